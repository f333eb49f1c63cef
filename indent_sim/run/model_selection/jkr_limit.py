"""JKR limit of a scene: force at the largest depth for any work of adhesion."""

from __future__ import annotations

from indent_sim.scene.scene import Scene
from indent_sim.theory.adhesion import Jkr
from indent_sim.theory.layer import Layer
from indent_sim.theory.punches import LayerPunches
from indent_sim.theory.roots import increasing_root


class JkrLimit:
    """JKR limit of a scene that is solved by the layer theory."""

    def __init__(self, scene: Scene, contact: Layer):
        self._delta = scene.physics.deltas[-1]
        self._work_unit = scene.physics.scales.pressure * scene.physics.scales.length
        self._punches = LayerPunches(contact)
        self._nonadhesive = contact.solutions_at_depths([self._delta])[0]

    def force_ratio(self, work: float) -> float:
        """Return the force with a work of adhesion divided by the force without it."""
        jkr = Jkr(self._punches, work / self._work_unit)
        # The search for the contact radius with adhesion begins at the radius without adhesion,
        # increased by this fraction.
        radius_margin = 1e-3
        # Smallest depth of that search, as a fraction of the prescribed depth.
        min_depth_fraction = 1e-6
        # The contact radius of the stable equilibrium is larger than that without adhesion.
        radius = increasing_root(
            lambda a: max(jkr.equilibrium_at(a).delta, min_depth_fraction * self._delta),
            self._delta,
            self._nonadhesive.a * (1 + radius_margin),
            self._punches.max_radius,
        )
        return jkr.equilibrium_at(radius).force / self._nonadhesive.force

    def work_of_force(self, fraction: float) -> float:
        """Return the work of adhesion `fraction` * (force/contact radius) [force/length]."""
        return fraction * self._nonadhesive.force * self._work_unit / self._nonadhesive.a
