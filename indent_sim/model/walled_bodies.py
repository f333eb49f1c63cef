"""Bodies between vertical walls: the strip (plane strain) and the box."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from indent_sim.model.body_base import (
    POINTS_PER_AXIS,
    UNIT_MIDPOINTS,
    UNIT_POINTS,
    BaseSupport,
    Points,
    Support,
)
from indent_sim.model.inclusions import POSITION_TOLERANCE, Inclusion, Inclusions, PositiveSize
from indent_sim.model.layers import Layers
from indent_sim.model.units import (
    Length,
    SurfaceTension,
)


@dataclass(frozen=True)
class StripSides:
    """Supports of the two walls of a strip; roller: no normal displacement."""

    x_min: Support = "free"
    x_max: Support = "free"


@dataclass(frozen=True)
class BoxSides(StripSides):
    """Supports of the four walls of a box; roller: no normal displacement."""

    y_min: Support = "free"
    y_max: Support = "free"


class _WalledBody(ABC):
    """Base class of bodies between vertical walls, from 0 to a width along each horizontal axis."""

    sides: StripSides

    @property
    @abstractmethod
    def widths(self) -> tuple[float, ...]:
        """Distances [length] between opposite walls."""

    @property
    def center(self) -> tuple[float, ...]:
        """Center of the top surface."""
        return tuple(width / 2 for width in self.widths)

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return the distance [length] from `center` to the nearest edge of the top surface.

        A roller wall through the tip's axis is a mirror plane and not counted as an edge.
        """
        distances: dict[str, float] = {}
        for axis, position, width in zip("xy", center, self.widths, strict=False):
            distances |= {f"{axis}_min": position, f"{axis}_max": width - position}
        return min(
            distance for wall, distance in distances.items() if not self._is_mirror(distance, wall)
        )

    def _is_mirror(self, distance: float, wall: str) -> bool:
        """Return whether a wall is a roller in a plane through the tip's axis."""
        return (
            abs(distance) <= POSITION_TOLERANCE * max(self.widths)
            and getattr(self.sides, wall) == "roller"
        )

    def mirrored_widths(self, center: tuple[float, ...]) -> tuple[float, ...]:
        """Return the widths [length], doubled where a mirror plane passes through `center`."""
        widths: list[float] = []
        for axis, position, width in zip("xy", center, self.widths, strict=False):
            distances = {f"{axis}_min": position, f"{axis}_max": width - position}
            is_mirrored = any(
                self._is_mirror(distance, wall) for wall, distance in distances.items()
            )
            widths.append(2 * width if is_mirrored else width)
        return tuple(widths)

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return the distance [length] from `center` to the farthest corner of the top surface."""
        positions = zip(center, self.widths, strict=True)
        return float(
            sum(max(position, width - position) ** 2 for position, width in positions) ** 0.5
        )

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Return the distance [length] from an inclusion to the nearest wall.

        The distance is negative if the inclusion protrudes.
        """
        positions = enumerate(zip(inclusion.center, self.widths, strict=False))
        return min(
            min(position, width - position) - inclusion.half_width(axis)
            for axis, (position, width) in positions
        )

    @property
    def is_laterally_confined(self) -> bool:
        """True if no side is free."""
        return "free" not in vars(self.sides).values()


@dataclass(frozen=True)
class Strip(_WalledBody):
    """Strip 0 <= x <= width, -height <= z <= 0 [length] in plane strain; forces per unit length."""

    width: Length
    height: Length
    shape: Literal["strip"] = "strip"
    base: BaseSupport = "fixed"
    sides: StripSides = StripSides()
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    # Plane strain: forces are per unit length.
    dim: ClassVar[int] = 2

    @property
    def widths(self) -> tuple[float, ...]:
        """The width of the strip as a tuple [length]."""
        return (self.width,)

    def top_points(self) -> Points:
        """Return points on the top edge, each representing an equal length."""
        return self.width * UNIT_MIDPOINTS, np.zeros(POINTS_PER_AXIS)

    def fixed_edge_points(self) -> Points:
        """Return the top ends of all fixed sides."""
        wall_positions = {"x_min": 0.0, "x_max": self.width}
        x = np.array(
            [
                position
                for side, position in wall_positions.items()
                if getattr(self.sides, side) == "fixed"
            ]
        )
        return x, 0 * x


@dataclass(frozen=True)
class Box(_WalledBody):
    """Box 0 <= x <= lx, 0 <= y <= ly, -lz <= z <= 0 [length]."""

    size: PositiveSize
    shape: Literal["box"] = "box"
    base: BaseSupport = "fixed"
    sides: BoxSides = BoxSides()
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    dim: ClassVar[int] = 3

    @property
    def height(self) -> float:
        """Thickness lz of the body [length]."""
        return self.size[2]

    @property
    def widths(self) -> tuple[float, ...]:
        """The widths (lx, ly) of the box [length]."""
        return self.size[:2]

    def top_points(self) -> Points:
        """Return points on the top surface, each representing an equal area."""
        return self.size[0] * UNIT_MIDPOINTS[:, None], self.size[1] * UNIT_MIDPOINTS[None, :]

    def fixed_edge_points(self) -> Points:
        """Return points along the top edge of all fixed sides."""
        lx, ly = self.widths
        x = lx * UNIT_POINTS
        y = ly * UNIT_POINTS
        zero = 0 * UNIT_POINTS
        lines = {
            "x_min": (zero, y),
            "x_max": (zero + lx, y),
            "y_min": (x, zero),
            "y_max": (x, zero + ly),
        }
        fixed = [lines[side] for side, support in vars(self.sides).items() if support == "fixed"]
        coordinates = np.hstack([np.empty((2, 0)), *map(np.array, fixed)])
        return coordinates[0], coordinates[1]
