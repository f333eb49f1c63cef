"""Pictures of fits: one curve with its fit, residuals and windows; many curves with their intervals
in order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import CurveFit, in_short, kind_of
from indent_sim.results.measured.measurement import curve_parts
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import Axis, picture_text, scaled_axis
from indent_sim.results.pictures.figures import COLOURS, GREY, INK, Axes, Figure, PlotStyle
from indent_sim.results.reader import Results

# inches
SIZE = (10.5, 5.2)
MANY_SIZE = (9.2, 4.8)
BASELINE = 1.0  # depths of the baseline that are shown
RESIDUAL_MEANS = 40  # whose means are drawn over the residuals
# where other models stand beside the windows, and beside one another
OTHERS_AT = 1.06
OTHERS_APART = 0.03
NAME_ROOM = 0.07  # of the height of a panel: for a line of names above the bars
GREY_POINTS: PlotStyle = {"ls": "", "marker": ".", "ms": 3, "color": "#b0b0b0", "zorder": 1}
FITTED: PlotStyle = {"color": COLOURS[0], "lw": 1.8, "zorder": 3}
Entry = Mapping[str, Any]


@contextmanager
def pictured(fit: CurveFit, config: Config) -> Iterator[Figure]:
    """The figure of one curve: force with the fit, residuals in per cent of the largest force, and
    the first varied key by the depth that is used.
    """
    assert fit.drawn is not None
    with figures.new_figure(SIZE) as figure:
        panels: dict[str, Axes] = figure.subplot_mosaic(
            [["force", "window"], ["residual", "window"]],
            width_ratios=[1.5, 1],
            height_ratios=[2.2, 1],
        )
        _forces(panels["force"], panels["residual"], fit, config)
        keys = list(fit.entry["parameters"])
        if keys:
            used = "depth" if fit.drawn.t is None else "time in contact"
            _windows(
                panels["window"], fit.entry, keys[0], _axis_of(config, keys[0], [fit.entry]), used
            )
        figures.draw_title(figure, picture_text(fit.name), in_short(fit.entry, config))
        yield figure


def draw_curve(fit: CurveFit, config: Config, path: Path) -> None:
    """Draw one curve into a file."""
    with pictured(fit, config) as figure:
        figures.save(figure, path)


def draw_many(entries: Sequence[Entry], keys: Sequence[str], config: Config, path: Path) -> None:
    """Draw the first varied key of many curves with its intervals, in order of its size; hollow:
    not explained.
    """
    done = [entry for entry in entries if entry["status"] == "done"]
    if not done or not keys:
        return
    axis = _axis_of(config, keys[0], done)
    ordered = sorted(done, key=lambda entry: float(entry["parameters"][keys[0]]["value"]))
    with figures.new_figure(MANY_SIZE) as figure:
        axes = figure.subplots()
        for explained, name in ((True, "explained by the scene"), (False, "not explained")):
            places = [
                k
                for k, entry in enumerate(ordered, start=1)
                if bool(entry["explained"]) is explained
            ]
            stated = [ordered[k - 1]["parameters"][keys[0]] for k in places]
            if not places:
                continue
            value, low, high = (
                axis([one[end] for one in stated]) for end in ("value", "low", "high")
            )
            look: PlotStyle = {
                "fmt": "o",
                "ms": 4,
                "lw": 1.0,
                "color": COLOURS[0 if explained else 1],
            }
            face = {} if explained else {"mfc": "white"}
            axes.errorbar(places, value, [value - low, high - value], label=name, **look, **face)
        axes.set(xlabel="curve, by size", xlim=(0.5, len(done) + 0.5), ylabel=axis.label)
        axes.locator_params(axis="x", integer=True)
        axes.margins(y=0.2)  # the legend's two lines
        axes.legend(loc="upper left")
        refused = len(entries) - len(done)
        beside = f", {refused} refused" if refused else ""
        count = "1 curve" if len(done) == 1 else f"{len(done)} curves"
        figures.draw_title(
            figure, f"{count}{beside}", "95 % intervals; fit.csv has a row for each curve"
        )
        figures.save(figure, path)


def _forces(above: Axes, below: Axes, fit: CurveFit, config: Config) -> None:
    """Measured and fitted forces, and what is left."""
    drawn = fit.drawn
    labels = _shown(config)
    assert drawn is not None
    depth = float(drawn.delta.max())
    shown = drawn.delta > -BASELINE * depth
    delta = labels("length", drawn.delta[shown], "depth δ")
    force = labels("force", drawn.force[shown], "force F")
    x = delta(drawn.delta[shown])
    along = delta.label
    if drawn.t is not None and _stays(drawn.delta[shown]):  # a hold is no line straight down
        x = drawn.t[shown]
        along = "time t [s]"
    above.plot(x, force(drawn.force[shown]), label="measured", **GREY_POINTS)
    above.plot(x, force(drawn.fit[shown]), label="scene", **FITTED)
    for k, (name, other) in enumerate(drawn.named.items(), start=1):
        above.plot(
            x, force(other[shown]), label=f"{name} instead", color=COLOURS[k], ls="--", lw=1.2
        )
    above.set(ylabel=force.label)
    above.legend(loc="best")
    left = 100 * (drawn.force - drawn.fit)[shown] / max(float(np.abs(drawn.fit).max()), 1e-300)
    below.plot(x, left, **GREY_POINTS)
    size = max(1, len(left) // RESIDUAL_MEANS)
    whole = len(left) // size * size
    means = (one[:whole].reshape(-1, size).mean(axis=1) for one in (x, left))
    below.plot(*means, color=INK, lw=1.0)
    below.axhline(0, color=GREY, lw=0.6)
    below.set(xlabel=along, ylabel="residual [%]")


def _stays(delta: np.ndarray) -> bool:
    """Whether a curve is held, or comes back."""
    return set(curve_parts(delta)) != {"approach"}


def _windows(axes: Axes, entry: Entry, key: str, axis: Axis, used: str) -> None:
    """The key of each window, of so much depth or time, with its own interval over the stated one,
    and named models.
    """
    stated = entry["parameters"][key]
    windows = entry["window"]
    axes.axhspan(
        float(axis(stated["low"])), float(axis(stated["high"])), color=COLOURS[0], alpha=0.15, lw=0
    )
    upper = [100 * window["upper"] for window in windows]
    value, low, high = (
        axis([window[f"{key}{end}"] for window in windows]) for end in ("", "_low", "_high")
    )
    axes.errorbar(
        upper, value, [value - low, high - value], fmt="o", ms=4, lw=1.0, color=COLOURS[0]
    )
    named = 0
    for k, other in enumerate(entry["models"], start=1):
        if other["name"] in entry["cause"]:
            place = axis(other["value"])
            bar = axis([[other["value"] - other["low"]], [other["high"] - other["value"]]])
            at = 100 * (OTHERS_AT + OTHERS_APART * named)
            named += 1
            axes.errorbar(
                [at], [place], bar, fmt="s", ms=4, lw=1.0, color=COLOURS[k], label=other["name"]
            )
    if named:  # above all bars, each of which it might hide
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + NAME_ROOM * (1 + named) * (high - low))
        axes.legend(loc="upper right")
    axes.set(xlabel=f"{used} used [%]", ylabel=axis.label)


def _shown(config: Config) -> Callable[[str, Any, str], Axis]:
    units = {"length": config.units.length, "force": config.units.force}
    return lambda kind, values, name: scaled_axis(
        kind, [Results(Path(), {}, {"units": units})], values, name
    )


def _axis_of(config: Config, key: str, entries: Sequence[Entry]) -> Axis:
    name = key.rpartition(".")[2]
    kind = kind_of(config, key)
    values = [entry["parameters"][key]["value"] for entry in entries]
    return _shown(config)(kind, values, name) if kind else Axis(name)
