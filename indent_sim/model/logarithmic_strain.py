"""Squares of logarithmic strains as functions of the invariants of the stretches.

With the squared stretches b_i = exp(2 e_i), z_i = (b_i - 1)/(b_i + 1) = tanh e_i. The elementary
symmetric functions of the z_i are rational functions of those of the b_i - 1, and sum e_i^2 is a
power series in the sums of the powers of the z_i: near the undeformed state no eigenvalues are
needed, and no digit is lost.
"""

from __future__ import annotations

from indent_sim.model.algebra import (
    Expr,
    exp,
    expm1_remainder,
    log,
    log1p,
    log1p_remainder,
    maximum,
    sqrt,
    unimodular_stretches,
    where_less,
)

# Coefficients of (artanh z)^2 = z^2 + 2/3 z^4 + 23/45 z^6 + ...
ARTANH_SQUARE_SERIES = (
    1.0,
    2 / 3,
    23 / 45,
    44 / 105,
    563 / 1575,
    3254 / 10395,
    88069 / 315315,
)
# Largest dev C : dev C/6 at which the series is used, which is |e| < 0.1. There it is accurate to
# 1e-12. The formula in the stretches is accurate to 1e-10 up to |e| = 2 and to 1e-9 at 3, and not
# better, because `unimodular_stretches` keeps a root away from zero. Checked by:
# tests/unit/model/test_plasticity.py.
SERIES_LIMIT = 0.015


def square_of_unimodular(excess: Expr, square: Expr, cube: Expr) -> Expr:
    """Return sum e_i^2 of the logarithms e_i of three stretches whose product is one.

    Parameters
    ----------
    excess : Expr
        tr C/3 - 1 of the tensor C with the squared stretches.
    square : Expr
        dev C : dev C/6.
    cube : Expr
        det dev C.
    """
    return where_less(
        square,
        SERIES_LIMIT,
        _series(excess, square, cube),
        # Used far from the undeformed state. Near it the derivatives are finite, but not used.
        _square_of_stretches(*unimodular_stretches(1 + excess, square, cube)),
    )


def deviator_square(trace: Expr, square: Expr, cube: Expr) -> Expr:
    """Return dev e : dev e of the logarithmic strain e = ln(b)/2 of any tensor b = 1 + a.

    Parameters
    ----------
    trace : Expr
        tr a.
    square : Expr
        dev a : dev a/6.
    cube : Expr
        det dev a.
    """
    mean = trace / 3
    second = 3 * (mean * mean - square)
    third = mean * (mean * mean - 3 * square) + cube
    growth = trace + second + third
    log_J = log1p(growth) / 2
    # tr a/2 - ln J = w, without the cancellation of the first order
    w = (log1p_remainder(growth) - second - third) / 2
    factor = exp(-2 * log_J / 3)
    excess = factor * (2 * w / 3 - expm1_remainder(2 * log_J / 3))
    return square_of_unimodular(excess, factor**2 * square, factor**3 * cube)


def _series(excess: Expr, square: Expr, cube: Expr) -> Expr:
    """Return sum e_i^2 by the series in z_i = tanh e_i."""
    # Elementary symmetric functions of b_i - 1, then of the z_i
    a1 = 3 * excess
    a2 = 3 * (excess * excess - square)
    a3 = excess * (excess * excess - 3 * square) + cube
    denominator = 8 + 4 * a1 + 2 * a2 + a3
    e1 = (4 * a1 + 4 * a2 + 3 * a3) / denominator
    e2 = (2 * a2 + 3 * a3) / denominator
    e3 = a3 / denominator
    sums = [3.0, e1, e1 * e1 - 2 * e2]
    total = 0.0
    for k, coefficient in enumerate(ARTANH_SQUARE_SERIES, start=1):
        while len(sums) <= 2 * k:  # Newton's identities
            sums.append(e1 * sums[-1] - e2 * sums[-2] + e3 * sums[-3])
        total = total + coefficient * sums[2 * k]
    return total


def _square_of_stretches(distinct_stretch: Expr, mean_stretch: Expr, spread: Expr) -> Expr:
    """Return sum e_i^2 from the results of `unimodular_stretches`."""
    mean_log = log(mean_stretch)
    # ln(1 + r) + ln(1 - r) with r^2 = spread; their half difference is artanh r
    log_sum = log1p(-spread)
    return (
        log(distinct_stretch) ** 2
        + 2 * mean_log * (mean_log + log_sum)
        + log_sum * log_sum / 2
        + 2 * _artanh_square(spread)
    )


def _artanh_square(spread: Expr) -> Expr:
    """Return (artanh r)^2 for r^2 = spread, by a series where both stretches are close."""
    # Up to this spread the first term left out is 1e-15 of the sum.
    limit = 0.01
    series: Expr = 0.0
    for coefficient in reversed(ARTANH_SQUARE_SERIES):
        series = (series + coefficient) * spread
    root = sqrt(maximum(spread, limit))
    artanh = log((1 + root) / (1 - root)) / 2
    return where_less(spread, limit, series, artanh * artanh)
