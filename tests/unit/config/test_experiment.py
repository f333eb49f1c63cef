"""The experiment section: refusals with key and remedy, and what replaces a loading."""

from __future__ import annotations

from typing import Any

import pytest
from scenes import placed

from indent_sim.config.scene_file import config_from_mapping, loads, to_yaml
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

SCENE: dict[str, Any] = {
    "body": {"shape": "layer", "height": 1.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.01},
}
SLOW = {"prony": [[0.5, 1.0]]}
RAMP = [[0, 0], [1, 0.01]]
BOX = {"shape": "box", "size": [2.0, 2.0, 1.0]}
HYPERELASTIC = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}


@pytest.mark.parametrize(
    ("experiment", "sections", "key", "words"),
    [
        ({}, {}, "experiment", "is empty"),
        (
            {"history": RAMP, "force_history": RAMP},
            {},
            "loading.force_history",
            "contradicts history",
        ),
        ({"history": [[1, 0], [0, 0.01]]}, {}, r"loading.history\[1\]", "time goes back"),
        ({"history": [[0, 0], [0, 0.01]]}, {}, "loading.history", "has no duration"),
        ({"history": [[0, -1], [1, 0]]}, {}, "loading.history", "never presses"),
        (
            {"force_history": [[0, 1e-3], [1, -1e-3]]},
            {},
            "loading.force_history",
            "there is no adhesion",
        ),
        ({"relaxation": SLOW}, {}, "material.relaxation", "needs a load path in time"),
        ({"relaxation": {}, "history": RAMP}, {}, "material.relaxation", "one of its two laws"),
        (
            {"relaxation": SLOW | {"of": "bulk"}, "history": RAMP},
            {},
            "material.relaxation.of",
            "all",
        ),
        (
            {"relaxation": {"prony": [[0.6, 1], [0.4, 2]]}, "history": RAMP},
            {},
            "material.relaxation.prony",
            "sum to",
        ),
        (
            {"relaxation": {"prony": [[0.6, 0]]}, "history": RAMP},
            {},
            r"material.relaxation.prony\[0\]",
            "not a term",
        ),
        (
            {
                "relaxation": {"power_law": {"exponent": 0.2, "time": 1}},
                "history": [[0, 0], [0, 0.01], [1, 0.01]],
            },
            {},
            "loading.history",
            "jumps",
        ),
        (
            {
                "relaxation": {"power_law": {"exponent": 0.2, "time": 1}},
                "history": [[0, 0.01], [1, 0.01]],
            },
            {},
            "loading.history",
            "jumps",
        ),
        ({"frequencies": [1.0]}, {}, "experiment.frequencies", "relaxation"),
        (
            {"adhesion": {"work": 1e-3}, "relaxation": SLOW, "history": RAMP},
            {},
            "experiment.adhesion",
            "cannot be combined",
        ),
        ({"adhesion": {"work": 1e-3}}, {"body": BOX}, "experiment.adhesion", "circular contact"),
        (
            {"adhesion": {"work": 1e-3}},
            {"indenter": {"shape": "flat_punch", "radius": 0.1}},
            "experiment.adhesion",
            "edge_radius",
        ),
        (
            {"adhesion": {"work": 1e-3}},
            {"indenter": {"shape": "pyramid", "half_angle": 65.0, "faces": 3}},
            "experiment.adhesion",
            "circular contact",
        ),
        (
            {"adhesion": {"work": 1e-3, "range": 1e-3}},
            {"indenter": {"shape": "cone", "half_angle": 70.0}},
            "experiment.adhesion.range",
            "a radius R",
        ),
        (
            {"calibration": {"stiffness": 0.1}, "history": RAMP},
            {},
            "experiment.calibration.stiffness",
            "cantilever",
        ),
        (
            {"calibration": {"R": 0.1}, "history": RAMP},
            {"indenter": {"shape": "cone", "half_angle": 70.0}},
            "experiment.calibration.R",
            "has none",
        ),
        ({"adhesion": {"work": -1.0}}, {}, "experiment.adhesion.work", "> 0"),
        ({"cantilever": {"k": 1.0}}, {}, "experiment.cantilever.k", "unknown key"),
        (
            {"history": RAMP, "relaxation": SLOW},
            {"material": HYPERELASTIC},
            "material.relaxation.of",
            "not linear",
        ),
        (
            {"history": RAMP, "cantilever": {"stiffness": 1.0}},
            {"contact": {"method": "nitsche"}},
            "experiment.cantilever",
            "row by row",
        ),
        (
            {"history": RAMP, "relaxation": SLOW},
            {"contact": {"friction": 0.3}},
            "material.relaxation.of",
            "friction, or adhesion over a range",
        ),
        ({"history": RAMP}, {"output": {"fields": "all"}}, "output.fields", "no fields"),
        (
            {"adhesion": {"work": 1e-3}},
            {"contact": {"friction": "stick"}},
            "experiment",
            "without friction",
        ),
        (
            {"adhesion": {"work": 1e-3}},
            {"body": {"shape": "strip", "width": 4.0, "height": 1.0}},
            "experiment.adhesion",
            "circular contact",
        ),
        (
            {"history": RAMP, "calibration": {"R": 0.1}},
            {"contact": {"gap": "current"}},
            "experiment.calibration",
            "needs an elastic curve",
        ),
        ({"history": [[0, 0], [1, 2.0]]}, {}, "loading", "beyond the body's thickness"),
        ({"adhesion": {"work": 1e15}}, {}, "experiment.adhesion", "beyond the range of the theory"),
        (
            {"adhesion": {"work": 1e-12}},
            {"solver": {"method": "condensed"}},
            "experiment.adhesion.work",
            "at pull-off",
        ),
        (
            {"adhesion": {"work": 10.0}},
            {"body": {"shape": "cylinder", "radius": 1.0, "height": 1.0}},
            "experiment.adhesion.work",
            "the body ends at",
        ),
        (
            {"adhesion": {"work": 1e-3}},
            {
                "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0},
                "mesh": {"symmetry": "full"},
            },
            "experiment.adhesion",
            "circular contact",
        ),
        (
            {"relaxation": SLOW, "force_history": RAMP},
            {
                "body": {"shape": "strip", "width": 4.0, "height": 1.0, "sides": "roller"},
                "solver": {"method": "theory"},
            },
            "material.relaxation",
            "needs time stepping",
        ),
    ],
)
def test_refusals(
    experiment: dict[str, Any], sections: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words) as refused:
        resolve(config_from_mapping(placed(SCENE | {"experiment": experiment} | sections)))
    errors = getattr(refused.value, "errors", [refused.value])
    assert any(error.key.replace("[", r"\[").replace("]", r"\]") == key for error in errors)


def test_a_history_is_a_loading() -> None:
    scene = resolve(
        config_from_mapping(SCENE | {"loading": {"history": [[0, 0], [1, 0.02], [2, 0]]}})
    )
    assert scene.physics.path.control == "depth" and len(scene.physics.deltas) == 10
    assert max(scene.physics.deltas) == pytest.approx(0.02)
    forces = resolve(
        config_from_mapping(SCENE | {"loading": {"force_history": [[0, 0], [1, 1e-3]]}})
    )
    assert forces.physics.path.control == "force"
    with pytest.raises(ConfigError, match="contradicts delta"):
        config_from_mapping(SCENE | {"loading": {"delta": 0.01, "history": RAMP}})
    with pytest.raises(ConfigError, match="applies only to a single delta"):
        config_from_mapping(SCENE | {"loading": {"history": RAMP, "steps": 3}})


@pytest.mark.parametrize(
    ("key", "section"),
    [("history", "loading"), ("force_history", "loading"), ("relaxation", "material")],
)
def test_keys_that_have_moved(key: str, section: str) -> None:
    with pytest.raises(ConfigError) as refused:
        config_from_mapping(SCENE | {"experiment": {key: SLOW if key == "relaxation" else RAMP}})
    assert refused.value.key == f"experiment.{key}" and "has moved" in refused.value.problem
    assert refused.value.remedy == f"write {section}.{key}"


def test_what_relaxes_does_so_alike_everywhere() -> None:
    law = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
    unlike = [law | {"relaxation": SLOW}, law]
    body = {
        "shape": "layer",
        "height": 1.0,
        "layers": [{"thickness": 0.5, "material": one} for one in unlike],
    }
    given = {"body": body, "indenter": SCENE["indenter"], "loading": {"history": RAMP}}
    with pytest.raises(ConfigError, match=r"differs from body.layers\[1\].material") as refused:
        config_from_mapping(given)
    assert refused.value.key == "body.layers[0].material.relaxation"
    body["layers"][1]["material"] = unlike[0]  # type: ignore[index]
    assert resolve(config_from_mapping(given)).relaxation is not None


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([0.5, 0.2], "is not later than the previous time"),
        ([2.0], "outside the history"),
        ([-1.0, 0.5], "outside"),
    ],
)
def test_times_are_those_of_the_history(times: list[float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        config_from_mapping(SCENE | {"loading": {"history": RAMP, "times": times}})
    with pytest.raises(ConfigError, match="applies only to a history"):
        config_from_mapping(SCENE | {"loading": {"delta": 0.01, "times": [1.0]}})


def test_times_of_forces_on_a_whole_body_pass_the_other_steps() -> None:
    given = SCENE | {
        "material": HYPERELASTIC,
        "loading": {"force_history": [[0, 0], [1, 1e-3]], "times": [0.5]},
    }
    path = resolve(config_from_mapping(given)).physics.path
    assert path.control == "force" and path.times == (0.5,) and len(path.segment(1)) > 5


def test_a_soft_spring_keeps_the_tip_back() -> None:
    """With a soft cantilever the depth is where the spring balances the force of the half-space."""
    given = {
        "experiment": {"cantilever": {"stiffness": 1e-3}},
        "loading": {"history": [[0, 0], [1, 1.0]]},
    }
    depth = max(resolve(config_from_mapping(SCENE | given)).physics.deltas)
    assert depth + 1e3 * 4 / 3 / 0.91 * depth**1.5 == pytest.approx(1.0, rel=1e-6)


def test_a_deeper_history_sizes_the_mesh() -> None:
    shallow, deep = (
        resolve(
            config_from_mapping(
                SCENE | {"loading": {"history": [[0, 0], [1, depth]]}}, ["solver.method=condensed"]
            )
        )
        for depth in (0.01, 0.04)
    )
    assert deep.sizes.fine_radius == pytest.approx(2 * shallow.sizes.fine_radius, rel=0.1)


def test_the_section_is_written_and_read_back() -> None:
    given = placed(
        SCENE | {"experiment": {"relaxation": SLOW, "history": RAMP, "frequencies": [1.0, 2.0]}}
    )
    config = config_from_mapping(given | {"loading": {"history": RAMP, "times": [0.5, 1.0]}})
    assert loads(to_yaml(config)) == config
    assert (
        loads(to_yaml(config), overrides=["material.relaxation.prony[0][0]=0.4"]).material
        != config.material
    )


def test_plan_says_what_is_exact() -> None:
    def said(experiment: dict[str, Any]) -> dict[str, str]:
        choices = resolve(
            config_from_mapping(placed(SCENE | {"experiment": experiment}))
        ).plan.choices
        return {
            choice.key: f"{choice.value}: {choice.why}" for choice in choices if choice.key in KEYS
        }

    assert "JKR" in said({"adhesion": {"work": 1e-3}})["experiment.adhesion"]
    assert "Ting" in said({"relaxation": SLOW, "history": RAMP})["time"]
    back = [[0, 0], [1, 0.01], [2, 0.0], [3, 0.01]]
    assert "time stepping" in said({"relaxation": SLOW, "history": back})["time"]
    assert "every point is an equilibrium" in said({"history": RAMP})["time"]
    rubber = resolve(
        config_from_mapping(SCENE | {"material": HYPERELASTIC, "loading": {"history": RAMP}})
    )
    (time,) = (choice for choice in rubber.plan.choices if choice.key == "time")
    assert time.value == "steps" and "not linear" in time.why and "t" in rubber.columns


KEYS = ("time", "experiment.adhesion")
