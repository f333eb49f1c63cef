"""Increments of a body that yields for a requested accuracy."""

from __future__ import annotations

from itertools import pairwise
from math import sqrt

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.load_path import LoadPath
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve
from indent_sim.scene.yield_increments import increment_count, with_yield_increments

TARGET = 0.05


def points(path: LoadPath) -> list[float]:
    """Return all depths of a path, from the undeformed body on."""
    steps = range(1, len(path.values) + 1)
    return [0.0, *(depth for step in steps for depth, _ in path.segment(step))]


@pytest.mark.parametrize(
    "values", [(0.1, 0.4, 1.0), (1.0, 0.9, 0.0), (0.5, 0.3, 0.8), (-0.1, 0.2), (0.5, -0.1)]
)
def test_increments_are_short(values: tuple[float, ...]) -> None:
    """At most the accuracy, relative to the depth, from the first small increment on."""
    path = with_yield_increments(LoadPath("depth", values), TARGET)
    assert path.values == values
    depths = points(path)
    assert increment_count(path) == len(depths) - 1
    first = next(value for value in values if value > 0)
    for before, after in pairwise(depths):
        shallow = min(before, after)
        if shallow > 1.001 * sqrt(TARGET) * first:
            assert abs(after - before) <= 1.001 * TARGET * shallow
        else:
            assert max(before, after) <= max(1.001 * (1 + TARGET) * sqrt(TARGET) * first, shallow)


def test_halved_increments_have_the_same_rows() -> None:
    path = with_yield_increments(LoadPath("depth", (0.5, 1.0, 0.9)), TARGET)
    halved = path.with_halved_increments()
    assert halved.values[1::2] == path.values
    assert len(points(halved)) == 2 * len(points(path)) - 1


def scene(accuracy: float | None, material: str = "metal", shape: str = "cone"):
    """Scene of a cone, or of a plate."""
    plasticity = {"plasticity": {"yield_stress": 1.0}} if material == "metal" else {}
    tip = {"cone": {"half_angle": 70.3}, "plate": {}}[shape]
    config = {
        "body": {"shape": "cylinder", "radius": 10.0, "height": 10.0},
        "material": {"model": "hencky", "E": 100.0, "nu": 0.3} | plasticity,
        "indenter": {"shape": shape} | tip,
        "loading": {"delta": 0.5, "steps": 5},
    }
    return resolve(config_from_mapping(config | ({"accuracy": accuracy} if accuracy else {})))


def test_which_scenes_have_increments() -> None:
    """Those of a body that yields with an accuracy, except under a plate, whose rows are exact."""
    assert scene(TARGET).physics.path.turns
    assert not any("increments" in text for text in scene(TARGET).plan.warnings)
    assert any("increments" in text for text in scene(None).plan.warnings)
    for other in (scene(None), scene(TARGET, "rubber"), scene(TARGET, shape="plate")):
        assert not other.physics.path.turns


def test_too_many_increments_are_refused() -> None:
    with pytest.raises(ConfigError, match="load increments, since the body yields"):
        scene(1e-4)
