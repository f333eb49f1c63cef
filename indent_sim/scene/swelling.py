"""Swelling of gels in the bath of a scene, and the drainage of its pore fluid."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite
from typing import TYPE_CHECKING

from indent_sim.model.drainage import Drainage
from indent_sim.model.gel import Gel
from indent_sim.model.history import History
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.scene.regions import Layers, layer_material

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


def nondimensional_drainage(config: Config, history: History | None, scales: Scales) -> Drainage:
    """Return the nondimensional drainage, with times since the beginning of the history.

    Raises
    ------
    ConfigError
        If the bath of a gel, a dimensionless chemical potential, is given with a unit.
    """
    drainage = (config.drainage or Drainage()).with_time_origin(
        history.points[0][0] if history else 0.0
    )
    scaled = scales.nondimensionalize(drainage)
    if not any(isinstance(material, Gel) for _, material in config.materials()):
        return scaled
    if any(key[:2] == ("drainage", "bath") for key in config.source.quantities):
        problem = "has a unit, but for a gel it is the chemical potential of the solvent over kT"
        raise ConfigError("drainage.bath", problem, "give a plain number; 0 is the pure solvent")
    return replace(scaled, bath=drainage.bath)


def max_surface_rise(drainage: Drainage, layers: Layers) -> float:
    """Return the largest rise of the surface [length] by laterally confined swelling in any bath.

    Raises
    ------
    ConfigError
        If a bath has no swelling equilibrium, or the gel is infinitely thick.
    """

    def rise(bath: float) -> float:
        total_rise = 0.0
        for layer in layers:
            law = layer_material(layer)
            if (
                isinstance(law, Gel)
                and law.flow
                and (stretch := _confined_swelling_stretch(law, bath)) != 1
            ):
                total_rise += (stretch - 1) * layer.thickness if layer.thickness else inf
        return total_rise

    max_rise = max(0.0, *(rise(bath) for bath in drainage.bath_values))
    if not isfinite(max_rise):
        problem = "makes an infinitely thick gel swell, whose surface rises without bound"
        raise ConfigError(
            "drainage.bath",
            problem,
            "use a layer or a cylinder, or stretch: auto and a constant bath",
        )
    return max_rise


def _confined_swelling_stretch(law: Gel, bath: float) -> float:
    """Return the vertical stretch of a laterally confined gel.

    Raises
    ------
    ConfigError
        If there is no equilibrium.
    """
    try:
        return law.confined_swelling(law.bath_pressure(bath)).stretch
    except ValueError as error:
        raise ConfigError(
            "drainage.bath",
            str(error),
            "give a bath closer to the chemical potential of free swelling",
        ) from None
