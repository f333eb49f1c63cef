"""The contact radius where all or a part of the face of a tip with a sharp edge is in contact."""

from __future__ import annotations

from math import acos, pi, sqrt
from typing import Any

import numpy as np
import pytest
from scenes import BOX, CYLINDER, STRIP, WALLED, scene, solve

from indent_sim.fe.postprocessing.contact_area import area_in_circle

RADIUS = 0.4
PUNCH = {"shape": "flat_punch", "radius": RADIUS}
ROLLERS_AT_AXIS = {"x_min": "roller", "y_min": "roller", "x_max": "free", "y_max": "free"}
COARSE = {"h_contact": 0.2, "h_far": 0.7}
# Distance of the axis from the wall of the box that the overhanging punch passes
TO_WALL = 0.1
AREA_ON_BOX = RADIUS**2 * (pi - acos(TO_WALL / RADIUS)) + TO_WALL * sqrt(RADIUS**2 - TO_WALL**2)

# Sections of the scene, and the contact radius that follows from the shapes of punch and body
WHOLE: dict[str, tuple[dict[str, Any], float]] = {
    "quarter": ({"body": BOX}, RADIUS),
    "half": ({"body": BOX, "indenter": PUNCH | {"center": [0.8, 1.0]}}, RADIUS),
    "full": ({"body": BOX, "indenter": PUNCH | {"center": [0.8, 0.9]}}, RADIUS),
    "edge that crosses elements": (
        {"body": CYLINDER, "indenter": PUNCH | {"center": [0.3, 0.0]}},
        RADIUS,
    ),
    "active set": ({"body": BOX, "contact": {"method": "active_set"}}, RADIUS),
    "profile without height": (
        {"body": BOX, "indenter": {"shape": "profile", "points": [[0, 0], [RADIUS, 0]]}},
        RADIUS,
    ),
    "quarter between rollers": (
        {"body": BOX | {"sides": ROLLERS_AT_AXIS}, "indenter": PUNCH | {"center": [0.0, 0.0]}},
        RADIUS / 2,
    ),
    "overhang": (
        {"body": BOX, "indenter": PUNCH | {"center": [2.0 - TO_WALL, 1.0]}},
        sqrt(AREA_ON_BOX / pi),
    ),
    "section, coarse at the edge": (
        {
            "body": CYLINDER | {"radius": 2.0},
            "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.5},
            "contact": {"method": "active_set"},
            "mesh": {"h_contact": 0.16, "h_edge": 0.08},
        },
        RADIUS,
    ),
    "strip": ({"body": STRIP, "mesh": {"h_contact": 0.16, "h_edge": 0.08}}, RADIUS),
}


@pytest.mark.parametrize("name", WHOLE)
def test_whole_face(name: str) -> None:
    """The contact ends at the edge of the punch or of the body, whatever the elements."""
    sections, a = WHOLE[name]
    (state,) = solve(scene(**{"indenter": PUNCH, "mesh": COARSE} | sections))
    # The area is a sum over some hundred facets, with a round-off of 1e-16 each.
    assert state.a == pytest.approx(a, rel=1e-12)


def test_face_in_part() -> None:
    """A conical tip is in contact with a part of its face, as layer theory of the cone says, until
    the contact reaches its end.
    """
    depths = [0.03, 0.08]
    points = [[0.0, 0.0], [RADIUS, 0.05]]
    ended = scene(
        WALLED,
        indenter={"shape": "profile", "points": points},
        loading={"deltas": depths},
        mesh={"h_contact": 0.05, "h_edge": 0.02},
    )
    cone = scene(
        WALLED,
        indenter={"shape": "cone", "half_angle": float(np.degrees(np.arctan2(RADIUS, 0.05)))},
        loading={"deltas": depths},
    )
    assert ended.sizes.punch_edge == pytest.approx(RADIUS / ended.physics.scales.length)
    theory = cone.plan.theory
    assert theory is not None
    solution = theory.solution_at_depth(depths[0])
    assert solution is not None
    in_part, whole = solve(ended)
    # The end of a contact inside an element is known to a twentieth of that (docs/conventions.md).
    assert in_part.a == pytest.approx(solution.a, abs=0.05 * 0.05)
    assert whole.a == pytest.approx(RADIUS, rel=1e-12)


def test_hole_inside_the_face() -> None:
    """A stiff film bends away from the middle of a punch: only a ring is in contact, and its area
    is not that of the face. In three dimensions the ring is that of the section.
    """
    film = {"thickness": 0.1, "material": {"model": "linear_elastic", "E": 200.0, "nu": 0.3}}
    bulk = {"thickness": 0.9, "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3}}
    punch = PUNCH | {"radius": 0.7}
    body = WALLED | {"layers": [film, bulk]}
    (section,) = solve(scene(body, indenter=punch, mesh={"h_contact": 0.05, "h_edge": 0.02}))
    assert section.a < 0.5 * 0.7
    force = section.force
    (solid,) = solve(scene(body, "mesh.symmetry=quarter", indenter=punch, mesh={"h_contact": 0.15}))
    # The ring is as wide as an element of the quarter, 0.0375, at its inner edge.
    assert abs(solid.a**2 - section.a**2) < 2 * 0.7 * 0.0375
    assert solid.force == pytest.approx(force, rel=0.05)  # 0.25 h_edge/radius (EDGE_ERROR)


def test_area_in_circle() -> None:
    """Parts of random triangles inside the unit circle, against sums over thin strips."""
    generator = np.random.default_rng(5)
    triangles = generator.uniform(-1.5, 1.5, (40, 3, 2))
    y = np.linspace(-1.0, 1.0, 40_001)
    half_width = np.sqrt(1 - y * y)
    for triangle, area in zip(triangles, area_in_circle(triangles, 1.0), strict=True):
        left, right = -half_width, half_width
        crossings = []
        for (x0, y0), (x1, y1) in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            is_crossed = (y - y0) * (y - y1) <= 0
            crossings.append(np.where(is_crossed, x0 + (x1 - x0) * (y - y0) / (y1 - y0), np.nan))
        is_inside = ~np.isnan(crossings).all(axis=0)
        low = np.nanmin(np.where(np.isnan(crossings), np.inf, crossings), axis=0)
        high = np.nanmax(np.where(np.isnan(crossings), -np.inf, crossings), axis=0)
        width = np.minimum(right, high) - np.maximum(left, low)
        strips = np.where(is_inside, np.maximum(width, 0.0), 0.0)
        # The width of the strips, 5e-5, times the largest jump of their length, 2
        assert abs(area) == pytest.approx(float(strips.sum() * (y[1] - y[0])), abs=1e-4)


def test_area_in_circle_with_a_corner_at_its_center() -> None:
    """A corner that is at the center up to round-off does not change the area of a triangle."""
    angles = np.linspace(0.1, 6.2, 40)
    for angle in angles:
        first = 0.05 * np.array([np.cos(angle), np.sin(angle)])
        second = 0.06 * np.array([np.cos(angle + 0.7), np.sin(angle + 0.7)])
        exact = 0.5 * 0.05 * 0.06 * np.sin(0.7)
        for shift in ([1e-19, -2e-19], [-3e-18, 1e-20], [0.0, -0.0]):
            center = np.array(shift)
            for corners in ((center, first, second), (first, second, center)):
                (area,) = area_in_circle(np.array([corners]), 1.0)
                # Areas of triangles are differences of numbers as large as the area.
                assert abs(area) == pytest.approx(exact, rel=1e-12)
