"""Fit of one material to the loops of several tips together."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import (
    FIT_ERRORS,
    CurveFit,
    FitRequest,
    curve_result,
    fit_loop,
    fit_reason,
    fitted_part,
    prepare_curve,
    reject_outside_range,
    rejected_fit,
)
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.inference.estimate import (
    Estimate,
    initial_guesses,
    reject_without_signal,
)
from indent_sim.fitting.inference.joint_estimate import JointEstimate, estimate_jointly
from indent_sim.fitting.inference.model_assessment import (
    ModelAssessment,
    baseline_noise_probability,
    find_residual_trend,
)
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import MeasuredCurve

OTHER_TIP = "--other-tip"


def scenes_of_tips(request: FitRequest) -> list[Config]:
    """Return the scene of each curve: that of the request, and the same with the other tips.

    Raises
    ------
    ConfigError
        If a fit of several curves together is not possible with this scene, or a key is none of
        the tip.
    """
    config = request.config
    if not config.yields:
        problem = "several tips are fitted together only to a body that yields"
        raise ConfigError(OTHER_TIP, problem, "fit each curve on its own")
    if request.curve_part != "both":
        problem = "several tips are fitted together to loading and unloading"
        raise ConfigError(OTHER_TIP, problem, "give --segment both")
    if config.experiment and config.experiment.calibration:
        problem = "several tips cannot be fitted together with a common error of calibration"
        raise ConfigError("experiment.calibration", problem, "leave it out")
    if request.origin.contact_point is not None or request.origin.level is not None:
        problem = "each curve has a contact point and a baseline of its own, which are fitted"
        raise ConfigError(OTHER_TIP, problem, "leave --contact-point and --level out")
    for setting in request.other_tips:
        key = setting.partition("=")[0]
        if key.partition(".")[0] != "indenter":
            problem = f"{key} is no key of the tip, and the curves have all else in common"
            raise ConfigError(OTHER_TIP, problem, "give indenter.half_angle=VALUE")
    document = to_mapping(config)
    others = [config_from_mapping(document, (setting,)) for setting in request.other_tips]
    return [config, *others]


def fit_together(
    curves: Sequence[MeasuredCurve], request: FitRequest, tables: ForwardModelCache
) -> list[CurveFit]:
    """Fit several curves together, and return the result for each of them.

    All have the same parameters with the same intervals, in which the errors of the tabulated loops
    are contained. A scene explains a curve if it explains the curve alone, and if the curves do not
    contradict each other.

    Parameters
    ----------
    curves
        A curve for the scene's tip, and one for each of the other tips.
    request
        The scene and the settings of the fit.
    tables
        Cache of forward models that curves share.

    Raises
    ------
    ConfigError
        If the scene or a key is invalid. If a curve cannot be fitted, all results have the reason.
    """
    start_time = time.process_time()
    requests = [replace(request, config=config) for config in scenes_of_tips(request)]
    estimates: list[Estimate] = []
    scenes: list[Config] = []
    notes = []
    curve = curves[0]
    try:
        with np.errstate(all="ignore"):
            for curve, curve_request in zip(curves, requests, strict=True):
                config, samples, sentences = prepare_curve(
                    fitted_part(curve, curve_request), curve_request
                )
                reject_without_signal(samples)
                estimates.append(fit_loop(config, curve_request, samples, tables))
                scenes.append(config)
                notes.append(tuple(sentences))
            together = estimate_jointly(estimates, _scene_start(estimates[0]))
            reject_outside_range(together.curves[0])
            return [
                curve_result(
                    curve.name, _assessment(together, k, estimate), scene, sentences, start_time
                )
                for k, (curve, estimate, scene, sentences) in enumerate(
                    zip(curves, estimates, scenes, notes, strict=True)
                )
            ]
    except FIT_ERRORS as error:
        reason = f"{curve.name}: {fit_reason(error)}"
        seconds = time.process_time() - start_time
        return [rejected_fit(curve.name, reason, seconds) for curve in curves]


def _scene_start(estimate: Estimate) -> list[np.ndarray]:
    """Return theta with the hardening of the scene, and E and yield stress of a curve."""
    model = estimate.model
    guesses = initial_guesses(model.forward_model, model.samples, model.origin)
    return [guess[: model.coordinate_count] for guess in guesses]


def _assessment(together: JointEstimate, k: int, alone: Estimate) -> ModelAssessment:
    """Return the assessment of a curve, whose residuals are judged by its fit alone.

    In the fit together the errors of the tabulated loops are a trend of the residuals.
    """
    return ModelAssessment(
        together.curves[k],
        [],
        find_residual_trend(alone).shape,
        baseline_noise_probability(alone),
        together=together,
    )
