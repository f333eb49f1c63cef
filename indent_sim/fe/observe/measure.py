"""Measurements of a solution: contact radius, peak pressure, penetration and the surface table."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from indent_sim.fe.observe.roughness import patches_of, roughness
from indent_sim.fe.observe.surface import Trace, contact_quadrature, lattice, reading_points
from indent_sim.model.state import Surface
from indent_sim.model.tips import below, gap_current, gap_reference
from indent_sim.scene.scene import Scene


class Observed(Protocol):
    """What must be known of a state to read these numbers off it."""

    scene: Scene
    comm: Any
    trace: Trace
    # None without; `shear_at` points: tau (facets, points, axes) [pressure]. `room_at` points:
    # friction p - |t_hat| (facets, points) [pressure], >= 0 where the surface sticks, which
    # `contact` alone asks for: a condensed body has it on its candidates
    # (`condensed.contact.CondensedState`), not where it is recovered for tables and fields
    friction: Any
    fluid: Any  # None without; `pressure_at` points: p (facets, points) [pressure], from the bath's

    @property
    def depth(self) -> float:
        """delta [length]."""

    @property
    def E_star(self) -> float:
        """Plane-strain modulus of what the tip touches, at this moment [pressure]."""

    def nodal_displacement(self) -> np.ndarray:
        """Displacement (facets, nodes, dim) [length]."""

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) [pressure]."""

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) as a pressure to be looked at [pressure]."""


LEAST_PRESSURE = 1e-8  # of E*, a pressure that is not round-off
# of the body's height, of the smallest element: closer nodes are the same
SAME_NODE = 1e-10
OF_ELEMENT = 1e-3
# of the step of the pressure that ends a tensed contact; how it grows with gamma/(E* a)
SMEARED = 0.3
STEEP = 11.0
# The roughness is read off the facets up to this multiple of the largest distance of contact from
# the tip's axis: what surrounds the contact has to be among them, so that it is told from a hole
# inside
BESIDE = 1.5
# of the depth: twice what was seen beside the edge of a punch, gamma/(E* a) from 1e-4 to 20, nu 0
# to 0.5
LIFTED = 0.01
# of the radius at which a tip ends: no tip is steep there, and a ball has its stem above
# (tips.STEM)
UNDER = 0.5
# Of E*/h, h the size of the facet, by formulation. Measured on 60 random layers between
# frictionless walls, two to thirty elements in the contact radius: a is off by 0.01 h in the
# median, in 95 % of the rows by less than 0.03 h (displacement) and 0.05 h (mixed); half of these
# values reads it 0.04 h too large, twice as much 0.03 h too small.
EDGE_MULTIPLE = {"displacement": 4.0, "mixed": 6.0}


@dataclass(frozen=True)
class Sample:
    """Fields at points of the contact facets, each (facets, points[, dim]).

    X reference coordinates, u displacement, gap g, p_hat nominal trial pressure (negative out of
    contact), pressure >= 0, but for what a tip that adheres pulls (nominal with a reference gap,
    true with a current one); area: true over nominal area.
    """

    X: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    p_hat: np.ndarray
    pressure: np.ndarray
    area: Any


def sample(body: Observed, points: np.ndarray) -> Sample:
    """Evaluate the contact fields at points (n, facet dim) of every contact facet of this rank."""
    scene = body.scene
    trace = body.trace
    nodal = body.nodal_displacement()
    X = trace.positions(points)
    u = trace.values(nodal, points)
    gap = _gap(body, trace, points, u)
    p_hat = body.multiplier_at(points) - _edge_stiffness(body) * gap
    pressure = np.where(p_hat > 0, np.maximum(body.pressure_at(points), 0.0), 0.0)
    if adhesion := scene.physics.contact.adhesion:
        pressure = pressure - adhesion.pull(gap)
    area = _area_ratio(body, nodal, points, X, u) if scene.physics.gap == "current" else 1.0
    return Sample(X, u, gap, p_hat, pressure / area, area)


def touching(body: Observed) -> np.ndarray:
    """Which corners (facets, corners) of this rank's contact facets touch the tip, as `a` counts
    it.
    """
    p_hat = sample(body, body.trace.node_points()[: body.trace.dim]).p_hat
    return np.asarray(p_hat > LEAST_PRESSURE * body.E_star)


def _edge_stiffness(body: Observed) -> np.ndarray:
    """Pressure per gap that finds the contact edge, (facets, 1): lam ripples beyond it, the gap is
    noisy inside.
    """
    region = body.scene.physics.part.regions[0]
    return EDGE_MULTIPLE[region.formulation] * body.E_star / body.trace.sizes[:, None]


def gap(body: Observed, points: np.ndarray) -> np.ndarray:
    """g [length] at points of every contact facet of this rank (facets, points), >= 0 open."""
    return _gap(body, body.trace, points, body.trace.values(body.nodal_displacement(), points))


def smallest_gap(body: Observed) -> float:
    """The least height [length] of the tip above the body, where contact is looked for
    (collective).
    """
    physics = body.scene.physics
    trace = body.trace
    points = np.vstack([contact_quadrature(trace.dim)[0], trace.node_points()])
    X = body.trace.positions(points)
    u = body.trace.values(body.nodal_displacement(), points)
    over = _by_axis(X if physics.gap == "reference" else X + u)
    height = physics.indenter.height(*physics.part.kinematics.horizontal(over, physics.center))
    g = height - body.depth - (X[..., -1] + u[..., -1])
    return float(body.comm.allreduce(float(g.min(initial=np.inf)), op=MPI.MIN))


def _gap(body: Observed, trace: Trace, points: np.ndarray, u: np.ndarray) -> np.ndarray:
    """g at points of the facets of a trace with displacements u there (facets, points[, dim])."""
    physics = body.scene.physics
    X = trace.positions(points)

    def over(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return physics.part.kinematics.horizontal(_by_axis(x), physics.center)

    if physics.gap == "current":
        x, y = over(X + u)
        return gap_current(physics.indenter, x, y, X[..., -1] + u[..., -1], body.depth)

    def open_gap() -> np.ndarray:
        x, y = over(X)
        return gap_reference(physics.indenter, x, y, X[..., -1], 0.0)

    return (
        trace.kept("gap", (physics.indenter, physics.center), points, open_gap)
        - body.depth
        - u[..., -1]
    )


def _may_touch_above(body: Observed, pressure: np.ndarray) -> bool:
    """Whether there may be contact at no depth (collective): by attraction, or with a body that has
    swollen.
    """
    physics = body.scene.physics
    if not physics.evolves:
        return physics.contact.may_snap
    largest = body.comm.allreduce(float(pressure.max(initial=0.0)), op=MPI.MAX)
    return bool(largest > LEAST_PRESSURE * body.E_star)


def _area_ratio(
    body: Observed, nodal: np.ndarray, points: np.ndarray, X: np.ndarray, u: np.ndarray
) -> np.ndarray:
    trace = body.trace
    before, after = (
        _measure(trace.tangents(places, points)) for places in (trace.X, trace.X + nodal)
    )
    if body.scene.physics.part.kinematics.name != "axisymmetric":
        return after / before
    # u_r/r tends to du_r/dr on the axis, where both stretches of the surface are equal and r is
    # round-off, not 0
    r = X[..., 0]
    is_off_axis = r > 1e-9 * before
    hoop = np.where(is_off_axis, 1 + u[..., 0] / np.where(is_off_axis, r, 1.0), after / before)
    return after / before * hoop


def _measure(tangents: np.ndarray) -> np.ndarray:
    if tangents.shape[-1] == 1:
        return np.linalg.norm(tangents[..., 0], axis=-1)
    return np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)


def contact(body: Observed) -> dict[str, float]:
    """Contact radius `a` [length], `p_max` [pressure], `penetration` and `overlap` [length], and
    `roughness` of the present state.

    a = sqrt(area/pi) of the region with p_hat > 0 (half its width in plane strain), cut along p_hat
    = 0, linearly inside each of the small simplices of a facet; with a current gap measured in the
    deformed configuration, projected on the horizontal plane; 0 for delta <= 0, unless the tip
    adheres or the body swells. Under surface tension the pressure ends with a step, which a mesh
    smears and nodes beside it swing about: a is where p_hat is SMEARED of the step, and the peak
    the largest mean over a facet. Else the peak is over the contact quadrature points and the
    nodes. It is NaN where no mesh knows it (see `scene.expected.peakless`). The penetration is the
    largest <-g> over the contact quadrature points. The overlap is how deep a whole facet lies
    inside the tip's own shape, of which the gap function may know nothing; 0 with a reference gap.
    The roughness is the part of p_max by which the pressure alternates from node to node; 0 where
    nothing is known of it (see `observe.roughness`).
    """
    dim = body.trace.dim
    grid = lattice(dim)[0]
    (inner, weights) = contact_quadrature(dim)
    s = sample(body, reading_points(dim))
    begin = len(grid)
    end = len(grid) + len(inner)
    x = s.X if body.scene.physics.gap == "reference" else s.X + s.u
    is_tensed = bool(body.scene.physics.surface_tension)
    pressure = (
        s.pressure[:, begin:end] @ weights / weights.sum() if is_tensed else s.pressure[:, begin:]
    )
    places = s.X[:, :begin, :-1], x[:, :begin, :-1]
    p_hat = _closed_at_an_edge(body, s.p_hat[:, :begin], s.gap[:, :begin])
    size = _region(body, *places, p_hat)
    if is_tensed and (step := _step_at_the_edge(body, size, pressure)):
        size = _region(body, *places, p_hat - SMEARED * step)
    if body.depth <= 0 and not _may_touch_above(body, s.pressure):  # what is there is round-off
        size = 0.0
    a = body.scene.physics.part.kinematics.contact_radius(size)
    sunk = (-s.gap[:, begin:end]).max(initial=0.0)
    overlap = _overlap(body, s.X + s.u, s.gap)
    rough = _rough(body, s, x, end) if a > 0 and body.scene.has_peak(a) else 0.0
    peak, depth, overlap, rough = _largest(body, pressure.max(initial=0.0), sunk, overlap, rough)
    rough = rough / peak if peak > LEAST_PRESSURE * body.E_star else 0.0
    peak = peak if body.scene.has_peak(a) else float("nan")
    found = {"a": a, "p_max": peak, "penetration": depth, "overlap": overlap, "roughness": rough}
    return found | ({"stick_radius": _stick_radius(body, a, s, x, grid)} if body.friction else {})


def _rough(body: Observed, s: Sample, x: np.ndarray, end: int) -> float:
    """The roughness of the pressure [pressure] on rank 0, 0 on the others (collective).

    Parameters
    ----------
    body
        What is looked at.
    s
        Its sample, at the nodes of the facets from the point number `end` on.
    x
        Where the points touch the tip (facets, points, dim) [length].
    end
        See `s`.
    """
    horizontal = body.scene.physics.part.kinematics.horizontal(
        _by_axis(x[:, end:]), body.scene.physics.center
    )
    nodal: Any = s.X[:, end:], s.pressure[:, end:], s.p_hat[:, end:] > 0, np.hypot(*horizontal)
    if body.comm.size > 1:
        parts = body.comm.gather(nodal, root=0)
        if parts is None:
            return 0.0
        nodal = [np.concatenate(part) for part in zip(*parts, strict=True)]
    X, pressure, touches, distance = nodal
    near = np.flatnonzero(distance.min(axis=1) <= BESIDE * distance[touches].max(initial=0.0))
    return roughness(
        patches_of(X[near]),
        pressure[near],
        touches[near],
        distance[near],
        body.scene.physics.indenter,
    )


def _largest(body: Observed, *numbers: float) -> list[float]:
    """The largest of all ranks of each number (collective)."""
    found = np.array(numbers, dtype=float)
    if body.comm.size > 1:
        body.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
    return list(map(float, found))


def _by_axis(x: np.ndarray) -> np.ndarray:
    """Points (..., axes) as (axes, ...)."""
    return x.transpose(x.ndim - 1, *range(x.ndim - 1))


def _closed_at_an_edge(body: Observed, p_hat: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """p_hat, next to nothing but > 0 where the gap is as good as closed: under surface tension the
    edge of a tip pushes with a force along a line, which the pressure of a mesh smears, so that
    elements beside it rise by LIFTED.
    """
    if not body.scene.physics.surface_tension or body.scene.sizes.edge is None:
        return p_hat
    return np.where((p_hat <= 0) & (gap <= LIFTED * body.depth), np.finfo(float).tiny, p_hat)


def _step_at_the_edge(body: Observed, size: float, means: np.ndarray) -> float:
    """The pressure with which the contact ends under a surface tension, from that in its middle; 0
    without tension, and at the edge of a tip, where elements end as well.

    By theory of paraboloids on half-spaces, gamma/(E* a) from 0.03 to 200, to 15 % of the mean
    pressure.
    """
    physics = body.scene.physics
    if not physics.surface_tension or not size or body.scene.sizes.edge is not None:
        return 0.0
    flat = (
        physics.surface_tension
        / physics.material.E_star
        / physics.part.kinematics.contact_radius(size)
    )
    inside = np.concatenate(body.comm.allgather(means[means > 0]))
    share = STEEP * flat**0.9
    return float(np.median(inside)) * share / (1 + share) if len(inside) else 0.0


def _stick_radius(body: Observed, a: float, s: Sample, x: np.ndarray, grid: np.ndarray) -> float:
    """sqrt(area/pi) [length] of the part of the contact that does not slip, as `a` is measured; a
    where nothing may.
    """
    if body.scene.physics.contact.is_bonded or a == 0.0:
        return a
    end = len(grid)
    sticks = np.minimum(s.p_hat[:, :end], body.friction.room_at(grid))
    size = _region(body, s.X[:, :end, :-1], x[:, :end, :-1], sticks)
    return min(a, body.scene.physics.part.kinematics.contact_radius(size))


def _overlap(body: Observed, x: np.ndarray, gap: np.ndarray) -> float:
    """How deep a whole deformed facet lies inside the tip [length], the deepest one by that of its
    points least inside. A point is z + depth - f inside, or -g where that is less. Over an apex
    or an edge only a facet's middle is.
    """
    if body.scene.physics.gap == "reference":
        return 0.0
    inside, distance = _under(body, x)
    inside = np.where(gap < 0, np.minimum(inside, -gap), inside)
    is_under = distance < UNDER * body.scene.physics.indenter.radius_at(
        body.scene.physics.body.height
    )
    least = np.where(is_under, inside, np.inf).min(axis=1)
    return float(least[is_under.any(axis=1)].max(initial=0.0))


def intrusion(body: Any, skin: Trace, solution: np.ndarray) -> float:
    """How deep the tip lies inside a surface where nothing keeps it out [length] (collective).

    A point counts that is inside by the gap that contact is tested with and by the tip's own shape,
    with the lesser of both. With the gap at reference points the rim of a body that is pressed flat
    may fold up beyond the tip's height above its reference point, while the tip itself, which rises
    outwards, is still above it.

    Parameters
    ----------
    body
        What is observed, whole or condensed.
    skin
        The surface that contact is not looked for on.
    solution
        The body's local array, or what of it lies on the surface [length].
    """
    points = contact_quadrature(body.trace.dim)[0]
    u = skin.values(solution[skin.dofs], points)
    by_gap = -_gap(body, skin, points, u)
    by_shape, _ = _under(body, skin.positions(points) + u)
    inside = np.minimum(by_gap, by_shape)
    return _largest(body, inside[inside > 0].max(initial=0.0))[0]


def _under(body: Observed, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the places x are above the tip's surface, z + depth - f, and from its axis [length]."""
    horizontal = body.scene.physics.part.kinematics.horizontal(
        _by_axis(x), body.scene.physics.center
    )
    return x[..., -1] + body.depth - body.scene.physics.indenter.height(*horizontal), np.hypot(
        *horizontal
    )


def penetration(body: Observed) -> float:
    """The largest <-g> at the contact quadrature points and the nodes [length]."""
    points = np.vstack([contact_quadrature(body.trace.dim)[0], body.trace.node_points()])
    return _largest(body, (-gap(body, points)).max(initial=0.0))[0]


def _region(body: Observed, X: np.ndarray, x: np.ndarray, p_hat: np.ndarray) -> float:
    """Area (length) of the body with p_hat > 0, but for what hangs over: its simplices at x are
    turned over from X.
    """
    _, simplices = lattice(body.trace.dim)
    is_on = p_hat > 0
    touched = np.any(is_on, axis=1)
    whole = np.zeros_like(touched)
    mine = 0.0
    if (
        body.trace.dim == 2 and body.scene.physics.gap == "reference"
    ):  # then no facet is turned over, and most touch as a whole
        whole = np.all(is_on, axis=1)
        mine = _length(body, x[whole, 0, 0], x[whole, -1, 0])
    partly = np.flatnonzero(touched & ~whole)
    corners = x[partly][:, simplices]
    p = p_hat[partly][:, simplices]
    if body.trace.dim == 2:
        ends = corners[..., 0]
        if body.scene.physics.gap == "current":
            p[(np.diff(ends) * np.diff(X[partly][:, simplices, 0]))[..., 0] < 0] = -1.0
        mine += _positive_length(body, ends, p)
    else:
        overhangs = _signed_area(corners) * _signed_area(X[partly][:, simplices]) < 0
        mine = _positive_area(corners, np.where(overhangs[..., None], -1.0, p))
    of_all = mine if body.comm.size == 1 else body.comm.allreduce(mine, op=MPI.SUM)
    return body.scene.physics.part.copies * of_all


def _signed_area(corners: np.ndarray) -> np.ndarray:
    """Area of triangles (..., 3, 2), negative where their corners go round the other way."""
    first, second = np.moveaxis(corners[..., 1:, :] - corners[..., :1, :], -2, 0)
    return 0.5 * (first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _positive_length(body: Observed, ends: np.ndarray, p_hat: np.ndarray) -> float:
    """Length (area of the rings, when axisymmetric) of the parts of segments where the linear p_hat
    is positive.
    """
    (first, last) = _by_axis(p_hat)
    (left, right) = _by_axis(ends)
    crossing = left + (right - left) * first / np.where(first == last, 1.0, first - last)
    begin = np.where(first > 0, left, crossing)
    end = np.where(last > 0, right, crossing)
    inside = (first > 0) | (last > 0)
    return _length(body, begin[inside], end[inside])


def _length(body: Observed, begin: np.ndarray, end: np.ndarray) -> float:
    """Length of segments between horizontal places, area of their rings when axisymmetric."""
    if body.scene.physics.part.kinematics.name == "axisymmetric":
        return pi * float(np.abs(end**2 - begin**2).sum())
    return float(np.abs(end - begin).sum())


def _positive_area(corners: np.ndarray, p_hat: np.ndarray) -> float:
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
    traction = tractions(body, s, body.trace.node_points())
    pores = (
        [] if body.fluid is None else [body.fluid.pressure_at(body.trace.node_points())[..., None]]
    )
    columns = np.concatenate([s.X, s.u, s.gap[..., None], *pores, traction], axis=-1)
    parts: Any = body.comm.gather(columns.reshape(-1, columns.shape[-1]), root=0)
    if parts is None:
        return None
    table = np.concatenate(parts)
    same = min(SAME_NODE, OF_ELEMENT * body.scene.sizes.finest)
    keys = np.round(table[:, : dim - 1] / same)
    _, first, place, count = np.unique(
        keys, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    place = place.ravel()
    X, u, gap = np.split(table[first, : 2 * dim + 1], [dim, 2 * dim], axis=1)
    fluid = {"pore_pressure": table[first, 2 * dim + 1]} if pores else {}
    X[np.abs(X) < 1e-12] = 0.0  # the axis is at 0, not at 1e-18 of the body's height
    gap = below(body.scene.physics.indenter, gap[:, 0])
    # the deformed area has a kink between facets: take the mean
    pressure, *shear = (
        np.bincount(place, column) / count for column in table[:, 2 * dim + 1 + len(pores) :].T
    )
    zero = np.zeros(len(first))
    if dim == 2:
        spatial = np.column_stack([u[:, 0], zero, u[:, 1]])
        return Surface(X[:, 0], zero, spatial, gap, pressure, X[:, 1], *shear, **fluid)
    return Surface(X[:, 0], X[:, 1], u, gap, pressure, X[:, 2], *shear, **fluid)


def tractions(body: Observed, s: Sample, points: np.ndarray) -> np.ndarray:
    """Pressure, and with friction shear, of a sample of every contact facet: (facets, points, 1 or
    2) [pressure].
    """
    if not body.friction:
        return s.pressure[..., None]
    tau = body.friction.shear_at(points)
    size = tau[..., 0] if body.trace.dim == 2 else np.linalg.norm(tau, axis=-1)
    return np.stack(
        [s.pressure, np.where(s.p_hat > 0, size, 0.0) / s.area], axis=-1
    )  # true with a current gap
