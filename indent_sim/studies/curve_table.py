"""Curves of a study: the table curves.csv, and groups of curves for pictures."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.config.quantities import QUANTITY_PATTERN
from indent_sim.config.strict_yaml import parse, short_yaml
from indent_sim.process.errors import IndentSimError, UsageError
from indent_sim.results.reader import Results, read_run
from indent_sim.studies import study_table
from indent_sim.studies.cases import Case
from indent_sim.studies.parameter_values import STIFFNESS_UNIT, StiffnessMultiple
from indent_sim.studies.study_table import Row

CURVE_COLUMNS = ("step", "delta", "force", "a", "force_error")


@dataclass(frozen=True)
class RunCurve:
    """Curve of a run with the values of its varied keys."""

    values: Row
    results: Results


@dataclass(frozen=True)
class CurveGroups:
    """Curves of a study and the varied keys that distinguish them."""

    curves: tuple[RunCurve, ...]
    keys: tuple[str, ...]

    def curve_names(self) -> list[str]:
        """Return the name of each curve."""
        return self.value_names(self.keys)

    def value_names(self, keys: Sequence[str]) -> list[str]:
        """Return the values of some keys as text for each curve.

        Of a value that is a section only the entries that differ are given.
        """
        common_entries = {
            key: _common_entries([curve.values.get(key) for curve in self.curves]) for key in keys
        }
        given_keys = [
            [key for key in keys if curve.values.get(key) is not None] for curve in self.curves
        ]
        return [
            ", ".join(
                _value_label(self.short_key(key), curve.values[key], common_entries[key])
                for key in keys_of_curve
            )
            for curve, keys_of_curve in zip(self.curves, given_keys, strict=True)
        ]

    def short_key(self, key: str) -> str:
        """Return the last part of a key, or the whole key if the last part is ambiguous.

        The last part is ambiguous, for example, for contact.method and solver.method.
        """
        last_part = key.split(".")[-1]
        is_unique = sum(other_key.split(".")[-1] == last_part for other_key in self.keys) < 2
        return last_part if is_unique else key

    def numeric_keys(self) -> tuple[str, ...]:
        """Return the keys whose values are numbers, or quantities in one unit."""
        return tuple(
            key
            for key in self.keys
            if len(units := self._key_units(key)) == 1 and None not in units
        )

    def key_numbers(self, key: str) -> list[float]:
        """Return the value of a numeric key for each curve."""
        return [number_and_unit(curve.values[key])[0] for curve in self.curves]

    def key_unit(self, key: str) -> str:
        """Return the unit of a numeric key; "" for numbers without a unit."""
        return self._key_units(key).pop() or ""

    def _key_units(self, key: str) -> set[str | None]:
        return {number_and_unit(curve.values.get(key))[1] for curve in self.curves}


def distinguishing_labels(values: Sequence[object]) -> list[str]:
    """Return the values of a varied key as text; for sections only the entries that differ."""
    shared_entries = _common_entries(values)
    return [_value_label("", value, shared_entries).strip() for value in values]


def _value_label(name: str, value: object, common_entries: Collection[str]) -> str:
    """Return a key and its value as text; for a section, the common entries are omitted."""
    section = _parse_section(value)
    if section is None:
        return f"{name} {value if isinstance(value, str) else short_yaml(value)}"
    distinct_entries = {
        entry: entry_value for entry, entry_value in section.items() if entry not in common_entries
    } or section
    return ", ".join(
        f"{entry} {entry_value if isinstance(entry_value, str) else short_yaml(entry_value)}"
        for entry, entry_value in distinct_entries.items()
    )


def _common_entries(values: Sequence[object]) -> list[str]:
    """Return the common entries of sections; [] if one value is not a section."""
    sections = [_parse_section(value) for value in values if value is not None]
    if not sections or None in sections:
        return []
    first_section, *other_sections = [section for section in sections if section is not None]
    return [
        name
        for name in first_section
        if all(
            name in second_section and second_section[name] == first_section[name]
            for second_section in other_sections
        )
    ]


def _parse_section(value: object) -> Mapping[str, object] | None:
    """Return a value that is a section or the YAML text of a section; None for any other value."""
    if isinstance(value, str) and value.startswith("{"):
        with suppress(IndentSimError):
            value = parse(value)[0]
    return value if isinstance(value, Mapping) else None


def number_and_unit(value: object) -> tuple[float, str | None]:
    """Return a value as a number and its unit ("" without a unit); (nan, None) for other text."""
    if isinstance(value, StiffnessMultiple):
        return value.factor, STIFFNESS_UNIT
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return float(value), ""
    match = QUANTITY_PATTERN.fullmatch(value) if isinstance(value, str) else None
    return (float(match["number"]), match["unit"].strip()) if match else (math.nan, None)


def rows(
    cases: Sequence[Case], keys: Sequence[str], results_by_id: Mapping[str, Results]
) -> list[Row]:
    """Return the rows of curves.csv: run, varied keys and `CURVE_COLUMNS`; None if unknown."""
    table_rows: list[Row] = []
    for case, results in (
        (case, results_by_id[case.id]) for case in cases if case.id in results_by_id
    ):
        first_cells = {"run": results.path.name} | {key: case.table_values.get(key) for key in keys}
        columns = {
            name: results.table.get(name, np.full(len(results), math.nan)) for name in CURVE_COLUMNS
        }
        for i in range(len(results)):
            values = {name: float(column[i]) for name, column in columns.items()}
            finite_values = {
                name: value if math.isfinite(value) else None for name, value in values.items()
            }
            table_rows.append(first_cells | finite_values | {"step": int(results["step"][i])})
    return table_rows


def write(curves: Sequence[Row]) -> str:
    """Return the rows as CSV text, with all digits of their numbers."""
    return study_table.write(curves) if curves else ",".join(["run", *CURVE_COLUMNS]) + "\n"


def group_case_curves(
    cases: Sequence[Case], keys: Sequence[str], results_by_id: Mapping[str, Results]
) -> CurveGroups:
    """Return the curves of all runs that have succeeded."""
    ended_cases = [
        case
        for case in cases
        if case.id in results_by_id and results_by_id[case.id].report.get("status") == "done"
    ]
    return _make_groups(
        [
            RunCurve({key: case.values.get(key) for key in keys}, results_by_id[case.id])
            for case in ended_cases
        ],
        keys,
    )


def group_folder_curves(folder: Path, runs: Sequence[Row], keys: Sequence[str]) -> CurveGroups:
    """Return the curves of a study's folder, without runs that have been deleted."""
    rows_by_run = {row["run"]: row for row in runs if row["status"] == "done" and row["run"]}
    curves = []
    for name, row in rows_by_run.items():
        with suppress(UsageError):
            curves.append(RunCurve({key: row[key] for key in keys}, read_run(folder / str(name))))
    return _make_groups([curve for curve in curves if len(curve.results)], keys)


def _make_groups(curves: Sequence[RunCurve], keys: Sequence[str]) -> CurveGroups:
    value_rows = [curve.values for curve in curves]
    independent = study_table.independent_keys(value_rows, keys)
    word_keys = [
        key
        for key in keys
        if any(
            row.get(key) is not None and number_and_unit(row[key])[1] is None for row in value_rows
        )
    ]

    def is_only_word(key: str) -> bool:
        """Return True if some run has no other key with a text value."""
        other_word_keys = [other_key for other_key in independent if other_key in word_keys]
        return any(
            row.get(key) is not None
            and all(row.get(other_key) is None for other_key in other_word_keys)
            for row in value_rows
        )

    return CurveGroups(
        tuple(curves),
        (
            *independent,
            *(key for key in word_keys if key not in independent and is_only_word(key)),
        ),
    )
