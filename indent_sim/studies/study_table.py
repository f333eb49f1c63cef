"""Table of a study: one row per case with its results, errors and costs."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from indent_sim.config.mesh_checks import MESH_SIZE_KEYS
from indent_sim.config.strict_yaml import inline_yaml, short_yaml
from indent_sim.results.reader import Results
from indent_sim.results.result_files import Report
from indent_sim.studies.cases import Case, RejectedCase
from indent_sim.studies.parameter_values import STIFFNESS_UNIT, StiffnessMultiple
from indent_sim.studies.reference.reference_solution import ReferenceCurve, ReferenceSolution
from indent_sim.studies.study_file import StudyFile

STAGES = ("resolve", "companions", "mesh", "assemble", "solve", "write")
# Column of the name of the run or theory with which a row is compared.
REFERENCE_COLUMN = "reference"
ERROR_COLUMNS = ("force_error_vs", "force_error_worst", "a_error_vs", "p_error_vs")
STUDY_COLUMNS = (
    "status",
    "exit_code",
    "reason",
    "steps_done",
    "force",
    "a",
    "p_max",
    "penetration",
    *ERROR_COLUMNS,
    REFERENCE_COLUMN,
    "method",
    "stiffness",
    "dofs",
    "newton_iterations",
    "substeps",
    *(f"cpu_{stage}" for stage in STAGES),
    "cpu_s",
    "wall_s",
    "memory_MB",
    "peak_memory_MB",
    "stated_error",
    "warnings",
    "verdict",
)
# Verdict of the finest run, with which other runs are compared.
REFERENCE_VERDICT = "reference"
VERDICT_MEANINGS = {
    "right": "the force is within the tolerance",
    "flagged": "the force is outside the tolerance, and the run states an error at least as large",
    "refused": "no force: a clear error before or during the run",
    "wrong": "a wrong force without a warning, or a crash",
}
VERDICTS = tuple(VERDICT_MEANINGS)
# Values of a row by column.
Row = dict[str, Any]
# Cases and rejected cases, as `resolve_cases` returns them.
ResolvedCases = tuple[Sequence[Case], Sequence[RejectedCase]]


def rows(
    study: StudyFile,
    resolved_cases: ResolvedCases,
    results_by_id: Mapping[str, Results],
    reference: ReferenceSolution,
    folder_names: Mapping[str, str],
) -> list[Row]:
    """Return the table: one row per case or rejected case, in the order of the study.

    Parameters
    ----------
    study, resolved_cases
        The study, and its cases and rejected cases.
    results_by_id
        Results of every run that has ended, by the id of the case; other cases are "pending".
    reference
        The reference solution of the study; this function chooses its finest runs.
    folder_names
        Name of each run's folder, by the id of its case.

    Returns
    -------
    list of dict
        Columns index, run, the varied keys, `STUDY_COLUMNS`; None where unknown. With a tolerance
        of the force every row has a verdict.
    """
    cases, rejected_cases = resolved_cases
    keys = study.keys
    reference.choose_finest_cases(
        cases,
        {
            name: table_rows
            for name, table_rows in results_by_id.items()
            if table_rows.report["status"] == "done"
        },
    )
    table_rows = [
        case_row(
            case,
            keys,
            results_by_id.get(case.id),
            reference.reference_curve(case),
            reference.reference_name(case),
        )
        for case in cases
    ]
    table_rows = sorted(
        [*table_rows, *(rejected_row(rejected_case, keys) for rejected_case in rejected_cases)],
        key=lambda row: row["index"],
    )
    if study.tolerance is not None:
        for row in table_rows:
            row["verdict"] = row_verdict(row, study.tolerance, reference.reference_ids)
    return [
        row | {name: folder_names.get(row[name], row[name]) for name in ("run", REFERENCE_COLUMN)}
        for row in table_rows
    ]


def write(table: Sequence[Row]) -> str:
    """Return the table as CSV text, with all digits of its numbers."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: cell_text(value) for name, value in row.items()} for row in table)
    return text.getvalue()


def representative_row(results: Results) -> int:
    """Return the index of the row that represents a run in the table.

    The row is the last one of a depth path. For a time history it is the first row with the largest
    force, or the deepest row if the force is tensile throughout.
    """
    if "t" not in results.table:
        return -1
    force = results["force"]
    max_force = np.nanmax(results["force"], initial=0.0)
    if max_force > 0:
        # Relative difference of two forces that are equal except for the solver's tolerance.
        tolerance = 1e-6
        return int(np.argmax(force >= (1 - tolerance) * max_force))
    return int(np.nanargmax(results["delta"]))


def read(text: str) -> list[Row]:
    """Return a table from its CSV text: numbers, texts, and None for empty cells."""
    return [
        {name: _parse_cell(value) for name, value in row.items()}
        for row in csv.DictReader(io.StringIO(text))
    ]


def _parse_cell(cell: str) -> Any:
    """Return a cell as a number or a text; None for an empty cell."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(cell)
    return cell or None


def independent_keys(table: Sequence[Row], keys: Sequence[str]) -> list[str]:
    """Return the independent keys: only the first one of keys that vary together."""
    kept_keys: list[str] = []
    for key in keys:
        values = {
            earlier_key: {short_yaml(row[earlier_key]) for row in table}
            for earlier_key in (*kept_keys, key)
        }
        pairs = {
            earlier_key: {(short_yaml(row[earlier_key]), short_yaml(row[key])) for row in table}
            for earlier_key in kept_keys
        }
        if len(values[key]) > 1 and all(
            len(pairs[earlier_key]) > len(values[earlier_key]) for earlier_key in kept_keys
        ):
            kept_keys.append(key)
    return kept_keys or list(keys)


def case_row(
    case: Case,
    keys: Sequence[str],
    results: Results | None,
    reference_curve: ReferenceCurve | None,
    reference_name: str | None,
) -> Row:
    """Return the row of a case, with its results and errors if it has been run."""
    first_cells = {"index": case.index + 1, "run": case.id} | {
        key: case.table_values.get(key) for key in keys
    }
    row: Row = first_cells | dict.fromkeys(STUDY_COLUMNS) | {"status": "pending"}
    row |= {"method": case.planned_run.scene.method, "stiffness": case.planned_run.stiffness}
    if results is None:
        return row
    report = results.report
    row |= {name: report.get(name) for name in ("status", "exit_code", "reason", "dofs")}
    row |= {"steps_done": len(results), "substeps": report.get("audit", {}).get("substeps")}
    row |= {
        "newton_iterations": int(results["newton_iterations"].sum()) if len(results) else None
    } | _cost_cells(report)
    # A failed run ended at a smaller depth, so that its last row does not answer for the scene.
    if row["status"] != "done":
        return row
    numbers = ("force", "a", "p_max", "penetration")
    row_index = representative_row(results)
    row |= {name: _finite_or_none(results[name][row_index]) for name in numbers} | _stated_cells(
        results, row_index
    )
    if reference_curve is None:
        return row
    return row | _error_cells(results, reference_curve) | {REFERENCE_COLUMN: reference_name}


def rejected_row(rejected_case: RejectedCase, keys: Sequence[str]) -> Row:
    """Return the row of a rejected case: a failed run with the error as its reason."""
    values = {key: rejected_case.table_values.get(key) for key in keys}
    stiffness = next(
        (value.factor for value in values.values() if isinstance(value, StiffnessMultiple)), None
    )
    row: Row = (
        {"index": rejected_case.index + 1, "run": None} | values | dict.fromkeys(STUDY_COLUMNS)
    )
    row |= {"method": values.get("contact.method"), "stiffness": stiffness, "status": "failed"}
    return row | {"exit_code": rejected_case.error.exit_code, "reason": str(rejected_case.error)}


def _cost_cells(report: Report) -> Row:
    """Return CPU time per stage and in total (excluding imports of libraries), and memory."""
    # The seconds of a resumed run do not include those before its interruption.
    is_complete = not report.get("resumed_after")
    cpu_timings, wall_timings = (
        report.get(name, {}) if is_complete else {} for name in ("cpu_timings", "timings")
    )
    row: Row = {f"cpu_{stage}": cpu_timings.get(stage) for stage in STAGES}
    row["cpu_s"] = _sum_stages(cpu_timings)
    peak_memory = report.get("peak_memory_MB")
    memory_before = report.get("memory_before_MB")
    own_memory = (
        round(peak_memory - memory_before, 1)
        if peak_memory is not None and memory_before is not None
        else None
    )
    return row | {
        "wall_s": _sum_stages(wall_timings),
        "memory_MB": own_memory,
        "peak_memory_MB": peak_memory,
    }


def _sum_stages(timings: Mapping[str, float]) -> float | None:
    """Return the sum of the times of all stages [s]; None if they are unknown."""
    return round(sum(timings.get(stage, 0.0) for stage in STAGES), 4) if timings else None


def _stated_cells(results: Results, row_index: int) -> Row:
    """Return the relative force error that a run states, and its warnings."""
    expected_error = results.report.get("plan", {}).get("prediction", {}).get("force_error", 0.0)
    error_bar = results.table["force_error"][row_index] if "force_error" in results.table else 0.0
    estimated_error = abs(
        _relative_error(results["force"][row_index] + error_bar, results["force"][row_index]) or 0.0
    )
    return {
        "stated_error": max(expected_error, estimated_error),
        "warnings": " | ".join(results.report.get("warnings", [])),
    }


def _error_cells(results: Results, reference_curve: ReferenceCurve) -> Row:
    """Return the signed relative errors at the last depth, and the largest force error."""
    reference_forces = [reference_curve.interpolate(delta)[0] for delta in results["delta"]]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative_errors = np.abs(results["force"] / np.array(reference_forces) - 1)
    force, a, p_max = reference_curve.interpolate(results["delta"][-1])
    finite_errors = relative_errors[np.isfinite(relative_errors)]
    last_force = results["force"][-1]
    largest = float(np.abs(results["force"]).max())
    # If the reference force is 0, the error refers to the largest force of the run.
    error: float | None = 0.0
    if force:
        error = _relative_error(last_force, force)
    elif largest:
        error = float(last_force / largest)
    worst = float(finite_errors.max()) if len(finite_errors) else None
    radius_and_pressure_errors = (
        _relative_error(results["a"][-1], a),
        _relative_error(results["p_max"][-1], p_max),
    )
    return dict(zip(ERROR_COLUMNS, (error, worst, *radius_and_pressure_errors), strict=True))


def _finite_or_none(value: float) -> float | None:
    """Return a number, or None if it is not finite."""
    return float(value) if math.isfinite(value) else None


def _relative_error(value: float, reference: float) -> float | None:
    """Return value / reference - 1; None if the reference is 0 or not finite."""
    if not math.isfinite(reference) or reference == 0:
        return None
    return _finite_or_none(value / reference - 1)


def cell_text(value: object) -> str:
    """Return a value as the text of a cell, with all digits of a number."""
    if value is None:
        return ""
    if isinstance(value, StiffnessMultiple):
        return f"{value.factor!r} {STIFFNESS_UNIT}"
    if isinstance(value, float):
        return repr(value)
    return " ".join(value.split()) if isinstance(value, str) else inline_yaml(value)


def rows_with_error(table: Iterable[Row]) -> list[Row]:
    """Return the rows with a nonzero error and a cost, without repeated runs."""
    rows_by_run = {row["run"]: row for row in table if row["force_error_vs"] and row["cpu_s"]}
    return list(rows_by_run.values())


def pareto_front(table: Iterable[Row]) -> list[Row]:
    """Return the rows on the Pareto front of CPU time and force error, sorted by CPU time."""
    front: list[Row] = []
    # An error counts as smaller than another one if it is below this fraction of it.
    ratio = 0.999
    for row in sorted(
        rows_with_error(table), key=lambda row: (row["cpu_s"], abs(row["force_error_vs"]))
    ):
        if not front or abs(row["force_error_vs"]) < ratio * abs(front[-1]["force_error_vs"]):
            front.append(row)
    return front


def recommended_run(table: Sequence[Row], keys: Sequence[str], target: float) -> Row | None:
    """Return the cheapest run whose force error is within the target.

    All finer meshes with the same settings must also be within the target, because a coarse mesh
    can have the correct force by coincidence.
    """
    compared_rows = [row for row in table if row["force_error_vs"]]
    mesh_keys = ("mesh", *(f"mesh.{name}" for name in MESH_SIZE_KEYS), "accuracy")
    other_keys = [key for key in keys if key not in mesh_keys]

    def is_reliable(row: Row) -> bool:
        same_settings = (
            other_row
            for other_row in compared_rows
            if all(other_row[key] == row[key] for key in other_keys)
        )
        return all(
            abs(finer["force_error_vs"]) <= target
            for finer in same_settings
            if (finer["dofs"] or 0) >= (row["dofs"] or 0)
        )

    return min(
        filter(is_reliable, rows_with_error(table)), key=lambda row: row["cpu_s"], default=None
    )


def recommendations(table: Sequence[Row], keys: Sequence[str]) -> list[str]:
    """Return lines with the recommended runs for force errors of 5 %, 1 % and 0.1 %."""
    if not rows_with_error(table):
        return []
    lines = []
    for target in (0.05, 0.01, 0.001):
        choice = "none of these runs"
        row = recommended_run(table, keys, target)
        if row:
            settings = ", ".join(
                f"{key}={short_yaml(row[key])}" for key in keys if row[key] is not None
            )
            choice = f"{settings}: {row['cpu_s']:.2g} s, {row['force_error_vs']:+.2%}"
        lines.append(f"for {100 * target:g} %: {choice}")
    return lines


def row_verdict(row: Row, tolerance: float, references: Collection[str] = ()) -> str | None:
    """Return a verdict, or `REFERENCE_VERDICT` for a reference run.

    The result is None for a row that is pending or has no reference.

    Parameters
    ----------
    tolerance
        Relative error of the force up to which a row is "right".
    references
        Ids of the runs with which other runs are compared.
    """
    if row["status"] == "failed":
        # Exit codes of config, mesh, convergence and verification, which all give a reason.
        return "refused" if row["exit_code"] in range(3, 7) else "wrong"
    error = row["force_error_vs"]
    if row["status"] != "done" or error is None:
        return None
    if row["run"] in references:
        return REFERENCE_VERDICT
    if abs(error) <= tolerance:
        return "right"
    return "flagged" if abs(error) <= (row["stated_error"] or 0.0) else "wrong"


def verdict_counts(table: Sequence[Row]) -> dict[str, int]:
    """Return the number of rows with each of `VERDICTS`."""
    return {name: sum(row["verdict"] == name for row in table) for name in VERDICTS}


def impossible_scene_count(table: Sequence[Row]) -> int:
    """Return the number of rows that were refused because their scene is impossible.

    Refusals by a limit of the contact method are not counted.
    """
    refusal_reasons = [
        row["reason"] for row in table if row["verdict"] == "refused" and row["exit_code"] == 3
    ]
    return sum(
        "contact." not in reason.partition(": ")[2].partition(": ")[0] for reason in refusal_reasons
    )
