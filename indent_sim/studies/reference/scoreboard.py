"""Scoreboard: published values beside exact ones and ours, and which of them is wrong by how much.

A row per case with a published value. The exact value is that of a second method: the theory of the
very body where the run is one of finite elements, the run of another case, or a number with its
derivation.
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
from indent_sim.studies.reference.published import PULL_OFF, Published
from indent_sim.studies.study_file import CASE, Member

SAME_PLACE = 1e-9  # relative
OWN_COLUMNS = ("within", "ours_difference", "wrong")
SCOREBOARD_COLUMNS = (
    *(
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
    ),
    *OWN_COLUMNS,
)
NOBODY = "nobody"
PUBLISHED = "published"
OURS = "ours"
BOTH = "both"
UNKNOWN = "unknown"
TEXT_COLUMNS = ("case", "quantity", "exact_by", "claims", "source", "wrong")  # columns of text
ROUNDING = 1e-9  # relative, of a number that is exact
Row = dict[str, Any]


@dataclass(frozen=True)
class Value:
    """A number [user's units], half the width of its error bar (None: not known) and how it was
    found.
    """

    number: float
    error: float | None = None
    by: str = ""


def check(members: Sequence[Member], cases: Sequence[Case]) -> None:
    """ConfigError, with its place, for a published value of a row that the scene does not have."""
    of = {case.values.get(CASE): case for case in cases}
    for member in members:
        case = of.get(member.name)
        published = member.published
        if (
            case is None
            or published is None
            or published.at is None
            or case.prospect.scene.is_time_dependent
        ):
            continue
        name, wanted = published.at
        depths = case.prospect.depths
        known = {
            "step": np.arange(1.0, len(depths) + 1),
            "delta": np.array(depths),
            "t": np.empty(0),
        }
        is_found = name == "delta" and case.prospect.has_prescribed_forces
        if not is_found and not np.isclose(known[name], wanted, rtol=SAME_PLACE, atol=0).any():
            problem = f"the scene of {member.name} has no row with {name} {wanted:g}"
            raise ConfigError("published.at", problem, "add it to loading.deltas", *member.place)


def rows(
    members: Sequence[Member], cases: Sequence[Case], done: Mapping[str, Results]
) -> list[Row]:
    """The scoreboard, a row for every case with a published value, in the order of the file; what
    is unknown is None. difference and ours_difference are in per cent of the exact value;
    `wrong` is nobody, published, ours, both or unknown.
    """
    found = {str(case.values.get(CASE)): (case, done.get(case.id)) for case in cases}
    return [_row(member, found) for member in members if member.published is not None]


def read_row(row: Mapping[str, str]) -> Row:
    """A row as `rows` gave it, from the cells of verification.csv; KeyError or ValueError where it
    is none.
    """
    cells = {name: row[name] for name in SCOREBOARD_COLUMNS}
    return {
        name: (text if name in TEXT_COLUMNS else float(text)) if text else None
        for name, text in cells.items()
    }


def read(text: str) -> list[Row]:
    """The scoreboard back from verification.csv; KeyError or ValueError where it is none."""
    return [read_row(row) for row in csv.DictReader(io.StringIO(text))]


def in_words(row: Row) -> str:
    """Who is wrong and by how much, of the exact value."""
    if row["wrong"] == UNKNOWN:
        return "no exact value known" if row["ours"] is not None else "the run failed"
    said = []
    if row["wrong"] in (PUBLISHED, BOTH):
        said.append(f"published by {row['difference']:+.2g} %, claims {100 * row['within']:.2g} %")
    if row["wrong"] in (OURS, BOTH):
        said.append(f"ours by {row['ours_difference']:+.2g} %")
    if row["within"] is None:
        said.append(f"published is {row['difference']:+.2g} % off, claims no accuracy")
    return "; ".join(said) or NOBODY


def _row(member: Member, found: Mapping[str, tuple[Case, Results | None]]) -> Row:
    published = member.published
    assert published is not None
    said: Row = {"case": member.name, "quantity": published.quantity, "published": published.value}
    said |= {"claims": published.claims, "source": published.source, "within": published.within}
    ours = _found(published, *found.get(member.name, (None, None)))
    exact = _exact(member, found)
    if exact is not None and exact.number == 0:
        exact = None  # of which no difference could be a part
    row = dict.fromkeys(SCOREBOARD_COLUMNS) | said | {"wrong": _wrong(published, exact, ours)}
    if ours is not None:
        row |= {"ours": ours.number, "our_error": ours.error}
    if exact is not None:
        row |= {"exact": exact.number, "exact_by": exact.by}
        row |= {"difference": 100 * (published.value / exact.number - 1)}
        row |= {"ours_difference": 100 * (ours.number / exact.number - 1) if ours else None}
    return row


def _wrong(published: Published, exact: Value | None, ours: Value | None) -> str:
    """Who is off by more than is claimed: the source beyond `within`, we beyond our error bar."""
    if exact is None:
        return UNKNOWN
    spread = (exact.error or 0.0) + ROUNDING * abs(exact.number)
    claimed = math.inf if published.within is None else published.within
    is_theirs = abs(published.value - exact.number) > claimed * abs(exact.number) + spread
    is_ours = (
        ours is not None
        and ours.error is not None
        and abs(ours.number - exact.number) > ours.error + spread
    )
    return {(0, 0): NOBODY, (1, 0): PUBLISHED, (0, 1): OURS, (1, 1): BOTH}[is_theirs, is_ours]


def _exact(member: Member, found: Mapping[str, tuple[Case, Results | None]]) -> Value | None:
    """The exact value of a case by its second method; None where there is none, or its run failed."""
    published = member.published
    exact = member.exact
    assert published is not None
    if exact is None:
        return _by_theory(published, *found.get(member.name, (None, None)))
    if exact.value is not None:
        return Value(exact.value, 0.0, exact.by)
    value = _found(published, *found.get(exact.case, (None, None)))
    return value and replace(value, by=exact.by)


def _found(published: Published, case: Case | None, results: Results | None) -> Value | None:
    """What a run says of the quantity; None where it has no such row, or it is empty there."""
    if case is None or results is None or results.report.get("status") != "done":
        return None
    if published.quantity == PULL_OFF:
        return _pull_off(results)
    row = _row_at(published, results)
    if row is None or published.quantity not in results.table:
        return None
    number = float(results[published.quantity][row])
    bars = results.table.get(f"{published.quantity}_error")
    error = float(bars[row]) if bars is not None and math.isfinite(bars[row]) else None
    if published.quantity == "E_hertz" and "force_error" in results.table and results["force"][row]:
        error = abs(number * float(results["force_error"][row]) / float(results["force"][row]))
    return Value(number, error) if math.isfinite(number) else None


def _row_at(published: Published, results: Results) -> int | None:
    """The row that a value was published of; at a jump, of two rows of one time, the later."""
    if published.at is None:
        return len(results) - 1
    name, wanted = published.at
    if name not in results.table:
        return None
    match = np.flatnonzero(np.isclose(results[name], wanted, rtol=SAME_PLACE, atol=0))
    return int(match[-1]) if len(match) else None


def _pull_off(results: Results) -> Value | None:
    """The pull-off force under force control, < 0.

    Of the limit without range; else the one between the rows, or where none was searched for that
    of the row that pulls most.
    """
    experiment, adhesion = (results.report.get(name) or {} for name in ("experiment", "adhesion"))
    without_range = ((experiment.get("adhesion") or {}).get(PULL_OFF) or {}).get("force_control")
    known = without_range or adhesion.get(PULL_OFF) or adhesion.get("largest_pull")
    if not known:
        return None
    force = float(known["force"])
    missed = known.get("error", 0.0)
    row = None if without_range else adhesion["largest_pull"]["step"]
    error = _pull_off_error(force, row, results)
    return Value(force, None if error is None or missed is None else error + missed)


def _pull_off_error(force: float, step: int | None, results: Results) -> float | None:
    """What elements cost: as large a part of the force as of the row that pulls most; without range
    as the widest of the elastic curve that it is found from. None without bars."""
    if "force_error" not in results.table or not len(results):
        return None
    forces = np.abs(results["force"])
    errors = results["force_error"]
    if step is not None:
        forces = forces[results["step"] == step]
        errors = errors[results["step"] == step]
    parts = errors[forces > 0] / forces[forces > 0]
    return abs(force) * float(parts.max()) if len(parts) and np.isfinite(parts).all() else None


def _by_theory(published: Published, case: Case | None, results: Results | None) -> Value | None:
    """What the theory of the very body says of a row that elements found; None where it is not
    exact for it.
    """
    if (
        case is None
        or results is None
        or not case.prospect.scene.is_meshed
        or case.prospect.scene.history_on_curve
        or not len(results)
    ):
        return None
    row = _row_at(published, results)
    theory = case.prospect.scene.exact_theory
    physics = case.prospect.scene.physics
    if row is None or theory is None:
        return _beside(published, results, row)
    L = physics.scales.length
    D = physics.scales.depth
    P = physics.scales.pressure
    F = physics.scales.force
    depth: float | None = float(results["delta"][row]) / D
    if case.prospect.has_prescribed_forces:
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
    return Value(number, 0.0, theory.name) if number is not None and math.isfinite(number) else None


def _beside(published: Published, results: Results, row: int | None) -> Value | None:
    """The theory that stands beside a run in its report, where that is exact for its friction too."""
    theory = results.report.get("theory") or {}
    if row is None or not theory.get("exact") or not theory.get(published.quantity):
        return None
    is_deepest = row == int(np.argmax(results["delta"]))
    return Value(float(theory[published.quantity]), 0.0, theory["name"]) if is_deepest else None
