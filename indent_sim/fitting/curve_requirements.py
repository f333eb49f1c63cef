"""What a scene requires for one measured curve: its effects at the curve's depth, and other models
fitted beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.config.quantities import pressures
from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import Request, fit_curve, in_scene_units, newtons_per_metre
from indent_sim.fitting.fit_folder import Reading
from indent_sim.fitting.inference.verdict import NAMED, Interval
from indent_sim.fitting.scene_curve.parameters import with_numbers
from indent_sim.fitting.scene_curve.scene_forces import Tables
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.results.measured.curve_file import read_curves
from indent_sim.results.measured.measurement import MeasuredCurve
from indent_sim.run.model_selection.recommended_model import Requirements, require

NEEDED = "needed"
NOT_EXCLUDED = "not excluded"


@dataclass(frozen=True)
class CurveRequirements:
    """What the scene requires with the modulus and the depth of a curve.

    key: the modulus that was fitted; entry: the curve's, as in fit.json; models: those that were
    fitted beside the scene's, with the modulus that each would give and whether it is needed or not
    excluded.
    """

    config: Config
    key: str
    entry: dict[str, Any]
    models: Sequence[dict[str, Any]]
    requirements: Requirements

    @property
    def modulus(self) -> Interval:
        """The modulus that the curve gives, with its stated interval."""
        stated = self.entry["parameters"][self.key]
        return Interval(stated["value"], stated["low"], stated["high"])

    def as_json(self) -> dict[str, Any]:
        """The requirements as one JSON object."""
        return self.requirements.as_json() | {"curve": self.entry, "models": self.models}


def require_of_curve(
    config: Config, path: Path, within: float, reading: Reading | None = None
) -> CurveRequirements:
    """What a scene requires for a force within a relative tolerance, at the depth and with the
    modulus of the first curve of a file.

    The modulus is the scene's first. NotConverged with the reason for a curve that tells nothing of
    it; ConfigError for a scene without a modulus or that cannot be run; errors of the file as
    `read_curves` raises them.
    """
    reading = reading or Reading()
    key = next(iter(pressures(config)), None)
    if key is None:
        raise ConfigError(
            "material",
            "has no modulus that a curve could tell",
            "give a material with one, such as E",
        )
    curve = read_curves(path, reading.columns or None, reading.units, newtons_per_metre(config))[0]
    found = fit_curve(curve, Request(config, (key,), models="all"), Tables())
    if not found.is_done:
        raise NotConverged(f"{path}: {found.entry['reason']}")
    value = found.entry["parameters"][key]["value"]
    pressed = with_numbers(config, {key: value, "loading": _loading(config, curve, found.entry)})
    models = [
        one | {"verdict": NEEDED if one["p"] < NAMED else NOT_EXCLUDED}
        for one in found.entry["models"]
    ]
    return CurveRequirements(config, key, found.entry, models, require(pressed, within))


def _loading(config: Config, curve: MeasuredCurve, entry: dict[str, Any]) -> dict[str, Any]:
    """The path of the curve's approach: its depth, or in time the way from first touch on at an
    even pace.
    """
    if not config.loading.prescribed_history:
        return {"delta": entry["depth"], "steps": config.loading.steps}
    held = config.experiment is not None and config.experiment.compliance > 0
    along = curve.available_abscissa("z" if held else "delta")
    approach = in_scene_units(curve, config).part("approach")
    x = approach.abscissa_values(along)
    c = entry["contact_point"]["value"]
    t = approach.t[x > c] if approach.t is not None else [0.0, 1.0]
    return {"history": [[0.0, 0.0], [float(t[-1] - t[0]), float(x.max() - c)]]}
