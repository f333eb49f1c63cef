"""Alternative models of a curve, and tests whether one of them is better than the scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from indent_sim.config.scene_file import config_from_mapping, config_with_settings, to_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.forward_model.parameters import ADHESION_WORK_KEY, MIN_HEIGHT_DEPTHS
from indent_sim.fitting.inference.estimate import (
    CurveModel,
    Estimate,
    FitRejected,
    convert_baseline,
    estimate_adhesive_tip,
    fit_adhesive_pilot,
    place_jumps,
    uncertainty_at,
)
from indent_sim.fitting.inference.noise import f_test
from indent_sim.process.errors import IndentSimError

ModelName = Literal["thickness", "adhesion", "relaxation", "tip"]
# Initial guesses of a Prony term: its fraction, and its time relative to the time in contact.
PRONY_FRACTIONS = (0.3,)


@dataclass(frozen=True)
class AlternativeModel:
    """Another model, fitted to the same curve.

    Attributes
    ----------
    name : str
        "thickness", "adhesion", "relaxation" or "tip".
    p : float
        Probability that the model is better than the scene's model by chance.
    estimate : Estimate
        The fit.
    added_values : dict
        Values of the keys that are fitted in addition to the fitted keys of the scene.
    """

    name: ModelName
    p: float
    estimate: Estimate
    added_values: dict[str, float]


def fit_alternatives(
    estimate: Estimate, config: Config, tables: ForwardModelCache
) -> list[AlternativeModel]:
    """Fit the alternative models of a curve, each from several initial guesses.

    Parameters
    ----------
    estimate : Estimate
        Fit of the scene.
    config : Config
        The scene.
    tables : ForwardModelCache
        Cache of the forward models that have already been computed.

    Returns
    -------
    list of AlternativeModel
        The models, the best first. A model that the scene already contains, or that cannot be
        computed for the scene, is omitted.
    """
    alternatives = (
        _fit_alternative(name, estimate, config, tables)
        for name in ("thickness", "adhesion", "relaxation", "tip")
    )
    return sorted(
        (alternative for alternative in alternatives if alternative is not None),
        key=lambda alternative: alternative.p,
    )


def _fit_alternative(
    name: ModelName, estimate: Estimate, config: Config, tables: ForwardModelCache
) -> AlternativeModel | None:
    try:
        best_estimate = (
            _fit_adhesion(estimate, config, tables)
            if name == "adhesion"
            else _best_candidate(estimate, list(_candidates(name, estimate, config, tables)))
        )
    except (
        IndentSimError,
        FitRejected,
        ForwardModelUnavailable,
        ValueError,
        ArithmeticError,
        np.linalg.LinAlgError,
    ):
        return None
    if best_estimate is None:
        return None
    p = refutation_probability(estimate, best_estimate)
    fitted_values = {
        parameter.key: parameter.value(float(x))
        for parameter, x in zip(
            best_estimate.model.forward_model.parameters, best_estimate.theta, strict=True
        )
    }
    return AlternativeModel(
        name,
        p,
        best_estimate,
        {
            key: value
            for key, value in fitted_values.items()
            if key not in estimate.model.forward_model.varied_keys
        },
    )


def _best_candidate(
    estimate: Estimate, candidates: Sequence[tuple[ForwardModel, np.ndarray]]
) -> Estimate | None:
    """Return the fit of the candidate with the smallest sum of squares.

    The candidates are compared on a subset of the samples; the best one is fitted to all samples.
    """
    scene_model = estimate.model
    # Number of block means and of iterations with which the initial guesses of a model are
    # compared.
    sample_count = 300
    iterations = 15
    pilot_model = replace(scene_model, samples=scene_model.samples.block_means(sample_count))
    baseline_values = convert_baseline(scene_model, pilot_model, estimate.ordinary_p)[
        scene_model.coordinate_count :
    ]
    best: tuple[float, CurveModel, np.ndarray] | None = None
    for forward_model, theta in candidates:
        model = _replace_forward_model(pilot_model, forward_model)
        try:
            p, squares = model.least_squares(
                np.array([*theta, *baseline_values]), rounds=iterations
            )
        except (ForwardModelUnavailable, ValueError, np.linalg.LinAlgError):
            continue
        if best is None or squares < best[0]:
            best = squares, model, p
    if best is None:
        return None
    model = replace(best[1], samples=scene_model.samples)
    p, _ = model.least_squares(convert_baseline(best[1], model, best[2]))
    return Estimate(model, p, p, uncertainty_at(model, p))


def _replace_forward_model(model: CurveModel, forward_model: ForwardModel) -> CurveModel:
    """Return a model with another forward model, and the same contact point and baseline."""
    added = len(forward_model.parameters) - model.coordinate_count
    fixed = frozenset(k + added if k >= model.coordinate_count else k for k in model.fixed)
    return replace(model, forward_model=forward_model, fixed=fixed)


def _fit_adhesion(estimate: Estimate, config: Config, tables: ForwardModelCache) -> Estimate | None:
    """Return the fit of the scene with a free work of adhesion.

    If the work is already fitted, a power of the contact radius by which it changes is fitted too.
    """
    forward_model = estimate.model.forward_model
    if forward_model.is_time_dependent:
        return None
    if ADHESION_WORK_KEY in forward_model.varied_keys:
        return _fit_growing_adhesion(estimate)
    if not forward_model.has_adhesion:
        # The initial guesses of the work cover all magnitudes, whatever the scene's work is.
        radius = forward_model.elastic_curves.scene_curve.contact_radius
        config = add_to_experiment(
            config, adhesion={"work": 0.01 * _scene_max_force(forward_model) / radius}
        )
    keys = (*forward_model.varied_keys, ADHESION_WORK_KEY)
    # The contact of an adhesive tip is as large as that of a deeper tip without adhesion.
    for factor in (1.0 if forward_model.has_adhesion else 2.0, 1.0):
        try:
            adhesive_model = tables.forward_model(config, keys, factor * forward_model.max_depth)
            break
        except (IndentSimError, ForwardModelUnavailable):
            continue
    else:
        return None
    model, p, weak_sides = fit_adhesive_pilot(
        adhesive_model, estimate.model.samples, estimate.model.origin
    )
    adhesive_estimate = estimate_adhesive_tip(model, p, weak_sides)
    largest = adhesive_model.largest_displacement(adhesive_estimate.theta)
    return adhesive_estimate if adhesive_estimate.depth <= largest else None


def _fit_growing_adhesion(estimate: Estimate) -> Estimate | None:
    """Return the fit of an adhesive scene whose work is multiplied by a power of the radius."""
    model = _replace_forward_model(estimate.model, estimate.model.forward_model.add_work_exponent())
    count = estimate.model.coordinate_count
    trials = []
    for exponent in (0.0, 0.5, 1.5):
        initial_p = np.insert(estimate.ordinary_p, count, exponent)
        try:
            trials.append(place_jumps(model, initial_p, ()))
        except (ForwardModelUnavailable, ValueError, np.linalg.LinAlgError):
            continue
    if not trials:
        return None
    _, p, _ = min(trials, key=lambda trial: trial[2])
    richer = estimate_adhesive_tip(model, p, ())
    largest = richer.model.forward_model.largest_displacement(richer.theta)
    return richer if richer.depth <= largest else None


def refutation_probability(scene: Estimate, richer: Estimate) -> float:
    """Return the probability that a model with more parameters is better by chance.

    The result is the probability of an F test with the most likely noise of the richer model.
    """
    noise = richer.uncertainty.likeliest_noise
    scene_squares, richer_squares = (
        noise.squares(r)
        for r in (scene.model.residual(_refit_scene(scene, noise)), _refitted_residual(richer))
    )
    m = len(richer.p) - len(scene.p)
    return f_test(
        max(scene_squares - richer_squares, 0.0),
        m,
        richer_squares,
        len(richer.model.samples) - len(richer.p),
    )


def _refit_scene(scene: Estimate, noise: Any) -> np.ndarray:
    return scene.model.least_squares(scene.ordinary_p, noise, rounds=10)[0]


def _refitted_residual(richer: Estimate) -> np.ndarray:
    p, _ = richer.model.least_squares(richer.p, richer.uncertainty.likeliest_noise, rounds=10)
    return richer.model.residual(p)


def _candidates(
    name: ModelName, estimate: Estimate, config: Config, tables: ForwardModelCache
) -> Iterator[tuple[ForwardModel, np.ndarray]]:
    """Yield forward models and initial guesses of their transformed parameters."""
    forward_model = estimate.model.forward_model
    theta = estimate.ordinary_p[: estimate.model.coordinate_count]
    # Effects of the scene with which a model is not fitted, by name of the model.
    excluded_effects: dict[str, set[str]] = {
        "tip": {"adhesion"},
        "thickness": set(),
        "relaxation": {"adhesion", "relaxation"},
    }
    if forward_model.effects & excluded_effects[name]:
        return
    match name:
        case "tip":
            compliance = forward_model.experiment.compliance
            free_model = forward_model.add_free_exponent(
                max(estimate.depth - compliance * estimate.max_force, 1e-3 * estimate.depth)
            )
            # Initial guesses of the change of the exponent of the depth.
            exponent_changes = (-0.2, 0.0, 0.2)
            yield from ((free_model, np.array([*theta, q])) for q in exponent_changes)
        case "thickness":
            yield from _thickness_candidates(forward_model, theta, config, tables)
        case "relaxation":
            yield from _relaxation_candidates(estimate, theta, config, tables)


def _relaxation_candidates(
    estimate: Estimate, theta: np.ndarray, config: Config, tables: ForwardModelCache
) -> Iterator[tuple[ForwardModel, np.ndarray]]:
    """Yield models with one Prony term, each with an initial guess.

    Nothing is yielded if the curve has no times.
    """
    forward_model = estimate.model.forward_model
    t = estimate.model.samples.t
    x = estimate.model.samples.x
    if t is None:
        return
    duration = float(np.ptp(t[x > estimate.contact_point]))
    key, relaxing_config = _add_relaxation(config, forward_model.max_depth)
    relaxing_model = tables.forward_model(
        relaxing_config,
        (*forward_model.varied_keys, f"{key}[0][0]", f"{key}[0][1]"),
        forward_model.max_depth,
    )
    instantaneous = _scale_modulus(
        theta, forward_model.scale_index, 1.0 / (1.0 - 0.5 * PRONY_FRACTIONS[0])
    )
    # Times of a Prony term relative to the time in contact.
    relative_times = (0.1, 0.4, 1.5)
    for fraction in relative_times:
        yield (
            relaxing_model,
            np.array([*instantaneous, math.log(PRONY_FRACTIONS[0]), math.log(fraction * duration)]),
        )


def _scene_max_force(forward_model: ForwardModel) -> float:
    """Return the largest force of the scene with its unchanged values."""
    return float(
        forward_model.elastic_curves.scene_curve.force(np.array([forward_model.max_depth]))[0]
    )


def _scale_modulus(theta: np.ndarray, scale_index: int | None, factor: float) -> np.ndarray:
    coordinates = theta.copy()
    if scale_index is not None:
        coordinates[scale_index] += math.log(factor)
    return coordinates


def _thickness_candidates(
    forward_model: ForwardModel, theta: np.ndarray, config: Config, tables: ForwardModelCache
) -> Iterator[tuple[ForwardModel, np.ndarray]]:
    """Yield models with a free height of a homogeneous body, unless the height is fitted."""
    body = config.body
    key = "body.height"
    radius = forward_model.elastic_curves.scene_curve.contact_radius
    if (
        key in forward_model.varied_keys
        or body.shape not in ("half_space", "layer")
        or body.layers
        or body.inclusions
    ):
        return
    min_height = MIN_HEIGHT_DEPTHS * forward_model.max_depth
    base_config = config
    if body.shape != "layer":
        layer = {"shape": "layer", "height": max(4.0 * radius, 2.0 * min_height)}
        base_config = config_from_mapping(to_mapping(config) | {"body": layer})
    layer_model = tables.forward_model(
        base_config, (*forward_model.varied_keys, key), forward_model.max_depth
    )
    # Initial guesses of the thickness, in contact radii.
    start_radii = (0.5, 1.5, 4.0)
    for fraction in start_radii:
        yield layer_model, np.array([*theta, math.log(max(fraction * radius, 1.1 * min_height))])


def _add_relaxation(config: Config, max_depth: float) -> tuple[str, Config]:
    """Return the key of the Prony terms of the first material, and the scene with one term."""
    keys = [f"{key}.relaxation" for key, _ in config.materials()]
    settings: list[tuple[str, Any]] = [
        (key, {"prony": [[PRONY_FRACTIONS[0], 1.0]]}) for key in keys
    ]
    # A relaxing material needs a loading history.
    settings.append(("loading", {"history": [[0.0, 0.0], [1.0, max_depth]]}))
    return f"{keys[0]}.prony", config_with_settings(
        to_mapping(config), config.source, [(*setting, ("--models", None)) for setting in settings]
    )


def add_to_experiment(config: Config, **parts: Any) -> Config:
    """Return the scene with parts added to its experiment; raise ConfigError if invalid."""
    document = to_mapping(config)
    document["experiment"] = {**document.get("experiment", {}), **parts}
    return config_from_mapping(document)
