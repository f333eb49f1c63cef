"""Simplex mesh as arrays, with its named surfaces."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from indent_sim.mesh.model_domain import ModelDomain

# Lengths are rounded to this many digits, so that a scene in nm and in m gives the same mesh.
LENGTH_DIGITS = 12
ROWS_PER_CHUNK = 10**6  # Rows per chunk, whose memory is small beside that of a solver.


@dataclass(frozen=True)
class Grid:
    """Simplex mesh as arrays.

    Attributes
    ----------
    points
        Coordinates (n, dim) in multiples of `Scales.length`; the coordinates of an imported mesh
        are at first in the length unit of its file.
    cells
        Point numbers (m, dim + 1) of the corners of the cells.
    regions
        Region number (m,) of each cell.
    surfaces
        Point numbers (k, dim) of the facets of each named surface.
    gmsh_version
        Version of gmsh that generated the mesh; empty for an imported mesh.
    """

    points: np.ndarray
    cells: np.ndarray
    regions: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int32), repr=False)
    surfaces: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    gmsh_version: str = ""

    @property
    def hash(self) -> str:
        """Hash of the mesh, which a run records, computed in chunks to save memory."""
        digest = hashlib.sha256()
        for chunk in row_slices(len(self.points)):
            digest.update(np.round(self.points[chunk], decimals=LENGTH_DIGITS).tobytes())
        for chunk in row_slices(len(self.cells)):
            digest.update(np.ascontiguousarray(self.cells[chunk]).tobytes())
        return digest.hexdigest()[:16]

    def separate_regions(self) -> Grid:
        """Return the same mesh with points duplicated at interfaces between regions."""
        origin, cells = split_at_interfaces(self.cells, self.regions, len(self.points))
        return replace(self, points=self.points[origin], cells=cells)


def split_at_interfaces(
    cells: np.ndarray, regions: np.ndarray, point_count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Duplicate the points on interfaces, so that each region has separate points.

    A point keeps its number in the first adjacent region; the points of other regions are appended.
    The result does not depend on the order of the cells.

    Parameters
    ----------
    cells
        Point numbers (m, k) of the corners of the cells.
    regions
        Region number (m,) of each cell.
    point_count
        Number of points n.

    Returns
    -------
    origin
        Original point number (n + added,) of each point.
    cells
        New point numbers (m, k) of the corners of the cells.
    """
    region_count = int(regions.max(initial=0)) + 1
    corners = cells.astype(np.int64) * region_count + regions[:, None]
    sides, side_of_corner = np.unique(corners, return_inverse=True)
    points = sides // region_count
    is_added = np.concatenate([[False], points[1:] == points[:-1]])
    numbers = np.where(is_added, point_count - 1 + np.cumsum(is_added), points)
    origin = np.concatenate([np.arange(point_count), points[is_added]])
    return origin, numbers[side_of_corner].reshape(cells.shape)


def map_grid(
    grid: Grid, source: ModelDomain, target: ModelDomain, radii: tuple[float, ...]
) -> Grid | None:
    """Map the mesh of one domain to another by scaling the layers and the contact radius.

    Parameters
    ----------
    source, target
        Sections with straight sides and layers, whose left side is the tip's axis.
    radii
        Contact radius [length] in the source and in the target.

    Returns
    -------
    Grid or None
        The mapped mesh; None for domains of other shapes.
    """
    if not (
        _is_mappable(source) and _is_mappable(target) and len(source.outline) == len(target.outline)
    ):
        return None
    (left_end, right), (bottom, top) = source.extent
    (new_left, new_right), (new_bottom, new_top) = target.extent
    a = radii[0]
    # Contact radii within which `map_grid` scales a mesh as a whole.
    moved_contact_radii = 2.0
    outer_radii = min(moved_contact_radii, (1 + right / a) / 2) if 0 < a < right else 0.0
    contact_edge, new_contact_edge = (
        [outer_radii * radius] if outer_radii else [] for radius in radii
    )
    x = np.interp(
        grid.points[:, 0],
        [left_end, *contact_edge, right],
        [new_left, *new_contact_edge, new_right],
    )
    levels, new_levels = (
        [low, *sorted(domain.interfaces), high]
        for low, domain, high in ((bottom, source, top), (new_bottom, target, new_top))
    )
    z = np.interp(grid.points[:, 1], levels, new_levels)
    return replace(grid, points=np.column_stack([x, z]))


def _is_mappable(domain: ModelDomain) -> bool:
    """Return whether a domain is a straight-sided section of layers whose left side is the axis."""
    is_straight = all(side.center is None for side in domain.outline)
    return (
        domain.dim == 2
        and is_straight
        and len(domain.regions) == len(domain.interfaces) + 1
        and domain.extent[0][0] == 0.0
    )


def named_surfaces(
    points: np.ndarray, cells: np.ndarray, domain: ModelDomain, finest: float
) -> dict[str, np.ndarray]:
    """Return the boundary facets on each surface of a domain.

    A facet belongs to the surface that contains all its corners; flat surfaces take precedence over
    curved ones. `finest` is the smallest element size [length].
    """
    # Coordinates are near 1 and have 12 digits; the next nodes are farther away than this.
    tolerance = min(1e-9, 1e-3 * finest)
    boundary, _ = boundary_facets(cells)
    distances = (
        [] if domain.dim == 2 else [("base", points[:, 2] + domain.height), ("top", points[:, 2])]
    )
    sides = sorted(domain.outline, key=lambda side: side.center is not None)
    distances += [(side.surface, side.distance(points[:, 0], points[:, 1])) for side in sides]
    surfaces: dict[str, np.ndarray] = {}
    for surface, distance in distances:
        is_on = (np.abs(distance) < tolerance)[boundary].all(axis=1)
        surfaces[surface] = np.concatenate([surfaces.get(surface, boundary[:0]), boundary[is_on]])
        boundary = boundary[~is_on]
    return surfaces


def regions_of_cells(points: np.ndarray, cells: np.ndarray, domain: ModelDomain) -> np.ndarray:
    """Return the number of the region (m,) that contains the centroid of each cell."""
    x, *y, z = points[cells].mean(axis=1).T
    region_numbers = len(domain.interfaces) - np.searchsorted(
        domain.interfaces, domain.interface_level(x, z)
    )
    for number, region in enumerate(domain.regions):
        if region.inclusion is not None:
            region_numbers[region.inclusion.contains((x, y[0] if y else 0.0, z))] = number
    return region_numbers.astype(np.int32)


def boundary_facets(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the facets (k, dim) that belong to a single cell, and the opposite corners (k,)."""
    boundary = [cells[:0, 1:]]
    opposite = [cells[:0, 0]]
    for facets, cell, corner in iterate_facets(cells):
        _, first, counts = np.unique(
            np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
        )
        unshared = first[counts == 1]
        boundary.append(facets[unshared])
        opposite.append(cells[cell[unshared], corner[unshared]])
    return np.concatenate(boundary), np.concatenate(opposite)


def iterate_facets(
    cells: np.ndarray, chunk_size: int = ROWS_PER_CHUNK
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield the facets (k, dim) of all cells, the cell (k,) of each and its opposite corner (k,).

    Each chunk has about `chunk_size` facets, sorted by their smallest point number, so that facets
    with the same points are in the same chunk. The opposite corner is given as its column number in
    `cells`.
    """
    m, corners = cells.shape
    smallest_corner, second_corner = np.partition(cells, 1, axis=1)[:, :2].T
    smallest_point = np.where(smallest_corner == cells.T, second_corner, smallest_corner).ravel()
    chunk_ends = np.unique(
        [*np.sort(smallest_point)[chunk_size - 1 :: chunk_size], smallest_point.max(initial=0)]
    )
    for low, high in pairwise([-1, *chunk_ends.tolist()]):
        corner, cell = np.divmod(
            np.flatnonzero((low < smallest_point) & (smallest_point <= high)), max(m, 1)
        )
        is_kept = np.arange(corners) != corner[:, None]
        yield cells[cell][is_kept].reshape(-1, corners - 1), cell, corner


def is_flat(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return a mask (m,) of cells with zero volume, e.g. triangles with three points on a line."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    # Volume of a cell over its longest edge^dim below which it counts as flat. Next to a
    # split of a side at 1e-8 of the body it is 1e-8.
    flat_cell_volume = 1e-9
    smallest_determinant = flat_cell_volume * np.abs(edges).max(axis=(1, 2)) ** points.shape[1]
    return np.asarray(np.abs(np.linalg.det(edges)) <= smallest_determinant)


def unit_normals(corners: np.ndarray) -> np.ndarray:
    """Return unit normals of segments or triangles (k, n, n), with arbitrary sign."""
    edges = corners[:, 1:] - corners[:, :1]
    is_segment = corners.shape[2] == 2
    first_edge = edges[:, 0]
    normal_vectors = (
        np.column_stack([first_edge[:, 1], -first_edge[:, 0]])
        if is_segment
        else np.cross(first_edge, edges[:, 1])
    )
    return np.asarray(normal_vectors / np.linalg.norm(normal_vectors, axis=1, keepdims=True))


def sort_and_match_rows(table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the order (k,) that sorts rows, and where a sorted row equals the next (k - 1,)."""
    order = np.lexsort(table.T)
    return order, (table[order[1:]] == table[order[:-1]]).all(axis=1)


def row_slices(count: int, chunk_size: int = ROWS_PER_CHUNK) -> Iterator[slice]:
    """Return slices that cover `count` rows, `chunk_size` at a time."""
    return (slice(start, start + chunk_size) for start in range(0, count, chunk_size))
