"""Worker that computes rows of a study: many runs without result folders, one after another."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from indent_sim.process.errors import ConfigError
from indent_sim.results.reader import Results
from indent_sim.run import pipeline
from indent_sim.studies import study_table
from indent_sim.studies.cases import Case, CaseBuilder, RejectedCase
from indent_sim.studies.parameter_values import ParameterPoint
from indent_sim.studies.row_file import CURVE_COLUMNS, NUMBERS, TEXTS, RunRow
from indent_sim.studies.study_file import RunRequest
from indent_sim.studies.worker import Job, run_job


@dataclass(frozen=True)
class RequestedRow:
    """Requested row: its index in the study, the checksum of its settings, and its scene."""

    index: int
    settings: int
    request: RunRequest


@dataclass(frozen=True)
class RowBatch:
    """Rows that a process computes one after another.

    Attributes
    ----------
    common_settings
        Settings of every run.
    rows
        The requested rows.
    known_physics
        Physics of rows that need not be computed again, sorted.
    runs_folder
        Folder for the result folders of failed runs; None if failed runs get none.
    """

    common_settings: ParameterPoint
    rows: Sequence[RequestedRow]
    known_physics: np.ndarray
    runs_folder: Path | None = None


@dataclass(frozen=True)
class FinishedBatch:
    """Results of a batch: computed rows, and settings with the physics of a known row.

    Attributes
    ----------
    rows
        The computed rows.
    known
        Settings and physics of the rows that were not computed.
    has_meshes
        True if a scene was meshed; the libraries then keep some memory.
    folder_count
        Number of result folders that were written.
    """

    rows: Sequence[RunRow]
    known: Sequence[tuple[int, int]]
    has_meshes: bool
    folder_count: int


def compute_batch(batch: RowBatch) -> FinishedBatch:
    """Compute the rows of a batch; a failed run is a row."""
    build_case = CaseBuilder(batch.common_settings)
    rows: list[RunRow] = []
    known: list[tuple[int, int]] = []
    folder_count = 0
    has_meshes = False
    for requested in batch.rows:
        start = (time.process_time(), time.perf_counter())
        try:
            case = build_case(requested.index, requested.request)
        except ConfigError as error:
            rows.append(_rejected_row(requested, error))
            continue
        physics = physics_number(case)
        if _contains(batch.known_physics, physics):
            known.append((requested.settings, physics))
            continue
        has_meshes = has_meshes or case.planned_run.scene.is_meshed
        rows.append(_compute_row(requested.settings, case, start))
        if batch.runs_folder is not None and rows[-1].cells["exit_code"]:
            directory = batch.runs_folder / case.name
            run_job(Job(case.planned_run.config, False, directory, resume=False))
            folder_count += 1
    return FinishedBatch(rows, known, has_meshes, folder_count)


def physics_number(case: Case) -> int:
    """Return the id of a case as a number."""
    return int(case.id, 16)


def failed_row(requested: RequestedRow, exit_code: int, reason: str) -> RunRow:
    """Return the row of a run whose process crashed."""
    cells = {"status": "failed", "exit_code": exit_code, "reason": reason}
    return RunRow(requested.settings, 0, cells, np.empty((0, len(CURVE_COLUMNS))))


def _contains(sorted_numbers: np.ndarray, number: int) -> bool:
    """Return whether a sorted array contains a number."""
    place = int(np.searchsorted(sorted_numbers, np.uint64(number)))
    return place < len(sorted_numbers) and int(sorted_numbers[place]) == number


def _rejected_row(requested: RequestedRow, error: ConfigError) -> RunRow:
    """Return the row of an invalid scene."""
    rejected_case = RejectedCase(requested.index, requested.request.point, None, error)
    cells = study_table.rejected_row(rejected_case, ())
    return failed_row(requested, cells["exit_code"], cells["reason"])


def _compute_row(settings: int, case: Case, start: tuple[float, float]) -> RunRow:
    """Simulate a case in memory and return its row.

    `start` is the CPU time and the time at which its scene began to be resolved [s].
    """
    resolve_seconds = (time.process_time() - start[0], time.perf_counter() - start[1])
    if case.planned_run.scene.is_meshed:
        # The time of a run does not include that of loading the libraries.
        pipeline.warm_up()
    config = case.planned_run.config
    no_files = replace(config.output, fields="none", surface="none", plot=False)
    config = config.model_copy(update={"output": no_files})
    results = pipeline.simulate_in_memory(config, case.planned_run.scene, case.name)
    for name, seconds in zip(("cpu_timings", "timings"), resolve_seconds, strict=True):
        timings = results.report.setdefault(name, {})
        timings["resolve"] = round(timings.get("resolve", 0.0) + seconds, 4)
    cells = study_table.case_row(case, (), results, None, None)
    kept_cells = {name: cells.get(name) for name in (*NUMBERS, *TEXTS, "exit_code")}
    kept_cells["run"] = case.name
    return RunRow(settings, physics_number(case), kept_cells, _curve(results))


def _curve(results: Results) -> np.ndarray:
    """Return the curve of a run; NaN where a column is unknown."""
    unknown = np.full(len(results), np.nan)
    columns = [results.table.get(name, unknown) for name in CURVE_COLUMNS]
    return np.column_stack(columns).astype(float)
