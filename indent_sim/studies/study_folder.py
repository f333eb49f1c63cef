"""Folder of a study: study.json, tables, pictures, and one result folder per run in runs/.

Finished runs can be read by any process. A lock allows either several shards or a single other
process to write the folder. The file study.json marks the folder as a study; only result folders
that this program wrote are deleted in it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError
from indent_sim.process.file_locks import lock_file
from indent_sim.process.limits import write_error
from indent_sim.process.regular_files import open_descriptor
from indent_sim.process.signals import MACHINE_SIGNALS
from indent_sim.process.version import VERSION
from indent_sim.results import result_files
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.overwrite_protection import MAX_DIFFERENCES, free_folder_name, is_finished
from indent_sim.results.reader import Results, read_run
from indent_sim.results.result_files import LOCK, PROGRAM, REPORT, RUNS, STUDY, read_report

STUDY_TABLE = "study.csv"
STUDY_PICTURE = "study.png"
CURVES = "curves.csv"
CURVES_HDF5 = "curves.h5"
CURVES_PICTURE = "curves.png"
SAMPLES_PICTURE = "samples.png"
MAPS_PICTURE = "maps.png"
SOBOL_PICTURE = "sobol.png"
SCOREBOARD = "verification.csv"
SCOREBOARD_PICTURE = "verification.png"
STUDY_FILES = (
    STUDY,
    STUDY_TABLE,
    STUDY_PICTURE,
    CURVES,
    CURVES_HDF5,
    CURVES_PICTURE,
    SCOREBOARD,
    SCOREBOARD_PICTURE,
    SAMPLES_PICTURE,
    MAPS_PICTURE,
    SOBOL_PICTURE,
    RUNS,
)
# Pictures of this program, which are recognised by a signature, so that no picture of a user is
# replaced.
PICTURES = tuple(name for name in STUDY_FILES if name.endswith(".png") and name != STUDY_PICTURE)

# Longest time to wait until the worker process of a killed study has ended [s].
WORKER_TIMEOUT = 5.0


class StudyFolder:
    """Folder of a study; a context manager that holds its lock.

    Parameters
    ----------
    path
        The folder.
    resume
        Keep all runs that are in the folder. Otherwise every run is replaced when the new run is
        finished, and runs that are not part of this study are deleted at the end.
    shared
        Share the folder with other shards of the same study, which implies `resume`.
    overwrite
        Allow the deletion of finished runs that are not part of this study.
    names
        Names of the runs of this study.

    Raises
    ------
    UsageError
        If the folder or a run folder was not made by this program, is in use or not writable, or if
        finished runs would be lost.
    """

    def __init__(
        self,
        path: Path,
        *,
        resume: bool,
        shared: bool = False,
        overwrite: bool = False,
        names: Iterable[str] = (),
    ):
        self.path = path
        self._runs_folder = path / RUNS
        self._overwrite = overwrite
        self._physics_names = {name.rpartition("-")[2] for name in names}
        self._is_resumed = resume or shared
        self._is_shared = shared
        self._lock_descriptor = -1
        self._results_by_run: dict[str, Results | None] = {}
        # Names of folders by the hash of their physics.
        self._folder_names: dict[str, str] = {}

    def __enter__(self) -> StudyFolder:
        result_files.refuse_foreign(self.path, "study", (STUDY_PICTURE, *PICTURES))
        if self._runs_folder.is_symlink() or (
            self._runs_folder.exists() and not self._runs_folder.is_dir()
        ):
            raise UsageError(
                f"{self._runs_folder} is a link or not a folder: the runs of a study must be in "
                "its own folder"
            )
        for run in self._runs_folder.iterdir() if self._runs_folder.exists() else ():
            if run.name.rpartition("-")[2] in self._physics_names:
                result_files.refuse_foreign(run)
        if not (self._is_resumed or self._overwrite):
            self._reject_losing_runs()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._take_lock()
            self._runs_folder.mkdir(exist_ok=True)
            self._folder_names = {
                entry.name.rpartition("-")[2]: entry.name for entry in self._runs_folder.iterdir()
            }
        except (OSError, UsageError) as error:
            self._release()
            raise (
                write_error(self.path, error) if isinstance(error, OSError) else error
            ) from error
        return self

    def __exit__(self, *error: object) -> None:
        self._release()

    @property
    def lock_descriptor(self) -> int:
        """File descriptor of the lock file."""
        return self._lock_descriptor

    @property
    def is_resumed(self) -> bool:
        """True if finished runs are kept and interrupted runs continued."""
        return self._is_resumed

    def run_folder(self, name: str) -> Path:
        """Return the result folder of a run: an existing one of the same physics, or a new one.

        A run with the same physics has the same id, which ends the name of its folder.
        """
        physics = name.rpartition("-")[2]
        if physics not in self._folder_names:
            self._folder_names[physics] = name
        return self._runs_folder / self._folder_names[physics]

    def is_finished(self, name: str) -> bool:
        """True if a run has ended with a result that would be the same if it were repeated.

        A run that was killed, or that ran out of memory or disk space, is not finished.
        """
        if (results_of_run := self._read_ended_run(name)) is None:
            return False
        code = results_of_run.report.get("exit_code")
        reason = str(results_of_run.report.get("reason"))
        # The reason of a run that ran out of memory or disk space begins with one of these texts.
        resource_failures = ("MemoryError", "cannot write results")
        machine_codes = {128 + number for number in MACHINE_SIGNALS}
        return code not in machine_codes and not reason.startswith(resource_failures)

    def ended_results(self, name: str) -> Results | None:
        """Return the result of a finished or failed run of this program version, or None.

        The result is cached: do not call this before a run that is still to be computed again.
        """
        if name not in self._results_by_run:
            self._results_by_run[name] = self._read_ended_run(name)
        return self._results_by_run[name]

    def _read_ended_run(self, name: str) -> Results | None:
        """Read the result of a finished or failed run of this program version, or return None."""
        report = read_report(self.run_folder(name))
        if report.get("status") in ("done", "failed") and report.get("version") == VERSION:
            # A damaged result counts as missing.
            with suppress(UsageError):
                return read_run(self.run_folder(name))
        return None

    def record_failure(self, name: str, exit_code: int, reason: str) -> None:
        """Write run.json of a failed run that has no run.json; keep that of a finished run."""
        report = read_report(self.run_folder(name))
        if report.get("status") == "done":
            return
        if report.get("status") == "failed" and report.get("exit_code") == exit_code:
            return
        identity = {"program": PROGRAM, "version": VERSION, "status": "failed"}
        self.run_folder(name).mkdir(exist_ok=True)
        failure = identity | {"exit_code": exit_code, "reason": reason, "rows": 0}
        write_atomically(self.run_folder(name) / REPORT, to_json(report | failure) + "\n")

    def delete_other_runs(self) -> None:
        """Delete the results of runs that are not part of this study, unless it is resumed."""
        for run in [] if self._is_resumed else self._other_runs():
            if result_files.is_own_folder(run):
                result_files.delete_own_files(run)

    def _other_runs(self) -> list[Path]:
        """Return the folders in runs/ that are not part of this study."""
        runs = sorted(self._runs_folder.iterdir()) if self._runs_folder.is_dir() else []
        return [run for run in runs if run.name.rpartition("-")[2] not in self._physics_names]

    def _reject_losing_runs(self) -> None:
        """Raise UsageError if finished runs of another study would be deleted."""
        lost_runs = [
            run
            for run in self._other_runs()
            if result_files.has_rows(run) and is_finished(read_report(run))
        ]
        if not lost_runs:
            return
        run_names = ", ".join(run.name for run in lost_runs[:MAX_DIFFERENCES]) + (
            " and others" if len(lost_runs) > MAX_DIFFERENCES else ""
        )
        count = "1 finished run" if len(lost_runs) == 1 else f"{len(lost_runs)} finished runs"
        problem = f"{self.path} has {count} that this study does not include: {run_names}"
        output_hint = f"choose another --output, such as {free_folder_name(self.path)}"
        raise UsageError(
            problem,
            f"--resume keeps them, --overwrite replaces them, or {output_hint}",
            str(self.path),
        )

    def write_file(self, name: str, content: str) -> None:
        """Replace a file of the study atomically."""
        write_atomically(self.path / name, content)

    def write_record(self, **entries: Any) -> None:
        """Write study.json, which marks the folder as a study."""
        self.write_file(STUDY, to_json({"program": PROGRAM, "version": VERSION, **entries}) + "\n")

    def _take_lock(self) -> None:
        """Lock the folder; raise UsageError if another study uses it."""
        self._lock_descriptor = open_descriptor(self.path / LOCK, os.O_RDWR | os.O_CREAT)
        deadline = time.monotonic() + WORKER_TIMEOUT
        while True:
            try:
                return lock_file(self._lock_descriptor, shared=self._is_shared)
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise UsageError(f"{self.path} is in use by another study") from None
                time.sleep(0.05)

    def _release(self) -> None:
        """Release the lock of the folder."""
        if self._lock_descriptor >= 0:
            os.close(self._lock_descriptor)
            self._lock_descriptor = -1


@contextmanager
def open_study_folder(path: Path, **options: Any) -> Iterator[StudyFolder]:
    """Yield the locked folder of a study; delete a new folder if it remains empty."""
    existing_parent = next((parent for parent in (path, *path.parents) if parent.exists()), path)
    with StudyFolder(path, **options) as folder:
        try:
            yield folder
        finally:
            if existing_parent != path and not (path / STUDY).exists():
                for created_path in (path / RUNS, path / LOCK, path):
                    with suppress(OSError):
                        created_path.rmdir() if created_path.is_dir() else created_path.unlink()
