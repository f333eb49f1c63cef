"""Closed forms of the half-space against reference numbers and their own derivatives."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from indent_sim.theory import half_space as hs

E_STAR = hs.E_star(1.0, 0.3)


def test_reference_numbers():
    # Hertz 1882, Sneddon 1965: R = 1, delta = 0.01, E = 1, nu = 0.3
    assert hs.paraboloid_force(0.01, 1.0, E_STAR) == pytest.approx(1.465201465201e-3, rel=1e-12)
    assert hs.sphere_force(0.01, 1.0, E_STAR) == pytest.approx(1.463736090376e-3, rel=1e-12)
    # C = 0.73762(2), angle between axis and face
    assert hs.square_pyramid_force(1.0, 45.0, 1.0) == pytest.approx(0.73762, abs=2e-5)


@pytest.mark.parametrize("depth", [1e-12, 1e-8, 1e-4, 0.01, 0.3, 1.0, 10.0, 1e3])
def test_sphere_obeys_its_equations_at_any_depth(depth):
    R = 2.0
    # delta = a artanh(a/R) with a = R tanh(t)
    a = R * math.tanh(brentq(lambda t: t * math.tanh(t) - depth, 0.0, depth + 2.0, xtol=1e-300, rtol=1e-14))
    step = 1e-5 * depth
    rise = hs.sphere_force((depth + step) * R, R, 1.0) - hs.sphere_force((depth - step) * R, R, 1.0)
    assert rise / (2 * step * R) == pytest.approx(2.0 * a, rel=1e-8)  # that of a punch of radius a


def test_sphere_tends_to_the_paraboloid():
    def ratio(delta):
        return hs.sphere_force(delta, 1.0, 1.0) / hs.paraboloid_force(delta, 1.0, 1.0)

    assert ratio(1e-10) == pytest.approx(1.0, rel=1e-10)
    assert ratio(0.01) == pytest.approx(1.0 - 0.001, abs=1e-5)


def surface_compliance(C11, C13, C33, C44):
    """w k/p of a half-space from its decaying waves: v' = A v for u_r, u_z, sigma_rz, sigma_zz of wavenumber k = 1."""
    A = np.array(
        [
            [0, 1, 1 / C44, 0],
            [-C13 / C33, 0, 0, 1 / C33],
            [C11 - C13**2 / C33, 0, 0, C13 / C33],
            [0, 0, -1, 0],
        ]
    )
    values, vectors = np.linalg.eig(A)
    decaying = vectors[:, values.real < 0]
    amplitudes = np.linalg.solve(decaying[2:], [0, -1])
    return (decaying[1] @ amplitudes).real


@pytest.mark.parametrize(
    ("E", "E_z", "nu", "nu_z", "G_z"),
    [(1, 2, 0.3, 0.4, 0.3), (3, 1, 0.1, 0.2, 2.0), (1, 1, -0.2, 0.3, 0.1), (0.2, 5, 0.3, 0.45, 1.0)],
)
def test_transverse_modulus_is_that_of_the_decaying_waves(E, E_z, nu, nu_z, G_z):
    # stiffnesses from the inverse of the compliance matrix of the directions 1, 2, 3 = z
    S = np.array([[1 / E, -nu / E, -nu_z / E_z], [-nu / E, 1 / E, -nu_z / E_z], [-nu_z / E_z, -nu_z / E_z, 1 / E_z]])
    C = np.linalg.inv(S)
    M = 2 / surface_compliance(C[0, 0], C[0, 2], C[2, 2], G_z)  # w = 2 p/(E* k)
    assert hs.transverse_modulus(E, E_z, nu, nu_z, G_z) == pytest.approx(M, rel=1e-12)
    assert hs.transverse_modulus(10 * E, 10 * E_z, nu, nu_z, 10 * G_z) == pytest.approx(10 * M, rel=1e-12)


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.4999, 0.5])
def test_transverse_modulus_of_an_isotropic_material(nu):
    assert hs.transverse_modulus(2.0, 2.0, nu, nu, 1.0 / (1.0 + nu)) == pytest.approx(hs.E_star(2.0, nu), rel=1e-14)


def test_nothing_happens_out_of_contact():
    for force in (
        hs.paraboloid_force(-0.1, 1.0, 1.0),
        hs.sphere_force(-0.1, 1.0, 1.0),
        hs.cone_force(-1.0, 45.0, 1.0),
        hs.flat_punch_force(-1.0, 1.0, 1.0),
    ):
        assert force == 0.0


@pytest.mark.parametrize(
    "call",
    [
        lambda: hs.E_star(0.0, 0.3),
        lambda: hs.E_star(1.0, 0.6),
        lambda: hs.paraboloid_force(0.1, -1.0, 1.0),
        lambda: hs.sphere_force(0.1, 1.0, math.nan),
        lambda: hs.cone_force(0.1, 90.0, 1.0),
        lambda: hs.square_pyramid_force(0.1, 0.0, 1.0),
        lambda: hs.flat_punch_force(0.1, math.inf, 1.0),
        lambda: hs.transverse_modulus(1.0, 1.0, 0.3, 0.7, 0.4),
        lambda: hs.transverse_modulus(1.0, 1.0, 1.0, 0.0, 0.4),
        lambda: hs.transverse_modulus(1.0, 1.0, 0.3, 0.3, 0.0),
    ],
)
def test_nonsense_is_refused(call):
    with pytest.raises(ValueError):
        call()
