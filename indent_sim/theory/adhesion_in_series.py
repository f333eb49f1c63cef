"""Two adhesive contacts in series: a body between a tip above and a flat below, without range.

Both contacts carry one force, and their approaches add up. Each is in the JKR limit on a compliance
of its own, which contains the displacement of the whole body by a fixed distribution of the same
force on the other contact. The compliance of both fixed distributions is contained in both and
subtracted once. What is neglected is the change of the distribution on one contact with the radius
of the other one.

Under tension the contact with the smaller pull-off force is lost first: it is the weaker one. Its
radius decreases along the whole curve, so that the equilibria are functions of it; the stronger
contact returns to its radius at zero force. Source: Johnson, Contact Mechanics (1985), 4.2, 5.5.
"""

from __future__ import annotations

import contextlib
import math

from indent_sim.theory.adhesion import AdhesiveContact, Jkr


class JkrInSeries(Jkr):
    """Equilibria of a body between tip and flat as functions of the radius of its weaker contact.

    Parameters
    ----------
    upper, lower
        The contacts of the body with the tip and with the flat.
    shared_compliance
        Compliance that is contained in both [L/F].
    """

    def __init__(self, upper: Jkr, lower: Jkr, shared_compliance: float):
        self.upper = upper
        self.lower = lower
        self.shared_compliance = shared_compliance
        self.is_base_weaker = lower.pull_off(math.inf).force > upper.pull_off(math.inf).force
        self._weaker, self._stronger = (lower, upper) if self.is_base_weaker else (upper, lower)
        super().__init__(self._weaker.punches, self._weaker.work)
        self.max_radius = self._largest_radius()

    @property
    def first_contact(self) -> float:
        """Depth at which the tip touches the body, which adhesion has drawn to the flat [L]."""
        resting = self.lower.stable_equilibrium(0.0, math.inf)
        assert resting is not None
        return resting.delta

    @property
    def neighbouring_fits(self) -> list[Jkr]:
        """The same contacts by fits of other degrees to the punches of both."""
        pairs = zip(self.upper.neighbouring_fits, self.lower.neighbouring_fits, strict=True)
        return [JkrInSeries(upper, lower, self.shared_compliance) for upper, lower in pairs]

    @property
    def zero_force_radius(self) -> float:  # type: ignore[override]
        """Radius of the weaker contact [L] at zero force."""
        return self._weaker.zero_force_radius

    def radii(self, contact: AdhesiveContact) -> tuple[float, float]:
        """Return the radii of the contacts with tip and flat [L] of an equilibrium."""
        other = self._stronger_contact(contact.force).a
        return (other, contact.a) if self.is_base_weaker else (contact.a, other)

    def _solve(self, a: float) -> AdhesiveContact:
        """Solve for the equilibrium at the radius a [L] of the weaker contact."""
        contact = self._weaker.equilibrium_at(a)
        other = self._stronger_contact(contact.force)
        delta = contact.delta + other.delta - self.shared_compliance * contact.force
        return AdhesiveContact(a, delta, contact.force)

    def _stronger_contact(self, force: float) -> AdhesiveContact:
        """Return the stable equilibrium of the stronger contact at a force [F]."""
        pull_off = self._stronger.pull_off(math.inf)
        # With equal contacts round-off may exceed the pull-off force.
        return self._stronger.stable_equilibrium(force, math.inf) or pull_off

    def _largest_radius(self) -> float:
        """Return the largest radius of the weaker contact that both contacts reach [L]."""
        largest_force = self._stronger.equilibrium_at(self._stronger.max_radius).force
        with contextlib.suppress(ValueError):
            # The factor keeps the search inside the range of the stronger contact.
            contact = self._weaker.stable_equilibrium(0.999 * largest_force, math.inf)
            return contact.a if contact else self._weaker.max_radius
        return self._weaker.max_radius
