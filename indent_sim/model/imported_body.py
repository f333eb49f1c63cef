"""Bodies whose mesh is read from a file."""

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


@dataclass(frozen=True)
class MeshSurfaces:
    """Names that the contact surface, the base and the sides have in a mesh file.

    If no names are given, the upward faces are the contact surface, the horizontal downward faces
    are the base, and the vertical faces are the sides, if these are supported.
    """

    contact: str | None = None
    base: str | None = None
    sides: str | None = None


@dataclass(frozen=True)
class MeshFromFile:
    """Body whose mesh is read from a file, z up.

    The coordinates (x, y) of a two-dimensional file are (r, z) or (x, z); the axis of revolution is
    r = 0. The tip's axis is at x = 0, y = 0 of the file unless `indenter.center` is given. Faces
    that belong to none of the `surfaces` are free. A surface whose name is not given is recognized
    by its orientation; if this is impossible, the file is rejected. `regions` gives the material of
    each named region; other cells have the material of the scene. sides "auto" means free. The
    support of a face in a plane through the tip's axis must be given, since the face may be a
    mirror plane of half a body (roller) or a free face of a whole body.
    """

    file: str
    kinematics: Literal["axisymmetric", "plane_strain", "3d"]
    surfaces: MeshSurfaces = MeshSurfaces()
    shape: Literal["mesh"] = "mesh"
    base: BaseSupport = "fixed"
    sides: Support | Auto = "auto"
    regions: dict[str, Annotated[Material, TaggedBy("model")]] | None = None
    hash: str | None = None

    # Its materials are given by `regions`.
    layers: ClassVar[None] = None
    inclusions: ClassVar[None] = None
    surface_tension: ClassVar[float] = 0.0

    @property
    def surface_names(self) -> MeshSurfaces:
        """Names of all surfaces, with default names for surfaces that the scene does not name.

        The copy of the mesh in the result folder uses these names.
        """
        given = self.surfaces
        sides = "sides" if self.sides in ("roller", "fixed") else None
        return MeshSurfaces(given.contact or "contact", given.base or "base", given.sides or sides)

    @property
    def dim(self) -> int:
        """Dimension of the body: 3, or 2 in plane strain, where forces are per unit length."""
        return 2 if self.kinematics == "plane_strain" else 3

    @property
    def center(self) -> tuple[float, ...]:
        """Default horizontal position of the tip's axis: the origin of the file."""
        return (0.0,) * (self.dim - 1)


@dataclass(frozen=True)
class ImportedBody:
    """Imported mesh with the properties of a body; first contact with the tip is at z = 0.

    Attributes
    ----------
    facets : (k, n, n)
        Corners of the facets of the contact surface [length].
    boundary_edges : (m, n - 1, n)
        Boundary edges of the contact surface, or its end points in two dimensions [length].
    fixed_points : (j, n)
        Points of the contact surface whose displacement is prescribed by a support [length].
    layers
        Material under the tip's axis, as a single layer.
    """

    height: Length
    # Position of the tip's axis.
    center: Annotated[tuple[float, ...], LENGTH]
    facets: Annotated[np.ndarray, LENGTH]
    boundary_edges: Annotated[np.ndarray, LENGTH]
    fixed_points: Annotated[np.ndarray, LENGTH]
    layers: Layers
    base: BaseSupport
    sides: Support
    # 2 in plane strain, where forces are per unit length.
    dim: int
    shape: Literal["mesh"] = "mesh"

    # A mesh file does not tell whether all sides are confined. False skips the check for a confined
    # incompressible body.
    is_laterally_confined: ClassVar[bool] = False
    inclusions: ClassVar[None] = None

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return the distance [length] from `center` to the nearest edge of the contact surface.

        The distance is negative if `center` is outside of the contact surface.
        """
        position = self._plan_coordinates(center)
        start = self.boundary_edges[:, 0, :-1]
        edge_vector = self.boundary_edges[:, -1, :-1] - self.boundary_edges[:, 0, :-1]
        # The squared length of an edge is bounded below, so that none is divided by zero.
        edge_fraction = ((position - start) * edge_vector).sum(axis=1) / np.maximum(
            (edge_vector**2).sum(axis=1), 1e-300
        )
        nearest_points = start + np.clip(edge_fraction, 0.0, 1.0)[:, None] * edge_vector
        distance = float(np.linalg.norm(nearest_points - position, axis=1).min(initial=np.inf))
        # A point outside a facet by rounding counts as on it.
        return (
            distance
            if (barycentric_coordinates(self.facets, center) >= -1e-9).all(axis=1).any()
            else -distance
        )

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Return the distance [length] from `center` to the contact surface's farthest point."""
        return float(self.corner_distances(center).max())

    def corner_distances(self, center: tuple[float, ...]) -> np.ndarray:
        """Return distances (k, n) [length] of the facets' corners from a vertical axis."""
        return np.asarray(
            np.linalg.norm(self.facets[..., :-1] - self._plan_coordinates(center), axis=-1)
        )

    def top_points(self) -> Points:
        """Return the horizontal positions of the corners of the facets [length]."""
        x, y = np.moveaxis(np.pad(self.facets[..., :-1], ((0, 0), (0, 0), (0, 1)))[..., :2], -1, 0)
        return x, y

    def fixed_edge_points(self) -> Points:
        """Return the horizontal positions of supported points of the contact surface."""
        x, y = np.pad(self.fixed_points[:, :-1], ((0, 0), (0, 1)))[:, :2].T
        return x, y

    def _plan_coordinates(self, center: tuple[float, ...]) -> np.ndarray:
        """Return the horizontal coordinates of a center: one in two dimensions, two in three."""
        return np.asarray(center[: self.facets.shape[2] - 1])


def barycentric_coordinates(facets: np.ndarray, center: tuple[float, ...]) -> np.ndarray:
    """Return barycentric coordinates (k, n) of a point in projected facets (k, n, n)."""
    plan_corners = facets[..., :-1]
    edges = np.swapaxes(plan_corners[:, 1:] - plan_corners[:, :1], 1, 2)
    coordinates = np.linalg.solve(
        edges, (np.asarray(center[: plan_corners.shape[2]]) - plan_corners[:, 0])[..., None]
    )[..., 0]
    return np.column_stack([1 - coordinates.sum(axis=1), coordinates])
