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

MOST_STEPS, MOST_POINTS = 100_000, 10_000
HISTORY_ROWS = 200  # of a history on the elastic curve at least, and at most as many more
SHORTEST = 1e-9  # of a piece: a last step shorter than that is none
PIECE_ROWS = 20  # of each piece of a history on the whole body
PER_PIECE = 5  # times the steps of each length, the least of a piece that moves
Force = Annotated[float, Gt(0), FORCE]
Way = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, LENGTH))]
Pull = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, FORCE))]
WAYS = ("delta", "deltas", "force", "forces", "history", "force_history")  # to say the path, one of them
PER_DOUBLING, MOST_PER_DOUBLING = 4, 1000
STEPPED = ("delta", "force")  # those that have steps
Control = Literal["depth", "force"]


@dataclass(frozen=True)
class LoadPath:
    """What is prescribed, and its values in order: depths [length], or forces of the whole body [force]; in time, the
    time and the branch of each too, and the values that the tip passes before it, where it turns between two rows.

    begin: when a body that takes time sets out [time], None of any other; `passed`: the times of its turns."""

    control: Control
    values: tuple[float, ...]
    times: tuple[float, ...] = ()
    branches: tuple[str, ...] = ()
    turns: tuple[tuple[float, ...], ...] = ()
    passed: tuple[tuple[float, ...], ...] = ()
    begin: float | None = None

    def halved(self) -> LoadPath:
        """The same in steps half as long: between each two values the mean of them, two rows for each."""
        rows: list[tuple[float, float]] = []
        turns: list[tuple[tuple[float, float], ...]] = []
        last = (0.0, 0.0)
        for step in range(1, len(self.values) + 1):
            fine = [part for a, b in pairwise((last, *self.leg(step))) for part in (_middle(a, b), b)]
            rows += fine[-2:]
            turns += [tuple(fine[:-2]), ()]
            last = fine[-1]
        values, times = zip(*rows, strict=True)
        passed = [tuple(zip(*leg, strict=True)) or ((), ()) for leg in turns] if self.turns else []
        found = LoadPath(self.control, values, turns=tuple(depths for depths, _ in passed))
        if self.begin is None:
            return found
        own = tuple(self.begin + t for t in times)
        legs = tuple(tuple(self.begin + t for t in leg) for _, leg in passed)
        return replace(
            found,
            times=own,
            branches=(*chain(*zip(self.branches, self.branches, strict=True)),),
            passed=legs,
            begin=self.begin,
        )

    @property
    def grows(self) -> bool:
        """Whether every value is larger than those before it."""
        return not any(self.turns) and all(b > a for a, b in pairwise(self.values))

    @property
    def still(self) -> int:
        """How many steps there are in which the value stays what it is."""
        values = [0.0, *(value for step in range(1, len(self.values) + 1) for value, _ in self.leg(step))]
        return sum(a == b for a, b in pairwise(values))

    @property
    def sudden(self) -> tuple[int, ...]:
        """The rows [from 1] to which no time passes, though the value changes."""
        rows = (self._is_sudden(step)[-1] for step in range(1, len(self.values) + 1))
        return tuple(step for step, is_sudden in enumerate(rows, start=1) if is_sudden)

    @property
    def jumps(self) -> bool:
        """Whether a value changes in no time, at a row or on the way to one."""
        return any(any(self._is_sudden(step)) for step in range(1, len(self.values) + 1))

    def _is_sudden(self, step: int) -> list[bool]:
        """For each place of the leg to a row [from 1] whether the value gets there in no time."""
        before = self.leg(step - 1)[-1] if step > 1 else (0.0, 0.0)
        return [a[1] == b[1] and a[0] != b[0] for a, b in pairwise((before, *self.leg(step)))]

    def without_sudden(self) -> LoadPath:
        """The same path without the places that it reaches in no time: the step after a jump begins before the jump.
        Rows among them are left out, and what is passed on the way to them is passed on the way to the next row."""
        rows: list[int] = []
        legs: list[list[tuple[float, float]]] = []
        waiting: list[tuple[float, float]] = []
        for step in range(1, len(self.values) + 1):
            kept = [place for place, sudden in zip(self.leg(step), self._is_sudden(step), strict=True) if not sudden]
            waiting += kept
            if self._is_sudden(step)[-1]:
                continue
            rows.append(step - 1)
            legs.append(waiting[:-1])
            waiting = []
        begin = self.begin or 0.0
        has_turns = any(legs)
        return replace(
            self,
            values=tuple(self.values[row] for row in rows),
            times=tuple(self.times[row] for row in rows),
            branches=tuple(self.branches[row] for row in rows),
            turns=tuple(tuple(value for value, _ in leg) for leg in legs) if has_turns else (),
            passed=tuple(tuple(begin + t for _, t in leg) for leg in legs) if has_turns else (),
        )

    def leg(self, step: int) -> tuple[tuple[float, float], ...]:
        """The values on the way to a step [from 1], its own the last, each with the time since the path's begin; no
        time passes for a body that takes none."""
        values = (*(self.turns[step - 1] if self.turns else ()), self.values[step - 1])
        if self.begin is None:
            return tuple((value, 0.0) for value in values)
        times = (*(self.passed[step - 1] if self.passed else ()), self.times[step - 1])
        return tuple((value, t - self.begin) for value, t in zip(values, times, strict=True))

    def without_units(self, unit: float) -> LoadPath:
        """The same with values in a unit; times stay."""
        turns = tuple(tuple(value / unit for value in passed) for passed in self.turns)
        return replace(self, values=tuple(value / unit for value in self.values), turns=turns)

    @property
    def kept(self) -> frozenset[int]:
        """The steps whose states are worth keeping, from 1: the last, and those from which the tip goes back after it
        was nowhere deeper (or, where forces are prescribed, pressed no harder)."""
        steps, deepest = {len(self.values)}, float("-inf")
        for step, (value, following) in enumerate(pairwise(self.values), start=1):
            deepest = max(deepest, value)
            if following < value == deepest:
                steps.add(step)
        return frozenset(steps)


@dataclass(frozen=True)
class Instant:
    """A row of a history: the time [time], what is prescribed there, and whether the tip approaches, holds or
    retracts."""

    t: float
    value: float
    branch: str


@dataclass(frozen=True)
class History:
    """Depths, ways of a base [length] or forces [force] in time: `points` (t, value), straight between them; two equal
    times are a jump. Before the first point the body is at rest. `times`: of the rows; none: every point and, between
    them, enough for a curve."""

    control: Control
    points: tuple[tuple[float, float], ...]
    times: tuple[float, ...] = ()

    @property
    def largest(self) -> float:
        """The largest value."""
        return max(value for _, value in self.points)

    @property
    def span(self) -> float:
        """From the first point to the last [time]."""
        return self.points[-1][0] - self.points[0][0]

    @property
    def way_in(self) -> float:
        """From where the tip sets out to where its value is the largest [time]; a jump takes none."""
        points = self.from_rest
        top = max(range(len(points)), key=lambda k: (points[k][1], -k))
        out = max((k for k in range(top) if points[k][1] <= 0), default=0)
        return points[top][0] - points[out][0]

    @property
    def rest_after(self) -> float:
        """From its largest value to the end where it stays there [time], else 0."""
        top = next(k for k, (_, value) in enumerate(self.points) if value == self.largest)
        stays = all(value == self.largest for _, value in self.points[top:])
        return self.points[-1][0] - self.points[top][0] if stays else 0.0

    @property
    def shortest_piece(self) -> float:
        """The shortest time between two points that is none [time]."""
        return min(after - before for (before, _), (after, _) in pairwise(self.points) if after > before)

    @property
    def shortest_time_to_row(self) -> float:
        """Shortest time from the beginning of a segment of the history to an output row in it [time].

        Infinite if no `times` of rows are given: every time step is a row then.
        """
        durations = [
            t - start for start, end in pairwise([t for t, _ in self.from_rest]) for t in self.times if start < t <= end
        ]
        return min(durations, default=inf)

    @property
    def comes_back(self) -> bool:
        """Whether a value rises again after it fell: more than one cycle."""
        steps = [after - before for (_, before), (_, after) in pairwise(self.points)]
        falls = [k for k, step in enumerate(steps) if step < 0]
        return bool(falls) and any(step > 0 for step in steps[falls[0] :])

    @property
    def jumps(self) -> bool:
        """Whether a value changes at once, from rest too."""
        return self.points[0][1] > 0 or any(a[0] == b[0] and a[1] != b[1] for a, b in pairwise(self.points))

    @property
    def from_rest(self) -> tuple[tuple[float, float], ...]:
        """The points, after one at rest where the first jumps in."""
        (t, value), *_ = self.points
        return ((t, 0.0), *self.points) if value > 0 else self.points

    @property
    def pieces(self) -> tuple[int, ...]:
        """Rows of each piece of `from_rest`: its share of the time, or of the pieces if that is more; a jump: 1."""
        spans = [after - before for (before, _), (after, _) in pairwise(self.from_rest)]
        shares = [max(span / self.span, 1.0 / len(spans)) for span in spans]
        return tuple(
            max(1, round(HISTORY_ROWS * share)) if span > 0 else 1 for share, span in zip(shares, spans, strict=True)
        )

    @property
    def through_its_times(self) -> History:
        """The same with its `times` as points, and a row at every point and between."""
        known, points = [t for t, _ in self.points], list(self.points)
        for t in sorted({*self.times} - {*known}):
            after = bisect_right(known, t)
            (t0, v0), (t1, v1) = self.points[after - 1 : after + 1]
            points.append((t, v0 + (v1 - v0) * (t - t0) / (t1 - t0)))
        return replace(self, points=tuple(sorted(points, key=lambda point: point[0])), times=())

    @property
    def instants(self) -> tuple[Instant, ...]:
        """Every point and those between, and at a jump the state before and after it."""
        points = self.from_rest
        found = [] if len(points) > len(self.points) else [Instant(*points[0], branch_of(points[0][1], points[1][1]))]
        for ((t0, v0), (t1, v1)), rows in zip(pairwise(points), self.pieces, strict=True):
            branch = branch_of(v0, v1)
            found += [Instant(t0 + (t1 - t0) * k / rows, v0 + (v1 - v0) * k / rows, branch) for k in range(1, rows)]
            found.append(Instant(t1, v1, branch))
        return tuple(found)

    @property
    def path(self) -> LoadPath:
        """Its rows as a path of the whole body: PIECE_ROWS in each piece that moves, the end of a hold, the state after
        a jump; or those at its `times`, and where it turns between them."""
        return self._followed(lambda span, moves: [k / PIECE_ROWS for k in range(1, PIECE_ROWS)] if moves else [])

    def in_steps(self, first: float, per_doubling: int) -> LoadPath:
        """The path of a body that takes time, every step a row: in each piece `per_doubling` steps of each length,
        `first` [time] and twice the one before, and PER_PIECE times as many at least where it moves; or rows as
        `path`."""

        def parts(span: float, moves: bool) -> list[float]:
            longest = span / (PER_PIECE * per_doubling) if moves else inf
            return [t / span for t in ladder(span, first, per_doubling, longest)]

        return replace(self._followed(parts), begin=self.points[0][0])

    def _followed(self, parts: Callable[[float, bool], Sequence[float]]) -> LoadPath:
        """Its rows at shares of each piece in time, by its span and whether it moves, and at its end."""
        rows = [] if len(self.from_rest) > len(self.points) else [Instant(*self.points[0], "approach")]
        for (t0, v0), (t1, v1) in pairwise(self.from_rest):
            shares, branch = (parts(t1 - t0, v1 != v0) if t1 > t0 else ()), branch_of(v0, v1)
            rows += [Instant(t0 + (t1 - t0) * share, v0 + (v1 - v0) * share, branch) for share in shares]
            rows.append(Instant(t1, v1, branch))
        if self.times:
            return self._picked(rows)
        values, times, branches = zip(*((row.value, row.t, row.branch) for row in rows), strict=True)
        return LoadPath(self.control, values, times, branches)

    def _picked(self, rows: Sequence[Instant]) -> LoadPath:
        """The rows at its `times`, at a jump the one after it; the others stay, as steps on the way to them."""
        at, known, legs = dict(self.through_its_times.points), [row.t for row in rows], []
        ends = [bisect_right(known, t) for t in self.times]
        for begin, end, t in zip((0, *ends), ends, self.times, strict=False):
            passed = rows[begin:end]
            legs.append(passed[:-1] if passed and known[end - 1] == t else passed)
        owners = (end - 1 if known[end - 1] == t else end for end, t in zip(ends, self.times, strict=True))
        values, branches = tuple(at[t] for t in self.times), tuple(rows[owner].branch for owner in owners)
        turns = tuple(tuple(row.value for row in leg) for leg in legs)
        moments = tuple(tuple(row.t for row in leg) for leg in legs)
        return LoadPath(self.control, values, self.times, branches, turns, moments)

    def without_units(self, unit: float) -> History:
        """The same with values in a unit; times stay."""
        return replace(self, points=tuple((t, value / unit) for t, value in self.points))


def ladder(span: float, first: float, per_doubling: int, longest: float = inf) -> list[float]:
    """Times from 0 to a span, without both: as many steps of each length as `per_doubling`, `first` and then twice the
    one before, but no longer than `longest` [time]."""
    found, t, dt = list[float](), 0.0, min(first, longest)
    while True:
        for _ in range(per_doubling):
            t += dt
            if t >= span * (1 - SHORTEST):
                return found
            found.append(t)
        dt = min(2 * dt, longest)


def _middle(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2


def branch_of(before: float, after: float) -> str:
    """What a tip does between two values."""
    return "hold" if before == after else "approach" if after > before else "retract"


@dataclass(frozen=True)
class Loading:
    """One of: a final depth `delta` or force `force` reached in `steps` equal steps, the depths `deltas` or the
    forces `forces` one by one, or in time `history`, [t, delta] (with a cantilever or a frame [t, z]), or
    `force_history`, [t, force]: straight between the points, two equal times are a jump, before the first point the
    body is at rest. `times`: auto: every point and, between them, enough for a curve | the times of the rows. A body
    that drains, or whose shear relaxes, takes `per_doubling` steps of each length before that doubles, in every piece.

    delta > 0 pushes in; negative values in `deltas` hold the tip clear of the body [length]. Forces are of the whole
    body (per unit length in plane strain); negative ones only under a tip that adheres, and no harder than it pulls
    where it first touches. Without adhesion a force of 0 is where the tip just touches, delta = 0.
    """

    delta: Length | None = None
    force: Force | None = None
    steps: Annotated[int, Gt(0), Le(MOST_STEPS)] = 10
    deltas: Annotated[tuple[Coordinate, ...], Len(1, MOST_STEPS), LENGTH] | None = None
    forces: Annotated[tuple[float, ...], Len(1, MOST_STEPS), FORCE] | None = None
    history: Annotated[tuple[Way, ...], Len(2, MOST_POINTS)] | None = None
    force_history: Annotated[tuple[Pull, ...], Len(2, MOST_POINTS)] | None = None
    times: Annotated[tuple[float, ...], Len(1, MOST_STEPS), TIME] | Auto = "auto"
    per_doubling: Annotated[int, Ge(2), Le(MOST_PER_DOUBLING)] | None = None

    @property
    def given(self) -> tuple[str, ...]:
        """Which of the ways to say the path are used; a complete loading uses one."""
        return tuple(way for way in WAYS if getattr(self, way) is not None)

    @property
    def steps_per_doubling(self) -> int:
        """Steps of each length in time before that doubles."""
        return self.per_doubling or PER_DOUBLING

    @property
    def in_time(self) -> History | None:
        """What is prescribed in time; None where no time passes."""
        points = self.history or self.force_history
        times = () if isinstance(self.times, str) else self.times
        return History("depth" if self.history else "force", points, times) if points else None  # type: ignore[arg-type]

    def path(self) -> LoadPath:
        """The requested depths or forces in order, of a loading without time."""
        (way,) = self.given
        last = getattr(self, way)
        values = last if way in ("deltas", "forces") else tuple(last * n / self.steps for n in range(1, self.steps + 1))
        return LoadPath("depth" if way in ("delta", "deltas") else "force", values)
