"""A tilted tip has the surface of the upright tip, turned, and is refused where it has none."""

from __future__ import annotations

from math import atan, cos, degrees, radians, sqrt, tan
from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.tilted_tip import largest_tilt, overhang_tilt, tilted
from indent_sim.model.tips import (
    Berkovich,
    Cone,
    CubeCorner,
    FlatPunch,
    Hyperboloid,
    Paraboloid,
    Profile,
    Pyramid,
    Sphere,
    Vickers,
    gap_under_tip,
)
from indent_sim.process.errors import ConfigError, ConfigErrors
from indent_sim.scene.scene import resolve

SHARP_PROFILE = ((0.0, 0.0), (0.3, 0.05), (0.8, 0.3), (2.0, 1.2))
FLAT_PROFILE = ((0.0, 0.0), (0.3, 0.0), (0.8, 0.3), (2.0, 1.2))
TIPS: list[tuple[Any, float]] = [
    (Paraboloid(1.5), 20.0),
    (Hyperboloid(0.3, 60.0), 15.0),
    (Cone(70.0), 15.0),
    (Cone(70.0, 0.2), 10.0),
    (Cone(30.0, 0.3), 20.0),
    (Vickers(), 12.0),
    (Vickers(tip_radius=0.1), 12.0),
    (Berkovich(rotation=20.0), 10.0),
    (Pyramid(70.0, 5), 8.0),
    (FlatPunch(0.8, 0.1), 5.0),
    (Profile(SHARP_PROFILE), 10.0),
    (Profile(FLAT_PROFILE), 10.0),
    (Profile(SHARP_PROFILE, 0.1), 10.0),
]


@pytest.fixture
def points() -> np.ndarray:
    """Horizontal positions (2, 400) around the tip."""
    return np.random.default_rng(3).uniform(-1, 1, (2, 400))


@pytest.mark.parametrize(("tip", "tilt"), TIPS, ids=str)
def test_the_gap_vanishes_on_the_surface(tip: Any, tilt: float, points: np.ndarray) -> None:
    """Height and gap are written independently of each other; the rounding of 1e-15 is left."""
    leaning = tilted(tip, tilt, 25.0)
    height = leaning.height(*points)
    is_below = height < 1e6
    gap = leaning.gap_current(*points[:, is_below], height[is_below])
    assert np.abs(gap).max() < 1e-14
    assert height.min() >= 0


@pytest.mark.parametrize(("tip", "tilt"), TIPS, ids=str)
def test_the_lowest_point_is_at_height_zero(tip: Any, tilt: float) -> None:
    """It is at the origin, for a punch at the lower end of its face."""
    leaning = tilted(tip, tilt, 90.0)
    place = 0.0
    if isinstance(tip, FlatPunch):
        flat_part = (tip.radius - tip.edge_radius) * cos(radians(tilt))
        place = flat_part + tip.edge_radius * np.sin(radians(tilt))
    assert leaning.height(np.zeros(1), np.array([place])) == pytest.approx(0.0, abs=1e-12)
    around = leaning.height(np.array([0.01, -0.01, 0.0]), place + np.array([0.0, 0.0, -0.01]))
    assert (around > 0).all()


@pytest.mark.parametrize(("tip", "tilt"), TIPS, ids=str)
def test_points_of_the_surface_are_turned(tip: Any, tilt: float, points: np.ndarray) -> None:
    """The surface of the upright tip, turned by `space_coordinates`, is that of the tilted one."""
    leaning = tilted(tip, tilt, -40.0)
    x, y = 0.3 * points
    x, y, z = leaning.space_coordinates(np.column_stack([x, y, tip.height(x, y)])).T
    assert leaning.height(x, y) == pytest.approx(z, abs=1e-10)


def test_a_tilted_cone_cut_along_the_tilt() -> None:
    """The flanks are at half_angle + tilt and half_angle - tilt from the vertical."""
    cone = tilted(Cone(70.0), 15.0, 0.0)
    ahead, behind = cone.height(np.array([1.0, -1.0]), np.zeros(2))
    assert ahead == pytest.approx(1 / tan(radians(85)), rel=1e-12)
    assert behind == pytest.approx(1 / tan(radians(55)), rel=1e-12)


def test_a_sharp_punch_leans_about_the_middle_of_its_face() -> None:
    punch = tilted(FlatPunch(1.0), 2.0, 0.0)
    slope = tan(radians(2))
    ends = cos(radians(2)) * np.array([1.0, -1.0])
    assert punch.height(ends, np.zeros(2)) == pytest.approx([0.0, 2 * slope * ends[0]], abs=1e-12)
    assert np.isnan(gap_under_tip(punch, punch.height(np.array([1.0001]), np.zeros(1)))).all()


def test_limits_of_the_tilt() -> None:
    """The edges of a pyramid with n faces are at atan(tan(half_angle)/cos(180/n)) from its axis."""
    assert largest_tilt(Vickers()) == pytest.approx(90 - degrees(atan(tan(radians(68)) * sqrt(2))))
    assert largest_tilt(Berkovich()) == pytest.approx(12.97, abs=0.005)
    assert largest_tilt(CubeCorner()) == pytest.approx(90 - degrees(atan(sqrt(2))))
    assert largest_tilt(Cone(70.0)) == overhang_tilt(Cone(20.0)) == 20.0
    assert largest_tilt(Profile(SHARP_PROFILE)) == pytest.approx(degrees(atan(0.75)))
    assert largest_tilt(Paraboloid(1.0)) == overhang_tilt(FlatPunch(1.0)) == 90.0


def test_a_sphere_is_not_changed() -> None:
    assert tilted(Sphere(2.0), 20.0, 5.0) == Sphere(2.0)


def test_the_equivalent_tip_has_equal_sections() -> None:
    """The area of the section, an ellipse, is that of the cone; its width in plane strain, too."""
    cone = tilted(Cone(70.0), 10.0, 0.0)
    ends = [tan(radians(80)), tan(radians(60))]
    equivalent = cone.equivalent_tip(2)
    assert equivalent.radius_at(1.0) == pytest.approx(sum(ends) / 2, rel=1e-12)
    angles = np.linspace(0, 360, 720, endpoint=False)
    reach = cone._reach(1.0, (0.0, 0.0), angles)
    assert cone.radius_at(1.0) == pytest.approx(sqrt(np.mean(reach**2)), rel=1e-6)
    pyramid = tilted(Vickers(), 10.0, 30.0)
    # 720 directions sum the area of a polygon to 1e-4.
    reach = pyramid._reach(1.0, (0.0, 0.0), angles)
    assert pyramid.radius_at(1.0) == pytest.approx(sqrt(np.mean(reach**2)), rel=1e-3)
    radius = tilted(Paraboloid(1.0), 20.0, 0.0).equivalent_tip().R
    assert radius == pytest.approx(1 / cos(radians(20)) ** 2)


SCENE: dict[str, Any] = {
    "body": {"shape": "box", "size": [8.0, 8.0, 4.0], "base": "fixed", "sides": "free"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "cone", "half_angle": 70.0},
    "loading": {"delta": 0.1, "steps": 1},
}
STRIP = {"shape": "strip", "width": 4.0, "height": 1.0, "base": "fixed", "sides": "roller"}


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"indenter": {"shape": "cone", "half_angle": 70, "tilt": 20}}, "lies on its flank"),
        ({"indenter": {"shape": "vickers", "tilt": 16}}, "lies on an edge"),
        ({"indenter": {"shape": "cone", "half_angle": 20, "tilt": 25}}, "overhangs"),
        ({"indenter": {"shape": "vickers", "tip_radius": 0.1, "tilt": 5}}, "rounded edges"),
        ({"indenter": {"shape": "plate", "tilt": 1}}, "touches the edge of the body first"),
        ({"indenter": {"shape": "cone", "half_angle": 70, "tilt_towards": 9}}, "tip is upright"),
        (
            {
                "indenter": {
                    "shape": "paraboloid",
                    "R": 1,
                    "tilt": 5,
                    "material": {"model": "linear_elastic", "E": 1, "nu": 0.3},
                },
                "body": {"shape": "half_space"},
            },
            "its holder level",
        ),
        (
            {
                "indenter": {"shape": "cone", "half_angle": 70, "tilt": 5},
                "body": {"shape": "cap", "base_radius": 2, "height": 1},
            },
            "is axisymmetric",
        ),
        (
            {
                "indenter": {"shape": "cone", "half_angle": 70, "tilt": 5, "tilt_towards": 90},
                "body": STRIP,
            },
            "leans along x",
        ),
        (
            {
                "indenter": {"shape": "cone", "half_angle": 70, "tilt": 5},
                "contact": {"adhesion": {"work": 0.01, "range": 0.01}},
            },
            "not verified together with indenter.tilt",
        ),
        (
            {
                "indenter": {"shape": "cone", "half_angle": 70, "tilt": 5},
                "experiment": {"adhesion": {"work": 0.01}},
                "body": {"shape": "half_space"},
            },
            "a tilted cone does not have",
        ),
        (
            {
                "indenter": {"shape": "cone", "half_angle": 70, "tilt": 5},
                "mesh": {"symmetry": "quarter"},
            },
            "only about the mid-plane normal to y",
        ),
        (
            {
                "indenter": {"shape": "flat_punch", "radius": 5, "edge_radius": 0.1, "tilt": 1},
                "contact": {"gap": "current"},
            },
            "crosses the edge of the body",
        ),
        (
            {
                "indenter": {"shape": "cone", "half_angle": 70, "tilt": 5},
                "solver": {"method": "theory"},
            },
            "a tilted cone is not axisymmetric",
        ),
    ],
)
def test_tilts_that_are_refused(sections: dict[str, Any], words: str) -> None:
    with pytest.raises((ConfigError, ConfigErrors), match=words):
        resolve(config_from_mapping(SCENE | sections, ()))


def test_the_keys_belong_to_the_indenter() -> None:
    with pytest.raises((ConfigError, ConfigErrors), match="it belongs in indenter"):
        config_from_mapping(SCENE | {"tilt": 5.0}, ())
    config = config_from_mapping(SCENE, ("indenter.tilt=11", "indenter.tilt_towards=90"))
    assert config.tip == tilted(Cone(70.0), 11.0, 90.0)
