"""Walking the load path: predict, solve, cut back, and say State after State."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from indent_sim.fe.path.equilibrium import Equilibrium
from indent_sim.fe.path.failure import failed_state
from indent_sim.fe.path.load_control import ForceDepth, LoadControl
from indent_sim.fe.path.pull_off import (
    FINEST_TOLERANCE,
    PullPoint,
    UnloadingBranch,
    find_largest_pull,
    force_ripple,
)
from indent_sim.fe.path.step_size_control import LoadPoint, LoadSegment, StepSizeControl
from indent_sim.fe.postprocessing import measurements
from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import PullOff, State

LARGEST_PARABOLA_STEP = (
    0.13  # of the depth: up to this the contact edge moves smoothly enough for a parabola, measured
)
# Ranges of an attraction: how far away a tip that adheres sets out (6e-6 of what it feels at first
# touch); its longest step; and the longest one over which it may snap in or let go. Over a longer
# one Newton may end in the other of two stable states: measured at Maugis' lambda 2, it let go too
# early in a step of five ranges.
START_RANGES = 12.0
LONGEST_STEP_RANGES = 4.0
SNAP_STEP_RANGES = 0.25
# Of the body's height, by which a tip is lifted, and twice as much, to see how far it is; and that
# is left below one that just touches. It is clear of the body where that rises by less than a fifth
# of it
LIFT_STEP = 1e-3
MOST_LIFTS = 12
TOUCH_GAP = 1e-9
CLEARANCE_FACTOR = 5.0
SPEED_TOLERANCE = 1e-6  # relative: of the tip in two steps of one ramp, but for rounding
MOST_FORCE_SEARCHES = (
    6  # for a force, each with the surface sealed where the one before has found contact
)


@dataclass(frozen=True)
class EquilibriumPoint:
    """An equilibrium on the path."""

    load_point: LoadPoint
    state: Any
    dissipation: float = 0.0  # on the path to it [energy]
    is_touching: bool = False  # asked for only where the tip adheres

    @property
    def delta(self) -> float:
        """Depth [length]."""
        return self.load_point.delta


# Depth [length], time, and the arrays of a state, as a checkpoint has them
PackedState = tuple[float, float, Sequence[np.ndarray]]


class LoadStepper:
    """Equilibria along the requested depths or forces: predicted, solved, and cut back where a step
    is too long.
    """

    def __init__(self, equilibrium: Equilibrium, started: float | None = None):
        self.equilibrium = equilibrium
        physics = equilibrium.scene.physics
        self._has_memory = equilibrium.has_memory
        self._adhesion_range = physics.contact.adhesion_range  # of the tip's attraction; 0 without
        self.started = time.perf_counter() if started is None else started
        start = LoadPoint(0.0 - START_RANGES * self._adhesion_range)  # no -0.0
        self._points = [
            EquilibriumPoint(start, equilibrium.snapshot())
        ]  # the untouched body at rest
        self._start_point = self._points[0]
        self._row_points = (
            self._points
        )  # up to the last row: what the first step after it is predicted from
        self._search_points = self._points  # the search for a force
        self._pending_point: EquilibriumPoint | None = None  # and not accepted yet
        self._step_control = self._create_step_control()
        self._substeps = self._cuts = 0  # so far
        self._search_time = 0.0  # at which a force is searched for
        self._last_rise = 0.0  # of a tip that just touches, in the step before
        self._unloading: UnloadingBranch | None = (
            UnloadingBranch() if physics.searches_pull_off else None
        )
        self._load_control = LoadControl(
            self._step_to_depth, physics.body.height, from_row=self._has_memory
        )

    def _create_step_control(self, segment: LoadSegment | None = None) -> StepSizeControl:
        """Of a path without failures yet; on a way that takes time depths are measured in it, and
        nothing is free. What has evolved may touch at any depth.
        """
        # without limit where the gap is linear in u
        scene = self.equilibrium.scene
        longest_step = inf
        finest_tried = inf
        if scene.physics.gap == "current":
            # of the deepest contact's radius: a longer step into a gap at the deformed point may
            # end elsewhere
            longest_step = 0.25 * scene.plan.prediction["a"] / scene.physics.scales.length
        if self._adhesion_range:
            longest_step = min(longest_step, LONGEST_STEP_RANGES * self._adhesion_range)
            finest_tried = SNAP_STEP_RANGES / 4 * self._adhesion_range
        if segment and segment.has_duration:
            return StepSizeControl(
                segment.coordinate_length(longest_step),
                -inf,
                segment.coordinate_length(finest_tried),
            )
        return StepSizeControl(
            longest_step,
            -inf if scene.physics.is_time_dependent else self._start_point.delta,
            finest_tried,
        )

    @property
    def _last_point(self) -> EquilibriumPoint:
        """The last accepted equilibrium: whoever asks for it has read off what the step to it has
        left.
        """
        self._accept_pending()
        return self._points[-1]

    def _accept_pending(self) -> None:
        """Accept what was found last, if not done: what is remembered moves on, numbers of the step
        are read before.
        """
        if (pending := self._pending_point) is None:
            return
        self._pending_point = None
        last_point = self._points[-1]
        dissipation = self.equilibrium.accept()
        earlier_points = (
            [] if pending.is_touching != last_point.is_touching else self._points[-2:]
        )  # no prediction leads over a snap
        pending = replace(
            pending,
            state=self.equilibrium.snapshot(),
            dissipation=last_point.dissipation + dissipation,
        )
        self._points = [*earlier_points, pending]

    @property
    def points(self) -> list[tuple[float, float, list[np.ndarray]]]:
        """The last equilibria, for `resume`: depth, time and arrays; with memory those up to the
        last row, on its own path.
        """
        points = self._row_points if self._has_memory else self._points
        packed = [
            (point.delta, point.load_point.t, self.equilibrium.pack(point.state))
            for point in points
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
        later_places: Sequence[tuple[float, float]],
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
            (LoadPoint(delta, t), self.equilibrium.unpack(delta, arrays, t))
            for delta, t, arrays in points
        ]
        resumed_points = [
            EquilibriumPoint(place, state) for place, state in unpacked if state is not None
        ]
        load_points = [LoadPoint(*at) for at in later_places]
        self._points = (
            resumed_points
            if resumed_points and self._adhesion_range
            else [*self._points, *resumed_points][-3:]
        )
        self.restore_last()
        self._points[-1] = replace(self._last_point, is_touching=self._is_touching)
        self._load_control.add_curve_point(*self._force_and_depth)
        if self._unloading is not None and not self._resume_unloading(pull_off_points or {}, step):
            return False
        start_points = self._points
        is_reached = not self._has_memory and all(
            self._step_to(place) for place in load_points[-3:]
        )
        if not is_reached:
            self._points, self._step_control = start_points, self._create_step_control()
            self.restore_last()
            is_reached = all(self._step_to_row(place) for place in load_points)
        self._accept_pending()
        self._row_points = self._points
        return is_reached

    def _step_to_row(self, load_point: LoadPoint) -> int:
        """Step to a row of the earlier walk as it did; the number of steps, 0 when lost."""
        earlier_points = self._points
        substeps = self._step_to(load_point)
        if self.equilibrium.scene.physics.path.control == "force":
            self._points = self._drop_tried_points(earlier_points)
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
            point = EquilibriumPoint(LoadPoint(delta, t), state, is_touching=self._is_touching)
            pulls.append(self._pull_point(point, number))
        self.restore_last()
        path = self.equilibrium.scene.physics.path
        point_count = sum(len(path.segment(row)) for row in range(1, step + 1))
        last = self._pull_point(self._last_point, point_count) if point_count else None
        self._unloading = UnloadingBranch.from_search_points(tuple(pulls), last)
        return True

    def _pull_point(self, point: EquilibriumPoint, number: int = 0) -> PullPoint:
        """Return the present equilibrium, which is that of a load point, for the search for the
        largest pull.
        """
        a = float(self.equilibrium.state_values()["a"])
        return PullPoint(point.delta, point.load_point.t, self.equilibrium.force, a, point, number)

    def _record_unloading_point(self) -> None:
        """Record the present load point where the largest pull is to be searched for."""
        if self._unloading is not None:
            self._unloading = self._unloading.with_point(self._pull_point(self._last_point))

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
        effort_before = body.statistics
        try:
            largest = find_largest_pull(
                *bracket, self._equilibrium_between, self._pull_off_tolerance
            )
            body.restore(largest.point.state.state)
            effort = body.statistics - effort_before
            numbers = body.state_values() | {"newton_iterations": effort.newton}
            numbers["wall_s"] = time.perf_counter() - self.started
            state = State(step=0, delta=largest.point.delta, **numbers)
        finally:
            self._points = self._row_points
            self._pending_point = None
            self.restore_last()
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
        place = LoadPoint(delta, begin.t + fraction * (end.t - begin.t))
        self._points = [begin.state]
        self._pending_point = None
        self.restore_last()
        if not self._step_to(place):
            return PullPoint(delta, place.t, inf, a=0.0)
        return self._pull_point(self._last_point)

    def _drop_tried_points(self, earlier_points: list[EquilibriumPoint]) -> list[EquilibriumPoint]:
        """The last equilibria at the force of a row, whose search set out from those `earlier_points`: its
        tries are too close together to extrapolate from.
        """
        return [*earlier_points[-2:], self._last_point]

    @property
    def counts(self) -> dict[str, int]:
        """Equilibria found, stages of steps in time among them, steps that failed and were cut, and
        changes of what the tip seals, all those of searches for a force too.
        """
        effort = self.equilibrium.statistics
        return {"stages": effort.stages, "cuts": self._cuts, "switches": effort.seal_changes}

    @property
    def failure(self) -> str:
        """Why the last value was not reached."""
        return (
            self._load_control.failure
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
            self._load_control.tolerance = body.tighten_tolerance()
            if self._adhesion_range:
                self._search_points = self._points
                self._load_control.measure_touch_pull()
        for step, value in enumerate(path.values[done:], start=done + 1):
            effort_before = body.statistics
            substeps = 0
            for depth, t in path.segment(step):
                if substeps:  # at a place between rows
                    self._record_unloading_point()
                segment_substeps = (
                    self._step_to(LoadPoint(depth, t))
                    if path.control == "depth"
                    else self._step_to_force(depth, t, step)
                )
                substeps = segment_substeps and substeps + segment_substeps
                if not segment_substeps:
                    break
            effort = body.statistics - effort_before
            if not substeps:
                cost = (effort.newton, time.perf_counter() - self.started)
                inverted = body.observed_body.find_inverted_elements()
                yield failed_state(
                    body.scene, step, value, self._force_and_depth, self.failure, inverted, cost
                )
                return
            values = body.state_values() | {
                "substeps": substeps,
                "krylov_iterations": effort.krylov,
            }
            surface = (
                measurements.surface_table(body.observed_body) if wants_surface(step) else None
            )
            if path.control == "force":
                self._points = self._drop_tried_points(self._search_points)
            dissipated = self._last_point.dissipation - self._row_point.dissipation
            self._row_points = self._points
            self._record_unloading_point()
            values["dissipation"] = (
                dissipated if "dissipation" in body.scene.physics.columns else None
            )
            values |= {
                "newton_iterations": effort.newton,
                "wall_s": time.perf_counter() - self.started,
            }
            if path.times:
                values |= {"t": path.times[step - 1], "branch": path.branches[step - 1]}
            yield State(step=step, delta=self._last_point.delta, surface=surface, **values)

    def _step_to_force(self, force: float, t: float, step: int) -> int:
        """Stand at the depth of a force, at a time; the number of steps there, 0 where there is no
        such depth.
        """
        self._accept_pending()
        self._search_points = self._points
        substeps = self._substeps
        physics = self.equilibrium.scene.physics
        expected = physics.deltas[step - 1] or self._adhesion_range
        self._search_time = t
        if force == 0 and physics.is_time_dependent and not self._adhesion_range:
            return self._substeps - substeps if self._step_to_touch() else 0
        if t == self._last_point.load_point.t and not (physics.is_time_dependent and t > 0):
            return (
                self._substeps - substeps if self._load_control.find_depth(force, expected) else 0
            )
        delta = self._last_point.delta or expected
        a = self.equilibrium.scene.plan.prediction["a"] / physics.scales.length
        for _ in range(MOST_FORCE_SEARCHES):
            if not self._load_control.find_by_secant(force, delta, 2 * physics.material.E_star * a):
                return 0
            delta = self._force_and_depth[
                1
            ]  # not accepted: the same step is searched again where the tip seals another vertex
            if self.equilibrium.is_seal_consistent():
                break
        return self._substeps - substeps

    def _step_to_touch(self) -> bool:
        """Stand where the tip just touches the body that has evolved; False where that is not
        found. Time passes with the tip so far away that it does not touch on its way either.
        """
        height = self.equilibrium.scene.physics.body.height
        depth_before = self._search_points[-1].delta
        lift = max(CLEARANCE_FACTOR * self._last_rise, LIFT_STEP * height)
        for _ in range(MOST_LIFTS):
            lifted_depth = depth_before - lift
            reached_depth = self._step_to_depth(depth_before - lift)[1]
            if reached_depth != lifted_depth:
                return False
            gap = measurements.smallest_gap(self.equilibrium.observed_body)
            if gap > 0 and gap >= lift * (1 - 1 / CLEARANCE_FACTOR):
                touch = LoadPoint(lifted_depth + gap - TOUCH_GAP * height, self._search_time)
                self._last_rise, substeps = abs(touch.delta - depth_before), self._step_to(touch)
                self._substeps += substeps
                return bool(substeps)
            lift *= 2
        return False

    def _step_to_depth(self, delta: float) -> ForceDepth:
        """Stand at a depth, or as near to it as there is an equilibrium; with memory on the way
        from the last row.
        """
        if self._has_memory:
            self._points = self._search_points
            self._pending_point = None
            self.restore_last()
        self._substeps += self._step_to(LoadPoint(delta, self._search_time))
        return self._force_and_depth

    @property
    def _row_point(self) -> EquilibriumPoint:
        """The equilibrium of the last row."""
        return self._row_points[-1]

    @property
    def _force_and_depth(self) -> ForceDepth:
        return self.equilibrium.force, (self._pending_point or self._points[-1]).delta

    def restore_last(self) -> None:
        """Put the last equilibrium back, after a step that failed."""
        self.equilibrium.restore(self._last_point.state)

    def restore_row(self) -> Any:
        """Put the last row's equilibrium back, after a stop in mid-step; the body that is observed
        then.
        """
        self.equilibrium.restore(self._row_point.state)
        return self.equilibrium.observed_body

    def _step_to(self, target_point: LoadPoint) -> int:
        """Step to the target, by way of where the tip begins or ends to be felt; the number of
        steps, 0 when lost.
        """
        segment = LoadSegment(self._last_point.load_point, target_point)
        if (
            self._has_memory or segment.has_duration
        ):  # each row has steps of its own: a resumed path is the same path
            self._step_control = self._create_step_control(segment)
            if (threshold := self._attraction_threshold(target_point)) is not None:
                return (
                    (substeps_before := self._step_to(threshold))
                    and (substeps_after := self._step_to(target_point))
                    and substeps_before + substeps_after
                )
        substeps = 0
        end = segment.coordinate(target_point)
        self._step_control.begin_target(end - segment.coordinate(self._last_point.load_point))
        while (
            next_coordinate := self._step_control.next_target(
                segment.coordinate(self._last_point.load_point), end
            )
        ) is not None:
            effort_before = self.equilibrium.statistics
            if self._try_load_point(segment.load_point(next_coordinate)):
                substeps += 1
                self._step_control.record_success()
                if next_coordinate == end:
                    return substeps
            else:
                self._cuts += 1
                self._step_control.record_failure(
                    (self.equilibrium.statistics - effort_before).newton
                )
        return 0

    def _attraction_threshold(self, target_point: LoadPoint) -> LoadPoint | None:
        """The place on the way to a target, at which time stands still, where the tip begins to be
        felt, or ends.
        """
        # felt: from here on inwards
        attraction_depth = self._start_point.delta
        last_depth = self._last_point.delta
        crosses = (
            (target_point.delta < attraction_depth < last_depth)
            if self._adhesion_range
            else (last_depth < 0 < target_point.delta)
        )
        return (
            LoadPoint(attraction_depth, target_point.t)
            if crosses and target_point.t == self._last_point.load_point.t
            else None
        )

    def _try_load_point(self, load_point: LoadPoint) -> bool:
        """Solve at a place; where an adhering tip snaps or that fails, by a short step to where the
        body rests.
        """
        is_found = self._solve_load_point(load_point)
        delta = load_point.delta
        has_snapped = is_found and self._is_touching != self._last_point.is_touching
        if self._adhesion_range and (has_snapped or not is_found):
            self.restore_last()
            is_found = not self._is_long_step(delta) and self.equilibrium.relax_to_stable_state(
                delta, load_point.t - self._last_point.load_point.t
            )
        if not is_found:
            self.restore_last()
            return False
        self._pending_point = EquilibriumPoint(load_point, None, is_touching=self._is_touching)
        return True

    def _solve_load_point(self, load_point: LoadPoint) -> bool:
        """Where time passes while the depth does not change as it did a step sets out from the last
        state: what is extrapolated through a hold leads nowhere.
        """
        delta = load_point.delta
        dt = load_point.t - self._last_point.load_point.t
        earlier_points = (
            []
            if dt and not self._keeps_speed(load_point)
            else _extrapolation_points(self._points, delta)
        )
        if (
            is_extrapolated := len(earlier_points) > 1
        ):  # by the line or parabola through the last states
            self.equilibrium.extrapolate(delta, [point.state for point in earlier_points])
            if self.equilibrium.solve(delta, dt):
                return True
        self.restore_last()
        if (
            is_extrapolated and self._adhesion_range and self._is_long_step(delta)
        ):  # a shorter step costs less than another fifty iterations
            return False
        return self.equilibrium.solve(delta, dt)

    def _keeps_speed(self, load_point: LoadPoint) -> bool:
        """Whether the depth changes as fast on the way to a place as on the way to where the walk
        stands.
        """
        point_before, last_load_point = (
            point.load_point for point in [self._points[0], *self._points][-2:]
        )
        elapsed = last_load_point.t - point_before.t
        dt = load_point.t - last_load_point.t
        if elapsed <= 0 or load_point.delta == last_load_point.delta:
            return False
        speed = (load_point.delta - last_load_point.delta) / dt
        speed_before = (last_load_point.delta - point_before.delta) / elapsed
        return abs(speed - speed_before) <= SPEED_TOLERANCE * abs(speed)

    @property
    def _is_touching(self) -> bool:
        return self._adhesion_range > 0 and bool(self.equilibrium.state_values()["a"] > 0)

    def _is_long_step(self, delta: float) -> bool:
        return abs(delta - self._last_point.delta) > SNAP_STEP_RANGES * self._adhesion_range


def _extrapolation_points(
    equilibria: list[EquilibriumPoint], delta: float
) -> list[EquilibriumPoint]:
    """The last points from which the path leads straight on to delta; one alone where nothing is
    predicted.
    """
    step = (
        delta - equilibria[-1].delta
    )  # not a small one: the contact edge leaves kinks in the states
    most_points = 3 if abs(step) <= LARGEST_PARABOLA_STEP * abs(delta) else 2
    earlier_points = equilibria[-1:]
    for point_before, point_after in zip(equilibria[-2::-1], equilibria[:0:-1], strict=True):
        step_behind = point_after.delta - point_before.delta
        is_near = (
            step_behind != 0 and -1 < step / step_behind <= 2
        )  # between the two, or not far out
        is_repeated = any(point.delta == point_before.delta for point in earlier_points)
        if not is_near or is_repeated or len(earlier_points) == most_points:
            break
        earlier_points = [point_before, *earlier_points]
    return earlier_points
