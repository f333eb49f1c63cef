"""Tilted tip: any tip whose axis leans from the vertical.

The axis, pointing up, leans by the angle `tilt` t towards the horizontal direction `towards`. With
the horizontal coordinates s along this direction and q across it, a point (s, q, z) has the
coordinates s' = s cos(t) - z sin(t), q' = q, z' = s sin(t) + z cos(t) in the frame of the tip. The
origin of (s, q) is below the lowest point of the tip, for a flat punch below the middle of its
face, and z is the height above the lowest point: a depth is counted from first contact.

Paraboloid, cone and hyperboloid are the quadric s'^2 + q'^2 = T^2 z'^2 + 2 R z', with T =
tan(half_angle), or 0 for a paraboloid, and R = 0 for a cone; pyramids and faces are planes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan, degrees, inf, pi
from typing import Any, ClassVar, Self

import numpy as np

from indent_sim.model.algebra import (
    Expr,
    cos,
    is_symbolic,
    maximum,
    minimum,
    sin,
    sqrt,
    tan,
    where_less,
)
from indent_sim.model.tips import (
    ENDED_TIP_HEIGHT,
    TINY_LENGTH,
    Cone,
    FlatPunch,
    Hyperboloid,
    Indenter,
    Paraboloid,
    Profile,
    RegularPyramid,
    Sphere,
    _largest,
    _Tip,
    max_radius,
)

# Number of directions in which the section of a tilted tip is measured.
SECTION_DIRECTIONS = 720
# Number of bisections of a length: the last interval is 1e-17 of the first one.
BISECTIONS = 56


@dataclass(frozen=True)
class TiltedTip(_Tip):
    """Tip whose axis leans by `tilt` degrees towards the direction `towards` degrees from x.

    Attributes
    ----------
    tip
        The upright tip.
    tilt
        Angle between axis and vertical [degrees].
    towards
        Horizontal direction to which the axis leans, from x [degrees].
    """

    tip: Any
    tilt: float
    towards: float

    is_axisymmetric: ClassVar[bool] = False

    @property
    def upright(self) -> Indenter:
        """The tip without tilt."""
        return self.tip  # type: ignore[no-any-return]

    @property
    def tilt_direction(self) -> float | None:
        """Horizontal direction to which the axis leans, from x [degrees]."""
        return self.towards

    @property
    def shape(self) -> str:
        """Name of the shape for messages."""
        return f"tilted {self.tip.shape}"

    def face_position(self, x: Expr, y: Expr) -> tuple[Expr, Expr]:
        """Return the position, in the plane of a flat face, of the point above (x, y) [length]."""
        s, q = self._components(x, y)
        return s / cos(self.tilt), q

    @property
    def foreshortening(self) -> float:
        """Area of a flat face seen from above, divided by its area."""
        return float(cos(self.tilt))

    def replace_upright(self, tip: Any) -> Any:
        """Return another tip with the same tilt."""
        return tilted(tip, self.tilt, self.towards)

    def scaled(self, factor: float) -> Self:
        """Return the geometrically similar tip, with all lengths multiplied by a factor."""
        return replace(self, tip=self.tip.scaled(factor))

    def has_mirror_plane(self, degrees: float) -> bool:
        """Return whether the vertical plane at an angle [degrees] from x is a mirror plane."""
        remainder = (degrees - self.towards) % 180
        is_in_plane = min(remainder, 180 - remainder) < 1e-9
        return is_in_plane and (self.tip.is_axisymmetric or self.tip.has_mirror_plane(degrees))

    def _components(self, x: Expr, y: Expr) -> tuple[Expr, Expr]:
        """Return the components of a horizontal vector along and across `towards`."""
        cos_towards = cos(self.towards)
        sin_towards = sin(self.towards)
        return x * cos_towards + y * sin_towards, y * cos_towards - x * sin_towards

    def _origin(self) -> tuple[Expr, Expr]:
        """Return (s, z) of the origin of the module's coordinates relative to the apex [length]."""
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        r, f = _touching_point(self.tip, self.tilt)
        along = 0.0 if isinstance(self.tip, FlatPunch) else r * cos_tilt + f * sin_tilt
        return along, f * cos_tilt - r * sin_tilt

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the gap of the upright tip at this point, in the tip's frame [length].

        `depth` is the height of the point above the lowest point of the tip.
        """
        X, Y, Z = self._tip_coordinates(x, y, depth)
        return self.tip.gap_current(X, Y, Z)

    def _tip_coordinates(self, x: Expr, y: Expr, z: Expr) -> tuple[Expr, Expr, Expr]:
        """Return the coordinates of a point (x, y, z) in the frame of the tip [length]."""
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        cos_towards = cos(self.towards)
        sin_towards = sin(self.towards)
        along, above = self._origin()
        s, q = self._components(x, y)
        s = s + along
        z = z + above
        turned = s * cos_tilt - z * sin_tilt
        return (
            turned * cos_towards - q * sin_towards,
            turned * sin_towards + q * cos_towards,
            s * sin_tilt + z * cos_tilt,
        )

    def space_coordinates(self, points: Any) -> Any:
        """Return points (n, 3), given in the frame of the tip, in coordinates of space [length].

        The horizontal coordinates are relative to the origin; z is the height above the lowest
        point.
        """
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        cos_towards = cos(self.towards)
        sin_towards = sin(self.towards)
        along, above = self._origin()
        X, Y, Z = points.T
        turned, q = self._components(X, Y)
        s = turned * cos_tilt + Z * sin_tilt - along
        z = Z * cos_tilt - turned * sin_tilt - above
        return np.column_stack(
            [s * cos_towards - q * sin_towards, s * sin_towards + q * cos_towards, z]
        )

    @property
    def has_closed_height(self) -> bool:
        """True if the height is a formula; it is found by bisection under other rounded tips."""
        rounding = getattr(self.tip, "edge_radius", getattr(self.tip, "tip_radius", 0.0))
        return isinstance(self.tip, Paraboloid | Hyperboloid | Cone) or rounding == 0

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the lowest point of the tip [length].

        Where no vertical line meets the tip, it is ENDED_TIP_HEIGHT times the size of the tip.
        """
        if not is_symbolic(x, y) and not self.has_closed_height:
            return self._height_by_bisection(x, y)
        s, q = self._components(x, y)
        along, above = self._origin()
        s = s + along
        match self.tip:
            case FlatPunch(radius=radius):
                face = -s * tan(self.tilt)
                r = sqrt((s / cos(self.tilt)) ** 2 + q * q)
                return where_less(radius * (1 + 1e-12), r, ENDED_TIP_HEIGHT * radius, face - above)
            case Paraboloid(R=R):
                return self._quadric_height(s, q, 0.0, R, ENDED_TIP_HEIGHT * R) - above
            case Hyperboloid(R=R, half_angle=half_angle):
                return (
                    self._quadric_height(s, q, tan(half_angle) ** 2, R, ENDED_TIP_HEIGHT * R)
                    - above
                )
            case Cone():
                return self._cone_height(s, q, above)
            case Profile():
                return self._profile_height(s, q, above, x, y)
        return self._pyramid_height(s, q)

    def _quadric_height(self, s: Expr, q: Expr, T2: Expr, R: Expr, ended: Expr) -> Expr:
        """Return z on the lower surface of the quadric at (s, q) relative to its apex [length].

        It is the root of A z^2 - 2 B z + C = 0 that vanishes with C. Without a root, `ended` is
        returned.
        """
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        A = sin_tilt * sin_tilt - T2 * cos_tilt * cos_tilt
        B = s * sin_tilt * cos_tilt * (1 + T2) + R * cos_tilt
        C = s * s * (cos_tilt * cos_tilt - T2 * sin_tilt * sin_tilt) + q * q - 2 * R * s * sin_tilt
        square = B * B - A * C
        # Both branches of a conditional are evaluated, and a cone has B = C = 0 at its apex.
        root = sqrt(maximum(square, 0.0 * s)) + 1e-300
        # Where the tilt exceeds the angle of the flank, the other nappe of a cone is below it.
        is_other = where_less(0.0, A, where_less(B, 0.0, -1.0, 0.0), 0.0)
        return where_less(minimum(square, is_other), 0.0, ended, C / (B + root))

    def _cone_height(self, s: Expr, q: Expr, above: Expr) -> Expr:
        """Return the height of a cone, whose apex may be rounded by a ball [length]."""
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        rho = self.tip.tip_radius
        sin_angle = sin(self.tip.half_angle)
        # Distance, along the axis, of the point where the flanks would meet below the rounded apex.
        below = rho * (1 / sin_angle - 1)
        flank = (
            self._quadric_height(
                s + below * sin_tilt, q, tan(self.tip.half_angle) ** 2, 0.0, ENDED_TIP_HEIGHT
            )
            - below * cos_tilt
        )
        along_axis = s * sin_tilt + flank * cos_tilt
        square = minimum((s - rho * sin_tilt) ** 2 + q * q, rho * rho)
        ball = square / (rho + sqrt(rho * rho - square) + 1e-300)
        return where_less(along_axis, rho * (1 - sin_angle), ball, flank - above)

    def _profile_height(self, s: Expr, q: Expr, above: Expr, x: Expr, y: Expr) -> Expr:
        """Return the height of a sharp profile, the largest height of its cones [length]."""
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        heights = []
        for (r_0, z_0), (r_1, z_1) in zip(self.tip.points, self.tip.points[1:], strict=False):
            slope = (z_1 - z_0) / (r_1 - r_0)
            if z_1 == z_0:
                heights.append(-s * sin_tilt / cos_tilt + z_0 / cos_tilt)
                continue
            apex = z_0 - slope * r_0
            heights.append(
                self._quadric_height(s - apex * sin_tilt, q, 1 / slope**2, 0.0, ENDED_TIP_HEIGHT)
                + apex * cos_tilt
            )
        height = _largest(heights) - above
        X, Y, _ = self._tip_coordinates(x, y, height)
        end = self.tip.points[-1][0]
        return where_less(end * (1 + 1e-12), sqrt(X * X + Y * Y), ENDED_TIP_HEIGHT * end, height)

    def _pyramid_height(self, s: Expr, q: Expr) -> Expr:
        """Return the height of a sharp pyramid, the largest height of its faces [length]."""
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        slope = 1 / tan(self.tip.half_angle)
        heights = []
        for k in range(self.tip.faces):
            angle = self.tip.rotation + 360 / self.tip.faces * k - self.towards
            along = cos(angle)
            across = sin(angle)
            heights.append(
                (s * (slope * cos_tilt * along - sin_tilt) + q * slope * across)
                / (cos_tilt + slope * sin_tilt * along)
            )
        return _largest(heights)

    def _height_by_bisection(self, x: Any, y: Any) -> Any:
        """Return the height of a tip without a formula, from the zero of its gap [length]."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        size = self._length
        cos_tilt = cos(self.tilt)
        sin_tilt = sin(self.tilt)
        along, above = self._origin()
        s, _ = self._components(x, y)
        # Every vertical line that meets the lower surface leaves the tip at this height along its
        # axis.
        level = self._end_level
        low = np.zeros(x.shape)
        high = 1e4 * (size + np.hypot(x, y))
        if level is not None:
            high = (level - (s + along) * sin_tilt) / cos_tilt - above
        ends = self.gap_current(x, y, high) > 1e-12 * size
        for _ in range(BISECTIONS + 14):
            middle = 0.5 * (low + high)
            is_outside = self.gap_current(x, y, middle) > 0
            low = np.where(is_outside, middle, low)
            high = np.where(is_outside, high, middle)
        return np.where(ends, ENDED_TIP_HEIGHT * size, 0.5 * (low + high))

    @property
    def _end_level(self) -> float | None:
        """Height above the apex, along the axis, at which a tip ends; None without an end."""
        match self.tip:
            case FlatPunch(edge_radius=e):
                return float(e)
            case Profile(points=points):
                return float(points[-1][1])
        return None

    @property
    def _length(self) -> float:
        """Characteristic length of the tip [length]; 1 if it has none."""
        end = max_radius(self.tip)
        lengths = [end, *(getattr(self.tip, name, 0.0) for name in ("R", "tip_radius"))]
        return next((length for length in lengths if 0 < length < inf), 1.0)

    def equivalent_tip(self, dim: int = 3) -> Indenter | None:
        """Return the upright tip with equal sections at every height; None if no such tip exists.

        Sections are equal in area, in plane strain (`dim` 2) in width. For rounded tips it is a
        tip that agrees with this tip near its apex and far from it.
        """
        tau = float(tan(self.tilt))
        T = float(tan(getattr(self.tip, "half_angle", 0.0)))
        stretch = (1 + tau * tau) / (1 - (T * tau) ** 2)
        factor = stretch if dim == 2 else stretch**0.75
        match self.tip:
            case Paraboloid(R=R):
                return Paraboloid(R * (1 + tau * tau) ** (1.5 if dim == 2 else 1.0))
            case Hyperboloid(R=R):
                curvature_factor = stretch**1.5 if dim == 2 else stretch
                return Hyperboloid(R * curvature_factor, degrees(atan(T * factor)))
            case Cone(tip_radius=rho):
                return Cone(degrees(atan(T * factor)), rho)
            case RegularPyramid(tip_radius=rho):
                return Cone(degrees(atan(self._sharp_section_radius())), rho)
        return None

    def _sharp_section_radius(self) -> float:
        """Return the radius of a circle with the area of a sharp pyramid's section at height 1."""
        cos_tilt = float(cos(self.tilt))
        sin_tilt = float(sin(self.tilt))
        faces = self.tip.faces
        angles = np.radians(
            self.tip.rotation - self.towards + 360 / faces * (np.arange(faces) + 0.5)
        )
        rise = float(cos(180 / faces) / tan(self.tip.half_angle))
        z = rise * cos_tilt - np.cos(angles) * sin_tilt
        s = (np.cos(angles) * cos_tilt + rise * sin_tilt) / z
        q = np.sin(angles) / z
        area = abs(s @ np.roll(q, -1) - q @ np.roll(s, -1)) / 2
        return float(np.sqrt(area / pi))

    def _reach(self, depth: float, origin: tuple[float, float], angles: np.ndarray) -> np.ndarray:
        """Return the distance from a horizontal origin to the section's end [length].

        `angles` are the directions [degrees from x], `depth` is the height of the section.
        """
        cos_angles = np.cos(np.radians(angles))
        sin_angles = np.sin(np.radians(angles))

        def is_inside(distance: np.ndarray) -> np.ndarray:
            return np.asarray(
                self.height(origin[0] + distance * cos_angles, origin[1] + distance * sin_angles)
                < depth
            )

        return _last_inside(is_inside, depth * np.ones(len(angles)))

    def contact_patch(self, a: float, dim: int) -> tuple[float, float]:
        """Return the shift of the middle of a contact along `towards`, and its largest radius.

        The contact is assumed to be similar to the section of the tip with the radius a.

        Parameters
        ----------
        a
            Contact radius, in plane strain half its width [length].
        dim
            2 in plane strain, otherwise 3.

        Returns
        -------
        tuple of float
            Shift of the middle, and largest distance of the contact's edge from it [length].
        """
        equivalent = self.equivalent_tip(dim)
        if equivalent is None:
            return 0.0, a
        if not self.has_closed_height:
            sharp = replace(self, tip=replace(self.tip, tip_radius=0.0))
            return sharp.contact_patch(a, dim)
        depth = float(_last_inside(lambda d: _radii(equivalent, d) < a, a * np.ones(1))[0])
        ends = self._reach(depth, (0.0, 0.0), np.array([self.towards, self.towards + 180]))
        shift = float(ends[0] - ends[1]) / 2
        if dim == 2:
            return shift, float(ends.sum()) / 2
        middle = shift * float(cos(self.towards)), shift * float(sin(self.towards))
        angles = 360 / SECTION_DIRECTIONS * np.arange(SECTION_DIRECTIONS)
        return shift, float(self._reach(depth, middle, angles).max())

    def radius_at(self, depth: float) -> float:
        """Return the radius of a circle with the area of the section at a height [length]."""
        return float((self.equivalent_tip() or self.tip).radius_at(depth))

    def slope(self, r: Expr) -> Expr:
        """Return the slope of the upright tip whose horizontal sections have the same areas."""
        return (self.equivalent_tip() or self.tip).slope(r)

    def slope_discontinuities(self) -> list[tuple[float, float]]:
        """Return radius and rounding width [length] of each slope discontinuity."""
        return (self.equivalent_tip() or self.tip).slope_discontinuities()

    @property
    def touching_radius(self) -> float:
        """Distance of the lowest point from the axis of the tip [length]."""
        r, _ = _touching_point(self.tip, self.tilt)
        return float(r)

    def radius_scale(self, r: float) -> float | None:
        """Return the radius of curvature of the upright tip with equal sections, if it is round."""
        return (self.equivalent_tip() or self.tip).radius_scale(r)

    def characteristic_strain(self, delta: float, a: float) -> tuple[float, str]:
        """Return the characteristic strain of a contact, and the formula as text."""
        if isinstance(self.tip, FlatPunch):
            strain, text = self.tip.characteristic_strain(delta, a)
            slope_strain = 0.2 * float(tan(self.tilt))
            return max((strain, text), (slope_strain, "0.2 tan(tilt)"))
        return (self.equivalent_tip() or self.tip).characteristic_strain(delta, a)


def tilted(tip: Indenter, tilt: float, towards: float) -> Indenter:
    """Return a tip whose axis leans by `tilt` degrees; a sphere is not changed by a tilt."""
    if not tilt or isinstance(tip, Sphere):
        return tip
    return TiltedTip(tip, tilt, towards)  # type: ignore[return-value]


def largest_tilt(tip: Indenter) -> float:
    """Return the tilt [degrees] from which on the tip lies on an edge or a flank.

    At a smaller tilt its lowest point is at the apex, or on its rounding. The edge of a pyramid
    with n faces has the half angle atan(tan(half_angle)/cos(180/n)).
    """
    match tip:
        case RegularPyramid():
            edge = tan(tip.half_angle) / cos(180 / tip.faces)
            return 90.0 - degrees(atan(edge))
        case Cone() | Hyperboloid():
            return 90.0 - tip.half_angle
        case Profile():
            return degrees(atan(float(_slope_of_outermost_cone(tip))))
    return 90.0


def overhang_tilt(tip: Indenter) -> float:
    """Return the tilt [degrees] from which on a flank of the tip overhangs: its half angle.

    90 for a flat face. A paraboloid overhangs at any tilt, but only far from its lowest point.
    """
    match tip:
        case RegularPyramid() | Cone() | Hyperboloid():
            return float(tip.half_angle)
        case Profile():
            return 90.0 - degrees(atan(float(_slope_of_outermost_cone(tip))))
    return 90.0


def _slope_of_outermost_cone(tip: Profile) -> Expr:
    """Return the slope dz/dr of the outermost cone of a profile."""
    (r_0, z_0), (r_1, z_1) = tip.points[-2:]
    return (z_1 - z_0) / (r_1 - r_0)


def _touching_point(tip: Any, tilt: Expr) -> tuple[Expr, Expr]:
    """Return radius and height, in the frame of the tip, of its lowest point [length].

    The slope of the tip there is tan(tilt), or jumps over it.
    """
    tau = tan(tilt)
    match tip:
        case Paraboloid(R=R):
            return R * tau, R * tau * tau / 2
        case Hyperboloid(R=R, half_angle=half_angle):
            T = tan(half_angle)
            r = R * tau / sqrt(1 - (T * tau) ** 2)
            return r, tip.height(r, 0.0 * r)
        case FlatPunch(radius=radius, edge_radius=e):
            return radius - e + e * sin(tilt), e * (1 - cos(tilt))
        case Profile():
            return _touching_point_of_profile(tip, tau)
    rho = tip.tip_radius
    return rho * sin(tilt), rho * (1 - cos(tilt))


def _touching_point_of_profile(tip: Profile, tau: Expr) -> tuple[Expr, Expr]:
    """Return radius and height of the point of a profile with the slope tau [length]."""
    r: Expr = 0.0
    slope: Expr = 0.0
    for center, half_width, jump in tip.rounding_arcs():
        part = minimum(maximum((tau - slope) / (jump + TINY_LENGTH), 0.0), 1.0)
        r = where_less(slope, tau, center - half_width + 2 * half_width * part, r)
        slope = slope + jump
    return r, tip.height_at_radius(r)


def _radii(tip: Indenter, depths: np.ndarray) -> np.ndarray:
    """Return the radii of the sections of a tip at several heights [length]."""
    return np.array([tip.radius_at(float(depth)) for depth in depths])


def _last_inside(is_inside: Callable[[np.ndarray], np.ndarray], start: np.ndarray) -> np.ndarray:
    """Return the largest numbers that fulfil a condition; no larger number fulfils it."""
    high = start
    # A section that has no end is cut off after this number of doublings.
    for _ in range(40):
        inside = is_inside(high)
        if not inside.any():
            break
        high = np.where(inside, 2 * high, high)
    low: np.ndarray = np.zeros(len(high))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        inside = is_inside(middle)
        low = np.where(inside, middle, low)
        high = np.where(inside, high, middle)
    return low
