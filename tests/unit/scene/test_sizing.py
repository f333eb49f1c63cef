"""Element sizes below tips that go deep into a body whose surface slides along them."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.mesh.sizes import Sizes
from indent_sim.scene.scene import resolve

ROD = {"shape": "flat_punch", "radius": 1.0, "edge_radius": 1.0}


def sizes(depth: float, tip: dict[str, Any] = ROD, **sections: Any) -> Sizes:
    """Element sizes [tip radii] below a tip in a block of rubber 20 radii high."""
    scene = resolve(
        config_from_mapping(
            {
                "body": {
                    "shape": "cylinder",
                    "radius": 20.0,
                    "height": 20.0,
                    "base": "fixed",
                    "sides": "free",
                },
                "material": {"model": "neo_hookean", "E": 10.0, "nu": 0.49},
                "indenter": tip,
                "loading": {"delta": depth, "steps": 1},
            }
            | sections
        )
    )
    return scene.sizes


def test_what_slides_outwards_is_meshed_finely_beneath_a_deep_rod() -> None:
    """Below a deep rod the elements at the axis are refined.

    At a depth of five radii a disc of a tenth of the radius is spread over the whole end of the
    rod.
    """
    shallow, deep = sizes(0.9), sizes(5.0)
    assert shallow.h_axis is None
    assert deep.h_axis is not None
    assert deep.h_axis < 0.1 * shallow.h_contact
    assert deep.grading < 0.1 < shallow.grading  # what is stretched is a column about the axis


def test_elements_go_around_the_edge_of_a_punch_wherever_it_is() -> None:
    """Five elements per radius of the edge lie below the face, twice as many at the edge.

    The surface that is at the edge now was below the face.
    """
    deep = sizes(5.0, ROD | {"edge_radius": 0.2})
    assert 20 * deep.h_contact == pytest.approx(0.2 / 5)
    assert deep.h_edge == pytest.approx(deep.h_contact / 2)
    assert deep.h_axis is not None
    assert deep.h_axis < 0.1 * deep.h_contact


def test_an_edge_that_no_elements_resolve_changes_no_sizes() -> None:
    """Below a sharp punch the sizes are the same at any depth: its edge ends the path early."""
    assert sizes(5.0, ROD | {"edge_radius": 0.0}) == sizes(0.9, ROD | {"edge_radius": 0.0})


@pytest.mark.parametrize(
    "sections",
    [
        {"contact": {"friction": "stick"}},
        {"mesh": {"h_contact": 0.1}},
        {"contact": {"method": "auto", "gap": "reference"}},
    ],
    ids=["what sticks does not slide", "sizes that are given stay", "no surface goes around a tip"],
)
def test_elsewhere_nothing_is_finer(sections: dict[str, Any]) -> None:
    assert sizes(5.0, **sections).h_axis is None
