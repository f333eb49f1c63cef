"""The body that a mesh file has, as arrays with named surfaces and regions: placed, refined, and written out again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from indent_sim.mesh.grid import DIGITS, Grid
from indent_sim.model.body import MeshFromFile
from indent_sim.process.errors import MeshError

GMSH_TYPE = {(1, 1): 1, (2, 1): 2, (3, 1): 4, (2, 2): 9, (3, 2): 11}  # by dimension and order
EIGHT = {  # an octahedron between the midpoints of a tetrahedron's edges, cut along each of its diagonals
    ((0, 1), (2, 3)): ((0, 2), (0, 3), (1, 3), (1, 2)),
    ((0, 2), (1, 3)): ((0, 1), (0, 3), (2, 3), (1, 2)),
    ((0, 3), (1, 2)): ((0, 1), (0, 2), (2, 3), (1, 3)),
}


@dataclass(frozen=True)
class Piece:
    """A body as its file has it, in the file's own units and place.

    grid: with the surfaces top, base and sides, and the axis r = 0 as r_min; names: of its regions, in their order.
    middles: the midside nodes of a quadratic mesh, edges (k, 2) by their points and places (k, dim) [length].
    """

    grid: Grid
    names: tuple[str, ...]
    middles: tuple[np.ndarray, np.ndarray]
    hash: str  # fingerprint of all that was taken from the file

    @property
    def dim(self) -> int:
        """Dimensions of the mesh."""
        return self.grid.points.shape[1]

    @property
    def height(self) -> float:
        """From the lowest to the highest point [length]."""
        z = self.grid.points[:, -1]
        return float(z.max() - z.min())

    def corners(self, surface: str) -> np.ndarray:
        """The corners of a surface's facets (k, dim, dim) [length]."""
        return self.grid.points[self.grid.surfaces[surface]]

    def led_by(self, region: int) -> Piece:
        """The same with a region as the first one."""
        order = [region, *(k for k in range(len(self.names)) if k != region)]
        number = np.argsort(order).astype(np.int32)
        grid = replace(self.grid, regions=number[self.grid.regions])
        return replace(self, grid=grid, names=tuple(self.names[k] for k in order))

    def lowered(self, height: float) -> Piece:
        """The same with what was at a height at z = 0 [length]."""
        return self._placed(lambda points: points - height * np.eye(self.dim)[-1])

    def measured(self, length: float) -> Piece:
        """The same in units of a length, its coordinates rounded as those of all meshes are."""
        return self._placed(lambda points: np.round(points / length, DIGITS) + 0.0)

    def _placed(self, place: Callable[[np.ndarray], np.ndarray]) -> Piece:
        edges, middles = self.middles
        return replace(self, grid=replace(self.grid, points=place(self.grid.points)), middles=(edges, place(middles)))


def halved(piece: Piece) -> Piece:
    """The piece with every edge halved: a triangle becomes four, a tetrahedron eight (Bey 1995, Computing 55, 355).

    The new points are the midside nodes of a quadratic mesh where it has any, else the middles of the edges. MeshError
    where a midside node turns a cell inside out.
    """
    grid, edges, (given, places) = piece.grid, edges_of(piece.grid.cells), piece.middles
    count, middles = len(grid.points), grid.points[edges].mean(axis=1)
    middles[np.searchsorted(keys_of(edges), keys_of(given))] = places

    def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return count + np.searchsorted(keys_of(edges), keys_of(np.sort(np.column_stack([a, b]), axis=1)))

    points, straight = np.vstack([grid.points, middles]), np.vstack([grid.points, grid.points[edges].mean(axis=1)])
    cells = _split(straight, grid.cells, between)
    if (_volumes(points, cells) * _volumes(straight, cells) <= 0).any():
        raise MeshError("the midside nodes of the mesh turn cells inside out: it cannot be refined")
    surfaces = {name: _split(straight, facets, between) for name, facets in grid.surfaces.items()}
    regions = np.tile(grid.regions, 2**piece.dim)
    grid = Grid(points, righted(points, cells), regions, surfaces)
    return replace(piece, grid=grid, middles=(given[:0], places[:0]))


def _split(points: np.ndarray, simplices: np.ndarray, between: Callable[[np.ndarray, np.ndarray], np.ndarray]
           ) -> np.ndarray:  # fmt: skip
    """The parts of segments, triangles or tetrahedra, all first ones first."""
    corners = simplices.T
    middle = {(i, j): between(corners[i], corners[j]) for i, j in combinations(range(len(corners)), 2)}
    parts = [[c, *(middle[min(i, j), max(i, j)] for j in range(len(corners)) if j != i)] for i, c in enumerate(corners)]
    if len(corners) == 3:
        parts.append(list(middle.values()))
    outer = np.concatenate([np.stack(part, axis=1) for part in parts])
    return outer if len(corners) < 4 else np.concatenate([outer, *_octahedra(points, middle)])


def _octahedra(points: np.ndarray, middle: Mapping[tuple[int, int], np.ndarray]) -> list[np.ndarray]:
    """Four tetrahedra (m, 4) in the middle of each one, around the shortest diagonal."""
    lengths = [np.linalg.norm(points[middle[a]] - points[middle[b]], axis=1) for a, b in EIGHT]
    shortest = np.argmin(lengths, axis=0)
    found = []
    for k in range(4):
        options = [[middle[a], middle[b], middle[ring[k]], middle[ring[(k + 1) % 4]]] for (a, b), ring in EIGHT.items()]
        found.append(np.choose(shortest, options).T)
    return found


def edges_of(cells: np.ndarray) -> np.ndarray:
    """The edges (k, 2) of simplices, each once, by their points in order."""
    pairs = combinations(range(cells.shape[1]), 2)
    return np.unique(np.sort(np.concatenate([cells[:, list(pair)] for pair in pairs]), axis=1), axis=0)


def keys_of(edges: np.ndarray) -> np.ndarray:
    """One number for every edge, in their order (k,)."""
    return np.asarray((edges[:, 0] << 32) + edges[:, 1])


def righted(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """The same cells, all of positive volume by the order of their corners."""
    turned, cells = _volumes(points, cells) < 0, cells.copy()
    cells[turned, -2:] = cells[turned][:, :-3:-1]
    return cells


def _volumes(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Volumes of cells (m,), but for a factor; negative where their corners go round the other way."""
    corners = points[cells]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]))


def as_msh(piece: Piece, source: MeshFromFile) -> str:
    """What was taken from a file as text in gmsh's format 2.2, which reads as the same piece to the last digit."""
    dim, grid = piece.dim, piece.grid
    edges, places = piece.middles
    points = np.pad(np.vstack([grid.points, places]), ((0, 0), (0, 3 - dim)))
    named = {"top": source.surfaces.contact, "base": source.surfaces.base, "sides": source.surfaces.sides}
    facets = [(str(named[surface]), found) for surface, found in grid.surfaces.items() if surface in named]
    names = [(dim - 1, name) for name, _ in facets] + [(dim, name) for name in piece.names if name]
    tags = {name: k + 1 for k, name in enumerate(names)}
    elements = [(GMSH_TYPE[dim - 1, 1], tags[dim - 1, name], row) for name, found in facets for row in found]
    kind = GMSH_TYPE[dim, 2 if len(edges) else 1]
    rows = grid.cells if len(edges) == 0 else np.hstack([grid.cells, _nodes_on(grid.cells, edges, len(grid.points))])
    regions = [tags.get((dim, name), 0) for name in piece.names]
    elements += [(kind, regions[region], row) for region, row in zip(grid.regions, rows, strict=True)]
    sections = {
        "MeshFormat": ["2.2 0 8"],
        "PhysicalNames": [str(len(names)), *(f'{of} {tags[of, name]} "{name}"' for of, name in names)],
        "Nodes": [str(len(points)), *(f"{k + 1} {x!r} {y!r} {z!r}" for k, (x, y, z) in enumerate(points.tolist()))],
        "Elements": [str(len(elements)), *(f"{k + 1} {of} 2 {tag} 1 {' '.join(map(str, row + 1))}"
                                           for k, (of, tag, row) in enumerate(elements))],
    }  # fmt: skip
    return "".join(f"${name}\n" + "\n".join(lines) + f"\n$End{name}\n" for name, lines in sections.items())


def _nodes_on(cells: np.ndarray, edges: np.ndarray, count: int) -> np.ndarray:
    """The midside nodes of every cell in the order of gmsh (m, edges of a cell), numbered after the points."""
    order = ((0, 1), (1, 2), (0, 2)) if cells.shape[1] == 3 else ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3))
    ends = [np.sort(cells[:, list(pair)], axis=1) for pair in order]
    return np.column_stack([count + np.searchsorted(keys_of(edges), keys_of(pair)) for pair in ends])
