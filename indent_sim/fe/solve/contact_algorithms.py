"""Contact algorithms: solution of the equilibrium at one depth by each contact method.

A function of the Newton solver and the contact terms creates an algorithm, which returns True if it
converged. To add an algorithm, write such a function and enter it in ALGORITHMS.
"""

from __future__ import annotations

from collections.abc import Callable

from indent_sim.fe.problem import Problem
from indent_sim.fe.solve import uzawa
from indent_sim.fe.solve.membrane_continuation import membrane_continuation
from indent_sim.fe.solve.newton import Newton, finest_tolerance
from indent_sim.fe.solve.slip_reference import FrictionalSurface, solve_with_slip_reference
from indent_sim.fe.solve.stiffness_continuation import approach_factors
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.scene_terms import ContactTerms


def _newton_with_continuation(newton: Newton, contact: ContactTerms) -> Callable[[], bool]:
    """Return Newton's method with stiffness continuation, for penalty and augmented Lagrangian.

    If there is no solution at a reduced stiffness, the contact is solved with its nominal stiffness
    directly. This is not tried if the residual was not finite and only one reduced stiffness is
    used: it is nearly equal to the nominal stiffness, with which the first Newton step would invert
    the same elements.
    """
    factors = approach_factors(newton.problem.law, newton.problem.scene)
    if not factors and (newton.problem.law.may_snap_through or newton.problem.scene.physics.yields):
        return newton.solve

    solve_softer_first = _restore_on_failure(
        newton.problem, lambda: newton.approach_stiff_contact() and newton.solve()
    )

    def solve() -> bool:
        if solve_softer_first():
            return True
        is_hopeless = len(factors) == 1 and newton.has_diverged
        return not is_hopeless and newton.solve()

    return solve


def contact_algorithm(newton: Newton, contact: ContactTerms) -> Callable[[], bool]:
    """Return a function that solves by the contact method and returns True if it converged."""
    algorithm = ALGORITHMS[newton.problem.law.multiplier](newton, contact)
    if newton.problem.has_membrane:
        algorithm = membrane_continuation(newton, algorithm)
    if newton.problem.law.is_conservative:
        return algorithm
    return _friction_passes(newton, contact.friction, algorithm)


def _friction_passes(
    newton: Newton, friction: FrictionalSurface | None, algorithm: Callable[[], bool]
) -> Callable[[], bool]:
    """Return an algorithm that solves a frictional increment in one or two passes.

    The slip reference determines the number of passes. The first of two passes only locates new
    contact points. Only a few per cent of the error of the first pass enter the force, so that the
    tolerance of this pass is 1e3 times the tolerance of Newton's method, at most 1e-6. If the depth
    of a force is searched for, both passes have the tolerance of Newton's method, because the
    search depends on differences of forces.
    """
    problem = newton.problem
    tolerance_factor = 1.0 if problem.scene.physics.path.control == "force" else 1e3

    def solve_loosely() -> bool:
        exact_rtol = newton.rtol
        newton.rtol = max(exact_rtol, min(tolerance_factor * exact_rtol, 1e-6))
        has_converged = algorithm()
        newton.rtol = exact_rtol
        return has_converged

    return _restore_on_failure(
        problem,
        lambda: solve_with_slip_reference(
            friction, problem.scene.physics.slip_reference, algorithm, solve_loosely
        ),
    )


def _restore_on_failure(problem: Problem, algorithm: Callable[[], bool]) -> Callable[[], bool]:
    """Return an algorithm that restores the state of the problem if it fails."""

    def solve() -> bool:
        state_before = problem.trial_state()
        if algorithm():
            return True
        problem.set_trial_state(state_before)
        return False

    return solve


def _uzawa_algorithm(newton: Newton, contact: ContactTerms) -> Callable[[], bool]:
    """Return the iteration of Uzawa: a solution with a frozen multiplier, then a multiplier update.

    The multiplier is also updated after each of the softer contacts of a continuation.
    """
    problem = newton.problem
    traction = contact.pressure
    assert isinstance(traction, Traction)
    newton.rtol = min(newton.rtol, finest_tolerance(problem))
    update = traction.projection.update_multiplier
    approach_stiff_contact = _restore_on_failure(
        problem, lambda: newton.approach_stiff_contact(update)
    )

    def iterate() -> bool:
        approach_stiff_contact()
        return uzawa.iterate(newton, problem.scene, problem.comm, newton.solve, update)

    return _restore_on_failure(problem, iterate)


ALGORITHMS: dict[str, Callable[[Newton, ContactTerms], Callable[[], bool]]] = {
    "none": _newton_with_continuation,
    "unknown": _newton_with_continuation,
    "stress": lambda newton, contact: newton.solve,
    "frozen": _uzawa_algorithm,
    "nodal": lambda newton, contact: newton.solve,
}
