"""Bodies with a spherical surface: the cap and the ball."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, tan
from typing import Annotated, Literal

from annotated_types import Gt, Lt

from indent_sim.model.body_base import BaseSupport, CenteredBody, RoundBody
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
    """The piece of a ball below its apex at z = 0, down to the plane z = -height [length]; its base
    is there.

    A whole ball (height = 2 radius) is held below its equator instead. pieces: see `Scales`.
    """

    radius: Length
    height: Length
    shape: Literal["cap", "ball"]
    base: BaseSupport = "fixed"
    contacts_per_body: int = 1
    inclusions: Inclusions | None = None

    @property
    def max_coating_thickness(self) -> float:
        """How thick skins may be together [length], all but: beyond it the core would not reach the
        base.
        """
        return (
            self.radius
            if self.height == 2 * self.radius
            else min(self.height, 2 * self.radius - self.height)
        )

    @property
    def base_edge(self) -> tuple[float, float]:
        """(r, z) [length] of the edge between the curved surface and the base."""
        depth = self.radius if self.height == 2 * self.radius else self.height
        return float(depth * (2 * self.radius - depth)) ** 0.5, -depth

    @property
    def max_section_radius(self) -> float:
        """The largest radius of a horizontal section [length]."""
        return self.radius if self.height > self.radius else self.base_edge[0]

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Distance [length] from an inclusion to the curved surface; negative where it is outside."""
        return self.radius - inclusion.farthest_distance((0.0, 0.0, -self.radius))


@dataclass(frozen=True)
class Cap(CenteredBody):
    """The part of a ball above the plane z = -height, on which it stands with `base_radius`
    [length].

    Either `height` or `contact_angle` [degrees], between base and surface inside the body: height =
    base_radius tan(contact_angle/2). Beyond 90 degrees the body is wider than its base. Layers are
    skins of constant thickness, concentric, from the curved surface inwards; the last one, the
    core, has no thickness.
    """

    base_radius: Length
    height: Length | None = None
    contact_angle: ContactAngle | None = None
    shape: Literal["cap"] = "cap"
    base: BaseSupport = "fixed"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    @property
    def apex_height(self) -> float:
        """The height, given or by the contact angle [length]."""
        return self.height or self.base_radius * tan(radians(self.contact_angle or 90.0) / 2)

    @property
    def spherical_body(self) -> SphericalBody:
        """The same body by the radius of its ball, (base_radius^2 + height^2)/(2 height)."""
        height = self.apex_height
        radius = (self.base_radius**2 + height**2) / (2 * height)
        return SphericalBody(radius, height, "cap", self.base, inclusions=self.inclusions)


@dataclass(frozen=True)
class Ball(CenteredBody):
    """A ball whose highest point is the origin: -2 radius <= z <= 0 [length].

    base roller: the plane through its center is a mirror plane, below which the same tip pushes up:
    `delta` is the approach of the two, and an inclusion is above that plane, and mirrored, or
    centered on it. fixed: the lower half of its surface is bonded to something rigid. Layers are
    concentric skins from the surface inwards; the last one, the core, has no thickness.
    """

    radius: Length
    shape: Literal["ball"] = "ball"
    base: BaseSupport = "roller"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    @property
    def spherical_body(self) -> SphericalBody:
        """What is modelled of it: the half above the mirror plane, or all of it."""
        if self.base == "roller":
            return SphericalBody(self.radius, self.radius, "ball", self.base, 2, self.inclusions)
        return SphericalBody(
            self.radius, 2 * self.radius, "ball", self.base, inclusions=self.inclusions
        )
