"""Contact laws: every method is a choice of the multiplier in one potential.

With p_hat = lam - epsilon_n g the contact term of the potential is

    1/(2 epsilon_n) ( <p_hat>^2 - lam^2 )   per unit contact area,

its derivative is the traction <p_hat> along the tip's normal, and <p_hat> >= 0 is the pressure
(signs: gap g >= 0 open, lam >= 0 a pressure, so lam = -lambda of the notes).

A tip that adheres adds gamma(g) = -work exp(-g/range) for g > 0, continued straight for g < 0: the
traction is then <p_hat> - sigma with sigma = dgamma/dg >= 0 [pressure], and lam is the pressure of
contact alone, on top of -sigma.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le

from indent_sim.model.adhesion import Adhesion
from indent_sim.model.algebra import Expr, macaulay
from indent_sim.model.units import Auto, ContactStiffness

Gap = Literal["auto", "reference", "current"]
Multiplier = Literal["none", "unknown", "frozen", "stress", "nodal"]
Friction = (
    Annotated[float, Ge(0), Le(5)] | Literal["stick"]
)  # Coulomb's coefficient; stick: no slip at all
# Where a point that comes into contact during a step is taken to have touched the tip: at its place
# at the step's beginning (too stiff), nowhere before the end (too soft), or on the way between,
# which the other two enclose.
SlipReference = Literal["implicit", "glue", "mid"]
NO_ELASTIC_CURVE = "friction, or adhesion over a range: no curve determines it"


class _ContactLaw:
    """What is asked of every law."""

    friction: Expr = 0.0
    epsilon_t: Expr = "auto"
    adhesion: Adhesion | None = None

    @property
    def is_conservative(self) -> bool:
        """Whether the contact has a potential: not with friction."""
        return not self.friction

    @property
    def is_bonded(self) -> bool:
        """Whether nothing that touches slips."""
        return self.friction == "stick"

    @property
    def may_snap_through(self) -> bool:
        """Whether two equilibria may be stable at one depth: of a tip that adheres."""
        return self.adhesion is not None

    @property
    def is_path_dependent(self) -> bool:
        """Whether an equilibrium depends on the path to it."""
        return self.may_snap_through or not self.is_conservative

    @property
    def remedies(self) -> tuple[str, ...]:
        """Other keys of it that may help where no equilibrium is found."""
        has_own_stiffness = not self.is_conservative and self.epsilon_t != getattr(
            self, "stiffness", None
        )
        return (
            *(["contact.epsilon_t: auto"] * has_own_stiffness),
            *(["contact.friction: 5"] * self.is_bonded),
        )

    @property
    def may_slip(self) -> bool:
        """Whether what touches may slip, and lose what that takes."""
        return not (self.is_conservative or self.is_bonded)

    @property
    def path_key(self) -> str:
        """The key that makes it depend on the path: friction | adhesion, which are not given both;
        "" for none.
        """
        return next((name for name in ("friction", "adhesion") if getattr(self, name)), "")

    @property
    def feature_without_theory(self) -> str:
        """What it has that no theory knows, in words; "" for nothing."""
        return {"friction": "friction", "adhesion": "attraction with a range"}.get(
            self.path_key, ""
        )

    @property
    def reason_no_elastic_curve(self) -> str:
        """Why no elastic curve determines what it does in time; "" where one does."""
        return NO_ELASTIC_CURVE if self.path_key else ""

    @property
    def reason_unsymmetric(self) -> str:
        """Why its tangent is not symmetric and definite; "" where it is, or its multiplier alone is
        why.
        """
        effects = {
            "friction": "has a tangent that is not symmetric",
            "adhesion": "has a tangent that may be indefinite",
        }
        return f"{self.path_key} {effects[self.path_key]}" if self.path_key else ""

    @property
    def adhesion_range(self) -> float:
        """How far the tip attracts the surface across the gap [length]; 0 where it does not."""
        return (self.adhesion.range or 0.0) if self.adhesion else 0.0


@dataclass(frozen=True)
class AutoContact(_ContactLaw):
    """The program chooses the method and says why."""

    method: Literal["auto"] = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"
    adhesion: Adhesion | None = None


class _StiffnessLaw(_ContactLaw):
    """What the laws with a stiffness (epsilon_n or gamma, pressure per length) have in common."""

    method: str
    stiffness: Expr

    def trial_pressure(self, g: Expr, lam: Expr) -> Expr:
        """p_hat = lam - stiffness g [pressure]; its positive part is the pressure."""
        return lam - self.stiffness * g

    def potential(self, g: Expr, lam: Expr) -> Expr:
        """( <p_hat>^2 - lam^2 ) / (2 stiffness), and gamma(g) of a tip that adheres, per area
        [pressure length].
        """
        contact_energy = (macaulay(self.trial_pressure(g, lam)) ** 2 - lam * lam) / (
            2 * self.stiffness
        )
        return contact_energy + self.adhesion.energy(g) if self.adhesion else contact_energy

    @property
    def reason_not_condensable(self) -> str:
        """Why a condensed body, which has this potential written out, cannot have the law; "" where
        it can.
        """
        if self.may_snap_through:
            return "a tip that adheres is solved on the whole body"
        has_own_potential = type(self).potential is not _StiffnessLaw.potential
        return f"{self.method} has a potential of its own" if has_own_potential else ""


class _NormalStiffness(_StiffnessLaw):
    epsilon_n: Expr

    @property
    def stiffness(self) -> Expr:  # type: ignore[override]
        """epsilon_n [pressure per length]."""
        return self.epsilon_n


@dataclass(frozen=True)
class Penalty(_NormalStiffness):
    """p = epsilon_n <-g>: energy epsilon_n/2 <-g>^2 (notes 3.3-3.5); the tip penetrates by
    p/epsilon_n.
    """

    method: Literal["penalty"] = "penalty"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"

    multiplier: ClassVar[Multiplier] = "none"
    auto_stiffness_factor: ClassVar[float] = (
        100.0  # of E*/h_contact, at least: 0.1 % of the force on HERTZ
    )
    min_tangential_factor: ClassVar[float] = (
        0.1  # of E*/h_contact: below, four fifths of what friction adds are lost
    )

    @property
    def reason_not_condensable(self) -> str:
        """Of one that rubs, too: its traction along the surface is not written out."""
        friction_reason = (
            "" if self.is_conservative else "a penalty with friction is solved on the whole body"
        )
        return super().reason_not_condensable or friction_reason


@dataclass(frozen=True)
class AugmentedLagrangian(_NormalStiffness):
    """Displacement and multiplier together in one semismooth Newton (notes 3.6-3.7); epsilon_n only
    steers it, and so does epsilon_t what slides; where the surface sticks, what it adds to the
    force moves by 0.35 h_contact/a of itself per decade.
    """

    method: Literal["augmented_lagrangian"] = "augmented_lagrangian"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"
    adhesion: Adhesion | None = None

    multiplier: ClassVar[Multiplier] = "unknown"
    auto_stiffness_factor: ClassVar[float] = 1.0  # of E*/h_contact: the most accurate, measured
    # Below, steps fail or end in forces without friction: from 1e-4 on with Coulomb's law; cut back
    # from 1e-3 on
    min_tangential_factor: ClassVar[float] = 0.01


@dataclass(frozen=True)
class Uzawa(_NormalStiffness):
    """Newton with the multiplier frozen, then lam <- <lam - epsilon_n g>, until it stands still."""

    method: Literal["uzawa"] = "uzawa"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "frozen"
    auto_stiffness_factor: ClassVar[float] = (
        100.0  # of E*/h_contact: few loops; softer ones fail in deep bodies of nu = 0.5
    )


@dataclass(frozen=True)
class Nitsche(_StiffnessLaw):
    """The multiplier is the body's own contact stress, p = <-sigma_n(u) - gamma g>; no extra
    unknown. The variation of sigma_n is dropped (theta = 0).
    """

    method: Literal["nitsche"] = "nitsche"
    gamma: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "stress"
    auto_stiffness_factor: ClassVar[float] = (
        10.0  # of E*/h_contact: far enough above the smallest that works
    )
    # Without the variation of sigma_n nothing holds the tip back below about E*/h_contact. Measured
    # against the active set on the same mesh (HERTZ axisymmetric, strip and cube; nu 0.3, 0.48, and
    # 0.4999 mixed; 4 to 20 elements in a): from 1 on the force is within 0.2 %, at 0.3 it is up to
    # 1.3 % too high, at 0.1 up to 9 %, at 0.01 up to 37 %; each of them converges as willingly as
    # the right one. With 2 elements in a: 3 % at 1, 8 % at 0.3.
    min_stiffness_factor: ClassVar[float] = 1.0

    reason_not_condensable: ClassVar[str] = "Nitsche's method needs the stress inside the body"  # type: ignore[misc]

    @property
    def stiffness(self) -> Expr:  # type: ignore[override]
        """gamma [pressure per length]."""
        return self.gamma


@dataclass(frozen=True)
class ActiveSet(_ContactLaw):
    """Primal-dual active set on nodal pressures and weighted gaps: exact complementarity, no
    parameter.
    """

    method: Literal["active_set"] = "active_set"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "nodal"
    reason_not_condensable: ClassVar[str] = ""


ContactLaw = Penalty | AugmentedLagrangian | Uzawa | ActiveSet | Nitsche
Contact = AutoContact | Penalty | AugmentedLagrangian | Uzawa | ActiveSet | Nitsche
