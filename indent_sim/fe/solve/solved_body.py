"""The whole body at the present solution, for measurements, the surface table and the fields."""

from __future__ import annotations

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.postprocessing.whole_body import WholeBody
from indent_sim.fe.terms.scene_terms import BulkTerms, ContactTerms


class SolvedBody(WholeBody):
    """The whole body at the present solution of its problem."""

    def __init__(self, body: Body, bulk: BulkTerms, contact: ContactTerms):
        super().__init__(body, bulk.strain_energies, contact.friction, bulk.flow)
        self.multiplier_at = contact.pressure.multiplier_at
        self.pressure_at = contact.pressure.pressure_at
        self._body = body

    @property
    def tip_center(self) -> tuple[float, ...]:
        """Horizontal position of the tip's axis [length]."""
        return self.scene.physics.track.position(self._body.slide)

    @property
    def depth(self) -> float:
        """Indentation depth delta [length]."""
        return float(self._body.now.delta.value)

    def inverted_size(self) -> float:
        """Return the size [length] of the region in which J < 0 (collective)."""
        return max(strain.inverted_size() for strain in self.strain_energies)
