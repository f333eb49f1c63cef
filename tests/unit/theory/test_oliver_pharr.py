"""Formulas of Oliver and Pharr on exact elastic contacts, and the fit of the power law."""

from __future__ import annotations

from math import pi, sqrt, tan

import numpy as np
import pytest
from scipy.optimize import curve_fit

from indent_sim.theory.half_space import cone_force, flat_punch_force, paraboloid_force
from indent_sim.theory.oliver_pharr import (
    contact_depth,
    epsilon_of_exponent,
    fit_unloading,
    indentation_modulus,
    reduced_modulus,
)

E_STAR = 2.5
DEPTH = 0.3


def unloaded(force, m: float) -> tuple[float, float, float, float]:
    """Fit the upper part of an elastic unloading curve; return F, S, m and epsilon of m."""
    h = np.linspace(DEPTH, 0.6 * DEPTH, 20)
    fit = fit_unloading(h, np.array([force(float(depth)) for depth in h]), DEPTH)
    assert fit.exponent == pytest.approx(m, rel=1e-8)
    assert abs(fit.h_f) < 1e-8 * DEPTH  # an elastic contact leaves no depth
    return fit.force, fit.stiffness, fit.exponent, epsilon_of_exponent(fit.exponent)


def test_a_cone_unloads_with_m_2_and_gives_its_modulus_back() -> None:
    """Sneddon: F ~ h^2, S = 2 F/h, a = 2/pi h tan(alpha), and E_r is E* exactly.

    The tolerance is the round-off of the fit. epsilon is 2 (pi - 2)/pi, as Oliver and Pharr found.
    """
    alpha = 70.3
    F, S, _, epsilon = unloaded(lambda h: cone_force(h, alpha, E_STAR), 2.0)
    assert epsilon == pytest.approx(2 * (pi - 2) / pi, rel=1e-8)
    h_c = contact_depth(DEPTH, F, S, epsilon)
    assert h_c == pytest.approx(2 / pi * DEPTH, rel=1e-7)
    area = pi * (h_c * tan(np.radians(alpha))) ** 2
    assert reduced_modulus(S, area, 1.0) == pytest.approx(E_STAR, rel=1e-7)


def test_a_paraboloid_unloads_with_m_1_5_and_gives_its_modulus_back() -> None:
    """Hertz: F ~ h^1.5, the contact depth is h/2, and epsilon is 0.75."""
    R = 4.0
    F, S, _, epsilon = unloaded(lambda h: paraboloid_force(h, R, E_STAR), 1.5)
    assert epsilon == pytest.approx(0.75, rel=1e-8)
    h_c = contact_depth(DEPTH, F, S, epsilon)
    assert h_c == pytest.approx(DEPTH / 2, rel=1e-7)
    assert reduced_modulus(S, 2 * pi * R * h_c, 1.0) == pytest.approx(E_STAR, rel=1e-7)


def test_a_flat_punch_unloads_with_m_1() -> None:
    F, S, _, epsilon = unloaded(lambda h: flat_punch_force(h, 2.0, E_STAR), 1.0)
    assert epsilon == pytest.approx(1.0, abs=1e-6)
    assert contact_depth(DEPTH, F, S, epsilon) == pytest.approx(0.0, abs=1e-6 * DEPTH)
    assert reduced_modulus(S, 4 * pi, 1.0) == pytest.approx(E_STAR, rel=1e-8)


def test_moduli_of_sample_and_tip_are_springs_in_series() -> None:
    """Half of the compliance belongs to a tip of the sample's own modulus."""
    assert indentation_modulus(0.5 * 10 / (1 - 0.09), 0.3, 10 / (1 - 0.09)) == pytest.approx(10)
    assert indentation_modulus(8.0, 0.0) == 8.0
    with pytest.raises(ValueError, match="not below the plane-strain modulus"):
        indentation_modulus(10.0, 0.3, 9.0)


@pytest.mark.parametrize("m", [1.0, 1.27, 2.0, 2.4])
@pytest.mark.parametrize("h_f", [0.0, 0.5, 0.9])
def test_the_fit_finds_any_power_law(m: float, h_f: float) -> None:
    """A power law is found to round-off, whatever the units and the permanent depth."""
    h = 1e-7 * np.linspace(0.995, h_f + 0.5 * (1 - h_f), 30)
    F = 3e9 * ((h / 1e-7 - h_f) / (1 - h_f)) ** m
    fit = fit_unloading(h, F, 1e-7)
    assert fit.exponent == pytest.approx(m, rel=1e-6)
    assert fit.force == pytest.approx(3e9, rel=1e-6)
    assert fit.stiffness == pytest.approx(3e9 * m / (1e-7 * (1 - h_f)), rel=1e-6)
    assert fit.h_f == pytest.approx(1e-7 * h_f, abs=1e-13)
    assert fit.B * (1e-7 * (1 - h_f)) ** m == pytest.approx(3e9, rel=1e-6)
    assert fit.work_below(3e9) == pytest.approx(3e9 * 1e-7 * (1 - h_f) / (m + 1), rel=1e-5)


@pytest.mark.parametrize(
    ("F_noise", "h_noise", "correlation"),
    [(3e-3, 0, 0), (0, 2e-4, 0), (3e-3, 2e-4, 0), (3e-3, 0, 0.8)],
)
def test_the_intervals_of_the_fit_hold(F_noise: float, h_noise: float, correlation: float) -> None:
    """95 % intervals of S and m contain the true values as often as that, and S has no bias.

    The curve is steep, as that of a metal: with scatter of the depth alone, plain least squares in
    the force would give a smaller S. Of 80 draws 95 % have a standard deviation of 2.4 %: 87 % is
    more than three of them below. Correlated noise leaves fewer independent samples, and the
    estimate of the correlation from so few is too small: 75 % is what remains.
    """
    draw = np.random.default_rng(3)
    h = np.linspace(1.0, 0.95, 150)
    h_f, m = 0.93, 1.4
    S = m / (1 - h_f)
    F = ((h - h_f) / (1 - h_f)) ** m
    inside, ratios = [], []
    for _ in range(80):
        white = draw.standard_normal((2, len(h)))
        for k in range(1, len(h)):
            white[:, k] = correlation * white[:, k - 1] + sqrt(1 - correlation**2) * white[:, k]
        fit = fit_unloading(h + h_noise * white[0], F + F_noise * white[1], 1.0, F_noise, h_noise)
        deviations = fit.coverage_factor * np.sqrt(np.diag(fit.covariance))
        inside.append(
            [abs(fit.stiffness - S) < deviations[1], abs(fit.exponent - m) < deviations[2]]
        )
        ratios.append(fit.stiffness / S)
    assert np.mean(inside, axis=0).min() > (0.75 if correlation else 0.87)
    # Four standard deviations of the mean of 80 draws.
    assert abs(np.mean(ratios) - 1) < 4 * np.std(ratios) / sqrt(80)


@pytest.mark.parametrize("seed", range(4))
def test_noise_of_a_tenth_of_the_recovery(seed: int) -> None:
    """The stiffness of a steep curve with a noisy depth is that of the depth over the force.

    A metal that recovers by 10 nm was measured with a noise of 1 nm and of 0.2 % of the force: the
    least squares of the depths at given forces have no bias then. Least squares of the forces give
    half of the stiffness, and with the tangent as slope of the weights the fit has no end.
    """
    draw = np.random.default_rng(seed)
    force = np.linspace(0.98, 0.4, 700)
    exact = 100.0 + 10.0 * force ** (1 / 1.3)
    h = exact + draw.standard_normal(len(force))
    F = force + 2e-3 * draw.standard_normal(len(force))
    fit = fit_unloading(h, F, 110.0, 2e-3, 1.0)

    def depth(F: np.ndarray, h_f: float, recovery: float, m: float) -> np.ndarray:
        return h_f + recovery * F ** (1 / m)

    (h_f, recovery, m), _ = curve_fit(
        depth, F, h, p0=(100.0, 10.0, 1.3), bounds=(0.1, [150, 200, 19])
    )
    F_top = ((110.0 - h_f) / recovery) ** m
    assert fit.stiffness == pytest.approx(m * F_top / (110.0 - h_f), rel=5e-3)
    error = fit.coverage_factor * fit.covariance[1, 1] ** 0.5
    assert abs(fit.stiffness - 0.13) < 1.5 * error


def test_what_cannot_be_fitted_is_refused() -> None:
    h = np.linspace(1.0, 0.9, 20)
    with pytest.raises(ValueError, match="at least 5"):
        fit_unloading(h[:4], h[:4] ** 2, 1.0)
    with pytest.raises(ValueError, match="does not decrease"):
        fit_unloading(h, 2 - h, 1.0)
    with pytest.raises(ValueError, match="must be a finite number"):
        fit_unloading(np.ones(20), h, 1.0)
    with pytest.raises(ValueError, match="less than 1"):
        epsilon_of_exponent(0.9)
