"""Step size control and load stepping on a body whose force is a formula."""

from __future__ import annotations

from math import inf
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from indent_sim.fe.path.load_stepping import LoadStepper
from indent_sim.fe.path.solver_statistics import SolverStatistics
from indent_sim.fe.path.step_size_control import (
    FAILED_ITERATIONS_PER_STEP,
    FAILED_ITERATIONS_PER_TARGET,
    MAX_FAILED_ITERATIONS,
    MAX_FAILURES,
    StepSizeControl,
)
from indent_sim.model.load_path import LoadPath


def test_a_target_is_reached_in_one_step_where_nothing_fails() -> None:
    rule = StepSizeControl()
    rule.begin_target(0.3)
    assert rule.next_target(0.1, 0.4) == 0.4


def test_a_failed_step_is_halved_and_the_parts_are_equal() -> None:
    rule = StepSizeControl()
    rule.begin_target(1.0)
    assert rule.next_target(0.0, 1.0) == 1.0
    rule.record_failure()
    assert rule.next_target(0.0, 1.0) == 0.5
    rule.record_failure()
    assert rule.next_target(0.0, 1.0) == 0.25
    assert rule.next_target(0.25, 1.0) == pytest.approx(0.5)  # three parts of 0.75


def test_a_step_that_does_not_move_on_is_given_up() -> None:
    """A failed step between two neighbouring numbers is given up, because it cannot be halved."""
    rule = StepSizeControl()
    at = 300.0
    target = float(np.nextafter(at, inf))
    rule.begin_target(target - at)
    assert rule.next_target(at, target) == target
    rule.record_failure()
    assert rule.next_target(at, target) is None


def test_two_successes_double_the_step_and_it_is_kept_for_the_next_target() -> None:
    rule = StepSizeControl()
    rule.begin_target(1.0)
    rule.next_target(0.0, 1.0)
    rule.record_failure()
    for _ in range(2):
        rule.record_success()
    assert rule.step_limit == 1.0
    rule.record_failure()
    rule.begin_target(3.0)
    assert rule.step_limit == 0.5


def test_no_step_is_longer_than_the_limit_but_through_the_air() -> None:
    rule = StepSizeControl(max_step=0.25)
    rule.begin_target(1.5)
    assert rule.next_target(-0.5, 1.0) == 0.25  # from 0 on in four parts
    assert rule.next_target(0.25, 1.0) == 0.5
    for _ in range(4):
        rule.record_success()
    assert rule.step_limit == 0.25
    assert rule.next_target(1.0, -9.0) == 0.75  # to 0 in four parts
    assert rule.next_target(0.25, -9.0) == -9.0
    assert rule.next_target(-9.0, -1.0) == -1.0


def test_a_target_is_given_up_after_many_failures_and_not_by_chance_of_its_size() -> None:
    for distance in (1e-12, 1.0, 1e9):
        rule, failures = StepSizeControl(), 0
        rule.begin_target(distance)
        while rule.next_target(0.0, distance) is not None:
            rule.record_failure()
            failures += 1
        assert failures == MAX_FAILURES


@given(tries=st.lists(st.tuples(st.integers(0, 300), st.booleans()), max_size=20))
def test_iterations_lost_on_the_way_to_a_target_are_bounded(tries: list[tuple[int, bool]]) -> None:
    """Iterations lost in failed steps to one target are bounded; the next target starts anew."""
    rule, lost, at = StepSizeControl(), 0, 0.0
    rule.begin_target(1.0)
    for cost, found in tries:
        if (goal := rule.next_target(at, 1.0)) is None:
            break
        assert lost < MAX_FAILED_ITERATIONS
        if found:
            at = min(goal, 0.999)
            rule.record_success()
        else:
            lost += cost
            rule.record_failure(cost)
    rule.begin_target(1.0)
    assert rule.next_target(at, 1.0) is not None


def test_fewer_iterations_are_lost_at_the_edge_of_a_punch() -> None:
    """The bound grows with the number of increments of full length on the way to the target."""
    for distance, step_count in ((0.1, 1), (1.0, 4)):
        rule = StepSizeControl(max_step=0.25, slides_around_edge=True)
        rule.begin_target(distance)
        most = FAILED_ITERATIONS_PER_TARGET + FAILED_ITERATIONS_PER_STEP * step_count
        assert rule.next_target(0.0, distance) is not None
        rule.record_failure(most - 1)
        assert rule.next_target(0.0, distance) is not None
        rule.record_failure(1)
        assert rule.next_target(0.0, distance) is None


class Spring:
    """A body with F = delta^2 that solves no step longer than `reach`.

    With `memory`, unloading wears it out by the way back.
    """

    def __init__(self, reach: float = inf, memory: bool = False):
        physics = SimpleNamespace(
            body=SimpleNamespace(height=10.0),
            deltas=(1.0,) * 9,
            gap="reference",
            columns=(),
            contact=SimpleNamespace(adhesion_range=0.0),
            is_time_dependent=False,
            yields=False,
            has_two_bodies=False,
            slides_around_edge=False,
            searches_pull_off=False,
            path=LoadPath("depth", (1.0,) * 9),
        )
        self.scene, self.has_memory = SimpleNamespace(physics=physics), memory
        self.depth, self.worn, self.solves, self.failure = 0.0, 0.0, 0, "too far"
        self.accepted, self.reach, self.longest_time = 0.0, reach, inf
        self.steps: list[float] = []  # of time, accepted
        self._dt = 0.0

    statistics = property(lambda self: SolverStatistics(self.solves))
    force = property(lambda self: self.depth**2 - self.worn)

    def solve(self, depth: float, dt: float = 0.0, slide: float = 0.0) -> bool:
        self.solves += 1
        if abs(depth - self.accepted) > self.reach or dt > self.longest_time:
            return False
        self.depth, self._dt = depth, dt
        return True

    def accept(self) -> float:
        self.worn += max(self.accepted - self.depth, 0.0) if self.has_memory else 0.0
        self.accepted = self.depth
        self.steps.append(self._dt)
        return 0.0

    def snapshot(self) -> Any:
        return self.depth, self.worn

    def restore(self, state: Any) -> None:
        self.depth, self.worn = state
        self.accepted = self.depth

    def extrapolate(self, depth: float, earlier: Any) -> None:
        """Set a guess that would count as unloading if it were taken for an accepted state."""
        self.depth = 1e3

    def state_values(self) -> dict[str, Any]:
        return {"force": self.force, "a": 1.0, "p_max": 1.0, "penetration": 0.0, "energy": 0.0}

    def pack(self, state: Any) -> list[Any]:
        return [state]

    def unpack(self, depth: float, arrays: Any) -> Any:
        return arrays[0]

    def tighten_tolerance(self) -> float:
        return 1e-10


def walked(body: Spring, control: str, *values: float) -> list[Any]:
    return list(LoadStepper(body).states(LoadPath(control, values), lambda step: False))  # type: ignore[arg-type]


def test_depths_are_walked_and_substeps_counted() -> None:
    states = walked(Spring(reach=0.3), "depth", 1.0, 0.5)
    assert [state.delta for state in states] == [1.0, 0.5]
    assert states[0].substeps >= 4  # 1.0 in steps of at most 0.3


def test_a_force_is_found_within_the_tolerance() -> None:
    (state,) = walked(Spring(), "force", 2.0)
    assert state.delta == pytest.approx(
        2**0.5, rel=1e-9
    )  # half the force's tolerance, as delta = sqrt(F)


def test_with_memory_no_try_of_a_force_wears_the_body_out() -> None:
    """Trials of load control leave no trace in a path-dependent body: each starts from the row."""
    body = Spring(memory=True)
    states = walked(body, "force", 2.0, 3.0)
    assert [state.force for state in states] == pytest.approx([2.0, 3.0], rel=1e-9)
    assert body.worn == 0.0


def test_a_resumed_walk_with_memory_goes_the_whole_way() -> None:
    straight, whole = Spring(), Spring(memory=True)
    deltas = (1.0, 3.0, 2.0, 2.5, 2.75)
    passed = [(delta, 0.0) for delta in deltas]
    assert LoadStepper(straight).resume([], passed) and LoadStepper(whole).resume([], passed)  # type: ignore[arg-type]
    assert straight.solves == 3 and whole.solves == 5
    assert whole.worn == 1.0  # from 3 to 2, as when it was not interrupted


def test_a_hold_is_cut_in_time() -> None:
    """A hold that fails in one increment is divided evenly in time."""
    body = Spring()
    times, branches = (0.0, 1.0), ("approach", "hold")
    path = LoadPath("depth", (1.0, 1.0), times, branches, start_time=0.0)
    rows = LoadStepper(body).states(path, lambda step: False)  # type: ignore[arg-type]
    assert next(rows).substeps == 1
    body.longest_time = 0.3
    assert [row.substeps for row in rows] == [4]
    assert body.steps == pytest.approx([0.0, 0.25, 0.25, 0.25, 0.25])
    assert (body.depth, body.accepted) == (1.0, 1.0)


def test_a_ramp_in_time_goes_straight() -> None:
    """Depth and time of a divided ramp remain proportional."""
    body = Spring(reach=0.6)
    path = LoadPath("depth", (1.0,), (4.0,), ("approach",), start_time=0.0)
    rows = LoadStepper(body).states(path, lambda step: False)  # type: ignore[arg-type]
    assert [row.substeps for row in rows] == [2]
    assert body.steps == pytest.approx([2.0, 2.0])


@pytest.mark.parametrize("reach", [inf, 0.7])
def test_what_is_remembered_knows_neither_guesses_nor_cuts(reach: float) -> None:
    """The wear of a path-dependent body does not depend on guesses, divided or failed steps.

    The tip goes back by 1.5 in total.
    """
    body = Spring(reach, memory=True)
    walked(body, "depth", 1.0, 2.0, 3.0, 2.0, 2.5, 2.0)
    assert body.worn == pytest.approx(
        1.5, abs=1e-12
    )  # sums of exact binary fractions, but for thirds of a step


@pytest.mark.parametrize("control", ["depth", "force"])
def test_rows_close_together_are_predicted_from_the_last_three(
    control: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A row is extrapolated from the last three rows, and only these are kept for a resume."""
    body, seen = Spring(), []
    monkeypatch.setattr(
        body,
        "extrapolate",
        lambda depth, earlier: seen.append((depth, [state[0] for state in earlier])),
    )
    depths = (1.0, 1.05, 1.1, 1.15)
    walk = LoadStepper(body)  # type: ignore[arg-type]
    path = LoadPath(control, depths if control == "depth" else tuple(depth**2 for depth in depths))
    assert len(list(walk.states(path, lambda step: False))) == len(depths)
    assert len(walk.points) == 3
    tried = [earlier for depth, earlier in seen if depth == pytest.approx(1.15, rel=1e-6)]
    assert tried[-1] == pytest.approx(depths[:3], rel=1e-6)


def test_a_long_way_of_which_each_longer_step_fails_is_walked() -> None:
    """A target is reached although every step above 0.3 fails, after each doubling."""
    rule, at, failures = StepSizeControl(), 0.0, 0
    rule.begin_target(20.0)
    while (goal := rule.next_target(at, 20.0)) is not None and at < 20.0:
        if goal - at > 0.3:
            rule.record_failure(1)
            failures += 1
        else:
            rule.record_success()
            at = goal
    assert at == 20.0 and failures > 10
