"""Summary of a run for run.json: theory beside it, its audit, its cost."""

from __future__ import annotations

from typing import Any

import numpy as np

from indent_sim.model.state import State
from indent_sim.process.usage import peak_memory
from indent_sim.scene.scene import Scene
from indent_sim.scene.theories import Theory, half_space_depth, half_space_force
from indent_sim.theory.solution import Solution

POINTS = 50  # of the theory curve that is kept for the plot


def summary(
    scene: Scene, states: list[State], stages: dict[str, float], cpu: dict[str, float], worst_audit: float
) -> dict[str, Any]:
    """The closing entries of run.json: theory, audit, timings (wall and CPU) [s] and peak memory [MB]."""
    return {
        "theory": theory_comparison(scene, states),
        "audit": {
            "force_against_reaction": worst_audit,
            "energy_by_trapezoid": energy_balance(states),
            "newton_iterations": sum(state.newton_iterations for state in states),
            "substeps": sum(state.substeps for state in states),
        },
        "timings": {name: round(seconds, 4) for name, seconds in stages.items()},
        "cpu_timings": {name: round(seconds, 4) for name, seconds in cpu.items()},
        "peak_memory_MB": round(peak_memory(), 1),
    }


def energy_balance(states: list[State]) -> float | None:
    """Relative difference between int F ddelta (trapezoid rule) and the energy; reported, not judged: on a coarse
    path the rule itself is wrong by far more than the solution."""
    if len(states) < 2 or states[-1].energy == 0:
        return None
    delta = np.array([0.0, *(state.delta for state in states)])
    force = np.array([0.0, *(state.force for state in states)])
    work = float(np.sum(np.diff(delta) * (force[1:] + force[:-1]) / 2))
    return work / states[-1].energy - 1


def theory_comparison(scene: Scene, states: list[State]) -> dict[str, Any] | None:
    """Small-strain theory beside the deepest state, and its curve over the depths walked; None without theory.

    Theory is asked for what the run found: for the force at its depth, or for the depth at the force prescribed.
    `force_deviation` or `delta_deviation` = this run / theory - 1; `exact` when the finite body is the theory's own.
    """
    pushed = [state for state in states if state.delta > 0]
    theory = scene.plan.theory
    if theory is None or not pushed:
        return None
    deepest = max(pushed, key=lambda state: state.delta)
    L, F = scene.physics.scales.length, scene.physics.scales.force
    solution = _theory_beside(scene, theory, deepest)
    if solution is None:
        return None
    depths = [solution.delta * n / POINTS for n in range(1, POINTS + 1)]
    found = {"force_deviation": deepest.force / (solution.force * F) - 1}
    if scene.physics.path.control == "force":
        found = {"delta_deviation": deepest.delta / (solution.delta * L) - 1}
    curve = theory.curve(depths) or []
    return {
        "name": theory.name,
        "exact": not scene.differences,
        "why": "; ".join(scene.differences) or theory.why,
        "delta": solution.delta * L,
        "force": solution.force * F,
        "a": solution.a * L,
        **found,
        "a_deviation": deepest.a / (solution.a * L) - 1,
        "half_space": _half_space(scene, deepest),
        "curve": {
            "delta": [s.delta * L for s in curve],
            "force": [s.force * F for s in curve],
            "a": [s.a * L for s in curve],
        },
    }


def _theory_beside(scene: Scene, theory: Theory, state: State) -> Solution | None:
    """Theory at the state's depth, or, where forces are prescribed, at its force."""
    delta, height = state.delta / scene.physics.scales.length, scene.physics.body.height
    if scene.physics.path.control == "depth":
        return theory.at(delta)
    found = theory.depth(state.force / scene.physics.scales.force, height)
    return theory.at(found) if found is not None and found < height else None


def _half_space(scene: Scene, state: State) -> dict[str, Any] | None:
    """The half-space formula's force at the state's depth, or depth at its force, and how that differs from the run."""
    if scene.physics.scales.dim == 2:
        return None
    L, F, E_star = scene.physics.scales.length, scene.physics.scales.force, scene.physics.material.E_star
    if scene.physics.path.control == "force":
        closed, name, unit = half_space_depth(scene.physics.indenter, state.force / F, E_star), "delta", L
    else:
        closed, name, unit = half_space_force(scene.physics.indenter, state.delta / L, E_star), "force", F
    if closed is None or getattr(state, name) == 0:
        return None
    value = closed[1] * unit
    return {"name": closed[0], name: value, "deviation": value / getattr(state, name) - 1}
