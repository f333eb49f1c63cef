"""Viscoelastic indentation: closed forms of Lee-Radok and Ting, and time stepping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import beta
from theory_bodies import one_layer

from indent_sim.theory import profiles, surface_contact, viscoelastic_stepping
from indent_sim.theory.elastic_curve import ElasticCurve
from indent_sim.theory.layer import Layer
from indent_sim.theory.lee_radok_ting import LeeRadokTing
from indent_sim.theory.relaxation_function import PowerLaw, ShearRelaxation
from indent_sim.theory.stack import Stack, StackLayer
from indent_sim.theory.surface_contact import (
    RelaxingSurface,
    SearchNotConverged,
    SurfaceContactLCP,
    layer_surface,
)
from indent_sim.theory.viscoelastic_stepping import ViscoelasticTimeStepper

SOLID = ShearRelaxation((0.5,), (1.0,))  # E = 2 instantaneous, 1 in the end
DEPTHS = np.geomspace(1e-4, 1.3, 60)
HERTZ = ElasticCurve(
    DEPTHS, 2 * DEPTHS**1.5, DEPTHS**0.5
)  # in units of the force of E_inf at the depth 1
TRIANGLE = [0.0, 1.0, 2.0], [0.0, 1.0, 0.0]


def layer_of(h: float) -> tuple[Layer, ElasticCurve, float]:
    layer = one_layer(Layer, profiles.paraboloid(1.0), E=2.0, nu=0.45, h=h)
    depths = np.geomspace(1e-5, 1.3, 80) * 0.01
    found = layer.solutions_at_depths(depths.tolist())
    return (
        layer,
        ElasticCurve(depths, np.array([s.force for s in found]), np.array([s.a for s in found])),
        found[-1].a,
    )


@pytest.mark.parametrize(
    ("t", "force"),
    [
        (0.5, 0.645470),
        (1.0, 1.692881),
        (1.1, 1.341960),
        (1.25, 0.883998),
        (1.5, 0.306514),
        (1.7, 0.033696),
    ],
)
def test_a_triangle_on_a_standard_linear_solid(t: float, force: float) -> None:
    """Ting's force of a triangular history is that of an independent quadrature, to six digits."""
    assert LeeRadokTing(SOLID, *TRIANGLE, HERTZ).response_at(t).force == pytest.approx(
        force, abs=6e-7
    )


def test_contact_shrinks_to_nothing_before_the_tip_is_back() -> None:
    cycle = LeeRadokTing(SOLID, *TRIANGLE, HERTZ)
    found = cycle.response_at(1.5)
    assert found.elastic_depth == pytest.approx(0.385110, abs=6e-7)
    assert found.a == pytest.approx(math.sqrt(0.385110), abs=1e-6)
    assert (
        cycle.response_at(1.7618).force > 0
        and cycle.response_at(1.7619).force == 0
        and cycle.response_at(1.7619).a == 0
    )


def test_step_and_hold_follows_the_modulus() -> None:
    cycle = LeeRadokTing(SOLID, [0, 0, 5], [0, 1, 1], HERTZ)
    for t in (0.0, 0.3, 5.0):
        assert cycle.response_at(t).force == pytest.approx(2 * float(SOLID(np.array(t))), rel=1e-12)


def test_a_jump_at_the_beginning_has_two_sides() -> None:
    cycle = LeeRadokTing(SOLID, [0, 0, 5], [0, 1, 1], HERTZ)
    before, after = (cycle.response_at(0.0, is_after_jump=one) for one in (False, True))
    assert (before.delta, before.force, before.a) == (0, 0, 0)
    assert (after.delta, after.force, after.a) == pytest.approx((1, 2, 1), rel=1e-12)


def test_a_ramp_on_a_power_law() -> None:
    """A ramp on a power law has F = C E0 t0^b (3/2) B(3/2, 1-b) v^(3/2) t^(3/2-b)."""
    law, t, v = PowerLaw(0.3, 0.2), 0.7, 0.9
    exact = 2 * law.time**0.3 * 1.5 * beta(1.5, 0.7) * v**1.5 * t**1.2
    assert LeeRadokTing(law, [0, 1], [0, v], HERTZ).response_at(t).force == pytest.approx(
        exact, rel=1e-8
    )


def test_without_relaxation_the_curve_is_elastic() -> None:
    cycle = LeeRadokTing(ShearRelaxation((), ()), [0, 1, 2], [-0.5, 1, 0.2], HERTZ)
    for t, delta in ((0.2, -0.2), (0.6, 0.4), (1.5, 0.6)):
        assert cycle.response_at(t).force == pytest.approx(2 * max(delta, 0) ** 1.5, rel=1e-6)


@pytest.mark.parametrize("exponent", [0.1, 0.3, 0.6])
def test_a_power_law_is_a_sum_of_exponentials(exponent: float) -> None:
    law, t = PowerLaw(exponent, 1.0), np.geomspace(1e-3, 10, 30)
    assert law.prony_series(1e-3, 10.0)(t) == pytest.approx(law(t), rel=1e-4)


@pytest.mark.parametrize("modulus", [SOLID, PowerLaw(0.3, 2.0)])
def test_the_complex_modulus_is_the_transform_of_the_other(
    modulus: ShearRelaxation | PowerLaw,
) -> None:
    """The complex modulus is the Fourier transform of the relaxation modulus.

    i omega int_0^inf (G - G_inf) e^(-i omega t) dt + G_inf; for a power law along t = -i s/omega.
    """
    omega = 1.7
    if isinstance(modulus, PowerLaw):
        x, step = np.linspace(-40, 5, 4000, retstep=True)  # s = e^x: int s^-b e^-s ds
        gamma = float((np.exp(x) ** 0.7 * np.exp(-np.exp(x))).sum() * step)
        assert modulus.complex_modulus(omega) == pytest.approx(
            gamma * (1j * omega * 2.0) ** 0.3, rel=1e-4
        )
    else:
        assert modulus.complex_modulus(omega) == pytest.approx(
            0.5 + 0.5 * 1j * omega / (1 + 1j * omega), rel=1e-12
        )


def test_a_tip_that_comes_back_is_no_cycle() -> None:
    with pytest.raises(ValueError, match="single cycle"):
        LeeRadokTing(SOLID, [0, 1, 2, 3], [0, 1, 0.5, 0.8], HERTZ)
    held = LeeRadokTing(
        SOLID, [0, 1, 1.2, 9], [0, 1, 0.8, 0.8], HERTZ
    )  # what is around the contact comes up again
    assert held.contact_grows_again(np.linspace(0, 9, 90).tolist())
    assert not LeeRadokTing(SOLID, *TRIANGLE, HERTZ).contact_grows_again(
        np.linspace(0, 2, 50).tolist()
    )


@pytest.mark.parametrize("h", [0.2, 1e3])
def test_ting_and_time_stepping_agree(h: float) -> None:
    """Ting's quadrature and time stepping on the compliance agree to 2e-5 of the largest force.

    200 places and 150 steps in each segment leave 1e-5.
    """
    layer, curve, a = layer_of(h)
    times = [0.0, 0.5, 1.0, 1.1, 1.25, 1.5, 1.7, 1.9]
    deltas = np.interp(times, TRIANGLE[0], 0.01 * np.array(TRIANGLE[1]))
    cycle = LeeRadokTing(SOLID, times, deltas.tolist(), curve)
    stepped = list(
        ViscoelasticTimeStepper(layer_surface(layer, a), SOLID).responses(times, deltas.tolist())
    )
    largest = cycle.response_at(1.0).force
    assert [r.force for r in stepped] == pytest.approx(
        [cycle.response_at(t).force for t in times], abs=2e-5 * largest
    )
    assert [r.a for r in stepped[1:-1]] == pytest.approx(
        [cycle.response_at(t).a for t in times[1:-1]], rel=1e-3
    )


def test_a_force_that_grows_follows_the_creep_compliance() -> None:
    """A growing force follows the creep compliance: F_el(delta(t)) = E int J(t-s) dF.

    For this solid E J = 2 - exp(-t/2), so that a ramp F = f t has F_el = f (2t - 2 + 2 exp(-t/2)).
    """
    layer, curve, a = layer_of(1e3)
    f, times = 1e-3, [0.0, 0.5, 1.0]
    found = list(
        ViscoelasticTimeStepper(layer_surface(layer, a), SOLID, is_force_controlled=True).responses(
            times, [f * t for t in times]
        )
    )
    for response in found[1:]:
        exact = curve.depth_of_force(f * (2 * response.t - 2 + 2 * math.exp(-response.t / 2)))
        assert response.delta == pytest.approx(exact, rel=2e-5) and response.force == pytest.approx(
            f * response.t
        )


def test_a_spring_between_tip_and_base() -> None:
    """With a spring z = delta + c F at every time; a stiff spring is depth control."""
    layer, _, a = layer_of(0.2)
    surface, times, z = layer_surface(layer, a), [0.0, 1.0, 2.0, 3.0], [0.0, 0.01, 0.003, 0.01]
    soft = list(ViscoelasticTimeStepper(surface, SOLID, compliance=1.0).responses(times, z))
    assert [r.delta + r.force for r in soft] == pytest.approx(z, abs=1e-12)
    stiff = list(ViscoelasticTimeStepper(surface, SOLID, compliance=1e-9).responses(times, z))
    free = list(ViscoelasticTimeStepper(surface, SOLID).responses(times, z))
    assert [r.force for r in stiff] == pytest.approx([r.force for r in free], rel=1e-6)
    assert soft[1].force < free[1].force


def test_a_contact_that_is_no_disc() -> None:
    """Permuted places without radii, solved by active sets, give the forces of the disc."""
    layer = Layer.from_stack(
        profiles.paraboloid(1.0),
        Stack((StackLayer(1.0, 2.0, 0.0), StackLayer(math.inf, 2.0, 0.0)), None),
    )
    disc = layer_surface(layer, 0.1)
    order = np.random.default_rng(1).permutation(len(disc.areas))
    other = RelaxingSurface(
        disc.compliance[np.ix_(order, order)], disc.heights[order], disc.areas[order]
    )
    times, z = [0.0, 1.0, 1.5, 2.0], [0.0, 0.01, 0.002, 0.006]
    found = [
        [r.force for r in ViscoelasticTimeStepper(surface, SOLID).responses(times, z)]
        for surface in (disc, other)
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def test_what_does_not_settle_is_no_pressure(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that is cut off, and a contact that is a ring, raise an error."""
    layer, _, a = layer_of(0.05)
    disc = layer_surface(layer, a)
    with pytest.raises(SearchNotConverged, match="not a disc"):
        SurfaceContactLCP(disc, disc.compliance).solve_pressures(
            disc.heights[::-1] - 0.001 * disc.areas
        )
    monkeypatch.setattr(surface_contact, "MAX_ACTIVE_SET_ITERATIONS", 1)
    other = RelaxingSurface(disc.compliance, disc.heights, disc.areas)
    with pytest.raises(SearchNotConverged, match="1 iterations"):
        SurfaceContactLCP(other, other.compliance).solve_pressures(disc.heights - 0.01 * disc.areas)
    monkeypatch.setattr(viscoelastic_stepping, "MAX_SEARCH_STEPS", 1)
    with pytest.raises(SearchNotConverged, match="was not found"):
        list(
            ViscoelasticTimeStepper(disc, SOLID, is_force_controlled=True).responses(
                [0.0, 1.0], [0.0, 1e-3]
            )
        )


def test_pressures_at_round_off_settle() -> None:
    """A place on the border between contact and gap is accepted and does not alternate for ever."""
    surface = RelaxingSurface(np.eye(3) + 0.1, np.array([0.0, 0.0, 1.0]), np.ones(3))
    p = SurfaceContactLCP(surface, surface.compliance).solve_pressures(
        np.array([-1.0, -1.0 / 11, 1.0])
    )
    assert p == pytest.approx([1 / 1.1, 0.0, 0.0], abs=1e-12)
