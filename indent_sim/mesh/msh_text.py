"""Text of a mesh file in gmsh's format 2.2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain, islice
from typing import Any

import numpy as np

from indent_sim.mesh.grid import Grid, row_slices
from indent_sim.mesh.simplices import edge_keys
from indent_sim.model.imported_body import MeshSurfaces

# Number of lines of text that are held in memory while a file is written.
ROWS_WRITTEN_AT_ONCE = 10**4
# Element types of gmsh, by dimension and order.
GMSH_TYPE = {(1, 1): 1, (2, 1): 2, (3, 1): 4, (2, 2): 9, (3, 2): 11}


def msh_text_parts(
    grid: Grid,
    region_names: tuple[str, ...],
    midside_nodes: tuple[np.ndarray, np.ndarray],
    surface_names: MeshSurfaces,
) -> Iterator[str]:
    """Generate the text of a mesh in gmsh's format 2.2.

    Coordinates are written with all digits, so that reading the text gives the same mesh. The text
    is generated in parts, because as a whole it takes several times the memory of the arrays.

    Parameters
    ----------
    grid : Grid
        The mesh with the surfaces top, base and sides.
    region_names : tuple of str
        Names of the regions; "" for cells of no named region.
    midside_nodes : tuple of numpy.ndarray
        Midside nodes of a quadratic mesh: point numbers (k, 2) of their edges, and coordinates (k,
        dim).
    surface_names : MeshSurfaces
        Names of the surfaces in the file.

    Yields
    ------
    str
        The next lines of the file.
    """
    dim = grid.points.shape[1]
    edges, midside_positions = midside_nodes
    names = {
        "top": surface_names.contact,
        "base": surface_names.base,
        "sides": surface_names.sides,
    }
    facets = [
        (str(names[surface]), surface_facets)
        for surface, surface_facets in grid.surfaces.items()
        if surface in names
    ]
    named_groups = [(dim - 1, name) for name, _ in facets] + [
        (dim, name) for name in region_names if name
    ]
    tags = {name: k + 1 for k, name in enumerate(named_groups)}
    regions = np.array([tags.get((dim, name), 0) for name in region_names])
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
    """Generate the text of a section of a gmsh file, including the number of lines."""
    yield f"${name}\n{count}\n"
    while chunk := list(islice(lines, ROWS_WRITTEN_AT_ONCE)):
        yield "\n".join(chunk) + "\n"
    yield f"$End{name}\n"


def _iterate_rows(
    rows: np.ndarray, convert: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> Iterator[Any]:
    """Generate the rows of an array as lists of Python numbers, in chunks to save memory."""
    for chunk in row_slices(len(rows), ROWS_WRITTEN_AT_ONCE):
        yield from convert(rows[chunk]).tolist()
