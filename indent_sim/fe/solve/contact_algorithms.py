"""The contact algorithms: how each method finds the equilibrium at one depth.

A method is one function from a Newton solver and the tip's terms to success; what they share is
`Newton` and the terms of `Problem`. Adding one is a function and an entry in ALGORITHMS. Where they
find nothing a body that adheres comes to rest.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from indent_sim.fe.problem import Problem
from indent_sim.fe.solve import uzawa
from indent_sim.fe.solve.newton import Newton, approach_factors, finest_tolerance
from indent_sim.fe.solve.slip_reference import FrictionalSurface, solve_with_slip_reference
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.contact.viscous_regularization import ViscousRegularization
from indent_sim.fe.terms.scene_terms import ContactTerms
from indent_sim.fe.terms.surface_tension import MEMBRANE_STIFFNESS

# Times Newton's tolerance: so well is the first pass of a step found, which says where new contact
# sticks. The force feels a few hundredths of what it is off, and Newton's last step leaves less
# than asked. At most LOOSEST_TOLERANCE.
FIRST_PASS_FACTOR = 1e3
FIRST_PASS_TOLERANCE = 1e-6
# Firmness of a drop (`terms.surface_tension`) from which its equilibria are followed to its own,
# the first ratio of one to the next, and the ratio beyond which they are given up: decades were
# enough but for one row in ten
FIRST_MEMBRANE_STIFFNESS = 1.0
MEMBRANE_RATIO = 0.1
LARGEST_MEMBRANE_RATIO = 0.8
# Of a body that comes to rest:
# drag, of work/range^2; at least, and at most, of the step before
FIRST_DRAG = 2.0
DRAG_DECREASE = 0.5
DRAG_INCREASE = 3.0
# times the curvature by which a body runs away: the step has its minimum nearby, for the next one
# has more
DRAG_SAFETY_FACTOR = 3.0
# found or not, and of one; snaps took 15 to 40 steps of 1 to 8 iterations
MOST_RELAXATION_STEPS = 60
MOST_STEP_ITERATIONS = 12


def _newton_with_continuation(newton: Newton, contact: ContactTerms) -> Callable[[], bool]:
    """Penalty, augmented Lagrangian: one Newton, through softer contacts to a stiff one, or at once
    if they mislead.
    """
    if newton.problem.law.may_snap_through and not approach_factors(
        newton.problem.law, newton.problem.scene
    ):
        return newton.solve

    softer_first = _restore_on_failure(
        newton.problem, lambda: newton.approach_stiff_contact() and newton.solve()
    )
    return lambda: softer_first() or newton.solve()


def contact_algorithm(newton: Newton, contact: ContactTerms) -> Callable[[], bool]:
    """The algorithm of a scene's tip, from success to success."""
    algorithm = ALGORITHMS[newton.problem.law.multiplier](newton, contact)
    if newton.problem.has_membrane:
        algorithm = membrane_continuation(newton, algorithm)
    return (
        algorithm
        if newton.problem.law.is_conservative
        else _friction_passes(newton, contact.friction, algorithm)
    )


def membrane_continuation(newton: Newton, algorithm: Callable[[], bool]) -> Callable[[], bool]:
    """An algorithm for a drop that, where it finds nothing at once, finds the equilibrium of a firm
    body first and then of ever softer ones, each from the one before: what Newton cannot do over
    a depth it does over a modulus.

    Measured on a ball between plates of gamma/(mu R) = 1000: 30 iterations for a row that took 170
    to 450 in 9 to 33 shorter and shorter steps of the depth.
    """
    problem = newton.problem

    def from_firm_to_soft() -> bool:
        stiffness = FIRST_MEMBRANE_STIFFNESS
        ratio = MEMBRANE_RATIO
        problem.set_membrane_stiffness(stiffness)
        if not (algorithm() and problem.is_admissible()):
            return False
        while stiffness > MEMBRANE_STIFFNESS:
            last_state = problem.trial_state()
            lower_stiffness = max(MEMBRANE_STIFFNESS, ratio * stiffness)
            problem.set_membrane_stiffness(lower_stiffness)
            if algorithm() and problem.is_admissible():
                stiffness = lower_stiffness
                continue
            problem.set_trial_state(last_state)
            ratio = ratio**0.5
            if ratio > LARGEST_MEMBRANE_RATIO:
                return False
        return True

    def find() -> bool:
        state_before = problem.trial_state()
        if algorithm() and problem.is_admissible():
            return True
        problem.set_trial_state(state_before)
        if from_firm_to_soft():
            return True
        problem.set_membrane_stiffness(MEMBRANE_STIFFNESS)
        problem.set_trial_state(state_before)
        return False

    return find


def _friction_passes(
    newton: Newton, friction: FrictionalSurface | None, algorithm: Callable[[], bool]
) -> Callable[[], bool]:
    """The algorithm in as many passes as the anchor of new contact takes."""
    problem = newton.problem
    tolerance_factor = (
        1.0 if problem.scene.physics.path.control == "force" else FIRST_PASS_FACTOR
    )  # forces are found by their differences

    def find() -> bool:
        exact_rtol = newton.rtol
        newton.rtol = max(exact_rtol, min(tolerance_factor * exact_rtol, FIRST_PASS_TOLERANCE))
        is_found = algorithm()
        newton.rtol = exact_rtol
        return is_found

    return _restore_on_failure(
        problem,
        lambda: solve_with_slip_reference(
            friction, problem.scene.physics.slip_reference, algorithm, find
        ),
    )


def _restore_on_failure(problem: Problem, algorithm: Callable[[], bool]) -> Callable[[], bool]:
    """An algorithm that leaves the problem as it was where it fails."""

    def solve() -> bool:
        state_before = problem.trial_state()
        if algorithm():
            return True
        problem.set_trial_state(state_before)
        return False

    return solve


def _uzawa_algorithm(newton: Newton, contact: ContactTerms) -> Callable[[], bool]:
    """Newton with lam held, in Uzawa's loop; on the way to its own stiffness lam is updated too."""
    problem = newton.problem
    traction = contact.pressure
    assert isinstance(traction, Traction)
    newton.rtol = min(newton.rtol, finest_tolerance(problem))
    update = traction.projection.update_multiplier
    approach_stiff_contact = _restore_on_failure(
        problem, lambda: newton.approach_stiff_contact(update)
    )

    def settle() -> bool:
        approach_stiff_contact()
        return uzawa.iterate(newton, problem.scene, problem.comm, newton.solve, update)

    return _restore_on_failure(problem, settle)


ALGORITHMS: dict[str, Callable[[Newton, ContactTerms], Callable[[], bool]]] = {
    "none": _newton_with_continuation,
    "unknown": _newton_with_continuation,
    "stress": lambda newton, touch: newton.solve,
    "frozen": _uzawa_algorithm,
    "nodal": lambda newton, touch: newton.solve,
}


def dynamic_relaxation(newton: Newton, regularization: ViscousRegularization) -> bool:
    """Let go of a body that adheres at the problem's delta; False where it finds no rest, and its
    state is as it was.

    Its surface moves against a drag, by implicit steps

        u_k+1 = the minimum next to u_k of  Pi(u; delta) + drag/2 int |u - u_k|^2 dGamma .

    The energy falls in each, as it does after a snap: they lead to the stable state in whose valley
    the body was. The drag begins above the curvature work/range^2 of an attraction, where a step
    has one minimum. A step leaves the traction drag x way to the next: how the way answers says
    with which curvature the body runs away, below zero on the way to its rest. There the drag is
    left out as soon as the body is stiffer.
    """
    problem = newton.problem
    law = newton.problem.law.adhesion
    assert law and law.range
    state_before = problem.trial_state()
    drag = FIRST_DRAG * law.work / law.range**2
    traction = 0.0
    for _ in range(MOST_RELAXATION_STEPS):
        distance = _relaxation_step(
            newton, regularization, drag, 1e-4
        )  # relative residual: on the way
        if distance is None:
            drag = DRAG_INCREASE * drag
            traction = 0.0
            continue
        unstable_curvature = drag - traction / distance if traction and distance else 0.0
        if (
            -unstable_curvature > drag
            and _relaxation_step(newton, regularization, 0.0, 0.0) is not None
        ):
            return True
        traction = drag * distance
        drag = min(
            max(DRAG_DECREASE * drag, DRAG_SAFETY_FACTOR * unstable_curvature), DRAG_INCREASE * drag
        )
    problem.set_trial_state(state_before)
    return False


def _relaxation_step(
    newton: Newton, regularization: ViscousRegularization, drag: float, rtol: float
) -> float | None:
    """How far the minimum under this drag is [length]; None where none is found, and the solution
    is as it was.
    """
    problem = newton.problem
    start = newton.problem.x.copy()
    regularization.set_drag(drag)
    is_found = newton.solve(rtol, MOST_STEP_ITERATIONS) and newton.is_stable
    regularization.set_drag(0.0)
    if not is_found:
        problem.body.set_solution(start)
        return None
    displacement_dofs = problem.unknowns.dofs("u")
    increment = (problem.x - start).array[
        displacement_dofs[displacement_dofs < problem.unknowns.owned_count]
    ]
    return float(problem.comm.allreduce(np.abs(increment).max(initial=0.0), op=MPI.MAX))
