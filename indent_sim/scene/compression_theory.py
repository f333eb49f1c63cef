"""Theory of a plate that covers the whole flat top: the body is compressed as a bar."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from indent_sim.model.body import Body, Cylinder
from indent_sim.model.layers import Layer as BodyLayer
from indent_sim.model.tips import (
    Indenter,
    flat_radius,
)
from indent_sim.model.walled_bodies import Box
from indent_sim.model.walled_bodies import Strip as BodyStrip
from indent_sim.scene.reasons import first_reason
from indent_sim.theory.compression import (
    Bar,
    Compression,
    HyperelasticBar,
    LinearBar,
    bonded_modulus,
)
from indent_sim.theory.roots import ForceCurve
from indent_sim.theory.theory import Theory

RADIUS_TOLERANCE = 1e-9  # relative: radii that differ by less are one

NEARLY_INCOMPRESSIBLE = (
    0.49  # Poisson's ratio from which rubber's formula for bonded blocks is said
)

# What a compression is called by the number of directions across it in which walls hold the body
COMPRESSION_NAMES = ("uniaxial compression", "plane-strain compression", "confined compression")


def covers_top(tip: Indenter, body: Body, center: tuple[float, ...]) -> bool:
    """Whether the flat face of a tip on the axis `center` covers all of a flat top, which then
    compresses the body as a plate does, as long as no rim bulges past its edge. Not known of a
    mesh from a file.
    """
    if not isinstance(body, Cylinder | BodyStrip | Box):
        return False
    return flat_radius(tip) >= body.max_lateral_extent(center) * (1 - RADIUS_TOLERANCE)


def compression_theory(
    body: Cylinder | BodyStrip | Box, layers: Sequence[BodyLayer], radius_ratio: float
) -> Theory | None:
    """Theory of a plate on all of a flat top: the body as a bar that slides on the plate and on its
    base. None where nobody knows it: layers that are no linear ones, a bar that cannot give way.
    room: the radius of the tip's flat face over that of the top.
    """
    constrained_directions = _constrained_directions(body)
    bar_model = _bar_model(layers, constrained_directions)
    if bar_model is None:
        return None
    bar, is_finite = bar_model
    dimensions = body.dim - 1
    widest = max(radius_ratio, 1.0) ** dimensions
    contact = Compression(bar, body.height, _area_of_top(body), dimensions, widest)
    why = first_reason(
        (body.base == "fixed", "the base is bonded, theory's slides"),
        (len(layers) > 1, "theory's layers slide on one another"),
    )
    formulas = (
        _bonded_formulas(body, layers)
        if body.base == "fixed" and constrained_directions == 2 - dimensions
        else {}
    )
    why_exact = "a block that slides between plates is this very body"
    return Theory(
        COMPRESSION_NAMES[constrained_directions],
        not why,
        why or why_exact,
        contact,
        formulas=formulas,
        is_finite_strain=is_finite,
    )


def _constrained_directions(body: Cylinder | BodyStrip | Box) -> int:
    """In how many of the two directions across it walls keep the width of a body; in plane strain
    in y at least.
    """
    if isinstance(body, Cylinder):
        return 0 if body.sides == "free" else 2
    sides = body.sides
    ends = [(sides.x_min, sides.x_max)]
    if isinstance(body, Box):
        ends.append((body.sides.y_min, body.sides.y_max))
    return 2 - len(ends) + sum("free" not in pair for pair in ends)


def _bar_model(layers: Sequence[BodyLayer], constrained_directions: int) -> tuple[Bar, bool] | None:
    """The body as a bar, and whether its strain is finite; None where it is not known."""
    materials = [layer.material for layer in layers if layer.material]
    if all(material.is_small_strain for material in materials):
        moduli = [material.bar_modulus(constrained_directions) for material in materials]
        thicknesses = [layer.thickness or inf for layer in layers]
        height = sum(thicknesses)
        compliance = sum(
            t / height / modulus for t, modulus in zip(thicknesses, moduli, strict=True)
        )
        return (LinearBar(1 / compliance), False) if compliance > 0 else None
    material = materials[0]
    is_incompressible = material.constants.nu == 0.5
    if len(materials) > 1 or (is_incompressible and constrained_directions == 2):
        return None
    return HyperelasticBar(material.energy_of_bar, is_incompressible, constrained_directions), True


def _area_of_top(body: Cylinder | BodyStrip | Box) -> float:
    """Area of a flat top [length^2], in plane strain its width [length]."""
    if isinstance(body, Cylinder):
        return float(np.pi) * body.radius**2
    return float(np.prod(body.widths))


def _bonded_formulas(
    body: Cylinder | BodyStrip | Box, layers: Sequence[BodyLayer]
) -> dict[str, ForceCurve]:
    """Gent and Lindley's force of a nearly incompressible disc or strip bonded at its base."""
    if isinstance(body, Box) or len(layers) > 1 or layers[0].material is None:
        return {}
    E, nu = layers[0].material.constants
    if nu < NEARLY_INCOMPRESSIBLE:
        return {}
    half_width = body.radius if isinstance(body, Cylinder) else body.width
    bulk = E / (3 * (1 - 2 * nu)) if nu < 0.5 else inf
    modulus = bonded_modulus(E, bulk, half_width / (4 * body.height), body.dim - 1)
    stiffness = modulus * _area_of_top(body) / body.height
    return {"Gent-Lindley": lambda delta: stiffness * delta}
