"""An impossible row is not written: exit code 6, and the rows before it stay."""

from __future__ import annotations

from pathlib import Path

import pytest
from scenes import CYLINDER, meshed
from scenes import scene as made

from indent_sim.config.scene_file import load
from indent_sim.fe import solver
from indent_sim.process.errors import VerificationError
from indent_sim.results.reader import read
from indent_sim.run import single_run
from indent_sim.run.pipeline import simulate

SCENE = """\
body: {shape: cylinder, radius: 2.0, height: 3.0}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: sphere, R: 1.0}
contact: {gap: current}
loading: {deltas: [0.1, 0.2]}
mesh: {h_contact: 0.2, h_far: 1.0}
output: {plot: false, fields: none}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE)
    return tmp_path / "scene.yaml"


def test_the_rows_before_stay(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(
        single_run, "violated_bound", lambda scene, state, earlier: "so to say" if earlier else None
    )
    with pytest.raises(
        VerificationError, match=r"step 2, at delta = 0.2, is physically impossible: so to say"
    ):
        simulate(load(scene), directory=tmp_path / "out")
    found = read(tmp_path / "out")
    assert list(found["step"]) == [1] and (found.report["status"], found.report["exit_code"]) == (
        "failed",
        6,
    )


def test_a_surface_moved_up_into_the_tip_overlaps_it() -> None:
    """A body moved up into the tip by 0.05 is penetrated by that, less the tip's height nearby.

    The first facet next to the apex counts with its far end.
    """
    contact, mesh = {"method": "auto", "gap": "current"}, {"h_contact": 0.02}
    base = made(CYLINDER, contact=contact, mesh=mesh, solver={"method": "newton"})
    found = solver.create_equilibrium(base, meshed(base))
    x = found.problem.x.copy()
    x.array[found.problem.unknowns.dofs("u").reshape(-1, 2)[:, 1]] = 0.05
    found.problem.body.set_solution(x)
    assert 0.05 - 0.03**2 < found.state_values()["overlap"] <= 0.05


@pytest.mark.parametrize("method", ["augmented_lagrangian", "penalty", "nitsche", "active_set"])
def test_a_contact_between_two_points_of_the_mesh(scene, tmp_path, method):
    with pytest.raises(VerificationError, match="there is no force"):
        overrides = (
            "loading={delta: 1.0e-6, steps: 1}",
            f"contact={{method: {method}, gap: reference}}",
        )
        simulate(load(scene, overrides), directory=tmp_path / "out")
