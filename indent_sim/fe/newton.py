"""One equilibrium by PETSc's SNES: built once, reused for every step."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from indent_sim.fe import options
from indent_sim.fe.problem import Problem

ROUNDOFF = 1e-14  # of the largest reaction ever met: below this a residual is noise


class Newton:
    """Semismooth Newton on a Problem; the residual is measured against the supports' reactions.

    Converged when |residual of free dofs| <= rtol * |reactions of the constrained dofs| + what is round-off.
    """

    def __init__(self, problem: Problem, rtol: float, max_iterations: int, petsc: dict[str, Any]):
        self.problem = problem
        self.rtol = rtol
        self.max_iterations = max_iterations
        self.iterations = 0
        self._largest_reaction = 0.0
        self._reaction = 0.0
        self._residual = 0.0
        self.failure = ""  # why the last solve did not converge
        self._user_options = petsc
        self.snes = self._create()

    def _create(self) -> PETSc.SNES:
        options.install(self._user_options)
        snes = PETSc.SNES().create(self.problem.comm)
        snes.setOptionsPrefix(options.PREFIX)
        snes.setFunction(self._function, self.problem.b.duplicate())
        snes.setJacobian(self._jacobian, self.problem.A)
        snes.setTolerances(max_it=self.max_iterations)
        snes.setConvergenceTest(self._converged)
        with options.blamed(self._user_options):
            snes.setFromOptions()
        return snes

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        problem = self.problem
        problem.set_solution(x)
        problem.assemble_residual(problem.b)
        values = problem.b.array
        held = values[problem.supports]
        self._reaction = _norm(problem.comm, held)
        values[problem.constrained] = 0.0  # the constrained dofs are zero and stay zero
        self._residual = _norm(problem.comm, values * problem.row_weights)
        problem.b.copy(f)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        self.problem.assemble_tangent(P)

    def _converged(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        residual = self._residual
        reasons = PETSc.SNES.ConvergedReason
        if not np.isfinite(residual):
            return reasons.DIVERGED_FNORM_NAN
        noise = ROUNDOFF * self._largest_reaction + self.problem.noise
        if residual <= self.rtol * self._reaction + noise:
            return reasons.CONVERGED_FNORM_RELATIVE
        return reasons.ITERATING

    def solve(self) -> bool:
        """Find the equilibrium at the problem's delta from its current solution; True when converged.

        On failure the solution is left as it was before.
        """
        start = self.problem.x.copy()
        guess = self.problem.x.copy()
        with options.blamed(self._user_options):
            self.snes.solve(None, guess)
        self.iterations += self.snes.getLinearSolveIterations() or self.snes.getIterationNumber()
        converged = self.snes.getConvergedReason() > 0
        self.failure = "" if converged else self._why_not()
        self.problem.set_solution(guess if converged else start)
        if converged:
            self._largest_reaction = max(self._largest_reaction, self._reaction)
        return converged

    def _why_not(self) -> str:
        """What ended the last solve, in words."""
        reasons, reason = PETSc.SNES.ConvergedReason, self.snes.getConvergedReason()
        if reason == reasons.DIVERGED_LINEAR_SOLVE:
            of = " (solver.petsc chose it)" if self._user_options else ""
            return f"the linear solver failed{of}"
        if reason == reasons.DIVERGED_MAX_IT:
            return f"no equilibrium within {self.max_iterations} iterations"
        if reason == reasons.DIVERGED_FNORM_NAN:
            return "the residual is not a number"
        return f"SNES reason {reason}"


def _norm(comm: Any, values: np.ndarray) -> float:
    return float(np.sqrt(comm.allreduce(float(values @ values))))
