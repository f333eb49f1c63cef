"""Pictures of fits: one curve with fit, residuals and depth ranges, or many intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import CurveFit, one_line_summary, quantity_kind
from indent_sim.results.measured.measurement import MeasuredCurve, curve_parts
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import Axis, picture_text, scaled_axis
from indent_sim.results.pictures.figures import COLOURS, GREY, INK, Axes, Figure, PlotStyle
from indent_sim.results.reader import Results

Entry = Mapping[str, Any]


@contextmanager
def fit_figure(fit: CurveFit, config: Config, note: str = "") -> Iterator[Figure]:
    """Yield the figure of one curve: force and fit, residuals, and the first key by depth range.

    The residuals are in per cent of the largest force. A note ends the line below the title.
    """
    assert fit.plotted is not None
    with figures.new_figure((10.5, 5.2)) as figure:
        panels: dict[str, Axes] = figure.subplot_mosaic(
            [["force", "window"], ["residual", "window"]],
            width_ratios=[1.5, 1],
            height_ratios=[2.2, 1],
        )
        _draw_forces(panels["force"], panels["residual"], fit, config)
        keys = list(fit.entry["parameters"])
        if keys:
            range_name = "depth" if fit.plotted.t is None else "time in contact"
            _draw_depth_ranges(
                panels["window"],
                fit.entry,
                keys[0],
                _parameter_axis(config, keys[0], [fit.entry]),
                range_name,
            )
        subtitle = "  ·  ".join(filter(None, [one_line_summary(fit.entry, config), note]))
        figures.draw_title(figure, picture_text(fit.name), subtitle)
        yield figure


def draw_curve(fit: CurveFit, config: Config, path: Path, note: str = "") -> None:
    """Draw one curve into a file; see `fit_figure`."""
    with fit_figure(fit, config, note) as figure:
        figures.save(figure, path)


def draw_rejected_curve(
    curve: MeasuredCurve, fit: CurveFit, config: Config, path: Path, note: str = ""
) -> None:
    """Draw the force of a rejected curve over its depth or displacement, one line for each part.

    A note ends the line below the title.
    """
    with figures.new_figure((8.0, 5.2)) as figure:
        axes = figure.subplots()
        make_axis = _axis_factory(config)
        column = curve.available_abscissa("z")
        name = "displacement z" if column == "z" else "depth δ"
        x = make_axis("length", curve.abscissa_values(column), name)
        force = make_axis("force", curve.force, "force F")
        parts = curve.parts or {"measured": slice(None)}
        for k, (part, rows) in enumerate(parts.items()):
            style: PlotStyle = {"ls": "", "marker": ".", "ms": 3, "color": COLOURS[k % 4]}
            axes.plot(
                x(curve.abscissa_values(column)[rows]),
                force(curve.force[rows]),
                label=part,
                **style,
            )
        axes.set(xlabel=x.label, ylabel=force.label)
        axes.legend(loc="best")
        subtitle = "  ·  ".join(filter(None, [f"refused: {fit.entry['reason']}", note]))
        figures.draw_title(figure, picture_text(curve.name), subtitle)
        figures.save(figure, path)


def draw_parameter_intervals(
    entries: Sequence[Entry], keys: Sequence[str], config: Config, path: Path
) -> None:
    """Draw the first varied key of many curves with its intervals, ordered by its value.

    Markers of curves that the scene does not explain are hollow.
    """
    done_entries = [entry for entry in entries if entry["status"] == "done"]
    if not done_entries or not keys:
        return
    axis = _parameter_axis(config, keys[0], done_entries)
    ordered = sorted(done_entries, key=lambda entry: float(entry["parameters"][keys[0]]["value"]))
    with figures.new_figure((9.2, 4.8)) as figure:
        axes = figure.subplots()
        for explained, name in ((True, "explained by the scene"), (False, "not explained")):
            ranks = [
                k
                for k, entry in enumerate(ordered, start=1)
                if bool(entry["explained"]) is explained
            ]
            intervals = [ordered[k - 1]["parameters"][keys[0]] for k in ranks]
            if not ranks:
                continue
            value, low, high = (
                axis([interval[end] for interval in intervals]) for end in ("value", "low", "high")
            )
            style: PlotStyle = {
                "fmt": "o",
                "ms": 4,
                "lw": 1.0,
                "color": COLOURS[0 if explained else 1],
            }
            face = {} if explained else {"mfc": "white"}
            axes.errorbar(ranks, value, [value - low, high - value], label=name, **style, **face)
        axes.set(xlabel="curve, by size", xlim=(0.5, len(done_entries) + 0.5), ylabel=axis.label)
        # Names of more curves would overlap.
        max_names = 40
        if len(ordered) <= max_names:
            names = _short_names([str(entry["curve"]) for entry in ordered])
            axes.set_xticks(range(1, len(names) + 1), names, rotation=90, fontsize=8)
        else:
            axes.locator_params(axis="x", integer=True)
        axes.margins(y=0.2)  # space for the two lines of the legend
        axes.legend(loc="upper left")
        rejected_count = len(entries) - len(done_entries)
        rejected_text = f", {rejected_count} refused" if rejected_count else ""
        count = "1 curve" if len(done_entries) == 1 else f"{len(done_entries)} curves"
        figures.draw_title(
            figure, f"{count}{rejected_text}", "95 % intervals; fit.csv has a row for each curve"
        )
        figures.save(figure, path)


def _short_names(names: Sequence[str]) -> list[str]:
    """Return names for a picture, without a long prefix that all have in common."""
    max_letters = 20
    columns = zip(*names, strict=False)
    same = list(takewhile(lambda letters: len(set(letters)) == 1, columns))
    common = min(len(same), min(map(len, names)) - 3)
    if len(names) == 1 or max(map(len, names)) <= max_letters or common < 1:
        return [picture_text(name, max_letters) for name in names]
    return [picture_text(f"…{name[common:]}", max_letters) for name in names]


def _draw_forces(force_axes: Axes, residual_axes: Axes, fit: CurveFit, config: Config) -> None:
    """Draw measured and fitted forces, and their residuals."""
    curve = fit.plotted
    make_axis = _axis_factory(config)
    assert curve is not None
    depth = float(curve.delta.max())
    # Shown length of the baseline, in indentation depths.
    shown_baseline_depths = 1.0
    is_shown = curve.delta > -shown_baseline_depths * depth
    delta = make_axis("length", curve.delta[is_shown], "depth δ")
    force = make_axis("force", curve.force[is_shown], "force F")
    x = delta(curve.delta[is_shown])
    x_label = delta.label
    # Over depth a hold would be a vertical line: draw it over time.
    if curve.t is not None and _has_hold(curve.delta[is_shown]):
        x = curve.t[is_shown]
        x_label = "time t [s]"
    grey_points: PlotStyle = {"ls": "", "marker": ".", "ms": 3, "color": "#b0b0b0", "zorder": 1}
    force_axes.plot(x, force(curve.force[is_shown]), label="measured", **grey_points)
    fit_style: PlotStyle = {"color": COLOURS[0], "lw": 1.8, "zorder": 3}
    force_axes.plot(x, force(curve.fit[is_shown]), label="scene", **fit_style)
    for k, (name, alternative_fit) in enumerate(curve.alternative_fits.items(), start=1):
        force_axes.plot(
            x,
            force(alternative_fit[is_shown]),
            label=f"{name} instead",
            color=COLOURS[k],
            ls="--",
            lw=1.2,
        )
    force_axes.set(ylabel=force.label)
    force_axes.legend(loc="best")
    residual = (
        100 * (curve.force - curve.fit)[is_shown] / max(float(np.abs(curve.fit).max()), 1e-300)
    )
    residual_axes.plot(x, residual, **grey_points)
    # Number of block means that are drawn over the residuals.
    residual_means = 40
    block_size = max(1, len(residual) // residual_means)
    used_length = len(residual) // block_size * block_size
    means = (values[:used_length].reshape(-1, block_size).mean(axis=1) for values in (x, residual))
    residual_axes.plot(*means, color=INK, lw=1.0)
    residual_axes.axhline(0, color=GREY, lw=0.6)
    residual_axes.set(xlabel=x_label, ylabel="residual [%]")


def _has_hold(delta: np.ndarray) -> bool:
    """Return True if a curve has a hold or a retraction."""
    return set(curve_parts(delta)) != {"approach"}


def _draw_depth_ranges(axes: Axes, entry: Entry, key: str, axis: Axis, range_name: str) -> None:
    """Draw the values of a key from parts of the curve and other models, and the stated interval.

    The parts of the curve are ranges of depth or time.
    """
    interval = entry["parameters"][key]
    windows = entry["window"]
    axes.axhspan(
        float(axis(interval["low"])),
        float(axis(interval["high"])),
        color=COLOURS[0],
        alpha=0.15,
        lw=0,
    )
    upper = [100 * window["upper"] for window in windows]
    value, low, high = (
        axis([window[f"{key}{end}"] for window in windows]) for end in ("", "_low", "_high")
    )
    axes.errorbar(
        upper, value, [value - low, high - value], fmt="o", ms=4, lw=1.0, color=COLOURS[0]
    )
    model_count = 0
    # Position of the first alternative model beside the depth ranges, and distance of the next
    # ones.
    first_position = 1.06
    spacing = 0.03
    for k, model in enumerate(entry["models"], start=1):
        if model["name"] in entry["cause"]:
            model_value = axis(model["value"])
            bar = axis([[model["value"] - model["low"]], [model["high"] - model["value"]]])
            x_position = 100 * (first_position + spacing * model_count)
            model_count += 1
            axes.errorbar(
                [x_position],
                [model_value],
                bar,
                fmt="s",
                ms=4,
                lw=1.0,
                color=COLOURS[k],
                label=model["name"],
            )
    if model_count:
        # The legend stands above all bars, since it might hide any of them.
        low, high = axes.get_ylim()
        # Fraction of a panel's height that a line of the legend needs above the bars.
        legend_margin = 0.07
        axes.set_ylim(low, high + legend_margin * (1 + model_count) * (high - low))
        axes.legend(loc="upper right")
    axes.set(xlabel=f"{range_name} used [%]", ylabel=axis.label)


def _axis_factory(config: Config) -> Callable[[str, Any, str], Axis]:
    units = {"length": config.units.length, "force": config.units.force}
    return lambda kind, values, name: scaled_axis(
        kind, [Results(Path(), {}, {"units": units})], values, name
    )


def _parameter_axis(config: Config, key: str, entries: Sequence[Entry]) -> Axis:
    name = key.rpartition(".")[2]
    kind = quantity_kind(config, key)
    values = [entry["parameters"][key]["value"] for entry in entries]
    return _axis_factory(config)(kind, values, name) if kind else Axis(name)
