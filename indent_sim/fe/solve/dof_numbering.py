"""Numbers of dofs that do not depend on how many ranks share a mesh, so that a state can go from
one run to another.

A node of a Lagrange space is a point of the grid or the middle of two; sorted by these points all
nodes have a place. Values at points inside cells have the place of their cell in the grid.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from dolfinx import fem

from indent_sim.fe import compat


class DofNumbering:
    """Where the values of a field on this rank stand among those of all ranks (collective)."""

    def __init__(self, space: fem.FunctionSpace, dofs: np.ndarray):
        """places: of the space's dofs in the local array of the vector that holds them."""
        owned = space.dofmap.index_map.size_local
        width = space.dofmap.index_map_bs
        self._comm = space.mesh.comm
        self._owned_dofs = dofs.reshape(-1, width)[:owned]
        is_in_cells = space.dofmap.dof_layout.num_entity_dofs(0) == 0
        keys = (_cell_point_keys if is_in_cells else _node_keys)(space)[:owned]
        all_keys = np.sort(np.concatenate(self._comm.allgather(keys)))
        self._global_rows = np.searchsorted(all_keys, keys)
        self.shape = len(all_keys), width

    def gather(self, local: np.ndarray) -> np.ndarray:
        """Values (nodes of all ranks, components) on rank 0; nothing elsewhere (collective)."""
        parts = self._comm.gather((self._global_rows, local[self._owned_dofs]), root=0)
        whole = np.zeros(self.shape if parts else (0, self.shape[1]))
        for rows, values in parts or ():
            whole[rows] = values
        return whole

    def scatter(self, whole: np.ndarray, local: np.ndarray) -> None:
        """Put this rank's own share of values of all ranks into a local array."""
        local[self._owned_dofs] = whole[self._global_rows]


def _node_keys(space: fem.FunctionSpace) -> np.ndarray:
    """A number for every local node: of its point in the grid, or of the two that it lies between."""
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
    """A number for every local point: of its cell in the grid, and its own in the cell."""
    dofs = compat.cell_dofs(space.dofmap)
    cells = np.asarray(space.mesh.topology.original_cell_index, dtype=np.int64)[: len(dofs)]
    keys = np.zeros(dofs.max(initial=-1) + 1, dtype=np.int64)
    keys[dofs] = cells[:, None] * dofs.shape[1] + np.arange(dofs.shape[1])
    return keys
