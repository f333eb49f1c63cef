"""Pictures with the panels, steps, fields, sizes and units that a user requests."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.field_reader import steps_with_fields
from indent_sim.results.pictures import curves, figures, history
from indent_sim.results.pictures.axes import BASE_UNITS, SHOWN_UNITS
from indent_sim.results.pictures.fields import FieldRow, find_field
from indent_sim.results.pictures.figures import Axes, Figure, SubFigure
from indent_sim.results.pictures.forces import draw_forces, draw_overlay, sort_and_name
from indent_sim.results.pictures.pressure import (
    PressureMaps,
    contact_surface,
    draw_pressures,
    largest_force_step,
    panel_title,
    surface_on_axis,
)
from indent_sim.results.pictures.profile import draw_profiles
from indent_sim.results.pictures.unloading import draw_hardness, imprint_step
from indent_sim.results.reader import Results

PANEL_KINDS = (
    "force",
    "time",
    "hardness",
    "pressure",
    "pressure_x",
    "pressure_y",
    "profile",
    "fields",
    "film",
)
STEP_PANELS = ("pressure", "pressure_x", "pressure_y", "profile", "fields", "film")
# pressure_x and pressure_y are curves along x and y through the tip's axis.
PRESSURE_PANELS = ("pressure", "pressure_x", "pressure_y")
MAP_PANELS = ("fields", "film")  # A film shows states of a field spread over the load path.
# Entries of a request, their options, and the panels that use them.
PANEL_OPTIONS = {
    "fields": ("--field", MAP_PANELS),
    "limits": ("--limits", (*PRESSURE_PANELS, *MAP_PANELS)),
    "zoom": ("--zoom", MAP_PANELS),
}
MM = 1 / figures.MM_PER_INCH  # One millimetre in inches.
MAX_LINE_COLUMNS = 3
MAX_PANELS = 40
T = TypeVar("T")
# Smallest widths of panels at the standard font size [inches]. In a narrower panel the vertical
# axis would be shorter than its name. Several maps in a row have one colour bar to the right of
# them.
MIN_PANEL_WIDTH = 2.6
MIN_MAP_WIDTH = 1.8
LabelledStep = tuple[Results, float, str]  # Result, step, and label.


@dataclass(frozen=True)
class PlotRequest:
    """Requested content and form of a picture.

    Attributes
    ----------
    what
        Kinds of panels, each one of PANEL_KINDS.
    fields
        Names of the fields in maps.
    steps
        Numbers of steps, "last" or "all"; empty for the step of the largest force.
    width
        Width of the picture [mm]; None for a width that depends on the number of panels.
    font
        Font size [points].
    units
        Units of the numbers shown, by kind.
    layout
        Rows and columns of all panels; None for as many columns as fit.
    letters
        "a" puts (a), (b), ... before the titles of the panels.
    dpi
        Resolution of rasterized parts.
    limits
        Ends of the colour range of maps and of pressure axes, in the unit shown.
    zoom
        Half-width of the view of fields around the tip, in contact radii; infinite for the whole
        body.
    """

    what: tuple[str, ...]
    fields: tuple[str, ...] = ("von_mises",)
    steps: tuple[str, ...] = ()
    width: float | None = None
    font: float = figures.FONT_SIZE
    units: Mapping[str, str] = field(default_factory=dict)
    layout: tuple[int, int] | None = None
    letters: Literal["", "a"] = ""
    dpi: float | None = None
    limits: tuple[float, float] | None = None
    zoom: float | None = None

    def max_columns(self, narrowest: float, most: int) -> int:
        """Return how many panels fit side by side.

        Parameters
        ----------
        narrowest
            Smallest width of a panel [inches] at the standard font size.
        most
            Largest number of panels.
        """
        columns = self.width * MM / (narrowest * self.font_scale) if self.width else most
        return int(np.clip(columns, 1, most))

    @property
    def font_scale(self) -> float:
        """Font size, relative to the standard one."""
        return self.font / figures.FONT_SIZE

    @property
    def file_name(self) -> str:
        """Default file name of the picture."""
        return f"{'_'.join(self.what)}.png"


def plot_request(options: Mapping[str, Any]) -> PlotRequest:
    """Return the request that corresponds to command-line options.

    Raises
    ------
    UsageError
        If an option has an unknown value or no effect.
    """
    request = PlotRequest(**{"what": ("force",), **options})
    if unknown := [word for word in request.what if word not in PANEL_KINDS]:
        raise UsageError(f"--what {unknown[0]} is not one of {', '.join(PANEL_KINDS)}")
    for name, (option, panel_kinds) in PANEL_OPTIONS.items():
        if name in options and not set(request.what) & set(panel_kinds):
            raise UsageError(f"{option} is only for --what {' or '.join(panel_kinds)}")
    if request.limits is not None and not request.limits[0] < request.limits[1]:
        low, high = request.limits
        raise UsageError(f"--limits {low:g}:{high:g}: the first must be below the second")
    if "steps" in options and not set(request.what) & set(STEP_PANELS):
        raise UsageError(
            f"--steps is only for --what {' or '.join(STEP_PANELS)}: "
            "the force is drawn at every step"
        )
    if invalid := [
        word for word in request.steps if not (word in ("last", "all") or word.isdecimal())
    ]:
        raise UsageError(f"--steps {invalid[0]}: expected step numbers, 'last' or 'all'")
    if invalid := [kind for kind in request.units if kind not in BASE_UNITS]:
        raise UsageError(f"--units {invalid[0]}: there are {', '.join(BASE_UNITS)}")
    for name in request.fields:
        find_field(name)
    return request


@dataclass(frozen=True)
class _Panel:
    """Panel of a picture.

    Attributes
    ----------
    draw
        Function that draws into axes with a given ratio of height to width.
    draw_in_own_figure
        Function that draws into axes of another program's figure.
    aspect
        Smallest ratio of height to width; None if every ratio is possible.
    """

    draw: Callable[[Axes, float], None]
    draw_in_own_figure: Callable[[Axes], None]
    aspect: float | None = None


@dataclass(frozen=True)
class _Row:
    """Panels of equal size, arranged in lines and columns.

    Attributes
    ----------
    lines, columns
        Numbers of lines and columns.
    aspect
        Ratio of height to width of the panels.
    min_panel_width
        Smallest width of a panel with its labels at the standard font size [inches].
    draw
        Function that draws the panels and returns their axes.
    """

    lines: int
    columns: int
    aspect: float
    min_panel_width: float
    draw: Callable[[SubFigure], Sequence[Axes]]


def draw(runs: Sequence[Results], request: PlotRequest, path: Path | str) -> None:
    """Draw a requested picture into a file.

    Raises
    ------
    UsageError
        If the file has no suffix of a picture, or for a reason of `requested_figure`.
    """
    figures.picture_format(Path(path))
    with requested_figure(runs, request) as figure:
        figures.save(figure, path, *([request.dpi] if request.dpi else []))


def draw_results(runs: Sequence[Results], path: Path | str) -> None:
    """Draw the default picture of results into a file.

    One time-dependent result is drawn as a history, several such results as force over time and
    over depth, and other results as force over depth.
    """
    if not all(history.is_time_stepped(run.report) for run in runs):
        draw_overlay(runs, path)
    elif len(runs) == 1:
        history.draw(runs[0], Path(path))
    else:
        draw(runs, PlotRequest(("time", "force")), path)


@contextmanager
def requested_figure(runs: Sequence[Results], request: PlotRequest) -> Iterator[Figure]:
    """Yield the figure of a request.

    Raises
    ------
    UsageError
        If the results do not have a requested step, field or panel.
    """
    if request.units:
        runs = [
            replace(run, report=run.report | {SHOWN_UNITS: dict(request.units)}) for run in runs
        ]
    runs, names = sort_and_name(runs) if len(runs) > 1 else (list(runs), [""])
    _refuse_too_many(runs, names, request)
    rows = (
        _requested_rows(runs, names, request)
        if request.layout
        else _automatic_rows(runs, names, request)
    )
    width = _picture_width(request, rows)
    # First estimate of the height of labels, numbers and colour bars around the panels of a line,
    # and of a line of a legend [inches]; the layout then finds the height that they need.
    height_of_labels = 1.6
    name_height = 0.2
    labels_height = height_of_labels + name_height * (len(runs) + len(request.what))
    heights = [
        row.lines * (row.aspect * width / row.columns + labels_height * request.font_scale)
        for row in rows
    ]
    with figures.new_figure((width, sum(heights)), request.font) as figure:
        grid = figure.add_gridspec(len(rows), 1, height_ratios=heights)
        parts = [figure.add_subfigure(place) for place in grid]
        row_axes = [row.draw(part) for row, part in zip(rows, parts, strict=True)]
        if request.letters:
            _letter_panels(figure)
        true_scale_axes = [axes for axes in figure.axes if axes.get_aspect() != "auto"]
        # The layout reserves no space for tick labels of axes that are smaller than their place in
        # the grid.
        for axes in true_scale_axes:
            axes.set_aspect("auto")
        # Each pass uses the heights and tick labels of the previous pass.
        passes = 3
        for _ in range(passes):
            figures.place_panels(figure)
            figures.thin_tick_labels(figure)
            heights = [
                _row_height(*row_part, figure.dpi)
                for row_part in zip(rows, parts, row_axes, strict=True)
            ]
            figure.set_size_inches(width, sum(heights))
            grid.set_height_ratios(heights)
        figures.apply_layout(figure)
        for axes in true_scale_axes:
            axes.set_aspect("equal")
        yield figure


def _picture_width(request: PlotRequest, rows: Sequence[_Row]) -> float:
    """Return the width of a picture [inches]; raise UsageError if it is too small for its text."""
    columns = max(row.columns for row in rows)
    min_width = request.font_scale * max(row.columns * row.min_panel_width for row in rows)
    if request.width is None:
        default_panel_width = 4.4
        return max(default_panel_width * min(MAX_LINE_COLUMNS, columns), min_width)
    width = request.width * MM
    if width < min_width:
        panels = "panels" if columns == 1 else f"{columns} panels side by side"
        fitting_font = math.floor(10 * request.font * width / min_width) / 10
        # The smallest font size that can be requested [points].
        smallest_font = 4.0
        smaller_font = f", or --font-size {fitting_font:g}" if fitting_font >= smallest_font else ""
        raise UsageError(
            f"{panels} with letters of {request.font:g} pt need --width "
            f"{math.ceil(min_width / MM)}{smaller_font}"
        )
    return width


def _row_height(row: _Row, part: SubFigure, panels: Sequence[Axes], dpi: float) -> float:
    """Return the height of a row [inches] that gives its panels their ratio of height to width."""
    part_width = part.bbox.width / dpi
    part_height = part.bbox.height / dpi
    panel = panels[0].get_position(original=True)
    return part_height + row.lines * (
        row.aspect * panel.width * part_width - panel.height * part_height
    )


def draw_into(axes: Axes, runs: Sequence[Results], request: PlotRequest) -> None:
    """Draw the only panel of a request into axes of another program's figure.

    The legend is drawn inside the axes.

    Raises
    ------
    UsageError
        If `requested_figure` would raise it, if there are several panels, or if options of a whole
        picture are given: width, font, layout or letters.
    """
    if (request.width, request.font, request.layout, request.letters) != (
        None,
        figures.FONT_SIZE,
        None,
        "",
    ):
        raise UsageError("width, font, layout and letters are determined by the figure of ax")
    if request.units:
        runs = [
            replace(run, report=run.report | {SHOWN_UNITS: dict(request.units)}) for run in runs
        ]
    runs, names = sort_and_name(runs) if len(runs) > 1 else (list(runs), [""])
    panels = _all_panels(runs, names, request)
    if len(panels) != 1:
        raise UsageError(
            f"ax is for one panel, but the request has {len(panels)}",
            "name one of --what, --field and --steps",
        )
    panels[0].draw_in_own_figure(axes)


def _all_panels(
    runs: Sequence[Results], names: Sequence[str], request: PlotRequest
) -> list[_Panel]:
    """Return all panels one by one, in the order of the request."""
    panels: list[_Panel] = []
    for panel_kind in request.what:
        panels += _line_panels(runs, names, request, panel_kind)
        for maps in _map_groups(runs, names, request, panel_kind):
            panels += [_map_panel(maps, i) for i in range(len(maps.steps))]
    return panels


def _refuse_too_many(runs: Sequence[Results], names: Sequence[str], request: PlotRequest) -> None:
    """Raise UsageError if a request makes more than MAX_PANELS panels.

    All kinds, fields and steps of all results are counted.
    """
    count = 0
    for panel_kind in request.what:
        if panel_kind in MAP_PANELS:
            count += len(request.fields) * len(_labelled_steps(runs, names, request, panel_kind))
        elif panel_kind == "pressure":
            maps = sum(
                np.ptp(run.surface["y"]) > 0
                for run, *_ in _labelled_steps(runs, names, request, panel_kind)
            )
            count += max(1, maps)
        else:
            count += 1
    if count > MAX_PANELS:
        problem = f"the request has {count} panels, but a picture can have at most {MAX_PANELS}"
        raise UsageError(problem, "name fewer --what, --field or --steps")


def _letter_panels(figure: Figure) -> None:
    """Write (a), (b), ... before the titles of the panels, in their order."""
    panels = [axes for axes in figure.axes if axes.axison and axes.get_label() != "<colorbar>"]
    for i, axes in enumerate(panels):
        title = axes.get_title(loc="left")
        letter = f"({chr(ord('a') + i % 26)})"
        axes.set_title(f"{letter} {title}".strip(), loc="left", fontsize="small", color=figures.INK)


def _automatic_rows(
    runs: Sequence[Results], names: Sequence[str], request: PlotRequest
) -> list[_Row]:
    """Return rows of single panels, then one row per group of several maps.

    The maps of a group share a colour bar.
    """
    single_panels: list[_Panel] = []
    map_rows: list[_Row] = []
    max_maps_in_row = 4
    max_film_columns = 6
    for panel_kind in request.what:
        single_panels += _line_panels(runs, names, request, panel_kind)
        for maps in _map_groups(runs, names, request, panel_kind):
            if len(maps.steps) == 1:
                single_panels.append(_map_panel(maps, 0))
            else:
                max_columns = request.max_columns(
                    MIN_MAP_WIDTH, max_film_columns if panel_kind == "film" else max_maps_in_row
                )
                map_rows.append(_map_row(maps, max_columns))
    max_columns = request.max_columns(MIN_PANEL_WIDTH, MAX_LINE_COLUMNS)
    columns = (
        2
        if len(single_panels) == 4 and max_columns > 2
        else min(max_columns, max(1, len(single_panels)))
    )
    return [_panel_row(part, columns) for part in _split_rows(single_panels, columns)] + map_rows


def _requested_rows(
    runs: Sequence[Results], names: Sequence[str], request: PlotRequest
) -> list[_Row]:
    """Return the panels in the requested rows and columns, in the order of the request."""
    assert request.layout is not None
    count, columns = request.layout
    if count * columns > MAX_PANELS:
        problem = f"--layout {count}x{columns} has {count * columns} panels"
        raise UsageError(problem, f"a picture has {MAX_PANELS} at most")
    panels = _all_panels(runs, names, request)
    if len(panels) > count * columns:
        raise UsageError(
            f"--layout {count}x{columns} has room for {count * columns} panels, but the "
            f"picture has {len(panels)}"
        )
    return [_panel_row(part, columns) for part in _split_rows(panels, columns)]


def _line_panels(
    runs: Sequence[Results], names: Sequence[str], request: PlotRequest, panel_kind: str
) -> list[_Panel]:
    """Return the panels of curves of one kind."""
    labels = names if len(runs) > 1 else ("this run",)
    if panel_kind == "force":
        theory = runs[0].report.get("theory") if len(runs) == 1 else None
        return [_line_panel(partial(draw_forces, runs=runs, theory=theory, names=labels))]
    if panel_kind == "time":
        return [_line_panel(partial(history.draw_over_time, runs=runs, names=labels))]
    if panel_kind == "hardness":
        return [_line_panel(partial(draw_hardness, runs=runs, names=labels))]
    if panel_kind == "profile":
        return [
            _line_panel(
                partial(
                    draw_profiles,
                    shown=_assign_colours(_labelled_steps(runs, names, request, panel_kind)),
                )
            )
        ]
    if panel_kind in PRESSURE_PANELS:
        return _pressure_panels(runs, names, request, panel_kind)
    return []


def _line_panel(draw: Callable[[Axes], None]) -> _Panel:
    """Return a panel of curves with its legend below."""

    def into(axes: Axes, aspect: float) -> None:
        draw(axes)
        figures.draw_legend_under(axes)

    def alone(axes: Axes) -> None:
        draw(axes)
        axes.legend()

    return _Panel(into, alone)


def _pressure_panels(
    runs: Sequence[Results], names: Sequence[str], request: PlotRequest, panel_kind: str
) -> list[_Panel]:
    """Return the panel of pressure curves: over the radius, or along a line through the tip's axis.

    The pressure of a body in 3D is drawn along x or y. If `panel_kind` names no axis, the pressure
    of such a body is left out here, because `_map_groups` draws it as a map.
    """
    along: Literal[0, 1] = 1 if panel_kind == "pressure_y" else 0
    curves_to_draw = []
    for run, step, name, colour in _assign_colours(
        _labelled_steps(runs, names, request, panel_kind)
    ):
        contact = contact_surface(run, step)
        has_two = np.ptp(contact.y) > 0
        if along == 1 and not has_two:
            raise UsageError(
                f"{run.path} has no y axis: --what pressure_y is for bodies in three dimensions"
            )
        if has_two and panel_kind == "pressure":
            continue  # The pressure of a surface in 3D is a map.
        curves_to_draw.append(
            (run, surface_on_axis(contact, along) if has_two else contact, name, colour)
        )
    return (
        [
            _line_panel(
                partial(draw_pressures, shown=curves_to_draw, limits=request.limits, along=along)
            )
        ]
        if curves_to_draw
        else []
    )


def _map_groups(
    runs: Sequence[Results], names: Sequence[str], request: PlotRequest, panel_kind: str
) -> Iterator[FieldRow | PressureMaps]:
    """Yield the maps of one kind, grouped by quantity."""
    if panel_kind == "pressure":
        labelled_steps = _labelled_steps(runs, names, request, panel_kind)
        if with_surface := [
            labelled_step
            for labelled_step in labelled_steps
            if np.ptp(labelled_step[0].surface["y"]) > 0
        ]:
            yield PressureMaps(with_surface, request.limits)
    elif panel_kind in MAP_PANELS:
        shown = _labelled_steps(runs, names, request, panel_kind)
        for name in request.fields:
            yield FieldRow(shown, find_field(name), request.limits, request.zoom)


def _map_panel(maps: FieldRow | PressureMaps, i: int) -> _Panel:
    """Return one map of a group as a panel with the group's colours and its own colour bar."""

    def into(axes: Axes, aspect: float) -> None:
        maps.draw([axes], slice(i, i + 1), "bottom", aspect)

    return _Panel(into, lambda axes: maps.draw([axes], slice(i, i + 1)), maps.aspect)


def _panel_row(panels: Sequence[_Panel], columns: int) -> _Row:
    """Return a row of panels of equal size, even if the row is not full."""
    # Ratio of height to width of panels of curves.
    line_aspect = 0.72
    aspect = max(
        (panel.aspect for panel in panels if panel.aspect is not None), default=line_aspect
    )

    def into(part: SubFigure) -> Sequence[Axes]:
        places = list(part.subplots(1, columns, squeeze=False)[0])
        for panel, axes in zip(panels, places[: len(panels)], strict=True):
            panel.draw(axes, aspect)
        for unused in places[len(panels) :]:
            unused.remove()
        return places[: len(panels)]

    return _Row(1, columns, aspect, MIN_PANEL_WIDTH, into)


def _map_row(maps: FieldRow | PressureMaps, max_columns: int) -> _Row:
    """Return the maps of a group with the same view and colours, in lines, with one colour bar."""
    lines = -(-len(maps.steps) // max_columns)
    columns = -(-len(maps.steps) // lines)

    def into(part: SubFigure) -> Sequence[Axes]:
        is_shared = isinstance(maps, FieldRow)  # Each pressure map is centred on its own tip.
        axes = part.subplots(
            lines, columns, squeeze=False, sharex=is_shared, sharey=is_shared
        ).ravel()
        for unused in axes[len(maps.steps) :]:
            unused.remove()
        used = list(axes[: len(maps.steps)])
        maps.draw(used)
        if is_shared:
            for panel in used:
                panel.label_outer()
        return used

    return _Row(lines, columns, maps.aspect, MIN_MAP_WIDTH, into)


def _split_rows(panels: Sequence[T], max_columns: int) -> list[Sequence[T]]:
    """Split panels into rows."""
    return [panels[begin : begin + max_columns] for begin in range(0, len(panels), max_columns)]


def _assign_colours(steps: Sequence[LabelledStep]) -> list[tuple[Results, float, str, Any]]:
    """Return result, step, title and colour of each curve.

    Steps of one result have colours from dark to light; different results have different hues.
    """
    count = len(steps)
    is_one_run = len({id(run) for run, *_ in steps}) == 1
    colours = [
        curves.map_colour(i, count)
        if is_one_run and count > 1
        else curves.line_style(i, count)["color"]
        for i in range(count)
    ]
    return [
        (*labelled_step[:2], panel_title(*labelled_step), colour)
        for labelled_step, colour in zip(steps, colours, strict=True)
    ]


def _labelled_steps(
    runs: Sequence[Results], names: Sequence[str], request: PlotRequest, panel_kind: str
) -> list[LabelledStep]:
    """Return result, step and name for every result and each of its requested steps.

    Raises UsageError if a step is missing or if there are too many steps.
    """
    steps = [
        (run, step, name)
        for run, name in zip(runs, names, strict=True)
        for step in _requested_steps(run, request, panel_kind)
    ]
    if len(steps) > MAX_PANELS:
        raise UsageError(
            f"{len(steps)} curves or panels of {panel_kind} are too many for one picture; name "
            "fewer --steps"
        )
    return steps


def _requested_steps(run: Results, request: PlotRequest, panel_kind: str) -> list[float]:
    """Return the steps of a result to be shown.

    They are the requested steps; for an animation, a selection of all steps; by default, the step
    of the largest force, and in a profile also the step of the imprint.
    """
    key = "fields" if panel_kind in MAP_PANELS else "surface"
    stored_steps = (
        steps_with_fields(run.path, run["step"]) if key == "fields" else run.surface.get("step", ())
    )
    available = sorted(set(map(int, stored_steps)))
    if not available:
        kept = "all" if panel_kind == "film" else "last or all"
        raise UsageError(f"{run.path} has no {key}; run it with --set output.{key}={kept}")
    if panel_kind == "film" and not request.steps:
        if len(available) < len(run):
            problem = (
                f"{run.path} has fields of {len(available)} of {len(run)} steps, "
                "but an animation (film) needs all"
            )
            raise UsageError(
                problem,
                "run the scene again with --set output.fields=all, or choose steps with --steps",
            )
        return [float(step) for step in history.film_steps(run, available)]
    requested = [available[-1] if word == "last" else word for word in request.steps]
    reduced_run = replace(run, surface={"step": np.array(available, dtype=float)})
    steps = (
        available
        if "all" in requested
        else [int(word) for word in requested]
        or [int(largest_force_step(reduced_run) or available[-1])]
    )
    imprint = imprint_step(run)
    if panel_kind == "profile" and not requested and imprint in available:
        steps = [*steps, int(imprint or 0)]
    if missing := [step for step in steps if step not in available]:
        available_text = ", ".join(map(str, available))
        problem = f"{run.path} has no {key} of step {missing[0]}, only of {available_text}"
        raise UsageError(f"{problem}; run with --set output.{key}=all to keep every step")
    return [float(step) for step in steps]
