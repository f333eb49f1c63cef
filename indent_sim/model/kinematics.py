"""From the displacement of a reduced model to the three-dimensional displacement gradient and back."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import ClassVar, Literal

from indent_sim.model.algebra import Expr, ufl


class _Kinematics:
    """What holds where nothing else is said: a round contact, a section in (r or x, z), and no
    weight.
    """

    def model_vector(self, v: Expr) -> Expr:
        """The components of a 3-vector along the model's own axes."""
        return ufl.as_vector([v[0], v[2]])

    def space_vector(self, v: Expr) -> Expr:
        """The 3-vector of a vector along the model's own axes."""
        return ufl.as_vector([v[0], 0, v[1]])

    def contact_area(self, a: float) -> float:
        """pi a^2 [length^2] of a contact of radius a."""
        return pi * a**2

    def contact_radius(self, area: float) -> float:
        """sqrt(area/pi) [length] of a contact of that area [length^2]."""
        return sqrt(area / pi)

    def integration_weight(self, x: Expr) -> Expr:
        """What an integral over the model must be multiplied with."""
        return 1.0


@dataclass(frozen=True)
class Axisymmetric(_Kinematics):
    """u = (u_r, u_z)(r, z); the hoop strain is u_r / r and a ring of radius r weighs 2 pi r."""

    name: Literal["axisymmetric"] = "axisymmetric"
    dim: int = 2
    axes: tuple[str, ...] = ("r", "z")
    reason: ClassVar[str] = (
        "body and tip turn about one axis: (r, z) says it all, a point stands for a ring"
    )

    def displacement_gradient(self, u: Expr, x: Expr) -> Expr:
        """Displacement gradient H (3x3) in the basis (r, theta, z)."""
        h = ufl.grad(u)
        return ufl.as_tensor([[h[0, 0], 0, h[0, 1]], [0, u[0] / x[0], 0], [h[1, 0], 0, h[1, 1]]])

    def horizontal_position(self, point: Expr, center: Expr) -> tuple[Expr, Expr]:
        """Horizontal position (r, 0) relative to the tip's axis, which is the axis of symmetry
        [length].
        """
        return point[0], 0.0

    def integration_weight(self, x: Expr) -> Expr:
        """Circumference 2 pi r [length]: what an integral over (r, z) must be multiplied with."""
        return 2 * pi * x[0]


@dataclass(frozen=True)
class PlaneStrain(_Kinematics):
    """u = (u_x, u_z)(x, z); everything is per unit length along y."""

    name: Literal["plane_strain"] = "plane_strain"
    dim: int = 2
    axes: tuple[str, ...] = ("x", "z")
    reason: ClassVar[str] = (
        "a strip is the same all along y: no strain there, forces per unit length"
    )

    def displacement_gradient(self, u: Expr, x: Expr) -> Expr:
        """Displacement gradient H (3x3) in the basis (x, y, z)."""
        h = ufl.grad(u)
        return ufl.as_tensor([[h[0, 0], 0, h[0, 1]], [0, 0, 0], [h[1, 0], 0, h[1, 1]]])

    def horizontal_position(self, point: Expr, center: Expr) -> tuple[Expr, Expr]:
        """Horizontal position (x - c, 0) relative to the tip's axis [length]."""
        return point[0] - center[0], 0.0

    def contact_area(self, a: float) -> float:
        """2 a [length], per unit length: of a contact of half the width a."""
        return 2 * a

    def contact_radius(self, area: float) -> float:
        """Half the width [length] of a contact of that area per unit length."""
        return area / 2


@dataclass(frozen=True)
class ThreeDimensional(_Kinematics):
    """u = (u_x, u_y, u_z)(x, y, z)."""

    name: Literal["three_dimensional"] = "three_dimensional"
    dim: int = 3
    axes: tuple[str, ...] = ("x", "y", "z")
    reason: ClassVar[str] = "tip and body vary along x and y"

    def displacement_gradient(self, u: Expr, x: Expr) -> Expr:
        """Displacement gradient H (3x3)."""
        return ufl.grad(u)

    def horizontal_position(self, point: Expr, center: Expr) -> tuple[Expr, Expr]:
        """Horizontal position (x - c_x, y - c_y) relative to the tip's axis [length]."""
        return point[0] - center[0], point[1] - center[1]

    def space_vector(self, v: Expr) -> Expr:
        """The 3-vector of a vector along the model's own axes."""
        return v

    def model_vector(self, v: Expr) -> Expr:
        """The components of a 3-vector along the model's own axes."""
        return v


Kinematics = Axisymmetric | PlaneStrain | ThreeDimensional
