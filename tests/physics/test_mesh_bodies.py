"""Bodies from mesh files: the same bodies meshed here, theory, and consistency."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from mesh_files import block, section, write

from indent_sim.config.scene_file import config_from_mapping, load
from indent_sim.mesh.gmsh import build_mesh
from indent_sim.run.pipeline import simulate, states
from indent_sim.scene.scene import resolve

LINEAR = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
NAMES = {"contact": "top", "base": "bottom", "sides": "wall"}
CYLINDER = {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"}


def scene(body: dict[str, Any], **others: Any) -> dict[str, Any]:
    """Mapping of a paraboloid on a body."""
    tip = {"shape": "paraboloid", "R": 1.0}
    return {
        "body": body,
        "material": LINEAR,
        "indenter": tip,
        "loading": {"deltas": [0.02, 0.05]},
        **others,
    }


def in_folder(folder: Path, body: dict[str, Any], **others: Any) -> Any:
    """Config of a scene whose mesh lies in a folder."""
    from indent_sim.config.strict_yaml import dump

    (folder / "scene.yaml").write_text(dump(scene(body, **others)), encoding="utf-8")
    return load(folder / "scene.yaml")


def forces(config: Any) -> np.ndarray:
    """Force of every row."""
    return np.array([state.force for state in states(resolve(config), with_surface=False)])


def test_a_cylinder_read_back_gives_the_same_force(tmp_path: Path) -> None:
    """A gmsh file of a mesh gives the force of that mesh, to the 1e-9 of an increment.

    It has physical groups, 16 digits and another height.
    """
    config = config_from_mapping(scene(CYLINDER))
    drawn = resolve(config)
    grid = build_mesh(drawn.physics.domain, drawn.sizes)
    facets = {
        "top": grid.surfaces["top"],
        "bottom": grid.surfaces["base"],
        "wall": grid.surfaces["r_max"],
    }
    gmsh.initialize([], False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        entity = gmsh.model.addDiscreteEntity(2)
        places = np.pad(grid.points + np.array([0.0, 5.0]), ((0, 0), (0, 1)))
        gmsh.model.mesh.addNodes(2, entity, np.arange(1, len(places) + 1), places.ravel())
        gmsh.model.mesh.addElementsByType(entity, 2, [], grid.cells.ravel() + 1)
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [entity]), "gel")
        for name, rows in facets.items():
            edge = gmsh.model.addDiscreteEntity(1)
            gmsh.model.mesh.addElementsByType(edge, 1, [], rows.ravel() + 1)
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [edge]), name)
        gmsh.write(str(tmp_path / "part.msh"))
    finally:
        gmsh.finalize()
    body = {
        "shape": "mesh",
        "file": "part.msh",
        "kinematics": "axisymmetric",
        "surfaces": NAMES,
        "sides": "roller",
    }
    contact = {
        "method": "augmented_lagrangian",
        "epsilon_n": 5.0,
    }  # h_contact is not the same, nor its multiples
    read_back = forces(in_folder(tmp_path, body, contact=contact))
    assert read_back == pytest.approx(
        forces(config_from_mapping(scene(CYLINDER, contact=contact))), rel=1e-9
    )


def test_a_section_and_a_block_feel_their_theory(tmp_path: Path) -> None:
    """A refined section of a layer between rollers has exact theory's force, to 0.3 %.

    This is the error of ten elements in the contact, as measured on automatic meshes.
    """
    write(tmp_path / "part.msh", section(2.0, 1.0, 20, 10))
    body = {
        "shape": "mesh",
        "file": "part.msh",
        "kinematics": "axisymmetric",
        "surfaces": NAMES,
        "sides": "roller",
    }
    found = forces(in_folder(tmp_path, body, mesh={"refinements": 2}))
    theory = resolve(config_from_mapping(scene(CYLINDER))).plan.theory
    assert theory is not None
    assert found == pytest.approx(
        [theory.solution_at_depth(delta).force for delta in (0.02, 0.05)], rel=3e-3
    )  # type: ignore[union-attr]


def test_a_block_is_a_box(tmp_path: Path) -> None:
    """A block from a file has the force of the box, to the 1 % of each mesh.

    The tip is in the middle of 0 ... 2 on the box, and at x = y = 0 on the file.
    """
    write(tmp_path / "part.msh", block(2.0, 1.0, 12, 6))
    body = {"shape": "mesh", "file": "part.msh", "kinematics": "3d", "surfaces": NAMES}
    loading = {"delta": 0.1, "steps": 1}
    found = forces(in_folder(tmp_path, body, loading=loading))
    box = forces(
        config_from_mapping(scene({"shape": "box", "size": [2.0, 2.0, 1.0]}, loading=loading))
    )
    assert found == pytest.approx(box, rel=0.02)


def test_regions_of_a_file_are_layers(tmp_path: Path) -> None:
    """Two regions of one material have the force of one body, and others that of layers.

    The first holds to 1e-9, the second to the error of both meshes.
    """
    body = section(2.0, 1.0, 40, 20)
    upper = body["points"][body["cells"]][:, :, 1].mean(axis=1) > -0.5
    body["regions"] = {"film": np.flatnonzero(upper), "glass": np.flatnonzero(~upper)}
    write(tmp_path / "part.msh", body)
    named = {
        "shape": "mesh",
        "file": "part.msh",
        "kinematics": "axisymmetric",
        "surfaces": NAMES,
        "sides": "roller",
    }
    alone = forces(in_folder(tmp_path, named, mesh={"refinements": 1}))
    same = forces(
        in_folder(tmp_path, named | {"regions": {"film": LINEAR}}, mesh={"refinements": 1})
    )
    assert same == pytest.approx(alone, rel=1e-9)
    stiff = LINEAR | {"E": 10.0}
    found = forces(
        in_folder(tmp_path, named | {"regions": {"glass": stiff}}, mesh={"refinements": 1})
    )
    layers = [{"thickness": 0.5, "material": LINEAR}, {"thickness": 0.5, "material": stiff}]
    config = scene(CYLINDER | {"layers": layers})
    del config["material"]
    assert found == pytest.approx(forces(config_from_mapping(config)), rel=5e-3)


@pytest.mark.parametrize("sides", ["free", "roller"])
def test_a_body_on_rollers_is_held_by_its_pins_alone_where_nothing_else_does(
    tmp_path: Path, sides: str
) -> None:
    """Pins remove the rigid motions of a body on rollers and have no reaction.

    The audit of every run demands this. A block between two walls has one horizontal motion, a free
    one three.
    """
    write(tmp_path / "part.msh", block(2.0, 1.0, 4, 3))
    body = {
        "shape": "mesh",
        "file": "part.msh",
        "kinematics": "3d",
        "surfaces": NAMES,
        "base": "roller",
        "sides": sides,
    }
    config = in_folder(tmp_path, body, loading={"delta": 0.1, "steps": 1})
    assert len(resolve(config).physics.domain.pins) == (3 if sides == "free" else 1)
    outcome = simulate(config, directory=tmp_path / "run")
    assert len(outcome.states) == 1 and outcome.states[0].force > 0


def test_a_result_reproduces_itself_from_its_own_folder(tmp_path: Path) -> None:
    """config.yaml and body.msh of a result give the same rows and files, to the last digit."""
    write(tmp_path / "part.vtu", section())
    body = {
        "shape": "mesh",
        "file": "part.vtu",
        "kinematics": "axisymmetric",
        "surfaces": {"contact": "part=1", "base": "part=2"},
    }
    first = simulate(
        in_folder(tmp_path, body, output={"plot": False}), directory=tmp_path / "first"
    )
    (tmp_path / "part.vtu").unlink()
    again = simulate(load(tmp_path / "first" / "config.yaml"), directory=tmp_path / "again")
    assert [state.force for state in again.states] == [state.force for state in first.states]
    for name in ("config.yaml", "body.msh"):
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_error_bars_of_a_given_mesh_hold_its_error(tmp_path: Path) -> None:
    """The error bar of a given mesh, from a refined one, holds the exact force.

    So does that of `accuracy`, whose coarser meshes are those before.
    """
    write(tmp_path / "part.msh", section(2.0, 1.0, 20, 10))
    body = {
        "shape": "mesh",
        "file": "part.msh",
        "kinematics": "axisymmetric",
        "surfaces": NAMES,
        "sides": "roller",
    }
    theory = resolve(config_from_mapping(scene(CYLINDER))).plan.theory
    assert theory is not None
    output = {"plot": False, "fields": "none"}
    given = simulate(
        in_folder(tmp_path, body, output=output), directory=tmp_path / "bars", error_bars=True
    )
    asked = simulate(
        in_folder(tmp_path, body, output=output, accuracy=0.01), directory=tmp_path / "accuracy"
    )
    for outcome in (given, asked):
        for state in outcome.states:
            assert state.force_error is not None
            assert (
                abs(state.force - theory.solution_at_depth(state.delta).force) <= state.force_error
            )  # type: ignore[union-attr]
    assert all(state.force_error <= 0.01 * state.force for state in asked.states)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("h", "refinements"), [(0.03, 1), pytest.param(0.06, 3, marks=pytest.mark.verify)]
)
def test_error_bars_of_flat_facets_hold_the_curved_surface(
    h: float, refinements: int, tmp_path: Path
) -> None:
    """The error bars of a mesh with flat facets hold the force on the curved surface.

    A file of order 1 has only chords of a cap, so that no refinement shows their error, but the
    angles of the facets do. The peak pressure grows with every refinement, as under a cone.
    """
    cap = {"shape": "cap", "base_radius": 1.0, "height": 0.5}
    sections = {"indenter": {"shape": "sphere", "R": 1.0}, "loading": {"delta": 0.03, "steps": 2}}
    drawn = resolve(
        config_from_mapping(scene(cap, **sections, mesh={"h_contact": h, "h_far": 0.2}))
    )
    grid, exact = (
        build_mesh(drawn.physics.domain, drawn.sizes),
        list(states(resolve(config_from_mapping(scene(cap, **sections))))),
    )
    facets = {"top": grid.surfaces["top"], "bottom": grid.surfaces["base"]}
    write(
        tmp_path / "part.msh",
        {
            "points": np.pad(grid.points * drawn.physics.scales.length, ((0, 0), (0, 1))),
            "cells": grid.cells,
            "facets": facets,
            "regions": {"gel": np.arange(len(grid.cells))},
        },
    )
    body = {
        "shape": "mesh",
        "file": "part.msh",
        "kinematics": "axisymmetric",
        "surfaces": {"contact": "top", "base": "bottom"},
    }
    config = in_folder(
        tmp_path,
        body,
        **sections,
        mesh={"refinements": refinements},
        output={"plot": False, "fields": "none"},
    )
    found = simulate(config, directory=tmp_path / "run", error_bars=True)
    for state, right in zip(found.states, exact, strict=True):
        assert abs(state.force - right.force) <= state.force_error <= 0.1 * state.force  # type: ignore[operator]
        assert abs(state.p_max - right.p_max) <= state.p_max_error <= 0.6 * state.p_max  # type: ignore[operator]
    assert all(
        budget.truncation > 0.002 * state.force
        for budget, state in zip(found.report["error_budget"], found.states, strict=True)
    )
