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
FIRST_TOLERANCE = 0.1  # relative residual that will do for the first solve
INNER_TOLERANCE = (
    1e-2  # of the multiplier's last change: how well the next solve must know the state
)
MOST_ITERATIONS = 500
MIXING_DEPTH = 15  # earlier steps that are remembered


class Mixing:
    """Anderson mixing (Walker & Ni 2011): the next x is where a line through the last steps would
    have no change. Vectors are this rank's part; the few numbers that combine them are summed
    over `comm`, so all ranks agree.
    """

    def __init__(self, comm: MPI.Comm):
        self._comm = comm
        self._images: list[np.ndarray] = []
        self._changes: list[np.ndarray] = []
        self._smallest_change = float("inf")

    def __call__(self, x: np.ndarray, g: np.ndarray) -> np.ndarray:
        """The next x, from the present one and its image g = G(x)."""
        change = float(np.sqrt(self._comm.allreduce(float((g - x) @ (g - x)))))
        if change > 1.5 * self._smallest_change:  # the steps remembered are of another contact
            self._images = []
            self._changes = []
            self._smallest_change = change
        self._smallest_change = min(self._smallest_change, change)
        self._images = [*self._images[-MIXING_DEPTH:], g.copy()]
        self._changes = [*self._changes[-MIXING_DEPTH:], g - x]
        if len(self._images) == 1:
            return g
        steps = np.diff(self._changes, axis=0)
        normal = self._comm.allreduce(np.column_stack([steps @ steps.T, steps @ self._changes[-1]]))
        coefficients = np.linalg.lstsq(normal[:, :-1], normal[:, -1], rcond=1e-14)[0]
        return g - coefficients @ np.diff(self._images, axis=0)


def iterate(
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
    smallest_change = float("inf")
    stagnant_iterations = 0
    mixing = Mixing(comm)
    rtol = FIRST_TOLERANCE
    for _ in range(MOST_ITERATIONS):
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
        rtol = min(FIRST_TOLERANCE, INNER_TOLERANCE * change)
        smallest_change, stagnant_iterations = (
            (change, 0)
            if change < smallest_change / 2
            else (smallest_change, stagnant_iterations + 1)
        )
        if stagnant_iterations > 60:  # loops in which the change must have halved at least once
            return False
    return False
