"""Stress relaxation in the first hold of a history: decrease of the force, and half-time."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, nan

import numpy as np

from indent_sim.results.reader import Results


@dataclass(frozen=True)
class HoldRelaxation:
    """Relaxation in the first hold of a history.

    Attributes
    ----------
    t
        Times since the hold began (rows,) [time], from 0.
    force
        Forces (rows,) [force].
    """

    t: np.ndarray
    force: np.ndarray

    @property
    def remaining_fraction(self) -> np.ndarray:
        """Normalized force relaxation (F - F_end)/(F_start - F_end) in the hold (rows,)."""
        return np.asarray((self.force - self.force[-1]) / (self.force[0] - self.force[-1]))

    @property
    def half_time(self) -> float:
        """Time after which half of the force relaxation is complete [time]; NaN without relaxation.

        Between two rows the force is interpolated by an exponential function of time.
        """
        if not self.force[0] > self.force[-1]:
            return nan
        after = int(np.argmax(self.remaining_fraction <= 0.5))
        neighbours = slice(after - 1, after + 1)
        rounding = 1e-12
        return float(
            np.interp(
                log(2),
                -np.log(np.maximum(self.remaining_fraction[neighbours], rounding)),
                self.t[neighbours],
            )
        )


def first_hold(results: Results) -> HoldRelaxation | None:
    """Return the first hold of a result; None without a history or if the hold has too few rows."""
    if not {"t", "branch"} <= set(results.table):
        return None
    hold_rows = np.flatnonzero(results["branch"] == "hold")
    min_rows = 4
    if len(hold_rows) < min_rows or hold_rows[0] == 0:
        return None
    ends = np.flatnonzero(np.diff(hold_rows) > 1)
    rows = np.arange(hold_rows[0] - 1, hold_rows[ends[0] if len(ends) else -1] + 1)
    return HoldRelaxation(results["t"][rows] - results["t"][rows[0]], results["force"][rows])
