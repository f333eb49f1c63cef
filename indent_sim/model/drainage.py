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

MAX_BATH_POINTS = 10_000  # of a bath


@dataclass(frozen=True)
class Conductance:
    """A surface that lets out the flux `conductance` p [length/time] at the pressure p above the
    bath's.
    """

    conductance: Annotated[float, Gt(0), Unit("length/(pressure time)")]


DrainCondition = Literal["drained", "sealed"]
BathPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, PRESSURE))]


@dataclass(frozen=True)
class Drainage:
    """Where a body with fluid in its pores lets it out, into a bath of the pressure `bath`
    [pressure].

    surface: what the tip may touch, where it does not; tip: where it does; sides auto: drained
    where they are free. Mirror planes are sealed. bath: a number, or [t, value] points, straight
    between them; at rest there is none. Of a gel it is the solvent's chemical potential [kT], and
    at rest that of free swelling.

    bath_ramp: the time that a sudden bath takes to come. No step of Newton's method finds the thin
    layer that swells at once, so that a sudden bath at finite strain comes evenly within it; auto:
    a seventy-fifth of the time that fluid takes through the contact, whatever the mesh. At small
    strain auto is 0, at once.
    """

    surface: DrainCondition = "drained"
    tip: DrainCondition | Conductance = "sealed"
    base: DrainCondition | Conductance = "sealed"
    sides: DrainCondition | Auto = "auto"
    bath: Annotated[float, PRESSURE] | Annotated[tuple[BathPoint, ...], Len(1, MAX_BATH_POINTS)] = (
        0.0
    )
    bath_ramp: Annotated[float, Gt(0), TIME] | Auto = "auto"

    def with_time_origin(self, origin: float) -> Drainage:
        """The same with the bath's times counted from another one."""
        if isinstance(self.bath, float | int):
            return self
        return replace(self, bath=tuple((t - origin, value) for t, value in self.bath))

    def drains_wall(self, support: str) -> bool:
        """Whether a wall with this support lets fluid out."""
        return self.sides == "drained" or (self.sides == "auto" and support == "free")

    @property
    def bath_values(self) -> tuple[float, ...]:
        """Values of the bath, between which all others lie."""
        return (
            (float(self.bath),)
            if isinstance(self.bath, float | int)
            else tuple(value for _, value in self.bath)
        )

    def bath_at(self, t: float) -> float:
        """The bath at a time; before the first point, and after the last, as there."""
        if isinstance(self.bath, float | int):
            return float(self.bath)
        times, values = zip(*self.bath, strict=True)
        return float(np.interp(t, times, values))
