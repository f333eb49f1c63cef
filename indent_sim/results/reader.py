"""Files of a result folder read back and checked; what an earlier run left for `--resume`."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

import numpy as np
from annotated_types import Ge
from pydantic import AllowInfNan, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from indent_sim.model.state import COLUMNS, EFFORT, ERRORS, OF_FRICTION, READINGS, State
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.folder import CONFIG, PROGRAM, REPORT, TABLE, content, read_report, refuse_links
from indent_sim.results.tables import EXPERIMENT, SURFACE, SURFACE_COLUMNS, SURFACE_MAY_BE_EMPTY, number, state_of
from indent_sim.results.xdmf import lost_fields

STUDY = "study.json"  # in the folder of a study
RUN_ELSEWHERE = "delete the folder and run its scene again, or choose another --output for that"
RUN_AGAIN = "run its scene again without --resume, or with another --output"
COMPARED = ("delta", "force", "a")


@dataclass(frozen=True)
class Results:
    """A finished (or partial) run read back: the force table by column, its run.json and its surface table.

    table: columns of force_indentation.csv; surface: columns of surface.csv, empty when there is none.
    """

    path: Path
    table: dict[str, np.ndarray]
    report: dict[str, Any] = field(default_factory=dict)
    surface: dict[str, np.ndarray] = field(default_factory=dict)

    def __getitem__(self, column: str) -> np.ndarray:
        return self.table[column]

    def __len__(self) -> int:
        return len(self.table["step"])


def read(path: Path | str) -> Results:
    """Read a result folder or a force table; UsageError when there is none or it is damaged.

    Of a table that is no result's, a measured curve, the rows are numbered, and the contact radius may be unknown.
    """
    path = Path(path)
    columns = _force_table(path)
    surface = {}
    if os.path.lexists(path / SURFACE):
        surface = read_table(path / SURFACE, SURFACE_COLUMNS, SURFACE_MAY_BE_EMPTY)
        known = np.isin(surface["step"], columns["step"])
        surface = {name: values[known] for name, values in surface.items()}
    return Results(path, columns, checked_report(path), surface)


def _force_table(path: Path) -> dict[str, np.ndarray]:
    file = force_table(path)
    if file == path:
        columns = read_table(path, ("delta", "force"))
        if "step" not in columns:
            rows = len(columns["delta"])
            return {"step": np.arange(1.0, rows + 1), "a": np.full(rows, np.nan)} | columns
    return read_steps(file, ("delta", "force"), unknown=("a",))


def force_table(path: Path) -> Path:
    """The force table of a result folder, and of a file itself; UsageError for a folder without one."""
    if not path.is_dir():
        return path
    if os.path.lexists(file := path / TABLE):
        return file
    if os.path.lexists(path / STUDY):
        remedy = f"name {path / 'runs' / 'NAME'}, the folder of a run"
        raise UsageError(f"{path} holds a study, which has no {TABLE} of its own", remedy, str(path))
    remedy = RUN_AGAIN if read_report(path) else "name the folder of a result"
    raise UsageError(f"cannot read {file}: there is none", remedy, str(file))


def read_run(path: Path) -> Results:
    """Read a result folder, with an empty table where the run failed before its first row; errors as of `read`."""
    report = checked_report(path)
    if report.get("rows"):
        return read(path)
    return Results(path, {name: np.empty(0) for name in ("step", *COMPARED, "newton_iterations")}, report)


def rows_of(states: Iterable[State]) -> list[dict[str, Any]]:
    """The rows of the force table as mappings from column to number."""
    names = (*COLUMNS, *READINGS, *OF_FRICTION, *EFFORT, *ERRORS)
    rows = ({name: getattr(state, name) for name in names} for state in states)
    return [{name: value for name, value in row.items() if value is not None} for row in rows]


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


class _HalfSpaceCurve(TypedDict):
    delta: list[Number]
    force: list[Number]


class _HalfSpace(TypedDict, total=False):
    name: str
    delta: Number
    force: Number
    deviation: Known
    curve: _HalfSpaceCurve


class _Formula(TypedDict, total=False):
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
    formulas: NotRequired[list[_Formula]]


class _Hertz(TypedDict):
    E: Number
    percent: Number


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
    hertz: _Hertz | None
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


@cache
def _shape() -> TypeAdapter[Any]:
    """What a run.json looks like; a run that reads none need not work it out."""
    return TypeAdapter(_Report)


def checked_report(folder: Path) -> dict[str, Any]:
    """The run.json of a folder, empty when there is none; UsageError when it is not what the program writes."""
    report = read_report(folder)
    if not report and os.path.lexists(folder / REPORT):
        raise _damaged(folder, f"no JSON object that says program: {PROGRAM}")
    try:
        _shape().validate_python(report, strict=True)
        _check_theory(report.get("theory") or {})
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False, include_context=False)[0]
        place = ".".join(str(part) for part in found["loc"] if isinstance(part, int) or str(part).isidentifier())
        raise _damaged(folder, f"{place}: {found['msg']}") from None
    except ValueError as error:
        raise _damaged(folder, f"theory: {error}") from None
    return report


def _damaged(folder: Path, why: str) -> UsageError:
    return UsageError(f"{folder / REPORT} is damaged: {why}", RUN_ELSEWHERE, str(folder / REPORT))


def _check_theory(theory: dict[str, Any]) -> None:
    if theory and theory.get("delta_deviation", theory.get("force_deviation")) is None:
        raise ValueError("says no deviation")
    closed = theory.get("half_space")
    asked = "delta" if "delta_deviation" in theory else "force"
    for said in filter(None, [closed, *theory.get("formulas", [])]):
        if said.get(asked) is None or said.get("deviation") is None or "name" not in said:
            raise ValueError("a formula lacks an entry")
    if len({len(theory.get("curve", {}).get(name, ())) for name in ("delta", "force", "a")}) > 1:
        raise ValueError("the columns of its curve have different lengths")


def read_table(
    path: Path, needed: Sequence[str], unknown: Sequence[str] = (), words: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """The columns of a CSV file with a header; a last line without its newline was torn and is dropped.

    UsageError when it is no such file. Numbers of the `needed` columns are finite, but in those that may be `unknown`;
    there, and in other columns, an empty cell is NaN. Columns of `words` are text as it stands.
    """
    if path.name == EXPERIMENT and not words:
        raise UsageError(f"{path} is the table of an experiment: its picture is experiment.png in the result folder",
                         file=str(path))  # fmt: skip
    try:
        text = content(path).decode("utf-8")
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or error}", file=str(path)) from None
    except ValueError:
        raise UsageError(f"{path} is not a table of numbers with a header: not UTF-8 text", file=str(path)) from None
    lines = [line for line in text[: text.rfind("\n") + 1].split("\n") if line.strip()]
    if not lines:
        raise UsageError(f"{path} is empty", file=str(path))
    header = [name.strip() for name in lines[0].split(",")]
    for name in (*needed, *unknown):
        if name not in header:
            raise UsageError(f"{path} has no column '{name}': not a table of results", file=str(path))
    if len(set(header)) < len(header):
        raise UsageError(f"{path} has two columns of one name", file=str(path))
    rows = [_row(line, header, words, f"{path}: line {number}") for number, line in enumerate(lines[1:], start=2)]
    cells = list(zip(*rows, strict=True)) or [()] * len(header)
    columns = {name: np.array(cells[i], dtype=str if name in words else float) for i, name in enumerate(header)}
    for name in needed:
        if name not in unknown and not np.isfinite(columns[name]).all():
            raise UsageError(f"{path}: column '{name}' holds a cell that is no number", file=str(path))
    return columns


def _row(line: str, header: Sequence[str], words: Sequence[str], place: str) -> list[float | str]:
    cells = line.split(",")
    if len(cells) != len(header):
        raise UsageError(f"{place} has {len(cells)} cells, the header {len(header)}: no table of numbers")
    return [cell if name in words else _number(cell, f"{place}, column {n}")
            for n, (name, cell) in enumerate(zip(header, cells, strict=True), start=1)]  # fmt: skip


def _number(cell: str, place: str) -> float:
    try:
        value = number(cell)
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
        raise UsageError(f"{path}: a step is not a whole number", file=str(path))
    if len(set(steps)) != len(steps):
        raise UsageError(f"{path} holds a step twice", file=str(path))
    return columns


SAME_DEPTH = 1e-9  # relative
OF_THE_WRITER = {"program", "version", "status", "exit_code", "reason", "rows", "started", "finished"}


@dataclass(frozen=True)
class Earlier:
    """The rows of an earlier run, its table's columns, the length that holds them [bytes], and its run.json."""

    states: tuple[State, ...]
    columns: tuple[str, ...]
    size: int
    report: dict[str, Any]

    def check(self, deltas: Sequence[float] | None, steps: int, folder: Path) -> None:
        """UsageError when these are not rows of a path of so many steps, to these depths where they are prescribed."""
        table = str(folder / TABLE)
        if len(self.states) > steps:
            problem = f"{table} has {len(self.states)} rows, the scene {steps} steps: it is damaged"
            raise UsageError(problem, RUN_AGAIN, table)
        for state, delta in zip(self.states, deltas or (), strict=False):
            if not math.isclose(state.delta, delta, rel_tol=SAME_DEPTH, abs_tol=0):
                problem = f"{table}: row {state.step} is not at the scene's depth: it is damaged"
                raise UsageError(problem, RUN_AGAIN, table)

    def finished(self, steps: int) -> bool:
        """Whether that run came to its end."""
        return self.report.get("status") == "done" and len(self.states) == steps

    @property
    def worst_audit(self) -> float:
        """The audit of the earlier rows; 0 when that run could not say."""
        return float((self.report.get("audit") or {}).get("force_against_reaction") or 0.0)

    @property
    def entries(self) -> dict[str, Any]:
        """What the run put into run.json beside the writer's own entries; `resumed_after` grows by one."""
        own = {name: value for name, value in self.report.items() if name not in OF_THE_WRITER}
        return own | {"resumed_after": [*own.get("resumed_after", []), len(self.states)]}


def earlier_run(folder: Path, config_yaml: str) -> Earlier | None:
    """The run of this config in a folder; None when the folder holds no run.

    Raises ConfigError when it holds a run of another config, UsageError when its rows cannot be understood.
    """
    report = checked_report(folder)
    if not report:
        return None
    try:
        refuse_links(folder)
        _refuse_other(folder, content(folder / CONFIG).decode("utf-8"), config_yaml)
        unknown = ("energy",) if report.get("method") == "theory" else ()
        return Earlier(*_rows(folder / TABLE, unknown), report)
    except FileNotFoundError as error:
        raise UsageError(f"{folder} has {REPORT} but no {Path(error.filename).name}", RUN_AGAIN, str(folder)) from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{folder} holds a {CONFIG} or {TABLE} that is no text", RUN_AGAIN, str(folder)) from error
    except OSError as error:
        raise UsageError(f"cannot read {folder}: {error.strerror or error}", RUN_AGAIN, str(folder)) from error


def lost_files(folder: Path, surface: bool, fields: bool) -> list[str]:
    """The files of a finished run, with a surface table and fields or without, that are missing or damaged now."""
    lost = lost_fields(folder) if fields else []
    return [*lost, SURFACE] if surface and not _has_last_surface(folder) else lost


def _has_last_surface(folder: Path) -> bool:
    try:
        found = read(folder)
    except UsageError:
        return False
    return found["step"][-1] in found.surface.get("step", ())


def _refuse_other(folder: Path, theirs: str, ours: str) -> None:
    if theirs == ours:
        return
    there, here = (dict(_keyed(text)) for text in (theirs, ours))
    only_there, only_here = (_first_of_its_own(*pair) for pair in ((there, here), (here, there)))
    told = [f"'{text}' {where}" for (_, text), where in ((only_there, "there"), (only_here, "here")) if text]
    raise ConfigError(
        only_here[0],
        f"{folder} holds a run of another config ({', '.join(told) or 'the same lines in another order'})",
        "give the same scene and --set as then, or another --output, or leave --resume out to replace it",
    )


def _first_of_its_own(one: dict[str, str], other: dict[str, str]) -> tuple[str, str]:
    """Key and text of the first line that another config has not; empty where it has all."""
    return next(((key, line.strip()[:80]) for key, line in one.items() if other.get(key) != line), ("", ""))


def _keyed(config_yaml: str) -> Iterator[tuple[str, str]]:
    """The lines of a config.yaml, each with its key: `mesh.h_far`."""
    section = ""
    for line in config_yaml.splitlines():
        name = line.split(":")[0]
        section = section if name.startswith(" ") else name
        yield f"{section}.{name.strip()}" if name.startswith(" ") else name, line


def _rows(path: Path, unknown: Sequence[str]) -> tuple[tuple[State, ...], tuple[str, ...], int]:
    lines = content(path).split(b"\n")[:-1]  # what has no newline was torn
    if not lines:
        return (), COLUMNS, 0
    names = tuple(lines[0].decode().split(","))
    known = {*READINGS, *OF_FRICTION, *EFFORT, *ERRORS}
    if names[: len(COLUMNS)] != COLUMNS or not set(names[len(COLUMNS) :]) <= known:
        raise UsageError(f"{path} has other columns than this version writes", RUN_AGAIN, str(path))
    states: list[State] = []
    size = len(lines[0]) + 1
    for line in lines[1:]:
        state = state_of(names, line, unknown)
        if state is None or state.step != len(states) + 1:
            break
        states.append(state)
        size += len(line) + 1
    return tuple(states), names, size
