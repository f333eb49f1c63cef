"""Load control: the depth at which the reaction of a body on the tip is a given force.

The force of a frictionless elastic body is nearly a power of the depth and does not depend on the
path. The depth is therefore found by inverse interpolation in (log force, log delta), where a power
law is a straight line, from the known points of the curve: earlier load increments and trial
depths. Every trial depth lies within a bracket of depths with smaller and larger force.

If time passes, the force-depth curve and its depth of zero force change with every increment. The
depth is then found by the secant method, starting from the depth of the previous increment.

An adhesive tip is pulled towards the body at first contact, delta = 0. The force at first contact
is subtracted, so that the curve of an adhesive tip also begins at zero and grows with the depth.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections.abc import Callable, Sequence

# Relative error of the force that is accepted where no floating-point number lies between two
# trial depths
FORCE_SLACK = 1e-8
# Largest number of trial depths for a prescribed force.
MAX_TRIES = 60

ForceDepth = tuple[float, float]  # force [force], depth [length]


class LoadControl:
    """Finds the depths of prescribed forces on the force-depth curve of a body.

    Parameters
    ----------
    go_to_depth
        Function that steps to a depth, or as close to it as an equilibrium exists, and returns the
        force and depth reached.
    deepest
        Largest trial depth [length].
    starts_from_row
        True for a path-dependent body: every trial starts from the equilibrium of the last accepted
        row, so that a depth at which the solution failed is not tried again.
    slack
        Relative error of the force that is accepted where no floating-point number lies between two
        trial depths.
    """

    def __init__(
        self,
        go_to_depth: Callable[[float], ForceDepth],
        deepest: float,
        *,
        starts_from_row: bool = False,
        slack: float = FORCE_SLACK,
    ):
        # Reason why the last force was not found; empty if a trial depth had no equilibrium
        self.failure = ""
        self._go_to_depth = go_to_depth
        self._deepest = deepest
        self._starts_from_row = starts_from_row
        self._slack = slack
        self.tolerance = 1e-10  # relative error of the force
        self._curve: list[ForceDepth] = []  # known points in the order of their force
        self._slope = 0.0  # last slope of the curve; 0 if unknown
        self._touch_pull: float | None = None  # tension on an adhesive tip at delta = 0

    def measure_pull_at_contact(self) -> None:
        """Determine the tensile force on an adhesive tip at first contact, delta = 0."""
        self._touch_pull = max(-self._go_to_depth(0.0)[0], 0.0)
        self._curve = []

    def find_by_secant(self, force: float, delta: float, slope: float) -> bool:
        """Find the depth of a force by the secant method, for a body that changes in time.

        The bracket is bisected where the secant method leaves it. A zero force is
        allowed only for adhesive tips, since it otherwise has no unique depth.

        Parameters
        ----------
        force
            Prescribed force [force].
        delta
            First trial depth [length].
        slope
            Slope of the curve [force/length], used if no slope is known from the previous row.

        Returns
        -------
        bool
            True if the body is in equilibrium at this force; otherwise `failure` contains the
            reason.
        """
        tried_points = list[ForceDepth]()
        lower = -math.inf
        upper = math.inf
        longest_step = math.inf
        slope = self._slope or slope
        pull = self._touch_pull or 0.0
        for _ in range(MAX_TRIES):
            reached_force, reached_depth = self._go_to_depth(delta)
            if reached_depth != delta:  # the trial depth was not reached
                self.failure = ""
                return False
            if abs(reached_force - force) <= self.tolerance * (force + pull):
                self._curve = []
                self.add_curve_point(reached_force + pull, reached_depth)
                return True
            tried_points = [*tried_points[-1:], (reached_force, reached_depth)]
            if reached_force < force:
                lower = max(lower, reached_depth)
            else:
                upper = min(upper, reached_depth)
            if math.isfinite(upper - lower) and upper - lower <= 4e-16 * max(
                abs(upper), abs(lower)
            ):
                self.failure = "near this force, the force is a discontinuous function of the depth"
                return abs(reached_force - force) <= self._slack * (force + pull)
            if (
                len(tried_points) > 1
                and (force_change := tried_points[1][0] - tried_points[0][0])
                * (depth_change := tried_points[1][1] - tried_points[0][1])
                > 0
            ):
                slope = self._slope = force_change / depth_change
            elif not reached_force:
                # Without contact the depth of first contact is unknown: a longer step is allowed.
                slope /= 2
            # A step is at most four times the one before: the slope at first contact says little
            # about the rest of the curve.
            step = min(max((force - reached_force) / slope, -longest_step), longest_step)
            delta = reached_depth + step
            longest_step = 4.0 * abs(step)
            if not lower < delta < upper:
                delta = (lower + upper) / 2
        self.failure = f"{MAX_TRIES} trial depths did not reach this force"
        return False

    def forget_curve(self) -> None:
        """Forget the known points of the curve, and its slope."""
        self._curve = []
        self._slope = 0.0

    def add_curve_point(self, force: float, delta: float) -> None:
        """Add a point of the force-depth curve, unless a point with this force is known."""
        is_known = any(
            math.isclose(curve_force, force, rel_tol=1e-6)
            for curve_force, _ in self._neighbour_points(force)
        )
        if force > 0 and delta > 0 and not is_known:
            insort(self._curve, (force, delta))

    def find_depth(self, force: float, expected: float) -> bool:
        """Find the depth of a force by inverse interpolation, for a body constant in time.

        Parameters
        ----------
        force
            Prescribed force [force]; for 0 the tip just touches the body.
        expected
            First trial depth [length] if no point of the curve is known.

        Returns
        -------
        bool
            True if the body is in equilibrium at this force; otherwise `failure` contains the
            reason.
        """
        if self._touch_pull is not None:
            if force < -self._touch_pull:
                self.failure = (
                    "the tensile force exceeds the attraction at first contact (delta = 0), which "
                    "load control does not support; prescribe depths instead"
                )
                return False
            force += self._touch_pull
        elif force == 0:
            return self._go_to_depth(0.0)[1] == 0.0
        curve_points = self._neighbour_points(force)
        tried_points = list[ForceDepth]()
        delta = min(predict_depth(force, curve_points) or expected, self._deepest)
        for _ in range(MAX_TRIES):
            reached_force, reached_depth = self._go_to_depth(delta)
            # The force is counted from its value at first contact, where the curve begins.
            reached_force += self._touch_pull or 0.0
            tried_points.append((reached_force, reached_depth))
            if abs(reached_force - force) <= self.tolerance * force:
                self.add_curve_point(reached_force, reached_depth)
                return True
            lower = max((depth for push, depth in tried_points if push < force), default=0.0)
            upper = min((depth for push, depth in tried_points if push >= force), default=math.inf)
            if self._is_exhausted(force, tried_points[-1], delta, lower, upper):
                return abs(reached_force - force) <= self._slack * force
            delta = min(
                _next_depth(force, [*curve_points, *tried_points], lower, upper, len(tried_points)),
                self._deepest,
            )
        self.failure = f"{MAX_TRIES} trial depths did not reach this force"
        return False

    def _neighbour_points(self, force: float) -> list[ForceDepth]:
        index = bisect_left(self._curve, (force, 0.0))
        # Number of points of the curve on each side of a force from which its depth is predicted.
        neighbour_count = 3
        return self._curve[max(0, index - neighbour_count) : index + neighbour_count]

    def _is_exhausted(
        self, force: float, last_point: ForceDepth, target_depth: float, lower: float, upper: float
    ) -> bool:
        """Return whether no further trial depth can succeed.

        `failure` then contains the reason. It stays empty if the solution at a trial depth failed,
        since the solver reports that reason itself.
        """
        reached_force, reached_depth = last_point
        is_blocked_out = (
            self._starts_from_row and reached_force > force and reached_depth > target_depth
        )
        if (reached_force < force and reached_depth != target_depth) or is_blocked_out:
            self.failure = ""
        elif reached_force < force and reached_depth >= self._deepest:
            self.failure = (
                "this force is not reached even with the tip close to the base of the body"
            )
        elif upper <= lower * (1 + 4e-16):
            self.failure = "near this force, the force is a discontinuous function of the depth"
        else:
            return False
        return True


def predict_depth(force: float, points: Sequence[ForceDepth]) -> float | None:
    """Return the depth of a force by inverse interpolation; None if no point is known.

    A parabola interpolates the logarithms of the three nearest points. Far outside of the known
    forces, a power law through the nearest two points is used instead.

    Parameters
    ----------
    force
        Force [force], > 0.
    points
        Known points (force, depth) of the curve.
    """
    nearest = sorted(
        {f: d for f, d in points if f > 0 and d > 0}.items(),
        key=lambda force_and_depth: abs(math.log(force_and_depth[0] / force)),
    )[:3]
    if not nearest:
        return None
    x = [math.log(f / force) for f, _ in nearest]
    y = [math.log(d) for _, d in nearest]
    span = max(x) - min(x)
    if len(nearest) == 1 or abs(x[0]) > span:
        # delta ~ force^(2/3) of a paraboloid, if only one point is known
        slope = (y[-1] - y[0]) / (x[-1] - x[0]) if len(nearest) > 1 else 2 / 3
        return math.exp(y[0] - min(max(slope, 0.0), 1.0) * x[0])
    return math.exp(_interpolate_at_zero(x, y))


def _interpolate_at_zero(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the value at x = 0 of the polynomial through the points (Neville's algorithm)."""
    values = list(y)
    for order in range(1, len(x)):
        for i in range(len(x) - order):
            values[i] = (x[i + order] * values[i] - x[i] * values[i + 1]) / (x[i + order] - x[i])
    return values[0]


def _next_depth(
    force: float, points: Sequence[ForceDepth], lower: float, upper: float, try_count: int
) -> float:
    """Return the next trial depth, by inverse interpolation or by division of the bracket.

    The bracket is divided if the interpolation leaves it or does not converge.
    """
    guess = predict_depth(force, points)
    is_stuck = try_count > 10 and try_count % 2 == 0
    if guess is not None and lower < guess < upper and not is_stuck:
        return min(guess, 4 * lower) if lower > 0 and math.isinf(upper) else guess
    if math.isinf(upper):
        return 2 * lower
    if lower > upper / 4:
        return (lower + upper) / 2
    return math.sqrt(lower * upper) if lower > 0 else upper / 4
