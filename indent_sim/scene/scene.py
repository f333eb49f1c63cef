"""Scene: a simulation with all decisions made. `resolve` makes it from a Config."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from indent_sim.mesh.grid import Grid, map_grid
from indent_sim.mesh.imported_mesh import ImportedMesh
from indent_sim.mesh.reactions import reaction_columns
from indent_sim.mesh.sizes import Sizes
from indent_sim.mesh.two_bodies import TwoBodyDomain
from indent_sim.model.experiment import Experiment
from indent_sim.model.history import History
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.tip_track import TipTrack
from indent_sim.model.tips import FlatPunch, max_radius
from indent_sim.model.unbounded_bodies import UnboundedBody
from indent_sim.process.errors import ConfigError
from indent_sim.process.repr_tables import ReprTable, cell_text
from indent_sim.process.usage import machine_memory
from indent_sim.scene import choices, contact_choices, curve_choices, sizing, solver_choices
from indent_sim.scene.choices import Choice
from indent_sim.scene.cost import Cost, SolverWork, add_tip_cost
from indent_sim.scene.cost import predict_cost as cost_of
from indent_sim.scene.diffusion_times import drained_face_size
from indent_sim.scene.discretisation_warnings import scene_warnings
from indent_sim.scene.fluid_warnings import fluid_warnings
from indent_sim.scene.history_path import problem_along_history, row_depths
from indent_sim.scene.measured_constants import (
    SECONDS_PER_ROW,
    SECONDS_PER_SEARCHED_ROW,
    THEORY_SECONDS,
)
from indent_sim.scene.mesh_counts import candidate_count
from indent_sim.scene.model_warnings import (
    ModelWarning,
    material_warnings,
    pull_warnings,
    theory_warnings,
)
from indent_sim.scene.no_slip_effect import friction_correction, friction_sentence, no_slip_effect
from indent_sim.scene.peak_pressure import missing_peak_reason
from indent_sim.scene.plan import Plan
from indent_sim.scene.predictions import prediction_of
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup, set_up_problem, truncate_body
from indent_sim.scene.resolution import MeshResolution
from indent_sim.scene.sizing import END_FRACTION
from indent_sim.scene.slide import check_slide, check_slide_sizes, slide_choices
from indent_sim.scene.soft_tip import (
    check_soft_tip,
    refine_tip_corners,
    soft_tip_choices,
    soft_tip_config,
)
from indent_sim.scene.time_prediction import TimePrediction, time_prediction
from indent_sim.theory.solution import Solution
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.scene_sections import SolverSettings
    from indent_sim.config.schema import Config

FRICTION_WHY = "the surface has friction, but the theory has none"
YIELD_WHY = "the body yields, but the theory is elastic"


@dataclass(frozen=True)
class Scene:
    """Simulation with all decisions made: physics, element sizes, solver and plan.

    Attributes
    ----------
    experiment : Experiment or None
        Properties of the experiment, nondimensional, that are applied to the solved curve.
    history_on_curve : History or None
        The nondimensional history that is evaluated on the elastic curve; `physics.path` is then
        the path of that curve. None if the path itself holds the rows.
    relaxation : Relaxation or None
        Relaxation of the whole body that is applied to its elastic curve.
    tip_scene : Scene or None
        Scene of the elastic part of a soft tip below its rigid holder, which is condensed like the
        body; None if the tip is rigid.
    """

    physics: ProblemDefinition
    sizes: Sizes
    solver: SolverSettings
    plan: Plan
    experiment: Experiment | None = None
    history_on_curve: History | None = None
    relaxation: Relaxation | None = None
    tip_scene: Scene | None = None

    def __repr__(self) -> str:
        return self._repr_table().text

    def _repr_html_(self) -> str:
        return self._repr_table().html

    def _repr_table(self) -> ReprTable:
        """Return the table for a notebook: every choice with its reason, and the predictions."""
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
        """True if the scene is solved on a mesh.

        If it is solved by theory, `sizes` are the distances between the surface points of the
        output.
        """
        return self.solver.method != "theory"

    @property
    def uses_elastic_curve(self) -> bool:
        """True if an experiment or the rows of a history are computed from the elastic curve."""
        return self.experiment is not None or self.history_on_curve is not None

    @property
    def is_time_dependent(self) -> bool:
        """True if every row of the result has a time."""
        return self.history_on_curve is not None or bool(self.physics.path.times)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the force table that this scene has in addition to the common ones."""
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
        """Return the columns with the reactions of the supports; empty if not written."""
        return reaction_columns(self.physics.domain)

    @property
    def contact_track(self) -> TipTrack:
        """Track of the middle of the expected contact, which a tilted tip has beside its axis."""
        return replace(self.physics.track, center=self.sizes.axis)

    @property
    def method(self) -> str:
        """Contact method, or "theory" if the scene is solved without a mesh."""
        return self.physics.contact.method if self.is_meshed else "theory"

    @property
    def cost(self) -> Cost:
        """Predicted cost of this scene on its mesh, without runs for error estimates."""
        work = self.physics.solver_work(self.solver.method, self.solver.linear)
        cost = cost_of(self.sizes, self.physics.domain, work)
        if self.tip_scene is None or not self.has_two_body_mesh:
            return cost
        tip_cost = cost_of(self.tip_scene.sizes, self.tip_scene.physics.domain, work)
        return add_tip_cost(cost, tip_cost)

    @property
    def has_two_body_mesh(self) -> bool:
        """True if a soft tip is on the mesh of the body and not on a separate mesh."""
        return self.tip_scene is not None and self.solver.method != "condensed"

    def two_body_scene(self) -> Scene:
        """Return the scene whose domain consists of the body and its soft tip.

        The tip is a region in the units of the body, with the formulation of its own scene.
        """
        elastic_part = self.physics.indenter.elastic_part
        assert self.tip_scene is not None
        assert elastic_part is not None
        tip_domain = self.tip_scene.physics.domain
        (tip_region,) = tip_domain.regions
        region = replace(tip_region, name="tip", material=elastic_part.material)
        domain = TwoBodyDomain.join(self.physics.domain, tip_domain, region)
        return self.replace_physics(domain=domain)

    def grid(self) -> Grid:
        """Return the mesh of the model domain; raise MeshError if gmsh fails."""
        from indent_sim.mesh import gmsh  # A plan needs no process that meshes.

        return gmsh.build_mesh(self.physics.domain, self.sizes)

    def adapt_grid(self, similar_scene: Scene, grid: Grid) -> Grid:
        """Return the mesh of a similar scene, mapped to the body and the contact of this scene.

        Parameters
        ----------
        similar_scene : Scene
            A scene whose body and contact differ little from those of this scene.
        grid : Grid
            The mesh of the similar scene.

        Returns
        -------
        Grid
            The mapped mesh, or a new mesh if it cannot be mapped.
        """
        radii = tuple(
            scene.plan.prediction.get("a", 0.0) / scene.physics.scales.length
            for scene in (similar_scene, self)
        )
        mapped_grid = map_grid(grid, similar_scene.physics.domain, self.physics.domain, radii)
        return mapped_grid or self.grid()

    def start_meshing(self) -> Callable[[], Grid]:
        """Start meshing in another process; return the function that waits for the mesh."""
        from indent_sim.mesh import gmsh

        return gmsh.start_meshing(self.physics.domain, self.sizes)

    def replace_physics(self, **changes: Any) -> Scene:
        """Return this scene with another tip, path or contact law on the same elements."""
        return replace(self, physics=replace(self.physics, **changes))

    @cached_property
    def theory_differences(self) -> tuple[str, ...]:
        """Return texts on the differences between this problem and that of the reference theory.

        The tuple is empty if there are no differences.
        """
        theory = self.plan.theory
        physics = self.physics
        is_finite = theory is not None and theory.is_finite_strain
        # The gap to a plate is the same at the deformed and the undeformed point.
        has_plate = physics.is_compressed
        reasons = (
            (
                not physics.small_strain and not is_finite,
                "strains are finite, but the theory is for small strain",
            ),
            (physics.yields, YIELD_WHY),
            (physics.has_friction, FRICTION_WHY),
            (physics.slides, "the tip slides, but the theory has no sideways motion"),
            (
                bool(physics.permeable_regions),
                "fluid flows in the pores, but the theory has no pore fluid",
            ),
            (
                bool(physics.relaxing_regions),
                "the shear modulus relaxes, but the theory is elastic",
            ),
            (
                physics.contact.may_snap_through,
                "the attraction has a finite range, but in the theory its range is zero",
            ),
            (
                physics.gap == "current" and not has_plate,
                (
                    "the gap is evaluated at the deformed point, but in the theory at the "
                    "undeformed point"
                ),
            ),
            (
                physics.gap == "reference" and is_finite,
                "the gap is evaluated at the undeformed point, but in the theory the surface "
                "slides under the plate",
            ),
        )
        differences = [why for applies, why in reasons if applies]
        if theory is not None:
            differences += theory.differences
        # The theory, too, may name the finite strain.
        return tuple(dict.fromkeys(differences))

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the plan: behaviour in time, effects of no slip and of friction."""
        time = self.plan.time
        no_slip = self.plan.stick
        friction = self.plan.friction
        sentences = (
            time and time.words,
            no_slip and no_slip.remark,
            friction and friction_sentence(self.physics, friction),
        )
        return tuple(sentence for sentence in sentences if sentence)

    def theory_solution(self, delta: float) -> Solution | None:
        """Return the contact of the reference theory at a depth [length], None if it has none.

        Parameters
        ----------
        delta : float
            A depth. All prescribed depths are solved together at the first call.
        """
        theory = self.plan.theory
        if theory is None:
            return None
        return self._prescribed_solutions.get(delta) or theory.solution_at_depth(delta)

    @cached_property
    def _prescribed_solutions(self) -> dict[float, Solution]:
        """Contacts of the reference theory at all prescribed depths; empty if one is missing."""
        if self.plan.theory is None or self.physics.path.control != "depth":
            return {}
        # Rows have depths in the user's units: the conversion and back repeats their round-off.
        scale = self.physics.scales.depth
        deltas = [delta * scale / scale for delta in self.physics.deltas]
        solutions = self.plan.theory.solutions_at_depths(deltas)
        return dict(zip(deltas, solutions, strict=True)) if solutions else {}

    @property
    def exact_theory(self) -> Theory | None:
        """The reference theory if it solves exactly this problem; None otherwise."""
        return self.plan.theory if not self.theory_differences else None

    def has_peak_pressure(self, a: float) -> bool:
        """True if a mesh can resolve the peak pressure of a contact of radius a [length].

        A mesh cannot resolve it if the contact ends at the edge of the tip, as under a punch, since
        the pressure is singular at the edge.
        """
        tip = self.physics.indenter
        if (
            self.sizes.punch_edge is not None
            and not isinstance(tip.upright, FlatPunch)
            and a >= END_FRACTION * max_radius(tip)
        ):
            return False
        return not missing_peak_reason(self.physics, self.sizes, a)


Mesher = Callable[[Scene], Grid]


def start_mesher() -> None:
    """Start the meshing process, so that it imports gmsh while this process continues."""
    from indent_sim.mesh import mesher_process

    mesher_process.start_mesher()


def resolve(
    config: Config, per_radius: float | None = None, piece: ImportedMesh | None = None
) -> Scene:
    """Return the scene of a config, with all decisions that the config leaves open.

    Parameters
    ----------
    config : Config
        The validated scene file.
    per_radius : float, optional
        Number of elements in every contact radius, for a config with `accuracy`; by default the
        number that is expected to reach this accuracy.
    piece : ImportedMesh, optional
        Mesh of the body, if it has already been read from the scene's mesh file.

    Returns
    -------
    Scene
        The scene with all decisions made.

    Raises
    ------
    ConfigError
        If the scene is impossible, or needs more memory than this machine has.
    """
    if config.yields and config.experiment:
        problem = "is simulated with the load curve of a linear body, but this one yields"
        remedy = "leave it out of runs; fit and hardness take the frame of an instrument from it"
        raise ConfigError("experiment", problem, remedy)
    setup = set_up_problem(config, piece)
    check_soft_tip(setup)
    check_slide(setup)
    if by_theory := solver_choices.theory(config, setup):
        return _theory_scene(config, setup, by_theory)
    return _meshed_scene(config, truncate_body(config, setup), per_radius)


def _soft_tip_scene(config: Config, setup: ProblemSetup, sizes: Sizes) -> Scene:
    """Return the scene of the elastic part of a soft tip."""
    tip_scene = resolve(soft_tip_config(config, setup, sizes))
    refined_sizes = refine_tip_corners(tip_scene.sizes, tip_scene.physics)
    return replace(tip_scene, sizes=refined_sizes)


def _theory_scene(config: Config, setup: ProblemSetup, solver: Choice) -> Scene:
    """Return a scene that is solved by theory; its sizes are distances between surface points."""
    physics = setup.physics
    decisions_on_curve = curve_choices.curve(config, setup, solver)
    choices.refuse_reactions(config, "theory solves this scene, without a mesh")
    choices.refuse_nodal_stress(config, has_fields=False)
    all_choices = (
        *choices.quantities(config),
        solver,
        *choices.theory_choices(config, setup),
        *decisions_on_curve,
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
    """Return the scene that is solved on a mesh, with all its choices in their order."""
    fineness = sizing.mesh_resolution(config, setup, per_radius)
    gap, gap_choice = contact_choices.gap(config.contact, setup)
    sizes = sizing.sizes(config, setup, fineness, gap)
    check_slide_sizes(setup, sizes)
    law, law_choice = contact_choices.contact(config.contact, setup, sizes, fineness)
    law, slip_reference, friction_choice = contact_choices.friction(law, setup, sizes)
    adhesion, adhesion_choice = contact_choices.adhesion(law, setup, sizes)
    wall_stiffness, wall_choice = _wall_stiffness(setup, sizes)
    tip, tip_choice = contact_choices.tip(config, setup, gap)
    physics = replace(
        setup.physics,
        wall_stiffness=wall_stiffness,
        indenter=tip,
        contact=law,
        gap=gap,
        slip_reference=slip_reference,
    )
    solver, linear, cost = _choose_solver(config, setup, physics, sizes)
    if follows_history := choices.follows_history(config, setup, solver):
        physics = problem_along_history(setup, physics, drained_face_size(physics, sizes))
        solver, linear, cost = _choose_solver(config, setup, physics, sizes)
    history_on_curve = None if follows_history else setup.history
    if cost.memory > machine_memory():
        work = physics.solver_work(str(solver.value), str(linear.value))
        raise _memory_error(config, physics, sizes, work, fineness)
    warnings = (
        *material_warnings(config, setup),
        *scene_warnings(setup, row_depths(setup, follows_history), law, gap, sizes),
        *fluid_warnings(setup, physics, sizes),
    )
    body_choices = (
        *choices.quantities(config),
        *choices.model_choices(setup),
        *choices.formulations(setup),
    )
    is_soft = physics.indenter.elastic_part is not None
    tip_scene = _soft_tip_scene(config, setup, sizes) if is_soft else None
    if tip_scene and solver.value == "newton":
        work = physics.solver_work("newton", "direct")
        cost = add_tip_cost(cost, cost_of(tip_scene.sizes, tip_scene.physics.domain, work))
    contact_decisions = (
        *(soft_tip_choices(setup, tip_scene.physics.domain) if tip_scene else ()),
        gap_choice,
        law_choice,
        *friction_choice,
        *adhesion_choice,
        *tip_choice,
        *wall_choice,
        *choices.side_force_choices(physics),
        *slide_choices(setup),
    )
    peak_reason = missing_peak_reason(physics, sizes, setup.a if setup.max_depth > 0 else 0.0)
    peak_choices = [Choice("p_max", "empty", peak_reason)] if peak_reason else []
    mesh_choices = choices.mesh(config, setup, sizes, fineness)
    decisions_on_curve = curve_choices.curve(config, setup, solver, follows_history)
    choices.refuse_nodal_stress(config, has_fields=history_on_curve is None)
    if history_on_curve:
        choices.refuse_reactions(
            config,
            "a history is evaluated on the elastic load curve, which contains only the "
            "forces of the tip",
        )
    elif isinstance(config.body, UnboundedBody):
        choices.refuse_reactions(
            config, "an unbounded body is supported at its base only, whose reaction is the force"
        )
    time_choices = (*decisions_on_curve, *choices.time_steps(setup, physics, sizes))
    all_choices = (
        *body_choices,
        *contact_decisions,
        *peak_choices,
        *mesh_choices,
        solver,
        linear,
        *time_choices,
    )
    time = time_prediction(
        setup, physics, drained_face_size(physics, sizes), _history_reason(time_choices)
    )
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
        setup.yielding,
    )
    plan = Plan(config.title, config.units, *plan_parts)
    settings = replace(
        config.solver,
        method=solver.value,  # type: ignore[arg-type]
        linear=linear.value,  # type: ignore[arg-type]
    )
    evaluation = setup.experiment, history_on_curve, setup.relaxation
    return Scene(physics, sizes, settings, plan, *evaluation, tip_scene)


def _history_reason(all_choices: Iterable[Choice]) -> str:
    """Return the reason for the method by which a history is solved; empty without a history."""
    return next((choice.why for choice in all_choices if choice.key == "time"), "")


def _wall_stiffness(setup: ProblemSetup, sizes: Sizes) -> tuple[float, list[Choice]]:
    """Return the penalty stiffness of a curved roller wall, and its entry in the list of choices.

    The stiffness is a pressure per displacement, divided by its scale. Only three-dimensional
    domains have such a wall; for other domains the stiffness is 0.
    """
    physics = setup.physics
    if not physics.domain.has_curved_roller:
        return 0.0, []
    # Under the pressure E the wall then moves by less than 1e-3 of an element.
    factor = 1e3
    stiffness = factor * physics.material.constants.E / sizes.h_far
    why = (
        "u.n = 0 on the curved roller wall is imposed weakly, along the normal of the cylinder, "
        f"with the stiffness {factor:g} E/h_far"
    )
    return stiffness, [Choice("wall", stiffness * physics.scales.stiffness, why)]


def _choose_solver(
    config: Config, setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes
) -> tuple[Choice, Choice, Cost]:
    """Choose method and linear solver by their predicted costs; return both and the cost."""
    nodes = candidate_count(sizes, physics.domain) * (
        physics.domain.dim if physics.has_friction else 1
    )
    method = solver_choices.solver(config, setup, physics, nodes)
    direct = cost_of(sizes, physics.domain, physics.solver_work(str(method.value), "direct"))
    iterative = cost_of(sizes, physics.domain, physics.solver_work("newton", "iterative"))
    linear = solver_choices.linear_solver(
        config, physics, sizes, direct, iterative, machine_memory()
    )
    if linear.value == "direct":
        return method, linear, direct
    why = method.why if method.value == "newton" else solver_choices.WHOLE_BODY_WHY
    return Choice("solver.method", "newton", why), linear, iterative


def _memory_error(
    config: Config,
    physics: ProblemDefinition,
    sizes: Sizes,
    work: SolverWork,
    fineness: MeshResolution | None,
) -> ConfigError:
    """Return the ConfigError for a scene that needs more memory than available, with a remedy."""
    cost = cost_of(sizes, physics.domain, work)
    available_memory = machine_memory()
    # The remedy names the key that determined the element sizes.
    key = "accuracy" if fineness else "mesh.h_contact"
    name = key
    if cost_of(replace(sizes, inclusions=()), physics.domain, work).memory <= available_memory:
        key = "mesh.h_inclusions"
        name = "mesh.h_inclusions, larger inclusions"
    memory_text = (
        f"about {cost.dofs:.2g} unknowns need {cost.memory / 1e9:.3g} GB; this machine "
        f"has {available_memory / 1e9:.3g} GB"
    )
    iterative = cost_of(
        sizes, physics.domain, replace(work, method="newton", linear="iterative")
    ).memory
    if iterative <= available_memory and not solver_choices.iterative_obstacle(
        config, physics, sizes
    ):
        return ConfigError(
            key, memory_text, f"use solver.linear: iterative, which needs {iterative / 1e9:.3g} GB"
        )
    return ConfigError(key, memory_text, f"use a larger {name}, or mesh.symmetry: auto")


def _predict(
    setup: ProblemSetup, warnings: tuple[ModelWarning, ...], cost: Cost, time: TimePrediction | None
) -> dict[str, float]:
    """Return the predicted results and cost of a meshed scene, in the user's units."""
    truncation = {"truncation_error": setup.truncation.error} if setup.truncation else {}
    error = 0.0
    if setup.physics.deltas[-1] > 0:
        error = sum(warning.force_error for warning in warnings)
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
