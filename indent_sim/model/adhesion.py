"""Adhesion over a range: attraction of tip and body across the gap."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Annotated

from annotated_types import Gt

from indent_sim.model.algebra import Expr, exp, macaulay
from indent_sim.model.units import ADHESION, LengthOrZero


@dataclass(frozen=True)
class Adhesion:
    """Attraction sigma = (work/range) exp(-g/range) [pressure] across the gap g.

    The integral over the gap is the work of adhesion. A scene that gives no range is rejected, and
    the message names the smallest range that the mesh resolves. The limit of zero range (JKR) is
    `experiment.adhesion`.
    """

    work: Annotated[float, Gt(0), ADHESION]
    range: LengthOrZero | None = None

    @property
    def _interaction_range(self) -> Expr:
        """Range of the attraction [length], which must be given when this property is used."""
        return self.range

    def energy(self, g: Expr) -> Expr:
        """Return the energy of the attraction per area [pressure length], which is negative.

        gamma(g) = -work exp(-<g>/range) - (work/range) <-g>.
        """
        open_gap = macaulay(g)
        interaction_range = self._interaction_range
        return self.work * ((g - open_gap) / interaction_range - exp(-open_gap / interaction_range))

    def attraction(self, g: Expr) -> Expr:
        """Return sigma(g) = (work/range) exp(-<g>/range) [pressure], >= 0.

        The attraction is constant for g < 0.
        """
        return self.work / self._interaction_range * exp(-macaulay(g) / self._interaction_range)

    def cohesive_zone(self, E_star: float) -> float:
        """Return the width l = (pi/4) E* range^2/work [length] of the cohesive zone.

        The cohesive zone is the ring outside the contact edge in which the tip attracts the
        surface.
        """
        return float(pi / 4 * E_star * self._interaction_range**2 / self.work)

    def range_for_cohesive_zone(self, cohesive_zone: float, E_star: float) -> float:
        """Return the range [length] for which the cohesive zone has a given width [length]."""
        return (4 / pi * self.work * cohesive_zone / E_star) ** 0.5
