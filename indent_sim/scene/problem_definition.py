"""The nondimensional problem: body, tip, contact law, load path and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.model.body import (
    Body,
    Drainage,
)
from indent_sim.model.contact import ActiveSet, ContactLaw, SlipReference
from indent_sim.model.loading import LoadPath
from indent_sim.model.materials import Gel, Material
from indent_sim.model.state import FLUID_COLUMNS, FRICTION_COLUMNS
from indent_sim.model.tips import Indenter
from indent_sim.model.units import Scales
from indent_sim.scene.compression_theory import covers_top
from indent_sim.scene.cost import SolverWork
from indent_sim.scene.depth_limits import Center, side_contact_depth
from indent_sim.scene.reference_theory import relative_tip

# Stretch of a skin across over that along it, from which the surface of an incompressible network
# has creases (Hong, Zhao & Suo 2009, Appl. Phys. Lett. 95, 111901); a smooth surface is without any
# stability from 3.4 on (Biot 1963)
CREASING_STRETCH = 2.4
FORCE_SEARCH_FACTOR = (
    2  # times the linear solves of a step to a known depth are needed to find the depth of a force
)
# gamma/(mu R) from which nothing but its tension holds a surface of radius R: with 33 a ball
# between plates is solved by the body alone, in 300 iterations, with 100 it is not
DROP_THRESHOLD = 50.0


@dataclass(frozen=True)
class ProblemDefinition:
    """What is simulated, without units: every number is divided by the `scales`.

    It begins as the config gives it, with contact as theory has it; the choices of a mesh replace
    what they decide.
    """

    scales: Scales
    body: Body
    domain: ModelDomain  # of the body, modelled
    indenter: Indenter
    center: Center
    path: LoadPath  # what is prescribed, step by step
    deltas: tuple[float, ...]  # prescribed, or expected at the prescribed forces
    contact: ContactLaw = field(default_factory=ActiveSet)
    gap: str = "reference"  # or current
    wall_stiffness: float = (
        0.0  # of the weak u . n = 0 on the curved wall of a cylinder in three dimensions; 0: none
    )
    slip_reference: SlipReference = (
        "implicit"  # of what comes into contact during a step, with friction
    )
    surface_tension: float = 0.0  # of the contact surface [pressure length]
    drainage: Drainage = field(
        default_factory=Drainage
    )  # of regions with a flow; times are the scene's own
    bath_ramp: float = 0.0  # in which a sudden bath comes [time]; 0: at once

    @cached_property
    def is_compressed(self) -> bool:
        """Whether a plate, or a punch wider than the body, presses on all of its flat top."""
        return covers_top(self.indenter, self.body, self.center)

    @cached_property
    def max_depth(self) -> float:
        """The largest depth of the path [length], which every row asks for."""
        return max(self.deltas)

    @cached_property
    def side_contact_depth(self) -> float:
        """The depth at which the tip meets the top of a fixed side [length], which every row is
        held to.
        """
        return side_contact_depth(self.body, self.indenter, self.center)

    @property
    def has_friction(self) -> bool:
        """Whether the tip drags on the surface."""
        return not self.contact.is_conservative

    @property
    def largest_force(self) -> float | None:
        """The largest prescribed force [pressure length^2]; None where depths are prescribed."""
        return max(self.path.values) if self.path.control == "force" else None

    @property
    def side_force_axes(self) -> dict[str, int]:
        """The horizontal axes, by name, along which friction may push the tip: it does not stand
        over a mirror plane across, which is a roller wall, there; an edge that is free or fixed
        is none.
        """
        if not self.has_friction or self.domain.kinematics.name == "axisymmetric":
            return {}
        mirror_surfaces = self.domain.mirror_walls(self.center)
        axes = {name: axis for axis, name in enumerate("xy"[: self.domain.dim - 1])}
        return {
            name: axis
            for name, axis in axes.items()
            if not mirror_surfaces & {f"{name}_min", f"{name}_max"}
        }

    @property
    def mirror_multiplicity(self) -> int:
        """How many times the body the tip sees (`Part.seen_by`)."""
        return self.domain.mirrored_body_count(self.center)

    def full_contact_radius(self, a: float) -> float:
        """The radius [length] of the whole contact, mirrored where the tip sees it go on, of a
        row's radius a, which is that of a circle (half a width) as large as the contact on the
        body itself.
        """
        kinematics = self.domain.kinematics
        return (
            a
            if self.mirror_multiplicity == 1
            else kinematics.contact_radius(self.mirror_multiplicity * kinematics.contact_area(a))
        )

    def row_contact_radius(self, a: float) -> float:
        """The radius [length] that a row has of a whole contact of radius a: the other way round."""
        kinematics = self.domain.kinematics
        return (
            a
            if self.mirror_multiplicity == 1
            else kinematics.contact_radius(kinematics.contact_area(a) / self.mirror_multiplicity)
        )

    @property
    def drained_walls(self) -> tuple[str, ...]:
        """The walls that let fluid out of the pores."""
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
        """The regions in whose pores fluid flows."""
        return tuple(region for region in self.domain.regions if region.material.flow)

    @property
    def is_porous_column(self) -> bool:
        """Whether fluid flows in a body whose top the tip covers, as in Terzaghi's consolidation."""
        return self.is_compressed and bool(self.permeable_regions)

    def bath_pressure(self, region: Region, t: float) -> float:
        """p_b [pressure] of the bath that a permeable region sees, at a time since rest; 0 until
        then.
        """
        if t <= 0:
            return 0.0
        bath: float = region.material.bath_pressure(self.drainage.bath_at(t))
        return bath * min(1.0, t / self.bath_ramp) if self.bath_ramp else bath

    @property
    def is_swelling(self) -> bool:
        """Whether a bath makes it swell or shrink."""
        return any(
            region.material.bath_pressure(bath) != 0
            for region in self.permeable_regions
            for bath in self.drainage.bath_values
        )

    @property
    def surface_layer_stretch(self) -> float:
        """The stretch across the surface of a gel whose skin has swollen, held sideways by what is
        beneath it; 1 without a gel at the surface. A free body has such a skin at first, a body
        between walls for good.
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
        """That the skin of a gel swells so much that its surface does not stay smooth, in words;
        empty where it does not.
        """
        if self.surface_layer_stretch <= CREASING_STRETCH:
            return ""
        swelling_text = (
            f"the gel's skin swells to {self.surface_layer_stretch:.3g} times its thickness, held "
            "sideways by what is beneath"
        )
        return f"{swelling_text}, and from {CREASING_STRETCH:g} on its surface has creases, which are not followed"

    def is_closed_by_swelling(self, depth: float, a: float) -> bool:
        """Whether a contact of radius a is wider than the tip at its depth, which pressing alone
        makes none.
        """
        return self.is_swelling and a > relative_tip(self.indenter, self.body).radius_at(
            max(depth, 0.0)
        )

    @property
    def relaxing_regions(self) -> tuple[Region, ...]:
        """The regions whose shear stress relaxes."""
        return tuple(region for region in self.domain.regions if region.material.relaxation)

    @property
    def is_time_dependent(self) -> bool:
        """Whether the body changes while the tip stands still."""
        return any(region.material.is_time_dependent for region in self.domain.regions)

    @property
    def is_path_dependent(self) -> bool:
        """Whether a row depends on the path to it, or on the time that it takes."""
        return self.contact.is_path_dependent or self.is_time_dependent

    @property
    def depends_on_step_size(self) -> bool:
        """Whether a row depends on the steps in which the path to it is followed."""
        return self.has_friction or self.is_time_dependent

    @property
    def searches_pull_off(self) -> bool:
        """Whether the largest pull is searched for between rows.

        It is where a tip that attracts over a range is drawn out along prescribed depths.
        """
        if not self.contact.adhesion_range or self.path.control != "depth":
            return False
        steps = range(1, len(self.path.values) + 1)
        depths = [depth for row in steps for depth, _ in self.path.segment(row)]
        return any(after < before for before, after in pairwise(depths))

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the force table that only some scenes have, in order."""
        fluid = FLUID_COLUMNS if self.permeable_regions else ()
        if not self.has_friction:
            return fluid
        side_force_columns = [f"side_force_{axis}" for axis in self.side_force_axes]
        return (
            *(
                name
                for name in FRICTION_COLUMNS
                if not name.startswith("side") or name in side_force_columns
            ),
            *fluid,
        )

    @property
    def material(self) -> Material:
        """What the tip touches: its E* compares pressures with lengths."""
        return self.domain.regions[0].material

    @property
    def small_strain(self) -> bool:
        """Whether the strain is small in all of the body."""
        return all(region.material.is_small_strain for region in self.domain.regions)

    @property
    def largest_locking_nu(self) -> float:
        """The largest Poisson's ratio, on the way, of displacement elements without fluid, whose
        pressure bears what would lock.
        """
        locking_regions = [
            candidate
            for candidate in self.domain.regions
            if candidate.formulation == "displacement" and not candidate.material.flow
        ]
        return max((region.softest_constants.nu for region in locking_regions), default=0.0)

    @property
    def largest_nu(self) -> float:
        """Poisson's ratio of what the tip touches in its most incompressible state on the way."""
        return self.domain.regions[0].softest_constants.nu

    @property
    def drop_number(self) -> float:
        """gamma/(mu R) of a round body at finite strain, by the softest of its regions; 0 without
        tension.
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
        """Whether next to nothing but its tension holds the surface of a round body."""
        return self.drop_number >= DROP_THRESHOLD

    @property
    def is_linear(self) -> bool:
        """Whether the strain is small and the gap tested at the undeformed point."""
        return self.small_strain and self.gap == "reference"

    def solver_work(self, method: str, linear: str) -> SolverWork:
        """What a solver of this kind has to do for it."""
        solves_per_row = (1 if self.largest_force is None else FORCE_SEARCH_FACTOR) * (
            2 if self.slip_reference == "mid" else 1
        )
        mixed = any(
            region.formulation == "mixed" or region.material.flow for region in self.domain.regions
        )
        stages = 2 if self.permeable_regions else 1
        is_nonlinear = self.contact.is_path_dependent or not self.is_linear
        steps = len(self.deltas) + sum(map(len, self.path.turns))
        # where nothing makes the contact grow; in three dimensions nobody has measured it
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
        )


def largest_diffusivity(physics: ProblemDefinition) -> float:
    """The largest diffusivity D [length^2/time] of the regions in which fluid flows."""
    return max(region.material.diffusivity for region in physics.permeable_regions)


def is_undrained_incompressible(physics: ProblemDefinition) -> bool:
    """Whether a tip as wide as a body between its walls finds no way to press it while no fluid
    leaves.
    """
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
    """Whether fluid leaves a body whose top the tip covers."""
    drainage = physics.drainage
    return drainage.tip != "sealed" or drainage.base != "sealed" or bool(physics.drained_walls)
