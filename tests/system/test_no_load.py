"""Paths whose forces or depths are all 0 are planned and run, or refused in words."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from indent_sim.cli import commands
from indent_sim.config.strict_yaml import dump

ATTRACTION = {"work": 0.05, "range": 0.2}
ROUND_OFF = 1e-9  # [force, length] of bodies of E = 1 under R = 1; forces are met to 1e-11


@pytest.fixture(
    params=[{"shape": "half_space"}, {"shape": "layer", "height": 1.0}], ids=["half_space", "layer"]
)
def body(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture(params=["linear_elastic", "neo_hookean"])
def model(request: pytest.FixtureRequest) -> Any:
    return request.param


def planned_and_run(
    folder: Path, body: Any, model: str, loading: Any, **sections: Any
) -> tuple[int, str]:
    """The exit code that `plan` and `run` share, and what `run` says.

    A refused scene leaves no folder.
    """
    scene = {
        "body": body,
        "material": {"model": model, "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "sphere", "R": 1.0},
    }
    (folder / "scene.yaml").write_text(
        dump(scene | {"loading": loading, "output": {"plot": False}} | sections)
    )
    words = str(folder / "scene.yaml")
    plan = CliRunner().invoke(commands.program, ["plan", words])
    run = CliRunner().invoke(
        commands.program, ["run", words, "--output", str(folder / "out"), "--quiet"]
    )
    assert run.exit_code == plan.exit_code, run.stderr
    assert (folder / "out").exists() == (run.exit_code == 0)
    return run.exit_code, run.stderr


def rows(folder: Path) -> list[dict[str, float]]:
    with open(folder / "out" / "force_indentation.csv", newline="") as file:
        return [
            {name: float(row[name]) for name in ("delta", "force", "a")}
            for row in csv.DictReader(file)
        ]


@pytest.mark.parametrize(
    "experiment", [None, {"adhesion": {"work": 0.05}}], ids=["smooth", "no_range"]
)
def test_forces_that_press_nothing(tmp_path, body, model, experiment):
    """Forces that are all 0 are refused where the solved contact has no attraction.

    No depth belongs to the force 0 then.
    """
    code, words = planned_and_run(tmp_path, body, model, {"forces": [0, 0]}, experiment=experiment)
    assert code == 3 and "loading.forces: never press the tip in: every force is 0" in words


def test_depths_at_which_nothing_touches(tmp_path, body, model):
    code, words = planned_and_run(tmp_path, body, model, {"deltas": [0, 0]})
    assert code == 0 and "the tip never reaches the body" in words
    assert [row["force"] for row in rows(tmp_path)] == [0, 0]


def test_an_experiment_that_ends_at_first_touch(tmp_path, body, model):
    """An adhesive experiment at depth 0 runs for a linear body and is refused otherwise.

    The JKR limit is made of a linear body's curve.
    """
    code, words = planned_and_run(
        tmp_path, body, model, {"deltas": [0, 0]}, experiment={"adhesion": {"work": 0.05}}
    )
    assert code == (0 if model == "linear_elastic" else 3)
    assert "never reaches the body" in words if code == 0 else "the material is not linear" in words


def test_a_tip_let_go_of_is_pulled_in_and_held_at_first_touch_it_pulls(tmp_path, body, model):
    """With an attraction the force 0 has a positive depth, and the depth 0 a tensile force.

    The second row, at the same force or depth, is the equilibrium of the first.
    """
    attracts = {"contact": {"adhesion": ATTRACTION}}
    found = {}
    for key in ("forces", "deltas"):
        (folder := tmp_path / key).mkdir()
        assert planned_and_run(folder, body, model, {key: [0, 0]}, **attracts) == (0, "")
        found[key], again = rows(folder)
        assert again == pytest.approx(found[key], rel=ROUND_OFF, abs=ROUND_OFF)
    free, held = found["forces"], found["deltas"]
    assert free["force"] == pytest.approx(0.0, abs=ROUND_OFF) and free["delta"] > 0
    assert held["delta"] == 0 and held["force"] < 0 and free["a"] > held["a"] > 0
