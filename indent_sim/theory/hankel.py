"""Surface compliance of an elastic layer in wave-number space, and the smooth kernels made of it.

A pressure of wave number k on a layer of thickness h displaces its surface by w = (2/E*) L(kh)/k p, > 0
into the body; L -> 1 is the half-space and M = 1 - L is what the base adds. All lengths in this file are in
units of h.
Sources: Lebedev & Ufliand (1958), PMM 22, 442; Hayes et al. (1972), J. Biomech. 5, 541; Sneddon, Mixed
Boundary Value Problems (1966), for the Dini sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from indent_sim.theory.solution import BASES

S_MAX = 22.0  # M(22) < 2e-16
CHANGE = 2.0  # k W at which the wall integral changes from its split to its direct form


def base_complement(s: np.ndarray, nu: float, base: str) -> np.ndarray:
    """M(s) = 1 - L(s) for s > 0 [-], free of cancellation and overflow; s = kh, shape of s.

    fixed:  L = (2K sinh 2s - 4s)/(2K cosh 2s + 1 + K^2 + 4s^2), K = 3 - 4 nu (Hayes et al. 1972)
    roller: L = (cosh 2s - 1)/(sinh 2s + 2s), for every nu (Lebedev & Ufliand 1958)
    Raises ValueError if base is neither.
    """
    decay = np.exp(-2.0 * s)
    if base == "fixed":
        K = 3.0 - 4.0 * nu
        rest = 1.0 + K * K + 4.0 * s * s
        return decay * (2.0 * K * decay + rest + 4.0 * s) / (K * (1.0 + decay**2) + rest * decay)
    if base == "roller":
        return decay * (2.0 * s - np.expm1(-2.0 * s)) / (-0.5 * np.expm1(-4.0 * s) + 2.0 * s * decay)
    raise ValueError(f"base must be one of {BASES}, got {base!r}")


@dataclass(frozen=True)
class Kernel:
    """Smooth symmetric kernel sum_j weight_j b_j(x) b_j(t), b = cos(k x), cosh(y x) exp(-y W) and 1."""

    k: np.ndarray
    y: np.ndarray
    wall: float
    weight: np.ndarray

    def basis(self, x: np.ndarray) -> np.ndarray:
        """b_j(x), shape (modes, len(x))."""
        cosines = np.cos(np.multiply.outer(self.k, x))
        if not self.y.size:
            return cosines
        # scaled by exp(-y W): cosh alone overflows, its product with the weight does not
        y = self.y[:, None]
        hyperbolic = 0.5 * (np.exp(y * (x - self.wall)) + np.exp(-y * (x + self.wall)))
        return np.vstack([cosines, hyperbolic, np.ones((1, x.size))])

    def slope_over_x(self, x: np.ndarray) -> np.ndarray:
        """b_j'(x)/x for x > 0, shape (modes, len(x)); finite as x -> 0 because every b is even."""
        k = self.k[:, None]
        cosines = -k * np.sin(k * x) / x
        if not self.y.size:
            return cosines
        y = self.y[:, None]
        hyperbolic = y * np.exp(y * (x - self.wall)) * -np.expm1(-2.0 * y * x) / (2.0 * x)
        return np.vstack([cosines, hyperbolic, np.zeros((1, x.size))])


def axisymmetric_kernel(a: float, nu: float, base: str, wall: float) -> Kernel:
    """Kernel K(x, t) of phi(x) - (2/pi) ∫_0^a phi K dt = (E*/pi)(delta - g), good for every radius up to a.

    wall = inf: K = ∫_0^inf M(s) cos(sx) cos(st) ds. With a frictionless wall at radius W the integral over L
    becomes the Dini sum over k_n = j_{1,n}/W. Cached in powers of two, so that neighbouring radii share one
    kernel.
    """
    if math.isinf(wall):
        return _layer_kernel(2.0 ** math.ceil(math.log2(max(a, 1.0))), nu, base)
    clearance = 2.0 ** math.floor(math.log2(1.0 - a / wall))
    return _cylinder_kernel(clearance, nu, base, wall)


@lru_cache(maxsize=64)
def _layer_kernel(reach: float, nu: float, base: str) -> Kernel:
    s, w = gauss(0.0, S_MAX, 100 + math.ceil(12.0 * reach))
    return Kernel(s, np.empty(0), math.inf, w * base_complement(s, nu, base))


@lru_cache(maxsize=64)
def _cylinder_kernel(clearance: float, nu: float, base: str, wall: float) -> Kernel:
    """Dini sum over L, as the half-space integral + smooth terms: the equation stays of the second kind.

    sum_n w_n cos cos = ∫ cos cos dk + (2/pi) ∫_0^inf [K1(yW)/I1(yW) cosh cosh - 2/(yW)^2] dy,
    w_n = 2/(k_n W^2 J0(k_n W)^2); the double pole belongs to the mean pressure, whose own term is that of
    confined compression: E* h/(W^2 M_c), with M_c the oedometric modulus; zero for nu = 0.5.
    """
    from scipy.special import j0

    zeros = bessel_j1_zeros(max(1, math.ceil(S_MAX * wall / math.pi)))
    k = zeros / wall
    dini = 2.0 * base_complement(k, nu, base) / (k * (wall * j0(zeros)) ** 2)
    z, wall_weight, pole = _wall_modes(clearance)
    uniform = (1.0 - 2.0 * nu) / ((1.0 - nu) * wall) ** 2
    weight = np.concatenate([dini, -wall_weight / wall, [-pole / wall - uniform]])
    return Kernel(k, z / wall, wall, weight)


@lru_cache(maxsize=64)
def _wall_modes(clearance: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Nodes z = yW and weights of (2/pi) ∫_0^inf [K1/I1 cosh cosh - 2/z^2] dz, and the constant left over.

    Below CHANGE, K1/I1 - ln(z/2) is even and analytic but for the pole 2/z^2: plain Gauss. ln(z/2) goes to
    nodes graded towards 0. Above CHANGE, K1/I1 decays as pi exp(-2z) against cosh cosh <= exp(2za/W):
    geometric panels.
    """
    from scipy.special import i1e, k1e

    def ratio(z):  # exp(2z) K1/I1; the factor cancels those of the scaled basis
        return k1e(z) / i1e(z)

    z0, w0 = gauss(0.0, CHANGE, 32)
    v, wv = gauss(0.0, 1.0, 48)
    z1, w1 = CHANGE * v**4, CHANGE * 4.0 * v**3 * wv
    nodes = [z0, z1]
    weights = [
        w0 * (ratio(z0) * np.exp(-2.0 * z0) - np.log(z0 / 2.0)) * np.exp(2.0 * z0),
        w1 * np.log(z1 / 2.0) * np.exp(2.0 * z1),
    ]
    end = max(2.0 * CHANGE, 19.0 / clearance)
    edges = CHANGE * np.geomspace(1.0, end / CHANGE, 1 + math.ceil(math.log(end / CHANGE, 3.0)))
    for lo, hi in pairwise(edges):
        z, w = gauss(lo, hi, 28)
        nodes.append(z)
        weights.append(w * ratio(z))
    pole = -float(np.sum(w0 * 2.0 / z0**2)) - 2.0 / CHANGE
    scale = 2.0 / math.pi
    return np.concatenate(nodes), scale * np.concatenate(weights), scale * pole


def bessel_j1_zeros(count: int) -> np.ndarray:
    """The first `count` positive zeros of J1, by McMahon's expansion and three Newton steps."""
    from scipy.special import j0, j1

    b = (np.arange(1, count + 1) + 0.25) * math.pi
    z = b - 3.0 / (8.0 * b) + 36.0 / (3.0 * (8.0 * b) ** 3)
    for _ in range(3):
        z = z - j1(z) / (j0(z) - j1(z) / z)
    return z


def gauss(lo: float, hi: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [lo, hi], each of shape (count,)."""
    x, w = _legendre(count)
    return 0.5 * (lo + hi) + 0.5 * (hi - lo) * x, 0.5 * (hi - lo) * w


@lru_cache(maxsize=256)
def _legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """numpy's leggauss, kept: an eigenvalue problem of this size would dominate a solve."""
    return np.polynomial.legendre.leggauss(count)
