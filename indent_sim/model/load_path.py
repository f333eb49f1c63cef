"""Load path: the sequence of prescribed depths or forces, with their times for a history."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Literal

from indent_sim.model.tip_track import TipTrack

Control = Literal["depth", "force"]


@dataclass(frozen=True)
class Unloading:
    """Rows of unloading at the end of a load path, until contact is lost.

    Attributes
    ----------
    start
        Number of the row after which unloading begins, from 1.
    rows
        Number of rows of unloading.
    to
        Smallest depth or force of unloading.
    """

    start: int
    rows: int
    to: float

    @property
    def last(self) -> int:
        """Number of the last row, from 1."""
        return self.start + self.rows


@dataclass(frozen=True)
class LoadPath:
    """Prescribed depths [length] or forces of the whole body [force], in order.

    Attributes
    ----------
    control
        "depth" or "force".
    values
        Prescribed values, one for each row of the results.
    times
        Time of each row [time]; empty without time.
    branches
        Branch of each row (approach, hold, retract); empty without time.
    turns
        For each row, the values at turning points and additional increments between the previous
        row and this row; empty if there are no such points.
    turn_times
        Times of `turns` [time].
    start_time
        Time at which the path of a time-dependent body begins [time]; None for other bodies.
    slides
        For each row, the horizontal displacement of the tip from where it was pressed in [length];
        empty if the tip does not slide.
    turn_slides
        Displacements of the tip at `turns` [length]; empty if `turns` is empty, or without a slide.
    slide_axis
        Horizontal axis along which the tip slides: 0 (x) or 1 (y).
    unloading
        The rows of unloading at the end; None if the path does not unload. For a body that yields,
        the depths of these rows are known only after the solution; until then `values` are the
        depths of an elastic body.
    """

    control: Control
    values: tuple[float, ...]
    times: tuple[float, ...] = ()
    branches: tuple[str, ...] = ()
    turns: tuple[tuple[float, ...], ...] = ()
    turn_times: tuple[tuple[float, ...], ...] = ()
    start_time: float | None = None
    slides: tuple[float, ...] = ()
    turn_slides: tuple[tuple[float, ...], ...] = ()
    slide_axis: int = 0
    unloading: Unloading | None = None

    def slide(self, step: int) -> float:
        """Return the horizontal displacement of the tip at a row [from 1, or 0: the beginning]."""
        return self.slides[step - 1] if self.slides and step else 0.0

    def segment_slides(self, step: int) -> tuple[float, ...]:
        """Return the displacement of the tip at each point of `segment` [length]."""
        if not self.slides:
            return (0.0,) * len(self.segment(step))
        if self.turn_slides:
            return (*self.turn_slides[step - 1], self.slides[step - 1])
        turns = self.turns[step - 1] if self.turns else ()
        return (self.slides[step - 1],) * (len(turns) + 1)

    def track(self, center: tuple[float, ...]) -> TipTrack:
        """Return the track of a tip that is pressed in at a horizontal position [length]."""
        ends = (0.0, *self.slides, *chain(*self.turn_slides))
        return TipTrack(center, self.slide_axis, min(ends), max(ends))

    def with_halved_increments(self) -> LoadPath:
        """Return the same path with all increments halved.

        The mean of two successive values is inserted between them, so that the number of increments
        is doubled.
        """
        rows: list[tuple[float, float, float]] = []
        turns: list[tuple[tuple[float, float, float], ...]] = []
        previous_point = (0.0, 0.0, 0.0)
        for step in range(1, len(self.values) + 1):
            points = [
                (*point, x)
                for point, x in zip(self.segment(step), self.segment_slides(step), strict=True)
            ]
            refined_points = [
                point
                for a, b in pairwise((previous_point, *points))
                for point in (_midpoint(a, b), b)
            ]
            rows += refined_points[-2:]
            turns += [tuple(refined_points[:-2]), ()]
            previous_point = refined_points[-1]
        values, times, slides = zip(*rows, strict=True)
        segment_points = (
            [tuple(zip(*segment, strict=True)) or ((), (), ()) for segment in turns]
            if self.turns
            else []
        )
        path = LoadPath(
            self.control,
            values,
            turns=tuple(depths for depths, _, _ in segment_points),
            slides=slides if self.slides else (),
            turn_slides=tuple(x for *_, x in segment_points) if self.turn_slides else (),
            slide_axis=self.slide_axis,
            unloading=self.unloading
            and replace(
                self.unloading, start=2 * self.unloading.start, rows=2 * self.unloading.rows
            ),
        )
        if self.start_time is None:
            return path
        row_times = tuple(self.start_time + t for t in times)
        turn_times = tuple(
            tuple(self.start_time + t for t in segment) for _, segment, _ in segment_points
        )
        return replace(
            path,
            times=row_times,
            branches=(*chain(*zip(self.branches, self.branches, strict=True)),),
            turn_times=turn_times,
            start_time=self.start_time,
        )

    @property
    def is_increasing(self) -> bool:
        """True if the values increase strictly."""
        steps = range(1, len(self.values) + 1)
        values = [value for step in steps for value, _ in self.segment(step)]
        return all(b > a for a, b in pairwise(values))

    @property
    def hold_count(self) -> int:
        """Number of increments in which the value does not change."""
        values = [
            0.0,
            *(value for step in range(1, len(self.values) + 1) for value, _ in self.segment(step)),
        ]
        return sum(a == b for a, b in pairwise(values))

    @property
    def sudden_rows(self) -> tuple[int, ...]:
        """Numbers of the rows [from 1] at which the value jumps, that is, changes in zero time."""
        rows = (self._sudden_points(step)[-1] for step in range(1, len(self.values) + 1))
        return tuple(step for step, is_sudden in enumerate(rows, start=1) if is_sudden)

    @property
    def has_jumps(self) -> bool:
        """True if the value jumps at a row or between two rows."""
        return any(any(self._sudden_points(step)) for step in range(1, len(self.values) + 1))

    def _sudden_points(self, step: int) -> list[bool]:
        """Return whether the value jumps at each point between the previous row and a row.

        Rows count from 1; the row itself is the last point. A value jumps if it changes in zero
        time.
        """
        previous_point = self.segment(step - 1)[-1] if step > 1 else (0.0, 0.0)
        return [
            a[1] == b[1] and a[0] != b[0]
            for a, b in pairwise((previous_point, *self.segment(step)))
        ]

    def without_sudden_rows(self) -> LoadPath:
        """Return the same path without the points at which the value jumps.

        The increment after a jump then begins before the jump. Rows at jumps are omitted; the
        points between the previous row and an omitted row are added to the next row.
        """
        rows: list[int] = []
        segments: list[list[tuple[float, float, float]]] = []
        pending_points: list[tuple[float, float, float]] = []
        for step in range(1, len(self.values) + 1):
            points = zip(
                self.segment(step),
                self.segment_slides(step),
                self._sudden_points(step),
                strict=True,
            )
            continuous_points = [(*point, x) for point, x, sudden in points if not sudden]
            pending_points += continuous_points
            if self._sudden_points(step)[-1]:
                continue
            rows.append(step - 1)
            segments.append(pending_points[:-1])
            pending_points = []
        start_time = self.start_time or 0.0
        turns: tuple[tuple[float, ...], ...] = ()
        turn_times: tuple[tuple[float, ...], ...] = ()
        turn_slides: tuple[tuple[float, ...], ...] = ()
        if any(segments):
            turns = tuple(tuple(value for value, _, _ in segment) for segment in segments)
            turn_times = tuple(tuple(start_time + t for _, t, _ in segment) for segment in segments)
        if any(segments) and self.slides:
            turn_slides = tuple(tuple(x for *_, x in segment) for segment in segments)
        return replace(
            self,
            values=tuple(self.values[row] for row in rows),
            times=tuple(self.times[row] for row in rows),
            branches=tuple(self.branches[row] for row in rows),
            turns=turns,
            turn_times=turn_times,
            slides=tuple(self.slides[row] for row in rows) if self.slides else (),
            turn_slides=turn_slides,
        )

    def first_rows(self, count: int) -> LoadPath:
        """Return the same path with only its first `count` rows."""
        return replace(
            self,
            values=self.values[:count],
            times=self.times[:count],
            branches=self.branches[:count],
            turns=self.turns[:count],
            turn_times=self.turn_times[:count],
            slides=self.slides[:count],
            turn_slides=self.turn_slides[:count],
        )

    def segment(self, step: int) -> tuple[tuple[float, float], ...]:
        """Return the values from the previous row to a row [from 1], each with its time.

        The last value belongs to the row itself. Times are measured from the beginning of the path;
        all times are 0 for a body that is not time-dependent.
        """
        values = (*(self.turns[step - 1] if self.turns else ()), self.values[step - 1])
        if self.start_time is None:
            return tuple((value, 0.0) for value in values)
        times = (*(self.turn_times[step - 1] if self.turn_times else ()), self.times[step - 1])
        return tuple((value, t - self.start_time) for value, t in zip(values, times, strict=True))

    def nondimensionalize(self, unit: float, length: float) -> LoadPath:
        """Return the same path in multiples of scales; times do not change.

        Parameters
        ----------
        unit
            Scale of the values.
        length
            Scale of the displacements `slides` [length].
        """
        turns = tuple(tuple(value / unit for value in segment) for segment in self.turns)
        return replace(
            self,
            values=tuple(value / unit for value in self.values),
            turns=turns,
            slides=tuple(x / length for x in self.slides),
            turn_slides=tuple(tuple(x / length for x in segment) for segment in self.turn_slides),
            unloading=self.unloading and replace(self.unloading, to=self.unloading.to / unit),
        )

    def with_first_values(self, values: Sequence[float]) -> LoadPath:
        """Return the same path with other values of its first rows."""
        return replace(self, values=(*values, *self.values[len(values) :]))

    @property
    def retained_rows(self) -> frozenset[int]:
        """Numbers [from 1] of the rows with kept states: starts of unloading, and the last row.

        Unloading starts at a row if the value decreases after it and no earlier value was larger.
        For a tip that slides, the rows at which it begins to slide and at which it turns are added.
        """
        rows = {len(self.values)}
        steps = [after - before for before, after in pairwise((0.0, *self.slides))]
        turning_points = enumerate(pairwise(steps), start=1)
        rows |= {row for row, (last, next_) in turning_points if next_ and last * next_ <= 0}
        deepest = float("-inf")
        for step, (value, next_value) in enumerate(pairwise(self.values), start=1):
            deepest = max(deepest, value)
            if next_value < value == deepest:
                rows.add(step)
        return frozenset(rows)


def _midpoint(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return the point halfway between two points (value, time, slide)."""
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2
