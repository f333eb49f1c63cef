"""Theory of a scene: which layer or half-space theory, for its tip, and what the body has that
theory has not.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from indent_sim.model import tips
from indent_sim.model.body import Body, Cylinder
from indent_sim.model.imported_body import ImportedBody
from indent_sim.model.layers import Layer as BodyLayer
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import (
    FlatPunch,
    Indenter,
    Paraboloid,
    Plate,
    Sphere,
    flat_radius,
)
from indent_sim.model.unbounded_bodies import HalfSpace, UnboundedBody
from indent_sim.model.walled_bodies import Box
from indent_sim.model.walled_bodies import Strip as BodyStrip
from indent_sim.scene.compression_theory import compression_theory, covers_top
from indent_sim.scene.reasons import first_reason
from indent_sim.scene.tip_theories import theory_tip_shape
from indent_sim.theory import profiles
from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.films import (
    dimitriadis_force,
    film_force,
    gao_modulus,
    perriot_barthel_modulus,
)
from indent_sim.theory.layer import Layer
from indent_sim.theory.roots import ForceCurve
from indent_sim.theory.solution import SOLUTION_ERRORS
from indent_sim.theory.stack import Stack, StackLayer
from indent_sim.theory.strip import Strip
from indent_sim.theory.theory import THEORY_ERROR, Theory

NO_INCLUSIONS = "theory's body has no inclusions"
# Between moduli from which theory loses digits, and the power: 2e-6 was measured at 1e5
INEXACT_CONTRAST = 1e4
CONTRAST_ERROR_EXPONENT = 2.5


def theory_of(
    body: Body,
    layers: Sequence[BodyLayer],
    tip: Indenter,
    center: tuple[float, ...],
    surface_tension: float = 0.0,
) -> Theory | None:
    """The theory of a tip on a body under a surface tension [pressure length], its inclusions left
    out, or None where there is none.
    """
    theory = (
        half_space_theory(tip, layers)
        if isinstance(body, HalfSpace)
        else layer_theory(body, layers, tip, center)
    )
    theory = _add_surface_tension(theory, surface_tension) if theory and surface_tension else theory
    if theory is None or not body.inclusions:
        return theory
    return replace(
        theory,
        is_exact=False,
        reason=NO_INCLUSIONS if theory.is_exact else f"{theory.reason}; {NO_INCLUSIONS}",
    )


def _add_surface_tension(theory: Theory, surface_tension: float) -> Theory | None:
    """The same with a surface tension, whose theory knows no walls, and nothing in plane strain."""
    if not isinstance(theory.contact, Layer):
        return None
    from indent_sim.theory.surface_tension import LayerWithSurfaceTension

    contact = LayerWithSurfaceTension.from_layer(theory.contact, surface_tension)
    has_wall = theory.contact.wall < inf
    difference = first_reason(
        (has_wall, "theory's layer is infinitely wide"),
        (
            contact.has_slope_discontinuities,
            "with a surface tension theory's pressure ripples under a tip with kinks",
        ),
    )
    exact = theory.is_exact and not difference
    why = difference or theory.reason
    return replace(
        theory,
        contact=contact,
        is_exact=exact,
        reason=why,
        error=max(theory.error, contact.error),
        formulas={},
    )


def layer_theory(
    body: Body, layers: Sequence[BodyLayer], tip: Indenter, center: tuple[float, ...]
) -> Theory | None:
    """The layer theory of a scene, or None where there is none (nu < 0, a tip that theory does not
    know).
    """
    if isinstance(body, ImportedBody):
        return None
    assert not isinstance(body, HalfSpace)
    if isinstance(body, SphericalBody):
        return _spherical_body_theory(body, layers, tip)
    if isinstance(body, Cylinder | BodyStrip | Box) and covers_top(tip, body, center):
        return compression_theory(body, layers, flat_radius(tip) / body.max_lateral_extent(center))
    shape = theory_tip_shape(tip)
    is_plane = body.dim == 2
    stack = stack_of(layers, body.base)
    if shape is None or stack is None or (is_plane and shape.f is None):
        return None
    wall, exact, why = _roller_wall(body, center)
    contact = (Strip if is_plane else Layer).from_stack(shape, stack, wall)
    formulas = {} if is_plane else _layer_formulas(layers, tip, body.base)
    return _assess_exactness(
        Theory("layer theory", exact, why, contact, formulas=formulas), layers, tip
    )


def _spherical_body_theory(
    body: SphericalBody, layers: Sequence[BodyLayer], tip: Indenter
) -> Theory | None:
    """Theory of a flat body under the curvatures of tip and dome: a layer as high as a cap, a
    half-space for a ball.
    """
    is_cap = body.shape == "cap"
    shape = theory_tip_shape(tip)
    stack = stack_of(layers, body.base if is_cap else None)
    if shape is None or stack is None:
        return None
    contact = Layer.from_stack(profiles.tip_over_spherical_body(shape, body.radius), stack)
    why = "theory's body is flat, and its tip has the curvature of this one relative to the body's"
    return Theory("layer theory" if is_cap else "half-space theory", False, why, contact)


def adhesive_radii(
    theory: Theory | None,
    tip: Indenter,
    layers: Sequence[BodyLayer],
    work: float,
    depth: float,
    force: float | None,
) -> tuple[float, float] | tuple[()]:
    """Contact radii [length] of a tip that adheres without range: where it comes off, and at a
    depth, or at a force [force] where that is prescribed.

    By theory, or that of a half-space of the first layer; empty where neither knows them.
    """
    depth = max(depth, 0.0)
    jkr = theory.jkr(work) if theory else None
    if jkr is None:
        half_space = half_space_theory(
            tip, [replace(layers[0], thickness=None)], tip.radius_at(depth) or 1.0
        )
        jkr = half_space.jkr(work) if half_space else None
    with contextlib.suppress(*SOLUTION_ERRORS):
        target = (depth,) if force is None else (max(force, 0.0), inf)
        if jkr is not None and (deepest_contact := jkr.stable_equilibrium(*target)):
            return jkr.pull_off().a, deepest_contact.a
    return ()


def relative_tip(tip: Indenter, body: Body) -> Indenter:
    """The tip that leaves the same gap over a flat top: of the curvature 1/R relative to the
    body's, 1/R + 1/radius. A sharp tip is its own: beside its apex the body is flat.
    """
    if not isinstance(body, SphericalBody):
        return tip
    match tip:
        case Paraboloid(R=R) | Sphere(R=R) | tips.Hyperboloid(R=R):
            return Paraboloid(1 / (1 / R + 1 / body.radius))
        case Plate() | FlatPunch():
            return Paraboloid(body.radius)
    return tip


def half_space_theory(
    tip: Indenter, layers: Sequence[BodyLayer], size: float = 1.0
) -> Theory | None:
    """Theory of a tip on a half-space, homogeneous or below layers; `size`: about a contact radius
    [length].
    """
    shape = theory_tip_shape(tip)
    stack = stack_of(layers, None, size)
    if shape is None or stack is None:
        return None
    why = "the half-space itself" if len(layers) == 1 else "the layers on the half-space itself"
    theory = Theory(
        "half-space theory",
        True,
        why,
        Layer.from_stack(shape, stack),
        formulas=_film_formulas(layers, tip),
    )
    return _assess_exactness(theory, layers, tip)


def stack_of(layers: Sequence[BodyLayer], base: str | None, size: float = 1.0) -> Stack | None:
    """The layers as theory knows them, on a rigid base, or the last one a half-space where base is
    None. None where theory does not know a material (nu < 0).
    """
    stack_layers = [_theory_layer(layer) for layer in layers]
    if base is None and len(stack_layers) == 1:
        return Stack.half_space(stack_layers[0].E / (1 - stack_layers[0].nu ** 2), size)
    if any(ply.nu < 0 for ply in stack_layers):
        return None
    if base is None:
        stack_layers[-1] = stack_layers[-1]._replace(thickness=inf)
    return Stack(tuple(stack_layers), base)


def _assess_exactness(theory: Theory, layers: Sequence[BodyLayer], tip: Indenter) -> Theory:
    """The theory of a body like its own, with what tip and materials have that it has not, and its
    error.
    """
    assert isinstance(theory.contact, ContactCurve)
    materials = [layer.material for layer in layers if layer.material]
    is_one_half_space = (
        len(layers) == 1 and theory.contact.scaled_stack.is_bottomless
    )  # of the same indentation modulus
    is_isotropic = is_one_half_space or all(material.is_isotropic for material in materials)
    why = first_reason(
        (not is_isotropic, "theory's layers are isotropic"),
        (
            not all(material.is_small_strain for material in materials),
            "theory is that of small strain",
        ),
        (not tip.is_axisymmetric, "theory's tip is the cone of equal sections"),
    )
    moduli = [material.constants.E for material in materials]
    error = (
        THEORY_ERROR
        * max(1.0, max(moduli) / min(moduli) / INEXACT_CONTRAST) ** CONTRAST_ERROR_EXPONENT
    )
    return replace(
        theory, is_exact=theory.is_exact and not why, reason=why or theory.reason, error=error
    )


def _layer_formulas(layers: Sequence[BodyLayer], tip: Indenter, base: str) -> dict[str, ForceCurve]:
    """Dimitriadis, for a paraboloid or a sphere on a single layer."""
    if len(layers) > 1 or not isinstance(tip, Paraboloid | Sphere):
        return {}
    return {
        "Dimitriadis": partial(
            dimitriadis_force, R=tip.R, layer=_theory_layer(layers[0]), base=base
        )
    }


def _film_formulas(layers: Sequence[BodyLayer], tip: Indenter) -> dict[str, ForceCurve]:
    """Gao and Perriot-Barthel, for one film on a half-space."""
    film_theory = half_space_theory(tip, layers[:1]) if len(layers) == 2 else None
    if film_theory is None:
        return {}
    film, substrate = map(_theory_layer, layers)
    moduli = {"Gao": gao_modulus, "Perriot-Barthel": perriot_barthel_modulus}
    force = partial(
        film_force, film=film, substrate=substrate, film_contact=film_theory.solution_at_depth
    )
    return {name: partial(force, modulus=modulus) for name, modulus in moduli.items()}


def _theory_layer(layer: BodyLayer) -> StackLayer:
    assert layer.material is not None
    return StackLayer(layer.thickness or inf, *layer.material.constants)


def _roller_wall(body: Body, center: tuple[float, ...]) -> tuple[float | None, bool, str]:
    """Radius of the roller wall, if the body has the one that theory knows, and what is different
    otherwise.
    """
    if isinstance(body, UnboundedBody):
        return None, True, "the infinitely wide layer itself"
    on_axis = np.allclose(
        center, body.center, rtol=2e-11, atol=1e-12 * body.height
    )  # it is rounded to 12 digits
    match body.shape:
        case "cylinder" if on_axis and body.sides == "roller":
            return body.radius, True, "a layer in a frictionless cylinder is this very body"
        case "strip" if on_axis and body.sides.x_min == body.sides.x_max == "roller":
            return body.width / 2, True, "a strip between frictionless walls is this very body"
    return None, False, "theory's layer is infinitely wide"
