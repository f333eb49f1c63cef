"""Output of a run: result folder shared by all MPI ranks, and outputs that may fail."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

from indent_sim.process.errors import IndentSimError, printable
from indent_sim.process.ranks import FailureConsensus, SerialComm, run_on_root
from indent_sim.process.signals import raise_pending_signal
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.checkpoint import Checkpoint
from indent_sim.results.json_text import to_json
from indent_sim.results.previous_run import PreviousRun
from indent_sim.results.result_files import REPORT, read_report
from indent_sim.results.writer import ResultFolder

T = TypeVar("T")
Fallback = TypeVar("Fallback")
log = logging.getLogger("indent_sim")

# A communicator of mpi4py, which is loaded only to solve a mesh, or a SerialComm.
Comm = Any
Failure = tuple[str, str]  # reason of a missing output, and the traceback
# ResultFolder, or a class with its methods that keeps the rows elsewhere.
FolderType = Callable[..., Any]


class OptionalOutput:
    """Evaluation of outputs whose failure is reported as a warning and does not stop the run.

    Exceptions that signals raise are not caught.

    Parameters
    ----------
    comm
        MPI communicator; by default this process alone.
    report_missing
        Function that is called with the name and the failure of each missing output, once per name;
        by default both are logged.
    """

    def __init__(
        self, comm: Comm = None, report_missing: Callable[[str, Failure], None] | None = None
    ):
        self._comm = comm if comm is not None else SerialComm()
        self.consensus = FailureConsensus(self._comm)
        self._report_missing = report_missing or (
            lambda name, failure: log.warning(f"{name} is missing: {failure[0]}")
        )
        self._missing: set[str] = set()

    def __call__(self, name: str, find: Callable[[], T], fallback: Fallback) -> T | Fallback:
        """Return what `find` returns, or `fallback` on all ranks if it fails on any (collective).

        If other ranks wait for the failed rank inside `find`, the error is raised, since all ranks
        must stop.

        Parameters
        ----------
        name
            Name of the output in the warning.
        find
            Function that evaluates the output.
        fallback
            The value that is returned if the output is missing.
        """
        failure: Failure | None = None
        try:
            value: T | Fallback = find()
        except Exception as error:
            raise_pending_signal()
            kind = "" if isinstance(error, IndentSimError) else f"{type(error).__name__}: "
            failure = f"{kind}{printable(str(error))}", "".join(traceback.format_exception(error))
            if (count := self.consensus.count_failures(True)) is None:
                raise
        else:
            count = self.consensus.count_failures(False)
        if not count:
            return value
        first = next(filter(None, self._comm.allgather(failure)))
        if name not in self._missing:
            self._missing.add(name)
            self._report_missing(name, first)
        return fallback


def _root_method(method: Callable[..., T]) -> Callable[..., T | None]:
    """Wrap a method of ResultFolder that runs on rank 0 and raises its failure on all ranks."""

    @wraps(method)
    def call(run_output: RunOutput, *args: Any, **options: Any) -> T | None:
        def call_on_folder() -> T:
            return getattr(run_output._folder, method.__name__)(*args, **options)

        return run_on_root(run_output.comm, call_on_folder)

    return call


class RunOutput:
    """Result folder shared by all MPI ranks: rank 0 writes, failures are raised on all."""

    def __init__(
        self,
        comm: Comm,
        target: Path,
        config_yaml: str,
        report: Mapping[str, Any],
        *,
        folder_type: FolderType = ResultFolder,
        **options: Any,
    ):
        self.comm = comm
        self.report = dict(report)
        self._open_folder = lambda: folder_type(
            target, config_yaml, report=self.report, **options
        ).__enter__()
        self._folder: Any = None
        self.earlier: PreviousRun | None = None
        # Outputs of all ranks together, and of each rank alone.
        self.optional_output = OptionalOutput(comm, self._report_missing)
        self.rank_optional_output = OptionalOutput(None, self._report_missing)
        # Ranks whose run failed agree apart from `optional_output`, where others may be waiting.
        self.failure_consensus = FailureConsensus(comm)

    def __enter__(self) -> RunOutput:
        self._folder = run_on_root(self.comm, self._open_folder)
        self.earlier = self.comm.bcast(
            self._folder.previous_run if self._folder is not None else None
        )
        return self

    def __exit__(self, *error: Any) -> None:
        if error[0] is None:
            run_on_root(self.comm, self._close_folder, *error)
            self.optional_output.consensus.free()
            self.failure_consensus.free()
        else:
            self._close_folder(*error)

    def _close_folder(self, *error: Any) -> None:
        """Close the result folder with the exception that ended the run, and keep its report."""
        if self._folder is not None:
            self._folder.__exit__(*error)
            self.report = dict(self._folder.report)

    # Methods of the folder that rank 0 executes; the arguments of other ranks are ignored.
    open_fields = _root_method(ResultFolder.open_fields)
    write_fields = _root_method(ResultFolder.write_fields)
    append = _root_method(ResultFolder.append)
    write_experiment = _root_method(ResultFolder.write_experiment)
    save_checkpoint = _root_method(ResultFolder.save_checkpoint)
    _read_checkpoint = _root_method(ResultFolder.read_checkpoint)

    def read_checkpoint(self, identity: Mapping[str, Any]) -> Checkpoint:
        """Return the last equilibria of the run that is continued, on all ranks.

        A checkpoint can be read with a different number of MPI ranks.
        """
        return self.comm.bcast(self._read_checkpoint(identity)) or Checkpoint()

    def add_entries(self, **entries: Any) -> None:
        """Add entries to run.json."""
        if self._folder is not None:
            self._folder.report.update(entries)

    def mark_failed(self, error: IndentSimError) -> None:
        """Record that the run has failed although all of its rows are written."""
        if self._folder is not None:
            self._folder.finish(error)

    def add_warnings(self, *warnings: str) -> None:
        """Add warnings to the entry `warnings` of run.json."""
        if self._folder is not None:
            self.add_entries(warnings=[*self._folder.report.get("warnings", []), *warnings])

    def _report_missing(self, name: str, failure: Failure) -> None:
        """Record a missing output in run.json."""
        if self._folder is not None:
            _add_missing_entry(self._folder.report, name, failure)


def optional_output_after_run(folder: Path, report: dict[str, Any]) -> OptionalOutput:
    """Return an OptionalOutput that records missing outputs in run.json and in `report`."""

    def report_missing(name: str, failure: Failure) -> None:
        for entries in (report, stored_report := read_report(folder)):
            _add_missing_entry(entries, name, failure)
        with suppress(OSError):
            write_atomically(folder / REPORT, to_json(stored_report) + "\n")

    return OptionalOutput(None, report_missing)


def _add_missing_entry(report: dict[str, Any], name: str, failure: Failure) -> None:
    """Add a missing output to the warnings and to the entry `missing` of a report."""
    message = f"{name} is missing: {failure[0]}; run.json has the traceback"
    report["warnings"] = [*(report.get("warnings") or []), message]
    report["missing"] = (report.get("missing") or {}) | {name: failure[1]}
