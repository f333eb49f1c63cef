"""Nondimensional problem: body, tip, contact law, load path and derived properties."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from math import exp

from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.mesh.two_bodies import TwoBodyDomain
from indent_sim.model.algebra import cos, sin
from indent_sim.model.body import Body
from indent_sim.model.contact import ActiveSet, ContactLaw, SlipReference
from indent_sim.model.drainage import Drainage
from indent_sim.model.gel import Gel
from indent_sim.model.load_path import LoadPath
from indent_sim.model.materials import Material
from indent_sim.model.state import (
    FLUID_COLUMNS,
    FRICTION_COLUMNS,
    MOMENT_COLUMNS,
    PLASTIC_COLUMNS,
    RESTING_COLUMNS,
    SLIDE_COLUMNS,
    SOFT_TIP_COLUMNS,
    UNLOADING_COLUMNS,
)
from indent_sim.model.tip_track import TipTrack
from indent_sim.model.tips import FlatPunch, Indenter
from indent_sim.model.units import Scales
from indent_sim.scene.compression_theory import covers_top
from indent_sim.scene.cost import SolverWork
from indent_sim.scene.depth_limits import Center, side_contact_depth
from indent_sim.scene.measured_constants import (
    SLIDING_SOLVES,
    SLIDING_SOLVES_GROWTH,
    STEADY_SLIDING_DEPTH,
)
from indent_sim.scene.reference_theory import relative_tip

# Ratio of the stretches normal to and along the surface of a surface layer, from which the surface
# of an incompressible network creases (Hong, Zhao & Suo 2009, Appl. Phys. Lett. 95, 111901). No
# smooth surface is stable from 3.4 on (Biot 1963).
CREASING_STRETCH = 2.4
# A gel is searched for unstable volume ratios from those that its bath gives it to this factor
# beyond, since the parts that swell or shrink first strain the others.
DEMIXING_MARGIN = 1.05


@dataclass(frozen=True)
class ProblemDefinition:
    """Nondimensional problem; every quantity is divided by the `scales`.

    The problem is made from the config with the contact conditions of the reference theory. The
    choices for a mesh then replace contact law, gap, tip and stiffnesses.

    Attributes
    ----------
    domain : ModelDomain
        The part of the body that is meshed.
    center : tuple of float
        Horizontal position of the tip's axis [length].
    path : LoadPath
        The prescribed depths or forces.
    deltas : tuple of float
        The prescribed depths, or the depths expected at the prescribed forces [length].
    gap : str
        Where the gap is evaluated: "reference" (undeformed point) or "current" (deformed point).
    wall_stiffness : float
        Stiffness of the weak condition u . n = 0 on the curved wall of a three-dimensional cylinder
        [pressure/length]; 0 without such a wall.
    slip_reference : SlipReference
        The point from which the slip of a new contact is counted.
    surface_tension : float
        Surface tension of the contact surface [pressure length].
    drainage : Drainage
        Boundary conditions of the pore fluid, with times since the beginning of the history.
    bath_ramp : float
        Time over which a sudden change of the bath is applied [time]; 0 for an instantaneous
        change.
    """

    scales: Scales
    body: Body
    domain: ModelDomain
    indenter: Indenter
    center: Center
    path: LoadPath
    deltas: tuple[float, ...]
    contact: ContactLaw = field(default_factory=ActiveSet)
    gap: str = "reference"
    wall_stiffness: float = 0.0
    slip_reference: SlipReference = "implicit"
    surface_tension: float = 0.0
    drainage: Drainage = field(default_factory=Drainage)
    bath_ramp: float = 0.0

    @cached_property
    def track(self) -> TipTrack:
        """Track of the tip's axis over the undeformed surface."""
        return self.path.track(self.center)

    @property
    def slides(self) -> bool:
        """True if the tip slides after it has been pressed in."""
        return bool(self.path.slides)

    @property
    def slide_force_column(self) -> str:
        """Column of the side force along the slide; empty if the tip does not slide."""
        return f"side_force_{'xy'[self.track.axis]}" if self.slides else ""

    @cached_property
    def is_compressed(self) -> bool:
        """True if a plate, or a punch wider than the body, covers the whole flat top."""
        return covers_top(self.indenter, self.body, self.center)

    @cached_property
    def max_depth(self) -> float:
        """Largest depth of the path [length]."""
        return max(self.deltas)

    @cached_property
    def side_contact_depth(self) -> float:
        """Depth at which the tip reaches the upper edge of a fixed side [length]."""
        return side_contact_depth(self.body, self.indenter, self.center)

    @property
    def has_friction(self) -> bool:
        """True if the contact has friction."""
        return not self.contact.is_conservative

    @property
    def largest_force(self) -> float | None:
        """Largest prescribed force [pressure length^2]; None if depths are prescribed."""
        return max(self.path.values) if self.path.control == "force" else None

    @property
    def side_force_axes(self) -> dict[str, int]:
        """Return the horizontal axes, by name, along which there can be a net side force.

        Such a force is due to friction, a slide, or the pressure along the normal of a tilted tip.

        By symmetry, there is no side force normal to a mirror plane through the tip.
        """
        return {
            name: axis
            for name, axis in self._lateral_axes.items()
            if not self._mirror_walls_across(name)
        }

    @property
    def missing_side_forces(self) -> dict[str, bool]:
        """Return the horizontal axes along which symmetry excludes a side force, with the cause.

        The value is True if a wall of the body itself is the mirror plane, whose mirror image
        exerts an opposite force. It is False if the mirror plane only reduces the model domain.
        """
        return {
            name: name not in self.domain.mirror_axes
            for name in self._lateral_axes
            if self._mirror_walls_across(name)
        }

    @property
    def _lateral_axes(self) -> dict[str, int]:
        """Return the horizontal axes along which the body may push the tip; none in axisymmetry.

        The push is due to friction and, if the tip slides or is tilted, to the pressure on the
        slope of the tip.
        """
        is_pushed = self.has_friction or self.slides or (self.has_moment and self.gap == "current")
        if not is_pushed or self.domain.kinematics.name == "axisymmetric":
            return {}
        return {name: axis for axis, name in enumerate("xy"[: self.domain.dim - 1])}

    def _mirror_walls_across(self, axis_name: str) -> set[str]:
        """Return the walls normal to an axis that are mirror planes through the tip."""
        return self.domain.mirror_walls(self.center) & {f"{axis_name}_min", f"{axis_name}_max"}

    @property
    def mirror_multiplicity(self) -> int:
        """Number of bodies in contact with the tip, including mirror images (1, 2 or 4)."""
        return self.domain.mirrored_body_count(self.center)

    def full_contact_radius(self, a: float) -> float:
        """Return the radius [length] of the contact including its mirror images.

        Parameters
        ----------
        a : float
            Contact radius of a row [length]: radius of a circle with the area of the contact on the
            body itself, in plane strain its half-width.
        """
        kinematics = self.domain.kinematics
        if self.mirror_multiplicity == 1:
            return a
        return kinematics.contact_radius(self.mirror_multiplicity * kinematics.contact_area(a))

    def row_contact_radius(self, a: float) -> float:
        """Return the contact radius of a row [length] from the radius with mirror images."""
        kinematics = self.domain.kinematics
        if self.mirror_multiplicity == 1:
            return a
        return kinematics.contact_radius(kinematics.contact_area(a) / self.mirror_multiplicity)

    @property
    def drained_walls(self) -> tuple[str, ...]:
        """Return the side walls through which pore fluid drains."""
        mirror_surfaces = self.domain.mirror_walls(self.center)
        walls = [
            wall for wall in self.domain.wall_distances(self.center) if wall not in mirror_surfaces
        ]
        return tuple(
            wall
            for wall in walls
            if self.drainage.drains_wall(self.domain.supports.get(wall, "free"))
        )

    @property
    def permeable_regions(self) -> tuple[Region, ...]:
        """The regions with pore fluid."""
        return tuple(region for region in self.domain.regions if region.material.flow)

    @property
    def is_porous_column(self) -> bool:
        """True if the tip covers the top of a poroelastic body, as in Terzaghi's consolidation."""
        return self.is_compressed and bool(self.permeable_regions)

    def bath_pressure(self, region: Region, t: float) -> float:
        """Return the pressure p_b [pressure] of the bath of a permeable region.

        Parameters
        ----------
        region : Region
            A region with pore fluid.
        t : float
            Time since the beginning of the history [time]; the pressure is 0 for t <= 0.
        """
        if t <= 0:
            return 0.0
        bath: float = region.material.bath_pressure(self.drainage.bath_at(t))
        return bath * min(1.0, t / self.bath_ramp) if self.bath_ramp else bath

    @property
    def is_swelling(self) -> bool:
        """True if a bath makes a gel swell or shrink."""
        return any(
            region.material.bath_pressure(bath) != 0
            for region in self.permeable_regions
            for bath in self.drainage.bath_values
        )

    @property
    def surface_layer_stretch(self) -> float:
        """Stretch normal to the surface of a gel whose surface layer has swollen; 1 without a gel.

        The gel below the surface layer prevents its lateral swelling: temporarily in a free body,
        permanently in a body between walls.
        """
        law = self.domain.regions[0].material
        if not isinstance(law, Gel) or not law.flow:
            return 1.0
        return max(
            law.confined_swelling(law.bath_pressure(bath)).stretch
            for bath in self.drainage.bath_values
        )

    @property
    def creasing_message(self) -> str:
        """Return a message if swelling makes the surface of a gel crease, otherwise ""."""
        if self.surface_layer_stretch <= CREASING_STRETCH:
            return ""
        swelling_text = (
            f"the surface layer of the gel swells to {self.surface_layer_stretch:.3g} times its "
            "thickness, laterally confined by the gel below"
        )
        return (
            f"{swelling_text}; from {CREASING_STRETCH:g} on the surface has creases, which are not "
            "modelled"
        )

    @property
    def demixing_message(self) -> str:
        """Return a message if a gel separates into two phases in this bath, otherwise ""."""
        law = self.domain.regions[0].material
        if not isinstance(law, Gel) or not self.is_swelling:
            return ""
        stretches = [
            1.0,
            *(
                law.confined_swelling(law.bath_pressure(bath)).stretch
                for bath in self.drainage.bath_values
            ),
        ]
        lowest = min(stretches) / DEMIXING_MARGIN
        highest = max(stretches) * DEMIXING_MARGIN
        lowest = max(lowest, (1 + 1e-6) / law.swelling_ratio(1.0))
        volume_ratios = [lowest * (highest / lowest) ** (k / 1000) for k in range(1001)]
        unstable = [J for J in volume_ratios if law.confined_stiffness(J) < 0]
        if not unstable:
            return ""
        nearest = min(unstable, key=lambda J: abs(J - 1))
        return (
            f"the gel is unstable at {nearest:.3g} times its volume, where it separates into a "
            "dilute and a dense phase, which is not modelled"
        )

    def is_closed_by_swelling(self, depth: float, a: float) -> bool:
        """True if swelling has widened a contact beyond the tip's cross-section at this depth.

        Parameters
        ----------
        depth : float
            The indentation depth [length].
        a : float
            The contact radius [length].
        """
        return self.is_swelling and a > relative_tip(self.indenter, self.body).radius_at(
            max(depth, 0.0)
        )

    @property
    def relaxing_regions(self) -> tuple[Region, ...]:
        """The regions with stress relaxation."""
        return tuple(region for region in self.domain.regions if region.material.relaxation)

    @property
    def has_two_bodies(self) -> bool:
        """True if the model domain contains a soft tip beside the body."""
        return isinstance(self.domain, TwoBodyDomain)

    @property
    def yields(self) -> bool:
        """True if a material of the body may yield."""
        return any(region.material.plasticity for region in self.domain.regions)

    @property
    def searches_unloading_depths(self) -> bool:
        """True if the depths of unloading are known only when the body is solved."""
        return self.path.unloading is not None and self.path.control == "depth" and self.yields

    @property
    def creeps(self) -> bool:
        """True if plastic flow of a material depends on the rate."""
        return any(region.material.creeps for region in self.domain.regions)

    @property
    def time_integration(self) -> str:
        """Method of the time integration along a history; "equilibria" of an elastic body."""
        if self.creeps:
            return "backward Euler"
        if self.permeable_regions:
            return "SDIRK2"
        return "exponentials" if self.relaxing_regions else "equilibria"

    @property
    def is_time_dependent(self) -> bool:
        """True if the force changes with time at a constant depth."""
        return any(region.material.is_time_dependent for region in self.domain.regions)

    @property
    def is_path_dependent(self) -> bool:
        """True if the force depends on the load path or on time."""
        return self.contact.is_path_dependent or self.is_time_dependent or self.yields

    @property
    def depends_on_step_size(self) -> bool:
        """True if the result depends on the step size: friction, yield, a time-dependent body."""
        return self.has_friction or self.is_time_dependent or self.yields

    @property
    def searches_pull_off(self) -> bool:
        """True if the pull-off force is searched for between the rows.

        The search needs an attraction with a finite range, and prescribed depths that decrease.
        """
        if not self.contact.adhesion_range or self.path.control != "depth":
            return False
        steps = range(1, len(self.path.values) + 1)
        depths = [depth for row in steps for depth, _ in self.path.segment(row)]
        return any(after < before for before, after in pairwise(depths))

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns for soft tip, flat, slide, friction, tilt, fluid and yield, in this order."""
        soft_tip = SOFT_TIP_COLUMNS if self.indenter.elastic_part else ()
        unloading = UNLOADING_COLUMNS if self.path.unloading else ()
        if soft_tip or self.domain.rests_on_flat:
            # Soft tips and bodies on a flat are not modelled with friction or pore fluid.
            resting = RESTING_COLUMNS if self.domain.rests_on_flat else ()
            return (*soft_tip, *resting, *unloading)
        fluid = FLUID_COLUMNS if self.permeable_regions else ()
        plastic = PLASTIC_COLUMNS if self.yields else ()
        tilt = MOMENT_COLUMNS if self.has_moment else ()
        side_force_columns = [f"side_force_{axis}" for axis in self.side_force_axes]
        return (
            *(SLIDE_COLUMNS if self.slides else ()),
            *(
                name
                for name in FRICTION_COLUMNS
                if name in side_force_columns or (self.has_friction and not name.startswith("side"))
            ),
            *tilt,
            *fluid,
            *plastic,
            *unloading,
        )

    @property
    def has_moment(self) -> bool:
        """True if the tip is tilted or slides, so that the contact exerts a moment on it."""
        return self.indenter.tilt_direction is not None or self.slides

    @property
    def moment_axis(self) -> tuple[float, float]:
        """Horizontal direction (x, y) of the lever arm of the moment: the tilt, else the slide."""
        direction = self.indenter.tilt_direction
        if direction is None:
            direction = 90.0 * self.path.slide_axis
        return float(cos(direction)), float(sin(direction))

    @property
    def material(self) -> Material:
        """Material below the tip."""
        return self.domain.regions[0].material

    @property
    def contact_modulus(self) -> float:
        """E* of the contact [pressure]; for a soft tip 1/(1/E_1* + 1/E_2*) of body and tip."""
        E_star: float = self.material.E_star
        lens = self.indenter.elastic_part
        return E_star if lens is None else 1.0 / (1.0 / E_star + 1.0 / lens.material.E_star)

    @property
    def small_strain(self) -> bool:
        """True if all materials are for small strain."""
        return all(region.material.is_small_strain for region in self.domain.regions)

    @property
    def largest_locking_nu(self) -> float:
        """Largest Poisson's ratio, over time, in regions with displacement elements and no fluid.

        Displacement elements lock if this ratio is close to 0.5. In regions with pore fluid, the
        pore pressure prevents locking.
        """
        locking_regions = [
            candidate
            for candidate in self.domain.regions
            if candidate.formulation == "displacement" and not candidate.material.flow
        ]
        return max((region.softest_constants.nu for region in locking_regions), default=0.0)

    @property
    def largest_nu(self) -> float:
        """The largest Poisson's ratio of the material below the tip during the history."""
        return self.domain.regions[0].softest_constants.nu

    @property
    def drop_number(self) -> float:
        """Elastocapillary number gamma/(mu R) of a round body at finite strain.

        mu is the shear modulus of the softest region. The number is 0 without surface tension.
        """
        if self.small_strain or not self.domain.top_radius or not self.surface_tension:
            return 0.0
        softest = min(
            E / (2 * (1 + nu))
            for E, nu in (region.softest_constants for region in self.domain.regions)
        )
        return self.surface_tension / (softest * self.domain.top_radius)

    @property
    def is_drop(self) -> bool:
        """True if surface tension dominates the elasticity of a round body."""
        # Elastocapillary number gamma/(mu R) from which surface tension alone stabilizes
        # the surface. Without a membrane, a ball between plates is solved at 33, in 300
        # iterations, and not at 100.
        drop_threshold = 50.0
        return self.drop_number >= drop_threshold

    @property
    def is_linear(self) -> bool:
        """True if strains are small, the gap refers to undeformed points, and nothing yields."""
        return self.small_strain and self.gap == "reference" and not self.yields

    def solver_work(self, method: str, linear: str) -> SolverWork:
        """Return the properties on which the cost of solving by a method depends.

        Parameters
        ----------
        method : str
            "condensed" or "newton".
        linear : str
            "direct" or "iterative".
        """
        # Linear solves of load control per linear solve of depth control.
        force_search_factor = 2
        solves_per_row = (1 if self.largest_force is None else force_search_factor) * (
            2 if self.slip_reference == "mid" else 1
        )
        mixed = any(
            region.formulation == "mixed" or region.material.flow for region in self.domain.regions
        )
        stages = 2 if self.permeable_regions else 1
        is_nonlinear = self.contact.is_path_dependent or not self.is_linear
        steps = len(self.deltas) + sum(map(len, self.path.turns))
        # The contact of a hold must not grow. Three-dimensional holds have not been measured.
        is_hold_linear = (
            self.domain.dim == 2
            and not is_nonlinear
            and not self.is_swelling
            and self.path.control == "depth"
        )
        holding_steps = self.path.hold_count if self.is_time_dependent and is_hold_linear else 0
        touches = [False, *(delta > 0 for delta in self.deltas)]
        snaps = (
            sum(touches_now != touches_next for touches_now, touches_next in pairwise(touches))
            if self.contact.may_snap_through
            else 0
        )
        is_nonlinear_in_time = self.is_time_dependent and not self.small_strain
        moving_solves = stages * solves_per_row * (steps - holding_steps)
        holding_solves = stages * holding_steps
        return SolverWork(
            method,
            linear,
            mixed,
            moving_solves,
            is_nonlinear,
            self.has_friction,
            snaps,
            is_nonlinear_in_time,
            holding_solves,
            self._sliding_solves,
            self.yields,
        )

    @property
    def slides_around_edge(self) -> bool:
        """True if the surface slides around the edge of a flat punch, which friction prevents."""
        is_sliding = self.gap == "current" and not self.has_friction and not self.is_compressed
        return is_sliding and isinstance(self.indenter.upright, FlatPunch)

    @property
    def _sliding_solves(self) -> float:
        """Linear solves while the surface slides around the edge of a flat punch, or 0.

        The increments become shorter with the depth, since the stretched layer at the edge becomes
        thinner.
        """
        tip = self.indenter.upright
        if not isinstance(tip, FlatPunch) or not self.slides_around_edge:
            return 0.0
        depth = max(self.max_depth, 0.0) / tip.radius
        steady_depth = STEADY_SLIDING_DEPTH[0] + STEADY_SLIDING_DEPTH[1] * (
            tip.edge_radius / tip.radius
        )
        # No path was measured to more solves; most are given up before.
        most_solves = 2000.0
        growth = min(SLIDING_SOLVES_GROWTH * max(depth - steady_depth, 0.0), 100.0)
        radii = min(depth, steady_depth) + (exp(growth) - 1) / SLIDING_SOLVES_GROWTH
        return min(SLIDING_SOLVES * radii, most_solves)


def largest_diffusivity(physics: ProblemDefinition) -> float:
    """Return the largest diffusivity D [length^2/time] of the regions with pore fluid."""
    return max(region.material.diffusivity for region in physics.permeable_regions)


def is_undrained_incompressible(physics: ProblemDefinition) -> bool:
    """True if a body whose top the tip covers cannot be compressed before fluid drains."""
    is_closed = all(
        physics.domain.supports.get(wall, "free") != "free"
        for wall in physics.domain.wall_distances(physics.center)
    )
    is_full = all(
        region.material.flow and not region.material.flow.storage
        for region in physics.domain.regions
    )
    return bool(physics.is_compressed and is_closed and is_full)


def has_drained_surface(physics: ProblemDefinition) -> bool:
    """True if fluid drains from a body whose top the tip covers."""
    drainage = physics.drainage
    return drainage.tip != "sealed" or drainage.base != "sealed" or bool(physics.drained_walls)
