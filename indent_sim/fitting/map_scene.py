"""Scene of a map: forces of its pixels, which may have different thicknesses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from indent_sim.config.quantities import si_factor
from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import (
    SOLVED_DEPTH_FACTOR,
    FitRequest,
    convert_to_scene_units,
    max_contact_depth,
    prepare_curve,
)
from indent_sim.fitting.forward_model.elastic_load_curve import (
    ElasticLoadCurve,
    TabulatedLoadCurve,
    solve_load_curve,
)
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.forward_model.parameters import (
    MIN_HEIGHT_DEPTHS,
    number_at,
    replace_numbers,
)
from indent_sim.fitting.inference.estimate import (
    MAX_SAMPLES,
    FitRejected,
    Samples,
    reject_without_signal,
)
from indent_sim.fitting.map_fit import MapModel
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import NoCurve

HEIGHT_KEY = "body.height"


@dataclass(frozen=True)
class MapScene:
    """Scene of a map with its curves in units of the scene.

    Attributes
    ----------
    given_request
        Settings of the fit as they were given.
    request
        Settings of the fit, with the scene that the curves need, such as its spring.
    curves
        The map.
    forward_model
        Forces of the scene up to the largest depth of the map.
    notes
        Sentences about assumptions.
    block_size
        Number of neighbouring samples whose means are fitted.
    """

    given_request: FitRequest
    request: FitRequest
    curves: MeasuredMap
    forward_model: ForwardModel
    notes: tuple[str, ...]
    block_size: int = 1

    def samples(self, index: int) -> Samples:
        """Return the samples of a curve; none if it is damaged or has no approach."""
        try:
            curve = convert_to_scene_units(self.curves[index], self.request.config)
            _, samples, _ = prepare_curve(curve.part(self.request.curve_part), self.request)
        except NoCurve:
            return Samples(np.zeros(0), np.zeros(0))
        return samples.means_of_blocks(self.block_size)

    def surface_height(self, contact_points: np.ndarray, travels: np.ndarray) -> np.ndarray:
        """Return the height of the surface at zero force (N,) [length], up to a constant.

        In a file with an image of the height, displacements begin anew for each curve. The image
        then gives the height of the base of the spring at the turning point, and the surface is
        `travel` above it.

        Parameters
        ----------
        contact_points
            Displacements at first contact (N,) [length].
        travels
            Displacements from first contact to the deepest sample (N,) [length].
        """
        image = self.curves.height
        if image is None:
            return -contact_points
        places = self.curves.places
        length = self.request.config.units.length
        factor = si_factor(length, "length") if length else 1.0
        return image[places[:, 0], places[:, 1]] / factor + travels  # type: ignore[no-any-return]


def plan_map(curves: MeasuredMap, request: FitRequest, tables: ForwardModelCache) -> MapScene:
    """Return the scene of a map, solved up to the largest depth of its curves.

    Raises
    ------
    ConfigError
        If the scene is invalid, or if a map cannot vary its keys.
    UsageError
        If no curve has a contact.
    """
    _check_keys(request)
    # Number of curves from which the largest depth of a map is estimated.
    probe_count = 200
    probes = np.unique(np.linspace(0, len(curves) - 1, min(probe_count, len(curves))).astype(int))
    depths = []
    counts = []
    config = request.config
    notes: list[str] = []
    for index in probes:
        try:
            curve = convert_to_scene_units(curves[int(index)], request.config)
            config, samples, notes = prepare_curve(curve.part(request.curve_part), request)
            reject_without_signal(samples)
        except (NoCurve, FitRejected):
            continue
        depths.append(max_contact_depth(samples, config))
        counts.append(len(samples))
    if not depths:
        raise UsageError("no curve of the map has a contact")
    depth = SOLVED_DEPTH_FACTOR * largest_depth(np.array(depths), percentile=95.0)
    try:
        forward_model = tables.forward_model(config, request.varied_keys, depth)
    except ForwardModelUnavailable as error:
        raise ConfigError(
            "loading", str(error), "use a scene that is valid at this depth"
        ) from None
    _check_model(forward_model, request)
    block_size = math.ceil(np.median(counts) / MAX_SAMPLES)
    planned = replace(request, config=config)
    return MapScene(request, planned, curves, forward_model, tuple(notes), block_size)


def largest_depth(depths: np.ndarray, percentile: float) -> float:
    """Return the depth [length] up to which load curves are solved for a map.

    It is the largest depth of the curves of the map, but at most 1.5 times the given percentile: a
    curve that never touches the body, if this is not noticed, may seem to have any depth, even more
    than the thickness of the body.
    """
    max_ratio = 1.5
    return float(min(np.nanmax(depths), max_ratio * np.nanpercentile(depths, percentile)))


def _check_keys(request: FitRequest) -> None:
    remedy = "fix the others, or fit curve by curve with --no-map"
    if len(request.varied_keys) != 1:
        raise ConfigError("--vary", "a map varies one modulus", remedy)
    number_at(request.config, request.varied_keys[0])


def _check_model(forward_model: ForwardModel, request: FitRequest) -> None:
    if not forward_model.is_batchable or forward_model.scale_index is None:
        raise ConfigError(
            request.varied_keys[0],
            "cannot be fitted to a map, which needs the modulus of an elastic body that has a "
            "single modulus and no adhesion",
            "fit curve by curve with --no-map",
        )


def thickness_model(scene: MapScene, thickness: np.ndarray, max_depth: float) -> MapModel:
    """Return the model of a map whose pixels have different thicknesses.

    Load curves are solved for thicknesses at equal ratios and interpolated by splines.

    Parameters
    ----------
    scene
        The scene, with a body that has a height.
    thickness
        Thickness of each curve (N,) [length]. Bodies thinner than `thinnest_body(max_depth)` have
        the load curve of this thickness.
    max_depth
        Largest depth of the map [length].

    Raises
    ------
    ConfigError
        If the body has no height, or a thickness is not positive.
    """
    config = scene.request.config
    number_at(config, HEIGHT_KEY)
    if not (np.isfinite(thickness).all() and (thickness > 0).all()):
        raise ConfigError("--thickness", "is not positive for every curve", "give other heights")
    log_h = np.log(np.maximum(thickness, thinnest_body(max_depth)))
    # Ratio of neighbouring thicknesses that are solved, and of those in the interpolated table. The
    # force of a thin layer changes by 0.1 to 0.3 % between two rows of the table.
    solved_ratio = 0.05
    tabulated_ratio = 0.001
    low = float(log_h.min())
    high = max(float(log_h.max()), low + 3 * solved_ratio)
    solved = np.linspace(low, high, 1 + math.ceil((high - low) / solved_ratio))
    exponent = scene.forward_model.elastic_curves.scene_curve.exponent
    curves = [_solve_thickness(config, math.exp(value), max_depth, exponent) for value in solved]
    spline = CubicSpline(solved, [curve.coefficients for curve in curves])
    row_count = 1 + math.ceil((high - low) / tabulated_ratio)
    rows = np.rint((log_h - low) / (high - low) * (row_count - 1)).astype(int)
    coefficients = spline(np.linspace(low, high, row_count))
    table = TabulatedLoadCurve(replace(curves[0], coefficients=coefficients), interval_count=300)
    return MapModel(scene.forward_model, scene.request.origin, table, rows)


def thinnest_body(max_depth: float) -> float:
    """Return the smallest thickness [length] that is solved for a depth [length]."""
    return MIN_HEIGHT_DEPTHS * max_depth


def _solve_thickness(
    config: Config, height: float, max_depth: float, exponent: float
) -> ElasticLoadCurve:
    try:
        return solve_load_curve(
            replace_numbers(config, {HEIGHT_KEY: height}), max_depth, exponent=exponent
        )
    except ForwardModelUnavailable as error:
        raise ConfigError("--thickness", f"{height:.4g} has no solution: {error}") from None
