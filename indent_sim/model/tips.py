"""Tips, defined by a formula for the surface; only a tip with a `material` is meshed.

The apex of a tip is at the origin of its coordinates, z up. `height(x, y)` is the height f of the
tip's surface above the apex at the horizontal position (x, y) relative to the axis. `gap_reference`
(small strain) is the gap at the undeformed point, with the pressure along z; `gap_current` is the
gap at the deformed point, with the pressure along the tip's normal. Both return g [length], >= 0
open; formulas accept floats, numpy arrays or UFL expressions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce
from itertools import pairwise
from math import atan, degrees, inf, nan, pi
from typing import Annotated, Any, ClassVar, Literal, Self

from annotated_types import Ge, Le, Len

from indent_sim.model.algebra import Expr, cos, maximum, minimum, sin, sqrt, tan, where_less
from indent_sim.model.materials import TipLaw
from indent_sim.model.units import (
    ANGLE,
    LENGTH,
    HalfAngle,
    Length,
    LengthOrZero,
    TaggedBy,
    field_units,
)

# Height of a tip outside the radius at which it ends, in multiples of that radius. It is above
# every body (a scene whose body is higher is refused), and its square is finite.
ENDED_TIP_HEIGHT = 1e15
# Half angle [degrees] of the cone about its axis in which a stem holds a sphere from above.
STEM_HALF_ANGLE = 30.0
# Added to a radius of curvature [length], so that sharp corners are not divided by zero.
TINY_LENGTH = 1e-30

Angle = Annotated[float, ANGLE]
Faces = Annotated[int, Ge(3), Le(64)]
Point = Annotated[tuple[Annotated[float, Ge(0)], ...], Len(2, 2)]
Points = Annotated[tuple[Point, ...], Len(2, 1000), LENGTH]
TipMaterial = Annotated[TipLaw | None, TaggedBy("model")]


@dataclass(frozen=True)
class Lens:
    """Elastic part of a soft tip: a cap of a ball, bonded to a rigid holder above.

    Attributes
    ----------
    radius
        Radius of curvature at the apex [length].
    thickness
        Distance of the holder from the apex [length], at most the radius.
    material
        Law of the cap: linear elastic, or hyperelastic on a hyperelastic body.
    """

    radius: float
    thickness: float
    material: TipLaw

    @property
    def base_radius(self) -> float:
        """Radius of the face that is bonded to the holder [length]."""
        return float(sqrt(self.thickness * (2 * self.radius - self.thickness)))


@dataclass(frozen=True)
class SoftCylinder:
    """Elastic part of a soft tip: a cylinder with free sides, bonded to a rigid holder above.

    Attributes
    ----------
    radius
        Radius [length].
    thickness
        Distance of the holder from the lower face [length].
    material
        Linear elastic law of the cylinder, defined by E and nu.
    """

    radius: float
    thickness: float
    material: TipLaw


class _Tip:
    """Base class of all tips; the defaults describe a smooth surface of revolution."""

    is_axisymmetric: ClassVar[bool] = True

    @property
    def elastic_part(self) -> Lens | SoftCylinder | None:
        """The elastic part of the tip; None if the tip is rigid."""
        return None

    @property
    def upright(self) -> Any:
        """The tip without tilt."""
        return self

    @property
    def tilt_direction(self) -> float | None:
        """Horizontal direction to which the axis leans [degrees]; None if it is vertical."""
        return None

    def face_position(self, x: Expr, y: Expr) -> tuple[Expr, Expr]:
        """Return the position, in the plane of a flat face, of the point above (x, y) [length]."""
        return x, y

    @property
    def foreshortening(self) -> float:
        """Area of a flat face seen from above, divided by its area."""
        return 1.0

    def replace_upright(self, tip: Any) -> Any:
        """Return another tip with the same tilt as this tip."""
        return tip

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the apex [length]."""
        raise NotImplementedError

    def slope(self, r: Expr) -> Expr:
        """Return the slope f'(r), by a central difference of the height."""
        # Step of the difference, relative to the radius.
        relative_step = 1e-6
        step = relative_step * r
        return (self.height(r + step, 0.0 * r) - self.height(r - step, 0.0 * r)) / (2 * step)

    def slope_discontinuities(self) -> list[tuple[float, float]]:
        """Return radius and rounding width [length] of each slope discontinuity."""
        return []

    @property
    def touching_radius(self) -> float:
        """Distance of the lowest point from the axis of the tip [length]."""
        return 0.0

    def radius_scale(self, r: float) -> float | None:
        """Return the radius of curvature that characterizes the tip up to the radius r [length].

        The result is the radius of the sphere through the apex and the surface at r; None if the
        tip is not round at r.
        """
        inner_radius, radius = (_sphere_radius(x, float(self.height(x, 0.0))) for x in (r / 2, r))
        # A tip is round up to a radius r if the spheres through its apex and its surface at r and
        # at r/2 differ by at most this fraction of their radius. They differ by 5 % for a
        # paraboloid at r = R/2, and by a factor of 2 for a cone.
        max_difference = 0.1
        return radius if abs(inner_radius - radius) <= max_difference * radius else None

    def characteristic_strain(self, delta: float, a: float) -> tuple[float, str]:
        """Return the characteristic strain of a contact, and the formula as text.

        The strain is 0.2 times the slope of the tip at the contact edge (Tabor 1951 for a ball,
        Johnson 1985, 6.3 for a cone, independent of the depth). A round tip is treated as a ball; a
        contact that reaches the end of the tip is treated as that of a flat punch.

        Parameters
        ----------
        delta
            Depth [length].
        a
            Contact radius [length].
        """
        if a >= max_radius(self):
            return _punch_strain(delta, a)
        radius = self.radius_scale(a)
        if radius is not None:
            return 0.2 * a / radius, "0.2 a/R"
        return self._strain_of_slope(a)

    def _strain_of_slope(self, a: float) -> tuple[float, str]:
        """Return the strain, 0.2 times the slope at the contact edge, and its formula as text."""
        return 0.2 * self.slope(a), "0.2 times the slope at the contact's edge"

    def scaled(self, factor: float) -> Self:
        """Return the geometrically similar tip, with all lengths multiplied by a factor."""
        kind: type = type(self)
        units = field_units(kind)
        own_fields: Any = fields(kind)
        lengths = {
            field.name: _multiply(getattr(self, field.name), factor)
            for field in own_fields
            if units[field.name] == LENGTH
        }
        return replace(self, **lengths)  # type: ignore[type-var]


class _PointedTip(_Tip):
    """Base class of cones and pyramids, whose flanks meet at the apex, sharp or rounded."""

    half_angle: Expr
    tip_radius: Expr

    def slope_discontinuities(self) -> list[tuple[float, float]]:
        """Return the apex as a slope discontinuity: radius 0 and width of the rounding [length]."""
        return [(0.0, self.tip_radius * float(cos(self.half_angle)))]

    def radius_scale(self, r: float) -> None:
        """Return None, because a cone or pyramid has no radius R."""
        return None


class _RoundTip(_Tip):
    """Base class of the tips of radius R, which may be soft.

    A soft tip is a lens of the radius R with an elastic `material`. Its `thickness` is the
    distance from the apex to the rigid holder to which it is bonded, R (half a ball) by default.
    """

    R: Any
    material: Any
    thickness: Any

    @property
    def elastic_part(self) -> Lens | None:
        """The elastic part of the tip; None if the tip is rigid."""
        if self.material is None:
            return None
        return Lens(self.R, self.thickness or self.R, self.material.canonical())

    def radius_scale(self, r: float) -> float:
        """Return the radius R [length]."""
        return float(self.R)


@dataclass(frozen=True)
class Paraboloid(_RoundTip):
    """Paraboloid f = r^2 / (2 R), the tip shape of Hertz' theory (notes 3.1).

    With `material` the tip is soft: a lens of this radius and `thickness`.
    """

    R: Length
    shape: Literal["paraboloid"] = "paraboloid"
    material: TipMaterial = None
    thickness: Length | None = None

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the apex [length]."""
        return (x * x + y * y) / (2 * self.R)

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the gap (f - depth) / |grad(f - z)| at the deformed point, 0 on the tip."""
        return (self.height(x, y) - depth) / sqrt(1 + (x * x + y * y) / (self.R * self.R))

    def radius_at(self, depth: float) -> float:
        """Return the radius of the section at the height `depth` above the apex [length]."""
        return float(sqrt(2 * self.R * depth))


@dataclass(frozen=True)
class Sphere(_RoundTip):
    """Sphere f = r^2 / (R + sqrt(R^2 - r^2)) for r < R; no contact beyond r = R.

    With `gap: current` the gap is the distance from the whole sphere, including its upper half,
    except within 30 degrees of the axis, where the tip is held by a stem. With `material` the tip
    is soft: a lens of this `thickness`, by default half a ball.
    """

    R: Length
    shape: Literal["sphere"] = "sphere"
    material: TipMaterial = None
    thickness: Length | None = None

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) [length] without loss of digits for r << R."""
        square = x * x + y * y
        R2 = self.R * self.R
        # Both branches of a conditional are differentiated, so the root's argument stays positive.
        inside = minimum(square, (1 - 1e-12) * R2)
        cap = inside / (self.R + sqrt(R2 - inside))
        return where_less(square, R2, cap, ENDED_TIP_HEIGHT * self.R)

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the gap, the distance from the sphere and its stem [length].

        |v| - R - 2 <cos(phi) - cos(STEM)>^2 |v| / (1 - cos(STEM))^2 with v = X + u - c from the
        center c, phi the angle between v and the upward axis, and STEM the half angle of the stem.
        On the axis above the center the gap is -|v| - R, so that a body through which the tip has
        passed does not count as separated.
        """
        R2 = self.R * self.R
        c = cos(STEM_HALF_ANGLE)
        # |v|^2 - R^2 = x^2 + y^2 + depth (depth - 2 R) loses no digits at small depths.
        difference = x * x + y * y + depth * (depth - 2 * self.R)
        # The small term keeps the derivative finite at the center.
        distance = sqrt(difference + R2 * (1 + 1e-15))
        stem = maximum(depth - self.R - c * distance, 0.0 * depth) / (1 - c)
        return difference / (distance + self.R) - 2 * stem * stem / distance

    def radius_at(self, depth: float) -> float:
        """Return the radius of the section at the height `depth` above the apex [length]."""
        depth = min(depth, self.R)
        return float(sqrt(depth * (2 * self.R - depth)))


@dataclass(frozen=True)
class Cone(_PointedTip):
    """Cone f = r cot(half_angle).

    With tip_radius > 0 the apex is a spherical cap that joins the flank with a continuous slope.
    """

    half_angle: HalfAngle
    tip_radius: LengthOrZero = 0.0
    shape: Literal["cone"] = "cone"

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the apex [length]."""
        r = sqrt(x * x + y * y)
        rho = self.tip_radius
        slope = 1 / tan(self.half_angle)
        # Cap and flank meet where the cap's slope is the flank's: r = rho cos(half_angle).
        s = minimum(r, rho * slope / sqrt(1 + slope * slope))
        cap = s * s / (rho + sqrt(rho * rho - s * s) + 1e-300)
        return cap + slope * (r - s)

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the gap at a deformed point, the distance from flank or apex cap [length].

        The distance from the flank is (f - depth) sin(half_angle). (x, y) is the position of the
        point relative to the tip's axis, and `depth` the depth of the apex below the point.
        """
        rho = self.tip_radius
        slope = 1 / tan(self.half_angle)
        square = x * x + y * y
        # The small term keeps the root's derivative finite at r = 0.
        r = sqrt(square + 1e-24 * rho * rho)
        secant = sqrt(1 + slope * slope)
        flank = (slope * r - rho * (secant - 1) - depth) / secant
        difference = square + depth * (depth - 2 * rho)
        cap = difference / (sqrt(maximum(difference + rho * rho, 1e-12 * rho * rho)) + rho)
        # The cone of normals through the circle where they join separates cap and flank.
        return where_less(r, slope * maximum(rho - depth, 0.0 * depth), cap, flank)

    def radius_at(self, depth: float) -> float:
        """Return the radius of the section at the height `depth` above the apex [length]."""
        rho = self.tip_radius
        if depth < rho * (1 - sin(self.half_angle)):
            return float(sqrt(depth * (2 * rho - depth)))
        return float((depth + rho * (1 / sin(self.half_angle) - 1)) * tan(self.half_angle))

    def characteristic_strain(self, delta: float, a: float) -> tuple[float, str]:
        """Return the characteristic strain on the flank or the rounded apex, and its formula."""
        if a > self.tip_radius * cos(self.half_angle):
            return 0.2 / tan(self.half_angle), "0.2 cot(half_angle)"
        return 0.2 * a / self.tip_radius, "0.2 a/tip_radius"


@dataclass(frozen=True)
class Hyperboloid(_Tip):
    """Hyperboloid, round at the apex and a cone far from it.

    f = R cot^2(half_angle) (sqrt(1 + (r tan(half_angle)/R)^2) - 1), written as r^2/(R (1 + sqrt(1 +
    (r tan(half_angle)/R)^2))), which loses no digits for r << R.
    """

    R: Length
    half_angle: HalfAngle
    shape: Literal["hyperboloid"] = "hyperboloid"

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the apex [length]."""
        square = x * x + y * y
        return square / (self.R * (1 + self._root(square)))

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the gap (f - depth) / |grad(f - z)| at the deformed point, 0 on the tip."""
        square = x * x + y * y
        return (self.height(x, y) - depth) / sqrt(1 + square / (self.R * self._root(square)) ** 2)

    def slope(self, r: Expr) -> Expr:
        """Return the slope f'(r) of the surface at the radius r."""
        return r / (self.R * self._root(r * r))

    def _root(self, square: Expr) -> Expr:
        """Return sqrt(1 + (r tan(half_angle)/R)^2) from r^2."""
        t = tan(self.half_angle) / self.R
        return sqrt(1 + square * t * t)

    def slope_discontinuities(self) -> list[tuple[float, float]]:
        """Return the apex as a slope discontinuity with the rounding width R cot(half_angle).

        At this radius the shape changes from a paraboloid to a cone.
        """
        return [(0.0, self.R / float(tan(self.half_angle)))]

    def radius_at(self, depth: float) -> float:
        """Return the radius of the section at the height `depth` above the apex [length]."""
        slope = 1 / tan(self.half_angle)
        return float(sqrt(depth * (2 * self.R + depth / slope**2)))

    def radius_scale(self, r: float) -> float:
        """Return R [length], the only length of the tip."""
        return self.R

    def characteristic_strain(self, delta: float, a: float) -> tuple[float, str]:
        """Return the strain, 0.2 times the slope at the contact edge, and its formula as text."""
        return self._strain_of_slope(a)


class _FlatTip(_Tip):
    """Base class of flat punch and plate, which may be soft.

    A soft tip is a cylinder of the given radius and `thickness` with a linear elastic `material`.
    """

    radius: Any
    material: Any
    thickness: Any

    @property
    def elastic_part(self) -> SoftCylinder | None:
        """The elastic part of the tip; None if the tip is rigid."""
        if self.material is None:
            return None
        return SoftCylinder(self.radius, self.thickness, self.material.canonical())


@dataclass(frozen=True)
class FlatPunch(_FlatTip):
    """Flat punch f = 0 for r <= radius; no contact at larger r.

    With edge_radius > 0 the edge is a quarter circle; with edge_radius = radius the punch is a rod
    with a hemispherical end. With `material` the tip is soft: a cylinder of this `thickness`.
    """

    radius: Length
    edge_radius: LengthOrZero = 0.0
    shape: Literal["flat_punch"] = "flat_punch"
    material: TipMaterial = None
    thickness: Length | None = None

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the apex [length]."""
        r = sqrt(x * x + y * y)
        e = self.edge_radius
        edge_distance = minimum(maximum(r - (self.radius - e), 0.0 * r), e)
        edge_height = (
            edge_distance
            * edge_distance
            / (e + sqrt(e * e - edge_distance * edge_distance) + 1e-300)
        )
        return where_less(self.radius * (1 + 1e-12), r, ENDED_TIP_HEIGHT * self.radius, edge_height)

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the distance from the face, the torus at the edge, or the side wall.

        The gap under the face is -depth. Deep inside the edge it is continued linearly, so that it
        is a continuous and decreasing function of the depth everywhere.
        """
        e = self.edge_radius
        r = sqrt(x * x + y * y + 1e-24 * e * e)
        outward = maximum(r - (self.radius - e), 0.0 * r)
        downward = e - depth
        # Any length that vanishes near the side wall would do.
        linear_from = 0.5 * e * maximum(1 - 2 * outward / e, 0.0 * r) ** 2
        vertical_distance = maximum(downward, linear_from)
        distance = sqrt(outward * outward + vertical_distance * vertical_distance)
        return distance - e - (vertical_distance - downward) * vertical_distance / distance

    def radius_at(self, depth: float) -> float:
        """Return the radius of the punch [length], which is the same at any depth."""
        return self.radius

    def radius_scale(self, r: float) -> None:
        """Return None, because a flat punch has no radius R."""
        return None

    def characteristic_strain(self, delta: float, a: float) -> tuple[float, str]:
        """Return the characteristic strain of a contact, and the formula as text."""
        return _punch_strain(delta, a)

    def slope_discontinuities(self) -> list[tuple[float, float]]:
        """Return radius and rounding width [length] of each slope discontinuity."""
        return [(self.radius - self.edge_radius, self.edge_radius)]


@dataclass(frozen=True)
class Plate(_FlatTip):
    """Plane, f = 0 everywhere, which compresses a body over its whole flat top.

    With `material` the plate is soft: a cylinder of the given `radius` and `thickness`.
    """

    radius: Length | None = None
    shape: Literal["plate"] = "plate"
    material: TipMaterial = None
    thickness: Length | None = None

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) = 0 of the surface [length]."""
        return 0.0 * x

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return -depth, the distance from the plane."""
        return 0.0 * x - depth

    def radius_at(self, depth: float) -> float:
        """Return infinity [length], because a plane has no end."""
        return inf

    def radius_scale(self, r: float) -> None:
        """Return None, because a plane has no size."""
        return None

    def characteristic_strain(self, delta: float, a: float) -> tuple[float, str]:
        """Return the characteristic strain of a contact, and the formula as text."""
        return _punch_strain(delta, a)


class RegularPyramid(_PointedTip):
    """Regular pyramid f = cot(half_angle) * max(x . n) over the horizontal normals n of the faces.

    half_angle is the angle between axis and face. The normal of one face points along x, rotated by
    `rotation` degrees about z. With tip_radius > 0 the apex is rounded by a sphere and the edges by
    cylinders of this radius, with a continuous slope.
    """

    faces: Expr
    rotation: Expr
    is_axisymmetric: ClassVar[bool] = False

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the apex [length]."""
        rho = self.tip_radius
        slope = 1 / tan(self.half_angle)
        square = x * x + y * y
        s, t, p, q = self._sector_coordinates(x, y)
        face_height = slope * s - rho * (1 / sin(self.half_angle) - 1)
        # The edge is a line of the slope m, along which the center of the rounding ball moves.
        m = slope * cos(180 / self.faces)
        secant = sqrt(1 + m * m)
        chord = sqrt(maximum(rho * rho - q * q, 0.0 * q))
        edge_height = rho + m * p - secant * chord
        inside = minimum(square, rho * rho)
        cap_height = inside / (rho + sqrt(rho * rho - inside) + 1e-300)
        rounded = where_less(secant * p, m * chord, cap_height, edge_height)
        return where_less(
            (s - rho * cos(self.half_angle)) * tan(180 / self.faces), t, rounded, face_height
        )

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the gap, which is the distance from a sharp inner pyramid, less tip_radius.

        The inner pyramid is the surface of the centers of the spheres that round the tip.
        """
        rho = self.tip_radius
        slope = 1 / tan(self.half_angle)
        s, t, p, q = self._sector_coordinates(x, y)
        z = depth - rho
        face_distance = s * cos(self.half_angle) - z * sin(self.half_angle)
        face_foot = s - face_distance * cos(self.half_angle)
        m = slope * cos(180 / self.faces)
        edge_height = (m * p - z) / sqrt(1 + m * m)
        # The small term keeps the roots' derivatives finite where the roots are not used.
        floor = 1e-24 * rho * rho
        edge_distance = sqrt(q * q + edge_height * edge_height + floor)
        apex_distance = sqrt(x * x + y * y + z * z + floor)
        rounded_distance = where_less(p + m * z, 0.0, apex_distance, edge_distance)
        return (
            where_less(face_foot * tan(180 / self.faces), t, rounded_distance, face_distance) - rho
        )

    def _sector_coordinates(self, x: Expr, y: Expr) -> tuple[Expr, Expr, Expr, Expr]:
        """Return coordinates (s, t, p, q) in the sector of the nearest face [length].

        s and t are measured along and across the horizontal normal of the nearest face, p and q
        along and across the nearest edge.
        """
        turn = 360 / self.faces
        turns = [
            [self.rotation + turn * (k + shift) for k in range(self.faces)] for shift in (0, 0.5)
        ]
        s, p = (_largest([x * cos(angle) + y * sin(angle) for angle in angles]) for angles in turns)
        c = cos(turn / 2)
        d = sin(turn / 2)
        return s, (p - s * c) / d, p, (s - p * c) / d

    def radius_at(self, depth: float) -> float:
        """Return the equivalent radius of the section `depth` above the apex [length].

        This is the radius of a circle of equal area; the rounding of edges is neglected.
        """
        inscribed_cone = Cone(self.half_angle, self.tip_radius)
        is_on_cap = depth < self.tip_radius * (1 - sin(self.half_angle))
        return inscribed_cone.radius_at(depth) * (
            1.0 if is_on_cap else self.equivalent_radius_ratio
        )

    def characteristic_strain(self, delta: float, a: float) -> tuple[float, str]:
        """Return the strain for the cone with equal section areas, and its formula as text."""
        strain = 0.2 / (self.equivalent_radius_ratio * tan(self.half_angle))
        return strain, "0.2 cot(half_angle of the cone of equal sections)"

    @property
    def equivalent_radius_ratio(self) -> float:
        """Radius of a circle with the area of a section, divided by the inscribed radius."""
        return float(sqrt(self.faces * tan(180 / self.faces) / pi))

    def has_mirror_plane(self, degrees: float) -> bool:
        """Return whether the vertical plane at an angle [degrees] from x is a mirror plane."""
        period = 180 / self.faces
        remainder = (degrees - self.rotation) % period
        return bool(min(remainder, period - remainder) < 1e-9)


@dataclass(frozen=True)
class Pyramid(RegularPyramid):
    """Regular pyramid f = cot(half_angle) * max(x . n) over the horizontal normals n of the faces.

    half_angle is the angle between axis and face.
    """

    half_angle: HalfAngle
    faces: Faces = 4
    rotation: Angle = 0.0
    tip_radius: LengthOrZero = 0.0
    shape: Literal["pyramid"] = "pyramid"


@dataclass(frozen=True)
class Berkovich(RegularPyramid):
    """Berkovich tip: three faces at 65.27 degrees from the axis (ISO 14577-2).

    The section area at a given depth is the same as for a Vickers tip.
    """

    rotation: Angle = 0.0
    tip_radius: LengthOrZero = 0.0
    shape: Literal["berkovich"] = "berkovich"

    half_angle: ClassVar[float] = 65.27  # type: ignore[misc]
    faces: ClassVar[int] = 3  # type: ignore[misc]


@dataclass(frozen=True)
class Vickers(RegularPyramid):
    """Vickers tip: four faces at 68 degrees from the axis (ISO 6507-1)."""

    rotation: Angle = 0.0
    tip_radius: LengthOrZero = 0.0
    shape: Literal["vickers"] = "vickers"

    half_angle: ClassVar[float] = 68.0  # type: ignore[misc]
    faces: ClassVar[int] = 4  # type: ignore[misc]


@dataclass(frozen=True)
class CubeCorner(RegularPyramid):
    """Cube corner: three perpendicular faces, 35.26 degrees from the axis (ISO 14577-2).

    The angle is arctan(1/sqrt(2)).
    """

    rotation: Angle = 0.0
    tip_radius: LengthOrZero = 0.0
    shape: Literal["cube_corner"] = "cube_corner"

    half_angle: ClassVar[float] = degrees(atan(sqrt(0.5)))  # type: ignore[misc]
    faces: ClassVar[int] = 3  # type: ignore[misc]


@dataclass(frozen=True)
class Profile(_Tip):
    """Convex tip of revolution: f is linear between the points (r, z) and ends at the last point.

    With tip_radius > 0, apex and corners are rounded by parabolic arcs of this radius of curvature.
    """

    points: Points
    tip_radius: LengthOrZero = 0.0
    shape: Literal["profile"] = "profile"

    def check_points(self) -> None:
        """Raise ValueError unless the points define a convex tip with room for the arcs."""
        (r_0, z_0), *_ = self.points
        if r_0 != 0 or z_0 != 0:
            raise ValueError("the first point must be the apex [0, 0]")
        if any(a[0] >= b[0] for a, b in pairwise(self.points)):
            raise ValueError("r must increase from point to point")
        slope_jumps = self._slope_jumps()
        if min(slope_jumps) < -1e-9 * (1 + sum(map(abs, slope_jumps))):
            raise ValueError("the tip must be convex: the slope must not decrease")
        corners = zip(self.points[1:-1], slope_jumps[1:], strict=True)
        if any(self.tip_radius * jump / 2 > r for (r, _), jump in corners):
            raise ValueError("tip_radius is too large: the arc of a corner reaches the axis")

    def _slope_jumps(self) -> list[Expr]:
        """Return the change of slope at the apex and at every point but the last."""
        slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(self.points)]
        return [slopes[0], *(next_slope - slope for slope, next_slope in pairwise(slopes))]

    def rounding_arcs(self) -> list[tuple[Expr, Expr, Expr]]:
        """Return center radius [length], half-width [length] and change of slope of every arc."""
        rho = self.tip_radius
        slope_jumps = self._slope_jumps()
        arc_centers = [rho * slope_jumps[0] / 2, *(r for r, _ in self.points[1:-1])]
        return [
            (arc_center, rho * jump / 2, jump)
            for arc_center, jump in zip(arc_centers, slope_jumps, strict=True)
        ]

    def slope(self, r: Expr) -> Expr:
        """Return the slope f'(r) of the surface at the radius r."""
        arcs = ((r - c, w, jump) for c, w, jump in self.rounding_arcs())
        rho = self.tip_radius + TINY_LENGTH
        return sum(
            where_less(x, -w, 0.0, where_less(x, w, (x + w) / rho, jump)) for x, w, jump in arcs
        )

    def height_at_radius(self, r: Expr) -> Expr:
        """Return f(r) [length], ignoring the end of the tip."""
        height: Expr = 0.0
        for c, w, jump in self.rounding_arcs():
            distance_past = maximum(r - c + w, 0.0 * r)
            arc = minimum(distance_past, 2 * w)
            height = (
                height
                + arc * arc / (2 * (self.tip_radius + TINY_LENGTH))
                + jump * (distance_past - arc)
            )
        return height

    def height(self, x: Expr, y: Expr) -> Expr:
        """Return the height f(x, y) of the surface above the apex [length]."""
        r = sqrt(x * x + y * y)
        max_radius = self.points[-1][0]
        return where_less(
            max_radius * (1 + 1e-12), r, ENDED_TIP_HEIGHT * max_radius, self.height_at_radius(r)
        )

    def gap_current(self, x: Expr, y: Expr, depth: Expr) -> Expr:
        """Return the gap (f - depth) / |grad(f - z)| at the deformed point [length]."""
        r = sqrt(x * x + y * y + 1e-24 * self.tip_radius * self.tip_radius)
        max_radius = self.points[-1][0]
        slope = self.slope(r)
        distance = (self.height_at_radius(r) - depth) / sqrt(1 + slope * slope)
        return where_less(max_radius * (1 + 1e-12), r, ENDED_TIP_HEIGHT * max_radius, distance)

    def radius_at(self, depth: float) -> float:
        """Return the radius of the section `depth` above the apex, ignoring rounding [length]."""
        for (r_0, z_0), (r_1, z_1) in pairwise(self.points):
            if depth < z_1:
                return r_0 + (r_1 - r_0) * (depth - z_0) / (z_1 - z_0)
        return self.points[-1][0]

    def slope_discontinuities(self) -> list[tuple[float, float]]:
        """Return radius and rounding width [length] of each slope discontinuity."""
        corners = [(c - w, 2 * w) for c, w, jump in self.rounding_arcs() if jump > 1e-9]
        # The tip ends in a sharp edge.
        return [*corners, (self.points[-1][0], 0.0)]


def _punch_strain(delta: float, a: float) -> tuple[float, str]:
    """Return the characteristic strain of the contact of a flat punch, and its formula as text.

    A punch has no slope. Its mean pressure 2 E* delta/(pi a) is therefore multiplied by the ratio
    of strain to mean pressure of a ball, 0.2 a/R to 4 E* a/(3 pi R), which gives 0.3 delta/a.
    """
    return 0.3 * delta / a, "0.3 delta/a"


def _sphere_radius(r: float, height: float) -> float:
    """Return the radius [length] of the sphere through the apex and a surface point (r, height)."""
    return (r * r + height * height) / (2 * height) if height > 0 else inf


def _multiply(value: Any, factor: float) -> Any:
    """Return a number, or all numbers in nested tuples, multiplied by a factor; None unchanged."""
    if value is None:
        return None
    if isinstance(value, tuple):
        return tuple(_multiply(part, factor) for part in value)
    return factor * value


def _largest(values: Sequence[Expr]) -> Expr:
    """Return the maximum of several expressions, taken pairwise to limit the nesting."""
    while len(values) > 1:
        pairs = [values[k : k + 2] for k in range(0, len(values), 2)]
        values = [reduce(maximum, pair) for pair in pairs]
    return values[0]


Indenter = (
    Paraboloid
    | Sphere
    | Cone
    | Hyperboloid
    | FlatPunch
    | Plate
    | Pyramid
    | Berkovich
    | Vickers
    | CubeCorner
    | Profile
)


def max_radius(tip: _Tip) -> float:
    """Return the radius [length] at which a tip ends; infinity if it does not end."""
    match tip.upright:
        case Sphere(R=R):
            return R
        case FlatPunch(radius=radius):
            return radius
        case Profile(points=points):
            return points[-1][0]
    return inf


def flat_radius(tip: Indenter) -> float:
    """Return the radius [length] of a tip's flat face; 0 if the tip has no flat face."""
    match tip:
        case Plate():
            return inf
        case FlatPunch(radius=radius, edge_radius=edge_radius):
            return radius - edge_radius
    return 0.0


def sharp_edge_radius(tip: Indenter) -> float | None:
    """Return the radius [length] of the sharp edge at which a tip ends; None without an edge."""
    match tip.upright:
        case FlatPunch(radius=radius, edge_radius=0.0):
            return radius
        case Profile(points=points):
            return points[-1][0]
    return None


def gap_under_tip(tip: Indenter, gap: Expr) -> Expr:
    """Return gaps [length] for output, with NaN at points outside the radius at which the tip ends.

    At these points `height` returns ENDED_TIP_HEIGHT instead of infinity.
    """
    return where_less(gap, ENDED_TIP_HEIGHT / 1e3 * max_radius(tip), gap, nan)


def pass_through_depth(tip: Indenter) -> float:
    """Return the penetration [length] above which a surface point may leave at the far side.

    A converged solution with a larger penetration is not accepted, since the point may have been
    pushed out through the far side of the tip.

    The result is half the radius for a sphere, and infinity for other tips.
    """
    return tip.R / 2 if isinstance(tip, Sphere) else inf


def gap_reference(tip: Indenter, x: Expr, y: Expr, z: Expr, delta: Expr) -> Expr:
    """Return the reference gap f(X, Y) - delta - z at the undeformed point (X, Y) [length].

    z = Z + u_z is the height of the deformed point.
    """
    return tip.height(x, y) - delta - z


def gap_current(tip: Indenter, x: Expr, y: Expr, z: Expr, delta: Expr) -> Expr:
    """Return the current gap, the distance of the deformed point (x, y, z) from the tip [length].

    The apex of the tip is at z = -delta.
    """
    return tip.gap_current(x, y, z + delta)
