"""Characteristic strain of a contact by the slope of the tip at its edge."""

from __future__ import annotations

from indent_sim.model.algebra import cos, tan
from indent_sim.model.tips import (
    Cone,
    Hyperboloid,
    Indenter,
    Paraboloid,
    Profile,
    RegularPyramid,
    Sphere,
    max_radius,
)


def characteristic_strain(tip: Indenter, delta: float, a: float) -> tuple[float, str]:
    """The strain beside a contact and the formula that gave it.

    0.2 times the tip's slope at the contact's edge (Tabor 1951 for a ball, Johnson 1985, 6.3 for a
    cone, whatever its depth), a pyramid as the cone of equal sections. A punch has no slope: 0.3
    delta/a, which is the same share of the mean pressure 2 E* delta/(pi a) as 0.2 a/R is of a
    ball's 4 E* a/(3 pi R), within 1 %.
    """
    match tip:
        case Paraboloid(R=R) | Sphere(R=R) if a < R or isinstance(tip, Paraboloid):
            return 0.2 * a / R, "0.2 a/R"
        case Cone(half_angle=angle, tip_radius=radius) if a > radius * cos(angle):
            return 0.2 / tan(angle), "0.2 cot(half_angle)"
        case Cone(tip_radius=radius):
            return 0.2 * a / radius, "0.2 a/tip_radius"
        case RegularPyramid(half_angle=angle, equivalent_radius_ratio=roundness):
            return 0.2 / (
                roundness * tan(angle)
            ), "0.2 cot(half_angle of the cone of equal sections)"
        case Profile() | Hyperboloid() if a < max_radius(tip):
            return 0.2 * tip.slope(a), "0.2 times the slope at the contact's edge"
    return 0.3 * delta / a, "0.3 delta/a"
