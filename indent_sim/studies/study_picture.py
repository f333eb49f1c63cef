"""Pictures of a study's curves (curves.png).

The pictures show force over depth of every run, and the last force (largest force of a time
history) over each varied number. If all runs have a hold, they show the normalized force relaxation
(F - F_end)/(F_start - F_end) over time, and its half-time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from indent_sim.config.strict_yaml import short_yaml
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import axis_of_column, picture_text
from indent_sim.results.pictures.curves import smooth_curve
from indent_sim.results.pictures.figures import FORMULA_STYLE, Axes, Figure, PlotStyle
from indent_sim.results.pictures.forces import draw_force, draw_force_lines
from indent_sim.results.reader import MEASURED, Results
from indent_sim.results.relaxation_in_hold import HoldRelaxation, first_hold
from indent_sim.results.result_files import Report
from indent_sim.studies import small_multiples, study_table
from indent_sim.studies.curve_table import CurveGroups, distinguishing_labels
from indent_sim.studies.small_multiples import (
    DASHES,
    MAX_COLOURS,
    draw_number_bar,
    draw_over_number,
    key_label,
    representative_values,
    set_plain_log_ticks,
    styles_by_key,
    value_ratio,
)
from indent_sim.studies.study_table import Row

# With more curves than this, colours show a key, and the curves have no names.
MAX_NAMED_CURVES = 8
SCOREBOARD_MARK: PlotStyle = {"ls": "", "marker": "o", "ms": 6, "zorder": 3}


def draw_cost(
    rows: Sequence[Row], keys: Sequence[str], title: str, reference: str, path: Path
) -> None:
    """Draw study.png: force error over CPU time, and over the varied number if there is one.

    If there are no errors, the picture is deleted.
    """
    compared_rows = study_table.rows_with_error(rows)
    if not compared_rows:
        path.unlink(missing_ok=True)
        return
    varying_keys = [
        key
        for key in keys
        if _is_numeric(compared_rows, key) and len({row[key] for row in compared_rows}) > 1
    ]
    number_key = varying_keys[0] if len(varying_keys) == 1 else None
    groups = _group_rows(compared_rows, keys, number_key)
    # Number of groups for which the legend fits, and additional height for each further group
    # [inches].
    base_count = 4
    height_per_group = 0.2
    height = 5.0 + height_per_group * max(0, len(groups) - base_count)
    names, widths = (
        (["work", "number", "names"], [1, 1, 0.62]) if number_key else (["work", "names"], [1, 0.5])
    )
    with figures.new_figure((12.4 if number_key else 9.6, height)) as figure:
        panels: dict[str, Axes] = figure.subplot_mosaic([names], width_ratios=widths)
        failed_count = sum(row["status"] == "failed" for row in rows)
        runs_text = f"{len(rows)} runs" + (f", {failed_count} failed" if failed_count else "")
        figures.draw_title(figure, title, f"{runs_text}  ·  force error against {reference}")
        _draw_error_over_cost(panels["work"], groups)
        front = study_table.pareto_front(rows)
        named_rows = _draw_pareto_front(panels["work"], front)
        if number_key:
            _draw_error_over_number(panels["number"], groups, number_key)
        value_labels = {
            key: _value_labels(compared_rows, key)
            for key in study_table.independent_keys(compared_rows, keys)
        }
        _draw_legend(panels["names"], panels["work"], named_rows, len(front), value_labels)
        figures.save(figure, path)


def draw_curves(curve_groups: CurveGroups, title: str, path: Path) -> None:
    """Draw curves.png with the curves of a study; delete the picture if there are no runs."""
    if not curve_groups.curves:
        path.unlink(missing_ok=True)
        return
    with curves_figure(curve_groups, title) as figure:
        figures.save(figure, path)


@contextmanager
def curves_figure(curve_groups: CurveGroups, title: str) -> Iterator[Figure]:
    """Yield the figure of a study with at least one curve.

    Many runs that differ in several keys are drawn as small multiples.
    """
    holds = [first_hold(curve.results) for curve in curve_groups.curves]
    if (
        len(curve_groups.keys) > 1
        and len(curve_groups.curves) > MAX_NAMED_CURVES
        and not _common_holds(holds)
    ):
        with small_multiples.small_multiples_figure(curve_groups, title) as figure:
            yield figure
        return
    number_keys = curve_groups.numeric_keys()[: small_multiples.MAX_NUMBER_PANELS]
    count = len(curve_groups.curves)
    styles, names, colour_scale = _curve_styles(curve_groups)
    # Width and height of the panels of curves.png [inches].
    panel_size = 4.4
    width = panel_size * (1 + len(number_keys))
    with figures.new_figure((width, panel_size)) as figure:
        panels = figure.subplots(1, 1 + len(number_keys), squeeze=False)[0]
        _draw_force_curves(panels[0], curve_groups, styles, names, holds)
        legend_heights = [0.0]
        if colour_scale is None:
            legend_heights.append(figures.draw_legend_under(panels[0]))
        else:
            label = key_label(curve_groups, number_keys[0])
            draw_number_bar(list(panels), colour_scale, label)
        for axes, key in zip(panels[1:], number_keys, strict=True):
            _draw_over_number(axes, curve_groups, key, styles, holds)
            legend_heights.append(figures.draw_legend_under(axes))
        figure.set_size_inches(width, panel_size + max(legend_heights))
        hold_subtitle = "normalized force relaxation in the hold, (F - F_end)/(F_start - F_end)"
        subtitle = hold_subtitle if _common_holds(holds) else "each force at the depth of its run"
        figures.draw_title(figure, title, f"{count} run{'s' * (count > 1)}  ·  {subtitle}")
        yield figure


def draw_curves_into(axes: Axes, curve_groups: CurveGroups) -> None:
    """Draw the curves of a study into given axes, with a legend inside."""
    holds = [first_hold(curve.results) for curve in curve_groups.curves]
    styles, names, colour_scale = _curve_styles(curve_groups)
    _draw_force_curves(axes, curve_groups, styles, names, holds)
    if colour_scale is not None:
        label = key_label(curve_groups, curve_groups.numeric_keys()[0])
        draw_number_bar([axes], colour_scale, label)
    elif axes.get_legend_handles_labels()[1]:
        axes.legend()


def requested_figure(
    curve_groups: CurveGroups, panel: str, title: str
) -> AbstractContextManager[Figure]:
    """Return the figure of a study's curves, or of one of its columns over the varied numbers."""
    if panel in small_multiples.PLOTTED_COLUMNS:
        return small_multiples.column_figure(curve_groups, panel, title)
    return curves_figure(curve_groups, title)


def _curve_styles(curve_groups: CurveGroups) -> tuple[list[PlotStyle], list[str], Any]:
    """Return style and name of every curve, and a colour scale (or None) in place of names.

    Curves that differ in one number, and many curves, are coloured by the first number.
    """
    count = len(curve_groups.curves)
    number_keys = curve_groups.numeric_keys()
    if number_keys and (len(curve_groups.keys) == 1 or count > MAX_NAMED_CURVES):
        styles, colour_scale = styles_by_key(curve_groups, number_keys[0])
        return styles, [""] * count, colour_scale
    return *_all_line_styles(curve_groups), None


def _all_line_styles(curve_groups: CurveGroups) -> tuple[list[PlotStyle], list[str]]:
    """Return the style and the legend name of every curve ("" for a repeated style).

    If there are few curves, each has a different style; otherwise the style depends on the first
    varied key. If this key has too many values for colours, all curves are grey and have no name.
    """
    names = curve_groups.curve_names()
    styles = (
        _styles_by_keys(curve_groups, curve_groups.keys)
        if len(set(names)) <= MAX_NAMED_CURVES
        else None
    )
    if styles is None:
        names = curve_groups.value_names(curve_groups.keys[:1])
        styles = _styles_by_keys(curve_groups, curve_groups.keys[:1])
    if styles is None:
        return [{"color": figures.GREY, "ls": "-"} for _ in names], [""] * len(names)
    return styles, [name if names.index(name) == i else "" for i, name in enumerate(names)]


def _styles_by_keys(curve_groups: CurveGroups, keys: Sequence[str]) -> list[PlotStyle] | None:
    """Return the style of every curve by some varied keys; None if they have too many values.

    Either each combination of values has a colour, or each value of one key has a colour and each
    combination of the other values a dash pattern.
    """
    for colour_keys, dash_keys in ((keys, ()), (keys[:1], keys[1:]), (keys[1:], keys[:1])):
        colours = curve_groups.value_names(colour_keys)
        dashes = curve_groups.value_names(dash_keys)
        colour_names = list(dict.fromkeys(colours))
        dash_names = list(dict.fromkeys(dashes))
        if len(colour_names) <= MAX_COLOURS and len(dash_names) <= len(DASHES):
            style_indices = [
                (colour_names.index(colour_name), dash_names.index(dash_name))
                for colour_name, dash_name in zip(colours, dashes, strict=True)
            ]
            return [
                {
                    "color": figures.COLOURS[colour_index],
                    "marker": figures.MARKERS[colour_index],
                    "ls": DASHES[dash_index],
                }
                for colour_index, dash_index in style_indices
            ]
    return None


def _group_styles(curve_groups: CurveGroups, key: str) -> list[PlotStyle] | None:
    """Return the style of each curve in a panel over the varied number `key`.

    The style shows the values of the other varied keys.

    The result is None if the other keys give too many lines.
    """
    other_keys = [other_key for other_key in curve_groups.keys if other_key != key]
    # Lines in a panel have no names if there are more of them.
    max_named_groups = 12
    is_few = 1 < len(set(curve_groups.value_names(other_keys))) <= max_named_groups
    return _styles_by_keys(curve_groups, other_keys) if is_few else None


def draw_scoreboard(rows: Sequence[Row], title: str, path: Path) -> None:
    """Draw the differences of published and computed values from the exact values.

    The axis is linear within 0.1 % on both sides of 0 and logarithmic beyond. If there are no exact
    values, the picture is deleted.
    """
    # The axis begins at the bottom, but the first row belongs at the top.
    known_rows = [row for row in rows if row["exact"] is not None][::-1]
    if not known_rows:
        path.unlink(missing_ok=True)
        return
    # Height of a row of the scoreboard [inches].
    scoreboard_line_height = 0.27
    with figures.new_figure((9.2, 1.6 + scoreboard_line_height * len(known_rows))) as figure:
        axes = figure.subplots()
        wrong_count = sum(row["wrong"] in ("published", "both") for row in known_rows)
        count_text = (
            f"{len(known_rows)} published values  ·  {wrong_count} outside their claimed accuracy"
        )
        for row_number, row in enumerate(known_rows):
            _draw_scoreboard_line(axes, row_number, row)
        axes.plot([], [], color=figures.INK, **SCOREBOARD_MARK, label="published")
        if wrong_count:
            axes.plot(
                [],
                [],
                color=figures.COLOURS[1],
                **SCOREBOARD_MARK,
                label="published, outside the claimed accuracy",
            )
        axes.set_yticks(
            range(len(known_rows)),
            [picture_text(f"{row['case']}: {row['quantity']}", 48) for row in known_rows],
        )
        # The axis of the scoreboard is logarithmic beyond this difference [per cent].
        linear_percent = 0.1
        axes.set_xscale("symlog", linthresh=linear_percent)
        largest_difference = max(1.0, *(abs(row["difference"]) for row in known_rows))
        ticks = [
            tick
            for tick in (-100, -10, -1, -linear_percent, 0, linear_percent, 1, 10, 100)
            if abs(tick) <= 3 * largest_difference
        ]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xlim(-3 * largest_difference, 3 * largest_difference)
        axes.axvline(0, color=figures.INK, lw=0.8, zorder=1)
        axes.set(xlabel="difference from the exact value [%]", ylim=(-0.7, len(known_rows) - 0.3))
        figures.draw_figure_legend(figure, axes)
        figures.draw_title(figure, title, f"{count_text}  ·  ours with its own error bar")
        figures.save(figure, path)


def _draw_scoreboard_line(axes: Axes, row_number: int, row: Row) -> None:
    """Draw a published value and ours by their differences from the exact value.

    The claimed error of the published value is drawn as a band.
    """
    claimed_percent = 100 * (row["within"] or 0.0)
    is_first = row_number == 0
    band = {"color": "#d9d9d9", "height": 0.6, "zorder": 0}
    label = "accuracy claimed by the source, if any" if is_first else None
    axes.barh(row_number, 2 * claimed_percent, left=-claimed_percent, label=label, **band)
    colour = figures.COLOURS[1] if row["wrong"] in ("published", "both") else figures.INK
    axes.plot(row["difference"], row_number, color=colour, **SCOREBOARD_MARK)
    if row["ours_difference"] is not None:
        bar = 100 * abs((row["our_error"] or 0.0) / row["exact"])
        bar_style: PlotStyle = {
            "fmt": "s",
            "ms": 4,
            "capsize": 3,
            "color": figures.COLOURS[0],
            "zorder": 4,
        }
        axes.errorbar(
            row["ours_difference"],
            row_number,
            xerr=bar,
            label="ours" if is_first else None,
            **bar_style,
        )


Holds = Sequence[HoldRelaxation | None]


def _draw_force_curves(
    axes: Axes,
    curve_groups: CurveGroups,
    styles: Sequence[PlotStyle],
    names: Sequence[str],
    holds: Holds,
) -> None:
    """Draw force over depth of every run, or the force relaxation if all runs have a hold."""
    runs = [curve.results for curve in curve_groups.curves]
    # Longer names in a legend are cut.
    max_legend_letters = 48
    # Matplotlib leaves labels that begin with "_" out of legends.
    labels = [picture_text(name, max_legend_letters) or "_" for name in names]
    if common_holds := _common_holds(holds):
        for hold, style, name in zip(common_holds, styles, labels, strict=True):
            axes.plot(
                hold.t[1:],
                hold.remaining_fraction[1:],
                color=style["color"],
                ls=style["ls"],
                lw=1.5,
                label=name,
            )
        axes.set(
            xscale="log",
            xlabel=f"time in the hold t{_time_unit(curve_groups)}",
            ylabel="normalized force relaxation",
        )
        axes.axhline(0.5, color=figures.GREY, lw=0.6, ls=":", zorder=0)
        return
    depth = axis_of_column("delta", runs)
    force = axis_of_column("force", runs)
    if len(runs) > MAX_NAMED_CURVES and {*labels} == {"_"} and all(_is_line(run) for run in runs):
        draw_force_lines(axes, runs, depth, force, styles)
    else:
        for run, style, name in zip(runs, styles, labels, strict=True):
            draw_force(axes, run, depth, force, style | {"marker": ""}, name)
    if formula := _common_formula(runs):
        formula_points = (
            depth([0, *formula["curve"]["delta"]]),
            force([0, *formula["curve"]["force"]]),
        )
        (line,) = axes.plot(
            *smooth_curve(*formula_points),
            **FORMULA_STYLE,
            label=picture_text(f"{formula['name']}, half-space"),
        )
        # The curves leave space in the upper left corner.
        axes.legend(handles=[line], loc="upper left")
    axes.set(xlabel=depth.label, ylabel=force.label)
    # Axes are logarithmic if the ratio of their values exceeds this. On linear axes most curves
    # would be indistinguishable from zero.
    log_ratio = 1000.0
    if value_ratio([run["delta"].max() for run in runs]) >= log_ratio:
        axes.set_xscale("log")
    if value_ratio([run["force"].max() for run in runs]) >= log_ratio:
        axes.set_yscale("log")
    else:
        axes.axhline(0, color=figures.GREY, lw=0.6, zorder=0)


def _is_line(run: Results) -> bool:
    """Return True if a run is drawn as a line, not as points (measured rows or a single row)."""
    return len(run) > 1 and not run.report.get(MEASURED)


def _common_formula(runs: Sequence[Results]) -> Report | None:
    """Return the half-space formula of the deepest run if all runs have the same one, or None."""
    formulas = [(run.report.get("theory") or {}).get("half_space") or {} for run in runs]
    if not all(
        formula.get("curve", {}).get("delta") and formula["curve"]["delta"][-1] > 0
        for formula in formulas
    ):
        return None
    deepest_formula: Report = max(
        formulas, key=lambda formula: float(formula["curve"]["delta"][-1])
    )
    x, y = (np.array([0.0, *deepest_formula["curve"][name]]) for name in ("delta", "force"))
    ends = [(formula["curve"]["delta"][-1], formula["curve"]["force"][-1]) for formula in formulas]
    # Relative difference up to which two runs have the same half-space formula; interpolation
    # between points of its curve is more accurate.
    formula_tolerance = 1e-3
    is_common = all(
        abs(np.interp(delta, *smooth_curve(x, y)) / force - 1) < formula_tolerance
        for delta, force in ends
        if force
    )
    return deepest_formula if is_common else None


def _time_unit(curve_groups: CurveGroups) -> str:
    """Return the unit of times for a label; "" for scenes without units."""
    has_units = any(
        (curve.results.report.get("units") or {}).get("length") for curve in curve_groups.curves
    )
    return " [s]" if has_units else ""


def _common_holds(holds: Holds) -> list[HoldRelaxation]:
    """Return the hold of every run if each has a hold with a decreasing force, otherwise []."""
    # The half time is NaN if the force does not fall.
    holds_with_fall = [hold for hold in holds if hold and hold.half_time == hold.half_time]
    return holds_with_fall if len(holds_with_fall) == len(holds) else []


def _draw_over_number(
    axes: Axes, curve_groups: CurveGroups, key: str, styles: Sequence[PlotStyle], holds: Holds
) -> None:
    """Draw the representative force or half-time of every run over a varied number.

    The half-time is that of the force relaxation in the hold of the run.
    """
    values, label = representative_values(curve_groups, "force")
    common_holds = _common_holds(holds)
    if common_holds:
        values = [hold.half_time for hold in common_holds]
        label = f"half-time of the force relaxation t{_time_unit(curve_groups)}"
    group_styles = _group_styles(curve_groups, key)
    draw_over_number(axes, curve_groups, key, values, label, styles, group_styles)
    number_ratio = value_ratio(curve_groups.key_numbers(key))
    if common_holds:
        axes.set_yscale("log")
    if common_holds and number_ratio > 1:
        axes.set_xscale("log")
        set_plain_log_ticks(axes.xaxis, number_ratio)


def _draw_error_over_cost(axes: Axes, groups: dict[str, list[Row]]) -> None:
    """Draw the force error of every run over its CPU time."""
    for i, (name, rows) in enumerate(groups.items()):
        style = _marker_style(i) | {"label": picture_text(name) or "runs"}
        axes.plot(
            [row["cpu_s"] for row in rows],
            [_relative_error_size(row) for row in rows],
            ls="",
            **style,
        )
    _set_log_axes(
        axes, "CPU seconds of a run", [row["cpu_s"] for rows in groups.values() for row in rows], 1
    )


def _draw_pareto_front(axes: Axes, front: Sequence[Row]) -> list[Row]:
    """Draw the Pareto front as a line with numbered points; return the numbered rows."""
    points = [(row["cpu_s"], _relative_error_size(row)) for row in front]
    axes.plot(*zip(*points, strict=True), color=figures.INK, lw=1.2, zorder=2, label="Pareto front")
    # The positions are fractions of the panel's width and height.
    positions = axes.transLimits.transform(axes.transScale.transform(points))
    spaced = _spaced_points(positions)
    # Largest number of numbered points of the Pareto front; more would not fit into the
    # legend.
    max_named_points = 8
    named_indices = [
        spaced[i]
        for i in np.linspace(0, len(spaced) - 1, min(max_named_points, len(spaced)))
        .round()
        .astype(int)
    ]
    left_below: PlotStyle = {
        "xytext": (-6, -6),
        "textcoords": "offset points",
        "ha": "right",
        "va": "top",
    }
    for number, i in enumerate(named_indices, start=1):
        axes.annotate(f"{number}", points[i], fontsize=9, fontweight="bold", **left_below)
    return [front[i] for i in named_indices]


def _spaced_points(positions: np.ndarray) -> list[int]:
    """Return the indices of points of a front at sufficient distances, including the last point."""
    kept_indices = [len(positions) - 1]
    # Points that are nearer to each other than these fractions of the panel's width and height have
    # no space for two numbers.
    label_distance = (0.03, 0.045)
    for i in reversed(range(len(positions) - 1)):
        if np.any(np.abs(positions[i] - positions[kept_indices[-1]]) >= label_distance):
            kept_indices.append(i)
    return kept_indices[::-1]


def _draw_error_over_number(axes: Axes, groups: dict[str, list[Row]], key: str) -> None:
    """Draw the force error of every run over a varied number."""
    for i, (name, rows) in enumerate(groups.items()):
        ordered = sorted((row for row in rows if row[key] is not None), key=lambda row: row[key])
        x = [row[key] for row in ordered]
        # If a number occurs twice, several curves share the colour and a line would zigzag.
        style = "-" if len(set(x)) == len(x) else ""
        axes.plot(
            x,
            [_relative_error_size(row) for row in ordered],
            ls=style,
            lw=1.0,
            **_marker_style(i),
            label=picture_text(name),
        )
    _set_log_axes(
        axes,
        picture_text(key),
        [row[key] for rows in groups.values() for row in rows if row[key] is not None],
    )


def _draw_legend(
    axes: Axes,
    cost_panel: Axes,
    named_rows: Sequence[Row],
    front_size: int,
    value_labels: dict[str, dict[str, str]],
) -> None:
    """Draw the meaning of the colours, and of the numbers on the Pareto front."""
    axes.axis("off")
    handles, labels = cost_panel.get_legend_handles_labels()
    axes.legend(handles, labels, loc="upper left", fontsize=9, borderaxespad=0)
    lines = [
        "Pareto front"
        if len(named_rows) == front_size
        else f"Pareto front, {len(named_rows)} of its {front_size} points"
    ]
    # Largest number of letters in a line of the legend, in which each point of the front has two
    # lines.
    max_letters = 44
    for number, row in enumerate(named_rows, start=1):
        first_line, *other_lines = wrap(_point_label(row, value_labels), max_letters) or [""]
        cost = f"{row['cpu_s']:.2g} s, {row['force_error_vs']:+.2g}"
        letters_left = max(1, max_letters - len(cost))
        second_line = [picture_text(" ".join(other_lines), letters_left)] if other_lines else []
        lines += [f"{number}  {picture_text(first_line)}", "    " + ": ".join([*second_line, cost])]
    axes.text(
        0,
        0,
        "\n".join(lines),
        fontsize=8,
        va="bottom",
        ha="left",
        linespacing=1.35,
        transform=axes.transAxes,
    )


def _point_label(row: Row, value_labels: dict[str, dict[str, str]]) -> str:
    """Return the varied values of a row as text; numbers and lists with their key."""
    value_texts = {
        key: labels[short_yaml(row[key])]
        for key, labels in value_labels.items()
        if row[key] is not None
    }
    has_key = {key: _is_number(row[key]) or value_texts[key].startswith("[") for key in value_texts}
    parts = [
        f"{key.split('.')[-1]} {text}" if has_key[key] else text
        for key, text in value_texts.items()
    ]
    return ", ".join(parts)


def _value_labels(rows: Sequence[Row], key: str) -> dict[str, str]:
    """Return a short text for every value of a key; the dictionary keys are values as YAML."""
    values = [row[key] for row in rows]
    return dict(zip(map(short_yaml, values), distinguishing_labels(values), strict=True))


def _group_rows(
    rows: Sequence[Row], keys: Sequence[str], number_key: str | None
) -> dict[str, list[Row]]:
    """Return the rows in groups that a few colours can distinguish.

    The groups differ in the contact method if it is varied, otherwise in a key with text values,
    otherwise in a number.
    """
    other_keys = [key for key in keys if key != number_key]
    word_keys = [key for key in other_keys if not _is_numeric(rows, key)]
    methods = ["method"] if any(key.split(".")[0] == "contact" for key in keys) else []
    for key in [*methods, *word_keys, *other_keys]:
        values = _value_labels(rows, key)
        if 1 < len(values) <= MAX_COLOURS:
            word = f"{key.split('.')[-1]} " if any(_is_number(row[key]) for row in rows) else ""
            return {
                f"{word}{label}": [row for row in rows if short_yaml(row[key]) == value]
                for value, label in values.items()
            }
    return {"": list(rows)}


def _is_numeric(rows: Sequence[Row], key: str) -> bool:
    """Return True if every value of a varied key is a number; `friction: [0.1, stick]` is not."""
    return all(_is_number(row[key]) for row in rows if row[key] is not None)


def _is_number(value: object) -> bool:
    """Return True for a number; booleans are not numbers."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _relative_error_size(row: Row) -> float:
    """Return the absolute value of the relative force error of a row."""
    return abs(row["force_error_vs"])


def _marker_style(i: int) -> PlotStyle:
    """Return the style of the points of a group of runs."""
    colour = figures.COLOURS[i % MAX_COLOURS]
    return {
        "color": colour,
        "marker": figures.MARKERS[i % 7],
        "ms": 6,
        "mec": "white",
        "mew": 0.6,
        "zorder": 3,
    }


def _set_log_axes(
    axes: Axes, x_label: str, values: Sequence[float], log_ratio: float = 3.0
) -> None:
    """Set a logarithmic error axis, and also a logarithmic x axis for a wide range of values.

    The range is wide if the ratio of the largest to the smallest value exceeds `log_ratio`.
    """
    axes.set(yscale="log", xlabel=x_label, ylabel="|relative error of the force|")
    if min(values) > 0 and max(values) > log_ratio * min(values):
        axes.set_xscale("log")
        set_plain_log_ticks(axes.xaxis, max(values) / min(values))
    one_percent = 0.01
    axes.axhline(one_percent, color=figures.GREY, lw=0.6, ls=":", zorder=1)
    label_style: PlotStyle = {
        "xycoords": ("axes fraction", "data"),
        "ha": "right",
        "va": "bottom",
        "fontsize": 8,
    }
    axes.annotate("1 %", (1, one_percent), color=figures.GREY, **label_style)
    axes.grid(True, which="major", color="#e4e4e4", lw=0.6, zorder=0)
    axes.margins(0.08)
