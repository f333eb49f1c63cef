"""Shape functions of quadratic facets and of nodal pressures on the reference facet."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

# Vertices between which the midpoints of a facet are, by dimension of the model
MIDPOINT_VERTICES = {2: ((0, 1),), 3: ((1, 2), (0, 2), (0, 1))}


def barycentric(points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (n, vertices) of points (n, dim) of the unit interval or simplex."""
    return np.column_stack([1 - points.sum(axis=1), points])


def shape_functions(points: np.ndarray) -> np.ndarray:
    """Quadratic shape functions (points, nodes) on the reference facet.

    Vertices come first, then the midpoint of the edge opposite to each vertex.
    """
    return _cached_shape_functions(points.tobytes(), points.shape[1])


@lru_cache(maxsize=64)  # all rows are evaluated at the same points
def _cached_shape_functions(point_bytes: bytes, columns: int) -> np.ndarray:
    bary = barycentric(np.frombuffer(point_bytes).reshape(-1, columns))
    vertices = bary * (2 * bary - 1)
    values = np.column_stack(
        [vertices, *(4 * bary[:, i] * bary[:, j] for i, j in MIDPOINT_VERTICES[bary.shape[1]])]
    )
    values.flags.writeable = False
    return values


def pressure_shape_functions(points: np.ndarray) -> np.ndarray:
    """Hat functions (points, nodes) of the nodal pressures p_i >= 0 on the reference facet.

    They sum to one and are never negative. On an edge they are piecewise linear between all three
    nodes. On a triangle they are the linear shape functions of the vertices, and zero for the
    midpoints: with pressures at all nodes an oscillation would remain undetermined, because the
    integral of the quadratic shape function of a vertex is zero.
    """
    vertices = barycentric(points)
    if points.shape[1] == 2:
        return np.pad(vertices, ((0, 0), (0, 3)))
    ends = np.maximum(2 * vertices - 1, 0.0)
    return np.column_stack([ends, 1 - ends.sum(axis=1)])


def interpolate_from_midpoints(
    nodal: np.ndarray, sum_over_facets: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Replace the vertex values of a quadratic multiplier on triangles by means of midpoint values.

    The integral of the quadratic shape function of a vertex is zero, so that the multiplier
    oscillates at vertices and is accurate at midpoints. The mean is taken over the midpoints of the
    edges that meet at a vertex.

    Parameters
    ----------
    nodal : ndarray, (facets, nodes)
        Nodal values.
    sum_over_facets : callable
        Function that sums contributions (facets, nodes) over the facets that share a node.

    Returns
    -------
    ndarray, (facets, nodes)
        Nodal values without the oscillation.
    """
    midpoints = nodal[:, 3:]
    means = np.zeros_like(nodal)
    ones = np.zeros_like(nodal)
    means[:, :3] = (midpoints.sum(axis=1, keepdims=True) - midpoints) / 2
    ones[:, :3] = 1.0
    return np.hstack([sum_over_facets(means)[:, :3] / sum_over_facets(ones)[:, :3], midpoints])
