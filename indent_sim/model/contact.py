"""Contact laws: every method is a choice of the multiplier in one potential.

With p_hat = lam - epsilon_n g the contact term of the potential is

    1/(2 epsilon_n) ( <p_hat>^2 - lam^2 )   per unit contact area,

its derivative is the traction <p_hat> along the tip's normal, and <p_hat> >= 0 is the pressure
(signs: gap g >= 0 open, lam >= 0 a pressure, so lam = -lambda of the notes).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from indent_sim.model.algebra import macaulay
from indent_sim.model.quantities import Auto, ContactStiffness

Gap = Literal["auto", "reference", "current"]


@dataclass(frozen=True)
class AutoContact:
    """The program chooses the method and says why."""

    method: Literal["auto"] = "auto"
    gap: Gap = "auto"


@dataclass(frozen=True)
class Penalty:
    """p = epsilon_n <-g>: energy epsilon_n/2 <-g>^2 (notes 3.3-3.5); the tip penetrates by p/epsilon_n."""

    method: Literal["penalty"] = "penalty"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"

    def trial_pressure(self, g: Any, lam: Any = 0.0) -> Any:
        """p_hat = -epsilon_n g [pressure]."""
        return -self.epsilon_n * g  # type: ignore[operator]

    def potential(self, g: Any, lam: Any = 0.0) -> Any:
        """Contact energy epsilon_n/2 <-g>^2 per area [pressure length]."""
        return macaulay(self.trial_pressure(g)) ** 2 / (2 * self.epsilon_n)  # type: ignore[operator]


Contact = AutoContact | Penalty
