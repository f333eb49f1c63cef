"""The contact algorithms: how each method finds the equilibrium at one depth.

A method is one function from a Newton solver to success; what they share is `Newton` and the terms of `Problem`.
Adding one is a function and an entry in ALGORITHMS.
"""

from __future__ import annotations

from collections.abc import Callable

from indent_sim.fe.solve.mixing import Mixing
from indent_sim.fe.solve.newton import ROUGHLY, Newton, finest
from indent_sim.fe.terms.traction import Traction
from indent_sim.scene.scene import Scene

UZAWA_TOLERANCE = 1e-8  # last change of the multiplier at E*/h_contact, relative; the force is then good to 1e-7
UZAWA_INNER = 1e-2  # of the multiplier's last change: how well the next solve within the loop must know the state
UZAWA_LOOPS = 500
UZAWA_PATIENCE = 60  # loops in which the change must have halved at least once


def settled(scene: Scene) -> float:
    """The last change of Uzawa's multiplier, relative: with a soft stiffness small changes do not mean a small gap."""
    stiffness = scene.contact.stiffness  # type: ignore[union-attr]
    return UZAWA_TOLERANCE * min(1.0, stiffness * scene.sizes.h_contact / scene.material.E_star)


def _simultaneous(newton: Newton) -> Callable[[], bool]:
    """Nitsche, active set: one semismooth Newton for everything."""
    return newton.solve


def _approaching(newton: Newton) -> Callable[[], bool]:
    """Penalty, augmented Lagrangian: one semismooth Newton, which comes to a stiff contact through softer ones.

    Or at once where those mislead.
    """

    def solve() -> bool:
        before = newton.problem.snapshot()
        if newton.approach() and newton.solve():
            return True
        newton.problem.restore(before)
        return newton.solve()

    return solve


def _uzawa(newton: Newton) -> Callable[[], bool]:
    """Newton with lam frozen, then lam <- projection of <lam - epsilon_n g>, until it stands still.

    On the way to its own stiffness lam is updated too, and a solve need not be finer than what the next update will
    change. The updates are mixed with earlier ones (`mixing`), which changes their number and not where they end:
    at the fixed point lam is the augmented Lagrangian's own, so both methods give the same answer.
    """
    contact = newton.problem.contact
    assert isinstance(contact, Traction)
    projection = contact.projection
    newton.rtol = min(newton.rtol, finest(newton.problem))

    def solve() -> bool:
        problem = newton.problem
        before = problem.snapshot()
        if not newton.approach(projection.update):
            problem.restore(before)
        smallest, since, mixing, rtol = float("inf"), 0, Mixing(problem.comm), ROUGHLY
        for _ in range(UZAWA_LOOPS):
            if not newton.solve(rtol):
                break
            change = projection.update(mixing)
            newton.failure = f"the multiplier does not settle, it still changes by {change:.1e} of itself"
            if change <= settled(problem.scene):
                return newton.solve()
            rtol = max(newton.rtol, min(ROUGHLY, UZAWA_INNER * change))
            smallest, since = (change, 0) if change < smallest / 2 else (smallest, since + 1)
            if since > UZAWA_PATIENCE:
                break
        problem.restore(before)
        return False

    return solve


ALGORITHMS: dict[str, Callable[[Newton], Callable[[], bool]]] = {
    "none": _approaching,
    "unknown": _approaching,
    "stress": _simultaneous,
    "frozen": _uzawa,
    "nodal": _simultaneous,
}
