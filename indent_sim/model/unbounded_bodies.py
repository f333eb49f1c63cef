"""Bodies without sides: the half-space and the infinitely wide layer."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import ClassVar, Literal

import numpy as np

from indent_sim.model.body_base import BaseSupport, CenteredBody, Points
from indent_sim.model.inclusions import Inclusion, Inclusions
from indent_sim.model.layers import Layers
from indent_sim.model.units import (
    Length,
    SurfaceTension,
)


class _UnboundedBody(CenteredBody):
    """Base class of bodies without sides, whose top surface is unbounded."""

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return infinity, because the top surface has no edge."""
        return inf

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return infinity, because the top surface has no farthest point."""
        return inf

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Return infinity, because there is no wall."""
        return inf

    def top_points(self) -> Points:
        """Return no points, because no average over an unbounded surface exists."""
        return np.empty(0), np.empty(0)


@dataclass(frozen=True)
class HalfSpace(_UnboundedBody):
    """Half-space z <= 0, solved by theory or on a sufficiently large finite body."""

    shape: Literal["half_space"] = "half_space"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    height: ClassVar[float] = inf


@dataclass(frozen=True)
class InfiniteLayer(_UnboundedBody):
    """Infinitely wide layer -height <= z <= 0 [length].

    The layer is solved by theory or on a sufficiently large finite body.
    """

    height: Length
    shape: Literal["layer"] = "layer"
    base: BaseSupport = "fixed"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0


UnboundedBody = HalfSpace | InfiniteLayer
