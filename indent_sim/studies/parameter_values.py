"""Values of varied keys: settings of a scene, and multiples of the contact stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from indent_sim.config.scene_file import SourceLocation

STIFFNESS_UNIT = "E*/h_contact"


@dataclass(frozen=True)
class StiffnessMultiple:
    """Contact stiffness as a multiple of E*/h_contact of the scene."""

    factor: float


# Dotted key, value, and its file and line.
Setting = tuple[str, Any, SourceLocation]
ParameterPoint = tuple[Setting, ...]
