"""Table of the effects that a model may neglect.

Each row has a function that chooses two scenes to compare, one with the effect and one without, for
a scene and a relative tolerance.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import hypot, inf, log
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.body import Cylinder
from indent_sim.model.body_base import Support
from indent_sim.model.contact import Friction
from indent_sim.model.history import History
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.layers import Layer as BodyLayer
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.tips import (
    FlatPunch,
    Hyperboloid,
    Indenter,
    Paraboloid,
    Plate,
    Profile,
    Sphere,
)
from indent_sim.model.unbounded_bodies import HalfSpace, InfiniteLayer, UnboundedBody
from indent_sim.model.walled_bodies import Strip, StripSides
from indent_sim.run.model_selection import variants
from indent_sim.run.model_selection.effects import (
    EffectRow,
    EffectSource,
    FixedEffect,
    ThresholdSearch,
    UnknownEffect,
    VariantPair,
    no_effect,
)
from indent_sim.run.model_selection.variant_solver import VariantSolver, history_variant
from indent_sim.run.model_selection.variants import (
    change_materials,
    half_space_variant,
    replace_sections,
)
from indent_sim.scene.prescribed_history import remaining_modulus_fraction
from indent_sim.theory.adhesion import Jkr
from indent_sim.theory.layer import Layer
from indent_sim.theory.punches import LayerPunches
from indent_sim.theory.roots import increasing_root

# Friction coefficients that are tried if a scene has no friction.
SAMPLE_FRICTIONS: tuple[Friction, ...] = (0.1, 0.3, "stick")
# Smallest radius of a wall around a flat punch, relative to that of the punch. At a ratio of 1 the
# whole body is compressed, which is another problem.
MIN_WALL_RATIO = 1.01
# The range of friction extends beyond the sampled one by half of its width and this relative force.
RANGE_MARGIN = 1e-3
# Relative change of R for the derivative of the force.
RADIUS_CHANGE = 0.02
# The search for a significant surface tension begins at this fraction of E* delta.
FIRST_TENSION_FRACTION = 0.01
# The search for the contact radius with adhesion begins above that without, by this fraction.
RADIUS_MARGIN = 1e-3
# Depths of that search are at least this fraction of the prescribed depth.
MIN_DEPTH_FRACTION = 1e-6
# Radius of the edge of a flat punch at finite strain, relative to that of the punch: a sharper edge
# cannot be solved. The effect of finite strain depends little on it: for nu = 0.3 and
# delta/a = 0.1 it is 1.18 to 1.23 % with edges of 0.005 to 0.1, and 1.6 % with a sharp edge.
EDGE_ROUNDING = 0.05
# The modulus of a substrate is varied downwards from this multiple of that of the layer.
MAX_MODULUS_RATIO = 1e3
# Poisson's ratio of that substrate.
SUBSTRATE_NU = 0.3


def _paraboloid(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Sphere instead of the paraboloid with the same radius of curvature."""
    tip = solver.config.indenter
    if not isinstance(tip, Paraboloid | Sphere):
        return no_effect(f"the tip is a {tip.shape.replace('_', ' ')}, not a sphere or paraboloid")
    return VariantPair(
        solver.replace_tip(Sphere(tip.R)),
        solver.replace_tip(Paraboloid(tip.R)),
        f"a sphere relative to a paraboloid{solver.stand_in_text}",
    )


def _blunt_tip(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Rounding of an apex or of the edge of a punch."""
    tip: Any = solver.tip
    key = "edge_radius" if isinstance(tip, FlatPunch) else "tip_radius"
    if not hasattr(tip, key):
        return no_effect(f"a {tip.shape.replace('_', ' ')} has neither a sharp apex nor an edge")
    sharp = replace(tip, **{key: 0.0})
    if getattr(tip, key) > 0:
        return VariantPair(
            solver.plain_scene,
            solver.replace_tip(sharp),
            f"the rounded tip relative to a sharp one{solver.stand_in_text}",
        )
    if (
        isinstance(tip, Profile)
        or solver.theory_variant is None
        or (solver.is_spherical and isinstance(tip, FlatPunch))
    ):
        return UnknownEffect("there is no theory of this tip and body")
    sharp_variant = replace_sections(solver.theory_variant, indenter=sharp)
    ratio = solver.ratio_over_parameter(
        sharp_variant,
        lambda radius: replace_sections(sharp_variant, indenter=replace(tip, **{key: radius})),
    )
    max_radius = 0.999 * tip.radius if isinstance(tip, FlatPunch) else inf
    return ThresholdSearch(
        f"indenter.{key}",
        ratio,
        min(0.1 * solver.delta, max_radius / 2),
        f"theory{solver.stand_in_text}",
        max_value=max_radius,
    )


def _thickness(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Finite thickness of the body, relative to a half-space."""
    body = solver.config.body
    layer = solver.layer_scene
    if body.dim == 2:
        return UnknownEffect(
            "in plane strain the depth of a half-space is indefinite: the thickness always matters"
        )
    if isinstance(body, HalfSpace):
        return _half_space_height(solver)
    if layer is None:
        assert solver.half_space_scene is not None
        change = solver.scene_force / solver.force(solver.half_space_scene) - 1
        return FixedEffect(
            change,
            change,
            f"the body as it is relative to a half-space{solver.stand_in_text}",
            change,
        )
    source = f"theory of a layer relative to that of a half-space{solver.stand_in_text}"
    return VariantPair(
        layer,
        half_space_variant(layer),
        source if solver.is_isotropic else "a layer relative to a half-space",
    )


def _half_space_height(solver: VariantSolver) -> EffectSource:
    """Thickness from which on the force is that of a half-space; x is the inverse height."""
    if solver.config.body.layers:
        return no_effect("the last layer is a half-space")
    scales = solver.scene.physics.scales
    a = solver.scene.physics.indenter.radius_at(solver.delta / scales.depth) * scales.length
    ratio = solver.ratio_over_parameter(
        solver.plain_scene,
        lambda x: replace_sections(solver.plain_scene, body=InfiniteLayer(1 / x)),
    )
    return ThresholdSearch(
        "body.height",
        ratio,
        0.05 / a,
        "theory of a layer on a rigid base",
        lambda x: 1 / x,
        " or less",
    )


def _side_walls(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Sides of the body, relative to an infinitely wide layer."""
    body = solver.config.body
    layer = solver.layer_scene
    if isinstance(body, HalfSpace):
        return no_effect("a half-space has no sides")
    if isinstance(body, UnboundedBody):
        return _layer_wall_search(solver)
    if isinstance(body, Strip):
        wide_strip: Any = solver.plain_scene.body
        wide_strip = replace(
            wide_strip,
            width=2 * body.width + 20 * body.height,
            sides=StripSides("roller", "roller"),
        )
        wide_variant = replace_sections(solver.plain_scene, body=wide_strip, center=None)
        return VariantPair(
            solver.plain_scene, wide_variant, "the strip relative to one with distant walls"
        )
    if layer is None:
        return no_effect("included in the row of the thickness, which compares the whole body")
    changes = [_side_wall_change(solver, sides) for sides in solver.side_supports]
    if not solver.has_cylinder_stand_in:
        return FixedEffect(
            changes[0],
            changes[0],
            f"the body with its sides relative to an infinitely wide layer{solver.stand_in_text}",
            changes[0],
        )
    source = (
        f"between no sides and {' or '.join(solver.side_supports)} sides all around at the "
        "distance of the nearest side"
    )
    return FixedEffect(min(0.0, *changes), max(0.0, *changes), source)


def _side_wall_change(solver: VariantSolver, sides: Support) -> float:
    """Relative change of the force by sides.

    Roller sides are compared with none by theory, and other sides with rollers on one mesh.
    """
    body: Any = solver.plain_scene.body
    supported, rollers = (
        replace_sections(solver.plain_scene, body=replace(body, sides=side))
        for side in (sides, "roller")
    )
    support_ratio = (
        1.0
        if sides == "roller"
        else solver.force_ratio(solver.meshed_variant(supported), solver.meshed_variant(rollers))
    )
    return solver.force_ratio(rollers, solver.layer_scene) * support_ratio - 1  # type: ignore[arg-type]


def _layer_wall_search(solver: VariantSolver) -> EffectSource:
    """Radius of a frictionless wall in an infinitely wide layer; x is the inverse radius."""
    layer: Any = solver.plain_scene.body
    cylinder = partial(
        Cylinder, height=layer.height, base=layer.base, sides="roller", layers=layer.layers
    )
    ratio = solver.ratio_over_parameter(
        solver.plain_scene, lambda x: replace_sections(solver.plain_scene, body=cylinder(1 / x))
    )
    tip = solver.tip
    min_radius = MIN_WALL_RATIO * tip.radius if isinstance(tip, FlatPunch) else 0.0
    max_value = 1 / min_radius if min_radius else inf
    return ThresholdSearch(
        "a frictionless wall at radius",
        ratio,
        min(0.3 / layer.height, max_value),
        "theory of a layer with and without the wall",
        lambda x: 1 / x,
        " or nearer",
        max_value,
    )


def _substrate(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Matter below the first layer, or below a body on a rigid base."""
    body: Any = solver.config.body
    layer = solver.layer_scene
    if isinstance(body, HalfSpace) and not body.layers:
        return no_effect("there is nothing below a half-space")
    if layer is None:
        return no_effect(
            "the body rests on a rigid base; its materials are compared in the row of the layers"
        )
    if len(layer.layers) > 1:
        first = layer.layers[0].material
        first_layer = replace_sections(layer, body=HalfSpace(), material=first)
        return VariantPair(
            layer,
            first_layer,
            f"theory of all layers relative to a half-space of the first{solver.stand_in_text}",
        )
    if not solver.is_isotropic or body.base != "fixed":
        return UnknownEffect("there is no theory of such a layer on a half-space")
    film = layer.layers[0].material
    (E, _) = solver.materials[0].constants

    def substrate_variant(x: float) -> Config:
        """The layer on a half-space of modulus MAX_MODULUS_RATIO E/x."""
        layers = (
            BodyLayer(body.height, film),
            BodyLayer(None, LinearElastic(E=MAX_MODULUS_RATIO / x * E, nu=SUBSTRATE_NU)),
        )
        return replace_sections(layer, body=HalfSpace(layers=layers), material=None)

    return ThresholdSearch(
        "a substrate of E",
        solver.ratio_over_parameter(layer, substrate_variant),
        1.0,
        f"theory of the layer on a half-space of nu = {SUBSTRATE_NU:g}",
        lambda x: MAX_MODULUS_RATIO / x * E,
        " or less",
    )


def _layers(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Layers or regions, relative to a homogeneous body of the material that the tip touches."""
    if len(solver.config.layers) < 2 and not getattr(solver.config.body, "regions", None):
        return no_effect("the body is homogeneous")
    is_meshed = isinstance(solver.config.body, MeshFromFile)
    touched_law: Any = solver.touched_material if is_meshed else None
    if not is_meshed:
        touched_law = variants.linear_law(
            solver.config.layers[0].material  # type: ignore[arg-type]
        )
    homogeneous = change_materials(solver.plain_scene, lambda material: touched_law)
    return VariantPair(
        solver.plain_scene,
        homogeneous,
        "the body with its layers relative to a homogeneous one of the material under the tip"
        f"{solver.stand_in_text}",
    )


def _inclusions(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Inclusions, relative to inclusions of the surrounding material on the same mesh."""
    if not solver.config.body.inclusions:
        return no_effect("the body has no inclusions")
    if solver.linear_scene.body.inclusions:
        variant = solver.meshed_variant(solver.linear_scene)
        stand_in = solver.stand_in_text
    else:
        variant = replace_sections(
            change_materials(solver.single_step_scene, variants.linear_law), mesh=solver.config.mesh
        )
        stand_in = ", in three dimensions"
    source = f"the body with its inclusions relative to one without, on one mesh{stand_in}"
    return VariantPair(variant, variants.remove_inclusion_contrast(variant), source)


def _anisotropy(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Transverse isotropy, relative to an isotropic material."""
    if solver.is_isotropic:
        return no_effect("the material is isotropic")
    source = (
        "relative to an isotropic material with the E and nu of the plane of isotropy"
        f"{solver.stand_in_text}"
    )
    return VariantPair(
        solver.linear_scene, change_materials(solver.linear_scene, variants.isotropic_law), source
    )


def _small_strain(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Finite strain and gap in the deformed configuration, relative to small strain."""
    if not solver.is_isotropic:
        return UnknownEffect("there is no anisotropic law of finite strain")
    tip, edge_text = _round_punch_edge(solver.tip)
    law = "its own law" if not solver.scene.physics.small_strain else "neo-Hookean"
    small, finite = (
        replace_sections(variant, indenter=tip)
        for variant in (solver.linear_scene, solver.hyperelastic_scene)
    )
    source = (
        f"finite strain ({law}, gap: current) relative to small strain (gap: reference), on one "
        f"mesh{edge_text}{solver.stand_in_text}"
    )
    finite_variant = solver.meshed_variant(finite, gap="current", **solver.friction_or_adhesion)
    return VariantPair(
        finite_variant, solver.meshed_variant(small, **solver.friction_or_adhesion), source
    )


def _round_punch_edge(tip: Indenter) -> tuple[Indenter, str]:
    """The tip with a rounded edge if it is a sharp flat punch, and a text that says so."""
    if not isinstance(tip, FlatPunch) or tip.edge_radius >= EDGE_ROUNDING * tip.radius:
        return tip, ""
    text = f", the punch's edge rounded by {EDGE_ROUNDING:g} of its radius in both"
    return replace(tip, edge_radius=EDGE_ROUNDING * tip.radius), text


def _incompressible(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Incompressibility, relative to the given Poisson's ratio; x is 0.5 - nu."""
    if not solver.is_isotropic:
        return UnknownEffect("the material is not isotropic")
    if any(material.constants.nu != 0.5 for material in solver.materials):
        incompressible_variant = change_materials(solver.linear_scene, variants.incompressible_law)
        return VariantPair(
            incompressible_variant,
            solver.linear_scene,
            f"nu = 0.5 relative to the given nu, at the same E{solver.stand_in_text}",
        )
    theory_variant = solver.theory_variant
    if theory_variant is None:
        return UnknownEffect("there is no theory of this body")
    ratio = solver.ratio_over_parameter(
        theory_variant,
        lambda x: change_materials(
            theory_variant, partial(variants.incompressible_law, nu_deficit=x)
        ),
    )
    return ThresholdSearch(
        "nu",
        ratio,
        0.01,
        f"theory{solver.stand_in_text}",
        lambda x: 0.5 - x,
        " or less",
        max_value=0.5,
        digits=4,
    )


def _surface_tension(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Surface tension; without one, x is the tension."""
    body: Any = solver.config.body
    if body.surface_tension:
        variant = replace_sections(
            solver.plain_scene,
            body=replace(solver.plain_scene.body, surface_tension=0.0),  # type: ignore[arg-type]
        )
        return VariantPair(
            solver.plain_scene,
            variant,
            f"the body with its surface tension relative to one without{solver.stand_in_text}",
        )
    if isinstance(body, MeshFromFile):
        return UnknownEffect("not estimated: a mesh from a file cannot have a surface tension")
    if body.dim == 2:
        return UnknownEffect("not estimated: there is no theory of surface tension in plane strain")
    theory_variant = solver.layer_scene or solver.half_space_scene
    if theory_variant is None:
        return UnknownEffect("there is no theory of this tip and body")
    initial_tension = (
        FIRST_TENSION_FRACTION
        * solver.scene.physics.material.E_star
        * solver.scene.physics.scales.pressure
        * solver.delta
    )

    def tension_variant(gamma: float) -> Config:
        """The scene with a surface tension."""
        body = replace(
            theory_variant.body,  # type: ignore[union-attr]
            surface_tension=gamma,  # type: ignore[arg-type]
        )
        return replace_sections(theory_variant, body=body)

    return ThresholdSearch(
        "body.surface_tension",
        solver.ratio_over_parameter(theory_variant, tension_variant),
        initial_tension,
        f"theory{solver.stand_in_text}",
    )


def _friction(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Friction of the scene, relative to a frictionless contact."""
    friction = solver.friction_or_adhesion.get("friction")
    correction = solver.scene.plan.friction
    if not friction:
        return no_effect("the scene has no friction")
    if correction:
        change = correction.force - 1
        return FixedEffect(
            change,
            change,
            f"friction {friction} relative to none: exact solution of a half-space",
            change,
        )
    return VariantPair(
        *_friction_pair(solver, friction),
        f"friction {friction} relative to none, on one mesh{solver.stand_in_text}",
    )


def _friction_pair(solver: VariantSolver, friction: Friction) -> tuple[Config, Config]:
    """The scenes with and without friction, on one mesh."""
    return solver.meshed_variant(solver.linear_scene, friction=friction), solver.meshed_variant(
        solver.linear_scene
    )


def _stick(solver: VariantSolver, tolerance: float) -> EffectSource:
    """No slip, relative to a frictionless contact.

    If the scene has no friction, the range is that of all friction coefficients.
    """
    source = f"on one mesh{solver.stand_in_text}"
    if solver.friction_or_adhesion.get("friction"):
        return VariantPair(
            *_friction_pair(solver, "stick"), f"no slip relative to no friction, {source}"
        )
    changes = [
        solver.force_ratio(*_friction_pair(solver, friction)) - 1 for friction in SAMPLE_FRICTIONS
    ]
    half_range = (max(changes) - min(changes)) / 2 + RANGE_MARGIN
    change = changes[-1]
    planned_effect = solver.scene.plan.stick
    # The plan has the exact effect where theory knows it.
    if planned_effect is not None and planned_effect.percent is not None:
        change = planned_effect.percent / 100
        source = planned_effect.source
    text = (
        f"no slip: {source}; the range contains all friction coefficients from "
        f"{SAMPLE_FRICTIONS[0]:g} on"
    )
    return FixedEffect(
        min(change, *changes) - half_range, max(change, *changes) + half_range, text, change
    )


def _adhesion(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Adhesion of the contact law or of the experiment; without one, x is a work of adhesion."""
    attraction = solver.friction_or_adhesion.get("adhesion")
    if attraction:
        return VariantPair(
            solver.meshed_variant(solver.linear_scene, adhesion=attraction),
            solver.meshed_variant(solver.linear_scene),
            "the contact law with its attraction relative to one without, on one mesh"
            f"{solver.stand_in_text}",
        )
    experiment = solver.config.experiment
    if solver.config.body.surface_tension:
        return UnknownEffect("there is no theory of adhesion together with surface tension")
    if experiment and experiment.adhesion:
        adhesive_variant = history_variant(solver, "adhesion")
        adhesion_report = solver.history_result(adhesive_variant).report["adhesion"]
        pull_off = adhesion_report["pull_off"]["force_control"]["force"]
        details = f", pull-off at {pull_off / solver.scene_force:.2g} of the force without adhesion"
        if "tabor" in adhesion_report:
            details += f", Tabor number {adhesion_report['tabor']:.2g}"
        return VariantPair(
            adhesive_variant,
            history_variant(solver),
            f"the JKR limit{details}{solver.stand_in_text}",
        )
    if isinstance(solver.tip, FlatPunch | Plate) and not solver.is_spherical:
        return no_effect("the contact area of a flat punch does not change by adhesion")
    return _adhesion_work_search(solver, tolerance)


def _adhesion_work_search(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Work of adhesion from which on the force of the JKR limit differs."""
    contact = solver.theory.contact if solver.theory else None
    if solver.theory_scene is None or not isinstance(contact, Layer):
        return UnknownEffect("the JKR limit is known for circular contacts only")
    scales = solver.theory_scene.physics.scales
    punches = LayerPunches(contact)
    delta = solver.theory_scene.physics.deltas[-1]
    unit = scales.pressure * scales.length
    nonadhesive = contact.solutions_at_depths([delta])[0]

    def force_ratio(work: float) -> float:
        """Force with a work of adhesion, relative to that without, at the same depth."""
        jkr = Jkr(punches, work / unit)
        # The contact radius of the stable equilibrium is larger than that without adhesion.
        radius = increasing_root(
            lambda a: max(jkr.equilibrium_at(a).delta, MIN_DEPTH_FRACTION * delta),
            delta,
            nonadhesive.a * (1 + RADIUS_MARGIN),
            punches.max_radius,
        )
        return jkr.equilibrium_at(radius).force / nonadhesive.force

    return ThresholdSearch(
        "work",
        force_ratio,
        0.01 * tolerance * nonadhesive.force * unit / nonadhesive.a,
        f"the JKR limit{solver.stand_in_text}",
    )


def _rate(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Stress relaxation, relative to the instantaneous modulus."""
    law = next((material.relaxation for _, material in solver.config.materials()), None)
    if solver.config.body.surface_tension:
        return UnknownEffect("surface tension does not relax, so the force has no common factor")
    if law is None:
        needs = (
            f"above {100 * tolerance:g} % from a fraction of the modulus that relaxes before the "
            "deepest point"
        )
        return UnknownEffect(
            "Lee and Radok (1960): the force decreases by at most this fraction",
            f"{needs} = {tolerance:.2g}",
        )
    if history := solver.config.loading.prescribed_history:
        source = (
            "the history relative to that of an elastic body"
            f"{_deborah_text(history, law)}{solver.stand_in_text}"
        )
        return VariantPair(history_variant(solver, "relaxation"), history_variant(solver), source)
    if law.power_law is not None:
        return UnknownEffect("the modulus of a power law depends on time, which the scene lacks")
    return FixedEffect(
        remaining_modulus_fraction(law, None) - 1,
        0.0,
        "between the instantaneous and the long-term modulus",
    )


def _deborah_text(history: History, law: Relaxation) -> str:
    """Deborah number as text: mean relaxation time over the time to the deepest point."""
    points = history.points
    t = max(points, key=lambda point: (point[1], -point[0]))[0] - points[0][0]
    total_fraction = sum(fraction for fraction, _ in law.prony or ())
    if not (total_fraction and t > 0):
        return ""
    weighted_times = sum(fraction * tau for fraction, tau in law.prony or ())
    return f", Deborah number {weighted_times / total_fraction / t:.2g}"


def _cantilever(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Compliance of cantilever and frame, whose base displacement is taken as the depth."""
    experiment = solver.config.experiment
    if experiment is not None and experiment.compliance > 0:
        if solver.config.loading.force_history:
            return no_effect("the force is prescribed and does not depend on the cantilever")
        source = f"the displacement of the base taken as the depth{solver.stand_in_text}"
        return VariantPair(
            history_variant(solver, "cantilever", "frame"), history_variant(solver), source
        )
    stiffness = (
        (1 - tolerance)
        * solver.scene_force
        / (solver.delta - _depth_at_fraction(solver, 1 - tolerance))
    )
    needs = f"above {100 * tolerance:g} % from stiffness = {stiffness:.2g} or less"
    return UnknownEffect("the displacement of the base taken as the depth", needs)


def _contact_point(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Error of the depth at first contact."""
    offset = solver.delta - _depth_at_fraction(solver, 1 - tolerance)
    return UnknownEffect(
        "slope of the force over the depth",
        f"above {100 * tolerance:g} % from an error of the depth = {offset:.2g}",
    )


def _depth_at_fraction(solver: VariantSolver, force_fraction: float) -> float:
    """Depth at which the force is a fraction of that of the deepest row."""
    # Hertz: the force grows with the depth to the power 3/2.
    initial_depth = solver.delta * force_fraction ** (2 / 3)
    return increasing_root(
        lambda depth: solver.force_at_depth(depth) / solver.scene_force,
        force_fraction,
        initial_depth,
        1.01 * solver.delta,
    )


def _calibration(solver: VariantSolver, tolerance: float) -> EffectSource:
    """Uncertainty of the spring constant and of the radius of the tip."""
    calibration = solver.config.experiment.calibration if solver.config.experiment else None
    radius_exponent, source = _radius_exponent(solver)
    if calibration is None:
        needs = f"above {100 * tolerance:g} % from calibration.stiffness = {tolerance:.2g}"
        if radius_exponent:
            needs += f" or R = {tolerance / radius_exponent:.2g}"
        return UnknownEffect(source, needs)
    uncertainty = hypot(calibration.stiffness, radius_exponent * calibration.R)
    return FixedEffect(-uncertainty, uncertainty, source)


def _radius_exponent(solver: VariantSolver) -> tuple[float, str]:
    """Exponent d ln F/d ln R, 0 for a tip without radius, and a text on errors of calibration."""
    tip = solver.tip
    source = "a relative error of the spring constant is one of the force"
    if not isinstance(tip, Paraboloid | Sphere | Hyperboloid):
        return 0.0, source
    ratio = solver.force_ratio(
        solver.replace_tip(replace(tip, R=(1 + RADIUS_CHANGE) * tip.R)), solver.plain_scene
    )
    radius_exponent = log(ratio) / log(1 + RADIUS_CHANGE)
    return radius_exponent, f"{source}; force ~ R^{radius_exponent:.2g}"


BODY_ROWS = (
    _paraboloid,
    _thickness,
    _side_walls,
    _substrate,
    _layers,
    _inclusions,
    _anisotropy,
    _small_strain,
)
CONTACT_ROWS = (_incompressible, _blunt_tip, _surface_tension, _friction, _stick, _adhesion)
SOURCE_FUNCTIONS = (*BODY_ROWS, *CONTACT_ROWS, _rate, _cantilever, _contact_point, _calibration)
EFFECT_ROWS = tuple(
    EffectRow(find_source.__name__.removeprefix("_"), find_source)
    for find_source in SOURCE_FUNCTIONS
)
