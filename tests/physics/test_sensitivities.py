"""Derivatives of the force with respect to keys of a scene.

References are theory, scaling laws and differences of accurate runs.
"""

from __future__ import annotations

import copy
from typing import Any

import pytest

import indent_sim
from indent_sim.process.errors import ConfigError

LAYER = {
    "body": {"shape": "cylinder", "radius": 20, "height": 10, "base": "fixed", "sides": "roller"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "sphere", "R": 5.0},
    "loading": {"deltas": [0.25, 0.5]},
    "solver": {"method": "condensed"},
}
RUBBER = {
    "body": {"shape": "cylinder", "radius": 2, "height": 1, "base": "fixed", "sides": "roller"},
    "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "sphere", "R": 1.0},
    "loading": {"delta": 0.3, "steps": 3},
}


def changed(scene: dict[str, Any], key: str, factor: float, **more: Any) -> Any:
    """The scene with a key multiplied by a factor, resolved."""
    found = copy.deepcopy(scene) | more
    section, name = key.split(".")
    found[section][name] *= factor
    return indent_sim.resolve(indent_sim.load(found))


def by_theory(key: str, row: int) -> float:
    """The derivative of exact layer theory, by differences of forces with eight digits."""

    def force(factor: float) -> float:
        scene = changed(LAYER, key, factor)
        return (
            scene.plan.theory.solution_at_depth(scene.physics.deltas[row]).force
            * scene.physics.scales.force
        )

    section, name = key.split(".")
    slopes = [(force(1 + h) - force(1 - h)) / (2 * h * LAYER[section][name]) for h in (0.01, 0.02)]
    return (4 * slopes[0] - slopes[1]) / 3


@pytest.fixture(scope="module")
def of_layer() -> dict[str, dict[str, list[float]]]:
    return indent_sim.sensitivities(
        LAYER, ["material.E", "material.nu", "body.height", "indenter.R"]
    )


@pytest.mark.parametrize("key", ["material.E", "material.nu", "body.height", "indenter.R"])
@pytest.mark.parametrize("row", [0, 1])
def test_of_a_layer_against_theory(key: str, row: int, of_layer: Any) -> None:
    """Sensitivities of a layer are those of exact theory to 1e-3 and within their stated error.

    1e-3 is twice the error measured at these automatic sizes.
    """
    value, error = (of_layer[key][name][row] for name in ("value", "error"))
    assert value == pytest.approx(by_theory(key, row), rel=1e-3)
    assert abs(value - by_theory(key, row)) <= error


def test_of_what_theory_solves_has_no_mesh_error() -> None:
    """On a half-space the derivatives are those of F = 4/3 E/(1 - nu^2) sqrt(R) delta^1.5.

    Theory and differences of fourth order leave 1e-6, and the stated error is small.
    """
    scene = LAYER | {
        "body": {"shape": "half_space"},
        "indenter": {"shape": "paraboloid", "R": 5.0},
        "solver": {},
    }
    found = indent_sim.sensitivities(scene, ["indenter.R", "material.nu"])
    force = 4 / 3 / 0.91 * 5**0.5 * 0.5**1.5
    assert found["indenter.R"]["value"][1] == pytest.approx(force / 10, rel=1e-6)
    assert found["material.nu"]["value"][1] == pytest.approx(force * 0.6 / 0.91, rel=1e-6)
    assert found["indenter.R"]["error"][1] < 1e-4 * force


def test_of_an_incompressible_body_goes_backward() -> None:
    """At nu = 0.5 the derivative by one-sided differences is Hertz' dF/dnu = F 2 nu/(1 - nu^2).

    There is no scene beyond nu = 0.5. One-sided differences are good to 1e-3.
    """
    matter = {"material": {"model": "linear_elastic", "E": 1.0, "nu": 0.5}, "solver": {}}
    scene = (
        LAYER
        | {"body": {"shape": "half_space"}, "indenter": {"shape": "paraboloid", "R": 5.0}}
        | matter
    )
    force = 4 / 3 / 0.75 * 5**0.5 * 0.5**1.5
    found = indent_sim.sensitivities(scene, "material.nu")
    assert found["material.nu"]["value"][1] == pytest.approx(force / 0.75, rel=1e-3)


def test_at_finite_strain_dimensions_bind_the_derivatives() -> None:
    """At finite strain E dF/dE = F, as F is E length^2 times a function of ratios of lengths.

    The contact law's epsilon_n stays as it is, which changes the derivative by 5e-6.
    """
    found = indent_sim.sensitivities(RUBBER, "material.E")["material.E"]["value"]
    *_, last = indent_sim.states(indent_sim.resolve(indent_sim.load(RUBBER)))
    assert found[-1] == pytest.approx(last.force, rel=1e-4)


@pytest.mark.verify
@pytest.mark.parametrize("key", ["material.nu", "indenter.R", "body.height"])
def test_at_finite_strain_against_accurate_runs(key: str) -> None:
    """At finite strain derivatives are those of differences of accurate runs to 5e-3.

    Runs accurate to 2e-4 whose keys are 12 % apart leave 2e-3 of these derivatives.
    """

    def force(factor: float) -> float:
        *_, last = indent_sim.states(changed(RUBBER, key, factor, accuracy=2e-4))
        return last.force

    section, name = key.split(".")
    slopes = [(force(1 + h) - force(1 - h)) / (2 * h * RUBBER[section][name]) for h in (0.06, 0.12)]
    value = indent_sim.sensitivities(RUBBER, key)[key]["value"][-1]
    assert value == pytest.approx((4 * slopes[0] - slopes[1]) / 3, rel=5e-3)


@pytest.mark.parametrize(
    ("scene", "key", "message"),
    [
        (LAYER, "material.G", "material.G: is not a nonzero number of this scene"),
        (LAYER, "body.shape", "body.shape: is not a nonzero number of this scene"),
        (
            LAYER | {"loading": {"force": 1.0, "steps": 1}},
            "material.E",
            "loading: derivatives of the force",
        ),
    ],
)
def test_what_has_no_derivative_is_refused(scene: dict[str, Any], key: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        indent_sim.sensitivities(scene, key)
