"""Imported mesh: arrays with named surfaces and regions, positioned, refined and written again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, combinations, islice
from typing import Any, Self

import numpy as np

from indent_sim.mesh.grid import LENGTH_DIGITS, Grid, boundary_facets, row_slices
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.process.errors import MeshError

# Midpoints of the edges of simplices, by the two corners (i, j) of an edge, i < j.
Midpoints = Mapping[tuple[int, int], np.ndarray]
# Function of two arrays of corners that returns the midpoints between them.
MidpointFinder = Callable[[np.ndarray, np.ndarray], np.ndarray]
ROWS_WRITTEN_AT_ONCE = 10**4  # Lines of text that are held in memory while a file is written.
GMSH_TYPE = {(1, 1): 1, (2, 1): 2, (3, 1): 4, (2, 2): 9, (3, 2): 11}  # by dimension and order
# The octahedron between the midpoints of a tetrahedron's edges can be split along three diagonals.
# Each diagonal, given by two opposite edges, is surrounded by the midpoints of four other edges.
OCTAHEDRON_SPLITS = {
    ((0, 1), (2, 3)): ((0, 2), (0, 3), (1, 3), (1, 2)),
    ((0, 2), (1, 3)): ((0, 1), (0, 3), (2, 3), (1, 2)),
    ((0, 3), (1, 2)): ((0, 1), (0, 2), (2, 3), (1, 3)),
}


@dataclass(frozen=True)
class MeshStatistics:
    """Numbers of cells, points and boundary facets of a mesh, and its longest edge [length]."""

    cells: int
    points: int
    boundary_facets: int
    longest_edge: float


@dataclass(frozen=True)
class ImportedMesh:
    """Mesh of a body from a file, at first in the units and the position of the file.

    Attributes
    ----------
    grid
        The mesh with the surfaces top, base and sides, and r_min for the axis r = 0.
    region_names
        Names of the regions in the order of their numbers; "" for cells of no named region.
    midside_nodes
        Midside nodes of a quadratic mesh: edges (k, 2) by their points, and coordinates (k, dim)
        [length].
    hash
        Fingerprint of everything that was taken from the file.
    leading_region
        Number in the file's order of the region that has been made the first one.
    height_offset, length_unit
        Height [length of the file] that has been moved to z = 0, and length unit of the
        coordinates [length of the file].
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
        return msh_text_parts(self, source)

    @property
    def height(self) -> float:
        """Height of the highest point above the lowest one [length]."""
        z = self.grid.points[:, -1]
        return float(z.max() - z.min())

    @cached_property
    def statistics(self) -> MeshStatistics:
        """Size of the mesh in numbers."""
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
        """The mesh with all cells of the file, which is this one."""
        return self

    def facet_corners(self, surface: str) -> np.ndarray:
        """Return the corners of a surface's facets (k, dim, dim) [length]."""
        return self.grid.points[self.grid.surfaces[surface]]

    def with_leading_region(self, region: int) -> Self:
        """Return the mesh with its regions renumbered so that the given one is the first."""
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

    They are all that a scene needs. On several MPI ranks every rank has them, and rank 0 alone has
    the full mesh.

    Attributes
    ----------
    point_numbers
        Numbers (n,) of the points in the full mesh.
    full_statistics
        Size of the full mesh, in the length unit of the file.
    unplaced_mesh
        The full mesh in the units and the position of the file; None on all ranks but 0.
    """

    point_numbers: np.ndarray
    full_statistics: MeshStatistics
    unplaced_mesh: ImportedMesh | None

    @property
    def statistics(self) -> MeshStatistics:  # type: ignore[override]
        """Size of the full mesh in numbers."""
        return replace(
            self.full_statistics, longest_edge=self.full_statistics.longest_edge / self.length_unit
        )

    def msh_text(self, source: MeshFromFile) -> Iterable[str]:
        """Return the text of a mesh file of the body, in parts; nothing on all ranks but 0."""
        return () if self.unplaced_mesh is None else self.unplaced_mesh.msh_text(source)

    @property
    def full_mesh(self) -> ImportedMesh:
        """The full mesh in the position and with the surfaces of these cells."""
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


def refined_once(mesh: ImportedMesh) -> ImportedMesh:
    """Return a uniformly refined mesh, in which every edge is bisected.

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
    if (_signed_volumes(points, cells) * _signed_volumes(straight_points, cells) <= 0).any():
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
    """Return the parts of segments, triangles or tetrahedra, all first parts first."""
    corner_parts, midpoints = split_at_midpoints(list(simplices.T), find_midpoints)
    if len(simplices.T) < 4:
        return corner_parts
    return np.concatenate([corner_parts, *_split_octahedra(points, midpoints)])


def split_at_midpoints(
    corners: Sequence[np.ndarray], find_midpoints: MidpointFinder
) -> tuple[np.ndarray, Midpoints]:
    """Split segments in halves, triangles in quarters, and the corners off tetrahedra.

    Parameters
    ----------
    corners : sequence of numpy.ndarray
        First, second, ... corner of all simplices, by numbers (k,) or coordinates (k, dim).
    find_midpoints : callable
        Function that returns the midpoints between two arrays of corners.

    Returns
    -------
    numpy.ndarray
        Corners of the parts (m, number of corners, ...).
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


def unique_edges(cells: np.ndarray) -> np.ndarray:
    """Return the edges (k, 2) of simplices by their points, sorted and without duplicates."""
    pairs = combinations(range(cells.shape[1]), 2)
    return np.unique(
        np.sort(np.concatenate([cells[:, list(pair)] for pair in pairs]), axis=1), axis=0
    )


def edge_keys(edges: np.ndarray) -> np.ndarray:
    """Return one integer per edge (k,), in the order of sorted edges."""
    return np.asarray((edges[:, 0] << 32) + edges[:, 1])


def oriented(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the cells with their corners ordered so that all volumes are positive."""
    is_inverted = _signed_volumes(points, cells) < 0
    cells = cells.copy()
    cells[is_inverted, -2:] = cells[is_inverted][:, :-3:-1]
    return cells


def _signed_volumes(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the determinants (m,) of the cells' edge vectors: dim! times their signed volumes."""
    volumes = [
        np.linalg.det(points[cells[chunk, 1:]] - points[cells[chunk, :1]])
        for chunk in row_slices(len(cells))
    ]
    return np.concatenate([np.empty(0), *volumes])


def msh_text_parts(mesh: ImportedMesh, source: MeshFromFile) -> Iterator[str]:
    """Generate the text of a mesh in gmsh's format 2.2.

    Coordinates have all digits, so that the text is read as the same mesh. It is generated in
    parts, because the whole text takes several times the memory of the arrays.

    Parameters
    ----------
    mesh : ImportedMesh
        The mesh.
    source : MeshFromFile
        The body in the scene file, which names the surfaces.

    Yields
    ------
    str
        The next lines of the file.
    """
    dim = mesh.dim
    grid = mesh.grid
    edges, midside_positions = mesh.midside_nodes
    surface_names = {
        "top": source.surface_names.contact,
        "base": source.surface_names.base,
        "sides": source.surface_names.sides,
    }
    facets = [
        (str(surface_names[surface]), surface_facets)
        for surface, surface_facets in grid.surfaces.items()
        if surface in surface_names
    ]
    named_groups = [(dim - 1, name) for name, _ in facets] + [
        (dim, name) for name in mesh.region_names if name
    ]
    tags = {name: k + 1 for k, name in enumerate(named_groups)}
    regions = np.array([tags.get((dim, name), 0) for name in mesh.region_names])
    cell_type = GMSH_TYPE[dim, 2 if len(edges) else 1]

    def add_midside_nodes(cells: np.ndarray) -> np.ndarray:
        if len(edges) == 0:
            return cells
        # Midside nodes are numbered after the corners; gmsh expects them in this order of edges.
        order = ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3))[: 3 if dim == 2 else 6]
        ends = (np.sort(cells[:, list(pair)], axis=1) for pair in order)
        nodes = [
            len(grid.points) + np.searchsorted(edge_keys(edges), edge_keys(pair)) for pair in ends
        ]
        return np.column_stack([cells, *nodes])

    def node_lines() -> Iterator[str]:
        for k, point in enumerate(
            chain(_iterate_rows(grid.points), _iterate_rows(midside_positions))
        ):
            yield f"{k + 1} {' '.join(map(repr, (*point, 0.0)[:3]))}"

    def element_lines() -> Iterator[str]:
        facet_elements = (
            (GMSH_TYPE[dim - 1, 1], tags[dim - 1, name], row)
            for name, surface_facets in facets
            for row in surface_facets
        )
        rows = _iterate_rows(grid.cells, add_midside_nodes)
        cell_elements = (
            (cell_type, tag, row)
            for tag, row in zip(_iterate_rows(grid.regions, regions.take), rows, strict=True)
        )
        for k, (element_type, tag, row) in enumerate(chain(facet_elements, cell_elements)):
            yield f"{k + 1} {element_type} 2 {tag} 1 {' '.join(str(node + 1) for node in row)}"

    name_lines = (
        f'{group_dim} {tags[group_dim, name]} "{name}"' for group_dim, name in named_groups
    )
    count = sum(len(surface_facets) for _, surface_facets in facets) + len(grid.cells)
    yield "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
    yield from _msh_section("PhysicalNames", len(named_groups), name_lines)
    yield from _msh_section("Nodes", len(grid.points) + len(midside_positions), node_lines())
    yield from _msh_section("Elements", count, element_lines())


def _msh_section(name: str, count: int, lines: Iterator[str]) -> Iterator[str]:
    """Generate the text of a section of a file of gmsh, with the number of its lines."""
    yield f"${name}\n{count}\n"
    while chunk := list(islice(lines, ROWS_WRITTEN_AT_ONCE)):
        yield "\n".join(chunk) + "\n"
    yield f"$End{name}\n"


def _iterate_rows(
    rows: np.ndarray, convert: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> Iterator[Any]:
    """Generate the rows of an array as Python numbers, converted in chunks to save memory."""
    for chunk in row_slices(len(rows), ROWS_WRITTEN_AT_ONCE):
        yield from convert(rows[chunk]).tolist()
