"""Exact solutions of bodies that drain or relax, as functions of time.

E and nu are linear drained constants, k is permeability over viscosity [length^2/(pressure time)],
grains and fluid are incompressible, and D = M_c k. Compression, settlement and fluid pressure are
positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import cos, exp, pi, sin

import numpy as np
from numpy.polynomial import Polynomial
from scipy.optimize import brentq
from scipy.special import j0, j1, jn_zeros

TERMS = 400  # of every series: at D t = 1e-4 a^2 the last is e^-150


def confined_modulus(E: float, nu: float) -> float:
    """The confined modulus M_c [pressure]."""
    return E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))


def _decays(rates: np.ndarray, T: float) -> np.ndarray:
    return np.exp(-rates * T)


def confined_ramp(E: float, nu: float, k: float, h: float, V: float, t: float) -> float:
    """Pressure on the drained top of a layer between rigid walls, pressed in with the speed V.

    The layer has the height h.
    """
    M = confined_modulus(E, nu)
    D, n = M * k, np.arange(1, TERMS)
    left = 2 / pi**2 * float(np.sum(_decays(n**2 * pi**2, D * t / h**2) / n**2))
    return M * (V * t / h + V * h / D * (1 / 3 - left))


def terzaghi_settlement(E: float, nu: float, k: float, h: float, sigma: float, t: float) -> float:
    """Settlement of the drained top of a confined layer under a pressure sigma applied at t = 0."""
    M = confined_modulus(E, nu)
    m = (2 * np.arange(TERMS) + 1) * pi / 2
    return sigma * h / M * (1 - float(np.sum(2 / m**2 * _decays(m**2, M * k * t / h**2))))


def unconfined_force(E: float, nu: float, k: float, a: float, eps: float, t: float) -> float:
    """Force on a disc suddenly shortened between sealed frictionless plates, its side drained.

    The disc has the radius a and the strain eps (Armstrong, Lai & Mow 1984).
    """
    T, x = confined_modulus(E, nu) * k * t / a**2, _unconfined_roots(nu)
    A = (1 - nu) * (1 - 2 * nu) / (1 + nu) / ((1 - nu) ** 2 * x**2 - (1 - 2 * nu))
    return pi * a**2 * E * eps * (1 + float(np.sum(A * _decays(x**2, T))))


def _unconfined_roots(nu: float) -> np.ndarray:
    """Roots of (1 - nu) x J0(x) = (1 - 2 nu) J1(x), one before each zero of J1."""
    ends = [0.0, *jn_zeros(1, TERMS)]

    def equation(x: float) -> float:
        return float((1 - nu) * x * j0(x) - (1 - 2 * nu) * j1(x))

    return np.array(
        [brentq(equation, low + 1e-9, high, xtol=1e-14) for low, high in pairwise(ends)]
    )


def mandel(
    E: float, nu: float, k: float, a: float, x: float, F: float, t: float
) -> tuple[float, float]:
    """Fluid pressure at x and shortening over height of Mandel's strip.

    The strip |x| <= a between sealed frictionless plates is suddenly pressed by a force 2 F per
    length; its sides are drained (Mandel 1953).
    """
    G, T = E / (2 * (1 + nu)), confined_modulus(E, nu) * k * t / a**2
    b = np.array([_mandel_root((1 - nu) / (0.5 - nu), n) for n in range(TERMS)])
    s, left = np.sin(b) / (b - np.sin(b) * np.cos(b)), _decays(b**2, T)
    pressure = F / a * float(np.sum(s * (np.cos(b * x / a) - np.cos(b)) * left))
    return pressure, F / (2 * G * a) * (1 - nu - float(np.sum(s * np.cos(b) * left)))


def _mandel_root(slope: float, n: int) -> float:
    """The root of tan b = slope b between n pi and n pi + pi/2."""
    low, high = n * pi + (1e-6 if n == 0 else 0.0), n * pi + pi / 2
    return float(brentq(lambda b: sin(b) - slope * b * cos(b), low, high, xtol=1e-15))


def relaxing_bar(
    E: float, nu: float, fractions: Sequence[float], times: Sequence[float], t: float
) -> float:
    """Stress per strain of a bar, suddenly stretched and held, whose shear modulus alone relaxes.

    The bulk modulus stays kappa; the shear modulus in Laplace space is s G(s) = N/P, a ratio of
    polynomials. The bar has s E(s) = 9 kappa N/(3 kappa P + N), and E(t) follows by partial
    fractions.
    """
    kappa = E / (3 * (1 - 2 * nu))
    N, P = _shear_ratio(E / (2 * (1 + nu)), fractions, times)
    below = 3 * kappa * P + N
    poles = below.roots()
    rest = 9 * kappa * N(0.0) / below(0.0)
    residues = 9 * kappa * N(poles) / (poles * below.deriv()(poles))
    return float(rest + np.real(np.sum(residues * np.exp(poles * t))))


def _shear_ratio(
    G: float, fractions: Sequence[float], times: Sequence[float]
) -> tuple[Polynomial, Polynomial]:
    """Numerator and denominator of s G(s) = G (1 - sum g/(1 + s tau))."""
    factors = [Polynomial([1.0, tau]) for tau in times]
    P = Polynomial([1.0])
    for factor in factors:
        P = P * factor
    N = P
    for g, factor in zip(fractions, factors, strict=True):
        N = N - g * (P // factor)
    return G * N, P


def held_incompressible(fractions: Sequence[float], times: Sequence[float], t: float) -> float:
    """F(t)/F(0) of an incompressible body, suddenly deformed and held.

    It holds for any law and shape, as nothing moves in the hold.
    """
    return 1 - sum(g * (1 - exp(-t / tau)) for g, tau in zip(fractions, times, strict=True))
