"""One equilibrium by PETSc's SNES: built once, reused for every step."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, log10, nan
from typing import Any

import numpy as np
from petsc4py import PETSc

from indent_sim.fe.problem import Problem
from indent_sim.fe.solve import linear
from indent_sim.fe.solve.iterative import LEAST, MOST, Iterative

SOFT = 0.1  # E*/h_contact: from here every contact has been found
STIFF = 1e5  # E*/h_contact: from here the first step, not the depth, may turn cells inside out
START = 3.0  # E*/h_contact: up to here a contact is found in a few iterations
CLOSE = 0.01  # of the depth: a step up to this leaves the contact as it is
ROUGHLY = 0.1  # relative residual that will do before the contact becomes stiffer
BROKEN_LIBRARY = 76  # PETSC_ERR_LIB: what MUMPS could not do
ROUNDOFF = 1e-14  # of the largest reaction ever met: below this a residual is noise
FINE = 1e-11  # Newton's tolerance where small changes are to be seen: in Uzawa's loop, in the search for a force
INEXACT = 1e-10  # Newton's tolerance at most where systems are solved by iterations: no last step goes far below it
PROBE = 1e-6  # of the depth, or of an attraction's range: over it a tangent is one, and a residual has ten digits left
CORRECTIONS, SETTLED = 6, 1e-5  # of a derivative by an old factor, and the share of the residual that ends them
ENOUGH = 1e-4  # the same of a symmetric tangent, where what is left counts twice over
EXACT = 1e-9  # of a derivative, where its systems are solved by iterations
FINEST = 1e-8  # relative residual of one of these systems: the next begins where it ends
NOISE = 1e-17  # relative residual per stiffness [thickness/E]: what round-off in the gaps makes of it


class Newton:
    """Semismooth Newton on a Problem; the residual is measured against the supports' reactions.

    Converged when |residual of free dofs| <= rtol * |reactions of the constrained dofs| + what is round-off.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        settings = problem.scene.solver
        self.rtol = self._tolerance = min(settings.rtol, INEXACT if settings.linear == "iterative" else 1.0)
        self.max_iterations = settings.max_iterations
        self.iterations = 0
        self._largest_reaction = 0.0
        self._solved_at = 0.0  # depth of the last solution
        self._reaction = 0.0
        self._has_tangent = False
        self._residual = self._before = 0.0  # now, and before the last step
        self.failure = ""  # why the last solve did not converge
        self._user_options = settings.petsc
        self._iterative = Iterative(problem) if settings.linear == "iterative" else None
        self._tangent = self._iterative.tangent if self._iterative else problem.create_tangent()
        self.snes = self._create(symmetric=problem.has_symmetric_tangent)

    @property
    def krylov_iterations(self) -> int | None:
        """Iterations of the linear solver so far; None where systems are factored."""
        return self._iterative.iterations if self._iterative else None

    def _create(self, *, symmetric: bool) -> PETSc.SNES:
        self._halved = not self._iterative and linear.halves(self._user_options, symmetric)
        self._has_tangent = False
        linear.install({"pc_type": "python"} if self._iterative else self._user_options, symmetric=symmetric)
        snes = PETSc.SNES().create(self.problem.comm)
        snes.setOptionsPrefix(linear.PREFIX)
        snes.setFunction(self._function, self.problem.b.duplicate())
        snes.setJacobian(self._jacobian, self._tangent)
        snes.setTolerances(max_it=self.max_iterations)
        snes.setConvergenceTest(self._converged)
        if self._iterative:  # before its options are read: PETSc would look for a preconditioner of this matrix
            self._iterative.attach(snes.getKSP())
        with linear.blamed(self._user_options):
            snes.setFromOptions()
        return snes

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        problem = self.problem
        problem.body.set_solution(x)
        problem.assemble_residual(problem.b)
        values = problem.b.array
        held = values[problem.body.supports]
        self._reaction = _norm(problem.comm, held)
        values[problem.body.constrained] = 0.0  # the constrained dofs are zero and stay zero
        self._before, self._residual = self._residual, _norm(problem.comm, values * problem.row_weights)
        problem.b.copy(f)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        self._assemble(P, self._forcing() if self._iterative else 0.0)

    def _assemble(self, tangent: PETSc.Mat, rtol: float) -> None:
        """The tangent at the present solution; `rtol` of its systems where they are solved by iterations."""
        self._has_tangent = True
        if self._iterative:
            self._iterative.assemble(rtol)
        else:
            self.problem.assemble_tangent(tangent)

    def _forcing(self) -> float:
        """How far the residual is to be reduced by a step that is solved for inexactly.

        As far as Newton will reduce it itself, judging by the last step (Eisenstat and Walker 1996, choice 2), and no
        further than the equilibrium asks for.
        """
        enough = 0.3 * (self._tolerance * self._reaction + ROUNDOFF * self._largest_reaction) / self._residual
        expected = (self._residual / self._before) ** 2 if self._before else 1.0
        return max(min(LEAST, expected), enough)

    def _converged(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        residual = self._residual
        reasons = PETSc.SNES.ConvergedReason
        if not np.isfinite(residual):
            return reasons.DIVERGED_FNORM_NAN
        if residual <= self._tolerance * self._reaction + ROUNDOFF * self._largest_reaction:
            return reasons.CONVERGED_FNORM_RELATIVE
        return reasons.ITERATING

    def solve(self, rtol: float = 0.0) -> bool:
        """Find the equilibrium at the problem's delta from its current solution; True when done.

        Full steps first: at the kinks of contact a line search stalls where they get through. If they do not, through
        softer contact to the law's own. `rtol`: a relative residual that will do, where its own is finer. On failure
        the solution is left as it was before.
        """
        solved = self._solve(rtol) or self._solve_from_softer_contact()
        PETSc.garbage_cleanup(self.problem.x.comm)  # or vectors that Python let go of stay, also on one rank
        if solved:
            self._solved_at = self.problem.depth
        return solved

    def approach(self, between: Callable[[], object] = lambda: None) -> bool:
        """Come near the equilibrium of a stiff contact through softer ones, each found roughly; True when there.

        Fewer iterations than at once: a contact that is 100 E*/h_contact stiff is sought point by point. `between` is
        called after each. On failure the solution is left as it was before.
        """
        problem, start, found = self.problem, self.problem.x.copy(), True
        is_close = abs(problem.depth - self._solved_at) <= CLOSE * abs(problem.depth)
        for factor in [] if is_close else stages(problem.law, problem.scene):
            problem.soften(factor)
            found = self._solve(ROUGHLY)
            if not found:
                problem.body.set_solution(start)
                break
            between()
        problem.soften(1.0)
        return found

    def _solve(self, rtol: float = 0.0) -> bool:
        self._tolerance, self._residual = max(self.rtol, rtol), 0.0
        start = self.problem.x.copy()
        guess = self.problem.x.copy()
        self.problem.begin_solve()
        if not self._runs(guess):
            self.problem.body.set_solution(start)
            self.failure = "the linear solver failed"
            return False
        self.iterations += self.snes.getLinearSolveIterations() or self.snes.getIterationNumber()
        reason = self.snes.getConvergedReason()
        if self._halved and reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
            self.problem.body.set_solution(start)
            self.snes = self._create(symmetric=False)  # L U pivots more freely: from here on that
            return self._solve(rtol)
        converged = reason > 0
        self.failure = "" if converged else self._why_not()
        self.problem.body.set_solution(guess if converged else start)
        if converged:
            self._largest_reaction = max(self._largest_reaction, self._reaction)
        return converged

    def _runs(self, guess: PETSc.Vec) -> bool:
        """Let SNES go to its end; False where the factorisation itself breaks down, as it may on a wild iterate."""
        try:
            with linear.blamed(self._user_options):
                self.snes.solve(None, guess)
        except PETSc.Error as error:
            if error.ierr != BROKEN_LIBRARY:
                raise
            self.snes = self._create(symmetric=False)  # the old one keeps what is left of the factors
            return False
        return True

    def _solve_from_softer_contact(self) -> bool:
        """A stiffness that is too much for Newton is within reach from the solution for a tenth of it, and so on."""
        problem, failure = self.problem, self.failure
        reason, reasons = self.snes.getConvergedReason(), PETSc.SNES.ConvergedReason
        is_thrown_out = reason == reasons.DIVERGED_FNORM_NAN and is_stiff(problem.law, problem.scene)
        if self.problem.law.adhesion or (reason != reasons.DIVERGED_MAX_IT and not is_thrown_out):
            return False  # where a tip snaps in or lets go, no softer contact leads to the other state
        start, solved = problem.x.copy(), False
        for factor in softening(problem.law, problem.scene):
            problem.soften(factor)
            solved = self._solve()
            if not solved:
                break
        else:
            return solved
        problem.soften(1.0)
        problem.body.set_solution(start)
        self.failure = failure
        return False

    def stiffness(self) -> float:
        """dF/ddelta [force/length] of the equilibrium just found, NaN where its factor does not tell (collective).

        The way w of the solution per depth, by the last tangent and what its residual r then leaves; an assembly of the
        residual each, no new tangent. Where the tangent is symmetric, r is worth w . r of force, up to its square.
        """
        problem = self.problem
        if problem.law.multiplier == "frozen":  # its multiplier moves in the loop outside
            return nan
        self._provide_tangent()
        start, depth, force = problem.x.copy(), problem.depth, problem.force()
        acting = (problem.law.adhesion.range or 0.0) if problem.law.adhesion else 0.0
        step, settled, first, way = PROBE * max(abs(depth), acting), False, 0.0, problem.x.duplicate()
        share = ENOUGH if problem.has_symmetric_tangent else SETTLED
        copies = problem.scene.physics.part.copies if problem.has_symmetric_tangent else 0
        way.set(0.0)
        begin, left, correction = (problem.b.duplicate() for _ in range(3))
        self._function(self.snes, start, begin)
        problem.delta.value = depth + step
        for _ in range(CORRECTIONS):
            self._function(self.snes, start + step * way, left)
            left.axpy(-1.0, begin)
            found = (problem.force() - force + copies * way.dot(left)) / step
            size = left.norm()
            first = first or size
            settled = self._tells(left, step, found) if self._iterative else size <= share * first
            if settled or not np.isfinite(size):
                break
            self.snes.getKSP().solve(left, correction)
            way.axpy(-1.0 / step, correction)
        problem.delta.value = depth
        problem.body.set_solution(start)
        return found if settled else nan

    def _tells(self, left: PETSc.Vec, step: float, found: float) -> bool:
        """Whether a residual leaves a stiffness as it is; if not, the next system is solved as far as that asks for.

        Judged by its energy: in the norm of the forces a stiff contact hides what the body lacks.
        """
        assert self._iterative
        wrong = self.problem.scene.physics.part.copies * self._iterative.energy(left) / step**2
        enough = EXACT * abs(found)
        if wrong > enough:
            self._iterative.rtol = max(0.3 * (enough / wrong) ** 0.5, FINEST)
        return wrong <= enough

    def _provide_tangent(self) -> None:
        """A tangent to solve with: the last one, or the first, where a state taken up again needed no iteration."""
        if not self._has_tangent:
            self._assemble(self._tangent, ENOUGH)
        self.snes.getKSP().setOperators(self._tangent, self._tangent)

    def _why_not(self) -> str:
        """What ended the last solve, in words."""
        reasons, reason = PETSc.SNES.ConvergedReason, self.snes.getConvergedReason()
        if self._iterative and self._iterative.failed:
            return f"a linear system was not solved within {MOST} iterations"
        if reason == reasons.DIVERGED_LINEAR_SOLVE:
            of = " (solver.petsc chose it)" if self._user_options else ""
            return f"the linear solver failed{of}"
        if reason == reasons.DIVERGED_MAX_IT:
            return f"no equilibrium within {self.max_iterations} iterations"
        if reason == reasons.DIVERGED_FNORM_NAN:
            return "the residual is not a number"
        return f"SNES reason {reason}"


def finest(problem: Problem) -> float:
    """The smallest relative residual that is not noise."""
    return max(FINE, NOISE * problem.stiffness_scale)


def stages(law: Any, scene: Any) -> list[float]:
    """Factors for the stiffness of a contact law, by half decades from START to below its own; none if it is soft."""
    excess = law.stiffness * scene.sizes.h_contact / scene.physics.material.E_star / START
    steps = max(1, round(2 * log10(excess))) if excess > 1 else 0
    return [excess ** (k / steps - 1) for k in range(steps)]


def is_stiff(law: Any, scene: Any) -> bool:
    """Whether a first step may throw the body out of all bounds for the stiffness of contact alone."""
    return getattr(law, "stiffness", 0.0) > STIFF * scene.physics.material.E_star / scene.sizes.h_contact


def softening(law: Any, scene: Any) -> list[float]:
    """Factors for the stiffness of a contact law, by decades from a soft contact to its own; none if it has none."""
    stiffness = getattr(law, "stiffness", None)
    if stiffness is None:
        return []
    soft = SOFT * scene.physics.material.E_star / scene.sizes.h_contact
    decades = max(1, ceil(log10(stiffness / soft) - 1e-9))  # a rounding is no decade
    return [10.0**-k for k in range(decades, -1, -1)]


def _norm(comm: Any, values: np.ndarray) -> float:
    return float(np.sqrt(comm.allreduce(float(values @ values))))
