"""Unloading of a body that yields: tangent, contact depth, residual depth, imprint and hardness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import curves, figures
from indent_sim.results.pictures.axes import Axis, axis_of_column
from indent_sim.results.pictures.figures import GREY, Axes
from indent_sim.results.reader import Results

# Factor of the contact depth of a paraboloid, and by habit of every tip (Oliver & Pharr 1992).
EPSILON = 0.75
TANGENT_COLOUR = "#CC79A7"


def imprint_step(results: Results) -> float | None:
    """Return the step at which the force has become zero; None if there is no such row."""
    if "contact_area" not in results.table or "residual_depth" not in results.table:
        return None
    rows = np.flatnonzero(np.isfinite(results["residual_depth"]))
    return float(results["step"][rows[-1]]) if len(rows) else None


def draw_unloading(axes: Axes, results: Results, depth: Axis, force: Axis) -> None:
    """Draw the tangent at the beginning of unloading, and the depths computed from unloading.

    Nothing is drawn for a body that does not yield, or whose path does not unload.
    """
    if not len(results) or "unloading_stiffness" not in results.table:
        return
    F_max = float(results["force"].max())
    row = results.unloading_row(F_max)
    h_max = float(results["delta"][row])
    S = float(results["unloading_stiffness"][row])
    unloads = bool(np.any(results["delta"][row:] < h_max))
    if not (unloads and F_max > 0 and np.isfinite(S) and S > 0):
        return
    axes.plot(
        depth([h_max, h_max - F_max / S]),
        force([F_max, 0.0]),
        color=TANGENT_COLOUR,
        lw=1.2,
        zorder=1.5,
        label="tangent, with the unloading stiffness",
    )
    h_c = float(depth([h_max - EPSILON * F_max / S])[0])
    marks = [("v", TANGENT_COLOUR, h_c, f"contact depth $h_c$ = {h_c:.4g} (epsilon {EPSILON:g})")]
    step = imprint_step(results)
    if step is not None:
        h_r = float(depth(results["delta"][results["step"] == step])[0])
        marks.append(("^", GREY, h_r, f"residual depth $h_r$ = {h_r:.4g}"))
    for marker, colour, h, label in marks:
        axes.plot(
            [h], force([0.0]), color=colour, marker=marker, ls="", ms=6, zorder=3, label=label
        )


def draw_hardness(axes: Axes, runs: Sequence[Results], names: Sequence[str]) -> None:
    """Draw the hardness (force divided by contact area) over the depth during loading.

    Raises
    ------
    UsageError
        If a result has no hardness, since its body does not yield.
    """
    for run in runs:
        if "hardness" not in run.table:
            problem = f"{run.path} has no hardness: its body does not yield"
            raise UsageError(problem, "give material.plasticity, or use the command hardness")
    depth = axis_of_column("delta", runs)
    hardness = axis_of_column("hardness", runs)
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        is_loading = run["delta"] >= np.maximum.accumulate(run["delta"])
        rows = is_loading & np.isfinite(run["hardness"])
        shown = run["delta"][rows], depth(run["delta"][rows]), hardness(run["hardness"][rows])
        curves.draw_rows(axes, shown, curves.line_style(i, len(runs)), name, joined=curves.polyline)
    axes.set(xlabel=depth.label, ylabel=hardness.label)
    figures.start_at_zero(axes, *(hardness(run["hardness"]) for run in runs))
