"""A body that rests on a rigid flat without a bond: two contacts on one compliance.

The tip presses on the top of the body, and the flat on its base, with the same force. The body is
pinned at half of its height on the axis. With nodal forces F that point into the body, both
surfaces move into the body by

    w = (D C D + c s s^T) F,   s = +1 on the top and -1 on the base,   D = diag(s),

where C is the compliance of the pinned body and c that of a spring between pin and flat. The rigid
motion of the body towards the flat is t = t_0 + c s.F. The start t_0 of the spring is moved until
it has no force, so that the forces on tip and flat are equal (`CondensedContact`). For the contact
methods there is a single compliance and a single surface. Each contact displaces the
surface of the other contact through the compliance. The theory of two contacts in series neglects
this effect; it is the limit of contacts that are small compared with the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from indent_sim.fe.condensed.compliance import Compliance, Condenser, FlatBelow
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.surface import Trace
from indent_sim.model.tip_track import TipTrack

# Compliance of the spring between body and flat, in multiples of that of the expected contacts.
# With much softer springs the active sets of some contact methods recur, mainly for caps on a flat
# base. The force does not depend on it: tests/physics/test_resting_bodies.py.
SPRING_FACTOR = 10.0


class RestingBodyCondenser:
    """Condenser of an axisymmetric body and of the contact with the flat on which it rests.

    The class has all members of `Condenser` that the equilibrium uses.

    Parameters
    ----------
    body
        The discrete body, whose surface `base` rests on the flat.
    """

    def __init__(self, body: Body):
        self.body = body
        self._condenser = Condenser(body, body.surface_trace("base"))
        # Nodes of the facets that the tip may touch, by their numbers in the whole surface.
        self.facet_rows = self._condenser.facet_rows[: len(body.trace.nodes)]
        self.support_surfaces = (*self._condenser.support_surfaces, ("base", body.trace.dim - 1))
        self.strain_energies = self._condenser.strain_energies
        self.count_candidates = self._condenser.count_candidates
        self._height = body.scene.physics.domain.height
        self._pinned: Compliance | None = None
        self._compliance: Compliance | None = None

    def condense(self, radius: float, track: TipTrack, axes: Sequence[int]) -> Compliance:
        """Return the compliance of the top near the axis and of the whole base.

        The parameters are those of `Condenser.condense`.
        """
        pinned = self._condenser.condense(radius, track, axes)
        if self._compliance is not None and pinned is self._pinned:
            return self._compliance
        is_on_flat = self._condenser.is_on_flat
        signs = np.where(is_on_flat[pinned.candidates], -1.0, 1.0)
        spring = SPRING_FACTOR * self._contact_compliance()
        self._pinned = pinned
        self._compliance = replace(
            pinned,
            matrix=signs[:, None] * (pinned.matrix + spring) * signs,
            support_reactions=np.vstack(
                [pinned.support_reactions * signs, np.where(signs < 0, 1.0, 0.0)]
            ),
            pin_reactions=np.zeros_like(pinned.pin_reactions),
            trace=self._turn_base(pinned.trace, is_on_flat[pinned.candidates]),
            surface=self._turn_base(pinned.surface, is_on_flat),
            flat=FlatBelow(is_on_flat, signs, spring),
        )
        return self._compliance

    def _contact_compliance(self) -> float:
        """Return the compliance 1/(2 E* (a + a_base)) of both expected contacts [length/force]."""
        scene = self.body.scene
        a = scene.plan.prediction["a"] / scene.physics.scales.length
        base = scene.sizes.base_contact
        a_base = base.radius if base else a
        return 1 / (2 * scene.physics.material.E_star * (a + a_base))

    def _turn_base(self, trace: Trace, is_on_flat: np.ndarray) -> Trace:
        """Return the trace, with the heights of its base above the flat as negative heights."""
        X = trace.X.copy()
        on_flat = is_on_flat[trace.nodes].all(axis=1)
        X[on_flat, :, -1] = -(X[on_flat, :, -1] + self._height)
        return Trace(trace.nodes, X, trace.dofs)

    @property
    def observed_dofs(self) -> np.ndarray:
        """Local positions of the displacements of the surface; see `Condenser`."""
        return self._condenser.observed_dofs

    def local_displacements(
        self, compliance: Compliance, nodal_forces: np.ndarray
    ) -> np.ndarray | None:
        """Return this rank's displacements of the pinned body; see `Condenser`."""
        assert self._pinned is not None
        return self._condenser.local_displacements(self._pinned, self._downward(nodal_forces))

    def recover(self, compliance: Compliance, nodal_forces: np.ndarray) -> None:
        """Set the solution to the response of the pinned body; see `Condenser`."""
        assert self._pinned is not None
        self._condenser.recover(self._pinned, self._downward(nodal_forces))

    def _downward(self, nodal_forces: np.ndarray) -> np.ndarray:
        """Return the downward nodal forces for forces that point into the body [force]."""
        assert self._compliance is not None
        assert self._compliance.flat is not None
        return self._compliance.flat.signs * nodal_forces
