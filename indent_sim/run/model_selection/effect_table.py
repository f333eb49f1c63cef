"""Table of the effects that a model may neglect.

An entry has the name of an effect and its cases; see `effects`. Functions of a case take the
variants v of the scene (`SceneVariants`) and, in a search, the value x of the varied parameter.
`find_effect` evaluates an entry.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import asin, degrees, hypot, inf, isfinite
from typing import Any

from indent_sim.config.schema import Config, MeshSettings
from indent_sim.model.body import Cylinder
from indent_sim.model.contact import AugmentedLagrangian, Friction
from indent_sim.model.experiment import Calibration
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.layers import Layer
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.loading import Loading
from indent_sim.model.materials import YieldingLaw
from indent_sim.model.spherical_bodies import Ball, CurvedBody, Ellipsoid
from indent_sim.model.tilted_tip import largest_tilt, tilted
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
from indent_sim.run.measured_constants import EDGE_ROUNDING
from indent_sim.run.model_selection.effects import (
    Absent,
    Cases,
    Change,
    Comparison,
    Range,
    Threshold,
    Unknown,
)
from indent_sim.run.model_selection.scene_variants import SceneVariants
from indent_sim.run.model_selection.variants import (
    change_materials,
    half_space_variant,
    incompressible_law,
    isotropic_law,
    linear_law,
    remove_inclusion_contrast,
    replace_sections,
)
from indent_sim.run.model_selection.yield_effect import (
    significant_yield_stress,
    yield_needs,
    yield_source,
    yielding_scene_needs,
)
from indent_sim.scene.prescribed_history import remaining_modulus_fraction

# Friction coefficients that are tried if a scene has no friction.
SAMPLE_FRICTIONS: tuple[Friction, ...] = (0.1, 0.3, "stick")
# Poisson's ratio of the substrate that is assumed below a layer without one.
SUBSTRATE_NU = 0.3
# Poisson's ratio of the soft tip that is assumed in place of a rigid one.
TIP_NU = 0.45


def _layer_source(v: SceneVariants) -> str:
    """Describe which solutions are compared to find the difference of a layer from a half-space."""
    if not v.is_isotropic:
        return "a layer relative to a half-space"
    return f"theory of a layer relative to that of a half-space{v.stand_in_text}"


def _radius_at_depth(v: SceneVariants) -> float:
    """Return the radius of the tip's section at the largest depth [length]."""
    scales = v.scene.physics.scales
    return v.scene.physics.indenter.radius_at(v.delta / scales.depth) * scales.length


def _wall_variant(v: SceneVariants, x: float) -> Config:
    """Return the scene of the layer with a frictionless wall at the radius 1/x."""
    layer: Any = v.plain_scene.body
    cylinder = Cylinder(1 / x, layer.height, base=layer.base, sides="roller", layers=layer.layers)
    return replace_sections(v.plain_scene, body=cylinder)


def _largest_inverse_wall_radius(v: SceneVariants) -> float:
    """Return the largest inverse radius of a curved wall around the tip [1/length].

    It is infinite unless the tip is a flat punch, which must fit into the wall.
    """
    # Smallest radius of a wall around a flat punch, relative to that of the punch. At a ratio
    # of 1 the punch compresses the whole body, which is a different problem.
    min_wall_ratio = 1.01
    return 1 / (min_wall_ratio * v.tip.radius) if isinstance(v.tip, FlatPunch) else inf


def _strip_with_distant_walls(v: SceneVariants) -> Config:
    """Return the scene of the strip with frictionless walls far from the tip."""
    strip: Any = v.plain_scene.body
    sides = StripSides("roller", "roller")
    wide_strip = replace(strip, width=2 * strip.width + 20 * strip.height, sides=sides)
    return replace_sections(v.plain_scene, body=wide_strip, center=None)


def _side_wall_change(v: SceneVariants, sides: Any) -> float:
    """Return the relative change of the force due to the side walls `sides`.

    Roller walls are compared with a layer without walls by theory. Other walls are compared with
    roller walls on the same mesh.
    """
    supported, rollers = (v.replace_plain_body(sides=side) for side in (sides, "roller"))
    support_ratio = 1.0
    if sides != "roller":
        support_ratio = v.force_ratio(v.meshed_variant(supported), v.meshed_variant(rollers))
    assert v.layer_scene is not None
    return v.force_ratio(rollers, v.layer_scene) * support_ratio - 1


def _side_wall_range(v: SceneVariants) -> tuple[float, float, None]:
    """Return bounds of the change of the force due to the side walls of the body.

    The bounds are the changes due to simpler side walls.
    """
    changes = [_side_wall_change(v, sides) for sides in v.side_supports]
    return min(0.0, *changes), max(0.0, *changes), None


def _substrate_modulus(v: SceneVariants, x: float) -> float:
    """Return the modulus of a substrate: 1000 times that of the layer, divided by x."""
    material: Any = v.config.layers[0].material
    # The modulus of a substrate is varied downwards from this multiple of that of the layer.
    max_ratio = 1e3
    return float(max_ratio / x * material.canonical().constants.E)


def _substrate_variant(v: SceneVariants, x: float) -> Config:
    """Return the scene with its layer on a half-space of modulus `_substrate_modulus(v, x)`."""
    scene: Any = v.layer_scene
    film = Layer(scene.body.height, scene.layers[0].material)
    substrate = Layer(None, LinearElastic(E=_substrate_modulus(v, x), nu=SUBSTRATE_NU))
    return replace_sections(scene, body=HalfSpace(layers=(film, substrate)), material=None)


def _homogeneous_variant(v: SceneVariants) -> Config:
    """Return the linear scene with a homogeneous body of the material under the tip."""
    law: Any = v.touched_material
    if not isinstance(v.config.body, MeshFromFile):
        law = linear_law(v.config.layers[0].material)  # type: ignore[arg-type]
    return change_materials(v.plain_scene, lambda material: law)


def _inclusion_variant(v: SceneVariants) -> Config:
    """Return the linear scene with its inclusions.

    The scene is three-dimensional if the axisymmetric replacement of the body has no inclusions.
    """
    if v.linear_scene.body.inclusions:
        return v.contact_variant()
    return replace_sections(change_materials(v.single_step_scene, linear_law), mesh=v.config.mesh)


def _inclusion_source(v: SceneVariants) -> str:
    """Return the description of the comparison with a body without inclusions."""
    place = v.stand_in_text if v.linear_scene.body.inclusions else ", in three dimensions"
    return (
        "the body with its inclusions relative to the body without inclusions, on the same "
        f"mesh{place}"
    )


def _finite_strain_tip(v: SceneVariants) -> Indenter:
    """Return the tip; for a flat punch with a sharper edge, the edge radius is EDGE_ROUNDING R."""
    tip = v.tip
    if isinstance(tip, FlatPunch) and tip.edge_radius < EDGE_ROUNDING * tip.radius:
        return v.rounded_tip(EDGE_ROUNDING * tip.radius)
    return tip


def _strain_source(v: SceneVariants) -> str:
    """Return the description of the comparison of finite with small strain."""
    law = "neo-Hookean" if v.scene.physics.small_strain else "law of the scene"
    edge = f", the punch's edge rounded by {EDGE_ROUNDING:g} of its radius in both"
    return (
        f"finite strain ({law}, gap: current) relative to small strain (gap: reference), on one "
        f"mesh{edge if _finite_strain_tip(v) is not v.tip else ''}{v.stand_in_text}"
    )


def _strain_variant(v: SceneVariants, scene: Config, **contact: Any) -> Config:
    """Return a scene with the friction or adhesion of the contact, on the common mesh."""
    tip: Any = _finite_strain_tip(v)
    if tip.elastic_part:
        # Body and tip have laws of the same kind.
        pressed: Any = scene.indenter
        tip = replace(tip, material=pressed.material)
    scene = replace_sections(scene, indenter=tip)
    return v.meshed_variant(scene, **contact, **v.friction_or_adhesion)


def _has_rounding_theory(v: SceneVariants) -> bool:
    """True if theory solves the scene for any rounding of its tip."""
    is_unknown = isinstance(v.tip, Profile) or (v.is_spherical and isinstance(v.tip, FlatPunch))
    return not is_unknown and v.theory_variant is not None


def _largest_rounding(v: SceneVariants) -> float:
    """Return the largest rounding radius of the tip in the search for the threshold [length]."""
    return 0.999 * v.tip.radius if isinstance(v.tip, FlatPunch) else inf


def _tension_ratio(v: SceneVariants, tension: float) -> float:
    """Return the force with a surface tension, divided by the force without it."""
    scene: Any = v.layer_scene or v.half_space_scene
    body = replace(scene.body, surface_tension=tension)
    return v.theory_ratio(replace_sections(scene, body=body), scene)


def _soft_tip_ratio(v: SceneVariants, x: float) -> float:
    """Return the force under a tip of the modulus 1/x, divided by the force under a rigid tip.

    The tip has the Poisson's ratio TIP_NU.
    """
    scene: Any = v.layer_scene or v.half_space_scene
    law = LinearElastic(E=1 / x, nu=TIP_NU)
    soft_scene = replace_sections(scene, indenter=replace(scene.indenter, material=law))
    return v.planned_force(soft_scene) / v.planned_force(scene)


def _tilt_variant(v: SceneVariants, tilt: float) -> Config:
    """Return the linear scene of the given body and tip with a tilt, in a single step.

    The upright and the tilted tip are both solved without the symmetry that only the upright tip
    has.
    """
    direction = v.config.tilt_towards if tilt else 0.0
    scene = change_materials(v.single_step_scene, linear_law)
    scene = replace_sections(scene, indenter=v.config.indenter, tilt=tilt, tilt_towards=direction)
    if isinstance(v.config.body, MeshFromFile):
        return scene
    sizes = v.scene.sizes
    settings = MeshSettings(
        h_contact=sizes.h_contact * v.scene.physics.scales.length,
        symmetry="full" if v.is_plane_strain else "half",
    )
    return replace_sections(scene, mesh=settings)


def _punch_tilt_needs(v: SceneVariants) -> str:
    """Return text on the tilt of a punch that changes its force by the tolerance."""
    tip: Any = v.tip
    sine = v.tolerance * v.delta / tip.radius
    if sine >= 1:
        return ""
    return f"above {v.percent:g} % from indenter.tilt = {degrees(asin(sine)):.2g}"


def _upright_equivalent(v: SceneVariants, tilt: float) -> Indenter | None:
    """Return the upright tip with the sections of the tilted tip; None if no such tip exists."""
    tip: Any = tilted(v.tip, tilt, 0.0)
    return tip.equivalent_tip(v.config.body.dim)  # type: ignore[no-any-return]


def _has_tilt_estimate(v: SceneVariants) -> bool:
    """True if theory gives the force of the upright tip with the sections of a tilted tip."""
    return (
        not v.is_spherical
        and v.theory_variant is not None
        and _upright_equivalent(v, 0.1 * _largest_estimated_tilt(v)) is not None
    )


def _largest_estimated_tilt(v: SceneVariants) -> float:
    """Return the largest tilt of the tip in the search for the threshold [degrees]."""
    # At the limit the tip lies on its flank and the force is infinite.
    return 0.9 * min(largest_tilt(v.tip), 50.0)


def _tilt_ratio(v: SceneVariants, tilt: float) -> float:
    """Return F of the upright tip with the sections of a tilted tip, divided by F of the tip.

    Boundary elements on a half-space gave a force that is larger by 0.5, 2 and 6 % for a cone of 70
    degrees at 5, 10 and 15 degrees, and the same for a paraboloid.
    """
    scene: Any = v.theory_variant
    equivalent = _upright_equivalent(v, tilt)
    return v.theory_ratio(replace_sections(scene, indenter=equivalent), scene)


def _tilt_source(v: SceneVariants) -> str:
    """Return the description of the estimate, with its value at a usual tilt."""
    # An AFM cantilever is mounted at 10 to 12 degrees.
    usual = min(10.0, _largest_estimated_tilt(v))
    percent = 100 * (_tilt_ratio(v, usual) - 1)
    return (
        "estimate by the upright tip with the cross-sections of the tilted one: "
        f"{percent:+.2g} % at {usual:.3g} degrees{v.stand_in_text}"
    )


def _slide_variant(v: SceneVariants, **contact: Any) -> Config:
    """Return the linear scene with a slide along the first stretch of the scene's slide.

    The tip is pressed to the largest depth, which is held during the slide. The element sizes are
    those of the scene.
    """
    slide: Any = v.config.loading.slide
    # The force at the end of the slide does not depend on the number of increments before it.
    press_steps = 4
    loading = Loading(delta=v.delta, steps=press_steps, slide=replace(slide, to=slide.ends[:1]))
    scene = change_materials(v.single_step_scene, linear_law)
    size = v.scene.sizes.h_contact * v.scene.physics.scales.length
    return replace_sections(
        scene,
        indenter=v.config.indenter,
        tilt=v.config.tilt,
        tilt_towards=v.config.tilt_towards,
        loading=loading,
        mesh=MeshSettings(h_contact=size),
        contact=AugmentedLagrangian(**contact),
    )


def _largest_side_force(v: SceneVariants) -> str:
    """Return text on the largest side force that friction allows."""
    if isinstance(v.friction, str):
        return "the surface sticks, so that nothing but the slide limits the side force"
    return f"friction allows a side force of at most {v.friction:g} times the force"


def _slide_source(v: SceneVariants) -> str:
    """Return the description of the comparison of a slide with and without friction."""
    return (
        f"friction {v.friction} relative to no friction at the end of the first stretch of the "
        "slide, at the largest depth, on the same mesh at small strain; besides this change of "
        f"the force {_largest_side_force(v)}"
    )


def _first_tension(v: SceneVariants) -> float:
    """Return the surface tension at which the search for the threshold begins."""
    physics = v.scene.physics
    # The search for a significant surface tension begins at this fraction of E* delta.
    first_tension_fraction = 0.01
    return first_tension_fraction * physics.material.E_star * physics.scales.pressure * v.delta


def _no_slip_source(v: SceneVariants) -> str:
    """Describe the solution without slip, by the plan's text if theory gives the effect."""
    source = f"on one mesh{v.stand_in_text}"
    if v.known_no_slip:
        source = v.known_no_slip.source
    return (
        f"no slip: {source}; the range includes the effect of all friction coefficients from "
        f"{SAMPLE_FRICTIONS[0]:g} on"
    )


def _no_slip_range(v: SceneVariants) -> tuple[float, float, float]:
    """Return bounds of the change of the force due to any friction, and the change without slip."""
    changes = [
        v.force_ratio(v.contact_variant(friction=friction), v.contact_variant()) - 1
        for friction in SAMPLE_FRICTIONS
    ]
    # The reported range of force changes is the sampled one, widened on both sides by half of its
    # width and this relative change.
    range_margin = 1e-3
    half_range = (max(changes) - min(changes)) / 2 + range_margin
    known: Any = v.known_no_slip
    change = known.percent / 100 if known else changes[-1]
    return min(change, *changes) - half_range, max(change, *changes) + half_range, change


def _jkr_source(v: SceneVariants) -> str:
    """Return the description of the solution with the adhesion of the experiment."""
    report = v.solver.history(v.history_variant("adhesion")).report["adhesion"]
    pull_off = report["pull_off"]["force_control"]["force"]
    tabor = f", Tabor number {report['tabor']:.2g}" if "tabor" in report else ""
    return (
        f"the JKR limit, with a pull-off force of {pull_off / v.scene_force:.2g} times the force "
        "without adhesion"
        f"{tabor}{v.stand_in_text}"
    )


def _relaxation_source(v: SceneVariants) -> str:
    """Return the description of the relaxing history, with its Deborah number.

    The Deborah number is the mean relaxation time divided by the time to the largest depth.
    """
    points = v.config.loading.prescribed_history.points  # type: ignore[union-attr]
    terms = v.relaxation.prony or ()  # type: ignore[union-attr]
    t = max(points, key=lambda point: (point[1], -point[0]))[0] - points[0][0]
    total_fraction = sum(fraction for fraction, _ in terms)
    number = ""
    if total_fraction and t > 0:
        mean_time = sum(fraction * tau for fraction, tau in terms) / total_fraction
        number = f", Deborah number {mean_time / t:.2g}"
    return f"the force in the history relative to that of an elastic body{number}{v.stand_in_text}"


def _stiffness_needs(v: SceneVariants) -> str:
    """Return text on the cantilever stiffness whose effect on the force is the tolerance."""
    stiffness = (1 - v.tolerance) * v.scene_force / v.tolerated_depth_error
    return f"above {v.percent:g} % from stiffness = {stiffness:.2g} or less"


def _calibration(v: SceneVariants) -> Calibration | None:
    """Return the uncertainties of the instrument that the scene states."""
    return v.config.experiment.calibration if v.config.experiment else None


def _calibration_source(v: SceneVariants) -> str:
    """Return the description of the effect of uncertain spring constant and tip radius."""
    radius = f"; force ~ R^{v.radius_exponent:.2g}" if v.tip_radius is not None else ""
    return f"the force has the relative error of the spring constant{radius}"


def _calibration_needs(v: SceneVariants) -> str:
    """Return text on the calibration uncertainties that change the force by the tolerance."""
    radius = f" or R = {v.tolerance / v.radius_exponent:.2g}" if v.radius_exponent else ""
    return f"above {v.percent:g} % from calibration.stiffness = {v.tolerance:.2g}{radius}"


def _calibration_range(v: SceneVariants) -> tuple[float, float, None]:
    """Return the uncertainty of the force due to the stated uncertainties of the instrument."""
    calibration: Any = _calibration(v)
    uncertainty = hypot(calibration.stiffness, v.radius_exponent * calibration.R)
    return -uncertainty, uncertainty, None


EFFECTS: dict[str, Cases] = {
    "paraboloid": (
        Absent(
            "the tip is a {v.tip_name}, not a sphere or paraboloid",
            when=lambda v: v.tip_radius is None or isinstance(v.tip, Hyperboloid),
        ),
        Comparison(
            "a sphere relative to a paraboloid{v.stand_in_text}",
            lambda v: v.replace_tip(Sphere(v.tip_radius)),
            lambda v: v.replace_tip(Paraboloid(v.tip_radius)),
        ),
    ),
    "thickness": (
        Unknown(
            "in plane strain the depth of a half-space is indefinite: the thickness always matters",
            when=lambda v: v.is_plane_strain,
        ),
        Absent(
            "the last layer is a half-space",
            when=lambda v: v.is_half_space and v.config.body.layers,
        ),
        Threshold(
            "theory of a layer on a rigid base",
            "body.height",
            lambda v, x: v.theory_ratio(
                replace_sections(v.plain_scene, body=InfiniteLayer(1 / x)), v.plain_scene
            ),
            initial=lambda v: 0.05 / _radius_at_depth(v),
            displayed_value=lambda v, x: 1 / x,
            direction=" or less",
            when=lambda v: v.is_half_space,
        ),
        Change(
            "the body of the scene relative to a half-space{v.stand_in_text}",
            lambda v: v.scene_force / v.solver.force(v.half_space_scene) - 1,
            when=lambda v: v.layer_scene is None,
        ),
        Comparison(
            _layer_source, lambda v: v.layer_scene, lambda v: half_space_variant(v.layer_scene)
        ),
    ),
    "side_walls": (
        Absent("a half-space has no sides", when=lambda v: v.is_half_space),
        Threshold(
            "theory of a layer with the wall relative to that of a layer without it",
            "a frictionless wall at radius",
            lambda v, x: v.theory_ratio(_wall_variant(v, x), v.plain_scene),
            initial=lambda v: min(0.3 / v.config.body.height, _largest_inverse_wall_radius(v)),
            displayed_value=lambda v, x: 1 / x,
            direction=" or nearer",
            max_value=_largest_inverse_wall_radius,
            when=lambda v: isinstance(v.config.body, UnboundedBody),
        ),
        Comparison(
            "the strip relative to a strip with distant walls",
            lambda v: v.plain_scene,
            _strip_with_distant_walls,
            when=lambda v: isinstance(v.config.body, Strip),
        ),
        Absent(
            "included in the row of the thickness, which compares the whole body with a half-space",
            when=lambda v: v.layer_scene is None,
        ),
        Change(
            "the body with its sides relative to an infinitely wide layer{v.stand_in_text}",
            lambda v: _side_wall_change(v, v.side_supports[0]),
            when=lambda v: not v.has_cylinder_stand_in,
        ),
        Range(
            lambda v: (
                "range between an infinitely wide body and one with "
                f"{' or '.join(v.side_supports)} sides all around at the distance of the nearest "
                "side"
            ),
            _side_wall_range,
        ),
    ),
    "substrate": (
        Absent(
            "there is nothing below a half-space",
            when=lambda v: v.is_half_space and not v.config.body.layers,
        ),
        Absent(
            "the body rests on a rigid base; its materials are compared in the row of the layers",
            when=lambda v: v.layer_scene is None,
        ),
        Comparison(
            "theory of all layers relative to a half-space of the first layer{v.stand_in_text}",
            lambda v: v.layer_scene,
            lambda v: replace_sections(
                v.layer_scene, body=HalfSpace(), material=v.layer_scene.layers[0].material
            ),
            when=lambda v: len(v.layer_scene.layers) > 1,
        ),
        Unknown(
            "there is no theory of such a layer on a half-space",
            when=lambda v: not v.is_isotropic or v.config.body.base != "fixed",
        ),
        Threshold(
            f"theory of the layer on a half-space of nu = {SUBSTRATE_NU:g}",
            "a substrate of E",
            lambda v, x: v.theory_ratio(_substrate_variant(v, x), v.layer_scene),
            initial=lambda v: 1.0,
            displayed_value=_substrate_modulus,
            direction=" or less",
        ),
    ),
    "layers": (
        Absent(
            "the body is homogeneous",
            when=lambda v: len(v.config.layers) < 2 and not getattr(v.config.body, "regions", None),
        ),
        Comparison(
            "the body with its layers relative to a homogeneous body of the material under the "
            "tip{v.stand_in_text}",
            lambda v: v.plain_scene,
            _homogeneous_variant,
        ),
    ),
    "inclusions": (
        Absent("the body has no inclusions", when=lambda v: not v.config.body.inclusions),
        Comparison(
            _inclusion_source,
            _inclusion_variant,
            lambda v: remove_inclusion_contrast(_inclusion_variant(v)),
        ),
    ),
    "anisotropy": (
        Absent("the material is isotropic", when=lambda v: v.is_isotropic),
        Comparison(
            "relative to an isotropic material with the E and nu of the plane of isotropy"
            "{v.stand_in_text}",
            lambda v: v.linear_scene,
            lambda v: change_materials(v.linear_scene, isotropic_law),
        ),
    ),
    "small_strain": (
        Unknown("there is no anisotropic law of finite strain", when=lambda v: not v.is_isotropic),
        Comparison(
            _strain_source,
            lambda v: _strain_variant(v, v.hyperelastic_scene, gap="current"),
            lambda v: _strain_variant(v, v.linear_scene),
        ),
    ),
    "incompressible": (
        Unknown("the material is not isotropic", when=lambda v: not v.is_isotropic),
        Comparison(
            "nu = 0.5 relative to the given nu, at the same E{v.stand_in_text}",
            lambda v: change_materials(v.linear_scene, incompressible_law),
            lambda v: v.linear_scene,
            when=lambda v: any(material.constants.nu != 0.5 for material in v.materials),
        ),
        Unknown("there is no theory of this body", when=lambda v: v.theory_variant is None),
        Threshold(
            "theory{v.stand_in_text}",
            "nu",
            lambda v, x: v.theory_ratio(
                change_materials(v.theory_variant, partial(incompressible_law, nu_deficit=x)),
                v.theory_variant,
            ),
            initial=lambda v: 0.01,
            displayed_value=lambda v, x: 0.5 - x,
            direction=" or less",
            max_value=lambda v: 0.5,
            digits=4,
        ),
    ),
    "blunt_tip": (
        Absent(
            "a {v.tip_name} has neither a sharp apex nor an edge",
            when=lambda v: not v.rounding_key,
        ),
        Comparison(
            "the rounded tip relative to a sharp one{v.stand_in_text}",
            lambda v: v.plain_scene,
            lambda v: v.replace_tip(v.rounded_tip(0.0)),
            when=lambda v: getattr(v.tip, v.rounding_key) > 0,
        ),
        Unknown(
            "there is no theory of this tip and body", when=lambda v: not _has_rounding_theory(v)
        ),
        Threshold(
            "theory{v.stand_in_text}",
            "indenter.{v.rounding_key}",
            lambda v, x: v.theory_ratio(
                replace_sections(v.theory_variant, indenter=v.rounded_tip(x)),
                replace_sections(v.theory_variant, indenter=v.rounded_tip(0.0)),
            ),
            initial=lambda v: min(0.1 * v.delta, _largest_rounding(v) / 2),
            max_value=_largest_rounding,
        ),
    ),
    "bond_below": (
        Absent(
            "only a cap, a ball or an ellipsoid can rest on a flat without a bond",
            when=lambda v: not isinstance(v.config.body, CurvedBody),
        ),
        Absent(
            "the {v.config.body.shape} is compressed between two tips, not on a base",
            when=lambda v: (
                v.config.body.base == "roller" and isinstance(v.config.body, Ball | Ellipsoid)
            ),
        ),
        Comparison(
            "the body that rests on a flat relative to one whose base is bonded, each on its "
            "own mesh",
            lambda v: v.meshed_variant(v.plain_scene),
            lambda v: v.meshed_variant(v.replace_plain_body(base="fixed")),
            when=lambda v: v.config.body.base == "unbonded",
        ),
        Comparison(
            "the body on its support relative to one that rests on a flat without a bond",
            lambda v: v.meshed_variant(v.plain_scene),
            lambda v: v.meshed_variant(v.replace_plain_body(base="unbonded", surface_tension=0.0)),
        ),
    ),
    "soft_tip": (
        Absent("the {v.tip_name} is rigid", when=lambda v: not hasattr(v.tip, "material")),
        Comparison(
            "the soft tip relative to a rigid one, on the same mesh{v.stand_in_text}",
            lambda v: v.meshed_variant(v.linear_scene),
            lambda v: v.meshed_variant(v.with_rigid_tip(v.linear_scene)),
            when=lambda v: v.config.indenter.elastic_part,
        ),
        Unknown(
            "there is no theory of this tip and body",
            when=lambda v: (
                not isinstance(v.tip, Paraboloid | Sphere)
                or not (v.layer_scene or v.half_space_scene)
            ),
        ),
        Threshold(
            "theory, in which the soft tip is a flat layer of thickness R{v.stand_in_text}",
            "indenter.material.E",
            _soft_tip_ratio,
            initial=lambda v: 1e-3 / v.touched_material.E,
            displayed_value=lambda v, x: 1 / x,
            direction=" or less",
        ),
    ),
    "plasticity": (
        Absent(
            "only bodies with the law linear_elastic or hencky may yield",
            when=lambda v: not isinstance(v.scene.physics.material, YieldingLaw),
        ),
        Absent(
            "a body that is time-dependent or adhesive may not yield here",
            when=lambda v: v.relaxation or v.scene.physics.contact.may_snap_through,
        ),
        Unknown(
            yield_source,
            when=lambda v: isfinite(significant_yield_stress(v)),
            needs=yield_needs,
        ),
        Unknown(
            "no theory gives the stress below this tip in a layer that is not thick",
            when=lambda v: len(v.config.layers) > 1,
            needs=yielding_scene_needs,
        ),
        Unknown("no theory gives the stress of this tip and body", needs=yielding_scene_needs),
    ),
    "tilt": (
        Absent("a tilt does not change a sphere", when=lambda v: isinstance(v.tip, Sphere)),
        Comparison(
            "the tilted tip relative to the upright one, each on its own mesh with elements of one "
            "size under the tip, at small strain",
            lambda v: _tilt_variant(v, v.config.tilt),
            lambda v: _tilt_variant(v, 0.0),
            when=lambda v: v.config.tilt,
        ),
        Unknown(
            "not estimated: a tilted plate touches the edge of the body first",
            when=lambda v: isinstance(v.tip, Plate),
        ),
        Unknown(
            "the force of a punch in full contact is that at the depth of the middle of its face, "
            "which is smaller than that of its lowest point by radius * sin(tilt)",
            needs=_punch_tilt_needs,
            when=lambda v: isinstance(v.tip, FlatPunch) and not v.is_spherical,
        ),
        Unknown(
            "there is no estimate for this tip and body",
            when=lambda v: not _has_tilt_estimate(v),
        ),
        Threshold(
            _tilt_source,
            "indenter.tilt",
            _tilt_ratio,
            initial=lambda v: 0.1 * _largest_estimated_tilt(v),
            max_value=_largest_estimated_tilt,
        ),
    ),
    "lateral": (
        Comparison(
            _slide_source,
            lambda v: _slide_variant(v, friction=v.friction),
            lambda v: _slide_variant(v),
            when=lambda v: v.config.loading.slide and v.friction,
        ),
        Absent(
            "the tip slides without friction, so that only the pressure on its slope pushes it "
            "sideways",
            when=lambda v: v.config.loading.slide,
        ),
        Absent(
            lambda v: f"nothing moves the tip sideways; {_largest_side_force(v)}",
            when=lambda v: v.friction,
        ),
        Absent("nothing moves the tip sideways, and there is no friction"),
    ),
    "surface_tension": (
        Comparison(
            "the body with its surface tension relative to one without{v.stand_in_text}",
            lambda v: v.plain_scene,
            lambda v: v.replace_plain_body(surface_tension=0.0),
            when=lambda v: v.config.body.surface_tension,
        ),
        Unknown(
            "not estimated: a mesh from a file cannot have a surface tension",
            when=lambda v: isinstance(v.config.body, MeshFromFile),
        ),
        Unknown(
            "not estimated: there is no theory of surface tension in plane strain",
            when=lambda v: v.is_plane_strain,
        ),
        Unknown(
            "there is no theory of this tip and body",
            when=lambda v: not (v.layer_scene or v.half_space_scene),
        ),
        Threshold(
            "theory{v.stand_in_text}",
            "body.surface_tension",
            _tension_ratio,
            initial=_first_tension,
        ),
    ),
    "friction": (
        Absent("the scene has no friction", when=lambda v: not v.friction),
        Change(
            "friction {v.friction} relative to no friction: exact solution of a half-space",
            lambda v: v.scene.plan.friction.force - 1,
            when=lambda v: v.scene.plan.friction,
        ),
        Comparison(
            "friction {v.friction} relative to no friction, on the same mesh{v.stand_in_text}",
            lambda v: v.contact_variant(friction=v.friction),
            lambda v: v.contact_variant(),
        ),
    ),
    "stick": (
        Comparison(
            "no slip relative to no friction, on the same mesh{v.stand_in_text}",
            lambda v: v.contact_variant(friction="stick"),
            lambda v: v.contact_variant(),
            when=lambda v: v.friction,
        ),
        Range(_no_slip_source, _no_slip_range),
    ),
    "adhesion": (
        Comparison(
            "the contact law with attraction relative to the same law without it, on the same "
            "mesh{v.stand_in_text}",
            lambda v: v.contact_variant(adhesion=v.config.contact.adhesion),
            lambda v: v.contact_variant(),
            when=lambda v: v.friction_or_adhesion.get("adhesion"),
        ),
        Unknown(
            "there is no theory of adhesion together with surface tension",
            when=lambda v: v.config.body.surface_tension,
        ),
        Comparison(
            _jkr_source,
            lambda v: v.history_variant("adhesion"),
            lambda v: v.history_variant(),
            when=lambda v: v.config.experiment and v.config.experiment.adhesion,
        ),
        Absent(
            "the contact area of a flat punch does not change by adhesion",
            when=lambda v: isinstance(v.tip, FlatPunch | Plate) and not v.is_spherical,
        ),
        Unknown(
            "the JKR limit is known for circular contacts only",
            when=lambda v: v.jkr_limit is None,
        ),
        Threshold(
            "the JKR limit{v.stand_in_text}",
            "work",
            lambda v, x: v.jkr_limit.force_ratio(x),
            initial=lambda v: v.jkr_limit.work_of_force(0.01 * v.tolerance),
        ),
    ),
    "rate": (
        Unknown(
            "surface tension does not relax, so that the force does not relax like the modulus",
            when=lambda v: v.config.body.surface_tension,
        ),
        Unknown(
            "Lee and Radok (1960): the force decreases by at most this fraction",
            needs="above {v.percent:g} % from a fraction of the modulus that relaxes before the "
            "deepest point = {v.tolerance:.2g}",
            when=lambda v: v.relaxation is None,
        ),
        Comparison(
            _relaxation_source,
            lambda v: v.history_variant("relaxation"),
            lambda v: v.history_variant(),
            when=lambda v: v.config.loading.prescribed_history,
        ),
        Unknown(
            "the modulus of a power law depends on time, but the scene has no loading history",
            when=lambda v: v.relaxation.power_law,
        ),
        Range(
            "between the instantaneous and the long-term modulus",
            lambda v: (remaining_modulus_fraction(v.relaxation, None) - 1, 0.0, None),
        ),
    ),
    "cantilever": (
        Absent(
            "the force is prescribed and does not depend on the cantilever",
            when=lambda v: v.compliance > 0 and v.config.loading.force_history,
        ),
        Comparison(
            "error if the displacement of the cantilever's base is used as the "
            "depth{v.stand_in_text}",
            lambda v: v.history_variant("cantilever", "frame"),
            lambda v: v.history_variant(),
            when=lambda v: v.compliance > 0,
        ),
        Unknown(
            "error if the displacement of the cantilever's base is used as the depth",
            needs=_stiffness_needs,
        ),
    ),
    "contact_point": (
        Unknown(
            "from the slope dF/d(delta) of the load curve",
            needs="above {v.percent:g} % from an error of the depth = "
            "{v.tolerated_depth_error:.2g}",
        ),
    ),
    "calibration": (
        Unknown(_calibration_source, needs=_calibration_needs, when=lambda v: not _calibration(v)),
        Range(_calibration_source, _calibration_range),
    ),
}
