"""The curved roller wall of a cylinder in three dimensions: u . n = 0 with the cylinder's own normal, weakly."""

from __future__ import annotations

import ufl
from dolfinx import fem

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.terms.term import Term


class Wall(Term):
    """The wall's points stay on r = radius, by the energy stiffness/2 w^2; w = u . n at small strain. n is the
    cylinder's own normal, the stiffness `scene.physics.wall_stiffness` in pressure/length."""

    is_matter = True

    def __init__(self, body: Body):
        self.is_constant = body.scene.physics.small_strain
        X, u = body.X, body.now.fields["u"]
        r = ufl.sqrt(X[0] ** 2 + X[1] ** 2)
        if body.scene.physics.small_strain:
            outward = (u[0] * X[0] + u[1] * X[1]) / r
        else:
            outward = ufl.sqrt((X[0] + u[0]) ** 2 + (X[1] + u[1]) ** 2) - r
        stiffness = fem.Constant(body.mesh, body.scene.physics.wall_stiffness)
        self.energy = body.over_surface("r_max", stiffness / 2 * outward**2)
