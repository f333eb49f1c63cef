"""Parameter estimation of one model from one curve with unknown contact point and baseline.

    F_i = b0 + b1 (x_i - mean)/range + f(x_i - c; theta) + noise

Ordinary least squares, followed by one step to the mean over all noise models, gives the
parameters. The noise of the residuals gives the intervals of the parameters. The step is shortened
where it raises the residuals, since a noise with a long correlation time hides a systematic misfit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from indent_sim.fitting.forward_model.forward_model import APPROACH, RETRACT, ForwardModel
from indent_sim.fitting.forward_model.loop_forward_model import LoopForwardModel
from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.forward_model.parameters import Role
from indent_sim.fitting.inference.baseline import (
    CONTACT_MARGIN,
    WRONG_BASELINE_P,
    baseline_columns,
    baseline_shift_probability,
)
from indent_sim.fitting.inference.initial_guess import fit_trials
from indent_sim.fitting.inference.jumps import (
    LEFT_OUT,
    best_branches,
    find_jumps,
    sides_of,
    spread_of_uniform,
    touch_interval,
)
from indent_sim.fitting.inference.least_squares import Metric, minimize_squares
from indent_sim.fitting.inference.noise import (
    NORMAL_95,
    WHITE,
    Noise,
    ParameterUncertainty,
    average_over_noise,
    solve_normal_equations,
)

MIN_POINTS = 30
MIN_CONTACT_POINTS = 20
# Number of block means of the curve in the search of initial guesses, and in the fit.
MAX_PILOT_SAMPLES = 400
MAX_SAMPLES = 1500
# Length of the fitted baseline: at most this many depths, but at least this fraction of the range.
MAX_BASELINE_DEPTHS = 1.5
MIN_BASELINE_FRACTION = 0.02
# A curve is rejected as saturated if more points than this fraction, and than this number, have the
# largest force; or if its largest force is a smaller multiple of the rms of the residuals; or if
# the factor of uncertainty of a modulus is larger.
SATURATED_FRACTION = 0.02
MAX_SATURATED = 5
MIN_SIGNAL_TO_NOISE = 4.0
MAX_UNCERTAINTY_FACTOR = 4.0
# Number of blocks of a curve whose means distinguish a contact from noise.
SIGNAL_BLOCKS = 50
# Largest rms of the residuals, relative to that of ordinary least squares.
MAX_RMS_RATIO = 1.1
# A snap-in of at least this many standard deviations of the noise lies between two known samples.
CLEAR_SNAP_DEVIATIONS = 5.0
# Smallest shift of a contact by adhesion, relative to the depth of the curve. It changes the force
# by 0.015 %.
SMALLEST_SHIFT = 1e-4
# Largest distance of a parameter from its fitted value, in the logarithm: a factor of a million.
FARTHEST_LOG_DISTANCE = math.log(1e6)


# Roles of parameters that do not only multiply the force.
NONLINEAR_ROLES: tuple[Role, ...] = ("shape", "work", "relaxation", "spring", "power")


class FitRejected(Exception):
    """Error: the parameters cannot be estimated from a curve; the message gives the reason."""


@dataclass(frozen=True)
class Samples:
    """Measured curve, or a batch of curves of equal length, in order of time.

    Attributes
    ----------
    x : ndarray, shape (..., n)
        Displacement of the base [length].
    force : ndarray, shape (..., n)
        Force [force].
    t : ndarray, shape (n,), optional
        Time [s].
    branch : ndarray of int, shape (..., n), optional
        Branches of the samples of an adhesive tip, see `jumps`, or of a body that yields; None if
        the model decides which samples are in contact.
    turn : float, optional
        Displacement at which unloading of a body that yields begins [length].
    """

    x: np.ndarray
    force: np.ndarray
    t: np.ndarray | None = None
    branch: np.ndarray | None = None
    turn: float | None = None

    def __len__(self) -> int:
        return self.x.shape[-1]

    def select(self, selected: np.ndarray) -> Samples:
        """Return the selected samples."""
        return Samples(
            self.x[selected],
            self.force[selected],
            None if self.t is None else self.t[selected],
            None if self.branch is None else self.branch[selected],
            self.turn,
        )

    def select_curves(self, selected: np.ndarray) -> Samples:
        """Return some curves of a batch; samples of one curve are not changed.

        A curve may also be repeated with different branches.
        """
        batched = {
            name: values[selected]
            for name, values in (("x", self.x), ("force", self.force), ("branch", self.branch))
            if values is not None and values.ndim > 1
        }
        return replace(self, **batched) if batched else self

    def block_means(self, max_count: int) -> Samples:
        """Return the means of blocks of neighbouring samples, at most `max_count` means."""
        return self.means_of_blocks(math.ceil(len(self) / max_count))

    def means_of_blocks(self, block_size: int) -> Samples:
        """Return the means of blocks of `block_size` neighbouring samples.

        The blocks are equally long, so that equal time steps stay equal; the remainder is taken
        from the beginning of the baseline.
        """
        if block_size <= 1:
            return self
        remainder = len(self) % block_size
        x, force = (
            column[..., remainder:].reshape(*column.shape[:-1], -1, block_size).mean(axis=-1)
            for column in (self.x, self.force)
        )
        return Samples(
            x,
            force,
            None if self.t is None else self.t[remainder:].reshape(-1, block_size).mean(axis=1),
            None if self.branch is None else self._branch_of_blocks(block_size, remainder),
            self.turn,
        )

    def _branch_of_blocks(self, block_size: int, remainder: int) -> np.ndarray:
        """Return the branches of blocks; a block with several branches is left out."""
        assert self.branch is not None
        blocks = self.branch[remainder:].reshape(-1, block_size)
        return np.where((blocks == blocks[:, :1]).all(axis=1), blocks[:, 0], LEFT_OUT)


@dataclass(frozen=True)
class OriginOptions:
    """Contact point and baseline of a fit.

    Attributes
    ----------
    contact_point : float, optional
        Known contact point [length]; None if it is fitted.
    has_slope : bool
        True if the baseline may have a slope.
    level, slope : float, optional
        Known baseline, level + slope x [force, force/length]; None if it is fitted.
    """

    contact_point: float | None = None
    has_slope: bool = True
    level: float | None = None
    slope: float = 0.0


@dataclass(frozen=True)
class CurveModel:
    """Model of measured curves with the parameters [theta..., c, b0, b1] (..., p).

    The parameters may have leading dimensions: several sets of parameters of one curve, or one set
    for each curve of a batch, whose samples have the same leading dimensions.

    Attributes
    ----------
    forward_model : ForwardModel
        Forces of the scene as a function of the transformed parameters theta.
    samples : Samples
        The curve, or a batch of curves.
    origin : OriginOptions
        Options of the contact point c and the baseline b0, b1.
    fixed : frozenset of int
        Indices of parameters that are not fitted.
    weights : ndarray, shape (..., n), optional
        Factors of the residuals, 0 for samples that are left out.
    touch : tuple of float, optional
        Displacements [length] between which the tip clearly snapped in. The contact point lies
        between these displacements, and is not fitted.
    """

    forward_model: ForwardModel
    samples: Samples
    origin: OriginOptions = field(default_factory=OriginOptions)
    fixed: frozenset[int] = frozenset()
    weights: np.ndarray | None = None
    touch: tuple[float, float] | None = None

    @property
    def coordinate_count(self) -> int:
        """Number of transformed parameters theta of the forward model."""
        return len(self.forward_model.parameters)

    @cached_property
    def baseline_coordinate(self) -> np.ndarray:
        """Coordinate s = (x - mean)/range of the slope of the baseline (..., n)."""
        x = self.samples.x
        span = np.maximum(np.ptp(x, axis=-1, keepdims=True), 1e-300)
        return (x - x.mean(axis=-1, keepdims=True)) / span  # type: ignore[no-any-return]

    @property
    def is_free(self) -> np.ndarray:
        """True for the parameters that are fitted (p,)."""
        is_free = np.ones(self.coordinate_count + 3, dtype=bool)
        is_free[self.coordinate_count] = self.origin.contact_point is None and self.touch is None
        is_free[-2] = self.origin.level is None
        is_free[-1] = self.origin.has_slope and self.origin.level is None
        is_free[list(self.fixed)] = False
        return is_free

    @property
    def model_without_touch(self) -> CurveModel:
        """The model without `touch`: the contact point is fitted even after a clear snap-in."""
        return self if self.touch is None else replace(self, touch=None)

    @cached_property
    def _factors(self) -> np.ndarray | None:
        """Factors of the residuals (..., n), 0 for samples that are left out."""
        if self.samples.branch is None:
            return self.weights
        is_used = self.samples.branch != LEFT_OUT
        weights: np.ndarray = is_used * (1.0 if self.weights is None else self.weights)
        return weights

    @property
    def has_analytic_derivatives(self) -> bool:
        """True if the forward model needs no difference quotients."""
        return self.forward_model.has_analytic_derivatives

    @property
    def shortens_steps(self) -> bool:
        """True for elastic bodies without adhesion.

        In the curved valleys of modulus and work of adhesion shortened steps do not arrive.
        """
        return self.has_analytic_derivatives and not self.forward_model.has_adhesion

    def select(self, curves: np.ndarray) -> CurveModel:
        """Return the model of some curves of a batch; a model of one curve is not changed."""
        samples = self.samples.select_curves(curves)
        if samples is self.samples:
            return self
        return replace(
            self,
            forward_model=self.forward_model.select(curves),
            samples=samples,
            weights=None if self.weights is None else self.weights[curves],
        )

    def depth_coordinate(self, p: np.ndarray) -> np.ndarray:
        """Return the displacements from first contact (..., n)."""
        depth: np.ndarray = self.samples.x - p[..., self.coordinate_count, None]
        return depth

    def _forward_model_at(self, p: np.ndarray) -> ForwardModel:
        """Return the forward model; the model of a loop gets the depth where unloading begins."""
        if not isinstance(self.forward_model, LoopForwardModel) or self.samples.turn is None:
            return self.forward_model
        return self.forward_model.turned_at(self.samples.turn - p[..., self.coordinate_count])

    def unloading_errors(self, p: np.ndarray) -> np.ndarray:
        """Return the errors (m, n) of the force due to errors of the tabulated unloading."""
        model = self._forward_model_at(p)
        if not isinstance(model, LoopForwardModel) or self.samples.branch is None:
            return np.zeros((0, len(self.samples)))
        theta = p[: self.coordinate_count]
        return model.unloading_errors(theta, self.depth_coordinate(p), self.samples.branch)

    def contact_force(self, p: np.ndarray) -> np.ndarray:
        """Return the forces without the baseline (..., n)."""
        theta = p[..., : self.coordinate_count]
        return self._forward_model_at(p)(
            theta, self.depth_coordinate(p), self.samples.t, self.samples.branch
        )

    def baseline(self, p: np.ndarray) -> np.ndarray:
        """Return the baseline b0 + b1 (x - mean)/range (..., n)."""
        baseline: np.ndarray = p[..., -2, None] + p[..., -1, None] * self.baseline_coordinate
        return baseline

    def residual(self, p: np.ndarray) -> np.ndarray:
        """Return the measured minus the modelled forces (..., n)."""
        residual: np.ndarray = self.samples.force - self.baseline(p) - self.contact_force(p)
        return residual if self._factors is None else residual * self._factors

    def jacobian(self, p: np.ndarray) -> np.ndarray:
        """Return the derivatives of the modelled forces of one curve (n, p)."""
        return self.linearize(p)[:-1].T

    def linearize(self, p: np.ndarray) -> np.ndarray:
        """Return the derivatives of the modelled forces, and the residuals as the last row.

        The shape is (..., p + 1, n). Derivatives with respect to fixed parameters are 0.
        """
        depth = self.depth_coordinate(p)
        theta = p[..., : self.coordinate_count]
        force, derivatives = self._forward_model_at(p).linearize(
            theta, depth, self.samples.t, self.samples.branch
        )
        residual = self.samples.force - self.baseline(p) - force
        rows = np.empty((*depth.shape[:-1], p.shape[-1] + 1, depth.shape[-1]))
        rows[..., :-3, :] = derivatives
        rows[..., -3, :] = 1.0
        rows[..., -2, :] = self.baseline_coordinate
        if not self.is_free.all():
            rows[..., :-1, :] *= self.is_free[:, None]
        rows[..., -1, :] = residual
        return rows if self._factors is None else rows * self._factors[..., None, :]

    @property
    def sample_spacing(self) -> float:
        """Median distance between neighbouring samples [length]."""
        return float(np.median(np.abs(np.diff(self.samples.x))))

    def clip_to_bounds(self, p: np.ndarray) -> np.ndarray:
        """Return the parameters (..., p), clipped to their bounds."""
        low, high = self.forward_model.bounds
        k = self.coordinate_count
        return np.concatenate([np.clip(p[..., :k], low, high), p[..., k:]], axis=-1)

    def limit_step(self, step: np.ndarray) -> np.ndarray:
        """Return a step (..., p), shortened where a coordinate changes by too much."""
        k = self.coordinate_count
        span = np.maximum(np.ptp(self.samples.x, axis=-1, keepdims=True), 1e-300)
        # Largest change of a coordinate in a step, and of the contact point relative to the range
        # of x.
        max_step = 1.0
        max_contact_shift = 0.3
        relative_steps = np.concatenate(
            [
                np.abs(step[..., :k]) / max_step,
                np.abs(step[..., k : k + 1]) / (max_contact_shift * span),
                np.ones((*step.shape[:-1], 1)),
            ],
            axis=-1,
        )
        shortened: np.ndarray = step / relative_steps.max(axis=-1, keepdims=True)
        return shortened

    def least_squares(
        self, p: np.ndarray, noise: Metric = WHITE, rounds: int = 40
    ) -> tuple[np.ndarray, float]:
        """Minimize the weighted sum of squares of one curve; see `minimize_squares`.

        Parameters
        ----------
        p : ndarray, shape (p,)
            Initial guess.
        noise : Metric
            Covariance V of the noise, up to a factor.
        rounds : int
            Largest number of iterations.

        Returns
        -------
        p : ndarray, shape (p,)
            The parameters.
        squares : float
            The weighted sum of squares.

        Raises
        ------
        ValueError
            If the forces are not finite.
        """
        solutions, squares = minimize_squares(self, p[None], noise, rounds)
        if not math.isfinite(squares[0]):
            raise ValueError("the forces are not finite")
        return solutions[0], float(squares[0])


@dataclass(frozen=True)
class Estimate:
    """Estimate of the parameters of a model from a curve.

    Attributes
    ----------
    model : CurveModel
        The model.
    p : ndarray, shape (p,)
        Parameters [theta..., c, b0, b1], the mean over all noise models.
    ordinary_p : ndarray, shape (p,)
        Parameters by ordinary least squares.
    uncertainty : ParameterUncertainty
        Noise and covariance of the parameters.
    profiles : dict
        Intervals by profile likelihood, by index of the parameter.
    p_baseline_shift : float, optional
        Probability that the fit moves the baseline away from the samples out of contact by chance;
        None if the baseline is too short.
    """

    model: CurveModel
    p: np.ndarray
    ordinary_p: np.ndarray
    uncertainty: ParameterUncertainty
    profiles: dict[int, tuple[float, float]] = field(default_factory=dict)
    p_baseline_shift: float | None = None

    @property
    def theta(self) -> np.ndarray:
        """Transformed values of the varied keys."""
        return self.p[: self.model.coordinate_count]

    @property
    def contact_point(self) -> float:
        """Displacement x at first contact [length]."""
        return float(self.p[self.model.coordinate_count])

    @property
    def depth(self) -> float:
        """Displacement from first contact to the deepest sample [length]."""
        return float(self.model.samples.x.max()) - self.contact_point

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured minus fitted forces."""
        return self.model.residual(self.p)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals [force]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def max_force(self) -> float:
        """Largest fitted force of the contact [force]."""
        return float(np.abs(self.model.contact_force(self.p)).max())

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the parameters."""
        return self.uncertainty.sd

    def interval(self, k: int) -> tuple[float, float]:
        """Return the 95 % interval of a transformed parameter, within its bounds."""
        low, high = self.model.forward_model.parameters[k].bounds
        half_width = min(NORMAL_95 * float(self.sd[k]), FARTHEST_LOG_DISTANCE)
        lower, upper = self.profiles.get(
            k, (float(self.theta[k]) - half_width, float(self.theta[k]) + half_width)
        )
        return max(low, lower), min(high, upper)

    def is_at_bound(self, k: int) -> bool:
        """Return True if a transformed parameter is at a bound of its range."""
        low, high = self.model.forward_model.parameters[k].bounds
        value = float(self.theta[k])
        tolerance = 1e-6
        return min(value - low, high - value) < tolerance


def estimate_parameters(model: CurveModel, initial_p: np.ndarray) -> Estimate:
    """Fit a model, beginning at the parameters `initial_p`."""
    ordinary_p, _ = model.least_squares(initial_p)
    return _mean_over_noise(model, ordinary_p)


def _mean_over_noise(model: CurveModel, ordinary_p: np.ndarray) -> Estimate:
    """Return the estimate whose parameters are the mean over all noise models.

    The estimate is moved from the ordinary least squares solution towards the mean, by a fraction t
    <= 1 of the difference. The move multiplies the sum of squares by 1 + kappa t^2, and t is
    limited by the residuals, since a noise model with a long correlation time could otherwise hide
    a systematic misfit.
    """
    uncertainty = uncertainty_at(model, ordinary_p)
    if not uncertainty.step.any():
        return Estimate(model, ordinary_p, ordinary_p, uncertainty)
    ordinary_squares = _mean_square(model, ordinary_p)
    p = model.clip_to_bounds(ordinary_p + model.limit_step(uncertainty.step))
    largest_rise = MAX_RMS_RATIO**2 - 1.0
    # Steps are shortened again where the model is not linear.
    for _ in range(10):
        rise = _mean_square(model, p) / max(ordinary_squares, 1e-300) - 1.0
        if rise <= (1.0 + 1e-6) * largest_rise:
            return Estimate(model, p, ordinary_p, uncertainty_at(model, p))
        fraction = math.sqrt(largest_rise / rise) if math.isfinite(rise) else 0.1
        p = ordinary_p + fraction * (p - ordinary_p)
    return Estimate(model, ordinary_p, ordinary_p, uncertainty)


def uncertainty_at(
    model: CurveModel, p: np.ndarray, noises: Sequence[Noise] | None = None
) -> ParameterUncertainty:
    """Return the uncertainty of the parameters at `p`, which is 0 for fixed parameters."""
    free_model = model.model_without_touch
    is_free = free_model.is_free
    uncertainty = average_over_noise(free_model.jacobian(p)[:, is_free], model.residual(p), noises)
    covariance = np.zeros((len(is_free), len(is_free)))
    step = np.zeros(len(is_free))
    covariance[np.ix_(is_free, is_free)] = uncertainty.covariance
    step[is_free] = uncertainty.step
    covariance, step = _observe_touch(covariance, step, model, p, uncertainty.s2)
    return replace(uncertainty, covariance=covariance, step=step)


def _observe_touch(
    covariance: np.ndarray, step: np.ndarray, model: CurveModel, p: np.ndarray, s2: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return covariance and mean step of the parameters, with the snap-in as a further observation.

    A clear snap-in lies between two samples. It is treated as an observation of the contact point
    in the middle between these samples, with the standard deviation of a uniform distribution.
    """
    index = model.coordinate_count
    touch = _touch_of(model, p, s2)
    if touch is None or index in model.fixed or model.origin.contact_point is not None:
        return covariance, step
    column = covariance[index]
    gain = column / (spread_of_uniform(touch) ** 2 + column[index])
    innovation = 0.5 * (touch[0] + touch[1]) - p[index] - step[index]
    return covariance - np.outer(gain, column), step + gain * innovation


def _touch_of(model: CurveModel, p: np.ndarray, s2: float) -> tuple[float, float] | None:
    """Return displacements [length] between which the tip snapped in; None if it is not clear.

    If the samples have no branches, as in a planned measurement, the contact point is assumed in
    the middle between two samples.
    """
    if model.touch is not None or model.samples.branch is not None:
        return model.touch
    if _snap_in_force(model, p) < CLEAR_SNAP_DEVIATIONS * math.sqrt(s2):
        return None
    contact_point = float(p[model.coordinate_count])
    half_spacing = 0.5 * model.sample_spacing
    return contact_point - half_spacing, contact_point + half_spacing


def _snap_in_force(model: CurveModel, p: np.ndarray) -> float:
    """Return the force at snap-in [force]; 0 for a tip without adhesion."""
    if not model.forward_model.has_adhesion:
        return 0.0
    theta = p[: model.coordinate_count]
    zero_depth = np.array([0.0])
    return abs(float(model.forward_model.force_without_spring(theta)(zero_depth)[0]))


def standard_deviation(estimate: Estimate, k: int, fixed: Sequence[int] = ()) -> float:
    """Return the standard deviation of one parameter of a fit.

    It is s sqrt((J'V^-1 J)^-1_kk), with the Jacobian J, the noise covariance s^2 V and the
    parameter's index k.

    Parameters
    ----------
    estimate : Estimate
        The fit.
    k : int
        Index of the transformed parameter.
    fixed : sequence of int
        Other parameters that are assumed to be known.

    Returns
    -------
    float
        The standard deviation with the most likely noise; infinite if no force depends on the
        parameter.
    """
    model = replace(estimate.model, fixed=estimate.model.fixed | set(fixed))
    is_free = model.model_without_touch.is_free
    noise = estimate.uncertainty.likeliest_noise
    J = model.model_without_touch.jacobian(estimate.p)
    scale = np.sqrt((J * J).sum(axis=0))
    if not scale[k] > 0:
        return math.inf if is_free[k] else 0.0
    J = J[:, is_free] / np.where(scale > 0, scale, 1.0)[is_free]
    gram = noise.gram(np.vstack([J.T, estimate.residual]))
    inverse = solve_normal_equations(gram).covariance
    covariance = np.zeros((len(is_free), len(is_free)))
    covariance[np.ix_(is_free, is_free)] = (
        estimate.uncertainty.s2 * inverse / np.outer(scale[is_free], scale[is_free])
    )
    covariance, _ = _observe_touch(
        covariance, np.zeros(len(is_free)), model, estimate.p, estimate.uncertainty.s2
    )
    return math.sqrt(max(float(covariance[k, k]), 0.0))


def _mean_square(model: CurveModel, p: np.ndarray) -> float:
    """Return the mean square of the residuals [force^2]; infinite where there is no solution."""
    try:
        return float(np.mean(model.residual(p) ** 2))
    except ForwardModelUnavailable:
        return math.inf


def _rms_residual(model: CurveModel, p: np.ndarray) -> float:
    return math.sqrt(_mean_square(model, p))


def reject_without_signal(samples: Samples) -> None:
    """Raise FitRejected for a curve without a contact, with too few points, or saturated."""
    n = len(samples)
    force = samples.force
    if n < MIN_POINTS:
        raise FitRejected(f"{n} points" if n != 1 else "1 point")
    for name, values in (("depth", samples.x), ("force", force)):
        if not np.ptp(values) > 0:
            raise FitRejected(f"no contact: the {name} does not change")
    saturated_count = int(np.count_nonzero(force >= force.max() - 1e-12 * np.ptp(force)))
    if saturated_count > max(SATURATED_FRACTION * n, MAX_SATURATED):
        raise FitRejected(f"saturated: {saturated_count} points at the largest force")
    block_size = n / SIGNAL_BLOCKS
    block_means = samples.block_means(SIGNAL_BLOCKS).force
    noise = 1.48 * float(np.median(np.abs(np.diff(force)))) / math.sqrt(2.0)
    if np.ptp(block_means) < 3.0 * noise + 6.0 * noise / math.sqrt(block_size):
        raise FitRejected("no contact: the force does not rise above its noise")


def initial_guesses(
    forward_model: ForwardModel, samples: Samples, origin: OriginOptions
) -> list[np.ndarray]:
    """Return initial guesses of the parameters, the best first.

    Several contact points and parameter values are tried; the baseline and the scale of the force
    follow from a linear least-squares problem.
    """
    pilot = samples.block_means(MAX_PILOT_SAMPLES)
    if isinstance(forward_model, LoopForwardModel):
        return _loop_guesses(forward_model, pilot, origin)
    # 80 trial contact points between the second and the 97th percentile of x.
    percentiles = (
        np.percentile(pilot.x, np.linspace(2.0, 97.0, 80)) if origin.contact_point is None else []
    )
    if origin.level is not None and origin.contact_point is None:
        # A curve without a baseline may begin deep in contact.
        begin = float(pilot.x.min())
        before = begin - np.ptp(pilot.x) * np.linspace(1.0, 0.02, 40)
        percentiles = np.concatenate([before, percentiles])
    contact_points = np.array(
        percentiles if origin.contact_point is None else [origin.contact_point]
    )
    compliance = forward_model.experiment.compliance
    depth = pilot.x - compliance * (pilot.force - baseline_level(pilot))
    has_scale = forward_model.scale_index is not None
    guesses = [
        _best_contact_point(
            forward_model, theta, pilot, depth, contact_points, origin.has_slope, has_scale
        )
        for theta in _trial_coordinates(forward_model)
    ]
    return [_replace_known_baseline(p, pilot, origin) for p in _best_guesses(guesses)]


def _best_guesses(guesses: Sequence[tuple[float, np.ndarray]]) -> list[np.ndarray]:
    """Return the parameters with the smallest finite sums of squares, the best first."""
    # Number of initial guesses from which the fit is iterated to convergence.
    max_guesses = 3
    possible = [guess for guess in guesses if math.isfinite(guess[0])]
    return [p for _, p in sorted(possible, key=lambda guess: guess[0])[:max_guesses]]


def _loop_guesses(
    forward_model: LoopForwardModel, samples: Samples, origin: OriginOptions
) -> list[np.ndarray]:
    """Return an initial guess for a loop, from its loading curve and its unloading stiffness.

    The root of the force of loading is a line in the depth, whose zero is the contact point.
    """
    level = baseline_level(samples)
    force = samples.force - level
    rise = float(force.max())
    is_unloading = (
        np.zeros(len(samples), dtype=bool) if samples.branch is None else samples.branch == RETRACT
    )
    compliance = forward_model.experiment.compliance
    depth = samples.x - compliance * force
    # Part of the largest force in which the contact is deep enough, and part of unloading that is
    # nearly a line of the root of the force.
    loading = ~is_unloading & (force > 0.15 * rise)
    top = is_unloading & (force > 0.5 * rise) & (force < 0.97 * rise)
    if np.count_nonzero(loading) < 3:
        return []
    slope, intercept = np.polyfit(depth[loading], np.sqrt(force[loading]), 1)
    if not slope > 0:
        return []
    contact_point = -intercept / slope if origin.contact_point is None else origin.contact_point
    stiffness = None
    if samples.turn is not None and np.count_nonzero(top) >= 3:
        deepest = samples.turn - compliance * rise
        fall = np.polyfit(depth[top] - deepest, force[top], 2)
        relative = float(fall[1] / fall[2]) * (deepest - contact_point) if fall[2] > 0 else None
        stiffness = relative if relative is not None and relative > 0 else None
    theta = forward_model.coordinates_of(float(slope) ** 2, stiffness)
    p = np.array([*theta, contact_point, level, 0.0])
    return [_replace_known_baseline(p, samples, origin)]


def baseline_level(samples: Samples) -> float:
    """Return the median force of the tenth of the samples that is farthest from the body."""
    far_samples = np.argsort(samples.x, kind="stable")[: max(3, len(samples) // 10)]
    return float(np.median(samples.force[far_samples]))


def _trial_coordinates(
    forward_model: ForwardModel, roles: Sequence[Role] = NONLINEAR_ROLES
) -> list[np.ndarray]:
    """Return the parameters of the scene, and copies with one parameter of some roles changed."""
    initial = forward_model.initial_coordinates
    trials = [initial]
    # Offsets of the trial values of theta from that of the scene, for logarithmic and for linear
    # parameters.
    log_offsets = (0.0, -1.2, 1.2, -2.4, 2.4)
    linear_offsets = (0.0, -0.1, 0.1)
    for k, parameter in enumerate(forward_model.parameters):
        if parameter.role in roles:
            for offset in (linear_offsets if parameter.is_linear else log_offsets)[1:]:
                trial = initial.copy()
                trial[k] = float(np.clip(initial[k] + offset, *parameter.bounds))
                trials.append(trial)
    return trials


def _best_contact_point(
    forward_model: ForwardModel,
    theta: np.ndarray,
    samples: Samples,
    depth: np.ndarray,
    contact_points: np.ndarray,
    has_slope: bool,
    has_scale: bool,
) -> tuple[float, np.ndarray]:
    """Return sum of squares and parameters of the best trial contact point.

    The sum of squares is infinite if no contact point is possible.
    """
    try:
        force_at_depth = forward_model.force_without_spring(theta)
    except ForwardModelUnavailable:
        return math.inf, theta
    f = force_at_depth(depth - contact_points[:, None])
    if samples.branch is not None:
        f[:, samples.branch < LEFT_OUT] = 0.0
    fits = fit_trials(samples.x, samples.force, f, has_slope, has_scale)
    best = int(np.argmin(fits.squares))
    if not math.isfinite(fits.squares[best]):
        return math.inf, theta
    coordinates = theta.copy()
    if has_scale:
        # Force and adhesion of a body are proportional to its modulus.
        is_scaled = [one.role in ("scale", "work") for one in forward_model.parameters]
        coordinates[is_scaled] += math.log(fits.amplitude[best])
    baseline = (fits.level[best], fits.slope[best])
    return float(fits.squares[best]), np.array([*coordinates, contact_points[best], *baseline])


def fit_model(
    forward_model: ForwardModel,
    samples: Samples,
    origin: OriginOptions,
    near: Estimate | None = None,
) -> Estimate:
    """Fit a scene to a curve.

    Parameters
    ----------
    forward_model : ForwardModel
        Forces of the scene.
    samples : Samples
        The curve.
    origin : OriginOptions
        Options of contact point and baseline.
    near : Estimate, optional
        Fit of a similar model to this curve, used as the only initial guess.

    Returns
    -------
    Estimate
        The best fit.

    Raises
    ------
    FitRejected
        If the curve has no contact or does not determine the parameters.
    """
    if forward_model.has_adhesion:
        return _fit_adhesive_tip(forward_model, samples, origin)
    pilot_model = CurveModel(forward_model, samples.block_means(MAX_PILOT_SAMPLES), origin)
    guesses = (
        initial_guesses(forward_model, samples, origin)
        if near is None
        else [convert_baseline(near.model, pilot_model, near.p)]
    )
    if not guesses:
        negated_samples = Samples(samples.x, -samples.force, samples.t)
        sign_hint = (
            " (it falls; the force of a tip that is pressed in has to be positive: with "
            "--columns, a minus before the column of the force reverses its sign)"
            if initial_guesses(forward_model, negated_samples, origin)
            else ""
        )
        raise FitRejected(f"no contact: the force does not rise with the depth{sign_hint}")
    solutions = [_try_least_squares(pilot_model, start) for start in guesses]
    best = min(
        (solution for solution in solutions if solution),
        key=lambda solution: solution[1],
        default=None,
    )
    if best is None:
        raise FitRejected("no contact: no fit was found")
    near_samples = samples_near_contact(samples, float(best[0][len(forward_model.parameters)]))
    if len(near_samples) < MIN_POINTS:
        raise FitRejected(f"no contact: {len(near_samples)} points in contact")
    model = CurveModel(forward_model, near_samples, origin)
    estimate = estimate_parameters(model, convert_baseline(pilot_model, model, best[0]))
    _reject_weak_signal(estimate)
    return _test_baseline(estimate)


def _test_baseline(estimate: Estimate) -> Estimate:
    """Return the estimate with `p_baseline_shift`, from an F test of its baseline.

    The baseline is compared with the samples out of contact.
    """
    model = estimate.model
    is_out = samples_out_of_contact(model, estimate.p)
    return replace(
        estimate,
        p_baseline_shift=baseline_shift_probability(
            model.samples.x[is_out],
            estimate.residual[is_out],
            model.origin.has_slope,
        ),
    )


def samples_out_of_contact(model: CurveModel, p: np.ndarray) -> np.ndarray:
    """Return True for the samples (n,) of the baseline.

    Without known branches these are the samples before a snap-in could be.
    """
    if model.samples.branch is not None and not model.forward_model.follows_loop:
        return model.samples.branch < LEFT_OUT
    contact_point = float(p[model.coordinate_count])
    depth = float(model.samples.x.max()) - contact_point
    is_out: np.ndarray = model.samples.x < contact_point - CONTACT_MARGIN * depth
    return is_out


def _fit_adhesive_tip(
    forward_model: ForwardModel, samples: Samples, origin: OriginOptions
) -> Estimate:
    """Fit a scene with an adhesive tip to a curve; reject a curve on which no contact is found."""
    model, p, weak_sides = fit_adhesive_pilot(forward_model, samples, origin)
    contact_point = float(p[model.coordinate_count])
    near_model = replace(model, samples=samples_near_contact(model.samples, contact_point))
    if len(near_model.samples) < MIN_POINTS:
        raise FitRejected(f"no contact: {len(near_model.samples)} points in contact")
    estimate = estimate_adhesive_tip(near_model, convert_baseline(model, near_model, p), weak_sides)
    _reject_weak_signal(estimate)
    return estimate


def _replace_known_baseline(p: np.ndarray, samples: Samples, origin: OriginOptions) -> np.ndarray:
    """Return the parameters (p,) with the known values in place of the fitted baseline."""
    if origin.level is None:
        return p
    mean = float(samples.x.mean())
    span = float(np.ptp(samples.x))
    return np.array([*p[:-2], origin.level + origin.slope * mean, origin.slope * span])


def fit_adhesive_pilot(
    forward_model: ForwardModel, samples: Samples, origin: OriginOptions
) -> tuple[CurveModel, np.ndarray, tuple[int, ...]]:
    """Fit an adhesive tip to block means of a curve, whose jumps separate its branches.

    Returns
    -------
    model : CurveModel
        The model of all samples, with their branches.
    p : ndarray, shape (p,)
        The parameters.
    weak_sides : tuple of int
        Sides of the curve whose jump is neither clear nor placed yet; jumps are placed in the
        samples themselves, if these are few enough for the pilot fit.
    """
    jumps = find_jumps(samples.x, samples.force, _sides(samples))
    touch = jumps.touch if origin.contact_point is None else None
    model = CurveModel(forward_model, replace(samples, branch=jumps.branch), origin, touch=touch)
    pilot_model = replace(model, samples=model.samples.block_means(MAX_PILOT_SAMPLES))
    guesses = _adhesive_guesses(pilot_model)
    if not guesses:
        raise FitRejected("no contact: the force does not rise with the depth")
    theta = guesses[0][: model.coordinate_count]
    depth = float(samples.x.max()) - float(guesses[0][model.coordinate_count])
    forward_model = forward_model.bound_work(
        forward_model.work_of_shift(theta, SMALLEST_SHIFT * depth)
    )
    model, pilot_model = (replace(one, forward_model=forward_model) for one in (model, pilot_model))
    trials = []
    for guess in guesses:
        try:
            trials.append(place_jumps(pilot_model, guess, jumps.weak_sides))
        except (ForwardModelUnavailable, ValueError, np.linalg.LinAlgError):
            continue
    if not trials:
        raise FitRejected("no contact: no fit was found")
    placed_model, p, _ = min(trials, key=lambda trial: trial[2])
    if pilot_model.samples is model.samples:
        return placed_model, p, ()
    return model, convert_baseline(pilot_model, model, p), jumps.weak_sides


def _sides(samples: Samples) -> np.ndarray:
    """Return APPROACH or RETRACT for every sample."""
    return sides_of(samples.x) if samples.branch is None else np.abs(samples.branch)


def estimate_adhesive_tip(
    model: CurveModel, p: np.ndarray, weak_sides: tuple[int, ...]
) -> Estimate:
    """Fit an adhesive tip, beginning at the parameters `p`.

    If the contact moves the baseline away from the samples out of contact, the scene does not
    explain the contact. The fit is then repeated with the baseline of these samples.
    """
    estimate = _test_baseline(_estimate_with_jumps(model, p, weak_sides))
    p_shift = estimate.p_baseline_shift
    if p_shift is None or p_shift >= WRONG_BASELINE_P:
        return estimate
    count = model.coordinate_count
    held_model = replace(estimate.model, fixed=model.fixed | {count + 1, count + 2})
    held_p = _refit_baseline(estimate)
    held_estimate = _estimate_with_jumps(held_model, held_p, weak_sides)
    return replace(held_estimate, p_baseline_shift=p_shift)


def _refit_baseline(estimate: Estimate) -> np.ndarray:
    """Return the parameters with the least-squares baseline of the samples out of contact."""
    model = estimate.model
    p = estimate.p.copy()
    is_out = samples_out_of_contact(model, p)
    columns = baseline_columns(model.baseline_coordinate[is_out], model.origin.has_slope)
    correction = np.linalg.lstsq(columns, estimate.residual[is_out], rcond=None)[0]
    p[model.coordinate_count + 1 : model.coordinate_count + 1 + len(correction)] += correction
    return p


def _estimate_with_jumps(model: CurveModel, p: np.ndarray, weak_sides: tuple[int, ...]) -> Estimate:
    """Fit an adhesive tip and its jumps, beginning at the parameters `p`."""
    model, ordinary_p, _ = place_jumps(model, p, weak_sides)
    if model.touch is not None:
        # The force in contact may determine the contact point better than the snap-in does.
        ordinary_p = ordinary_p + uncertainty_at(model, ordinary_p, (WHITE,)).step
        ordinary_p, _ = model.least_squares(ordinary_p)
    return _mean_over_noise(model, ordinary_p)


def place_jumps(
    model: CurveModel, p: np.ndarray, weak_sides: tuple[int, ...]
) -> tuple[CurveModel, np.ndarray, float]:
    """Fit an adhesive tip, and place a snap-in or pull-off that the noise hides (see `jumps`).

    The placing of these jumps alternates with the fit.

    Returns
    -------
    model : CurveModel
        The model with the branch of every sample and, if the snap-in is clear, with the
        displacements between which the tip snapped in (`touch`).
    p : ndarray, shape (p,)
        The parameters by ordinary least squares.
    squares : float
        The sum of squares.
    """
    p = _move_to_touch(model, p)
    if not weak_sides:
        return model, *model.least_squares(p)
    branch = _branch_by_model(model, p, weak_sides)
    if APPROACH in weak_sides and model.origin.contact_point is None:
        branch, p = _search_touch(replace(model, samples=replace(model.samples, branch=branch)), p)
    max_rounds = 6
    for _ in range(max_rounds):
        model = replace(model, samples=replace(model.samples, branch=branch))
        p, squares = model.least_squares(p)
        next_branch = _branch_of_least_squares(model, p, weak_sides)
        if np.array_equal(next_branch, branch):
            break
        branch = next_branch
    touch = touch_interval(model.samples.x, branch)
    if APPROACH not in weak_sides or model.origin.contact_point is not None or touch is None:
        return model, p, squares
    first_force = model.contact_force(p)[np.argmax(branch == APPROACH)]
    if abs(first_force) < CLEAR_SNAP_DEVIATIONS * _rms_residual(model, p):
        return model, p, squares
    model = replace(model, touch=touch)
    return model, *model.least_squares(_move_to_touch(model, p))


def _search_touch(model: CurveModel, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return branches (n,) and parameters for the snap-in with the smallest sum of squares.

    The sum of squares jumps where the snap-in passes a sample, at which a descent iteration would
    stop. Therefore all intervals between samples near the contact point are tried.
    """
    samples = model.samples
    assert samples.branch is not None
    approach = np.flatnonzero(np.abs(samples.branch) == APPROACH)
    # Samples at a larger displacement than all earlier ones; the snap-in lies just before one of
    # them.
    farthest = np.maximum.accumulate(samples.x[approach])
    first_samples = approach[1:][farthest[1:] > farthest[:-1]]
    contact_point = float(p[model.coordinate_count])
    center = int(np.searchsorted(samples.x[first_samples], contact_point))
    # Number of samples tried on each side of the center, and moves of the center to the best trial.
    reach = 6
    max_moves = 6
    best: tuple[float, int, np.ndarray, np.ndarray] = (math.inf, -1, samples.branch, p)
    for _ in range(max_moves):
        indices = range(max(center - reach, 0), min(center + reach + 1, len(first_samples)))
        squares, branches, solutions = _try_touches(model, best[3], first_samples[indices])
        k = int(np.argmin(squares))
        if not squares[k] < best[0]:
            break
        is_same = indices[k] == best[1]
        best = float(squares[k]), indices[k], branches[k], solutions[k]
        if is_same:
            break
        center = best[1]
    return best[2], best[3]


def _try_touches(
    model: CurveModel, p: np.ndarray, first_samples: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit a curve with its snap-in just before one of several samples.

    Parameters
    ----------
    model : CurveModel
        The model.
    p : ndarray, shape (p,)
        Parameters with which the iterations begin.
    first_samples : ndarray of int, shape (B,)
        Indices of the samples just after the snap-in.

    Returns
    -------
    squares : ndarray, shape (B,)
        The sums of squares after some iterations.
    branches : ndarray of int, shape (B, n)
        The branches of the samples.
    p : ndarray, shape (B, p)
        The parameters.
    """
    samples = model.samples
    assert samples.branch is not None
    is_before = np.arange(len(samples)) < first_samples[:, None]
    is_approach = np.abs(samples.branch) == APPROACH
    branches = np.where(is_approach, np.where(is_before, -APPROACH, APPROACH), samples.branch)
    starts = np.tile(p, (len(first_samples), 1))
    starts[:, model.coordinate_count] = 0.5 * (
        samples.x[first_samples - 1] + samples.x[first_samples]
    )
    trials = replace(
        model,
        samples=replace(samples, branch=branches),
        fixed=model.fixed | {model.coordinate_count},
    )
    iterations = 4
    solutions, squares = minimize_squares(trials, starts, WHITE, iterations)
    return squares, branches, solutions


def _move_to_touch(model: CurveModel, p: np.ndarray) -> np.ndarray:
    """Return the parameters with the contact point in the middle of `touch`, if that is known."""
    p = p.copy()
    if model.touch is not None:
        p[model.coordinate_count] = 0.5 * sum(model.touch)
    return p


def _branch_by_model(model: CurveModel, p: np.ndarray, weak_sides: tuple[int, ...]) -> np.ndarray:
    """Return the branches (n,); on sides without a clear jump the model predicts them."""
    samples = model.samples
    assert samples.branch is not None
    side = np.abs(samples.branch)
    is_out = model.forward_model(p[: model.coordinate_count], model.depth_coordinate(p)) == 0.0
    branch: np.ndarray = np.where(
        np.isin(side, weak_sides), np.where(is_out, -side, side), samples.branch
    )
    return branch


def _branch_of_least_squares(
    model: CurveModel, p: np.ndarray, weak_sides: tuple[int, ...]
) -> np.ndarray:
    """Return the branches (n,) with the least squares at the parameters p.

    If the contact point is given, the snap-in lies within a few samples of the contact point.
    Otherwise the snap-in has been found by `_search_touch`, and does not move.
    """
    samples = model.samples
    assert samples.branch is not None
    side = np.abs(samples.branch)
    depth = model.depth_coordinate(p)
    # Largest distance of a snap-in from the contact point, in samples.
    max_distance = 3.5
    is_near = np.abs(depth) <= max_distance * model.sample_spacing
    may_move = np.isin(side, weak_sides) & ((side != APPROACH) | is_near)
    if model.origin.contact_point is None:
        may_move &= side != APPROACH
    force = samples.force - model.baseline(p)
    theta = p[: model.coordinate_count]
    contact_force = model.forward_model(theta, depth, samples.t, side)
    squares_in = (force - contact_force) ** 2
    return best_branches(samples.branch, force**2, squares_in, may_move)


def _adhesive_guesses(model: CurveModel) -> list[np.ndarray]:
    """Return initial guesses of the parameters of an adhesive tip, the best first.

    Without a clear snap-in they are the minima of the sum of squares over the ratio of adhesion and
    modulus.
    """
    samples = model.samples
    origin = model.origin
    forward_model = model.forward_model
    is_weak = origin.contact_point is None and model.touch is None
    if origin.contact_point is not None:
        contact_points = np.array([origin.contact_point])
    elif model.touch is not None:
        contact_points = np.array([0.5 * sum(model.touch)])
    else:
        contact_points = np.percentile(samples.x, np.linspace(2.0, 97.0, 80))
    compliance = forward_model.experiment.compliance
    depth = samples.x - compliance * (samples.force - baseline_level(samples))
    assert samples.branch is not None
    is_used = samples.branch != LEFT_OUT
    used = samples.select(is_used)
    guesses: list[tuple[float, np.ndarray]] = []
    for trials, has_scale in _adhesive_trials(forward_model, depth.max() - contact_points.min()):
        row = [
            _best_contact_point(
                forward_model,
                theta,
                used,
                depth[is_used],
                contact_points,
                origin.has_slope,
                has_scale,
            )
            for theta in trials
        ]
        if is_weak:
            # Neighbours of a minimum lead to the same fit.
            squares = np.array([math.inf, *(guess[0] for guess in row), math.inf])
            minima = np.flatnonzero((squares[1:-1] <= squares[:-2]) & (squares[1:-1] < squares[2:]))
            row = [row[k] for k in minima]
        guesses += row
    return _best_guesses(guesses)


def _adhesive_trials(
    forward_model: ForwardModel, depth: float
) -> Iterator[tuple[list[np.ndarray], bool]]:
    """Yield rows of trial values of theta, and whether force and adhesion are scaled together.

    The ratio of work of adhesion and modulus is unknown in advance. The ratios of a row range from
    one that hardly shifts the largest contact to one that shifts it by twice the depth. A ratio is
    set by the work if the work is varied, otherwise by the modulus.
    """
    shifts = depth * np.geomspace(0.01, 2.0, 24)
    works = [k for k, one in enumerate(forward_model.parameters) if one.role == "work"]
    scale_index = forward_model.scale_index
    adhesion = forward_model.experiment.adhesion
    assert adhesion is not None
    for initial in _trial_coordinates(forward_model, ("shape", "spring")):
        if not works and scale_index is None:
            yield [initial], False
            continue
        row = []
        for shift in shifts:
            theta = initial.copy()
            log_work = math.log(forward_model.work_of_shift(theta, shift))
            theta[works] = log_work
            if not works:
                theta[scale_index] += math.log(adhesion.work) - log_work
            row.append(theta)
        yield row, bool(works) and scale_index is not None


def _try_least_squares(model: CurveModel, initial_p: np.ndarray) -> tuple[np.ndarray, float] | None:
    try:
        return model.least_squares(initial_p)
    except (ForwardModelUnavailable, ValueError, np.linalg.LinAlgError):
        return None


def samples_near_contact(samples: Samples, contact_point: float) -> Samples:
    """Return the samples in contact and their neighbours out of contact.

    A long baseline with systematic deviations would dominate the fit.
    """
    depth = float(samples.x.max()) - contact_point
    span = float(np.ptp(samples.x))
    return samples.select(
        samples.x > contact_point - max(MAX_BASELINE_DEPTHS * depth, MIN_BASELINE_FRACTION * span)
    ).block_means(MAX_SAMPLES)


def convert_baseline(old: CurveModel, new: CurveModel, p: np.ndarray) -> np.ndarray:
    """Return the parameters for other samples (model `new`) that keep the baseline unchanged."""
    old_range = float(np.ptp(old.samples.x))
    new_range = float(np.ptp(new.samples.x))
    slope = p[-1] / max(old_range, 1e-300)
    level = p[-2] + slope * (float(new.samples.x.mean()) - float(old.samples.x.mean()))
    return np.array([*p[:-2], level, slope * new_range])


def _reject_weak_signal(estimate: Estimate) -> None:
    branch = estimate.model.samples.branch
    is_in_contact = (
        estimate.model.samples.x > estimate.contact_point if branch is None else branch > LEFT_OUT
    )
    contact_count = int(np.count_nonzero(is_in_contact))
    if contact_count < MIN_CONTACT_POINTS:
        raise FitRejected(f"no contact: {contact_count} points in contact")
    # Residuals of an adhesive contact may be a misfit; the samples out of contact show the noise.
    noise = estimate.rms
    if branch is not None and not is_in_contact.all():
        noise = min(noise, float(np.std(estimate.residual[branch < LEFT_OUT])))
    if estimate.max_force < MIN_SIGNAL_TO_NOISE * noise:
        raise FitRejected("no contact: the force does not rise above its noise")
    for k, parameter in enumerate(estimate.model.forward_model.parameters):
        factor = (
            math.exp(min(NORMAL_95 * float(estimate.sd[k]), 100.0))
            if parameter.role == "scale"
            else 1.0
        )
        if factor > MAX_UNCERTAINTY_FACTOR:
            raise FitRejected(f"{parameter.key} is known to a factor of {factor:.2g} only")
