"""The record of a run: its result folder as all ranks see it, its clock, and what is missing beside
its rows.
"""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

from indent_sim.process.errors import IndentSimError, printable
from indent_sim.process.ranks import Alone, Meeting, on_root
from indent_sim.process.signals import check
from indent_sim.results.checkpoint import Checkpoint
from indent_sim.results.folder import REPORT, read_report, write_atomically
from indent_sim.results.reader import Earlier
from indent_sim.results.writer import ResultFolder, to_json

T = TypeVar("T")
Other = TypeVar("Other")
log = logging.getLogger("indent_sim")

Comm = Any  # a communicator of mpi4py, which is loaded where a mesh is solved alone, or `Alone`
Failure = tuple[str, str]  # why something is missing: in words, and the traceback


class Beside:
    """Finds what stands beside the rows of a run: where that fails it is missing, and the run goes
    on.

    `say` is told what is missing and why, once for each thing [the log]. Signals pass through.
    """

    def __init__(self, comm: Comm = None, say: Callable[[str, Failure], None] | None = None):
        self._comm = comm if comm is not None else Alone()
        self.meeting = Meeting(self._comm)
        self._say = say or (lambda what, why: log.warning(f"{what} is missing: {why[0]}"))
        self._missing: set[str] = set()

    def __call__(self, what: str, find: Callable[[], T], otherwise: Other) -> T | Other:
        """What `find` returns, or `otherwise` on all ranks where it fails on any (collective).

        The error of a rank that the others wait for inside `find` passes through: there all must
        end.
        """
        failure: Failure | None = None
        try:
            value: T | Other = find()
        except Exception as error:
            check()
            kind = "" if isinstance(error, IndentSimError) else f"{type(error).__name__}: "
            failure = f"{kind}{printable(str(error))}", "".join(traceback.format_exception(error))
            if (count := self.meeting.failures(True)) is None:
                raise
        else:
            count = self.meeting.failures(False)
        if not count:
            return value
        first = next(filter(None, self._comm.allgather(failure)))
        if what not in self._missing:
            self._missing.add(what)
            self._say(what, first)
        return otherwise


def _by_root(act: Callable[..., T]) -> Callable[..., T | None]:
    """A method of a record that does something with the folder on rank 0; its failure is that of
    all ranks.
    """

    @wraps(act)
    def call(record: Record, *args: Any, **options: Any) -> T | None:
        return on_root(record.comm, lambda: act(record._folder, *args, **options))

    return call


class Record:
    """The result folder seen from all ranks: rank 0 writes, every rank learns of a failure."""

    def __init__(
        self, comm: Comm, target: Path, config_yaml: str, report: Mapping[str, Any], **options: Any
    ):
        self.comm = comm
        self.report = dict(report)
        self._open = lambda: ResultFolder(
            target, config_yaml, report=self.report, **options
        ).__enter__()
        self._folder: ResultFolder | None = None
        self.earlier: Earlier | None = None
        # of all ranks, of this one
        self.beside = Beside(comm, self._miss)
        self.alone = Beside(None, self._miss)
        self.end = Meeting(
            comm
        )  # of ranks whose run has failed: others may just then meet in `beside`

    def __enter__(self) -> Record:
        self._folder = on_root(self.comm, self._open)
        self.earlier = self.comm.bcast(self._folder.earlier if self._folder is not None else None)
        return self

    def __exit__(self, *error: Any) -> None:
        if error[0] is None:
            on_root(self.comm, self._close, *error)
            self.beside.meeting.free()
            self.end.free()
        else:
            self._close(*error)

    def _close(self, *error: Any) -> None:
        if self._folder is not None:
            self._folder.__exit__(*error)
            self.report = dict(self._folder.report)

    # what rank 0 does, with what it alone may have
    open_fields = _by_root(ResultFolder.open_fields)
    write_fields = _by_root(ResultFolder.write_fields)
    append = _by_root(ResultFolder.append)
    write_experiment = _by_root(ResultFolder.write_experiment)
    save_checkpoint = _by_root(ResultFolder.save_checkpoint)
    _read_checkpoint = _by_root(ResultFolder.read_checkpoint)

    def read_checkpoint(self, identity: Mapping[str, Any]) -> Checkpoint:
        """The last equilibria of the run that is continued, on all ranks; it may have had another
        number of them.
        """
        return self.comm.bcast(self._read_checkpoint(identity)) or Checkpoint()

    def note(self, **entries: Any) -> None:
        """Add entries to run.json."""
        if self._folder is not None:
            self._folder.report.update(entries)

    def fail(self, error: IndentSimError) -> None:
        """Say that the run has failed, though all of its rows are there."""
        if self._folder is not None:
            self._folder.finish(error)

    def warn(self, *warnings: str) -> None:
        """Add warnings to those of run.json."""
        if self._folder is not None:
            self.note(warnings=[*self._folder.report.get("warnings", []), *warnings])

    def _miss(self, what: str, failure: Failure) -> None:
        if self._folder is not None:
            _add(self._folder.report, what, failure)


def amend(folder: Path, report: dict[str, Any]) -> Beside:
    """Finds what stands beside the rows of a run that has ended, and says in its run.json, and in
    `report`, what is missing.
    """

    def say(what: str, failure: Failure) -> None:
        for entries in (report, written := read_report(folder)):
            _add(entries, what, failure)
        with suppress(OSError):
            write_atomically(folder / REPORT, to_json(written) + "\n")

    return Beside(None, say)


def _add(report: dict[str, Any], what: str, failure: Failure) -> None:
    said = f"{what} is missing: {failure[0]}; run.json has the traceback"
    report["warnings"] = [*(report.get("warnings") or []), said]
    report["missing"] = (report.get("missing") or {}) | {what: failure[1]}
