"""Supports of a body, and base classes with what several shapes of bodies share."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

Support = Literal["free", "roller", "fixed"]
BaseSupport = Literal["fixed", "roller"]
Points = tuple[np.ndarray, np.ndarray]  # x and y [length]
POINTS_PER_AXIS = (
    400  # along each axis; midpoints, so that the mean of a paraboloid is good to 1e-5
)
UNIT_MIDPOINTS = (np.arange(POINTS_PER_AXIS) + 0.5) / POINTS_PER_AXIS
UNIT_POINTS = np.linspace(0, 1, POINTS_PER_AXIS + 1)


class CenteredBody:
    """What holds of a body about the z axis that says nothing else: no side holds it."""

    dim: ClassVar[int] = 3  # 2 in plane strain, where forces are per unit length
    center: ClassVar[tuple[float, ...]] = (0.0, 0.0)  # where the tip stands

    @property
    def is_laterally_confined(self) -> bool:
        """Whether no side lets the body out."""
        return False

    def fixed_edge_points(self) -> Points:
        """Points along the top of all fixed sides."""
        return np.empty(0), np.empty(0)


class RoundBody(CenteredBody):
    """What bodies of revolution have in common: their outline, as seen from above, is a circle
    about the origin.
    """

    radius: float

    @property
    def max_section_radius(self) -> float:
        """The largest radius of a horizontal section [length]."""
        return self.radius

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the outline."""
        return self.max_section_radius - float(sum(c * c for c in center) ** 0.5)

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farthest point of the outline."""
        return self.max_section_radius + float(sum(c * c for c in center) ** 0.5)

    def top_points(self) -> Points:
        """Points as seen from above, each standing for an equal area there."""
        r = self.max_section_radius * np.sqrt(UNIT_MIDPOINTS)[:, None]
        angle = 2 * np.pi * UNIT_MIDPOINTS[None, :]
        return r * np.cos(angle), r * np.sin(angle)
