"""Pictures of a study: its curves in curves.png, and in study.png what accuracy costs.

curves.png: force over depth of every run, and the last force, of histories the largest, over each
varied number; of histories with a hold what is left of the force's fall over the time, and when
half of it is over. study.png: force error against CPU seconds, and against the varied number if
there is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import wrap

import numpy as np

from indent_sim.config.strict_yaml import short
from indent_sim.results.folder import Report
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import axis_of_column, picture_text
from indent_sim.results.pictures.curves import smooth_curve
from indent_sim.results.pictures.figures import FORMULA_STYLE, Axes, Figure, PlotStyle
from indent_sim.results.pictures.forces import draw_force, draw_force_lines
from indent_sim.results.reader import MEASURED, Results
from indent_sim.results.relaxation_in_hold import HoldRelaxation, first_hold
from indent_sim.studies import multiples, study_table
from indent_sim.studies.curve_table import Families, told_apart
from indent_sim.studies.multiples import (
    DASHES,
    LOG_SPAN,
    MOST_COLOURS,
    MOST_GROUPS,
    few_decades,
    groups_of,
    label_of,
    looks_by,
    span,
)
from indent_sim.studies.study_table import Row

MOST_NAMED = 8  # points of the front that are named
LABEL_DISTANCE = (
    0.03,
    0.045,
)  # of the panel's width or height: points that are nearer have no room for a number each
# from how many groups on the picture grows, and by how much for each
FEW_COLOURS = 4
INCHES = 0.2
MOST_LEGEND_LETTERS = 48  # of a name
NAME_LETTERS = 44  # of a line of what a point of the front is, of which there are two
SPAN = 3.0  # from which ratio of largest to smallest an axis is logarithmic
ONE_PERCENT = 0.01
CURVE_PANEL = 4.4  # inches: width and height of the panels of curves.png
BAR_WIDTH = 0.2  # inches: width of a bar of colours
MOST_ABREAST = 24  # letters of names of which two stand side by side below a panel
NAMES_HEIGHT = (
    1.4  # inches: of names below a panel that take room from it; more make the picture higher
)
MOST_CURVES_NAMED = 8  # beside the panels
SAME_FORMULA = 1e-3  # relative, between points of a curve
# inches of a line of the scoreboard; per cent where its axis turns logarithmic
BOARD_LINE = 0.27
LEAST = 0.1
BOARD_MARK: PlotStyle = {"ls": "", "marker": "o", "ms": 6, "zorder": 3}
LOG_FORCES = 1000.0  # likewise depths and forces: on linear axes most curves would lie on zero


def draw(rows: Sequence[Row], keys: Sequence[str], title: str, reference: str, path: Path) -> None:
    """Draw the picture of a study; without any error to show there is none."""
    shown = study_table.measured(rows)
    if not shown:
        path.unlink(missing_ok=True)
        return
    several = [
        key for key in keys if _is_numeric(shown, key) and len({row[key] for row in shown}) > 1
    ]
    number = several[0] if len(several) == 1 else None
    groups = _groups(shown, keys, number)
    height = 5.0 + INCHES * max(0, len(groups) - FEW_COLOURS)
    names, widths = (
        (["work", "number", "names"], [1, 1, 0.62]) if number else (["work", "names"], [1, 0.5])
    )
    with figures.new_figure((12.4 if number else 9.6, height)) as figure:
        panels: dict[str, Axes] = figure.subplot_mosaic([names], width_ratios=widths)
        failed = sum(row["status"] == "failed" for row in rows)
        runs = f"{len(rows)} runs" + (f", {failed} failed" if failed else "")
        figures.draw_title(figure, title, f"{runs}  ·  force error against {reference}")
        _work(panels["work"], groups)
        front = study_table.pareto(rows)
        named = _front(panels["work"], front)
        if number:
            _against(panels["number"], groups, number)
        words = {key: _words(shown, key) for key in study_table.telling(shown, keys)}
        _names(panels["names"], panels["work"], named, len(front), words)
        figures.save(figure, path)


def draw_curves(families: Families, title: str, path: Path) -> None:
    """Draw the curves of a study's runs, and their last forces over every varied number; without a
    run nothing.
    """
    if not families.curves:
        path.unlink(missing_ok=True)
        return
    with curves_pictured(families, title) as figure:
        figures.save(figure, path)


@contextmanager
def curves_pictured(families: Families, title: str) -> Iterator[Figure]:
    """The figure of the curves of a study's runs, of which there is at least one; of many that
    differ in several keys small multiples.
    """
    holds = [first_hold(curve.results) for curve in families.curves]
    if len(families.keys) > 1 and len(families.curves) > MOST_CURVES_NAMED and not _all_held(holds):
        with multiples.pictured(families, title) as figure:
            yield figure
        return
    # panels
    numbers = families.numeric()[:3]
    count = len(families.curves)
    is_coloured = len(numbers) > 0 and (len(families.keys) == 1 or count > MOST_CURVES_NAMED)
    looks, names = _looks_of_all(families)
    longest = min(max(map(len, names), default=0), MOST_LEGEND_LETTERS)
    beside = 0.9 if is_coloured or not any(names) else 0.7 + figures.LETTER_WIDTH * longest
    groups = {key: groups_of(families, key) for key in numbers}
    named = {key: list(found) for key, found in groups.items() if _group_looks(families, key)}
    abreast = (
        2
        if max((len(name) for known in named.values() for name in known), default=0) <= MOST_ABREAST
        else 1
    )
    lines = figures.LINE_HEIGHT * max(
        [0, *(-(-len(known) // abreast) + 1 for known in named.values())]
    )
    height = CURVE_PANEL + max(0.0, lines - NAMES_HEIGHT)
    widths = [*[CURVE_PANEL] * (1 + len(numbers)), BAR_WIDTH if is_coloured else beside]
    rows = [["curves", *numbers, "names"]]
    heights = [height - lines]
    if named:
        rows = [
            *rows,
            ["curves", *(f"{key} groups" if key in named else key for key in numbers), "names"],
        ]
        heights = [*heights, lines]
    with figures.new_figure((CURVE_PANEL * (1 + len(numbers)) + beside, height)) as figure:
        axes: dict[str, Axes] = figure.subplot_mosaic(
            rows, width_ratios=widths, height_ratios=heights
        )
        held = "what is left of the force's fall while the tip stands still"
        shown = held if _all_held(holds) else "every force at its run's own depth"
        figures.draw_title(figure, title, f"{count} run{'s' * (count > 1)}  ·  {shown}")
        if is_coloured:
            looks, colours = looks_by(families, numbers[0])
            names = [""] * count
            label = label_of(families, numbers[0])
            figure.colorbar(colours, cax=axes["names"], label=label).outline.set_visible(False)
        _curves(axes["curves"], families, looks, names, holds)
        for key in numbers:
            _over(axes[key], families, key, looks, holds)
            if key in named:
                figures.draw_legend_panel(axes[f"{key} groups"], axes[key], abreast)
        if not is_coloured:
            figures.draw_legend_panel(axes["names"], axes["curves"])
            if (
                inside := axes["curves"].get_legend()
            ) is not None:  # what it names is named beside, too
                inside.remove()
        yield figure


def _looks_of_all(families: Families) -> tuple[list[PlotStyle], list[str]]:
    """The look of every curve, and the name of the first with each look: of few curves their own,
    of many those of what varies first; where that has too many values for colours all are grey
    and have none.
    """
    names = families.apart()
    looks = _told_by(families, families.keys) if len(set(names)) <= MOST_CURVES_NAMED else None
    if looks is None:
        names = families.names(families.keys[:1])
        looks = _told_by(families, families.keys[:1])
    if looks is None:
        return [{"color": figures.GREY, "ls": "-"} for _ in names], [""] * len(names)
    return looks, [name if names.index(name) == i else "" for i, name in enumerate(names)]


def _told_by(families: Families, keys: Sequence[str]) -> list[PlotStyle] | None:
    """The look of every curve by these varied keys, a colour for each of their values, or of more
    than there are colours a colour for each value of one key and dashes for those of the others;
    None where that is not enough.
    """
    for by, others in ((keys, ()), (keys[:1], keys[1:]), (keys[1:], keys[:1])):
        colours = families.names(by)
        dashes = families.names(others)
        known = list(dict.fromkeys(colours))
        kinds = list(dict.fromkeys(dashes))
        if len(known) <= MOST_COLOURS and len(kinds) <= len(DASHES):
            places = [
                (known.index(one), kinds.index(other))
                for one, other in zip(colours, dashes, strict=True)
            ]
            return [
                {"color": figures.COLOURS[one], "marker": figures.MARKERS[one], "ls": DASHES[other]}
                for one, other in places
            ]
    return None


def _group_looks(families: Families, key: str) -> list[PlotStyle] | None:
    """The look of every curve in a panel over a varied number, where a few named lines differ in
    the others; else None.
    """
    others = [other for other in families.keys if other != key]
    few = 1 < len(set(families.names(others))) <= MOST_GROUPS
    return _told_by(families, others) if few else None


def draw_scoreboard(rows: Sequence[Row], title: str, path: Path) -> None:
    """Draw how far published values, and ours with their error bars, are from the exact ones;
    without any nothing.

    The axis is linear to LEAST per cent on both sides of 0 and logarithmic beyond.
    """
    known = [row for row in rows if row["exact"] is not None][::-1]  # the first on top
    if not known:
        path.unlink(missing_ok=True)
        return
    with figures.new_figure((9.2, 1.6 + BOARD_LINE * len(known))) as figure:
        axes = figure.subplots()
        wrong = sum(row["wrong"] in ("published", "both") for row in known)
        said = f"{len(known)} published values  ·  {wrong} off by more than they claim"
        figures.draw_title(figure, title, f"{said}  ·  ours with its own error bar")
        for place, row in enumerate(known):
            _board_line(axes, place, row)
        axes.plot([], [], color=figures.INK, **BOARD_MARK, label="published")
        if wrong:
            axes.plot(
                [],
                [],
                color=figures.COLOURS[1],
                **BOARD_MARK,
                label="published, off by more than it claims",
            )
        axes.set_yticks(
            range(len(known)),
            [picture_text(f"{row['case']}: {row['quantity']}", 48) for row in known],
        )
        axes.set_xscale("symlog", linthresh=LEAST)
        far = max(1.0, *(abs(row["difference"]) for row in known))
        ticks = [
            tick for tick in (-100, -10, -1, -LEAST, 0, LEAST, 1, 10, 100) if abs(tick) <= 3 * far
        ]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xlim(-3 * far, 3 * far)
        axes.axvline(0, color=figures.INK, lw=0.8, zorder=1)
        axes.set(xlabel="difference from the exact value [%]", ylim=(-0.7, len(known) - 0.3))
        figures.draw_figure_legend(figure, axes)
        figures.save(figure, path)


def _board_line(axes: Axes, place: int, row: Row) -> None:
    """One published value: what it claims as a bar, where it lies, and ours."""
    claimed = 100 * (row["within"] or 0.0)
    is_first = place == 0
    band = {"color": "#d9d9d9", "height": 0.6, "zorder": 0}
    said = "claimed by the source, where it says so" if is_first else None
    axes.barh(place, 2 * claimed, left=-claimed, label=said, **band)
    colour = figures.COLOURS[1] if row["wrong"] in ("published", "both") else figures.INK
    axes.plot(row["difference"], place, color=colour, **BOARD_MARK)
    if row["ours_difference"] is not None:
        bar = 100 * abs((row["our_error"] or 0.0) / row["exact"])
        look: PlotStyle = {
            "fmt": "s",
            "ms": 4,
            "capsize": 3,
            "color": figures.COLOURS[0],
            "zorder": 4,
        }
        axes.errorbar(
            row["ours_difference"], place, xerr=bar, label="ours" if is_first else None, **look
        )


Holds = Sequence[HoldRelaxation | None]


def _curves(
    axes: Axes, families: Families, looks: Sequence[PlotStyle], names: Sequence[str], holds: Holds
) -> None:
    """Force over depth of every run; where all hold, what is left of the fall in the hold over the
    time.
    """
    runs = [curve.results for curve in families.curves]
    said = [
        picture_text(name, MOST_LEGEND_LETTERS) or "_" for name in names
    ]  # what begins with _ is no name
    if held := _all_held(holds):
        for hold, look, name in zip(held, looks, said, strict=True):
            axes.plot(
                hold.t[1:],
                hold.remaining_fraction[1:],
                color=look["color"],
                ls=look["ls"],
                lw=1.5,
                label=name,
            )
        axes.set(
            xscale="log",
            xlabel=f"time in the hold t{_seconds(families)}",
            ylabel="left of the fall of the force",
        )
        axes.axhline(0.5, color=figures.GREY, lw=0.6, ls=":", zorder=0)
        return
    depth = axis_of_column("delta", runs)
    force = axis_of_column("force", runs)
    if len(runs) > MOST_CURVES_NAMED and {*said} == {"_"} and all(_is_curve(run) for run in runs):
        draw_force_lines(axes, runs, depth, force, looks)
    else:
        for run, look, name in zip(runs, looks, said, strict=True):
            draw_force(axes, run, depth, force, look | {"marker": ""}, name)
    if hertz := _formula_of_all(runs):
        drawn = depth([0, *hertz["curve"]["delta"]]), force([0, *hertz["curve"]["force"]])
        (line,) = axes.plot(
            *smooth_curve(*drawn),
            **FORMULA_STYLE,
            label=picture_text(f"{hertz['name']}, half-space"),
        )
        axes.legend(handles=[line], loc="upper left")  # where no force is
    axes.set(xlabel=depth.label, ylabel=force.label)
    if span([run["delta"].max() for run in runs]) >= LOG_FORCES:
        axes.set_xscale("log")
    if span([run["force"].max() for run in runs]) >= LOG_FORCES:
        axes.set_yscale("log")
    else:
        axes.axhline(0, color=figures.GREY, lw=0.6, zorder=0)


def _is_curve(run: Results) -> bool:
    """Whether a line goes through its rows: one alone has a mark, measured ones are points."""
    return len(run) > 1 and not run.report.get(MEASURED)


def _formula_of_all(runs: Sequence[Results]) -> Report | None:
    """The half-space formula beside all runs, where it is one and the same for them; of the run
    that goes deepest.
    """
    found = [(run.report.get("theory") or {}).get("half_space") or {} for run in runs]
    if not all(
        one.get("curve", {}).get("delta") and one["curve"]["delta"][-1] > 0 for one in found
    ):
        return None
    deepest: Report = max(found, key=lambda one: float(one["curve"]["delta"][-1]))
    x, y = (np.array([0.0, *deepest["curve"][name]]) for name in ("delta", "force"))
    ends = [(one["curve"]["delta"][-1], one["curve"]["force"][-1]) for one in found]
    is_one = all(
        abs(np.interp(delta, *smooth_curve(x, y)) / force - 1) < SAME_FORMULA
        for delta, force in ends
        if force
    )
    return deepest if is_one else None


def _seconds(families: Families) -> str:
    """The unit of times, of scenes that have units."""
    return (
        " [s]"
        if any((curve.results.report.get("units") or {}).get("length") for curve in families.curves)
        else ""
    )


def _all_held(holds: Holds) -> list[HoldRelaxation]:
    """The holds where every run has one in which its force falls; none else."""
    held = [hold for hold in holds if hold and hold.half_time == hold.half_time]
    return held if len(held) == len(holds) else []


def _over(
    axes: Axes, families: Families, key: str, looks: Sequence[PlotStyle], holds: Holds
) -> None:
    """The last force of every run, of histories the largest, over a varied number, or when half of
    its fall in a hold is over; a line for each group of those that differ in it alone, with the
    looks of the curves where it has no name.
    """
    force = axis_of_column("force", [curve.results for curve in families.curves])
    held = _all_held(holds)
    own = _group_looks(families, key)
    values = families.numbers(key)
    y = [hold.half_time for hold in held] or [
        float(force(_told_force(curve.results))) for curve in families.curves
    ]
    for name, places in groups_of(families, key).items():
        along = sorted(places, key=lambda place: values[place])
        x_y = [values[place] for place in along], [y[place] for place in along]
        if own:
            axes.plot(*x_y, lw=1.0, ms=5, **own[along[0]], label=picture_text(name))
            continue
        axes.plot(*x_y, lw=1.0, color=figures.GREY, zorder=1)
        axes.scatter(*x_y, s=14, color=[looks[place]["color"] for place in along], zorder=2)
    in_time = all("t" in curve.results.table for curve in families.curves)
    if span(values) > (1.0 if held else LOG_SPAN):
        axes.set_xscale("log")
        few_decades(axes.xaxis, span(values))
    if held or span(y) >= LOG_FORCES:
        axes.set_yscale("log")
    axes.set(
        xlabel=label_of(families, key),
        ylabel=f"half of the fall is over at t{_seconds(families)}"
        if held
        else f"{'largest' if in_time else 'last'} {force.label}",
    )


def _told_force(run: Results) -> float:
    return float(run["force"][study_table.answer_row(run)])


def _work(axes: Axes, groups: dict[str, list[Row]]) -> None:
    for i, (name, rows) in enumerate(groups.items()):
        look = _mark(i) | {"label": picture_text(name) or "runs"}
        axes.plot([row["cpu_s"] for row in rows], [_error(row) for row in rows], ls="", **look)
    _log_axes(
        axes, "CPU seconds of a run", [row["cpu_s"] for rows in groups.values() for row in rows], 1
    )


def _front(axes: Axes, front: Sequence[Row]) -> list[Row]:
    """The Pareto front as a line, the points with room for it numbered; returns these."""
    points = [(row["cpu_s"], _error(row)) for row in front]
    axes.plot(*zip(*points, strict=True), color=figures.INK, lw=1.2, zorder=2, label="Pareto front")
    places = axes.transLimits.transform(axes.transScale.transform(points))  # in parts of the panel
    apart = _with_room(places)
    named = [
        apart[i]
        for i in np.linspace(0, len(apart) - 1, min(MOST_NAMED, len(apart))).round().astype(int)
    ]
    left_below: PlotStyle = {
        "xytext": (-6, -6),
        "textcoords": "offset points",
        "ha": "right",
        "va": "top",
    }
    for number, i in enumerate(named, start=1):
        axes.annotate(f"{number}", points[i], fontsize=9, fontweight="bold", **left_below)
    return [front[i] for i in named]


def _with_room(places: np.ndarray) -> list[int]:
    """The points of a front that lie apart from one another, the last among them."""
    kept = [len(places) - 1]
    for i in reversed(range(len(places) - 1)):
        if np.any(np.abs(places[i] - places[kept[-1]]) >= LABEL_DISTANCE):
            kept.append(i)
    return kept[::-1]


def _against(axes: Axes, groups: dict[str, list[Row]], key: str) -> None:
    for i, (name, rows) in enumerate(groups.items()):
        along = sorted((row for row in rows if row[key] is not None), key=lambda row: row[key])
        x = [row[key] for row in along]
        style = "-" if len(set(x)) == len(x) else ""  # else several curves share the colour
        axes.plot(
            x,
            [_error(row) for row in along],
            ls=style,
            lw=1.0,
            **_mark(i),
            label=picture_text(name),
        )
    _log_axes(
        axes,
        picture_text(key),
        [row[key] for rows in groups.values() for row in rows if row[key] is not None],
    )


def _names(
    axes: Axes, work: Axes, named: Sequence[Row], of: int, words: dict[str, dict[str, str]]
) -> None:
    """What the colours and the numbers on the front stand for."""
    axes.axis("off")
    handles, labels = work.get_legend_handles_labels()
    axes.legend(handles, labels, loc="upper left", fontsize=9, borderaxespad=0)
    lines = [
        "Pareto front" if len(named) == of else f"Pareto front, {len(named)} of its {of} points"
    ]
    for number, row in enumerate(named, start=1):
        first, *rest = wrap(_brief(row, words), NAME_LETTERS) or [""]
        cost = f"{row['cpu_s']:.2g} s, {row['force_error_vs']:+.2g}"
        room = max(1, NAME_LETTERS - len(cost))
        more = [picture_text(" ".join(rest), room)] if rest else []
        lines += [f"{number}  {picture_text(first)}", "    " + ": ".join([*more, cost])]
    axes.text(
        0,
        0,
        "\n".join(lines),
        fontsize=8,
        va="bottom",
        ha="left",
        linespacing=1.35,
        transform=axes.transAxes,
    )


def _brief(row: Row, words: dict[str, dict[str, str]]) -> str:
    """The telling keys of a row: words alone, numbers and lists of them with their key."""
    said = {key: known[short(row[key])] for key, known in words.items() if row[key] is not None}
    has_key = {key: _is_number(row[key]) or said[key].startswith("[") for key in said}
    parts = [f"{key.split('.')[-1]} {word}" if has_key[key] else word for key, word in said.items()]
    return ", ".join(parts)


def _words(rows: Sequence[Row], key: str) -> dict[str, str]:
    """The values of a key in words, by the values in full."""
    values = [row[key] for row in rows]
    return dict(zip(map(short, values), told_apart(values), strict=True))


def _groups(rows: Sequence[Row], keys: Sequence[str], number: str | None) -> dict[str, list[Row]]:
    """The rows by what few colours can tell apart: the contact method, else a varied word, else a
    number.
    """
    others = [key for key in keys if key != number]
    by_words = [key for key in others if not _is_numeric(rows, key)]
    methods = ["method"] if any(key.split(".")[0] == "contact" for key in keys) else []
    for key in [*methods, *by_words, *others]:
        values = _words(rows, key)
        if 1 < len(values) <= MOST_COLOURS:
            word = f"{key.split('.')[-1]} " if any(_is_number(row[key]) for row in rows) else ""
            return {
                f"{word}{said}": [row for row in rows if short(row[key]) == value]
                for value, said in values.items()
            }
    return {"": list(rows)}


def _is_numeric(rows: Sequence[Row], key: str) -> bool:
    """Whether every known value of a varied key is a number: `friction: [0.1, stick]` has words
    too.
    """
    return all(_is_number(row[key]) for row in rows if row[key] is not None)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _error(row: Row) -> float:
    return abs(row["force_error_vs"])


def _mark(i: int) -> PlotStyle:
    colour = figures.COLOURS[i % MOST_COLOURS]
    return {
        "color": colour,
        "marker": figures.MARKERS[i % 7],
        "ms": 6,
        "mec": "white",
        "mew": 0.6,
        "zorder": 3,
    }


def _log_axes(axes: Axes, x: str, values: Sequence[float], span: float = SPAN) -> None:
    """|error| on a logarithmic axis, and the other logarithmic where its numbers span enough."""
    axes.set(yscale="log", xlabel=x, ylabel="|relative error of the force|")
    if min(values) > 0 and max(values) > span * min(values):
        axes.set_xscale("log")
        few_decades(axes.xaxis, max(values) / min(values))
    axes.axhline(ONE_PERCENT, color=figures.GREY, lw=0.6, ls=":", zorder=1)
    at_right: PlotStyle = {
        "xycoords": ("axes fraction", "data"),
        "ha": "right",
        "va": "bottom",
        "fontsize": 8,
    }
    axes.annotate("1 %", (1, ONE_PERCENT), color=figures.GREY, **at_right)
    axes.grid(True, which="major", color="#e4e4e4", lw=0.6, zorder=0)
    axes.margins(0.08)
