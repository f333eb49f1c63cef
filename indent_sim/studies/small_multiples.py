"""Small multiples of the curves of a study with many runs and several varied keys."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import Axis, axis_of_column, picture_text, unit_label_of_key
from indent_sim.results.pictures.curves import Colour
from indent_sim.results.pictures.figures import Axes, Figure, PlotStyle, SubFigure
from indent_sim.results.pictures.forces import draw_force, draw_force_lines
from indent_sim.results.reader import MEASURED, Results
from indent_sim.studies.curve_table import CurveGroups
from indent_sim.studies.study_table import representative_row

# Columns of the table that are drawn over varied keys.
PLOTTED_COLUMNS = ("force", "a", "p_max", "penetration")
STIFFNESS_KEY = "contact.epsilon_n"
MAX_COLOURS = len(figures.COLOURS)
MAX_PANEL_COLUMNS = 6
MAX_PANEL_ROWS = 4
# Largest number of panels over a varied number.
MAX_NUMBER_PANELS = 3
DASHES = ("-", (0, (4, 2)), (0, (1, 1.5)), (0, (5, 1.5, 1, 1.5)))
# The axis of a varied number is logarithmic if the ratio of its ends exceeds this.
LOG_NUMBER_RATIO = 20.0
# The axis of results is logarithmic if their ratio exceeds this. On a linear axis half of the
# curves would be indistinguishable from zero.
LOG_RESULT_RATIO = 30.0
# A logarithmic axis with a larger ratio of its ends has ticks only at 1, 2 and 5 in each decade.
FEW_TICKS_RATIO = 6.0
# Width and height of a panel over a number [inches].
PANEL_SIZE = (4.2, 3.4)
# Height of title and subtitle [inches].
TITLE_HEIGHT = 0.7


@dataclass(frozen=True)
class KeyRoles:
    """Roles of the varied keys in small multiples; an unused role is "".

    Attributes
    ----------
    colour
        Key whose values are the colours of the curves.
    across, down
        Keys whose values are the columns and rows of panels.
    dashes
        Key whose values are the dash patterns of lines of one colour.
    """

    colour: str
    across: str = ""
    down: str = ""
    dashes: str = ""

    @property
    def visible_keys(self) -> tuple[str, ...]:
        """Keys whose values can be read from the picture."""
        return tuple(filter(None, (self.colour, self.across, self.down, self.dashes)))


def assign_roles(curve_groups: CurveGroups) -> KeyRoles:
    """Return the role of each varied key, which depends on the number of its values.

    The numeric key with the most values is shown by colour, since a colour bar can show any number
    of values. The other keys are assigned to columns, rows and dash patterns in the order of their
    numbers of values. A key with too many values for a role is skipped if another key is suitable.
    """
    counts = {key: len(_value_names(curve_groups, key)) for key in curve_groups.keys}
    numeric = curve_groups.numeric_keys()
    word_keys = [
        key for key in curve_groups.keys if key not in numeric and counts[key] <= MAX_COLOURS
    ]
    colour = max(numeric or word_keys or curve_groups.keys, key=counts.__getitem__)
    remaining_keys = sorted(
        (key for key in curve_groups.keys if key != colour), key=counts.__getitem__, reverse=True
    )
    keys_by_role = {"colour": colour}
    for role, max_values in (
        ("across", MAX_PANEL_COLUMNS),
        ("down", MAX_PANEL_ROWS),
        ("dashes", len(DASHES)),
    ):
        candidates = [key for key in remaining_keys if counts[key] <= max_values]
        if not candidates and role == "across":
            # If a key has too many values for every role, panels are shown for some of them.
            candidates = remaining_keys
        if candidates:
            keys_by_role[role] = candidates[0]
            remaining_keys.remove(candidates[0])
    return KeyRoles(**keys_by_role)


@contextmanager
def small_multiples_figure(curve_groups: CurveGroups, title: str) -> Iterator[Figure]:
    """Yield the figure of many runs of a study with two or more varied keys.

    The upper part has small multiples of force over depth. The lower part has the force of each run
    over every varied number, and for two numbers a map over both.
    """
    key_roles = assign_roles(curve_groups)
    across, down = (
        _evenly_spaced(_value_names(curve_groups, key), max_count)
        for key, max_count in _facet_keys(key_roles)
    )
    number_keys = curve_groups.numeric_keys()[:MAX_NUMBER_PANELS]
    is_map = len(curve_groups.keys) == 2 and is_grid(curve_groups, number_keys)
    lower_panels = [*(["map"] if is_map else []), *number_keys]
    # Width and height of a small multiple [inches].
    multiple_size = (2.0, 1.75)
    width = max(multiple_size[0] * len(across) + 1.6, PANEL_SIZE[0] * len(lower_panels))
    heights = [
        multiple_size[1] * len(down) + 0.9,
        *([PANEL_SIZE[1] + 0.6 * is_map] if lower_panels else []),
    ]
    with figures.new_figure((width, sum(heights) + TITLE_HEIGHT)) as figure:
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        subfigures = [figure.add_subfigure(grid_cell) for grid_cell in grid]
        styles, bar = styles_by_key(curve_groups, key_roles.colour)
        first_axes = _draw_multiples(
            subfigures[0], curve_groups, key_roles, (across, down), styles, bar
        )
        if lower_panels:
            values, label = representative_values(curve_groups, "force")
            panels = subfigures[1].subplots(1, len(lower_panels), squeeze=False)[0]
            for axes, key in zip(panels, lower_panels, strict=True):
                if key == "map":
                    draw_map(axes, curve_groups, number_keys, values, label)
                else:
                    draw_over_number(axes, curve_groups, key, values, label, styles)
        figures.draw_figure_legend(figure, first_axes)
        figures.draw_title(figure, title, _subtitle(curve_groups, key_roles, across))
        yield figure


def _subtitle(curve_groups: CurveGroups, key_roles: KeyRoles, across: Sequence[str]) -> str:
    """Return the number of runs, and which values and keys the picture does not show."""
    parts = [f"{len(curve_groups.curves)} runs", "each force at the depth of its run"]
    value_count = len(_value_names(curve_groups, key_roles.across)) if key_roles.across else 0
    if value_count > len(across):
        parts.append(
            f"{curve_groups.short_key(key_roles.across)}: {len(across)} of {value_count} values"
        )
    if hidden_keys := [
        curve_groups.short_key(key)
        for key in curve_groups.keys
        if key not in key_roles.visible_keys
    ]:
        parts.append(f"lines of the same style differ in {', '.join(hidden_keys)}")
    return "  \N{MIDDLE DOT}  ".join(parts)


def _facet_keys(key_roles: KeyRoles) -> tuple[tuple[str, int], tuple[str, int]]:
    """Return the keys of the panel columns and rows, each with its largest number of panels."""
    return (key_roles.across, MAX_PANEL_COLUMNS), (key_roles.down, MAX_PANEL_ROWS)


def _value_names(curve_groups: CurveGroups, key: str) -> list[str]:
    """Return the distinct values of a key as text, numbers ascending; [""] if `key` is empty."""
    if not key:
        return [""]
    names = list(dict.fromkeys(curve_groups.value_names([key])))
    if key not in curve_groups.numeric_keys():
        return names
    numbers = dict(zip(curve_groups.value_names([key]), curve_groups.key_numbers(key), strict=True))
    return sorted(names, key=numbers.__getitem__)


def _evenly_spaced(values: Sequence[str], max_count: int) -> list[str]:
    """Return at most `max_count` evenly spaced values of a list."""
    if len(values) <= max_count:
        return list(values)
    return [values[i] for i in np.linspace(0, len(values) - 1, max_count).round().astype(int)]


def _draw_multiples(
    subfigure: SubFigure,
    curve_groups: CurveGroups,
    key_roles: KeyRoles,
    facets: tuple[Sequence[str], Sequence[str]],
    styles: Sequence[PlotStyle],
    bar: Any,
) -> Axes:
    """Draw force over depth, one panel per pair of values; return the axes with the legend."""
    across, down = facets
    runs = [curve.results for curve in curve_groups.curves]
    depth = axis_of_column("delta", runs)
    force = axis_of_column("force", runs)
    dash_names = _value_names(curve_groups, key_roles.dashes)
    names = {
        key: curve_groups.value_names([key]) if key else [""] * len(runs)
        for key in ("", *key_roles.visible_keys)
    }
    styles = [
        style | {"ls": DASHES[dash_names.index(name)], "marker": ""}
        for style, name in zip(styles, names[key_roles.dashes], strict=True)
    ]
    panels = subfigure.subplots(len(down), len(across), squeeze=False, sharex=True, sharey=True)
    for panel_row, row_name in zip(panels, down, strict=True):
        for axes, name in zip(panel_row, across, strict=True):
            panel_runs = [
                i
                for i in range(len(runs))
                if names[key_roles.across][i] == name and names[key_roles.down][i] == row_name
            ]
            if panel_runs:
                _draw_curves(
                    axes,
                    [runs[i] for i in panel_runs],
                    depth,
                    force,
                    [styles[i] for i in panel_runs],
                )
            value_names = [
                value_name or f"{curve_groups.short_key(key)} not given"
                for key, value_name in ((key_roles.across, name), (key_roles.down, row_name))
                if key
            ]
            figures.draw_panel_title(axes, picture_text(", ".join(value_names)))
            axes.set(xlabel=depth.label, ylabel=force.label)
    first_axes: Axes = panels[0, 0]
    _scale_axes(first_axes, runs, depth, force)
    for axes in panels.ravel():
        axes.label_outer()
    if bar is not None:
        draw_number_bar(list(panels.ravel()), bar, key_label(curve_groups, key_roles.colour))
    else:
        style_by_name = dict(zip(names[key_roles.colour], styles, strict=True))
        for name, style in style_by_name.items():
            first_axes.plot([], [], color=style["color"], label=picture_text(name))
    if key_roles.dashes:
        for name, dash in zip(dash_names, DASHES, strict=False):
            first_axes.plot([], [], color=figures.GREY, ls=dash, label=picture_text(name))
    return first_axes


def _draw_curves(
    axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis, styles: Sequence[PlotStyle]
) -> None:
    """Draw force over depth of some runs in one panel."""
    if all(len(run) > 1 and not run.report.get(MEASURED) for run in runs):
        draw_force_lines(axes, runs, depth, force, styles)
        return
    for run, style in zip(runs, styles, strict=True):
        draw_force(axes, run, depth, force, style, "_")


def _scale_axes(axes: Axes, runs: Sequence[Results], depth: Axis, force: Axis) -> None:
    """Set linear axes, or logarithmic axes if most curves would be close to zero."""
    from matplotlib.ticker import NullLocator

    if value_ratio([run["force"].max() for run in runs]) < LOG_RESULT_RATIO:
        axes.autoscale_view()
        return
    # Margin of a logarithmic axis: a factor that is a power of the ratio of its ends, and its
    # minimum.
    exponent = 0.05
    min_margin = 1.25
    for matplotlib_axis, set_scale, set_limits, convert, column in (
        (axes.xaxis, axes.set_xscale, axes.set_xlim, depth, "delta"),
        (axes.yaxis, axes.set_yscale, axes.set_ylim, force, "force"),
    ):
        values = np.concatenate([run[column] for run in runs])
        positive_values = convert(values[values > 0])
        ratio = value_ratio(positive_values)
        if ratio == 1:  # If all runs have a single row at the same depth, the axis needs a range.
            continue
        set_scale("log")
        margin = max(min_margin, ratio**exponent)
        set_limits(positive_values.min() / margin, margin * positive_values.max())
        set_plain_log_ticks(matplotlib_axis, max(ratio, FEW_TICKS_RATIO))
        matplotlib_axis.set_minor_locator(NullLocator())


def styles_by_key(curve_groups: CurveGroups, key: str) -> tuple[list[PlotStyle], Any]:
    """Return the style of every curve by a varied key, and the colour scale (None for text)."""
    if key in curve_groups.numeric_keys():
        colours, bar = number_colours(curve_groups.key_numbers(key))
        return [{"color": colour, "ls": "-"} for colour in colours], bar
    names = curve_groups.value_names([key])
    colour_names = list(dict.fromkeys(names))
    if len(colour_names) > MAX_COLOURS:
        return [{"color": figures.GREY, "ls": "-"} for _ in names], None
    return [{"color": figures.COLOURS[colour_names.index(name)], "ls": "-"} for name in names], None


def number_colours(values: Sequence[float]) -> tuple[list[Colour], Any]:
    """Return a colour for each number, and the colour scale for a colour bar."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize

    low = min(values)
    high = max(values)
    norm = (LogNorm if low > 0 and high > LOG_NUMBER_RATIO * low else Normalize)(
        low, high if high > low else low + 1
    )
    # The lightest tenth of viridis is yellow, which is hard to see on white, and is left out.
    viridis = colormaps["viridis"]
    colour_map = LinearSegmentedColormap.from_list("shades", viridis(np.linspace(0.0, 0.9, 256)))
    colours = [tuple(colour) for colour in viridis(0.9 * np.asarray(norm(values))).tolist()]
    return colours, ScalarMappable(norm, colour_map)


def draw_number_bar(panels: Sequence[Axes], colour_scale: Any, label: str) -> None:
    """Draw the colour bar of a varied number to the right of the panels."""
    from matplotlib.colors import LogNorm

    bar = figures.draw_colour_bar(panels, colour_scale, label, "right")
    norm = colour_scale.norm
    if isinstance(norm, LogNorm):
        set_plain_log_ticks(bar.ax.yaxis, norm.vmax / norm.vmin)


def key_label(curve_groups: CurveGroups, key: str) -> str:
    """Return the axis label of a varied number: its name with its unit."""
    unit = curve_groups.key_unit(key) or unit_label_of_key(key, curve_groups.curves[0].results)
    return Axis(picture_text(curve_groups.short_key(key)), unit=unit).label


def value_ratio(values: Sequence[float] | np.ndarray) -> float:
    """Return the ratio of the largest to the smallest number; 1 if not all are positive."""
    return float(np.max(values) / np.min(values)) if np.min(values) > 0 else 1.0


def representative_values(curve_groups: CurveGroups, column: str) -> tuple[list[float], str]:
    """Return a column's value in the representative row of each run, and the axis label.

    The values are in the unit of the picture.
    """
    runs = [curve.results for curve in curve_groups.curves]
    column_axis = axis_of_column(column, runs)
    values = [float(column_axis(run[column][representative_row(run)])) for run in runs]
    has_histories = all("t" in run.table for run in runs)
    row_text = "at the largest force" if has_histories else "at the last depth"
    if column == "force":
        return values, f"{'largest' if has_histories else 'last'} {column_axis.label}"
    return values, f"{column_axis.label}, {row_text}"


def _group_indices(curve_groups: CurveGroups, key: str) -> dict[str, list[int]]:
    """Return the indices of the curves, grouped by the values of all other varied keys as text."""
    groups: dict[str, list[int]] = {}
    for index, name in enumerate(
        curve_groups.value_names([other_key for other_key in curve_groups.keys if other_key != key])
    ):
        groups.setdefault(name, []).append(index)
    return groups


def draw_over_number(
    axes: Axes,
    curve_groups: CurveGroups,
    key: str,
    values: Sequence[float],
    label: str,
    styles: Sequence[PlotStyle],
    group_styles: Sequence[PlotStyle] | None = None,
) -> None:
    """Draw results over a varied number; lines join runs that differ only in this number.

    Parameters
    ----------
    key
        The varied number.
    values, label
        Result of each curve, and its axis label.
    styles
        Style of each curve; its points have this colour.
    group_styles
        Style of the line through each curve's point, if the lines are named in a legend.
    """
    numbers = curve_groups.key_numbers(key)
    for name, indices in _group_indices(curve_groups, key).items():
        ordered = sorted(indices, key=lambda index: numbers[index])
        x = [numbers[index] for index in ordered]
        y = [values[index] for index in ordered]
        if group_styles:
            axes.plot(x, y, lw=1.0, ms=5, **group_styles[ordered[0]], label=picture_text(name))
            continue
        colours = [styles[index]["color"] for index in ordered]
        line = colours[0] if len(set(map(str, colours))) == 1 else figures.GREY
        axes.plot(x, y, lw=0.9, color=line, zorder=1)
        axes.scatter(x, y, s=12, color=colours, zorder=2)
    number_ratio = value_ratio(numbers)
    if number_ratio > LOG_NUMBER_RATIO:
        axes.set_xscale("log")
        set_plain_log_ticks(axes.xaxis, number_ratio)
    if value_ratio(values) >= LOG_RESULT_RATIO:
        axes.set_yscale("log")
    axes.set(xlabel=key_label(curve_groups, key), ylabel=label)


def set_plain_log_ticks(matplotlib_axis: Any, ratio: float) -> None:
    """Set plain numbers on a logarithmic axis whose ends have a ratio below 100."""
    from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter

    if ratio < 100:
        matplotlib_axis.set_major_locator(
            LogLocator(subs=(1, 2, 5) if ratio >= FEW_TICKS_RATIO else (1, 1.5, 2, 3, 4, 5, 6, 8))
        )
        matplotlib_axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        matplotlib_axis.set_minor_locator(NullLocator())
    matplotlib_axis.set_minor_formatter(NullFormatter())


def is_grid(curve_groups: CurveGroups, keys: Sequence[str]) -> bool:
    """Return True if the runs form a grid of two varied numbers with enough values."""
    if len(keys) != 2 or tuple(keys) != curve_groups.keys:
        return False
    pairs = set(
        zip(curve_groups.key_numbers(keys[0]), curve_groups.key_numbers(keys[1]), strict=True)
    )
    counts = [len({pair[i] for pair in pairs}) for i in (0, 1)]
    is_full = len(pairs) == len(curve_groups.curves) == counts[0] * counts[1]
    # A map needs this number of values of each of its two keys.
    min_values = 3
    return min(counts) >= min_values and is_full


def draw_map(
    axes: Axes, curve_groups: CurveGroups, keys: Sequence[str], values: Sequence[float], label: str
) -> None:
    """Draw results as colours over two varied numbers; dots mark the runs.

    Parameters
    ----------
    keys
        The two varied numbers, across and up.
    values, label
        Result of each curve, and its label.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import AutoLocator, LogLocator

    x, y = (np.array(curve_groups.key_numbers(key)) for key in keys)
    across = np.unique(x)
    up = np.unique(y)
    value_grid = np.array(values)[np.lexsort((x, y))].reshape(len(up), len(across))
    is_log = value_ratio(values) >= LOG_RESULT_RATIO
    low = min(values)
    high = max(values) if max(values) > low else low + 1.0
    map_levels = 12
    levels = (np.geomspace if is_log else np.linspace)(low, high, map_levels + 1)
    norm_style: PlotStyle = {"norm": LogNorm(low, high)} if is_log else {}
    filled_contours = axes.contourf(
        across, up, value_grid, levels=levels, cmap="viridis", extend="neither", **norm_style
    )
    dot_style: PlotStyle = {"ls": "", "marker": "o", "ms": 3, "color": "white", "clip_on": False}
    axes.plot(x, y, mec=figures.INK, mew=0.5, zorder=3, **dot_style)
    for numbers, scale, matplotlib_axis in (
        (across, axes.set_xscale, axes.xaxis),
        (up, axes.set_yscale, axes.yaxis),
    ):
        if value_ratio(numbers) >= LOG_NUMBER_RATIO:
            scale("log")
            set_plain_log_ticks(matplotlib_axis, value_ratio(numbers))
    axes.set(xlabel=key_label(curve_groups, keys[0]), ylabel=key_label(curve_groups, keys[1]))
    bar = figures.draw_colour_bar([axes], filled_contours, label, "bottom")
    # Numbers of the colour bar over more than three decades are powers of ten.
    max_plain_ratio = 1000.0
    if not is_log:
        bar.set_ticks(AutoLocator())
    elif high < max_plain_ratio * low:
        bar.set_ticks(LogLocator(subs=(1, 2, 5)))
        bar.ax.xaxis.set_major_formatter("{x:g}")
    else:
        bar.set_ticks(LogLocator())
    bar.minorticks_off()


@contextmanager
def column_figure(curve_groups: CurveGroups, column: str, title: str) -> Iterator[Figure]:
    """Yield the figure of one of `PLOTTED_COLUMNS` over the varied numbers.

    Penetration is drawn over epsilon_n if this is varied. Otherwise the figure is a map over two
    numbers, or has a panel for each number.

    Raises
    ------
    UsageError
        If no number varies, or no run has this column.
    """
    panel_keys = _keys_of_panels(curve_groups, column)
    is_map = len(panel_keys[0]) == 2
    count = len(panel_keys)
    width = PANEL_SIZE[0] * count * (1.4 if count == 1 else 1.0)
    with figures.new_figure(
        (width, TITLE_HEIGHT + PANEL_SIZE[1] + (1.0 if is_map else 0.4))
    ) as figure:
        panels = figure.subplots(1, count, squeeze=False)[0]
        _draw_column(panels, curve_groups, column, panel_keys)
        figures.draw_figure_legend(figure, panels[0])
        figures.draw_title(figure, title, f"{len(curve_groups.curves)} runs")
        yield figure


def draw_column_into(axes: Axes, curve_groups: CurveGroups, column: str) -> None:
    """Draw one of `PLOTTED_COLUMNS` into given axes, with a legend inside.

    Raises
    ------
    UsageError
        If no number varies, no run has this column, or the column needs several panels.
    """
    panel_keys = _keys_of_panels(curve_groups, column)
    if len(panel_keys) > 1:
        keys = ", ".join(key for keys in panel_keys for key in keys)
        raise UsageError(
            f"ax is one panel, but {column} needs {len(panel_keys)} panels, over the keys {keys}",
            "leave out the argument ax",
        )
    _draw_column([axes], curve_groups, column, panel_keys)
    if axes.get_legend_handles_labels()[1]:
        axes.legend()


def _keys_of_panels(curve_groups: CurveGroups, column: str) -> list[tuple[str, ...]]:
    """Return the varied numeric keys on the axes of each panel of a column.

    A panel of lines has one key, a map two.

    Raises UsageError if there are none, or no run has the column.
    """
    numeric = curve_groups.numeric_keys()
    if not numeric:
        raise UsageError(
            f"no number varies in this study: there is no axis over which to draw {column}"
        )
    if not any(
        np.isfinite(curve.results.table.get(column, np.nan)).any() for curve in curve_groups.curves
    ):
        raise UsageError(f"no run of this study has {column}")
    if column == "penetration" and STIFFNESS_KEY in numeric:
        return [(STIFFNESS_KEY,)]
    if is_grid(curve_groups, numeric):
        return [numeric]
    return [(key,) for key in numeric[:MAX_NUMBER_PANELS]]


def _draw_column(
    panels: Sequence[Axes],
    curve_groups: CurveGroups,
    column: str,
    panel_keys: Sequence[tuple[str, ...]],
) -> None:
    """Draw a table column into its panels: a map, or points over one varied number per panel."""
    values, label = representative_values(curve_groups, column)
    if len(panel_keys[0]) == 2:
        draw_map(panels[0], curve_groups, panel_keys[0], values, label)
        return
    number_keys = [key for (key,) in panel_keys]
    _draw_column_over_numbers(panels, curve_groups, number_keys, (values, label))
    if column == "penetration" and number_keys == [STIFFNESS_KEY]:
        _draw_pressure_over_stiffness(panels[0], curve_groups)
        stiffness_ratio = value_ratio(curve_groups.key_numbers(STIFFNESS_KEY))
        if min(values) > 0 and stiffness_ratio > LOG_NUMBER_RATIO:
            # Penetration is inversely proportional to the stiffness.
            panels[0].set_yscale("log")


def _draw_column_over_numbers(
    panels: Sequence[Axes],
    curve_groups: CurveGroups,
    number_keys: Sequence[str],
    values_and_label: tuple[Sequence[float], str],
) -> None:
    """Draw a column over each of several varied numbers, one number in each panel."""
    other_keys = [key for key in curve_groups.keys if key not in number_keys]
    names = curve_groups.value_names(other_keys)
    group_names = list(dict.fromkeys(names))
    if 1 < len(group_names) <= MAX_COLOURS:
        styles: list[PlotStyle] = [
            {"color": figures.COLOURS[group_names.index(name)]} for name in names
        ]
        bar = None
        for name, colour in zip(group_names, figures.COLOURS, strict=False):
            panels[0].plot([], [], color=colour, label=picture_text(name))
    elif len(other_keys) or len(number_keys) > 1:
        colour_key = next(
            (key for key in (*other_keys, *number_keys) if key in curve_groups.numeric_keys()),
            curve_groups.keys[0],
        )
        styles, bar = styles_by_key(curve_groups, colour_key)
        if bar is not None:
            draw_number_bar(list(panels), bar, key_label(curve_groups, colour_key))
    else:
        styles = [{"color": figures.COLOURS[0]} for _ in names]
    for axes, key in zip(panels, number_keys, strict=True):
        draw_over_number(axes, curve_groups, key, *values_and_label, styles)


def _draw_pressure_over_stiffness(axes: Axes, curve_groups: CurveGroups) -> None:
    """Draw p_max / epsilon_n, the penetration of a penalty method at the largest pressure."""
    runs = [curve.results for curve in curve_groups.curves]
    if any(run.report.get("method") != "penalty" for run in runs) or curve_groups.key_unit(
        STIFFNESS_KEY
    ):
        return
    stiffness = np.array(curve_groups.key_numbers(STIFFNESS_KEY))
    peak_pressure = np.array([run["p_max"][representative_row(run)] for run in runs])
    order = np.argsort(stiffness)
    penetration = axis_of_column("penetration", runs)(peak_pressure[order] / stiffness[order])
    label = r"$p_{max}/\varepsilon_n$ of these runs"
    axes.plot(stiffness[order], penetration, label=label, **figures.FORMULA_STYLE)
