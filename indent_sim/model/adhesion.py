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
    """An attraction across the gap g: sigma = (work/range) exp(-g/range) [pressure], whose integral
    is `work`. Without a range the smallest is named that the mesh resolves; 0 is the limit of
    `experiment.adhesion`.
    """

    work: Annotated[float, Gt(0), ADHESION]
    range: LengthOrZero | None = None

    @property
    def _interaction_range(self) -> Expr:
        return self.range

    def energy(self, g: Expr) -> Expr:
        """gamma(g) = -work exp(-<g>/range) - (work/range) <-g> per area [pressure length],
        negative.
        """
        open_gap = macaulay(g)
        interaction_range = self._interaction_range
        return self.work * ((g - open_gap) / interaction_range - exp(-open_gap / interaction_range))

    def attraction(self, g: Expr) -> Expr:
        """sigma(g) = (work/range) exp(-<g>/range) [pressure], >= 0, constant where the gap is
        closed.
        """
        return self.work / self._interaction_range * exp(-macaulay(g) / self._interaction_range)

    def cohesive_zone(self, E_star: float) -> float:
        """l = (pi/4) E* range^2/work [length]: how far the attraction reaches beside the edge of a
        contact.
        """
        return float(pi / 4 * E_star * self._interaction_range**2 / self.work)

    def range_for_cohesive_zone(self, cohesive_zone: float, E_star: float) -> float:
        """The range [length] that has this cohesive zone [length]."""
        return (4 / pi * self.work * cohesive_zone / E_star) ** 0.5
