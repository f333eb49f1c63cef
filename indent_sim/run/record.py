"""The record of a run: its result folder as all ranks see it, and its clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from indent_sim.model.state import State
from indent_sim.process.errors import IndentSimError
from indent_sim.process.ranks import on_root
from indent_sim.results.checkpoint import Checkpoint
from indent_sim.results.reader import Earlier
from indent_sim.results.writer import Keep, ResultFolder

T = TypeVar("T")


class Record:
    """The result folder seen from all ranks: rank 0 writes, every rank learns of a failure."""

    def __init__(self, comm: Any, target: Path, config_yaml: str, **options: Any):
        self.comm = comm
        self.report: dict[str, Any] = {}
        self._open = lambda: ResultFolder(target, config_yaml, report=self.report, **options).__enter__()
        self._folder: ResultFolder | None = None
        self.earlier: Earlier | None = None

    def __enter__(self) -> Record:
        self._folder = on_root(self.comm, self._open)
        self.earlier = self.comm.bcast(self._folder.earlier if self._folder is not None else None)
        return self

    def __exit__(self, *error: Any) -> None:
        if error[0] is None:
            on_root(self.comm, self._close, *error)
        elif self._folder is not None:
            self._close(*error)

    def _close(self, *error: Any) -> None:
        assert self._folder is not None
        self._folder.__exit__(*error)
        self.report = dict(self._folder.report)

    def open_fields(self, *mesh: Any, keep: Keep, friction: bool) -> None:
        """Prepare the field files, from the mesh that rank 0 has."""
        self._on_root(ResultFolder.open_fields, *mesh, keep=keep, friction=friction)

    def write_fields(self, state: State, fields: Any) -> None:
        """Write the fields of a state, which rank 0 has; call before its `append`."""
        self._on_root(ResultFolder.write_fields, state, fields)

    def append(self, state: State) -> None:
        """Add the row of a converged state."""
        self._on_root(ResultFolder.append, state)

    def write_experiment(self, rows: Sequence[Any], dynamic: Sequence[Any]) -> None:
        """Write the tables of an experiment."""
        self._on_root(ResultFolder.write_experiment, rows, dynamic)

    def save_checkpoint(self, saved: Checkpoint, identity: Mapping[str, Any]) -> None:
        """Keep the last equilibria for `--resume`."""
        self._on_root(ResultFolder.save_checkpoint, saved, identity)

    def read_checkpoint(self, identity: Mapping[str, Any]) -> Checkpoint:
        """The last equilibria of the run that is continued, on all ranks; it may have had another number of them."""
        saved = self._on_root(ResultFolder.read_checkpoint, identity)
        return self.comm.bcast(saved) or Checkpoint()

    def _on_root(self, act: Callable[..., T], *args: Any, **options: Any) -> T | None:
        return on_root(self.comm, lambda: act(self._folder, *args, **options))

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
