"""Rigid tips as formulas. A tip stands on its axis with the apex at the origin, z up; nothing is meshed.

`height(x, y)` is the tip's surface z = f above the apex level at the horizontal position (x, y) from the axis.
`gap_reference` (small strain) tests it at the undeformed point with pressure along z; `gap_current` tests the
deformed point with pressure along the tip's normal. Both return g [length], >= 0 open; formulas take
floats, numpy arrays or UFL expressions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from indent_sim.model.algebra import maximum, minimum, sqrt, tan, where_less
from indent_sim.model.quantities import HalfAngle, Length, LengthOrZero

# A tip that ends (sphere beyond R, punch beyond its radius) is this many of its own radii away there:
# far enough never to touch, small enough to stay finite in derivatives.
FAR = 1e3


@dataclass(frozen=True)
class Paraboloid:
    """f = r^2 / (2 R): Hertz' own tip (notes 3.1)."""

    R: Length
    shape: Literal["paraboloid"] = "paraboloid"

    def height(self, x: Any, y: Any) -> Any:
        """f(x, y) [length]."""
        return (x * x + y * y) / (2 * self.R)

    def gap_current(self, x: Any, y: Any, depth: Any) -> Any:
        """(f - depth) / |grad(f - z)| at the deformed point, a length that vanishes on the tip."""
        return (self.height(x, y) - depth) / sqrt(1 + (x * x + y * y) / (self.R * self.R))

    def radius_at(self, depth: float) -> float:
        """Radius of the tip's section `depth` above its apex [length]."""
        return float(sqrt(2 * self.R * depth))


@dataclass(frozen=True)
class Sphere:
    """The exact ball, f = r^2 / (R + sqrt(R^2 - r^2)) for r < R; no contact beyond."""

    R: Length
    shape: Literal["sphere"] = "sphere"

    def height(self, x: Any, y: Any) -> Any:
        """f(x, y) [length], in the form that keeps its digits for r << R."""
        square = x * x + y * y
        R2 = self.R * self.R
        # both branches of a conditional are differentiated, so the root's argument stays positive
        inside = minimum(square, (1 - 1e-12) * R2)
        cap = inside / (self.R + sqrt(R2 - inside))
        return where_less(square, R2, cap, FAR * self.R)

    def gap_current(self, x: Any, y: Any, depth: Any) -> Any:
        """|X + u - c| - R, with c the ball's centre; written to keep its digits when shallow."""
        # |v|^2 - R^2 = x^2 + y^2 + depth (depth - 2 R) with depth measured upward from the apex
        difference = x * x + y * y + depth * (depth - 2 * self.R)
        return difference / (sqrt(difference + self.R * self.R) + self.R)

    def radius_at(self, depth: float) -> float:
        """Radius of the tip's section `depth` above its apex [length]."""
        depth = min(depth, self.R)
        return float(sqrt(depth * (2 * self.R - depth)))


@dataclass(frozen=True)
class Cone:
    """f = r cot(half_angle); with tip_radius > 0 the apex is a spherical cap that meets the flank smoothly."""

    half_angle: HalfAngle
    tip_radius: LengthOrZero = 0.0
    shape: Literal["cone"] = "cone"

    def height(self, x: Any, y: Any) -> Any:
        """f(x, y) [length]."""
        r = sqrt(x * x + y * y)
        slope = 1 / tan(self.half_angle)
        # cap and flank meet where the cap's slope is the flank's: r = rho cos(half_angle)
        rho = self.tip_radius
        secant = sqrt(1 + slope * slope)
        junction = rho * slope / secant
        s = minimum(r, junction)
        cap = s * s / (rho + sqrt(rho * rho - s * s) + 1e-300)
        return cap + slope * (r - s)

    def gap_current(self, x: Any, y: Any, depth: Any) -> Any:
        """(f - depth) sin(half_angle) on the flank, the ball's distance on the cap."""
        slope = 1 / tan(self.half_angle)
        rho = self.tip_radius
        square = x * x + y * y
        r = sqrt(square + 1e-24 * rho * rho)  # the root's derivative at r = 0 stays finite
        secant = sqrt(1 + slope * slope)
        flank = (slope * r - rho * (secant - 1) - depth) / secant
        difference = square + depth * (depth - 2 * rho)
        cap = difference / (sqrt(maximum(difference + rho * rho, 1e-12 * rho * rho)) + rho)
        # the cone of normals through the junction circle separates the two regions
        return where_less(r, slope * maximum(rho - depth, 0.0 * depth), cap, flank)

    def radius_at(self, depth: float) -> float:
        """Radius of the tip's section `depth` above its apex [length] (sharp flank)."""
        return float(depth * tan(self.half_angle)) + self.tip_radius


@dataclass(frozen=True)
class FlatPunch:
    """f = 0 for r <= radius, nothing beyond; with edge_radius > 0 the edge is a quarter circle."""

    radius: Length
    edge_radius: LengthOrZero = 0.0
    shape: Literal["flat_punch"] = "flat_punch"

    def height(self, x: Any, y: Any) -> Any:
        """f(x, y) [length]."""
        r = sqrt(x * x + y * y)
        e = self.edge_radius
        beyond = minimum(maximum(r - (self.radius - e), 0.0 * r), e)
        edge = beyond * beyond / (e + sqrt(e * e - beyond * beyond) + 1e-300)
        return where_less(self.radius * (1 + 1e-12), r, FAR * self.radius, edge)

    def gap_current(self, x: Any, y: Any, depth: Any) -> Any:
        """Signed distance to the rounded punch: -depth under the flat, the distance to the torus at the edge."""
        e = self.edge_radius
        r = sqrt(x * x + y * y + 1e-24 * e * e)
        outward = r - (self.radius - e)
        downward = e - depth
        corner = sqrt(maximum(outward, 1e-9 * e) ** 2 + maximum(downward, 0.0 * depth) ** 2) - e
        return where_less(outward, 0.0, -depth, corner)

    def radius_at(self, depth: float) -> float:
        """The punch's radius at any depth [length]."""
        return self.radius


Indenter = Paraboloid | Sphere | Cone | FlatPunch


def gap_reference(tip: Indenter, x: Any, y: Any, u_z: Any, delta: Any) -> Any:
    """g = f(X, Y) - delta - u_z at the undeformed point [length], >= 0 open."""
    return tip.height(x, y) - delta - u_z


def gap_current(tip: Indenter, x: Any, y: Any, z: Any, delta: Any) -> Any:
    """Distance of the deformed point (x, y, z) from the tip whose apex is at z = -delta [length], >= 0 open."""
    return tip.gap_current(x, y, z + delta)
