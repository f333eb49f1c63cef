"""The auxiliary runs that `plan` counts are those that a run solves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from indent_sim.cli import commands
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.strict_yaml import dump
from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.run.error_estimation.coarser_run import CoarserRun
from indent_sim.run.error_estimation.predicted_cost import auxiliary_scenes, predict_total_cost
from indent_sim.run.error_estimation.refinement import RefinementLevel
from indent_sim.scene.scene import Scene, resolve

PLAIN: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.02, "steps": 3},
}
BOX = {"shape": "box", "size": [2.0, 2.0, 1.0]}
ITERATED = {
    "body": BOX,
    "mesh": {"h_contact": 0.1, "h_far": 0.5},
    "solver": {"linear": "iterative"},
}
SCENES: dict[str, dict[str, Any]] = {
    "plain": {},
    "accuracy": {"accuracy": 0.0005},  # whose companion costs more than the digits of `seconds`
    "solid": {"body": BOX},
    "solid, iterated": ITERATED,
    "penalty": {"contact": {"method": "penalty"}},
    "friction": {"contact": {"method": "auto", "friction": 0.5}},
    "penalty with friction": {"contact": {"method": "penalty", "friction": 0.2}},
    "finite strain": {"material": {"model": "neo_hookean", "E": 1.0, "nu": 0.5}},
    "forces": {"loading": {"forces": [0.001, 0.002]}},
    "adhesion": {"contact": {"method": "auto", "adhesion": {"work": 1e-3, "range": 0.02}}},
    "pins": {
        "body": BOX | {"base": "roller"},
        "indenter": {"shape": "paraboloid", "R": 1.0, "center": [0.9, 1.0]},
    },
    "out of contact": {"loading": {"deltas": [-0.01]}},
    "drains": {
        "material": PLAIN["material"] | {"flow": {"diffusivity": 1.0}},
        "loading": {"history": [[0, 0], [0.1, 0.02]], "times": [0.05, 0.1]},
    },
    "swells": {
        "material": {
            "model": "gel",
            "G": 1.0,
            "n_omega": 0.001,
            "chi": 0.6,
            "stretch": 1.4,
            "flow": {"diffusivity": 1},
        },
        "loading": {"history": [[0, 0], [100, 0]], "times": [10, 100]},
    },
    "half-space by mesh": {"body": {"shape": "half_space"}, "output": {"fields": "last"}},
}
Said = tuple[Any, ...]


def said(scene: Scene) -> Said:
    """Everything of a scene that its cost depends on; depths to round-off."""
    physics = scene.physics
    return (
        scene.sizes,
        physics.contact,
        physics.path.control,
        np.round(physics.deltas, 12).tolist(),
        physics.slip_reference,
        scene.solver,
    )


def reached(scene: Scene) -> list[State]:
    """Rows at all depths of a scene, as a run would have them."""
    depths = [delta * scene.physics.scales.depth for delta in scene.physics.deltas]
    return [
        State(k, delta, max(delta, 0.0) ** 1.5, 0.1, 0, 0, 0, 1, 0.0)
        for k, delta in enumerate(depths, start=1)
    ]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("with_stick", [False, True])
def test_the_companions_that_are_planned_are_those_that_are_run(
    monkeypatch, tmp_path, name, with_stick
):
    config = config_from_mapping(PLAIN | SCENES[name])
    scene = resolve(config)
    solved: list[Said] = []
    monkeypatch.setattr(pipeline, "backend", lambda: None)
    monkeypatch.setattr(
        pipeline,
        "states",
        lambda other, *_, **__: solved.append(said(other)) or reached(other),
    )
    run = pipeline.SimulationDriver(config, None, None, tmp_path, None, False, with_stick, False)
    bars = run._error_bars(RefinementLevel(scene))
    if with_stick:
        run._no_slip_effect(CoarserRun(1.0, reached(scene), scene), bars)
    assert solved == [said(other) for other in auxiliary_scenes(scene, with_stick)]


@pytest.mark.parametrize("name", SCENES)
def test_a_whole_run_costs_more_than_its_own_mesh(name):
    scene = resolve(config_from_mapping(PLAIN | SCENES[name]))
    alone, beside = (predict_total_cost(scene, bars).plan.prediction for bars in (False, True))
    assert beside["seconds"] > scene.plan.prediction["seconds"]
    assert beside["memory_MB"] >= scene.plan.prediction["memory_MB"]
    assert (alone["seconds"] > scene.plan.prediction["seconds"]) == ("accuracy" in SCENES[name])
    assert {key: alone[key] for key in ("cells", "dofs")} == {
        key: beside[key] for key in ("cells", "dofs")
    }


def test_theory_has_no_companions():
    scene = resolve(
        config_from_mapping(PLAIN | {"body": {"shape": "half_space"}, "accuracy": 0.01})
    )
    assert predict_total_cost(scene, True) is scene


def test_plan_counts_them_where_it_is_asked_to(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(dump(PLAIN))
    (tmp_path / "study.yaml").write_text(
        dump({"base": "scene.yaml", "vary": {"material.nu": [0.2, 0.3]}})
    )
    for file in ("scene.yaml", "study.yaml"):
        words = ["plan", file, "--json"]
        told = [
            CliRunner().invoke(commands.program, [*words, *flag]) for flag in ([], ["--error-bars"])
        ]
        assert [done.exit_code for done in told] == [0, 0]
        assert told[0].stdout != told[1].stdout
    assert (
        "seconds"
        in CliRunner().invoke(commands.program, ["plan", "scene.yaml", "--error-bars"]).stdout
    )
