"""Grid -> distributed dolfinx mesh with named surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import dolfinx
import numpy as np

from indent_sim.fe import compat
from indent_sim.mesh import rows
from indent_sim.mesh.grid import Grid
from indent_sim.mesh.part import Part

AT_POINT = 1e-9  # of a body whose coordinates are near 1 and rounded to 12 digits


@dataclass(frozen=True)
class BodyMesh:
    """The distributed mesh; `surfaces` maps each named surface to its facets on this rank.

    regions: the number of the region of each cell on this rank (n,).
    """

    mesh: Any
    part: Part
    surfaces: dict[str, np.ndarray]
    regions: np.ndarray
    hash: str

    @cached_property
    def comm(self) -> Any:
        """The communicator of the mesh."""
        return self.mesh.comm

    @property
    def dim(self) -> int:
        """Topological dimension of a cell."""
        return self.part.dim

    @property
    def facet_dim(self) -> int:
        """Topological dimension of a facet."""
        return self.dim - 1

    def vertices_at(self, point: tuple[float, ...]) -> np.ndarray:
        """Local vertices at a point."""
        target = np.asarray(point)[:, None]

        def close(x: np.ndarray) -> np.ndarray:
            return np.all(np.abs(x[: self.dim] - target) < AT_POINT, axis=0)

        return dolfinx.mesh.locate_entities(self.mesh, 0, close)


def distribute(grid: Grid | None, part: Part, comm: Any) -> BodyMesh:
    """Divide the grid of a part, which rank 0 can read, among all ranks; each has its named surfaces (collective).

    A rank takes the rows of one slice of points and cells, and from there dolfinx finds who is best to have which cell.
    """
    dim = part.dim
    fingerprint, named = comm.bcast((grid.hash, grid.surfaces) if grid else None, root=0)
    points, cells, regions = (rows.scatter(comm, getattr(grid, name, None)) for name in ("points", "cells", "regions"))
    mesh = compat.create_mesh(comm, cells, points, dim)
    regions = rows.fetch(comm, regions, np.asarray(mesh.topology.original_cell_index))
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    mesh.topology.create_connectivity(0, dim)
    facets, corners = compat.exterior_facets(mesh)
    surfaces = {surface: facets[_among(corners, wanted)] for surface, wanted in named.items()}
    return BodyMesh(mesh, part, surfaces, regions, fingerprint)


def _among(facets: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Which facets (n, dim), by their points in any order, are among the wanted ones."""
    _, inverse = np.unique(np.sort(np.concatenate([wanted, facets]), axis=1), axis=0, return_inverse=True)
    return np.isin(inverse.ravel()[len(wanted) :], inverse.ravel()[: len(wanted)])
