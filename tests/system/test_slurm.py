"""The job files of scripts/slurm, run by a stand-in for Slurm, give the numbers of plain runs."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import MPI_ENVIRONMENT, ROOT

from indent_sim.results.reader import read

SLURM = ROOT / "scripts" / "slurm"
SCENE = """\
body: {shape: cylinder, radius: 1.0, height: 1.0, sides: roller}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 10}
mesh: {h_contact: 0.05, h_far: 0.5}
output: {plot: false, fields: none}
"""
STUDY = """\
base: scene.yaml
compare_to: theory
vary: {contact.method: [penalty, active_set], mesh.h_contact: [0.06, 0.05, 0.04]}
"""
SAME = 1e-9  # rounding: other ranks, another order of sums, a curve taken up in its middle

Call = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def call(tmp_path: Path) -> Call:
    """A function that calls a command in a folder with a scene and a study.

    It also has the program and the stand-in for Slurm.
    """
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "study.yaml").write_text(STUDY)
    (tmp_path / "jobs").mkdir()
    programs = tmp_path / "bin"
    programs.mkdir()
    for name in ("sbatch", "srun", "scontrol"):
        written = (ROOT / "tests" / "system" / "stand_in_slurm.py").read_text().split("\n", 1)[1]
        (programs / name).write_text(f"#!{sys.executable}\n{written}")
        (programs / name).chmod(0o755)
    (programs / "indent-sim").write_text(
        f'#!/bin/sh\nexec {sys.executable} -m indent_sim.cli.commands "$@"\n'
    )
    (programs / "indent-sim").chmod(0o755)
    environment = (
        os.environ
        | MPI_ENVIRONMENT
        | {
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
            "STAND_IN_SLURM": str(tmp_path / "jobs"),
        }
    )

    def start(*words: str | Path, **more: str) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [str(word) for word in words],
            cwd=tmp_path,
            env=environment | more,
            capture_output=True,
            text=True,
            timeout=240,
        )
        assert done.returncode == 0, done.stderr + logs(tmp_path)
        return done

    return start


def logs(place: Path) -> str:
    """The output of all jobs."""
    return "\n".join(log.read_text() for log in sorted(place.glob("slurm-*.out")))


def ends(place: Path) -> list[dict[str, Any]]:
    """Exit code and options of every end of every job and task, in order."""
    files = sorted((place / "jobs").glob("*/*/ends"), key=lambda path: path.parent.name)
    return [json.loads(line) for path in files for line in path.read_text().splitlines()]


def numbers(folder: Path, *varied: str) -> list[list[Any]]:
    """The rows of study.csv: its numbers other than times and memory, then its words."""
    with open(folder / "study.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    measured, kept = (
        ("force", "a", "p_max"),
        ("index", "run", *varied, "status", "steps_done", "dofs"),
    )
    return [[*(float(row[k]) for k in measured), *(row[k] for k in kept)] for row in rows]


def assert_same_table(found: Path, expected: Path, *varied: str) -> None:
    """Assert that two tables have the same words, and the same numbers to rounding."""
    for row, other in zip(numbers(found, *varied), numbers(expected, *varied), strict=True):
        assert row[3:] == other[3:]
        assert row[:3] == pytest.approx(other[:3], rel=SAME)


def block(language: str) -> str:
    """All blocks of docs/cluster.md in a language."""
    text = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
    return "".join(re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL))


def test_a_run_on_two_ranks(call: Call, tmp_path: Path) -> None:
    words = ("scene.yaml", "--set", "mesh.h_contact=0.04")
    call("sbatch", "--ntasks=2", SLURM / "run.sbatch", *words, "--output", "job")
    call("indent-sim", "run", *words, "--output", "alone")
    assert read(tmp_path / "job").report["ranks"] == 2
    call("indent-sim", "compare", "job", "alone", "--rtol", f"{SAME}")
    (end,) = ends(tmp_path)
    assert end["code"] == 0 and end["options"]["signal"] == "TERM@120" and end["options"]["requeue"]


def test_a_run_at_its_time_limit_goes_on(call: Call, tmp_path: Path) -> None:
    """A run at its time limit ends with 143, is queued again, and gives the undisturbed curve.

    The ranks get SIGTERM.
    """
    words = ("scene.yaml", "--set", "loading.steps=100")
    call(
        "sbatch", "--ntasks=2", SLURM / "run.sbatch", *words, "--output", "job", STAND_IN_ROWS="20"
    )
    assert [end["code"] for end in ends(tmp_path)] == [143, 0]
    report = read(tmp_path / "job").report
    assert report["status"] == "done" and 20 <= report["resumed_after"][0] < 100
    call("indent-sim", "run", *words, "--output", "alone")
    call("indent-sim", "compare", "job", "alone", "--rtol", "1e-8")


def test_exit_codes_come_through(call: Call, tmp_path: Path) -> None:
    """A config error ends the job with 3, and the job is not queued again."""
    call("sbatch", "--ntasks=2", SLURM / "run.sbatch", "scene.yaml", "--set", "loading.delta=2")
    assert [end["code"] for end in ends(tmp_path)] == [3] and "beyond the body's thickness" in logs(
        tmp_path
    )


def test_the_worked_example_of_the_page(call: Call, tmp_path: Path) -> None:
    """An array of three tasks, each stopped once, gives the table of the undivided study.

    SIGUSR1 goes to the job file, and SIGTERM from there to the study, whose current run goes on
    from its last row.
    """
    (tmp_path / "tips.yaml").write_text(block("yaml"))
    told = call(
        SLURM / "submit_study", "tips.yaml", "3", "--time=00:10:00", STAND_IN_ROWS="30"
    ).stdout
    assert "3 shards" in told
    assert [end["code"] for end in ends(tmp_path)] == [143, 0] * 3 + [0]
    assert {end["options"]["time"] for end in ends(tmp_path)} == {"00:10:00"}
    assert (
        "6 of 6 runs are finished already" in sorted(tmp_path.glob("slurm-*.out"))[-1].read_text()
    )
    found = tmp_path / "results" / "tips"
    assert [read(folder).report["status"] for folder in (found / "runs").iterdir()] == ["done"] * 6
    call("indent-sim", "study", "tips.yaml", "--output", "whole")
    assert_same_table(found, tmp_path / "whole", "indenter.R")


def test_a_study_under_srun_takes_no_part_in_mpi(call: Call, tmp_path: Path) -> None:
    """Runs of a study do not look for the PMI server that the variables of srun promise."""
    step = {f"SLURM_{name}": "0" for name in ("NODELIST", "STEP_ID", "STEPID", "PROCID", "LOCALID")}
    call("indent-sim", "study", "study.yaml", **step)
    assert {row[5] for row in numbers(tmp_path / "results" / "study")} == {"done"}


def test_the_commands_of_the_page_work(call: Call, tmp_path: Path) -> None:
    """Every line of docs/cluster.md that calls sbatch, submit_study or the program works."""
    (tmp_path / "scripts").symlink_to(ROOT / "scripts")
    (tmp_path / "study.yaml").write_text(STUDY.replace("0.06, 0.05, 0.04", "0.06"))
    (tmp_path / "tips.yaml").write_text(block("yaml").replace("count: 6", "count: 2"))
    ours = [
        line
        for line in block("sh").splitlines()
        if re.match(r"export|sbatch|scripts/|indent-sim", line)
    ]
    assert len(ours) == 9
    call("bash", "-ec", "\n".join(ours))
    assert [end["code"] for end in ends(tmp_path)] == [0] * 11
    assert (
        numbers(tmp_path / "results" / "study")
        and read(tmp_path / "results" / "cold").report["ranks"] == 4
    )


def test_submit_study_says_how_it_is_used(call: Call) -> None:
    done = subprocess.run(
        [SLURM / "submit_study", "study.yaml", "none"], capture_output=True, text=True
    )
    assert done.returncode == 2 and "usage" in done.stderr
