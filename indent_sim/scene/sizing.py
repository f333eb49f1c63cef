"""Element sizes from the expected contact."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, exp, inf, log2
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.sizes import DrainedFace, Sizes
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.tips import FlatPunch, Indenter, max_radius
from indent_sim.model.units import Scales, round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene import boundary_films
from indent_sim.scene.corner_singularities import corners
from indent_sim.scene.history_path import problem_along_history
from indent_sim.scene.path_rows import path_rows
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import (
    FixedSizes,
    MeshResolution,
    anisotropy_factor,
    required_elements,
    resolution_from_contacts,
    target_error,
)

if TYPE_CHECKING:
    from indent_sim.config.schema import Config, MeshSettings


# Elements per contact radius that keep the force within 0.3 % at the last step (measured on HERTZ
# axi and cube)
ELEMENTS_PER_RADIUS = {2: 10.0, 3: 5.0}  # by dim
# per radius of a contact that comes off: its pull-off within 0.2 %, measured on bonded layers
ADHESIVE_ELEMENTS_PER_RADIUS = 30.0
ELEMENTS_PER_ZONE = (
    2.0  # elements in the cohesive zone of a tip that adheres: the force within 0.3 %, measured
)
ELEMENTS_AT_PULL_OFF = {
    2: 8.0,
    3: 4.0,
}  # elements in the radius of the contact that comes off, by dim
MAX_ZONE_ELEMENTS = {
    2: 1000.0,
    3: 60.0,
}  # elements in the radius of a contact for the sake of its cohesive zone, by dim
# per radius of a contact that is stepped in time by nodal pressures: 0.03 % of the force, measured
STEPPED_ELEMENTS_PER_RADIUS = 25.0
SURFACE_POINTS = 40  # of theory's surface in every contact radius
GRADING = 0.2  # growth of the size per unit distance
# elements per radius of a curved wall: its polygon encloses 0.3 % less than the circle, which
ELEMENTS_PER_WALL_RADIUS = 8.0
# an incompressible body between roller walls feels as much
PATCH_FACTOR = 1.15  # the fine patch reaches this far beyond the expected contact radius
AUTO_ERROR = 0.003  # of the force, the error that the sizes left to the program may cost
MIN_LAST_RADIUS = (
    1e-4  # contact radius of the last step, of the largest one, that still gets as many elements
)
EDGE_RATIO = {
    2: 20.0,
    3: 4.0,
}  # refinement towards a punch's sharp edge, where the pressure is singular
# of a punch's radius: with a smaller radius of its edge the pressure has a peak where contact ends
NEARLY_SHARP = 0.5
END_FRACTION = (
    0.999  # of the radius at which a tip ends: a contact that reaches it ends as under a punch
)
# Of the longest side of what is meshed: with smaller elements (up to 3e-9 were seen, and where the
# tip is at r = 0 and coordinates have all their digits below 1e-10) gmsh aborts or never ends
MIN_ELEMENT_SIZE = 5e-9
MIN_AXIS_SIZE = 1e-10
# of the longest side of a box, a punch's radius: below 3e-6 the edge is lost in the tolerance of
MIN_PUNCH_RADIUS = 1e-5
# gmsh's CAD kernel, 1e-7, and it fails or aborts
SQUEEZED_RATIO = (
    1.0  # contact radius over height from which a layer is squeezed rather than indented
)
# of (1 + radius/gap), by how much more a punch's radius is felt beside a wall: to 20 %, by layer
# theory
EDGE_REFINEMENT = 0.74
# Growth of the surface's stretch beneath a frictionless tip with each of its radii beyond the
# first: 13.5 was measured at the apex of a rod with a round end 4.75 radii deep in neo-Hookean
# rubber of nu = 0.49
STRETCH_GROWTH = 0.7
# Power of that stretch by which sizes grow less with the depth: what is stretched is a slender
# column about the axis. With a third the rod came to 5 radii (sizes grow by 0.08), and with the
# usual 0.2 elements beneath it folded at 4.5
GRADING_STRETCH_EXPONENT = 1 / 3
# elements as long as the radius of a punch's edge, which go around it when the surface slides there
ELEMENTS_PER_ARC = 10.0
MIN_ARC_FRACTION = 0.02  # of a punch's radius: a sharper edge would take thousands of elements
CORNER_ERROR_SHARE = (
    0.1  # of the error of the force that all else may cost, what the corners may cost
)
FILM_ERROR_SHARE = (
    0.5  # likewise, what films beside drained faces may cost where an accuracy is asked for
)
# of the contact radius: with smaller elements at a face its film costs less than 1e-4 of the force
MIN_FILM_SIZE = 1e-3
INCLUSION_ERROR_SHARE = (
    0.25  # of the error of the force that all else may cost, what inclusions may cost
)
ELEMENTS_PER_COATING = 1.5  # elements across a skin: see `test_skins`
INCLUSION_ELEMENTS = {
    2: (2.0, 30.0),
    3: (2.0, 6.0),
}  # elements in half the thickness of an inclusion, from and to, by dim
# What the force feels of a missing part of an inclusion, at most; and elements in one with flat
# faces, which miss none of it, times those in a round one. Measured for moduli of 1e-3 to 1e3 times
# the body's: 0.02 to 0.1 % at auto
MAX_INCLUSION_WEIGHT = 0.25
FLAT_INCLUSION_FACTOR = 0.5
# elements between it and the top of a cap or ball, which bends as a shell all around a soft
# inclusion:
ELEMENTS_ABOVE_INCLUSION = 4.0
# 0.1 to 0.2 % of the force for 0.05 to 0.4 of the radius, beside the series of `test_layered_ball`
INCOMPRESSIBLE_NU = 0.45  # Poisson ratio from which it then gives way to the sides alone


def surface_point_sizes(setup: ProblemSetup) -> Sizes:
    """The distances between the points at which theory's surface is written: as many in every
    contact radius.
    """
    depths = [delta for delta in setup.physics.deltas if delta > 0]
    radii = (
        [setup.expected_radius(delta) for delta in (min(depths), max(depths))]
        if depths
        else [setup.a]
    )  # grows with depth
    a = round_length(max(radii))
    h = round_length(max(radii) / SURFACE_POINTS)
    h_axis = round_length(max(min(radii), MIN_LAST_RADIUS * a) / SURFACE_POINTS)
    return Sizes(
        h, inf, a, GRADING, h_axis=h_axis if h_axis < h else None, a=a, axis=setup.physics.center
    )


def mesh_resolution(
    config: Config, setup: ProblemSetup, per_radius: float | None
) -> MeshResolution | None:
    """What `accuracy` asks of the mesh; the shallowest and the deepest contact know it."""
    physics = setup.physics
    target = target_error(config.accuracy)
    refinements = 0
    if target is None:
        return None
    positive_depths = [delta for delta in physics.deltas if delta > 0] or [
        max(map(abs, physics.deltas)) or 1.0
    ]
    contacts = [
        _contact_state(setup, delta) for delta in (min(positive_depths), max(positive_depths))
    ]
    if isinstance(
        physics.domain, ImportedDomain
    ):  # at least one refinement: the bars compare the last two
        initial_elements = setup.a / physics.domain.facet_size_near(physics.center, 0.0, setup.a)
        halvings = log2(
            (per_radius or required_elements(target, physics.domain.dim)) / initial_elements
        )
        refinements = max(1, round(halvings) if per_radius else ceil(halvings))
        n = initial_elements * 2.0**refinements
    else:
        is_squeezed = max(a for _, a, _ in contacts) >= SQUEEZED_RATIO * physics.body.height
        is_nearly_incompressible = is_squeezed and physics.largest_nu >= INCOMPRESSIBLE_NU
        is_confined = is_nearly_incompressible and not _is_sharp(
            physics.indenter
        )  # a sharp edge says where contact ends
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
    """Whether contact ends at a punch's edge, with a peak of the pressure there."""
    return isinstance(tip, FlatPunch) and tip.edge_radius < NEARLY_SHARP * tip.radius


def _contact_state(setup: ProblemSetup, delta: float) -> tuple[float, float, float]:
    a = setup.expected_radius(delta)
    solution = setup.solution(delta)
    area = setup.physics.domain.kinematics.contact_area(a)
    return (
        delta,
        a,
        solution.force / area if solution else setup.physics.material.E_star * delta / (2 * a),
    )


def _edge_radius(setup: ProblemSetup, gap: str, is_asked: bool) -> float | None:
    """Radius of an edge at which the pressure is singular, or nearly: a punch's, or of a tip's end
    that is reached.

    A plate has none, and the edge of a punch wider than the body touches nothing. Where the scene
    asks for elements at the edge of the contact (`is_asked`), they are those at the body's rim.
    """
    tip = setup.physics.indenter
    a = setup.a
    if setup.physics.is_compressed:
        return a if is_asked else None
    if isinstance(tip, FlatPunch):
        if setup.physics.domain.top_radius and a < END_FRACTION * tip.radius:
            return None  # the curved top ends the contact
        return (a if tip.edge_radius else tip.radius) if _is_sharp(tip) else None
    # with a gap at the deformed point the body goes around the end
    return max_radius(tip) if gap == "reference" and a >= END_FRACTION * max_radius(tip) else None


def sizes(
    config: Config, setup: ProblemSetup, resolution: MeshResolution | None, gap: str
) -> Sizes:
    """The element sizes: the config's, those of the fineness that `accuracy` wants, or those of
    `sizing`.
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
    fixed_sizes = _configured_sizes(
        mesh, physics.scales, domain.height, edge
    )  # and refused, whoever chooses
    if resolution:
        fixed_sizes = resolution.sizes(
            domain.height,
            domain.max_width,
            edge,
            domain.wall_radius or domain.top_radius,
            edge_refinement,
        )
    if setup.uses_time_stepping and domain.dim == 2 and fixed_sizes.h_contact is None:
        fixed_sizes = replace(
            fixed_sizes,
            h_contact=round_length(min(a / STEPPED_ELEMENTS_PER_RADIUS, domain.height / 4)),
        )
    if setup.attraction:
        fixed_sizes = _refine_cohesive_zone(config, setup, fixed_sizes)
    elif (
        radii := setup.adhesive_radii
    ) and fixed_sizes.h_contact is None:  # as fine in the smallest contact as in the deepest
        fixed_sizes = replace(
            fixed_sizes,
            h_contact=round_length(a / ADHESIVE_ELEMENTS_PER_RADIUS),
            h_axis=round_length(radii[0] / ADHESIVE_ELEMENTS_PER_RADIUS),
        )
    fixed_sizes = _refine_below_deep_tip(config, setup, fixed_sizes, edge, gap)
    default_sizes = replace(
        _default_sizes(setup, fixed_sizes, edge, edge_refinement),
        rounded_edge_width=_frictional_edge_width(config, setup, edge, gap),
    )
    refined_sizes = _refine_inclusions(
        _refine_corners(default_sizes, setup, fixed_sizes, resolution), config, setup, resolution
    )
    refined_sizes = _refine_films(
        _refine_coatings(refined_sizes, config, setup, resolution), setup, fixed_sizes, resolution
    )
    _refuse_bad_sizes(refined_sizes, setup, max(domain.max_width, domain.height))
    return refined_sizes


def _default_sizes(
    setup: ProblemSetup, fixed_sizes: FixedSizes, edge: float | None, edge_refinement: float
) -> Sizes:
    """Element sizes for the expected contact; others follow from its radius and the body."""
    physics = setup.physics
    domain = setup.physics.domain
    a = setup.a
    dim = domain.dim
    last_depth = physics.deltas[-1]
    anisotropy = anisotropy_factor(physics.material.decay_rates)
    # What follows must not know who chose the finest size. Wide contacts feel the corners at the
    # base
    h_contact = round_length(
        fixed_sizes.h_contact or min(a / (anisotropy * ELEMENTS_PER_RADIUS[dim]), domain.height / 4)
    )
    max_size = (0.25 - 0.3 * min(max(a / domain.max_width - 0.5, 0.0), 0.5)) * max(
        domain.height, domain.max_width
    )
    if wall_radius := domain.wall_radius or domain.top_radius:
        max_size = min(max_size, wall_radius / ELEMENTS_PER_WALL_RADIUS)
    ratio = EDGE_RATIO[dim] * (
        edge_refinement if dim == 2 else 1.0
    )  # in three dimensions it would cost too much
    last_radius_ratio = (
        setup.expected_radius(last_depth) if last_depth > 0 and edge is None else a
    ) / a  # the contact of the last step
    axis_size = round_length(
        fixed_sizes.h_axis
        or (
            h_contact
            if fixed_sizes.h_contact
            else h_contact * max(last_radius_ratio, MIN_LAST_RADIUS)
        )
    )
    h_far = round_length(fixed_sizes.h_far or max(h_contact, max_size))
    patch = round_length(PATCH_FACTOR * a + 2 * h_contact)
    growth = round_length(fixed_sizes.grading or GRADING / anisotropy)
    h_axis = axis_size if axis_size < h_contact else None
    h_edge = round_length(fixed_sizes.h_edge or h_contact / ratio) if edge is not None else None
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
        axis=physics.center,
    )


def _frictional_edge_width(
    config: Config, setup: ProblemSetup, edge: float | None, gap: str
) -> float:
    """Width [length] of a punch's rounded edge, all of which friction at finite strain needs in
    small elements; or 0.

    Where the body slides around the edge, or sticks to it, it is sheared by about its own thickness
    within a fifth of the edge's radius. Elements of a tenth of that radius leave the pressure 9 %
    of p_max rough (see `observe.roughness`) and p_max 4 % too large. In three dimensions it would
    cost too much.
    """
    tip = setup.physics.indenter
    physics = setup.physics
    is_sheared = bool(config.contact.friction) and gap == "current" and not physics.small_strain
    if edge is None or not is_sheared or physics.domain.dim == 3 or not isinstance(tip, FlatPunch):
        return 0.0
    return round_length(max(edge - (tip.radius - tip.edge_radius), 0.0)) if tip.edge_radius else 0.0


def _refine_below_deep_tip(
    config: Config, setup: ProblemSetup, fixed_sizes: FixedSizes, edge: float | None, gap: str
) -> FixedSizes:
    """The sizes with smaller elements beneath a tip that goes deeper than the radius at which it
    ends.

    Without friction the surface slides outwards along the tip and up its side: what lies beneath a
    rod five radii deep was a disc of a tenth of its radius, and one element of the usual size there
    would cover all of its end.
    """
    tip = setup.physics.indenter
    end_radius = max_radius(setup.physics.indenter)
    depth = setup.max_depth / end_radius
    is_given = (
        config.mesh.h_contact != "auto"
        or bool(config.contact.friction)
        or setup.physics.domain.dim == 3
    )
    if gap != "current" or is_given or setup.physics.is_compressed or depth <= 1:
        return fixed_sizes
    h_contact = fixed_sizes.h_contact or min(
        setup.a / ELEMENTS_PER_RADIUS[2], setup.physics.domain.height / 4
    )
    edge_radius = getattr(tip, "edge_radius", 0.0)
    if edge_radius >= MIN_ARC_FRACTION * end_radius:
        h_contact = min(h_contact, edge_radius / ELEMENTS_PER_ARC)
    h_edge = round_length(h_contact) if edge is not None and edge_radius > 0 else fixed_sizes.h_edge
    stretched = exp(STRETCH_GROWTH * (depth - 1))
    growth = fixed_sizes.grading or round_length(GRADING / stretched**GRADING_STRETCH_EXPONENT)
    return replace(
        fixed_sizes,
        h_contact=round_length(h_contact),
        h_axis=round_length(h_contact / stretched),
        h_edge=h_edge,
        grading=growth,
    )


def _refine_cohesive_zone(
    config: Config, setup: ProblemSetup, fixed_sizes: FixedSizes
) -> FixedSizes:
    """The sizes with elements of half the cohesive zone; ConfigError for a zone that would take too
    many of them.
    """
    physics = setup.physics
    attraction = setup.attraction
    a = setup.a
    L = physics.scales.length
    assert attraction is not None
    if config.mesh.h_contact != "auto" or not attraction.range:
        return fixed_sizes
    E_star = physics.material.E_star
    max_elements = MAX_ZONE_ELEMENTS[physics.domain.dim]
    default_size = fixed_sizes.h_contact or min(
        a / ELEMENTS_PER_RADIUS[physics.domain.dim], physics.domain.height / 4
    )
    if setup.adhesive_radii:
        default_size = min(
            default_size, setup.adhesive_radii[0] / ELEMENTS_AT_PULL_OFF[physics.domain.dim]
        )
    h = min(default_size, attraction.cohesive_zone(E_star) / ELEMENTS_PER_ZONE)
    if h * max_elements < a:
        min_range = (
            attraction.range_for_cohesive_zone(ELEMENTS_PER_ZONE * a / max_elements, E_star) * L
        )
        zone = attraction.cohesive_zone(E_star) * L
        problem = (
            f"is too short for a mesh: its cohesive zone is {zone:.3g}, the contact radius "
            f"{a * L:.3g}"
        )
        raise ConfigError(
            "contact.adhesion.range",
            problem,
            f"at least {min_range:.3g}, or experiment.adhesion, its limit",
        )
    h_axis = fixed_sizes.h_axis and min(fixed_sizes.h_axis, h)
    edge, corner = (size and min(size, h) for size in (fixed_sizes.h_edge, fixed_sizes.h_corner))
    return replace(
        fixed_sizes, h_contact=round_length(h), h_axis=h_axis, h_edge=edge, h_corner=corner
    )


def _imported_mesh_sizes(
    domain: ImportedDomain, setup: ProblemSetup, edge: float | None, refinements: int
) -> Sizes:
    """The sizes that a mesh from a file has after so many refinements: of its facets in the
    contact, of its largest.
    """
    size_factor = 0.5**refinements
    a = setup.a
    h = round_length(size_factor * domain.facet_size_near(setup.physics.center, 0.0, a))
    h_edge = (
        round_length(size_factor * domain.facet_size_near(setup.physics.center, edge, edge))
        if edge is not None
        else None
    )
    h_far = round_length(max(h, size_factor * domain.longest_edge))
    patch = round_length(PATCH_FACTOR * a + 2 * h)
    sizes_of_mesh = Sizes(
        h, h_far, patch, GRADING, edge, h_edge, a=round_length(a), axis=setup.physics.center
    )
    return replace(sizes_of_mesh, refinements=refinements)


def _edge_refinement_factor(setup: ProblemSetup, edge: float | None) -> float:
    """How much more than on a far larger body the force feels the radius of a sharp punch beside a
    wall.
    """
    physics = setup.physics
    if edge is None:
        return 1.0
    if physics.is_compressed:
        return 0.0  # the body's own rim ends the contact, wherever elements end
    side_supports = [support for name, support in physics.domain.supports.items() if name != "base"]
    gap = max(physics.body.lateral_extent(physics.center) - edge, 1e-9 * edge)
    squeezed = (
        1 / max(1 - 2 * physics.largest_nu, 1e-9) ** 0.5
        if physics.body.is_laterally_confined
        else 1.0
    )
    sheared = (1 + edge / gap) ** 0.5 if "fixed" in side_supports else 1.0
    return max(1.0, EDGE_REFINEMENT * min(1 + edge / gap, max(squeezed, sheared)))


def _refine_corners(
    default_sizes: Sizes,
    setup: ProblemSetup,
    fixed_sizes: FixedSizes,
    resolution: MeshResolution | None,
) -> Sizes:
    """The sizes, smaller towards all corners where the contact feels one; in three dimensions that
    costs too much.

    What the elements at corners cost the force stands in `corner_error`, whether they are refined
    or not: a coarser companion does not show it, since its elements at a corner are no larger than
    those in its contact.
    """
    physics = setup.physics
    nu = physics.largest_nu
    contact_end = setup.a if physics.is_compressed else default_sizes.punch_edge
    near_corners = (
        corners(physics.domain, physics.center, setup.a, nu, contact_end)
        if setup.max_depth > 0
        else []
    )
    if fixed_sizes.h_corner and (physics.domain.dim == 3 or not near_corners):
        where = "bonded corners and narrow gaps beside the contact in a meshed section"
        raise ConfigError(
            "mesh.h_corner", f"is for {where}, and this scene has none", "leave it out"
        )
    error, n = (
        (resolution.error, resolution.n)
        if resolution
        else (AUTO_ERROR, setup.a / default_sizes.h_contact)
    )
    corner_sizes = [
        (corner, float(default_sizes.size_at(np.array(corner.r), np.array(corner.depth))))
        for corner in near_corners
    ]
    h = fixed_sizes.h_corner
    is_size_free = resolution is not None or fixed_sizes.h_contact is None
    is_felt = any(
        corner.size(CORNER_ERROR_SHARE * error, n) < size for corner, size in corner_sizes
    )
    if physics.domain.dim == 2 and h is None and is_size_free and is_felt:
        h = min(corner.size(CORNER_ERROR_SHARE * error, n) for corner in near_corners)
    if h is None:
        return replace(
            default_sizes,
            corner_error=max((corner.error(size) for corner, size in corner_sizes), default=0.0),
        )
    corner_points = tuple(
        sorted({(corner.r, round_length(corner.depth)) for corner in near_corners})
    )
    refined = replace(
        default_sizes, corners=corner_points, h_corner=min(round_length(h), default_sizes.h_contact)
    )
    sizes = (
        float(refined.size_at(np.array(corner.r), np.array(corner.depth)))
        for corner in near_corners
    )
    max_error = max(corner.error(size) for corner, size in zip(near_corners, sizes, strict=True))
    return replace(refined, corner_error=max_error)


def _refine_inclusions(
    default_sizes: Sizes, config: Config, setup: ProblemSetup, resolution: MeshResolution | None
) -> Sizes:
    """The sizes, smaller in inclusions: flat facets inside a round one of radius R leave out
    (h/R)^2/4 of it.
    """
    inclusions = [region.inclusion for region in setup.physics.domain.regions if region.inclusion]
    error = INCLUSION_ERROR_SHARE * (resolution.error if resolution else AUTO_ERROR)
    given_sizes = config.mesh.h_inclusions
    inclusion_sizes = [
        inclusion.min_half_width / _elements_in_inclusion(inclusion, setup, error)
        for inclusion in inclusions
    ]
    if given_sizes:
        inclusion_sizes = [h / setup.physics.scales.length for h in given_sizes]
    return replace(
        default_sizes,
        inclusions=tuple(zip(inclusions, map(round_length, inclusion_sizes), strict=True)),
    )


def _refine_coatings(
    default_sizes: Sizes, config: Config, setup: ProblemSetup, resolution: MeshResolution | None
) -> Sizes:
    """The sizes, smaller in the skins of a cap or ball: as many elements across as all else has in
    the radius, of the number that it has at automatic sizes.
    """
    coatings = setup.physics.domain.coatings
    given_sizes = config.mesh.h_layers
    L = setup.physics.scales.length
    refinement_factor = max(1.0, (resolution.n if resolution else 0.0) / ELEMENTS_PER_RADIUS[2])
    coating_sizes = (
        [h / L for h in given_sizes]
        if given_sizes
        else [
            coating.thickness / (ELEMENTS_PER_COATING * refinement_factor) for coating in coatings
        ]
    )
    return replace(
        default_sizes, coatings=tuple(zip(coatings, map(round_length, coating_sizes), strict=True))
    )


def _refine_films(
    default_sizes: Sizes,
    setup: ProblemSetup,
    fixed_sizes: FixedSizes,
    resolution: MeshResolution | None,
) -> Sizes:
    """The sizes, smaller at the drained faces of a section where the first rows find only a film
    drained; in three dimensions that costs too much.
    """
    physics = setup.physics
    is_size_free = (
        resolution is not None or fixed_sizes.h_contact is None or fixed_sizes.h_film is not None
    )
    drains = (
        physics.permeable_regions
        and physics.domain.dim == 2
        and setup.history is not None
        and setup.max_depth > 0
    )
    if not (is_size_free and drains):
        return default_sizes
    faces, h_film = film_sizes(
        setup,
        default_sizes,
        fixed_sizes.h_film,
        FILM_ERROR_SHARE * resolution.error if resolution else AUTO_ERROR,
    )
    return replace(default_sizes, drained_faces=faces, h_film=h_film if faces else None)


def film_sizes(
    setup: ProblemSetup, default_sizes: Sizes, given_size: float | None, max_fraction: float
) -> tuple[tuple[DrainedFace, ...], float]:
    """Drained faces that need elements smaller than `default_sizes`, and their size at the contact.

    The size [length] is the given one, or that with an error of the force of `max_fraction`.
    """
    assert setup.history is not None
    physics = setup.physics
    a = setup.a
    D = boundary_films.smallest_diffusivity(setup.physics)
    path = problem_along_history(setup, physics, default_sizes.h_contact).path
    rows = path_rows(path)
    faces = boundary_films.drained_faces(setup, min(path.times) - (path.start_time or 0.0))
    h_film = given_size
    if h_film is None:
        fraction_per_length = boundary_films.force_fraction_per_length(setup)
        h_film = round_length(
            boundary_films.film_element_size(
                rows, max_fraction, D, fraction_per_length, default_sizes.h_far, MIN_FILM_SIZE * a
            )
        )
    films = []
    for side in physics.domain.outline:
        if side.surface in faces:
            distance = faces[side.surface]
            h = h_film / boundary_films.distance_weight(setup, distance) ** 0.5
            nearest = (
                0.0 if side.surface == "top" else distance + (a if side.surface != "base" else 0.0)
            )
            if h < default_sizes.h_far:
                films.append(
                    DrainedFace(
                        side, round_length(h), round_length(nearest + default_sizes.fine_radius)
                    )
                )
    return tuple(films), h_film


def _elements_in_inclusion(inclusion: Inclusion, setup: ProblemSetup, error: float) -> float:
    """Elements in half the thickness of an inclusion, by what the strain energy of a point force
    feels of it.
    """
    physics = setup.physics
    min_elements, max_elements = INCLUSION_ELEMENTS[physics.domain.dim]
    x, *y = physics.center
    d = max(float(inclusion.distance((x, y[0] if y else 0.0, 0.0))), inclusion.min_half_width)
    is_section = physics.body.dim == 2
    inclusion_weight = (
        8 * inclusion.half_width(0) * inclusion.half_width(2) / d**2
        if is_section
        else 2 * inclusion.volume * setup.a / d**4
    )
    needed = (min(inclusion_weight, MAX_INCLUSION_WEIGHT) / (4 * error)) ** 0.5
    needed *= (
        1.0 if inclusion.is_curved_where_thinnest(physics.domain.dim) else FLAT_INCLUSION_FACTOR
    )
    cover_thickness = -inclusion.center[2] - inclusion.half_width(2)  # to the surface
    elements = min(
        max(needed, inclusion.min_half_width / cover_thickness, min_elements), max_elements
    )
    cover_elements = ELEMENTS_ABOVE_INCLUSION * (INCLUSION_ERROR_SHARE * AUTO_ERROR / error) ** 0.5
    return (
        max(elements, cover_elements * inclusion.min_half_width / cover_thickness)
        if physics.domain.top_radius
        else elements
    )


def _refuse_bad_sizes(sizes_found: Sizes, setup: ProblemSetup, largest: float) -> None:
    """ConfigError for sizes that are lost in rounding beside the `largest` length, or larger than
    an edge's radius.
    """
    domain = setup.physics.domain
    L = setup.physics.scales.length
    edge = sizes_found.punch_edge
    if (
        edge is not None
        and domain.dim == 3
        and domain.wall_radius is None
        and edge < (min_size := MIN_PUNCH_RADIUS * largest)
    ):
        problem = (
            f"a punch of radius {edge * L:g} is too small for a box of this size, at least "
            f"{min_size * L:.3g}"
        )
        raise ConfigError(
            "indenter.radius", problem, "make the box smaller, or the body a half_space"
        )
    min_size = (
        MIN_AXIS_SIZE if domain.kinematics.name == "axisymmetric" else MIN_ELEMENT_SIZE
    ) * largest
    if sizes_found.min_size < min_size * (1 - 1e-9):
        problem = (
            f"elements of {sizes_found.min_size * L:.3g} are too small for a body of this size, at "
            f"least {min_size * L:.3g}"
        )
        raise ConfigError(
            "mesh",
            problem,
            "make the body smaller: one of 1e5 contact radii feels like a half-space",
        )
    if edge is not None and (
        size := float(sizes_found.size_at(np.array(edge), np.array(0.0)))
    ) > edge * (1 + 1e-9):
        problem = f"elements of {size * L:.3g} are larger than the tip's radius {edge * L:.3g}"
        remedy = f"at most {edge * L / 4:.3g}, or auto; are both in the same unit of length?"
        raise ConfigError("mesh.h_contact", problem, remedy)


def _configured_sizes(
    mesh: MeshSettings, scales: Scales, height: float, edge: float | None
) -> FixedSizes:
    """The sizes of the config; ConfigError where they contradict one another or the scene."""
    names = ("h_contact", "h_axis", "h_edge", "h_corner", "h_film", "h_far")
    lengths = {
        name: getattr(mesh, name) for name in names if getattr(mesh, name) not in (None, "auto")
    }
    h = lengths.get("h_contact", 0.0)
    if h and lengths.get("h_far", h) < h:
        raise ConfigError("mesh.h_far", "is smaller than h_contact", f"at least {h:g}")
    if h > height * scales.length:
        raise ConfigError(
            "mesh.h_contact",
            "is larger than the body is thick",
            f"at most {height * scales.length:g}",
        )
    for name in ("h_axis", "h_edge", "h_corner", "h_film"):
        if name in lengths and not h:
            raise ConfigError(
                f"mesh.{name}", "needs h_contact, up to which sizes grow", "give both"
            )
        if lengths.get(name, 0.0) > h:
            raise ConfigError(f"mesh.{name}", "is larger than h_contact", f"at most {h:g}")
    if edge is None and "h_edge" in lengths:
        problem = "is for the sharp edge of a flat punch, or of a tip that ends inside the contact"
        raise ConfigError("mesh.h_edge", problem, "leave it out")
    grading = None if mesh.grading == "auto" else mesh.grading
    return FixedSizes(
        **{name: length / scales.length for name, length in lengths.items()}, grading=grading
    )
