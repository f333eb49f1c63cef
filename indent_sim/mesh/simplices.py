"""Edges and volumes of simplices as arrays."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from indent_sim.mesh.grid import row_slices


def unique_edges(cells: np.ndarray) -> np.ndarray:
    """Return the edges (k, 2) of simplices as point numbers, sorted and without duplicates."""
    pairs = combinations(range(cells.shape[1]), 2)
    return np.unique(
        np.sort(np.concatenate([cells[:, list(pair)] for pair in pairs]), axis=1), axis=0
    )


def edge_keys(edges: np.ndarray) -> np.ndarray:
    """Return an integer for each edge (k,); sorting the integers sorts the edges."""
    return np.asarray((edges[:, 0] << 32) + edges[:, 1])


def oriented(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the cells with their corners ordered so that all volumes are positive."""
    is_inverted = signed_volumes(points, cells) < 0
    cells = cells.copy()
    cells[is_inverted, -2:] = cells[is_inverted][:, :-3:-1]
    return cells


def signed_volumes(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return dim! times the signed volumes (m,) of cells: determinants of the edge vectors."""
    volumes = [
        np.linalg.det(points[cells[chunk, 1:]] - points[cells[chunk, :1]])
        for chunk in row_slices(len(cells))
    ]
    return np.concatenate([np.empty(0), *volumes])
