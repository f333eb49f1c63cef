"""Stiffnesses of bonded flat punches of every radius on a condensed axisymmetric body.

All of them follow from one Cholesky factorisation C = L L^T of the compliance with the nodes
ordered by radius, because the factor of every leading block of C is the leading block of L. With L
y = 1 and L h = heights of the tip, a bonded punch of the tip's shape on the first n nodes has

    K_n = 1.C_n^-1.1 = sum y^2,   P_n = 1.C_n^-1.heights = sum y h,   F = K delta - P.

The largest punch ends before the first node that cannot move relative to the nodes inside it: a
node with a prescribed displacement, or the last nodes of a sealed incompressible body.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from indent_sim.fe.condensed.contact import CondensedContact
from indent_sim.fe.measured_constants import RADIUS_SHIFT
from indent_sim.fe.surface import Trace
from indent_sim.model.tips import Indenter, Plate

# Radii [length], stiffnesses [force/length] and forces [force] of punches.
PunchTable = tuple[np.ndarray, np.ndarray, np.ndarray]


def punches(contact: CondensedContact) -> PunchTable:
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
    return _bonded_punches(contact, compliance.trace, compliance.C, contact.scene.physics.indenter)


class BothContacts:
    """Bonded punches of tip and flat on a body that rests on the flat.

    The punches of one contact move relative to the other contact, on which the same force has the
    distribution of a given equilibrium, without a mean displacement there.

    Parameters
    ----------
    contact
        The contact of tip, body and flat in an equilibrium, which gives the distributions.

    Attributes
    ----------
    shared_compliance
        Compliance of both distributions, which is a part of that of both contacts [length/force].
    """

    def __init__(self, contact: CondensedContact):
        self._contact = contact
        flat = contact.compliance.flat
        assert flat is not None
        # The compliance for forces that point into the body, without the spring below it.
        self._C = contact.compliance.C - flat.spring * np.outer(flat.signs, flat.signs)
        self._on_flat = flat.signs < 0
        forces = np.abs(contact.F)
        above = forces[~self._on_flat].sum()
        below = forces[self._on_flat].sum()
        self._distribution = forces / np.where(self._on_flat, below, above)
        self.shared_compliance = float(self._distribution @ self._C @ self._distribution)

    @property
    def upper(self) -> PunchTable:
        """Punches of the tip, see `punches`."""
        facets = self._facets(~self._on_flat)
        tip = self._contact.scene.physics.indenter
        return _bonded_punches(
            self._contact, facets, self._relative_compliance(~self._on_flat), tip
        )

    @property
    def lower(self) -> PunchTable:
        """Punches of the flat up to the end of the fine part of the base, see `punches`."""
        facets = self._facets(self._on_flat)
        base = self._contact.scene.sizes.base_contact
        assert base is not None
        facets = facets.select_facets(facets.X[..., 0].max(axis=1) <= base.radius)
        relative = self._relative_compliance(self._on_flat)
        return _bonded_punches(self._contact, facets, relative, Plate())

    def depth_error(self, a: float, a_base: float, force: float) -> float:
        """Return the error of the depth as a sum of two contacts of given radii [length].

        The right depth is that of two bonded punches on the compliance of the whole body.

        Parameters
        ----------
        a, a_base
            Radii of the contacts with tip and flat [length].
        force
            Force on both [force].
        """
        r, heights = self._radii_and_heights
        upper = np.flatnonzero(~self._on_flat & (r <= a))
        lower = np.flatnonzero(self._on_flat & (r <= a_base))
        total = -self.shared_compliance * force
        for nodes, is_own in ((upper, ~self._on_flat), (lower, self._on_flat)):
            compliance = self._relative_compliance(is_own)[np.ix_(nodes, nodes)]
            by_unit, by_heights = np.linalg.solve(
                compliance, np.column_stack([np.ones(len(nodes)), heights[nodes]])
            ).T
            total += (force + by_heights.sum()) / by_unit.sum()
        # Both together: the body moves by t towards the flat, until the forces are equal.
        nodes = np.concatenate([upper, lower])
        is_upper = np.arange(len(nodes)) < len(upper)
        directions = np.column_stack([is_upper, np.where(is_upper, 1.0, -1.0), heights[nodes]])
        solved = np.linalg.solve(self._C[np.ix_(nodes, nodes)], directions)
        on_tip = solved[is_upper].sum(axis=0)
        balance = directions[:, 1] @ solved
        stiffness, _, offset = on_tip - on_tip[1] / balance[1] * balance
        return float(total - (force + offset) / stiffness)

    @cached_property
    def _radii_and_heights(self) -> tuple[np.ndarray, np.ndarray]:
        """Radius of each candidate, and height of tip or flat above it [length]."""
        r = np.zeros(len(self._on_flat))
        heights = np.zeros(len(self._on_flat))
        for is_own, tip in (
            (~self._on_flat, self._contact.scene.physics.indenter),
            (self._on_flat, Plate()),
        ):
            trace = self._facets(is_own)
            x = trace.positions(trace.node_points())
            r[trace.nodes] = x[..., 0]
            heights[trace.nodes] = tip.height(x[..., 0], 0.0) - x[..., 1]
        return r, heights

    def _facets(self, is_own: np.ndarray) -> Trace:
        """Return the facets of one contact."""
        trace = self._contact.compliance.trace
        return trace.select_facets(is_own[trace.nodes].all(axis=1))

    def _relative_compliance(self, is_own: np.ndarray) -> np.ndarray:
        """Return the compliance of one contact relative to the distribution on the other one."""
        load = np.where(is_own, 0.0, self._distribution)
        by_load = self._C @ load
        return np.asarray(self._C + by_load[:, None] + by_load + load @ by_load)


def _bonded_punches(
    contact: CondensedContact, trace: Trace, compliance: np.ndarray, tip: Indenter
) -> PunchTable:
    """Return radii, stiffnesses and forces of bonded punches on the facets of a trace.

    `compliance` is that of all candidates.
    """
    physics = contact.scene.physics
    x = trace.positions(trace.node_points())
    r = np.full(contact.compliance.size, np.inf)
    heights = np.zeros(contact.compliance.size)
    r[trace.nodes] = x[..., 0]
    heights[trace.nodes] = tip.height(x[..., 0], 0.0) - x[..., 1]
    order = np.argsort(r)[: np.count_nonzero(np.isfinite(r))]
    C = compliance[np.ix_(order, order)]
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
