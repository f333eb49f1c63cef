"""Smooth kernels of the integral equation from the surface compliance of a stack.

A pressure of wavenumber k displaces the surface by w = (2/E*) L(k)/k p, > 0 into the body. For a
half-space L = 1, and M = 1 - L is the effect of everything below the top layer (`stack`). All
lengths in this module are in units of the top layer's thickness. Sources: Lebedev & Ufliand (1958),
PMM 22, 442; Sneddon, Mixed Boundary Value Problems (1966), for the Dini sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebvander

from indent_sim.theory.quadrature import (
    bessel_j1_zeros,
    gauss_legendre,
    join_nodes,
    wall_mode_nodes,
    wavenumber_nodes,
)
from indent_sim.theory.stack import Stack


@dataclass(frozen=True)
class Kernel:
    """Smooth symmetric kernel sum_j weight_j b_j(x) b_j(t).

    The functions b are cos(k x), cosh(y x) exp(-y W) and 1.
    """

    k: np.ndarray
    y: np.ndarray
    wall: float
    weight: np.ndarray

    def basis(self, x: np.ndarray) -> np.ndarray:
        """Return the basis functions b_j(x), shape (modes, len(x))."""
        cosines = np.cos(np.multiply.outer(self.k, x))
        if not self.y.size:
            return cosines
        # cosh(y x) alone would overflow, but its product with the weight does not; therefore it is
        # scaled by exp(-y W).
        y = self.y[:, None]
        hyperbolic = 0.5 * (np.exp(y * (x - self.wall)) + np.exp(-y * (x + self.wall)))
        return np.vstack([cosines, hyperbolic, np.ones((1, x.size))])

    def apply_weights(self, values: np.ndarray) -> np.ndarray:
        """Multiply the coefficients of the modes (*, modes, n) by the weights of the modes."""
        return self.weight[:, None] * values

    def solve_modes(
        self, direct: np.ndarray, projection: np.ndarray, modes_at_points: np.ndarray
    ) -> np.ndarray:
        """Solve m = direct + projection (modes_at_points m) for the coefficients m of the modes.

        The coefficients have the shape (*, modes, n).

        The linear system is solved for the values at the points, because near a wall the modes are
        nearly dependent and a system for the modes would lose digits.
        """
        point_matrix = np.eye(projection.shape[-1]) - modes_at_points @ projection
        return np.asarray(
            direct + projection @ np.linalg.solve(point_matrix, modes_at_points @ direct)
        )

    def slope_over_x(self, x: np.ndarray) -> np.ndarray:
        """Return b_j'(x)/x for x > 0, shape (modes, len(x)); finite as x -> 0, since b is even."""
        k = self.k[:, None]
        cosines = -k * np.sin(k * x) / x
        if not self.y.size:
            return cosines
        y = self.y[:, None]
        hyperbolic = y * np.exp(y * (x - self.wall)) * -np.expm1(-2.0 * y * x) / (2.0 * x)
        return np.vstack([cosines, hyperbolic, np.zeros((1, x.size))])

    def slope_integrals(self, a: np.ndarray) -> np.ndarray:
        """Return ∫_0^a b_j'(x)/x dx, shape (modes, len(a)).

        The integral is -k Si(k a) for the cosines; the other integrals are computed by quadrature.
        """
        from scipy.special import sici

        cosines = -self.k[:, None] * sici(np.multiply.outer(self.k, a))[0]
        if not self.y.size:
            return cosines
        # The integrand cosh(y x) is an entire function.
        x, w = gauss_legendre(0.0, 1.0, 64)
        hyperbolic = self.slope_over_x(np.multiply.outer(a, x).ravel())[self.k.size :].reshape(
            -1, a.size, x.size
        )
        return np.vstack([cosines, hyperbolic @ w * a])

    def surface_displacements(self, r: np.ndarray) -> np.ndarray:
        """Return (2/pi) ∫_0^r b_j(x)/sqrt(r^2 - x^2) dx, shape (modes, len(r)).

        These are J0(k r), I0(y r) exp(-y W) and 1.
        """
        from scipy.special import i0e, j0

        waves = j0(np.multiply.outer(self.k, r))
        if not self.y.size:
            return waves
        y = self.y[:, None]
        return np.vstack([waves, i0e(y * r) * np.exp(y * (r - self.wall)), np.ones((1, r.size))])


@dataclass(frozen=True)
class EvenKernel:
    """Kernel sum_jl matrix_jl b_j(x) b_l(t) of a few even polynomials on [0, max_radius].

    The polynomials are b_j = T_2j(x/max_radius).
    """

    max_radius: float
    matrix: np.ndarray

    def basis(self, x: np.ndarray) -> np.ndarray:
        """Return the basis functions b_j(x), shape (modes, len(x))."""
        return chebvander(self._chebyshev_argument(x), len(self.matrix) - 1).T

    def apply_weights(self, values: np.ndarray) -> np.ndarray:
        """Multiply the coefficients of the modes (*, modes, n) by the matrix of the kernel."""
        return self.matrix @ values

    def solve_modes(
        self, direct: np.ndarray, projection: np.ndarray, modes_at_points: np.ndarray
    ) -> np.ndarray:
        """Solve m = direct + projection (modes_at_points m) for the coefficients m of the modes.

        The coefficients have the shape (*, modes, n).
        """
        return np.asarray(
            np.linalg.solve(np.eye(len(self.matrix)) - projection @ modes_at_points, direct)
        )

    def slope_over_x(self, x: np.ndarray) -> np.ndarray:
        """Return b_j'(x)/x of the basis functions, shape (modes, len(x))."""
        derivative_matrix = _derivative_matrix(len(self.matrix))
        return (
            4.0
            / self.max_radius**2
            * (
                derivative_matrix
                @ chebvander(self._chebyshev_argument(x), derivative_matrix.shape[1] - 1).T
            )
        )

    def slope_integrals(self, a: np.ndarray) -> np.ndarray:
        """Return ∫_0^a b_j'(x)/x dx, shape (modes, len(a))."""
        x, w = gauss_legendre(0.0, 1.0, len(self.matrix))
        slopes = self.slope_over_x(np.multiply.outer(a, x).ravel())
        return np.asarray(slopes.reshape(-1, a.size, x.size) @ w * a)

    def _chebyshev_argument(self, x: np.ndarray) -> np.ndarray:
        """Return the argument at which the Chebyshev polynomial T_j equals T_2j(x/max_radius)."""
        return 2.0 * (x / self.max_radius) ** 2 - 1.0


@lru_cache(maxsize=8)
def _derivative_matrix(count: int) -> np.ndarray:
    """Return the Chebyshev coefficients (count, count - 1) of the derivatives of T_0, T_1, ..."""
    return np.ascontiguousarray(chebder(np.eye(count)).T)


def contact_kernel(a: float, stack: Stack, wall: float) -> Kernel | EvenKernel:
    """Return the kernel of `axisymmetric_kernel` for radii up to a, in polynomials if possible.

    Without walls the kernel is analytic within 2 h of the real axis, so that a few polynomials
    approximate it for smaller contacts. The kernels are cached for radii in powers of sqrt(2).
    """
    if math.isinf(wall) and a <= 2.0:
        max_radius = 2.0 ** (0.5 * math.ceil(2.0 * math.log2(max(a, 2.0**-10))))
        if polynomial_kernel := _polynomial_kernel(max_radius, stack):
            return polynomial_kernel
    return axisymmetric_kernel(a, stack, wall)


@lru_cache(maxsize=64)
def _polynomial_kernel(max_radius: float, stack: Stack) -> EvenKernel | None:
    """Return the kernel in even polynomials; None if too many polynomials are needed.

    cos(k x) = J_0(k R) + 2 sum_j (-1)^j J_2j(k R) T_2j(x/R) with R = max_radius.
    """
    from scipy.special import jv

    kernel = axisymmetric_kernel(max_radius, stack, math.inf)
    # Largest number of even polynomials of a kernel.
    max_polynomials = 32
    j = np.arange(max_polynomials)[:, None]
    waves = np.where(j == 0, 1.0, 2.0 * (-1.0) ** j) * jv(2 * j, kernel.k * max_radius)
    matrix = waves @ (kernel.weight[:, None] * waves.T)
    sizes = np.abs(matrix).max(axis=0)
    # Coefficients below round-off are left out.
    polynomial_count = max(1, int(np.count_nonzero(sizes > 1e-17 * sizes.max())))
    return (
        EvenKernel(max_radius, matrix[:polynomial_count, :polynomial_count])
        if polynomial_count < max_polynomials
        else None
    )


def axisymmetric_kernel(a: float, stack: Stack, wall: float) -> Kernel:
    """Return the kernel K(x, t) of phi(x) - (2/pi) ∫_0^a phi K dt = (E*/pi)(delta - g).

    wall = inf: K = ∫_0^inf M(s) cos(sx) cos(st) ds. With a frictionless wall at radius W the
    integral over L becomes the Dini sum over k_n = j_{1,n}/W. The kernel is valid for all radii up
    to a; it is cached for powers of two, so that similar radii use the same kernel.
    """
    max_radius = 2.0 ** math.ceil(math.log2(max(a, 1.0)))
    if math.isinf(wall):
        return _layer_kernel(max_radius, stack)
    clearance = 2.0 ** math.floor(math.log2(1.0 - a / wall))
    return _cylinder_kernel(min(max_radius, wall), clearance, stack, wall)


@lru_cache(maxsize=64)
def _layer_kernel(max_radius: float, stack: Stack) -> Kernel:
    """Return the kernel of an infinitely wide layer."""
    s, w = wavenumber_nodes(max_radius, stack.min_wavenumber)
    return Kernel(s, np.empty(0), math.inf, w * stack.compliance_complement(s))


@lru_cache(maxsize=64)
def _cylinder_kernel(max_radius: float, clearance: float, stack: Stack, wall: float) -> Kernel:
    """Return the kernel between walls: the half-space integral minus the Dini sum.

    This difference is smooth, so that the integral equation remains of the second kind.
    """
    # The sum is sum_n w_n cos cos
    #     = ∫ cos cos dk + (2/pi) ∫_0^inf [K1(yW)/I1(yW) cosh cosh - 2/(yW)^2] dy
    # with w_n = 2/(k_n W^2 J0(k_n W)^2). The double pole is the mean pressure of confined
    # compression.
    from scipy.special import j1, y1

    number, weight = wall_mode_nodes(max_radius, wall)
    zeros = bessel_j1_zeros(number)
    k = zeros / wall
    # The Wronskian gives J0^2 at the zeros of J1 as a smooth function of n.
    j0_squared = 4.0 / ((math.pi * zeros) ** 2 * (j1(zeros) ** 2 + y1(zeros) ** 2))
    dini = 2.0 * weight * stack.compliance_complement(k) / (k * wall**2 * j0_squared)
    z, wall_weight, pole = _wall_modes(clearance)
    weight = np.concatenate(
        [dini, -wall_weight / wall, [-pole / wall - stack.confined_compliance / wall**2]]
    )
    return Kernel(k, z / wall, wall, weight)


@lru_cache(maxsize=64)
def _wall_modes(clearance: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return nodes z = yW and weights of (2/pi) ∫_0^inf [K1/I1 cosh cosh - 2/z^2] dz.

    The singular part 2/z^2 is subtracted and integrated analytically; the constant that it
    contributes is the third returned value.
    """
    from scipy.special import i1e, k1e

    def scaled_bessel_ratio(z):
        """Return exp(2z) K1/I1; exp(2z) cancels the factors exp(-z) of two basis functions."""
        return k1e(z) / i1e(z)

    # The value of z at which the wall integral changes from its split to its direct form. Below it
    # K1/I1 - ln(z/2) is even and analytic but for the pole 2/z^2; above it K1/I1 decays as
    # pi exp(-2z).
    form_switch = 2.0
    z0, w0 = gauss_legendre(0.0, form_switch, 32)
    v, wv = gauss_legendre(0.0, 1.0, 48)
    z1 = form_switch * v**4
    w1 = form_switch * 4.0 * v**3 * wv
    parts = [
        (
            z0,
            w0
            * (scaled_bessel_ratio(z0) * np.exp(-2.0 * z0) - np.log(z0 / 2.0))
            * np.exp(2.0 * z0),
        )
    ]
    parts.append((z1, w1 * np.log(z1 / 2.0) * np.exp(2.0 * z1)))
    end = max(2.0 * form_switch, 19.0 / clearance)
    edges = form_switch * np.geomspace(
        1.0, end / form_switch, 1 + math.ceil(math.log(end / form_switch, 3.0))
    )
    for lo, hi in pairwise(edges):
        z, w = gauss_legendre(lo, hi, 28)
        parts.append((z, w * scaled_bessel_ratio(z)))
    pole = -float(np.sum(w0 * 2.0 / z0**2)) - 2.0 / form_switch
    nodes, weights = join_nodes(parts)
    return nodes, 2.0 / math.pi * weights, 2.0 / math.pi * pole
