"""Base classes of the elastic laws: strain energy densities that UFL differentiates.

A material is a frozen dataclass with its constants, an `energy` of the displacement gradient H
(3x3) and a `mixed_energy`, made of the same `energy_parts`, in which a pressure-like field q
replaces the volumetric stiffness (at the solution q = lame_lambda tr eps, or lame_lambda ln J, or
kappa ln J - k (I1 - 3)), so that nu = 0.5 is allowed. Constants may be floats or UFL constants.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple, Self

from indent_sim.model.algebra import (
    Expr,
    ufl,
)
from indent_sim.model.finite_strain import nonlinear_volume_growth
from indent_sim.model.isotropic_constants import ISOTROPIC_CONSTANTS, young_and_poisson
from indent_sim.model.pore_flow import Flow
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.units import (
    AnyModulus,
    Modulus,
    PoissonRatio,
)

Formulation = Literal["auto", "displacement", "mixed"]
LOCKING_POISSON_RATIO = (
    0.45  # Poisson's ratio from which displacement elements lock: see `docs/theory.md`
)


class Constants(NamedTuple):
    """Young's modulus E [pressure] and Poisson's ratio nu at small strain."""

    E: float
    nu: float

    @property
    def E_star(self) -> float:
        """Plane-strain modulus E/(1 - nu^2) [pressure]."""
        return self.E / (1 - self.nu * self.nu)


class ElasticLaw(ABC):
    """What follows from the small-strain constants E and nu of any law, and from psi = rest +
    stiffness theta^2/2.
    """

    is_small_strain: ClassVar[bool] = False
    is_isotropic: ClassVar[bool] = True
    is_conservative: ClassVar[bool] = (
        True  # the stress is the slope of an energy: strains that come back cost no work
    )
    is_path_dependent: ClassVar[bool] = (
        False  # the stress depends on the strains before as well as on the present one
    )
    relaxation: Relaxation | None
    flow: Flow | None

    @property
    def has_shear_relaxation(self) -> bool:
        """Whether its shear relaxes alone."""
        return self.relaxation is not None and self.relaxation.of == "shear"

    @property
    def is_time_dependent(self) -> bool:
        """Whether a body of it changes with time other than by one common factor."""
        return self.flow is not None or self.has_shear_relaxation

    @property
    @abstractmethod
    def constants(self) -> Constants:
        """Small-strain E [pressure] and nu."""

    @property
    def decay_rates(self) -> tuple[float, float]:
        """How fast the two waves exp(-k s z) of a surface pressure of wavenumber k fade, the slower
        first: Re s.
        """
        return 1.0, 1.0

    @property
    def E_star(self) -> float:
        """Small-strain plane-strain modulus E/(1 - nu^2) [pressure]."""
        return self.constants.E_star

    def relaxed_constants(self, shear_fraction: float) -> Constants:
        """Small-strain constants of which a share of the shear modulus is left, and all of the bulk
        modulus.

        Parameters
        ----------
        share : float
            Of the shear modulus mu; 1 leaves the constants as they are.

        Returns
        -------
        Constants
            E = 9 kappa mu'/(3 kappa + mu') [pressure] and nu = (3 kappa - 2 mu')/(2 (3 kappa + mu')),
            mu' = share mu: the less of mu is left, the nearer nu is to 1/2.
        """
        E, nu = self.constants
        if shear_fraction == 1 or nu == 0.5:
            return Constants(shear_fraction * E, nu)
        mu = shear_fraction * E / (2 * (1 + nu))
        kappa = E / (3 * (1 - 2 * nu))
        relaxed_nu = (3 * kappa - 2 * mu) / (2 * (3 * kappa + mu))
        return Constants(2 * mu * (1 + relaxed_nu), relaxed_nu)

    @property
    def confined_modulus(self) -> float:
        """Small-strain M_c = E (1 - nu)/((1 + nu)(1 - 2 nu)) [pressure] of a bar between rigid
        walls.
        """
        E, nu = self.constants
        return E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) if nu < 0.5 else math.inf

    def bar_modulus(self, confined_directions: int) -> float:
        """Small-strain modulus [pressure] of a bar along z that `confined_directions` of the two directions across
        it cannot leave: E, E/(1 - nu^2) or M_c.
        """
        return (self.constants.E, self.E_star, self.confined_modulus)[confined_directions]

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """psi [pressure] of principal stretches (floats) at finite strain; of an incompressible law
        their product is one. TypeError for a law of small strain.
        """
        raise TypeError(f"{type(self).__name__} knows no stretches")

    @property
    def diffusivity(self) -> float:
        """Small-strain D = permeability/(storage + alpha^2/M_c) [length^2/time] of its flow, said
        by permeability.
        """
        assert self.flow and self.flow.permeability
        return self.flow.permeability / (
            self.flow.storage + self.flow.alpha**2 / self.confined_modulus
        )

    @property
    def flow_by_permeability(self) -> Flow | None:
        """Its flow, said by the permeability; ValueError where it is not well said."""
        return self.flow and self.flow.canonical(self.confined_modulus)

    def volume_growth(self, H: Expr) -> Expr:
        """Growth e of the volume, per undeformed volume: tr eps at small strain, else J - 1, to all
        digits.
        """
        return ufl.tr(H) if self.is_small_strain else ufl.tr(H) + nonlinear_volume_growth(H)

    def fluid_content(self, H: Expr, p: Expr) -> Expr:
        """zeta = alpha e + storage p of the fluid per undeformed volume; p [pressure] from that at
        rest.
        """
        assert self.flow
        return self.flow.alpha * self.volume_growth(H) + self.flow.storage * p

    def swelling_ratio(self, J: Expr) -> Expr:
        """The volume over that of the dry body; J where nothing has swollen the body at rest."""
        return J

    def nominal_permeability(self, H: Expr) -> Expr:
        """m (3 x 3) [length^2/(pressure time)] of the nominal flux -m grad p: the permeability at
        small strain, else J k(J) F^-1 F^-T with that of the deformed body, k(J).
        """
        assert self.flow
        if self.is_small_strain:
            return self.flow.permeability * ufl.Identity(3)
        J = 1 + self.volume_growth(H)
        inverse_gradient = ufl.inv(ufl.Identity(3) + H)
        return (
            J
            * self.permeability_ratio(J)
            * self.flow.permeability
            * inverse_gradient
            * inverse_gradient.T
        )

    def permeability_ratio(self, J: Expr) -> Expr:
        """The permeability of the deformed body over that at rest."""
        return (
            self.flow.holmes_mow.permeability_ratio(J) if self.flow and self.flow.holmes_mow else 1
        )

    def bath_pressure(self, bath: float) -> float:
        """The pressure [pressure] of a bath above that at rest."""
        return bath

    @property
    @abstractmethod
    def volumetric_compliance(self) -> Expr:
        """1/stiffness [1/pressure] of the volume-like strain; 0 when incompressible."""

    @abstractmethod
    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """The energy without its volumetric part [pressure], and the volume-like strain theta: tr
        eps, or ln J.
        """

    def energy(self, H: Expr) -> Expr:
        """psi [pressure] of the displacement gradient H (3 x 3)."""
        remaining_energy, theta = self.energy_parts(H)
        return remaining_energy + theta**2 / (2 * self.volumetric_compliance)

    def mixed_energy(self, H: Expr, q: Expr) -> Expr:
        """The same with q theta - q^2/(2 stiffness) in place of stiffness theta^2/2 [pressure]."""
        remaining_energy, theta = self.energy_parts(H)
        return remaining_energy + q * theta - q * q * self.volumetric_compliance / 2


@dataclass(frozen=True)
class TwoConstantLaw(ElasticLaw):
    """Any two of E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure]."""

    E: Modulus | None = None
    nu: PoissonRatio | None = None
    mu: Modulus | None = None
    kappa: Modulus | None = None
    lame_lambda: AnyModulus | None = None
    formulation: Formulation = "auto"
    relaxation: Relaxation | None = None
    flow: Flow | None = None

    def canonical(self) -> Self:
        """The same material said by E and nu; ValueError when it is not said by exactly two
        constants.
        """
        given = {
            name: getattr(self, name)
            for name in ISOTROPIC_CONSTANTS
            if getattr(self, name) is not None
        }
        E, nu = young_and_poisson(given)
        material = replace(self, E=E, nu=nu, mu=None, kappa=None, lame_lambda=None)
        return replace(material, flow=material.flow_by_permeability)

    @property
    def constants(self) -> Constants:
        """E [pressure] and nu of a canonical material."""
        assert self.E is not None and self.nu is not None
        return Constants(self.E, self.nu)

    @property
    def shear_modulus(self) -> Expr:
        """mu = E / (2 (1 + nu)) [pressure]."""
        return self.E / (2 * (1 + self.nu))  # type: ignore[operator]

    @property
    def volumetric_compliance(self) -> Expr:
        """1/lame_lambda = (1 + nu)(1 - 2 nu)/(E nu) [1/pressure]; 0 when incompressible."""
        return (1 + self.nu) * (1 - 2 * self.nu) / (self.E * self.nu)  # type: ignore[operator]
