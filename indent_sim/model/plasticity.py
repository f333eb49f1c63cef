"""Plasticity of metals and glasses: von Mises yield with isotropic hardening.

The yield stress sigma(alpha) grows with the equivalent plastic strain alpha. With the trial von
Mises stress q of an increment, which is that without plastic flow, the plastic strain increment d
is zero while q <= sigma(alpha), and otherwise the root of

    q - 3 mu d = sigma(alpha + d).

With logarithmic strains this radial return holds at finite strain as at small strain. Source: Simo
& Hughes (1998), Computational Inelasticity, boxes 3.1 and 9.1; Weber & Anand (1990), Comput.
Methods Appl. Mech. Eng. 79, 173.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Lt

from indent_sim.model.algebra import Expr, exp, macaulay
from indent_sim.model.units import PRESSURE, Modulus

# Newton iterations for the plastic strain increment of a nonlinear hardening law, after which it is
# right to round-off if the hardening modulus is below Young's (tests/unit/model/test_plasticity.py)
INCREMENT_ITERATIONS = 4


@dataclass(frozen=True)
class Voce:
    """Saturating hardening, rise (1 - exp(-alpha/strain)) in addition to the yield stress."""

    rise: Modulus
    strain: Annotated[float, Gt(0)]


@dataclass(frozen=True)
class Plasticity:
    """Von Mises yield with isotropic hardening, for the equivalent plastic strain alpha.

    The yield stress `yield_stress` alone is perfect plasticity. At most one hardening law is added:
    `n` for yield_stress (1 + E alpha/yield_stress)^n, `linear` for yield_stress + linear alpha, or
    `voce` for yield_stress + rise (1 - exp(-alpha/strain)).
    """

    yield_stress: Modulus
    n: Annotated[float, Ge(0), Lt(1)] | None = None
    linear: Annotated[float, Ge(0), PRESSURE] | None = None
    voce: Voce | None = None

    @property
    def hardening_laws(self) -> tuple[str, ...]:
        """Keys of the given hardening laws, of which there may be one at most."""
        return tuple(name for name in ("n", "linear", "voce") if getattr(self, name) is not None)

    def flow_stress(self, alpha: Expr, E: Expr) -> Expr:
        """Return the yield stress sigma(alpha) [pressure] at a plastic strain; E is Young's."""
        if self.n is not None:
            return self.yield_stress * (1 + E * alpha / self.yield_stress) ** self.n
        if self.linear is not None:
            return self.yield_stress + self.linear * alpha
        if self.voce is not None:
            return self.yield_stress + self.voce.rise * (1 - exp(-alpha / self.voce.strain))
        return self.yield_stress + 0.0 * alpha

    def hardening_modulus(self, alpha: Expr, E: Expr) -> Expr:
        """Return the derivative dsigma/dalpha [pressure]."""
        if self.n is not None:
            return self.n * E * (1 + E * alpha / self.yield_stress) ** (self.n - 1)
        if self.linear is not None:
            return self.linear + 0.0 * alpha
        if self.voce is not None:
            return self.voce.rise / self.voce.strain * exp(-alpha / self.voce.strain)
        return 0.0 * alpha

    def plastic_work(self, alpha: Expr, E: Expr) -> Expr:
        """Return the work per volume [pressure] of plastic flow up to alpha: int sigma dalpha."""
        if self.n is not None:
            base = 1 + E * alpha / self.yield_stress
            return self.yield_stress**2 / (E * (1 + self.n)) * (base ** (self.n + 1) - 1)
        work = self.yield_stress * alpha
        if self.linear is not None:
            return work + self.linear * alpha * alpha / 2
        if self.voce is not None:
            strain = self.voce.strain
            return work + self.voce.rise * (alpha - strain * (1 - exp(-alpha / strain)))
        return work

    def strain_increment(self, q: Expr, alpha: Expr, mu: Expr, E: Expr) -> Expr:
        """Return the plastic strain increment d >= 0 of an increment of load.

        Parameters
        ----------
        q : Expr
            Trial von Mises stress [pressure].
        alpha : Expr
            Equivalent plastic strain at the beginning of the increment.
        mu : Expr
            Shear modulus [pressure].
        E : Expr
            Young's modulus [pressure].
        """
        excess = macaulay(q - self.flow_stress(alpha, E))
        if self.n is None and self.voce is None:
            return excess / (3 * mu + self.hardening_modulus(alpha, E))
        # sigma is concave, so that Newton's method converges monotonically after one step from the
        # increment without hardening, which is too large.
        start_stress = self.flow_stress(alpha, E)
        d = excess / (3 * mu)
        for _ in range(INCREMENT_ITERATIONS):
            rise = self.flow_stress(alpha + d, E) - start_stress
            slope = 3 * mu + self.hardening_modulus(alpha + d, E)
            d = d + (excess - 3 * mu * d - rise) / slope
        return d
