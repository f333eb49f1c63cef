"""Refinement in the contact: rounded edges with friction, deep tips and cohesive zones."""

from __future__ import annotations

from dataclasses import replace
from math import exp
from typing import TYPE_CHECKING

from indent_sim.model.tips import FlatPunch, max_radius
from indent_sim.model.units import round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene.measured_constants import (
    ELEMENTS_PER_RADIUS,
    ELEMENTS_PER_ZONE,
    STRETCH_GROWTH,
)
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import GRADING, FixedSizes

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


def frictional_edge_width(
    config: Config, setup: ProblemSetup, edge: float | None, gap: str
) -> float:
    """Return the width [length] of the region at a rounded punch edge that needs small elements.

    The width is 0 without friction, at small strain, and in three dimensions, where small elements
    would cost too much. At finite strain a body that slides around the edge or sticks to it is
    sheared by about its own thickness within a fifth of the edge's radius. With elements of a tenth
    of that radius the roughness of the pressure (`fe.postprocessing.roughness`) is 9 % of p_max,
    and p_max is 4 % too large.

    Parameters
    ----------
    config : Config
        The config, for its friction.
    setup : ProblemSetup
        The problem setup.
    edge : float or None
        Radius of the edge [length] if the contact ends there; otherwise None.
    gap : str
        The key `contact.gap`, "reference" or "current".
    """
    tip = setup.physics.indenter.upright
    physics = setup.physics
    is_sheared = bool(config.contact.friction) and gap == "current" and not physics.small_strain
    if edge is None or not is_sheared or physics.domain.dim == 3 or not isinstance(tip, FlatPunch):
        return 0.0
    return round_length(max(edge - (tip.radius - tip.edge_radius), 0.0)) if tip.edge_radius else 0.0


def refine_below_deep_tip(
    config: Config, setup: ProblemSetup, fixed_sizes: FixedSizes, edge: float | None, gap: str
) -> FixedSizes:
    """Return sizes with smaller elements below a tip whose depth exceeds the radius of its end.

    Without friction the surface slides outwards along the tip and up its side. Below a rod at a
    depth of five radii, the contact surface is in the undeformed body a disc of a tenth of the
    rod's radius, which one element of the usual size would cover. The surface under the face of a
    flat punch is stretched as much. Under a sharp edge, whose arc no elements resolve, the path
    ends before that depth, so that the sizes are not changed.

    Parameters
    ----------
    config : Config
        The config, for its friction and `mesh.h_contact`.
    setup : ProblemSetup
        The problem setup.
    fixed_sizes : FixedSizes
        The sizes that are known so far.
    edge : float or None
        Radius of an edge at which the pressure is singular [length]; None without such an edge.
    gap : str
        The key `contact.gap`, "reference" or "current".
    """
    tip = setup.physics.indenter.upright
    end_radius = max_radius(setup.physics.indenter)
    depth_ratio = setup.max_depth / end_radius
    is_excluded = (
        config.mesh.h_contact != "auto"
        or bool(config.contact.friction)
        or setup.physics.domain.dim == 3
    )
    if gap != "current" or is_excluded or setup.physics.is_compressed or depth_ratio <= 1:
        return fixed_sizes
    edge_radius = getattr(tip, "edge_radius", 0.0)
    # Smallest radius of an edge that is resolved, in radii of the punch; a sharper edge would need
    # thousands of elements.
    min_arc_fraction = 0.02
    if isinstance(tip, FlatPunch) and edge_radius < min_arc_fraction * end_radius:
        return fixed_sizes
    h_contact = fixed_sizes.h_contact or min(
        setup.a / ELEMENTS_PER_RADIUS[2], setup.physics.domain.height / 4
    )
    h_edge = fixed_sizes.h_edge
    if edge_radius > 0:
        # Elements per radius of a punch's rounded edge below the face, from where the surface
        # slides around the edge. Twice as many change the force by 1e-5 at a depth of one radius.
        elements_per_arc = 5.0
        h_contact = min(h_contact, edge_radius / elements_per_arc)
        h_edge = round_length(h_contact / 2) if edge is not None else h_edge
    stretch = exp(STRETCH_GROWTH * (depth_ratio - 1))
    # The grading is divided by this power of the stretch, since the stretched region is a slender
    # column around the axis. With 1/3, which gives a grading of 0.08, a rod reached a depth of 5
    # radii; with the usual grading of 0.2, elements below it were inverted at 4.5 radii.
    grading_stretch_exponent = 1 / 3
    growth = fixed_sizes.grading or round_length(GRADING / stretch**grading_stretch_exponent)
    return replace(
        fixed_sizes,
        h_contact=round_length(h_contact),
        h_axis=round_length(h_contact / stretch),
        h_edge=h_edge,
        grading=growth,
    )


def refine_cohesive_zone(
    config: Config, setup: ProblemSetup, fixed_sizes: FixedSizes
) -> FixedSizes:
    """Return sizes with elements of half the width of the cohesive zone.

    Raises
    ------
    ConfigError
        If the contact radius would have too many such elements.
    """
    physics = setup.physics
    attraction = setup.attraction
    a = setup.a
    L = physics.scales.length
    assert attraction is not None
    if config.mesh.h_contact != "auto" or not attraction.range:
        return fixed_sizes
    E_star = physics.material.E_star
    # Largest number of elements in the contact radius that a cohesive zone may require, by
    # dimension.
    max_elements = {2: 1000.0, 3: 60.0}[physics.domain.dim]
    default_size = fixed_sizes.h_contact or min(
        a / ELEMENTS_PER_RADIUS[physics.domain.dim], physics.domain.height / 4
    )
    if setup.adhesive_radii:
        # Elements in the contact radius at pull-off, by dimension.
        elements_at_pull_off = {2: 8.0, 3: 4.0}
        default_size = min(
            default_size, setup.adhesive_radii[0] / elements_at_pull_off[physics.domain.dim]
        )
    h = min(default_size, attraction.cohesive_zone(E_star) / ELEMENTS_PER_ZONE)
    if h * max_elements < a:
        min_range = (
            attraction.range_for_cohesive_zone(ELEMENTS_PER_ZONE * a / max_elements, E_star) * L
        )
        zone = attraction.cohesive_zone(E_star) * L
        problem = (
            f"is too short for a mesh: the cohesive zone is {zone:.3g} wide, the contact radius is "
            f"{a * L:.3g}"
        )
        remedy = f"use at least {min_range:.3g}, or experiment.adhesion, the limit of range 0"
        raise ConfigError("contact.adhesion.range", problem, remedy)
    h_axis = fixed_sizes.h_axis and min(fixed_sizes.h_axis, h)
    h_edge, h_corner = (
        size and min(size, h) for size in (fixed_sizes.h_edge, fixed_sizes.h_corner)
    )
    return replace(
        fixed_sizes, h_contact=round_length(h), h_axis=h_axis, h_edge=h_edge, h_corner=h_corner
    )
