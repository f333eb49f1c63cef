"""Inversion of an increasing load curve: the contact size of a depth, the depth of a force."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import numpy as np

from indent_sim.theory.solution import SOLUTION_ERRORS

ForceCurve = Callable[[float], float]  # the force [F] at a depth [L]
GUESS_FRACTIONS = np.geomspace(
    1e-18, 1.0, 400
)  # of the limit, the sizes among which the first guess is sought
LEAST_END_DISTANCE = (
    1e-4  # relative distance from a wall or from the end of the tip at which the search gives up
)


def first_guess(profile: Callable[[np.ndarray], np.ndarray], depth: float, limit: float) -> float:
    """Contact size in (0, limit) at which an increasing profile(x) is about `depth`: where to
    start.
    """
    grid = limit * (1.0 - 1e-9) * GUESS_FRACTIONS
    values = profile(grid)
    if values[-1] <= depth:
        return 0.5 * limit
    index = max(1, int(np.searchsorted(values, depth)))
    return float(np.sqrt(grid[index - 1] * grid[index]))


def next_guess(previous_points: list[tuple[float, float]], depth: float) -> float | None:
    """Contact size at `depth` from the last two (depth, size) of a curve, which nearly obey a power
    law.
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
    """Contact size a in (0, limit) with depth(a) = target > 0, for an increasing depth(a); or any
    such pair.

    Secant in (log a, log depth), where Hertz is a straight line, kept inside a bracket that
    bisection halves whenever the secant does not. Raises ValueError if depth stays below target up
    to 1e-4 from the limit, ArithmeticError if nothing converges.
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
            return step  # the secant squares this error
        previous = (a, value)
        if (iteration > 30 and iteration % 2) or not lo < step < hi:
            step = _bracketed_step(lo, hi, limit)
        if lo > limit * (1.0 - LEAST_END_DISTANCE):
            reason = "a wall, the end of the tip, or too thin a layer"
            raise ValueError(f"the contact would reach {limit:g} thicknesses: {reason}")
        a = step
    raise ArithmeticError(
        f"no contact size found for the depth {target:g} (in units of the thickness)"
    )


def depth_of_force(force_at: ForceCurve, force: float, start: float) -> float | None:
    """The depth at which an increasing force_at(depth) is `force` > 0, near `start`; None when it
    is not reached.
    """
    with contextlib.suppress(*SOLUTION_ERRORS), np.errstate(all="ignore"):
        return increasing_root(force_at, force, start, 1e15 * start)
    return None


def power_law_step(
    a: float, value: float, target: float, previous: tuple[float, float] | None = None
) -> float:
    """Next a of the log-log secant; the exponent starts at the paraboloid's 2.

    Not a number where `value` is none.
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
    if lo == 0.0:
        return 0.25 * hi
    if hi >= limit:  # nothing is known above lo: approach the limit quickly, but not in one leap
        return min(2.0 * lo, limit - 0.1 * (limit - lo))
    return 0.5 * (lo + hi)
