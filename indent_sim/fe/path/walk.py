"""Walking the load path: predict, solve, cut back, and say State after State."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from indent_sim.fe.observe import measure
from indent_sim.fe.path.equilibrium import Equilibrium
from indent_sim.fe.path.failure import failed_state
from indent_sim.fe.path.load_control import LoadControl, Pair
from indent_sim.fe.path.pull_off import (
    FINEST_TOLERANCE,
    PullPoint,
    UnloadingBranch,
    find_largest_pull,
    force_ripple,
)
from indent_sim.fe.path.steps import Place, StepRule, Way
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import PullOff, State

PARABOLA_STEP = (
    0.13  # of the depth: up to this the contact edge moves smoothly enough for a parabola, measured
)
# Ranges of an attraction: how far away a tip that adheres sets out (6e-6 of what it feels at first
# touch); its longest step; and the longest one over which it may snap in or let go. Over a longer
# one Newton may end in the other of two stable states: measured at Maugis' lambda 2, it let go too
# early in a step of five ranges.
OUTSET_RANGES = 12.0
LONG = 4.0
JUMP = 0.25
# Of the body's height, by which a tip is lifted, and twice as much, to see how far it is; and that
# is left below one that just touches. It is clear of the body where that rises by less than a fifth
# of it
LIFT = 1e-3
MOST_LIFTS = 12
AIR = 1e-9
CLEAR = 5.0
SAME_SPEED = 1e-6  # relative: of the tip in two steps of one ramp, but for rounding
MOST_SEARCHES = (
    6  # for a force, each with the surface sealed where the one before has found contact
)


@dataclass(frozen=True)
class Point:
    """An equilibrium on the path."""

    place: Place
    state: Any
    dissipated: float = 0.0  # on the path to it [energy]
    touches: bool = False  # asked for only where the tip adheres

    @property
    def delta(self) -> float:
        """Depth [length]."""
        return self.place.delta


# Depth [length], time, and the arrays of a state, as a checkpoint has them
PackedState = tuple[float, float, Sequence[np.ndarray]]


class Walk:
    """Equilibria along the requested depths or forces: predicted, solved, and cut back where a step
    is too long.
    """

    def __init__(self, equilibrium: Equilibrium, started: float | None = None):
        self.equilibrium = equilibrium
        physics = equilibrium.scene.physics
        self._has_memory = equilibrium.has_memory
        self._range = physics.contact.reach  # of the tip's attraction; 0 without
        self.started = time.perf_counter() if started is None else started
        outset = Place(0.0 - OUTSET_RANGES * self._range)  # no -0.0
        self._points = [Point(outset, equilibrium.snapshot())]  # the untouched body at rest
        self._untouched = self._points[0]
        self._to_row = (
            self._points
        )  # up to the last row: what the first step after it is predicted from
        self._before = self._points  # the search for a force
        self._found: Point | None = None  # and not accepted yet
        self._steps = self._step_rule()
        self._substeps = self._cuts = 0  # so far
        self._t = 0.0  # at which a force is searched for
        self._rise = 0.0  # of a tip that just touches, in the step before
        self._unloading: UnloadingBranch | None = (
            UnloadingBranch() if physics.seeks_pull_off else None
        )
        self._control = LoadControl(self._go, physics.body.height, from_row=self._has_memory)

    def _step_rule(self, way: Way | None = None) -> StepRule:
        """Of a path without failures yet; on a way that takes time depths are measured in it, and
        nothing is free. What has evolved may touch at any depth.
        """
        # without limit where the gap is linear in u
        scene = self.equilibrium.scene
        longest = inf
        fine = inf
        if scene.physics.gap == "current":
            # of the deepest contact's radius: a longer step into a gap at the deformed point may
            # end elsewhere
            longest = 0.25 * scene.plan.prediction["a"] / scene.physics.scales.length
        if self._range:
            longest = min(longest, LONG * self._range)
            fine = JUMP / 4 * self._range
        if way and way.takes_time:
            return StepRule(way.measured(longest), -inf, way.measured(fine))
        return StepRule(longest, -inf if scene.physics.evolves else self._untouched.delta, fine)

    @property
    def _last(self) -> Point:
        """The last accepted equilibrium: whoever asks for it has read off what the step to it has
        left.
        """
        self._accept()
        return self._points[-1]

    def _accept(self) -> None:
        """Accept what was found last, if not done: what is remembered moves on, numbers of the step
        are read before.
        """
        if (found := self._found) is None:
            return
        self._found = None
        last = self._points[-1]
        lost = self.equilibrium.accept()
        before = (
            [] if found.touches != last.touches else self._points[-2:]
        )  # no prediction leads over a snap
        found = replace(found, state=self.equilibrium.snapshot(), dissipated=last.dissipated + lost)
        self._points = [*before, found]

    @property
    def points(self) -> list[tuple[float, float, list[np.ndarray]]]:
        """The last equilibria, for `resume`: depth, time and arrays; with memory those up to the
        last row, on its own path.
        """
        points = self._to_row if self._has_memory else self._points
        packed = [
            (point.delta, point.place.t, self.equilibrium.pack(point.state)) for point in points
        ]
        return [(delta, t, arrays) for delta, t, arrays in packed if arrays]

    @property
    def pull_off_points(self) -> dict[int, PackedState]:
        """The load points from which the largest pull is searched for, by their numbers, for
        `resume`.
        """
        packed: dict[int, PackedState] = {}
        for point in self._unloading.search_points if self._unloading else ():
            packed[point.number] = point.delta, point.t, self.equilibrium.pack(point.state.state)
        return packed

    def resume(
        self,
        points: Sequence[PackedState],
        passed: Sequence[tuple[float, float]],
        step: int = 0,
        pull_off_points: Mapping[int, PackedState] | None = None,
    ) -> bool:
        """Stand where an earlier walk stood: at its `points` (or at rest), then at the last of the
        depths and times passed since. An equilibrium without memory does not depend on the path, so
        the way is straight to the last three, from which the next one is predicted; or that of the
        earlier walk where it has to be. False when it is lost.

        Parameters
        ----------
        points, pull_off_points
            Those of the earlier walk.
        passed
            Depth [length] and time of each place since then.
        step
            The row that the earlier walk stood at, from 1.
        """
        unpacked = [
            (Place(delta, t), self.equilibrium.unpack(delta, arrays, t))
            for delta, t, arrays in points
        ]
        found = [Point(place, state) for place, state in unpacked if state is not None]
        places = [Place(*at) for at in passed]
        self._points = found if found and self._range else [*self._points, *found][-3:]
        self.return_to_last()
        self._points[-1] = replace(self._last, touches=self._touches)
        self._control.know(*self._pair)
        if self._unloading is not None and not self._resume_unloading(pull_off_points or {}, step):
            return False
        start = self._points
        is_there = not self._has_memory and all(self._reach(place) for place in places[-3:])
        if not is_there:
            self._points, self._steps = start, self._step_rule()
            self.return_to_last()
            is_there = all(self._come_to_row(place) for place in places)
        self._accept()
        self._to_row = self._points
        return is_there

    def _come_to_row(self, place: Place) -> int:
        """Step to a row of the earlier walk as it did; the number of steps, 0 when lost."""
        before = self._points
        substeps = self._reach(place)
        if self.equilibrium.scene.physics.path.control == "force":
            self._points = self._without_tries(before)
        if substeps:
            self._record_unloading_point()
        return substeps

    def _resume_unloading(self, packed: Mapping[int, PackedState], step: int) -> bool:
        """Restore what an earlier walk knew of the smallest force during unloading.

        Parameters
        ----------
        packed
            `pull_off_points` of the earlier walk.
        step
            The row that it stood at, from 1.

        Returns
        -------
        bool
            False where the states are none of this body.
        """
        pulls = []
        for number, (delta, t, arrays) in sorted(packed.items()):
            state = self.equilibrium.unpack(delta, arrays, t)
            if state is None:
                return False
            self.equilibrium.restore(state)
            point = Point(Place(delta, t), state, touches=self._touches)
            pulls.append(self._pull_point(point, number))
        self.return_to_last()
        path = self.equilibrium.scene.physics.path
        point_count = sum(len(path.leg(row)) for row in range(1, step + 1))
        last = self._pull_point(self._last, point_count) if point_count else None
        self._unloading = UnloadingBranch.from_search_points(tuple(pulls), last)
        return True

    def _pull_point(self, point: Point, number: int = 0) -> PullPoint:
        """Return the present equilibrium, which is that of a load point, for the search for the
        largest pull.
        """
        a = float(self.equilibrium.numbers()["a"])
        return PullPoint(point.delta, point.place.t, self.equilibrium.force, a, point, number)

    def _record_unloading_point(self) -> None:
        """Record the present load point where the largest pull is to be searched for."""
        if self._unloading is not None:
            self._unloading = self._unloading.with_point(self._pull_point(self._last))

    def find_pull_off(self) -> PullOff | None:
        """Search for the smallest force during unloading, between the rows around the lowest one.

        The walk stands at its last load point again afterwards.

        Returns
        -------
        PullOff or None
            In the solver's units; None where no row that pulls has rows on both sides during
            unloading.

        Raises
        ------
        NotConverged
            If an equilibrium between these rows is not found again.
        """
        bracket = self._unloading.bracket if self._unloading else None
        if bracket is None:
            return None
        body = self.equilibrium
        effort_before = body.effort
        try:
            largest = find_largest_pull(
                *bracket, self._equilibrium_between, self._pull_off_tolerance
            )
            body.restore(largest.point.state.state)
            effort = body.effort - effort_before
            numbers = body.numbers() | {"newton_iterations": effort.newton}
            numbers["wall_s"] = time.perf_counter() - self.started
            state = State(step=0, delta=largest.point.delta, **numbers)
        finally:
            self._points = self._to_row
            self._found = None
            self.return_to_last()
        from_crest_to_trough = 2 * self._force_ripple(largest.point) * abs(state.force)
        return PullOff(state, largest.error + from_crest_to_trough, largest.equilibria)

    def _pull_off_tolerance(self, point: PullPoint) -> float:
        """Return the error at which a search for the largest pull ends, relative to the force."""
        return max(self._force_ripple(point), FINEST_TOLERANCE)

    def _force_ripple(self, point: PullPoint) -> float:
        """Return the amplitude of the ripple of the force on this mesh, relative to the force."""
        scene = self.equilibrium.scene
        assert scene.plan.adhesion is not None
        in_zone = scene.plan.adhesion.elements
        in_contact = max(point.a / scene.sizes.h_contact, 1.0)
        return force_ripple(min(in_zone, in_contact) if point.is_touching else in_zone)

    def _equilibrium_between(self, begin: PullPoint, end: PullPoint, delta: float) -> PullPoint:
        """Solve the equilibrium at a depth between two others, starting from the first of them."""
        fraction = (delta - begin.delta) / (end.delta - begin.delta)
        place = Place(delta, begin.t + fraction * (end.t - begin.t))
        self._points = [begin.state]
        self._found = None
        self.return_to_last()
        if not self._reach(place):
            return PullPoint(delta, place.t, inf, a=0.0)
        return self._pull_point(self._last)

    def _without_tries(self, before: list[Point]) -> list[Point]:
        """The last equilibria at the force of a row, whose search set out from those `before`: its
        tries are too close together to extrapolate from.
        """
        return [*before[-2:], self._last]

    @property
    def counts(self) -> dict[str, int]:
        """Equilibria found, stages of steps in time among them, steps that failed and were cut, and
        changes of what the tip seals, all those of searches for a force too.
        """
        effort = self.equilibrium.effort
        return {"stages": effort.stages, "cuts": self._cuts, "switches": effort.switches}

    @property
    def failure(self) -> str:
        """Why the last value was not reached."""
        return (
            self._control.failure
            or f"{self.equilibrium.failure}, in shorter and shorter substeps too"
        )

    def states(
        self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0
    ) -> Iterator[State]:
        """One State per requested value after the first `done`; after one that is not converged
        there is no other.
        """
        body = self.equilibrium
        if path.control == "force":
            self._control.tolerance = body.sharpen()
            if self._range:
                self._before = self._points
                self._control.begin()
        for step, value in enumerate(path.values[done:], start=done + 1):
            before = body.effort
            substeps = 0
            for passed, t in path.leg(step):
                if substeps:  # at a place between rows
                    self._record_unloading_point()
                more = (
                    self._reach(Place(passed, t))
                    if path.control == "depth"
                    else self._press(passed, t, step)
                )
                substeps = more and substeps + more
                if not more:
                    break
            effort = body.effort - before
            if not substeps:
                spent = (effort.newton, time.perf_counter() - self.started)
                crushed = body.observed.crushed()
                yield failed_state(
                    body.scene, step, value, self._pair, self.failure, crushed, spent
                )
                return
            numbers = body.numbers() | {"substeps": substeps, "krylov_iterations": effort.krylov}
            surface = measure.surface(body.observed) if wants_surface(step) else None
            if path.control == "force":
                self._points = self._without_tries(self._before)
            dissipated = self._last.dissipated - self._row.dissipated
            self._to_row = self._points
            self._record_unloading_point()
            numbers["dissipation"] = (
                dissipated if "dissipation" in body.scene.physics.columns else None
            )
            numbers |= {
                "newton_iterations": effort.newton,
                "wall_s": time.perf_counter() - self.started,
            }
            if path.times:
                numbers |= {"t": path.times[step - 1], "branch": path.branches[step - 1]}
            yield State(step=step, delta=self._last.delta, surface=surface, **numbers)

    def _press(self, force: float, t: float, step: int) -> int:
        """Stand at the depth of a force, at a time; the number of steps there, 0 where there is no
        such depth.
        """
        self._accept()
        self._before = self._points
        substeps = self._substeps
        physics = self.equilibrium.scene.physics
        expected = physics.deltas[step - 1] or self._range
        self._t = t
        if force == 0 and physics.evolves and not self._range:
            return self._substeps - substeps if self._touch() else 0
        if t == self._last.place.t and not (physics.evolves and t > 0):
            return self._substeps - substeps if self._control.press(force, expected) else 0
        delta = self._last.delta or expected
        a = self.equilibrium.scene.plan.prediction["a"] / physics.scales.length
        for _ in range(MOST_SEARCHES):
            if not self._control.renew(force, delta, 2 * physics.material.E_star * a):
                return 0
            delta = self._pair[
                1
            ]  # not accepted: the same step is searched again where the tip seals another vertex
            if self.equilibrium.is_settled():
                break
        return self._substeps - substeps

    def _touch(self) -> bool:
        """Stand where the tip just touches the body that has evolved; False where that is not
        found. Time passes with the tip so far away that it does not touch on its way either.
        """
        height = self.equilibrium.scene.physics.body.height
        before = self._before[-1].delta
        up = max(CLEAR * self._rise, LIFT * height)
        for _ in range(MOST_LIFTS):
            away = before - up
            reached = self._go(before - up)[1]
            if reached != away:
                return False
            gap = measure.smallest_gap(self.equilibrium.observed)
            if gap > 0 and gap >= up * (1 - 1 / CLEAR):
                touch = Place(away + gap - AIR * height, self._t)
                self._rise, there = abs(touch.delta - before), self._reach(touch)
                self._substeps += there
                return bool(there)
            up *= 2
        return False

    def _go(self, delta: float) -> Pair:
        """Stand at a depth, or as near to it as there is an equilibrium; with memory on the way
        from the last row.
        """
        if self._has_memory:
            self._points = self._before
            self._found = None
            self.return_to_last()
        self._substeps += self._reach(Place(delta, self._t))
        return self._pair

    @property
    def _row(self) -> Point:
        """The equilibrium of the last row."""
        return self._to_row[-1]

    @property
    def _pair(self) -> Pair:
        return self.equilibrium.force, (self._found or self._points[-1]).delta

    def return_to_last(self) -> None:
        """Put the last equilibrium back, after a step that failed."""
        self.equilibrium.restore(self._last.state)

    def return_to_row(self) -> Any:
        """Put the last row's equilibrium back, after a stop in mid-step; the body that is observed
        then.
        """
        self.equilibrium.restore(self._row.state)
        return self.equilibrium.observed

    def _reach(self, target: Place) -> int:
        """Step to the target, by way of where the tip begins or ends to be felt; the number of
        steps, 0 when lost.
        """
        way = Way(self._last.place, target)
        if (
            self._has_memory or way.takes_time
        ):  # each row has steps of its own: a resumed path is the same path
            self._steps = self._step_rule(way)
            if (threshold := self._threshold(target)) is not None:
                return (
                    (first := self._reach(threshold))
                    and (rest := self._reach(target))
                    and first + rest
                )
        substeps = 0
        end = way.coordinate(target)
        self._steps.begin(end - way.coordinate(self._last.place))
        while (goal := self._steps.goal(way.coordinate(self._last.place), end)) is not None:
            before = self.equilibrium.effort
            if self._attempt(way.place(goal)):
                substeps += 1
                self._steps.succeeded()
                if goal == end:
                    return substeps
            else:
                self._cuts += 1
                self._steps.failed((self.equilibrium.effort - before).newton)
        return 0

    def _threshold(self, target: Place) -> Place | None:
        """The place on the way to a target, at which time stands still, where the tip begins to be
        felt, or ends.
        """
        # felt: from here on inwards
        felt = self._untouched.delta
        last = self._last.delta
        crosses = (target.delta < felt < last) if self._range else (last < 0 < target.delta)
        return Place(felt, target.t) if crosses and target.t == self._last.place.t else None

    def _attempt(self, place: Place) -> bool:
        """Solve at a place; where an adhering tip snaps or that fails, by a short step to where the
        body rests.
        """
        found = self._solve(place)
        delta = place.delta
        jumps = found and self._touches != self._last.touches
        if self._range and (jumps or not found):
            self.return_to_last()
            found = not self._is_long(delta) and self.equilibrium.settle(
                delta, place.t - self._last.place.t
            )
        if not found:
            self.return_to_last()
            return False
        self._found = Point(place, None, touches=self._touches)
        return True

    def _solve(self, place: Place) -> bool:
        """Where time passes while the depth does not change as it did a step sets out from the last
        state: what is extrapolated through a hold leads nowhere.
        """
        delta = place.delta
        dt = place.t - self._last.place.t
        leading = [] if dt and not self._goes_on(place) else _leading(self._points, delta)
        if is_led := len(leading) > 1:  # by the line or parabola through the last states
            self.equilibrium.predict(delta, [point.state for point in leading])
            if self.equilibrium.solve(delta, dt):
                return True
        self.return_to_last()
        if (
            is_led and self._range and self._is_long(delta)
        ):  # a shorter step costs less than another fifty iterations
            return False
        return self.equilibrium.solve(delta, dt)

    def _goes_on(self, place: Place) -> bool:
        """Whether the depth changes as fast on the way to a place as on the way to where the walk
        stands.
        """
        before, last = (point.place for point in [self._points[0], *self._points][-2:])
        passed = last.t - before.t
        dt = place.t - last.t
        if passed <= 0 or place.delta == last.delta:
            return False
        speed = (place.delta - last.delta) / dt
        was = (last.delta - before.delta) / passed
        return abs(speed - was) <= SAME_SPEED * abs(speed)

    @property
    def _touches(self) -> bool:
        return self._range > 0 and bool(self.equilibrium.numbers()["a"] > 0)

    def _is_long(self, delta: float) -> bool:
        return abs(delta - self._last.delta) > JUMP * self._range


def _leading(points: list[Point], delta: float) -> list[Point]:
    """The last points from which the path leads straight on to delta; one alone where nothing is
    predicted.
    """
    step = delta - points[-1].delta  # not a small one: the contact edge leaves kinks in the states
    most = 3 if abs(step) <= PARABOLA_STEP * abs(delta) else 2
    leading = points[-1:]
    for before, after in zip(points[-2::-1], points[:0:-1], strict=True):
        behind = after.delta - before.delta
        leads = behind != 0 and -1 < step / behind <= 2  # between the two, or not far out
        been_there = any(point.delta == before.delta for point in leading)
        if not leads or been_there or len(leading) == most:
            break
        leading = [before, *leading]
    return leading
