"""Alternating pressures are warned of: random scenes with friction, and bodies that yield."""

from __future__ import annotations

import numpy as np
import pytest
from rubber_with_friction import drawn, judged
from scenes import scene

from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.run.measured_constants import MAX_ROUGHNESS
from indent_sim.run.row_warnings import oscillating_pressure_warnings
from indent_sim.scene.scene import Scene


@pytest.mark.verify
@pytest.mark.parametrize("number", range(5))
def test_rough_pressures_are_warned_of(number: int) -> None:
    """Pressures that alternate from node to node do not pass without a warning.

    The measure here knows nothing of the facets on which the run's own measure is defined.
    """
    found = judged(drawn(1, number))
    assert found.warnings or found.alternation <= MAX_ROUGHNESS


def metal_rows(formulation: str) -> tuple[Scene, list[State]]:
    """Rows of a perfectly plastic half-space under a cone."""
    plasticity = {"yield_stress": 1.0}
    material = {"model": "hencky", "E": 100.0, "nu": 0.3, "plasticity": plasticity}
    base = scene(
        {"shape": "half_space"},
        material=material | {"formulation": formulation},
        indenter={"shape": "cone", "half_angle": 70.3},
        loading={"delta": 0.9, "steps": 9},
        mesh={"h_contact": 0.25},
    )
    return base, list(pipeline.states(base))


def saw_tooth(state: State) -> float:
    """Mean amplitude of what alternates from node to node in the middle of the contact [-].

    It is a quarter of the second difference, over the mean pressure.
    """
    assert state.surface is not None
    order = np.argsort(state.surface.x)
    pressure = state.surface.pressure[order]
    is_middle = np.abs(state.surface.x[order] / state.a - 0.5) < 0.2
    middle = pressure[is_middle]
    second = middle[2:] - 2 * middle[1:-1] + middle[:-2]
    return float(np.abs(second).mean() / 4 / middle.mean())


def test_rough_pressures_of_plastic_flow_are_warned_of() -> None:
    """Under a sharp cone, too; the warning names the remedy.

    Plastic flow does not change the volume, which locks displacement elements.
    """
    base, rows = metal_rows("auto")
    assert saw_tooth(rows[-1]) > MAX_ROUGHNESS
    (warning,) = oscillating_pressure_warnings(base, rows)
    assert "`formulation: mixed`" in warning


@pytest.mark.verify
def test_mixed_elements_smooth_plastic_flow() -> None:
    """Means of the last four rows: a quarter of the saw-tooth, and 0.37 of the roughness.

    Single rows scatter, with the place of the contact's edge on its element: half is required.
    """
    locked, smooth = (metal_rows(name)[1][-4:] for name in ("displacement", "mixed"))
    assert sum(map(saw_tooth, smooth)) < sum(map(saw_tooth, locked)) / 2
    assert sum(row.roughness for row in smooth) < sum(row.roughness for row in locked) / 2
