"""Fit of a surrogate to the runs of a study, and its error at held-out runs."""

from __future__ import annotations

import copy
import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.key_dimensions import (
    DIMENSIONLESS,
    column_dimension,
    is_plane_strain,
    key_numbers,
)
from indent_sim.config.scene_file import to_mapping
from indent_sim.config.strict_yaml import key_path
from indent_sim.process.errors import ConfigError, UsageError, VerificationError
from indent_sim.studies import study_folder
from indent_sim.studies.cases import CaseBuilder
from indent_sim.studies.chebyshev_sum import ChebyshevSum
from indent_sim.studies.dimensionless_groups import Powers, find_groups, powers_text
from indent_sim.studies.edge_points import edge_difference, edge_text
from indent_sim.studies.held_out_error import held_out_error, held_out_mask, place_text
from indent_sim.studies.polynomial_fit import fit_polynomial
from indent_sim.studies.study_file import StudyFile
from indent_sim.studies.surrogate import Coordinate, Surrogate, middle_values

SURROGATE_COLUMNS = ("force", "a", "p_max")
# Largest number of rows of the table that are read, and to which the polynomial is fitted.
MAX_ROWS = 50_000
MAX_FITTED_ROWS = 6_000
MIN_ROWS = 40
# Number of runs of the table that are compared with those of the study.
CHECKED_RUNS = 5
# Beginnings of keys that belong to the numerical method and not to the mechanical problem.
METHOD_SECTIONS = ("mesh", "solver")
METHOD_KEYS = ("accuracy", "contact.epsilon_n", "contact.gamma", "loading.steps")


@dataclass(frozen=True)
class RunTable:
    """Values of the varied keys and of a column, of the runs of a study that have a result.

    Attributes
    ----------
    keys
        Values by key; (rows,).
    column
        The column; (rows,).
    stated_error
        Largest relative error of the force that the runs state.
    failed
        Number of runs without a result.
    first_runs
        Names of the first CHECKED_RUNS runs by their index in the study.
    """

    keys: dict[str, np.ndarray]
    column: np.ndarray
    stated_error: float
    failed: int
    first_runs: Mapping[int, str]


def fit_surrogate(
    study: StudyFile, directory: Path, column: str, within: float | None = None
) -> Surrogate:
    """Fit a surrogate to the table of a study.

    Parameters
    ----------
    study, directory
        The study and its folder with study.csv.
    column
        One of SURROGATE_COLUMNS.
    within
        Error that the surrogate must not exceed.

    Raises
    ------
    UsageError
        The study has no table, too few runs, or keys that are not positive numbers.
    VerificationError
        The error is larger than requested.
    """
    if column not in SURROGATE_COLUMNS:
        raise UsageError(f"--surrogate {column}: choose one of {', '.join(SURROGATE_COLUMNS)}")
    table = read_table(study, directory, column)
    _check_runs(study, table.first_runs, directory / study_folder.STUDY_TABLE)
    surrogate = _surrogate_without_polynomial(study, table, column)
    is_held_out = held_out_mask(len(table.column))
    train = np.flatnonzero(~is_held_out)[:MAX_FITTED_ROWS]
    values = {key: column[train] for key, column in all_values(surrogate, table.keys).items()}
    target = _target(surrogate, table)[train]
    surrogate = fit_polynomial(surrogate, values, target)
    held_out = {key: values[is_held_out] for key, values in table.keys.items()}
    error = _errors(surrogate, held_out, table.column[is_held_out])
    edges = edge_difference(surrogate, values, target)
    surrogate = replace(surrogate, error=error | {"edges": edges})
    if within is not None and error["error"] > within:
        raise VerificationError(
            f"the surrogate of {column} is not within {within:g}: {surrogate.error_text()}; "
            "give the study more points, or narrower ranges"
        )
    return surrogate


def surrogate_summary(surrogate: Surrogate) -> list[str]:
    """Return lines on the groups, the range and the error of a surrogate."""
    groups = [powers_text(coordinate.powers) for coordinate in surrogate.coordinates]
    scale = powers_text(surrogate.scale)
    terms = len(surrogate.polynomial.coefficients)
    lines = [
        f"{surrogate.column} / ({scale}) as a function of {'; '.join(groups)}: {terms} terms",
        surrogate.error_text(),
        f"the largest error is at {place_text(surrogate.error['largest_at'])}",
        edge_text(surrogate.error["edges"]),
        f"range: {surrogate.range_text()}",
    ]
    runs = surrogate.information["runs"]
    if runs["failed"]:
        lines.append(
            f"{runs['failed']} runs have no result: near their points the error of the surrogate "
            "is unknown"
        )
    if runs["stated_error"]:
        lines.append(f"the runs themselves state errors up to {runs['stated_error']:.2g}")
    return lines


def read_table(study: StudyFile, directory: Path, column: str) -> RunTable:
    """Return the runs of a study from study.csv."""
    path = directory / study_folder.STUDY_TABLE
    try:
        with open(path, encoding="utf-8", newline="") as stream:
            rows = _table_rows(stream, study.keys, column)
    except OSError as error:
        raise UsageError(
            f"cannot read {path}: {error.strerror}", "run the study first", str(path)
        ) from None
    except (ValueError, KeyError, csv.Error) as error:
        raise UsageError(
            f"{path} has no numbers of this study ({error})",
            "a surrogate needs varied keys with numerical values; if they have them, the table is "
            "damaged: run the study again with --resume",
            str(path),
        ) from None
    return rows


def _check_runs(study: StudyFile, runs: Mapping[int, str], path: Path) -> None:
    """Raise UsageError if runs of the table are not those of the study, which was changed since.

    The runs are compared by the checksum of their physics, at the end of their names.
    """
    build_case = CaseBuilder(study.common_settings)
    for index, request in enumerate(islice(study.iterate_requests(), max(runs) + 1)):
        if index not in runs:
            continue
        try:
            is_same = build_case(index, request).id == runs[index].rpartition("-")[2]
        except ConfigError:
            is_same = False
        if not is_same:
            raise UsageError(
                f"{path} is not the table of this study: its row {index + 1} is another run",
                "run the study again with --resume, or with --overwrite if another version of the "
                "program computed the table",
                str(path),
            )


def _table_rows(stream: io.TextIOBase, keys: Sequence[str], column: str) -> RunTable:
    """Return the runs in a stream of study.csv."""
    numbers: list[list[float]] = []
    failed = 0
    first_runs: dict[int, str] = {}
    for row in islice(csv.DictReader(stream), MAX_ROWS):
        if row["status"] == "done" and row[column]:
            cells = (*(row[key] for key in keys), row[column], row["stated_error"] or "0")
            numbers.append([float(cell) for cell in cells])
            if len(first_runs) < CHECKED_RUNS:
                first_runs[int(row["index"]) - 1] = row["run"]
        else:
            failed += row["status"] != "pending"
    if len(numbers) < MIN_ROWS:
        raise UsageError(f"{len(numbers)} runs have a result: a surrogate needs {MIN_ROWS}")
    columns = np.array(numbers).T
    values = dict(zip(keys, columns[:-2], strict=True))
    return RunTable(values, columns[-2], float(columns[-1].max()), failed, first_runs)


def _surrogate_without_polynomial(study: StudyFile, table: RunTable, column: str) -> Surrogate:
    """Return the surrogate with its groups and ranges, before its polynomial is fitted."""
    build_case = CaseBuilder(study.common_settings)
    case = None
    for index, request in enumerate(islice(study.iterate_requests(), MAX_ROWS)):
        try:
            case = build_case(index, request)
            break
        except ConfigError:
            continue
    if case is None:
        raise UsageError("the study has no valid scene")
    config = case.planned_run.config
    document = to_mapping(config)
    numbers = key_numbers(document)
    varying = {key: values for key, values in table.keys.items() if np.ptp(values) > 0}
    dimensions = {
        key: numbers[key].dimension if key in numbers else DIMENSIONLESS for key in varying
    }
    fixed = {
        key: number
        for key, number in numbers.items()
        if key not in varying
        and number.dimension != DIMENSIONLESS
        and number.value
        and key.split(".")[0] not in METHOD_SECTIONS
        and key not in METHOD_KEYS
    }
    for key, values in varying.items():
        if dimensions[key] != DIMENSIONLESS and values.min() <= 0:
            raise UsageError(
                f"{key} has values that are not positive; a surrogate needs positive ones"
            )
    if not varying:
        raise UsageError("no key of the study varies")
    if negative := [key for key, number in fixed.items() if number.value < 0]:
        # A negative number has no fractional power. Its sign is the same in all runs.
        fixed = {key: number for key, number in fixed.items() if key not in negative}
    try:
        groups = find_groups(
            dimensions,
            {key: number.dimension for key, number in fixed.items()},
            column_dimension(column, is_plane_strain(document)),
        )
    except ValueError as error:
        raise UsageError(f"there is no surrogate of {column}: {error}") from None
    if not groups.varied:
        raise UsageError(
            f"{column} is a constant times a product of powers of the keys: it needs no surrogate"
        )
    logarithmic = _logarithmic_keys(study)
    coordinates = tuple(
        Coordinate(_numbers(powers), len(powers) > 1 or _only_key(powers) in logarithmic)
        for powers in groups.varied
    )
    fixed_values = {key: number.value for key, number in fixed.items()}
    constant = tuple(
        (_numbers(powers), _logarithm(powers, fixed_values)) for powers in groups.constant
    )
    units = {"length": config.units.length, "force": config.units.force}
    runs = {"fitted": len(table.column), "failed": table.failed}
    ranges = {key: _range(study, key, values) for key, values in varying.items()}
    return Surrogate(
        column,
        ranges,
        fixed_values,
        coordinates,
        constant,
        _numbers(groups.scale),
        bool((table.column > 0).all()),
        ChebyshevSum(np.zeros((1, len(coordinates)), int), np.zeros(1)),
        tuple(condition.text for condition in study.conditions),
        {},
        {
            "title": study.title,
            "units": units,
            "study": str(study.path),
            "runs": runs | {"stated_error": table.stated_error},
            "scene": _scene(document, ranges),
        },
    )


def _scene(
    document: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:
    """Return the document of a run with the varied keys in the middle of their ranges."""
    scene = copy.deepcopy(dict(document))
    for key, value in middle_values(ranges).items():
        *path, last = key_path(key)
        section: Any = scene
        for part in path:
            section = section[part]
        section[last] = value
    return scene


def _range(study: StudyFile, key: str, values: np.ndarray) -> tuple[float, float]:
    """Return the range of a key: the sampled range, or the smallest and the largest value."""
    samples = [block.sample for block in study.blocks if block.sample]
    ends = [
        end
        for sample in samples
        for part in sample.ranges
        if part.key == key and not part.is_stiffness
        for end in (part.first, part.last)
    ]
    return min([*ends, float(values.min())]), max([*ends, float(values.max())])


def _numbers(powers: Powers) -> dict[str, float]:
    """Return powers as floating-point numbers."""
    return {key: float(power) for key, power in powers.items()}


def _logarithm(powers: Powers, values: Mapping[str, float]) -> float:
    """Return the logarithm of a product of powers."""
    return float(sum(float(power) * np.log(values[key]) for key, power in powers.items()))


def _only_key(powers: Powers) -> str:
    """Return the key of a group of one key."""
    (key,) = powers
    return key


def _logarithmic_keys(study: StudyFile) -> set[str]:
    """Return the sampled keys with logarithmic spacing."""
    samples = [block.sample for block in study.blocks if block.sample]
    return {part.key for sample in samples for part in sample.ranges if part.is_logarithmic}


def all_values(surrogate: Surrogate, keys: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the values of varied and fixed keys."""
    varied = {key: values for key, values in keys.items() if key in surrogate.ranges}
    return surrogate.values_of(varied)[0]


def _target(surrogate: Surrogate, table: RunTable) -> np.ndarray:
    """Return the values to which the polynomial is fitted."""
    values = all_values(surrogate, table.keys)
    logarithm = sum(power * np.log(values[key]) for key, power in surrogate.scale.items())
    scaled = table.column * np.exp(-np.asarray(logarithm))
    return np.log(scaled) if surrogate.is_logarithmic else scaled


def _errors(
    surrogate: Surrogate, keys: Mapping[str, np.ndarray], column: np.ndarray
) -> dict[str, Any]:
    """Return the error at held-out runs."""
    varied = {key: values for key, values in keys.items() if key in surrogate.ranges}
    computed = surrogate(varied)
    scale = np.abs(column) if surrogate.is_logarithmic else np.abs(column).max()
    return held_out_error(varied, np.abs(computed - column) / scale) | {
        "variance_share": float(np.mean((computed - column) ** 2) / np.var(column)),
        "is_relative": surrogate.is_logarithmic,
    }
