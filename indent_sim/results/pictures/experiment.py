"""The experiment in a picture: force over depth and the way of the base, force or depth over time, as experiment.csv
says."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.results.folder import read_report
from indent_sim.results.pictures.axes import axis, in_print
from indent_sim.results.pictures.canvas import COLOURS, GREY, canvas, head, legend_below, name_axes, save
from indent_sim.results.pictures.curves import smooth
from indent_sim.results.pictures.names import config_of
from indent_sim.results.reader import read
from indent_sim.results.tables import EXPERIMENT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PICTURE = "experiment.png"
LOOKS = {"approach": (COLOURS[0], "-"), "hold": (COLOURS[2], "-"), "retract": (COLOURS[1], "-"),
         "stable": (COLOURS[0], "-"), "unstable": (GREY, "--")}  # fmt: skip


def plot_experiment(folder: Path | str) -> Path:
    """Draw the experiment of a result folder into it; returns the picture's path."""
    path = Path(folder) / PICTURE
    draw(Path(folder), path)
    return path


def draw(folder: Path, path: Path) -> None:
    """Draw the experiment of a result folder."""
    results, rows = read(folder), _rows(folder / EXPERIMENT)
    has_times, has_base = bool(rows[0]["t"]), any(row["z"] != row["delta"] for row in rows)
    has_forces = bool(config_of(folder).get("experiment.force_history"))  # then time tells the depth
    panels = ["depth", *(["base"] if has_base else []), *(["time"] if has_times else ["radius"])]
    with canvas((3.1 + 3.3 * len(panels), 4.4)) as figure:
        drawn: dict[str, Any] = figure.subplot_mosaic([panels, ["legend"] * len(panels)])
        head(figure, results.report.get("title") or folder.name, _subtitle(folder))
        force, depth = axis("force", [results]), axis("delta", [results])
        _draw(drawn["depth"], rows, "delta", depth, force)
        if has_base:
            _draw(drawn["base"], rows, "z", depth, force, "way of the base z")
        if has_times and has_forces:
            _draw(drawn["time"], rows, "t", None, depth, "time t", "delta")
        elif has_times:
            _draw(drawn["time"], rows, "t", None, force, "time t")
        else:
            _draw(drawn["radius"], rows, "a", axis("a", [results]), force)
        legend_below(figure, drawn["legend"], drawn["depth"])
        save(figure, path)


def _rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def _subtitle(folder: Path) -> str:
    said = read_report(folder).get("experiment") or {}
    parts = [f"by {said.get('by', '?')}"]
    parts += [name for name in ("adhesion", "relaxation", "cantilever") if name in said]
    return "  \N{MIDDLE DOT}  ".join(parts)


def _draw(
    axes: Axes, rows: Sequence[dict[str, str]], name: str, x: Any, y: Any, label: str = "", of: str = "force"
) -> None:
    """A column over another, a line for each branch that is one piece of the table."""
    seen: set[str] = set()
    begin = 0
    for k in range(1, len(rows) + 1):
        if k < len(rows) and rows[k]["branch"] == rows[begin]["branch"]:
            continue
        branch, piece = rows[begin]["branch"], rows[max(begin - 1, 0) : k]
        colour, style = LOOKS.get(branch, (COLOURS[0], "-"))
        across = _numbers(piece, name)
        curve = smooth(across if x is None else x(across), y(_numbers(piece, of)))
        axes.plot(*curve, color=colour, ls=style, lw=1.5, label=None if branch in seen else branch)
        seen.add(branch)
        begin = k
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    named = label if x is None else x.label if not label else f"{label} [{in_print(x.unit)}]" if x.unit else label
    name_axes(axes, named, y.label)
    axes.locator_params(axis="x", nbins=5)


def _numbers(rows: Sequence[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row[name]) if row[name] else np.nan for row in rows])
