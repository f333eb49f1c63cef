"""Linear complementarity problem of nodal pressures on a compliance."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular


def solve_complementarity(
    A: np.ndarray, open_gap: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, int]:
    """Solve p >= 0, G = open_gap + A p >= 0, p G = 0.

    A primal-dual active set method is used. If an active set recurs, the method would cycle; then
    the equivalent problem of non-negative least squares, which cannot cycle, is solved (Lawson &
    Hanson 1974, Solving Least Squares Problems, chapter 23).

    Parameters
    ----------
    A
        Symmetric positive definite compliance (n, n).
    open_gap
        Weighted gaps (n,) without pressure.
    active
        Initial active set (n,), True in contact.

    Returns
    -------
    p
        Pressures (n,).
    solves
        Number of linear solves.
    """
    visited: set[bytes] = set()
    while active.tobytes() not in visited:
        visited.add(active.tobytes())
        p = np.zeros(len(A))
        active_nodes = np.flatnonzero(active)
        p[active_nodes] = np.linalg.solve(
            A[np.ix_(active_nodes, active_nodes)], -open_gap[active_nodes]
        )
        # A node with NaN would be treated as a node without pressure.
        if not np.isfinite(p).all():
            break
        next_active = np.where(active, p, -(open_gap + A @ p)) > 0
        if np.array_equal(next_active, active):
            return p, len(visited)
        active = next_active
    # Imported here since it loads all of scipy.optimize, which few contacts need
    from scipy.optimize import nnls

    L = cholesky(A, lower=True)
    p, _ = nnls(L.T, -solve_triangular(L, open_gap, lower=True), maxiter=50 * len(A))
    return p, len(visited) + 1
