"""Spherical bodies and ellipsoidal inclusions: sizes, edges, distances and overlaps."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.model.inclusions import (
    BallInclusion,
    BoxInclusion,
    CylinderInclusion,
    EllipsoidInclusion,
    Inclusion,
)
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.spherical_bodies import Ball, Cap, SphericalBody
from indent_sim.model.units import Scales

TINY = 1e-14  # rounding of numbers near 1


@pytest.mark.parametrize(
    ("base_radius", "height"), [(2.0, 1.0), (1.0, 1.0), (1.0, 3.0), (100.0, 1.0)]
)
def test_a_cap_stands_on_its_base_radius(base_radius: float, height: float) -> None:
    """The base edge of a cap lies on its sphere, at its height and base radius.

    Where the cap overhangs, its lateral extent is the radius of the sphere.
    """
    dome = Cap(base_radius, height).spherical_body
    r, z = dome.base_edge
    assert (r, z) == (pytest.approx(base_radius, rel=TINY), -height)
    assert np.hypot(r, z + dome.radius) == pytest.approx(dome.radius, rel=TINY)
    assert dome.lateral_extent((0.0, 0.0)) == pytest.approx(
        dome.radius if height > dome.radius else base_radius
    )


@pytest.mark.parametrize("angle", [10.0, 90.0, 150.0])
def test_a_contact_angle_is_between_base_and_surface(angle: float) -> None:
    """At the base edge the sphere's radius is turned from the axis by the contact angle."""
    dome = Cap(2.0, contact_angle=angle).spherical_body
    r, z = dome.base_edge
    assert np.degrees(np.arctan2(r, z + dome.radius)) == pytest.approx(angle, rel=1e-12)


def test_half_a_ball_stands_for_one_between_plates() -> None:
    between, bonded = Ball(3.0).spherical_body, Ball(3.0, base="fixed").spherical_body
    assert (between.height, between.contacts_per_body, between.base_edge) == (3.0, 2, (3.0, -3.0))
    assert (bonded.height, bonded.contacts_per_body, bonded.base_edge) == (
        6.0,
        1,
        (3.0, -3.0),
    )  # bonded below its equator


def test_what_is_seen_from_above_has_equal_areas() -> None:
    """The points of the top represent equal areas of the projected disc.

    The mean of r^2 is then half the squared radius; midpoints give it to 1e-5.
    """
    dome = SphericalBody(2.0, 3.0, "cap")
    x, y = dome.top_points()
    assert np.mean(x**2 + y**2) == pytest.approx(dome.max_section_radius**2 / 2, rel=1e-5)
    assert not dome.is_laterally_confined and not dome.fixed_edge_points()[0].size


def test_pieces_share_approach_and_energy() -> None:
    scales = Scales(2.0, 3.0, contacts_per_body=2)
    assert (scales.depth, scales.force, scales.energy) == (4.0, 12.0, 48.0)
    assert (
        scales.control_unit("depth") == scales.depth
        and scales.control_unit("force") == scales.force
    )


# ---- inclusions: where they end

MATTER = LinearElastic(E=1.0, nu=0.3)
PLACE = (0.1, -0.2, 0.3)
POINTS = (
    (2.0, 1.0, 0.5),
    (0.1, -0.2, 3.0),
    (0.1, -0.2, 0.35),
    (0.0, 0.0, -5.0),
    (0.4, -0.1, 0.32),
    (0.1, 1.0, 0.3),
)


def on_unit_ball(count: int) -> np.ndarray:
    """Evenly spread points (count, 3) of the unit sphere: a spiral of the golden angle."""
    z, turn = 1 - (2 * np.arange(count) + 1) / count, np.pi * (3 - np.sqrt(5)) * np.arange(count)
    return np.column_stack(
        [np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z]
    )


@pytest.mark.parametrize(
    "semi_axes", [(1.0, 1.0, 1.0), (0.3, 0.5, 0.9), (1.0, 1.0, 0.1), (0.02, 1.0, 0.5)]
)
def test_an_ellipsoid_ends_where_its_surface_is(semi_axes: tuple[float, ...]) -> None:
    """Distances to an ellipsoid are those to the nearest and farthest of 4e5 surface points.

    The points are 0.006 apart, which leaves 1e-4 of the farthest distance.
    """
    found = EllipsoidInclusion(PLACE, semi_axes, MATTER)
    surface = np.array(PLACE) + on_unit_ball(400_000) * semi_axes
    for point in POINTS:
        away = np.linalg.norm(surface - point, axis=1)
        is_inside = bool(found.contains(point))
        assert is_inside == bool((((np.array(point) - PLACE) / semi_axes) ** 2).sum() <= 1)
        assert found.distance(point) == pytest.approx(0.0 if is_inside else away.min(), abs=3e-4)
        assert found.farthest_distance(point) == pytest.approx(away.max(), abs=1e-4)
        across = np.linalg.norm(surface[:, :2] - point[:2], axis=1)
        assert found.farthest_distance(point, (0, 1)) == pytest.approx(across.max(), abs=1e-4)
    assert found.volume == pytest.approx(4 / 3 * np.pi * np.prod(semi_axes), rel=1e-14)


def test_an_ellipsoid_of_equal_semi_axes_is_a_ball() -> None:
    """An ellipsoid with equal semi-axes has all distances of the ball, to rounding."""
    ball, round_ = (
        BallInclusion(PLACE, 0.4, MATTER),
        EllipsoidInclusion(PLACE, (0.4, 0.4, 0.4), MATTER),
    )
    for point in POINTS:
        assert round_.contains(point) == ball.contains(point)
        assert round_.distance(point) == pytest.approx(ball.distance(point), rel=1e-14, abs=1e-15)
        assert round_.farthest_distance(point) == pytest.approx(
            ball.farthest_distance(point), rel=1e-11
        )
        assert round_.farthest_distance(point, (0, 1)) == pytest.approx(
            ball.farthest_distance(point, (0, 1)), rel=1e-11
        )
    assert round_.distance(np.array(POINTS).T) == pytest.approx(
        ball.distance(np.array(POINTS).T), abs=1e-15
    )
    assert (round_.volume, round_.min_half_width) == (
        pytest.approx(ball.volume),
        ball.min_half_width,
    )
    assert round_.is_axisymmetric_about(PLACE[:2]) and not round_.is_axisymmetric_about((0.0, 0.0))


BLUNT = EllipsoidInclusion((0.0, 0.0, 0.0), (0.5, 0.3, 0.1), MATTER)


@pytest.mark.parametrize(
    ("other", "gap"),
    [
        (BallInclusion((0.9, 0.0, 0.0), 0.3, MATTER), 0.1),
        (BallInclusion((0.0, 0.0, 0.5), 0.3, MATTER), 0.1),
        (BoxInclusion((0.0, 0.9, 0.0), (4.0, 1.0, 0.1), MATTER), 0.1),
        (CylinderInclusion((0.0, 0.0, -0.45), 2.0, 0.5, MATTER), 0.1),
        (EllipsoidInclusion((1.1, 0.0, 0.0), (0.5, 2.0, 0.3), MATTER), 0.1),
        (EllipsoidInclusion((0.0, 0.0, 0.4), (0.05, 0.05, 0.2), MATTER), 0.1),
        (BallInclusion((0.45, 0.27, 0.09), 0.25, MATTER), 0.0),
        (EllipsoidInclusion((0.0, 0.0, 0.0), (0.4, 0.2, 0.05), MATTER), 0.0),  # one in the other
    ],
)
def test_inclusions_overlap_where_they_are_nearer(other: Inclusion, gap: float) -> None:
    """Two inclusions overlap within a gap that is at least their distance, asked either way."""
    for one, two in ((BLUNT, other), (other, BLUNT)):
        assert one.overlaps(two, gap + 1e-6)
        assert not gap or not one.overlaps(two, gap - 1e-6)
