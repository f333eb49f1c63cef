"""Force and contact radius over the depth, of one result or of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures.canvas import (
    COLOURS,
    GREY,
    LABEL,
    MANY,
    MARKERS,
    PICTURE,
    THEORY,
    axis,
    canvas,
    choice,
    from_zero,
    head,
    hollow,
    in_picture,
    is_plane_strain,
    name_axes,
    save,
    unit_of,
)
from indent_sim.results.pictures.names import in_order, names_of
from indent_sim.results.pictures.pressure import draw_pressure, strongest_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from indent_sim.results.reader import Results


MANY_RUNS = 10  # from which their colours are those of a map, in their order
LEGEND_LINES = 30  # in a column
ESTIMATED = "estimated error"
SAYABLE = 5e-5  # relative error that is not 0.00 %
PANELS, LETTER = 9.2, 0.07  # inches: width of all panels, and of a letter in the legend beside them


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
    with canvas() as figure:
        panels: dict[str, Any] = figure.subplot_mosaic(
            [["force", "a"], ["force", "pressure"]] if strongest else [["force", "a"]],
            width_ratios=[1.55, 1],
        )
        head(figure, _title(results), _subtitle(results))
        _draw_forces(panels["force"], [results], theory)
        _draw_radius(panels["a"], results, theory)
        if strongest:
            draw_pressure(panels["pressure"], results, strongest)
        save(figure, path)


def overlay(runs: Sequence[Results], path: Path | str) -> None:
    """Force and contact radius of several runs over one another, named after what differs between them.

    UsageError when they have different units, which no axis can show.
    """
    if len(runs) == 1:
        return force_indentation(runs[0], path)
    _refuse_other_units(runs)
    names = [in_picture(name) + in_picture(unit) for name, unit in zip(names_of(runs), _units(runs), strict=True)]
    named = sorted(zip(names, runs, strict=True), key=lambda pair: in_order(pair[0]))
    runs, names = [run for _, run in named], [name for name, _ in named]
    columns = -(-len(runs) // LEGEND_LINES)
    beside = columns * (0.7 + LETTER * max(map(len, [ESTIMATED, *names])))
    with canvas((PANELS + beside, max(4.8, 0.19 * len(runs) / columns + 0.6))) as figure:
        panels: dict[str, Any] = figure.subplot_mosaic(
            [["force", "a", "names"]], width_ratios=[PANELS / 2, PANELS / 2, beside]
        )
        _draw_forces(panels["force"], runs, None, names)
        x, y = axis("a", runs), axis("delta", runs)
        for i, run in enumerate(runs):
            _curve(panels["a"], y(run["delta"]), x(run["a"]), _look(i, len(runs)))
        name_axes(panels["a"], y.label, x.label)
        panels["a"].locator_params(axis="x", nbins=6)
        from_zero(panels["a"], *(x(run["a"]) for run in runs))
        _legend_beside(panels["names"], panels["force"], columns)
        save(figure, path)
    return None


def _look(i: int, of: int) -> dict[str, Any]:
    """Colour and mark of the i-th of so many curves; of many, colours of a map from dark to light, without marks."""
    if of <= MANY_RUNS:
        return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)]}
    from matplotlib import colormaps

    return {"color": colormaps["viridis"](0.95 * i / (of - 1)), "marker": ""}  # its lightest yellow is lost on white


def _legend_beside(axes: Axes, named: Axes, columns: int) -> None:
    """The legend of a panel in one of its own."""
    named.get_legend().remove()
    axes.axis("off")
    handles, labels = named.get_legend_handles_labels()
    axes.legend(handles, labels, loc="upper left", fontsize=8, ncol=columns, borderaxespad=0)


def _draw_forces(axes: Axes, runs: Sequence[Results], theory: Mapping[str, Any] | None,
                 names: Sequence[str] = ("this run",)) -> None:  # fmt: skip
    depth, force = axis("delta", runs), axis("force", runs)
    judged = [run for run in runs if "force_error" in run.table and np.isfinite(run["force_error"]).any()]
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        x, y, look = depth(run["delta"]), force(run["force"]), _look(i, len(runs))
        _curve(axes, x, y, look, name)
        if any(run is other for other in judged):
            half = force(np.nan_to_num(run["force_error"]))
            label = f"{ESTIMATED}{_of_last(half, y) if len(runs) == 1 else ''}" if run is judged[-1] else None
            if len(x) > 1:
                axes.fill_between(x, y - half, y + half, color=look["color"], alpha=0.2, lw=0, label=label)
            else:  # a band needs two
                axes.errorbar(x, y, half, color=look["color"], alpha=0.5, capsize=6, ls="", label=label)
    if theory and theory.get("curve", {}).get("delta"):
        curve = theory["curve"]
        x, y = depth([0, *curve["delta"]]), force([0, *curve["force"]])
        axes.plot(x, y, **THEORY, label=_theory_label(theory))
    closed = (theory or {}).get("half_space")
    if theory and closed:
        label = in_picture(f"{closed['name'].split(' (')[0]}, half-space{_against_run(closed.get('deviation'))}", LABEL)
        at = theory | closed  # the formula's force at the run's depth, or its depth at the run's force
        axes.plot(depth([at["delta"]]), force([at["force"]]), **hollow("D", GREY), label=label)
        beside = closed.get("curve", {"delta": (), "force": ()})  # of an older result: none
        axes.plot(depth([0, *beside["delta"]]), force([0, *beside["force"]]), color=GREY, ls=":", lw=1.2, zorder=2)
    name_axes(axes, depth.label, force.label)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.locator_params(axis="x", nbins=6)  # numbers such as 0.0025 are wide
    axes.legend(loc="upper left")


def _of_last(half: np.ndarray, y: np.ndarray) -> str:
    """The last error in words: a thin band cannot be read off."""
    if y[-1] == 0:
        return ""
    last = abs(half[-1] / y[-1])
    said = f"{last:.2%}" if last >= SAYABLE else f"{100 * last:.0e}%"
    return f", \N{PLUS-MINUS SIGN}{said} at the last step"


def _draw_radius(axes: Axes, results: Results, theory: Mapping[str, Any] | None) -> None:
    depth, radius = axis("delta", [results]), axis("a", [results])
    _curve(axes, depth(results["delta"]), radius(results["a"]), _look(0, 1))
    curve = (theory or {}).get("curve", {})
    if curve.get("a"):
        axes.plot(depth(curve["delta"]), radius(curve["a"]), **THEORY)
    name_axes(axes, depth.label, radius.label)
    axes.locator_params(axis="x", nbins=3)
    from_zero(axes, radius(results["a"]), radius(curve.get("a", [])))


def _curve(axes: Axes, x: np.ndarray, y: np.ndarray, look: Mapping[str, Any], label: str | None = None) -> None:
    if len(x) > MANY or not look["marker"]:
        axes.plot(x, y, color=look["color"], label=label, zorder=3)
        return
    axes.plot(x, y, color=look["color"], lw=1.2, alpha=0.6, zorder=2)
    axes.plot(x, y, **look, ls="", ms=6, mec="white", mew=0.6, label=label, zorder=4)


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
