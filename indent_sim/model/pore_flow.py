"""Fluid flow through the pores of an elastic solid (Biot's poroelasticity)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Self

from annotated_types import Ge, Gt, Le, Lt

from indent_sim.model.algebra import (
    Expr,
    exp,
)
from indent_sim.model.units import (
    Unit,
)


@dataclass(frozen=True)
class HolmesMow:
    """Permeability of pores that close as the volume shrinks.

    k(J)/k(1) = ((J - phi0)/(1 - phi0))^alpha exp(M (J^2 - 1)/2), where phi0 is the volume fraction
    of the solid in the undeformed body (Holmes & Mow 1990, J. Biomech. 23, 1145).
    """

    phi0: Annotated[float, Ge(0), Lt(1)]
    alpha: Annotated[float, Ge(0)] = 0.0
    M: Annotated[float, Ge(0)] = 0.0

    def permeability_ratio(self, J: Expr) -> Expr:
        """Return k(J)/k(1) at the volume ratio J; NaN where J <= phi0, because no pore is left."""
        return ((J - self.phi0) / (1 - self.phi0)) ** self.alpha * exp(self.M * (J * J - 1) / 2)


@dataclass(frozen=True)
class Flow:
    """Pore fluid of a material whose elastic law has the drained constants (Biot 1941).

    The fluid content per volume is zeta = alpha tr eps + storage p with zeta' = div(permeability
    grad p).

    Attributes
    ----------
    permeability
        Permeability of the pores over the viscosity of the fluid [length^2/(pressure time)].
    diffusivity
        Alternative to `permeability`: diffusivity of the pore pressure in the laterally confined
        body, permeability/(storage + alpha^2/M_c) [length^2/time].
    alpha
        Biot's coefficient [1]; 1 where the grains are incompressible.
    storage
        Specific storage [1/pressure]; 0 where grains and fluid are incompressible.
    holmes_mow
        Change of the permeability at finite strain; if None, the permeability of the deformed body
        is constant.
    """

    permeability: Annotated[float, Gt(0), Unit("length^2/(pressure time)")] | None = None
    diffusivity: Annotated[float, Gt(0), Unit("length^2/time")] | None = None
    alpha: Annotated[float, Gt(0), Le(1)] = 1.0
    storage: Annotated[float, Ge(0), Unit("1/pressure")] = 0.0
    holmes_mow: HolmesMow | None = None

    def canonical(self, confined_modulus: float) -> Self:
        """Return the same flow, defined by the permeability instead of the diffusivity.

        Parameters
        ----------
        confined_modulus : float
            Modulus M_c [pressure] of the drained body in uniaxial strain.

        Raises
        ------
        ValueError
            If both or neither of permeability and diffusivity are given, or M_c is infinite (nu =
            0.5).
        """
        if (self.permeability is None) == (self.diffusivity is None):
            raise ValueError("flow needs exactly one of permeability and diffusivity")
        if not math.isfinite(confined_modulus):
            raise ValueError("nu (drained) must be < 0.5: an incompressible body cannot drain")
        if self.diffusivity is None:
            return self
        permeability = self.diffusivity * (self.storage + self.alpha**2 / confined_modulus)
        return replace(self, permeability=permeability, diffusivity=None)
