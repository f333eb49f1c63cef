"""Geometry of a model domain for gmsh: outline, layers, inclusions and size field.

Source: Gmsh Reference Manual, for the built-in and the OpenCASCADE kernel.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from indent_sim.mesh.grid import LENGTH_DIGITS
from indent_sim.mesh.mesher_process import Gmsh
from indent_sim.mesh.model_domain import ModelDomain, Side
from indent_sim.mesh.size_formulas import (
    coating_formula,
    drained_face_formula,
    inclusion_formula,
    size_formula,
)
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.inclusions import (
    BallInclusion,
    CylinderInclusion,
    EllipsoidInclusion,
    Inclusion,
)


def _cad_kernel(gmsh: Gmsh, domain: ModelDomain) -> Gmsh:
    """Return gmsh's CAD kernel: OpenCASCADE for inclusions, otherwise the built-in kernel."""
    return gmsh.model.occ if domain.inclusions else gmsh.model.geo


def draw_inclusions(gmsh: Gmsh, domain: ModelDomain) -> None:
    """Insert the inclusions, or the parts of them inside the domain, as separate volumes."""
    occ = gmsh.model.occ
    body_entities = gmsh.model.getEntities(domain.dim)
    solids = [
        (domain.dim, _add_inclusion(occ, inclusion, domain.dim)) for inclusion in domain.inclusions
    ]
    inner_solids, _ = occ.intersect(solids, body_entities, removeTool=False)
    occ.fragment(body_entities, inner_solids)
    occ.synchronize()


def _add_inclusion(occ: Gmsh, inclusion: Inclusion, dim: int) -> int:
    """Add an inclusion as a solid; in two dimensions the section y = 0, drawn in (x, y)."""
    (x, y, z) = _round_point(inclusion.center)
    (a, b, c) = _round_point(tuple(map(inclusion.half_width, range(3))))
    if isinstance(inclusion, EllipsoidInclusion):
        return _add_ellipsoid(occ, (x, y, z), (a, b, c), dim)
    if isinstance(inclusion, BallInclusion):
        return int(occ.addDisk(x, z, 0.0, a, a) if dim == 2 else occ.addSphere(x, y, z, a))
    if dim == 2:
        return int(occ.addRectangle(x - a, z - c, 0.0, 2 * a, 2 * c))
    if isinstance(inclusion, CylinderInclusion):
        return int(occ.addCylinder(x, y, z - c, 0.0, 0.0, 2 * c, a))
    return int(occ.addBox(x - a, y - b, z - c, 2 * a, 2 * b, 2 * c))


def _add_ellipsoid(
    occ: Gmsh, center: tuple[float, ...], semi_axes: tuple[float, ...], dim: int
) -> int:
    """Add an ellipsoid as a stretched disk or ball, because gmsh's disk must be longer along x.

    The ball is rotated first, because OpenCASCADE 7.8 does not close a stretched ball that symmetry
    planes cut along the seam or at a pole.
    """
    (x, y, z) = center
    (a, b, c) = semi_axes
    tag = int(occ.addDisk(x, z, 0.0, 1.0, 1.0) if dim == 2 else occ.addSphere(x, y, z, 1.0))
    center_point, factors = ((x, z, 0.0), (a, c, 1.0)) if dim == 2 else ((x, y, z), (a, b, c))
    if dim == 3:
        # Rotation axis and angle that take the seam and the poles of a ball out of all symmetry
        # planes.
        rotation = (1.0, -1.0, 0.0, 1.0)
        occ.rotate([(dim, tag)], *center_point, *rotation)
    occ.dilate([(dim, tag)], *center_point, *factors)
    return tag


def draw_section(gmsh: Gmsh, domain: ModelDomain, sizes: Sizes) -> None:
    """Create the geometry of a two-dimensional domain.

    Its outline is split at the tip's axis, at the edge of a punch and at the interfaces of layers.
    """
    geo = _cad_kernel(gmsh, domain)
    division_points = [
        (_round_point(position), z, side)
        for side in domain.outline
        for position, z in _division_points(domain, sizes, side)
    ]
    corners = [corner for corner, _, _ in division_points]
    arc_centers = [_round_point(side.center) for side in domain.outline if side.center]
    point_tags = {
        point: geo.addPoint(*point, 0.0) for point in dict.fromkeys([*corners, *arc_centers])
    }
    points = [point_tags[corner] for corner in corners]
    pairs = zip(points, points[1:] + points[:1], strict=True)
    lines = [
        _draw_side(geo, side, a, b, point_tags)
        for (a, b), (_, _, side) in zip(pairs, division_points, strict=True)
    ]
    interface_ends = [
        [k for k, (_, level, _) in enumerate(division_points) if level == z]
        for z in domain.interfaces
    ]
    interface_lines = [
        _draw_interface(geo, domain, *((corners[k], points[k]) for k in end_indices))
        for end_indices in interface_ends
    ]
    # The boundary of a layer goes up the right side, along its upper interface, down the left side.
    edges = zip(
        [0, *(right for right, _ in interface_ends)],
        [len(corners), *(left_index for _, left_index in interface_ends)],
        strict=True,
    )
    for layer, (begin, end) in enumerate(edges):
        lower_lines = [-line for line in reversed(interface_lines[layer - 1])] if layer else []
        boundary_lines = lines[begin:end]
        if layer < len(interface_lines):
            right, left_index = interface_ends[layer]
            boundary_lines = [*lines[begin:right], *interface_lines[layer], *lines[left_index:end]]
        geo.addPlaneSurface([geo.addCurveLoop([*lower_lines, *boundary_lines])])
    geo.synchronize()


def _draw_side(
    geo: Gmsh, side: Side, start: int, end: int, points: Mapping[tuple[float, ...], int]
) -> int:
    """Draw a part of a side between two points as a line or as an arc of a circle or ellipse."""
    if not side.center:
        return int(geo.addLine(start, end))
    center = points[_round_point(side.center)]
    if side.stretch == 1.0:
        return int(geo.addCircleArc(start, center, end))
    # Gmsh needs an end of the major axis of the ellipse.
    (x, y) = side.center
    vertical = side.radius * side.stretch
    is_tall = side.stretch > 1
    major = (x, y + vertical) if is_tall else (x + side.radius, y)
    return int(geo.addEllipseArc(start, center, points[_round_point(major)], end))


Corner = tuple[tuple[float, ...], int]  # Position of a point, and its tag in gmsh.


def _draw_interface(geo: Gmsh, domain: ModelDomain, right: Corner, left: Corner) -> list[int]:
    """Draw an interface from right to left: a straight line, or arcs of up to a quarter circle."""
    (start, start_tag) = right
    (end, end_tag) = left
    if domain.top_radius is None:
        return [geo.addLine(start_tag, end_tag)]
    radius = abs(end[1] + domain.top_radius)
    center = geo.addPoint(0.0, -domain.top_radius, 0.0)
    if start[1] >= -domain.top_radius:
        return [geo.addCircleArc(start_tag, center, end_tag)]
    equator = geo.addPoint(radius, -domain.top_radius, 0.0)
    return [
        geo.addCircleArc(start_tag, center, equator),
        geo.addCircleArc(equator, center, end_tag),
    ]


def _division_points(
    domain: ModelDomain, sizes: Sizes, side: Side
) -> list[tuple[tuple[float, ...], float | None]]:
    """Return the points that divide a side of a two-dimensional domain, beginning with its start.

    The top is divided at the tip's axis and at the edge of a punch, any other straight side at its
    crossings with interfaces of layers. Each point is paired with the level of its interface, or
    with None if it is on no interface.
    """
    if side.surface == "top":
        arc = domain.top_arc
        positions = reversed(_top_split_points(domain, sizes, side.end[0], side.start[0]))
        points = [
            (x, -_sagitta(arc.radius, x) * arc.stretch if arc else side.start[1]) for x in positions
        ]
        return [(side.start, None), *((point, None) for point in points)]
    return [(side.start, None), *(domain.interface_crossings(side) if side.center is None else ())]


def _sagitta(radius: float, x: float) -> float:
    """Return the depth of a circle below its highest point at the horizontal distance x."""
    return float(x * x / (radius + np.sqrt(radius * radius - x * x)))


def _top_split_points(domain: ModelDomain, sizes: Sizes, x0: float, x1: float) -> list[float]:
    """Return the points at which the top edge is split, from left to right.

    The distance of each point from corners and axis is at least ten random shifts of gmsh.
    """
    # gmsh aborts if its random shift makes points change places, which was seen up to distances of
    # 4 shifts.
    min_split_shifts = 10.0
    min_distance = min_split_shifts * point_shift(domain, sizes) * domain.max_extent
    positions = [round(x0, LENGTH_DIGITS), round(x1, LENGTH_DIGITS)]
    for offset in (
        (0.0,) if sizes.punch_edge is None else (0.0, -sizes.punch_edge, sizes.punch_edge)
    ):
        x = round(sizes.axis[0] + offset, LENGTH_DIGITS)
        if positions[0] < x < positions[1] and all(
            abs(x - position) > min_distance for position in positions
        ):
            positions.append(x)
    return sorted(positions[2:])


def draw_box(gmsh: Gmsh, domain: ModelDomain, sizes: Sizes) -> None:
    """Draw a box whose top is split along a punch's edge.

    If elements crossed the edge, the punch would be effectively smaller.
    """
    (x0, x1), (y0, y1), (z0, z1) = map(_round_point, domain.extent)
    occ = gmsh.model.occ
    levels = (z0, *(round(z, LENGTH_DIGITS) for z in domain.interfaces), z1)
    layers = [
        (3, occ.addBox(x0, y0, low, x1 - x0, y1 - y0, high - low)) for low, high in pairwise(levels)
    ]
    tools = layers[:-1]
    if sizes.punch_edge is not None:
        radius = round(sizes.punch_edge, LENGTH_DIGITS)
        disk = occ.addDisk(*sizes.axis, z1, radius, radius)
        if sizes.edge_tilt:
            tilt, towards = np.radians(sizes.edge_tilt)
            middle = (*sizes.axis, z1)
            occ.dilate([(2, disk)], *middle, np.cos(tilt), 1.0, 1.0)
            occ.rotate([(2, disk)], *middle, 0.0, 0.0, 1.0, towards)
        disks, _ = occ.intersect([(2, disk)], layers[-1:], removeTool=False)
        tools = [*tools, *disks]
    if tools:
        occ.fragment(layers[-1:], tools)
    occ.synchronize()


def draw_extruded(gmsh: Gmsh, domain: ModelDomain, sizes: Sizes) -> None:
    """Draw the outline with its arcs on the base and extrude it to the top, layer by layer."""
    geo = _cad_kernel(gmsh, domain)
    base = -round(domain.height, LENGTH_DIGITS)
    arc_centers = [side.center for side in domain.outline if side.center]
    outline_points = [*arc_centers, *(side.start for side in domain.outline)]
    points = {
        point: geo.addPoint(*point, base)
        for point in dict.fromkeys(map(_round_point, outline_points))
    }

    def line(side: Side) -> int:
        """Add a side of the outline as a line or an arc."""
        ends = points[_round_point(side.start)], points[_round_point(side.end)]
        return (
            geo.addCircleArc(ends[0], points[_round_point(side.center)], ends[1])
            if side.center
            else geo.addLine(*ends)
        )

    section = (2, geo.addPlaneSurface([geo.addCurveLoop([line(side) for side in domain.outline])]))
    for low, high in pairwise((base, *(round(z, LENGTH_DIGITS) for z in domain.interfaces), 0.0)):
        section = geo.extrude([section], 0.0, 0.0, high - low)[0]
    geo.synchronize()


def _round_point(point: tuple[float, ...]) -> tuple[float, ...]:
    """Round the coordinates of a point to LENGTH_DIGITS digits."""
    return tuple(round(x, LENGTH_DIGITS) for x in point)


def prescribe_sizes(gmsh: Gmsh, sizes: Sizes, dim: int) -> None:
    """Set the element size to the minimum of fields for contact, inclusions, coatings and faces.

    Separate fields are used because every minimum would double the length of a single formula.
    """
    field = gmsh.model.mesh.field
    tags = []
    inclusion_formulas = [inclusion_formula(*size, sizes.grading, dim) for size in sizes.inclusions]
    coating_formulas = [coating_formula(*size, sizes.grading) for size in sizes.coatings]
    face_formulas = [
        drained_face_formula(face, sizes.axis[0], sizes.grading) for face in sizes.drained_faces
    ]
    for formula in (
        size_formula(sizes, dim),
        *inclusion_formulas,
        *coating_formulas,
        *face_formulas,
    ):
        tags.append(field.add("MathEval"))
        field.setString(tags[-1], "F", formula)
    minimum_field = tags[0] if len(tags) == 1 else field.add("Min")
    if len(tags) > 1:
        field.setNumbers(minimum_field, "FieldsList", tags)
    field.setAsBackgroundMesh(minimum_field)


def point_shift(domain: ModelDomain, sizes: Sizes) -> float:
    """Return gmsh's random shift of points, relative to the longest side of the body.

    Larger shifts invert cells or make gmsh abort.
    """
    # gmsh's default of 1e-9 keeps any four points from lying on a circle.
    return min(1e-9, 1e-4 * sizes.min_size / domain.max_extent)
