"""Relaxation in a scene file: refusals with key and remedy, and the increments in time."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping, loads, to_yaml
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

SHEAR = {"prony": [[0.4, 0.1], [0.3, 1.0]], "of": "shear"}
ALL = SHEAR | {"of": "all"}
SOFT: dict[str, Any] = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
RUBBER: dict[str, Any] = {"model": "mooney_rivlin", "C10": 0.2, "C01": 0.0, "nu": 0.45}
HISTORY = [[0, 0], [1, 0.02], [8, 0.02]]
SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"},
    "material": SOFT | {"relaxation": SHEAR},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"history": HISTORY},
    "mesh": {"h_contact": 0.05},
}
NEO = {"model": "neo_hookean", "E": 1.0, "nu": 0.3, "relaxation": SHEAR}
TWO = [{"thickness": 0.5, "material": SOFT | {"relaxation": ALL}}, {"thickness": 0.5}]


@pytest.mark.parametrize(
    ("sections", "key", "words"),
    [
        ({"loading": {"delta": 0.02}}, "material.relaxation", "needs a load path in time"),
        ({"material": NEO}, "material.relaxation.of", "depends on the volume; use mooney_rivlin"),
        (
            {"body": SCENE["body"] | {"layers": TWO}},
            "body.layers[0].material.relaxation.of",
            "of: shear",
        ),
        ({"contact": {"method": "nitsche"}}, "contact.method", "stress of the body, which relaxes"),
        (
            {"contact": {"adhesion": {"work": 1e-3, "range": 0.1}}},
            "contact.adhesion",
            "not verified",
        ),
        (
            {"solver": {"method": "theory"}},
            "solver.method",
            "not include relaxation of the shear modulus",
        ),
        ({"solver": {"method": "condensed"}}, "solver.method", "bulk modulus does not"),
        (
            {"experiment": {"frequencies": [1.0]}},
            "experiment.frequencies",
            "needs an elastic load curve",
        ),
        (
            {"experiment": {"cantilever": {"stiffness": 1.0}}},
            "experiment.cantilever",
            "needs an elastic curve",
        ),
        ({"material": RUBBER | {"relaxation": ALL}}, "material.relaxation.of", "of: shear"),
        (
            {"material": SOFT | {"relaxation": ALL}, "contact": {"friction": 0.3}},
            "relaxation.of",
            "of: shear",
        ),
        (
            {
                "material": SOFT
                | {"relaxation": {"power_law": {"exponent": 0.2, "time": 1.0}, "of": "shear"}},
                "loading": {"history": [[0, 0.02], [1, 0.02]]},
            },
            "loading.history",
            "power law is infinite",
        ),
        (
            {"body": {"shape": "box", "size": [2.0, 2.0, 1.0]}, "solver": {"linear": "iterative"}},
            "solver.linear",
            "are factorized",
        ),
    ],
)
def test_what_does_not_go_with_shear_that_relaxes_is_refused(
    sections: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(ConfigError) as error:
        resolve(config_from_mapping(SCENE | sections))
    assert key in str(error.value) and words in str(error.value)


def test_a_scene_comes_back_from_its_own_text() -> None:
    config = config_from_mapping(SCENE)
    assert loads(to_yaml(config)) == config


@pytest.mark.parametrize("material", [SOFT | {"relaxation": SHEAR}, RUBBER | {"relaxation": SHEAR}])
def test_shear_is_followed_from_a_twentieth_of_its_shortest_time(material: dict[str, Any]) -> None:
    found = resolve(config_from_mapping(SCENE | {"material": material}))
    assert (
        found.solver.method == "newton"
        and found.history_on_curve is None
        and found.relaxation is None
    )
    assert found.physics.path.times[1] == pytest.approx(0.1 / 20, rel=1e-12)
    (region,) = found.physics.domain.regions
    assert region.relaxation_series and region.relaxation_series[1:] == ((0.4, 0.3), (0.1, 1.0))
    assert region.relaxation_series.long_term == pytest.approx(0.3, rel=1e-12)


def test_what_relaxes_as_a_whole_stays_on_its_curve() -> None:
    found = resolve(config_from_mapping(SCENE | {"material": SOFT | {"relaxation": ALL}}))
    assert found.solver.method == "condensed" and found.history_on_curve is not None
    assert found.relaxation is not None and not found.physics.is_time_dependent
    assert all(region.relaxation_series is None for region in found.physics.domain.regions)


def test_a_layer_may_relax_alone_or_by_a_law_of_its_own() -> None:
    layers = [{"thickness": 0.5, "material": SOFT}, {"thickness": 0.5}]
    other = SOFT | {"relaxation": {"prony": [[0.5, 10.0]], "of": "shear"}}
    for layer, times in ((SOFT, ((), (0.1, 1.0))), (other, ((10.0,), (0.1, 1.0)))):
        layers[0]["material"] = layer
        found = resolve(config_from_mapping(SCENE | {"body": SCENE["body"] | {"layers": layers}}))
        assert (
            tuple(
                one.relaxation_series.times if one.relaxation_series else ()
                for one in found.physics.domain.regions
            )
            == times
        )
