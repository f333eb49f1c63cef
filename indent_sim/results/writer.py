"""Writer of a result folder, which adds each converged state to the files."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.model.state import State, Surface
from indent_sim.process.errors import NotConverged
from indent_sim.process.limits import DISK_FULL_ERRORS
from indent_sim.process.signals import defer_signals
from indent_sim.process.version import VERSION
from indent_sim.results import atomic_files, checkpoint, output_folder, result_files, tables
from indent_sim.results.atomic_files import (
    append_atomically,
    overwrite_in_place,
    write_atomically,
)
from indent_sim.results.checkpoint import CHECKPOINT, Checkpoint
from indent_sim.results.field_arrays import ARRAYS, OPTIONAL_ARRAYS
from indent_sim.results.field_writer import FieldWriter
from indent_sim.results.json_text import to_json
from indent_sim.results.overwrite_protection import refuse_overwrite
from indent_sim.results.previous_run import PreviousRun, previous_run
from indent_sim.results.result_files import (
    CONFIG,
    PROGRAM,
    REPORT,
    TABLE,
    KeptStates,
    Report,
    read_report,
)
from indent_sim.results.tables import DYNAMIC, EXPERIMENT, SURFACE


class ResultFolder:
    """Writer of the files of one run; a context manager that is used only on rank 0.

    The folder gets its final name with the first row. At the end of the `with` block run.json gets
    the status done, failed or interrupted, depending on the exception. A run that fails before its
    first row does not replace earlier results; a run that ends with exit code 2 or 3 leaves no
    files.

    Parameters
    ----------
    target
        Path of the result folder.
    config_yaml
        The resolved scene, written to config.yaml.
    surface
        The states whose surface is kept in surface.csv.
    columns
        Columns of the force table that not every scene has.
    report
        Entries of run.json. The attribute `report` can be changed until the end of the run.
    resume
        Keep the rows of a previous run of this config (`previous_run`) and append to them.
    guard
        If True, raise UsageError instead of replacing rows of another config file or a finished run
        of another scene. A finished run of the same scene is replaced only at the end of this run.
    mesh
        Content of the config's mesh file, as a sequence of texts.
    """

    def __init__(
        self,
        target: Path,
        config_yaml: str,
        *,
        surface: KeptStates = "last",
        columns: tuple[str, ...] = (),
        report: Report | None = None,
        resume: bool = False,
        guard: bool = False,
        mesh: Iterable[str] = (),
    ):
        self.report: Report = dict(report or {})
        self.rows = 0
        self._target = Path(target)
        self._config_yaml = config_yaml
        self._mesh = mesh
        self._surface = surface
        self._columns = tables.force_columns(columns)
        self.previous_run: PreviousRun | None = None
        self._resume = resume
        self._guard = guard and not resume
        self._appears_at_end = False
        self._fields: FieldWriter | None = None
        # Depth, and lines of the surface table.
        self._deepest_surface = (-math.inf, b"")
        # Time of the last write that waited for the disk, and whether the next write must wait.
        self._last_sync = time.monotonic()
        self._next_write_syncs = False
        # First files of the run that may not be on the disk yet.
        self._unsynced_files: tuple[str, ...] = ()
        self._status: Report = {"status": "running", "exit_code": None, "reason": ""}
        self._started = _utc_time()

    @property
    def path(self) -> Path:
        """Folder that contains the files at present; it changes once, with the first row."""
        return self._output.path

    def __enter__(self) -> ResultFolder:
        with defer_signals():
            self._output = output_folder.OutputFolder(self._target, self._refuse_overwrite)
            self._appears_at_end = (
                self._guard and read_report(self._output.target).get("status") == "done"
            )
            try:
                previous = None
                if self._resume:
                    previous = previous_run(self._output.target, self._config_yaml, self.report)
                with self._convert_write_errors():
                    if previous is not None:
                        self._resume_previous_run(previous)
                        self._write_report()
                    else:  # run.json is written with the first row.
                        self._write_first_files()
            except BaseException:
                self._output.abandon()
                raise
        return self

    def _refuse_overwrite(self, target: Path) -> None:
        """Raise UsageError if this run would replace protected results."""
        if self._guard:
            refuse_overwrite(self._target, self._config_yaml, self.report)

    def _write_first_files(self) -> None:
        """Write config.yaml, the mesh file and the header of the force table."""
        first_files: dict[str, str | Iterable[str]] = {CONFIG: self._config_yaml}
        first_files |= {result_files.MESH_FILE: self._mesh} if self._mesh else {}
        self._unsynced_files = tuple(first_files)
        for name, content in (first_files | {TABLE: ",".join(self._columns) + "\n"}).items():
            write_atomically(self.path / name, content, self._next_write_syncs)

    def _resume_previous_run(self, earlier: PreviousRun) -> None:
        """Continue in the folder of a previous run, after its last complete row."""
        self._output.resume_in_place()
        # An older version of this program may have written fewer columns.
        self._columns = earlier.columns
        os.truncate(self.path / TABLE, earlier.table_bytes)
        tables.drop_later_blocks(self.path / SURFACE, len(earlier.states))
        self.previous_run = earlier
        self.rows = len(earlier.states)
        blocks = tables.surface_blocks(self.path / SURFACE) if self._surface == "last" else {}
        depths = [(earlier.states[step - 1].delta, block) for step, block in blocks.items()]
        self._deepest_surface = max(depths, default=self._deepest_surface)
        writer_entries = {
            "program",
            "version",
            "status",
            "exit_code",
            "reason",
            "rows",
            "started",
            "finished",
        }
        old_entries = {
            name: value for name, value in earlier.report.items() if name not in writer_entries
        }
        self.report = (
            old_entries
            | {"resumed_after": [*old_entries.get("resumed_after", []), self.rows]}
            | self.report
        )
        self._started = earlier.report.get("started", self._started)

    def append(self, state: State) -> None:
        """Add the row of a converged state, with its surface.

        The folder gets its final name with the first row.

        Raises
        ------
        NotConverged
            If the disk is full; earlier rows are kept.
        """
        if not state.converged:
            raise ValueError(
                f"step {state.step} has not converged and is not a result: {state.reason}"
            )
        with defer_signals(), self._convert_write_errors():
            # A power failure loses at most the rows of the last second.
            self._next_write_syncs = time.monotonic() - self._last_sync > 1.0
            if state.surface is not None:
                self._write_surface(state, state.surface)
            append_atomically(
                self.path / TABLE, tables.force_row(state, self._columns), self._next_write_syncs
            )
            if self._next_write_syncs:
                self._sync_files()
            self.rows += 1
            # Writing run.json after each of thousands of quick steps would take longer than the
            # steps.
            if self._next_write_syncs or self.rows == 1:
                self._write_report()
            self._rename_into_place()
            if self._next_write_syncs:
                self._last_sync = time.monotonic()

    def open_fields(
        self,
        *mesh: Any,
        keep: KeptStates,
        extra_arrays: Sequence[str] = (),
        information: Mapping[str, str] | None = None,
    ) -> None:
        """Prepare fields.xdmf, tip.xdmf and fields/ for states on one mesh.

        Parameters
        ----------
        mesh
            Mesh and tip, in the form of the argument `body` of `field_writer.FieldWriter`.
        keep
            The states whose fields are kept.
        extra_arrays
            Names of fields in addition to the fields that every body has.
        information
            Information that the files contain besides the units.
        """
        if keep == "none":
            return
        with defer_signals(), self._convert_write_errors():
            done = self.rows if self.previous_run else None
            arrays = ARRAYS | {name: OPTIONAL_ARRAYS[name] for name in extra_arrays}
            scene_units = self.report.get("units")
            units = {
                f"unit of {kind}": unit
                for kind in ("length", "force")
                if (unit := getattr(scene_units, kind, ""))
            }
            self._fields = FieldWriter(
                self.path,
                *mesh,
                keep=keep,
                done=done,
                arrays=arrays,
                information=units | dict(information or {}),
            )
            if self.previous_run and keep == "all" and not self._fields.is_continued:
                warning = (
                    f"the fields of steps 1 to {self.rows} are missing: "
                    "only those of later steps are kept"
                )
                self.report["warnings"] = [*self.report.get("warnings", []), warning]

    def write_fields(
        self, state: State, fields: Mapping[str, np.ndarray], time: float | None = None
    ) -> None:
        """Write the fields of a state; to be called before its `append`.

        Nothing is written without `open_fields`. `time` is the time of the state; if it is None,
        the step is used as the time.
        """
        if self._fields is None:
            return
        with defer_signals(), self._convert_write_errors():
            self._fields.write(state.step, state.delta, fields, time, state.x or 0.0)

    def write_experiment(self, rows: Sequence[Any], dynamic: Sequence[Any]) -> None:
        """Write experiment.csv and dynamic.csv, or delete a file that would have no rows."""
        with defer_signals(), self._convert_write_errors():
            for name, items in ((EXPERIMENT, rows), (DYNAMIC, dynamic)):
                if items:
                    write_atomically(self.path / name, tables.csv_table(items))
                else:
                    (self.path / name).unlink(missing_ok=True)

    def save_checkpoint(self, saved: Checkpoint, identity: Report) -> None:
        """Save the last equilibria for `--resume`; nothing is saved if the disk is full."""
        with defer_signals(), suppress(OSError):
            checkpoint.write(self.path / CHECKPOINT, saved, identity)

    def read_checkpoint(self, identity: Report) -> Checkpoint:
        """Return the last equilibria of the run that is continued; empty if they cannot be used."""
        return checkpoint.read(self.path / CHECKPOINT, identity)

    def finish(self, error: BaseException | None) -> None:
        """Record how the run ended; further calls have no effect."""
        if self._status["status"] == "running":
            self._status = dict(
                zip(("status", "exit_code", "reason"), final_status(error), strict=True)
            )

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.finish(error)
        self._next_write_syncs = True
        with defer_signals():
            try:
                is_done = self._status["status"] == "done"
                if self._appears_at_end:
                    is_worth_keeping = is_done
                else:
                    is_worth_keeping = self.rows > 0 or not self._output.replaces_results
                self._appears_at_end = False
                if not self._output.is_in_place and (
                    self._status["exit_code"] in (2, 3) or not is_worth_keeping
                ):
                    self._output.abandon()
                    return
                if is_done:
                    (self.path / CHECKPOINT).unlink(missing_ok=True)
                with self._convert_write_errors() if error is None else suppress(OSError):
                    try:
                        self._sync_files(TABLE)
                    finally:
                        self._write_report()
                    self._rename_into_place()
            finally:
                self._output.release_lock()

    def _sync_files(self, *names: str) -> None:
        """Wait until the given files and the first files of the run are on the disk."""
        for name in (*self._unsynced_files, *names):
            atomic_files.sync_to_disk(self.path / name)
        self._unsynced_files = ()

    def _rename_into_place(self) -> None:
        """Give the folder its final name as soon as it has a row."""
        if self._output.is_in_place or self._appears_at_end:
            return
        self._output.rename_into_place()
        if self._fields is not None:
            self._fields.directory = self.path

    def _write_report(self) -> None:
        """Write run.json."""
        ended = {} if self._status["status"] == "running" else {"finished": _utc_time()}
        identity = {"program": PROGRAM, "version": VERSION, **self._status, "rows": self.rows}
        report = {**identity, "started": self._started, **ended, **self.report}
        try:
            write_atomically(self.path / REPORT, to_json(report) + "\n", self._next_write_syncs)
        except OSError as error:
            if error.errno not in DISK_FULL_ERRORS or self._status["status"] in ("running", "done"):
                raise
            # A full disk has no space for a second file. The last report on one line, with the end
            # of the run, is shorter than the file.
            last_report = read_report(self.path) | identity | ended
            overwrite_in_place(self.path / REPORT, to_json(last_report, indent=None).encode())

    def _write_surface(self, state: State, surface: Surface) -> None:
        """Write the surface of a state, if the key `output.surface` requests it.

        With "all", surfaces of all states are appended to the table. With "last", only the surfaces
        of the deepest and the last state are kept.
        """
        path = self.path / SURFACE
        block = tables.surface_block(state.step, surface)
        if self._surface == "all" and path.exists():
            append_atomically(path, block, self._next_write_syncs)
        elif self._surface != "none":
            depth, deepest = self._deepest_surface
            text = (
                tables.surface_header(surface) + (deepest if depth > state.delta else b"") + block
            )
            write_atomically(path, text, self._next_write_syncs)
            if state.delta >= depth:
                self._deepest_surface = (state.delta, block)

    @contextmanager
    def _convert_write_errors(self) -> Iterator[None]:
        """Raise NotConverged for a failed write; the run then ends with its present rows."""
        try:
            yield
        except OSError as error:
            if self._appears_at_end:
                kept_text = f"the finished run in {self._output.target} is unchanged"
            elif self.rows:
                kept_text = f"{self.rows} rows are kept in {self._output.target}"
            else:
                kept_text = "no row is kept"
            raise NotConverged(
                f"cannot write results: {error.strerror or error}; {kept_text}"
            ) from error


def final_status(error: BaseException | None) -> tuple[str, int, str]:
    """Return status, exit code and reason of a run; `error` is the exception that ended it."""
    if error is None:
        return "done", 0, ""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted", getattr(error, "exit_code", 130), str(error) or "interrupted"
    code = getattr(error, "exit_code", 1)
    return "failed", code, str(error) if code != 1 else f"{type(error).__name__}: {error}"


def _utc_time() -> str:
    """Return the present time as ISO 8601 text in UTC."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
