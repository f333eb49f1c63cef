"""Model selection for one measured curve: effects at its depth, and alternative models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.config.quantities import pressure_keys
from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import (
    FitRequest,
    cantilever_stiffness_si,
    convert_to_scene_units,
    fit_curve,
)
from indent_sim.fitting.fit_folder import ReadOptions
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import replace_numbers
from indent_sim.fitting.inference.model_assessment import BETTER_MODEL_P, Interval
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.results.measured.curve_file import read_curves
from indent_sim.results.measured.measurement import MeasuredCurve
from indent_sim.run.model_selection.recommended_model import Requirements, require


@dataclass(frozen=True)
class CurveRequirements:
    """Model requirements of a scene at the depth and with the modulus of a measured curve.

    Attributes
    ----------
    key
        Key of the fitted modulus.
    entry
        Entry of the curve as in fit.json.
    models
        Alternative models, each with its modulus and whether it is needed or not excluded.
    """

    config: Config
    key: str
    entry: dict[str, Any]
    models: Sequence[dict[str, Any]]
    requirements: Requirements

    @property
    def modulus(self) -> Interval:
        """Modulus of the curve with its stated interval."""
        interval = self.entry["parameters"][self.key]
        return Interval(interval["value"], interval["low"], interval["high"])

    def as_json(self) -> dict[str, Any]:
        """Return the requirements as an object for JSON."""
        return self.requirements.as_json() | {"curve": self.entry, "models": self.models}


def require_for_curve(
    config: Config, path: Path, within: float, reading: ReadOptions | None = None
) -> CurveRequirements:
    """Return the model requirements at the depth and with the modulus of a measured curve.

    Parameters
    ----------
    config
        The scene; its first modulus is fitted.
    path
        File of the curve; its first curve is used.
    within
        Relative tolerance of the force.
    reading
        Options for reading the file.

    Raises
    ------
    NotConverged
        If the curve does not determine the modulus.
    ConfigError
        If the scene has no modulus or cannot be run. The errors of `read_curves` are raised as
        well.
    """
    reading = reading or ReadOptions()
    key = next(iter(pressure_keys(config)), None)
    if key is None:
        raise ConfigError(
            "material",
            "has no modulus that could be fitted to a curve",
            "give a material with one, such as E",
        )
    curve = read_curves(
        path,
        reading.columns or None,
        reading.units,
        cantilever_stiffness_si(config),
        reading.sensitivity,
    )[0]
    curve_fit = fit_curve(curve, FitRequest(config, (key,), models="all"), ForwardModelCache())
    if not curve_fit.is_done:
        raise NotConverged(f"{path}: {curve_fit.entry['reason']}")
    value = curve_fit.entry["parameters"][key]["value"]
    fitted_config = replace_numbers(
        config, {key: value, "loading": _approach_loading(config, curve, curve_fit.entry)}
    )
    models = [
        model | {"verdict": "needed" if model["p"] < BETTER_MODEL_P else "not excluded"}
        for model in curve_fit.entry["models"]
    ]
    return CurveRequirements(config, key, curve_fit.entry, models, require(fitted_config, within))


def _approach_loading(
    config: Config, curve: MeasuredCurve, entry: dict[str, Any]
) -> dict[str, Any]:
    """Return the section `loading` for the approach: a depth, or a linear history."""
    if not config.loading.prescribed_history:
        return {"delta": entry["depth"], "steps": config.loading.steps}
    has_spring = config.experiment is not None and config.experiment.compliance > 0
    column = curve.available_abscissa("z" if has_spring else "delta")
    approach = convert_to_scene_units(curve, config).part("approach")
    x = approach.abscissa_values(column)
    contact_point = entry["contact_point"]["value"]
    t = approach.t[x > contact_point] if approach.t is not None else [0.0, 1.0]
    return {"history": [[0.0, 0.0], [float(t[-1] - t[0]), float(x.max() - contact_point)]]}
