"""Initial guesses: contact points are tried, and scale and baseline follow by linear least squares.

    F_i = b0 + b1 s_i + A f(x_i - c) + noise,   s = (x - mean)/range

For a trial contact point c the baseline is eliminated by projection: with f' and F' orthogonal to 1
and s, A = f'.F'/f'.f', and the sum of squares is F'.F' - (f'.F')^2/f'.f'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TrialFits:
    """Linear fits at trial contact points.

    Attributes
    ----------
    squares : ndarray, shape (..., k)
        Sums of squares; infinite without contact, or where the fitted force would be tensile.
    amplitude : ndarray, shape (..., k)
        Scale A of the force.
    level, slope : ndarray, shape (..., k)
        Baseline b0, b1.
    """

    squares: np.ndarray
    amplitude: np.ndarray
    level: np.ndarray
    slope: np.ndarray


def fit_trials(
    x: np.ndarray, force: np.ndarray, f: np.ndarray, has_slope: bool, has_scale: bool
) -> TrialFits:
    """Fit scale and baseline at trial contact points.

    Parameters
    ----------
    x : ndarray, shape (..., n)
        Displacements.
    force : ndarray, shape (..., n)
        Measured forces.
    f : ndarray, shape (..., k, n)
        Forces of the scene for each trial contact point.
    has_slope : bool
        Whether the slope b1 is fitted.
    has_scale : bool
        Whether the scale A is fitted; it is 1 otherwise.

    Returns
    -------
    TrialFits
        The fits.
    """
    mean_force = force.mean(axis=-1, keepdims=True)
    mean_f = f.mean(axis=-1, keepdims=True)
    centred = x - x.mean(axis=-1, keepdims=True)
    s = centred / np.maximum(np.ptp(x, axis=-1, keepdims=True), 1e-300)
    ss = np.maximum((s * s).sum(axis=-1), 1e-300)
    slope_of_force = ((s * force).sum(axis=-1) / ss)[..., None] * has_slope
    slope_of_f = (f @ s[..., :, None])[..., 0] / ss[..., None] * has_slope
    F_rest = force - mean_force - slope_of_force * s
    f_rest = f - mean_f - slope_of_f[..., None] * s[..., None, :]
    ff = (f_rest * f_rest).sum(axis=-1)
    fF = (f_rest @ F_rest[..., :, None])[..., 0]
    FF = (F_rest * F_rest).sum(axis=-1)[..., None]
    amplitude = fF / np.maximum(ff, 1e-300) if has_scale else np.ones_like(fF)
    squares = np.maximum(FF - 2.0 * amplitude * fF + amplitude**2 * ff, 0.0)
    is_valid = (ff > 0) & (amplitude > 0) & np.isfinite(squares)
    return TrialFits(
        np.where(is_valid, squares, np.inf),
        amplitude,
        mean_force - amplitude * mean_f[..., 0],
        slope_of_force - amplitude * slope_of_f,
    )
