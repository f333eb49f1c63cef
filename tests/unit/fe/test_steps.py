"""The step rule of a load path, and the walk on a body that is a formula: no solver."""

from __future__ import annotations

from math import inf
from types import SimpleNamespace
from typing import Any

import pytest

from indent_sim.fe.path.steps import PATIENCE, StepRule
from indent_sim.fe.path.walk import Walk
from indent_sim.model.loading import LoadPath


def test_a_target_is_reached_in_one_step_where_nothing_fails() -> None:
    rule = StepRule()
    rule.begin(0.3)
    assert rule.goal(0.1, 0.4) == 0.4


def test_a_failed_step_is_halved_and_the_parts_are_equal() -> None:
    rule = StepRule()
    rule.begin(1.0)
    assert rule.goal(0.0, 1.0) == 1.0
    rule.failed()
    assert rule.goal(0.0, 1.0) == 0.5
    rule.failed()
    assert rule.goal(0.0, 1.0) == 0.25
    assert rule.goal(0.25, 1.0) == pytest.approx(0.5)  # three parts of 0.75


def test_two_successes_double_the_step_and_it_is_kept_for_the_next_target() -> None:
    rule = StepRule()
    rule.begin(1.0)
    rule.goal(0.0, 1.0)
    rule.failed()
    for _ in range(2):
        rule.succeeded()
    assert rule.longest == 1.0
    rule.failed()
    rule.begin(3.0)
    assert rule.longest == 0.5


def test_no_step_is_longer_than_the_limit_but_through_the_air() -> None:
    rule = StepRule(limit=0.25)
    rule.begin(1.5)
    assert rule.goal(-0.5, 1.0) == 0.25  # from 0 on in four parts
    assert rule.goal(0.25, 1.0) == 0.5
    for _ in range(4):
        rule.succeeded()
    assert rule.longest == 0.25
    assert rule.goal(1.0, -9.0) == 0.75  # to 0 in four parts
    assert rule.goal(0.25, -9.0) == -9.0
    assert rule.goal(-9.0, -1.0) == -1.0


def test_a_target_is_given_up_after_many_failures_and_not_by_chance_of_its_size() -> None:
    for distance in (1e-12, 1.0, 1e9):
        rule, failures = StepRule(), 0
        rule.begin(distance)
        while rule.goal(0.0, distance) is not None:
            rule.failed()
            failures += 1
        assert failures == PATIENCE


class Spring:
    """F = delta^2; it solves no step longer than `reach`, and with `memory` going back wears it out."""

    def __init__(self, reach: float = inf, memory: bool = False):
        physics = SimpleNamespace(body=SimpleNamespace(height=10.0), deltas=(1.0,) * 9, gap="reference",
                                  adheres=False, has_friction=memory,
                                  contact=SimpleNamespace(adhesion=None))  # fmt: skip
        self.scene = SimpleNamespace(physics=physics)
        self.depth, self.worn, self.solves, self.has_memory = 0.0, 0.0, 0, memory
        self.reach, self.failure, self.force_tolerance = reach, "too far", 1e-10

    iterations = property(lambda self: self.solves)
    krylov_iterations = None
    dissipation = 0.0
    force = property(lambda self: self.depth**2 - self.worn)

    def solve(self, depth: float) -> bool:
        self.solves += 1
        if abs(depth - self.depth) > self.reach:
            return False
        self.worn += max(self.depth - depth, 0.0) if self.has_memory else 0.0
        self.depth = depth
        return True

    def snapshot(self) -> Any:
        return self.depth, self.worn

    def restore(self, state: Any, depth: float) -> None:
        self.depth, self.worn = state

    def predict(self, depth: float, earlier: Any) -> None:
        """A guess changes nothing here."""

    def numbers(self) -> dict[str, Any]:
        return {"force": self.force, "a": 1.0, "p_max": 1.0, "penetration": 0.0, "energy": 0.0}

    def pack(self, state: Any) -> list[Any]:
        return [state]

    def unpack(self, arrays: Any) -> Any:
        return arrays[0]

    def depart(self) -> None:
        """What it goes back is all that it remembers."""

    def sharpen(self) -> None:
        """Exact already."""


def walked(body: Spring, control: str, *values: float) -> list[Any]:
    return list(Walk(body).states(LoadPath(control, values), lambda step: False))  # type: ignore[arg-type]


def test_depths_are_walked_and_substeps_counted() -> None:
    states = walked(Spring(reach=0.3), "depth", 1.0, 0.5)
    assert [state.delta for state in states] == [1.0, 0.5]
    assert states[0].substeps >= 4  # 1.0 in steps of at most 0.3


def test_a_force_is_found_within_the_tolerance() -> None:
    (state,) = walked(Spring(), "force", 2.0)
    assert state.delta == pytest.approx(2**0.5, rel=1e-9)  # half the force's tolerance, as delta = sqrt(F)


def test_with_memory_no_try_of_a_force_wears_the_body_out() -> None:
    """Every try begins at the last row: what the tries before went back by is forgotten."""
    body = Spring(memory=True)
    states = walked(body, "force", 2.0, 3.0)
    assert [state.force for state in states] == pytest.approx([2.0, 3.0], rel=1e-9)
    assert body.worn == 0.0


def test_a_resumed_walk_with_memory_goes_the_whole_way() -> None:
    straight, whole = Spring(), Spring(memory=True)
    deltas = (1.0, 3.0, 2.0, 2.5, 2.75)
    assert Walk(straight).resume([], deltas) and Walk(whole).resume([], deltas)  # type: ignore[arg-type]
    assert straight.solves == 3 and whole.solves == 5
    assert whole.worn == 1.0  # from 3 to 2, as when it was not interrupted
