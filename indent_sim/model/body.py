"""Soft bodies: the cylinder, and the unions of all shapes.

The z axis points up; the undeformed top surface is z = 0 and the body lies below it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from indent_sim.model.body_base import UNIT_POINTS, BaseSupport, Points, RoundBody, Support
from indent_sim.model.imported_body import ImportedBody, MeshFromFile
from indent_sim.model.inclusions import Inclusion, Inclusions
from indent_sim.model.layers import Layers
from indent_sim.model.spherical_bodies import Ball, Cap, Ellipsoid, SphericalBody
from indent_sim.model.unbounded_bodies import UnboundedBody
from indent_sim.model.units import (
    Length,
    SurfaceTension,
)
from indent_sim.model.walled_bodies import Box, Strip


@dataclass(frozen=True)
class Cylinder(RoundBody):
    """Cylinder 0 <= r <= radius, -height <= z <= 0 [length]."""

    radius: Length
    height: Length
    shape: Literal["cylinder"] = "cylinder"
    base: BaseSupport = "fixed"
    sides: Support = "free"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Return the distance [length] from an inclusion to the wall; negative if it protrudes."""
        return self.radius - inclusion.farthest_distance((0.0, 0.0), (0, 1))

    @property
    def is_laterally_confined(self) -> bool:
        """True if no side is free."""
        return self.sides != "free"

    def fixed_edge_points(self) -> Points:
        """Return points along the top edge of all fixed sides."""
        angle = 2 * np.pi * (UNIT_POINTS if self.sides == "fixed" else UNIT_POINTS[:0])
        return self.radius * np.cos(angle), self.radius * np.sin(angle)


DimensionedBody = Cylinder | Strip | Box | SphericalBody  # meshed here
Body = DimensionedBody | ImportedBody | UnboundedBody
AnyBody = Cylinder | Strip | Box | UnboundedBody | Cap | Ball | Ellipsoid | MeshFromFile
