"""Fits of a curve and of a map from Python, with their parameters and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping, load
from indent_sim.config.schema import Config
from indent_sim.fitting import map_estimate, map_thickness
from indent_sim.fitting.curve_fit import (
    INTERVAL_KEYS,
    CurveFit,
    FitRequest,
    cantilever_stiffness_si,
    fit_curve,
)
from indent_sim.fitting.fit_folder import ReadOptions
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.inference.estimate import OriginOptions
from indent_sim.fitting.inference.model_assessment import Interval
from indent_sim.fitting.map_result import MapFit
from indent_sim.process.errors import NotConverged, UsageError
from indent_sim.results.measured.curve_file import read_curves
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import MeasuredCurve, curve_parts

if TYPE_CHECKING:
    from indent_sim.results.pictures.figures import Figure

Curve = str | Path | MeasuredCurve | tuple[Any, Any]


@dataclass(frozen=True)
class Fit:
    """Scene fitted to a curve.

    Attributes
    ----------
    parameters
        Value, lower end and upper end of the interval of each key.
    explained
        True if the scene explains the curve.
    words
        Sentences on the result.
    entry
        Entry of the curve as in fit.json.
    """

    parameters: dict[str, Interval]
    explained: bool
    words: str
    entry: dict[str, Any] = field(repr=False)
    _curve_fit: CurveFit = field(repr=False)
    _config: Config = field(repr=False)

    def figure(self) -> Figure:
        """Return the figure of the force, the fit, the residuals and the depth ranges."""
        from indent_sim.fitting import fit_picture

        with fit_picture.fit_figure(self._curve_fit, self._config) as figure:
            return figure


def fit(curve: Curve, request: FitRequest, reading: ReadOptions) -> Fit:
    """Fit parameters of a scene to one measured curve with unknown contact point and baseline.

    Parameters
    ----------
    curve
        File, whose first curve is used, a `MeasuredCurve`, or arrays (depth, force) in the units of
        the scene.
    request, reading
        Settings of the fit, and of the reader of the file.

    Raises
    ------
    NotConverged
        If the curve does not determine the parameters.
    """
    measured_curve = _read_curve(curve, reading, request.config)
    curve_fit = fit_curve(measured_curve, request, ForwardModelCache(request.surrogate))
    if not curve_fit.is_done:
        raise NotConverged(f"{curve_fit.name}: {curve_fit.entry['reason']}")
    intervals = curve_fit.entry["parameters"]
    numbers = {key: Interval(*(intervals[key][end] for end in INTERVAL_KEYS)) for key in intervals}
    return Fit(
        numbers,
        curve_fit.entry["explained"],
        curve_fit.entry["words"],
        curve_fit.entry,
        curve_fit,
        request.config,
    )


class FittedMap(MapFit):
    """Scene fitted to a map, with its figure."""

    def figure(self, *panels: str) -> Figure:
        """Return the figure with its four panels, or with the named ones; see `map_figure`."""
        from indent_sim.fitting import map_picture

        config = config_from_mapping(self.entry["request"]["scene"])
        with map_picture.map_figure(self, config, panels) as figure:
            return figure


def fit_map(
    curves: str | Path | MeasuredMap | tuple[Any, Any],
    scene: Config | Mapping[str, Any] | str | Path,
    vary: str = "material.E",
    *,
    thickness: str | np.ndarray | None = None,
    contact_point: float | None = None,
) -> FittedMap:
    """Fit the modulus of a scene to every curve of a map.

    Parameters
    ----------
    curves
        File of a map, a `MeasuredMap`, or arrays (depth, force) in the units of the scene: depth of
        shape (n,) or (rows, columns, n), force of shape (rows, columns, n).
    scene
        The scene, or its document or file.
    vary
        Key of the modulus.
    thickness
        Thickness of each pixel (rows, columns) [length], or a text as for the option `--thickness`;
        by default the thickness in the section `map` of the scene.
    contact_point
        Displacement at first contact, if it is known.

    Raises
    ------
    UsageError
        If there is no map, or too few curves have a baseline.
    ConfigError
        If a key or the scene is invalid.
    """
    request = FitRequest(_load_scene(scene), (vary,), "approach", OriginOptions(contact_point))
    measured_map = _read_map(curves)
    pixels = map_thickness.thickness_of_scene(request.config)
    if isinstance(thickness, str):
        pixels = map_thickness.parse_thickness(thickness, request, measured_map.shape)
    elif thickness is not None:
        pixels = map_thickness.Thickness(values=np.asarray(thickness, dtype=float))
    return FittedMap(**vars(map_estimate.fit_map(measured_map, request, pixels)[0]))


def _read_map(curves: str | Path | MeasuredMap | tuple[Any, Any]) -> MeasuredMap:
    if isinstance(curves, MeasuredMap):
        return curves
    if isinstance(curves, tuple):
        depth, force = (np.asarray(values, dtype=float) for values in curves)
        if force.ndim != 3 or depth.shape not in (force.shape, force.shape[-1:]):
            raise UsageError("a map needs depths (n,) or (rows, columns, n), and as many forces")
        forces = force.reshape(-1, force.shape[-1])
        depths = depth.reshape(-1, force.shape[-1])
        rows, columns = force.shape[:2]

        def read_curve(index: int) -> MeasuredCurve:
            x = depths[index if len(depths) > 1 else 0]
            return MeasuredCurve("curve", forces[index], x, parts=curve_parts(x))

        places = np.column_stack(np.divmod(np.arange(rows * columns), columns))
        return MeasuredMap((rows, columns), None, places, read_curve, units={})
    measured_map = read_curves(curves)
    if not isinstance(measured_map, MeasuredMap):
        raise UsageError(f"{curves} contains no grid of curves")
    return measured_map


def _load_scene(scene: Config | Mapping[str, Any] | str | Path) -> Config:
    if isinstance(scene, Config):
        return scene
    return config_from_mapping(scene) if isinstance(scene, Mapping) else load(scene)


def _read_curve(curve: Curve, reading: ReadOptions, config: Config) -> MeasuredCurve:
    if isinstance(curve, MeasuredCurve):
        return curve
    if isinstance(curve, tuple):
        delta, force = (np.asarray(values, dtype=float) for values in curve)
        if delta.ndim != 1 or delta.shape != force.shape:
            raise UsageError("a curve needs two arrays of numbers of the same length")
        return MeasuredCurve("curve", force, delta, parts=curve_parts(delta))
    stiffness = cantilever_stiffness_si(config)
    columns = reading.columns or None
    return read_curves(curve, columns, reading.units, stiffness, reading.sensitivity)[0]
