"""Shard of a study without result folders: missing rows are computed and appended to a file."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from indent_sim.process.child_process import ChildProcess, ProcessCrash, wait_for_answers
from indent_sim.process.errors import ConfigError, ConfigErrors, UsageError
from indent_sim.process.limits import write_error
from indent_sim.process.usage import duration_text
from indent_sim.results.map_arrays import require_hdf5
from indent_sim.results.result_files import RUNS
from indent_sim.studies.cases import CaseBuilder, RejectedCase
from indent_sim.studies.row_file import ROWS_FOLDER, RowIndex, RowWriter, RunRow, row_files
from indent_sim.studies.row_worker import (
    FinishedBatch,
    RequestedRow,
    RowBatch,
    compute_batch,
    failed_row,
)
from indent_sim.studies.settings_checksum import SettingsChecksum
from indent_sim.studies.study_file import StudyFile

ReportLine = Callable[[str], None]
# Number of points that are checked before the first run.
CHECKED_POINTS = 20
# Largest number of rows of a batch, and intended duration of a batch [s].
MAX_BATCH = 64
BATCH_SECONDS = 0.5
# Numbers of rows, by theory and on meshes, after which a process is replaced by a new one. This
# bounds the memory that the libraries do not release.
MAX_ROWS_OF_A_PROCESS = 5000
MAX_MESHED_ROWS_OF_A_PROCESS = 100
# Largest number of failed runs of a shard that get a result folder.
MAX_FAILED_FOLDERS = 100
# Time between lines of progress, and between synchronizations with the disk [s].
PROGRESS_SECONDS = 10.0
SYNC_SECONDS = 1.0


def check_first_points(study: StudyFile) -> float:
    """Return the largest memory [MB] that the first points of a study need, as predicted.

    A study without folders may have a million points: invalid scenes become rows with exit code 3.

    Raises
    ------
    ConfigError
        If none of the first points is a valid scene.
    """
    build_case = CaseBuilder(study.common_settings)
    errors: dict[str, ConfigError] = {}
    memories = []
    for index, request in enumerate(itertools.islice(study.iterate_requests(), CHECKED_POINTS)):
        try:
            plan = build_case(index, request).planned_run.plan
            memories.append(float(plan.prediction.get("memory_MB", 0.0)))
        except ConfigError as error:
            rejected_case = RejectedCase(index, request.point, None, error)
            errors.setdefault(str(error), rejected_case.located_error)
            last_error = error
    if memories:
        return max(memories)
    # An error that all points have belongs to the scene; its message need not name a run.
    raise last_error if len(errors) == 1 else ConfigErrors.combine(list(errors.values()))


def compute_rows(
    study: StudyFile,
    directory: Path,
    *,
    shard: tuple[int, int],
    jobs: int,
    lock: int,
    tell: ReportLine,
) -> None:
    """Compute the missing rows of a shard of a study.

    Parameters
    ----------
    study, directory
        The study and its folder, which is locked.
    shard
        (i, n): every n-th row, starting with the i-th.
    jobs
        Number of processes.
    lock
        Descriptor of the lock file, which the processes keep open.
    tell
        Function that is called with each line of progress.
    """
    require_hdf5("a study without folders for its runs")
    rows_folder = directory / ROWS_FOLDER
    try:
        if rows_folder.is_symlink():
            raise UsageError(f"{rows_folder} is a link: the rows must be in the study's own folder")
        rows_folder.mkdir(exist_ok=True)
        path = rows_folder / f"{shard[0]}-of-{shard[1]}.h5"
        with RowWriter(path) as writer:
            _ShardExecution(study, directory, shard, writer, lock, tell).run(jobs)
    except OSError as error:
        raise write_error(rows_folder, error) from error


def delete_rows(directory: Path) -> None:
    """Delete all row files of a study."""
    for path in row_files(directory / ROWS_FOLDER):
        path.unlink()


@dataclass
class _Worker:
    """Process that computes batches of rows, and the batch that it computes now."""

    process: ChildProcess
    batch: RowBatch | None = None
    wait: Callable[[], FinishedBatch] | None = None
    started: float = 0.0
    row_count: int = 0
    meshed_count: int = 0

    def fileno(self) -> int:
        """Return a file descriptor that becomes readable when the batch has ended."""
        return self.process.fileno()


class _ShardExecution:
    """Execution of one shard: batches for its processes, and the file of its rows."""

    def __init__(
        self,
        study: StudyFile,
        directory: Path,
        shard: tuple[int, int],
        writer: RowWriter,
        lock: int,
        tell: ReportLine,
    ):
        self._study = study
        self._shard = shard
        self._writer = writer
        self._lock = lock
        self._tell = tell
        self._runs_folder = None if study.run_folders == "none" else directory / RUNS
        self._index = RowIndex(directory / ROWS_FOLDER)
        self._known_physics = self._index.physics
        self._checksum = SettingsChecksum(study)
        self._folder_count = 0
        self._batch_size = 1
        # Rows of batches whose process crashed are computed one by one.
        self._single_rows: deque[RequestedRow] = deque()
        self._done_count = 0
        self._start_time = self._last_line = self._last_sync = time.monotonic()

    def run(self, worker_count: int) -> None:
        """Compute all missing rows."""
        pending = self._pending_rows()
        with ExitStack() as stack:
            idle = []
            for _ in range(worker_count):
                process = ChildProcess(compute_batch.__module__, inherited_files=(self._lock,))
                stack.callback(process.stop)
                idle.append(_Worker(process))
            busy: list[_Worker] = []
            while True:
                while idle and (rows := self._next_rows(pending)):
                    worker = idle.pop()
                    self._begin(worker, rows)
                    busy.append(worker)
                if not busy:
                    break
                ready = wait_for_answers(busy)
                for worker in ready:
                    busy.remove(worker)
                    self._finish(worker)
                    idle.append(worker)
        self._tell(f"{self._done_count} rows computed")

    def _pending_rows(self) -> Iterator[RequestedRow]:
        """Yield the requested rows of this shard that have not been computed yet."""
        index, count = self._shard
        requests = enumerate(self._study.iterate_requests())
        known_count = 0
        for place, request in itertools.islice(requests, index - 1, None, count):
            settings = self._checksum(request)
            if self._index.find_finished(settings):
                known_count += 1
            else:
                yield RequestedRow(place, settings, request)
        if known_count:
            self._tell(f"{known_count} rows had been computed before")

    def _next_rows(self, pending: Iterator[RequestedRow]) -> Sequence[RequestedRow]:
        """Return the rows of the next batch to be computed; empty if there are none."""
        if self._single_rows:
            return [self._single_rows.popleft()]
        return list(itertools.islice(pending, self._batch_size))

    def _begin(self, worker: _Worker, rows: Sequence[RequestedRow]) -> None:
        """Begin a batch."""
        if (
            worker.row_count >= MAX_ROWS_OF_A_PROCESS
            or worker.meshed_count >= MAX_MESHED_ROWS_OF_A_PROCESS
        ):
            worker.process.stop()
            worker.row_count = worker.meshed_count = 0
        has_folders = self._folder_count < MAX_FAILED_FOLDERS
        worker.batch = RowBatch(
            self._study.common_settings,
            rows,
            self._known_physics,
            self._runs_folder if has_folders else None,
        )
        worker.started = time.monotonic()
        worker.wait = worker.process.begin_call(compute_batch, worker.batch)

    def _finish(self, worker: _Worker) -> None:
        """Append the rows of a finished batch to the file."""
        assert worker.batch is not None and worker.wait is not None
        rows = worker.batch.rows
        try:
            finished = worker.wait()
        except ProcessCrash as crash:
            self._record_crash(rows, crash)
            return
        for row in finished.rows:
            self._writer.append(row)
        for settings, physics in finished.known:
            self._append_known(settings, physics)
        self._done_count += len(rows)
        self._folder_count += finished.folder_count
        worker.row_count += len(rows)
        worker.meshed_count += len(rows) if finished.has_meshes else 0
        self._adapt_batch_size(len(rows), time.monotonic() - worker.started)
        self._report_progress()

    def _record_crash(self, rows: Sequence[RequestedRow], crash: ProcessCrash) -> None:
        """Record the run whose process crashed, or compute the rows of its batch one by one."""
        if len(rows) > 1:
            self._single_rows.extend(rows)
            return
        reason = f"the process of the run {crash}"
        self._writer.append(failed_row(rows[0], crash.exit_code, reason))
        self._done_count += 1

    def _append_known(self, settings: int, physics: int) -> None:
        """Append the row of a run whose physics was already computed with other settings.

        It is a copy of the row that was computed. The checksums are those of `RunRow`.
        """
        row = self._index.find_physics(physics)
        assert row is not None
        self._writer.append(RunRow(settings, physics, row.cells, row.curve))

    def _adapt_batch_size(self, row_count: int, seconds: float) -> None:
        """Change the size of the batches so that each takes about BATCH_SECONDS."""
        seconds_of_a_row = max(seconds / row_count, 1e-4)
        wanted_size = int(BATCH_SECONDS / seconds_of_a_row)
        self._batch_size = max(1, min(wanted_size, 2 * row_count, MAX_BATCH))

    def _report_progress(self) -> None:
        """At regular times write a line of progress, and wait until the rows are on the disk."""
        now = time.monotonic()
        if now - self._last_sync > SYNC_SECONDS:
            self._writer.sync()
            self._last_sync = now
        if now - self._last_line > PROGRESS_SECONDS:
            self._last_line = now
            total = self._study.point_count // self._shard[1]
            seconds_of_a_row = (now - self._start_time) / self._done_count
            rate = f"{1000 * seconds_of_a_row:.3g} ms each"
            left = duration_text(seconds_of_a_row * max(0, total - self._done_count))
            self._tell(f"row {self._done_count} of at most {total}  {rate}  at most {left} left")
