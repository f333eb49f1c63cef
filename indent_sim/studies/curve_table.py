"""curves.csv: the curves of a study in long form, and the families of them that a picture shows."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.config.quantities import QUANTITY_PATTERN
from indent_sim.config.strict_yaml import parse, short
from indent_sim.process.errors import IndentSimError, UsageError
from indent_sim.results.reader import Results, read_run
from indent_sim.studies import study_table
from indent_sim.studies.cases import Case
from indent_sim.studies.points import STIFFNESS_UNIT, Multiple
from indent_sim.studies.study_table import Row

CURVE_COLUMNS = ("step", "delta", "force", "a", "force_error")


@dataclass(frozen=True)
class Curve:
    """The curve of a run and the values of the varied keys that made it."""

    values: Row
    results: Results


@dataclass(frozen=True)
class Families:
    """The curves of a study and the varied keys that tell them apart, those that decide others
    first.
    """

    curves: tuple[Curve, ...]
    keys: tuple[str, ...]

    def apart(self) -> list[str]:
        """The name of each curve."""
        return self.names(self.keys)

    def names(self, keys: Sequence[str]) -> list[str]:
        """These of the varied keys in words, curve by curve; of sections what differs between them."""
        alike = {key: _alike([curve.values.get(key) for curve in self.curves]) for key in keys}
        given = [
            [key for key in keys if curve.values.get(key) is not None] for curve in self.curves
        ]
        return [
            ", ".join(_in_words(self.told(key), curve.values[key], alike[key]) for key in known)
            for curve, known in zip(self.curves, given, strict=True)
        ]

    def told(self, key: str) -> str:
        """The last part of a key's name, all of it where another key ends alike: contact.method and
        solver.method.
        """
        last = key.split(".")[-1]
        return last if sum(other.split(".")[-1] == last for other in self.keys) < 2 else key

    def numeric(self) -> tuple[str, ...]:
        """The keys whose values are numbers, or quantities in one unit."""
        return tuple(
            key for key in self.keys if len(units := self._units(key)) == 1 and None not in units
        )

    def numbers(self, key: str) -> list[float]:
        """The values of a numeric key."""
        return [amount(curve.values[key])[0] for curve in self.curves]

    def unit(self, key: str) -> str:
        """The unit of a numeric key's values; "" of plain numbers."""
        return self._units(key).pop() or ""

    def _units(self, key: str) -> set[str | None]:
        return {amount(curve.values.get(key))[1] for curve in self.curves}


def told_apart(values: Sequence[object]) -> list[str]:
    """Values of a varied key in words; of sections what differs between them."""
    alike = _alike(values)
    return [_in_words("", value, alike).strip() for value in values]


def _in_words(name: str, value: object, alike: Collection[str]) -> str:
    """The value of a varied key behind its name; of a section the entries that are not alike, of
    equal ones all.
    """
    section = _section(value)
    if section is None:
        return f"{name} {value if isinstance(value, str) else short(value)}"
    own = {entry: one for entry, one in section.items() if entry not in alike} or section
    return ", ".join(
        f"{entry} {one if isinstance(one, str) else short(one)}" for entry, one in own.items()
    )


def _alike(values: Sequence[object]) -> list[str]:
    """The entries that all of some sections have in common; none of values that are no sections."""
    sections = [_section(value) for value in values if value is not None]
    if not sections or None in sections:
        return []
    first, *others = [section for section in sections if section is not None]
    return [
        name
        for name in first
        if all(name in other and other[name] == first[name] for other in others)
    ]


def _section(value: object) -> Mapping[str, object] | None:
    """A value that is a section, also read back as text; None of any other."""
    if isinstance(value, str) and value.startswith("{"):
        with suppress(IndentSimError):
            value = parse(value)[0]
    return value if isinstance(value, Mapping) else None


def amount(value: object) -> tuple[float, str | None]:
    """A value as a number and its unit, "" of a plain number; the unit of a word, nan, is None."""
    if isinstance(value, Multiple):
        return value.factor, STIFFNESS_UNIT
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return float(value), ""
    match = QUANTITY_PATTERN.fullmatch(value) if isinstance(value, str) else None
    return (float(match["number"]), match["unit"].strip()) if match else (math.nan, None)


def rows(cases: Sequence[Case], keys: Sequence[str], done: Mapping[str, Results]) -> list[Row]:
    """One row per run and step: run, every varied key, then `CURVE_COLUMNS`; what is unknown is
    None.
    """
    found: list[Row] = []
    for case, results in ((case, done[case.id]) for case in cases if case.id in done):
        head = {"run": results.path.name} | {key: case.numbers.get(key) for key in keys}
        columns = {
            name: results.table.get(name, np.full(len(results), math.nan)) for name in CURVE_COLUMNS
        }
        for i in range(len(results)):
            values = {name: float(column[i]) for name, column in columns.items()}
            known = {
                name: value if math.isfinite(value) else None for name, value in values.items()
            }
            found.append(head | known | {"step": int(results["step"][i])})
    return found


def write(curves: Sequence[Row]) -> str:
    """The rows as CSV text, numbers to the last digit."""
    return study_table.write(curves) if curves else ",".join(["run", *CURVE_COLUMNS]) + "\n"


def families(cases: Sequence[Case], keys: Sequence[str], done: Mapping[str, Results]) -> Families:
    """The curves of all runs that came to their end."""
    ended = [
        case for case in cases if case.id in done and done[case.id].report.get("status") == "done"
    ]
    return _family(
        [Curve({key: case.values.get(key) for key in keys}, done[case.id]) for case in ended], keys
    )


def of_runs(folder: Path, runs: Sequence[Row], keys: Sequence[str]) -> Families:
    """The same of the rows of a study's table, from those of its runs that are still in their
    folder.
    """
    named = {row["run"]: row for row in runs if row["status"] == "done" and row["run"]}
    found = []
    for name, row in named.items():
        with suppress(UsageError):
            found.append(Curve({key: row[key] for key in keys}, read_run(folder / str(name))))
    return _family([curve for curve in found if len(curve.results)], keys)


def _family(found: Sequence[Curve], keys: Sequence[str]) -> Families:
    rows = [curve.values for curve in found]
    told = study_table.telling(rows, keys)
    words = [
        key
        for key in keys
        if any(row.get(key) is not None and amount(row[key])[1] is None for row in rows)
    ]

    def has_words_alone(key: str) -> bool:
        """Whether a run would have no word without it: a section that others lack."""
        others = [other for other in told if other in words]
        return any(
            row.get(key) is not None and all(row.get(other) is None for other in others)
            for row in rows
        )

    return Families(
        tuple(found), (*told, *(key for key in words if key not in told and has_words_alone(key)))
    )
