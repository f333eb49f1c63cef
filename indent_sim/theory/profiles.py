"""Rigid tips as the layer theories see them: their shape in plane strain, its Abel transform about
an axis.

A profile f(r) >= 0 [L], f(0) = 0, enters the axisymmetric theory only through g(x) = x ∫_0^x
f'(r)/sqrt(x^2 - r^2) dr [L] (Sneddon 1965), and the plane one, even in x, as it is. Contact is
assumed to be one disc or band, so f' must not decrease.
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
    """One tip: g(x) and f(x) (array in, array out, [L]) and the facts that quadrature must know
    about it.

    f: None for a tip that plane strain does not know, since its shape is not smooth beside the
    apex. edge: contact radius that the shape imposes (flat punch), or None if the contact grows
    with the load [L]. reach: radius at which the tip ends; the contact stays below it [L]. breaks:
    increasing radii where f' is not smooth [L]. corner: the slope f'(0+); where it is not 0 the
    pressure at the apex is infinite.
    """

    g: Shape
    f: Shape | None = None
    punch_radius: float | None = None
    max_radius: float = math.inf
    slope_discontinuities: tuple[float, ...] = ()
    apex_slope: float = 0.0


def flat_plate() -> Tip:
    """f = g = 0 without end: a tip for curved bodies, see `tip_over_spherical_body`; on flat ones it is that of
    `Compression`.
    """
    return Tip(lambda x: 0.0 * x, lambda x: 0.0 * x)


def tip_over_spherical_body(tip: Tip, radius: float) -> Tip:
    """The tip that leaves over a flat body the gap of this one over a paraboloid r^2/(2 radius): g
    + x^2/radius. What a flat punch touches then grows with the load, up to its edge.
    """
    require_positive(radius=radius)
    max_radius = min(tip.max_radius, tip.punch_radius or math.inf)
    return replace(
        tip, g=lambda x: tip.g(x) + x * x / radius, f=None, punch_radius=None, max_radius=max_radius
    )


def paraboloid(R: float) -> Tip:
    """f = r^2/(2R), g = x^2/R."""
    require_positive(R=R)
    return Tip(lambda x: x * x / R, lambda x: x * x / (2.0 * R))


def sphere(R: float) -> Tip:
    """f = R - sqrt(R^2 - r^2), g = x artanh(x/R) = x/2 ln((R+x)/(R-x)), x < R."""
    require_positive(R=R)

    def f(x):
        return x * x / (R + np.sqrt(np.maximum((R - x) * (R + x), 0.0)))

    return Tip(lambda x: x * np.arctanh(x / R), f, max_radius=R)


def cone(half_angle: float, tip_radius: float = 0.0) -> Tip:
    """f = r cot(alpha), g = pi/2 x cot(alpha); alpha in degrees between axis and flank.

    With tip_radius > 0 a sphere of that radius replaces the apex, tangent to the flank at r =
    tip_radius cos(alpha).
    """
    cot = 1.0 / tangent_of_half_angle(half_angle)
    if tip_radius == 0.0:
        return Tip(lambda x: 0.5 * math.pi * cot * x, lambda x: cot * np.abs(x), apex_slope=cot)
    require_positive(tip_radius=tip_radius)
    junction = tip_radius * math.cos(math.radians(half_angle))

    def slope(r):
        cap_radius = np.minimum(r, junction)
        return cap_radius / np.sqrt((tip_radius - cap_radius) * (tip_radius + cap_radius))

    return tip_from_slope(slope, slope_discontinuities=(junction,))


def hyperboloid(R: float, half_angle: float) -> Tip:
    """f = r^2/(R (1 + sqrt(1 + (r/b)^2))), g = x b/R arctan(x/b), b = R cot(alpha); alpha in
    degrees between axis and asymptote.
    """
    require_positive(R=R)
    b = R / tangent_of_half_angle(half_angle)
    return Tip(
        lambda x: x * np.arctan(x / b) * b / R, lambda x: x * x / (R * (1.0 + np.hypot(1.0, x / b)))
    )


def equivalent_cone(half_angle: float, roundness: float, tip_radius: float = 0.0) -> Tip:
    """The cone with sections as large as a pyramid's, of `roundness` times their inner radius."""
    return cone(math.degrees(math.atan(roundness * math.tan(math.radians(half_angle)))), tip_radius)


def flat_punch(radius: float, edge_radius: float = 0.0) -> Tip:
    """f = 0, g = 0, contact radius fixed; with edge_radius > 0 the rim is a quarter circle of that
    radius.
    """
    require_positive(radius=radius)
    if edge_radius == 0.0:
        return Tip(lambda x: 0.0 * x, lambda x: 0.0 * x, punch_radius=radius)
    if not 0.0 < edge_radius <= radius:
        raise ValueError(f"edge_radius must lie in [0, radius], got {edge_radius!r}")
    flat_radius = radius - edge_radius

    def slope(r):
        edge_distance = np.clip(r - flat_radius, 0.0, edge_radius * (1.0 - 1e-15))
        return edge_distance / np.sqrt(
            (edge_radius - edge_distance) * (edge_radius + edge_distance)
        )

    return tip_from_slope(
        slope, slope_discontinuities=(flat_radius,) if flat_radius > 0.0 else (), max_radius=radius
    )


def piecewise_linear(points: Sequence[Sequence[float]]) -> Tip:
    """f through the points (r, z), z measured up from the apex (0, 0), and straight between them.

    Every jump d of the slope at r_i adds g = d x arccos(r_i/x) for x > r_i. The tip ends at the
    last point. Raises ValueError unless it starts at (0, 0), r increases and the slope does not
    decrease (convex).
    """
    r, z = np.array(points, dtype=float).T
    if r.size < 2 or r[0] != 0.0 or z[0] != 0.0 or np.any(np.diff(r) <= 0.0):
        raise ValueError("points must start at [0, 0] and r must increase")
    slopes = np.diff(z) / np.diff(r)
    slope_jumps = np.diff(slopes, prepend=0.0)
    if np.any(slope_jumps < -1e-12 * np.max(np.abs(slopes))):
        raise ValueError("points must describe a convex tip: the slope must not decrease")

    def g(x):
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
    """Any tip from its slope f'(r) (array in, array out): g(x) = x ∫_0^{pi/2} f'(x sin q) dq by
    quadrature. breaks: the radii where f' jumps or kinks; between them the quadrature converges
    exponentially.
    """
    slope_discontinuities = tuple(float(b) for b in slope_discontinuities)
    node, weight = np.polynomial.legendre.leggauss(48)

    def g(x):
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
