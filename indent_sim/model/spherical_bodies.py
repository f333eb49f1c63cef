"""Bodies with a curved top: the cap, the ball and the ellipsoid of revolution."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, tan
from typing import Annotated, ClassVar, Literal

from annotated_types import Gt, Lt

from indent_sim.model.body_base import CenteredBody, RestingSupport, RoundBody
from indent_sim.model.inclusions import Inclusion, Inclusions
from indent_sim.model.layers import Layers
from indent_sim.model.units import (
    ANGLE,
    Length,
    SurfaceTension,
)

ContactAngle = Annotated[float, Gt(0), Lt(180), ANGLE]


@dataclass(frozen=True)
class SphericalBody(RoundBody):
    """Part of a ball between its apex at z = 0 and the base plane z = -height [length].

    A whole ball (height = 2 radius) is supported below the equator instead. An unbonded body rests
    on a rigid flat, without friction, and may lift off. For `contacts_per_body` see `Scales`. With
    a `vertical_semi_axis` the ball is stretched along its axis to an ellipsoid of revolution, and
    `radius` is its horizontal semi-axis.
    """

    radius: Length
    height: Length
    shape: Literal["cap", "ball", "ellipsoid"]
    base: RestingSupport = "fixed"
    contacts_per_body: int = 1
    inclusions: Inclusions | None = None
    vertical_semi_axis: Length | None = None

    @property
    def max_coating_thickness(self) -> float:
        """Upper bound of the total thickness of all coatings [length].

        With thicker coatings the core would not reach the base.
        """
        return self.radius if self.is_whole else min(self.height, 2 * self.radius - self.height)

    @property
    def half_height(self) -> float:
        """Depth of the widest section of the whole ball or ellipsoid below the apex [length]."""
        return self.vertical_semi_axis or self.radius

    @property
    def stretch(self) -> float:
        """Vertical over horizontal semi-axis; 1 for a sphere."""
        return self.half_height / self.radius

    @property
    def apex_radius(self) -> float:
        """Radius of curvature at the apex [length]: radius^2/half_height."""
        return self.radius / self.stretch

    @property
    def is_whole(self) -> bool:
        """True if the body is a whole ball or ellipsoid."""
        return self.height == 2 * self.half_height

    @property
    def rests_on_flat(self) -> bool:
        """True if the body rests on a rigid flat without a bond."""
        return self.base == "unbonded"

    @property
    def base_edge(self) -> tuple[float, float]:
        """Coordinates (r, z) [length] of the edge between the curved surface and the base."""
        depth = self.half_height if self.is_whole else self.height
        depth_in_ball = depth / self.stretch
        return float(depth_in_ball * (2 * self.radius - depth_in_ball)) ** 0.5, -depth

    @property
    def max_section_radius(self) -> float:
        """Largest radius of a horizontal section [length]."""
        return self.radius if self.height > self.half_height else self.base_edge[0]

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Return the distance [length] from an inclusion to the curved surface.

        The distance is negative if the inclusion protrudes.
        """
        return self.radius - inclusion.farthest_distance((0.0, 0.0, -self.radius))


@dataclass(frozen=True)
class Cap(CenteredBody):
    """Spherical cap with the radius `base_radius` of the base in the plane z = -height [length].

    Either `height` or `contact_angle` [degrees] is given, the angle between base and surface inside
    the body: height = base_radius tan(contact_angle/2). Beyond 90 degrees the body is wider than
    the base. Layers are concentric coatings of constant thickness from the curved surface inwards;
    the last layer is the core and has no `thickness`. base "unbonded": the cap rests on a rigid
    flat without friction, and its base may lift off.
    """

    base_radius: Length
    height: Length | None = None
    contact_angle: ContactAngle | None = None
    shape: Literal["cap"] = "cap"
    base: RestingSupport = "fixed"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    @property
    def apex_height(self) -> float:
        """Height of the apex above the base [length], given or from the contact angle."""
        return self.height or self.base_radius * tan(radians(self.contact_angle or 90.0) / 2)

    @property
    def spherical_body(self) -> SphericalBody:
        """Return the same cap defined by the radius (base_radius^2 + height^2)/(2 height)."""
        height = self.apex_height
        radius = (self.base_radius**2 + height**2) / (2 * height)
        return SphericalBody(radius, height, "cap", self.base, inclusions=self.inclusions)


@dataclass(frozen=True)
class Ball(CenteredBody):
    """Ball whose highest point is the origin: -2 radius <= z <= 0 [length].

    base "roller": the plane through the center is a mirror plane, and an equal tip pushes up from
    below. `delta` is the approach of the two tips; an inclusion lies above the mirror plane and has
    a mirror image below it, or is centered on it. base "fixed": the lower half of the surface is
    bonded to a rigid support. base "unbonded": the ball rests on a rigid flat without friction, in
    a second contact with another contact radius. Layers are concentric coatings from the surface
    inwards; the last one, the core, has no thickness.
    """

    radius: Length
    shape: Literal["ball"] = "ball"
    base: RestingSupport = "roller"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    @property
    def spherical_body(self) -> SphericalBody:
        """Return the modelled part: the half above the mirror plane, or the whole ball."""
        if self.base == "roller":
            return SphericalBody(self.radius, self.radius, "ball", self.base, 2, self.inclusions)
        return SphericalBody(
            self.radius, 2 * self.radius, "ball", self.base, inclusions=self.inclusions
        )


@dataclass(frozen=True)
class Ellipsoid(CenteredBody):
    """Ellipsoid of revolution about the z axis: -height <= z <= 0, `radius` wide [length].

    `radius` is the horizontal semi-axis, and half of `height` the vertical one: the ellipsoid is
    oblate if height < 2 radius, and a ball if both are equal. The supports are those of a ball.
    """

    radius: Length
    height: Length
    shape: Literal["ellipsoid"] = "ellipsoid"
    base: RestingSupport = "roller"

    # It consists of one material without surface tension.
    layers: ClassVar[None] = None
    inclusions: ClassVar[None] = None
    surface_tension: ClassVar[float] = 0.0

    @property
    def spherical_body(self) -> SphericalBody:
        """Return the modelled part: the half above the mirror plane, or the whole ellipsoid."""
        c = self.height / 2
        if self.base == "roller":
            return SphericalBody(self.radius, c, "ellipsoid", self.base, 2, vertical_semi_axis=c)
        return SphericalBody(self.radius, 2 * c, "ellipsoid", self.base, vertical_semi_axis=c)


CurvedBody = Cap | Ball | Ellipsoid
