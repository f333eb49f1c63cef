"""Load increments of a body that yields for a requested accuracy.

With backward Euler the force is too small by an amount that is proportional to the increments
relative to the depth (`YIELD_INCREMENT_ERROR`). Between two rows the depth therefore grows by a
constant factor.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import ceil, log1p, sqrt

import numpy as np

from indent_sim.model.load_path import LoadPath

# Increment relative to the depth, divided by the requested accuracy, of a path that only loads and
# of one that unloads. The error estimate of the increments is then about half of the accuracy. In
# unloading the force falls to zero, and its relative error grows.
INCREMENT_PER_ACCURACY = 1.0
INCREMENT_PER_ACCURACY_UNLOADING = 0.5
# Largest number of increments: about an hour on a small mesh.
MAX_INCREMENTS = 20000


def with_yield_increments(path: LoadPath, target: float) -> LoadPath:
    """Return a path of depths with short increments between its rows.

    Parameters
    ----------
    path : LoadPath
        The prescribed depths.
    target : float
        Requested relative error of the force.
    """
    # The force of a first increment is too small by up to a quarter of itself, but it is `target`
    # times that of the first row.
    first = next((value for value in path.values if value > 0), 0.0)
    start = sqrt(target) * first
    unloads = any(after < before for before, after in pairwise(path.values))
    fraction = (INCREMENT_PER_ACCURACY_UNLOADING if unloads else INCREMENT_PER_ACCURACY) * target
    turns = [
        tuple(_points_between(before, after, start, fraction))
        for before, after in pairwise((0.0, *path.values))
    ]
    if path.unloading:
        # The depths of these rows are found during the run.
        turns[path.unloading.start :] = [()] * (len(turns) - path.unloading.start)
    return replace(path, turns=tuple(turns))


def increment_count(path: LoadPath) -> int:
    """Return the number of increments of a path."""
    return len(path.values) + sum(map(len, path.turns))


def _points_between(before: float, after: float, start: float, fraction: float) -> list[float]:
    """Return depths between two rows, whose increments are at most a fraction of the depth."""
    low, high = sorted((before, after))
    low = max(low, start)
    if high <= low:
        return []
    count = ceil(log1p((high - low) / low) / log1p(fraction))
    depths = [float(depth) for depth in np.geomspace(low, high, count + 1)[:-1]]
    inner = [depth for depth in depths if min(before, after) < depth < max(before, after)]
    return inner if after > before else inner[::-1]
