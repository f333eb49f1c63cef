"""Bonded flat punches of every radius on a condensed axisymmetric body, from one Cholesky of its
compliance.

With the nodes in the order of their radius and C = L L^T, the leading block of every size has the factor's leading
block, so that L one = 1, L h = heights give at once, for the punch on the first n nodes and the tip's shape there,
    K_n = 1.C_n^-1.1 = sum one^2,   P_n = 1.C_n^-1.heights = sum one h,   F = K delta - P.
They end before the first node that does not yield beside those inside it: one that is held, or the last ones of a
sealed incompressible body, where no punch can move.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from indent_sim.fe.condensed.contact import CondensedContact

# Of the element inside the edge: so much larger than the last vertex's is the radius of the punch
# that a mesh finds, by formulation, with nu = 0 and what it loses with nu. Measured against theory
# on half-spaces and layers: 0.111 at nu = 0 and 0.092 at 0.3 (displacement), 0.059 at 0.45 and
# 0.050 at 0.5 (mixed), to 0.004 each.
RADIUS_SHIFT = {"displacement": (0.111, 0.063), "mixed": (0.140, 0.180)}
COMPLIANCE_TOLERANCE = (
    1e-8  # of a node's compliance, what is left of it when those inside are held; less is rounding
)


def punches(contact: CondensedContact) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radii a [length], stiffness K [pressure length] and P [pressure length^2] of the punches that
    end at a vertex. The body's own, from the first vertex off the axis to the last that is
    condensed to and yields.
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
    is_stiff = (
        np.diag(L)[:factored_count] ** 2 <= COMPLIANCE_TOLERANCE * np.diag(C)[:factored_count]
    )
    n = int(np.argmax(np.append(is_stiff, True)))
    right_hand_sides = np.column_stack([np.ones(n), heights[order][:n]])
    unit_solution, height_solution = (
        solve_triangular(L[:n, :n], right_hand_sides, lower=True).T if n else right_hand_sides.T
    )
    vertex_ends = np.searchsorted(r[order], np.sort(r[np.unique(trace.nodes[:, :2])]))[
        1:
    ]  # of the vertices but the axis
    vertex_ends = vertex_ends[vertex_ends < n]
    K = np.cumsum(unit_solution**2)[vertex_ends]
    P = np.cumsum(unit_solution * height_solution)[vertex_ends]
    a = r[order][vertex_ends]
    elements = np.diff(a, prepend=0.0)
    region = physics.domain.regions[0]
    intercept, slope = RADIUS_SHIFT[region.formulation]
    return a + (intercept - slope * region.material.constants.nu) * elements, K, P
