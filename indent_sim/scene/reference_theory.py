"""Reference theory of a scene, and the differences between the scene and the theory."""

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
    Lens,
    Paraboloid,
    Plate,
    SoftCylinder,
    Sphere,
    flat_radius,
)
from indent_sim.model.unbounded_bodies import HalfSpace, UnboundedBody
from indent_sim.model.walled_bodies import Box
from indent_sim.model.walled_bodies import Strip as BodyStrip
from indent_sim.scene.compression_theory import compression_theory, covers_top
from indent_sim.scene.measured_constants import CONTRAST_ERROR_EXPONENT, INEXACT_CONTRAST
from indent_sim.scene.tip_theories import theory_tip_shape
from indent_sim.theory import profiles
from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.contacts_in_series import ContactsInSeries
from indent_sim.theory.films import (
    dimitriadis_force,
    film_force,
    gao_modulus,
    perriot_barthel_modulus,
)
from indent_sim.theory.layer import Layer
from indent_sim.theory.measured_constants import THEORY_ERROR
from indent_sim.theory.roots import ForceCurve
from indent_sim.theory.solution import SOLUTION_ERRORS
from indent_sim.theory.stack import Stack, StackLayer
from indent_sim.theory.stack_pair import StackPair
from indent_sim.theory.strip import Strip
from indent_sim.theory.theory import Theory

NO_INCLUSIONS = "the theory does not include inclusions"
INFINITELY_WIDE = "the layer of the theory is infinitely wide"


def theory_of(
    body: Body,
    layers: Sequence[BodyLayer],
    tip: Indenter,
    center: tuple[float, ...],
    surface_tension: float = 0.0,
) -> Theory | None:
    """Return the reference theory of a scene, without its inclusions; None if there is no theory.

    Parameters
    ----------
    body : Body
        The body.
    layers : sequence of Layer
        The layers of the body from the top.
    tip : Indenter
        The tip.
    center : tuple of float
        Horizontal position of the tip's axis [length].
    surface_tension : float, optional
        Surface tension [pressure length].

    Returns
    -------
    Theory or None
        The theory, with the reason if it is not exact for this body.
    """
    theory = (
        half_space_theory(tip, layers)
        if isinstance(body, HalfSpace)
        else layer_theory(body, layers, tip, center)
    )
    if theory and surface_tension:
        theory = _add_surface_tension(theory, surface_tension)
    if theory and tip.elastic_part:
        theory = _soft_tip_theory(theory, tip.elastic_part, body)
    if theory is None or not body.inclusions:
        return theory
    return theory.add_differences(NO_INCLUSIONS)


def _add_surface_tension(theory: Theory, surface_tension: float) -> Theory | None:
    """Return the theory of a layer with surface tension; None in plane strain.

    The theory is for a layer without side walls, so that it is not exact for a body with a wall.
    """
    if not isinstance(theory.contact, Layer):
        return None
    from indent_sim.theory.surface_tension import LayerWithSurfaceTension

    contact = LayerWithSurfaceTension.from_layer(theory.contact, surface_tension)
    if theory.contact.wall < inf:
        theory = theory.add_differences(INFINITELY_WIDE)
    if contact.has_slope_discontinuities:
        theory = theory.add_differences(
            "with surface tension, theory's pressure oscillates under a tip with slope "
            "discontinuities"
        )
    return replace(theory, contact=contact, error=max(theory.error, contact.error), formulas={})


def _soft_tip_theory(theory: Theory, lens: Lens | SoftCylinder, body: Body) -> Theory | None:
    """Return the theory of a body under a soft tip; None if no layer resembles the tip.

    The free sides of a soft punch are at the edge of its contact with a flat body.
    """
    if isinstance(lens, SoftCylinder) and not isinstance(body, SphericalBody):
        return None
    return _add_soft_tip(theory, lens)


def _add_soft_tip(theory: Theory, lens: Lens | SoftCylinder) -> Theory | None:
    """Return the theory of a layer under a soft tip, which is also treated as a flat layer.

    The result is None in plane strain.
    """
    rigid = theory.contact
    if isinstance(rigid, ContactsInSeries):
        upper = _add_soft_tip(replace(theory, contact=rigid.upper), lens)
        if upper is None:
            return None
        assert isinstance(upper.contact, ContactCurve)
        return replace(upper, contact=replace(rigid, upper=upper.contact))
    if not isinstance(rigid, Layer):
        return None
    body = rigid.scaled_stack.scaled(rigid.h, rigid.E_star / rigid.scaled_stack.E_star)
    soft_layer = StackLayer(lens.thickness, *lens.material.constants)
    pair = StackPair.join(body, Stack((soft_layer,)))
    return replace(
        theory.add_differences("the theory takes the soft tip as a flat layer of its thickness"),
        contact=Layer.from_stack(rigid.tip, pair),
        formulas={},
    )


def layer_theory(
    body: Body, layers: Sequence[BodyLayer], tip: Indenter, center: tuple[float, ...]
) -> Theory | None:
    """Return the layer theory of a bounded body; None if there is none.

    No theory exists for a body from a mesh file, for layers with nu < 0, and for tips whose profile
    no theory includes. The parameters are those of `theory_of`.
    """
    if isinstance(body, ImportedBody):
        return None
    assert not isinstance(body, HalfSpace)
    if isinstance(body, SphericalBody):
        return _spherical_body_theory(body, layers, tip)
    if isinstance(body, Cylinder | BodyStrip | Box) and covers_top(tip, body, center):
        radius_ratio = flat_radius(tip) / body.max_lateral_extent(center)
        return compression_theory(body, layers, center, radius_ratio)
    shape = theory_tip_shape(tip, body.dim)
    is_plane = body.dim == 2
    stack = stack_of(layers, body.base)
    if shape is None or stack is None or (is_plane and shape.f is None):
        return None
    wall, scope = _roller_wall(body, center)
    contact = (Strip if is_plane else Layer).from_stack(shape, stack, wall)
    formulas = {} if is_plane else _layer_formulas(layers, tip, body.base)
    differences = () if scope else (INFINITELY_WIDE,)
    theory = Theory("layer theory", contact, scope, differences, formulas=formulas)
    return _assess_exactness(theory, layers, tip)


def _spherical_body_theory(
    body: SphericalBody, layers: Sequence[BodyLayer], tip: Indenter
) -> Theory | None:
    """Return the theory of a flat body and a tip with the sum of both curvatures.

    The flat body is a layer with the height of a cap, or a half-space for a ball or an ellipsoid.
    """
    is_cap = body.shape == "cap"
    shape = theory_tip_shape(tip)
    # The flat base of a cap that rests on a flat stays in contact nearly everywhere.
    base = "roller" if body.rests_on_flat else body.base
    stack = stack_of(layers, base if is_cap else None)
    if shape is None or stack is None:
        return None
    contact = Layer.from_stack(profiles.tip_over_spherical_body(shape, body.apex_radius), stack)
    difference = "the theory uses a flat body and a tip with the sum of both curvatures"
    if body.rests_on_flat and not is_cap:
        plate = profiles.tip_over_spherical_body(profiles.flat_plate(), body.apex_radius)
        series = ContactsInSeries(contact, Layer.from_stack(plate, stack))
        difference = f"{difference}, for each of the two contacts"
        return Theory("two contacts in series", series, differences=(difference,))
    name = "layer theory" if is_cap else "half-space theory"
    return Theory(name, contact, differences=(difference,))


def adhesive_radii(
    theory: Theory | None,
    tip: Indenter,
    layers: Sequence[BodyLayer],
    work: float,
    depth: float,
    force: float | None,
) -> tuple[float, float] | tuple[()]:
    """Return the JKR contact radii at pull-off and in the deepest contact.

    Parameters
    ----------
    theory : Theory or None
        The reference theory; if it has no JKR contact, a half-space of the first layer is used.
    tip : Indenter
        The tip.
    layers : sequence of Layer
        Layers from the top.
    work : float
        Work of adhesion [pressure length].
    depth : float
        Largest depth [length].
    force : float or None
        Largest force [pressure length^2] if forces are prescribed.

    Returns
    -------
    tuple of float
        Both radii [length]; empty if no theory has an equilibrium.
    """
    depth = max(depth, 0.0)
    jkr = theory.jkr(work) if theory else None
    if jkr is None:
        half_space = half_space_theory(
            tip, [replace(layers[0], thickness=None)], tip.radius_at(depth) or 1.0
        )
        jkr = half_space.jkr(work) if half_space else None
    with contextlib.suppress(*SOLUTION_ERRORS):
        # A prescribed force is the equilibrium at the end of a spring of infinite compliance.
        prescribed = (depth,) if force is None else (max(force, 0.0), inf)
        if jkr is not None and (deepest_contact := jkr.stable_equilibrium(*prescribed)):
            return jkr.pull_off().a, deepest_contact.a
    return ()


def relative_tip(tip: Indenter, body: Body) -> Indenter:
    """Return the tip that has the same gap over a flat body as the given tip over its body.

    To second order it is a paraboloid with the curvature 1/R + 1/apex_radius. A sharp tip is
    returned unchanged, since the body is flat near its apex.
    """
    if not isinstance(body, SphericalBody):
        return tip
    match tip:
        case Paraboloid(R=R) | Sphere(R=R) | tips.Hyperboloid(R=R):
            return Paraboloid(1 / (1 / R + 1 / body.apex_radius))
        case Plate() | FlatPunch():
            return Paraboloid(body.apex_radius)
    return tip


def half_space_theory(
    tip: Indenter, layers: Sequence[BodyLayer], size: float = 1.0
) -> Theory | None:
    """Return the theory of a tip on layers on a half-space; None if no theory exists.

    The last layer is the half-space. `size` is a length of about the contact radius [length], the
    length unit for a homogeneous half-space.
    """
    shape = theory_tip_shape(tip)
    stack = stack_of(layers, None, size)
    if shape is None or stack is None:
        return None
    scope = f"theory describes this {'layered ' if len(layers) > 1 else ''}half-space exactly"
    theory = Theory(
        "half-space theory",
        Layer.from_stack(shape, stack),
        scope,
        formulas=_film_formulas(layers, tip),
    )
    return _assess_exactness(theory, layers, tip)


def stack_of(layers: Sequence[BodyLayer], base: str | None, size: float = 1.0) -> Stack | None:
    """Return the layers for the theory; None if a layer has nu < 0.

    Parameters
    ----------
    layers : sequence of Layer
        Layers from the top.
    base : str or None
        "fixed" or "roller" for a rigid base; None if the last layer is a half-space.
    size : float, optional
        Length unit of a homogeneous half-space [length].

    Returns
    -------
    Stack or None
        Thickness and elastic constants of the layers.
    """
    stack_layers = [_theory_layer(layer) for layer in layers]
    if base is None and len(stack_layers) == 1:
        return Stack.half_space(stack_layers[0].E / (1 - stack_layers[0].nu ** 2), size)
    if any(layer.nu < 0 for layer in stack_layers):
        return None
    if base is None:
        stack_layers[-1] = stack_layers[-1]._replace(thickness=inf)
    return Stack(tuple(stack_layers), base)


def _assess_exactness(theory: Theory, layers: Sequence[BodyLayer], tip: Indenter) -> Theory:
    """Return the theory with its error; not exact if materials or tip are simplified."""
    assert isinstance(theory.contact, ContactCurve)
    materials = [layer.material for layer in layers if layer.material]
    # A transversely isotropic half-space indents as the isotropic one of its indentation modulus.
    is_one_half_space = len(layers) == 1 and theory.contact.scaled_stack.is_bottomless
    is_isotropic = is_one_half_space or all(material.is_isotropic for material in materials)
    if not is_isotropic:
        theory = theory.add_differences("the layers of the theory are isotropic")
    if not all(material.is_small_strain for material in materials):
        theory = theory.add_differences("strains are finite, but the theory is for small strain")
    if tip.tilt_direction is not None:
        theory = theory.add_differences(
            "the tip of the theory is upright, with equal cross-sections"
        )
    elif not tip.is_axisymmetric:
        theory = theory.add_differences(
            "the tip of the theory is the cone with equal cross-sections"
        )
    moduli = [material.constants.E for material in materials]
    error = (
        THEORY_ERROR
        * max(1.0, max(moduli) / min(moduli) / INEXACT_CONTRAST) ** CONTRAST_ERROR_EXPONENT
    )
    return replace(theory, error=error)


def _layer_formulas(layers: Sequence[BodyLayer], tip: Indenter, base: str) -> dict[str, ForceCurve]:
    """Return the formula of Dimitriadis for a paraboloid or a sphere on a single layer."""
    if len(layers) > 1 or not isinstance(tip, Paraboloid | Sphere):
        return {}
    return {
        "Dimitriadis": partial(
            dimitriadis_force, R=tip.R, layer=_theory_layer(layers[0]), base=base
        )
    }


def _film_formulas(layers: Sequence[BodyLayer], tip: Indenter) -> dict[str, ForceCurve]:
    """Return the formulas of Gao and of Perriot and Barthel for one film on a half-space."""
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
    """Return thickness and elastic constants of a layer."""
    assert layer.material is not None
    return StackLayer(layer.thickness or inf, *layer.material.constants)


def _roller_wall(body: Body, center: tuple[float, ...]) -> tuple[float | None, str]:
    """Return the radius [length] of a roller wall and the scope of the theory.

    The reference theory has either a frictionless wall around the tip's axis or no wall. The radius
    is None for a theory without a wall. The scope is empty if the walls of the body differ from
    those of the theory.
    """
    if isinstance(body, UnboundedBody):
        return None, "theory describes this infinitely wide layer exactly"
    # Positions are rounded to 12 digits.
    is_on_axis = np.allclose(center, body.center, rtol=2e-11, atol=1e-12 * body.height)
    match body.shape:
        case "cylinder" if is_on_axis and body.sides == "roller":
            return body.radius, "theory describes this layer in a frictionless cylinder exactly"
        case "strip" if is_on_axis and body.sides.x_min == body.sides.x_max == "roller":
            scope = "theory describes this strip between frictionless walls exactly"
            return body.width / 2, scope
    return None, ""
