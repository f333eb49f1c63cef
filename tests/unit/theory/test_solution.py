"""Quantities of a theory's solution."""

from __future__ import annotations

import math

import numpy as np
import pytest
from theory_bodies import indent, stack_of

from indent_sim.theory import half_space as hs
from indent_sim.theory import profiles
from indent_sim.theory.layer import Layer
from indent_sim.theory.profiles import Tip
from indent_sim.theory.solution import no_contact


def test_largest_pressure_of_hertz() -> None:
    """The largest pressure of Hertz is 2 E* a/(pi R).

    The layer is 1e6 contact radii deep.
    """
    found = indent(Layer, profiles.paraboloid(1.0), 1e-4, E=1.0, nu=0.3, h=1e4)
    assert found.largest_pressure() == pytest.approx(
        2 * hs.E_star(1.0, 0.3) * 0.01 / math.pi, rel=1e-6
    )


def test_largest_pressure_beside_a_rounded_edge() -> None:
    """The largest pressure of a rounded punch lies near the edge and is that of a dense scan."""
    found = indent(Layer, profiles.flat_punch(0.3, 0.02), 0.01, E=1.0, nu=0.3, h=1.0)
    r = np.concatenate(
        [np.linspace(0.0, 0.8 * found.a, 401), np.linspace(0.8 * found.a, found.a, 4001)]
    )
    scanned = found.pressure(r)
    assert r[np.argmax(scanned)] > 0.8 * found.a
    assert scanned.max() <= found.largest_pressure() * (1 + 1e-12)
    assert found.largest_pressure() == pytest.approx(scanned.max(), rel=1e-6)


@pytest.mark.parametrize(
    "tip",
    [
        profiles.cone(70.0),
        profiles.flat_punch(0.2),
        profiles.piecewise_linear(((0, 0), (0.02, 0.001), (1, 0.2))),
    ],
)
def test_an_infinite_pressure_is_not_a_number(tip: Tip) -> None:
    """An infinite pressure is NaN: under an apex, a corner or a sharp edge."""
    contact = Layer.from_stack(tip, stack_of([(1.0, 1.0, 0.3)]))
    assert math.isnan(contact.solutions_at_depths([0.01])[0].largest_pressure())


def test_a_finely_rounded_apex_has_a_largest_pressure() -> None:
    found = indent(Layer, profiles.cone(70.0, 1e-4), 0.01, E=1.0, nu=0.3, h=1.0)
    assert found.largest_pressure() == pytest.approx(
        float(found.pressure(np.zeros(1))[0]), rel=1e-9
    )


def test_without_contact_there_is_none() -> None:
    assert no_contact(-0.1).largest_pressure() == 0.0
