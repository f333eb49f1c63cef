"""Flow of a fluid through the pores of an elastic law (Biot's poroelasticity)."""

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
    """Pores that close: permeability ((J - phi0)/(1 - phi0))^alpha exp(M (J^2 - 1)/2), with the
    solid's share phi0 of the volume at rest (Holmes & Mow 1990, J. Biomech. 23, 1145).
    """

    phi0: Annotated[float, Ge(0), Lt(1)]
    alpha: Annotated[float, Ge(0)] = 0.0
    M: Annotated[float, Ge(0)] = 0.0

    def permeability_ratio(self, J: Expr) -> Expr:
        """Of the permeability at rest, at a volume ratio J; not a number where no pore is left."""
        return ((J - self.phi0) / (1 - self.phi0)) ** self.alpha * exp(self.M * (J * J - 1) / 2)


@dataclass(frozen=True)
class Flow:
    """Fluid in the pores of a law whose own constants are those of the drained body (Biot 1941).

    Fluid content per volume zeta = alpha tr eps + storage p, zeta' = div(permeability grad p).
    `permeability`: that of the pores over the viscosity [length^2/(pressure time)]; or
    `diffusivity` [length^2/time], with which pressure evens out while the body is confined,
    permeability/(storage + alpha^2/M_c). alpha [1]: 1 where grains do not change their volume;
    storage [1/pressure]: 0 where, besides, the fluid does not. holmes_mow: how the permeability
    changes at finite strain; without it that of the deformed body stays what it is.
    """

    permeability: Annotated[float, Gt(0), Unit("length^2/(pressure time)")] | None = None
    diffusivity: Annotated[float, Gt(0), Unit("length^2/time")] | None = None
    alpha: Annotated[float, Gt(0), Le(1)] = 1.0
    storage: Annotated[float, Ge(0), Unit("1/pressure")] = 0.0
    holmes_mow: HolmesMow | None = None

    def canonical(self, confined_modulus: float) -> Self:
        """The same said by the permeability; ValueError when not exactly one way of saying it is
        used. confined_modulus: M_c of the drained body [pressure].
        """
        if (self.permeability is None) == (self.diffusivity is None):
            raise ValueError("flow needs exactly one of permeability, diffusivity")
        if not math.isfinite(confined_modulus):
            raise ValueError("nu = 0.5 leaves no pores to drain; give the drained nu, below 0.5")
        if self.diffusivity is None:
            return self
        permeability = self.diffusivity * (self.storage + self.alpha**2 / confined_modulus)
        return replace(self, permeability=permeability, diffusivity=None)
