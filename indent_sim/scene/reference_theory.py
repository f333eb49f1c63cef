"""Theory of a scene: which layer or half-space theory, for its tip, and what the body has that
theory has not.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import inf

import numpy as np

from indent_sim.model import tips
from indent_sim.model.body import Body, Cylinder
from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import NeoHookean
from indent_sim.model.imported_body import ImportedBody
from indent_sim.model.layers import Layer as BodyLayer
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic
from indent_sim.model.materials import Material
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import (
    FlatPunch,
    Indenter,
    Paraboloid,
    Plate,
    Profile,
    RegularPyramid,
    Sphere,
    flat_radius,
)
from indent_sim.model.unbounded_bodies import HalfSpace, UnboundedBody
from indent_sim.model.units import Scales
from indent_sim.model.walled_bodies import Box
from indent_sim.model.walled_bodies import Strip as BodyStrip
from indent_sim.theory import half_space, profiles
from indent_sim.theory.compression import (
    Bar,
    Compression,
    HyperelasticBar,
    LinearBar,
    bonded_modulus,
)
from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.films import (
    dimitriadis_force,
    film_force,
    gao_modulus,
    perriot_barthel_modulus,
)
from indent_sim.theory.half_space import estimate_depth
from indent_sim.theory.layer import Layer, sneddon_force
from indent_sim.theory.poroelasticity import PorousSolid
from indent_sim.theory.roots import ForceCurve, depth_of_force
from indent_sim.theory.solution import SOLUTION_ERRORS
from indent_sim.theory.stack import Stack, StackLayer
from indent_sim.theory.strip import Strip
from indent_sim.theory.theory import THEORY_ERROR, Theory

NO_INCLUSIONS = "theory's body has no inclusions"
# Between moduli from which theory loses digits, and the power: 2e-6 was measured at 1e5
INEXACT_CONTRAST = 1e4
CONTRAST_ERROR_EXPONENT = 2.5
RADIUS_TOLERANCE = 1e-9  # relative: radii that differ by less are one
NEARLY_INCOMPRESSIBLE = (
    0.49  # Poisson's ratio from which rubber's formula for bonded blocks is said
)


@dataclass(frozen=True)
class TipTheory:
    """What theory knows of a kind of tip: its shape, and force(delta, size, E_star) of a sharp one
    on a half-space.

    takes: what the shape takes of the tip, by name; the first is the size. half_space: whose
    formula the force is.
    """

    shape: Callable[..., profiles.Tip]
    tip_attributes: tuple[str, ...] = ()
    formula_name: str = ""
    force: Callable[..., float] | None = None


SlopeJumps = Callable[
    [], Sequence[tuple[float, float, float]]
]  # of a profile: radius, half of the width, and jump


def _piecewise_linear_tip(
    points: Sequence[Sequence[float]],
    tip_radius: float,
    slope: profiles.Shape,
    slope_jumps: SlopeJumps,
) -> profiles.Tip:
    if tip_radius == 0.0:
        return profiles.piecewise_linear(points)
    slope_discontinuities = {
        round(edge, 15) for c, w, _ in slope_jumps() for edge in (c - w, c + w)
    }
    return profiles.tip_from_slope(
        slope,
        max_radius=points[-1][0],
        slope_discontinuities=sorted(b for b in slope_discontinuities if b > 0),
    )


PUNCH_FORMULA = ("Sneddon (flat punch)", half_space.flat_punch_force)
SQUARE_PYRAMID_FORMULA = ("a square pyramid on a half-space", half_space.square_pyramid_force)
PYRAMID_THEORY = TipTheory(
    profiles.equivalent_cone, ("half_angle", "equivalent_radius_ratio", "tip_radius"), *SQUARE_PYRAMID_FORMULA
)
TIP_THEORIES: dict[type, TipTheory] = {
    Paraboloid: TipTheory(profiles.paraboloid, ("R",), "Hertz", half_space.paraboloid_force),
    Sphere: TipTheory(profiles.sphere, ("R",), "Sneddon (sphere)", half_space.sphere_force),
    tips.Cone: TipTheory(
        profiles.cone, ("half_angle", "tip_radius"), "Sneddon (cone)", half_space.cone_force
    ),
    tips.Hyperboloid: TipTheory(profiles.hyperboloid, ("R", "half_angle")),
    FlatPunch: TipTheory(profiles.flat_punch, ("radius", "edge_radius"), *PUNCH_FORMULA),
    Plate: TipTheory(profiles.flat_plate),
    **dict.fromkeys((tips.Pyramid, tips.Berkovich, tips.Vickers, tips.CubeCorner), PYRAMID_THEORY),
    Profile: TipTheory(_piecewise_linear_tip, ("points", "tip_radius", "slope", "rounding_arcs")),
}


def theory_tip_shape(tip: Indenter) -> profiles.Tip | None:
    """The tip as layer theory sees it; None for one that it does not know."""
    tip_theory = TIP_THEORIES.get(type(tip))
    with contextlib.suppress(ValueError):
        return (
            tip_theory.shape(*(getattr(tip, name) for name in tip_theory.tip_attributes))
            if tip_theory
            else None
        )
    return None


def first_reason(*reasons: tuple[bool, str]) -> str:
    """The first of the reasons that apply; empty where none does."""
    return next((why for applies, why in reasons if applies), "")


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
        return _compression_theory(body, layers, flat_radius(tip) / body.max_lateral_extent(center))
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


def covers_top(tip: Indenter, body: Body, center: tuple[float, ...]) -> bool:
    """Whether the flat face of a tip on the axis `center` covers all of a flat top, which then
    compresses the body as a plate does, as long as no rim bulges past its edge. Not known of a
    mesh from a file.
    """
    if not isinstance(body, Cylinder | BodyStrip | Box):
        return False
    return flat_radius(tip) >= body.max_lateral_extent(center) * (1 - RADIUS_TOLERANCE)


# What a compression is called by the number of directions across it in which walls hold the body
COMPRESSION_NAMES = ("uniaxial compression", "plane-strain compression", "confined compression")


def _compression_theory(
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
    """Gent and Lindley's force of a nearly incompressible disc or strip that is bonded at its base."""
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


def half_space_depth(tip: Indenter, force: float, E_star: float) -> tuple[str, float] | None:
    """Name and depth of a tip on a half-space at a force; None for the tips that nobody has a
    formula for.
    """
    start = estimate_depth(tip.radius_at, force, E_star)
    name, force_at = _half_space_formula(tip, start, E_star)
    depth = depth_of_force(force_at, force, start) if force_at else None
    return (name, depth) if depth else None


def half_space_force(tip: Indenter, delta: float, E_star: float) -> tuple[str, float] | None:
    """Name and force of a tip on a half-space (Hertz, Sneddon); None for the tips that nobody has a
    formula for.
    """
    name, force_at = _half_space_formula(tip, delta, E_star)
    try:
        return (name, force_at(delta)) if force_at else None
    except SOLUTION_ERRORS:
        return None


def _half_space_formula(
    tip: Indenter, delta: float, E_star: float
) -> tuple[str, ForceCurve | None]:
    """Name and force of a tip on a half-space near a depth; by quadrature where it has no closed
    form.
    """
    if not delta > 0:
        return "", None
    name, force_at = _closed_form_formula(tip, E_star)
    if force_at or not name:
        return name, force_at
    shape = theory_tip_shape(tip) if tip.is_axisymmetric else None
    unit = float(2.0 ** np.ceil(np.log2(tip.radius_at(delta))))  # about the contact radius
    half_space = Stack.half_space(E_star, unit)
    return name, partial(sneddon_force, tip=shape, half_space=half_space) if shape else None


@lru_cache(maxsize=16)  # every row and every point of a curve asks
def _closed_form_formula(tip: Indenter, E_star: float) -> tuple[str, ForceCurve | None]:
    """Name and force of a tip on a half-space; no force where it takes a quadrature, no name where
    nobody knows it.
    """
    tip_theory = TIP_THEORIES.get(type(tip))
    if (
        tip_theory is None
        or isinstance(tip, Plate)
        or (isinstance(tip, RegularPyramid) and tip.faces != 4)
    ):
        return "", None
    if (
        tip_theory.force is None
        or getattr(tip, "tip_radius", 0.0) > 0
        or getattr(tip, "edge_radius", 0.0) > 0
    ):
        return "Sneddon (quadrature)", None
    first_attribute = {tip_theory.tip_attributes[0]: getattr(tip, tip_theory.tip_attributes[0])}
    return tip_theory.formula_name, partial(tip_theory.force, E_star=E_star, **first_attribute)


def undrained_law(material: Material) -> Material:
    """The elastic law of a canonical material from which no fluid leaves; the material itself where
    none flows.

    At small strain its bulk modulus is K + alpha^2/storage, at finite strain its volume stays what
    it is; a gel's network is neo-Hookean then.
    """
    flow = material.flow
    law = material
    if flow is None:
        return material
    E, nu = law.constants
    if isinstance(law, TransverselyIsotropic):
        return _undrained_anisotropic_law(law)
    if isinstance(law, Gel):
        return NeoHookean(E=3 * law.shear_modulus, nu=0.5)
    assert flow.permeability is not None
    solid = PorousSolid(E, nu, flow.permeability, flow.alpha, flow.storage)
    undrained_values = {"nu": solid.undrained_nu, "flow": None, "formulation": "auto"}
    undrained_values |= (
        {"E": solid.undrained_E} if isinstance(law, LinearElastic | NeoHookean) else {}
    )
    return replace(law, **undrained_values)  # type: ignore[arg-type]


def _undrained_anisotropic_law(law: TransverselyIsotropic) -> Material:
    """S_u = S - (S alpha)(S alpha)^T/(alpha S alpha + storage) of the compliance S (Woodbury)."""
    assert law.flow is not None
    E = law.E
    E_z = law.E_z
    nu = law.nu
    nu_z = law.nu_z
    alpha = law.flow.alpha
    across = alpha * ((1 - nu) / E - nu_z / E_z)
    along = alpha * (1 - 2 * nu_z) / E_z
    storage_compliance = alpha * (2 * across + along) + law.flow.storage
    E_u = 1 / (1 / E - across**2 / storage_compliance)
    E_zu = 1 / (1 / E_z - along**2 / storage_compliance)
    nu_zu = (nu_z / E_z + across * along / storage_compliance) * E_zu if law.flow.storage else 0.5
    nu_u = (
        (nu / E + across**2 / storage_compliance) * E_u
        if law.flow.storage
        else 1 - E_u / (2 * E_zu)
    )
    return replace(law, E=E_u, E_z=E_zu, nu=nu_u, nu_z=nu_zu, flow=None, formulation="auto")


def relaxed_law(material: Material, left: float) -> Material:
    """The elastic law of a canonical material of which a share of the shear stress is left, and all
    of the bulk modulus, or where everything relaxes the same share of it; the material itself
    where nothing does.
    """
    if material.relaxation is None:
        return material
    law = Scales(1.0, 1.0 / left).nondimensionalize(replace(material, flow=None))
    if material.has_shear_relaxation and material.constants.nu < 0.5:
        E, nu = material.relaxed_constants(left)
        relaxed_constants = {"nu": nu} | ({"E": E} if isinstance(law, LinearElastic) else {})
        law = replace(law, **relaxed_constants)  # type: ignore[arg-type]
    return replace(law, relaxation=None, flow=material.flow)
