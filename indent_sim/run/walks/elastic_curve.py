"""Elastic curve of a scene at any depths, by its own solver, and the flat punches under its tip.

Depths, forces and lengths are in the user's units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indent_sim.model.state import State
from indent_sim.process.errors import NotConverged
from indent_sim.run.chain import condense, states
from indent_sim.run.companions.companion import Companion, beside, softer
from indent_sim.run.companions.error_bars import ErrorBars
from indent_sim.run.prospect import Prospect
from indent_sim.run.readings import hertz_forces, punches_of
from indent_sim.scene.scene import Scene
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.surface.punches import radius_at

DEEP = 0.5  # of the deepest: from there on the error bar of a curve counts
ADHERING_DEPTH = 1.6  # times the depth: an adhering tip has the contact of a deeper one
PUNCH_RADII = 40  # flat punches


@dataclass(frozen=True)
class ElasticForces:
    """Forces (n,) at depths, theory's beside them where it has them all, the contact radius at the
    deepest, and the relative half-width of the error bar of the deep ones.
    """

    forces: np.ndarray
    of_theory: np.ndarray | None
    radius: float
    error: float = 0.0


def forces_at(prospect: Prospect, depths: np.ndarray) -> ElasticForces:
    """The forces of an elastic scene at depths, increasing; those of the load path where neither
    theory solves it nor it condenses. NotConverged where one is not reached, UNSOLVED where
    theory has no solution.
    """
    scene = prospect.scene
    scales = prospect.scene.physics.scales
    asked = [float(depth / scales.depth) for depth in depths]
    theory = scene.plan.theory
    if not scene.is_meshed:
        assert theory is not None
        exact = theory.contact.curve(asked)
        return ElasticForces(
            np.array([one.force for one in exact]) * scales.force, None, exact[-1].a * scales.length
        )
    found = _solved(scene, depths)
    if len(found) < len(depths) or not found[-1].converged:
        raise NotConverged(
            next((state.reason for state in found if not state.converged), "the path ended")
        )
    curve = theory.curve(asked) if theory else None
    of_theory = np.array([one.force for one in curve]) * scales.force if curve else None
    forces = np.array([state.force for state in found])
    return ElasticForces(forces, of_theory, found[-1].a, _bar(scene, found, depths))


def _solved(scene: Scene, depths: np.ndarray) -> list[State]:
    if scene.solver.method == "condensed":
        return condense(scene).states(deltas=list(map(float, depths)))
    return list(states(scene, with_surface=False))


def _bar(scene: Scene, found: list[State], depths: np.ndarray) -> float:
    """The relative error bar of the deepest forces, from a coarser mesh."""
    ratio, other = beside(scene)
    soft = softer(other)
    bars = ErrorBars(
        scene,
        Companion(ratio, _solved(other, depths), other),
        _solved(soft, depths) if soft else None,
    )
    judged = [bars.judged(state) for state in found]  # each knows those before it
    deep = [
        state
        for state in judged
        if state.delta > DEEP * depths[-1] and np.isfinite(state.force_error or 0.0)
    ]
    return max(((state.force_error or 0.0) / state.force for state in deep), default=0.0)


def punches_to(
    prospect: Prospect, deepest: float, least: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Flat punches under the tip: radii (n,) over the widest, that of an adhering contact at a
    depth, from `least` on; depth, force, stiffness and its slope over the radius (4, n); the
    widest radius. UNSOLVED where there are none.
    """
    scene = prospect.scene
    scales = prospect.scene.physics.scales
    equilibrium = None
    if scene.is_meshed:
        equilibrium = condense(scene).equilibrium
        equilibrium.solve(deepest / scales.depth)
    punches = punches_of(scene, equilibrium)
    try:
        widest = radius_at(punches, ADHERING_DEPTH * deepest / scales.depth)
    except UNSOLVED:
        widest = 0.999 * punches.largest
    radii = np.geomspace(max(least * widest, punches.smallest), widest, PUNCH_RADII)
    rows = [punches.at(float(a)) for a in radii]
    units = (
        scales.depth,
        scales.force,
        scales.force / scales.depth,
        scales.force / scales.depth / scales.length,
    )
    columns = zip(*((one.delta, one.force, one.stiffness, one.slope) for one in rows), strict=True)
    values = [np.array(column) * unit for column, unit in zip(columns, units, strict=True)]
    return radii / widest, np.array(values), widest * scales.length


def half_space_modulus(prospect: Prospect, delta: np.ndarray, force: np.ndarray) -> float | None:
    """The modulus E that a least-squares fit of the half-space formula to a curve (n,) reads; None
    where there is no formula or no contact.
    """
    scene = prospect.scene
    scales = prospect.scene.physics.scales
    try:
        known = [force or 0.0 for force in hertz_forces(scene, map(float, delta / scales.depth))]
    except UNSOLVED:
        return None
    total = sum(one * one for one in known)
    if not total:
        return None
    return (
        float(np.dot(known, force))
        / total
        / scales.force
        * scene.physics.material.constants.E
        * scales.pressure
    )
