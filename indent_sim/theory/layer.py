"""Frictionless axisymmetric indentation of a layer or a stack of layers, to high accuracy.

The pressure is written as an Abel integral over phi, which turns the mixed boundary conditions into
    phi(x) - (2/pi) ∫_0^a phi(t) K(x, t) dt = (E*/pi) (delta - g(x)),  0 <= x <= a,
F = 2 pi ∫ phi, energy U = pi ∫ phi (delta - g),
p(r) = phi(a)/sqrt(a^2-r^2) - ∫_r^a phi'(t)/sqrt(t^2-r^2) dt.
The surface displacement into the body is
    (2/E*) [∫_0^min(r,a) phi(t)/sqrt(r^2-t^2) dt - ∫_0^inf M(k) J0(kr) ∫_0^a phi cos(kt) dt dk].
K is analytic, so that Nystrom's method with Gauss-Legendre points converges exponentially. For a
given contact radius a the problem is linear: phi = delta phi_1 - phi_g, and phi(a) = 0 (smooth
tips) gives delta(a), which a root search inverts.

M is the compliance of the stack below the tip (`stack`); the unit of length is h, the thickness of
the top layer. Forces are accurate to 1e-9 for a/h < 100 and ratios of moduli up to 1000. For a
half-space softer than the top layer by a factor of 1e4 they are accurate to 1e-8, by 1e5 to 2e-6,
because of cancellation between the stiffness of layer and half-space.

Small strain, gap at the reference radius. delta, force and pressure are > 0 in indentation. Any
consistent units. Sources: Lebedev & Ufliand (1958), PMM 22, 442; Hayes et al. (1972), J. Biomech.
5, 541.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Chebyshev

from indent_sim.theory.abel_pressure import (
    TIP_INTEGRAL_POINTS,
    LayerPressure,
    abel_point_count,
    contact_nodes,
    layer_pressure_rule,
    polynomial_degree,
    tip_pressure,
    tip_pressure_rule,
)
from indent_sim.theory.contact_curve import ContactCurve, field_of_position
from indent_sim.theory.hankel import EvenKernel, Kernel, axisymmetric_kernel, contact_kernel
from indent_sim.theory.profiles import Tip
from indent_sim.theory.quadrature import gauss_legendre
from indent_sim.theory.roots import first_guess, increasing_root
from indent_sim.theory.solution import Solution
from indent_sim.theory.stack import Stack


@dataclass(frozen=True)
class _LinearSolution:
    """Linear solutions at one contact radius, in units of h and E*/pi.

    Their combination is phi = depth unit_depth - tip_shape. `g`, `unit_depth` and `tip_shape` are
    values at quadrature points with `weights`.
    """

    weights: np.ndarray
    g: np.ndarray
    unit_depth: np.ndarray
    tip_shape: np.ndarray
    unit_depth_edge: float
    tip_shape_edge: float
    unit_depth_modes: np.ndarray
    tip_shape_modes: np.ndarray
    kernel: Kernel | EvenKernel = field(kw_only=True)

    @property
    def indentation_of_radius(self) -> float:
        """Depth [h] of a smooth tip with this contact radius, at which phi is 0 at the edge."""
        return self.tip_shape_edge / self.unit_depth_edge


class Layer(ContactCurve):
    """Axisymmetric layer under a tip of revolution; with a wall it is a cylinder of that radius."""

    def profile(self, x: np.ndarray) -> np.ndarray:
        """Return the Abel transform g [h] of the tip's profile at radii x [h]."""
        return self.tip.g(x * self.h) / self.h

    def linear_solution(self, a: float) -> _LinearSolution:
        """Solve the integral equation for unit depth and for the tip's shape at the radius a [h].

        The tip may have slope discontinuities, but phi - delta + g is always smooth. Only this part
        is unknown, at a few Gauss points; integrals of the tip's shape use separate finer points.
        """
        kernel = contact_kernel(a, self.scaled_stack, self.wall)
        breaks = self._inner_discontinuities(a)
        tip_nodes, tip_weights = contact_nodes(a, breaks, self._tip_point_count(a))
        basis_at_tip = kernel.basis(np.append(tip_nodes, a))
        g = self.profile(np.append(tip_nodes, a))
        source = np.column_stack([np.ones_like(g), g])
        x, w = (
            gauss_legendre(0.0, a, self._smooth_point_count(a))
            if breaks
            else (tip_nodes, tip_weights)
        )
        B = kernel.basis(x) if breaks else basis_at_tip[:, :-1]

        source_modes = kernel.apply_weights(
            basis_at_tip[:, :-1] @ (2.0 / math.pi * tip_weights[:, None] * source[:-1])
        )
        projection = kernel.apply_weights(2.0 / math.pi * w * B)
        modes = kernel.solve_modes(source_modes, projection, B.T)
        phi = source + basis_at_tip.T @ modes
        (unit_depth, tip_shape) = phi[:-1].T
        (unit_depth_edge, tip_shape_edge) = map(float, phi[-1])
        return _LinearSolution(
            tip_weights,
            g[:-1],
            unit_depth,
            tip_shape,
            unit_depth_edge,
            tip_shape_edge,
            modes[:, 0],
            modes[:, 1],
            kernel=kernel,
        )

    def linear_solutions(self, sizes: Sequence[float], largest: float) -> Sequence[_LinearSolution]:
        """Solve for several contact radii, vectorized if the tip's slope is continuous.

        All radii have the number of quadrature points that the largest one requires.
        """
        if self.tip.slope_discontinuities:
            return super().linear_solutions(sizes, largest)
        kernel = contact_kernel(largest, self.scaled_stack, self.wall)
        count = self._tip_point_count(largest)
        (x, w) = gauss_legendre(0.0, 1.0, count)
        a = np.array(sizes)
        points = np.multiply.outer(a, np.append(x, 1.0))
        basis_at_tip = np.ascontiguousarray(
            kernel.basis(points.ravel()).reshape(-1, *points.shape).swapaxes(0, 1)
        )
        g = self.profile(points.ravel()).reshape(points.shape)
        source = np.stack([np.ones_like(g), g], axis=2)
        w = np.multiply.outer(a, w)

        B = basis_at_tip[:, :, :-1]
        source_modes = kernel.apply_weights(B @ (2.0 / math.pi * w[:, :, None] * source[:, :-1]))
        projection = kernel.apply_weights(2.0 / math.pi * w[:, None, :] * B)
        modes = kernel.solve_modes(source_modes, projection, B.swapaxes(1, 2))
        phi = source + basis_at_tip.swapaxes(1, 2) @ modes
        unit_depth, tip_shape = phi.transpose(2, 0, 1)
        edges = phi[:, -1].T.tolist()
        mode_pairs = modes.transpose(2, 0, 1)
        solution_parts = zip(
            w, g[:, :-1], unit_depth[:, :-1], tip_shape[:, :-1], *edges, *mode_pairs, strict=True
        )
        return [_LinearSolution(*parts, kernel=kernel) for parts in solution_parts]

    def load_values(
        self, sizes: np.ndarray, linear_solutions: Sequence[_LinearSolution]
    ) -> np.ndarray:
        """Return depth, force, stiffness and energy of contacts, without Solution objects."""
        if self.tip.slope_discontinuities:
            return super().load_values(sizes, linear_solutions)
        parts = (
            [getattr(lin, name) for lin in linear_solutions]
            for name in ("weights", "g", "unit_depth", "tip_shape", "indentation_of_radius")
        )
        w, g, unit_depth, tip_shape, depths = map(np.array, parts)
        phi = depths[:, None] * unit_depth - tip_shape
        force = np.sum(w * phi, axis=1)
        stiffness = np.sum(w * unit_depth, axis=1)
        energy = np.sum(w * phi * (depths[:, None] - g), axis=1)
        unit = self.E_star * self.h
        h = self.h
        return np.array(
            [depths * h, 2.0 * unit * h * force, 2.0 * unit * stiffness, unit * h * h * energy]
        )

    def center_pressures(
        self, sizes: np.ndarray, linear_solutions: Sequence[_LinearSolution]
    ) -> np.ndarray:
        """Return the central pressures of contacts, vectorized if the tip's slope is continuous."""
        if self.tip.slope_discontinuities or self.tip.apex_slope:
            return super().center_pressures(sizes, linear_solutions)
        s, w = gauss_legendre(0.0, 1.0, TIP_INTEGRAL_POINTS)
        t = np.multiply.outer(sizes, s)
        tip_part = (
            self.profile(sizes) / sizes
            + (self.profile(t.ravel()).reshape(t.shape) / t**2) @ w * sizes
        )
        modes = np.array(
            [
                linear.indentation_of_radius * linear.unit_depth_modes - linear.tip_shape_modes
                for linear in linear_solutions
            ]
        )
        layer_part = -np.sum(modes * linear_solutions[-1].kernel.slope_integrals(sizes).T, axis=1)
        return self.E_star / math.pi * (tip_part + layer_part)

    def pressures(
        self, sizes: np.ndarray, linear_solutions: Sequence[_LinearSolution], point_count: int
    ) -> np.ndarray:
        """Return the pressures of all contacts, vectorized if the tip's slope is continuous."""
        if self.tip.slope_discontinuities or self.tip.apex_slope:
            return super().pressures(sizes, linear_solutions, point_count)
        radius_fractions, t, tip_weights = tip_pressure_rule(point_count)
        x, layer_weights = layer_pressure_rule(
            point_count, polynomial_degree(sizes[-1]), abel_point_count(sizes[-1])
        )
        edge, g, height_differences = (
            self._profiles(sizes, fractions)
            for fractions in (np.ones(1), radius_fractions, t.ravel())
        )
        height_differences = height_differences.reshape(sizes.size, *t.shape) - g[:, :, None]
        tip_part = (
            (edge - g) / np.sqrt(1.0 - radius_fractions * radius_fractions)
            + np.sum(height_differences * tip_weights, axis=2)
        ) / sizes[:, None]
        modes = np.array(
            [
                linear.indentation_of_radius * linear.unit_depth_modes - linear.tip_shape_modes
                for linear in linear_solutions
            ]
        )
        slopes = (
            linear_solutions[-1]
            .kernel.slope_over_x(np.multiply.outer(sizes, x).ravel())
            .reshape(-1, sizes.size, x.size)
        )
        layer_part = np.einsum("im,mij->ij", modes, slopes) @ layer_weights.T * sizes[:, None]
        return self.E_star / math.pi * (tip_part + layer_part)

    def _profiles(self, sizes: np.ndarray, radius_fractions: np.ndarray) -> np.ndarray:
        """Return g [h] at fractions of the contact radii, shape (sizes, fractions)."""
        return self.profile(np.multiply.outer(sizes, radius_fractions).ravel()).reshape(
            sizes.size, -1
        )

    def _inner_discontinuities(self, a: float) -> list[float]:
        """Return the radii [h] of the tip's slope discontinuities inside the contact."""
        return [b / self.h for b in self.tip.slope_discontinuities if b / self.h < a]

    def _smooth_point_count(self, a: float) -> int:
        """Return the number of Gauss points for the smooth part of phi."""
        # Gauss's rule converges exponentially: the kernel is analytic up to 2h off the real axis,
        # and singular where the contact meets a wall.
        return 20 + math.ceil(5.0 * a + 12.0 * math.sqrt(a / max(self.wall - a, 1e-4 * a)))

    def _tip_point_count(self, a: float) -> int:
        """Return the number of Gauss points between two slope discontinuities of the tip."""
        # The tip's profile is singular at its end, near the last panel.
        last_panel = a - max(self._inner_discontinuities(a), default=0.0)
        end_distance_ratio = math.sqrt(
            last_panel / max(self.tip.max_radius / self.h - a, 1e-4 * last_panel)
        )
        return self._smooth_point_count(a) + math.ceil(12.0 * end_distance_ratio)

    def solution(self, delta: float, a: float, linear: _LinearSolution | None = None) -> Solution:
        """Convert the linear solutions at the contact radius a [h] to physical quantities."""
        depth = delta / self.h
        lin = linear or self.linear_solution(a)
        phi = depth * lin.unit_depth - lin.tip_shape
        edge_value = (
            depth * lin.unit_depth_edge - lin.tip_shape_edge
            if self.tip.punch_radius is not None
            else 0.0
        )
        force = 2.0 * self.E_star * self.h**2 * float(lin.weights @ phi)
        energy = self.E_star * self.h**3 * float(lin.weights @ (phi * (depth - lin.g)))
        stiffness = 2.0 * self.E_star * self.h * float(lin.weights @ lin.unit_depth)
        layer_part = LayerPressure(
            lin.kernel, a, depth * lin.unit_depth_modes - lin.tip_shape_modes
        )
        pressure = field_of_position(_pressure, self, a, edge_value, layer_part)
        u_z = field_of_position(_u_z, self, lin, a, depth)
        return Solution(
            float(delta), force, float(a * self.h), self.area(a), energy, stiffness, pressure, u_z
        )


def sneddon_force(delta: float, tip: Tip, half_space: Stack) -> float:
    """Return the force [F] on a half-space by Sneddon's integral, for any tip of revolution.

    On a half-space phi = delta - g, so that g = delta gives the contact radius without an integral
    equation. Raises the same errors as `Layer.solutions_at_depths`.
    """
    layer = Layer.from_stack(tip, half_space)
    if tip.punch_radius is not None or delta <= 0.0:
        return layer.solutions_at_depths([delta])[0].force
    depth = delta / layer.h
    limit = layer.max_size()
    start = first_guess(layer.profile, depth, limit)
    a = increasing_root(lambda a: float(layer.profile(np.array([a]))[0]), depth, start, limit)
    return layer.solution(delta, a).force


def _pressure(
    layer: Layer, a: float, edge: float, layer_part: LayerPressure, r: np.ndarray
) -> np.ndarray:
    """Return the pressure p(r) [F/L^2] by Abel integrals of the parts of phi = delta - g + psi."""
    inside = r < a
    radius = r[inside]
    chord = np.sqrt((a - radius) * (a + radius))
    value = edge / chord + layer_part(radius, chord)
    if layer.tip.punch_radius is None:
        value += tip_pressure(
            layer.profile, radius, a, layer._inner_discontinuities(a), layer.tip.apex_slope
        )
    p = np.where((r == a) & (edge > 0.0), np.inf, 0.0)
    p[inside] = layer.E_star / math.pi * value
    return p


def _u_z(layer: Layer, lin: _LinearSolution, a: float, depth: float, r: np.ndarray) -> np.ndarray:
    """Return u_z(r) [L]: half-space displacement due to delta - g; outside also that due to psi."""
    is_beyond_wall = r > layer.wall * (1.0 + 1e-12)
    if layer._inner_discontinuities(a):
        value = np.array([_half_space_sinking(layer, a, depth, radius) for radius in r])
    else:
        value = _smooth_sinking(layer, a, depth, r)
    is_outside = (r > a) & ~is_beyond_wall
    if np.any(is_outside):
        value[is_outside] += _layer_sinking(layer, lin, a, depth, r[is_outside])
    value[is_beyond_wall] = math.nan
    return -layer.h * value


def _smooth_sinking(layer: Layer, a: float, depth: float, r: np.ndarray) -> np.ndarray:
    """Return `_half_space_sinking` at radii r (n,), for a tip with a continuous slope."""
    s, w = gauss_legendre(0.0, 1.0, TIP_INTEGRAL_POINTS)
    end = np.arcsin(np.minimum(a / np.maximum(r, a), 1.0))
    t = r[:, None] * np.sin(end[:, None] * s)
    return np.asarray(
        2.0 / math.pi * end * ((depth - layer.profile(t.ravel()).reshape(t.shape)) @ w)
    )


def _half_space_sinking(layer: Layer, a: float, depth: float, r: float) -> float:
    """Return (2/pi) ∫_0^min(r,a) (depth - g(t))/sqrt(r^2 - t^2) dt [h] with t = r sin(q).

    Inside the contact this is depth - f(r).
    """
    end = math.asin(a / r) if r > a else 0.5 * math.pi
    breaks = [math.asin(b / r) for b in layer._inner_discontinuities(min(r, a))]
    q, w = contact_nodes(end, breaks, TIP_INTEGRAL_POINTS)
    return 2.0 / math.pi * float(w @ (depth - layer.profile(r * np.sin(q))))


def _layer_sinking(
    layer: Layer, lin: _LinearSolution, a: float, depth: float, r: np.ndarray
) -> np.ndarray:
    """Return the effect of the layer on the displacement outside the contact, r > a [h].

    This is (2/pi) ∫_0^a psi(t)/sqrt(r^2 - t^2) dt
    - sum_j modes_j (2/pi) ∫_0^r b_j(t)/sqrt(r^2 - t^2) dt.
    """
    kernel = axisymmetric_kernel(0.5 * (a + float(r.max())), layer.scaled_stack, layer.wall)
    breaks = layer._inner_discontinuities(a)
    nodes, _ = contact_nodes(a, breaks, layer._tip_point_count(a) if breaks else lin.weights.size)
    phi = depth * lin.unit_depth - lin.tip_shape
    modes = 2.0 / math.pi * kernel.weight * (kernel.basis(nodes) @ (lin.weights * phi))
    psi = Chebyshev.interpolate(
        lambda t: modes @ kernel.basis(t), polynomial_degree(a), domain=[0.0, a]
    )
    s, w = gauss_legendre(0.0, 1.0, abel_point_count(a))
    end = np.arcsin(a / r)
    return 2.0 / math.pi * end * (
        psi(r[:, None] * np.sin(end[:, None] * s)) @ w
    ) - modes @ kernel.surface_displacements(r)
