"""Weak roller condition on the curved wall of a cylinder in three dimensions."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.terms.term import Term
from indent_sim.mesh.reactions import SurfaceComponent


class WeakRollerBC(Term):
    """Penalty energy stiffness/2 w^2 of the radial displacement w of a cylinder's wall.

    At small strain w = u . n with the normal n of the exact cylinder, not of the facets; at finite
    strain w is the change of the radius. The stiffness is `scene.physics.wall_stiffness`
    [pressure/length].
    """

    is_bulk = True

    def __init__(self, body: Body):
        self._body = body
        self.has_constant_tangent = body.scene.physics.small_strain
        X = body.X
        u = body.now.fields["u"]
        r = ufl.sqrt(X[0] ** 2 + X[1] ** 2)
        if body.scene.physics.small_strain:
            radial_displacement = (u[0] * X[0] + u[1] * X[1]) / r
            normal = [X[axis] / r for axis in (0, 1)]
        else:
            deformed = ufl.sqrt((X[0] + u[0]) ** 2 + (X[1] + u[1]) ** 2)
            radial_displacement = deformed - r
            normal = [(X[axis] + u[axis]) / deformed for axis in (0, 1)]
        stiffness = fem.Constant(body.mesh, body.scene.physics.wall_stiffness)
        self.energy = body.surface_integral("r_max", stiffness / 2 * radial_displacement**2)
        self._axis = fem.Constant(body.mesh, np.array([1.0, 0.0]))
        axis_component = self._axis[0] * normal[0] + self._axis[1] * normal[1]
        self._reaction_expression = body.surface_integral(
            "r_max", -stiffness * radial_displacement * axis_component
        )

    @cached_property
    def _reaction_form(self) -> fem.Form:
        return compile_form(self._reaction_expression)

    def reactions(self) -> dict[SurfaceComponent, float]:
        """Force of the wall on the body along x and y [force], this rank's part."""
        reactions: dict[SurfaceComponent, float] = {}
        for axis in (0, 1):
            self._axis.value = np.eye(2)[axis]
            reactions["r_max", axis] = float(fem.assemble_scalar(self._reaction_form))
        return reactions

    def reaction_rows(self) -> dict[SurfaceComponent, np.ndarray]:
        """Row vectors (owned dofs,) whose product with the solution is the reaction (linear body).

        There is one row vector for each axis [force per unit of the dof] (collective).
        """
        body = self._body
        form = compile_form(
            ufl.derivative(self._reaction_expression, body.now.function, body.now.test)
        )
        rows: dict[SurfaceComponent, np.ndarray] = {}
        for axis in (0, 1):
            self._axis.value = np.eye(2)[axis]
            vector = fem_petsc.assemble_vector(form)
            vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            rows["r_max", axis] = vector.array_r.copy()
        return rows
