"""Cells, dofs and values of UFL expressions on boundary facets."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from dolfinx.mesh import Mesh
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.kernel_cache import compile_expression
from indent_sim.fe.shape_functions import barycentric


def adjacent_cells(mesh: Mesh, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cell of each boundary facet (facets,), and the facet's number in this cell."""
    dim = mesh.topology.dim
    to_cell = mesh.topology.connectivity(dim - 1, dim)
    to_facet = mesh.topology.connectivity(dim, dim - 1)
    cells = np.array([to_cell.links(facet)[0] for facet in facets], dtype=np.int32)
    pairs = zip(cells, facets, strict=True)
    local = np.array(
        [int(np.flatnonzero(to_facet.links(c) == f)[0]) for c, f in pairs], dtype=np.int32
    )
    return cells, local


def facet_nodes(mesh: Mesh, space: fem.FunctionSpace, facets: np.ndarray) -> np.ndarray:
    """Block dofs (facets, n) of a Lagrange space on each facet: vertices first, then edges."""
    dim = mesh.topology.dim
    cells, local = adjacent_cells(mesh, facets)
    layout = space.dofmap.dof_layout
    closure = np.array([layout.entity_closure_dofs(dim - 1, k) for k in range(dim + 1)])
    return compat.cell_dofs(space.dofmap)[cells[:, None], closure[local]].astype(np.int64)


def cell_heights(mesh: Mesh, facets: np.ndarray) -> np.ndarray:
    """Return the height (facets,) of each cell above its facet [length]: dim * volume/area."""
    dim = mesh.topology.dim
    cells, local = adjacent_cells(mesh, facets)
    corners = mesh.geometry.x[compat.geometry_dofs(mesh)[cells], :dim]
    apex = corners[np.arange(len(cells)), local]
    on_facet = np.array([np.delete(np.arange(dim + 1), k) for k in range(dim + 1)])[local]
    base = np.take_along_axis(corners, on_facet[:, :, None], axis=1)
    facet_edges = base[:, 1:] - base[:, :1]  # (facets, dim - 1, dim)
    apex_edge = apex - base[:, 0]
    edges = np.concatenate([facet_edges, apex_edge[:, None]], axis=1)
    area = np.sqrt(np.abs(np.linalg.det(facet_edges @ facet_edges.transpose(0, 2, 1))))
    return np.abs(np.linalg.det(edges)) / area


class FacetValues:
    """Values of a UFL expression at points of the reference facet, on facets of this rank.

    Creation is collective: every rank compiles the kernels that any rank needs, because a rank that
    does not compile would let the other ranks wait forever.

    Parameters
    ----------
    mesh : Mesh
        Mesh of the body.
    facets : ndarray of int, (facets,)
        Local numbers of boundary facets.
    expression : Expr
        UFL expression.
    points : ndarray, (points, dim - 1)
        Points of the reference facet.
    """

    def __init__(self, mesh: Mesh, facets: np.ndarray, expression: Expr, points: np.ndarray):
        self._mesh = mesh
        self._cells, self._local = adjacent_cells(mesh, facets)
        self._points = len(points)
        numbers = sorted(set().union(*mesh.comm.allgather(set(self._local.tolist()))))
        cell_corners = np.vstack([np.zeros(mesh.topology.dim), np.eye(mesh.topology.dim)])
        # Facet k of the reference cell is opposite to corner k
        points_by_facet = {
            k: barycentric(points) @ np.delete(cell_corners, k, axis=0) for k in numbers
        }
        self._compiled = {k: compile_expression(expression, points_by_facet[k]) for k in numbers}
        self._size = int(np.prod(expression.ufl_shape, dtype=int))

    def __call__(self) -> np.ndarray:
        """Evaluate the expression (facets, points, components) at the current solution."""
        values = np.zeros((len(self._cells), self._points, self._size))
        for k in np.unique(self._local):
            facet_indices = np.flatnonzero(self._local == k)
            facet_values = compat.evaluate_expression(
                self._compiled[k], self._mesh, self._cells[facet_indices]
            )
            values[facet_indices] = facet_values.reshape(
                len(facet_indices), self._points, self._size
            )
        return values
