"""Uzawa's loop: solve with the multiplier held, lam <- projection of <lam - epsilon_n g>, until it stands still.

The updates are mixed with earlier ones (`mixing`), which changes their number and not where they end: at the fixed
point lam is the augmented Lagrangian's own, so both methods give the same answer at equal epsilon_n.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from indent_sim.fe.solve.mixing import Mixing
from indent_sim.scene.scene import Scene

TOLERANCE = 1e-8  # last change of the multiplier at E*/h_contact, relative; the force is then good to 1e-7
BEGIN = 0.1  # relative residual that will do for the first solve
INNER = 1e-2  # of the multiplier's last change: how well the next solve must know the state
LOOPS = 500
PATIENCE = 60  # loops in which the change must have halved at least once


class Solver(Protocol):
    """What solves with the multiplier held."""

    failure: str  # why the last solve did not converge


def settle(
    solver: Solver, scene: Scene, comm: Any, solve: Callable[[float], bool], update: Callable[[Mixing], float]
) -> bool:
    """Solve and update in turn until the multiplier settles; False, and the solver's `failure`, where it does not.

    solve: to a relative residual, or as well as it can where that is finer; update: how much it changes, relative.
    """
    law, unit = scene.physics.contact, scene.physics.material.E_star / scene.sizes.h_contact
    # with a soft stiffness small changes do not mean a small gap
    tolerance = TOLERANCE * min(1.0, law.stiffness / unit)  # type: ignore[union-attr]
    smallest, since, mixing, rtol = float("inf"), 0, Mixing(comm), BEGIN
    for _ in range(LOOPS):
        if not solve(rtol):
            return False
        change = update(mixing)
        if change <= tolerance:
            return solve(0.0)
        solver.failure = f"the multiplier does not settle, it still changes by {change:.1e} of itself"
        rtol = min(BEGIN, INNER * change)
        smallest, since = (change, 0) if change < smallest / 2 else (smallest, since + 1)
        if since > PATIENCE:
            return False
    return False
