"""Distributed dolfinx mesh of a grid, with its named surfaces and regions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import dolfinx
import numpy as np
from mpi4py import MPI

from indent_sim.fe import compat
from indent_sim.mesh import distributed_rows
from indent_sim.mesh.grid import Grid
from indent_sim.mesh.model_domain import ModelDomain, nearest_on_sphere

# Relative distance of a vertex from a spherical surface that is round-off of its coordinates.
SPHERE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class BodyMesh:
    """Mesh of a model domain, distributed among the ranks.

    Attributes
    ----------
    mesh : dolfinx.mesh.Mesh
        The mesh.
    part : ModelDomain
        The model domain.
    surfaces : dict of str to ndarray
        Facets of each named surface on this rank.
    noncontact_facets : ndarray of int
        Boundary facets on this rank outside of the contact surface, mirror planes and rollers.
    regions : ndarray of int, (cells,)
        Region number of each cell on this rank.
    hash : str
        Hash of the grid.
    """

    mesh: dolfinx.mesh.Mesh
    part: ModelDomain
    surfaces: dict[str, np.ndarray]
    noncontact_facets: np.ndarray
    regions: np.ndarray
    hash: str

    @cached_property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.mesh.comm

    @property
    def dim(self) -> int:
        """Topological dimension of a cell."""
        return self.part.dim

    def vertices_at(self, point: tuple[float, ...]) -> np.ndarray:
        """Local numbers of the vertices at a point [length]."""
        target = np.asarray(point)[:, None]
        # Coordinates are of the order of 1 and rounded to 12 digits
        return dolfinx.mesh.locate_entities(
            self.mesh, 0, lambda x: (np.abs(x[: self.dim] - target) < 1e-9).all(axis=0)
        )


def distribute(grid: Grid | None, part: ModelDomain, comm: MPI.Comm) -> BodyMesh:
    """Distribute the grid of a model domain among all ranks (collective).

    Each rank receives a part of the points and cells, and dolfinx partitions the mesh.

    Parameters
    ----------
    grid : Grid or None
        The grid on rank 0, None on the others.
    part : ModelDomain
        The model domain.
    comm : MPI.Comm
        Communicator.

    Returns
    -------
    BodyMesh
        The mesh with the named surfaces and regions of each rank.
    """
    dim = part.dim
    fingerprint, named_facets = comm.bcast((grid.hash, grid.surfaces) if grid else None, root=0)
    tables = (None,) * 3 if grid is None else (*_curved_geometry(grid, part), grid.regions)
    points, cells, regions = (distributed_rows.scatter_rows(comm, table) for table in tables)
    mesh = compat.create_mesh(comm, cells, points, dim)
    regions = distributed_rows.fetch_rows(
        comm, regions, np.asarray(mesh.topology.original_cell_index)
    )
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    mesh.topology.create_connectivity(0, dim)
    facets, corners = compat.exterior_facets(mesh)
    surfaces = {
        surface: facets[_match_facets(corners, wanted)] for surface, wanted in named_facets.items()
    }
    excluded_facets = [
        facets[:0],
        *(
            surfaces[name]
            for name in named_facets
            if name == "top" or part.supports.get(name) == "roller"
        ),
    ]
    noncontact_facets = np.setdiff1d(facets, np.concatenate(excluded_facets))
    return BodyMesh(mesh, part, surfaces, noncontact_facets, regions, fingerprint)


def _curved_geometry(grid: Grid, part: ModelDomain) -> tuple[np.ndarray, np.ndarray]:
    """Return points and cells of a grid, with edge midpoints if the top is spherical.

    The midpoints of edges on spherical surfaces and layer interfaces are moved onto the sphere.
    """
    if part.top_radius is None:
        return grid.points, grid.cells
    corners = grid.cells
    n = len(grid.points)
    edges = np.sort(corners[:, [[1, 2], [0, 2], [0, 1]]], axis=2).reshape(-1, 2)
    ends, number = np.unique(edges, axis=0, return_inverse=True)
    middles = grid.points[ends].mean(axis=1)
    arcs = {side.surface for side in part.outline if side.center is not None}
    is_on_sphere = _match_facets(
        ends, np.concatenate([grid.surfaces[name] for name in sorted(arcs)])
    )
    # The contact surface of a cap that rests on a flat consists of its flat base and of an arc of
    # the sphere beside it.
    radii = np.hypot(grid.points[:, 0], grid.points[:, 1] + part.top_radius)
    is_off_sphere = np.abs(radii - part.top_radius) > SPHERE_TOLERANCE * part.top_radius
    is_on_sphere &= ~is_off_sphere[ends].any(axis=1)
    middles[is_on_sphere] = np.column_stack(
        nearest_on_sphere(part.top_radius, *middles[is_on_sphere].T)
    )
    for z, is_on_interface in _layer_interfaces(grid, part, number.ravel(), len(ends)):
        r, height = nearest_on_sphere(part.top_radius + z, *(middles[is_on_interface] - [0.0, z]).T)
        middles[is_on_interface] = np.column_stack([r, height + z])
    return np.concatenate([grid.points, middles]), np.hstack([corners, n + number.reshape(-1, 3)])


def _layer_interfaces(
    grid: Grid, part: ModelDomain, edge_numbers: np.ndarray, edge_count: int
) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the height on the axis and the edges of each interface between layers.

    Parameters
    ----------
    grid : Grid
        The grid.
    part : ModelDomain
        Its model domain.
    edge_numbers : ndarray of int, (3 cells,)
        Numbers of the edges of each cell.
    edge_count : int
        Number of edges.

    Yields
    ------
    z : float
        Height of the interface on the axis [length].
    is_on_interface : ndarray of bool, (edges,)
        Mask of the edges on the interface.
    """
    regions = np.repeat(grid.regions, 3)
    layers = len(part.interfaces)
    outer = np.full(edge_count, layers)
    inner = np.zeros(edge_count, dtype=int)
    np.minimum.at(outer, edge_numbers, regions)
    np.maximum.at(inner, edge_numbers, regions)
    for k, z in enumerate(reversed(part.interfaces)):
        yield z, (outer == k) & (inner == k + 1)


def _match_facets(facets: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the facets (n, dim) that are in `wanted`, in any vertex order."""
    first, *later_columns = np.sort(np.concatenate([wanted, facets]).astype(np.int64), axis=1).T
    facet_number = first
    # Numbers are built column by column, because sorting whole rows takes ten times as long
    for corners in later_columns:
        _, facet_number = np.unique(facet_number, return_inverse=True)
        facet_number = facet_number.ravel() * (corners.max(initial=0) + 1) + corners
    return np.isin(facet_number[len(wanted) :], facet_number[: len(wanted)])
