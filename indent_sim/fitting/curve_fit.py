"""Fit of a scene to one measured curve: parameters with intervals, or a reason for rejection."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from indent_sim.config.quantities import dimension_of_key, pressure_keys, si_factor
from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.forward_model.cone_loop import (
    HARDENING_KEY,
    YIELD_STRESS_KEY,
)
from indent_sim.fitting.forward_model.elastic_load_curve import (
    ElasticLoadCurve,
    elastic_config,
    solve_load_curve,
)
from indent_sim.fitting.forward_model.forward_model import (
    APPROACH,
    RETRACT,
    ForwardModel,
    is_time_dependent,
)
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.loop_forward_model import LoopForwardModel
from indent_sim.fitting.forward_model.measured_path_forces import (
    first_contact_time,
    needs_time_stepping,
    simplify_path,
)
from indent_sim.fitting.forward_model.parameter_grid import (
    NUMERICAL_ERRORS,
    ForwardModelUnavailable,
)
from indent_sim.fitting.forward_model.parameters import (
    ADHESION_WORK_KEY,
    RETRACT_WORK_KEY,
    SPRING_KEYS,
    number_at,
    replace_numbers,
)
from indent_sim.fitting.forward_model.surrogate_load_curves import (
    ForceSurrogate,
    SurrogateLoadCurves,
    surrogate_identity,
)
from indent_sim.fitting.inference import alternative_models
from indent_sim.fitting.inference.alternative_models import AlternativeModel, add_to_experiment
from indent_sim.fitting.inference.depth_range_fits import fit_depth_ranges
from indent_sim.fitting.inference.estimate import (
    CurveModel,
    Estimate,
    FitRejected,
    OriginOptions,
    Samples,
    baseline_level,
    fit_model,
    initial_guesses,
    reject_without_signal,
)
from indent_sim.fitting.inference.jumps import LEFT_OUT, find_jumps, sides_of, touch_interval
from indent_sim.fitting.inference.missing_baseline import STEEP_BASELINE, known_baseline
from indent_sim.fitting.inference.model_assessment import (
    Interval,
    ModelAssessment,
    baseline_noise_probability,
    find_residual_trend,
    is_suspect,
    systematic_half_widths,
    width_inflation_factors,
)
from indent_sim.fitting.inference.profile_likelihood import add_profile_intervals
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.measured.indentation_cycle import indentation_cycle
from indent_sim.results.measured.measurement import CurvePart, MeasuredCurve, NoCurve
from indent_sim.results.pictures.axes import scaled_axis
from indent_sim.results.reader import Results
from indent_sim.run.solvers.elastic_curve import half_space_modulus

SOLVED_DEPTH_FACTOR = 1.3  # the scene is solved to this multiple of the estimated largest depth
# The same for an adhesive tip, whose contact is as large as that of a deeper tip without adhesion.
ADHESIVE_DEPTH_FACTOR = 2.4
MIN_DEPTH_FACTOR = 1.01  # smallest multiple, for a body that cannot be indented further
MIN_DIGITS = 4
MAX_DIGITS = 10
INTERVAL_KEYS = ("value", "low", "high")  # keys of an interval in fit.json
ModelChoice = Literal["needed", "all"]
SURROGATE_NOTE = (
    "the forces come from a surrogate, whose error is in the intervals; adhesion, and a thickness "
    "that the scene does not have, are not fitted as other models"
)


@dataclass(frozen=True)
class FitRequest:
    """Settings of a fit that are the same for all curves.

    Attributes
    ----------
    config
        The scene.
    varied_keys
        Keys of the fitted parameters.
    origin
        Options of the contact point and the baseline.
    models
        Whether alternative models are fitted only when needed, or always.
    other_tips
        Keys and values of the tips of the second and further curves, "KEY=VALUE"; all curves are
        then fitted together.
    surrogate
        Surrogate that gives the elastic forces; None to solve the scene.
    """

    config: Config
    varied_keys: tuple[str, ...]
    curve_part: CurvePart = "approach"
    origin: OriginOptions = field(default_factory=OriginOptions)
    models: ModelChoice = "needed"
    other_tips: tuple[str, ...] = ()
    surrogate: ForceSurrogate | None = None


@dataclass(frozen=True)
class PlottedCurve:
    """Data for the picture and the table of a curve, in arrays of shape (n,).

    Attributes
    ----------
    delta
        Depth from first contact.
    force
        Force without baseline.
    alternative_fits
        Forces by other models, by name.
    t
        Times from first contact [s]; None if the force does not depend on time.
    """

    delta: np.ndarray
    force: np.ndarray
    fit: np.ndarray
    alternative_fits: dict[str, np.ndarray] = field(default_factory=dict)
    t: np.ndarray | None = None


@dataclass(frozen=True)
class CurveFit:
    """Result for one curve: the entry for fit.json and the data of its picture."""

    entry: dict[str, Any]
    plotted: PlottedCurve | None = None

    @property
    def name(self) -> str:
        """Name of the curve."""
        return str(self.entry["curve"])

    @property
    def is_done(self) -> bool:
        """True if the parameters were found."""
        return bool(self.entry["status"] == "done")


def keys_of_part(keys: Sequence[str], part: CurvePart) -> tuple[str, ...]:
    """Return the varied keys; a work of adhesion becomes two keys if both branches are fitted."""
    if part == "both" and ADHESION_WORK_KEY in keys and RETRACT_WORK_KEY not in keys:
        after = list(keys).index(ADHESION_WORK_KEY) + 1
        return (*keys[:after], RETRACT_WORK_KEY, *keys[after:])
    return tuple(keys)


def rejected_fit(name: str, reason: str, seconds: float = 0.0) -> CurveFit:
    """Return the result for a rejected curve, with the reason of the rejection."""
    return CurveFit({"curve": name, "status": "refused", "reason": reason, "seconds": seconds})


def fit_curve(curve: MeasuredCurve, request: FitRequest, tables: ForwardModelCache) -> CurveFit:
    """Fit one measured curve.

    Parameters
    ----------
    curve
        The measured curve, in the units of its file.
    request
        The scene and the settings of the fit.
    tables
        Cache of forward models that curves share.

    Raises
    ------
    ConfigError
        If the scene or a key is invalid for every curve. A curve that cannot be fitted does not
        raise an error, but gives a result with the reason.
    """
    start_time = time.process_time()
    try:
        with np.errstate(all="ignore"):
            return _fit_and_assess(fitted_part(curve, request), request, tables, start_time)
    except FIT_ERRORS as error:
        return rejected_fit(curve.name, fit_reason(error), time.process_time() - start_time)


# Errors of a curve that cannot be fitted.
FIT_ERRORS = (FitRejected, ForwardModelUnavailable, NoCurve, *NUMERICAL_ERRORS)


def fit_reason(error: Exception) -> str:
    """Return the reason for which a curve was rejected, of one of FIT_ERRORS."""
    if isinstance(error, FitRejected | ForwardModelUnavailable):
        return str(error)
    if isinstance(error, NoCurve):
        return error.problem
    error_text = " ".join(str(error).split())[:120]
    return f"the fit failed numerically ({error_text}); check the columns and units of the curve"


def fitted_part(curve: MeasuredCurve, request: FitRequest) -> MeasuredCurve:
    """Return the part of a curve that is fitted, in the units of the scene."""
    converted = convert_to_scene_units(curve, request.config)
    if request.config.yields:
        converted = _with_parts_by_force(converted)
    return converted.part(request.curve_part)


def _with_parts_by_force(curve: MeasuredCurve) -> MeasuredCurve:
    """Return the curve of a body that yields, divided into its parts by the force.

    Such a body recovers by only some per cent of the depth, so that a division by the depth would
    take unloading for a hold.
    """
    depth = curve.abscissa_values(curve.available_abscissa("delta"))
    try:
        cycle = indentation_cycle(depth - depth.min(), curve.force - curve.force.min())
    except UsageError as error:
        raise NoCurve(str(error)) from None
    # With noise the largest force is not where the tip turns, which the depth shows.
    deepest = int(np.argmax(depth[: cycle.end]))
    first = deepest if cycle.hold_start is None else min(cycle.hold_start, deepest)
    parts = {"approach": slice(0, first + 1), "retract": slice(deepest + 1, cycle.end)}
    return replace(curve, parts=parts)


def convert_to_scene_units(curve: MeasuredCurve, config: Config) -> MeasuredCurve:
    """Return the curve in the units of a scene."""
    return curve.convert_units(_scene_units(config))


def cantilever_stiffness_si(config: Config) -> float | None:
    """Return the cantilever stiffness of a scene in N/m, for AFM files that lack it.

    The result is None if the scene has no cantilever or no units.
    """
    cantilever = config.experiment.cantilever if config.experiment else None
    if cantilever is None or not (config.units.length and config.units.force):
        return None
    return (
        cantilever.stiffness
        * si_factor(config.units.force, "force")
        / si_factor(config.units.length, "length")
    )


def _scene_units(config: Config) -> dict[str, str]:
    return {"length": config.units.length, "force": config.units.force}


def _fit_and_assess(
    curve: MeasuredCurve, request: FitRequest, tables: ForwardModelCache, start_time: float
) -> CurveFit:
    config, samples, notes = prepare_curve(curve, request)
    _refuse_wrong_scale(config, samples)
    reject_without_signal(samples)
    if request.curve_part == "both" and is_time_dependent(config):
        raise ConfigError(
            "--segment both",
            "leaves out the hold, on which the later force of a time-dependent material depends",
            "give --segment all",
        )
    if is_time_dependent(config) and samples.t is None:
        raise NoCurve("no column of time, which a viscoelastic or poroelastic scene needs")
    errors: tuple[float, ...] = ()
    if config.yields:
        estimate = fit_loop(config, request, samples, tables)
        reject_outside_range(estimate)
    elif needs_time_stepping(config):
        estimate = _fit_along_path(config, request, samples, tables)
    else:
        estimate, baseline_notes, errors = _fit_elastic(config, request, samples, tables)
        notes += baseline_notes
    assessment = _assess_model(
        add_profile_intervals(estimate), config, request.models, tables, errors
    )
    if tables.surrogate is not None:
        reject_interval_outside_surrogate(assessment)
        notes.append(SURROGATE_NOTE)
    return curve_result(curve.name, assessment, config, tuple(notes), start_time)


def curve_result(
    name: str,
    assessment: ModelAssessment,
    config: Config,
    notes: tuple[str, ...],
    start_time: float,
) -> CurveFit:
    """Return the result for a curve, with its entry and the data of its picture."""
    return CurveFit(
        _report_entry(name, assessment, config, notes, start_time), _plotted_curve(assessment)
    )


def _fit_elastic(
    config: Config, request: FitRequest, samples: Samples, tables: ForwardModelCache
) -> tuple[Estimate, list[str], tuple[float, ...]]:
    """Fit an elastic scene; a curve without samples before contact is given a baseline.

    Returns the fit, sentences about the baseline, and the errors (k,) of theta due to leaving out
    the toe, which is the slow rise of the force before contact. These errors are empty without a
    toe.
    """
    estimate = _fit_load_curve(config, request, samples, tables)
    reject_outside_surrogate(estimate)
    known = None
    if not estimate.model.forward_model.has_adhesion:
        known = known_baseline(samples, estimate)
    if known is None:
        return estimate, [], ()
    known_request = replace(request, origin=known.origin)
    try:
        known_estimate, *others = (
            _fit_load_curve(config, known_request, selected, tables)
            for selected in (known.samples, *known.other_samples)
        )
    except (FitRejected, ForwardModelUnavailable):
        return estimate, [], ()
    if not known.fits(known_estimate, estimate):
        return estimate, [], ()
    reject_outside_surrogate(known_estimate)
    differences = [np.abs(other.theta - known_estimate.theta) for other in others]
    # Twice the largest difference between fits that leave out less or more of the toe bounds the
    # difference from a curve without a toe.
    errors = tuple(2.0 * np.max(differences, axis=0)) if differences else ()
    return known_estimate, [known.note], errors


def _fit_load_curve(
    config: Config, request: FitRequest, samples: Samples, tables: ForwardModelCache
) -> Estimate:
    """Fit an elastic scene; solve deeper and refit if the fit exceeds the solved depth."""
    if config.experiment and config.experiment.adhesion:
        return _fit_adhesive_load_curve(config, request, samples, tables)
    forward_model = _shared_forward_model(config, request.varied_keys, samples, tables)
    estimate = fit_model(forward_model, samples, request.origin)
    depth = _max_indentation(estimate)
    if depth > forward_model.max_depth:
        estimate = fit_model(
            tables.forward_model(config, request.varied_keys, SOLVED_DEPTH_FACTOR * depth),
            samples,
            request.origin,
        )
    return estimate


def _fit_adhesive_load_curve(
    config: Config, request: FitRequest, samples: Samples, tables: ForwardModelCache
) -> Estimate:
    """Fit an adhesive scene; solve deeper and refit until all contacts of the fit are solved.

    The contacts of an adhesive tip are larger than those without adhesion at the same depth.
    """
    contact_depth = adhesive_contact_depth(samples, config)
    for factor in (ADHESIVE_DEPTH_FACTOR, SOLVED_DEPTH_FACTOR, MIN_DEPTH_FACTOR):
        try:
            forward_model = tables.forward_model(
                config, request.varied_keys, rounded_depth(factor * contact_depth)
            )
            break
        except (ConfigError, ForwardModelUnavailable):
            continue
    else:
        forward_model = tables.forward_model(config, request.varied_keys, contact_depth)
    max_rounds = 5
    for _ in range(max_rounds):
        estimate = fit_model(forward_model, samples, request.origin)
        missing = estimate.depth / forward_model.largest_displacement(estimate.theta)
        if 0.0 < missing <= 1.0:
            return estimate
        # If the contact is tensile at all solved depths, the missing depth is unknown: solve three
        # times as deep.
        growth = min(max(1.2 * missing, 1.3), 3.0) if missing > 0.0 else 3.0
        forward_model = tables.forward_model(
            config, request.varied_keys, rounded_depth(growth * forward_model.max_depth)
        )
    raise FitRejected(
        "the adhesive contact is larger than any that was solved: the adhesion is too strong for "
        "the depth of the curve"
    )


def fit_loop(
    config: Config, request: FitRequest, samples: Samples, tables: ForwardModelCache
) -> Estimate:
    """Fit the loading and unloading of a body that yields.

    Raises
    ------
    ConfigError
        If the part of the curve is not a loop.
    """
    if request.curve_part not in ("approach", "both"):
        raise ConfigError(
            f"--segment {request.curve_part}",
            "is not a loop of a body that yields",
            "give --segment both (loading and unloading), or --segment approach to fit one "
            "parameter",
        )
    if request.curve_part == "approach" and len(request.varied_keys) > 1:
        raise ConfigError(
            "--segment approach",
            "the loading curve of a cone gives only one number, F/h^2, which does not determine "
            f"{' and '.join(request.varied_keys)}",
            "give --segment both, or vary one key",
        )
    forward_model = tables.forward_model(
        config, request.varied_keys, max_contact_depth(samples, config)
    )
    return fit_model(forward_model, samples, request.origin)


def reject_outside_range(estimate: Estimate) -> None:
    """Raise FitRejected if the fit leaves the range of materials that is tabulated."""
    forward_model = estimate.model.forward_model
    assert isinstance(forward_model, LoopForwardModel)
    ratio = forward_model.metal(estimate.theta).ratio
    low, high = forward_model.ratio_bounds
    if not low < ratio < high:
        raise FitRejected(
            f"E/yield_stress = {ratio:.3g} is outside the range of {low:g} to {high:g} for "
            "which loading and unloading are tabulated: check units, half angle and frame "
            "compliance"
        )


def reject_outside_surrogate(estimate: Estimate) -> None:
    """Raise FitRejected if the parameters are outside the range of the surrogate of a fit."""
    theta = estimate.theta
    _reject_outside_surrogate(estimate, theta, theta)


def reject_interval_outside_surrogate(assessment: ModelAssessment) -> None:
    """Raise FitRejected if an interval leaves the range of the surrogate of a fit."""
    estimate = assessment.estimate
    intervals = [assessment.statistical_interval(k) for k in range(len(estimate.theta))]
    _reject_outside_surrogate(estimate, *np.array(intervals).reshape(-1, 2).T)


def _reject_outside_surrogate(estimate: Estimate, low: np.ndarray, high: np.ndarray) -> None:
    """Raise FitRejected if a box of transformed parameters leaves the range of the surrogate."""
    forward_model = estimate.model.forward_model
    curves = forward_model.elastic_curves
    if not isinstance(curves, SurrogateLoadCurves):
        return
    shape = [k for k, part in enumerate(forward_model.parameters) if part.role == "shape"]
    lower, upper = forward_model.bounds
    first = np.clip(low, lower, upper)[shape].tolist()
    last = np.clip(high, lower, upper)[shape].tolist()
    if reason := curves.outside_text(first, last):
        raise FitRejected(reason)


def _fit_along_path(
    config: Config, request: FitRequest, samples: Samples, tables: ForwardModelCache
) -> Estimate:
    """Fit a path-dependent scene along the measured load path.

    The path begins at first contact, which is first estimated by an elastic fit. Path and fit are
    repeated until the contact point converges (at most four times).
    """
    assert samples.t is not None
    compliance = config.experiment.compliance if config.experiment else 0.0
    force = samples.force - baseline_level(samples)
    # Depths behind a spring contain the noise of the force. Changes of less than this many medians
    # of the change between samples count as noise.
    noise_medians = 4.0
    depth_noise = noise_medians * compliance * float(np.median(np.abs(np.diff(force))))
    depth = samples.x - compliance * force
    # The approach ends, and a hold may begin, where the depth is less than this fraction of its
    # range from the largest depth.
    hold_depth_fraction = 0.01
    approach = samples.select(
        np.arange(len(samples))
        <= int(np.argmax(depth > depth.max() - hold_depth_fraction * np.ptp(depth)))
    )
    contact_point = _elastic_contact_point(config, request, approach, tables)
    estimate = None
    max_path_iterations = 4
    # The load path is computed again if the contact point has moved by more than this fraction of
    # the depth; a diffusivity changes by the same fraction.
    same_path_tolerance = 0.002
    for _ in range(max_path_iterations):
        path = simplify_path(samples.t, depth - contact_point, depth_noise)
        forward_model = tables.forward_model(
            config, request.varied_keys, SOLVED_DEPTH_FACTOR * path.max_depth, path
        )
        estimate = fit_model(forward_model, samples, request.origin, near=estimate)
        shift = abs(estimate.contact_point - contact_point)
        contact_point = estimate.contact_point
        if shift < same_path_tolerance * path.max_depth and not depth_noise:
            break
        if compliance:
            # The fitted force has no noise: it gives a smooth deflection of the spring.
            depth = samples.x - compliance * forward_model(
                estimate.theta, samples.x - contact_point, samples.t
            )
            depth_noise = 0.0
    assert estimate is not None
    return estimate


def _elastic_contact_point(
    config: Config, request: FitRequest, approach: Samples, tables: ForwardModelCache
) -> float:
    """Return the contact point of an elastic fit to the approach, in which one modulus is free.

    Raises
    ------
    FitRejected
        If the curve has no contact.
    """
    if request.origin.contact_point is not None:
        return request.origin.contact_point
    elastic_model = _shared_forward_model(
        _elastic_config_with_spring(config, max_contact_depth(approach, config)),
        (pressure_keys(config)[0],),
        approach,
        tables,
    )
    guesses = initial_guesses(elastic_model, approach, request.origin)
    if not guesses:
        raise FitRejected("no contact: the force does not rise with the depth")
    p, _ = CurveModel(elastic_model, approach, request.origin).least_squares(guesses[0])
    return float(p[-3])


def _elastic_config_with_spring(config: Config, depth: float) -> Config:
    """Return the scene with elastic material and the same spring, loaded to a depth."""
    experiment = to_mapping(config).get("experiment")
    document = to_mapping(elastic_config(config, depth))
    return config_from_mapping(document | ({"experiment": experiment} if experiment else {}))


def prepare_curve(curve: MeasuredCurve, request: FitRequest) -> tuple[Config, Samples, list[str]]:
    """Return the scene for a curve, its samples, and notes on the assumptions."""
    config = request.config
    has_spring = config.experiment is not None and config.experiment.compliance > 0
    guesses = []
    if has_spring and curve.is_abscissa_guessed:
        curve = curve.reinterpret_depth()
        guesses.append(
            "the file does not name the quantity in its column of lengths, and the scene has a "
            "spring: the column is taken as the displacement of the base; if it contains the "
            "depth, name it, as in --columns depth=1,force=2"
        )
    elif curve.is_abscissa_guessed:
        guesses.append(
            "the file does not name the quantity in its column of lengths: the column is taken "
            "as the depth"
        )
    notes = [*curve.notes, *guesses]
    stiffness = curve.stiffness
    if not has_spring and stiffness and curve.z is not None:
        config = add_to_experiment(config, cantilever={"stiffness": stiffness})
        has_spring = True
    column = curve.available_abscissa("z" if has_spring else "delta")
    if has_spring and column == "delta":
        config = _remove_spring(config)
        notes.append("the curve has depths: the scene's spring is not used")
    if not has_spring and column == "z":
        notes.append("no spring is known: the displacement of the base is taken as the depth")
    t = None if curve.t is None else curve.t - curve.t[0]
    samples = Samples(curve.abscissa_values(column), curve.force, t)
    if config.yields or (config.experiment and config.experiment.adhesion):
        samples = _order_by_time(samples, curve, request.curve_part)
    if config.yields:
        samples = replace(samples, turn=float(samples.x.max()))
    return config, samples, notes


def _order_by_time(samples: Samples, curve: MeasuredCurve, part: CurvePart) -> Samples:
    """Return the samples in the order of time; those of a whole curve also have their branch."""
    if part == "approach" and samples.x[0] > samples.x[-1]:
        # The rows of this file are in the order of z, so that they begin at the deepest point.
        return Samples(
            samples.x[::-1], samples.force[::-1], None if samples.t is None else samples.t[::-1]
        )
    if part != "both":
        return samples
    branch = np.full(len(samples), APPROACH)
    branch[curve.parts["retract"]] = RETRACT
    return replace(samples, branch=branch)


def _remove_spring(config: Config) -> Config:
    experiment = config.experiment
    assert experiment is not None
    return config.model_copy(
        update={"experiment": replace(experiment, cantilever=None, frame=None)}
    )


def _shared_forward_model(
    config: Config, keys: tuple[str, ...], samples: Samples, tables: ForwardModelCache
) -> ForwardModel:
    """Return the forward model up to a rounded depth, which curves of similar depths share.

    If the scene is not valid at that depth, the model extends slightly beyond the depth of the
    curve.
    """
    contact_depth = max_contact_depth(samples, config)
    try:
        return tables.forward_model(
            config, keys, rounded_depth(SOLVED_DEPTH_FACTOR * contact_depth)
        )
    except (ConfigError, ForwardModelUnavailable):
        return tables.forward_model(config, keys, MIN_DEPTH_FACTOR * contact_depth)


def rounded_depth(depth: float) -> float:
    """Return a depth, rounded up to a power of 1.25, so that similar curves share solutions."""
    grade_ratio = 1.25
    return float(grade_ratio ** math.ceil(math.log(depth) / math.log(grade_ratio)))


def adhesive_contact_depth(samples: Samples, config: Config) -> float:
    """Return the largest depth of an adhesive curve [length], measured from a clear snap-in.

    Without a clear snap-in the depth is estimated as for curves without adhesion.
    """
    side = sides_of(samples.x) if samples.branch is None else np.abs(samples.branch)
    touch = find_jumps(samples.x, samples.force, side).touch
    if touch is None:
        return max_contact_depth(samples, config)
    compliance = config.experiment.compliance if config.experiment else 0.0
    rise = float(samples.force.max()) - baseline_level(samples)
    travel = float(samples.x.max()) - touch[0]
    # Least depth on a soft spring, as a fraction of the travel.
    min_depth_fraction = 0.05
    return max(travel - compliance * rise, min_depth_fraction * travel)


def max_contact_depth(samples: Samples, config: Config) -> float:
    """Return an upper bound of the depth [length], from the samples above the baseline."""
    block_count = 200
    block_means = samples.block_means(block_count)
    # Samples of a retraction begin at the deepest: sort them by depth.
    order = np.argsort(block_means.x, kind="stable")
    x = block_means.x[order]
    force = block_means.force[order]
    baseline = baseline_level(block_means)
    peak = int(np.argmax(force))
    rise = float(force[peak]) - baseline
    # Contact begins before this fraction of the rise of the force.
    contact_rise_fraction = 0.02
    below_contact = np.flatnonzero(force[: peak + 1] < baseline + contact_rise_fraction * rise)
    contact_depth = float(samples.x.max() - x[below_contact[-1] if len(below_contact) else 0])
    compliance = config.experiment.compliance if config.experiment else 0.0
    # Least depth on a soft spring, as a fraction of the measured range.
    min_depth_fraction = 0.05
    return max(contact_depth - compliance * rise, min_depth_fraction * contact_depth)


def _max_indentation(estimate: Estimate) -> float:
    """Return the depth of the deepest sample, without the spring's deflection [length]."""
    return estimate.depth - estimate.model.forward_model.experiment.compliance * estimate.max_force


def _assess_model(
    estimate: Estimate,
    config: Config,
    model_choice: ModelChoice,
    tables: ForwardModelCache,
    errors: tuple[float, ...] = (),
) -> ModelAssessment:
    """Assess a fit; `errors` (k,) are further systematic errors of the transformed parameters."""
    forward_model = estimate.model.forward_model
    depth_ranges = fit_depth_ranges(estimate)
    residual_trend = find_residual_trend(estimate)
    p_baseline = baseline_noise_probability(estimate)
    alternatives: list[AlternativeModel] = []
    is_wanted = model_choice == "all" or is_suspect(depth_ranges, residual_trend, p_baseline)
    # Other models are elastic.
    if is_wanted and not forward_model.follows_loop:
        alternatives = alternative_models.fit_alternatives(estimate, config, tables)
    half_widths = systematic_half_widths(
        estimate, _force_error(estimate), relative_calibration_error(config, forward_model)
    )
    if errors:
        half_widths = tuple(map(math.hypot, half_widths, errors))
    return ModelAssessment(
        estimate, depth_ranges, residual_trend.shape, p_baseline, alternatives, half_widths
    )


def relative_calibration_error(config: Config, forward_model: ForwardModel) -> float:
    """Return the relative error of a modulus due to uncertain stiffness and tip radius.

    The result is the sum in quadrature of the relative error of the cantilever stiffness and of the
    relative error of the radius multiplied by d ln F / d ln R.
    """
    calibration = config.experiment.calibration if config.experiment else None
    if not calibration:
        return 0.0
    radius_error = 0.0
    if calibration.R:
        radius_error = _radius_exponent(config, forward_model) * calibration.R
    return math.hypot(calibration.stiffness, radius_error)


def _radius_exponent(config: Config, forward_model: ForwardModel) -> float:
    """Return n = d ln F / d ln R at the largest depth, by a central difference.

    A relative error of the tip radius R changes the modulus by n times this error.
    """
    R = number_at(config, "indenter.R")
    depths = np.array([forward_model.max_depth])
    variation = 0.05
    factors = (1.0 - variation, 1.0 + variation)
    scenes = (replace_numbers(config, {"indenter.R": factor * R}) for factor in factors)
    lower_force, upper_force = (
        float(_load_curve_of(scene, forward_model).force(depths)[0]) for scene in scenes
    )
    return math.log(upper_force / lower_force) / math.log(factors[1] / factors[0])


def _load_curve_of(config: Config, forward_model: ForwardModel) -> ElasticLoadCurve:
    """Return the load curve of a scene from the surrogate of a forward model, or a solution."""
    max_depth = forward_model.max_depth
    if forward_model.surrogate is None:
        return solve_load_curve(config, max_depth)
    return SurrogateLoadCurves(forward_model.surrogate, config, (), max_depth).scene_curve


def _force_error(estimate: Estimate) -> float:
    """Return the relative error of the forces of a fit: of the mesh, or of the surrogate."""
    return estimate.model.forward_model.relative_error_at(estimate.theta)


# ---- entry in fit.json, warnings and sentences
# ------------------------------------------------------------------------------------


def _report_entry(
    name: str,
    assessment: ModelAssessment,
    config: Config,
    notes: tuple[str, ...],
    start_time: float,
) -> dict[str, Any]:
    """Return the entry of a curve for fit.json."""
    estimate = assessment.estimate
    forward_model = assessment.estimate.model.forward_model
    parameters = forward_model.parameters
    k = len(forward_model.parameters)
    intervals = {
        parameter.key: assessment.stated_interval(i) for i, parameter in enumerate(parameters)
    }
    parameter_entries = {
        parameter.key: vars(intervals[parameter.key])
        | {"statistical": [parameter.value(end) for end in assessment.statistical_interval(i)]}
        for i, parameter in enumerate(parameters)
    }
    half_width = 1.96 * float(estimate.sd[k])
    contact_point = {"value": estimate.contact_point, "low": estimate.contact_point - half_width}
    ratios = {
        parameter.key: ratio
        for parameter, ratio in zip(parameters, _width_factors(assessment), strict=True)
    }
    rise = estimate.max_force
    n = len(estimate.model.samples)
    noise = estimate.uncertainty.likeliest_noise
    residual: dict[str, Any] = {"rms": estimate.rms, "percent": 100 * estimate.rms / rise, "n": n}
    residual |= {"n_effective": n / noise.integrated_correlation_time, "correlation": noise.tau}
    residual |= {"p_shape": assessment.p_shape, "p_baseline": assessment.p_baseline}
    span = max(float(np.ptp(estimate.model.samples.x)), 1e-300)
    entry = {
        "curve": name,
        "status": "done",
        "reason": "",
        "explained": assessment.is_adequate,
        "cause": assessment.misfit_causes,
    }
    entry |= {"parameters": parameter_entries, "fixed": _fixed_numbers(config, forward_model)}
    entry |= {"contact_point": contact_point | {"high": estimate.contact_point + half_width}}
    entry |= {"baseline": {"force": float(estimate.p[-2]), "slope": float(estimate.p[-1]) / span}}
    entry |= {"force_max": rise, "depth": _max_indentation(estimate), "residual": residual}
    entry |= {
        "window": _depth_range_rows(assessment),
        "models": [
            _alternative_entry(alternative, parameters) for alternative in assessment.alternatives
        ],
    }
    entry |= {
        "identifiable": assessment.is_identifiable,
        "tied": ratios,
        "words": _summary(assessment, config),
    }
    if assessment.together:
        entry |= {"together": {"p": assessment.together.p_together}}
    entry |= {
        "hertz": _hertz_comparison(assessment),
        "model_error": _force_error(estimate),
    }
    return entry | {
        "warnings": [*notes, *_warnings(assessment), *_scale_warnings(estimate, config)],
        "seconds": time.process_time() - start_time,
    }


def _width_factors(assessment: ModelAssessment) -> list[float]:
    """Return each interval's width divided by its width if all other parameters were known."""
    if assessment.together:
        return assessment.together.width_factors
    return width_inflation_factors(assessment.estimate)


def _fixed_numbers(config: Config, forward_model: ForwardModel) -> dict[str, float]:
    """Return the numbers of the scene that affect the modulus but were not fitted."""
    fixed_values = {}
    for key in (
        "material.E",
        "material.nu",
        "indenter.R",
        "indenter.half_angle",
        "body.height",
        *SPRING_KEYS,
    ):
        if key not in forward_model.varied_keys:
            try:
                fixed_values[key] = number_at(config, key)
            except ConfigError:
                continue
    return fixed_values


def _depth_range_rows(assessment: ModelAssessment) -> list[dict[str, float]]:
    """Return values and intervals of every depth range; the last one is the whole curve."""
    parameters = assessment.estimate.model.forward_model.parameters

    def row(
        upper: float, theta: np.ndarray, interval: Callable[[int], tuple[float, float]]
    ) -> dict[str, float]:
        values = {"upper": upper}
        for k, parameter in enumerate(parameters):
            low, high = map(parameter.value, interval(k))
            values |= {
                parameter.key: parameter.value(float(theta[k])),
                f"{parameter.key}_low": low,
                f"{parameter.key}_high": high,
            }
        return values

    rows = [
        row(range_fit.depth_fraction, range_fit.theta, range_fit.interval)
        for range_fit in assessment.depth_range_fits
    ]
    return [*rows, row(1.0, assessment.estimate.theta, assessment.statistical_interval)]


def _alternative_entry(
    alternative: AlternativeModel, parameters: tuple[Any, ...]
) -> dict[str, Any]:
    """Return the added parameters of an alternative model and its value of the first varied key."""
    first_parameter = parameters[0] if parameters else None
    entry: dict[str, Any] = {
        "name": alternative.name,
        "p": alternative.p,
        "parameters": alternative.added_values,
    }
    if first_parameter is None:
        return entry
    low, high = alternative.estimate.interval(0)
    value = first_parameter.value(float(alternative.estimate.theta[0]))
    return entry | {
        "value": value,
        "low": first_parameter.value(low),
        "high": first_parameter.value(high),
    }


def _hertz_comparison(assessment: ModelAssessment) -> dict[str, float] | None:
    """Return the modulus by a fit of the half-space formula with the same contact point.

    The keys are `E`, the modulus, and `percent`, its difference from the modulus of the scene in
    per cent. The result is None if no fit exists.
    """
    estimate = assessment.estimate
    forward_model = assessment.estimate.model.forward_model
    if forward_model.follows_loop:
        return None
    planned_run = forward_model.elastic_run
    point_count = 200
    samples = estimate.model.samples.block_means(point_count)
    contact_force = estimate.model.samples.force - estimate.model.baseline(estimate.p)
    force = Samples(estimate.model.samples.x, contact_force).block_means(point_count).force
    delta = samples.x - estimate.contact_point - forward_model.experiment.compliance * force
    E = half_space_modulus(planned_run, delta, force)
    if E is None:
        return None
    coordinates = zip(forward_model.parameters, estimate.theta, strict=True)
    fitted_moduli = [
        parameter.value(float(x)) for parameter, x in coordinates if parameter.key == "material.E"
    ]
    scene_modulus = fitted_moduli[0] if fitted_moduli else planned_run.modulus
    return {"E": E, "percent": 100 * (E / scene_modulus - 1)}


def _warnings(assessment: ModelAssessment) -> list[str]:
    estimate = assessment.estimate
    parameters = estimate.model.forward_model.parameters
    messages = [
        f"{parameter.key} is at a bound of its range"
        for k, parameter in enumerate(parameters)
        if estimate.is_at_bound(k)
    ]
    if (touch := _contradicting_touch(estimate)) is not None:
        messages.append(
            f"the tip snaps in between {touch[0]:.4g} and {touch[1]:.4g}, not at the contact point "
            f"{estimate.contact_point:.4g} that was given: leave --contact-point out"
        )
    if estimate.p[-1] > STEEP_BASELINE * estimate.max_force:
        hint = (
            "if the curve begins in contact it has no baseline and the modulus is wrong; give "
            "what is known with --no-slope or --contact-point"
        )
        messages.append(
            f"the baseline rises by {100 * estimate.p[-1] / estimate.max_force:.0f} % of the "
            f"force: {hint}"
        )
    error = _force_error(estimate)
    sd = estimate.sd[: len(parameters)]
    # 0.65 is a third of the half width 1.96 sd of a 95 % interval.
    source = "mesh"
    remedy = "use a finer mesh"
    if estimate.model.forward_model.surrogate is not None:
        source = "surrogate"
        remedy = "fit with the scene, or give the study more points"
    if len(sd) and error > 0.65 * float(np.min(sd[sd > 0], initial=np.inf)):
        messages.append(
            f"the error of the {source} is {100 * error:.2g} %, more than a third of the half "
            f"width of the interval: {remedy}"
        )
    return messages


def _contradicting_touch(estimate: Estimate) -> tuple[float, float] | None:
    """Return the displacements around a snap-in that contradicts the contact point; may be None."""
    model = estimate.model
    if model.origin.contact_point is None or model.samples.branch is None:
        return None
    touch = touch_interval(model.samples.x, model.samples.branch)
    # A given contact point may be off by some samples.
    margin = 5.0 * model.sample_spacing
    if touch is None or touch[0] - margin < estimate.contact_point < touch[1] + margin:
        return None
    return touch


def _scale_warnings(estimate: Estimate, config: Config) -> list[str]:
    """Return a warning if the curve is deeper than the radius of the tip."""
    R = getattr(config.indenter, "R", None)
    depth = _max_indentation(estimate)
    # At a depth of one radius a paraboloid no longer approximates a sphere.
    if R is None or depth <= R:
        return []
    return [
        f"the depth is {depth / R:.3g} times the radius of the tip, indenter.R = {R:g}: a sphere "
        f"ends at one radius; check the unit of indenter.R and of the depth{_unit_hint(depth / R)}"
    ]


def _unit_hint(ratio: float) -> str:
    """Return a hint if a wrong unit prefix explains a large ratio of depth to tip radius."""
    # Usual ratios of depth to tip radius.
    low = 1e-3
    high = 1.0
    for power, name in ((3, "a thousand"), (6, "a million")):
        if low <= ratio / 10.0**power <= high:
            return f" (one of the units is probably wrong by a factor of {name})"
    return ""


def _refuse_wrong_scale(config: Config, samples: Samples) -> None:
    """Raise NoCurve if the range of depths is below 1e-6 of the radius of the tip."""
    R = getattr(config.indenter, "R", None)
    span = float(np.ptp(samples.x)) if len(samples) else 0.0
    # Smallest depth of a curve, relative to the radius of the tip: for radii of up to 0.1 mm it is
    # 0.1 nm, the size of an atom.
    smallest_depth = 1e-6
    if R is not None and 0.0 < span < smallest_depth * R:
        raise NoCurve(
            f"the depths span {span:.3g}, {span / R:.2g} of the tip's radius indenter.R = {R:g}: "
            "the unit of the file or of the scene is wrong, see --units length=..."
        )


def format_value(key: str, config: Config, value: float, interval: Interval | None = None) -> str:
    """Return a value of a key as text with its unit, if the scene has units.

    Parameters
    ----------
    value
        The value in units of the scene.
    interval
        Interval of the value, which determines the prefix of the unit and the number of digits.
    """
    kind = quantity_kind(config, key)
    digits = _significant_digits(interval) if interval else MIN_DIGITS
    if kind is None:
        return f"{value:.{digits}g}"
    unit_results = [Results(Path(), {}, {"units": _scene_units(config)})]
    return scaled_axis(
        kind, unit_results, np.array([interval.value if interval else value]), key
    ).value_text(value, digits)


def _significant_digits(interval: Interval) -> int:
    """Return the number of digits (at least 4) that resolves the interval's width to two digits."""
    width = (interval.high - interval.low) / max(abs(interval.high), abs(interval.low), 1e-300)
    return (
        min(max(MIN_DIGITS, 2 - math.floor(math.log10(width))), MAX_DIGITS)
        if 0 < width < math.inf
        else MIN_DIGITS
    )


def quantity_kind(config: Config, key: str) -> str | None:
    """Return the kind "length", "force" or "pressure" of a key; None for other dimensions."""
    if key == RETRACT_WORK_KEY:
        return quantity_kind(config, ADHESION_WORK_KEY)
    return dimension_of_key(key_path(key), to_mapping(config))


def _summary(assessment: ModelAssessment, config: Config) -> str:
    """Return the result of a fit in a few sentences."""
    sentences = [
        _parameter_sentence(assessment, k, config)
        for k in range(assessment.estimate.model.coordinate_count)
    ]
    sentences += [tied] if (tied := _hardening_sentence(assessment)) else []
    if assessment.is_adequate:
        return " ".join([*sentences, "Nothing in the curve contradicts the scene."])
    better_names = ", ".join(model.name for model in assessment.better_models)
    alternative = ""
    if better_names:
        alternative = f"{better_names} would."
    elif assessment.alternatives:
        alternative = "none of the alternative models does."
    return " ".join(
        [*sentences, f"The scene does not explain the curve; {alternative}".rstrip("; ")]
    )


def _hardening_sentence(assessment: ModelAssessment) -> str:
    """Return a sentence if one loop does not separate yield stress and hardening, else ""."""
    estimate = assessment.estimate
    keys = estimate.model.forward_model.varied_keys
    if not {YIELD_STRESS_KEY, HARDENING_KEY} <= set(keys):
        return ""
    pair = [keys.index(YIELD_STRESS_KEY), keys.index(HARDENING_KEY)]
    covariance = estimate.uncertainty.covariance[np.ix_(pair, pair)]
    scale = math.sqrt(covariance[0, 0] * covariance[1, 1])
    correlation = float(covariance[0, 1]) / scale if scale > 0 else -1.0
    if assessment.together:
        return (
            f"The correlation of yield_stress and n is {correlation:.3f} with the loops of all "
            "tips together."
        )
    return (
        "One cone does not determine yield_stress and n separately (correlation "
        f"{correlation:.3f}): a loop with another half angle, or of a sphere, does."
    )


def one_line_summary(entry: Mapping[str, Any], config: Config) -> str:
    """Return one line with the intervals of an entry and the reasons for a misfit of the scene."""
    intervals = [
        format_interval(key, config, Interval(*map(numbers.get, INTERVAL_KEYS)))
        for key, numbers in entry["parameters"].items()
    ]
    objection = f"not explained: {', '.join(entry['cause'])}" if entry["cause"] else "explained"
    return "  ·  ".join([*intervals, objection])


def format_interval(key: str, config: Config, interval: Interval) -> str:
    """Return a key's value and its 95 % interval as text with units.

    If the curve does not determine the parameter, the text states this, with the upper limit of the
    parameter if there is one.
    """
    name = key.rpartition(".")[2]
    if interval.low == 0.0 < interval.value:
        limit = format_value(key, config, interval.high, interval)
        return f"{name} is not determined: at most {limit}"
    # A parameter whose interval spans a larger factor is not determined.
    max_known_factor = 1e3
    if interval.low > 0.0 and interval.high > max_known_factor * interval.low:
        return f"{name} is not determined by the curve"
    value, low, high = (
        format_value(key, config, number, interval)
        for number in (interval.value, interval.low, interval.high)
    )
    return f"{name} = {value}, 95 % in {low} to {high}"


def _parameter_sentence(assessment: ModelAssessment, k: int, config: Config) -> str:
    parameter = assessment.estimate.model.forward_model.parameters[k]
    text = format_interval(parameter.key, config, assessment.stated_interval(k))
    half_width_percent = 196 * float(assessment.estimate.sd[k])
    noise_note = (
        f"noise alone would give ±{half_width_percent:.2g} %" if not parameter.is_linear else ""
    )
    if "window" in assessment.misfit_causes and assessment.depth_range_fits:
        shallow_value = format_value(
            parameter.key, config, parameter.value(float(assessment.depth_range_fits[0].theta[k]))
        )
        depth_fraction = assessment.depth_range_fits[0].depth_fraction
        text += (
            f": the value changes with the depth range of the fit, from {shallow_value} at "
            f"{depth_fraction:g} of the depth"
        )
    return f"{text}; {noise_note}." if noise_note and not assessment.is_adequate else f"{text}."


def _plotted_curve(assessment: ModelAssessment) -> PlottedCurve:
    """Return the curve without baseline and its fits, over the indentation depth."""
    estimate = assessment.estimate
    model = estimate.model
    baseline = estimate.model.baseline(estimate.p)
    fitted = model.contact_force(estimate.p)
    delta = (
        model.samples.x
        - estimate.contact_point
        - model.forward_model.experiment.compliance * fitted
    )
    alternative_fits: dict[str, np.ndarray] = {}
    for alternative in assessment.better_models:
        other_estimate = alternative.estimate
        alternative_fits[alternative.name] = (
            other_estimate.model.contact_force(other_estimate.p)
            + other_estimate.model.baseline(other_estimate.p)
            - baseline
        )
    t = model.samples.t
    contact_times = (
        t - first_contact_time(t, delta)
        if t is not None and model.forward_model.is_time_dependent
        else None
    )
    branch = model.samples.branch
    # Samples between the two sides of a jump are not fitted.
    is_used = np.ones(len(delta), dtype=bool) if branch is None else branch != LEFT_OUT
    return PlottedCurve(
        delta[is_used],
        (model.samples.force - baseline)[is_used],
        fitted[is_used],
        {name: force[is_used] for name, force in alternative_fits.items()},
        None if contact_times is None else contact_times[is_used],
    )


def request_identity(request: FitRequest) -> Mapping[str, Any]:
    """Return the settings that must be equal for a folder to be resumed."""
    record = {
        "scene": to_mapping(request.config),
        "vary": list(request.varied_keys),
        "part": request.curve_part,
    }
    if request.surrogate is not None:
        record["surrogate"] = surrogate_identity(request.surrogate)
    origin = {name: value for name, value in vars(request.origin).items() if name != "slope"}
    if origin["level"] is None:
        origin.pop("level")
    record |= {"other_tips": list(request.other_tips)} if request.other_tips else {}
    return record | {"origin": origin, "models": request.models}
