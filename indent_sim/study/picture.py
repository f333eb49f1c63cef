"""study.png: what accuracy costs. Force error against CPU seconds, and against the varied number if there is one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.results.pictures import canvas
from indent_sim.results.pictures.axes import in_picture
from indent_sim.study import table
from indent_sim.study.cases import short
from indent_sim.study.table import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_COLOURS = len(canvas.COLOURS)
MOST_NAMED = 8  # points of the front that are named
APART = (0.03, 0.045)  # of the panel's width or height: points that are nearer have no room for a number each
FEW_COLOURS, INCHES = 4, 0.2  # from how many groups on the picture grows, and by how much for each
MOST_LETTERS = 48  # of a name
SPAN = 3.0  # from which ratio of largest to smallest an axis is logarithmic
ONE_PERCENT = 0.01


def draw(rows: Sequence[Row], keys: Sequence[str], title: str, reference: str, path: Path) -> None:
    """Draw the picture of a study; without any error to show there is none."""
    shown = table.measured(rows)
    if not shown:
        path.unlink(missing_ok=True)
        return
    number = _one_number(shown, keys)
    groups = _groups(shown, keys, number)
    height = 5.0 + INCHES * max(0, len(groups) - FEW_COLOURS)
    with canvas.canvas((12.4 if number else 9.6, height)) as figure:
        panels: dict[str, Any] = figure.subplot_mosaic(
            [["work", "number", "names"] if number else ["work", "names"]],
            width_ratios=[1, 1, 0.62] if number else [1, 0.5],
        )
        failed = sum(row["status"] == "failed" for row in rows)
        runs = f"{len(rows)} runs" + (f", {failed} failed" if failed else "")
        canvas.head(figure, title, f"{runs}  ·  force error against {reference}")
        _work(panels["work"], groups)
        front = table.pareto(rows)
        named = _front(panels["work"], front)
        if number:
            _against(panels["number"], groups, number)
        _names(panels["names"], panels["work"], named, len(front), _telling(shown, keys))
        canvas.save(figure, path)


def _work(axes: Axes, groups: dict[str, list[Row]]) -> None:
    for i, (name, rows) in enumerate(groups.items()):
        look = _mark(i) | {"label": in_picture(name) or "runs"}
        axes.plot([row["cpu_s"] for row in rows], [_error(row) for row in rows], ls="", **look)
    _log_axes(axes, "CPU seconds of a run", [row["cpu_s"] for rows in groups.values() for row in rows], 1)


def _telling(rows: Sequence[Row], keys: Sequence[str]) -> list[str]:
    """The keys that vary, without those that another one decides: of keys that go together the first."""
    kept: list[str] = []
    for key in keys:
        values = {other: {short(row[other]) for row in rows} for other in (*kept, key)}
        pairs = {other: {(short(row[other]), short(row[key])) for row in rows} for other in kept}
        if len(values[key]) > 1 and all(len(pairs[other]) > len(values[other]) for other in kept):
            kept.append(key)
    return kept or list(keys)


def _front(axes: Axes, front: Sequence[Row]) -> list[Row]:
    """The Pareto front as a line, the points with room for it numbered; returns these."""
    points = [(row["cpu_s"], _error(row)) for row in front]
    axes.plot(*zip(*points, strict=True), color=canvas.INK, lw=1.2, zorder=2, label="Pareto front")
    places = axes.transLimits.transform(axes.transScale.transform(points))  # in parts of the panel
    named = _spread(_with_room(places))
    for number, i in enumerate(named, start=1):
        axes.annotate(f"{number}", points[i], xytext=(-6, -6), textcoords="offset points",
                      ha="right", va="top", fontsize=9, fontweight="bold")  # fmt: skip
    return [front[i] for i in named]


def _with_room(places: np.ndarray) -> list[int]:
    """The points of a front that lie apart from one another, the last among them."""
    kept = [len(places) - 1]
    for i in reversed(range(len(places) - 1)):
        if np.any(np.abs(places[i] - places[kept[-1]]) >= APART):
            kept.append(i)
    return kept[::-1]


def _spread(indices: list[int]) -> list[int]:
    """At most MOST_NAMED of them from the first to the last."""
    chosen = np.linspace(0, len(indices) - 1, min(MOST_NAMED, len(indices))).round().astype(int)
    return [indices[i] for i in chosen]


def _against(axes: Axes, groups: dict[str, list[Row]], key: str) -> None:
    for i, (name, rows) in enumerate(groups.items()):
        along = sorted((row for row in rows if row[key] is not None), key=lambda row: row[key])
        x = [row[key] for row in along]
        is_curve = len(set(x)) == len(x)  # else several curves share the colour
        axes.plot(
            x,
            [_error(row) for row in along],
            ls="-" if is_curve else "",
            lw=1.0,
            **_mark(i),
            label=in_picture(name),
        )
    _log_axes(
        axes, in_picture(key), [row[key] for rows in groups.values() for row in rows if row[key] is not None]
    )


def _names(axes: Axes, work: Axes, named: Sequence[Row], of: int, keys: Sequence[str]) -> None:
    """What the colours and the numbers on the front stand for."""
    axes.axis("off")
    handles, labels = work.get_legend_handles_labels()
    axes.legend(handles, labels, loc="upper left", fontsize=9, borderaxespad=0)
    lines = ["Pareto front" if len(named) == of else f"Pareto front, {len(named)} of its {of} points"]
    for number, row in enumerate(named, start=1):
        lines.append(f"{number}  {_brief(row, keys)}")
        lines.append(f"    {row['cpu_s']:.2g} s, {row['force_error_vs']:+.2g}")
    axes.text(0, 0, "\n".join(lines), fontsize=8, va="bottom", ha="left", linespacing=1.35, transform=axes.transAxes)


def _brief(row: Row, keys: Sequence[str]) -> str:
    """The telling keys of a row: words alone, numbers with their key."""
    parts = [f"{_last(key)} {short(row[key])}" if _is_number(row[key]) else short(row[key])
             for key in keys if row[key] is not None]  # fmt: skip
    text = ", ".join(parts)
    return in_picture(text, MOST_LETTERS)


def _last(key: str) -> str:
    return key.split(".")[-1]


def _groups(rows: Sequence[Row], keys: Sequence[str], number: str | None) -> dict[str, list[Row]]:
    """The rows by what few colours can tell apart: the contact method, else a varied word, else a number."""
    others = [key for key in keys if key != number]
    by_words = [key for key in others if not any(_is_number(row[key]) for row in rows)]
    methods = ["method"] if any(key.split(".")[0] == "contact" for key in keys) else []
    for key in [*methods, *by_words, *others]:
        values = list(dict.fromkeys(short(row[key]) for row in rows))
        if 1 < len(values) <= MOST_COLOURS:
            word = f"{_last(key)} " if key not in (*methods, *by_words) else ""
            return {f"{word}{value}": [row for row in rows if short(row[key]) == value] for value in values}
    return {"": list(rows)}


def _one_number(rows: Sequence[Row], keys: Sequence[str]) -> str | None:
    """The varied key whose values are numbers, when there is exactly one."""
    numeric = [key for key in keys if any(_is_number(row[key]) for row in rows)]
    several = [key for key in numeric if len({row[key] for row in rows}) > 1]
    return several[0] if len(several) == 1 else None


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _error(row: Row) -> float:
    return abs(row["force_error_vs"])


def _mark(i: int) -> dict[str, Any]:
    colour = canvas.COLOURS[i % MOST_COLOURS]
    return {"color": colour, "marker": canvas.MARKERS[i % 7], "ms": 6, "mec": "white", "mew": 0.6, "zorder": 3}




def _log_axes(axes: Axes, x: str, values: Sequence[float], span: float = SPAN) -> None:
    """|error| on a logarithmic axis, and the other logarithmic where its numbers span enough."""
    from matplotlib.ticker import LogLocator

    axes.set(yscale="log", xlabel=x, ylabel="|relative error of the force|")
    if min(values) > 0 and max(values) > span * min(values):
        axes.set_xscale("log")
        if (ratio := max(values) / min(values)) < 100:
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if ratio > 5 else (1, 1.5, 2, 3, 4, 5, 6, 8)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter("")
    axes.axhline(ONE_PERCENT, color=canvas.GREY, lw=0.6, ls=":", zorder=1)
    axes.annotate("1 %", (1, ONE_PERCENT), xycoords=("axes fraction", "data"), ha="right", va="bottom",
                  fontsize=8, color=canvas.GREY)  # fmt: skip
    axes.grid(True, which="major", color="#e4e4e4", lw=0.6, zorder=0)
    axes.margins(0.08)
