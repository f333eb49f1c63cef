"""Runs solved by theory: closed forms, the mesh that they replace, and their folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import ELASTIC, STRIP, WALLED, force, scene
from scipy.integrate import trapezoid

from indent_sim.cli import terminal
from indent_sim.config.scene_file import config_from_mapping, load
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.results.compare import compare
from indent_sim.results.reader import read
from indent_sim.run import pipeline
from indent_sim.theory import half_space as hs

THEORY, CONDENSED = "solver.method=theory", "solver.method=condensed"
HALF_SPACE = {"shape": "half_space"}
LAYER = {"shape": "layer", "height": 0.4}
FILM = [{"thickness": 0.1, "material": ELASTIC | {"E": 10.0}}, {}]
BODIES: dict[str, dict[str, Any]] = {
    "half_space": HALF_SPACE,
    "layer": LAYER,
    "layer, roller": LAYER | {"base": "roller"},
    "film": HALF_SPACE | {"layers": FILM},
    "bilayer": LAYER | {"layers": [FILM[0], {"thickness": 0.3}]},
    "walled": WALLED,
    "strip": STRIP,
}
SPHERE = {"shape": "sphere", "R": 1.0}


def given(body: dict[str, Any], **sections: Any) -> dict[str, Any]:
    plain = {"material": ELASTIC, "indenter": SPHERE, "loading": {"deltas": [0.005, 0.02, 0.01]}}
    return {"body": body, "output": {"plot": False}} | plain | sections


def run(
    folder: Path, *overrides: str, resume: bool = False, bars: bool = False, **sections: Any
) -> pipeline.Outcome:
    config = config_from_mapping(given(**({"body": LAYER} | sections)), overrides)
    return pipeline.simulate(config, directory=folder, resume=resume, error_bars=bars)


def by_theory(*args: Any, **sections: Any) -> list[State]:
    return list(pipeline.states(scene(*args, **sections)))


# ---- the numbers


def test_hertz_and_sneddon_to_eight_digits() -> None:
    """Force, radius and peak pressure of Hertz and Sneddon are reproduced to the stated 1e-8."""
    (state,) = by_theory(HALF_SPACE)
    E_star = hs.E_star(1.0, 0.3)
    assert state.force == pytest.approx(hs.paraboloid_force(0.01, 1.0, E_star), rel=1e-8)
    assert state.a == pytest.approx(0.1, rel=1e-8)
    assert state.p_max == pytest.approx(2 * E_star * 0.1 / np.pi, rel=1e-8)
    (state,) = by_theory(HALF_SPACE, indenter=SPHERE, loading={"force": 1e-3, "steps": 1})
    assert state.force == pytest.approx(1e-3, rel=1e-8)
    assert hs.sphere_force(state.delta, 1.0, E_star) == pytest.approx(1e-3, rel=1e-8)


@pytest.mark.parametrize("name", BODIES)
def test_a_mesh_agrees_within_its_error_bars(name: str, tmp_path: Path) -> None:
    """A mesh agrees with theory within its estimated error, without theory's part of the bar.

    At least 1e-4 is allowed, the scatter from mesh to mesh.
    """
    theory = run(tmp_path / "theory", THEORY, body=BODIES[name]).states
    mesh = run(tmp_path / "mesh", CONDENSED, body=BODIES[name], accuracy=0.01)
    for exact, found, budget in zip(theory, mesh.states, mesh.report["error_budget"], strict=True):
        assert abs(found.force - exact.force) <= max(budget.estimated, 1e-4 * exact.force)
        assert found.a == pytest.approx(exact.a, rel=0.02)
        assert found.p_max == pytest.approx(exact.p_max, rel=0.02)


def test_the_surface_is_the_mesh_s(tmp_path: Path) -> None:
    """Displacement, gap and pressure of the surface are those of a mesh.

    1 % of the depth and 2 % of the peak are the scatter of the nodes. An element at the contact's
    end, where the pressure is a square root, is left out.
    """
    mesh, theory = (
        read(run(tmp_path / name, f"solver.method={name}", body=WALLED, accuracy=0.001).directory)
        for name in ("condensed", "theory")
    )
    assert (
        set(mesh.surface["step"]) == set(theory.surface["step"]) == {2, 3}
    )  # the deepest and the last
    for step in (2, 3):
        ours, theirs = (
            {name: column[run.surface["step"] == step] for name, column in run.surface.items()}
            for run in (theory, mesh)
        )
        x, a = theirs["x"], theory["a"][step - 1]
        seen = (x < 0.25) & (np.abs(x - a) > 0.1 * a)  # farther out the points are too far apart
        for name, scale in (("u_z", 0.01), ("gap", 0.01), ("pressure", 2 * ours["pressure"].max())):
            between = np.interp(x[seen], ours["x"], ours[name])
            assert between == pytest.approx(theirs[name][seen], abs=0.01 * scale), name
        assert (
            np.isnan(ours["u_x"]).all() and (ours["u_y"] == 0).all() and not (ours["gap"] < 0).any()
        )


def test_equilibrium_of_the_surface(tmp_path: Path) -> None:
    """The written pressure integrates to the force, to the 4e-3 of trapezoids."""
    found = read(run(tmp_path / "out", body=LAYER).directory)
    r, p = (found.surface[name][found.surface["step"] == 2] for name in ("x", "pressure"))
    assert trapezoid(2 * np.pi * r * p, r) == pytest.approx(found["force"][1], rel=4e-3)


def test_a_strip_is_written_from_its_middle(tmp_path: Path) -> None:
    x = read(run(tmp_path / "out", THEORY, body=STRIP).directory).surface["x"]
    assert x.min() == 2.0 and x.max() <= 4.0


def test_out_of_contact_there_is_nothing() -> None:
    states = by_theory(LAYER, loading={"deltas": [-0.01, 0.0, 0.01, -0.01]})
    assert [state.force > 0 for state in states] == [False, False, True, False]
    assert all(state.a == state.p_max == 0.0 for state in states if state.force == 0)


# ---- the folder


def test_what_the_table_says(tmp_path: Path) -> None:
    done = run(tmp_path / "out")
    header, first = (tmp_path / "out" / "force_indentation.csv").read_text().splitlines()[:2]
    row = dict(zip(header.split(","), first.split(","), strict=True))
    assert (row["penetration"], row["energy"], row["newton_iterations"]) == ("0", "", "0")
    report = json.loads((tmp_path / "out" / "run.json").read_text())
    assert report["method"] == "theory" and "mesh" not in report and "dofs" not in report
    assert (
        report["audit"]["force_against_reaction"] is None
        and report["audit"]["energy_by_trapezoid"] is None
    )
    assert not (tmp_path / "out" / "fields.xdmf").exists()
    assert all(state.penetration == 0 and state.energy != state.energy for state in done.states)


def test_a_sharp_tip_leaves_its_largest_pressure_empty(tmp_path: Path) -> None:
    found = read(run(tmp_path / "out", indenter={"shape": "flat_punch", "radius": 0.2}).directory)
    assert np.isnan(found["p_max"]).all()
    at_edge = found.surface["x"] == 0.2
    assert np.isnan(found.surface["pressure"][at_edge]).all() and at_edge.sum() == 2


def test_a_picture_is_drawn_of_it(tmp_path: Path) -> None:
    run(tmp_path / "out", "output.plot=true", indenter={"shape": "cone", "half_angle": 75})
    assert (tmp_path / "out" / "force_indentation.png").stat().st_size > 10_000


def test_error_bars_are_theorys_own(tmp_path: Path) -> None:
    """Error bars of theory are 1e-8 of each number."""
    found = read(run(tmp_path / "out", bars=True, loading={"forces": [0.001, 0.002]}).directory)
    for name in ("force", "a", "p_max", "delta"):
        assert found[f"{name}_error"] == pytest.approx(1e-8 * found[name], rel=1e-12)
    assert [part["theory"] for part in found.report["error_budget"]] == pytest.approx(
        list(found["force_error"])
    )


def test_accuracy_is_met_without_a_mesh(tmp_path: Path) -> None:
    done = run(tmp_path / "out", accuracy=1e-6)
    assert done.report["accuracy"] == {"target": 1e-6}
    assert all(state.force_error == pytest.approx(1e-8 * state.force) for state in done.states)
    again = run(tmp_path / "out", accuracy=1e-6, resume=True)
    assert again.resumed_after == 3
    with pytest.raises(ConfigError, match="contains a run with accuracy"):
        run(tmp_path / "out", resume=True)


def test_a_run_cut_short_goes_on_with_the_same_rows(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole")
    run(tmp_path / "cut")
    table, report = tmp_path / "cut" / "force_indentation.csv", tmp_path / "cut" / "run.json"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:2]))
    report.write_text(report.read_text().replace('"status": "done"', '"status": "interrupted"'))
    again = run(tmp_path / "cut", resume=True)
    assert again.resumed_after == 1 and read(tmp_path / "cut").report["status"] == "done"
    for name in ("delta", "force", "a", "p_max"):
        assert [getattr(s, name) for s in again.states] == [getattr(s, name) for s in whole.states]


def test_the_written_config_reproduces_the_run(tmp_path: Path) -> None:
    run(tmp_path / "A", body=LAYER, loading={"forces": [0.001, 0.002]})
    config = load(tmp_path / "A" / "config.yaml")
    assert (config.solver.method, config.output.fields, config.contact.gap) == (
        "theory",
        "none",
        "reference",
    )
    pipeline.simulate(config, directory=tmp_path / "B")
    assert (tmp_path / "B" / "config.yaml").read_text() == (
        tmp_path / "A" / "config.yaml"
    ).read_text()
    compare(tmp_path / "A", tmp_path / "B", 1e-15).check()


def test_theory_and_mesh_are_compared(tmp_path: Path) -> None:
    run(tmp_path / "theory", THEORY, body=WALLED)
    run(tmp_path / "mesh", CONDENSED, body=WALLED)
    compare(tmp_path / "theory", tmp_path / "mesh", 0.02).check()


def test_the_end_says_what_film_formulas_would_have_said(tmp_path: Path) -> None:
    """The report and the last lines compare with film formulas, for theory and for a mesh."""
    for name in ("theory", "condensed"):
        done = run(tmp_path / name, f"solver.method={name}", body=BODIES["film"])
        said = {one["name"]: one for one in done.report["theory"]["formulas"]}
        assert set(said) == {"Gao", "Perriot-Barthel"}
        deepest = max(done.states, key=lambda state: state.delta)
        assert said["Gao"]["deviation"] == pytest.approx(
            said["Gao"]["force"] / deepest.force - 1, rel=1e-9
        )
        (line,) = (
            line
            for line in terminal.conclusion_lines(done)
            if line.startswith("film formulas at delta 0.02")
        )
        assert f"({said['Gao']['deviation']:+.3%})" in line and "Perriot-Barthel" in line
        assert (
            read(done.directory).report["theory"]["formulas"] == done.report["theory"]["formulas"]
        )


def test_200_layers_in_a_row() -> None:
    """200 layers, each with a kernel of its own, have a force that grows as they get thinner."""
    forces = [
        by_theory({"shape": "layer", "height": h})[0].force for h in np.geomspace(3.0, 0.03, 200)
    ]
    assert all(np.diff(forces) > 0)


def test_a_notebook_walks_it_like_any_other() -> None:
    assert force_of(LAYER) == pytest.approx(
        force(scene(LAYER, CONDENSED)), rel=3e-3
    )  # what automatic sizes promise


def force_of(body: dict[str, Any]) -> float:
    return by_theory(body)[-1].force
