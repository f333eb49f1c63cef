"""Stiffnesses of bonded flat punches of every radius on a condensed axisymmetric body.

All of them follow from one Cholesky factorisation C = L L^T of the compliance with the nodes
ordered by radius, because the factor of every leading block of C is the leading block of L. With L
y = 1 and L h = heights of the tip, a bonded punch of the tip's shape on the first n nodes has

    K_n = 1.C_n^-1.1 = sum y^2,   P_n = 1.C_n^-1.heights = sum y h,   F = K delta - P.

The largest punch ends before the first node that cannot move relative to the nodes inside it: a
node with a prescribed displacement, or the last nodes of a sealed incompressible body.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from indent_sim.fe.condensed.contact import CondensedContact
from indent_sim.fe.measured_constants import RADIUS_SHIFT


def punches(contact: CondensedContact) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return radii, stiffnesses and forces of bonded punches, one ending at each vertex.

    The smallest punch ends at the first vertex off the axis, the largest one at the last vertex of
    the condensed surface that can move.

    Returns
    -------
    a, K, P
        Radii [length], and the stiffnesses K [force/length] and forces P [force] in the force F = K
        delta - P of the model domain.
    """
    compliance = contact.compliance
    physics = contact.scene.physics
    trace = compliance.trace
    x = trace.positions(trace.node_points())
    r = np.zeros(compliance.size)
    heights = np.zeros(compliance.size)
    r[trace.nodes] = x[..., 0]
    heights[trace.nodes] = physics.indenter.height(x[..., 0], 0.0) - x[..., 1]
    order = np.argsort(r)
    C = compliance.C[np.ix_(order, order)]
    L, failed_at = dpotrf(C, lower=1)
    factored_count = failed_at - 1 if failed_at else len(C)
    # A smaller compliance of a node with those inside it fixed, relative to its own, is round-off
    is_stiff = np.diag(L)[:factored_count] ** 2 <= 1e-8 * np.diag(C)[:factored_count]
    n = int(np.argmax(np.append(is_stiff, True)))
    right_hand_sides = np.column_stack([np.ones(n), heights[order][:n]])
    unit_solution, height_solution = (
        solve_triangular(L[:n, :n], right_hand_sides, lower=True).T if n else right_hand_sides.T
    )
    # Positions of the vertices in this order, without the one on the axis
    vertex_ends = np.searchsorted(r[order], np.sort(r[np.unique(trace.nodes[:, :2])]))[1:]
    vertex_ends = vertex_ends[vertex_ends < n]
    K = np.cumsum(unit_solution**2)[vertex_ends]
    P = np.cumsum(unit_solution * height_solution)[vertex_ends]
    a = r[order][vertex_ends]
    elements = np.diff(a, prepend=0.0)
    region = physics.domain.regions[0]
    intercept, slope = RADIUS_SHIFT[region.formulation]
    return a + (intercept - slope * region.material.constants.nu) * elements, K, P
