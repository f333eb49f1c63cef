"""Hardening laws, the increment of plastic strain, and logarithmic strains without eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from indent_sim.model.logarithmic_strain import deviator_square, square_of_unimodular
from indent_sim.model.plasticity import Plasticity, Voce

LAWS = {
    "perfect": Plasticity(1.0),
    "linear": Plasticity(1.0, linear=10.0),
    "steep": Plasticity(1.0, n=0.9),
    "flat": Plasticity(1.0, n=0.05),
    "no exponent": Plasticity(1.0, n=0.0),
    "saturating": Plasticity(1.0, voce=Voce(rise=0.5, strain=0.05)),
    # rise/strain is Young's modulus at E = 10, the most that a config may give
    "steepest": Plasticity(1.0, voce=Voce(rise=100.0, strain=10.0)),
}
each_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())


@each_law
@pytest.mark.parametrize("E", [10.0, 1e4])
@pytest.mark.parametrize("alpha", [0.0, 1e-4, 1.0])
def test_the_increment_is_the_root_of_the_return(law: Plasticity, E: float, alpha: float) -> None:
    """Against scipy's brentq; 1e-14 of the trial stress is round-off."""
    mu = E / 2.6
    for excess in (1e-8, 1e-3, 1.0, 1e3):
        q = float(law.flow_stress(alpha, E)) * (1 + excess)
        d = float(law.strain_increment(np.float64(q), alpha, mu, E))
        root = brentq(
            lambda d: q - 3 * mu * d - float(law.flow_stress(alpha + d, E)),  # noqa: B023
            0.0,
            q / (3 * mu),
            xtol=1e-300,
            rtol=1e-14,
        )
        assert 3 * mu * abs(d - root) <= 2e-14 * q


@each_law
def test_below_the_yield_stress_nothing_flows(law: Plasticity) -> None:
    q = np.array([0.0, 0.5, float(law.flow_stress(0.1, 10.0))])
    assert not law.strain_increment(q, 0.1, 4.0, 10.0).any()


@each_law
def test_modulus_and_work_are_derivative_and_integral_of_the_stress(law: Plasticity) -> None:
    alpha = 0.03
    E = 100.0
    step = 1e-6
    difference = (law.flow_stress(alpha + step, E) - law.flow_stress(alpha - step, E)) / (2 * step)
    assert law.hardening_modulus(alpha, E) == pytest.approx(difference, rel=1e-7, abs=1e-9)
    work, _ = quad(lambda strain: float(law.flow_stress(strain, E)), 0.0, alpha, epsabs=1e-13)
    assert law.plastic_work(alpha, E) == pytest.approx(work, rel=1e-11)


@pytest.mark.parametrize("size", [1e-8, 1e-3, 0.1, 0.5, 2.0])
def test_the_deviator_of_logarithmic_strain(size: float) -> None:
    """Against the eigenvalues, with and without equal ones.

    The far branch keeps a root off zero by 1e-6 of a stretch, 1e-10 of the sum.
    """
    draw = np.random.default_rng(1)
    for kind in range(30):
        e = draw.uniform(-1, 1, 3)
        if kind % 3 == 1:
            e[1] = e[2]
        e *= size / np.abs(e).max()
        a = np.expm1(2 * e)
        deviator = a - a.mean()
        found = deviator_square(a.sum(), (deviator**2).sum() / 6, deviator.prod())
        expected = ((e - e.mean()) ** 2).sum()
        assert found == pytest.approx(expected, rel=2e-10, abs=1e-13 * size**2)


def test_both_branches_meet() -> None:
    """No jump at the limit of the series, for stretches whose product is one."""
    values = []
    for e in (0.1 - 1e-9, 0.1 + 1e-9):
        b = np.exp(2 * np.array([e, -e / 2, -e / 2]))
        deviator = b - b.mean()
        values.append(
            float(
                square_of_unimodular(b.mean() - 1, (deviator**2).sum() / 6, deviator.prod())
                / (1.5 * e * e)
            )
        )
    assert values == pytest.approx([1.0, 1.0], rel=2e-10)
