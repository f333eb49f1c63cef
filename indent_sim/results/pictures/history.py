"""A history of a body that is followed row by row: force over depth, and over time what the tip and
the fluid do.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.folder import Report
from indent_sim.results.pictures import curves
from indent_sim.results.pictures.axes import axis, choice, time_axis
from indent_sim.results.pictures.canvas import GREY, Axes, canvas, head, legend_below, save
from indent_sim.results.pictures.curves import Points, smooth
from indent_sim.results.pictures.experiment import draw_branches, pieces
from indent_sim.results.pictures.forces import subtitle
from indent_sim.results.reader import Results

# inches of a panel, and the width of one that is alone
PANEL_SIZE = (4.6, 3.5)
LONE_WIDTH = 6.4
LOG_RATIO = (
    1e3  # last time over the first one that is seen, from which on the axis of times is logarithmic
)
LEAST_SEEN = 1e-3  # of the largest force, or depth, from which on something is seen
STATES = 5  # of a film
LIMIT_STYLES = ("--", ":")  # before anything has flowed or relaxed, and when all has


def is_of_body(report: Report) -> bool:
    """Whether the rows of a run are steps in time of the whole body."""
    return (report.get("time") or {}).get("way") == "steps"


def draw(results: Results, path: Path) -> None:
    """Draw the rows of a run in time: what its force does over depth, and over time what changes."""
    panels = shown(results)
    across = 2 if len(panels) in (2, 4) else min(len(panels), 3)
    rows = [panels[k : k + across] for k in range(0, len(panels), across)]
    rows[-1] += ["."] * (across - len(rows[-1]))
    with canvas(
        (PANEL_SIZE[0] * across if across > 1 else LONE_WIDTH, PANEL_SIZE[1] * len(rows))
    ) as figure:
        drawn: dict[str, Axes] = figure.subplot_mosaic(rows)
        time = results.report.get("time") or {}
        said = [f"in time by {time.get('method', 'steps')}", subtitle(results)]
        for name in panels:
            if name == "curve":
                draw_branches(
                    drawn[name],
                    results.table,
                    "delta",
                    axis("delta", [results]),
                    axis("force", [results]),
                )
            else:
                _draw_over_time(drawn[name], results, name)
        _draw_limits(results, drawn, drawn[panels[0]])
        legend_below(figure, drawn[panels[0]])
        head(
            figure,
            results.report.get("title") or path.parent.name,
            "  \N{MIDDLE DOT}  ".join(filter(None, said)),
        )
        save(figure, path)


def shown(results: Results) -> list[str]:
    """The panels: "curve", the force over a depth that changes, and columns that change over time;
    one at least.
    """
    force = results["force"]
    delta = results["delta"]
    is_loaded = bool(np.any(force != 0))
    found = ["curve"] if is_loaded and np.ptp(delta) > 0 else []
    found += ["force"] if np.ptp(force) > 0 else []
    found += ["delta"] if results.report.get("control") == "force" else []
    found += ["a"] if is_loaded else []
    found += (
        ["pore_pressure_max"] if np.any(results.table.get("pore_pressure_max", 0.0) > 0) else []
    )
    return found or ["force"]


def _draw_over_time(axes: Axes, results: Results, name: str) -> None:
    """A column over the time, logarithmic where most would else stand at its left end."""
    t = time_axis([results])
    column = axis(name, [results])
    if not _spans_decades(results):
        draw_branches(axes, results.table, "t", t, column, name)
        return
    draw_branches(axes, results.table, "t", t, column, name, _smooth_in_log)
    axes.set_xscale("log")
    axes.set_xlim(t(first_seen(results)), 1.2 * t(results["t"][-1]))


def draw_over_time(axes: Axes, runs: Sequence[Results], names: Sequence[str]) -> None:
    """What answers in each of several runs over their times: the force, or where all prescribe it
    the depth.

    UsageError for a run without times.
    """
    if bare := [run for run in runs if np.isnan(run.table.get("t", np.nan)).all()]:
        raise UsageError(
            f"{bare[0].path} has no times", "loading.history and force_history give some"
        )
    asked = "delta" if all(run.report.get("control") == "force" for run in runs) else "force"
    t = time_axis(runs)
    column = axis(asked, runs)
    is_wide = all(_spans_decades(run) for run in runs)
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        colour = curves.look(i, len(runs))["color"]
        label = name
        for begin, end in pieces(run.table.get("branch", np.zeros(len(run)))):
            piece = slice(max(begin - 1, 0), end)
            points = (_smooth_in_log if is_wide else smooth)(
                t(run["t"][piece]), column(run[asked][piece])
            )
            axes.plot(*points, color=colour, lw=1.5, label=label)
            label = "_"  # named once
    if is_wide:
        axes.set_xscale("log")
        axes.set_xlim(
            min(t(first_seen(run)) for run in runs), 1.2 * max(t(run["t"][-1]) for run in runs)
        )
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.set(xlabel=t.label, ylabel=column.label)


def _smooth_in_log(t: np.ndarray, y: np.ndarray) -> Points:
    """A smooth curve over the logarithm of times, of those after 0."""
    after = t > 0
    along, fine = smooth(np.log10(t[after]), y[after])
    return 10**along, fine


def _draw_limits(results: Results, drawn: dict[str, Axes], named: Axes) -> None:
    """What a linear body does before anything has flowed or relaxed, and when all has: the force at
    the deepest depth, or the depth of the largest force.
    """
    asked = "delta" if results.report.get("control") == "force" else "force"
    limits = (results.report.get("time") or {}).get("limits") or {}
    if asked not in drawn or choice(results.report, "strain") != "small":
        return
    along = axis(asked, [results])
    for (name, value), style in zip(limits.items(), LIMIT_STYLES, strict=False):
        if value is not None:
            look = {"color": GREY, "ls": style, "lw": 1.1}
            drawn[asked].axhline(float(along(value)), zorder=1, **look)
            named.plot([], [], label=f"{name}, by theory", **look)


def first_seen(results: Results) -> float:
    """The first time after 0 at which a force, or where forces are prescribed a depth, is there to
    be seen.
    """
    size = np.abs(
        np.nan_to_num(results["delta" if results.report.get("control") == "force" else "force"])
    )
    later = results["t"] > 0
    seen = later & (size >= LEAST_SEEN * size.max(initial=0.0))
    return float(results["t"][np.argmax(seen if seen.any() else later)])


def _spans_decades(results: Results) -> bool:
    """Whether most of what happens would stand at the left end of the axis."""
    t = results["t"]
    return bool(t[0] >= 0 and t[-1] > 0 and t[-1] > LOG_RATIO * first_seen(results))


def spread(results: Results, steps: Sequence[int]) -> list[int]:
    """About STATES of some steps for a film: evenly, of a body in time over the logarithm of time
    from what is first seen on, and with that of the largest force.
    """
    if len(steps) <= STATES + 1:
        return list(steps)
    if not is_of_body(results.report):
        return [steps[k] for k in np.linspace(0, len(steps) - 1, STATES).round().astype(int)]
    rows = np.searchsorted(results["step"], steps)
    begin = min(results["t"][0], 0.0)
    t = np.log(np.maximum(results["t"][rows] - begin, first_seen(results) - begin))
    chosen = {int(np.argmin(np.abs(t - at))) for at in np.linspace(t[0], t[-1], STATES)} | {
        len(steps) - 1
    }
    if np.any(results["force"][rows] > 0):
        chosen.add(int(np.argmax(results["force"][rows])))
    return [steps[k] for k in sorted(chosen)]
