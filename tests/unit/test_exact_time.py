"""Exact solutions in time: values of another program, limits, and one another."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from exact_time import (
    confined_modulus,
    confined_ramp,
    held_incompressible,
    mandel,
    relaxing_bar,
    terzaghi_settlement,
    unconfined_force,
)

DIGITS = 5.1e-8  # relative: eight are printed


@pytest.mark.parametrize(
    ("given", "pressure"),
    [
        ((1.0, 0.2, 0.9, 1.0, 0.01, 0.1), 0.0039647361),
        ((10.0, 0.35, 0.002, 2.0, 0.05, 3.0), 8.7538653),
    ],
)
def test_confined_ramp(given: tuple[float, ...], pressure: float) -> None:
    assert confined_ramp(*given) == pytest.approx(pressure, rel=DIGITS)


@pytest.mark.parametrize(
    ("given", "settlement"),
    [
        ((1.0, 0.2, 0.9, 1.0, 0.01, 0.1), 0.0032114106),
        ((10.0, 0.35, 0.002, 2.0, 0.05, 30.0), 0.0034396672),
    ],
)
def test_settlement(given: tuple[float, ...], settlement: float) -> None:
    assert terzaghi_settlement(*given) == pytest.approx(settlement, rel=DIGITS)


@pytest.mark.parametrize(
    ("given", "force"),
    [
        ((1.0, 0.0, 1.0, 1.0, 0.01, 0.1), 0.040848595),
        ((10.0, 0.3, 0.002, 0.5, 0.02, 1.5), 0.16608819),
    ],
)
def test_unconfined_disc(given: tuple[float, ...], force: float) -> None:
    assert unconfined_force(*given) == pytest.approx(force, rel=DIGITS)


@pytest.mark.parametrize(
    ("given", "pressure", "strain"),
    [
        ((1.0, 0.2, 0.9, 1.0, 0.0, 0.005, 0.1), 0.0027385344, 0.0034476964),
        ((10.0, 0.0, 0.002, 0.5, 0.2, 0.03, 3.0), 0.024738819, 0.0040458029),
    ],
)
def test_mandel_strip(given: tuple[float, ...], pressure: float, strain: float) -> None:
    assert mandel(*given) == pytest.approx((pressure, strain), rel=DIGITS)


@pytest.mark.parametrize(
    ("E", "nu", "fractions", "times", "t", "modulus"),
    [
        (1.0, 0.3, [0.4, 0.3], [0.1, 1.0], 0.5, 0.52399882),
        (10.0, 0.1, [0.6], [2.0], 3.0, 6.2477116),
    ],
)
def test_bar(
    E: float, nu: float, fractions: list[float], times: list[float], t: float, modulus: float
) -> None:
    assert relaxing_bar(E, nu, fractions, times, t) == pytest.approx(modulus, rel=DIGITS)


@pytest.mark.parametrize(
    ("fractions", "times", "t", "left"),
    [([0.4, 0.3], [0.1, 1.0], 0.5, 0.48465438), ([0.6], [2.0], 3.0, 0.53387810)],
)
def test_held_incompressible_body(
    fractions: list[float], times: list[float], t: float, left: float
) -> None:
    assert held_incompressible(fractions, times, t) == pytest.approx(left, rel=DIGITS)


# ---- limits


def test_a_sudden_disc_is_incompressible_and_then_drained() -> None:
    """A suddenly compressed disc has the modulus 3 G at first and E at last.

    sum A_n = (1 - 2 nu)/(2 (1 + nu)); 400 terms leave 1/(pi^2 n) = 3e-4 of it.
    """
    nu = 0.2
    force = [unconfined_force(1.0, nu, 1.0, 1.0, 0.01, t) / (pi * 0.01) for t in (0.0, 1e3)]
    assert force[0] == pytest.approx(1.5 / (1 + nu), rel=3e-4)
    assert force[1] == pytest.approx(1.0, rel=1e-12)


def test_a_sudden_strip_shares_its_pressure_and_then_drains() -> None:
    """Mandel's strip has p = F/(2 a) at first and the drained modulus 2 G/(1 - nu) at last.

    The sudden shortening is F/(4 G a).
    """
    E, nu, F, a = 1.0, 0.2, 0.005, 1.0
    G = E / (2 * (1 + nu))
    assert mandel(E, nu, 0.9, a, 0.0, F, 1e-4) == pytest.approx(
        (F / (2 * a), F / (4 * G * a)), rel=2e-2
    )
    assert mandel(E, nu, 0.9, a, 0.0, F, 1e3) == pytest.approx(
        (0.0, F * (1 - nu) / (2 * G * a)), rel=1e-12, abs=1e-15
    )


def test_mandel_pressure_rises_before_it_falls() -> None:
    """The pressure in the middle rises before it falls: the Mandel-Cryer effect."""
    pressures = [mandel(1.0, 0.0, 1.0, 1.0, 0.0, 1.0, t)[0] for t in (0.001, 0.1, 1.0)]
    assert pressures[1] > 1.05 * pressures[0] > 0.5 > pressures[2]


def test_a_slow_ramp_is_drained_and_a_step_consolidates() -> None:
    M = confined_modulus(1.0, 0.2)
    lag = confined_ramp(1.0, 0.2, 0.9, 1.0, 0.01, 1e3) - M * 10.0
    assert lag == pytest.approx(0.01 / 0.9 / 3, rel=1e-9)  # V h/(3 k)
    assert terzaghi_settlement(1.0, 0.2, 0.9, 1.0, 0.01, 1e3) == pytest.approx(0.01 / M, rel=1e-12)


def test_a_ramp_of_pressure_settles_as_the_ramp_of_depth_presses() -> None:
    """The pressures of a ramp of depth, applied as steps, give back that ramp.

    400 steps of the midpoint rule leave 1e-3, from the steep beginning.
    """
    given, V, t, n = (1.0, 0.2, 0.9, 1.0), 0.01, 0.3, 400
    times = np.linspace(0.0, t, n + 1)
    steps = np.diff([confined_ramp(*given, V, s) for s in times])
    ages = t - (times[1:] + times[:-1]) / 2
    settled = sum(
        terzaghi_settlement(*given, step, age) for step, age in zip(steps, ages, strict=True)
    )
    assert settled == pytest.approx(V * t, rel=2e-3)


def test_limits_of_a_bar() -> None:
    """A relaxing bar has the modulus E at first and 9 kappa G/(3 kappa + G) at last.

    G is the shear modulus that is left.
    """
    E, nu, fractions, times = 2.0, 0.3, [0.4, 0.3], [0.1, 1.0]
    kappa, G = E / (3 * (1 - 2 * nu)), 0.3 * E / (2 * (1 + nu))
    assert relaxing_bar(E, nu, fractions, times, 0.0) == pytest.approx(E, rel=1e-12)
    assert relaxing_bar(E, nu, fractions, times, 1e3) == pytest.approx(
        9 * kappa * G / (3 * kappa + G), rel=1e-12
    )
    almost = relaxing_bar(E, 0.5 - 1e-9, fractions, times, 0.5) / E
    assert almost == pytest.approx(held_incompressible(fractions, times, 0.5), rel=1e-8)
