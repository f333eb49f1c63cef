"""Gels in closed form: homogeneous swelling, small strain, swelling equilibrium, permeability."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from indent_sim.model.gel import Gel
from indent_sim.model.pore_flow import HolmesMow

SOFT = Gel(G=1.0, n_omega=1e-3, chi=0.6, stretch=1.4)
FIRM = Gel(G=1.0, n_omega=1e-2, chi=0.4, stretch=1.3)
HELD_OUT = [
    Gel(G=2.5, n_omega=0.05, chi=0.1, stretch=1.05),
    Gel(G=0.3, n_omega=2e-4, chi=0.45, stretch=2.5),
    Gel(G=7.0, n_omega=0.3, chi=-0.2, stretch=1.6),
    Gel(G=1.0, n_omega=1e-3, chi=0.5, stretch=2.0),
]
GELS = [SOFT, FIRM, *HELD_OUT]
each_gel = pytest.mark.parametrize("gel", GELS)


def along(energy: Any, F: np.ndarray, direction: np.ndarray, order: int) -> float:
    """Derivative of psi at F along a direction, from the law's own UFL expression."""
    t = ufl.variable(ufl.as_ufl(0.0))
    H = [
        [float(F[i, j] - (i == j)) + t * float(direction[i, j]) for j in range(3)] for i in range(3)
    ]
    expression = energy(ufl.as_matrix(H))
    for _ in range(order):
        expression = ufl.diff(expression, t)
    return float(apply_derivatives(apply_algebra_lowering(expression))(()))


def energy_of(gel: Gel, F: np.ndarray) -> float:
    return along(gel.energy, F, np.eye(3), 0)


def nominal_stress(gel: Gel, s: np.ndarray) -> np.ndarray:
    """Nominal stresses of principal stretches."""
    return np.array([along(gel.energy, np.diag(s), axis(i), 1) for i in range(3)])


def axis(i: int) -> np.ndarray:
    return np.outer(np.eye(3)[i], np.eye(3)[i])


def principal_stress(gel: Gel, s: np.ndarray, bath_pressure: float = 0.0) -> np.ndarray:
    """Nominal stresses of a gel in equilibrium with its bath, by stretches from its reference.

    Hong et al., J. Mech. Phys. Solids 56 (2008).
    """
    G, n, chi, l = gel.G, gel.n_omega, gel.chi, gel.stretch
    assert isinstance(l, float)
    grown, J = float(np.prod(s)), l**3 * float(np.prod(s))
    free = n * (1 / l - 1 / l**3) + math.log(1 - 1 / l**3) + 1 / l**3 + chi / l**6
    mixing = math.log(1 - 1 / J) + 1 / J + chi / J**2 - free
    pushed = G * (1 / l - 1 / l**3) / grown + G / n * mixing - bath_pressure
    return G / l * (s - 1 / s) + grown / s * pushed


@pytest.mark.parametrize(
    ("gel", "stretches"),
    [
        *((gel, (1.1, 0.95, 1.07)) for gel in GELS),
        (SOFT, (1.3, 1.2, 1.4)),
        (FIRM, (0.99, 1.02, 0.985)),
    ],
)
def test_slopes_of_the_energy_are_the_stresses(
    gel: Gel, stretches: tuple[float, float, float]
) -> None:
    """Derivatives of the energy are the stresses of Hong et al. (2008).

    Round-off of mu_free and of G/n, up to 5000 times G, leaves 1e-11 of G/n.
    """
    s = np.array(stretches)
    expected = principal_stress(gel, s)
    assert nominal_stress(gel, s) == pytest.approx(
        expected, rel=1e-10, abs=1e-11 * gel.G / gel.n_omega
    )


@each_gel
def test_the_stress_of_swelling_is_the_slope_of_its_energy(gel: Gel) -> None:
    """Under isotropic swelling the energy's slope is `swelling_stress` and the shear term.

    The shear term is G/l (s - 1/s).
    """
    for s in (0.97, 1.0000001):
        slope = along(gel.energy, s * np.eye(3), np.eye(3), 1)
        growth = (s - 1) * (1 + s + s * s)
        by_hand = 3 * gel.shear_modulus * (s - 1) * (s + 1) / s + 3 * s * s * float(
            gel.swelling_stress(growth)
        )
        assert slope == pytest.approx(by_hand, rel=1e-9)


OF_ONE_FORMULA = [
    pytest.param(gel, marks=pytest.mark.verify) for gel in (FIRM, HELD_OUT[1], HELD_OUT[3])
]


@pytest.mark.parametrize("gel", [SOFT, HELD_OUT[0], HELD_OUT[2], *OF_ONE_FORMULA])
def test_small_strain_constants(gel: Gel) -> None:
    """The small-strain constants are the second derivatives of the energy at rest."""
    E, nu = gel.constants
    factor = E / ((1 + nu) * (1 - 2 * nu))
    both, sheared = axis(0) + axis(1), np.outer(np.eye(3)[0], np.eye(3)[1])
    confined = along(gel.energy, np.eye(3), axis(0), 2)
    coupled = along(gel.energy, np.eye(3), both, 2) / 2 - confined
    assert confined == pytest.approx(factor * (1 - nu), rel=1e-9)
    assert coupled == pytest.approx(factor * nu, rel=1e-9, abs=1e-9 * factor)
    assert along(gel.energy, np.eye(3), sheared, 2) == pytest.approx(gel.shear_modulus, rel=1e-12)
    assert coupled == pytest.approx(1 / gel.volumetric_compliance, rel=1e-9)


@pytest.mark.parametrize("gel", [SOFT, HELD_OUT[0]])
@pytest.mark.parametrize("size", [1e-4, 1e-8])
def test_small_strains_keep_their_digits(gel: Gel, size: float) -> None:
    """Energy and stress at small strain are those of Hooke's law.

    The tolerance is the strain times the third derivatives of the law, and the rounding of F.
    """
    H = size * np.array([[0.3, 0.5, -0.2], [0.1, 0.6, 0.4], [-0.3, 0.2, 0.2]])
    E, nu = gel.constants
    mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    eps = (H + H.T) / 2
    hooke = mu * np.sum(eps * eps) + lam / 2 * np.trace(eps) ** 2
    psi, slope = (along(gel.energy, np.eye(3) + H, H, order) for order in (0, 1))
    curved = 100 * size  # third derivatives over second ones: 1/(J0 - 1) and its like
    rounding = 1e-15 / size  # of F = 1 + H, which this test is given
    assert psi == pytest.approx(hooke, rel=curved + rounding)
    assert slope == pytest.approx(2 * hooke, rel=curved + rounding)


@pytest.mark.parametrize("size", [1e-6, 1e-10, 1e-14])
def test_a_small_growth_keeps_all_digits(size: float) -> None:
    """Energy and stress of a tiny growth e keep all digits up to their next order."""
    lam = 1 / SOFT.volumetric_compliance
    assert float(SOFT.swelling_stress(size)) == pytest.approx(lam * size, rel=100 * size + 1e-12)
    E, nu = SOFT.constants
    bulk = E / (3 * (1 - 2 * nu))
    isotropic = ufl.as_matrix((size / 3 * np.eye(3)).tolist())
    energy = apply_derivatives(apply_algebra_lowering(SOFT.energy(isotropic)))
    assert float(energy(())) == pytest.approx(bulk * size * size / 2, rel=100 * size + 1e-12)


@pytest.mark.parametrize("stretches", [(1.1, 0.95, 1.07), (1.2, 1.2, 1.3)])
def test_a_mixed_energy_has_the_same_value_at_its_pressure(
    stretches: tuple[float, float, float],
) -> None:
    """The mixed energy at its stationary pressure q = lambda e is the energy itself."""
    F, e = np.diag(stretches), float(np.prod(stretches)) - 1
    mixed = along(lambda H: FIRM.mixed_energy(H, e / FIRM.volumetric_compliance), F, axis(2), 0)
    assert mixed == pytest.approx(energy_of(FIRM, F), rel=1e-12)


# ---- swelling


@pytest.mark.parametrize(
    ("gel", "rest", "shear", "nu", "nu_at_rest", "bath", "held", "lateral"),
    [
        (SOFT, 1.5756615, 0.71428571, 0.49285072, 0.46703934, 8.7678581, 1.3788065, -0.64364819),
        (FIRM, 1.8607136, 0.76923077, 0.48244298, 0.25115712, 6.6097100, 1.8650459, -1.9064585),
    ],
)
def test_swelling_in_a_bath_of_no_potential(
    gel: Gel,
    rest: float,
    shear: float,
    nu: float,
    nu_at_rest: float,
    bath: float,
    held: float,
    lateral: float,
) -> None:
    """Swelling equilibria and constants are those of another program, to its printed digits."""
    digits = 5.1e-8
    assert gel.free_swelling_stretch(0.0) == pytest.approx(rest, abs=digits)
    assert gel.shear_modulus == pytest.approx(shear, abs=digits)
    assert gel.constants.nu == pytest.approx(nu, abs=digits)
    assert replace(gel, stretch="auto").with_free_swelling(0.0).constants.nu == pytest.approx(
        nu_at_rest, abs=digits
    )
    assert gel.bath_pressure(0.0) == pytest.approx(bath, abs=digits)
    assert gel.confined_swelling(float(gel.bath_pressure(0.0))) == pytest.approx(
        (held, lateral), abs=digits
    )


@each_gel
def test_free_swelling_has_no_stress(gel: Gel) -> None:
    """Free swelling has no stress in the gel's own bath and in any other.

    Free swelling by s is the same as a reference of stretch l s.
    """
    assert gel.free_swelling_stretch(
        float(gel.free_swelling_potential(gel.stretch))
    ) == pytest.approx(gel.stretch, rel=1e-9)
    assert gel.bath_pressure(gel.free_swelling_potential(gel.stretch)) == 0.0
    s = 1.05
    bath = float(gel.bath_pressure(gel.free_swelling_potential(gel.stretch * s)))
    size = gel.G / gel.n_omega  # round-off of what cancels
    assert np.allclose(principal_stress(gel, np.full(3, s), bath), 0.0, atol=1e-13 * size)
    slope = along(gel.energy, s * np.eye(3), axis(0), 1)
    assert slope - bath * s * s == pytest.approx(0.0, abs=1e-13 * size)


@each_gel
@pytest.mark.parametrize("share", [-0.3, -1e-6, 0.0, 1e-6, 0.1])
def test_held_swelling_pushes_nothing_along_its_free_axis(gel: Gel, share: float) -> None:
    bath = share * gel.G / gel.n_omega * 0.01
    s, lateral = gel.confined_swelling(bath)
    across, _, free = principal_stress(gel, np.array([1.0, 1.0, s]), bath)
    size = gel.G / gel.n_omega
    assert free == pytest.approx(0.0, abs=1e-12 * size)
    assert across == pytest.approx(lateral, abs=1e-12 * size)
    assert np.sign(s - 1) == np.sign(-lateral) == np.sign(share)


def test_a_reference_does_not_matter() -> None:
    """Two references of one gel give the same Cauchy stress at the same bath and stretch."""
    other = replace(FIRM, stretch=1.5)
    total = np.array([1.7, 1.6, 1.45])  # of the dry network
    stresses = []
    for gel in (FIRM, other):
        s = total / gel.stretch
        stresses.append(nominal_stress(gel, s) * s / np.prod(s) - float(gel.bath_pressure(-0.01)))
    assert stresses[0] == pytest.approx(stresses[1], rel=1e-10)


def test_energy_of_a_dry_gel_is_not_a_number() -> None:
    s = 0.99 / SOFT.stretch  # type: ignore[operator]
    with pytest.raises(ValueError, match="math domain"):
        energy_of(SOFT, s * np.eye(3))


def test_a_bath_given_beside_a_stretch_leaves_it() -> None:
    assert SOFT.with_free_swelling(0.0) is SOFT


@pytest.mark.parametrize("bath", [0.5, 10.0])
def test_no_free_swelling(bath: float) -> None:
    with pytest.raises(ValueError, match=f"no free swelling .* chemical potential {bath:g} kT"):
        SOFT.free_swelling_stretch(bath)


def test_a_gel_that_would_collapse_is_refused() -> None:
    """A gel whose mixing energy exceeds the stiffness of its network is refused as unstable."""
    with pytest.raises(ValueError, match="is unstable"):
        replace(SOFT, chi=2.0, stretch=2.0).canonical()
    for gel in (*GELS, replace(SOFT, stretch="auto")):
        assert gel.canonical() is gel


# ---- permeability


def test_solvent_moves_by_its_diffusivity() -> None:
    """The permeability follows from the flux D c/(kT) grad mu with c = (J - 1)/(J Omega).

    It is zero for the dry gel and at most D n/G.
    """
    J0 = SOFT.stretch**3  # type: ignore[operator]
    assert SOFT.permeability(1 / J0, 2.0) == pytest.approx(0.0, abs=1e-18)
    assert SOFT.permeability(1.0, 2.0) == pytest.approx(2e-3 * (1 - 1 / J0), rel=1e-14)
    assert SOFT.permeability(1e12, 2.0) == pytest.approx(2e-3, rel=1e-11)


@pytest.mark.parametrize(
    "law", [HolmesMow(M=2.0, phi0=0.2, alpha=2.0), HolmesMow(M=0.0, phi0=0.4, alpha=1.0)]
)
def test_pores_widen_and_close(law: HolmesMow) -> None:
    assert law.permeability_ratio(1.0) == pytest.approx(1.0, rel=1e-14)
    assert law.permeability_ratio(law.phi0) == 0.0
    J = np.linspace(law.phi0, 1.5, 20)
    assert np.all(np.diff(law.permeability_ratio(J)) > 0)
    # d ln k/dJ at rest = alpha/(1 - phi0) + M, by a central difference of 1e-5: 1e-9
    slope = (
        math.log(law.permeability_ratio(1 + 1e-5)) - math.log(law.permeability_ratio(1 - 1e-5))
    ) / 2e-5
    assert slope == pytest.approx(law.alpha / (1 - law.phi0) + law.M, rel=1e-8)


@pytest.mark.parametrize("J", [0.7, 1.0, 1.3])
def test_permeabilities_are_the_same_in_forms_and_in_numbers(J: float) -> None:
    law = HolmesMow(M=2.0, phi0=0.2, alpha=2.0)
    assert law.permeability_ratio(ufl.as_ufl(J) * ufl.as_ufl(1.0))(()) == pytest.approx(
        law.permeability_ratio(J), rel=1e-14
    )
    assert SOFT.permeability(ufl.as_ufl(J), 3.0)(()) == pytest.approx(
        SOFT.permeability(J, 3.0), rel=1e-14
    )


@each_gel
@pytest.mark.parametrize("stretch", [0.9, 1.0, 1.3])
def test_the_stiffness_between_walls_is_the_derivative_of_the_axial_stress(
    gel: Gel, stretch: float
) -> None:
    """The stiffness is the second derivative of psi along the axis, from the law's UFL energy."""
    axis = np.diag([0.0, 0.0, 1.0])
    second_derivative = along(gel.energy, np.diag([1.0, 1.0, stretch]), axis, 2)
    assert gel.confined_stiffness(stretch) == pytest.approx(second_derivative, rel=1e-9)


def test_a_gel_with_a_large_chi_separates_into_two_phases() -> None:
    """Without a network, Flory and Huggins' mixture is unstable from 1/(1 - f) - 1 < 2 chi f on.

    f is the fraction of polymer; with few chains the network hardly moves this limit.
    """
    gel = Gel(G=1.0, n_omega=1e-6, chi=0.7, stretch=1.3)
    limit = (1 - 1 / (2 * gel.chi)) ** -1 / 1.3**3  # f = 1/(J0 J) = 1 - 1/(2 chi)
    assert gel.confined_stiffness(0.99 * limit) > 0 > gel.confined_stiffness(1.01 * limit)
