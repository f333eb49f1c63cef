"""Curves through the rows of a result: smooth interpolation, loading and unloading."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from indent_sim.results.pictures.figures import COLOURS, MARKERS, MAX_MARKED_POINTS, Axes, PlotStyle

# Style of unloading: dashed, with hollow markers.
UNLOADING_STYLE = {"ls": (0, (4, 2)), "mfc": "white"}
Points = tuple[np.ndarray, np.ndarray]  # x and y.
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]  # Depths, x and y.
Interpolator = Callable[[np.ndarray, np.ndarray], Points]  # Function from points to a line.
Colour = Any  # A colour in any form that matplotlib accepts.


def line_style(index: int, count: int) -> PlotStyle:
    """Return colour and marker of one of several curves.

    Many curves are coloured by a colour map from dark to light, and have no markers.
    """
    if count <= 10:
        return {"color": COLOURS[index % len(COLOURS)], "marker": MARKERS[index % len(MARKERS)]}
    return {"color": map_colour(index, count), "marker": ""}


def map_colour(index: int, count: int) -> Colour:
    """Return the colour of one of `count` curves, by a colour map from dark to light."""
    from matplotlib import colormaps

    # The lightest yellow of the map is invisible on white.
    return colormaps["viridis"](0.9 * index / max(1, count - 1))


def split_branches(delta: np.ndarray) -> list[tuple[slice, bool]]:
    """Split a path of depths at its turning points.

    A turning point is a row of both branches. A hold of the tip is a part of the branch before the
    hold.

    Returns
    -------
    list
        Rows of each branch, and True if the tip retracts in it.
    """
    if len(delta) < 2:
        return [(slice(0, len(delta)), False)]
    steps = np.sign(np.diff(delta))
    moves = np.maximum.accumulate(np.where(steps != 0, np.arange(len(steps)), 0))
    steps = steps[moves]
    turning_points = [k + 1 for k in range(len(steps) - 1) if steps[k] * steps[k + 1] < 0]
    ends = pairwise([0, *turning_points, len(delta) - 1])
    return [(slice(first, last + 1), bool(delta[last] < delta[first])) for first, last in ends]


def smooth_curve(x: np.ndarray, y: np.ndarray) -> Points:
    """Return a smooth curve through points in ascending or descending x.

    It is a monotone piecewise cubic in y^(1/n), with n from the first and last point, so that power
    laws are drawn exactly; force and contact radius are nearly power laws of the depth. Straight
    lines are used if x is not monotone, and for negative forces, because these may jump.

    Parameters
    ----------
    x, y
        The points (n,).
    """
    goes_up = bool((np.diff(x) > 0).all())
    goes_on = goes_up or (np.diff(x) < 0).all()
    if len(x) < 3 or not goes_on or not np.isfinite(np.append(x, y)).all() or y.min() < 0:
        return x, y
    from scipy.interpolate import PchipInterpolator

    n = _power_law_exponent(x, y)
    order = slice(None, None, 1 if goes_up else -1)
    straightened = PchipInterpolator(x[order], y[order] ** (1 / n))
    # Number of points of a drawn curve between two rows.
    points_between_rows = 20
    fine_x = np.append(np.linspace(x[:-1], x[1:], points_between_rows, endpoint=False).T, x[-1])
    fine_y = np.maximum(straightened(fine_x), 0.0) ** n
    fine_y[::points_between_rows] = y  # The curve passes through the rows without rounding errors.
    return fine_x, fine_y


def _power_law_exponent(x: np.ndarray, y: np.ndarray) -> float:
    """Return the exponent n of y ~ x^n through the first and last point; 1 for negative x."""
    is_positive = (x > 0) & (y > 0)
    if x.min() < 0 or is_positive.sum() < 2:
        return 1.0
    first, last = np.flatnonzero(is_positive)[[0, -1]]
    exponent = np.log(y[last] / y[first]) / np.log(x[last] / x[first])
    # Exponents of power laws are between 1/max_exponent and max_exponent.
    max_exponent = 3.0
    return float(np.clip(exponent, 1 / max_exponent, max_exponent))


def polyline(x: np.ndarray, y: np.ndarray) -> Points:
    """Return the points themselves, to be joined by straight lines."""
    return x, y


def branch_lines(
    rows: Rows, begin: Sequence[float] = (), joined: Interpolator = smooth_curve
) -> Iterator[tuple[Points, slice, bool]]:
    """Yield the line through each branch, its rows, and whether the tip retracts."""
    delta, x, y = rows
    for part, goes_out in split_branches(delta):
        before = [] if part.start or goes_out else begin
        yield joined(np.array([*before, *x[part]]), np.array([*before, *y[part]])), part, goes_out


def draw_rows(
    axes: Axes,
    rows: Rows,
    look: PlotStyle,
    label: str | None = None,
    begin: Sequence[float] = (),
    joined: Interpolator = smooth_curve,
) -> None:
    """Draw rows of a path of depths as lines with markers (none if there are many rows).

    Unloading is dashed with hollow markers.

    Parameters
    ----------
    axes
        The panel.
    rows
        Depths, x and y of the rows.
    look
        Colour, marker and line style.
    label
        Name in the legend.
    begin
        x and y of points that are drawn before the first branch if this is a loading branch.
    joined
        Interpolation of the rows: `smooth_curve` or `polyline`.
    """
    (_, x, y) = rows
    colour = look["color"]
    marker = look["marker"] if len(x) <= MAX_MARKED_POINTS else ""
    # A single row is drawn without a line, which would suggest a linear curve.
    if len(x) == 1:
        marker = marker or MARKERS[0]
        begin = ()
    for curve, part, goes_out in branch_lines(rows, begin, joined):
        line = {
            "ls": UNLOADING_STYLE["ls"] if goes_out else look.get("ls", "-"),
            "lw": 1.2 if marker else 1.6,
        }
        axes.plot(*curve, color=colour, zorder=2, label=None if marker else label, **line)
        if marker:
            # The turning point already has a marker, as the last row of loading.
            marked_rows = slice(part.start + goes_out, part.stop)
            marker_edge = {"mec": "white", "mew": 0.6}
            if goes_out:
                marker_edge = {"mec": colour, "mew": 1.0, "mfc": UNLOADING_STYLE["mfc"]}
            axes.plot(
                x[marked_rows],
                y[marked_rows],
                ls="",
                marker=marker,
                ms=5.5,
                color=colour,
                label=label,
                zorder=4,
                **marker_edge,
            )
        label = None
