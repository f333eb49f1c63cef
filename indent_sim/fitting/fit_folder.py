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
    Request,
    fit_curve,
    newtons_per_metre,
    refused,
    request_words,
)
from indent_sim.fitting.scene_curve.parameters import number_at
from indent_sim.fitting.scene_curve.scene_forces import Tables
from indent_sim.process.errors import BackendError, ConfigError, NotConverged, UsageError
from indent_sim.process.forked import Crash, Forked
from indent_sim.process.limits import unwritable
from indent_sim.process.version import VERSION
from indent_sim.results import folder as results
from indent_sim.results.folder import FIT, PROGRAM, read_report, write_atomically
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve
from indent_sim.results.writer import to_json
from indent_sim.run.planned_run import PlannedRun

FIT_TABLE = "fit.csv"
FIT_PICTURE = "fit.png"
CURVES_FOLDER = "curves"
PICTURES = "pictures"
FIT_FILES = (FIT, FIT_TABLE, FIT_PICTURE, CURVES_FOLDER, PICTURES)
SAVED_EVERY = 2.0  # s between two writings of fit.json while curves are fitted
Tell = Callable[[str], None]
Entry = dict[str, Any]


@dataclass(frozen=True)
class Reading:
    """How the files of curves are read: columns by title or number, and units where the files say
    none.
    """

    columns: tuple[str, ...] = ()
    units: Mapping[str, str] | None = None


@dataclass(frozen=True)
class Fits:
    """The fits of some curves: where they lie, and their entries in order of the curves."""

    directory: Path
    request: Request
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
        return {"scene": scene, "vary": list(self.request.keys), "curves": self.entries}


@dataclass(frozen=True)
class _Task:
    """A curve to be fitted, where what is drawn of it goes, and what tells its file from a later
    one.
    """

    curve: MeasuredCurve
    directory: Path
    picture: Path | None
    source: Entry


def fit_all(
    paths: Sequence[Path],
    request: Request,
    directory: Path,
    reading: Reading | None = None,
    jobs: int = 1,
    tell: Tell = lambda line: None,
) -> Fits:
    """Fit a scene to every curve of files and folders, `jobs` at a time, into a folder of its own.

    Raises UsageError for a path that is not there, or a folder that holds something else or the fit
    of another scene; ConfigError for a scene, a key or a column that is wrong; BackendError for AFM
    files without their package. One broken curve is an entry with its reason.
    """
    reading = reading or Reading()
    files = [file for path in paths for file in curve_files(path)]
    for key in request.keys:
        number_at(request.config, key)
    PlannedRun.resolve(request.config)
    with _opened(directory, request) as known:
        writer = _Writer(directory, request, known)
        try:
            curves = _curves(files, request, reading, writer)
            drawn = request.config.output.plot
            several = len(files) > 1
            tasks = (_task(curve, source, directory, several, drawn) for curve, source in curves)
            for entry in _done(tasks, request, jobs):
                writer.add(entry)
                tell(_told(entry, len(writer.entries)))
        except (ConfigError, UsageError, BackendError):
            if writer.entries:
                writer.write("failed")
            raise
        except BaseException:
            writer.write("interrupted")
            raise
        fits = writer.finished()
    return fits


class _Writer:
    """The entries of a fit and its files, written now and then."""

    def __init__(self, directory: Path, request: Request, known: list[Entry]):
        self.directory = directory
        self.request = request
        self.known = {str(entry["curve"]): entry for entry in known}
        self.entries: list[Entry] = []
        self._order: dict[str, int] = {}  # of the curves, in which processes do not end
        self._written = 0.0

    def keeps(self, name: str, source: Entry) -> bool:
        """Whether a curve has an entry of an earlier call, which stays."""
        self._order[name] = len(self._order)
        entry = self.known.pop(name, None)
        if entry is None or entry.get("source") != source:
            return False
        self.entries.append(entry)
        return True

    def add(self, entry: Entry) -> None:
        """One more curve; what has been found is on disk soon."""
        self.entries.append(entry)
        if time.monotonic() - self._written > SAVED_EVERY:
            self.write("running")

    def write(self, status: str) -> None:
        """fit.json and fit.csv as they are known."""
        fits = Fits(self.directory, self.request, self.entries)
        code = fits.exit_code if status == "done" else None
        said = {"program": PROGRAM, "version": VERSION, "status": status, "exit_code": code}
        entries = [*self.entries, *(self.known.values() if status != "done" else ())]
        text = to_json(
            said | fits.as_json() | {"curves": entries, "request": request_words(self.request)}
        )
        try:
            write_atomically(self.directory / FIT, text + "\n")
            write_atomically(
                self.directory / FIT_TABLE, fit_table.table_of_fits(self.entries, self.request.keys)
            )
        except OSError as error:
            raise unwritable(self.directory, error) from error
        self._written = time.monotonic()

    def finished(self) -> Fits:
        """The whole fit, written, with the picture of many curves."""
        self.entries.sort(key=lambda entry: self._order[str(entry["curve"])])
        fits = Fits(self.directory, self.request, self.entries)
        self.write("done" if not fits.exit_code else "failed")
        if self.request.config.output.plot and len(self.entries) > 1:
            from indent_sim.fitting import fit_picture

            fit_picture.draw_many(
                self.entries, self.request.keys, self.request.config, self.directory / FIT_PICTURE
            )
        return fits


@contextmanager
def _opened(directory: Path, request: Request) -> Iterator[list[Entry]]:
    """The folder, locked, and the entries of an earlier call of the same request; UsageError where
    it is another's.
    """
    results.refuse_foreign(directory, "fit", (FIT_PICTURE,))
    before = read_report(directory, FIT)
    if before and before.get("request") != _plain(request_words(request)):
        problem = f"{directory} holds the fit of another scene, or of other options"
        raise UsageError(problem, "choose another --output", str(directory))
    made = [one for one in (directory, *directory.parents) if not one.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / CURVES_FOLDER).mkdir(exist_ok=True)
        lock = os.open(directory / results.LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise unwritable(directory, error) from error
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(f"{directory} is in use by another fit") from None
        except OSError:
            pass  # a file system without locks: go on without
        yield list(before.get("curves", []))
    finally:
        os.close(lock)
        if made and not (directory / FIT).exists():
            _take_away(directory, made)


def _take_away(directory: Path, made: Sequence[Path]) -> None:
    """Delete the folder that this call made, and those above it, where nothing came of it."""
    with suppress(OSError):
        (directory / results.LOCK).unlink()
        for folder in (directory / CURVES_FOLDER, *made):
            folder.rmdir()


def _plain(found: Mapping[str, Any]) -> Any:
    """As it comes back from a file."""
    import json

    return json.loads(to_json(found))


def _curves(
    files: Sequence[Path], request: Request, reading: Reading, writer: _Writer
) -> Iterator[tuple[MeasuredCurve | CurveFit, Entry]]:
    """The curves that have no entry yet, in order of the files; a file without any is its own
    reason.
    """
    taken: set[str] = set()
    for file in files:
        found: Sequence[MeasuredCurve | CurveFit]
        try:
            found = read_curves(
                file, reading.columns or None, reading.units, newtons_per_metre(request.config)
            )
        except NoCurve as error:
            found = [refused(file.stem, error.problem)]
        except UsageError as error:
            found = [refused(file.stem, f"not a curve: {error.problem}")]
        source = _source(file)
        for curve in found:
            name = _own_name(curve.name, file, taken)
            if not writer.keeps(name, source):
                yield _renamed(curve, name), source


def _renamed(curve: MeasuredCurve | CurveFit, name: str) -> MeasuredCurve | CurveFit:
    return (
        replace(curve, name=name)
        if isinstance(curve, MeasuredCurve)
        else refused(name, curve.entry["reason"])
    )


def _own_name(name: str, file: Path, taken: set[str]) -> str:
    """A name that no other curve has."""
    names = chain([name, file.name], (f"{name}-{k}" for k in count(2)))
    own = next(one for one in names if one not in taken)
    taken.add(own)
    return own


def _source(file: Path) -> Entry:
    """What tells a file from a later one of its name."""
    try:
        found = file.stat()
    except OSError:
        return {"file": str(file)}
    return {"file": str(file), "bytes": found.st_size, "modified": found.st_mtime_ns}


def _task(
    curve: MeasuredCurve | CurveFit, source: Entry, directory: Path, several: bool, drawn: bool
) -> Any:
    if isinstance(curve, CurveFit):
        return curve.entry | {"source": source}
    picture = (
        (directory / PICTURES / f"{curve.name}.png" if several else directory / FIT_PICTURE)
        if drawn
        else None
    )
    return _Task(curve, directory, picture, source)


def _done(tasks: Iterator[Any], request: Request, jobs: int) -> Iterator[Entry]:
    """The entries of all tasks in their order, those that were refused when they were read among
    them.
    """
    tables = Tables()

    def work(task: _Task) -> Entry:
        return _carried_out(task, request, tables)

    if jobs == 1:
        for task in tasks:
            yield work(task) if isinstance(task, _Task) else task
        return
    yield from _in_processes(tasks, work, jobs)


def _in_processes(
    tasks: Iterator[Any], work: Callable[[_Task], Entry], jobs: int
) -> Iterator[Entry]:
    """The entries of tasks that are done so many at a time, each in a process of its own, as they
    come.
    """
    with ExitStack() as stack:
        idle = [Forked(work, lambda: None, uses_mpi=True) for _ in range(jobs)]
        for process in idle:
            stack.callback(process.stop)
        busy: dict[Forked, tuple[Callable[[], Any], _Task]] = {}
        for task in tasks:
            if not isinstance(task, _Task):
                yield task
                continue
            while not idle:
                for process in _ready(busy):
                    idle.append(process)
                    yield _answer(*busy.pop(process))
            process = idle.pop()
            busy[process] = process.ask(task), task
        while busy:
            for process in _ready(busy):
                yield _answer(*busy.pop(process))


def _ready(busy: Mapping[Forked, Any]) -> list[Forked]:
    """The processes that have an answer, at least one."""
    answered = list(map(id, connection.wait(list(busy))))  # type: ignore[arg-type]
    return [process for process in busy if id(process) in answered]


def _answer(answer: Callable[[], Entry], task: _Task) -> Entry:
    try:
        return answer()
    except Crash as crash:
        return refused(task.curve.name, f"the process of this curve {crash}").entry | {
            "source": task.source
        }


def _carried_out(task: _Task, request: Request, tables: Tables) -> Entry:
    """Fit one curve, and write what is drawn of it."""
    fit = fit_curve(task.curve, request, tables)
    if fit.drawn is not None:
        table = task.directory / CURVES_FOLDER / f"{fit.name}.csv"
        write_atomically(table, fit_table.table_of_curve(fit.drawn), sync=False)
        if task.picture is not None:
            from indent_sim.fitting import fit_picture

            task.picture.parent.mkdir(exist_ok=True)
            fit_picture.draw_curve(fit, request.config, task.picture)
    return fit.entry | {"source": task.source}


def _told(entry: Entry, number: int) -> str:
    if entry["status"] != "done":
        return f"curve {number}  {entry['curve']}  refused: {entry['reason']}"
    warned = "".join(f"\n  warning: {line}" for line in entry["warnings"])
    return f"curve {number}  {entry['curve']}  {entry['words']}{warned}"
