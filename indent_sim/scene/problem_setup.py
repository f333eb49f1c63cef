"""The scene before any choice: without units, its modelled part, its theory and the depths to
expect.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from itertools import pairwise
from math import ceil, inf, isfinite, log2, sqrt
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from indent_sim.mesh import imported_domain, mesh_import
from indent_sim.mesh.imported_mesh import BoundaryCells, ImportedMesh
from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.model.body import (
    Ball,
    Body,
    Cap,
    DimensionedBody,
    Drainage,
    HalfSpace,
    ImportedBody,
    Layer,
    MeshFromFile,
    Points,
    SphericalBody,
    UnboundedBody,
)
from indent_sim.model.contact import ActiveSet, Adhesion, ContactLaw, SlipReference
from indent_sim.model.experiment import Experiment, JKRAdhesion
from indent_sim.model.loading import STEPS_PER_DOUBLING, History, Loading, LoadPath
from indent_sim.model.materials import LOCKING_POISSON_RATIO, Gel, Material, PronySeries, Relaxation
from indent_sim.model.state import FLUID_COLUMNS, FRICTION_COLUMNS
from indent_sim.model.tips import FlatPunch, Indenter, Plate
from indent_sim.model.units import Scales, round_length
from indent_sim.process.errors import ConfigError
from indent_sim.process.ranks import run_on_root
from indent_sim.scene.cost import SolverWork
from indent_sim.scene.domain_truncation import Truncation, expected_depth, truncate
from indent_sim.scene.reference_theory import (
    RADIUS_TOLERANCE,
    adhesive_radii,
    covers_top,
    half_space_force,
    relative_tip,
    relaxed_law,
    theory_of,
    undrained_law,
)
from indent_sim.scene.resolution import target_error
from indent_sim.scene.symmetry_reduction import reduce
from indent_sim.theory.half_space import estimate_depth
from indent_sim.theory.solution import Solution
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.theory.adhesion import Jkr

MAX_DEPTH_FRACTION = 0.9  # of the thickness: there no force is expected to find its depth
# at which theory is asked for a depth: the largest sizes the mesh, and a search needs no more
MAX_THEORY_FORCES = 3
D = TypeVar("D")
Layers = tuple[Layer, ...]
Center = tuple[float, ...]  # horizontal position of the tip's axis [length]
# Of the time that fluid takes through the contact, and of that through an element: the first step
# of a piece. In less than the second an element of linear pressure does not drain as a half-space
# does, and the force is up to 1.4 % low
FIRST_STEP_FRACTION = 1e-3
ELEMENT_DRAINAGE_FACTOR = 6.0
# Of the time that fluid takes through the contact, or through a thinner body: within this a sudden
# bath comes at finite strain, in RAMP_STEPS first steps, since no Newton step finds the layer that
# swells at once. Elements of a tenth of the contact radius just drain in such a step,
# h^2/(DRAINS_ELEMENT D)
RAMP_STEPS = 8.0
BATH_RAMP_FRACTION = RAMP_STEPS / ELEMENT_DRAINAGE_FACTOR / 10**2
# Of the force, with PER_DOUBLING steps of each length; of second order in them. What rubs is known
# to less: its error bar is five times what half steps change
TIME_STEPPING_ERROR = 0.004
FRICTION_STEPPING_ERROR = 0.02
STEPS_PER_RELAXATION_TIME = 20.0  # first steps of a piece in the shortest time of a relaxation
# Of the shortest piece of a history: its first step at least, and of that the shortest time of a
# power law, which is a sum of exponentials down to there
MIN_STEP_FRACTION = 1e-3
SHORTEST_TIME_FRACTION = 1e-2
# Stretch of a skin across over that along it, from which the surface of an incompressible network
# has creases (Hong, Zhao & Suo 2009, Appl. Phys. Lett. 95, 111901); a smooth surface is without any
# stability from 3.4 on (Biot 1963)
CREASING_STRETCH = 2.4
BISECTIONS = 40  # of the way of a spring's base, until the depth is known
ATTRACTION_CUTOFF = (
    7.0  # ranges of gap up to which an attraction counts: beyond, a thousandth of its work is left
)
RIM_TOLERANCE = 1e-9  # of a contact surface, from the tip's axis to its rim: less is none
FORCE_SEARCH_FACTOR = (
    2  # times the linear solves of a step to a known depth are needed to find the depth of a force
)
# gamma/(mu R) from which nothing but its tension holds a surface of radius R: with 33 a ball
# between plates is solved by the body alone, in 300 iterations, with 100 it is not
DROP_THRESHOLD = 50.0
MAX_DISPLACEMENT_NU = (
    0.49999  # Poisson's ratio beyond which a displacement element's matrix loses its digits
)


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


@dataclass(frozen=True)
class DiffusionTimes:
    """How long the fluid takes [time] through the contact, an element, the body's height and half
    of the way to its wall. The first step of a piece is a thousandth of the contact's, but none
    in which an element cannot drain.
    """

    contact: float
    element: float
    height: float
    wall: float

    @staticmethod
    def compute(
        setup: ProblemSetup, physics: ProblemDefinition, h_contact: float
    ) -> DiffusionTimes:
        """Those of a scene's fastest region; h_contact [length]."""
        D = largest_diffusivity(physics)
        lengths = (
            setup.a,
            h_contact,
            physics.body.height,
            physics.body.lateral_extent(physics.center) / 2,
        )
        return DiffusionTimes(*(length**2 / D for length in lengths))

    def first_step(self, shortest: float) -> float:
        """Of the steps of a piece, beside what takes a `shortest` one [time]."""
        return max(
            min(FIRST_STEP_FRACTION * self.contact, shortest),
            self.element / ELEMENT_DRAINAGE_FACTOR,
        )


def largest_diffusivity(physics: ProblemDefinition) -> float:
    """The largest diffusivity D [length^2/time] of the regions in which fluid flows."""
    return max(region.material.diffusivity for region in physics.permeable_regions)


@dataclass(frozen=True)
class ProblemSetup:
    """A scene as given, before any choice: its physics, and what it leads to expect."""

    physics: ProblemDefinition
    truncation: Truncation | None  # of a body without end, for which this one stands
    layers: Layers  # from the top, each with its thickness and material
    relative_tip: Indenter  # the tip over a flat body, see `relative_tip`
    domain_reason: str
    theory: Theory | None
    experiment: Experiment | None  # without units
    history: (
        History | None
    )  # without units; `physics.path` goes to the largest depth that it may come to
    relaxation: Relaxation | None
    uses_time_stepping: bool  # whether a relaxing body is followed step by step
    steps_per_doubling: int  # steps of each length, where fluid flows
    attraction: Adhesion | None  # of the contact
    theory_without_tension: Theory | None  # the theory of the same body without a surface tension
    surface_rise: float  # how far a gel's surface rises at most, where nothing is above it [length]
    expected_radius: Callable[[float], float] = field(
        repr=False
    )  # the contact radius [length] to expect at a depth [length]
    theory_for_materials: Callable[[Callable[[Material], Material]], Theory | None] = field(
        repr=False
    )  # all of it changed so

    @property
    def is_half_space(self) -> bool:
        """Whether the body is a half-space, or stands for one."""
        stands_for_one = self.truncation is not None and self.truncation.represents == "half-space"
        return stands_for_one or isinstance(self.physics.body, HalfSpace)

    @property
    def max_depth(self) -> float:
        """The largest depth [length], in what has swollen by then."""
        return max(self.physics.deltas) + self.surface_rise

    @property
    def a(self) -> float:
        """The contact radius [length] to expect at the deepest point, adhesion included."""
        if self.adhesive_radii and self.max_depth <= 0:  # no other tip touches there
            return max(self.adhesive_radii)
        return max([self.expected_radius(self.max_depth), *self.adhesive_radii])

    @property
    def elastocapillary_length(self) -> float:
        """gamma/E* [length]: a surface flatter than that is held by what is below it, a sharper one
        by its tension.
        """
        return self.physics.surface_tension / self.physics.material.E_star

    @property
    def jkr_limit(self) -> JKRAdhesion | None:
        """The adhesion of the experiment, which takes it without range."""
        return self.experiment.adhesion if self.experiment else None

    @cached_property
    def adhesive_radii(self) -> tuple[float, float] | tuple[()]:
        """Contact radii [length] with adhesion, without range: the smallest that comes off and the
        deepest one's.
        """
        jkr_adhesion = self.jkr_limit
        if self.attraction and self.physics.body.dim == 3:
            attraction = self.attraction
            force = self.physics.largest_force
            return adhesive_radii(
                self.theory, self.relative_tip, self.layers, attraction.work, self.max_depth, force
            )
        if jkr_adhesion is None or self.physics.domain.kinematics.name != "axisymmetric":
            return ()
        return adhesive_radii(
            self.theory, self.relative_tip, self.layers, jkr_adhesion.work, self.max_depth, None
        )

    @cached_property
    def jkr(self) -> Jkr | None:
        """The contact of a tip that adheres as if its attraction had no range; None where theory
        does not know it.
        """
        return self.theory.jkr(self.attraction.work) if self.attraction and self.theory else None

    def solution(self, delta: float) -> Solution | None:
        """Theory's contact at a depth [length], where there is a theory."""
        return self.theory.solution_at_depth(delta) if self.theory else None


def set_up_problem(config: Config, imported_mesh: ImportedMesh | None = None) -> ProblemSetup:
    """The scene without units, its body as given; ConfigError for one that cannot exist.
    piece: what `read_imported_mesh` finds in the config's mesh file, where somebody has read it."""
    body = config.body
    if isinstance(body, MeshFromFile):
        meshed_body, imported_mesh = _position_imported_mesh(
            config, body, imported_mesh or _read_mesh_file(config, body)
        )
        return _set_up(config, meshed_body, meshed_body.layers, None, imported_mesh)
    layers = _elastic_layers(config)
    if isinstance(body, Cap | Ball):
        spherical_body = body.spherical_body
        (*coatings, core) = layers
        core = replace(
            core,
            thickness=spherical_body.height - sum(layer.thickness or 0.0 for layer in coatings),
        )
        return _set_up(config, spherical_body, (*coatings, core), None, None)
    return _set_up(config, body, layers, None, None)


def truncate_body(config: Config, setup: ProblemSetup) -> ProblemSetup:
    """The scene on a body that can be meshed: one large enough stands for a body without end."""
    if not isinstance(config.body, UnboundedBody):
        return setup
    deepest = setup.max_depth
    if setup.adhesive_radii:  # as deep as a tip that does not adhere has this contact
        deepest = max(deepest, 2 * float(setup.physics.indenter.height(setup.a, 0.0)))
    if setup.attraction:  # or as far as it is felt
        deepest = max(deepest, 2 * ATTRACTION_CUTOFF * (setup.attraction.range or 0.0))
    states = _layers_in_extreme_states(config)
    depth = deepest * setup.physics.scales.length
    truncation = truncate(config.body, config.indenter, states, depth, tension_width_factor(setup))
    return _set_up(config, truncation.body, truncation.layers, truncation, None)


def _layers_in_extreme_states(config: Config) -> list[Layers]:
    """Return the layers in the elastic states between which their materials change with time.

    The drained and unrelaxed state is the first. The undrained state, and that of the shear modulus
    which has relaxed most, are less compressible: on a frictionless base a wall is felt from much
    farther away.
    """
    layers = _elastic_layers(config)
    states = [layers]
    if any(layer.material and layer.material.flow for layer in layers):
        states.append(
            tuple(
                replace(layer, material=layer.material and undrained_law(layer.material))
                for layer in layers
            )
        )
    shares = [
        _least_shear_fraction(config, layer.material) if layer.material else 1.0 for layer in layers
    ]
    if min(shares) < 1:
        softened = [
            replace(layer, material=layer.material and relaxed_law(layer.material, share))
            for layer, share in zip(layers, shares, strict=True)
        ]
        states.append(tuple(softened))
    return states


def tension_width_factor(setup: ProblemSetup) -> float:
    """How many times as wide a finite body must be for its surface tension: the force that it adds
    is felt as far away, and the surface beside the contact is flat over gamma/E*.
    """
    elastocapillary_length = setup.elastocapillary_length
    theory_without_tension = setup.theory_without_tension
    if not elastocapillary_length or theory_without_tension is None or setup.max_depth <= 0:
        return 1.0
    solution = setup.solution(setup.max_depth)
    reference = theory_without_tension.solution_at_depth(setup.max_depth)
    force = solution.force / reference.force if solution and reference else 1.0
    return max(force, 1.0 + elastocapillary_length / setup.physics.body.height)


def _set_up(
    config: Config,
    whole_body: Body,
    layers: Layers,
    truncation: Truncation | None,
    imported_mesh: ImportedMesh | None,
) -> ProblemSetup:
    material = _layer_material(layers[0])
    center = whole_body.center if truncation else config.center or whole_body.center
    contacts = whole_body.contacts_per_body if isinstance(whole_body, SphericalBody) else 1
    history = config.loading.prescribed_history
    relaxations = [law.relaxation for _, law in config.materials() if law.relaxation]
    relaxation = next((law for law in relaxations if law.of == "all"), None)  # of the curve
    compliance = config.experiment.compliance if config.experiment else 0.0
    least_modulus_fraction = min(
        (remaining_modulus_fraction(law, history) for law in relaxations), default=1.0
    )
    indenter = _plate_if_covering(config.indenter, whole_body, center)
    tip = relative_tip(indenter, whole_body)
    path = (
        path_to_max_depth(history, least_modulus_fraction, compliance, tip, layers)
        if history
        else config.loading.path()
    )
    _check_scene(whole_body, layers, indenter, center, path, contacts, "loading")
    scales = Scales(
        _length_unit(whole_body, layers, indenter, path),
        material.constants.E,
        whole_body.dim,
        contacts,
    )
    body = scales.nondimensionalize(whole_body)
    tip = scales.nondimensionalize(indenter)
    material = scales.nondimensionalize(material)
    layers = tuple(map(scales.nondimensionalize, layers))
    center = tuple(round_length(c / scales.length) for c in center)
    history = history and history.nondimensionalize(scales.control_unit(history.control))
    path = path.nondimensionalize(scales.control_unit(path.control))
    domain, domain_reason = _model_domain(config, body, imported_mesh, center, tip, layers, scales)
    whole_body = (
        scales.nondimensionalize(config.body) if isinstance(config.body, UnboundedBody) else body
    )
    tension = scales.nondimensionalize(config.body).surface_tension
    theory = theory_of(whole_body, layers, tip, center, tension)
    relative = relative_tip(tip, body)
    deltas = expected_depths(
        path, theory, relative, material, body.height, scales, domain.mirrored_body_count(center)
    )
    drainage = _drainage(config, history, scales)
    physics = ProblemDefinition(
        scales, body, domain, tip, center, path, deltas, surface_tension=tension, drainage=drainage
    )
    attraction = scales.nondimensionalize(config.contact).adhesion
    radius = cache(partial(_expected_radius, theory, (relative, tip), body, center))
    theory = theory and theory.checked_for_tension(deltas)

    def theory_with(change: Callable[[Material], Material]) -> Theory | None:
        changed = [replace(layer, material=change(_layer_material(layer))) for layer in layers]
        return theory_of(whole_body, changed, tip, center, tension)

    experiment = config.experiment and config.experiment.nondimensionalize(scales)
    uses_time_stepping = needs_time_stepping(history, relaxation, compliance)
    steps_per_doubling = _steps_per_doubling(config)
    theory_without_tension = theory_of(whole_body, layers, tip, center) if tension else theory
    expectations = (
        relative,
        domain_reason,
        theory,
        experiment,
        history,
        relaxation,
        uses_time_stepping,
        steps_per_doubling,
        attraction,
        theory_without_tension,
    )
    return ProblemSetup(
        physics,
        truncation,
        layers,
        *expectations,
        _max_surface_rise(drainage, layers),
        radius,
        theory_with,
    )


def _plate_if_covering(tip: Indenter, body: Body, center: Center) -> Indenter:
    """A plate in place of a sharp punch that is exactly as wide as a flat top: such a punch is
    meant as a plate, and its edge would cut into the rim, which bulges at finite strain.
    """
    if not isinstance(tip, FlatPunch) or tip.edge_radius or not covers_top(tip, body, center):
        return tip
    return (
        Plate() if tip.radius <= body.max_lateral_extent(center) * (1 + RADIUS_TOLERANCE) else tip
    )


def _model_domain(
    config: Config,
    body: Body,
    imported_mesh: ImportedMesh | None,
    center: tuple[float, ...],
    tip: Indenter,
    layers: Layers,
    scales: Scales,
) -> tuple[ModelDomain, str]:
    """The modelled piece of a body, and why it is that one."""
    if isinstance(body, ImportedBody):
        assert imported_mesh is not None
        return _imported_domain(config, imported_mesh, scales)
    regions = (*_layer_regions(config, layers), *_inclusion_regions(config, body, scales))
    return reduce(_round_lengths(body), center, config.mesh.symmetry, tip, regions)


def _drainage(config: Config, history: History | None, scales: Scales) -> Drainage:
    """Where fluid leaves, without units, its times from the begin of the history; ConfigError for a
    gel's bath with a unit.
    """
    drainage = (config.drainage or Drainage()).with_time_origin(
        history.points[0][0] if history else 0.0
    )
    scaled = scales.nondimensionalize(drainage)
    if not any(isinstance(material, Gel) for _, material in config.materials()):
        return scaled
    if any(key[:2] == ("drainage", "bath") for key in config.source.quantities):
        problem = "has a unit, and of a gel it is the solvent's chemical potential over kT"
        raise ConfigError("drainage.bath", problem, "a plain number, 0 for the pure solvent")
    return replace(scaled, bath=drainage.bath)


def _steps_per_doubling(config: Config) -> int:
    """Steps in time of one length, as given or as the accuracy asks: errors fall with their square."""
    default_error = (
        TIME_STEPPING_ERROR if config.contact.is_conservative else FRICTION_STEPPING_ERROR
    )
    step_factor = ceil(sqrt(default_error / (target_error(config.accuracy) or default_error)))
    return config.loading.per_doubling or STEPS_PER_DOUBLING * max(1, step_factor)


def _max_surface_rise(drainage: Drainage, layers: Layers) -> float:
    """How far the surface of gels rises above that at rest, held sideways, in the bath in which
    they swell most [length]; ConfigError for a bath in which they are not at rest, or rise
    without end.
    """

    def rise(bath: float) -> float:
        total_rise = 0.0
        for layer in layers:
            law = _layer_material(layer)
            if (
                isinstance(law, Gel)
                and law.flow
                and (stretch := _confined_swelling_stretch(law, bath)) != 1
            ):
                total_rise += (stretch - 1) * layer.thickness if layer.thickness else inf
        return total_rise

    max_rise = max(0.0, *(rise(bath) for bath in drainage.bath_values))
    if not isfinite(max_rise):
        problem = "lets a gel without end swell, whose surface rises without end"
        raise ConfigError(
            "drainage.bath", problem, "use a layer or a cylinder, or stretch: auto and one bath"
        )
    return max_rise


def _confined_swelling_stretch(law: Gel, bath: float) -> float:
    try:
        return law.confined_swelling(law.bath_pressure(bath)).stretch
    except ValueError as error:
        raise ConfigError("drainage.bath", str(error), "nearer to that of free swelling") from None


def expected_depths(
    path: LoadPath,
    theory: Theory | None,
    tip: Indenter,
    material: Material,
    height: float,
    scales: Scales,
    mirror_multiplicity: int = 1,
) -> tuple[float, ...]:
    """The requested depths, or those to expect at the requested forces, within DEEPEST of the
    body's height.

    Of forces by theory, or by the tip's section where there is none or it ends; between MOST_FORCES
    by power laws. seen: how many times the body the tip sees, each with the prescribed force.
    ConfigError when theory says that a linear body does not bear the largest force.
    """
    if path.control == "depth":
        return path.values
    max_depth = MAX_DEPTH_FRACTION * height
    forces = [mirror_multiplicity * force for force in path.values]
    positive_forces = np.unique([force for force in forces if force > 0])
    sample_forces = (
        positive_forces
        if len(positive_forces) <= MAX_THEORY_FORCES
        else np.geomspace(positive_forces[0], positive_forces[-1], MAX_THEORY_FORCES)
    )
    sample_depths = []
    E_star = material.E_star
    for force in map(float, sample_forces):
        start = estimate_depth(tip.radius_at, force, E_star) if scales.dim == 3 else force / E_star
        depth = (theory and theory.depth_of_force(force, max_depth)) or min(start, max_depth / 2)
        sample_depths.append(float(f"{depth:.9g}"))  # the same in all units, and so is the mesh
    interpolate_log = partial(np.interp, xp=np.log(sample_forces), fp=np.log(sample_depths))
    depths = tuple(
        float(np.exp(interpolate_log(np.log(force)))) if force > 0 else 0.0 for force in forces
    )
    if material.is_small_strain and theory and max(depths) > (1 - 1e-6) * max_depth:
        largest = max(path.values) * scales.force
        problem = (
            f"a force of {largest:g} would press the tip to {MAX_DEPTH_FRACTION:.0%} of the body's "
            "thickness or deeper"
        )
        raise ConfigError("loading", problem, "use a smaller force")
    return depths


def problem_along_history(
    setup: ProblemSetup, physics: ProblemDefinition, h_contact: float
) -> ProblemDefinition:
    """Physics whose path is the rows of the history, in place of the way to its deepest one;
    h_contact [length].
    """
    assert setup.history is not None
    path = setup.history.path
    if physics.is_time_dependent:
        physics = replace(physics, domain=_expand_relaxation(physics, setup.history))
        physics = replace(physics, bath_ramp=bath_ramp_time(setup, physics))
        path = setup.history.time_stepped_path(
            first_step(setup, physics, h_contact), setup.steps_per_doubling
        )
        if is_undrained_incompressible(physics) and not _has_drained_surface(physics):
            problem = (
                "no fluid leaves the pores, and the tip covers the top of a body that is held on "
                "all other sides"
            )
            remedy = (
                "drain the tip, the base or the sides, free the sides, or give the material some "
                "flow.storage"
            )
            raise ConfigError("drainage", f"{problem}: it cannot be compressed", remedy)
        if path.has_jumps and is_undrained_incompressible(physics):
            path = _remove_jumps(
                path, "loading.force_history" if path.control == "force" else "loading.history"
            )
    tip = setup.relative_tip
    height = physics.body.height
    return replace(
        physics,
        path=path,
        deltas=expected_depths(
            path,
            setup.theory,
            tip,
            physics.material,
            height,
            physics.scales,
            physics.mirror_multiplicity,
        ),
    )


def bath_ramp_time(setup: ProblemSetup, physics: ProblemDefinition) -> float:
    """Return the time [time] over which the chemical potential of a gel's bath ramps up linearly.

    It is 0 for a body that no bath swells or shrinks, and for a sudden bath. The key
    `drainage.bath_ramp` gives it; for `auto` at finite strain it is BATH_RAMP L^2/D, where D is the
    largest diffusivity and L the smaller of the expected contact radius and the body's height. The
    ramp does not depend on the mesh.
    """
    if not physics.is_swelling:
        return 0.0
    if physics.drainage.bath_ramp != "auto":
        return physics.drainage.bath_ramp
    if physics.small_strain:
        return 0.0
    return (
        BATH_RAMP_FRACTION * min(setup.a, physics.body.height) ** 2 / largest_diffusivity(physics)
    )


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


def _has_drained_surface(physics: ProblemDefinition) -> bool:
    """Whether fluid leaves a body whose top the tip covers."""
    drainage = physics.drainage
    return drainage.tip != "sealed" or drainage.base != "sealed" or bool(physics.drained_walls)


def _remove_jumps(path: LoadPath, key: str) -> LoadPath:
    """The path without the places that it reaches in no time; ConfigError where such a place is a
    row that `times` asks for, or where there is no other row.
    """
    requested_jumps = path.sudden_rows if path.turns else ()
    if requested_jumps or len(path.sudden_rows) == len(path.values):
        time_text = f" at t = {path.times[requested_jumps[0] - 1]:g}" if requested_jumps else ""
        problem = (
            f"jumps{time_text} on a column that cannot give way before its fluid does: there is no "
            "equilibrium then"
        )
        raise ConfigError(key, problem, "ask for a later time, or let it grow")
    return path.without_sudden_rows()


def first_step(setup: ProblemSetup, physics: ProblemDefinition, h_contact: float) -> float:
    """The first step of a piece of the history [time]: what flows, what relaxes and a bath that
    comes are followed by it; h_contact [length].
    """
    assert setup.history is not None
    times = [
        t
        for region in physics.domain.regions
        if region.relaxation_series
        for t in region.relaxation_series.times
    ]
    shortest = max(
        min(times, default=inf) / STEPS_PER_RELAXATION_TIME,
        MIN_STEP_FRACTION * setup.history.shortest_segment,
    )
    if not physics.permeable_regions:
        return shortest
    first = DiffusionTimes.compute(setup, physics, h_contact).first_step(shortest)
    return min(first, physics.bath_ramp / RAMP_STEPS) if physics.bath_ramp else first


def _expand_relaxation(physics: ProblemDefinition, history: History) -> ModelDomain:
    """The modelled part, its laws of relaxation as sums of exponentials."""

    def followed(region: Region) -> Region:
        law = region.material.relaxation
        shortest = SHORTEST_TIME_FRACTION * MIN_STEP_FRACTION * history.shortest_segment
        return (
            replace(region, relaxation_series=prony_series(law, shortest, history.duration))
            if law
            else region
        )

    return replace(physics.domain, regions=tuple(map(followed, physics.domain.regions)))


def path_to_max_depth(
    history: History,
    least_modulus_fraction: float,
    compliance: float,
    tip: Indenter,
    layers: Sequence[Layer],
) -> LoadPath:
    """Equal steps to the largest depth, or force, that a history may come to.

    What relaxes lets the tip in as far as a body of the least share `least_modulus_fraction` of its modulus, and a
    spring keeps the tip back by the least force that a half-space of the softest layer has.
    """
    largest = history.largest_value
    if history.control == "force":
        return Loading(force=largest / least_modulus_fraction).path()
    if not compliance:
        return Loading(delta=largest).path()
    E_star = least_modulus_fraction * min(_layer_material(layer).E_star for layer in layers)

    def beyond(depth: float) -> bool:
        half_space_formula = half_space_force(tip, depth, E_star)
        radius = tip.radius_at(depth)
        if not half_space_formula and not isfinite(
            radius
        ):  # a plate: the least force of a body is not known
            return depth >= largest
        force = half_space_formula[1] if half_space_formula else 0.5 * E_star * radius * depth
        return depth + compliance * force >= largest

    low = 0.0
    high = largest
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return Loading(delta=high).path()


def needs_time_stepping(history: History | None, law: Relaxation | None, compliance: float) -> bool:
    """Whether a relaxing body is followed step by step: forces or springs, or a tip that comes
    back.
    """
    is_any = history is not None and (
        history.control == "force" or compliance > 0 or history.has_reloading
    )
    return law is not None and is_any


def prony_series(law: Relaxation, shortest: float, longest: float) -> PronySeries:
    """A relaxation as a sum of exponentials; a power law to 1e-5 between two times [time]."""
    if law.power_law is None:
        fractions, times = zip(*(law.prony or ()), strict=True)
        return PronySeries(1.0 - sum(fractions), fractions, times)
    from indent_sim.theory.relaxation_function import (
        PowerLaw,  # with scipy's splines, which no other scene needs
    )

    series = PowerLaw(law.power_law.exponent, law.power_law.time).prony_series(shortest, longest)
    return PronySeries(series.long_term, series.fractions, series.times)


def remaining_modulus_fraction(law: Relaxation | None, history: History | None) -> float:
    """The least share of the instantaneous modulus that a body has during a history; of a power law
    it may be above 1.
    """
    if law is None:
        return 1.0
    if law.power_law is None:
        return 1.0 - sum(fraction for fraction, _ in law.prony or ())
    return (
        float((history.duration / law.power_law.time) ** -law.power_law.exponent)
        if history
        else 1.0
    )


def _length_unit(body: Body, layers: Sequence[Layer], tip: Indenter, path: LoadPath) -> float:
    """The body's height; of a half-space about the contact radius, a power of two, which costs no
    digit.
    """
    if isfinite(body.height):
        return body.height
    deepest = max(path.values)
    depth = expected_depth(tip, layers, deepest) if path.control == "force" else abs(deepest)
    return float(2.0 ** round(log2(tip.radius_at(depth or 1.0))))


def _elastic_layers(config: Config) -> Layers:
    """The layers from the top, each with its thickness (a half-space's last: infinite) and its
    material's constants.
    """
    laws = [_instantaneous_law(config, _layer_material(layer)) for layer in config.layers]
    layers = zip(config.layers, laws, strict=True)
    return tuple(
        replace(layer, thickness=layer.thickness or inf, material=material)
        for layer, material in layers
    )


def _instantaneous_law(config: Config, material: Material) -> Material:
    """The law of the instantaneous constants: what relaxes as a whole is made of its elastic curve.
    A gel has swollen in the scene's first bath where it does not say by how much.
    """
    if isinstance(material, Gel):
        return material.with_free_swelling(config.initial_bath).canonical()
    return replace(
        material.canonical(),
        relaxation=material.relaxation if material.has_shear_relaxation else None,
    )


def _layer_material(layer: Layer) -> Material:
    assert layer.material is not None
    return layer.material


def _layer_regions(config: Config, layers: Layers) -> tuple[Region, ...]:
    """The regions of layers, z of their lower faces rounded as all lengths of a mesh."""
    regions = []
    depths = np.cumsum([layer.thickness for layer in layers])
    for k, (layer, depth) in enumerate(zip(layers, depths, strict=True)):
        name = f"layers[{k}]" if len(layers) > 1 else "body"
        material = _layer_material(layer)
        shear_fraction = _least_shear_fraction(config, material)
        formulation = _formulation(config.material_key(k), material, shear_fraction)
        regions.append(
            Region(
                name,
                material,
                formulation,
                -round_length(float(depth)),
                min_shear_fraction=shear_fraction,
            )
        )
    return tuple(regions)


def _inclusion_regions(
    config: Config, body: DimensionedBody | UnboundedBody, scales: Scales
) -> Iterator[Region]:
    """The regions of inclusions, lengths rounded likewise."""
    laws = [
        _instantaneous_law(config, inclusion.material) for inclusion in config.body.inclusions or ()
    ]
    for k, (inclusion, material) in enumerate(zip(body.inclusions or (), laws, strict=True)):
        law = scales.nondimensionalize(material)
        name = f"inclusions[{k}]"
        shear_fraction = _least_shear_fraction(config, material)
        formulation = _formulation(f"body.{name}.material", law, shear_fraction)
        yield Region(
            name,
            law,
            formulation,
            inclusion=_round_lengths(inclusion),
            min_shear_fraction=shear_fraction,
        )


def _least_shear_fraction(config: Config, material: Material) -> float:
    """What is left of a material's shear modulus when it has relaxed most on the way of a scene, at
    most 1.
    """
    if not material.has_shear_relaxation:
        return 1.0
    return min(
        1.0, remaining_modulus_fraction(material.relaxation, config.loading.prescribed_history)
    )


def _formulation(key: str, material: Material, least_share: float) -> str:
    """Displacements alone, or with a pressure, for the most incompressible state of a material on
    its way.

    Parameters
    ----------
    key : str
        Where the material stands in the scene file.
    material : Material
        Its law at the first moment.
    least_share : float
        What is left of its shear modulus when it has relaxed most.

    Returns
    -------
    str
        displacement | mixed.

    Raises
    ------
    ConfigError
        Where the material or the elements that it asks for cannot.
    """
    nu = material.relaxed_constants(least_share).nu
    requested = material.formulation
    chosen = (
        requested
        if requested != "auto"
        else "mixed"
        if nu >= LOCKING_POISSON_RATIO
        else "displacement"
    )
    law_text = (
        f"nu = {nu:g}" if material.is_isotropic else f"matter as compressible as nu = {nu:.6g}"
    )
    if least_share < 1:
        law_text = f"shear that relaxes to {law_text}"
    if chosen == "displacement" and nu > MAX_DISPLACEMENT_NU:
        raise ConfigError(
            f"{key}.formulation", f"displacement elements cannot carry {law_text}", "use 'mixed'"
        )
    if chosen == "mixed" and nu <= 0:
        raise ConfigError(
            f"{key}.formulation",
            f"'mixed' needs nu > 0, and this is {law_text}",
            "use 'displacement'",
        )
    return chosen


def _position_imported_mesh(
    config: Config, source: MeshFromFile, imported_mesh: ImportedMesh
) -> tuple[ImportedBody, ImportedMesh]:
    """The body that a file has, lowered so that the tip first touches it at z = 0."""
    center = config.center or source.center
    if source.hash not in (None, imported_mesh.hash):
        remedy = "find the mesh that this scene was made with, or leave the hash out"
        raise ConfigError(
            "body.hash", f"'{source.file}' holds another mesh, {imported_mesh.hash}", remedy
        )
    imported_mesh = imported_mesh.with_leading_region(
        imported_domain.region_under_axis(imported_mesh, center)
    )
    imported_domain.refuse_forgotten_mirrors(imported_mesh, source, center)
    placed_mesh = imported_mesh.translated_to_contact(
        imported_domain.first_contact_height(config.indenter, imported_mesh, center)
    )
    return imported_domain.imported_body(
        placed_mesh, source, center, _region_materials(placed_mesh, config)[0][1]
    ), placed_mesh


def read_imported_mesh(config: Config, comm: Any) -> ImportedMesh | None:
    """The body of the config's mesh file, None where it names none (collective).

    On several ranks rank 0 reads the file, has its arrays mapped, and all know the skin of the
    body.
    """
    if not isinstance(config.body, MeshFromFile):
        return None
    if comm.size == 1:
        return _read_mesh_file(config, config.body)
    boundary_cells = run_on_root(comm, _read_boundary_cells, config, config.body)
    shared_cells = comm.bcast(
        replace(boundary_cells, unplaced_mesh=None) if boundary_cells else None, root=0
    )
    return boundary_cells or shared_cells


def _read_mesh_file(config: Config, source: MeshFromFile) -> ImportedMesh:
    """The body as its file, beside the scene's, has it."""
    return mesh_import.import_mesh(os.path.dirname(config.source.name), source, config.material)


def _read_boundary_cells(config: Config, source: MeshFromFile) -> BoundaryCells:
    """The skin of that body, read in the process that meshes; of the whole this one has arrays that
    lie in a file.
    """
    from indent_sim.mesh import mesher_process

    failure_text = f"'{source.file}' could not be read"
    folder = os.path.dirname(config.source.name)
    return mesher_process.call_in_mesher(
        failure_text, mesh_import.import_boundary_cells, folder, source, config.material
    )()


def _region_materials(imported_mesh: ImportedMesh, config: Config) -> list[tuple[str, Material]]:
    """The materials of a piece's regions with the keys where they stand, in their order."""
    regions = getattr(config.body, "regions", None) or {}
    region_laws = {name: (f"body.regions.{name}", material) for name, material in regions.items()}
    laws = [
        region_laws.get(name, ("material", config.material)) for name in imported_mesh.region_names
    ]
    return [
        (key, _instantaneous_law(config, material))
        for key, material in laws
        if material is not None
    ]


def unused_material_message(config: Config, domain: ModelDomain) -> str:
    """That nothing of a body has the material of the section `material`, in words; empty where
    something has.
    """
    if config.material is None:
        return ""
    if isinstance(config.body, MeshFromFile):
        region_kind = "region"
        is_used = any(region.name == "body" for region in domain.regions)
    else:
        region_kind = "layer"
        is_used = any(config.material_key(k) == "material" for k in range(len(config.layers)))
    return "" if is_used else f"nothing uses `material`: every {region_kind} has its own"


def remove_unused_material(config: Config, domain: ModelDomain) -> Config:
    """The config without the section `material` where nothing of the body has it."""
    return (
        config.model_copy(update={"material": None})
        if unused_material_message(config, domain)
        else config
    )


def _imported_domain(
    config: Config, imported_mesh: ImportedMesh, scales: Scales
) -> tuple[ModelDomain, str]:
    assert isinstance(config.body, MeshFromFile)
    materials = [
        (key, scales.nondimensionalize(material))
        for key, material in _region_materials(imported_mesh, config)
    ]
    names = [f"regions.{name}" if name else "body" for name in imported_mesh.region_names]
    named_laws = zip(names, materials, strict=True)
    shear_fractions = [_least_shear_fraction(config, law) for _, law in materials]
    regions = tuple(
        Region(
            name,
            law,
            _formulation(key, law, shear_fraction),
            0.0,
            min_shear_fraction=shear_fraction,
        )
        for (name, (key, law)), shear_fraction in zip(named_laws, shear_fractions, strict=True)
    )
    domain = imported_domain.imported_domain(
        imported_mesh.scaled_by_length(scales.length), config.body, regions
    )
    surfaces_text = (
        ""
        if config.body.surface_names == config.body.surfaces
        else ", its surfaces without a name by where they face"
    )
    return domain, f"a mesh from a file is modelled as it is{surfaces_text}"


def _round_lengths(body: D) -> D:
    """A body, or an inclusion, with its own lengths rounded."""

    def to_digits(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(to_digits, value))
        return round_length(value) if isinstance(value, float) else value

    fields = dataclasses.fields(body)  # type: ignore[arg-type]
    return replace(body, **{f.name: to_digits(getattr(body, f.name)) for f in fields})  # type: ignore[type-var]


def _check_scene(
    body: Body,
    layers: Layers,
    tip: Indenter,
    center: Center,
    path: LoadPath,
    contacts: int,
    key: str,
) -> None:
    """ConfigError for a tip that does not stand on a body, or a path that leads it where it cannot
    go.
    """
    if body.lateral_extent(center) < 0:
        raise ConfigError(
            "indenter.center",
            f"{list(center)} lies outside the body's top surface",
            "move it inside",
        )
    delta = max(path.values)
    thickness = contacts * body.height
    _check_punch_width(body, tip, center)
    if path.control == "force":
        return
    if delta >= thickness:
        problem = f"depth {delta:g} is beyond the body's thickness {thickness:g}"
        raise ConfigError(key, problem, f"stay below {thickness:g}")
    if delta >= (coverage_depth := top_coverage_depth(body, layers, tip, center)):
        coverage_text = f"at {coverage_depth:g} the tip would cover its whole top"
        problem = f"depth {delta:g} leaves no room to an incompressible body held on all sides: {coverage_text}"
        raise ConfigError(key, problem, "stay well below, free a side, or nu < 0.5")
    if delta > (side_depth := side_contact_depth(body, tip, center)):
        side = f"the top of a fixed side, which it meets at {side_depth:g}"
        problem = (
            f"depth {delta:g} presses the tip onto {side}: nothing moves it, and the force "
            "has no bound"
        )
        raise ConfigError(
            key, problem, f"stay below {side_depth:g}, free that side, or take a wider body"
        )


def _check_punch_width(body: Body, tip: Indenter, center: Center) -> None:
    """ConfigError for a sharp punch wider than a flat top that it does not cover: its edge would
    cross that of the body.
    """
    if (
        not isinstance(tip, FlatPunch)
        or tip.edge_radius
        or isinstance(body, SphericalBody)
        or covers_top(tip, body, center)
    ):
        return
    widest = body.lateral_extent(body.center)
    if tip.radius > widest:
        problem = f"the edge of a flat punch of radius {tip.radius:g} crosses that of the body"
        covering = (
            ""
            if isinstance(body, ImportedBody)
            else f", at least {body.max_lateral_extent(center):g}, or shape: plate"
        )
        raise ConfigError("indenter.radius", problem, f"at most {widest:g}{covering}")


def _expected_radius(
    theory: Theory | None, tips: Sequence[Indenter], body: Body, center: Center, delta: float
) -> float:
    """Contact radius at the deepest point: layer theory, else the smallest of the tips' sections;
    within the body.
    """
    rim = max(body.lateral_extent(center), 0.05 * body.lateral_extent(body.center))
    if isinstance(body, ImportedBody) and rim <= RIM_TOLERANCE * body.max_lateral_extent(center):
        rim = body.max_lateral_extent(center)  # half of a symmetric body, cut where the tip stands
    if delta <= 0:
        return 0.2 * rim if isfinite(rim) else 1.0
    if isinstance(body, ImportedBody):
        return min(_overlap_radius(tips[0], body, center, delta), rim)
    solution = theory.solution_at_depth(delta) if theory else None
    return min(solution.a if solution else min(tip.radius_at(delta) for tip in tips), rim)


def _overlap_radius(tip: Indenter, body: ImportedBody, center: Center, delta: float) -> float:
    """How far from its axis [length] a tip at a depth would overlap the undeformed surface, to a
    part of a facet.
    """
    distances = body.corner_distances(center).ravel()
    gap = (_tip_heights(tip, body.top_points(), center) - body.facets[..., -1]).ravel()
    order = np.argsort(np.where(np.isfinite(gap), distances, np.inf))[: np.isfinite(gap).sum()]
    return float(
        np.interp(delta, np.maximum.accumulate([0.0, *gap[order]]), [0.0, *distances[order]])
    )


def top_coverage_depth(body: Body, layers: Sequence[Layer], tip: Indenter, center: Center) -> float:
    """The depth [length] at which the tip would cover the whole top; infinity for a body that can
    give way.

    The volume under the undeformed top stays what it is, so the surface's mean height stays 0, and
    under a tip that touches it everywhere that is the tip's mean height minus the depth. The force
    grows beyond all bounds before.
    """
    materials = [_layer_material(layer) for layer in layers]
    materials += [inclusion.material.canonical() for inclusion in body.inclusions or ()]
    if any(material.constants.nu < 0.5 for material in materials) or not body.is_laterally_confined:
        return float("inf")
    return float(np.mean(_tip_heights(tip, body.top_points(), center)))


def side_contact_depth(body: Body, tip: Indenter, center: Center) -> float:
    """The depth [length] at which the tip meets the top of a fixed side; infinity where no side is
    fixed.

    Deeper, the surface would have to jump from u_z = 0 at the side to the tip beside it: no
    displacement of finite energy does, and the force of a mesh grows as the logarithm of its
    elements there.
    """
    z = body.fixed_points[:, -1] if isinstance(body, ImportedBody) else 0.0
    return float(np.min(_tip_heights(tip, body.fixed_edge_points(), center) - z, initial=np.inf))


def _tip_heights(tip: Indenter, points: Points, center: Center) -> Any:
    """How high a tip is above its apex [length] over points, seen from above."""
    along_x, along_y = (*center, 0.0)[:2]
    return tip.height(points[0] - along_x, points[1] - along_y)
