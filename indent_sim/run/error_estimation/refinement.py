"""Refine until the estimated error of the force is what `accuracy` asks for, or say why not."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.contact import ActiveSet, Penalty
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    coarser_scene,
    refine_scene,
    same_mesh_scenes,
)
from indent_sim.run.error_estimation.error_bars import AnyErrorBars, ErrorBudget
from indent_sim.run.error_estimation.film_error import sudden_load_scene
from indent_sim.run.error_estimation.no_slip_runs import no_slip_base_run, no_slip_scenes
from indent_sim.scene.cost import (
    SECONDS_PER_RUN,
    SECONDS_PER_THEORY_RUN,
    START_SECONDS,
    THEORY_SECONDS,
    Cost,
)
from indent_sim.scene.resolution import (
    MAX_ELEMENTS,
    ORDER_OF_CONVERGENCE,
    MeshResolution,
    target_error,
)
from indent_sim.scene.scene import Scene

MAX_LEVELS = 6
MIN_FORCE_FRACTION = (
    1e-6  # of the largest force: a step with less has none that an accuracy could be asked of
)
# how much finer a next mesh is
MIN_REFINEMENT = 1.3
MAX_REFINEMENT = 2.5
REFINEMENT_MARGIN = 1.1  # and how much finer than the estimate says
# The error bar to expect of a body that drains is about DRAINING n^-DRAINING_RATE, with n elements
# in the contact radius: the fluid's pressure has a corner where the tip's seal ends. SMEARED_EDGE:
# where that edge comes to lie within elements that are sealed in part. Measured on a punch and a
# ball, n = 5 to 56
DRAINAGE_ERROR = 0.04
SMEARED_EDGE_ERROR = 0.16
DRAINAGE_ORDER = 1.3

Resolve = Callable[[float | None], Scene]  # the scene with so many elements in a contact radius
log = logging.getLogger("indent_sim")


@dataclass
class RefinementLevel:
    """A scene on one of the meshes on the way to its accuracy."""

    scene: Scene
    previous_resolutions: tuple[
        float, ...
    ] = ()  # elements in the contact radius of the attempts before, in turn
    coarser_run: CoarserRun | None = (
        None  # the last of those as that of this one; None: it makes its own
    )
    failure: str = ""  # why it is not accurate enough; "" when it is
    next_level: RefinementLevel | None = None  # what to try then; None: nothing may help

    def assess(self, resolve: Resolve, states: Sequence[State], error_bars: AnyErrorBars) -> None:
        """Find whether an error bar is wider than the scene's accuracy allows, and what to try
        then.
        """
        relative_errors = [
            (budget.total / force, budget)
            for force, budget in _loaded_rows(states, error_bars.budgets)
        ]
        unknown = [
            (inf, budget)
            for relative_error, budget in relative_errors
            if relative_error != relative_error
        ]
        error, worst = max(
            unknown or relative_errors, key=lambda item: item[0], default=(0.0, None)
        )
        fineness = self.scene.plan.resolution
        if fineness is None or worst is None or error <= fineness.target:
            return
        resolutions = (*self.previous_resolutions, fineness.n)
        first_step_error = next(
            (budget.path / force for force, budget in _loaded_rows(states, error_bars.budgets)), 0.0
        )
        next_scene, outcome_text = _next_refinement(
            resolve, fineness, error, worst, first_step_error, len(resolutions)
        )
        if next_scene is not None and next_scene.plan.resolution is not None:
            outcome_text = (
                f"refining to {next_scene.plan.resolution.n:.3g} elements in the contact radius"
            )
            ratio = self.scene.sizes.h_contact / next_scene.sizes.h_contact
            self.next_level = RefinementLevel(
                next_scene, resolutions, CoarserRun(ratio, states, self.scene)
            )
        self.failure = (
            f"accuracy not reached: the error at step {worst.step} is estimated as "
            f"{error:.2g} of the force"
        )
        self.failure += f", {fineness.target:g} is asked for; {outcome_text}"


def adaptive_refinement(
    resolve: Resolve, elements: float | None = None, previous_resolutions: Sequence[float] = ()
) -> Iterator[RefinementLevel]:
    """A scene, and finer and finer ones while the last is judged not to be accurate enough.

    A resumed run begins with the `elements` in the contact radius of its last attempt; `previous_resolutions` are
    those before.
    """
    level: RefinementLevel | None = RefinementLevel(resolve(elements), tuple(previous_resolutions))
    while level is not None:
        yield level
        if level.next_level is not None:
            log.info(level.failure)
        level = level.next_level


def predict_total_cost(scene: Scene, error_bars: bool = False) -> Scene:
    """The scene with the seconds and the memory of its whole run predicted; error_bars: asked for
    beside `accuracy`.
    """
    if not scene.is_meshed or not (error_bars or scene.plan.resolution):
        return scene
    auxiliary_costs = _auxiliary_costs(scene, error_bars)
    seconds = scene.cost.seconds + sum(
        cost.seconds - START_SECONDS + SECONDS_PER_RUN for cost in auxiliary_costs
    )
    memory = max(cost.memory for cost in (scene.cost, *auxiliary_costs))
    prediction = scene.plan.prediction | {
        "memory_MB": round(memory / 1e6),
        "seconds": float(f"{seconds:.2g}"),
    }
    return replace(scene, plan=replace(scene.plan, prediction=prediction))


def study_seconds(scene: Scene, error_bars: bool = False) -> float:
    """Processor time [s] to expect of a run in a process that has its libraries, as `cpu_s` of
    study.csv counts it.
    """
    if not scene.is_meshed:
        return (
            float(scene.plan.prediction.get("seconds", THEORY_SECONDS))
            - THEORY_SECONDS
            + SECONDS_PER_THEORY_RUN
        )
    auxiliary_costs = (
        _auxiliary_costs(scene, error_bars) if error_bars or scene.plan.resolution else []
    )
    return sum(
        cost.seconds - START_SECONDS + SECONDS_PER_RUN for cost in (scene.cost, *auxiliary_costs)
    )


def _auxiliary_costs(scene: Scene, error_bars: bool) -> list[Cost]:
    """What each scene costs that is solved beside this one for its error bars, or before it for its
    accuracy.
    """
    meshes = [scene, *(refine_scene(scene, ratio) for ratio in _expected_refinement_ratios(scene))]
    scenes = auxiliary_scenes(scene, error_bars)
    for coarser, finer in pairwise(meshes):
        scenes += [finer, *same_mesh_scenes(coarser), *_undrained_scenes(finer)]
    return [auxiliary.cost for auxiliary in scenes]


def auxiliary_scenes(scene: Scene, no_slip: bool) -> list[Scene]:
    """All scenes that a run solves beside its first attempt: for its error bars, and for what stick
    would change.
    """
    ratio, coarse_scene = coarser_scene(scene)
    base_scene = (
        no_slip_base_run(CoarserRun(1.0, (), scene), CoarserRun(ratio, (), coarse_scene)).scene
        or scene
    )
    stick_scenes = no_slip_scenes(base_scene, max(scene.physics.deltas)) if no_slip else []
    return [coarse_scene, *same_mesh_scenes(coarse_scene), *_undrained_scenes(scene), *stick_scenes]


def _undrained_scenes(scene: Scene) -> list[Scene]:
    """The scene on its own mesh that tells what films beside drained faces cost, if there are any."""
    undrained = sudden_load_scene(scene)
    return [] if undrained is None else [undrained]


def _expected_refinement_ratios(scene: Scene) -> list[float]:
    """How much finer than the first the further meshes on the way to a scene's accuracy will be, in
    turn.
    """
    physics = scene.physics
    fineness = scene.plan.resolution
    if fineness is None:
        return []
    if physics.permeable_regions and physics.drainage.tip == "sealed":
        is_smeared = scene.sizes.h_edge is None and not isinstance(physics.contact, ActiveSet)
        ratios = [1.0]
        error = SMEARED_EDGE_ERROR if is_smeared else DRAINAGE_ERROR
        while (error_bar := error * (ratios[-1] * fineness.n) ** -DRAINAGE_ORDER) > fineness.target:
            ratios.append(ratios[-1] * _refinement_ratio(fineness.target / error_bar))
        if len(ratios) > 1:
            return ratios[1:MAX_LEVELS]
    # the first mesh meets most accuracies, but leaves no room for what the steps of a path with
    # friction or a stiff penalty cost, and one from a file has the sizes that it has
    needs_refinement = (
        physics.has_friction,
        isinstance(physics.contact, Penalty),
        scene.sizes.refinements is not None,
    )
    return [MIN_REFINEMENT] if any(needs_refinement) else []


def _refinement_ratio(error_ratio: float) -> float:
    """How much finer a next mesh is whose error is to be `error_ratio` times that of this one."""
    return float(
        min(
            max(REFINEMENT_MARGIN * error_ratio ** (-1 / ORDER_OF_CONVERGENCE), MIN_REFINEMENT),
            MAX_REFINEMENT,
        )
    )


def forceless_row_warnings(
    scene: Scene, states: Sequence[State], error_bars: AnyErrorBars
) -> list[str]:
    """What to say of steps whose error bar is wider than the scene's accuracy allows, but that are
    not held to it.
    """
    floor = _force_threshold(states)
    fineness = scene.plan.resolution
    if fineness is None:
        return []
    forceless = [
        (state, budget)
        for state, budget in zip(states, error_bars.budgets, strict=True)
        if abs(state.force) <= floor
    ]
    wide_steps = [
        str(state.step)
        for state, budget in forceless
        if not budget.total <= fineness.target * abs(state.force)
    ]
    message = (
        f"accuracy is not asked of steps with less than {MIN_FORCE_FRACTION:g} of the largest force"
    )
    return (
        [f"{message}: of {', '.join(wide_steps[:5])}{' and more' if len(wide_steps) > 5 else ''}"]
        if wide_steps
        else []
    )


def _force_threshold(states: Sequence[State]) -> float:
    """The force up to which a step has none that an accuracy could be asked of."""
    return MIN_FORCE_FRACTION * max((abs(state.force) for state in states), default=0.0)


def _loaded_rows(
    states: Sequence[State], budgets: Sequence[ErrorBudget]
) -> Iterator[tuple[float, ErrorBudget]]:
    """The size of the force of every step that has one, with its budget."""
    floor = _force_threshold(states)
    forces = (abs(state.force) for state in states)
    return ((force, budget) for force, budget in zip(forces, budgets, strict=True) if force > floor)


def _next_refinement(
    resolve: Resolve,
    fineness: MeshResolution,
    error: float,
    worst: ErrorBudget,
    first_step_error: float,
    level_count: int,
) -> tuple[Scene | None, str]:
    """The next scene, or why there is none; `first_step_error`: what the path costs the first row."""
    allowed = fineness.target * worst.total / error
    if worst.enforcement >= allowed and fineness.stiffness_given:
        return (
            None,
            f"the penalty's epsilon_n alone costs {error * worst.enforcement / worst.total:.2g}",
        )
    if worst.path >= allowed:
        advice = f"{first_step_error:.2g} at the first row, which is one step from rest however many there are"
        advice = "more of them may help" if first_step_error < fineness.target else advice
        return (
            None,
            f"the steps of the path alone cost {error * worst.path / worst.total:.2g}: {advice}",
        )
    if worst.time >= allowed:
        return (
            None,
            f"the steps in time alone cost {error * worst.time / worst.total:.2g}: a larger "
            "loading.per_doubling",
        )
    if worst.truncation >= allowed:
        return (
            None,
            "the finite body that stands for the half-space, or flat facets for a curved "
            "surface, cost more",
        )
    if level_count >= MAX_LEVELS:
        return None, f"{level_count} attempts were not enough"
    fixed_errors = worst.truncation + worst.path + worst.time
    error_ratio = (allowed - fixed_errors) / (worst.total - fixed_errors)
    factor = 2.0 if fineness.refinements else _refinement_ratio(error_ratio)
    if fineness.n * factor > MAX_ELEMENTS:
        return None, f"more than {MAX_ELEMENTS:g} elements in the contact radius would be needed"
    try:
        return resolve(fineness.n * factor), ""
    except ConfigError as limit:
        return None, f"the next mesh is beyond this machine ({limit.problem})"


def accuracy_entry(
    config: Config, fineness: MeshResolution | None, previous_resolutions: Sequence[float]
) -> dict[str, Any] | None:
    """What run.json says of the accuracy: what was asked for, and of a mesh the elements in a
    contact radius, now and before; None where nothing was asked for.
    """
    target = target_error(config.accuracy)
    mesh_entries = {"elements": fineness.n, "tried": list(previous_resolutions)} if fineness else {}
    return None if target is None else {"target": target} | mesh_entries


@dataclass(frozen=True)
class ErrorRequest:
    """What a run was asked for beside its rows: error bars, and how small they are to be."""

    error_bars: bool
    accuracy: float | None

    @property
    def has_error_bars(self) -> bool:
        """Whether there are error bars."""
        return self.error_bars or self.accuracy is not None


def error_request_of(report: Mapping[str, Any]) -> ErrorRequest:
    """What the run of a run.json was asked for; those of older versions say it by what they have."""
    target = (report.get("accuracy") or {}).get("target")
    telltale_keys = {"stick"} if target else {"stick", "error_budget"}
    request = {"error_bars": bool(telltale_keys & report.keys()), "accuracy": target} | report.get(
        "asked", {}
    )
    return ErrorRequest(request["error_bars"], request["accuracy"])


def check_same_request(previous: ErrorRequest, request: ErrorRequest, folder: Path) -> None:
    """ConfigError when the run of a folder was asked for other error bars than the one to resume
    it.
    """
    if request.has_error_bars and not previous.has_error_bars:
        raise ConfigError(
            "", f"{folder} holds a run without error bars", "leave --resume out to replace it"
        )
    if previous.accuracy != request.accuracy:
        old_text, new_text = (
            f"accuracy {accuracy:g}" if accuracy else "no accuracy"
            for accuracy in (previous.accuracy, request.accuracy)
        )
        problem = f"{folder} holds a run with {old_text}, this one has {new_text}"
        raise ConfigError("accuracy", problem, "leave --resume out to replace it")
