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
    """Permeable surface: flux conductance p [length/time] at the pore pressure p.

    p is counted from the pressure of the bath.
    """

    conductance: Annotated[float, Gt(0), Unit("length/(pressure time)")]


DrainCondition = Literal["drained", "sealed"]
BathPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, PRESSURE))]


@dataclass(frozen=True)
class Drainage:
    """Boundary conditions of the pore fluid and the pressure `bath` [pressure] of its bath.

    Mirror planes are sealed.

    Attributes
    ----------
    surface
        Contact surface where the tip does not touch.
    tip
        Contact surface where the tip touches.
    base
        Lower face.
    sides
        Walls; "auto": drained where they are free.
    bath
        Pressure, or points [t, value] with straight lines between them; 0 in the undeformed body.
        For a gel it is the solvent's chemical potential [kT], in the reference state that of free
        swelling.
    bath_ramp
        Time in which a sudden change of the bath is imposed at a constant rate. Newton's method
        does not converge to the thin layer that swells at once at finite strain; "auto" is there
        1/75 of the time that the fluid takes through the contact, whatever the mesh. At small
        strain "auto" is 0: the change is imposed at once.
    """

    surface: DrainCondition = "drained"
    tip: DrainCondition | Conductance = "sealed"
    base: DrainCondition | Conductance = "sealed"
    sides: DrainCondition | Auto = "auto"
    bath: Annotated[float, PRESSURE] | Annotated[tuple[BathPoint, ...], Len(1, 10_000)] = 0.0
    bath_ramp: Annotated[float, Gt(0), TIME] | Auto = "auto"

    def with_time_origin(self, origin: float) -> Drainage:
        """Return the same drainage with the bath's times counted from `origin`."""
        if isinstance(self.bath, float | int):
            return self
        return replace(self, bath=tuple((t - origin, value) for t, value in self.bath))

    def drains_wall(self, support: str) -> bool:
        """Return whether a wall with this support lets fluid out."""
        return self.sides == "drained" or (self.sides == "auto" and support == "free")

    @property
    def bath_values(self) -> tuple[float, ...]:
        """Values of the bath, between which its value always lies."""
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
