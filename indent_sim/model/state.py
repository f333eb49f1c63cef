"""State: the solution at one requested depth, as a row of the force table, and its contact surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from indent_sim.model.units import Scales

DERIVED_COLUMNS = (
    "stiffness",
    "area",
    "E_hertz",
)  # more to read at each row; empty where there is none
# The last where the tip is off centre
FRICTION_COLUMNS = ("stick_radius", "dissipation", "side_force_x", "side_force_y")
FLUID_COLUMNS = ("outflow", "pore_pressure_max")  # with fluid in the pores
ERROR_COLUMNS = (
    "force_error",
    "a_error",
    "p_max_error",
    "delta_error",
    "stick_radius_error",
    "dissipation_error",
)
KRYLOV_COLUMNS = ("krylov_iterations",)  # with an iterative linear solver
TIME_COLUMNS = ("t", "z", "branch", "calibration_error")  # of a history; t stands after step
SUPPORTS = ("base", "sides", "x_min", "x_max", "y_min", "y_max")
REACTION_PREFIX = "reaction_"  # how the columns of the reactions of single supports begin
# On request; `mesh.reactions` says which a body has
REACTION_COLUMNS = (
    *(f"{REACTION_PREFIX}{support}_{axis}" for support in SUPPORTS for axis in "rxyz"),
    *(f"{REACTION_PREFIX}mirror_{axis}" for axis in "xy"),
)
STATE_COLUMNS = (
    "step",
    "delta",
    "force",
    "a",
    "p_max",
    "penetration",
    "energy",
    "newton_iterations",
    "wall_s",
)


@dataclass(frozen=True)
class Surface:
    """The contact surface at one state: reference coordinates, displacement, gap and pressure, one
    entry a point.

    x, y, z [length] (axisymmetric: x = r, y = 0; strip: y = 0; z = 0 on a flat top); u (n, 3)
    [length]; gap [length] >= 0 open; pressure [pressure] >= 0; shear [pressure] the tangential
    traction on the body, > 0 along x or the radius, in three dimensions its size; None without
    friction. pore_pressure [pressure] of the fluid above the bath's; None without.
    """

    x: np.ndarray
    y: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    pressure: np.ndarray
    z: np.ndarray
    shear: np.ndarray | None = None
    pore_pressure: np.ndarray | None = None

    def to_user_units(self, length: float, pressure: float) -> Surface:
        """The same table with lengths and pressures measured in the user's units."""
        lengths = {name: getattr(self, name) * length for name in ("x", "y", "z", "u", "gap")}
        optional_fields = {
            name: values
            for name in ("shear", "pore_pressure")
            if (values := getattr(self, name)) is not None
        }
        stresses = {name: values * pressure for name, values in optional_fields.items()}
        return Surface(pressure=self.pressure * pressure, **stresses, **lengths)


@dataclass(frozen=True)
class State:
    """One converged (or failed) load step of the whole body, in the units of the scene it belongs
    to.

    force [pressure length^2] > 0 pushing (per unit length in plane strain), a [length] contact
    radius, p_max [pressure] NaN where no mesh knows it, penetration [length] the largest <-g> over
    the contact quadrature points, energy [pressure length^3] strain plus penalty energy, reaction
    the z-reaction of all constrained dofs, reactions the forces of single supports on the body by
    support and axis (see `mesh.reactions`), None without a mesh, overlap [length] how deep a whole
    facet of the surface lies inside the tip's own shape (current gap only), intrusion [length] how
    deep the tip lies inside the surface beside that which it may touch, roughness the part of p_max
    by which the pressure alternates from node to node. stiffness [pressure length] is dF/ddelta,
    area [length^2] that of the contact, E_hertz [pressure] the modulus that a half-space fit of
    this one point returns; NaN where there is none, None where nobody asked. With friction, None
    without: stick_radius [length] of the region that does not slip, dissipation [pressure length^3]
    of the step, side_force on the tip [force] across a body that it stands off the middle of.
    krylov_iterations are those of an iterative linear solver. Errors are half-widths of error bars,
    None where there are none. With a history t [time], the way z [length] of a base, branch
    (approach, hold, retract), and what the instrument's calibration leaves unknown of the force;
    what the curve does not know is NaN. With fluid in the pores: outflow [length^3] since rest, the
    largest pore pressure above the bath's [pressure], the fluid that has moved, out of the body or
    from place to place in it, and the fluid that has neither left nor is there [length^3]. drained:
    of a sudden step, at each vertex of a drained face the height of its elements and p^2 times its
    area, in the scene's units and of the part that is modelled.
    """

    step: int
    delta: float
    force: float
    a: float
    p_max: float
    penetration: float
    energy: float
    newton_iterations: int
    wall_s: float
    reaction: float = float("nan")
    reactions: Mapping[str, float] | None = field(default=None, repr=False)
    stray_reaction: float = 0.0
    krylov_iterations: int | None = None
    overlap: float = 0.0
    intrusion: float = 0.0
    roughness: float = 0.0
    substeps: int = 1
    converged: bool = True
    reason: str = ""
    stiffness: float | None = None
    area: float | None = None
    E_hertz: float | None = None
    stick_radius: float | None = None
    dissipation: float | None = None
    side_force_x: float | None = None
    side_force_y: float | None = None
    force_error: float | None = None
    a_error: float | None = None
    p_max_error: float | None = None
    delta_error: float | None = None
    stick_radius_error: float | None = None
    dissipation_error: float | None = None
    t: float | None = None
    z: float | None = None
    branch: str = ""
    calibration_error: float | None = None
    outflow: float | None = None
    pore_pressure_max: float | None = None
    moved: float = 0.0
    unbalanced: float = 0.0
    drained: np.ndarray | None = field(default=None, repr=False, compare=False)
    surface: Surface | None = field(default=None, repr=False, compare=False)

    def __str__(self) -> str:
        """What a log says of it."""
        return self.summary({})

    def summary(self, units: Mapping[str, str]) -> str:
        """Time, depth, force and contact radius in words, each with its unit where `units` has it,
        by these names.
        """
        numbers = {"t": self.t, "delta": self.delta, "force": self.force, "a": self.a}
        known_numbers = {
            name: value
            for name, value in numbers.items()
            if value is not None and (name != "t" or value == value)
        }
        return "  ".join(
            f"{name} {value:.6g} {units.get(name, '')}".rstrip()
            for name, value in known_numbers.items()
        )

    def column(self, name: str) -> Any:
        """The value of a column of the force table; None where there is none."""
        if name in REACTION_COLUMNS:
            return (self.reactions or {}).get(name.removeprefix(REACTION_PREFIX))
        return getattr(self, name)

    def to_user_units(self, scales: Scales) -> State:
        """The same state measured in the user's units, of which the scales are the scene's."""
        values = vars(self)
        units = _field_units(scales)
        measured: dict[str, Any] = {
            name: value * unit
            for name, unit in units.items()
            if (value := values[name]) is not None
        }
        surface = self.surface and self.surface.to_user_units(scales.length, scales.pressure)
        if self.reactions is not None:
            measured["reactions"] = {
                name: force * scales.force for name, force in self.reactions.items()
            }
        return State(
            **values | measured | {"surface": surface}
        )  # `replace` would ask for every field's default


@dataclass(frozen=True)
class PullOff:
    """The largest pull on the way out.

    Attributes
    ----------
    state
        The equilibrium there, which is no row: its step is 0.
    error
        By how much the pull between the rows may be larger [force]; infinite where nobody knows.
    equilibria
        How many were sought.
    """

    state: State
    error: float
    equilibria: int


@cache
def _field_units(scales: Scales) -> dict[str, float]:
    """The units of a State's fields, of those that have one."""
    L = scales.length
    P = scales.pressure
    F = scales.force
    depth = scales.depth
    energy = scales.energy
    units = dict.fromkeys(
        ("force", "reaction", "stray_reaction", "side_force_x", "side_force_y"), F
    )
    units |= dict.fromkeys(("a", "penetration", "overlap", "intrusion", "stick_radius"), L)
    units |= dict.fromkeys(("energy", "dissipation"), energy)
    units |= dict.fromkeys(("outflow", "moved", "unbalanced"), energy / P)
    units |= dict.fromkeys(("p_max", "E_hertz", "pore_pressure_max"), P)
    depths = {"delta": depth, "z": depth}
    return (
        units
        | depths
        | {"calibration_error": F, "stiffness": F / depth, "area": L ** (scales.dim - 1)}
    )
