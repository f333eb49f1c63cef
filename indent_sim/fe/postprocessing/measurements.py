"""Measurements of a solution: contact radius, peak pressure, penetration and the surface table."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from indent_sim.fe.postprocessing.roughness import build_patches, roughness
from indent_sim.fe.quadrature import contact_quadrature, evaluation_points, facet_lattice
from indent_sim.fe.surface import Trace
from indent_sim.model.state import Surface
from indent_sim.model.tips import gap_current, gap_reference, gap_under_tip
from indent_sim.scene.scene import Scene


class ObservedBody(Protocol):
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


PRESSURE_ROUNDOFF = 1e-8  # of E*, a pressure that is not round-off
# of the body's height, of the smallest element: closer nodes are the same
SAME_NODE_OF_HEIGHT = 1e-10
SAME_NODE_OF_ELEMENT = 1e-3
# of the step of the pressure that ends a tensed contact; how it grows with gamma/(E* a)
EDGE_STEP_FRACTION = 0.3
EDGE_STEP_GROWTH = 11.0
# The roughness is read off the facets up to this multiple of the largest distance of contact from
# the tip's axis: what surrounds the contact has to be among them, so that it is told from a hole
# inside
ROUGHNESS_RANGE = 1.5
# of the depth: twice what was seen beside the edge of a punch, gamma/(E* a) from 1e-4 to 20, nu 0
# to 0.5
EDGE_GAP_FRACTION = 0.01
# of the radius at which a tip ends: no tip is steep there, and a ball has its stem above
# (tips.STEM)
TIP_RADIUS_FRACTION = 0.5
# Of E*/h, h the size of the facet, by formulation. Measured on 60 random layers between
# frictionless walls, two to thirty elements in the contact radius: a is off by 0.01 h in the
# median, in 95 % of the rows by less than 0.03 h (displacement) and 0.05 h (mixed); half of these
# values reads it 0.04 h too large, twice as much 0.03 h too small.
EDGE_STIFFNESS_FACTOR = {"displacement": 4.0, "mixed": 6.0}


@dataclass(frozen=True)
class ContactSample:
    """Fields at points of the contact facets, each (facets, points[, dim]).

    X reference coordinates, u displacement, gap g, p_hat nominal trial pressure (negative out of
    contact), pressure >= 0, but for what a tip that adheres pulls (nominal with a reference gap,
    true with a current one); area: true over nominal area.
    """

    X: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    trial_pressure: np.ndarray
    pressure: np.ndarray
    area_ratio: Any


def sample_contact(body: ObservedBody, points: np.ndarray) -> ContactSample:
    """Evaluate the contact fields at points (n, facet dim) of every contact facet of this rank."""
    scene = body.scene
    trace = body.trace
    nodal = body.nodal_displacement()
    X = trace.positions(points)
    u = trace.interpolate(nodal, points)
    gap = _gap_of_displacement(body, trace, points, u)
    trial_pressure = body.multiplier_at(points) - _edge_stiffness(body) * gap
    pressure = np.where(trial_pressure > 0, np.maximum(body.pressure_at(points), 0.0), 0.0)
    if adhesion := scene.physics.contact.adhesion:
        pressure = pressure - adhesion.attraction(gap)
    area_ratio = _area_ratio(body, nodal, points, X, u) if scene.physics.gap == "current" else 1.0
    return ContactSample(X, u, gap, trial_pressure, pressure / area_ratio, area_ratio)


def touching_corners(body: ObservedBody) -> np.ndarray:
    """Which corners (facets, corners) of this rank's contact facets touch the tip, as `a` counts
    it.
    """
    trial_pressure = sample_contact(body, body.trace.node_points()[: body.trace.dim]).trial_pressure
    return np.asarray(trial_pressure > PRESSURE_ROUNDOFF * body.E_star)


def _edge_stiffness(body: ObservedBody) -> np.ndarray:
    """Pressure per gap that finds the contact edge, (facets, 1): lam ripples beyond it, the gap is
    noisy inside.
    """
    region = body.scene.physics.domain.regions[0]
    return EDGE_STIFFNESS_FACTOR[region.formulation] * body.E_star / body.trace.facet_sizes[:, None]


def gap(body: ObservedBody, points: np.ndarray) -> np.ndarray:
    """g [length] at points of every contact facet of this rank (facets, points), >= 0 open."""
    return _gap_of_displacement(
        body, body.trace, points, body.trace.interpolate(body.nodal_displacement(), points)
    )


def smallest_gap(body: ObservedBody) -> float:
    """The least height [length] of the tip above the body, where contact is looked for
    (collective).
    """
    physics = body.scene.physics
    trace = body.trace
    points = np.vstack([contact_quadrature(trace.dim)[0], trace.node_points()])
    X = body.trace.positions(points)
    u = body.trace.interpolate(body.nodal_displacement(), points)
    positions = _components_first(X if physics.gap == "reference" else X + u)
    height = physics.indenter.height(
        *physics.domain.kinematics.horizontal_position(positions, physics.center)
    )
    g = height - body.depth - (X[..., -1] + u[..., -1])
    return float(body.comm.allreduce(float(g.min(initial=np.inf)), op=MPI.MIN))


def _gap_of_displacement(
    body: ObservedBody, trace: Trace, points: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """g at points of the facets of a trace with displacements u there (facets, points[, dim])."""
    physics = body.scene.physics
    X = trace.positions(points)

    def over(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return physics.domain.kinematics.horizontal_position(_components_first(x), physics.center)

    if physics.gap == "current":
        x, y = over(X + u)
        return gap_current(physics.indenter, x, y, X[..., -1] + u[..., -1], body.depth)

    def open_gap() -> np.ndarray:
        x, y = over(X)
        return gap_reference(physics.indenter, x, y, X[..., -1], 0.0)

    return (
        trace.cached_values("gap", (physics.indenter, physics.center), points, open_gap)
        - body.depth
        - u[..., -1]
    )


def _may_touch_unindented(body: ObservedBody, pressure: np.ndarray) -> bool:
    """Whether there may be contact at no depth (collective): by attraction, or with a body that has
    swollen.
    """
    physics = body.scene.physics
    if not physics.is_time_dependent:
        return physics.contact.may_snap_through
    largest = body.comm.allreduce(float(pressure.max(initial=0.0)), op=MPI.MAX)
    return bool(largest > PRESSURE_ROUNDOFF * body.E_star)


def _area_ratio(
    body: ObservedBody, nodal: np.ndarray, points: np.ndarray, X: np.ndarray, u: np.ndarray
) -> np.ndarray:
    trace = body.trace
    area_before, area_after = (
        _tangent_measure(trace.tangents(places, points)) for places in (trace.X, trace.X + nodal)
    )
    if body.scene.physics.domain.kinematics.name != "axisymmetric":
        return area_after / area_before
    # u_r/r tends to du_r/dr on the axis, where both stretches of the surface are equal and r is
    # round-off, not 0
    radius = X[..., 0]
    is_off_axis = radius > 1e-9 * area_before
    hoop_stretch = np.where(
        is_off_axis, 1 + u[..., 0] / np.where(is_off_axis, radius, 1.0), area_after / area_before
    )
    return area_after / area_before * hoop_stretch


def _tangent_measure(tangents: np.ndarray) -> np.ndarray:
    if tangents.shape[-1] == 1:
        return np.linalg.norm(tangents[..., 0], axis=-1)
    return np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)


def contact_values(body: ObservedBody) -> dict[str, float]:
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
    grid = facet_lattice(dim)[0]
    (quadrature_points, weights) = contact_quadrature(dim)
    sample = sample_contact(body, evaluation_points(dim))
    begin = len(grid)
    end = len(grid) + len(quadrature_points)
    positions = sample.X if body.scene.physics.gap == "reference" else sample.X + sample.u
    is_tensed = bool(body.scene.physics.surface_tension)
    pressure = (
        sample.pressure[:, begin:end] @ weights / weights.sum()
        if is_tensed
        else sample.pressure[:, begin:]
    )
    lattice_points = sample.X[:, :begin, :-1], positions[:, :begin, :-1]
    trial_pressure = _edge_corrected_pressure(
        body, sample.trial_pressure[:, :begin], sample.gap[:, :begin]
    )
    size = _contact_area(body, *lattice_points, trial_pressure)
    if is_tensed and (step := _edge_pressure_step(body, size, pressure)):
        size = _contact_area(body, *lattice_points, trial_pressure - EDGE_STEP_FRACTION * step)
    if body.depth <= 0 and not _may_touch_unindented(
        body, sample.pressure
    ):  # what is there is round-off
        size = 0.0
    a = body.scene.physics.domain.kinematics.contact_radius(size)
    deepest = (-sample.gap[:, begin:end]).max(initial=0.0)
    overlap = _overlap(body, sample.X + sample.u, sample.gap)
    roughness_value = (
        _roughness_amplitude(body, sample, positions, end)
        if a > 0 and body.scene.has_peak_pressure(a)
        else 0.0
    )
    peak_pressure, penetration_depth, overlap, roughness_value = _max_over_ranks(
        body, pressure.max(initial=0.0), deepest, overlap, roughness_value
    )
    roughness_value = (
        roughness_value / peak_pressure if peak_pressure > PRESSURE_ROUNDOFF * body.E_star else 0.0
    )
    peak_pressure = peak_pressure if body.scene.has_peak_pressure(a) else float("nan")
    values = {
        "a": a,
        "p_max": peak_pressure,
        "penetration": penetration_depth,
        "overlap": overlap,
        "roughness": roughness_value,
    }
    return values | (
        {"stick_radius": _stick_radius(body, a, sample, positions, grid)} if body.friction else {}
    )


def _roughness_amplitude(
    body: ObservedBody, sample: ContactSample, positions: np.ndarray, first_node: int
) -> float:
    """The roughness of the pressure [pressure] on rank 0, 0 on the others (collective).

    Parameters
    ----------
    body
        What is looked at.
    s
        Its sample, at the nodes of the facets from the point number `first_node` on.
    x
        Where the points touch the tip (facets, points, dim) [length].
    end
        See `sample`.
    """
    horizontal = body.scene.physics.domain.kinematics.horizontal_position(
        _components_first(positions[:, first_node:]), body.scene.physics.center
    )
    nodal: Any = (
        sample.X[:, first_node:],
        sample.pressure[:, first_node:],
        sample.trial_pressure[:, first_node:] > 0,
        np.hypot(*horizontal),
    )
    if body.comm.size > 1:
        gathered = body.comm.gather(nodal, root=0)
        if gathered is None:
            return 0.0
        nodal = [np.concatenate(part) for part in zip(*gathered, strict=True)]
    X, pressure, touches, distance = nodal
    near_facets = np.flatnonzero(
        distance.min(axis=1) <= ROUGHNESS_RANGE * distance[touches].max(initial=0.0)
    )
    return roughness(
        build_patches(X[near_facets]),
        pressure[near_facets],
        touches[near_facets],
        distance[near_facets],
        body.scene.physics.indenter,
    )


def _max_over_ranks(body: ObservedBody, *numbers: float) -> list[float]:
    """The largest of all ranks of each number (collective)."""
    largest = np.array(numbers, dtype=float)
    if body.comm.size > 1:
        body.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    return list(map(float, largest))


def _components_first(vectors: np.ndarray) -> np.ndarray:
    """Points (..., axes) as (axes, ...)."""
    return vectors.transpose(vectors.ndim - 1, *range(vectors.ndim - 1))


def _edge_corrected_pressure(
    body: ObservedBody, trial_pressure: np.ndarray, gap: np.ndarray
) -> np.ndarray:
    """p_hat, next to nothing but > 0 where the gap is as good as closed: under surface tension the
    edge of a tip pushes with a force along a line, which the pressure of a mesh smears, so that
    elements beside it rise by LIFTED.
    """
    if not body.scene.physics.surface_tension or body.scene.sizes.punch_edge is None:
        return trial_pressure
    return np.where(
        (trial_pressure <= 0) & (gap <= EDGE_GAP_FRACTION * body.depth),
        np.finfo(float).tiny,
        trial_pressure,
    )


def _edge_pressure_step(body: ObservedBody, size: float, means: np.ndarray) -> float:
    """The pressure with which the contact ends under a surface tension, from that in its middle; 0
    without tension, and at the edge of a tip, where elements end as well.

    By theory of paraboloids on half-spaces, gamma/(E* a) from 0.03 to 200, to 15 % of the mean
    pressure.
    """
    physics = body.scene.physics
    if not physics.surface_tension or not size or body.scene.sizes.punch_edge is not None:
        return 0.0
    tension_number = (
        physics.surface_tension
        / physics.material.E_star
        / physics.domain.kinematics.contact_radius(size)
    )
    positive_means = np.concatenate(body.comm.allgather(means[means > 0]))
    step_fraction = EDGE_STEP_GROWTH * tension_number**0.9
    return (
        float(np.median(positive_means)) * step_fraction / (1 + step_fraction)
        if len(positive_means)
        else 0.0
    )


def _stick_radius(
    body: ObservedBody, a: float, sample: ContactSample, positions: np.ndarray, grid: np.ndarray
) -> float:
    """sqrt(area/pi) [length] of the part of the contact that does not slip, as `a` is measured; a
    where nothing may.
    """
    if body.scene.physics.contact.is_bonded or a == 0.0:
        return a
    point_count = len(grid)
    stick_indicator = np.minimum(
        sample.trial_pressure[:, :point_count], body.friction.stick_margin_at(grid)
    )
    size = _contact_area(
        body, sample.X[:, :point_count, :-1], positions[:, :point_count, :-1], stick_indicator
    )
    return min(a, body.scene.physics.domain.kinematics.contact_radius(size))


def _overlap(body: ObservedBody, positions: np.ndarray, gap: np.ndarray) -> float:
    """How deep a whole deformed facet lies inside the tip [length], the deepest one by that of its
    points least inside. A point is z + depth - f inside, or -g where that is less. Over an apex
    or an edge only a facet's middle is.
    """
    if body.scene.physics.gap == "reference":
        return 0.0
    inside, distance = _depth_inside_tip(body, positions)
    inside = np.where(gap < 0, np.minimum(inside, -gap), inside)
    is_under = distance < TIP_RADIUS_FRACTION * body.scene.physics.indenter.radius_at(
        body.scene.physics.body.height
    )
    least_inside = np.where(is_under, inside, np.inf).min(axis=1)
    return float(least_inside[is_under.any(axis=1)].max(initial=0.0))


def penetration_outside_contact_surface(
    body: Any, noncontact_trace: Trace, solution: np.ndarray
) -> float:
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
    u = noncontact_trace.interpolate(solution[noncontact_trace.dofs], points)
    by_gap = -_gap_of_displacement(body, noncontact_trace, points, u)
    by_shape, _ = _depth_inside_tip(body, noncontact_trace.positions(points) + u)
    inside = np.minimum(by_gap, by_shape)
    return _max_over_ranks(body, inside[inside > 0].max(initial=0.0))[0]


def _depth_inside_tip(body: ObservedBody, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the places x are above the tip's surface, z + depth - f, and from its axis [length]."""
    horizontal = body.scene.physics.domain.kinematics.horizontal_position(
        _components_first(positions), body.scene.physics.center
    )
    return positions[..., -1] + body.depth - body.scene.physics.indenter.height(
        *horizontal
    ), np.hypot(*horizontal)


def penetration(body: ObservedBody) -> float:
    """The largest <-g> at the contact quadrature points and the nodes [length]."""
    points = np.vstack([contact_quadrature(body.trace.dim)[0], body.trace.node_points()])
    return _max_over_ranks(body, (-gap(body, points)).max(initial=0.0))[0]


def _contact_area(
    body: ObservedBody, X: np.ndarray, positions: np.ndarray, trial_pressure: np.ndarray
) -> float:
    """Area (length) of the body with p_hat > 0, but for what hangs over: its simplices at x are
    turned over from X.
    """
    _, simplices = facet_lattice(body.trace.dim)
    is_on = trial_pressure > 0
    is_touched = np.any(is_on, axis=1)
    is_full = np.zeros_like(is_touched)
    local_area = 0.0
    if (
        body.trace.dim == 2 and body.scene.physics.gap == "reference"
    ):  # then no facet is turned over, and most touch as a whole
        is_full = np.all(is_on, axis=1)
        local_area = _segment_measure(body, positions[is_full, 0, 0], positions[is_full, -1, 0])
    partial_facets = np.flatnonzero(is_touched & ~is_full)
    corners = positions[partial_facets][:, simplices]
    corner_pressures = trial_pressure[partial_facets][:, simplices]
    if body.trace.dim == 2:
        ends = corners[..., 0]
        if body.scene.physics.gap == "current":
            corner_pressures[
                (np.diff(ends) * np.diff(X[partial_facets][:, simplices, 0]))[..., 0] < 0
            ] = -1.0
        local_area += _positive_length(body, ends, corner_pressures)
    else:
        overhangs = _signed_area(corners) * _signed_area(X[partial_facets][:, simplices]) < 0
        local_area = _positive_area(corners, np.where(overhangs[..., None], -1.0, corner_pressures))
    total_area = local_area if body.comm.size == 1 else body.comm.allreduce(local_area, op=MPI.SUM)
    return body.scene.physics.domain.symmetry_factor * total_area


def _signed_area(corners: np.ndarray) -> np.ndarray:
    """Area of triangles (..., 3, 2), negative where their corners go round the other way."""
    first, second = np.moveaxis(corners[..., 1:, :] - corners[..., :1, :], -2, 0)
    return 0.5 * (first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _positive_length(body: ObservedBody, ends: np.ndarray, trial_pressure: np.ndarray) -> float:
    """Length (area of the rings, when axisymmetric) of the parts of segments where the linear p_hat
    is positive.
    """
    (first, last) = _components_first(trial_pressure)
    (left, right) = _components_first(ends)
    crossing = left + (right - left) * first / np.where(first == last, 1.0, first - last)
    begin = np.where(first > 0, left, crossing)
    end = np.where(last > 0, right, crossing)
    inside = (first > 0) | (last > 0)
    return _segment_measure(body, begin[inside], end[inside])


def _segment_measure(body: ObservedBody, begin: np.ndarray, end: np.ndarray) -> float:
    """Length of segments between horizontal places, area of their rings when axisymmetric."""
    if body.scene.physics.domain.kinematics.name == "axisymmetric":
        return pi * float(np.abs(end**2 - begin**2).sum())
    return float(np.abs(end - begin).sum())


def _positive_area(corners: np.ndarray, trial_pressure: np.ndarray) -> float:
    area = np.abs(_signed_area(corners))
    a, b, c = np.moveaxis(np.sort(trial_pressure, axis=-1), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        corner_fraction = c * c / ((c - a) * (c - b))  # one corner in contact
        cut_fraction = 1 - a * a / ((a - b) * (a - c))  # one corner out of contact
    fraction = np.where(
        a > 0, 1.0, np.where(c <= 0, 0.0, np.where(b > 0, cut_fraction, corner_fraction))
    )
    return float((area * fraction).sum())


def surface_table(body: ObservedBody) -> Surface | None:
    """The surface table at the nodes, sorted by (x, y), gathered on rank 0; None on the others."""
    sample = sample_contact(body, body.trace.node_points())
    dim = body.trace.dim
    traction = tractions(body, sample, body.trace.node_points())
    pore_columns = (
        [] if body.fluid is None else [body.fluid.pressure_at(body.trace.node_points())[..., None]]
    )
    columns = np.concatenate(
        [sample.X, sample.u, sample.gap[..., None], *pore_columns, traction], axis=-1
    )
    parts: Any = body.comm.gather(columns.reshape(-1, columns.shape[-1]), root=0)
    if parts is None:
        return None
    table = np.concatenate(parts)
    tolerance = min(SAME_NODE_OF_HEIGHT, SAME_NODE_OF_ELEMENT * body.scene.sizes.min_size)
    keys = np.round(table[:, : dim - 1] / tolerance)
    _, first_rows, row_of_node, node_count = np.unique(
        keys, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    row_of_node = row_of_node.ravel()
    X, u, gap = np.split(table[first_rows, : 2 * dim + 1], [dim, 2 * dim], axis=1)
    fluid = {"pore_pressure": table[first_rows, 2 * dim + 1]} if pore_columns else {}
    X[np.abs(X) < 1e-12] = 0.0  # the axis is at 0, not at 1e-18 of the body's height
    gap = gap_under_tip(body.scene.physics.indenter, gap[:, 0])
    # the deformed area has a kink between facets: take the mean
    pressure, *shear = (
        np.bincount(row_of_node, column) / node_count
        for column in table[:, 2 * dim + 1 + len(pore_columns) :].T
    )
    zero = np.zeros(len(first_rows))
    if dim == 2:
        spatial = np.column_stack([u[:, 0], zero, u[:, 1]])
        return Surface(X[:, 0], zero, spatial, gap, pressure, X[:, 1], *shear, **fluid)
    return Surface(X[:, 0], X[:, 1], u, gap, pressure, X[:, 2], *shear, **fluid)


def tractions(body: ObservedBody, sample: ContactSample, points: np.ndarray) -> np.ndarray:
    """Pressure, and with friction shear, of a sample of every contact facet: (facets, points, 1 or
    2) [pressure].
    """
    if not body.friction:
        return sample.pressure[..., None]
    tau = body.friction.shear_at(points)
    shear = tau[..., 0] if body.trace.dim == 2 else np.linalg.norm(tau, axis=-1)
    return np.stack(
        [sample.pressure, np.where(sample.trial_pressure > 0, shear, 0.0) / sample.area_ratio],
        axis=-1,
    )  # true with a current gap
