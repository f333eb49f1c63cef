"""Film formulas: their constants, their limits, and their distance from the exact solution."""

import math

import pytest
from theory_bodies import indent

from indent_sim.theory import half_space as hs
from indent_sim.theory import profiles
from indent_sim.theory.films import dimitriadis_force, gao_modulus, perriot_barthel_modulus
from indent_sim.theory.layer import Layer
from indent_sim.theory.stack import Stack, StackLayer

FORMULAS = (gao_modulus, perriot_barthel_modulus)
# film nu 0.3 on a half-space E 1, nu 0.3, flat punch: E_f, a/t, and how far off in per cent the two
# formulas are
OFF = [
    (0.1, 0.1, (56.2, -2.7)),
    (0.1, 1.0, (178.9, -10.8)),
    (0.1, 5.0, (70.7, 1.1)),
    (0.5, 1.0, (10.9, -0.5)),
    (2.0, 1.0, (10.3, -2.7)),
    (10.0, 0.1, (36.7, -3.6)),
    (10.0, 1.0, (141.6, -17.6)),
    (10.0, 5.0, (79.4, -13.1)),
]


@pytest.mark.parametrize(("E", "a", "per_cent"), OFF)
def test_how_far_off_they_are(E, a, per_cent):
    film, substrate = StackLayer(1.0, E, 0.3), StackLayer(math.inf, 1.0, 0.3)
    exact = Layer.from_stack(
        profiles.flat_punch(a), Stack((film, substrate), None)
    ).solutions_at_depths([1.0])[0].stiffness / (2 * a)
    for formula, expected in zip(FORMULAS, per_cent, strict=True):
        assert 100 * (formula(film, substrate, a) / exact - 1) == pytest.approx(expected, abs=0.06)


@pytest.mark.parametrize("formula", FORMULAS)
def test_limits(formula):
    film, substrate = StackLayer(1.0, 3.0, 0.2), StackLayer(math.inf, 1.0, 0.45)
    assert formula(film, substrate, 1e-6) == pytest.approx(hs.E_star(3.0, 0.2), rel=1e-5)
    assert formula(film, substrate, 1e6) == pytest.approx(hs.E_star(1.0, 0.45), rel=1e-4)
    assert formula(film, film, 0.7) == pytest.approx(hs.E_star(3.0, 0.2), rel=1e-14)


@pytest.mark.parametrize("base", ["fixed", "roller"])
@pytest.mark.parametrize("nu", [0.2, 0.3, 0.4, 0.5])
def test_dimitriadis_is_good_for_small_contacts(nu, base):
    ply, x = StackLayer(2.0, 1.0, nu), 0.02
    delta = (x * ply.thickness) ** 2
    exact = indent(Layer, profiles.paraboloid(1.0), delta, E=1.0, nu=nu, h=2.0, base=base).force
    # its first coefficient is a fit, good to some per cent but on a frictionless base: 0.884 at nu
    # = 0.5, exactly 0.743
    assert dimitriadis_force(delta, 1.0, ply, base) == pytest.approx(exact, rel=0.2 * x)


def test_dimitriadis_has_the_printed_coefficients():
    # Biophys. J. 82, 2798, incompressible layers
    for base, printed in [
        ("fixed", (1.133, 1.283, 0.769, 0.0975)),
        ("roller", (0.884, 0.781, 0.386, 0.0048)),
    ]:
        for x in (0.1, 0.5, 1.0):
            ratio = dimitriadis_force(
                x**2, 1.0, StackLayer(1.0, 1.0, 0.5), base
            ) / hs.paraboloid_force(x**2, 1.0, 4 / 3)
            assert ratio == pytest.approx(
                1 + sum(c * x ** (n + 1) for n, c in enumerate(printed)), abs=1e-3
            )


def test_nonsense_is_refused():
    ply = StackLayer(1.0, 1.0, 0.3)
    with pytest.raises(ValueError):
        dimitriadis_force(0.1, 1.0, ply, "glued")
    for formula in FORMULAS:
        with pytest.raises(ValueError):
            formula(ply, ply, 0.0)
