"""Truncation of unbounded bodies to finite ones, with a bound of the error of the force.

For a half-space, a finite body of half-width and height n a (a: contact radius) is too stiff by
about 1/n. For a layer, the error of a wall decays with its distance in heights of the layer. Layer
theory gives both errors exactly for a cylinder between frictionless walls. Elements that grow with
the distance allow an n of thousands at little cost.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

from indent_sim.model.body import Cylinder
from indent_sim.model.layers import Layer
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter
from indent_sim.model.unbounded_bodies import HalfSpace, InfiniteLayer, UnboundedBody
from indent_sim.model.walled_bodies import Box, BoxSides
from indent_sim.scene.reference_theory import half_space_theory, stack_of
from indent_sim.scene.tip_theories import theory_tip_shape
from indent_sim.theory import profiles
from indent_sim.theory.half_space import estimate_depth
from indent_sim.theory.layer import Layer as LayerContact
from indent_sim.theory.solution import MAX_SLENDERNESS, Solution

# Relative error of the force that the truncation may cause; the mesh may cause the rest of 1e-3.
TRUNCATION_ERROR = 3e-4
ROLLER_SIDES = BoxSides("roller", "roller", "roller", "roller")
# Factor of safety for the error that theory predicts. It allows for the scatter of the forces on
# meshes, 1e-4, and for the replacement of laws with nu < 0 by one with nu = 0.3.
TRUNCATION_SAFETY = 1.5


@dataclass(frozen=True)
class Truncation:
    """Finite body in place of an unbounded body.

    Attributes
    ----------
    body : Cylinder or Box
        The finite body.
    layers : tuple of Layer
        Its layers from the top.
    represents : str
        Name of the unbounded body.
    ratio : float
        Half-width divided by the contact radius.
    error : float
        Bound of the relative error of the force; it is positive, since the finite body is too
        stiff.
    """

    body: Cylinder | Box
    layers: tuple[Layer, ...]
    represents: str
    ratio: float
    error: float

    @property
    def why(self) -> str:
        """Return the reason for the finite body, as the plan shows it."""
        size = "half-width and height" if self.represents == "half-space" else "half-width"
        basis = f"{TRUNCATION_SAFETY:g} times the error by layer theory"
        error_text = f"the force is at most {100 * self.error:.2g} % too large ({basis})"
        size_text = f"{size} of {self.ratio:.3g} contact radii"
        return f"replaces the {self.represents}: {size_text}; {error_text}"


def truncate(
    body: UnboundedBody,
    tip: Indenter,
    states: Sequence[Sequence[Layer]],
    delta: float,
    width_factor: float = 1.0,
) -> Truncation:
    """Return the smallest finite body that can replace a half-space or an infinitely wide layer.

    The relative difference of the forces at the depth `delta` is at most TRUNCATION_ERROR.

    Parameters
    ----------
    body : UnboundedBody
        The half-space or layer.
    tip : Indenter
        The tip.
    states : sequence of sequence of Layer
        The layers of the body from the top in each elastic state between which the body changes
        with time. The finite body has the layers of the first state and is large enough for all
        states.
    delta : float
        The depth [length].
    width_factor : float
        Factor by which the width (for a half-space also the height) is increased for effects that
        theory does not include, such as surface tension.

    Returns
    -------
    Truncation
        The finite body with the bound of its error.
    """
    search = _truncate_half_space if isinstance(body, HalfSpace) else _truncate_layer
    truncations = [search(body, tip, layers, delta) for layers in states]  # type: ignore[arg-type]
    largest = max(truncations, key=lambda truncation: _width(truncation.body))
    first_state_layers = [
        replace(layer, material=first_layer.material)
        for layer, first_layer in zip(largest.layers, states[0], strict=True)
    ]
    largest = replace(largest, layers=tuple(first_state_layers))
    truncation = _scale_width(largest, largest.layers, float(f"{width_factor:.6g}"))
    # Inclusions move with the tip's axis to the center of the finite body.
    shift = (*truncation.body.center, 0.0)
    centers = [
        tuple(x + s for x, s in zip(inclusion.center, shift, strict=True))
        for inclusion in body.inclusions or ()
    ]
    shifted_inclusions = tuple(
        replace(inclusion, center=center)
        for inclusion, center in zip(body.inclusions or (), centers, strict=True)
    )
    return replace(truncation, body=replace(truncation.body, inclusions=shifted_inclusions or None))


def _width(body: Cylinder | Box) -> float:
    """Return the width of a finite body [length]."""
    return 2 * body.radius if isinstance(body, Cylinder) else body.size[0]


def _scale_width(truncation: Truncation, layers: Sequence[Layer], factor: float) -> Truncation:
    """Return a truncation whose width (for a half-space also height) is scaled by a factor."""
    body = truncation.body
    ratio = factor * truncation.ratio
    if factor == 1.0:
        return truncation
    is_deep = truncation.represents == "half-space"
    height = body.height * (factor if is_deep else 1.0)
    if isinstance(body, Cylinder):
        scaled_body: Cylinder | Box = replace(body, radius=factor * body.radius, height=height)
    else:
        scaled_body = replace(body, size=(factor * body.size[0], factor * body.size[1], height))
    return replace(
        truncation,
        body=scaled_body,
        layers=_finite_layers(layers, height) if is_deep else truncation.layers,
        ratio=ratio,
    )


def _inclusion_extent(body: UnboundedBody) -> float:
    """Return the largest distance of an inclusion from the point of first contact [length]."""
    return max(
        (inclusion.farthest_distance((0.0, 0.0, 0.0)) for inclusion in body.inclusions or ()),
        default=0.0,
    )


def _truncate_layer(
    body: InfiniteLayer, tip: Indenter, layers: Sequence[Layer], delta: float
) -> Truncation:
    """Return the truncation of a layer whose side wall causes the allowed error of the force.

    Where the theory does not reach the depth, a flat punch as wide as the contact replaces the tip.
    """
    tip_shape = theory_tip_shape(tip)
    depth = abs(delta) or body.height
    height = body.height
    stack = stack_of(
        [replace(layer, material=_nonnegative_nu_law(layer.material)) for layer in layers],
        body.base,
    )
    assert stack is not None
    contact = LayerContact.from_stack(tip_shape, stack) if tip_shape else None
    deepest = _contact_at_depth(contact, depth) if contact else None
    radius = deepest.a if deepest else tip.radius_at(depth)
    if deepest is None or contact is None:
        punch = profiles.flat_punch(min(radius, 0.5 * MAX_SLENDERNESS * stack.h))
        contact = LayerContact.from_stack(punch, stack)
        deepest = contact.solutions_at_depths([depth])[0]
    # The first trial wall is three heights of the layer from the contact, the product of the two
    # numbers below; every further one is wall_distance_factor times as far.
    first_wall_distance = 2.0
    wall_distance_factor = 1.5
    wall_distance = first_wall_distance * height + _inclusion_extent(body)
    error = inf
    while error > TRUNCATION_ERROR:
        wall_distance *= wall_distance_factor
        walled_contact = _contact_at_depth(
            LayerContact.from_stack(contact.tip, stack, deepest.a + wall_distance), depth
        )
        error = abs(walled_contact.force / deepest.force - 1) if walled_contact else inf
    # The disturbance decays over a longer distance in a body that is stiff in its plane.
    wall_distance *= max(
        1.0, *(layer.material.decay_rates[1] for layer in layers if layer.material)
    )
    width = float(f"{radius + wall_distance:.6g}")
    # Smallest relative error of the force that is stated for a layer.
    min_stated_error = 1e-6
    error = TRUNCATION_SAFETY * max(error, min_stated_error)
    finite_body: Cylinder | Box = Cylinder(width, height, base=body.base, sides="roller")
    if not tip.is_axisymmetric:
        finite_body = Box((2 * width, 2 * width, height), base=body.base, sides=ROLLER_SIDES)
    return Truncation(finite_body, tuple(layers), "infinitely wide layer", width / radius, error)


def _truncate_half_space(
    body: HalfSpace, tip: Indenter, layers: Sequence[Layer], delta: float
) -> Truncation:
    """Return the truncation of a half-space that has the allowed error of the force."""
    tip_shape = theory_tip_shape(tip)
    depth = abs(delta) or 1.0
    theory_layers = [
        replace(layer, material=_nonnegative_nu_law(layer.material)) for layer in layers
    ]
    # If there is no theory for the tip, or it does not reach the depth, a flat punch as wide as the
    # contact replaces the tip; if the upper layers are too thin for the theory, they are omitted.
    punch = profiles.flat_punch(tip.radius_at(depth))
    models = [
        *([(tip_shape, theory_layers)] if tip_shape else []),
        (punch, theory_layers),
        (punch, theory_layers[-1:]),
    ]
    for shape, theory_layers in models:
        stack = stack_of(theory_layers, None, tip.radius_at(depth))
        if stack and (deepest := _contact_at_depth(LayerContact.from_stack(shape, stack), depth)):
            break
    assert deepest is not None
    upper_thickness = sum(layer.thickness or 0.0 for layer in layers[:-1])
    target = TRUNCATION_ERROR
    ratio = max(100.0, 10 * max(upper_thickness, _inclusion_extent(body)) / deepest.a)
    # The strain decays more slowly with the depth than in isotropic layers by this factor.
    decay_factor = max(
        1.0, *(1 / layer.material.decay_rates[0] for layer in layers if layer.material)
    )

    def error_of(size: float) -> float:
        """Return the relative error of the force for a cylinder of radius and height `size`."""
        stack = stack_of(_finite_layers(theory_layers, size), "fixed")
        assert stack is not None
        contact = LayerContact.from_stack(shape, stack, size)
        force = contact.solutions_at_depths([deepest.delta])[0].force
        return decay_factor * (force / deepest.force - 1)

    while (error := error_of(ratio * deepest.a)) > target:
        # The error falls a little faster than 1/ratio.
        ratio *= 1.01 * error / target
    # A rounded ratio gives the same numbers in all units.
    ratio = float(f"{ratio:.6g}")
    size = ratio * deepest.a
    finite_body: Cylinder | Box = Cylinder(size, size, base="fixed", sides="roller")
    if not tip.is_axisymmetric:
        # The cylinder of theory fits into this box, which is softer.
        finite_body = Box((2 * size, 2 * size, size), base="fixed", sides=ROLLER_SIDES)
    return Truncation(
        finite_body, _finite_layers(layers, size), "half-space", ratio, TRUNCATION_SAFETY * error
    )


def expected_depth(tip: Indenter, layers: Sequence[Layer], force: float) -> float:
    """Return the depth at which a half-space carries a force.

    Parameters
    ----------
    tip : Indenter
        The tip.
    layers : sequence of Layer
        The layers of the half-space from the top.
    force : float
        The force [pressure length^2].

    Returns
    -------
    float
        The depth [length], an estimate if there is no theory for the tip; 0 for a force <= 0.
    """
    if force <= 0:
        return 0.0
    material = layers[0].material
    assert material is not None
    start = estimate_depth(tip.radius_at, force, material.E_star)
    theory = half_space_theory(tip, layers, max(start, tip.radius_at(start)))
    return (theory and theory.depth_of_force(force, 1e6 * start)) or start


def _nonnegative_nu_law(material: Material | None) -> Material:
    """Return a linear elastic law with nu = 0.3 if nu of the material is negative.

    For nu < 0 the error caused by a side wall is 0.9 to 1.01 times as large as for nu = 0.3.
    """
    assert material is not None
    E, nu = material.constants
    return LinearElastic(E=E, nu=nu if nu >= 0 else 0.3)


def _finite_layers(layers: Sequence[Layer], size: float) -> tuple[Layer, ...]:
    """Return the layers of a half-space whose substrate ends at the depth `size` [length]."""
    upper_thickness = sum(layer.thickness or 0.0 for layer in layers[:-1])
    return (*layers[:-1], replace(layers[-1], thickness=size - upper_thickness))


def _contact_at_depth(contact: LayerContact, delta: float) -> Solution | None:
    """Return the contact solution at a depth [length]; None beyond the range of the theory."""
    with contextlib.suppress(ValueError):
        return contact.solutions_at_depths([delta])[0]
    return None
