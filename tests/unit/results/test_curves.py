"""Smooth curves through rows, and the branches of a load path."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.results.pictures import curves


def test_a_smooth_curve_goes_through_its_points_and_never_beyond_them():
    """A smooth curve goes through its points and is monotone between increasing ones."""
    chance = np.random.default_rng(0)
    for _ in range(50):
        x, y = np.cumsum(chance.uniform(0.1, 1, 8)), np.cumsum(chance.exponential(1, 8) ** 3)
        fine_x, fine_y = curves.smooth_curve(x, y)
        assert np.isin(x, fine_x).all() and fine_y[np.isin(fine_x, x)] == pytest.approx(y)
        assert (np.diff(fine_y) >= -1e-12 * y[-1]).all()


@pytest.mark.parametrize("power", [0.5, 1.0, 1.5, 2.0, 3.0])
def test_a_power_law_is_a_curve_and_no_chords(power):
    """A power law through four points from first contact on is reproduced exactly."""
    x = np.array([0.0, 0.1, 0.4, 1.0])
    for places in (x, x[::-1]):
        fine_x, fine_y = curves.smooth_curve(places, places**power)
        assert fine_y == pytest.approx(fine_x**power, rel=1e-12, abs=1e-12)


def test_what_is_nearly_a_power_law_is_nearly_exact():
    """A force that turns from delta^1.5 to delta^2.5 has a fifth of the error of chords."""
    x = np.linspace(0, 1, 9)
    fine_x, fine_y = curves.smooth_curve(x, x**1.5 * (1 + x))
    exact = fine_x**1.5 * (1 + fine_x)
    assert (
        np.abs(fine_y - exact).max()
        < 0.2 * np.abs(np.interp(fine_x, x, x**1.5 * (1 + x)) - exact).max()
    )


@pytest.mark.parametrize("y", [[1.0], [1.0, 2.0], [1.0, np.nan, 2.0], [1.0, -3.0, 0.0]])
def test_too_few_points_and_jumps_stay_as_they_are(y):
    assert curves.smooth_curve(np.arange(len(y)), np.array(y))[1] == pytest.approx(y, nan_ok=True)


def test_branches_end_at_turning_points():
    found = curves.split_branches(np.array([1.0, 2.0, 3.0, 2.0, 1.0, 2.0]))
    assert found == [(slice(0, 3), False), (slice(2, 5), True), (slice(4, 6), False)]
