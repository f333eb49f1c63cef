"""Penetration of the tip into straight facets, on surfaces given by their nodes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from indent_sim.fe.postprocessing.penetration import overlap_depth
from indent_sim.model.kinematics import PlaneStrain
from indent_sim.model.tips import Cone, Indenter, Paraboloid, Profile, Sphere, gap_current

H = 0.1  # length of a facet
ALONG = np.linspace(0.0, 1.0, 9)[:, None]  # points of it


def overlap(tip: Indenter, depth: float, places: np.ndarray, heights: np.ndarray) -> float:
    """Penetration of a tip, whose apex is `depth` below z = 0, into the facets between nodes."""
    nodes = np.stack([places, heights], axis=-1)
    x = np.moveaxis(nodes[:-1] + ALONG[..., None] * np.diff(nodes, axis=0), 0, 1)
    domain = SimpleNamespace(kinematics=PlaneStrain())
    body = SimpleNamespace(height=2.0)
    physics = SimpleNamespace(gap="current", indenter=tip, center=(0.0,), domain=domain, body=body)
    scene = SimpleNamespace(physics=physics)
    with np.errstate(invalid="ignore"):  # 0/0 at a sharp apex, in the branch not taken
        gap = gap_current(tip, x[..., 0], 0.0 * x[..., 0], x[..., 1], depth)
    state = SimpleNamespace(scene=scene, depth=depth, tip_center=(0.0,))
    return overlap_depth(state, x, gap)


def surface(tip: Indenter, depth: float, places: np.ndarray, lift: float = 0.0) -> np.ndarray:
    """Heights of nodes that lie `lift` inside the tip, or at rest beyond it."""
    return np.minimum(tip.height(places, 0.0 * places) - depth + lift, 0.0)


@pytest.mark.parametrize("half_angle", [80.0, 45.0, 28.0, 15.0, 5.0])
@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5])
def test_a_facet_over_an_apex(half_angle: float, shift: float) -> None:
    """Nodes on the surface of a cone count as no penetration, in spite of the facet at its apex.

    That facet is up to H cot(half_angle) / 4 inside the tip, but its ends are not; 1e-12 is
    round-off.
    """
    cone, places = Cone(half_angle), H * (np.arange(-20, 21) + shift)
    for depth in (0.01, 0.3, 1.5):
        assert overlap(cone, depth, places, surface(cone, depth, places)) <= 1e-12


@pytest.mark.parametrize(
    "tip", [Cone(28.0), Sphere(1.0), Paraboloid(1.0), Profile(((0, 0), (0.2, 0), (1.5, 3)))]
)
def test_facets_inside(tip: Indenter) -> None:
    """With all nodes 0.05 inside the tip, the penetration is the normal distance of some facet.

    The tip's curvature within an element H makes it smaller than 0.05.
    """
    places = H * np.arange(-20, 21)
    found = overlap(tip, 0.5, places, surface(tip, 0.5, places, lift=0.05))
    assert 0.4 * 0.05 < found <= 0.05


@pytest.mark.parametrize("depth", [0.6, 1.0, 1.85])
@pytest.mark.parametrize("tip", [Cone(28.0), Cone(70.0), Sphere(1.0), Paraboloid(1.0)])
def test_a_surface_that_the_tip_went_through(tip: Indenter, depth: float) -> None:
    """A surface at rest is penetrated by nearly its distance from the nearest side of the tip.

    That distance is at least depth sin(28 degrees), or R / 2, less an element H.
    """
    places = H * np.arange(-20, 21)
    assert overlap(tip, depth, places, 0.0 * places) > min(0.4 * depth, 0.5) - H


def test_a_surface_behind_a_ball() -> None:
    """A surface that has closed over the ball penetrates it, although the gap is positive again."""
    places, ball = H * np.arange(-20, 21), Sphere(1.0)
    assert overlap(ball, 2.5, places, np.zeros_like(places)) > 0.5


def test_a_body_that_closes_over_a_ball() -> None:
    """A surface that closes over a ball without touching it is not penetrated.

    The facets follow the ball up to 36 degrees from its top, then a stem, then a level. The nodes
    of a polygon about a circle of radius 1 are 1 / cos(half an angle step) from its center at z =
    -1.55.
    """
    angles = np.radians(np.arange(180, 35, -6))
    ring = np.stack([np.sin(angles), np.cos(angles)]) / np.cos(np.radians(3))
    places, heights = np.concatenate([ring, [[1.5, 3.0], [1.5, 1.5]]], axis=1)
    assert overlap(Sphere(1.0), 2.55, places, heights - 1.55) <= 1e-12
    assert overlap(Sphere(1.0), 2.55, places, heights - 1.45) == pytest.approx(0.1, rel=0.1)
