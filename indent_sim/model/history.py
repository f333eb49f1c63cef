"""Loading histories: depths or forces prescribed in time, and the output rows."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

from indent_sim.model.load_path import Control, LoadPath


@dataclass(frozen=True)
class HistoryRow:
    """Output row of a history: time, prescribed value and branch (approach, hold or retract)."""

    t: float
    value: float
    branch: str


@dataclass(frozen=True)
class History:
    """Depths, base positions [length] or forces [force] prescribed in time.

    The value is linear between `points` (t, value); two equal times define a jump. Before the first
    point the body is undeformed. `times` are the times of the output rows; if empty, every point is
    a row, and rows are added between them for a smooth curve. `slide_points` (t, x) are the
    horizontal displacements of the tip from where it is pressed in [length], linear between the
    points; before the first and after the last point the tip does not slide.
    """

    control: Control
    points: tuple[tuple[float, float], ...]
    times: tuple[float, ...] = ()
    slide_points: tuple[tuple[float, float], ...] = ()

    def slide_at(self, t: float) -> float:
        """Return the horizontal displacement of the tip at a time [length]; 0 without a slide."""
        if not self.slide_points:
            return 0.0
        next_index = bisect_right(self.slide_points, (t, inf))
        if next_index == 0:
            return 0.0
        (t0, x0), (t1, x1) = (*self.slide_points, (inf, 0.0))[next_index - 1 : next_index + 1]
        return x0 + (x1 - x0) * (t - t0) / (t1 - t0) if t1 < inf else x0

    @property
    def largest_value(self) -> float:
        """Largest prescribed value."""
        return max(value for _, value in self.points)

    @property
    def duration(self) -> float:
        """Time from the first point to the last [time]."""
        return self.points[-1][0] - self.points[0][0]

    @property
    def loading_duration(self) -> float:
        """Time from the beginning of loading to the largest value [time]; 0 for a jump."""
        points = self.points_from_rest
        peak_index = max(range(len(points)), key=lambda k: (points[k][1], -k))
        start_index = max((k for k in range(peak_index) if points[k][1] <= 0), default=0)
        return points[peak_index][0] - points[start_index][0]

    @property
    def hold_duration(self) -> float:
        """Duration of a final hold at the largest value [time]; 0 without such a hold."""
        peak_index = next(
            k for k, (_, value) in enumerate(self.points) if value == self.largest_value
        )
        is_held = all(value == self.largest_value for _, value in self.points[peak_index:])
        return self.points[-1][0] - self.points[peak_index][0] if is_held else 0.0

    @property
    def shortest_segment(self) -> float:
        """Shortest non-zero time between two successive points [time]."""
        times = sorted({t for t, _ in (*self.points, *self.slide_points)})
        return min(end - start for start, end in pairwise(times) if end > start)

    @property
    def shortest_time_to_row(self) -> float:
        """Shortest time from the beginning of a segment of the history to a row inside it [time].

        Infinite if no `times` are given, because every time step is then a row.
        """
        durations = [
            t - start
            for start, end in pairwise([t for t, _ in self.points_from_rest])
            for t in self.times
            if start < t <= end
        ]
        return min(durations, default=inf)

    @property
    def has_reloading(self) -> bool:
        """True if the value increases again after a decrease."""
        steps = [next_value - value for (_, value), (_, next_value) in pairwise(self.points)]
        falls = [k for k, step in enumerate(steps) if step < 0]
        return bool(falls) and any(step > 0 for step in steps[falls[0] :])

    @property
    def has_jumps(self) -> bool:
        """True if the value jumps, also at the first point."""
        return self.points[0][1] > 0 or any(
            a[0] == b[0] and a[1] != b[1] for a, b in pairwise(self.points)
        )

    @property
    def points_from_rest(self) -> tuple[tuple[float, float], ...]:
        """The points of the history, preceded by a point at value 0 if it begins with a jump."""
        (t, value), *_ = self.points
        return ((t, 0.0), *self.points) if value > 0 else self.points

    @property
    def rows_per_segment(self) -> tuple[int, ...]:
        """Number of rows in each segment of `points_from_rest`; 1 for a jump.

        200 rows are distributed in proportion to the duration of the segments. A segment with fewer
        than 200/(number of segments) rows then gets this number of rows.
        """
        spans = [end - start for (start, _), (end, _) in pairwise(self.points_from_rest)]
        fractions = [max(span / self.duration, 1.0 / len(spans)) for span in spans]
        # A history on the elastic curve has between one and two times as many rows.
        row_count = 200
        return tuple(
            max(1, round(row_count * fraction)) if span > 0 else 1
            for fraction, span in zip(fractions, spans, strict=True)
        )

    @property
    def with_row_times_inserted(self) -> History:
        """Return the same history with its `times` as points, and `times` empty."""
        point_times = [t for t, _ in self.points]
        points = list(self.points)
        for t in sorted({*self.times} - {*point_times}):
            next_index = bisect_right(point_times, t)
            (t0, v0), (t1, v1) = self.points[next_index - 1 : next_index + 1]
            points.append((t, v0 + (v1 - v0) * (t - t0) / (t1 - t0)))
        return replace(self, points=tuple(sorted(points, key=lambda point: point[0])), times=())

    @property
    def rows(self) -> tuple[HistoryRow, ...]:
        """All output rows: the points and the rows between them; a jump has two rows."""
        points = self.points_from_rest
        history_rows = (
            []
            if len(points) > len(self.points)
            else [HistoryRow(*points[0], branch_of(points[0][1], points[1][1]))]
        )
        for ((t0, v0), (t1, v1)), rows in zip(pairwise(points), self.rows_per_segment, strict=True):
            branch = branch_of(v0, v1)
            history_rows += [
                HistoryRow(t0 + (t1 - t0) * k / rows, v0 + (v1 - v0) * k / rows, branch)
                for k in range(1, rows)
            ]
            history_rows.append(HistoryRow(t1, v1, branch))
        return tuple(history_rows)

    @property
    def path(self) -> LoadPath:
        """Load path of a body that does not depend on time.

        A segment with a moving tip has 20 rows, a hold has one row at its end, and a jump has one
        row after the jump. If `times` are given, the rows are at these times, and the points of the
        history between them are turning points.
        """
        # Rows in each segment of a history on the whole body.
        segment_rows = 20
        return self._path_at_fractions(
            lambda span, moves, x: (
                [k / segment_rows for k in range(1, segment_rows)] if moves else []
            )
        )

    def time_stepped_path(
        self, first_step: float, per_doubling: int, longest_slide: float = inf
    ) -> LoadPath:
        """Return the load path of a time-dependent body, in which every time increment is a row.

        Parameters
        ----------
        first_step : float
            First time increment of each segment [time].
        per_doubling : int
            Number of increments of each length before the length doubles. A segment with a moving
            tip has at least 5 * per_doubling increments.
        longest_slide : float
            Largest distance over which the tip slides in one increment [length].

        Returns
        -------
        LoadPath
            Path with a row at the end of each increment, or only at the given `times`, with further
            increments between the rows.
        """

        def step_fractions(span: float, moves: bool, distance: float) -> list[float]:
            """Return the ends of the increments in a segment as fractions of its span."""
            # A segment with a moving tip has at least `per_doubling` times as many time increments.
            least_steps = 5
            longest = span / (least_steps * per_doubling) if moves else inf
            if distance:
                longest = min(longest, span * longest_slide / distance)
            return [t / span for t in doubling_times(span, first_step, per_doubling, longest)]

        return replace(self._path_at_fractions(step_fractions), start_time=self.points[0][0])

    def _path_at_fractions(
        self, fractions_of: Callable[[float, bool, float], Sequence[float]]
    ) -> LoadPath:
        """Return the load path with rows at fractions of each segment's duration and at its end.

        `fractions_of(duration, tip_moves, distance)` returns the fractions of a segment along which
        the tip slides over a distance.
        """
        rows = (
            []
            if len(self.points_from_rest) > len(self.points)
            else [HistoryRow(*self.points[0], "approach")]
        )
        for (t0, v0), (t1, v1) in pairwise(self._points_of_both_motions):
            distance = abs(self.slide_at(t1) - self.slide_at(t0))
            moves = v1 != v0 or distance > 0
            fractions = fractions_of(t1 - t0, moves, distance) if t1 > t0 else ()
            branch = branch_of(v0, v1)
            rows += [
                HistoryRow(t0 + (t1 - t0) * fraction, v0 + (v1 - v0) * fraction, branch)
                for fraction in fractions
            ]
            rows.append(HistoryRow(t1, v1, branch))
        if self.times:
            return self._path_at_times(rows)
        values, times, branches = zip(
            *((row.value, row.t, row.branch) for row in rows), strict=True
        )
        slides = tuple(map(self.slide_at, times)) if self.slide_points else ()
        return LoadPath(self.control, values, times, branches, slides=slides)

    @property
    def _points_of_both_motions(self) -> tuple[tuple[float, float], ...]:
        """The points of `points_from_rest`, and the points at which the slide changes its speed."""
        points = self.points_from_rest
        first = points[0][0]
        last = points[-1][0]
        times = tuple(t for t, _ in self.slide_points if first <= t <= last)
        return replace(self, points=points, times=times).with_row_times_inserted.points

    def _path_at_times(self, rows: Sequence[HistoryRow]) -> LoadPath:
        """Return the load path with rows at `times`, and with the given rows as points in between.

        A row at a jump has the value after the jump.
        """
        value_at = dict(self.with_row_times_inserted.points)
        row_times = [row.t for row in rows]
        segments = []
        ends = [bisect_right(row_times, t) for t in self.times]
        for begin, end, t in zip((0, *ends), ends, self.times, strict=False):
            segment_rows = rows[begin:end]
            segments.append(
                segment_rows[:-1] if segment_rows and row_times[end - 1] == t else segment_rows
            )
        row_indices = (
            end - 1 if row_times[end - 1] == t else end
            for end, t in zip(ends, self.times, strict=True)
        )
        values = tuple(value_at[t] for t in self.times)
        branches = tuple(rows[row_index].branch for row_index in row_indices)
        turns = tuple(tuple(row.value for row in segment) for segment in segments)
        turn_times = tuple(tuple(row.t for row in segment) for segment in segments)
        slides: tuple[float, ...] = ()
        turn_slides: tuple[tuple[float, ...], ...] = ()
        if self.slide_points:
            slides = tuple(map(self.slide_at, self.times))
            turn_slides = tuple(tuple(map(self.slide_at, segment)) for segment in turn_times)
        return LoadPath(
            self.control,
            values,
            self.times,
            branches,
            turns,
            turn_times,
            slides=slides,
            turn_slides=turn_slides,
        )

    def nondimensionalize(self, unit: float, length: float = 1.0) -> History:
        """Return the same history in multiples of scales; times do not change.

        Parameters
        ----------
        unit : float
            Scale of the values.
        length : float
            Scale of the displacements of a slide [length].
        """
        return replace(
            self,
            points=tuple((t, value / unit) for t, value in self.points),
            slide_points=tuple((t, x / length) for t, x in self.slide_points),
        )


def doubling_times(
    span: float, first_step: float, per_doubling: int, longest: float = inf
) -> list[float]:
    """Return times between 0 and `span` whose increments grow by repeated doubling.

    Parameters
    ----------
    span : float
        End of the interval [time].
    first_step : float
        First increment [time].
    per_doubling : int
        Number of increments of each length before the length doubles.
    longest : float
        Upper bound of the increments [time].

    Returns
    -------
    list of float
        Increasing times, without 0 and `span`.
    """
    times = list[float]()
    t = 0.0
    dt = min(first_step, longest)
    while True:
        for _ in range(per_doubling):
            t += dt
            # A shorter last increment is left out.
            if t >= span * (1 - 1e-9):
                return times
            times.append(t)
        dt = min(2 * dt, longest)


def branch_of(value: float, next_value: float) -> str:
    """Return the branch between two values: "approach", "hold" or "retract"."""
    if value == next_value:
        return "hold"
    return "approach" if next_value > value else "retract"
