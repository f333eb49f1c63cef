"""Uzawa's loop: solve with the multiplier held, lam <- projection of <lam - epsilon_n g>, until it
stands still.

The updates are mixed with earlier ones (`Mixing`), which changes their number and not where they
end: at the fixed point lam is the augmented Lagrangian's own, so both methods give the same answer
at equal epsilon_n.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.scene.scene import Scene

UZAWA_TOLERANCE = (
    1e-8  # last change of the multiplier at E*/h_contact, relative; the force is then good to 1e-7
)
BEGIN = 0.1  # relative residual that will do for the first solve
INNER = 1e-2  # of the multiplier's last change: how well the next solve must know the state
LOOPS = 500
DEPTH = 15  # earlier steps that are remembered


class Mixing:
    """Anderson mixing (Walker & Ni 2011): the next x is where a line through the last steps would
    have no change. Vectors are this rank's part; the few numbers that combine them are summed
    over `comm`, so all ranks agree.
    """

    def __init__(self, comm: MPI.Comm):
        self._comm = comm
        self._g: list[np.ndarray] = []
        self._change: list[np.ndarray] = []
        self._smallest = float("inf")

    def __call__(self, x: np.ndarray, g: np.ndarray) -> np.ndarray:
        """The next x, from the present one and its image g = G(x)."""
        change = float(np.sqrt(self._comm.allreduce(float((g - x) @ (g - x)))))
        if change > 1.5 * self._smallest:  # the steps remembered are of another contact
            self._g = []
            self._change = []
            self._smallest = change
        self._smallest = min(self._smallest, change)
        self._g = [*self._g[-DEPTH:], g.copy()]
        self._change = [*self._change[-DEPTH:], g - x]
        if len(self._g) == 1:
            return g
        steps = np.diff(self._change, axis=0)
        normal = self._comm.allreduce(np.column_stack([steps @ steps.T, steps @ self._change[-1]]))
        share = np.linalg.lstsq(normal[:, :-1], normal[:, -1], rcond=1e-14)[0]
        return g - share @ np.diff(self._g, axis=0)


def settle(
    solver: Any,
    scene: Scene,
    comm: MPI.Comm,
    solve: Callable[[float], bool],
    update: Callable[[Mixing], float],
) -> bool:
    """Solve and update in turn until the multiplier settles; False, and the solver's `failure`,
    where it does not. solve: to a relative residual, or as well as it can where that is finer;
    update: how much it changes, relative.
    """
    law = scene.physics.contact
    unit = scene.physics.material.E_star / scene.sizes.h_contact
    # with a soft stiffness small changes do not mean a small gap
    tolerance = UZAWA_TOLERANCE * min(1.0, law.stiffness / unit)  # type: ignore[union-attr]
    smallest = float("inf")
    since = 0
    mixing = Mixing(comm)
    rtol = BEGIN
    for _ in range(LOOPS):
        if not solve(rtol):
            return False
        change = update(mixing)
        if not np.isfinite(change):
            solver.failure = "the multiplier is not a number"
            return False
        if change <= tolerance:
            return solve(0.0)
        solver.failure = (
            f"the multiplier does not settle, it still changes by {change:.1e} of itself"
        )
        rtol = min(BEGIN, INNER * change)
        smallest, since = (change, 0) if change < smallest / 2 else (smallest, since + 1)
        if since > 60:  # loops in which the change must have halved at least once
            return False
    return False
