"""Onset of yield below a sphere, and the contact of cones, against published values."""

from __future__ import annotations

from math import pi, radians, tan

import numpy as np
import pytest

from indent_sim.theory.yielding import YieldingSolid, onset_pressure, sphere_onset

ANGLE = 70.3
SLOPE = 1 / tan(radians(ANGLE))


def solid(E: float, n: float = 0.0, nu: float = 0.3) -> YieldingSolid:
    """Power-law hardening from the yield stress 1."""
    return YieldingSolid(
        E, nu, lambda a: (1 + E * a) ** n, lambda a: n * E * (1 + E * a) ** (n - 1)
    )


# Published runs of finite elements, nu = 0.3: Lu et al. (2020), PNAS 117, 7052, FEM_70deg.csv.
# E/sigma_y, n, F/(sigma_y delta^2), S/(E* delta)
PUBLISHED = [
    (33.3, 0.0, 41.95, 5.135),
    (100.0, 0.0, 70.00, 6.258),
    (333.0, 0.0, 91.04, 7.156),
    (700.0, 0.0, 97.45, 7.298),
    (100.0, 0.1, 76.48, 5.832),
    (100.0, 0.3, 92.30, 5.146),
    (100.0, 0.5, 110.6, 4.801),
]


@pytest.mark.parametrize(
    ("nu", "ratio"), [(0.2, 1.4986), (0.3, 1.6128), (0.4, 1.7385), (0.45, 1.8061), (0.5, 1.8772)]
)
def test_onset_below_a_sphere(nu: float, ratio: float) -> None:
    """Values of an independent maximisation, to their five digits."""
    assert onset_pressure(nu) == pytest.approx(ratio, abs=6e-5)


def test_onset_contact() -> None:
    """Depth 6.41799 R (sigma_y/E*)^2, a 2.53337 R sigma_y/E*, F 21.6789 R^2 sigma_y^3/E*^2."""
    onset = sphere_onset(2.0, 50.0, 0.3, 0.5)
    strain = 0.5 / 50.0
    assert onset.delta == pytest.approx(6.41799 * 2.0 * strain**2, rel=1e-5)
    assert onset.a == pytest.approx(2.53337 * 2.0 * strain, rel=1e-5)
    assert onset.force == pytest.approx(21.6789 * 4.0 * 0.5 * strain**2, rel=1e-5)


@pytest.mark.parametrize("nu", [-0.9, -0.5, 0.0])
def test_onset_at_small_nu_is_the_largest_stress_anywhere(nu: float) -> None:
    """The von Mises stress of Hertz's contact on a grid of points, by superposed point forces.

    The axis and the edge are the candidates of `onset_pressure`; no point of the grid is above.
    """
    largest = 1 / onset_pressure(nu)
    rng = np.random.default_rng(0)
    # Sources: pressure p0 sqrt(1 - r^2) by a product rule
    nodes, weights = np.polynomial.legendre.leggauss(60)
    radius = np.sin(0.25 * pi * (nodes + 1))
    w_r = 0.25 * pi * weights * np.cos(0.25 * pi * (nodes + 1)) ** 2 * radius
    angles = 2 * pi * (np.arange(90) + 0.5) / 90
    sx = np.outer(radius, np.cos(angles)).ravel()
    sy = np.outer(radius, np.sin(angles)).ravel()
    force = np.outer(w_r, np.full(90, 2 * pi / 90)).ravel()
    for x, z in zip(rng.uniform(0, 1.2, 40), rng.uniform(0.15, 1.0, 40), strict=True):
        dx = x - sx
        dy = -sy
        stress = _boussinesq(dx, dy, z, nu) @ force
        xx, yy, zz, xz = stress
        mises = np.sqrt(((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 2 + 3 * xz**2)
        assert mises <= largest * (1 + 1e-3)


def _boussinesq(x: np.ndarray, y: np.ndarray, z: float, nu: float) -> np.ndarray:
    """Stresses xx, yy, zz, xz (4, n) of unit normal forces on a half-space (Johnson 3.18)."""
    rho2 = x * x + y * y + z * z
    rho = np.sqrt(rho2)
    r2 = x * x + y * y
    part = 1 - 2 * nu
    common = part / r2 * ((1 - z / rho) * (x * x - y * y) / r2 + z * y * y / rho**3)
    xx = common - 3 * z * x * x / rho**5
    other = part / r2 * ((1 - z / rho) * (y * y - x * x) / r2 + z * x * x / rho**3)
    yy = other - 3 * z * y * y / rho**5
    return np.array([xx, yy, -3 * z**3 / rho**5, -3 * x * z * z / rho**5]) / (2 * pi)


@pytest.mark.parametrize(("E", "n", "curvature", "stiffness"), PUBLISHED)
def test_functions_of_dao(E: float, n: float, curvature: float, stiffness: float) -> None:
    """They are fits to these runs, within 3 %."""
    body = solid(E, n)
    assert not body.dao_obstacle(ANGLE)
    assert body.dao_curvature() == pytest.approx(curvature, rel=0.03)
    assert body.dao_stiffness(n) / body.E_star == pytest.approx(stiffness, rel=0.03)


def test_where_the_functions_of_dao_do_not_hold() -> None:
    assert "half-angle" in solid(100.0).dao_obstacle(60.0)
    assert "nu" in solid(100.0, nu=0.45).dao_obstacle(ANGLE)
    assert "sigma_0.033" in solid(5.0).dao_obstacle(ANGLE)


@pytest.mark.parametrize(("E", "n", "curvature", "stiffness"), PUBLISHED)
def test_expected_force_of_a_cone(E: float, n: float, curvature: float, stiffness: float) -> None:
    """Within 15 %: the estimate of radius and pressure is made for sizes, not for results."""
    body = solid(E, n)
    radius = body.contact_height(SLOPE, is_round=False) / SLOPE
    assert body.mean_pressure(SLOPE) * pi * radius**2 == pytest.approx(curvature, rel=0.15)


def test_an_elastic_body_has_the_elastic_contact() -> None:
    """Sneddon's cone and Hertz's paraboloid, far below yield."""
    body = solid(3.0)
    assert body.contact_height(SLOPE, is_round=False) == pytest.approx(2 / pi)
    assert body.contact_height(SLOPE, is_round=True) == 0.5
