"""Checks of contact, tip and experiment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from indent_sim.config.key_types import field_names
from indent_sim.config.scene_sections import SceneSections
from indent_sim.model.body import Cylinder
from indent_sim.model.contact import AugmentedLagrangian, AutoContact
from indent_sim.model.experiment import Experiment, JKRAdhesion
from indent_sim.model.gel import Gel
from indent_sim.model.spherical_bodies import Ball, Cap, CurvedBody, Ellipsoid
from indent_sim.model.tilted_tip import largest_tilt
from indent_sim.model.tips import (
    FlatPunch,
    Paraboloid,
    Plate,
    Profile,
    RegularPyramid,
    Sphere,
)
from indent_sim.model.unbounded_bodies import HalfSpace, InfiniteLayer, UnboundedBody
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import ConfigError

# Bodies on whose axis a soft tip can be placed.
AXISYMMETRIC_BODIES = (Cylinder, HalfSpace, InfiniteLayer, Cap, Ball, Ellipsoid)


def contact_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the contact: `epsilon_t` without friction, and invalid adhesion."""
    adhesion = config.contact.adhesion
    if config.contact.epsilon_t != "auto" and config.contact.is_conservative:
        yield ConfigError(
            "contact.epsilon_t",
            "applies only with friction, but the scene has none",
            "leave it out, or give contact.friction",
        )
    if adhesion and not config.contact.is_conservative:
        yield ConfigError(
            "contact.adhesion",
            "is not verified together with friction",
            "leave contact.adhesion or contact.friction out",
        )
    if adhesion and adhesion.range == 0:
        problem = "is 0, a limit that no mesh can resolve"
        remedy = "give a range above 0, or experiment.adhesion: {work: ...} for that limit"
        yield ConfigError("contact.adhesion.range", problem, remedy)


def center_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the position of the tip's axis."""
    center = config.center
    needed = len(config.body.center)
    if isinstance(config.body, UnboundedBody | CurvedBody) and any(center or ()):
        if isinstance(config.body, CurvedBody):
            reason = f"the tip is on the axis of a {config.body.shape}"
        else:
            reason = f"all positions on a {config.body.shape} are equivalent"
        yield ConfigError("indenter.center", reason, "leave it out")
    elif center is not None and len(center) != needed:
        form = "[x]" if needed == 1 else "[x, y]"
        problem = f"the position on a {config.body.shape} must be {form}, got {len(center)} numbers"
        yield ConfigError("indenter.center", problem, f"give {form}")


def tip_errors(config: SceneSections) -> list[ConfigError]:
    """Return errors in the tip and in its combination with the body."""
    tip = config.indenter
    if getattr(config.body, "kinematics", "") == "axisymmetric" and not tip.is_axisymmetric:
        return [
            ConfigError(
                "indenter.shape",
                f"a {tip.shape} is not a tip of revolution",
                "use body.kinematics: 3d",
            )
        ]
    if config.body.dim == 2 and not tip.is_axisymmetric:
        return [
            ConfigError(
                "indenter.shape",
                f"a {tip.shape} on a strip, which is in plane strain, is not possible",
                "use a box, a cylinder or a half_space",
            )
        ]
    if isinstance(config.body, CurvedBody) and not tip.is_axisymmetric:
        problem = f"a {tip.shape} on a {config.body.shape}, which is axisymmetric, is not possible"
        return [
            ConfigError(
                "indenter.shape", problem, "use a tip of revolution, e.g. an equivalent cone"
            )
        ]
    if isinstance(tip, Plate) and isinstance(config.body, UnboundedBody):
        problem = f"a plate on a {config.body.shape} touches all of an unbounded surface"
        return [
            ConfigError(
                "indenter.shape", problem, "use a cylinder, a strip or a box, or another tip"
            )
        ]
    if (
        isinstance(tip, Plate)
        and config.contact.adhesion
        and isinstance(config.body, Cylinder | Strip | Box)
    ):
        problem = "is not verified for a plate that touches all of a flat top"
        return [ConfigError("contact.adhesion", problem, "leave it out")]
    if isinstance(tip, FlatPunch) and tip.edge_radius > tip.radius:
        problem = "must not be larger than the punch's radius"
        return [
            ConfigError(
                "indenter.edge_radius", problem, f"use at most {tip.radius:g}, a hemispherical end"
            )
        ]
    try:
        if isinstance(tip, Profile):
            tip.check_points()
    except ValueError as error:
        return [ConfigError("indenter.points", str(error))]
    return []


def tilt_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the tilt of the tip, and in its combination with the body."""
    tip = config.indenter
    key = "indenter.tilt"
    if not config.tilt:
        if config.tilt_towards:
            problem = "is the direction of a tilt, but the tip is upright"
            yield ConfigError(
                "indenter.tilt_towards", problem, "give indenter.tilt, or leave it out"
            )
        return
    if getattr(tip, "material", None) is not None:
        problem = "the model of a soft tip has an upright axis, with its holder level"
        yield ConfigError(key, problem, "leave indenter.tilt or indenter.material out")
    if isinstance(tip, Sphere):
        # A tilt does not change a sphere.
        return
    if isinstance(tip, Plate):
        problem = "a tilted plate touches the edge of the body first, which is not modelled"
        yield ConfigError(key, problem, "use a flat_punch that is narrower than the body")
        return
    if config.tilt >= (limit := largest_tilt(tip)):
        part = "an edge" if isinstance(tip, RegularPyramid) else "its flank"
        problem = f"at a tilt of {limit:.4g} degrees this {tip.shape} lies on {part}"
        yield ConfigError(key, problem, f"use less than {limit:.4g}")
    if isinstance(config.body, CurvedBody) or (
        getattr(config.body, "kinematics", "") == "axisymmetric"
    ):
        problem = f"a tilted {tip.shape} on a {config.body.shape}, which is axisymmetric"
        remedy = "use a box, a cylinder, a layer or a half_space, or a sphere without a tilt"
        yield ConfigError(key, f"{problem}, is not possible", remedy)
    if config.body.dim == 2 and config.tilt_towards not in (0.0, 180.0):
        problem = "in plane strain the tip leans along x"
        yield ConfigError("indenter.tilt_towards", problem, "use 0 or 180")
    if config.contact.adhesion:
        problem = "is not verified together with indenter.tilt"
        yield ConfigError("contact.adhesion", problem, "leave one of the two out")


def soft_tip_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in material and thickness of a soft tip, and in parts incompatible with it."""
    tip = config.indenter
    if not isinstance(tip, Paraboloid | Sphere | FlatPunch | Plate):
        return
    if tip.material is None:
        if tip.thickness is not None:
            problem = "is the thickness of a soft tip, but this tip is rigid"
            yield ConfigError(
                "indenter.thickness", problem, "give indenter.material, or leave it out"
            )
        if isinstance(tip, Plate) and tip.radius is not None:
            problem = "is the radius of a soft plate, but this plate is rigid and has no end"
            remedy = "give indenter.material, use shape: flat_punch, or leave it out"
            yield ConfigError("indenter.radius", problem, remedy)
        return
    try:
        tip.material.canonical()
    except (ArithmeticError, ValueError) as error:
        yield ConfigError("indenter.material", str(error))
        return
    if isinstance(tip, FlatPunch | Plate):
        yield from _soft_cylinder_errors(config, tip)
    elif (tip.thickness or 0.0) > tip.R:
        problem = f"must not exceed the radius R = {tip.R:g}: the tip is a cap of a ball"
        yield ConfigError("indenter.thickness", problem, f"use at most {tip.R:g}, half a ball")
    key = "indenter.material"
    for slot, words in (("relaxation", "relax"), ("flow", "drain"), ("plasticity", "yield")):
        if getattr(tip.material, slot) is not None:
            problem = f"a soft tip does not {words}: its material is elastic"
            yield ConfigError(f"{key}.{slot}", problem, "leave it out")
    if not isinstance(config.body, AXISYMMETRIC_BODIES):
        problem = (
            f"a soft tip on a {config.body.shape} is not modelled, only axisymmetric bodies are"
        )
        yield ConfigError(key, problem, "use a cylinder, a layer, a half_space, a cap or a ball")
    yield from _soft_tip_conflicts(config, key)
    if tip.material.is_small_strain:
        yield from _linear_tip_conflicts(config, key)
    else:
        yield from _finite_strain_tip_conflicts(config, key)


def _soft_cylinder_errors(config: SceneSections, tip: FlatPunch | Plate) -> Iterator[ConfigError]:
    """Yield errors in the sizes of a soft flat punch or a soft plate."""
    missing = [name for name in ("thickness", "radius") if getattr(tip, name) is None]
    for name in missing:
        problem = "missing: a soft plate is a cylinder of this radius"
        if name == "thickness":
            problem = f"missing: a soft {tip.shape} is a cylinder between its face and its holder"
        yield ConfigError(f"indenter.{name}", problem, "give a number > 0")
    if isinstance(tip, FlatPunch) and tip.edge_radius:
        problem = "is not modelled for a soft punch, whose edge is sharp"
        yield ConfigError("indenter.edge_radius", problem, "leave it out")
    body = config.body
    if missing or not isinstance(body, Cylinder) or isinstance(tip, FlatPunch):
        return
    if (tip.radius or 0.0) < body.radius * (1 - 1e-9):
        problem = f"a plate of radius {tip.radius:g} does not cover a top of radius {body.radius:g}"
        yield ConfigError("indenter.radius", problem, "use shape: flat_punch, or a wider plate")


def _soft_tip_conflicts(config: SceneSections, key: str) -> Iterator[ConfigError]:
    """Yield errors of parts of the scene that are not modelled together with a soft tip."""
    contact = config.contact
    reasons = (
        (
            any(material.is_time_dependent for _, material in config.materials()),
            "needs a body whose response does not depend on time",
            "leave material.flow and relaxation of shear out",
        ),
        (
            config.yields,
            "needs a body that does not yield",
            "leave material.plasticity out",
        ),
        (
            not contact.is_conservative,
            "is modelled without friction",
            "leave contact.friction out",
        ),
        (
            contact.adhesion is not None,
            "is not modelled with an attraction over a range",
            "give experiment.adhesion, the limit of a short range",
        ),
        (
            bool(getattr(config.body, "surface_tension", 0.0)),
            "is not modelled with surface tension",
            "leave body.surface_tension out",
        ),
        (
            bool(config.instrument.calibration and config.instrument.calibration.R),
            "changes its compliance with R, which experiment.calibration.R neglects",
            "leave experiment.calibration.R out",
        ),
    )
    yield from _errors_of(key, "a soft tip", reasons)


def _linear_tip_conflicts(config: SceneSections, key: str) -> Iterator[ConfigError]:
    """Yield errors of parts of the scene that do not fit a soft tip at small strain."""
    reasons = (
        (
            any(not material.is_small_strain for _, material in config.materials()),
            "needs a linear elastic body",
            "give the body a linear elastic material, or the tip a hyperelastic one",
        ),
        (
            config.contact.gap == "current",
            "needs the gap at the undeformed point",
            "use contact.gap: reference",
        ),
        (
            config.solver.method in ("newton", "theory"),
            "must be auto: a soft tip is solved by static condensation of tip and body",
            "use solver.method: auto",
        ),
    )
    yield from _errors_of(key, "a linear elastic tip", reasons)


def _finite_strain_tip_conflicts(config: SceneSections, key: str) -> Iterator[ConfigError]:
    """Yield errors of parts of the scene that do not fit a soft tip at finite strain."""
    materials = [material for _, material in config.materials()]
    contact = config.contact
    reasons = (
        (
            any(material.is_small_strain for material in materials),
            "needs a hyperelastic body",
            "give all of the body hyperelastic materials, or the tip a linear elastic one",
        ),
        (
            any(isinstance(material, Gel) for material in materials),
            "is not modelled on a gel, which swells",
            "give the body a hyperelastic material",
        ),
        (
            any(material.relaxation for material in materials),
            (
                "does not relax, so that the force of body and tip together does not relax like "
                "the modulus of the body"
            ),
            "leave material.relaxation out",
        ),
        (
            not isinstance(config.indenter, Sphere | Paraboloid),
            "is a sphere or a paraboloid: the edge of a soft punch or plate is not modelled",
            "use shape: sphere or paraboloid, or linear elastic materials",
        ),
        (
            isinstance(config.body, Ball | Ellipsoid),
            f"is not modelled on a {config.body.shape} between two tips",
            "use a cap, or linear elastic materials",
        ),
        (
            contact.gap == "reference",
            "needs the gap at the deformed point",
            "use contact.gap: current, or auto",
        ),
        (
            not isinstance(contact, AutoContact | AugmentedLagrangian),
            "is modelled by the augmented Lagrangian method only",
            "use contact.method: augmented_lagrangian, or auto",
        ),
        (
            config.solver.method in ("condensed", "theory"),
            "is solved on the whole mesh of both bodies",
            "use solver.method: newton, or auto",
        ),
        (
            config.output.nodal_stress,
            "cannot be combined with stresses at the nodes",
            "leave output.nodal_stress out",
        ),
    )
    yield from _errors_of(key, "a soft tip at finite strain", reasons)


def _errors_of(
    key: str, subject: str, reasons: Iterable[tuple[bool, str, str]]
) -> Iterator[ConfigError]:
    """Yield an error for each reason that applies, with its problem and remedy."""
    for applies, problem, remedy in reasons:
        if applies:
            yield ConfigError(key, f"{subject} {problem}", remedy)


def experiment_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the section `experiment` that are found without solving the scene."""
    experiment = config.experiment
    if experiment is None:
        return
    if experiment.adhesion:
        yield from _jkr_errors(config, experiment.adhesion)
    if experiment.calibration and experiment.calibration.stiffness and not experiment.cantilever:
        problem = "is the uncertainty of a cantilever's stiffness, but there is no cantilever"
        yield ConfigError(
            "experiment.calibration.stiffness",
            problem,
            "give experiment.cantilever, or leave it out",
        )
    if experiment.calibration and experiment.calibration.R and not hasattr(config.indenter, "R"):
        problem = f"is the uncertainty of a tip's radius R, but a {config.indenter.shape} has none"
        yield ConfigError("experiment.calibration.R", problem, "leave it out")
    if not any(vars(experiment).values()):
        yield ConfigError(
            "experiment", "is empty", f"its keys are {', '.join(field_names(Experiment))}"
        )


def _jkr_errors(config: SceneSections, adhesion: JKRAdhesion) -> Iterator[ConfigError]:
    """Yield errors if the JKR limit does not apply.

    The limit needs a circular contact whose radius varies with the depth, for the Griffith energy
    balance at the edge of the contact.
    """
    body = config.body
    tip = config.indenter
    key = "experiment.adhesion"
    if any(material.relaxation for _, material in config.materials()):
        problem = (
            "cannot be combined with relaxation: the energy balance at the edge of contact needs "
            "an elastic body"
        )
        yield ConfigError(key, problem, "give one of the two")
    problem = "the JKR limit holds for a circular contact, which a {} does not have"
    if isinstance(body, Strip | Box):
        remedy = "use a cylinder, a layer, a half_space, a cap or a ball"
        yield ConfigError(key, problem.format(body.shape), remedy)
    if not config.tip.is_axisymmetric:
        yield ConfigError(key, problem.format(config.tip.shape), "use an upright tip of revolution")
    if isinstance(tip, Plate) and not isinstance(body, CurvedBody):
        problem = "the contact of a plate on a flat top does not shrink, but separates all at once"
        yield ConfigError(key, problem, "use another tip")
    if isinstance(tip, FlatPunch) and not tip.edge_radius and not isinstance(body, CurvedBody):
        problem = "the contact of a sharp flat punch does not shrink, but separates all at once"
        yield ConfigError(key, problem, "give the punch an edge_radius")
    if adhesion.base_work is not None:
        yield from _base_work_errors(config, adhesion)
    if adhesion.range and not hasattr(tip, "R"):
        problem = (
            f"is used only for the Tabor number of a tip with a radius R, but a {tip.shape} has "
            "none"
        )
        yield ConfigError(f"{key}.range", problem, "leave it out")


def _base_work_errors(config: SceneSections, adhesion: JKRAdhesion) -> Iterator[ConfigError]:
    """Yield errors of the work of adhesion between a body and the flat below it."""
    body = config.body
    base = getattr(body, "base", None)
    if base != "unbonded":
        what = f"a {body.shape} with base {base}" if base else f"a {body.shape}, which has no base"
        problem = "is the adhesion of a body to the flat on which it rests, but the body is"
        yield ConfigError(
            "experiment.adhesion.base_work",
            f"{problem} {what}",
            "leave it out, or use a ball or an ellipsoid with body.base: unbonded",
        )
    elif adhesion.range is not None:
        yield ConfigError(
            "experiment.adhesion.range",
            "gives the Tabor number of one contact, but this body has two",
            "leave it out",
        )
