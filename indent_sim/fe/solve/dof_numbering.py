"""Numbering of dofs that does not depend on the number of ranks that share a mesh.

A checkpoint can thus be read with another number of ranks. A node of a Lagrange space is a vertex
of the grid or an edge midpoint; nodes are sorted by the numbers of the one or two vertices that
define them. Values at points inside cells are sorted by the number of the cell in the grid.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from dolfinx import fem

from indent_sim.fe import compat


class DofNumbering:
    """Positions of this rank's values of a field among the values of all ranks (collective).

    Parameters
    ----------
    space
        The space of the field.
    dofs
        Positions of the dofs of the space in the local array of the vector with their values.
    """

    def __init__(self, space: fem.FunctionSpace, dofs: np.ndarray):
        owned = space.dofmap.index_map.size_local
        width = space.dofmap.index_map_bs
        self._comm = space.mesh.comm
        self._owned_dofs = dofs.reshape(-1, width)[:owned]
        keys = (_node_keys if compat.has_vertex_dofs(space) else _cell_point_keys)(space)[:owned]
        all_keys = np.sort(np.concatenate(self._comm.allgather(keys)))
        self._global_rows = np.searchsorted(all_keys, keys)
        self.shape = len(all_keys), width

    def gather(self, local: np.ndarray) -> np.ndarray:
        """Return the values (nodes, components) of all ranks on rank 0 (collective).

        Other ranks get an empty array.
        """
        parts = self._comm.gather((self._global_rows, local[self._owned_dofs]), root=0)
        whole = np.zeros(self.shape if parts else (0, self.shape[1]))
        for rows, values in parts or ():
            whole[rows] = values
        return whole

    def scatter(self, whole: np.ndarray, local: np.ndarray) -> None:
        """Copy this rank's part of the values of all ranks into a local array."""
        local[self._owned_dofs] = whole[self._global_rows]


def _node_keys(space: fem.FunctionSpace) -> np.ndarray:
    """Return a number for every local node, from the one or two grid vertices that define it."""
    mesh = space.mesh
    dofs = compat.cell_dofs(space.dofmap)
    corners = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)[
        compat.geometry_dofs(mesh)
    ]
    n = corners.shape[1]
    edges = reversed([*combinations(range(n), 2)]) if dofs.shape[1] > n else ()
    pairs = [*((k, k) for k in range(n)), *edges]
    total = mesh.geometry.index_map().size_global
    keys = np.zeros(dofs.max(initial=-1) + 1, dtype=np.int64)
    for node, (a, b) in zip(dofs.T, pairs, strict=True):
        low = np.minimum(corners[:, a], corners[:, b])
        high = np.maximum(corners[:, a], corners[:, b])
        keys[node] = low * total + high
    return keys


def _cell_point_keys(space: fem.FunctionSpace) -> np.ndarray:
    """Return a number for every local point, from its cell and its number in the cell."""
    dofs = compat.cell_dofs(space.dofmap)
    cells = np.asarray(space.mesh.topology.original_cell_index, dtype=np.int64)[: len(dofs)]
    keys = np.zeros(dofs.max(initial=-1) + 1, dtype=np.int64)
    keys[dofs] = cells[:, None] * dofs.shape[1] + np.arange(dofs.shape[1])
    return keys
