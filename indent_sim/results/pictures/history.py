"""History of a body that was solved step by step: force over depth, and quantities over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import curves
from indent_sim.results.pictures.axes import axis_of_column, plan_choice, time_axis
from indent_sim.results.pictures.curves import Points, smooth_curve
from indent_sim.results.pictures.experiment import branch_ranges, draw_branches
from indent_sim.results.pictures.figures import (
    GREY,
    Axes,
    draw_figure_legend,
    draw_title,
    new_figure,
    save,
)
from indent_sim.results.pictures.forces import (
    SIDE_PANEL,
    draw_side_force,
    slide_force_column,
    subtitle,
)
from indent_sim.results.reader import Results
from indent_sim.results.result_files import Report


def is_time_stepped(report: Report) -> bool:
    """Return whether the rows of a run are time steps of the whole body."""
    return (report.get("time") or {}).get("way") == "steps"


def draw(results: Results, path: Path) -> None:
    """Draw a history into a file: force over depth, and all columns that change over time."""
    panels = panel_names(results)
    columns = 2 if len(panels) in (2, 4) else min(len(panels), 3)
    rows = [panels[k : k + columns] for k in range(0, len(panels), columns)]
    rows[-1] += ["."] * (columns - len(rows[-1]))
    # Width and height of a panel [inches], and the width of a single panel.
    panel_size = (4.6, 3.5)
    single_panel_width = 6.4
    with new_figure(
        (panel_size[0] * columns if columns > 1 else single_panel_width, panel_size[1] * len(rows))
    ) as figure:
        panel_axes: dict[str, Axes] = figure.subplot_mosaic(rows)
        time = results.report.get("time") or {}
        subtitle_parts = [f"in time by {time.get('method', 'steps')}", subtitle(results)]
        for name in panels:
            if name == "curve":
                draw_branches(
                    panel_axes[name],
                    results.table,
                    "delta",
                    axis_of_column("delta", [results]),
                    axis_of_column("force", [results]),
                )
            elif name == SIDE_PANEL:
                draw_side_force(panel_axes[name], results, slide_force_column(results))
            else:
                _draw_over_time(panel_axes[name], results, name)
        _draw_limits(results, panel_axes, panel_axes[panels[0]])
        draw_figure_legend(figure, panel_axes[panels[0]])
        draw_title(
            figure,
            results.report.get("title") or path.parent.name,
            "  \N{MIDDLE DOT}  ".join(filter(None, subtitle_parts)),
        )
        save(figure, path)


def panel_names(results: Results) -> list[str]:
    """Return the panels: force over depth, columns drawn over time, side force over the slide."""
    force = results["force"]
    delta = results["delta"]
    is_loaded = bool(np.any(force != 0))
    names = ["curve"] if is_loaded and np.ptp(delta) > 0 else []
    names += ["force"] if np.ptp(force) > 0 else []
    names += ["delta"] if results.report.get("control") == "force" else []
    names += ["a"] if is_loaded else []
    names += (
        ["pore_pressure_max"] if np.any(results.table.get("pore_pressure_max", 0.0) > 0) else []
    )
    names += [SIDE_PANEL] if slide_force_column(results) else []
    return names or ["force"]


def _draw_over_time(axes: Axes, results: Results, name: str) -> None:
    """Draw a column over time, on a logarithmic axis if the times span decades."""
    t = time_axis([results])
    column = axis_of_column(name, [results])
    if not _spans_decades(results):
        draw_branches(axes, results.table, "t", t, column, name)
        return
    draw_branches(axes, results.table, "t", t, column, name, _smooth_log_time)
    axes.set_xscale("log")
    axes.set_xlim(t(first_visible_time(results)), 1.2 * t(results["t"][-1]))


def draw_over_time(axes: Axes, runs: Sequence[Results], names: Sequence[str]) -> None:
    """Draw the force of several results over time, or their depth if all forces are prescribed.

    Raises
    ------
    UsageError
        If a result has no times.
    """
    if runs_without_times := [run for run in runs if np.isnan(run.table.get("t", np.nan)).all()]:
        raise UsageError(
            f"{runs_without_times[0].path} has no times",
            "use loading.history or loading.force_history",
        )
    column_name = "delta" if all(run.report.get("control") == "force" for run in runs) else "force"
    t = time_axis(runs)
    column = axis_of_column(column_name, runs)
    is_wide = all(_spans_decades(run) for run in runs)
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        colour = curves.line_style(i, len(runs))["color"]
        label = name
        for begin, end in branch_ranges(run.table.get("branch", np.zeros(len(run)))):
            piece = slice(max(begin - 1, 0), end)
            points = (_smooth_log_time if is_wide else smooth_curve)(
                t(run["t"][piece]), column(run[column_name][piece])
            )
            axes.plot(*points, color=colour, lw=1.5, label=label)
            label = "_"  # Only the first line of a result is named in the legend.
    if is_wide:
        axes.set_xscale("log")
        axes.set_xlim(
            min(t(first_visible_time(run)) for run in runs),
            1.2 * max(t(run["t"][-1]) for run in runs),
        )
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.set(xlabel=t.label, ylabel=column.label)


def _smooth_log_time(t: np.ndarray, y: np.ndarray) -> Points:
    """Return a smooth curve over the logarithm of the times after 0."""
    after = t > 0
    along, fine = smooth_curve(np.log10(t[after]), y[after])
    return 10**along, fine


def _draw_limits(results: Results, panel_axes: dict[str, Axes], legend_axes: Axes) -> None:
    """Draw the force of a linear body before, and after, all flow and relaxation.

    The force is drawn at the largest depth. If forces are prescribed, the depth at the largest
    force is drawn instead.
    """
    column_name = "delta" if results.report.get("control") == "force" else "force"
    limits = (results.report.get("time") or {}).get("limits") or {}
    if column_name not in panel_axes or plan_choice(results.report, "strain") != "small":
        return
    value_axis = axis_of_column(column_name, [results])
    # Limits before, and after all flow and relaxation.
    styles = ("--", ":")
    for (name, value), style in zip(limits.items(), styles, strict=False):
        if value is not None:
            look = {"color": GREY, "ls": style, "lw": 1.1}
            panel_axes[column_name].axhline(float(value_axis(value)), zorder=1, **look)
            legend_axes.plot([], [], label=f"{name}, by theory", **look)


def first_visible_time(results: Results) -> float:
    """Return the first time after 0 at which the force is visible.

    If forces are prescribed, it is the first time at which the depth is visible.
    """
    size = np.abs(
        np.nan_to_num(results["delta" if results.report.get("control") == "force" else "force"])
    )
    later = results["t"] > 0
    # A force or depth is visible from this fraction of its largest value on.
    min_visible_fraction = 1e-3
    is_visible = later & (size >= min_visible_fraction * size.max(initial=0.0))
    return float(results["t"][np.argmax(is_visible if is_visible.any() else later)])


def _spans_decades(results: Results) -> bool:
    """Return whether the times of a history span decades, so that its time axis is logarithmic."""
    t = results["t"]
    # The time axis is logarithmic if the last time exceeds this multiple of the first visible one.
    log_ratio = 1e3
    return bool(t[0] >= 0 and t[-1] > 0 and t[-1] > log_ratio * first_visible_time(results))


def film_steps(results: Results, steps: Sequence[int]) -> list[int]:
    """Return about five of the steps for an animation.

    The steps are evenly spaced. In a history they are evenly spaced in the logarithm of time,
    beginning at the first visible time, and include the step of the largest force.
    """
    # Approximate number of states in a film.
    count = 5
    if len(steps) <= count + 1:
        return list(steps)
    if not is_time_stepped(results.report):
        return [steps[k] for k in np.linspace(0, len(steps) - 1, count).round().astype(int)]
    rows = np.searchsorted(results["step"], steps)
    begin = min(results["t"][0], 0.0)
    t = np.log(np.maximum(results["t"][rows] - begin, first_visible_time(results) - begin))
    chosen = {int(np.argmin(np.abs(t - at))) for at in np.linspace(t[0], t[-1], count)} | {
        len(steps) - 1
    }
    if np.any(results["force"][rows] > 0):
        chosen.add(int(np.argmax(results["force"][rows])))
    return [steps[k] for k in sorted(chosen)]
