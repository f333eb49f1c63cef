"""The linear systems of Newton's method by FGMRES, as exactly as each is worth.

The preconditioner is the upper block factor of the tangent's Schur complement: S for each field
beside the displacement, one cycle of multigrid for the displacement. It is kept until it has cost
as many iterations more as a new one is worth.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, log10
from weakref import WeakMethod

import numpy as np
from petsc4py import PETSc

from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.blocks import DisplacementStiffness, FieldBlocks
from indent_sim.fe.solve.multigrid import Multigrid

MOST_KRYLOV_ITERATIONS = 200  # iterations of one system
INEXACT_REDUCTION = (
    1e-2  # what an inexact step leaves of a residual: asked for more, Newton needs no fewer steps
)


class Iterative:
    """Solves one system after another: `assemble`, then `apply` as the preconditioner of PETSc's
    SNES.
    """

    def __init__(self, problem: Problem):
        self.iterations = 0
        self.rtol = 0.0
        self.has_failed = False
        unknowns = problem.unknowns
        space = problem.unknowns.collapsed_space("u")
        owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self._problem = problem
        self._A = DisplacementStiffness(problem, space, "sbaij")
        self._field_blocks = [FieldBlocks(problem, name) for name in unknowns.names[1:]]
        self._block_dofs = [
            unknowns.dofs("u")[:owned],
            *(field.free_dofs for field in self._field_blocks),
        ]
        self._weights = [1.0, *(field.weight for field in self._field_blocks)]
        self._multigrid = Multigrid(problem, self._A)
        self._excess_iterations = inf
        self._solve_count = 0
        self._fewest_per_digit = inf
        self._ksp = self._create_krylov_solver()
        self.tangent = PETSc.Mat().createPython((problem.x.getSizes(),) * 2, comm=problem.comm)

    def attach(self, ksp: PETSc.KSP) -> None:
        """Solve the systems of Newton's method; options of the environment without a prefix are the
        solver's own.
        """
        ksp.setOptionsPrefix("newton_")
        ksp.setType("preonly")
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(_WeakPreconditioner(self.apply))

    def _create_krylov_solver(self) -> PETSc.KSP:
        rows = [[self._A.matrix, *(field.B for field in self._field_blocks)]]
        for k, field in enumerate(self._field_blocks):
            diagonal = [field.C if k == other else None for other in range(len(self._field_blocks))]
            rows.append([PETSc.Mat().createTranspose(field.B), *diagonal])
        tangent = PETSc.Mat().createNest(rows, comm=self._A.matrix.comm)
        blocks = [self._A.matrix, *(field.C for field in self._field_blocks)]
        vectors = ([block.createVecLeft() for block in blocks] for _ in range(2))
        self._b, self._x = (PETSc.Vec().createNest(parts, comm=tangent.comm) for parts in vectors)
        self._work = self._A.matrix.createVecLeft(), self._A.matrix.createVecLeft()
        ksp = PETSc.KSP().create(self._problem.comm)
        ksp.setOperators(tangent)
        ksp.setType("fgmres")
        ksp.setGMRESRestart(40)
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(_WeakPreconditioner(self.apply_preconditioner))
        ksp.setFromOptions()
        return ksp

    def assemble(self, rtol: float) -> None:
        """The tangent at the present solution, which will be solved to `rtol`; the preconditioner
        where it is worn.
        """
        self.rtol = rtol
        self._A.assemble()
        for field in self._field_blocks:
            field.assemble()
            field.factor()
        self._ksp.getOperators()[0].assemble()
        if self._excess_iterations >= 20:  # iterations: what a new one costs
            self._rebuild_preconditioner()

    def _rebuild_preconditioner(self) -> None:
        self._multigrid.rebuild()
        self._excess_iterations = 0.0
        self._solve_count = 0

    def apply(self, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """Solve for a step to the tolerance; what is held and idle stays."""
        self._load_residual(residual)
        self._ksp.setTolerances(rtol=self.rtol, atol=0.0, max_it=MOST_KRYLOV_ITERATIONS)
        self._solve()
        if self.has_failed and self._solve_count > 1:
            self._rebuild_preconditioner()
            self._solve()
        step.set(0.0)
        for block, dofs, weight in zip(
            self._x.getNestSubVecs(), self._block_dofs, self._weights, strict=True
        ):
            step.array[dofs] = weight * block.array_r
        if self.has_failed:
            step.set(np.nan)  # a system that was not solved makes the step no number

    def residual_energy(self, residual: PETSc.Vec) -> float:
        """The energy r .

        A^-1 r of a residual r, by the preconditioner; fields added up, whatever their sign.
        """
        self._load_residual(residual)
        self.apply_preconditioner(self._b, self._x)
        pairs = zip(self._b.getNestSubVecs(), self._x.getNestSubVecs(), strict=True)
        return float(sum(abs(known.dot(found)) for known, found in pairs))

    def _load_residual(self, residual: PETSc.Vec) -> None:
        for block, dofs, weight in zip(
            self._b.getNestSubVecs(), self._block_dofs, self._weights, strict=True
        ):
            block.array[:] = weight * residual.array_r[dofs]

    def _solve(self) -> None:
        """Solve for the blocks; count the iterations, and those beyond the fewest that a digit has
        ever cost.
        """
        self._ksp.solve(self._b, self._x)
        iterations = self._ksp.getIterationNumber()
        digits = -log10(min(self.rtol, INEXACT_REDUCTION))  # of few digits the first costs most
        self.iterations += iterations
        self._solve_count += 1
        is_solved = self._ksp.getConvergedReason() > 0 and np.isfinite(self._x.norm())
        self.has_failed = not is_solved
        if self.has_failed:
            self._excess_iterations = inf
            return
        self._fewest_per_digit = min(self._fewest_per_digit, iterations / digits)
        self._excess_iterations += iterations - self._fewest_per_digit * digits

    def apply_preconditioner(self, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """The upper factor of the block preconditioner, applied."""
        r, *field_residuals = residual.getNestSubVecs()
        u, *field_steps = step.getNestSubVecs()
        load, coupling_load = self._work
        r.copy(load)
        for field, rhs, solution in zip(
            self._field_blocks, field_residuals, field_steps, strict=True
        ):
            field.solve(rhs, solution)
            field.B.mult(solution, coupling_load)
            load.axpy(-1.0, coupling_load)
        self._multigrid.apply(load, u)


class _WeakPreconditioner:
    """A method as PETSc calls a preconditioner; held weakly, for Python finds no circle that goes
    through PETSc.
    """

    def __init__(self, method: Callable[[PETSc.Vec, PETSc.Vec], None]):
        self._method = WeakMethod(method)

    def apply(self, pc: PETSc.PC, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """Apply it to a residual."""
        if method := self._method():
            method(residual, step)
