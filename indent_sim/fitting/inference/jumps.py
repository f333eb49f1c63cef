"""Jumps of the force of an adhesive tip: snap-in in the approach, pull-off in the retraction.

Each sample of an adhesive tip belongs to a branch, positive in contact and negative out of contact:

    APPROACH, RETRACT    in contact during the approach or the retraction
    -APPROACH, -RETRACT  out of contact
    LEFT_OUT             between the two sides of a jump

A clear jump is found in the samples alone, independently of the parameters. A weak one is placed
where the sum of squares is smallest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from indent_sim.fitting.forward_model.forward_model import APPROACH, RETRACT

LEFT_OUT = 0
# A jump is clear if it exceeds this multiple of the standard deviation of the changes between
# samples. One in 3.5 million normally distributed changes is as large.
CLEAR_JUMP_DEVIATIONS = 5.0
# Number of samples on each side of a jump. Their medians must differ by at least half the jump.
MIN_SIDE_SAMPLES = 5


@dataclass(frozen=True)
class Jumps:
    """Branches of the samples of a curve, if clear jumps determine them.

    Attributes
    ----------
    branch : ndarray of int, shape (n,)
        Branch of every sample; all samples of a side without a clear jump are in contact.
    touch : tuple of float, optional
        Displacements x between which the tip snapped in [length]; None without a clear snap-in.
    weak_sides : tuple of int
        Sides of the curve, APPROACH or RETRACT, without a clear jump.
    """

    branch: np.ndarray
    touch: tuple[float, float] | None
    weak_sides: tuple[int, ...]


def sides_of(x: np.ndarray) -> np.ndarray:
    """Return APPROACH for samples up to the deepest one, and RETRACT for the later ones (n,)."""
    return np.where(np.arange(len(x)) <= int(np.argmax(x)), APPROACH, RETRACT)


def find_jumps(x: np.ndarray, force: np.ndarray, side: np.ndarray) -> Jumps:
    """Find the clear jumps of a curve.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Displacements [length] in order of time.
    force : ndarray, shape (n,)
        Forces [force].
    side : ndarray of int, shape (n,)
        APPROACH or RETRACT.
    """
    branch = side.copy()
    touch = None
    approach = np.flatnonzero(side == APPROACH)
    retract = np.flatnonzero(side == RETRACT)
    snap_in = _clear_fall(force[approach])
    if snap_in is not None:
        before, after = snap_in
        branch[approach[: before + 1]] = -APPROACH
        branch[approach[before + 1 : after]] = LEFT_OUT
        touch = float(x[approach[before]]), float(x[approach[after]])
        touch = min(touch), max(touch)
    # Backwards in time, a pull-off is a fall from the baseline.
    pull_off = _clear_fall(force[retract][::-1])
    if pull_off is not None:
        before, after = (len(retract) - 1 - index for index in pull_off)
        branch[retract[before:]] = -RETRACT
        branch[retract[after + 1 : before]] = LEFT_OUT
    weak_sides = tuple(
        name
        for name, rows, jump in ((APPROACH, approach, snap_in), (RETRACT, retract, pull_off))
        if len(rows) and jump is None
    )
    return Jumps(branch, touch, weak_sides)


def _clear_fall(force: np.ndarray) -> tuple[int, int] | None:
    """Return the samples before and after the largest fall of the force, if it is clear."""
    if len(force) < 2 * MIN_SIDE_SAMPLES:
        return None
    changes = np.diff(force)
    steepest = int(np.argmin(changes))
    # Standard deviation of a normal distribution over the median of its absolute value.
    median_to_deviation = 1.4826
    # Second differences do not contain the slope of the contact.
    deviation = median_to_deviation * float(np.median(np.abs(np.diff(changes)))) / math.sqrt(2.0)
    threshold = max(CLEAR_JUMP_DEVIATIONS * deviation, 1e-9 * float(np.ptp(force)))
    is_fall = changes < -threshold
    before = after = steepest
    # A jump may last several samples.
    while before > 0 and is_fall[before - 1]:
        before -= 1
    while after + 1 < len(changes) and is_fall[after + 1]:
        after += 1
    first = after + 1
    if not is_fall[steepest] or before + 1 < MIN_SIDE_SAMPLES:
        return None
    # A single outlier is no jump.
    earlier = force[before + 1 - MIN_SIDE_SAMPLES : before + 1]
    later = force[first : first + MIN_SIDE_SAMPLES]
    fall = float(np.median(earlier) - np.median(later))
    return (before, first) if fall > 0.5 * (force[before] - force[first]) else None


def best_branches(
    branch: np.ndarray, squares_out: np.ndarray, squares_in: np.ndarray, may_move: np.ndarray
) -> np.ndarray:
    """Return the branches with the least sum of squares, with one jump on each side of the curve.

    Parameters
    ----------
    branch : ndarray of int, shape (n,)
        Branches of the samples.
    squares_out, squares_in : ndarray, shape (n,)
        Squared residual of each sample if it is out of contact, or in contact.
    may_move : ndarray of bool, shape (n,)
        True for the samples whose branch may change.
    """
    result = branch.copy()
    gain = squares_out - squares_in
    for side, direction in ((APPROACH, 1), (RETRACT, -1)):
        rows = np.flatnonzero((np.abs(branch) == side) & may_move)[::direction]
        if len(rows):
            # The samples from the j-th on are in contact: j with the largest sum of gains.
            gains = np.append(np.cumsum(gain[rows][::-1])[::-1], 0.0)
            first = int(np.argmax(gains))
            result[rows[:first]] = -side
            result[rows[first:]] = side
    return result


def touch_interval(x: np.ndarray, branch: np.ndarray) -> tuple[float, float] | None:
    """Return the displacements [length] between which the tip snapped in; None if unknown."""
    before = x[branch == -APPROACH]
    after = x[branch == APPROACH]
    if not len(before) or not len(after):
        return None
    ends = float(before[-1]), float(after[0])
    return min(ends), max(ends)


def spread_of_uniform(interval: tuple[float, float]) -> float:
    """Return the standard deviation of a uniform distribution in an interval."""
    return (interval[1] - interval[0]) / math.sqrt(12.0)
