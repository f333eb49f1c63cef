"""Plasticity of metals and glasses: von Mises yield with isotropic hardening.

The yield stress sigma(alpha) grows with the equivalent plastic strain alpha. With the trial von
Mises stress q of an increment, the stress without plastic flow, the plastic strain increment d is
zero while q <= sigma(alpha), and otherwise the root of

    q - 3 mu d = sigma(alpha + d).

With `creep` the stress under which the body flows also depends on the rate of the plastic strain,

    q - 3 mu d = sigma(alpha + d) (1 + s),    s = (d/(rate dt))^m,

in a time increment dt by the backward Euler method.

With logarithmic strains this radial return holds at finite strain as at small strain. Source: Simo
& Hughes (1998), Computational Inelasticity, boxes 3.1 and 9.1; Weber & Anand (1990), Comput.
Methods Appl. Mech. Eng. 79, 173; Perzyna (1966), Adv. Appl. Mech. 9, 243.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from annotated_types import Ge, Gt, Le, Lt

from indent_sim.model.algebra import Expr, exp, macaulay, maximum, minimum
from indent_sim.model.units import PRESSURE, Modulus, Unit

# Number of Newton iterations for the plastic strain increment of a nonlinear hardening law. The
# increment is then accurate to round-off if the hardening modulus is smaller than Young's modulus.
# Checked: tests/unit/model/test_plasticity.py.
INCREMENT_ITERATIONS = 4
# The same for the overstress of a body that creeps.
# Checked: tests/unit/model/test_plasticity.py.
CREEP_ITERATIONS = 10
# Least strain rate dt of a time increment: in a sudden change of the load nothing creeps.
MIN_CREEP_STRAIN = 1e-200


@dataclass(frozen=True)
class Voce:
    """Saturating hardening, rise (1 - exp(-alpha/strain)) in addition to the yield stress."""

    rise: Modulus
    strain: Annotated[float, Gt(0)]


# Laws of hardening, by the keys that give them.
HARDENING_LAWS = ("n", "linear", "voce")
Exponent = Annotated[float, Ge(0), Lt(1)]
HardeningModulus = Annotated[float, Ge(0), PRESSURE]


@dataclass(frozen=True)
class Hardening:
    """Growth of the yield stress with the equivalent plastic strain alpha; one law is given.

    `n` is the power law yield_stress (1 + E alpha/yield_stress)^n, `linear` gives yield_stress +
    linear alpha, and `voce` gives yield_stress + rise (1 - exp(-alpha/strain)).
    """

    n: Exponent | None = None
    linear: HardeningModulus | None = None
    voce: Voce | None = None

    @property
    def laws(self) -> tuple[str, ...]:
        """Keys of the given laws; a valid hardening has exactly one law."""
        return tuple(name for name in HARDENING_LAWS if getattr(self, name) is not None)


@dataclass(frozen=True)
class Creep:
    """Rate-dependent flow (Perzyna): the flow stress is sigma(alpha) (1 + (alpha'/rate)^m).

    alpha' is the rate of the equivalent plastic strain, `rate` [1/time] is the rate at which the
    flow stress is twice the yield stress sigma(alpha) of slow loading, and m is the rate
    sensitivity.
    """

    rate: Annotated[float, Gt(0), Unit("1/time")]
    m: Annotated[float, Ge(0.01), Le(1)]


class FlowIncrement(NamedTuple):
    """Plastic flow in an increment of load or time.

    Attributes
    ----------
    strain : Expr
        Increment d >= 0 of the equivalent plastic strain.
    compliance : Expr
        Derivative of d with respect to the trial von Mises stress [1/pressure], where d > 0.
    viscous_work : Expr
        Work per volume of the overstress [pressure]; zero without creep.
    """

    strain: Expr
    compliance: Expr
    viscous_work: Expr


@dataclass(frozen=True)
class Plasticity:
    """Von Mises yield with isotropic hardening, for the equivalent plastic strain alpha.

    With the yield stress `yield_stress` alone the body is perfectly plastic; with `hardening` the
    yield stress grows. The keys `n`, `linear` and `voce` beside the yield stress are short forms of
    `hardening` with this law. With `creep` the body flows with time under a stress above the yield
    stress.
    """

    yield_stress: Modulus
    hardening: Hardening | None = None
    n: Exponent | None = None
    linear: HardeningModulus | None = None
    voce: Voce | None = None
    creep: Creep | None = None

    def __post_init__(self) -> None:
        """Replace the short form by the equivalent `hardening`."""
        short = {name: getattr(self, name) for name in self.short_laws}
        if self.hardening is not None or len(short) != 1:
            return
        object.__setattr__(self, "hardening", Hardening(**short))
        for name in short:
            object.__setattr__(self, name, None)

    @property
    def short_laws(self) -> tuple[str, ...]:
        """Keys of laws in the short form, which the initialisation replaces by `hardening`."""
        return tuple(name for name in HARDENING_LAWS if getattr(self, name) is not None)

    def flow_stress(self, alpha: Expr, E: Expr) -> Expr:
        """Return the yield stress sigma(alpha) [pressure] at an equivalent plastic strain."""
        law = self.hardening or Hardening()
        if law.n is not None:
            return self.yield_stress * (1 + E * alpha / self.yield_stress) ** law.n
        if law.linear is not None:
            return self.yield_stress + law.linear * alpha
        if law.voce is not None:
            return self.yield_stress + law.voce.rise * (1 - exp(-alpha / law.voce.strain))
        return self.yield_stress + 0.0 * alpha

    def hardening_modulus(self, alpha: Expr, E: Expr) -> Expr:
        """Return the derivative dsigma/dalpha [pressure]."""
        law = self.hardening or Hardening()
        if law.n is not None:
            return law.n * E * (1 + E * alpha / self.yield_stress) ** (law.n - 1)
        if law.linear is not None:
            return law.linear + 0.0 * alpha
        if law.voce is not None:
            return law.voce.rise / law.voce.strain * exp(-alpha / law.voce.strain)
        return 0.0 * alpha

    def plastic_work(self, alpha: Expr, E: Expr) -> Expr:
        """Return the work per volume [pressure] of plastic flow up to alpha: int sigma dalpha."""
        law = self.hardening or Hardening()
        if law.n is not None:
            base = 1 + E * alpha / self.yield_stress
            return self.yield_stress**2 / (E * (1 + law.n)) * (base ** (law.n + 1) - 1)
        work = self.yield_stress * alpha
        if law.linear is not None:
            return work + law.linear * alpha * alpha / 2
        if law.voce is not None:
            strain = law.voce.strain
            return work + law.voce.rise * (alpha - strain * (1 - exp(-alpha / strain)))
        return work

    def flow_increment(
        self, q: Expr, alpha: Expr, mu: Expr, E: Expr, dt: Expr = 0.0
    ) -> FlowIncrement:
        """Return the plastic flow in an increment of load or time.

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
        dt : Expr
            Duration of the increment [time], only used with `creep`.
        """
        if self.creep:
            return self._creep_increment(q, alpha, mu, E, dt)
        start_stress = self.flow_stress(alpha, E)
        excess = macaulay(q - start_stress)
        law = self.hardening or Hardening()
        if law.n is None and law.voce is None:
            compliance = 1 / (3 * mu + self.hardening_modulus(alpha, E))
            return FlowIncrement(excess * compliance, compliance, 0.0 * excess)
        # The increment without hardening is too large. From there Newton's method converges
        # monotonically after its first step, because sigma is concave.
        d = excess / (3 * mu)
        for _ in range(INCREMENT_ITERATIONS):
            rise = self.flow_stress(alpha + d, E) - start_stress
            slope = 3 * mu + self.hardening_modulus(alpha + d, E)
            d = d + (excess - 3 * mu * d - rise) / slope
        return FlowIncrement(d, 1 / (3 * mu + self.hardening_modulus(alpha + d, E)), 0.0 * excess)

    def _creep_increment(self, q: Expr, alpha: Expr, mu: Expr, E: Expr, dt: Expr) -> FlowIncrement:
        """Return the plastic flow with creep; the parameters are those of `flow_increment`.

        The overstress s is the unknown: with d = rate dt s^(1/m) it is the root of
        3 mu d + sigma(alpha + d) (1 + s) = q, or zero below the yield stress.
        """
        assert self.creep
        exponent = 1 / self.creep.m
        creep_strain = maximum(self.creep.rate * dt, 0.0 * dt + MIN_CREEP_STRAIN)
        start_stress = self.flow_stress(alpha, E)
        excess = macaulay(q - start_stress)
        # Either term alone would need a larger s. From the smaller of both values Newton's method
        # decreases monotonically, because the left side is convex, or nearly so.
        s = minimum(excess / start_stress, (excess / (3 * mu * creep_strain)) ** self.creep.m)
        for _ in range(CREEP_ITERATIONS):
            d = creep_strain * s**exponent
            strain_slope = exponent * creep_strain * s ** (exponent - 1)
            stress = self.flow_stress(alpha + d, E)
            residual = 3 * mu * d + (stress - start_stress) + stress * s - excess
            modulus = 3 * mu + self.hardening_modulus(alpha + d, E) * (1 + s)
            s = macaulay(s - residual / (stress + modulus * strain_slope))
        # The bound only matters for trial states far from equilibrium, with a hundred times the
        # yield stress, where the iterations may not have converged.
        d = minimum(creep_strain * s**exponent, excess / (3 * mu))
        strain_slope = exponent * creep_strain * s ** (exponent - 1)
        stress = self.flow_stress(alpha + d, E)
        modulus = 3 * mu + self.hardening_modulus(alpha + d, E) * (1 + s)
        return FlowIncrement(d, strain_slope / (stress + modulus * strain_slope), stress * s * d)
