"""Parameters of a fit: varied keys of the scene, their effect on the force, and their bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from indent_sim.config.quantities import pressure_keys
from indent_sim.config.scene_file import config_with_settings, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.process.errors import ConfigError

Role = Literal["scale", "shape", "work", "relaxation", "spring", "power"]
ADHESION_WORK_KEY = "experiment.adhesion.work"
# Work of adhesion during the retraction, if approach and retraction are fitted together.
RETRACT_WORK_KEY = "experiment.adhesion.work_retract"
SPRING_KEYS = ("experiment.cantilever.stiffness", "experiment.frame.compliance")
# lower bound of a height, in multiples of the largest depth, so that the tip does not reach the
# base
MIN_HEIGHT_DEPTHS = 1.15


@dataclass(frozen=True)
class Parameter:
    """Varied key of a scene with its transformed value theta (called coordinate).

    Attributes
    ----------
    role
        "scale": the parameter multiplies the force; "shape": it requires new solutions of the
        scene; other parameters belong to the experiment.
    is_linear
        True for a Poisson's ratio, where theta is the value; otherwise theta is its logarithm.
    grid_step
        Distance in theta between neighbouring scenes that are solved.
    """

    key: str
    initial_value: float
    role: Role
    low: float
    high: float
    is_linear: bool = False
    grid_step: float = 0.2

    def theta(self, value: float) -> float:
        """Return the transformed parameter theta of a value."""
        return value if self.is_linear else math.log(value)

    def value(self, theta: float) -> float:
        """Return the value at a transformed parameter theta; 0 at minus infinity."""
        if self.is_linear:
            return theta
        return 0.0 if theta == -math.inf else math.exp(min(max(theta, -700.0), 700.0))

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of theta."""
        if self.is_linear:
            return self.low, self.high
        return _log_or_infinity(self.low), _log_or_infinity(self.high)


def _log_or_infinity(value: float) -> float:
    return math.log(value) if 0 < value < math.inf else math.copysign(math.inf, value - 0.5)


def parameters_of(config: Config, keys: Sequence[str], max_depth: float) -> tuple[Parameter, ...]:
    """Return the parameters of some keys.

    Parameters
    ----------
    max_depth
        Largest depth of the fit [length]; bodies must be thicker.

    Raises
    ------
    ConfigError
        If a key is not a number of the scene, or is given twice.
    """
    for key in keys:
        if list(keys).count(key) > 1:
            raise ConfigError("--vary", f"names {key} twice", "name it once")
    return tuple(_make_parameter(config, key, max_depth) for key in keys)


def _make_parameter(config: Config, key: str, max_depth: float) -> Parameter:
    initial_value = number_at(config, key)
    last_part = key.rpartition(".")[2]
    if last_part.startswith("nu"):
        # Grid step of a Poisson's ratio.
        linear_step = 0.02
        return Parameter(
            key, initial_value, "shape", 0.0, 0.5, is_linear=True, grid_step=linear_step
        )
    if key.endswith("plasticity.hardening.n"):
        # Largest hardening exponent of a fit, and step of the nodes; a metal has at most 0.5.
        return Parameter(key, initial_value, "shape", 0.0, 0.6, is_linear=True, grid_step=0.1)
    if not initial_value > 0:
        raise ConfigError(
            key, f"is {initial_value:g}: a fit begins from a number above 0", f"--set {key}=..."
        )
    if key in (ADHESION_WORK_KEY, RETRACT_WORK_KEY):
        return Parameter(key, initial_value, "work", 0.0, math.inf)
    if "relaxation" in key_path(key):
        is_fraction = key.endswith("[0]") or last_part == "exponent"
        in_shear = any(
            law.relaxation and law.relaxation.of != "all" for _, law in config.materials()
        )
        role: Role = "shape" if in_shear else "relaxation"
        return Parameter(key, initial_value, role, 0.0, 0.999 if is_fraction else math.inf)
    if key in SPRING_KEYS:
        return Parameter(key, initial_value, "spring", 0.0, math.inf)
    if pressure_keys(config) == [key]:
        return Parameter(key, initial_value, "scale", 0.0, math.inf)
    low = (
        MIN_HEIGHT_DEPTHS * max_depth
        if last_part in ("height", "thickness") and "layers" not in key
        else 0.0
    )
    return Parameter(key, initial_value, "shape", low, math.inf)


def number_at(config: Config, key: str) -> float:
    """Return the number at a key; raise ConfigError if a curve cannot determine it.

    The initial value of the work of adhesion of the retraction is the scene's work of adhesion.
    """
    if key == RETRACT_WORK_KEY:
        return number_at(config, ADHESION_WORK_KEY)
    measurable_sections = ("body", "material", "indenter", "contact", "experiment")
    if str(next(iter(key_path(key)), "")) not in measurable_sections:
        raise ConfigError(
            key,
            "cannot be determined from a measured curve",
            f"--vary names a key of {', '.join(measurable_sections)}",
        )
    section: Any = to_mapping(config)
    for part in key_path(key):
        try:
            section = section[part]
        except (KeyError, IndexError, TypeError):
            raise ConfigError(
                key,
                "is not a number of the scene",
                "--vary needs a key of the scene whose value is a number; add it by --set "
                f"{key}=...",
            ) from None
    if isinstance(section, bool) or not isinstance(section, int | float):
        raise ConfigError(
            key,
            f"is {section!r}, not a number",
            "--vary needs a key of the scene whose value is a number",
        )
    return float(section)


def replace_numbers(config: Config, values: Mapping[str, Any]) -> Config:
    """Return the scene with other values at some keys; raise ConfigError if it is invalid."""
    settings = [(key, value, ("--vary", None)) for key, value in values.items()]
    return config_with_settings(to_mapping(config), config.source, settings)
