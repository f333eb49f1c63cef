"""Pictures on request: which panels, of which steps and fields, how wide and in which units."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import canvas, curves, history
from indent_sim.results.pictures.axes import BASE_UNITS, SHOWN_UNITS
from indent_sim.results.pictures.canvas import Axes, Figure, SubFigure
from indent_sim.results.pictures.fields import FieldRow, field_of
from indent_sim.results.pictures.forces import draw_forces, named_apart, overlay
from indent_sim.results.pictures.pressure import (
    PressureMaps,
    contact_of,
    draw_pressures,
    on_axis,
    strongest_step,
    titled,
)
from indent_sim.results.pictures.profile import draw_profiles
from indent_sim.results.reader import Results
from indent_sim.results.xdmf import kept_steps

WHAT = ("force", "time", "pressure", "pressure_x", "pressure_y", "profile", "fields", "film")
OF_STEPS = ("pressure", "pressure_x", "pressure_y", "profile", "fields", "film")
PRESSED = ("pressure", "pressure_x", "pressure_y")  # _x, _y: along these axes through the tip's
MAPPED = ("fields", "film")  # film: states of a field spread over the path
# Entries of a wish, their options, and the panels that heed them
OF_PANELS = {
    "fields": ("--field", MAPPED),
    "limits": ("--limits", (*PRESSED, *MAPPED)),
    "zoom": ("--zoom", MAPPED),
}
MM = 1 / 25.4  # inches
PANEL_WIDTH = 4.4  # inches: width of a panel where no width is asked for
LINE_ASPECT = 0.72  # height over width of panels of curves
# inches: around the panels of a line for words, numbers and bars, before the layout says how much
# they take
WORDS = 1.6
FITTINGS = 2  # the second time the layout knows how high the panels are
MOST_IN_ROW = 4
MOST_IN_FILM = 6
MOST_WIDE = 3
MOST_PANELS = 40
T = TypeVar("T")
NARROWEST_CELL = 1.5  # inches: a panel of a layout at the standard font size
# inches: panels at the standard font size
NARROWEST_LINES = 2.6
NARROWEST_MAPS = 1.8
Shown = tuple[Results, float, str]  # a result, a step, and what tells them from the others in words


@dataclass(frozen=True)
class Wish:
    """What a picture shall show. steps: numbers, last or all; "": the step of the largest force;
    width [mm].
    """

    what: tuple[str, ...]
    fields: tuple[str, ...] = ("von_mises",)
    steps: tuple[str, ...] = ()
    width: float | None = None
    font: float = canvas.FONT
    units: Mapping[str, str] = field(default_factory=dict)
    layout: tuple[int, int] | None = None  # rows and columns of all panels; None: as they have room
    letters: Literal["", "a"] = ""  # before the panels: none, or (a), (b), ...
    dpi: float | None = None  # of what is drawn point by point
    limits: tuple[float, float] | None = (
        None  # of the colours of maps and of pressures, in the unit shown
    )
    zoom: float | None = (
        None  # contact radii around the tip that fields show; infinite: the whole body
    )

    def side_by_side(self, narrowest: float, most: int) -> int:
        """How many panels stand side by side, none narrower than so many inches at the standard
        font size.
        """
        room = self.width * MM / (narrowest * self.font / canvas.FONT) if self.width else most
        return int(np.clip(room, 1, most))

    @property
    def name(self) -> str:
        """The file of a picture that nobody named."""
        return f"{'_'.join(self.what)}.png"


def wish(given: Mapping[str, Any]) -> Wish:
    """The wish of some options; UsageError for words that are none, and for options that would have
    no effect.
    """
    found = Wish(**{"what": ("force",), **given})
    if unknown := [word for word in found.what if word not in WHAT]:
        raise UsageError(f"--what {unknown[0]} is none of {', '.join(WHAT)}")
    for name, (option, heeding) in OF_PANELS.items():
        if name in given and not set(found.what) & set(heeding):
            raise UsageError(f"{option} belongs to --what {' or '.join(heeding)}")
    if found.limits is not None and not found.limits[0] < found.limits[1]:
        raise UsageError(
            f"--limits {found.limits[0]:g}:{found.limits[1]:g}: the first must be below the second"
        )
    if "steps" in given and not set(found.what) & set(OF_STEPS):
        raise UsageError(
            f"--steps belongs to --what {' or '.join(OF_STEPS)}: the force is drawn at every step"
        )
    if wrong := [word for word in found.steps if not (word in ("last", "all") or word.isdecimal())]:
        raise UsageError(f"--steps {wrong[0]} is neither a step nor last nor all")
    if wrong := [kind for kind in found.units if kind not in BASE_UNITS]:
        raise UsageError(f"--units {wrong[0]}: there are {', '.join(BASE_UNITS)}")
    for name in found.fields:
        field_of(name)
    return found


@dataclass(frozen=True)
class _Panel:
    """One panel.

    draw: draws into it, when it is told its height over its width; draw_alone: the same in a figure
    of somebody else; aspect: what the height over the width is at least, None where any will do.
    """

    draw: Callable[[Axes, float], None]
    draw_alone: Callable[[Axes], None]
    aspect: float | None = None


@dataclass(frozen=True)
class _Row:
    """Panels of one size in so many lines and columns: their height over their width, and what
    draws them.
    """

    lines: int
    columns: int
    aspect: float
    draw: Callable[[SubFigure], Sequence[Axes]]


def draw(runs: Sequence[Results], wish: Wish, path: Path | str) -> None:
    """Draw what was wished for into a file; UsageError as `pictured`, and for a file that is no
    picture.
    """
    canvas.format_of(Path(path))
    with pictured(runs, wish) as figure:
        canvas.save(figure, path, *([wish.dpi] if wish.dpi else []))


def draw_results(runs: Sequence[Results], path: Path | str) -> None:
    """The picture of results of which nothing was wished for: of a body in time its history, of
    several forces over time and depth, else forces over depth.
    """
    if not all(history.is_of_body(run.report) for run in runs):
        overlay(runs, path)
    elif len(runs) == 1:
        history.draw(runs[0], Path(path))
    else:
        draw(runs, Wish(("time", "force")), path)


@contextmanager
def pictured(runs: Sequence[Results], wish: Wish) -> Iterator[Figure]:
    """The figure of what was wished for; UsageError for steps, fields and panels that the results
    do not have.
    """
    if wish.units:
        runs = [replace(run, report=run.report | {SHOWN_UNITS: dict(wish.units)}) for run in runs]
    runs, names = named_apart(runs) if len(runs) > 1 else (list(runs), [""])
    _refuse_too_many(runs, names, wish)
    rows = _laid_out(runs, names, wish) if wish.layout else _as_they_have_room(runs, names, wish)
    width = (
        wish.width * MM
        if wish.width
        else PANEL_WIDTH * min(MOST_WIDE, max(row.columns for row in rows))
    )
    words = WORDS + canvas.LINE * (len(runs) + len(wish.what))
    heights = [
        row.lines * (row.aspect * width / row.columns + words) * wish.font / canvas.FONT
        for row in rows
    ]
    with canvas.canvas((width, sum(heights)), wish.font) as figure:
        grid = figure.add_gridspec(len(rows), 1, height_ratios=heights)
        parts = [figure.add_subfigure(place) for place in grid]
        drawn = [row.draw(part) for row, part in zip(rows, parts, strict=True)]
        if wish.letters:
            _letter(figure)
        true = [axes for axes in figure.axes if axes.get_aspect() != "auto"]
        for axes in (
            true
        ):  # the layout leaves no room for the numbers of one that is smaller than its place
            axes.set_aspect("auto")
        for _ in range(FITTINGS):
            canvas.find_places(figure)
            canvas.thin_numbers(figure)
            heights = [_height(*one, figure.dpi) for one in zip(rows, parts, drawn, strict=True)]
            figure.set_size_inches(width, sum(heights))
            grid.set_height_ratios(heights)
        canvas.lay_out(figure)
        for axes in true:
            axes.set_aspect("equal")
        yield figure


def _height(row: _Row, part: SubFigure, panels: Sequence[Axes], dpi: float) -> float:
    """The height of a row [inches] in which its panels have the height over width that they are
    drawn for.
    """
    wide = part.bbox.width / dpi
    high = part.bbox.height / dpi
    panel = panels[0].get_position(original=True)
    return high + row.lines * (row.aspect * panel.width * wide - panel.height * high)


def draw_into(axes: Axes, runs: Sequence[Results], wish: Wish) -> None:
    """Draw the one panel that was wished for into axes of somebody else's figure, with its legend
    inside.

    UsageError as `pictured`, for several panels, and for a wish of the whole picture (width, font,
    layout, letters).
    """
    if (wish.width, wish.font, wish.layout, wish.letters) != (None, canvas.FONT, None, ""):
        raise UsageError(
            "width, font, layout and letters are those of the figure that ax belongs to"
        )
    if wish.units:
        runs = [replace(run, report=run.report | {SHOWN_UNITS: dict(wish.units)}) for run in runs]
    runs, names = named_apart(runs) if len(runs) > 1 else (list(runs), [""])
    panels = _every_panel(runs, names, wish)
    if len(panels) != 1:
        raise UsageError(
            f"ax is for one panel, these are {len(panels)}",
            "name one of --what, --field and --steps",
        )
    panels[0].draw_alone(axes)


def _every_panel(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> list[_Panel]:
    """All panels one by one, in the order of the wish."""
    panels: list[_Panel] = []
    for what in wish.what:
        panels += _line_panels(runs, names, wish, what)
        for maps in _maps(runs, names, wish, what):
            panels += [_map_panel(maps, i) for i in range(len(maps.shown))]
    return panels


def _refuse_too_many(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> None:
    """UsageError for more panels than a picture has; all kinds, fields and steps of all results are
    counted.
    """
    count = 0
    for what in wish.what:
        if what in MAPPED:
            count += len(wish.fields) * len(_shown(runs, names, wish, what))
        elif what == "pressure":
            maps = sum(np.ptp(run.surface["y"]) > 0 for run, *_ in _shown(runs, names, wish, what))
            count += max(1, maps)
        else:
            count += 1
    if count > MOST_PANELS:
        problem = f"these are {count} panels, a picture has {MOST_PANELS} at most"
        raise UsageError(problem, "name fewer --what, --field or --steps")


def _letter(figure: Figure) -> None:
    """(a), (b), ... before the titles of the panels, in their order."""
    panels = [axes for axes in figure.axes if axes.axison and axes.get_label() != "<colorbar>"]
    for i, axes in enumerate(panels):
        said = axes.get_title(loc="left")
        letter = f"({chr(ord('a') + i % 26)})"
        axes.set_title(f"{letter} {said}".strip(), loc="left", fontsize="small", color=canvas.INK)


def _as_they_have_room(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> list[_Row]:
    """Panels that stand alone side by side, then every map of which there are several, with one bar
    of colours.
    """
    alone: list[_Panel] = []
    together: list[_Row] = []
    for what in wish.what:
        alone += _line_panels(runs, names, wish, what)
        for maps in _maps(runs, names, wish, what):
            if len(maps.shown) == 1:
                alone.append(_map_panel(maps, 0))
            else:
                most = wish.side_by_side(
                    NARROWEST_MAPS, MOST_IN_FILM if what == "film" else MOST_IN_ROW
                )
                together.append(_map_row(maps, most))
    most = wish.side_by_side(NARROWEST_LINES, MOST_WIDE)
    columns = 2 if len(alone) == 4 and most > 2 else min(most, max(1, len(alone)))
    return [_side_by_side(part, columns) for part in _in_rows(alone, columns)] + together


def _laid_out(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> list[_Row]:
    """The panels in the rows and columns asked for, in the order of the wish."""
    assert wish.layout is not None
    count, columns = wish.layout
    if count * columns > MOST_PANELS:
        problem = f"--layout {count}x{columns} is for {count * columns} panels"
        raise UsageError(problem, f"a picture has {MOST_PANELS} at most")
    panels = _every_panel(runs, names, wish)
    if len(panels) > count * columns:
        raise UsageError(
            f"--layout {count}x{columns} has room for {count * columns} panels; these are "
            f"{len(panels)}"
        )
    narrow = NARROWEST_CELL * wish.font / canvas.FONT
    if wish.width and wish.width * MM < columns * narrow:
        least = columns * narrow / MM
        raise UsageError(
            f"{columns} panels side by side with letters of {wish.font:g} pt need --width "
            f"{least:.0f}"
        )
    return [_side_by_side(part, columns) for part in _in_rows(panels, columns)]


def _line_panels(
    runs: Sequence[Results], names: Sequence[str], wish: Wish, what: str
) -> list[_Panel]:
    """The panels of curves of one kind."""
    named = names if len(runs) > 1 else ("this run",)
    if what == "force":
        theory = runs[0].report.get("theory") if len(runs) == 1 else None
        return [_line_panel(partial(draw_forces, runs=runs, theory=theory, names=named))]
    if what == "time":
        return [_line_panel(partial(history.draw_over_time, runs=runs, names=named))]
    if what == "profile":
        return [
            _line_panel(partial(draw_profiles, shown=_coloured(_shown(runs, names, wish, what))))
        ]
    if what in PRESSED:
        return _pressure_curves(runs, names, wish, what)
    return []


def _line_panel(draw: Callable[[Axes], None]) -> _Panel:
    """A panel of curves with its legend below."""

    def into(axes: Axes, aspect: float) -> None:
        draw(axes)
        canvas.legend_under(axes)

    def alone(axes: Axes) -> None:
        draw(axes)
        axes.legend()

    return _Panel(into, alone)


def _pressure_curves(
    runs: Sequence[Results], names: Sequence[str], wish: Wish, what: str
) -> list[_Panel]:
    """Pressures as curves: over the radius, or of a surface of two dimensions on a line through the
    tip's axis.
    """
    along: Literal[0, 1] = 1 if what == "pressure_y" else 0
    told = []
    for run, step, name, colour in _coloured(_shown(runs, names, wish, what)):
        contact = contact_of(run, step)
        has_two = np.ptp(contact.y) > 0
        if along == 1 and not has_two:
            raise UsageError(
                f"{run.path} has no y axis: --what pressure_y is of bodies in three dimensions"
            )
        if has_two and what == "pressure":
            continue  # which is a map
        told.append((run, on_axis(contact, along) if has_two else contact, name, colour))
    return (
        [_line_panel(partial(draw_pressures, shown=told, limits=wish.limits, along=along))]
        if told
        else []
    )


def _maps(
    runs: Sequence[Results], names: Sequence[str], wish: Wish, what: str
) -> Iterator[FieldRow | PressureMaps]:
    """The maps of one kind, those of one quantity together."""
    if what == "pressure":
        found = _shown(runs, names, wish, what)
        if seen := [one for one in found if np.ptp(one[0].surface["y"]) > 0]:
            yield PressureMaps(seen, wish.limits)
    elif what in MAPPED:
        shown = _shown(runs, names, wish, what)
        for name in wish.fields:
            yield FieldRow(shown, field_of(name), wish.limits, wish.zoom)


def _map_panel(maps: FieldRow | PressureMaps, i: int) -> _Panel:
    """One of some maps by itself, in the frame and the colours of all, the bar below it."""

    def into(axes: Axes, aspect: float) -> None:
        maps.draw([axes], slice(i, i + 1), "bottom", aspect)

    return _Panel(into, lambda axes: maps.draw([axes], slice(i, i + 1)), maps.aspect)


def _side_by_side(panels: Sequence[_Panel], columns: int) -> _Row:
    """Panels side by side, of one height and one baseline, each as wide as the others, be the row
    full or not.
    """
    aspect = max(
        (panel.aspect for panel in panels if panel.aspect is not None), default=LINE_ASPECT
    )

    def into(part: SubFigure) -> Sequence[Axes]:
        places = list(part.subplots(1, columns, squeeze=False)[0])
        for panel, axes in zip(panels, places[: len(panels)], strict=True):
            panel.draw(axes, aspect)
        for unused in places[len(panels) :]:
            unused.remove()
        return places[: len(panels)]

    return _Row(1, columns, aspect, into)


def _map_row(maps: FieldRow | PressureMaps, most: int) -> _Row:
    """Maps in one frame and one range of colours, in as many lines as they need, with one bar."""
    lines = -(-len(maps.shown) // most)
    columns = -(-len(maps.shown) // lines)

    def into(part: SubFigure) -> Sequence[Axes]:
        is_shared = isinstance(maps, FieldRow)  # each pressure is seen around its own tip
        axes = part.subplots(
            lines, columns, squeeze=False, sharex=is_shared, sharey=is_shared
        ).ravel()
        for unused in axes[len(maps.shown) :]:
            unused.remove()
        maps.draw(list(axes[: len(maps.shown)]))
        return list(axes[: len(maps.shown)])

    return _Row(lines, columns, maps.aspect, into)


def _in_rows(panels: Sequence[T], most: int) -> list[Sequence[T]]:
    """So many in each row at most."""
    return [panels[begin : begin + most] for begin in range(0, len(panels), most)]


def _coloured(shown: Sequence[Shown]) -> list[tuple[Results, float, str, Any]]:
    """With the words that tell a curve from the others and its colour: steps from dark to light,
    results by hue.
    """
    many = len(shown)
    single = len({id(run) for run, *_ in shown}) == 1
    colours = [
        curves.shade(i, many) if single and many > 1 else curves.look(i, many)["color"]
        for i in range(many)
    ]
    return [(*one[:2], titled(*one), colour) for one, colour in zip(shown, colours, strict=True)]


def _shown(runs: Sequence[Results], names: Sequence[str], wish: Wish, what: str) -> list[Shown]:
    """Every result at every step asked for; UsageError where one is missing."""
    found = [
        (run, step, name)
        for run, name in zip(runs, names, strict=True)
        for step in _steps(run, wish, what)
    ]
    if len(found) > MOST_PANELS:
        raise UsageError(
            f"{len(found)} curves or panels of {what} are too many for one picture; name "
            "fewer --steps"
        )
    return found


def _steps(run: Results, wish: Wish, what: str) -> list[float]:
    """The steps of a result that are shown: those asked for, or that of the largest force, of a
    film some of all.
    """
    key = "fields" if what in MAPPED else "surface"
    known = kept_steps(run.path, run["step"]) if key == "fields" else run.surface.get("step", ())
    there = sorted(set(map(int, known)))
    if not there:
        kept = "all" if what == "film" else "last or all"
        raise UsageError(f"{run.path} has no {key}; run it with --set output.{key}={kept}")
    if what == "film" and not wish.steps:
        if len(there) < len(run):
            problem = (
                f"{run.path} has fields of {len(there)} of {len(run)} steps, and a film is of all"
            )
            raise UsageError(problem, "run it with --set output.fields=all, or name --steps")
        return [float(step) for step in history.spread(run, there)]
    asked = [there[-1] if word == "last" else word for word in wish.steps]
    drawn = replace(run, surface={"step": np.array(there, dtype=float)})
    steps = (
        there
        if "all" in asked
        else [int(word) for word in asked] or [int(strongest_step(drawn) or there[-1])]
    )
    if missing := [step for step in steps if step not in there]:
        problem = (
            f"{run.path} has no {key} of step {missing[0]}, only of {', '.join(map(str, there))}"
        )
        raise UsageError(f"{problem}; output.{key}: all keeps every step")
    return [float(step) for step in steps]
