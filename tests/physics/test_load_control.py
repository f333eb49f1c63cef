"""Load control: a path of forces is the inverse of a path of depths, and agrees with theory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import BOX, CYLINDER, STRIP, WALLED, scene, solve

from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run import pipeline
from indent_sim.scene.scene import Scene

COARSE = {"mesh": {"h_contact": 0.04}}
UP_AND_DOWN = [0.004, 0.012, 0.02, 0.007, 0.012, 0.02]
NEO_HOOKEAN = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
SCENES: dict[str, dict[str, Any]] = {
    **{
        f"condensed {name}": COARSE | {"body": CYLINDER, "contact": {"method": name}}
        for name in ("augmented_lagrangian", "penalty", "uzawa", "active_set")
    },
    **{
        f"newton {name}": COARSE
        | {"body": CYLINDER, "contact": {"method": name}, "solver": {"method": "newton"}}
        for name in ("augmented_lagrangian", "penalty", "uzawa", "active_set", "nitsche")
    },
    **{
        f"hyperelastic {name}": COARSE
        | {"body": CYLINDER, "material": NEO_HOOKEAN, "contact": {"method": name}}
        for name in ("augmented_lagrangian", "penalty", "uzawa", "active_set", "nitsche")
    },
    "plane strain": COARSE | {"body": STRIP},
    "quarter": {"body": BOX, "mesh": {"h_contact": 0.15}},
}


def column(states: list[State], name: str) -> np.ndarray:
    return np.array([getattr(state, name) for state in states])


def to_forces(base: Scene, forces: Any, expected: Any = None) -> list[State]:
    """The scene on the same mesh with depths found for forces in the user's units."""
    forces = tuple(float(force) / base.physics.scales.force for force in forces)
    expected = base.physics.deltas if expected is None else tuple(expected)
    return solve(base.replace_physics(path=LoadPath("force", forces), deltas=expected))


# The search knows no method: one beside the augmented Lagrangian of each equilibrium; the others in
# `make verify`
USUAL = {
    *(name for name in SCENES if "augmented_lagrangian" in name or " " not in name),
    "condensed active_set",
    "newton nitsche",
    "hyperelastic active_set",
    "plane strain",
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in USUAL else [pytest.mark.verify]) for name in SCENES],
)
def test_forces_lead_back_to_the_depths(name: str) -> None:
    """The forces of a path of depths lead back to these depths.

    Force and derivative belong to one curve, so that 1e-10 of the force is about that of the depth;
    Uzawa's iteration stops within 1e-7 of its limit.
    """
    given = SCENES[name]
    base = scene(**given | {"loading": {"deltas": UP_AND_DOWN}})
    by_depth = solve(base)
    forces = column(by_depth, "force")
    by_force = to_forces(base, forces, expected=[1.3 * delta for delta in UP_AND_DOWN])
    np.testing.assert_allclose(column(by_force, "force"), forces, rtol=1e-10)
    np.testing.assert_allclose(
        column(by_force, "delta"), UP_AND_DOWN, rtol=1e-7 if "uzawa" in name else 1e-8
    )
    print(
        name,
        column(by_depth, "newton_iterations"),
        column(by_force, "newton_iterations"),
        np.abs(column(by_force, "delta") / UP_AND_DOWN - 1).max(),
    )


TIPS: dict[str, tuple[dict[str, Any], float]] = {
    "paraboloid": ({"shape": "paraboloid", "R": 1.0}, 2e-3),
    "sphere": ({"shape": "sphere", "R": 0.5}, 2e-3),
    "cone": ({"shape": "cone", "half_angle": 70}, 2e-3),
    "punch": ({"shape": "flat_punch", "radius": 0.1}, 2e-3),
}


@pytest.mark.parametrize("body", [WALLED, STRIP], ids=["layer", "strip"])
@pytest.mark.parametrize("tip", TIPS)
def test_depth_is_theorys(tip: str, body: dict[str, Any]) -> None:
    """The depth of a force on a layer between roller walls is exact theory's.

    `h_contact: auto` promises 0.3 % of the force, 1 % under a sharp edge; of the depth it is less.
    The sizes follow from the expected contact.
    """
    shape, force = TIPS[tip]
    base = scene(body, indenter=shape, loading={"force": force, "steps": 2})
    half, whole = solve(base)
    assert base.plan.theory and base.plan.theory.is_exact
    expected = base.plan.theory.solution_at_depth(
        whole.delta
    )  # E = height = 1: the scene's units are the user's
    assert expected and expected.force == pytest.approx(
        force, rel=0.01 if tip == "punch" else 0.003
    )
    assert [half.force, whole.force] == pytest.approx([force / 2, force], rel=1e-10)
    assert base.plan.prediction["delta"] == pytest.approx(
        whole.delta, rel=0.01 if tip == "punch" else 0.003
    )
    assert base.plan.prediction["a"] == pytest.approx(expected.a, rel=0.01)


@pytest.mark.parametrize("material", [None, NEO_HOOKEAN], ids=["linear", "hyperelastic"])
def test_up_and_down_is_one_curve(material: dict[str, Any] | None) -> None:
    """States of equal forces are equal, whatever came before; a force of 0 is first contact."""
    given = {"material": material} if material else {}
    path = [0.001, 0.003, 0.0, 0.003, 0.002, 0.001, 0.0]
    states = list(
        pipeline.states(
            scene(CYLINDER, loading={"forces": path}, mesh={"h_contact": 0.02}, **given)
        )
    )
    assert len(states) == len(path) and all(state.converged for state in states)
    # at the first touch the reactions are round-off of a finite strain, 1e-16 of E height^2
    assert all(abs(state.force - state.reaction) <= 1e-8 * state.force + 1e-15 for state in states)
    for state, force in zip(states, path, strict=True):
        twin = states[path.index(force)]
        for name in ("delta", "force", "a", "p_max", "energy"):
            # a row is known within 1e-10 of its force; a is read off signs of pressures
            assert getattr(state, name) == pytest.approx(
                getattr(twin, name), rel=1e-7, abs=1e-12
            ), name
        if force == 0.0:
            assert (
                state.delta == state.a == 0.0
                and abs(state.force) < 1e-15
                and state.newton_iterations < 30
            )


@pytest.mark.parametrize(
    ("body", "symmetries"),
    [
        (BOX, ("quarter", "half", "full")),
        (STRIP | {"width": 2.0}, ("half", "full")),
    ],
)
def test_force_is_of_the_whole_body(body: dict[str, Any], symmetries: tuple[str, ...]) -> None:
    """A prescribed force is that of the whole body, for every symmetry of the model.

    The depths differ by the meshes, 1 % with 4 elements in contact.
    """

    def depth(symmetry: str) -> float:
        mesh = {"h_contact": 0.1, "symmetry": symmetry}
        (state,) = solve(scene(body, loading={"force": 0.02, "steps": 1}, mesh=mesh))
        assert state.force == pytest.approx(0.02, rel=1e-10)
        return state.delta

    first, *others = map(depth, symmetries)
    assert others == pytest.approx([first] * len(others), rel=0.01)


@pytest.mark.parametrize("solver", ["condensed", "newton"])
def test_units_do_not_matter(solver: str) -> None:
    """Units do not change mesh and depths, to twice the 1e-10 of the search."""

    def depths(length: float, force: float) -> np.ndarray:
        body = CYLINDER | {"radius": 10 * length, "height": 10 * length}
        material = {"model": "linear_elastic", "E": 5.0 * force / length**2, "nu": 0.3}
        given = scene(
            body,
            material=material,
            indenter={"shape": "paraboloid", "R": 5 * length},
            solver={"method": solver},
            loading={"forces": [2 * force, 5 * force, 1 * force]},
            mesh={"h_contact": 0.2 * length},
        )
        return column(solve(given), "delta") / length

    np.testing.assert_allclose(depths(1.0, 1.0), depths(1e-6, 1e-9), rtol=2e-10)


def test_too_large_a_force() -> None:
    """A too large force is refused by theory, and ends a hyperelastic path with its last depth."""
    with pytest.raises(ConfigError, match="thickness") as caught:
        scene(WALLED, loading={"force": 1e3, "steps": 2})
    assert caught.value.key == "loading" and caught.value.exit_code == 3
    gent = {"model": "gent", "mu": 1.0, "Jm": 0.5, "nu": 0.3}
    *_, last = pipeline.states(
        scene(CYLINDER, material=gent, loading={"forces": [0.01, 1e4]}, mesh={"h_contact": 0.2})
    )
    assert (
        not last.converged and "force = 10000" in last.reason and "last equilibrium" in last.reason
    )


def test_beyond_the_end_of_a_profile() -> None:
    """A force beyond a profile's end finds the depth of the punch that is left."""
    profile = {"shape": "profile", "points": [[0, 0], [0.05, 0.01], [0.1, 0.03]]}
    base = scene(
        CYLINDER, indenter=profile, loading={"force": 0.1, "steps": 1}, mesh={"h_contact": 0.02}
    )
    (state,) = solve(base)
    flat = {"shape": "flat_punch", "radius": 0.1}
    (punch,) = solve(
        scene(CYLINDER, indenter=flat, loading={"force": 0.1, "steps": 1}, mesh={"h_contact": 0.02})
    )
    # the tip's relief is below 0.03, on the mean half of that; the punch's own depth is 0.4
    assert punch.delta < state.delta < punch.delta + 0.03


@pytest.mark.parametrize("force", [1e-12, 1e-7])
def test_tiny_forces(force: float) -> None:
    """Tiny forces are found; the mesh follows the expected contact."""
    base = scene(WALLED, loading={"force": force, "steps": 1})
    (state,) = solve(base)
    assert state.force == pytest.approx(force, rel=1e-10)
    hertz = (0.75 * force * (1 - 0.3**2)) ** (2 / 3)
    assert state.delta == pytest.approx(hertz, rel=0.005)  # the mesh's 0.2 %, and the layer's part


def test_half_space_is_sized_for_the_force() -> None:
    """The depth of a force on a half-space is Hertz's, to 0.3 % of the force.

    The plan's truncation and the mesh contribute.
    """
    base = scene(
        {"shape": "half_space"}, "solver.method=condensed", loading={"force": 1e-3, "steps": 1}
    )
    (state,) = solve(base)
    hertz = (0.75 * 1e-3 * (1 - 0.3**2)) ** (2 / 3)
    assert state.delta == pytest.approx(hertz, rel=0.002)
    assert base.plan.prediction["delta"] == pytest.approx(hertz, rel=1e-6)
