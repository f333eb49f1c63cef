"""Theory of a tip that covers the whole flat top: the body is compressed like a bar."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from indent_sim.model.body import Body, Cylinder
from indent_sim.model.layers import Layer as BodyLayer
from indent_sim.model.tips import Indenter, flat_radius
from indent_sim.model.walled_bodies import Box
from indent_sim.model.walled_bodies import Strip as BodyStrip
from indent_sim.theory.compression import (
    Bar,
    Compression,
    HyperelasticBar,
    LinearBar,
    bonded_modulus,
)
from indent_sim.theory.roots import ForceCurve
from indent_sim.theory.theory import Theory

RADIUS_TOLERANCE = 1e-9  # Relative difference up to which radii count as equal.


def covers_top(tip: Indenter, body: Body, center: tuple[float, ...]) -> bool:
    """Return whether the flat face of a tip covers the whole flat top of a body.

    The tip then acts like a compression plate, unless the body bulges beyond the tip's edge. Return
    False for a mesh from a file. `center` is the position of the tip's axis [length].
    """
    if not isinstance(body, Cylinder | BodyStrip | Box):
        return False
    return flat_radius(tip) >= body.max_lateral_extent(center) * (1 - RADIUS_TOLERANCE)


def compression_theory(
    body: Cylinder | BodyStrip | Box,
    layers: Sequence[BodyLayer],
    center: tuple[float, ...],
    radius_ratio: float,
) -> Theory | None:
    """Return the theory of a body compressed between two frictionless plates.

    The theory applies if the tip covers the whole flat top. If a roller wall passes through the
    tip's axis, the theory describes the body together with its mirror image.

    Parameters
    ----------
    body : Cylinder, Strip or Box
        The body.
    layers : sequence of Layer
        The layers of the body from the top.
    center : tuple of float
        Position of the tip's axis [length].
    radius_ratio : float
        Radius of the tip's flat face divided by the radius of the top.

    Returns
    -------
    Theory or None
        None for several layers at finite strain, and for an incompressible body with fixed walls.
    """
    constrained_directions = _constrained_directions(body)
    bar_model = _bar_model(layers, constrained_directions)
    if bar_model is None:
        return None
    bar, is_finite_strain = bar_model
    dimensions = body.dim - 1
    max_area_ratio = max(radius_ratio, 1.0) ** dimensions
    area = _area_of_top(body, center)
    contact = Compression(bar, body.height, area, dimensions, max_area_ratio)
    differences = []
    if body.base == "fixed":
        differences.append("the base is bonded, but slides in the theory")
    if len(layers) > 1:
        differences.append("the layers slide on one another in the theory")
    has_free_sides = constrained_directions == 2 - dimensions
    is_bonded_block = body.base == "fixed" and has_free_sides
    formulas = _bonded_formulas(body, layers, center) if is_bonded_block else {}
    # Names by the number of lateral directions in which walls confine the body.
    names = ("uniaxial compression", "plane-strain compression", "confined compression")
    return Theory(
        names[constrained_directions],
        contact,
        "theory describes this block between frictionless plates exactly",
        tuple(differences),
        formulas=formulas,
        is_finite_strain=is_finite_strain,
    )


def _constrained_directions(body: Cylinder | BodyStrip | Box) -> int:
    """Return the number of lateral directions, 0 to 2, in which the body cannot expand.

    In plane strain, the direction y is counted.
    """
    if isinstance(body, Cylinder):
        return 0 if body.sides == "free" else 2
    sides = body.sides
    ends = [(sides.x_min, sides.x_max)]
    if isinstance(body, Box):
        ends.append((body.sides.y_min, body.sides.y_max))
    return 2 - len(ends) + sum("free" not in pair for pair in ends)


def _bar_model(layers: Sequence[BodyLayer], constrained_directions: int) -> tuple[Bar, bool] | None:
    """Return the body as a bar and whether its strain is finite; None if the body is not a bar.

    At small strain the compliances of the layers are added. At finite strain only a homogeneous,
    compressible body is represented by a bar.
    """
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


def _area_of_top(body: Cylinder | BodyStrip | Box, center: tuple[float, ...]) -> float:
    """Return the area of a flat top with its mirror images; in plane strain, its width."""
    if isinstance(body, Cylinder):
        return float(np.pi) * body.radius**2
    return float(np.prod(body.mirrored_widths(center)))


def _bonded_formulas(
    body: Cylinder | BodyStrip | Box, layers: Sequence[BodyLayer], center: tuple[float, ...]
) -> dict[str, ForceCurve]:
    """Return the formula of Gent and Lindley for nearly incompressible discs and strips.

    The disc or strip is bonded at its base and slides on the plate.
    """
    if isinstance(body, Box) or len(layers) > 1 or layers[0].material is None:
        return {}
    E, nu = layers[0].material.constants
    # Smallest Poisson's ratio for which the run is compared with the formula for bonded rubber
    # blocks.
    nearly_incompressible = 0.49
    if nu < nearly_incompressible:
        return {}
    # A block that is bonded at its base only is half of one that is bonded at both ends.
    lateral_size = body.radius if isinstance(body, Cylinder) else body.mirrored_widths(center)[0]
    bulk = E / (3 * (1 - 2 * nu)) if nu < 0.5 else inf
    modulus = bonded_modulus(E, bulk, lateral_size / (4 * body.height), body.dim - 1)
    stiffness = modulus * _area_of_top(body, center) / body.height
    return {"Gent-Lindley": lambda delta: stiffness * delta}
