"""Measurements of a solution: contact radius, peak pressure, penetration and the surface table."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from indent_sim.fe.observe.surface import Trace, lattice, quadrature_points, undeformed
from indent_sim.model.state import Surface
from indent_sim.model.tips import gap_current, gap_reference
from indent_sim.scene.scene import Scene


class Observed(Protocol):
    """What must be known of a state to read these numbers off it."""

    scene: Scene
    comm: Any
    trace: Trace

    @property
    def depth(self) -> float:
        """delta [length]."""

    def nodal_displacement(self) -> np.ndarray:
        """Displacement (facets, nodes, dim) [length]."""

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) [pressure]."""

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) as a pressure to be looked at [pressure]."""

    def room_at(self, points: np.ndarray) -> np.ndarray:
        """friction p - |t_hat| (facets, points) [pressure], >= 0 where the surface sticks; only with friction."""

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) [pressure]; only with friction."""


SAME_PLACE, OF_ELEMENT = 1e-10, 1e-3  # of the body's height, of the smallest element: closer nodes are the same
ROUNDOFF = 1e-12  # of the body's height: a coordinate below it is zero
UNDER = 0.5  # of the radius at which a tip ends: no tip is steep there, and a ball has its stem above (tips.STEM)
# Of E*/h, h the size of the facet, by formulation. Measured on 60 random layers between frictionless walls, two to
# thirty elements in the contact radius: a is off by 0.01 h in the median, in 95 % of the rows by less than 0.03 h
# (displacement) and 0.05 h (mixed); half of these values reads it 0.04 h too large, twice as much 0.03 h too small.
EDGE_MULTIPLE = {"displacement": 4.0, "mixed": 6.0}


@dataclass(frozen=True)
class Sample:
    """Fields at points of the contact facets, each (facets, points[, dim]).

    X reference coordinates, u displacement, gap g, p_hat nominal trial pressure (negative out of contact),
    pressure >= 0, but for what a tip that adheres pulls (nominal with a reference gap, true with a current one); area:
    true over nominal area.
    """

    X: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    p_hat: np.ndarray
    pressure: np.ndarray
    area: Any


def sample(body: Observed, points: np.ndarray) -> Sample:
    """Evaluate the contact fields at points (n, facet dim) of every contact facet of this rank."""
    scene, trace = body.scene, body.trace
    nodal = body.nodal_displacement()
    X, u = undeformed(scene.physics.part, trace, points), trace.values(nodal, points)
    gap = _gap(body, X, u)
    p_hat = body.multiplier_at(points) - _edge_stiffness(body) * gap
    pressure = np.where(p_hat > 0, np.maximum(body.pressure_at(points), 0.0), 0.0)
    if adhesion := scene.physics.contact.adhesion:
        pressure = pressure - adhesion.pull(gap)
    area = _area_ratio(body, nodal, points, X, u) if scene.physics.gap == "current" else 1.0
    return Sample(X, u, gap, p_hat, pressure / area, area)


def _edge_stiffness(body: Observed) -> np.ndarray:
    """What a gap is worth in pressure when the contact edge is sought, (facets, 1) [pressure/length].

    The multiplier ripples a little beyond the edge, over a part of an element: it must not be outweighed by too small
    a value, nor the gap's own noise inside the contact be magnified by too large a one.
    """
    region = body.scene.physics.part.regions[0]
    return EDGE_MULTIPLE[region.formulation] * region.material.E_star / body.trace.sizes[:, None]


def gap(body: Observed, points: np.ndarray) -> np.ndarray:
    """g [length] at points of every contact facet of this rank (facets, points), >= 0 open."""
    X, u = undeformed(body.scene.physics.part, body.trace, points), body.trace.values(body.nodal_displacement(), points)
    return _gap(body, X, u)


def _gap(body: Observed, X: np.ndarray, u: np.ndarray) -> np.ndarray:
    scene, last = body.scene, body.trace.dim - 1
    delta = body.depth
    x = X if scene.physics.gap == "reference" else X + u
    horizontal = scene.physics.part.kinematics.horizontal(np.moveaxis(x, -1, 0), scene.physics.center)
    gap = gap_reference if scene.physics.gap == "reference" else gap_current
    return gap(scene.physics.indenter, *horizontal, X[..., last] + u[..., last], delta)


def _area_ratio(body: Observed, nodal: np.ndarray, points: np.ndarray, X: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Deformed over reference area da/dA of the surface, from the trace alone."""
    trace = body.trace
    before = _measure(trace.tangents(trace.X, points))
    after = _measure(trace.tangents(trace.X + nodal, points))
    if body.scene.physics.part.kinematics.name != "axisymmetric":
        return after / before
    # u_r/r tends to du_r/dr on the axis, where both stretches of the surface are equal and r is round-off, not 0
    r = X[..., 0]
    is_off_axis = r > 1e-9 * before
    hoop = np.where(is_off_axis, 1 + u[..., 0] / np.where(is_off_axis, r, 1.0), after / before)
    return after / before * hoop


def _measure(tangents: np.ndarray) -> np.ndarray:
    if tangents.shape[-1] == 1:
        return np.linalg.norm(tangents[..., 0], axis=-1)
    return np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)


def contact(body: Observed) -> dict[str, float]:
    """Contact radius `a` [length], `p_max` [pressure], `penetration` and `overlap` [length] of the present state.

    a = sqrt(area/pi) of the region with p_hat > 0 (half its width in plane strain), cut along p_hat = 0, linearly
    inside each of the small simplices of a facet; with a current gap measured in the deformed configuration,
    projected on the horizontal plane; 0 for delta <= 0 without adhesion. The peak is over the contact quadrature points
    and the nodes, NaN where no mesh knows it (see `scene.expected.peakless`), the penetration the largest <-g> over the
    contact quadrature points. The overlap is how deep a whole facet lies inside the tip's own shape, of which the gap
    function may know nothing; 0 with a reference gap.
    """
    dim = body.trace.dim
    grid, simplices = lattice(dim)
    inner, nodes = quadrature_points(dim), body.trace.node_points()
    s = sample(body, np.vstack([grid, inner, nodes]))
    begin, end = len(grid), len(grid) + len(inner)
    x = s.X if body.scene.physics.gap == "reference" else s.X + s.u
    size = _region(body, s.X[:, :begin, :-1], x[:, :begin, :-1], s.p_hat[:, :begin], simplices)
    size = body.scene.physics.part.copies * body.comm.allreduce(size, op=MPI.SUM)
    may_touch = body.depth > 0 or body.scene.physics.adheres  # no other before; what is there is round-off
    size = size if may_touch else 0.0
    a = body.scene.physics.part.kinematics.contact_radius(size)
    peak = body.comm.allreduce(float(s.pressure[:, begin:].max(initial=0.0)), op=MPI.MAX)
    peak = peak if body.scene.has_peak(a) else float("nan")
    depth = body.comm.allreduce(float(np.maximum(-s.gap[:, begin:end], 0.0).max(initial=0.0)), op=MPI.MAX)
    overlap = body.comm.allreduce(_overlap(body, s.X + s.u, s.gap), op=MPI.MAX)
    found = {"a": a, "p_max": peak, "penetration": depth, "overlap": overlap}
    return found | ({"stick_radius": _stick_radius(body, a, s, x, grid)} if body.scene.physics.has_friction else {})


def _stick_radius(body: Observed, a: float, s: Sample, x: np.ndarray, grid: np.ndarray) -> float:
    """sqrt(area/pi) [length] of the part of the contact that does not slip, as `a` is measured; a where nothing may."""
    if body.scene.physics.contact.friction == "stick" or a == 0.0:
        return a
    end = len(grid)
    sticks = np.minimum(s.p_hat[:, :end], body.room_at(grid))
    size = _region(body, s.X[:, :end, :-1], x[:, :end, :-1], sticks, lattice(body.trace.dim)[1])
    size = body.scene.physics.part.copies * body.comm.allreduce(size, op=MPI.SUM)
    return body.scene.physics.part.kinematics.contact_radius(size)


def _overlap(body: Observed, x: np.ndarray, gap: np.ndarray) -> float:
    """How deep a whole deformed facet lies inside the tip [length], the deepest one by that of its points least inside.

    A point under the tip is z + depth - f inside, or -g where that is less: f may be steep. A facet that lies over an
    apex or an edge is inside in its middle by what the tip bends within it, however steep; its ends are not. One that
    the tip went through is inside with all its points.
    """
    if body.scene.physics.gap == "reference":
        return 0.0
    tip = body.scene.physics.indenter
    horizontal = body.scene.physics.part.kinematics.horizontal(np.moveaxis(x, -1, 0), body.scene.physics.center)
    inside = x[..., -1] + body.depth - tip.height(*horizontal)
    inside = np.where(gap < 0, np.minimum(inside, -gap), inside)
    is_under = np.hypot(*horizontal) < UNDER * tip.radius_at(body.scene.physics.body.height)
    least = np.where(is_under, inside, np.inf).min(axis=1)
    return float(least[is_under.any(axis=1)].max(initial=0.0))


def penetration(body: Observed) -> float:
    """The largest <-g> at the contact quadrature points and the nodes [length]."""
    points = np.vstack([quadrature_points(body.trace.dim), body.trace.node_points()])
    u = body.trace.values(body.nodal_displacement(), points)
    gap = _gap(body, undeformed(body.scene.physics.part, body.trace, points), u)
    return body.comm.allreduce(float((-gap).max(initial=0.0)), op=MPI.MAX)


def _region(body: Observed, X: np.ndarray, x: np.ndarray, p_hat: np.ndarray, simplices: np.ndarray) -> float:
    """Area (length in plane strain) of this rank's region with p_hat > 0 at the horizontal places x.

    Where the surface hangs over, as around a ball deeper than its radius, it lies above what is counted already: there
    the simplices at x are turned over from what they are at the reference places X.
    """
    if body.trace.dim == 2:
        ends, p = x[:, simplices, 0], np.array(p_hat[:, simplices])
        p[(np.diff(ends) * np.diff(X[:, simplices, 0]))[..., 0] < 0] = -1.0
        return _positive_length(body, ends, p)
    touched = np.flatnonzero((p_hat > 0).any(axis=1))
    corners, p = x[touched][:, simplices], p_hat[touched][:, simplices]
    overhangs = _signed_area(corners) * _signed_area(X[touched][:, simplices]) < 0
    return _positive_area(corners, np.where(overhangs[..., None], -1.0, p))


def _signed_area(corners: np.ndarray) -> np.ndarray:
    """Area of triangles (..., 3, 2), negative where their corners go round the other way."""
    first, second = np.moveaxis(corners[..., 1:, :] - corners[..., :1, :], -2, 0)
    return 0.5 * (first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _positive_length(body: Observed, ends: np.ndarray, p_hat: np.ndarray) -> float:
    """Length (area of the rings, when axisymmetric) of the parts of segments where the linear p_hat is positive."""
    first, last = np.moveaxis(p_hat, -1, 0)
    left, right = np.moveaxis(ends, -1, 0)
    crossing = left + (right - left) * first / np.where(first == last, 1.0, first - last)
    begin = np.where(first > 0, left, crossing)
    end = np.where(last > 0, right, crossing)
    inside = (first > 0) | (last > 0)
    if body.scene.physics.part.kinematics.name == "axisymmetric":
        return pi * float(np.abs(end**2 - begin**2)[inside].sum())
    return float(np.abs(end - begin)[inside].sum())


def _positive_area(corners: np.ndarray, p_hat: np.ndarray) -> float:
    """Area of the parts of triangles where the linear p_hat is positive."""
    area = np.abs(_signed_area(corners))
    a, b, c = np.moveaxis(np.sort(p_hat, axis=-1), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        tip = c * c / ((c - a) * (c - b))  # one corner in contact
        hole = 1 - a * a / ((a - b) * (a - c))  # one corner out of contact
    fraction = np.where(a > 0, 1.0, np.where(c <= 0, 0.0, np.where(b > 0, hole, tip)))
    return float((area * fraction).sum())


def surface(body: Observed) -> Surface | None:
    """The surface table at the nodes, sorted by (x, y), gathered on rank 0; None on the others."""
    s = sample(body, body.trace.node_points())
    dim = body.trace.dim
    traction = _tractions(body, s, body.trace.node_points())
    columns = np.concatenate([s.X, s.u, s.gap[..., None], traction], axis=-1)
    columns = columns.reshape(-1, columns.shape[-1])
    parts: Any = body.comm.gather(columns, root=0)
    if parts is None:
        return None
    table = np.concatenate(parts)
    same = min(SAME_PLACE, OF_ELEMENT * body.scene.sizes.finest)
    keys = np.round(table[:, : dim - 1] / same)
    _, first, place, count = np.unique(keys, axis=0, return_index=True, return_inverse=True, return_counts=True)
    place = place.ravel()
    X = np.where(np.abs(table[first, :dim]) < ROUNDOFF, 0.0, table[first, :dim])  # the axis is at 0, not at 1e-18
    u, gap = table[first, dim : 2 * dim], table[first, 2 * dim]
    # the deformed area has a kink between facets: take the mean
    pressure, *shear = (np.bincount(place, column) / count for column in table[:, 2 * dim + 1 :].T)
    zero = np.zeros(len(first))
    if dim == 2:
        return Surface(X[:, 0], zero, np.column_stack([u[:, 0], zero, u[:, 1]]), gap, pressure, X[:, 1], *shear)
    return Surface(X[:, 0], X[:, 1], u, gap, pressure, X[:, 2], *shear)


def tractions(body: Observed, points: np.ndarray) -> np.ndarray:
    """Pressure, and with friction shear, at points of every contact facet: (facets, points, 1 or 2) [pressure]."""
    return _tractions(body, sample(body, points), points)


def _tractions(body: Observed, s: Sample, points: np.ndarray) -> np.ndarray:
    return np.stack([s.pressure, *([_shear(body, s, points)] if body.scene.physics.has_friction else [])], axis=-1)


def _shear(body: Observed, s: Sample, points: np.ndarray) -> np.ndarray:
    """tau (facets, points) as written: in three dimensions its size; true with a current gap; 0 out of contact."""
    tau = body.shear_at(points)
    size = tau[..., 0] if body.trace.dim == 2 else np.linalg.norm(tau, axis=-1)
    return np.where(s.p_hat > 0, size, 0.0) / s.area
