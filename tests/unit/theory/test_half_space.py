"""Closed forms of the half-space against reference numbers and their own integrals and derivatives."""

import math

import numpy as np
import pytest

from indent_sim.theory import half_space as hs

E_STAR = hs.E_star(1.0, 0.3)


def disc_integral(pressure, a):
    """2 pi ∫_0^a p r dr, the nodes crowded towards both ends because p may be singular there."""
    u, w = np.polynomial.legendre.leggauss(200)
    u, w = 0.5 * (1.0 + u), 0.5 * w
    t = u**2 * (3.0 - 2.0 * u)
    return 2.0 * math.pi * np.sum(w * 6.0 * u * (1.0 - u) * a * pressure(a * t) * a * t)


def test_reference_numbers():
    # Hertz 1882, Sneddon 1965: R = 1, delta = 0.01, E = 1, nu = 0.3
    assert hs.paraboloid_force(0.01, 1.0, E_STAR) == pytest.approx(1.465201465201e-3, rel=1e-12)
    assert hs.paraboloid_contact_radius(0.01, 1.0) == pytest.approx(0.1, rel=1e-14)
    assert hs.paraboloid_peak_pressure(0.01, 1.0, E_STAR) == pytest.approx(6.99582167e-2, rel=1e-8)
    assert hs.sphere_force(0.01, 1.0, E_STAR) == pytest.approx(1.463736090376e-3, rel=1e-12)
    assert hs.sphere_contact_radius(0.01, 1.0) == pytest.approx(9.983330577456e-2, rel=1e-12)
    # C = 0.73762(2), angle between axis and face
    assert hs.square_pyramid_force(1.0, 45.0, 1.0) == pytest.approx(0.73762, abs=2e-5)


@pytest.mark.parametrize("depth", [1e-12, 1e-8, 1e-4, 0.01, 0.3, 1.0, 10.0, 1e3])
def test_sphere_obeys_its_equations_at_any_depth(depth):
    R = 2.0
    a = hs.sphere_contact_radius(depth * R, R)
    assert 0.0 < a <= R
    if depth < 5.0:  # beyond, a = R to rounding
        assert a * math.atanh(a / R) == pytest.approx(depth * R, rel=1e-11)
    step = 1e-5 * depth
    rise = hs.sphere_force((depth + step) * R, R, 1.0) - hs.sphere_force((depth - step) * R, R, 1.0)
    assert rise / (2 * step * R) == pytest.approx(2.0 * a, rel=1e-8)  # that of a punch of radius a


def test_sphere_tends_to_the_paraboloid():
    def ratio(delta):
        return hs.sphere_force(delta, 1.0, 1.0) / hs.paraboloid_force(delta, 1.0, 1.0)

    assert ratio(1e-10) == pytest.approx(1.0, rel=1e-10)
    assert ratio(0.01) == pytest.approx(1.0 - 0.001, abs=1e-5)


@pytest.mark.parametrize(
    ("force", "pressure", "a"),
    [
        (
            hs.paraboloid_force(0.1, 2.0, 1.5),
            lambda r: hs.paraboloid_pressure(r, 0.1, 2.0, 1.5),
            hs.paraboloid_contact_radius(0.1, 2.0),
        ),
        (
            hs.sphere_force(0.6, 2.0, 1.5),
            lambda r: hs.sphere_pressure(r, 0.6, 2.0, 1.5),
            hs.sphere_contact_radius(0.6, 2.0),
        ),
        (
            hs.sphere_force(4.0, 2.0, 1.5),
            lambda r: hs.sphere_pressure(r, 4.0, 2.0, 1.5),
            hs.sphere_contact_radius(4.0, 2.0),
        ),
        (
            hs.cone_force(0.1, 60.0, 1.5),
            lambda r: hs.cone_pressure(r, 0.1, 60.0, 1.5),
            hs.cone_contact_radius(0.1, 60.0),
        ),
        (hs.flat_punch_force(0.1, 0.5, 1.5), lambda r: hs.flat_punch_pressure(r, 0.1, 0.5, 1.5), 0.5),
    ],
)
def test_pressure_integrates_to_the_force(force, pressure, a):
    assert disc_integral(pressure, a) == pytest.approx(force, rel=1e-6)
    assert pressure(1.01 * a) == 0.0
    assert np.all(pressure(np.linspace(0.01, 0.99, 7).reshape(7, 1) * a) > 0.0)
    assert pressure(np.zeros((2, 3))).shape == (2, 3)


def test_singular_pressures():
    assert hs.cone_pressure(0.0, 0.1, 60.0, 1.0) == math.inf
    assert hs.flat_punch_pressure(0.5, 0.1, 0.5, 1.0) == math.inf


def test_line_contact():
    # Johnson 1985: a^2 = 4 F'R/(pi E*), p0 = 2F'/(pi a)
    a = hs.line_contact_half_width(2e-3, 1.5, E_STAR)
    assert a**2 == pytest.approx(4.0 * 2e-3 * 1.5 / (math.pi * E_STAR), rel=1e-14)
    assert hs.line_contact_force(a, 1.5, E_STAR) == pytest.approx(2e-3, rel=1e-14)
    p0 = pytest.approx(2.0 * 2e-3 / (math.pi * a), rel=1e-14)
    assert hs.line_contact_peak_pressure(2e-3, 1.5, E_STAR) == p0
    assert hs.line_contact_pressure(0.0, 2e-3, 1.5, E_STAR) == p0
    x = a * np.cos((np.arange(400) + 0.5) * math.pi / 400)  # Gauss-Chebyshev
    p = hs.line_contact_pressure(x, 2e-3, 1.5, E_STAR)
    assert np.sum(p * np.sqrt(a**2 - x**2)) * math.pi / 400 == pytest.approx(2e-3, rel=1e-12)


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
        hs.line_contact_half_width(-1.0, 1.0, 1.0),
    ):
        assert force == 0.0
    for pressure in (hs.paraboloid_pressure, hs.sphere_pressure, hs.flat_punch_pressure):
        assert np.all(pressure(np.linspace(0.0, 2.0, 5), -0.1, 1.0, 1.0) == 0.0)
    assert np.all(hs.cone_pressure(np.linspace(0.0, 2.0, 5), 0.0, 45.0, 1.0) == 0.0)


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
