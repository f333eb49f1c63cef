"""Interpolation of tables in depth and in time, with an estimate of its error."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from indent_sim.results.measured.measurement import curve_parts

MIN_ROWS = 3  # A table with fewer rows is not interpolated.
Table = dict[str, np.ndarray]


def values_at_times(dense: Table, t: np.ndarray, names: Sequence[str]) -> tuple[Table, np.ndarray]:
    """Return the columns of a history at other times, with a mask of interpolated rows.

    Parameters
    ----------
    dense
        The history, with columns by name (rows,).
    t
        Times (n,), not decreasing; at a jump a time occurs twice.
    names
        The columns to return.

    Returns
    -------
    tuple
        Columns by name (n,), and a mask (n,) of the values that are linearly interpolated between
        two rows.
    """
    # Two rows at a jump have the same time, and a table may have only the later one. Occurrences
    # are counted from the end, so that the rows after the jump are matched first.
    reverse = slice(None, None, -1)
    rows = rows_by_occurrence(dense["t"][reverse])
    wanted_rows = rows_by_occurrence(t[reverse])
    matched_rows = {
        len(t) - 1 - k: len(dense["t"]) - 1 - rows[time]
        for time, k in wanted_rows.items()
        if time in rows
    }
    columns = {name: np.interp(t, dense["t"], dense[name]) for name in names}
    for name, column in columns.items():
        column[list(matched_rows)] = dense[name][list(matched_rows.values())]
    return columns, ~np.isin(np.arange(len(t)), list(matched_rows))


def history_chord_error(history: Table) -> float:
    """Estimate the error of linear interpolation of the force of a history.

    The error is relative to the largest force. The history is split at jumps and at the ends of
    branches, where the slope of the force is discontinuous.
    """
    t = history["t"]
    force = history["force"]
    corners = history["branch"][1:] != history["branch"][:-1] if "branch" in history else False
    pieces = np.split(np.arange(len(t)), np.flatnonzero((np.diff(t) == 0) | corners) + 1)
    largest = float(np.nanmax(np.abs(force), initial=0.0)) or 1.0
    return (
        max(_interpolation_error(t[piece], force[piece], is_smooth=False) for piece in pieces)
        / largest
    )


def interpolate_table(
    dense: Table, sparse: Table, names: Sequence[str]
) -> tuple[np.ndarray, dict[str, np.ndarray], float]:
    """Interpolate a table at the depths of another table, separately in approach and retraction.

    Parameters
    ----------
    dense, sparse
        The table to be interpolated, and the table whose depths are used; columns by name.
    names
        The columns to interpolate.

    Returns
    -------
    tuple
        Rows of `sparse` within the depths of `dense` (k,), interpolated columns by name (k,), and
        the estimated error of the force, relative to the largest force.
    """
    parts = [curve_parts(table["delta"]) for table in (dense, sparse)]
    rows: list[np.ndarray] = []
    values: dict[str, list[np.ndarray]] = {name: [] for name in names}
    # Only results have steps; a measured curve has noise, and is not smooth.
    is_smooth = "step" in dense
    error = 0.0
    largest = float(np.nanmax(np.abs(dense["force"]), initial=0.0)) or 1.0
    for part in ("approach", "retract"):
        if not all(part in pieces for pieces in parts):
            continue
        dense_rows, sparse_rows = (
            np.arange(len(t["delta"]))[pieces[part]]
            for t, pieces in zip((dense, sparse), parts, strict=True)
        )
        order = dense_rows[np.argsort(dense["delta"][dense_rows], kind="stable")]
        x = dense["delta"][order]
        sparse_x = sparse["delta"][sparse_rows]
        inside = (sparse_x >= x[0]) & (sparse_x <= x[-1])
        rows.append(sparse_rows[inside])
        for name in names:
            values[name].append(_interpolate(sparse_x[inside], x, dense[name][order], is_smooth))
        error = max(error, _interpolation_error(x, dense["force"][order], is_smooth) / largest)
    joined = {name: np.concatenate([np.empty(0), *pieces]) for name, pieces in values.items()}
    return np.concatenate([np.empty(0, dtype=int), *rows]), joined, error


def _interpolate(x_new: np.ndarray, x: np.ndarray, y: np.ndarray, is_smooth: bool) -> np.ndarray:
    """Interpolate y(x) at new points, with x in ascending order.

    A smooth curve is interpolated by a power law y = y_1 (x/x_1)^m between two positive neighbours;
    otherwise the interpolation is linear.
    """
    values = np.interp(x_new, x, y)
    k = np.clip(np.searchsorted(x, x_new), 1, max(len(x) - 1, 1))
    if not is_smooth or len(x) < 2:
        return values
    low = k - 1
    high = k
    is_power_law = (x[low] > 0) & (y[low] > 0) & (y[high] > 0) & (x[high] > x[low])
    with np.errstate(all="ignore"):
        power = np.log(y[high] / y[low]) / np.log(x[high] / x[low])
        power_values = y[low] * (x_new / x[low]) ** power
    return np.where(is_power_law, power_values, values)


def _interpolation_error(x: np.ndarray, y: np.ndarray, is_smooth: bool) -> float:
    """Estimate the largest interpolation error between the points of a curve.

    Every second point is left out and interpolated from its neighbours. The error of this
    interpolation is O((2h)^2), so that a quarter of it is an estimate of the error O(h^2) between
    all points.
    """
    if len(x) < MIN_ROWS:
        return 0.0
    largest_error = 0.0
    for first in (0, 1):
        kept_x = x[first::2]
        left_out_x = x[1 - first :: 2]
        inside = (left_out_x > kept_x[0]) & (left_out_x < kept_x[-1])
        interpolated = _interpolate(left_out_x[inside], kept_x, y[first::2], is_smooth)
        largest_error = max(
            largest_error,
            float(np.nanmax(np.abs(interpolated - y[1 - first :: 2][inside]), initial=0.0)),
        )
    return 0.25 * largest_error


def rows_by_occurrence(column: np.ndarray) -> dict[tuple[str, int], int]:
    """Return the row number of the k-th occurrence of every value, keyed by value and k.

    Values are rounded to 10 digits.
    """
    counts: Counter[str] = Counter()
    rows = {}
    for i, name in enumerate(f"{value:.9e}" for value in column):
        rows[name, counts[name]] = i
        counts[name] += 1
    return rows
