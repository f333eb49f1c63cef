"""Plan of a study: runs, predicted costs and reference, without running anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.studies import cases as case_list
from indent_sim.studies import study_file
from indent_sim.studies.reference import scoreboard
from indent_sim.studies.reference.reference_solution import ReferenceSolution
from indent_sim.studies.shard import check_first_points
from indent_sim.studies.study_table import Row

PREDICTED_COLUMNS = ("force", "delta", "dofs", "memory_MB", "seconds")


@dataclass(frozen=True)
class StudyPlan:
    """Planned runs of a study: one row per run, with predicted results and cost.

    Attributes
    ----------
    title, keys
        Title of the study and its varied keys.
    compared_with
        Name of the reference solution with which the forces are compared.
    rows
        Varied keys, predicted results, cost and warnings of each run.
    same
        Number of points with the same physics as an earlier point; they are not run again.
    refused
        Errors of the points that are not valid scenes.
    notes
        Remarks on the reference.
    point_count
        Number of points of a study without result folders, of which only the first are planned; 0
        for other studies, all of whose runs are planned.
    """

    title: str
    keys: tuple[str, ...]
    compared_with: str
    rows: Sequence[Row]
    same: int
    refused: Sequence[str]
    notes: tuple[str, ...]
    point_count: int = 0

    @property
    def seconds(self) -> float:
        """Predicted CPU time [s] of all runs together, excluding the import of libraries.

        If only the first points are planned, it is their mean times the number of points.
        """
        seconds = sum(row["seconds"] or 0.0 for row in self.rows)
        planned_count = len(self.rows) + self.same + len(self.refused)
        return round(seconds * max(1.0, self.point_count / max(1, planned_count)), 1)

    def as_json(self) -> Row:
        """Return the plan as an object for JSON."""
        names = ("title", "compared_with", "rows", "same", "refused", "seconds", "notes")
        points = {"points": self.point_count} if self.point_count else {}
        return {name: getattr(self, name) for name in names} | points


def plan_study(study_input: Path | str | Mapping[str, Any], error_bars: bool = False) -> StudyPlan:
    """Return the plan of a study without running anything.

    Parameters
    ----------
    study_input
        Path of a study file, or a dictionary with its structure.
    error_bars
        Include the cost of error estimates in the predicted cost of each run.

    Raises
    ------
    UsageError, ConfigError
        The same errors that `execute_study` raises before its first run.
    """
    study = study_file.read(study_input)
    point_count = 0
    # Number of points that are planned in a study without result folders.
    planned_points = 100
    if study.keeps_all_runs:
        cases, rejected_cases = case_list.resolve_cases(study)
    else:
        check_first_points(study)
        cases, rejected_cases = case_list.validate_cases(study, planned_points)
        point_count = study.point_count - study.left_out_count()
    scoreboard.check_published_rows(study.named_cases, cases)
    reference = ReferenceSolution(study, cases)
    runs = case_list.unique_cases(cases)
    rows: list[Row] = []
    for case in runs:
        run_plan = case.planned_run.add_estimation_cost(error_bars).plan
        row = {"index": case.index + 1, "run": case.name} | {
            key: case.values.get(key) for key in study.keys
        }
        row |= {"method": case.planned_run.scene.method} | {
            name: run_plan.prediction.get(name) for name in PREDICTED_COLUMNS
        }
        row["seconds"] = float(f"{case.planned_run.study_seconds(error_bars):.2g}")
        rows.append(row | {"warnings": list(run_plan.warnings)})
    rejected_errors = [str(rejected_case.error) for rejected_case in rejected_cases]
    return StudyPlan(
        study.title,
        study.keys,
        reference.name,
        rows,
        len(cases) - len(runs),
        rejected_errors,
        reference.notes,
        point_count,
    )
