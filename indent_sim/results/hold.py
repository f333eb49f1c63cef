"""Hold of a history: how much of a force goes while the tip stands still, and how soon."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, nan

import numpy as np

from indent_sim.results.reader import Results

LEAST_ROWS = 4
SHARE_ROUNDING = 1e-12


@dataclass(frozen=True)
class Hold:
    """The first hold: times since it began, from 0, and forces."""

    t: np.ndarray
    force: np.ndarray

    @property
    def share(self) -> np.ndarray:
        """What is left of the fall: 1 where it begins, 0 at its end."""
        return np.asarray((self.force - self.force[-1]) / (self.force[0] - self.force[-1]))

    @property
    def half_time(self) -> float:
        """When half of the fall is over [time], an exponential between rows; NaN of a force that
        does not fall.
        """
        if not self.force[0] > self.force[-1]:
            return nan
        after = int(np.argmax(self.share <= 0.5))
        near = slice(after - 1, after + 1)
        return float(
            np.interp(log(2), -np.log(np.maximum(self.share[near], SHARE_ROUNDING)), self.t[near])
        )


def first_hold(results: Results) -> Hold | None:
    """The first hold of a result with a history; None where there is none, or next to nothing of
    it.
    """
    if not {"t", "branch"} <= set(results.table):
        return None
    held = np.flatnonzero(results["branch"] == "hold")
    if len(held) < LEAST_ROWS or held[0] == 0:
        return None
    ends = np.flatnonzero(np.diff(held) > 1)
    rows = np.arange(held[0] - 1, held[ends[0] if len(ends) else -1] + 1)
    return Hold(results["t"][rows] - results["t"][rows[0]], results["force"][rows])
