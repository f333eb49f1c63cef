"""Contacts interpolated between a few sizes are those that are sought one by one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from indent_sim.theory import contact_curve, profiles
from indent_sim.theory.contact_curve import ChebyshevContactCurve, ContactCurve
from indent_sim.theory.layer import Layer
from indent_sim.theory.solution import Solution
from indent_sim.theory.stack import Stack, StackLayer
from indent_sim.theory.strip import Strip
from indent_sim.theory.surface_tension import LayerWithSurfaceTension

RUBBER, SPONGE = Stack((StackLayer(1.0, 1.0, 0.5),)), Stack((StackLayer(1.0, 1.0, 0.3),))
HALF_SPACE = Stack.half_space(1.0, 1.0)
COATED = Stack((StackLayer(1.0, 1000.0, 0.3), StackLayer(math.inf, 1.0, 0.4)), None)
SMOOTH = {
    "a sphere on a layer": (Layer.from_stack(profiles.sphere(1.25), RUBBER), 0.05),
    "a film much thinner than the contact": (
        Layer.from_stack(profiles.paraboloid(500.0), SPONGE),
        0.2,
    ),
    "nearly the whole of a sphere": (Layer.from_stack(profiles.sphere(1.0), HALF_SPACE), 0.95),
    "a cone": (Layer.from_stack(profiles.cone(60.0), RUBBER), 0.2),
    "a hyperboloid": (Layer.from_stack(profiles.hyperboloid(0.3, 60.0), RUBBER), 0.2),
    "a stiff film on a soft half-space": (Layer.from_stack(profiles.paraboloid(2.0), COATED), 0.1),
    "beside a wall": (Layer.from_stack(profiles.sphere(2.0), SPONGE, 2.0), 0.1),
    "a roller": (Strip.from_stack(profiles.paraboloid(5.0), SPONGE), 0.1),
    "a roller between walls": (Strip.from_stack(profiles.paraboloid(5.0), SPONGE, 3.0), 0.1),
}
# of both ways: a search ends within 1e-11 of the size, squared, and sums of a hundred terms lose
# digits
ROUNDING = 5e-12


def numbers(found: list[Solution]) -> np.ndarray:
    """Depth, force, size, area, energy, stiffness and largest pressure of contacts (n, 7)."""
    known = [
        (s.delta, s.force, s.a, s.area, s.energy, s.stiffness, s.largest_pressure()) for s in found
    ]
    return np.array(known)


def one_by_one(contact: ContactCurve, deltas: Sequence[float]) -> list[Solution]:
    """Contacts at depths, each sought alone: one depth is not interpolated."""
    return [contact.solutions_at_depths([delta])[0] for delta in deltas]


@pytest.fixture
def curves(monkeypatch) -> list[ChebyshevContactCurve | None]:
    """Interpolated curves that a test asks for; None where there is none."""
    asked: list[ChebyshevContactCurve | None] = []
    interpolate = ChebyshevContactCurve.interpolate

    def recorded(*given):
        asked.append(interpolate(*given))
        return asked[-1]

    monkeypatch.setattr(ChebyshevContactCurve, "interpolate", recorded)
    return asked


@pytest.mark.parametrize("name", SMOOTH)
def test_many_depths_are_those_sought_one_by_one(name, curves):
    contact, deepest = SMOOTH[name]
    deltas = list(deepest * np.arange(1, 121) / 120)
    some = slice(0, None, 13)
    found = numbers(contact.solutions_at_depths(deltas)[some])
    assert curves[-1] is not None
    np.testing.assert_allclose(found, numbers(one_by_one(contact, deltas[some])), rtol=ROUNDING)


@pytest.mark.parametrize("name", SMOOTH)
def test_forces_are_met(name):
    contact, deepest = SMOOTH[name]
    expected = one_by_one(contact, deepest * np.linspace(0.1, 1.0, 60))
    found = contact.solutions_at_forces([one.force for one in expected])
    np.testing.assert_allclose(
        [one.delta for one in found], [one.delta for one in expected], rtol=ROUNDING
    )


def test_pressure_and_surface_are_solved_for_when_asked():
    contact, deepest = SMOOTH["a sphere on a layer"]
    one = contact.solutions_at_depths(list(np.linspace(0.1, 1.0, 40) * deepest))[17]
    (expected,) = one_by_one(contact, [one.delta])
    r = np.linspace(0.0, 2.0 * one.a, 50)
    np.testing.assert_allclose(
        one.pressure(r), expected.pressure(r), rtol=1e-9, atol=1e-9 * one.force / one.area
    )
    np.testing.assert_allclose(
        one.u_z(r), expected.u_z(r), rtol=1e-9
    )  # beside the edge both lose half of the digits


def no_polynomial() -> dict[str, ContactCurve]:
    """Contacts that no polynomial of their size approximates, or that need none."""
    return {
        "a rim": Layer.from_stack(profiles.flat_punch(1.0, 0.3), RUBBER),
        "a punch": Layer.from_stack(profiles.flat_punch(1.0), RUBBER),
        "corners": Layer.from_stack(
            profiles.piecewise_linear([(0, 0), (1, 0.1), (2, 0.4)]), RUBBER
        ),
        "a wedge between walls": Strip.from_stack(profiles.cone(70.0), SPONGE, 3.0),
        "steps of its own quadrature": LayerWithSurfaceTension.from_layer(
            Layer.from_stack(profiles.sphere(1.25), RUBBER), 0.1
        ),
    }


@pytest.mark.parametrize("name", no_polynomial())
def test_what_is_no_polynomial_is_sought_one_by_one(name, curves):
    contact = no_polynomial()[name]
    deltas = np.linspace(0.001, 0.1, 30).tolist()
    assert [one.delta for one in contact.solutions_at_depths(deltas)] == pytest.approx(deltas)
    assert not any(curves)


def test_few_sizes_are_asked_for_where_few_depths_are_wanted():
    contact, deepest = SMOOTH["a film much thinner than the contact"]
    asked = []

    class Counting(Layer):
        def linear_solutions(self, sizes, largest):
            asked.extend(sizes)
            return super().linear_solutions(sizes, largest)

    counting = Counting(contact.tip, contact.scaled_stack, contact.E_star, contact.h, contact.wall)
    sizes = [one.a / contact.h for one in one_by_one(contact, [0.1 * deepest, deepest])]
    assert ChebyshevContactCurve.interpolate(counting, *sizes, max_sizes=15) is None
    assert len(asked) == 8  # what the first coefficients say of the others is believed


def test_no_contact_at_no_depth_among_many():
    contact, deepest = SMOOTH["a cone"]
    found = contact.solutions_at_depths([-0.1 * deepest, 0.0, *np.linspace(0.1, 1.0, 20) * deepest])
    assert [one.force for one in found[:2]] == [0.0, 0.0] and found[2].force > 0.0


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_depth_that_is_no_number_is_refused_among_many(wrong):
    contact, deepest = SMOOTH["a cone"]
    with pytest.raises(ValueError, match="finite"):
        contact.solutions_at_depths([*np.linspace(0.1, 1.0, 20) * deepest, wrong])


def test_a_depth_that_is_not_found_is_an_error(monkeypatch):
    """A depth that is not found raises an error; `Theory` then solves each depth on its own."""
    contact, deepest = SMOOTH["a film much thinner than the contact"]
    monkeypatch.setattr(contact_curve, "SIZE_TOLERANCE", 1.0)  # one step of the search
    with pytest.raises(ArithmeticError, match="did not converge"):
        contact.solutions_at_depths(list(deepest * np.arange(1, 121) / 120))


@pytest.mark.parametrize("name", SMOOTH)
def test_all_contacts_at_once_are_those_one_by_one(name):
    """Numbers and pressures of many sizes at once are those of each contact alone."""
    contact, deepest = SMOOTH[name]
    sizes = [one.a / contact.h for one in one_by_one(contact, [0.2 * deepest, deepest])]
    sampled = ChebyshevContactCurve.interpolate(contact, *sizes, max_sizes=228)
    together, found = sampled.curve, sampled.linear_solutions
    expected = ContactCurve.load_values(contact, sampled.sizes, found)
    np.testing.assert_allclose(together.load_values(sampled.sizes, found), expected, rtol=ROUNDING)
    with np.errstate(all="ignore"):  # on the axis of a cone it is infinite, in both
        p = together.pressures(sampled.sizes, found, 25)
        expected = ContactCurve.pressures(contact, sampled.sizes, found, 25)
    p, expected = (np.where(np.isfinite(one), one, 0.0) for one in (p, expected))
    apart = (p - expected) / expected.max(axis=1, keepdims=True)
    assert (
        np.abs(apart).max() < 1e-10
    )  # beside the edge the half-space's part loses digits: differences over a - r
