"""Bodies whose mesh comes from a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from indent_sim.model.body_base import BaseSupport, Points, Support
from indent_sim.model.layers import Layers
from indent_sim.model.materials import Material
from indent_sim.model.units import (
    LENGTH,
    Auto,
    Length,
    TaggedBy,
)

FACET_TOLERANCE = 1e-9  # of a facet: so far outside a point still counts as on it
TINY_SQUARE = 1e-300  # no length is 0


@dataclass(frozen=True)
class MeshSurfaces:
    """Names that the file gives to the surface which the tip may touch, to the base and to the
    sides.

    Without them the contact surface is what faces up, the base what faces down and is level, and
    sides that are held what is upright.
    """

    contact: str | None = None
    base: str | None = None
    sides: str | None = None


@dataclass(frozen=True)
class MeshFromFile:
    """A body meshed elsewhere, z up; a file in two dimensions has (r, z) or (x, z) in its (x, y),
    the axis is r = 0.

    The tip's axis is at x = 0, y = 0 of the file unless `indenter.center` says otherwise. What is
    none of `surfaces` is free; a surface without a name is known by where it faces, or the file is
    refused. `regions` gives each named region its material; cells of no region are of the scene's.
    sides auto: free, but asked for where a face lies in a plane through the tip's axis, which is a
    mirror (roller) of half a body, or an end (free) of a whole one.
    """

    file: str
    kinematics: Literal["axisymmetric", "plane_strain", "3d"]
    surfaces: MeshSurfaces = MeshSurfaces()
    shape: Literal["mesh"] = "mesh"
    base: BaseSupport = "fixed"
    sides: Support | Auto = "auto"
    regions: dict[str, Annotated[Material, TaggedBy("model")]] | None = None
    hash: str | None = None

    layers: ClassVar[None] = None  # it has regions
    inclusions: ClassVar[None] = None
    surface_tension: ClassVar[float] = 0.0

    @property
    def surface_names(self) -> MeshSurfaces:
        """The names of all surfaces that it has, those for a copy of the file among them."""
        given = self.surfaces
        sides = "sides" if self.sides in ("roller", "fixed") else None
        return MeshSurfaces(given.contact or "contact", given.base or "base", given.sides or sides)

    @property
    def dim(self) -> int:
        """2 in plane strain, where forces are per unit length."""
        return 2 if self.kinematics == "plane_strain" else 3

    @property
    def center(self) -> tuple[float, ...]:
        """The file's own axis."""
        return (0.0,) * (self.dim - 1)


@dataclass(frozen=True)
class ImportedBody:
    """A body as its mesh has it: what is known of its contact surface. z = 0 where the tip first
    touches.

    facets (k, n, n): corners of the contact surface's facets; rim (m, n - 1, n): the edges around
    it, in two dimensions its ends; clamped (j, n): those of its points that are held too [length].
    """

    height: Length
    center: Annotated[tuple[float, ...], LENGTH]  # where the tip's axis is
    facets: Annotated[np.ndarray, LENGTH]
    boundary_edges: Annotated[np.ndarray, LENGTH]
    fixed_points: Annotated[np.ndarray, LENGTH]
    layers: Layers  # the matter under the tip's axis, as a single one
    base: BaseSupport
    sides: Support
    dim: int  # 2 in plane strain, where forces are per unit length
    shape: Literal["mesh"] = "mesh"

    is_laterally_confined: ClassVar[bool] = False  # not known, and what is not known is not refused
    inclusions: ClassVar[None] = None

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the nearest edge of the contact surface; negative
        outside of it.
        """
        position = self._plan_coordinates(center)
        start = self.boundary_edges[:, 0, :-1]
        edge_vector = self.boundary_edges[:, -1, :-1] - self.boundary_edges[:, 0, :-1]
        edge_fraction = ((position - start) * edge_vector).sum(axis=1) / np.maximum(
            (edge_vector**2).sum(axis=1), TINY_SQUARE
        )
        nearest_points = start + np.clip(edge_fraction, 0.0, 1.0)[:, None] * edge_vector
        distance = float(np.linalg.norm(nearest_points - position, axis=1).min(initial=np.inf))
        return (
            distance
            if (barycentric_coordinates(self.facets, center) >= -FACET_TOLERANCE).all(axis=1).any()
            else -distance
        )

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farthest point of the contact surface."""
        return float(self.corner_distances(center).max())

    def corner_distances(self, center: tuple[float, ...]) -> np.ndarray:
        """Distances [length] of the corners of the facets from a vertical axis (k, n)."""
        return np.asarray(
            np.linalg.norm(self.facets[..., :-1] - self._plan_coordinates(center), axis=-1)
        )

    def top_points(self) -> Points:
        """The corners of the facets, seen from above."""
        x, y = np.moveaxis(np.pad(self.facets[..., :-1], ((0, 0), (0, 0), (0, 1)))[..., :2], -1, 0)
        return x, y

    def fixed_edge_points(self) -> Points:
        """Those points of the contact surface that are held, seen from above."""
        x, y = np.pad(self.fixed_points[:, :-1], ((0, 0), (0, 1)))[:, :2].T
        return x, y

    def _plan_coordinates(self, center: tuple[float, ...]) -> np.ndarray:
        return np.asarray(center[: self.facets.shape[2] - 1])


def barycentric_coordinates(facets: np.ndarray, center: tuple[float, ...]) -> np.ndarray:
    """The barycentric coordinates (k, n) of a point in facets (k, n, n), seen from above."""
    plan_corners = facets[..., :-1]
    edges = np.swapaxes(plan_corners[:, 1:] - plan_corners[:, :1], 1, 2)
    coordinates = np.linalg.solve(
        edges, (np.asarray(center[: plan_corners.shape[2]]) - plan_corners[:, 0])[..., None]
    )[..., 0]
    return np.column_stack([1 - coordinates.sum(axis=1), coordinates])
