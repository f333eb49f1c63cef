"""LayerContact: the contact of a layer theory at one depth or force after another, or at many at
once.

Once the powers of Hertz's contact are taken out of it, whatever belongs to a contact of the size a is an analytic
function of a,
    delta = h g d(a),  F = E* h^n a^(n-1) g f(a),  dF/ddelta = E* h^(n-1) a^(n-1) s(a),
    U = E* h^(n+1) a^(n-1) g^2 u(a),  p_max = E* (g/a) p(a),
with g(a) the tip's profile, a and g in units of h, n = 2 (n = 1 in plane strain). Chebyshev polynomials through a few
sizes meet it to rounding, which their last coefficients tell; where these are not small nothing is interpolated: a tip
with kinks, a pressure whose largest place wanders.
Source: Trefethen (2013), Approximation Theory and Approximation Practice, chapters 3 and 8.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from indent_sim.theory.chebyshev_contact_curve import ChebyshevContactCurve
from indent_sim.theory.profiles import Tip
from indent_sim.theory.roots import first_guess, increasing_root, next_guess, power_law_step
from indent_sim.theory.solution import (
    MAX_SLENDERNESS,
    Solution,
    check_contact,
    no_contact,
)
from indent_sim.theory.stack import Stack

TENSION_RINGS = 40  # of a contact, in which the sign of the pressure is looked at
TENSION_TOLERANCE = 1e-6  # of the force: less is a lost digit
# Depths from which on a few sizes may tell all of them, and most sizes for each: a search of one
# takes four or five
FEWEST_DEPTHS = 8
SIZES_PER_DEPTH = 1.9
END_MARGIN = 0.05  # of the sizes at both ends: what the first step of a search may be off
Sizes = TypeVar("Sizes", float, np.ndarray)


def field_of_position(
    value: Callable[..., np.ndarray], curve: ContactCurve, *arguments: Any
) -> Callable[[Any], np.ndarray]:
    """value(contact, *known, |x|/h) of places (n,), as a function of places x [L], a number or an
    array.
    """
    return partial(_evaluate_field, value, curve, arguments)


def _evaluate_field(
    value: Callable[..., np.ndarray], curve: ContactCurve, arguments: tuple[Any, ...], x: Any
) -> np.ndarray:
    x = np.abs(np.asarray(x, dtype=float)) / curve.h
    return value(curve, *arguments, np.atleast_1d(x).ravel()).reshape(x.shape)[()]


@dataclass(frozen=True)
class ContactCurve(ABC):
    """A layer, or a stack of them, under a tip.

    The unit of length of all contact sizes is h [L], the thickness of the top layer. wall: the
    distance of frictionless side walls [h], infinity for none. E_star [F/L^2]: of the top layer.
    """

    tip: Tip
    scaled_stack: Stack  # in units of its top layer
    E_star: float
    h: float
    wall: float

    dimensions: ClassVar[int] = 2  # of the contact area

    @classmethod
    def from_stack(cls, tip: Tip, stack: Stack, wall: float | None = None) -> Self:
        """The contact of a tip with a stack, infinitely wide or between frictionless walls at the
        distance `wall` [L]. ValueError for a wall around a half-space, which would sink without
        end.
        """
        return cls(
            tip, stack.scaled_by_top(), stack.E_star, stack.h, stack.scaled_wall_distance(wall)
        )

    @abstractmethod
    def profile(self, x: np.ndarray) -> np.ndarray:
        """An increasing shape function of the tip, about the depth [h] of a contact of size x."""

    @abstractmethod
    def linear_solution(self, a: float) -> Any:
        """The linear problem of the contact size a; its `touch` is the depth [h] of a smooth tip
        with this contact.
        """

    @abstractmethod
    def solution(self, delta: float, a: float, linear: Any = None) -> Solution:
        """The contact of size a at the depth delta [L]; found: what `at` says of that size, where
        it is known.
        """

    def area(self, a: Sizes) -> Sizes:
        """Area [L^2] of a disc of radius a, in plane strain the width [L] of a band."""
        return math.pi * (a * self.h) ** 2 if self.dimensions == 2 else 2.0 * a * self.h

    @staticmethod
    def interpolation_variable(a: Sizes) -> Sizes:
        """The variable in which what belongs to a contact of size a is smooth between two sizes."""
        return a

    @staticmethod
    def size_of_variable(x: float) -> float:
        """The size with that variable."""
        return x

    def max_size(self) -> float:
        """The contact size that cannot be reached."""
        return min(self.wall, self.tip.max_radius / self.h, MAX_SLENDERNESS)

    def linear_solutions(self, sizes: Sequence[float], largest: float) -> Sequence[Any]:
        """What `at` says of several contact sizes, none above the largest [h]."""
        return [self.linear_solution(a) for a in sizes]

    def load_values(self, sizes: np.ndarray, linear_solutions: Sequence[Any]) -> np.ndarray:
        """Depth, force, stiffness and energy (4, sizes) [L, F, F/L, F L] of contacts of a smooth
        tip; found: what `at` says of their sizes [h].
        """
        solutions = [
            self.solution_at_size(a, linear)
            for a, linear in zip(map(float, sizes), linear_solutions, strict=True)
        ]
        return np.array(
            [[linear.delta, linear.force, linear.stiffness, linear.energy] for linear in solutions]
        ).T

    def center_pressures(self, sizes: np.ndarray, linear_solutions: Sequence[Any]) -> np.ndarray:
        """Pressures [F/L^2] in the middle of contacts of a smooth tip; as above."""
        center = np.zeros(1)
        pairs = zip(map(float, sizes), linear_solutions, strict=True)
        return np.array(
            [float(self.solution_at_size(a, linear).pressure(center)[0]) for a, linear in pairs]
        )

    def pressures(
        self, sizes: np.ndarray, linear_solutions: Sequence[Any], point_count: int
    ) -> np.ndarray:
        """Pressures (sizes, places) [F/L^2] at even steps from the middle to before the edge; as
        above.
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
        """The contact of size a of a smooth tip; found: what `at` says of that size, where it is
        known.
        """
        linear = linear or self.linear_solution(a)
        return self.solution(linear.indentation_of_radius * self.h, a, linear)

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution]:
        """One Solution per depth [L]; none for a depth <= 0.

        Raises ValueError when the contact would reach the wall, the end of the tip, or a/h = 100.

        Those of many depths are interpolated where that is exact to rounding, else each is sought
        from its neighbour's.
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
        """One Solution per force [F], none for a force <= 0; otherwise as `curve`."""
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
        """The contacts between two depths, from which so many are wanted; None where they are few,
        or no polynomial meets them.
        """
        if (
            count < FEWEST_DEPTHS
            or self.tip.punch_radius is not None
            or self.tip.slope_discontinuities
        ):
            return None
        max_sizes = int(SIZES_PER_DEPTH * count)
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
        """A little less and a little more than the contact sizes [h] at two depths [L]: the first
        step of a search.
        """
        depths = first_depth / self.h, last_depth / self.h
        sizes = [first_guess(self.profile, depth, self.max_size()) for depth in depths]
        estimates = zip(sizes, self.linear_solutions(sizes, max(sizes)), depths, strict=True)
        smallest, largest = (
            power_law_step(a, linear.indentation_of_radius, depth) for a, linear, depth in estimates
        )
        return smallest * (1.0 - END_MARGIN), largest * (1.0 + END_MARGIN)

    def _solve_one_by_one(self, deltas: Sequence[float]) -> list[Solution]:
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
        """Solutions up to a known one, at even steps of the contact size, which is not sought then;
        of the depth under an edge.
        """
        steps = np.arange(1, count + 1) / count
        if self.tip.punch_radius is not None:
            return self.solutions_at_depths(list(deepest.delta * steps))
        return [self.solution_at_size(a) for a in deepest.a / self.h * steps]

    def depth_of_force(self, force: float) -> float:
        """The depth [L] at which the force is this one [F] > 0, found by the contact's size; errors
        as for `curve`.
        """
        if self.tip.punch_radius is not None:
            return force / self.solutions_at_depths([self.h])[0].stiffness
        start = first_guess(self.profile, force / (self.E_star * self.h**2), self.max_size())
        a = increasing_root(lambda a: self.solution_at_size(a).force, force, start, self.max_size())
        return float(self.linear_solution(a).indentation_of_radius * self.h)

    def tension_fraction(self, solution: Solution) -> float:
        """The share of the force that the tip would have to pull with: the sum of negative pressure
        over the force.

        The contact of theory is whole. A stiff layer on a soft one bends away from the middle of a
        punch, and what is pushed alone has a smaller contact and a little less force.
        """
        if len(self.scaled_stack.layers) == 1 or solution.force <= 0:
            return 0.0
        radius_fractions = (np.arange(TENSION_RINGS) + 0.5) / TENSION_RINGS
        area_fractions = self.dimensions * radius_fractions ** (self.dimensions - 1) / TENSION_RINGS
        fraction = (
            -float(
                area_fractions @ np.minimum(solution.pressure(radius_fractions * solution.a), 0.0)
            )
            * solution.area
            / solution.force
        )
        return fraction if fraction > TENSION_TOLERANCE else 0.0
