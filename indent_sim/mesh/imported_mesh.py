"""Imported mesh: arrays with named surfaces and regions, in a position and a length unit."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Self

import numpy as np

from indent_sim.mesh.grid import LENGTH_DIGITS, Grid, boundary_facets
from indent_sim.mesh.msh_text import msh_text_parts
from indent_sim.mesh.simplices import edge_keys, unique_edges
from indent_sim.model.imported_body import MeshFromFile


@dataclass(frozen=True)
class MeshStatistics:
    """Numbers of cells, points and boundary facets of a mesh, and its longest edge [length]."""

    cells: int
    points: int
    boundary_facets: int
    longest_edge: float


@dataclass(frozen=True)
class ImportedMesh:
    """Mesh of a body from a file, initially in the units and the position of the file.

    Attributes
    ----------
    grid
        The mesh with the surfaces top, base and sides, and r_min for the axis r = 0.
    region_names
        Names of the regions in the order of their numbers; "" for cells of no named region.
    midside_nodes
        Midside nodes of a quadratic mesh: point numbers (k, 2) of their edges, and coordinates (k,
        dim) [length].
    hash
        Hash of all data that were taken from the file.
    leading_region
        Number in the file of the region that was moved to the first position.
    height_offset, length_unit
        Height in the file that was moved to z = 0, and length unit of the coordinates, both in the
        length unit of the file.
    """

    grid: Grid
    region_names: tuple[str, ...]
    midside_nodes: tuple[np.ndarray, np.ndarray]
    hash: str
    leading_region: int = field(default=0, kw_only=True)
    height_offset: float = field(default=0.0, kw_only=True)
    length_unit: float = field(default=1.0, kw_only=True)

    @property
    def dim(self) -> int:
        """Number of space dimensions of the mesh."""
        return self.grid.points.shape[1]

    def msh_text(self, source: MeshFromFile) -> Iterable[str]:
        """Return the text of a mesh file of the body, in parts; see `msh_text_parts`."""
        return msh_text_parts(
            self.grid, self.region_names, self.midside_nodes, source.surface_names
        )

    @property
    def height(self) -> float:
        """Distance between the highest and the lowest point [length]."""
        z = self.grid.points[:, -1]
        return float(z.max() - z.min())

    @cached_property
    def statistics(self) -> MeshStatistics:
        """Numbers of cells, points and facets, and the longest edge."""
        points = self.grid.points
        cells = self.grid.cells
        edges = (
            points[cells[:, i]] - points[cells[:, j]]
            for i, j in combinations(range(self.dim + 1), 2)
        )
        longest = max(float(np.linalg.norm(edge, axis=1).max()) for edge in edges)
        return MeshStatistics(len(cells), len(points), len(boundary_facets(cells)[0]), longest)

    @property
    def full_mesh(self) -> ImportedMesh:
        """The mesh with all cells of the file, which for this class is the mesh itself."""
        return self

    def facet_corners(self, surface: str) -> np.ndarray:
        """Return the corners of a surface's facets (k, dim, dim) [length]."""
        return self.grid.points[self.grid.surfaces[surface]]

    def with_leading_region(self, region: int) -> Self:
        """Return the mesh with its regions renumbered so that the given region is the first."""
        order = [region, *(k for k in range(len(self.region_names)) if k != region)]
        new_numbers = np.argsort(order).astype(np.int32)
        grid = replace(self.grid, regions=new_numbers[self.grid.regions])
        return replace(
            self,
            grid=grid,
            region_names=tuple(self.region_names[k] for k in order),
            leading_region=region,
        )

    def translated_to_contact(self, height: float) -> Self:
        """Return the mesh moved down by a height [length]."""
        return replace(
            self._transform_points(lambda points: points - height * np.eye(self.dim)[-1]),
            height_offset=height,
        )

    def scaled_by_length(self, length: float) -> Self:
        """Return the mesh in units of a length, with coordinates rounded to LENGTH_DIGITS."""
        return replace(
            self._transform_points(lambda points: np.round(points / length, LENGTH_DIGITS) + 0.0),
            length_unit=length,
        )

    def _transform_points(self, transform: Callable[[np.ndarray], np.ndarray]) -> Self:
        """Return the mesh with transformed points and midside nodes."""
        edges, positions = self.midside_nodes
        return replace(
            self,
            grid=replace(self.grid, points=transform(self.grid.points)),
            midside_nodes=(edges, transform(positions)),
        )


@dataclass(frozen=True)
class BoundaryCells(ImportedMesh):
    """Cells of an imported mesh that touch its boundary.

    A scene needs only these cells. With several MPI ranks, every rank stores them, while only rank
    0 stores the full mesh.

    Attributes
    ----------
    point_numbers
        Numbers (n,) of the points in the full mesh.
    full_statistics
        Size of the full mesh, in the length unit of the file.
    unplaced_mesh
        The full mesh in the units and the position of the file; None except on rank 0.
    """

    point_numbers: np.ndarray
    full_statistics: MeshStatistics
    unplaced_mesh: ImportedMesh | None

    @property
    def statistics(self) -> MeshStatistics:  # type: ignore[override]
        """Numbers of cells, points and facets of the full mesh, and its longest edge."""
        return replace(
            self.full_statistics, longest_edge=self.full_statistics.longest_edge / self.length_unit
        )

    def msh_text(self, source: MeshFromFile) -> Iterable[str]:
        """Return the text of a mesh file of the body, in parts; empty except on rank 0."""
        return () if self.unplaced_mesh is None else self.unplaced_mesh.msh_text(source)

    @property
    def full_mesh(self) -> ImportedMesh:
        """The full mesh with the same position, units and surfaces as these cells."""
        assert self.unplaced_mesh is not None
        placed_mesh = (
            self.unplaced_mesh.with_leading_region(self.leading_region)
            .translated_to_contact(self.height_offset)
            .scaled_by_length(self.length_unit)
        )
        surfaces = {name: self.point_numbers[facets] for name, facets in self.grid.surfaces.items()}
        return replace(placed_mesh, grid=replace(placed_mesh.grid, surfaces=surfaces))


def boundary_cells_of(mesh: ImportedMesh) -> BoundaryCells:
    """Return the cells of a mesh that touch its boundary, with a reference to the full mesh."""
    grid = mesh.grid
    (edges, positions) = mesh.midside_nodes
    is_outside = np.zeros(len(grid.points), dtype=bool)
    is_outside[boundary_facets(grid.cells)[0]] = True
    is_touching = is_outside[grid.cells].any(axis=1)
    numbers, cells = np.unique(grid.cells[is_touching], return_inverse=True)
    cells = cells.reshape(-1, mesh.dim + 1)
    surfaces = {name: np.searchsorted(numbers, facets) for name, facets in grid.surfaces.items()}
    is_inside = np.all(np.isin(edges, numbers), axis=1)
    is_inside[is_inside] = np.isin(
        edge_keys(np.searchsorted(numbers, edges[is_inside])), edge_keys(unique_edges(cells))
    )
    midside_nodes = np.searchsorted(numbers, edges[is_inside]), positions[is_inside]
    boundary_grid = Grid(grid.points[numbers], cells, grid.regions[is_touching], surfaces)
    return BoundaryCells(
        boundary_grid, mesh.region_names, midside_nodes, mesh.hash, numbers, mesh.statistics, mesh
    )
