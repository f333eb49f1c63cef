"""Distributed dolfinx mesh of a grid, with its named surfaces and regions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import dolfinx
import numpy as np
from mpi4py import MPI

from indent_sim.fe import compat
from indent_sim.mesh import distributed_rows
from indent_sim.mesh.grid import Grid
from indent_sim.mesh.model_domain import ModelDomain, nearest_on_sphere
from indent_sim.mesh.two_bodies import TIP_PREFIX, TwoBodyDomain
from indent_sim.model.tips import Paraboloid
from indent_sim.scene.scene import Scene

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
    body_counts : tuple of int, optional
        Numbers of vertices and cells of the body, which precede the vertices and cells of a soft
        tip; None if the mesh contains no tip.
    """

    mesh: dolfinx.mesh.Mesh
    part: ModelDomain
    surfaces: dict[str, np.ndarray]
    noncontact_facets: np.ndarray
    regions: np.ndarray
    hash: str
    body_counts: tuple[int, int] | None = None

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
    fingerprint, named_facets = comm.bcast((grid.hash, grid.surfaces) if grid else None, root=0)
    tables = (None,) * 3 if grid is None else (*_curved_geometry(grid, part), grid.regions)
    return _distribute_tables(tables, named_facets, fingerprint, part, comm)


def distribute_with_tip(grid: Grid, tip_grid: Grid, scene: Scene, comm: MPI.Comm) -> BodyMesh:
    """Return the mesh of a body and of the soft tip above it, which share no points.

    The tip is mirrored, so that its apex is at the origin and its holder above it. The vertices of
    the body come first, then those of the tip and the midpoints of all edges.

    Parameters
    ----------
    grid, tip_grid : Grid
        The grids of the body and of the tip upside down.
    scene : Scene
        The scene, whose domain consists of both bodies.
    comm : MPI.Comm
        Communicator of this process alone.
    """
    part = scene.physics.domain
    assert isinstance(part, TwoBodyDomain)
    assert scene.tip_scene is not None
    indenter = scene.physics.indenter
    unit = scene.tip_scene.physics.scales.length / scene.physics.scales.length
    points, cells = _quadratic_geometry(grid, part)
    tip_points, tip_cells = _quadratic_geometry(tip_grid, part.tip)
    tip_points = unit * tip_points * [1.0, -1.0]
    if isinstance(indenter, Paraboloid):
        # The cap of a ball, whose section at the height z has the radius sqrt(z (2 R - z)).
        tip_points[:, 0] *= np.sqrt(2 * indenter.R / (2 * indenter.R - tip_points[:, 1]))
    n = len(grid.points)
    m = len(tip_grid.points)
    all_points = np.concatenate([points[:n], tip_points[:m], points[n:], tip_points[m:]])
    # Numbers of the points of each body among those of both.
    body_numbers = np.concatenate([np.arange(n), np.arange(n, len(points)) + m])
    tip_numbers = np.concatenate([np.arange(m) + n, np.arange(m, len(tip_points)) + len(points)])
    all_cells = np.concatenate([body_numbers[cells], tip_numbers[tip_cells]])
    regions = np.concatenate([grid.regions, np.full(len(tip_cells), len(part.regions) - 1)])
    surfaces = {
        **grid.surfaces,
        **{TIP_PREFIX + name: n + facets for name, facets in tip_grid.surfaces.items()},
    }
    fingerprint = f"{grid.hash}-{tip_grid.hash}"
    tables = (all_points, all_cells, regions.astype(grid.regions.dtype))
    mesh = _distribute_tables(tables, surfaces, fingerprint, part, comm)
    return replace(mesh, body_counts=(n, len(grid.cells)))


def _distribute_tables(
    tables: tuple[np.ndarray | None, ...],
    named_facets: Mapping[str, np.ndarray],
    fingerprint: str,
    part: ModelDomain,
    comm: MPI.Comm,
) -> BodyMesh:
    """Distribute points, cells and region numbers, which are None on all ranks but the first."""
    dim = part.dim
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
            if name == "top" or part.supports.get(name) == "roller" or name.startswith(TIP_PREFIX)
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
    return _quadratic_geometry(grid, part)


def _quadratic_geometry(grid: Grid, part: ModelDomain) -> tuple[np.ndarray, np.ndarray]:
    """Return points and cells of a section; edge midpoints on a spherical top are on the sphere."""
    corners = grid.cells
    n = len(grid.points)
    edges = np.sort(corners[:, [[1, 2], [0, 2], [0, 1]]], axis=2).reshape(-1, 2)
    ends, number = np.unique(edges, axis=0, return_inverse=True)
    middles = grid.points[ends].mean(axis=1)
    if part.top_radius is not None:
        _move_onto_spheres(grid, part, middles, ends, number)
    return np.concatenate([grid.points, middles]), np.hstack([corners, n + number.reshape(-1, 3)])


def _move_onto_spheres(
    grid: Grid, part: ModelDomain, middles: np.ndarray, ends: np.ndarray, number: np.ndarray
) -> None:
    """Move the midpoints of edges on spherical surfaces and layer interfaces onto the sphere.

    Midpoints on an ellipsoid are moved in coordinates in which the ellipsoid is a sphere.

    Parameters
    ----------
    grid : Grid
        The grid.
    part : ModelDomain
        Model domain of the grid.
    middles : ndarray, (edges, 2)
        Midpoints of the edges [length]; they are changed.
    ends : ndarray of int, (edges, 2)
        Vertices of the edges.
    number : ndarray of int
        Numbers of the edges of each cell.
    """
    arc = part.top_arc
    assert arc is not None
    arcs = {side.surface for side in part.outline if side.center is not None}
    is_on_sphere = _match_facets(
        ends, np.concatenate([grid.surfaces[name] for name in sorted(arcs)])
    )
    # The contact surface of a cap that rests on a flat consists of its flat base and of an arc of
    # the sphere beside it.
    radii = np.hypot(grid.points[:, 0], grid.points[:, 1] / arc.stretch + arc.radius)
    is_off_sphere = np.abs(radii - arc.radius) > SPHERE_TOLERANCE * arc.radius
    is_on_sphere &= ~is_off_sphere[ends].any(axis=1)
    r, z = middles[is_on_sphere].T
    r, height = nearest_on_sphere(arc.radius, r, z / arc.stretch)
    middles[is_on_sphere] = np.column_stack([r, arc.stretch * height])
    for z, is_on_interface in _layer_interfaces(grid, part, number.ravel(), len(ends)):
        r, height = nearest_on_sphere(arc.radius + z, *(middles[is_on_interface] - [0.0, z]).T)
        middles[is_on_interface] = np.column_stack([r, height + z])


def _layer_interfaces(
    grid: Grid, part: ModelDomain, edge_numbers: np.ndarray, edge_count: int
) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the height on the axis and the edges of each interface between layers.

    Parameters
    ----------
    grid : Grid
        The grid.
    part : ModelDomain
        Model domain of the grid.
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
