"""Fields on the deformed body, in the vertical plane through the tip's axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.field_reader import read_fields
from indent_sim.results.pictures.axes import (
    Axis,
    horizontal_axis_name,
    plan_choice,
    scaled_axis,
    tip_axis_position,
)
from indent_sim.results.pictures.figures import (
    GREY,
    Axes,
    BarPosition,
    draw_colour_bar,
    draw_panel_title,
)
from indent_sim.results.pictures.pressure import panel_title
from indent_sim.results.pictures.profile import draw_tip, tip_lift
from indent_sim.results.reader import Results
from indent_sim.results.result_scene import scene_of

# Points, deformed points, cells, and values at the points.
RegionPart = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class FieldQuantity:
    """Quantity that can be drawn on the body.

    Attributes
    ----------
    name
        Name of the quantity, in which {r} and {t} are replaced by the first two axes: r and theta
        of an axisymmetric body, otherwise x and y.
    kind
        Kind of quantity, which determines the unit; "1" for a dimensionless number.
    values
        Function from the arrays of a step to values at points or cells.
    neutral_value
        Value shown in white by a diverging colour map, for a field with both signs; None for other
        fields.
    lowest_value
        Lower end of the colour range of a field without `neutral_value`; None for the smallest
        value of the field.
    is_odd
        True if the mirror image in a plane x = const has the opposite sign.
    available_for
        Bodies that have the field.
    """

    name: str
    kind: str
    values: Callable[[dict[str, np.ndarray]], np.ndarray]
    neutral_value: float | None = None
    lowest_value: float | None = 0.0
    is_odd: bool = False
    available_for: str = "every body"


POROUS_BODIES = "bodies with fluid in their pores (material.flow)"
METALS = "bodies that yield (material.plasticity)"
GELS = "gels (material.model: gel)"
FIELDS = {
    "von_mises": FieldQuantity("von Mises stress", "pressure", lambda f: f["von_mises"]),
    "principal_1": FieldQuantity(
        "principal stress σ₁", "pressure", lambda f: f["principal_stresses"][:, 0], 0.0
    ),
    "principal_2": FieldQuantity(
        "principal stress σ₂", "pressure", lambda f: f["principal_stresses"][:, 1], 0.0
    ),
    "principal_3": FieldQuantity(
        "principal stress σ₃", "pressure", lambda f: f["principal_stresses"][:, 2], 0.0
    ),
    "sigma_xx": FieldQuantity(
        r"stress $\sigma_{{{r}{r}}}$", "pressure", lambda f: f["stress"][:, 0], 0.0
    ),
    "sigma_yy": FieldQuantity(
        r"stress $\sigma_{{{t}{t}}}$", "pressure", lambda f: f["stress"][:, 4], 0.0
    ),
    "sigma_zz": FieldQuantity(
        r"stress $\sigma_{{zz}}$", "pressure", lambda f: f["stress"][:, 8], 0.0
    ),
    "sigma_xz": FieldQuantity(
        r"stress $\sigma_{{{r}z}}$", "pressure", lambda f: f["stress"][:, 2], 0.0, is_odd=True
    ),
    "J": FieldQuantity("volume ratio J", "1", lambda f: f["J"], 1.0),
    "energy_density": FieldQuantity("energy density ψ", "pressure", lambda f: f["energy_density"]),
    "displacement": FieldQuantity(
        "displacement |u|", "length", lambda f: np.linalg.norm(f["displacement"], axis=1)
    ),
    "pore_pressure": FieldQuantity(
        "pore pressure p",
        "pressure",
        lambda f: f["pore_pressure"],
        0.0,
        available_for=POROUS_BODIES,
    ),
    "fluid_content": FieldQuantity(
        "fluid content ζ", "1", lambda f: f["fluid_content"], 0.0, available_for=POROUS_BODIES
    ),
    "plastic_strain": FieldQuantity(
        "equivalent plastic strain α", "1", lambda f: f["plastic_strain"], available_for=METALS
    ),
    "swelling": FieldQuantity(
        "swelling ratio J", "1", lambda f: f["swelling"], lowest_value=None, available_for=GELS
    ),
}


@dataclass(frozen=True)
class Section:
    """Section of the deformed body with the values of a field.

    Attributes
    ----------
    points
        Points (n, 2) [length].
    triangles
        Numbers of the points of each triangle (m, 3).
    values
        Values of the field at the points (n,).
    interfaces
        Pairs (k, 2) of point numbers: lines between two regions (layers, coatings, inclusions).
    """

    points: np.ndarray
    triangles: np.ndarray
    values: np.ndarray
    interfaces: np.ndarray

    def mirror(self, middle: float, sign: float) -> Section:
        """Return the section with its mirror image in the vertical line x = middle.

        The values of the image are multiplied by `sign`.
        """
        image = np.column_stack([2 * middle - self.points[:, 0], self.points[:, 1]])
        triangles = np.concatenate([self.triangles, self.triangles[:, ::-1] + len(image)])
        faces = np.concatenate([self.interfaces, self.interfaces + len(image)])
        values = np.concatenate([self.values, sign * self.values])
        return Section(np.concatenate([self.points, image]), triangles, values, faces)

    @cached_property
    def areas(self) -> np.ndarray:
        """Areas of the triangles (m,) [length^2]."""
        sides = self.points[self.triangles[:, 1:]] - self.points[self.triangles[:, :1]]
        return np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2

    def is_sliver(self, min_height: float) -> np.ndarray:
        """Return a mask (m,) of the triangles with a height below `min_height` [length].

        Matplotlib would draw shaded colours beyond the sides of such a triangle.
        """
        corners = self.points[self.triangles]
        longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
        return 2 * self.areas <= min_height * longest

    def values_in_frame(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the values and the areas of the points in a frame (left, right, bottom, top).

        The area of a point is a third of the area of its triangles.
        """
        x, z = self.points.T
        is_inside = (frame[0] <= x) & (x <= frame[1]) & (frame[2] <= z) & (z <= frame[3])
        area = np.bincount(self.triangles.ravel(), np.repeat(self.areas / 3, 3), len(self.points))
        return self.values[is_inside], area[is_inside]


def find_field(name: str) -> FieldQuantity:
    """Return a field by its name; raise UsageError if there is none."""
    if name not in FIELDS:
        raise UsageError(f"there is no field {name}; choose among {', '.join(FIELDS)}")
    return FIELDS[name]


def deformed_section(results: Results, step: float, field: FieldQuantity) -> Section:
    """Return the deformed section of a step in the plane through the tip's axis.

    If half of the section is modelled, it is completed by its mirror image.

    Raises
    ------
    UsageError
        If the result does not have the field.
    """
    fields = read_fields(results.path, int(step))
    try:
        values = field.values(fields)
    except KeyError as missing:
        raise UsageError(
            f"{results.path} has no field {missing.args[0]}",
            f"this field exists only for {field.available_for}",
        ) from None
    parts = [
        _region_part(fields, values, fields["region"] == region)
        for region in np.unique(fields["region"])
    ]
    center = np.array([*results.report.get("center", [0.0]), 0.0][:2]) + results.slide_at(step)
    if fields["cells"].shape[1] == 4:
        y = fields["points"][:, 1]
        inside = np.clip(center[1], y.min() + 1e-6 * np.ptp(y), y.max() - 1e-6 * np.ptp(y))
        parts = [_cut_tetrahedra(*part, inside) for part in parts]
    starts = np.cumsum([0, *(len(moved) for _, moved, *_ in parts[:-1])])
    triangles = np.concatenate(
        [cells + start for (_, _, cells, _), start in zip(parts, starts, strict=True)]
    )
    points = np.concatenate([part[1] for part in parts])
    shown = np.concatenate([part[3] for part in parts])
    regions = np.repeat(np.arange(len(parts)), [len(cells) for _, _, cells, _ in parts])
    section = Section(
        points[:, [0, 2]], triangles, shown, _region_interfaces(points, triangles, regions)
    )
    x = fields["points"][:, 0]
    begins_at_axis = x.min() >= center[0] - 1e-9 * np.ptp(x)
    is_half = plan_choice(results.report, "symmetry") != "full" and begins_at_axis
    # The component rz refers to its own r on both sides of the axis of an axisymmetric body.
    is_odd = field.is_odd and horizontal_axis_name(results) == "x"
    if not is_half:
        return section
    return section.mirror(center[0], -1.0 if is_odd else 1.0)


def _region_interfaces(
    points: np.ndarray, triangles: np.ndarray, regions: np.ndarray
) -> np.ndarray:
    """Return the edges (k, 2) at which triangles of two regions meet.

    Each region has separate points, so that edges of two regions are matched by position.
    """
    _, first, point_indices = np.unique(points, axis=0, return_index=True, return_inverse=True)
    edges = np.sort(point_indices.ravel()[triangles][:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(
        -1, 2
    )
    distinct_edges, edge_indices = np.unique(edges, axis=0, return_inverse=True)
    low = np.full(len(distinct_edges), regions.max())
    high = np.zeros(len(distinct_edges), dtype=regions.dtype)
    np.minimum.at(low, edge_indices.ravel(), np.repeat(regions, 3))
    np.maximum.at(high, edge_indices.ravel(), np.repeat(regions, 3))
    return np.asarray(first[distinct_edges[low < high]])


def _region_part(
    fields: dict[str, np.ndarray], values: np.ndarray, is_in_region: np.ndarray
) -> RegionPart:
    """Return the mesh and the field of one region; the field may jump at its boundary.

    Values of cells are averaged to the vertices, weighted by volume.
    """
    vertices, cells = np.unique(fields["cells"][is_in_region], return_inverse=True)
    cells = cells.reshape(-1, fields["cells"].shape[1])
    points = fields["points"][vertices]
    is_nodal = len(values) == len(fields["points"]) and len(values) != len(fields["cells"])
    nodal = values[vertices] if is_nodal else _vertex_means(points, cells, values[is_in_region])
    return points, points + fields["displacement"][vertices], cells, nodal


def _vertex_means(points: np.ndarray, cells: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the volume-weighted mean of the values of the cells around each vertex (n,)."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    weights = np.sqrt(np.abs(np.linalg.det(edges @ np.swapaxes(edges, 1, 2))))
    corners = cells.shape[1]
    total = np.bincount(cells.ravel(), np.repeat(weights * values, corners), len(points))
    return total / np.bincount(cells.ravel(), np.repeat(weights, corners), len(points))


def _cut_tetrahedra(
    points: np.ndarray, moved: np.ndarray, cells: np.ndarray, values: np.ndarray, y: float
) -> RegionPart:
    """Return the triangles in which a plane y = const of the undeformed body cuts tetrahedra."""
    distance = points[:, 1] - y
    count = (distance[cells] > 0).sum(axis=1)
    # The vertices of each tetrahedron are ordered from the front of the plane to its back.
    order = np.take_along_axis(cells, np.argsort(-distance[cells], axis=1), axis=1)
    corners = {1: [(0, 1), (0, 2), (0, 3)], 3: [(0, 3), (1, 3), (2, 3)]}
    pairs = [order[count == n][:, np.array(edges)] for n, edges in corners.items()]
    quads = order[count == 2]
    pairs += [
        quads[:, np.array(edges)] for edges in ([(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)])
    ]
    ends = np.concatenate(pairs).reshape(-1, 2)
    fraction = (distance[ends[:, 0]] / (distance[ends[:, 0]] - distance[ends[:, 1]]))[:, None]
    columns = np.column_stack([points, moved, values])
    cut_points = (1 - fraction) * columns[ends[:, 0]] + fraction * columns[ends[:, 1]]
    return (
        cut_points[:, :3],
        cut_points[:, 3:6],
        np.arange(len(cut_points)).reshape(-1, 3),
        cut_points[:, 6],
    )


@dataclass(frozen=True)
class FieldRow:
    """Maps of one field for several results or steps, side by side with the same view and colours.

    Attributes
    ----------
    steps
        Result, step and label of each map.
    field
        The field.
    limits
        Ends of the colour range in the unit shown; None for the range of the values.
    zoom
        Half-width of the view around the tip in contact radii; infinite for the whole body, None
        for an automatic view.
    """

    steps: Sequence[tuple[Results, float, str]]
    field: FieldQuantity
    limits: tuple[float, float] | None = None
    zoom: float | None = None

    @cached_property
    def sections(self) -> list[Section]:
        """Deformed section of each map, moved to a common axis of the tips."""
        sections = []
        for results, step, _ in self.steps:
            section = deformed_section(results, step, self.field)
            slide = results.slide_at(step)
            offset = self.axis_position - tip_axis_position([results], 0, [slide])[0]
            sections.append(
                replace(section, points=section.points + np.array([offset, 0.0]))
                if offset
                else section
            )
        return sections

    @property
    def axis_position(self) -> float:
        """Position of the tips' axis in the maps [length]."""
        return self._axis_and_name[0]

    @property
    def _axis_and_name(self) -> tuple[float, str]:
        """Position of the tips' axis in the maps [length], and label of the horizontal axis."""
        slides = [results.slide_at(step) for results, step, _ in self.steps]
        return tip_axis_position([results for results, *_ in self.steps], 0, slides)

    @cached_property
    def frame(self) -> np.ndarray:
        """Limits (left, right, bottom, top) [length] of the axes.

        The limits enclose the surroundings of the contacts, or the whole body if it is small.
        """
        points = np.concatenate([section.points for section in self.sections])
        (left, bottom) = points.min(axis=0)
        (right, top) = points.max(axis=0)
        depths = [_row_value(run, step, "delta") for run, step, _ in self.steps]
        contact_radius = max(_row_value(run, step, "a") for run, step, _ in self.steps)
        size = max(contact_radius, *np.abs(depths))
        # If the depth is less than this fraction of the lift of the tip, there is no contact to
        # show.
        max_lift = 0.01
        # A swelling body may lift the tip without a contact that could be shown.
        if not contact_radius > 0 and max(depths) <= max_lift * size:
            size = (top - bottom) / 2
        # Space for the tip above the surface, in contact radii or depths.
        space_above = 0.35
        if self.zoom is not None:
            half_width = self.zoom * size
            sides = (
                max(left, self.axis_position - half_width),
                min(right, self.axis_position + half_width),
            )
            return np.array([*sides, max(bottom, -half_width), top + space_above * size])
        # Half-width of the view of a thin body, in multiples of its height. In a wider view the
        # body would be too thin to see its field.
        thin_body_heights = 4.0
        # Half-width of the view around the tip, in contact radii or depths; the second number is
        # the smallest one for a thin body.
        field_view = 3.0
        thin_body_view = 1.5
        half_width = size * np.clip(
            thin_body_heights * (top - bottom) / size, thin_body_view, field_view
        )
        sides = (self.axis_position - half_width, self.axis_position + half_width)
        # A body that is up to this many times as wide or deep as the view is shown whole.
        whole_body_ratio = 1.6
        if right - left <= 2 * whole_body_ratio * half_width:
            sides = (left, right)
        return np.array(
            [
                *sides,
                bottom if -bottom <= whole_body_ratio * half_width else -half_width,
                top + space_above * size,
            ]
        )

    @property
    def aspect(self) -> float:
        """Ratio of the height of the view to its width."""
        return float(np.ptp(self.frame[2:]) / np.ptp(self.frame[:2]))

    def _frame_of_aspect(self, aspect: float) -> np.ndarray:
        """Return the view at a larger aspect ratio, extended downwards first, then upwards.

        Downwards it is extended at most to the bottom of the body.
        """
        left, right, bottom, top = self.frame
        missing_height = aspect * (right - left) - (top - bottom)
        if missing_height <= 0:
            return self.frame
        lowest = min(float(section.points[:, 1].min()) for section in self.sections)
        height_below = min(missing_height, max(bottom - lowest, 0.0))
        return np.array([left, right, bottom - height_below, top + missing_height - height_below])

    def draw(
        self,
        panels: Sequence[Axes],
        some: slice = slice(None),
        where: BarPosition = "right",
        aspect: float = 0.0,
    ) -> None:
        """Draw some of the maps with one colour bar.

        Parameters
        ----------
        panels
            The panel of each map.
        some
            The maps to be drawn.
        where
            Position of the colour bar.
        aspect
            Ratio of height to width of the panels, if they are higher than the view.
        """
        runs = [run for run, *_ in self.steps]
        frame = self._frame_of_aspect(aspect)
        length = scaled_axis("length", runs, np.ptp(frame[:2]) / 2, self._axis_and_name[1])
        inside, areas = map(
            np.concatenate,
            zip(*(section.values_in_frame(self.frame) for section in self.sections), strict=True),
        )
        if not inside.size:
            raise UsageError(
                "no point of the mesh is in view; widen it by a larger --zoom, its half width in "
                "contact radii"
            )
        first = horizontal_axis_name(runs[0])
        kind = self.field.kind
        name = self.field.name.format(r=first, t={"r": r"\theta", "x": "y"}[first])
        axis = Axis(name) if kind == "1" else scaled_axis(kind, runs, inside, name)
        low, high, colours = _colour_range(axis(inside), areas, self.field)
        low, high = self.limits or (low, high)
        # Height of a sliver relative to the width of the view: about half a pixel.
        relative_height = 2e-3
        for axes, (run, step, words), section in zip(
            panels, self.steps[some], self.sections[some], strict=True
        ):
            look = {"vmin": low, "vmax": high, "cmap": colours, "rasterized": True}
            colour_mesh = _draw_section(
                axes, section, length, axis, relative_height * np.ptp(frame[:2]), look
            )
            if (scene := scene_of(run.path)) is not None:
                draw_tip(
                    axes,
                    scene,
                    _row_value(run, step, "delta"),
                    self.axis_position,
                    float(np.ptp(frame[:2])),
                    length,
                    tip_lift(run, step, scene),
                )
            axes.set(aspect="equal", xlim=length(frame[:2]), ylim=length(frame[2:]))
            draw_panel_title(axes, panel_title(run, step, words, apart="\n"))
            axes.set(xlabel=length.label, ylabel=Axis("z", unit=length.unit).label)
        is_clipped = [axis(inside).min() < low, axis(inside).max() > high]
        beyond = {(False, True): "max", (True, False): "min", (True, True): "both"}.get(
            tuple(is_clipped), "neither"
        )
        draw_colour_bar(panels, colour_mesh, axis.label, where, extend=beyond)


def _draw_section(
    axes: Axes,
    section: Section,
    length: Axis,
    axis: Axis,
    sliver_height: float,
    look: dict[str, Any],
) -> Any:
    """Draw the triangles of a section in shaded colours, and very flat triangles in one colour.

    Returns the collection from which a colour bar is made.
    """
    x, z = length(section.points).T
    values = axis(section.values)
    is_sliver = section.is_sliver(sliver_height)
    if is_sliver.any():
        slivers = section.triangles[is_sliver]
        axes.tripcolor(
            x,
            z,
            slivers,
            facecolors=values[slivers].mean(axis=1),
            edgecolors="face",
            lw=0.3,
            **look,
        )
    if len(section.interfaces):
        lines = np.pad(
            length(section.points[section.interfaces]),
            ((0, 0), (0, 1), (0, 0)),
            constant_values=np.nan,
        )
        # Width of lines between regions [points].
        interface_line_width = 0.6
        axes.plot(*lines.reshape(-1, 2).T, color=GREY, lw=interface_line_width)
    return axes.tripcolor(x, z, section.triangles[~is_sliver], values, shading="gouraud", **look)


def _row_value(results: Results, step: float, column: str) -> float:
    """Return the value of a column at a step."""
    return float(results[column][results["step"] == step][0])


def _colour_range(
    values: np.ndarray, areas: np.ndarray, field: FieldQuantity
) -> tuple[float, float, Any]:
    """Return the colour limits and the colour map of a field.

    The range begins at the lowest value, or is symmetric about the neutral value. Nearly
    all of the area is inside it.
    """
    middle = field.neutral_value
    if middle is not None:
        base_value = middle
    elif field.lowest_value is not None:
        base_value = field.lowest_value
    else:
        base_value = float(values.min())
    deviations = np.abs(values - base_value)
    order = np.argsort(deviations)
    covered_area = np.cumsum(areas[order])
    # The colours cover this percentage of the area in view: the stress at an edge is infinite, and
    # the mesh has many points there.
    coloured_percent = 99.8
    high = (
        float(
            deviations[
                order[np.searchsorted(covered_area, coloured_percent / 100 * covered_area[-1])]
            ]
        )
        or 1.0
    )
    return (
        (base_value, base_value + high, "viridis")
        if middle is None
        else (base_value - high, base_value + high, "RdBu_r")
    )
