"""Two-level p-multigrid of a displacement block: quadratic elements, corrected by linear ones on the same mesh.

Smoothing by Chebyshev polynomials and the diagonal; on linear elements a factorisation while it is cheap, and algebraic
multigrid by smoothed aggregation with the rigid-body modes (W-cycles) beyond.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.blocks import Stiffness

PREFIX = "pmultigrid_"
FACTORED = 20_000  # unknowns of the linear elements, up to which they are factored: on several ranks that gains little
SMOOTHER = {
    "ksp_type": "chebyshev",
    "ksp_max_it": 3,
    "ksp_chebyshev_esteig": "0,0.1,0,1.1",
    "ksp_chebyshev_esteig_steps": 12,
    "esteig_ksp_type": "cg",
    "pc_type": "jacobi",  # PETSc 3.22 keeps the inverses of the nodes' blocks when the matrix is filled anew
}
FACTOR = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
AGGREGATION = {
    "ksp_type": "preonly",
    "pc_type": "gamg",
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0,
    "pc_gamg_aggressive_coarsening": 1,  # the finest level alone
    "pc_gamg_esteig_ksp_type": "cg",
    "pc_gamg_coarse_eq_limit": 1000,
    "pc_mg_cycle_type": "w",
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 2,
    "mg_levels_pc_type": "jacobi",  # aggregates of one node leave zero rows, which only jacobi takes
}


class Multigrid:
    """One cycle for the stiffness over a problem's displacements; built for one solution, and good near it."""

    def __init__(self, problem: Problem, fine: Stiffness):
        space = problem.unknowns.own_space("u")
        linear = compat.function_space(problem.mesh, compat.lagrange(problem.unknowns.dim, 1, problem.unknowns.dim))
        self._coarse = Stiffness(problem, linear, "aij")
        self._coarse.matrix.setNearNullSpace(_rigid_modes(linear))
        self._pc = PETSc.PC().create(problem.comm)
        self._pc.setOptionsPrefix(PREFIX)
        self._pc.setOperators(fine.matrix)
        self._pc.setType("mg")
        self._pc.setMGLevels(2)
        self._pc.setMGInterpolation(1, _interpolation(self._coarse, linear, space))
        self._pc.getMGCoarseSolve().setOperators(self._coarse.matrix)
        self._pc.getMGSmoother(1).setOperators(fine.matrix)
        _install(self._coarse.matrix.getSize()[0])
        self._pc.setFromOptions()

    def renew(self) -> None:
        """Build the levels for the present solution."""
        self._coarse.assemble()
        self._pc.getMGCoarseSolve().setOperators(self._coarse.matrix)  # or it is not factored again
        self._keep(False)
        self._pc.setUp()
        self._keep(True)

    def _keep(self, is_kept: bool) -> None:
        """Keep the levels and the factor of the coarse one; the diagonal is always that of the matrix."""
        self._pc.setReusePreconditioner(is_kept)
        self._pc.getMGCoarseSolve().getPC().setReusePreconditioner(is_kept)

    def apply(self, residual: PETSc.Vec, correction: PETSc.Vec) -> None:
        """One cycle from zero."""
        self._pc.apply(residual, correction)


def _install(coarse: int) -> None:
    """PETSc's options of the levels; all that stands under the prefix."""
    database = PETSc.Options(PREFIX)
    for name in list(database.getAll()):
        database.delValue(name)
    levels = {"mg_levels_": SMOOTHER, "mg_coarse_": FACTOR if coarse <= FACTORED else AGGREGATION}
    for prefix, options in levels.items():
        for name, value in options.items():
            database.setValue(prefix + name, value)


def _interpolation(coarse: Stiffness, linear: Any, space: Any) -> PETSc.Mat:
    """From linear to quadratic elements, of what is free: a held dof, whose row is the identity's, would move those
    beside it by a force over 1 instead of one over their stiffness."""
    matrix, free = compat.interpolation_matrix(linear, space), coarse.matrix.createVecRight()
    free.set(1.0)
    free.array[coarse.held] = 0.0
    matrix.diagonalScale(R=free)
    return matrix


def _rigid_modes(space: Any) -> PETSc.NullSpace:
    """The rigid-body modes of a space of displacements, orthonormal."""
    X = space.tabulate_dof_coordinates()
    dim, owned = space.dofmap.index_map_bs, space.dofmap.index_map.size_local
    turns = [(i, j) for i in range(dim) for j in range(i)]
    modes = np.zeros((dim + len(turns), len(X), dim))
    for k in range(dim):
        modes[k, :, k] = 1.0
    for mode, (i, j) in zip(modes[dim:], turns, strict=True):
        mode[:, i], mode[:, j] = X[:, j], -X[:, i]
    vectors: list[PETSc.Vec] = []
    for mode in modes:
        vector = PETSc.Vec().createMPI((dim * owned, PETSc.DETERMINE), comm=space.mesh.comm)
        vector.array[:] = mode[:owned].ravel()
        for other in vectors:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
        vectors.append(vector)
    return PETSc.NullSpace().create(vectors=vectors, comm=space.mesh.comm)
