"""Newton's method for one equilibrium, by PETSc's SNES.

The solver is created once per run and reused for every equilibrium. The tangent is that of a
semismooth Newton method (Alart & Curnier 1991): the active points of the contact may change in each
iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.blocks import use_direct_solver
from indent_sim.fe.solve.iterative import INEXACT_REDUCTION, MAX_KRYLOV_ITERATIONS, Iterative
from indent_sim.fe.solve.petsc_options import default_options
from indent_sim.fe.solve.stiffness_continuation import approach_factors, stiffness_continuation
from indent_sim.fe.terms.contact.multiplier import stiffness_scale

LINEAR_SOLVER_FAILED = "the linear solver failed"
# Reason that `Newton._test_convergence` returns, and the only one that is accepted: SNES has
# others, such as a short step, which say nothing about the residual.
CONVERGED = PETSc.SNES.ConvergedReason.CONVERGED_FNORM_RELATIVE
# Round-off in the residual, relative to the largest reaction of any accepted equilibrium
REACTION_ROUNDOFF = 1e-14
# The same of a body that yields: its residual stress remains where no tip presses, so that the
# round-off of its stress is larger than that of its reactions
RESIDUAL_STRESS_ROUNDOFF = 1e-12
# Residual, relative to the reactions, above which the tangent limits the pressure times the tip's
# curvature (`Traction.tangent`). Below it Newton's method converges quadratically with the full
# tangent.
FAR_FROM_EQUILIBRIUM = 1e-2


class Newton:
    """Semismooth Newton method for a `Problem`.

    The residual is compared with the reactions of the supports:

        |residual of the free dofs| <= rtol |reactions of the constrained dofs| + round-off .
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        settings = problem.scene.solver
        # An iterative linear solver ends as soon as Newton's tolerance is met, while a direct one
        # leaves residuals far below it. A smaller tolerance gives both the same accuracy.
        largest_rtol = 1e-10 if settings.linear == "iterative" else 1.0
        self.rtol = self._tolerance = min(settings.rtol, largest_rtol)
        self.max_iterations = settings.max_iterations
        self.iterations = 0
        self._reaction = 0.0
        self._largest_reaction = _reaction_floor(problem)
        self._roundoff = (
            RESIDUAL_STRESS_ROUNDOFF if problem.scene.physics.yields else REACTION_ROUNDOFF
        )
        self._tangent_parameters: tuple[float, ...] = ()  # parameters of the last tangent
        self._last_solved_depth = 0.0
        self._residual = 0.0
        self._previous_residual = 0.0  # one Newton step earlier
        # Smallest residual of the present solve, and the iteration that reached it
        self._smallest_residual = 0.0
        self._smallest_residual_iteration = 0
        self.failure = ""  # why the last solve did not converge
        self._iterative = Iterative(problem) if settings.linear == "iterative" else None
        self._tangent = self._iterative.tangent if self._iterative else problem.create_tangent()
        self.snes = self._create_snes(symmetric=problem.has_symmetric_tangent)

    @property
    def krylov_iterations(self) -> int | None:
        """Number of Krylov iterations so far; None with a direct solver."""
        return self._iterative.iterations if self._iterative else None

    @property
    def has_diverged(self) -> bool:
        """True if the last residual was not finite."""
        return not bool(np.isfinite([self._residual, self._reaction]).all())

    @property
    def reaction_norm(self) -> float:
        """Euclidean norm of the nodal support reactions at the last residual [force]."""
        return self._reaction

    def _create_snes(self, *, symmetric: bool) -> PETSc.SNES:
        """Create the SNES solver with the options of PETSC_OPTIONS.

        The tolerances and the convergence test are the scene's and cannot be changed by these
        options.
        """
        self._has_tangent = False
        snes = PETSc.SNES().create(self.problem.comm)
        snes.setFunction(self._evaluate_residual, self.problem.b.duplicate())
        snes.setJacobian(self._evaluate_tangent, self._tangent)
        ksp = snes.getKSP()
        if self._iterative:
            # Attached before the options are read, since PETSc would otherwise look for a
            # preconditioner of this matrix
            self._iterative.attach(ksp)
        else:
            use_direct_solver(ksp, "cholesky" if symmetric else "lu")
        # Since PETSc 3.24 "l2" ends where the squared residual changes by less than an absolute
        # tolerance, which no residual in nondimensional units exceeds: its steps would all be full.
        line_search_options = {
            "snes_linesearch_type": line_search(self.problem),
            "snes_linesearch_atol": 0.0,
        }
        with default_options(line_search_options):
            snes.setFromOptions()
        # stol = 0: a short step does not indicate an equilibrium, and PETSc would accept one after
        # a failed line search.
        snes.setTolerances(stol=0.0, max_it=self.max_iterations)
        snes.setConvergenceTest(self._test_convergence)
        self._uses_cholesky = symmetric and ksp.getPC().getType() == "cholesky"
        return snes

    def _evaluate_residual(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        problem = self.problem
        problem.body.set_solution(x)
        problem.assemble_residual(problem.b)
        values = problem.b.array
        self._reaction = _norm(problem.comm, values[problem.body.support_dofs])
        values[problem.body.constrained_dofs] = 0.0  # their values are prescribed
        self._previous_residual = self._residual
        self._residual = _norm(problem.comm, values * problem.row_weights)
        problem.b.copy(f)

    def _evaluate_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        if not self._is_tangent_up_to_date():
            self._assemble_tangent(P, self._forcing_term() if self._iterative else 0.0)

    def _is_tangent_up_to_date(self) -> bool:
        """Return whether the last factored tangent can be used once more.

        The last tangent is tried in the first iteration of every solve, and kept as long as it
        reduces the residual quickly enough.
        """
        if not (
            self._has_tangent
            and self.problem.can_reuse_tangent
            and self._tangent_parameters == self.problem.tangent_parameters
        ):
            return False
        # An iteration that leaves more than this fraction of the residual costs more than a new
        # factorisation.
        largest_reduction = 0.05
        return (
            self.snes.getIterationNumber() == 0
            or self._residual <= largest_reduction * self._previous_residual
        )

    def _assemble_tangent(self, tangent: PETSc.Mat, rtol: float) -> None:
        """Assemble the tangent at the present solution; `rtol` is for an iterative solver."""
        self._has_tangent = True
        self._tangent_parameters = self.problem.tangent_parameters
        self.problem.limit_curvature(
            is_limited=self._residual > FAR_FROM_EQUILIBRIUM * self._reaction
        )
        if self._iterative:
            self._iterative.assemble(rtol)
        else:
            self.problem.assemble_tangent(tangent)

    def _forcing_term(self) -> float:
        """Return the relative tolerance of the next linear system.

        The tolerance is adapted to the convergence of Newton's method by "choice 2" of Eisenstat &
        Walker (1996, SIAM J. Sci. Comput. 17).
        """
        sufficient = (
            0.3
            * (self._tolerance * self._reaction + self._roundoff * self._largest_reaction)
            / self._residual
        )
        expected = (
            (self._residual / self._previous_residual) ** 2 if self._previous_residual else 1.0
        )
        return max(min(INEXACT_REDUCTION, expected), sufficient)

    def _test_convergence(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> int:
        residual = self._residual
        reasons = PETSc.SNES.ConvergedReason
        if not np.isfinite([residual, self._reaction]).all():
            return compat.SNES_RESIDUAL_NOT_FINITE
        # With fluid flow, every time step makes at least one iteration: otherwise the residuals of
        # the fluid's mass balance would accumulate over many steps.
        is_first_of_flow = self.problem.has_flow and iteration == 0
        if (
            not is_first_of_flow
            and residual
            <= self._tolerance * self._reaction + self._roundoff * self._largest_reaction
        ):
            return CONVERGED
        # The residual may rise in the first step
        if iteration <= 1 or residual < self._smallest_residual / 2:
            self._smallest_residual = residual
            self._smallest_residual_iteration = iteration
        # After 20 iterations in which the residual was not halved a shorter load increment costs
        # less than waiting, though some of these solves would converge in the end
        if iteration < self._smallest_residual_iteration + 20:
            return reasons.ITERATING
        return reasons.DIVERGED_MAX_IT

    def solve(self, rtol: float = 0.0, max_iterations: int | None = None) -> bool:
        """Find the equilibrium at the problem's depth, starting from its present solution.

        Full Newton steps are tried first, because a line search stalls where the active points of
        the contact change. If they do not converge, the stiffness of the contact is increased in
        steps from a small value. On failure the solution is restored.

        Parameters
        ----------
        rtol
            Relative residual that is sufficient, if it is larger than `self.rtol`.
        max_iterations
            Limit of the iterations, if it is smaller than `self.max_iterations`.

        Returns
        -------
        bool
            True if the method converged.
        """
        self.snes.setTolerances(
            max_it=min(max_iterations or self.max_iterations, self.max_iterations)
        )
        solved = self._solve(rtol) or self._solve_by_continuation()
        # PETSc frees vectors that Python has released only in this call, also on a single rank.
        PETSc.garbage_cleanup(self.problem.x.comm)
        if solved:
            self._last_solved_depth = self.problem.depth
        return solved

    def approach_stiff_contact(self, after_each: Callable[[], object] = lambda: None) -> bool:
        """Approach the equilibrium of a stiff contact by solving softer contacts to a low accuracy.

        This approach needs fewer iterations than a direct solution of the stiff contact: with a
        stiffness of 100 E*/h_contact Newton's method moves the contact edge by one point in each
        iteration. On failure the solution is restored.

        Parameters
        ----------
        after_each
            Function that is called after each of the softer contacts.

        Returns
        -------
        bool
            True if all softer contacts converged.
        """
        problem = self.problem
        start = self.problem.x.copy()
        has_converged = True
        # After so small a change of depth the contact is nearly that of the last solution
        is_close = abs(problem.depth - self._last_solved_depth) <= 0.01 * abs(problem.depth)
        factors = [] if is_close else approach_factors(problem.law, problem.scene)
        for factor in factors:
            problem.set_continuation_factor(factor)
            has_converged = self._solve(0.1)  # a rough solution is a sufficient initial guess
            if not has_converged:
                problem.body.set_solution(start)
                break
            after_each()
        problem.set_continuation_factor(1.0)
        return has_converged

    def _solve(self, rtol: float = 0.0) -> bool:
        self._tolerance = max(self.rtol, rtol)
        self._residual = 0.0
        start = self.problem.x.copy()
        self.problem.begin_solve()
        trial_solution = self.problem.x.copy()
        if not self._run_snes(trial_solution):
            self.problem.body.set_solution(start)
            self.failure = LINEAR_SOLVER_FAILED
            return False
        self.iterations += self.snes.getLinearSolveIterations() or self.snes.getIterationNumber()
        reason = self.snes.getConvergedReason()
        if self._uses_cholesky and reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
            self.problem.body.set_solution(start)
            # LU chooses its pivots more freely than LDL^T; it is kept for the rest of the run
            self.snes = self._create_snes(symmetric=False)
            return self._solve(rtol)
        # SNES may report convergence although the last residual was not finite
        converged = reason == CONVERGED and np.isfinite(self._residual)
        self.failure = "" if converged else self._failure_reason()
        self.problem.body.set_solution(trial_solution if converged else start)
        return converged

    def accept(self) -> None:
        """Accept the present equilibrium, whose reactions from now on define the round-off level.

        Reactions of trial equilibria are not used, because they may be arbitrarily large, such as
        those of a sealed body full of fluid before its surface drains.
        """
        self._largest_reaction = max(self._largest_reaction, self._reaction)

    def _run_snes(self, trial_solution: PETSc.Vec) -> bool:
        """Run SNES; return False if a factorisation fails, as may happen far from equilibrium."""
        try:
            self.snes.solve(None, trial_solution)
        except PETSc.Error as error:
            if error.ierr != 76:  # PETSC_ERR_LIB: an error of MUMPS
                raise
            # The old solver is dropped, since it keeps the unfinished factors
            self.snes = self._create_snes(symmetric=False)
            return False
        return True

    def _solve_by_continuation(self) -> bool:
        """Solve with a soft contact, then increase the stiffness by decades to the nominal one."""
        problem = self.problem
        failure = self.failure
        reason = self.snes.getConvergedReason()
        reasons = PETSc.SNES.ConvergedReason
        unit = problem.scene.physics.material.E_star / problem.scene.sizes.h_contact
        # With a contact stiffness beyond 1e5 E*/h_contact the first Newton step may invert
        # elements, whatever the depth.
        is_overshooting = (
            reason == compat.SNES_RESIDUAL_NOT_FINITE
            and stiffness_scale(problem.scene) > 1e5 * unit
        )
        is_stuck = reason in (reasons.DIVERGED_MAX_IT, reasons.DIVERGED_LINE_SEARCH)
        # A snap of an adhesive tip leads to another branch of equilibria, which softer contacts
        # do not reach
        if problem.law.may_snap_through or not (is_stuck or is_overshooting):
            return False
        start = problem.x.copy()
        # The last of the factors is 1.
        factors = stiffness_continuation(problem.law, problem.scene)
        has_converged = bool(factors)
        for factor in factors:
            problem.set_continuation_factor(factor)
            has_converged = self._solve()
            if not has_converged:
                break
        if has_converged:
            return True
        problem.set_continuation_factor(1.0)
        problem.body.set_solution(start)
        self.failure = failure
        return False

    @property
    def is_stable(self) -> bool:
        """True if the equilibrium just found is a local minimum of the energy (collective).

        The criterion is the inertia of the last LDL^T factor: at a minimum it has exactly one
        negative pivot for each free dof of the fields other than the displacement. The result is
        True if no such factor was computed.
        """
        if not self._uses_cholesky or not self.snes.getIterationNumber():
            return True
        unknowns = self.problem.unknowns
        constrained = self.problem.body.constrained_dofs
        field_dofs = np.concatenate([unknowns.dofs(name) for name in unknowns.names[1:]])
        field_dof_count = self.problem.comm.allreduce(
            len(np.setdiff1d(field_dofs[field_dofs < unknowns.owned_count], constrained))
        )
        return bool(
            self.snes.getKSP().getPC().getFactorMatrix().getMumpsInfog(12) == field_dof_count
        )

    def discard_tangent(self) -> None:
        """Mark the tangent as outdated, so that it is assembled anew before its next use."""
        self._has_tangent = False

    def stiffness(self) -> float:
        """Return dF/ddelta [force/length] of the equilibrium just found (collective).

        The derivative w of the solution with respect to the depth is found by iterative refinement
        with the last tangent: each correction needs one residual at depth + step and no new
        tangent. If the tangent is symmetric, the force is corrected by w . r with the remaining
        residual r, so that the error is of second order in r.

        Returns
        -------
        float
            The stiffness; NaN if the refinement does not converge, and for Uzawa's method, whose
            multiplier changes outside Newton's method.
        """
        problem = self.problem
        if problem.law.multiplier == "frozen":
            return nan
        # Residual at which the iterative correction of dF/ddelta ends, relative to the first one,
        # for a symmetric tangent: the error of the stiffness is then of second order in the
        # residual.
        symmetric_residual = 1e-4
        if not self._has_tangent:  # a resumed state needed no iteration
            self._assemble_tangent(self._tangent, symmetric_residual)
        self.snes.getKSP().setOperators(self._tangent, self._tangent)
        start = problem.x.copy()
        depth = problem.depth
        force = problem.force()
        # Over this change of depth the residual is linear, and its difference still has ten digits.
        step = 1e-6 * max(abs(depth), problem.law.adhesion_range)
        is_converged = False
        first_residual = 0.0
        derivative = problem.x.duplicate()
        tolerance = symmetric_residual if problem.has_symmetric_tangent else 1e-5
        symmetry_factor = (
            problem.scene.physics.domain.symmetry_factor if problem.has_symmetric_tangent else 0
        )
        derivative.set(0.0)
        start_residual, remaining, correction = (problem.b.duplicate() for _ in range(3))
        try:
            self._evaluate_residual(self.snes, start, start_residual)
            problem.delta.value = depth + step
            # An old factor that needs more corrections than this is of no use for the stiffness.
            max_corrections = 6
            for _ in range(max_corrections):
                self._evaluate_residual(self.snes, start + step * derivative, remaining)
                remaining.axpy(-1.0, start_residual)
                stiffness = (
                    problem.force() - force + symmetry_factor * derivative.dot(remaining)
                ) / step
                residual = remaining.norm()
                first_residual = first_residual or residual
                is_converged = (
                    self._is_stiffness_converged(remaining, step, stiffness)
                    if self._iterative
                    else residual <= tolerance * first_residual
                )
                if is_converged or not np.isfinite(residual):
                    break
                self.snes.getKSP().solve(remaining, correction)
                derivative.axpy(-1.0 / step, correction)
        finally:
            # The state is restored even after an error, since the run goes on without a stiffness.
            problem.delta.value = depth
            problem.body.set_solution(start)
        return stiffness if is_converged else nan

    def _is_stiffness_converged(self, remaining: PETSc.Vec, step: float, stiffness: float) -> bool:
        """Return whether the energy of the remaining residual is negligible.

        The norm of the residual would be misleading, because a stiff contact dominates it.
        """
        assert self._iterative
        stiffness_error = (
            self.problem.scene.physics.domain.symmetry_factor
            * self._iterative.residual_energy(remaining)
            / step**2
        )
        allowed_error = 1e-9 * abs(stiffness)
        if stiffness_error > allowed_error:
            # The energy is proportional to the square of the residual
            self._iterative.rtol = max(0.3 * (allowed_error / stiffness_error) ** 0.5, 1e-8)
        return stiffness_error <= allowed_error

    def _failure_reason(self) -> str:
        reasons = PETSc.SNES.ConvergedReason
        reason = self.snes.getConvergedReason()
        if self._iterative and self._iterative.has_failed:
            return (
                f"a linear system was not solved within {MAX_KRYLOV_ITERATIONS} Krylov iterations"
            )
        if not np.isfinite(self._residual):
            return "the residual is not a number"
        return {
            reasons.DIVERGED_LINEAR_SOLVE: LINEAR_SOLVER_FAILED,
            reasons.DIVERGED_MAX_IT: "no equilibrium was found within "
            f"{self.snes.getIterationNumber()} Newton iterations",
            compat.SNES_RESIDUAL_NOT_FINITE: "the residual is not a number",
            reasons.DIVERGED_LINE_SEARCH: "the line search found no smaller residual",
        }.get(reason, f"PETSc's SNES stopped with the reason code {reason}")


def _reaction_floor(problem: Problem) -> float:
    """Return the least reaction [force] to which residuals are compared.

    The result is zero without fluid flow. A body that swells freely has no reactions, so that a
    residual relative to the reactions could not converge. With flow the floor is therefore 100 E
    L^2 (100 E L in two dimensions). L is the height of a body that swells; for a body that only
    drains it is the contact radius or the height, whichever is smaller.
    """
    physics = problem.scene.physics
    E = max(region.material.constants.E for region in physics.domain.regions)
    a = problem.scene.plan.prediction["a"] / physics.scales.length
    length = physics.domain.height if physics.is_swelling else min(a, physics.domain.height)
    return 100.0 * E * length ** (physics.body.dim - 1) if problem.has_flow else 0.0


def finest_tolerance(problem: Problem) -> float:
    """Return the smallest relative residual that is above round-off.

    This tolerance is used where small changes of the state matter: in Uzawa's iteration and in load
    control. The round-off in the gap enters the residual in proportion to the stiffness of the
    contact.
    """
    return max(1e-11, 1e-17 * stiffness_scale(problem.scene))


def line_search(problem: Problem) -> str:
    """Return the name of PETSc's line search: "l2" for a body that yields, "basic" for most others.

    An increment is many yield strains long, so that full Newton steps of a body that yields cycle
    between flow in opposite directions; "l2" chooses the length with the smallest residual.

    With a penalty, the tangential traction goes from the slip limit f p (coefficient of friction f,
    pressure p) to -f p over a slip of 2 f p/epsilon_t. If a point reverses its slip, full Newton
    steps jump back and forth across this range endlessly; "bt" shortens a step that does not reduce
    the residual. "basic" takes full steps.
    """
    if problem.scene.physics.yields:
        return "l2"
    may_oscillate = problem.law.multiplier == "none" and problem.law.may_slip
    return "bt" if may_oscillate else "basic"


def _norm(comm: MPI.Comm, values: np.ndarray) -> float:
    return float(np.sqrt(comm.allreduce(float(values @ values))))
