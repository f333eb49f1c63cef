"""Every scene of configs/ runs from its file to its folder and gives the expected force.

expected.json comes from scripts/make_references: layer theory where the body is the theory's own, a
much finer run elsewhere. Each entry says which, and how far it may be off. No tolerance here is the
digits of one mesh: it is the discretisation error of the scene as run, so that another gmsh or
contact method passes and a wrong factor does not.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from shipped_scenes import COARSER, CONFIGS, SCENES, Run

from indent_sim.config.scene_file import load
from indent_sim.run.pipeline import simulate

EXPECTED = json.loads(Path(__file__).with_name("expected.json").read_text())["scenes"]
BY_THEORY = (
    "coating.yaml",
    "half_space.yaml",
    "relaxing_gel.yaml",
    "sticky_gel.yaml",
    "tense_gel.yaml",
    "wide_layer.yaml",
)


def deviations(name: str, directory: Path, *overrides: str) -> np.ndarray:
    """Relative differences of a run's forces to the expected ones, at every known depth.

    Where forces are prescribed, depths are compared.
    """
    elastic = EXPECTED[name].get("overrides", ())  # of a scene in time
    config = load(CONFIGS / name, ("output.plot=false", *elastic, *overrides))
    simulate(config, MPI.COMM_SELF, directory=directory)
    assert json.loads((directory / "run.json").read_text())["status"] == "done"
    with open(directory / "force_indentation.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    x, y = ("force", "delta") if EXPECTED[name]["control"] == "force" else ("delta", "force")
    expected = [
        (round(at, 12), value)
        for at, value in zip(EXPECTED[name][x], EXPECTED[name][y], strict=True)
    ]
    found = [(round(float(row[x]), 12 if x == "delta" else 8), float(row[y])) for row in rows]
    assert found[-1][0] == expected[-1][0]
    if len(found) == len(expected):  # row by row, since depths may repeat
        pairs = zip(found, expected, strict=True)
        return np.array([value / right - 1 for (_, value), (_, right) in pairs if right])
    known = dict(expected)
    return np.array([value / known[at] - 1 for at, value in found if known.get(at)])


@pytest.mark.parametrize("name", SCENES)
def test_scene_gives_its_force(name: str, tmp_path: Path) -> None:
    """A shipped scene has its expected force, within the stated tolerance.

    Scenes that theory solves have it to 1e-8, which theory states of itself.
    """
    assert name in EXPECTED, f"no expected force: scripts/make_references configs/{name}"
    settings = COARSER.get(name, Run())
    found = deviations(name, tmp_path / "result", *settings.overrides)
    by_theory = json.loads((tmp_path / "result" / "run.json").read_text())["method"] == "theory"
    if (
        "overrides" not in EXPECTED[name]
    ):  # an elastic curve may be theory's where the scene in time is not
        assert by_theory == (name in BY_THEORY)
    assert abs(found[-1]) <= (1e-8 if by_theory else settings.last)
    assert np.abs(found).max() <= (1e-8 if by_theory else settings.any)


@pytest.mark.parametrize("name", BY_THEORY)
def test_a_mesh_gives_the_force_of_theory(name: str, tmp_path: Path) -> None:
    """A mesh has the force of a scene that theory solves, within the 0.3 % of automatic sizes.

    The expected force is theory's, so the mesh is an independent answer.
    """
    found = deviations(name, tmp_path / "mesh", "solver.method=condensed")
    assert abs(found[-1]) <= Run().last and np.abs(found).max() <= Run().any


@pytest.mark.verify
@pytest.mark.parametrize("name", [name for name, settings in COARSER.items() if settings.overrides])
def test_scene_as_shipped(name: str, tmp_path: Path) -> None:
    """A scene without the tests' coarser mesh has its expected force to 0.3 % at the last step.

    The uncertainty of the expected force is allowed on top.
    """
    assert abs(deviations(name, tmp_path / "result")[-1]) <= 0.003 + EXPECTED[name]["uncertainty"]


@pytest.mark.parametrize("name", EXPECTED)
def test_expected_forces_are_better_known_than_they_are_tested(name: str) -> None:
    settings = COARSER.get(name, Run())
    assert name in SCENES, "the scene is gone; remove its entry"
    assert EXPECTED[name]["uncertainty"] <= min(settings.last, settings.any) / 2
    assert EXPECTED[name]["source"]


def test_a_wrong_scene_is_noticed(tmp_path: Path) -> None:
    """A modulus off by 1 % changes the force by 1 %, which is more than the tolerance of 0.3 %."""
    found = deviations("hertz.yaml", tmp_path / "result", "material.E=1.01")
    assert abs(found[-1]) > Run().last
    assert found[-1] == pytest.approx(0.01, abs=0.002)
