"""A body so thick and wide that friction acts on it as on a half-space."""

from __future__ import annotations

from typing import Any

from scenes import PARABOLOID, scene, solve

from indent_sim.model.state import State

# 2000 contact radii thick and wide: what friction adds to the force is that of a half-space to a
# thousandth of itself
THICK = {"shape": "cylinder", "radius": 200.0, "height": 200.0, "base": "fixed", "sides": "roller"}
A = 0.1  # contact radius of the deepest frictionless contact


def rough(
    friction: float | str,
    nu: float,
    loading: dict[str, Any],
    tip: dict[str, Any] = PARABOLOID,
    **more: Any,
) -> list[State]:
    """States of a thick body under a tip, with thirty elements in its contact radius."""
    sections = {
        "material": {"model": "linear_elastic", "E": 1.0, "nu": nu},
        "mesh": {"h_contact": A / 30},
        "contact": {"method": "augmented_lagrangian", "friction": friction},
    } | more
    return solve(scene(THICK, indenter=tip, loading=loading, **sections))
