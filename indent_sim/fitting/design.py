"""Experimental design: intervals to be expected from a planned measurement.

With the Jacobian J of the force with respect to parameters, contact point and baseline, and white
noise of standard deviation s, the covariance of the parameters is s^2 (J'J)^-1 (Seber & Wild 2003,
ch. 5). Wide intervals are found by profile likelihood as in a fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import (
    MIN_DEPTH_FACTOR,
    SOLVED_DEPTH_FACTOR,
    format_interval,
    relative_calibration_error,
)
from indent_sim.fitting.forward_model.cone_loop import HARDENING_KEY
from indent_sim.fitting.forward_model.forward_model import (
    APPROACH,
    RETRACT,
    ForwardModel,
    relaxation_of,
)
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.loop_forward_model import LoopForwardModel
from indent_sim.fitting.forward_model.measured_path_forces import (
    MeasuredPath,
    needs_time_stepping,
    simplify_path,
)
from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.forward_model.parameters import number_at, replace_numbers
from indent_sim.fitting.inference.estimate import (
    MAX_BASELINE_DEPTHS,
    CurveModel,
    Estimate,
    Samples,
    standard_deviation,
)
from indent_sim.fitting.inference.joint_estimate import JointNoise, joint_model
from indent_sim.fitting.inference.model_assessment import (
    Interval,
    ModelAssessment,
    systematic_half_widths,
    width_inflation_factors,
)
from indent_sim.fitting.inference.noise import NORMAL_95, WHITE, ParameterUncertainty
from indent_sim.fitting.inference.profile_likelihood import add_profile_intervals
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run.planned_run import PlannedRun

BASELINE_DEPTHS = 1.0  # length of the baseline of a designed curve, in indentation depths


@dataclass(frozen=True)
class DesignImprovement:
    """Change of the experiment with the expected intervals, or the reason why it is impossible."""

    change: dict[str, Any]
    parameters: dict[str, Interval]
    reason: str = ""


@dataclass(frozen=True)
class Design:
    """Expected intervals of the parameters of a scene by a planned measurement.

    Attributes
    ----------
    parameters
        95 % intervals.
    tied
        Width of each interval divided by its width if the other parameters were known.
    helps
        Changes of the experiment with their intervals.
    baseline
        Sufficient length of the baseline, in units of the largest depth: a longer one makes no
        interval narrower by more than 5 %.
    depth, force
        Depth [length] and force [force] of the deepest sample.
    noise
        Standard deviation of the noise [force].
    points
        Number of samples of the whole curve.
    """

    config: Config
    parameters: dict[str, Interval]
    tied: dict[str, float]
    identifiable: bool
    helps: tuple[DesignImprovement, ...]
    baseline: float
    depth: float
    force: float
    noise: float
    points: int

    def as_json(self) -> dict[str, Any]:
        """Return the design as an object for JSON."""
        report = {
            "scene": self.config.source.name,
            "vary": list(self.parameters),
            "words": self.words,
        } | vars(self)
        intervals = {key: asdict(value) for key, value in self.parameters.items()}
        improvements = [asdict(value) for value in self.helps]
        report |= {"parameters": intervals, "helps": improvements}
        return {name: value for name, value in report.items() if name != "config"}

    @property
    def words(self) -> str:
        """Sentences on the expected intervals and on parameters that are not identifiable."""
        if not self.identifiable:
            return (
                f"Not identifiable: {' and '.join(self.parameters)} together are not known better "
                "than to a factor of 3."
            )
        sentences = [
            f"{format_interval(key, self.config, interval)}."
            for key, interval in self.parameters.items()
        ]
        # Ratios of interval widths above this one are reported.
        reported_width_ratio = 2.0
        wide_ratios = [
            (key, ratio) for key, ratio in self.tied.items() if ratio > reported_width_ratio
        ]
        sentences += [
            f"If the other parameters were known, the interval of {key} would be {ratio:.2g} times "
            "narrower."
            for key, ratio in wide_ratios
        ]
        return " ".join(
            [
                *sentences,
                f"A baseline before contact of {self.baseline:g} times the depth is long enough.",
            ]
        )


@dataclass(frozen=True)
class _PlannedMeasurement:
    """Planned measurement with displacement x [length] over time t [s] from first contact.

    x is the depth, or with a spring the displacement of its base; it is piecewise linear in time.
    `depth` [length] is the largest depth.
    """

    config: Config
    forward_model: ForwardModel
    depth: float
    x: np.ndarray
    t: np.ndarray

    def build_model(self, points: int, baseline: float) -> CurveModel:
        """Return the model of a curve of equally spaced samples after a baseline.

        Parameters
        ----------
        points
            Number of samples.
        baseline
            Length of the baseline, relative to the largest depth.
        """
        if isinstance(self.forward_model, LoopForwardModel):
            return self._loop_model(self.forward_model, points, baseline)
        deepest_index = int(np.argmax(self.x))
        # The baseline before a jump has the speed of an approach that takes this fraction of the
        # history.
        min_fraction = 0.25
        speed = self.x[deepest_index] / max(
            self.t[deepest_index] - self.t[0], min_fraction * float(np.ptp(self.t))
        )
        baseline_length = baseline * self.depth
        t = np.linspace(self.t[0] - baseline_length / speed, self.t[-1], points)
        x = np.where(t < self.t[0], speed * (t - self.t[0]), np.interp(t, self.t, self.x))
        return CurveModel(
            self.forward_model,
            Samples(
                x, np.zeros(points), t - t[0] if self.forward_model.is_time_dependent else None
            ),
        )

    def _loop_model(
        self, forward_model: LoopForwardModel, points: int, baseline: float
    ) -> CurveModel:
        """Return the model of a loop, in which loading and unloading have equally many samples.

        The depth of loading and the force of unloading are equally spaced.
        """
        side = max(round(points / (2.0 + baseline)), 2)
        before = max(points - 2 * side, 0)
        E, loop = forward_model.loop(forward_model.initial_coordinates)
        compliance = forward_model.experiment.compliance
        up = self.depth * np.linspace(0.0, 1.0, side)
        down = loop.depths_of(np.linspace(1.0, 0.0, side + 1)[1:], self.depth)
        x = np.concatenate(
            [
                -baseline * self.depth * np.linspace(1.0, 0.0, before, endpoint=False),
                up + compliance * loop.loading(E, up),
                down + compliance * loop.unloading(E, down, self.depth),
            ]
        )
        branch = np.repeat([APPROACH, RETRACT], [before + side, side])
        samples = Samples(x, np.zeros(len(x)), None, branch, float(x[before + side - 1]))
        return CurveModel(forward_model, samples)

    @property
    def max_force(self) -> float:
        """Largest force [force]."""
        model = self.build_model(len(self.t) * 50, 0.0)
        return float(model.contact_force(self._initial_parameters).max())

    @property
    def _initial_parameters(self) -> np.ndarray:
        return np.array([*self.forward_model.initial_coordinates, 0.0, 0.0, 0.0])

    def expected_estimate(
        self, points: int, noise: float, baseline: float = BASELINE_DEPTHS
    ) -> Estimate:
        """Return the estimate to expect from a curve of this scene with white noise [force]."""
        model = self.build_model(points, baseline)
        p = self._initial_parameters
        model = replace(model, samples=replace(model.samples, force=model.contact_force(p)))
        noise_free = Estimate(
            model,
            p,
            p,
            ParameterUncertainty(WHITE, noise**2, np.zeros((len(p), len(p))), np.zeros(len(p))),
        )
        sd = np.array([standard_deviation(noise_free, k) for k in range(len(p))])
        for key, value in zip(self.forward_model.varied_keys, sd, strict=False):
            if not np.isfinite(value):
                raise ConfigError(key, "the force does not depend on it", "leave it out of --vary")
        return replace(
            noise_free, uncertainty=replace(noise_free.uncertainty, covariance=np.diag(sd**2))
        )


def design_measurement(config: Config, keys: Sequence[str], noise: float, points: int) -> Design:
    """Return the expected intervals of parameters of a scene from a planned measurement.

    Parameters
    ----------
    config
        The scene; the measurement ends at its largest depth.
    keys
        Keys of the parameters.
    noise
        Standard deviation of a sample relative to the largest force. Scenes with a changed
        experiment have the same absolute noise.
    points
        Number of samples; half of them are the baseline.

    Raises
    ------
    ConfigError
        If a key or the scene is invalid.
    NotConverged
        If the scene could not be solved.
    """
    # Profiles of the likelihood may overflow far from the optimum.
    with np.errstate(all="ignore"):
        return _evaluate_design(config, keys, noise, points)


def _evaluate_design(config: Config, keys: Sequence[str], noise: float, points: int) -> Design:
    tables = ForwardModelCache()
    try:
        measurement = _plan_measurement(config, tuple(keys), tables)
    except ForwardModelUnavailable as error:
        raise NotConverged(f"the scene could not be solved: {error}") from error
    noise_force = noise * measurement.max_force
    estimate = measurement.expected_estimate(points, noise_force)
    improvements = tuple(
        _evaluate_change(config, change, tuple(keys), (points, noise_force), tables)
        for change in _possible_changes(config, keys)
    )
    if HARDENING_KEY in keys:
        improvements = (*improvements, _second_cone(measurement, estimate, points, tables))
    ratios = dict(zip(keys, width_inflation_factors(estimate), strict=True))
    baseline = _sufficient_baseline(measurement, points, noise_force)
    assessment = _adequate_assessment(measurement, estimate)
    return Design(
        config,
        _stated_intervals(assessment),
        ratios,
        assessment.is_identifiable,
        improvements,
        baseline,
        measurement.depth,
        measurement.max_force,
        noise_force,
        points,
    )


def _plan_measurement(
    config: Config, keys: tuple[str, ...], tables: ForwardModelCache
) -> _PlannedMeasurement:
    """Return the measurement along the path of a scene until the last time at the largest depth."""
    for key in keys:
        number_at(config, key)
    if config.loading.force_history:
        raise ConfigError(
            "loading.force_history", "a design needs prescribed depths", "give loading.history"
        )
    depth = _largest_depth(config)
    if not depth > 0:
        raise ConfigError("loading", "the tip never touches the body", "give loading.delta > 0")
    if config.yields:
        loop_model = tables.forward_model(config, keys, depth)
        path = np.array([0.0, depth, 0.0]), np.array([0.0, 1.0, 2.0])
        return _PlannedMeasurement(config, loop_model, depth, *path)
    measured_path = _scene_path(config)
    history = config.loading.prescribed_history
    try:
        forward_model = tables.forward_model(
            config, keys, SOLVED_DEPTH_FACTOR * depth, measured_path
        )
    except (ConfigError, ForwardModelUnavailable):
        forward_model = tables.forward_model(config, keys, MIN_DEPTH_FACTOR * depth, measured_path)
    if history is None:
        deepest_x = depth + forward_model.experiment.compliance * float(
            forward_model.force_without_spring(forward_model.initial_coordinates)(
                np.array([depth])
            )[0]
        )
        return _PlannedMeasurement(
            config, forward_model, depth, np.array([0.0, deepest_x]), np.array([0.0, 1.0])
        )
    t, x = np.array(history.points_from_rest).T
    end = int(np.flatnonzero(x == x.max())[-1]) + 1
    return _PlannedMeasurement(config, forward_model, depth, x[:end], t[:end])


def _largest_depth(config: Config) -> float:
    """Return the largest depth of a scene [length]."""
    # A body that yields is run without the frame of the instrument.
    instrument = None if config.yields else config.experiment
    return max(PlannedRun.resolve(config.model_copy(update={"experiment": instrument})).depths)


def _scene_path(config: Config) -> MeasuredPath | None:
    """Return the load path of a scene that is solved by time stepping; None for other scenes."""
    history = config.loading.prescribed_history
    if not needs_time_stepping(config) or history is None:
        return None
    if config.experiment and config.experiment.compliance:
        raise ConfigError(
            "experiment",
            "the design for a time-dependent material prescribes the depth of the tip",
            "leave the spring out",
        )
    t, delta = np.array(history.points_from_rest).T
    return simplify_path(t, delta)


def _adequate_assessment(measurement: _PlannedMeasurement, estimate: Estimate) -> ModelAssessment:
    """Return the assessment of a fit that explains the curve."""
    forward_model = measurement.forward_model
    half_widths = systematic_half_widths(
        estimate,
        forward_model.relative_error,
        relative_calibration_error(measurement.config, forward_model),
    )
    return ModelAssessment(add_profile_intervals(estimate), [], 1.0, None, [], half_widths)


def _stated_intervals(assessment: ModelAssessment) -> dict[str, Interval]:
    """Return the reported 95 % interval of each varied key."""
    return {
        key: assessment.stated_interval(k)
        for k, key in enumerate(assessment.estimate.model.forward_model.varied_keys)
    }


def _possible_changes(config: Config, keys: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield changes of the experiment: twice the depth, half and twice the tip radius, a hold."""
    history = config.loading.history
    if history:
        yield {"loading.history": [[t, 2.0 * value] for t, value in history]}
    else:
        yield {
            "loading": {
                "delta": 2.0 * _largest_depth(config),
                "steps": config.loading.steps,
            }
        }
    radius_keys = ("indenter.R", "indenter.radius")
    for key in radius_keys:
        try:
            R = number_at(config, key)
        except ConfigError:
            continue
        yield from ({key: factor * R} for factor in (0.5, 2.0) if key not in keys)
    if history and relaxation_of(config):
        max_depth = max(value for _, value in history)
        approach = [
            list(point)
            for point in history[
                : max(k for k, point in enumerate(history) if point[1] == max_depth) + 1
            ]
        ]
        yield {
            "loading.history": [
                *approach,
                [approach[-1][0] + (approach[-1][0] - approach[0][0]), max_depth],
            ]
        }


def _evaluate_change(
    config: Config,
    change: dict[str, Any],
    keys: tuple[str, ...],
    points_and_noise: tuple[int, float],
    tables: ForwardModelCache,
) -> DesignImprovement:
    points, noise_force = points_and_noise
    reported_change = (
        {"loading.delta": change["loading"]["delta"]} if "loading" in change else change
    )
    try:
        measurement = _plan_measurement(replace_numbers(config, change), keys, tables)
        return DesignImprovement(
            reported_change,
            _stated_intervals(
                _adequate_assessment(
                    measurement, measurement.expected_estimate(points, noise_force)
                )
            ),
        )
    except (ConfigError, NotConverged) as error:
        return DesignImprovement(
            reported_change,
            {},
            f"{error.key}: {error.problem}" if isinstance(error, ConfigError) else str(error),
        )
    except ForwardModelUnavailable as error:
        return DesignImprovement(reported_change, {}, str(error))


def _second_cone(
    measurement: _PlannedMeasurement, estimate: Estimate, points: int, tables: ForwardModelCache
) -> DesignImprovement:
    """Return the intervals if a loop with another cone is measured and fitted together."""
    # A sharp cone has larger representative strains than the usual 70.3 degrees; both are tabulated
    # in the literature.
    sharp = 50.0
    usual = 70.3
    half_angle = number_at(measurement.config, "indenter.half_angle")
    other_angle = sharp if half_angle > 0.5 * (sharp + usual) else usual
    change = {"and indenter.half_angle": other_angle}
    config = replace_numbers(measurement.config, {"indenter.half_angle": other_angle})
    keys = measurement.forward_model.varied_keys
    try:
        other = _plan_measurement(config, keys, tables)
        noise_force = float(estimate.uncertainty.s2**0.5)
        estimates = (estimate, other.expected_estimate(points, noise_force))
    except ForwardModelUnavailable as error:
        return DesignImprovement(change, {}, str(error))
    curves = [one.p for one in estimates]
    model = joint_model([one.model for one in estimates], curves)
    noise = JointNoise((WHITE, WHITE), (noise_force**2, noise_force**2), model.lengths)
    p = model.joined_parameters(estimate.theta, curves)
    deviations = np.sqrt(np.diag(model.covariance(p, noise)))[: model.coordinate_count]
    intervals = {}
    for parameter, theta, sd in zip(
        measurement.forward_model.parameters, estimate.theta, deviations, strict=True
    ):
        low, high = np.clip([theta - NORMAL_95 * sd, theta + NORMAL_95 * sd], *parameter.bounds)
        ends = parameter.value(float(low)), parameter.value(float(high))
        intervals[parameter.key] = Interval(parameter.value(float(theta)), *ends)
    return DesignImprovement(change, intervals)


def _sufficient_baseline(
    measurement: _PlannedMeasurement, points: int, noise_force: float
) -> float:
    """Return the shortest baseline that is sufficient; the spacing of the samples is unchanged."""
    points_per_depth = points / (1.0 + BASELINE_DEPTHS)

    def deviations(baseline: float) -> np.ndarray:
        estimate = measurement.expected_estimate(
            round(points_per_depth * (1.0 + baseline)), noise_force, baseline
        )
        return estimate.sd[: estimate.model.coordinate_count]

    # Lengths of the baseline that are compared, in depths; a fit uses no more than the last.
    lengths = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0, MAX_BASELINE_DEPTHS)
    best_deviations = deviations(lengths[-1])
    # A baseline is sufficient if no standard deviation is larger than with the longest by
    # this factor.
    baseline_tolerance = 1.05
    return next(
        candidate
        for candidate in lengths
        if np.all(deviations(candidate) <= baseline_tolerance * best_deviations)
    )
