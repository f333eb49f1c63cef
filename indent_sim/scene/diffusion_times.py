"""Diffusion times of the pore fluid through contact, element and body."""

from __future__ import annotations

from dataclasses import dataclass

from indent_sim.scene.problem_definition import ProblemDefinition, largest_diffusivity
from indent_sim.scene.problem_setup import ProblemSetup

# Of the time that fluid takes through the contact, and of that through an element: the first step
# of a piece. In less than the second an element of linear pressure does not drain as a half-space
# does, and the force is up to 1.4 % low
FIRST_STEP_FRACTION = 1e-3
ELEMENT_DRAINAGE_FACTOR = 6.0


@dataclass(frozen=True)
class DiffusionTimes:
    """How long the fluid takes [time] through the contact, an element, the body's height and half
    of the way to its wall. The first step of a piece is a thousandth of the contact's, but none
    in which an element cannot drain.
    """

    contact: float
    element: float
    height: float
    wall: float

    @staticmethod
    def compute(
        setup: ProblemSetup, physics: ProblemDefinition, h_contact: float
    ) -> DiffusionTimes:
        """Those of a scene's fastest region; h_contact [length]."""
        D = largest_diffusivity(physics)
        lengths = (
            setup.a,
            h_contact,
            physics.body.height,
            physics.body.lateral_extent(physics.center) / 2,
        )
        return DiffusionTimes(*(length**2 / D for length in lengths))

    def first_step(self, shortest: float) -> float:
        """Of the steps of a piece, beside what takes a `shortest` one [time]."""
        return max(
            min(FIRST_STEP_FRACTION * self.contact, shortest),
            self.element / ELEMENT_DRAINAGE_FACTOR,
        )
