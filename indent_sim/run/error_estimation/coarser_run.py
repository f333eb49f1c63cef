"""Auxiliary scenes of the error estimate: coarser mesh, softer penalty, halved increments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from indent_sim.model.contact import Penalty
from indent_sim.model.state import State
from indent_sim.scene import resolution
from indent_sim.scene.scene import Scene

# Ratio of the element sizes of the coarser run to those of the run; see `error_bars`.
REFINEMENT_RATIO = 1.6

StatesByStep = dict[int, State]
States = Sequence[State]


@dataclass(frozen=True)
class CoarserRun:
    """Run of the same scene on a mesh with element sizes multiplied by `ratio`.

    Attributes
    ----------
    ratio
        Grid refinement ratio; below 1 the mesh is finer.
    states
        The rows of the run.
    scene
        The scene on this mesh; None if it is not known.
    """

    ratio: float
    states: States
    scene: Scene | None = field(default=None, repr=False)

    @property
    def states_by_step(self) -> StatesByStep:
        """Return the converged states as a dictionary by their step."""
        return states_by_step(self.states)


def states_by_step(states: States) -> StatesByStep:
    """Return the converged states as a dictionary by their step."""
    return {state.step: state for state in states if state.converged}


def coarsen_scene(scene: Scene, ratio: float) -> Scene:
    """Return the scene with all element sizes multiplied by `ratio`."""
    physics = scene.physics
    sizes = resolution.coarsened_sizes(
        scene.sizes, ratio, physics.domain.height, is_column=physics.is_porous_column
    )
    return replace(
        scene.replace_physics(wall_stiffness=scene.physics.wall_stiffness / ratio),
        sizes=sizes,
        tip_scene=scene.tip_scene and coarsen_scene(scene.tip_scene, ratio),
    )


def coarser_scene(scene: Scene, previous_scene: Scene | None = None) -> tuple[float, Scene]:
    """Choose the scene of the coarser run and its grid refinement ratio.

    The element sizes of an imported mesh are given. Its auxiliary run has one uniform refinement
    less, or one more if the mesh is not refined.

    Parameters
    ----------
    scene
        The scene whose error is estimated.
    previous_scene
        The scene of the previous level of adaptive refinement, which is used as the coarser run.

    Returns
    -------
    ratio
        Element sizes of the coarser scene divided by those of `scene`.
    coarser_scene
        The scene of the coarser run.
    """
    level = scene.sizes.refinements
    if level is not None:
        coarser_level = level - 1 if level > 0 else level + 1
        return 2.0 ** (level - coarser_level), _set_refinements(scene, coarser_level)
    if previous_scene is not None:
        return previous_scene.sizes.h_contact / scene.sizes.h_contact, previous_scene
    return REFINEMENT_RATIO, coarsen_scene(scene, REFINEMENT_RATIO)


def refine_scene(scene: Scene, ratio: float) -> Scene:
    """Return the scene with element sizes divided by `ratio`, or an imported mesh refined once."""
    level = scene.sizes.refinements
    return coarsen_scene(scene, 1 / ratio) if level is None else _set_refinements(scene, level + 1)


def _set_refinements(scene: Scene, refinements: int) -> Scene:
    """Return the scene with another number of uniform refinements of its imported mesh."""
    return replace(scene, sizes=resolution.refined_sizes(scene.sizes, refinements))


def halve_penalty(scene: Scene) -> Scene | None:
    """Return the scene with half the penalty stiffness; None if the law has no penalty."""
    law = scene.physics.contact
    if not isinstance(law, Penalty):
        return None
    tangential = law.epsilon_t if law.epsilon_t == "auto" else law.epsilon_t / 2
    soft_law = replace(law, epsilon_n=law.stiffness / 2, epsilon_t=tangential)
    return scene.replace_physics(contact=soft_law)


def halve_increments(scene: Scene) -> Scene | None:
    """Return the scene in increments half as long; None if this does not change the result."""
    physics = scene.physics
    if not physics.depends_on_step_size:
        return None
    path = physics.path.with_halved_increments()
    if physics.path.turns and not physics.path.times:
        return scene.replace_physics(path=path, deltas=path.values)
    return scene.replace_physics(path=path, deltas=_halve_values(physics.deltas))


def with_solved_depths(scene: Scene, states: States) -> Scene:
    """Return the scene with the solved depths of its rows prescribed, if they were searched for.

    Two solutions with different increments to the same depths differ only by the error of the
    increments.
    """
    physics = scene.physics
    if not physics.searches_unloading_depths:
        return scene
    depths = [state.delta / physics.scales.depth for state in states if state.converged]
    path = replace(physics.path.with_first_values(depths), unloading=None)
    return scene.replace_physics(path=path, deltas=path.values)


def double_bath_ramp(scene: Scene) -> Scene | None:
    """Return the scene with a bath ramp of twice the duration; None if there is no bath ramp."""
    ramp = scene.physics.bath_ramp
    return scene.replace_physics(bath_ramp=2 * ramp) if ramp else None


def same_mesh_scenes(scene: Scene) -> list[Scene]:
    """Return the auxiliary scenes that are solved on the same mesh as `scene`."""
    scenes = (halve_penalty(scene), halve_increments(scene), double_bath_ramp(scene))
    return [auxiliary for auxiliary in scenes if auxiliary is not None]


def _halve_values(values: Sequence[float]) -> tuple[float, ...]:
    """Return the values of a path with the means of neighbouring values inserted."""
    steps = pairwise((0.0, *values))
    return tuple(
        refined_value
        for previous, value in steps
        for refined_value in ((previous + value) / 2, value)
    )
