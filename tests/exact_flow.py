"""Exact answers for bodies with fluid in their pores (Biot, small strain): numpy and scipy only.

D = k M_c with the drained confined modulus M_c, grains and fluid incompressible, unless said otherwise.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.optimize import brentq
from scipy.special import j0, j1

MANY = 400  # terms of a series: the next one is below round-off at the times asked for
PANELS = 100


def confined_modulus(E: float, nu: float) -> float:
    """M_c [pressure]."""
    return E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))


def confined_ramp(E: float, nu: float, k: float, h: float, V: float, t: float) -> float:
    """Pressure on a porous lid that goes down at the speed V on a layer h between frictionless walls (Terzaghi)."""
    M, n = confined_modulus(E, nu), np.arange(1, MANY)
    D = k * M
    decay = (np.exp(-((n * np.pi / h) ** 2) * D * t) / n**2).sum()
    return float(M * (V * t / h + V * h / D * (1 / 3 - 2 / np.pi**2 * decay)))


def terzaghi(E: float, nu: float, k: float, h: float, sigma: float, t: float) -> float:
    """Settlement of the same layer under a sudden pressure sigma on its porous lid."""
    M, m = confined_modulus(E, nu), (2 * np.arange(MANY) + 1) * np.pi / 2
    return float(sigma * h / M * (1 - (2 / m**2 * np.exp(-(m**2) * k * M * t / h**2)).sum()))


def unconfined(E: float, nu: float, k: float, a: float, strain: float, t: float) -> float:
    """Force on a disc of radius a between frictionless sealed plates, its side free and drained, suddenly shortened
    (Armstrong, Lai & Mow 1984, J. Biomech. Eng. 106, 165)."""
    ends = np.arange(40) * np.pi + 1e-9

    def zero(x: float) -> float:
        return float((1 - nu) * x * j0(x) - (1 - 2 * nu) * j1(x))

    x = np.array([brentq(zero, a, b) for a, b in pairwise(ends) if zero(a) * zero(b) < 0])
    A = (1 - nu) * (1 - 2 * nu) / (1 + nu) / ((1 - nu) ** 2 * x**2 - (1 - 2 * nu))
    decay = np.exp(-(x**2) * k * confined_modulus(E, nu) * t / a**2)
    return float(np.pi * a**2 * E * strain * (1 + (A * decay).sum()))


def mandel(E: float, nu: float, k: float, a: float, x: float, F: float, t: float) -> tuple[float, float]:
    """Pressure at x and shortening per height of a strip |x| <= a under the sudden force 2 F per length, its sides free
    and drained, its plates rigid, frictionless and sealed (Mandel 1953)."""
    G, T = E / (2 * (1 + nu)), k * confined_modulus(E, nu) * t / a**2
    slope = (1 - nu) / (0.5 - nu)
    roots = [
        brentq(lambda b: np.sin(b) - slope * b * np.cos(b), n * np.pi + 1e-6 * (n == 0), (n + 0.5) * np.pi)
        for n in range(100)
    ]
    b = np.array(roots)
    s = np.sin(b) / (b - np.sin(b) * np.cos(b))
    decay = np.exp(-(b**2) * T)
    pressure = F / a * (s * (np.cos(b * x / a) - np.cos(b)) * decay).sum()
    return float(pressure), float(F / (2 * G * a) * ((1 - nu) - (s * np.cos(b) * decay).sum()))


def punch_relaxation(nu: float, surface: str, tau: float, nodes: int = 48, longest: float = 400.0) -> float:
    """F/F(0+) of a flat punch of radius a suddenly pressed into a half-space whose surface is drained or sealed all
    over; tau = D t/a^2. Dual integral equations in Laplace space, inverted along Talbot's contour with 24 nodes."""
    M = 24
    theta = np.arange(1, M) * np.pi / M
    cot = 1 / np.tan(theta)
    contour = np.concatenate([[2 * M / 5], 2 * np.arange(1, M) * np.pi / 5 * (cot + 1j)])
    slope = np.concatenate([[0.5], 1 + 1j * theta * (1 + cot**2) - 1j * cot])
    weights = np.exp(contour) * slope
    found = [_punch_in_laplace(nu, surface, s, nodes, longest) for s in contour / tau]
    return float(0.4 / tau * (weights * found).real.sum())


def _punch_in_laplace(nu: float, surface: str, s: complex, nodes: int, longest: float) -> complex:
    """F/F(0+) at s [D/a^2]: (1 - r)/s int phi with phi - int K phi = 1 on 0 < y < 1."""
    r = (1 - 2 * nu) / (2 * (1 - nu))
    y, w = leggauss(nodes)
    y, w = (y + 1) / 2, w / 2
    point, weight = leggauss(30)  # in each of PANELS parts, which are shorter where k is small
    share = ((np.arange(PANELS)[:, None] + (point + 1) / 2) / PANELS).ravel()
    k, dk = longest * share**2, longest * 2 * share * np.tile(weight / 2, PANELS) / PANELS
    gamma = np.sqrt(k**2 + s)
    if surface == "drained":
        L, c = 1 / (1 - 2 * r * k / (gamma + k)), r / (4 * (1 - r))
    else:
        L, c = 1 / (1 - 2 * r * k**2 / (gamma * (gamma + k))), 3 * r / (4 * (1 - r))
    rest = 1 - (1 - r) * L - c * s / (k**2 + s)
    cosines = np.cos(np.outer(y, k))
    smooth = 2 / np.pi * (cosines * (rest * dk)) @ cosines.T
    root = np.sqrt(s)

    def kink(distance: np.ndarray) -> np.ndarray:
        return np.exp(-root * distance)

    # (2/pi) int c s/(k^2 + s) cos kx cos ky dk = c root/2 (e^(-root |x - y|) + e^(-root (x + y)))
    x, z = y[:, None], y[None, :]
    smooth = smooth + c * root / 2 * kink(x + z)
    ridge = c * root / 2 * kink(np.abs(x - z)) * w
    exact = c * root / 2 * ((1 - np.exp(-root * y)) + (1 - np.exp(-root * (1 - y)))) / root  # int of the ridge times 1
    whole = smooth * w + ridge
    whole = whole + np.diag(exact - ridge.sum(axis=1))
    phi = np.linalg.solve(np.eye(nodes) - whole, np.ones(nodes))
    return complex((1 - r) / s * (w * phi).sum())
