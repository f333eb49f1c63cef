"""Fit of one curve from Python, with its parameters and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping, load
from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import INTERVAL_KEYS, CurveFit, FitRequest, ModelChoice, fit_curve
from indent_sim.fitting.forward_model.forward_model import ForwardModelCache
from indent_sim.fitting.inference.estimate import OriginOptions
from indent_sim.fitting.inference.model_assessment import Interval
from indent_sim.process.errors import NotConverged, UsageError
from indent_sim.results.measured.curve_file import read_curves
from indent_sim.results.measured.measurement import CurvePart, MeasuredCurve, curve_parts

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


def fit(
    curve: Curve,
    scene: Config | Mapping[str, Any] | str | Path,
    vary: Sequence[str] = ("material.E",),
    *,
    segment: CurvePart = "approach",
    columns: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
    contact_point: float | None = None,
    models: ModelChoice = "needed",
) -> Fit:
    """Fit parameters of a scene to one measured curve with unknown contact point and baseline.

    Parameters
    ----------
    curve
        File, whose first curve is used, a `MeasuredCurve`, or arrays (depth, force) in the units of
        the scene.
    scene
        The scene, or its document or file.
    vary
        Keys of the parameters.
    segment
        Part of the curve that is fitted.
    columns, units
        Columns of the file by title or number, and units if the file has none.
    contact_point
        Displacement at first contact, if it is known.
    models
        Fit alternative models only when needed, or all of them.

    Raises
    ------
    NotConverged
        If the curve does not determine the parameters.
    ConfigError
        If a key or the scene is invalid.
    """
    if isinstance(scene, Config):
        config = scene
    elif isinstance(scene, Mapping):
        config = config_from_mapping(scene)
    else:
        config = load(scene)
    request = FitRequest(config, tuple(vary), segment, OriginOptions(contact_point), models)
    curve_fit = fit_curve(_read_curve(curve, columns, units), request, ForwardModelCache())
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
        config,
    )


def _read_curve(
    curve: Curve, columns: Sequence[str], units: Mapping[str, str] | None
) -> MeasuredCurve:
    if isinstance(curve, MeasuredCurve):
        return curve
    if isinstance(curve, tuple):
        delta, force = (np.asarray(values, dtype=float) for values in curve)
        if delta.ndim != 1 or delta.shape != force.shape:
            raise UsageError("a curve needs two arrays of numbers of the same length")
        return MeasuredCurve("curve", force, delta, parts=curve_parts(delta))
    return read_curves(curve, columns or None, units)[0]
