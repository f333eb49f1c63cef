"""Elastic force curve of a scene at any depths, and flat punches on its body.

Depths, forces and lengths are in the user's units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.model.state import State
from indent_sim.model.tips import RegularPyramid
from indent_sim.model.unbounded_bodies import HalfSpace
from indent_sim.process.errors import NotConverged
from indent_sim.run.derived_quantities import hertz_forces, punches_of
from indent_sim.run.error_estimation.coarser_run import CoarserRun, coarser_scene, halve_penalty
from indent_sim.run.error_estimation.error_bars import ErrorBars
from indent_sim.run.pipeline import condense, states
from indent_sim.run.planned_run import PlannedRun
from indent_sim.scene.scene import Scene
from indent_sim.theory.measured_constants import PYRAMID_CONSTANT_ERROR
from indent_sim.theory.punches import contact_radius
from indent_sim.theory.solution import SOLUTION_ERRORS


@dataclass(frozen=True)
class ElasticForces:
    """Elastic force curve of a scene.

    Attributes
    ----------
    forces
        Forces at the depths, shape (n,).
    theory_forces
        Forces of theory, shape (n,); None if theory does not reach all depths.
    contact_radius
        Contact radius at the largest depth.
    error
        Largest relative error estimate of the rows at large depths.
    """

    forces: np.ndarray
    theory_forces: np.ndarray | None
    contact_radius: float
    error: float = 0.0


def elastic_forces(prospect: PlannedRun, depths: np.ndarray) -> ElasticForces:
    """Return the forces of an elastic scene at depths.

    Parameters
    ----------
    prospect
        The planned run of the scene.
    depths
        Increasing depths, shape (n,). If neither theory nor a condensed body solves the scene, they
        must be the depths of its load path.

    Raises
    ------
    NotConverged
        If a depth is not reached.
    SOLUTION_ERRORS
        If theory has no solution.
    """
    scene = prospect.scene
    scales = prospect.scene.physics.scales
    scaled_depths = [float(depth / scales.depth) for depth in depths]
    theory = scene.plan.theory
    if not scene.is_meshed:
        assert theory is not None
        solutions = theory.contact.solutions_at_depths(scaled_depths)
        return ElasticForces(
            np.array([solution.force for solution in solutions]) * scales.force,
            None,
            solutions[-1].a * scales.length,
        )
    states_found = _solve_depths(scene, depths)
    if len(states_found) < len(depths) or not states_found[-1].converged:
        raise NotConverged(
            next(
                (state.reason for state in states_found if not state.converged),
                "the load path ended early",
            )
        )
    curve = theory.solutions_at_depths(scaled_depths) if theory else None
    theory_forces = (
        np.array([solution.force for solution in curve]) * scales.force if curve else None
    )
    forces = np.array([state.force for state in states_found])
    return ElasticForces(
        forces, theory_forces, states_found[-1].a, _relative_error(scene, states_found, depths)
    )


def is_self_similar(config: Config) -> bool:
    """Return whether the force is a constant times the square of the depth.

    This is true for a sharp pyramid on a homogeneous half-space, because the depth is the only
    length in this problem.
    """
    body = config.body
    is_homogeneous = (
        isinstance(body, HalfSpace)
        and not (body.layers or body.inclusions)
        and not body.surface_tension
    )
    is_sharp = isinstance(config.indenter, RegularPyramid) and not config.indenter.tip_radius
    return is_homogeneous and is_sharp and not config.contact.path_key


def self_similar_force(prospect: PlannedRun, depth: float) -> ElasticForces:
    """Return the force of a self-similar scene at a depth, by the formula if there is one.

    Otherwise the force is solved on a mesh that is made for this depth. Raises NotConverged if the
    depth is not reached.
    """
    scene = prospect.scene
    scales = scene.physics.scales
    is_linear = getattr(prospect.config.material, "model", "") == "linear_elastic"
    [force] = hertz_forces(scene, [depth / scales.depth]) if is_linear else [None]
    if force is None or prospect.config.solver.method != "auto":
        return elastic_forces(prospect, np.array([depth]))
    contact_radius = scene.physics.indenter.radius_at(depth / scales.depth) * scales.length
    return ElasticForces(
        np.array([force * scales.force]), None, contact_radius, PYRAMID_CONSTANT_ERROR
    )


def _solve_depths(scene: Scene, depths: np.ndarray) -> list[State]:
    """Return the states at the given depths, from the condensed body or along the load path."""
    if scene.solver.method == "condensed":
        return condense(scene).states(deltas=list(map(float, depths)))
    return list(states(scene, with_surface=False))


def _relative_error(scene: Scene, states_found: list[State], depths: np.ndarray) -> float:
    """Return the relative error of the forces at large depths, from a coarser mesh."""
    ratio, coarse_scene = coarser_scene(scene)
    soft_scene = halve_penalty(coarse_scene)
    error_bars = ErrorBars(
        scene,
        CoarserRun(ratio, _solve_depths(coarse_scene, depths), coarse_scene),
        _solve_depths(soft_scene, depths) if soft_scene else None,
    )
    # The error of a row depends on the rows before it.
    estimated = [error_bars.add_error_estimate(state) for state in states_found]
    # The error bars of depths above this fraction of the largest one count.
    deep_fraction = 0.5
    deep_states = [
        state
        for state in estimated
        if state.delta > deep_fraction * depths[-1] and np.isfinite(state.force_error or 0.0)
    ]
    return max(((state.force_error or 0.0) / state.force for state in deep_states), default=0.0)


def flat_punches(
    prospect: PlannedRun, deepest: float, min_ratio: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return flat punches on the body, up to the radius of the adhesive contact at a depth.

    Parameters
    ----------
    prospect
        The planned run of the scene.
    deepest
        The depth.
    min_ratio
        Smallest radius relative to the largest one.

    Returns
    -------
    radii
        Radii relative to the largest one, shape (n,).
    values
        Depth, force, stiffness and its derivative with respect to the radius, shape (4, n).
    max_radius
        The largest radius.

    Raises
    ------
    SOLUTION_ERRORS
        If the contact of the tip does not follow from flat punches.
    """
    scene = prospect.scene
    scales = prospect.scene.physics.scales
    equilibrium = None
    if scene.is_meshed:
        equilibrium = condense(scene).equilibrium
        equilibrium.solve(deepest / scales.depth)
    punches = punches_of(scene, equilibrium)
    try:
        # An adhesive contact is as wide as one without adhesion at this multiple of its
        # depth.
        adhering_depth = 1.6
        widest = contact_radius(punches, adhering_depth * deepest / scales.depth)
    except SOLUTION_ERRORS:
        widest = 0.999 * punches.max_radius
    # Number of flat punches.
    punch_count = 40
    radii = np.geomspace(max(min_ratio * widest, punches.min_radius), widest, punch_count)
    rows = [punches.punch_of_radius(float(a)) for a in radii]
    units = (
        scales.depth,
        scales.force,
        scales.force / scales.depth,
        scales.force / scales.depth / scales.length,
    )
    columns = zip(
        *((punch.delta, punch.force, punch.stiffness, punch.stiffness_slope) for punch in rows),
        strict=True,
    )
    values = [np.array(column) * unit for column, unit in zip(columns, units, strict=True)]
    return radii / widest, np.array(values), widest * scales.length


def half_space_modulus(prospect: PlannedRun, delta: np.ndarray, force: np.ndarray) -> float | None:
    """Return the modulus of a least-squares fit of the half-space formula to a curve.

    The result is Young's modulus; None if there is no formula or no contact.

    Parameters
    ----------
    prospect
        The planned run of the scene.
    delta, force
        The curve, shape (n,).
    """
    scene = prospect.scene
    scales = prospect.scene.physics.scales
    try:
        unit_forces = [
            force or 0.0 for force in hertz_forces(scene, map(float, delta / scales.depth))
        ]
    except SOLUTION_ERRORS:
        return None
    total = sum(value * value for value in unit_forces)
    if not total:
        return None
    return (
        float(np.dot(unit_forces, force))
        / total
        / scales.force
        * scene.physics.material.constants.E
        * scales.pressure
    )
