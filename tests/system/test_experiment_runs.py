"""Experiments through the command line: files, what they load, stopped and resumed runs, ranks, JSON, pictures."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import Mpirun
from test_theory_runs import ran

from indent_sim.config.scene_file import from_mapping, to_yaml

SCENE: dict[str, Any] = {
    "body": {"shape": "layer", "height": 1.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "experiment": {
        "relaxation": {"prony": [[0.5, 1.0]]},
        "history": [[0, 0], [1, 0.01], [2, 0.01], [3, 0]],
        "frequencies": [1.0],
    },
}
STICKY = {"experiment": {"adhesion": {"work": 1e-3}, "cantilever": {"stiffness": 0.1}}, "loading": {"delta": 0.01}}
OF_A_MESH = ("dolfinx", "basix", "ffcx", "petsc4py", "gmsh", "h5py", "mpi4py")


def written(folder: Path, **sections: Any) -> Path:
    path = folder / "scene.yaml"
    path.write_text(to_yaml(from_mapping(SCENE | sections)))
    return path


def rows(folder: Path, name: str = "experiment.csv") -> list[dict[str, str]]:
    with open(folder / name, newline="") as stream:
        return list(csv.DictReader(stream))


def test_theory_does_it_without_a_library_of_a_mesh(tmp_path: Path) -> None:
    program = f"""
import sys
sys.modules.update(dict.fromkeys({OF_A_MESH!r}))  # importing any of these fails now
from indent_sim.cli.commands import program
program(sys.argv[1:], standalone_mode=False)
"""
    words = ["run", str(written(tmp_path)), "--output", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    table = rows(tmp_path / "out")
    assert list(table[0]) == ["t", "z", "delta", "force", "a", "branch"]
    assert {"0", "1", "2", "3"} <= {row["t"] for row in table}
    assert {row["branch"] for row in table} == {"approach", "hold", "retract"}
    assert list(rows(tmp_path / "out", "dynamic.csv")[0]) == ["frequency", "storage", "loss"]
    assert (tmp_path / "out" / "experiment.png").stat().st_size > 5000
    assert "relaxation by quadrature" in done.stderr


def test_a_scene_without_an_experiment_loads_and_writes_nothing_of_it(tmp_path: Path) -> None:
    program = """
import sys
from indent_sim.cli.commands import program
program(sys.argv[1:], standalone_mode=False)
assert not [name for name in sys.modules if name.startswith("indent_sim.run.experiment") or name == "scipy.optimize"]
"""
    config = tmp_path / "scene.yaml"
    given = {name: part for name, part in SCENE.items() if name != "experiment"}
    config.write_text(to_yaml(from_mapping(given | {"loading": {"delta": 0.01}, "output": {"plot": False}})))
    words = ["run", str(config), "--output", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "out").glob("experiment*"))
    assert "experiment" not in json.loads((tmp_path / "out" / "run.json").read_text())


@pytest.mark.parametrize("method", ["theory", "condensed"])
def test_a_run_killed_before_its_experiment_is_resumed(tmp_path: Path, method: str) -> None:
    """All rows are there, the status is running: --resume computes the experiment, to the last digit."""
    config, out = written(tmp_path, solver={"method": method}), tmp_path / "out"
    ran("run", config, "--output", out)
    whole, report = (out / "experiment.csv").read_bytes(), json.loads((out / "run.json").read_text())
    (out / "experiment.csv").unlink()
    said = json.loads(ran("run", config, "--output", out, "--resume", "--json"))  # finished: it stays as it is
    assert any("experiment.csv" in warning for warning in said["report"]["warnings"])
    (out / "run.json").write_text(json.dumps(report | {"status": "running", "exit_code": None}))
    ran("run", config, "--output", out, "--resume")
    assert (out / "experiment.csv").read_bytes() == whole
    assert json.loads((out / "run.json").read_text())["status"] == "done"


def test_a_run_without_one_replaces_the_files_of_one(tmp_path: Path) -> None:
    out = tmp_path / "out"
    ran("run", written(tmp_path), "--output", out)
    ran("run", written(tmp_path, **STICKY), "--output", out)
    assert not (out / "dynamic.csv").exists() and len(rows(out)) == 200
    held = json.loads((out / "run.json").read_text())["experiment"]
    assert held["adhesion"]["pull_off"]["force_control"]["force"] < 0 and held["cantilever"]["jump_out"]["z"] < 0


def test_two_ranks_write_what_one_does(tmp_path: Path, mpirun: Mpirun) -> None:
    """Of one mesh, partitioned: the compliance is the same to rounding, and a contact's edge with it."""
    config = written(tmp_path, solver={"method": "condensed"}, output={"plot": False})
    ran("run", config, "--output", tmp_path / "one")
    mpirun(2, "-m", "indent_sim.cli.commands", "run", config, "--output", tmp_path / "two")
    for one, two in zip(rows(tmp_path / "one"), rows(tmp_path / "two"), strict=True):
        assert float(one["force"]) == pytest.approx(float(two["force"]), rel=1e-6, abs=1e-12)


def test_a_refused_experiment_leaves_nothing(tmp_path: Path) -> None:
    config = tmp_path / "scene.yaml"
    text = to_yaml(from_mapping(SCENE)).replace("prony:", "power_law: {exponent: 0.2, time: 1.0}\n    prony:")
    config.write_text(text)
    ran("run", config, "--output", tmp_path / "out", code=3)
    assert os.listdir(tmp_path) == ["scene.yaml"]
