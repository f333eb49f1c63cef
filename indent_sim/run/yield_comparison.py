"""Comparison of a body that yields with theory: onset, published curvature and stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

from indent_sim.model.state import State
from indent_sim.scene.scene import Scene
from indent_sim.theory.yielding import DAO_ERROR

PUBLISHED_NAME = "Dao et al. (2001)"


def has_yielded(states: Sequence[State]) -> bool:
    """True if plastic flow has dissipated energy in a row."""
    return any(state.plastic_dissipation for state in states)


def published_comparison(scene: Scene, states: Sequence[State]) -> dict[str, Any] | None:
    """Compare a cone in a body that has yielded with the functions of Dao et al. (2001).

    Returns
    -------
    dict or None
        The entry `theory` of run.json: force or depth, unloading stiffness, and the deviations of
        the run from them; `error` is the relative error of the functions. None where these
        functions do not hold.
    """
    contact = scene.plan.yielding
    physics = scene.physics
    curvature = contact.published_curvature() if contact else None
    deepest = max(states, key=lambda state: state.delta)
    if contact is None or curvature is None or physics.has_friction or deepest.delta <= 0:
        return None
    D = physics.scales.depth
    F = physics.scales.force / physics.mirror_multiplicity
    is_forced = physics.path.control == "force"
    depth = sqrt(deepest.force / F / curvature) if is_forced else deepest.delta / D
    numbers = {"delta": depth * D, "force": curvature * depth**2 * F}
    name = "delta" if is_forced else "force"
    deviation = {f"{name}_deviation": getattr(deepest, name) / numbers[name] - 1}
    stiffness = contact.published_stiffness()
    if stiffness is not None and deepest.unloading_stiffness:
        value = stiffness * deepest.delta / D * F / D
        numbers["stiffness"] = value
        deviation["stiffness_deviation"] = deepest.unloading_stiffness / value - 1
    points = 20
    depths = [depth * k / points for k in range(1, points + 1)]
    curve = {
        "delta": [delta * D for delta in depths],
        "force": [curvature * delta**2 * F for delta in depths],
    }
    why = f"fits of finite-element runs, within {DAO_ERROR:.0%}"
    entries = {"name": PUBLISHED_NAME, "exact": False, "why": why, "error": DAO_ERROR}
    return entries | numbers | deviation | {"half_space": None, "formulas": [], "curve": curve}


def onset_entry(scene: Scene, states: Sequence[State]) -> dict[str, Any] | None:
    """Return the entry `onset_of_yield` of run.json; None if the onset is not known.

    It has depth, force and contact radius at the onset of yield, and whether the run has yielded.
    """
    onset = scene.plan.yielding.onset if scene.plan.yielding else None
    if onset is None or scene.physics.has_friction:
        return None
    scales = scene.physics.scales
    return {
        "delta": onset.delta * scales.depth,
        "force": onset.force * scales.force / scene.physics.mirror_multiplicity,
        "a": scene.physics.row_contact_radius(onset.a) * scales.length,
        "passed": has_yielded(states),
    }
