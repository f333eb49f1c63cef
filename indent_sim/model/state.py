"""State: the solution at one load increment, which is one row of the force table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from indent_sim.model.units import Scales

# Quantities that follow from the solution of a row; empty where there is none.
DERIVED_COLUMNS = ("stiffness", "area", "E_hertz")
# Columns of scenes with friction; a side force only if no mirror plane through the tip is normal to
# its axis.
FRICTION_COLUMNS = ("stick_radius", "dissipation", "side_force_x", "side_force_y")
# Columns of scenes with a tip that is tilted or slides.
MOMENT_COLUMNS = ("moment", "x_contact")
# Columns of scenes with a tip that slides; x comes after delta.
SLIDE_COLUMNS = ("x",)
# Columns of scenes with fluid in the pores.
FLUID_COLUMNS = ("outflow", "pore_pressure_max")
# Columns of scenes with a body that yields, in whose tables DERIVED_COLUMNS are absent.
PLASTIC_COLUMNS = ("plastic_dissipation", "hardness", "contact_area", "unloading_stiffness")
# Columns of scenes with `loading.unload`.
UNLOADING_COLUMNS = ("residual_depth",)
# Columns of scenes with a soft tip.
SOFT_TIP_COLUMNS = ("tip_sink", "tip_energy")
# Columns of bodies that rest on a flat without a bond.
RESTING_COLUMNS = ("a_base", "base_approach")
ERROR_COLUMNS = (
    "force_error",
    "a_error",
    "p_max_error",
    "delta_error",
    "residual_depth_error",
    "stick_radius_error",
    "dissipation_error",
    "moment_error",
    "x_contact_error",
    "side_force_x_error",
    "side_force_y_error",
)
# Columns of runs with an iterative linear solver.
KRYLOV_COLUMNS = ("krylov_iterations",)
# Columns of histories; t comes after step.
TIME_COLUMNS = ("t", "z", "branch", "calibration_error")
SUPPORTS = ("base", "sides", "x_min", "x_max", "y_min", "y_max")
# Beginning of the names of columns with the reactions of single supports.
REACTION_PREFIX = "reaction_"
# Columns on request; `mesh.reactions` selects those of a body.
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
    """Contact surface of one state, with one entry for each surface point.

    Attributes
    ----------
    x, y, z
        Undeformed coordinates [length]; axisymmetric: x = r, y = 0; strip: y = 0; flat top: z = 0.
    u : (n, 3)
        Displacement [length].
    gap
        Gap [length], >= 0 open.
    pressure
        Contact pressure [pressure], >= 0.
    shear
        Tangential traction on the body [pressure], > 0 along x or the radius; its magnitude in
        three dimensions; None without friction.
    pore_pressure
        Pore pressure relative to the bath [pressure]; None without fluid.
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
        """Return the same surface with lengths and pressures multiplied by these scales."""
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
    """Results of a load increment of the whole body, converged or failed, in the scene's units.

    A quantity is None if it does not apply to the scene or was not requested, and NaN if it is
    unknown.

    Attributes
    ----------
    step
        Number of the row, from 1.
    delta
        Indentation depth [length].
    force
        Force [force], > 0 pushing; per unit length in plane strain.
    a
        Contact radius [length].
    p_max
        Largest contact pressure [pressure].
    penetration
        Largest <-g> at the quadrature points of the contact [length].
    energy
        Strain energy plus penalty energy [energy].
    newton_iterations, krylov_iterations
        Iterations of Newton's method, and of an iterative linear solver.
    wall_s
        Wall time since the start of the run [s].
    reaction
        z-reaction of all constrained degrees of freedom [force].
    reactions
        Force of each support on the body, by support and axis (see `mesh.reactions`) [force].
    stray_reaction
        Reaction of the constraints that only prevent rigid motions [force]; zero in equilibrium.
    overlap
        Largest depth of a whole facet inside the tip's surface, current gap only [length].
    intrusion
        Depth of the tip inside a surface on which no contact is modelled [length].
    roughness
        Amplitude of the pressure's oscillation from node to node, divided by p_max [1].
    clearance
        Smallest vertical distance of the tip above the surface of a swelling or shrinking gel that
        it does not touch [length]; None otherwise.
    substeps
        Number of increments into which the step was divided.
    converged, reason
        Whether the increment has a solution, and the reason if not.
    stiffness
        dF/ddelta [force/length].
    area
        Contact area [length^2].
    E_hertz
        Modulus from a half-space fit of this row alone [pressure].
    x
        Horizontal displacement of a sliding tip from where it was pressed in [length].
    stick_radius
        Radius of the region that does not slip, with friction [length].
    dissipation
        Energy dissipated by friction since the previous row [energy].
    plastic_dissipation
        Energy dissipated by plastic flow since the undeformed state [energy].
    hardness
        Force over contact area of a body that yields [pressure].
    contact_area
        Contact area of a body that yields [length^2].
    unloading_stiffness
        dF/ddelta of a body that yields, at the beginning of unloading [force/length].
    residual_depth
        Depth at which the force has become zero in unloading [length]; NaN in other rows.
    side_force_x, side_force_y
        Horizontal force on the tip, with friction, a tilt or a slide, along an axis to which no
        mirror plane is normal [force]. For a sliding tip it includes the force of the pressure on
        the slope of the tip, even with a reference gap, so that its work is the work of the slide.
    lateral_imbalance
        Resultant horizontal force on the body under a sliding tip [force]; zero in equilibrium.
    moment
        Integral of the vertical traction times the distance from the tip's axis along the tilt, or
        for an upright tip along its slide [force length]. The axis moves with the slide.
    x_contact
        Distance of the resultant vertical force from the tip's axis in this direction [length].
    force_error, a_error, p_max_error, delta_error, residual_depth_error, stick_radius_error,
    dissipation_error, side_force_x_error, side_force_y_error, moment_error, x_contact_error
        Error estimates: half-widths of intervals, in the unit of the quantity.
    t, z, branch
        Time [time], position of the base [length] and branch (approach, hold, retract) of a
        history.
    calibration_error
        Uncertainty of the force from the calibration of the instrument [force].
    outflow
        Fluid that has left the body since the undeformed state [length^3].
    pore_pressure_max
        Largest pore pressure relative to the bath [pressure].
    tip_sink
        Depth by which the apex of a soft tip is pressed in, a part of delta [length].
    tip_energy
        Strain energy of a soft tip, a part of `energy` [energy].
    a_base
        Radius of the contact with the flat on which a body rests [length].
    base_approach
        For a body that rests on a flat, motion of the point at half of its height towards the flat,
        a part of delta [length].
    moved
        Volume of fluid that has moved, within the body or out of it [length^3].
    unbalanced
        Error of the fluid balance (content plus outflow); zero in equilibrium [length^3].
    drained
        Element height and p^2 * area at each vertex of the drained faces of the model domain,
        nondimensional; only for an increment without duration.
    surface
        Contact surface.
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
    lateral_imbalance: float = 0.0
    krylov_iterations: int | None = None
    overlap: float = 0.0
    intrusion: float = 0.0
    roughness: float = 0.0
    clearance: float | None = None
    substeps: int = 1
    converged: bool = True
    reason: str = ""
    stiffness: float | None = None
    area: float | None = None
    E_hertz: float | None = None
    x: float | None = None
    stick_radius: float | None = None
    dissipation: float | None = None
    plastic_dissipation: float | None = None
    hardness: float | None = None
    contact_area: float | None = None
    unloading_stiffness: float | None = None
    residual_depth: float | None = None
    side_force_x: float | None = None
    side_force_y: float | None = None
    moment: float | None = None
    x_contact: float | None = None
    force_error: float | None = None
    a_error: float | None = None
    p_max_error: float | None = None
    delta_error: float | None = None
    residual_depth_error: float | None = None
    stick_radius_error: float | None = None
    dissipation_error: float | None = None
    moment_error: float | None = None
    x_contact_error: float | None = None
    side_force_x_error: float | None = None
    side_force_y_error: float | None = None
    t: float | None = None
    z: float | None = None
    branch: str = ""
    calibration_error: float | None = None
    outflow: float | None = None
    pore_pressure_max: float | None = None
    tip_sink: float | None = None
    tip_energy: float | None = None
    a_base: float | None = None
    base_approach: float | None = None
    moved: float = 0.0
    unbalanced: float = 0.0
    drained: np.ndarray | None = field(default=None, repr=False, compare=False)
    surface: Surface | None = field(default=None, repr=False, compare=False)

    def __str__(self) -> str:
        """Return the line of this state in the log."""
        return self.summary({})

    def summary(self, units: Mapping[str, str]) -> str:
        """Return time, depth, slide x, force and contact radius as text.

        `units` maps the names of these quantities to their units.
        """
        numbers = {"t": self.t, "delta": self.delta, "x": self.x}
        numbers |= {"force": self.force, "a": self.a}
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
        """Return the value in a column of the force table; None if it does not apply."""
        if name in REACTION_COLUMNS:
            return (self.reactions or {}).get(name.removeprefix(REACTION_PREFIX))
        return getattr(self, name)

    def to_user_units(self, scales: Scales) -> State:
        """Return the same state in the user's units, with the scales of its scene."""
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
        # All fields are passed at once; `replace` would look up the default of every field.
        return State(**values | measured | {"surface": surface})


@dataclass(frozen=True)
class PullOff:
    """Largest tensile force during unloading.

    Attributes
    ----------
    state
        The equilibrium with this force; its `step` is 0, because it is not a row of the table.
    error
        Bound on the error of the largest tensile force [force]; infinite if unknown.
    equilibria
        Number of equilibria that were computed.
    """

    state: State
    error: float
    equilibria: int


@cache
def _field_units(scales: Scales) -> dict[str, float]:
    """Return the scale, in user units, of each field of a State that has a dimension."""
    L = scales.length
    P = scales.pressure
    F = scales.force
    depth = scales.depth
    energy = scales.energy
    units = dict.fromkeys(
        (
            "force",
            "reaction",
            "stray_reaction",
            "lateral_imbalance",
            "side_force_x",
            "side_force_y",
        ),
        F,
    )
    lengths = (
        "a",
        "x",
        "penetration",
        "overlap",
        "intrusion",
        "clearance",
        "stick_radius",
        "tip_sink",
        "x_contact",
    )
    units |= dict.fromkeys((*lengths, *RESTING_COLUMNS), L)
    units["moment"] = F * L
    units |= dict.fromkeys(("energy", "tip_energy", "dissipation", "plastic_dissipation"), energy)
    units |= dict.fromkeys(("outflow", "moved", "unbalanced"), energy / P)
    units |= dict.fromkeys(("p_max", "E_hertz", "hardness", "pore_pressure_max"), P)
    depths = {"delta": depth, "z": depth, "residual_depth": depth}
    units |= dict.fromkeys(("stiffness", "unloading_stiffness"), F / depth)
    units |= dict.fromkeys(("area", "contact_area"), L ** (scales.dim - 1))
    return units | depths | {"calibration_error": F}
