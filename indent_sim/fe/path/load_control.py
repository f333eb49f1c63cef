"""Load control: the depth at which a body pushes back with a given force.

The force of a frictionless elastic body grows with the depth, nearly as a power of it, whatever the
path before. So the depth is found by inverse interpolation in (log force, log delta), where a power
is a straight line, from what is known of the curve: the rows before, and the depths tried for this
one. A bracket keeps every try between those that pushed less and those that pushed more.

Where time passes the curve is another one at every row, and begins where the body has risen or sunk
to: there the depth is found by secants, from that of the row before.

A tip that adheres pulls where it first touches, at delta = 0. Forces are counted from there: that
curve begins with no force, too, and grows with the depth.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections.abc import Callable, Sequence

FORCE_SLACK = (
    1e-8  # of the force, where round-off leaves no depth between two tries: that of the audit
)
MOST_TRIES = 60
LARGEST_STEP_RATIO = 4.0  # times the step before, the next one at most
NEIGHBOURS = 3  # points of the curve taken on each side of a force

ForceDepth = tuple[float, float]  # force, depth


class LoadControl:
    """Finds depths of forces on a curve that `reach` follows: it goes to a depth, or as near as it
    can, and returns that depth and the force there.
    """

    def __init__(
        self, go_to_depth: Callable[[float], ForceDepth], deepest: float, *, from_row: bool = False
    ):
        """reach: depth -> (force, depth) where it then stands; deepest: no depth beyond this is
        tried; from_row: it sets out from the last row each time, and what stops it once stops it
        again.
        """
        self.failure = ""  # why the last force was not found, "" when a depth was not reached
        self._go_to_depth = go_to_depth
        self._deepest = deepest
        self._starts_from_row = from_row
        self.tolerance = 1e-10  # of the force, relative
        self._curve: list[ForceDepth] = []  # in order of the force
        self._slope = 0.0  # of the curve as it was last, 0: not known
        self._touch_pull: float | None = None  # of a tip that adheres, at delta = 0

    def measure_touch_pull(self) -> None:
        """Find out how a tip that adheres pulls where it first touches."""
        self._touch_pull = max(-self._go_to_depth(0.0)[0], 0.0)
        self._curve = []

    def find_by_secant(self, force: float, delta: float, slope: float) -> bool:
        """Stand at the depth of a force on a curve that is another one now, near `delta`, where it
        rises by about `slope` if nothing better is known; by secants, and by halves of the
        bracket where these leave it. A force of 0 only of a tip that adheres: else it has many
        depths.
        """
        tried_points = list[ForceDepth]()
        lower = -math.inf
        upper = math.inf
        longest_step = math.inf
        slope = self._slope or slope
        pull = self._touch_pull or 0.0
        for _ in range(MOST_TRIES):
            reached_force, reached_depth = self._go_to_depth(delta)
            if reached_depth != delta:  # it stands where it set out from, at another time
                self.failure = ""
                return False
            if abs(reached_force - force) <= self.tolerance * (force + pull):
                self._curve = []
                self.add_curve_point(reached_force + pull, reached_depth)
                return True
            tried_points = [*tried_points[-1:], (reached_force, reached_depth)]
            lower, upper = (
                (max(lower, reached_depth), upper)
                if reached_force < force
                else (lower, min(upper, reached_depth))
            )
            if math.isfinite(upper - lower) and upper - lower <= 4e-16 * max(
                abs(upper), abs(lower)
            ):
                self.failure = "the force jumps over it"
                return abs(reached_force - force) <= FORCE_SLACK * (force + pull)
            if (
                len(tried_points) > 1
                and (force_change := tried_points[1][0] - tried_points[0][0])
                * (depth_change := tried_points[1][1] - tried_points[0][1])
                > 0
            ):
                slope = self._slope = force_change / depth_change
            elif not reached_force:
                slope /= 2  # out of contact: it may be further away
            step = min(
                max((force - reached_force) / slope, -longest_step), longest_step
            )  # a first touch tells little of the rest
            delta = reached_depth + step
            longest_step = LARGEST_STEP_RATIO * abs(step)
            if not lower < delta < upper:
                delta = (lower + upper) / 2
        self.failure = f"{MOST_TRIES} depths gave other forces"
        return False

    def add_curve_point(self, force: float, delta: float) -> None:
        """A point of the curve, from which others are predicted."""
        is_known = any(
            math.isclose(known, force, rel_tol=1e-6) for known, _ in self._neighbour_points(force)
        )
        if force > 0 and delta > 0 and not is_known:
            insort(self._curve, (force, delta))

    def find_depth(self, force: float, expected: float) -> bool:
        """Stand at the depth of a force, near `expected` if nothing better is known; 0 where the
        tip just touches.
        """
        if self._touch_pull is not None:
            if force < -self._touch_pull:
                self.failure = (
                    "the tip pulls with less where it first touches, "
                    "and harder pulls are not sought"
                )
                return False
            force += self._touch_pull
        elif force == 0:
            return self._go_to_depth(0.0)[1] == 0.0
        curve_points = self._neighbour_points(force)
        tried_points = list[ForceDepth]()
        delta = min(predict_depth(force, curve_points) or expected, self._deepest)
        for _ in range(MOST_TRIES):
            reached_force, reached_depth = self._go_to_depth(delta)
            reached_force += self._touch_pull or 0.0  # from where the curve begins
            tried_points.append((reached_force, reached_depth))
            if abs(reached_force - force) <= self.tolerance * force:
                self.add_curve_point(reached_force, reached_depth)
                return True
            lower = max(
                (depth for push, depth in tried_points if push < force), default=0.0
            )  # the deepest that pushed less
            upper = min((depth for push, depth in tried_points if push >= force), default=math.inf)
            if self._is_exhausted(force, tried_points[-1], delta, lower, upper):
                return abs(reached_force - force) <= FORCE_SLACK * force
            delta = min(
                _next_depth(force, [*curve_points, *tried_points], lower, upper, len(tried_points)),
                self._deepest,
            )
        self.failure = f"{MOST_TRIES} depths gave other forces"
        return False

    def _neighbour_points(self, force: float) -> list[ForceDepth]:
        index = bisect_left(self._curve, (force, 0.0))
        return self._curve[max(0, index - NEIGHBOURS) : index + NEIGHBOURS]

    def _is_exhausted(
        self, force: float, last_point: ForceDepth, target_depth: float, lower: float, upper: float
    ) -> bool:
        """Whether no other depth is worth a try; `failure` says why, where it is not the
        equilibrium that failed.
        """
        reached_force, reached_depth = last_point
        is_blocked_out = (
            self._starts_from_row and reached_force > force and reached_depth > target_depth
        )
        if (reached_force < force and reached_depth != target_depth) or is_blocked_out:
            self.failure = ""
        elif reached_force < force and reached_depth >= self._deepest:
            self.failure = "the body pushes back with less even when the tip is all but at its base"
        elif upper <= lower * (1 + 4e-16):
            self.failure = "the force jumps over it"
        else:
            return False
        return True


def predict_depth(force: float, points: Sequence[ForceDepth]) -> float | None:
    """The depth of a force by inverse interpolation in logarithms of the nearest points; None
    without any. Far outside of what is known by the power law of the nearest two.
    """
    nearest = sorted(
        {f: d for f, d in points if f > 0 and d > 0}.items(),
        key=lambda p: abs(math.log(p[0] / force)),
    )[:3]
    if not nearest:
        return None
    x = [math.log(f / force) for f, _ in nearest]
    y = [math.log(d) for _, d in nearest]
    span = max(x) - min(x)
    if len(nearest) == 1 or abs(x[0]) > span:
        slope = (
            (y[-1] - y[0]) / (x[-1] - x[0]) if len(nearest) > 1 else 2 / 3
        )  # delta ~ force^(2/3) of a paraboloid
        return math.exp(y[0] - min(max(slope, 0.0), 1.0) * x[0])
    return math.exp(_interpolate_at_zero(x, y))


def _interpolate_at_zero(x: Sequence[float], y: Sequence[float]) -> float:
    """The polynomial through the points at x = 0 (Neville)."""
    values = list(y)
    for order in range(1, len(x)):
        for i in range(len(x) - order):
            values[i] = (x[i + order] * values[i] - x[i] * values[i + 1]) / (x[i + order] - x[i])
    return values[0]


def _next_depth(
    force: float, points: Sequence[ForceDepth], lower: float, upper: float, try_count: int
) -> float:
    """The next depth to try: what the points predict, or a middle of the bracket where that leads
    nowhere.
    """
    guess = predict_depth(force, points)
    is_stuck = try_count > 10 and try_count % 2 == 0
    if guess is not None and lower < guess < upper and not is_stuck:
        return min(guess, 4 * lower) if lower > 0 and math.isinf(upper) else guess
    if math.isinf(upper):
        return 2 * lower
    return (
        (lower + upper) / 2
        if lower > upper / 4
        else math.sqrt(lower * upper)
        if lower > 0
        else upper / 4
    )
