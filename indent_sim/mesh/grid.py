"""A simplex mesh as arrays, with its named surfaces."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from indent_sim.mesh.part import Part

DIGITS = 12  # lengths are rounded to this many digits, so that a scene in nm and in m gives the same mesh
ON_SURFACE = 1e-9  # of a body whose coordinates are near 1 and rounded to 12 digits
LOT = 10**6  # rows worked on at a time: what they take then is little beside what a solver takes
OF_ELEMENT = 1e-3  # the smallest: less than what lies between a surface and the next nodes


@dataclass(frozen=True)
class Grid:
    """A simplex mesh as arrays: points (n, dim) [length of the scene], cells (m, dim + 1); by which gmsh.

    surfaces: the facets (k, dim) of each named surface, by their points; regions (m,): each cell's region.
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
        for table, to_digits in ((self.points, partial(np.round, decimals=DIGITS)), (self.cells, np.ascontiguousarray)):
            for some in lots(len(table)):
                digest.update(to_digits(table[some]).tobytes())
        return digest.hexdigest()[:16]


def named_surfaces(points: np.ndarray, cells: np.ndarray, part: Part, finest: float) -> dict[str, np.ndarray]:
    """The boundary facets on each surface of a part meshed with elements down to `finest` [length].

    A facet belongs to the surface that holds all its corners, to a flat one rather than to a curved one.
    """
    near = min(ON_SURFACE, OF_ELEMENT * finest)
    boundary, _ = boundary_of(cells)
    found: dict[str, np.ndarray] = {}
    for surface, distance in _distances(points, part):
        is_on = (distance < near)[boundary].all(axis=1)
        found[surface] = np.concatenate([found.get(surface, boundary[:0]), boundary[is_on]])
        boundary = boundary[~is_on]
    return found


def regions_of_cells(points: np.ndarray, cells: np.ndarray, part: Part) -> np.ndarray:
    """The number of the region that holds each cell's centroid (m,)."""
    x, *y, z = points[cells].mean(axis=1).T
    found = len(part.interfaces) - np.searchsorted(part.interfaces, z)
    for number, region in enumerate(part.regions):
        if region.inclusion is not None:
            found[region.inclusion.holds((x, y[0] if y else 0.0, z))] = number
    return found.astype(np.int32)


def _distances(points: np.ndarray, part: Part) -> list[tuple[str, np.ndarray]]:
    """Each surface and the distance of all points to it, flat ones first [length]."""
    ends = [] if part.dim == 2 else [("base", np.abs(points[:, 2] + part.height)), ("top", np.abs(points[:, 2]))]
    sides = sorted(part.outline, key=lambda side: side.middle is not None)
    return ends + [(side.surface, side.distance(points[:, 0], points[:, 1])) for side in sides]


def boundary_of(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The facets (k, dim) that belong to one cell only, and the corner (k,) of that cell that is not on it."""
    found, opposite = [cells[:0, 1:]], [cells[:0, 0]]
    for facets, cell, corner in facets_of(cells):
        _, first, counts = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
        alone = first[counts == 1]
        found.append(facets[alone])
        opposite.append(cells[cell[alone], corner[alone]])
    return np.concatenate(found), np.concatenate(opposite)


def facets_of(cells: np.ndarray, lot: int = LOT) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The facets (k, dim) of all cells, with the cell (k,) of each and the corner (k,) of that which it leaves out.

    About a `lot` of them at a time, by their smallest point: those of the same points come together.
    """
    m, corners = cells.shape
    first, second = np.partition(cells, 1, axis=1)[:, :2].T
    least = np.where(first == cells.T, second, first).ravel()
    ends = np.unique([*np.sort(least)[lot - 1 :: lot], least.max(initial=0)])
    for low, high in pairwise([-1, *ends.tolist()]):
        corner, cell = np.divmod(np.flatnonzero((low < least) & (least <= high)), max(m, 1))
        kept = np.arange(corners) != corner[:, None]
        yield cells[cell][kept].reshape(-1, corners - 1), cell, corner


def lots(count: int, lot: int = LOT) -> Iterator[slice]:
    """Slices of so many rows, a `lot` at a time."""
    return (slice(begin, begin + lot) for begin in range(0, count, lot))
