"""The step rule of a load path: how far its coordinate may go at once. It knows no solver."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf

SMALLEST_CUT = (
    2.0**-10
)  # of a requested step: what fails there fails for another reason than its size
MOST_FAILURES = 10  # failures without two successes between them: what still fails will
FUTILE = 600  # iterations in failures of a requested step: the costliest row that was found had 425


@dataclass(frozen=True)
class Place:
    """A place on the load path: depth [length] and time."""

    delta: float
    t: float = 0.0


@dataclass(frozen=True)
class Way:
    """The straight way between two places; its coordinate is time where it passes, depth where it
    stands still.
    """

    begin: Place
    end: Place

    @property
    def takes_time(self) -> bool:
        """Whether time passes."""
        return self.end.t != self.begin.t

    def coordinate(self, place: Place) -> float:
        """Where a place of the way is."""
        return place.t if self.takes_time else place.delta

    def place(self, coordinate: float) -> Place:
        """The place with a coordinate; the ends themselves at theirs."""
        if coordinate == self.coordinate(self.end):
            return self.end
        if not self.takes_time:
            return Place(coordinate, self.begin.t)
        share = (coordinate - self.begin.t) / (self.end.t - self.begin.t)
        return Place(self.begin.delta + share * (self.end.delta - self.begin.delta), coordinate)

    def measured(self, length: float) -> float:
        """A length of depth as one of the coordinate; without end where the depth stands still."""
        if not self.takes_time:
            return length
        deep = abs(self.end.delta - self.begin.delta)
        return length * abs(self.end.t - self.begin.t) / deep if deep else inf


class StepRule:
    """Equal steps to a target, no longer than what works: half the length after a failure, twice
    after two successes. The length is kept from one target to the next: where one has failed,
    the next target does not begin with it.
    """

    def __init__(self, limit: float = inf, free: float = 0.0, fine: float = inf):
        """limit: no step is longer; free: nothing is felt below this coordinate, no step is needed;
        fine: steps of this length are tried, however long the requested one.
        """
        self._free = free
        self._fine = fine
        self.limit = self.longest = limit  # that is tried now
        self._smallest = self._step = 0.0
        self._failures = self._successes = self._futile = 0  # successes at this length

    def begin(self, distance: float) -> None:
        """Set out for a target at this distance."""
        self._smallest = min(SMALLEST_CUT * abs(distance), self._fine)
        self._failures = 0
        self._futile = 0
        self.longest = max(self.longest, self._smallest)

    def goal(self, at: float, target: float) -> float | None:
        """The next coordinate from `at` to `target`, what is below `free` at once; None where it is
        given up.

        Given up as well is a step so short that its end is its beginning, to the last digit:
        without time or depth in it, it would work for ever.
        """
        if (
            self._failures >= MOST_FAILURES
            or self._futile >= FUTILE
            or self.longest <= self._smallest / 2
        ):
            return None
        start = max(at, self._free)
        end = max(target, self._free)
        parts = max(1, ceil(abs(end - start) / self.longest - 1e-9))
        self._step = abs(end - start) / parts
        if parts == 1:
            return target
        goal = start + (end - start) / parts
        return None if goal == at else goal

    def succeeded(self) -> None:
        """The step worked."""
        self._successes += 1
        if self._successes == 2:
            self.longest = min(2 * self.longest, self.limit)
            self._successes = 0
            self._failures = 0

    def failed(self, iterations: int = 0) -> None:
        """The step did not work, after so many iterations."""
        self._failures = self._failures + 1
        self._successes = 0
        self._futile = self._futile + iterations
        self.longest = self._step / 2
