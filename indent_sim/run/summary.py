"""Summary of a run for run.json: theory beside it, its audit, its cost."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

import numpy as np

from indent_sim.model.state import State
from indent_sim.model.tips import Sphere
from indent_sim.process.usage import peak_memory
from indent_sim.run.readings import hertz_fit, hertz_force
from indent_sim.scene.scene import ROUGH, Scene
from indent_sim.scene.theories import Theory, half_space_depth, half_space_force, relative_tip
from indent_sim.theory.solution import Solution
from indent_sim.theory.surface.no_slip import FRICTIONLESS

PARABOLIC = "its friction is that of a paraboloid"
POINTS, OF_THEORY = 50, 20  # of the curves kept for the plot, a formula's and theory's


def summary(
    scene: Scene, states: list[State], wall: dict[str, float], cpu: dict[str, float], worst_audit: float | None
) -> dict[str, Any]:
    """The closing entries of run.json: theory, audit, timings (wall and CPU) [s] and peak memory [MB]."""
    return {
        "theory": theory_comparison(scene, states),
        **({"adhesion": adhesion(scene, states)} if scene.plan.adhesion else {}),
        "hertz": hertz_fit(scene, states),
        "audit": {
            "force_against_reaction": worst_audit,
            "energy_by_trapezoid": None if scene.physics.adheres else energy_balance(states),
            "newton_iterations": sum(state.newton_iterations for state in states),
            **_krylov(states),
            "substeps": sum(state.substeps for state in states),
        },
        "timings": stages(wall),
        "cpu_timings": stages(cpu),
        "peak_memory_MB": round(peak_memory(), 1),
    }


def _krylov(states: list[State]) -> dict[str, int]:
    """The iterations of an iterative linear solver, where there was one."""
    counts = [state.krylov_iterations for state in states if state.krylov_iterations is not None]
    return {"krylov_iterations": sum(counts)} if counts else {}


def stages(seconds: Mapping[str, float]) -> dict[str, float]:
    """Seconds of the stages of a run, as run.json has them."""
    return {name: round(value, 4) for name, value in seconds.items()}


def energy_balance(states: list[State]) -> float | None:
    """Relative difference between int F ddelta (trapezoid rule) and the energy with what friction took of it.

    Reported, not judged: on a coarse path the rule itself is wrong by far more than the solution. None where there is
    no energy; a tip that adheres loses some where it jumps, between two rows.
    """
    spent = (states[-1].energy if states else 0.0) + sum(state.dissipation or 0.0 for state in states)
    if len(states) < 2 or spent == 0 or spent != spent:
        return None
    delta = np.array([0.0, *(state.delta for state in states)])
    force = np.array([0.0, *(state.force for state in states)])
    work = float(np.sum(np.diff(delta) * (force[1:] + force[:-1]) / 2))
    return work / spent - 1


def theory_comparison(scene: Scene, states: list[State]) -> dict[str, Any] | None:
    """Small-strain theory beside the deepest state, and its curve over the depths walked; None without theory.

    Theory is asked for what the run found: for the force at its depth, or for the depth at the force prescribed, with
    the friction of the scene where that is known.
    `force_deviation` or `delta_deviation` = this run / theory - 1; `exact` when the finite body is the theory's own.
    Beside a tip that adheres it is that of one without range (JKR), with its stable branch.
    """
    if scene.physics.adheres:
        return _without_range(scene, states)
    pushed = [state for state in states if state.delta > 0]
    theory = scene.plan.theory
    if theory is None or not pushed:
        return None
    deepest = max(pushed, key=lambda state: state.delta)
    rough, unlike = scene.plan.friction or FRICTIONLESS, _unlike(scene)
    D, L = scene.physics.scales.depth, scene.physics.scales.length * rough.radius
    F = scene.physics.scales.force * rough.force
    solution = _theory_beside(scene, theory, deepest, F)
    if solution is None:
        return None
    found = {"force_deviation": deepest.force / (solution.force * F) - 1}
    if scene.physics.path.control == "force":
        found = {"delta_deviation": deepest.delta / (solution.delta * D) - 1}
    curve = theory.contact.up_to(solution, OF_THEORY) if scene.is_meshed else []  # else: the rows
    return {
        "name": _name(scene, theory),
        "exact": not unlike,
        "why": "; ".join(unlike) or theory.why,
        "delta": solution.delta * D,
        "force": solution.force * F,
        "a": solution.a * L,
        **found,
        "a_deviation": deepest.a / (solution.a * L) - 1,
        "half_space": _half_space(scene, deepest),
        "formulas": _formulas(scene, theory, deepest),
        "curve": {
            "delta": [s.delta * D for s in curve],
            "force": [s.force * F for s in curve],
            "a": [s.a * L for s in curve],
        },
    }


def _formulas(scene: Scene, theory: Theory, state: State) -> list[dict[str, Any]]:
    """What the usual formulas for films and thin layers say at the state's depth, or at its force, beside the run."""
    D, F = scene.physics.scales.depth, scene.physics.scales.force
    is_forced = scene.physics.path.control == "force"
    name, unit, force = ("delta", D, state.force / F) if is_forced else ("force", F, None)
    said = {formula: theory.formula_at(formula, state.delta / D, force) for formula in theory.formulas}
    return [
        {"name": formula, name: value * unit, "deviation": value * unit / getattr(state, name) - 1}
        for formula, value in said.items()
        if value is not None and getattr(state, name) != 0
    ]


def adhesion(scene: Scene, states: Sequence[State]) -> dict[str, Any]:
    """What was known of the attraction beforehand, and the row that is pulled most [user's units]."""
    pulled = min((state for state in states if state.force < 0), key=lambda state: state.force, default=None)
    found = {"step": pulled.step, "delta": pulled.delta, "force": pulled.force} if pulled else None
    assert scene.plan.adhesion
    return dataclasses.asdict(scene.plan.adhesion) | {"largest_pull": found}


def _without_range(scene: Scene, states: Sequence[State]) -> dict[str, Any] | None:
    """The JKR limit beside the deepest state, and its stable branch; None where it is not known or has come off."""
    jkr, scales, is_forced = scene.plan.jkr, scene.physics.scales, scene.physics.path.control == "force"
    deepest = max(states, key=lambda state: state.delta, default=None)
    if jkr is None or deepest is None:
        return None
    L, F, D = scales.length, scales.force, scales.depth
    asked = (deepest.force / F, inf) if is_forced else (deepest.delta / D, 0.0)
    try:
        beside, last = jkr.stable(*asked), jkr.pull_off()
        if beside is None:
            return None
        branch = jkr.branch(beside.delta)
        curve = [found for delta in np.linspace(last.delta, beside.delta, POINTS) if (found := branch(float(delta)))]
    except (ValueError, ArithmeticError):
        return None
    name, value, here = ("delta", beside.delta * D, deepest.delta) if is_forced else ("force", beside.force * F,
                                                                                     deepest.force)  # fmt: skip
    return {
        "name": "JKR",
        "exact": False,
        "why": "; ".join(scene.differences),
        "delta": beside.delta * D,
        "force": beside.force * F,
        "a": beside.a * L,
        **({f"{name}_deviation": here / value - 1} if value else {}),
        "a_deviation": deepest.a / (beside.a * L) - 1,
        "curve": {
            "delta": [found.delta * D for found in curve],
            "force": [found.force * F for found in curve],
            "a": [found.a * L for found in curve],
        },
    }


def _name(scene: Scene, theory: Theory) -> str:
    """Theory's name, with what it knows of the scene's friction."""
    if not scene.physics.has_friction:
        return theory.name
    return f"{theory.name} {'with' if scene.plan.friction else 'without'} friction"


def _unlike(scene: Scene) -> tuple[str, ...]:
    """What the problem has that theory, with friction where that is known, has not."""
    if scene.plan.friction is None:
        return scene.differences
    is_round = (PARABOLIC,) if isinstance(scene.physics.indenter, Sphere) else ()
    return (*(why for why in scene.differences if why != ROUGH), *is_round)


def _theory_beside(scene: Scene, theory: Theory, state: State, F: float) -> Solution | None:
    """Theory at the state's depth, or, where forces are prescribed, at its force; F: that of theory's 1."""
    delta, height = state.delta / scene.physics.scales.depth, scene.physics.body.height
    if scene.physics.path.control == "depth":
        return theory.at(delta)
    found = theory.depth(state.force / F, height)
    return theory.at(found) if found is not None and found < height else None


def _half_space(scene: Scene, state: State) -> dict[str, Any] | None:
    """The half-space formula's force at the state's depth, or depth at its force, and how that differs from the run."""
    if scene.physics.scales.dim == 2:
        return None
    D, F, E_star = scene.physics.scales.depth, scene.physics.scales.force, scene.physics.material.E_star
    tip = relative_tip(scene.physics.indenter, scene.physics.body)
    if scene.physics.path.control == "force":
        closed, name, unit = half_space_depth(tip, state.force / F, E_star), "delta", D
    else:
        closed, name, unit = half_space_force(tip, state.delta / D, E_star), "force", F
    if closed is None or getattr(state, name) == 0:
        return None
    value = closed[1] * unit
    depths = [state.delta / D * n / POINTS for n in range(1, POINTS + 1)]
    curve = [(delta, force) for delta in depths if (force := hertz_force(scene, delta))]
    return {
        "name": closed[0],
        name: value,
        "deviation": value / getattr(state, name) - 1,
        "curve": {"delta": [delta * D for delta, _ in curve], "force": [force * F for _, force in curve]},
    }
