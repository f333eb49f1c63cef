"""Sample of the many runs of a study without result folders, for pictures and the report."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.result_files import STUDY, Report, read_report
from indent_sim.studies import study_folder
from indent_sim.studies.curve_file import read_curves

# Largest number of runs that are drawn, and of keys in a picture.
MAX_RUNS = 3000
MAX_KEYS = 5


@dataclass(frozen=True)
class ManyRuns:
    """Many runs of a study: a sample of them, small enough to be drawn.

    Attributes
    ----------
    title, units
        Title of the study, and its units of length and force.
    keys
        Values of the varied numbers; each (runs,).
    column, values
        Name and values of a result; (runs,).
    curves
        Depth and force of every run; each (rows, 2).
    count
        Number of all runs of the study.
    rows
        Some rows of study.csv, of any status, as texts.
    statuses
        Numbers of rows by their status.
    warnings
        Some of the warnings of the runs.
    """

    title: str
    units: Mapping[str, str]
    keys: Mapping[str, np.ndarray]
    column: str
    values: np.ndarray
    curves: Sequence[np.ndarray]
    count: int
    rows: Sequence[Mapping[str, str]] = ()
    statuses: Mapping[str, int] = field(default_factory=dict)
    warnings: Sequence[str] = ()

    @property
    def varying_keys(self) -> list[str]:
        """Varied keys in the order of their rank correlation with the result, the largest first."""
        varying = [key for key, values in self.keys.items() if np.ptp(values) > 0]
        return sorted(varying, key=self._rank_correlation, reverse=True)[:MAX_KEYS]

    def _rank_correlation(self, key: str) -> float:
        """Return the absolute value of the rank correlation of the result with a key."""
        first, second = (np.argsort(np.argsort(values)) for values in (self.keys[key], self.values))
        return abs(float(np.corrcoef(first, second)[0, 1]))

    def label(self, key: str) -> str:
        """Return a key for an axis: its last part, or the whole key if that is ambiguous."""
        last_part = key.split(".")[-1]
        is_unique = sum(other.split(".")[-1] == last_part for other in self.keys) < 2
        return last_part if is_unique else key

    @property
    def result_label(self) -> str:
        """Label of the result."""
        unit = self.units.get(self.column, "")
        return f"{self.column} ({unit})" if unit else self.column


def is_row_study(folder: Path) -> bool:
    """Return whether the runs of a study are rows without folders."""
    return "counts" in read_report(folder, STUDY)


def read_many_runs(folder: Path, column: str = "force") -> ManyRuns:
    """Read a sample of the runs of a study, evenly spaced in its table.

    Raises
    ------
    UsageError
        The folder has no readable table of rows.
    """
    record = read_report(folder, STUDY)
    path = folder / study_folder.STUDY_TABLE
    try:
        return _read_table(folder, record, column)
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise UsageError(f"{path} is not a readable table: {error}", file=str(path)) from None


def _read_table(folder: Path, record: Report, column: str) -> ManyRuns:
    """Read a sample of the rows of study.csv and their curves."""
    total = int(record["counts"]["total"])
    stride = max(1, -(-total // MAX_RUNS))
    statuses: Counter[str] = Counter()
    warnings: dict[str, None] = {}
    rows = []
    # Largest number of different warnings that a report shows.
    max_warnings = 50
    with open(folder / study_folder.STUDY_TABLE, encoding="utf-8", newline="") as stream:
        lines = csv.reader(stream)
        names = next(lines)
        status = names.index("status")
        warning = names.index("warnings")
        for number, cells in enumerate(lines):
            statuses[cells[status]] += 1
            if cells[warning] and len(warnings) < max_warnings:
                warnings |= dict.fromkeys(cells[warning].split(" | "))
            if number % stride == 0:
                rows.append(dict(zip(names, cells, strict=True)))
    done = [row for row in rows if row["status"] == "done" and row[column]]
    if not done:
        raise ValueError(f"no run has a value of {column}")
    keys: dict[str, np.ndarray] = {}
    for key in record["keys"]:
        with suppress(ValueError):
            keys[key] = np.array([float(row[key]) for row in done])
    curves = read_curves(folder, {int(row["index"]): row["run"] for row in done})
    return ManyRuns(
        str(record.get("title") or folder.resolve().name),
        record.get("units") or {},
        keys,
        column,
        np.array([float(row[column]) for row in done]),
        curves,
        statuses["done"],
        rows,
        statuses,
        tuple(warnings),
    )
