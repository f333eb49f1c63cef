"""Element sizes from the expected contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil, inf, log2
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.mesh.meshed import MeshedPart
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Inclusion
from indent_sim.model.tips import FlatPunch, Indenter, reach
from indent_sim.model.units import Scales, rounded
from indent_sim.process.errors import ConfigError
from indent_sim.scene.corners import Corner, corners
from indent_sim.scene.fineness import Fineness, SettledSizes, elements_for, fineness_of, steepness, target_of
from indent_sim.scene.given import Given

if TYPE_CHECKING:
    from indent_sim.config.schema import Config, MeshSettings


# Elements per contact radius that keep the force within 0.3 % at the last step (measured on HERTZ axi and cube)
PER_RADIUS = {2: 10.0, 3: 5.0}  # by dim
PER_ADHESIVE = 30.0  # per radius of a contact that comes off: its pull-off within 0.2 %, measured on bonded layers
PER_STEPPED = 25.0  # per radius of a contact that is stepped in time by nodal pressures: 0.03 % of the force, measured
POINTS = 40  # of theory's surface in every contact radius
GRADING = 0.2  # growth of the size per unit distance
PER_WALL_RADIUS = 8.0  # elements per radius of a curved wall: its polygon encloses 0.3 % less than the circle, which
# an incompressible body between roller walls feels as much
PATCH = 1.15  # the fine patch reaches this far beyond the expected contact radius
AUTO = 0.003  # of the force, the error that the sizes left to the program may cost
SMALLEST = 1e-4  # contact radius of the last step, of the largest one, that still gets as many elements
EDGE_RATIO = {2: 20.0, 3: 4.0}  # refinement towards a punch's sharp edge, where the pressure is singular


def choose(a: float, height: float, width: float, dim: int, settled: SettledSizes, *,
           axis: tuple[float, ...], edge: float | None, last: float | None = None, round_radius: float | None = None,
           keenness: float = 1.0, steeper: float = 1.0) -> Sizes:  # fmt: skip
    """Sizes for an expected contact radius a in a body of the given height and width [length].

    last: the radius to expect at the last step, if there is contact [length].
    round_radius: of a curved wall, which straight facets follow [length].
    keenness: how much finer than usual a punch's edge must be, in two dimensions; in three it would cost too much.
    steeper: times as many elements as in an isotropic body, in the contact radius and below it.
    """
    fine = rounded(settled.h_contact or min(a / (steeper * PER_RADIUS[dim]), height / 4))  # what follows must not know
    wide = min(max(a / width - 0.5, 0.0), 0.5)  # who chose it. Wide contacts feel the corners at the base
    coarse = (0.25 - 0.3 * wide) * max(height, width)
    far = settled.h_far or max(fine, min(coarse, round_radius / PER_WALL_RADIUS) if round_radius else coarse)
    patch = PATCH * a + 2 * fine
    ratio = EDGE_RATIO[dim] * (keenness if dim == 2 else 1.0)
    h_edge = rounded(settled.h_edge or fine / ratio) if edge is not None else None
    on_axis = rounded(settled.h_axis or (fine if settled.h_contact else fine * max((last or a) / a, SMALLEST)))
    grading = rounded(settled.grading or GRADING / steeper)
    return Sizes(fine, rounded(far), rounded(patch), grading, edge, h_edge,
                 h_axis=on_axis if on_axis < fine else None, a=rounded(a), keenness=keenness, axis=axis)  # fmt: skip

NEARLY_SHARP = 0.5  # of a punch's radius: with a smaller radius of its edge the pressure has a peak where contact ends
AT_END = 0.999  # of the radius at which a tip ends: a contact that reaches it ends as under a punch
FINEST, ON_AXIS = 5e-9, 1e-10  # of the longest side of what is meshed: with smaller elements (up to 3e-9 were seen, and
# where the tip is at r = 0 and coordinates have all their digits below 1e-10) gmsh aborts or never ends
LEAST_DISK = 1e-5  # of the longest side of a box, a punch's radius: below 3e-6 the edge is lost in the tolerance of
# gmsh's CAD kernel, 1e-7, and it fails or aborts
WIDE = 1.0  # contact radius over height from which a layer is squeezed rather than indented
KEEN = 0.74  # of (1 + radius/gap), by how much more a punch's radius is felt beside a wall: to 20 %, by layer theory
CORNERS = 0.1  # of the error of the force that all else may cost, what the corners may cost
RULE = 0.25  # and from what share on they rule how the force converges
HEARD = 0.25  # of the error of the force that all else may cost, what inclusions may cost
ACROSS = {2: (2.0, 30.0), 3: (2.0, 6.0)}  # elements in half the thickness of an inclusion, from and to, by dim
# What the force feels of a missing part of an inclusion, at most; and elements in one with flat faces, which miss none
# of it, times those in a round one. Measured for moduli of 1e-3 to 1e3 times the body's: 0.02 to 0.1 % at auto
MOST_FELT, FLAT = 0.25, 0.5
INCOMPRESSIBLE = 0.45  # Poisson ratio from which it then gives way to the sides alone


def surface_points(given: Given) -> Sizes:
    """The distances between the points at which theory's surface is written: as many in every contact radius."""
    inside = [given.radius(delta) for delta in given.deltas if delta > 0] or [given.a]
    a, h = rounded(max(inside)), rounded(max(inside) / POINTS)
    on_axis = rounded(max(min(inside), SMALLEST * a) / POINTS)
    return Sizes(h, inf, a, GRADING, h_axis=on_axis if on_axis < h else None, a=a, axis=given.center)


def fineness(config: Config, given: Given, per_radius: float | None) -> Fineness | None:
    """What `accuracy` asks of the mesh; the shallowest and the deepest contact know it."""
    target = target_of(config.accuracy)
    if target is None:
        return None
    inside = [delta for delta in given.deltas if delta > 0] or [max(map(abs, given.deltas)) or 1.0]
    contacts = [_contact(given, delta) for delta in (min(inside), max(inside))]
    stiffness_given = getattr(config.contact, "epsilon_n", "auto") != "auto"
    if isinstance(given.part, MeshedPart):
        return _fineness_of_file(given.part, given, target, per_radius, contacts, stiffness_given)
    squeezed = max(a for _, a, _ in contacts) >= WIDE * given.body.height
    gives_way = squeezed and given.material.constants.nu >= INCOMPRESSIBLE
    confined = gives_way and not _is_sharp(given.tip)  # a sharp edge says where contact ends: nothing scatters
    return fineness_of(target, per_radius, contacts, given.dim, confined, stiffness_given, _steeper(given))


def _fineness_of_file(part: MeshedPart, given: Given, target: float, per_radius: float | None,
                      contacts: Sequence[tuple[float, float, float]], stiffness_given: bool) -> Fineness:  # fmt: skip
    """The refinements of a mesh from a file whose error is expected within the target, at least one: the bars compare
    the last two."""
    coarse = given.a / part.facet_near(given.center, 0.0, given.a)
    n = per_radius or elements_for(target, given.dim)
    refinements = max(1, round(log2(n / coarse)) if per_radius else ceil(log2(n / coarse)))
    found = fineness_of(target, coarse * 2.0**refinements, contacts, given.dim, False, stiffness_given)
    return replace(found, refinements=refinements)


def _steeper(given: Given) -> float:
    """What an anisotropic top layer asks of the elements."""
    return steepness(given.material.decay)


def _is_sharp(tip: Indenter) -> bool:
    """Whether contact ends at a punch's edge, with a peak of the pressure there."""
    return isinstance(tip, FlatPunch) and tip.edge_radius < NEARLY_SHARP * tip.radius


def _contact(given: Given, delta: float) -> tuple[float, float, float]:
    """A depth, the contact radius and the mean pressure to expect there."""
    a, solution = given.radius(delta), given.solution(delta)
    area = given.part.kinematics.contact_area(a)
    return delta, a, solution.force / area if solution else given.material.E_star * delta / (2 * a)


def _edge(given: Given, gap: str) -> float | None:
    """Radius of an edge at which the pressure is singular, or nearly: a punch's, or where contact reaches a tip's end.

    With a gap at the deformed point the body goes around the end of a tip.
    """
    tip, a = given.tip, given.a
    if isinstance(tip, FlatPunch):
        if given.part.dome and a < AT_END * tip.radius:
            return None  # the curved top ends the contact
        return (a if tip.edge_radius else tip.radius) if _is_sharp(tip) else None
    return reach(tip) if gap == "reference" and a >= AT_END * reach(tip) else None


def sizes(config: Config, given: Given, wanted: Fineness | None, gap: str) -> Sizes:
    """The element sizes: the config's, those of the fineness that `accuracy` wants, or those of `sizing`."""
    mesh, part, a = config.mesh, given.part, given.a
    edge = _edge(given, gap)
    edge = rounded(edge) if edge is not None else None
    if isinstance(part, MeshedPart):
        return _of_file(part, given, edge, wanted.refinements if wanted else mesh.refinements or 0)
    height, width, bend, keenness = part.height, part.width, part.bend or part.dome, _keenness(given, edge)
    settled = _settled(mesh, given.scales, height, edge)
    if wanted:
        settled = wanted.sizes(height, width, edge, bend, keenness)
    last = given.radius(given.deltas[-1]) if given.deltas[-1] > 0 and edge is None else None
    stepped = given.experiment is not None and given.experiment.is_stepped and given.dim == 2
    if stepped and settled.h_contact is None:
        settled = replace(settled, h_contact=rounded(min(a / PER_STEPPED, height / 4)))
    if given.adhesive and settled.h_contact is None:  # as fine in the smallest contact as in the deepest one
        settled = replace(settled, h_contact=rounded(a / PER_ADHESIVE),
                          h_axis=rounded(given.adhesive[0] / PER_ADHESIVE))  # fmt: skip
    plain = choose(a, height, width, given.dim, settled, axis=given.center, edge=edge, last=last, round_radius=bend,
                          keenness=keenness, steeper=_steeper(given))  # fmt: skip
    found = _in_inclusions(_at_corners(plain, given, settled, wanted), config, given, wanted)
    if edge is not None and part.dim == 3 and part.bend is None:
        _refuse_lost_edge(edge * given.scales.length, LEAST_DISK * max(width, height) * given.scales.length)
    least = (ON_AXIS if part.kinematics.name == "axisymmetric" else FINEST) * max(width, height)
    _refuse_lost(found.finest * given.scales.length, least * given.scales.length)
    if edge is not None:
        size = float(found.at(np.array(edge), np.array(0.0)))
        _refuse_coarse_edge(edge * given.scales.length, size * given.scales.length)
    return found


def _of_file(part: MeshedPart, given: Given, edge: float | None, refinements: int) -> Sizes:
    """The sizes that a mesh from a file has after so many refinements: of its facets in the contact, of its largest."""
    shrunk, a = 0.5**refinements, given.a
    h = rounded(shrunk * part.facet_near(given.center, 0.0, a))
    h_edge = rounded(shrunk * part.facet_near(given.center, edge, edge)) if edge is not None else None
    far = rounded(max(h, shrunk * part.largest))
    return Sizes(h, far, rounded(PATCH * a + 2 * h), GRADING, edge, h_edge, a=rounded(a), axis=given.center,
                 refinements=refinements)  # fmt: skip


def _keenness(given: Given, edge: float | None) -> float:
    """How much more than on a far larger body the force feels the radius of a sharp punch.

    d ln F/d ln a of an incompressible layer grows with a over the gap up to the wall, until its compressibility gives
    way: 2 to 100, by layer theory. A fixed wall holds the surface in the gap too.
    """
    held = [support for name, support in given.part.supports.items() if name != "base"]
    if edge is None:
        return 1.0
    gap = max(given.body.rim_distance(given.center) - edge, 1e-9 * edge)
    squeezed = 1 / max(1 - 2 * given.material.constants.nu, 1e-9) ** 0.5 if given.body.is_held else 1.0
    sheared = (1 + edge / gap) ** 0.5 if "fixed" in held else 1.0
    return max(1.0, KEEN * min(1 + edge / gap, max(squeezed, sheared)))


def _at_corners(plain: Sizes, given: Given, settled: SettledSizes, wanted: Fineness | None) -> Sizes:
    """The sizes, smaller towards the corners that the contact feels; all of them where it feels one.

    In three dimensions they are lines, and elements along them would cost more than they give: there it is only said.
    """
    nu, sharp = given.material.constants.nu, plain.edge is not None
    around = corners(given.part, given.center, given.a, nu, sharp) if given.deepest > 0 else []
    if settled.h_corner and (given.dim == 3 or not around):
        raise ConfigError("mesh.h_corner", "is for bonded corners and narrow gaps beside the contact in a meshed "
                          "section, and this scene has none", "leave it out")  # fmt: skip
    error, n = (wanted.error, wanted.n) if wanted else (AUTO, given.a / plain.h_contact)
    cost = max((corner.error(_there(plain, corner)) for corner in around), default=0.0)
    if given.dim == 3:
        ruled = any(_is_too_coarse(plain, corner, RULE * error, n) for corner in around)
        return replace(plain, corner_error=cost, ruled_by_corners=ruled)
    h = settled.h_corner
    is_open = wanted is not None or settled.h_contact is None
    if h is None and is_open and any(_is_too_coarse(plain, corner, CORNERS * error, n) for corner in around):
        h = min(corner.size(CORNERS * error, n) for corner in around)
    if h is None:
        return replace(plain, corner_error=cost)
    at = tuple(sorted({(corner.r, rounded(corner.depth)) for corner in around}))
    return replace(plain, corners=at, h_corner=min(rounded(h), plain.h_contact))


def _in_inclusions(plain: Sizes, config: Config, given: Given, wanted: Fineness | None) -> Sizes:
    """The sizes, smaller in inclusions: flat facets inside a round one of radius R leave out (h/R)^2/4 of it."""
    inclusions = [region.inclusion for region in given.part.regions if region.inclusion]
    asked = config.mesh.h_inclusions
    if asked:
        found = [h / given.scales.length for h in asked]
    else:
        error = HEARD * (wanted.error if wanted else AUTO)
        found = [inclusion.thinnest / _elements_across(inclusion, given, error) for inclusion in inclusions]
    return replace(plain, inclusions=tuple(zip(inclusions, map(rounded, found), strict=True)))


def _elements_across(inclusion: Inclusion, given: Given, error: float) -> float:
    """Elements in half the thickness of an inclusion, for which the force is as good as that; more where it is near
    the surface.

    The force feels an inclusion as the strain energy of a point force does at the distance d of the contact: a volume V
    by 2 a V/d^4, in plane strain a section A by 2 A/d^2.
    """
    few, many = ACROSS[given.dim]
    x, *y = given.center
    d = max(float(inclusion.distance((x, y[0] if y else 0.0, 0.0))), inclusion.thinnest)
    felt = 2 * inclusion.volume * given.a / d**4
    if given.body.dim == 2:
        felt = 8 * inclusion.half(0) * inclusion.half(2) / d**2
    needed = (min(felt, MOST_FELT) / (4 * error)) ** 0.5 * (1.0 if inclusion.is_round(given.dim) else FLAT)
    room = -inclusion.center[2] - inclusion.half(2)  # to the surface
    return min(max(needed, inclusion.thinnest / room, few), many)


def _is_too_coarse(sizes: Sizes, corner: Corner, error: float, n: float) -> bool:
    """Whether elements at a corner cost more than this relative error of the force."""
    return corner.size(error, n) < _there(sizes, corner)


def _there(sizes: Sizes, corner: Corner) -> float:
    """The element size [length] at a corner."""
    return float(sizes.at(np.array(corner.r), np.array(corner.depth)))


def _refuse_lost(smallest: float, least: float) -> None:
    """ConfigError for elements so small beside the body that their corners are rounding errors."""
    if smallest < least * (1 - 1e-9):
        problem = f"elements of {smallest:.3g} are too small for a body of this size, at least {least:.3g}"
        raise ConfigError("mesh", problem, "make the body smaller: one of 1e5 contact radii feels like a half-space")


def _refuse_coarse_edge(radius: float, size: float) -> None:
    """ConfigError for elements larger than the radius of an edge: they know nothing of the contact."""
    if size > radius * (1 + 1e-9):
        raise ConfigError("mesh.h_contact", f"elements of {size:.3g} are larger than the tip's radius {radius:.3g}",
                          f"at most {radius / 4:.3g}, or auto; are both in the same unit of length?")  # fmt: skip


def _refuse_lost_edge(radius: float, least: float) -> None:
    """ConfigError for a punch whose edge cannot be drawn on the top of a box."""
    if radius < least:
        problem = f"a punch of radius {radius:g} is too small for a box of this size, at least {least:.3g}"
        raise ConfigError("indenter.radius", problem, "make the box smaller, or the body a half_space")


def _settled(mesh: MeshSettings, scales: Scales, height: float, edge: float | None) -> SettledSizes:
    """The sizes of the config; ConfigError where they contradict one another or the scene."""
    names = ("h_contact", "h_axis", "h_edge", "h_corner", "h_far")
    lengths = {name: getattr(mesh, name) for name in names if getattr(mesh, name) not in (None, "auto")}
    h = lengths.get("h_contact", 0.0)
    if h and lengths.get("h_far", h) < h:
        raise ConfigError("mesh.h_far", "is smaller than h_contact", f"at least {h:g}")
    if h > height * scales.length:
        raise ConfigError("mesh.h_contact", "is larger than the body is thick", f"at most {height * scales.length:g}")
    for name in ("h_axis", "h_edge", "h_corner"):
        if name in lengths and not h:
            raise ConfigError(f"mesh.{name}", "needs h_contact, up to which sizes grow", "give both")
        if lengths.get(name, 0.0) > h:
            raise ConfigError(f"mesh.{name}", "is larger than h_contact", f"at most {h:g}")
    if edge is None and "h_edge" in lengths:
        problem = "is for the sharp edge of a flat punch, or of a tip that ends inside the contact"
        raise ConfigError("mesh.h_edge", problem, "leave it out")
    grading = None if mesh.grading == "auto" else mesh.grading
    return SettledSizes(**{name: length / scales.length for name, length in lengths.items()}, grading=grading)
