"""Penetration of the tip into the body, at contact points and outside the contact surface."""

from __future__ import annotations

from typing import Any

import numpy as np

from indent_sim.fe.postprocessing.contact_sample import (
    ObservedBody,
    components_first,
    gap,
    gap_of_displacement,
    max_over_ranks,
)
from indent_sim.fe.quadrature import contact_quadrature
from indent_sim.fe.surface import Trace


def penetration(body: ObservedBody) -> float:
    """Largest penetration at contact quadrature points and nodes [length] (collective)."""
    points = np.vstack([contact_quadrature(body.trace.dim)[0], body.trace.node_points()])
    return max_over_ranks(body, (-gap(body, points)).max(initial=0.0))[0]


def penetration_outside_contact_surface(
    body: Any, noncontact_trace: Trace, solution: np.ndarray
) -> float:
    """Penetration of the tip into a surface on which no contact is modelled [length] (collective).

    The penetration of a point is the smaller of two values: minus the gap function, and the depth
    of the deformed point inside the tip. With a gap evaluated at the undeformed position, the first
    value alone would report penetration at a rim that has moved outwards below the rising tip.

    Parameters
    ----------
    body : ObservedBody
        Whole or condensed body.
    noncontact_trace : Trace
        The surface without contact.
    solution : ndarray
        Local solution array of the body, or the part of the array on this surface [length].
    """
    points = contact_quadrature(body.trace.dim)[0]
    u = noncontact_trace.interpolate(solution[noncontact_trace.dofs], points)
    by_gap = -gap_of_displacement(body, noncontact_trace, points, u)
    by_shape, _ = _depth_inside_tip(body, noncontact_trace.positions(points) + u)
    inside = np.minimum(by_gap, by_shape)
    return max_over_ranks(body, inside[inside > 0].max(initial=0.0))[0]


def overlap_depth(body: ObservedBody, positions: np.ndarray, gap: np.ndarray) -> float:
    """Largest depth by which a whole deformed facet lies inside the tip on this rank [length].

    The depth of a facet is the smallest depth of its points, so that a facet that spans an apex or
    an edge is not counted. The depth of a point is min(z + delta - f, -g). The result is 0 with a
    reference gap.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    positions : ndarray, (facets, points, dim)
        Deformed positions [length].
    gap : ndarray, (facets, points)
        Gap g [length].
    """
    if body.scene.physics.gap == "reference":
        return 0.0
    inside, distance = _depth_inside_tip(body, positions)
    inside = np.where(gap < 0, np.minimum(inside, -gap), inside)
    # Only points within half of the tip's radius count: farther out a tip may be steep, and a
    # sphere has its stem.
    is_under = distance < 0.5 * body.scene.physics.indenter.radius_at(
        body.scene.physics.body.height
    )
    least_inside = np.where(is_under, inside, np.inf).min(axis=1)
    return float(least_inside[is_under.any(axis=1)].max(initial=0.0))


def _depth_inside_tip(body: ObservedBody, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth of positions inside the tip, and their distance from its axis [length].

    The depth is z + delta - f, with the height f of the tip's surface above its apex.
    """
    horizontal = body.scene.physics.domain.kinematics.horizontal_position(
        components_first(positions), body.tip_center
    )
    indenter = body.scene.physics.indenter
    inside = positions[..., -1] + body.depth - indenter.height(*horizontal)
    distance = np.hypot(*horizontal)
    return inside - body.tip_displacement(distance) if indenter.elastic_part else inside, distance
