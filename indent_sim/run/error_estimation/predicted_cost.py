"""Predicted cost of a run with the auxiliary runs of its error estimate."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from indent_sim.model.contact import ActiveSet, Penalty
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    coarser_scene,
    refine_scene,
    same_mesh_scenes,
)
from indent_sim.run.error_estimation.film_error import sudden_load_scene
from indent_sim.run.error_estimation.no_slip_runs import no_slip_base_run, no_slip_scenes
from indent_sim.run.error_estimation.refinement import MAX_LEVELS, MIN_REFINEMENT, refinement_ratio
from indent_sim.run.measured_constants import DRAINAGE_ERROR, DRAINAGE_ORDER, SMEARED_EDGE_ERROR
from indent_sim.scene.cost import Cost
from indent_sim.scene.measured_constants import (
    SECONDS_PER_RUN,
    SECONDS_PER_THEORY_RUN,
    START_SECONDS,
    THEORY_SECONDS,
)
from indent_sim.scene.scene import Scene


def predict_total_cost(scene: Scene, error_bars: bool = False) -> Scene:
    """Return the scene with the predicted processor time and memory of its whole run.

    Parameters
    ----------
    scene
        The scene of the run.
    error_bars
        True if error bars are requested in addition to `accuracy`.
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
    """Return the expected processor time [s] of a run in a process that has imported the libraries.

    The time is comparable with the column `cpu_s` of study.csv.
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
    """Return the cost of each auxiliary scene of the error estimate and of each finer mesh."""
    meshes = [scene, *(refine_scene(scene, ratio) for ratio in _expected_refinement_ratios(scene))]
    scenes = auxiliary_scenes(scene, error_bars)
    for coarser, finer in pairwise(meshes):
        scenes += [finer, *same_mesh_scenes(coarser), *_undrained_scenes(finer)]
    return [auxiliary.cost for auxiliary in scenes]


def auxiliary_scenes(scene: Scene, no_slip: bool) -> list[Scene]:
    """Return all scenes that a run solves in addition to its first mesh.

    Parameters
    ----------
    scene
        The scene of the run.
    no_slip
        True if the no-slip effect is also solved.
    """
    ratio, coarse_scene = coarser_scene(scene)
    base_scene = (
        no_slip_base_run(CoarserRun(1.0, (), scene), CoarserRun(ratio, (), coarse_scene)).scene
        or scene
    )
    stick_scenes = no_slip_scenes(base_scene, max(scene.physics.deltas)) if no_slip else []
    return [coarse_scene, *same_mesh_scenes(coarse_scene), *_undrained_scenes(scene), *stick_scenes]


def _undrained_scenes(scene: Scene) -> list[Scene]:
    """Return the suddenly loaded scene that measures the error of drainage boundary layers.

    The list is empty if no such scene is solved.
    """
    undrained = sudden_load_scene(scene)
    return [] if undrained is None else [undrained]


def _expected_refinement_ratios(scene: Scene) -> list[float]:
    """Return the expected ratios of element sizes of the first mesh to those of each finer mesh."""
    physics = scene.physics
    resolution = scene.plan.resolution
    if resolution is None:
        return []
    if physics.permeable_regions and physics.drainage.tip == "sealed":
        is_smeared = scene.sizes.h_edge is None and not isinstance(physics.contact, ActiveSet)
        ratios = [1.0]
        error = SMEARED_EDGE_ERROR if is_smeared else DRAINAGE_ERROR
        while (
            error_bar := error * (ratios[-1] * resolution.n) ** -DRAINAGE_ORDER
        ) > resolution.target:
            ratios.append(ratios[-1] * refinement_ratio(resolution.target / error_bar))
        if len(ratios) > 1:
            return ratios[1:MAX_LEVELS]
    # The first mesh meets most accuracies. It leaves no margin for the errors of the load
    # increments with friction or of a penalty, and the element sizes of an imported mesh are given.
    needs_refinement = (
        physics.has_friction,
        isinstance(physics.contact, Penalty),
        scene.sizes.refinements is not None,
    )
    return [MIN_REFINEMENT] if any(needs_refinement) else []
