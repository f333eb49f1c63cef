"""Profiles of rigid tips for the layer theories: the shape f, and its Abel transform g.

A profile f(r) >= 0 [L] with f(0) = 0 is the height of the tip's surface above the apex. The
axisymmetric theories use only the Abel transform

    g(x) = x ∫_0^x f'(r)/sqrt(x^2 - r^2) dr [L],

and the theory of plane strain uses f(|x|). The contact is assumed to be one disc or band, so that
f' must not decrease.

Source: Sneddon (1965), Int. J. Eng. Sci. 3, 47.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from indent_sim.theory.solution import require_positive, tangent_of_half_angle

Shape = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Tip:
    """Rigid tip: profile, Abel transform, and the radii at which the profile is not smooth.

    Attributes
    ----------
    g
        Abel transform g(x) [L] of the profile, a function of an array of radii [L].
    f
        Profile f(x) [L], a function of an array of radii [L]; None if it is not smooth outside the
        apex, for which there is no plane strain theory.
    punch_radius
        Contact radius [L] of a flat punch; None if the contact grows with the load.
    max_radius
        Radius [L] at which the tip ends, an upper bound of the contact radius.
    slope_discontinuities
        Increasing radii [L] at which f' is not smooth.
    apex_slope
        Slope f'(0+); if it is not 0, the pressure at the apex is infinite.
    """

    g: Shape
    f: Shape | None = None
    punch_radius: float | None = None
    max_radius: float = math.inf
    slope_discontinuities: tuple[float, ...] = ()
    apex_slope: float = 0.0


def flat_plate() -> Tip:
    """Return an infinite plate f = g = 0, for spherical bodies (`tip_over_spherical_body`).

    The theory of a plate on a flat body is `Compression`.
    """
    return Tip(lambda x: 0.0 * x, lambda x: 0.0 * x)


def tip_over_spherical_body(tip: Tip, radius: float) -> Tip:
    """Return the tip that has the same gap over a flat body as `tip` over a spherical body.

    The surface of the body is the paraboloid r^2/(2 radius), so that g becomes g + x^2/radius. The
    contact of a flat punch then grows with the load, up to its edge.

    Parameters
    ----------
    tip
        Tip over the spherical body.
    radius
        Radius of the body's surface [L].
    """
    require_positive(radius=radius)
    max_radius = min(tip.max_radius, tip.punch_radius or math.inf)
    return replace(
        tip, g=lambda x: tip.g(x) + x * x / radius, f=None, punch_radius=None, max_radius=max_radius
    )


def paraboloid(R: float) -> Tip:
    """Return the paraboloid f = r^2/(2R), g = x^2/R of the radius of curvature R [L]."""
    require_positive(R=R)
    return Tip(lambda x: x * x / R, lambda x: x * x / (2.0 * R))


def sphere(R: float) -> Tip:
    """Return the sphere f = R - sqrt(R^2 - r^2), g = x artanh(x/R), x < R, of the radius R [L]."""
    require_positive(R=R)

    def f(x):
        """Return the profile without cancellation near the apex."""
        return x * x / (R + np.sqrt(np.maximum((R - x) * (R + x), 0.0)))

    return Tip(lambda x: x * np.arctanh(x / R), f, max_radius=R)


def cone(half_angle: float, tip_radius: float = 0.0) -> Tip:
    """Return the cone f = r cot(alpha), g = pi/2 x cot(alpha), sharp or with a spherical apex.

    Parameters
    ----------
    half_angle
        Angle alpha between axis and flank [degrees].
    tip_radius
        Radius [L] of a sphere that replaces the apex, tangent to the flank at r = tip_radius
        cos(alpha); 0 for a sharp cone.
    """
    cot = 1.0 / tangent_of_half_angle(half_angle)
    if tip_radius == 0.0:
        return Tip(lambda x: 0.5 * math.pi * cot * x, lambda x: cot * np.abs(x), apex_slope=cot)
    require_positive(tip_radius=tip_radius)
    junction = tip_radius * math.cos(math.radians(half_angle))

    def slope(r):
        """Return the slope of the sphere up to the junction, and of the flank beyond."""
        cap_radius = np.minimum(r, junction)
        return cap_radius / np.sqrt((tip_radius - cap_radius) * (tip_radius + cap_radius))

    return tip_from_slope(slope, slope_discontinuities=(junction,))


def hyperboloid(R: float, half_angle: float) -> Tip:
    """Return the hyperboloid f = r^2/(R (1 + sqrt(1 + (r/b)^2))), g = x b/R arctan(x/b).

    Parameters
    ----------
    R
        Radius of curvature of the apex [L]; b = R cot(alpha).
    half_angle
        Angle alpha between axis and asymptote [degrees].
    """
    require_positive(R=R)
    b = R / tangent_of_half_angle(half_angle)
    return Tip(
        lambda x: x * np.arctan(x / b) * b / R, lambda x: x * x / (R * (1.0 + np.hypot(1.0, x / b)))
    )


def equivalent_cone(
    half_angle: float, equivalent_radius_ratio: float, tip_radius: float = 0.0
) -> Tip:
    """Return the cone whose sections have the same areas as the sections of a pyramid.

    Parameters
    ----------
    half_angle
        Angle between the axis and the faces of the pyramid [degrees].
    equivalent_radius_ratio
        Ratio of the radius of a disc with the area of the pyramid's section to the section's
        inscribed radius.
    tip_radius
        Radius of a spherical apex [L], as for `cone`.
    """
    return cone(
        math.degrees(math.atan(equivalent_radius_ratio * math.tan(math.radians(half_angle)))),
        tip_radius,
    )


def flat_punch(radius: float, edge_radius: float = 0.0) -> Tip:
    """Return a flat punch, sharp (f = g = 0, fixed contact radius) or with a rounded edge.

    Parameters
    ----------
    radius
        Radius of the punch [L].
    edge_radius
        Radius [L] of the quarter circle that replaces the edge; 0 for a sharp edge.
    """
    require_positive(radius=radius)
    if edge_radius == 0.0:
        return Tip(lambda x: 0.0 * x, lambda x: 0.0 * x, punch_radius=radius)
    if not 0.0 < edge_radius <= radius:
        raise ValueError(f"edge_radius must lie in [0, radius], got {edge_radius!r}")
    flat_radius = radius - edge_radius

    def slope(r):
        """Return the slope of the rounded edge outside the flat part."""
        edge_distance = np.clip(r - flat_radius, 0.0, edge_radius * (1.0 - 1e-15))
        return edge_distance / np.sqrt(
            (edge_radius - edge_distance) * (edge_radius + edge_distance)
        )

    return tip_from_slope(
        slope, slope_discontinuities=(flat_radius,) if flat_radius > 0.0 else (), max_radius=radius
    )


def piecewise_linear(points: Sequence[Sequence[float]]) -> Tip:
    """Return the tip with a piecewise linear profile, which ends at the last point.

    Every jump d of the slope at a radius r_i adds g = d x arccos(r_i/x) for x > r_i.

    Parameters
    ----------
    points
        Points (r, z) [L] of the profile, z measured upwards from the apex (0, 0), the first point.

    Raises
    ------
    ValueError
        Unless the points start at (0, 0), r increases and the slope does not decrease (convex).
    """
    r, z = np.array(points, dtype=float).T
    if r.size < 2 or r[0] != 0.0 or z[0] != 0.0 or np.any(np.diff(r) <= 0.0):
        raise ValueError("points must start at [0, 0] and r must increase")
    slopes = np.diff(z) / np.diff(r)
    slope_jumps = np.diff(slopes, prepend=0.0)
    if np.any(slope_jumps < -1e-12 * np.max(np.abs(slopes))):
        raise ValueError("points must describe a convex tip: the slope must not decrease")

    def g(x):
        """Return the sum of the terms of all slope jumps."""
        x = np.asarray(x, dtype=float)
        nonzero_x = np.where(x > 0.0, x, 1.0)
        jump_terms = (
            d * np.arccos(np.minimum(c / nonzero_x, 1.0))
            for d, c in zip(slope_jumps, r[:-1], strict=True)
        )
        return x * sum(jump_terms)

    return Tip(
        g,
        max_radius=float(r[-1]),
        slope_discontinuities=tuple(r[1:-1].tolist()),
        apex_slope=float(slopes[0]),
    )


def tip_from_slope(
    slope: Shape,
    *,
    max_radius: float = math.inf,
    slope_discontinuities: Sequence[float] = (),
    apex_slope: float = 0.0,
) -> Tip:
    """Return a tip from its slope f'(r), with g(x) = x ∫_0^{pi/2} f'(x sin q) dq by quadrature.

    The quadrature converges exponentially between the slope discontinuities.

    Parameters
    ----------
    slope
        Slope f' at an array of radii [L].
    max_radius
        Radius [L] at which the tip ends.
    slope_discontinuities
        Radii [L] at which f' jumps or has a kink.
    apex_slope
        Slope f'(0+).
    """
    slope_discontinuities = tuple(float(b) for b in slope_discontinuities)
    node, weight = np.polynomial.legendre.leggauss(48)

    def g(x):
        """Return the Abel transform by Gauss's rule between the slope discontinuities."""
        x = np.asarray(x, dtype=float)
        nonzero_x = np.where(x > 0.0, x, 1.0)
        break_angles = [np.arcsin(np.minimum(b / nonzero_x, 1.0)) for b in slope_discontinuities]
        ends = [np.zeros_like(nonzero_x), *break_angles, np.full_like(nonzero_x, 0.5 * math.pi)]
        integral = np.zeros_like(nonzero_x)
        for lo, hi in pairwise(ends):
            half = 0.5 * (hi - lo)
            angle = (0.5 * (hi + lo))[..., None] + half[..., None] * node
            integral += half * np.sum(weight * slope(x[..., None] * np.sin(angle)), axis=-1)
        return x * integral

    return Tip(
        g, max_radius=max_radius, slope_discontinuities=slope_discontinuities, apex_slope=apex_slope
    )
