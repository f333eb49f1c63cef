"""Contact laws: all methods use one potential and differ in the choice of the multiplier.

With p_hat = lam - epsilon_n g the contact term of the potential is

    1/(2 epsilon_n) ( <p_hat>^2 - lam^2 )   per unit contact area,

and its derivative is the traction <p_hat> along the tip's normal, where <p_hat> >= 0 is the contact
pressure (sign convention: gap g >= 0 open, lam >= 0 a pressure, so that lam = -lambda of the
notes).

Adhesion adds gamma(g) = -work exp(-g/range) for g > 0, continued linearly for g < 0. The traction
is then <p_hat> - sigma with sigma = dgamma/dg >= 0 [pressure]; lam is the contact pressure without
the attraction sigma.
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
# Coulomb's coefficient; stick: no slip at all.
# Largest coefficient of friction [-] of a scene; with it nearly every point sticks.
MAX_FRICTION = 5.0
Friction = Annotated[float, Ge(0), Le(MAX_FRICTION)] | Literal["stick"]
# Where a point that comes into contact during an increment sticks to the tip: at its position at
# the beginning of the increment (implicit, too stiff), not before the end (glue, too soft), or on
# the way (mid), which lies between the other two.
SlipReference = Literal["implicit", "glue", "mid"]


class _ContactLaw:
    """Base class of all contact laws, with the properties on which the choice of solver depends."""

    friction: Expr = 0.0
    epsilon_t: Expr = "auto"
    adhesion: Adhesion | None = None

    @property
    def is_conservative(self) -> bool:
        """True if the contact has a potential, that is, without friction."""
        return not self.friction

    @property
    def is_bonded(self) -> bool:
        """True if no point in contact can slip."""
        return self.friction == "stick"

    @property
    def may_snap_through(self) -> bool:
        """True if two stable equilibria may exist at one depth, as with adhesion."""
        return self.adhesion is not None

    @property
    def is_path_dependent(self) -> bool:
        """True if an equilibrium depends on the load path."""
        return self.may_snap_through or not self.is_conservative

    @property
    def remedies(self) -> tuple[str, ...]:
        """Settings of the contact that may help if Newton's method does not converge."""
        has_own_stiffness = not self.is_conservative and self.epsilon_t != getattr(
            self, "stiffness", None
        )
        return (
            *(["contact.epsilon_t: auto"] * has_own_stiffness),
            *([f"contact.friction: {MAX_FRICTION:g}"] * self.is_bonded),
        )

    @property
    def may_slip(self) -> bool:
        """True if points in contact may slip and dissipate energy."""
        return not (self.is_conservative or self.is_bonded)

    @property
    def path_key(self) -> str:
        """Key that makes the law path-dependent: "friction" or "adhesion".

        Only one of the two may be given. The result is "" if neither is given.
        """
        return next((name for name in ("friction", "adhesion") if getattr(self, name)), "")

    @property
    def feature_without_theory(self) -> str:
        """Description of a feature that no reference theory covers; "" without such a feature."""
        return {"friction": "friction", "adhesion": "adhesion with a range"}.get(self.path_key, "")

    @property
    def reason_no_elastic_curve(self) -> str:
        """Reason why a history cannot be computed from the elastic curve; "" if it can."""
        if not self.path_key:
            return ""
        return (
            "with friction, or adhesion over a range, the load curve does not determine the history"
        )

    @property
    def reason_unsymmetric(self) -> str:
        """Reason why the tangent is not symmetric and definite; "" if it is.

        An indefiniteness caused by a multiplier is not considered.
        """
        effects = {
            "friction": "has a tangent that is not symmetric",
            "adhesion": "has a tangent that may be indefinite",
        }
        return f"{self.path_key} {effects[self.path_key]}" if self.path_key else ""

    @property
    def adhesion_range(self) -> float:
        """Range of the attraction across the gap [length]; 0 without adhesion."""
        return (self.adhesion.range or 0.0) if self.adhesion else 0.0


@dataclass(frozen=True)
class AutoContact(_ContactLaw):
    """Contact whose method the program chooses (`method: auto`)."""

    method: Literal["auto"] = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"
    adhesion: Adhesion | None = None


class _StiffnessLaw(_ContactLaw):
    """Base class of the laws with a stiffness, epsilon_n or gamma [pressure/length]."""

    method: str
    stiffness: Expr

    def trial_pressure(self, g: Expr, lam: Expr) -> Expr:
        """Return p_hat = lam - stiffness g [pressure]; its positive part is the pressure."""
        return lam - self.stiffness * g

    def potential(self, g: Expr, lam: Expr) -> Expr:
        """Return the potential of the contact per area [pressure length].

        The potential is (<p_hat>^2 - lam^2)/(2 stiffness), plus gamma(g) with adhesion.
        """
        contact_energy = (macaulay(self.trial_pressure(g, lam)) ** 2 - lam * lam) / (
            2 * self.stiffness
        )
        return contact_energy + self.adhesion.energy(g) if self.adhesion else contact_energy

    @property
    def reason_not_condensable(self) -> str:
        """Reason why the law cannot be solved on a condensed body; "" if it can.

        The condensed solver implements only the potential of this class.
        """
        if self.may_snap_through:
            return "the condensed solver does not support adhesion with a range"
        if type(self).potential is not _StiffnessLaw.potential:
            return f"the condensed solver does not implement the contact potential of {self.method}"
        return ""


class _NormalStiffness(_StiffnessLaw):
    """Base class of the laws whose stiffness is epsilon_n."""

    epsilon_n: Expr

    @property
    def stiffness(self) -> Expr:  # type: ignore[override]
        """Penalty stiffness epsilon_n [pressure/length]."""
        return self.epsilon_n


@dataclass(frozen=True)
class Penalty(_NormalStiffness):
    """Penalty method: p = epsilon_n <-g>, with the energy epsilon_n/2 <-g>^2 (notes 3.3-3.5).

    The tip penetrates the body by p/epsilon_n.
    """

    method: Literal["penalty"] = "penalty"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"

    multiplier: ClassVar[Multiplier] = "none"
    # Smallest epsilon_n in units of E*/h_contact with `epsilon_n: auto`. The error of the force in
    # Hertz's problem is then 0.1 %.
    auto_stiffness_factor: ClassVar[float] = 100.0
    # Smallest epsilon_t in units of E*/h_contact; below it, four fifths of the force that friction
    # adds are lost.
    min_tangential_factor: ClassVar[float] = 0.1

    @property
    def reason_not_condensable(self) -> str:
        """Reason why the law cannot be solved on a condensed body; "" if it can.

        The reason may be friction, which the condensed solver does not support with a penalty.
        """
        friction_reason = (
            "" if self.is_conservative else "the condensed solver has no penalty with friction"
        )
        return super().reason_not_condensable or friction_reason


@dataclass(frozen=True)
class AugmentedLagrangian(_NormalStiffness):
    """Augmented Lagrangian: displacement and multiplier by one semismooth Newton method.

    Source: notes 3.6-3.7.

    epsilon_n affects only the convergence, as does epsilon_t at points that slip. Where the surface
    sticks, the force added by friction changes by a fraction of 0.35 h_contact/a per decade of
    epsilon_t.
    """

    method: Literal["augmented_lagrangian"] = "augmented_lagrangian"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"
    friction: Friction = 0.0
    epsilon_t: ContactStiffness | Auto = "auto"
    adhesion: Adhesion | None = None

    multiplier: ClassVar[Multiplier] = "unknown"
    # epsilon_n in units of E*/h_contact that was measured to be the most accurate.
    auto_stiffness_factor: ClassVar[float] = 1.0
    # Smallest epsilon_t in units of E*/h_contact. With Coulomb's law, increments are cut back at
    # 1e-3 and below; at 1e-4 and below they fail or converge to forces without friction.
    min_tangential_factor: ClassVar[float] = 0.01


@dataclass(frozen=True)
class Uzawa(_NormalStiffness):
    """Uzawa iteration: Newton's method with a fixed multiplier, then lam <- <lam - epsilon_n g>.

    Both steps are repeated until lam no longer changes.
    """

    method: Literal["uzawa"] = "uzawa"
    epsilon_n: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "frozen"
    # epsilon_n in units of E*/h_contact that needs few iterations; smaller ones fail in deep bodies
    # with nu = 0.5.
    auto_stiffness_factor: ClassVar[float] = 100.0


@dataclass(frozen=True)
class Nitsche(_StiffnessLaw):
    """Nitsche's method: the multiplier is the body's contact stress, p = <-sigma_n(u) - gamma g>.

    The method has no additional unknowns. The variation of sigma_n is dropped (theta = 0).
    """

    method: Literal["nitsche"] = "nitsche"
    gamma: ContactStiffness | Auto = "auto"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "stress"
    # gamma in units of E*/h_contact, ten times the smallest that is accurate.
    auto_stiffness_factor: ClassVar[float] = 10.0
    # Smallest gamma in units of E*/h_contact. With a smaller one the tip penetrates, because the
    # variation of sigma_n is dropped. Measured against the active set on the same mesh (Hertz's
    # problem axisymmetric, strip and cube; nu 0.3, 0.48, and 0.4999 mixed; 4 to 20 elements in a):
    # from 1 on the force is within 0.2 %, at 0.3 it is up to 1.3 % too high, at 0.1 up to 9 %, at
    # 0.01 up to 37 %; Newton's method converges equally well for all of them. With 2 elements in a
    # the force is 3 % too high at 1, and 8 % at 0.3.
    min_stiffness_factor: ClassVar[float] = 1.0

    reason_not_condensable: ClassVar[str] = (  # type: ignore[misc]
        "Nitsche's method needs the stress inside the body"
    )

    @property
    def stiffness(self) -> Expr:  # type: ignore[override]
        """Stabilization parameter gamma [pressure/length]."""
        return self.gamma


@dataclass(frozen=True)
class ActiveSet(_ContactLaw):
    """Primal-dual active set method with nodal pressures and weighted gaps.

    Complementarity holds exactly, and the method has no parameter.
    """

    method: Literal["active_set"] = "active_set"
    gap: Gap = "auto"

    multiplier: ClassVar[Multiplier] = "nodal"
    reason_not_condensable: ClassVar[str] = ""


ContactLaw = Penalty | AugmentedLagrangian | Uzawa | ActiveSet | Nitsche
Contact = AutoContact | Penalty | AugmentedLagrangian | Uzawa | ActiveSet | Nitsche
