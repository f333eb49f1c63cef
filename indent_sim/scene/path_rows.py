"""Rows of a load path in time, with the preceding load changes that cause drainage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np

from indent_sim.model.load_path import LoadPath
from indent_sim.theory.drained_layer import drained_length, excess_length


@dataclass
class PathSegment:
    """Segment of a path with a constant rate, or a jump.

    Attributes
    ----------
    begin, end
        Times at the beginning and the end of the segment [time]; they are equal for a jump.
    change
        Change of the depth or force, divided by the largest value of the path.
    """

    begin: float
    end: float
    change: float

    @property
    def rate(self) -> float:
        """Return the change per time [1/time]; infinity for a jump."""
        return self.change / (self.end - self.begin) if self.end > self.begin else inf


@dataclass(frozen=True)
class PathRow:
    """Row of a path in time, with the preceding changes of the load.

    Attributes
    ----------
    changes
        Absolute changes (n,) of the depth or force until this row.
    elapsed
        Times (n,) since each change began [time].
    durations
        Durations (n,) of the changes [time]; 0 for a jump.
    value
        Depth or force of the row. Value and changes are relative to the largest value of the path.
    """

    changes: np.ndarray
    elapsed: np.ndarray
    durations: np.ndarray
    value: float

    def drained_length(self, diffusivity: float) -> float:
        """Return the drained thickness of the body [length], weighted with the load changes.

        The result is the sum of the theory's `drained_length` over all changes of the load. Each
        change is weighted by its pressure divided by the pressure at the largest value of the path.
        """
        return float(self.changes @ drained_length(diffusivity, self.elapsed, self.durations))

    def excess_length(self, h: np.ndarray, diffusivity: float) -> np.ndarray:
        """Return the overestimate [length] of the drained length (m,) by elements of sizes h (m,).

        The result is the sum of the theory's `excess_length` over all changes of the load.
        """
        lengths = drained_length(diffusivity, self.elapsed, self.durations)
        return excess_length(h[:, None], lengths) @ self.changes


def path_rows(path: LoadPath) -> list[PathRow]:
    """Return the rows of a path in time, each with the last 30 changes of the load before it.

    A jump at the time of a row is not included, because no fluid has drained since. A path without
    a positive depth or force has no rows, because no pore pressure arises.
    """
    largest = max(path.values)
    if largest <= 0:
        return []
    increments = [path.segment(step) for step in range(1, len(path.values) + 1)]
    segments = _merge_segments(
        [(0.0, 0.0), *((value / largest, t) for increment in increments for value, t in increment)]
    )
    begins, ends, changes = np.array(
        [(segment.begin, segment.end, segment.change) for segment in segments if segment.change]
    ).T
    rows = []
    # Number of changes of the load before a row that are considered: the boundary layers of earlier
    # changes have grown thick.
    max_changes = 30
    for increment in increments:
        value, t = increment[-1]
        change_count = int(np.searchsorted(begins, t))
        recent = slice(max(change_count - max_changes, 0), change_count)
        elapsed = t - begins[recent]
        full_durations = ends[recent] - begins[recent]
        durations = np.minimum(elapsed, full_durations)
        done_fractions = np.divide(
            durations, full_durations, out=np.ones_like(durations), where=full_durations > 0
        )
        rows.append(
            PathRow(np.abs(changes[recent] * done_fractions), elapsed, durations, value / largest)
        )
    return rows


def _merge_segments(points: Sequence[tuple[float, float]]) -> list[PathSegment]:
    """Return the segments between points (value, time); segments of equal rate are merged."""
    segments: list[PathSegment] = []
    # Relative difference of the rates of two segments up to which they are one.
    rate_tolerance = 1e-6
    for (previous_value, begin), (value, end) in pairwise(points):
        segment = PathSegment(begin, end, value - previous_value)
        if (
            segments
            and end > begin
            and abs(segment.rate - segments[-1].rate) <= rate_tolerance * abs(segment.rate)
        ):
            segments[-1].end = end
            segments[-1].change = segments[-1].change + segment.change
        elif end > begin or value != previous_value:
            segments.append(segment)
    return segments
