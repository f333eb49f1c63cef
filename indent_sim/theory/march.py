"""LayerContact: the contact of a layer theory at one depth after another, and under a force."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from indent_sim.theory.profiles import Tip
from indent_sim.theory.roots import first_guess, increasing_root, next_guess
from indent_sim.theory.solution import MAX_SLENDERNESS, Solution, check_contact, no_contact
from indent_sim.theory.stack import Stack

SIGN_RINGS = 40  # of a contact, in which the sign of the pressure is looked at
TENSION = 1e-6  # of the force: less is a lost digit


def pointwise(value: Callable[..., np.ndarray], contact: LayerContact, *known: Any) -> Callable[[Any], np.ndarray]:
    """value(contact, *known, |x|/h) of places (n,), as a function of places x [L], a number or an array."""
    return partial(_at, value, contact, known)


def _at(value: Callable[..., np.ndarray], contact: LayerContact, known: tuple[Any, ...], x: Any) -> np.ndarray:
    x = np.abs(np.asarray(x, dtype=float)) / contact.h
    return value(contact, *known, np.atleast_1d(x).ravel()).reshape(x.shape)[()]


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
        ValueError for a wall around a half-space, which would sink without end."""
        return cls(tip, stack.in_units_of_top(), stack.E_star, stack.h, stack.wall(wall))

    @abstractmethod
    def profile(self, x: np.ndarray) -> np.ndarray:
        """An increasing shape function of the tip, about the depth [h] of a contact of size x."""

    @abstractmethod
    def at(self, a: float) -> Any:
        """The linear problem of the contact size a; its `touch` is the depth [h] of a smooth tip with this contact."""

    @abstractmethod
    def solution(self, delta: float, a: float) -> Solution:
        """The contact of size a at the depth delta [L]."""

    def largest(self) -> float:
        """The contact size that cannot be reached."""
        return min(self.wall, self.tip.reach / self.h, MAX_SLENDERNESS)

    def curve(self, deltas: Sequence[float]) -> list[Solution]:
        """One Solution per depth [L], each contact sought from its neighbour's; none for a depth <= 0. Raises
        ValueError when the contact would reach the wall, the end of the tip, or a/h = 100."""
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
        return float(self.at(a).touch * self.h)

    def tension(self, solution: Solution) -> float:
        """The share of the force that the tip would have to pull with: the sum of negative pressure over the force.

        The contact of theory is whole. A stiff layer on a soft one bends away from the middle of a punch, and what is
        pushed alone has a smaller contact and a little less force.
        """
        if len(self.scaled.plies) == 1 or solution.force <= 0:
            return 0.0
        at = (np.arange(SIGN_RINGS) + 0.5) / SIGN_RINGS
        share = self.dimensions * at ** (self.dimensions - 1) / SIGN_RINGS
        pull = -float(share @ np.minimum(solution.pressure(at * solution.a), 0.0)) * solution.area / solution.force
        return pull if pull > TENSION else 0.0
