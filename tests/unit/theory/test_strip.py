"""Plane-strain strips: converged reference numbers, limits and conservation laws."""

import math
from dataclasses import replace

import numpy as np
import pytest
from theory_bodies import indent, one_layer

from indent_sim.theory import half_space as hs
from indent_sim.theory import profiles
from indent_sim.theory import strip as ps

UNIT = {"E": 1.0, "h": 1.0}
PARABOLOID = profiles.paraboloid(1.0)
E_STAR = hs.E_star(1.0, 0.3)


def width_integral(solution):
    """int_-a^a p dx, with nodes crowded towards the middle and the edge."""
    u, w = np.polynomial.legendre.leggauss(150)
    u, w = 0.5 * (1.0 + u), 0.5 * w
    t, dt = u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * u**2 * (1.0 - u) ** 2
    return 2.0 * np.sum(w * dt * solution.a * solution.pressure(solution.a * t))


def test_reference_numbers():
    # E = 1, h = 1, R = 1, bonded, half-width 2; all digits are converged
    s = indent(ps.Strip, PARABOLOID, 0.01, nu=0.3, wall=2.0, **UNIT)
    assert s.force == pytest.approx(5.38351500073e-03, rel=1e-12)
    assert s.a == pytest.approx(7.88040343271e-02, rel=1e-12)
    assert s.pressure(0.0) == pytest.approx(4.349102404e-02, rel=1.2e-10)


@pytest.mark.parametrize("wall", [None, 2.0])
def test_small_contact_is_the_line_contact(wall):
    # F' = pi E* a^2/(4R), p = E*/(2R) sqrt(a^2 - x^2) (Johnson 1985, sect. 4.2)
    s = indent(ps.Strip, PARABOLOID, 1e-9, nu=0.3, wall=wall, **UNIT)
    assert s.force == pytest.approx(math.pi * E_STAR * s.a**2 / 4.0, rel=1e-8)
    x = np.array([0.0, 0.5, 0.999]) * s.a
    assert s.pressure(x) == pytest.approx(E_STAR / 2.0 * np.sqrt(s.a**2 - x**2), rel=1e-8)


@pytest.mark.parametrize("wall", [None, 1.2])
def test_a_contact_near_the_end_of_its_tip_knows_no_unit_of_length(wall):
    """A contact at 0.99 of a sphere's radius does not depend on the unit of length, to 1e-11.

    This takes more nodes towards the end of the tip.
    """
    known = indent(ps.Strip, profiles.sphere(1.0), 1.5, nu=0.3, wall=wall, **UNIT)
    far = wall and 1e3 * wall
    large = indent(ps.Strip, profiles.sphere(1e3), 1.5e3, nu=0.3, wall=far, E=1.0, h=1e3)
    assert known.a > 0.98 and (large.force, large.a) == pytest.approx(
        (1e3 * known.force, 1e3 * known.a), rel=1e-11
    )


def test_small_wedge_is_the_half_plane_one():
    # F' = E* a cot(alpha), p = E* cot(alpha)/pi arcosh(a/x) (Johnson 1985, sect. 5.2)
    cot = 1.0 / math.tan(math.radians(70.0))
    s = indent(ps.Strip, profiles.cone(70.0), 1e-6, nu=0.3, **UNIT)
    assert s.force == pytest.approx(E_STAR * s.a * cot, rel=1e-9)
    assert s.pressure(s.a / 2) == pytest.approx(E_STAR * cot / math.pi * math.acosh(2.0), rel=1e-9)


def test_wedge_agrees_with_a_plain_profile():
    # without its corner declared the same wedge converges, only slowly
    wedge = profiles.cone(70.0)
    known = indent(ps.Strip, wedge, 0.1, nu=0.3, wall=1.0, **UNIT)
    plain = indent(ps.Strip, replace(wedge, apex_slope=0.0), 0.1, nu=0.3, wall=1.0, **UNIT)
    assert known.force == pytest.approx(plain.force, rel=1e-3)
    assert width_integral(known) == pytest.approx(known.force, rel=1e-6)


def test_walls_far_away():
    infinite = indent(ps.Strip, PARABOLOID, 0.01, nu=0.3, **UNIT)
    far = indent(ps.Strip, PARABOLOID, 0.01, nu=0.3, wall=50.0, **UNIT)
    assert far.force == pytest.approx(infinite.force, rel=1e-12)
    assert far.pressure(0.03) == pytest.approx(infinite.pressure(0.03), rel=1e-10)
    near = indent(ps.Strip, PARABOLOID, 0.01, nu=0.3, wall=2.0, **UNIT)
    assert 7e-4 < near.force / infinite.force - 1 < 8e-4


@pytest.mark.parametrize(
    "tip", [PARABOLOID, profiles.sphere(1.0), profiles.cone(60.0), profiles.flat_punch(0.3)]
)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(
    ("base", "wall"), [("fixed", None), ("fixed", 1.0), ("roller", 2.0), ("roller", None)]
)
def test_conservation(tip, nu, base, wall):
    delta = 0.05
    depths = [delta * (1 - 1e-4), delta, delta * (1 + 1e-4)]
    less, s, more = one_layer(
        ps.Strip, tip, nu=nu, base=base, wall=wall, **UNIT
    ).solutions_at_depths(depths)
    assert width_integral(s) == pytest.approx(s.force, rel=1e-6)
    assert np.all(s.pressure(np.linspace(-1.2 * s.a, 1.2 * s.a, 24)) >= 0.0)
    assert (more.energy - less.energy) / (2e-4 * delta) == pytest.approx(s.force, rel=1e-7)
    assert (more.force - less.force) / (2e-4 * delta) == pytest.approx(s.stiffness, rel=1e-7)


def test_thin_strip_is_an_oedometer():
    # a >> h, bonded, compressible: p = M_c (delta - f)/h, a = sqrt(2 R delta), F' = 4/3 M_c a
    # delta/h
    nu, R, delta = 0.3, 1e4, 0.1
    modulus = (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    s = indent(ps.Strip, profiles.paraboloid(R), delta, nu=nu, **UNIT)
    assert s.a == pytest.approx(math.sqrt(2.0 * R * delta), rel=0.02)
    assert s.force == pytest.approx(4.0 / 3.0 * modulus * s.a * delta, rel=0.03)
    assert s.pressure(0.0) == pytest.approx(modulus * delta, rel=1e-3)


@pytest.mark.parametrize("gap", [1e-15, 1e-11, 1e-9, 1e-8, 1e-6])
def test_a_punch_that_nearly_fills_the_strip_is_an_oedometer(gap):
    """A punch that nearly fills a strip between rollers has F = 2 W E_oed delta/h.

    A gap changes it by the square of gap/W.
    """
    E_oed = 0.7 / (1.3 * 0.4)
    found = indent(
        ps.Strip, profiles.flat_punch(1 - gap), 0.01, E=1.0, nu=0.3, h=2.0, wall=1.0, base="roller"
    )
    assert found.force == pytest.approx(2 * E_oed * 0.01 / 2, rel=1e-9)


def test_units_only_scale_and_lifting_off():
    s = indent(ps.Strip, PARABOLOID, 0.1, nu=0.5, wall=2.0, **UNIT)
    nano = indent(ps.Strip, profiles.paraboloid(1e-9), 1e-10, E=1e12, nu=0.5, h=1e-9, wall=2e-9)
    assert nano.force == pytest.approx(s.force * 1e12 * 1e-9, rel=1e-11)
    assert nano.pressure(0.0) == pytest.approx(s.pressure(0.0) * 1e12, rel=1e-11)
    assert indent(ps.Strip, PARABOLOID, -0.1, nu=0.3, **UNIT).force == 0.0
    assert indent(ps.Strip, profiles.flat_punch(0.5), 0.1, nu=0.3, **UNIT).pressure(0.5) == math.inf


@pytest.mark.parametrize(
    "change",
    [
        {"E": -1.0},
        {"nu": 0.6},
        {"h": 0.0},
        {"base": "glued"},
        {"wall": -1.0},
        {"delta": math.inf},
        {"delta": 5.0, "wall": 1.0},
        {"tip": profiles.flat_punch(1.0), "wall": 1.0},
    ],
)
def test_nonsense_is_refused(change):
    arguments = {"tip": PARABOLOID, "delta": 0.01, "E": 1.0, "nu": 0.3, "h": 1.0, **change}
    with pytest.raises(ValueError):
        indent(ps.Strip, **arguments)
