"""The step rule of a load path: how far the depth may go at once. It knows no solver."""

from __future__ import annotations

from math import ceil, inf

SMALLEST_CUT = 2.0**-10  # of a requested step: what fails there fails for another reason than its size
PATIENCE = 10  # failures in a requested step: what still fails will


class StepRule:
    """Equal steps to a target, no longer than what works: half the length after a failure, twice after two successes.

    The length is kept from one target to the next: where one has failed, the next target does not begin with it.
    """

    def __init__(self, limit: float = inf, free: float = 0.0, fine: float = inf):
        """limit: no step is longer; free: nothing is felt below this depth, and no step needed; fine: steps of this
        length are tried, however long the requested one [length]."""
        self._free, self._fine = free, fine
        self.limit = self.longest = limit  # that is tried now
        self._smallest = self._step = 0.0
        self._failures = self._successes = 0  # successes at this length

    def begin(self, distance: float) -> None:
        """Set out for a target at this distance [length]."""
        self._smallest, self._failures = min(SMALLEST_CUT * abs(distance), self._fine), 0
        self.longest = max(self.longest, self._smallest)

    def goal(self, at: float, target: float) -> float | None:
        """The next depth on the way from `at` to `target` [length]; None where it is given up.

        The part of the way out of contact, below the depth `free`, is gone at once.
        """
        if self._failures >= PATIENCE or self.longest <= self._smallest / 2:
            return None
        start, end = max(at, self._free), max(target, self._free)
        parts = max(1, ceil(abs(end - start) / self.longest - 1e-9))
        self._step = abs(end - start) / parts
        return target if parts == 1 else start + (end - start) / parts

    def succeeded(self) -> None:
        """The step worked."""
        self._successes += 1
        if self._successes == 2:
            self.longest, self._successes = min(2 * self.longest, self.limit), 0

    def failed(self) -> None:
        """The step did not work."""
        self._failures, self._successes = self._failures + 1, 0
        self.longest = self._step / 2
