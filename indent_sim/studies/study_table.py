"""The table of a study: one row per case, what it costs, how far it is off, and which of them to
choose.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from indent_sim.config.strict_yaml import inline, short
from indent_sim.results.folder import Report
from indent_sim.results.reader import Results
from indent_sim.studies.cases import Case, Refusal
from indent_sim.studies.points import STIFFNESS_UNIT, Multiple
from indent_sim.studies.reference.truth import Answer, Truth
from indent_sim.studies.study_file import StudyFile

STAGES = ("resolve", "companions", "mesh", "assemble", "solve", "write")
COSTS = (*(f"cpu_{stage}" for stage in STAGES), "cpu_s", "wall_s", "memory_MB", "peak_memory_MB")
OUTCOME = ("status", "exit_code", "reason", "steps_done", "force", "a", "p_max", "penetration")
COMPARED = "reference"  # column of what a row is compared with
ERRORS = ("force_error_vs", "force_error_worst", "a_error_vs", "p_error_vs")
EFFORT = ("method", "stiffness", "dofs", "newton_iterations", "substeps")
SAID = ("stated_error", "warnings", "verdict")
STUDY_COLUMNS = (*OUTCOME, *ERRORS, COMPARED, *EFFORT, *COSTS, *SAID)
SAME_FORCE = (
    1e-6  # relative: rows of a history with one force, but for what the solver leaves of it
)
SMALLER_ERROR = (
    0.999  # an error less than this fraction of another is smaller, not the same but for rounding
)
LENGTHS = ("h_contact", "h_axis", "h_edge", "h_corner", "h_film", "h_far", "grading")
MESH_KEYS = ("mesh", *(f"mesh.{name}" for name in LENGTHS), "accuracy")
TARGETS = (0.05, 0.01, 0.001)
REFERENCE = "reference"  # the finest run, which the others are compared with
MEANINGS = {"right": "the force is within the tolerance"}
MEANINGS |= {"flagged": "it is not, and the run itself states an error at least as large"}
MEANINGS |= {"refused": "no force: a clear error before or during the run"}
MEANINGS |= {"wrong": "a wrong force without a word, or a crash"}
VERDICTS = tuple(MEANINGS)
REFUSALS = range(3, 7)  # exit codes that come with a reason: config, mesh, not converged, audit
Row = dict[str, Any]  # values by column
Asked = tuple[Sequence[Case], Sequence[Refusal]]  # as `cases.asked_for` gives them


def rows(
    study: StudyFile,
    asked: Asked,
    done: Mapping[str, Results],
    against: Truth,
    names: Mapping[str, str],
) -> list[Row]:
    """One row per case or refusal, in order: index, run, every varied key, `STUDY_COLUMNS`; what is
    unknown is None.

    done: the results (table and run.json) of every run that has ended, by id; a case without any is
    "pending". names: of the runs' folders, by id. With a tolerance of the force every row has a
    verdict.
    """
    (cases, refusals) = asked
    keys = study.keys
    against.find_finest(
        cases, {name: found for name, found in done.items() if found.report["status"] == "done"}
    )
    found = [
        _row(case, keys, done.get(case.id), against.answer(case), against.reference(case))
        for case in cases
    ]
    found = sorted(
        [*found, *(_refused(refusal, keys) for refusal in refusals)], key=lambda row: row["index"]
    )
    if study.tolerance is not None:
        for row in found:
            row["verdict"] = verdict(row, study.tolerance, against.references)
    return [
        row | {name: names.get(row[name], row[name]) for name in ("run", COMPARED)} for row in found
    ]


def write(table: Sequence[Row]) -> str:
    """The table as CSV text, numbers to the last digit."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in table)
    return text.getvalue()


def answer_row(found: Results) -> int:
    """Index of the row that a run is told by: the last one; of a history that of the largest force,
    the first of several alike, and of one that pulls all the way that of the largest depth.
    """
    if "t" not in found.table:
        return -1
    force = found["force"]
    top = np.nanmax(found["force"], initial=0.0)
    return int(
        np.argmax(force >= (1 - SAME_FORCE) * top) if top > 0 else np.nanargmax(found["delta"])
    )


def read(text: str) -> list[Row]:
    """A table back from its CSV text: numbers, words, and None where a cell is empty."""
    return [
        {name: _read(value) for name, value in row.items()}
        for row in csv.DictReader(io.StringIO(text))
    ]


def _read(cell: str) -> Any:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(cell)
    return cell or None


def telling(table: Sequence[Row], keys: Sequence[str]) -> list[str]:
    """The keys that vary, without those that another one decides: of keys that go together the
    first.
    """
    kept: list[str] = []
    for key in keys:
        values = {other: {short(row[other]) for row in table} for other in (*kept, key)}
        pairs = {other: {(short(row[other]), short(row[key])) for row in table} for other in kept}
        if len(values[key]) > 1 and all(len(pairs[other]) > len(values[other]) for other in kept):
            kept.append(key)
    return kept or list(keys)


def _row(
    case: Case,
    keys: Sequence[str],
    found: Results | None,
    answer: Answer | None,
    reference: str | None,
) -> Row:
    named = {"index": case.index + 1, "run": case.id} | {key: case.numbers.get(key) for key in keys}
    row: Row = named | dict.fromkeys(STUDY_COLUMNS) | {"status": "pending"}
    row |= {"method": case.prospect.scene.method, "stiffness": case.prospect.stiffness}
    if found is None:
        return row
    report = found.report
    row |= {name: report.get(name) for name in ("status", "exit_code", "reason", "dofs")}
    row |= {"steps_done": len(found), "substeps": report.get("audit", {}).get("substeps")}
    row |= {
        "newton_iterations": int(found["newton_iterations"].sum()) if len(found) else None
    } | _costs(report)
    if row["status"] != "done":  # numbers of a lesser depth are no answer
        return row
    numbers = ("force", "a", "p_max", "penetration")
    told = answer_row(found)
    row |= {name: _known(found[name][told]) for name in numbers} | _said(found, told)
    return row | (_errors(found, answer) | {COMPARED: reference} if answer else {})


def _refused(refusal: Refusal, keys: Sequence[str]) -> Row:
    values = {key: refusal.numbers.get(key) for key in keys}
    stiffness = next(
        (value.factor for value in values.values() if isinstance(value, Multiple)), None
    )
    row: Row = {"index": refusal.index + 1, "run": None} | values | dict.fromkeys(STUDY_COLUMNS)
    row |= {"method": values.get("contact.method"), "stiffness": stiffness, "status": "failed"}
    return row | {"exit_code": refusal.error.exit_code, "reason": str(refusal.error)}


def _costs(report: Report) -> Row:
    """CPU seconds per stage and in sum, without loading libraries, and the memory of the run and of
    its process.
    """
    whole = not report.get("resumed_after")  # else nobody knows the seconds before
    cpu, wall = (report.get(name, {}) if whole else {} for name in ("cpu_timings", "timings"))
    row: Row = {f"cpu_{stage}": cpu.get(stage) for stage in STAGES}
    row["cpu_s"] = _sum(cpu)
    peak = report.get("peak_memory_MB")
    before = report.get("memory_before_MB")
    own = round(peak - before, 1) if peak is not None and before is not None else None
    return row | {"wall_s": _sum(wall), "memory_MB": own, "peak_memory_MB": peak}


def _sum(timings: Mapping[str, float]) -> float | None:
    return round(sum(timings.get(stage, 0.0) for stage in STAGES), 4) if timings else None


def _said(found: Results, told: int) -> Row:
    """What a run says itself of its error in the row that it is told by: a part of the force, and
    its warnings.
    """
    expected = found.report.get("plan", {}).get("prediction", {}).get("force_error", 0.0)
    bar = found.table["force_error"][told] if "force_error" in found.table else 0.0
    measured = abs(_relative(found["force"][told] + bar, found["force"][told]) or 0.0)
    return {
        "stated_error": max(expected, measured),
        "warnings": " | ".join(found.report.get("warnings", [])),
    }


def _errors(found: Results, answer: Answer) -> Row:
    """Relative errors at the last depth, signed, and the largest of the force at any depth."""
    steps = [answer.at(delta)[0] for delta in found["delta"]]
    with np.errstate(divide="ignore", invalid="ignore"):
        every = np.abs(found["force"] / np.array(steps) - 1)
    force, a, p_max = answer.at(found["delta"][-1])
    known = every[np.isfinite(every)]
    # a force that should be 0: a part of it
    last = found["force"][-1]
    largest = float(np.abs(found["force"]).max())
    error = _relative(last, force) if force else float(last / largest) if largest else 0.0
    worst = float(known.max()) if len(known) else None
    others = _relative(found["a"][-1], a), _relative(found["p_max"][-1], p_max)
    return dict(zip(ERRORS, (error, worst, *others), strict=True))


def _known(value: float) -> float | None:
    """A number of the table; None for one that there is none of."""
    return float(value) if math.isfinite(value) else None


def _relative(value: float, reference: float) -> float | None:
    return _known(value / reference - 1) if math.isfinite(reference) and reference != 0 else None


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, Multiple):
        return f"{value.factor!r} {STIFFNESS_UNIT}"
    if isinstance(value, float):
        return repr(value)
    return " ".join(value.split()) if isinstance(value, str) else inline(value)


def measured(table: Iterable[Row]) -> list[Row]:
    """The rows that have an error other than zero, and a cost; identical runs once."""
    kept = {row["run"]: row for row in table if row["force_error_vs"] and row["cpu_s"]}
    return list(kept.values())


def pareto(table: Iterable[Row]) -> list[Row]:
    """The rows that no other beats in both CPU seconds and force error, the quickest first."""
    front: list[Row] = []
    for row in sorted(measured(table), key=lambda row: (row["cpu_s"], abs(row["force_error_vs"]))):
        if not front or abs(row["force_error_vs"]) < SMALLER_ERROR * abs(
            front[-1]["force_error_vs"]
        ):
            front.append(row)
    return front


def recommended(table: Sequence[Row], keys: Sequence[str], target: float) -> Row | None:
    """The cheapest run within the target, if every finer mesh with the same settings is within it
    too.

    A coarse mesh may hit the force by luck; what a finer one misses was luck.
    """
    known = [row for row in table if row["force_error_vs"]]
    others = [key for key in keys if key not in MESH_KEYS]

    def is_within(row: Row) -> bool:
        alike = (one for one in known if all(one[key] == row[key] for key in others))
        return all(
            abs(finer["force_error_vs"]) <= target
            for finer in alike
            if (finer["dofs"] or 0) >= (row["dofs"] or 0)
        )

    return min(filter(is_within, measured(table)), key=lambda row: row["cpu_s"], default=None)


def recommendations(table: Sequence[Row], keys: Sequence[str]) -> list[str]:
    """For 5 %, 1 % and 0.1 % of the force: the run to choose, in words."""
    if not measured(table):
        return []
    lines = []
    for target in TARGETS:
        choice = "none of these"
        row = recommended(table, keys, target)
        if row:
            words = ", ".join(f"{key}={short(row[key])}" for key in keys if row[key] is not None)
            choice = f"{words}: {row['cpu_s']:.2g} s, {row['force_error_vs']:+.2%}"
        lines.append(f"for {100 * target:g} %: {choice}")
    return lines


def verdict(row: Row, tolerance: float, references: Collection[str] = ()) -> str | None:
    """One of VERDICTS, or REFERENCE for these runs; None for a row that is pending or compared with
    nothing.
    """
    if row["status"] == "failed":
        return "refused" if row["exit_code"] in REFUSALS else "wrong"
    error = row["force_error_vs"]
    if row["status"] != "done" or error is None:
        return None
    if row["run"] in references:
        return REFERENCE
    if abs(error) <= tolerance:
        return "right"
    return "flagged" if abs(error) <= (row["stated_error"] or 0.0) else "wrong"


def counts(table: Sequence[Row]) -> dict[str, int]:
    """How many rows have each of VERDICTS."""
    return {name: sum(row["verdict"] == name for row in table) for name in VERDICTS}


def impossible(table: Sequence[Row]) -> int:
    """How many rows were refused as scenes that cannot be, before anything was run; a contact
    method's own limit is none of them.
    """
    refused = [
        row["reason"] for row in table if row["verdict"] == "refused" and row["exit_code"] == 3
    ]
    return sum("contact." not in reason.partition(": ")[2].partition(": ")[0] for reason in refused)
