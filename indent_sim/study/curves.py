"""curves.csv: the curves of a study in long form, and the families of them that a picture shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.quantities import QUANTITY
from indent_sim.process.errors import UsageError
from indent_sim.results.reader import Results, read_run
from indent_sim.study import table
from indent_sim.study.cases import Case, short

COLUMNS = ("step", "delta", "force", "a", "force_error")

Row = dict[str, Any]


@dataclass(frozen=True)
class Curve:
    """The curve of a run and the values of the varied keys that made it."""

    values: Mapping[str, Any]
    results: Results

    def name(self, keys: Sequence[str]) -> str:
        """These of the varied keys in words."""
        given = [key for key in keys if self.values.get(key) is not None]
        return ", ".join(f"{key.split('.')[-1]} {_in_words(self.values[key])}" for key in given)


@dataclass(frozen=True)
class Families:
    """The curves of a study and the varied keys that tell them apart, those that decide others first."""

    curves: tuple[Curve, ...]
    keys: tuple[str, ...]

    def apart(self) -> list[str]:
        """The name of each curve."""
        return [curve.name(self.keys) for curve in self.curves]

    def numeric(self) -> tuple[str, ...]:
        """The keys whose values are numbers, or quantities in one unit."""
        return tuple(key for key in self.keys if len(units := self._units(key)) == 1 and None not in units)

    def numbers(self, key: str) -> list[float]:
        """The values of a numeric key."""
        return [amount(curve.values[key])[0] for curve in self.curves]

    def unit(self, key: str) -> str:
        """The unit of a numeric key's values; "" of plain numbers."""
        return self._units(key).pop() or ""

    def _units(self, key: str) -> set[str | None]:
        return {amount(curve.values.get(key))[1] for curve in self.curves}


def amount(value: Any) -> tuple[float, str | None]:
    """A value as a number and its unit, "" of a plain number; the unit of a word, nan, is None."""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return float(value), ""
    match = QUANTITY.fullmatch(value) if isinstance(value, str) else None
    return (float(match["number"]), match["unit"].strip()) if match else (math.nan, None)


def _in_words(value: Any) -> str:
    return value if isinstance(value, str) else short(value)


def rows(cases: Sequence[Case], keys: Sequence[str], done: Mapping[str, Results]) -> list[Row]:
    """One row per run and step: run, every varied key, then `COLUMNS`; what is unknown is None."""
    found: list[Row] = []
    for case in cases:
        results = done.get(case.id)
        head = {"run": results.path.name} | {key: case.values.get(key) for key in keys} if results else {}
        for i in range(len(results) if results else 0):
            assert results is not None
            values = {name: _known(results.table, name, i) for name in COLUMNS}
            found.append(head | values | {"step": int(results["step"][i])})
    return found


def _known(columns: Mapping[str, np.ndarray], name: str, i: int) -> float | None:
    value = float(columns[name][i]) if name in columns else math.nan
    return value if math.isfinite(value) else None


def write(curves: Sequence[Row]) -> str:
    """The rows as CSV text, numbers to the last digit."""
    return table.write(curves) if curves else ",".join(["run", *COLUMNS]) + "\n"


def families(cases: Sequence[Case], keys: Sequence[str], done: Mapping[str, Results]) -> Families:
    """The curves of all runs that came to their end."""
    found = [Curve({key: case.values.get(key) for key in keys}, done[case.id]) for case in cases
             if case.id in done and done[case.id].report.get("status") == "done"]  # fmt: skip
    return _family(found, keys)


def of_runs(folder: Path, runs: Sequence[Row], keys: Sequence[str]) -> Families:
    """The same of the rows of a study's table, from those of its runs that are still in their folder."""
    named = {row["run"]: row for row in runs if row["status"] == "done" and row["run"]}
    found = []
    for name, row in named.items():
        with suppress(UsageError):
            found.append(Curve({key: row[key] for key in keys}, read_run(folder / str(name))))
    return _family([curve for curve in found if len(curve.results)], keys)


def _family(found: Sequence[Curve], keys: Sequence[str]) -> Families:
    return Families(tuple(found), tuple(table.telling([curve.values for curve in found], keys)))
