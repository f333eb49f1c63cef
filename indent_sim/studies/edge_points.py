"""Points at the edges of the range of a surrogate, and its error there, where it has few runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from indent_sim.studies.held_out_error import place_text
from indent_sim.studies.polynomial_fit import with_coefficients
from indent_sim.studies.surrogate import Surrogate

# Number of points that are drawn.
COUNT = 4096
# Number of runs that are added to them.
RUNS = 100
# Number of fits, each of which leaves out one part of the runs.
PARTS = 4
# A larger difference, which may have no finite number, is stated as this one.
LARGEST = 1e9


def edge_points(surrogate: Surrogate, runs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return values of the varied keys at points inside the range of the study, mostly at edges.

    Each key has, with equal probability, its smallest value, its largest one, or one in between.
    Some runs are added: if conditions leave out nearly all of the ranges, they are the only points.

    Parameters
    ----------
    surrogate
        The surrogate.
    runs
        Values of all keys at its runs; (rows,).
    """
    random = np.random.default_rng(0)
    points: dict[str, np.ndarray] = {}
    for key, (low, high) in surrogate.ranges.items():
        share = random.random(COUNT)
        inner = low * (high / low) ** share if low > 0 else low + (high - low) * share
        place = random.integers(0, 3, COUNT)
        points[key] = np.select([place == 0, place == 1], [low, high], inner)
    is_inside = surrogate.inside(points)
    return {
        key: np.concatenate([values[is_inside], runs[key][:RUNS]]) for key, values in points.items()
    }


def edge_difference(
    surrogate: Surrogate, values: Mapping[str, np.ndarray], target: np.ndarray
) -> dict[str, Any]:
    """Return the largest difference at the edges of fits that leave out a part of the runs.

    Parameters
    ----------
    surrogate
        The surrogate of all runs.
    values
        Values of all keys at the fitted runs; (rows,).
    target
        Values to which its polynomial is fitted; (rows,).

    Returns
    -------
    dict
        "difference", relative if the errors of the surrogate are, and the point "at" which it is.
    """
    points = edge_points(surrogate, values)
    with np.errstate(over="ignore"):
        column = surrogate(points)
    scale = np.abs(column) if surrogate.is_logarithmic else np.abs(column).max()
    part = np.random.default_rng(1).integers(0, PARTS, len(target))
    differences = np.zeros(len(column))
    for left_out in range(PARTS):
        is_kept = part != left_out
        kept = {key: array[is_kept] for key, array in values.items()}
        other = with_coefficients(surrogate, kept, target[is_kept])
        with np.errstate(over="ignore", invalid="ignore"):
            difference = np.abs(other(points) - column) / scale
        finite = np.where(difference < LARGEST, difference, LARGEST)
        differences = np.maximum(differences, finite)
    worst = int(np.argmax(differences))
    return {
        "difference": float(differences[worst]),
        "at": {key: float(array[worst]) for key, array in points.items()},
    }


def edge_text(difference: Mapping[str, Any]) -> str:
    """Return the difference at the edges as text."""
    return (
        "at the edges of the range, where there are few runs, fits without a quarter of the runs "
        f"differ by up to {difference['difference']:.2g}, at {place_text(difference['at'])}"
    )
