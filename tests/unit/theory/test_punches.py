"""Flat punches of every radius: the half-space, layers, and curves from samples."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from theory_bodies import one_layer

from indent_sim.theory import profiles
from indent_sim.theory.layer import Layer
from indent_sim.theory.punches import FittedPunches, LayerPunches, contact_radius

E_STAR = 1 / (1 - 0.3**2)


def layer(tip: profiles.Tip, nu: float = 0.3, h: float = 1.0) -> Layer:
    return one_layer(Layer, tip, E=1.0, nu=nu, h=h)


def test_a_half_space() -> None:
    """On a half-space K = 2 E* a and the force is Hertz's.

    The layer is 1e6 contact radii thick and differs by a/h.
    """
    punch = LayerPunches(layer(profiles.paraboloid(1.0), h=1e5)).punch_of_radius(0.1)
    E_star = 1 / (1 - 0.3**2)
    assert punch.delta == pytest.approx(0.01, rel=1e-5)
    assert punch.force == pytest.approx(4 / 3 * E_star * 1e-3, rel=1e-5)
    assert (punch.stiffness, punch.stiffness_slope) == pytest.approx(
        (0.2 * E_star, 2 * E_star), rel=1e-5
    )


@pytest.mark.parametrize(
    ("a", "nu", "kappa"), [(1, 0.3, 2.48352), (1, 0.5, 3.61874), (4, 0.45, 14.66383)]
)
def test_the_stiffness_is_that_of_a_flat_punch(a: float, nu: float, kappa: float) -> None:
    """The stiffness is kappa = F/(2 E* a delta) of bonded layers, to six digits."""
    punch = LayerPunches(layer(profiles.paraboloid(30.0), nu)).punch_of_radius(a)
    assert punch.stiffness == pytest.approx(2 * a / (1 - nu**2) * kappa, rel=3e-6)


@pytest.mark.parametrize(
    "tip",
    [profiles.paraboloid(1.0), profiles.sphere(2.0), profiles.cone(70.0), profiles.cone(70.0, 0.1)],
)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_the_slope_of_the_curve_is_the_stiffness(tip: profiles.Tip, nu: float) -> None:
    """dF = K ddelta and dK = K' da hold by central differences over 2e-4 of the radius.

    The differences cost the square of that.
    """
    punches = LayerPunches(layer(tip, nu))
    for a in (0.05, 0.3, 1.0):
        low, here, high = (punches.punch_of_radius(a * (1 + step)) for step in (-1e-4, 0.0, 1e-4))
        assert (high.force - low.force) / (high.delta - low.delta) == pytest.approx(
            here.stiffness, rel=1e-7
        )
        assert (high.stiffness - low.stiffness) / (high.a - low.a) == pytest.approx(
            here.stiffness_slope, rel=1e-7
        )


@pytest.mark.parametrize(
    "tip", [profiles.paraboloid(1.0), profiles.cone(70.0, 0.1), profiles.flat_punch(0.5, 0.3)]
)
def test_punches_from_samples(tip: profiles.Tip) -> None:
    """K and P at 20 radii give theory's values between them to 1e-4, by seven powers."""
    exact = LayerPunches(layer(tip))
    a = np.linspace(0.02, 0.45, 20)
    samples = [exact.punch_of_radius(float(radius)) for radius in a]
    K = np.array([punch.stiffness for punch in samples])
    found = FittedPunches(
        a, K, np.array([p.stiffness * p.delta - p.force for p in samples]), tip, E_STAR
    )
    for radius in (0.23, 0.3, 0.42):
        ours, theirs = found.punch_of_radius(radius), exact.punch_of_radius(radius)
        assert (ours.delta, ours.stiffness) == pytest.approx(
            (theirs.delta, theirs.stiffness), rel=1e-4
        )
        assert (ours.force, ours.stiffness_slope) == pytest.approx(
            (theirs.force, theirs.stiffness_slope), rel=1e-3
        )
        assert contact_radius(found, theirs.delta) == pytest.approx(radius, rel=1e-4)


def test_radii_beyond_the_end_of_a_tip_are_left_out() -> None:
    """Samples beyond the end of a tip, where its shape is not a number, are left out."""
    a, ball = np.linspace(0.02, 0.6, 30), profiles.sphere(0.4)
    under = a < 0.4
    assert not under.all()
    found, alone = (FittedPunches(x, 2 * x, x**3, ball, 1.0) for x in (a, a[under]))
    assert found.punch_of_radius(0.3) == alone.punch_of_radius(0.3)
    assert found.max_radius == alone.max_radius == a[under][-1]


def test_too_little_is_refused() -> None:
    a = np.linspace(0.1, 0.5, 4)
    with pytest.raises(ValueError, match="too few"):
        FittedPunches(a, 2 * a, a**3, profiles.paraboloid(1.0), 1.0)
    few = FittedPunches(
        a := np.linspace(0.1, 0.5, 9), 2 * a, 2 * a**3 / 3, profiles.paraboloid(1.0), 1.0
    )
    with pytest.raises(ValueError, match="smaller than"):
        contact_radius(few, 1e-5)
    assert all(
        math.isclose(few.punch_of_radius(x).delta, x * x, rel_tol=1e-10) for x, _ in pairwise(a)
    )
