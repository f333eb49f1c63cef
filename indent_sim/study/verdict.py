"""Verdicts on the rows of a study with a tolerance: right, flagged, refused or wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

REFERENCE = "reference"  # the finest run, which the others are compared with
VERDICTS = ("right", "flagged", "refused", "wrong")
MEANINGS = {
    "right": "the force is within the tolerance",
    "flagged": "it is not, and the run itself states an error at least as large",
    "refused": "no force: a clear error before or during the run",
    "wrong": "a wrong force without a word, or a crash",
}
REFUSALS = range(3, 7)  # exit codes that come with a reason: config, mesh, not converged, audit


def verdict(row: Mapping[str, Any], tolerance: float, *, is_reference: bool) -> str | None:
    """One of VERDICTS or REFERENCE; None for a row that is pending or has nothing to be compared with."""
    if row["status"] == "failed":
        return "refused" if row["exit_code"] in REFUSALS else "wrong"
    error = row["force_error_vs"]
    if row["status"] != "done" or error is None:
        return None
    if is_reference:
        return REFERENCE
    if abs(error) <= tolerance:
        return "right"
    return "flagged" if abs(error) <= (row["stated_error"] or 0.0) else "wrong"


def counts(rows: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """How many rows have each of VERDICTS."""
    return {name: sum(row["verdict"] == name for row in rows) for name in VERDICTS}


def impossible(rows: Sequence[Mapping[str, Any]]) -> int:
    """How many rows were refused as scenes that cannot be, before anything was run; a contact method's own limit is
    none of them."""
    refused = [row["reason"] for row in rows if row["verdict"] == "refused" and row["exit_code"] == 3]
    return sum("contact." not in reason.partition(": ")[2].partition(": ")[0] for reason in refused)
