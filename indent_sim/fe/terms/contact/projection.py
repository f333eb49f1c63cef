"""L2 projection of the contact pressure onto the Lagrange functions of the contact surface."""

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
from indent_sim.fe.kernel_cache import compile_form

# The next multiplier from the present one and its projection
MixingRule = Callable[[np.ndarray, np.ndarray], np.ndarray]


class PressureProjection:
    """L2 projection lam of the contact pressure: int lam N = int <p_hat> N for all functions N.

    The projection has the same nodal forces as <p_hat>. The trial pressure p_hat itself oscillates
    inside the elements, because its penalty stiffness magnifies small oscillations of the gap.

    Parameters
    ----------
    body : Body
        Discrete body.
    pressure : Expr
        The contact pressure <p_hat> [pressure], a UFL expression.
    function : fem.Function
        The multiplier lam, which `update_multiplier` changes.
    """

    def __init__(self, body: Body, pressure: Expr, function: fem.Function):
        self.function = function
        self.lam = compat.petsc_vector(function)
        space = function.function_space
        trial = ufl.TrialFunction(space)
        test = ufl.TestFunction(space)
        # The zero volume term gives the dofs off the surface an entry on the diagonal
        diagonal = fem.Constant(body.mesh, 0.0) * trial * test * ufl.dx
        mass = compile_form(body.contact_integral(trial * test) + diagonal)
        self._load_form = compile_form(body.contact_integral(pressure * test))
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
        """Replace the multiplier by its projection, or by a mixture of both (collective).

        Parameters
        ----------
        mixing : callable, optional
            Function of the present multiplier and its projection that returns the next multiplier.

        Returns
        -------
        float
            Relative difference of the multiplier and its projection before the update; NaN if one
            of the two is not finite.
        """
        with self._b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._b, self._load_form)
        self._b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        self._b.array[self._off_surface_dofs] = 0.0
        before = self.lam.copy()
        image = self.lam.duplicate()
        self._solver.solve(self._b, image)
        # np.maximum propagates NaN, max() does not
        magnitude = np.maximum(image.norm(), before.norm())
        self.lam.array[:] = mixing(before.array_r, image.array_r) if mixing else image.array_r
        self.lam.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        before.axpy(-1.0, image)
        return before.norm() / magnitude if magnitude != 0 else 0.0
