"""Scene: physics, sizes, solver and plan; `resolve` makes it from a Config."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from indent_sim.mesh.grid import Grid, map_grid
from indent_sim.mesh.imported_mesh import ImportedMesh
from indent_sim.mesh.reactions import reaction_columns
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import UnboundedBody
from indent_sim.model.experiment import Experiment
from indent_sim.model.loading import History
from indent_sim.model.materials import Relaxation
from indent_sim.model.tips import FlatPunch, max_radius
from indent_sim.process.errors import ConfigError
from indent_sim.process.repr_tables import ReprTable, cell_text
from indent_sim.process.usage import machine_memory
from indent_sim.scene import choices, sizing
from indent_sim.scene.choices import Choice
from indent_sim.scene.cost import (
    SECONDS_PER_ROW,
    SECONDS_PER_SEARCHED_ROW,
    THEORY_SECONDS,
    Cost,
    SolverWork,
    candidate_count,
)
from indent_sim.scene.cost import predict_cost as cost_of
from indent_sim.scene.model_warnings import (
    ModelWarning,
    fluid_warnings,
    material_warnings,
    pull_warnings,
    scene_warnings,
    theory_warnings,
)
from indent_sim.scene.predictions import (
    ExpectedAdhesion,
    NoSlipEffect,
    TimePrediction,
    friction_correction,
    friction_sentence,
    missing_peak_reason,
    no_slip_effect,
    prediction_of,
    time_prediction,
)
from indent_sim.scene.problem_setup import (
    ProblemDefinition,
    ProblemSetup,
    problem_along_history,
    set_up_problem,
    truncate_body,
)
from indent_sim.scene.resolution import MeshResolution
from indent_sim.scene.sizing import END_FRACTION
from indent_sim.theory.no_slip import FrictionCorrection
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.schema import Config, SolverSettings, Units
    from indent_sim.theory.adhesion import Jkr

# of E/h_far: a curved roller wall gives way by less than 1e-3 of an element under the pressure E
WALL_STIFFNESS = 1e3
WALL_WHY = f"u.n = 0 with the cylinder's own normal, weakly, by {WALL_STIFFNESS:g} E/h_far"
GAP_WHY = "the gap is tested at the deformed point, theory's at the undeformed one"
PLANE_GAP_WHY = "the gap is tested at the undeformed point, and the contact of theory spreads"
FRICTION_WHY = "the surface is rough, theory's frictionless"


@dataclass(frozen=True)
class Plan:
    """What is said of a simulation before it runs: names, theory, choices with their reasons,
    doubts, predictions.
    """

    title: str
    units: Units
    theory: Theory | None = field(repr=False)
    resolution: MeshResolution | None  # where `accuracy` chose the sizes
    choices: tuple[Choice, ...]
    model_warnings: tuple[ModelWarning, ...]
    prediction: dict[str, float]  # in the user's units
    stick: NoSlipEffect | None = (
        None  # what no slip would change; None where there is friction, or nothing is known
    )
    friction: FrictionCorrection | None = (
        None  # what it changes of theory's contact, where that is known
    )
    adhesion: ExpectedAdhesion | None = None  # of a tip that adheres
    jkr: Jkr | None = field(default=None, repr=False)  # the same tip without range, without units
    time: TimePrediction | None = None  # of a scene that is followed in time

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the model or the mesh is a poor one for what is asked, a sentence each."""
        return tuple(doubt.message for doubt in self.model_warnings if doubt.message)

    def as_json(self) -> dict[str, Any]:
        """The plan as one JSON object."""
        parts = (
            "title",
            "units",
            "choices",
            "prediction",
            "stick",
            "friction",
            "adhesion",
            "warnings",
        )
        return {name: getattr(self, name) for name in parts} | {
            "time": self.time.report if self.time else None
        }


@dataclass(frozen=True)
class Scene:
    """A completely decided simulation: what is simulated, on which elements, how it is solved, and
    what is said.
    """

    physics: ProblemDefinition
    sizes: Sizes
    solver: SolverSettings
    plan: Plan
    experiment: Experiment | None = None  # what is computed from the solved curve, without units
    # What its rows follow on the elastic curve, that of the physics' path, without units; None
    # where the path says it
    history_on_curve: History | None = None
    relaxation: Relaxation | None = None

    def __repr__(self) -> str:
        return self._repr_table().text

    def _repr_html_(self) -> str:
        return self._repr_table().html

    def _repr_table(self) -> ReprTable:
        """What a notebook shows: every choice with its reason, and what to expect."""
        rows = [(choice.key, choice.value, choice.why) for choice in self.plan.choices]
        expected = ", ".join(
            f"{name.replace('_', ' ')} {cell_text(value)}"
            for name, value in self.plan.prediction.items()
        )
        title = (
            self.plan.title
            or f"{type(self.physics.indenter).__name__} on {type(self.physics.body).__name__}"
        )
        return ReprTable(title, ("what", "choice", "why"), rows, f"expected: {expected}")

    @property
    def is_meshed(self) -> bool:
        """Whether a mesh is solved; where theory is, `sizes` are distances between points of the
        surface.
        """
        return self.solver.method != "theory"

    @property
    def uses_elastic_curve(self) -> bool:
        """Whether something is made of its elastic curve: an experiment, the rows of a history."""
        return self.experiment is not None or self.history_on_curve is not None

    @property
    def is_time_dependent(self) -> bool:
        """Whether its rows have times."""
        return self.history_on_curve is not None or bool(self.physics.path.times)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of its force table beyond those of every scene."""
        if self.history_on_curve is None:
            return (*self.physics.columns, *(("t", "branch") if self.physics.path.times else ()))
        has_compliance = self.experiment and self.experiment.compliance
        has_calibration = self.experiment and self.experiment.calibration
        return (
            "t",
            *(["z"] if has_compliance else []),
            "branch",
            *(["calibration_error"] if has_calibration else []),
        )

    @property
    def reaction_columns(self) -> tuple[str, ...]:
        """Columns of its force table with the reactions of its supports, for a run that writes
        them.
        """
        return reaction_columns(self.physics.domain)

    @property
    def method(self) -> str:
        """The contact method, or theory."""
        return self.physics.contact.method if self.is_meshed else "theory"

    @property
    def cost(self) -> Cost:
        """What its mesh will cost, alone."""
        work = self.physics.solver_work(self.solver.method, self.solver.linear)
        return cost_of(self.sizes, self.physics.domain, work)

    def grid(self) -> Grid:
        """The mesh of its part by its sizes; MeshError where gmsh fails."""
        from indent_sim.mesh import gmsh  # with processes, which no plan needs

        return gmsh.build_mesh(self.physics.domain, self.sizes)

    def adapt_grid(self, other: Scene, grid: Grid) -> Grid:
        """The mesh of a scene that differs from this one a little, moved to this one's body and
        contact; a mesh of its own where it cannot be moved.
        """
        radii = tuple(
            scene.plan.prediction.get("a", 0.0) / scene.physics.scales.length
            for scene in (other, self)
        )
        return map_grid(grid, other.physics.domain, self.physics.domain, radii) or self.grid()

    def start_meshing(self) -> Callable[[], Grid]:
        """Have its mesh made in the process that meshes; the function that is returned waits for
        it.
        """
        from indent_sim.mesh import gmsh

        return gmsh.start_meshing(self.physics.domain, self.sizes)

    def replace_physics(self, **changes: Any) -> Scene:
        """The same simulation of something else: another tip, path or contact law on the same
        elements.
        """
        return replace(self, physics=replace(self.physics, **changes))

    @cached_property
    def theory_differences(self) -> tuple[str, ...]:
        """What this problem has that theory's has not, in words; empty when they are one, or there
        is no theory.
        """
        theory = self.plan.theory
        physics = self.physics
        is_finite = theory is not None and theory.is_finite_strain
        has_plate = physics.is_compressed  # a plane is the same at every point
        reasons = (
            (not physics.small_strain and not is_finite, "strain is finite, theory's small"),
            (physics.has_friction, FRICTION_WHY),
            (bool(physics.permeable_regions), "fluid flows in the pores, theory's body has none"),
            (bool(physics.relaxing_regions), "its shear relaxes, theory's body is elastic"),
            (physics.contact.may_snap_through, "the attraction has a range, theory's none"),
            (physics.gap == "current" and not has_plate, GAP_WHY),
            (physics.gap == "reference" and is_finite, PLANE_GAP_WHY),
            (theory is not None and not theory.is_exact, theory.reason if theory else ""),
        )
        return tuple(why for applies, why in reasons if applies)

    @property
    def notes(self) -> tuple[str, ...]:
        """What else is said of its plan, a sentence each: how it is followed in time, what no slip
        or its friction changes.
        """
        time = self.plan.time
        no_slip = self.plan.stick
        friction = self.plan.friction
        sentences = (
            time and time.words,
            no_slip and no_slip.remark,
            friction and friction_sentence(self.physics, friction),
        )
        return tuple(sentence for sentence in sentences if sentence)

    @property
    def exact_theory(self) -> Theory | None:
        """The theory of this very problem."""
        return self.plan.theory if not self.theory_differences else None

    def has_peak_pressure(self, a: float) -> bool:
        """Whether the pressures of a contact of radius a [length] have a largest one that a mesh
        can know. Not where contact ends at the end of a tip, as under a punch.
        """
        tip = self.physics.indenter
        if (
            self.sizes.punch_edge is not None
            and not isinstance(tip, FlatPunch)
            and a >= END_FRACTION * max_radius(tip)
        ):
            return False
        return not missing_peak_reason(self.physics, self.sizes, a)


Mesher = Callable[[Scene], Grid]  # makes the mesh of a scene


def start_mesher() -> None:
    """Fork the process that meshes, which loads gmsh while this one does something else."""
    from indent_sim.mesh import mesher_process

    mesher_process.start_mesher()


def resolve(
    config: Config, per_radius: float | None = None, piece: ImportedMesh | None = None
) -> Scene:
    """Decide everything the config leaves open.

    With `accuracy` there are `per_radius` elements in every contact radius, or as many as it is
    expected to need. piece: the body of the config's mesh file, where it has been read. Raises
    ConfigError for a scene that cannot exist or that this machine cannot hold.
    """
    setup = set_up_problem(config, piece)
    if by_theory := choices.theory(config, setup):
        return _theory_scene(config, setup, by_theory)
    return _meshed_scene(config, truncate_body(config, setup), per_radius)


def _theory_scene(config: Config, setup: ProblemSetup, solver: Choice) -> Scene:
    """The scene that theory solves: what stands for its sizes are the points of the surface that
    are written.
    """
    physics = setup.physics
    curve_choices = choices.curve(config, setup, solver)
    choices.refuse_reactions(config, "theory solves it, without a mesh")
    choices.refuse_nodal_stress(config, has_fields=False)
    all_choices = (
        *choices.quantities(config),
        solver,
        *choices.theory_choices(config, setup),
        *curve_choices,
    )
    seconds_per_row = (
        SECONDS_PER_SEARCHED_ROW
        if setup.theory and setup.theory.contact.tip.slope_discontinuities
        else SECONDS_PER_ROW
    )
    prediction = prediction_of(setup) | {
        "seconds": float(f"{THEORY_SECONDS + seconds_per_row * len(physics.deltas):.3g}")
    }
    warnings = (*material_warnings(config, setup), *theory_warnings(setup), *pull_warnings(setup))
    plan_parts = (
        setup.theory,
        None,
        all_choices,
        warnings,
        prediction,
        no_slip_effect(setup, physics),
    )
    plan = Plan(
        config.title,
        config.units,
        *plan_parts,
        time=time_prediction(setup, physics, None, _history_reason(all_choices)),
    )
    settings = replace(config.solver, method="theory")
    return Scene(
        physics,
        sizing.surface_point_sizes(setup),
        settings,
        plan,
        setup.experiment,
        setup.history,
        setup.relaxation,
    )


def _meshed_scene(config: Config, setup: ProblemSetup, per_radius: float | None) -> Scene:
    fineness = sizing.mesh_resolution(config, setup, per_radius)
    gap, gap_choice = choices.gap(config.contact, setup)
    sizes = sizing.sizes(config, setup, fineness, gap)
    law, law_choice = choices.contact(config.contact, setup, sizes, fineness)
    law, anchor, friction_choice = choices.friction(law, setup, sizes)
    adhesion, adhesion_choice = choices.adhesion(law, setup, sizes)
    wall_stiffness, wall_choice = _wall_stiffness(setup, sizes)
    tip, tip_choice = choices.tip(config, setup, gap)
    physics = replace(
        setup.physics,
        wall_stiffness=wall_stiffness,
        indenter=tip,
        contact=law,
        gap=gap,
        slip_reference=anchor,
    )
    solver, linear, cost = _choose_solver(config, setup, physics, sizes)
    if is_in_time := choices.is_followed_on_body(config, setup, solver):
        physics = problem_along_history(setup, physics, sizes.h_contact)
        solver, linear, cost = _choose_solver(config, setup, physics, sizes)
    if cost.memory > machine_memory():
        work = physics.solver_work(str(solver.value), str(linear.value))
        raise _memory_error(config, physics, sizes, work, fineness)
    warnings = (
        *material_warnings(config, setup),
        *scene_warnings(setup, law, gap, sizes),
        *fluid_warnings(setup, physics, sizes),
    )
    body_choices = (
        *choices.quantities(config),
        *choices.model_choices(setup),
        *choices.formulations(setup),
    )
    contact_choices = (
        gap_choice,
        law_choice,
        *friction_choice,
        *adhesion_choice,
        *tip_choice,
        *wall_choice,
    )
    peak_reason = missing_peak_reason(physics, sizes, setup.a if setup.max_depth > 0 else 0.0)
    peak_choices = [Choice("p_max", "empty", peak_reason)] if peak_reason else []
    mesh_choices = choices.mesh(config, setup, sizes, fineness)
    curve_choices = choices.curve(config, setup, solver, is_in_time)
    choices.refuse_nodal_stress(config, has_fields=not setup.history or is_in_time)
    if setup.history and not is_in_time:
        choices.refuse_reactions(
            config, "a history is followed on the elastic curve, of forces alone"
        )
    elif isinstance(config.body, UnboundedBody):
        choices.refuse_reactions(
            config, "a body without end is held at its base alone, by the force"
        )
    time_choices = (*curve_choices, *choices.time_steps(setup, physics, sizes))
    all_choices = (
        *body_choices,
        *contact_choices,
        *peak_choices,
        *mesh_choices,
        solver,
        linear,
        *time_choices,
    )
    time = time_prediction(setup, physics, sizes.h_contact, _history_reason(time_choices))
    prediction = _predict(setup, warnings, cost, time)
    no_slip = no_slip_effect(setup, physics, str(linear.value))
    friction = friction_correction(setup, physics, config.contact.friction)
    plan_parts = (
        setup.theory,
        fineness,
        all_choices,
        warnings,
        prediction,
        no_slip,
        friction,
        adhesion,
        setup.jkr,
        time,
    )
    plan = Plan(config.title, config.units, *plan_parts)
    settings = replace(config.solver, method=solver.value, linear=linear.value)  # type: ignore[arg-type]
    history = None if is_in_time else setup.history
    return Scene(physics, sizes, settings, plan, setup.experiment, history, setup.relaxation)


def _history_reason(all_choices: Iterable[Choice]) -> str:
    """Why a history is followed as it is; empty without one."""
    return next((choice.why for choice in all_choices if choice.key == "time"), "")


def _wall_stiffness(setup: ProblemSetup, sizes: Sizes) -> tuple[float, list[Choice]]:
    """The stiffness of a curved roller wall in three dimensions [pressure/length, without units];
    0: there is none.
    """
    physics = setup.physics
    if not physics.domain.has_curved_roller:
        return 0.0, []
    stiffness = WALL_STIFFNESS * physics.material.constants.E / sizes.h_far
    return stiffness, [Choice("wall", stiffness * physics.scales.stiffness, WALL_WHY)]


def _choose_solver(
    config: Config, setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes
) -> tuple[Choice, Choice, Cost]:
    nodes = candidate_count(sizes, physics.domain) * (
        physics.domain.dim if physics.has_friction else 1
    )
    method = choices.solver(config, setup, physics, nodes)
    direct = cost_of(sizes, physics.domain, physics.solver_work(str(method.value), "direct"))
    iterative = cost_of(sizes, physics.domain, physics.solver_work("newton", "iterative"))
    linear = choices.linear_solver(config, physics, sizes, direct, iterative, machine_memory())
    if linear.value == "direct":
        return method, linear, direct
    why = method.why if method.value == "newton" else choices.WHOLE_BODY_WHY
    return Choice("solver.method", "newton", why), linear, iterative


def _memory_error(
    config: Config,
    physics: ProblemDefinition,
    sizes: Sizes,
    work: SolverWork,
    fineness: MeshResolution | None,
) -> ConfigError:
    """What to say of a scene that is beyond this machine, and what would fit."""
    cost = cost_of(sizes, physics.domain, work)
    available_memory = machine_memory()
    key, name = (
        ("accuracy", "accuracy") if fineness else ("mesh.h_contact", "h_contact")
    )  # whoever set the sizes
    if cost_of(replace(sizes, inclusions=()), physics.domain, work).memory <= available_memory:
        key = "mesh.h_inclusions"
        name = "h_inclusions, or inclusions"
    memory_text = (
        f"about {cost.dofs:.2g} unknowns need {cost.memory / 1e9:.3g} GB; this machine "
        f"has {available_memory / 1e9:.3g} GB"
    )
    iterative = cost_of(
        sizes, physics.domain, replace(work, method="newton", linear="iterative")
    ).memory
    if iterative <= available_memory and not choices.iterative_obstacle(config, physics, sizes):
        return ConfigError(
            key, memory_text, f"solver.linear: iterative needs {iterative / 1e9:.3g} GB"
        )
    return ConfigError(key, memory_text, f"use a larger {name}, or symmetry")


def _predict(
    setup: ProblemSetup, warnings: tuple[ModelWarning, ...], cost: Cost, time: TimePrediction | None
) -> dict[str, float]:
    """What to expect of the results and of the run, in the user's units."""
    truncation = {"truncation_error": setup.truncation.error} if setup.truncation else {}
    error = sum(doubt.force_error for doubt in warnings) if setup.physics.deltas[-1] > 0 else 0.0
    mesh_size = {
        "cells": round(cost.cells),
        "dofs": round(cost.dofs),
        "memory_MB": round(cost.memory / 1e6),
    }
    effort = mesh_size | {"seconds": float(f"{cost.seconds:.2g}")}
    quantity = "delta" if setup.physics.path.control == "force" else "force"
    time_values = time.prediction(quantity) if time and setup.physics.is_time_dependent else {}
    return (
        prediction_of(setup)
        | time_values
        | truncation
        | ({"force_error": error} if error else {})
        | effort
    )
