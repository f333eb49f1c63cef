"""Scoreboard: published, exact and computed values, and which of them are wrong.

The scoreboard has one row per case with a published value. The exact value comes from a second
method: the theory of the same body for a finite-element run, the run of another case, or a number
with its derivation.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from indent_sim.process.errors import ConfigError
from indent_sim.results.reader import Results
from indent_sim.studies.cases import Case
from indent_sim.studies.reference.published import PULL_OFF, PublishedValue
from indent_sim.studies.study_file import CASE_COLUMN, NamedCase

ROW_TOLERANCE = 1e-9  # relative difference of equal depths or times
SCOREBOARD_COLUMNS = (
    "case",
    "quantity",
    "published",
    "exact",
    "exact_by",
    "ours",
    "our_error",
    "difference",
    "claims",
    "source",
    "within",
    "ours_difference",
    "wrong",
)
NOBODY = "nobody"
PUBLISHED = "published"
OURS = "ours"
BOTH = "both"
UNKNOWN = "unknown"
Row = dict[str, Any]


@dataclass(frozen=True)
class VerifiedValue:
    """Number in the user's units with its error estimate.

    `error` is the half-width of the error bar, or None; `method` is the method of the solution.
    """

    number: float
    error: float | None = None
    method: str = ""


def check_published_rows(named_cases: Sequence[NamedCase], cases: Sequence[Case]) -> None:
    """Raise ConfigError if a published value refers to a row that the scene does not have."""
    cases_by_name = {case.values.get(CASE_COLUMN): case for case in cases}
    for named_case in named_cases:
        case = cases_by_name.get(named_case.name)
        published = named_case.published
        if (
            case is None
            or published is None
            or published.row_key is None
            or case.planned_run.scene.is_time_dependent
        ):
            continue
        name, published_place = published.row_key
        depths = case.planned_run.depths
        row_values = {
            "step": np.arange(1.0, len(depths) + 1),
            "delta": np.array(depths),
            "t": np.empty(0),
        }
        is_found_depth = name == "delta" and case.planned_run.has_prescribed_forces
        if (
            not is_found_depth
            and not np.isclose(row_values[name], published_place, rtol=ROW_TOLERANCE, atol=0).any()
        ):
            problem = f"the scene of {named_case.name} has no row with {name} {published_place:g}"
            raise ConfigError(
                "published.at", problem, "add it to loading.deltas", *named_case.published_location
            )


def rows(
    named_cases: Sequence[NamedCase], cases: Sequence[Case], results_by_id: Mapping[str, Results]
) -> list[Row]:
    """Return the scoreboard: one row per case with a published value, in the order of the file.

    The columns `difference` and `ours_difference` are in per cent of the exact value; `wrong`
    states which of the two values is wrong: nobody, published, ours, both or unknown. Unknown cells
    are None.
    """
    case_results = {
        str(case.values.get(CASE_COLUMN)): (case, results_by_id.get(case.id)) for case in cases
    }
    return [
        _scoreboard_row(named_case, case_results)
        for named_case in named_cases
        if named_case.published is not None
    ]


def read_row(row: Mapping[str, str]) -> Row:
    """Return a row from verification.csv; raise KeyError or ValueError if it is invalid."""
    cells = {name: row[name] for name in SCOREBOARD_COLUMNS}
    return {name: _parse_cell(name, text) for name, text in cells.items()}


def _parse_cell(name: str, text: str) -> str | float | None:
    if not text:
        return None
    text_columns = ("case", "quantity", "exact_by", "claims", "source", "wrong")
    return text if name in text_columns else float(text)


def read(text: str) -> list[Row]:
    """Return the scoreboard from verification.csv; raise KeyError or ValueError if invalid."""
    return [read_row(row) for row in csv.DictReader(io.StringIO(text))]


def verdict_text(row: Row) -> str:
    """Return a text on which values are wrong, with differences in per cent of the exact value."""
    if row["wrong"] == UNKNOWN:
        return "no exact value known" if row["ours"] is not None else "the run failed"
    parts = []
    if row["wrong"] in (PUBLISHED, BOTH):
        parts.append(
            f"the published value deviates by {row['difference']:+.2g} %, "
            f"claimed accuracy {100 * row['within']:.2g} %"
        )
    if row["wrong"] in (OURS, BOTH):
        parts.append(f"the computed value deviates by {row['ours_difference']:+.2g} %")
    if row["within"] is None:
        parts.append(
            f"the published value deviates by {row['difference']:+.2g} %, no accuracy claimed"
        )
    return "; ".join(parts) or NOBODY


def _scoreboard_row(
    named_case: NamedCase, case_results: Mapping[str, tuple[Case, Results | None]]
) -> Row:
    published = named_case.published
    assert published is not None
    source_cells: Row = {
        "case": named_case.name,
        "quantity": published.quantity,
        "published": published.value,
    }
    source_cells |= {
        "claims": published.claimed_kind,
        "source": published.source,
        "within": published.claimed_error,
    }
    computed = _computed_value(published, *case_results.get(named_case.name, (None, None)))
    exact = _exact_value(named_case, case_results)
    if exact is not None and exact.number == 0:
        exact = None  # no relative difference from 0
    row = (
        dict.fromkeys(SCOREBOARD_COLUMNS)
        | source_cells
        | {"wrong": _wrong_side(published, exact, computed)}
    )
    if computed is not None:
        row |= {"ours": computed.number, "our_error": computed.error}
    if exact is not None:
        row |= {"exact": exact.number, "exact_by": exact.method}
        row |= {"difference": 100 * (published.value / exact.number - 1)}
        row |= {"ours_difference": 100 * (computed.number / exact.number - 1) if computed else None}
    return row


def _wrong_side(
    published: PublishedValue, exact: VerifiedValue | None, computed: VerifiedValue | None
) -> str:
    """Return which values are outside their claimed error or error bar."""
    if exact is None:
        return UNKNOWN
    # Relative rounding error of an exact value.
    rounding = 1e-9
    exact_uncertainty = (exact.error or 0.0) + rounding * abs(exact.number)
    claimed_error = math.inf if published.claimed_error is None else published.claimed_error
    is_published_wrong = (
        abs(published.value - exact.number) > claimed_error * abs(exact.number) + exact_uncertainty
    )
    is_computed_wrong = (
        computed is not None
        and computed.error is not None
        and abs(computed.number - exact.number) > computed.error + exact_uncertainty
    )
    return {(0, 0): NOBODY, (1, 0): PUBLISHED, (0, 1): OURS, (1, 1): BOTH}[
        is_published_wrong, is_computed_wrong
    ]


def _exact_value(
    named_case: NamedCase, case_results: Mapping[str, tuple[Case, Results | None]]
) -> VerifiedValue | None:
    """Return the exact value of a case; None if it is unknown or its run failed.

    The exact value is a value given in the study, the result of another case, or the value by
    theory.
    """
    published = named_case.published
    exact = named_case.exact
    assert published is not None
    if exact is None:
        return _theory_value(published, *case_results.get(named_case.name, (None, None)))
    if exact.value is not None:
        return VerifiedValue(exact.value, 0.0, exact.method)
    value = _computed_value(published, *case_results.get(exact.case, (None, None)))
    return value and replace(value, method=exact.method)


def _computed_value(
    published: PublishedValue, case: Case | None, results: Results | None
) -> VerifiedValue | None:
    """Return the computed value of a published quantity; None if there is no such row or value."""
    if case is None or results is None or results.report.get("status") != "done":
        return None
    if published.quantity == PULL_OFF:
        return _pull_off(results)
    row = _row_index(published, results)
    if row is None or published.quantity not in results.table:
        return None
    number = float(results[published.quantity][row])
    error_bars = results.table.get(f"{published.quantity}_error")
    error = (
        float(error_bars[row])
        if error_bars is not None and math.isfinite(error_bars[row])
        else None
    )
    if published.quantity == "E_hertz" and "force_error" in results.table and results["force"][row]:
        error = abs(number * float(results["force_error"][row]) / float(results["force"][row]))
    return VerifiedValue(number, error) if math.isfinite(number) else None


def _row_index(published: PublishedValue, results: Results) -> int | None:
    """Return the row of a published value; at a jump in time the second of its two rows."""
    if published.row_key is None:
        return len(results) - 1
    name, row_value = published.row_key
    if name not in results.table:
        return None
    matching_rows = np.flatnonzero(np.isclose(results[name], row_value, rtol=ROW_TOLERANCE, atol=0))
    return int(matching_rows[-1]) if len(matching_rows) else None


def _pull_off(results: Results) -> VerifiedValue | None:
    """Return the pull-off force under force control, < 0.

    In the JKR limit it is the pull-off force of the elastic curve. With a cohesive law it is the
    result of the search between rows, or the largest tensile force of a row.
    """
    experiment, adhesion = (results.report.get(name) or {} for name in ("experiment", "adhesion"))
    jkr_pull_off = ((experiment.get("adhesion") or {}).get(PULL_OFF) or {}).get("force_control")
    pull_off = jkr_pull_off or adhesion.get(PULL_OFF) or adhesion.get("largest_pull")
    if not pull_off:
        return None
    force = float(pull_off["force"])
    search_error = pull_off.get("error", 0.0)
    row = None if jkr_pull_off else adhesion["largest_pull"]["step"]
    error = _pull_off_error(force, row, results)
    return VerifiedValue(
        force, None if error is None or search_error is None else error + search_error
    )


def _pull_off_error(force: float, step: int | None, results: Results) -> float | None:
    """Return the discretisation error of a pull-off force; None without error estimates.

    With a cohesive law it is the force multiplied by the relative error of the row with the largest
    tension (`step`). In the JKR limit (`step` is None) it is the force multiplied by the largest
    relative error of the elastic curve.
    """
    if "force_error" not in results.table or not len(results):
        return None
    forces = np.abs(results["force"])
    errors = results["force_error"]
    if step is not None:
        forces = forces[results["step"] == step]
        errors = errors[results["step"] == step]
    relative_errors = errors[forces > 0] / forces[forces > 0]
    return (
        abs(force) * float(relative_errors.max())
        if len(relative_errors) and np.isfinite(relative_errors).all()
        else None
    )


def _theory_value(
    published: PublishedValue, case: Case | None, results: Results | None
) -> VerifiedValue | None:
    """Return the value of an exact theory for a row of a mesh run on the same body; may be None."""
    if (
        case is None
        or results is None
        or not case.planned_run.scene.is_meshed
        or case.planned_run.scene.history_on_curve
        or not len(results)
    ):
        return None
    row = _row_index(published, results)
    theory = case.planned_run.scene.exact_theory
    physics = case.planned_run.scene.physics
    if row is None or theory is None:
        return _reported_theory_value(published, results, row)
    L = physics.scales.length
    D = physics.scales.depth
    P = physics.scales.pressure
    F = physics.scales.force
    depth: float | None = float(results["delta"][row]) / D
    if case.planned_run.has_prescribed_forces:
        depth = theory.depth_of_force(float(results["force"][row]) / F, physics.body.height)
    solution = theory.solution_at_depth(depth) if depth is not None else None
    if solution is None:
        return None
    numbers = {"force": solution.force * F, "a": solution.a * L, "delta": solution.delta * D}
    number = (
        solution.largest_pressure() * P
        if published.quantity == "p_max"
        else numbers.get(published.quantity)
    )
    return (
        VerifiedValue(number, 0.0, theory.name)
        if number is not None and math.isfinite(number)
        else None
    )


def _reported_theory_value(
    published: PublishedValue, results: Results, row: int | None
) -> VerifiedValue | None:
    """Return the theory value of the run's report, if that theory is exact for the scene."""
    theory = results.report.get("theory") or {}
    if row is None or not theory.get("exact") or not theory.get(published.quantity):
        return None
    is_deepest = row == int(np.argmax(results["delta"]))
    return (
        VerifiedValue(float(theory[published.quantity]), 0.0, theory["name"])
        if is_deepest
        else None
    )
