"""Fields for ParaView: values at the vertices and cells of the grid, gathered on rank 0 in the grid's own order."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np
from dolfinx import fem

from indent_sim.fe import compat
from indent_sim.fe.observe import measure


class ObservedBody(measure.Observed, Protocol):
    """A whole body whose fields can be read off."""

    mesh: Any
    body_mesh: Any
    unknowns: Any
    strains: Any  # of each region: its Cauchy stress (3, 3) [pressure] in UFL, and its cells on this rank

    def local_array(self) -> np.ndarray:
        """The solution's dofs on this rank, ghosts included."""


class Fields:
    """Displacement (points, dim) [length], stress (cells, 3, 3) and contact pressure (points,) of a solution.

    A quadratic displacement is shown by its values at the vertices; stress is that of the cells' centroids.
    """

    def __init__(self, body: ObservedBody):
        self.body = body

    @cached_property
    def _stress(self) -> tuple[fem.Function, list[tuple[fem.Expression, np.ndarray]]]:
        mesh, dim = self.body.mesh, self.body.body_mesh.dim
        space = compat.function_space(mesh, compat.piecewise_constant_tensor(dim))
        points = compat.interpolation_points(space.element)
        return fem.Function(space), [(fem.Expression(s.stress, points), s.cells) for s in self.body.strains]

    def gather(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """(displacement, stress, pressure) on rank 0, None on the others."""
        body = self.body
        mesh = body.mesh
        nodes, cells = mesh.geometry.input_global_indices, mesh.topology.original_cell_index
        parts: Any = body.comm.gather((nodes, self._at_nodes(), cells, self._in_cells()), root=0)
        if parts is None:
            return None
        points = _in_order([(p[0], p[1]) for p in parts])
        return points[:, :-1], _in_order([(p[2], p[3]) for p in parts]).reshape(-1, 3, 3), points[:, -1]

    def _at_nodes(self) -> np.ndarray:
        """Displacement and pressure at the geometry nodes of this rank."""
        body = self.body
        dim = body.body_mesh.dim
        geometry = compat.geometry_dofs(body.mesh)
        values = np.zeros((len(body.mesh.geometry.x), dim + 1))
        vertices = compat.cell_dofs(body.unknowns.own_space("u").dofmap)[
            :, : dim + 1
        ]  # vertices come first in a cell
        values[geometry, :dim] = body.local_array()[body.unknowns.displacement_places(vertices)]
        pressure = np.zeros(vertices.max(initial=0) + 1)
        corners = body.trace.node_points()[:dim]
        # the true pressure is each facet's own: of those that meet the largest, as where ranks meet
        np.maximum.at(pressure, body.trace.nodes[:, :dim], measure.sample(body, corners).pressure)
        values[geometry, dim] = pressure[vertices]
        return values

    def _in_cells(self) -> np.ndarray:
        function, expressions = self._stress
        for expression, cells in expressions:
            function.interpolate(expression, cells)
        return function.x.array.reshape(-1, 9)[compat.cell_dofs(function.function_space.dofmap).ravel()]


def _in_order(parts: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Rows of all ranks at their original places; a node shared by ranks takes the value with contact."""
    index = np.concatenate([numbers for numbers, _ in parts])
    rows = np.concatenate([values[: len(numbers)] for numbers, values in parts])
    table = np.zeros((index.max() + 1, rows.shape[1]))
    by_pressure = np.argsort(rows[:, -1], kind="stable")  # the largest last, so that it stays
    table[index[by_pressure]] = rows[by_pressure]
    return table
