"""Fits to the shallower parts of a curve, and their differences from the whole fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.inference.estimate import (
    FARTHEST_LOG_DISTANCE,
    MIN_CONTACT_POINTS,
    CurveModel,
    Estimate,
    convert_baseline,
    uncertainty_at,
)
from indent_sim.fitting.inference.noise import NORMAL_95

# Least standard deviation of the difference of two fits, relative to that of the partial fit.
MIN_DEVIATION_RATIO = 0.1


@dataclass(frozen=True)
class DepthRangeFit:
    """Ordinary least-squares fit to the samples up to a fraction of the largest depth.

    Attributes
    ----------
    depth_fraction : float
        Largest depth of the fitted samples, as a fraction of the largest depth of the curve.
    theta : ndarray, shape (k,)
        Transformed parameters.
    sd : ndarray, shape (k,)
        Standard deviations of theta.
    z_score : ndarray, shape (k,)
        Difference from the fit to the whole curve, in standard deviations of the difference.
    """

    depth_fraction: float
    theta: np.ndarray
    sd: np.ndarray
    z_score: np.ndarray

    def interval(self, k: int) -> tuple[float, float]:
        """Return the 95 % interval of a transformed parameter."""
        half_width = min(NORMAL_95 * float(self.sd[k]), FARTHEST_LOG_DISTANCE)
        return float(self.theta[k]) - half_width, float(self.theta[k]) + half_width


def fit_depth_ranges(estimate: Estimate) -> list[DepthRangeFit]:
    """Return the fits to parts of a curve, the shallowest first.

    Parts with too few points in contact are omitted. If the scene is time-dependent, a part ends at
    a fraction of the time in contact.

    The difference of two ordinary least-squares fits is D times the noise, with the matrix
    D = pinv(J_part) - pinv(J), where pinv(J_part) has zero columns for the samples outside the
    part. The covariance of the difference is s2 D V D' with the variance s2 and the correlation
    matrix V of the noise of the whole curve.
    """
    model = estimate.model
    # The shallower part of a loop is loading, which does not determine its parameters.
    if model.forward_model.follows_loop:
        return []
    p = estimate.ordinary_p
    is_free = model.is_free
    whole_pseudoinverse = np.linalg.pinv(model.jacobian(p)[:, is_free])
    progress = _contact_progress(model, float(p[model.coordinate_count]))
    fits = (
        _fit_depth_range(estimate, whole_pseudoinverse, fraction, progress <= fraction)
        for fraction in (0.5, 0.6, 0.7, 0.8, 0.9)
    )
    return [range_fit for range_fit in fits if range_fit is not None]


def _contact_progress(model: CurveModel, c: float) -> np.ndarray:
    """Return the position of each sample between first contact (0) and the deepest sample (1).

    If the scene is time-dependent, the position in time is returned, since the tip may be held.
    """
    x = model.samples.x
    t = model.samples.t
    if model.forward_model.is_time_dependent and t is not None and np.any(x > c):
        contact_time = t[np.argmax(x > c)]
        progress: np.ndarray = (t - contact_time) / max(float(t[-1] - contact_time), 1e-300)
    else:
        progress = (x - c) / max(float(x.max()) - c, 1e-300)
    return progress


def _fit_depth_range(
    estimate: Estimate,
    whole_pseudoinverse: np.ndarray,
    depth_fraction: float,
    is_inside: np.ndarray,
) -> DepthRangeFit | None:
    model = estimate.model
    is_free = estimate.model.is_free
    if (
        np.count_nonzero(is_inside & (model.samples.x > estimate.contact_point))
        < MIN_CONTACT_POINTS
    ):
        return None
    partial_model = replace(model, samples=model.samples.select(is_inside))
    try:
        p, _ = partial_model.least_squares(
            convert_baseline(model, partial_model, estimate.ordinary_p)
        )
        J = partial_model.jacobian(p)[:, is_free]
        partial_uncertainty = uncertainty_at(partial_model, p)
    except (ForwardModelUnavailable, ValueError, np.linalg.LinAlgError):
        return None
    k = model.coordinate_count
    D = -whole_pseudoinverse[:k].copy()
    D[:, is_inside] += np.linalg.pinv(J)[:k]
    uncertainty = estimate.uncertainty
    variance = uncertainty.s2 * np.einsum(
        "ij,ji->i", D, uncertainty.likeliest_noise.apply_covariance(D.T)
    )
    if model.touch is not None:
        # Both fits take the contact point from the snap-in, so that its error is common to both.
        shift = D @ model.model_without_touch.jacobian(estimate.ordinary_p)[:, k]
        variance += shift**2 * uncertainty.covariance[k, k]
    sd = np.sqrt(np.maximum(variance, 0.0))
    sd = np.maximum(sd, MIN_DEVIATION_RATIO * partial_uncertainty.sd[:k])
    theta = p[:k]
    return DepthRangeFit(
        depth_fraction,
        theta,
        partial_uncertainty.sd[:k],
        (theta - estimate.ordinary_p[:k]) / np.where(sd > 0, sd, 1.0),
    )
