"""Load control: a path of forces is the inverse of a path of depths, and theory's, whatever finds it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from indent_sim.scene import Scene
from indent_sim.state import State
from tests.scenes import BOX, CYLINDER, STRIP, scene, solve

COARSE = {"mesh": {"h_contact": 0.04}}
UP_AND_DOWN = [0.004, 0.012, 0.02, 0.007, 0.012, 0.02]
NEO_HOOKEAN = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
SCENES: dict[str, dict[str, Any]] = {
    **{f"condensed {name}": COARSE | {"body": CYLINDER, "contact": {"method": name}}
       for name in ("augmented_lagrangian", "penalty", "uzawa", "active_set")},
    **{f"newton {name}": COARSE | {"body": CYLINDER, "contact": {"method": name}, "solver": {"method": "newton"}}
       for name in ("augmented_lagrangian", "penalty", "uzawa", "active_set", "nitsche")},
    **{f"hyperelastic {name}": COARSE | {"body": CYLINDER, "material": NEO_HOOKEAN, "contact": {"method": name}}
       for name in ("augmented_lagrangian", "penalty", "uzawa", "active_set", "nitsche")},
    "plane strain": COARSE | {"body": STRIP},
    "quarter": {"body": BOX, "mesh": {"h_contact": 0.15}},
}  # fmt: skip


def column(states: list[State], name: str) -> np.ndarray:
    return np.array([getattr(state, name) for state in states])


def to_forces(base: Scene, forces: Any, expected: Any = None) -> list[State]:
    """The same scene on the same mesh, its depths found for forces in the user's units."""
    forces = tuple(float(force) / base.scales.force for force in forces)
    expected = base.deltas if expected is None else tuple(expected)
    return solve(dataclasses.replace(base, forces=forces, deltas=expected))


@pytest.mark.parametrize("name", SCENES)
def test_forces_lead_back_to_the_depths(name: str) -> None:
    """What a path of depths pushes back with, asked for as forces, gives the depths again: force and derivative are
    one curve, so 1e-10 of the force is about that of the depth; Uzawa's loop stops within 1e-7 of its own limit."""
    given = SCENES[name]
    base = scene(**given | {"loading": {"deltas": UP_AND_DOWN}})
    by_depth = solve(base)
    forces = column(by_depth, "force")
    by_force = to_forces(base, forces, expected=[1.3 * delta for delta in UP_AND_DOWN])
    np.testing.assert_allclose(column(by_force, "force"), forces, rtol=1e-10)
    np.testing.assert_allclose(column(by_force, "delta"), UP_AND_DOWN, rtol=1e-7 if "uzawa" in name else 1e-8)
    print(
        name,
        column(by_depth, "newton_iterations"),
        column(by_force, "newton_iterations"),
        np.abs(column(by_force, "delta") / UP_AND_DOWN - 1).max(),
    )
