"""Truncation of bodies without end: the finite body that stands for one, and the error of the
force.

For a half-space, a body of width and height n a is too stiff by about 1/n (a: contact radius); for
a layer, the error of a wall fades with its distance in heights. Layer theory knows both exactly for
a cylinder between frictionless walls. Sizes that grow with the distance make n in the thousands
cheap.
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

FORCE_ACCURACY = 1e-3  # wanted of the force
TRUNCATION_ERROR_SHARE = 0.3  # of it that the truncation may take; the rest is the mesh's
ROLLER_SIDES = BoxSides("roller", "roller", "roller", "roller")
# heights from a layer's contact to the first wall that is tried, and times to the next
FIRST_WALL_DISTANCE = 2.0
WALL_DISTANCE_FACTOR = 1.5
MIN_STATED_ERROR = 1e-6  # of the force: an error of truncation that is less is stated as this
# times theory's error is stated: the mesh leaves noise of 1e-4, and nu < 0 is not in theory
TRUNCATION_SAFETY = 1.5


@dataclass(frozen=True)
class Truncation:
    """The finite body, its size in contact radii, and a bound of the relative error of the force (>
    0, too stiff).
    """

    body: Cylinder | Box
    layers: tuple[Layer, ...]
    represents: str
    ratio: float
    error: float

    @property
    def why(self) -> str:
        """The reason in words."""
        size = "wide and high" if self.represents == "half-space" else "wide"
        basis = f"{TRUNCATION_SAFETY:g} times layer theory's error"
        stiff = f"too stiff by at most {100 * self.error:.2g} % of the force ({basis})"
        return f"stands for the {self.represents}: {self.ratio:.3g} contact radii {size}, {stiff}"


def truncate(
    body: UnboundedBody,
    tip: Indenter,
    states: Sequence[Sequence[Layer]],
    delta: float,
    width_factor: float = 1.0,
) -> Truncation:
    """Return the smallest finite body that stands for a half-space or an infinitely wide layer.

    Its force at the depth differs from that of the body without end by SHARE ACCURACY at most.

    Parameters
    ----------
    body, tip
        The body without end, and what is pressed in.
    states
        The layers of the body from the top, in each of the elastic states between which it changes
        with time; the first are those that the finite body gets. It is large enough for all states.
    delta
        The depth [length].
    wider
        Times as wide, and a half-space as high, for what theory without a surface tension does not
        know.
    """
    search = _truncate_half_space if isinstance(body, HalfSpace) else _truncate_layer
    truncations = [search(body, tip, layers, delta) for layers in states]  # type: ignore[arg-type]
    largest = max(truncations, key=lambda item: _width(item.body))
    own_layers = [
        replace(layer, material=first.material)
        for layer, first in zip(largest.layers, states[0], strict=True)
    ]
    largest = replace(largest, layers=tuple(own_layers))
    truncation = _scale_width(largest, largest.layers, float(f"{width_factor:.6g}"))
    shift = (*truncation.body.center, 0.0)  # to where the finite body has its axis
    centers = [
        tuple(x + s for x, s in zip(item.center, shift, strict=True))
        for item in body.inclusions or ()
    ]
    placed = tuple(
        replace(item, center=center)
        for item, center in zip(body.inclusions or (), centers, strict=True)
    )
    return replace(truncation, body=replace(truncation.body, inclusions=placed or None))


def _width(body: Cylinder | Box) -> float:
    """The width of a finite body [length]."""
    return 2 * body.radius if isinstance(body, Cylinder) else body.size[0]


def _scale_width(truncation: Truncation, layers: Sequence[Layer], times: float) -> Truncation:
    """Return a truncation with a wider body; that for a half-space is also higher by the factor."""
    body = truncation.body
    ratio = times * truncation.ratio
    if times == 1.0:
        return truncation
    is_deep = truncation.represents == "half-space"
    height = body.height * (times if is_deep else 1.0)
    if isinstance(body, Cylinder):
        scaled_body: Cylinder | Box = replace(body, radius=times * body.radius, height=height)
    else:
        scaled_body = replace(body, size=(times * body.size[0], times * body.size[1], height))
    return replace(
        truncation,
        body=scaled_body,
        layers=_finite_layers(layers, height) if is_deep else truncation.layers,
        ratio=ratio,
    )


def _inclusion_extent(body: UnboundedBody) -> float:
    """How far from the tip's axis and the surface inclusions reach [length]."""
    return max(
        (inclusion.farthest_distance((0.0, 0.0, 0.0)) for inclusion in body.inclusions or ()),
        default=0.0,
    )


def _truncate_layer(
    body: InfiniteLayer, tip: Indenter, layers: Sequence[Layer], delta: float
) -> Truncation:
    """A wall where theory with and without it differ by no more than is allowed, or beside its
    widest contact.
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
    wall_distance = FIRST_WALL_DISTANCE * height + _inclusion_extent(body)
    error = inf
    while error > TRUNCATION_ERROR_SHARE * FORCE_ACCURACY:
        wall_distance *= WALL_DISTANCE_FACTOR
        walled_contact = _contact_at_depth(
            LayerContact.from_stack(contact.tip, stack, deepest.a + wall_distance), depth
        )
        error = abs(walled_contact.force / deepest.force - 1) if walled_contact else inf
    # a stiff plane carries it farther
    wall_distance *= max(
        1.0, *(layer.material.decay_rates[1] for layer in layers if layer.material)
    )
    width = float(f"{radius + wall_distance:.6g}")
    error = TRUNCATION_SAFETY * max(error, MIN_STATED_ERROR)
    finite_body: Cylinder | Box = Cylinder(width, height, base=body.base, sides="roller")
    if not tip.is_axisymmetric:
        finite_body = Box((2 * width, 2 * width, height), base=body.base, sides=ROLLER_SIDES)
    return Truncation(finite_body, tuple(layers), "infinitely wide layer", width / radius, error)


def _truncate_half_space(
    body: HalfSpace, tip: Indenter, layers: Sequence[Layer], delta: float
) -> Truncation:
    tip_shape = theory_tip_shape(tip)
    depth = abs(delta) or 1.0
    modelled = [replace(layer, material=_nonnegative_nu_law(layer.material)) for layer in layers]
    # what theory does not know, or ends in, is no wider in contact than a punch of its radius
    punch = profiles.flat_punch(tip.radius_at(depth))
    models = [
        *([(tip_shape, modelled)] if tip_shape else []),
        (punch, modelled),
        (punch, modelled[-1:]),
    ]  # films far too thin
    for shape, modelled in models:
        stack = stack_of(modelled, None, tip.radius_at(depth))
        if stack and (deepest := _contact_at_depth(LayerContact.from_stack(shape, stack), depth)):
            break
    assert deepest is not None
    upper_thickness = sum(layer.thickness or 0.0 for layer in layers[:-1])
    target = TRUNCATION_ERROR_SHARE * FORCE_ACCURACY
    ratio = max(100.0, 10 * max(upper_thickness, _inclusion_extent(body)) / deepest.a)
    # how much deeper than below isotropic layers the base is felt
    decay_factor = max(
        1.0, *(1 / layer.material.decay_rates[0] for layer in layers if layer.material)
    )

    def error_of(size: float) -> float:
        """F(cylinder)/F(half-space) - 1."""
        stack = stack_of(_finite_layers(modelled, size), "fixed")
        assert stack is not None
        return decay_factor * (
            LayerContact.from_stack(shape, stack, size)
            .solutions_at_depths([deepest.delta])[0]
            .force
            / deepest.force
            - 1
        )

    while (error := error_of(ratio * deepest.a)) > target:
        ratio *= 1.01 * error / target  # the error falls a little faster than 1/ratio
    ratio = float(f"{ratio:.6g}")  # so that the numbers are the same in all units
    size = ratio * deepest.a
    finite_body: Cylinder | Box = Cylinder(size, size, base="fixed", sides="roller")
    if not tip.is_axisymmetric:  # the cylinder of theory fits into this box, which is softer
        finite_body = Box((2 * size, 2 * size, size), base="fixed", sides=ROLLER_SIDES)
    return Truncation(
        finite_body, _finite_layers(layers, size), "half-space", ratio, TRUNCATION_SAFETY * error
    )


def expected_depth(tip: Indenter, layers: Sequence[Layer], force: float) -> float:
    """The depth at which a half-space pushes back with a force [pressure length^2], 0 for one that
    does not push; about that for an unknown tip.
    """
    if force <= 0:
        return 0.0
    material = layers[0].material
    assert material is not None
    start = estimate_depth(tip.radius_at, force, material.E_star)
    theory = half_space_theory(tip, layers, max(start, tip.radius_at(start)))
    return (theory and theory.depth_of_force(force, 1e6 * start)) or start


def _nonnegative_nu_law(material: Material | None) -> Material:
    """nu = 0.3 stands for nu < 0, where the error is between 0.9 and 1.01 times as large."""
    assert material is not None
    E, nu = material.constants
    return LinearElastic(E=E, nu=nu if nu >= 0 else 0.3)


def _finite_layers(layers: Sequence[Layer], size: float) -> tuple[Layer, ...]:
    upper_thickness = sum(layer.thickness or 0.0 for layer in layers[:-1])
    return (*layers[:-1], replace(layers[-1], thickness=size - upper_thickness))


def _contact_at_depth(contact: LayerContact, delta: float) -> Solution | None:
    """The contact at a depth; None where theory ends."""
    with contextlib.suppress(ValueError):
        return contact.solutions_at_depths([delta])[0]
    return None
