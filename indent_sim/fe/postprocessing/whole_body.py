"""Whole body at the current state, from which fields and contact values are evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any


class WholeBody:
    """Whole body at the current state; subclasses add the contact.

    Parameters
    ----------
    body : Body
        Discrete body.
    strain_energies : sequence of StrainEnergy
        Strain energy term of each region, the region under the tip first.
    friction : Friction or None
        Friction term.
    fluid : Flow or None
        Pore fluid.
    """

    def __init__(self, body: Any, strain_energies: Sequence[Any], friction: Any, fluid: Any = None):
        self.scene = body.scene
        self.comm = body.comm
        self.trace = body.trace
        self.body_mesh = body.body_mesh
        self.mesh = body.mesh
        self.unknowns = body.unknowns
        self.strain_energies = strain_energies
        self.friction = friction
        self.nodal_displacement = body.nodal_displacement
        self.local_array = body.local_array
        self.dofs = body.active_dof_count
        self.fluid = fluid

    @property
    def tip_center(self) -> tuple[float, ...]:
        """Horizontal position of the tip's axis [length]."""
        return tuple(self.scene.physics.center)

    @property
    def E_star(self) -> float:
        """Current plane-strain modulus of the region under the tip [pressure]."""
        return float(self.strain_energies[0].E_star)

    def tip_displacement(self, r: Any) -> Any:
        """Return a soft tip's surface displacement at radii r [length]; 0 for a rigid tip."""
        return 0.0 * r

    def find_inverted_elements(self) -> Any:
        """Find the points of smallest volume ratio and largest stretch; None at small strain.

        The call is collective.
        """
        inverted = [
            extremes
            for strain in self.strain_energies
            if (extremes := strain.find_inverted_elements())
        ]
        if not inverted:
            return None
        return reduce(lambda first, second: first.merge_extremes(second), inverted)
