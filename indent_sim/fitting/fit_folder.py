"""The folder of a fit: measured curves one after another, their entries in fit.json, tables and
pictures.

A call with the same folder goes on with the curves that lack an entry, or whose file has changed.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import chain, count
from multiprocessing import connection
from pathlib import Path
from typing import Any

from indent_sim.fitting import fit_table
from indent_sim.fitting.curve_fit import (
    CurveFit,
    FitRequest,
    cantilever_stiffness_si,
    fit_curve,
    rejected_fit,
    request_identity,
)
from indent_sim.fitting.forward_model.forward_model import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import number_at
from indent_sim.process.errors import BackendError, ConfigError, NotConverged, UsageError
from indent_sim.process.forked_process import ForkedProcess, ProcessCrash
from indent_sim.process.limits import write_error
from indent_sim.process.version import VERSION
from indent_sim.results import result_files
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve
from indent_sim.results.result_files import FIT, PROGRAM, read_report
from indent_sim.run.planned_run import PlannedRun

FIT_TABLE = "fit.csv"
FIT_PICTURE = "fit.png"
CURVES_FOLDER = "curves"
PICTURES = "pictures"
FIT_FILES = (FIT, FIT_TABLE, FIT_PICTURE, CURVES_FOLDER, PICTURES)
SAVE_INTERVAL = 2.0  # s between two writings of fit.json while curves are fitted
ReportLine = Callable[[str], None]
Entry = dict[str, Any]


@dataclass(frozen=True)
class ReadOptions:
    """How the files of curves are read: columns by title or number, and units where the files say
    none.
    """

    columns: tuple[str, ...] = ()
    units: Mapping[str, str] | None = None


@dataclass(frozen=True)
class CurveFits:
    """The fits of some curves: where they lie, and their entries in order of the curves."""

    directory: Path
    request: FitRequest
    entries: list[Entry]

    @property
    def exit_code(self) -> int:
        """0 where any curve was fitted, else 5."""
        return (
            0
            if any(entry["status"] == "done" for entry in self.entries)
            else NotConverged.exit_code
        )

    def as_json(self) -> Entry:
        """What fit.json says of the curves."""
        scene = str(self.request.config.source.name)
        return {"scene": scene, "vary": list(self.request.varied_keys), "curves": self.entries}


@dataclass(frozen=True)
class _FitTask:
    """A curve to be fitted, where what is drawn of it goes, and what tells its file from a later
    one.
    """

    curve: MeasuredCurve
    directory: Path
    picture: Path | None
    source: Entry


def fit_curves(
    paths: Sequence[Path],
    request: FitRequest,
    directory: Path,
    reading: ReadOptions | None = None,
    jobs: int = 1,
    tell: ReportLine = lambda line: None,
) -> CurveFits:
    """Fit a scene to every curve of files and folders, `jobs` at a time, into a folder of its own.

    Raises UsageError for a path that is not there, or a folder that holds something else or the fit
    of another scene; ConfigError for a scene, a key or a column that is wrong; BackendError for AFM
    files without their package. One broken curve is an entry with its reason.
    """
    reading = reading or ReadOptions()
    files = [file for path in paths for file in curve_files(path)]
    for key in request.varied_keys:
        number_at(request.config, key)
    PlannedRun.resolve(request.config)
    with _open_locked(directory, request) as earlier_entries:
        writer = _Writer(directory, request, earlier_entries)
        try:
            curves = _read_curves(files, request, reading, writer)
            is_plotted = request.config.output.plot
            has_many_files = len(files) > 1
            tasks = (
                _make_task(curve, source, directory, has_many_files, is_plotted)
                for curve, source in curves
            )
            for entry in _run_tasks(tasks, request, jobs):
                writer.add_entry(entry)
                tell(_progress_line(entry, len(writer.entries)))
        except (ConfigError, UsageError, BackendError):
            if writer.entries:
                writer.write("failed")
            raise
        except BaseException:
            writer.write("interrupted")
            raise
        fits = writer.finish()
    return fits


class _Writer:
    """The entries of a fit and its files, written now and then."""

    def __init__(self, directory: Path, request: FitRequest, earlier_entries: list[Entry]):
        self.directory = directory
        self.request = request
        self.earlier_entries = {str(entry["curve"]): entry for entry in earlier_entries}
        self.entries: list[Entry] = []
        self._order: dict[str, int] = {}  # of the curves, in which processes do not end
        self._write_time = 0.0

    def keep_earlier_entry(self, name: str, source: Entry) -> bool:
        """Whether a curve has an entry of an earlier call, which stays."""
        self._order[name] = len(self._order)
        entry = self.earlier_entries.pop(name, None)
        if entry is None or entry.get("source") != source:
            return False
        self.entries.append(entry)
        return True

    def add_entry(self, entry: Entry) -> None:
        """One more curve; what has been found is on disk soon."""
        self.entries.append(entry)
        if time.monotonic() - self._write_time > SAVE_INTERVAL:
            self.write("running")

    def write(self, status: str) -> None:
        """fit.json and fit.csv as they are known."""
        fits = CurveFits(self.directory, self.request, self.entries)
        code = fits.exit_code if status == "done" else None
        header = {"program": PROGRAM, "version": VERSION, "status": status, "exit_code": code}
        entries = [*self.entries, *(self.earlier_entries.values() if status != "done" else ())]
        text = to_json(
            header | fits.as_json() | {"curves": entries, "request": request_identity(self.request)}
        )
        try:
            write_atomically(self.directory / FIT, text + "\n")
            write_atomically(
                self.directory / FIT_TABLE,
                fit_table.table_of_fits(self.entries, self.request.varied_keys),
            )
        except OSError as error:
            raise write_error(self.directory, error) from error
        self._write_time = time.monotonic()

    def finish(self) -> CurveFits:
        """The whole fit, written, with the picture of many curves."""
        self.entries.sort(key=lambda entry: self._order[str(entry["curve"])])
        fits = CurveFits(self.directory, self.request, self.entries)
        self.write("done" if not fits.exit_code else "failed")
        if self.request.config.output.plot and len(self.entries) > 1:
            from indent_sim.fitting import fit_picture

            fit_picture.draw_parameter_intervals(
                self.entries,
                self.request.varied_keys,
                self.request.config,
                self.directory / FIT_PICTURE,
            )
        return fits


@contextmanager
def _open_locked(directory: Path, request: FitRequest) -> Iterator[list[Entry]]:
    """The folder, locked, and the entries of an earlier call of the same request; UsageError where
    it is another's.
    """
    result_files.refuse_foreign(directory, "fit", (FIT_PICTURE,))
    report = read_report(directory, FIT)
    if report and report.get("request") != _json_roundtrip(request_identity(request)):
        problem = f"{directory} holds the fit of another scene, or of other options"
        raise UsageError(problem, "choose another --output", str(directory))
    created_folders = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / CURVES_FOLDER).mkdir(exist_ok=True)
        lock = os.open(directory / result_files.LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise write_error(directory, error) from error
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(f"{directory} is in use by another fit") from None
        except OSError:
            pass  # a file system without locks: go on without
        yield list(report.get("curves", []))
    finally:
        os.close(lock)
        if created_folders and not (directory / FIT).exists():
            _remove_empty_folders(directory, created_folders)


def _remove_empty_folders(directory: Path, created_folders: Sequence[Path]) -> None:
    """Delete the folder that this call made, and those above it, where nothing came of it."""
    with suppress(OSError):
        (directory / result_files.LOCK).unlink()
        for folder in (directory / CURVES_FOLDER, *created_folders):
            folder.rmdir()


def _json_roundtrip(record: Mapping[str, Any]) -> Any:
    """As it comes back from a file."""
    import json

    return json.loads(to_json(record))


def _read_curves(
    files: Sequence[Path], request: FitRequest, reading: ReadOptions, writer: _Writer
) -> Iterator[tuple[MeasuredCurve | CurveFit, Entry]]:
    """The curves that have no entry yet, in order of the files; a file without any is its own
    reason.
    """
    used_names: set[str] = set()
    for file in files:
        curves: Sequence[MeasuredCurve | CurveFit]
        try:
            curves = read_curves(
                file,
                reading.columns or None,
                reading.units,
                cantilever_stiffness_si(request.config),
            )
        except NoCurve as error:
            curves = [rejected_fit(file.stem, error.problem)]
        except UsageError as error:
            curves = [rejected_fit(file.stem, f"not a curve: {error.problem}")]
        source = _file_identity(file)
        for curve in curves:
            name = _unique_name(curve.name, file, used_names)
            if not writer.keep_earlier_entry(name, source):
                yield _rename_curve(curve, name), source


def _rename_curve(curve: MeasuredCurve | CurveFit, name: str) -> MeasuredCurve | CurveFit:
    return (
        replace(curve, name=name)
        if isinstance(curve, MeasuredCurve)
        else rejected_fit(name, curve.entry["reason"])
    )


def _unique_name(name: str, file: Path, used_names: set[str]) -> str:
    """A name that no other curve has."""
    names = chain([name, file.name], (f"{name}-{k}" for k in count(2)))
    unique_name = next(candidate for candidate in names if candidate not in used_names)
    used_names.add(unique_name)
    return unique_name


def _file_identity(file: Path) -> Entry:
    """What tells a file from a later one of its name."""
    try:
        status = file.stat()
    except OSError:
        return {"file": str(file)}
    return {"file": str(file), "bytes": status.st_size, "modified": status.st_mtime_ns}


def _make_task(
    curve: MeasuredCurve | CurveFit,
    source: Entry,
    directory: Path,
    has_many_files: bool,
    is_plotted: bool,
) -> Any:
    if isinstance(curve, CurveFit):
        return curve.entry | {"source": source}
    picture = (
        (directory / PICTURES / f"{curve.name}.png" if has_many_files else directory / FIT_PICTURE)
        if is_plotted
        else None
    )
    return _FitTask(curve, directory, picture, source)


def _run_tasks(tasks: Iterator[Any], request: FitRequest, jobs: int) -> Iterator[Entry]:
    """The entries of all tasks in their order, those that were refused when they were read among
    them.
    """
    tables = ForwardModelCache()

    def work(task: _FitTask) -> Entry:
        return _fit_and_write(task, request, tables)

    if jobs == 1:
        for task in tasks:
            yield work(task) if isinstance(task, _FitTask) else task
        return
    yield from _run_in_processes(tasks, work, jobs)


def _run_in_processes(
    tasks: Iterator[Any], work: Callable[[_FitTask], Entry], jobs: int
) -> Iterator[Entry]:
    """The entries of tasks that are done so many at a time, each in a process of its own, as they
    come.
    """
    with ExitStack() as stack:
        idle = [ForkedProcess(work, lambda: None, uses_mpi=True) for _ in range(jobs)]
        for process in idle:
            stack.callback(process.stop)
        busy: dict[ForkedProcess, tuple[Callable[[], Any], _FitTask]] = {}
        for task in tasks:
            if not isinstance(task, _FitTask):
                yield task
                continue
            while not idle:
                for process in _ready_processes(busy):
                    idle.append(process)
                    yield _collect_entry(*busy.pop(process))
            process = idle.pop()
            busy[process] = process.begin_call(task), task
        while busy:
            for process in _ready_processes(busy):
                yield _collect_entry(*busy.pop(process))


def _ready_processes(busy: Mapping[ForkedProcess, Any]) -> list[ForkedProcess]:
    """The processes that have an answer, at least one."""
    answered = list(map(id, connection.wait(list(busy))))  # type: ignore[arg-type]
    return [process for process in busy if id(process) in answered]


def _collect_entry(answer: Callable[[], Entry], task: _FitTask) -> Entry:
    try:
        return answer()
    except ProcessCrash as crash:
        return rejected_fit(task.curve.name, f"the process of this curve {crash}").entry | {
            "source": task.source
        }


def _fit_and_write(task: _FitTask, request: FitRequest, tables: ForwardModelCache) -> Entry:
    """Fit one curve, and write what is drawn of it."""
    fit = fit_curve(task.curve, request, tables)
    if fit.plotted is not None:
        table = task.directory / CURVES_FOLDER / f"{fit.name}.csv"
        write_atomically(table, fit_table.table_of_curve(fit.plotted), sync=False)
        if task.picture is not None:
            from indent_sim.fitting import fit_picture

            task.picture.parent.mkdir(exist_ok=True)
            fit_picture.draw_curve(fit, request.config, task.picture)
    return fit.entry | {"source": task.source}


def _progress_line(entry: Entry, number: int) -> str:
    if entry["status"] != "done":
        return f"curve {number}  {entry['curve']}  refused: {entry['reason']}"
    warning_lines = "".join(f"\n  warning: {line}" for line in entry["warnings"])
    return f"curve {number}  {entry['curve']}  {entry['words']}{warning_lines}"
