"""Load stepping: increments with extrapolation, cutback and recovery along a load path.

Each increment is started from an extrapolation of the previous equilibria, solved, and cut back if
the solution fails (Belytschko et al. 2014, chapter 6.6). One or more increments lead to each
prescribed depth or force, whose results are a row of the force table.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf
from typing import Any

import numpy as np

from indent_sim.fe.measured_constants import (
    FINEST_TOLERANCE,
    LONGEST_STEP_RANGES,
    SNAP_STEP_RANGES,
    SOFT_TIP_FORCE_SCATTER,
)
from indent_sim.fe.path.equilibrium import Equilibrium
from indent_sim.fe.path.failure import LastEquilibrium, failed_state
from indent_sim.fe.path.load_control import FORCE_SLACK, ForceDepth, LoadControl
from indent_sim.fe.path.load_segment import LoadPoint, LoadSegment
from indent_sim.fe.path.pull_off import (
    PullPoint,
    UnloadingBranch,
    find_largest_pull,
    force_oscillation,
)
from indent_sim.fe.path.step_size_control import StepSizeControl
from indent_sim.fe.postprocessing.contact_sample import smallest_gap
from indent_sim.fe.postprocessing.surface_table import surface_table
from indent_sim.model.load_path import LoadPath, Unloading
from indent_sim.model.state import PullOff, State

# Largest number of halvings of a time step in which the depth of a prescribed force is not found.
MAX_HALVINGS = 4
# Largest number of attempts to place a row of unloading of a body that yields. The last row of a
# cone on steel needs 3; without success its `residual_depth` is NaN.
MAX_PLACEMENTS = 4


@dataclass(frozen=True)
class EquilibriumPoint:
    """Equilibrium at a point of the load path."""

    load_point: LoadPoint
    state: Any
    dissipation: float = 0.0  # dissipated energy on the path to it [energy]
    is_touching: bool = False  # known only for adhesive tips

    @property
    def delta(self) -> float:
        """Indentation depth [length]."""
        return self.load_point.delta


# A state as in a checkpoint: depth [length], time, and arrays of unknowns.
PackedState = tuple[float, float, Sequence[np.ndarray]]


class LoadStepper:
    """Solves the equilibria along a path of prescribed depths or forces.

    Each increment is started from an extrapolation and cut back if its solution fails.

    Parameters
    ----------
    equilibrium
        The body under the tip, whole or condensed.
    started
        Time of `time.perf_counter` at which the column `wall_s` is zero; now if None.
    """

    def __init__(self, equilibrium: Equilibrium, started: float | None = None):
        self.equilibrium = equilibrium
        physics = equilibrium.scene.physics
        self._has_memory = equilibrium.has_memory
        # Range of the attraction [length]; 0 without adhesion.
        self._adhesion_range = physics.contact.adhesion_range
        self.started = time.perf_counter() if started is None else started
        # An adhesive tip starts at 12 ranges above the body, where the attraction is 6e-6 of that
        # at first contact. `0.0 -` avoids -0.0.
        start = LoadPoint(0.0 - 12.0 * self._adhesion_range)
        # The last equilibria, beginning with the undeformed body
        self._points = [EquilibriumPoint(start, equilibrium.snapshot())]
        self._start_point = self._points[0]
        # Equilibria up to the last row, from which the next increment is extrapolated
        self._row_points = self._points
        # Equilibria from which the search for the depth of a force starts
        self._search_points = self._points
        # Equilibrium that was found but is not accepted yet
        self._pending_point: EquilibriumPoint | None = None
        self._step_control = self._create_step_control()
        self._substeps = 0
        self._cuts = 0
        self._search_slide = 0.0  # slide at which the depth of a force is searched for
        # Number of increments to each trial depth of a search; 0 if there is no search
        self._search_increments = 0
        self._search_time = 0.0  # time at which the depth of a force is searched for
        # Change of the depth of first contact in the last increment, for a body that changes in
        # time
        self._last_rise = 0.0
        self._unloading: UnloadingBranch | None = (
            UnloadingBranch() if physics.searches_pull_off else None
        )
        self._load_control = LoadControl(
            self._step_to_depth,
            physics.body.height,
            starts_from_row=self._has_memory,
            slack=SOFT_TIP_FORCE_SCATTER if physics.has_two_bodies else FORCE_SLACK,
        )

    def _create_step_control(self, segment: LoadSegment | None = None) -> StepSizeControl:
        """Create a step size control with no failures recorded.

        On a segment with duration the step limits are converted from depth to time. Increments
        before first contact are skipped only if the body does not change in time, because a body
        that changes may touch the tip at any depth.
        """
        scene = self.equilibrium.scene
        longest_step = inf
        always_tried_step = inf
        if scene.physics.gap == "current":
            # The gap at the deformed point is nonlinear in u, so that a longer increment may end in
            # another solution. In a body that yields long increments also make the force too small.
            fraction = 0.14 if scene.physics.yields else 0.25
            longest_step = fraction * scene.plan.prediction["a"] / scene.physics.scales.length
        if self._adhesion_range:
            longest_step = min(longest_step, LONGEST_STEP_RANGES * self._adhesion_range)
            always_tried_step = SNAP_STEP_RANGES / 4 * self._adhesion_range
        if segment and segment.slides and not segment.has_duration:
            # Increments of a slide have the same largest length as increments of the depth.
            return StepSizeControl(longest_step, -inf)
        if segment and segment.has_duration:
            return StepSizeControl(
                segment.coordinate_length(longest_step),
                -inf,
                segment.coordinate_length(always_tried_step),
                slides_around_edge=scene.physics.slides_around_edge,
            )
        return StepSizeControl(
            longest_step,
            -inf if scene.physics.is_time_dependent else self._start_point.delta,
            always_tried_step,
            slides_around_edge=scene.physics.slides_around_edge,
        )

    @property
    def _last_point(self) -> EquilibriumPoint:
        """The last equilibrium, which is accepted first if its acceptance is still pending.

        Read this property only after all results of the increment have been evaluated.
        """
        self._accept_pending()
        return self._points[-1]

    def _accept_pending(self) -> None:
        """Accept the equilibrium that was found last, which updates the internal variables.

        Results of the increment, such as its dissipation, must be evaluated before.
        """
        if (pending := self._pending_point) is None:
            return
        self._pending_point = None
        last_point = self._points[-1]
        dissipation = self.equilibrium.accept()
        # Equilibria before a snap are no basis for an extrapolation beyond it
        has_snapped = pending.is_touching != last_point.is_touching
        earlier_points = [] if has_snapped else self._points[-2:]
        pending = replace(
            pending,
            state=self.equilibrium.snapshot(),
            dissipation=last_point.dissipation + dissipation,
        )
        self._points = [*earlier_points, pending]

    @property
    def points(self) -> list[tuple[float, float, list[np.ndarray]]]:
        """Depth, time and packed state arrays of the last equilibria, as stored in a checkpoint.

        For a path-dependent body the last of them is the equilibrium of the last row of the force
        table.
        """
        points = self._row_points if self._has_memory else self._points
        packed = [
            (point.delta, point.load_point.t, self.equilibrium.pack(point.state))
            for point in points
        ]
        return [(delta, t, arrays) for delta, t, arrays in packed if arrays]

    @property
    def pull_off_points(self) -> dict[int, PackedState]:
        """Packed states around the largest tensile force, by load point number, for `resume`."""
        packed: dict[int, PackedState] = {}
        for point in self._unloading.search_points if self._unloading else ():
            packed[point.number] = point.delta, point.t, self.equilibrium.pack(point.state.state)
        return packed

    def resume(
        self,
        points: Sequence[PackedState],
        later_load_points: Sequence[tuple[float, ...]],
        step: int = 0,
        pull_off_points: Mapping[int, PackedState] | None = None,
    ) -> bool:
        """Return to the state at which an earlier run stopped; return False on failure.

        If the equilibrium does not depend on the path, only the last three load points are solved,
        from which the next one is extrapolated. Otherwise, or if that fails, all load points since
        the checkpoint are solved again.

        Parameters
        ----------
        points, pull_off_points
            The attributes of the same names, from the checkpoint of the earlier run.
        later_load_points
            Depth [length], time and slide [length] of each load point after the checkpoint.
        step
            Number of the row of the force table, counted from 1, at which the earlier run stopped.

        Returns
        -------
        bool
            False if an equilibrium was not found again.
        """
        unpacked = [
            (delta, t, self.equilibrium.unpack(delta, arrays, t)) for delta, t, arrays in points
        ]
        resumed_points = [
            EquilibriumPoint(LoadPoint(delta, t, state.slide), state)
            for delta, t, state in unpacked
            if state is not None
        ]
        load_points = [LoadPoint(*point) for point in later_load_points]
        if resumed_points and self._adhesion_range:
            self._points = resumed_points
        else:
            self._points = [*self._points, *resumed_points][-3:]
        self.restore_last()
        self._points[-1] = replace(self._last_point, is_touching=self._is_touching)
        self._load_control.add_curve_point(*self._force_and_depth)
        if self._unloading is not None and not self._resume_unloading(pull_off_points or {}, step):
            return False
        start_points = self._points
        is_reached = not self._has_memory and all(
            self._step_to(load_point) for load_point in load_points[-3:]
        )
        if not is_reached:
            self._points = start_points
            self._step_control = self._create_step_control()
            self.restore_last()
            is_reached = all(self._step_to_row(load_point) for load_point in load_points)
        self._accept_pending()
        self._row_points = self._points
        return is_reached

    def _step_to_row(self, load_point: LoadPoint) -> int:
        """Solve a load point of the earlier run; return the number of increments, 0 on failure."""
        earlier_points = self._points
        substeps = self._step_to(load_point)
        if self.equilibrium.scene.physics.path.control == "force":
            self._points = self._points_after_search(earlier_points)
        if substeps:
            self._record_unloading_point()
        return substeps

    def _resume_unloading(self, packed: Mapping[int, PackedState], step: int) -> bool:
        """Restore the load points around the smallest force during unloading from a checkpoint.

        Parameters
        ----------
        packed
            `pull_off_points` of the earlier run.
        step
            Number of the row of the force table, counted from 1, at which that run stopped.

        Returns
        -------
        bool
            False if the arrays do not belong to this body.
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
        """Return `point`, the present equilibrium, as a `PullPoint` for the pull-off search."""
        a = float(self.equilibrium.state_values()["a"])
        return PullPoint(point.delta, point.load_point.t, self.equilibrium.force, a, point, number)

    def _record_unloading_point(self) -> None:
        """Record the present load point for the pull-off search, if one is requested."""
        if self._unloading is not None:
            self._unloading = self._unloading.add_point(self._pull_point(self._last_point))

    def find_pull_off(self) -> PullOff | None:
        """Search for the smallest force during unloading, around the row with the smallest force.

        Afterwards the body is restored to the equilibrium of the last row.

        Returns
        -------
        PullOff or None
            Pull-off in nondimensional units; None if no row with a tensile force lies between two
            rows of unloading.

        Raises
        ------
        NotConverged
            If an equilibrium between these rows is not found again.
        """
        bracket = self._unloading.bracket if self._unloading else None
        if bracket is None:
            return None
        body = self.equilibrium
        statistics_before = body.statistics
        try:
            largest = find_largest_pull(
                *bracket, self._equilibrium_between, self._pull_off_tolerance
            )
            body.restore(largest.point.state.state)
            effort = body.statistics - statistics_before
            values = body.state_values() | {"newton_iterations": effort.newton}
            values["wall_s"] = time.perf_counter() - self.started
            state = State(step=0, delta=largest.point.delta, **values)
        finally:
            self._points = self._row_points
            self._pending_point = None
            self.restore_last()
        oscillation = 2 * self._force_oscillation(largest.point) * abs(state.force)
        return PullOff(state, largest.error + oscillation, largest.equilibria)

    def _pull_off_tolerance(self, point: PullPoint) -> float:
        """Return the tolerance of the pull-off search, relative to the force."""
        return max(self._force_oscillation(point), FINEST_TOLERANCE)

    def _force_oscillation(self, point: PullPoint) -> float:
        """Return the relative amplitude of the mesh-induced oscillation of the force."""
        scene = self.equilibrium.scene
        assert scene.plan.adhesion is not None
        elements_in_zone = scene.plan.adhesion.elements
        elements_in_contact = max(point.a / scene.sizes.h_contact, 1.0)
        return force_oscillation(
            min(elements_in_zone, elements_in_contact) if point.is_touching else elements_in_zone
        )

    def _equilibrium_between(self, begin: PullPoint, end: PullPoint, delta: float) -> PullPoint:
        """Solve the equilibrium at a depth between `begin` and `end`, starting from `begin`."""
        fraction = (delta - begin.delta) / (end.delta - begin.delta)
        load_point = LoadPoint(delta, begin.t + fraction * (end.t - begin.t))
        self._points = [begin.state]
        self._pending_point = None
        self.restore_last()
        if not self._step_to(load_point):
            return PullPoint(delta, load_point.t, inf, a=0.0)
        return self._pull_point(self._last_point)

    def _points_after_search(
        self, earlier_points: list[EquilibriumPoint]
    ) -> list[EquilibriumPoint]:
        """Return the equilibria from which the increment after a prescribed force is extrapolated.

        The trial depths of the search are too close together for an extrapolation. The two
        equilibria before the search and the one at the prescribed force are used instead.
        """
        return [*earlier_points[-2:], self._last_point]

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of time integration stages, cutbacks and changes of the contact seal so far."""
        effort = self.equilibrium.statistics
        return {"stages": effort.stages, "cuts": self._cuts, "switches": effort.seal_changes}

    @property
    def failure(self) -> str:
        """Reason why the last prescribed depth or force was not reached."""
        return (
            self._load_control.failure
            or f"{self.equilibrium.failure}, even after all cutbacks of the increment"
        )

    def states(
        self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0
    ) -> Iterator[State]:
        """Solve the path and yield one State per prescribed value.

        Parameters
        ----------
        path
            Prescribed depths or forces.
        wants_surface
            Function of the number of a row that returns whether the surface table of this row is
            needed.
        done
            Number of values that an earlier run has finished.

        Yields
        ------
        State
            State of each row; the last one describes the failure if a row did not converge.
        """
        body = self.equilibrium
        if path.control == "force":
            self._load_control.tolerance = body.tighten_tolerance()
            if self._adhesion_range:
                self._search_points = self._points
                self._load_control.measure_pull_at_contact()
        depths = list(path.values[:done])
        unloading = path.unloading
        if unloading and not body.scene.physics.searches_unloading_depths:
            unloading = None
        for step, value in enumerate(path.values[done:], start=done + 1):
            statistics_before = body.statistics
            substeps = 0
            goes_back = unloading is not None and step > unloading.start
            if unloading is not None and goes_back:
                substeps = self._step_back(unloading, step, depths)
            points = zip(path.segment(step), path.segment_slides(step), strict=True)
            for (depth, t), slide in () if goes_back else points:
                if substeps:  # the last equilibrium is a load point between two rows
                    self._record_unloading_point()
                segment_substeps = (
                    self._step_to(LoadPoint(depth, t, slide))
                    if path.control == "depth"
                    else self._step_to_force(depth, t, step, slide=slide)
                )
                substeps = segment_substeps and substeps + segment_substeps
                if not segment_substeps:
                    break
            effort = body.statistics - statistics_before
            if not substeps:
                cost = (effort.newton, time.perf_counter() - self.started)
                inverted = body.observed_body.find_inverted_elements()
                yield failed_state(
                    body.scene, step, value, self._last_equilibrium, self.failure, inverted, cost
                )
                return
            values = body.state_values() | {
                "substeps": substeps,
                "krylov_iterations": effort.krylov,
            }
            surface = surface_table(body.observed_body) if wants_surface(step) else None
            if path.control == "force":
                self._points = self._points_after_search(self._search_points)
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
            if path.slides:
                values["x"] = path.slide(step)
            if path.times:
                values |= {"t": path.times[step - 1], "branch": path.branches[step - 1]}
            depths.append(self._last_point.delta)
            yield State(step=step, delta=depths[-1], surface=surface, **values)

    def _step_back(self, unloading: Unloading, step: int, depths: Sequence[float]) -> int:
        """Solve the next row of unloading of a body that yields; return its number of increments.

        The rows divide the depth that the body recovers into equal parts. This depth is searched
        for before the first row, and again before the last one, since the reverse flow of the rows
        between them changes it. If contact is lost earlier than expected, the remaining rows are
        distributed anew; if the tip still touches the body at the last row, it is lifted further.

        Parameters
        ----------
        unloading
            The rows of unloading.
        step
            Number of the row, from 1.
        depths
            Depths of the earlier rows [length].

        Returns
        -------
        int
            0 if the row was not reached.
        """
        rows_left = unloading.last - step + 1
        row_depth = self._last_point.delta
        end = (
            self._end_of_unloading(unloading.to)
            if rows_left in (1, unloading.rows)
            else row_depth - rows_left * (depths[-2] - row_depth)
        )
        substeps = 0
        for _ in range(MAX_PLACEMENTS):
            if end is None:
                return 0
            increments = self._step_to(LoadPoint(row_depth - (row_depth - end) / rows_left))
            if not increments:
                return 0
            substeps += increments
            is_touching = self.equilibrium.force > 0
            # The last row is where contact is lost, all others are before.
            if is_touching == (rows_left > 1) or (rows_left == 1 and end <= unloading.to):
                break
            if rows_left > 1:
                self._restore_equilibria(self._row_points)
                substeps = 0
            end = self._end_of_unloading(unloading.to)
        return substeps

    def _end_of_unloading(self, to: float) -> float | None:
        """Return the depth at which unloading from the last row ends; None if it is not found.

        The tip is lifted until contact is lost. The body then no longer moves, so that contact was
        lost at the depth of the lifted tip plus the smallest gap. Afterwards the equilibrium of the
        last row is restored.

        Parameters
        ----------
        to
            Smallest depth of unloading [length].
        """
        self._accept_pending()
        row_points = self._points
        physics = self.equilibrium.scene.physics
        depth = self._last_point.delta
        lift_factor = 1.0
        while self.equilibrium.force > 0 and depth > to:
            # An elastic contact of the stiffness S = 2 E* a recovers at most 2 F/S.
            a = float(self.equilibrium.state_values()["a"])
            stiffness = physics.material.E_star * a ** (physics.scales.dim - 2)
            depth = max(to, depth - lift_factor * self.equilibrium.force / stiffness)
            lift_factor *= 2
            if not self._step_to(LoadPoint(depth)):
                self._restore_equilibria(row_points)
                return None
        end = to
        if self.equilibrium.force <= 0:
            gap = smallest_gap(self.equilibrium.observed_body)
            # The tip stops above the body by more than round-off, so that the force is zero.
            clearance = max(1e-6 * gap, 1e-10 * row_points[-1].delta)
            end = max(to, depth + gap - clearance)
        self._restore_equilibria(row_points)
        return end

    def _restore_equilibria(self, points: list[EquilibriumPoint]) -> None:
        """Restore the last of the given equilibria and discard all increments after it."""
        self._points = points
        self._pending_point = None
        self.restore_last()

    def _step_to_force(
        self,
        force: float,
        t: float,
        step: int,
        halvings: int = MAX_HALVINGS,
        slide: float = 0.0,
    ) -> int:
        """Find the equilibrium at a force and time; return the number of increments, 0 on failure.

        A time step in which the depth of the force is not found is halved; the force is linear in
        time within the step.
        """
        start_time = self._last_point.load_point.t
        start_force = self.equilibrium.force
        start_slide = self._last_point.load_point.slide
        substeps = self._find_depth_of_force(force, t, step, slide)
        if substeps or not halvings or t == start_time:
            return substeps
        self._cuts += 1
        self._points = self._search_points
        self._pending_point = None
        self.restore_last()
        middle_force = (start_force + force) / 2
        middle_time = (start_time + t) / 2
        middle_slide = (start_slide + slide) / 2
        first_substeps = self._step_to_force(
            middle_force, middle_time, step, halvings - 1, middle_slide
        )
        if not first_substeps:
            return 0
        last_substeps = self._step_to_force(force, t, step, halvings - 1, slide)
        return last_substeps and first_substeps + last_substeps

    def _find_depth_of_force(self, force: float, t: float, step: int, slide: float) -> int:
        """Find the depth of a force at a time; return the number of increments, 0 on failure."""
        self._accept_pending()
        self._search_points = self._points
        substeps = self._substeps
        physics = self.equilibrium.scene.physics
        expected = physics.deltas[step - 1] or self._adhesion_range
        self._search_time = t
        self._search_slide = slide
        if force == 0 and physics.is_time_dependent and not self._adhesion_range:
            return self._substeps - substeps if self._find_first_contact() else 0
        # At every row of a slide the force is another function of the depth.
        is_same_curve = slide == self._last_point.load_point.slide and not (
            physics.is_time_dependent and t > 0
        )
        if t == self._last_point.load_point.t and is_same_curve:
            is_found = (
                self._find_depth_of_yielding_body(force, expected)
                if physics.yields
                else self._load_control.find_depth(force, expected)
            )
            return self._substeps - substeps if is_found else 0
        delta = self._last_point.delta or expected
        a = self.equilibrium.scene.plan.prediction["a"] / physics.scales.length
        # The contact seal is frozen during a search. Where it does not fit the contact that was
        # found, the same increment, which is not accepted yet, is searched again with a new seal.
        for _ in range(6):
            if not self._load_control.find_by_secant(force, delta, 2 * physics.material.E_star * a):
                return 0
            delta = self._force_and_depth[1]
            if self.equilibrium.is_seal_consistent():
                break
        return self._substeps - substeps

    def _find_depth_of_yielding_body(self, force: float, expected: float) -> bool:
        """Find the depth of a force on a body that yields; return True if it was found.

        Loading and unloading follow different curves, which both begin at the equilibrium of the
        last row. The computed force jumps at a depth beyond which one more increment is used. A
        force within this jump is searched for again, with the same number of increments to every
        trial depth.

        Parameters
        ----------
        force
            Prescribed force [force]; at 0 contact is just lost.
        expected
            Expected depth of the first row [length].
        """
        row = self._last_point
        row_force = self.equilibrium.force
        if force == 0:
            end = self._end_of_unloading(0.0)
            return end is not None and self._step_to_depth(end)[1] == end
        physics = self.equilibrium.scene.physics
        a = self.equilibrium.scene.plan.prediction["a"] / physics.scales.length
        a = float(self.equilibrium.state_values()["a"]) or a
        stiffness = 2 * physics.material.E_star * a ** (physics.scales.dim - 2)
        # Plastic flow makes the contact more compliant than this stiffness, so that the first trial
        # depth is too small.
        delta = row.delta + (force - row_force) / stiffness if row.delta > 0 else expected
        self._load_control.forget_curve()
        if self._load_control.find_by_secant(force, delta, stiffness):
            return True
        if not self._load_control.failure:
            return False
        delta = self._force_and_depth[1]
        self._search_increments = ceil(
            abs(delta - row.delta) / self._create_step_control().max_step
        )
        self._load_control.forget_curve()
        is_found = self._load_control.find_by_secant(force, delta, stiffness)
        self._search_increments = 0
        return is_found

    def _find_first_contact(self) -> bool:
        """Find the depth at which the tip just touches a time-dependent body; return True if found.

        The tip is lifted clear of the body for the time step, and the remaining gap is then
        subtracted. The lift is doubled until the tip does not touch the body.
        """
        height = self.equilibrium.scene.physics.body.height
        depth_before = self._search_points[-1].delta
        # The tip is lifted to measure its gap. The lift is large enough if the body then rises by
        # less than a fifth of it.
        clearance_factor = 5.0
        lift = max(clearance_factor * self._last_rise, 1e-3 * height)
        for _ in range(12):
            lifted_depth = depth_before - lift
            reached_depth = self._step_to_depth(depth_before - lift)[1]
            if reached_depth != lifted_depth:
                return False
            gap = smallest_gap(self.equilibrium.observed_body)
            if gap > 0 and gap >= lift * (1 - 1 / clearance_factor):
                # The tip overlaps the body by 1e-9 of its height, so that there is a contact
                touch = LoadPoint(
                    lifted_depth + gap - 1e-9 * height, self._search_time, self._search_slide
                )
                self._last_rise = abs(touch.delta - depth_before)
                substeps = self._step_to(touch)
                self._substeps += substeps
                return bool(substeps)
            lift *= 2
        return False

    def _step_to_depth(self, delta: float) -> ForceDepth:
        """Step to a depth, or as close as an equilibrium exists; return force and depth there.

        For a path-dependent body the stepping starts at the equilibrium of the last row.
        """
        if self._has_memory:
            self._restore_equilibria(self._search_points)
        self._substeps += self._step_to(LoadPoint(delta, self._search_time, self._search_slide))
        return self._force_and_depth

    @property
    def _row_point(self) -> EquilibriumPoint:
        """Equilibrium of the last row."""
        return self._row_points[-1]

    @property
    def _force_and_depth(self) -> ForceDepth:
        return self.equilibrium.force, (self._pending_point or self._points[-1]).delta

    @property
    def _last_equilibrium(self) -> LastEquilibrium:
        """Force, depth and time of the last equilibrium."""
        last = self._pending_point or self._points[-1]
        start_time = self.equilibrium.scene.physics.path.start_time or 0.0
        load_point = last.load_point
        return LastEquilibrium(
            self.equilibrium.force, last.delta, start_time + load_point.t, load_point.slide
        )

    def restore_last(self) -> None:
        """Restore the last accepted equilibrium after a failed increment."""
        self.equilibrium.restore(self._last_point.state)

    def restore_row(self) -> Any:
        """Restore the equilibrium of the last row after an interruption; return the body."""
        self.equilibrium.restore(self._row_point.state)
        return self.equilibrium.observed_body

    def _step_to(self, target_point: LoadPoint) -> int:
        """Advance to a load point; return the number of increments, 0 if it was not reached.

        One increment ends exactly at first contact, or at the depth where adhesion begins.
        """
        segment = LoadSegment(self._last_point.load_point, target_point)
        if self._has_memory or segment.has_duration or segment.slides:
            # The step size control is created anew for each target, so that a resumed path has
            # the same increments
            self._step_control = self._create_step_control(segment)
            if self._search_increments:
                distance = abs(segment.end.delta - segment.begin.delta)
                self._step_control = StepSizeControl(distance / self._search_increments, -inf)
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
            statistics_before = self.equilibrium.statistics
            if self._try_load_point(segment.load_point(next_coordinate)):
                substeps += 1
                self._step_control.record_success()
                if next_coordinate == end:
                    return substeps
            else:
                self._cuts += 1
                self._step_control.record_failure(
                    (self.equilibrium.statistics - statistics_before).newton
                )
        return 0

    def _attraction_threshold(self, target_point: LoadPoint) -> LoadPoint | None:
        """Return the load point before the target at which the tip begins to act on the body.

        At this point the tip touches the body, or the attraction of an adhesive tip begins. The
        result is None if no such point is passed, or if the target is at a later time than the
        present state.
        """
        attraction_depth = self._start_point.delta
        last_depth = self._last_point.delta
        if self._adhesion_range:
            crosses = target_point.delta < attraction_depth < last_depth
        else:
            crosses = last_depth < 0 < target_point.delta
        if crosses and target_point.t == self._last_point.load_point.t:
            return LoadPoint(attraction_depth, target_point.t, self._last_point.load_point.slide)
        return None

    def _try_load_point(self, load_point: LoadPoint) -> bool:
        """Solve one increment; return whether it succeeded.

        If an adhesive tip snaps, or Newton's method fails for an adhesive tip, the increment is
        solved again by dynamic relaxation, provided that it is short (`_is_long_step`); a longer
        one counts as failed and is cut back.
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
        """Solve one increment from an extrapolation, then from the last equilibrium.

        If the speed of the tip has changed, as at the beginning of a hold, no extrapolation is
        made, because it would be wrong. Nor is one made for a body that yields: a small error of an
        extrapolated displacement amounts to many yield strains, and a cycle of loading and
        unloading took twice the iterations.
        """
        delta = load_point.delta
        dt = load_point.t - self._last_point.load_point.t
        earlier_points: list[EquilibriumPoint] = []
        # The state of a body that yields, or below a tip that slides, is not a function of the
        # depth alone.
        is_sliding = load_point.slide != self._points[0].load_point.slide
        may_extrapolate = not (is_sliding or self.equilibrium.scene.physics.yields)
        if may_extrapolate and (not dt or self._keeps_speed(load_point)):
            earlier_points = _extrapolation_points(self._points, delta)
        is_extrapolated = len(earlier_points) > 1
        if is_extrapolated:
            self.equilibrium.extrapolate(delta, [point.state for point in earlier_points])
            if self.equilibrium.solve(delta, dt, load_point.slide):
                return True
        self.restore_last()
        if is_extrapolated and self._adhesion_range and self._is_long_step(delta):
            # A shorter increment costs less than fifty more iterations of this one
            return False
        return self.equilibrium.solve(delta, dt, load_point.slide)

    def _keeps_speed(self, load_point: LoadPoint) -> bool:
        """Return whether the tip's speed in this increment equals that of the last increment."""
        point_before, last_load_point = (
            point.load_point for point in [self._points[0], *self._points][-2:]
        )
        elapsed = last_load_point.t - point_before.t
        dt = load_point.t - last_load_point.t
        if elapsed <= 0 or load_point.delta == last_load_point.delta:
            return False
        speed = (load_point.delta - last_load_point.delta) / dt
        speed_before = (last_load_point.delta - point_before.delta) / elapsed
        # The speeds are equal up to round-off.
        return abs(speed - speed_before) <= 1e-6 * abs(speed)

    @property
    def _is_touching(self) -> bool:
        return self._adhesion_range > 0 and bool(self.equilibrium.state_values()["a"] > 0)

    def _is_long_step(self, delta: float) -> bool:
        return abs(delta - self._last_point.delta) > SNAP_STEP_RANGES * self._adhesion_range


def _extrapolation_points(
    equilibria: list[EquilibriumPoint], delta: float
) -> list[EquilibriumPoint]:
    """Return the last equilibria through which the state at a depth is extrapolated.

    Two or three are returned, or only the last one if the direction of the path has changed.
    """
    step = delta - equilibria[-1].delta
    # States are not smooth in the depth where the contact edge passes a node. Over increments
    # longer than this fraction of the depth a line is better than a parabola.
    longest_parabola_step = 0.13
    most_points = 3 if abs(step) <= longest_parabola_step * abs(delta) else 2
    earlier_points = equilibria[-1:]
    for point_before, point_after in zip(equilibria[-2::-1], equilibria[:0:-1], strict=True):
        step_behind = point_after.delta - point_before.delta
        # The depth lies between the two equilibria or not far beyond them
        is_near = step_behind != 0 and -1 < step / step_behind <= 2
        is_repeated = any(point.delta == point_before.delta for point in earlier_points)
        if not is_near or is_repeated or len(earlier_points) == most_points:
            break
        earlier_points = [point_before, *earlier_points]
    return earlier_points
