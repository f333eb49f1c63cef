"""Force and contact radius over the depth, of one result or of several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.folder import Report
from indent_sim.results.outline import adheres
from indent_sim.results.pictures import canvas, curves
from indent_sim.results.pictures.axes import Axis, axis, choice, in_picture, is_plane_strain, unit_of
from indent_sim.results.pictures.canvas import FORMULA_STYLE, GREY, LABEL_LETTERS, THEORY_STYLE, Axes, Look, save
from indent_sim.results.pictures.names import in_order, names_of
from indent_sim.results.pictures.pressure import draw_pressure, strongest_step
from indent_sim.results.reader import MEASURED, Results, in_common_units, refuse_other_units

OF_FORCE = "the accuracy asked for is that of the force"  # beside a pressure
ESTIMATED, UNLOADING = "estimated error", "unloading"
POINTS: Look = {"ls": "", "marker": ".", "ms": 3, "zorder": 1}  # of a measured curve
PANELS, HEIGHT = 9.2, 4.8  # inches: width and height of all panels


def force_indentation(results: Results, path: Path | str) -> None:
    """The picture of a run: force against depth beside theory, contact radius, and the pressure at the largest force.

    Theory as run.json says it: name, force_deviation (load control: delta_deviation), curve with delta, force and a.
    """
    theory, strongest = results.report.get("theory"), strongest_step(results)
    with canvas.canvas((PANELS, HEIGHT)) as figure:
        beside = ["a"] if _with_radius([results]) else []
        rows = [["force", *beside], ["force", "pressure"]] if strongest else [["force", *beside]]
        widths = [1.55, 1][: len(rows[0])]
        panels: dict[str, Axes] = figure.subplot_mosaic(rows, width_ratios=widths)
        name = "measured" if results.report.get(MEASURED) else "this run"
        draw_forces(panels["force"], [results], theory, [name])
        if beside:
            _draw_radius(panels["a"], [results], theory)
        if strongest:
            draw_pressure(panels["pressure"], results, strongest)
            if results.report.get("accuracy"):
                said = panels["pressure"].get_title(loc="left")
                panels["pressure"].set_title(f"{said}\n{OF_FORCE}", loc="left", fontsize="small", color=GREY)
        canvas.legend_below(figure, panels["force"])
        canvas.head(figure, results.report.get("title") or names_of([results])[0], subtitle(results))
        save(figure, path)


def overlay(runs: Sequence[Results], path: Path | str) -> None:
    """Force and contact radius of several runs over one another, named after what differs between them.

    UsageError when they have different units, which no axis can show.
    """
    if len(runs) == 1:
        force_indentation(runs[0], path)
        return
    runs, names = named_apart(runs)
    columns = -(-len(runs) // 30)  # names to a column
    beside = columns * (0.7 + canvas.LETTER * max(map(len, [ESTIMATED, *names])))
    with canvas.canvas((PANELS + beside, max(HEIGHT, 0.19 * len(runs) / columns + 0.6))) as figure:
        shown = ["force", *(["a"] if _with_radius(runs) else [])]
        widths = [*[PANELS / len(shown)] * len(shown), beside]
        panels: dict[str, Axes] = figure.subplot_mosaic([[*shown, "names"]], width_ratios=widths)
        draw_forces(panels["force"], runs, None, names)
        if "a" in panels:
            _draw_radius(panels["a"], runs, None)
        canvas.legend_in(panels["names"], panels["force"], columns)
        save(figure, path)


def named_apart(runs: Sequence[Results]) -> tuple[list[Results], list[str]]:
    """Several runs in the order of their names, which say what differs; UsageError when no axis can show all."""
    runs = in_common_units(runs)
    refuse_other_units(runs, "draw them apart")
    _refuse_other_forces(runs)
    names = [in_picture(name) + in_picture(unit) for name, unit in zip(names_of(runs), _units(runs), strict=True)]
    named = sorted(zip(names, runs, strict=True), key=lambda pair: in_order(pair[0]))
    return [run for _, run in named], [name for name, _ in named]


def draw_forces(
    axes: Axes, runs: Sequence[Results], theory: Report | None = None, names: Sequence[str] = ("this run",)
) -> None:
    """Force over depth: rows as marks on smooth curves, unloading dashed and hollow, error bands, theory beside one."""
    depth, force = axis("delta", runs), axis("force", runs)
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        draw_force(axes, run, depth, force, curves.look(i, len(runs)), name)
    paths = (run["delta"] for run in runs if not run.report.get(MEASURED))
    back = [path for path in paths if any(goes_out for _, goes_out in curves.branches(path))]
    if back:
        marks = "o" if any(len(path) <= canvas.MANY for path in back) else ""  # as the curves have them
        axes.plot([], [], color=GREY, label=UNLOADING, marker=marks, ms=5.5, mec=GREY, lw=1.2, **curves.UNLOADING_STYLE)
    _draw_bars(axes, runs, depth, force)
    if theory:
        _draw_theory(axes, theory, depth, force)
    axes.set(xlabel=depth.label, ylabel=force.label)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)


def draw_force(axes: Axes, run: Results, depth: Axis, force: Axis, look: Look, name: str) -> None:
    """The force of one run over its depth; without adhesion its first branch begins with no force at no depth."""
    if run.report.get(MEASURED):
        axes.plot(depth(run["delta"]), force(run["force"]), color=look["color"], label=name, **POINTS)
        return
    rows, begin, joined = _way(run, depth, force)
    curves.draw(axes, rows, look, name, begin, joined)


def draw_many(axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis, looks: Sequence[Look]) -> None:
    """As `draw_force`, of runs of two rows and more without marks and names: for matplotlib one thing."""
    from matplotlib.collections import LineCollection

    found = [
        (np.column_stack(curve), look["color"], curves.UNLOADING_STYLE["ls"] if goes_out else look.get("ls", "-"))
        for run, look in zip(runs, looks, strict=True)
        for curve, _, goes_out in curves.lines(*_way(run, depth, force))
    ]
    lines, colours, dashes = zip(*found, strict=True)
    # matplotlib reads a tuple of two line styles as one style, (offset, dashes); of a list each
    # item is the style of a line.
    collection = LineCollection(
        lines, colors=colours, linestyles=list(dashes), linewidths=1.6, joinstyle="round", zorder=2
    )
    axes.add_collection(collection)
    axes.autoscale_view()


def _way(run: Results, depth: Axis, force: Axis) -> tuple[curves.Rows, Sequence[float], curves.Joined]:
    """The rows of a run, the points before them, and how they are joined."""
    jumps = adheres(run.path)  # between two rows the tip may snap in or let go
    begin = [0.0] if jumps is False and len(run) and run["delta"][0] > 0 else []
    rows = run["delta"], depth(run["delta"]), force(run["force"])
    return rows, begin, curves.chords if jumps else curves.smooth


def _draw_bars(axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis) -> None:
    """The error bars of all runs that have them, named once."""
    judged = [i for i, run in enumerate(runs) if np.isfinite(run.table.get("force_error", np.nan)).any()]
    for i in judged:
        x, y, half = depth(runs[i]["delta"]), force(runs[i]["force"]), force(np.nan_to_num(runs[i]["force_error"]))
        label = f"{ESTIMATED}{_of_last(half, y) if len(runs) == 1 else ''}" if i == judged[-1] else None
        colour = curves.look(i, len(runs))["color"]
        if len(x) == 1:  # a band needs two
            axes.errorbar(x, y, half, color=colour, alpha=0.5, capsize=6, ls="", label=label)
            continue
        for rows, _ in curves.branches(runs[i]["delta"]):
            ends = [(y + side * half)[rows] for side in (-1, 1)]
            straight = ends[0].min() < 0  # as curves.smooth joins forces that pull: then both ends alike
            (along, below), (_, above) = ((x[rows], end) if straight else curves.smooth(x[rows], end) for end in ends)
            axes.fill_between(along, below, above, color=colour, alpha=0.2, lw=0, label=label)
            label = None


def _draw_theory(axes: Axes, theory: Report, depth: Axis, force: Axis) -> None:
    if (curve := theory.get("curve", {})).get("delta"):
        begin = [0.0] if curve["delta"][0] > 0 else []  # a stable branch of a tip that pulls begins elsewhere
        drawn = curves.smooth(depth([*begin, *curve["delta"]]), force([*begin, *curve["force"]]))
        off = theory.get("force_deviation")
        beside = "" if off is None else f", this run {off:+.2%}"
        if "delta_deviation" in theory:
            beside = f", depth of this run {theory['delta_deviation']:+.2%}"
        label = in_picture(f"{theory.get('name', 'theory')}{beside}", LABEL_LETTERS)
        axes.plot(*drawn, **THEORY_STYLE, label=label)
    if closed := theory.get("half_space"):
        off = closed.get("deviation")
        beside = "" if off is None else f": {_off_by(off)}"
        label = in_picture(f"{closed['name'].split(' (')[0]}, half-space{beside}", LABEL_LETTERS)
        at = {**theory, **closed}  # the formula's force at the run's depth, or its depth at the run's force
        curve = closed.get("curve", {"delta": (), "force": ()})  # of an older result: none
        x, y = depth([0, *curve["delta"]]), force([0, *curve["force"]])
        if at["delta"] > 1.001 * max(curve["delta"], default=0.0):  # under a force it is deeper than the run
            x, y = np.append(x, depth(at["delta"])), np.append(y, force(at["force"]))
        axes.plot(*curves.smooth(x, y), **FORMULA_STYLE)
        hollow: Look = {"marker": "D", "mfc": "none", "mec": GREY, "ls": "", "ms": 6, "zorder": 2}
        axes.plot(depth([at["delta"]]), force([at["force"]]), **hollow, label=label)


def _off_by(deviation: float) -> str:
    """How far a formula is from this run, in words."""
    said = f"{abs(deviation):.1%}"
    return "as this run" if said == "0.0%" else f"{said} {'below' if deviation < 0 else 'above'} this run"


def _of_last(half: np.ndarray, y: np.ndarray) -> str:
    """The last error in words: a thin band cannot be read off."""
    if y[-1] == 0:
        return ""
    last = abs(half[-1] / y[-1])
    said = f"{last:.2%}" if last >= 5e-5 else f"{100 * last:.0e}%"  # not 0.00 %
    return f", \N{PLUS-MINUS SIGN}{said} at the last step"


def _with_radius(runs: Sequence[Results]) -> list[int]:
    """Which runs know a contact radius, or have no rows that could say."""
    return [i for i, run in enumerate(runs) if not len(run) or np.isfinite(run["a"]).any()]


def _draw_radius(axes: Axes, runs: Sequence[Results], theory: Report | None) -> None:
    depth, radius = axis("delta", runs), axis("a", runs)
    for i in _with_radius(runs):
        run = runs[i]
        joined = curves.chords if adheres(run.path) else curves.smooth
        rows = run["delta"], depth(run["delta"]), radius(run["a"])
        curves.draw(axes, rows, curves.look(i, len(runs)), joined=joined)
    curve = (theory or {}).get("curve", {})
    if curve.get("a"):
        axes.plot(*curves.smooth(depth(curve["delta"]), radius(curve["a"])), **THEORY_STYLE)
    axes.set(xlabel=depth.label, ylabel=radius.label)
    canvas.from_zero(axes, *(radius(run["a"]) for run in runs), radius(curve.get("a", [])))


def subtitle(results: Results) -> str:
    """What was solved and how, and how it ended where that was not well."""
    report = results.report
    parts = [choice(report, "symmetry"), choice(report, "kinematics"), report.get("method")]
    if report.get("gap"):
        parts.append(f"gap at the {'undeformed' if report['gap'] == 'reference' else 'deformed'} point")
    if report.get("status") not in (None, "done", "running"):
        parts.append(f"{report['status']}: {report.get('reason') or 'no reason given'}")
    words = dict.fromkeys(str(part).replace("_", " ") for part in parts if part)
    return "  ·  ".join(word if len(word) <= 90 else f"{word[:89]}…" for word in words)


def _refuse_other_forces(runs: Sequence[Results]) -> None:
    """UsageError when the forces of one run are per length and those of another are not."""
    flat = {is_plane_strain(run): run.path for run in runs if choice(run.report, "kinematics")}
    if len(flat) > 1:
        raise UsageError(f"the forces of {flat[True]} are per length, those of {flat[False]} are not: draw them apart")


def _units(runs: Sequence[Results]) -> list[str]:
    """What every run measures in, to be said behind its name; nothing where that is the same, and the axes say it."""
    units = [run.report.get("units") or {} for run in runs]
    told = [" and ".join(filter(None, (unit_of(kind, said) for kind in ("length", "force")))) for said in units]
    return [f" [{said or 'unit unknown'}]" if len(set(told)) > 1 else "" for said in told]
