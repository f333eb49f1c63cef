"""Picture of a map: modulus, height at zero force, uncertainty or causes, and a histogram."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import quantity_kind
from indent_sim.fitting.map_result import MapFit
from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import Axis, printed_unit, scaled_axis
from indent_sim.results.pictures.figures import COLOURS, GREY, INK, Axes, Figure
from indent_sim.results.reader import Results

NO_VALUE = "#d0d0d0"  # colour of pixels without a value


def draw_map(
    map_fit: MapFit,
    config: Config,
    path: Path,
    panels: Sequence[str] = (),
    dpi: float | None = None,
) -> None:
    """Draw panels of a map into a file; see `map_figure`."""
    with map_figure(map_fit, config, panels) as figure:
        figures.save(figure, path, dpi)


@contextmanager
def map_figure(map_fit: MapFit, config: Config, panels: Sequence[str] = ()) -> Iterator[Figure]:
    """Yield the figure of a map with its four panels, or with the named panels of PANELS.

    Raises
    ------
    UsageError
        If there is no such panel.
    """
    if wrong := [name for name in panels if name not in PANELS]:
        raise UsageError(
            f"a map has no panel {wrong[0]}", f"--what must be one of {', '.join(PANELS)}"
        )
    names = panels or default_panels(map_fit)
    columns = min(len(names), 2)
    rows = math.ceil(len(names) / columns)
    with figures.new_figure((6.0 * columns, 4.3 * rows)) as figure:
        axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
        for panel, name in zip(axes, names, strict=False):
            PANELS[name](figure, panel, map_fit, config)
        for empty in axes[len(names) :]:
            empty.set_axis_off()
        fitted = int(np.count_nonzero(np.isfinite(map_fit.value)))
        curves = int(np.count_nonzero(map_fit.reason >= 0))
        refused = f", {curves - fitted} refused" if curves > fitted else ""
        subtitle = f"varied: {map_fit.key}"
        if fitted < map_fit.value.size:
            subtitle += "  ·  grey: no value"
        left = map_fit.entry.get("left", 0)
        waiting = f", {left} not yet" if left else ""
        title = f"{fitted} of {curves + left} curves fitted{refused}{waiting}"
        figures.draw_title(figure, title, subtitle)
        yield figure


def default_panels(map_fit: MapFit) -> tuple[str, ...]:
    """Return the four panels; causes of misfits replace the intervals if they are many."""
    max_unexplained = 0.05
    explained = np.nanmean(map_fit.explained) if np.isfinite(map_fit.explained).any() else 1.0
    third = "cause" if explained < 1.0 - max_unexplained else "interval"
    return ("modulus", "height", third, "histogram")


def _draw_modulus(figure: Figure, axes: Axes, map_fit: MapFit, config: Config) -> None:
    from matplotlib.colors import LogNorm

    axis = _value_axis(map_fit, config)
    values = axis(map_fit.value)
    finite = values[np.isfinite(values)]
    norm = None
    if len(finite):
        low, high = np.percentile(finite, [1, 99])
        # Values within a smaller factor have linear colours.
        max_linear_factor = 3.0
        norm = LogNorm(low, high) if low > 0 and high > max_linear_factor * low else None
        limits = {} if norm else {"vmin": low, "vmax": high}
    else:
        limits = {}
    _draw_image(figure, axes, values, map_fit, axis.label, norm=norm, cmap="viridis", **limits)
    axes.set_title(map_fit.key)


def _draw_height(figure: Figure, axes: Axes, map_fit: MapFit, config: Config) -> None:
    axis = _axis(config, "length", map_fit.height, "height")
    _draw_image(figure, axes, axis(map_fit.height), map_fit, axis.label, cmap="cividis")
    axes.set_title("height at zero force")


def _draw_interval(figure: Figure, axes: Axes, map_fit: MapFit, config: Config) -> None:
    percent = 50.0 * (map_fit.high - map_fit.low) / map_fit.value
    _draw_image(figure, axes, percent, map_fit, "half width [%]", cmap="magma")
    axes.set_title("half width of the 95 % interval")


def _draw_cause(figure: Figure, axes: Axes, map_fit: MapFit, config: Config) -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    shape = map_fit.pixels["p_shape"] < 1e-3
    classes = np.where(map_fit.explained == 1.0, 0, np.where(shape, 1, 2))
    classes = np.where(map_fit.reason > 0, 3, classes)
    shown = np.where(map_fit.reason < 0, math.nan, classes)
    names = ("explained", "residuals have a trend", "value depends on the depth", "refused")
    colours = ("#009E73", "#D55E00", "#E69F00", NO_VALUE)
    axes.imshow(
        shown, origin="lower", cmap=ListedColormap(colours), vmin=-0.5, vmax=3.5, **_extent(map_fit)
    )
    _label_axes(axes, map_fit)
    handles = [
        Patch(color=colour, label=f"{name}: {int(np.count_nonzero(shown == k))}")
        for k, (name, colour) in enumerate(zip(names, colours, strict=True))
        if np.any(shown == k)
    ]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncol=2)
    axes.set_title("what the scene explains")


def _draw_histogram(figure: Figure, axes: Axes, map_fit: MapFit, config: Config) -> None:
    axis = _value_axis(map_fit, config)
    values = axis(map_fit.value)
    values = values[np.isfinite(values) & (values > 0)]
    axes.set(xlabel=axis.label, ylabel="curves")
    if not len(values):
        return
    bin_count = min(60, max(10, int(math.sqrt(len(values)))))
    low, high = np.percentile(values, [0.5, 99.5])
    max_linear_factor = 3.0
    is_logarithmic = high > max_linear_factor * low
    bins = (np.geomspace if is_logarithmic else np.linspace)(low, max(high, 1.001 * low), bin_count)
    axes.hist(values, bins=bins, color=COLOURS[0])
    if is_logarithmic:
        axes.set_xscale("log")
        _write_plain_numbers(axes.xaxis)
    quartiles = np.percentile(values, [25, 50, 75])
    for value, style in zip(quartiles, (":", "-", ":"), strict=True):
        axes.axvline(value, color=INK, ls=style, lw=1.2)
    unit = f" {printed_unit(axis.unit)}" if axis.unit else ""
    low, median, high = (f"{value:.4g}" for value in quartiles)
    axes.set_title(f"median {median}{unit}, middle half {low} to {high}{unit}")


PANELS: dict[str, Callable[[Figure, Axes, MapFit, Config], None]] = {
    "modulus": _draw_modulus,
    "height": _draw_height,
    "interval": _draw_interval,
    "cause": _draw_cause,
    "histogram": _draw_histogram,
}


def _draw_image(
    figure: Figure, axes: Axes, values: np.ndarray, map_fit: MapFit, label: str, **style: Any
) -> None:
    image = axes.imshow(
        values, origin="lower", interpolation="nearest", **style, **_extent(map_fit)
    )
    axes.set_facecolor(NO_VALUE)
    _label_axes(axes, map_fit)
    # The colour bar stands beside the image and has its height.
    bar = figure.colorbar(image, cax=axes.inset_axes((1.03, 0.0, 0.045, 1.0)), label=label)
    if bar.ax.get_yscale() == "log":
        _write_plain_numbers(bar.ax.yaxis)


def _write_plain_numbers(axis: Any) -> None:
    """Write the numbers of a logarithmic axis as decimals, also between powers of ten."""
    from matplotlib.ticker import LogFormatter

    class _Decimals(LogFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return f"{x:g}" if super().__call__(x, pos) else ""

    for set_formatter in (axis.set_major_formatter, axis.set_minor_formatter):
        set_formatter(_Decimals(labelOnlyBase=False, minor_thresholds=(2.0, 0.5)))


def _extent(map_fit: MapFit) -> dict[str, Any]:
    if map_fit.size is None:
        return {}
    height, width = (1e6 * length for length in map_fit.size)
    return {"extent": (0.0, width, 0.0, height)}


def _label_axes(axes: Axes, map_fit: MapFit) -> None:
    unit = "" if map_fit.size is None else " [µm]"
    names = ("column", "row") if map_fit.size is None else ("x", "y")
    axes.set(xlabel=f"{names[0]}{unit}", ylabel=f"{names[1]}{unit}")
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
        axes.spines[side].set_color(GREY)


def _value_axis(map_fit: MapFit, config: Config) -> Axis:
    kind = quantity_kind(config, map_fit.key)
    name = map_fit.key.rpartition(".")[2]
    return _axis(config, kind or "", map_fit.value, name)


def _axis(config: Config, kind: str, values: np.ndarray, name: str) -> Axis:
    units = {"length": config.units.length, "force": config.units.force}
    finite = values[np.isfinite(values)]
    shown = finite if len(finite) else np.array([1.0])
    return scaled_axis(kind, [Results(Path(), {}, {"units": units})], shown, name)
