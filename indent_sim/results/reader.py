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

from indent_sim.config.quantities import si_factor
from indent_sim.config.scene_file import load, to_yaml
from indent_sim.config.schema import REMOVED_KEYS
from indent_sim.config.strict_yaml import inline_yaml, key_text, leaf_values, parse
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
from indent_sim.process.repr_tables import ReprTable
from indent_sim.results import output_folder as result_folder
from indent_sim.results import tables
from indent_sim.results.output_folder import (
    CONFIG,
    PROGRAM,
    REPORT,
    TABLE,
    KeptStates,
    Report,
    has_rows,
    read_regular_file,
    read_report,
)
from indent_sim.results.tables import EXPERIMENT, SURFACE, WORD_COLUMNS, parse_state
from indent_sim.results.xdmf import missing_field_files

if TYPE_CHECKING:
    import pandas

NEW_FOLDER_REMEDY = "delete the folder and run its scene again, or choose another --output for that"
RUN_AGAIN_REMEDY = "run its scene again without --resume, or with another --output"
REPR_COLUMNS = (
    "step",
    "t",
    "delta",
    "force",
    "force_error",
    "a",
    "p_max",
    "branch",
)  # in a notebook
COMPARED_COLUMNS = ("delta", "force", "a")
SAME_DEPTH_RTOL = 1e-9  # relative
MAX_HEADER_BYTES = 10_000  # bytes
MEASURED = "measured"  # entry of the report of a curve that nobody simulated
OPTIONAL_COLUMNS = (
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
RESULT_COLUMNS = tuple(
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
        return self._repr_table().text

    def _repr_html_(self) -> str:
        return self._repr_table().html

    def _repr_table(self) -> ReprTable:
        """What a notebook shows: the columns that tell most, and how the run ended."""
        names = [
            name for name in REPR_COLUMNS if name in self.table and np.any(self[name] == self[name])
        ]
        rows = list(zip(*(self[name].tolist() for name in names), strict=True))
        units = ", ".join(filter(None, (self.report.get("units") or {}).values()))
        title_parts = [
            self.report.get("title") or str(self.path),
            self.report.get("status", ""),
            units,
        ]
        return ReprTable(
            "  ·  ".join(filter(None, title_parts)),
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
    file = force_table_path(path)
    if file == path and path.name == EXPERIMENT:
        read_table(path, ())  # which says what it is
    if file == path and not _is_result_table(path):
        return _read_curve_file(path)
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
        has_row = np.isin(surface["step"], columns["step"])
        surface = {name: values[has_row] for name, values in surface.items()}
    return Results(path, columns, report_of(path) if report is None else report, surface)


def report_of(path: Path) -> Report:
    """The run.json of a result folder; of a force table by itself the units that the run.json
    beside it says.
    """
    if path.is_dir():
        return checked_report(path)
    units = read_report(path.parent).get("units") if path.name == TABLE else None
    is_known = isinstance(units, Mapping) and all(isinstance(unit, str) for unit in units.values())
    return {"units": units} if is_known else {}


def _is_result_table(path: Path) -> bool:
    """Whether a file has the columns of a force table, or is none that could be read."""
    return "step" in header_of(path) or not path.is_file()


def header_of(path: Path) -> list[str]:
    """The titles in the first line of a table with commas; none where nothing can be read."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            line = file.read(MAX_HEADER_BYTES).split(b"\n")[0]
    except OSError:
        return []
    return [name.strip() for name in line.decode("latin-1").split(",")]


def _read_curve_file(path: Path) -> Results:
    """The first curve of a file of measured ones, as a table; its way stands for a depth that it
    does not have.
    """
    from indent_sim.results.measured.curve_file import (
        read_curves,
    )  # with all formats, which no run needs
    from indent_sim.results.measured.measurement import NoCurve

    try:
        curve = read_curves(path)[0]
    except NoCurve as error:
        raise UsageError(f"{path} is {error.problem}", error.remedy, str(path)) from None
    delta = curve.abscissa_values(curve.available_abscissa("delta"))
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


def convert_to_common_units(runs: Sequence[Results]) -> list[Results]:
    """The results, measured curves in the units of the first that is none; ConfigError for units
    that are none.

    A curve that says no units has those of the others.
    """
    simulated_first = sorted(runs, key=lambda run: run.report.get(MEASURED, False))
    unit_mappings = (run.report.get("units") or {} for run in simulated_first)
    units = next(
        (mapping for mapping in unit_mappings if mapping.get("length") and mapping.get("force")), {}
    )
    return [
        _convert_units(run, units) if units and run.report.get(MEASURED) else run for run in runs
    ]


def refuse_different_units(runs: Sequence[Results], remedy: str) -> None:
    """UsageError when two runs measure in different units; one that does not say is taken as it is."""
    for kind in ("length", "force"):
        paths_by_unit = {
            unit: run.path for run in runs if (unit := (run.report.get("units") or {}).get(kind))
        }
        if len(paths_by_unit) > 1:
            (first_unit, first), (second_unit, second) = list(paths_by_unit.items())[:2]
            raise UsageError(
                f"{first} measures {kind} in {first_unit}, {second} in {second_unit}: {remedy}"
            )


def _convert_units(run: Results, units: Mapping[str, str]) -> Results:
    table = dict(run.table)
    for column, kind in (("delta", "length"), ("force", "force")):
        if own_unit := run.report["units"][kind]:
            table[column] = table[column] * (
                si_factor(own_unit, kind) / si_factor(units[kind], kind)
            )
    return replace(run, table=table, report=run.report | {"units": dict(units)})


def force_table_path(path: Path) -> Path:
    """The force table of a result folder, and of a file itself; UsageError for a folder without
    one.
    """
    if not path.is_dir():
        return path
    if os.path.lexists(file := path / TABLE):
        return file
    if result_folder.folder_kind(path) == "study":
        remedy = f"name {path / 'runs' / 'NAME'}, the folder of a run"
        raise UsageError(
            f"{path} holds a study, which has no {TABLE} of its own", remedy, str(path)
        )
    remedy = RUN_AGAIN_REMEDY if read_report(path) else "name the folder of a result"
    raise UsageError(f"cannot read {file}: there is none", remedy, str(file))


def read_run(path: Path) -> Results:
    """Read a result folder, with an empty table where the run failed before its first row; errors
    as of `read`.
    """
    report = checked_report(path)
    if report.get("rows"):
        return read(path)
    return Results(
        path,
        {name: np.empty(0) for name in ("step", *COMPARED_COLUMNS, "newton_iterations")},
        report,
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
        for name in (*STATE_COLUMNS, *OPTIONAL_COLUMNS)
        if with_reactions or name not in REACTION_COLUMNS
    ]
    rows = ({name: state.column(name) for name in names} for state in states)
    return [{name: value for name, value in row.items() if value is not None} for row in rows]


LARGEST_NUMBER = 1e150  # a number whose square and cube are numbers too
LARGEST_STEP_NUMBER = 1e15  # a step is a whole number below this
Number = Annotated[float, AllowInfNan(False), Ge(-LARGEST_NUMBER)]
OptionalNumber = Number | None
Count = Annotated[int, Ge(0)]


def _mapping_type(name: str = "mapping", /, *, needed: Collection[str] = (), **entries: Any) -> Any:
    """A mapping of entries, those that are `needed` and others that may be missing."""
    kinds = {key: kind if key in needed else NotRequired[kind] for key, kind in entries.items()}
    return cast(Any, TypedDict)(name, kinds)


@cache
def _report_schema() -> TypeAdapter[Report]:
    """What a run.json looks like; a run that reads none need not work it out."""
    answer: Any = {"name": str, "delta": Number, "force": Number}
    curve: Any = {"delta": list[Number], "force": list[Number]}
    force_point = _mapping_type(
        "_Place", needed=("delta", "force"), delta=Number, force=Number, error=OptionalNumber
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
        **formula_entries,
    )
    choices = GenericAlias(list, _mapping_type(key=str))
    entries: Any = dict.fromkeys(
        ("reason", "version", "started", "finished", "title", "gap", "method", "control"), str
    )
    entries |= dict.fromkeys(("timings", "cpu_timings"), dict[str, Number]) | {
        "versions": dict[str, object]
    }
    entries |= dict.fromkeys(
        ("peak_memory_MB", "memory_before_MB"), OptionalNumber
    ) | dict.fromkeys(("rows", "dofs"), Count)
    entries |= {
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
        hertz=_mapping_type(needed=("E", "percent"), E=Number, percent=Number) | None,
        audit=_mapping_type(force_against_reaction=OptionalNumber, substeps=Count) | None,
        accuracy=_mapping_type(target=Number, elements=Number, tried=list[Number]) | None,
        stick=_mapping_type(needed=("words",), words=str) | None,
        adhesion=GenericAlias(dict, (str, OptionalNumber | force_point)) | None,
        experiment=_mapping_type(
            by=str,
            adhesion=_mapping_type(pull_off=GenericAlias(dict, (str, force_point)) | None) | None,
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
    """The run.json of a folder, empty when there is none; UsageError when it is not what the
    program writes.
    """
    report = read_report(folder)
    if not report and os.path.lexists(folder / REPORT):
        raise _damaged_report(folder, f"no JSON object that says program: {PROGRAM}")
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
    return UsageError(
        f"{folder / REPORT} is damaged: {why}", NEW_FOLDER_REMEDY, str(folder / REPORT)
    )


def _check_theory(theory: Report) -> None:
    if theory and theory.get("delta_deviation", theory.get("force_deviation")) is None:
        raise ValueError("says no deviation")
    half_space = theory.get("half_space")
    computed = "delta" if "delta_deviation" in theory else "force"
    for formula in filter(None, [half_space, *theory.get("formulas", [])]):
        if (
            formula.get(computed) is None
            or formula.get("deviation") is None
            or "name" not in formula
        ):
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
        text = read_regular_file(path).decode("utf-8")
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
        _parse_row(line, header, words, f"{path}: line {number}")
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


def read_history(folder: Path) -> dict[str, np.ndarray]:
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
        raise UsageError(
            f"{folder / EXPERIMENT} has no rows", RUN_AGAIN_REMEDY, str(folder / EXPERIMENT)
        )
    return columns


def _parse_row(
    line: str, header: Sequence[str], words: Sequence[str], place: str
) -> list[float | str]:
    cells = line.split(",")
    if len(cells) != len(header):
        raise UsageError(
            f"{place} has {len(cells)} cells, the header {len(header)}: no table of numbers"
        )
    named = enumerate(zip(header, cells, strict=True), start=1)
    return [
        cell if name in words else _parse_number(cell, f"{place}, column {n}")
        for n, (name, cell) in named
    ]


def _parse_number(cell: str, place: str) -> float:
    try:
        value = tables.parse_number(cell)
    except ValueError:
        raise UsageError(f"{place} is not a number: no table of numbers with a header") from None
    if abs(value) > LARGEST_NUMBER:
        raise UsageError(f"{place} is no number that a result can hold")
    return value


@dataclass(frozen=True)
class PreviousRun:
    """The rows of an earlier run, its table's columns, the length that holds them [bytes], and its
    run.json.
    """

    states: tuple[State, ...]
    columns: tuple[str, ...]
    table_bytes: int
    report: Report

    def check(self, deltas: Sequence[float] | None, steps: int, folder: Path) -> None:
        """UsageError when these are not rows of a path of so many steps, to these depths where they
        are prescribed.
        """
        table = str(folder / TABLE)
        problems = (
            [f" has {len(self.states)} rows, the scene {steps} steps"]
            if len(self.states) > steps
            else []
        )
        for state, delta in zip(self.states, deltas or (), strict=False):
            if not math.isclose(state.delta, delta, rel_tol=SAME_DEPTH_RTOL, abs_tol=0):
                problems.append(f": row {state.step} is not at the scene's depth")
        if problems:
            raise UsageError(f"{table}{problems[0]}: it is damaged", RUN_AGAIN_REMEDY, table)


def resumable_report(folder: Path) -> Report:
    """The run.json of a run that `--resume` can go on with; empty where there are no rows, and so
    nothing to keep.
    """
    report = checked_report(folder)
    return report if report and (has_rows(folder) or report.get("rows")) else {}


def previous_run(
    folder: Path, config_yaml: str, report: Report | None = None
) -> PreviousRun | None:
    """The run of this config in a folder; None when the folder holds no row of any.

    report: what this run says of itself. Raises ConfigError when the folder holds a run of another
    config, UsageError when its rows cannot be understood.
    """
    old_report = resumable_report(folder)
    if not old_report:
        return None
    try:
        result_folder.refuse_links(folder)
        automatic_keys = set.intersection(
            *(
                set((run_report.get("plan") or {}).get("auto") or ())
                for run_report in (report or {}, old_report)
            )
        )
        _refuse_other_config(
            folder, _current_config_yaml(folder / CONFIG), config_yaml, automatic_keys
        )
        unknown = ("energy",) if old_report.get("method") == "theory" else ()
        return PreviousRun(*_read_rows(folder / TABLE, unknown), old_report)
    except FileNotFoundError as error:
        raise UsageError(
            f"{folder} has {REPORT} but no {Path(error.filename).name}",
            RUN_AGAIN_REMEDY,
            str(folder),
        ) from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{folder} holds a {CONFIG} or {TABLE} that is no text", RUN_AGAIN_REMEDY, str(folder)
        ) from error
    except OSError as error:
        raise UsageError(
            f"cannot read {folder}: {error.strerror or error}", RUN_AGAIN_REMEDY, str(folder)
        ) from error


def missing_files(folder: Path, surface: KeptStates, fields: KeptStates) -> list[str]:
    """The files of a finished run that are missing or damaged now; surface, fields: of which states
    it kept these.
    """
    missing = missing_field_files(folder) if fields != "none" else []
    with suppress(UsageError):
        if surface == "none" or (results := read(folder))["step"][-1] in results.surface.get(
            "step", ()
        ):
            return missing
    return [*missing, SURFACE]


def _current_config_yaml(path: Path) -> str:
    """Return the config of a result with all keys of the present version, new ones at their
    defaults.

    A config that the present version cannot read is returned as it stands. Raises
    UnicodeDecodeError where the file is no text.
    """
    text = read_regular_file(path).decode("utf-8")
    try:
        return to_yaml(load(path))
    except (ConfigError, UsageError):
        return text


def _refuse_other_config(
    folder: Path, old_yaml: str, new_yaml: str, automatic_keys: Collection[str]
) -> None:
    """ConfigError with the first key that differs, one that both left to the program (`automatic_keys`)
    last.
    """
    if old_yaml == new_yaml:
        return
    documents = [parse(text, str(folder / CONFIG))[0] for text in (old_yaml, new_yaml)]
    old_values, new_values = (dict(leaf_values(document)) for document in documents)
    for path, (problem, remedy) in REMOVED_KEYS.items():
        if path[-1] in (documents[0].get(path[0]) or {}):
            remedy_text = f"leave --resume out to replace it; {remedy}"
            raise ConfigError(
                key_text(path), f"{problem}; {folder} holds a run with it", remedy_text
            )
    differing_keys = [
        key for key in {**new_values, **old_values} if old_values.get(key) != new_values.get(key)
    ]
    key = min(
        differing_keys,
        key=lambda key: key in automatic_keys or key.partition("[")[0] in automatic_keys,
        default="",
    )
    name = key.rpartition(".")[2]
    sides = ((old_values, "there"), (new_values, "here"))
    difference_text = ", ".join(
        f"'{name}: {inline_yaml(values[key])}' {where}" for values, where in sides if key in values
    )
    problem = f"{folder} holds a run of another config ({difference_text or 'the same lines in another order'})"
    remedy = (
        "give the same scene and --set as then, or another --output, or leave --resume "
        "out to replace it"
    )
    raise ConfigError(key, problem, remedy)


def _read_rows(
    path: Path, unknown: Sequence[str]
) -> tuple[tuple[State, ...], tuple[str, ...], int]:
    lines = read_regular_file(path).split(b"\n")[:-1]  # what has no newline was torn
    if not lines:
        return (), STATE_COLUMNS, 0
    names = tuple(lines[0].decode().split(","))
    columns = tuple(name for name in names if name != "t")
    has_known_columns = columns[: len(STATE_COLUMNS)] == STATE_COLUMNS and set(names) <= {
        *STATE_COLUMNS,
        *OPTIONAL_COLUMNS,
    }
    if not has_known_columns or names != tables.order_columns(names):
        raise UsageError(
            f"{path} has other columns than this version writes", RUN_AGAIN_REMEDY, str(path)
        )
    states: list[State] = []
    size = len(lines[0]) + 1
    for line in lines[1:]:
        state = parse_state(names, line, unknown)
        if state is None or state.step != len(states) + 1:
            break
        states.append(state)
        size += len(line) + 1
    return tuple(states), names, size
