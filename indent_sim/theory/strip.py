"""Frictionless indentation of an elastic strip in plane strain by a symmetric tip in its middle.

Frictionless walls are at x = +-W. With k_n = n pi/W, a pressure displaces the surface into the body
by

    w(x) = (2/(pi E*)) ∫_-a^a p(t) [-ln|2 sin(pi (x - t)/2W)|
                                    - sum_n M(k_n h)/n cos k_n x cos k_n t] dt
           + F sum_i h_i/E_oed,i/(2 W),

where M = 1 - L is the effect of everything below the top layer (`stack`), a is the half-width of
the contact, E* is that of the top layer, and E_oed,i are the oedometric moduli of the layers of
thickness h_i; the last term, a uniform mode, vanishes at nu = 0.5.

The substitution sin(pi x/2W) = S q, S = sin(pi a/2W), turns the logarithm, on even densities, into
-ln 2S - ln|q - q'|. The latter is diagonal in Chebyshev polynomials: with p dx = y(q) dq/sqrt(1 -
q^2), y = sum_m b_m T_2m(q) and q = cos(theta) its eigenvalues are pi ln 2 for m = 0 and pi/2m. The
remainder is analytic, so that collocation converges exponentially, and the square-root behaviour at
the ends is included. For the infinite strip q = x/a and S = a/2. A kink at the apex of the tip adds
|q| to the right-hand side, for which the solution is known in closed form.

Lengths are in units of h, the thickness of the top layer; force, energy and stiffness are per unit
length of the strip.

Small strain, gap at the reference point. delta, force and pressure are > 0 in indentation. Any
consistent units.
Sources: Johnson, Contact Mechanics (1985), sections 2.7 and 5.8; Meijers (1968), Appl. Sci. Res.
18, 353, for the layer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np

from indent_sim.theory.contact_curve import ContactCurve, Sizes, field_of_position
from indent_sim.theory.profiles import Tip
from indent_sim.theory.quadrature import wall_mode_nodes, wavenumber_nodes
from indent_sim.theory.solution import Solution
from indent_sim.theory.stack import Stack


@dataclass(frozen=True)
class _LinearSolution:
    """Linear solutions at one half-width, in units of h and pi E*/2.

    Their combination is y = depth unit_depth - tip_shape.

    Attributes
    ----------
    q, f
        Collocation points (n,) and values of the tip's profile f [h] at these points.
    unit_depth, tip_shape
        Chebyshev coefficients (n,) of y for unit depth and for the tip's shape.
    kink_part
        Part of `tip_shape` due to a kink at the apex.
    tip_shape_edge
        Value of the tip's solution at the edge q = 1.
    apex_slope
        Slope df/dq at the apex: f ~ apex_slope |q|.
    """

    q: np.ndarray
    f: np.ndarray
    unit_depth: np.ndarray
    tip_shape: np.ndarray
    kink_part: np.ndarray
    tip_shape_edge: float
    apex_slope: float

    @property
    def indentation_of_radius(self) -> float:
        """Depth [h] of a smooth tip with this half-width, at which y is 0 at the edge."""
        return self.tip_shape_edge / float(np.sum(self.unit_depth))


class Strip(ContactCurve):
    """Load curve of a strip in plane strain under a symmetric tip in its middle."""

    dimensions: ClassVar[int] = 1

    @classmethod
    def from_stack(cls, tip: Tip, stack: Stack, wall: float | None = None) -> Self:
        """Return the load curve of a tip on a stack, infinitely wide or between frictionless walls.

        `wall` is the distance [L] of the walls from the middle. Raises ValueError for a half-space,
        because its displacements are infinite in plane strain.
        """
        if stack.is_bottomless:
            raise ValueError(
                "plane strain: the indentation depth of a half-space is infinite; give the body a "
                "finite height"
            )
        return super().from_stack(tip, stack, wall)

    def profile(self, x: np.ndarray) -> np.ndarray:
        """Return the profile f [h] of the tip at x [h]; raises ValueError if f is None."""
        if self.tip.f is None:
            raise ValueError("plane strain: there is no theory for the profile of this tip")
        return self.tip.f(x * self.h) / self.h

    def linear_solution(self, a: float) -> _LinearSolution:
        """Solve by collocation for unit depth and for the tip's shape at the half-width a [h]."""
        n = self._node_count(a)
        # The positive half of 2 n Chebyshev points.
        theta = (np.arange(n) + 0.5) * math.pi / (2 * n)
        q = np.cos(theta)
        T = np.cos(2.0 * np.outer(theta, np.arange(n)))
        eigenvalue = np.concatenate([[math.pi * math.log(2.0)], math.pi / (2.0 * np.arange(1, n))])
        x, slope = self._position_in_strip(q, a)
        f = self.profile(x)
        remainder = (math.pi / n) * self._smooth_kernel(x, x, a) @ T
        # The solution for the kink under the logarithm is known: only a smooth rest is collocated.
        apex_slope = self.tip.apex_slope * slope
        kink = apex_slope * _kink_coefficients(n) / eigenvalue
        kink_edge = apex_slope * 2.0 / math.pi**2 * (1.0 + 1.0 / math.log(2.0))
        right_side = np.column_stack([np.ones(n), f - apex_slope * q + remainder @ kink])
        b = np.linalg.solve(T * eigenvalue - remainder, right_side)
        shape_edge = float(np.sum(b[:, 1])) + kink_edge
        return _LinearSolution(q, f, b[:, 0], b[:, 1] + kink, kink, shape_edge, apex_slope)

    def _node_count(self, a: float) -> int:
        """Return the number of collocation points at the half-width a [h]."""
        # Collocation converges exponentially: the remainder is analytic up to 2 h off the real
        # axis, and singular at a wall and at the end of the tip.
        end_terms = sum(
            math.sqrt(a / max(end_distance - a, 1e-4 * a))
            for end_distance in (self.tip.max_radius / self.h, self.wall)
        )
        # Between walls a kink leaves a term |q|^3, which converges more slowly.
        least_count = 100 if self.tip.apex_slope else 18
        return least_count + math.ceil(6.0 * a + 12.0 * end_terms)

    def _position_in_strip(self, q: np.ndarray, a: float) -> tuple[np.ndarray, float]:
        """Return the positions x [h] of the collocation points q, and dx/dq [h] at q = 0."""
        if math.isinf(self.wall):
            return a * q, a
        c = math.pi / (2.0 * self.wall)
        return np.arcsin(math.sin(c * a) * q) / c, math.sin(c * a) / c

    def _smooth_kernel(self, x: np.ndarray, t: np.ndarray, a: float) -> np.ndarray:
        """Return the smooth part of the kernel, subtracted from -ln|q - q'|, at x and t [h].

        This part consists of the effect of the lower layers, the uniform mode and ln 2S, and has
        the shape (len(x), len(t)).
        """
        max_half_width = 2.0 ** math.ceil(math.log2(max(0.5 * float(x.max() + t.max()), 1.0)))
        if math.isinf(self.wall):
            k, weight = _layer_modes(max_half_width, self.scaled_stack)
        else:
            k, weight = _strip_modes(min(max_half_width, self.wall), self.scaled_stack, self.wall)
        smooth = np.cos(np.outer(x, k)) @ (weight[:, None] * np.cos(np.outer(k, t)))
        if math.isinf(self.wall):
            differences = np.subtract.outer(x, t)
            sums = np.add.outer(x, t)
            return (
                smooth - 0.25 * (np.log(differences**2 + 4.0) + np.log(sums**2 + 4.0)) + math.log(a)
            )
        uniform_part = math.pi * self.scaled_stack.confined_compliance / (4.0 * self.wall)
        return smooth - uniform_part + math.log(2.0 * math.sin(math.pi * a / (2.0 * self.wall)))

    @staticmethod
    def interpolation_variable(a: Sizes) -> Sizes:
        """Return ln a, because the depth of narrow contacts depends on the logarithm of a."""
        return np.log(a)

    @staticmethod
    def size_of_variable(x: float) -> float:
        """Return the half-width [h] from its logarithm."""
        return math.exp(x)

    def solution(self, delta: float, a: float, linear: _LinearSolution | None = None) -> Solution:
        """Convert the linear solutions at the half-width a [h] to physical quantities."""
        depth = delta / self.h
        lin = linear or self.linear_solution(a)
        b = depth * lin.unit_depth - lin.tip_shape
        # Coefficients of y without the term of a wedge, apex_slope 2/pi^2 arcosh(1/q) sin(theta).
        # The solution for the kink differs from that term by a constant, which follows from y = 0
        # at the edge.
        smooth_coefficients = b + lin.kink_part
        if lin.apex_slope:
            smooth_coefficients[0] -= np.sum(smooth_coefficients)
        unit = 0.5 * math.pi * self.E_star
        force = unit * self.h * math.pi * float(b[0])
        stiffness = unit * math.pi * float(lin.unit_depth[0])
        energy = 0.5 * unit * self.h**2 * _energy_integral(lin, smooth_coefficients, depth)
        pressure = field_of_position(_pressure, self, a, smooth_coefficients, lin.apex_slope)
        u_z = field_of_position(_u_z, self, lin, a, depth)
        return Solution(
            float(delta), force, float(a * self.h), self.area(a), energy, stiffness, pressure, u_z
        )


def _pressure(
    strip: Strip, a: float, b: np.ndarray, apex_slope: float, x: np.ndarray
) -> np.ndarray:
    """Return p(x) = (pi E*/2) y(q)/sin(theta) dq/dx [F/L^2] at x [h]; y(1) = 0 for smooth tips.

    `b` are the coefficients of y without the part due to a kink at the apex.
    """
    is_inside = x < a
    q, slope, edge_distance = _strip_coordinates(strip, x[is_inside], a)
    theta = 2.0 * np.arcsin(np.sqrt(0.5 * edge_distance))
    sin_theta = np.sqrt(edge_distance * (1.0 + q))
    m = np.arange(b.size)
    if strip.tip.punch_radius is None:
        # The coefficients add up to 0. With cos(2 m theta) - 1 no rounding error is divided by
        # sin(theta).
        y = -2.0 * np.sin(np.outer(theta, m)) ** 2 @ b
    else:
        y = np.cos(2.0 * np.outer(theta, m)) @ b
    value = y / sin_theta
    if apex_slope:
        q = np.maximum(q, 1e-300)
        value += apex_slope * 2.0 / math.pi**2 * np.arccosh(1.0 / q)
    p = np.where((x == a) & (strip.tip.punch_radius is not None), np.inf, 0.0)
    p[is_inside] = 0.5 * math.pi * strip.E_star * value * slope
    return p


def _u_z(strip: Strip, lin: _LinearSolution, a: float, depth: float, x: np.ndarray) -> np.ndarray:
    """Return u_z(x) [L]: f - depth inside the contact, and the effect of the pressure outside."""
    value = np.where(x <= strip.wall * (1.0 + 1e-12), depth, math.nan)
    value[x <= a] -= strip.profile(x[x <= a])
    is_outside = (x > a) & ~np.isnan(value)
    if np.any(is_outside):
        value[is_outside] = _sinking_outside(strip, lin, a, depth, x[is_outside])
    return -strip.h * value


def _sinking_outside(
    strip: Strip, lin: _LinearSolution, a: float, depth: float, x: np.ndarray
) -> np.ndarray:
    """Return the displacement into the body [h] at x > a [h].

    With q = (z + 1/z)/2, z < 1, the logarithm maps T_2m to pi/2m z^2m and T_0 to pi ln 2z.
    """
    q = _strip_coordinates(strip, x, a)[0]
    z = 1.0 / (q + np.sqrt(np.maximum(q * q - 1.0, 0.0)))
    b = depth * lin.unit_depth - lin.tip_shape
    n = b.size
    m = np.arange(1, n)
    value = math.pi * np.log(2.0 * z) * b[0]
    value += np.power.outer(z, 2 * m) @ (math.pi / (2.0 * m) * (b + lin.kink_part)[1:])
    # The kink without its coefficient of T_0.
    value -= lin.apex_slope * 2.0 / math.pi * ((z + 1.0 / z) * np.arctan(z) - 1.0)
    T = np.cos(2.0 * np.outer(np.arccos(lin.q), np.arange(n)))
    return value - math.pi / n * strip._smooth_kernel(
        x, strip._position_in_strip(lin.q, a)[0], a
    ) @ (T @ b)


def _strip_coordinates(
    strip: Strip, x: np.ndarray, a: float
) -> tuple[np.ndarray, np.ndarray | float, np.ndarray]:
    """Return q(x), dq/dx and 1 - q, where 1 - q has no cancellation at the edge."""
    if math.isinf(strip.wall):
        return x / a, 1.0 / a, (a - x) / a
    c = math.pi / (2.0 * strip.wall)
    S = math.sin(c * a)
    edge_distance = 2.0 * np.sin(0.5 * c * (a - x)) * np.cos(0.5 * c * (a + x)) / S
    return np.sin(c * x) / S, c * np.cos(c * x) / S, edge_distance


def _energy_integral(lin: _LinearSolution, b: np.ndarray, depth: float) -> float:
    """Return ∫ y (depth - f) d theta over [0, pi], with the terms of a kink in closed form."""
    n = b.size
    theta = np.arccos(lin.q)
    y = np.cos(2.0 * np.outer(theta, np.arange(n))) @ b
    smooth_shape = lin.f - lin.apex_slope * lin.q
    wedge = 2.0 / math.pi**2 * np.sin(theta) * np.arccosh(1.0 / lin.q)
    moments = 0.5 * math.pi * _kink_coefficients(n)
    moments[0] *= 2.0
    apex_part = float(moments @ b) - 2.0 / math.pi * depth + 2.0 / math.pi**2 * lin.apex_slope
    return (
        math.pi / n * float(y @ (depth - smooth_shape) - lin.apex_slope * wedge @ smooth_shape)
        - lin.apex_slope * apex_part
    )


def _kink_coefficients(n: int) -> np.ndarray:
    """Return n coefficients of |q| = 2/pi + 4/pi sum_m (-1)^(m+1)/(4m^2-1) T_2m(q)."""
    m = np.arange(n)
    c = -4.0 / math.pi * (-1.0) ** m / (4.0 * m * m - 1.0)
    c[0] *= 0.5
    return c


@lru_cache(maxsize=64)
def _strip_modes(max_half_width: float, stack: Stack, wall: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the wavenumbers k_n = n pi/W [1/h] and M(k_n)/n of all modes with non-negligible M.

    The modes are accurate for half-widths up to `max_half_width` [h].
    """
    n, weight = wall_mode_nodes(max_half_width, wall)
    k = n * math.pi / wall
    return k, weight * stack.compliance_complement(k) / n


@lru_cache(maxsize=64)
def _layer_modes(max_half_width: float, stack: Stack) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes s and weights of ∫_0^inf (M - exp(-2s))/s cos(sx) cos(st) ds.

    The nodes are accurate for half-widths up to `max_half_width` [h]. The subtracted part is known,
    ∫_0^inf (1 - exp(-2s))/s cos(us) ds = ln sqrt(1 + 4/u^2); `_smooth_kernel` adds its term ln
    sqrt(u^2 + 4).
    """
    s, w = wavenumber_nodes(max_half_width, stack.min_wavenumber)
    return s, w * (stack.compliance_complement(s) - np.exp(-2.0 * s)) / s
