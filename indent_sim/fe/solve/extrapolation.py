"""What the equilibria at some depths lead to expect at another one.

Where a smooth contact ends, the pressure inside grows as the root of the distance s from its edge
and the gap outside as s^(3/2). As the edge passes over a point, pressure^2 and gap^(2/3) are
therefore linear in the depth there, and the gap itself is not: its line finds the edge two thirds
of its way too far out, these to a sixth of it or better.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod

import numpy as np

CUT_ELEMENT_PRESSURE = (
    0.01  # of the largest: a trial below it is of elements cut by the edge, linear in depth
)


def lagrange_weights(depths: Sequence[float], depth: float) -> list[float]:
    """Weights of values at some depths in the polynomial through them at another depth (Lagrange)."""
    return [
        prod((depth - other) / (own - other) for other in depths if other != own) for own in depths
    ]


def predict_trial_pressure(
    trials: Sequence[np.ndarray], depths: Sequence[float], depth: float, largest: float
) -> np.ndarray:
    """The trial pressure [pressure] at a depth from those at two others, by the line of what is
    linear in the depth. trials: lam - epsilon_n g at the same points, above zero in contact;
    largest: of all of them on all ranks.
    """
    if largest <= 0:
        return np.asarray(trials[-1])
    weighted_trials = zip(lagrange_weights(depths, depth), trials, strict=True)
    distances = [share * _edge_distance(trial / largest) for share, trial in weighted_trials]
    return largest * _trial_pressure(sum(distances[1:], start=distances[0]))


def _edge_distance(trial: np.ndarray) -> np.ndarray:
    """The distance from the edge, in some unit, of what is above zero inside."""
    inside = np.maximum(trial, 0.0)
    outside = np.maximum(-trial, 0.0)
    return np.asarray(
        inside**2 - (np.cbrt(outside + CUT_ELEMENT_PRESSURE) ** 2 - CUT_ELEMENT_PRESSURE ** (2 / 3))
    )


def _trial_pressure(distance: np.ndarray) -> np.ndarray:
    inside = np.maximum(distance, 0.0)
    outside = np.maximum(-distance, 0.0)
    shifted = outside + CUT_ELEMENT_PRESSURE ** (2 / 3)
    return np.asarray(np.sqrt(inside) - (shifted * np.sqrt(shifted) - CUT_ELEMENT_PRESSURE))
