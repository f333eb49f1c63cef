"""Force and contact radius over the depth, of one result or of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.outline import scene_of
from indent_sim.results.pictures import curves
from indent_sim.results.pictures.axes import Axis, axis, choice, in_picture, is_plane_strain, unit_of
from indent_sim.results.pictures.canvas import (
    GREY,
    LABEL,
    LETTER,
    PICTURE,
    THEORY,
    canvas,
    from_zero,
    head,
    hollow,
    legend_below,
    legend_in,
    name_axes,
    save,
)
from indent_sim.results.pictures.names import in_order, names_of
from indent_sim.results.pictures.pressure import draw_pressure, strongest_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from indent_sim.results.reader import Results


LEGEND_LINES = 30  # in a column
ESTIMATED, UNLOADING = "estimated error", "unloading"
SAYABLE = 5e-5  # relative error that is not 0.00 %
PANELS, HEIGHT = 9.2, 4.8  # inches: width and height of all panels


def plot_run(folder: Path | str) -> Path:
    """Draw the picture of a result folder into it; returns its path."""
    from indent_sim.results.reader import read

    path = Path(folder) / PICTURE
    force_indentation(read(folder), path)
    return path


def force_indentation(results: Results, path: Path | str, theory: Mapping[str, Any] | None = None) -> None:
    """The picture of a run: force against depth beside theory, contact radius, and the pressure at the largest force.

    `theory` as in run.json (taken from there when not given): name, force_deviation (load control:
    delta_deviation), and curve with delta, force and a.
    """
    theory = theory if theory is not None else results.report.get("theory")
    strongest = strongest_step(results)
    with canvas((PANELS, HEIGHT)) as figure:
        rows = [["force", "a"], ["force", "pressure"]] if strongest else [["force", "a"]]
        panels: dict[str, Any] = figure.subplot_mosaic([*rows, ["names", "names"]], width_ratios=[1.55, 1])
        draw_forces(panels["force"], [results], theory)
        _draw_radius(panels["a"], [results], theory)
        if strongest:
            draw_pressure(panels["pressure"], results, strongest)
        legend_below(figure, panels["names"], panels["force"])
        head(figure, _title(results), _subtitle(results))
        save(figure, path)


def overlay(runs: Sequence[Results], path: Path | str) -> None:
    """Force and contact radius of several runs over one another, named after what differs between them.

    UsageError when they have different units, which no axis can show.
    """
    if len(runs) == 1:
        return force_indentation(runs[0], path)
    runs, names = named_apart(runs)
    columns = -(-len(runs) // LEGEND_LINES)
    beside = columns * (0.7 + LETTER * max(map(len, [ESTIMATED, *names])))
    with canvas((PANELS + beside, max(HEIGHT, 0.19 * len(runs) / columns + 0.6))) as figure:
        panels: dict[str, Any] = figure.subplot_mosaic(
            [["force", "a", "names"]], width_ratios=[PANELS / 2, PANELS / 2, beside]
        )
        draw_forces(panels["force"], runs, None, names)
        _draw_radius(panels["a"], runs, None)
        legend_in(panels["names"], panels["force"], columns)
        save(figure, path)
    return None


def named_apart(runs: Sequence[Results]) -> tuple[list[Results], list[str]]:
    """Several runs in the order of their names, which say what differs; UsageError when no axis can show all."""
    _refuse_other_units(runs)
    names = [in_picture(name) + in_picture(unit) for name, unit in zip(names_of(runs), _units(runs), strict=True)]
    named = sorted(zip(names, runs, strict=True), key=lambda pair: in_order(pair[0]))
    return [run for _, run in named], [name for name, _ in named]


def draw_forces(axes: Axes, runs: Sequence[Results], theory: Mapping[str, Any] | None = None,
                names: Sequence[str] = ("this run",)) -> None:  # fmt: skip
    """Force over depth: rows as marks on smooth curves, unloading dashed and hollow, error bands, theory beside one."""
    depth, force = axis("delta", runs), axis("force", runs)
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        curves.draw(axes, run["delta"], depth(run["delta"]), force(run["force"]), curves.look(i, len(runs)), name,
                    from_origin=begins_untouched(run), straight=adheres(run))  # fmt: skip
    if any(goes_out for run in runs for _, goes_out in curves.branches(run["delta"])):
        axes.plot([], [], color=GREY, label=UNLOADING, marker="o", ms=5.5, mec=GREY, lw=1.2, **curves.UNLOADING)
    _draw_bars(axes, runs, depth, force)
    if theory:
        _draw_theory(axes, theory, depth, force)
    name_axes(axes, depth.label, force.label)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)


def begins_untouched(run: Results) -> bool:
    """Whether a run's first branch begins with no force at no depth, as without adhesion."""
    return len(run) > 0 and bool(run["delta"][0] > 0) and not adheres(run, unknown=True)


def adheres(run: Results, unknown: bool = False) -> bool:
    """Whether the tip of a run adheres over a range: between two rows it may snap in or let go."""
    scene = scene_of(run.path)
    return getattr(scene.contact, "adhesion", None) is not None if scene else unknown


def _draw_bars(axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis) -> None:
    """The error bars of all runs that have them, named once."""
    judged = [i for i, run in enumerate(runs) if is_judged(run)]
    for i in judged:
        x, y, half = depth(runs[i]["delta"]), force(runs[i]["force"]), force(np.nan_to_num(runs[i]["force_error"]))
        label = f"{ESTIMATED}{_of_last(half, y) if len(runs) == 1 else ''}" if i == judged[-1] else None
        colour = curves.look(i, len(runs))["color"]
        if len(x) == 1:  # a band needs two
            axes.errorbar(x, y, half, color=colour, alpha=0.5, capsize=6, ls="", label=label)
            continue
        for rows, _ in curves.branches(runs[i]["delta"]):
            (along, below), (_, above) = (curves.smooth(x[rows], (y + side * half)[rows]) for side in (-1, 1))
            axes.fill_between(along, below, above, color=colour, alpha=0.2, lw=0, label=label)
            label = None


def is_judged(run: Results) -> bool:
    """Whether a run has error bars."""
    return "force_error" in run.table and bool(np.isfinite(run["force_error"]).any())


def _draw_theory(axes: Axes, theory: Mapping[str, Any], depth: Axis, force: Axis) -> None:
    if theory.get("curve", {}).get("delta"):
        curve = theory["curve"]
        begin = [0.0] if curve["delta"][0] > 0 else []  # with adhesion a stable branch begins elsewhere
        axes.plot(*curves.smooth(depth([*begin, *curve["delta"]]), force([*begin, *curve["force"]])), **THEORY,
                  label=_theory_label(theory))  # fmt: skip
    if closed := theory.get("half_space"):
        label = in_picture(f"{closed['name'].split(' (')[0]}, half-space{_against_run(closed.get('deviation'))}", LABEL)
        at = {**theory, **closed}  # the formula's force at the run's depth, or its depth at the run's force
        curve = closed.get("curve", {"delta": (), "force": ()})  # of an older result: none
        x, y = depth([0, *curve["delta"]]), force([0, *curve["force"]])
        if at["delta"] > 1.001 * max(curve["delta"], default=0.0):  # under a force it is deeper than the run
            x, y = np.append(x, depth(at["delta"])), np.append(y, force(at["force"]))
        axes.plot(*curves.smooth(x, y), color=GREY, ls=":", lw=1.2, zorder=2)
        axes.plot(depth([at["delta"]]), force([at["force"]]), **hollow("D", GREY), label=label)


def _of_last(half: np.ndarray, y: np.ndarray) -> str:
    """The last error in words: a thin band cannot be read off."""
    if y[-1] == 0:
        return ""
    last = abs(half[-1] / y[-1])
    said = f"{last:.2%}" if last >= SAYABLE else f"{100 * last:.0e}%"
    return f", \N{PLUS-MINUS SIGN}{said} at the last step"


def _draw_radius(axes: Axes, runs: Sequence[Results], theory: Mapping[str, Any] | None) -> None:
    depth, radius = axis("delta", runs), axis("a", runs)
    for i, run in enumerate(runs):
        curves.draw(axes, run["delta"], depth(run["delta"]), radius(run["a"]), curves.look(i, len(runs)),
                    straight=adheres(run))  # fmt: skip
    curve = (theory or {}).get("curve", {})
    if curve.get("a"):
        axes.plot(*curves.smooth(depth(curve["delta"]), radius(curve["a"])), **THEORY)
    name_axes(axes, depth.label, radius.label)
    from_zero(axes, *(radius(run["a"]) for run in runs), radius(curve.get("a", [])))


# ---- words and units ------------------------------------------------------------


def _title(results: Results) -> str:
    return results.report.get("title") or names_of([results])[0]


def _subtitle(results: Results) -> str:
    report = results.report
    parts = [choice(report, "symmetry"), choice(report, "kinematics"), report.get("method")]
    if report.get("gap"):
        parts.append(f"gap at the {'undeformed' if report['gap'] == 'reference' else 'deformed'} point")
    if report.get("status") not in (None, "done", "running"):
        parts.append(f"{report['status']}: {report.get('reason') or 'no reason given'}")
    words = dict.fromkeys(str(part).replace("_", " ") for part in parts if part)
    return "  ·  ".join(word if len(word) <= 90 else f"{word[:89]}…" for word in words)


def _refuse_other_units(runs: Sequence[Results]) -> None:
    """UsageError when two runs measure in different units; one that does not say is shown as it is."""
    for kind in ("length", "force"):
        known = {unit: run.path for run in runs if (unit := unit_of(kind, run.report.get("units") or {}))}
        if len(known) > 1:
            (one, first), (other, second) = list(known.items())[:2]
            raise UsageError(f"{first} measures {kind} in {one}, {second} in {other}: draw them apart")
    flat = {is_plane_strain(run): run.path for run in runs if choice(run.report, "kinematics")}
    if len(flat) > 1:
        raise UsageError(f"the forces of {flat[True]} are per length, those of {flat[False]} are not: draw them apart")


def _units(runs: Sequence[Results]) -> list[str]:
    """What every run measures in, to be said behind its name; nothing where that is the same, and the axes say it."""
    units = [run.report.get("units") or {} for run in runs]
    told = [" and ".join(label for label in (unit_of(kind, said) for kind in ("length", "force")) if label)
            for said in units]  # fmt: skip
    return [f" [{said or 'unit unknown'}]" if len(set(told)) > 1 else "" for said in told]


def _theory_label(theory: Mapping[str, Any]) -> str:
    deviation = theory.get("force_deviation")
    beside = "" if deviation is None else f", this run {deviation:+.2%}"
    if "delta_deviation" in theory:
        beside = f", depth of this run {theory['delta_deviation']:+.2%}"
    return in_picture(f"{theory.get('name', 'theory')}{beside}", LABEL)


def _against_run(deviation: float | None) -> str:
    return "" if deviation is None else f": {abs(deviation):.1%} {'below' if deviation < 0 else 'above'} this run"
