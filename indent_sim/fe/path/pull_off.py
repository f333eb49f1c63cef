"""Search for the pull-off: the smallest force on an adhesive tip during unloading.

During unloading under displacement control the force falls to a minimum. It then either rises
smoothly, as in JKR's theory, or the tip snaps off first and the force jumps towards zero. Both
cases are bracketed by three load points, the middle one having the smallest force.

A smooth minimum is found by successive parabolic interpolation (Brent 1973, Algorithms for
Minimization without Derivatives, chapter 5). A snap-off is found by bisection: it is a fold
(limit point) of the equilibrium path, near which the force varies as the square root of the
distance from the fold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt
from typing import Any

from indent_sim.fe.measured_constants import (
    FOLD_LENGTH_RATIO,
    FORCE_OSCILLATION_FACTOR,
    MAX_FORCE_OSCILLATION,
)
from indent_sim.process.errors import NotConverged

# Largest number of equilibria of a search; a smooth minimum takes one to eight.
MAX_EQUILIBRIA = 24


@dataclass(frozen=True)
class PullPoint:
    """Equilibrium of an adhesive tip at a prescribed depth.

    Attributes
    ----------
    delta, t
        Depth [length] and time [time].
    force
        Force on the tip [force], < 0 where it pulls; infinite where no equilibrium is found.
    a
        Contact radius [length]; 0 where the tip does not touch the body.
    state
        The equilibrium point from which load stepping can continue.
    number
        Number of the load point on the path, from 1; 0 for an equilibrium between load points.
    """

    delta: float
    t: float
    force: float
    a: float
    state: Any = None
    number: int = 0

    @property
    def is_touching(self) -> bool:
        """True if the tip touches the body."""
        return self.a > 0


@dataclass(frozen=True)
class UnloadingBranch:
    """Load point with the smallest force during unloading, and its two neighbours.

    Attributes
    ----------
    last
        The last load point of the path so far.
    before, lowest, after
        The load point with the smallest force and its neighbours. `before` is None where unloading
        begins at the lowest point, `after` where unloading ends there.
    """

    last: PullPoint | None = None
    before: PullPoint | None = None
    lowest: PullPoint | None = None
    after: PullPoint | None = None

    def add_point(self, point: PullPoint) -> UnloadingBranch:
        """Return the branch updated by the next load point of the path."""
        last = self.last
        point = replace(point, number=last.number + 1 if last else 1)
        if last is None or point.delta >= last.delta:
            return replace(self, last=point)
        before = self.before
        lowest = self.lowest
        after = self.after
        if lowest is None or last.force < lowest.force:  # unloading begins at the last point
            before = None
            lowest = last
            after = None
        if point.force < lowest.force:
            before = last
            lowest = point
            after = None
        elif before is not None and lowest.number == last.number:
            after = point
        return UnloadingBranch(point, before, lowest, after)

    @property
    def bracket(self) -> tuple[PullPoint, PullPoint, PullPoint] | None:
        """Three points around the smallest force in the order of the path.

        The result is None if one of these points is missing, or if the smallest force is not
        tensile.
        """
        before = self.before
        lowest = self.lowest
        after = self.after
        if before is None or lowest is None or after is None or lowest.force >= 0:
            return None
        return before, lowest, after

    @property
    def search_points(self) -> tuple[PullPoint, ...]:
        """The points `before`, `lowest` and `after`, omitting None, for a checkpoint."""
        points = (self.before, self.lowest, self.after)
        return tuple(point for point in points if point is not None)

    @classmethod
    def from_search_points(
        cls, points: tuple[PullPoint, ...], last: PullPoint | None
    ) -> UnloadingBranch:
        """Return the branch with the given `search_points` (from a checkpoint)."""
        if len(points) < 2:
            return cls(last, lowest=points[0] if points else None)
        before, lowest, *after = points
        return cls(last, before, lowest, after[0] if after else None)


def force_oscillation(elements: float) -> float:
    """Return the amplitude of the mesh-induced oscillation of the force, relative to the pull-off.

    Parameters
    ----------
    elements
        Number of elements in the cohesive zone or in the contact radius, whichever is smaller.
    """
    return min(FORCE_OSCILLATION_FACTOR / elements**2, MAX_FORCE_OSCILLATION)


@dataclass(frozen=True)
class LargestPull:
    """Result of a pull-off search.

    Attributes
    ----------
    point
        The equilibrium with the smallest force that was found.
    error
        Bound on the difference from the true smallest force [force]; infinite if there is no
        estimate.
    equilibria
        Number of equilibria that were solved.
    """

    point: PullPoint
    error: float
    equilibria: int


# Solves the equilibrium at a depth [length] between two others, starting from the first of them
SolveBetween = Callable[[PullPoint, PullPoint, float], PullPoint]


def find_largest_pull(
    before: PullPoint,
    lowest: PullPoint,
    after: PullPoint,
    solve_between: SolveBetween,
    tolerance: Callable[[PullPoint], float],
) -> LargestPull:
    """Find the smallest force between load points during unloading.

    Parameters
    ----------
    before, lowest, after
        Three equilibria in the order of the path, the force of the middle one being the smallest.
    solve_between
        Function that solves the equilibrium at a depth between two equilibria, starting from the
        first.
    tolerance
        Function that returns the relative tolerance of the force for an equilibrium.

    Raises
    ------
    NotConverged
        If there is no equilibrium at a depth that the tip has already passed.
    """
    search = _Bracket(before, lowest, after)
    error = inf
    equilibria = 0
    widths = [inf, inf]
    while equilibria < MAX_EQUILIBRIA and error > tolerance(search.best) * abs(search.best.force):
        parabola = search.parabola
        is_slow = search.width > widths[-2] / 2
        widths = [widths[-1], search.width]
        delta = search.midpoint if parabola is None or is_slow else search.next_depth(parabola)
        if delta in (search.inner.delta, search.best.delta, search.outer.delta):
            # No floating-point number lies between these depths
            return LargestPull(search.best, 0.0, equilibria)
        is_inside = delta > search.best.delta
        interval = (search.inner, search.best) if is_inside else (search.best, search.outer)
        point = solve_between(*interval, delta)
        equilibria += 1
        if is_inside and not isfinite(point.force):
            raise NotConverged(
                "no equilibrium was found at a depth that the tip has passed during unloading"
            )
        search = search.narrowed(point)
        error = search.error_bound(point, parabola)
    return LargestPull(search.best, error, equilibria)


@dataclass(frozen=True)
class _Bracket:
    """Three equilibria around the smallest force in the order of the path: inner, best, outer.

    `best` has the smallest force. `earlier` is the equilibrium before `inner`, or None.
    """

    inner: PullPoint
    best: PullPoint
    outer: PullPoint
    earlier: PullPoint | None = None

    @property
    def width(self) -> float:
        """Length of the bracket [length]."""
        return self.inner.delta - self.outer.delta

    @property
    def has_fold(self) -> bool:
        """True if the tip snaps off between `best` and `outer`: the force may jump there."""
        snaps_off = self.best.is_touching and not self.outer.is_touching
        return snaps_off or not isfinite(self.outer.force)

    @property
    def _end_of_longer_part(self) -> float:
        """Depth of `inner` or `outer`, whichever bounds the part to be divided next [length].

        `best` divides the bracket into two parts, of which the longer one is divided next. If the
        tip snaps off in the outer part, the inner part is divided only if it is FOLD_LENGTH_RATIO
        times as long as the outer part.
        """
        inner = self.inner.delta
        best = self.best.delta
        outer = self.outer.delta
        ratio = FOLD_LENGTH_RATIO if self.has_fold else 1.0
        return inner if inner - best > ratio * (best - outer) else outer

    @property
    def midpoint(self) -> float:
        """Depth at the middle of the part to be divided next [length]."""
        return (self.best.delta + self._end_of_longer_part) / 2

    @property
    def parabola(self) -> _Parabola | None:
        """Parabola through the three points; None if the force may jump between them."""
        return None if self.has_fold else _Parabola.fit_points(self.inner, self.best, self.outer)

    def next_depth(self, parabola: _Parabola) -> float:
        """Return the depth of the next equilibrium by parabolic interpolation [length]."""
        # An equilibrium so close to the best one adds no information
        if abs(parabola.delta - self.best.delta) < 0.05 * self.width:
            golden_section = (3 - sqrt(5)) / 2
            return self.best.delta + golden_section * (self._end_of_longer_part - self.best.delta)
        return parabola.delta

    def narrowed(self, point: PullPoint) -> _Bracket:
        """Return the smaller bracket that follows from one more equilibrium inside it."""
        is_inside = point.delta > self.best.delta
        is_lower = point.force < self.best.force
        if is_inside and is_lower:
            return replace(self, best=point, outer=self.best)
        if is_inside:
            return replace(self, inner=point, earlier=self.inner)
        if is_lower:
            return replace(self, inner=self.best, best=point, earlier=self.inner)
        return replace(self, outer=point)

    def error_bound(self, point: PullPoint, predicted: _Parabola | None) -> float:
        """Return a bound on the difference of `best` from the true smallest force [force].

        For a smooth force it is the difference of `best` from the parabola's minimum, plus the
        error of the previous parabola at the equilibrium that was solved last.

        Parameters
        ----------
        point
            The equilibrium that was solved last.
        predicted
            The parabola through the previous bracket; None for the first bracket.
        """
        if self.has_fold:
            return self._fold_error_bound
        parabola = self.parabola
        if predicted is None or parabola is None:
            return inf
        return abs(point.force - predicted.force_at(point.delta)) + self.best.force - parabola.force

    @property
    def _fold_error_bound(self) -> float:
        """Bound on the further decrease of the force until the tip snaps off [force].

        The force is assumed to decrease as a square root from `inner` to `best` and on to the fold,
        which lies at `outer` at the latest. The decrease is measured from `earlier`, which makes
        the bound larger: `inner` and `best` may lie on both sides of a smooth minimum and have
        equal forces by chance.
        """
        if self.earlier is None:
            return inf
        inner_length = self.inner.delta - self.best.delta
        outer_length = self.best.delta - self.outer.delta
        return (self.earlier.force - self.best.force) / (sqrt(1 + inner_length / outer_length) - 1)


@dataclass(frozen=True)
class _Parabola:
    """Force as a parabola of the depth x: force + curvature (x - delta)^2.

    Attributes
    ----------
    delta, force
        Depth [length] and force [force] of the minimum.
    curvature
        Half the second derivative [force/length^2], > 0.
    """

    delta: float
    force: float
    curvature: float

    def force_at(self, depth: float) -> float:
        """Return the force of the parabola at a depth [force]."""
        return self.force + self.curvature * (depth - self.delta) ** 2

    @classmethod
    def fit_points(cls, inner: PullPoint, best: PullPoint, outer: PullPoint) -> _Parabola | None:
        """Return the parabola through three equilibria; None if it has no minimum."""
        inner_slope = (inner.force - best.force) / (inner.delta - best.delta)
        outer_slope = (best.force - outer.force) / (best.delta - outer.delta)
        curvature = (inner_slope - outer_slope) / (inner.delta - outer.delta)
        if not curvature > 0:
            return None
        delta = (inner.delta + best.delta) / 2 - inner_slope / (2 * curvature)
        return cls(delta, best.force - curvature * (best.delta - delta) ** 2, curvature)
