"""Expected contact of bodies that yield, against their runs."""

from __future__ import annotations

from typing import Any

import pytest
from scenes import scene

from indent_sim.run import pipeline
from indent_sim.scene.scene import Scene

CONE = {"shape": "cone", "half_angle": 70.3}
SPHERE = {"shape": "sphere", "R": 1.0}


def metal(E: float, tip: dict[str, Any], loading: dict[str, Any], **plasticity: Any) -> Scene:
    """Half-space with sigma_y = 1 under a tip."""
    return scene(
        {"shape": "half_space"},
        material={
            "model": "hencky",
            "E": E,
            "nu": 0.3,
            "plasticity": {"yield_stress": 1.0} | plasticity,
        },
        indenter=tip,
        loading=loading,
        mesh={},
    )


@pytest.mark.parametrize(
    ("E", "tip", "depth", "n"),
    [
        (100.0, CONE, 1.0, 0.0),
        pytest.param(33.0, CONE, 1.0, 0.0, marks=pytest.mark.verify),
        pytest.param(700.0, CONE, 1.0, 0.0, marks=pytest.mark.verify),
        pytest.param(100.0, CONE, 1.0, 0.3, marks=pytest.mark.verify),
        pytest.param(100.0, CONE, 1.0, 0.5, marks=pytest.mark.verify),
        pytest.param(1000.0, SPHERE, 5e-4, 0.0, marks=pytest.mark.verify),
        pytest.param(1000.0, SPHERE, 0.05, 0.0, marks=pytest.mark.verify),
    ],
)
def test_expected_contact(E: float, tip: dict[str, Any], depth: float, n: float) -> None:
    """Contact radius within 10 %, force within 20 %: ten increments make it 6 % too low.

    The predicted number of solutions is within a factor of two.
    """
    base = metal(E, tip, {"delta": depth, "steps": 10}, n=n)
    rows = list(pipeline.states(base))
    assert rows[-1].a == pytest.approx(base.plan.prediction["a"], rel=0.10)
    assert rows[-1].force == pytest.approx(base.plan.prediction["force"], rel=0.20)
    solves = base.physics.solver_work("newton", "direct").linear_solves
    assert 0.5 * solves < sum(row.newton_iterations for row in rows) < 2 * solves


def test_expected_depth_of_a_force() -> None:
    """The depth of the force that is expected at the depth 1; without yield it is 0.59."""
    deep = metal(100.0, CONE, {"delta": 1.0, "steps": 10})
    force = deep.plan.prediction["force"]
    forced = metal(100.0, CONE, {"force": force, "steps": 10})
    assert forced.plan.prediction["delta"] == pytest.approx(1.0, rel=1e-6)
    assert forced.plan.prediction["a"] == pytest.approx(deep.plan.prediction["a"], rel=1e-6)


@pytest.mark.parametrize(("tip", "depth"), [(CONE, 0.0), (SPHERE, 6.41799 / (1e3 / 0.91) ** 2)])
def test_plan_tells_the_onset(tip: dict[str, Any], depth: float) -> None:
    """At once under a sharp tip, and at delta_y = 6.418 R (sigma_y/E*)^2 under a sphere."""
    base = metal(1000.0, tip, {"delta": 1e-3, "steps": 10})
    assert base.plan.prediction["onset_delta"] == pytest.approx(depth, rel=1e-5)
    strain = next(choice for choice in base.plan.choices if choice.key == "strain")
    assert ("from the first contact on" if depth == 0 else f"{depth:.4g}") in strain.why
