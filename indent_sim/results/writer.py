"""States -> the files of a result folder."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from json.encoder import encode_basestring
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np

from indent_sim.model.state import DERIVED_COLUMNS, STATE_COLUMNS, State, Surface
from indent_sim.process.errors import NotConverged
from indent_sim.process.signals import uninterrupted
from indent_sim.process.version import VERSION
from indent_sim.results import checkpoint, folder, tables
from indent_sim.results.checkpoint import CHECKPOINT, Checkpoint
from indent_sim.results.folder import (
    CONFIG,
    PROGRAM,
    REPORT,
    TABLE,
    Keep,
    Report,
    append_whole,
    read_report,
    write_atomically,
)
from indent_sim.results.reader import Earlier, earlier_run
from indent_sim.results.replacing import refuse_to_lose
from indent_sim.results.tables import DYNAMIC, EXPERIMENT, SURFACE
from indent_sim.results.xdmf import ARRAYS, MORE_ARRAYS, FieldWriter

ENCODER = json.JSONEncoder(allow_nan=False, ensure_ascii=False)
OWN_ENTRIES = {"program", "version", "status", "exit_code", "reason", "rows", "started", "finished"}


class ResultFolder:
    """The files of one run, written as its states come; a context manager, used on rank 0 alone.

    columns: those of the force table beyond `STATE_COLUMNS` that this run has. mesh: the config's
    mesh file, as text in parts. The folder appears under its name with the first row. `report`
    becomes run.json. Leaving the block ends the run: status done, failed or interrupted after the
    exception that passes through. A run that fails before its first row replaces no earlier
    results; one that ends with exit code 2 or 3 leaves nothing. With `resume` the rows of this
    config that are there stay (`earlier`), and the run goes on behind them. With `guard` rows of
    another config file and a finished run of another scene are not replaced (UsageError), and a
    finished run of the same scene is replaced when this one is done: one that is not leaves it as
    it was.
    """

    def __init__(
        self,
        target: Path,
        config_yaml: str,
        *,
        surface: Keep = "last",
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
        self._columns = tables.in_order((*STATE_COLUMNS, *DERIVED_COLUMNS, *columns))
        self.earlier: Earlier | None = None
        self._resume = resume
        self._guard = guard and not resume
        self._awaits_end = False
        self._fields: FieldWriter | None = None
        self._deepest = (-math.inf, b"")  # depth, and lines of the surface table
        # when last, and whether the next write waits for the disk
        self._synced = time.monotonic()
        self._sync = False
        self._begun: tuple[str, ...] = ()  # what was given, in files that were not waited for yet
        self._status: Report = {"status": "running", "exit_code": None, "reason": ""}
        self._started = _now()

    @property
    def path(self) -> Path:
        """Where the files are now; changes once, with the first row."""
        return self._claim.path

    def __enter__(self) -> ResultFolder:
        with uninterrupted():
            self._claim = folder.Claim(self._target, self._refuse_to_lose)
            self._awaits_end = (
                self._guard and read_report(self._claim.target).get("status") == "done"
            )
            try:
                found = (
                    earlier_run(self._claim.target, self._config_yaml, self.report)
                    if self._resume
                    else None
                )
                with self._writing():
                    if found is not None:
                        self._continue(found)
                        self._save_report()
                    else:  # run.json comes with the first row
                        self._begin()
            except BaseException:
                self._claim.drop()
                raise
        return self

    def _refuse_to_lose(self, target: Path) -> None:
        """UsageError where this run would replace what is to be kept."""
        if self._guard:
            refuse_to_lose(self._target, self._config_yaml, self.report)

    def _begin(self) -> None:
        """Write what was given, and the head of the table."""
        given: dict[str, str | Iterable[str]] = {CONFIG: self._config_yaml}
        given |= {folder.MESH_FILE: self._mesh} if self._mesh else {}
        self._begun = tuple(given)
        for name, content in (given | {TABLE: ",".join(self._columns) + "\n"}).items():
            write_atomically(self.path / name, content, self._sync)

    def _continue(self, earlier: Earlier) -> None:
        self._claim.adopt()
        self._columns = earlier.columns  # those of an older version of this program may be fewer
        os.truncate(self.path / TABLE, earlier.size)
        tables.drop_later_blocks(self.path / SURFACE, len(earlier.states))
        self.earlier = earlier
        self.rows = len(earlier.states)
        blocks = tables.surface_blocks(self.path / SURFACE) if self._surface == "last" else {}
        depths = [(earlier.states[step - 1].delta, block) for step, block in blocks.items()]
        self._deepest = max(depths, default=self._deepest)
        kept = {name: value for name, value in earlier.report.items() if name not in OWN_ENTRIES}
        self.report = (
            kept | {"resumed_after": [*kept.get("resumed_after", []), self.rows]} | self.report
        )
        self._started = earlier.report.get("started", self._started)

    def append(self, state: State) -> None:
        """Add the row of a converged state, with its surface; the first row publishes the folder.

        Raises NotConverged when the disk is full; the rows before are kept.
        """
        if not state.converged:
            raise ValueError(
                f"step {state.step} has not converged and is no result: {state.reason}"
            )
        with uninterrupted(), self._writing():
            self._sync = time.monotonic() - self._synced > 1.0  # s that a power failure may cost
            if state.surface is not None:
                self._write_surface(state, state.surface)
            append_whole(self.path / TABLE, tables.row(state, self._columns), self._sync)
            if self._sync:
                self._settle()
            self.rows += 1
            if (
                self._sync or self.rows == 1
            ):  # of thousands of quick steps it would cost more than they do
                self._save_report()
            self._publish()
            if self._sync:
                self._synced = time.monotonic()

    def open_fields(
        self,
        *mesh: Any,
        keep: Keep,
        more: Sequence[str] = (),
        told: Mapping[str, str] | None = None,
    ) -> None:
        """Prepare fields.xdmf, tip.xdmf and fields/ for states of a mesh and a tip (see
        `xdmf.FieldWriter`).

        more: names of fields beyond those of every body. told: what the files say beside the units.
        """
        if keep == "none":
            return
        with uninterrupted(), self._writing():
            done = self.rows if self.earlier else None
            arrays = ARRAYS | {name: MORE_ARRAYS[name] for name in more}
            named = self.report.get("units")
            units = {
                f"unit of {kind}": unit
                for kind in ("length", "force")
                if (unit := getattr(named, kind, ""))
            }
            self._fields = FieldWriter(
                self.path, *mesh, keep=keep, done=done, arrays=arrays, told=units | dict(told or {})
            )
            if self.earlier and keep == "all" and not self._fields.continued:
                lost = (
                    f"the fields of steps 1 to {self.rows} were lost: "
                    "those of the steps after them "
                    "alone are kept"
                )
                self.report["warnings"] = [*self.report.get("warnings", []), lost]

    def write_fields(
        self, state: State, fields: Mapping[str, np.ndarray], time: float | None = None
    ) -> None:
        """Write the fields of a state at a time [its step]; call before its `append`.

        Nothing happens without `open_fields`.
        """
        if self._fields is None:
            return
        with uninterrupted(), self._writing():
            self._fields.write(state.step, state.delta, fields, time)

    def write_experiment(self, rows: Sequence[Any], dynamic: Sequence[Any]) -> None:
        """Write experiment.csv, and dynamic.csv where there is one; of a run before what is not
        written now goes.
        """
        with uninterrupted(), self._writing():
            for name, items in ((EXPERIMENT, rows), (DYNAMIC, dynamic)):
                if items:
                    write_atomically(self.path / name, tables.table_of(items))
                else:
                    (self.path / name).unlink(missing_ok=True)

    def save_checkpoint(self, saved: Checkpoint, identity: Report) -> None:
        """Keep the last equilibria for `--resume`, which can do without: a full disk is no failure
        here.
        """
        with uninterrupted(), suppress(OSError):
            checkpoint.write(self.path / CHECKPOINT, saved, identity)

    def read_checkpoint(self, identity: Report) -> Checkpoint:
        """The last equilibria of the run that is continued; an empty one when they are of no use."""
        return checkpoint.read(self.path / CHECKPOINT, identity)

    def finish(self, error: BaseException | None) -> None:
        """Say how the run ended; the first word counts."""
        if self._status["status"] == "running":
            self._status = dict(zip(("status", "exit_code", "reason"), _ending(error), strict=True))

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.finish(error)
        self._sync = True
        with uninterrupted():
            try:
                is_done = self._status["status"] == "done"
                worth = (
                    is_done if self._awaits_end else self.rows or not self._claim.replaces_results
                )
                self._awaits_end = False
                if not self._claim.published and (self._status["exit_code"] in (2, 3) or not worth):
                    self._claim.drop()
                    return
                self._claim.give_ballast()
                if is_done:
                    (self.path / CHECKPOINT).unlink(missing_ok=True)
                with self._writing() if error is None else suppress(OSError):
                    try:
                        self._settle(TABLE)
                    finally:
                        self._save_report()
                    self._publish()
            finally:
                self._claim.release()

    def _settle(self, *names: str) -> None:
        """Wait until the disk has these files, and what was given."""
        for name in (*self._begun, *names):
            folder.wait_for_disk(self.path / name)
        self._begun = ()

    def _publish(self) -> None:
        if self._claim.published or self._awaits_end:
            return
        self._claim.publish()
        if self._fields is not None:
            self._fields.directory = self.path

    def _save_report(self) -> None:
        ended = {} if self._status["status"] == "running" else {"finished": _now()}
        identity = {"program": PROGRAM, "version": VERSION, **self._status, "rows": self.rows}
        report = {**identity, "started": self._started, **ended, **self.report}
        write_atomically(self.path / REPORT, to_json(report) + "\n", self._sync)

    def _write_surface(self, state: State, surface: Surface) -> None:
        """Every state's surface, or those of the deepest and of the last."""
        path = self.path / SURFACE
        block = tables.surface_block(state.step, surface)
        if self._surface == "all" and path.exists():
            append_whole(path, block, self._sync)
        elif self._surface != "none":
            depth, deepest = self._deepest
            shown = (
                tables.surface_header(surface) + (deepest if depth > state.delta else b"") + block
            )
            write_atomically(path, shown, self._sync)
            if state.delta >= depth:
                self._deepest = (state.delta, block)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """A write that fails ends the run with what it has."""
        try:
            yield
        except OSError as error:
            kept = (
                f"{self.rows} rows are kept in {self._claim.target}"
                if self.rows
                else "no row is kept"
            )
            if self._awaits_end:
                kept = f"the finished run in {self._claim.target} is as it was"
            raise NotConverged(
                f"cannot write results: {error.strerror or error}; {kept}"
            ) from error


def to_json(value: Any, indent: int | None = 2) -> str:
    """Strict JSON: what is not finite becomes null; dataclasses, paths and numpy numbers become
    plain.
    """
    shown = plain(value)
    text = ENCODER.encode(shown) if indent is None else _in_lines(shown, "\n", " " * indent)
    return re.sub(
        "[\ud800-\udfff]", lambda lone: f"\\u{ord(lone.group()):04x}", text
    )  # of a file name in no encoding


def _in_lines(value: Any, line: str, step: str) -> str:
    """JSON with a line for each entry of a mapping and of a list of such, which json itself writes
    slowly.
    """
    kind = type(value)
    if kind is str:
        return encode_basestring(value)
    if kind is float or kind is int:
        return repr(value)
    inner = line + step
    if kind is dict and value:
        parts = [
            f"{encode_basestring(key)}: {_in_lines(part, inner, step)}"
            for key, part in value.items()
        ]
        return f"{{{inner}{f',{inner}'.join(parts)}{line}}}"
    if kind is list and any(type(part) in (dict, list) for part in value):
        return f"[{inner}{f',{inner}'.join(_in_lines(part, inner, step) for part in value)}{line}]"
    return ENCODER.encode(value)


def plain(value: Any) -> Any:
    """The same as numbers, words, lists and dictionaries; None for a number that is not finite."""
    kind = type(value)
    if kind in (str, int, bool, NoneType):
        return value
    if kind is float:
        return value if math.isfinite(value) else None
    if kind is tuple or kind is list:
        return [plain(part) for part in value]
    match value:  # what is rarer
        case Mapping():
            return {str(key): plain(part) for key, part in value.items()}
        case str() | int():
            return value
        case np.generic() | np.ndarray():
            return plain(value.tolist())
        case float():
            return plain(float(value))
        case list() | tuple() | set() | frozenset():
            return [plain(part) for part in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {part.name: plain(getattr(value, part.name)) for part in dataclasses.fields(value)}
    return str(value)


def _ending(error: BaseException | None) -> tuple[str, int, str]:
    """Status, exit code and reason after the exception that ends a run."""
    if error is None:
        return "done", 0, ""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted", getattr(error, "exit_code", 130), str(error) or "interrupted"
    code = getattr(error, "exit_code", 1)
    return "failed", code, str(error) if code != 1 else f"{type(error).__name__}: {error}"


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
