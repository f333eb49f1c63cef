"""The contact surface in numpy: traces of fields on its facets, for measuring results.

The solver integrates over this surface with UFL; what is measured afterwards (contact radius, peak
pressure, penetration, the surface table) is evaluated here from the dofs on the facets, at any
points.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache

import numpy as np
from dolfinx import fem
from dolfinx.mesh import Mesh
from ufl.core.expr import Expr

from indent_sim.fe import compat

QUADRATURE_DEGREE = {
    2: 20,
    3: 10,
}  # by dimension: 11 points an edge, 25 a triangle, for the kink at the contact edge
MIDPOINT_VERTICES = {
    2: ((0, 1),),
    3: ((1, 2), (0, 2), (0, 1)),
}  # of a facet's vertices, between which its midpoints are
SUBDIVISIONS = {2: 32, 3: 8}  # of a facet edge, to find the contact edge inside it


def barycentric(points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (points, vertices) of points (n, 1) or (n, 2) of the unit interval or
    triangle.
    """
    return np.column_stack([1 - points.sum(axis=1), points])


def shape_functions(points: np.ndarray) -> np.ndarray:
    """Quadratic shape functions (points, nodes) on a facet; vertices first, then edge midpoints
    opposite them.
    """
    return _cached_shape_functions(points.tobytes(), points.shape[1])


@lru_cache(maxsize=64)  # every row is read off at the same points
def _cached_shape_functions(point_bytes: bytes, columns: int) -> np.ndarray:
    bary = barycentric(np.frombuffer(point_bytes).reshape(-1, columns))
    vertices = bary * (2 * bary - 1)
    values = np.column_stack(
        [vertices, *(4 * bary[:, i] * bary[:, j] for i, j in MIDPOINT_VERTICES[bary.shape[1]])]
    )
    values.flags.writeable = False
    return values


def pressure_shape_functions(points: np.ndarray) -> np.ndarray:
    """Functions (points, nodes) of the nodal pressures p_i >= 0 of a facet, which sum to one and
    are never negative.

    On an edge the hats of all its nodes, piecewise linear between them. On a triangle those of its
    vertices alone, zero for the midpoints: the integral of a quadratic displacement's vertex
    function is zero there, so that a pressure at every node would be known only up to a ripple.
    """
    vertices = barycentric(points)
    if points.shape[1] == 2:
        return np.pad(vertices, ((0, 0), (0, 3)))
    ends = np.maximum(2 * vertices - 1, 0.0)
    return np.column_stack([ends, 1 - ends.sum(axis=1)])


def interpolate_from_midpoints(
    nodal: np.ndarray, sum_over_facets: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """A quadratic multiplier (facets, nodes) of triangles with each vertex value from the midpoints
    next to it.

    The integral of a triangle's vertex function is zero, so a multiplier ripples there and is right
    at the midpoints. The mean of the midpoints on the edges that meet in a vertex is exact for a
    constant. `sum_over_facets` sums contributions (facets, nodes) over the facets that share a node.
    """
    midpoints = nodal[:, 3:]
    means = np.zeros_like(nodal)
    ones = np.zeros_like(nodal)
    means[:, :3] = (midpoints.sum(axis=1, keepdims=True) - midpoints) / 2
    ones[:, :3] = 1.0
    return np.hstack([sum_over_facets(means)[:, :3] / sum_over_facets(ones)[:, :3], midpoints])


@cache
def split_quadrature(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights on the reference facet, a rule for each part on which `pressure_shape_functions`
    are smooth.
    """
    if dim == 3:
        return contact_quadrature(dim)
    points, weights = compat.quadrature_rule("interval", 12)
    return np.vstack([points / 2, (points + 1) / 2]), np.concatenate([weights, weights]) / 2


@cache
def facet_lattice(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Equally spaced points on the reference facet and the small simplices between them."""
    n = SUBDIVISIONS[dim]
    if dim == 2:
        return np.linspace(0, 1, n + 1)[:, None], np.column_stack(
            [np.arange(n), np.arange(1, n + 1)]
        )
    index = {
        place: k for k, place in enumerate((i, j) for i in range(n + 1) for j in range(n + 1 - i))
    }
    upward = [(index[i, j], index[i + 1, j], index[i, j + 1]) for i, j in index if i + j < n]
    downward = [
        (index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for i, j in index if i + j < n - 1
    ]
    return np.array(list(index), dtype=float) / n, np.array(upward + downward)


@cache
def contact_quadrature(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """The contact quadrature points and weights on the reference facet."""
    return compat.quadrature_rule({2: "interval", 3: "triangle"}[dim], QUADRATURE_DEGREE[dim])


@cache
def node_points(dim: int) -> np.ndarray:
    """Reference-facet coordinates of the nodes."""
    corners = np.vstack([np.zeros(dim - 1), np.eye(dim - 1)])
    return np.vstack([corners, *((corners[i] + corners[j]) / 2 for i, j in MIDPOINT_VERTICES[dim])])


@cache
def evaluation_points(dim: int) -> np.ndarray:
    """The points at which a row is read off: those of the lattice, of the contact quadrature, and
    the nodes.
    """
    return np.vstack([facet_lattice(dim)[0], contact_quadrature(dim)[0], node_points(dim)])


@dataclass(frozen=True)
class Trace:
    """The facets of the contact surface on this rank and the dofs on them. nodes (facets, n) block
    dofs, X (facets, n, dim) their coordinates [length], dofs (facets, n, dim) indices into the
    solution's local array.
    """

    nodes: np.ndarray
    X: np.ndarray
    dofs: np.ndarray
    _cached: dict[tuple[str, bytes], tuple[Hashable, np.ndarray]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def dim(self) -> int:
        """Space dimension."""
        return self.X.shape[2]

    def select_facets(self, is_chosen: np.ndarray) -> Trace:
        """Those of the facets that are chosen."""
        return Trace(self.nodes[is_chosen], self.X[is_chosen], self.dofs[is_chosen])

    def join(self, second: Trace) -> Trace:
        """These facets and others of the same body."""
        pairs = ((self.nodes, second.nodes), (self.X, second.X), (self.dofs, second.dofs))
        return Trace(*(np.concatenate(pair) for pair in pairs))

    @property
    def has_ripples(self) -> bool:
        """Whether a multiplier of these nodes has vertex functions without integral (see
        `interpolate_from_midpoints`).
        """
        return self.dim == 3

    @cached_property
    def facet_sizes(self) -> np.ndarray:
        """Length of each facet, of a triangle that of the equilateral one with its area (facets,)
        [length].
        """
        edges = self.X[:, 1 : self.dim] - self.X[:, :1]
        squares = np.linalg.det(edges @ np.swapaxes(edges, 1, 2))
        return np.sqrt(squares) if self.dim == 2 else np.sqrt(2 / np.sqrt(3) * np.sqrt(squares))

    def positions(self, points: np.ndarray) -> np.ndarray:
        """Reference coordinates (facets, points, dim) [length], which stay what they are."""
        return self.cached_values(
            "positions",
            None,
            points,
            lambda: np.einsum("pn,fnd->fpd", shape_functions(points), self.X),
        )

    def cached_values(
        self,
        quantity: str,
        dependency: Hashable,
        points: np.ndarray,
        compute: Callable[[], np.ndarray],
    ) -> np.ndarray:
        """What is found once at points, and stays what it is; of the last thing that was asked for."""
        key = quantity, points.tobytes()
        if key not in self._cached or self._cached[key][0] != dependency:
            values = compute()
            values.flags.writeable = False
            self._cached[key] = dependency, values
        return self._cached[key][1]

    def interpolate(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        """A nodal field (facets, n, components) at points: (facets, points, components)."""
        return shape_functions(points) @ nodal

    def tangents(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Derivatives (facets, points, dim, facet dim) of a nodal field along the facet's
        coordinates.
        """
        step = 1e-3  # central differences are exact for quadratics
        shifts = step * np.eye(points.shape[1])
        slopes = np.stack(
            [
                (shape_functions(points + by) - shape_functions(points - by)) / (2 * step)
                for by in shifts
            ],
            axis=-1,
        )
        return np.einsum("pnk,fnd->fpdk", slopes, nodal)

    def measures(self, points: np.ndarray) -> np.ndarray:
        """Length or area (facets, points) per length or area of the reference facet."""
        tangents = self.tangents(self.X, points)
        return np.sqrt(np.linalg.det(np.einsum("fpdi,fpdj->fpij", tangents, tangents)))

    def node_points(self) -> np.ndarray:
        """Reference-facet coordinates of the nodes themselves."""
        return node_points(self.dim)


def adjacent_cells(mesh: Mesh, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cell behind each boundary facet, and the facet's local number in it."""
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
    """Block dofs (facets, n) of a Lagrange space on the closure of each facet, vertices first, then
    edges.
    """
    dim = mesh.topology.dim
    cells, local = adjacent_cells(mesh, facets)
    layout = space.dofmap.dof_layout
    closure = np.array([layout.entity_closure_dofs(dim - 1, k) for k in range(dim + 1)])
    return compat.cell_dofs(space.dofmap)[cells[:, None], closure[local]].astype(np.int64)


def cell_heights(mesh: Mesh, facets: np.ndarray) -> np.ndarray:
    """How far the cell of each facet reaches from it (facets,) [length]: dim times its volume over
    the facet's area.
    """
    dim = mesh.topology.dim
    cells, local = adjacent_cells(mesh, facets)
    corners = mesh.geometry.x[compat.cell_dofs(mesh.geometry.dofmap)[cells][:, : dim + 1], :dim]
    apex = corners[np.arange(len(cells)), local]
    on_facet = np.array([np.delete(np.arange(dim + 1), k) for k in range(dim + 1)])[local]
    base = np.take_along_axis(corners, on_facet[:, :, None], axis=1)
    facet_edges = base[:, 1:] - base[:, :1]  # (facets, dim - 1, dim)
    apex_edge = apex - base[:, 0]
    edges = np.concatenate([facet_edges, apex_edge[:, None]], axis=1)
    area = np.sqrt(np.abs(np.linalg.det(facet_edges @ facet_edges.transpose(0, 2, 1))))
    return np.abs(np.linalg.det(edges)) / area


class FacetValues:
    """A UFL expression at points of the reference facet, on every one of this rank's facets."""

    def __init__(self, mesh: Mesh, facets: np.ndarray, expression: Expr, points: np.ndarray):
        """Collective: all ranks compile what any of them needs, or those with few facets would
        leave others waiting.
        """
        self._mesh = mesh
        self._cells, self._local = adjacent_cells(mesh, facets)
        self._points = len(points)
        numbers = sorted(set().union(*mesh.comm.allgather(set(self._local.tolist()))))
        corners = np.vstack(
            [np.zeros(mesh.topology.dim), np.eye(mesh.topology.dim)]
        )  # of the reference cell
        points_by_facet = {
            k: barycentric(points) @ np.delete(corners, k, axis=0) for k in numbers
        }  # on its facet k
        self._compiled = {k: fem.Expression(expression, points_by_facet[k]) for k in numbers}
        self._size = int(np.prod(expression.ufl_shape, dtype=int))

    def __call__(self) -> np.ndarray:
        """Values (facets, points, components) at the present solution."""
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
