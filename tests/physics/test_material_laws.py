"""Hyperelastic laws: energy, stress and curvature of the compiled expressions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from compiled_laws import I, Numbers
from scipy.optimize import brentq

from indent_sim.model.hyperelasticity import (
    ArrudaBoyce,
    Fung,
    Gent,
    Hencky,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
)
from indent_sim.model.linear_elasticity import LinearElastic

LAWS: dict[str, Any] = {
    "neo_hookean": NeoHookean(mu=1.0, lame_lambda=1.5).canonical(),
    "hencky": Hencky(E=2.5, nu=0.3),
    "mooney_rivlin": MooneyRivlin(C10=0.3, C01=0.2, nu=0.3),
    "yeoh": Yeoh(C10=0.5, C20=-0.05, C30=0.02, nu=0.3),
    "ogden": Ogden(mu=(0.6, -0.2), alpha=(1.7, -2.3), nu=0.3),
    "gent": Gent(mu=1.0, Jm=9.0, nu=0.3),
    "fung": Fung(mu=1.0, b=1.5, nu=0.3),
    "arruda_boyce": ArrudaBoyce(mu=1.0, lambda_m=2.5, nu=0.3),
}
# Where stretches meet roots are kept off zero by 1e-6 or 3e-6 (model/algebra.py): 1e-11 of energies
# and stresses, a few tens of it with exponents and strains like these. The other laws are exact to
# round-off.
EXACT = {name: 1e-12 for name in LAWS} | {"ogden": 1e-9, "hencky": 1e-9}
each_law = pytest.mark.parametrize("name", LAWS)


@cache
def numbers(name: str, mixed: bool = False) -> Numbers:
    """Compiled numbers of one of LAWS."""
    return Numbers(LAWS[name], mixed)


def some_F(seed: int, size: float = 0.25) -> np.ndarray:
    """Deformation gradient without any symmetry."""
    return I + size * np.random.default_rng(seed).uniform(-1, 1, (3, 3))


def stationary_pressure(law: Any, F: np.ndarray) -> float:
    """q at which the mixed energy is stationary.

    It is lambda ln J for neo-Hookean laws and kappa ln J - k (I1 - 3) for others.
    """
    k = 0.0 if isinstance(law, NeoHookean) else law.poynting_coefficient
    return float(np.log(np.linalg.det(F)) / law.volumetric_compliance - k * (np.sum(F * F) - 3))


def rotation(seed: int) -> np.ndarray:
    """Random proper rotation."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


# ---- the law of the notes' original code, exactly

HOMOGENEOUS = 1e-9  # the printed digits of the reference


def free_stretch(held: Any) -> float:
    """Stretch s at which the last normal stress of the deformation held(s) vanishes."""
    return float(
        brentq(lambda s: numbers("neo_hookean").stress(held(s))[2, 2], 0.3, 3.0, xtol=1e-15)
    )


@pytest.mark.parametrize(
    ("stretch", "P", "lateral"),
    [(0.7, -1.053599103217, 1.107934732848), (1.5, 0.983528458625, 0.880174591807)],
)
def test_uniaxial(stretch: float, P: float, lateral: float) -> None:
    def F(s: float) -> np.ndarray:
        return np.diag([stretch, s, s])

    s = free_stretch(F)
    assert s == pytest.approx(lateral, abs=HOMOGENEOUS)
    assert np.allclose(numbers("neo_hookean").stress(F(s)), np.diag([P, 0, 0]), atol=HOMOGENEOUS)


def test_equibiaxial() -> None:
    s = free_stretch(lambda s: np.diag([1.5, 1.5, s]))
    assert s == pytest.approx(0.652018518357, abs=HOMOGENEOUS)
    P = numbers("neo_hookean").stress(np.diag([1.5, 1.5, s]))
    assert np.allclose(P, np.diag([1.216581234479, 1.216581234479, 0]), atol=HOMOGENEOUS)


def test_confined() -> None:
    P = numbers("neo_hookean").stress(np.diag([0.7, 1, 1]))
    assert np.allclose(
        P, np.diag([-1.492874879869, -0.535012415908, -0.535012415908]), atol=HOMOGENEOUS
    )


def test_simple_shear() -> None:
    F = I + 0.5 * np.outer(I[0], I[1])
    P = numbers("neo_hookean").stress(F)
    assert P[0, 1] == pytest.approx(0.5, abs=HOMOGENEOUS)
    assert P[1, 0] == pytest.approx(0.5, abs=HOMOGENEOUS)
    assert (P @ F.T)[0, 0] == pytest.approx(0.25, abs=HOMOGENEOUS)


# ---- the other laws, against the textbook stress of an incompressible bar


def incompressible_uniaxial(name: str, stretch: float) -> float:
    """Nominal stress of an incompressible bar, written out for each law.

    Treloar 1975, Ogden 1972, Gent 1996, Fung 1967, Arruda & Boyce 1993.
    """
    law, I1 = LAWS[name], stretch**2 + 2 / stretch
    strain = stretch - stretch**-2
    match name:
        case "neo_hookean":
            return strain * law.shear_modulus
        case "hencky":
            return 3 * law.shear_modulus * np.log(stretch) / stretch
        case "mooney_rivlin":
            return 2 * strain * (law.C10 + law.C01 / stretch)
        case "yeoh":
            return 2 * strain * (law.C10 + 2 * law.C20 * (I1 - 3) + 3 * law.C30 * (I1 - 3) ** 2)
        case "ogden":
            pairs = zip(law.mu, law.alpha, strict=True)
            return sum(
                mu * (stretch ** (alpha - 1) - stretch ** (-alpha / 2 - 1)) for mu, alpha in pairs
            )
        case "gent":
            return strain * law.mu * law.Jm / (law.Jm - I1 + 3)
        case "fung":
            return strain * law.mu * np.exp(law.b * (I1 - 3))
    c = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
    return 2 * strain * law.mu * sum((i + 1) * c[i] * (I1 / law.lambda_m**2) ** i for i in range(5))


@each_law
@pytest.mark.parametrize("stretch", [0.5, 0.8, 1.3, 2.0])
def test_incompressible_bar(name: str, stretch: float) -> None:
    """At J = 1 every law has the textbook stress of an incompressible bar.

    The pressure that frees the sides is eliminated by hand: P11 - P22 stretch^(-3/2).
    """
    s = stretch**-0.5
    F = np.diag([stretch, s, s])
    P = numbers(name, mixed=True).stress(F, stationary_pressure(LAWS[name], F))
    found = P[0, 0] - P[1, 1] * s / stretch
    assert found == pytest.approx(incompressible_uniaxial(name, stretch), rel=EXACT[name])


# ---- what every law must be


@each_law
@pytest.mark.parametrize("mixed", [False, True])
def test_no_energy_and_no_stress_at_rest(name: str, mixed: bool) -> None:
    """A body at rest, rotated or not, has no energy and no stress, to round-off near 3^5."""
    for Q in (I, rotation(1)):
        assert abs(numbers(name, mixed).energy(Q)) < 1e-11
        assert np.abs(numbers(name, mixed).stress(Q)).max() < 1e-11


@each_law
@pytest.mark.parametrize("mixed", [False, True])
def test_no_stress_at_all_in_the_untouched_body(name: str, mixed: bool) -> None:
    """The stress at H = 0 is exactly zero.

    A body that is not touched has no force with which round-off could be compared.
    """
    assert not numbers(name, mixed).stress_of_gradient(np.zeros((3, 3))).any()


@each_law
def test_stress_of_a_small_strain_keeps_its_digits(name: str) -> None:
    """At H of 1e-9 the stress is Hooke's, to the next order in H.

    1 + H would leave 1e-7.
    """
    G, (E, nu) = np.random.default_rng(9).uniform(-1, 1, (3, 3)) * 1e-9, LAWS[name].constants
    eps = (G + G.T) / 2
    hooke = E / (1 + nu) * (eps + nu / (1 - 2 * nu) * np.trace(eps) * I)
    assert np.allclose(
        numbers(name).stress_of_gradient(G), hooke, rtol=0, atol=3e-8 * np.abs(hooke).max()
    )


@each_law
@pytest.mark.parametrize("size", [1e-7, 1e-5, 1e-4])
def test_stress_has_no_noise(name: str, size: float) -> None:
    """Third differences of the stress in a small strain are round-off, below 2e-11.

    The stress is a parabola in the strain to 1e-14 at 1e-4.
    """
    G = np.random.default_rng(9).uniform(-1, 1, (3, 3))
    stresses = [numbers(name).stress_of_gradient(size * (1 + 0.01 * k) * G) for k in range(4)]
    assert np.abs(np.diff(stresses, 3, axis=0)).max() < 2e-11 * np.abs(stresses[0]).max()


@each_law
def test_objective_and_isotropic(name: str) -> None:
    """psi(Q F R) = psi(F) and P(Q F R) = Q P(F) R, to 1e-10.

    The roots of Ogden's law lie near a singular point and magnify round-off by up to 1e6.
    """
    F, Q, R = some_F(2), rotation(3), rotation(4)
    law = numbers(name)
    assert law.energy(Q @ F @ R) == pytest.approx(law.energy(F), rel=1e-10)
    assert np.allclose(law.stress(Q @ F @ R), Q @ law.stress(F) @ R, atol=1e-10)


STEPS = np.array([1e-1, 3e-2, 1e-2, 3e-3])


def slope_of(remainders: np.ndarray) -> float:
    """Least-squares slope in log-log."""
    return float(np.polyfit(np.log(STEPS), np.log(np.abs(remainders)), 1)[0])


@each_law
@pytest.mark.parametrize("mixed", [False, True])
def test_taylor(name: str, mixed: bool) -> None:
    """The remainders of the energy's expansion fall with the square and the cube of the step.

    0.1 is the next term at a step of 0.1.
    """
    F, G, q, dq = some_F(5), some_F(6, 0.5) - I, 0.3, 0.7
    psi, first, second = numbers(name, mixed).along(F, G, q, dq)
    stepped = np.array([numbers(name, mixed).energy(F + h * G, q + h * dq) for h in STEPS])
    assert slope_of(stepped - psi - STEPS * first) == pytest.approx(2, abs=0.1)
    assert slope_of(stepped - psi - STEPS * first - STEPS**2 / 2 * second) == pytest.approx(
        3, abs=0.1
    )


@each_law
def test_small_strain_is_hooke(name: str) -> None:
    """The second derivative at rest is 2 mu eps:eps + lame_lambda (tr eps)^2 in all directions.

    E and nu are the law's own constants.
    """
    law = LAWS[name]
    E, nu = law.constants
    mu, lame_lambda = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
    for seed in range(3):
        G = np.random.default_rng(seed).normal(size=(3, 3))
        eps = (G + G.T) / 2
        hooke = 2 * mu * np.sum(eps * eps) + lame_lambda * np.trace(eps) ** 2
        assert numbers(name).along(I, G)[2] == pytest.approx(hooke, rel=1e-9)


def test_linear_elasticity_is_hooke() -> None:
    law = Numbers(LinearElastic(E=2.0, nu=0.3), False)
    G = np.random.default_rng(0).normal(size=(3, 3))
    eps = (G + G.T) / 2
    mu, lame_lambda = 1 / 1.3, 0.6 / 1.3 / 0.4
    assert np.allclose(
        law.stress(I + G), 2 * mu * eps + lame_lambda * np.trace(eps) * I, atol=1e-12
    )


@each_law
@pytest.mark.parametrize("gamma", [0.02, 1e-4, 1e-7])
def test_q_is_the_normal_stress_in_simple_shear(name: str, gamma: float) -> None:
    """At q = 0 no normal stress acts on a sheared surface, up to 4 mu gamma^4.

    If q were the mean stress, it would be 0.3 to 0.8 mu gamma^2. 1e-14 of the shear stress is the
    round-off of I1 - 3.
    """
    law = replace(LAWS[name], nu=0.5)
    mu = law.constants.E / 3
    shear = gamma * np.outer(I[0], I[1])
    normal_stress = Numbers(law, mixed=True).stress_of_gradient(shear)[1, 1]
    round_off = {"ogden": 1e-9, "hencky": 1e-9}.get(name, 1e-14)
    assert abs(normal_stress) < mu * (20 * gamma**4 + round_off * gamma)


@each_law
def test_mixed_is_the_displacement_law_at_its_pressure(name: str) -> None:
    """Where it is stationary in q, the mixed law has the energy and stress of the other."""
    law, F = LAWS[name], some_F(7)
    q = stationary_pressure(law, F)
    assert numbers(name, True).along(F, 0 * I, q, 1.0)[1] == pytest.approx(0, abs=1e-13)
    assert numbers(name, True).energy(F, q) == pytest.approx(numbers(name).energy(F), rel=1e-12)
    assert np.allclose(numbers(name, True).stress(F, q), numbers(name).stress(F), atol=1e-12)


# ---- special cases of one law are another

NEO = MooneyRivlin(C10=0.5, nu=0.3)  # the isochoric neo-Hookean law, mu = 1
SAME = {
    "ogden_2": (Ogden(mu=(1.0,), alpha=(2.0,), nu=0.3), NEO, 1e-9),
    "ogden_2_-2": (
        Ogden(mu=(0.6, -0.4), alpha=(2.0, -2.0), nu=0.3),
        MooneyRivlin(C10=0.3, C01=0.2, nu=0.3),
        1e-9,
    ),
    "yeoh": (Yeoh(C10=0.5, nu=0.3), NEO, 1e-14),
    # what is left of the next term, (I1 - 3)^2 / (4 Jm) and (I1^2 - 9) / (20 lambda_m^2), with I1
    # near 3
    "gent": (Gent(mu=1.0, Jm=1e8, nu=0.3), NEO, 1e-7),
    "arruda_boyce": (ArrudaBoyce(mu=1.0, lambda_m=1e4, nu=0.3), NEO, 1e-7),
    "fung": (Fung(mu=1.0, b=1e-12, nu=0.3), NEO, 1e-11),  # b (I1 - 3)/2 of the energy
}


@pytest.mark.parametrize("case", SAME)
def test_special_case(case: str) -> None:
    special, other, tolerance = SAME[case]
    one, two = Numbers(special, False), Numbers(other, False)
    for F in (some_F(8), np.diag([1.6, 1.6, 0.5]), np.diag([0.6, 1.2, 1.2])):
        assert one.energy(F) == pytest.approx(two.energy(F), rel=tolerance)
        assert np.allclose(one.stress(F), two.stress(F), atol=tolerance)


def test_gent_has_a_limit() -> None:
    """Gent's energy grows without bound towards I1 - 3 = Jm and is not a number beyond it.

    For Jm = 9 the limiting stretch is 3.27.
    """

    def bar(stretch: float) -> np.ndarray:
        return np.diag([stretch, stretch**-0.5, stretch**-0.5])

    limit = brentq(lambda s: s * s + 2 / s - 3 - 9.0, 1, 10, xtol=1e-15)
    law = numbers("gent")
    assert law.stress(bar(limit * (1 - 1e-9)))[0, 0] > 1e8
    assert not np.isfinite(law.energy(bar(limit * (1 + 1e-9))))
