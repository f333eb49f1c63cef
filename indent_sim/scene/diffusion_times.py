"""Diffusion times of the pore fluid over the contact radius, an element and the body."""

from __future__ import annotations

from dataclasses import dataclass

from indent_sim.mesh.sizes import Sizes
from indent_sim.scene.measured_constants import ELEMENT_DRAINAGE_FACTOR
from indent_sim.scene.problem_definition import ProblemDefinition, largest_diffusivity
from indent_sim.scene.problem_setup import ProblemSetup


@dataclass(frozen=True)
class DiffusionTimes:
    """Diffusion times L^2/D [time] of the pore fluid.

    Attributes
    ----------
    contact : float
        L is the expected contact radius.
    element : float
        L is the element size at the contact.
    height : float
        L is the height of the body.
    wall : float
        L is half of the distance from the tip's axis to the edge of the body.
    """

    contact: float
    element: float
    height: float
    wall: float

    @staticmethod
    def compute(
        setup: ProblemSetup, physics: ProblemDefinition, h_contact: float
    ) -> DiffusionTimes:
        """Return the diffusion times for the largest diffusivity; h_contact is an element size."""
        D = largest_diffusivity(physics)
        lengths = (
            setup.a,
            h_contact,
            physics.body.height,
            physics.body.lateral_extent(physics.center) / 2,
        )
        return DiffusionTimes(*(length**2 / D for length in lengths))

    def first_step(self, shortest: float) -> float:
        """Return the first time step [time] of a segment.

        The step is at most `shortest`, unless diffusion over an element takes longer.
        """
        # First time step of a segment, relative to the diffusion time of the contact.
        first_step_fraction = 1e-3
        return max(
            min(first_step_fraction * self.contact, shortest),
            self.element / ELEMENT_DRAINAGE_FACTOR,
        )


def drained_face_size(physics: ProblemDefinition, sizes: Sizes) -> float:
    """Return the element size at the drained faces [length] that determines the first time step.

    The element size at the contact is returned, or for a confined column that drains through its
    base the smaller one of the element sizes at contact and base.
    """
    if physics.is_porous_column and sizes.h_film is not None:
        return min(sizes.h_contact, sizes.h_film)
    return sizes.h_contact
