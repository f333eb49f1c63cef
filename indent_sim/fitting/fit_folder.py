"""Fit of many measured curves into a folder with fit.json, tables and pictures.

A call with the same folder continues with the curves that have no entry or whose file has changed.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.fitting import fit_table
from indent_sim.fitting.curve_fit import (
    CurveFit,
    FitRequest,
    cantilever_stiffness_si,
    fit_curve,
    format_value,
    rejected_fit,
    request_identity,
)
from indent_sim.fitting.forward_model.cone_loop import HARDENING_KEY, refuse_other_scenes
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import number_at
from indent_sim.fitting.inference.model_assessment import Interval
from indent_sim.fitting.joint_fit import fit_together, scenes_of_tips
from indent_sim.fitting.measured_constants import LOOP_NODES, LOOP_SECONDS
from indent_sim.process.child_process import ChildProcess, ProcessCrash, run_calls
from indent_sim.process.errors import (
    BackendError,
    ConfigError,
    NotConverged,
    UsageError,
    printable,
)
from indent_sim.process.file_locks import lock_file
from indent_sim.process.limits import write_error
from indent_sim.process.regular_files import FORBIDDEN_IN_NAMES, open_descriptor
from indent_sim.process.version import VERSION
from indent_sim.results import result_files
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve
from indent_sim.results.result_files import CURVES_FOLDER, FIT, PROGRAM, read_report
from indent_sim.run.planned_run import PlannedRun
from indent_sim.run.solvers.elastic_curve import is_self_similar

FIT_TABLE = "fit.csv"
FIT_PICTURE = "fit.png"
PICTURES = "pictures"
MAP_FIELDS = "map.h5"
MAP_TABLE = "map.csv"
MAP_PICTURE = "map.png"
MAP_PROGRESS = "progress.h5"
FIT_FILES = (
    FIT,
    FIT_TABLE,
    FIT_PICTURE,
    CURVES_FOLDER,
    PICTURES,
    MAP_FIELDS,
    MAP_TABLE,
    MAP_PICTURE,
)
IMAGE_SUFFIXES = (".gsf", ".tif")  # images of a map: the varied key, and the height of the surface
ReportLine = Callable[[str], None]
Entry = dict[str, Any]


@dataclass(frozen=True)
class ReadOptions:
    """Options for reading curve files.

    Attributes
    ----------
    columns
        Columns as "role=title" or "role=number", or the titles or numbers of the columns of depth,
        force and time, in this order.
    units
        Units of a file without units.
    sensitivity
        Length per voltage of deflections in volts, such as 50 nm/V.
    """

    columns: tuple[str, ...] = ()
    units: Mapping[str, str] | None = None
    sensitivity: str | None = None

    def identity(self) -> Entry:
        """Return the given options, by which an earlier fit with the same options is recognised."""
        given = {"columns": list(self.columns), "units": dict(self.units or {})}
        return {
            name: value
            for name, value in (given | {"sensitivity": self.sensitivity}).items()
            if value
        }


@dataclass(frozen=True)
class CurveFits:
    """Fits of several curves: the folder, and the entries in the order of the curves."""

    directory: Path
    request: FitRequest
    entries: list[Entry]

    @property
    def exit_code(self) -> int:
        """Exit code: 0 if at least one curve was fitted, else 5."""
        is_any_done = any(entry["status"] == "done" for entry in self.entries)
        return 0 if is_any_done else NotConverged.exit_code

    def as_json(self) -> Entry:
        """Return scene, varied keys, units of fit.csv and entries as written to fit.json."""
        config = self.request.config
        keys = self.request.varied_keys
        return {
            "scene": str(config.source.name),
            "vary": list(keys),
            "units": fit_table.column_units(fit_table.fit_columns(keys), keys, config),
            "curves": self.entries,
        }


@dataclass(frozen=True)
class _FitTask:
    """Curve to be fitted, with the paths of its output and the `source` of its entry."""

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
    """Fit a scene to every curve of some files and folders.

    Parameters
    ----------
    paths
        Files of curves, or folders with such files.
    request
        The scene and the settings of the fit.
    directory
        Folder of the fit.
    reading
        Options for reading the files.
    jobs
        Number of curves that are fitted at the same time.
    tell
        Function that is called with each line of progress.

    Returns
    -------
    CurveFits
        The entries; a curve that cannot be fitted has an entry with the reason.

    Raises
    ------
    UsageError
        If a path does not exist, or the folder contains something else.
    ConfigError
        If the scene, a key or a column is invalid.
    BackendError
        If a package for AFM files is missing.
    """
    reading = reading or ReadOptions()
    files = [file for path in paths for file in curve_files(path)]
    for key in request.varied_keys:
        number_at(request.config, key)
    tell_cost(request, tell)
    if request.other_tips:
        scenes_of_tips(request)
        if jobs > 1:
            raise UsageError("--jobs: the curves of several tips are one fit", "leave it out")
    with open_locked(directory, request_identity(request)) as earlier_entries:
        writer = _Writer(directory, request, earlier_entries)
        try:
            curves = _read_curves(files, request, reading, writer)
            is_plotted = request.config.output.plot
            has_many_files = len(files) > 1
            tasks = (
                _make_task(curve, source, directory, has_many_files, is_plotted)
                for curve, source in curves
            )
            entries = (
                _fit_tips_together(list(tasks), request)
                if request.other_tips
                else _run_tasks(tasks, request, jobs)
            )
            for entry in entries:
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
    if len(fits.entries) > 1:
        tell(_summary_line(fits))
    return fits


def fit_files(folder: Path) -> tuple[str, ...]:
    """Return the names of all files and folders that a fit writes, with the images of a map."""
    keys = read_report(folder, FIT).get("vary", [])
    names = (*(str(key).rpartition(".")[2] for key in keys), "height")
    return (*FIT_FILES, *(f"{name}{suffix}" for name in names for suffix in IMAGE_SUFFIXES))


def tell_cost(request: FitRequest, tell: ReportLine) -> None:
    """Report that the forces of the scene come from finite elements, and how long a run takes.

    Raises ConfigError if the scene is not valid, or has no such forces.
    """
    if request.config.yields:
        refuse_other_scenes(request.config, tuple(request.varied_keys))
        return tell(loop_cost(request.varied_keys, 1 + len(request.other_tips)))
    if request.surrogate is not None:
        return
    planned_run = PlannedRun.resolve(request.config)
    if not planned_run.scene.is_meshed:
        return
    count = "at most one is needed" if is_self_similar(request.config) else "one or more are needed"
    seconds = planned_run.study_seconds(error_bars=True)
    tell(f"a solution by finite elements takes about {seconds:.2g} s of CPU time; {count}")


def loop_cost(keys: Sequence[str], tips: int = 1) -> str:
    """Return a sentence about the runs that the fit of a body that yields needs."""
    count = tips * (LOOP_NODES**2 if HARDENING_KEY in keys else LOOP_NODES)
    return (
        f"the table of loops needs {count} to {2 * count} runs of about {LOOP_SECONDS:g} s of CPU "
        "time each, which all curves share"
    )


class _Writer:
    """Writer of fit.json and fit.csv, which are updated every few seconds with all entries."""

    def __init__(self, directory: Path, request: FitRequest, earlier_entries: list[Entry]):
        self.directory = directory
        self.request = request
        self.earlier_entries = {str(entry["curve"]): entry for entry in earlier_entries}
        self.entries: list[Entry] = []
        # positions of the curves; parallel processes end in another order
        self._order: dict[str, int] = {}
        self._write_time = 0.0

    def keep_earlier_entry(self, name: str, source: Entry) -> bool:
        """Keep the entry of an earlier call for an unchanged file; return True if there is one."""
        self._order[name] = len(self._order)
        entry = self.earlier_entries.pop(name, None)
        if entry is None or entry.get("source") != source:
            return False
        self.entries.append(entry)
        return True

    def add_entry(self, entry: Entry) -> None:
        """Add an entry, and write the files if they were last written some seconds ago."""
        self.entries.append(entry)
        # Time [s] between two writings of fit.json while curves are fitted.
        save_interval = 2.0
        if time.monotonic() - self._write_time > save_interval:
            self.write("running")

    def write(self, status: str) -> None:
        """Write fit.json and fit.csv with the entries so far."""
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
        """Write the finished fit, with the overview picture of several curves."""
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
def open_locked(directory: Path, identity: Mapping[str, Any]) -> Iterator[list[Entry]]:
    """Lock the folder, and yield the entries of an earlier call with the same settings.

    Raises
    ------
    UsageError
        If the folder contains something else.
    """
    result_files.refuse_foreign(directory, "fit", (FIT_PICTURE,))
    report = read_report(directory, FIT)
    if report and report.get("request") != _json_roundtrip(identity):
        problem = f"{directory} contains the fit of another scene or with other options"
        raise UsageError(problem, "choose another --output", str(directory))
    created_folders = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / CURVES_FOLDER).mkdir(exist_ok=True)
        lock = open_descriptor(directory / result_files.LOCK, os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise write_error(directory, error) from error
    try:
        try:
            lock_file(lock)
        except BlockingIOError:
            raise UsageError(f"{directory} is in use by another fit") from None
        yield list(report.get("curves", []))
    finally:
        os.close(lock)
        if created_folders and not (directory / FIT).exists():
            _remove_empty_folders(directory, created_folders)


def _remove_empty_folders(directory: Path, created_folders: Sequence[Path]) -> None:
    """Delete the folders that this call has created, if they are empty."""
    with suppress(OSError):
        (directory / result_files.LOCK).unlink()
        for folder in (directory / CURVES_FOLDER, *created_folders):
            folder.rmdir()


def _json_roundtrip(record: Mapping[str, Any]) -> Any:
    """Return a record as it would be after writing it to a JSON file and reading it again."""
    import json

    return json.loads(to_json(record))


def _read_curves(
    files: Sequence[Path], request: FitRequest, reading: ReadOptions, writer: _Writer
) -> Iterator[tuple[MeasuredCurve | CurveFit, Entry]]:
    """Yield the curves without an entry; a file without curves yields one rejected curve."""
    used_names: set[str] = set()
    for file in files:
        curves: Sequence[MeasuredCurve | CurveFit]
        try:
            curves = read_curves(
                file,
                reading.columns or None,
                reading.units,
                cantilever_stiffness_si(request.config),
                reading.sensitivity,
            )
        except NoCurve as error:
            curves = [rejected_fit(file.stem, error.problem)]
        except UsageError as error:
            curves = [rejected_fit(file.stem, f"not a curve: {error.problem}")]
        except BackendError as error:
            # A file of another kind in a folder does not end the fit of the others.
            if len(files) == 1:
                raise
            curves = [rejected_fit(file.stem, str(error))]
        source = _file_identity(file) | reading.identity()
        for index in range(len(curves)):
            curve = _curve_or_rejection(curves, index, file)
            name = _unique_name(_file_name(curve.name), file, used_names)
            if not writer.keep_earlier_entry(name, source):
                yield _rename_curve(curve, name), source


def _curve_or_rejection(
    curves: Sequence[MeasuredCurve | CurveFit], index: int, file: Path
) -> MeasuredCurve | CurveFit:
    """Return a curve of a file; if a curve of a map is damaged, return it as a rejected curve."""
    try:
        return curves[index]
    except NoCurve as error:
        return rejected_fit(f"{file.stem}-{index}", error.problem)


def _rename_curve(curve: MeasuredCurve | CurveFit, name: str) -> MeasuredCurve | CurveFit:
    return (
        replace(curve, name=name)
        if isinstance(curve, MeasuredCurve)
        else rejected_fit(name, curve.entry["reason"])
    )


def _file_name(name: str) -> str:
    """Return the name of a curve as a file name: printable, and not too long."""
    # File systems allow 255 bytes, of which suffixes and names of temporary files need some.
    max_bytes = 200
    text = printable(name)
    for character in FORBIDDEN_IN_NAMES:
        text = text.replace(character, "_")
    return text.encode()[:max_bytes].decode(errors="ignore")


def _unique_name(name: str, file: Path, used_names: set[str]) -> str:
    """Return a name that no other curve has."""
    names = chain([name, _file_name(file.name)], (f"{name}-{k}" for k in count(2)))
    unique_name = next(candidate for candidate in names if candidate not in used_names)
    used_names.add(unique_name)
    return unique_name


def _file_identity(file: Path) -> Entry:
    """Return the properties of a file by which a later change is detected."""
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
    picture = None
    if is_plotted and has_many_files:
        picture = directory / PICTURES / f"{curve.name}.png"
    elif is_plotted:
        picture = directory / FIT_PICTURE
    return _FitTask(curve, directory, picture, source)


def _run_tasks(tasks: Iterator[Any], request: FitRequest, jobs: int) -> Iterator[Entry]:
    """Yield the entries of all tasks; a curve rejected while reading already has its entry."""
    if jobs > 1:
        yield from _run_in_processes(tasks, request, jobs)
        return
    tables = ForwardModelCache(request.surrogate)
    for task in tasks:
        yield _fit_and_write(task, request, tables) if isinstance(task, _FitTask) else task


def _fit_tips_together(tasks: Sequence[Any], request: FitRequest) -> list[Entry]:
    """Fit one curve of each tip together, and return their entries.

    Raises UsageError if the curves are not one for each tip.
    """
    # An earlier call has fitted all of them.
    if not tasks:
        return []
    count = 1 + len(request.other_tips)
    if len(tasks) != count:
        raise UsageError(
            f"the scene and --other-tip are {count} tips, and {len(tasks)} of the curves have no "
            "fit yet",
            "give one curve for each tip, the one of the scene first, and a new --output",
        )
    if unread := [task for task in tasks if not isinstance(task, _FitTask)]:
        raise UsageError(f"{unread[0]['curve']}: {unread[0]['reason']}")
    fits = fit_together([task.curve for task in tasks], request, ForwardModelCache())
    return [_write_fit(task, fit, request) for task, fit in zip(tasks, fits, strict=True)]


def _run_in_processes(tasks: Iterator[Any], request: FitRequest, jobs: int) -> Iterator[Entry]:
    """Yield the entries of tasks that run in parallel, each as soon as it has ended."""
    rejected: list[Entry] = []

    def calls() -> Iterator[tuple[_FitTask, Callable[..., Entry], tuple[Any, ...]]]:
        for task in tasks:
            if isinstance(task, _FitTask):
                yield task, _fit_in_child, (task, request)
            else:
                rejected.append(task)

    with ExitStack() as stack:
        processes = [ChildProcess(__name__) for _ in range(jobs)]
        for process in processes:
            stack.callback(process.stop)
        for task, answer in run_calls(processes, calls()):
            yield _collect_entry(answer, task)
            while rejected:
                yield rejected.pop()
    yield from rejected


def _fit_in_child(task: _FitTask, request: FitRequest) -> Entry:
    """Fit one curve in a child process, which keeps its forward models for later curves.

    Forward models of a surrogate are computed for each curve, since they cost little.
    """
    tables = ForwardModelCache(request.surrogate) if request.surrogate else _forward_models()
    return _fit_and_write(task, request, tables)


@cache
def _forward_models() -> ForwardModelCache:
    """Return the cache of forward models of this process."""
    return ForwardModelCache()


def _collect_entry(answer: Callable[[], Entry], task: _FitTask) -> Entry:
    try:
        return answer()
    except ProcessCrash as crash:
        return rejected_fit(task.curve.name, f"the process of this curve {crash}").entry | {
            "source": task.source
        }


def _fit_and_write(task: _FitTask, request: FitRequest, tables: ForwardModelCache) -> Entry:
    """Fit one curve, and write its table and picture."""
    return _write_fit(task, fit_curve(task.curve, request, tables), request)


def _write_fit(task: _FitTask, fit: CurveFit, request: FitRequest) -> Entry:
    """Write the table and the picture of a fitted curve, and return its entry."""
    if fit.plotted is not None:
        table = task.directory / CURVES_FOLDER / f"{fit.name}.csv"
        write_atomically(table, fit_table.table_of_curve(fit.plotted), sync=False)
        if task.picture is not None:
            from indent_sim.fitting import fit_picture

            task.picture.parent.mkdir(exist_ok=True)
            fit_picture.draw_curve(fit, request.config, task.picture)
    return fit.entry | {"source": task.source}


def _summary_line(fits: CurveFits) -> str:
    """Return counts of fitted and rejected curves, the reasons, and values of the first key."""
    done = [entry for entry in fits.entries if entry["status"] == "done"]
    reasons = Counter(str(entry["reason"]) for entry in fits.entries if entry["status"] != "done")
    text = f"{len(fits.entries)} curves: {len(done)} fitted"
    if reasons:
        causes = ", ".join(f"{reason} ({count})" for reason, count in reasons.most_common())
        text += f", {reasons.total()} refused: {causes}"
    if done and fits.request.varied_keys:
        key = fits.request.varied_keys[0]
        values = [float(entry["parameters"][key]["value"]) for entry in done]
        quartiles = [float(value) for value in np.percentile(values, [25, 50, 75])]
        interval = Interval(quartiles[1], quartiles[0], quartiles[2])
        low, median, high = (
            format_value(key, fits.request.config, value, interval) for value in quartiles
        )
        text += f"; {key} = {median} in the median, {low} to {high} for the middle half"
    return text


def _progress_line(entry: Entry, number: int) -> str:
    if entry["status"] != "done":
        return f"curve {number}  {entry['curve']}  refused: {entry['reason']}"
    warning_lines = "".join(f"\n  warning: {line}" for line in entry["warnings"])
    return f"curve {number}  {entry['curve']}  {entry['words']}{warning_lines}"
