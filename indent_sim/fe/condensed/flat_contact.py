"""Contact of a condensed body with the flat on which it rests, evaluated like that with a plate."""

from __future__ import annotations

from indent_sim.fe.condensed.condensed_state import CondensedState
from indent_sim.fe.condensed.contact import CondensedContact
from indent_sim.fe.postprocessing.measurements import contact_values
from indent_sim.model.tips import Plate


class FlatContact(CondensedState):
    """Contact with the flat, treated as a plate that approaches the body turned upside down.

    Parameters
    ----------
    contact
        The contact of tip, body and flat.
    """

    def __init__(self, contact: CondensedContact):
        super().__init__(contact)
        on_flat = contact.compliance.rests_on_flat
        assert on_flat is not None
        self.scene = contact.scene.replace_physics(indenter=Plate())
        self.trace = contact.compliance.trace.select_facets(on_flat)

    @property
    def depth(self) -> float:
        """Motion of the body towards the flat [length]."""
        return self.contact.base_approach

    @property
    def motion(self) -> float:
        """Motion of the spring towards the flat, which is a part of the depth [length]."""
        return self.contact.base_approach - self.contact.motion


def flat_contact_radius(contact: CondensedContact, force: float) -> float:
    """Return the radius of the contact with the flat [length].

    Parameters
    ----------
    contact
        The contact of tip, body and flat.
    force
        Force on the flat [force].
    """
    return float(contact_values(FlatContact(contact), force)["a"])
