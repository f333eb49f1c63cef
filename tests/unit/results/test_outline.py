"""Outline of a tip: its section lies on the tip, and its surface has the tip's edges."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.model.tips import Cone, FlatPunch, Paraboloid, Plate, Profile, Pyramid, Sphere
from indent_sim.results.tip_geometry import half_section, section, tip_mesh


@pytest.mark.parametrize(
    "tip",
    [
        Sphere(1.0),
        Cone(60.0),
        Cone(60.0, 0.2),
        FlatPunch(0.5, 0.1),
        Paraboloid(1.0),
        Plate(),
        Pyramid(70.0, 3, tip_radius=0.1),
        Profile(((0, 0), (0.5, 0.1), (0.7, 0.4))),
    ],
)
@pytest.mark.parametrize("degrees", [0.0, 37.0])
def test_a_section_lies_on_the_tip(tip, degrees):
    """The points of a section lie on the tip's surface and on its side where it ends."""
    s, z = half_section(tip, 0.6, degrees)
    x, y = s * np.cos(np.radians(degrees)), s * np.sin(np.radians(degrees))
    sharp = 0.02 if isinstance(tip, Profile) else 1e-9
    side = slice(None, -1 if isinstance(tip, FlatPunch | Profile) else None)
    assert tip.height(x[side], y[side]) == pytest.approx(z[side], abs=sharp)
    assert s[0] == z[0] == 0 and s[-1] <= 0.6


def test_a_sphere_that_fits_is_whole():
    s, z = section(Sphere(0.5), 1.0)
    assert np.hypot(s, z - 0.5) == pytest.approx(0.5) and z.max() == pytest.approx(1.0)


def test_the_surface_of_a_pyramid_has_its_edges():
    """The surface of a pyramid contains its edges, at which the section is widest."""
    drawn = tip_mesh(Pyramid(70.0, 4), (0.0, 0.0), 1.0, "three_dimensional", 1)
    x, y, z = drawn.points.T
    assert np.tan(np.radians(70)) * z == pytest.approx(np.maximum(np.abs(x), np.abs(y)))
    assert len(drawn.cells) == 2 * (
        len(drawn.points) - len(drawn.points) // len(np.unique(np.round(np.hypot(x, y), 9)))
    )
