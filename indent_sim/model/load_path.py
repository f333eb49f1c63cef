"""Load path: the prescribed depths or forces in order, and in time for a history."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Literal

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


def _midpoint(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
