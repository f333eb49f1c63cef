"""Penalty: the penetration is p/epsilon_n, and the softening that of perturbation theory.

To first order in 1/epsilon_n the potential with penalty is the exact one minus 1/(2 epsilon_n) int
p^2 dA. The force is its derivative by the depth; with Hertz' pressure int p^2 dA / 2 = E*^2 delta^2
/ pi, hence

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
    """Last state for each of the stiffnesses, all on one mesh."""
    base = scene(WALLED, mesh={"h_contact": 0.005})
    return [solve(with_penalty(base, m * E_STAR / A_HERTZ))[-1] for m in STIFFNESSES]


def slope(values: list[float]) -> float:
    """Least-squares slope of log(values) over log(stiffness)."""
    return float(np.polyfit(np.log(STIFFNESSES[: len(values)]), np.log(values), 1)[0])


def test_force_error_falls_as_one_over_the_stiffness(states: list[Any]) -> None:
    """The force error falls as 1/epsilon_n, to 0.05 in the exponent.

    On one mesh F(2 eps) - F(eps) is half of what eps lacks. The next term is a few per cent at 25
    E*/a, and the quadrature points in contact change.
    """
    forces = np.array([state.force for state in states])
    assert np.all(np.diff(forces) > 0)
    assert slope(list(np.diff(forces))) == pytest.approx(-1, abs=0.05)


def test_force_error_is_the_one_of_perturbation_theory(states: list[Any]) -> None:
    """The force error is that of perturbation theory, to 10 %.

    The layer's pressure grows faster than Hertz's, which makes 5 % at this thickness, and the next
    order in 1/eps is as much.
    """
    forces = [state.force for state in states]
    lacking = 2 * (forces[1] - forces[0])  # what a stiffness of 25 E*/a lacks
    assert lacking / forces[-1] == pytest.approx(3 / (2 * pi) / STIFFNESSES[0], rel=0.1)


def test_penetration_falls_as_one_over_the_stiffness(states: list[Any]) -> None:
    """The penetration falls as 1/epsilon_n, to 0.05 in the exponent.

    The peak pressure grows by 5 % from the softest to the stiffest.
    """
    assert slope([state.penetration for state in states]) == pytest.approx(-1, abs=0.05)


def test_penetration_is_pressure_over_stiffness(states: list[Any]) -> None:
    """The penetration is p_max/epsilon_n, to 1 %.

    The penetration is taken at quadrature points and p_max at nodes, too, where the pressure
    oscillates by 1 %.
    """
    for state, m in zip(states, STIFFNESSES, strict=True):
        assert state.penetration * m * E_STAR / A_HERTZ == pytest.approx(state.p_max, rel=0.01)


def test_automatic_stiffness_is_a_multiple_of_modulus_over_element() -> None:
    """The automatic stiffness is 100 E*/h_contact.

    It costs 0.05 % of the force with ten elements in the radius, by the formula above.
    test_extremes.py has the bodies that take more.
    """
    for E, h in ((1.0, 0.02), (5.0, 0.01)):
        base = scene(CYLINDER, material=ELASTIC | {"E": E}, mesh={"h_contact": h}, contact=PENALTY)
        assert base.physics.contact.epsilon_n == pytest.approx(100 * E_STAR / h, rel=1e-12)


def test_stated_stiffness_is_taken_in_the_users_units() -> None:
    """A given epsilon_n has the user's units; the scene is scaled by its height and modulus."""
    body = CYLINDER | {"radius": 2.0, "height": 2.0}
    stated = scene(body, material=ELASTIC | {"E": 4.0}, contact=PENALTY | {"epsilon_n": 300.0})
    assert stated.physics.contact.epsilon_n == pytest.approx(300.0 * 2.0 / 4.0, rel=1e-12)


def test_energy_error_is_the_one_of_perturbation_theory(states: list[Any]) -> None:
    """The energy error is int p^2 dA / (2 eps) = pi a^2 p0^2 / (4 eps), to 6 %.

    a and p0 are those of the layer. Its pressure is not quite an ellipse, and the next order in
    1/eps is 5 %.
    """
    lacking = 2 * (states[1].energy - states[0].energy)
    a, p0 = 1.03127364087e-01, 7.218770639e-02
    assert lacking == pytest.approx(
        pi * a**2 * p0**2 / 4 / (STIFFNESSES[0] * E_STAR / A_HERTZ), rel=0.06
    )
