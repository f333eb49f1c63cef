"""Remedies of a path that ended early: their order, their cost and their report."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.model.state import State
from indent_sim.run.remedies import has_remedies, remedies, try_remedies
from indent_sim.scene.scene import Scene, resolve

RUBBER = {"model": "neo_hookean", "E": 10.0, "nu": 0.45}
PUNCH = {
    "body": {"shape": "cylinder", "radius": 6.0, "height": 4.0, "base": "fixed", "sides": "free"},
    "material": RUBBER,
    "indenter": {"shape": "flat_punch", "radius": 1.0, "edge_radius": 0.15},
    "loading": {"delta": 1.5, "steps": 3},
    "mesh": {"h_contact": 0.25},
}


def configured(**sections: Any) -> tuple[Config, Scene]:
    config = config_from_mapping(PUNCH | sections)
    return config, resolve(config)


def walk_to(ends: dict[float, int], iterations: int = 10) -> Any:
    """Load stepping that ends at a step given by the scene's edge radius, else at the first."""

    def walk(scene: Scene) -> Iterator[State]:
        last = ends.get(
            getattr(scene.physics.indenter, "edge_radius", 0.0) * scene.physics.scales.length, 1
        )
        for step, delta in enumerate(scene.physics.deltas, start=1):
            depth = delta * scene.physics.scales.depth
            numbers = (
                (depth, 10.0 * depth, 1.0, 1.0, 0.0, 1.0) if step <= last else (depth, *(nan,) * 5)
            )
            yield State(step, *numbers, iterations, 0.0, converged=step <= last)
            if step > last:
                return

    return walk


def test_rounder_edges_come_first_then_smaller_and_larger_elements() -> None:
    config, scene = configured()
    found = [(remedy.key, remedy.value) for remedy in remedies(config, scene)]
    rounder = [("indenter.edge_radius", 0.3), ("indenter.edge_radius", 1.0)]
    assert found == [*rounder, ("mesh.h_contact", 0.125), ("mesh.h_contact", 0.5)]


def test_the_first_that_helps_is_the_last_that_is_tried() -> None:
    config, scene = configured()
    said = try_remedies(remedies(config, scene), 2, 1000, resolve, walk_to({1.0: 3}))
    ends, comes = (
        "with indenter.edge_radius: 0.3 the run ends after delta = 0.5",
        "with indenter.edge_radius: 1 the run reaches delta = 1, where the force is 10",
    )
    assert said.startswith(f"; tried: {ends}; {comes}")
    assert "h_contact" not in said


def test_all_tries_cost_no_more_than_the_run() -> None:
    """No remedy begins after the remedies have used as many iterations as the run.

    Of 15 iterations the first try takes 20, with its last row.
    """
    config, scene = configured()
    said = try_remedies(remedies(config, scene), 3, 15, resolve, walk_to({}))
    assert said == "; tried: with indenter.edge_radius: 0.3 the run ends after delta = 0.5"


@pytest.mark.parametrize(
    "sections",
    [
        {"material": {"model": "linear_elastic", "E": 10.0, "nu": 0.3}},
        {"loading": {"force": 1.0}},
        {"contact": {"method": "auto", "gap": "reference"}},
    ],
    ids=["small strain", "forces", "gap at the undeformed point"],
)
def test_nothing_is_tried_where_nothing_is_known_to_help(sections: dict[str, Any]) -> None:
    assert not has_remedies(configured(**sections)[1])
    assert has_remedies(configured()[1])


def test_a_plate_has_no_edge_to_round() -> None:
    config, scene = configured(indenter={"shape": "flat_punch", "radius": 6.0})
    assert [remedy.key for remedy in remedies(config, scene)] == [
        "mesh.h_contact",
        "mesh.h_contact",
    ]
