"""Two-level p-multigrid of the displacement: quadratic elements, corrected by linear ones.

Both levels use the same mesh. The smoother is a Chebyshev polynomial with the diagonal as
preconditioner. The system of linear elements is factored if it is small; otherwise it is solved by
a W-cycle of algebraic multigrid (smoothed aggregation with the rigid-body modes).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.kernel_cache import create_function_space
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.blocks import DisplacementStiffness
from indent_sim.fe.solve.petsc_options import default_options

PREFIX = "pmultigrid_"
# Number of unknowns of the linear elements up to which they are factored; on several ranks larger
# factors gain little
LARGEST_FACTORED = 20_000
# The smoother uses the diagonal and not the blocks of the nodes, whose inverses PETSc 3.22 keeps
# when the matrix changes
SMOOTHER: dict[str, Any] = {
    "ksp_type": "chebyshev",
    "ksp_max_it": 3,
    "pc_type": "jacobi",
    "esteig_ksp_type": "cg",
    "ksp_chebyshev_esteig": "0,0.1,0,1.1",
    "ksp_chebyshev_esteig_steps": 12,
}
FACTORISATION = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
# Coarsening is aggressive on the finest level only. Aggregates of one node leave zero rows, which
# only "jacobi" accepts.
AGGREGATION: dict[str, Any] = {
    "ksp_type": "preonly",
    "pc_type": "gamg",
    "pc_mg_cycle_type": "w",
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0,
    "pc_gamg_aggressive_coarsening": 1,
    "pc_gamg_coarse_eq_limit": 1000,
    "pc_gamg_esteig_ksp_type": "cg",
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 2,
    "mg_levels_pc_type": "jacobi",
}


class Multigrid:
    """Multigrid cycle as a preconditioner of the displacement block of the tangent.

    The preconditioner is built for the tangent at one solution and remains effective near this
    solution.
    """

    def __init__(self, problem: Problem, fine: DisplacementStiffness):
        space = problem.unknowns.collapsed_space("u")
        linear = create_function_space(
            problem.mesh, compat.lagrange_element(problem.unknowns.dim, 1, problem.unknowns.dim)
        )
        self._coarse = DisplacementStiffness(problem, linear, "aij")
        self._coarse.matrix.setNearNullSpace(_rigid_modes(linear))
        self._pc = PETSc.PC().create(problem.comm)
        self._pc.setOptionsPrefix(PREFIX)
        self._pc.setOperators(fine.matrix)
        self._pc.setType("mg")
        self._pc.setMGLevels(2)
        interpolation = compat.interpolation_matrix(linear, space)
        is_free = self._coarse.matrix.createVecRight()
        is_free.set(1.0)
        # The unit diagonal entry of a constrained dof would give a meaningless correction
        is_free.array[self._coarse.constrained_dofs] = 0.0
        interpolation.diagonalScale(R=is_free)
        self._pc.setMGInterpolation(1, interpolation)
        self._pc.getMGCoarseSolve().setOperators(self._coarse.matrix)
        self._pc.getMGSmoother(1).setOperators(fine.matrix)
        coarsest = (
            FACTORISATION if self._coarse.matrix.getSize()[0] <= LARGEST_FACTORED else AGGREGATION
        )
        levels = {"mg_levels_": SMOOTHER, "mg_coarse_": coarsest}
        self._options = {
            level + name: value
            for level, options in levels.items()
            for name, value in options.items()
        }
        with default_options(self._options, PREFIX):
            self._pc.setFromOptions()

    def rebuild(self) -> None:
        """Build the multigrid hierarchy for the present solution."""
        self._coarse.assemble()
        # Without setting the operators again PETSc would not factor them again
        self._pc.getMGCoarseSolve().setOperators(self._coarse.matrix)
        # Their factors are kept until the next call; the smoother follows the matrix
        levels = (self._pc, self._pc.getMGCoarseSolve().getPC())
        for pc in levels:
            pc.setReusePreconditioner(False)
        with default_options(self._options, PREFIX):
            self._pc.setUp()
        for pc in levels:
            pc.setReusePreconditioner(True)

    def apply(self, residual: PETSc.Vec, correction: PETSc.Vec) -> None:
        """Apply one multigrid cycle with initial guess zero."""
        self._pc.apply(residual, correction)


def _rigid_modes(space: fem.FunctionSpace) -> PETSc.NullSpace:
    """Return the orthonormal rigid-body modes of a space of displacements."""
    X = space.tabulate_dof_coordinates()
    dim = space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local
    rotations = [(i, j) for i in range(dim) for j in range(i)]
    modes = np.zeros((dim + len(rotations), len(X), dim))
    for k in range(dim):
        modes[k, :, k] = 1.0
    for mode, (i, j) in zip(modes[dim:], rotations, strict=True):
        mode[:, i], mode[:, j] = X[:, j], -X[:, i]
    vectors: list[PETSc.Vec] = []
    for mode in modes:
        vector = PETSc.Vec().createMPI((dim * owned, PETSc.DETERMINE), comm=space.mesh.comm)
        vector.array[:] = mode[:owned].ravel()
        for previous in vectors:
            vector.axpy(-vector.dot(previous), previous)
        vector.normalize()
        vectors.append(vector)
    return PETSc.NullSpace().create(vectors=vectors, comm=space.mesh.comm)
