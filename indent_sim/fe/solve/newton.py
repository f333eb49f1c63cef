"""One equilibrium by PETSc's SNES: built once, reused for every step."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, log10, nan
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.blocks import by_factors
from indent_sim.fe.solve.iterative import INEXACT_REDUCTION, MOST_KRYLOV_ITERATIONS, Iterative
from indent_sim.fe.solve.options import defaults
from indent_sim.fe.terms.contact.multiplier import stiffness_scale
from indent_sim.model.contact import ContactLaw
from indent_sim.scene.scene import Scene

LINEAR_SOLVER_FAILED = "the linear solver failed"
# The reason that Newton's own convergence test gives, and the only one that is accepted: SNES has others, such as that
# a step was short, which say nothing of the residual
CONVERGED = PETSc.SNES.ConvergedReason.CONVERGED_FNORM_RELATIVE
SOFT = 0.1  # E*/h_contact: from here every contact has been found
STIFF = 1e5  # E*/h_contact: from here the first step, not the depth, may turn cells inside out
FIRST_STIFFNESS = 3.0  # E*/h_contact: up to here a contact is found in a few iterations
STAGNANT = 20  # iterations without half the residual: a shorter step costs less, though some would end well
# E times the square of the height of a body that swells, and has no reactions to measure against; of the contact radius
# of one that only drains. 1e-12 of it will do
FLUID_REACTION = 100.0
KEPT_REDUCTION = 0.05  # of the residual by an old factor: with less a new one is worth its time
REACTION_ROUNDOFF = 1e-14  # of the largest reaction ever met: below this a residual is noise
FINE_TOLERANCE = 1e-11  # Newton's where small changes are to be seen: in Uzawa's loop, in the search for a force
INEXACT = 1e-10  # Newton's tolerance at most where systems are solved by iterations: no last step goes far below it
PROBE = 1e-6  # of the depth, or of an attraction's range: over it a tangent is one, and a residual has ten digits left
CORRECTIONS, SETTLED = 6, 1e-5  # of a derivative by an old factor, and the share of the residual that ends them
SETTLED_SYMMETRIC = 1e-4  # the same of a symmetric tangent, where what is left counts twice over
DERIVATIVE_TOLERANCE = 1e-9  # of a derivative, where its systems are solved by iterations
RESIDUAL_NOISE = 1e-17  # relative residual per stiffness [thickness/E]: what round-off in the gaps makes of it


class Newton:
    """Semismooth Newton on a Problem; the residual is measured against the supports' reactions. Converged when
    |residual of free dofs| <= rtol * |reactions of the constrained dofs| + what is round-off."""

    def __init__(self, problem: Problem):
        self.problem = problem
        settings = problem.scene.solver
        self.rtol = self._tolerance = min(settings.rtol, INEXACT if settings.linear == "iterative" else 1.0)
        self.max_iterations = settings.max_iterations
        self.iterations = 0
        self._reaction, self._largest_reaction = 0.0, _least_reaction(problem)
        self._setting: tuple[float, ...] = ()  # of the last tangent
        self._solved_at = 0.0  # depth of the last solution
        self._residual = self._before = 0.0  # now, and before the last step
        self._least, self._nearest = 0.0, 0  # residual of this solve, and its iteration
        self.failure = ""  # why the last solve did not converge
        self._iterative = Iterative(problem) if settings.linear == "iterative" else None
        self._tangent = self._iterative.tangent if self._iterative else problem.create_tangent()
        self.snes = self._create(symmetric=problem.has_symmetric_tangent)

    @property
    def krylov_iterations(self) -> int | None:
        """Iterations of the linear solver so far; None where systems are factored."""
        return self._iterative.iterations if self._iterative else None

    @property
    def reaction_norm(self) -> float:
        """Euclidean norm of the nodal support reactions at the last residual [force]."""
        return self._reaction

    def _create(self, *, symmetric: bool) -> PETSc.SNES:
        """SNES with the environment's options; what the scene says, and when it has converged, is not theirs."""
        self._has_tangent = False
        snes = PETSc.SNES().create(self.problem.comm)
        snes.setFunction(self._function, self.problem.b.duplicate())
        snes.setJacobian(self._jacobian, self._tangent)
        ksp = snes.getKSP()
        if self._iterative:  # before options are read: PETSc would look for a preconditioner of this matrix
            self._iterative.attach(ksp)
        else:
            by_factors(ksp, "cholesky" if symmetric else "lu")
        with defaults({"snes_linesearch_type": line_search(self.problem)}):
            snes.setFromOptions()
        # stol = 0: a short step is no sign of an equilibrium, and PETSc accepts one after a line search that failed
        snes.setTolerances(stol=0.0, max_it=self.max_iterations)
        snes.setConvergenceTest(self._converged)
        self._halved = symmetric and ksp.getPC().getType() == "cholesky"
        return snes

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        problem = self.problem
        problem.body.set_solution(x)
        problem.assemble_residual(problem.b)
        values = problem.b.array
        self._reaction = _norm(problem.comm, values[problem.body.supports])
        values[problem.body.constrained] = 0.0  # the constrained dofs are zero and stay zero
        self._before, self._residual = self._residual, _norm(problem.comm, values * problem.row_weights)
        problem.b.copy(f)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        if not self._keeps_tangent():
            self._assemble(P, self._forcing() if self._iterative else 0.0)

    def _keeps_tangent(self) -> bool:
        """Whether the last tangent, with its factor, will do: as long as it leads on quickly."""
        if not (self._has_tangent and self.problem.keeps_tangent and self._setting == self.problem.setting):
            return False
        return self.snes.getIterationNumber() == 0 or self._residual <= KEPT_REDUCTION * self._before

    def _assemble(self, tangent: PETSc.Mat, rtol: float) -> None:
        """The tangent at the present solution; `rtol` of its systems where they are solved by iterations."""
        self._has_tangent, self._setting = True, self.problem.setting
        if self._iterative:
            self._iterative.assemble(rtol)
        else:
            self.problem.assemble_tangent(tangent)

    def _forcing(self) -> float:
        """The reduction asked of an inexact step: Newton's own, by the last (Eisenstat & Walker 1996, choice 2)."""
        enough = 0.3 * (self._tolerance * self._reaction + REACTION_ROUNDOFF * self._largest_reaction) / self._residual
        expected = (self._residual / self._before) ** 2 if self._before else 1.0
        return max(min(INEXACT_REDUCTION, expected), enough)

    def _converged(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        residual = self._residual
        reasons = PETSc.SNES.ConvergedReason
        if not np.isfinite([residual, self._reaction]).all():
            return compat.SNES_RESIDUAL_NOT_FINITE
        begins = self.problem.flows and iteration == 0  # what many steps leave of the fluid's balance would add up
        if not begins and residual <= self._tolerance * self._reaction + REACTION_ROUNDOFF * self._largest_reaction:
            return CONVERGED
        if iteration <= 1 or residual < self._least / 2:  # the first step may go up
            self._least, self._nearest = residual, iteration
        return reasons.ITERATING if iteration < self._nearest + STAGNANT else reasons.DIVERGED_MAX_IT

    def solve(self, rtol: float = 0.0, most: int | None = None) -> bool:
        """Find the equilibrium at the problem's delta from its current solution; True when done.

        Full steps first: at the kinks of contact a line search stalls where they get through. If they do not, through
        softer contact to the law's own. `rtol`: a relative residual that will do, where its own is finer; `most`: fewer
        iterations than its own. On failure the solution is left as it was before."""
        self.snes.setTolerances(max_it=min(most or self.max_iterations, self.max_iterations))
        solved = self._solve(rtol) or self._solve_from_softer_contact()
        PETSc.garbage_cleanup(self.problem.x.comm)  # or vectors that Python let go of stay, also on one rank
        if solved:
            self._solved_at = self.problem.depth
        return solved

    def approach(self, between: Callable[[], object] = lambda: None) -> bool:
        """Come near the equilibrium of a stiff contact through softer ones, each found roughly; True when there. Fewer
        iterations than at once: a contact that is 100 E*/h_contact stiff is sought point by point. `between` is called
        after each. On failure the solution is left as it was before."""
        problem, start, found = self.problem, self.problem.x.copy(), True
        is_close = abs(problem.depth - self._solved_at) <= 0.01 * abs(
            problem.depth
        )  # which leaves the contact as it is
        for factor in [] if is_close else stages(problem.law, problem.scene):
            problem.soften(factor)
            found = self._solve(0.1)  # a rough residual will do before the contact becomes stiffer
            if not found:
                problem.body.set_solution(start)
                break
            between()
        problem.soften(1.0)
        return found

    def _solve(self, rtol: float = 0.0) -> bool:
        self._tolerance, self._residual = max(self.rtol, rtol), 0.0
        start = self.problem.x.copy()
        self.problem.begin_solve()
        guess = self.problem.x.copy()
        if not self._runs(guess):
            self.problem.body.set_solution(start)
            self.failure = LINEAR_SOLVER_FAILED
            return False
        self.iterations += self.snes.getLinearSolveIterations() or self.snes.getIterationNumber()
        reason = self.snes.getConvergedReason()
        if self._halved and reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
            self.problem.body.set_solution(start)
            self.snes = self._create(symmetric=False)  # L U pivots more freely: from here on that
            return self._solve(rtol)
        # the last residual that SNES asked for: where it is no number there is no equilibrium, whatever SNES says
        converged = reason == CONVERGED and np.isfinite(self._residual)
        self.failure = "" if converged else self._why_not()
        self.problem.body.set_solution(guess if converged else start)
        return converged

    def accept(self) -> None:
        """Take the present equilibrium as one that the body went through: its reactions measure
        round-off from now on.

        One that was only tried may be of any size, as that of a closed body full of fluid before
        the tip lets it out.
        """
        self._largest_reaction = max(self._largest_reaction, self._reaction)

    def _runs(self, guess: PETSc.Vec) -> bool:
        """Let SNES go to its end; False where the factorisation itself breaks down, as it may on a wild iterate."""
        try:
            self.snes.solve(None, guess)
        except PETSc.Error as error:
            if error.ierr != 76:  # PETSC_ERR_LIB: what MUMPS could not do
                raise
            self.snes = self._create(symmetric=False)  # the old one keeps what is left of the factors
            return False
        return True

    def _solve_from_softer_contact(self) -> bool:
        """A stiffness that is too much for Newton is within reach from the solution for a tenth of it, and so on."""
        problem, failure = self.problem, self.failure
        reason, reasons = self.snes.getConvergedReason(), PETSc.SNES.ConvergedReason
        unit = problem.scene.physics.material.E_star / problem.scene.sizes.h_contact
        is_thrown_out = reason == compat.SNES_RESIDUAL_NOT_FINITE and stiffness_scale(problem.scene) > STIFF * unit
        is_stuck = reason in (reasons.DIVERGED_MAX_IT, reasons.DIVERGED_LINE_SEARCH)
        if problem.law.may_snap or not (is_stuck or is_thrown_out):
            return False  # where a tip snaps in or lets go, no softer contact leads to the other state
        start, factors = problem.x.copy(), softening(problem.law, problem.scene)
        for factor in factors:
            problem.soften(factor)
            if not self._solve():
                break
        else:
            return bool(factors)
        problem.soften(1.0)
        problem.body.set_solution(start)
        self.failure = failure
        return False

    @property
    def is_stable(self) -> bool:
        """Whether the equilibrium just found is a minimum, by the last L D L^T; True where none was made (collective).
        Then it has one negative pivot for each free dof of the fields beside the displacement."""
        if not self._halved or not self.snes.getIterationNumber():
            return True
        unknowns, held = self.problem.unknowns, self.problem.body.constrained
        own = np.concatenate([unknowns.places(name) for name in unknowns.names[1:]])
        beside = self.problem.comm.allreduce(len(np.setdiff1d(own[own < unknowns.owned], held)))
        return bool(self.snes.getKSP().getPC().getFactorMatrix().getMumpsInfog(12) == beside)

    def stiffness(self) -> float:
        """dF/ddelta [force/length] of the equilibrium just found, NaN where its factor does not tell (collective). The
        way w of the solution per depth, by the last tangent and what its residual r then leaves; an assembly of the
        residual each, no new tangent. Where the tangent is symmetric, r is worth w . r of force, up to its square."""
        problem = self.problem
        if problem.law.multiplier == "frozen":  # its multiplier moves in the loop outside
            return nan
        if not self._has_tangent:  # a state taken up again needed no iteration
            self._assemble(self._tangent, SETTLED_SYMMETRIC)
        self.snes.getKSP().setOperators(self._tangent, self._tangent)
        start, depth, force = problem.x.copy(), problem.depth, problem.force()
        step, settled, first, way = PROBE * max(abs(depth), problem.law.reach), False, 0.0, problem.x.duplicate()
        share = SETTLED_SYMMETRIC if problem.has_symmetric_tangent else SETTLED
        copies = problem.scene.physics.part.copies if problem.has_symmetric_tangent else 0
        way.set(0.0)
        begin, left, correction = (problem.b.duplicate() for _ in range(3))
        try:
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
        finally:  # also for who goes on without a stiffness
            problem.delta.value = depth
            problem.body.set_solution(start)
        return found if settled else nan

    def _tells(self, left: PETSc.Vec, step: float, found: float) -> bool:
        """Whether a residual leaves a stiffness as it is, by its energy: a stiff contact hides the body in its norm."""
        assert self._iterative
        wrong = self.problem.scene.physics.part.copies * self._iterative.energy(left) / step**2
        enough = DERIVATIVE_TOLERANCE * abs(found)
        if wrong > enough:
            self._iterative.rtol = max(0.3 * (enough / wrong) ** 0.5, 1e-8)  # the next system begins where this ends
        return wrong <= enough

    def _why_not(self) -> str:
        reasons, reason = PETSc.SNES.ConvergedReason, self.snes.getConvergedReason()
        if self._iterative and self._iterative.failed:
            return f"a linear system was not solved within {MOST_KRYLOV_ITERATIONS} iterations"
        if not np.isfinite(self._residual):
            return "the residual is not a number"
        return {
            reasons.DIVERGED_LINEAR_SOLVE: LINEAR_SOLVER_FAILED,
            reasons.DIVERGED_MAX_IT: f"no equilibrium within {self.snes.getIterationNumber()} iterations",
            compat.SNES_RESIDUAL_NOT_FINITE: "the residual is not a number",
            reasons.DIVERGED_LINE_SEARCH: "no part of Newton's step comes nearer",
        }.get(reason, f"SNES reason {reason}")


def _least_reaction(problem: Problem) -> float:
    """What counts as the largest reaction before there was one [force]; more than nothing only where fluid flows."""
    physics = problem.scene.physics
    E = max(region.material.constants.E for region in physics.part.regions)
    a = problem.scene.plan.prediction["a"] / physics.scales.length
    size = physics.part.height if physics.swells else min(a, physics.part.height)
    return FLUID_REACTION * E * size ** (physics.body.dim - 1) if problem.flows else 0.0


def finest(problem: Problem) -> float:
    """The smallest relative residual that is not noise."""
    return max(FINE_TOLERANCE, RESIDUAL_NOISE * stiffness_scale(problem.scene))


def line_search(problem: Problem) -> str:
    """PETSc's line search: none, but for a penalty with Coulomb's law. There t goes from one bound to the other over a
    slip of 2 friction p/epsilon_t. Where a point turns back full steps leap over that and back again, for ever; a step
    that does not lessen the residual is shortened."""
    leaps = problem.law.multiplier == "none" and problem.law.slips
    return "bt" if leaps else "basic"


def stages(law: Any, scene: Scene) -> list[float]:
    """Factors for the stiffness of a contact law, by half decades from FIRST_STIFFNESS to below 1; none if soft."""
    excess = law.stiffness * scene.sizes.h_contact / scene.physics.material.E_star / FIRST_STIFFNESS
    steps = max(1, round(2 * log10(excess))) if excess > 1 else 0
    return [excess ** (k / steps - 1) for k in range(steps)]


def softening(law: ContactLaw, scene: Scene) -> list[float]:
    """Factors for the stiffness of a contact law, by decades from a soft contact to its own; none if it has none."""
    stiffness = getattr(law, "stiffness", None)
    if stiffness is None:
        return []
    soft = SOFT * scene.physics.material.E_star / scene.sizes.h_contact
    decades = max(1, ceil(log10(stiffness / soft) - 1e-9))  # a rounding is no decade
    return [10.0**-k for k in range(decades, -1, -1)]


def _norm(comm: MPI.Comm, values: np.ndarray) -> float:
    return float(np.sqrt(comm.allreduce(float(values @ values))))
