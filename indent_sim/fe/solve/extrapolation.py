"""Interpolation weights and predicted trial pressure for the initial guess at the next depth.

Near the edge of a smooth contact the pressure inside varies as the square root of the distance s
from the edge, the gap outside as s^(3/2). At a point over which the edge passes, pressure^2 and
gap^(2/3) are therefore linear in the depth. A linear extrapolation of gaps misplaces the edge by
two thirds of the distance that it moves, an extrapolation of these powers misplaces the edge by a
sixth of this distance or less. The initial guess is set in `Equilibrium.extrapolate`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod

import numpy as np

# Trial pressure, relative to the largest one, below which it is taken as linear in the depth: such
# points lie in elements that the contact edge cuts
CUT_ELEMENT_PRESSURE = 0.01


def lagrange_weights(depths: Sequence[float], depth: float) -> list[float]:
    """Return the weights with which values at `depths` are interpolated to a depth (Lagrange)."""
    return [
        prod((depth - depth_j) / (depth_k - depth_j) for depth_j in depths if depth_j != depth_k)
        for depth_k in depths
    ]


def predict_trial_pressure(
    trials: Sequence[np.ndarray], depths: Sequence[float], depth: float, largest: float
) -> np.ndarray:
    """Extrapolate the trial pressure, from two depths, to another depth.

    Parameters
    ----------
    trials
        Trial pressures at the same points at two depths, > 0 in contact [pressure].
    depths
        The two depths [length].
    depth
        The depth to which the trial pressure is extrapolated [length].
    largest
        Largest value of `trials` on all ranks [pressure].

    Returns
    -------
    ndarray
        Trial pressure at these points [pressure].
    """
    if largest <= 0:
        return np.asarray(trials[-1])
    weighted_trials = zip(lagrange_weights(depths, depth), trials, strict=True)
    distances = [share * _edge_distance(trial / largest) for share, trial in weighted_trials]
    return largest * _trial_pressure(sum(distances[1:], start=distances[0]))


def _edge_distance(trial: np.ndarray) -> np.ndarray:
    """Return a measure proportional to the distance from the contact edge, > 0 inside."""
    inside = np.maximum(trial, 0.0)
    outside = np.maximum(-trial, 0.0)
    return np.asarray(
        inside**2 - (np.cbrt(outside + CUT_ELEMENT_PRESSURE) ** 2 - CUT_ELEMENT_PRESSURE ** (2 / 3))
    )


def _trial_pressure(distance: np.ndarray) -> np.ndarray:
    """Return the trial pressure from the edge distance, the inverse of `_edge_distance`."""
    inside = np.maximum(distance, 0.0)
    outside = np.maximum(-distance, 0.0)
    shifted = outside + CUT_ELEMENT_PRESSURE ** (2 / 3)
    return np.asarray(np.sqrt(inside) - (shifted * np.sqrt(shifted) - CUT_ELEMENT_PRESSURE))
