"""Acceleration of a fixed-point iteration x <- G(x) that leaves its fixed point where it is."""

from __future__ import annotations

from typing import Any

import numpy as np

DEPTH = 15  # earlier steps that are remembered
RESTART = 1.5  # times the smallest change so far: a larger one says that the steps remembered are of another contact


class Mixing:
    """Anderson mixing (Walker & Ni 2011): the next x is where a line through the last steps would have no change.

    Vectors are this rank's part; the few numbers that combine them are summed over `comm`, so all ranks agree.
    """

    def __init__(self, comm: Any):
        self._comm = comm
        self._g: list[np.ndarray] = []
        self._change: list[np.ndarray] = []
        self._smallest = float("inf")

    def __call__(self, x: np.ndarray, g: np.ndarray) -> np.ndarray:
        """The next x, from the present one and its image g = G(x)."""
        change = float(np.sqrt(self._comm.allreduce(float((g - x) @ (g - x)))))
        if change > RESTART * self._smallest:
            self._g, self._change, self._smallest = [], [], change
        self._smallest = min(self._smallest, change)
        self._g, self._change = [*self._g[-DEPTH:], g.copy()], [*self._change[-DEPTH:], g - x]
        if len(self._g) == 1:
            return g
        steps = np.diff(self._change, axis=0)
        normal = self._comm.allreduce(np.column_stack([steps @ steps.T, steps @ self._change[-1]]))
        share = np.linalg.lstsq(normal[:, :-1], normal[:, -1], rcond=1e-14)[0]
        return g - share @ np.diff(self._g, axis=0)
