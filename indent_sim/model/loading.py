"""The path of the tip: which depths or forces are asked for, one after another or in time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from math import inf
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, Len

from indent_sim.model.units import FORCE, LENGTH, TIME, Auto, Coordinate, Length, UnitRow

MAX_STEPS = 100_000
MAX_HISTORY_POINTS = 10_000
HISTORY_ROWS = 200  # of a history on the elastic curve at least, and at most as many more
LEAST_STEP_FRACTION = 1e-9  # of a piece: a last step shorter than that is none
ROWS_PER_SEGMENT = 20  # of each piece of a history on the whole body
LEAST_STEPS_PER_SEGMENT = 5  # times the steps of each length, the least of a piece that moves
Force = Annotated[float, Gt(0), FORCE]
HistoryPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, LENGTH))]
ForceHistoryPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, FORCE))]
PATH_KEYS = (
    "delta",
    "deltas",
    "force",
    "forces",
    "history",
    "force_history",
)  # to say the path, one of them
STEPS_PER_DOUBLING = 4
MAX_STEPS_PER_DOUBLING = 1000
STEPPED_KEYS = ("delta", "force")  # those that have steps
Control = Literal["depth", "force"]


@dataclass(frozen=True)
class LoadPath:
    """What is prescribed, and its values in order: depths [length], or forces of the whole body
    [force]; in time, the time and the branch of each too, and the values that the tip passes
    before it, where it turns between two rows.

    begin: when a body that takes time sets out [time], None of any other; `passed`: the times of
    its turns.
    """

    control: Control
    values: tuple[float, ...]
    times: tuple[float, ...] = ()
    branches: tuple[str, ...] = ()
    turns: tuple[tuple[float, ...], ...] = ()
    turn_times: tuple[tuple[float, ...], ...] = ()
    start_time: float | None = None

    def with_halved_increments(self) -> LoadPath:
        """The same in steps half as long: between each two values the mean of them, two rows for
        each.
        """
        rows: list[tuple[float, float]] = []
        turns: list[tuple[tuple[float, float], ...]] = []
        previous_point = (0.0, 0.0)
        for step in range(1, len(self.values) + 1):
            refined_points = [
                point
                for a, b in pairwise((previous_point, *self.segment(step)))
                for point in (_midpoint(a, b), b)
            ]
            rows += refined_points[-2:]
            turns += [tuple(refined_points[:-2]), ()]
            previous_point = refined_points[-1]
        values, times = zip(*rows, strict=True)
        segment_points = (
            [tuple(zip(*segment, strict=True)) or ((), ()) for segment in turns]
            if self.turns
            else []
        )
        path = LoadPath(self.control, values, turns=tuple(depths for depths, _ in segment_points))
        if self.start_time is None:
            return path
        row_times = tuple(self.start_time + t for t in times)
        turn_times = tuple(
            tuple(self.start_time + t for t in segment) for _, segment in segment_points
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
        """Whether every value is larger than those before it."""
        return not any(self.turns) and all(b > a for a, b in pairwise(self.values))

    @property
    def hold_count(self) -> int:
        """How many steps there are in which the value stays what it is."""
        values = [
            0.0,
            *(value for step in range(1, len(self.values) + 1) for value, _ in self.segment(step)),
        ]
        return sum(a == b for a, b in pairwise(values))

    @property
    def sudden_rows(self) -> tuple[int, ...]:
        """The rows [from 1] to which no time passes, though the value changes."""
        rows = (self._sudden_points(step)[-1] for step in range(1, len(self.values) + 1))
        return tuple(step for step, is_sudden in enumerate(rows, start=1) if is_sudden)

    @property
    def has_jumps(self) -> bool:
        """Whether a value changes in no time, at a row or on the way to one."""
        return any(any(self._sudden_points(step)) for step in range(1, len(self.values) + 1))

    def _sudden_points(self, step: int) -> list[bool]:
        """For each place of the leg to a row [from 1] whether the value gets there in no time."""
        previous_point = self.segment(step - 1)[-1] if step > 1 else (0.0, 0.0)
        return [
            a[1] == b[1] and a[0] != b[0]
            for a, b in pairwise((previous_point, *self.segment(step)))
        ]

    def without_sudden_rows(self) -> LoadPath:
        """The same path without the places that it reaches in no time: the step after a jump begins
        before the jump. Rows among them are left out, and what is passed on the way to them is
        passed on the way to the next row.
        """
        rows: list[int] = []
        segments: list[list[tuple[float, float]]] = []
        pending_points: list[tuple[float, float]] = []
        for step in range(1, len(self.values) + 1):
            continuous_points = [
                point
                for point, sudden in zip(self.segment(step), self._sudden_points(step), strict=True)
                if not sudden
            ]
            pending_points += continuous_points
            if self._sudden_points(step)[-1]:
                continue
            rows.append(step - 1)
            segments.append(pending_points[:-1])
            pending_points = []
        start_time = self.start_time or 0.0
        has_turns = any(segments)
        return replace(
            self,
            values=tuple(self.values[row] for row in rows),
            times=tuple(self.times[row] for row in rows),
            branches=tuple(self.branches[row] for row in rows),
            turns=tuple(tuple(value for value, _ in segment) for segment in segments)
            if has_turns
            else (),
            turn_times=tuple(tuple(start_time + t for _, t in segment) for segment in segments)
            if has_turns
            else (),
        )

    def segment(self, step: int) -> tuple[tuple[float, float], ...]:
        """The values on the way to a step [from 1], its own the last, each with the time since the
        path's begin; no time passes for a body that takes none.
        """
        values = (*(self.turns[step - 1] if self.turns else ()), self.values[step - 1])
        if self.start_time is None:
            return tuple((value, 0.0) for value in values)
        times = (*(self.turn_times[step - 1] if self.turn_times else ()), self.times[step - 1])
        return tuple((value, t - self.start_time) for value, t in zip(values, times, strict=True))

    def nondimensionalize(self, unit: float) -> LoadPath:
        """The same with values in a unit; times stay."""
        turns = tuple(tuple(value / unit for value in segment) for segment in self.turns)
        return replace(self, values=tuple(value / unit for value in self.values), turns=turns)

    @property
    def retained_rows(self) -> frozenset[int]:
        """The steps whose states are worth keeping, from 1: the last, and those from which the tip
        goes back after it was nowhere deeper (or, where forces are prescribed, pressed no
        harder).
        """
        rows = {len(self.values)}
        deepest = float("-inf")
        for step, (value, next_value) in enumerate(pairwise(self.values), start=1):
            deepest = max(deepest, value)
            if next_value < value == deepest:
                rows.add(step)
        return frozenset(rows)


@dataclass(frozen=True)
class HistoryRow:
    """A row of a history: the time [time], what is prescribed there, and whether the tip
    approaches, holds or retracts.
    """

    t: float
    value: float
    branch: str


@dataclass(frozen=True)
class History:
    """Depths, ways of a base [length] or forces [force] in time: `points` (t, value), straight
    between them; two equal times are a jump. Before the first point the body is at rest.
    `times`: of the rows; none: every point and, between them, enough for a curve.
    """

    control: Control
    points: tuple[tuple[float, float], ...]
    times: tuple[float, ...] = ()

    @property
    def largest_value(self) -> float:
        """The largest value."""
        return max(value for _, value in self.points)

    @property
    def duration(self) -> float:
        """From the first point to the last [time]."""
        return self.points[-1][0] - self.points[0][0]

    @property
    def loading_duration(self) -> float:
        """From where the tip sets out to where its value is the largest [time]; a jump takes none."""
        points = self.points_from_rest
        peak_index = max(range(len(points)), key=lambda k: (points[k][1], -k))
        start_index = max((k for k in range(peak_index) if points[k][1] <= 0), default=0)
        return points[peak_index][0] - points[start_index][0]

    @property
    def hold_duration(self) -> float:
        """From its largest value to the end where it stays there [time], else 0."""
        peak_index = next(
            k for k, (_, value) in enumerate(self.points) if value == self.largest_value
        )
        is_held = all(value == self.largest_value for _, value in self.points[peak_index:])
        return self.points[-1][0] - self.points[peak_index][0] if is_held else 0.0

    @property
    def shortest_segment(self) -> float:
        """The shortest time between two points that is none [time]."""
        return min(end - start for (start, _), (end, _) in pairwise(self.points) if end > start)

    @property
    def has_reloading(self) -> bool:
        """Whether a value rises again after it fell: more than one cycle."""
        steps = [next_value - value for (_, value), (_, next_value) in pairwise(self.points)]
        falls = [k for k, step in enumerate(steps) if step < 0]
        return bool(falls) and any(step > 0 for step in steps[falls[0] :])

    @property
    def has_jumps(self) -> bool:
        """Whether a value changes at once, from rest too."""
        return self.points[0][1] > 0 or any(
            a[0] == b[0] and a[1] != b[1] for a, b in pairwise(self.points)
        )

    @property
    def points_from_rest(self) -> tuple[tuple[float, float], ...]:
        """The points, after one at rest where the first jumps in."""
        (t, value), *_ = self.points
        return ((t, 0.0), *self.points) if value > 0 else self.points

    @property
    def rows_per_segment(self) -> tuple[int, ...]:
        """Rows of each piece of `from_rest`: its share of the time, or of the pieces if that is
        more; a jump: 1.
        """
        spans = [end - start for (start, _), (end, _) in pairwise(self.points_from_rest)]
        fractions = [max(span / self.duration, 1.0 / len(spans)) for span in spans]
        return tuple(
            max(1, round(HISTORY_ROWS * fraction)) if span > 0 else 1
            for fraction, span in zip(fractions, spans, strict=True)
        )

    @property
    def with_row_times_inserted(self) -> History:
        """The same with its `times` as points, and a row at every point and between."""
        point_times = [t for t, _ in self.points]
        points = list(self.points)
        for t in sorted({*self.times} - {*point_times}):
            next_index = bisect_right(point_times, t)
            (t0, v0), (t1, v1) = self.points[next_index - 1 : next_index + 1]
            points.append((t, v0 + (v1 - v0) * (t - t0) / (t1 - t0)))
        return replace(self, points=tuple(sorted(points, key=lambda point: point[0])), times=())

    @property
    def rows(self) -> tuple[HistoryRow, ...]:
        """Every point and those between, and at a jump the state before and after it."""
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
        """Its rows as a path of the whole body: PIECE_ROWS in each piece that moves, the end of a
        hold, the state after a jump; or those at its `times`, and where it turns between them.
        """
        return self._path_at_fractions(
            lambda span, moves: (
                [k / ROWS_PER_SEGMENT for k in range(1, ROWS_PER_SEGMENT)] if moves else []
            )
        )

    def time_stepped_path(self, first_step: float, per_doubling: int) -> LoadPath:
        """The path of a body that takes time, every step a row: in each piece `per_doubling` steps
        of each length, `first_step` [time] and twice the one before, and PER_PIECE times as many at
        least where it moves; or rows as `path`.
        """

        def step_fractions(span: float, moves: bool) -> list[float]:
            longest = span / (LEAST_STEPS_PER_SEGMENT * per_doubling) if moves else inf
            return [t / span for t in doubling_times(span, first_step, per_doubling, longest)]

        return replace(self._path_at_fractions(step_fractions), start_time=self.points[0][0])

    def _path_at_fractions(
        self, fractions_of: Callable[[float, bool], Sequence[float]]
    ) -> LoadPath:
        """Its rows at shares of each piece in time, by its span and whether it moves, and at its
        end.
        """
        rows = (
            []
            if len(self.points_from_rest) > len(self.points)
            else [HistoryRow(*self.points[0], "approach")]
        )
        for (t0, v0), (t1, v1) in pairwise(self.points_from_rest):
            fractions = fractions_of(t1 - t0, v1 != v0) if t1 > t0 else ()
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
        return LoadPath(self.control, values, times, branches)

    def _path_at_times(self, rows: Sequence[HistoryRow]) -> LoadPath:
        """The rows at its `times`, at a jump the one after it; the others stay, as steps on the way
        to them.
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
        return LoadPath(self.control, values, self.times, branches, turns, turn_times)

    def nondimensionalize(self, unit: float) -> History:
        """The same with values in a unit; times stay."""
        return replace(self, points=tuple((t, value / unit) for t, value in self.points))


def doubling_times(
    span: float, first_step: float, per_doubling: int, longest: float = inf
) -> list[float]:
    """Times from 0 to a span, without both: as many steps of each length as `per_doubling`, `first_step`
    and then twice the one before, but no longer than `longest` [time].
    """
    times = list[float]()
    t = 0.0
    dt = min(first_step, longest)
    while True:
        for _ in range(per_doubling):
            t += dt
            if t >= span * (1 - LEAST_STEP_FRACTION):
                return times
            times.append(t)
        dt = min(2 * dt, longest)


def _midpoint(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2


def branch_of(value: float, next_value: float) -> str:
    """What a tip does between two values."""
    return "hold" if value == next_value else "approach" if next_value > value else "retract"


@dataclass(frozen=True)
class Loading:
    """One of: a final depth `delta` or force `force` reached in `steps` equal steps, the depths
    `deltas` or the forces `forces` one by one, or in time `history`, [t, delta] (with a
    cantilever or a frame [t, z]), or `force_history`, [t, force]: straight between the points,
    two equal times are a jump, before the first point the body is at rest. `times`: auto: every
    point and, between them, enough for a curve | the times of the rows. A body that drains, or
    whose shear relaxes, takes `per_doubling` steps of each length before that doubles, in every
    piece.

    delta > 0 pushes in; negative values in `deltas` hold the tip clear of the body [length]. Forces
    are of the whole body (per unit length in plane strain); negative ones only under a tip that
    adheres, and no harder than it pulls where it first touches. Without adhesion a force of 0 is
    where the tip just touches, delta = 0.
    """

    delta: Length | None = None
    force: Force | None = None
    steps: Annotated[int, Gt(0), Le(MAX_STEPS)] = 10
    deltas: Annotated[tuple[Coordinate, ...], Len(1, MAX_STEPS), LENGTH] | None = None
    forces: Annotated[tuple[float, ...], Len(1, MAX_STEPS), FORCE] | None = None
    history: Annotated[tuple[HistoryPoint, ...], Len(2, MAX_HISTORY_POINTS)] | None = None
    force_history: Annotated[tuple[ForceHistoryPoint, ...], Len(2, MAX_HISTORY_POINTS)] | None = (
        None
    )
    times: Annotated[tuple[float, ...], Len(1, MAX_STEPS), TIME] | Auto = "auto"
    per_doubling: Annotated[int, Ge(2), Le(MAX_STEPS_PER_DOUBLING)] | None = None

    @property
    def given_path_keys(self) -> tuple[str, ...]:
        """Which of the ways to say the path are used; a complete loading uses one."""
        return tuple(key for key in PATH_KEYS if getattr(self, key) is not None)

    @property
    def steps_per_doubling(self) -> int:
        """Steps of each length in time before that doubles."""
        return self.per_doubling or STEPS_PER_DOUBLING

    @property
    def prescribed_history(self) -> History | None:
        """What is prescribed in time; None where no time passes."""
        points = self.history or self.force_history
        times = () if isinstance(self.times, str) else self.times
        return History("depth" if self.history else "force", points, times) if points else None  # type: ignore[arg-type]

    def path(self) -> LoadPath:
        """The requested depths or forces in order, of a loading without time."""
        (key,) = self.given_path_keys
        prescribed = getattr(self, key)
        values = (
            prescribed
            if key in ("deltas", "forces")
            else tuple(prescribed * n / self.steps for n in range(1, self.steps + 1))
        )
        return LoadPath("depth" if key in ("delta", "deltas") else "force", values)
