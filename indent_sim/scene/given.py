"""The scene before any choice: without units, its modelled part, its theory and the depths to expect."""

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

from indent_sim.mesh import file_checks, part_from_file
from indent_sim.mesh.body_from_file import Piece, Skin
from indent_sim.mesh.modelled_part import Part, Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import (
    Ball,
    Body,
    Cap,
    Dome,
    Drainage,
    Drawn,
    Endless,
    HalfSpace,
    Layer,
    Meshed,
    MeshFromFile,
    Points,
)
from indent_sim.model.contact import ActiveSet, Adhesion, Anchor, ContactLaw
from indent_sim.model.experiment import Experiment, JKRAdhesion
from indent_sim.model.loading import PER_DOUBLING, History, Loading, LoadPath
from indent_sim.model.materials import LOCKING, Exponentials, Gel, Material, Relaxation
from indent_sim.model.state import FLUID_COLUMNS, FRICTION_COLUMNS
from indent_sim.model.tips import FlatPunch, Indenter, Plate
from indent_sim.model.units import Scales, rounded
from indent_sim.process.errors import ConfigError
from indent_sim.process.ranks import on_root
from indent_sim.scene.cost import Work
from indent_sim.scene.fineness import target_of
from indent_sim.scene.reduction import reduce
from indent_sim.scene.theories import (
    SAME_RADIUS,
    adhesive_radii,
    covers_top,
    half_space_force,
    relative_tip,
    relaxed,
    theory_of,
    undrained,
)
from indent_sim.scene.truncation import Truncation, expected_depth, truncate
from indent_sim.theory.half_space import section_depth
from indent_sim.theory.solution import Solution
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.theory.surface.adhesion import Jkr

DEEPEST = 0.9  # of the thickness: there no force is expected to find its depth
MOST_FORCES = 3  # at which theory is asked for a depth: the largest sizes the mesh, and a search needs no more
D = TypeVar("D")
Layers = tuple[Layer, ...]
Center = tuple[float, ...]  # horizontal position of the tip's axis [length]
# Of the time that fluid takes through the contact, and of that through an element: the first step of a piece. In less
# than the second an element of linear pressure does not drain as a half-space does, and the force is up to 1.4 % low
FIRST_STEP, DRAINS_ELEMENT = 1e-3, 6.0
# Least number of time steps between a change of the tip's speed and the next output row. The
# boundary layer of pore pressure beside a drained face grows with the square root of that time. In
# one step the force of a row was 6 % wrong with an error bar of 20 %, in eight steps 0.3 %, of
# confined columns: `python tests/early_times.py --kinds column --accuracy 0.01`.
STEPS_TO_ROW = 8.0
# Of the time that fluid takes through the contact, or through a thinner body: within this a sudden bath comes at finite
# strain, in RAMP_STEPS first steps, since no Newton step finds the layer that swells at once. Elements of a tenth of
# the contact radius just drain in such a step, h^2/(DRAINS_ELEMENT D)
RAMP_STEPS = 8.0
BATH_RAMP = RAMP_STEPS / DRAINS_ELEMENT / 10**2
# Of the force, with PER_DOUBLING steps of each length; of second order in them. What rubs is known to less: its error
# bar is five times what half steps change
FOLLOWED_TO, RUBS_TO = 0.004, 0.02
PER_TIME = 20.0  # first steps of a piece in the shortest time of a relaxation
# Of the shortest piece of a history: its first step at least, and of that the shortest time of a power law, which is a
# sum of exponentials down to there
SHORTEST_STEP, BEFORE_STEP = 1e-3, 1e-2
# Stretch of a skin across over that along it, from which the surface of an incompressible network has creases (Hong,
# Zhao & Suo 2009, Appl. Phys. Lett. 95, 111901); a smooth surface is without any stability from 3.4 on (Biot 1963)
CREASE = 2.4
HALVINGS = 40  # of the way of a spring's base, until the depth is known
ATTRACTION_REACH = 7.0  # ranges of gap up to which an attraction counts: beyond, a thousandth of its work is left
AT_RIM = 1e-9  # of a contact surface, from the tip's axis to its rim: less is none
FORCE_SEARCH_FACTOR = 2  # times the linear solves of a step to a known depth are needed to find the depth of a force
# gamma/(mu R) from which nothing but its tension holds a surface of radius R: with 33 a ball between plates is solved
# by the body alone, in 300 iterations, with 100 it is not
DROP = 50.0
MOST_COMPRESSED = 0.49999  # Poisson's ratio beyond which a displacement element's matrix loses its digits


@dataclass(frozen=True)
class Physics:
    """What is simulated, without units: every number is divided by the `scales`.

    It begins as the config gives it, with contact as theory has it; the choices of a mesh replace what they decide.
    """

    scales: Scales
    body: Body
    part: Part  # of the body, modelled
    indenter: Indenter
    center: Center
    path: LoadPath  # what is prescribed, step by step
    deltas: tuple[float, ...]  # prescribed, or expected at the prescribed forces
    contact: ContactLaw = field(default_factory=ActiveSet)
    gap: str = "reference"  # or current
    wall_stiffness: float = 0.0  # of the weak u . n = 0 on the curved wall of a cylinder in three dimensions; 0: none
    anchor: Anchor = "implicit"  # of what comes into contact during a step, with friction
    surface_tension: float = 0.0  # of the contact surface [pressure length]
    drainage: Drainage = field(default_factory=Drainage)  # of regions with a flow; times are the scene's own
    bath_ramp: float = 0.0  # in which a sudden bath comes [time]; 0: at once

    @cached_property
    def is_compressed(self) -> bool:
        """Whether a plate, or a punch wider than the body, presses on all of its flat top."""
        return covers_top(self.indenter, self.body, self.center)

    @cached_property
    def deepest(self) -> float:
        """The largest depth of the path [length], which every row asks for."""
        return max(self.deltas)

    @cached_property
    def end_of_sides(self) -> float:
        """The depth at which the tip meets the top of a fixed side [length], which every row is held to."""
        return end_of_sides(self.body, self.indenter, self.center)

    @property
    def has_friction(self) -> bool:
        """Whether the tip drags on the surface."""
        return not self.contact.is_conservative

    @property
    def largest_force(self) -> float | None:
        """The largest prescribed force [pressure length^2]; None where depths are prescribed."""
        return max(self.path.values) if self.path.control == "force" else None

    @property
    def sideways(self) -> dict[str, int]:
        """The horizontal axes, by name, along which friction may push the tip: it does not stand over a mirror plane
        across, which is a roller wall, there; an edge that is free or fixed is none."""
        if not self.has_friction or self.part.kinematics.name == "axisymmetric":
            return {}
        mirrors = self.part.mirrors(self.center)
        axes = {name: axis for axis, name in enumerate("xy"[: self.part.dim - 1])}
        return {name: axis for name, axis in axes.items() if not mirrors & {f"{name}_min", f"{name}_max"}}

    @property
    def seen(self) -> int:
        """How many times the body the tip sees (`Part.seen_by`)."""
        return self.part.seen_by(self.center)

    def whole_radius(self, a: float) -> float:
        """The radius [length] of the whole contact, mirrored where the tip sees it go on, of a row's radius a, which is
        that of a circle (half a width) as large as the contact on the body itself."""
        kinematics = self.part.kinematics
        return a if self.seen == 1 else kinematics.contact_radius(self.seen * kinematics.contact_area(a))

    def own_radius(self, a: float) -> float:
        """The radius [length] that a row has of a whole contact of radius a: the other way round."""
        kinematics = self.part.kinematics
        return a if self.seen == 1 else kinematics.contact_radius(kinematics.contact_area(a) / self.seen)

    @property
    def drained_walls(self) -> tuple[str, ...]:
        """The walls that let fluid out of the pores."""
        mirrors = self.part.mirrors(self.center)
        walls = [wall for wall in self.part.distances(self.center) if wall not in mirrors]
        return tuple(wall for wall in walls if self.drainage.drains_wall(self.part.supports.get(wall, "free")))

    @property
    def permeable(self) -> tuple[Region, ...]:
        """The regions in whose pores fluid flows."""
        return tuple(region for region in self.part.regions if region.material.flow)

    @property
    def is_porous_column(self) -> bool:
        """Whether fluid flows in a body whose top the tip covers, as in Terzaghi's consolidation."""
        return self.is_compressed and bool(self.permeable)

    def bath_pressure(self, region: Region, t: float) -> float:
        """p_b [pressure] of the bath that a permeable region sees, at a time since rest; 0 until then."""
        if t <= 0:
            return 0.0
        bath: float = region.material.bath_pressure(self.drainage.bath_at(t))
        return bath * min(1.0, t / self.bath_ramp) if self.bath_ramp else bath

    @property
    def swells(self) -> bool:
        """Whether a bath makes it swell or shrink."""
        return any(one.material.bath_pressure(bath) != 0 for one in self.permeable for bath in self.drainage.baths)

    @property
    def skin_stretch(self) -> float:
        """The stretch across the surface of a gel whose skin has swollen, held sideways by what is beneath it; 1
        without a gel at the surface. A free body has such a skin at first, a body between walls for good."""
        law = self.part.regions[0].material
        if not isinstance(law, Gel) or not law.flow:
            return 1.0
        return max(law.held_swelling(law.bath_pressure(bath)).stretch for bath in self.drainage.baths)

    @property
    def creases(self) -> str:
        """That the skin of a gel swells so much that its surface does not stay smooth, in words; empty where it does
        not."""
        if self.skin_stretch <= CREASE:
            return ""
        skin = f"the gel's skin swells to {self.skin_stretch:.3g} times its thickness, held sideways by what is beneath"
        return f"{skin}, and from {CREASE:g} on its surface has creases, which are not followed"

    def is_closed_by_swelling(self, depth: float, a: float) -> bool:
        """Whether a contact of radius a is wider than the tip at its depth, which pressing alone makes none."""
        return self.swells and a > relative_tip(self.indenter, self.body).radius_at(max(depth, 0.0))

    @property
    def relaxing(self) -> tuple[Region, ...]:
        """The regions whose shear stress relaxes."""
        return tuple(region for region in self.part.regions if region.material.relaxation)

    @property
    def evolves(self) -> bool:
        """Whether the body changes while the tip stands still."""
        return any(region.material.evolves for region in self.part.regions)

    @property
    def takes_path(self) -> bool:
        """Whether a row depends on the path to it, or on the time that it takes."""
        return self.contact.has_memory or self.evolves

    @property
    def takes_steps(self) -> bool:
        """Whether a row depends on the steps in which the path to it is followed."""
        return self.has_friction or self.evolves

    @property
    def seeks_pull_off(self) -> bool:
        """Whether the largest pull is searched for between rows.

        It is where a tip that attracts over a range is drawn out along prescribed depths.
        """
        if not self.contact.reach or self.path.control != "depth":
            return False
        rows = range(1, len(self.path.values) + 1)
        depths = [depth for row in rows for depth, _ in self.path.leg(row)]
        return any(after < before for before, after in pairwise(depths))

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the force table that only some scenes have, in order."""
        fluid = FLUID_COLUMNS if self.permeable else ()
        if not self.has_friction:
            return fluid
        across = [f"side_force_{axis}" for axis in self.sideways]
        return (*(name for name in FRICTION_COLUMNS if not name.startswith("side") or name in across), *fluid)

    @property
    def material(self) -> Material:
        """What the tip touches: its E* compares pressures with lengths."""
        return self.part.regions[0].material

    @property
    def small_strain(self) -> bool:
        """Whether the strain is small in all of the body."""
        return all(region.material.small_strain for region in self.part.regions)

    @property
    def most_locked(self) -> float:
        """The largest Poisson's ratio, on the way, of displacement elements without fluid, whose pressure bears what
        would lock."""
        regions = [one for one in self.part.regions if one.formulation == "displacement" and not one.material.flow]
        return max((region.softest.nu for region in regions), default=0.0)

    @property
    def largest_nu(self) -> float:
        """Poisson's ratio of what the tip touches in its most incompressible state on the way."""
        return self.part.regions[0].softest.nu

    @property
    def drop_number(self) -> float:
        """gamma/(mu R) of a round body at finite strain, by the softest of its regions; 0 without tension."""
        if self.small_strain or not self.part.dome or not self.surface_tension:
            return 0.0
        softest = min(E / (2 * (1 + nu)) for E, nu in (region.softest for region in self.part.regions))
        return self.surface_tension / (softest * self.part.dome)

    @property
    def is_drop(self) -> bool:
        """Whether next to nothing but its tension holds the surface of a round body."""
        return self.drop_number >= DROP

    @property
    def is_linear(self) -> bool:
        """Whether the strain is small and the gap tested at the undeformed point."""
        return self.small_strain and self.gap == "reference"

    def work(self, method: str, linear: str) -> Work:
        """What a solver of this kind has to do for it."""
        a_row = (1 if self.largest_force is None else FORCE_SEARCH_FACTOR) * (2 if self.anchor == "mid" else 1)
        mixed = any(region.formulation == "mixed" or region.material.flow for region in self.part.regions)
        stages = 2 if self.permeable else 1
        is_nonlinear = self.contact.has_memory or not self.is_linear
        steps = len(self.deltas) + sum(map(len, self.path.turns))
        # where nothing makes the contact grow; in three dimensions nobody has measured it
        is_held = self.part.dim == 2 and not is_nonlinear and not self.swells and self.path.control == "depth"
        still = self.path.still if self.evolves and is_held else 0
        touching = [False, *(delta > 0 for delta in self.deltas)]
        snaps = sum(one != other for one, other in pairwise(touching)) if self.contact.may_snap else 0
        is_slow = self.evolves and not self.small_strain
        moving, held = stages * a_row * (steps - still), stages * still
        return Work(method, linear, mixed, moving, is_nonlinear, self.has_friction, snaps, is_slow, held)


@dataclass(frozen=True)
class Durations:
    """How long the fluid takes [time] through the contact, an element, the body's height and half of the way to its
    wall. The first step of a piece is a thousandth of the contact's, but none in which an element cannot drain."""

    contact: float
    element: float
    height: float
    wall: float

    @staticmethod
    def of(given: Given, physics: Physics, h_contact: float) -> Durations:
        """Those of a scene's fastest region; h_contact [length]."""
        D = fastest(physics)
        lengths = (given.a, h_contact, physics.body.height, physics.body.rim_distance(physics.center) / 2)
        return Durations(*(length**2 / D for length in lengths))

    def first(self, shortest: float) -> float:
        """Of the steps of a piece, beside what takes a `shortest` one [time]."""
        return max(min(FIRST_STEP * self.contact, shortest), self.element / DRAINS_ELEMENT)


def drained_face_size(physics: Physics, sizes: Sizes) -> float:
    """Element size at the drained faces [length], from which the first time step follows.

    It is that at the contact. A confined column may drain through its base instead; its size is
    that of the boundary layer of pore pressure there if it is smaller.
    """
    if physics.is_porous_column and sizes.h_film is not None:
        return min(sizes.h_contact, sizes.h_film)
    return sizes.h_contact


def fastest(physics: Physics) -> float:
    """The largest diffusivity D [length^2/time] of the regions in which fluid flows."""
    return max(region.material.diffusivity for region in physics.permeable)


@dataclass(frozen=True)
class Given:
    """A scene as given, before any choice: its physics, and what it leads to expect."""

    physics: Physics
    truncation: Truncation | None  # of a body without end, for which this one stands
    layers: Layers  # from the top, each with its thickness and material
    relative: Indenter  # the tip over a flat body, see `relative_tip`
    part_why: str
    theory: Theory | None
    experiment: Experiment | None  # without units
    history: History | None  # without units; `physics.path` goes to the largest depth that it may come to
    relaxation: Relaxation | None
    is_stepped: bool  # whether a relaxing body is followed step by step
    per_doubling: int  # steps of each length, where fluid flows
    attraction: Adhesion | None  # of the contact
    without_tension: Theory | None  # the theory of the same body without a surface tension
    swelling: float  # how far a gel's surface rises at most, where nothing is above it [length]
    radius: Callable[[float], float] = field(repr=False)  # the contact radius [length] to expect at a depth [length]
    theory_with: Callable[[Callable[[Material], Material]], Theory | None] = field(repr=False)  # all of it changed so

    @property
    def is_half_space(self) -> bool:
        """Whether the body is a half-space, or stands for one."""
        stands_for_one = self.truncation is not None and self.truncation.stands_for == "half-space"
        return stands_for_one or isinstance(self.physics.body, HalfSpace)

    @property
    def deepest(self) -> float:
        """The largest depth [length], in what has swollen by then."""
        return max(self.physics.deltas) + self.swelling

    @property
    def a(self) -> float:
        """The contact radius [length] to expect at the deepest point, adhesion included."""
        if self.held_radii and self.deepest <= 0:  # no other tip touches there
            return max(self.held_radii)
        return max([self.radius(self.deepest), *self.held_radii])

    @property
    def elastocapillary_length(self) -> float:
        """gamma/E* [length]: a surface flatter than that is held by what is below it, a sharper one by its tension."""
        return self.physics.surface_tension / self.physics.material.E_star

    @property
    def jkr_limit(self) -> JKRAdhesion | None:
        """The adhesion of the experiment, which takes it without range."""
        return self.experiment.adhesion if self.experiment else None

    @cached_property
    def held_radii(self) -> tuple[float, float] | tuple[()]:
        """Contact radii [length] with adhesion, without range: the smallest that comes off and the deepest one's."""
        limit = self.jkr_limit
        if self.attraction and self.physics.body.dim == 3:
            found, force = self.attraction, self.physics.largest_force
            return adhesive_radii(self.theory, self.relative, self.layers, found.work, self.deepest, force)
        if limit is None or self.physics.part.kinematics.name != "axisymmetric":
            return ()
        return adhesive_radii(self.theory, self.relative, self.layers, limit.work, self.deepest, None)

    @cached_property
    def jkr(self) -> Jkr | None:
        """The contact of a tip that adheres as if its attraction had no range; None where theory does not know it."""
        return self.theory.jkr(self.attraction.work) if self.attraction and self.theory else None

    def solution(self, delta: float) -> Solution | None:
        """Theory's contact at a depth [length], where there is a theory."""
        return self.theory.at(delta) if self.theory else None


def given_by(config: Config, piece: Piece | None = None) -> Given:
    """The scene without units, its body as given; ConfigError for one that cannot exist.
    piece: what `body_from_file` finds in the config's mesh file, where somebody has read it."""
    body = config.body
    if isinstance(body, MeshFromFile):
        meshed_body, piece = _from_file(config, body, piece or _piece_of(config, body))
        return _given(config, meshed_body, meshed_body.layers, None, piece)
    layers = _layers(config)
    if isinstance(body, Cap | Ball):
        dome, (*skins, core) = body.dome, layers
        core = replace(core, thickness=dome.height - sum(layer.thickness or 0.0 for layer in skins))
        return _given(config, dome, (*skins, core), None, None)
    return _given(config, body, layers, None, None)


def on_finite_body(config: Config, given: Given) -> Given:
    """The scene on a body that can be meshed: one large enough stands for a body without end."""
    if not isinstance(config.body, Endless):
        return given
    deepest = given.deepest
    if given.held_radii:  # as deep as a tip that does not adhere has this contact
        deepest = max(deepest, 2 * float(given.physics.indenter.height(given.a, 0.0)))
    if given.attraction:  # or as far as it is felt
        deepest = max(deepest, 2 * ATTRACTION_REACH * (given.attraction.range or 0.0))
    states = _layers_in_extreme_states(config)
    depth = deepest * given.physics.scales.length
    found = truncate(config.body, config.indenter, states, depth, wider_for_tension(given))
    return _given(config, found.body, found.layers, found, None)


def _layers_in_extreme_states(config: Config) -> list[Layers]:
    """Return the layers in the elastic states between which their materials change with time.

    The drained and unrelaxed state is the first. The undrained state, and that of the shear modulus
    which has relaxed most, are less compressible: on a frictionless base a wall is felt from much
    farther away.
    """
    layers = _layers(config)
    states = [layers]
    if any(layer.material and layer.material.flow for layer in layers):
        states.append(tuple(replace(layer, material=layer.material and undrained(layer.material)) for layer in layers))
    shares = [_least_share(config, layer.material) if layer.material else 1.0 for layer in layers]
    if min(shares) < 1:
        softened = [
            replace(layer, material=layer.material and relaxed(layer.material, share))
            for layer, share in zip(layers, shares, strict=True)
        ]
        states.append(tuple(softened))
    return states


def wider_for_tension(given: Given) -> float:
    """How many times as wide a finite body must be for its surface tension: the force that it adds is felt as far away,
    and the surface beside the contact is flat over gamma/E*."""
    ell, plain = given.elastocapillary_length, given.without_tension
    if not ell or plain is None or given.deepest <= 0:
        return 1.0
    stiffer, reference = given.solution(given.deepest), plain.at(given.deepest)
    force = stiffer.force / reference.force if stiffer and reference else 1.0
    return max(force, 1.0 + ell / given.physics.body.height)


def _given(config: Config, whole: Body, layers: Layers, truncation: Truncation | None, piece: Piece | None) -> Given:
    material = _material_of(layers[0])
    center = whole.center if truncation else config.center or whole.center
    pieces = whole.pieces if isinstance(whole, Dome) else 1
    history, laws = config.loading.in_time, [law.relaxation for _, law in config.materials() if law.relaxation]
    relaxation = next((law for law in laws if law.of == "all"), None)  # of the curve
    compliance = config.experiment.compliance if config.experiment else 0.0
    softest = min((remaining(law, history) for law in laws), default=1.0)
    indenter = _without_edge_at_rim(config.indenter, whole, center)
    tip = relative_tip(indenter, whole)
    path = deepest_path(history, softest, compliance, tip, layers) if history else config.loading.path()
    _check_scene(whole, layers, indenter, center, path, pieces, "loading")
    scales = Scales(_unit_of_length(whole, layers, indenter, path), material.constants.E, whole.dim, pieces)
    body, tip, material = scales.scaled(whole), scales.scaled(indenter), scales.scaled(material)
    layers = tuple(map(scales.scaled, layers))
    center = tuple(rounded(c / scales.length) for c in center)
    history = history and history.without_units(scales.of(history.control))
    path = path.without_units(scales.of(path.control))
    part, part_why = _part(config, body, piece, center, tip, layers, scales)
    whole = scales.scaled(config.body) if isinstance(config.body, Endless) else body
    tension = scales.scaled(config.body).surface_tension
    theory, relative = theory_of(whole, layers, tip, center, tension), relative_tip(tip, body)
    deltas = depths_of(path, theory, relative, material, body.height, scales, part.seen_by(center))
    drainage = _drainage(config, history, scales)
    physics = Physics(scales, body, part, tip, center, path, deltas, surface_tension=tension, drainage=drainage)
    attraction = scales.scaled(config.contact).adhesion
    radius = cache(partial(_expected_radius, theory, (relative, tip), body, center))
    theory = theory and theory.along(deltas)

    def theory_with(change: Callable[[Material], Material]) -> Theory | None:
        changed = [replace(layer, material=change(_material_of(layer))) for layer in layers]
        return theory_of(whole, changed, tip, center, tension)

    experiment = config.experiment and config.experiment.without_units(scales)
    stepped, steps = is_stepped(history, relaxation, compliance), _steps_per_doubling(config)
    plain = theory_of(whole, layers, tip, center) if tension else theory
    found = (relative, part_why, theory, experiment, history, relaxation, stepped, steps, attraction, plain)
    return Given(physics, truncation, layers, *found, _swelling(drainage, layers), radius, theory_with)


def _without_edge_at_rim(tip: Indenter, body: Body, center: Center) -> Indenter:
    """A plate in place of a sharp punch that is exactly as wide as a flat top: such a punch is meant as a plate, and
    its edge would cut into the rim, which bulges at finite strain."""
    if not isinstance(tip, FlatPunch) or tip.edge_radius or not covers_top(tip, body, center):
        return tip
    return Plate() if tip.radius <= body.reach(center) * (1 + SAME_RADIUS) else tip


def _part(
    config: Config,
    body: Body,
    piece: Piece | None,
    center: tuple[float, ...],
    tip: Indenter,
    layers: Layers,
    scales: Scales,
) -> tuple[Part, str]:
    """The modelled piece of a body, and why it is that one."""
    if isinstance(body, Meshed):
        assert piece is not None
        return _piece_as_it_is(config, piece, scales)
    regions = (*_regions(config, layers), *_inclusions(config, body, scales))
    return reduce(_to_digits(body), center, config.mesh.symmetry, tip, regions)


def _drainage(config: Config, history: History | None, scales: Scales) -> Drainage:
    """Where fluid leaves, without units, its times from the begin of the history; ConfigError for a gel's bath with a
    unit."""
    drainage = (config.drainage or Drainage()).since(history.points[0][0] if history else 0.0)
    scaled = scales.scaled(drainage)
    if not any(isinstance(material, Gel) for _, material in config.materials()):
        return scaled
    if any(key[:2] == ("drainage", "bath") for key in config.source.quantities):
        problem = "has a unit, and of a gel it is the solvent's chemical potential over kT"
        raise ConfigError("drainage.bath", problem, "a plain number, 0 for the pure solvent")
    return replace(scaled, bath=drainage.bath)


def _steps_per_doubling(config: Config) -> int:
    """Steps in time of one length, as given or as the accuracy asks: errors fall with their square."""
    known_to = FOLLOWED_TO if config.contact.is_conservative else RUBS_TO
    finer = ceil(sqrt(known_to / (target_of(config.accuracy) or known_to)))
    return config.loading.per_doubling or PER_DOUBLING * max(1, finer)


def _swelling(drainage: Drainage, layers: Layers) -> float:
    """How far the surface of gels rises above that at rest, held sideways, in the bath in which they swell most
    [length]; ConfigError for a bath in which they are not at rest, or rise without end."""

    def rise(bath: float) -> float:
        found = 0.0
        for layer in layers:
            law = _material_of(layer)
            if isinstance(law, Gel) and law.flow and (stretch := _held_stretch(law, bath)) != 1:
                found += (stretch - 1) * layer.thickness if layer.thickness else inf
        return found

    found = max(0.0, *(rise(bath) for bath in drainage.baths))
    if not isfinite(found):
        problem = "lets a gel without end swell, whose surface rises without end"
        raise ConfigError("drainage.bath", problem, "use a layer or a cylinder, or stretch: auto and one bath")
    return found


def _held_stretch(law: Gel, bath: float) -> float:
    try:
        return law.held_swelling(law.bath_pressure(bath)).stretch
    except ValueError as error:
        raise ConfigError("drainage.bath", str(error), "nearer to that of free swelling") from None


def depths_of(
    path: LoadPath,
    theory: Theory | None,
    tip: Indenter,
    material: Material,
    height: float,
    scales: Scales,
    seen: int = 1,
) -> tuple[float, ...]:
    """The requested depths, or those to expect at the requested forces, within DEEPEST of the body's height.

    Of forces by theory, or by the tip's section where there is none or it ends; between MOST_FORCES by power laws.
    seen: how many times the body the tip sees, each with the prescribed force.
    ConfigError when theory says that a linear body does not bear the largest force.
    """
    if path.control == "depth":
        return path.values
    deepest = DEEPEST * height
    forces = [seen * force for force in path.values]
    pushed = np.unique([force for force in forces if force > 0])
    some = pushed if len(pushed) <= MOST_FORCES else np.geomspace(pushed[0], pushed[-1], MOST_FORCES)
    known, E_star = [], material.E_star
    for force in map(float, some):
        start = section_depth(tip.radius_at, force, E_star) if scales.dim == 3 else force / E_star
        depth = (theory and theory.depth(force, deepest)) or min(start, deepest / 2)
        known.append(float(f"{depth:.9g}"))  # the same in all units, and so is the mesh
    between = partial(np.interp, xp=np.log(some), fp=np.log(known))
    depths = tuple(float(np.exp(between(np.log(force)))) if force > 0 else 0.0 for force in forces)
    if material.small_strain and theory and max(depths) > (1 - 1e-6) * deepest:
        largest = max(path.values) * scales.force
        problem = f"a force of {largest:g} would press the tip to {DEEPEST:.0%} of the body's thickness or deeper"
        raise ConfigError("loading", problem, "use a smaller force")
    return depths


def in_time(given: Given, physics: Physics, h_contact: float) -> Physics:
    """Physics whose path is the rows of the history, in place of the way to its deepest one; h_contact [length]."""
    assert given.history is not None
    path = given.history.path
    if physics.evolves:
        physics = replace(physics, part=_relaxing(physics, given.history))
        physics = replace(physics, bath_ramp=bath_ramp(given, physics))
        path = given.history.in_steps(first_step(given, physics, h_contact), given.per_doubling)
        if is_locked(physics) and not _lets_fluid_out(physics):
            problem = "no fluid leaves the pores, and the tip covers the top of a body that is held on all other sides"
            remedy = "drain the tip, the base or the sides, free the sides, or give the material some flow.storage"
            raise ConfigError("drainage", f"{problem}: it cannot be compressed", remedy)
        if path.jumps and is_locked(physics):
            path = _without_sudden(path, "loading.force_history" if path.control == "force" else "loading.history")
    tip, height = given.relative, physics.body.height
    return replace(
        physics,
        path=path,
        deltas=depths_of(path, given.theory, tip, physics.material, height, physics.scales, physics.seen),
    )


def bath_ramp(given: Given, physics: Physics) -> float:
    """Return the time [time] over which the chemical potential of a gel's bath ramps up linearly.

    It is 0 for a body that no bath swells or shrinks, and for a sudden bath. The key
    `drainage.bath_ramp` gives it; for `auto` at finite strain it is BATH_RAMP L^2/D, where D is the
    largest diffusivity and L the smaller of the expected contact radius and the body's height. The
    ramp does not depend on the mesh.
    """
    if not physics.swells:
        return 0.0
    if physics.drainage.bath_ramp != "auto":
        return physics.drainage.bath_ramp
    if physics.small_strain:
        return 0.0
    return BATH_RAMP * min(given.a, physics.body.height) ** 2 / fastest(physics)


def is_locked(physics: Physics) -> bool:
    """Whether a tip as wide as a body between its walls finds no way to press it while no fluid leaves."""
    is_closed = all(
        physics.part.supports.get(wall, "free") != "free" for wall in physics.part.distances(physics.center)
    )
    is_full = all(one.material.flow and not one.material.flow.storage for one in physics.part.regions)
    return bool(physics.is_compressed and is_closed and is_full)


def _lets_fluid_out(physics: Physics) -> bool:
    """Whether fluid leaves a body whose top the tip covers."""
    drainage = physics.drainage
    return drainage.tip != "sealed" or drainage.base != "sealed" or bool(physics.drained_walls)


def _without_sudden(path: LoadPath, key: str) -> LoadPath:
    """The path without the places that it reaches in no time; ConfigError where such a place is a row that `times` asks
    for, or where there is no other row."""
    asked = path.sudden if path.turns else ()
    if asked or len(path.sudden) == len(path.values):
        at = f" at t = {path.times[asked[0] - 1]:g}" if asked else ""
        problem = f"jumps{at} on a column that cannot give way before its fluid does: there is no equilibrium then"
        raise ConfigError(key, problem, "ask for a later time, or let it grow")
    return path.without_sudden()


def first_step(given: Given, physics: Physics, h_contact: float) -> float:
    """The first step of a piece of the history [time]: what flows, what relaxes and a bath that comes are followed by
    it; h_contact [length]."""
    assert given.history is not None
    times = [t for region in physics.part.regions if region.relaxing for t in region.relaxing.times]
    shortest = max(min(times, default=inf) / PER_TIME, SHORTEST_STEP * given.history.shortest_piece)
    if not physics.permeable:
        return shortest
    shortest = min(shortest, given.history.shortest_time_to_row / STEPS_TO_ROW)
    first = Durations.of(given, physics, h_contact).first(shortest)
    return min(first, physics.bath_ramp / RAMP_STEPS) if physics.bath_ramp else first


def _relaxing(physics: Physics, history: History) -> Part:
    """The modelled part, its laws of relaxation as sums of exponentials."""

    def followed(region: Region) -> Region:
        law = region.material.relaxation
        shortest = BEFORE_STEP * SHORTEST_STEP * history.shortest_piece
        return replace(region, relaxing=exponentials(law, shortest, history.span)) if law else region

    return replace(physics.part, regions=tuple(map(followed, physics.part.regions)))


def deepest_path(
    history: History, softest: float, compliance: float, tip: Indenter, layers: Sequence[Layer]
) -> LoadPath:
    """Equal steps to the largest depth, or force, that a history may come to.

    What relaxes lets the tip in as far as a body of the least share `softest` of its modulus, and a spring keeps the
    tip back by the least force that a half-space of the softest layer has.
    """
    largest = history.largest
    if history.control == "force":
        return Loading(force=largest / softest).path()
    if not compliance:
        return Loading(delta=largest).path()
    E_star = softest * min(_material_of(layer).E_star for layer in layers)

    def beyond(depth: float) -> bool:
        closed = half_space_force(tip, depth, E_star)
        radius = tip.radius_at(depth)
        if not closed and not isfinite(radius):  # a plate: the least force of a body is not known
            return depth >= largest
        force = closed[1] if closed else 0.5 * E_star * radius * depth
        return depth + compliance * force >= largest

    low, high = 0.0, largest
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return Loading(delta=high).path()


def is_stepped(history: History | None, law: Relaxation | None, compliance: float) -> bool:
    """Whether a relaxing body is followed step by step: forces or springs, or a tip that comes back."""
    is_any = history is not None and (history.control == "force" or compliance > 0 or history.comes_back)
    return law is not None and is_any


def exponentials(law: Relaxation, shortest: float, longest: float) -> Exponentials:
    """A relaxation as a sum of exponentials; a power law to 1e-5 between two times [time]."""
    if law.power_law is None:
        fractions, times = zip(*(law.prony or ()), strict=True)
        return Exponentials(1.0 - sum(fractions), fractions, times)
    from indent_sim.theory.surface.relaxation import PowerLaw  # with scipy's splines, which no other scene needs

    found = PowerLaw(law.power_law.exponent, law.power_law.time).prony(shortest, longest)
    return Exponentials(found.lasting, found.fractions, found.times)


def remaining(law: Relaxation | None, history: History | None) -> float:
    """The least share of the instantaneous modulus that a body has during a history; of a power law it may be above
    1."""
    if law is None:
        return 1.0
    if law.power_law is None:
        return 1.0 - sum(fraction for fraction, _ in law.prony or ())
    return float((history.span / law.power_law.time) ** -law.power_law.exponent) if history else 1.0


def _unit_of_length(body: Body, layers: Sequence[Layer], tip: Indenter, path: LoadPath) -> float:
    """The body's height; of a half-space about the contact radius, a power of two, which costs no digit."""
    if isfinite(body.height):
        return body.height
    deepest = max(path.values)
    depth = expected_depth(tip, layers, deepest) if path.control == "force" else abs(deepest)
    return float(2.0 ** round(log2(tip.radius_at(depth or 1.0))))


def _layers(config: Config) -> Layers:
    """The layers from the top, each with its thickness (a half-space's last: infinite) and its material's constants."""
    own = [_elastic(config, _material_of(layer)) for layer in config.layers]
    layers = zip(config.layers, own, strict=True)
    return tuple(replace(layer, thickness=layer.thickness or inf, material=material) for layer, material in layers)


def _elastic(config: Config, material: Material) -> Material:
    """The law of the instantaneous constants: what relaxes as a whole is made of its elastic curve. A gel has swollen
    in the scene's first bath where it does not say by how much."""
    if isinstance(material, Gel):
        return material.swollen_in(config.first_bath).canonical()
    return replace(material.canonical(), relaxation=material.relaxation if material.relaxes_in_shear else None)


def _material_of(layer: Layer) -> Material:
    assert layer.material is not None
    return layer.material


def _regions(config: Config, layers: Layers) -> tuple[Region, ...]:
    """The regions of layers, z of their lower faces rounded as all lengths of a mesh."""
    regions, depths = [], np.cumsum([layer.thickness for layer in layers])
    for k, (layer, depth) in enumerate(zip(layers, depths, strict=True)):
        name, material = f"layers[{k}]" if len(layers) > 1 else "body", _material_of(layer)
        share = _least_share(config, material)
        formulation = _formulation(config.material_key(k), material, share)
        regions.append(Region(name, material, formulation, -rounded(float(depth)), least_share=share))
    return tuple(regions)


def _inclusions(config: Config, body: Drawn | Endless, scales: Scales) -> Iterator[Region]:
    """The regions of inclusions, lengths rounded likewise."""
    own = [_elastic(config, inclusion.material) for inclusion in config.body.inclusions or ()]
    for k, (inclusion, material) in enumerate(zip(body.inclusions or (), own, strict=True)):
        matter, name, share = scales.scaled(material), f"inclusions[{k}]", _least_share(config, material)
        formulation = _formulation(f"body.{name}.material", matter, share)
        yield Region(name, matter, formulation, inclusion=_to_digits(inclusion), least_share=share)


def _least_share(config: Config, material: Material) -> float:
    """What is left of a material's shear modulus when it has relaxed most on the way of a scene, at most 1."""
    if not material.relaxes_in_shear:
        return 1.0
    return min(1.0, remaining(material.relaxation, config.loading.in_time))


def _formulation(key: str, material: Material, least_share: float) -> str:
    """Displacements alone, or with a pressure, for the most incompressible state of a material on its way.

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
    nu, wanted = material.softened(least_share).nu, material.formulation
    chosen = wanted if wanted != "auto" else "mixed" if nu >= LOCKING else "displacement"
    said = f"nu = {nu:g}" if material.is_isotropic else f"matter as compressible as nu = {nu:.6g}"
    if least_share < 1:
        said = f"shear that relaxes to {said}"
    if chosen == "displacement" and nu > MOST_COMPRESSED:
        raise ConfigError(f"{key}.formulation", f"displacement elements cannot carry {said}", "use 'mixed'")
    if chosen == "mixed" and nu <= 0:
        raise ConfigError(f"{key}.formulation", f"'mixed' needs nu > 0, and this is {said}", "use 'displacement'")
    return chosen


def _from_file(config: Config, source: MeshFromFile, piece: Piece) -> tuple[Meshed, Piece]:
    """The body that a file has, lowered so that the tip first touches it at z = 0."""
    center = config.center or source.center
    if source.hash not in (None, piece.hash):
        remedy = "find the mesh that this scene was made with, or leave the hash out"
        raise ConfigError("body.hash", f"'{source.file}' holds another mesh, {piece.hash}", remedy)
    piece = piece.led_by(part_from_file.under_axis(piece, center))
    part_from_file.refuse_forgotten_mirrors(piece, source, center)
    placed = piece.lowered(part_from_file.first_touch(config.indenter, piece, center))
    return part_from_file.body_of(placed, source, center, _materials(placed, config)[0][1]), placed


def body_from_file(config: Config, comm: Any) -> Piece | None:
    """The body of the config's mesh file, None where it names none (collective).

    On several ranks rank 0 reads the file, has its arrays mapped, and all know the skin of the body.
    """
    if not isinstance(config.body, MeshFromFile):
        return None
    if comm.size == 1:
        return _piece_of(config, config.body)
    skin = on_root(comm, _mapped_skin, config, config.body)
    known = comm.bcast(replace(skin, whole=None) if skin else None, root=0)
    return skin or known


def _piece_of(config: Config, source: MeshFromFile) -> Piece:
    """The body as its file, beside the scene's, has it."""
    return file_checks.piece_in(os.path.dirname(config.source.name), source, config.material)


def _mapped_skin(config: Config, source: MeshFromFile) -> Skin:
    """The skin of that body, read in the process that meshes; of the whole this one has arrays that lie in a file."""
    from indent_sim.mesh import gmsh

    what = f"'{source.file}' could not be read"
    folder = os.path.dirname(config.source.name)
    return gmsh.elsewhere(what, file_checks.skin_in, folder, source, config.material)()


def _materials(piece: Piece, config: Config) -> list[tuple[str, Material]]:
    """The materials of a piece's regions with the keys where they stand, in their order."""
    regions = getattr(config.body, "regions", None) or {}
    own = {name: (f"body.regions.{name}", material) for name, material in regions.items()}
    found = [own.get(name, ("material", config.material)) for name in piece.names]
    return [(key, _elastic(config, material)) for key, material in found if material is not None]


def unused_material(config: Config, part: Part) -> str:
    """That nothing of a body has the material of the section `material`, in words; empty where something has."""
    if config.material is None:
        return ""
    if isinstance(config.body, MeshFromFile):
        parts, is_used = "region", any(region.name == "body" for region in part.regions)
    else:
        parts, is_used = "layer", any(config.material_key(k) == "material" for k in range(len(config.layers)))
    return "" if is_used else f"nothing uses `material`: every {parts} has its own"


def with_used_material(config: Config, part: Part) -> Config:
    """The config without the section `material` where nothing of the body has it."""
    return config.model_copy(update={"material": None}) if unused_material(config, part) else config


def _piece_as_it_is(config: Config, piece: Piece, scales: Scales) -> tuple[Part, str]:
    assert isinstance(config.body, MeshFromFile)
    materials = [(key, scales.scaled(material)) for key, material in _materials(piece, config)]
    names = [f"regions.{name}" if name else "body" for name in piece.names]
    named = zip(names, materials, strict=True)
    shares = [_least_share(config, matter) for _, matter in materials]
    regions = tuple(
        Region(name, matter, _formulation(key, matter, share), 0.0, least_share=share)
        for (name, (key, matter)), share in zip(named, shares, strict=True)
    )
    part = part_from_file.part_of(piece.measured(scales.length), config.body, regions)
    known = "" if config.body.named == config.body.surfaces else ", its surfaces without a name by where they face"
    return part, f"a mesh from a file is modelled as it is{known}"


def _to_digits(body: D) -> D:
    """A body, or an inclusion, with its own lengths rounded."""

    def to_digits(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(to_digits, value))
        return rounded(value) if isinstance(value, float) else value

    fields = dataclasses.fields(body)  # type: ignore[arg-type]
    return replace(body, **{f.name: to_digits(getattr(body, f.name)) for f in fields})  # type: ignore[type-var]


def _check_scene(
    body: Body, layers: Layers, tip: Indenter, center: Center, path: LoadPath, pieces: int, key: str
) -> None:
    """ConfigError for a tip that does not stand on a body, or a path that leads it where it cannot go."""
    if body.rim_distance(center) < 0:
        raise ConfigError("indenter.center", f"{list(center)} lies outside the body's top surface", "move it inside")
    delta, thickness = max(path.values), pieces * body.height
    _check_width(body, tip, center)
    if path.control == "force":
        return
    if delta >= thickness:
        problem = f"depth {delta:g} is beyond the body's thickness {thickness:g}"
        raise ConfigError(key, problem, f"stay below {thickness:g}")
    if delta >= (room := deepest(body, layers, tip, center)):
        covered = f"at {room:g} the tip would cover its whole top"
        problem = f"depth {delta:g} leaves no room to an incompressible body held on all sides: {covered}"
        raise ConfigError(key, problem, "stay well below, free a side, or nu < 0.5")
    if delta > (end := end_of_sides(body, tip, center)):
        side = f"the top of a fixed side, which it meets at {end:g}"
        problem = f"depth {delta:g} presses the tip onto {side}: nothing moves it, and the force has no bound"
        raise ConfigError(key, problem, f"stay below {end:g}, free that side, or take a wider body")


def _check_width(body: Body, tip: Indenter, center: Center) -> None:
    """ConfigError for a sharp punch wider than a flat top that it does not cover: its edge would cross that of the
    body."""
    if not isinstance(tip, FlatPunch) or tip.edge_radius or isinstance(body, Dome) or covers_top(tip, body, center):
        return
    widest = body.rim_distance(body.center)
    if tip.radius > widest:
        problem = f"the edge of a flat punch of radius {tip.radius:g} crosses that of the body"
        covering = "" if isinstance(body, Meshed) else f", at least {body.reach(center):g}, or shape: plate"
        raise ConfigError("indenter.radius", problem, f"at most {widest:g}{covering}")


def _expected_radius(
    theory: Theory | None, tips: Sequence[Indenter], body: Body, center: Center, delta: float
) -> float:
    """Contact radius at the deepest point: layer theory, else the smallest of the tips' sections; within the body."""
    rim = max(body.rim_distance(center), 0.05 * body.rim_distance(body.center))
    if isinstance(body, Meshed) and rim <= AT_RIM * body.reach(center):
        rim = body.reach(center)  # half of a symmetric body, cut where the tip stands
    if delta <= 0:
        return 0.2 * rim if isfinite(rim) else 1.0
    if isinstance(body, Meshed):
        return min(_overlap(tips[0], body, center, delta), rim)
    solution = theory.at(delta) if theory else None
    return min(solution.a if solution else min(tip.radius_at(delta) for tip in tips), rim)


def _overlap(tip: Indenter, body: Meshed, center: Center, delta: float) -> float:
    """How far from its axis [length] a tip at a depth would overlap the undeformed surface, to a part of a facet."""
    r, gap = body.distances(center).ravel(), (_heights(tip, body.top(), center) - body.facets[..., -1]).ravel()
    order = np.argsort(np.where(np.isfinite(gap), r, np.inf))[: np.isfinite(gap).sum()]
    return float(np.interp(delta, np.maximum.accumulate([0.0, *gap[order]]), [0.0, *r[order]]))


def deepest(body: Body, layers: Sequence[Layer], tip: Indenter, center: Center) -> float:
    """The depth [length] at which the tip would cover the whole top; infinity for a body that can give way.

    The volume under the undeformed top stays what it is, so the surface's mean height stays 0, and under a tip that
    touches it everywhere that is the tip's mean height minus the depth. The force grows beyond all bounds before.
    """
    matter = [_material_of(layer) for layer in layers]
    matter += [inclusion.material.canonical() for inclusion in body.inclusions or ()]
    if any(material.constants.nu < 0.5 for material in matter) or not body.is_held:
        return float("inf")
    return float(np.mean(_heights(tip, body.top(), center)))


def end_of_sides(body: Body, tip: Indenter, center: Center) -> float:
    """The depth [length] at which the tip meets the top of a fixed side; infinity where no side is fixed.

    Deeper, the surface would have to jump from u_z = 0 at the side to the tip beside it: no displacement of finite
    energy does, and the force of a mesh grows as the logarithm of its elements there.
    """
    z = body.clamped[:, -1] if isinstance(body, Meshed) else 0.0
    return float(np.min(_heights(tip, body.fixed_ends(), center) - z, initial=np.inf))


def _heights(tip: Indenter, points: Points, center: Center) -> Any:
    """How high a tip is above its apex [length] over points, seen from above."""
    along_x, along_y = (*center, 0.0)[:2]
    return tip.height(points[0] - along_x, points[1] - along_y)
