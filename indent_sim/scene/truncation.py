"""Truncation of a half-space: the finite body that stands for it, and the error of the force.

A body of width and height n a is too stiff by about 1/n (a: contact radius), which layer theory knows exactly for a
cylinder between frictionless walls. Sizes that grow with the distance make n in the thousands cheap.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from indent_sim.model.body import Box, BoxSides, Cylinder, Layer
from indent_sim.model.materials import LinearElastic, Material
from indent_sim.model.tips import Indenter
from indent_sim.scene.theories import half_space_theory, section_depth, shape_of, stack_of
from indent_sim.theory import profiles
from indent_sim.theory.layer import Layer as LayerContact
from indent_sim.theory.solution import Solution

ACCURACY = 1e-3  # wanted of the force
SHARE = 0.3  # of it that the truncation may take; the rest is the mesh's
MARGIN = 1.5  # times theory's error is stated: the mesh leaves noise of 1e-4, and nu < 0 is not in theory


@dataclass(frozen=True)
class Truncation:
    """The finite body, its size in contact radii, and a bound of the relative error of the force (> 0, too stiff)."""

    body: Cylinder | Box
    layers: tuple[Layer, ...]
    ratio: float
    error: float

    @property
    def why(self) -> str:
        """The reason in words."""
        return (
            f"stands for the half-space: {self.ratio:.3g} contact radii wide and high, "
            f"too stiff by at most {self.error:.2%} of the force ({MARGIN:g} times layer theory's error)"
        )


def truncate(tip: Indenter, layers: Sequence[Layer], delta: float) -> Truncation:
    """The smallest body whose force at `delta` [length] is within SHARE ACCURACY of the half-space's."""
    known, depth = shape_of(tip), abs(delta) or 1.0
    # what theory does not know, or ends in, is no wider in contact than a punch of its radius
    shapes = [*([known] if known else []), profiles.flat_punch(tip.radius_at(depth))]
    modelled = [replace(layer, material=_compressible(layer.material)) for layer in layers]
    contacts = ((shape, _deep(shape, modelled, depth)) for shape in shapes)
    shape, deepest = next((shape, found) for shape, found in contacts if found)
    above = sum(layer.thickness or 0.0 for layer in layers[:-1])
    target, ratio = SHARE * ACCURACY, max(100.0, 10 * above / deepest.a)
    error = _error(shape, modelled, deepest, ratio)
    while error > target:
        ratio *= 1.01 * error / target  # the error falls a little faster than 1/ratio
        error = _error(shape, modelled, deepest, ratio)
    ratio = float(f"{ratio:.6g}")  # so that the numbers are the same in all units
    size = ratio * deepest.a
    body: Cylinder | Box = Cylinder(size, size, base="fixed", sides="roller")
    if not tip.of_revolution:  # the cylinder of theory fits into this box, which is softer
        body = Box((2 * size, 2 * size, size), base="fixed", sides=BoxSides("roller", "roller", "roller", "roller"))
    return Truncation(body, _finite(layers, size), ratio, MARGIN * error)


def expected_depth(tip: Indenter, layers: Sequence[Layer], force: float) -> float:
    """The depth at which a half-space pushes back with a force [pressure length^2]; about that for an unknown tip."""
    material = layers[0].material
    assert material is not None
    start, theory = section_depth(tip, force, material.E_star, 3), half_space_theory(tip, layers)
    return (theory and theory.depth(force, 1e6 * start)) or start


def _compressible(material: Material | None) -> Material:
    """nu = 0.3 stands for nu < 0, where the error is between 0.9 and 1.01 times as large."""
    assert material is not None
    E, nu = material.constants
    return LinearElastic(E=E, nu=nu if nu >= 0 else 0.3)


def _finite(layers: Sequence[Layer], size: float) -> tuple[Layer, ...]:
    """The layers of a body of that height."""
    above = sum(layer.thickness or 0.0 for layer in layers[:-1])
    return (*layers[:-1], replace(layers[-1], thickness=size - above))


def _deep(shape: profiles.Tip, layers: Sequence[Layer], delta: float) -> Solution | None:
    with contextlib.suppress(ValueError):
        return LayerContact.on(shape, stack_of(layers, None)).curve([delta])[0]  # type: ignore[arg-type]
    return None


def _error(shape: profiles.Tip, layers: Sequence[Layer], deepest: Solution, ratio: float) -> float:
    """F(cylinder)/F(half-space) - 1."""
    size = ratio * deepest.a
    stack = stack_of(_finite(layers, size), "fixed")
    return LayerContact.on(shape, stack, size).curve([deepest.delta])[0].force / deepest.force - 1  # type: ignore[arg-type]
