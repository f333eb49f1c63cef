"""Element sizes from the expected contact."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, exp, inf, log2
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.mesh.part_from_file import MeshedPart
from indent_sim.mesh.sizes import Film, Sizes
from indent_sim.model.body import Inclusion
from indent_sim.model.tips import FlatPunch, Indenter, reach
from indent_sim.model.units import Scales, rounded
from indent_sim.process.errors import ConfigError
from indent_sim.scene import boundary_films
from indent_sim.scene.corners import corners
from indent_sim.scene.fineness import (
    Fineness,
    SettledSizes,
    elements_for,
    fineness_of,
    steepness,
    target_of,
)
from indent_sim.scene.given import Given, in_time

if TYPE_CHECKING:
    from indent_sim.config.schema import Config, MeshSettings


# Elements per contact radius that keep the force within 0.3 % at the last step (measured on HERTZ
# axi and cube)
PER_RADIUS = {2: 10.0, 3: 5.0}  # by dim
# per radius of a contact that comes off: its pull-off within 0.2 %, measured on bonded layers
PER_ADHESIVE = 30.0
PER_ZONE = (
    2.0  # elements in the cohesive zone of a tip that adheres: the force within 0.3 %, measured
)
PER_HELD = {2: 8.0, 3: 4.0}  # elements in the radius of the contact that comes off, by dim
MOST_ACROSS = {
    2: 1000.0,
    3: 60.0,
}  # elements in the radius of a contact for the sake of its cohesive zone, by dim
# per radius of a contact that is stepped in time by nodal pressures: 0.03 % of the force, measured
PER_STEPPED = 25.0
SURFACE_POINTS = 40  # of theory's surface in every contact radius
GRADING = 0.2  # growth of the size per unit distance
# elements per radius of a curved wall: its polygon encloses 0.3 % less than the circle, which
PER_WALL_RADIUS = 8.0
# an incompressible body between roller walls feels as much
PATCH = 1.15  # the fine patch reaches this far beyond the expected contact radius
AUTO = 0.003  # of the force, the error that the sizes left to the program may cost
LEAST_LAST_RADIUS = (
    1e-4  # contact radius of the last step, of the largest one, that still gets as many elements
)
EDGE_RATIO = {
    2: 20.0,
    3: 4.0,
}  # refinement towards a punch's sharp edge, where the pressure is singular
# of a punch's radius: with a smaller radius of its edge the pressure has a peak where contact ends
NEARLY_SHARP = 0.5
AT_END = 0.999  # of the radius at which a tip ends: a contact that reaches it ends as under a punch
# Of the longest side of what is meshed: with smaller elements (up to 3e-9 were seen, and where the
# tip is at r = 0 and coordinates have all their digits below 1e-10) gmsh aborts or never ends
LEAST_ELEMENT_SIZE = 5e-9
ON_AXIS = 1e-10
# of the longest side of a box, a punch's radius: below 3e-6 the edge is lost in the tolerance of
LEAST_DISK = 1e-5
# gmsh's CAD kernel, 1e-7, and it fails or aborts
SQUEEZED_RATIO = (
    1.0  # contact radius over height from which a layer is squeezed rather than indented
)
# of (1 + radius/gap), by how much more a punch's radius is felt beside a wall: to 20 %, by layer
# theory
KEEN = 0.74
# Growth of the surface's stretch beneath a frictionless tip with each of its radii beyond the
# first: 13.5 was measured at the apex of a rod with a round end 4.75 radii deep in neo-Hookean
# rubber of nu = 0.49
STRETCHED = 0.7
# Power of that stretch by which sizes grow less with the depth: what is stretched is a slender
# column about the axis. With a third the rod came to 5 radii (sizes grow by 0.08), and with the
# usual 0.2 elements beneath it folded at 4.5
SLENDER = 1 / 3
# elements as long as the radius of a punch's edge, which go around it when the surface slides there
PER_ARC = 10.0
SHARPEST_ARC = 0.02  # of a punch's radius: a sharper edge would take thousands of elements
CORNERS = 0.1  # of the error of the force that all else may cost, what the corners may cost
FILMS = 0.5  # likewise, what films beside drained faces may cost where an accuracy is asked for
# of the contact radius: with smaller elements at a face its film costs less than 1e-4 of the force
FINEST_FILM = 1e-3
HEARD = 0.25  # of the error of the force that all else may cost, what inclusions may cost
PER_SKIN = 1.5  # elements across a skin: see `test_skins`
ACROSS = {
    2: (2.0, 30.0),
    3: (2.0, 6.0),
}  # elements in half the thickness of an inclusion, from and to, by dim
# What the force feels of a missing part of an inclusion, at most; and elements in one with flat
# faces, which miss none of it, times those in a round one. Measured for moduli of 1e-3 to 1e3 times
# the body's: 0.02 to 0.1 % at auto
MOST_FELT = 0.25
FLAT_INCLUSION_FACTOR = 0.5
# elements between it and the top of a cap or ball, which bends as a shell all around a soft
# inclusion:
PER_RIND = 4.0
# 0.1 to 0.2 % of the force for 0.05 to 0.4 of the radius, beside the series of `test_layered_ball`
INCOMPRESSIBLE = 0.45  # Poisson ratio from which it then gives way to the sides alone


def surface_points(given: Given) -> Sizes:
    """The distances between the points at which theory's surface is written: as many in every
    contact radius.
    """
    depths = [delta for delta in given.physics.deltas if delta > 0]
    inside = (
        [given.radius(delta) for delta in (min(depths), max(depths))] if depths else [given.a]
    )  # grows with depth
    a = rounded(max(inside))
    h = rounded(max(inside) / SURFACE_POINTS)
    on_axis = rounded(max(min(inside), LEAST_LAST_RADIUS * a) / SURFACE_POINTS)
    return Sizes(
        h, inf, a, GRADING, h_axis=on_axis if on_axis < h else None, a=a, axis=given.physics.center
    )


def fineness(config: Config, given: Given, per_radius: float | None) -> Fineness | None:
    """What `accuracy` asks of the mesh; the shallowest and the deepest contact know it."""
    physics = given.physics
    target = target_of(config.accuracy)
    refinements = 0
    if target is None:
        return None
    inside = [delta for delta in physics.deltas if delta > 0] or [
        max(map(abs, physics.deltas)) or 1.0
    ]
    contacts = [_contact(given, delta) for delta in (min(inside), max(inside))]
    if isinstance(
        physics.part, MeshedPart
    ):  # at least one refinement: the bars compare the last two
        coarse = given.a / physics.part.facet_near(physics.center, 0.0, given.a)
        halvings = log2((per_radius or elements_for(target, physics.part.dim)) / coarse)
        refinements = max(1, round(halvings) if per_radius else ceil(halvings))
        n = coarse * 2.0**refinements
    else:
        squeezed = max(a for _, a, _ in contacts) >= SQUEEZED_RATIO * physics.body.height
        gives_way = squeezed and physics.largest_nu >= INCOMPRESSIBLE
        is_confined = gives_way and not _is_sharp(
            physics.indenter
        )  # a sharp edge says where contact ends
        n = per_radius or elements_for(
            target, physics.part.dim, is_confined, steepness(physics.material.decay)
        )
    stiffness_given = getattr(config.contact, "epsilon_n", "auto") != "auto"
    found = fineness_of(target, n, contacts, physics.part.dim)
    is_column = physics.is_porous_column
    return replace(
        found, stiffness_given=stiffness_given, refinements=refinements, is_column=is_column
    )


def _is_sharp(tip: Indenter) -> bool:
    """Whether contact ends at a punch's edge, with a peak of the pressure there."""
    return isinstance(tip, FlatPunch) and tip.edge_radius < NEARLY_SHARP * tip.radius


def _contact(given: Given, delta: float) -> tuple[float, float, float]:
    a = given.radius(delta)
    solution = given.solution(delta)
    area = given.physics.part.kinematics.contact_area(a)
    return (
        delta,
        a,
        solution.force / area if solution else given.physics.material.E_star * delta / (2 * a),
    )


def _edge(given: Given, gap: str, is_asked: bool) -> float | None:
    """Radius of an edge at which the pressure is singular, or nearly: a punch's, or of a tip's end
    that is reached.

    A plate has none, and the edge of a punch wider than the body touches nothing. Where the scene
    asks for elements at the edge of the contact (`is_asked`), they are those at the body's rim.
    """
    tip = given.physics.indenter
    a = given.a
    if given.physics.is_compressed:
        return a if is_asked else None
    if isinstance(tip, FlatPunch):
        if given.physics.part.dome and a < AT_END * tip.radius:
            return None  # the curved top ends the contact
        return (a if tip.edge_radius else tip.radius) if _is_sharp(tip) else None
    # with a gap at the deformed point the body goes around the end
    return reach(tip) if gap == "reference" and a >= AT_END * reach(tip) else None


def sizes(config: Config, given: Given, wanted: Fineness | None, gap: str) -> Sizes:
    """The element sizes: the config's, those of the fineness that `accuracy` wants, or those of
    `sizing`.
    """
    physics = given.physics
    mesh = config.mesh
    part = given.physics.part
    a = given.a
    found = _edge(given, gap, mesh.h_edge is not None)
    edge = rounded(found) if found is not None else None
    if isinstance(part, MeshedPart):
        return _of_file(part, given, edge, wanted.refinements if wanted else mesh.refinements or 0)
    keenness = _keenness(given, edge)
    settled = _settled(mesh, physics.scales, part.height, edge)  # and refused, whoever chooses
    if wanted:
        settled = wanted.sizes(part.height, part.width, edge, part.bend or part.dome, keenness)
    if given.is_stepped and part.dim == 2 and settled.h_contact is None:
        settled = replace(settled, h_contact=rounded(min(a / PER_STEPPED, part.height / 4)))
    if given.attraction:
        settled = _in_cohesive_zone(config, given, settled)
    elif (
        held := given.held_radii
    ) and settled.h_contact is None:  # as fine in the smallest contact as in the deepest
        settled = replace(
            settled, h_contact=rounded(a / PER_ADHESIVE), h_axis=rounded(held[0] / PER_ADHESIVE)
        )
    settled = _beneath_deep_tip(config, given, settled, edge, gap)
    plain = replace(
        _plain(given, settled, edge, keenness), rubbed=_rubbed(config, given, edge, gap)
    )
    fine = _in_inclusions(_at_corners(plain, given, settled, wanted), config, given, wanted)
    fine = _in_films(_in_skins(fine, config, given, wanted), given, settled, wanted)
    _refuse_lost(fine, given, max(part.width, part.height))
    return fine


def _plain(given: Given, settled: SettledSizes, edge: float | None, keenness: float) -> Sizes:
    """Sizes for the expected contact; what is not settled follows the contact radius and the body."""
    physics = given.physics
    part = given.physics.part
    a = given.a
    dim = part.dim
    last = physics.deltas[-1]
    steeper = steepness(physics.material.decay)
    # What follows must not know who chose the finest size. Wide contacts feel the corners at the
    # base
    fine = rounded(settled.h_contact or min(a / (steeper * PER_RADIUS[dim]), part.height / 4))
    coarse = (0.25 - 0.3 * min(max(a / part.width - 0.5, 0.0), 0.5)) * max(part.height, part.width)
    if bend := part.bend or part.dome:
        coarse = min(coarse, bend / PER_WALL_RADIUS)
    ratio = EDGE_RATIO[dim] * (
        keenness if dim == 2 else 1.0
    )  # in three dimensions it would cost too much
    shrunk = (
        given.radius(last) if last > 0 and edge is None else a
    ) / a  # the contact of the last step
    on_axis = rounded(
        settled.h_axis or (fine if settled.h_contact else fine * max(shrunk, LEAST_LAST_RADIUS))
    )
    far = rounded(settled.h_far or max(fine, coarse))
    patch = rounded(PATCH * a + 2 * fine)
    growth = rounded(settled.grading or GRADING / steeper)
    h_axis = on_axis if on_axis < fine else None
    h_edge = rounded(settled.h_edge or fine / ratio) if edge is not None else None
    return Sizes(
        fine,
        far,
        patch,
        growth,
        edge,
        h_edge,
        h_axis,
        rounded(a),
        keenness=keenness,
        axis=physics.center,
    )


def _rubbed(config: Config, given: Given, edge: float | None, gap: str) -> float:
    """Width [length] of a punch's rounded edge, all of which friction at finite strain needs in
    small elements; or 0.

    Where the body slides around the edge, or sticks to it, it is sheared by about its own thickness
    within a fifth of the edge's radius. Elements of a tenth of that radius leave the pressure 9 %
    of p_max rough (see `observe.roughness`) and p_max 4 % too large. In three dimensions it would
    cost too much.
    """
    tip = given.physics.indenter
    physics = given.physics
    is_sheared = bool(config.contact.friction) and gap == "current" and not physics.small_strain
    if edge is None or not is_sheared or physics.part.dim == 3 or not isinstance(tip, FlatPunch):
        return 0.0
    return rounded(max(edge - (tip.radius - tip.edge_radius), 0.0)) if tip.edge_radius else 0.0


def _beneath_deep_tip(
    config: Config, given: Given, settled: SettledSizes, edge: float | None, gap: str
) -> SettledSizes:
    """The sizes with smaller elements beneath a tip that goes deeper than the radius at which it
    ends.

    Without friction the surface slides outwards along the tip and up its side: what lies beneath a
    rod five radii deep was a disc of a tenth of its radius, and one element of the usual size there
    would cover all of its end.
    """
    tip = given.physics.indenter
    end = reach(given.physics.indenter)
    depth = given.deepest / end
    is_given = (
        config.mesh.h_contact != "auto"
        or bool(config.contact.friction)
        or given.physics.part.dim == 3
    )
    if gap != "current" or is_given or given.physics.is_compressed or depth <= 1:
        return settled
    fine = settled.h_contact or min(given.a / PER_RADIUS[2], given.physics.part.height / 4)
    rho = getattr(tip, "edge_radius", 0.0)
    if rho >= SHARPEST_ARC * end:
        fine = min(fine, rho / PER_ARC)
    h_edge = rounded(fine) if edge is not None and rho > 0 else settled.h_edge
    stretched = exp(STRETCHED * (depth - 1))
    growth = settled.grading or rounded(GRADING / stretched**SLENDER)
    return replace(
        settled,
        h_contact=rounded(fine),
        h_axis=rounded(fine / stretched),
        h_edge=h_edge,
        grading=growth,
    )


def _in_cohesive_zone(config: Config, given: Given, settled: SettledSizes) -> SettledSizes:
    """The sizes with elements of half the cohesive zone; ConfigError for a zone that would take too
    many of them.
    """
    physics = given.physics
    found = given.attraction
    a = given.a
    L = physics.scales.length
    assert found is not None
    if config.mesh.h_contact != "auto" or not found.range:
        return settled
    E_star = physics.material.E_star
    most = MOST_ACROSS[physics.part.dim]
    usual = settled.h_contact or min(a / PER_RADIUS[physics.part.dim], physics.part.height / 4)
    if given.held_radii:
        usual = min(usual, given.held_radii[0] / PER_HELD[physics.part.dim])
    h = min(usual, found.zone(E_star) / PER_ZONE)
    if h * most < a:
        least = found.resolved_by(PER_ZONE * a / most, E_star) * L
        zone = found.zone(E_star) * L
        problem = (
            f"is too short for a mesh: its cohesive zone is {zone:.3g}, the contact radius "
            f"{a * L:.3g}"
        )
        raise ConfigError(
            "contact.adhesion.range",
            problem,
            f"at least {least:.3g}, or experiment.adhesion, its limit",
        )
    on_axis = settled.h_axis and min(settled.h_axis, h)
    edge, corner = (size and min(size, h) for size in (settled.h_edge, settled.h_corner))
    return replace(settled, h_contact=rounded(h), h_axis=on_axis, h_edge=edge, h_corner=corner)


def _of_file(part: MeshedPart, given: Given, edge: float | None, refinements: int) -> Sizes:
    """The sizes that a mesh from a file has after so many refinements: of its facets in the
    contact, of its largest.
    """
    shrunk = 0.5**refinements
    a = given.a
    h = rounded(shrunk * part.facet_near(given.physics.center, 0.0, a))
    h_edge = (
        rounded(shrunk * part.facet_near(given.physics.center, edge, edge))
        if edge is not None
        else None
    )
    far = rounded(max(h, shrunk * part.largest))
    patch = rounded(PATCH * a + 2 * h)
    found = Sizes(h, far, patch, GRADING, edge, h_edge, a=rounded(a), axis=given.physics.center)
    return replace(found, refinements=refinements)


def _keenness(given: Given, edge: float | None) -> float:
    """How much more than on a far larger body the force feels the radius of a sharp punch beside a
    wall.
    """
    physics = given.physics
    if edge is None:
        return 1.0
    if physics.is_compressed:
        return 0.0  # the body's own rim ends the contact, wherever elements end
    held = [support for name, support in physics.part.supports.items() if name != "base"]
    gap = max(physics.body.rim_distance(physics.center) - edge, 1e-9 * edge)
    squeezed = 1 / max(1 - 2 * physics.largest_nu, 1e-9) ** 0.5 if physics.body.is_held else 1.0
    sheared = (1 + edge / gap) ** 0.5 if "fixed" in held else 1.0
    return max(1.0, KEEN * min(1 + edge / gap, max(squeezed, sheared)))


def _at_corners(
    plain: Sizes, given: Given, settled: SettledSizes, wanted: Fineness | None
) -> Sizes:
    """The sizes, smaller towards all corners where the contact feels one; in three dimensions that
    costs too much.

    What the elements at corners cost the force stands in `corner_error`, whether they are refined
    or not: a coarser companion does not show it, since its elements at a corner are no larger than
    those in its contact.
    """
    physics = given.physics
    nu = physics.largest_nu
    end = given.a if physics.is_compressed else plain.edge
    around = corners(physics.part, physics.center, given.a, nu, end) if given.deepest > 0 else []
    if settled.h_corner and (physics.part.dim == 3 or not around):
        where = "bonded corners and narrow gaps beside the contact in a meshed section"
        raise ConfigError(
            "mesh.h_corner", f"is for {where}, and this scene has none", "leave it out"
        )
    error, n = (wanted.error, wanted.n) if wanted else (AUTO, given.a / plain.h_contact)
    there = [
        (corner, float(plain.at(np.array(corner.r), np.array(corner.depth)))) for corner in around
    ]
    h = settled.h_corner
    is_open = wanted is not None or settled.h_contact is None
    is_felt = any(corner.size(CORNERS * error, n) < size for corner, size in there)
    if physics.part.dim == 2 and h is None and is_open and is_felt:
        h = min(corner.size(CORNERS * error, n) for corner in around)
    if h is None:
        return replace(
            plain, corner_error=max((corner.error(size) for corner, size in there), default=0.0)
        )
    at = tuple(sorted({(corner.r, rounded(corner.depth)) for corner in around}))
    refined = replace(plain, corners=at, h_corner=min(rounded(h), plain.h_contact))
    sizes = (float(refined.at(np.array(corner.r), np.array(corner.depth))) for corner in around)
    cost = max(corner.error(size) for corner, size in zip(around, sizes, strict=True))
    return replace(refined, corner_error=cost)


def _in_inclusions(plain: Sizes, config: Config, given: Given, wanted: Fineness | None) -> Sizes:
    """The sizes, smaller in inclusions: flat facets inside a round one of radius R leave out
    (h/R)^2/4 of it.
    """
    inclusions = [region.inclusion for region in given.physics.part.regions if region.inclusion]
    error = HEARD * (wanted.error if wanted else AUTO)
    asked = config.mesh.h_inclusions
    found = [
        inclusion.thinnest / _elements_across(inclusion, given, error) for inclusion in inclusions
    ]
    if asked:
        found = [h / given.physics.scales.length for h in asked]
    return replace(plain, inclusions=tuple(zip(inclusions, map(rounded, found), strict=True)))


def _in_skins(plain: Sizes, config: Config, given: Given, wanted: Fineness | None) -> Sizes:
    """The sizes, smaller in the skins of a cap or ball: as many elements across as all else has in
    the radius, of the number that it has at automatic sizes.
    """
    skins = given.physics.part.skins
    asked = config.mesh.h_layers
    L = given.physics.scales.length
    finer = max(1.0, (wanted.n if wanted else 0.0) / PER_RADIUS[2])
    found = (
        [h / L for h in asked] if asked else [skin.thickness / (PER_SKIN * finer) for skin in skins]
    )
    return replace(plain, skins=tuple(zip(skins, map(rounded, found), strict=True)))


def _in_films(plain: Sizes, given: Given, settled: SettledSizes, wanted: Fineness | None) -> Sizes:
    """The sizes, smaller at the drained faces of a section where the first rows find only a film
    drained; in three dimensions that costs too much.
    """
    physics = given.physics
    is_open = wanted is not None or settled.h_contact is None or settled.h_film is not None
    drains = (
        physics.permeable
        and physics.part.dim == 2
        and given.history is not None
        and given.deepest > 0
    )
    if not (is_open and drains):
        return plain
    faces, h_film = films_of(given, plain, settled.h_film, FILMS * wanted.error if wanted else AUTO)
    return replace(plain, films=faces, h_film=h_film if faces else None)


def films_of(
    given: Given, plain: Sizes, asked: float | None, most: float
) -> tuple[tuple[Film, ...], float]:
    """The drained faces at which elements are smaller than those of `plain`, and the size [length]
    at those next to the contact: the one asked for, or what costs at `most` this share of the
    force.
    """
    assert given.history is not None
    physics = given.physics
    a = given.a
    D = boundary_films.slowest(given.physics)
    path = in_time(given, physics, plain.h_contact).path
    rows = boundary_films.rows_of(path)
    faces = boundary_films.drained_faces(given, min(path.times) - (path.begin or 0.0))
    h_film = asked
    if h_film is None:
        per = boundary_films.per_length(given)
        h_film = rounded(boundary_films.size_for(rows, most, D, per, plain.h_far, FINEST_FILM * a))
    found = []
    for side in physics.part.outline:
        if side.surface in faces:
            distance = faces[side.surface]
            h = h_film / boundary_films.felt(given, distance) ** 0.5
            nearest = (
                0.0 if side.surface == "top" else distance + (a if side.surface != "base" else 0.0)
            )
            if h < plain.h_far:
                found.append(Film(side, rounded(h), rounded(nearest + plain.patch)))
    return tuple(found), h_film


def _elements_across(inclusion: Inclusion, given: Given, error: float) -> float:
    """Elements in half the thickness of an inclusion, by what the strain energy of a point force
    feels of it.
    """
    physics = given.physics
    few, many = ACROSS[physics.part.dim]
    x, *y = physics.center
    d = max(float(inclusion.distance((x, y[0] if y else 0.0, 0.0))), inclusion.thinnest)
    is_section = physics.body.dim == 2
    felt = (
        8 * inclusion.half(0) * inclusion.half(2) / d**2
        if is_section
        else 2 * inclusion.volume * given.a / d**4
    )
    needed = (min(felt, MOST_FELT) / (4 * error)) ** 0.5
    needed *= 1.0 if inclusion.is_round(physics.part.dim) else FLAT_INCLUSION_FACTOR
    room = -inclusion.center[2] - inclusion.half(2)  # to the surface
    usual = min(max(needed, inclusion.thinnest / room, few), many)
    rind = PER_RIND * (HEARD * AUTO / error) ** 0.5
    return max(usual, rind * inclusion.thinnest / room) if physics.part.dome else usual


def _refuse_lost(found: Sizes, given: Given, largest: float) -> None:
    """ConfigError for sizes that are lost in rounding beside the `largest` length, or larger than
    an edge's radius.
    """
    part = given.physics.part
    L = given.physics.scales.length
    edge = found.edge
    if (
        edge is not None
        and part.dim == 3
        and part.bend is None
        and edge < (least := LEAST_DISK * largest)
    ):
        problem = (
            f"a punch of radius {edge * L:g} is too small for a box of this size, at least "
            f"{least * L:.3g}"
        )
        raise ConfigError(
            "indenter.radius", problem, "make the box smaller, or the body a half_space"
        )
    least = (ON_AXIS if part.kinematics.name == "axisymmetric" else LEAST_ELEMENT_SIZE) * largest
    if found.finest < least * (1 - 1e-9):
        problem = (
            f"elements of {found.finest * L:.3g} are too small for a body of this size, at "
            f"least {least * L:.3g}"
        )
        raise ConfigError(
            "mesh",
            problem,
            "make the body smaller: one of 1e5 contact radii feels like a half-space",
        )
    if edge is not None and (size := float(found.at(np.array(edge), np.array(0.0)))) > edge * (
        1 + 1e-9
    ):
        problem = f"elements of {size * L:.3g} are larger than the tip's radius {edge * L:.3g}"
        remedy = f"at most {edge * L / 4:.3g}, or auto; are both in the same unit of length?"
        raise ConfigError("mesh.h_contact", problem, remedy)


def _settled(mesh: MeshSettings, scales: Scales, height: float, edge: float | None) -> SettledSizes:
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
    return SettledSizes(
        **{name: length / scales.length for name, length in lengths.items()}, grading=grading
    )
