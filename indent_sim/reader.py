"""Files of a result folder read back and checked: a damaged one is refused in words, whatever is wrong with it.

Folders come from killed runs, full disks, editors and other people. Only what a reader of this program uses is
checked, and nothing that stands in a file is repeated in an error beyond names and places.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

import numpy as np
from annotated_types import Ge
from pydantic import AllowInfNan, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from indent_sim.errors import UsageError
from indent_sim.folder import REPORT, content, read_report

LARGEST = 1e150  # a number whose square and cube are numbers too
WHOLE = 1e15  # a step is a whole number below this

Number = Annotated[float, AllowInfNan(False), Ge(-LARGEST)]
Known = Number | None
Count = Annotated[int, Ge(0)]


class _Units(TypedDict, total=False):
    length: str
    force: str


class _Choice(TypedDict, total=False):
    key: str


class _Prediction(TypedDict, total=False):
    force_error: Known


class _Plan(TypedDict, total=False):
    choices: list[_Choice]
    prediction: _Prediction


class _Curve(TypedDict, total=False):
    delta: list[Number]
    force: list[Number]
    a: list[Number]


class _HalfSpace(TypedDict, total=False):
    name: str
    delta: Number
    force: Number
    deviation: Known


class _Theory(TypedDict):
    name: str
    delta: Number
    force: Number
    force_deviation: NotRequired[Known]
    delta_deviation: NotRequired[Known]
    why: NotRequired[str]
    curve: NotRequired[_Curve]
    half_space: NotRequired[_HalfSpace | None]


class _Audit(TypedDict, total=False):
    force_against_reaction: Known
    substeps: Count


class _Accuracy(TypedDict, total=False):
    target: Number
    elements: Number
    tried: list[Number]


class _Mesh(TypedDict, total=False):
    hash: str


class _Report(TypedDict, total=False):
    status: Literal["running", "done", "failed", "interrupted"]
    exit_code: int | None
    reason: str
    rows: Count
    version: str
    started: str
    title: str
    units: _Units
    gap: str
    method: str
    control: str
    center: list[Number]
    plan: _Plan
    theory: _Theory | None
    warnings: list[str]
    audit: _Audit | None
    accuracy: _Accuracy | None
    timings: dict[str, Number]
    cpu_timings: dict[str, Number]
    peak_memory_MB: Known
    memory_before_MB: Known
    dofs: Count
    mesh: _Mesh | None
    resumed_after: list[Count]


_SHAPE: TypeAdapter[Any] = TypeAdapter(_Report)


def checked_report(folder: Path) -> dict[str, Any]:
    """The run.json of a folder, empty when there is none or it is not this program's; UsageError when an entry is not
    what the program writes."""
    report = read_report(folder)
    try:
        _SHAPE.validate_python(report, strict=True)
        _check_theory(report.get("theory") or {})
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False, include_context=False)[0]
        place = ".".join(str(part) for part in found["loc"] if isinstance(part, int) or str(part).isidentifier())
        raise UsageError(f"{folder / REPORT} is damaged: {place}: {found['msg']}") from None
    except ValueError as error:
        raise UsageError(f"{folder / REPORT} is damaged: theory: {error}") from None
    return report


def _check_theory(theory: dict[str, Any]) -> None:
    if theory and theory.get("delta_deviation", theory.get("force_deviation")) is None:
        raise ValueError("says no deviation")
    closed = theory.get("half_space")
    asked = "delta" if "delta_deviation" in theory else "force"
    if closed and (closed.get(asked) is None or closed.get("deviation") is None or "name" not in closed):
        raise ValueError("half_space lacks an entry")
    if len({len(theory.get("curve", {}).get(name, ())) for name in ("delta", "force", "a")}) > 1:
        raise ValueError("the columns of its curve have different lengths")


def read_table(path: Path, needed: Sequence[str], unknown: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """The columns of a CSV file with a header; a last line without its newline was torn and is dropped.

    UsageError when it is no such file. Numbers of the `needed` columns are finite, but in those that may be `unknown`;
    there, and in other columns, an empty cell is NaN.
    """
    try:
        text = content(path).decode("utf-8")
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError:
        raise UsageError(f"{path} is not a table of numbers with a header: not UTF-8 text") from None
    lines = [line for line in text[: text.rfind("\n") + 1].split("\n") if line.strip()]
    if not lines:
        raise UsageError(f"{path} is empty")
    header = [name.strip() for name in lines[0].split(",")]
    for name in (*needed, *unknown):
        if name not in header:
            raise UsageError(f"{path} has no column '{name}': not a table of results")
    if len(set(header)) < len(header):
        raise UsageError(f"{path} has two columns of one name")
    rows = [_row(line, header, f"{path}: line {number}") for number, line in enumerate(lines[1:], start=2)]
    values = np.array(rows, dtype=float).reshape(len(rows), len(header))
    columns = {name: values[:, i] for i, name in enumerate(header)}
    for name in needed:
        if name not in unknown and not np.isfinite(columns[name]).all():
            raise UsageError(f"{path}: column '{name}' holds a cell that is no number")
    return columns


def _row(line: str, header: Sequence[str], place: str) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(header):
        raise UsageError(f"{place} has {len(cells)} cells, the header {len(header)}: no table of numbers")
    return [_number(cell, f"{place}, column {n}") for n, cell in enumerate(cells, start=1)]


def _number(cell: str, place: str) -> float:
    try:
        value = float(cell) if cell.strip() else np.nan
    except ValueError:
        raise UsageError(f"{place} is not a number: no table of numbers with a header") from None
    if abs(value) > LARGEST:
        raise UsageError(f"{place} is no number that a result can hold")
    return value


def read_steps(path: Path, needed: Sequence[str], unknown: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """A table with a row per step, each a whole number from 0 on, once; UsageError otherwise."""
    columns = read_table(path, ["step", *needed], unknown)
    steps = columns["step"]
    if not ((steps >= 0) & (steps < WHOLE) & (steps == np.floor(steps))).all():
        raise UsageError(f"{path}: a step is not a whole number")
    if len(set(steps)) != len(steps):
        raise UsageError(f"{path} holds a step twice")
    return columns
