"""Penalty: it penetrates by p/epsilon_n and is too soft by an amount that perturbation theory
predicts.

The potential with penalty is, to first order in 1/epsilon_n, the exact one minus 1/(2 epsilon_n)
int p^2 dA. The force is its derivative by the depth; with Hertz' pressure int p^2 dA / 2 = E*^2
delta^2 / pi, hence

    dF = -2 E*^2 delta / (pi epsilon_n),   dF/F = -3/(2 pi) E*/(a epsilon_n).
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scenes import CYLINDER, E_STAR, ELASTIC, PENALTY, WALLED, scene, solve, with_penalty

DELTA = 0.01
A_HERTZ = sqrt(DELTA)
STIFFNESSES = np.array([25.0, 50.0, 100.0, 200.0, 400.0])  # E*/a


@pytest.fixture(scope="module")
def states() -> list[Any]:
    """The last state for each of the stiffnesses, all on one mesh."""
    base = scene(WALLED, mesh={"h_contact": 0.005})
    return [solve(with_penalty(base, m * E_STAR / A_HERTZ))[-1] for m in STIFFNESSES]


def slope(values: list[float]) -> float:
    """Least-squares slope of log(values) over log(stiffness)."""
    return float(np.polyfit(np.log(STIFFNESSES[: len(values)]), np.log(values), 1)[0])


def test_force_error_falls_as_one_over_the_stiffness(states: list[Any]) -> None:
    """On one mesh F(2 eps) - F(eps) is half of what eps lacks. 0.05 in the slope: the next term in
    1/eps is a few percent of the first at 25 E*/a, and which quadrature points touch changes.
    """
    forces = np.array([state.force for state in states])
    assert np.all(np.diff(forces) > 0)
    assert slope(list(np.diff(forces))) == pytest.approx(-1, abs=0.05)


def test_force_error_is_the_one_of_perturbation_theory(states: list[Any]) -> None:
    """10 %: the layer's pressure grows faster with depth than Hertz', which makes 5 % at this
    thickness, and the next order in 1/eps is as much.
    """
    forces = [state.force for state in states]
    lacking = 2 * (forces[1] - forces[0])  # what a stiffness of 25 E*/a lacks
    assert lacking / forces[-1] == pytest.approx(3 / (2 * pi) / STIFFNESSES[0], rel=0.1)


def test_penetration_falls_as_one_over_the_stiffness(states: list[Any]) -> None:
    """0.05 in the slope: the peak pressure itself grows by 5 % from the softest to the stiffest."""
    assert slope([state.penetration for state in states]) == pytest.approx(-1, abs=0.05)


def test_penetration_is_pressure_over_stiffness(states: list[Any]) -> None:
    """The definition, at the points where both are taken: the quadrature points, and p_max at the
    nodes too, so p_max may be larger by what the pressure oscillates, 1 %.
    """
    for state, m in zip(states, STIFFNESSES, strict=True):
        assert state.penetration * m * E_STAR / A_HERTZ == pytest.approx(state.p_max, rel=0.01)


def test_automatic_stiffness_is_a_multiple_of_modulus_over_element() -> None:
    """100 E*/h_contact: 0.05 % of the force with ten elements in the radius, by the formula above;
    E = 1 there. More only where a penalty would cost more: see test_extremes.py.
    """
    for E, h in ((1.0, 0.02), (5.0, 0.01)):
        base = scene(CYLINDER, material=ELASTIC | {"E": E}, mesh={"h_contact": h}, contact=PENALTY)
        assert base.physics.contact.epsilon_n == pytest.approx(100 * E_STAR / h, rel=1e-12)


def test_stated_stiffness_is_taken_in_the_users_units() -> None:
    """The scene is measured in its height and its modulus."""
    body = CYLINDER | {"radius": 2.0, "height": 2.0}
    stated = scene(body, material=ELASTIC | {"E": 4.0}, contact=PENALTY | {"epsilon_n": 300.0})
    assert stated.physics.contact.epsilon_n == pytest.approx(300.0 * 2.0 / 4.0, rel=1e-12)


def test_energy_error_is_the_one_of_perturbation_theory(states: list[Any]) -> None:
    """Pi lacks int p^2 dA / (2 eps) = pi a^2 p0^2 / (4 eps), with a and p0 of this layer
    (semi-analytic). 6 %: the layer's pressure is not quite an ellipse, and the next order in
    1/eps is 5 %.
    """
    lacking = 2 * (states[1].energy - states[0].energy)
    a, p0 = 1.03127364087e-01, 7.218770639e-02
    assert lacking == pytest.approx(
        pi * a**2 * p0**2 / 4 / (STIFFNESSES[0] * E_STAR / A_HERTZ), rel=0.06
    )
