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


def failed(step: int, t: float | None = None) -> State:
    return State(step, *(nan,) * 6, 0, 0.0, converged=False, t=t)


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
    found = [remedy.text for remedy in remedies(config, scene)]
    rounder = ["indenter.edge_radius: 0.3", "indenter.edge_radius: 1"]
    assert found == [*rounder, "mesh.h_contact: 0.125", "mesh.h_contact: 0.5"]


def test_the_first_that_helps_is_the_last_that_is_tried() -> None:
    config, scene = configured()
    said = try_remedies(
        remedies(config, scene), failed(2), 1000, scene.cost.dofs, resolve, walk_to({1.0: 3})
    )
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
    said = try_remedies(
        remedies(config, scene), failed(3), 15, scene.cost.dofs, resolve, walk_to({})
    )
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


STUCK_SLIDE: dict[str, Any] = {
    "body": {"shape": "strip", "width": 6.0, "height": 1.0, "base": "fixed", "sides": "roller"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.2},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "contact": {"friction": "stick"},
    "loading": {"delta": 0.01, "steps": 2, "slide": {"to": [0.005], "steps": 2}},
    "mesh": {"h_contact": 0.02},
}


def test_a_slide_that_sticks_is_tried_with_the_largest_friction() -> None:
    """And with nothing else; a tip that may slip, or that does not slide, has no remedy."""
    config, scene = configured(**STUCK_SLIDE)
    assert has_remedies(scene)
    (found,) = remedies(config, scene)
    assert found.text == "contact.friction: 5"
    assert found.config.contact.friction == 5.0
    assert not has_remedies(configured(**STUCK_SLIDE | {"contact": {"friction": 0.3}})[1])
    assert not has_remedies(configured(**STUCK_SLIDE | {"loading": {"delta": 0.01}})[1])


def test_a_plate_has_no_edge_to_round() -> None:
    config, scene = configured(indenter={"shape": "flat_punch", "radius": 6.0})
    assert [list(remedy.values) for remedy in remedies(config, scene)] == [["mesh.h_contact"]] * 2


GEL = {"model": "gel", "G": 1.0, "n_omega": 1e-3, "chi": 0.6, "stretch": 1.4}
SWELLING: dict[str, Any] = {
    "material": GEL | {"flow": {"diffusivity": 1.0}},
    "indenter": {"shape": "sphere", "R": 3.0},
    "drainage": {"bath": 0.0},
    "mesh": {},
}


@pytest.mark.parametrize("key", ["history", "force_history"])
def test_for_a_gel_the_remedies_reach_the_time_of_the_failed_row(key: str) -> None:
    """The path of a gel is tried up to the time of the failed row, also with other time steps."""
    loading = {key: [[0, 0], [10, 0.05], [100, 0.05]], "times": "auto"}
    config, scene = configured(**SWELLING, loading=loading)
    assert has_remedies(scene)
    found = remedies(config, scene)
    assert [list(one.values) for one in found] == [["mesh.h_contact"]] * 2
    last_times: list[float] = []

    def solve(tried: Scene) -> Iterator[State]:
        path = tried.physics.path
        last_times.append(path.times[-1])
        assert len(path.values) == len(tried.physics.deltas) == len(path.times)
        yield State(len(path.times), 0.05, *(1.0,) * 5, 1, 0.0, t=path.times[-1])

    row = next(step for step, t in enumerate(scene.physics.path.times, start=1) if t >= 7.0)
    time = scene.physics.path.times[row - 1]
    said = try_remedies(found, failed(row, time), 1000, scene.cost.dofs, resolve, solve)
    assert said.endswith(f"reaches t = {last_times[-1]:.6g}, delta = 0.05, where the force is 1")
    assert 7.0 <= last_times[0] < 20.0 and len(last_times) == 1


def test_elements_at_drained_faces_change_with_those_in_the_contact() -> None:
    """A given h_contact alone would leave the small elements at drained faces out."""
    config, scene = configured(
        material=RUBBER | {"flow": {"diffusivity": 1.0}},
        indenter={"shape": "sphere", "R": 3.0},
        loading={"history": [[0, 0], [1e-3, 0.05], [1, 0.05]]},
        mesh={},
    )
    finer, coarser = remedies(config, scene)
    assert list(finer.values) == list(coarser.values) == ["mesh.h_contact", "mesh.h_film"]
    for one, factor in ((finer, 0.5), (coarser, 2.0)):
        sizes = resolve(one.config).sizes
        h_film = min(scene.sizes.h_film or 0.0, scene.sizes.h_contact)
        assert sizes.h_film == pytest.approx(factor * h_film, rel=0.01)
        assert sizes.h_contact == pytest.approx(factor * scene.sizes.h_contact, rel=0.01)
