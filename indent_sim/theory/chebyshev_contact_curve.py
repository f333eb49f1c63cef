"""Load curve interpolated by Chebyshev polynomials of the contact size.

The scaled quantities of `contact_curve` are analytic functions of the contact size, which
polynomials through few sizes approximate to rounding. The last coefficients measure the error;
where they are not small the curve is not interpolated (tips with slope discontinuities, pressures
whose maximum moves).

delta > 0 pushes in; force, pressure > 0 push.
Source: Trefethen (2013), Approximation Theory and Approximation Practice, chapters 3 and 8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.theory.solution import (
    PEAK_POINTS,
    Solution,
)

if TYPE_CHECKING:
    from indent_sim.theory.contact_curve import ContactCurve

# Numbers of Chebyshev points that are tried in turn. The points are nested (n -> 2 n - 1), so that
# every contact size that was solved for one number is used again for the next.
SIZE_COUNTS = (8, 15, 29, 57, 113)
# A polynomial has converged when its last coefficients, this many, are this small relative to the
# largest one.
TAIL_TOLERANCE = 2e-13
TAIL_COEFFICIENTS = 2
# Relative error of a depth or force above which the search for its contact size has failed.
SEARCH_TOLERANCE = 1e-11
# Margin of the number of sizes that is predicted from the decay of the coefficients: smaller
# numbers are skipped.
SIZE_COUNT_MARGIN = 2.0
# The secant search for sizes: relative step at which it ends, relative step below which the
# exponent is kept, and number of steps.
SIZE_TOLERANCE = 1e-11
LEAST_SECANT_STEP = 1e-10
MAX_SECANT_STEPS = 30
PEAK_SAMPLING_STRIDE = 7  # The place of the largest pressure is checked for every seventh size.
# Points across a contact at which the largest pressure is searched for: the pressure varies over h.
LEAST_PEAK_POINTS = 21
PEAK_POINTS_PER_RADIUS = 8.0
# Rows of the load values of a contact: depth, force, stiffness, energy.
DEPTH_COLUMN = 0
FORCE_COLUMN = 1


@dataclass(frozen=True, eq=False)
class ChebyshevContactCurve:
    """Contacts of a load curve interpolated between the smallest and the largest of some sizes.

    `sizes` [h] increase; `linear_solutions` are those of `ContactCurve.linear_solution` at each.
    """

    curve: ContactCurve
    sizes: np.ndarray
    linear_solutions: Sequence[Any]

    @classmethod
    def interpolate(
        cls, curve: ContactCurve, smallest: float, largest: float, max_sizes: int
    ) -> ChebyshevContactCurve | None:
        """Interpolate contacts of a smooth tip from `smallest` to `largest` [h].

        None where `max_sizes` contact sizes are too few for polynomials to converge.
        """
        solution_of_size: dict[float, Any] = {}
        needed_count = 0.0
        for count in (count for count in SIZE_COUNTS if count <= max_sizes):
            if count < needed_count - SIZE_COUNT_MARGIN:
                continue
            sizes = list(
                map(
                    curve.size_of_variable,
                    _chebyshev_points(
                        curve.interpolation_variable(smallest),
                        curve.interpolation_variable(largest),
                        count,
                    ),
                )
            )
            new_sizes = [a for a in sizes if a not in solution_of_size]
            solution_of_size |= zip(
                new_sizes, curve.linear_solutions(new_sizes, sizes[-1]), strict=True
            )
            interpolated = cls(curve, np.array(sizes), [solution_of_size[a] for a in sizes])
            tail = _tail_ratio(interpolated._scaled_node_values)
            if tail <= TAIL_TOLERANCE:
                return interpolated
            needed_count = (
                TAIL_COEFFICIENTS
                + (count - TAIL_COEFFICIENTS) * math.log(TAIL_TOLERANCE) / math.log(tail)
                if tail < 1.0
                else math.inf
            )
        return None

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution]:
        """Return the contacts at depths [L] between those of the smallest and the largest size."""
        return self._solutions(self._find_sizes(deltas, DEPTH_COLUMN), deltas)

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution]:
        """Return the contacts under forces [F] between those of the smallest and the largest size."""
        a = self._find_sizes(forces, FORCE_COLUMN)
        return self._solutions(a, list(map(float, self._load_values(a)[DEPTH_COLUMN])))

    def covers(self, first: float, last: float) -> bool:
        """Return whether two depths [L] lie between those of the smallest and the largest size."""
        return bool(
            self._node_values[DEPTH_COLUMN, 0] <= first
            and last <= self._node_values[DEPTH_COLUMN, -1]
        )

    @cached_property
    def node_solutions(self) -> list[Solution]:
        """Contacts at the interpolation nodes."""
        return [
            self.curve.solution_at_size(a, linear)
            for a, linear in zip(map(float, self.sizes), self.linear_solutions, strict=True)
        ]

    def solution_at_size(self, a: float) -> Solution:
        """Solve the contact of a size [h] without interpolation."""
        return self.curve.solution_at_size(float(a))

    def _solutions(self, a: np.ndarray, deltas: Sequence[float]) -> list[Solution]:
        """Return the interpolated contacts of sizes a [h] at their depths [L]."""
        curve = self.curve
        peak_pressures = _PeakPressures(self, a)
        solutions = []
        _, force, stiffness, energy = (list(map(float, value)) for value in self._load_values(a))
        for i, (size, delta) in enumerate(zip(map(float, a), deltas, strict=True)):
            pressure, u_z = (
                partial(_field_values, curve, delta, size, name) for name in ("pressure", "u_z")
            )
            values = (
                float(delta),
                force[i],
                size * curve.h,
                curve.area(size),
                energy[i],
                stiffness[i],
            )
            solutions.append(
                Solution(
                    *values,
                    pressure=pressure,
                    u_z=u_z,
                    peak_pressure=partial(peak_pressures.peak_pressure, i),
                )
            )
        return solutions

    def _load_values(self, a: np.ndarray) -> np.ndarray:
        """Return depth, force, stiffness and energy (4, len(a)) [L, F, F/L, F L] of contacts."""
        return self.evaluate_polynomials(self._scaled_node_values, a) * self._load_scales(a)

    def _load_scales(self, a: np.ndarray) -> np.ndarray:
        """Return Hertzian factors of the load values (4, len(a)) [L, F, F/L, F L]."""
        curve = self.curve
        h = self.curve.h
        g = h * curve.profile(a)
        stiffness = curve.E_star * (a * h) ** (curve.dimensions - 1)
        return np.array([g, stiffness * g, stiffness, stiffness * g * g])

    @cached_property
    def _scaled_node_values(self) -> np.ndarray:
        """Scaled quantities d, f, s and u at the nodes (4, sizes)."""
        return np.asarray(self._node_values / self._load_scales(self.sizes))

    @cached_property
    def _node_values(self) -> np.ndarray:
        """Depth, force, stiffness and energy at the nodes (4, sizes) [L, F, F/L, F L]."""
        return self.curve.load_values(self.sizes, self.linear_solutions)

    def evaluate_polynomials(self, values: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Evaluate polynomials through node values (columns, sizes) at sizes a, (columns, len(a))."""
        x = self.curve.interpolation_variable(a)
        (first, *_, last) = self.curve.interpolation_variable(self.sizes)
        angle = np.arccos(
            np.minimum(np.maximum((2.0 * x - first - last) / (last - first), -1.0), 1.0)
        )
        return (
            np.cos(np.multiply.outer(angle, np.arange(values.shape[1]))) @ _coefficients(values)
        ).T

    def _find_sizes(self, requested: Sequence[float], column: int) -> np.ndarray:
        """Return the sizes [h] at which one row of the load values has the requested values.

        Secants in logarithmic variables start from chords between the nodes.
        """
        log_requested = np.log(requested)
        smallest = self.sizes[0]
        largest = self.sizes[-1]
        log_sizes = np.log(self.sizes)
        log_values = np.log(self._node_values[column])
        chord = np.clip(np.searchsorted(log_values, log_requested) - 1, 0, log_values.size - 2)
        x = np.interp(log_requested, log_values, log_sizes)
        exponent = (np.diff(log_values) / np.diff(log_sizes))[chord]
        previous: tuple[np.ndarray, np.ndarray] | None = None
        for _ in range(MAX_SECANT_STEPS):
            log_errors = (
                np.log(
                    self._load_values(np.minimum(np.maximum(np.exp(x), smallest), largest))[column]
                )
                - log_requested
            )
            if previous is not None:
                size_changes = x - previous[0]
                error_changes = log_errors - previous[1]
                is_reliable = np.abs(size_changes) > LEAST_SECANT_STEP
                exponent = np.where(
                    is_reliable, error_changes / np.where(is_reliable, size_changes, 1.0), exponent
                )
            previous = (x, log_errors)
            x = x - log_errors / exponent
            if np.abs(x - previous[0]).max() <= SIZE_TOLERANCE:
                break
        a = np.minimum(np.maximum(np.exp(x), smallest), largest)
        if not np.all(
            np.abs(self._load_values(a)[column] - requested) <= SEARCH_TOLERANCE * np.abs(requested)
        ):
            raise ArithmeticError("contact sizes were not found for all depths or forces at once")
        return a


class _PeakPressures:
    """Largest pressures of contacts: interpolated if a polynomial converges, else searched for."""

    def __init__(self, curve: ChebyshevContactCurve, a: np.ndarray):
        self._curve = curve
        self._a = a

    def peak_pressure(self, i: int) -> float:
        """Return the largest pressure [F/L^2] of the i-th contact."""
        return (
            float(self._interpolated_peaks[i])
            if self._interpolated_peaks is not None
            else self._search_peak(self._curve.solution_at_size(self._a[i]))
        )

    @property
    def _are_central(self) -> bool:
        """Whether the largest pressure lies in the center, where an even pressure has slope 0.

        Every PEAK_SAMPLING_STRIDE-th size is checked, and all are taken to be alike.
        """
        curve = self._curve
        stride = slice(None, None, PEAK_SAMPLING_STRIDE)
        point_count = min(
            PEAK_POINTS, LEAST_PEAK_POINTS + math.ceil(PEAK_POINTS_PER_RADIUS * curve.sizes[-1])
        )
        with np.errstate(all="ignore"):
            p = curve.curve.pressures(
                curve.sizes[stride], curve.linear_solutions[stride], point_count
            )
        return bool(np.all((p[:, 0] >= p.max(axis=1)) & (p[:, 1] > p[:, 2])))

    def _search_peak(self, solution: Solution) -> float:
        """Search for the largest pressure [F/L^2] of a contact that was solved for."""
        point_count = LEAST_PEAK_POINTS + math.ceil(
            PEAK_POINTS_PER_RADIUS * solution.a / self._curve.curve.h
        )
        return solution.largest_pressure(min(PEAK_POINTS, point_count))

    @cached_property
    def _interpolated_peaks(self) -> np.ndarray | None:
        """Interpolated largest pressures of all contacts; None where no polynomial converges."""
        curve = self._curve
        contact_curve = self._curve.curve
        if self._are_central:
            peaks = contact_curve.center_pressures(curve.sizes, curve.linear_solutions)[None]
        elif self._a.size < curve.sizes.size:
            return None
        else:
            peaks = np.array([[solution.largest_pressure() for solution in curve.node_solutions]])
        if not np.isfinite(peaks).any():
            return np.full(self._a.size, math.nan)
        scales = [
            contact_curve.E_star * contact_curve.profile(a) / a for a in (curve.sizes, self._a)
        ]
        if not np.isfinite(peaks).all() or _tail_ratio(peaks / scales[0]) > TAIL_TOLERANCE:
            return None
        return np.asarray(curve.evaluate_polynomials(peaks / scales[0], self._a)[0] * scales[1])


def _field_values(curve: ContactCurve, delta: float, a: float, name: str, r: Any) -> Any:
    """Solve a contact and return its field `name`, pressure or u_z, at positions r [L]."""
    return getattr(curve.solution(delta, a), name)(r)


def _chebyshev_points(low: float, high: float, count: int) -> list[float]:
    """Return Chebyshev points of the second kind in ascending order.

    Every second one of 2 n - 1 points is one of n points.
    """
    points = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(
        math.pi * np.arange(count) / (count - 1)
    )
    return [low, *map(float, points[1:-1]), high]


@lru_cache(maxsize=len(SIZE_COUNTS))
def _coefficient_matrix(count: int) -> np.ndarray:
    """Return the matrix (count, count) from values at Chebyshev points to coefficients."""
    k = np.arange(count)
    n = count - 1
    ends = np.where((k == 0) | (k == n), 0.5, 1.0)
    return 2.0 / n * ends[:, None] * np.cos(math.pi * np.outer(k, n - k) / n) * ends


def _tail_ratio(values: np.ndarray) -> float:
    """Return the last coefficients of polynomials through values over the largest one of each.

    `values` has the shape (columns, sizes); the result is the largest ratio.
    """
    coefficients = np.abs(_coefficients(values))
    return float((coefficients[-TAIL_COEFFICIENTS:].max(axis=0) / coefficients.max(axis=0)).max())


def _coefficients(values: np.ndarray) -> np.ndarray:
    """Return coefficients (sizes, columns) of polynomials through values (columns, sizes)."""
    return _coefficient_matrix(values.shape[1]) @ values.T
