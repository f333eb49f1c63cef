"""The body that a mesh file has, as arrays with named surfaces and regions: placed, refined, and
written out again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, combinations, islice
from typing import Any, Self

import numpy as np

from indent_sim.mesh.grid import LENGTH_DIGITS, Grid, boundary_of, lots
from indent_sim.model.body import MeshFromFile
from indent_sim.process.errors import MeshError

Middles = Mapping[tuple[int, int], np.ndarray]  # between two corners of every simplex
Between = Callable[[np.ndarray, np.ndarray], np.ndarray]  # finds that
ROWS_WRITTEN_AT_ONCE = 10**4  # rows of a file written at a time
GMSH_TYPE = {(1, 1): 1, (2, 1): 2, (3, 1): 4, (2, 2): 9, (3, 2): 11}  # by dimension and order
# an octahedron between the midpoints of a tetrahedron's edges, cut along each of its diagonals
EIGHT = {
    ((0, 1), (2, 3)): ((0, 2), (0, 3), (1, 3), (1, 2)),
    ((0, 2), (1, 3)): ((0, 1), (0, 3), (2, 3), (1, 2)),
    ((0, 3), (1, 2)): ((0, 1), (0, 2), (2, 3), (1, 3)),
}


@dataclass(frozen=True)
class Size:
    """Numbers of a whole mesh: of its cells, its points and its outer facets, and its longest edge
    [length].
    """

    cells: int
    points: int
    outside: int
    longest_edge: float


@dataclass(frozen=True)
class Piece:
    """A body as its file has it, in the file's own units and place.

    grid: with the surfaces top, base and sides, and the axis r = 0 as r_min; names: of its regions,
    in their order. middles: the midside nodes of a quadratic mesh, edges (k, 2) by their points and
    places (k, dim) [length]. first, lift, unit: the region that leads, and the height and unit
    [length of the file] of where it has been put.
    """

    grid: Grid
    names: tuple[str, ...]
    middles: tuple[np.ndarray, np.ndarray]
    hash: str  # fingerprint of all that was taken from the file
    first: int = field(default=0, kw_only=True)
    lift: float = field(default=0.0, kw_only=True)
    unit: float = field(default=1.0, kw_only=True)

    @property
    def dim(self) -> int:
        """Dimensions of the mesh."""
        return self.grid.points.shape[1]

    def text(self, source: MeshFromFile) -> Iterable[str]:
        """What was taken from the file as a file of its own, in parts; nothing on a rank that has
        not read it.
        """
        return as_msh(self, source)

    @property
    def height(self) -> float:
        """From the lowest to the highest point [length]."""
        z = self.grid.points[:, -1]
        return float(z.max() - z.min())

    @cached_property
    def size(self) -> Size:
        """How large the mesh is."""
        points = self.grid.points
        cells = self.grid.cells
        edges = (
            points[cells[:, i]] - points[cells[:, j]]
            for i, j in combinations(range(self.dim + 1), 2)
        )
        longest = max(float(np.linalg.norm(edge, axis=1).max()) for edge in edges)
        return Size(len(cells), len(points), len(boundary_of(cells)[0]), longest)

    @property
    def filled(self) -> Piece:
        """The whole of it."""
        return self

    def corners(self, surface: str) -> np.ndarray:
        """The corners of a surface's facets (k, dim, dim) [length]."""
        return self.grid.points[self.grid.surfaces[surface]]

    def led_by(self, region: int) -> Self:
        """The same with a region as the first one."""
        order = [region, *(k for k in range(len(self.names)) if k != region)]
        number = np.argsort(order).astype(np.int32)
        grid = replace(self.grid, regions=number[self.grid.regions])
        return replace(self, grid=grid, names=tuple(self.names[k] for k in order), first=region)

    def lowered(self, height: float) -> Self:
        """The same with what was at a height at z = 0 [length]."""
        return replace(
            self._placed(lambda points: points - height * np.eye(self.dim)[-1]), lift=height
        )

    def measured(self, length: float) -> Self:
        """The same in units of a length, its coordinates rounded as those of all meshes are."""
        return replace(
            self._placed(lambda points: np.round(points / length, LENGTH_DIGITS) + 0.0), unit=length
        )

    def _placed(self, place: Callable[[np.ndarray], np.ndarray]) -> Self:
        edges, middles = self.middles
        return replace(
            self,
            grid=replace(self.grid, points=place(self.grid.points)),
            middles=(edges, place(middles)),
        )


@dataclass(frozen=True)
class Skin(Piece):
    """The cells of a piece that touch its outside: all that a scene must have of it, where many
    ranks have the scene.

    numbers (n,): of its points among those of the whole piece, which rank 0 can read, as it is in
    its file.
    """

    numbers: np.ndarray
    of_whole: Size
    whole: Piece | None

    @property
    def size(self) -> Size:  # type: ignore[override]
        """How large the whole mesh is."""
        return replace(self.of_whole, longest_edge=self.of_whole.longest_edge / self.unit)

    def text(self, source: MeshFromFile) -> Iterable[str]:
        """The whole piece as a file of its own."""
        return () if self.whole is None else self.whole.text(source)

    @property
    def filled(self) -> Piece:
        """The whole piece, put where this is, with the surfaces that this has."""
        assert self.whole is not None
        whole = self.whole.led_by(self.first).lowered(self.lift).measured(self.unit)
        surfaces = {name: self.numbers[facets] for name, facets in self.grid.surfaces.items()}
        return replace(whole, grid=replace(whole.grid, surfaces=surfaces))


def skin_of(piece: Piece) -> Skin:
    """A piece as its skin, the whole with it."""
    grid = piece.grid
    (edges, places) = piece.middles
    is_outside = np.zeros(len(grid.points), dtype=bool)
    is_outside[boundary_of(grid.cells)[0]] = True
    touching = is_outside[grid.cells].any(axis=1)
    numbers, cells = np.unique(grid.cells[touching], return_inverse=True)
    cells = cells.reshape(-1, piece.dim + 1)
    surfaces = {name: np.searchsorted(numbers, facets) for name, facets in grid.surfaces.items()}
    inside = np.all(np.isin(edges, numbers), axis=1)
    inside[inside] = np.isin(
        keys_of(np.searchsorted(numbers, edges[inside])), keys_of(edges_of(cells))
    )
    middles = np.searchsorted(numbers, edges[inside]), places[inside]
    skin = Grid(grid.points[numbers], cells, grid.regions[touching], surfaces)
    return Skin(skin, piece.names, middles, piece.hash, numbers, piece.size, piece)


def halved(piece: Piece) -> Piece:
    """The piece with every edge halved: a triangle becomes four, a tetrahedron eight (Bey 1995,
    Computing 55, 355).

    The new points are the midside nodes of a quadratic mesh where it has any, else the middles of
    the edges. MeshError where a midside node turns a cell inside out.
    """
    grid = piece.grid
    edges = edges_of(piece.grid.cells)
    (given, places) = piece.middles
    count = len(grid.points)
    middles = grid.points[edges].mean(axis=1)
    middles[np.searchsorted(keys_of(edges), keys_of(given))] = places

    def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return count + np.searchsorted(
            keys_of(edges), keys_of(np.sort(np.column_stack([a, b]), axis=1))
        )

    points = np.vstack([grid.points, middles])
    straight = np.vstack([grid.points, grid.points[edges].mean(axis=1)])
    cells = _split(straight, grid.cells, between)
    if (_volumes(points, cells) * _volumes(straight, cells) <= 0).any():
        raise MeshError("the midside nodes of the mesh turn cells inside out: it cannot be refined")
    surfaces = {name: _split(straight, facets, between) for name, facets in grid.surfaces.items()}
    regions = np.tile(grid.regions, 2**piece.dim)
    grid = Grid(points, righted(points, cells), regions, surfaces)
    return replace(piece, grid=grid, middles=(given[:0], places[:0]))


def _split(points: np.ndarray, simplices: np.ndarray, between: Between) -> np.ndarray:
    """The parts of segments, triangles or tetrahedra, all first ones first."""
    outer, middle = parts_of(list(simplices.T), between)
    return outer if len(simplices.T) < 4 else np.concatenate([outer, *_octahedra(points, middle)])


def parts_of(corners: Sequence[np.ndarray], between: Between) -> tuple[np.ndarray, Middles]:
    """The halves of segments, the quarters of triangles, or the outer parts of tetrahedra, by their
    corners (k, ...) and what is between two of them; and what is between.
    """
    n = len(corners)
    middle = {(i, j): between(corners[i], corners[j]) for i, j in combinations(range(n), 2)}
    parts = [
        [c, *(middle[min(i, j), max(i, j)] for j in range(n) if j != i)]
        for i, c in enumerate(corners)
    ]
    inner = [list(middle.values())] if n == 3 else []
    return np.concatenate([np.stack(part, axis=1) for part in parts + inner]), middle


def _octahedra(points: np.ndarray, middle: Middles) -> list[np.ndarray]:
    """Four tetrahedra (m, 4) in the middle of each one, around the shortest diagonal."""
    lengths = [np.linalg.norm(points[middle[a]] - points[middle[b]], axis=1) for a, b in EIGHT]
    shortest = np.argmin(lengths, axis=0)

    def around(k: int) -> list[list[np.ndarray]]:
        return [
            [middle[a], middle[b], middle[ring[k]], middle[ring[(k + 1) % 4]]]
            for (a, b), ring in EIGHT.items()
        ]

    return [np.choose(shortest, around(k)).T for k in range(4)]


def edges_of(cells: np.ndarray) -> np.ndarray:
    """The edges (k, 2) of simplices, each once, by their points in order."""
    pairs = combinations(range(cells.shape[1]), 2)
    return np.unique(
        np.sort(np.concatenate([cells[:, list(pair)] for pair in pairs]), axis=1), axis=0
    )


def keys_of(edges: np.ndarray) -> np.ndarray:
    """One number for every edge, in their order (k,)."""
    return np.asarray((edges[:, 0] << 32) + edges[:, 1])


def righted(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """The same cells, all of positive volume by the order of their corners."""
    turned = _volumes(points, cells) < 0
    cells = cells.copy()
    cells[turned, -2:] = cells[turned][:, :-3:-1]
    return cells


def _volumes(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Volumes of cells (m,), but for a factor; negative where their corners go round the other way."""
    found = [
        np.linalg.det(points[cells[some, 1:]] - points[cells[some, :1]])
        for some in lots(len(cells))
    ]
    return np.concatenate([np.empty(0), *found])


def as_msh(piece: Piece, source: MeshFromFile) -> Iterator[str]:
    """What was taken from a file as text in gmsh's format 2.2, which reads as the same piece to the
    last digit.

    It comes in parts: all of it is several times as long as the arrays.
    """
    dim = piece.dim
    grid = piece.grid
    edges, places = piece.middles
    named = {"top": source.named.contact, "base": source.named.base, "sides": source.named.sides}
    facets = [
        (str(named[surface]), found) for surface, found in grid.surfaces.items() if surface in named
    ]
    names = [(dim - 1, name) for name, _ in facets] + [(dim, name) for name in piece.names if name]
    tags = {name: k + 1 for k, name in enumerate(names)}
    regions = np.array([tags.get((dim, name), 0) for name in piece.names])
    kind = GMSH_TYPE[dim, 2 if len(edges) else 1]

    def with_middles(cells: np.ndarray) -> np.ndarray:
        if len(edges) == 0:
            return cells
        # in the order of gmsh, numbered after the points
        order = ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3))[: 3 if dim == 2 else 6]
        ends = (np.sort(cells[:, list(pair)], axis=1) for pair in order)
        nodes = [len(grid.points) + np.searchsorted(keys_of(edges), keys_of(pair)) for pair in ends]
        return np.column_stack([cells, *nodes])

    def nodes() -> Iterator[str]:
        for k, place in enumerate(chain(_in_lots(grid.points), _in_lots(places))):
            yield f"{k + 1} {' '.join(map(repr, (*place, 0.0)[:3]))}"

    def elements() -> Iterator[str]:
        on_facets = (
            (GMSH_TYPE[dim - 1, 1], tags[dim - 1, name], row)
            for name, found in facets
            for row in found
        )
        rows = _in_lots(grid.cells, with_middles)
        in_cells = (
            (kind, tag, row)
            for tag, row in zip(_in_lots(grid.regions, regions.take), rows, strict=True)
        )
        for k, (of, tag, row) in enumerate(chain(on_facets, in_cells)):
            yield f"{k + 1} {of} 2 {tag} 1 {' '.join(str(node + 1) for node in row)}"

    physical = (f'{of} {tags[of, name]} "{name}"' for of, name in names)
    count = sum(len(found) for _, found in facets) + len(grid.cells)
    yield "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
    yield from _section("PhysicalNames", len(names), physical)
    yield from _section("Nodes", len(grid.points) + len(places), nodes())
    yield from _section("Elements", count, elements())


def _section(name: str, count: int, lines: Iterator[str]) -> Iterator[str]:
    yield f"${name}\n{count}\n"
    while some := list(islice(lines, ROWS_WRITTEN_AT_ONCE)):
        yield "\n".join(some) + "\n"
    yield f"$End{name}\n"


def _in_lots(
    rows: np.ndarray, made: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> Iterator[Any]:
    """The rows of an array, or what is made of some of them at a time, as Python's numbers."""
    for some in lots(len(rows), ROWS_WRITTEN_AT_ONCE):
        yield from made(rows[some]).tolist()
