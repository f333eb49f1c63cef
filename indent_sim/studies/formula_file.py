"""Files with a closed formula, as statements of Python and as an equation for LaTeX."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.result_files import PROGRAM
from indent_sim.studies.closed_formula import ClosedFormula
from indent_sim.studies.dimensionless_groups import powers_text
from indent_sim.studies.formula_fit import LARGEST_ERROR, MAX_COEFFICIENTS
from indent_sim.studies.formula_text import comment, latex_text, python_text
from indent_sim.studies.surrogate import Surrogate


def formula_entry(column: str, formula: ClosedFormula | None) -> dict[str, Any]:
    """Return the closed formula as an object for the file of the surrogate.

    Parameters
    ----------
    column
        The column.
    formula
        The formula; None if the column has values that are not positive.

    Returns
    -------
    dict
        The parts of the formula, its error, and its text for Python and LaTeX; or the "reason" why
        there is no formula.
    """
    if formula is None:
        return {"reason": f"no closed formula: {column} has values that are not positive"}
    # An error that is no number is not within the limit either.
    if not formula.error["error"] <= LARGEST_ERROR:
        return {
            "reason": f"no closed formula of at most {MAX_COEFFICIENTS} coefficients is within "
            f"{100 * LARGEST_ERROR:g} %: the best one has {formula.coefficient_count}, "
            f"{formula.error_text()}; give the study narrower ranges, or use the surrogate"
        }
    return {
        "coefficients": formula.coefficient_count,
        "words": formula.error_text(),
        "python": python_text(formula),
        "latex": latex_text(formula),
    } | formula.as_json()


def formula_files(column: str) -> tuple[str, str]:
    """Return the names of the files of a closed formula in the folder of a study."""
    return f"formula-{column}.txt", f"formula-{column}.tex"


def write_formula(surrogate: Surrogate, directory: Path) -> None:
    """Write the files of the closed formula of a surrogate, or why there is none."""
    entry = surrogate.information["formula"]
    lines = _description(surrogate, entry)
    for name, language, sign in zip(
        formula_files(surrogate.column), ("python", "latex"), ("#", "%"), strict=True
    ):
        write_atomically(directory / name, comment(lines, sign) + entry.get(language, ""))


def formula_summary(surrogate: Surrogate, directory: Path) -> list[str]:
    """Return lines on the closed formula of a surrogate and its files."""
    entry = surrogate.information["formula"]
    if "reason" in entry:
        return [entry["reason"]]
    names = " and ".join(str(directory / name) for name in formula_files(surrogate.column))
    return [f"closed formula of {entry['coefficients']} coefficients in {names}: {entry['words']}"]


def _description(surrogate: Surrogate, entry: Mapping[str, Any]) -> list[str]:
    """Return lines on the study, the error and the range of a formula."""
    title = surrogate.information["title"]
    lines = [f"{surrogate.column} of the study {title}, fitted by {PROGRAM} {VERSION}"]
    if "reason" in entry:
        return [*lines, entry["reason"]]
    lines += [entry["words"], f"range: {surrogate.range_text()}"]
    lines += [
        f"for {powers_text(powers)} = {math.exp(logarithm):.6g}"
        for powers, logarithm in surrogate.constant
    ]
    return [*lines, "all other keys have their values in the study"]
