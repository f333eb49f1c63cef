"""Rows of two results side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import UsageError, VerificationError
from indent_sim.results.folder import TABLE
from indent_sim.results.reader import COMPARED, read, read_table

SHOWN = 10  # differences told one by one
RTOL = 1e-6


@dataclass(frozen=True)
class Comparison:
    """Two force tables side by side: one (a, b) pair per row and column, rows matched by step, or else by depth.

    rows: what is said of each, step 3 or delta 0.1; rtol of every column; worst: its largest relative difference;
    differences: what differs, in words; empty when equal.
    """

    steps: tuple[float, ...]
    matched_by: str
    pairs: dict[str, np.ndarray]
    rtol: dict[str, float]
    worst: dict[str, float]
    differences: tuple[str, ...]

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
                "differences": self.differences}  # fmt: skip


def compare(
    first: Path | str,
    second: Path | str,
    rtol: float | Mapping[str, float] = RTOL,
    columns: Sequence[str] | None = None,
) -> Comparison:
    """Compare columns [delta, force, a and those that rtol names] of two results row by row.

    Two numbers agree when |x - y| <= rtol max(|x|, |y|, 1e-6 largest of the column): a force of 1e-18 out of
    contact is a zero. An empty cell agrees with an empty cell alone. Where rtol says nothing of a column it is 1e-6.
    Rows belong together by step; where a file has no steps by depth, the k-th of a depth with the k-th. UsageError for
    a column that is in neither file, or in one alone.
    """
    A, B = _table(first), _table(second)
    key = "step" if "step" in A and "step" in B else "delta"
    usual = [name for name in COMPARED if name in A and name in B]
    tolerances = _tolerances(rtol, columns or usual, named=bool(columns))
    _refuse_missing(tolerances, {str(first): A, str(second): B})
    keys, of_A, of_B, alone = _matched(A[key], B[key])
    differences = [f"{key} {value:.10g} is in {(first, second)[where]} alone" for where, value in alone]
    if not len(keys):
        differences.append(f"the two have no {key} in common")
    pairs = {name: np.column_stack([A[name][of_A], B[name][of_B]]) for name in tolerances}
    worst = {}
    for name, pair in pairs.items():
        relative = _relative_difference(pair)
        worst[name] = float(relative.max(initial=0.0))
        differences += [
            f"{key} {keys[i]:.10g}: {name} {pair[i, 0]:.10g} and {pair[i, 1]:.10g} differ by {relative[i]:.2g}"
            for i in np.flatnonzero(~(relative <= tolerances[name]))
        ]
    return Comparison(tuple(keys), key, pairs, tolerances, worst, tuple(differences))


def _table(path: Path | str) -> dict[str, np.ndarray]:
    """The columns of a result folder's or any other force table, with or without steps."""
    path = Path(path)
    columns = read_table(path / TABLE if path.is_dir() else path, ("delta", "force"))
    return read(path).table if "step" in columns else columns


def _tolerances(rtol: float | Mapping[str, float], columns: Sequence[str], named: bool) -> dict[str, float]:
    """The tolerance of every column to compare."""
    if not isinstance(rtol, Mapping):
        return dict.fromkeys(columns, rtol)
    others = [name for name in rtol if name and name not in columns]
    if named and others:
        raise UsageError(f"--rtol names {others[0]}, which is not among the --columns {', '.join(columns)}")
    return {name: rtol.get(name, rtol.get("", RTOL)) for name in (*columns, *others)}


def _refuse_missing(columns: Iterable[str], tables: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    for name in columns:
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
