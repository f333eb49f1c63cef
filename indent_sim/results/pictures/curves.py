"""Curves through the rows of a result: smooth interpolation, loading and unloading."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from indent_sim.results.pictures.figures import COLOURS, MARKERS, MAX_MARKED_POINTS, Axes, PlotStyle

POINTS_BETWEEN_ROWS = 20  # A drawn curve has so many points between two rows.
MAX_EXPONENT = 3.0  # Exponents of power laws are between 1/MAX_EXPONENT and MAX_EXPONENT.
UNLOADING_STYLE = {"ls": (0, (4, 2)), "mfc": "white"}  # Dashed, with hollow markers.
Points = tuple[np.ndarray, np.ndarray]  # x and y.
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]  # Depths, x and y.
Interpolator = Callable[[np.ndarray, np.ndarray], Points]  # Function from points to a line.
Colour = Any  # Any form that matplotlib accepts.


def line_style(index: int, count: int) -> PlotStyle:
    """Return colour and marker of one of several curves.

    Many curves have colours of a map from dark to light, and no markers.
    """
    if count <= 10:
        return {"color": COLOURS[index % len(COLOURS)], "marker": MARKERS[index % len(MARKERS)]}
    return {"color": map_colour(index, count), "marker": ""}


def map_colour(index: int, count: int) -> Colour:
    """Return one of several colours of a map, from dark to light."""
    from matplotlib import colormaps

    # The lightest yellow of the map is invisible on white.
    return colormaps["viridis"](0.9 * index / max(1, count - 1))


def split_branches(delta: np.ndarray) -> list[tuple[slice, bool]]:
    """Split a path of depths at its turning points.

    A turning point belongs to both branches. A tip that stands still has not turned yet.

    Returns
    -------
    list
        Rows of each branch, and whether the tip goes out.
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
    """Return a smooth curve through points in ascending or descending x, monotone where they are.

    It is piecewise cubic in y^(1/n), with n from the first and last point, so that power laws are
    drawn exactly: force and contact radius nearly are power laws of the depth. Slopes are limited
    so that the curve does not overshoot. Points with turning x, and negative forces, which may
    jump, are joined by straight lines.

    Parameters
    ----------
    x, y
        The points (n,).

    References
    ----------
    J. M. Hyman, SIAM J. Sci. Stat. Comput. 4 (1983) 645: the limiter of the slopes.
    """
    h = np.diff(x)
    goes_on = (h > 0).all() or (h < 0).all()
    if len(x) < 3 or not goes_on or not np.isfinite(np.append(x, y)).all() or y.min() < 0:
        return x, y
    n = _power_law_exponent(x, y)
    fine_x, straightened = _piecewise_cubic(x, y ** (1 / n), h)
    fine_y = np.maximum(straightened, 0.0) ** n if n != 1 else straightened
    fine_y[::POINTS_BETWEEN_ROWS] = y  # The curve passes through the rows without rounding errors.
    return fine_x, fine_y


def _power_law_exponent(x: np.ndarray, y: np.ndarray) -> float:
    """Return the exponent n of y ~ x^n through the first and last point; 1 for negative x."""
    is_positive = (x > 0) & (y > 0)
    if x.min() < 0 or is_positive.sum() < 2:
        return 1.0
    (near, low), (far, high) = sorted(zip(x[is_positive], y[is_positive], strict=True))[
        :: is_positive.sum() - 1
    ]
    return float(np.clip(np.log(high / low) / np.log(far / near), 1 / MAX_EXPONENT, MAX_EXPONENT))


def _piecewise_cubic(x: np.ndarray, y: np.ndarray, h: np.ndarray) -> Points:
    """Return the piecewise cubic with limited slopes through points whose distances in x are h."""
    secant = np.diff(y) / h
    slope = _limited_slopes(h, secant)
    t = np.linspace(0, 1, POINTS_BETWEEN_ROWS, endpoint=False)
    rise = (h * (slope[:-1] + slope[1:]) - 2 * np.diff(y))[:, None]
    bend = (h * (3 * secant - 2 * slope[:-1] - slope[1:]))[:, None]
    fine_y = y[:-1, None] + t * (h * slope[:-1])[:, None] + t**2 * bend + t**3 * rise
    fine_x = x[:-1, None] + t * h[:, None]
    return np.append(fine_x.ravel(), x[-1]), np.append(fine_y.ravel(), y[-1])


def _limited_slopes(h: np.ndarray, secant: np.ndarray) -> np.ndarray:
    """Return dy/dx at the points by parabolas, limited to three secants, and 0 at an extremum."""
    weight = h[1:] / (h[:-1] + h[1:])
    inside = weight * secant[:-1] + (1 - weight) * secant[1:]
    first = 2 * secant[0] - inside[0]
    last = 2 * secant[-1] - inside[-1]
    slopes = np.concatenate([[first], inside, [last]])
    before = np.append(secant[0], secant)
    after = np.append(secant, secant[-1])
    steepest = 3 * np.minimum(np.abs(before), np.abs(after))
    rises = np.sign(before) * ((before * after > 0) & (slopes * before > 0))
    return rises * np.minimum(np.abs(slopes), steepest)


def polyline(x: np.ndarray, y: np.ndarray) -> Points:
    """Return the points themselves: between two of them the curve may jump."""
    return x, y


def branch_lines(
    rows: Rows, begin: Sequence[float] = (), joined: Interpolator = smooth_curve
) -> Iterator[tuple[Points, slice, bool]]:
    """Yield the line through each branch, its rows, and whether the tip goes out."""
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
    """Draw rows of a path of depths as lines with markers; very many rows have no markers.

    Unloading is dashed and has hollow markers.

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
        x and y of points before the first branch, if it is loading.
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
            # The turning point has its marker as the last row of loading.
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
