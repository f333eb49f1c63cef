"""The table of requirements: what a model may leave out, each row a scene with it and one without."""

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

SAMPLE_FRICTIONS: tuple[Friction, ...] = (
    0.1,
    0.3,
    "stick",
)  # that tell what may come of friction where a scene has none
# Of a punch's radius: as near as a wall is followed, for at the punch itself the body is
# compressed, another problem
MIN_WALL_RATIO = 1.01
RANGE_MARGIN = 1e-3  # of the force, by which a range is wider than half of itself to either side
RADIUS_CHANGE = 0.02  # relative change of R that says how the force grows with it
# Of a contact with adhesion, where its search begins; of the depth, instead of one below 0
FIRST_TENSION_FRACTION = (
    0.01  # of E* delta, where the search for a surface tension that matters begins
)
RADIUS_MARGIN = 1e-3
MIN_DEPTH_FRACTION = 1e-6
# Of a flat punch's radius: that of its edge where it is too sharp to solve at finite strain, whose
# effect hangs little on it: at nu = 0.3, delta/a = 0.1 it is 1.18 to 1.23 % for edges of 0.005 to
# 0.1, 1.6 % for a sharp one
EDGE_ROUNDING = 0.05
MAX_MODULUS_RATIO = (
    1e3  # times the modulus of a film, of the substrate from which on a softer one is followed
)
SUBSTRATE_NU = 0.3  # Poisson's ratio of that substrate


def _paraboloid(solver: VariantSolver, tolerance: float) -> EffectSource:
    tip = solver.config.indenter
    if not isinstance(tip, Paraboloid | Sphere):
        return no_effect(f"a {tip.shape.replace('_', ' ')} is no sphere")
    return VariantPair(
        solver.replace_tip(Sphere(tip.R)),
        solver.replace_tip(Paraboloid(tip.R)),
        f"a sphere over a paraboloid{solver.stand_in_text}",
    )


def _blunt_tip(solver: VariantSolver, tolerance: float) -> EffectSource:
    tip: Any = solver.tip
    key = "edge_radius" if isinstance(tip, FlatPunch) else "tip_radius"
    if not hasattr(tip, key):
        return no_effect(f"a {tip.shape} has neither apex nor edge")
    sharp = replace(tip, **{key: 0.0})
    if getattr(tip, key) > 0:
        return VariantPair(
            solver.plain_scene,
            solver.replace_tip(sharp),
            f"the rounded tip over the sharp one{solver.stand_in_text}",
        )
    if (
        isinstance(tip, Profile)
        or solver.theory_variant is None
        or (solver.is_spherical and isinstance(tip, FlatPunch))
    ):
        return UnknownEffect("no theory of this tip and body")
    sharp_variant = replace_sections(solver.theory_variant, indenter=sharp)
    ratio = solver.ratio_over_parameter(
        sharp_variant,
        lambda radius: replace_sections(sharp_variant, indenter=replace(tip, **{key: radius})),
    )
    end = 0.999 * tip.radius if isinstance(tip, FlatPunch) else inf
    return ThresholdSearch(
        f"indenter.{key}",
        ratio,
        min(0.1 * solver.delta, end / 2),
        f"theory{solver.stand_in_text}",
        max_value=end,
    )


def _thickness(solver: VariantSolver, tolerance: float) -> EffectSource:
    body = solver.config.body
    layer = solver.layer_scene
    if body.dim == 2:
        return UnknownEffect(
            "in plane strain a half-space has no depth: the thickness always decides"
        )
    if isinstance(body, HalfSpace):
        return _half_space_height(solver)
    if layer is None:
        assert solver.half_space_scene is not None
        change = solver.scene_force / solver.force(solver.half_space_scene) - 1
        return FixedEffect(
            change, change, f"the body as it is over a half-space{solver.stand_in_text}", change
        )
    source = f"theory of a layer over that of a half-space{solver.stand_in_text}"
    return VariantPair(
        layer,
        half_space_variant(layer),
        source if solver.is_isotropic else "a layer over a half-space",
    )


def _half_space_height(solver: VariantSolver) -> EffectSource:
    if solver.config.body.layers:
        return no_effect("the last layer is a half-space")
    scales = solver.scene.physics.scales
    a = solver.scene.physics.indenter.radius_at(solver.delta / scales.depth) * scales.length
    change = solver.ratio_over_parameter(
        solver.plain_scene,
        lambda x: replace_sections(solver.plain_scene, body=InfiniteLayer(1 / x)),
    )
    return ThresholdSearch(
        "body.height",
        change,
        0.05 / a,
        "theory of a layer on a rigid base",
        lambda x: 1 / x,
        " down",
    )


def _side_walls(solver: VariantSolver, tolerance: float) -> EffectSource:
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
            solver.plain_scene, wide_variant, "the strip over one with its walls far away"
        )
    if layer is None:
        return no_effect("in the row of the thickness, which takes the body as it is")
    changes = [_side_wall_change(solver, sides) for sides in solver.side_supports]
    if not solver.has_cylinder_stand_in:
        return FixedEffect(
            changes[0],
            changes[0],
            f"the body with its sides over a layer without{solver.stand_in_text}",
            changes[0],
        )
    source = (
        f"between none and {' or '.join(solver.side_supports)} sides all around at the distance of "
        "the nearest"
    )
    return FixedEffect(min(0.0, *changes), max(0.0, *changes), source)


def _side_wall_change(solver: VariantSolver, sides: Support) -> float:
    """Relative change of the force by sides: by theory for rollers, from which others differ on one
    mesh.
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
    layer: Any = solver.plain_scene.body
    cylinder = partial(
        Cylinder, height=layer.height, base=layer.base, sides="roller", layers=layer.layers
    )
    change = solver.ratio_over_parameter(
        solver.plain_scene, lambda x: replace_sections(solver.plain_scene, body=cylinder(1 / x))
    )
    key = "a frictionless wall at radius"
    tip = solver.tip
    nearest = MIN_WALL_RATIO * tip.radius if isinstance(tip, FlatPunch) else 0.0
    end = 1 / nearest if nearest else inf
    first = min(0.3 / layer.height, end)
    return ThresholdSearch(key, change, first, "theory of both", lambda x: 1 / x, " or nearer", end)


def _substrate(solver: VariantSolver, tolerance: float) -> EffectSource:
    body: Any = solver.config.body
    layer = solver.layer_scene
    if isinstance(body, HalfSpace) and not body.layers:
        return no_effect("there is nothing below a half-space")
    if layer is None:
        return no_effect(
            "this body stands on something rigid; what it is made of is in the row of the layers"
        )
    if len(layer.layers) > 1:
        first = layer.layers[0].material
        first_layer = replace_sections(layer, body=HalfSpace(), material=first)
        return VariantPair(
            layer,
            first_layer,
            f"theory of all layers over that of the first as a half-space{solver.stand_in_text}",
        )
    if not solver.is_isotropic or body.base != "fixed":
        return UnknownEffect("theory knows no half-space below such a layer")
    film = layer.layers[0].material
    (E, _) = solver.materials[0].constants

    def above(x: float) -> Config:
        layers = (
            BodyLayer(body.height, film),
            BodyLayer(None, LinearElastic(E=MAX_MODULUS_RATIO / x * E, nu=SUBSTRATE_NU)),
        )
        return replace_sections(layer, body=HalfSpace(layers=layers), material=None)

    source = f"theory of a film on a half-space of nu = {SUBSTRATE_NU:g}"
    return ThresholdSearch(
        "a substrate of E",
        solver.ratio_over_parameter(layer, above),
        1.0,
        source,
        lambda x: MAX_MODULUS_RATIO / x * E,
        " down",
    )


def _layers(solver: VariantSolver, tolerance: float) -> EffectSource:
    if len(solver.config.layers) < 2 and not getattr(solver.config.body, "regions", None):
        return no_effect("the body is of one piece")
    is_meshed = isinstance(solver.config.body, MeshFromFile)
    touched: Any = solver.touched_material if is_meshed else None
    if not is_meshed:
        touched = variants.linear_law(solver.config.layers[0].material)  # type: ignore[arg-type]
    homogeneous = change_materials(solver.plain_scene, lambda material: touched)
    return VariantPair(
        solver.plain_scene,
        homogeneous,
        f"the body with its layers over one of what the tip touches{solver.stand_in_text}",
    )


def _inclusions(solver: VariantSolver, tolerance: float) -> EffectSource:
    if not solver.config.body.inclusions:
        return no_effect("the body has none")
    if solver.linear_scene.body.inclusions:
        variant = solver.meshed_variant(solver.linear_scene)
        stand_in = solver.stand_in_text
    else:
        variant = replace_sections(
            change_materials(solver.single_step_scene, variants.linear_law), mesh=solver.config.mesh
        )
        stand_in = ", in three dimensions"
    source = f"the body with its inclusions over one without, on one mesh{stand_in}"
    return VariantPair(variant, variants.remove_inclusion_contrast(variant), source)


def _anisotropy(solver: VariantSolver, tolerance: float) -> EffectSource:
    if solver.is_isotropic:
        return no_effect("the material is isotropic")
    source = (
        f"over an isotropic material with its E and nu, those across the axis{solver.stand_in_text}"
    )
    return VariantPair(
        solver.linear_scene, change_materials(solver.linear_scene, variants.isotropic_law), source
    )


def _small_strain(solver: VariantSolver, tolerance: float) -> EffectSource:
    if not solver.is_isotropic:
        return UnknownEffect("no law of finite strain is anisotropic")
    tip, edge_text = _round_punch_edge(solver.tip)
    law = "its own law" if not solver.scene.physics.small_strain else "neo-Hookean"
    small, finite = (
        replace_sections(variant, indenter=tip)
        for variant in (solver.linear_scene, solver.hyperelastic_scene)
    )
    source = f"{law}, gap: current, over small strain, gap: reference, on one mesh{edge_text}{solver.stand_in_text}"
    finite_variant = solver.meshed_variant(finite, gap="current", **solver.friction_or_adhesion)
    return VariantPair(
        finite_variant, solver.meshed_variant(small, **solver.friction_or_adhesion), source
    )


def _round_punch_edge(tip: Indenter) -> tuple[Indenter, str]:
    """A tip with the edge of a sharp flat punch rounded, as finite strain needs it, and that in
    words.
    """
    if not isinstance(tip, FlatPunch) or tip.edge_radius >= EDGE_ROUNDING * tip.radius:
        return tip, ""
    text = f", the punch's edge rounded by {EDGE_ROUNDING:g} of its radius in both"
    return replace(tip, edge_radius=EDGE_ROUNDING * tip.radius), text


def _incompressible(solver: VariantSolver, tolerance: float) -> EffectSource:
    if not solver.is_isotropic:
        return UnknownEffect("the material is not isotropic")
    if any(material.constants.nu != 0.5 for material in solver.materials):
        incompressible_variant = change_materials(solver.linear_scene, variants.incompressible_law)
        return VariantPair(
            incompressible_variant,
            solver.linear_scene,
            f"nu = 0.5 at the same E{solver.stand_in_text}",
        )
    theory_variant = solver.theory_variant
    if theory_variant is None:
        return UnknownEffect("no theory of this body")
    change = solver.ratio_over_parameter(
        theory_variant,
        lambda x: change_materials(theory_variant, partial(variants.incompressible_law, less=x)),
    )
    return ThresholdSearch(
        "nu",
        change,
        0.01,
        f"theory{solver.stand_in_text}",
        lambda x: 0.5 - x,
        " down",
        max_value=0.5,
        digits=4,
    )


def _surface_tension(solver: VariantSolver, tolerance: float) -> EffectSource:
    body: Any = solver.config.body
    if isinstance(body, MeshFromFile) or body.dim == 2:
        return no_effect(
            "a mesh from a file has none"
            if body.dim == 3
            else "there is no theory of it in plane strain"
        )
    if body.surface_tension:
        variant = replace_sections(
            solver.plain_scene,
            body=replace(solver.plain_scene.body, surface_tension=0.0),  # type: ignore[arg-type]
        )
        return VariantPair(
            solver.plain_scene,
            variant,
            f"the body with its surface tension over one without{solver.stand_in_text}",
        )
    theory_variant = solver.layer_scene or solver.half_space_scene
    if theory_variant is None:
        return UnknownEffect("no theory of this tip and body")
    start = (
        FIRST_TENSION_FRACTION
        * solver.scene.physics.material.E_star
        * solver.scene.physics.scales.pressure
        * solver.delta
    )

    def tensed(gamma: float) -> Config:
        body = replace(
            theory_variant.body,  # type: ignore[union-attr]
            surface_tension=gamma,  # type: ignore[arg-type]
        )
        return replace_sections(theory_variant, body=body)

    return ThresholdSearch(
        "body.surface_tension",
        solver.ratio_over_parameter(theory_variant, tensed),
        start,
        f"theory{solver.stand_in_text}",
    )


def _friction(solver: VariantSolver, tolerance: float) -> EffectSource:
    friction = solver.friction_or_adhesion.get("friction")
    correction = solver.scene.plan.friction
    if not friction:
        return no_effect("the scene has none")
    if correction:
        change = correction.force - 1
        return FixedEffect(
            change, change, f"friction {friction} over none: half-space, exact", change
        )
    return VariantPair(
        *_friction_pair(solver, friction),
        f"friction {friction} over none, on one mesh{solver.stand_in_text}",
    )


def _friction_pair(solver: VariantSolver, friction: Friction) -> tuple[Config, Config]:
    return solver.meshed_variant(solver.linear_scene, friction=friction), solver.meshed_variant(
        solver.linear_scene
    )


def _stick(solver: VariantSolver, tolerance: float) -> EffectSource:
    """No slip, and where the scene has no friction what may come of any."""
    source = f"on one mesh{solver.stand_in_text}"
    if solver.friction_or_adhesion.get("friction"):
        return VariantPair(*_friction_pair(solver, "stick"), f"no slip over no friction, {source}")
    changes = [
        solver.force_ratio(*_friction_pair(solver, friction)) - 1 for friction in SAMPLE_FRICTIONS
    ]
    half_range = (max(changes) - min(changes)) / 2 + RANGE_MARGIN
    change = changes[-1]
    planned_effect = solver.scene.plan.stick
    if planned_effect is not None and planned_effect.percent is not None:  # exact
        change = planned_effect.percent / 100
        source = planned_effect.source
    text = f"no slip: {source}; the range holds friction from {SAMPLE_FRICTIONS[0]:g} on"
    return FixedEffect(
        min(change, *changes) - half_range, max(change, *changes) + half_range, text, change
    )


def _adhesion(solver: VariantSolver, tolerance: float) -> EffectSource:
    attraction = solver.friction_or_adhesion.get("adhesion")
    if attraction:
        details = f"the contact law with its range over the one without, on one mesh{solver.stand_in_text}"
        return VariantPair(
            solver.meshed_variant(solver.linear_scene, adhesion=attraction),
            solver.meshed_variant(solver.linear_scene),
            details,
        )
    experiment = solver.config.experiment
    if solver.config.body.surface_tension:
        return UnknownEffect("not known together with a surface tension")
    if experiment and experiment.adhesion:
        adhesive_variant = history_variant(solver, "adhesion")
        adhesion_report = solver.history_result(adhesive_variant).report["adhesion"]
        details = f", pull-off {adhesion_report['pull_off']['force_control']['force'] / solver.scene_force:.2g} of this force"
        details += (
            f", Tabor number {adhesion_report['tabor']:.2g}" if "tabor" in adhesion_report else ""
        )
        return VariantPair(
            adhesive_variant,
            history_variant(solver),
            f"the JKR limit{details}{solver.stand_in_text}",
        )
    if isinstance(solver.tip, FlatPunch | Plate) and not solver.is_spherical:
        return no_effect("a flat punch touches the same disc with adhesion as without")
    return _adhesion_work_search(solver, tolerance)


def _adhesion_work_search(solver: VariantSolver, tolerance: float) -> EffectSource:
    contact = solver.theory.contact if solver.theory else None
    if solver.theory_scene is None or not isinstance(contact, Layer):
        return UnknownEffect("the JKR limit is that of a disc")
    scales = solver.theory_scene.physics.scales
    punches = LayerPunches(contact)
    delta = solver.theory_scene.physics.deltas[-1]
    unit = scales.pressure * scales.length
    contact_without = contact.solutions_at_depths([delta])[0]

    def pulled(work: float) -> float:
        jkr = Jkr(punches, work / unit)  # the stable contact is the one wider than without adhesion
        begin = contact_without.a * (1 + RADIUS_MARGIN)
        wider = increasing_root(
            lambda a: max(jkr.equilibrium_at(a).delta, MIN_DEPTH_FRACTION * delta),
            delta,
            begin,
            punches.max_radius,
        )
        return jkr.equilibrium_at(wider).force / contact_without.force

    return ThresholdSearch(
        "work",
        pulled,
        0.01 * tolerance * contact_without.force * unit / contact_without.a,
        f"the JKR limit{solver.stand_in_text}",
    )


def _rate(solver: VariantSolver, tolerance: float) -> EffectSource:
    law = next((material.relaxation for _, material in solver.config.materials()), None)
    if solver.config.body.surface_tension:
        return UnknownEffect("a surface tension does not relax")
    if law is None:
        needs = (
            f"above {100 * tolerance:g} % from a fraction of the modulus that relaxes before the "
            "deepest point"
        )
        return UnknownEffect(
            "Lee & Radok: the force falls by that fraction at most", f"{needs} = {tolerance:.2g}"
        )
    if history := solver.config.loading.prescribed_history:
        source = f"the history over that of an elastic body{_deborah_text(history, law)}{solver.stand_in_text}"
        return VariantPair(history_variant(solver, "relaxation"), history_variant(solver), source)
    if law.power_law is not None:
        return UnknownEffect("a power law has no modulus without a time")
    return FixedEffect(
        remaining_modulus_fraction(law, None) - 1,
        0.0,
        "between the instantaneous and the last modulus",
    )


def _deborah_text(history: History, law: Relaxation) -> str:
    """The relaxation's mean time over that of the way in, in words."""
    points = history.points
    t = max(points, key=lambda point: (point[1], -point[0]))[0] - points[0][0]
    total = sum(fraction for fraction, _ in law.prony or ())
    return (
        f", Deborah number {sum(f * tau for f, tau in law.prony or ()) / total / t:.2g}"
        if total and t > 0
        else ""
    )


def _cantilever(solver: VariantSolver, tolerance: float) -> EffectSource:
    experiment = solver.config.experiment
    if experiment is not None and experiment.compliance > 0:
        if solver.config.loading.force_history:
            return no_effect("the force is prescribed, whatever holds the tip")
        source = f"the way of the base taken for the depth{solver.stand_in_text}"
        return VariantPair(
            history_variant(solver, "cantilever", "frame"), history_variant(solver), source
        )
    stiffness = (
        (1 - tolerance)
        * solver.scene_force
        / (solver.delta - _depth_at_fraction(solver, 1 - tolerance))
    )
    needs = f"above {100 * tolerance:g} % from stiffness = {stiffness:.2g} down"
    return UnknownEffect("the way of the base taken for the depth", needs)


def _contact_point(solver: VariantSolver, tolerance: float) -> EffectSource:
    offset = solver.delta - _depth_at_fraction(solver, 1 - tolerance)
    return UnknownEffect(
        "the curve's own slope",
        f"above {100 * tolerance:g} % from an error of the depth = {offset:.2g}",
    )


def _depth_at_fraction(solver: VariantSolver, force_fraction: float) -> float:
    """The depth at which the force is a share of the deepest one."""
    start = solver.delta * force_fraction ** (2 / 3)
    return increasing_root(
        lambda d: solver.force_at_depth(d) / solver.scene_force,
        force_fraction,
        start,
        1.01 * solver.delta,
    )


def _calibration(solver: VariantSolver, tolerance: float) -> EffectSource:
    calibration = solver.config.experiment.calibration if solver.config.experiment else None
    radius_exponent, source = _radius_exponent(solver)
    if calibration is None:
        R = f" or R = {tolerance / radius_exponent:.2g}" if radius_exponent else ""
        return UnknownEffect(
            source, f"above {100 * tolerance:g} % from calibration.stiffness = {tolerance:.2g}{R}"
        )
    uncertainty = hypot(calibration.stiffness, radius_exponent * calibration.R)
    return FixedEffect(-uncertainty, uncertainty, source)


def _radius_exponent(solver: VariantSolver) -> tuple[float, str]:
    """d ln F/d ln R of a tip that has one, and what the force owes to an uncertain instrument."""
    tip = solver.tip
    source = "an error of the spring is one of the force"
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
EFFECT_ROWS = tuple(EffectRow(said.__name__.removeprefix("_"), said) for said in SOURCE_FUNCTIONS)
