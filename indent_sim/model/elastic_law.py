"""Base classes of the elastic laws, with displacement and mixed (displacement-pressure) energies.

A material is a frozen dataclass with its constants. UFL differentiates its strain energy density:
`energy` as a function of the displacement gradient H (3x3), or `mixed_energy`, in which a
pressure-like field q replaces the volumetric stiffness (at the solution q = lame_lambda tr eps, or
lame_lambda ln J, or kappa ln J - k (I1 - 3)), so that nu = 0.5 is allowed. Constants may be floats
or UFL constants.
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
from indent_sim.model.plasticity import Plasticity
from indent_sim.model.pore_flow import Flow
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.units import (
    AnyModulus,
    Modulus,
    PoissonRatio,
)

Formulation = Literal["auto", "displacement", "mixed"]


class Constants(NamedTuple):
    """Young's modulus E [pressure] and Poisson's ratio nu at small strain."""

    E: float
    nu: float

    @property
    def E_star(self) -> float:
        """Plane-strain modulus E/(1 - nu^2) [pressure]."""
        return self.E / (1 - self.nu * self.nu)


class ElasticLaw(ABC):
    """Base class of all elastic laws.

    The class implements all properties that follow from the small-strain constants E and nu and
    from a strain energy density psi = remaining energy + stiffness theta^2/2 with a volume measure
    theta.
    """

    is_small_strain: ClassVar[bool] = False
    is_isotropic: ClassVar[bool] = True
    relaxation: Relaxation | None
    flow: Flow | None

    @property
    def plasticity(self) -> Plasticity | None:
        """Yield and hardening of the law; None if it does not yield."""
        return None

    @property
    def has_shear_relaxation(self) -> bool:
        """True if the shear modulus relaxes and the bulk modulus does not."""
        return self.relaxation is not None and self.relaxation.of == "shear"

    @property
    def is_time_dependent(self) -> bool:
        """True if the response changes with time, other than by a common factor of all moduli."""
        return self.flow is not None or self.has_shear_relaxation or self.creeps

    @property
    def creeps(self) -> bool:
        """True if plastic flow depends on the rate."""
        return self.plasticity is not None and self.plasticity.creep is not None

    @property
    @abstractmethod
    def constants(self) -> Constants:
        """Small-strain E [pressure] and nu."""

    @property
    def decay_rates(self) -> tuple[float, float]:
        """Decay rates Re s of the two solutions exp(-k s z) below the surface, smaller first.

        k is the wavenumber of the pressure along the surface; both are 1 if the law is isotropic.
        """
        return 1.0, 1.0

    @property
    def E_star(self) -> float:
        """Small-strain plane-strain modulus E/(1 - nu^2) [pressure]."""
        return self.constants.E_star

    def relaxed_constants(self, shear_fraction: float) -> Constants:
        """Return the small-strain constants after relaxation at constant bulk modulus.

        Parameters
        ----------
        shear_fraction : float
            Remaining fraction of the shear modulus mu.

        Returns
        -------
        Constants
            E = 9 kappa mu'/(3 kappa + mu') [pressure] and nu = (3 kappa - 2 mu')/(2 (3 kappa +
            mu')) with mu' = shear_fraction mu: the smaller mu', the nearer nu is to 1/2.
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
        """Small-strain modulus M_c [pressure] in uniaxial strain.

        M_c = E (1 - nu)/((1 + nu)(1 - 2 nu)); infinite if incompressible.
        """
        E, nu = self.constants
        return E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) if nu < 0.5 else math.inf

    def bar_modulus(self, confined_directions: int) -> float:
        """Return the small-strain modulus [pressure] of a bar along z, free or laterally confined.

        `confined_directions` is the number of directions across the bar (0, 1 or 2) in which it
        cannot expand; the modulus is E, E/(1 - nu^2) or M_c.
        """
        return (self.constants.E, self.E_star, self.confined_modulus)[confined_directions]

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """Return psi [pressure] at finite strain for principal stretches (floats).

        The product of the stretches must be 1 if the law is incompressible. Raises TypeError for a
        small-strain law.
        """
        raise TypeError(f"{type(self).__name__} has no energy of finite stretches")

    @property
    def diffusivity(self) -> float:
        """Small-strain diffusivity D [length^2/time] of the pore pressure.

        D = permeability/(storage + alpha^2/M_c) with the `confined_modulus` M_c.

        The flow must be given by its permeability (`flow_by_permeability`).
        """
        assert self.flow and self.flow.permeability
        return self.flow.permeability / (
            self.flow.storage + self.flow.alpha**2 / self.confined_modulus
        )

    @property
    def flow_by_permeability(self) -> Flow | None:
        """Flow defined by its permeability, or None; raises the errors of `Flow.canonical`."""
        return self.flow and self.flow.canonical(self.confined_modulus)

    def volume_growth(self, H: Expr) -> Expr:
        """Return the volume change per undeformed volume: tr eps at small strain, otherwise J - 1.

        The formula loses no digits where H is small.
        """
        return ufl.tr(H) if self.is_small_strain else ufl.tr(H) + nonlinear_volume_growth(H)

    def fluid_content(self, H: Expr, p: Expr) -> Expr:
        """Return the fluid content zeta = alpha e + storage p per undeformed volume.

        p [pressure] is the pore pressure minus the pore pressure of the undeformed body.
        """
        assert self.flow
        return self.flow.alpha * self.volume_growth(H) + self.flow.storage * p

    def swelling_ratio(self, J: Expr) -> Expr:
        """Return the ratio of the volume to the dry volume; J for a law without swelling."""
        return J

    def nominal_permeability(self, H: Expr) -> Expr:
        """Return the nominal permeability m (3 x 3) of the nominal fluid flux -m grad p.

        m [length^2/(pressure time)] is the permeability at small strain; at finite strain it is J
        k(J) F^-1 F^-T with the permeability k(J) of the deformed body.
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
        """Return the permeability of the deformed body divided by that of the undeformed body."""
        return (
            self.flow.holmes_mow.permeability_ratio(J) if self.flow and self.flow.holmes_mow else 1
        )

    def bath_pressure(self, bath: float) -> float:
        """Return the pressure [pressure] of a bath relative to the bath of the undeformed body."""
        return bath

    @property
    @abstractmethod
    def volumetric_compliance(self) -> Expr:
        """Inverse 1/stiffness [1/pressure] of the volumetric stiffness; 0 if incompressible."""

    @abstractmethod
    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return the energy [pressure] without the volumetric part, and theta (tr eps or ln J)."""

    def energy(self, H: Expr) -> Expr:
        """Return psi [pressure] of the displacement gradient H (3 x 3)."""
        remaining_energy, theta = self.energy_parts(H)
        return remaining_energy + theta**2 / (2 * self.volumetric_compliance)

    def mixed_energy(self, H: Expr, q: Expr) -> Expr:
        """Return the energy [pressure] of the mixed formulation with the pressure-like field q.

        The volumetric part is q theta - q^2/(2 stiffness) in place of stiffness theta^2/2.
        """
        remaining_energy, theta = self.energy_parts(H)
        return remaining_energy + q * theta - q * q * self.volumetric_compliance / 2


@dataclass(frozen=True)
class TwoConstantLaw(ElasticLaw):
    """Base class of isotropic laws that are defined by any two elastic constants.

    The constants are E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure].
    """

    E: Modulus | None = None
    nu: PoissonRatio | None = None
    mu: Modulus | None = None
    kappa: Modulus | None = None
    lame_lambda: AnyModulus | None = None
    formulation: Formulation = "auto"
    relaxation: Relaxation | None = None
    flow: Flow | None = None

    def canonical(self) -> Self:
        """Return the same material defined by E and nu.

        Raises ValueError unless exactly two constants are given.
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
        """Young's modulus and Poisson's ratio; they must be the given constants (`canonical`)."""
        assert self.E is not None and self.nu is not None
        return Constants(self.E, self.nu)

    @property
    def shear_modulus(self) -> Expr:
        """Shear modulus mu = E / (2 (1 + nu)) [pressure]."""
        return self.E / (2 * (1 + self.nu))  # type: ignore[operator]

    @property
    def volumetric_compliance(self) -> Expr:
        """Inverse 1/lame_lambda = (1 + nu)(1 - 2 nu)/(E nu) [1/pressure]; 0 if incompressible."""
        return (1 + self.nu) * (1 - 2 * self.nu) / (self.E * self.nu)  # type: ignore[operator]
