"""The experiment in a picture: force over depth and the way of the base, force or depth over time,
as experiment.csv says.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from indent_sim.results.folder import Report, read_report
from indent_sim.results.pictures.axes import Axis, axis, time_axis
from indent_sim.results.pictures.canvas import (
    COLOURS,
    GREY,
    MANY,
    Axes,
    canvas,
    head,
    legend_below,
    save,
)
from indent_sim.results.pictures.curves import Joined, smooth
from indent_sim.results.pictures.names import config_of
from indent_sim.results.reader import read, read_curve
from indent_sim.results.tables import EXPERIMENT

EXPERIMENT_PICTURE = "experiment.png"
LOOKS = {
    "hold": (COLOURS[2], "-"),
    "retract": (COLOURS[1], "-"),
    "unstable": (GREY, "--"),
}  # of branches


def is_there(folder: Path, report: Report) -> bool:
    """Whether a run has rows of its elastic curve: an experiment, or a history that was followed on
    it.
    """
    return (folder / EXPERIMENT).exists() or (report.get("time") or {"way": "steps"}).get(
        "way"
    ) != "steps"


def draw(folder: Path, path: Path | None = None) -> None:
    """Draw the experiment of a result folder [into it, as experiment.png]."""
    results = read(folder)
    rows = read_curve(folder)
    config = config_of(folder)
    has_times = not np.isnan(rows["t"][0])
    has_base = bool((rows["z"] != rows["delta"]).any())
    has_forces = any(
        config.get(f"{section}.force_history") for section in ("loading", "experiment")
    )  # time tells depth
    panels = ["depth", *(["base"] if has_base else []), *(["time"] if has_times else ["radius"])]
    with canvas((3.1 + 3.3 * len(panels), 4.4)) as figure:
        drawn: dict[str, Axes] = figure.subplot_mosaic([panels])
        report = read_report(folder)
        by = (report.get("experiment") or {}).get("by") or (report.get("time") or {}).get(
            "method", "?"
        )
        effects = [
            name
            for name in ("adhesion", "relaxation", "cantilever")
            if any(f".{name}." in f".{key}." for key in config)
        ]
        head(
            figure,
            results.report.get("title") or folder.name,
            "  \N{MIDDLE DOT}  ".join([f"by {by}", *effects]),
        )
        force = axis("force", [results])
        depth = axis("delta", [results])
        draw_branches(drawn["depth"], rows, "delta", depth, force)
        if has_base:
            draw_branches(drawn["base"], rows, "z", replace(depth, name="way of the base z"), force)
        t = time_axis([results])
        if has_times and has_forces:
            draw_branches(drawn["time"], rows, "t", t, depth, "delta")
        elif has_times:
            draw_branches(drawn["time"], rows, "t", t, force)
        else:
            draw_branches(drawn["radius"], rows, "a", axis("a", [results]), force)
        legend_below(figure, drawn["depth"])
        save(figure, path or folder / EXPERIMENT_PICTURE)


def pieces(branches: np.ndarray) -> Iterator[tuple[int, int]]:
    """Where each piece of one branch begins, and where it ends."""
    changes = np.flatnonzero(branches[1:] != branches[:-1]) + 1
    return pairwise([0, *map(int, changes), len(branches)])


def draw_branches(
    axes: Axes,
    rows: Mapping[str, np.ndarray],
    name: str,
    x: Axis,
    y: Axis,
    of: str = "force",
    joined: Joined = smooth,
) -> None:
    """A column over another, a line for each branch that is one piece of the table; marks where
    rows are few.

    joined: the line through the rows.
    """
    seen: set[str] = set()
    branches = rows["branch"]
    for begin, end in pieces(branches):
        branch = str(branches[begin])
        piece = slice(max(begin - 1, 0), end)
        colour, style = LOOKS.get(branch, (COLOURS[0], "-"))
        across = x(rows[name][piece])
        up = y(rows[of][piece])
        if len(across) > 1:
            axes.plot(
                *joined(across, up),
                color=colour,
                ls=style,
                lw=1.5,
                label=None if branch in seen else branch,
            )
            seen.add(branch)
        if len(branches) <= MANY:
            own = slice(-(end - begin), None)  # a piece begins with the last row of the one before
            axes.plot(
                across[own], up[own], ls="", marker="o", ms=4, color=colour, mec="white", mew=0.5
            )
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.set(xlabel=x.label, ylabel=y.label)
    axes.locator_params(axis="x", nbins=5)
