"""Finished study: its folder, its table and the recommended settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.process.repr_tables import ReprTable
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.reader import data_frame
from indent_sim.results.result_files import STUDY, Report, read_report
from indent_sim.studies import study_folder, study_table
from indent_sim.studies.reference import scoreboard
from indent_sim.studies.study_table import Row

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False)
class Study:
    """Finished study: its folder, its table and the recommended settings.

    Attributes
    ----------
    directory, title
        Folder and title of the study.
    keys
        The varied keys.
    compared_with
        Name of the reference solution with which the forces are compared.
    rows
        The rows of the table; empty for a shard, which only performs its part of the runs.
    notes
        Remarks on the reference solution.
    scoreboard
        One row per case with a published value.
    counts
        Numbers of rows by their status, of a study whose runs are rows without folders.
    """

    directory: Path
    title: str
    keys: tuple[str, ...]
    compared_with: str
    rows: Sequence[Row]
    notes: tuple[str, ...] = ()
    scoreboard: Sequence[Row] = ()
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def recommendations(self) -> list[str]:
        """Recommended runs for errors of 5 %, 1 % and 0.1 % of the force.

        In a study with a tolerance they are the numbers of rows with each verdict.
        """
        if any(self.verdicts.values()):
            return [", ".join(f"{count} {name}" for name, count in self.verdicts.items())]
        return study_table.recommendations(self.rows, self.keys)

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of rows with each verdict (right, flagged, refused, wrong)."""
        return study_table.verdict_counts(self.rows)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table."""
        return tuple(self.rows[0]) if self.rows else ()

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column of the table as numbers (unknown: NaN) or objects."""
        values = [row[column] for row in self.rows]
        is_number = all(isinstance(value, (int, float, type(None))) for value in values)
        return np.array(
            [np.nan if value is None else value for value in values],
            dtype=float if is_number else object,
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return self._repr_table().text

    def _repr_html_(self) -> str:
        return self._repr_table().html

    def _repr_table(self) -> ReprTable:
        """Return the table for a notebook: varied keys and main results."""
        shown_columns = ("status", "force", "a", "p_max", "force_error_vs", "cpu_s", "verdict")
        names = [
            name
            for name in (*self.keys, *shown_columns)
            if any(row.get(name) is not None for row in self.rows)
        ]
        rows = [[row[name] for name in names] for row in self.rows]
        done_count = sum(row["status"] == "done" for row in self.rows)
        return ReprTable(
            f"{self.title}: {done_count} of {len(rows)} runs done",
            names,
            rows,
            "; ".join(self.recommendations),
        )

    def to_pandas(self) -> pandas.DataFrame:
        """Return the table as a DataFrame; raise BackendError without pandas."""
        return data_frame({name: self[name] for name in self.columns})

    @property
    def failures(self) -> list[Row]:
        """Rows of the table whose run has not succeeded."""
        return [row for row in self.rows if row["status"] != "done"]


def read_study(folder: Path) -> Study:
    """Read a finished study from its folder; raise UsageError if there is none."""
    record = read_report(folder, STUDY)
    table = folder / study_folder.STUDY_TABLE
    scoreboard_rows: list[Row] = []
    try:
        rows = study_table.read(read_regular_file(table).decode("utf-8"))
        if (folder / study_folder.SCOREBOARD).exists():
            scoreboard_rows = scoreboard.read(
                read_regular_file(folder / study_folder.SCOREBOARD).decode("utf-8")
            )
        keys = tuple(map(str, record["keys"]))
        required_columns = {"status", "verdict", *keys}
        if not rows or not required_columns <= rows[0].keys():
            raise ValueError(
                "its table has no rows or lacks one of the columns "
                f"{', '.join(sorted(required_columns))}"
            )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{folder} has no readable study: {error}", file=str(folder)) from None
    return Study(
        folder,
        str(record.get("title") or folder.resolve().name),
        keys,
        str(record.get("compare_to")),
        rows,
        scoreboard=scoreboard_rows,
    )


def as_json(study: Study) -> Report:
    """Return a study as an object for JSON."""
    names = (
        "directory",
        "title",
        "compared_with",
        "rows",
        "recommendations",
        "notes",
        "verdicts",
        "scoreboard",
    )
    counts = {"counts": study.counts} if study.counts else {}
    pareto = [row["index"] for row in study_table.pareto_front(study.rows)]
    return {name: getattr(study, name) for name in names} | {"pareto": pareto} | counts
