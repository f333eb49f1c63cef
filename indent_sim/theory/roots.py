"""Inversion of an increasing load curve: the contact size of a depth, the depth of a force.

The search is a secant method in (log a, log depth), where Hertz's law is a straight line, inside a
bracket (Press et al., Numerical Recipes, chapter 9, for safeguarded secants).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import numpy as np

from indent_sim.theory.solution import SOLUTION_ERRORS

ForceCurve = Callable[[float], float]  # Force [F] at a depth [L].
# Sizes over the limit at which the tip's profile is tabulated for the first guess.
GUESS_FRACTIONS = np.geomspace(1e-18, 1.0, 400)
# Relative distance from a wall or from the end of the tip at which the search gives up.
LEAST_END_DISTANCE = 1e-4


def first_guess(profile: Callable[[np.ndarray], np.ndarray], depth: float, limit: float) -> float:
    """Return a contact size in (0, limit) at which an increasing profile(x) is about `depth`."""
    grid = limit * (1.0 - 1e-9) * GUESS_FRACTIONS
    values = profile(grid)
    if values[-1] <= depth:
        return 0.5 * limit
    index = max(1, int(np.searchsorted(values, depth)))
    return float(np.sqrt(grid[index - 1] * grid[index]))


def next_guess(previous_points: list[tuple[float, float]], depth: float) -> float | None:
    """Extrapolate the contact size to `depth` by a power law through the last two points.

    The points are pairs (depth, size); None without any.
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
    depth: Callable[[float], float], target: float, start: float, limit: float
) -> float:
    """Return the contact size a in (0, limit) at which an increasing depth(a) is `target` > 0.

    The secant in (log a, log depth) is kept inside a bracket, which is bisected where the secant
    leaves it or converges slowly. Any other increasing function can take the place of the depth.

    Raises
    ------
    ValueError
        If the depth stays below the target up to a relative distance of 1e-4 from the limit.
    ArithmeticError
        If the search does not converge.
    """
    lo = 0.0
    hi = limit
    a = min(start, 0.5 * (start + limit) if start < limit else 0.9 * limit)
    previous: tuple[float, float] | None = None
    for iteration in range(200):
        value = depth(a)
        lo, hi = (a, hi) if value < target else (lo, a)
        if value == target or hi - lo <= 1e-15 * hi:
            return a
        step = power_law_step(a, value, target, previous)
        if abs(step - a) <= 1e-11 * a:
            return step  # The error of this step is about the square of the last one's.
        previous = (a, value)
        if (iteration > 30 and iteration % 2) or not lo < step < hi:
            step = _bracketed_step(lo, hi, limit)
        if lo > limit * (1.0 - LEAST_END_DISTANCE):
            raise ValueError(
                f"the contact would grow to {limit:g} thicknesses, where it meets a wall or the "
                "end of the tip, or where the layer is too thin for the theory"
            )
        a = step
    raise ArithmeticError(
        f"no contact size found for the depth {target:g} (in units of the thickness)"
    )


def depth_of_force(force_at: ForceCurve, force: float, start: float) -> float | None:
    """Return the depth at which an increasing force_at(depth) is `force` > 0, sought near `start`.

    None where the force is not reached.
    """
    with contextlib.suppress(*SOLUTION_ERRORS), np.errstate(all="ignore"):
        return increasing_root(force_at, force, start, 1e15 * start)
    return None


def power_law_step(
    a: float, value: float, target: float, previous: tuple[float, float] | None = None
) -> float:
    """Return the next a of the secant in (log a, log value); NaN where `value` is not > 0.

    Without a previous pair (a, value) the exponent is 2, that of a paraboloid's depth.
    """
    if value <= 0.0:
        return math.nan
    exponent = 2.0
    if previous is not None and previous[1] > 0.0 and previous[0] != a:
        exponent = math.log(value / previous[1]) / math.log(a / previous[0])
    if not 0.1 < exponent < 100.0:
        exponent = 2.0 if exponent < 0.1 else 100.0
    return a * (target / value) ** (1.0 / exponent)


def _bracketed_step(lo: float, hi: float, limit: float) -> float:
    """Return a step inside the bracket (lo, hi) for a secant that left it."""
    if lo == 0.0:
        return 0.25 * hi
    if hi >= limit:
        # No size above lo was evaluated: approach the limit quickly, but not in one step.
        return min(2.0 * lo, limit - 0.1 * (limit - lo))
    return 0.5 * (lo + hi)
