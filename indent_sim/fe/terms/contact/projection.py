"""The L2 projection of the contact pressure on the Lagrange functions of the contact surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body

MixingRule = Callable[
    [np.ndarray, np.ndarray], np.ndarray
]  # the next vector, from the present one and its image


class PressureProjection:
    """lam <- the L2 projection of <p_hat> on the contact surface: int lam N = int <p_hat> N, the
    nodal forces. What a law without a multiplier of its own knows of the pressure, p_hat at
    points, oscillates inside the elements as much as its stiffness magnifies the gap; the nodal
    forces do not.
    """

    def __init__(self, body: Body, pressure: Expr, function: fem.Function):
        self.function = function  # whose memory `lam` is
        self.lam = compat.petsc_vector(function)
        space = function.function_space
        trial = ufl.TrialFunction(space)
        test = ufl.TestFunction(space)
        # the volume term is zero: it only gives dofs off the surface a place on the diagonal
        diagonal = fem.Constant(body.mesh, 0.0) * trial * test * ufl.dx
        mass = fem.form(body.contact_integral(trial * test) + diagonal)
        self._load_form = fem.form(body.contact_integral(pressure * test))
        surface_dofs = fem.locate_dofs_topological(
            space, body.body_mesh.dim - 1, body.body_mesh.surfaces["top"]
        )
        off_surface = np.setdiff1d(np.arange(len(function.x.array)), surface_dofs).astype(np.int32)
        self._off_surface_dofs = off_surface[off_surface < space.dofmap.index_map.size_local]
        matrix = fem_petsc.assemble_matrix(mass, [compat.zero_bc(off_surface, space)])
        matrix.assemble()
        self._b = compat.create_vector(self._load_form, space)
        self._solver = PETSc.KSP().create(body.comm)
        self._solver.setOperators(matrix)
        self._solver.setType("preonly")
        self._solver.getPC().setType("lu")
        self._solver.getPC().setFactorSolverType("mumps")

    def update_multiplier(self, mixing: MixingRule | None = None) -> float:
        """Change the multiplier (collective); returns how far it was from its projection, relative
        to itself: NaN where one of both is not a number.
        """
        with self._b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._b, self._load_form)
        self._b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        self._b.array[self._off_surface_dofs] = 0.0
        before = self.lam.copy()
        image = self.lam.duplicate()
        self._solver.solve(self._b, image)
        magnitude = np.maximum(
            image.norm(), before.norm()
        )  # NaN where one is, which max() may lose
        self.lam.array[:] = mixing(before.array_r, image.array_r) if mixing else image.array_r
        self.lam.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        before.axpy(-1.0, image)
        return before.norm() / magnitude if magnitude != 0 else 0.0
