"""Noise of a measurement: a sum of white and first-order autoregressive noise.

    V = w I + (1 - w) R,   R_ij = rho^|i - j|,   tau = -1/ln rho [samples]

With T = R^-1, tridiagonal, V^-1 X = T (w T + (1 - w) I)^-1 X costs O(n). For a linear model r = J p
+ noise

    A = J'V^-1 J,   s^2 = r'P r/(n - p),   -2 ln L = ln|V| + ln|A| + (n - p) ln s^2

The mean and covariance of p are averaged over a grid of (tau, w) with the restricted likelihood L
as the weight. The maximum of L alone gives intervals that are too narrow, since a correlation is
never known well. Sources: Patterson & Thompson (1971), Biometrika 58, 545; Kenward & Roger (1997),
Biometrics 53, 983.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.signal import lfilter

NORMAL_95 = 1.96


@dataclass(frozen=True)
class Noise:
    """Covariance V of noise, up to a factor.

    Attributes
    ----------
    tau : float
        Correlation time [samples]; 0 for white noise.
    w : float
        Fraction of the variance that is white.
    """

    tau: float = 0.0
    w: float = 1.0

    @property
    def rho(self) -> float:
        """Correlation of neighbouring samples of the autoregressive part."""
        return math.exp(-1.0 / self.tau) if self.tau else 0.0

    def _inverse_correlation(self, n: int) -> np.ndarray:
        """Return the tridiagonal inverse T of the correlation matrix of the autoregressive part.

        The rows of the result (2, n) are the upper diagonal and the diagonal.
        """
        rho = self.rho
        band = np.empty((2, n))
        band[0] = -rho
        band[1] = 1.0 + rho * rho
        band[1, 0] = band[1, -1] = 1.0
        return band / (1.0 - rho * rho)

    def apply_inverse_covariance(self, X: np.ndarray) -> tuple[np.ndarray, float]:
        """Return V^-1 X for columns X (n, m) or one column X (n,), and ln|V|."""
        n = len(X)
        if not self.tau or n < 2:
            return X, 0.0
        T = self._inverse_correlation(n)
        mixed = self.w * T
        mixed[1] += 1.0 - self.w
        factor = cholesky_banded(mixed)
        Y = cho_solve_banded((factor, False), X)
        off_diagonal = T[0, 1:]
        diagonal = T[1]
        rows = (slice(None), None) if X.ndim == 2 else (slice(None),)
        Z = diagonal[rows] * Y
        Z[:-1] += off_diagonal[rows] * Y[1:]
        Z[1:] += off_diagonal[rows] * Y[:-1]
        log_T = -(n - 1) * math.log1p(-(self.rho**2))
        return Z, 2.0 * float(np.log(factor[1]).sum()) - log_T

    def apply_covariance(self, X: np.ndarray) -> np.ndarray:
        """Return V X of columns (n, m)."""
        if not self.tau:
            return X
        rho = self.rho
        forward = lfilter([1.0], [1.0, -rho], X, axis=0)
        backward = lfilter([1.0], [1.0, -rho], X[::-1], axis=0)[::-1]
        return self.w * X + (1.0 - self.w) * (forward + backward - X)

    @property
    def integrated_correlation_time(self) -> float:
        """Number of samples per independent sample: w + (1 - w) (1 + rho)/(1 - rho)."""
        return self.w + (1.0 - self.w) * (1.0 + self.rho) / (1.0 - self.rho)


WHITE = Noise()


@dataclass(frozen=True)
class ParameterUncertainty:
    """Uncertainty of the parameters of a linear model.

    Attributes
    ----------
    likeliest_noise : Noise
        Noise with the largest likelihood.
    s2 : float
        Variance of this noise.
    covariance : ndarray, shape (p, p)
        Covariance of the parameters, averaged over all noise models.
    step : ndarray, shape (p,)
        Mean of the parameters, relative to the point of linearisation.
    """

    likeliest_noise: Noise
    s2: float
    covariance: np.ndarray
    step: np.ndarray

    @cached_property
    def sd(self) -> np.ndarray:
        """Standard deviations of the parameters (p,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def noise_grid(n: int) -> list[Noise]:
    """Return white noise, and noise models whose correlation time n samples can resolve."""
    # Longest correlation time that is considered, relative to the number of samples.
    max_tau_fraction = 0.25
    taus = [2.0**k for k in range(30) if 2.0**k <= max_tau_fraction * n]
    white_fractions = (0.0003, 0.05, 0.25, 0.5, 0.8, 0.95)
    return [WHITE, *(Noise(tau, w) for tau in taus for w in white_fractions)]


def average_over_noise(
    J: np.ndarray, r: np.ndarray, noises: list[Noise] | None = None
) -> ParameterUncertainty:
    """Average the parameters of r = J p + noise over noise models, weighted by likelihood.

    Parameters
    ----------
    J : ndarray, shape (n, p)
        Jacobian; a parameter with a column of zeros has an infinite variance.
    r : ndarray, shape (n,)
        Residuals.
    noises : list of Noise, optional
        Noise models to average over; by default the result of `noise_grid`.

    Returns
    -------
    ParameterUncertainty
        Mean, covariance and likeliest noise.
    """
    n, p = J.shape
    scale = np.sqrt((J * J).sum(axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    X = np.column_stack([J / scale, r])
    noises = noise_grid(n) if noises is None else noises
    results = [_restricted_likelihood(noise, X, n - p) for noise in noises]
    log_likelihoods = np.array([result[0] for result in results])
    # Weight of white noise, in nodes of the grid.
    white_weight = 54
    log_likelihoods[0] += math.log(white_weight if len(noises) > 1 else 1)
    weights = np.exp(log_likelihoods - log_likelihoods.max())
    weights /= weights.sum()
    steps = np.array([result[2] for result in results])
    mean = weights @ steps
    covariance = np.zeros((p, p))
    # Nodes with a smaller weight than this fraction of the largest one are omitted.
    min_weight = 1e-9
    for weight, (_, cov, step, _) in zip(weights, results, strict=True):
        if weight > min_weight:
            covariance += weight * (cov + np.outer(step - mean, step - mean))
    best = int(np.argmax(weights))
    return ParameterUncertainty(
        noises[best], results[best][3], covariance / np.outer(scale, scale), mean / scale
    )


def _restricted_likelihood(
    noise: Noise, X: np.ndarray, degrees_of_freedom: int
) -> tuple[float, np.ndarray, np.ndarray, float]:
    """Return ln L, parameter covariance, parameter step and s2 for a given noise."""
    VX, log_V = noise.apply_inverse_covariance(X)
    M = X.T @ VX
    A = M[:-1, :-1]
    b = M[:-1, -1]
    c = float(M[-1, -1])
    cov, log_A = symmetric_inverse(A)
    step = cov @ b
    s2 = max((c - float(b @ step)) / max(degrees_of_freedom, 1), 1e-300)
    return -0.5 * (log_V + log_A + degrees_of_freedom * math.log(s2)), s2 * cov, step, s2


def symmetric_inverse(A: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the inverse and ln|A| of a symmetric matrix, with its eigenvalues kept above 0."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    values = np.maximum(values, 1e-14 * max(values[-1], 1e-300))
    return (vectors / values) @ vectors.T, float(np.log(values).sum())


def f_test_extra_columns(J: np.ndarray, extra: np.ndarray, r: np.ndarray, noise: Noise) -> float:
    """Return the probability of an F test of additional columns.

    Parameters
    ----------
    J : ndarray, shape (n, p)
        Columns of the model.
    extra : ndarray, shape (n, m)
        Additional columns.
    r : ndarray, shape (n,)
        Residuals.
    noise : Noise
        Covariance of the residuals, up to a factor.

    Returns
    -------
    float
        Probability that the additional columns would reduce the sum of squares at least as much by
        chance.
    """
    X = np.column_stack([J, extra, r])
    p = J.shape[1]
    m = extra.shape[1]
    squares_without, squares_with = (
        _residual_squares(X[:, [*range(k), -1]], noise) for k in (p, p + m)
    )
    return f_test(max(squares_without - squares_with, 0.0), m, squares_with, len(r) - p - m)


def _residual_squares(X: np.ndarray, noise: Noise) -> float:
    """Return the residual sum of squares of a fit of the last column by the other columns."""
    scale = np.sqrt((X[:, :-1] ** 2).sum(axis=0))
    X = np.column_stack([X[:, :-1] / np.where(scale > 0, scale, 1.0), X[:, -1]])
    M = X.T @ noise.apply_inverse_covariance(X)[0]
    cov, _ = symmetric_inverse(M[:-1, :-1])
    return float(M[-1, -1] - M[:-1, -1] @ cov @ M[:-1, -1])


def f_test(
    explained_squares: float, m: int, residual_squares: float, degrees_of_freedom: int
) -> float:
    """Return the probability of at least F = (explained/m)/(residual/degrees of freedom)."""
    from scipy.special import fdtrc

    if degrees_of_freedom < 1 or residual_squares <= 0:
        return 1.0
    return float(
        fdtrc(
            m, degrees_of_freedom, explained_squares / m / (residual_squares / degrees_of_freedom)
        )
    )
