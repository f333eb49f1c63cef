"""Rows of two results side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError, VerificationError
from indent_sim.results.folder import TABLE, Report
from indent_sim.results.measured.measurement import parts_of
from indent_sim.results.reader import (
    COMPARED,
    MEASURED,
    Results,
    force_table,
    header_of,
    in_common_units,
    read,
    read_table,
    refuse_other_units,
    report_of,
)
from indent_sim.results.tables import DYNAMIC, EXPERIMENT, WORD_COLUMNS

MOST_DIFFERENCES = 10  # differences told one by one
RTOL = 1e-6
FEWEST = 3  # rows of a table that is interpolated
# relative: depths that are one; share of the rows that must have one to be matched by name
NEAR = 1e-9
MATCHED = 0.5
Table = dict[str, np.ndarray]
Tolerances = float | Mapping[str, float]  # of all columns, or by column


@dataclass(frozen=True)
class Comparison:
    """Two tables side by side: one (a, b) pair per row and column, rows matched by step, by row, or
    else by depth.

    steps: what is said of each row, step 3 or delta 0.1; rtol of every column; worst: its largest
    relative difference; differences: what differs, in words; empty when equal; beside: of two
    results the tables beside the force table; interpolated: the one of two paths whose numbers were
    interpolated, and the largest error that this may make of the force, relative to the largest
    one.
    """

    steps: tuple[float, ...]
    matched_by: str
    pairs: dict[str, np.ndarray]
    rtol: dict[str, float]
    worst: dict[str, float]
    differences: tuple[str, ...]
    beside: dict[str, Comparison] = field(default_factory=dict)
    interpolated: tuple[Path, float] | None = None

    @property
    def residual(self) -> dict[str, float]:
        """Difference of the forces in per cent of the largest one: the largest, and the root of the
        mean square.
        """
        pair = self.pairs.get("force", np.empty((0, 2)))
        pair = pair[np.isfinite(pair).all(axis=1)]
        largest = float(np.abs(pair).max(initial=0.0))
        if not largest:
            return {}
        off = 100 * np.abs(pair[:, 0] - pair[:, 1]) / largest
        return {"percent_largest": float(off.max()), "percent_rms": float(np.sqrt(np.mean(off**2)))}

    def check(self) -> None:
        """Raise VerificationError when the two differ."""
        if self.differences:
            more = len(self.differences) - MOST_DIFFERENCES
            told = [
                *self.differences[:MOST_DIFFERENCES],
                *([f"and {more} more"] if more > 0 else []),
            ]
            raise VerificationError("the two differ\n" + "\n".join(told))

    def as_json(self) -> Report:
        """The comparison as one JSON object."""
        numbers = [
            {name: pair[i] for name, pair in self.pairs.items()} for i in range(len(self.steps))
        ]
        rows = [{self.matched_by: key} | row for key, row in zip(self.steps, numbers, strict=True)]
        found: Report = {
            "matched_by": self.matched_by,
            "rtol": self.rtol,
            "worst": self.worst,
            "rows": rows,
        }
        found |= {"residual": self.residual or None, "interpolated": None}
        if self.interpolated:
            path, error = self.interpolated
            found["interpolated"] = {"curve": str(path), "error": error}
        beside = {name: table.as_json() for name, table in self.beside.items()}
        return found | {"differences": self.differences, "beside": beside}


def compare(
    first: Path | str,
    second: Path | str,
    rtol: Tolerances = RTOL,
    columns: Sequence[str] | None = None,
) -> Comparison:
    """Compare columns [delta, force, a and those that rtol names] of two results row by row.

    Two numbers agree when |x - y| <= rtol max(|x|, |y|, 1e-6 largest of the column): a force of
    1e-18 out of contact is a zero. An empty cell agrees with an empty cell alone. Where rtol says
    nothing of a column it is 1e-6. Rows belong together by step; where a file has no steps by
    depth, the k-th of a depth with the k-th. Where depths differ the curve with more rows is
    interpolated in depth, approach and retraction apart: a result by power laws through two
    neighbours, a measured curve by chords. Of two histories whose times differ the one with more
    rows is taken at the times of the other: its row of that time, at a jump the one on the same
    side, else by chords. All miss something of the order h^2: a quarter of what they miss at rows
    that are left out. Measured curves are taken in the units of the other; UsageError for two
    results in different ones. A history that an earlier version wrote to experiment.csv is compared
    with one of today. Rows of two experiment.csv or dynamic.csv belong together by their number,
    and all their columns are compared, words too. Of two results these tables, where both have
    them, are compared as well. UsageError for a column that no two tables have.
    """
    paths = (Path(first), Path(second))
    beside = [
        name for name in (EXPERIMENT, DYNAMIC) if all((path / name).exists() for path in paths)
    ]
    tables = {TABLE: _histories(paths, *_both(*paths))}
    tables |= {name: _both(paths[0] / name, paths[1] / name) for name in beside}
    if isinstance(rtol, Mapping) and (named := rtol.keys() & set(WORD_COLUMNS)):
        raise UsageError(f"--rtol names {named.pop()}, a column of words: they are the same or not")
    asked = {*(columns or ()), *(rtol if isinstance(rtol, Mapping) else ())} - {""}
    for name in sorted(asked):
        if not any(name in A and name in B for A, B in tables.values()):
            _refuse_missing(name, dict(zip(map(str, paths), tables[TABLE], strict=True)))
    own = _compared(paths, *tables.pop(TABLE), rtol, columns)
    wanted = {
        name: (A, B)
        for name, (A, B) in tables.items()
        if not columns or asked & A.keys() & B.keys()
    }
    found = {name: _compared(paths, A, B, rtol, columns) for name, (A, B) in wanted.items()}
    told = [
        f"{name}: {difference}" for name, table in found.items() for difference in table.differences
    ]
    return replace(own, beside=found, differences=(*own.differences, *told))


def _compared(
    paths: tuple[Path, Path], A: Table, B: Table, rtol: Tolerances, columns: Sequence[str] | None
) -> Comparison:
    """Two tables, in the columns asked for that both have."""
    key = next((name for name in ("step", "row") if name in A and name in B), "delta")
    _refuse_missing(key, dict(zip(map(str, paths), (A, B), strict=True)))
    usual = [name for name in (A if key == "row" else COMPARED) if name != "row"]
    tolerances = {
        name: r for name, r in _tolerances(rtol, columns, usual).items() if name in A and name in B
    }
    in_A = _numbered(A[key])
    in_B = _numbered(B[key])
    common = [name for name in in_A if name in in_B]
    of_A, of_B = (np.array([places[name] for name in common], dtype=int) for places in (in_A, in_B))
    alone = [(paths[0], A[key][i]) for name, i in in_A.items() if name not in in_B]
    alone += [(paths[1], B[key][i]) for name, i in in_B.items() if name not in in_A]
    keys = A[key][of_A]
    differences = [f"{key} {value:.10g} is in {path} alone" for path, value in alone]
    in_time = key == "step" and all(
        "t" in table and (np.diff(table["t"]) >= 0).all() for table in (A, B)
    )
    along = "t" if in_time else "delta"
    near = {"delta": max(tolerances.get("delta", 0.0), NEAR), "t": NEAR}[along]
    otherwise = _by_time if in_time else _by_depth
    is_matched = key == "row" or _is_matched(A, B, of_A, of_B, along, near)
    if not is_matched and (found := otherwise(paths, A, B, tolerances)):
        return found
    if not len(keys):
        differences.append(f"the two have no {key} in common")
    for name in [name for name in tolerances if name in WORD_COLUMNS]:
        del tolerances[name]
        a = A[name][of_A]
        b = B[name][of_B]
        differences += [
            f"{key} {keys[i]:.10g}: {name} {a[i]} and {b[i]}" for i in np.flatnonzero(a != b)
        ]
    pairs = {name: np.column_stack([A[name][of_A], B[name][of_B]]) for name in tolerances}
    worst, told = _judged(key, keys, pairs, tolerances)
    return Comparison(tuple(keys), key, pairs, tolerances, worst, (*differences, *told))


def _judged(
    key: str, keys: np.ndarray, pairs: dict[str, np.ndarray], tolerances: dict[str, float]
) -> tuple[dict[str, float], list[str]]:
    """The largest relative difference of every column, and what differs in words."""
    worst = {}
    told = []
    for name, pair in pairs.items():
        relative = _relative_difference(pair)
        worst[name] = float(relative.max(initial=0.0))
        for i in np.flatnonzero(~(relative <= tolerances[name])):
            sides = f"{pair[i, 0]:.10g} and {pair[i, 1]:.10g} differ by {relative[i]:.2g}"
            told.append(f"{key} {keys[i]:.10g}: {name} {sides}")
    return worst, told


def _is_matched(
    A: Table, B: Table, of_A: np.ndarray, of_B: np.ndarray, along: str, rtol: float
) -> bool:
    """Whether rows that belong together by name are at the same depths, or times, or too few for
    anything else.

    Where forces are prescribed depths are found, and differ a little: then, too, steps belong
    together.
    """
    if min(len(A[along]), len(B[along])) < 1 or max(len(A[along]), len(B[along])) < FEWEST:
        return True
    if not len(of_A):
        return False
    a = A[along][of_A]
    b = B[along][of_B]
    near = np.isclose(a, b, rtol=rtol, atol=0.0, equal_nan=True)
    if "step" in A and "step" in B:
        return bool(near.mean() >= MATCHED)
    return len(of_A) >= MATCHED * min(len(A[along]), len(B[along]))


def _by_time(
    paths: tuple[Path, Path], A: Table, B: Table, tolerances: dict[str, float]
) -> Comparison | None:
    """The history with more rows at the times of the other; None where the two have no time in
    common.
    """
    first = len(A["t"]) >= len(B["t"])
    (dense, sparse), (curve, other) = ((A, B), paths) if first else ((B, A), paths[::-1])
    t = sparse["t"]
    inside = (t >= dense["t"][0]) & (t <= dense["t"][-1])
    if not inside.any():
        return None
    limits = {name: rtol for name, rtol in tolerances.items() if name not in WORD_COLUMNS}
    values, is_chord = _at_times(dense, t, tuple(limits))
    sides = {name: (values[name][inside], sparse[name][inside]) for name in limits}
    pairs = {name: np.column_stack(pair if first else pair[::-1]) for name, pair in sides.items()}
    differences = [f"t {value:.10g} is in {other} alone" for value in t[~inside]]
    worst, told = _judged("t", t[inside], pairs, limits)
    interpolated = (curve, _between_times(dense)) if is_chord[inside].any() else None
    found = tuple(t[inside]), "t", pairs, limits, worst, (*differences, *told)
    return Comparison(*found, interpolated=interpolated)


def _at_times(dense: Table, t: np.ndarray, names: Sequence[str]) -> tuple[Table, np.ndarray]:
    """The columns of a history at times, and where they are of no row but of a chord."""
    back = slice(
        None, None, -1
    )  # at a jump the last row of a time is the one after it, whether that before is there
    rows = _numbered(dense["t"][back])
    wanted = _numbered(t[back])
    same = {
        len(t) - 1 - k: len(dense["t"]) - 1 - rows[time]
        for time, k in wanted.items()
        if time in rows
    }
    columns = {name: np.interp(t, dense["t"], dense[name]) for name in names}
    for name, column in columns.items():
        column[list(same)] = dense[name][list(same.values())]
    return columns, ~np.isin(np.arange(len(t)), list(same))


def _between_times(history: Table) -> float:
    """What chords of a history miss of its force, relative to the largest one: between its jumps
    and corners.
    """
    t = history["t"]
    force = history["force"]
    corners = history["branch"][1:] != history["branch"][:-1] if "branch" in history else False
    pieces = np.split(np.arange(len(t)), np.flatnonzero((np.diff(t) == 0) | corners) + 1)
    largest = float(np.nanmax(np.abs(force), initial=0.0)) or 1.0
    return max(_left_out(t[piece], force[piece], is_smooth=False) for piece in pieces) / largest


def _by_depth(
    paths: tuple[Path, Path], A: Table, B: Table, tolerances: dict[str, float]
) -> Comparison | None:
    """The table with more rows at the depths of the other; None where the two have no depth in
    common.
    """
    first = len(A["delta"]) >= len(B["delta"])
    (dense, sparse), (curve, other) = ((A, B), paths) if first else ((B, A), paths[::-1])
    names = [name for name in tolerances if name not in (*WORD_COLUMNS, "delta")]
    rows, values, error = _interpolated(dense, sparse, names)
    if not len(rows):
        return None
    sides = {name: (values[name], sparse[name][rows]) for name in names}
    pairs = {name: np.column_stack(pair if first else pair[::-1]) for name, pair in sides.items()}
    keys = sparse["delta"][rows]
    alone = np.setdiff1d(np.arange(len(sparse["delta"])), rows)
    differences = [f"delta {sparse['delta'][i]:.10g} is in {other} alone" for i in alone]
    worst, told = _judged("delta", keys, pairs, tolerances)
    found = (
        tuple(keys),
        "delta",
        pairs,
        {name: tolerances[name] for name in names},
        worst,
        (*differences, *told),
    )
    return Comparison(*found, interpolated=(curve, error))


def _interpolated(
    dense: Table, sparse: Table, names: Sequence[str]
) -> tuple[np.ndarray, dict[str, np.ndarray], float]:
    """The rows of the sparse table inside the dense one's range, the dense one's columns there, and
    what that misses of its force at most, relative to the largest one; approach and retraction
    apart.
    """
    parts = [parts_of(table["delta"]) for table in (dense, sparse)]
    rows: list[np.ndarray] = []
    values: dict[str, list[np.ndarray]] = {name: [] for name in names}
    is_smooth = "step" in dense  # a measured curve has none, and noise
    error = 0.0
    largest = float(np.nanmax(np.abs(dense["force"]), initial=0.0)) or 1.0
    for part in ("approach", "retract"):
        if not all(part in found for found in parts):
            continue
        of_dense, of_sparse = (
            np.arange(len(t["delta"]))[found[part]]
            for t, found in zip((dense, sparse), parts, strict=True)
        )
        order = of_dense[np.argsort(dense["delta"][of_dense], kind="stable")]
        x = dense["delta"][order]
        at = sparse["delta"][of_sparse]
        inside = (at >= x[0]) & (at <= x[-1])
        rows.append(of_sparse[inside])
        for name in names:
            values[name].append(_between(at[inside], x, dense[name][order], is_smooth))
        error = max(error, _left_out(x, dense["force"][order], is_smooth) / largest)
    joined = {name: np.concatenate([np.empty(0), *found]) for name, found in values.items()}
    return np.concatenate([np.empty(0, dtype=int), *rows]), joined, error


def _between(at: np.ndarray, x: np.ndarray, y: np.ndarray, is_smooth: bool) -> np.ndarray:
    """Values between points in order of x: of a smooth curve by power laws through neighbours, else
    by chords.
    """
    values = np.interp(at, x, y)
    k = np.clip(np.searchsorted(x, at), 1, max(len(x) - 1, 1))
    if not is_smooth or len(x) < 2:
        return values
    low = k - 1
    high = k
    known = (x[low] > 0) & (y[low] > 0) & (y[high] > 0) & (x[high] > x[low])
    with np.errstate(all="ignore"):
        power = np.log(y[high] / y[low]) / np.log(x[high] / x[low])
        along = y[low] * (at / x[low]) ** power
    return np.where(known, along, values)


def _left_out(x: np.ndarray, y: np.ndarray, is_smooth: bool) -> float:
    """What interpolation misses at most: a quarter of what it misses at a point that is left out,
    between neighbours twice as far apart.
    """
    if len(x) < FEWEST:
        return 0.0
    off = 0.0
    for first in (0, 1):
        kept = x[first::2]
        out = x[1 - first :: 2]
        inside = (out > kept[0]) & (out < kept[-1])
        found = _between(out[inside], kept, y[first::2], is_smooth)
        off = max(off, float(np.nanmax(np.abs(found - y[1 - first :: 2][inside]), initial=0.0)))
    return 0.25 * off


def _histories(paths: tuple[Path, Path], A: Table, B: Table) -> tuple[Table, Table]:
    """The two force tables; where one alone has times, the other's history from experiment.csv, if
    it is there.
    """
    if ("t" in A) == ("t" in B):
        return A, B
    old = paths["t" in A] / EXPERIMENT
    found = read_table(old, ("force",), ("t", "delta", "a"), WORD_COLUMNS) if old.is_file() else {}
    if not found or not np.isfinite(found["t"]).all():
        return A, B
    found = {
        name: column for name, column in found.items() if name != "force_error"
    }  # the instrument's, it was
    found |= {"step": np.arange(1.0, len(found["t"]) + 1)}
    return (A, found) if "t" in A else (found, B)


def _both(first: Path, second: Path) -> tuple[Table, Table]:
    """The two tables, measured curves in the units of the other; UsageError for two results in
    different units.
    """
    one, other = in_common_units([_table(path) for path in (first, second)])
    refuse_other_units([one, other], "run one of them in the units of the other")
    return _columns(one), _columns(other)


def _columns(results: Results) -> Table:
    """The table of a result; a measured curve has neither steps nor radii."""
    if not results.report.get(MEASURED):
        return results.table
    return {name: column for name, column in results.table.items() if name not in ("step", "a")}


def _table(path: Path) -> Results:
    """A result or a measured curve, or the columns of a table of an experiment, under whatever
    name.
    """
    file = force_table(path)
    names = set(header_of(file))
    is_of_branches = "branch" in names and ("step" in names or {"z", "a"} <= names)
    if is_of_branches or "frequency" in names:
        found = read_table(file, (), words=WORD_COLUMNS)
        rows = {"row": np.arange(1.0, len(next(iter(found.values()))) + 1)}
        return Results(path, rows | found, report_of(path))
    return read(path)


def _tolerances(
    rtol: Tolerances, columns: Sequence[str] | None, usual: Sequence[str]
) -> dict[str, float]:
    """The tolerance of each column that is compared: those asked for, else the usual ones and what
    rtol names.
    """
    wanted = columns or usual
    if not isinstance(rtol, Mapping):
        return dict.fromkeys(wanted, rtol)
    others = [name for name in rtol if name and name not in wanted]
    if columns and others:
        raise UsageError(
            f"--rtol names {others[0]}, which is not among the --columns {', '.join(columns)}"
        )
    return {name: rtol.get(name, rtol.get("", RTOL)) for name in (*wanted, *others)}


def _refuse_missing(name: str, tables: Mapping[str, Table]) -> None:
    for path, table in tables.items():
        if name not in table:
            raise UsageError(f"{path} has no column '{name}'; it has {', '.join(table)}")


def _numbered(column: np.ndarray) -> dict[tuple[str, int], int]:
    """The place of the k-th occurrence of every value; values are the same to 10 digits."""
    seen: Counter[str] = Counter()
    places = {}
    for i, name in enumerate(f"{value:.9e}" for value in column):
        places[name, seen[name]] = i
        seen[name] += 1
    return places


def _relative_difference(pair: np.ndarray) -> np.ndarray:
    """|x - y| over the larger of the two or 1e-6 of the largest in the column; infinite when one is
    NaN.
    """
    finite = np.abs(pair[np.isfinite(pair)])
    floor = 1e-6 * finite.max(initial=0.0)
    size = np.maximum(np.abs(pair).max(axis=1), floor)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.abs(pair[:, 0] - pair[:, 1]) / size
    same = (pair[:, 0] == pair[:, 1]) | np.isnan(pair).all(axis=1)
    return np.where(same, 0.0, np.where(np.isfinite(relative), relative, np.inf))
