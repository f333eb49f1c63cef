"""The folder of a study: study.json, one result folder per physics under runs/, and who may write it.

Any process may read back a finished run; several shards share the folder, anything else has it alone. study.json says
that the folder is a study's; in it only result folders that this program made are ever deleted.
"""

from __future__ import annotations

import fcntl
import json
import os
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError
from indent_sim.process.version import VERSION
from indent_sim.results.folder import PROGRAM, REPORT, contents, discard, is_ours, read_report, write_atomically
from indent_sim.results.folder import content as content_of
from indent_sim.results.reader import STUDY, read_run
from indent_sim.results.writer import to_json

RECORD, TABLE, PICTURE = STUDY, "study.csv", "study.png"
CURVES, CURVES_PICTURE = "curves.csv", "curves.png"
RUNS, OLD_RUNS, LOCK = "runs", ".runs.old", ".lock"
PATIENCE = 5.0  # s to wait for the worker of a killed study to be gone
LASTING = ("done", "failed")
SENT = (signal.SIGHUP, signal.SIGINT, signal.SIGBUS, signal.SIGKILL, signal.SIGTERM, signal.SIGXCPU)
OF_THE_MACHINE = {128 + number for number in SENT}  # exit codes
LACKING = ("MemoryError", "cannot write results")  # how the reason of a run begins that ran out of memory or disk


class StudyFolder:
    """Where a study lies; a context manager that holds its lock.

    Without `resume` the runs of an earlier call are replaced: they go when the first new one has ended.
    Raises UsageError when the folder is foreign, unwritable or in use.
    """

    def __init__(self, path: Path, *, resume: bool, shared: bool = False):
        self.path = path
        self._resume, self._shared = resume or shared, shared
        self._lock = -1
        self._names: dict[str, str] = {}  # of the folders of runs, by the name of their physics

    def __enter__(self) -> StudyFolder:
        _refuse_foreign(self.path)
        for folder in (self._runs, self._old):
            if folder.is_symlink():
                raise UsageError(f"{folder} is a link: the runs of a study stand in its own folder")
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._take_lock()
            self._recover()
            if not self._resume and self._runs.exists():
                self._runs.rename(self._old)
            self._runs.mkdir(exist_ok=True)
            self._names = {entry.name.rpartition("-")[2]: entry.name for entry in self._runs.iterdir()}
        except OSError as error:
            self._release()
            raise UsageError(f"cannot write {self.path}: {error.strerror or error}") from error
        except UsageError:
            self._release()
            raise
        return self

    def __exit__(self, *error: Any) -> None:
        self._release()

    def run(self, name: str) -> Path:
        """The result folder of a run: that of the same physics where there is one, whatever was varied then."""
        physics = name.rpartition("-")[2]
        if physics not in self._names:
            self._names[physics] = name
        return self._runs / self._names[physics]

    def is_finished(self, name: str) -> bool:
        """Whether a run has ended and would end so again: the machine did not kill it, and gave it memory and disk."""
        return self.has_ended(name) and not _was_killed(read_report(self.run(name)))

    def has_ended(self, name: str) -> bool:
        """Whether a run has ended, well or not, under this version of the program, and its result can be read."""
        report = read_report(self.run(name))
        if report.get("status") not in LASTING or report.get("version") != VERSION:
            return False
        try:
            read_run(self.run(name))
        except UsageError:  # damaged since
            return False
        return True

    def fail(self, name: str, exit_code: int, reason: str) -> None:
        """Write down a failure that left no report of its own."""
        report = read_report(self.run(name))
        if report.get("status") == "failed" and report.get("exit_code") == exit_code:
            return
        identity = {"program": PROGRAM, "version": VERSION, "status": "failed"}
        self.run(name).mkdir(exist_ok=True)
        said = identity | {"exit_code": exit_code, "reason": reason, "rows": 0}
        write_atomically(self.run(name) / REPORT, to_json(report | said) + "\n")

    def forget_old(self) -> None:
        """Delete the runs that this study replaces; what else stands among them goes back to where it was."""
        _discard_runs(self._old)
        if self._old.is_dir():
            self._put_back()

    def write(self, name: str, content: str) -> None:
        """Replace a file of the study at once."""
        write_atomically(self.path / name, content)

    def write_record(self, **entries: Any) -> None:
        """study.json: that this folder is a study, and what it says of itself."""
        self.write(RECORD, to_json({"program": PROGRAM, "version": VERSION, **entries}) + "\n")

    @property
    def _runs(self) -> Path:
        return self.path / RUNS

    @property
    def _old(self) -> Path:
        return self.path / OLD_RUNS

    def _take_lock(self) -> None:
        self._lock = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        mode = fcntl.LOCK_SH if self._shared else fcntl.LOCK_EX
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return fcntl.flock(self._lock, mode | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise UsageError(f"{self.path} is in use by another study") from None
                time.sleep(0.05)
            except OSError:
                return None  # a file system without locks: go on without

    def _release(self) -> None:
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def _recover(self) -> None:
        """Undo a replacement that was killed before its first run had ended, or finish it."""
        if not self._old.exists():
            return
        if self._runs.exists() and any(self.is_finished(entry.name) for entry in self._runs.iterdir()):
            self.forget_old()
        else:
            _discard_runs(self._runs)
            self._put_back()

    def _put_back(self) -> None:
        """Make the old runs the runs again, beside those that are there; UsageError when one has the same name."""
        self._runs.mkdir(exist_ok=True)
        for entry in self._old.iterdir():
            if os.path.lexists(self._runs / entry.name):
                raise UsageError(f"{entry} is in the way of a study; move it somewhere else")
            entry.rename(self._runs / entry.name)
        self._old.rmdir()


@contextmanager
def opened(path: Path, *, resume: bool, shared: bool) -> Iterator[StudyFolder]:
    """The folder of a study, locked; one that this call made and left empty is taken away again."""
    before = next((parent for parent in (path, *path.parents) if parent.exists()), path)
    with StudyFolder(path, resume=resume, shared=shared) as folder:
        try:
            yield folder
        finally:
            if before != path and not (path / RECORD).exists():
                for made in (path / RUNS, path / LOCK, path):
                    with suppress(OSError):
                        made.rmdir() if made.is_dir() else made.unlink()


def _discard_runs(folder: Path) -> None:
    """Delete the results that this program wrote, and the folder when nothing else is in it."""
    for entry in folder.iterdir() if folder.is_dir() else ():
        if is_ours(entry):
            discard(entry)
    with suppress(OSError):
        folder.rmdir()


def _was_killed(report: Mapping[str, Any]) -> bool:
    """Whether a run failed for want of what the machine may have another time."""
    return report.get("exit_code") in OF_THE_MACHINE or str(report.get("reason")).startswith(LACKING)


def _refuse_foreign(path: Path) -> None:
    runs = path / RUNS
    begun = {LOCK, RUNS} if runs.is_dir() and not runs.is_symlink() and not any(runs.iterdir()) else {LOCK}
    if contents(path, begun) and not _is_study(path):
        raise UsageError(f"{path} is not empty and was not made by `{PROGRAM} study`; choose another --output")


def _is_study(path: Path) -> bool:
    try:
        record = json.loads(content_of(path / RECORD))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(record, dict) and record.get("program") == PROGRAM
