"""Previous rows of a path, for comparison with a new row."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, isfinite

import numpy as np

from indent_sim.model.state import State
from indent_sim.model.work import work_of_rows

RowForce = tuple[float, float, float]  # depth, force and half-width of its error bar


class PreviousRows:
    """Previous rows of a path with fast searches for the comparison with a new row.

    The cost of a comparison hardly depends on the number of rows.
    """

    def __init__(self, states: Iterable[State] = ()):
        self.last: State | None = None
        self.has_turned = False  # the path has gone back to a smaller depth
        self.max_depth = -inf
        self.largest_force = 0.0
        self.largest_side_force = 0.0
        # Length of the path along which the tip has slid.
        self.slide_distance = 0.0
        # The row whose error bar has the largest lower end.
        self._largest_force_row: RowForce | None = None
        self._columns: np.ndarray = np.empty((3, 64))  # the entries of `RowForce` by row
        self._count = 0
        for state in states:
            self.append(state)

    def __len__(self) -> int:
        return self._count

    def append(self, state: State) -> None:
        """Add the next row."""
        if self._count == self._columns.shape[1]:
            self._columns = np.concatenate([self._columns, np.empty_like(self._columns)], axis=1)
        self._columns[:, self._count] = row_force = force_interval(state)
        least_force = row_force[1] - row_force[2]
        if least_force == least_force and (
            self._largest_force_row is None
            or least_force > self._largest_force_row[1] - self._largest_force_row[2]
        ):
            self._largest_force_row = row_force
        self._count += 1
        self.has_turned |= self.last is not None and state.delta < self.last.delta
        self.max_depth = max(self.max_depth, state.delta)
        self.largest_force = max(self.largest_force, abs(state.force))
        self.slide_distance += self.slide_increment(state)
        self.largest_side_force = max(
            self.largest_side_force, abs(state.side_force_x or 0.0), abs(state.side_force_y or 0.0)
        )
        self.last = state

    def slide_increment(self, state: State) -> float:
        """Return the length by which the tip slides from the last row to a state [length]."""
        last_x = (self.last.x if self.last else None) or 0.0
        return abs((state.x or 0.0) - last_x)

    def largest_shallower_force(self, delta: float) -> RowForce | None:
        """Return the shallower row whose error bar has the largest lower end; may be None."""
        if delta > self.max_depth:
            return self._largest_force_row
        depth, force, bar = self._columns[:, : self._count]
        return self._row_at_maximum(force - bar, depth < delta)

    def smallest_deeper_force(self, delta: float) -> RowForce | None:
        """Return the deeper row whose error bar has the smallest upper end; may be None."""
        if delta >= self.max_depth:
            return None
        depth, force, bar = self._columns[:, : self._count]
        return self._row_at_maximum(-force - bar, depth > delta)

    def work_to(self, state: State) -> tuple[float, float]:
        """Return the work of the tip from first contact to the next row, and its error.

        The work is the integral of the force over the rows by trapezoids [energy]. The error has a
        factor of safety of 3; it is infinite for the first four rows with a force.
        """
        delta, force = self._columns[:2, : self._count]
        is_loaded = force != 0
        if np.count_nonzero(is_loaded) < 4:
            return 0.0, inf
        delta = delta[is_loaded]
        force = force[is_loaded]
        work = work_of_rows(
            np.array([0.0, *delta, state.delta]), np.array([0.0, *force, state.force])
        )
        safety = 3.0
        return work.value, safety * work.error

    def _row_at_maximum(self, value: np.ndarray, where: np.ndarray) -> RowForce | None:
        """Return the row with the largest value among the selected rows; None without rows."""
        if not where.any():
            return None
        depth, force, bar = self._columns[:, int(np.argmax(np.where(where, value, -inf)))]
        return float(depth), float(force), float(bar)


def force_interval(state: State) -> RowForce:
    """Return depth, force and half-width of the error bar of a row."""
    return state.delta, state.force, _error_half_width(state)


def _error_half_width(state: State) -> float:
    """Return the half-width of the error bar of a row's force [force], or 0."""
    return state.force_error if state.force_error and isfinite(state.force_error) else 0.0
