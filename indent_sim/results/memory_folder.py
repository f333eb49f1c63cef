"""Rows of a run in memory, with the methods of a result folder but without files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from indent_sim.model.state import State
from indent_sim.process.version import VERSION
from indent_sim.results import tables
from indent_sim.results.checkpoint import Checkpoint
from indent_sim.results.reader import Results
from indent_sim.results.result_files import PROGRAM, Report
from indent_sim.results.tables import WORD_COLUMNS
from indent_sim.results.writer import final_status


class MemoryFolder:
    """Rows and report of one run that writes no files; has the methods of `ResultFolder`.

    Parameters
    ----------
    target
        Path of the results; nothing is written there.
    config_yaml
        The resolved scene; not kept.
    report
        Entries of run.json. The attribute `report` can be changed until the end of the run.
    columns
        Columns of the force table that not every scene has.
    **file_options
        Options of files, which have no effect.
    """

    def __init__(
        self,
        target: Path,
        config_yaml: str,
        *,
        report: Report,
        columns: tuple[str, ...] = (),
        **file_options: Any,
    ):
        self.report = dict(report)
        self.states: list[State] = []
        self.previous_run = None
        self._target = target
        self._columns = tables.force_columns(columns)
        self._status: Report = {"status": "running", "exit_code": None, "reason": ""}

    @classmethod
    def failed(cls, target: Path, error: BaseException) -> Results:
        """Return the results of a run that failed before it had a folder."""
        folder = cls(target, "", report={})
        folder.finish(error)
        return folder.results()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.finish(error)

    def append(self, state: State) -> None:
        """Keep a converged state."""
        self.states.append(state)

    def open_fields(self, *mesh: Any, **options: Any) -> None:
        """Write no fields."""

    def write_fields(self, *arguments: Any) -> None:
        """Write no fields."""

    def write_experiment(self, rows: Sequence[Any], dynamic: Sequence[Any]) -> None:
        """Write no tables of an experiment."""

    def save_checkpoint(self, saved: Checkpoint, identity: Report) -> None:
        """Save nothing: a run in memory is repeated as a whole."""

    def read_checkpoint(self, identity: Report) -> Checkpoint:
        """Return an empty checkpoint."""
        return Checkpoint()

    def finish(self, error: BaseException | None) -> None:
        """Record how the run ended; further calls have no effect."""
        if self._status["status"] == "running":
            words = ("status", "exit_code", "reason")
            self._status = dict(zip(words, final_status(error), strict=True))

    def results(self) -> Results:
        """Return the rows by column, and the report."""
        identity = {"program": PROGRAM, "version": VERSION, **self._status}
        report = {**identity, "rows": len(self.states), **self.report}
        table = {name: self._column(name) for name in self._columns}
        return Results(self._target, table, report)

    def _column(self, name: str) -> np.ndarray:
        """Return a column of the force table; NaN in rows without a value."""
        values = [state.column(name) for state in self.states]
        if name in WORD_COLUMNS:
            return np.array(values, dtype=object)
        return np.array([np.nan if value is None else value for value in values], dtype=float)
