"""Stiffness continuation: factors by which the stiffness of a contact law is reduced.

The solution of a softer contact is the initial guess for a stiff one (Wriggers 2006, chapter 6.3).
"""

from __future__ import annotations

from math import ceil, log10
from typing import Any

from indent_sim.model.contact import ContactLaw
from indent_sim.scene.scene import Scene


def approach_factors(law: Any, scene: Scene) -> list[float]:
    """Return factors below 1, in half decades, that reduce the stiffness of a contact law.

    The smallest stiffness is 3 E*/h_contact, up to which Newton's method converges in a few
    iterations. The list is empty if the law is not stiffer than this.
    """
    excess = law.stiffness * scene.sizes.h_contact / scene.physics.material.E_star / 3.0
    step_count = max(1, round(2 * log10(excess))) if excess > 1 else 0
    return [excess ** (k / step_count - 1) for k in range(step_count)]


def stiffness_continuation(law: ContactLaw, scene: Scene) -> list[float]:
    """Return factors of the stiffness of a contact law, in decades up to 1.

    The first stiffness is at most 0.1 E*/h_contact, for which Newton's method converges from any
    state. The list is empty for a law without a stiffness.
    """
    stiffness = getattr(law, "stiffness", None)
    if stiffness is None:
        return []
    soft = 0.1 * scene.physics.material.E_star / scene.sizes.h_contact
    # Round-off in the quotient must not add a decade
    decades = max(1, ceil(log10(stiffness / soft) - 1e-9))
    return [10.0**-k for k in range(decades, -1, -1)]
