"""Uzawa iteration: solve with a frozen multiplier and update it until it converges.

The update is lam <- projection of <lam - epsilon_n g>. The iteration is accelerated by Anderson
mixing (`Mixing`), which changes the number of iterations but not the result. At convergence lam is
the multiplier of the augmented Lagrangian method, so that both methods give the same result at
equal epsilon_n.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.scene.scene import Scene

MAX_ITERATIONS = 500


class Mixing:
    """Anderson mixing: acceleration of a fixed-point iteration x <- G(x) (Walker & Ni 2011).

    The next x is the combination of the last iterates for which a linear prediction of G(x) - x is
    smallest. Vectors are this rank's parts; inner products are summed over `comm`.
    """

    def __init__(self, comm: MPI.Comm):
        self._comm = comm
        self._images: list[np.ndarray] = []
        self._changes: list[np.ndarray] = []
        self._smallest_change = float("inf")

    def __call__(self, x: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return the next x from the present x and its image g = G(x)."""
        change = float(np.sqrt(self._comm.allreduce(float((g - x) @ (g - x)))))
        if change > 1.5 * self._smallest_change:
            # The contact has changed, and the earlier iterates are no longer of use
            self._images = []
            self._changes = []
            self._smallest_change = change
        self._smallest_change = min(self._smallest_change, change)
        # Number of earlier iterates that are used.
        mixing_depth = 15
        self._images = [*self._images[-mixing_depth:], g.copy()]
        self._changes = [*self._changes[-mixing_depth:], g - x]
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
    """Alternate solution and multiplier update until the multiplier converges.

    Parameters
    ----------
    solver
        Object whose attribute `failure` is set if the iteration fails.
    scene, comm
        The scene, and the ranks that share the multiplier.
    solve
        Function that solves to the given relative residual, or to the solver's tolerance if larger.
    update
        Function that updates the multiplier and returns its relative change.

    Returns
    -------
    bool
        True if the multiplier converged.
    """
    law = scene.physics.contact
    unit = scene.physics.material.E_star / scene.sizes.h_contact
    # The force has a relative error of 1e-7 if the stiffness is E*/h_contact. A small change of the
    # multiplier does not mean a small gap if the stiffness is small.
    tolerance = 1e-8 * min(1.0, law.stiffness / unit)  # type: ignore[union-attr]
    smallest_change = float("inf")
    stagnant_iterations = 0
    mixing = Mixing(comm)
    # Relative residual of the first solve, and of all others at most.
    first_tolerance = 0.1
    rtol = first_tolerance
    for _ in range(MAX_ITERATIONS):
        if not solve(rtol):
            return False
        change = update(mixing)
        if not np.isfinite(change):
            solver.failure = "the multiplier is not a number"
            return False
        if change <= tolerance:
            return solve(0.0)
        solver.failure = (
            f"the multiplier does not converge; its last relative change is {change:.1e}"
        )
        # The next solve must be much more accurate than the change of the multiplier
        rtol = min(first_tolerance, 1e-2 * change)
        if change < smallest_change / 2:
            smallest_change = change
            stagnant_iterations = 0
        else:
            stagnant_iterations += 1
        if stagnant_iterations > 60:  # within this many iterations the change must have been halved
            return False
    return False
