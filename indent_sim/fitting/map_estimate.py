"""Fit of a map: values with intervals, the noise, and some curves fitted like single curves.

These sampled curves are fitted one by one with all tests of single curves. Their fits show whether
the faster fits of the map can be trusted.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from indent_sim.fitting.curve_fit import (
    CurveFit,
    FitRequest,
    fit_curve,
    format_value,
    relative_calibration_error,
    request_identity,
)
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import replace_numbers
from indent_sim.fitting.inference.model_assessment import Interval
from indent_sim.fitting.inference.noise import NORMAL_95
from indent_sim.fitting.inference.pooled_noise import (
    MIN_BASELINE_SAMPLES,
    MIN_BASELINES,
    PooledNoise,
)
from indent_sim.fitting.map_blocks import fit_blocks, process_crash
from indent_sim.fitting.map_fit import (
    BARE_SUBSTRATE,
    FITTED,
    REASONS,
    TOO_DEEP,
    UNCERTAIN,
    MapFitter,
    MapModel,
    PixelFits,
)
from indent_sim.fitting.map_progress import (
    FITTED_WITH_NOISE,
    INITIALLY_FITTED,
    REFITTED,
    MapProgress,
    ThicknessFit,
)
from indent_sim.fitting.map_result import MapFit
from indent_sim.fitting.map_scene import (
    HEIGHT_KEY,
    MapScene,
    largest_depth,
    plan_map,
    thickness_model,
    thinnest_body,
)
from indent_sim.fitting.map_source import named_curve
from indent_sim.fitting.map_thickness import Thickness, heights_above_base
from indent_sim.process.child_process import ChildProcess, ProcessCrash, run_calls
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.process.usage import cpu_time
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import MeasuredCurve

ReportLine = Callable[[str], None]


def fit_map(
    curves: MeasuredMap,
    request: FitRequest,
    thickness: Thickness | None = None,
    jobs: int = 1,
    progress: MapProgress | None = None,
    tell: ReportLine = lambda line: None,
) -> tuple[MapFit, list[CurveFit]]:
    """Fit a map, and in addition some of its curves one by one.

    Parameters
    ----------
    curves
        The map.
    request
        Scene and settings of the fit; its only varied key is a modulus that scales the force.
    thickness
        Thickness of each pixel.
    jobs
        Number of processes that fit blocks of curves.
    progress
        Results of an earlier call, from which this call continues.
    tell
        Function that is called with each line of progress.

    Returns
    -------
    map_fit : MapFit
        The fit.
    sample : list of CurveFit
        Fits of the curves that were fitted one by one.

    Raises
    ------
    ConfigError
        If the scene or the keys are not valid for a map.
    UsageError
        If there is no contact, or if too few curves have a baseline.
    """
    start_time = cpu_time()
    progress = progress or MapProgress()
    tables = ForwardModelCache()
    scene = plan_map(curves, request, tables)
    model = MapModel(scene.forward_model, scene.request.origin)
    fitter = MapFitter(scene.samples, len(curves), model)
    kept = progress.restore(fitter)
    if kept:
        tell(f"{kept} of {len(curves)} curves were fitted by an earlier call")
    passes = _Passes(fitter, progress, jobs, tell)
    passes.run(INITIALLY_FITTED, None)
    if progress.noise is None:
        progress.noise = _estimate_noise(fitter)
    tell(f"noise of the map: {noise_text(progress.noise)}")
    thicknesses = _set_thickness(passes, scene, thickness)
    passes.run(FITTED_WITH_NOISE, progress.noise)
    noise = progress.noise
    map_fit = map_fit_of_curves(scene, fitter.fits, noise, thicknesses)
    sample = _fit_sample(passes, scene, thicknesses, tables)
    entry = _entry(scene, map_fit, fitter.fits, sample, cpu_time() - start_time)
    return replace(map_fit, entry=entry), [fit for _, fit in sample]


@dataclass(frozen=True)
class _Passes:
    """Fits of all blocks of curves of a map, once per stage; each finished block is written."""

    fitter: MapFitter
    progress: MapProgress
    jobs: int
    tell: ReportLine

    def run(self, stage: int, noise: PooledNoise | None) -> None:
        """Fit the blocks whose fits have not yet reached a stage."""
        blocks = self.progress.unfinished(self.fitter, stage)
        done = self.fitter.count - sum(map(len, blocks))
        last_told = time.monotonic()

        def finish(block: np.ndarray) -> None:
            nonlocal done, last_told
            self.progress.finish_block(self.fitter, block, stage)
            done += len(block)
            # Time [s] between two lines of progress.
            interval = 2.0
            if time.monotonic() - last_told > interval:
                name = "fitted" if noise else "fitted by ordinary least squares"
                self.tell(f"{done} of {self.fitter.count} curves {name}")
                last_told = time.monotonic()

        fit_blocks(self.fitter, blocks, noise, self.jobs, finish)


def _estimate_noise(fitter: MapFitter) -> PooledNoise:
    noise = fitter.estimate_noise()
    if noise is None:
        raise UsageError(
            f"fewer than {MIN_BASELINES} curves of the map have a baseline of "
            f"{MIN_BASELINE_SAMPLES} samples, by which its noise is estimated",
            "fit curve by curve with --no-map",
        )
    return noise


def _set_thickness(
    passes: _Passes, scene: MapScene, thickness: Thickness | None
) -> np.ndarray | None:
    """Set the thickness of each curve (N,) in the fitter after the first pass, and return it.

    A thickness that follows from the contact points is computed twice, since the first pass finds
    them for a body of uniform thickness.
    """
    fitter = passes.fitter
    if thickness is None or not np.isfinite(fitter.initial_depths).any():
        return None
    if thickness.values is None:
        if thickness.mean is None and REFITTED not in passes.progress.thickness:
            fitter.reject(_is_bare_substrate(fitter, scene), BARE_SUBSTRATE)
        _use_thickness(passes, scene, thickness, REFITTED)
        passes.run(REFITTED, None)
    return _use_thickness(passes, scene, thickness, FITTED_WITH_NOISE)


def _use_thickness(
    passes: _Passes, scene: MapScene, thickness: Thickness, stage: int
) -> np.ndarray:
    """Set the thicknesses (N,) of a stage in the fitter; those of an earlier call are reused."""
    fitter = passes.fitter
    kept = passes.progress.thickness
    if stage not in kept:
        # Another thickness moves the contact point by less than this fraction of the depth.
        margin = 1.1
        max_depth = margin * largest_depth(fitter.initial_depths, percentile=99.0)
        kept[stage] = ThicknessFit(_thicknesses(fitter, scene, thickness, max_depth), max_depth)
        passes.progress.save(fitter)
    values = kept[stage].values
    max_depth = kept[stage].max_depth
    fitter.model = thickness_model(scene, values, max_depth)
    fitter.reject(values < thinnest_body(max_depth), TOO_DEEP)
    return values


def _thicknesses(
    fitter: MapFitter, scene: MapScene, thickness: Thickness, max_depth: float
) -> np.ndarray:
    """Return the thickness of each curve (N,), as it is given or from the contact points."""
    places = scene.curves.places
    if thickness.values is not None:
        given: np.ndarray = thickness.values[places[:, 0], places[:, 1]]
        return given
    height = scene.surface_height(fitter.initial.contact_point, fitter.initial.travel)
    is_fitted = fitter.fits.is_fitted
    if thickness.mean is not None:
        values = thickness.mean + height - np.nanmedian(height[is_fitted])
    else:
        values = heights_above_base(places, height, fitter.fits.reason == BARE_SUBSTRATE)
    # The thickness of rejected curves is not used. By noise a surface may lie below the base.
    values = np.where(is_fitted & np.isfinite(values), values, np.nanmedian(values[is_fitted]))
    thicknesses: np.ndarray = np.maximum(values, 0.5 * thinnest_body(max_depth))
    return thicknesses


def _is_bare_substrate(fitter: MapFitter, scene: MapScene) -> np.ndarray:
    """Return for each curve (N,) whether the tip is on the bare, rigid substrate.

    There the cantilever is deflected, and the indentation is negligible.

    Raises
    ------
    ConfigError
        If the scene has no cantilever, whose deflection is needed to recognise the substrate.
    """
    if not scene.forward_model.experiment.compliance:
        raise ConfigError(
            "--thickness",
            "pixels of bare substrate are recognised by the deflection of a cantilever, but the "
            "scene has none",
            "give experiment.cantilever, or another --thickness",
        )
    # Depth of a rigid body, over the displacement of the cantilever's base.
    max_depth_fraction = 0.05
    initial = fitter.initial
    is_bare: np.ndarray = fitter.fits.is_fitted & (
        initial.depth < max_depth_fraction * initial.travel
    )
    return is_bare


def map_fit_of_curves(
    scene: MapScene, fits: PixelFits, noise: PooledNoise, thicknesses: np.ndarray | None
) -> MapFit:
    """Return values and stated intervals, and reject curves with wide intervals.

    Parameters
    ----------
    scene
        The map.
    fits
        Fits of its curves.
    noise
        Noise of the map.
    thicknesses
        Thickness of each curve (N,) [length], if it differs.
    """
    request = scene.request
    image = scene.curves.image
    parameter = scene.forward_model.parameters[0]
    half_width = NORMAL_95 * fits.theta_sd
    low = fits.theta - half_width
    high = fits.theta + half_width
    explained = fits.is_explained
    stated_low = np.where(explained, low, np.fmin(low, fits.low_theta))
    stated_high = np.where(explained, high, np.fmax(high, fits.high_theta))
    systematic = math.hypot(
        scene.forward_model.relative_error,
        NORMAL_95 * relative_calibration_error(request.config, scene.forward_model),
    )
    stated_low = fits.theta - np.hypot(fits.theta - stated_low, systematic)
    stated_high = fits.theta + np.hypot(stated_high - fits.theta, systematic)
    # A curve whose interval is wider than this on one side is rejected.
    widest = math.log(4.0)
    is_wide = np.fmax(fits.theta - stated_low, stated_high - fits.theta) > widest
    fits.reason[fits.is_fitted & is_wide] = UNCERTAIN
    is_fitted = fits.is_fitted

    def value(theta: np.ndarray) -> np.ndarray:
        return image(np.where(is_fitted, np.exp(np.clip(theta, -700.0, 700.0)), math.nan))

    reason = np.full(scene.curves.shape, -1)
    reason[scene.curves.places[:, 0], scene.curves.places[:, 1]] = fits.reason
    height = scene.surface_height(fits.contact_point, fits.travel)
    height = np.where(is_fitted, height, math.nan)
    pixels = {
        "contact_point": fits.contact_point,
        "contact_point_low": fits.contact_point - NORMAL_95 * fits.contact_point_sd,
        "contact_point_high": fits.contact_point + NORMAL_95 * fits.contact_point_sd,
        "baseline": fits.level,
        "slope": fits.slope,
        "force_max": fits.max_force,
        "depth": fits.depth,
        "rms_percent": 100.0 * fits.rms / fits.max_force,
        "p_shape": fits.p_shape,
        "drift_percent": 100.0 * np.expm1(fits.half_theta - fits.theta),
        "z_half": fits.half_z,
        "n": np.where(is_fitted, fits.point_count, math.nan),
    }
    return MapFit(
        parameter.key,
        value(fits.theta),
        value(stated_low),
        value(stated_high),
        value(low),
        value(high),
        image(np.where(is_fitted, explained, math.nan)),
        reason,
        image(height - np.nanmedian(height)),
        None if thicknesses is None else image(np.where(is_fitted, thicknesses, math.nan)),
        {name: image(np.where(is_fitted, values, math.nan)) for name, values in pixels.items()},
        scene.curves.size,
        noise,
        {},
    )


def _fit_sample(
    passes: _Passes,
    scene: MapScene,
    thicknesses: np.ndarray | None,
    tables: ForwardModelCache,
) -> list[tuple[int, CurveFit]]:
    """Fit a sample of the curves one by one: half at random, half with the largest misfit."""
    progress = passes.progress
    indices = _sample_indices(passes.fitter.fits)

    def pixel_request(index: int) -> FitRequest:
        if thicknesses is None:
            return scene.request
        config = replace_numbers(scene.request.config, {HEIGHT_KEY: float(thicknesses[index])})
        return replace(scene.request, config=config)

    calls = [
        (index, _fit_in_child, (named_curve(scene.curves, index), pixel_request(index)))
        for index in indices
        if index not in progress.sample
    ]
    if passes.jobs == 1:
        for index, _, arguments in calls:
            progress.finish_curve(passes.fitter, index, fit_curve(*arguments, tables))
    else:
        with ExitStack() as stack:
            processes = [ChildProcess(__name__) for _ in range(passes.jobs)]
            for process in processes:
                stack.callback(process.stop)
            for index, answer in run_calls(processes, calls):
                progress.finish_curve(passes.fitter, index, _receive_fit(answer))
    return [(index, progress.sample[index]) for index in indices]


def _sample_indices(fits: PixelFits) -> list[int]:
    """Return the curves that are fitted one by one."""
    fitted = np.flatnonzero(fits.is_fitted)
    # Number of curves that are also fitted one by one: half are random, half have the largest
    # misfit.
    sample_size = 48
    count = min(sample_size // 2, len(fitted))
    chosen = np.random.default_rng(0).choice(fitted, count, replace=False)
    misfit = np.fmax(
        -np.log10(np.maximum(fits.p_shape[fitted], 1e-300)), np.abs(fits.half_z[fitted])
    )
    worst = fitted[np.argsort(-misfit)[:count]]
    indices: list[int] = np.unique(np.concatenate([chosen, worst])).tolist()
    return indices


def _fit_in_child(curve: MeasuredCurve, request: FitRequest) -> CurveFit:
    """Fit one curve in a child process, which keeps its forward models for later curves."""
    return fit_curve(curve, request, _forward_models())


@cache
def _forward_models() -> ForwardModelCache:
    """Return the cache of forward models of this process."""
    return ForwardModelCache()


def _receive_fit(answer: Callable[[], CurveFit]) -> CurveFit:
    try:
        return answer()
    except ProcessCrash as crash:
        raise process_crash(crash) from None


def _entry(
    scene: MapScene,
    map_fit: MapFit,
    fits: PixelFits,
    sample: list[tuple[int, CurveFit]],
    seconds: float,
) -> dict[str, Any]:
    """Return the content of fit.json for a map."""
    counts = {
        REASONS[code]: int(np.count_nonzero(fits.reason == code))
        for code in np.unique(fits.reason[fits.reason != FITTED])
    }
    values = map_fit.value[np.isfinite(map_fit.value)]
    quartiles = np.percentile(values, [25, 50, 75]).tolist() if len(values) else [None] * 3
    comparison = _compare_sample(map_fit, fits, sample)
    record = {
        "shape": list(scene.curves.shape),
        "size": scene.curves.size,
        "curves": len(scene.curves),
        "fitted": len(values),
        "refused": counts,
        "explained": int(np.nansum(map_fit.explained)),
        "median": quartiles[1],
        "quartiles": [quartiles[0], quartiles[2]],
        "noise": map_fit.noise.as_record(),
        "sample": comparison,
    }
    warnings = [*scene.notes, *_warnings(scene, map_fit, record)]
    return {
        "request": request_identity(scene.given_request),
        "scene": str(scene.request.config.source.name),
        "vary": list(scene.request.varied_keys),
        "map": record,
        "curves": [fit.entry for _, fit in sample],
        "words": _summary(scene, map_fit, record),
        "warnings": warnings,
        "seconds": seconds,
    }


def _compare_sample(
    map_fit: MapFit, fits: PixelFits, sample: list[tuple[int, CurveFit]]
) -> dict[str, Any]:
    """Return how the curves that were fitted one by one differ from the fits of the map."""
    shifts = []
    ratios = []
    causes: dict[str, int] = {}
    for index, fit in sample:
        if not fit.is_done:
            continue
        parameter = fit.entry["parameters"][map_fit.key]
        value = math.log(parameter["value"])
        statistical = np.log(np.maximum(parameter["statistical"], 1e-300))
        sd = float(fits.theta_sd[index])
        shifts.append(abs(value - float(fits.theta[index])) / sd)
        ratios.append(float(statistical[1] - statistical[0]) / (2.0 * NORMAL_95 * sd))
        for cause in fit.entry["cause"]:
            causes[cause] = causes.get(cause, 0) + 1
    return {
        "curves": len(sample),
        "fitted": len(shifts),
        "median_shift": float(np.median(shifts)) if shifts else None,
        "median_width_ratio": float(np.median(ratios)) if ratios else None,
        "causes": causes,
    }


def _warnings(scene: MapScene, map_fit: MapFit, record: dict[str, Any]) -> list[str]:
    messages = []
    comparison = record["sample"]
    # Median shift in standard deviations, and ratios of widths, beyond which a map is doubtful.
    max_shift = 0.5
    width_range = (0.6, 2.0)
    shift = comparison["median_shift"]
    ratio = comparison["median_width_ratio"]
    if shift is not None and shift > max_shift:
        messages.append(
            f"fits of single curves differ from the map by {shift:.2g} standard deviations in the "
            "median: use --no-map"
        )
    if ratio is not None and not width_range[0] <= ratio <= width_range[1]:
        messages.append(
            f"intervals of single curves are {ratio:.2g} times as wide as those of the map in the "
            "median: the noise of the map is not that of its curves; use --no-map"
        )
    height = getattr(scene.request.config.body, "height", None)
    if height and map_fit.thickness is None and np.isfinite(map_fit.height).any():
        low, high = np.nanpercentile(map_fit.height, [2.5, 97.5])
        # If the surface varies by more than this fraction of the body's height, a uniform thickness
        # is doubtful.
        max_variation = 0.1
        if high - low > max_variation * height:
            messages.append(
                f"the height at zero force varies by {100 * (high - low) / height:.0f} % of "
                "body.height: if the base is flat, the thickness varies as much; give "
                "--thickness height:MEAN or a file of thicknesses"
            )
    length = float(np.nanmedian(map_fit.pixels["n"]))
    if map_fit.noise.baseline_samples < 0.25 * length:
        messages.append(
            f"the noise is estimated from baselines of {map_fit.noise.baseline_samples} samples, "
            f"and the fits have {length:.0f}: if the noise varies slowly, intervals may be too "
            "narrow"
        )
    return messages


def noise_text(noise: PooledNoise) -> str:
    """Return a description of the noise of a map."""
    white = noise.white_fraction
    waves = noise.wave_fraction
    correlated = max(1.0 - white - waves, 0.0)
    parts = []
    # Parts below this fraction of the variance are not named.
    smallest_part = 0.03
    if white > smallest_part:
        parts.append(f"{100 * white:.0f} % white")
    if correlated > smallest_part:
        parts.append(
            f"{100 * correlated:.0f} % correlated over {noise.correlation_time:.2g} samples"
        )
    if waves > smallest_part:
        parts.append(f"{100 * waves:.0f} % waves")
    return ", ".join(parts)


def _summary(scene: MapScene, map_fit: MapFit, record: dict[str, Any]) -> str:
    """Return the result of a map in a few sentences."""
    refused = sum(record["refused"].values())
    sentences = [f"{record['curves']} curves: {record['fitted']} fitted"]
    if refused:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in record["refused"].items())
        sentences[0] += f", {refused} refused: {reasons}"
    if record["fitted"]:
        config = scene.request.config
        key = map_fit.key
        low, high = record["quartiles"]
        interval = Interval(record["median"], low, high)
        median_text, low_text, high_text = (
            format_value(key, config, number, interval) for number in (interval.value, low, high)
        )
        width = 50.0 * np.nanmedian((map_fit.high - map_fit.low) / map_fit.value)
        name = key.rpartition(".")[2]
        sentences.append(
            f"{name} = {median_text} in the median, {low_text} to {high_text} for the middle half; "
            f"the half width "
            f"of an interval is {width:.2g} % in the median"
        )
        sentences.append(f"Noise of the map: {noise_text(map_fit.noise)}")
        share = 100.0 * record["explained"] / record["fitted"]
        sentences.append(f"The scene explains {share:.3g} % of the fitted curves")
        comparison = record["sample"]
        if comparison["fitted"]:
            sentences.append(
                f"{comparison['fitted']} curves fitted one by one differ by "
                f"{comparison['median_shift']:.2g} standard deviations in the median, and have "
                f"{comparison['median_width_ratio']:.2g} times as wide intervals"
            )
    return ". ".join(sentences) + "."
