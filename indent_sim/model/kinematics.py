"""Kinematics: 3D displacement gradient from the displacement of an axisymmetric or plane model."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import ClassVar, Literal

from indent_sim.model.algebra import Expr, ufl


class _Kinematics:
    """Base class with defaults: circular contact, two-dimensional section, integration weight 1."""

    def model_vector(self, v: Expr) -> Expr:
        """Return the components of a 3-vector along the two axes of the model."""
        return ufl.as_vector([v[0], v[2]])

    def space_vector(self, v: Expr) -> Expr:
        """Return a vector of the model as a 3-vector."""
        return ufl.as_vector([v[0], 0, v[1]])

    def contact_area(self, a: float) -> float:
        """Return the contact area pi a^2 [length^2] for a contact radius a."""
        return pi * a**2

    def contact_radius(self, area: float) -> float:
        """Return the contact radius sqrt(area/pi) [length] for a contact area [length^2]."""
        return sqrt(area / pi)

    def integration_weight(self, x: Expr) -> Expr:
        """Return the weight of the integrand in integrals over the model."""
        return 1.0


@dataclass(frozen=True)
class Axisymmetric(_Kinematics):
    """Axisymmetric kinematics u = (u_r, u_z)(r, z).

    The hoop strain is u_r/r, and integrals have the weight 2 pi r.
    """

    name: Literal["axisymmetric"] = "axisymmetric"
    dim: int = 2
    axes: tuple[str, ...] = ("r", "z")
    reason: ClassVar[str] = (
        "axisymmetric: body and tip are rotationally symmetric about the same axis"
    )

    def displacement_gradient(self, u: Expr, x: Expr) -> Expr:
        """Return the displacement gradient H (3 x 3) in the basis (r, theta, z)."""
        h = ufl.grad(u)
        return ufl.as_tensor([[h[0, 0], 0, h[0, 1]], [0, u[0] / x[0], 0], [h[1, 0], 0, h[1, 1]]])

    def horizontal_position(self, point: Expr, center: Expr) -> tuple[Expr, Expr]:
        """Return the horizontal position (r, 0) from the axis of symmetry [length]."""
        return point[0], 0.0

    def integration_weight(self, x: Expr) -> Expr:
        """Return the weight 2 pi r [length] of integrands over (r, z)."""
        return 2 * pi * x[0]


@dataclass(frozen=True)
class PlaneStrain(_Kinematics):
    """Plane strain kinematics u = (u_x, u_z)(x, z); everything is per unit length along y."""

    name: Literal["plane_strain"] = "plane_strain"
    dim: int = 2
    axes: tuple[str, ...] = ("x", "z")
    reason: ClassVar[str] = (
        "plane strain: a strip is infinite along y without strain in y; forces are per unit length"
    )

    def displacement_gradient(self, u: Expr, x: Expr) -> Expr:
        """Return the displacement gradient H (3 x 3) in the basis (x, y, z)."""
        h = ufl.grad(u)
        return ufl.as_tensor([[h[0, 0], 0, h[0, 1]], [0, 0, 0], [h[1, 0], 0, h[1, 1]]])

    def horizontal_position(self, point: Expr, center: Expr) -> tuple[Expr, Expr]:
        """Return the horizontal position (x - c, 0) from the tip's axis [length]."""
        return point[0] - center[0], 0.0

    def contact_area(self, a: float) -> float:
        """Return the contact area per unit length, the width 2 a [length]."""
        return 2 * a

    def contact_radius(self, area: float) -> float:
        """Return the half-width [length] of a contact, half its area per unit length [length]."""
        return area / 2


@dataclass(frozen=True)
class ThreeDimensional(_Kinematics):
    """Three-dimensional kinematics u = (u_x, u_y, u_z)(x, y, z)."""

    name: Literal["three_dimensional"] = "three_dimensional"
    dim: int = 3
    axes: tuple[str, ...] = ("x", "y", "z")
    reason: ClassVar[str] = "three-dimensional: tip and body together have no axis of symmetry"

    def displacement_gradient(self, u: Expr, x: Expr) -> Expr:
        """Return the displacement gradient H (3 x 3)."""
        return ufl.grad(u)

    def horizontal_position(self, point: Expr, center: Expr) -> tuple[Expr, Expr]:
        """Return the horizontal position (x - c_x, y - c_y) from the tip's axis [length]."""
        return point[0] - center[0], point[1] - center[1]

    def space_vector(self, v: Expr) -> Expr:
        """Return the vector itself, because model and space have the same axes."""
        return v

    def model_vector(self, v: Expr) -> Expr:
        """Return the vector itself, because model and space have the same axes."""
        return v


Kinematics = Axisymmetric | PlaneStrain | ThreeDimensional
