"""Drainage: the boundary conditions of the pore fluid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Len

from indent_sim.model.units import (
    PRESSURE,
    TIME,
    Auto,
    Unit,
    UnitRow,
)


@dataclass(frozen=True)
class Conductance:
    """Permeable surface with the flux q = conductance p [length/time].

    The pore pressure p is relative to the pressure of the bath.
    """

    conductance: Annotated[float, Gt(0), Unit("length/(pressure time)")]


DrainCondition = Literal["drained", "sealed"]
BathPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, PRESSURE))]


@dataclass(frozen=True)
class Drainage:
    """Boundary conditions of the pore fluid, and the pressure of the surrounding bath.

    Mirror planes are sealed.

    Attributes
    ----------
    surface
        Condition of the contact surface outside the contact.
    tip
        Condition of the contact surface where the tip touches.
    base
        Condition of the lower face.
    sides
        Condition of the walls; "auto": drained where they are free.
    bath
        Pressure of the bath [pressure], constant or linear between points [t, value]; 0 in the
        undeformed body. For a gel it is the solvent's chemical potential [kT]; in the reference
        state it has the value of free swelling.
    bath_ramp
        Time in which a sudden change of the bath is imposed at a constant rate. At finite strain a
        sudden change swells a thin layer, for which Newton's method does not converge; "auto" is
        then 1/75 of the diffusion time of the contact, or of the height if that is smaller,
        independent of the mesh. At small strain "auto" is 0.
    """

    surface: DrainCondition = "drained"
    tip: DrainCondition | Conductance = "sealed"
    base: DrainCondition | Conductance = "sealed"
    sides: DrainCondition | Auto = "auto"
    bath: Annotated[float, PRESSURE] | Annotated[tuple[BathPoint, ...], Len(1, 10_000)] = 0.0
    bath_ramp: Annotated[float, Gt(0), TIME] | Auto = "auto"

    def with_time_origin(self, origin: float) -> Drainage:
        """Return the same drainage with the times of the bath measured from `origin`."""
        if isinstance(self.bath, float | int):
            return self
        return replace(self, bath=tuple((t - origin, value) for t, value in self.bath))

    def drains_wall(self, support: str) -> bool:
        """Return whether fluid can leave the body through a wall with this support."""
        return self.sides == "drained" or (self.sides == "auto" and support == "free")

    @property
    def bath_values(self) -> tuple[float, ...]:
        """Values of the bath given by the scene, which bound its value at any time."""
        return (
            (float(self.bath),)
            if isinstance(self.bath, float | int)
            else tuple(value for _, value in self.bath)
        )

    def bath_at(self, t: float) -> float:
        """Return the bath's value at a time; constant before the first and after the last point."""
        if isinstance(self.bath, float | int):
            return float(self.bath)
        times, values = zip(*self.bath, strict=True)
        return float(np.interp(t, times, values))
