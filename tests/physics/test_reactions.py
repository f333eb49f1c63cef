"""Reactions of the supports: balance with the tip, symmetry planes, exact solutions."""

from __future__ import annotations

import json
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import pytest
from scenes import BOX, CYLINDER, ELASTIC, STRIP, WALLED, scene, solve

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.results.reader import read
from indent_sim.run.pipeline import simulate
from indent_sim.scene.scene import Scene, resolve

# of the force: Newton's method leaves 1e-10 of the reactions, over some hundred held nodes
BALANCE = 1e-8
COARSE = ("mesh.h_contact=0.05", "mesh.h_far=0.5")
RUBBER = {"model": "neo_hookean", "E": 1.0, "nu": 0.4}
ROUGH = {"method": "augmented_lagrangian", "friction": 0.3}
POROUS = ELASTIC | {"flow": {"diffusivity": 1.0}}
HELD_BOX = BOX | {"sides": "fixed"}
OFF_CENTER = {"shape": "paraboloid", "R": 1.0, "center": [1.7]}
RAMP: dict[str, Any] = {"history": [[0, 0], [0.1, 0.02]], "times": [0.01, 0.1]}


def along(state: State, axis: str) -> float:
    """Sum of all supports' forces on the body along an axis."""
    assert state.reactions is not None
    supports = {
        name: force for name, force in state.reactions.items() if not name.startswith("mirror")
    }
    return sum(force for name, force in supports.items() if name.endswith(f"_{axis}"))


BALANCED = {
    "axisymmetric": scene(CYLINDER | {"sides": "fixed"}),
    "strip": scene(STRIP | {"sides": "fixed"}, "mesh.symmetry=full"),
    "strip off its middle, with friction": scene(STRIP, indenter=OFF_CENTER, contact=ROUGH),
    "strip off its middle, whole": scene(
        STRIP, "solver.method=newton", indenter=OFF_CENTER, contact=ROUGH
    ),
    "rubber strip off its middle": scene(
        STRIP,
        indenter=OFF_CENTER,
        contact=ROUGH,
        material=RUBBER,
        loading={"delta": 0.1, "steps": 2},
    ),
    "quarter of a box": scene(HELD_BOX, *COARSE),
    "quarter of a rubber box": scene(
        HELD_BOX, *COARSE, material=RUBBER, loading={"delta": 0.02, "steps": 1}
    ),
    "half of a cylinder in a curved roller": scene(WALLED, "mesh.symmetry=half", *COARSE),
    "half of a rubber cylinder in a curved roller": scene(
        WALLED, "mesh.symmetry=half", "mesh.h_contact=0.1", "mesh.h_far=0.5", material=RUBBER
    ),
    "draining": scene(CYLINDER | {"sides": "roller"}, material=POROUS, loading=RAMP),
    "draining rubber": scene(
        CYLINDER | {"sides": "fixed"},
        material=RUBBER | {"flow": {"diffusivity": 1.0}},
        loading=RAMP,
    ),
}


@pytest.mark.parametrize("name", BALANCED)
def test_the_supports_push_the_body_as_the_body_pushes_the_tip(name: str) -> None:
    """The reactions balance the force of the row along z and that of friction sideways.

    Sideways they vanish where the gap is vertical.
    """
    base = BALANCED[name]
    is_vertical = base.physics.gap == "reference"
    for state in solve(base):
        assert along(state, "z") == pytest.approx(state.force, rel=BALANCE)
        for axis in {"x", "y"} if base.physics.domain.kinematics.name != "axisymmetric" else ():
            side_force = getattr(state, f"side_force_{axis}")
            if side_force is not None or is_vertical:
                assert along(state, axis) == pytest.approx(
                    side_force or 0.0, abs=BALANCE * state.force
                )


@pytest.mark.parametrize("sides", ["roller", "fixed"])
def test_what_is_mirrored_bears_what_the_whole_does(sides: str) -> None:
    """The reactions of a half strip are those of the whole, to 0.2 %.

    Each of the two meshes is right to 0.1 %.
    """
    body = STRIP | {"sides": sides}
    (half,), (whole,) = solve(scene(body)), solve(scene(body, "mesh.symmetry=full"))
    assert half.reactions and whole.reactions
    wanted = {name: force for name, force in whole.reactions.items() if name != "base_x"}
    assert {*half.reactions} == {*wanted, "mirror_x"}
    for name, force in wanted.items():
        assert half.reactions[name] == pytest.approx(force, rel=2e-3), name
    assert abs(whole.reactions["base_x"]) < 1e-4 * whole.force  # which cancels between the halves


def test_a_quarter_bears_what_the_whole_box_does() -> None:
    """The reactions of a quarter of a box are those of the whole, to 3 %.

    Each of the two meshes with 2.5 elements in the contact radius is right to 1.1 %.
    """
    (part,), (whole,) = (
        solve(scene(HELD_BOX, *COARSE, *more)) for more in ((), ("mesh.symmetry=full",))
    )
    assert part.reactions and whole.reactions
    for name in ("base_z", "x_min_x", "x_max_x", "y_min_y", "y_max_z", "x_min_z"):
        assert part.reactions[name] == pytest.approx(whole.reactions[name], rel=0.03), name
    assert part.reactions["x_min_x"] == -part.reactions["x_max_x"]


def test_a_mirror_plane_bears_what_the_side_does_on_rollers() -> None:
    """On a roller base, the reaction of a mirror plane is that of the opposite side."""
    (state,) = solve(scene(BOX | {"base": "roller", "sides": "roller"}, *COARSE))
    assert state.reactions
    for axis in "xy":
        side = state.reactions[f"{axis}_max_{axis}"]
        assert side < 0  # the body presses outwards, the side inwards
        assert state.reactions[f"mirror_{axis}"] == pytest.approx(-side, abs=BALANCE * state.force)


@pytest.mark.parametrize("method", ["newton", "condensed"])
def test_the_wall_of_a_confined_column_bears_its_lateral_pressure(method: str) -> None:
    """The wall of a confined column carries sigma_r = nu/(1-nu) sigma_z on its area.

    Linear fields are exact.
    """
    body = {"shape": "cylinder", "radius": 0.5, "height": 1.0, "base": "roller", "sides": "roller"}
    (state,) = solve(scene(body, f"solver.method={method}", indenter={"shape": "plate"}))
    modulus = (1 - 0.3) / (1 + 0.3) / (1 - 2 * 0.3)
    assert state.force == pytest.approx(pi * 0.25 * modulus * 0.01, rel=BALANCE)
    assert state.reactions == pytest.approx(
        {"base_z": state.force, "sides_r": -2 * pi * 0.5 * modulus * 0.01 * 0.3 / 0.7}, rel=BALANCE
    )


@pytest.mark.parametrize(
    "name", ["quarter of a box", "half of a cylinder in a curved roller", "axisymmetric"]
)
def test_the_condensed_body_has_the_reactions_of_the_whole_one(name: str) -> None:
    condensed = BALANCED[name]
    assert condensed.solver.method == "condensed"
    whole = with_newton(condensed)
    (one,), (other,) = solve(condensed), solve(whole)
    assert one.reactions == pytest.approx(other.reactions, abs=1e-7 * one.force)


def with_newton(base: Scene) -> Scene:
    """The same scene on the whole mesh."""
    return replace(base, solver=replace(base.solver, method="newton"))


def test_a_node_on_two_fixed_supports_is_shared() -> None:
    """The reaction of nodes on base and sides is shared; its share vanishes with the elements."""
    body = CYLINDER | {"sides": "fixed"}
    parts = [solve(scene(body, f"mesh.h_far={h}"))[-1] for h in (0.2, 0.1)]
    shares = [state.reactions["sides_z"] / state.force for state in parts if state.reactions]
    assert shares[0] == pytest.approx(shares[1], rel=0.02)


GIVEN = {
    "body": CYLINDER | {"sides": "fixed"},
    "material": ELASTIC,
    "indenter": {"shape": "paraboloid", "R": 1.0},
}
GIVEN |= {"loading": {"delta": 0.01, "steps": 2}, "units": {"length": "mm", "force": "N"}}


def test_columns_on_request_and_the_last_row_in_run_json(tmp_path: Path) -> None:
    quiet = GIVEN | {"output": {"plot": False, "fields": "none"}}
    plain = simulate(config_from_mapping(quiet), directory=tmp_path / "plain")
    asked = simulate(
        config_from_mapping(quiet, ("output.reactions=true",)), directory=tmp_path / "asked"
    )
    columns = ("reaction_base_z", "reaction_sides_z", "reaction_sides_r")
    found, without = read(tmp_path / "asked"), read(tmp_path / "plain")
    assert {*found.columns} == {*without.columns, *columns} and found.columns[-3:] == (
        "reaction_base_z",
        "reaction_sides_r",
        "reaction_sides_z",
    )
    assert found["reaction_base_z"] + found["reaction_sides_z"] == pytest.approx(
        found["force"], rel=BALANCE
    )
    for outcome in (plain, asked):
        report = json.loads((outcome.directory / "run.json").read_text())["reactions"]
        assert report["step"] == 2
        assert report["base"]["z"] == found["reaction_base_z"][-1]
        assert report["sides"] == {axis: found[f"reaction_sides_{axis}"][-1] for axis in "rz"}
    assert (found["force"] == without["force"]).all()


def test_reactions_are_forces_in_the_units_of_the_scene() -> None:
    """Reactions are forces in the units of the scene."""
    small = {"shape": "cylinder", "radius": 1e3, "height": 1e3, "base": "fixed", "sides": "fixed"}
    material, tip = ELASTIC | {"E": 1e-3}, {"shape": "paraboloid", "R": 1e3}
    (one,) = solve(scene(CYLINDER | {"sides": "fixed"}))
    (other,) = solve(
        scene(small, material=material, indenter=tip, loading={"delta": 10.0, "steps": 1})
    )
    assert one.reactions and other.reactions
    assert other.reactions == pytest.approx(
        {name: 1e3 * force for name, force in one.reactions.items()}, rel=1e-9
    )


def test_a_run_with_reactions_goes_on_with_them(tmp_path: Path) -> None:
    config = config_from_mapping(
        GIVEN | {"output": {"plot": False, "fields": "none", "reactions": True}}
    )
    simulate(config, directory=tmp_path / "run")
    wanted = read(tmp_path / "run")
    table = tmp_path / "run" / "force_indentation.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:2]))
    simulate(config, directory=tmp_path / "run", resume=True)
    found = read(tmp_path / "run")
    for name in ("reaction_base_z", "reaction_sides_r", "reaction_sides_z"):
        assert found[name] == pytest.approx(wanted[name], rel=1e-9)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"body": {"shape": "half_space"}}, "without a mesh"),
        (
            {"body": {"shape": "layer", "height": 1.0}, "solver": {"method": "condensed"}},
            "unbounded body",
        ),
        (
            {
                "material": ELASTIC | {"relaxation": {"prony": [[0.5, 1.0]]}},
                "loading": {"history": [[0, 0], [1, 0.01]]},
            },
            "elastic load curve",
        ),
    ],
)
def test_what_has_no_reactions_says_so(given: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigError, match=why) as raised:
        resolve(config_from_mapping(GIVEN | given, ("output.reactions=true",)))
    assert raised.value.key == "output.reactions"
