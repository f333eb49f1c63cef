"""Stages of the time integration on du/dt = -u, whose solution is known."""

from __future__ import annotations

import math

import pytest

from indent_sim.fe.terms.time_integration import sdirk2_stages


def decayed(time: float, steps: int) -> float:
    """Return u at a time from u = 1; each stage is a backward Euler step."""
    u = 1.0
    for _ in range(steps):
        one = before = u
        for stage in sdirk2_stages(time / steps):
            u = (before + stage.extrapolation_factor * (one - before)) / (1.0 + stage.dt)
            one = u
    return u


def test_two_stages_are_of_second_order() -> None:
    """Half the time step leaves a quarter of the error.

    Ten steps are 1.5e-4 off; with the other root of the second-order condition they are 3.8e-3 off.
    """
    errors = [abs(decayed(1.0, steps) - math.exp(-1.0)) for steps in (10, 20)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[0] < 2e-4


def test_a_step_far_longer_than_the_decay_leaves_nothing() -> None:
    assert abs(decayed(1e6, 1)) < 1e-5


def test_no_stage_is_beyond_the_step() -> None:
    assert [
        stage.elapsed <= 1.0 and 0.0 < stage.end_fraction <= 1.0 for stage in sdirk2_stages(1.0)
    ] == [
        True,
        True,
    ]
