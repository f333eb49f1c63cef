"""Force and contact radius over the depth, of one result or of several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from indent_sim.model.work import path_integral
from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import curves, figures
from indent_sim.results.pictures.axes import (
    Axis,
    axis_of_column,
    is_plane_strain,
    picture_text,
    plan_choice,
    unit_label,
)
from indent_sim.results.pictures.figures import (
    FORMULA_STYLE,
    GREY,
    Axes,
    PlotStyle,
    save,
)
from indent_sim.results.pictures.pressure import draw_pressure, largest_force_step
from indent_sim.results.pictures.profile import draw_profiles
from indent_sim.results.pictures.run_names import natural_sort_key, run_names
from indent_sim.results.pictures.unloading import draw_unloading, imprint_step
from indent_sim.results.reader import MEASURED, Results
from indent_sim.results.result_files import Report
from indent_sim.results.result_scene import has_adhesion
from indent_sim.results.unit_conversion import convert_to_common_units, refuse_different_units

THEORY_STYLE: PlotStyle = {"color": "#D55E00", "ls": "--", "lw": 1.4, "zorder": 3}
ERROR_LABEL = "estimated error"
UNLOADING_LABEL = "unloading"
SIDE_PANEL = "side force"
# Width and height of all panels [inches].
PANELS_WIDTH = 9.2
PANELS_HEIGHT = 4.8


def draw_force_indentation(results: Results, path: Path | str) -> None:
    """Draw a result into a file: force and contact radius over depth, and the pressure at one step.

    The pressure is drawn at the largest force; for a body that has yielded and is unloaded, the
    surface under load and the imprint are drawn in its place. The reference theory is drawn from
    its entries in run.json: `name`, `force_deviation` (in load control `delta_deviation`), and a
    curve with `delta`, `force` and `a`.
    """
    theory = results.report.get("theory")
    step = largest_force_step(results)
    with figures.new_figure((PANELS_WIDTH, PANELS_HEIGHT)) as figure:
        radius_panel = ["a"] if _runs_with_radius([results]) else []
        rows = (
            [["force", *radius_panel], ["force", "pressure"]]
            if step
            else [["force", *radius_panel]]
        )
        side_force = slide_force_column(results)
        if side_force:
            # The left column shows the force above the side force
            rows = [["force", *rows[0][1:]], [SIDE_PANEL, *rows[-1][1:]]]
        widths = [1.55, 1][: len(rows[0])]
        panels: dict[str, Axes] = figure.subplot_mosaic(rows, width_ratios=widths)
        name = "measured" if results.report.get(MEASURED) else "this run"
        draw_forces(panels["force"], [results], theory, [name])
        if side_force:
            draw_side_force(panels[SIDE_PANEL], results, side_force)
        if radius_panel:
            _draw_radius(panels["a"], [results], theory)
        imprint = imprint_step(results)
        if step and imprint in results.surface.get("step", ()):
            _draw_imprint(panels["pressure"], results, step, float(imprint or 0))
        elif step:
            draw_pressure(panels["pressure"], results, step)
            if results.report.get("accuracy"):
                panel_title = panels["pressure"].get_title(loc="left")
                note = "the required accuracy applies to the force, not to the pressure"
                panels["pressure"].set_title(
                    f"{panel_title}\n{note}", loc="left", fontsize="small", color=GREY
                )
        figures.draw_figure_legend(figure, panels["force"])
        figures.draw_title(
            figure, results.report.get("title") or run_names([results])[0], subtitle(results)
        )
        save(figure, path)


def _draw_imprint(axes: Axes, results: Results, step: float, imprint: float) -> None:
    """Draw the surface at the largest force, and the imprint without force with its pile-up."""
    colours = [curves.map_colour(i, 2) for i in range(2)]
    shown = [
        (results, step, "largest force", colours[0]),
        (results, imprint, "imprint", colours[1]),
    ]
    draw_profiles(axes, shown)
    axes.yaxis.label.set_size("small")
    axes.legend(fontsize="small", loc="lower right")


def draw_overlay(runs: Sequence[Results], path: Path | str) -> None:
    """Draw force and contact radius of several results into a file.

    The names of the results in the legend show how they differ.

    Raises
    ------
    UsageError
        If the results have different units.
    """
    if len(runs) == 1:
        draw_force_indentation(runs[0], path)
        return
    runs, names = sort_and_name(runs)
    panel_names = ["force", *(["a"] if _runs_with_radius(runs) else [])]
    with figures.new_figure((PANELS_WIDTH, PANELS_HEIGHT)) as figure:
        panels: dict[str, Axes] = figure.subplot_mosaic([panel_names])
        draw_forces(panels["force"], runs, None, names)
        if "a" in panels:
            _draw_radius(panels["a"], runs, None)
        figures.draw_legend_right(panels[panel_names[-1]], panels["force"])
        save(figure, path)


def sort_and_name(runs: Sequence[Results]) -> tuple[list[Results], list[str]]:
    """Return results in the order of their names, and the names.

    Raises
    ------
    UsageError
        If the results have no common axis: units differ, or only some forces are per length.
    """
    runs = convert_to_common_units(runs)
    refuse_different_units(runs, "draw them separately")
    _refuse_mixed_kinematics(runs)
    names = [
        picture_text(name) + picture_text(unit)
        for name, unit in zip(run_names(runs), _unit_suffixes(runs), strict=True)
    ]
    named = sorted(zip(names, runs, strict=True), key=lambda pair: natural_sort_key(pair[0]))
    return [run for _, run in named], [name for name, _ in named]


def draw_forces(
    axes: Axes,
    runs: Sequence[Results],
    theory: Report | None = None,
    names: Sequence[str] = ("this run",),
) -> None:
    """Draw forces over depth, with error bands.

    Rows are drawn as markers on smooth curves, and unloading as a dashed line with hollow markers.

    Parameters
    ----------
    axes
        The panel.
    runs
        The results.
    theory
        Entry `theory` of run.json, to be drawn with a single result.
    names
        Names of the results in the legend.
    """
    depth = axis_of_column("delta", runs)
    force = axis_of_column("force", runs)
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        draw_force(axes, run, depth, force, curves.line_style(i, len(runs)), name)
    paths = (run["delta"] for run in runs if not run.report.get(MEASURED))
    unloading_paths = [
        path for path in paths if any(goes_out for _, goes_out in curves.split_branches(path))
    ]
    if unloading_paths:
        # The entry of the legend has markers if the curves have them.
        marks = (
            "o" if any(len(path) <= figures.MAX_MARKED_POINTS for path in unloading_paths) else ""
        )
        axes.plot(
            [],
            [],
            color=GREY,
            label=UNLOADING_LABEL,
            marker=marks,
            ms=5.5,
            mec=GREY,
            lw=1.2,
            **curves.UNLOADING_STYLE,
        )
    _draw_error_bands(axes, runs, depth, force)
    if len(runs) == 1:
        draw_unloading(axes, runs[0], depth, force)
    if theory:
        _draw_theory(axes, theory, depth, force)
    axes.set(xlabel=depth.label, ylabel=force.label)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)


def draw_force(
    axes: Axes, run: Results, depth: Axis, force: Axis, look: PlotStyle, name: str
) -> None:
    """Draw the force of a result over depth; without adhesion the curve begins at the origin."""
    if run.report.get(MEASURED):
        measured_style: PlotStyle = {"ls": "", "marker": ".", "ms": 3, "zorder": 1}
        axes.plot(
            depth(run["delta"]),
            force(run["force"]),
            color=look["color"],
            label=name,
            **measured_style,
        )
        return
    rows, begin, joined = _force_rows(run, depth, force)
    curves.draw_rows(axes, rows, look, name, begin, joined)


def draw_force_lines(
    axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis, looks: Sequence[PlotStyle]
) -> None:
    """Draw the forces of many results as one collection of lines, without markers and names."""
    from matplotlib.collections import LineCollection

    styled_lines = [
        (
            np.column_stack(curve),
            look["color"],
            curves.UNLOADING_STYLE["ls"] if goes_out else look.get("ls", "-"),
        )
        for run, look in zip(runs, looks, strict=True)
        for curve, _, goes_out in curves.branch_lines(*_force_rows(run, depth, force))
    ]
    lines, colours, dashes = zip(*styled_lines, strict=True)
    # matplotlib reads a tuple of two line styles as one style, (offset, dashes); of a list each
    # item is the style of a line.
    collection = LineCollection(
        lines, colors=colours, linestyles=list(dashes), linewidths=1.6, joinstyle="round", zorder=2
    )
    axes.add_collection(collection)
    axes.autoscale_view()


def _force_rows(
    run: Results, depth: Axis, force: Axis
) -> tuple[curves.Rows, Sequence[float], curves.Interpolator]:
    """Return the rows of a result, the points drawn before them, and their interpolation."""
    jumps = has_adhesion(run.path)  # Between two rows an adhesive tip may snap in or pull off.
    begin = [0.0] if jumps is False and len(run) and run["delta"][0] > 0 else []
    rows = run["delta"], depth(run["delta"]), force(run["force"])
    return rows, begin, curves.polyline if jumps else curves.smooth_curve


def _draw_error_bands(axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis) -> None:
    """Draw the error bands of all results that have them, with one entry in the legend."""
    runs_with_errors = [
        i for i, run in enumerate(runs) if np.isfinite(run.table.get("force_error", np.nan)).any()
    ]
    for i in runs_with_errors:
        x = depth(runs[i]["delta"])
        y = force(runs[i]["force"])
        half_widths = force(np.nan_to_num(runs[i]["force_error"]))
        last_error = _last_error_text(half_widths, y) if len(runs) == 1 else ""
        label = f"{ERROR_LABEL}{last_error}" if i == runs_with_errors[-1] else None
        colour = curves.line_style(i, len(runs))["color"]
        if len(x) == 1:  # A band needs two points.
            axes.errorbar(x, y, half_widths, color=colour, alpha=0.5, capsize=6, ls="", label=label)
            continue
        for rows, _ in curves.split_branches(runs[i]["delta"]):
            ends = [(y + side * half_widths)[rows] for side in (-1, 1)]
            # `smooth_curve` joins negative forces by straight lines: then both ends are straight.
            straight = ends[0].min() < 0
            (along, below), (_, above) = (
                (x[rows], end) if straight else curves.smooth_curve(x[rows], end) for end in ends
            )
            axes.fill_between(along, below, above, color=colour, alpha=0.2, lw=0, label=label)
            label = None


def _draw_theory(axes: Axes, theory: Report, depth: Axis, force: Axis) -> None:
    """Draw the curve of the reference theory, and the formula of the half-space."""
    # Longer labels are shortened.
    max_letters = 120
    if (curve := theory.get("curve", {})).get("delta"):
        # The stable branch of an adhesive tip begins at a negative depth, not at the origin.
        begin = [0.0] if curve["delta"][0] > 0 else []
        drawn = curves.smooth_curve(
            depth([*begin, *curve["delta"]]), force([*begin, *curve["force"]])
        )
        deviation = theory.get("force_deviation")
        deviation_text = "" if deviation is None else f", this run {deviation:+.2%}"
        if "delta_deviation" in theory:
            deviation_text = f", depth of this run {theory['delta_deviation']:+.2%}"
        label = picture_text(f"{theory.get('name', 'theory')}{deviation_text}", max_letters)
        axes.plot(*drawn, **THEORY_STYLE, label=label)
        if error := theory.get("error"):
            along, middle = drawn
            ends = middle * (1 - error), middle * (1 + error)
            axes.fill_between(along, *ends, color=THEORY_STYLE["color"], alpha=0.15, lw=0)
    if half_space := theory.get("half_space"):
        deviation = half_space.get("deviation")
        deviation_text = "" if deviation is None else f": {_deviation_text(deviation)}"
        label = picture_text(
            f"{half_space['name'].split(' (')[0]}, half-space{deviation_text}", max_letters
        )
        # The point is the formula's force at the run's depth, or its depth at the run's force.
        formula_point = {**theory, **half_space}
        # Results of older versions do not contain a curve of the formula.
        curve = half_space.get("curve", {"delta": (), "force": ()})
        x = depth([0, *curve["delta"]])
        y = force([0, *curve["force"]])
        # The formula's depth can be larger than that of the run in load control.
        if formula_point["delta"] > 1.001 * max(curve["delta"], default=0.0):
            x = np.append(x, depth(formula_point["delta"]))
            y = np.append(y, force(formula_point["force"]))
        axes.plot(*curves.smooth_curve(x, y), **FORMULA_STYLE)
        hollow: PlotStyle = {
            "marker": "D",
            "mfc": "none",
            "mec": GREY,
            "ls": "",
            "ms": 6,
            "zorder": 2,
        }
        axes.plot(
            depth([formula_point["delta"]]), force([formula_point["force"]]), **hollow, label=label
        )


def _deviation_text(deviation: float) -> str:
    """Return as text by how much a formula deviates from this run."""
    percent_text = f"{abs(deviation):.1%}"
    if percent_text == "0.0%":
        return "as this run"
    side = "below" if deviation < 0 else "above"
    return f"{percent_text} {side} this run"


def _last_error_text(half_widths: np.ndarray, y: np.ndarray) -> str:
    """Return the error at the last step as text, since a narrow error band is hard to read."""
    if y[-1] == 0:
        return ""
    last = abs(half_widths[-1] / y[-1])
    # A small error is written with an exponent, because it would be rounded to 0.00 %.
    percent_text = f"{last:.2%}" if last >= 5e-5 else f"{100 * last:.0e}%"
    return f", \N{PLUS-MINUS SIGN}{percent_text} at the last step"


def _runs_with_radius(runs: Sequence[Results]) -> list[int]:
    """Return the indices of results with a contact radius, or without any rows."""
    return [i for i, run in enumerate(runs) if not len(run) or np.isfinite(run["a"]).any()]


def _draw_radius(axes: Axes, runs: Sequence[Results], theory: Report | None) -> None:
    """Draw contact radii over depth."""
    depth = axis_of_column("delta", runs)
    radius = axis_of_column("a", runs)
    for i in _runs_with_radius(runs):
        run = runs[i]
        joined = curves.polyline if has_adhesion(run.path) else curves.smooth_curve
        rows = run["delta"], depth(run["delta"]), radius(run["a"])
        curves.draw_rows(axes, rows, curves.line_style(i, len(runs)), joined=joined)
    curve = (theory or {}).get("curve", {})
    if curve.get("a"):
        axes.plot(*curves.smooth_curve(depth(curve["delta"]), radius(curve["a"])), **THEORY_STYLE)
    axes.set(xlabel=depth.label, ylabel=radius.label)
    figures.start_at_zero(axes, *(radius(run["a"]) for run in runs), radius(curve.get("a", [])))


def slide_force_column(results: Results) -> str:
    """Return the column of the side force along the slide; empty if the tip does not slide."""
    name = f"side_force_{results.report.get('slide_axis')}"
    return name if name in results.table and np.any(results.table.get("x", 0.0)) else ""


def draw_side_force(axes: Axes, results: Results, side_force: str) -> None:
    """Draw the side force over the slide, with the work and the dissipation of the last loop."""
    slide = axis_of_column("x", [results])
    force = axis_of_column(side_force, [results])
    first = max(int(np.flatnonzero(results["x"])[0]) - 1, 0)
    x = results["x"][first:]
    F = results[side_force][first:]
    style = curves.line_style(0, 1)
    marker = style["marker"] if len(x) <= figures.MAX_MARKED_POINTS else ""
    axes.plot(slide(x), force(F), color=style["color"], marker=marker, ms=3.5, lw=1.2)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.set(xlabel=Axis(f"slide {side_force[-1]}", unit=slide.unit).label, ylabel=force.label)
    begin = _loop_begin(x)
    name = "slide" if begin is None else "last loop"
    begin = begin or 0
    work = -path_integral(x[begin:], F[begin:])
    text = f"{name}: work {work:.4g}"
    if "dissipation" in results.table:
        dissipated = float(results["dissipation"][first + begin + 1 :].sum())
        text += f", dissipated {dissipated:.4g}"
    axes.set_title(text, loc="left", fontsize="small", color=GREY)


def _loop_begin(x: np.ndarray) -> int | None:
    """Return the last row at which a closed loop of the slide begins; it ends at the last row.

    The result is None if the tip was not at its last position before.
    """
    span = np.ptp(x)
    same = np.flatnonzero(np.abs(x[:-1] - x[-1]) <= 1e-9 * span)
    begins = [int(i) for i in same if np.ptp(x[i:]) > 0.01 * span]
    return begins[-1] if begins else None


def subtitle(results: Results) -> str:
    """Return model, method and status of a result as a subtitle."""
    report = results.report
    parts = [
        plan_choice(report, "symmetry"),
        plan_choice(report, "kinematics"),
        report.get("method"),
    ]
    if report.get("gap"):
        parts.append(
            f"gap at the {'undeformed' if report['gap'] == 'reference' else 'deformed'} point"
        )
    if report.get("status") not in (None, "done", "running"):
        parts.append(f"{report['status']}: {report.get('reason') or 'no reason given'}")
    words = dict.fromkeys(str(part).replace("_", " ") for part in parts if part)
    return "  ·  ".join(word if len(word) <= 90 else f"{word[:89]}…" for word in words)


def _refuse_mixed_kinematics(runs: Sequence[Results]) -> None:
    """Raise UsageError if only some results have forces per unit length."""
    flat = {is_plane_strain(run): run.path for run in runs if plan_choice(run.report, "kinematics")}
    if len(flat) > 1:
        raise UsageError(
            f"the forces of {flat[True]} are per length, those of {flat[False]} are not: draw "
            "them separately"
        )


def _unit_suffixes(runs: Sequence[Results]) -> list[str]:
    """Return the units of each result as a suffix of its name; empty if all have the same units."""
    units = [run.report.get("units") or {} for run in runs]
    unit_texts = [
        " and ".join(filter(None, (unit_label(kind, labels) for kind in ("length", "force"))))
        for labels in units
    ]
    return [
        f" [{labels or 'unit unknown'}]" if len(set(unit_texts)) > 1 else ""
        for labels in unit_texts
    ]
