"""Extrapolated trial pressure, against the exact fields of a paraboloid on a half-space."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.fe.solve.extrapolation import lagrange_weights, predict_trial_pressure

R, H = 1.0, 0.001  # of the tip, and of an element


def trial(r: np.ndarray, depth: float) -> np.ndarray:
    """Hertz's pressure over E* inside the contact, minus gap over H outside.

    Johnson, Contact Mechanics (1985), eq. 3.42.
    """
    a = np.sqrt(R * depth)
    inside = np.sqrt(np.maximum(a**2 - r**2, 0.0))
    x = np.maximum(r, a)
    sunk = ((2 * a**2 - x**2) * np.arcsin(a / x) + a * np.sqrt(x**2 - a**2)) / (np.pi * R)
    gap = x**2 / (2 * R) - depth + sunk
    return 2 * inside / (np.pi * R) - gap / H


def edge(values: np.ndarray, r: np.ndarray) -> float:
    return float(r[np.argmin(values > 0)])


@pytest.mark.parametrize("step", [2, 3, 5, 9])
def test_the_edge_of_a_paraboloid_is_foreseen(step: int) -> None:
    """The extrapolated contact edge is off by at most a sixth of its motion in the increment.

    A linear extrapolation of gap and pressure overshoots by two thirds of the motion.
    """
    r, depths = np.linspace(0.0, 0.2, 20001), [0.001 * (step - 1), 0.001 * step]
    depth = 0.001 * (step + 1)
    trials = [trial(r, before) for before in depths]
    found = predict_trial_pressure(trials, depths, depth, max(values.max() for values in trials))
    now, was = np.sqrt(R * depth), np.sqrt(R * depths[-1])
    assert abs(edge(found, r) - now) < (now - was) / 6
    straight = sum(
        share * values
        for share, values in zip(lagrange_weights(depths, depth), trials, strict=True)
    )
    assert edge(np.asarray(straight), r) - now > 0.6 * (now - was)


def test_a_tip_that_goes_back_leaves_the_edge_behind() -> None:
    """During unloading the extrapolated contact edge is exact.

    The pressure next to the edge grows as a root of the depth, so that its square is linear.
    """
    r, depths = np.linspace(0.0, 0.2, 20001), [0.010, 0.009]
    trials = [trial(r, before) for before in depths]
    found = predict_trial_pressure(trials, depths, 0.008, max(values.max() for values in trials))
    assert edge(found, r) == pytest.approx(np.sqrt(R * 0.008), abs=1e-5)  # the step of r


def test_without_contact_the_last_state_is_expected() -> None:
    trials = [np.array([-2.0, -1.0]), np.array([-1.0, -0.5])]
    assert predict_trial_pressure(trials, [-0.2, -0.1], 0.0, 0.0) is trials[-1]


def test_shares_are_those_of_the_parabola() -> None:
    depths = [0.1, 0.4, 0.5]
    assert np.dot(lagrange_weights(depths, 0.7), np.square(depths)) == pytest.approx(
        0.49, rel=1e-13
    )
