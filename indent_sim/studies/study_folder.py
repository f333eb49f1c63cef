"""The folder of a study: study.json, one result folder per physics under runs/, and who may write
it.

Any process may read back a finished run; several shards share the folder, anything else has it
alone. study.json says that the folder is a study's; in it only result folders that this program
made are ever deleted.
"""

from __future__ import annotations

import fcntl
import os
import signal
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError
from indent_sim.process.limits import unwritable
from indent_sim.process.version import VERSION
from indent_sim.results import folder as results
from indent_sim.results.folder import PROGRAM, REPORT, RUNS, read_report, write_atomically
from indent_sim.results.overwrite_protection import MAX_DIFFERENCES, free_folder_name, is_finished
from indent_sim.results.reader import Results, read_run
from indent_sim.results.writer import to_json

RECORD = results.STUDY
STUDY_TABLE = "study.csv"
STUDY_PICTURE = "study.png"
CURVES = "curves.csv"
CURVES_PICTURE = "curves.png"
SCOREBOARD = "verification.csv"
SCOREBOARD_PICTURE = "verification.png"
STUDY_FILES = (
    RECORD,
    STUDY_TABLE,
    STUDY_PICTURE,
    CURVES,
    CURVES_PICTURE,
    SCOREBOARD,
    SCOREBOARD_PICTURE,
    RUNS,
)
LOCK = ".lock"
WORKER_TIMEOUT = 5.0  # s to wait for the worker of a killed study to be gone
SENT = (signal.SIGHUP, signal.SIGINT, signal.SIGBUS, signal.SIGKILL, signal.SIGTERM, signal.SIGXCPU)
OF_THE_MACHINE = {128 + number for number in SENT}  # exit codes
LACKING = (
    "MemoryError",
    "cannot write results",
)  # how the reason of a run begins that ran out of memory or disk


class StudyFolder:
    """Where a study lies; a context manager that holds its lock.

    Without `resume` each run of an earlier call is replaced once its new one is done, and those
    that are not asked for any more go at the end; finished ones among these are refused without
    `overwrite`. names: of the runs that it is to have. Raises UsageError when the folder, or that
    of one of them, is foreign, unwritable or in use, or when it holds finished runs that would be
    lost.
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
        self._runs = path / RUNS
        self._overwrite = overwrite
        self._physics = {name.rpartition("-")[2] for name in names}
        self._resume = resume or shared
        self._shared = shared
        self._lock = -1
        self._ended: dict[str, Results | None] = {}  # runs, by their names
        self._names: dict[str, str] = {}  # of the folders of runs, by the name of their physics

    def __enter__(self) -> StudyFolder:
        results.refuse_foreign(
            self.path, "study", (STUDY_PICTURE, CURVES_PICTURE, SCOREBOARD_PICTURE)
        )
        if self._runs.is_symlink() or (self._runs.exists() and not self._runs.is_dir()):
            raise UsageError(
                f"{self._runs} is a link, or no folder: the runs of a study stand in its own folder"
            )
        for run in self._runs.iterdir() if self._runs.exists() else ():
            if run.name.rpartition("-")[2] in self._physics:  # this study writes there
                results.refuse_foreign(run)
        if not (self._resume or self._overwrite):
            self._refuse_to_lose()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._take_lock()
            self._runs.mkdir(exist_ok=True)
            self._names = {
                entry.name.rpartition("-")[2]: entry.name for entry in self._runs.iterdir()
            }
        except (OSError, UsageError) as error:
            self._release()
            raise (unwritable(self.path, error) if isinstance(error, OSError) else error) from error
        return self

    def __exit__(self, *error: object) -> None:
        self._release()

    @property
    def keeps(self) -> bool:
        """Whether runs that have ended stay, and those cut off are gone on with."""
        return self._resume

    def run(self, name: str) -> Path:
        """The result folder of a run: that of the same physics where there is one, whatever was
        varied then.
        """
        physics = name.rpartition("-")[2]
        if physics not in self._names:
            self._names[physics] = name
        return self._runs / self._names[physics]

    def is_finished(self, name: str) -> bool:
        """Whether a run has ended and would end so again: the machine did not kill it, and gave it
        memory and disk.
        """
        if (found := self._read(name)) is None:
            return False
        code = found.report.get("exit_code")
        reason = str(found.report.get("reason"))
        return code not in OF_THE_MACHINE and not reason.startswith(LACKING)

    def ended(self, name: str) -> Results | None:
        """The result of a run that has ended, well or not, under this version of the program; None
        of any other, and where it cannot be read. To be asked for when it will not be done
        again: it is read once.
        """
        if name not in self._ended:
            self._ended[name] = self._read(name)
        return self._ended[name]

    def _read(self, name: str) -> Results | None:
        report = read_report(self.run(name))
        if report.get("status") in ("done", "failed") and report.get("version") == VERSION:
            with suppress(UsageError):  # damaged since
                return read_run(self.run(name))
        return None

    def fail(self, name: str, exit_code: int, reason: str) -> None:
        """Write down a failure that left no report of its own, and no finished run of before."""
        report = read_report(self.run(name))
        if report.get("status") == "done":
            return
        if report.get("status") == "failed" and report.get("exit_code") == exit_code:
            return
        identity = {"program": PROGRAM, "version": VERSION, "status": "failed"}
        self.run(name).mkdir(exist_ok=True)
        said = identity | {"exit_code": exit_code, "reason": reason, "rows": 0}
        write_atomically(self.run(name) / REPORT, to_json(report | said) + "\n")

    def forget_others(self) -> None:
        """Delete the results of runs that this study does not ask for, unless it is to keep what is
        there.
        """
        for run in [] if self._resume else self._others():
            if results.is_own_folder(run):
                results.delete_own_files(run)

    def _others(self) -> list[Path]:
        """What stands among the runs and is none that this study asks for."""
        runs = sorted(self._runs.iterdir()) if self._runs.is_dir() else []
        return [run for run in runs if run.name.rpartition("-")[2] not in self._physics]

    def _refuse_to_lose(self) -> None:
        """UsageError where finished runs of another study would go."""
        lost = [
            run for run in self._others() if results.has_rows(run) and is_finished(read_report(run))
        ]
        if not lost:
            return
        told = ", ".join(run.name for run in lost[:MAX_DIFFERENCES]) + (
            " and others" if len(lost) > MAX_DIFFERENCES else ""
        )
        count = "1 finished run" if len(lost) == 1 else f"{len(lost)} finished runs"
        problem = f"{self.path} holds {count} that this study does not ask for: {told}"
        other = f"choose another --output, such as {free_folder_name(self.path)}"
        raise UsageError(
            problem, f"--resume keeps them, --overwrite replaces them, or {other}", str(self.path)
        )

    def write(self, name: str, content: str) -> None:
        """Replace a file of the study at once."""
        write_atomically(self.path / name, content)

    def write_record(self, **entries: Any) -> None:
        """study.json: that this folder is a study, and what it says of itself."""
        self.write(RECORD, to_json({"program": PROGRAM, "version": VERSION, **entries}) + "\n")

    def _take_lock(self) -> None:
        self._lock = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        mode = fcntl.LOCK_SH if self._shared else fcntl.LOCK_EX
        deadline = time.monotonic() + WORKER_TIMEOUT
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


@contextmanager
def opened(path: Path, **how: Any) -> Iterator[StudyFolder]:
    """The folder of a study, locked; one that this call made and left empty is taken away again."""
    before = next((parent for parent in (path, *path.parents) if parent.exists()), path)
    with StudyFolder(path, **how) as folder:
        try:
            yield folder
        finally:
            if before != path and not (path / RECORD).exists():
                for made in (path / RUNS, path / LOCK, path):
                    with suppress(OSError):
                        made.rmdir() if made.is_dir() else made.unlink()
