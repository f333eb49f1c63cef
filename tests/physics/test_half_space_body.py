"""`body.shape: half_space` against Hertz and Sneddon, and its truncation error."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from scenes import force, scene

from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import Scene

HALF_SPACE = {"shape": "half_space"}
SMALL = 2.0**-13  # a power of two costs no digit
TIPS: dict[str, tuple[dict[str, Any], float, float]] = {  # tip, depth, what the force may be off by
    "paraboloid": ({"shape": "paraboloid", "R": 1.0}, 0.01, 1e-3),
    "sphere": ({"shape": "sphere", "R": 1.0}, 0.1, 1e-3),
    "cone": ({"shape": "cone", "half_angle": 70}, 0.1, 1e-3),
    "flat_punch": ({"shape": "flat_punch", "radius": 0.5}, 0.01, 5e-3),
}


def over(tip: dict[str, Any], delta: float, nu: float = 0.3, **sections: Any) -> Scene:
    """A tip on a half-space, represented by a finite body."""
    material = {"model": "linear_elastic", "E": 2.0, "nu": nu}
    return scene(
        HALF_SPACE,
        "solver.method=condensed",
        indenter=tip,
        material=material,
        loading={"delta": delta, "steps": 1},
        **sections,
    )


@pytest.mark.parametrize(("tip", "delta", "tolerance"), TIPS.values(), ids=TIPS)
def test_closed_forms(tip: dict[str, Any], delta: float, tolerance: float) -> None:
    base = over(tip, delta)
    assert force(base) == pytest.approx(base.plan.prediction["force_half_space"], rel=tolerance)


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.45, 0.5])
def test_any_compressibility(nu: float) -> None:
    base = over(*TIPS["paraboloid"][:2], nu=nu)
    assert force(base) == pytest.approx(base.plan.prediction["force_half_space"], rel=1e-3)


@pytest.mark.parametrize(
    "nu", [-0.9, -0.4, 0.0, 0.3, 0.44, pytest.param(0.5, marks=pytest.mark.verify)]
)
def test_stated_error_covers_the_true_one(nu: float) -> None:
    """The stated truncation error covers the true one, on a mesh whose own error is a few 1e-5."""
    base = over(*TIPS["paraboloid"][:2], nu=nu)
    sizes = dataclasses.replace(
        base.sizes, h_contact=base.sizes.h_contact / 2, grading=base.sizes.grading / 2
    )
    true = (
        force(dataclasses.replace(base, sizes=sizes)) / base.plan.prediction["force_half_space"] - 1
    )
    stated = base.plan.prediction["truncation_error"]
    assert 0.3 * stated < true < stated < 1e-3
    assert any(c.key == "body" and f"{100 * stated:.2g} %" in c.why for c in base.plan.choices)


def test_its_theory_is_the_half_space() -> None:
    """The reference theory of the half-space gives Hertz's force and contact radius to 1e-6.

    Theory represents the half-space by a layer that is 1e7 bodies deep.
    """
    base = over(*TIPS["paraboloid"][:2])
    solution = (
        base.plan.theory.solution_at_depth(base.physics.deltas[-1]) if base.plan.theory else None
    )
    assert solution and base.plan.theory and base.plan.theory.name == "half-space theory"
    force_scale, expected = base.physics.scales.force, base.plan.prediction["force_half_space"]
    assert solution.force * force_scale == pytest.approx(expected, rel=1e-6)
    assert solution.a * base.physics.scales.length == pytest.approx(0.1, rel=1e-6)
    assert not base.plan.warnings


@pytest.mark.parametrize("scale", [1e-9, 1e3])
def test_any_unit_of_length(scale: float) -> None:
    """The force is the same in any unit of length, to the twelve digits of the sizes."""
    forces = [force(over({"shape": "sphere", "R": R}, 0.01 * R)) / R**2 for R in (1.0, scale)]
    assert forces[0] == pytest.approx(forces[1], rel=1e-8)


def test_no_depth_at_all() -> None:
    """Out of contact there is a body, and no force."""
    base = scene(HALF_SPACE, "solver.method=condensed", loading={"deltas": [-0.01]})
    assert force(base) == 0


def test_a_tip_in_contact_to_its_end() -> None:
    """A profile in contact to its end takes that end as contact radius."""
    base = over({"shape": "profile", "points": [[0, 0], [0.1, 0.01]]}, 0.05)
    assert base.physics.body.height * base.physics.scales.length > 100 * 0.1
    assert any("reaches the end of the tip's profile" in warning for warning in base.plan.warnings)


def test_three_dimensions_on_request() -> None:
    assert (
        over(*TIPS["paraboloid"][:2], mesh={"symmetry": "quarter"}).physics.domain.symmetry
        == "quarter"
    )


def test_a_place_on_it_is_refused() -> None:
    with pytest.raises(ConfigError, match="are equivalent"):
        over({"shape": "paraboloid", "R": 1.0, "center": [0.1, 0.0]}, 0.01)


@pytest.mark.parametrize("loading", [{"delta": 100.0, "steps": 1}, {"force": 1e5, "steps": 1}])
def test_a_contact_of_many_units_of_length(loading: dict[str, float]) -> None:
    """A contact radius above 100 units, as in nanometres, gives the same body."""
    found, small = (
        scene(
            {"shape": "half_space"},
            "solver.method=condensed",
            indenter={"shape": "paraboloid", "R": 1e4 * unit},
            loading=given,
        )
        for unit, given in ((1.0, loading), (SMALL, scaled_down(loading)))
    )
    assert found.sizes == small.sizes
    assert found.physics.scales.length * SMALL == small.physics.scales.length


def scaled_down(loading: dict[str, float]) -> dict[str, float]:
    """The same path in a larger unit of length; forces scale with its square."""
    by = {"delta": SMALL, "force": SMALL**2}
    return {key: value * by.get(key, 1) for key, value in loading.items()}
