"""Layers of a body, and coatings (layers below a curved surface)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Len

from indent_sim.model.materials import Material
from indent_sim.model.units import (
    LENGTH,
    Length,
    TaggedBy,
)

Position = Annotated[tuple[float, ...], Len(3, 3), LENGTH]  # (x, y, z)


@dataclass(frozen=True)
class Layer:
    """Layer of a body, bonded to the adjacent layers.

    Without `material` the layer has the material of the body. The last layer of a half-space and
    the core of a cap or ball have no thickness; the other layers of a cap or ball are coatings of
    the core.
    """

    thickness: Length | None = None
    material: Annotated[Material | None, TaggedBy("model")] = None


Layers = Annotated[tuple[Layer, ...], Len(1, 50)]


@dataclass(frozen=True)
class Coating:
    """Region between two spheres about `center` [length]: a coating of a cap or a ball."""

    center: Position
    inner_radius: float
    outer_radius: float

    @property
    def thickness(self) -> float:
        """Thickness of the coating [length]."""
        return self.outer_radius - self.inner_radius
