"""Rows of two results side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import UsageError, VerificationError
from indent_sim.results.folder import TABLE
from indent_sim.results.reader import COMPARED, force_table, read, read_table
from indent_sim.results.tables import DYNAMIC, EXPERIMENT, WORDS

SHOWN = 10  # differences told one by one
RTOL = 1e-6
Table = dict[str, np.ndarray]


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
            more = len(self.differences) - SHOWN
            told = [*self.differences[:SHOWN], *([f"and {more} more"] if more > 0 else [])]
            raise VerificationError("the two differ\n" + "\n".join(told))

    def as_json(self) -> dict[str, Any]:
        """The comparison as one JSON object."""
        rows = [{self.matched_by: key, **{name: self.pairs[name][i] for name in self.pairs}}
                for i, key in enumerate(self.steps)]  # fmt: skip
        return {"matched_by": self.matched_by, "rtol": self.rtol, "worst": self.worst, "rows": rows,
                "differences": self.differences,
                "beside": {name: table.as_json() for name, table in self.beside.items()}}  # fmt: skip


def compare(
    first: Path | str,
    second: Path | str,
    rtol: float | Mapping[str, float] = RTOL,
    columns: Sequence[str] | None = None,
) -> Comparison:
    """Compare columns [delta, force, a and those that rtol names] of two results row by row.

    Two numbers agree when |x - y| <= rtol max(|x|, |y|, 1e-6 largest of the column): a force of 1e-18 out of
    contact is a zero. An empty cell agrees with an empty cell alone. Where rtol says nothing of a column it is 1e-6.
    Rows belong together by step; where a file has no steps by depth, the k-th of a depth with the k-th; those of two
    experiment.csv or dynamic.csv by their number, and all their columns are compared, words too. Of two results these
    tables, where both have them, are compared as well. UsageError for a column that no two tables have.
    """
    paths = (Path(first), Path(second))
    tables = {TABLE: (_table(paths[0]), _table(paths[1])), **_tables_beside(paths)}
    if isinstance(rtol, Mapping) and (named := rtol.keys() & set(WORDS)):
        raise UsageError(f"--rtol names {named.pop()}, a column of words: they are the same or not")
    asked = {*(columns or ()), *(rtol if isinstance(rtol, Mapping) else ())} - {""}
    for name in sorted(asked):
        if not any(name in A and name in B for A, B in tables.values()):
            _refuse_missing(name, dict(zip(map(str, paths), tables[TABLE], strict=True)))
    found = {name: _compared(paths, *pair, rtol, columns) for name, pair in tables.items()
             if name == TABLE or not columns or asked & pair[0].keys() & pair[1].keys()}  # fmt: skip
    own = found.pop(TABLE)
    told = [f"{name}: {difference}" for name, table in found.items() for difference in table.differences]
    return replace(own, beside=found, differences=(*own.differences, *told))


def _compared(
    paths: tuple[Path, Path], A: Table, B: Table, rtol: float | Mapping[str, float], columns: Sequence[str] | None
) -> Comparison:
    """Two tables, in the columns asked for that both have."""
    key = next((name for name in ("step", "row") if name in A and name in B), "delta")
    _refuse_missing(key, dict(zip(map(str, paths), (A, B), strict=True)))
    usual = [name for name in (A if key == "row" else COMPARED) if name != "row"]
    tolerances = _tolerances(rtol, columns or usual, named=bool(columns))
    common = [name for name in tolerances if name in A and name in B]
    tolerances = {name: tolerances[name] for name in common}
    keys, of_A, of_B, alone = _matched(A[key], B[key])
    differences = [f"{key} {value:.10g} is in {paths[where]} alone" for where, value in alone]
    if not len(keys):
        differences.append(f"the two have no {key} in common")
    sides = {name: (A[name][of_A], B[name][of_B]) for name in common}
    differences += [
        f"{key} {keys[i]:.10g}: {name} {sides[name][0][i]} and {sides[name][1][i]}"
        for name in common if name in WORDS for i in np.flatnonzero(sides[name][0] != sides[name][1])
    ]  # fmt: skip
    tolerances = {name: tolerance for name, tolerance in tolerances.items() if name not in WORDS}
    pairs = {name: np.column_stack(sides[name]) for name in tolerances}
    worst = {}
    for name, pair in pairs.items():
        relative = _relative_difference(pair)
        worst[name] = float(relative.max(initial=0.0))
        differences += [
            f"{key} {keys[i]:.10g}: {name} {pair[i, 0]:.10g} and {pair[i, 1]:.10g} differ by {relative[i]:.2g}"
            for i in np.flatnonzero(~(relative <= tolerances[name]))
        ]
    return Comparison(tuple(keys), key, pairs, tolerances, worst, tuple(differences))


def _table(path: Path) -> Table:
    """The columns of a result folder's or any other force table, with or without steps, or of a table beside one."""
    file = force_table(path)
    found = read_table(file, (), words=WORDS)
    if "branch" in found or "frequency" in found:
        return {"row": np.arange(1.0, len(next(iter(found.values()))) + 1)} | found
    columns = read_table(file, ("delta", "force"))
    return read(path).table if "step" in columns else columns


def _tables_beside(paths: tuple[Path, Path]) -> dict[str, tuple[Table, Table]]:
    """The tables of an experiment that both of two result folders have."""
    names = [name for name in (EXPERIMENT, DYNAMIC) if all((path / name).exists() for path in paths)]
    return {name: (_table(paths[0] / name), _table(paths[1] / name)) for name in names}


def _tolerances(rtol: float | Mapping[str, float], columns: Sequence[str], named: bool) -> dict[str, float]:
    """The tolerance of every column to compare."""
    if not isinstance(rtol, Mapping):
        return dict.fromkeys(columns, rtol)
    others = [name for name in rtol if name and name not in columns]
    if named and others:
        raise UsageError(f"--rtol names {others[0]}, which is not among the --columns {', '.join(columns)}")
    return {name: rtol.get(name, rtol.get("", RTOL)) for name in (*columns, *others)}


def _refuse_missing(name: str, tables: Mapping[str, Table]) -> None:
    for path, table in tables.items():
        if name not in table:
            raise UsageError(f"{path} has no column '{name}'; it has {', '.join(table)}")


Matched = tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[int, float]]]


def _matched(first: np.ndarray, second: np.ndarray) -> Matched:
    """Values in both columns and their places there, and what is in one alone: (0 or 1, value).

    A value that comes several times is matched in its order. Values are the same to 10 digits.
    """
    numbered = [_numbered(column) for column in (first, second)]
    common = [name for name in numbered[0] if name in numbered[1]]
    of_A, of_B = ([places[name] for name in common] for places in numbered)
    alone = [(where, float((first, second)[where][i])) for where in (0, 1)
             for name, i in numbered[where].items() if name not in numbered[1 - where]]  # fmt: skip
    return first[of_A], np.array(of_A, dtype=int), np.array(of_B, dtype=int), alone


def _numbered(column: np.ndarray) -> dict[tuple[str, int], int]:
    """The place of the k-th occurrence of every value."""
    seen: Counter[str] = Counter()
    places = {}
    for i, value in enumerate(column):
        name = f"{value:.9e}"
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
