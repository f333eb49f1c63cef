"""The whole body at the present solution, for measurements, the surface table and the fields."""

from __future__ import annotations

import numpy as np

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.postprocessing.whole_body import WholeBody
from indent_sim.fe.terms.contact.soft_tip_contact import SoftTipContact
from indent_sim.fe.terms.scene_terms import BulkTerms, ContactTerms
from indent_sim.model.tips import max_radius


class SolvedBody(WholeBody):
    """The whole body at the present solution of its problem."""

    def __init__(self, body: Body, bulk: BulkTerms, contact: ContactTerms):
        super().__init__(body, bulk.strain_energies, contact.friction, bulk.flow)
        self.multiplier_at = contact.pressure.multiplier_at
        self.pressure_at = contact.pressure.pressure_at
        self._body = body
        self._contact = contact.pressure

    @property
    def tip_center(self) -> tuple[float, ...]:
        """Horizontal position of the tip's axis [length]."""
        return self.scene.physics.track.position(self._body.slide)

    @property
    def depth(self) -> float:
        """Indentation depth delta [length]."""
        return float(self._body.now.delta.value)

    def tip_displacement(self, r: np.ndarray) -> np.ndarray:
        """Return the height of a soft tip's deformed surface above the undeformed one [length].

        Both heights are taken at the same radii r [length]; the result is 0 for a rigid tip. Beyond
        the meshed part of the surface, the value at the end of this part is returned.
        """
        if not isinstance(self._contact, SoftTipContact):
            return 0.0 * r
        indenter = self.scene.physics.indenter
        end = min(self._contact.end_radius, 0.99 * max_radius(indenter))
        inside = np.minimum(np.abs(r), end)
        height = self._contact.surface_at(inside.ravel()).height.reshape(r.shape)
        return height - np.asarray(indenter.height(inside, 0.0 * inside))

    def inverted_size(self) -> float:
        """Return the size [length] of the region of inverted elements, J < 0 (collective)."""
        return max(strain.inverted_size() for strain in self.strain_energies)
