"""Step size control of a load path: the length of the next increment.

It depends only on the coordinate along the path, not on the solver.
"""

from __future__ import annotations

from math import ceil, inf, isfinite

# Shortest increment relative to the distance to the target: an increment of this length fails for
# another reason than its length
SMALLEST_STEP_FRACTION = 2.0**-10
# Largest number of failed increments between which there are no two successes in a row.
MAX_FAILURES = 10
# Largest number of Newton iterations in the failed increments to one target. The most expensive row
# that was found, under an adhesive tip, had 425.
MAX_FAILED_ITERATIONS = 600
# The same for a surface that slides around the edge of a punch: a number for the target, and one
# for each increment of the largest length. The first bounds the effort at a sharp edge, where no
# shorter increment helps; the second allows for rows of many increments.
FAILED_ITERATIONS_PER_TARGET = 150
FAILED_ITERATIONS_PER_STEP = 30


class StepSizeControl:
    """Increments of equal length to a target.

    The length is halved after a failure and doubled after two successes. It carries over from one
    target to the next, so that a length that has just failed is not tried again at once.

    Parameters
    ----------
    max_step
        Longest increment.
    no_contact_below
        Coordinate below which the tip does not act on the body, so that no increments are needed.
    always_tried_step
        Increments down to this length are tried, however long the distance to the target is.
    slides_around_edge
        True if the surface slides around the edge of a punch, in which case a path is given up
        earlier.
    """

    def __init__(
        self,
        max_step: float = inf,
        no_contact_below: float = 0.0,
        always_tried_step: float = inf,
        *,
        slides_around_edge: bool = False,
    ):
        self._slides_around_edge = slides_around_edge
        self._no_contact_below = no_contact_below
        self._always_tried_step = always_tried_step
        self.max_step = max_step
        self.step_limit = max_step  # longest increment at present
        self._smallest_step = 0.0
        self._step = 0.0
        self._failures = 0  # without two successes in a row between them
        self._successes = 0  # consecutive, with the present step limit
        self._failed_iterations = 0  # since the last target was reached
        self._max_failed_iterations = MAX_FAILED_ITERATIONS

    def begin_target(self, distance: float) -> None:
        """Begin the increments to a target at the given distance."""
        self._smallest_step = min(SMALLEST_STEP_FRACTION * abs(distance), self._always_tried_step)
        self._failures = 0
        self._failed_iterations = 0
        if self._slides_around_edge and isfinite(self.max_step):
            step_count = ceil(abs(distance) / self.max_step)
            self._max_failed_iterations = (
                FAILED_ITERATIONS_PER_TARGET + FAILED_ITERATIONS_PER_STEP * step_count
            )
        self.step_limit = max(self.step_limit, self._smallest_step)

    def next_target(self, coordinate: float, target: float) -> float | None:
        """Return the end of the next increment from a coordinate to the target; None to give up.

        The control gives up after too many failures or iterations, below the smallest step, and if
        the end of the increment equals its beginning in floating point.
        """
        if (
            self._failures >= MAX_FAILURES
            or self._failed_iterations >= self._max_failed_iterations
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
        """Record that the increment converged, and adapt the step length."""
        self._successes += 1
        if self._successes == 2:
            self.step_limit = min(2 * self.step_limit, self.max_step)
            self._successes = 0
            self._failures = 0

    def record_failure(self, iterations: int = 0) -> None:
        """Record that the increment failed after a number of Newton iterations."""
        self._failures = self._failures + 1
        self._successes = 0
        self._failed_iterations = self._failed_iterations + iterations
        self.step_limit = self._step / 2
