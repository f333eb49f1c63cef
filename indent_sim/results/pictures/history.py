"""A history of a body that is followed row by row: force over depth, and over time what the tip and the fluid do."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from indent_sim.results.folder import Report
from indent_sim.results.pictures.axes import axis, time_axis
from indent_sim.results.pictures.canvas import Axes, canvas, head, legend_below, save
from indent_sim.results.pictures.experiment import draw_branches
from indent_sim.results.reader import Results

SIZE = 4.6, 3.5  # inches of a panel
DECADES = 1e4  # last over first time, from which on the axis of times is logarithmic


def is_of_body(report: Report) -> bool:
    """Whether the rows of a run are steps in time of the whole body."""
    return (report.get("time") or {}).get("way") == "steps"


def draw(results: Results, path: Path) -> None:
    """Draw the rows of a run in time."""
    is_loaded = bool(np.any(results["force"] != 0))
    over_time = ["force"] if np.ptp(results["force"]) > 0 else []
    over_time += ["delta"] if results.report.get("control") == "force" else []
    over_time += ["a"] * is_loaded
    over_time += ["pore_pressure_max"] if np.any(results.table.get("pore_pressure_max", 0.0) > 0) else []
    panels = [*(["curve"] if is_loaded else []), *over_time]
    across = 2 if len(panels) in (2, 4) else min(len(panels), 3)
    rows = [panels[k : k + across] for k in range(0, len(panels), across)]
    rows[-1] += ["."] * (across - len(rows[-1]))
    with canvas((SIZE[0] * across, SIZE[1] * len(rows))) as figure:
        drawn: dict[str, Axes] = figure.subplot_mosaic([*rows, ["legend"] * across])
        time = results.report.get("time") or {}
        head(
            figure, results.report.get("title") or path.parent.name, f"row by row on the body, by {time.get('method')}"
        )
        if is_loaded:
            draw_branches(drawn["curve"], results.table, "delta", axis("delta", [results]), axis("force", [results]))
        for name in over_time:
            draw_branches(drawn[name], results.table, "t", time_axis([results]), axis(name, [results]), name)
            if _spans_decades(results["t"]):
                drawn[name].set_xscale("log")
        legend_below(figure, drawn["legend"], drawn[panels[0]])
        save(figure, path)


def _spans_decades(t: np.ndarray) -> bool:
    """Whether most of what happens would stand at the left end of the axis."""
    return bool(t[0] >= 0 and t[-1] > DECADES * np.min(t[t > 0], initial=np.inf))
