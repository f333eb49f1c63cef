"""Sobol indices against Ishigami's function and sums, whose indices are known."""

from __future__ import annotations

import numpy as np
import pytest
from surrogate_tables import hertz, study_with_table

from indent_sim.process.errors import UsageError
from indent_sim.studies.sobol_indices import indices_of_study, sobol_indices
from indent_sim.studies.surrogate_fit import fit_surrogate


def ishigami(points):
    """sin x + 7 sin^2 y + 0.1 z^4 sin x on [-pi, pi]^3."""
    x, y, z = np.pi * (2 * points.T - 1)
    return np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def test_ishigami():
    """The variances in closed form (Ishigami & Homma 1990), to 1 % of the variance.

    The stated errors cover the differences.
    """
    a, b = 7, 0.1
    alone = np.array([(1 + b * np.pi**4 / 5) ** 2 / 2, a**2 / 8, 0])
    together = 8 * b**2 * np.pi**8 / 225
    variance = alone.sum() + together
    total = alone + np.array([together, 0, together])
    indices = sobol_indices(ishigami, 3)
    assert np.abs(indices.first - alone / variance).max() < 0.01
    assert np.abs(indices.total - total / variance).max() < 0.01
    assert (np.abs(indices.first - alone / variance) <= indices.error).all()
    assert (np.abs(indices.total - total / variance) <= indices.error).all()
    assert indices.error.max() < 0.01


def test_a_sum_has_no_interactions():
    weights = np.array([3.0, 2.0, 1.0, 0.0])
    indices = sobol_indices(lambda points: 5 + points @ weights, 4)
    expected = weights**2 / (weights**2).sum()
    # The error of 2^16 points of a smooth function.
    assert np.allclose(indices.first, expected, atol=1e-3)
    assert np.allclose(indices.total, expected, atol=1e-3)


def test_a_constant_has_no_indices():
    assert not sobol_indices(lambda points: np.ones(len(points)), 2).total.any()


def test_hertz_through_a_surrogate(tmp_path):
    """A product of functions of one key each: 1 + S_total ratios follow from the variances.

    For f = prod f_i the first index of i is v_i / (prod (1 + v) - 1), the total one
    v_i/(1 + v_i) prod (1 + v) / (prod (1 + v) - 1), with v_i the squared coefficient of variation
    of f_i, which numerical quadrature gives.
    """
    study = study_with_table(tmp_path, hertz)
    surrogate = fit_surrogate(study, tmp_path, "force")
    found = indices_of_study(study, surrogate)
    u = (np.arange(20000) + 0.5) / 20000
    factors = {
        "material.E": 1000**u,
        "material.nu": 1 / (1 - (0.1 + 0.4 * u) ** 2),
        "indenter.R": (0.5 * 10**u) ** 0.5,
        "loading.delta": (0.01 + 0.04 * u) ** 1.5,
    }
    v = {key: values.var() / values.mean() ** 2 for key, values in factors.items()}
    product = np.prod([1 + value for value in v.values()])
    for key, value in v.items():
        first = value / (product - 1)
        total = value / (1 + value) * product / (product - 1)
        assert found[key]["first"] == pytest.approx(first, abs=found[key]["error"])
        assert found[key]["total"] == pytest.approx(total, abs=found[key]["error"])
        assert found[key]["error"] < 0.02


def test_dependent_keys_are_refused(tmp_path):
    study = study_with_table(tmp_path, hertz, where="loading.delta < indenter.R / 30")
    surrogate = fit_surrogate(study, tmp_path, "force")
    with pytest.raises(UsageError, match="leaves points out"):
        indices_of_study(study, surrogate)
