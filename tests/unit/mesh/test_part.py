"""The modelled part: what its outline encloses, how far its walls are, which facets lie on which surface."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from scenes import BOX, CYLINDER, STRIP, scene

from indent_sim.mesh.grid import named_surfaces
from indent_sim.mesh.part import Part, Region, Side, polygon
from indent_sim.model.kinematics import PlaneStrain
from indent_sim.model.materials import LinearElastic


def part_of(outline: tuple[Side, ...]) -> Part:
    region = Region("body", LinearElastic(E=1.0, nu=0.3), "displacement")
    return Part(PlaneStrain(), "full", 1, outline, 1.0, (region,), {})


@pytest.mark.parametrize(("symmetry", "copies"), [("full", 1), ("half", 2), ("quarter", 4)])
def test_copies_of_the_outline_are_the_whole_cross_section(symmetry: str, copies: int) -> None:
    """Arcs are circles: pi R^2 and lx ly to rounding, whatever is cut away."""
    for body, area in ((CYLINDER, pi * CYLINDER["radius"] ** 2), (BOX, BOX["size"][0] * BOX["size"][1])):
        part = scene(body, mesh={"symmetry": symmetry, "h_contact": 0.2}).physics.part
        assert part.copies == copies
        assert part.copies * part.area == pytest.approx(area, rel=1e-12)


def test_a_side_knows_its_normal_and_an_arc_has_none() -> None:
    whole = scene(CYLINDER, mesh={"symmetry": "half", "h_contact": 0.2}).physics.part
    section = scene(STRIP).physics.part
    assert whole.normal("r_max") is None and whole.normal("base") == whole.normal("top") == 2
    assert {whole.normal(name) for name in ("x_min", "y_min") if name in whole.supports} <= {0, 1}
    assert section.normal("x_max") == 0 and section.normal("base") == section.normal("top") == 1


def test_walls_are_as_far_from_the_tip_as_they_are_drawn() -> None:
    off = {"indenter": {"shape": "paraboloid", "R": 1.0, "center": [0.3, 0.0]}, "mesh": {"h_contact": 0.2}}
    found = scene(CYLINDER, **off)
    distances = found.physics.part.distances(found.physics.center)
    assert distances == pytest.approx({"r_max": CYLINDER["radius"] - 0.3, "y_min": 0.0})
    strip = scene(STRIP, indenter={"shape": "paraboloid", "R": 1.0, "center": [0.4]})
    assert strip.physics.part.distances(strip.physics.center) == pytest.approx(
        {"x_min": 0.4 / STRIP["height"], "x_max": (STRIP["width"] - 0.4) / STRIP["height"]}
    )


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_facets_are_on_the_surface_that_holds_their_corners() -> None:
    part = part_of(polygon(("base", "x_max", "top", "x_min"), tuple(map(tuple, SQUARE.tolist()))))
    found = named_surfaces(SQUARE, np.array([[0, 1, 2], [0, 2, 3]]), part, finest=0.5)
    edges = {name: {frozenset(facet) for facet in facets.tolist()} for name, facets in found.items()}
    assert edges == {"base": {frozenset({0, 1})}, "x_max": {frozenset({1, 2})},
                     "top": {frozenset({2, 3})}, "x_min": {frozenset({3, 0})}}  # fmt: skip


def test_a_chord_between_points_of_an_arc_is_no_surface() -> None:
    """Four points of a half circle in two triangles: the chord between them is no boundary."""
    half = sqrt(0.5)
    points = np.array([[1.0, 0.0], [half, half], [-half, half], [-1.0, 0.0]])
    arc = Side("top", (1.0, 0.0), (-1.0, 0.0), middle=(0.0, 0.0))
    part = part_of((arc, Side("base", (-1.0, 0.0), (1.0, 0.0))))
    found = named_surfaces(points, np.array([[0, 1, 2], [0, 2, 3]]), part, finest=0.5)
    assert {frozenset(facet) for facet in found["top"].tolist()} == {frozenset({k, k + 1}) for k in range(3)}
    assert part.area == pytest.approx(pi / 2, rel=1e-12)
