"""Coulomb's law at a point: its variational form, a path, and UFL against numpy."""

from __future__ import annotations

from math import cos, hypot, pi, sin
from typing import Any

import numpy as np
import pytest
import ufl

from indent_sim.model.contact import AugmentedLagrangian
from indent_sim.model.contact_point import (
    CoulombPoint,
    dissipation_on_separation,
    is_new_contact,
    passed_gap,
    step_fraction_at_contact,
)

TRACTIONS = [(0.3, 0.1), (-0.02, 0.05), (0.0, -2.0), (0.08, 0.06)]


@pytest.mark.parametrize("t_hat", TRACTIONS)
@pytest.mark.parametrize("p", [0.0, 0.3, 5.0])
def test_the_traction_is_the_nearest_within_the_bound(t_hat: tuple[float, float], p: float) -> None:
    """The traction is the projection of the trial traction onto the disc of Coulomb's bound.

    Reference: the nearest point on a grid of angles and lengths.
    """
    point = CoulombPoint(0.4, p, t_hat)
    t = [point.traction_ratio * c for c in t_hat]
    assert hypot(*t) <= 0.4 * p * (1 + 1e-12)
    within = [
        (r * 0.4 * p * cos(k * pi / 180), r * 0.4 * p * sin(k * pi / 180))
        for k in range(360)
        for r in (0.5, 1)
    ]
    nearest = min(hypot(t_hat[0] - x, t_hat[1] - y) for x, y in within)
    assert hypot(t_hat[0] - t[0], t_hat[1] - t[1]) <= nearest + 1e-12


def test_no_traction_of_stick_is_bounded() -> None:
    point = CoulombPoint("stick", np.array([0.0, 1.0]), np.array([[1e6, 2.0]]))
    assert point.traction_ratio == 1.0 and (point.stick_margin > 0).all()


def test_heat_is_traction_times_way_at_constant_pressure() -> None:
    """The dissipation at constant pressure is friction p times the slip.

    A tangential stiffness epsilon_t drags the point along x at p = 2.
    """
    friction, p, epsilon_t, moved = 0.3, 2.0, 50.0, 0.1
    point = CoulombPoint(friction, p, [epsilon_t * moved])
    t = [point.traction_ratio * point.trial_traction[0]]
    slid = [(point.trial_traction[0] - t[0]) / epsilon_t]
    assert slid[0] == pytest.approx(moved - friction * p / epsilon_t, rel=1e-12)
    assert point.dissipation(t, slid, p) == pytest.approx(friction * p * slid[0], rel=1e-12)
    assert point.dissipation(t, slid, 0.0) == pytest.approx(
        friction * p * slid[0] / 2, rel=1e-12
    )  # it came into contact
    assert CoulombPoint(friction, p, [0.5]).dissipation([0.5], [0.0], p) == 0.0


def test_what_leaves_rubs_with_half_its_pressure() -> None:
    """A point that separates dissipates with the mean of its pressures.

    A third of a way of 0.1 is left, with friction 0.3 and a pressure that falls from 2 to 0.
    """
    assert dissipation_on_separation(0.3, 2.0, [0.1], 2 / 3) == pytest.approx(
        0.3 * 1.0 * 0.1 / 3, rel=1e-12
    )


def test_a_gap_that_closes_or_opens() -> None:
    """New contact and passed gap of points that close, stay open, stay closed and open."""
    opening, p_hat = np.array([0.01, 0.01, -0.02, -0.02]), np.array([1.0, -1.0, 1.0, -3.0])
    is_new = is_new_contact(opening, 0.1)
    assert is_new.tolist() == [1.0, 1.0, 0.0, 0.0]
    assert passed_gap(opening, is_new, p_hat, 100.0).tolist() == [0.01, 0.0, 0.0, 0.03]
    assert is_new_contact(1e-9, 0.1) == 0.0  # closed at once, as under a flat punch
    way = step_fraction_at_contact(np.linspace(-1.0, 2.0, 31), 1.0)
    assert (np.diff(way) >= 0).all() and way[0] == 0.0 and way[-1] == way[20] < 1.0


@pytest.mark.parametrize("t_hat", TRACTIONS)
@pytest.mark.parametrize("p", [0.0, 0.3, 5.0])
def test_numpy_and_ufl_agree(t_hat: tuple[float, float], p: float) -> None:
    def numbers(p: Any, t_hat: Any, opening: Any) -> list[Any]:
        point = CoulombPoint(0.4, p, t_hat)
        t = [point.traction_ratio * c for c in t_hat]
        way = step_fraction_at_contact(
            passed_gap(opening, is_new_contact(opening, 0.1), p - 0.1, 7.0), 0.3
        )
        return [
            point.stick_margin,
            *t,
            point.dissipation(t, t_hat, 0.2),
            dissipation_on_separation(0.4, p, t_hat, way),
        ]

    ours = numbers(p, t_hat, 0.02)
    p_, x, y, opening = (
        ufl.variable(ufl.as_ufl(float(c))) for c in (p, *t_hat, 0.02)
    )  # which UFL does not fold
    theirs = [float(ufl.as_ufl(one)(())) for one in numbers(p_, [x, y], opening)]
    assert theirs == pytest.approx([float(one) for one in ours], rel=1e-12, abs=1e-15)


def test_a_law_says_what_it_does_to_an_equilibrium() -> None:
    smooth, rough, bonded = (
        AugmentedLagrangian(friction=friction) for friction in (0.0, 0.3, "stick")
    )
    assert [law.is_conservative for law in (smooth, rough, bonded)] == [True, False, False]
    assert [law.is_path_dependent for law in (smooth, rough, bonded)] == [False, True, True]
    assert [law.is_bonded for law in (smooth, rough, bonded)] == [False, False, True]
    assert not any(law.may_snap_through or law.adhesion_range for law in (smooth, rough, bonded))
