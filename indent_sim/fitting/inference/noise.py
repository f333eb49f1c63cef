"""Noise of a measurement: a sum of white and first-order autoregressive noise.

    V = w I + (1 - w) R,   R_ij = rho^|i - j|,   tau = -1/ln rho [samples]

The inverse T of R is tridiagonal, and the cosine transform (DCT-II) C diagonalizes it except at the
two ends of the curve, U = [e_1, e_n]:

    T = C diag(t) C' + k U U',   t_j = ((1 - rho)^2 + rho l_j)/(1 - rho^2),
    l_j = 2 - 2 cos(pi j/n),     k = rho/(1 + rho)
    D = C diag(d) C',            d = w t + 1 - w
    V^-1 = C diag(t/d) C' + (1 - w) k D^-1 U (I + w k U'D^-1 U)^-1 U'D^-1

so that one transform of the columns X gives X'V^-1 X for all noise models by a matrix product. For
a linear model r = J p + noise

    A = J'V^-1 J,   s^2 = r'P r/(n - p),   -2 ln L = ln|V| + ln|A| + (n - p) ln s^2

The mean and covariance of p are averaged over a grid of (tau, w) with the restricted likelihood L
as the weight. The maximum of L alone gives intervals that are too narrow, since a correlation is
never known well. Sources: Patterson & Thompson (1971), Biometrika 58, 545; Kenward & Roger (1997),
Biometrics 53, 983; Strang (1999), SIAM Review 41, 135 (cosine transforms).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.fft import dct
from scipy.linalg import solveh_banded

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

    def gram(self, X: np.ndarray) -> np.ndarray:
        """Return X'V^-1 X (..., c, c); the c columns of X are stored as rows (..., c, n)."""
        if not self.tau:
            return X @ np.swapaxes(X, -1, -2)  # type: ignore[no-any-return]
        return noise_models(X.shape[-1], (self,)).gram(X)[..., 0, :, :]

    def squares(self, r: np.ndarray) -> float:
        """Return the weighted sum of squares r'V^-1 r of residuals (n,)."""
        return float(self.gram(r[None])[0, 0])

    def apply_covariance(self, X: np.ndarray) -> np.ndarray:
        """Multiply columns (n, m) by the covariance of the noise."""
        if not self.tau:
            return X
        rho = self.rho
        inverse = np.empty((2, len(X)))
        inverse[0] = -rho
        inverse[1] = 1.0 + rho**2
        inverse[1, [0, -1]] = 1.0
        correlated = solveh_banded(inverse / (1.0 - rho**2), X)
        return self.w * X + (1.0 - self.w) * correlated

    @property
    def integrated_correlation_time(self) -> float:
        """Number of samples per independent sample: w + (1 - w) (1 + rho)/(1 - rho)."""
        return self.w + (1.0 - self.w) * (1.0 + self.rho) / (1.0 - self.rho)


WHITE = Noise()


@dataclass(frozen=True)
class NoiseModels:
    """Inverse covariances V^-1 of n samples for m noise models, in the cosine transform's basis.

    Attributes
    ----------
    noises : tuple of Noise
        The noise models (m,).
    weights : ndarray, shape (n, m)
        Diagonal t/d.
    edge_weights : ndarray, shape (n, m)
        Components of D^-1 U: the even ones belong to the sum of both ends of the curve over
        sqrt(2), the odd ones to their difference.
    edge_gains : ndarray, shape (2, m)
        (1 - w) k/(1 + w k u'D^-1 u) for the sum and the difference u of both ends.
    log_determinant : ndarray, shape (m,)
        ln|V|.
    """

    noises: tuple[Noise, ...]
    weights: np.ndarray
    edge_weights: np.ndarray
    edge_gains: np.ndarray
    log_determinant: np.ndarray

    def gram(self, X: np.ndarray) -> np.ndarray:
        """Return X'V^-1 X for each of the m noise models.

        Parameters
        ----------
        X : ndarray, shape (..., c, n)
            The c columns of X, n samples each (columns of a Jacobian or residuals), stored as rows.

        Returns
        -------
        ndarray, shape (..., m, c, c)
            Symmetric matrices.
        """
        count = X.shape[-2]
        H = dct(X, type=2, norm="ortho", axis=-1)
        first, second = np.triu_indices(count)
        products = (H[..., first, :] * H[..., second, :]) @ self.weights
        for parity, gain in enumerate(self.edge_gains):
            edges = H[..., parity::2] @ self.edge_weights[parity::2]
            products += gain * edges[..., first, :] * edges[..., second, :]
        matrices = np.empty((*X.shape[:-2], len(self.noises), count, count))
        matrices[..., first, second] = matrices[..., second, first] = np.swapaxes(products, -1, -2)
        return matrices


@lru_cache(maxsize=16)
def noise_models(n: int, noises: tuple[Noise, ...]) -> NoiseModels:
    """Return the inverse covariances of n samples."""
    rho = np.array([noise.rho for noise in noises])
    w = np.array([noise.w for noise in noises])
    angles = np.pi * np.arange(n)[:, None] / n
    laplacian = 2.0 - 2.0 * np.cos(angles)
    t = ((1.0 - rho) ** 2 + rho * laplacian) / (1.0 - rho**2)
    k = rho / (1.0 + rho)
    d = w * t + 1.0 - w
    # First row of C times sqrt(2): the components of (e_1 + e_n)/sqrt(2) for even j, and of
    # (e_1 - e_n)/sqrt(2) for odd j.
    edge = math.sqrt(2.0) * np.where(angles > 0, math.sqrt(2.0 / n), math.sqrt(1.0 / n))
    edge = edge * np.cos(0.5 * angles)
    edge_weights = edge / d
    reduced = np.array([(edge**2 / d)[parity::2].sum(axis=0) for parity in (0, 1)])
    corrections = 1.0 + w * k * reduced
    log_determinant = np.log(d).sum(axis=0) + np.log(corrections).sum(axis=0)
    log_determinant += (n - 1) * np.log1p(-(rho**2))
    return NoiseModels(noises, t / d, edge_weights, (1.0 - w) * k / corrections, log_determinant)


@dataclass(frozen=True)
class ParameterUncertainty:
    """Uncertainty of the parameters of a linear model.

    Attributes
    ----------
    likeliest_noise : Noise
        Noise with the largest likelihood.
    s2 : float
        Variance of the likeliest noise.
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


@lru_cache(maxsize=64)
def noise_grid(n: int) -> tuple[Noise, ...]:
    """Return white noise, and noise models whose correlation time n samples can resolve."""
    # Longest correlation time that is considered, relative to the number of samples.
    max_tau_fraction = 0.25
    taus = [2.0**k for k in range(30) if 2.0**k <= max_tau_fraction * n]
    white_fractions = (0.0003, 0.05, 0.25, 0.5, 0.8, 0.95)
    return (WHITE, *(Noise(tau, w) for tau in taus for w in white_fractions))


def average_over_noise(
    J: np.ndarray, r: np.ndarray, noises: Sequence[Noise] | None = None
) -> ParameterUncertainty:
    """Average the parameters of r = J p + noise over noise models, weighted by likelihood.

    Parameters
    ----------
    J : ndarray, shape (n, p)
        Jacobian; a parameter with a column of zeros has an infinite variance.
    r : ndarray, shape (n,)
        Residuals.
    noises : sequence of Noise, optional
        Noise models to average over; by default the result of `noise_grid`.

    Returns
    -------
    ParameterUncertainty
        Mean, covariance and likeliest noise.
    """
    n, p = J.shape
    scale = _column_norms(J)
    models = noise_models(n, noise_grid(n) if noises is None else tuple(noises))
    solution = solve_normal_equations(models.gram(np.vstack([J.T / scale[:, None], r])))
    s2 = np.maximum(solution.residual_squares / max(n - p, 1), 1e-300)
    log_likelihood = -0.5 * (
        models.log_determinant + solution.log_determinant + (n - p) * np.log(s2)
    )
    # Weight of white noise; that of every other node of the grid is 1.
    white_weight = 54
    log_likelihood[0] += math.log(white_weight if len(models.noises) > 1 else 1)
    weights = np.exp(log_likelihood - log_likelihood.max())
    weights /= weights.sum()
    mean = weights @ solution.step
    deviation = solution.step - mean
    covariance = np.einsum("m,mij->ij", weights * s2, solution.covariance)
    covariance += np.einsum("m,mi,mj->ij", weights, deviation, deviation)
    best = int(np.argmax(weights))
    return ParameterUncertainty(
        models.noises[best], float(s2[best]), covariance / np.outer(scale, scale), mean / scale
    )


def _column_norms(J: np.ndarray) -> np.ndarray:
    """Return the norms (p,) of the columns of a Jacobian (n, p), 1 for columns of zeros."""
    norms = np.sqrt((J * J).sum(axis=0))
    return np.where(norms > 0, norms, 1.0)


@dataclass(frozen=True)
class LinearFit:
    """Least-squares solutions of r = J p, with leading dimensions for different noises.

    Attributes
    ----------
    covariance : ndarray, shape (..., p, p)
        (J'V^-1 J)^-1.
    step : ndarray, shape (..., p)
        Parameters p.
    residual_squares : ndarray, shape (...)
        r'V^-1 r with the residuals r that remain.
    log_determinant : ndarray, shape (...)
        ln|J'V^-1 J|.
    """

    covariance: np.ndarray
    step: np.ndarray
    residual_squares: np.ndarray
    log_determinant: np.ndarray


def solve_normal_equations(gram: np.ndarray, p: int | None = None) -> LinearFit:
    """Solve normal equations by Gauss-Jordan elimination, for all leading dimensions at once.

    Parameters
    ----------
    gram : ndarray, shape (..., c, c)
        [J, ..., r]'V^-1 [J, ..., r] of columns J of similar norm, and residuals r as the last one.
    p : int, optional
        Number of leading columns J that are fitted; by default all columns except the last.

    Returns
    -------
    LinearFit
        The solutions. If a column depends linearly on others, its pivot is below round-off; it is
        then raised to round-off, which gives a large variance.
    """
    p = gram.shape[-1] - 1 if p is None else p
    M = gram.copy()
    smallest_pivot = 1e-14 * np.maximum(
        np.diagonal(gram, axis1=-2, axis2=-1)[..., :p].max(axis=-1), 1e-300
    )
    log_determinant = np.zeros(gram.shape[:-2])
    for k in range(p):
        pivot = np.maximum(M[..., k, k], smallest_pivot)
        log_determinant += np.log(pivot)
        row = M[..., k, :] / pivot[..., None]
        column = M[..., :, k].copy()
        M -= column[..., :, None] * row[..., None, :]
        M[..., k, :] = row
        M[..., :, k] = -column / pivot[..., None]
        M[..., k, k] = 1.0 / pivot
    return LinearFit(M[..., :p, :p], M[..., :p, -1], M[..., -1, -1], log_determinant)


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
    p = J.shape[1]
    m = extra.shape[1]
    columns = np.column_stack([J, extra])
    gram = noise.gram(np.vstack([(columns / _column_norms(columns)).T, r]))
    squares_without, squares_with = (
        float(solve_normal_equations(gram, count).residual_squares) for count in (p, p + m)
    )
    return f_test(max(squares_without - squares_with, 0.0), m, squares_with, len(r) - p - m)


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
