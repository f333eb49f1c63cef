"""Bonded flat punches of every radius on a condensed axisymmetric body, from one Cholesky of its compliance.

With the nodes in the order of their radius and C = L L^T, the leading block of every size has the factor's leading
block, so that L one = 1, L h = heights give at once, for the punch on the first n nodes and the tip's shape there,
    K_n = 1.C_n^-1.1 = sum one^2,   P_n = 1.C_n^-1.heights = sum one h,   F = K delta - P.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from indent_sim.fe.condensed.contact import CondensedContact
from indent_sim.fe.observe.surface import undeformed

# Of the element inside the edge: so much larger than the last vertex's is the radius of the punch that a mesh finds, by
# formulation. Measured against theory on layers, three to twenty-five elements in the radius, nu = 0 ... 0.4999: 0.086
# to 0.092 (displacement), 0.050 to 0.061 (mixed). Without it K would be 1.4 % too small at 20 elements.
SHIFT = {"displacement": 0.09, "mixed": 0.055}


def punches(contact: CondensedContact) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radii a [length], stiffness K [pressure length] and P [pressure length^2] of the punches that end at a vertex.

    The body's own, from the first vertex off the axis to the last that is condensed to.
    """
    compliance, physics = contact.compliance, contact.scene.physics
    trace = compliance.trace
    x = undeformed(physics.part, trace, trace.node_points())
    r, heights = np.zeros(compliance.size), np.zeros(compliance.size)
    r[trace.nodes] = x[..., 0]
    heights[trace.nodes] = physics.indenter.height(x[..., 0], 0.0) - x[..., 1]
    order = np.argsort(r)
    L = cholesky(compliance.C[np.ix_(order, order)], lower=True)
    one, h = solve_triangular(L, np.column_stack([np.ones(len(r)), heights[order]]), lower=True).T
    ends = np.searchsorted(r[order], np.sort(r[np.unique(trace.nodes[:, :2])]))[1:]  # of the vertices but the axis
    K, P, a = np.cumsum(one**2)[ends], np.cumsum(one * h)[ends], r[order][ends]
    elements = np.diff(a, prepend=0.0)
    return a + SHIFT[physics.part.regions[0].formulation] * elements, K, P
