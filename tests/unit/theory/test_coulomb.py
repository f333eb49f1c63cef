"""Coulomb friction on a half-space: an independent solution, limits, and convergence."""

from __future__ import annotations

import math

import numpy as np
import pytest

from indent_sim.theory import friction as coulomb_friction
from indent_sim.theory import no_slip
from indent_sim.theory.friction import friction_correction

# Force with friction over the frictionless one, by rings of constant pressure and linear shear on
# the surface itself
PUNCHES = {
    (0.0, 0.1): 1.01810,
    (0.0, 0.3): 1.05240,
    (0.0, 1.0): 1.09220,
    (0.3, 0.1): 1.01035,
    (0.3, 0.3): 1.02430,
    (0.3, 1.0): 1.02857,
}
PARABOLOIDS = {
    0.0: (1.0112, 1.0221, 1.0318, 1.0439, 1.0514),
    0.2: (1.0084, 1.0164, 1.0221, 1.0268, 1.0284),
    0.3: (1.0064, 1.0118, 1.0145, 1.0159, 1.0162),
    0.4: (1.0036, 1.0051, 1.0054, 1.0054, 1.0054),
}
FRICTIONS = (0.1, 0.2, 0.3, 0.5, 1.0)
STICKS = {
    (0.3, 0.1): 0.20,
    (0.3, 0.2): 0.70,
    (0.3, 0.3): 0.896,
    (0.3, 0.5): 0.984,
    (0.0, 0.2): 0.22,
    (0.0, 0.3): 0.505,
    (0.0, 0.5): 0.81,
    (0.0, 1.0): 0.969,
}


@pytest.mark.parametrize(("nu", "friction"), PUNCHES)
def test_punches(nu: float, friction: float) -> None:
    """The force of a flat punch with friction is that of superposed punches.

    2.5e-5 is the error of 200 rings and half of the last given digit.
    """
    assert friction_correction(nu, friction).force == pytest.approx(
        PUNCHES[nu, friction], abs=2.5e-5
    )


@pytest.mark.parametrize("nu", PARABOLOIDS)
def test_paraboloids(nu: float) -> None:
    """The force of a paraboloid with friction is that of superposed punches.

    7e-5 is half of the last given digit and 2e-5 of the rings.
    """
    found = [friction_correction(nu, friction, 2.0).force for friction in FRICTIONS]
    assert found == pytest.approx(PARABOLOIDS[nu], abs=7e-5)


@pytest.mark.parametrize(("nu", "friction"), STICKS)
def test_stick_radius(nu: float, friction: float) -> None:
    """The stick radius under a flat punch is the reference to one ring.

    Rings are 0.015 wide at the axis and narrower outwards.
    """
    assert friction_correction(nu, friction).sticks == pytest.approx(
        STICKS[nu, friction], abs=0.012
    )


@pytest.mark.parametrize("power", [1.0, 2.0, 3.5, math.inf])
@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3])
def test_between_no_friction_and_no_slip(nu: float, power: float) -> None:
    """More friction gives more force and a narrower contact, from none to no slip."""
    none, *some = (
        friction_correction(nu, friction, power) for friction in (0.0, 1e-3, 0.1, 0.3, 1.0)
    )
    assert (none.force, none.radius) == pytest.approx((1.0, 1.0), abs=1e-13)
    stuck = friction_correction(nu, "stick", power)
    forces = [1.0, *(found.force for found in some), stuck.force]
    assert np.all(np.diff(forces) > 0)
    assert np.all(np.diff([*(found.sticks for found in some), stuck.sticks]) >= 0)
    assert np.all(np.diff([*(found.radius for found in some), stuck.radius]) <= 1e-12)


@pytest.mark.parametrize("power", [1.0, 2.0, math.inf])
@pytest.mark.parametrize("nu", [0.4, 0.45])
def test_much_friction_does_not_slip(nu: float, power: float) -> None:
    """A friction coefficient of 3 gives the closed quadrature of no slip, to 2e-5."""
    assert friction_correction(nu, 3.0, power).force == pytest.approx(
        no_slip.force_ratio(nu, power), abs=2e-5
    )


def test_little_friction_adds_its_own_share() -> None:
    """For small friction the force grows by f times the work of q along the surface.

    The surface slips everywhere with q = f p; by Betti's theorem the growth is the work of q along
    the frictionless surface, f beta int p u_r.
    """
    friction, nu = 1e-4, 0.2
    once, twice = (friction_correction(nu, f).force - 1 for f in (friction, 2 * friction))
    assert twice == pytest.approx(2 * once, rel=1e-3)
    beta = (1 - 2 * nu) / (2 * (1 - nu))
    s = 1 - (np.arange(4000) + 0.5) / 4000  # r = 1 - s^4, close together at the edge
    r, dr = 1 - s**4, 4 * s**3 / 4000
    root = np.sqrt(1 - r**2)  # p = 2/(pi root), the surface is drawn inward by beta (1 - root)/r
    work = 2 / math.pi * beta * float(np.sum(2 / math.pi * (1 - root) / root * dr))
    assert once == pytest.approx(math.pi / 2 * friction * work, rel=1e-2)


def test_rings_converge() -> None:
    """Twice as many rings change the forces by less than 2e-5."""
    coarse = [friction_correction(0.0, friction).force for friction in (0.1, 0.3, 1.0)]
    fine = [
        coulomb_friction.Rings(1 - (1 - np.linspace(0, 1, 401)) ** coulomb_friction.EDGE_GRADING)
        .solve_punch(0.5, friction)
        .force
        for friction in (0.1, 0.3, 1.0)
    ]
    assert coarse == pytest.approx(fine, abs=2e-5)


def test_incompressible_bodies_do_not_slip_anyway() -> None:
    assert friction_correction(0.5, 0.1, 2.0) == coulomb_friction.FrictionCorrection(
        pytest.approx(1.0, abs=1e-13), pytest.approx(1.0, abs=1e-13), 1.0
    )


@pytest.mark.parametrize(
    ("nu", "friction", "power"),
    [
        (0.6, 0.3, 2.0),
        (-1.0, 0.3, 2.0),
        (0.3, -0.1, 2.0),
        (0.0, 5.0, 2.0),
        (0.3, 0.3, 0.5),
        (0.3, math.nan, 2.0),
    ],
)
def test_no_such_contact(nu: float, friction: float, power: float) -> None:
    with pytest.raises(ValueError):
        friction_correction(nu, friction, power)
