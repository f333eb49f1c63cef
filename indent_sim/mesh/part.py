"""The modelled piece of a body."""

from __future__ import annotations

from dataclasses import dataclass

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Body
from indent_sim.model.kinematics import Kinematics


@dataclass(frozen=True)
class Part:
    """What the process that meshes has to know of a scene."""

    kinematics: Kinematics
    body: Body
    extent: tuple[tuple[float, float], ...]
    center: tuple[float, ...]
    sizes: Sizes
