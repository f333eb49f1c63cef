"""Model domain: area of its outline, distances of its walls, and facets on its surfaces."""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scenes import BOX, CYLINDER, STRIP, scene

from indent_sim.mesh.grid import named_surfaces
from indent_sim.mesh.model_domain import ModelDomain, Region, Side, nearest_on_sphere, polygon_sides
from indent_sim.model.kinematics import PlaneStrain
from indent_sim.model.linear_elasticity import LinearElastic


def part_of(outline: tuple[Side, ...]) -> ModelDomain:
    region = Region("body", LinearElastic(E=1.0, nu=0.3), "displacement", -1.0)
    return ModelDomain(PlaneStrain(), "full", 1, outline, 1.0, (region,), {})


@pytest.mark.parametrize(("symmetry", "copies"), [("full", 1), ("half", 2), ("quarter", 4)])
def test_copies_of_the_outline_are_the_whole_cross_section(symmetry: str, copies: int) -> None:
    """The area of the model domain times the symmetry factor is that of the body.

    Arcs are exact: pi R^2 and lx ly are reproduced to rounding.
    """
    for body, area in (
        (CYLINDER, pi * CYLINDER["radius"] ** 2),
        (BOX, BOX["size"][0] * BOX["size"][1]),
    ):
        part = scene(body, mesh={"symmetry": symmetry, "h_contact": 0.2}).physics.domain
        assert part.symmetry_factor == copies
        assert part.symmetry_factor * part.area == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("body", [CYLINDER, BOX])
def test_what_is_modelled_lies_where_x_and_y_grow(body: dict[str, Any]) -> None:
    """The model domain extends from the mirror planes, through the tip, to larger x and y."""
    for symmetry, planes in (("half", 1), ("quarter", 2)):
        base = scene(body, mesh={"symmetry": symmetry, "h_contact": 0.2})
        lows = [low for low, _ in base.physics.domain.extent[:2]]
        assert (
            sum(low == pytest.approx(c) for low, c in zip(lows, base.physics.center, strict=True))
            == planes
        )


def test_a_side_knows_its_normal_and_an_arc_has_none() -> None:
    whole = scene(CYLINDER, mesh={"symmetry": "half", "h_contact": 0.2}).physics.domain
    section = scene(STRIP).physics.domain
    assert (
        whole.normal_component("r_max") is None
        and whole.normal_component("base") == whole.normal_component("top") == 2
    )
    assert {
        whole.normal_component(name) for name in ("x_min", "y_min") if name in whole.supports
    } <= {0, 1}
    assert (
        section.normal_component("x_max") == 0
        and section.normal_component("base") == section.normal_component("top") == 1
    )


def test_walls_are_as_far_from_the_tip_as_they_are_drawn() -> None:
    off = {
        "indenter": {"shape": "paraboloid", "R": 1.0, "center": [0.3, 0.0]},
        "mesh": {"h_contact": 0.2},
    }
    found = scene(CYLINDER, **off)
    distances = found.physics.domain.wall_distances(found.physics.center)
    assert distances == pytest.approx({"r_max": CYLINDER["radius"] - 0.3, "y_min": 0.0})
    strip = scene(STRIP, indenter={"shape": "paraboloid", "R": 1.0, "center": [0.4]})
    assert strip.physics.domain.wall_distances(strip.physics.center) == pytest.approx(
        {"x_min": 0.4 / STRIP["height"], "x_max": (STRIP["width"] - 0.4) / STRIP["height"]}
    )


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_facets_are_on_the_surface_that_holds_their_corners() -> None:
    part = part_of(
        polygon_sides(("base", "x_max", "top", "x_min"), tuple(map(tuple, SQUARE.tolist())))
    )
    found = named_surfaces(SQUARE, np.array([[0, 1, 2], [0, 2, 3]]), part, finest=0.5)
    edges = {
        name: {frozenset(facet) for facet in facets.tolist()} for name, facets in found.items()
    }
    assert edges == {
        "base": {frozenset({0, 1})},
        "x_max": {frozenset({1, 2})},
        "top": {frozenset({2, 3})},
        "x_min": {frozenset({3, 0})},
    }


def test_a_chord_between_points_of_an_arc_is_no_surface() -> None:
    """A chord between distant points of an arc is not a boundary facet.

    Two triangles over four points of a half circle have such a chord in common.
    """
    half = sqrt(0.5)
    points = np.array([[1.0, 0.0], [half, half], [-half, half], [-1.0, 0.0]])
    arc = Side("top", (1.0, 0.0), (-1.0, 0.0), center=(0.0, 0.0))
    part = part_of((arc, Side("base", (-1.0, 0.0), (1.0, 0.0))))
    found = named_surfaces(points, np.array([[0, 1, 2], [0, 2, 3]]), part, finest=0.5)
    assert {frozenset(facet) for facet in found["top"].tolist()} == {
        frozenset({k, k + 1}) for k in range(3)
    }
    assert part.area == pytest.approx(pi / 2, rel=1e-12)


QUARTER = Side("top", (1.0, -1.0), (0.0, 0.0), center=(0.0, -1.0))  # of the circle about (0, -1)


def test_an_arc_is_no_further_than_its_ends() -> None:
    """The distance from an arc is that from its nearer end for points beyond it."""
    angle = np.radians([0.0, 30.0, 90.0, 120.0, -90.0])
    away = QUARTER.distance(np.cos(angle), -1 + np.sin(angle))
    assert away == pytest.approx([0, 0, 0, 2 * np.sin(np.radians(15)), sqrt(2)], abs=1e-15)
    assert QUARTER.distance(np.array([0.5]), np.array([-1.0])) == pytest.approx([0.5])


@pytest.mark.parametrize(
    ("body", "volume"),
    [
        ({"shape": "ball", "radius": 1.0}, 2 / 3 * pi),
        ({"shape": "ball", "radius": 1.0, "base": "fixed"}, 4 / 3 * pi),
        ({"shape": "ellipsoid", "radius": 1.0, "height": 0.5}, pi / 6),
        ({"shape": "ellipsoid", "radius": 1.0, "height": 6.0, "base": "unbonded"}, 4 * pi),
        ({"shape": "cap", "base_radius": 2.0, "height": 1.0}, pi / 6 * 13),
        ({"shape": "cap", "base_radius": 1.0, "height": 1.5}, pi / 4 * 5.25),
    ],
)
def test_the_section_of_a_round_body_encloses_its_volume(body: dict, volume: float) -> None:
    """The outline of a spherical body encloses pi h (3 b^2 + h^2)/6 by Pappus' rule.

    Arcs are replaced by 2000 chords, which leaves an error below 1e-6.
    """
    part = scene(body, mesh={"h_contact": 0.2}).physics.domain
    height = body.get("height", 2.0)
    is_halved = body["shape"] != "cap" and "base" not in body
    scale = height / 2 if is_halved else height
    total = 0.0
    for side in part.outline:
        share = np.linspace(0, 1, 2001)
        if side.center is None:
            r, z = (a + (b - a) * share for a, b in zip(side.start, side.end, strict=True))
        else:
            begin = np.arctan2(side.start[1] - side.center[1], side.start[0] - side.center[0])
            r = side.center[0] + side.radius * np.cos(begin + side.arc_angle * share)
            z = side.center[1] + side.stretch * side.radius * np.sin(begin + side.arc_angle * share)
        total += float(np.sum((r[1:] ** 2 + r[1:] * r[:-1] + r[:-1] ** 2) / 3 * np.diff(z)) * pi)
    assert total * scale**3 == pytest.approx(volume, rel=1e-6)


def test_an_elliptic_top_has_the_curvature_of_its_apex() -> None:
    """The apex of an ellipsoid has the radius of curvature radius^2/(height/2)."""
    part = scene({"shape": "ellipsoid", "radius": 2.0, "height": 1.0}).physics.domain
    assert part.top_radius == pytest.approx(2.0**2 / 0.5 / 0.5)
    assert part.smallest_semi_axis == pytest.approx(1.0)
    assert part.area == pytest.approx(pi * 4.0 * 1.0 / 4)


def test_the_halves_of_a_ball_are_two_surfaces() -> None:
    """Top and base of a ball are arcs of one circle; each facet lies on the arc around it."""
    part = scene({"shape": "ball", "radius": 1.0, "base": "fixed"}).physics.domain
    angle = np.radians([-90.0, -45.0, 0.0, 45.0, 90.0])
    points = np.vstack(
        [[0.0, -0.5], np.column_stack([0.5 * np.cos(angle), -0.5 + 0.5 * np.sin(angle)])]
    )
    found = named_surfaces(points, np.array([[0, k, k + 1] for k in range(1, 5)]), part, finest=0.1)
    assert {
        name: {frozenset(facet) for facet in found[name].tolist()} for name in ("top", "base")
    } == {
        "top": {frozenset({3, 4}), frozenset({4, 5})},
        "base": {frozenset({1, 2}), frozenset({2, 3})},
    }


@pytest.mark.parametrize("radius", [1.0, 1e6])
def test_a_chord_is_lifted_to_the_sphere(radius: float) -> None:
    """Points of chords are projected onto the sphere -r^2/(radius + root).

    The height keeps its relative digits next to a far larger radius, too.
    """
    r = np.array([1e-6, 1e-3, 0.1, 0.6])
    z = -r * r / (radius + np.sqrt(radius**2 - r * r))
    on_r, on_z = nearest_on_sphere(radius, r, z * (1 + 0.1 * np.arange(4)))
    assert on_z == pytest.approx(
        -on_r * on_r / (radius + np.sqrt(radius**2 - on_r * on_r)), rel=1e-9
    )
    assert nearest_on_sphere(radius, r, z)[1] == pytest.approx(z, rel=1e-12)
