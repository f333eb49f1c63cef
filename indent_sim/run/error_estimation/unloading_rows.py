"""Rows of unloading of two runs, which are at different depths, compared at the same depth."""

from __future__ import annotations

from math import nan

import numpy as np

from indent_sim.model.load_path import Unloading
from indent_sim.run.error_estimation.coarser_run import StatesByStep

# Between two rows the power 1/EXPONENT of the force is nearly linear in the depth: unloading curves
# are power laws with exponents of about 1.2 to 1.6 (Oliver & Pharr 1992).
EXPONENT = 1.5


def unloading_force(states: StatesByStep, unloading: Unloading, delta: float) -> float:
    """Return the force of the rows of unloading at a depth [force]; NaN if rows are missing.

    Beyond the last row the force is zero.
    """
    depths, forces = _unloading_rows(states, unloading)
    if len(depths) <= unloading.rows:
        return nan
    root = np.interp(delta, depths, np.maximum(forces, 0.0) ** (1 / EXPONENT))
    return float(root**EXPONENT)


def depth_without_force(states: StatesByStep, unloading: Unloading) -> float:
    """Return the depth at which the force vanishes in unloading [length].

    The depth is extrapolated from the last two rows with a force; NaN if rows are missing.
    """
    depths, forces = _unloading_rows(states, unloading)
    loaded = forces > 0
    if len(depths) <= unloading.rows or np.count_nonzero(loaded) < 2:
        return nan
    near, far = forces[loaded][:2] ** (1 / EXPONENT)
    depth, deeper = depths[loaded][:2]
    return float(depth - near * (deeper - depth) / (far - near)) if far > near else nan


def _unloading_rows(states: StatesByStep, unloading: Unloading) -> tuple[np.ndarray, np.ndarray]:
    """Return depths and forces of the rows from the beginning of unloading, deepest last."""
    steps = range(unloading.last, unloading.start - 1, -1)
    rows = [states[step] for step in steps if step in states]
    return np.array([row.delta for row in rows]), np.array([row.force for row in rows])
