"""Pictures of many runs: bands of their curves, maps and samples of a column, Sobol indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import picture_text
from indent_sim.results.pictures.figures import Axes
from indent_sim.studies import study_folder
from indent_sim.studies.many_runs import ManyRuns, read_many_runs
from indent_sim.studies.small_multiples import (
    LOG_NUMBER_RATIO,
    LOG_RESULT_RATIO,
    number_colours,
    set_plain_log_ticks,
    value_ratio,
)

# Quantiles of the runs between which the bands are drawn, with the strength of their colour. The
# colours are opaque, so that those of the legend are those of the bands.
BANDS = ((0.01, 0.99, 0.2), (0.1, 0.9, 0.45), (0.25, 0.75, 0.75))


def draw_pictures(folder: Path) -> None:
    """Draw the pictures of a study whose runs are rows into its folder."""
    runs = read_many_runs(folder)
    draw_bands(runs, folder / study_folder.CURVES_PICTURE)
    draw_samples(runs, folder / study_folder.SAMPLES_PICTURE)
    draw_maps(runs, folder / study_folder.MAPS_PICTURE)


def draw_panel(folder: Path, panel: str, path: Path, dpi: float | None) -> None:
    """Draw one picture of a study whose runs are rows: its curves, or a map of a column.

    Raises
    ------
    UsageError
        The runs have no such picture.
    """
    if panel == "curves":
        is_drawn = draw_bands(read_many_runs(folder), path, dpi)
    else:
        is_drawn = draw_maps(read_many_runs(folder, panel), path, dpi)
    if not is_drawn:
        raise UsageError(
            f"{folder} has no picture of {panel}",
            "curves need runs with at least two rows; a map of a column needs two varied numbers",
        )


def draw_bands(runs: ManyRuns, path: Path, dpi: float | None = None) -> bool:
    """Draw the forces over depth; return False, without a picture, if no run has two rows."""
    if not _rising_curves(runs):
        path.unlink(missing_ok=True)
        return False
    with figures.new_figure((6.4, 4.8)) as figure:
        draw_bands_into(figure.subplots(), runs)
        figures.draw_title(figure, runs.title, _count_text(runs))
        figures.save(figure, path, dpi)
    return True


def draw_bands_into(axes: Axes, runs: ManyRuns) -> None:
    """Draw the curves into given axes: a few as lines, many as bands between quantiles.

    The depths of bands are relative to the last depth of each run.
    """
    curves = _rising_curves(runs)
    # With more curves than this, bands are drawn.
    max_lines = 100
    if len(curves) <= max_lines:
        for curve in curves:
            axes.plot(*curve.T, color=figures.COLOURS[0], lw=0.6)
        axes.set(xlabel="depth", ylabel=runs.result_label)
        return
    # Relative depths at which the quantiles are computed; all runs reach them.
    first_depth = max(curve[0, 0] / curve[-1, 0] for curve in curves)
    depths = np.linspace(first_depth, 1.0, 41)
    forces = np.array([np.interp(depths * curve[-1, 0], *curve.T) for curve in curves])
    for low, high, strength in BANDS:
        lower, upper = np.quantile(forces, (low, high), axis=0)
        name = f"{100 * (high - low):.0f} % of runs"
        axes.fill_between(depths, lower, upper, label=name, color=_tint(strength), lw=0)
    axes.plot(depths, np.median(forces, axis=0), color=figures.INK, label="median")
    axes.set(xlabel="depth / last depth of the run", ylabel=runs.result_label)
    if forces.min() > 0 and value_ratio(forces[:, -1]) >= LOG_RESULT_RATIO:
        axes.set_yscale("log")
    figures.draw_legend_under(axes)


def _tint(strength: float) -> tuple[float, ...]:
    """Return a mixture of white and the first colour, of which `strength` is the share."""
    from matplotlib.colors import to_rgb

    return tuple(1 - strength * (1 - part) for part in to_rgb(figures.COLOURS[0]))


def has_curves(runs: ManyRuns) -> bool:
    """Return whether the runs have curves that can be drawn over depth."""
    return bool(_rising_curves(runs))


def _rising_curves(runs: ManyRuns) -> list[np.ndarray]:
    """Return the curves of at least two rows whose depth increases."""
    return [
        curve
        for curve in runs.curves
        if len(curve) > 1
        and np.isfinite(curve).all()
        and (np.diff(curve[:, 0]) > 0).all()
        and curve[-1, 0] > 0
    ]


def draw_samples(runs: ManyRuns, path: Path) -> None:
    """Draw samples.png: every pair of keys, with the runs as dots coloured by the result."""
    keys = runs.varying_keys
    count = len(keys)
    if count < 2:
        path.unlink(missing_ok=True)
        return
    colours, scale = number_colours([float(value) for value in runs.values])
    # Width and height of a panel [inches].
    panel_size = 2.1
    size = panel_size * (count - 1)
    with figures.new_figure((max(4.5, size + 1.6), max(3.6, size + 0.9))) as figure:
        panels = figure.subplots(count - 1, count - 1, squeeze=False)
        drawn = []
        for axes in panels.flat:
            axes.set_visible(False)
        for i, j in combinations(range(count), 2):
            axes = panels[j - 1, i]
            axes.set_visible(True)
            drawn.append(axes)
            x = runs.keys[keys[i]]
            y = runs.keys[keys[j]]
            axes.scatter(x, y, c=colours, s=4, lw=0, rasterized=True)
            for numbers, set_scale, axis in (
                (x, axes.set_xscale, axes.xaxis),
                (y, axes.set_yscale, axes.yaxis),
            ):
                if has_logarithmic_axis(numbers):
                    set_scale("log")
                    set_plain_log_ticks(axis, value_ratio(numbers))
            if j == count - 1:
                axes.set_xlabel(picture_text(runs.label(keys[i])))
            if i == 0:
                axes.set_ylabel(picture_text(runs.label(keys[j])))
        figures.draw_colour_bar(drawn, scale, runs.result_label, "right")
        figures.draw_title(figure, runs.title, _count_text(runs))
        figures.save(figure, path)


def draw_maps(runs: ManyRuns, path: Path, dpi: float | None = None) -> bool:
    """Draw the result over the two most influential keys, in panels for thirds of two others.

    The colour of a rectangle shows the median of the runs in it; a rectangle without runs is white.
    Return False, without a picture, if fewer than two numbers vary.
    """
    keys = runs.varying_keys
    if len(keys) < 2:
        path.unlink(missing_ok=True)
        return False
    across, up, *others = keys[:4]
    parts = [_thirds(runs.keys[key]) for key in others]
    parts += [[(np.ones(len(runs.values), bool), "")]] * (2 - len(parts))
    names = [picture_text(runs.label(key)) for key in others] + [""] * (2 - len(others))
    columns, rows = parts
    # Number of rectangles in each direction, such that most of them contain several runs.
    fields = int(np.clip(np.sqrt(len(runs.values) / len(columns) / len(rows) / 4), 3, 24))
    edges = [_edges(runs.keys[key], fields) for key in (across, up)]
    _, scale = number_colours([float(value) for value in runs.values])
    panel_size = 2.3
    figure_size = (panel_size * len(columns) + 1.6, panel_size * len(rows) + 1.0)
    with figures.new_figure(figure_size) as figure:
        panels = figure.subplots(len(rows), len(columns), squeeze=False, sharex=True, sharey=True)
        for (row, row_name), panel_row in zip(rows, panels, strict=True):
            for (column, column_name), axes in zip(columns, panel_row, strict=True):
                medians = _field_medians(runs, (across, up), edges, row & column)
                axes.pcolormesh(*edges, medians.T, norm=scale.norm, cmap=scale.cmap)
                title = ", ".join(
                    f"{name} {text}"
                    for name, text in zip(names, (column_name, row_name), strict=True)
                    if text
                )
                figures.draw_panel_title(axes, title)
                _scale_axes(axes, edges)
        for axes in panels[-1]:
            axes.set_xlabel(picture_text(runs.label(across)))
        for axes in panels[:, 0]:
            axes.set_ylabel(picture_text(runs.label(up)))
        figures.draw_colour_bar(list(panels.flat), scale, runs.result_label, "right")
        figures.draw_title(figure, runs.title, f"{_count_text(runs)}  ·  median in each rectangle")
        figures.save(figure, path, dpi)
    return True


def draw_sobol_indices(
    indices: Mapping[str, Mapping[str, float]], column: str, title: str, path: Path
) -> None:
    """Draw sobol.png: first and total Sobol indices of each key, with their errors."""
    keys = sorted(indices, key=lambda key: indices[key]["total"])
    places = np.arange(len(keys))
    with figures.new_figure((7.2, 1.5 + 0.5 * len(keys))) as figure:
        axes = figure.subplots()
        errors = [indices[key]["error"] for key in keys]
        for name, offset, colour in (
            ("total", 0.2, figures.COLOURS[5]),
            ("first", -0.2, figures.COLOURS[0]),
        ):
            values = [indices[key][name] for key in keys]
            label = {"total": "with other keys (total)", "first": "alone (first)"}[name]
            axes.barh(
                places + offset, values, 0.38, xerr=errors, color=colour, label=label, ecolor="k"
            )
        axes.set_yticks(places, [picture_text(key) for key in keys])
        axes.set_xlabel(f"share of the variance of {column}")
        axes.set_xlim(min(0.0, 1.1 * min(indices[key]["first"] for key in keys)), None)
        axes.legend(loc="lower right")
        figures.draw_title(figure, title, "Sobol indices over the ranges of the study")
        figures.save(figure, path)


def _count_text(runs: ManyRuns) -> str:
    """Return the number of runs as text."""
    if len(runs.values) < runs.count:
        return f"{len(runs.values)} of {runs.count} runs"
    return f"{runs.count} runs"


def _thirds(values: np.ndarray) -> list[tuple[np.ndarray, str]]:
    """Return the runs with a small, a medium and a large value, with the range of each."""
    numbers = np.unique(values)
    if len(numbers) <= 3:
        return [(values == number, f"{number:.3g}") for number in numbers]
    ends = np.quantile(values, (0, 1 / 3, 2 / 3, 1))
    parts = []
    for number, (low, high) in enumerate(pairwise(ends)):
        is_in = (values >= low) & ((values < high) | (number == 2))
        parts.append((is_in, f"{low:.3g} to {high:.3g}"))
    return parts


def _edges(values: np.ndarray, fields: int) -> np.ndarray:
    """Return the edges of the rectangles over a key."""
    spacing = np.geomspace if has_logarithmic_axis(values) else np.linspace
    return np.asarray(spacing(values.min(), values.max(), fields + 1))


def has_logarithmic_axis(values: np.ndarray) -> bool:
    """Return whether the axis of some values is logarithmic: they cover decades evenly.

    Values that are spaced linearly from nearly 0 on cover decades, too, but their median is in the
    middle of a linear axis.
    """
    if value_ratio(values) < LOG_NUMBER_RATIO:
        return False
    low, high = float(values.min()), float(values.max())
    return bool(np.median(values) ** 2 < np.sqrt(low * high) * (low + high) / 2)


def _field_medians(
    runs: ManyRuns, keys: tuple[str, str], edges: Sequence[np.ndarray], chosen: np.ndarray
) -> np.ndarray:
    """Return the median result of the chosen runs in each rectangle; NaN without a run."""
    fields = len(edges[0]) - 1
    places = [
        np.clip(np.searchsorted(edge, runs.keys[key][chosen], side="right") - 1, 0, fields - 1)
        for key, edge in zip(keys, edges, strict=True)
    ]
    field_numbers = places[0] * fields + places[1]
    values = runs.values[chosen]
    medians = np.full(fields * fields, np.nan)
    for number in np.unique(field_numbers):
        medians[number] = np.median(values[field_numbers == number])
    return medians.reshape(fields, fields)


def _scale_axes(axes: Axes, edges: Sequence[np.ndarray]) -> None:
    """Make the axes of wide ranges logarithmic."""
    for edge, set_scale, axis in zip(
        edges, (axes.set_xscale, axes.set_yscale), (axes.xaxis, axes.yaxis), strict=True
    ):
        if has_logarithmic_axis(edge):
            set_scale("log")
            set_plain_log_ticks(axis, value_ratio(edge))
