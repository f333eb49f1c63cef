"""Round bodies: the ball of a cap, the edge of its base, what is modelled of a ball."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.model.body import Ball, Cap, Dome
from indent_sim.model.units import Scales

TINY = 1e-14  # rounding of numbers near 1


@pytest.mark.parametrize(("base_radius", "height"), [(2.0, 1.0), (1.0, 1.0), (1.0, 3.0), (100.0, 1.0)])
def test_a_cap_stands_on_its_base_radius(base_radius: float, height: float) -> None:
    """Its foot is on the ball about (0, -radius), at its height; where it overhangs it is as wide as the ball."""
    dome = Cap(base_radius, height).dome
    r, z = dome.foot
    assert (r, z) == (pytest.approx(base_radius, rel=TINY), -height)
    assert np.hypot(r, z + dome.radius) == pytest.approx(dome.radius, rel=TINY)
    assert dome.rim_distance((0.0, 0.0)) == pytest.approx(dome.radius if height > dome.radius else base_radius)


@pytest.mark.parametrize("angle", [10.0, 90.0, 150.0])
def test_a_contact_angle_is_between_base_and_surface(angle: float) -> None:
    """At the foot the surface is normal to the ball's radius there, which turns from the axis by the contact angle."""
    dome = Cap(2.0, contact_angle=angle).dome
    r, z = dome.foot
    assert np.degrees(np.arctan2(r, z + dome.radius)) == pytest.approx(angle, rel=1e-12)


def test_half_a_ball_stands_for_one_between_plates() -> None:
    between, bonded = Ball(3.0).dome, Ball(3.0, base="fixed").dome
    assert (between.height, between.pieces, between.foot) == (3.0, 2, (3.0, -3.0))
    assert (bonded.height, bonded.pieces, bonded.foot) == (6.0, 1, (3.0, -3.0))  # bonded below its equator


def test_what_is_seen_from_above_has_equal_areas() -> None:
    """The mean of r^2 over the disc of the widest section: midpoints give it to 1e-5."""
    dome = Dome(2.0, 3.0, "cap")
    x, y = dome.top()
    assert np.mean(x**2 + y**2) == pytest.approx(dome.widest**2 / 2, rel=1e-5)
    assert not dome.is_held and not dome.fixed_ends()[0].size


def test_pieces_share_approach_and_energy() -> None:
    scales = Scales(2.0, 3.0, pieces=2)
    assert (scales.depth, scales.force, scales.energy) == (4.0, 12.0, 48.0)
    assert scales.of("depth") == scales.depth and scales.of("force") == scales.force
