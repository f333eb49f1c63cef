"""Quadrature rules and evaluation points on the reference facet of the contact surface."""

from __future__ import annotations

from functools import cache

import numpy as np

from indent_sim.fe import compat
from indent_sim.fe.shape_functions import MIDPOINT_VERTICES

# Degree of the contact quadrature, by dimension: 11 points per edge, 25 per triangle, because the
# contact pressure has a kink at the contact edge
QUADRATURE_DEGREE = {2: 20, 3: 10}


@cache
def split_quadrature(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points and weights of a quadrature rule for `pressure_shape_functions`.

    An edge has one rule for each half, because the functions have a kink in the middle.
    """
    if dim == 3:
        return contact_quadrature(dim)
    points, weights = compat.quadrature_rule("interval", 12)
    return np.vstack([points / 2, (points + 1) / 2]), np.concatenate([weights, weights]) / 2


@cache
def facet_lattice(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Equally spaced points (n, dim - 1) on the reference facet, and the simplices between them.

    The simplices are used to locate the contact edge inside a facet.
    """
    # Subdivisions of the edge of a facet: the contact edge is found to one of them.
    n = {2: 32, 3: 8}[dim]
    if dim == 2:
        return np.linspace(0, 1, n + 1)[:, None], np.column_stack(
            [np.arange(n), np.arange(1, n + 1)]
        )
    lattice = ((i, j) for i in range(n + 1) for j in range(n + 1 - i))
    index = {point: k for k, point in enumerate(lattice)}
    upward = [(index[i, j], index[i + 1, j], index[i, j + 1]) for i, j in index if i + j < n]
    downward = [
        (index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for i, j in index if i + j < n - 1
    ]
    return np.array(list(index), dtype=float) / n, np.array(upward + downward)


@cache
def contact_quadrature(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of the contact quadrature on the reference facet."""
    return compat.quadrature_rule({2: "interval", 3: "triangle"}[dim], QUADRATURE_DEGREE[dim])


@cache
def node_points(dim: int) -> np.ndarray:
    """Coordinates (nodes, dim - 1) of the nodes on the reference facet."""
    corners = np.vstack([np.zeros(dim - 1), np.eye(dim - 1)])
    return np.vstack([corners, *((corners[i] + corners[j]) / 2 for i, j in MIDPOINT_VERTICES[dim])])


@cache
def evaluation_points(dim: int) -> np.ndarray:
    """Points at which contact values are evaluated: lattice, contact quadrature, then nodes."""
    return np.vstack([facet_lattice(dim)[0], contact_quadrature(dim)[0], node_points(dim)])
