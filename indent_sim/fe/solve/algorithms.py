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
from indent_sim.fe.solve.anchor import Anchored, anchored
from indent_sim.fe.solve.newton import Newton, finest, stages
from indent_sim.fe.terms.contact.drag import Drag
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.scene_terms import Touch
from indent_sim.fe.terms.surface_tension import FIRMNESS

# Times Newton's tolerance: so well is the first pass of a step found, which says where new contact
# sticks. The force feels a few hundredths of what it is off, and Newton's last step leaves less
# than asked. At most LOOSEST_TOLERANCE.
LOOSELY = 1e3
LOOSEST_TOLERANCE = 1e-6
# Firmness of a drop (`terms.surface_tension`) from which its equilibria are followed to its own,
# the first ratio of one to the next, and the ratio beyond which they are given up: decades were
# enough but for one row in ten
FIRM = 1.0
SOFTER = 0.1
LEAST_SOFTER = 0.8
# Of a body that comes to rest:
# drag, of work/range^2; at least, and at most, of the step before
FIRST_DRAG = 2.0
LIGHTER = 0.5
HEAVIER = 3.0
# times the curvature by which a body runs away: the step has its minimum nearby, for the next one
# has more
SAFE = 3.0
# found or not, and of one; snaps took 15 to 40 steps of 1 to 8 iterations
STEPS = 60
MOST_STEP_ITERATIONS = 12


def _approaching(newton: Newton, touch: Touch) -> Callable[[], bool]:
    """Penalty, augmented Lagrangian: one Newton, through softer contacts to a stiff one, or at once
    if they mislead.
    """
    if newton.problem.law.may_snap and not stages(newton.problem.law, newton.problem.scene):
        return newton.solve

    softer_first = _or_as_before(newton.problem, lambda: newton.approach() and newton.solve())
    return lambda: softer_first() or newton.solve()


def algorithm_of(newton: Newton, touch: Touch) -> Callable[[], bool]:
    """The algorithm of a scene's tip, from success to success."""
    algorithm = ALGORITHMS[newton.problem.law.multiplier](newton, touch)
    if newton.problem.can_firm:
        algorithm = through_firmer_bodies(newton, algorithm)
    return (
        algorithm
        if newton.problem.law.is_conservative
        else _with_friction(newton, touch.friction, algorithm)
    )


def through_firmer_bodies(newton: Newton, algorithm: Callable[[], bool]) -> Callable[[], bool]:
    """An algorithm for a drop that, where it finds nothing at once, finds the equilibrium of a firm
    body first and then of ever softer ones, each from the one before: what Newton cannot do over
    a depth it does over a modulus.

    Measured on a ball between plates of gamma/(mu R) = 1000: 30 iterations for a row that took 170
    to 450 in 9 to 33 shorter and shorter steps of the depth.
    """
    problem = newton.problem

    def from_firm_to_soft() -> bool:
        firmness = FIRM
        ratio = SOFTER
        problem.firm(firmness)
        if not (algorithm() and problem.is_admissible()):
            return False
        while firmness > FIRMNESS:
            found = problem.guess()
            softer = max(FIRMNESS, ratio * firmness)
            problem.firm(softer)
            if algorithm() and problem.is_admissible():
                firmness = softer
                continue
            problem.take(found)
            ratio = ratio**0.5
            if ratio > LEAST_SOFTER:
                return False
        return True

    def find() -> bool:
        before = problem.guess()
        if algorithm() and problem.is_admissible():
            return True
        problem.take(before)
        if from_firm_to_soft():
            return True
        problem.firm(FIRMNESS)
        problem.take(before)
        return False

    return find


def _with_friction(
    newton: Newton, friction: Anchored | None, algorithm: Callable[[], bool]
) -> Callable[[], bool]:
    """The algorithm in as many passes as the anchor of new contact takes."""
    problem = newton.problem
    loosely = (
        1.0 if problem.scene.physics.path.control == "force" else LOOSELY
    )  # forces are found by their differences

    def find() -> bool:
        exact = newton.rtol
        newton.rtol = max(exact, min(loosely * exact, LOOSEST_TOLERANCE))
        found = algorithm()
        newton.rtol = exact
        return found

    return _or_as_before(
        problem, lambda: anchored(friction, problem.scene.physics.anchor, algorithm, find)
    )


def _or_as_before(problem: Problem, algorithm: Callable[[], bool]) -> Callable[[], bool]:
    """An algorithm that leaves the problem as it was where it fails."""

    def solve() -> bool:
        before = problem.guess()
        if algorithm():
            return True
        problem.take(before)
        return False

    return solve


def _uzawa(newton: Newton, touch: Touch) -> Callable[[], bool]:
    """Newton with lam held, in Uzawa's loop; on the way to its own stiffness lam is updated too."""
    problem = newton.problem
    contact = touch.pressure
    assert isinstance(contact, Traction)
    newton.rtol = min(newton.rtol, finest(problem))
    update = contact.projection.update
    approach = _or_as_before(problem, lambda: newton.approach(update))

    def settle() -> bool:
        approach()
        return uzawa.settle(newton, problem.scene, problem.comm, newton.solve, update)

    return _or_as_before(problem, settle)


ALGORITHMS: dict[str, Callable[[Newton, Touch], Callable[[], bool]]] = {
    "none": _approaching,
    "unknown": _approaching,
    "stress": lambda newton, touch: newton.solve,
    "frozen": _uzawa,
    "nodal": lambda newton, touch: newton.solve,
}


def come_to_rest(newton: Newton, surface: Drag) -> bool:
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
    before = problem.guess()
    drag = FIRST_DRAG * law.work / law.range**2
    traction = 0.0
    for _ in range(STEPS):
        moved = _step(newton, surface, drag, 1e-4)  # relative residual: on the way
        if moved is None:
            drag = HEAVIER * drag
            traction = 0.0
            continue
        runaway = drag - traction / moved if traction and moved else 0.0
        if -runaway > drag and _step(newton, surface, 0.0, 0.0) is not None:
            return True
        traction = drag * moved
        drag = min(max(LIGHTER * drag, SAFE * runaway), HEAVIER * drag)
    problem.take(before)
    return False


def _step(newton: Newton, surface: Drag, drag: float, rtol: float) -> float | None:
    """How far the minimum under this drag is [length]; None where none is found, and the solution
    is as it was.
    """
    problem = newton.problem
    start = newton.problem.x.copy()
    surface.hold(drag)
    found = newton.solve(rtol, MOST_STEP_ITERATIONS) and newton.is_stable
    surface.hold(0.0)
    if not found:
        problem.body.set_solution(start)
        return None
    places = problem.unknowns.places("u")
    way = (problem.x - start).array[places[places < problem.unknowns.owned]]
    return float(problem.comm.allreduce(np.abs(way).max(initial=0.0), op=MPI.MAX))
