"""Inversion of an increasing load curve: contact size for a depth, depth for a force.

The search is Brent's method in (ln a, ln depth), where Hertz's law is a straight line.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from functools import cache

import numpy as np

from indent_sim.theory.solution import SOLUTION_ERRORS

ForceCurve = Callable[[float], float]  # Force [F] at a depth [L].


def first_guess(profile: Callable[[np.ndarray], np.ndarray], depth: float, limit: float) -> float:
    """Return a contact size in (0, limit) at which an increasing profile(x) is roughly `depth`."""
    grid = limit * (1.0 - 1e-9) * np.geomspace(1e-18, 1.0, 400)
    values = profile(grid)
    if values[-1] <= depth:
        return 0.5 * limit
    index = max(1, int(np.searchsorted(values, depth)))
    return float(np.sqrt(grid[index - 1] * grid[index]))


def next_guess(previous_points: list[tuple[float, float]], depth: float) -> float | None:
    """Extrapolate the contact size to `depth` by a power law through the last two points.

    The points are pairs (depth, size). Returns None without points.
    """
    if not previous_points:
        return None
    last_depth, a = previous_points[-1]
    exponent = 0.5
    if len(previous_points) > 1 and previous_points[-2][0] != last_depth:
        exponent = math.log(a / previous_points[-2][1]) / math.log(
            last_depth / previous_points[-2][0]
        )
    return a * (depth / last_depth) ** min(max(exponent, 0.0), 1.0)


def increasing_root(
    function: Callable[[float], float], target: float, start: float, limit: float
) -> float:
    """Return the x in (0, limit) at which an increasing function(x) is `target` > 0.

    The relative error of the root is 1e-13.

    Parameters
    ----------
    function
        Increasing function.
    target
        Value of the function at the root.
    start
        First x of the search.
    limit
        Upper bound of x, at which the function is not evaluated.

    Raises
    ------
    ValueError
        If the function stays below the target up to a relative distance of 1e-4 from the limit.
    ArithmeticError
        If the function stays above the target down to x = 0.
    """
    # This import takes 0.2 s, which other scenes need not spend.
    from scipy.optimize import brentq

    @cache  # Brent's method begins with both ends of the bracket.
    def log_excess(log_x: float) -> float:
        """Return ln(function/target), or a large number if the logarithm does not exist."""
        ratio = function(math.exp(log_x)) / target
        if ratio <= 0.0:
            return -1e3
        return math.log(ratio) if math.isfinite(ratio) else 1e3

    low = high = math.log(start if start < limit else 0.9 * limit)
    # Tolerance of the logarithm of the root, and thus its relative error.
    tolerance = 1e-13
    # If the function grows with the power 2 of x (the depth of a paraboloid) or more, the root is
    # at a distance of at most half of |ln(function/target)| in ln x.
    width = max(0.6 * abs(log_excess(low)), tolerance)
    while log_excess(high) < 0.0:
        size = math.exp(high)
        if size > limit * (1.0 - 1e-4):
            raise ValueError(
                f"the contact would grow to {limit:g} thicknesses, where it meets a wall or the "
                "end of the tip, or where the layer is too thin for the theory"
            )
        low = high
        # A step covers at most nine tenths of the distance to the limit.
        high = min(high + width, math.log(limit - 0.1 * (limit - size)))
        width *= 2.0
    while log_excess(low) >= 0.0:
        if math.exp(low) == 0.0:
            raise ArithmeticError(
                f"no contact size > 0 was found at which depth or force is as small as {target:g}"
            )
        high = low
        low -= width
        width *= 2.0
    return math.exp(brentq(log_excess, low, high, xtol=tolerance))


def depth_of_force(force_at: ForceCurve, force: float, start: float) -> float | None:
    """Return the depth at which an increasing force_at(depth) is `force` > 0.

    The search begins at `start`. Returns None if the force is not reached.
    """
    with contextlib.suppress(*SOLUTION_ERRORS), np.errstate(all="ignore"):
        return increasing_root(force_at, force, start, 1e15 * start)
    return None
