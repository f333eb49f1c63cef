"""Closed forms of the half-space against reference numbers and their own derivatives."""

import math

import pytest
from scipy.optimize import brentq

from indent_sim.theory import half_space as hs

E_STAR = hs.E_star(1.0, 0.3)


def test_reference_numbers():
    # Hertz 1882, Sneddon 1965: R = 1, delta = 0.01, E = 1, nu = 0.3
    assert hs.paraboloid_force(0.01, 1.0, E_STAR) == pytest.approx(1.465201465201e-3, rel=1e-12)
    assert hs.sphere_force(0.01, 1.0, E_STAR) == pytest.approx(1.463736090376e-3, rel=1e-12)
    # C = 0.73762(2), angle between axis and face
    assert hs.square_pyramid_force(1.0, 45.0, 1.0) == pytest.approx(0.73762, abs=2e-5)


@pytest.mark.parametrize("depth", [1e-12, 1e-8, 1e-4, 0.01, 0.3, 1.0, 10.0, 1e3])
def test_sphere_obeys_its_equations_at_any_depth(depth):
    R = 2.0
    # delta = a artanh(a/R) with a = R tanh(t)
    a = R * math.tanh(
        brentq(lambda t: t * math.tanh(t) - depth, 0.0, depth + 2.0, xtol=1e-300, rtol=1e-14)
    )
    step = 1e-5 * depth
    rise = hs.sphere_force((depth + step) * R, R, 1.0) - hs.sphere_force((depth - step) * R, R, 1.0)
    assert rise / (2 * step * R) == pytest.approx(2.0 * a, rel=1e-8)  # that of a punch of radius a


def test_sphere_tends_to_the_paraboloid():
    def ratio(delta):
        return hs.sphere_force(delta, 1.0, 1.0) / hs.paraboloid_force(delta, 1.0, 1.0)

    assert ratio(1e-10) == pytest.approx(1.0, rel=1e-10)
    assert ratio(0.01) == pytest.approx(1.0 - 0.001, abs=1e-5)


def test_nothing_happens_out_of_contact():
    for force in (
        hs.paraboloid_force(-0.1, 1.0, 1.0),
        hs.sphere_force(-0.1, 1.0, 1.0),
        hs.cone_force(-1.0, 45.0, 1.0),
        hs.flat_punch_force(-1.0, 1.0, 1.0),
    ):
        assert force == 0.0


@pytest.mark.parametrize(
    "call",
    [
        lambda: hs.E_star(0.0, 0.3),
        lambda: hs.E_star(1.0, 0.6),
        lambda: hs.paraboloid_force(0.1, -1.0, 1.0),
        lambda: hs.sphere_force(0.1, 1.0, math.nan),
        lambda: hs.cone_force(0.1, 90.0, 1.0),
        lambda: hs.square_pyramid_force(0.1, 0.0, 1.0),
        lambda: hs.flat_punch_force(0.1, math.inf, 1.0),
    ],
)
def test_nonsense_is_refused(call):
    with pytest.raises(ValueError):
        call()
