"""Area and radius of the contact, and of its part that sticks."""

from __future__ import annotations

from math import pi

import numpy as np
from mpi4py import MPI

from indent_sim.fe.measured_constants import (
    EDGE_GAP_FRACTION,
    EDGE_STEP_EXPONENT,
    EDGE_STEP_FRACTION,
    EDGE_STEP_GROWTH,
)
from indent_sim.fe.postprocessing.contact_sample import (
    ContactSample,
    ObservedBody,
    components_first,
    min_over_ranks,
)
from indent_sim.fe.quadrature import facet_lattice
from indent_sim.model.tips import FlatPunch, sharp_edge_radius


def contact_area(
    body: ObservedBody, X: np.ndarray, positions: np.ndarray, trial_pressure: np.ndarray
) -> float:
    """Contact area of the whole body, where the trial pressure is positive (collective).

    Parts of the surface that are folded over are not counted.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    X : ndarray, (facets, points, dim - 1)
        Undeformed horizontal positions of the lattice points of the facets [length].
    positions : ndarray, (facets, points, dim - 1)
        Horizontal positions of these points in the configuration in which the area is measured
        [length]: X, or X + u if the gap is `current`.
    trial_pressure : ndarray, (facets, points)
        Trial pressure p_hat [pressure].

    Returns
    -------
    float
        Area [length^2], or width [length] in plane strain.
    """
    _, simplices = facet_lattice(body.trace.dim)
    is_on = trial_pressure > 0
    is_touched = np.any(is_on, axis=1)
    is_full = np.zeros_like(is_touched)
    local_area = 0.0
    if body.trace.dim == 2 and body.scene.physics.gap == "reference":
        # No facet can turn over, and most are in contact as a whole
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


def whole_face_area(body: ObservedBody, X: np.ndarray, trial_pressure: np.ndarray) -> float | None:
    """Area of the face of a tip with a sharp edge, if the whole face is in contact (collective).

    At the sharp edge the pressure is singular and p_hat oscillates from node to node, so that
    `contact_area` misses up to 4 % of the face. The whole face is in contact if the mean of p_hat
    over each facet below it is positive, and p_hat is positive at each lattice point on the edge.
    The area is computed inside the exact circle of the edge.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    X : ndarray, (facets, points, dim - 1)
        Undeformed horizontal positions of the lattice points of the facets [length].
    trial_pressure : ndarray, (facets, points)
        Trial pressure p_hat [pressure].

    Returns
    -------
    float or None
        Area [length^2], or width [length] in plane strain. None if a part of the face is not in
        contact, the tip has no sharp edge, or a tip that is not flat has an edge that crosses
        facets.
    """
    physics = body.scene.physics
    radius = sharp_edge_radius(physics.indenter)
    if radius is None or body.scene.sizes.punch_edge is None or physics.gap != "reference":
        return None
    horizontal_position = physics.domain.kinematics.horizontal_position
    tip = physics.indenter
    position = horizontal_position(components_first(X), body.tip_center)
    distance = np.hypot(*tip.face_position(*position))
    # Relative distance from a tip's sharp edge within which a point of the mesh counts as lying on
    # it, since coordinates are rounded to 12 digits.
    edge_tolerance = 1e-9
    is_below = distance <= radius * (1 + edge_tolerance)
    is_face = is_below.all(axis=1)
    is_edge = is_below & (distance >= radius * (1 - edge_tolerance))
    smallest_mean, smallest_at_edge = min_over_ranks(
        body,
        trial_pressure[is_face].mean(axis=1).min(initial=np.inf),
        trial_pressure[is_edge].min(initial=np.inf),
    )
    follows_edge = smallest_at_edge < np.inf
    if not (0 < smallest_mean < np.inf and smallest_at_edge > 0):
        return None
    if not (follows_edge or isinstance(tip.upright, FlatPunch)):
        return None
    if body.trace.dim == 2:
        local_area = _segment_measure(body, X[is_face, 0, 0], X[is_face, -1, 0])
    else:
        corners = body.trace.X[:, :3, :2] - np.array(body.tip_center)
        face_position = np.stack(tip.face_position(corners[..., 0], corners[..., 1]), axis=-1)
        local_area = tip.foreshortening * float(np.abs(area_in_circle(face_position, radius)).sum())
    total_area = local_area if body.comm.size == 1 else body.comm.allreduce(local_area, op=MPI.SUM)
    return physics.domain.symmetry_factor * total_area


def area_in_circle(corners: np.ndarray, radius: float) -> np.ndarray:
    """Area of the parts of triangles (*, 3, 2) inside a circle about the origin [length^2].

    It is negative if the corners are in clockwise order. Each side of a triangle contributes the
    area between this side and the origin: a triangle where the side is inside the circle, a
    circular sector elsewhere.
    """
    start = corners
    end = np.roll(corners, -1, axis=-2)
    side = end - start
    # Points start + t side on the circle: a t^2 + 2 b t + c = 0
    a = (side**2).sum(axis=-1)
    b = (start * side).sum(axis=-1)
    c = (start**2).sum(axis=-1) - radius**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    # The ends of a side are kept exactly: a corner at the origin up to round-off has no direction,
    # and rounding would turn it by any angle.
    t_entry = np.clip((-b - root) / a, 0.0, 1.0)[..., None]
    t_exit = np.clip((-b + root) / a, 0.0, 1.0)[..., None]
    entry = (1.0 - t_entry) * start + t_entry * end
    exit_ = (1.0 - t_exit) * start + t_exit * end
    areas = (
        radius**2 / 2 * (_turn_angle(start, entry) + _turn_angle(exit_, end))
        + _cross_product(entry, exit_) / 2
    )
    return areas.sum(axis=-1)


def _turn_angle(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Signed angle [radians] from the first to the second plane vector (*, 2)."""
    return np.arctan2(_cross_product(first, second), (first * second).sum(axis=-1))


def _cross_product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Cross product of plane vectors (..., 2)."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _signed_area(corners: np.ndarray) -> np.ndarray:
    """Area of triangles (..., 3, 2), negative if their corners are in clockwise order."""
    first, second = np.moveaxis(corners[..., 1:, :] - corners[..., :1, :], -2, 0)
    return 0.5 * (first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _positive_length(body: ObservedBody, ends: np.ndarray, trial_pressure: np.ndarray) -> float:
    """Length of the parts of segments in which the trial pressure is positive.

    The trial pressure is linear in each segment.

    For an axisymmetric body the area of the corresponding rings is returned.
    """
    (first, last) = components_first(trial_pressure)
    (left, right) = components_first(ends)
    crossing = left + (right - left) * first / np.where(first == last, 1.0, first - last)
    begin = np.where(first > 0, left, crossing)
    end = np.where(last > 0, right, crossing)
    inside = (first > 0) | (last > 0)
    return _segment_measure(body, begin[inside], end[inside])


def _segment_measure(body: ObservedBody, begin: np.ndarray, end: np.ndarray) -> float:
    """Total length of horizontal segments, or the area of their rings if axisymmetric."""
    if body.scene.physics.domain.kinematics.name == "axisymmetric":
        return pi * float(np.abs(end**2 - begin**2).sum())
    return float(np.abs(end - begin).sum())


def _positive_area(corners: np.ndarray, trial_pressure: np.ndarray) -> float:
    """Area of the parts of triangles with positive trial pressure, linear in each triangle."""
    area = np.abs(_signed_area(corners))
    a, b, c = np.moveaxis(np.sort(trial_pressure, axis=-1), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Fraction of the area in contact if exactly one corner is in contact.
        corner_fraction = c * c / ((c - a) * (c - b))
        # The same if exactly one corner is not in contact.
        cut_fraction = 1 - a * a / ((a - b) * (a - c))
    fraction = np.where(
        a > 0, 1.0, np.where(c <= 0, 0.0, np.where(b > 0, cut_fraction, corner_fraction))
    )
    return float((area * fraction).sum())


def edge_corrected_pressure(
    body: ObservedBody, trial_pressure: np.ndarray, gap: np.ndarray
) -> np.ndarray:
    """Trial pressure, set to a tiny positive value where the gap at a tip's edge is almost closed.

    Under surface tension the edge of a tip exerts a line force. The discrete pressure of this line
    force is spread over elements next to the edge, whose gaps therefore open by up to
    EDGE_GAP_FRACTION of the depth.
    """
    if not body.scene.physics.surface_tension or body.scene.sizes.punch_edge is None:
        return trial_pressure
    return np.where(
        (trial_pressure <= 0) & (gap <= EDGE_GAP_FRACTION * body.depth),
        np.finfo(float).tiny,
        trial_pressure,
    )


def edge_pressure_step(body: ObservedBody, size: float, force: float) -> float:
    """Pressure step at the contact edge under surface tension [pressure].

    It is computed from the mean contact pressure: by `_membrane_edge_ratio` for a large tension,
    and by a fit to the theory of round tips for a smaller one. It is 0 without surface tension, if
    the edge of the tip coincides with element edges, and if the contact ends within two elements of
    a slope discontinuity, where the tip exerts a line force.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    size : float
        Contact area or width.
    force : float
        Contact force on this area or width.
    """
    physics = body.scene.physics
    sizes = body.scene.sizes
    if not physics.surface_tension or not size or sizes.punch_edge is not None:
        return 0.0
    a = physics.domain.kinematics.contact_radius(size)
    if any(
        r > 0 and abs(a - r) <= 2 * sizes.surface_size(r)
        for r, _ in physics.indenter.slope_discontinuities()
    ):
        return 0.0
    tension_number = physics.surface_tension / physics.material.E_star / a
    step_ratio = EDGE_STEP_GROWTH * tension_number**EDGE_STEP_EXPONENT
    membrane_step = max(force, 0.0) / size * _membrane_edge_ratio(body, a)
    return membrane_step * step_ratio / (1 + step_ratio)


def _membrane_edge_ratio(body: ObservedBody, a: float) -> float:
    """Ratio of edge pressure to mean pressure of a membrane that touches the tip up to a radius.

    A membrane with the tension gamma has the pressure gamma (f'' + f'/r) below a tip with the
    height f(r), and the mean pressure 2 gamma f'(a)/a; in plane strain these are gamma f'' and
    gamma f'(a)/a. The ratio is 1 for a paraboloid and 1/2 for a cone. It is at most 2, because
    f'' is infinite where the slope jumps, and 1 for tips without axis of revolution.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    a : float
        Contact radius [length].
    """
    physics = body.scene.physics
    top_curvature = 1 / physics.domain.top_radius if physics.domain.top_radius else 0.0
    inner, outer = (
        float(physics.indenter.slope(r)) + top_curvature * r for r in (0.95 * a, 1.05 * a)
    )
    if not physics.indenter.is_axisymmetric or inner + outer <= 0:
        return 1.0
    slope_growth = (outer - inner) / (0.1 * (inner + outer) / 2)
    is_strip = physics.domain.kinematics.name == "plane_strain"
    return float(np.clip(slope_growth if is_strip else (1 + slope_growth) / 2, 0.0, 2.0))


def contact_area_within_step(
    body: ObservedBody,
    lattice_points: tuple[np.ndarray, np.ndarray],
    trial_pressure: np.ndarray,
    size: float,
    force: float,
) -> float:
    """Contact area of the whole body if the pressure ends with a step (collective).

    The mesh spreads the step over an element. The edge is where p_hat is EDGE_STEP_FRACTION of the
    step, which depends on the mean pressure and therefore on the area.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    lattice_points : tuple of ndarray
        Positions X and `positions` of `contact_area`.
    trial_pressure : ndarray, (facets, points)
        Trial pressure p_hat [pressure].
    size : float
        Area or width where p_hat > 0, which is returned if the pressure has no step.
    force : float
        Contact force on this area or width.
    """
    physics = body.scene.physics
    kinematics = physics.domain.kinematics
    X, _ = lattice_points
    distance = np.hypot(*kinematics.horizontal_position(components_first(X), body.tip_center))
    # Elsewhere the pressure of a tip that is not round may be lower than at the edge.
    is_near_edge = distance > kinematics.contact_radius(size) - body.trace.facet_sizes[:, None]
    # The second iteration changes the radius by up to 0.05 elements; a third would change it by
    # 0.01.
    for _ in range(2):
        threshold = EDGE_STEP_FRACTION * edge_pressure_step(body, size, force)
        if threshold > 0:
            margin = np.where(is_near_edge, trial_pressure - threshold, trial_pressure)
            size = contact_area(body, *lattice_points, margin) or size
    return size


def stick_radius(
    body: ObservedBody, a: float, sample: ContactSample, positions: np.ndarray, grid: np.ndarray
) -> float:
    """Radius sqrt(area/pi) of the sticking part of the contact [length]; `a` if bonded.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    a : float
        Contact radius [length].
    sample : ContactSample
        Contact fields; the lattice points are the first points.
    positions : ndarray, (facets, points, dim)
        Positions at which the area is measured [length].
    grid : ndarray, (lattice points, dim - 1)
        Lattice of the reference facet.
    """
    if body.scene.physics.contact.is_bonded or a == 0.0:
        return a
    point_count = len(grid)
    stick_indicator = np.minimum(
        sample.trial_pressure[:, :point_count], body.friction.stick_margin_at(grid)
    )
    size = contact_area(
        body, sample.X[:, :point_count, :-1], positions[:, :point_count, :-1], stick_indicator
    )
    return min(a, body.scene.physics.domain.kinematics.contact_radius(size))
