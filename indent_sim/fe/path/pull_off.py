"""Pull-off: the largest pull of a tip that adheres, between the rows around the largest one.

On the way out the force on the tip falls to its smallest value. Under a prescribed depth it then
either rises smoothly, as JKR's does, or the tip comes off before and the force jumps towards zero.
Both are bracketed by three rows, of which the middle one has the smallest force.

A smooth minimum is found by successive parabolic interpolation (Brent 1973, Algorithms for
Minimization without Derivatives, chapter 5), a jump by bisection: it is a fold of the equilibrium
path, near which the force goes as the square root of the distance from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt
from typing import Any

from indent_sim.process.errors import NotConverged

# The force over the depth has waves, as the edge of contact passes from element to element. Their
# amplitude, relative to the largest pull, is of second order in the elements: times the square of
# their number in the cohesive zone or in the contact radius, whichever are fewer, it was 0.002 to
# 0.02 on 0.7 to 11 elements at Maugis' lambda 0.5 to 2.5, and 0.0075 at most. Measured as the
# largest deviation from a polynomial of degree 6 over 60 rows around pull-off
# (tests/physics/test_pull_off.py).
WAVES, HIGHEST_WAVES = 0.02, 0.008
# A search need not be finer, relative to the largest pull: on 11 elements in the cohesive zone the
# force is known to 2e-4 (docs/verification.md)
FINEST = 1e-4
MOST_EQUILIBRIA = 24  # of a search; a smooth minimum takes one to eight
# The part of a bracket within which a parabola's minimum is no news of the row that it is next to
BESIDE = 0.05
GOLDEN = (3 - sqrt(5)) / 2
# Next to a fold two in three equilibria are tried beyond `best`, and one to see whether the force
# has had a minimum before: with 1 a search takes a third more of them, with 8 a twentieth less
MUCH_LONGER = 4.0


@dataclass(frozen=True)
class Pull:
    """An equilibrium of a tip at a depth, with what the path needs to go on from it.

    Attributes
    ----------
    delta, t
        Depth [length] and time.
    force
        Force on the tip [force], < 0 where it pulls; infinite where no equilibrium is found.
    a
        Contact radius [length]; 0 where the tip does not touch the body.
    state
        The equilibrium itself.
    number
        Its number among the places that the path asks for, from 1; 0 of any other.
    """

    delta: float
    t: float
    force: float
    a: float
    state: Any = None
    number: int = 0

    @property
    def touches(self) -> bool:
        """Whether the tip touches the body."""
        return self.a > 0


@dataclass(frozen=True)
class WayOut:
    """The places around the one that pulls most, among those that a path asks for on its ways out.

    Those are its rows, and the places that it passes between rows at given times.

    Attributes
    ----------
    last
        The last place.
    before, lowest, after
        The place with the smallest force and its neighbours. `before` is missing where the tip has
        turned there, `after` where it turns or the path ends.
    """

    last: Pull | None = None
    before: Pull | None = None
    lowest: Pull | None = None
    after: Pull | None = None

    def followed_by(self, place: Pull) -> WayOut:
        """The same with one more place."""
        last = self.last
        place = replace(place, number=last.number + 1 if last else 1)
        if last is None or place.delta >= last.delta:
            return replace(self, last=place)
        before, lowest, after = self.before, self.lowest, self.after
        if lowest is None or last.force < lowest.force:  # the tip has turned there
            before, lowest, after = None, last, None
        if place.force < lowest.force:
            before, lowest, after = last, place, None
        elif before is not None and lowest.number == last.number:
            after = place
        return WayOut(place, before, lowest, after)

    @property
    def bracket(self) -> tuple[Pull, Pull, Pull] | None:
        """The places between which the tip pulls most, outwards; None where there are none."""
        before, lowest, after = self.before, self.lowest, self.after
        if before is None or lowest is None or after is None or lowest.force >= 0:
            return None
        return before, lowest, after

    @property
    def kept(self) -> tuple[Pull, ...]:
        """The places that a search would set out from, or whose force a smaller one has to beat."""
        places = (self.before, self.lowest, self.after)
        return tuple(place for place in places if place is not None)

    @classmethod
    def of(cls, kept: tuple[Pull, ...], last: Pull | None) -> WayOut:
        """What has these places as `kept`."""
        if len(kept) < 2:
            return cls(last, lowest=kept[0] if kept else None)
        before, lowest, *after = kept
        return cls(last, before, lowest, after[0] if after else None)


def waves(elements: float) -> float:
    """The amplitude of the waves of the force, relative to it, on so many elements."""
    return min(WAVES / elements**2, HIGHEST_WAVES)


@dataclass(frozen=True)
class Found:
    """The largest pull that was found.

    Attributes
    ----------
    pull
        The equilibrium that pulls most.
    error
        By how much a smaller force may have been missed [force]; infinite where that is not known.
    equilibria
        How many were sought.
    """

    pull: Pull
    error: float
    equilibria: int


Go = Callable[[Pull, Pull, float], Pull]


def largest_pull(
    before: Pull,
    lowest: Pull,
    after: Pull,
    go: Go,
    tolerance: Callable[[Pull], float],
) -> Found:
    """Find the smallest force between two equilibria on the way out.

    Parameters
    ----------
    before, lowest, after
        Three equilibria in turn, outwards, the force of the middle one being the smallest.
    go
        Finds an equilibrium from the first of two others, at a depth on the way to the second.
    tolerance
        The error at which the search ends, relative to the force of an equilibrium.

    Raises
    ------
    NotConverged
        Where there is no equilibrium at a depth from which the tip has been further out.
    """
    search = _Search(before, lowest, after)
    error, equilibria, widths = inf, 0, [inf, inf]
    while equilibria < MOST_EQUILIBRIA and error > tolerance(search.best) * abs(search.best.force):
        expected = search.parabola
        is_slow = search.width > widths[-2] / 2
        widths = [widths[-1], search.width]
        delta = search.halfway if expected is None or is_slow else search.place(expected)
        if delta in (search.inner.delta, search.best.delta, search.outer.delta):
            return Found(search.best, 0.0, equilibria)  # no number lies between
        is_inside = delta > search.best.delta
        way = (search.inner, search.best) if is_inside else (search.best, search.outer)
        tried = go(*way, delta)
        equilibria += 1
        if is_inside and not isfinite(tried.force):
            passed = "at a depth that the tip has passed on its way out"
            raise NotConverged(f"no equilibrium was found {passed}")
        search = search.with_one_more(tried, is_inside)
        error = search.missed(tried, expected)
    return Found(search.best, error, equilibria)


@dataclass(frozen=True)
class _Search:
    """A bracket of the smallest force, that of `best`: three equilibria in turn, outwards.

    `earlier` is the equilibrium next to `inner`, further in, as far as one was found.
    """

    inner: Pull
    best: Pull
    outer: Pull
    earlier: Pull | None = None

    @property
    def width(self) -> float:
        """The length of the bracket [length]."""
        return self.inner.delta - self.outer.delta

    @property
    def may_jump(self) -> bool:
        """Whether the tip has come off between `best` and `outer`, where the force may jump."""
        comes_off = self.best.touches and not self.outer.touches
        return comes_off or not isfinite(self.outer.force)

    @property
    def _longer_end(self) -> float:
        """The end of the part of the bracket that is divided next [length]: of the longer one.

        Where the tip has come off the inner one is not before it is much longer.
        """
        inner, best, outer = self.inner.delta, self.best.delta, self.outer.delta
        ratio = MUCH_LONGER if self.may_jump else 1.0
        return inner if inner - best > ratio * (best - outer) else outer

    @property
    def halfway(self) -> float:
        """The middle of the longer part of the bracket [length]."""
        return (self.best.delta + self._longer_end) / 2

    @property
    def parabola(self) -> _Parabola | None:
        """The parabola through the three; None where the force may jump."""
        return None if self.may_jump else _Parabola.through(self.inner, self.best, self.outer)

    def place(self, expected: _Parabola) -> float:
        """The depth to try next where the force is expected on a parabola [length]."""
        if abs(expected.delta - self.best.delta) < BESIDE * self.width:
            return self.best.delta + GOLDEN * (self._longer_end - self.best.delta)
        return expected.delta

    def with_one_more(self, tried: Pull, is_inside: bool) -> _Search:
        """The bracket with one more equilibrium, between `inner` and `best` or beyond `best`."""
        is_lower = tried.force < self.best.force
        if is_inside and is_lower:
            return replace(self, best=tried, outer=self.best)
        if is_inside:
            return replace(self, inner=tried, earlier=self.inner)
        if is_lower:
            return replace(self, inner=self.best, best=tried, earlier=self.inner)
        return replace(self, outer=tried)

    def missed(self, tried: Pull, expected: _Parabola | None) -> float:
        """By how much the force may be smaller than that of `best` [force].

        On a smooth curve as much as the parabola through the three expects, and as the one before
        was wrong at the last equilibrium.
        """
        if self.may_jump:
            return self._before_a_fold
        following = self.parabola
        if expected is None or following is None:
            return inf
        return abs(tried.force - expected.at(tried.delta)) + self.best.force - following.force

    @property
    def _before_a_fold(self) -> float:
        """By how much the force may fall further until the tip comes off [force].

        As much as a square root would that has fallen to `best` on the way from `inner`, and ends
        at `outer` at the latest. It has fallen from `earlier` instead, which is more: `inner` and
        `best` may lie on both sides of a smooth minimum, with forces that are equal by chance.
        """
        if self.earlier is None:
            return inf
        passed = self.inner.delta - self.best.delta
        left = self.best.delta - self.outer.delta
        return (self.earlier.force - self.best.force) / (sqrt(1 + passed / left) - 1)


@dataclass(frozen=True)
class _Parabola:
    """A force that goes as force + curvature (x - delta)^2 with the depth x, curvature > 0."""

    delta: float
    force: float
    curvature: float

    def at(self, x: float) -> float:
        """The force at a depth x."""
        return self.force + self.curvature * (x - self.delta) ** 2

    @classmethod
    def through(cls, inner: Pull, best: Pull, outer: Pull) -> _Parabola | None:
        """The parabola through three equilibria in turn; None where they are on a straight line."""
        rise_in = (inner.force - best.force) / (inner.delta - best.delta)
        rise_out = (best.force - outer.force) / (best.delta - outer.delta)
        curvature = (rise_in - rise_out) / (inner.delta - outer.delta)
        if not curvature > 0:
            return None
        delta = (inner.delta + best.delta) / 2 - rise_in / (2 * curvature)
        return cls(delta, best.force - curvature * (best.delta - delta) ** 2, curvature)
