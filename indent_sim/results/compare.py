"""Comparison of two results, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from indent_sim.model.state import SLIDE_COLUMNS
from indent_sim.process.errors import UsageError, VerificationError
from indent_sim.results.csv_table import header_of, read_table
from indent_sim.results.reader import (
    COMPARED_COLUMNS,
    MEASURED,
    Results,
    force_table_path,
    read,
    report_of,
)
from indent_sim.results.result_files import TABLE, Report
from indent_sim.results.table_interpolation import (
    MIN_ROWS,
    Table,
    history_chord_error,
    interpolate_table,
    rows_by_occurrence,
    values_at_times,
)
from indent_sim.results.tables import DYNAMIC, EXPERIMENT, WORD_COLUMNS
from indent_sim.results.unit_conversion import convert_to_common_units, refuse_different_units

DEFAULT_RTOL = 1e-6
# One relative tolerance for all columns, or one per column.
Tolerances = float | Mapping[str, float]


@dataclass(frozen=True)
class Comparison:
    """Result of the comparison of two tables, with a pair of values per row and column.

    Attributes
    ----------
    row_keys
        Step, row number, depth or time of each compared row.
    matched_by
        The column by which rows are matched: "step", "row", "delta" or "t".
    pairs
        Values (rows, 2) of both tables by column.
    rtol
        Relative tolerance of each column.
    max_relative_difference
        Largest relative difference of each column.
    differences
        One sentence per difference; empty if the two are equal within the tolerances.
    other_tables
        Comparisons of further tables that both results have.
    interpolation
        Path of the result whose values were interpolated, and the estimated interpolation error of
        the force, relative to the largest force.
    """

    row_keys: tuple[float, ...]
    matched_by: str
    pairs: dict[str, np.ndarray]
    rtol: dict[str, float]
    max_relative_difference: dict[str, float]
    differences: tuple[str, ...]
    other_tables: dict[str, Comparison] = field(default_factory=dict)
    interpolation: tuple[Path, float] | None = None

    @property
    def residual(self) -> dict[str, float]:
        """Maximum and root mean square of the force differences [% of the largest force]."""
        pair = self.pairs.get("force", np.empty((0, 2)))
        pair = pair[np.isfinite(pair).all(axis=1)]
        largest = float(np.abs(pair).max(initial=0.0))
        if not largest:
            return {}
        difference = 100 * np.abs(pair[:, 0] - pair[:, 1]) / largest
        return {
            "percent_largest": float(difference.max()),
            "percent_rms": float(np.sqrt(np.mean(difference**2))),
        }

    def check(self) -> None:
        """Raise VerificationError if the two tables differ."""
        if self.differences:
            # Largest number of differences in a message.
            max_differences = 10
            remaining = len(self.differences) - max_differences
            lines = [
                *self.differences[:max_differences],
                *([f"and {remaining} more"] if remaining > 0 else []),
            ]
            raise VerificationError("the two results differ\n" + "\n".join(lines))

    def as_json(self) -> Report:
        """Return the comparison as an object for JSON."""
        numbers = [
            {name: pair[i] for name, pair in self.pairs.items()} for i in range(len(self.row_keys))
        ]
        rows = [
            {self.matched_by: key} | row for key, row in zip(self.row_keys, numbers, strict=True)
        ]
        entries: Report = {
            "matched_by": self.matched_by,
            "rtol": self.rtol,
            "worst": self.max_relative_difference,
            "rows": rows,
        }
        entries |= {"residual": self.residual or None, "interpolated": None}
        if self.interpolation:
            path, error = self.interpolation
            entries["interpolated"] = {"curve": str(path), "error": error}
        other_tables = {name: table.as_json() for name, table in self.other_tables.items()}
        return entries | {"differences": self.differences, "beside": other_tables}


def compare(
    first: Path | str,
    second: Path | str,
    rtol: Tolerances = DEFAULT_RTOL,
    columns: Sequence[str] | None = None,
) -> Comparison:
    """Compare two results row by row.

    Two numbers agree if |x - y| <= rtol max(|x|, |y|, 1e-6 max|column|). Due to the last term, a
    force of 1e-18 out of contact counts as zero. An empty cell agrees only with an empty cell.

    Rows are matched by step. In tables without steps they are matched by depth: the k-th row at a
    depth in one table is matched with the k-th row at this depth in the other table. If the depths
    differ, the curve with more rows is interpolated in depth, separately for approach and
    retraction. A simulated result is interpolated by power laws between neighbouring rows, and a
    measured curve linearly. If the times of two histories differ, the history with more rows is
    evaluated at the times of the other history. A row at such a time is used directly (at a jump,
    the row on the same side of the jump); between its rows the history is interpolated linearly.
    The interpolation error is of order h^2; it is estimated as a quarter of the error that results
    if every second row is interpolated from its neighbours.

    A measured curve is converted to the units of the other result. A history that an earlier
    version wrote to experiment.csv can be compared with one in the force table. Rows of two files
    experiment.csv or dynamic.csv are matched by their number, and all columns are compared,
    including text. If both results have these files, they are compared as well.

    Parameters
    ----------
    first, second
        Result folders, force tables or measured curves.
    rtol
        Relative tolerance of all columns, or tolerances by column; the key "" is for all columns
        that are not named (default 1e-6).
    columns
        The compared columns; by default delta, force, a and the columns named in `rtol`.

    Raises
    ------
    UsageError
        If a table cannot be read, the units differ, or no pair of tables has a requested column.
    """
    paths = (Path(first), Path(second))
    common_tables = [
        name for name in (EXPERIMENT, DYNAMIC) if all((path / name).exists() for path in paths)
    ]
    tables = {TABLE: _force_tables(paths, *_read_table_pair(*paths))}
    tables |= {name: _read_table_pair(paths[0] / name, paths[1] / name) for name in common_tables}
    if isinstance(rtol, Mapping) and (word_columns := rtol.keys() & set(WORD_COLUMNS)):
        name = word_columns.pop()
        raise UsageError(f"--rtol names {name}, a column of words, to which no tolerance applies")
    requested_columns = {*(columns or ()), *(rtol if isinstance(rtol, Mapping) else ())} - {""}
    for name in sorted(requested_columns):
        if not any(name in A and name in B for A, B in tables.values()):
            _refuse_missing(name, dict(zip(map(str, paths), tables[TABLE], strict=True)))
    force_comparison = _compare_tables(paths, *tables.pop(TABLE), rtol, columns)
    wanted_tables = {
        name: (A, B)
        for name, (A, B) in tables.items()
        if not columns or requested_columns & A.keys() & B.keys()
    }
    comparisons = {
        name: _compare_tables(paths, A, B, rtol, columns) for name, (A, B) in wanted_tables.items()
    }
    table_differences = [
        f"{name}: {difference}"
        for name, table in comparisons.items()
        for difference in table.differences
    ]
    return replace(
        force_comparison,
        other_tables=comparisons,
        differences=(*force_comparison.differences, *table_differences),
    )


def _compare_tables(
    paths: tuple[Path, Path], A: Table, B: Table, rtol: Tolerances, columns: Sequence[str] | None
) -> Comparison:
    """Compare two tables in the requested columns that both have."""
    key = next((name for name in ("step", "row") if name in A and name in B), "delta")
    _refuse_missing(key, dict(zip(map(str, paths), (A, B), strict=True)))
    compared_columns = A if key == "row" else (*COMPARED_COLUMNS, *SLIDE_COLUMNS)
    default_columns = [name for name in compared_columns if name != "row"]
    tolerances = {
        name: r
        for name, r in _column_tolerances(rtol, columns, default_columns).items()
        if name in A and name in B
    }
    rows_of_A = rows_by_occurrence(A[key])
    rows_of_B = rows_by_occurrence(B[key])
    common = [name for name in rows_of_A if name in rows_of_B]
    matched_A, matched_B = (
        np.array([places[name] for name in common], dtype=int) for places in (rows_of_A, rows_of_B)
    )
    unmatched = [(paths[0], A[key][i]) for name, i in rows_of_A.items() if name not in rows_of_B]
    unmatched += [(paths[1], B[key][i]) for name, i in rows_of_B.items() if name not in rows_of_A]
    keys = A[key][matched_A]
    differences = [f"{key} {value:.10g} is only in {path}" for path, value in unmatched]
    has_times = key == "step" and all(
        "t" in table and (np.diff(table["t"]) >= 0).all() for table in (A, B)
    )
    abscissa = "t" if has_times else "delta"
    # Depths or times are the same within this relative tolerance.
    place_rtol = 1e-9
    abscissa_rtol = {
        "delta": max(tolerances.get("delta", 0.0), place_rtol),
        "t": place_rtol,
    }[abscissa]
    compare_interpolated = _compare_by_time if has_times else _compare_by_depth
    # The rows of a tip that slides have one depth, in which nothing can be interpolated
    slides = any(name in table for name in SLIDE_COLUMNS for table in (A, B))
    is_matched = (
        key == "row" or slides or _is_matched(A, B, matched_A, matched_B, abscissa, abscissa_rtol)
    )
    if not is_matched and (comparison := compare_interpolated(paths, A, B, tolerances)):
        return comparison
    if not len(keys):
        differences.append(f"the two results have no {key} in common")
    for name in [name for name in tolerances if name in WORD_COLUMNS]:
        del tolerances[name]
        a = A[name][matched_A]
        b = B[name][matched_B]
        differences += [
            f"{key} {keys[i]:.10g}: {name} {a[i]} and {b[i]}" for i in np.flatnonzero(a != b)
        ]
    pairs = {name: np.column_stack([A[name][matched_A], B[name][matched_B]]) for name in tolerances}
    worst, value_differences = _find_differences(key, keys, pairs, tolerances)
    return Comparison(
        tuple(keys), key, pairs, tolerances, worst, (*differences, *value_differences)
    )


def _find_differences(
    key: str, keys: np.ndarray, pairs: dict[str, np.ndarray], tolerances: dict[str, float]
) -> tuple[dict[str, float], list[str]]:
    """Return the largest relative difference of each column, and one sentence per difference."""
    worst = {}
    differences = []
    for name, pair in pairs.items():
        relative = _relative_difference(pair)
        worst[name] = float(relative.max(initial=0.0))
        for i in np.flatnonzero(~(relative <= tolerances[name])):
            sides = f"{pair[i, 0]:.10g} and {pair[i, 1]:.10g} differ by {relative[i]:.2g}"
            differences.append(f"{key} {keys[i]:.10g}: {name} {sides}")
    return worst, differences


def _is_matched(
    A: Table, B: Table, matched_A: np.ndarray, matched_B: np.ndarray, abscissa: str, rtol: float
) -> bool:
    """True if rows of the same step have the same depth (or time).

    If forces are prescribed, depths are results and may differ slightly; rows of equal steps are
    then matched nevertheless. Tables with too few rows for interpolation count as matched.
    """
    if (
        min(len(A[abscissa]), len(B[abscissa])) < 1
        or max(len(A[abscissa]), len(B[abscissa])) < MIN_ROWS
    ):
        return True
    if not len(matched_A):
        return False
    a = A[abscissa][matched_A]
    b = B[abscissa][matched_B]
    is_close = np.isclose(a, b, rtol=rtol, atol=0.0, equal_nan=True)
    # Rows are matched by step if at least half of them are at the same depth or time.
    min_fraction = 0.5
    if "step" in A and "step" in B:
        return bool(is_close.mean() >= min_fraction)
    return len(matched_A) >= min_fraction * min(len(A[abscissa]), len(B[abscissa]))


def _compare_by_time(
    paths: tuple[Path, Path], A: Table, B: Table, tolerances: dict[str, float]
) -> Comparison | None:
    """Compare histories at the times of the history with fewer rows; None without common times."""
    is_first_denser = len(A["t"]) >= len(B["t"])
    (dense, sparse), (dense_path, sparse_path) = (
        ((A, B), paths) if is_first_denser else ((B, A), paths[::-1])
    )
    t = sparse["t"]
    inside = (t >= dense["t"][0]) & (t <= dense["t"][-1])
    if not inside.any():
        return None
    number_tolerances = {
        name: rtol for name, rtol in tolerances.items() if name not in WORD_COLUMNS
    }
    values, is_chord = values_at_times(dense, t, tuple(number_tolerances))
    sides = {name: (values[name][inside], sparse[name][inside]) for name in number_tolerances}
    pairs = {
        name: np.column_stack(pair if is_first_denser else pair[::-1])
        for name, pair in sides.items()
    }
    differences = [f"t {value:.10g} is only in {sparse_path}" for value in t[~inside]]
    worst, value_differences = _find_differences("t", t[inside], pairs, number_tolerances)
    interpolated = (dense_path, history_chord_error(dense)) if is_chord[inside].any() else None
    fields = (
        tuple(t[inside]),
        "t",
        pairs,
        number_tolerances,
        worst,
        (*differences, *value_differences),
    )
    return Comparison(*fields, interpolation=interpolated)


def _compare_by_depth(
    paths: tuple[Path, Path], A: Table, B: Table, tolerances: dict[str, float]
) -> Comparison | None:
    """Compare tables at the depths of the table with fewer rows; None without common depths."""
    is_first_denser = len(A["delta"]) >= len(B["delta"])
    (dense, sparse), (dense_path, sparse_path) = (
        ((A, B), paths) if is_first_denser else ((B, A), paths[::-1])
    )
    names = [name for name in tolerances if name not in (*WORD_COLUMNS, "delta")]
    rows, values, error = interpolate_table(dense, sparse, names)
    if not len(rows):
        return None
    sides = {name: (values[name], sparse[name][rows]) for name in names}
    pairs = {
        name: np.column_stack(pair if is_first_denser else pair[::-1])
        for name, pair in sides.items()
    }
    keys = sparse["delta"][rows]
    unmatched = np.setdiff1d(np.arange(len(sparse["delta"])), rows)
    differences = [f"delta {sparse['delta'][i]:.10g} is only in {sparse_path}" for i in unmatched]
    worst, value_differences = _find_differences("delta", keys, pairs, tolerances)
    fields = (
        tuple(keys),
        "delta",
        pairs,
        {name: tolerances[name] for name in names},
        worst,
        (*differences, *value_differences),
    )
    return Comparison(*fields, interpolation=(dense_path, error))


def _force_tables(paths: tuple[Path, Path], A: Table, B: Table) -> tuple[Table, Table]:
    """Return the two force tables.

    If only one of the two results has times, the table of the other result is replaced by the
    history in its experiment.csv, if that file exists.
    """
    if ("t" in A) == ("t" in B):
        return A, B
    experiment_file = paths["t" in A] / EXPERIMENT
    if not experiment_file.is_file():
        return A, B
    history = read_table(experiment_file, ("force",), ("t", "delta", "a"), WORD_COLUMNS)
    if not np.isfinite(history["t"]).all():
        return A, B
    # The column force_error of experiment.csv was the error of the instrument, not of the solution.
    history = {name: column for name, column in history.items() if name != "force_error"}
    history |= {"step": np.arange(1.0, len(history["t"]) + 1)}
    return (A, history) if "t" in A else (history, B)


def _read_table_pair(first: Path, second: Path) -> tuple[Table, Table]:
    """Read two tables in the same units; raise UsageError if two results have different units."""
    first_results, second_results = convert_to_common_units(
        [_read_any_table(path) for path in (first, second)]
    )
    refuse_different_units(
        [first_results, second_results], "run one of them in the units of the other"
    )
    return _comparable_columns(first_results), _comparable_columns(second_results)


def _comparable_columns(results: Results) -> Table:
    """Return the columns of a result; a measured curve has no steps or radii."""
    if not results.report.get(MEASURED):
        return results.table
    return {name: column for name, column in results.table.items() if name not in ("step", "a")}


def _read_any_table(path: Path) -> Results:
    """Read a result, a measured curve, or a table of an experiment under any file name."""
    file = force_table_path(path)
    names = set(header_of(file))
    is_of_branches = "branch" in names and ("step" in names or {"z", "a"} <= names)
    if is_of_branches or "frequency" in names:
        columns = read_table(file, (), words=WORD_COLUMNS)
        rows = {"row": np.arange(1.0, len(next(iter(columns.values()))) + 1)}
        return Results(path, rows | columns, report_of(path))
    return read(path)


def _column_tolerances(
    rtol: Tolerances, columns: Sequence[str] | None, default_columns: Sequence[str]
) -> dict[str, float]:
    """Return the tolerance of each compared column.

    The compared columns are `columns`, or by default `default_columns` and the columns named in
    `rtol`.
    """
    compared_columns = columns or default_columns
    if not isinstance(rtol, Mapping):
        return dict.fromkeys(compared_columns, rtol)
    extra_columns = [name for name in rtol if name and name not in compared_columns]
    if columns and extra_columns:
        column_names = ", ".join(columns)
        raise UsageError(
            f"--rtol names {extra_columns[0]}, which is not among the --columns {column_names}"
        )
    default = rtol.get("", DEFAULT_RTOL)
    return {name: rtol.get(name, default) for name in (*compared_columns, *extra_columns)}


def _refuse_missing(name: str, tables: Mapping[str, Table]) -> None:
    """Raise UsageError if no table has the column `name`."""
    for path, table in tables.items():
        if name not in table:
            raise UsageError(f"{path} has no column '{name}'; it has {', '.join(table)}")


def _relative_difference(pair: np.ndarray) -> np.ndarray:
    """Return |x - y| / max(|x|, |y|, 1e-6 max|column|) of pairs (rows, 2).

    The difference is 0 for two NaN, and infinite for a pair with one NaN.
    """
    finite = np.abs(pair[np.isfinite(pair)])
    floor = 1e-6 * finite.max(initial=0.0)
    size = np.maximum(np.abs(pair).max(axis=1), floor)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.abs(pair[:, 0] - pair[:, 1]) / size
    same = (pair[:, 0] == pair[:, 1]) | np.isnan(pair).all(axis=1)
    return np.where(same, 0.0, np.where(np.isfinite(relative), relative, np.inf))
