"""Contact laws: every method is a choice of the multiplier in one potential.

With p_hat = lam - epsilon_n g the contact term of the potential is

    1/(2 epsilon_n) ( <p_hat>^2 - lam^2 )   per unit contact area,

its derivative is the traction <p_hat> along the tip's normal, and <p_hat> >= 0 is the pressure
(signs: gap g >= 0 open, lam >= 0 a pressure, so lam = -lambda of the notes).

A tip that adheres adds gamma(g) = -work exp(-g/range) for g > 0, continued straight for g < 0: the traction is then
<p_hat> - sigma with sigma = dgamma/dg >= 0 [pressure], and lam is the pressure of contact alone, on top of -sigma.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from indent_sim.model.algebra import exp, macaulay
from indent_sim.model.units import ADHESION, Auto, ContactStiffness, LengthOrZero

Gap = Literal["auto", "reference", "current"]
Multiplier = Literal["none", "unknown", "frozen", "stress", "nodal"]
Friction = Annotated[float, Ge(0), Le(5)] | Literal["stick"]  # Coulomb's coefficient; stick: no slip at all
# Where a point that comes into contact during a step is taken to have touched the tip: at its place at the step's
# beginning (too stiff), nowhere before the end (too soft), or on the way between, which the other two enclose.
Anchor = Literal["implicit", "glue", "mid"]


@dataclass(frozen=True)
class Cohesion:
    """An attraction across the gap g: sigma = (work/range) exp(-g/range) [pressure], whose integral is `work`.

    Without a range the smallest is named that the mesh resolves; 0 is the limit of `experiment.adhesion`.
    """

    work: Annotated[float, Gt(0), ADHESION]
    range: LengthOrZero | None = None

    @property
    def _reach(self) -> Any:
        return self.range

    def energy(self, g: Any) -> Any:
        """gamma(g) = -work exp(-<g>/range) - (work/range) <-g> per area [pressure length], negative."""
        opened, reach = macaulay(g), self._reach
        return self.work * ((g - opened) / reach - exp(-opened / reach))

    def pull(self, g: Any) -> Any:
        """sigma(g) = (work/range) exp(-<g>/range) [pressure], >= 0, constant where the gap is closed."""
        return self.work / self._reach * exp(-macaulay(g) / self._reach)

    def zone(self, E_star: float) -> float:
        """l = (pi/4) E* range^2/work [length]: how far the attraction reaches beside the edge of a contact."""
        return float(pi / 4 * E_star * self._reach**2 / self.work)

    def resolved_by(self, zone: float, E_star: float) -> float:
        """The range [length] that has this cohesive zone [length]."""
        return (4 / pi * self.work * zone / E_star) ** 0.5


@dataclass(frozen=True)
class AutoContact:
    """The program chooses the method and says why."""

    method: Literal["auto"] = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"
    adhesion: Cohesion | None = None


class _StiffnessLaw:
    """What the laws with a stiffness (epsilon_n or gamma, pressure per length) have in common."""

    method: str
    stiffness: Any
    friction: Any = 0.0
    epsilon_t: Any = "auto"
    adhesion: Any = None

    def trial_pressure(self, g: Any, lam: Any) -> Any:
        """p_hat = lam - stiffness g [pressure]; its positive part is the pressure."""
        return lam - self.stiffness * g

    def potential(self, g: Any, lam: Any) -> Any:
        """( <p_hat>^2 - lam^2 ) / (2 stiffness), and gamma(g) of a tip that adheres, per area [pressure length]."""
        pushed = (macaulay(self.trial_pressure(g, lam)) ** 2 - lam * lam) / (2 * self.stiffness)
        return pushed + self.adhesion.energy(g) if self.adhesion else pushed

    @property
    def uncondensed(self) -> str:
        """Why a condensed body, which has this potential written out, cannot have the law; "" where it can."""
        if self.adhesion:
            return "a tip that adheres is solved on the whole body"
        is_other = type(self).potential is not _StiffnessLaw.potential
        return f"{self.method} has a potential of its own" if is_other else ""


class _NormalStiffness(_StiffnessLaw):
    epsilon_n: Any

    @property
    def stiffness(self) -> Any:  # type: ignore[override]
        """epsilon_n [pressure per length]."""
        return self.epsilon_n


@dataclass(frozen=True)
class Penalty(_NormalStiffness):
    """p = epsilon_n <-g>: energy epsilon_n/2 <-g>^2 (notes 3.3-3.5); the tip penetrates by p/epsilon_n."""

    method: Literal["penalty"] = "penalty"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"

    multiplier: ClassVar[Multiplier] = "none"
    auto_multiple: ClassVar[float] = 100.0  # of E*/h_contact, at least: 0.1 % of the force on HERTZ
    smallest_tangential: ClassVar[float] = 0.1  # of E*/h_contact: below, four fifths of what friction adds are lost


@dataclass(frozen=True)
class AugmentedLagrangian(_NormalStiffness):
    """Displacement and multiplier together in one semismooth Newton (notes 3.6-3.7); epsilon_n only steers it, and so
    does epsilon_t what slides; where the surface sticks, what it adds to the force moves by 0.35 h_contact/a of itself
    per decade."""

    method: Literal["augmented_lagrangian"] = "augmented_lagrangian"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"
    adhesion: Cohesion | None = None

    multiplier: ClassVar[Multiplier] = "unknown"
    auto_multiple: ClassVar[float] = 1.0  # of E*/h_contact: the most accurate, measured
    # Below, steps fail or end in forces without friction: from 1e-4 on with Coulomb's law; cut back from 1e-3 on
    smallest_tangential: ClassVar[float] = 0.01


@dataclass(frozen=True)
class Uzawa(_NormalStiffness):
    """Newton with the multiplier frozen, then lam <- <lam - epsilon_n g>, until it stands still."""

    method: Literal["uzawa"] = "uzawa"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "frozen"
    auto_multiple: ClassVar[float] = 100.0  # of E*/h_contact: few loops; softer ones fail in deep bodies of nu = 0.5


@dataclass(frozen=True)
class Nitsche(_StiffnessLaw):
    """The multiplier is the body's own contact stress, p = <-sigma_n(u) - gamma g>; no extra unknown.

    The variation of sigma_n is dropped (theta = 0).
    """

    method: Literal["nitsche"] = "nitsche"
    gamma: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "stress"
    auto_multiple: ClassVar[float] = 10.0  # of E*/h_contact: far enough above the smallest that works
    # Without the variation of sigma_n nothing holds the tip back below about E*/h_contact. Measured against the active
    # set on the same mesh (HERTZ axisymmetric, strip and cube; nu 0.3, 0.48, and 0.4999 mixed; 4 to 20 elements in a):
    # from 1 on the force is within 0.2 %, at 0.3 it is up to 1.3 % too high, at 0.1 up to 9 %, at 0.01 up to 37 %;
    # each of them converges as willingly as the right one. With 2 elements in a: 3 % at 1, 8 % at 0.3.
    smallest_multiple: ClassVar[float] = 1.0

    uncondensed: ClassVar[str] = "Nitsche's method needs the stress inside the body"  # type: ignore[misc]

    @property
    def stiffness(self) -> Any:  # type: ignore[override]
        """gamma [pressure per length]."""
        return self.gamma


@dataclass(frozen=True)
class ActiveSet:
    """Primal-dual active set on nodal pressures and weighted gaps: exact complementarity, no parameter."""

    method: Literal["active_set"] = "active_set"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "nodal"
    uncondensed: ClassVar[str] = ""
    friction: ClassVar[float] = 0.0
    epsilon_t: ClassVar[Any] = "auto"
    adhesion: ClassVar[None] = None


ContactLaw = Penalty | AugmentedLagrangian | Uzawa | ActiveSet | Nitsche
Contact = AutoContact | Penalty | AugmentedLagrangian | Uzawa | ActiveSet | Nitsche
