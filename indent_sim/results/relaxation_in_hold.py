"""Hold of a history: how much of a force goes while the tip stands still, and how soon."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, nan

import numpy as np

from indent_sim.results.reader import Results

MIN_HOLD_ROWS = 4
FRACTION_ROUNDING = 1e-12


@dataclass(frozen=True)
class HoldRelaxation:
    """The first hold: times since it began, from 0, and forces."""

    t: np.ndarray
    force: np.ndarray

    @property
    def remaining_fraction(self) -> np.ndarray:
        """What is left of the fall: 1 where it begins, 0 at its end."""
        return np.asarray((self.force - self.force[-1]) / (self.force[0] - self.force[-1]))

    @property
    def half_time(self) -> float:
        """When half of the fall is over [time], an exponential between rows; NaN of a force that
        does not fall.
        """
        if not self.force[0] > self.force[-1]:
            return nan
        after = int(np.argmax(self.remaining_fraction <= 0.5))
        neighbours = slice(after - 1, after + 1)
        return float(
            np.interp(
                log(2),
                -np.log(np.maximum(self.remaining_fraction[neighbours], FRACTION_ROUNDING)),
                self.t[neighbours],
            )
        )


def first_hold(results: Results) -> HoldRelaxation | None:
    """The first hold of a result with a history; None where there is none, or next to nothing of
    it.
    """
    if not {"t", "branch"} <= set(results.table):
        return None
    hold_rows = np.flatnonzero(results["branch"] == "hold")
    if len(hold_rows) < MIN_HOLD_ROWS or hold_rows[0] == 0:
        return None
    ends = np.flatnonzero(np.diff(hold_rows) > 1)
    rows = np.arange(hold_rows[0] - 1, hold_rows[ends[0] if len(ends) else -1] + 1)
    return HoldRelaxation(results["t"][rows] - results["t"][rows[0]], results["force"][rows])
