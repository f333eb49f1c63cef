"""Symmetry reduction: the model domain of a body with its supports and pins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from math import inf, isclose

from indent_sim.mesh.model_domain import ModelDomain, Pins, Point, Region, Side, polygon_sides
from indent_sim.model.body import Cylinder, DimensionedBody
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import Indenter
from indent_sim.model.unbounded_bodies import UnboundedBody
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import ConfigError

Regions = tuple[Region, ...]
Sides = tuple[Side, ...]
Supports = Mapping[str, str]


def reduce(
    body: DimensionedBody | UnboundedBody,
    center: Point,
    requested_symmetry: str,
    tip: Indenter,
    regions: Regions,
    slide_axis: str = "",
) -> tuple[ModelDomain, str]:
    """Choose the smallest model domain that the symmetry of the scene allows.

    Parameters
    ----------
    body : DimensionedBody or UnboundedBody
        The nondimensional body.
    center : tuple of float
        Horizontal position of the tip's axis [length].
    requested_symmetry : str
        The key `mesh.symmetry`.
    tip : Indenter
        The tip.
    regions : tuple of Region
        Layers and inclusions.
    slide_axis : str
        Horizontal axis, "x" or "y", along which the tip slides; empty if it does not. A plane
        normal to this axis is no mirror plane.

    Returns
    -------
    ModelDomain
        The part of the body that is meshed, with its supports.
    str
        The reason for its symmetry.

    Raises
    ------
    ConfigError
        If the scene does not have the requested symmetry.
    """
    if isinstance(body, UnboundedBody):
        # Theory solves this axisymmetric section, whose wall is at infinity; it is never meshed.
        domain = _axisymmetric_domain(
            inf, body.height, regions, {"base": getattr(body, "base", "free")}
        )
        return domain, "axisymmetric: axisymmetric tip on a laterally unbounded body"
    if isinstance(body, Cylinder):
        domain, reason = _cylinder_domain(
            body, center, requested_symmetry, tip, regions, slide_axis
        )
    elif isinstance(body, Strip):
        domain, reason = _strip_domain(body, center, requested_symmetry, tip, regions, slide_axis)
    elif isinstance(body, SphericalBody):
        domain, reason = _spherical_domain(body, requested_symmetry, regions)
    else:
        domain, reason = _box_domain(body, center, requested_symmetry, tip, regions, slide_axis)
    return replace(domain, pins=_pins(domain)), reason


def _symmetry_error(requested_symmetry: str, why: str, remedy: str) -> ConfigError:
    """Return the ConfigError for a requested symmetry that the scene does not have."""
    return ConfigError(
        "mesh.symmetry", f"'{requested_symmetry}' does not fit this scene: {why}", remedy
    )


def _is_tip_symmetric(tip: Indenter, axis: str) -> bool:
    """True if the plane through the tip's axis, normal to `axis`, is a mirror plane of the tip."""
    angle = {"x": 90.0, "y": 0.0}[axis]
    return tip.is_axisymmetric or tip.has_mirror_plane(angle)  # type: ignore[union-attr]


def _are_inclusions_symmetric(regions: Regions, axis: str, c: float) -> bool:
    """True if a plane normal to a horizontal axis is a mirror plane of all inclusions together."""
    inclusions = {_round_center(region.inclusion) for region in regions if region.inclusion}
    return inclusions == {
        _round_center(inclusion.mirror_image("xyz".index(axis), c)) for inclusion in inclusions
    }


def _round_center(inclusion: Inclusion) -> Inclusion:
    """Return the inclusion with a rounded center, so that mirror images compare equal."""
    # Mirror images must agree to 1e-9 of the height of the body.
    mirror_decimals = 9
    return replace(
        inclusion, center=tuple(round(x, mirror_decimals) + 0.0 for x in inclusion.center)
    )


def _cylinder_domain(
    body: Cylinder,
    center: Point,
    requested_symmetry: str,
    tip: Indenter,
    regions: Regions,
    slide_axis: str,
) -> tuple[ModelDomain, str]:
    """Return the model domain of a cylinder (section, whole, half or quarter) and the reason."""
    on_axis = {axis: abs(c) <= 1e-12 * body.radius for axis, c in zip("xy", center, strict=True)}
    obstacle = "" if all(on_axis.values()) else "the tip's axis is not the cylinder's axis"
    obstacle = obstacle if tip.is_axisymmetric else f"a {tip.shape} is not axisymmetric"
    obstacle = obstacle or ("the tip slides" if slide_axis else "")
    if any(
        region.inclusion and not region.inclusion.is_axisymmetric_about(body.center)
        for region in regions
    ):
        obstacle = obstacle or "an inclusion is not axisymmetric about the cylinder's axis"
    if requested_symmetry == "plane_strain" or (requested_symmetry == "axisymmetric" and obstacle):
        raise _symmetry_error(
            requested_symmetry,
            obstacle or "a cylinder is not infinitely long",
            "use 'auto', 'half' or 'full'",
        )
    supports = {"base": body.base, "r_max": body.sides}
    if requested_symmetry in ("auto", "axisymmetric") and not obstacle:
        return _axisymmetric_domain(
            body.radius, body.height, regions, supports
        ), "axisymmetric: body and tip are rotationally symmetric about the same axis"
    symmetric = [
        axis
        for axis in "xy"
        if on_axis[axis]
        and axis != slide_axis
        and _is_tip_symmetric(tip, axis)
        and _are_inclusions_symmetric(regions, axis, 0.0)
    ]
    mirror_axes = _mirror_axes(requested_symmetry, symmetric)
    domain = _cut_domain(
        mirror_axes,
        ThreeDimensional(),
        _sector_outline(body.radius, mirror_axes),
        body.height,
        regions,
        supports,
    )
    why_solid = obstacle or "a three-dimensional model is requested"
    return domain, f"{why_solid}; {_mirror_plane_text(mirror_axes)}"


def _axisymmetric_domain(
    radius: float, height: float, regions: Regions, supports: Supports
) -> ModelDomain:
    """Return the axisymmetric section of a cylinder."""
    section = _rectangle_outline(("base", "r_max", "top", "r_min"), (0.0, radius), (-height, 0.0))
    return ModelDomain(
        Axisymmetric(), "axisymmetric", 1, section, height, regions, {**supports, "r_min": "roller"}
    )


def _sector_outline(radius: float, mirror_axes: list[str]) -> Sides:
    """Return the outline of a circle, half circle or quarter circle, with arcs of 90 degrees."""
    first = -1 if mirror_axes == ["x"] else 0
    # Ends of the quarters of a unit circle, anticlockwise.
    quarter_ends = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
    quarters = [quarter_ends[k % 4] for k in range(first, first + 4 // 2 ** len(mirror_axes) + 1)]
    ends = [(radius * c, radius * s) for c, s in quarters]
    arcs = tuple(Side("r_max", start, end, center=(0.0, 0.0)) for start, end in pairwise(ends))
    if not mirror_axes:
        return arcs
    inwards = Side(f"{mirror_axes[0]}_min", ends[-1], (0.0, 0.0))
    return (*arcs, inwards, Side(f"{mirror_axes[-1]}_min", (0.0, 0.0), ends[0]))


def _strip_domain(
    body: Strip,
    center: Point,
    requested_symmetry: str,
    tip: Indenter,
    regions: Regions,
    slide_axis: str,
) -> tuple[ModelDomain, str]:
    """Return the model domain of a strip (section or half section) and the reason."""
    if requested_symmetry not in ("auto", "plane_strain", "half", "full"):
        raise _symmetry_error(
            requested_symmetry,
            "a strip is modelled in plane strain",
            "use 'auto', 'half' or 'full'",
        )
    symmetric = _is_centred(center[0], body.width) and body.sides.x_min == body.sides.x_max
    symmetric = symmetric and _is_tip_symmetric(tip, "x") and not slide_axis
    symmetric = symmetric and _are_inclusions_symmetric(regions, "x", center[0])
    supports = {"base": str(body.base), **vars(body.sides)}
    if requested_symmetry == "half" and not symmetric:
        raise _symmetry_error(
            requested_symmetry,
            "the tip slides"
            if slide_axis
            else "tip, sides or inclusions are not symmetric about the middle",
            "use 'auto' or 'full'",
        )
    mirror_axes = ["x"] if symmetric and requested_symmetry != "full" else []
    x_range = (center[0] if mirror_axes else 0.0, body.width)
    section = _rectangle_outline(("base", "x_max", "top", "x_min"), x_range, (-body.height, 0.0))
    domain = _cut_domain(mirror_axes, PlaneStrain(), section, body.height, regions, supports)
    reason = "tip, sides and inclusions are not symmetric about the tip's axis"
    if mirror_axes:
        reason = "tip, sides and inclusions are symmetric about the mid-plane"
    elif requested_symmetry == "full":
        reason = "the full section is requested"
    elif slide_axis:
        reason = "the tip slides, so that no plane normal to x is a mirror plane"
    return domain, f"plane strain: {reason}"


def _box_domain(
    body: Box,
    center: Point,
    requested_symmetry: str,
    tip: Indenter,
    regions: Regions,
    slide_axis: str,
) -> tuple[ModelDomain, str]:
    """Return the model domain of a box (all, half or a quarter of it) and the reason."""
    if requested_symmetry not in ("auto", "quarter", "half", "full"):
        raise _symmetry_error(
            requested_symmetry,
            "a box is modelled in three dimensions",
            "use 'auto', 'quarter', 'half' or 'full'",
        )
    sides = body.sides
    tip_symmetric = {
        "x": _is_centred(center[0], body.size[0])
        and sides.x_min == sides.x_max
        and _is_tip_symmetric(tip, "x"),
        "y": _is_centred(center[1], body.size[1])
        and sides.y_min == sides.y_max
        and _is_tip_symmetric(tip, "y"),
    }
    inclusions_symmetric = {
        axis: _are_inclusions_symmetric(regions, axis, c)
        for axis, c in zip("xy", center, strict=True)
    }
    mirror_axes = _mirror_axes(
        requested_symmetry,
        [
            axis
            for axis, symmetric in tip_symmetric.items()
            if symmetric and inclusions_symmetric[axis] and axis != slide_axis
        ],
    )
    ranges = [
        (c if axis in mirror_axes else 0.0, size)
        for axis, c, size in zip("xy", center, body.size, strict=False)
    ]
    outline = _rectangle_outline(("y_min", "x_max", "y_max", "x_min"), *ranges)
    supports = {"base": body.base, **vars(sides)}
    domain = _cut_domain(mirror_axes, ThreeDimensional(), outline, body.height, regions, supports)
    return domain, f"tip, sides and inclusions: {_mirror_plane_text(mirror_axes)}"


def _cut_domain(
    mirror_axes: list[str],
    kinematics: Kinematics,
    outline: Sides,
    height: float,
    regions: Regions,
    supports: Supports,
) -> ModelDomain:
    """Return the part of a body on one side of its mirror planes, which become roller supports."""
    supports = {**supports, **{f"{axis}_min": "roller" for axis in mirror_axes}}
    # The index is the number of mirror planes.
    symmetry_names = ("full", "half", "quarter")
    symmetry = symmetry_names[len(mirror_axes)]
    symmetry_factor = 2 ** len(mirror_axes)
    return ModelDomain(
        kinematics,
        symmetry,
        symmetry_factor,
        outline,
        height,
        regions,
        supports,
        mirror_axes=tuple(mirror_axes),
    )


def _spherical_domain(
    body: SphericalBody, requested_symmetry: str, regions: Regions
) -> tuple[ModelDomain, str]:
    """Return the axisymmetric section of a ball or a cap, and the reason for this symmetry."""
    if requested_symmetry not in ("auto", "axisymmetric"):
        raise _symmetry_error(
            requested_symmetry, f"a {body.shape} is modelled as axisymmetric", "use 'auto'"
        )
    supports = {"base": body.base, "r_min": "roller"}
    outline = _spherical_outline(body)
    if (body.is_whole and len(regions) > 1) or body.rests_on_flat:
        # The outline of every section begins in the core; that of a whole ball on its axis. A body
        # that rests on a flat is pinned at half of its height.
        start = (0.0, -body.height / 2)
        (first, *middle_sides, last) = outline
        outline = (
            Side("r_min", start, first.start),
            first,
            *middle_sides,
            Side("r_min", last.start, start),
        )
    domain = ModelDomain(Axisymmetric(), "axisymmetric", 1, outline, body.height, regions, supports)
    reason = "axisymmetric: body and tip are rotationally symmetric about the same axis"
    if body.contacts_per_body == 2:
        reason += (
            f"; the horizontal plane through the center of the {body.shape} is a mirror plane: "
            f"half of the {body.shape} is modelled, with half of the depth"
        )
    return domain, reason


def _spherical_outline(body: SphericalBody) -> Sides:
    """Return the outline of a spherical body: base, arcs of the curved surface, and axis."""
    R = body.radius
    c = body.half_height
    base_edge = body.base_edge
    apex = (0.0, 0.0)
    bottom = (0.0, -body.height)
    middle = (0.0, -c)
    is_whole = base_edge[1] > bottom[1]
    arc_ends = [base_edge, *([(R, -c)] if base_edge[1] < -c else []), apex]
    base = Side(
        "base", bottom, base_edge, center=middle if is_whole else None, stretch=body.stretch
    )
    # The overhang of a cap may touch the flat on which it rests.
    underside = "base" if body.rests_on_flat else "top"
    curved = (
        Side("top" if end == apex else underside, start, end, middle, body.stretch)
        for start, end in pairwise(arc_ends)
    )
    return base, *curved, Side("r_min", apex, bottom)


def _rectangle_outline(
    surfaces: tuple[str, ...], x_range: tuple[float, float], z_range: tuple[float, float]
) -> Sides:
    """Return the outline of a rectangle with its surface names."""
    (x0, x1) = x_range
    (y0, y1) = z_range
    return polygon_sides(surfaces, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def _pins(domain: ModelDomain) -> Pins:
    """Return the point constraints (point, component) that only prevent rigid-body modes."""
    if domain.rests_on_flat:
        return (((0.0, -domain.height / 2), 1),)
    if isinstance(domain.kinematics, Axisymmetric) or "fixed" in domain.supports.values():
        return ()
    if domain.wall_radius is not None:
        return _cylinder_pins(domain, domain.wall_radius)
    corner = tuple(low for low, _ in domain.extent)
    constrained_components = {
        domain.normal_component(surface)
        for surface, support in domain.supports.items()
        if support == "roller"
    }
    horizontal = range(domain.dim - 1)
    pins = [
        (corner, component) for component in horizontal if component not in constrained_components
    ]
    if domain.dim == 3 and not constrained_components.intersection(horizontal):
        # No roller prevents the rotation about z.
        pins.append(((domain.extent[0][1], *corner[1:]), 1))
    return tuple(pins)


def _cylinder_pins(domain: ModelDomain, radius: float) -> Pins:
    """Return the pins of a cylinder.

    Without a mirror plane the rotation about z is free, even with roller sides. With one mirror
    plane the translation along that plane is free.
    """
    at_x = (radius, 0.0, -domain.height)
    at_y = (0.0, radius, -domain.height)
    mirror_axes = [axis for axis in "xy" if f"{axis}_min" in domain.supports]
    if domain.supports["r_max"] == "roller":
        return () if mirror_axes else ((at_x, 1),)
    if not mirror_axes:
        return ((at_x, 0), (at_x, 1), (at_y, 0))
    return {"x": ((at_y, 1),), "y": ((at_x, 0),), "xy": ()}["".join(mirror_axes)]


def _mirror_plane_text(mirror_axes: list[str]) -> str:
    """Return the mirror planes as text, each named by the axis normal to it."""
    if not mirror_axes:
        return "no mirror plane is used"
    return f"symmetric about the mid-planes normal to {' and '.join(mirror_axes)}"


def _mirror_axes(requested_symmetry: str, symmetric_axes: list[str]) -> list[str]:
    """Return the axes normal to the mirror planes that are used.

    Raises
    ------
    ConfigError
        If the scene has too few mirror planes for the requested symmetry.
    """
    plane_count = {"auto": len(symmetric_axes), "full": 0, "half": 1, "quarter": 2}[
        requested_symmetry
    ]
    if plane_count > len(symmetric_axes):
        symmetry_text = (
            f"only about the mid-plane normal to {symmetric_axes[0]}"
            if symmetric_axes
            else "about no mid-plane"
        )
        raise _symmetry_error(
            requested_symmetry,
            f"tip, sides and inclusions are symmetric {symmetry_text}",
            "use 'auto'",
        )
    return symmetric_axes[:plane_count]


def _is_centred(c: float, width: float) -> bool:
    """True if a coordinate is in the middle of a width; both are rounded to 12 digits."""
    return isclose(c, width / 2, rel_tol=2e-11)
