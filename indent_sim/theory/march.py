"""LayerContact: the contact of a layer theory at one depth after another, and under a force."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np

from indent_sim.theory.profiles import Tip
from indent_sim.theory.roots import first_guess, increasing_root, next_guess
from indent_sim.theory.solution import MAX_SLENDERNESS, Solution, check_contact, no_contact
from indent_sim.theory.stack import Ply, Stack

RINGS = 40  # of a contact, in which the sign of the pressure is looked at
TENSION = 1e-6  # of the force: less is a lost digit


class Touching(Protocol):
    """What is linear at a given contact size."""

    @property
    def touch(self) -> float:
        """The depth [h] of a smooth tip with this contact size."""
        ...


@dataclass(frozen=True)
class LayerContact(ABC):
    """A layer, or a stack of them, under a tip.

    The unit of length of all contact sizes is h [L], the thickness of the top layer.
    wall: the distance of frictionless side walls [h], infinity for none. E_star [F/L^2]: of the top layer.
    """

    tip: Tip
    scaled: Stack  # in units of its top layer
    E_star: float
    h: float
    wall: float

    dimensions: ClassVar[int] = 2  # of the contact area

    @classmethod
    def on(cls, tip: Tip, stack: Stack, wall: float | None = None) -> Self:
        """The contact of a tip with a stack, infinitely wide or between frictionless walls at the distance `wall` [L].

        ValueError for a wall around a half-space, which would sink without end.
        """
        return cls(tip, stack.in_units_of_top(), stack.E_star, stack.h, stack.wall(wall))

    @classmethod
    def of(cls, tip: Tip, *, E: float, nu: float, h: float, base: str = "fixed", wall: float | None = None) -> Self:
        """The contact with one layer of thickness h [L].

        nu in [0, 0.5], 0.5 included; base: "fixed" (bonded) or "roller" (frictionless). ValueError otherwise.
        """
        return cls.on(tip, Stack((Ply(h, E, nu),), base), wall)

    @abstractmethod
    def profile(self, x: np.ndarray) -> np.ndarray:
        """An increasing shape function of the tip, about the depth [h] of a contact of size x."""

    @abstractmethod
    def at(self, a: float) -> Touching:
        """The linear problem of the contact size a."""

    @abstractmethod
    def solution(self, delta: float, a: float) -> Solution:
        """The contact of size a at the depth delta [L]."""

    def largest(self) -> float:
        """The contact size that cannot be reached."""
        return min(self.wall, self.tip.reach / self.h, MAX_SLENDERNESS)

    def curve(self, deltas: Sequence[float]) -> list[Solution]:
        """One Solution per depth [L], each contact sought from its neighbour's; none for a depth <= 0.

        Raises ValueError when the contact would reach the wall, the end of the tip, or a/h = 100.
        """
        solutions: list[Solution] = []
        known: list[tuple[float, float]] = []
        for delta in deltas:
            check_contact(delta, self.tip.edge, self.h, self.wall * self.h)
            if delta <= 0.0:
                solutions.append(no_contact(delta))
            elif self.tip.edge is not None:
                solutions.append(self.solution(delta, self.tip.edge / self.h))
            else:
                depth = delta / self.h
                start = next_guess(known, depth) or first_guess(self.profile, depth, self.largest())
                a = increasing_root(lambda a: self.at(a).touch, depth, start, self.largest())
                known.append((depth, a))
                solutions.append(self.solution(delta, a))
        return solutions

    def up_to(self, deepest: Solution, count: int) -> list[Solution]:
        """Solutions up to a known one, at even steps of the contact size, which is not sought then; of the depth under
        an edge."""
        steps = np.arange(1, count + 1) / count
        if self.tip.edge is not None:
            return self.curve(list(deepest.delta * steps))
        return [self.solution(self.at(a).touch * self.h, a) for a in deepest.a / self.h * steps]

    def depth(self, force: float) -> float:
        """The depth [L] at which the force is this one [F] > 0, found by the contact's size; errors as for `curve`."""
        if self.tip.edge is not None:
            return force / self.curve([self.h])[0].stiffness
        start = first_guess(self.profile, force / (self.E_star * self.h**2), self.largest())
        a = increasing_root(lambda a: self.solution(self.at(a).touch * self.h, a).force, force, start, self.largest())
        return self.at(a).touch * self.h

    def tension(self, solution: Solution) -> float:
        """The share of the force that the tip would have to pull with: the sum of negative pressure over the force.

        The contact of theory is whole. A stiff layer on a soft one bends away from the middle of a punch, and what is
        pushed alone has a smaller contact and a little less force.
        """
        if len(self.scaled.plies) == 1 or solution.force <= 0:
            return 0.0
        at = (np.arange(RINGS) + 0.5) / RINGS
        share = self.dimensions * at ** (self.dimensions - 1) / RINGS
        pull = -float(share @ np.minimum(solution.pressure(at * solution.a), 0.0)) * solution.area / solution.force
        return pull if pull > TENSION else 0.0
