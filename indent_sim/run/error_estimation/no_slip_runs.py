"""What no slip instead of no friction would change of a scene's force, solved beside a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import isnan, nan
from typing import Literal

import numpy as np

from indent_sim.model.contact import AugmentedLagrangian, Friction, SlipReference
from indent_sim.model.load_path import LoadPath
from indent_sim.process.usage import machine_memory
from indent_sim.run.error_estimation.coarser_run import CoarserRun, States
from indent_sim.scene.cost import MAX_CANDIDATES, SolverWork, candidate_count, predict_cost
from indent_sim.scene.predictions import STICK_FRICTION, NoSlipEffect, tensile_rim_width
from indent_sim.scene.scene import Scene

SLIP_REFERENCES: tuple[SlipReference, ...] = ("mid", "implicit", "glue")
STICK_STEPS = {
    2: 10,
    3: 4,
}  # by dim: new contact sticks on the way through each, to 0.05 % and 0.15 % of the force


def solve_no_slip_effect(run: CoarserRun, follow: Callable[[Scene], States]) -> NoSlipEffect | None:
    """What pure stick instead of no friction would change of the deepest force of a run or a
    companion, on its mesh: with the anchor `mid`, between its two ends.

    None where there is no such number: friction or adhesion already, no contact, a body that may
    slide away, or a run that fails.
    """
    deepest = max((state.delta for state in run.states_by_step.values()), default=0.0)
    if run.scene is None:
        return None
    solved = map(follow, no_slip_scenes(run.scene, deepest / run.scene.physics.scales.depth))
    forces = [states[-1].force if states and states[-1].converged else nan for states in solved]
    if not forces or not forces[0] > 0 or any(map(isnan, forces)):
        return None
    changes = [100 * (force / forces[0] - 1) for force in forces[1:]]
    return NoSlipEffect(changes[0], min(changes), max(changes), "solved beside this run")


def no_slip_scenes(scene: Scene, depth: float) -> list[Scene]:
    """The scenes that tell what stick would change of a scene's force at a depth: without friction,
    and with each anchor; none where there is no such number.
    """
    frictionless = _frictionless_scene(scene) if depth > 0 else None
    if frictionless is None:
        return []
    frictional = _sticking_scene(frictionless)
    steps = STICK_STEPS[scene.physics.domain.dim]
    return [
        _scene_to_depth(frictionless, depth, 1),
        *(_scene_to_depth(frictional, depth, steps, anchor) for anchor in SLIP_REFERENCES),
    ]


def no_slip_base_run(run: CoarserRun, coarser_run: CoarserRun | None) -> CoarserRun:
    """The one on whose mesh stick is solved: the run itself, in three dimensions its companion."""
    is_solid = run.scene is not None and run.scene.physics.domain.dim == 3
    return coarser_run if coarser_run is not None and is_solid else run


def _frictionless_scene(scene: Scene) -> Scene | None:
    """The same frictionless scene with a law that may have friction; None for one that may not."""
    physics = scene.physics
    if physics.is_path_dependent or physics.domain.pins:
        return None
    if scene.solver.linear == "iterative":
        factored = _direct_solver_scene(scene)
        return _frictionless_scene(factored) if factored else None
    law = physics.contact
    if not isinstance(law, AugmentedLagrangian):
        law = AugmentedLagrangian(epsilon_n=physics.material.E_star / scene.sizes.typical_size)
    return scene.replace_physics(contact=law)


def _direct_solver_scene(scene: Scene) -> Scene | None:
    """The same scene for a solver that knows friction; None where that does not fit this machine."""
    physics = scene.physics
    domain = scene.physics.domain
    is_linear = physics.small_strain and physics.gap == "reference"
    is_small = candidate_count(scene.sizes, domain) * domain.dim <= MAX_CANDIDATES
    method: Literal["condensed", "newton"] = "condensed" if is_linear and is_small else "newton"
    mixed = any(region.formulation == "mixed" for region in domain.regions)
    work = SolverWork(
        method, "direct", mixed, STICK_STEPS[domain.dim], is_nonlinear=True, has_friction=True
    )
    if predict_cost(scene.sizes, domain, work).memory > machine_memory():
        return None
    return replace(scene, solver=replace(scene.solver, method=method, linear="direct"))


def _sticking_scene(scene: Scene) -> Scene:
    """A frictionless scene whose surface sticks, on the whole body where a compliance along it
    would be too large.
    """
    law = scene.physics.contact
    domain = scene.physics.domain
    assert isinstance(law, AugmentedLagrangian)
    tensile_rim = tensile_rim_width(
        scene.physics.indenter, domain.regions[0].material.constants.nu, scene.sizes, domain.dim
    )
    friction: Friction = STICK_FRICTION if tensile_rim else "stick"
    is_large = candidate_count(scene.sizes, domain) * domain.dim > MAX_CANDIDATES
    solver = replace(scene.solver, method="newton") if is_large else scene.solver
    return replace(
        scene.replace_physics(contact=replace(law, friction=friction, epsilon_t=law.epsilon_n)),
        solver=solver,
    )


def _scene_to_depth(
    scene: Scene, depth: float, steps: int, slip_reference: SlipReference = "implicit"
) -> Scene:
    """The same scene on its way to a depth in equal steps."""
    depths = tuple(float(value) for value in np.linspace(0.0, depth, steps + 1)[1:])
    return scene.replace_physics(
        path=LoadPath("depth", depths), deltas=depths, anchor=slip_reference
    )
