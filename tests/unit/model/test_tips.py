"""Tips as formulas: against theory's shapes, against geometry, and numpy against UFL."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import pytest
import ufl
from pytest import approx

from indent_sim.model.tips import (
    Berkovich,
    Cone,
    CubeCorner,
    FlatPunch,
    Hyperboloid,
    Indenter,
    Paraboloid,
    Plate,
    Profile,
    Pyramid,
    Sphere,
    Vickers,
    _Tip,
    gap_under_tip,
)
from indent_sim.model.units import Length
from indent_sim.scene.tip_theories import theory_tip_shape

BITS = ((0.0, 0.0), (0.2, 0.0), (0.5, 0.1), (1.0, 0.6))
SMOOTH: dict[str, Indenter] = {
    "paraboloid": Paraboloid(1.3),
    "sphere": Sphere(1.3),
    "cone": Cone(65.0, 0.2),
    "hyperboloid": Hyperboloid(0.2, 50.0),
    "flat_punch": FlatPunch(1.0, 0.3),
    "pyramid": Pyramid(65.0, tip_radius=0.2),
    "triangle": Pyramid(50.0, faces=3, rotation=20.0, tip_radius=0.1),
    "profile": Profile(BITS, tip_radius=0.3),
}
SHARP: dict[str, Indenter] = {
    "sharp_cone": Cone(65.0),
    "sharp_pyramid": Pyramid(65.0, faces=5, rotation=10.0),
    "sharp_profile": Profile(BITS),
}
TIPS = SMOOTH | SHARP
OF_REVOLUTION = {name: tip for name, tip in TIPS.items() if tip.is_axisymmetric}
POINTS = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 400))


@cache
def gauss() -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of a Gauss rule of 2000 points from 0 to pi/2."""
    x, w = np.polynomial.legendre.leggauss(2000)
    return np.pi / 4 * (x + 1), np.pi / 4 * w


def on_axis_plane(tip: Indenter, r: np.ndarray) -> np.ndarray:
    """Height of a tip along x."""
    return np.asarray(tip.height(r, 0.0 * r), dtype=float)


@pytest.mark.parametrize("tip", OF_REVOLUTION.values(), ids=OF_REVOLUTION)
def test_height_has_the_abel_transform_of_theory(tip: Indenter) -> None:
    """The height's Abel transform, by quadrature, is theory's shape of the tip.

    g(x) = x int_0^(pi/2) f'(x sin q) dq, with f' from differences of the height.
    """
    q, weight = gauss()
    known = theory_tip_shape(tip)
    assert known is not None
    x = np.array([0.1, 0.3, 0.45, 0.8])
    step = 1e-7
    r = x[:, None] * np.sin(q)
    slope = (on_axis_plane(tip, r + step) - on_axis_plane(tip, r - step)) / (2 * step)
    # the differences are good to 1e-8, the rule to 1/2000 of a jump of the slope, here at most 0.7
    assert x * (slope @ weight) == approx(known.g(x), rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("tip", TIPS.values(), ids=TIPS)
def test_height_is_convex_continuous_and_starts_at_the_apex(tip: Indenter) -> None:
    assert tip.height(np.array(0.0), np.array(0.0)) == approx(0.0, abs=1e-15)
    (x, y), (x_2, y_2) = POINTS, np.roll(POINTS, 1, axis=1)
    between = np.asarray(tip.height((x + x_2) / 2, (y + y_2) / 2))
    assert np.all(
        between <= (np.asarray(tip.height(x, y)) + np.asarray(tip.height(x_2, y_2))) / 2 + 1e-12
    )
    step = 1e-9  # no jump: the steepest of these tips rises by 2.5 a length
    assert (
        np.abs(np.asarray(tip.height(x + step, y)) - np.asarray(tip.height(x, y))).max() < 3 * step
    )


@pytest.mark.parametrize("tip", SMOOTH.values(), ids=SMOOTH)
def test_smooth_tips_have_a_continuous_slope(tip: Indenter) -> None:
    """Second differences of smooth tips are of the order h^2, as a kink's would not be."""
    x, y = POINTS
    h = 1e-4
    for a, b in ((1.0, 0.0), (0.0, 1.0), (0.6, 0.8)):
        ends = [np.asarray(tip.height(x + k * h * a, y + k * h * b)) for k in (-1, 0, 1)]
        assert np.abs(ends[0] - 2 * ends[1] + ends[2]).max() < 50 * h**2


@pytest.mark.parametrize("tip", TIPS.values(), ids=TIPS)
def test_current_gap_vanishes_on_the_tip_and_is_a_length(tip: Indenter) -> None:
    """The current gap is zero on the tip, and changes by a step along the normal there.

    It is positive below the tip and negative above its surface.
    """
    x, y = POINTS
    z = np.asarray(tip.height(x, y), dtype=float)
    assert np.abs(tip.gap_current(x, y, z)).max() < 1e-12
    h = 1e-6
    gradient = np.array(
        [
            np.asarray(tip.gap_current(*(c + h * e for c, e in zip((x, y, z), step, strict=True))))
            - np.asarray(
                tip.gap_current(*(c - h * e for c, e in zip((x, y, z), step, strict=True)))
            )
            for step in np.eye(3)
        ]
    ) / (2 * h)
    length = np.linalg.norm(gradient, axis=0)
    # where a step of 1e-6 crosses a sharp edge or corner the difference sees two faces
    assert np.quantile(np.abs(length - 1), 0.98) < 1e-4
    assert np.all(np.asarray(tip.gap_current(x, y, z - 0.01)) > 0)
    assert np.all(np.asarray(tip.gap_current(x, y, z + 1e-3)) < 0)


DEPTHS = np.linspace(-1.0, 8.0, 1801)


@pytest.mark.parametrize("name", sorted(TIPS.keys() - {"sphere"}))
def test_the_gap_falls_with_the_depth(name: str) -> None:
    """The current gap of any point decreases monotonically with the depth, to rounding."""
    gap = TIPS[name].gap_current(*(c[:, None] for c in 3 * POINTS), DEPTHS)
    assert np.all(np.isfinite(gap)) and np.diff(gap).max() < 1e-12


@pytest.mark.parametrize("edge", [1e-6, 0.3, 0.999999])
def test_the_gap_of_a_punch_does_not_jump(edge: float) -> None:
    """The current gap of a rounded punch has no jump from its flat to its wall, at any depth."""
    r = np.concatenate(
        [np.linspace(0, 1 - edge, 50), np.linspace(1 - edge, 1, 2000), np.linspace(1, 3, 50)]
    )
    for depth in (0.5 * edge, edge, 2 * edge, 1.0, 5.0):
        gap = np.asarray(FlatPunch(1.0, edge).gap_current(r, 0.0, depth))
        assert gap[0] == approx(-depth) and gap[-1] == approx(
            np.hypot(2.0 + edge, max(edge - depth, 0)) - edge
        )
        steepest = 1 + 5 * depth / edge  # 2 in the mean
        assert np.all(np.abs(np.diff(gap)) <= steepest * np.diff(r) + 1e-12)


def test_a_ball_is_whole_but_for_its_stem() -> None:
    """Outside the cone of the stem the current gap of a sphere is the distance to the ball.

    On the axis it falls with the depth, through the center, too.
    """
    ball, angle = Sphere(1.3), np.radians(np.linspace(31, 180, 50))
    for distance in (0.7, 1.3, 2.0):
        gap = ball.gap_current(distance * np.sin(angle), 0.0, 1.3 + distance * np.cos(angle))
        assert gap == approx(distance - 1.3, abs=1e-12)
    assert np.diff(ball.gap_current(0.0, 0.0, DEPTHS)) == approx(
        -np.diff(DEPTHS), rel=1e-4
    )  # the root's floor


@pytest.mark.parametrize("name", ["sphere", "punch", "profile"])
def test_the_end_of_a_tip_is_out_of_reach(name: str) -> None:
    """The height beyond the end of a tip is out of reach, also for a micrometre-sized tip."""
    small = {
        "sphere": Sphere(1e-6),
        "punch": FlatPunch(1e-6),
        "profile": Profile(((0.0, 0.0), (1e-6, 1e-6))),
    }[name]
    assert small.height(2e-6, 0.0) > 1e6


@pytest.mark.parametrize("name", ["sphere", "cone", "flat_punch", "pyramid", "triangle"])
def test_current_gap_is_the_distance_to_the_surface(name: str) -> None:
    """The current gap is the distance to the nearest of many points of the surface.

    Their spacing of 0.004 leaves 0.004^2/(8 distance) at most.
    """
    tip = TIPS[name]
    lattice = np.linspace(-0.9, 0.9, 451)
    X, Y = np.meshgrid(lattice, lattice)
    Z = np.asarray(tip.height(X, Y), dtype=float)
    x, y = POINTS[:, :60] / 2
    z = np.asarray(tip.height(x, y), dtype=float) - 0.15
    squares = (
        (X - x[:, None, None]) ** 2 + (Y - y[:, None, None]) ** 2 + (Z - z[:, None, None]) ** 2
    )
    assert tip.gap_current(x, y, z) == approx(np.sqrt(squares.min(axis=(1, 2))), abs=1e-4)


@pytest.mark.parametrize("tip", TIPS.values(), ids=TIPS)
def test_numpy_and_ufl_evaluate_alike(tip: Indenter) -> None:
    for x, y, z in POINTS[:, :30].reshape(-1, 3):
        X, Y, depth = (
            ufl.variable(ufl.as_ufl(float(c))) for c in (x, y, abs(z))
        )  # which UFL does not fold
        assert ufl_value(tip.height(X, Y)) == approx(float(tip.height(x, y)), rel=1e-12)
        found = ufl_value(tip.gap_current(X, Y, depth))
        assert found == approx(float(tip.gap_current(x, y, abs(z))), rel=1e-10, abs=1e-14)


def ufl_value(expression: Any) -> float:
    """Value of a UFL expression."""
    return float(ufl.as_ufl(expression)(()))


def test_hyperboloid_between_its_limits() -> None:
    """A hyperboloid is a paraboloid near its apex, a shifted cone far away, a hyperbola between.

    The paraboloid holds to (r/b)^2/4 with b = R cot(half_angle), and the cone to b/r of the shift R
    cot^2(half_angle).
    """
    tip, r = Hyperboloid(0.2, 50.0), np.geomspace(1e-9, 1e-3, 20)
    slope = 1 / np.tan(np.radians(50))
    assert on_axis_plane(tip, r) == approx(on_axis_plane(Paraboloid(0.2), r), rel=1e-5)
    far = np.array([1e3, 1e5])
    assert on_axis_plane(tip, far) - on_axis_plane(Cone(50.0), far) == approx(
        -0.2 * slope**2, rel=1e-3
    )
    s = np.linspace(0.1, 3.0, 9)
    above = on_axis_plane(tip, s) / (0.2 * slope**2) + 1
    assert above**2 - (s / (0.2 * slope)) ** 2 == approx(1.0, rel=1e-12)
    assert tip.radius_at(float(on_axis_plane(tip, s)[4])) == approx(s[4], rel=1e-14)
    assert (tip.slope(s + 1e-6) + tip.slope(s)) / 2 * 1e-6 == approx(
        np.diff([*map(tip.height, (s, s + 1e-6), (0.0, 0.0))], axis=0)[0], rel=1e-8
    )


def test_blunt_pyramid_between_its_limits() -> None:
    """A blunt pyramid is a shifted sharp one far away, and the blunt cone along a face normal."""
    blunt, sharp, cone = Pyramid(60.0, tip_radius=0.1), Pyramid(60.0), Cone(60.0, 0.1)
    r = np.linspace(0, 1, 50)
    assert on_axis_plane(blunt, r) == approx(on_axis_plane(cone, r), abs=1e-14)
    shift = 0.1 * (1 / np.sin(np.radians(60)) - 1)
    assert blunt.height(1.0, 0.3) == approx(sharp.height(1.0, 0.3) - shift, rel=1e-12)


def test_many_faces_are_a_cone() -> None:
    """A pyramid of 64 faces is the cone within 1 - cos(pi/64) = 0.12 %."""
    x, y = POINTS
    assert Pyramid(70.0, faces=64).height(x, y) == approx(Cone(70.0).height(x, y), rel=1.3e-3)


@pytest.mark.parametrize(
    ("tip", "area", "tolerance"),
    [
        (Berkovich(), 24.494, 3e-4),
        (Vickers(), 24.504, 1e-4),
        (CubeCorner(), 2.598, 1e-4),
    ],
)
def test_area_of_a_standard_pyramid(tip, area: float, tolerance: float) -> None:
    """Standard pyramids have the area functions of ISO 14577-2.

    They are 24.49 h^2, 24.50 h^2 and 2.60 h^2; the tolerances come from the digits of the angles.
    """
    assert np.pi * tip.radius_at(1.0) ** 2 == approx(area, rel=tolerance)


def test_faces_of_a_cube_corner_are_at_right_angles() -> None:
    x, y, h = 0.3, 0.1, 1e-6
    normals = []
    for turn in (0.0, 120.0, 240.0):
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        place = (c * x - s * y, s * x + c * y)
        f = CubeCorner().height
        normals.append(
            (
                (f(place[0] + h, place[1]) - f(*place)) / h,
                (f(place[0], place[1] + h) - f(*place)) / h,
                -1.0,
            )
        )
    products = np.array(normals) @ np.array(normals).T
    assert products == approx(np.diag(np.diag(products)), abs=1e-6)


def test_pyramid_turns_with_its_rotation() -> None:
    x, y = POINTS
    c, s = np.cos(np.radians(25)), np.sin(np.radians(25))
    turned = Pyramid(70.0, faces=3, rotation=25.0, tip_radius=0.1).height(
        c * x - s * y, s * x + c * y
    )
    assert turned == approx(Pyramid(70.0, faces=3, tip_radius=0.1).height(x, y), abs=1e-13)


@pytest.mark.parametrize(
    ("faces", "rotation", "mirrors"),
    [
        (4, 0, (True, True)),
        (4, 45, (True, True)),
        (4, 20, (False, False)),
        (3, 0, (True, False)),
        (3, 90, (False, True)),
        (5, -18, (False, True)),
        (6, 30, (True, True)),
    ],
)
def test_mirror_planes_of_a_pyramid(
    faces: int, rotation: float, mirrors: tuple[bool, bool]
) -> None:
    """The stated mirror planes through x and y are those of the height."""
    tip = Pyramid(70.0, faces=faces, rotation=rotation)
    x, y = POINTS
    assert (tip.has_mirror_plane(0.0), tip.has_mirror_plane(90.0)) == mirrors
    assert np.allclose(tip.height(x, y), tip.height(x, -y), atol=1e-12) == mirrors[0]
    assert np.allclose(tip.height(x, y), tip.height(-x, y), atol=1e-12) == mirrors[1]


@pytest.mark.parametrize("tip", TIPS.values(), ids=TIPS)
def test_radius_of_a_section(tip: Indenter) -> None:
    """radius_at is sqrt(area/pi) of the section, counted on a lattice to 2 %.

    Where rounded edges are left out the tolerance is 15 %.
    """
    lattice = np.linspace(-1.5, 1.5, 1201)
    X, Y = np.meshgrid(lattice, lattice)
    depth = 0.12
    area = np.count_nonzero(np.asarray(tip.height(X, Y)) < depth) * (lattice[1] - lattice[0]) ** 2
    rounded = isinstance(tip, FlatPunch | Profile) or getattr(tip, "tip_radius", 0) > 0
    assert tip.radius_at(depth) == approx(np.sqrt(area / np.pi), rel=0.15 if rounded else 0.02)


@pytest.mark.parametrize(
    ("points", "tip_radius", "fragment"),
    [
        (((0.1, 0.0), (1.0, 1.0)), 0.0, "apex"),
        (((0.0, 0.1), (1.0, 1.0)), 0.0, "apex"),
        (((0.0, 0.0), (1.0, 1.0), (1.0, 2.0)), 0.0, "increase"),
        (((0.0, 0.0), (1.0, 1.0), (2.0, 1.5)), 0.0, "convex"),
        (((0.0, 0.0), (1.0, -1.0)), 0.0, "convex"),
        (((0.0, 0.0), (0.1, 0.0), (2.0, 3.0)), 1.0, "too large"),
    ],
)
def test_impossible_profiles(points: Any, tip_radius: float, fragment: str) -> None:
    with pytest.raises(ValueError, match=fragment):
        Profile(points, tip_radius).check_points()


def test_a_paraboloid_through_points() -> None:
    """A profile through 40 points of a paraboloid is above it by at most (1/40)^2/8R."""
    r = np.linspace(0, 1, 41)
    tip = Profile(tuple((float(s), float(s * s / 2)) for s in r))
    tip.check_points()
    at = np.linspace(0, 1, 333)
    difference = on_axis_plane(tip, at) - at**2 / 2
    assert difference.min() > -1e-15 and difference.max() < 1.01 / 40**2 / 8


def test_a_hyperboloid_is_rounded_where_its_paraboloid_goes_over_into_its_cone() -> None:
    """The width of a hyperboloid's apex is where its slope is 1/sqrt(2) of the cone's.

    Larger elements cannot resolve its largest pressure.
    """
    tip = Hyperboloid(0.1, 70.0)
    ((r, width),) = tip.slope_discontinuities()
    flank = float(tip.slope(1e9))
    assert r == 0.0 and width / tip.R == pytest.approx(flank, rel=1e-9)
    assert float(tip.slope(width)) == pytest.approx(flank / 2**0.5, rel=1e-9)


def test_a_plate_is_a_plane() -> None:
    """The current gap of a plate is the distance below it at every place."""
    x, y = POINTS
    assert np.all(np.asarray(Plate().height(x, y)) == 0.0)
    assert np.array_equal(Plate().gap_current(x, y, x), -x)
    assert Plate().radius_at(0.1) == np.inf and Plate().slope_discontinuities() == []


@pytest.mark.parametrize(
    "tip", [Sphere(1.3), FlatPunch(1.0, 0.3), Profile(BITS), Cone(65.0), Paraboloid(1.3)]
)
def test_no_gap_is_written_beside_a_tip_that_ends(tip: Indenter) -> None:
    """The gap is kept up to the end of a tip and is NaN beyond it."""
    r = np.array([0.0, 0.5, 0.9, 1.7, 40.0])
    gap = np.asarray(tip.height(r, 0.0 * r), dtype=float) - 0.1
    ends = {"sphere": 1.3, "flat_punch": 1.0, "profile": 1.0}.get(tip.shape, np.inf)
    assert np.array_equal(np.isnan(gap_under_tip(tip, gap)), r > ends)
    assert np.array_equal(gap_under_tip(tip, gap)[r <= ends], gap[r <= ends])


@dataclass(frozen=True)
class Quartic(_Tip):
    """A tip of one's own, f = r^4/R^3, that says nothing but its height."""

    R: Length
    shape: Literal["quartic"] = "quartic"

    def height(self, x: Any, y: Any) -> Any:
        return (x * x + y * y) ** 2 / self.R**3


def test_a_tip_of_ones_own_has_the_strain_of_its_slope() -> None:
    """0.2 f' = 0.8 a^3/R^3, by the default of all tips; the central difference is good to 1e-9."""
    strain, formula = Quartic(2.0).characteristic_strain(0.01, 0.5)
    assert strain == approx(0.8 * 0.25**3, rel=1e-9) and "slope" in formula
    assert Quartic(2.0).radius_scale(0.5) is None  # it is no ball: flat at its apex


@pytest.mark.parametrize("a", [0.2, 0.4, 0.55])
def test_a_profile_on_a_sphere_has_its_radius_and_its_strain(a: float) -> None:
    """Twenty points as far as 0.6 R: between them the chord is above the sphere by up to 1.5e-4 R,
    3e-3 of the smallest height.
    """
    radii = np.linspace(0.0, 0.6 * 1.3, 21)
    points = tuple((float(r), float(1.3 - np.sqrt(1.3**2 - r**2))) for r in radii)
    sphere, profile = Sphere(1.3), Profile(points)
    assert profile.radius_scale(1.3 * a) == approx(1.3, rel=1e-2)
    found, exact = (tip.characteristic_strain(0.01, 1.3 * a) for tip in (profile, sphere))
    assert found[0] == approx(exact[0], rel=1e-2) and found[1] == exact[1] == "0.2 a/R"


def test_which_tips_have_a_radius() -> None:
    """Those with a key R, and no cone, pyramid, punch or profile with a flat end."""
    radii = {name: tip.radius_scale(0.3) for name, tip in TIPS.items()}
    round_tips = {name: R for name, R in radii.items() if R is not None}
    assert round_tips == {"paraboloid": 1.3, "sphere": 1.3, "hyperboloid": 0.2}
    assert Plate().radius_scale(0.3) is None


@pytest.mark.parametrize("name", OF_REVOLUTION)
def test_a_scaled_tip_is_similar(name: str) -> None:
    """f_s(s r) = s f(r)."""
    tip, r = OF_REVOLUTION[name], np.linspace(0.05, 0.9, 12)
    scaled = on_axis_plane(tip.scaled(2.5), 2.5 * r)
    assert scaled == approx(2.5 * on_axis_plane(tip, r), rel=1e-12)
