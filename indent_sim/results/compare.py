"""Rows of two results side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError, VerificationError
from indent_sim.results.folder import TABLE, Report
from indent_sim.results.reader import COMPARED, force_table, read, read_table
from indent_sim.results.tables import DYNAMIC, EXPERIMENT, WORD_COLUMNS

MOST_DIFFERENCES = 10  # differences told one by one
RTOL = 1e-6
Table = dict[str, np.ndarray]
Tolerances = float | Mapping[str, float]  # of all columns, or by column


@dataclass(frozen=True)
class Comparison:
    """Two tables side by side: one (a, b) pair per row and column, rows matched by step, by row, or else by depth.

    steps: what is said of each row, step 3 or delta 0.1; rtol of every column; worst: its largest relative difference;
    differences: what differs, in words; empty when equal; beside: of two results the tables beside the force table.
    """

    steps: tuple[float, ...]
    matched_by: str
    pairs: dict[str, np.ndarray]
    rtol: dict[str, float]
    worst: dict[str, float]
    differences: tuple[str, ...]
    beside: dict[str, Comparison] = field(default_factory=dict)

    def check(self) -> None:
        """Raise VerificationError when the two differ."""
        if self.differences:
            more = len(self.differences) - MOST_DIFFERENCES
            told = [*self.differences[:MOST_DIFFERENCES], *([f"and {more} more"] if more > 0 else [])]
            raise VerificationError("the two differ\n" + "\n".join(told))

    def as_json(self) -> Report:
        """The comparison as one JSON object."""
        numbers = [{name: pair[i] for name, pair in self.pairs.items()} for i in range(len(self.steps))]
        rows = [{self.matched_by: key} | row for key, row in zip(self.steps, numbers, strict=True)]
        found = {"matched_by": self.matched_by, "rtol": self.rtol, "worst": self.worst, "rows": rows}
        beside = {name: table.as_json() for name, table in self.beside.items()}
        return found | {"differences": self.differences, "beside": beside}


def compare(
    first: Path | str, second: Path | str, rtol: Tolerances = RTOL, columns: Sequence[str] | None = None
) -> Comparison:
    """Compare columns [delta, force, a and those that rtol names] of two results row by row.

    Two numbers agree when |x - y| <= rtol max(|x|, |y|, 1e-6 largest of the column): a force of 1e-18 out of
    contact is a zero. An empty cell agrees with an empty cell alone. Where rtol says nothing of a column it is 1e-6.
    Rows belong together by step; where a file has no steps by depth, the k-th of a depth with the k-th; those of two
    experiment.csv or dynamic.csv by their number, and all their columns are compared, words too. Of two results these
    tables, where both have them, are compared as well. UsageError for a column that no two tables have.
    """
    paths = (Path(first), Path(second))
    beside = [name for name in (EXPERIMENT, DYNAMIC) if all((path / name).exists() for path in paths)]
    tables = {TABLE: (_table(paths[0]), _table(paths[1]))}
    tables |= {name: (_table(paths[0] / name), _table(paths[1] / name)) for name in beside}
    if isinstance(rtol, Mapping) and (named := rtol.keys() & set(WORD_COLUMNS)):
        raise UsageError(f"--rtol names {named.pop()}, a column of words: they are the same or not")
    asked = {*(columns or ()), *(rtol if isinstance(rtol, Mapping) else ())} - {""}
    for name in sorted(asked):
        if not any(name in A and name in B for A, B in tables.values()):
            _refuse_missing(name, dict(zip(map(str, paths), tables[TABLE], strict=True)))
    own = _compared(paths, *tables.pop(TABLE), rtol, columns)
    wanted = {name: (A, B) for name, (A, B) in tables.items() if not columns or asked & A.keys() & B.keys()}
    found = {name: _compared(paths, A, B, rtol, columns) for name, (A, B) in wanted.items()}
    told = [f"{name}: {difference}" for name, table in found.items() for difference in table.differences]
    return replace(own, beside=found, differences=(*own.differences, *told))


def _compared(
    paths: tuple[Path, Path], A: Table, B: Table, rtol: Tolerances, columns: Sequence[str] | None
) -> Comparison:
    """Two tables, in the columns asked for that both have."""
    key = next((name for name in ("step", "row") if name in A and name in B), "delta")
    _refuse_missing(key, dict(zip(map(str, paths), (A, B), strict=True)))
    usual = [name for name in (A if key == "row" else COMPARED) if name != "row"]
    tolerances = {name: r for name, r in _tolerances(rtol, columns, usual).items() if name in A and name in B}
    in_A, in_B = _numbered(A[key]), _numbered(B[key])
    common = [name for name in in_A if name in in_B]
    of_A, of_B = (np.array([places[name] for name in common], dtype=int) for places in (in_A, in_B))
    alone = [(paths[0], A[key][i]) for name, i in in_A.items() if name not in in_B]
    alone += [(paths[1], B[key][i]) for name, i in in_B.items() if name not in in_A]
    keys, differences = A[key][of_A], [f"{key} {value:.10g} is in {path} alone" for path, value in alone]
    if not len(keys):
        differences.append(f"the two have no {key} in common")
    for name in [name for name in tolerances if name in WORD_COLUMNS]:
        del tolerances[name]
        a, b = A[name][of_A], B[name][of_B]
        differences += [f"{key} {keys[i]:.10g}: {name} {a[i]} and {b[i]}" for i in np.flatnonzero(a != b)]
    pairs = {name: np.column_stack([A[name][of_A], B[name][of_B]]) for name in tolerances}
    worst = {}
    for name, pair in pairs.items():
        relative = _relative_difference(pair)
        worst[name] = float(relative.max(initial=0.0))
        for i in np.flatnonzero(~(relative <= tolerances[name])):
            sides = f"{pair[i, 0]:.10g} and {pair[i, 1]:.10g} differ by {relative[i]:.2g}"
            differences.append(f"{key} {keys[i]:.10g}: {name} {sides}")
    return Comparison(tuple(keys), key, pairs, tolerances, worst, tuple(differences))


def _table(path: Path) -> Table:
    """The columns of a result folder's or any other force table, with or without steps, or of a table beside one."""
    file = force_table(path)
    found = read_table(file, (), words=WORD_COLUMNS)
    if "branch" in found or "frequency" in found:
        return {"row": np.arange(1.0, len(next(iter(found.values()))) + 1)} | found
    columns = read_table(file, ("delta", "force"))
    return read(path).table if "step" in columns else columns


def _tolerances(rtol: Tolerances, columns: Sequence[str] | None, usual: Sequence[str]) -> dict[str, float]:
    """The tolerance of each column that is compared: those asked for, else the usual ones and what rtol names."""
    wanted = columns or usual
    if not isinstance(rtol, Mapping):
        return dict.fromkeys(wanted, rtol)
    others = [name for name in rtol if name and name not in wanted]
    if columns and others:
        raise UsageError(f"--rtol names {others[0]}, which is not among the --columns {', '.join(columns)}")
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
    """|x - y| over the larger of the two or 1e-6 of the largest in the column; infinite when one is NaN."""
    finite = np.abs(pair[np.isfinite(pair)])
    floor = 1e-6 * finite.max(initial=0.0)
    size = np.maximum(np.abs(pair).max(axis=1), floor)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.abs(pair[:, 0] - pair[:, 1]) / size
    same = (pair[:, 0] == pair[:, 1]) | np.isnan(pair).all(axis=1)
    return np.where(same, 0.0, np.where(np.isfinite(relative), relative, np.inf))
