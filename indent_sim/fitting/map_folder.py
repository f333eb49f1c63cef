"""Fit of a map into a folder: map.h5, map.csv, images, a picture, and fit.json with a sample.

A sample of the curves is fitted one by one as well, with all tests of single curves: it shows
whether the faster fits of the map can be trusted.
"""

from __future__ import annotations

import csv
import io
import math
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.quantities import si_factor
from indent_sim.fitting import fit_table
from indent_sim.fitting.curve_fit import (
    CurveFit,
    FitRequest,
    cantilever_stiffness_si,
    fit_curve,
    format_value,
    quantity_kind,
    rejected_fit,
    relative_calibration_error,
    request_identity,
)
from indent_sim.fitting.fit_folder import (
    CURVES_FOLDER,
    FIT_TABLE,
    MAP_FIELDS,
    MAP_PICTURE,
    MAP_TABLE,
    PICTURES,
    ReadOptions,
    open_locked,
)
from indent_sim.fitting.forward_model.forward_model import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import number_at, replace_numbers
from indent_sim.fitting.inference.model_assessment import Interval
from indent_sim.fitting.inference.noise import NORMAL_95
from indent_sim.fitting.inference.pooled_noise import (
    MIN_BASELINE_SAMPLES,
    MIN_BASELINES,
    NoiseComponent,
    PooledNoise,
)
from indent_sim.fitting.map_fit import (
    FITTED,
    REASONS,
    TOO_DEEP,
    UNCERTAIN,
    MapFitter,
    MapModel,
    PixelFits,
)
from indent_sim.fitting.map_result import MapFit
from indent_sim.fitting.map_scene import (
    HEIGHT_KEY,
    MapScene,
    plan_map,
    thickness_model,
    thinnest_body,
)
from indent_sim.process.errors import NotConverged, UsageError
from indent_sim.process.limits import write_error
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.map_arrays import hdf5_bytes, read_hdf5_file, require_hdf5
from indent_sim.results.map_images import gwyddion_field, read_image, tiff_image
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve
from indent_sim.results.result_files import FIT, PROGRAM, read_report

# Curves that are also fitted one by one: as many at random as with the largest misfit.
SAMPLE_SIZE = 48
ReportLine = Callable[[str], None]


@dataclass(frozen=True)
class Thickness:
    """Thickness of each pixel of a map.

    Attributes
    ----------
    mean
        Median thickness [length of the scene], if it follows the height of the surface at zero
        force: the body lies on a flat base.
    values
        Thickness of each pixel (rows, columns) [length of the scene], if it is given.
    """

    mean: float | None = None
    values: np.ndarray | None = None


def fit_map(
    curves: MeasuredMap,
    request: FitRequest,
    thickness: Thickness | None = None,
    tell: ReportLine = lambda line: None,
) -> tuple[MapFit, list[CurveFit]]:
    """Fit a map, and a sample of its curves one by one.

    Parameters
    ----------
    curves
        The map.
    request
        Scene and settings of the fit; its only varied key is a modulus that scales the force.
    thickness
        Thickness of each pixel.
    tell
        Function that is called with each line of progress.

    Returns
    -------
    map_fit : MapFit
        The fit.
    sample : list of CurveFit
        Fits of single curves.

    Raises
    ------
    ConfigError
        If the scene or the keys are not valid for a map.
    UsageError
        If there is no contact, or if too few curves have a baseline.
    """
    start_time = time.process_time()
    tables = ForwardModelCache()
    scene = plan_map(curves, request, tables)
    fitter, thicknesses = _initial_fit(scene, thickness)
    noise = fitter.estimate_noise()
    if noise is None:
        raise UsageError(
            f"fewer than {MIN_BASELINES} curves of the map have a baseline of "
            f"{MIN_BASELINE_SAMPLES} samples, by which its noise is estimated",
            "fit curve by curve with --no-map",
        )
    tell(f"noise of the map: {noise_text(noise)}")
    last_told = time.monotonic()

    def tell_progress(done: int) -> None:
        nonlocal last_told
        # Time [s] between two lines of progress.
        interval = 2.0
        if time.monotonic() - last_told > interval:
            tell(f"{done} of {len(curves)} curves fitted")
            last_told = time.monotonic()

    with np.errstate(all="ignore"):
        fitter.fit(noise, tell_progress)
    map_fit = _map_fit(scene, fitter.fits, noise, thicknesses)
    sample = _fit_sample(scene, map_fit, fitter.fits, thicknesses, tables)
    entry = _entry(scene, map_fit, fitter.fits, sample, time.process_time() - start_time)
    return replace(map_fit, entry=entry), [fit for _, fit in sample]


def _initial_fit(
    scene: MapScene, thickness: Thickness | None
) -> tuple[MapFitter, np.ndarray | None]:
    """Return the fitter after its first pass, and the thickness of each curve (N,)."""
    model = MapModel(scene.forward_model, scene.request.origin)
    fitter = MapFitter(scene.samples, len(scene.curves), model)
    with np.errstate(all="ignore"):
        fitter.fit_initially()
    if thickness is None or not np.isfinite(fitter.initial_depths).any():
        return fitter, None
    if thickness.values is not None:
        places = scene.curves.places
        thicknesses = thickness.values[places[:, 0], places[:, 1]]
    else:
        assert thickness.mean is not None
        height = _surface_height(scene.curves, fitter.initial_contact_points)
        height = np.where(np.isfinite(height), height, np.nanmedian(height))
        thicknesses = thickness.mean + height - np.median(height)
    # The contact point moves by less than this fraction of the depth when the thickness is right.
    margin = 1.1
    max_depth = margin * float(np.nanmax(fitter.initial_depths))
    fitter.model = thickness_model(scene, thicknesses, max_depth)
    fitter.reject(thicknesses < thinnest_body(max_depth), TOO_DEEP)
    return fitter, thicknesses


def _surface_height(curves: MeasuredMap, contact_points: np.ndarray) -> np.ndarray:
    """Return the height of the surface at zero force (N,) [length of the scene]."""
    return -contact_points


def _map_fit(
    scene: MapScene, fits: PixelFits, noise: PooledNoise, thicknesses: np.ndarray | None
) -> MapFit:
    """Return values and stated intervals, and reject curves with wide intervals."""
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
    # An interval that is wider on one side is no result.
    widest = math.log(4.0)
    is_wide = np.fmax(fits.theta - stated_low, stated_high - fits.theta) > widest
    fits.reason[fits.is_fitted & is_wide] = UNCERTAIN
    is_fitted = fits.is_fitted

    def value(theta: np.ndarray) -> np.ndarray:
        return image(np.where(is_fitted, np.exp(np.clip(theta, -700.0, 700.0)), math.nan))

    reason = np.full(scene.curves.shape, -1)
    reason[scene.curves.places[:, 0], scene.curves.places[:, 1]] = fits.reason
    height = np.where(is_fitted, _surface_height(scene.curves, fits.contact_point), math.nan)
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
        None if thicknesses is None else image(thicknesses),
        {name: image(np.where(is_fitted, values, math.nan)) for name, values in pixels.items()},
        scene.curves.size,
        noise,
        {},
    )


def _fit_sample(
    scene: MapScene,
    map_fit: MapFit,
    fits: PixelFits,
    thicknesses: np.ndarray | None,
    tables: ForwardModelCache,
) -> list[tuple[int, CurveFit]]:
    """Fit curves one by one: half of them at random, half with the largest misfit."""
    fitted = np.flatnonzero(fits.is_fitted)
    count = min(SAMPLE_SIZE // 2, len(fitted))
    chosen = np.random.default_rng(0).choice(fitted, count, replace=False)
    misfit = np.fmax(
        -np.log10(np.maximum(fits.p_shape[fitted], 1e-300)), np.abs(fits.half_z[fitted])
    )
    worst = fitted[np.argsort(-misfit)[:count]]
    sample = []
    for index in np.unique(np.concatenate([chosen, worst])).tolist():
        request = scene.request
        if thicknesses is not None:
            config = replace_numbers(request.config, {HEIGHT_KEY: float(thicknesses[index])})
            request = replace(request, config=config)
        row, column = scene.curves.place(index)
        name = f"row {row} column {column}"
        try:
            curve = replace(scene.curves[index], name=name)
        except NoCurve as error:
            fit = rejected_fit(name, error.problem)
        else:
            fit = fit_curve(curve, request, tables)
        sample.append((index, fit))
    return sample


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
    noise = map_fit.noise
    record = {
        "shape": list(scene.curves.shape),
        "size": scene.curves.size,
        "curves": len(scene.curves),
        "fitted": len(values),
        "refused": counts,
        "explained": int(np.nansum(map_fit.explained)),
        "median": quartiles[1],
        "quartiles": [quartiles[0], quartiles[2]],
        "noise": {
            "components": [vars(component) for component in noise.components],
            "weights": list(noise.weights),
            "baselines": noise.baseline_count,
            "samples": noise.baseline_samples,
        },
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
    """Return how the fits of single curves differ from those of the map."""
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
        # Variation of the surface, relative to the height of the body, from which on one thickness
        # for all pixels is doubtful.
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
            f"and the fits have {length:.0f}: intervals may be too narrow if the noise is slow"
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


def find_map(
    paths: Sequence[Path],
    request: FitRequest,
    reading: ReadOptions,
    choice: bool | None,
    grid: tuple[int, int] | None,
) -> MeasuredMap | None:
    """Return the map that is to be fitted, or None if curves are to be fitted one by one.

    Parameters
    ----------
    paths
        Files and folders of curves.
    request
        Settings of the fit.
    reading
        Options for reading the files.
    choice
        True for a map, False for single curves, None for a map if a file contains enough curves.
    grid
        Rows and columns, if the files of a folder, in the order of their names, are a map.

    Raises
    ------
    UsageError
        If a map is asked for, and the files contain none.
    """
    if request.curve_part != "approach":
        if choice or grid is not None:
            raise UsageError(
                f"--segment {request.curve_part}: a map is fitted to the approach of its curves",
                "leave --segment out, or fit curve by curve with --no-map",
            )
        return None
    if choice is False:
        return None
    if grid is not None:
        return _map_of_files([file for path in paths for file in curve_files(path)], grid, reading)
    if len(paths) == 1 and paths[0].is_file():
        try:
            curves = read_curves(
                paths[0],
                reading.columns or None,
                reading.units,
                cantilever_stiffness_si(request.config),
            )
        except NoCurve:
            if choice:
                raise
            return None
        if isinstance(curves, MeasuredMap) and (choice or len(curves) >= MIN_BASELINES):
            return curves
    if choice:
        raise UsageError(
            "--map: no file with a grid of curves", "give one map file, or a folder with --grid"
        )
    return None


def _map_of_files(
    files: Sequence[Path], grid: tuple[int, int], reading: ReadOptions
) -> MeasuredMap:
    """Return the map whose curves are the files, row by row."""
    rows, columns = grid
    if len(files) != rows * columns:
        raise UsageError(f"--grid {rows}x{columns}: there are {len(files)} files")

    def read_curve(index: int) -> MeasuredCurve:
        return read_curves(files[index], reading.columns or None, reading.units)[0]

    places = np.column_stack(np.divmod(np.arange(len(files)), columns))
    return MeasuredMap(grid, None, places, read_curve)


def fit_map_folder(
    curves: MeasuredMap,
    request: FitRequest,
    directory: Path,
    thickness: str | None = None,
    tell: ReportLine = lambda line: None,
) -> MapFit:
    """Fit a map into a folder; see `fit_map` for errors, and `require_hdf5`.

    Parameters
    ----------
    curves
        The map.
    request
        Scene and settings of the fit.
    directory
        Folder of the fit.
    thickness
        Thickness of the pixels, see `parse_thickness`.
    tell
        Function that is called with each line of progress.
    """
    require_hdf5()
    pixel_thickness = parse_thickness(thickness, request, curves.shape) if thickness else None
    identity = dict(request_identity(request)) | {"map": {"thickness": thickness}}
    with open_locked(directory, identity):
        map_fit, sample = fit_map(curves, request, pixel_thickness, tell)
        map_fit = replace(map_fit, entry=map_fit.entry | {"request": identity})
        write_map(map_fit, sample, request, directory)
    tell(map_fit.words)
    for warning in map_fit.entry["warnings"]:
        tell(f"  warning: {warning}")
    return map_fit


def write_map(
    map_fit: MapFit, sample: list[CurveFit], request: FitRequest, directory: Path
) -> None:
    """Write the files of a map into the folder of a fit.

    Raises
    ------
    UsageError
        If the folder cannot be written.
    """
    quantities = {
        map_fit.key: map_fit.value,
        f"{map_fit.key}_low": map_fit.low,
        f"{map_fit.key}_high": map_fit.high,
        "statistical_low": map_fit.statistical_low,
        "statistical_high": map_fit.statistical_high,
        "height": map_fit.height,
        **({} if map_fit.thickness is None else {"thickness": map_fit.thickness}),
        **map_fit.pixels,
        "explained": map_fit.explained,
    }
    try:
        attributes: dict[str, Any] = {
            "key": map_fit.key,
            "program": f"{PROGRAM} {VERSION}",
            "reasons": REASONS,
        }
        if map_fit.size is not None:
            attributes |= {"size_m": map_fit.size}
        arrays = quantities | {"reason": map_fit.reason.astype(np.int8)}
        write_atomically(directory / MAP_FIELDS, hdf5_bytes(arrays, attributes))
        write_atomically(directory / MAP_TABLE, _table(map_fit, quantities))
        for name, values, kind in (
            (
                map_fit.key.rpartition(".")[2],
                map_fit.value,
                quantity_kind(request.config, map_fit.key),
            ),
            ("height", map_fit.height, "length"),
        ):
            unit, factor = _si_unit(request, kind)
            data = values * factor
            write_atomically(
                directory / f"{name}.gsf", gwyddion_field(data, map_fit.size, name, unit)
            )
            write_atomically(directory / f"{name}.tif", tiff_image(data, map_fit.size, unit))
        for fit in sample:
            if fit.plotted is not None:
                table = fit_table.table_of_curve(fit.plotted)
                write_atomically(directory / CURVES_FOLDER / f"{fit.name}.csv", table, sync=False)
        entries = [fit.entry for fit in sample]
        write_atomically(
            directory / FIT_TABLE, fit_table.table_of_fits(entries, request.varied_keys)
        )
        if request.config.output.plot:
            _draw(map_fit, sample, request, directory)
        status = "done" if map_fit.entry["map"]["fitted"] else "failed"
        code = 0 if status == "done" else NotConverged.exit_code
        header = {"program": PROGRAM, "version": VERSION, "status": status, "exit_code": code}
        write_atomically(directory / FIT, to_json(header | map_fit.entry) + "\n")
    except OSError as error:
        raise write_error(directory, error) from error


def _draw(map_fit: MapFit, sample: list[CurveFit], request: FitRequest, directory: Path) -> None:
    from indent_sim.fitting import fit_picture, map_picture

    map_picture.draw_map(map_fit, request.config, directory / MAP_PICTURE)
    (directory / PICTURES).mkdir(exist_ok=True)
    # Pictures of single curves take longer than the fit of a small map.
    max_pictures = 12
    plotted = [fit for fit in sample if fit.plotted is not None]
    for fit in plotted[:: max(1, len(plotted) // max_pictures)]:
        fit_picture.draw_curve(fit, request.config, directory / PICTURES / f"{fit.name}.png")


def _si_unit(request: FitRequest, kind: str | None) -> tuple[str, float]:
    """Return the SI unit of a quantity and the factor to it; without units of the scene "", 1."""
    units = request.config.units
    if kind is None or not units.length or not (units.force or kind == "length"):
        return "", 1.0
    length = si_factor(units.length, "length")
    if kind == "length":
        return "m", length
    return "Pa", si_factor(units.force, "force") / length**2


def _table(map_fit: MapFit, quantities: dict[str, np.ndarray]) -> str:
    """Return map.csv: a row for each pixel."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [name for name in quantities if name != "explained"]
    writer.writerow(["row", "column", "x", "y", "status", "reason", "explained", *names])
    rows, columns = map_fit.value.shape
    spacing = (
        (math.nan, math.nan)
        if map_fit.size is None
        else (map_fit.size[0] / rows, map_fit.size[1] / columns)
    )
    for row, column in np.ndindex(rows, columns):
        code = int(map_fit.reason[row, column])
        is_fitted = code == FITTED
        reason = REASONS[code] if code >= 0 else "no curve"
        explained = bool(map_fit.explained[row, column] == 1.0)
        cells = [
            row,
            column,
            _cell((column + 0.5) * spacing[1]),
            _cell((row + 0.5) * spacing[0]),
            "done" if is_fitted else "refused",
            reason,
            str(explained).lower() if is_fitted else "",
        ]
        writer.writerow([*cells, *(_cell(float(quantities[name][row, column])) for name in names)])
    return text.getvalue()


def _cell(value: float) -> str:
    return f"{value:.7g}" if math.isfinite(value) else ""


def read_map(folder: Path) -> MapFit:
    """Return the map of a folder; raise UsageError if it has no readable map."""
    entry = read_report(folder, FIT)
    try:
        arrays, attributes = read_hdf5_file(folder / MAP_FIELDS)
        key = str(attributes["key"])
        size = attributes.get("size_m")
        noise = entry["map"]["noise"]
        components = tuple(
            NoiseComponent(component["decay_length"], component["wavelength"] or math.inf)
            for component in noise["components"]
        )
        return MapFit(
            key,
            arrays.pop(key),
            arrays.pop(f"{key}_low"),
            arrays.pop(f"{key}_high"),
            arrays.pop("statistical_low"),
            arrays.pop("statistical_high"),
            arrays.pop("explained"),
            arrays.pop("reason").astype(int),
            arrays.pop("height"),
            arrays.pop("thickness", None),
            arrays,
            None if size is None else (float(size[0]), float(size[1])),
            PooledNoise(components, tuple(noise["weights"]), noise["baselines"], noise["samples"]),
            entry,
        )
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"{folder} contains no readable map: {type(error).__name__} {error}"
        ) from None


def parse_thickness(text: str, request: FitRequest, shape: tuple[int, int]) -> Thickness:
    """Return the thickness of the pixels by `height`, `height:MEAN`, or a file.

    Parameters
    ----------
    text
        `height`: body.height is the median thickness, and the thickness follows the surface;
        `height:MEAN` with another median, such as `height:6 um`; or a .gsf, .tif or text file with
        a number for each pixel [length of the scene; .gsf: m].
    request
        The scene.
    shape
        Shape of the map.

    Raises
    ------
    UsageError
        If the file cannot be read, or has another shape.
    ConfigError
        If the body has no height, or the median is not a length.
    """
    config = request.config
    if match := re.fullmatch(r"height(?::(.+))?", text):
        if match[1]:
            config = replace_numbers(config, {HEIGHT_KEY: _number_or_text(match[1])})
        return Thickness(mean=number_at(config, HEIGHT_KEY))
    path = Path(text)
    try:
        values = read_image(path)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"--thickness {text}: cannot be read ({error})",
            "give height, height:MEAN as in height:6um, or a .gsf, .tif or .csv file",
        ) from None
    if values.shape != shape:
        raise UsageError(
            f"--thickness {text}: has {values.shape[0]} x {values.shape[1]} numbers, and the map "
            f"{shape[0]} x {shape[1]} pixels"
        )
    if path.suffix.lower() == ".gsf":
        unit, factor = _si_unit(request, "length")
        values = values / factor if unit else values
    return Thickness(values=values)


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
