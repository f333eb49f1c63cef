"""Table of a study without result folders: study.csv and curves, merged from all shards.

The rows are read and written one after another, so that a table of a million rows needs no more
memory than a small one.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.quantities import QUANTITY_PATTERN
from indent_sim.config.scene_file import quantities_of
from indent_sim.config.strict_yaml import key_path
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.atomic_files import write_atomically
from indent_sim.studies import study_folder, study_table
from indent_sim.studies.curve_file import CurveWriter
from indent_sim.studies.row_file import CURVE_COLUMNS, ROWS_FOLDER, RowIndex, RunRow
from indent_sim.studies.settings_checksum import SettingsChecksum
from indent_sim.studies.study_file import RunRequest, StudyFile
from indent_sim.studies.study_table import Row


@dataclass
class RowCounts:
    """Numbers of rows of a study by their status, and of omitted curve rows and points."""

    done: int = 0
    failed: int = 0
    pending: int = 0
    curve_rows: int = 0
    left_out: int = 0
    first_reason: str = ""

    @property
    def total(self) -> int:
        """Number of rows of the table."""
        return self.done + self.failed + self.pending

    def add(self, row: Row, curve_rows: int) -> None:
        """Count a row."""
        self.curve_rows += curve_rows
        if row["status"] == "done":
            self.done += 1
        elif row["status"] == "pending":
            self.pending += 1
        else:
            self.failed += 1
            self.first_reason = self.first_reason or row["reason"]

    def as_json(self) -> dict[str, int]:
        """Return the numbers for study.json."""
        names = ("total", "done", "failed", "pending", "left_out")
        return {name: getattr(self, name) for name in names}


class RowTable:
    """Table of a study, merged from the row files in its folder.

    Parameters
    ----------
    study, directory
        The study and its folder.
    """

    def __init__(self, study: StudyFile, directory: Path):
        self._study = study
        self._directory = directory
        self._index = RowIndex(directory / ROWS_FOLDER)
        self._checksum = SettingsChecksum(study)

    def rows(self) -> Iterator[tuple[Row, np.ndarray]]:
        """Yield every row of study.csv with its curve, in the order of the study."""
        empty = np.empty((0, len(CURVE_COLUMNS)))
        for index, request in enumerate(self._study.iterate_requests()):
            found = self._find(request)
            row: Row = {"index": index + 1, "run": None} | self._values(request)
            row |= dict.fromkeys(study_table.STUDY_COLUMNS) | {"status": "pending"}
            if found is not None:
                row |= found.cells
            yield row, empty if found is None else found.curve

    def _find(self, request: RunRequest) -> RunRow | None:
        """Return the row of a request; None if the row has not been computed or is damaged."""
        try:
            return self._index.find(self._checksum(request))
        except UsageError:
            return None

    def _values(self, request: RunRequest) -> Row:
        """Return the varied keys of a request, with quantities as numbers in the scene's units."""
        values: dict[str, Any] = dict.fromkeys(self._study.keys)
        values |= {key: value for key, value, _ in request.point}
        has_quantity = any(
            isinstance(value, str) and QUANTITY_PATTERN.fullmatch(value)
            for value in values.values()
        )
        if not has_quantity:
            return values
        settings = (*self._study.common_settings, *request.point)
        try:
            quantities = quantities_of(request.base, settings)
        except ConfigError:
            return values
        return values | {
            key: quantities[key_path(key)][1] for key in values if key_path(key) in quantities
        }

    def write(self) -> RowCounts:
        """Write study.csv and the curves, and return the numbers of rows."""
        counts = RowCounts()
        curves = CurveWriter(self._directory)
        try:
            table_path = self._directory / study_folder.STUDY_TABLE
            write_atomically(table_path, self._lines(counts, curves))
            curves.finish(self._study.keys, self.rows)
        except BaseException:
            curves.abandon()
            raise
        counts.left_out = self._study.point_count - counts.total
        return counts

    def _lines(self, counts: RowCounts, curves: CurveWriter) -> Iterator[str]:
        """Yield the lines of study.csv, count the rows and write their curves."""
        columns = ("index", "run", *self._study.keys, *study_table.STUDY_COLUMNS)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        for row, curve in self.rows():
            counts.add(row, len(curve))
            curves.append(row["index"], curve)
            writer.writerow([study_table.cell_text(row[name]) for name in columns])
            # Number of characters that are collected before they are written.
            block_size = 1 << 16
            if text.tell() > block_size:
                yield text.getvalue()
                text.seek(0)
                text.truncate()
        yield text.getvalue()
