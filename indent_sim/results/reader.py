"""Reader of result folders, force tables and measured curves.

A result folder is read as `Results`: its force table by column, its run.json and its surface table.
Tables are read by `csv_table`, run.json is checked by `report_schema`, and earlier runs are read
for `--resume` by `previous_run`.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.model.state import (
    DERIVED_COLUMNS,
    ERROR_COLUMNS,
    FLUID_COLUMNS,
    FRICTION_COLUMNS,
    KRYLOV_COLUMNS,
    MOMENT_COLUMNS,
    PLASTIC_COLUMNS,
    REACTION_COLUMNS,
    RESTING_COLUMNS,
    SLIDE_COLUMNS,
    SOFT_TIP_COLUMNS,
    STATE_COLUMNS,
    TIME_COLUMNS,
    UNLOADING_COLUMNS,
    State,
)
from indent_sim.process.errors import BackendError, UsageError
from indent_sim.process.repr_tables import ReprTable
from indent_sim.results import result_files, tables
from indent_sim.results.csv_table import header_of, read_table
from indent_sim.results.report_schema import checked_report
from indent_sim.results.result_files import TABLE, Report, read_report
from indent_sim.results.tables import EXPERIMENT, SURFACE, WORD_COLUMNS

if TYPE_CHECKING:
    import pandas

log = logging.getLogger("indent_sim")

RUN_AGAIN_REMEDY = "run its scene again without --resume, or with another --output"
COMPARED_COLUMNS = ("delta", "force", "a")
MEASURED = "measured"  # Key of run.json that marks a measured curve.
# Columns that only some runs have.
OPTIONAL_COLUMNS = (
    *DERIVED_COLUMNS,
    *SLIDE_COLUMNS,
    *FRICTION_COLUMNS,
    *FLUID_COLUMNS,
    *PLASTIC_COLUMNS,
    *UNLOADING_COLUMNS,
    *SOFT_TIP_COLUMNS,
    *MOMENT_COLUMNS,
    *RESTING_COLUMNS,
    *KRYLOV_COLUMNS,
    *ERROR_COLUMNS,
    *TIME_COLUMNS,
    *REACTION_COLUMNS,
)
# Columns of computed results, without error estimates, step numbers, names of branches, Krylov
# iterations and wall times.
RESULT_COLUMNS = tuple(
    name
    for name in (
        *STATE_COLUMNS,
        *DERIVED_COLUMNS,
        *SLIDE_COLUMNS,
        *FRICTION_COLUMNS,
        *FLUID_COLUMNS,
        *PLASTIC_COLUMNS,
        *UNLOADING_COLUMNS,
        *SOFT_TIP_COLUMNS,
        *MOMENT_COLUMNS,
        *RESTING_COLUMNS,
        *TIME_COLUMNS,
    )
    if name not in ("step", "wall_s", *WORD_COLUMNS)
)


@dataclass(frozen=True)
class Results:
    """Results of a finished or partial run, read from its files.

    Attributes
    ----------
    path
        The result folder, or the file of a force table or measured curve.
    table
        Columns of force_indentation.csv by name, each (rows,).
    report
        The content of run.json; empty if the file does not exist.
    surface
        Columns of surface.csv by name; empty if the file does not exist.
    """

    path: Path
    table: dict[str, np.ndarray]
    report: Report = field(default_factory=dict)
    surface: dict[str, np.ndarray] = field(default_factory=dict)

    def __getitem__(self, column: str) -> np.ndarray:
        return self.table[column]

    def __len__(self) -> int:
        return len(self.table["step"])

    def slide_at(self, step: float) -> np.ndarray:
        """Return the horizontal displacement (x, y) of the tip at a step [length]; 0 if unknown."""
        axis = self.report.get("slide_axis")
        rows = np.flatnonzero(self["step"] == step)
        if axis not in ("x", "y") or "x" not in self.table or not len(rows):
            return np.zeros(2)
        return float(self["x"][rows[0]]) * np.array([axis == "x", axis == "y"])

    def unloading_row(self, F_max: float) -> int:
        """Return the index of the row at which unloading from the force F_max begins.

        After a hold, the last row of the hold is returned, because the contact of a creeping body
        grows during the hold.
        """
        # Prescribed forces are found to 1e-10, so that those of a hold differ by that.
        tolerance = 1e-9 * abs(F_max)
        distance = np.abs(self["force"] - F_max)
        return int(np.flatnonzero(distance <= distance.min() + tolerance)[-1])

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the force table."""
        return tuple(self.table)

    def __repr__(self) -> str:
        return self._repr_table().text

    def _repr_html_(self) -> str:
        return self._repr_table().html

    def _repr_table(self) -> ReprTable:
        """Return the table for a notebook: the most important columns, and how the run ended."""
        shown_columns = ("step", "t", "delta", "force", "force_error", "a", "p_max", "branch")
        names = [
            name
            for name in shown_columns
            if name in self.table and np.any(self[name] == self[name])
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
        """Return the force table as a DataFrame; raise BackendError without pandas."""
        return data_frame(self.table)


def data_frame(table: Mapping[str, np.ndarray]) -> pandas.DataFrame:
    """Return columns as a DataFrame; raise BackendError without the optional package pandas."""
    try:
        import pandas
    except ImportError as error:
        raise BackendError(
            f"cannot import pandas ({error}); install it with `pip install pandas`"
        ) from error
    return pandas.DataFrame(dict(table))


def read(path: Path | str, report: Report | None = None) -> Results:
    """Read a result folder, a force table or a measured curve.

    The rows of a measured curve are numbered from 1, its units are those of its file, and its
    contact radius is NaN.

    Parameters
    ----------
    path
        A result folder, a file in the format of force_indentation.csv, or a file of a measured
        curve.
    report
        The content of run.json, if this process has just written it; by default it is read and
        checked.

    Raises
    ------
    UsageError
        If there is no table, or a file is damaged.
    """
    path = Path(path)
    file = force_table_path(path)
    if file == path and path.name == EXPERIMENT:
        read_table(path, ())  # always raises, with the error for experiment.csv
    if file == path and not _is_result_table(path):
        return _read_curve_file(path)
    columns = read_table(
        file, ("step", "delta", "force"), unknown=("a", "delta"), words=WORD_COLUMNS
    )
    if "t" not in columns and not np.isfinite(columns["delta"]).all():
        raise UsageError(f"{file}: column 'delta' has a cell that is not a number", file=str(file))
    steps = columns["step"]
    # Integers below this are exact as doubles.
    largest_step_number = 1e15
    if not ((steps >= 0) & (steps < largest_step_number) & (steps == np.floor(steps))).all():
        raise UsageError(f"{file}: a step is not a whole number", file=str(file))
    if len(set(steps)) != len(steps):
        raise UsageError(f"{file} has two rows of the same step", file=str(file))
    surface = {}
    if os.path.lexists(path / SURFACE):
        surface = read_table(path / SURFACE, tables.SURFACE_COLUMNS, tables.SURFACE_MAY_BE_EMPTY)
        has_row = np.isin(surface["step"], columns["step"])
        surface = {name: values[has_row] for name, values in surface.items()}
    return Results(path, columns, report_of(path) if report is None else report, surface)


def report_of(path: Path) -> Report:
    """Return the run.json of a result folder, or only the units of a force table.

    The units of a force table are those of the run.json in the same folder.
    """
    if path.is_dir():
        return checked_report(path)
    units = read_report(path.parent).get("units") if path.name == TABLE else None
    is_known = isinstance(units, Mapping) and all(isinstance(unit, str) for unit in units.values())
    return {"units": units} if is_known else {}


def _is_result_table(path: Path) -> bool:
    """Return whether a file has the columns of a force table; True if the file cannot be read."""
    return "step" in header_of(path) or not path.is_file()


def _read_curve_file(path: Path) -> Results:
    """Read the first curve of a file of measured curves as a table.

    If the file has no depth, the displacement z of the base is used instead. Every assumption made
    in reading, such as the meaning of a column, is added as a warning.
    """
    # This import loads the readers of all formats, which a simulation does not need.
    from indent_sim.results.measured.curve_file import read_curves
    from indent_sim.results.measured.measurement import NoCurve

    try:
        curve = read_curves(path)[0]
    except NoCurve as error:
        raise UsageError(f"{path} is {error.problem}", error.remedy, str(path)) from None
    abscissa = curve.available_abscissa("delta")
    delta = curve.abscissa_values(abscissa)
    rows = len(curve)
    table = {
        "step": np.arange(1.0, rows + 1),
        "a": np.full(rows, np.nan),
        "delta": delta,
        "force": curve.force,
    }
    table |= {"t": curve.t} if curve.t is not None else {}
    notes = list(curve.notes)
    if abscissa != "delta":
        notes.append("without a column of depth, the displacement of the base is taken for delta")
    for note in notes:
        log.warning(f"warning: {path}: {note}")
    return Results(
        path,
        table,
        {MEASURED: True, "units": {name: curve.units[name] for name in ("length", "force")}},
    )


def force_table_path(path: Path) -> Path:
    """Return the path of a folder's force table, or the path of a file unchanged."""
    if not path.is_dir():
        return path
    if os.path.lexists(file := path / TABLE):
        return file
    if result_files.folder_kind(path) == "study":
        remedy = f"name {path / 'runs' / 'NAME'}, the folder of a run"
        raise UsageError(f"{path} contains a study, which has no {TABLE}", remedy, str(path))
    remedy = RUN_AGAIN_REMEDY if read_report(path) else "name the folder of a result"
    raise UsageError(f"cannot read {file}: it does not exist", remedy, str(file))


def read_run(path: Path) -> Results:
    """Read a result folder; the table is empty if the run failed before its first row.

    Raises
    ------
    UsageError
        If there is no table although the run has rows, or a file is damaged.
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
    """Return whether the force table of a result folder has columns of support reactions."""
    return not {*header_of(folder / TABLE)}.isdisjoint(REACTION_COLUMNS)


def rows_of(states: Iterable[State], with_reactions: bool = False) -> list[dict[str, float]]:
    """Return the rows of the force table as mappings from column to number.

    Parameters
    ----------
    states
        Converged states, one per row.
    with_reactions
        Include the reactions of the supports.
    """
    names = [
        name
        for name in (*STATE_COLUMNS, *OPTIONAL_COLUMNS)
        if with_reactions or name not in REACTION_COLUMNS
    ]
    rows = ({name: state.column(name) for name in names} for state in states)
    return [{name: value for name, value in row.items() if value is not None} for row in rows]


def read_history(folder: Path) -> dict[str, np.ndarray]:
    """Read the rows of a history with their times t and displacements z of the base.

    The rows are read from the force table, or from experiment.csv if the force table has no times.

    Raises
    ------
    UsageError
        If the table is damaged or has no rows.
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
