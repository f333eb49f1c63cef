"""The record of a run: its result folder as all ranks see it, and its clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from indent_sim.process.ranks import on_root
from indent_sim.results.reader import Earlier
from indent_sim.results.writer import ResultFolder


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

    def __call__(self, method: str, *args: Any, **options: Any) -> Any:
        """Call a method of the folder on rank 0; what it returns stays there."""
        return on_root(self.comm, lambda: getattr(self._folder, method)(*args, **options))

    def note(self, **entries: Any) -> None:
        """Add entries to run.json."""
        if self._folder is not None:
            self._folder.report.update(entries)

    def warn(self, *warnings: str) -> None:
        """Add warnings to those of run.json."""
        if self._folder is not None:
            self.note(warnings=[*self._folder.report.get("warnings", []), *warnings])
