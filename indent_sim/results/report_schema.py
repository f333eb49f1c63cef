"""Schema of run.json, by which a report is validated before its numbers are used."""

from __future__ import annotations

import os
from collections.abc import Collection
from functools import cache
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Literal, NotRequired, cast

from annotated_types import Ge
from pydantic import AllowInfNan, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from indent_sim.process.errors import UsageError
from indent_sim.results.csv_table import LARGEST_NUMBER
from indent_sim.results.result_files import PROGRAM, REPORT, Report, read_report

Number = Annotated[float, AllowInfNan(False), Ge(-LARGEST_NUMBER)]
OptionalNumber = Number | None
Count = Annotated[int, Ge(0)]


def _mapping_type(name: str = "mapping", /, *, needed: Collection[str] = (), **entries: Any) -> Any:
    """Return a TypedDict type of the entries; entries that are not `needed` may be missing."""
    kinds = {key: kind if key in needed else NotRequired[kind] for key, kind in entries.items()}
    return cast(Any, TypedDict)(name, kinds)


@cache
def _report_schema() -> TypeAdapter[Report]:
    """Return the validator of run.json, which is created at first use."""
    answer: Any = {"name": str, "delta": Number, "force": Number}
    curve: Any = {"delta": list[Number], "force": list[Number]}
    force_point = _mapping_type(
        "_ForcePoint", needed=("delta", "force"), delta=Number, force=Number, error=OptionalNumber
    )
    half_space = _mapping_type(
        **answer, deviation=OptionalNumber, curve=_mapping_type(needed=curve, **curve)
    )
    formula_entries = {
        "half_space": half_space | None,
        "curve": _mapping_type(**curve, a=list[Number]),
        "why": str,
    }
    formula_entries |= {
        "formulas": GenericAlias(list, _mapping_type(**answer, deviation=OptionalNumber))
    }
    theory = _mapping_type(
        needed=answer,
        **answer,
        force_deviation=OptionalNumber,
        delta_deviation=OptionalNumber,
        error=OptionalNumber,
        stiffness=OptionalNumber,
        stiffness_deviation=OptionalNumber,
        **formula_entries,
    )
    choices = GenericAlias(list, _mapping_type(key=str))
    entries: Any = dict.fromkeys(
        ("reason", "version", "started", "finished", "title", "gap", "method", "control"), str
    )
    entries |= {
        "timings": dict[str, Number],
        "cpu_timings": dict[str, Number],
        "versions": dict[str, object],
        "peak_memory_MB": OptionalNumber,
        "memory_before_MB": OptionalNumber,
        "rows": Count,
        "dofs": Count,
        "exit_code": int | None,
        "center": list[Number],
        "warnings": list[str],
        "resumed_after": list[Count],
    }
    entries |= {
        "units": _mapping_type(length=str, force=str),
        "asked": _mapping_type(error_bars=bool, accuracy=OptionalNumber),
    }
    report = _mapping_type(
        **entries,
        status=Literal["running", "done", "failed", "interrupted"],
        plan=_mapping_type(
            auto=list[str],
            choices=choices,
            prediction=_mapping_type(
                force_error=OptionalNumber, a=OptionalNumber, elastocapillary_length=OptionalNumber
            ),
        ),
        theory=theory | None,
        onset_of_yield=_mapping_type(
            needed=("delta", "force", "a", "passed"),
            delta=Number,
            force=Number,
            a=Number,
            passed=bool,
        ),
        hertz=_mapping_type(needed=("E", "percent"), E=Number, percent=Number) | None,
        audit=_mapping_type(force_against_reaction=OptionalNumber, substeps=Count) | None,
        accuracy=_mapping_type(target=Number, elements=Number, tried=list[Number]) | None,
        stick=_mapping_type(needed=("words",), words=str) | None,
        adhesion=GenericAlias(dict, (str, OptionalNumber | force_point)) | None,
        experiment=_mapping_type(
            by=str,
            adhesion=_mapping_type(
                pull_off=GenericAlias(dict, (str, force_point)) | None,
                lost_contact=str,
                series_error=Number,
                words=str,
            )
            | None,
        )
        | None,
        mesh=_mapping_type(hash=str) | None,
        time=_mapping_type(
            way=str, method=str, why=str, words=str, limits=dict[str, OptionalNumber]
        )
        | None,
    )
    return TypeAdapter(report)


def checked_report(folder: Path) -> Report:
    """Return the validated run.json of a folder, empty if there is none.

    Raises
    ------
    UsageError
        If the file was not written by this program or is damaged; the message names the entry.
    """
    report = read_report(folder)
    if not report and os.path.lexists(folder / REPORT):
        raise _damaged_report(
            folder, f'it is not a JSON object whose entry "program" is "{PROGRAM}"'
        )
    try:
        _report_schema().validate_python(report, strict=True)
        _check_theory(report.get("theory") or {})
    except ValidationError as error:
        finding = error.errors(include_url=False, include_input=False, include_context=False)[0]
        place = ".".join(
            str(part)
            for part in finding["loc"]
            if isinstance(part, int) or str(part).isidentifier()
        )
        raise _damaged_report(folder, f"{place}: {finding['msg']}") from None
    except ValueError as error:
        raise _damaged_report(folder, f"theory: {error}") from None
    return report


def _damaged_report(folder: Path, why: str) -> UsageError:
    """Return the error for a damaged run.json, with its reason and remedy."""
    remedy = "delete the folder and run its scene again, or choose another --output"
    return UsageError(f"{folder / REPORT} is damaged: {why}", remedy, str(folder / REPORT))


def _check_theory(theory: Report) -> None:
    """Check relations between entries of `theory` that the schema cannot express."""
    if theory and theory.get("delta_deviation", theory.get("force_deviation")) is None:
        raise ValueError("the entry theory lacks the deviation of the run from theory")
    half_space = theory.get("half_space")
    computed = "delta" if "delta_deviation" in theory else "force"
    for formula in filter(None, [half_space, *theory.get("formulas", [])]):
        if (
            formula.get(computed) is None
            or formula.get("deviation") is None
            or "name" not in formula
        ):
            raise ValueError("a formula of the entry theory lacks its name, value or deviation")
    curve = theory.get("curve", {})
    # Published functions for bodies that yield give no contact radius.
    names = ("delta", "force", *(name for name in ("a",) if name in curve))
    if len({len(curve.get(name, ())) for name in names}) > 1:
        raise ValueError("the columns of the curve of the entry theory have different lengths")
