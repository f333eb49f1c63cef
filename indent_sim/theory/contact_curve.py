"""Load curve of a layer theory: its contacts at one or many depths or forces.

Without the powers of Hertz's contact all quantities of a contact of size a are analytic in a,
    delta = h g d(a),  F = E* h^n a^(n-1) g f(a),  dF/ddelta = E* h^(n-1) a^(n-1) s(a),
    U = E* h^(n+1) a^(n-1) g^2 u(a),  p_max = E* (g/a) p(a),
with g(a) the tip's profile, a and g in units of h, n = 2 (n = 1 in plane strain). Chebyshev
polynomials through a few sizes approximate them to rounding (`chebyshev_contact_curve`).

delta > 0 pushes in; force, pressure > 0 push.
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

TENSION_RINGS = 40  # Rings of a contact in which the sign of the pressure is checked.
TENSION_TOLERANCE = 1e-6  # Tensile part of the force below which the sign is rounding.
# Interpolation pays for this many depths and more, as long as it solves no more sizes per depth
# than this; the search for the size of one depth solves four or five.
FEWEST_DEPTHS = 8
SIZES_PER_DEPTH = 1.9
END_MARGIN = 0.05  # Relative margin for the error of the estimated smallest and largest size.
Sizes = TypeVar("Sizes", float, np.ndarray)


def field_of_position(
    value: Callable[..., np.ndarray], curve: ContactCurve, *arguments: Any
) -> Callable[[Any], np.ndarray]:
    """Return value(curve, *arguments, |x|/h) as a function of positions x [L], numbers or arrays."""
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
        The layers in units of the thickness and modulus of the top one.
    E_star
        E* of the top layer [F/L^2].
    h
        Thickness of the top layer [L], the unit of all contact sizes.
    wall
        Distance of frictionless side walls [h], infinity for none.
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

        `wall` is the walls' distance [L] from the axis. ValueError for walls around a half-space,
        which would sink without end.
        """
        return cls(
            tip, stack.scaled_by_top(), stack.E_star, stack.h, stack.scaled_wall_distance(wall)
        )

    @abstractmethod
    def profile(self, x: np.ndarray) -> np.ndarray:
        """Return an increasing shape function of the tip, about the depth [h] of a contact."""

    @abstractmethod
    def linear_solution(self, a: float) -> Any:
        """Solve the linear problem of the contact size a [h].

        Its `indentation_of_radius` is the depth [h] of a smooth tip with this contact.
        """

    @abstractmethod
    def solution(self, delta: float, a: float, linear: Any = None) -> Solution:
        """Return the contact of size a [h] at the depth delta [L].

        `linear` is the `linear_solution` of that size where it is known.
        """

    def area(self, a: Sizes) -> Sizes:
        """Return the area [L^2] of a disc of radius a [h], in plane strain the width [L] of a band."""
        return math.pi * (a * self.h) ** 2 if self.dimensions == 2 else 2.0 * a * self.h

    @staticmethod
    def interpolation_variable(a: Sizes) -> Sizes:
        """Return the variable in which the quantities of a contact of size a are smooth."""
        return a

    @staticmethod
    def size_of_variable(x: float) -> float:
        """Return the contact size of an interpolation variable."""
        return x

    def max_size(self) -> float:
        """Return the contact size [h] that no contact can reach."""
        return min(self.wall, self.tip.max_radius / self.h, MAX_SLENDERNESS)

    def linear_solutions(self, sizes: Sequence[float], largest: float) -> Sequence[Any]:
        """Return the linear solutions of several contact sizes, none above `largest` [h]."""
        return [self.linear_solution(a) for a in sizes]

    def load_values(self, sizes: np.ndarray, linear_solutions: Sequence[Any]) -> np.ndarray:
        """Return depth, force, stiffness and energy (4, sizes) [L, F, F/L, F L] of smooth contacts."""
        solutions = [
            self.solution_at_size(a, linear)
            for a, linear in zip(map(float, sizes), linear_solutions, strict=True)
        ]
        return np.array(
            [[linear.delta, linear.force, linear.stiffness, linear.energy] for linear in solutions]
        ).T

    def center_pressures(self, sizes: np.ndarray, linear_solutions: Sequence[Any]) -> np.ndarray:
        """Return the pressures (sizes,) [F/L^2] in the centers of contacts of a smooth tip."""
        center = np.zeros(1)
        pairs = zip(map(float, sizes), linear_solutions, strict=True)
        return np.array(
            [float(self.solution_at_size(a, linear).pressure(center)[0]) for a, linear in pairs]
        )

    def pressures(
        self, sizes: np.ndarray, linear_solutions: Sequence[Any], point_count: int
    ) -> np.ndarray:
        """Return pressures (sizes, points) [F/L^2] from the center to before the edge.

        The points are evenly spaced.
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
        """Return the contact of size a [h] of a smooth tip.

        `linear` is the `linear_solution` of that size where it is known.
        """
        linear = linear or self.linear_solution(a)
        return self.solution(linear.indentation_of_radius * self.h, a, linear)

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution]:
        """Return one Solution per depth [L]; without contact for a depth <= 0.

        Many depths are interpolated where this is accurate to rounding; otherwise the contact size
        of each is searched for from its neighbour's.

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
        """Return one Solution per force [F]; without contact for a force <= 0.

        Errors as `solutions_at_depths`.
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
        """Return the interpolated contacts between two depths [L], from which `count` are wanted.

        None where they are few, or where no polynomial of the contact size approximates them.
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
        """Estimate the contact sizes [h] at two depths [L], with a margin outwards."""
        depths = first_depth / self.h, last_depth / self.h
        sizes = [first_guess(self.profile, depth, self.max_size()) for depth in depths]
        estimates = zip(sizes, self.linear_solutions(sizes, max(sizes)), depths, strict=True)
        smallest, largest = (
            power_law_step(a, linear.indentation_of_radius, depth) for a, linear, depth in estimates
        )
        return smallest * (1.0 - END_MARGIN), largest * (1.0 + END_MARGIN)

    def _solve_one_by_one(self, deltas: Sequence[float]) -> list[Solution]:
        """Return one Solution per depth [L], each by a search that starts from the previous ones."""
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
        """Return solutions at even steps of the contact size up to a known one.

        For a flat punch, whose contact size is fixed, the steps are even in depth.
        """
        steps = np.arange(1, count + 1) / count
        if self.tip.punch_radius is not None:
            return self.solutions_at_depths(list(deepest.delta * steps))
        return [self.solution_at_size(a) for a in deepest.a / self.h * steps]

    def depth_of_force(self, force: float) -> float:
        """Return the depth [L] of a force [F] > 0; errors as `solutions_at_depths`."""
        if self.tip.punch_radius is not None:
            return force / self.solutions_at_depths([self.h])[0].stiffness
        start = first_guess(self.profile, force / (self.E_star * self.h**2), self.max_size())
        a = increasing_root(lambda a: self.solution_at_size(a).force, force, start, self.max_size())
        return float(self.linear_solution(a).indentation_of_radius * self.h)

    def tension_fraction(self, solution: Solution) -> float:
        """Return the integral of the tensile pressure over the force.

        The theory's contact is a full disc or band. A stiff layer on a soft one bends away from the
        center of a punch; without tension its contact would be smaller and its force slightly
        lower.
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
