"""Estimate of the parameters of one material from the loops of several tips together.

    r_i = F_i - b_i - f_i(x - c_i; theta) - E_i a_i
    minimize sum r_i'V_i^-1 r_i/s_i^2 + sum a_i'a_i

theta is common to all curves; contact point c_i, baseline b_i and the amplitudes a_i of the errors
E_i of tabulated loops belong to one. The amplitudes have a normal distribution with the standard
deviation 1. These errors are as large as the noise or larger, and without them the curve with the
least noise would determine theta alone. Noise V_i and its variance s_i^2 are those of the fit of
each curve alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.inference.estimate import (
    CurveModel,
    Estimate,
    FitRejected,
    standard_deviation,
)
from indent_sim.fitting.inference.jumps import LEFT_OUT
from indent_sim.fitting.inference.least_squares import minimize_squares
from indent_sim.fitting.inference.noise import (
    NORMAL_95,
    WHITE,
    Noise,
    f_test,
    solve_normal_equations,
)
from indent_sim.fitting.inference.profile_likelihood import WIDE_HALF_WIDTH, profile_end

# Largest number of accepted steps of the least squares, and along a profile.
MAX_ROUNDS = 80
PROFILE_ROUNDS = 15


@dataclass(frozen=True)
class JointNoise:
    """Covariance of the residuals of several curves, and of the amplitudes after them.

    Attributes
    ----------
    noises
        Noise of each curve.
    variances
        Variance of each noise [force^2].
    """

    noises: tuple[Noise, ...]
    variances: tuple[float, ...]
    lengths: tuple[int, ...]

    def gram(self, X: np.ndarray) -> np.ndarray:
        """Return X'V^-1 X (..., c, c); the c columns of X are stored as rows (..., c, n)."""
        *curves, amplitudes = np.split(X, np.cumsum(self.lengths), axis=-1)
        parts = zip(self.noises, self.variances, curves, strict=True)
        return sum(
            (noise.gram(part) / variance for noise, variance, part in parts),
            start=WHITE.gram(amplitudes),
        )


@dataclass(frozen=True)
class JointModel:
    """Model of several curves with parameters [theta, (c, b0, b1, amplitudes) of each] (..., p).

    Attributes
    ----------
    models
        Model of each curve, with the same varied keys.
    errors
        Errors (m, n) of the force of each curve, as standard deviations.
    fixed
        Indices of parameters that are not fitted.
    """

    models: tuple[CurveModel, ...]
    errors: tuple[np.ndarray, ...]
    fixed: frozenset[int] = field(default_factory=frozenset)

    @property
    def has_analytic_derivatives(self) -> bool:
        """False: derivatives of loops are difference quotients."""
        return False

    @property
    def shortens_steps(self) -> bool:
        """False, since the additional evaluation is expensive."""
        return False

    @property
    def coordinate_count(self) -> int:
        """Number of transformed parameters theta."""
        return self.models[0].coordinate_count

    @property
    def lengths(self) -> tuple[int, ...]:
        """Number of samples of each curve."""
        return tuple(len(model.samples) for model in self.models)

    @cached_property
    def _slices(self) -> tuple[slice, ...]:
        """Parameters of each curve besides theta."""
        ends = np.cumsum([self.coordinate_count, *(3 + len(errors) for errors in self.errors)])
        return tuple(slice(int(low), int(high)) for low, high in pairwise(ends))

    @property
    def parameter_count(self) -> int:
        """Number of parameters p."""
        return self._slices[-1].stop

    def own_indices(self, k: int) -> list[int]:
        """Return the indices of the parameters [theta, c, b0, b1] of a curve."""
        start = self._slices[k].start
        return [*range(self.coordinate_count), *range(start, start + 3)]

    def curve_parameters(self, p: np.ndarray, k: int) -> np.ndarray:
        """Return the parameters [theta, c, b0, b1] (..., q) of a curve."""
        return p[..., self.own_indices(k)]

    def joined_parameters(self, theta: np.ndarray, curves: Sequence[np.ndarray]) -> np.ndarray:
        """Return the parameters (p,) with the last three of each curve's, and amplitudes of 0."""
        p = np.zeros(self.parameter_count)
        p[: self.coordinate_count] = theta
        for place, parameters in zip(self._slices, curves, strict=True):
            p[place.start : place.start + 3] = parameters[-3:]
        return p

    @cached_property
    def is_free(self) -> np.ndarray:
        """True for the parameters that are fitted (p,)."""
        is_free = np.ones(self.parameter_count, dtype=bool)
        for place, model in zip(self._slices, self.models, strict=True):
            is_free[place.start : place.start + 3] = model.is_free[-3:]
        is_free[list(self.fixed)] = False
        return is_free

    def select(self, curves: np.ndarray) -> JointModel:
        """Return the model itself, which is no batch."""
        return self

    def residual(self, p: np.ndarray) -> np.ndarray:
        """Return the residuals of all curves, and the amplitudes with a minus (..., n)."""
        parts = []
        amplitudes = []
        for k, (place, model, errors) in enumerate(
            zip(self._slices, self.models, self.errors, strict=True)
        ):
            a = p[..., place][..., 3:]
            parts.append(model.residual(self.curve_parameters(p, k)) - a @ errors)
            amplitudes.append(-a)
        return np.concatenate([*parts, *amplitudes], axis=-1)

    def linearize(self, p: np.ndarray) -> np.ndarray:
        """Return the derivatives of the modelled forces, and the residuals (..., p + 1, n)."""
        count = self.coordinate_count
        residual = self.residual(p)
        rows = np.zeros((*p.shape[:-1], p.shape[-1] + 1, residual.shape[-1]))
        ends = np.cumsum(self.lengths)
        amplitude_row = int(ends[-1])
        for k, (place, model, errors) in enumerate(
            zip(self._slices, self.models, self.errors, strict=True)
        ):
            here = slice(int(ends[k]) - len(model.samples), int(ends[k]))
            derivatives = model.linearize(self.curve_parameters(p, k))
            rows[..., :count, here] = derivatives[..., :count, :]
            rows[..., place.start : place.start + 3, here] = derivatives[..., count : count + 3, :]
            first = place.start + 3
            rows[..., first : place.stop, here] = errors
            for index in range(first, place.stop):
                rows[..., index, amplitude_row] = 1.0
                amplitude_row += 1
        rows[..., :-1, :] *= self.is_free[:, None]
        rows[..., -1, :] = residual
        return rows

    def clip_to_bounds(self, p: np.ndarray) -> np.ndarray:
        """Return the parameters (..., p) with theta within its bounds."""
        low, high = self.models[0].forward_model.bounds
        count = self.coordinate_count
        return np.concatenate([np.clip(p[..., :count], low, high), p[..., count:]], axis=-1)

    def limit_step(self, step: np.ndarray) -> np.ndarray:
        """Return a step (..., p), shortened as the models of the curves shorten theirs."""
        fractions = []
        for k, model in enumerate(self.models):
            curve_step = self.curve_parameters(step, k)
            size = np.linalg.norm(curve_step, axis=-1, keepdims=True)
            limited = np.linalg.norm(model.limit_step(curve_step), axis=-1, keepdims=True)
            fractions.append(limited / np.where(size > 0, size, 1.0) + (size == 0))
        shortened: np.ndarray = step * np.minimum.reduce(fractions)
        return shortened

    def covariance(self, p: np.ndarray, noise: JointNoise) -> np.ndarray:
        """Return the covariance (p, p) of the parameters; that of fixed ones is 0."""
        rows = self.linearize(p[None])[0]
        free = np.flatnonzero(self.is_free)
        scale = np.sqrt((rows[free] ** 2).sum(axis=-1))
        scale = np.where(scale > 0, scale, 1.0)
        gram = noise.gram(np.vstack([rows[free] / scale[:, None], rows[-1:]]))
        covariance = np.zeros((len(p), len(p)))
        inverse = solve_normal_equations(gram).covariance
        covariance[np.ix_(free, free)] = inverse / np.outer(scale, scale)
        return covariance


@dataclass(frozen=True)
class JointEstimate:
    """Estimate of one material from several curves.

    Attributes
    ----------
    curves
        Estimate of each curve, with the common theta and its covariance and intervals.
    p_together
        Probability that fits of the single curves are better than this one by chance.
    correlation
        Correlations (k, k) of theta.
    """

    curves: tuple[Estimate, ...]
    p_together: float
    correlation: np.ndarray

    @property
    def width_factors(self) -> list[float]:
        """Width of the interval of each theta, divided by its width if the others were known."""
        inverse = np.linalg.pinv(self.correlation)
        return np.sqrt(np.maximum(np.diag(inverse), 1.0)).tolist()


def joint_model(models: Sequence[CurveModel], curves: Sequence[np.ndarray]) -> JointModel:
    """Return the model of several curves, with the errors of their loops at parameters (q,)."""
    return JointModel(
        tuple(models),
        tuple(_loop_errors(model, p) for model, p in zip(models, curves, strict=True)),
    )


def _loop_errors(model: CurveModel, p: np.ndarray) -> np.ndarray:
    """Return the errors (m, n) of the force by those of the tabulated loop, as deviations."""
    loading = model.forward_model.relative_error * model.contact_force(p)
    branch = model.samples.branch
    is_used = 1.0 if branch is None else branch != LEFT_OUT
    return np.vstack([loading, *model.unloading_errors(p)]) * is_used / NORMAL_95


def estimate_jointly(
    estimates: Sequence[Estimate], starts: Sequence[np.ndarray] = ()
) -> JointEstimate:
    """Fit several curves together.

    Parameters
    ----------
    estimates
        Fits of the single curves.
    starts
        Further initial guesses of theta (k,).

    Raises
    ------
    FitRejected
        If no solution is found.
    """
    curves = [estimate.p for estimate in estimates]
    model = joint_model([estimate.model for estimate in estimates], curves)
    noise = JointNoise(
        tuple(estimate.uncertainty.likeliest_noise for estimate in estimates),
        tuple(_variance(estimate) for estimate in estimates),
        model.lengths,
    )
    thetas = [*starts, *(estimate.theta for estimate in estimates)]
    solutions = [
        _least_squares(model, model.joined_parameters(theta, curves), noise, MAX_ROUNDS)
        for theta in thetas
    ]
    p, squares = min(solutions, key=lambda solution: solution[1])
    if not np.isfinite(squares):
        raise FitRejected("the curves of the tips have no fit together")
    model, p, squares = _fit_with_updated_errors(model, p, noise)
    covariance = model.covariance(p, noise)
    count = model.coordinate_count
    deviations = np.sqrt(np.diag(covariance)[:count])
    profiles = _profiles(model, p, noise, deviations)
    separate = sum(_separate_squares(estimate, noise, k) for k, estimate in enumerate(estimates))
    freedom = sum(model.lengths) - model.parameter_count
    p_together = f_test(
        max(squares - separate, 0.0), count * (len(estimates) - 1), separate, freedom
    )
    joined = []
    for k, estimate in enumerate(estimates):
        curve_parameters = model.curve_parameters(p, k)
        indices = model.own_indices(k)
        uncertainty = replace(
            estimate.uncertainty,
            covariance=covariance[np.ix_(indices, indices)],
            step=np.zeros(len(indices)),
        )
        joined.append(
            Estimate(estimate.model, curve_parameters, curve_parameters, uncertainty, profiles)
        )
    correlation = covariance[:count, :count] / np.outer(deviations, deviations)
    return JointEstimate(tuple(joined), p_together, correlation)


def _fit_with_updated_errors(
    model: JointModel, p: np.ndarray, noise: JointNoise
) -> tuple[JointModel, np.ndarray, float]:
    """Return the model with the errors of loops at its own fit, and the fit with its squares."""
    # The errors change little along the fit.
    rounds = 3
    squares = np.inf
    for _ in range(rounds):
        parameters = [model.curve_parameters(p, k) for k in range(len(model.models))]
        model = joint_model(model.models, parameters)
        p, squares = _least_squares(model, p, noise, MAX_ROUNDS)
    return model, p, squares


def _variance(estimate: Estimate) -> float:
    """Return the variance of the noise, increased by what an uncertain correlation adds."""
    count = estimate.model.coordinate_count
    likeliest = [standard_deviation(estimate, k) for k in range(count)]
    ratios = estimate.sd[:count] / np.maximum(likeliest, 1e-300)
    return estimate.uncertainty.s2 * float(max(np.max(ratios), 1.0)) ** 2


def _separate_squares(estimate: Estimate, noise: JointNoise, k: int) -> float:
    """Return the sum of squares of a curve that is fitted alone, with amplitudes."""
    model = joint_model([estimate.model], [estimate.p])
    curve_noise = JointNoise((noise.noises[k],), (noise.variances[k],), model.lengths)
    p = model.joined_parameters(estimate.theta, [estimate.p])
    return _fit_with_updated_errors(model, p, curve_noise)[2]


def _least_squares(
    model: JointModel, p: np.ndarray, noise: JointNoise, rounds: int
) -> tuple[np.ndarray, float]:
    """Return the parameters (p,) of least squares, and the squares; infinite without a solution."""
    try:
        solutions, squares = minimize_squares(model, p[None], noise, rounds)
    except (ForwardModelUnavailable, ValueError, np.linalg.LinAlgError):
        return p, np.inf
    return solutions[0], float(squares[0])


def _profiles(
    model: JointModel, p: np.ndarray, noise: JointNoise, deviations: np.ndarray
) -> dict[int, tuple[float, float]]:
    """Return the intervals of theta by profile likelihood, if one of them is wide."""
    count = model.coordinate_count
    if not (NORMAL_95 * deviations > WIDE_HALF_WIDTH).any():
        half_widths = NORMAL_95 * deviations
        return {
            k: (float(p[k] - half_widths[k]), float(p[k] + half_widths[k])) for k in range(count)
        }
    return {
        k: (
            _profile_end(model, p, noise, k, -float(deviations[k])),
            _profile_end(model, p, noise, k, float(deviations[k])),
        )
        for k in range(count)
    }


def _profile_end(
    model: JointModel, p: np.ndarray, noise: JointNoise, k: int, deviation: float
) -> float:
    """Return the end of the interval of a parameter on the side of a deviation.

    See `profile_likelihood.profile_end`.
    """
    fixed_model = replace(model, fixed=frozenset({k}))
    smallest_squares = float(noise.gram(model.residual(p)[None])[0, 0])
    start = float(p[k])
    p = p.copy()

    def rise_at(value: float) -> float:
        p[k] = value
        p[:], squares = _least_squares(fixed_model, p, noise, PROFILE_ROUNDS)
        if not np.isfinite(squares):
            raise ForwardModelUnavailable("no solution along the profile")
        return max(squares - smallest_squares, 0.0)

    parameter = model.models[0].forward_model.parameters[k]
    return profile_end(rise_at, start, deviation, NORMAL_95**2, parameter)
