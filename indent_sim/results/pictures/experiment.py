"""Picture of an experiment: force over depth and displacement of the base, and curves over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from indent_sim.results.pictures.axes import Axis, axis_of_column, time_axis
from indent_sim.results.pictures.curves import Interpolator, smooth_curve
from indent_sim.results.pictures.figures import (
    COLOURS,
    GREY,
    MAX_MARKED_POINTS,
    Axes,
    draw_figure_legend,
    draw_title,
    new_figure,
    save,
)
from indent_sim.results.pictures.run_names import config_by_key
from indent_sim.results.reader import read, read_history
from indent_sim.results.result_files import Report, read_report
from indent_sim.results.tables import EXPERIMENT

EXPERIMENT_PICTURE = "experiment.png"


def has_elastic_curve(folder: Path, report: Report) -> bool:
    """Return whether a run has an experiment to draw.

    An experiment can be drawn if experiment.csv has rows, or if the history was evaluated on the
    elastic curve.
    """
    return (folder / EXPERIMENT).exists() or (report.get("time") or {"way": "steps"}).get(
        "way"
    ) != "steps"


def draw(folder: Path, path: Path | None = None) -> None:
    """Draw the experiment of a result folder, by default into experiment.png in that folder."""
    results = read(folder)
    rows = read_history(folder)
    config = config_by_key(folder)
    has_times = not np.isnan(rows["t"][0])
    has_base = bool((rows["z"] != rows["delta"]).any())
    # Under force control the depth is drawn over time.
    is_force_controlled = any(
        config.get(f"{section}.force_history") for section in ("loading", "experiment")
    )
    panels = ["depth", *(["base"] if has_base else []), *(["time"] if has_times else ["radius"])]
    # A body that adheres to a flat has a contact below, too.
    panels += ["radius_below"] if "a_base" in rows else []
    with new_figure((3.1 + 3.3 * len(panels), 4.4)) as figure:
        panel_axes: dict[str, Axes] = figure.subplot_mosaic([panels])
        report = read_report(folder)
        method = (report.get("experiment") or {}).get("by") or (report.get("time") or {}).get(
            "method"
        )
        effects = [
            name
            for name in ("adhesion", "relaxation", "cantilever")
            if any(f".{name}." in f".{key}." for key in config)
        ]
        force = axis_of_column("force", [results])
        depth = axis_of_column("delta", [results])
        draw_branches(panel_axes["depth"], rows, "delta", depth, force)
        if has_base:
            draw_branches(
                panel_axes["base"], rows, "z", replace(depth, name="displacement of base z"), force
            )
        t = time_axis([results])
        if has_times and is_force_controlled:
            draw_branches(panel_axes["time"], rows, "t", t, depth, "delta")
        elif has_times:
            draw_branches(panel_axes["time"], rows, "t", t, force)
        else:
            draw_branches(panel_axes["radius"], rows, "a", axis_of_column("a", [results]), force)
        if "a_base" in rows:
            below = replace(axis_of_column("a", [results]), name="radius of the contact below")
            draw_branches(panel_axes["radius_below"], rows, "a_base", below, force)
        draw_figure_legend(figure, panel_axes["depth"])
        draw_title(
            figure,
            results.report.get("title") or folder.name,
            "  \N{MIDDLE DOT}  ".join([*([f"by {method}"] if method else []), *effects]),
        )
        save(figure, path or folder / EXPERIMENT_PICTURE)


def branch_ranges(branches: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield begin and end of each sequence of consecutive rows of the same branch."""
    changes = np.flatnonzero(branches[1:] != branches[:-1]) + 1
    return pairwise([0, *map(int, changes), len(branches)])


def draw_branches(
    axes: Axes,
    rows: Mapping[str, np.ndarray],
    abscissa: str,
    x: Axis,
    y: Axis,
    ordinate: str = "force",
    joined: Interpolator = smooth_curve,
) -> None:
    """Draw a column over another column, with a line through consecutive rows of each branch.

    Rows have markers if there are few of them.

    Parameters
    ----------
    axes
        The panel.
    rows
        Columns of the table, including `branch`.
    abscissa, ordinate
        Names of the columns.
    x, y
        Axes (label and unit) of the columns.
    joined
        Interpolation of the rows.
    """
    labelled: set[str] = set()
    branches = rows["branch"]
    styles = {
        "hold": (COLOURS[2], "-"),
        "retract": (COLOURS[1], "-"),
        "unstable": (GREY, "--"),
    }
    for begin, end in branch_ranges(branches):
        branch = str(branches[begin])
        piece = slice(max(begin - 1, 0), end)
        colour, style = styles.get(branch, (COLOURS[0], "-"))
        piece_x = x(rows[abscissa][piece])
        piece_y = y(rows[ordinate][piece])
        if len(piece_x) > 1:
            axes.plot(
                *joined(piece_x, piece_y),
                color=colour,
                ls=style,
                lw=1.5,
                label=None if branch in labelled else branch,
            )
            labelled.add(branch)
        if len(branches) <= MAX_MARKED_POINTS:
            # The line begins at the last row of the previous branch, which already has a marker.
            new_rows = slice(-(end - begin), None)
            axes.plot(
                piece_x[new_rows],
                piece_y[new_rows],
                ls="",
                marker="o",
                ms=4,
                color=colour,
                mec="white",
                mew=0.5,
            )
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.set(xlabel=x.label, ylabel=y.label)
