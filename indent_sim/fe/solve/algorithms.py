"""The contact algorithms: how each method finds the equilibrium at one depth.

A method is one function from a Newton solver to success; what they share is `Newton` and the terms of `Problem`.
Adding one is a function and an entry in ALGORITHMS.
"""

from __future__ import annotations

from collections.abc import Callable

from indent_sim.fe.solve import uzawa
from indent_sim.fe.solve.anchor import anchored
from indent_sim.fe.solve.newton import Newton, finest, stages
from indent_sim.fe.terms.traction import Traction

# Times Newton's tolerance: so well is the first pass of a step found, which says where new contact sticks. The force
# feels a few hundredths of what it is off, and Newton's last step leaves less than it is asked to. At most ROUGH.
LOOSELY, ROUGH = 1e3, 1e-6


def _approaching(newton: Newton) -> Callable[[], bool]:
    """Penalty, augmented Lagrangian: one semismooth Newton, which comes to a stiff contact through softer ones.

    Or at once where those mislead. A second try without them would be the first: of a tip that adheres many fail.
    """
    if newton.problem.law.adhesion and not stages(newton.problem.law, newton.problem.scene):
        return newton.solve

    def solve() -> bool:
        before = newton.problem.snapshot()
        if newton.approach() and newton.solve():
            return True
        newton.problem.restore(before)
        return newton.solve()

    return solve


def with_friction(newton: Newton, algorithm: Callable[[], bool]) -> Callable[[], bool]:
    """The algorithm with what friction remembers; itself where there is none."""
    problem, friction = newton.problem, newton.problem.friction
    if friction is None:
        return algorithm

    loosely = 1.0 if problem.scene.physics.path.control == "force" else LOOSELY  # forces are found by their differences

    def find() -> bool:
        exact = newton.rtol
        newton.rtol = max(exact, min(loosely * exact, ROUGH))
        found = algorithm()
        newton.rtol = exact
        return found

    def solve() -> bool:
        before = problem.snapshot()
        if anchored(friction, problem.scene.physics.anchor, algorithm, find):
            return True
        problem.restore(before)
        return False

    return solve


def _uzawa(newton: Newton) -> Callable[[], bool]:
    """Newton with lam held, in Uzawa's loop; on the way to its own stiffness lam is updated too."""
    problem, contact = newton.problem, newton.problem.contact
    assert isinstance(contact, Traction)
    newton.rtol = min(newton.rtol, finest(problem))

    def solve() -> bool:
        before = problem.snapshot()
        if not newton.approach(contact.projection.update):
            problem.restore(before)
        if uzawa.settle(newton, problem.scene, problem.comm, newton.solve, contact.projection.update):
            return True
        problem.restore(before)
        return False

    return solve


ALGORITHMS: dict[str, Callable[[Newton], Callable[[], bool]]] = {
    "none": _approaching,
    "unknown": _approaching,
    "stress": lambda newton: newton.solve,
    "frozen": _uzawa,
    "nodal": lambda newton: newton.solve,
}
