"""Assessment of a fit: adequacy of the model, and stated intervals of the parameters.

A scene does not explain a curve if the residuals have a trend, if the parameters change with the
depth range of the fit, if the contact is noisier than the baseline, or if another model is better.
The interval is then widened until it contains the values of those fits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from indent_sim.fitting.inference.alternative_models import AlternativeModel
from indent_sim.fitting.inference.baseline import WRONG_BASELINE_P, baseline_noise
from indent_sim.fitting.inference.depth_range_fits import DepthRangeFit
from indent_sim.fitting.inference.estimate import (
    CurveModel,
    Estimate,
    samples_out_of_contact,
    standard_deviation,
)
from indent_sim.fitting.inference.joint_estimate import JointEstimate
from indent_sim.fitting.inference.noise import (
    NORMAL_95,
    average_over_noise,
    f_test,
    f_test_extra_columns,
)

BETTER_MODEL_P = 1e-3
# The scene does not explain the curve below this probability of the trend of the residuals, or
# above this z score of a fit to a part of the depth.
MIN_SHAPE_P = 1e-3
MAX_DEPTH_Z = 3.5
# Below this larger probability, or above this smaller z score, other models and depth ranges are
# fitted, too.
SUSPICIOUS_SHAPE_P = 1e-2
SUSPICIOUS_DEPTH_Z = 2.5


@dataclass(frozen=True)
class Interval:
    """Value of a parameter and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ModelAssessment:
    """Assessment of a fit by its residuals, by fits to parts of the curve, and by other models.

    Attributes
    ----------
    estimate : Estimate
        The fit.
    depth_range_fits : list of DepthRangeFit
        Fits to the shallower parts of the curve.
    p_shape : float
        Probability that the residuals have their trend by chance.
    p_baseline : float, optional
        Probability that the contact contradicts the baseline by chance.
    alternatives : list of AlternativeModel
        Other models of the curve.
    systematic_half_widths : tuple of float
        Half widths (k,) of the intervals of theta due to mesh and calibration, added in quadrature.
    together : JointEstimate, optional
        The fit of several curves together, whose part this one is.
    """

    estimate: Estimate
    depth_range_fits: list[DepthRangeFit]
    p_shape: float
    p_baseline: float | None
    alternatives: list[AlternativeModel] = field(default_factory=list)
    systematic_half_widths: tuple[float, ...] = ()
    together: JointEstimate | None = None

    @property
    def better_models(self) -> list[AlternativeModel]:
        """Alternative models that are significantly better than the scene's model."""
        return [model for model in self.alternatives if model.p < BETTER_MODEL_P]

    @cached_property
    def misfit_causes(self) -> list[str]:
        """Reasons why the scene does not explain the curve; empty if it does.

        Each entry is the name of a significantly better model, or "shape" (the residuals have a
        trend), "window" (the parameters depend on the depth range), "baseline" (the residuals in
        contact are noisier than those of the baseline, or the fit moves the baseline away from the
        samples out of contact) or "tips" (the curves of several tips contradict each other).
        Residuals at the level of round-off are not a reason.
        """
        # Residuals below this fraction of the largest force are round-off, as of a
        # simulated curve.
        negligible_residual = 1e-5
        if self.estimate.rms < negligible_residual * self.estimate.max_force:
            return []
        is_depth_dependent = any(
            self._is_depth_dependent(k) for k in range(self.estimate.model.coordinate_count)
        )
        is_noisy = self.p_baseline is not None and self.p_baseline < WRONG_BASELINE_P
        is_misfit = {
            "shape": self.p_shape < MIN_SHAPE_P,
            "window": is_depth_dependent,
            "baseline": is_noisy,
            "tips": self.together is not None and self.together.p_together < MIN_SHAPE_P,
        }
        return [
            *(model.name for model in self.better_models),
            *(name for name, is_wrong in is_misfit.items() if is_wrong),
        ]

    def _is_depth_dependent(self, k: int) -> bool:
        """Return True if a fit to a part differs significantly from the fit to the whole curve.

        The difference also counts as significant if the intervals of the two fits do not overlap.
        """
        low, high = self._add_systematic_errors(k, *self.statistical_interval(k))
        for range_fit in self.depth_range_fits:
            range_low, range_high = range_fit.interval(k)
            if abs(range_fit.z_score[k]) > MAX_DEPTH_Z or range_high < low or range_low > high:
                return True
        return False

    @property
    def is_adequate(self) -> bool:
        """True if the scene explains the curve."""
        return not self.misfit_causes

    def statistical_interval(self, k: int) -> tuple[float, float]:
        """Return the interval of a transformed parameter due to noise alone."""
        return self.estimate.interval(k)

    def coordinate_interval(self, k: int) -> tuple[float, float]:
        """Return the stated interval of a transformed parameter, with systematic errors.

        If the scene does not explain the curve, the interval contains the values of the partial
        fits and the intervals of the better models.
        """
        low, high = self.statistical_interval(k)
        if not self.is_adequate:
            low = min([low, *(float(range_fit.theta[k]) for range_fit in self.depth_range_fits)])
            high = max([high, *(float(range_fit.theta[k]) for range_fit in self.depth_range_fits)])
            for alternative in self.better_models:
                alternative_low, alternative_high = alternative.estimate.interval(k)
                low = min(low, alternative_low)
                high = max(high, alternative_high)
        low, high = self._add_systematic_errors(k, low, high)
        lower_bound, upper_bound = self.estimate.model.forward_model.parameters[k].bounds
        return max(low, lower_bound), min(high, upper_bound)

    def _add_systematic_errors(self, k: int, low: float, high: float) -> tuple[float, float]:
        """Return an interval with the errors of mesh and calibration added in quadrature."""
        value = float(self.estimate.theta[k])
        systematic = self.systematic_half_widths[k] if self.systematic_half_widths else 0.0
        return value - math.hypot(value - low, systematic), value + math.hypot(
            high - value, systematic
        )

    def stated_interval(self, k: int) -> Interval:
        """Return value and interval of a varied key, in the scene's units."""
        parameter = self.estimate.model.forward_model.parameters[k]
        ends = (parameter.value(end) for end in self.coordinate_interval(k))
        return Interval(parameter.value(float(self.estimate.theta[k])), *ends)

    @property
    def is_identifiable(self) -> bool:
        """True if every parameter is known to a factor of three and is not at a bound."""
        keys = range(self.estimate.model.coordinate_count)
        # A parameter whose factor of uncertainty is larger is not identifiable.
        max_identifiable_factor = 3.0
        return not any(
            self.estimate.is_at_bound(k) or self._uncertainty_factor(k) > max_identifiable_factor
            for k in keys
        )

    def _uncertainty_factor(self, k: int) -> float:
        interval = self.stated_interval(k)
        ends = (abs(interval.high), abs(interval.value), abs(interval.low))
        if self.estimate.model.forward_model.parameters[k].is_linear:
            return 1.0
        if min(ends) == 0:
            return math.inf
        return max(ends[0] / ends[1], ends[1] / ends[2])


@dataclass(frozen=True)
class ResidualTrend:
    """Probabilities that the residuals have their trend by chance.

    Attributes
    ----------
    shape : float
        Probability of any smooth trend.
    power : float
        Probability of a trend due to another exponent of the depth.
    snap : float
        Probability of the largest drop of the force between two samples, as at a snap-in.
    """

    shape: float
    power: float
    snap: float


def is_suspect(
    depth_range_fits: Sequence[DepthRangeFit],
    residual_trend: ResidualTrend,
    p_baseline: float | None,
) -> bool:
    """Return True if other models should be fitted."""
    # Probabilities below which other models are fitted.
    max_power = 1e-2
    max_snap = 1e-3
    max_baseline = 1e-3
    is_depth_dependent = any(
        np.any(np.abs(range_fit.z_score) > SUSPICIOUS_DEPTH_Z) for range_fit in depth_range_fits
    )
    is_noisy = p_baseline is not None and p_baseline < max_baseline
    has_trend = (
        residual_trend.shape < SUSPICIOUS_SHAPE_P
        or residual_trend.power < max_power
        or residual_trend.snap < max_snap
    )
    return is_depth_dependent or is_noisy or has_trend


def find_residual_trend(estimate: Estimate) -> ResidualTrend:
    """Test the residuals for a trend by F tests.

    The shape is tested with eight cosines over the contact, and the power with the function F
    ln(delta/depth): a wrong thickness or tip shape, or missing adhesion, changes a curve
    approximately by this function, to which the eight cosines are less sensitive. The noise is
    estimated with and without the cosines, and the larger probability is used, since a trend can be
    mistaken for correlated noise.
    """
    model = estimate.model
    p = estimate.ordinary_p
    J = model.jacobian(p)[:, model.is_free]
    r = model.residual(p)
    x = model.samples.x
    cosines = trend_cosines(x, np.array(estimate.contact_point), np.array(estimate.depth)).T
    noise_with_cosines = average_over_noise(np.column_stack([J, cosines]), r).likeliest_noise
    shape = max(
        f_test_extra_columns(J, cosines, r, noise)
        for noise in {noise_with_cosines, estimate.uncertainty.likeliest_noise}
    )
    snap = (
        1.0
        if model.forward_model.has_adhesion or model.forward_model.follows_loop
        else _snap_in_probability(model.samples.force[np.argsort(x, kind="stable")])
    )
    return ResidualTrend(
        shape,
        f_test_extra_columns(J, _exponent_derivative(model, p)[:, None], r, noise_with_cosines),
        snap,
    )


def trend_cosines(x: np.ndarray, contact_point: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return eight cosines (..., 8, n) over the contact, 0 before it.

    The cosines begin 0.35 depths before first contact, and end at the deepest sample.

    Parameters
    ----------
    x
        Displacements (..., n) [length].
    contact_point, depth
        Displacement at first contact and largest depth [length], (..., 1) for a batch.
    """
    baseline_depths = 0.35
    cosine_count = 8
    first_x = contact_point - baseline_depths * depth
    u = np.clip((x - first_x) / ((1.0 + baseline_depths) * depth), 0.0, 1.0)
    harmonics = np.pi * np.arange(1, cosine_count + 1)[:, None]
    cosines = np.cos(harmonics * u[..., None, :])
    return np.where((x >= first_x)[..., None, :], cosines, 0.0)


def _snap_in_probability(force: np.ndarray) -> float:
    """Return the probability that the largest drop between two samples (n,) is noise.

    The samples are in order of depth, and the noise follows from the median of the changes between
    samples. Slow noise hides the attraction around a snap-in, but not the drop itself.
    """
    changes = np.diff(force)
    # Standard deviation of a normal distribution over the median of its absolute value.
    median_to_deviation = 1.4826
    deviation = median_to_deviation * float(np.median(np.abs(changes)))
    # In a curve with few digits most neighbouring samples are equal, and the median of their
    # changes is 0.
    if not deviation > 0:
        return 1.0
    return min(
        1.0, 0.5 * len(changes) * math.erfc(-float(changes.min()) / deviation / math.sqrt(2.0))
    )


def _exponent_derivative(model: CurveModel, p: np.ndarray) -> np.ndarray:
    """Return F ln(delta/delta_max) with the largest depth delta_max.

    It is the derivative of F (delta/delta_max)^m with respect to m at m = 0.
    """
    force = model.contact_force(p)
    delta = (
        model.samples.x
        - p[model.coordinate_count]
        - model.forward_model.experiment.compliance * force
    )
    relative_depth = np.maximum(delta / max(float(delta.max()), 1e-300), 1e-9)
    return force * np.log(relative_depth)  # type: ignore[no-any-return]


def baseline_noise_probability(estimate: Estimate) -> float | None:
    """Return the probability that the contact contradicts the baseline by chance.

    The contact contradicts the baseline if it is noisier, or if it has moved the baseline away from
    the samples out of contact. The smaller probability of the two is returned; None if the baseline
    is too short.
    """
    model = estimate.model
    r = estimate.residual
    is_before_contact = samples_out_of_contact(model, estimate.p)
    s = model.samples.x[is_before_contact]
    n = int(np.count_nonzero(is_before_contact))
    m = int(np.count_nonzero(~is_before_contact))
    noise = baseline_noise(s, r[is_before_contact])
    p_shift = estimate.p_baseline_shift
    if noise is None or not m:
        return p_shift
    contact_squares = noise[0].squares(r[~is_before_contact])
    p_noise = f_test(contact_squares, m, noise[1] * (n - 2), n - 2)
    return p_noise if p_shift is None else min(p_noise, p_shift)


def width_inflation_factors(estimate: Estimate) -> list[float]:
    """Return each interval's width divided by its width if all other parameters were known."""
    coordinate_count = estimate.model.coordinate_count
    other_indices = [
        [j for j in range(coordinate_count) if j != k] for k in range(coordinate_count)
    ]
    pairs = (
        (standard_deviation(estimate, k), standard_deviation(estimate, k, fixed))
        for k, fixed in enumerate(other_indices)
    )
    return [
        total_deviation / max(conditional_deviation, 1e-300)
        for total_deviation, conditional_deviation in pairs
    ]


def parameter_shift(estimate: Estimate, force_error: np.ndarray) -> np.ndarray:
    """Return the changes of theta due to an error (n,) of the modelled force."""
    model = estimate.model
    noise = estimate.uncertainty.likeliest_noise
    J = model.jacobian(estimate.p)[:, model.is_free]
    gram = noise.gram(np.vstack([J.T, force_error]))
    shift = np.linalg.lstsq(gram[:-1, :-1], gram[:-1, -1], rcond=1e-13)[0]
    return np.abs(shift[: model.coordinate_count])


def systematic_half_widths(
    estimate: Estimate, mesh_error: float, calibration_error: float
) -> tuple[float, ...]:
    """Return the half widths (k,) of the intervals of theta due to systematic errors.

    Parameters
    ----------
    estimate : Estimate
        The fit.
    mesh_error : float
        Relative error of the force due to the mesh.
    calibration_error : float
        Relative standard deviation of the force due to calibration.

    Returns
    -------
    tuple of float
        Half widths, including the errors of time stepping.
    """
    force = estimate.model.contact_force(estimate.p)
    model = estimate.model
    error_shift = parameter_shift(
        estimate, math.hypot(mesh_error, NORMAL_95 * calibration_error) * force
    )
    samples = model.samples
    time_step_shift = parameter_shift(
        estimate,
        model.forward_model.time_step_error(
            estimate.theta, samples.x - estimate.contact_point, samples.t
        ),
    )
    unloading_shifts = [
        parameter_shift(estimate, error) for error in model.unloading_errors(estimate.p)
    ]
    shifts = np.array([error_shift, time_step_shift, *unloading_shifts])
    return tuple(np.sqrt((shifts**2).sum(axis=0)).tolist())
