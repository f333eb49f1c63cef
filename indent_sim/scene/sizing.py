"""Element sizes of a scene, from the expected contact."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, inf, log2
from typing import TYPE_CHECKING

from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.algebra import cos, sin
from indent_sim.model.tilted_tip import TiltedTip
from indent_sim.model.tips import FlatPunch, Indenter, max_radius
from indent_sim.model.units import round_length
from indent_sim.scene.contact_refinement import (
    frictional_edge_width,
    refine_below_deep_tip,
    refine_cohesive_zone,
)
from indent_sim.scene.expected_error import NEARLY_INCOMPRESSIBLE_NU
from indent_sim.scene.local_refinement import (
    refine_base_contact,
    refine_coatings,
    refine_corners,
    refine_films,
    refine_inclusions,
)
from indent_sim.scene.measured_constants import (
    ADHESIVE_ELEMENTS_PER_RADIUS,
    EDGE_REFINEMENT,
    ELEMENTS_PER_RADIUS,
    STEPPED_ELEMENTS_PER_RADIUS,
)
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import (
    GRADING,
    FixedSizes,
    MeshResolution,
    anisotropy_factor,
    required_elements,
    resolution_from_contacts,
    target_error,
)
from indent_sim.scene.size_checks import check_sizes, configured_sizes

if TYPE_CHECKING:
    from indent_sim.config.schema import Config

# Radius of the fine patch in expected contact radii.
PATCH_FACTOR = 1.15
# A contact that is smaller than the largest one gets as many elements as that, by smaller elements
# at the axis, down to this ratio of the two radii.
MIN_RADIUS_RATIO = 1e-4
# A contact counts as ending at the edge of the tip if its radius exceeds this fraction of the
# radius of the edge. The pressure is then singular there, as under a flat punch.
END_FRACTION = 0.999


def surface_point_sizes(setup: ProblemSetup) -> Sizes:
    """Return the distances between the points at which theory is evaluated for `surface.csv`.

    The smallest and the largest contact radius of the path have the same number of points.
    """
    depths = [delta for delta in setup.physics.deltas if delta > 0]
    # The contact radius grows with the depth.
    radii = (
        [setup.expected_radius(delta) for delta in (min(depths), max(depths))]
        if depths
        else [setup.a]
    )
    a = round_length(max(radii))
    points_per_radius = 40
    h = round_length(max(radii) / points_per_radius)
    h_axis = round_length(max(min(radii), MIN_RADIUS_RATIO * a) / points_per_radius)
    return Sizes(
        h, inf, a, GRADING, h_axis=h_axis if h_axis < h else None, a=a, axis=setup.physics.center
    )


def mesh_resolution(
    config: Config, setup: ProblemSetup, per_radius: float | None
) -> MeshResolution | None:
    """Return the mesh resolution for the key `accuracy`; None without a requested accuracy.

    The resolution is determined by the contacts at the smallest and the largest depth.

    Parameters
    ----------
    config : Config
        The config.
    setup : ProblemSetup
        The problem setup.
    per_radius : float or None
        Number of elements in the contact radius, if it follows from a previous mesh.
    """
    physics = setup.physics
    target = target_error(config.accuracy)
    refinements = 0
    if target is None:
        return None
    # A path without positive depths, of an adhesive tip for example, has the largest depth in
    # place of them, and any depth if all are zero.
    positive_depths = [delta for delta in physics.deltas if delta > 0] or [
        max(map(abs, physics.deltas)) or 1.0
    ]
    contacts = [
        _contact_state(setup, delta) for delta in (min(positive_depths), max(positive_depths))
    ]
    if isinstance(physics.domain, ImportedDomain):
        # Error estimates compare the last two meshes, which takes at least one refinement.
        initial_elements = setup.a / physics.domain.facet_size_near(physics.center, 0.0, setup.a)
        halvings = log2(
            (per_radius or required_elements(target, physics.domain.dim)) / initial_elements
        )
        # A number of elements that follows from a measured error is met as closely as possible,
        # one that is only expected to suffice is not fallen short of.
        refinements = max(1, round(halvings) if per_radius else ceil(halvings))
        n = initial_elements * 2.0**refinements
    else:
        # A layer is compressed rather than indented if the contact is wider than the height. If it
        # is nearly incompressible as well, the material can only flow to the sides, and the force
        # depends strongly on the contact radius, unless a sharp edge determines this radius.
        is_wide = max(a for _, a, _ in contacts) >= physics.body.height
        is_squeezed = is_wide and physics.largest_nu >= NEARLY_INCOMPRESSIBLE_NU
        is_confined = is_squeezed and not _is_sharp(physics.indenter)
        n = per_radius or required_elements(
            target, physics.domain.dim, is_confined, anisotropy_factor(physics.material.decay_rates)
        )
    stiffness_given = getattr(config.contact, "epsilon_n", "auto") != "auto"
    resolution = resolution_from_contacts(target, n, contacts, physics.domain.dim)
    is_column = physics.is_porous_column
    return replace(
        resolution,
        stiffness_given=stiffness_given,
        refinements=refinements,
        is_draining_column=is_column,
    )


def _is_sharp(tip: Indenter) -> bool:
    """True if the contact ends at the edge of a punch, where the pressure has a peak."""
    # Radius of a punch's edge, in radii of the punch, below which the pressure has a peak
    # where the contact ends.
    nearly_sharp = 0.5
    punch = tip.upright
    return isinstance(punch, FlatPunch) and punch.edge_radius < nearly_sharp * punch.radius


def _contact_state(setup: ProblemSetup, delta: float) -> tuple[float, float, float]:
    """Return depth, expected contact radius, and mean pressure by theory.

    Without a theory the mean pressure is taken as E* delta/(2 a).
    """
    a = setup.expected_radius(delta)
    solution = setup.solution(delta)
    area = setup.physics.domain.kinematics.contact_area(a)
    if solution:
        return delta, a, solution.force / area
    return delta, a, setup.physics.material.E_star * delta / (2 * a)


def _edge_radius(setup: ProblemSetup, gap: str, has_edge_size: bool) -> float | None:
    """Return the radius of an edge at which the pressure is (nearly) singular, or None.

    This edge is the edge of a punch, or the end of a tip if the contact reaches it. A plate has no
    edge. The edge of a punch wider than the body is outside of the contact; if the config then
    gives `h_edge` (`has_edge_size`), this size applies to the edge of the body.
    """
    tip = setup.physics.indenter
    a = setup.a
    if setup.physics.is_compressed:
        return a if has_edge_size else None
    punch = tip.upright
    if isinstance(punch, FlatPunch):
        if setup.physics.domain.top_radius and a < END_FRACTION * punch.radius:
            # The contact ends on the curved top before it reaches the edge of the punch.
            return None
        if not _is_sharp(punch):
            return None
        # Under a rounded edge the pressure has its peak where the contact ends.
        edge = a if punch.edge_radius else punch.radius
        if isinstance(tip, TiltedTip) and setup.physics.domain.dim == 2:
            return edge * float(cos(tip.tilt))
        return edge
    # If the gap is evaluated at the deformed point, the body bends around the end of the tip, and
    # the pressure is finite.
    return max_radius(tip) if gap == "reference" and a >= END_FRACTION * max_radius(tip) else None


def sizes(
    config: Config, setup: ProblemSetup, resolution: MeshResolution | None, gap: str
) -> Sizes:
    """Return the element sizes of a scene.

    The order of precedence is: sizes for a requested accuracy, sizes of the config, the number of
    elements that time stepping, adhesion or a deep tip require, default sizes for the expected
    contact. Corners, inclusions, coatings and drained faces are refined afterwards.

    Parameters
    ----------
    config : Config
        The config.
    setup : ProblemSetup
        The problem setup.
    resolution : MeshResolution or None
        The mesh resolution for a requested accuracy.
    gap : str
        The key `contact.gap`, "reference" or "current".

    Raises
    ------
    ConfigError
        If sizes of the config are inconsistent, or if a size cannot be meshed.
    """
    physics = setup.physics
    mesh = config.mesh
    domain = setup.physics.domain
    a = setup.a
    edge_radius = _edge_radius(setup, gap, mesh.h_edge is not None)
    edge = round_length(edge_radius) if edge_radius is not None else None
    if isinstance(domain, ImportedDomain):
        return _imported_mesh_sizes(
            domain, setup, edge, resolution.refinements if resolution else mesh.refinements or 0
        )
    edge_refinement = _edge_refinement_factor(setup, edge)
    # Sizes of the config are checked even if an accuracy replaces them.
    fixed_sizes = configured_sizes(mesh, physics.scales, domain.height, edge)
    if resolution:
        fixed_sizes = resolution.sizes(
            domain.height,
            domain.max_width,
            edge,
            domain.smallest_semi_axis,
            edge_refinement,
        )
    if setup.curve_method == "time steps" and domain.dim == 2 and fixed_sizes.h_contact is None:
        fixed_sizes = replace(
            fixed_sizes,
            h_contact=round_length(min(a / STEPPED_ELEMENTS_PER_RADIUS, domain.height / 4)),
        )
    if setup.attraction:
        fixed_sizes = refine_cohesive_zone(config, setup, fixed_sizes)
    elif (radii := setup.adhesive_radii) and fixed_sizes.h_contact is None:
        # The smallest contact has as many elements as the largest one.
        fixed_sizes = replace(
            fixed_sizes,
            h_contact=round_length(a / ADHESIVE_ELEMENTS_PER_RADIUS),
            h_axis=round_length(radii[0] / ADHESIVE_ELEMENTS_PER_RADIUS),
        )
    fixed_sizes = refine_below_deep_tip(config, setup, fixed_sizes, edge, gap)
    default_sizes = replace(
        _default_sizes(setup, fixed_sizes, edge, edge_refinement),
        rounded_edge_width=frictional_edge_width(config, setup, edge, gap),
    )
    default_sizes = refine_base_contact(default_sizes, setup)
    refined_sizes = refine_corners(default_sizes, setup, fixed_sizes, resolution)
    refined_sizes = refine_inclusions(refined_sizes, config, setup, resolution)
    refined_sizes = refine_coatings(refined_sizes, config, setup, resolution)
    refined_sizes = refine_films(refined_sizes, setup, fixed_sizes, resolution)
    check_sizes(refined_sizes, setup, max(domain.max_width, domain.height))
    return refined_sizes


def _default_sizes(
    setup: ProblemSetup, fixed_sizes: FixedSizes, edge: float | None, edge_refinement: float
) -> Sizes:
    """Return the element sizes for the expected contact, without local refinements."""
    physics = setup.physics
    domain = setup.physics.domain
    a = setup.a
    dim = domain.dim
    # In unloading, the contact of a body that yields hardly shrinks until the tip leaves it.
    last_depth = setup.max_depth if physics.yields else physics.deltas[-1]
    anisotropy = anisotropy_factor(physics.material.decay_rates)
    # All further sizes follow from h_contact, whether the config gives it or not.
    h_contact = round_length(
        fixed_sizes.h_contact or min(a / (anisotropy * ELEMENTS_PER_RADIUS[dim]), domain.height / 4)
    )
    # Largest size: a quarter of the body. The corners at the base influence a contact that is wider
    # than half of the body, for which the size decreases to a tenth.
    width_excess = min(max(a / domain.max_width - 0.5, 0.0), 0.5)
    max_size = (0.25 - 0.3 * width_excess) * max(domain.height, domain.max_width)
    if wall_radius := domain.smallest_semi_axis:
        # Elements per radius of a curved wall. The polygon encloses 0.3 % less than the circle, and
        # the force of an incompressible body between roller walls changes by as much.
        elements_per_wall_radius = 8.0
        max_size = min(max_size, wall_radius / elements_per_wall_radius)
    # The pressure is singular at a punch's sharp edge, whose elements are smaller by this ratio. In
    # three dimensions a ratio of 20 would cost too much.
    edge_ratio = {2: 20.0, 3: 4.0}[dim] * (edge_refinement if dim == 2 else 1.0)
    tip = physics.indenter
    axis = physics.center
    elongation = 1.0
    edge_tilt = None
    if isinstance(tip, TiltedTip):
        axis, elongation = _tilted_contact(setup, tip)
        edge_tilt = (tip.tilt, tip.towards) if edge is not None and dim == 3 else None
    # The contact of the last row, which is small after unloading, gets as many elements as the
    # largest one, by smaller elements at the axis. Under a tilted tip it is not at this axis.
    is_at_axis = edge is None and axis == physics.center
    last_radius = setup.expected_radius(last_depth) if last_depth > 0 and is_at_axis else a
    last_radius_ratio = last_radius / a
    axis_size = h_contact
    if fixed_sizes.h_axis:
        axis_size = fixed_sizes.h_axis
    elif not fixed_sizes.h_contact:
        axis_size = h_contact * max(last_radius_ratio, MIN_RADIUS_RATIO)
    axis_size = round_length(axis_size)
    h_far = round_length(fixed_sizes.h_far or max(h_contact, max_size))
    patch = round_length(PATCH_FACTOR * elongation * a + 2 * h_contact)
    growth = round_length(fixed_sizes.grading or GRADING / anisotropy)
    h_axis = axis_size if axis_size < h_contact else None
    h_edge = None
    if edge is not None:
        h_edge = round_length(fixed_sizes.h_edge or h_contact / edge_ratio)
    return Sizes(
        h_contact,
        h_far,
        patch,
        growth,
        edge,
        h_edge,
        h_axis,
        round_length(a),
        edge_refinement_factor=edge_refinement,
        elongation=elongation,
        edge_tilt=edge_tilt,
        axis=axis,
        track=None if physics.track.is_point else replace(physics.track, center=axis),
    )


def _tilted_contact(setup: ProblemSetup, tip: TiltedTip) -> tuple[tuple[float, ...], float]:
    """Return the middle of the contact under a tilted tip, and its largest radius divided by a."""
    shift, reach = tip.contact_patch(setup.a, setup.physics.domain.dim)
    direction = cos(tip.towards), sin(tip.towards)
    axis = tuple(
        round_length(c + shift * float(e))
        for c, e in zip(setup.physics.center, direction, strict=False)
    )
    return axis, round_length(max(reach / setup.a, 1.0))


def _imported_mesh_sizes(
    domain: ImportedDomain, setup: ProblemSetup, edge: float | None, refinements: int
) -> Sizes:
    """Return the element sizes of an imported mesh after a number of uniform refinements.

    These sizes are the facet sizes in the contact and at the edge, and the longest edge of the
    mesh.
    """
    size_factor = 0.5**refinements
    a = setup.a
    h = round_length(size_factor * domain.facet_size_near(setup.physics.center, 0.0, a))
    h_edge = None
    if edge is not None:
        facet_size = domain.facet_size_near(setup.physics.center, edge, edge)
        h_edge = round_length(size_factor * facet_size)
    h_far = round_length(max(h, size_factor * domain.longest_edge))
    patch = round_length(PATCH_FACTOR * a + 2 * h)
    sizes_of_mesh = Sizes(
        h, h_far, patch, GRADING, edge, h_edge, a=round_length(a), axis=setup.physics.center
    )
    return replace(sizes_of_mesh, refinements=refinements)


def _edge_refinement_factor(setup: ProblemSetup, edge: float | None) -> float:
    """Return the factor by which the elements at a sharp edge are smaller because of a side wall.

    The factor is the sensitivity of the force to the punch's radius relative to the sensitivity
    without a wall, at least 1. A narrow gap between punch and wall increases it, by up to 1 +
    radius/gap, if the wall confines a nearly incompressible body or holds it in shear. It is 1
    without a sharp edge, and 0 for a tip that covers the top, under which the edge of the body ends
    the contact.
    """
    physics = setup.physics
    if edge is None:
        return 1.0
    if physics.is_compressed:
        return 0.0
    side_supports = [support for name, support in physics.domain.supports.items() if name != "base"]
    gap = max(physics.body.lateral_extent(physics.center) - edge, 1e-9 * edge)
    compression_factor = shear_factor = 1.0
    if physics.body.is_laterally_confined:
        compression_factor = 1 / max(1 - 2 * physics.largest_nu, 1e-9) ** 0.5
    if "fixed" in side_supports:
        shear_factor = (1 + edge / gap) ** 0.5
    wall_factor = min(1 + edge / gap, max(compression_factor, shear_factor))
    return max(1.0, EDGE_REFINEMENT * wall_factor)
