"""Reduction by symmetry: the part of the body that is modelled, its supports and its pins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from math import inf, isclose

from indent_sim.mesh.modelled_part import Part, Pins, Point, Region, Side, polygon
from indent_sim.model.body import Box, Cylinder, Dome, Drawn, Endless, Inclusion, Strip
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional
from indent_sim.model.tips import Indenter
from indent_sim.process.errors import ConfigError

Regions = tuple[Region, ...]
Sides = tuple[Side, ...]
Supports = Mapping[str, str]
SYMMETRY = ("full", "half", "quarter")  # by the number of mirror planes
MIRROR_DECIMALS = 9  # decimals, of the body's height, to which mirror images must agree
QUARTER_ENDS = (
    (1.0, 0.0),
    (0.0, 1.0),
    (-1.0, 0.0),
    (0.0, -1.0),
)  # the ends of a circle's quarters, anticlockwise


def reduce(
    body: Drawn | Endless, center: Point, wanted: str, tip: Indenter, regions: Regions
) -> tuple[Part, str]:
    """Choose the symmetric part to model, and say why; `wanted` is `mesh.symmetry`.

    Raises ConfigError when the scene does not have the symmetry that is asked for.
    """
    if isinstance(
        body, Endless
    ):  # theory sees a section whose walls are at infinity; nothing meshes it
        part = _section(inf, body.height, regions, {"base": getattr(body, "base", "free")})
        return part, "tip of revolution on a body that is the same everywhere"
    if isinstance(body, Cylinder):
        part, why = _cylinder(body, center, wanted, tip, regions)
    elif isinstance(body, Strip):
        part, why = _strip(body, center, wanted, regions)
    elif isinstance(body, Dome):
        part, why = _dome(body, wanted, regions)
    else:
        part, why = _box(body, center, wanted, tip, regions)
    return replace(part, pins=_pins(part)), why


def _refuse(wanted: str, why: str, remedy: str) -> ConfigError:
    return ConfigError("mesh.symmetry", f"'{wanted}' does not fit this scene: {why}", remedy)


def _mirrors(tip: Indenter, axis: str) -> bool:
    """Whether the tip is its own mirror image about the plane normal to `axis` through its axis."""
    return tip.of_revolution or tip.is_mirrored({"x": 90.0, "y": 0.0}[axis])  # type: ignore[union-attr]


def _is_matched(regions: Regions, axis: str, c: float) -> bool:
    """Whether the inclusions are their own mirror images, together, about the plane normal to
    `axis` at c.
    """
    found = {_placed(region.inclusion) for region in regions if region.inclusion}
    return found == {_placed(inclusion.mirrored("xyz".index(axis), c)) for inclusion in found}


def _placed(inclusion: Inclusion) -> Inclusion:
    """The inclusion where it is to so many digits that two places are one."""
    return replace(
        inclusion, center=tuple(round(x, MIRROR_DECIMALS) + 0.0 for x in inclusion.center)
    )


def _cylinder(
    body: Cylinder, center: Point, wanted: str, tip: Indenter, regions: Regions
) -> tuple[Part, str]:
    on_axis = {axis: abs(c) <= 1e-12 * body.radius for axis, c in zip("xy", center, strict=True)}
    obstacle = "" if all(on_axis.values()) else "the tip stands off the cylinder's axis"
    obstacle = obstacle if tip.of_revolution else f"a {tip.shape} is no tip of revolution"
    if any(region.inclusion and not region.inclusion.is_about(body.center) for region in regions):
        obstacle = obstacle or "an inclusion is no body of revolution about the axis"
    if wanted == "plane_strain" or (wanted == "axisymmetric" and obstacle):
        raise _refuse(
            wanted, obstacle or "a cylinder is not infinitely long", "use 'auto', 'half' or 'full'"
        )
    supports = {"base": body.base, "r_max": body.sides}
    if wanted in ("auto", "axisymmetric") and not obstacle:
        return _section(
            body.radius, body.height, regions, supports
        ), "tip of revolution on the axis of a cylinder"
    symmetric = [
        axis
        for axis in "xy"
        if on_axis[axis] and _mirrors(tip, axis) and _is_matched(regions, axis, 0.0)
    ]
    cuts = _cuts(wanted, symmetric)
    part = _cut(
        cuts, ThreeDimensional(), _sector(body.radius, cuts), body.height, regions, supports
    )
    return part, f"{obstacle or 'three dimensions asked for'}; {_about(cuts)}"


def _section(radius: float, height: float, regions: Regions, supports: Supports) -> Part:
    section = _rectangle(("base", "r_max", "top", "r_min"), (0.0, radius), (-height, 0.0))
    return Part(
        Axisymmetric(), "axisymmetric", 1, section, height, regions, {**supports, "r_min": "roller"}
    )


def _sector(radius: float, cuts: list[str]) -> Sides:
    """The circle, or the half or quarter of it on one side of the mirror planes, from arcs of a
    quarter turn.
    """
    first = -1 if cuts == ["x"] else 0
    quarters = [QUARTER_ENDS[k % 4] for k in range(first, first + 4 // 2 ** len(cuts) + 1)]
    ends = [(radius * c, radius * s) for c, s in quarters]
    arcs = tuple(Side("r_max", start, end, middle=(0.0, 0.0)) for start, end in pairwise(ends))
    if not cuts:
        return arcs
    inwards = Side(f"{cuts[0]}_min", ends[-1], (0.0, 0.0))
    return (*arcs, inwards, Side(f"{cuts[-1]}_min", (0.0, 0.0), ends[0]))


def _strip(body: Strip, center: Point, wanted: str, regions: Regions) -> tuple[Part, str]:
    if wanted not in ("auto", "plane_strain", "half", "full"):
        raise _refuse(wanted, "a strip is modelled in plane strain", "use 'auto', 'half' or 'full'")
    symmetric = _middle(center[0], body.width) and body.sides.x_min == body.sides.x_max
    symmetric = symmetric and _is_matched(regions, "x", center[0])
    supports = {"base": str(body.base), **vars(body.sides)}
    if wanted == "half" and not symmetric:
        raise _refuse(
            wanted,
            "tip, sides or inclusions are not symmetric about the middle",
            "use 'auto' or 'full'",
        )
    cuts = ["x"] if symmetric and wanted != "full" else []
    across = (center[0] if cuts else 0.0, body.width)
    section = _rectangle(("base", "x_max", "top", "x_min"), across, (-body.height, 0.0))
    whole = "asked for whole" if wanted == "full" else "not symmetric about the tip"
    part = _cut(cuts, PlaneStrain(), section, body.height, regions, supports)
    return part, f"plane strain, {'tip and sides symmetric about the middle' if cuts else whole}"


def _box(
    body: Box, center: Point, wanted: str, tip: Indenter, regions: Regions
) -> tuple[Part, str]:
    if wanted not in ("auto", "quarter", "half", "full"):
        raise _refuse(
            wanted,
            "a box is modelled in three dimensions",
            "use 'auto', 'quarter', 'half' or 'full'",
        )
    sides = body.sides
    mirrored = {
        "x": _middle(center[0], body.size[0]) and sides.x_min == sides.x_max and _mirrors(tip, "x"),
        "y": _middle(center[1], body.size[1]) and sides.y_min == sides.y_max and _mirrors(tip, "y"),
    }
    matched = {axis: _is_matched(regions, axis, c) for axis, c in zip("xy", center, strict=True)}
    cuts = _cuts(
        wanted, [axis for axis, symmetric in mirrored.items() if symmetric and matched[axis]]
    )
    across = [
        (c if axis in cuts else 0.0, size)
        for axis, c, size in zip("xy", center, body.size, strict=False)
    ]
    outline = _rectangle(("y_min", "x_max", "y_max", "x_min"), *across)
    supports = {"base": body.base, **vars(sides)}
    part = _cut(cuts, ThreeDimensional(), outline, body.height, regions, supports)
    return part, f"tip and sides: {_about(cuts)}"


def _cut(
    cuts: list[str],
    kinematics: Kinematics,
    outline: Sides,
    height: float,
    regions: Regions,
    supports: Supports,
) -> Part:
    """The part of a body that is cut along mirror planes, which are rollers."""
    supports = {**supports, **{f"{axis}_min": "roller" for axis in cuts}}
    symmetry = SYMMETRY[len(cuts)]
    copies = 2 ** len(cuts)
    return Part(kinematics, symmetry, copies, outline, height, regions, supports, cuts=tuple(cuts))


def _dome(body: Dome, wanted: str, regions: Regions) -> tuple[Part, str]:
    if wanted not in ("auto", "axisymmetric"):
        raise _refuse(wanted, f"a {body.shape} is modelled about its axis", "use 'auto'")
    supports = {"base": body.base, "r_min": "roller"}
    outline = _round_section(body)
    if (
        body.height == 2 * body.radius and len(regions) > 1
    ):  # from a place in the core, as all sections
        start = (0.0, -body.radius)
        (first, *others, last) = outline
        outline = (
            Side("r_min", start, first.start),
            first,
            *others,
            Side("r_min", last.start, start),
        )
    part = Part(Axisymmetric(), "axisymmetric", 1, outline, body.height, regions, supports)
    mirrored = (
        "; half of the ball, which the plane through its center mirrors, and half of the approach"
    )
    return (
        part,
        f"tip of revolution on the axis of a {body.shape}{mirrored if body.pieces == 2 else ''}",
    )


def _round_section(body: Dome) -> Sides:
    """The base, the curved surface from its edge up to the apex in arcs of a quarter turn at most,
    and the axis.
    """
    R = body.radius
    foot = body.foot
    apex = (0.0, 0.0)
    nadir = (0.0, -body.height)
    middle = (0.0, -R)
    is_whole = foot[1] > nadir[1]
    around = [foot, *([(R, -R)] if foot[1] < -R else []), apex]
    base = Side("base", nadir, foot, middle=middle if is_whole else None)
    curved = (Side("top", start, end, middle=middle) for start, end in pairwise(around))
    return base, *curved, Side("r_min", apex, nadir)


def _rectangle(
    surfaces: tuple[str, ...], across: tuple[float, float], up: tuple[float, float]
) -> Sides:
    (x0, x1) = across
    (y0, y1) = up
    return polygon(surfaces, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def _pins(part: Part) -> Pins:
    """Point constraints (point, component) that take the rigid modes the supports leave, and
    nothing else.
    """
    if isinstance(part.kinematics, Axisymmetric) or "fixed" in part.supports.values():
        return ()
    if part.bend is not None:
        return _round_pins(part, part.bend)
    corner = tuple(low for low, _ in part.extent)
    held = {
        part.normal(surface) for surface, support in part.supports.items() if support == "roller"
    }
    horizontal = range(part.dim - 1)
    pins = [(corner, component) for component in horizontal if component not in held]
    if part.dim == 3 and not held.intersection(horizontal):  # the turn about z is free too
        pins.append(((part.extent[0][1], *corner[1:]), 1))
    return tuple(pins)


def _round_pins(part: Part, radius: float) -> Pins:
    """Without a mirror plane the turn about z is free, even between rollers; along the planes, the
    shift.
    """
    at_x = (radius, 0.0, -part.height)
    at_y = (0.0, radius, -part.height)
    cut = [axis for axis in "xy" if f"{axis}_min" in part.supports]
    if part.supports["r_max"] == "roller":
        return () if cut else ((at_x, 1),)
    if not cut:
        return ((at_x, 0), (at_x, 1), (at_y, 0))
    return {"x": ((at_y, 1),), "y": ((at_x, 0),), "xy": ()}["".join(cut)]


def _about(cuts: list[str]) -> str:
    return f"symmetric about {' and '.join(cuts)}" if cuts else "no symmetry used"


def _cuts(wanted: str, symmetric: list[str]) -> list[str]:
    needed = {"auto": len(symmetric), "full": 0, "half": 1, "quarter": 2}[wanted]
    if needed > len(symmetric):
        have = f"only about the mid-plane of {symmetric[0]}" if symmetric else "about no mid-plane"
        raise _refuse(wanted, f"tip, sides and inclusions are symmetric {have}", "use 'auto'")
    return symmetric[:needed]


def _middle(c: float, width: float) -> bool:
    return isclose(c, width / 2, rel_tol=2e-11)  # both are rounded to 12 digits
