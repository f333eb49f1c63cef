"""Load curve of a layer theory: contact solutions at given depths or forces.

Divided by the powers of a in Hertz's theory, all quantities of a contact of size a are analytic,
    delta = h g d(a),  F = E* h^n a^(n-1) g f(a),  dF/ddelta = E* h^(n-1) a^(n-1) s(a),
    U = E* h^(n+1) a^(n-1) g^2 u(a),  p_max = E* (g/a) p(a),
with g(a) the tip's profile, a and g in units of h, n = 2 (n = 1 in plane strain). Chebyshev
polynomials through a few sizes approximate them to round-off; the last coefficients measure the
error. If these are not small, the quantity is not interpolated, for example for tips with slope
discontinuities, or for pressures whose maximum is not at a fixed position.

delta, force and pressure are > 0 in indentation.
Source: Trefethen (2013), Approximation Theory and Approximation Practice, chapters 3 and 8.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebpts2, chebval

from indent_sim.theory.profiles import Tip
from indent_sim.theory.roots import first_guess, increasing_root, next_guess
from indent_sim.theory.solution import (
    MAX_SLENDERNESS,
    PEAK_POINTS,
    Solution,
    check_contact,
    no_contact,
)
from indent_sim.theory.stack import Stack

# Smallest number of depths for which interpolation is faster than one search for each depth.
FEWEST_DEPTHS = 8
# A polynomial has converged when this many of its last coefficients are below this fraction of the
# largest one.
TAIL_TOLERANCE = 2e-13
TAIL_COEFFICIENTS = 2
SIZE_TOLERANCE = 1e-11  # Relative step at which the secant search for sizes ends.
# Points across a contact at which the largest pressure is searched for: the pressure varies over h.
LEAST_PEAK_POINTS = 21
PEAK_POINTS_PER_RADIUS = 8.0
# Rows of the load values of a contact: depth, force, stiffness, energy.
DEPTH_COLUMN = 0
FORCE_COLUMN = 1
Sizes = TypeVar("Sizes", float, np.ndarray)


def field_of_position(
    value: Callable[..., np.ndarray], curve: ContactCurve, *arguments: Any
) -> Callable[[Any], np.ndarray]:
    """Return the function x -> value(curve, *arguments, |x|/h) of positions x [L] of any shape."""
    return partial(_evaluate_field, value, curve, arguments)


def _evaluate_field(
    value: Callable[..., np.ndarray], curve: ContactCurve, arguments: tuple[Any, ...], x: Any
) -> np.ndarray:
    """Evaluate a field of `field_of_position` at positions x [L]."""
    x = np.abs(np.asarray(x, dtype=float)) / curve.h
    return value(curve, *arguments, np.atleast_1d(x).ravel()).reshape(x.shape)[()]


@dataclass(frozen=True)
class ContactCurve(ABC):
    """Load curve of a tip on a layer or a stack of layers.

    Attributes
    ----------
    tip
        Profile of the tip.
    scaled_stack
        The layers in units of the thickness and modulus of the top layer.
    E_star
        E* of the top layer [F/L^2].
    h
        Thickness of the top layer [L], the unit of all contact sizes.
    wall
        Distance of frictionless side walls from the axis [h]; infinity without walls.
    """

    tip: Tip
    scaled_stack: Stack
    E_star: float
    h: float
    wall: float

    dimensions: ClassVar[int] = 2  # Dimensions of the contact area.

    @classmethod
    def from_stack(cls, tip: Tip, stack: Stack, wall: float | None = None) -> Self:
        """Return the load curve of a tip on a stack, infinitely wide or between frictionless walls.

        `wall` is the distance [L] of the walls from the axis. Raises ValueError for walls around a
        half-space, which would have an infinite indentation depth.
        """
        return cls(
            tip, stack.scaled_by_top(), stack.E_star, stack.h, stack.scaled_wall_distance(wall)
        )

    @abstractmethod
    def profile(self, x: np.ndarray) -> np.ndarray:
        """Return an increasing function of the contact size x [h] that is roughly the depth [h]."""

    @abstractmethod
    def linear_solution(self, a: float) -> Any:
        """Solve the linear problem of the contact size a [h].

        The attribute `indentation_of_radius` of the result is the depth [h] of a smooth tip with
        this contact.
        """

    @abstractmethod
    def solution(self, delta: float, a: float, linear: Any = None) -> Solution:
        """Return the Solution for a contact of size a [h] at the depth delta [L].

        `linear` is the `linear_solution` of this size, if it has already been computed.
        """

    def area(self, a: Sizes) -> Sizes:
        """Return the contact area [L^2] for a radius a [h]; in plane strain the width [L]."""
        return math.pi * (a * self.h) ** 2 if self.dimensions == 2 else 2.0 * a * self.h

    @staticmethod
    def interpolation_variable(a: Sizes) -> Sizes:
        """Return the variable of interpolation, a function of the contact size a."""
        return a

    @staticmethod
    def size_of_variable(x: float) -> float:
        """Return the contact size for a value of the interpolation variable."""
        return x

    def max_size(self) -> float:
        """Upper bound of the contact size [h], which no contact reaches."""
        return min(self.wall, self.tip.max_radius / self.h, MAX_SLENDERNESS)

    def linear_solutions(self, sizes: Sequence[float], largest: float) -> Sequence[Any]:
        """Return the linear solutions of several contact sizes, all at most `largest` [h]."""
        return [self.linear_solution(a) for a in sizes]

    def load_values(self, sizes: np.ndarray, linear_solutions: Sequence[Any]) -> np.ndarray:
        """Return depth, force, stiffness and energy (4, sizes) of contacts of a smooth tip.

        The units are [L, F, F/L, F L].
        """
        solutions = [
            self.solution_at_size(a, linear)
            for a, linear in zip(map(float, sizes), linear_solutions, strict=True)
        ]
        return np.array(
            [
                [solution.delta, solution.force, solution.stiffness, solution.energy]
                for solution in solutions
            ]
        ).T

    def center_pressures(self, sizes: np.ndarray, linear_solutions: Sequence[Any]) -> np.ndarray:
        """Return the pressures (sizes,) [F/L^2] at the centers of contacts of a smooth tip."""
        center = np.zeros(1)
        pairs = zip(map(float, sizes), linear_solutions, strict=True)
        return np.array(
            [float(self.solution_at_size(a, linear).pressure(center)[0]) for a, linear in pairs]
        )

    def pressures(
        self, sizes: np.ndarray, linear_solutions: Sequence[Any], point_count: int
    ) -> np.ndarray:
        """Return pressures (sizes, points) [F/L^2] at equally spaced points from center to edge.

        The edge itself is not included.
        """
        radius_fractions = np.linspace(0.0, 1.0, point_count, endpoint=False)
        pairs = zip(map(float, sizes), linear_solutions, strict=True)
        return np.array(
            [
                self.solution_at_size(a, linear).pressure(a * self.h * radius_fractions)
                for a, linear in pairs
            ]
        )

    def solution_at_size(self, a: float, linear: Any = None) -> Solution:
        """Return the Solution for a contact of size a [h] of a smooth tip.

        `linear` is the `linear_solution` of this size, if it has already been computed.
        """
        linear = linear or self.linear_solution(a)
        return self.solution(linear.indentation_of_radius * self.h, a, linear)

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution]:
        """Return one Solution for each depth [L]; depths <= 0 have no contact.

        Many depths are interpolated if this is accurate to round-off. Otherwise each contact size
        is found by a search that starts from the previous results.

        Raises
        ------
        ValueError
            If the contact would reach the wall, the end of the tip, or a/h = 100.
        """
        for delta in deltas:
            check_contact(delta, self.tip.punch_radius, self.h, self.wall * self.h)
        depths = sorted({delta for delta in deltas if delta > 0.0})
        interpolated = (
            self._interpolated_curve(depths[0], depths[-1], len(depths)) if depths else None
        )
        if interpolated is None:
            return self._solve_one_by_one(deltas)
        solution_at = dict(zip(depths, interpolated.solutions_at_depths(depths), strict=True))
        return [solution_at.get(delta) or no_contact(delta) for delta in deltas]

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution]:
        """Return one Solution for each force [F]; forces <= 0 have no contact.

        Raises the same errors as `solutions_at_depths`.
        """
        pushing_forces = sorted({force for force in forces if force > 0.0})
        interpolated = None
        if len(pushing_forces) >= FEWEST_DEPTHS:
            interpolated = self._interpolated_curve(
                self.depth_of_force(pushing_forces[0]),
                self.depth_of_force(pushing_forces[-1]),
                len(pushing_forces),
            )
        solutions = (
            interpolated.solutions_at_forces(pushing_forces)
            if interpolated
            else self._solve_one_by_one([self.depth_of_force(force) for force in pushing_forces])
        )
        solution_at = dict(zip(pushing_forces, solutions, strict=True))
        return [solution_at.get(force) or no_contact(0.0) for force in forces]

    def _interpolated_curve(
        self, first_depth: float, last_depth: float, count: int
    ) -> ChebyshevContactCurve | None:
        """Return an interpolation of the contacts between two depths [L], for `count` evaluations.

        The result is None if `count` is small, or if no polynomial approximates the contacts.
        """
        if (
            count < FEWEST_DEPTHS
            or self.tip.punch_radius is not None
            or self.tip.slope_discontinuities
        ):
            return None
        # The search for the contact size of a single depth solves four or five sizes.
        max_sizes = int(1.9 * count)
        smallest, largest = self._estimated_sizes(first_depth, last_depth)
        if largest < self.max_size():
            interpolated = ChebyshevContactCurve.interpolate(self, smallest, largest, max_sizes)
            if interpolated is None or interpolated.covers(first_depth, last_depth):
                return interpolated
        smallest, largest = (
            solution.a / self.h for solution in self._solve_one_by_one([first_depth, last_depth])
        )
        return (
            ChebyshevContactCurve.interpolate(self, smallest, largest, max_sizes)
            if smallest < largest
            else None
        )

    def _estimated_sizes(self, first_depth: float, last_depth: float) -> tuple[float, float]:
        """Estimate the contact sizes [h] at two depths [L], with a margin on both sides."""
        depths = first_depth / self.h, last_depth / self.h
        sizes = [first_guess(self.profile, depth, self.max_size()) for depth in depths]
        estimates = zip(sizes, self.linear_solutions(sizes, max(sizes)), depths, strict=True)
        # The depth of a paraboloid grows with the square of the contact size.
        smallest, largest = (
            a * math.sqrt(depth / linear.indentation_of_radius) for a, linear, depth in estimates
        )
        # Relative margin for the error of the estimated smallest and largest size.
        margin = 0.05
        return smallest * (1.0 - margin), largest * (1.0 + margin)

    def _solve_one_by_one(self, deltas: Sequence[float]) -> list[Solution]:
        """Return one Solution for each depth [L]; each search starts from the previous results."""
        solutions: list[Solution] = []
        previous_points: list[tuple[float, float]] = []
        for delta in deltas:
            if delta <= 0.0:
                solutions.append(no_contact(delta))
            elif self.tip.punch_radius is not None:
                solutions.append(self.solution(delta, self.tip.punch_radius / self.h))
            else:
                depth = delta / self.h
                start = next_guess(previous_points, depth) or first_guess(
                    self.profile, depth, self.max_size()
                )
                a = increasing_root(
                    lambda a: self.linear_solution(a).indentation_of_radius,
                    depth,
                    start,
                    self.max_size(),
                )
                previous_points.append((depth, a))
                solutions.append(self.solution(delta, a))
        return solutions

    def solutions_up_to(self, deepest: Solution, count: int) -> list[Solution]:
        """Return `count` solutions at equally spaced contact sizes up to the solution `deepest`.

        For a flat punch, whose contact size is fixed, the depths are equally spaced.
        """
        steps = np.arange(1, count + 1) / count
        if self.tip.punch_radius is not None:
            return self.solutions_at_depths(list(deepest.delta * steps))
        return [self.solution_at_size(a) for a in deepest.a / self.h * steps]

    def depth_of_force(self, force: float) -> float:
        """Return the depth [L] of a force [F] > 0; raises the errors of `solutions_at_depths`."""
        if self.tip.punch_radius is not None:
            return force / self.solutions_at_depths([self.h])[0].stiffness
        start = first_guess(self.profile, force / (self.E_star * self.h**2), self.max_size())
        a = increasing_root(lambda a: self.solution_at_size(a).force, force, start, self.max_size())
        return float(self.linear_solution(a).indentation_of_radius * self.h)

    def tension_fraction(self, solution: Solution) -> float:
        """Return the ratio of the resultant of tensile pressure to the force.

        The theory assumes contact on a full disc or band. A stiff layer on a soft one may bend away
        from the center of a punch; without tension the contact would be smaller and the force
        slightly lower.
        """
        if len(self.scaled_stack.layers) == 1 or solution.force <= 0:
            return 0.0
        # Rings of a contact in which the sign of the pressure is checked.
        ring_count = 40
        radius_fractions = (np.arange(ring_count) + 0.5) / ring_count
        area_fractions = self.dimensions * radius_fractions ** (self.dimensions - 1) / ring_count
        fraction = (
            -float(
                area_fractions @ np.minimum(solution.pressure(radius_fractions * solution.a), 0.0)
            )
            * solution.area
            / solution.force
        )
        # A smaller fraction is round-off.
        return fraction if fraction > 1e-6 else 0.0


@dataclass(frozen=True, eq=False)
class ChebyshevContactCurve:
    """Load curve interpolated by Chebyshev polynomials of the contact size.

    `sizes` [h] are the interpolation nodes in ascending order, and `linear_solutions` the results
    of `ContactCurve.linear_solution` at the nodes.
    """

    curve: ContactCurve
    sizes: np.ndarray
    linear_solutions: Sequence[Any]

    @classmethod
    def interpolate(
        cls, curve: ContactCurve, smallest: float, largest: float, max_sizes: int
    ) -> ChebyshevContactCurve | None:
        """Interpolate contacts of a smooth tip from `smallest` to `largest` [h].

        The result is None if polynomials through `max_sizes` contact sizes have not converged.
        """
        solution_of_size: dict[float, Any] = {}
        needed_count = 0.0
        # The Chebyshev points are nested (n -> 2 n - 1), so that every contact size that was solved
        # for one number is used again for the next.
        for count in (count for count in (8, 15, 29, 57, 113) if count <= max_sizes):
            # From the decay of the coefficients the required number of points is predicted; smaller
            # numbers are skipped, with a margin of a factor of two.
            if count < needed_count - 2.0:
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
            tail = _tail_ratio(interpolated._load_coefficients)
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
        """Return one Solution for each depth [L] within the interpolated range."""
        return self._solutions(self._find_sizes(deltas, DEPTH_COLUMN), deltas)

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution]:
        """Return one Solution for each force [F] within the interpolated range."""
        a = self._find_sizes(forces, FORCE_COLUMN)
        return self._solutions(a, list(map(float, self._load_values(a)[DEPTH_COLUMN])))

    def covers(self, first: float, last: float) -> bool:
        """Return whether two depths [L] lie within the interpolated range."""
        return bool(
            self._node_values[DEPTH_COLUMN, 0] <= first
            and last <= self._node_values[DEPTH_COLUMN, -1]
        )

    @cached_property
    def node_solutions(self) -> list[Solution]:
        """Solutions at the interpolation nodes."""
        return [
            self.curve.solution_at_size(a, linear)
            for a, linear in zip(map(float, self.sizes), self.linear_solutions, strict=True)
        ]

    def solution_at_size(self, a: float) -> Solution:
        """Return the Solution for a contact size [h], without interpolation."""
        return self.curve.solution_at_size(float(a))

    def _solutions(self, a: np.ndarray, deltas: Sequence[float]) -> list[Solution]:
        """Return the interpolated solutions for contact sizes a [h] and their depths [L]."""
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
        """Return depth, force, stiffness and energy (4, len(a)) [L, F, F/L, F L] at sizes a [h]."""
        return self.evaluate_polynomials(self._load_coefficients, a) * self._load_scales(a)

    def _load_scales(self, a: np.ndarray) -> np.ndarray:
        """Return the scales (4, len(a)) of depth, force, stiffness and energy, as in Hertz' theory.

        The polynomials approximate the load values divided by these scales [L, F, F/L, F L].
        """
        curve = self.curve
        h = self.curve.h
        g = h * curve.profile(a)
        stiffness = curve.E_star * (a * h) ** (curve.dimensions - 1)
        return np.array([g, stiffness * g, stiffness, stiffness * g * g])

    @cached_property
    def _load_coefficients(self) -> np.ndarray:
        """Chebyshev coefficients (sizes, 4) of the scaled depth, force, stiffness and energy."""
        return _coefficients(self._node_values / self._load_scales(self.sizes))

    @cached_property
    def _node_values(self) -> np.ndarray:
        """Depth, force, stiffness and energy at the nodes (4, sizes) [L, F, F/L, F L]."""
        return self.curve.load_values(self.sizes, self.linear_solutions)

    def evaluate_polynomials(self, coefficients: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the values (columns, len(a)) of Chebyshev series at contact sizes a [h]."""
        x = self.curve.interpolation_variable(a)
        first, *_, last = self.curve.interpolation_variable(self.sizes)
        return np.asarray(
            chebval(np.clip((2.0 * x - first - last) / (last - first), -1.0, 1.0), coefficients)
        )

    def _find_sizes(self, requested: Sequence[float], column: int) -> np.ndarray:
        """Return the sizes [h] at which one row of the load values has the requested values.

        The secant method in logarithmic variables starts from linear interpolation between nodes.
        """
        # This import takes 0.2 s, which other scenes need not spend.
        from scipy.optimize import newton

        log_requested = np.log(requested)
        log_sizes = np.log(self.sizes)
        start = np.interp(log_requested, np.log(self._node_values[column]), log_sizes)
        log_a = newton(
            lambda x: np.log(self._load_values(np.exp(x))[column]) - log_requested,
            start,
            tol=SIZE_TOLERANCE,
        )
        a = np.exp(np.clip(log_a, log_sizes[0], log_sizes[-1]))
        if not np.all(
            np.abs(self._load_values(a)[column] - requested) <= 1e-11 * np.abs(requested)
        ):
            raise ArithmeticError(
                "the secant method for the contact sizes at all requested depths or forces did not "
                "converge"
            )
        return a


class _PeakPressures:
    """Largest contact pressure at each contact size.

    The pressure is interpolated by a Chebyshev polynomial of the contact size if the polynomial
    converges; otherwise the largest pressure of each contact is searched for.
    """

    def __init__(self, curve: ChebyshevContactCurve, a: np.ndarray):
        self._curve = curve
        self._a = a

    def peak_pressure(self, i: int) -> float:
        """Return the largest contact pressure [F/L^2] of the i-th solution."""
        return (
            float(self._interpolated_peaks[i])
            if self._interpolated_peaks is not None
            else self._search_peak(self._curve.solution_at_size(self._a[i]))
        )

    @property
    def _are_central(self) -> bool:
        """True if the largest pressure is at the center, where the slope of the pressure is 0.

        Only every seventh contact is checked.
        """
        curve = self._curve
        stride = slice(None, None, 7)
        point_count = min(
            PEAK_POINTS, LEAST_PEAK_POINTS + math.ceil(PEAK_POINTS_PER_RADIUS * curve.sizes[-1])
        )
        with np.errstate(all="ignore"):
            p = curve.curve.pressures(
                curve.sizes[stride], curve.linear_solutions[stride], point_count
            )
        return bool(np.all((p[:, 0] >= p.max(axis=1)) & (p[:, 1] > p[:, 2])))

    def _search_peak(self, solution: Solution) -> float:
        """Search for the largest pressure [F/L^2] of a solution that is not interpolated."""
        point_count = LEAST_PEAK_POINTS + math.ceil(
            PEAK_POINTS_PER_RADIUS * solution.a / self._curve.curve.h
        )
        return solution.largest_pressure(min(PEAK_POINTS, point_count))

    @cached_property
    def _interpolated_peaks(self) -> np.ndarray | None:
        """Interpolated largest pressures of all contacts; None if they are not interpolated."""
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
        if not np.isfinite(peaks).all():
            return None
        coefficients = _coefficients(peaks / scales[0])
        if _tail_ratio(coefficients) > TAIL_TOLERANCE:
            return None
        return np.asarray(curve.evaluate_polynomials(coefficients, self._a)[0] * scales[1])


def _field_values(curve: ContactCurve, delta: float, a: float, name: str, r: Any) -> Any:
    """Solve a contact and return the field `name` (pressure or u_z) at positions r [L]."""
    return getattr(curve.solution(delta, a), name)(r)


def _chebyshev_points(low: float, high: float, count: int) -> list[float]:
    """Return Chebyshev points of the second kind in ascending order.

    If there are 2 n - 1 points, every second point coincides with one of the points for count = n.
    """
    points = 0.5 * (low + high) + 0.5 * (high - low) * chebpts2(count)
    return [low, *map(float, points[1:-1]), high]


def _coefficients(values: np.ndarray) -> np.ndarray:
    """Return the Chebyshev coefficients (sizes, columns) of nodal values (columns, sizes)."""
    count = values.shape[1]
    return np.asarray(chebfit(chebpts2(count), values.T, count - 1))


def _tail_ratio(coefficients: np.ndarray) -> float:
    """Return the ratio of the last coefficients to the largest one of their column.

    The coefficients have the shape (sizes, columns), and the largest ratio of all columns is
    returned.
    """
    sizes = np.abs(coefficients)
    return float((sizes[-TAIL_COEFFICIENTS:].max(axis=0) / sizes.max(axis=0)).max())
