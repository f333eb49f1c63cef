"""Frictionless indentation of a layer or a stack of layers, axisymmetric, to near machine precision
in milliseconds.

The pressure is written as an Abel integral over phi, which turns the mixed boundary conditions into
    phi(x) - (2/pi) ∫_0^a phi(t) K(x, t) dt = (E*/pi) (delta - g(x)),  0 <= x <= a,
F = 2 pi ∫ phi, energy U = pi ∫ phi (delta - g), p(r) = phi(a)/sqrt(a^2-r^2) - ∫_r^a phi'(t)/sqrt(t^2-r^2) dt. The
surface sinks by (2/E*) [∫_0^min(r,a) phi(t)/sqrt(r^2-t^2) dt - ∫_0^inf M(k) J0(kr) ∫_0^a phi cos(kt) dt dk]. K is
analytic, so a Gauss-Legendre Nystrom rule converges exponentially. For a given contact radius a
everything is linear: phi = delta phi_1 - phi_g, and phi(a) = 0 (smooth tips) gives delta(a); a root search inverts
that.

M is that of the stack below the tip (`stack`), and h, the unit of length, the thickness of its top
layer. Forces are good to 1e-9 for a/h < 100 and moduli within a factor of 1000; on a half-space 1e4
times softer than the top layer to 1e-8, 1e5 times softer to 2e-6, because digits of a stiffness are
lost against the plate's.

Small strain, gap at the reference radius. delta > 0 pushes in; force, pressure > 0 push. Any
consistent units. Sources: Lebedev & Ufliand (1958), PMM 22, 442; Hayes et al. (1972), J. Biomech.
5, 541.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebpts1, chebvander

from indent_sim.theory.hankel import (
    EvenKernel,
    Kernel,
    Nodes,
    axisymmetric_kernel,
    contact_kernel,
    gauss,
    joined,
)
from indent_sim.theory.march import LayerContact, pointwise
from indent_sim.theory.profiles import Shape, Tip
from indent_sim.theory.roots import first_guess, increasing_root
from indent_sim.theory.solution import Solution
from indent_sim.theory.stack import Stack

TIP_POINTS = 64  # of an integral over a tip without breaks
MAX_PANELS = 40  # of an Abel integral, between kinks of the tip
RADII_AT_ONCE = 50  # radii whose integrals are worked out together, of some hundred nodes each


@dataclass(frozen=True)
class _LinearKernel:
    """The two linear solutions at one contact radius, phi = delta one - shape, in units of h and
    E*/pi.
    """

    w: np.ndarray  # weights of the quadrature points of g, one and shape
    g: np.ndarray
    one: np.ndarray
    shape: np.ndarray
    one_edge: float
    shape_edge: float
    one_modes: np.ndarray
    shape_modes: np.ndarray
    kernel: Kernel | EvenKernel = field(kw_only=True)

    @property
    def touch(self) -> float:
        """Depth at which phi vanishes at the edge: the depth of a smooth tip with this contact
        radius.
        """
        return self.shape_edge / self.one_edge


@dataclass(frozen=True)
class _LayerPart:
    """-∫_r^a psi'(t)/sqrt(t^2-r^2) dt; psi is even and analytic: t^2 = r^2 + chord^2 s^2
    regularises it.
    """

    kernel: Kernel | EvenKernel
    a: float
    modes: np.ndarray  # of psi

    def __call__(self, r: np.ndarray, chord: np.ndarray) -> np.ndarray:
        s, w = gauss(0.0, 1.0, _points(self.a))
        t = np.hypot(r[:, None], chord[:, None] * s)
        if len(r) == 1:  # no polynomial for one place
            return -chord * (self.modes @ self.kernel.slope_over_x(t[0]) @ w)
        return -chord * (self._curvature(t) @ w)

    @cached_property
    def _curvature(self) -> Chebyshev:
        """psi'(t)/t."""
        slope_over_x = self.kernel.slope_over_x
        return Chebyshev.interpolate(
            lambda t: self.modes @ slope_over_x(t), _degree(self.a), domain=[0.0, self.a]
        )


def _degree(a: float) -> int:
    """Of a polynomial that psi is, and what is analytic as far, over a contact of the radius a [h]."""
    return 24 + math.ceil(8.0 * a)


def _points(a: float) -> int:
    """Of an Abel integral of it."""
    return 24 + math.ceil(4.0 * a)


class Layer(LayerContact):
    """A layer under a tip of revolution; with a wall, a cylinder of that radius."""

    def profile(self, x: np.ndarray) -> np.ndarray:
        """g [h] of the tip."""
        return self.tip.g(x * self.h) / self.h

    def at(self, a: float) -> _LinearKernel:
        """Solve the integral equation for unit depth and for the tip's shape at the contact radius
        a [h].

        The tip may have corners, phi - delta + g never has: only that smooth part is unknown, on a
        few Gauss points, while the tip enters through moments taken on its own finer points.
        """
        kernel = contact_kernel(a, self.scaled, self.wall)
        breaks = self._breaks(a)
        fine, fine_w = contact_nodes(a, breaks, self._tip_count(a))
        at_tip = kernel.basis(np.append(fine, a))
        g = self.profile(np.append(fine, a))
        source = np.column_stack([np.ones_like(g), g])
        x, w = gauss(0.0, a, self._smooth_count(a)) if breaks else (fine, fine_w)
        B = kernel.basis(x) if breaks else at_tip[:, :-1]

        direct = kernel.applied(at_tip[:, :-1] @ (2.0 / math.pi * fine_w[:, None] * source[:-1]))
        project = kernel.applied(2.0 / math.pi * w * B)
        modes = kernel.solved(direct, project, B.T)
        phi = source + at_tip.T @ modes
        (one, shape) = phi[:-1].T
        (one_edge, shape_edge) = map(float, phi[-1])
        return _LinearKernel(
            fine_w,
            g[:-1],
            one,
            shape,
            one_edge,
            shape_edge,
            modes[:, 0],
            modes[:, 1],
            kernel=kernel,
        )

    def several(self, sizes: Sequence[float], largest: float) -> Sequence[_LinearKernel]:
        """As `at`, under a tip without breaks of all sizes at once, on as many points as the
        largest needs.
        """
        if self.tip.breaks:
            return super().several(sizes, largest)
        kernel = contact_kernel(largest, self.scaled, self.wall)
        count = self._tip_count(largest)
        (x, w) = gauss(0.0, 1.0, count)
        a = np.array(sizes)
        places = np.multiply.outer(a, np.append(x, 1.0))
        at_tip = np.ascontiguousarray(
            kernel.basis(places.ravel()).reshape(-1, *places.shape).swapaxes(0, 1)
        )
        g = self.profile(places.ravel()).reshape(places.shape)
        source = np.stack([np.ones_like(g), g], axis=2)
        w = np.multiply.outer(a, w)

        B = at_tip[:, :, :-1]
        direct = kernel.applied(B @ (2.0 / math.pi * w[:, :, None] * source[:, :-1]))
        project = kernel.applied(2.0 / math.pi * w[:, None, :] * B)
        modes = kernel.solved(direct, project, B.swapaxes(1, 2))
        phi = source + at_tip.swapaxes(1, 2) @ modes
        one, shape = phi.transpose(2, 0, 1)
        edges = phi[:, -1].T.tolist()
        of_modes = modes.transpose(2, 0, 1)
        found = zip(w, g[:, :-1], one[:, :-1], shape[:, :-1], *edges, *of_modes, strict=True)
        return [_LinearKernel(*parts, kernel=kernel) for parts in found]

    def numbers(self, sizes: np.ndarray, found: Sequence[_LinearKernel]) -> np.ndarray:
        """As `solution` says them, under a tip without breaks of all contacts at once."""
        if self.tip.breaks:
            return super().numbers(sizes, found)
        parts = (
            [getattr(lin, name) for lin in found] for name in ("w", "g", "one", "shape", "touch")
        )
        w, g, one, shape, touch = map(np.array, parts)
        phi = touch[:, None] * one - shape
        force = np.sum(w * phi, axis=1)
        stiffness = np.sum(w * one, axis=1)
        energy = np.sum(w * phi * (touch[:, None] - g), axis=1)
        unit = self.E_star * self.h
        h = self.h
        return np.array(
            [touch * h, 2.0 * unit * h * force, 2.0 * unit * stiffness, unit * h * h * energy]
        )

    def middle_pressures(self, sizes: np.ndarray, found: Sequence[_LinearKernel]) -> np.ndarray:
        """As `_pressure` says them, under a tip without breaks and corners of all contacts at once."""
        if self.tip.breaks or self.tip.corner:
            return super().middle_pressures(sizes, found)
        s, w = gauss(0.0, 1.0, TIP_POINTS)
        t = np.multiply.outer(sizes, s)
        by_tip = (
            self.profile(sizes) / sizes
            + (self.profile(t.ravel()).reshape(t.shape) / t**2) @ w * sizes
        )
        modes = np.array([one.touch * one.one_modes - one.shape_modes for one in found])
        by_layer = -np.sum(modes * found[-1].kernel.slope_integrals(sizes).T, axis=1)
        return self.E_star / math.pi * (by_tip + by_layer)

    def pressures(
        self, sizes: np.ndarray, found: Sequence[_LinearKernel], places: int
    ) -> np.ndarray:
        """As `_pressure` says them, under a tip without breaks and corners of all contacts at once."""
        if self.tip.breaks or self.tip.corner:
            return super().pressures(sizes, found, places)
        shares, t, of_tip = _tip_rule(places)
        x, of_layer = _layer_rule(places, _degree(sizes[-1]), _points(sizes[-1]))
        edge, g, below = (self._profiles(sizes, some) for some in (np.ones(1), shares, t.ravel()))
        below = below.reshape(sizes.size, *t.shape) - g[:, :, None]
        by_tip = (
            (edge - g) / np.sqrt(1.0 - shares * shares) + np.sum(below * of_tip, axis=2)
        ) / sizes[:, None]
        modes = np.array([one.touch * one.one_modes - one.shape_modes for one in found])
        slopes = (
            found[-1]
            .kernel.slope_over_x(np.multiply.outer(sizes, x).ravel())
            .reshape(-1, sizes.size, x.size)
        )
        by_layer = np.einsum("im,mij->ij", modes, slopes) @ of_layer.T * sizes[:, None]
        return self.E_star / math.pi * (by_tip + by_layer)

    def _profiles(self, sizes: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """g [h] at shares of contact radii (sizes, shares)."""
        return self.profile(np.multiply.outer(sizes, shares).ravel()).reshape(sizes.size, -1)

    def _breaks(self, a: float) -> list[float]:
        """Those of the tip inside the contact [h]."""
        return [b / self.h for b in self.tip.breaks if b / self.h < a]

    def _smooth_count(self, a: float) -> int:
        # exponential convergence: the kernel is analytic 2h off the axis, singular where the
        # contact meets a wall
        return 20 + math.ceil(5.0 * a + 12.0 * math.sqrt(a / max(self.wall - a, 1e-4 * a)))

    def _tip_count(self, a: float) -> int:
        # the tip's own singularity is where it ends, next to the last panel
        last_panel = a - max(self._breaks(a), default=0.0)
        rim = math.sqrt(last_panel / max(self.tip.reach / self.h - a, 1e-4 * last_panel))
        return self._smooth_count(a) + math.ceil(12.0 * rim)

    def solution(self, delta: float, a: float, found: _LinearKernel | None = None) -> Solution:
        """Turn the linear solutions at the contact radius a [h] into physical quantities."""
        depth = delta / self.h
        lin = found or self.at(a)
        phi = depth * lin.one - lin.shape
        edge = depth * lin.one_edge - lin.shape_edge if self.tip.edge is not None else 0.0
        force = 2.0 * self.E_star * self.h**2 * float(lin.w @ phi)
        energy = self.E_star * self.h**3 * float(lin.w @ (phi * (depth - lin.g)))
        stiffness = 2.0 * self.E_star * self.h * float(lin.w @ lin.one)
        layer_part = _LayerPart(lin.kernel, a, depth * lin.one_modes - lin.shape_modes)
        pressure = pointwise(_pressure, self, a, edge, layer_part)
        u_z = pointwise(_u_z, self, lin, a, depth)
        return Solution(
            float(delta), force, float(a * self.h), self.area(a), energy, stiffness, pressure, u_z
        )


def sneddon_force(delta: float, tip: Tip, half_space: Stack) -> float:
    """Force [F] on a half-space by Sneddon's integral, for any tip of revolution; errors as of
    `curve`.

    phi = delta - g there, so the contact radius is where g = delta: no integral equation is solved
    to find it.
    """
    layer = Layer.on(tip, half_space)
    if tip.edge is not None or delta <= 0.0:
        return layer.curve([delta])[0].force
    depth = delta / layer.h
    limit = layer.largest()
    start = first_guess(layer.profile, depth, limit)
    a = increasing_root(lambda a: float(layer.profile(np.array([a]))[0]), depth, start, limit)
    return layer.solution(delta, a).force


def _pressure(
    layer: Layer, a: float, edge: float, layer_part: _LayerPart, r: np.ndarray
) -> np.ndarray:
    """p(r) [F/L^2] from phi = delta - g + psi: the edge, the tip and the layer each add one Abel
    integral.
    """
    inside = r < a
    radius = r[inside]
    chord = np.sqrt((a - radius) * (a + radius))
    value = edge / chord + layer_part(radius, chord)
    if layer.tip.edge is None:
        value += tip_pressure(layer.profile, radius, a, layer._breaks(a), layer.tip.corner)
    p = np.where((r == a) & (edge > 0.0), np.inf, 0.0)
    p[inside] = layer.E_star / math.pi * value
    return p


def _u_z(layer: Layer, lin: _LinearKernel, a: float, depth: float, r: np.ndarray) -> np.ndarray:
    """u_z(r) [L]: as on a half-space under delta - g, and outside the contact what psi adds to it."""
    beyond = r > layer.wall * (1.0 + 1e-12)
    if layer._breaks(a):
        value = np.array([_half_space_sink(layer, a, depth, radius) for radius in r])
    else:
        value = _smooth_sink(layer, a, depth, r)
    seen = (r > a) & ~beyond
    if np.any(seen):
        value[seen] += _layer_sink(layer, lin, a, depth, r[seen])
    value[beyond] = math.nan
    return -layer.h * value


def _smooth_sink(layer: Layer, a: float, depth: float, r: np.ndarray) -> np.ndarray:
    """What `_half_space_sink` is at places r (n,) under a tip without breaks, all at once."""
    s, w = gauss(0.0, 1.0, TIP_POINTS)
    end = np.arcsin(np.minimum(a / np.maximum(r, a), 1.0))
    t = r[:, None] * np.sin(end[:, None] * s)
    return np.asarray(
        2.0 / math.pi * end * ((depth - layer.profile(t.ravel()).reshape(t.shape)) @ w)
    )


def _half_space_sink(layer: Layer, a: float, depth: float, r: float) -> float:
    """(2/pi) ∫_0^min(r,a) (depth - g(t))/sqrt(r^2 - t^2) dt with t = r sin(q); depth - f(r) inside
    the contact.
    """
    end = math.asin(a / r) if r > a else 0.5 * math.pi
    breaks = [math.asin(b / r) for b in layer._breaks(min(r, a))]
    q, w = contact_nodes(end, breaks, TIP_POINTS)
    return 2.0 / math.pi * float(w @ (depth - layer.profile(r * np.sin(q))))


def _layer_sink(
    layer: Layer, lin: _LinearKernel, a: float, depth: float, r: np.ndarray
) -> np.ndarray:
    """(2/pi) ∫_0^a psi(t)/sqrt(r^2 - t^2) dt - sum_j modes_j (2/pi) ∫_0^r b_j(t)/sqrt(r^2 - t^2)
    dt, r > a.
    """
    kernel = axisymmetric_kernel(0.5 * (a + float(r.max())), layer.scaled, layer.wall)
    breaks = layer._breaks(a)
    nodes, _ = contact_nodes(a, breaks, layer._tip_count(a) if breaks else lin.w.size)
    phi = depth * lin.one - lin.shape
    modes = 2.0 / math.pi * kernel.weight * (kernel.basis(nodes) @ (lin.w * phi))
    psi = Chebyshev.interpolate(lambda t: modes @ kernel.basis(t), _degree(a), domain=[0.0, a])
    s, w = gauss(0.0, 1.0, _points(a))
    end = np.arcsin(a / r)
    return 2.0 / math.pi * end * (
        psi(r[:, None] * np.sin(end[:, None] * s)) @ w
    ) - modes @ kernel.surface(r)


def contact_nodes(a: float, breaks: Sequence[float], count: int) -> Nodes:
    """Gauss nodes and weights on [0, a], `count` per panel (fewer if there are many), panelled at
    the breaks. Behind a break g rises like sqrt(x - break): there x = break + length v^2 makes
    it analytic again.
    """
    edges = [0.0, *(b for b in breaks if 0.0 < b < a), a]
    count = count if len(edges) < 5 else min(count, 12)
    return joined(
        [gauss(0.0, edges[1], count), *(_graded(lo, hi, count) for lo, hi in pairwise(edges[1:]))]
    )


def tip_pressure(
    g: Shape, r: np.ndarray, a: float, breaks: Sequence[float], corner: float
) -> np.ndarray:
    """∫_r^a g'(t)/sqrt(t^2 - r^2) dt at radii 0 <= r < a, shape of r: pi/E* times the half-space
    pressure; infinite at an apex with a `corner`.

    By parts about g(r), so that g' is not needed and only differences ~ (t - r) are divided: (g(a)
    - g(r))/sqrt(a^2 - r^2) + ∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt, with t = r cosh y, which
    resolves any r. More than MAX_PANELS breaks are thinned: such a tip is nearly smooth.
    """
    breaks = [b for b in breaks if 0.0 < b < a]
    breaks = breaks[:: max(1, math.ceil(len(breaks) / MAX_PANELS))]
    g_edge = float(g(np.array([a]))[0])
    off_axis = r >= 1e-9 * a
    t, w = contact_nodes(a, breaks, TIP_POINTS)
    on_axis = g_edge / a + float(
        w @ (g(t) / t**2)
    )  # ∫_0^a g'(t)/t dt of a tip that is smooth at its apex
    value = np.full_like(r, math.inf if corner > 0.0 else on_axis)
    seen = r[off_axis]
    g_r = g(seen)
    value[off_axis] = (g_edge - g_r) / np.sqrt((a - seen) * (a + seen)) + _by_parts(
        g, g_r, a, seen, breaks
    )
    return value


def _by_parts(
    g: Shape, g_r: np.ndarray, a: float, r: np.ndarray, breaks: Sequence[float]
) -> np.ndarray:
    """∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt; a tip without breaks has the same nodes below all
    radii.
    """
    if not breaks:
        s, w = gauss(0.0, 1.0, TIP_POINTS)
        end = np.arccosh(a / r)[:, None]
        return np.asarray((_integrand(g, g_r[:, None], r[:, None], end * s) @ w) * end[:, 0])
    places = [slice(k, k + RADII_AT_ONCE) for k in range(0, r.size, RADII_AT_ONCE)]
    return np.concatenate(
        [_beside_breaks(g, g_r[some], a, r[some], breaks) for some in places] or [r]
    )


def _beside_breaks(
    g: Shape, g_r: np.ndarray, a: float, r: np.ndarray, breaks: Sequence[float]
) -> np.ndarray:
    """What `_by_parts` is at some radii, each of which has nodes of its own."""
    nodes = [_abel_nodes(a, radius, breaks) for radius in r]
    y, w = joined(nodes)
    counts = [own.size for own, _ in nodes]
    values = w * _integrand(g, np.repeat(g_r, counts), np.repeat(r, counts), y)
    return np.asarray(np.add.reduceat(values, np.cumsum([0, *counts[:-1]])))


@lru_cache(maxsize=8)
def _tip_rule(places: int) -> tuple[np.ndarray, ...]:
    """Even shares r/a from 0 below 1 (places), nodes t/a and weights (places, TIP_POINTS) of
    a ∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt."""
    shares = np.linspace(0.0, 1.0, places, endpoint=False)
    s, w = gauss(0.0, 1.0, TIP_POINTS)
    r = shares[1:, None]
    end = np.arccosh(1.0 / r)
    cosh = np.cosh(end * s)
    sinh = np.sinh(end * s)
    return shares, np.vstack([s, r * cosh]), np.vstack([w / s**2, w * end * cosh / sinh**2 / r])


@lru_cache(maxsize=8)
def _layer_rule(places: int, degree: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes t/a and weights (places, nodes) of -1/a ∫_r^a psi'(t)/sqrt(t^2 - r^2) dt at even shares
    r/a, of psi'(t)/t at the nodes; a polynomial of that degree, by so many points
    (`_LayerPart`).
    """
    shares = np.linspace(0.0, 1.0, places, endpoint=False)[:, None]
    nodes = chebpts1(degree + 1)
    s, w = gauss(0.0, 1.0, count)
    chord = np.sqrt(1.0 - shares * shares)
    polynomials = chebvander(2.0 * np.hypot(shares, chord * s) - 1.0, degree)
    weights = -chord * np.einsum("ijn,j->in", polynomials, w)
    return 0.5 * (1.0 + nodes), weights @ np.linalg.inv(chebvander(nodes, degree))


def _integrand(g: Shape, g_r: np.ndarray, r: np.ndarray, y: np.ndarray) -> np.ndarray:
    cosh = np.cosh(y)
    t = r * cosh
    return (g(t.ravel()).reshape(t.shape) - g_r) * cosh / np.sinh(y) ** 2 / r


def _abel_nodes(a: float, r: float, breaks: Sequence[float]) -> Nodes:
    """Nodes y = arcosh(t/r) on [0, arcosh(a/r)]; geometric panels, as a pole or a branch point may
    be near a start.
    """
    end = math.acosh(a / r)
    below = max((b for b in breaks if b < r), default=0.0)
    size = math.sqrt(2.0 * (r - below) / r)
    starts = [0.0, *(math.acosh(b / r) for b in breaks if b > r), end]
    panels = []
    for start, stop in pairwise(starts):
        cuts = [
            start,
            *_geometric(max(start, 1e-8) if start else max(size, 1e-8), start, stop),
            stop,
        ]
        first = _graded(cuts[0], cuts[1], 24) if start else gauss(cuts[0], cuts[1], 24)
        panels += [first, *(gauss(lo, hi, 24) for lo, hi in pairwise(cuts[1:]))]
    return joined(panels)


def _geometric(size: float, start: float, stop: float) -> list[float]:
    """start + size (1, 3, 9, ...) as far as it stays clearly below stop."""
    count = (
        math.floor(math.log((stop - start) / (1.5 * size), 3.0)) + 1
        if stop - start > 1.5 * size
        else 0
    )
    return [start + size * 3.0**k for k in range(count)]


def _graded(lo: float, hi: float, count: int) -> Nodes:
    v, w = gauss(0.0, 1.0, count)
    return lo + (hi - lo) * v**2, 2.0 * (hi - lo) * v * w
