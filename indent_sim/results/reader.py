"""Files of a result folder read back and checked; what an earlier run left for `--resume`."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import GenericAlias
from typing import TYPE_CHECKING, Annotated, Any, Literal, NotRequired, cast

import numpy as np
from annotated_types import Ge
from pydantic import AllowInfNan, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from indent_sim.config.quantities import size_of
from indent_sim.config.scene_file import load, to_yaml
from indent_sim.config.schema import GONE
from indent_sim.config.strict_yaml import inline, key_text, leaves, parse
from indent_sim.model.state import (
    DERIVED_COLUMNS,
    ERROR_COLUMNS,
    FLUID_COLUMNS,
    FRICTION_COLUMNS,
    KRYLOV_COLUMNS,
    REACTION_COLUMNS,
    STATE_COLUMNS,
    TIME_COLUMNS,
    State,
)
from indent_sim.process.errors import BackendError, ConfigError, UsageError
from indent_sim.process.screen import Shown
from indent_sim.results import folder as result_folder
from indent_sim.results import tables
from indent_sim.results.folder import (
    CONFIG,
    PROGRAM,
    REPORT,
    TABLE,
    Keep,
    Report,
    content,
    has_rows,
    read_report,
)
from indent_sim.results.tables import EXPERIMENT, SURFACE, WORD_COLUMNS, state_of
from indent_sim.results.xdmf import lost_fields

if TYPE_CHECKING:
    import pandas

RUN_ELSEWHERE = "delete the folder and run its scene again, or choose another --output for that"
RUN_AGAIN = "run its scene again without --resume, or with another --output"
SHOWN_COLUMNS = (
    "step",
    "t",
    "delta",
    "force",
    "force_error",
    "a",
    "p_max",
    "branch",
)  # in a notebook
COMPARED = ("delta", "force", "a")
SAME_DEPTH = 1e-9  # relative
LONGEST_HEADER = 10_000  # bytes
MEASURED = "measured"  # entry of the report of a curve that nobody simulated
BEYOND_STATE = (
    *DERIVED_COLUMNS,
    *FRICTION_COLUMNS,
    *FLUID_COLUMNS,
    *KRYLOV_COLUMNS,
    *ERROR_COLUMNS,
    *TIME_COLUMNS,
    *REACTION_COLUMNS,
)  # columns that not every run has
# Columns of what was found: numbers without their error bars, and not what says which row it is or
# what it took
FOUND_COLUMNS = tuple(
    name
    for name in (*STATE_COLUMNS, *DERIVED_COLUMNS, *FRICTION_COLUMNS, *FLUID_COLUMNS, *TIME_COLUMNS)
    if name not in ("step", "wall_s", *WORD_COLUMNS)
)


@dataclass(frozen=True)
class Results:
    """A finished (or partial) run read back: the force table by column, its run.json and its
    surface table.

    table: columns of force_indentation.csv; surface: columns of surface.csv, empty when there is
    none.
    """

    path: Path
    table: dict[str, np.ndarray]
    report: Report = field(default_factory=dict)
    surface: dict[str, np.ndarray] = field(default_factory=dict)

    def __getitem__(self, column: str) -> np.ndarray:
        return self.table[column]

    def __len__(self) -> int:
        return len(self.table["step"])

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of its table."""
        return tuple(self.table)

    def __repr__(self) -> str:
        return self._shown().text

    def _repr_html_(self) -> str:
        return self._shown().html

    def _shown(self) -> Shown:
        """What a notebook shows: the columns that tell most, and how the run ended."""
        names = [
            name
            for name in SHOWN_COLUMNS
            if name in self.table and np.any(self[name] == self[name])
        ]
        rows = list(zip(*(self[name].tolist() for name in names), strict=True))
        units = ", ".join(filter(None, (self.report.get("units") or {}).values()))
        said = [self.report.get("title") or str(self.path), self.report.get("status", ""), units]
        return Shown(
            "  ·  ".join(filter(None, said)),
            names,
            rows,
            "; ".join(self.report.get("warnings", ())),
        )

    def to_pandas(self) -> pandas.DataFrame:
        """Its force table as a DataFrame; BackendError without pandas."""
        return data_frame(self.table)


def data_frame(table: Mapping[str, np.ndarray]) -> pandas.DataFrame:
    """Columns as a DataFrame; BackendError without pandas, which nothing else here needs."""
    try:
        import pandas
    except ImportError as error:
        raise BackendError(
            f"pandas: {error}; install it beside this program, pip install pandas"
        ) from error
    return pandas.DataFrame(dict(table))


def read(path: Path | str, report: Report | None = None) -> Results:
    """Read a result folder, a force table or a measured curve; UsageError when there is none or it
    is damaged.

    report: what its run.json says, where this process has just written it [read and checked]. Of a
    table that is no result's, a measured curve, the rows are numbered, its units are those that it
    says, and the contact radius is unknown.
    """
    path = Path(path)
    file = force_table(path)
    if file == path and path.name == EXPERIMENT:
        read_table(path, ())  # which says what it is
    if file == path and not _is_result_table(path):
        return _of_curve(path)
    columns = read_table(
        file, ("step", "delta", "force"), unknown=("a", "delta"), words=WORD_COLUMNS
    )
    if "t" not in columns and not np.isfinite(columns["delta"]).all():
        raise UsageError(f"{file}: column 'delta' holds a cell that is no number", file=str(file))
    steps = columns["step"]
    if not ((steps >= 0) & (steps < LARGEST_STEP_NUMBER) & (steps == np.floor(steps))).all():
        raise UsageError(f"{file}: a step is not a whole number", file=str(file))
    if len(set(steps)) != len(steps):
        raise UsageError(f"{file} holds a step twice", file=str(file))
    surface = {}
    if os.path.lexists(path / SURFACE):
        surface = read_table(path / SURFACE, tables.SURFACE_COLUMNS, tables.SURFACE_MAY_BE_EMPTY)
        known = np.isin(surface["step"], columns["step"])
        surface = {name: values[known] for name, values in surface.items()}
    return Results(path, columns, report_of(path) if report is None else report, surface)


def report_of(path: Path) -> Report:
    """The run.json of a result folder; of a force table by itself the units that the run.json
    beside it says.
    """
    if path.is_dir():
        return checked_report(path)
    units = read_report(path.parent).get("units") if path.name == TABLE else None
    is_known = isinstance(units, Mapping) and all(isinstance(one, str) for one in units.values())
    return {"units": units} if is_known else {}


def _is_result_table(path: Path) -> bool:
    """Whether a file has the columns of a force table, or is none that could be read."""
    return "step" in header_of(path) or not path.is_file()


def header_of(path: Path) -> list[str]:
    """The titles in the first line of a table with commas; none where nothing can be read."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            line = file.read(LONGEST_HEADER).split(b"\n")[0]
    except OSError:
        return []
    return [name.strip() for name in line.decode("latin-1").split(",")]


def _of_curve(path: Path) -> Results:
    """The first curve of a file of measured ones, as a table; its way stands for a depth that it
    does not have.
    """
    from indent_sim.results.measured.curve_file import (
        read_measured,
    )  # with all formats, which no run needs
    from indent_sim.results.measured.measurement import NoCurve

    try:
        curve = read_measured(path)[0]
    except NoCurve as error:
        raise UsageError(f"{path} is {error.problem}", error.remedy, str(path)) from None
    delta = curve.x(curve.along("delta"))
    rows = len(curve)
    table = {
        "step": np.arange(1.0, rows + 1),
        "a": np.full(rows, np.nan),
        "delta": delta,
        "force": curve.force,
    }
    table |= {"t": curve.t} if curve.t is not None else {}
    return Results(
        path,
        table,
        {MEASURED: True, "units": {name: curve.units[name] for name in ("length", "force")}},
    )


def in_common_units(runs: Sequence[Results]) -> list[Results]:
    """The results, measured curves in the units of the first that is none; ConfigError for units
    that are none.

    A curve that says no units has those of the others.
    """
    said = sorted(runs, key=lambda run: run.report.get(MEASURED, False))
    known = (run.report.get("units") or {} for run in said)
    units = next((one for one in known if one.get("length") and one.get("force")), {})
    return [_in_units(run, units) if units and run.report.get(MEASURED) else run for run in runs]


def refuse_other_units(runs: Sequence[Results], remedy: str) -> None:
    """UsageError when two runs measure in different units; one that does not say is taken as it is."""
    for kind in ("length", "force"):
        known = {
            unit: run.path for run in runs if (unit := (run.report.get("units") or {}).get(kind))
        }
        if len(known) > 1:
            (one, first), (other, second) = list(known.items())[:2]
            raise UsageError(f"{first} measures {kind} in {one}, {second} in {other}: {remedy}")


def _in_units(run: Results, units: Mapping[str, str]) -> Results:
    table = dict(run.table)
    for column, kind in (("delta", "length"), ("force", "force")):
        if own := run.report["units"][kind]:
            table[column] = table[column] * (size_of(own, kind) / size_of(units[kind], kind))
    return replace(run, table=table, report=run.report | {"units": dict(units)})


def force_table(path: Path) -> Path:
    """The force table of a result folder, and of a file itself; UsageError for a folder without
    one.
    """
    if not path.is_dir():
        return path
    if os.path.lexists(file := path / TABLE):
        return file
    if result_folder.held(path) == "study":
        remedy = f"name {path / 'runs' / 'NAME'}, the folder of a run"
        raise UsageError(
            f"{path} holds a study, which has no {TABLE} of its own", remedy, str(path)
        )
    remedy = RUN_AGAIN if read_report(path) else "name the folder of a result"
    raise UsageError(f"cannot read {file}: there is none", remedy, str(file))


def read_run(path: Path) -> Results:
    """Read a result folder, with an empty table where the run failed before its first row; errors
    as of `read`.
    """
    report = checked_report(path)
    if report.get("rows"):
        return read(path)
    return Results(
        path, {name: np.empty(0) for name in ("step", *COMPARED, "newton_iterations")}, report
    )


def has_reactions(folder: Path) -> bool:
    """Whether the force table of a result folder has the reactions of supports."""
    return not {*header_of(folder / TABLE)}.isdisjoint(REACTION_COLUMNS)


def rows_of(states: Iterable[State], with_reactions: bool = False) -> list[dict[str, float]]:
    """The rows of the force table as mappings from column to number; with reactions where they were
    asked for.
    """
    names = [
        name
        for name in (*STATE_COLUMNS, *BEYOND_STATE)
        if with_reactions or name not in REACTION_COLUMNS
    ]
    rows = ({name: state.column(name) for name in names} for state in states)
    return [{name: value for name, value in row.items() if value is not None} for row in rows]


LARGEST_NUMBER = 1e150  # a number whose square and cube are numbers too
LARGEST_STEP_NUMBER = 1e15  # a step is a whole number below this
Number = Annotated[float, AllowInfNan(False), Ge(-LARGEST_NUMBER)]
Known = Number | None
Count = Annotated[int, Ge(0)]


def _mapping(name: str = "mapping", /, *, needed: Collection[str] = (), **entries: Any) -> Any:
    """A mapping of entries, those that are `needed` and others that may be missing."""
    kinds = {key: kind if key in needed else NotRequired[kind] for key, kind in entries.items()}
    return cast(Any, TypedDict)(name, kinds)


@cache
def _shape() -> TypeAdapter[Report]:
    """What a run.json looks like; a run that reads none need not work it out."""
    answer: Any = {"name": str, "delta": Number, "force": Number}
    curve: Any = {"delta": list[Number], "force": list[Number]}
    place = _mapping("_Place", needed=("delta", "force"), delta=Number, force=Number, error=Known)
    half_space = _mapping(**answer, deviation=Known, curve=_mapping(needed=curve, **curve))
    beside = {
        "half_space": half_space | None,
        "curve": _mapping(**curve, a=list[Number]),
        "why": str,
    }
    beside |= {"formulas": GenericAlias(list, _mapping(**answer, deviation=Known))}
    theory = _mapping(
        needed=answer, **answer, force_deviation=Known, delta_deviation=Known, **beside
    )
    choices = GenericAlias(list, _mapping(key=str))
    entries: Any = dict.fromkeys(
        ("reason", "version", "started", "finished", "title", "gap", "method", "control"), str
    )
    entries |= dict.fromkeys(("timings", "cpu_timings"), dict[str, Number]) | {
        "versions": dict[str, object]
    }
    entries |= dict.fromkeys(("peak_memory_MB", "memory_before_MB"), Known) | dict.fromkeys(
        ("rows", "dofs"), Count
    )
    entries |= {
        "exit_code": int | None,
        "center": list[Number],
        "warnings": list[str],
        "resumed_after": list[Count],
    }
    entries |= {
        "units": _mapping(length=str, force=str),
        "asked": _mapping(error_bars=bool, accuracy=Known),
    }
    report = _mapping(
        **entries,
        status=Literal["running", "done", "failed", "interrupted"],
        plan=_mapping(
            auto=list[str],
            choices=choices,
            prediction=_mapping(force_error=Known, a=Known, elastocapillary_length=Known),
        ),
        theory=theory | None,
        hertz=_mapping(needed=("E", "percent"), E=Number, percent=Number) | None,
        audit=_mapping(force_against_reaction=Known, substeps=Count) | None,
        accuracy=_mapping(target=Number, elements=Number, tried=list[Number]) | None,
        stick=_mapping(needed=("words",), words=str) | None,
        adhesion=GenericAlias(dict, (str, Known | place)) | None,
        experiment=_mapping(
            by=str, adhesion=_mapping(pull_off=GenericAlias(dict, (str, place)) | None) | None
        )
        | None,
        mesh=_mapping(hash=str) | None,
        time=_mapping(way=str, method=str, why=str, words=str, limits=dict[str, Known]) | None,
    )
    return TypeAdapter(report)


def checked_report(folder: Path) -> Report:
    """The run.json of a folder, empty when there is none; UsageError when it is not what the
    program writes.
    """
    report = read_report(folder)
    if not report and os.path.lexists(folder / REPORT):
        raise _damaged(folder, f"no JSON object that says program: {PROGRAM}")
    try:
        _shape().validate_python(report, strict=True)
        _check_theory(report.get("theory") or {})
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False, include_context=False)[0]
        place = ".".join(
            str(part) for part in found["loc"] if isinstance(part, int) or str(part).isidentifier()
        )
        raise _damaged(folder, f"{place}: {found['msg']}") from None
    except ValueError as error:
        raise _damaged(folder, f"theory: {error}") from None
    return report


def _damaged(folder: Path, why: str) -> UsageError:
    return UsageError(f"{folder / REPORT} is damaged: {why}", RUN_ELSEWHERE, str(folder / REPORT))


def _check_theory(theory: Report) -> None:
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
    """The columns of a CSV file with a header; a last line without its newline was torn and is
    dropped.

    UsageError when it is no such file. Numbers of the `needed` columns are finite, but in those
    that may be `unknown`; there, and in other columns, an empty cell is NaN. Columns of `words` are
    text as it stands.
    """
    if path.name == EXPERIMENT and not words:
        problem = (
            f"{path} is the table of an experiment: its picture is experiment.png in the "
            "result folder"
        )
        raise UsageError(problem, file=str(path))
    try:
        text = content(path).decode("utf-8")
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or error}", file=str(path)) from None
    except ValueError:
        raise UsageError(
            f"{path} is not a table of numbers with a header: not UTF-8 text", file=str(path)
        ) from None
    lines = [line for line in text[: text.rfind("\n") + 1].split("\n") if line.strip()]
    if not lines:
        raise UsageError(f"{path} is empty", file=str(path))
    header = [name.strip() for name in lines[0].split(",")]
    for name in (*needed, *unknown):
        if name not in header:
            raise UsageError(
                f"{path} has no column '{name}': not a table of results", file=str(path)
            )
    if len(set(header)) < len(header):
        raise UsageError(f"{path} has two columns of one name", file=str(path))
    rows = [
        _row(line, header, words, f"{path}: line {number}")
        for number, line in enumerate(lines[1:], start=2)
    ]
    cells = list(zip(*rows, strict=True)) or [()] * len(header)
    columns = {
        name: np.array(cells[i], dtype=str if name in words else float)
        for i, name in enumerate(header)
    }
    for name in needed:
        if name not in unknown and not np.isfinite(columns[name]).all():
            raise UsageError(
                f"{path}: column '{name}' holds a cell that is no number", file=str(path)
            )
    return columns


def read_curve(folder: Path) -> dict[str, np.ndarray]:
    """The rows of a history, else those of a result's experiment.csv, with t and z; UsageError when
    the table is damaged, or without rows.
    """
    columns = read(folder).table
    if "t" in columns:
        return columns if "z" in columns else columns | {"z": columns["delta"]}
    columns = read_table(
        folder / EXPERIMENT, ("delta", "force"), ("t", "z", "a", *WORD_COLUMNS), WORD_COLUMNS
    )
    if not len(columns["delta"]):
        raise UsageError(f"{folder / EXPERIMENT} has no rows", RUN_AGAIN, str(folder / EXPERIMENT))
    return columns


def _row(line: str, header: Sequence[str], words: Sequence[str], place: str) -> list[float | str]:
    cells = line.split(",")
    if len(cells) != len(header):
        raise UsageError(
            f"{place} has {len(cells)} cells, the header {len(header)}: no table of numbers"
        )
    named = enumerate(zip(header, cells, strict=True), start=1)
    return [
        cell if name in words else _number(cell, f"{place}, column {n}")
        for n, (name, cell) in named
    ]


def _number(cell: str, place: str) -> float:
    try:
        value = tables.number(cell)
    except ValueError:
        raise UsageError(f"{place} is not a number: no table of numbers with a header") from None
    if abs(value) > LARGEST_NUMBER:
        raise UsageError(f"{place} is no number that a result can hold")
    return value


@dataclass(frozen=True)
class Earlier:
    """The rows of an earlier run, its table's columns, the length that holds them [bytes], and its
    run.json.
    """

    states: tuple[State, ...]
    columns: tuple[str, ...]
    size: int
    report: Report

    def check(self, deltas: Sequence[float] | None, steps: int, folder: Path) -> None:
        """UsageError when these are not rows of a path of so many steps, to these depths where they
        are prescribed.
        """
        table = str(folder / TABLE)
        wrong = (
            [f" has {len(self.states)} rows, the scene {steps} steps"]
            if len(self.states) > steps
            else []
        )
        for state, delta in zip(self.states, deltas or (), strict=False):
            if not math.isclose(state.delta, delta, rel_tol=SAME_DEPTH, abs_tol=0):
                wrong.append(f": row {state.step} is not at the scene's depth")
        if wrong:
            raise UsageError(f"{table}{wrong[0]}: it is damaged", RUN_AGAIN, table)


def begun_report(folder: Path) -> Report:
    """The run.json of a run that `--resume` can go on with; empty where there are no rows, and so
    nothing to keep.
    """
    report = checked_report(folder)
    return report if report and (has_rows(folder) or report.get("rows")) else {}


def earlier_run(folder: Path, config_yaml: str, report: Report | None = None) -> Earlier | None:
    """The run of this config in a folder; None when the folder holds no row of any.

    report: what this run says of itself. Raises ConfigError when the folder holds a run of another
    config, UsageError when its rows cannot be understood.
    """
    theirs = begun_report(folder)
    if not theirs:
        return None
    try:
        result_folder.refuse_links(folder)
        follows = set.intersection(
            *(set((one.get("plan") or {}).get("auto") or ()) for one in (report or {}, theirs))
        )
        _refuse_other(folder, _with_present_keys(folder / CONFIG), config_yaml, follows)
        unknown = ("energy",) if theirs.get("method") == "theory" else ()
        return Earlier(*_rows(folder / TABLE, unknown), theirs)
    except FileNotFoundError as error:
        raise UsageError(
            f"{folder} has {REPORT} but no {Path(error.filename).name}", RUN_AGAIN, str(folder)
        ) from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{folder} holds a {CONFIG} or {TABLE} that is no text", RUN_AGAIN, str(folder)
        ) from error
    except OSError as error:
        raise UsageError(
            f"cannot read {folder}: {error.strerror or error}", RUN_AGAIN, str(folder)
        ) from error


def lost_files(folder: Path, surface: Keep, fields: Keep) -> list[str]:
    """The files of a finished run that are missing or damaged now; surface, fields: of which states
    it kept these.
    """
    lost = lost_fields(folder) if fields != "none" else []
    with suppress(UsageError):
        if surface == "none" or (found := read(folder))["step"][-1] in found.surface.get(
            "step", ()
        ):
            return lost
    return [*lost, SURFACE]


def _with_present_keys(path: Path) -> str:
    """Return the config of a result with all keys of the present version, new ones at their
    defaults.

    A config that the present version cannot read is returned as it stands. Raises
    UnicodeDecodeError where the file is no text.
    """
    text = content(path).decode("utf-8")
    try:
        return to_yaml(load(path))
    except (ConfigError, UsageError):
        return text


def _refuse_other(folder: Path, theirs: str, ours: str, follows: Collection[str]) -> None:
    """ConfigError with the first key that differs, one that both left to the program (`follows`)
    last.
    """
    if theirs == ours:
        return
    documents = [parse(text, str(folder / CONFIG))[0] for text in (theirs, ours)]
    there, here = (dict(leaves(document)) for document in documents)
    for path, (problem, remedy) in GONE.items():
        if path[-1] in (documents[0].get(path[0]) or {}):
            again = f"leave --resume out to replace it; {remedy}"
            raise ConfigError(key_text(path), f"{problem}; {folder} holds a run with it", again)
    differ = [key for key in {**here, **there} if there.get(key) != here.get(key)]
    key = min(
        differ, key=lambda key: key in follows or key.partition("[")[0] in follows, default=""
    )
    name = key.rpartition(".")[2]
    sides = ((there, "there"), (here, "here"))
    told = ", ".join(
        f"'{name}: {inline(values[key])}' {where}" for values, where in sides if key in values
    )
    problem = (
        f"{folder} holds a run of another config ({told or 'the same lines in another order'})"
    )
    remedy = (
        "give the same scene and --set as then, or another --output, or leave --resume "
        "out to replace it"
    )
    raise ConfigError(key, problem, remedy)


def _rows(path: Path, unknown: Sequence[str]) -> tuple[tuple[State, ...], tuple[str, ...], int]:
    lines = content(path).split(b"\n")[:-1]  # what has no newline was torn
    if not lines:
        return (), STATE_COLUMNS, 0
    names = tuple(lines[0].decode().split(","))
    own = tuple(name for name in names if name != "t")
    is_ours = own[: len(STATE_COLUMNS)] == STATE_COLUMNS and set(names) <= {
        *STATE_COLUMNS,
        *BEYOND_STATE,
    }
    if not is_ours or names != tables.in_order(names):
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
