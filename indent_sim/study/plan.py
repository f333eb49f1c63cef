"""What a study would do: its runs, what each costs, and what there would be to compare; nothing is run or written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.study import cases as case_list
from indent_sim.study import file
from indent_sim.study.cases import Case
from indent_sim.study.truth import Comparison

EXPECTED = ("force", "delta", "dofs", "memory_MB", "seconds")
Row = dict[str, Any]


@dataclass(frozen=True)
class Plan:
    """The runs of a study before any is done: a row each, with what is expected of it.

    same: points that ask for the same physics as another and are no run of their own; refused: those with an error.
    """

    title: str
    keys: tuple[str, ...]
    compared_with: str
    rows: Sequence[Row]
    same: int
    refused: Sequence[str]
    notes: tuple[str, ...]

    @property
    def seconds(self) -> float:
        """Of all runs, one after another."""
        return float(sum(row["seconds"] or 0.0 for row in self.rows))

    def as_json(self) -> dict[str, Any]:
        """The plan as one JSON object."""
        return {"title": self.title, "compared_with": self.compared_with, "rows": self.rows, "same": self.same,
                "refused": self.refused, "seconds": self.seconds, "notes": self.notes}  # fmt: skip


def plan(path: Path | str) -> Plan:
    """The plan of a study file; errors as of `carry_out` before its first run."""
    study = file.read(path)
    cases, refusals = (case_list.of(study), []) if study.tolerance is None else case_list.sorted_out(study)
    against, runs = Comparison(study, cases), case_list.unique(cases)
    rows = [_row(case, study.keys) for case in runs]
    refused = [str(refusal.error) for refusal in refusals]
    return Plan(study.title, study.keys, against.name, rows, len(cases) - len(runs), refused, against.notes)


def _row(case: Case, keys: Sequence[str]) -> Row:
    said = case.scene.plan
    expected = {name: said.prediction.get(name) for name in EXPECTED}
    values = {key: case.values.get(key) for key in keys}
    return {"index": case.index + 1, "run": case.name} | values | {
        "method": case.scene.method, **expected, "warnings": list(said.warnings)}  # fmt: skip
