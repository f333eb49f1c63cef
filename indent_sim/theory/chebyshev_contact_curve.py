"""Chebyshev."""

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

SIZE_COUNTS = (8, 15, 29, 57, 113)  # sizes, those of each among those of the next
# relative size of that many last coefficients once a polynomial has converged
TAIL_TOLERANCE = 2e-13
TAIL_COEFFICIENTS = 2
SEARCH_TOLERANCE = 1e-11  # relative, of a depth or force that a search has not found
SIZE_COUNT_MARGIN = 2.0  # sizes by which what a few foretell may be too many
# relative steps: the last of a search, the least of a secant; rounds
SIZE_TOLERANCE = 1e-11
LEAST_SECANT_STEP = 1e-10
MAX_SECANT_STEPS = 30
PEAK_SAMPLING_STRIDE = 7  # every so many sizes it is looked where the largest pressure is
# in a contact, where its largest pressure is looked for: it changes within h
LEAST_PEAK_POINTS = 21
PEAK_POINTS_PER_RADIUS = 8.0
# columns of what belongs to a contact
DEPTH_COLUMN = 0
FORCE_COLUMN = 1


@dataclass(frozen=True, eq=False)
class ChebyshevContactCurve:
    """The contacts of a theory between two sizes, which was asked for them at a few sizes [h],
    increasing.
    """

    curve: ContactCurve
    sizes: np.ndarray
    linear_solutions: Sequence[Any]  # what `LayerContact.at` says of each

    @classmethod
    def interpolate(
        cls, curve: ContactCurve, smallest: float, largest: float, max_sizes: int
    ) -> ChebyshevContactCurve | None:
        """Contacts of a smooth tip from `smallest` to `largest` [h]; None where `max_sizes` sizes do not
        determine them.
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
        """The contacts at depths [L] between those of the two sizes."""
        return self._solutions(self._find_sizes(deltas, DEPTH_COLUMN), deltas)

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution]:
        """The contacts under forces [F] between those of the two sizes."""
        a = self._find_sizes(forces, FORCE_COLUMN)
        return self._solutions(a, list(map(float, self._load_values(a)[DEPTH_COLUMN])))

    def covers(self, first: float, last: float) -> bool:
        """Whether two depths [L] are between those of the sizes."""
        return bool(
            self._node_values[DEPTH_COLUMN, 0] <= first
            and last <= self._node_values[DEPTH_COLUMN, -1]
        )

    @cached_property
    def node_solutions(self) -> list[Solution]:
        """The contacts of the sizes."""
        return [
            self.curve.solution_at_size(a, linear)
            for a, linear in zip(map(float, self.sizes), self.linear_solutions, strict=True)
        ]

    def solution_at_size(self, a: float) -> Solution:
        """The contact of a size [h], solved for."""
        return self.curve.solution_at_size(float(a))

    def _solutions(self, a: np.ndarray, deltas: Sequence[float]) -> list[Solution]:
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
        """Depth, force, stiffness and energy of contacts of sizes (4, len(a)) [L, F, F/L, F L]."""
        return self.evaluate_polynomials(self._scaled_node_values, a) * self._load_scales(a)

    def _load_scales(self, a: np.ndarray) -> np.ndarray:
        """What is taken out of depth, force, stiffness and energy (4, len(a)) [L, F, F/L, F L]."""
        curve = self.curve
        h = self.curve.h
        g = h * curve.profile(a)
        stiffness = curve.E_star * (a * h) ** (curve.dimensions - 1)
        return np.array([g, stiffness * g, stiffness, stiffness * g * g])

    @cached_property
    def _scaled_node_values(self) -> np.ndarray:
        """d, f, s and u at the sizes (4, sizes)."""
        return np.asarray(self._node_values / self._load_scales(self.sizes))

    @cached_property
    def _node_values(self) -> np.ndarray:
        """Depth, force, stiffness and energy at the sizes (4, sizes) [L, F, F/L, F L]."""
        return self.curve.load_values(self.sizes, self.linear_solutions)

    def evaluate_polynomials(self, values: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Polynomials through values (columns, sizes), at other sizes (columns, len(a))."""
        x = self.curve.interpolation_variable(a)
        (first, *_, last) = self.curve.interpolation_variable(self.sizes)
        angle = np.arccos(
            np.minimum(np.maximum((2.0 * x - first - last) / (last - first), -1.0), 1.0)
        )
        return (
            np.cos(np.multiply.outer(angle, np.arange(values.shape[1]))) @ _coefficients(values)
        ).T

    def _find_sizes(self, requested: Sequence[float], column: int) -> np.ndarray:
        """The sizes [h] at which a column of `_values` is what is asked for: secants between
        logarithms, which set out from chords between the known sizes.
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
    """The largest pressures of contacts, of all by a polynomial where one meets them, else each
    sought.
    """

    def __init__(self, curve: ChebyshevContactCurve, a: np.ndarray):
        self._curve = curve
        self._a = a

    def peak_pressure(self, i: int) -> float:
        """The largest pressure [F/L^2] of the i-th contact."""
        return (
            float(self._interpolated_peaks[i])
            if self._interpolated_peaks is not None
            else self._search_peak(self._curve.solution_at_size(self._a[i]))
        )

    @property
    def _are_central(self) -> bool:
        """Whether every LOOKED_AT-th size has it there, where an even pressure is flat: then all
        are taken to.
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
        point_count = LEAST_PEAK_POINTS + math.ceil(
            PEAK_POINTS_PER_RADIUS * solution.a / self._curve.curve.h
        )
        return solution.largest_pressure(min(PEAK_POINTS, point_count))

    @cached_property
    def _interpolated_peaks(self) -> np.ndarray | None:
        """Those of all contacts; None where no polynomial meets them."""
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
    """Pressure or u_z of a contact at places r, solved for when they are asked for."""
    return getattr(curve.solution(delta, a), name)(r)


def _chebyshev_points(low: float, high: float, count: int) -> list[float]:
    """Chebyshev's points of the second kind, in order; every second one is among those of half as
    many.
    """
    points = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(
        math.pi * np.arange(count) / (count - 1)
    )
    return [low, *map(float, points[1:-1]), high]


@lru_cache(maxsize=len(SIZE_COUNTS))
def _coefficient_matrix(count: int) -> np.ndarray:
    """From values at Chebyshev's points to coefficients (count, count)."""
    k = np.arange(count)
    n = count - 1
    ends = np.where((k == 0) | (k == n), 0.5, 1.0)
    return 2.0 / n * ends[:, None] * np.cos(math.pi * np.outer(k, n - k) / n) * ends


def _tail_ratio(values: np.ndarray) -> float:
    """The last coefficients of polynomials through values (columns, sizes), over the largest one of
    each.
    """
    coefficients = np.abs(_coefficients(values))
    return float((coefficients[-TAIL_COEFFICIENTS:].max(axis=0) / coefficients.max(axis=0)).max())


def _coefficients(values: np.ndarray) -> np.ndarray:
    """Coefficients (sizes, columns) of polynomials through values (columns, sizes)."""
    return _coefficient_matrix(values.shape[1]) @ values.T
