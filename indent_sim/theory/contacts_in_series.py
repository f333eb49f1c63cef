"""Two contacts in series: a body between a tip above and a flat below, both carrying one force.

Each contact is computed by a layer theory, as if the other contact were far away. At equal forces
the approaches are added, delta = delta_1(F) + delta_2(F), and so are the compliances and the
energies. This is the limit of contacts that are small compared with the body. Source: Johnson,
Contact Mechanics (1985), 4.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf

import numpy as np

from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.profiles import Tip
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.solution import Solution, no_contact


@dataclass(frozen=True)
class ContactsInSeries:
    """Load curve of a body that is pressed onto a flat.

    Attributes
    ----------
    upper
        Contact of the tip with the body. Solutions have its pressure and contact radius.
    lower
        Contact of the flat with the body.
    """

    upper: ContactCurve
    lower: ContactCurve

    @property
    def tip(self) -> Tip:
        """The tip of the upper contact."""
        return self.upper.tip

    def lower_solution(self, force: float) -> Solution:
        """Return the Solution of the lower contact at a force [F]."""
        return self.lower.solutions_at_forces([force])[0]

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution]:
        """Return one Solution for each force [F]; forces <= 0 have no contact.

        Raises ValueError beyond the range of one of the theories.
        """
        pairs = zip(
            self.upper.solutions_at_forces(forces),
            self.lower.solutions_at_forces(forces),
            strict=True,
        )
        return [_sum_of(upper, lower) for upper, lower in pairs]

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution]:
        """Return one Solution for each approach [L]; approaches <= 0 have no contact.

        Raises ValueError beyond the range of one of the theories.
        """
        return [
            self._solution_at_depth(delta) if delta > 0 else no_contact(delta) for delta in deltas
        ]

    def depth_of_force(self, force: float) -> float:
        """Return the approach [L] at a force [F] > 0."""
        return self.upper.depth_of_force(force) + self.lower.depth_of_force(force)

    def solutions_up_to(self, deepest: Solution, count: int) -> list[Solution]:
        """Return `count` solutions at forces up to that of `deepest`, at similar distances."""
        fractions = np.arange(1, count + 1) / count
        return self.solutions_at_forces(list(deepest.force * fractions**1.5))

    def _solution_at_depth(self, delta: float) -> Solution:
        """Return the Solution at an approach [L] > 0."""
        start = self.upper.solutions_at_depths([delta / 2])[0].force
        force = increasing_root(self.depth_of_force, delta, start, inf)
        return replace(self.solutions_at_forces([force])[0], delta=delta)


def _sum_of(upper: Solution, lower: Solution) -> Solution:
    """Return the Solution of two contacts that carry the same force."""
    is_open = upper.stiffness == 0 or lower.stiffness == 0
    stiffness = 0.0 if is_open else 1 / (1 / upper.stiffness + 1 / lower.stiffness)
    return replace(
        upper,
        delta=upper.delta + lower.delta,
        energy=upper.energy + lower.energy,
        stiffness=stiffness,
        u_z=partial(_moved_surface, upper, lower.delta),
    )


def _moved_surface(upper: Solution, approach: float, r: np.ndarray) -> np.ndarray:
    """Return the displacement of the upper surface of a body that moves down by an approach."""
    return upper.u_z(r) - approach
