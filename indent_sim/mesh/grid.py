"""A simplex mesh as arrays, with its named surfaces."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from indent_sim.mesh.modelled_part import Part

# volume of a cell over length^dim, less is none: beside a split at 1e-8 of the body it is 1e-8
FLAT_CELL_VOLUME = 1e-9
AROUND = 2.0  # contact radii that a mesh is moved with as a whole
# lengths are rounded to this many digits, so that a scene in nm and in m gives the same mesh
LENGTH_DIGITS = 12
ROWS_AT_ONCE = (
    10**6
)  # rows worked on at a time: what they take then is little beside what a solver takes


@dataclass(frozen=True)
class Grid:
    """A simplex mesh as arrays: points (n, dim) [length of the scene], cells (m, dim + 1); by which
    gmsh.

    surfaces: the facets (k, dim) of each named surface, by their points; regions (m,): each cell's
    region.
    """

    points: np.ndarray
    cells: np.ndarray
    regions: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int32), repr=False)
    surfaces: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    gmsh: str = ""

    @property
    def hash(self) -> str:
        """Fingerprint of the mesh, for the record of a run; not all of it in memory at a time."""
        digest = hashlib.sha256()
        for some in lots(len(self.points)):
            digest.update(np.round(self.points[some], decimals=LENGTH_DIGITS).tobytes())
        for some in lots(len(self.cells)):
            digest.update(np.ascontiguousarray(self.cells[some]).tobytes())
        return digest.hexdigest()[:16]


def moved(grid: Grid, part: Part, onto: Part, radii: tuple[float, ...]) -> Grid | None:
    """The mesh of one part moved onto another, with its sides, the interfaces of its layers and the
    edge of the contact, which has the `radii` in the one and in the other [length].

    None where that is no map: both must be sections of straight sides and of layers, their tip's
    axis the left one.
    """
    if not (_is_plain(part) and _is_plain(onto) and len(part.outline) == len(onto.outline)):
        return None
    (left, right), (bottom, top) = part.extent
    (new_left, new_right), (new_bottom, new_top) = onto.extent
    a = radii[0]
    beyond = min(AROUND, (1 + right / a) / 2) if 0 < a < right else 0.0
    edge, new_edge = ([beyond * radius] if beyond else [] for radius in radii)
    x = np.interp(grid.points[:, 0], [left, *edge, right], [new_left, *new_edge, new_right])
    levels, new_levels = (
        [low, *sorted(one.interfaces), high]
        for low, one, high in ((bottom, part, top), (new_bottom, onto, new_top))
    )
    z = np.interp(grid.points[:, 1], levels, new_levels)
    return replace(grid, points=np.column_stack([x, z]))


def _is_plain(part: Part) -> bool:
    """Whether a part is a section of straight sides and of layers, its tip's axis the left one."""
    is_straight = all(side.middle is None for side in part.outline)
    return (
        part.dim == 2
        and is_straight
        and len(part.regions) == len(part.interfaces) + 1
        and part.extent[0][0] == 0.0
    )


def named_surfaces(
    points: np.ndarray, cells: np.ndarray, part: Part, finest: float
) -> dict[str, np.ndarray]:
    """The boundary facets on each surface of a part meshed with elements down to `finest` [length].

    A facet belongs to the surface that holds all its corners, to a flat one rather than to a curved
    one.
    """
    near = min(
        1e-9, 1e-3 * finest
    )  # of coordinates near 1 with 12 digits; less than from a surface to the next nodes
    boundary, _ = boundary_of(cells)
    distances = (
        [] if part.dim == 2 else [("base", points[:, 2] + part.height), ("top", points[:, 2])]
    )
    sides = sorted(part.outline, key=lambda side: side.middle is not None)
    distances += [(side.surface, side.distance(points[:, 0], points[:, 1])) for side in sides]
    found: dict[str, np.ndarray] = {}
    for surface, distance in distances:
        is_on = (np.abs(distance) < near)[boundary].all(axis=1)
        found[surface] = np.concatenate([found.get(surface, boundary[:0]), boundary[is_on]])
        boundary = boundary[~is_on]
    return found


def regions_of_cells(points: np.ndarray, cells: np.ndarray, part: Part) -> np.ndarray:
    """The number of the region that holds each cell's centroid (m,)."""
    x, *y, z = points[cells].mean(axis=1).T
    found = len(part.interfaces) - np.searchsorted(part.interfaces, part.level(x, z))
    for number, region in enumerate(part.regions):
        if region.inclusion is not None:
            found[region.inclusion.holds((x, y[0] if y else 0.0, z))] = number
    return found.astype(np.int32)


def boundary_of(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The facets (k, dim) that belong to one cell only, and the corner (k,) of that cell that is
    not on it.
    """
    found = [cells[:0, 1:]]
    opposite = [cells[:0, 0]]
    for facets, cell, corner in facets_of(cells):
        _, first, counts = np.unique(
            np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
        )
        alone = first[counts == 1]
        found.append(facets[alone])
        opposite.append(cells[cell[alone], corner[alone]])
    return np.concatenate(found), np.concatenate(opposite)


def facets_of(
    cells: np.ndarray, lot: int = ROWS_AT_ONCE
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The facets (k, dim) of all cells, with the cell (k,) of each and the corner (k,) of that
    which it leaves out.

    About a `lot` of them at a time, by their smallest point: those of the same points come
    together.
    """
    m, corners = cells.shape
    first, second = np.partition(cells, 1, axis=1)[:, :2].T
    least = np.where(first == cells.T, second, first).ravel()
    ends = np.unique([*np.sort(least)[lot - 1 :: lot], least.max(initial=0)])
    for low, high in pairwise([-1, *ends.tolist()]):
        corner, cell = np.divmod(np.flatnonzero((low < least) & (least <= high)), max(m, 1))
        kept = np.arange(corners) != corner[:, None]
        yield cells[cell][kept].reshape(-1, corners - 1), cell, corner


def is_flat(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Which cells have no volume (m,), as a triangle on three points of a straight side."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    least = FLAT_CELL_VOLUME * np.abs(edges).max(axis=(1, 2)) ** points.shape[1]
    return np.asarray(np.abs(np.linalg.det(edges)) <= least)


def normals(corners: np.ndarray) -> np.ndarray:
    """The unit normals of segments or triangles (k, n, n), on either side."""
    edges = corners[:, 1:] - corners[:, :1]
    is_segment = corners.shape[2] == 2
    first = edges[:, 0]
    found = (
        np.column_stack([first[:, 1], -first[:, 0]]) if is_segment else np.cross(first, edges[:, 1])
    )
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def same_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of rows, in ascending order of them, and which of these (k - 1,) hold the same as
    the next.
    """
    order = np.lexsort(rows.T)
    return order, (rows[order[1:]] == rows[order[:-1]]).all(axis=1)


def lots(count: int, lot: int = ROWS_AT_ONCE) -> Iterator[slice]:
    """Slices of so many rows, a `lot` at a time."""
    return (slice(begin, begin + lot) for begin in range(0, count, lot))
