"""Runs without a mesh: the libraries they load, several ranks, studies and --json."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_line import ran
from conftest import Mpirun

from indent_sim.config.scene_file import config_from_mapping, to_yaml
from indent_sim.results.reader import read

COATING = {
    "shape": "half_space",
    "layers": [
        {"thickness": 0.1, "material": {"model": "linear_elastic", "E": 10.0, "nu": 0.3}},
        {},
    ],
}
SCENE: dict[str, Any] = {
    "body": COATING,
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "sphere", "R": 1.0},
    "loading": {"delta": 0.01, "steps": 10},
    "output": {"plot": False},
}
OF_A_MESH = ("dolfinx", "basix", "ffcx", "petsc4py", "gmsh", "h5py", "matplotlib")


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(to_yaml(config_from_mapping(SCENE)))
    return path


@pytest.mark.parametrize("command", ["run", "plan"])
def test_no_library_of_a_mesh_is_loaded(config: Path, tmp_path: Path, command: str) -> None:
    """A run by theory loads no library of a mesh and starts no process of gmsh."""
    program = f"""
import sys
sys.modules.update(dict.fromkeys({OF_A_MESH!r}))  # importing any of these fails now
from indent_sim.cli.commands import program
from indent_sim.process.child_process import ChildProcess
ChildProcess.start = None
program(sys.argv[1:], standalone_mode=False)
"""
    words = [
        command,
        str(config),
        *(["--output", str(tmp_path / "out")] if command == "run" else []),
    ]
    done = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    if command == "run":
        assert len(read(tmp_path / "out")) == 10


def test_three_ranks_say_what_one_says(config: Path, tmp_path: Path, mpirun: Mpirun) -> None:
    """Three ranks give the rows of one to the last digit, as rank 0 computes."""
    ran("run", config, "--output", tmp_path / "one")
    done = mpirun(3, "-m", "indent_sim.cli.commands", "run", config, "--output", tmp_path / "three")
    assert done.returncode == 0, done.stderr
    one, three = read(tmp_path / "one"), read(tmp_path / "three")
    assert three.report["ranks"] == 3
    assert all((one[name] == three[name]).all() for name in ("delta", "force", "a", "p_max"))
    surfaces = [(tmp_path / name / "surface.csv").read_bytes() for name in ("one", "three")]
    assert surfaces[0] == surfaces[1]


def test_json_has_null_for_what_theory_does_not_say(config: Path, tmp_path: Path) -> None:
    said = json.loads(ran("run", config, "--json", "--error-bars", "--output", tmp_path / "out"))
    assert said["status"] == "done" and {row["energy"] for row in said["rows"]} == {None}
    assert {(row["penetration"], row["newton_iterations"]) for row in said["rows"]} == {(0, 0)}
    assert all(row["force_error"] > 0 for row in said["rows"])


def test_the_plan_says_why(config: Path) -> None:
    said = json.loads(ran("plan", config, "--json"))
    choices = {choice["key"]: choice for choice in said["choices"]}
    assert (
        choices["solver.method"]["value"] == "theory"
        and "no mesh is needed" in choices["solver.method"]["why"]
    )
    assert {"force_Gao", "force_Perriot-Barthel"} <= set(said["prediction"])


def test_in_vain_it_is_refused(config: Path, tmp_path: Path) -> None:
    """A scene that theory cannot solve is refused with exit code 3, a reason, and no folder."""
    asked = ("solver.method=theory", "material.nu=-0.2")
    flags = [word for change in asked for word in ("--set", change)]
    said = json.loads(ran("run", config, *flags, "--json", "--output", tmp_path / "out", code=3))
    assert "nu >= 0" in said["error"]["message"] and said["error"]["key"] == "solver.method"
    assert not (tmp_path / "out").exists()


def test_a_study_of_theories_and_meshes(config: Path, tmp_path: Path) -> None:
    """Theory counts as the finest run, with which every mesh is compared; it has no unknowns."""
    file = tmp_path / "study.yaml"
    file.write_text(
        "base: scene.yaml\nset: {loading.steps: 2}\ncompare_to: finest\n"
        "vary: {solver.method: [theory, condensed, newton]}\n"
    )
    ran("study", file, "--output", tmp_path / "study")
    with open(tmp_path / "study" / "study.csv", newline="") as stream:
        rows = {row["solver.method"]: row for row in csv.DictReader(stream)}
    assert [row["status"] for row in rows.values()] == ["done"] * 3
    assert rows["theory"]["method"] == "theory" and rows["theory"]["dofs"] == ""
    errors = {name: abs(float(row["force_error_vs"])) for name, row in rows.items()}
    assert errors["theory"] == 0.0
    # 0.3 % of sizes left to the program, and the finite body that stands for the half-space
    assert all(0.0 < errors[name] < 0.004 for name in ("condensed", "newton"))
