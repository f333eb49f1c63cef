"""JKR from frictionless curves: closed forms, bonded layers, and limits of Maugis' model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from theory_bodies import BONDED_PULL_OFF, one_layer

from indent_sim.theory import profiles
from indent_sim.theory.adhesion import Jkr
from indent_sim.theory.layer import Layer
from indent_sim.theory.maugis import maugis_lambda, maugis_pull_off, tabor_number
from indent_sim.theory.punches import FittedPunches, LayerPunches
from indent_sim.theory.stack import Stack, StackLayer

E_STAR, WORK, R = 4 / 3, 1e-3, 1.0
HALF_SPACE = Layer.from_stack(
    profiles.paraboloid(R),
    Stack((StackLayer(1.0, E_STAR, 0.0), StackLayer(math.inf, E_STAR, 0.0)), None),
)
UNIT_FORCE, UNIT_DEPTH = math.pi * WORK * R, (math.pi**2 * WORK**2 * R / E_STAR**2) ** (1 / 3)


@pytest.fixture(scope="module")
def jkr() -> Jkr:
    return Jkr(LayerPunches(HALF_SPACE), WORK)


@pytest.mark.parametrize("a", [0.01, 0.07, 0.3])
def test_both_branches_on_a_half_space(jkr: Jkr, a: float) -> None:
    """Both branches on a half-space are those of Johnson, Kendall & Roberts (1971)."""
    found = jkr.equilibrium_at(a)
    assert found.delta == pytest.approx(
        a**2 / R - math.sqrt(2 * math.pi * WORK * a / E_STAR), rel=1e-10
    )
    assert found.force == pytest.approx(
        4 * E_STAR * a**3 / (3 * R) - math.sqrt(8 * math.pi * WORK * E_STAR * a**3), rel=1e-10
    )


def test_pull_off_by_force_and_by_depth(jkr: Jkr) -> None:
    by_force, by_depth = jkr.pull_off(math.inf), jkr.pull_off(0.0)
    assert by_force.force == pytest.approx(-1.5 * UNIT_FORCE, rel=1e-10)
    assert by_force.delta == pytest.approx(-0.3605623925 * UNIT_DEPTH, rel=1e-8)
    assert by_depth.force == pytest.approx(-5 / 6 * UNIT_FORCE, rel=1e-10)
    assert by_depth.delta == pytest.approx(-0.75 * UNIT_DEPTH, rel=1e-10)


@pytest.mark.parametrize(("nu", "h", "pull_off"), BONDED_PULL_OFF)
def test_pull_off_of_bonded_layers(nu: float, h: float, pull_off: float) -> None:
    """The pull-off of bonded layers is that of a table, to its five digits."""
    layer = one_layer(Layer, profiles.paraboloid(1.0), E=1.0, nu=nu, h=h)
    found = Jkr(LayerPunches(layer), WORK).pull_off(math.inf)
    assert found.force / (math.pi * WORK) == pytest.approx(pull_off, abs=6e-6)


@pytest.mark.parametrize("k", [1e-4, 0.03, 1.0, 1e4])
def test_a_spring_lets_go_where_the_slope_is_its_own(jkr: Jkr, k: float) -> None:
    """A spring jumps off where dF/ddelta = -k; below that z has no stable equilibrium.

    The slope is a difference over 1e-5 of the radius.
    """
    found = jkr.pull_off(1 / k)
    near = [jkr.equilibrium_at(found.a * (1 + step)) for step in (-1e-5, 1e-5)]
    slope = (near[1].force - near[0].force) / (near[1].delta - near[0].delta)
    assert slope == pytest.approx(-k, rel=1e-3)
    z = found.delta + found.force / k
    assert jkr.stable_equilibrium(z - 1e-6 * abs(z), 1 / k) is None
    held = jkr.stable_equilibrium(z + 0.1 * abs(z), 1 / k)
    assert (
        held
        and held.a > found.a
        and held.delta + held.force / k == pytest.approx(0.9 * z, rel=1e-9)
    )


@pytest.mark.parametrize("compliance", [0.0, 30.0, math.inf])
def test_a_branch_from_samples(jkr: Jkr, compliance: float) -> None:
    """The spline of a branch is its equilibria to 1e-6 of the largest; none lie below pull-off."""
    last = jkr.pull_off(compliance)
    lowest = last.force if math.isinf(compliance) else last.delta + compliance * last.force
    branch = jkr.stable_branch(-10 * lowest, compliance)
    for z in np.linspace(lowest * 0.999, -9 * lowest, 7):
        exact, found = jkr.stable_equilibrium(float(z), compliance), branch(float(z))
        assert exact and found and found.a == pytest.approx(exact.a, rel=1e-5)
        assert found.force == pytest.approx(exact.force, abs=1e-6 * abs(branch(-9 * lowest).force))  # type: ignore[union-attr]
    assert branch(1.001 * lowest) is None


def test_beside_a_wall_every_contact_pulls() -> None:
    """A wall at ten contact radii changes the pull-off only by about (a/W)^3.

    K' vanishes where the contact fills a cylinder with rollers. Reference: a wall a hundred times
    farther away.
    """
    near, far = (
        one_layer(Layer, profiles.paraboloid(1.0), E=1.0, nu=0.3, h=10.0, wall=W)
        for W in (0.5, 50.0)
    )
    found = [Jkr(LayerPunches(layer), 1e-6).pull_off(math.inf).force for layer in (near, far)]
    assert found[0] == pytest.approx(found[1], rel=2e-3)


def test_a_stiff_spring_is_depth_control_and_a_soft_one_force_control(jkr: Jkr) -> None:
    assert jkr.pull_off(1e-8).force == pytest.approx(jkr.pull_off(0.0).force, rel=1e-6)
    assert jkr.pull_off(1e8).force == pytest.approx(jkr.pull_off(math.inf).force, rel=1e-6)


def test_a_curve_known_at_some_radii() -> None:
    """Exact K and P at 24 radii give the pull-off to 1e-4."""
    layer = one_layer(Layer, profiles.paraboloid(1.0), E=1.0, nu=0.3, h=0.3)
    exact = LayerPunches(layer)
    a = np.linspace(0.01, 0.3, 24)
    samples = [exact.punch_of_radius(float(x)) for x in a]
    K, P = (
        np.array(v)
        for v in zip(
            *((p.stiffness, p.stiffness * p.delta - p.force) for p in samples), strict=True
        )
    )
    found = Jkr(FittedPunches(a, K, P, profiles.paraboloid(1.0), layer.E_star), WORK)
    assert found.pull_off(math.inf).force / (math.pi * WORK) == pytest.approx(-1.56203, rel=1e-4)
    with pytest.raises(ValueError, match="strong"):
        Jkr(FittedPunches(a, K, P, profiles.paraboloid(1.0), layer.E_star), 10.0).pull_off()
    with pytest.raises(ValueError, match=r"weak|small"):
        Jkr(FittedPunches(a, K, P, profiles.paraboloid(1.0), layer.E_star), 1e-9).pull_off()


@pytest.mark.parametrize(
    ("parameter", "force"),
    [
        (0.01, -1.99829),
        (0.1, -1.95059),
        (0.3, -1.81556),
        (0.5, -1.71825),
        (1, -1.60073),
        (2, -1.53460),
        (5, -1.50635),
    ],
)
def test_maugis_between_dmt_and_jkr(parameter: float, force: float) -> None:
    assert maugis_pull_off(parameter) == pytest.approx(force, abs=6e-6)


def test_maugis_at_any_number() -> None:
    """The pull-off grows monotonically from DMT's -2 to JKR's -3/2 for all Maugis numbers."""
    forces = [
        maugis_pull_off(10.0**power) for power in (-300, -30, -10, -5, -1, 1, 4, 5, 6, 8, 30, 300)
    ]
    assert forces == sorted(forces)
    assert (forces[0], forces[-1]) == (pytest.approx(-2.0, abs=1e-9), pytest.approx(-1.5, abs=1e-9))


def test_tabor_and_maugis_numbers() -> None:
    """lambda = 2 s0 (R/(pi w K^2))^(1/3) with s0 = w/range and K = 4 E*/3."""
    reach = 0.01
    direct = 2 * WORK / reach * (R / (math.pi * WORK * (4 * E_STAR / 3) ** 2)) ** (1 / 3)
    assert maugis_lambda(WORK, reach, R, E_STAR) == pytest.approx(direct, rel=1e-12)
    assert direct / tabor_number(WORK, reach, R, E_STAR) == pytest.approx(1.127, abs=5e-4)
