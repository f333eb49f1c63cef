"""Krylov solver of the linear systems of Newton's method: flexible GMRES.

The preconditioner is the upper block-triangular factor of the tangent: an approximate Schur
complement for each field other than the displacement, one multigrid cycle for the displacement. The
multigrid hierarchy is kept until the additional iterations with the old hierarchy have cost more
than a new one. Each system is solved only as accurately as Newton's method needs.
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

MAX_KRYLOV_ITERATIONS = 200  # limit for one system
# Largest relative tolerance of a system; with a smaller one Newton's method takes no fewer steps
INEXACT_REDUCTION = 1e-2


class Iterative:
    """Krylov solver of the tangent: `assemble`, then `apply` as a preconditioner of SNES."""

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
        """Use this solver as the linear solver of SNES.

        Options without a prefix in the environment variable PETSC_OPTIONS apply to this solver.
        """
        ksp.setOptionsPrefix("newton_")
        ksp.setType("preonly")
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(_WeakPreconditioner(self.apply))

    def _create_krylov_solver(self) -> PETSc.KSP:
        """Create the Krylov solver with its nested matrix and vectors."""
        rows = [[self._A.matrix, *(field.B for field in self._field_blocks)]]
        for k, field in enumerate(self._field_blocks):
            diagonal = [
                field.C if k == column else None for column in range(len(self._field_blocks))
            ]
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
        """Assemble the tangent at the present solution; `rtol` is the tolerance of the solver.

        The multigrid hierarchy is rebuilt if the present one needs too many iterations.
        """
        self.rtol = rtol
        self._A.assemble()
        for field in self._field_blocks:
            field.assemble()
            field.factor()
        self._ksp.getOperators()[0].assemble()
        # Building a new hierarchy takes as long as 20 iterations
        if self._excess_iterations >= 20:
            self._rebuild_preconditioner()

    def _rebuild_preconditioner(self) -> None:
        """Build the multigrid hierarchy for the present solution."""
        self._multigrid.rebuild()
        self._excess_iterations = 0.0
        self._solve_count = 0

    def apply(self, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """Solve for a Newton step, which is zero at constrained and unused dofs."""
        self._load_residual(residual)
        self._ksp.setTolerances(rtol=self.rtol, atol=0.0, max_it=MAX_KRYLOV_ITERATIONS)
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
            step.set(np.nan)  # a system that was not solved gives a step of NaN

    def residual_energy(self, residual: PETSc.Vec) -> float:
        """Return the energy r . A^-1 r of a residual r, with the preconditioner in place of A^-1.

        The contributions of the fields are added by their absolute values.
        """
        self._load_residual(residual)
        self.apply_preconditioner(self._b, self._x)
        pairs = zip(self._b.getNestSubVecs(), self._x.getNestSubVecs(), strict=True)
        return float(sum(abs(rhs.dot(solution)) for rhs, solution in pairs))

    def _load_residual(self, residual: PETSc.Vec) -> None:
        """Scale a residual and copy it into the blocks of the right-hand side."""
        for block, dofs, weight in zip(
            self._b.getNestSubVecs(), self._block_dofs, self._weights, strict=True
        ):
            block.array[:] = weight * residual.array_r[dofs]

    def _solve(self) -> None:
        """Solve the block system and count the iterations.

        Excess iterations are counted relative to the smallest number of iterations per decimal
        digit of any system so far.
        """
        self._ksp.solve(self._b, self._x)
        iterations = self._ksp.getIterationNumber()
        # The first digits need the most iterations, so a minimum number of digits is assumed
        digits = -log10(min(self.rtol, INEXACT_REDUCTION))
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
        """Apply the upper block-triangular preconditioner to a residual."""
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
    """PETSc preconditioner that calls a method through a weak reference.

    A strong reference would form a cycle through PETSc, which Python cannot collect.
    """

    def __init__(self, method: Callable[[PETSc.Vec, PETSc.Vec], None]):
        self._method = WeakMethod(method)

    def apply(self, pc: PETSc.PC, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """Apply the preconditioner to a residual."""
        if method := self._method():
            method(residual, step)
