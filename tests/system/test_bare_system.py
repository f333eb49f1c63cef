"""Commands where neither POSIX modules nor the solver of scenes on a mesh can be imported."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import bare_system
import pytest
from command_line import ROOT, environment

from indent_sim.process import installation

CONFIGS = ROOT / "configs"
CURVE = CONFIGS / "curves" / "thin_gel.csv"
LAYER = """
title: Thin gel on glass
units: {length: um, force: nN}
body: {shape: layer, height: 8 um}
material: {model: linear_elastic, E: 1 kPa, nu: 0.5}
indenter: {shape: sphere, R: 5 um}
loading: {delta: 1.5 um}
experiment: {cantilever: {stiffness: 0.06 N/m}}
"""
STUDY = """
base: scene.yaml
set: {loading.steps: 3}
vary: {indenter.R: [4 um, 5 um]}
"""
# Five scenes that theory solves, among them all kinds of theory: half-space, layer, stack of
# layers, relaxation, adhesion.
BY_THEORY = ("half_space", "wide_layer", "coating", "relaxing_gel", "sticky_gel")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "scene.yaml").write_text(LAYER)
    (tmp_path / "sizes.yaml").write_text(STUDY)
    return tmp_path


def bare(folder: Path, *words: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run the program without the hidden modules, and assert its exit code."""
    done = subprocess.run(
        [sys.executable, "-m", "indent_sim.cli.start", *map(str, words)],
        cwd=folder,
        env=bare_system.start_up(folder / f"start-{len(list(folder.iterdir()))}"),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def test_commands_without_a_scene(folder: Path) -> None:
    for words in (("--help",), ("list",), ("schema",), ("init",), ("init", "study")):
        bare(folder, *words)


def test_doctor_names_the_line_that_installs_the_solver(folder: Path) -> None:
    """Without the solver an installation by pip is complete, one by scripts/setup is not."""
    told = bare(folder, "doctor", code=7 if installation.is_made_by_setup() else 0).stdout
    assert installation.solver_command() in told and "mpi4py" not in told


@pytest.mark.parametrize("name", BY_THEORY)
def test_scenes_by_theory_are_those_of_a_full_installation(folder: Path, name: str) -> None:
    """Force tables are equal to the last digit: the same Python and numpy compute them."""
    words = ("run", CONFIGS / f"{name}.yaml", "--set", "output.plot=false", "--output")
    bare(folder, *words, "bare")
    full = [sys.executable, "-m", "indent_sim.cli.start", *map(str, words), "full"]
    subprocess.run(full, cwd=folder, env=environment(), check=True, capture_output=True)
    rows = [read_rows(folder / kind / "force_indentation.csv") for kind in ("bare", "full")]
    assert rows[0] == rows[1] and len(rows[0]) > 1


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a force table without the times that they took."""
    with open(path, newline="") as file:
        return [
            {name: value for name, value in row.items() if "wall" not in name}
            for row in csv.DictReader(file)
        ]


def test_results_are_planned_drawn_compared_and_reported(folder: Path) -> None:
    bare(folder, "plan", "scene.yaml")
    bare(folder, "plan", CONFIGS / "hertz.yaml")
    bare(folder, "run", "scene.yaml", "--output", "run")
    bare(folder, "run", "scene.yaml", "--output", "run", "--resume")
    bare(folder, "compare", "run", "run")
    bare(folder, "plot", "run", "--output", "curve.png")
    bare(folder, "report", "run", "--crate")
    assert (folder / "curve.png").exists() and (folder / "run" / "report.html").exists()


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_study_by_theory(folder: Path, jobs: str) -> None:
    bare(folder, "study", "sizes.yaml", "--output", "study", "--jobs", jobs)
    assert len(read_rows(folder / "study" / "study.csv")) == 2
    bare(folder, "report", "study")


def test_a_curve_is_fitted_with_its_interval(folder: Path) -> None:
    """The interval contains the modulus of which the curve was made, 3.2 kPa."""
    done = bare(
        folder, "fit", CURVE, "--scene", "scene.yaml", "--vary", "material.E", "--output", "fit"
    )
    entry = json.loads((folder / "fit" / "fit.json").read_text())["curves"][0]
    parameter = entry["parameters"]["material.E"]
    assert parameter["low"] < 3.2 < parameter["high"], done.stderr
    bare(folder, "report", "fit")
    bare(folder, "fit", "--design", "scene.yaml", "--vary", "material.E", "--noise", "0.01")


def test_several_curves_are_fitted_in_child_processes(folder: Path) -> None:
    (folder / "second.csv").write_bytes(CURVE.read_bytes())
    words = ("--scene", "scene.yaml", "--vary", "material.E", "--output", "fit", "--jobs", "2")
    bare(folder, "fit", CURVE, "second.csv", *words)
    assert json.loads((folder / "fit" / "fit.json").read_text())["status"] == "done"


def test_require_says_which_effects_need_a_mesh(folder: Path) -> None:
    told = json.loads(bare(folder, "require", CONFIGS / "half_space.yaml", "--json").stdout)
    sources = {effect["name"]: effect["source"] for effect in told["effects"]}
    assert {name for name, source in sources.items() if "needs a mesh" in source} == {
        "small_strain",
        "stick",
    }
    assert "this line installs it" in told["words"]
    bare(folder, "require", "scene.yaml", "--curve", CURVE)


@pytest.mark.parametrize("command", ["run", "study", "fit"])
def test_a_scene_on_a_mesh_is_exit_7_and_one_line_that_mends_it(folder: Path, command: str) -> None:
    mesh = LAYER.replace("{shape: layer, height: 8 um}", "{shape: cylinder, height: 8 um}")
    (folder / "scene.yaml").write_text(mesh.replace("height", "radius: 40 um, height"))
    words = {
        "run": ("run", "scene.yaml"),
        "study": ("study", "sizes.yaml", "--quiet"),
        "fit": ("fit", CURVE, "--scene", "scene.yaml", "--vary", "material.E", "--quiet"),
    }[command]
    done = bare(folder, *words, code=7)
    line = done.stderr.strip().splitlines()[-1]
    assert "needs the solver, DOLFINx, which is not installed; this line installs it: " in line


def test_no_posix_module_is_loaded_by_the_package_or_its_help() -> None:
    program = f"""
import sys
import indent_sim
from indent_sim.cli.commands import program
program(["--help"], standalone_mode=False)
loaded = {bare_system.POSIX_MODULES!r} & {{*sys.modules}}
assert not loaded, loaded
"""
    subprocess.run([sys.executable, "-c", program], env=environment(), check=True, timeout=60)
