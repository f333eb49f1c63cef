"""Change of the force if the surface could not slip on the tip, computed after a run."""

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
from indent_sim.run.measured_constants import STICK_STEPS
from indent_sim.scene.cost import MAX_CANDIDATES, SolverWork, predict_cost
from indent_sim.scene.measured_constants import STICK_FRICTION
from indent_sim.scene.mesh_counts import candidate_count
from indent_sim.scene.no_slip_effect import NoSlipEffect, tensile_rim_width
from indent_sim.scene.scene import Scene


def solve_no_slip_effect(run: CoarserRun, follow: Callable[[Scene], States]) -> NoSlipEffect | None:
    """Return the change of the largest force if the contact has no slip, on the same mesh.

    The change is relative to the contact without friction. The slip reference `mid` gives the
    value; the results of all slip references give the bounds.

    Parameters
    ----------
    run
        The run, or its coarser run.
    follow
        Function that solves a scene and returns its states.

    Returns
    -------
    NoSlipEffect or None
        None if the effect is not defined (friction or adhesion in the scene, no contact, a body
        that is held only by pins) or if one of the runs fails.
    """
    deepest = max((state.delta for state in run.states_by_step.values()), default=0.0)
    if run.scene is None:
        return None
    solved = map(follow, no_slip_scenes(run.scene, deepest / run.scene.physics.scales.depth))
    forces = [states[-1].force if states and states[-1].converged else nan for states in solved]
    if not forces or not forces[0] > 0 or any(map(isnan, forces)):
        return None
    changes = [100 * (force / forces[0] - 1) for force in forces[1:]]
    return NoSlipEffect(changes[0], min(changes), max(changes), "solved for this run")


def no_slip_scenes(scene: Scene, depth: float) -> list[Scene]:
    """Return the scenes for the no-slip effect at a depth.

    The first scene is frictionless; in the other scenes the contact sticks, each with another slip
    reference. The list is empty if the effect is not defined.
    """
    frictionless = _frictionless_scene(scene) if depth > 0 else None
    if frictionless is None:
        return []
    frictional = _sticking_scene(frictionless)
    steps = STICK_STEPS[scene.physics.domain.dim]
    slip_references: tuple[SlipReference, ...] = ("mid", "implicit", "glue")
    return [
        _scene_to_depth(frictionless, depth, 1),
        *(_scene_to_depth(frictional, depth, steps, reference) for reference in slip_references),
    ]


def no_slip_base_run(run: CoarserRun, coarser_run: CoarserRun | None) -> CoarserRun:
    """Return the run that gives the mesh of the no-slip effect: in 3D the coarser run."""
    is_three_dimensional = run.scene is not None and run.scene.physics.domain.dim == 3
    return coarser_run if coarser_run is not None and is_three_dimensional else run


def _frictionless_scene(scene: Scene) -> Scene | None:
    """Return the scene without friction, but with a contact law that allows friction.

    The result is None for a path-dependent contact, for a soft tip, for a body that is held only by
    pins, or if an iteratively solved scene exceeds the memory with a direct solver.
    """
    physics = scene.physics
    if physics.is_path_dependent or physics.indenter.elastic_part or physics.domain.pins:
        return None
    if scene.solver.linear == "iterative":
        direct_scene = _direct_solver_scene(scene)
        return _frictionless_scene(direct_scene) if direct_scene else None
    law = physics.contact
    if not isinstance(law, AugmentedLagrangian):
        law = AugmentedLagrangian(epsilon_n=physics.material.E_star / scene.sizes.typical_size)
    return scene.replace_physics(contact=law)


def _direct_solver_scene(scene: Scene) -> Scene | None:
    """Return the scene with a direct solver; None if it exceeds the memory of the machine."""
    physics = scene.physics
    domain = scene.physics.domain
    is_linear = physics.small_strain and physics.gap == "reference"
    is_small = candidate_count(scene.sizes, domain) * domain.dim <= MAX_CANDIDATES
    method: Literal["condensed", "newton"] = "condensed" if is_linear and is_small else "newton"
    has_mixed_elements = any(region.formulation == "mixed" for region in domain.regions)
    work = SolverWork(
        method,
        "direct",
        has_mixed_elements,
        STICK_STEPS[domain.dim],
        is_nonlinear=True,
        has_friction=True,
    )
    if predict_cost(scene.sizes, domain, work).memory > machine_memory():
        return None
    return replace(scene, solver=replace(scene.solver, method=method, linear="direct"))


def _sticking_scene(scene: Scene) -> Scene:
    """Return a frictionless scene with complete stick added.

    The body is not condensed if its surface compliance with tangential components is too large.
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
    """Return the scene loaded to a depth in equal steps."""
    depths = tuple(float(value) for value in np.linspace(0.0, depth, steps + 1)[1:])
    return scene.replace_physics(
        path=LoadPath("depth", depths), deltas=depths, slip_reference=slip_reference
    )
