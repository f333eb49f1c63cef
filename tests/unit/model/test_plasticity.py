"""Hardening laws, the increment of plastic strain, and logarithmic strains without eigenvalues."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from indent_sim.model.logarithmic_strain import deviator_square, square_of_unimodular
from indent_sim.model.plasticity import MIN_CREEP_STRAIN, Creep, Plasticity, Voce

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
        d = float(law.flow_increment(np.float64(q), alpha, mu, E).strain)
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
    assert not law.flow_increment(q, 0.1, 4.0, 10.0).strain.any()


@each_law
@pytest.mark.parametrize("m", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("dt", [0.0, 1e-3, 1.0, 1e9])
def test_creep_is_the_root_of_the_return(law: Plasticity, m: float, dt: float) -> None:
    """Against scipy's brentq with the overstress as the unknown; 1e-12 of q is round-off."""
    law = replace(law, creep=Creep(1e-3, m))
    for E in (10.0, 1e4):
        mu = E / 2.6
        for alpha in (0.0, 1e-4, 1.0):
            for excess in (1e-8, 1e-3, 0.1, 1.0, 30.0):
                yield_stress = float(law.flow_stress(alpha, E))
                q = yield_stress * (1 + excess)
                flow = law.flow_increment(np.float64(q), alpha, mu, E, np.float64(dt))
                creep_strain = max(1e-3 * dt, MIN_CREEP_STRAIN)

                def residual(s: float) -> float:
                    d = creep_strain * s ** (1 / m)  # noqa: B023
                    stress = float(law.flow_stress(alpha + d, E))  # noqa: B023
                    return 3 * mu * d + stress * (1 + s) - q  # noqa: B023

                s = brentq(residual, 0.0, excess * (1 + 1e-12), xtol=1e-300, rtol=1e-14)
                root = creep_strain * s ** (1 / m)
                assert 3 * mu * abs(flow.strain - root) <= 1e-12 * q
                work = float(law.flow_stress(alpha + root, E)) * s * root
                assert flow.viscous_work == pytest.approx(work, rel=1e-9, abs=1e-12 * q * root)


@each_law
@pytest.mark.parametrize("creep", [None, Creep(1e-3, 0.1), Creep(1e-3, 1.0)])
def test_compliance_is_the_derivative_of_the_increment(law: Plasticity, creep: Creep) -> None:
    """Against central differences, whose own error is 1e-6."""
    law = replace(law, creep=creep)
    E = 100.0
    mu = E / 2.6
    q = 1.5 * float(law.flow_stress(0.01, E))
    step = 1e-5 * q
    below, flow, above = (
        law.flow_increment(np.float64(q + dq), 0.01, mu, E, np.float64(1.0))
        for dq in (-step, 0.0, step)
    )
    assert flow.compliance == pytest.approx((above.strain - below.strain) / (2 * step), rel=1e-6)


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
