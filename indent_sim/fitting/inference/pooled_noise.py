"""Noise of a map: one autocovariance for all curves, estimated from their baselines.

    V_ij = s_b^2 sum_k w_k R_k(|i - j|),   w_k >= 0,   R_k(0) = 1

s_b is the standard deviation of curve b; the shape of the noise is determined by the instrument and
the same for all curves. R_k are white noise, exponentials of different correlation times, and
slowly damped waves, as interference of the laser causes. The weights maximize the restricted
likelihood of the baselines r_b, with K orthogonal to straight lines,

    -2 ln L = sum_b ln|K'V K| + r_b'K (K'V K)^-1 K'r_b

Sources: Patterson & Thompson (1971), Biometrika 58, 545.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.fft import dct, idct, irfft, next_fast_len, rfft
from scipy.linalg import cho_factor, cho_solve, null_space, toeplitz
from scipy.optimize import minimize

# Largest number of samples of a baseline that are used: the cost grows with its third power.
MAX_BASELINE_SAMPLES = 256
# Smallest number of baselines, and of samples of each, from which the noise of a map is estimated.
MIN_BASELINES = 64
MIN_BASELINE_SAMPLES = 48


@dataclass(frozen=True)
class NoiseComponent:
    """Autocorrelation R(l) = cos(2 pi l/wavelength) exp(-l/decay_length) at a lag of l samples.

    Attributes
    ----------
    decay_length : float
        Correlation time [samples]; 0 for white noise.
    wavelength : float
        Wavelength [samples]; infinite for noise that does not oscillate.
    """

    decay_length: float
    wavelength: float = math.inf

    def autocorrelation(self, lags: np.ndarray) -> np.ndarray:
        """Return the autocorrelation at lags [samples]."""
        if not self.decay_length:
            return np.where(lags == 0, 1.0, 0.0)
        return np.cos(2.0 * np.pi * lags / self.wavelength) * np.exp(-lags / self.decay_length)


@dataclass(frozen=True)
class PooledNoise:
    """Autocovariance of the noise of a map, for a variance of 1.

    Attributes
    ----------
    components : tuple of NoiseComponent
        Parts of the noise.
    weights : tuple of float
        Fractions of the variance, of sum 1.
    baseline_count : int
        Number of baselines from which it was estimated.
    baseline_samples : int
        Number of samples of each baseline.
    """

    components: tuple[NoiseComponent, ...]
    weights: tuple[float, ...]
    baseline_count: int = 0
    baseline_samples: int = 0

    def as_record(self) -> dict[str, Any]:
        """Return the noise as data for JSON; an infinite wavelength is None."""
        return {
            "components": [
                {
                    "decay_length": component.decay_length,
                    "wavelength": component.wavelength
                    if math.isfinite(component.wavelength)
                    else None,
                }
                for component in self.components
            ],
            "weights": list(self.weights),
            "baselines": self.baseline_count,
            "samples": self.baseline_samples,
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> PooledNoise:
        """Return the noise from data of `as_record`; raise KeyError or TypeError for other data."""
        components = tuple(
            NoiseComponent(part["decay_length"], part["wavelength"] or math.inf)
            for part in record["components"]
        )
        return cls(components, tuple(record["weights"]), record["baselines"], record["samples"])

    def autocovariance(self, n: int) -> np.ndarray:
        """Return the autocovariance at lags of 0 to n - 1 samples."""
        lags = np.arange(n)
        parts = [
            weight * component.autocorrelation(lags)
            for weight, component in zip(self.weights, self.components, strict=True)
        ]
        total: np.ndarray = np.sum(parts, axis=0)
        return total

    def metric(self, n: int) -> CosineMetric:
        """Return the approximate inverse of the covariance of n samples."""
        return _cosine_metric(self, n)

    def variances(self, rows: np.ndarray) -> np.ndarray:
        """Return the variances (...) of linear combinations of noise with coefficients (..., n).

        They are d'V d for the rows d, computed with a circulant matrix that contains V.
        """
        n = rows.shape[-1]
        size = next_fast_len(2 * n, real=True)
        covariance = self.autocovariance(n)
        circulant = np.zeros(size)
        circulant[:n] = covariance
        circulant[size - n + 1 :] = covariance[:0:-1]
        spectrum = rfft(circulant).real
        transformed = rfft(rows, size, axis=-1)
        applied = irfft(transformed * spectrum, size, axis=-1)[..., :n]
        variances: np.ndarray = np.maximum((rows * applied).sum(axis=-1), 0.0)
        return variances

    @property
    def white_fraction(self) -> float:
        """Fraction of the variance that is white."""
        return sum(
            weight
            for weight, component in zip(self.weights, self.components, strict=True)
            if not component.decay_length
        )

    @property
    def wave_fraction(self) -> float:
        """Fraction of the variance that oscillates."""
        return sum(
            weight
            for weight, component in zip(self.weights, self.components, strict=True)
            if math.isfinite(component.wavelength)
        )

    @property
    def correlation_time(self) -> float:
        """Mean correlation time [samples] of the exponential components, weighted by variance."""
        coloured = [
            (weight, component.decay_length)
            for weight, component in zip(self.weights, self.components, strict=True)
            if component.decay_length and not math.isfinite(component.wavelength)
        ]
        total = sum(weight for weight, _ in coloured)
        return sum(weight * tau for weight, tau in coloured) / total if total else 0.0


@dataclass(frozen=True)
class CosineMetric:
    """Weights of the squares of cosine coefficients: C W C' approximates V^-1.

    W is the inverse of the diagonal of C'V C, with the cosine transform C. Parameters estimated
    with these weights are unbiased, and nearly as precise as with V^-1; their covariance has to be
    computed with V itself (`PooledNoise.variances`).
    """

    weights: np.ndarray

    def gram(self, X: np.ndarray) -> np.ndarray:
        """Return X'C W C'X (..., c, c); the c columns of X are stored as rows (..., c, n)."""
        H = dct(X, type=2, norm="ortho", axis=-1) * np.sqrt(self.weights)
        return H @ np.swapaxes(H, -1, -2)  # type: ignore[no-any-return]

    def apply(self, X: np.ndarray) -> np.ndarray:
        """Return C W C'X; the columns of X are stored as rows (..., n)."""
        return idct(  # type: ignore[no-any-return]
            self.weights * dct(X, type=2, norm="ortho", axis=-1), type=2, norm="ortho", axis=-1
        )


@lru_cache(maxsize=256)
def _cosine_metric(noise: PooledNoise, n: int) -> CosineMetric:
    V = toeplitz(noise.autocovariance(n))
    half = dct(V, type=2, norm="ortho", axis=0)
    diagonal = np.diag(dct(half, type=2, norm="ortho", axis=1))
    return CosineMetric(1.0 / np.maximum(diagonal, 1e-12))


def estimate_pooled_noise(baselines: np.ndarray) -> PooledNoise:
    """Estimate the noise of a map from baselines.

    Parameters
    ----------
    baselines : ndarray, shape (b, m)
        Forces before contact, in order of time.

    Returns
    -------
    PooledNoise
        The noise. It contains waves only if they increase ln L by at least 0.5 per curve, since a
        wave as long as a baseline cannot be distinguished from slow noise.
    """
    count, m = baselines.shape
    x = np.linspace(-1.0, 1.0, m)
    K = null_space(np.vstack([np.ones(m), x]))
    residuals = baselines @ K
    residuals = residuals[(residuals != 0).any(axis=1)]
    decays = [0.0, *(0.5 * 2.0 ** (0.5 * k) for k in range(60) if 0.5 * 2.0 ** (0.5 * k) <= 2 * m)]
    exponentials = [NoiseComponent(decay) for decay in decays]
    wavelengths = [2.0 * m / 2.0 ** (0.25 * k) for k in range(17)]
    waves = [NoiseComponent(4.0 * m, wavelength) for wavelength in wavelengths]
    likelihood, weights = _maximize_likelihood(exponentials, K, residuals)
    components = exponentials
    wave_likelihood, wave_weights = _maximize_likelihood([*exponentials, *waves], K, residuals)
    min_gain = 0.5
    if wave_likelihood - likelihood > min_gain:
        components = [*exponentials, *waves]
        weights = wave_weights
    kept = weights > 1e-6 * weights.sum()
    total = float(weights[kept].sum())
    return PooledNoise(
        tuple(component for component, is_kept in zip(components, kept, strict=True) if is_kept),
        tuple((weights[kept] / total).tolist()),
        count,
        m,
    )


def _maximize_likelihood(
    components: list[NoiseComponent], K: np.ndarray, residuals: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return ln L per curve and the weights of the components.

    The variances of the curves and the weights are computed alternately.
    """
    m = len(K)
    degrees_of_freedom = K.shape[1]
    matrices = [
        K.T @ toeplitz(component.autocorrelation(np.arange(m))) @ K for component in components
    ]
    weights = np.full(len(components), 1.0 / len(components))
    log_likelihood = -math.inf
    alternations = 4
    for _ in range(alternations):
        V = np.tensordot(weights, matrices, axes=1)
        solved = cho_solve(cho_factor(V), residuals.T).T
        variances = (residuals * solved).sum(axis=1) / degrees_of_freedom
        scaled = residuals / np.sqrt(variances)[:, None]
        S = scaled.T @ scaled / len(scaled)
        result = minimize(
            _negative_log_likelihood,
            weights,
            args=(matrices, S),
            jac=True,
            method="L-BFGS-B",
            bounds=[(1e-7 if k == 0 else 0.0, None) for k in range(len(components))],
            options={"maxiter": 60, "ftol": 1e-9},
        )
        weights = result.x
        log_likelihood = -float(result.fun) - 0.5 * degrees_of_freedom * float(
            np.mean(np.log(variances))
        )
    return log_likelihood, weights


def _negative_log_likelihood(
    weights: np.ndarray, matrices: list[np.ndarray], S: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the negative log-likelihood per curve and its gradient, for a variance of 1."""
    V = np.tensordot(weights, matrices, axes=1)
    try:
        factor = cho_factor(V)
    except np.linalg.LinAlgError:
        return 1e300, np.zeros(len(weights))
    inverse = cho_solve(factor, np.eye(len(V)))
    inverse_S = inverse @ S
    log_determinant = 2.0 * float(np.log(np.diag(factor[0])).sum())
    # Derivative of ln|V| + tr(V^-1 S) with respect to V.
    slope = inverse - inverse_S @ inverse
    gradient = np.array([0.5 * float((slope * matrix).sum()) for matrix in matrices])
    return 0.5 * (log_determinant + float(np.trace(inverse_S))), gradient
