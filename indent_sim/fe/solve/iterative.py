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
from indent_sim.fe.solve.blocks import FieldBlocks, Stiffness
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
        self.failed = False
        unknowns = problem.unknowns
        space = problem.unknowns.own_space("u")
        owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self._problem = problem
        self._A = Stiffness(problem, space, "sbaij")
        self._beside = [FieldBlocks(problem, name) for name in unknowns.names[1:]]
        self._places = [unknowns.places("u")[:owned], *(field.places for field in self._beside)]
        self._weights = [1.0, *(field.weight for field in self._beside)]
        self._multigrid = Multigrid(problem, self._A)
        self._wear = inf
        self._solves = 0
        self._least = inf
        self._ksp = self._create()
        self.tangent = PETSc.Mat().createPython((problem.x.getSizes(),) * 2, comm=problem.comm)

    def attach(self, ksp: PETSc.KSP) -> None:
        """Solve the systems of Newton's method; options of the environment without a prefix are the
        solver's own.
        """
        ksp.setOptionsPrefix("newton_")
        ksp.setType("preonly")
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(_Weakly(self.apply))

    def _create(self) -> PETSc.KSP:
        rows = [[self._A.matrix, *(field.B for field in self._beside)]]
        for k, field in enumerate(self._beside):
            own = [field.C if k == other else None for other in range(len(self._beside))]
            rows.append([PETSc.Mat().createTranspose(field.B), *own])
        tangent = PETSc.Mat().createNest(rows, comm=self._A.matrix.comm)
        blocks = [self._A.matrix, *(field.C for field in self._beside)]
        vectors = ([block.createVecLeft() for block in blocks] for _ in range(2))
        self._b, self._x = (PETSc.Vec().createNest(parts, comm=tangent.comm) for parts in vectors)
        self._work = self._A.matrix.createVecLeft(), self._A.matrix.createVecLeft()
        ksp = PETSc.KSP().create(self._problem.comm)
        ksp.setOperators(tangent)
        ksp.setType("fgmres")
        ksp.setGMRESRestart(40)
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(_Weakly(self.precondition))
        ksp.setFromOptions()
        return ksp

    def assemble(self, rtol: float) -> None:
        """The tangent at the present solution, which will be solved to `rtol`; the preconditioner
        where it is worn.
        """
        self.rtol = rtol
        self._A.assemble()
        for field in self._beside:
            field.assemble()
            field.factor()
        self._ksp.getOperators()[0].assemble()
        if self._wear >= 20:  # iterations: what a new one costs
            self._renew()

    def _renew(self) -> None:
        self._multigrid.renew()
        self._wear = 0.0
        self._solves = 0

    def apply(self, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """Solve for a step to the tolerance; what is held and idle stays."""
        self._take(residual)
        self._ksp.setTolerances(rtol=self.rtol, atol=0.0, max_it=MOST_KRYLOV_ITERATIONS)
        self._solve()
        if self.failed and self._solves > 1:
            self._renew()
            self._solve()
        step.set(0.0)
        for block, places, weight in zip(
            self._x.getNestSubVecs(), self._places, self._weights, strict=True
        ):
            step.array[places] = weight * block.array_r
        if self.failed:
            step.set(np.nan)  # a system that was not solved makes the step no number

    def energy(self, residual: PETSc.Vec) -> float:
        """The energy r .

        A^-1 r of a residual r, by the preconditioner; fields added up, whatever their sign.
        """
        self._take(residual)
        self.precondition(self._b, self._x)
        pairs = zip(self._b.getNestSubVecs(), self._x.getNestSubVecs(), strict=True)
        return float(sum(abs(known.dot(found)) for known, found in pairs))

    def _take(self, residual: PETSc.Vec) -> None:
        for block, places, weight in zip(
            self._b.getNestSubVecs(), self._places, self._weights, strict=True
        ):
            block.array[:] = weight * residual.array_r[places]

    def _solve(self) -> None:
        """Solve for the blocks; count the iterations, and those beyond the fewest that a digit has
        ever cost.
        """
        self._ksp.solve(self._b, self._x)
        iterations = self._ksp.getIterationNumber()
        digits = -log10(min(self.rtol, INEXACT_REDUCTION))  # of few digits the first costs most
        self.iterations += iterations
        self._solves += 1
        solved = self._ksp.getConvergedReason() > 0 and np.isfinite(self._x.norm())
        self.failed = not solved
        if self.failed:
            self._wear = inf
            return
        self._least = min(self._least, iterations / digits)
        self._wear += iterations - self._least * digits

    def precondition(self, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """The upper factor of the block preconditioner, applied."""
        r, *others = residual.getNestSubVecs()
        u, *fields = step.getNestSubVecs()
        load, push = self._work
        r.copy(load)
        for field, known, found in zip(self._beside, others, fields, strict=True):
            field.solve(known, found)
            field.B.mult(found, push)
            load.axpy(-1.0, push)
        self._multigrid.apply(load, u)


class _Weakly:
    """A method as PETSc calls a preconditioner; held weakly, for Python finds no circle that goes
    through PETSc.
    """

    def __init__(self, method: Callable[[PETSc.Vec, PETSc.Vec], None]):
        self._method = WeakMethod(method)

    def apply(self, pc: PETSc.PC, residual: PETSc.Vec, step: PETSc.Vec) -> None:
        """Apply it to a residual."""
        if method := self._method():
            method(residual, step)
