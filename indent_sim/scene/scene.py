"""Scene: physics, sizes, solver and plan; `resolve` makes it from a Config."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from indent_sim.mesh.body_from_file import Piece
from indent_sim.mesh.grid import Grid, moved
from indent_sim.mesh.reactions import reaction_columns
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Endless
from indent_sim.model.experiment import Experiment
from indent_sim.model.loading import History
from indent_sim.model.materials import Relaxation
from indent_sim.model.tips import FlatPunch, reach
from indent_sim.process.errors import ConfigError
from indent_sim.process.screen import Shown, cell
from indent_sim.process.usage import machine_memory
from indent_sim.scene import choices, sizing
from indent_sim.scene.choices import Choice
from indent_sim.scene.cost import PER_ROW, PER_SOUGHT_ROW, THEORY_SECONDS, Cost, Work, candidates
from indent_sim.scene.cost import cost as cost_of
from indent_sim.scene.doubts import Doubt, doubts, of_fluid, of_material, of_theory, of_whole_contact
from indent_sim.scene.expected import (
    ExpectedAdhesion,
    InTime,
    Stick,
    followed,
    peakless,
    prediction_of,
    rubbed,
    rubbed_words,
    stick,
)
from indent_sim.scene.fineness import Fineness
from indent_sim.scene.given import Given, Physics, drained_face_size, given_by, in_time, on_finite_body
from indent_sim.scene.sizing import AT_END
from indent_sim.theory.surface.no_slip import Rubbed
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.schema import Config, SolverSettings, Units
    from indent_sim.theory.surface.adhesion import Jkr

WALL_STIFFNESS = 1e3  # of E/h_far: a curved roller wall gives way by less than 1e-3 of an element under the pressure E
WALL_WHY = f"u.n = 0 with the cylinder's own normal, weakly, by {WALL_STIFFNESS:g} E/h_far"
GAP_WHY = "the gap is tested at the deformed point, theory's at the undeformed one"
PLANE_GAP_WHY = "the gap is tested at the undeformed point, and the contact of theory spreads"
FRICTION_WHY = "the surface is rough, theory's frictionless"


@dataclass(frozen=True)
class Plan:
    """What is said of a simulation before it runs: names, theory, choices with their reasons, doubts, predictions."""

    title: str
    units: Units
    theory: Theory | None = field(repr=False)
    fineness: Fineness | None  # where `accuracy` chose the sizes
    choices: tuple[Choice, ...]
    doubts: tuple[Doubt, ...]
    prediction: dict[str, float]  # in the user's units
    stick: Stick | None = None  # what no slip would change; None where there is friction, or nothing is known
    friction: Rubbed | None = None  # what it changes of theory's contact, where that is known
    adhesion: ExpectedAdhesion | None = None  # of a tip that adheres
    jkr: Jkr | None = field(default=None, repr=False)  # the same tip without range, without units
    time: InTime | None = None  # of a scene that is followed in time

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the model or the mesh is a poor one for what is asked, a sentence each."""
        return tuple(doubt.words for doubt in self.doubts if doubt.words)

    def as_json(self) -> dict[str, Any]:
        """The plan as one JSON object."""
        parts = ("title", "units", "choices", "prediction", "stick", "friction", "adhesion", "warnings")
        return {name: getattr(self, name) for name in parts} | {"time": self.time.report if self.time else None}


@dataclass(frozen=True)
class Scene:
    """A completely decided simulation: what is simulated, on which elements, how it is solved, and what is said."""

    physics: Physics
    sizes: Sizes
    solver: SolverSettings
    plan: Plan
    experiment: Experiment | None = None  # what is computed from the solved curve, without units
    # What its rows follow on the elastic curve, that of the physics' path, without units; None where the path says it
    history: History | None = None
    relaxation: Relaxation | None = None

    def __repr__(self) -> str:
        return self._shown().text

    def _repr_html_(self) -> str:
        return self._shown().html

    def _shown(self) -> Shown:
        """What a notebook shows: every choice with its reason, and what to expect."""
        rows = [(choice.key, choice.value, choice.why) for choice in self.plan.choices]
        expected = ", ".join(f"{name.replace('_', ' ')} {cell(value)}" for name, value in self.plan.prediction.items())
        title = self.plan.title or f"{type(self.physics.indenter).__name__} on {type(self.physics.body).__name__}"
        return Shown(title, ("what", "choice", "why"), rows, f"expected: {expected}")

    @property
    def is_meshed(self) -> bool:
        """Whether a mesh is solved; where theory is, `sizes` are distances between points of the surface."""
        return self.solver.method != "theory"

    @property
    def is_of_curve(self) -> bool:
        """Whether something is made of its elastic curve: an experiment, the rows of a history."""
        return self.experiment is not None or self.history is not None

    @property
    def takes_time(self) -> bool:
        """Whether its rows have times."""
        return self.history is not None or bool(self.physics.path.times)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of its force table beyond those of every scene."""
        if self.history is None:
            return (*self.physics.columns, *(("t", "branch") if self.physics.path.times else ()))
        held, given = self.experiment and self.experiment.compliance, self.experiment and self.experiment.calibration
        return ("t", *(["z"] if held else []), "branch", *(["calibration_error"] if given else []))

    @property
    def reaction_columns(self) -> tuple[str, ...]:
        """Columns of its force table with the reactions of its supports, for a run that writes them."""
        return reaction_columns(self.physics.part)

    @property
    def method(self) -> str:
        """The contact method, or theory."""
        return self.physics.contact.method if self.is_meshed else "theory"

    @property
    def cost(self) -> Cost:
        """What its mesh will cost, alone."""
        work = self.physics.work(self.solver.method, self.solver.linear)
        return cost_of(self.sizes, self.physics.part, work)

    def grid(self) -> Grid:
        """The mesh of its part by its sizes; MeshError where gmsh fails."""
        from indent_sim.mesh import gmsh  # with processes, which no plan needs

        return gmsh.build(self.physics.part, self.sizes)

    def grid_like(self, other: Scene, grid: Grid) -> Grid:
        """The mesh of a scene that differs from this one a little, moved to this one's body and contact; a mesh of its
        own where it cannot be moved."""
        radii = tuple(one.plan.prediction.get("a", 0.0) / one.physics.scales.length for one in (other, self))
        return moved(grid, other.physics.part, self.physics.part, radii) or self.grid()

    def begin_grid(self) -> Callable[[], Grid]:
        """Have its mesh made in the process that meshes; the function that is returned waits for it."""
        from indent_sim.mesh import gmsh

        return gmsh.begin(self.physics.part, self.sizes)

    def with_physics(self, **changes: Any) -> Scene:
        """The same simulation of something else: another tip, path or contact law on the same elements."""
        return replace(self, physics=replace(self.physics, **changes))

    @cached_property
    def differences(self) -> tuple[str, ...]:
        """What this problem has that theory's has not, in words; empty when they are one, or there is no theory."""
        theory, physics = self.plan.theory, self.physics
        is_finite = theory is not None and theory.is_finite
        has_plate = physics.is_compressed  # a plane is the same at every point
        parts = (
            (not physics.small_strain and not is_finite, "strain is finite, theory's small"),
            (physics.has_friction, FRICTION_WHY),
            (bool(physics.permeable), "fluid flows in the pores, theory's body has none"),
            (bool(physics.relaxing), "its shear relaxes, theory's body is elastic"),
            (physics.contact.may_snap, "the attraction has a range, theory's none"),
            (physics.gap == "current" and not has_plate, GAP_WHY),
            (physics.gap == "reference" and is_finite, PLANE_GAP_WHY),
            (theory is not None and not theory.exact, theory.why if theory else ""),
        )
        return tuple(why for applies, why in parts if applies)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What else is said of its plan, a sentence each: how it is followed in time, what no slip or its friction
        changes."""
        time, slip, rough = self.plan.time, self.plan.stick, self.plan.friction
        told = (time and time.words, slip and slip.remark, rough and rubbed_words(self.physics, rough))
        return tuple(words for words in told if words)

    @property
    def exact_theory(self) -> Theory | None:
        """The theory of this very problem."""
        return self.plan.theory if not self.differences else None

    def has_peak(self, a: float) -> bool:
        """Whether the pressures of a contact of radius a [length] have a largest one that a mesh can know. Not where
        contact ends at the end of a tip, as under a punch."""
        tip = self.physics.indenter
        if self.sizes.edge is not None and not isinstance(tip, FlatPunch) and a >= AT_END * reach(tip):
            return False
        return not peakless(self.physics, self.sizes, a)


Mesher = Callable[[Scene], Grid]  # makes the mesh of a scene


def start_mesher() -> None:
    """Fork the process that meshes, which loads gmsh while this one does something else."""
    from indent_sim.mesh import gmsh

    gmsh.start()


def resolve(config: Config, per_radius: float | None = None, piece: Piece | None = None) -> Scene:
    """Decide everything the config leaves open.

    With `accuracy` there are `per_radius` elements in every contact radius, or as many as it is expected to need.
    piece: the body of the config's mesh file, where it has been read.
    Raises ConfigError for a scene that cannot exist or that this machine cannot hold.
    """
    given = given_by(config, piece)
    if by_theory := choices.theory(config, given):
        return _by_theory(config, given, by_theory)
    return _meshed(config, on_finite_body(config, given), per_radius)


def _by_theory(config: Config, given: Given, solver: Choice) -> Scene:
    """The scene that theory solves: what stands for its sizes are the points of the surface that are written."""
    physics = given.physics
    of_curve = choices.curve(config, given, solver)
    choices.refuse_reactions(config, "theory solves it, without a mesh")
    choices.refuse_nodal_stress(config, has_fields=False)
    chosen = (*choices.quantities(config), solver, *choices.by_theory(config, given), *of_curve)
    each = PER_SOUGHT_ROW if given.theory and given.theory.contact.tip.breaks else PER_ROW
    predicted = prediction_of(given) | {"seconds": float(f"{THEORY_SECONDS + each * len(physics.deltas):.3g}")}
    against = (*of_material(config, given), *of_theory(given), *of_whole_contact(given))
    known = (given.theory, None, chosen, against, predicted, stick(given, physics))
    plan = Plan(config.title, config.units, *known, time=followed(given, physics, None, _why_so(chosen)))
    settings = replace(config.solver, method="theory")
    return Scene(
        physics, sizing.surface_points(given), settings, plan, given.experiment, given.history, given.relaxation
    )


def _meshed(config: Config, given: Given, per_radius: float | None) -> Scene:
    fineness = sizing.fineness(config, given, per_radius)
    gap, gap_choice = choices.gap(config.contact, given)
    sizes = sizing.sizes(config, given, fineness, gap)
    law, law_choice = choices.contact(config.contact, given, sizes, fineness)
    law, anchor, friction_choice = choices.friction(law, given, sizes)
    adhesion, adhesion_choice = choices.adhesion(law, given, sizes)
    wall, wall_choice = _wall(given, sizes)
    tip, tip_choice = choices.tip(config, given, gap)
    physics = replace(given.physics, wall_stiffness=wall, indenter=tip, contact=law, gap=gap, anchor=anchor)
    solver, linear, cost = _solver(config, given, physics, sizes)
    if is_in_time := choices.follows_whole(config, given, solver):
        physics = in_time(given, physics, drained_face_size(physics, sizes))
        solver, linear, cost = _solver(config, given, physics, sizes)
    if cost.memory > machine_memory():
        work = physics.work(str(solver.value), str(linear.value))
        raise _unaffordable(config, physics, sizes, work, fineness)
    doubted = (*of_material(config, given), *doubts(given, law, gap, sizes), *of_fluid(given, physics, sizes))
    of_body = (*choices.quantities(config), *choices.model(given), *choices.formulations(given))
    of_contact = (gap_choice, law_choice, *friction_choice, *adhesion_choice, *tip_choice, *wall_choice)
    no_peak = peakless(physics, sizes, given.a if given.deepest > 0 else 0.0)
    of_peak = [Choice("p_max", "empty", no_peak)] if no_peak else []
    of_mesh, of_curve = choices.mesh(config, given, sizes, fineness), choices.curve(config, given, solver, is_in_time)
    choices.refuse_nodal_stress(config, has_fields=not given.history or is_in_time)
    if given.history and not is_in_time:
        choices.refuse_reactions(config, "a history is followed on the elastic curve, of forces alone")
    elif isinstance(config.body, Endless):
        choices.refuse_reactions(config, "a body without end is held at its base alone, by the force")
    of_time = (*of_curve, *choices.steps(given, physics, sizes))
    chosen = (*of_body, *of_contact, *of_peak, *of_mesh, solver, linear, *of_time)
    time = followed(given, physics, drained_face_size(physics, sizes), _why_so(of_time))
    predicted = _prediction(given, doubted, cost, time)
    said, rough = stick(given, physics, str(linear.value)), rubbed(given, physics, config.contact.friction)
    known = (given.theory, fineness, chosen, doubted, predicted, said, rough, adhesion, given.jkr, time)
    plan = Plan(config.title, config.units, *known)
    settings = replace(config.solver, method=solver.value, linear=linear.value)  # type: ignore[arg-type]
    history = None if is_in_time else given.history
    return Scene(physics, sizes, settings, plan, given.experiment, history, given.relaxation)


def _why_so(chosen: Iterable[Choice]) -> str:
    """Why a history is followed as it is; empty without one."""
    return next((choice.why for choice in chosen if choice.key == "time"), "")


def _wall(given: Given, sizes: Sizes) -> tuple[float, list[Choice]]:
    """The stiffness of a curved roller wall in three dimensions [pressure/length, without units]; 0: there is none."""
    physics = given.physics
    if not physics.part.has_curved_roller:
        return 0.0, []
    stiffness = WALL_STIFFNESS * physics.material.constants.E / sizes.h_far
    return stiffness, [Choice("wall", stiffness * physics.scales.stiffness, WALL_WHY)]


def _solver(config: Config, given: Given, physics: Physics, sizes: Sizes) -> tuple[Choice, Choice, Cost]:
    nodes = candidates(sizes, physics.part) * (physics.part.dim if physics.has_friction else 1)
    method = choices.solver(config, given, physics, nodes)
    direct = cost_of(sizes, physics.part, physics.work(str(method.value), "direct"))
    iterative = cost_of(sizes, physics.part, physics.work("newton", "iterative"))
    linear = choices.linear(config, physics, sizes, direct, iterative, machine_memory())
    if linear.value == "direct":
        return method, linear, direct
    why = method.why if method.value == "newton" else choices.FOR_WHOLE
    return Choice("solver.method", "newton", why), linear, iterative


def _unaffordable(config: Config, physics: Physics, sizes: Sizes, work: Work, fineness: Fineness | None) -> ConfigError:
    """What to say of a scene that is beyond this machine, and what would fit."""
    cost, room = cost_of(sizes, physics.part, work), machine_memory()
    key, name = ("accuracy", "accuracy") if fineness else ("mesh.h_contact", "h_contact")  # whoever set the sizes
    if cost_of(replace(sizes, inclusions=()), physics.part, work).memory <= room:
        key, name = "mesh.h_inclusions", "h_inclusions, or inclusions"
    said = f"about {cost.dofs:.2g} unknowns need {cost.memory / 1e9:.3g} GB; this machine has {room / 1e9:.3g} GB"
    iterative = cost_of(sizes, physics.part, replace(work, method="newton", linear="iterative")).memory
    if iterative <= room and not choices.against_iterative(config, physics, sizes):
        return ConfigError(key, said, f"solver.linear: iterative needs {iterative / 1e9:.3g} GB")
    return ConfigError(key, said, f"use a larger {name}, or symmetry")


def _prediction(given: Given, doubted: tuple[Doubt, ...], cost: Cost, time: InTime | None) -> dict[str, float]:
    """What to expect of the results and of the run, in the user's units."""
    truncation = {"truncation_error": given.truncation.error} if given.truncation else {}
    error = sum(doubt.force_error for doubt in doubted) if given.physics.deltas[-1] > 0 else 0.0
    size = {"cells": round(cost.cells), "dofs": round(cost.dofs), "memory_MB": round(cost.memory / 1e6)}
    effort = size | {"seconds": float(f"{cost.seconds:.2g}")}
    asked = "delta" if given.physics.path.control == "force" else "force"
    of_time = time.prediction(asked) if time and given.physics.evolves else {}
    return prediction_of(given) | of_time | truncation | ({"force_error": error} if error else {}) | effort
