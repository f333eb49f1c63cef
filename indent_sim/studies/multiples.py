"""Pictures of a study of many runs: small multiples of curves, and columns of its table over the
keys that vary.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import Axis, axis_of_column, picture_text, unit_label_of_key
from indent_sim.results.pictures.curves import Colour
from indent_sim.results.pictures.figures import Axes, Figure, PlotStyle, SubFigure
from indent_sim.results.pictures.forces import draw_force, draw_force_lines
from indent_sim.results.reader import MEASURED, Results
from indent_sim.studies.curve_table import Families
from indent_sim.studies.study_table import answer_row

COLUMNS = ("force", "a", "p_max", "penetration")  # of a run, that are drawn over the keys that vary
STIFFNESS = "contact.epsilon_n"
MOST_COLOURS = len(figures.COLOURS)
# small multiples side by side and below one another
MOST_ACROSS = 6
MOST_DOWN = 4
MOST_NUMBERS = 3  # panels over a varied number
MOST_GROUPS = 12  # lines that are named
DASHES = ("-", (0, (4, 2)), (0, (1, 1.5)), (0, (5, 1.5, 1, 1.5)))  # of lines that share a colour
LOG_SPAN = 20.0  # ratio of largest to smallest from which a varied number is logarithmic
# The same of what many runs tell: of numbers over a decade and a half half of the curves would lie
# on zero
WIDE_SPAN = 30.0
FEW_VALUES = 3  # values of a key, from which on there is a map over two
# ratio of the ends of a logarithmic axis from which on 1, 2 and 5 of a decade are enough numbers
FEW_NUMBERS = 6.0
LEVELS = 12  # steps of the colours of a map
# inches: width and height of a small multiple, and of another panel
SMALL = (2.0, 1.75)
PANEL = (4.2, 3.4)
HEAD = 0.7  # inches: of title and subtitle


@dataclass(frozen=True)
class Roles:
    """What each varied key does in small multiples: "" where no key does it.

    colour: of the curves; across, down: panels side by side and below one another; dashes: of lines
    of one colour.
    """

    colour: str
    across: str = ""
    down: str = ""
    dashes: str = ""

    @property
    def told(self) -> tuple[str, ...]:
        """The keys that can be read off."""
        return tuple(filter(None, (self.colour, self.across, self.down, self.dashes)))


def roles(families: Families) -> Roles:
    """Give every key its role by how many values it has.

    The number with the most values is the colour, for a bar tells any number of them apart. Of the
    other keys the one with the most values goes across, and so on; a key with more values than
    there are panels gets none while another one can have it.
    """
    counts = {key: len(_values(families, key)) for key in families.keys}
    numeric = families.numeric()
    few_words = [key for key in families.keys if key not in numeric and counts[key] <= MOST_COLOURS]
    colour = max(numeric or few_words or families.keys, key=counts.__getitem__)
    rest = sorted(
        (key for key in families.keys if key != colour), key=counts.__getitem__, reverse=True
    )
    found = {"colour": colour}
    for role, most in (("across", MOST_ACROSS), ("down", MOST_DOWN), ("dashes", len(DASHES))):
        fitting = [key for key in rest if counts[key] <= most]
        if not fitting and role == "across":
            fitting = rest  # some of its values are shown
        if fitting:
            found[role] = fitting[0]
            rest.remove(fitting[0])
    return Roles(**found)


@contextmanager
def pictured(families: Families, title: str) -> Iterator[Figure]:
    """The figure of the curves of many runs of a study with two varied keys or more.

    Above small multiples of force over depth, below what the force of a run is over every varied
    number, and for two numbers a map over both.
    """
    chosen = roles(families)
    across, down = (_some(_values(families, key), most) for key, most in _facets(chosen))
    numbers = families.numeric()[:MOST_NUMBERS]
    is_map = len(families.keys) == 2 and is_grid(families, numbers)
    below = [*(["map"] if is_map else []), *numbers]
    width = max(SMALL[0] * len(across) + 1.6, PANEL[0] * len(below))
    heights = [SMALL[1] * len(down) + 0.9, *([PANEL[1] + 0.6 * is_map] if below else [])]
    with figures.new_figure((width, sum(heights) + HEAD)) as figure:
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        parts = [figure.add_subfigure(place) for place in grid]
        looks, bar = looks_by(families, chosen.colour)
        first = _draw_multiples(parts[0], families, chosen, (across, down), looks, bar)
        if below:
            values, label = told(families, "force")
            panels = parts[1].subplots(1, len(below), squeeze=False)[0]
            for axes, key in zip(panels, below, strict=True):
                if key == "map":
                    draw_map(axes, families, numbers, values, label)
                else:
                    draw_over(axes, families, key, values, label, looks)
        if first.get_legend_handles_labels()[1]:
            figures.draw_figure_legend(figure, first)
        figures.draw_title(figure, title, _subtitle(families, chosen, across))
        yield figure


def _subtitle(families: Families, chosen: Roles, across: Sequence[str]) -> str:
    """How many runs there are, and what the picture does not tell of them."""
    said = [f"{len(families.curves)} runs", "every force at its run's own depth"]
    every = len(_values(families, chosen.across)) if chosen.across else 0
    if every > len(across):
        said.append(f"{families.told(chosen.across)}: {len(across)} of {every} values")
    if hidden := [families.told(key) for key in families.keys if key not in chosen.told]:
        said.append(f"lines of one look differ in {', '.join(hidden)}")
    return "  \N{MIDDLE DOT}  ".join(said)


def _facets(chosen: Roles) -> tuple[tuple[str, int], tuple[str, int]]:
    return (chosen.across, MOST_ACROSS), (chosen.down, MOST_DOWN)


def _values(families: Families, key: str) -> list[str]:
    """The values of a key in words, numbers in their order; one empty word of no key."""
    if not key:
        return [""]
    names = list(dict.fromkeys(families.names([key])))
    if key not in families.numeric():
        return names
    numbers = dict(zip(families.names([key]), families.numbers(key), strict=True))
    return sorted(names, key=numbers.__getitem__)


def _some(values: Sequence[str], most: int) -> list[str]:
    """So many of some values, spread over all of them."""
    if len(values) <= most:
        return list(values)
    return [values[i] for i in np.linspace(0, len(values) - 1, most).round().astype(int)]


def _draw_multiples(
    part: SubFigure,
    families: Families,
    chosen: Roles,
    facets: tuple[Sequence[str], Sequence[str]],
    looks: Sequence[PlotStyle],
    bar: Any,
) -> Axes:
    """Draw force over depth into a panel for every pair of values; returns the one that has the
    names.
    """
    across, down = facets
    runs = [curve.results for curve in families.curves]
    depth = axis_of_column("delta", runs)
    force = axis_of_column("force", runs)
    dashed = _values(families, chosen.dashes)
    names = {key: families.names([key]) if key else [""] * len(runs) for key in ("", *chosen.told)}
    looks = [
        look | {"ls": DASHES[dashed.index(name)], "marker": ""}
        for look, name in zip(looks, names[chosen.dashes], strict=True)
    ]
    panels = part.subplots(len(down), len(across), squeeze=False, sharex=True, sharey=True)
    for line, lower in zip(panels, down, strict=True):
        for axes, name in zip(line, across, strict=True):
            own = [
                i
                for i in range(len(runs))
                if names[chosen.across][i] == name and names[chosen.down][i] == lower
            ]
            if own:
                _draw_curves(axes, [runs[i] for i in own], depth, force, [looks[i] for i in own])
            figures.draw_panel_title(axes, picture_text(", ".join(filter(None, (name, lower)))))
            axes.set(xlabel=depth.label, ylabel=force.label)
    first: Axes = panels[0, 0]
    _scale(first, runs, depth, force)
    for axes in panels.ravel():
        axes.label_outer()
    if bar is not None:
        figures.draw_colour_bar(
            list(panels.ravel()), bar, label_of(families, chosen.colour), "right"
        )
    else:
        known = dict(zip(names[chosen.colour], looks, strict=True))
        for name, look in known.items():
            first.plot([], [], color=look["color"], label=picture_text(name))
    if chosen.dashes:
        for name, dash in zip(dashed, DASHES, strict=False):
            first.plot([], [], color=figures.GREY, ls=dash, label=picture_text(name))
    return first


def _draw_curves(
    axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis, looks: Sequence[PlotStyle]
) -> None:
    if all(len(run) > 1 and not run.report.get(MEASURED) for run in runs):
        draw_force_lines(axes, runs, depth, force, looks)
        return
    for run, look in zip(runs, looks, strict=True):
        draw_force(axes, run, depth, force, look, "_")


def _scale(axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis) -> None:
    """Axes from zero, or logarithmic ones where most curves would lie on zero."""
    from matplotlib.ticker import NullLocator

    if span([run["force"].max() for run in runs]) < WIDE_SPAN:
        axes.autoscale_view()
        return
    axes.set(xscale="log", yscale="log")
    for along, set_limits, shown, column in (
        (axes.xaxis, axes.set_xlim, depth, "delta"),
        (axes.yaxis, axes.set_ylim, force, "force"),
    ):
        values = np.concatenate([run[column] for run in runs])
        pushed = shown(values[values > 0])
        set_limits(0.8 * pushed.min(), 1.25 * pushed.max())
        few_decades(along, max(span(pushed), FEW_NUMBERS))
        along.set_minor_locator(NullLocator())


def looks_by(families: Families, key: str) -> tuple[list[PlotStyle], Any]:
    """The colour of every curve by a varied key, and what a bar of colours is made of; None of
    words.
    """
    if key in families.numeric():
        colours, bar = shades(families.numbers(key))
        return [{"color": colour, "ls": "-"} for colour in colours], bar
    names = families.names([key])
    known = list(dict.fromkeys(names))
    if len(known) > MOST_COLOURS:
        return [{"color": figures.GREY, "ls": "-"} for _ in names], None
    return [{"color": figures.COLOURS[known.index(name)], "ls": "-"} for name in names], None


def shades(values: Sequence[float]) -> tuple[list[Colour], Any]:
    """Colours of some numbers, and what a bar of colours is made of."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize

    low = min(values)
    high = max(values)
    norm = (LogNorm if low > 0 and high > LOG_SPAN * low else Normalize)(
        low, high if high > low else low + 1
    )
    seen = colormaps["viridis"]  # without its lightest yellow, which is lost on white
    shown = LinearSegmentedColormap.from_list("shades", seen(np.linspace(0.0, 0.9, 256)))
    colours = [tuple(colour) for colour in seen(0.9 * np.asarray(norm(values))).tolist()]
    return colours, ScalarMappable(norm, shown)


def label_of(families: Families, key: str) -> str:
    """The name of a varied number with its unit."""
    unit = families.unit(key) or unit_label_of_key(key, families.curves[0].results)
    return Axis(picture_text(families.told(key)), unit=unit).label


def span(values: Sequence[float] | np.ndarray) -> float:
    """Ratio of the largest to the smallest of positive numbers; 1 where one is not."""
    return float(np.max(values) / np.min(values)) if np.min(values) > 0 else 1.0


def told(families: Families, column: str) -> tuple[list[float], str]:
    """A column in the row that each run is told by, as it is shown, and its name with its unit."""
    runs = [curve.results for curve in families.curves]
    shown = axis_of_column(column, runs)
    values = [float(shown(run[column][answer_row(run)])) for run in runs]
    has_histories = all("t" in run.table for run in runs)
    when = "at the largest force" if has_histories else "at the last depth"
    before = "largest" if has_histories else "last"
    return values, f"{before} {shown.label}" if column == "force" else f"{shown.label}, {when}"


def groups_of(families: Families, key: str) -> dict[str, list[int]]:
    """The places of the curves by their other varied keys, in words."""
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(
        families.names([other for other in families.keys if other != key])
    ):
        groups.setdefault(name, []).append(place)
    return groups


def draw_over(
    axes: Axes,
    families: Families,
    key: str,
    values: Sequence[float],
    label: str,
    looks: Sequence[PlotStyle],
) -> None:
    """Draw what the runs tell over a varied number: a line for all runs that differ in this number
    alone.
    """
    numbers = families.numbers(key)
    for places in groups_of(families, key).values():
        along = sorted(places, key=lambda place: numbers[place])
        colours = [looks[place]["color"] for place in along]
        x = [numbers[place] for place in along]
        y = [values[place] for place in along]
        line = colours[0] if len(set(map(str, colours))) == 1 else figures.GREY
        axes.plot(x, y, lw=0.9, color=line, zorder=1)
        axes.scatter(x, y, s=12, color=colours, zorder=2)
    scale_numbers(axes, numbers)
    if span(values) >= WIDE_SPAN:
        axes.set_yscale("log")
    axes.set(xlabel=label_of(families, key), ylabel=label)


def scale_numbers(axes: Axes, numbers: Sequence[float]) -> None:
    """A logarithmic axis of x for a varied number that spans decades."""
    if span(numbers) > LOG_SPAN:
        axes.set_xscale("log")
        few_decades(axes.xaxis, span(numbers))


def few_decades(along: Any, ratio: float) -> None:
    """Plain numbers on a logarithmic axis whose largest number is less than 100 times the smallest."""
    from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter

    if ratio < 100:
        along.set_major_locator(
            LogLocator(subs=(1, 2, 5) if ratio >= FEW_NUMBERS else (1, 1.5, 2, 3, 4, 5, 6, 8))
        )
        along.set_major_formatter(StrMethodFormatter("{x:g}"))
        along.set_minor_locator(NullLocator())
    along.set_minor_formatter(NullFormatter())


def is_grid(families: Families, keys: Sequence[str]) -> bool:
    """Whether two numbers vary, every value of one with every value of the other, at least
    FEW_VALUES of each.
    """
    if len(keys) != 2 or tuple(keys) != families.keys:
        return False
    pairs = set(zip(families.numbers(keys[0]), families.numbers(keys[1]), strict=True))
    counts = [len({pair[i] for pair in pairs}) for i in (0, 1)]
    return min(counts) >= FEW_VALUES and len(pairs) == counts[0] * counts[1]


def draw_map(
    axes: Axes, families: Families, keys: Sequence[str], values: Sequence[float], label: str
) -> None:
    """Draw what the runs tell as colours over two varied numbers, between the runs, which are dots."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, MaxNLocator

    x, y = (families.numbers(key) for key in keys)
    at = {
        pair: value for *pair_, value in zip(x, y, values, strict=True) for pair in [tuple(pair_)]
    }
    across = sorted(set(x))
    up = sorted(set(y))
    found = np.array([[at[one, other] for one in across] for other in up])
    is_log = span(values) >= WIDE_SPAN
    low = min(values)
    high = max(values)
    high = high if high > low else low + 1.0
    levels = np.geomspace(low, high, LEVELS + 1) if is_log else np.linspace(low, high, LEVELS + 1)
    look: PlotStyle = {"norm": LogNorm(low, high)} if is_log else {}
    drawn = axes.contourf(
        across, up, found, levels=levels, cmap="viridis", extend="neither", **look
    )
    axes.plot(x, y, ls="", marker=".", ms=4, color="white", mec=figures.INK, mew=0.3)
    for numbers, scale, along in (
        (across, axes.set_xscale, axes.xaxis),
        (up, axes.set_yscale, axes.yaxis),
    ):
        if span(numbers) >= LOG_SPAN:
            scale("log")
            few_decades(along, span(numbers))
    axes.set(xlabel=label_of(families, keys[0]), ylabel=label_of(families, keys[1]))
    bar = figures.draw_colour_bar([axes], drawn, label, "bottom")
    bar.set_ticks(LogLocator(subs=(1, 2, 5)) if is_log else MaxNLocator(5))
    bar.ax.xaxis.set_major_formatter("{x:g}")
    bar.minorticks_off()


@contextmanager
def column_pictured(families: Families, column: str, title: str) -> Iterator[Figure]:
    """The figure of one of COLUMNS over what varies: the penetration over epsilon_n where that
    varies.

    Else over two numbers a map, over one or several a panel for each. UsageError where no number
    varies, or no run has such a column.
    """
    numeric = families.numeric()
    if not numeric:
        raise UsageError(f"no number varies in this study: {column} can be drawn over none")
    if not any(
        np.isfinite(curve.results.table.get(column, np.nan)).any() for curve in families.curves
    ):
        raise UsageError(f"no run of this study has {column}")
    over = (
        (STIFFNESS,) if column == "penetration" and STIFFNESS in numeric else numeric[:MOST_NUMBERS]
    )
    values, label = told(families, column)
    is_map = over == numeric and is_grid(families, over)
    count = 1 if is_map else len(over)
    wide = PANEL[0] * count * (1.4 if count == 1 else 1.0)
    with figures.new_figure((wide, HEAD + PANEL[1] + (1.0 if is_map else 0.4))) as figure:
        panels = figure.subplots(1, count, squeeze=False)[0]
        if is_map:
            draw_map(panels[0], families, over, values, label)
        else:
            _draw_over_each(figure, panels, families, over, (values, label))
        if over == (STIFFNESS,):
            _draw_pressure_over_stiffness(panels[0], families)
            if min(values) > 0 and span(families.numbers(STIFFNESS)) > LOG_SPAN:
                panels[0].set_yscale("log")  # it falls with the stiffness
        if panels[0].get_legend_handles_labels()[1]:
            figures.draw_figure_legend(figure, panels[0])
        figures.draw_title(figure, title, f"{len(families.curves)} runs")
        yield figure


def _draw_over_each(
    figure: Figure,
    panels: Sequence[Axes],
    families: Families,
    over: Sequence[str],
    shown: tuple[Sequence[float], str],
) -> None:
    """Draw a column over each of some numbers, its lines named by the other keys while they are
    few.
    """
    others = [key for key in families.keys if key not in over]
    names = families.names(others)
    known = list(dict.fromkeys(names))
    if 1 < len(known) <= MOST_COLOURS:
        looks: list[PlotStyle] = [{"color": figures.COLOURS[known.index(name)]} for name in names]
        bar = None
        for name, colour in zip(known, figures.COLOURS, strict=False):
            panels[0].plot([], [], color=colour, label=picture_text(name))
    elif len(others) or len(over) > 1:
        by = next((key for key in (*others, *over) if key in families.numeric()), families.keys[0])
        looks, bar = looks_by(families, by)
        if bar is not None:
            figures.draw_colour_bar(list(panels), bar, label_of(families, by), "right")
    else:
        looks = [{"color": figures.COLOURS[0]} for _ in names]
    for axes, key in zip(panels, over, strict=True):
        draw_over(axes, families, key, *shown, looks)


def _draw_pressure_over_stiffness(axes: Axes, families: Families) -> None:
    """Draw by how much a penalty of stiffness epsilon_n yields under the largest pressure: p_max /
    epsilon_n.
    """
    runs = [curve.results for curve in families.curves]
    if any(run.report.get("method") != "penalty" for run in runs) or families.unit(STIFFNESS):
        return
    stiffness = np.array(families.numbers(STIFFNESS))
    peak = np.array([run["p_max"][answer_row(run)] for run in runs])
    along = np.argsort(stiffness)
    yields = axis_of_column("penetration", runs)(peak[along] / stiffness[along])
    label = r"$p_{max}/\varepsilon_n$ of these runs"
    axes.plot(stiffness[along], yields, label=label, **figures.FORMULA_STYLE)
