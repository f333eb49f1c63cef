"""Surrogate of a study: a column as a function of the keys, with its error and its range."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import read_regular_file, write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.result_files import PROGRAM
from indent_sim.studies.chebyshev_sum import ChebyshevSum
from indent_sim.studies.condition import ConditionError, parse_condition
from indent_sim.studies.zonotope import Zonotope

KIND = "surrogate"
# Largest size of the file [bytes], and largest numbers of terms and keys of a surrogate.
MAX_BYTES = 1_000_000
MAX_TERMS = 10_000
MAX_KEYS = 50
# Relative difference of a fixed group from its value in the study that counts as round-off.
FIXED_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Coordinate:
    """Coordinate of the surrogate: a dimensionless group of keys, or its logarithm.

    Attributes
    ----------
    powers
        Powers of the keys.
    is_logarithmic
        True if the coordinate is the logarithm of the product.
    stretch
        Number b between -1 and 1: the polynomial has the variable (x - b)/(1 - b x), where x is the
        coordinate divided by its range, from -1 to 1. b > 0 stretches the upper end of the range,
        b < 0 the lower one.
    """

    powers: Mapping[str, float]
    is_logarithmic: bool
    stretch: float = 0.0

    def at(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the coordinate at values of the keys."""
        if self.is_logarithmic:
            return _log_product(self.powers, values)
        (key,) = self.powers
        return values[key]


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Column of a study as a function of its keys, fitted to the runs of the study.

    Call it with numbers or arrays by dotted keys, in the units of the scene:
    `surrogate({"indenter.R": 5.0, "loading.delta": deltas})`. A key of the study's scene that is
    not given has the value of the scene.

    Attributes
    ----------
    column
        The column: force, a or p_max.
    ranges
        Smallest and largest value of each varied key.
    fixed
        Values of the keys with a dimension that did not vary.
    coordinates
        The dimensionless groups on which the column depends.
    constant
        Powers of the keys in the groups that are the same in all runs, with their logarithm.
    scale
        Powers of the keys in the scale of the column.
    is_logarithmic
        True if the logarithm of the column is fitted, and its errors are relative.
    polynomial
        The fitted sum of Chebyshev polynomials.
    where
        Conditions that every point must fulfil.
    error
        Error at held-out runs; see docs/study.md.
    information
        Title, units and number of runs of the study, the scene of a run with the varied keys in the
        middle of their ranges, and a closed formula.
    """

    column: str
    ranges: Mapping[str, tuple[float, float]]
    fixed: Mapping[str, float]
    coordinates: tuple[Coordinate, ...]
    constant: tuple[tuple[Mapping[str, float], float], ...]
    scale: Mapping[str, float]
    is_logarithmic: bool
    polynomial: ChebyshevSum
    where: tuple[str, ...]
    error: Mapping[str, Any]
    information: Mapping[str, Any]

    def __call__(self, keys: Mapping[str, Any]) -> np.ndarray:
        """Return the column at values of the keys.

        Parameters
        ----------
        keys
            Numbers or arrays by dotted keys; arrays are broadcast together.

        Raises
        ------
        UsageError
            A key is unknown or missing, or a point is outside the range of the study.
        """
        values, shape = self.values_of(keys)
        points = self.points_of(values)
        is_inside = self._is_inside(values, points)
        if not is_inside.all():
            first = {key: float(value[np.argmin(is_inside)]) for key, value in values.items()}
            text = ", ".join(f"{key}={first[key]:.6g}" for key in self.ranges)
            raise UsageError(
                f"{np.count_nonzero(~is_inside)} of {len(is_inside)} points are outside the range "
                f"of the surrogate, the first one at {text}",
                f"the range is {self.range_text()}; the method `inside` tells which points are "
                "inside",
            )
        return self._column(values, self.unit_points(points)).reshape(shape)

    def continued(self, keys: Mapping[str, Any]) -> np.ndarray:
        """Return the column at any values of the keys, also outside the range of the study.

        Outside the range the error is unknown. The coordinates are those of the nearest point of
        the bounding box of the range, so that the column is finite and continuous.
        """
        values, shape = self.values_of(keys)
        unit_points = self.unit_points(self.points_of(values), is_clipped=True)
        return self._column(values, unit_points).reshape(shape)

    def _column(self, values: Mapping[str, np.ndarray], unit_points: np.ndarray) -> np.ndarray:
        """Return the column at values of the keys and variables of the polynomial."""
        scale = np.exp(_log_product(self.scale, values))
        fitted = self.polynomial(unit_points)
        return scale * (np.exp(fitted) if self.is_logarithmic else fitted)

    def inside(self, keys: Mapping[str, Any]) -> np.ndarray:
        """Return for each point whether it is inside the range of the study."""
        values, shape = self.values_of(keys)
        return self._is_inside(values, self.points_of(values)).reshape(shape)

    def __repr__(self) -> str:
        return f"<Surrogate of {self.column}: {self.range_text()}; {self.error_text()}>"

    def range_text(self) -> str:
        """Return the ranges of the keys as text."""
        parts = [f"{key} {low:.6g} to {high:.6g}" for key, (low, high) in self.ranges.items()]
        return ", ".join([*parts, *self.where])

    def error_text(self) -> str:
        """Return the error at held-out runs as text."""
        quantile = self.error["quantile"]
        error = self.error["error"]
        relation = "relative" if self.is_logarithmic else "of the largest value"
        return (
            f"{100 * quantile:g} % of points are within {error:.2g} ({relation}, at 95 % "
            f"confidence, {self.error['held_out']} held-out runs, the largest error "
            f"{self.error['largest']:.2g})"
        )

    @cached_property
    def _zonotope(self) -> Zonotope:
        """Range of the study in the space of the coordinates."""
        middle: dict[str, np.ndarray] = {}
        half_width: dict[str, float] = {}
        logarithmic_keys = {
            key
            for coordinate in self.coordinates
            if coordinate.is_logarithmic
            for key in coordinate.powers
        }
        for key, (low, high) in self.ranges.items():
            is_log = key in logarithmic_keys
            ends = np.log([low, high]) if is_log else np.array([low, high])
            center = ends.mean()
            middle[key] = np.atleast_1d(np.exp(center) if is_log else center)
            half_width[key] = float(ends[1] - ends[0]) / 2
        middle |= {key: np.atleast_1d(value) for key, value in self.fixed.items()}
        generators = [
            [half_width[key] * coordinate.powers.get(key, 0.0) for coordinate in self.coordinates]
            for key in self.ranges
        ]
        kept = np.array([row for row in generators if any(row)])
        return Zonotope(self.points_of(middle)[0], kept)

    def unit_points(self, points: np.ndarray, is_clipped: bool = False) -> np.ndarray:
        """Return points of the bounding box as variables of the polynomial in [-1, 1]^d.

        With `is_clipped`, other points are moved to the nearest point of the box.
        """
        x = (points - self._zonotope.center) / self._zonotope.half_widths
        if is_clipped:
            x = np.clip(x, -1.0, 1.0)
        stretch = np.array([coordinate.stretch for coordinate in self.coordinates])
        return (x - stretch) / (1 - stretch * x)

    def points_of(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the coordinates at values of the keys; (rows, d)."""
        with np.errstate(all="ignore"):
            return np.column_stack([coordinate.at(values) for coordinate in self.coordinates])

    def _is_inside(self, values: Mapping[str, np.ndarray], points: np.ndarray) -> np.ndarray:
        """Return for each point whether it is inside the sampled range."""
        is_inside = self._zonotope.contains(points)
        for powers, logarithm in self.constant:
            with np.errstate(all="ignore"):
                difference = np.abs(_log_product(powers, values) - logarithm)
            is_inside = is_inside & (difference <= FIXED_TOLERANCE)
        for condition in self._conditions:
            is_inside = is_inside & condition.holds(values)
        return is_inside

    @cached_property
    def _conditions(self) -> list[Any]:
        """The parsed conditions."""
        conditions = map(parse_condition, self.where)
        known = {*self.ranges, *self.fixed}
        return [condition for condition in conditions if known.issuperset(condition.keys)]

    def values_of(self, keys: Mapping[str, Any]) -> tuple[dict[str, np.ndarray], tuple[int, ...]]:
        """Broadcast and flatten the values of the keys; return them and the broadcast shape.

        Fixed keys that are not given have the values of the study.
        """
        known = {*self.ranges, *self.fixed}
        if unknown := [key for key in keys if key not in known]:
            raise UsageError(
                f"the surrogate has no key {unknown[0]}", f"its keys are {', '.join(sorted(known))}"
            )
        if missing := [key for key in self.ranges if key not in keys]:
            raise UsageError(f"the surrogate needs a value of {', '.join(missing)}")
        arrays = [np.asarray(value, dtype=float) for value in keys.values()]
        try:
            broadcast = np.broadcast_arrays(*arrays)
        except ValueError:
            raise UsageError("the arrays of the keys have different shapes") from None
        values = {key: array.reshape(-1) for key, array in zip(keys, broadcast, strict=True)}
        size = broadcast[0].size
        fixed = {
            key: np.full(size, value) for key, value in self.fixed.items() if key not in values
        }
        return values | fixed, broadcast[0].shape

    def as_json(self) -> dict[str, Any]:
        """Return the surrogate as an object for its file."""
        return {
            "program": PROGRAM,
            "version": VERSION,
            "kind": KIND,
            "column": self.column,
            **self.information,
            "error": self.error,
            "ranges": self.ranges,
            "fixed": self.fixed,
            "where": self.where,
            "coordinates": [
                {
                    "powers": coordinate.powers,
                    "log": coordinate.is_logarithmic,
                    "stretch": coordinate.stretch,
                }
                for coordinate in self.coordinates
            ],
            "constant": [
                {"powers": powers, "logarithm": logarithm} for powers, logarithm in self.constant
            ],
            "scale": self.scale,
            "log": self.is_logarithmic,
            "indices": self.polynomial.indices,
            "coefficients": self.polynomial.coefficients,
        }


def surrogate_file(column: str) -> str:
    """Return the name of the file of a surrogate in the folder of a study."""
    return f"surrogate-{column}.json"


def write_surrogate(surrogate: Surrogate, path: Path) -> None:
    """Write the file of a surrogate."""
    write_atomically(path, to_json(surrogate.as_json(), indent=None) + "\n")


def read_surrogate(path: Path | str) -> Surrogate:
    """Read the file of a surrogate, which `indent-sim study STUDY --surrogate` wrote.

    Raises
    ------
    UsageError
        If the file does not contain a surrogate, or is damaged.
    """
    path = Path(path)
    try:
        content = read_regular_file(path)
        if len(content) > MAX_BYTES:
            raise ValueError(f"it is longer than {MAX_BYTES} bytes")
        data = json.loads(content)
        return _surrogate_of(data)
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RecursionError,
        OverflowError,
    ) as error:
        problem = f"it has no entry {error}" if isinstance(error, KeyError) else str(error)
        raise UsageError(
            f"{path} is not a readable surrogate: {problem}",
            "make it with indent-sim study STUDY --surrogate force",
            str(path),
        ) from None


def _surrogate_of(data: Mapping[str, Any]) -> Surrogate:
    """Return the surrogate of the content of a file; raise an error if it is not consistent."""
    if data["program"] != PROGRAM or data["kind"] != KIND:
        raise ValueError("it was not written by this program")
    ranges = {str(key): (float(low), float(high)) for key, (low, high) in data["ranges"].items()}
    coordinates = tuple(
        Coordinate(_powers(part["powers"]), bool(part["log"]), float(part["stretch"]))
        for part in data["coordinates"]
    )
    indices = np.array(data["indices"], dtype=int).reshape(-1, len(coordinates))
    coefficients = np.array(data["coefficients"], dtype=float)
    order = np.lexsort(indices.T[::-1]) if len(coordinates) else np.arange(0)
    # Largest degree of a polynomial.
    max_degree = 1000
    is_valid = (
        0 < len(indices) == len(coefficients) <= MAX_TERMS
        and 0 < len(ranges) <= MAX_KEYS
        and indices.min() >= 0
        and indices.max() <= max_degree
        and np.isfinite(coefficients).all()
        and all(abs(coordinate.stretch) < 1 for coordinate in coordinates)
        and np.array_equal(order, np.arange(len(indices)))
    )
    if not is_valid:
        raise ValueError("its polynomial is not valid")
    for text in data["where"]:
        try:
            parse_condition(text)
        except ConditionError as error:
            raise ValueError(f"its condition {error}") from None
    if not isinstance(data["scene"], dict):
        raise ValueError("its scene is not a mapping")
    names = ("title", "units", "study", "runs", "scene", "formula")
    for name in ("quantile", "error", "largest", "held_out", "variance_share"):
        float(data["error"][name])
    surrogate = Surrogate(
        str(data["column"]),
        ranges,
        {str(key): float(value) for key, value in data["fixed"].items()},
        coordinates,
        tuple((_powers(part["powers"]), float(part["logarithm"])) for part in data["constant"]),
        _powers(data["scale"]),
        bool(data["log"]),
        ChebyshevSum(indices, coefficients),
        tuple(map(str, data["where"])),
        data["error"],
        {name: data[name] for name in names if name in data},
    )
    # In an undamaged file the surrogate has a value in the middle of its range.
    surrogate.inside(middle_values(ranges))
    return surrogate


def middle_values(ranges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Return a value of each key in the middle of its range."""
    return {
        key: math.sqrt(low * high) if low > 0 else (low + high) / 2
        for key, (low, high) in ranges.items()
    }


def _powers(data: Mapping[str, Any]) -> dict[str, float]:
    """Return the exponent of each key in a product of powers, from the file of a surrogate."""
    return {str(key): float(power) for key, power in data.items()}


def _log_product(powers: Mapping[str, float], values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the logarithm of a product of powers."""
    logarithm = np.zeros(len(next(iter(values.values()))))
    for key, power in powers.items():
        logarithm += power * np.log(values[key])
    return logarithm
