"""Baseline of a curve, tested by the samples out of contact, which do not depend on the model.

A fit determines the baseline b0 + b1 s from all samples. If the scene does not explain the contact,
the fitted baseline may deviate from the samples out of contact, whose residuals then have a mean or
a slope.
"""

from __future__ import annotations

import numpy as np

from indent_sim.fitting.inference.noise import (
    Noise,
    average_over_noise,
    f_test,
)

# Smallest number of samples, and of independent samples, of a baseline that is compared with the
# fit.
MIN_POINTS = 40
MIN_EFFECTIVE_POINTS = 8.0
# Distance before first contact, in depths, that does not count as baseline, since a snap-in lies
# there.
CONTACT_MARGIN = 0.2
# If chance alone shifts the baseline with a smaller probability, the scene does not explain the
# curve.
WRONG_BASELINE_P = 1e-4


def baseline_columns(s: np.ndarray, has_slope: bool) -> np.ndarray:
    """Return the columns (n, 1 or 2) of a constant and, with a slope, a linear baseline."""
    columns = [np.ones(len(s)), s][: 2 if has_slope else 1]
    return np.column_stack(columns)


def baseline_noise(s: np.ndarray, r: np.ndarray) -> tuple[Noise, float] | None:
    """Return the noise of a baseline and its variance; None if the baseline is too short.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Coordinates of the samples out of contact.
    r : ndarray, shape (n,)
        Residuals of these samples [force].
    """
    if len(r) < MIN_POINTS:
        return None
    uncertainty = average_over_noise(baseline_columns(s - s.mean(), True), r)
    noise = uncertainty.likeliest_noise
    if len(r) / noise.integrated_correlation_time < MIN_EFFECTIVE_POINTS:
        return None
    return noise, uncertainty.s2


def baseline_shift_probability(s: np.ndarray, r: np.ndarray, has_slope: bool) -> float | None:
    """Return the probability that the samples out of contact differ from the baseline by chance.

    The result is the probability of an F test of a baseline through the residuals, with the
    covariance of the noise models averaged over these samples only, since in the noise of the whole
    curve a misfit of the contact looks like slow noise. It is None if the baseline is too short,
    and 1 for a baseline that follows from these samples alone.

    Parameters
    ----------
    s, r
        Coordinates of the samples out of contact (n,), and their residuals [force].
    has_slope
        True if the baseline of the fit has a slope.
    """
    if len(r) < MIN_POINTS:
        return None
    uncertainty = average_over_noise(baseline_columns(s - s.mean(), has_slope), r)
    correlation_time = uncertainty.likeliest_noise.integrated_correlation_time
    independent_points = len(r) / correlation_time
    if independent_points < MIN_EFFECTIVE_POINTS:
        return None
    shift = uncertainty.step
    m = len(shift)
    squares = float(shift @ np.linalg.lstsq(uncertainty.covariance, shift, rcond=None)[0])
    degrees_of_freedom = max(int(independent_points) - m, 1)
    return f_test(squares, m, float(degrees_of_freedom), degrees_of_freedom)
