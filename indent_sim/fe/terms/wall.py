"""The curved roller wall of a cylinder in three dimensions: u . n = 0 with the cylinder's own normal, weakly."""

from __future__ import annotations

from typing import Any

import ufl
from dolfinx import fem

from indent_sim.fe.body import Body


class Wall:
    """The wall's points stay on r = radius, by the energy stiffness/2 w^2; w = u . n at small strain.

    n is the cylinder's own normal, the stiffness `scene.physics.wall_stiffness` in pressure/length.
    """

    def __init__(self, body: Body):
        self.body = body
        X, u = body.X, body.unknowns.fields["u"]
        r = ufl.sqrt(X[0] ** 2 + X[1] ** 2)
        if body.scene.physics.small_strain:
            outward = (u[0] * X[0] + u[1] * X[1]) / r
        else:
            outward = ufl.sqrt((X[0] + u[0]) ** 2 + (X[1] + u[1]) ** 2) - r
        self.energy = body.over_wall(fem.Constant(body.mesh, body.scene.physics.wall_stiffness) / 2 * outward**2)

    def work(self, test: Any, trial: Any) -> tuple[Any, Any]:
        """First and second variation of the energy, as UFL forms."""
        push = ufl.derivative(self.energy, self.body.unknowns.solution, test)
        return push, ufl.derivative(push, self.body.unknowns.solution, trial)
