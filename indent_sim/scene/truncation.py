"""Truncation of a half-space: the finite body that stands for it, and the error of the force.

A body of width and height n a is too stiff by about 1/n (a: contact radius), which layer theory knows exactly for a
cylinder between frictionless walls. Sizes that grow with the distance make n in the thousands cheap.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from indent_sim.model.body import Box, BoxSides, Cylinder
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter
from indent_sim.scene.theories import DEEP, half_space_theory, section_depth, shape_of
from indent_sim.theory import layer, profiles
from indent_sim.theory.solution import Solution

ACCURACY = 1e-3  # wanted of the force
SHARE = 0.3  # of it that the truncation may take; the rest is the mesh's
MARGIN = 1.5  # times theory's error is stated: the mesh leaves noise of 1e-4, and nu < 0 is not in theory


@dataclass(frozen=True)
class Truncation:
    """The finite body, its size in contact radii, and a bound of the relative error of the force (> 0, too stiff)."""

    body: Cylinder | Box
    ratio: float
    error: float

    @property
    def why(self) -> str:
        """The reason in words."""
        return (
            f"stands for the half-space: {self.ratio:.3g} contact radii wide and high, "
            f"too stiff by at most {self.error:.2%} of the force ({MARGIN:g} times layer theory's error)"
        )


def truncate(tip: Indenter, material: Material, delta: float) -> Truncation:
    """The smallest body whose force at `delta` [length] is within SHARE ACCURACY of the half-space's."""
    theory, depth = shape_of(tip), abs(delta) or 1.0
    if theory is None or (deepest := _deep(theory, depth, tip.radius_at(depth))) is None:
        theory, deepest = _punch(tip.radius_at(depth), depth)
    nu = material.constants.nu
    target, ratio = SHARE * ACCURACY, 100.0
    error = _error(theory, deepest, nu, ratio)
    while error > target:
        ratio *= 1.01 * error / target  # the error falls a little faster than 1/ratio
        error = _error(theory, deepest, nu, ratio)
    ratio = float(f"{ratio:.6g}")  # so that the numbers are the same in all units
    size = ratio * deepest.a
    if tip.of_revolution:
        return Truncation(Cylinder(size, size, base="fixed", sides="roller"), ratio, MARGIN * error)
    # the cylinder of theory fits into this box, which is softer
    walls = BoxSides("roller", "roller", "roller", "roller")
    return Truncation(Box((2 * size, 2 * size, size), base="fixed", sides=walls), ratio, MARGIN * error)


def expected_depth(tip: Indenter, material: Material, force: float) -> float:
    """The depth at which a half-space pushes back with a force [pressure length^2]; about that for an unknown tip."""
    start = section_depth(tip, force, material.E_star, 3)
    theory = half_space_theory(tip, material, 10 * max(start, tip.radius_at(start)))
    return (theory and theory.depth(force, 1e6 * start)) or start


def _deep(theory: profiles.Tip, delta: float, size: float) -> Solution | None:
    with contextlib.suppress(ValueError):
        return layer.indent(theory, delta, E=1.0, nu=0.0, h=DEEP * size)
    return None


def _punch(radius: float, delta: float) -> tuple[profiles.Tip, Solution]:
    """A tip in contact up to its end is no wider than a punch of that radius."""
    theory = profiles.flat_punch(radius)
    return theory, layer.indent(theory, delta, E=1.0, nu=0.0, h=DEEP * radius)


def _error(theory: profiles.Tip, deepest: Solution, nu: float, ratio: float) -> float:
    """F(cylinder)/F(half-space) - 1; nu = 0.3 stands for nu < 0, where it is between 0.9 and 1.01 times as large."""
    size = ratio * deepest.a
    nu = nu if nu >= 0 else 0.3
    found = layer.indent(theory, deepest.delta, E=1.0 - nu**2, nu=nu, h=size, wall=size)
    return found.force / deepest.force - 1
