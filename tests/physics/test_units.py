"""Units are the user's affair: a scene in other units has the same numbers and iterations.

Every method and both solvers are tried.
"""

from __future__ import annotations

from typing import Any

import pytest
from scenes import ELASTIC, PARABOLOID, WALLED, force, scene, solve

from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

SAME = 1e-9  # the same equations but for round-off, which their solution amplifies by less than 1e5
METHODS = ("penalty", "augmented_lagrangian", "uzawa", "active_set", "nitsche")
PROBLEMS: dict[str, dict[str, Any]] = {
    "condensed": {"material": ELASTIC, "solver": {"method": "condensed"}},
    "newton": {"material": ELASTIC, "solver": {"method": "newton"}},
    "neo-Hookean": {"material": ELASTIC | {"model": "neo_hookean"}},
}
UNITS = {"nm, nN": (1e9, 1e-9), "um, Pa": (1e6, 1.0), "km, TPa": (1e-3, 1e-12)}  # of 1 m and 1 Pa
LENGTHS = ("radius", "height", "R", "delta", "h_contact", "h_far")


def pressed(problem: str, method: str, length: float = 1.0, pressure: float = 1.0) -> Scene:
    """A paraboloid of 1 m on a layer of 1 m and 5 Pa, in units of any size.

    A metre is `length` of the units and a pascal `pressure` of them.
    """

    def lengths(section: dict[str, Any]) -> dict[str, Any]:
        return {key: value * length if key in LENGTHS else value for key, value in section.items()}

    sections = PROBLEMS[problem]
    return scene(
        lengths(WALLED),
        **sections | {"material": sections["material"] | {"E": 5.0 * pressure}},
        indenter=lengths(PARABOLOID),
        contact={"method": method},
        loading=lengths({"delta": 0.06, "steps": 2}),
        mesh=lengths({"h_contact": 0.08, "h_far": 0.5}),
    )


def numbers(state: State) -> list[float]:
    return [getattr(state, name) for name in ("delta", "force", "a", "p_max", "energy", "reaction")]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_same_digits_and_iterations(problem: str, method: str) -> None:
    """States and iterations are the same in all units.

    What is left of a multiplier's penetration is round-off of the depth, so it is compared with
    that.
    """
    if (problem, method) == ("condensed", "nitsche"):
        pytest.skip("Nitsche's method needs the stress inside the body")
    base = pressed(problem, method)
    expected = solve(base)
    for length, pressure in UNITS.values():
        other = pressed(problem, method, length, pressure)
        assert other.sizes == base.sizes
        for here, there in zip(expected, solve(other), strict=True):
            back = there.to_user_units(type(base.physics.scales)(1 / length, 1 / pressure))
            assert there.newton_iterations == here.newton_iterations
            assert numbers(back) == pytest.approx(numbers(here), rel=SAME)
            assert back.penetration == pytest.approx(
                here.penetration, rel=SAME, abs=SAME * here.delta
            )


def test_given_sizes_of_inclusions_are_lengths() -> None:
    """Element sizes given for inclusions scale with the unit of length."""

    def sizes(length: float) -> Any:
        inclusion = {
            "shape": "ball",
            "center": [0.0, 0.0, -0.35 * length],
            "radius": 0.2 * length,
            "material": ELASTIC,
        }
        body = WALLED | {"radius": 2.0 * length, "height": length, "inclusions": [inclusion]}
        tip, path = {"shape": "paraboloid", "R": length}, {"delta": 0.05 * length, "steps": 1}
        mesh = {"h_contact": 0.1 * length, "h_inclusions": [0.05 * length]}
        return scene(body, indenter=tip, loading=path, mesh=mesh).sizes

    ((_, size),) = sizes(1.0).inclusions
    assert size == pytest.approx(0.05, rel=1e-12)
    assert sizes(1e3) == sizes(1.0)


def test_a_half_space_of_the_same_digits() -> None:
    """A meshed half-space has the same digits in feet and pounds as in SI units.

    Its finite body is a number of contact radii large.
    """
    foot, psi = 1 / 0.3048, 1 / 6894.757

    def force_in(length: float, pressure: float) -> float:
        tip, path = {"shape": "paraboloid", "R": 0.8 * length}, {"delta": 0.02 * length, "steps": 1}
        material = ELASTIC | {"E": 3.0 * pressure}
        body, meshed = {"shape": "half_space"}, "solver.method=condensed"
        return force(scene(body, meshed, material=material, indenter=tip, loading=path))

    assert force_in(foot, psi) / (psi * foot**2) == pytest.approx(force_in(1.0, 1.0), rel=SAME)


def test_a_force_of_the_same_iterations() -> None:
    """Under prescribed forces the number of iterations is the same in all units.

    `auto` is E*/h_contact up to a rounding, which must not cost an iteration.
    """

    def spent(length: float, pressure: float) -> list[int]:
        body = WALLED | {"radius": 2.3 * length, "height": 1.1 * length}
        tip, path = (
            {"shape": "paraboloid", "R": 0.8 * length},
            {"force": 0.01 * pressure * length**2, "steps": 3},
        )
        states = solve(
            scene(body, material=ELASTIC | {"E": 3.0 * pressure}, indenter=tip, loading=path)
        )
        return [state.newton_iterations for state in states]

    assert spent(1.0, 1.0) == spent(3.0, 7.0) == spent(1e25, 1e-25) == spent(1e9, 1e-9)
