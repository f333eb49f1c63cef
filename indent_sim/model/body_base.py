"""Supports of a body, and base classes of several body shapes."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

Support = Literal["free", "roller", "fixed"]
BaseSupport = Literal["fixed", "roller"]
RestingSupport = Literal["fixed", "roller", "unbonded"]
Points = tuple[np.ndarray, np.ndarray]  # x and y [length]
# Number of equal intervals along each axis, whose midpoints give the mean of a paraboloid to 1e-5.
POINTS_PER_AXIS = 400
UNIT_MIDPOINTS = (np.arange(POINTS_PER_AXIS) + 0.5) / POINTS_PER_AXIS
UNIT_POINTS = np.linspace(0, 1, POINTS_PER_AXIS + 1)


class CenteredBody:
    """Base class of bodies about the z axis without supported sides."""

    dim: ClassVar[int] = 3
    # Default position of the tip's axis [length].
    center: ClassVar[tuple[float, ...]] = (0.0, 0.0)

    @property
    def is_laterally_confined(self) -> bool:
        """True if no side is free."""
        return False

    def fixed_edge_points(self) -> Points:
        """Return points along the top edge of all fixed sides."""
        return np.empty(0), np.empty(0)


class RoundBody(CenteredBody):
    """Base class of bodies of revolution, whose outline from above is a circle about the origin."""

    radius: float

    @property
    def max_section_radius(self) -> float:
        """Largest radius of a horizontal section [length]."""
        return self.radius

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return the distance [length] from `center` to the outline."""
        return self.max_section_radius - float(sum(c * c for c in center) ** 0.5)

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return the distance [length] from `center` to the farthest point of the outline."""
        return self.max_section_radius + float(sum(c * c for c in center) ** 0.5)

    def top_points(self) -> Points:
        """Return horizontal positions of points, each representing an equal projected area."""
        r = self.max_section_radius * np.sqrt(UNIT_MIDPOINTS)[:, None]
        angle = 2 * np.pi * UNIT_MIDPOINTS[None, :]
        return r * np.cos(angle), r * np.sin(angle)
