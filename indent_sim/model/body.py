"""The soft bodies and how they are held. z is up, the undeformed top surface is z = 0, the body lies below."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Gt, Len

from indent_sim.model.units import LENGTH, Length

Support = Literal["free", "roller", "fixed"]
BaseSupport = Literal["fixed", "roller"]
PositiveSize = Annotated[tuple[Annotated[float, Gt(0)], ...], Len(3, 3), LENGTH]


@dataclass(frozen=True)
class StripSides:
    """The two walls of a strip; roller: no normal displacement."""

    x_min: Support = "free"
    x_max: Support = "free"


@dataclass(frozen=True)
class BoxSides:
    """The four walls of a box; roller: no normal displacement."""

    x_min: Support = "free"
    x_max: Support = "free"
    y_min: Support = "free"
    y_max: Support = "free"


@dataclass(frozen=True)
class Cylinder:
    """0 <= r <= radius, -height <= z <= 0 [length]."""

    radius: Length
    height: Length
    shape: Literal["cylinder"] = "cylinder"
    base: BaseSupport = "fixed"
    sides: Support = "free"

    @property
    def center(self) -> tuple[float, ...]:
        """The axis."""
        return (0.0, 0.0)

    def rim_distance(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the nearest edge of the top surface."""
        return self.radius - float(sum(c * c for c in center) ** 0.5)

    def reach(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farthest point of the top surface."""
        return self.radius + float(sum(c * c for c in center) ** 0.5)


@dataclass(frozen=True)
class Strip:
    """0 <= x <= width, -height <= z <= 0 [length], plane strain: forces per unit length."""

    width: Length
    height: Length
    shape: Literal["strip"] = "strip"
    base: BaseSupport = "fixed"
    sides: StripSides = StripSides()

    @property
    def center(self) -> tuple[float, ...]:
        """The middle of the top edge."""
        return (self.width / 2,)

    def rim_distance(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the nearest end of the top edge."""
        return min(center[0], self.width - center[0])

    def reach(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farther end of the top edge."""
        return max(center[0], self.width - center[0])


@dataclass(frozen=True)
class Box:
    """0 <= x <= lx, 0 <= y <= ly, -lz <= z <= 0 [length]."""

    size: PositiveSize
    shape: Literal["box"] = "box"
    base: BaseSupport = "fixed"
    sides: BoxSides = BoxSides()

    @property
    def height(self) -> float:
        """Thickness lz [length]."""
        return self.size[2]

    @property
    def center(self) -> tuple[float, ...]:
        """The middle of the top surface."""
        return (self.size[0] / 2, self.size[1] / 2)

    def rim_distance(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the nearest edge of the top surface."""
        x, y = center
        return min(x, self.size[0] - x, y, self.size[1] - y)

    def reach(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farthest corner of the top surface."""
        x, y = center
        return float((max(x, self.size[0] - x) ** 2 + max(y, self.size[1] - y) ** 2) ** 0.5)


@dataclass(frozen=True)
class HalfSpace:
    """z <= 0 without end. A simulation replaces it by a finite body that is large enough."""

    shape: Literal["half_space"] = "half_space"

    @property
    def center(self) -> tuple[float, ...]:
        """Where the tip stands; every place is equal."""
        return (0.0, 0.0)


Body = Cylinder | Strip | Box
AnyBody = Body | HalfSpace
