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
from indent_sim.results.pictures.pressure import contact_of, draw_map, draw_pressures, strongest_step, titled
from indent_sim.results.pictures.profile import draw_profiles
from indent_sim.results.reader import Results
from indent_sim.results.xdmf import kept_steps

WHAT = ("force", "time", "pressure", "profile", "fields", "film")
OF_STEPS = ("pressure", "profile", "fields", "film")
MAPPED = ("fields", "film")  # film: states of a field spread over the path
OF_FIELDS = {"fields": "--field", "limits": "--limits", "zoom": "--zoom"}  # entries of a wish, and their options
MM = 1 / 25.4  # inches
PANEL_WIDTH = 4.4  # inches: width of a panel where no width is asked for
LINE_ASPECT, MAP_ASPECT = 0.72, 0.85  # height over width of panels
# Inches around a field for words and numbers, and what its bar leaves
WORDS_HEIGHT, TIME_HEIGHT, NUMBERS_WIDTH, BESIDE_BAR = 0.75, 0.15, 0.4, 0.85
LOWEST = 1.2  # inches: of a bar with its words
MOST_IN_ROW, MOST_IN_FILM, MOST_WIDE, MOST_PANELS = 4, 6, 3, 40
T = TypeVar("T")
NARROWEST_CELL, BAR_HEIGHT = 1.5, 0.5  # inches: of a panel of a layout at the standard font size, of a bar below it
NARROWEST_LINES, NARROWEST_MAPS = 2.6, 1.8  # inches: panels at the standard font size
Shown = tuple[Results, float, str]  # a result, a step, and what tells them from the others in words


@dataclass(frozen=True)
class Wish:
    """What a picture shall show. steps: numbers, last or all; "": the step of the largest force; width [mm]."""

    what: tuple[str, ...]
    fields: tuple[str, ...] = ("von_mises",)
    steps: tuple[str, ...] = ()
    width: float | None = None
    font: float = canvas.FONT
    units: Mapping[str, str] = field(default_factory=dict)
    layout: tuple[int, int] | None = None  # rows and columns of all panels; None: as they have room
    letters: Literal["", "a"] = ""  # before the panels: none, or (a), (b), ...
    dpi: float | None = None  # of what is drawn point by point
    limits: tuple[float, float] | None = None  # of the colours of a field, in the unit shown
    zoom: float | None = None  # contact radii around the tip that fields show; infinite: the whole body

    def side_by_side(self, narrowest: float, most: int) -> int:
        """How many panels stand side by side, none narrower than so many inches at the standard font size."""
        room = self.width * MM / (narrowest * self.font / canvas.FONT) if self.width else most
        return int(np.clip(room, 1, most))

    @property
    def name(self) -> str:
        """The file of a picture that nobody named."""
        return f"{'_'.join(self.what)}.png"


def wish(given: Mapping[str, Any]) -> Wish:
    """The wish of some options; UsageError for words that are none, and for options that would have no effect."""
    found = Wish(**{"what": ("force",), **given})
    if unknown := [word for word in found.what if word not in WHAT]:
        raise UsageError(f"--what {unknown[0]} is none of {', '.join(WHAT)}")
    for name, option in OF_FIELDS.items():
        if name in given and not set(found.what) & set(MAPPED):
            raise UsageError(f"{option} belongs to --what {' or '.join(MAPPED)}")
    if found.limits is not None and not found.limits[0] < found.limits[1]:
        raise UsageError(f"--limits {found.limits[0]:g}:{found.limits[1]:g}: the first must be below the second")
    if "steps" in given and not set(found.what) & set(OF_STEPS):
        raise UsageError(f"--steps belongs to --what {' or '.join(OF_STEPS)}: the force is drawn at every step")
    if wrong := [word for word in found.steps if not (word in ("last", "all") or word.isdecimal())]:
        raise UsageError(f"--steps {wrong[0]} is neither a step nor last nor all")
    if wrong := [kind for kind in found.units if kind not in BASE_UNITS]:
        raise UsageError(f"--units {wrong[0]}: there are {', '.join(BASE_UNITS)}")
    for name in found.fields:
        field_of(name)
    return found


@dataclass(frozen=True)
class _Row:
    """A row of so many panels: its height at a width of the picture [inches], and what draws it into its part."""

    panels: int
    height: Callable[[float], float]
    draw: Callable[[SubFigure], None]


def draw(runs: Sequence[Results], wish: Wish, path: Path | str) -> None:
    """Draw what was wished for into a file; UsageError as `pictured`, and for a file that is no picture."""
    canvas.format_of(Path(path))
    with pictured(runs, wish) as figure:
        canvas.save(figure, path, *([wish.dpi] if wish.dpi else []))


def draw_results(runs: Sequence[Results], path: Path | str) -> None:
    """The picture of results of which nothing was wished for: of a body in time its history, of several forces over
    time and depth, else forces over depth."""
    if not all(history.is_of_body(run.report) for run in runs):
        overlay(runs, path)
    elif len(runs) == 1:
        history.draw(runs[0], Path(path))
    else:
        draw(runs, Wish(("time", "force")), path)


@contextmanager
def pictured(runs: Sequence[Results], wish: Wish) -> Iterator[Figure]:
    """The figure of what was wished for; UsageError for steps, fields and panels that the results do not have."""
    if wish.units:
        runs = [replace(run, report=run.report | {SHOWN_UNITS: dict(wish.units)}) for run in runs]
    runs, names = named_apart(runs) if len(runs) > 1 else (list(runs), [""])
    _refuse_too_many(runs, names, wish)
    rows = _laid_out(runs, names, wish) if wish.layout else _as_they_have_room(runs, names, wish)
    width = wish.width * MM if wish.width else PANEL_WIDTH * min(MOST_WIDE, max(row.panels for row in rows))
    heights = [row.height(width) for row in rows]
    with canvas.canvas((width, sum(heights)), wish.font) as figure:
        parts = figure.subfigures(len(rows), 1, height_ratios=heights, squeeze=False)
        for row, part in zip(rows, parts[:, 0], strict=True):
            row.draw(part)
        if wish.letters:
            _letter(figure)
        yield figure


def draw_into(axes: Axes, runs: Sequence[Results], wish: Wish) -> None:
    """Draw the one panel that was wished for into axes of somebody else's figure, with its legend inside.

    UsageError as `pictured`, for several panels, and for a wish of the whole picture (width, font, layout, letters).
    """
    if (wish.width, wish.font, wish.layout, wish.letters) != (None, canvas.FONT, None, ""):
        raise UsageError("width, font, layout and letters are those of the figure that ax belongs to")
    if wish.units:
        runs = [replace(run, report=run.report | {SHOWN_UNITS: dict(wish.units)}) for run in runs]
    runs, names = named_apart(runs) if len(runs) > 1 else (list(runs), [""])
    drawings = _line_panels(runs, names, wish)
    lines = len(drawings)
    for what in wish.what:
        if what == "pressure":
            shown = _shown(runs, names, wish, what)
            mapped = [one for one in shown if np.ptp(one[0].surface["y"]) > 0]
            drawings += [partial(draw_map, results=run, contact=contact_of(run, step)) for run, step, _ in mapped]
        if what in MAPPED:
            for name in wish.fields:
                row = _fields(runs, names, wish, name, what)
                places = (slice(k, k + 1) for k in range(len(row.shown)))
                drawings += [partial(_draw_field, row=row, some=some) for some in places]
    if len(drawings) != 1:
        raise UsageError(f"ax is for one panel, these are {len(drawings)}", "name one of --what, --field and --steps")
    drawings[0](axes)
    if lines:
        axes.legend()


def _draw_field(axes: Axes, row: FieldRow, some: slice) -> None:
    """One panel of a field with its bar of colours."""
    row.draw([axes], some)


def _refuse_too_many(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> None:
    """UsageError for more panels than a picture has; all kinds, fields and steps of all results are counted."""
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
    """Curves first, then maps, in rows as wide as the picture."""
    lines = _line_panels(runs, names, wish)
    rows = [_line_row(part, len(runs)) for part in _in_rows(lines, wish.side_by_side(NARROWEST_LINES, MOST_WIDE))]
    return rows + _map_rows(runs, names, wish)


def _laid_out(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> list[_Row]:
    """The panels in the rows and columns asked for, in the order of the wish."""
    assert wish.layout is not None
    count, columns = wish.layout
    if count * columns > MOST_PANELS:
        problem = f"--layout {count}x{columns} is for {count * columns} panels"
        raise UsageError(problem, f"a picture has {MOST_PANELS} at most")
    cells = [cell for what in wish.what for cell in _cells(runs, names, replace(wish, what=(what,)))]
    if len(cells) > count * columns:
        raise UsageError(f"--layout {count}x{columns} has room for {count * columns} panels; these are {len(cells)}")
    narrow = NARROWEST_CELL * wish.font / canvas.FONT
    if wish.width and wish.width * MM < columns * narrow:
        least = columns * narrow / MM
        raise UsageError(f"{columns} panels side by side with letters of {wish.font:g} pt need --width {least:.0f}")
    return [_beside_one_another(part, columns) for part in _in_rows(cells, columns)]


def _cells(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> list[_Row]:
    """The panels of one kind, each by itself."""
    cells = [_line_row([panel], len(runs)) for panel in _line_panels(runs, names, wish)]
    if "pressure" in wish.what:
        shown = _shown(runs, names, wish, "pressure")
        cells += [_pressure_row([one]) for one in shown if np.ptp(one[0].surface["y"]) > 0]
    for what in (what for what in wish.what if what in MAPPED):
        for name in wish.fields:
            row = _fields(runs, names, wish, name, what)
            cells += [_field_cell(row, i) for i in range(len(row.shown))]
    return cells


def _beside_one_another(cells: Sequence[_Row], columns: int) -> _Row:
    """Cells side by side, each as wide as the others, whether the last row is full or not."""

    def into(part: SubFigure) -> None:
        parts = part.subfigures(1, columns, squeeze=False)[0]
        for cell, place in zip(cells, parts[: len(cells)], strict=True):
            cell.draw(place)

    return _Row(columns, lambda width: max(cell.height(width / columns) for cell in cells), into)


def _field_cell(row: FieldRow, i: int) -> _Row:
    """One of the panels of a field by itself, in the frame and the colours of all, the bar below it."""

    def height(width: float) -> float:
        aspect = float(np.ptp(row.frame[2:]) / np.ptp(row.frame[:2]))
        return max(aspect * (width - NUMBERS_WIDTH), LOWEST) + WORDS_HEIGHT + BAR_HEIGHT

    return _Row(1, height, lambda part: row.draw([part.subplots()], slice(i, i + 1), "bottom"))


def _fields(runs: Sequence[Results], names: Sequence[str], wish: Wish, name: str, what: str) -> FieldRow:
    return FieldRow(_shown(runs, names, wish, what), field_of(name), wish.limits, wish.zoom)


def _line_panels(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> list[Callable[[Axes], None]]:
    """What draws each panel of curves, in the order of the wish."""
    panels: list[Callable[[Axes], None]] = []
    theory = runs[0].report.get("theory") if len(runs) == 1 else None
    for what in wish.what:
        if what == "force":
            panels.append(lambda axes: draw_forces(axes, runs, theory, names if len(runs) > 1 else ("this run",)))
        elif what == "time":
            panels.append(partial(history.draw_over_time, runs=runs, names=names if len(runs) > 1 else ("this run",)))
        elif what == "profile":
            panels.append(partial(draw_profiles, shown=_coloured(_shown(runs, names, wish, what))))
        elif what == "pressure":
            shown = _coloured([one for one in _shown(runs, names, wish, what) if np.ptp(one[0].surface["y"]) == 0])
            told = [(run, contact_of(run, step), name, colour) for run, step, name, colour in shown]
            panels += [partial(draw_pressures, shown=told)] if told else []
    return panels


def _line_row(panels: Sequence[Callable[[Axes], None]], runs: int) -> _Row:
    """Panels of curves side by side, each with its legend below."""

    def into(part: SubFigure) -> None:
        axes = part.subplots(2, len(panels), squeeze=False)
        width, height = part.bbox.width / part.figure.dpi / len(panels), part.bbox.height / part.figure.dpi
        for draw_panel, (plot, below) in zip(panels, axes.T, strict=True):
            draw_panel(plot)
            canvas.legend_in(below, plot, wide=width - 0.5)  # for its words and numbers
        legends = [below.get_legend().get_texts() for below in axes[1]]
        lines = max(sum(text.get_text().count("\n") + 1 for text in texts) for texts in legends)
        legend = min(0.6 * height, canvas.LINE * (lines + 0.5) * canvas.figure_font() / canvas.FONT)
        axes[0, 0].get_gridspec().set_height_ratios([height - legend, legend])

    words = canvas.LINE * (2 + len(panels) + runs)
    return _Row(len(panels), lambda width: LINE_ASPECT * width / len(panels) + words, into)


def _map_rows(runs: Sequence[Results], names: Sequence[str], wish: Wish) -> list[_Row]:
    """Rows of maps: of the pressure where the surface has two dimensions, and of every field."""
    rows: list[_Row] = []
    most, film = (wish.side_by_side(NARROWEST_MAPS, many) for many in (MOST_IN_ROW, MOST_IN_FILM))
    for what in wish.what:
        if what == "pressure":
            mapped = [one for one in _shown(runs, names, wish, what) if np.ptp(one[0].surface["y"]) > 0]
            rows += [_pressure_row(part) for part in _in_rows(mapped, most)]
        if what in MAPPED:
            across = film if what == "film" else most
            rows += [_field_row(_fields(runs, names, wish, name, what), across) for name in wish.fields]
    return rows


def _pressure_row(shown: Sequence[Shown]) -> _Row:
    def into(part: SubFigure) -> None:
        for axes, (run, step, words) in zip(part.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
            draw_map(axes, run, contact_of(run, step))
            axes.set_title(titled(run, step, words), loc="left", fontsize="small", color=canvas.GREY)

    return _Row(len(shown), lambda width: MAP_ASPECT * min(width / len(shown), PANEL_WIDTH), into)


def _field_row(row: FieldRow, most: int) -> _Row:
    """A field in one frame and one range of colours, in as many lines as the panels need."""
    lines = -(-len(row.shown) // most)
    columns = -(-len(row.shown) // lines)

    def into(part: SubFigure) -> None:
        axes = part.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
        for unused in axes[len(row.shown) :]:
            unused.remove()
        row.draw(list(axes[: len(row.shown)]))

    def height(width: float) -> float:
        aspect = float(np.ptp(row.frame[2:]) / np.ptp(row.frame[:2]))
        panel = max(aspect * (BESIDE_BAR * width / columns - NUMBERS_WIDTH), LOWEST)
        return lines * (panel + TIME_HEIGHT * any("t" in run.table for run, *_ in row.shown)) + WORDS_HEIGHT

    return _Row(columns, height, into)


def _in_rows(panels: Sequence[T], most: int) -> list[Sequence[T]]:
    """So many in each row at most."""
    return [panels[begin : begin + most] for begin in range(0, len(panels), most)]


def _coloured(shown: Sequence[Shown]) -> list[tuple[Results, float, str, Any]]:
    """With the words that tell a curve from the others and its colour: steps from dark to light, results by hue."""
    many = len(shown)
    single = len({id(run) for run, *_ in shown}) == 1
    colours = [curves.shade(i, many) if single and many > 1 else curves.look(i, many)["color"] for i in range(many)]
    return [(*one[:2], titled(*one), colour) for one, colour in zip(shown, colours, strict=True)]


def _shown(runs: Sequence[Results], names: Sequence[str], wish: Wish, what: str) -> list[Shown]:
    """Every result at every step asked for; UsageError where one is missing."""
    found = [(run, step, name) for run, name in zip(runs, names, strict=True) for step in _steps(run, wish, what)]
    if len(found) > MOST_PANELS:
        raise UsageError(f"{len(found)} curves or panels of {what} are too many for one picture; name fewer --steps")
    return found


def _steps(run: Results, wish: Wish, what: str) -> list[float]:
    """The steps of a result that are shown: those asked for, or that of the largest force, of a film some of all."""
    key = "fields" if what in MAPPED else "surface"
    known = kept_steps(run.path, run["step"]) if key == "fields" else run.surface.get("step", ())
    there = sorted(set(map(int, known)))
    if not there:
        kept = "all" if what == "film" else "last or all"
        raise UsageError(f"{run.path} has no {key}; run it with --set output.{key}={kept}")
    if what == "film" and not wish.steps:
        if len(there) < len(run):
            problem = f"{run.path} has fields of {len(there)} of {len(run)} steps, and a film is of all"
            raise UsageError(problem, "run it with --set output.fields=all, or name --steps")
        return [float(step) for step in history.spread(run, there)]
    asked = [there[-1] if word == "last" else word for word in wish.steps]
    drawn = replace(run, surface={"step": np.array(there, dtype=float)})
    steps = there if "all" in asked else [int(word) for word in asked] or [int(strongest_step(drawn) or there[-1])]
    if missing := [step for step in steps if step not in there]:
        problem = f"{run.path} has no {key} of step {missing[0]}, only of {', '.join(map(str, there))}"
        raise UsageError(f"{problem}; output.{key}: all keeps every step")
    return [float(step) for step in steps]
