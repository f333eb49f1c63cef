"""Axisymmetric frictionless indentation of an elastic layer or stack with a surface tension.

A surface tension gamma acts on a curved surface like the pressure gamma lap u_z, which flattens it.
A tip's pressure p of wavenumber k then displaces the surface by C/(1 + gamma k^2 C) p instead of
C p, with the compliance C = (2/E*) L(k)/k of the `stack`. L is thus replaced by

    L_gamma = L/(1 + b k L) = 1/(1 + b k) - M/((1 + b k L)(1 + b k)),   b = 2 gamma/E*,  M = 1 - L,

and the integral equation of `layer` becomes, for 0 <= x <= a,

    (1/pi) ∫_-a^a phi(t) k0(x - t) dt - (2/pi) ∫_0^a phi(t) K(x, t) dt = (E*/pi) (delta - g(x)),
    K(x, t) = ∫_0^inf M/((1 + b k L)(1 + b k)) cos kx cos kt dk,
    k0(s) = ∫_0^inf cos ks/(1 + b k) dk = G(|s|/b)/b,   G(z) = ∫_0^inf cos t/(t + z) dt.

K is smooth, k0 has a logarithm at s = 0 and the width b. With t = a cos(theta) the even solutions
are

    phi = c/sin(theta) + sum_n d_n sin((2n + 1) theta):

a line force along the edge (c), and pressures p = (E*/2a) sum_n (2n + 1) d_n P_n(2 r^2/a^2 - 1)
that are finite at the edge. For a smooth tip c = 0, because the surface has no kink at the edge.
The coefficients c and d_n are found by collocation.

If the contact is much smaller than gamma/E*, the surface is a membrane: under a paraboloid p = 2
gamma/R, F = 2 pi gamma a^2/R and, on a half-space, delta = a^2/R (ln(4 gamma/(E* a)) + 1/2 -
0.5772...).

Small strain, gap at the reference radius. delta, force and pressure are > 0 in indentation. Any
consistent units; lengths [h] are in units of the top layer's thickness h.
Sources: Hajji (1978), J. Appl. Mech. 45, 320; Long & Wang (2013), Proc. R. Soc. A 469, 20120567;
Abramowitz & Stegun 5.2.13 for G; Sneddon (1966), Mixed Boundary Value Problems, section 2.1, for
the transforms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev

from indent_sim.theory.contact_curve import ContactCurve, field_of_position
from indent_sim.theory.layer import Layer
from indent_sim.theory.measured_constants import (
    TENSION_ERROR_OF_KINKED_TIPS,
    TENSION_ERROR_OF_PUNCHES,
    TENSION_ERROR_OF_SMOOTH_TIPS,
)
from indent_sim.theory.quadrature import Nodes, gauss_legendre, join_nodes, wavenumber_nodes
from indent_sim.theory.solution import Solution

# Number of basis functions of phi: the smallest number, the increase per sqrt(a/b), since phi has a
# boundary layer of width b at the edge, and the largest number.
LEAST_FUNCTIONS = 16
FUNCTIONS_PER_ROOT = 1.5
MAX_FUNCTIONS = 100


class LinearSolution(NamedTuple):
    """Coefficients (c, d_0, d_1, ...) of phi at one contact radius, in units of h and E*/pi.

    The combination of both solutions is phi = depth unit_depth - tip_shape.
    """

    unit_depth: np.ndarray
    tip_shape: np.ndarray

    @property
    def indentation_of_radius(self) -> float:
        """Depth of a smooth tip with this contact radius, in thicknesses of the layer.

        The force along the contact line is zero at this depth.
        """
        return float(self.tip_shape[0] / self.unit_depth[0])


@dataclass(frozen=True)
class LayerWithSurfaceTension(ContactCurve):
    """Load curve of a tip of revolution on a layer with a surface tension.

    b = 2 gamma/E* [h] is the elastocapillary length, below which the tension dominates.
    """

    b: float = 0.0

    @classmethod
    def from_layer(cls, layer: Layer, surface_tension: float) -> LayerWithSurfaceTension:
        """Return the load curve of an infinitely wide layer with a surface tension [F/L] > 0."""
        b = 2.0 * surface_tension / (layer.E_star * layer.h)
        return cls(layer.tip, layer.scaled_stack, layer.E_star, layer.h, math.inf, b)

    def profile(self, x: np.ndarray) -> np.ndarray:
        """Return the Abel transform g [h] of the tip's profile at x [h]."""
        return self.tip.g(x * self.h) / self.h

    def linear_solution(self, a: float) -> LinearSolution:
        """Solve by collocation for unit depth and for the tip's shape at the radius a [h]."""
        function_count = self._function_count(a)
        theta = (np.arange(function_count) + 0.5) * math.pi / (2 * function_count)
        x = a * np.cos(theta)
        right_side = np.column_stack([np.ones(function_count), self._tip_shape(a, theta)])
        matrix = self._kernel_matrix(a, theta, function_count) - self._layer_matrix(
            a, x, function_count
        )
        return LinearSolution(*np.linalg.solve(matrix, right_side).T)

    def _function_count(self, a: float) -> int:
        """Return the number of basis functions at the contact radius a [h].

        The number is constant over ranges of radii, so that the load curve is smooth in root
        searches.
        """
        width_ratio = 2.0 ** math.ceil(math.log2(a / self.b))
        base_count = LEAST_FUNCTIONS * (3 if self.has_slope_discontinuities else 1)
        return min(
            base_count + math.ceil(FUNCTIONS_PER_ROOT * math.sqrt(width_ratio)), MAX_FUNCTIONS
        )

    @property
    def error(self) -> float:
        """Estimated relative error of the force."""
        if self.has_slope_discontinuities:
            return TENSION_ERROR_OF_KINKED_TIPS
        if self.tip.punch_radius is not None:
            return TENSION_ERROR_OF_PUNCHES
        return TENSION_ERROR_OF_SMOOTH_TIPS

    @property
    def has_slope_discontinuities(self) -> bool:
        """True if the tip's slope has discontinuities, which slow the convergence of phi."""
        return bool(self.tip.slope_discontinuities) or self.tip.apex_slope > 0.0

    def _tip_shape(self, a: float, theta: np.ndarray) -> np.ndarray:
        """Return the tip's Abel transform g [h] at the angles theta.

        For a tip with slope discontinuities g is projected on as many functions cos(2 m theta) as
        there are angles.
        """
        breaks = [
            math.acos(b / (a * self.h)) for b in self.tip.slope_discontinuities if b < a * self.h
        ]
        if not self.has_slope_discontinuities:
            return self.profile(a * np.cos(theta))
        # Outside a discontinuity, towards the edge, g rises like the root of the distance from it.
        edges = [0.0, *reversed(breaks), 0.5 * math.pi]
        point_count = 2 * theta.size
        parts = [
            _graded_nodes(hi, lo, point_count)
            if hi in breaks
            else gauss_legendre(lo, hi, point_count)
            for lo, hi in pairwise(edges)
        ]
        angle, weight = join_nodes(parts)
        m = 2 * np.arange(theta.size)
        moments = (
            4.0 / math.pi * (weight * self.profile(a * np.cos(angle))) @ np.cos(np.outer(angle, m))
        )
        moments[0] *= 0.5
        return np.asarray(np.cos(np.outer(theta, m)) @ moments)

    def _kernel_matrix(self, a: float, theta: np.ndarray, count: int) -> np.ndarray:
        """Return (1/pi) ∫ phi(t) k0(a cos(theta) - t) dt of each basis function.

        The shape of the result is (len(theta), count).
        """
        levels = max(2, math.ceil(math.log2(1.0 + a / self.b)) + 3)
        nodes = [_logarithmic_nodes(float(angle), levels, count) for angle in theta]
        offsets, weight = join_nodes(nodes)
        node_counts = [len(offset) for offset, _ in nodes]
        angle = np.repeat(theta, node_counts)
        distances = 2.0 * a * np.sin(angle + 0.5 * offsets) * np.abs(np.sin(0.5 * offsets))
        kernel = auxiliary_integral(distances / self.b) / self.b
        starts = np.cumsum([0, *node_counts[:-1]])
        return a / math.pi * _basis_sums(angle + offsets, weight * kernel, starts, count)

    def _layer_matrix(self, a: float, x: np.ndarray, count: int) -> np.ndarray:
        """Return (2/pi) ∫_0^a phi(t) K(x, t) dt of each basis function, shape (len(x), count)."""
        max_radius = 2.0 ** math.ceil(math.log2(max(a, float(x.max()), 1.0)))
        k, weight = wavenumber_nodes(max_radius, self.scaled_stack.min_wavenumber)
        M = self.scaled_stack.compliance_complement(k)
        weight = weight * M / ((1.0 + self.b * k * (1.0 - M)) * (1.0 + self.b * k))
        theta, w = gauss_legendre(
            0.0, 0.5 * math.pi, count + math.ceil(20 + 2.0 * a * min(22.0, float(k.max())))
        )
        modes = np.cos(np.outer(k, a * np.cos(theta))) @ (
            a * w[:, None] * _basis_functions(theta, count)
        )
        return 2.0 / math.pi * np.cos(np.outer(x, k)) @ (weight[:, None] * modes)

    def solution(self, delta: float, a: float, linear: LinearSolution | None = None) -> Solution:
        """Convert the linear solutions at the contact radius a [h] to physical quantities."""
        depth = delta / self.h
        linear = linear or self.linear_solution(a)
        phi = depth * linear.unit_depth - linear.tip_shape
        if self.tip.punch_radius is None:
            phi[0] = 0.0
        theta, weight = gauss_legendre(0.0, 0.5 * math.pi, 4 * phi.size)
        basis = _basis_functions(theta, phi.size)
        # ∫_0^a phi dt of each basis function.
        basis_integrals = a * weight @ basis
        energy = (
            self.E_star
            * self.h**3
            * a
            * float(weight @ ((basis @ phi) * (depth - self.profile(a * np.cos(theta)))))
        )
        force = 2.0 * self.E_star * self.h**2 * float(basis_integrals @ phi)
        stiffness = 2.0 * self.E_star * self.h * float(basis_integrals @ linear.unit_depth)
        pressure = field_of_position(_pressure, self, a, phi)
        u_z = field_of_position(_u_z, self, a, phi, depth)
        return Solution(
            float(delta), force, float(a * self.h), self.area(a), energy, stiffness, pressure, u_z
        )

    def outside_displacement(self, a: float, phi: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the left-hand side of the integral equation at positions x > a [h].

        `_u_z` computes the surface displacement outside the contact from this quantity.
        """
        rows = np.array([self._outside_row(a, position, phi.size) for position in x])
        return (rows - self._layer_matrix(a, x, phi.size)) @ phi

    def _outside_row(self, a: float, x: float, count: int) -> np.ndarray:
        """Return a row of `_kernel_matrix` for a position x > a [h].

        The nodes are graded towards the edge.
        """
        theta, weight = _logarithmic_nodes(
            0.0, max(2, math.ceil(math.log2(1.0 + a / min(self.b, x - a))) + 3), count
        )
        kernel = auxiliary_integral((x - a + 2.0 * a * np.sin(0.5 * theta) ** 2) / self.b) / self.b
        return a / math.pi * ((weight * kernel) @ _basis_functions(theta, count))


def _graded_nodes(begin: float, end: float, count: int) -> Nodes:
    """Return nodes and weights between two positions, graded quadratically towards the first."""
    v, w = gauss_legendre(0.0, 1.0, count)
    return begin + (end - begin) * v**2, abs(end - begin) * 2.0 * v * w


def auxiliary_integral(z: np.ndarray) -> np.ndarray:
    """Return G(z) = ∫_0^inf cos t/(t + z) dt = Re e^(iz) E1(iz) for z > 0."""
    from scipy.special import exp1

    value = np.empty_like(z)
    # The exponential integral takes ten times as long as the asymptotic series, whose terms
    # (2 k + 1)! (-1/z^2)^k are below 1e-15 here from the twelfth on.
    is_far = z > 50.0
    inverse_square = z[is_far] ** -2.0
    series = np.ones_like(inverse_square)
    for k in range(12, 0, -1):
        series = 1.0 - 2 * k * (2 * k + 1) * inverse_square * series
    value[is_far] = series * inverse_square
    near_argument = 1j * z[~is_far]
    value[~is_far] = (np.exp(near_argument) * exp1(near_argument)).real
    return value


def _basis_functions(theta: np.ndarray, count: int) -> np.ndarray:
    """Return phi dt/(a d theta) (len(theta), count) of each basis function at angles theta.

    These are 1, then sin((2n + 1) theta) sin(theta).
    """
    n = np.arange(count - 1)
    return np.column_stack(
        [np.ones(theta.size), np.sin(np.outer(theta, 2 * n + 1)) * np.sin(theta)[:, None]]
    )


def _basis_sums(
    theta: np.ndarray, weight: np.ndarray, starts: np.ndarray, count: int
) -> np.ndarray:
    """Return weighted sums (len(starts), count) of `_basis_functions` over groups of angles.

    A group begins at each of the indices `starts`. The sines are computed by a recurrence, in a
    tenth of the time that their direct evaluation takes.
    """
    sums = [np.add.reduceat(weight, starts)]
    double_cosine = 2.0 * np.cos(2.0 * theta)
    current = weight * np.sin(theta) ** 2
    previous = -current
    for _ in range(count - 1):
        sums.append(np.add.reduceat(current, starts))
        previous, current = current, double_cosine * current - previous
    return np.column_stack(sums)


@lru_cache(maxsize=4096)
def _logarithmic_nodes(angle: float, levels: int, count: int) -> Nodes:
    """Return nodes and weights on [0, pi] for an integrand with a logarithm at an angle.

    The nodes are given relative to this angle, because the distance of the nearest nodes is below
    the round-off of the angle.

    Parameters
    ----------
    angle
        Angle at which the logarithm is singular.
    levels
        Number of times that the panels are halved towards this angle.
    count
        Number of basis functions, whose oscillations the panels resolve.
    """
    # Gauss points on a panel of the angle.
    point_count = 10
    longest = 2.0 * point_count / (3.0 * count)
    parts = []
    for length, direction in ((angle, -1.0), (math.pi - angle, 1.0)):
        if length <= 0.0:
            continue
        steps = [min(longest, 0.5 * length) * 0.5**k for k in range(levels, -1, -1)]
        panels = math.ceil((length - steps[-1]) / longest)
        edges = [*steps, *(steps[-1] + (length - steps[-1]) * np.arange(1, panels + 1) / panels)]
        # The innermost panel is graded as v^3 to the logarithm.
        v, w = gauss_legendre(0.0, 1.0, 20)
        parts.append((direction * edges[0] * v**3, 3.0 * edges[0] * v**2 * w))
        parts += [
            (direction * x, w)
            for x, w in (gauss_legendre(*ends, point_count) for ends in pairwise(edges))
        ]
    return join_nodes(parts)


def _pressure(
    layer: LayerWithSurfaceTension, a: float, phi: np.ndarray, r: np.ndarray
) -> np.ndarray:
    """Return p(r) = (E*/2a) sum_n (2n + 1) d_n P_n(2 r^2/a^2 - 1) [F/L^2].

    The pressure is infinite at the edge if there is a line force.
    """
    n = np.arange(phi.size - 1)
    p = np.where((r == a) & (phi[0] > 0.0), np.inf, 0.0)
    inside = r < a if phi[0] > 0.0 else r <= a
    polynomials = np.polynomial.legendre.legval(
        2.0 * (r[inside] / a) ** 2 - 1.0, (2 * n + 1) * phi[1:]
    )
    p[inside] = layer.E_star / (2.0 * a) * polynomials
    return p


def _u_z(
    layer: LayerWithSurfaceTension, a: float, phi: np.ndarray, depth: float, r: np.ndarray
) -> np.ndarray:
    """Return u_z(r) = -(2/pi) ∫_0^r s(x)/sqrt(r^2 - x^2) dx [L].

    s is delta - g inside the contact and `outside_displacement` outside.
    """
    q, w = gauss_legendre(0.0, 1.0, 64)
    outside_sinking = None
    end = float(np.arccosh(max(1.0, r.max() / a)))
    if end > 0.0:
        # The displacement outside the contact is interpolated by a polynomial of degree 24.
        outside_sinking = Chebyshev.interpolate(
            lambda y: layer.outside_displacement(a, phi, a * np.cosh(np.maximum(y, 1e-9))),
            24,
            [0.0, end],
        )
    value = np.empty_like(r)
    for k, radius in enumerate(r):
        contact_angle = math.asin(a / radius) if radius > a else 0.5 * math.pi
        sinking = contact_angle * float(
            w @ (depth - layer.profile(radius * np.sin(contact_angle * q)))
        )
        if radius > a and outside_sinking is not None:
            angle = contact_angle + (0.5 * math.pi - contact_angle) * q
            sinking += (0.5 * math.pi - contact_angle) * float(
                w @ outside_sinking(np.arccosh(np.maximum(radius * np.sin(angle) / a, 1.0)))
            )
        value[k] = 2.0 / math.pi * sinking
    return -layer.h * value
