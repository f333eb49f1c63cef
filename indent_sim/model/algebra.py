"""Functions for formulas that accept both UFL expressions and numpy arrays.

A formula is written once; the solver differentiates it symbolically and numpy evaluates it.
"""

from __future__ import annotations

from functools import partial
from math import pi
from typing import Any

import numpy as np

# A number, an array or a UFL expression, which has no static type.
Expr = Any


class _Ufl:
    """UFL, imported on first use, because planning and evaluation of results do not need it."""

    def __getattr__(self, name: str) -> Expr:
        import ufl

        return getattr(ufl, name)


ufl = _Ufl()


def is_symbolic(*values: Expr) -> bool:
    """Return whether any of the values is a UFL expression."""
    return any(hasattr(value, "ufl_shape") for value in values)


def _apply_function(name: str, x: Expr) -> Expr:
    """Return numpy's or UFL's function of the given numpy name, applied to x."""
    return (
        getattr(ufl, "ln" if name == "log" else name)(x) if is_symbolic(x) else getattr(np, name)(x)
    )


def _apply_to_degrees(name: str, degrees: Expr) -> Expr:
    """Return the trigonometric function of the given numpy name for an angle in degrees."""
    return _apply_function(
        name, degrees * pi / 180 if is_symbolic(degrees) else np.radians(degrees)
    )


# `log` is the natural logarithm.
sqrt, log, exp = (partial(_apply_function, name) for name in ("sqrt", "log", "exp"))
# Angles are in degrees.
sin, cos, tan = (partial(_apply_to_degrees, name) for name in ("sin", "cos", "tan"))

# Largest |x| at which ln(1 + x) and its derivatives come from a series, which loses no digits.
LOG_SERIES_LIMIT = 0.03
# ln(1 + x) = 2 z (1 + z^2/3 + z^4/5 + ...) with z = x / (2 + x); the next term is 1e-19.
LOG_SERIES_FACTORS = (1 / 3, 1 / 5, 1 / 7, 1 / 9)


def log1p(x: Expr) -> Expr:
    """Return ln(1 + x) without loss of digits at small x."""
    z = x / (2 + x)
    return _where_small(x, 2 * z + 2 * z**3 * _odd_series(z), log(1 + x))


def log1p_remainder(x: Expr) -> Expr:
    """Return x - ln(1 + x), which is x^2/2 for small x."""
    z = x / (2 + x)
    return _where_small(x, 2 * z * z / (1 - z) - 2 * z**3 * _odd_series(z), x - log(1 + x))


def expm1_remainder(x: Expr) -> Expr:
    """Return e^x - 1 - x, which is x^2/2 for small x."""
    # The series goes up to x^10/10!, so that its second derivative is exact to 2e-17, the next term
    # x^9/9! at LOG_SERIES_LIMIT.
    series: Expr = 0.0
    for n in range(10, 2, -1):
        series = (1 + series) * x / n
    return _where_small(x, x * x / 2 * (1 + series), exp(x) - 1 - x)


def _odd_series(z: Expr) -> Expr:
    """Return the series 1/3 + z^2/5 + z^4/7 + ..., which appears in ln(1 + x)."""
    z_squared = z * z
    series = 0.0
    for factor in reversed(LOG_SERIES_FACTORS):
        series = factor + z_squared * series
    return series


def _where_small(x: Expr, small_value: Expr, large_value: Expr) -> Expr:
    """Return `small_value` where |x| < LOG_SERIES_LIMIT, and `large_value` elsewhere."""
    return where_less(x * x, LOG_SERIES_LIMIT**2, small_value, large_value)


def where_less(a: Expr, b: Expr, then: Expr, otherwise: Expr) -> Expr:
    """Return `then` where a < b, and `otherwise` elsewhere.

    Both branches are evaluated and must be finite.
    """
    if is_symbolic(a, b, then, otherwise):
        return ufl.conditional(ufl.lt(a, b), then, otherwise)
    return np.where(np.less(a, b), then, otherwise)


def minimum(a: Expr, b: Expr) -> Expr:
    """Return the smaller of two expressions."""
    return where_less(a, b, a, b)


def maximum(a: Expr, b: Expr) -> Expr:
    """Return the larger of two expressions."""
    return where_less(a, b, b, a)


def macaulay(x: Expr) -> Expr:
    """Return the Macaulay bracket <x> = (x + |x|)/2 (notes, equation 3.2)."""
    return where_less(0.0, x, x, 0.0 * x)


# Largest norm of the deviator for which sums of powers are computed from their series.
SMALL_DEVIATOR = 3e-3


def power_sum(exponent: Expr, square: Expr, cube: Expr) -> Expr:
    """Return sum (1 + t_i)^exponent - 3 for three t_i with sum zero, by the binomial series.

    The arguments are square = sum t_i^2/6 and cube = t_1 t_2 t_3. The sums of the k-th powers are
    p_k = 3 square p_(k-2) + cube p_(k-3) (Newton's identities), with p_0 = 3, p_1 = 0.
    """
    sums = [3.0, 0.0, 6 * square]
    binomial = exponent
    total = 0.0 * square
    # The next term, of the eighth power, is 1e-17 at SMALL_DEVIATOR, which is 1e-12 of the sum.
    for k in range(2, 8):
        binomial = binomial * (exponent - (k - 1)) / k
        total = total + binomial * sums[-1]
        sums.append(3 * square * sums[-2] + cube * sums[-3])
    return total


def unimodular_stretches(mean: Expr, square: Expr, cube: Expr) -> tuple[Expr, Expr, Expr]:
    """Return the principal stretches for det F = 1, as one distinct stretch and a pair.

    With C = F^T F, the squared stretch that is farthest from the others is mean + 2 sqrt(square) y
    with 4 y^3 - 3 y = cosine (Cardano). Newton's method solves this equation without the singular
    point of the arc cosine; the other two stretches follow from the trace, the product and 1 - y^2.
    All three results are smooth where two stretches are equal, as they are everywhere in uniaxial
    stress, whereas the difference of the pair is not smooth there.

    Parameters
    ----------
    mean : Expr
        tr C/3 (UFL or floats).
    square : Expr
        dev C : dev C/6.
    cube : Expr
        det dev C.

    Returns
    -------
    tuple of Expr
        The distinct stretch, the mean m of the other two stretches l2 and l3, and the square ((l2 -
        l3)/(l2 + l3))^2 of half their difference divided by m.
    """
    # A principal stretch has no derivative where two of them are equal, but a symmetric function of
    # the stretches has. Where all three are equal, this number keeps the root away from zero, and
    # symmetric functions are computed from their series instead (`power_sum`).
    regularization = 1e-6
    radius = sqrt(square + regularization**2)
    cosine = cube / (2 * radius**3)
    sign = where_less(cosine, 0.0 * cosine, -1.0, 1.0)
    cosine = sign * cosine
    # This initial guess of the largest root is accurate to 0.3 % for a cosine from 0 to 1. Two
    # Newton steps give the root to round-off, and one further step each derivative.
    y = 0.866 + 0.134 * cosine
    for _ in range(4):
        y = (8 * y**3 + cosine) / (12 * y * y - 3)
    distinct_stretch = sqrt(mean + 2 * sign * radius * y)
    # Product of the other two stretches: all three are roots of one cubic.
    product = sqrt(1 - 3 * mean * regularization**2) / distinct_stretch
    mean_stretch = sqrt(3 * mean - distinct_stretch * distinct_stretch + 2 * product) / 2
    return distinct_stretch, mean_stretch, radius * radius * 3 * (1 - y * y) / (4 * mean_stretch**4)


def pair_power_sum(exponent: Expr, mean_stretch: Expr, spread: Expr) -> Expr:
    """Return l2^exponent + l3^exponent for the pair of `unimodular_stretches`.

    Near l2 = l3 the binomial series 2 m^a sum_k C(a, 2 k) spread^k is used, because second
    derivatives of the square root of the spread lose all digits there.

    Parameters
    ----------
    exponent : Expr
        Exponent a.
    mean_stretch : Expr
        Mean m of the pair.
    spread : Expr
        Squared relative half difference of the pair.
    """
    series = 1.0 + 0.0 * spread
    binomial = 1.0
    power = 1.0 + 0.0 * spread
    for k in range(1, 7):
        binomial = (
            binomial * (exponent - 2 * k + 2) * (exponent - 2 * k + 1) / ((2 * k - 1) * (2 * k))
        )
        power = power * spread
        series = series + binomial * power
    # Largest squared relative difference at which a pair of stretches is summed by six terms of its
    # series; the next one is 1e-13 of the sum for exponents up to 30.
    series_limit = 1e-3
    root = sqrt(maximum(spread, series_limit))
    direct_sum = (1 + root) ** exponent + (1 - root) ** exponent
    return mean_stretch**exponent * where_less(spread, series_limit, 2 * series, direct_sum)
