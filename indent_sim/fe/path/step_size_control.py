"""The step rule of a load path: how far its coordinate may go at once. It knows no solver."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf

SMALLEST_STEP_FRACTION = (
    2.0**-10
)  # of a requested step: what fails there fails for another reason than its size
MOST_FAILURES = 10  # failures without two successes between them: what still fails will
MOST_FAILED_ITERATIONS = (
    600  # iterations in failures of a requested step: the costliest row that was found had 425
)


@dataclass(frozen=True)
class LoadPoint:
    """A place on the load path: depth [length] and time."""

    delta: float
    t: float = 0.0


@dataclass(frozen=True)
class LoadSegment:
    """The straight way between two places; its coordinate is time where it passes, depth where it
    stands still.
    """

    begin: LoadPoint
    end: LoadPoint

    @property
    def has_duration(self) -> bool:
        """Whether time passes."""
        return self.end.t != self.begin.t

    def coordinate(self, load_point: LoadPoint) -> float:
        """Where a place of the way is."""
        return load_point.t if self.has_duration else load_point.delta

    def load_point(self, coordinate: float) -> LoadPoint:
        """The place with a coordinate; the ends themselves at theirs."""
        if coordinate == self.coordinate(self.end):
            return self.end
        if not self.has_duration:
            return LoadPoint(coordinate, self.begin.t)
        fraction = (coordinate - self.begin.t) / (self.end.t - self.begin.t)
        return LoadPoint(
            self.begin.delta + fraction * (self.end.delta - self.begin.delta), coordinate
        )

    def coordinate_length(self, length: float) -> float:
        """A length of depth as one of the coordinate; without end where the depth stands still."""
        if not self.has_duration:
            return length
        depth_change = abs(self.end.delta - self.begin.delta)
        return length * abs(self.end.t - self.begin.t) / depth_change if depth_change else inf


class StepSizeControl:
    """Equal steps to a target, no longer than what works: half the length after a failure, twice
    after two successes. The length is kept from one target to the next: where one has failed,
    the next target does not begin with it.
    """

    def __init__(
        self, limit: float = inf, no_contact_below: float = 0.0, finest_tried: float = inf
    ):
        """limit: no step is longer; free: nothing is felt below this coordinate, no step is needed;
        fine: steps of this length are tried, however long the requested one.
        """
        self._no_contact_below = no_contact_below
        self._finest_tried = finest_tried
        self.max_step = self.step_limit = limit  # that is tried now
        self._smallest_step = self._step = 0.0
        self._failures = self._successes = self._failed_iterations = 0  # successes at this length

    def begin_target(self, distance: float) -> None:
        """Set out for a target at this distance."""
        self._smallest_step = min(SMALLEST_STEP_FRACTION * abs(distance), self._finest_tried)
        self._failures = 0
        self._failed_iterations = 0
        self.step_limit = max(self.step_limit, self._smallest_step)

    def next_target(self, coordinate: float, target: float) -> float | None:
        """The next coordinate from `coordinate` to `target`, what is below `free` at once; None where it is
        given up.

        Given up as well is a step so short that its end is its beginning, to the last digit:
        without time or depth in it, it would work for ever.
        """
        if (
            self._failures >= MOST_FAILURES
            or self._failed_iterations >= MOST_FAILED_ITERATIONS
            or self.step_limit <= self._smallest_step / 2
        ):
            return None
        start = max(coordinate, self._no_contact_below)
        end = max(target, self._no_contact_below)
        step_count = max(1, ceil(abs(end - start) / self.step_limit - 1e-9))
        self._step = abs(end - start) / step_count
        if step_count == 1:
            return target
        next_coordinate = start + (end - start) / step_count
        return None if next_coordinate == coordinate else next_coordinate

    def record_success(self) -> None:
        """The step worked."""
        self._successes += 1
        if self._successes == 2:
            self.step_limit = min(2 * self.step_limit, self.max_step)
            self._successes = 0
            self._failures = 0

    def record_failure(self, iterations: int = 0) -> None:
        """The step did not work, after so many iterations."""
        self._failures = self._failures + 1
        self._successes = 0
        self._failed_iterations = self._failed_iterations + iterations
        self.step_limit = self._step / 2
