"""Uniform (red) refinement of an imported mesh: every edge is halved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from indent_sim.mesh.grid import Grid
from indent_sim.mesh.imported_mesh import ImportedMesh
from indent_sim.mesh.simplices import edge_keys, oriented, signed_volumes, unique_edges
from indent_sim.process.errors import MeshError

# Midpoints of the edges of simplices, by the two corners (i, j) of an edge, i < j.
Midpoints = Mapping[tuple[int, int], np.ndarray]
# Function of two arrays of corners that returns the midpoints between them.
MidpointFinder = Callable[[np.ndarray, np.ndarray], np.ndarray]
# The octahedron between the midpoints of a tetrahedron's edges can be split along three diagonals.
# Each diagonal, given by two opposite edges, is surrounded by the midpoints of four other edges.
OCTAHEDRON_SPLITS = {
    ((0, 1), (2, 3)): ((0, 2), (0, 3), (1, 3), (1, 2)),
    ((0, 2), (1, 3)): ((0, 1), (0, 3), (2, 3), (1, 2)),
    ((0, 3), (1, 2)): ((0, 1), (0, 2), (2, 3), (1, 3)),
}


def refined_once(mesh: ImportedMesh) -> ImportedMesh:
    """Return a uniformly refined mesh, in which every edge is halved.

    A triangle becomes four, a tetrahedron eight (Bey 1995, Computing 55, 355). The new points are
    the midside nodes of a quadratic mesh, and the midpoints of all other edges.

    Raises
    ------
    MeshError
        If a midside node inverts a cell.
    """
    grid = mesh.grid
    edges = unique_edges(mesh.grid.cells)
    (midside_edges, midside_positions) = mesh.midside_nodes
    count = len(grid.points)
    midpoints = grid.points[edges].mean(axis=1)
    midpoints[np.searchsorted(edge_keys(edges), edge_keys(midside_edges))] = midside_positions

    def midpoint_numbers(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return count + np.searchsorted(
            edge_keys(edges), edge_keys(np.sort(np.column_stack([a, b]), axis=1))
        )

    points = np.vstack([grid.points, midpoints])
    straight_points = np.vstack([grid.points, grid.points[edges].mean(axis=1)])
    cells = _split_simplices(straight_points, grid.cells, midpoint_numbers)
    if (signed_volumes(points, cells) * signed_volumes(straight_points, cells) <= 0).any():
        raise MeshError(
            "the mesh cannot be refined: new cells with corners at its midside nodes are inverted"
        )
    surfaces = {
        name: _split_simplices(straight_points, facets, midpoint_numbers)
        for name, facets in grid.surfaces.items()
    }
    regions = np.tile(grid.regions, 2**mesh.dim)
    grid = Grid(points, oriented(points, cells), regions, surfaces)
    return replace(mesh, grid=grid, midside_nodes=(midside_edges[:0], midside_positions[:0]))


def _split_simplices(
    points: np.ndarray, simplices: np.ndarray, find_midpoints: MidpointFinder
) -> np.ndarray:
    """Return the children of refined simplices: the first child of each, then the second, etc."""
    corner_parts, midpoints = split_at_midpoints(list(simplices.T), find_midpoints)
    if len(simplices.T) < 4:
        return corner_parts
    return np.concatenate([corner_parts, *_split_octahedra(points, midpoints)])


def split_at_midpoints(
    corners: Sequence[np.ndarray], find_midpoints: MidpointFinder
) -> tuple[np.ndarray, Midpoints]:
    """Split segments in halves, triangles in quarters, and cut the four corners off tetrahedra.

    Parameters
    ----------
    corners : sequence of numpy.ndarray
        First, second, ... corner of all simplices, as point numbers (k,) or coordinates (k, dim).
    find_midpoints : callable
        Function that returns the midpoints between two arrays of corners.

    Returns
    -------
    numpy.ndarray
        Corners of the parts (m, number of corners, *).
    dict
        The midpoints between each pair of corners.
    """
    n = len(corners)
    midpoints = {
        (i, j): find_midpoints(corners[i], corners[j]) for i, j in combinations(range(n), 2)
    }
    corner_parts = [
        [corner, *(midpoints[min(i, j), max(i, j)] for j in range(n) if j != i)]
        for i, corner in enumerate(corners)
    ]
    central_part = [list(midpoints.values())] if n == 3 else []
    parts = [np.stack(part, axis=1) for part in corner_parts + central_part]
    return np.concatenate(parts), midpoints


def _split_octahedra(points: np.ndarray, midpoints: Midpoints) -> list[np.ndarray]:
    """Return the four tetrahedra (m, 4) of each octahedron, around its shortest diagonal."""
    lengths = [
        np.linalg.norm(points[midpoints[a]] - points[midpoints[b]], axis=1)
        for a, b in OCTAHEDRON_SPLITS
    ]
    shortest = np.argmin(lengths, axis=0)

    def tetrahedron_corners(k: int) -> list[list[np.ndarray]]:
        return [
            [midpoints[a], midpoints[b], midpoints[ring[k]], midpoints[ring[(k + 1) % 4]]]
            for (a, b), ring in OCTAHEDRON_SPLITS.items()
        ]

    return [np.choose(shortest, tetrahedron_corners(k)).T for k in range(4)]
