"""Parameters of a fit: keys of the scene that vary, what each of them does to the curve, and within
which bounds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from indent_sim.config.quantities import pressures
from indent_sim.config.scene_file import to_mapping, varied
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.process.errors import ConfigError

Role = Literal["scale", "shape", "work", "relaxation", "spring", "power"]
# of the depth beside the scene's own, no key of it; its range
FREE_EXPONENT = "exponent"
EXPONENTS = (-1.0, 1.0)
MEASURABLE = (
    "body",
    "material",
    "indenter",
    "contact",
    "experiment",
)  # sections of what a curve may tell
WORK = "experiment.adhesion.work"
SPRINGS = ("experiment.cantilever.stiffness", "experiment.frame.compliance")
LARGEST_NU = 0.5
LARGEST_FRACTION = 0.999
SHALLOWEST_BODY = 1.15  # depths: a thinner body is pressed through
# of the lattice on which scenes are solved
LOG_STEP = 0.2
LINEAR_STEP = 0.02


@dataclass(frozen=True)
class Parameter:
    """One key that varies: theta = ln value of a positive number, the value itself of a Poisson
    ratio.

    role: scale multiplies the force; shape asks for another solution; the others are the
    experiment's. step: of the lattice of solutions, in theta.
    """

    key: str
    start: float
    role: Role
    low: float
    high: float
    is_linear: bool = False
    step: float = LOG_STEP

    def theta(self, value: float) -> float:
        """The coordinate of a value in which the fit works."""
        return value if self.is_linear else math.log(value)

    def value(self, theta: float) -> float:
        """The value of a coordinate."""
        return theta if self.is_linear else math.exp(min(max(theta, -700.0), 700.0))

    @property
    def bounds(self) -> tuple[float, float]:
        """The coordinates between which the value may lie."""
        ends = (self.low, self.high)
        return ends if self.is_linear else tuple(map(_log, ends))  # type: ignore[return-value]


def _log(value: float) -> float:
    return math.log(value) if 0 < value < math.inf else math.copysign(math.inf, value - 0.5)


def parameters_of(config: Config, keys: Sequence[str], deepest: float) -> tuple[Parameter, ...]:
    """The parameters of some keys; ConfigError for one that is no number of the scene, or that is
    named twice.

    deepest: the largest depth [length] of the fit, of which a body must have more.
    """
    for key in keys:
        if list(keys).count(key) > 1:
            raise ConfigError("--vary", f"names {key} twice", "name it once")
    return tuple(_parameter(config, key, deepest) for key in keys)


def _parameter(config: Config, key: str, deepest: float) -> Parameter:
    start = number_at(config, key)
    last = key.rpartition(".")[2]
    if last.startswith("nu"):
        return Parameter(key, start, "shape", 0.0, LARGEST_NU, is_linear=True, step=LINEAR_STEP)
    if not start > 0:
        raise ConfigError(
            key, f"is {start:g}: a fit begins from a number above 0", f"--set {key}=..."
        )
    if key == WORK:
        return Parameter(key, start, "work", 0.0, math.inf)
    if "relaxation" in key_path(key):
        is_fraction = key.endswith("[0]") or last == "exponent"
        in_shear = any(
            law.relaxation and law.relaxation.of != "all" for _, law in config.materials()
        )
        role: Role = "shape" if in_shear else "relaxation"
        return Parameter(key, start, role, 0.0, LARGEST_FRACTION if is_fraction else math.inf)
    if key in SPRINGS:
        return Parameter(key, start, "spring", 0.0, math.inf)
    if pressures(config) == [key]:
        return Parameter(key, start, "scale", 0.0, math.inf)
    low = (
        SHALLOWEST_BODY * deepest
        if last in ("height", "thickness") and "layers" not in key
        else 0.0
    )
    return Parameter(key, start, "shape", low, math.inf)


def number_at(config: Config, key: str) -> float:
    """The number at a key of the scene; ConfigError where there is none, or none that a curve tells
    of.
    """
    if str(next(iter(key_path(key)), "")) not in MEASURABLE:
        raise ConfigError(
            key,
            "is nothing that a curve tells of",
            f"--vary names a key of {', '.join(MEASURABLE)}",
        )
    section: Any = to_mapping(config)
    for part in key_path(key):
        try:
            section = section[part]
        except (KeyError, IndexError, TypeError):
            raise ConfigError(
                key, "is no number of the scene", f"--vary names one; --set {key}=... adds it"
            ) from None
    if isinstance(section, bool) or not isinstance(section, int | float):
        raise ConfigError(key, f"is {section!r}, no number", "--vary names a number of the scene")
    return float(section)


def with_numbers(config: Config, values: Mapping[str, Any]) -> Config:
    """The scene with other values at some keys; ConfigError where there is no such scene."""
    settings = [(key, value, ("--vary", None)) for key, value in values.items()]
    return varied(to_mapping(config), config.source, settings)
