"""Noise against dense covariance matrices and its own random samples."""

from __future__ import annotations

import numpy as np
import pytest
from measurements import NOISES, drawn
from scipy.linalg import toeplitz

from indent_sim.fitting.inference.noise import (
    WHITE,
    Noise,
    average_over_noise,
    f_test,
    f_test_extra_columns,
    noise_grid,
    noise_models,
    solve_normal_equations,
)


def dense(noise: Noise, n: int) -> np.ndarray:
    """Covariance V, shape (n, n)."""
    return noise.w * np.eye(n) + (1 - noise.w) * toeplitz(noise.rho ** np.arange(n))


@pytest.mark.parametrize("noise", [WHITE, Noise(1, 0.0003), Noise(8, 0.5), Noise(64, 0.05)])
def test_covariance_is_that_of_the_dense_matrix(noise):
    V, X = dense(noise, 50), np.random.default_rng(0).standard_normal((50, 3))
    np.testing.assert_allclose(noise.apply_covariance(X), V @ X, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n", [30, 300, 601])
def test_gram_matrices_are_those_of_the_dense_inverse(n):
    """X'V^-1 X and ln|V| of all noises of the grid, by the cosine transform and by solving."""
    columns = np.random.default_rng(n).standard_normal((3, n))
    models = noise_models(n, noise_grid(n))
    gram = models.gram(columns)
    for k, noise in enumerate(models.noises):
        V = dense(noise, n)
        # The condition of V is at most 1e5, of 16 digits.
        exact = columns @ np.linalg.solve(V, columns.T)
        np.testing.assert_allclose(gram[k], exact, rtol=1e-9, atol=1e-10 * np.abs(exact).max())
        assert models.log_determinant[k] == pytest.approx(
            np.linalg.slogdet(V)[1], rel=1e-9, abs=1e-9
        )


def test_normal_equations_of_a_batch_are_those_of_least_squares():
    """Parameters, covariance, remaining squares and ln|A| of several matrices at once."""
    draw = np.random.default_rng(8)
    J = draw.standard_normal((5, 40, 3))
    r = draw.standard_normal((5, 40, 1))
    X = np.concatenate([J, r], axis=2)
    found = solve_normal_equations(np.swapaxes(X, 1, 2) @ X)
    for k in range(5):
        step, squares, *_ = np.linalg.lstsq(J[k], r[k, :, 0], rcond=None)
        A = J[k].T @ J[k]
        # Condition numbers of random columns are below 10.
        np.testing.assert_allclose(found.step[k], step, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(found.covariance[k], np.linalg.inv(A), rtol=1e-10, atol=1e-12)
        assert found.residual_squares[k] == pytest.approx(squares[0], rel=1e-10)
        assert found.log_determinant[k] == pytest.approx(np.linalg.slogdet(A)[1], rel=1e-10)


def test_samples_that_count_as_one():
    """The variance of a mean follows from the integrated correlation time.

    Reference: the sum of the dense V; its ends contribute tau/n.
    """
    noise, n = Noise(8, 0.3), 4000
    assert (
        abs(dense(noise, n).sum() / n / noise.integrated_correlation_time - 1) < 0.005
    )  # ends: tau/n


def test_white_noise_gives_the_textbook_covariance():
    J = np.column_stack([np.ones(200), np.linspace(-1, 1, 200)])
    r = drawn(WHITE, 200, np.random.default_rng(3))
    found = average_over_noise(J, r, [WHITE])
    left = r - J @ np.linalg.lstsq(J, r, rcond=None)[0]
    np.testing.assert_allclose(
        found.covariance, left @ left / 198 * np.linalg.inv(J.T @ J), rtol=1e-9, atol=1e-15
    )
    np.testing.assert_allclose(found.step, np.linalg.lstsq(J, r, rcond=None)[0], rtol=1e-9)


@pytest.mark.parametrize("name", NOISES)
def test_intervals_of_a_line_hold_its_slope(name):
    """At least 86 of 100 intervals of 95 % contain the slope of a line.

    Fewer happen once in 4000 by chance. Unknown noise widens the intervals by up to a third.
    """
    n, noise, draw = 300, NOISES[name], np.random.default_rng(4)
    J = np.column_stack([np.ones(n), np.linspace(-1, 1, n)])
    found = [average_over_noise(J, drawn(noise, n, draw)) for _ in range(100)]
    inside = sum(abs(one.step[1]) < 1.96 * one.sd[1] for one in found)
    V = dense(noise, n)
    true = np.sqrt(np.linalg.inv(J.T @ np.linalg.solve(V, J))[1, 1])
    assert inside >= 86 and np.median([one.sd[1] for one in found]) < 1.35 * true


def test_the_likeliest_noise_of_a_long_record_is_its_own():
    J, draw = np.ones((3000, 1)), np.random.default_rng(5)
    found = average_over_noise(J, drawn(Noise(16, 0.5), 3000, draw)).likeliest_noise
    assert found.tau in (8, 16, 32) and found.w in (0.25, 0.5, 0.8)  # beside it on the grid
    assert average_over_noise(J, drawn(WHITE, 3000, draw)).likeliest_noise == WHITE


def test_the_grid_ends_at_a_quarter_of_the_record():
    assert (
        noise_grid(3) == (WHITE,)
        and max(noise.tau for noise in noise_grid(1200)) == 256
        and len(noise_grid(1200)) == 55
    )


def test_gains_by_accident_are_uniform():
    """The p-value of columns without information is uniform; that of a real column is tiny.

    Of 200 draws 5 to 38 lie below 0.1, in all but one case of 10^4.
    """
    draw, x = np.random.default_rng(6), np.linspace(-1, 1, 80)
    J, extra = np.column_stack([np.ones(80), x]), np.column_stack([x**2, x**3])
    p = [f_test_extra_columns(J, extra, draw.standard_normal(80), WHITE) for _ in range(200)]
    assert 5 <= sum(one < 0.1 for one in p) <= 38
    assert f_test_extra_columns(J, extra, draw.standard_normal(80) + 3 * x**2, WHITE) < 1e-6
    assert f_test(1.0, 2, 0.0, 5) == 1.0 and f_test(1.0, 2, 1.0, 0) == 1.0
