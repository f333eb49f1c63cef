"""Model warnings: reasons to distrust a scene's model, contact law or mesh, before it is solved.

Each warning has the relative error of the force that it stands for, as far as that is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.sizes import DOUBTFUL_ELEMENTS, Sizes
from indent_sim.model import stability
from indent_sim.model.contact import ContactLaw, Nitsche, Penalty
from indent_sim.model.elastic_law import LOCKING_POISSON_RATIO
from indent_sim.model.tips import (
    STEM_HALF_ANGLE,
    FlatPunch,
    Hyperboloid,
    Paraboloid,
    Sphere,
    max_radius,
)
from indent_sim.scene.boundary_films import unresolved_film
from indent_sim.scene.characteristic_strain import characteristic_strain
from indent_sim.scene.diffusion_times import DiffusionTimes, draining_size
from indent_sim.scene.expected_error import (
    FORCE_DEPTH_EXPONENT,
    NEGLIGIBLE_ERROR,
    error_text,
    expected_force_error,
    penalty_force_loss,
    penalty_friction_loss,
    stick_force_change,
)
from indent_sim.scene.half_space_formulas import half_space_force
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ATTRACTION_CUTOFF, ProblemSetup
from indent_sim.scene.regions import unused_material_message
from indent_sim.theory.solution import SOLUTION_ERRORS

if TYPE_CHECKING:
    from indent_sim.config.schema import Config

# A shallow contact is worth a warning from this expected error of its force on: about that of two
# elements in the contact radius.
UNDERRESOLVED_ERROR = 0.02
# Largest penalty stiffness, in units of E*/h_contact; beyond it the contact pressures oscillate.
MAX_STIFFNESS_MULTIPLE = 1e3
# Characteristic strain up to which forces at small strain are good to some per cent: a/R = 0.25.
MAX_SMALL_STRAIN = 0.05
# Relative difference of the forces of several equilibria on one mesh, with active_set and a path of
# 1, 3 and 6 steps.
EQUILIBRIA_DIFFERENCE = 0.002
# Elements without an unknown pressure are too stiff for a drained gel with a larger Poisson ratio,
# by LOCKING_ERROR of the force at 0.4999.
DRAINED_LOCKING_NU = 0.495
LOCKING_ERROR = 0.01
# Rows earlier than this many ramp times of the bath get a warning: at this time a gel has risen by
# 2.6 % less than after a sudden change.
SUDDEN_BATH_RATIO = 10.0
# Elements in the radius of a contact that a tip seals, with which the unknown end of the sealed
# area costs 2 % of the force that relaxes.
MIN_SEALED_ELEMENTS = 10.0
# Coefficient of friction up to which the edge of the contact slips: ten steps along the path then
# change the force by 0.01 %, and no second solution is needed.
MAX_SLIPPING_FRICTION = 0.3
# Ratio of moduli up to which stacks of random layers were compared with theory: 1000, and a margin
# for rounding.
VERIFIED_CONTRAST = 1001.0
# Relative error of the force by the membrane that holds the surface of a drop in its plane, at
# most.
SURFACE_MEMBRANE_ERROR = 5e-4
# Elastocapillary length over contact radius beyond which p_max is off by more than its error
# estimate; it is off by 5 % at 200.
TENSION_PRESSURE_LIMIT = 30.0


@dataclass(frozen=True)
class ModelWarning:
    """A reason to distrust the force of a scene.

    Attributes
    ----------
    key : str
        Short name of the cause.
    message : str
        The warning; empty where the error is too small to mention.
    force_error : float
        Relative error of the last row's force that the warning stands for; 0 where it is unknown.
    """

    key: str
    message: str
    force_error: float = 0.0


NO_CONTACT = ModelWarning("no_contact", "the tip never reaches the body: every depth is <= 0")


def scene_warnings(
    setup: ProblemSetup, law: ContactLaw, gap: str, sizes: Sizes
) -> tuple[ModelWarning, ...]:
    """Warnings about the model, the contact law and the mesh of a scene at its deepest contact.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    law : ContactLaw
        The contact law, with its stiffnesses.
    gap : str
        The key `contact.gap`, "reference" or "current".
    sizes : Sizes
        The element sizes.

    Returns
    -------
    tuple of ModelWarning
        The warnings, some of which have an error and no message.
    """
    if setup.max_depth <= 0:
        return () if setup.attraction else (NO_CONTACT,)
    contact_warnings = (
        *_contact_law_warnings(setup, law, gap, sizes),
        *_friction_warnings(setup, law, sizes),
    )
    truncation_warnings = (
        [ModelWarning("truncation", "", setup.truncation.error)] if setup.truncation else []
    )
    return (
        *theory_warnings(setup, gap),
        *contact_warnings,
        *_mesh_warnings(setup, sizes),
        *_facet_warnings(setup, sizes),
        *truncation_warnings,
    )


def theory_warnings(setup: ProblemSetup, gap: str = "reference") -> tuple[ModelWarning, ...]:
    """Warnings about the model itself, whichever solver is used."""
    if setup.max_depth <= 0:
        return tuple(_attraction_warnings(setup)) if setup.attraction else (NO_CONTACT,)
    return (
        *_model_warnings(setup),
        *_tip_end_warnings(setup, gap),
        *_attraction_warnings(setup),
        *_adhesion_warnings(setup),
    )


def fluid_warnings(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Warnings about the drainage of the fluid and its resolution in space and time."""
    if not physics.permeable_regions or setup.history is None:
        return
    drainage = physics.drainage
    diffusion_times = DiffusionTimes.compute(setup, physics, draining_size(physics, sizes))
    if {drainage.surface, drainage.tip, drainage.base} == {"sealed"} and not physics.drained_walls:
        yield ModelWarning(
            "sealed", "every surface is sealed: no fluid leaves the body, it only flows inside"
        )
    elements = setup.a / sizes.h_contact
    if (
        drainage.surface == "drained"
        and drainage.tip == "sealed"
        and elements < 0.99 * MIN_SEALED_ELEMENTS
    ):
        problem = (
            f"the sealed contact has {elements:.2g} elements in its radius, and its edge is known "
            "to within one element"
        )
        remedy = (
            f"with {MIN_SEALED_ELEMENTS:g} elements the error is 2 % of the force that relaxes; "
            "use a smaller mesh.h_contact"
        )
        yield ModelWarning("sealing", f"{problem}: {remedy}")
    largest_nu = max(
        (
            region.material.constants.nu
            for region in physics.permeable_regions
            if region.formulation != "mixed"
        ),
        default=0.0,
    )
    if largest_nu > DRAINED_LOCKING_NU:
        problem = (
            f"the drained gel has nu = {largest_nu:g}: elements without an unknown network pressure"
        )
        yield ModelWarning("locking", f"{problem} are 1 % too stiff at 0.4999", LOCKING_ERROR)
    if setup.is_half_space and setup.history.duration > diffusion_times.wall:
        yield ModelWarning(
            "diffusion",
            "diffusion reaches the walls of the finite body that replaces the half-space",
        )
    start_time = setup.history.points[0][0]
    if (
        setup.max_depth > 0
        and not physics.is_swelling
        and (film := unresolved_film(setup, physics, sizes, NEGLIGIBLE_ERROR))
    ):
        element_text = (
            f"elements of {film.h * physics.scales.length:.2g} at the drained {film.face} are "
            "thicker than the layer that has drained by then"
        )
        force_text = f"the force is up to {error_text(film.max_error)} too low"
        message = (
            f"rows up to t = {physics.path.times[film.last_row]:.3g}: {element_text}, and "
            f"{force_text}"
        )
        yield ModelWarning(
            "early",
            f"{message}; {refinement_advice(sizes, 'give a smaller mesh.h_film')}",
            film.last_row_error,
        )
    if physics.creasing_message:
        yield ModelWarning(
            "creases",
            f"{physics.creasing_message}: some equilibria may not be found, and the others have a "
            "smooth surface",
        )
    if drainage.bath_ramp != "auto" and not physics.is_swelling:
        yield ModelWarning(
            "bath_ramp",
            "drainage.bath_ramp has no effect: the body starts in equilibrium with this bath",
        )
    ramp = physics.bath_ramp
    if early_times := [
        t - start_time for t in physics.path.times if 0 < t - start_time < SUDDEN_BATH_RATIO * ramp
    ]:
        deficit_text = " to ".join(
            dict.fromkeys(
                error_text(_swelling_deficit(ramp, t)) for t in (max(early_times), min(early_times))
            )
        )
        rows_text = (
            f"rows up to t = {start_time + max(early_times):.3g}: the bath changes over a time of "
            f"{ramp:.3g}"
        )
        yield ModelWarning(
            "bath",
            f"{rows_text}, and after a sudden change the gel would have risen more by then, by "
            f"{deficit_text}; use a smaller drainage.bath_ramp",
        )


def _swelling_deficit(ramp: float, t: float) -> float:
    """Return by how much less a gel has risen at time t than after a sudden change of its bath.

    The deficit is relative. The rise grows as t^(1/2) after a sudden change, and is
    2/3 (t^(3/2) - (t - ramp)^(3/2))/ramp if the bath changes linearly over the time `ramp`.
    """
    return 1.0 - 2.0 / 3.0 * (t**1.5 - max(t - ramp, 0.0) ** 1.5) / (ramp * t**0.5)


def material_warnings(config: Config, setup: ProblemSetup) -> tuple[ModelWarning, ...]:
    """A warning if the section `material` has no effect."""
    message = unused_material_message(config, setup.physics.domain)
    return (ModelWarning("material", message),) if message else ()


def pull_warnings(setup: ProblemSetup) -> tuple[ModelWarning, ...]:
    """A warning if the contact of the reference theory has tension, which no mesh allows."""
    if not (setup.theory and setup.theory.tension_fraction):
        return ()
    message = (
        f"{setup.theory.reason}; a contact without tension is smaller, and so is its force: only a "
        "finite-element solution tells by how much"
    )
    return (ModelWarning("pull", message, setup.theory.tension_fraction),)


def _model_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Warnings about kinematics, tip, material and body that do not suit the depth."""
    physics = setup.physics
    body = physics.body
    material = physics.material
    tip = physics.indenter
    delta = setup.max_depth
    a = setup.a
    strain, formula = characteristic_strain(setup.relative_tip, delta, a)
    if physics.is_compressed:
        strain = delta / body.height
        formula = "delta/height"
    if physics.small_strain and strain > MAX_SMALL_STRAIN:
        yield ModelWarning(
            "small_strain",
            f"strains near {formula} = {strain:.2g}: small strain is no longer a good model",
        )
    if isinstance(tip, Paraboloid) and delta > 0.1 * tip.R:
        message = (
            "the depth is more than R/10: the force of a sphere of this R would be at least 1 % "
            "lower than that of the paraboloid"
        )
        yield ModelWarning("paraboloid", message)
    # Compression of the whole height is already reported by its strain.
    if physics.small_strain and delta > 0.1 * body.height and not physics.is_compressed:
        depth_text = f"depth is {delta / body.height:.0%} of the thickness"
        yield ModelWarning("small_strain", f"{depth_text}: small strain is no longer a good model")
    if a > 0.8 * body.lateral_extent(physics.center) and not physics.is_compressed:
        yield ModelWarning("rim", "the contact comes close to the edge of the body")
    if (nu := physics.largest_locking_nu) >= LOCKING_POISSON_RATIO:
        yield ModelWarning(
            "locking",
            f"nu = {nu:g} with displacement elements: pressures oscillate, forces are too high",
        )
    for message in stability.instability_warnings(
        material, stability.largest_strain(setup.relative_tip, a, delta, body.height)
    ):
        yield ModelWarning("stability", message)
    solution = setup.solution(delta) if body.dim == 3 else None
    half_space_force_pair = half_space_force(setup.relative_tip, delta, material.E_star)
    if (
        solution
        and half_space_force_pair
        and abs(1 - half_space_force_pair[1] / solution.force) >= 0.01
    ):
        cause = "the body is not thick enough for a contact this large"
        if len(setup.layers) > 1:
            cause = "the body is layered"
        if physics.surface_tension:
            cause = "its surface is under tension"
        yield ModelWarning(
            "half_space",
            f"{half_space_force_pair[0]}, half-space, does not apply: {cause}",
        )


def _tip_end_warnings(setup: ProblemSetup, gap: str) -> Iterator[ModelWarning]:
    """A warning if the tip's profile ends inside the contact, with what the model makes of it."""
    tip = setup.physics.indenter
    delta = setup.max_depth
    end_radius = max_radius(setup.physics.indenter)
    if isinstance(tip, FlatPunch) or not (
        setup.a >= end_radius or (isinstance(tip, Sphere) and delta > end_radius)
    ):
        return
    message = "the depth exceeds the height of the tip's profile: the body may slip around its end"
    if gap == "reference":
        message = (
            "the contact reaches the end of the tip's profile, and ends there as under a flat punch"
        )
    elif isinstance(tip, Sphere):
        message = (
            "the depth exceeds the ball's radius: it is modelled as whole except for a stem within "
            f"{STEM_HALF_ANGLE:g} degrees of its top"
        )
    yield ModelWarning("tip_end", message)
    # Beyond 100 radii the tip is a needle, or a unit is wrong.
    if delta > 100.0 * end_radius:
        message = (
            f"the depth is {delta / end_radius:.3g} times the radius at which the tip ends: do "
            "both have the same unit?"
        )
        yield ModelWarning("units", message)


def _attraction_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """A warning if the attraction reaches beyond the edge of the body."""
    rim = setup.physics.body.lateral_extent(setup.physics.center)
    if (
        setup.attraction is None
        or not setup.attraction.range
        or rim >= max_radius(setup.relative_tip)
    ):
        return
    if (
        gap_ratio := float(setup.relative_tip.height(rim, 0.0)) / setup.attraction.range
    ) < ATTRACTION_CUTOFF:
        gap_text = (
            f"the body ends where its gap to the tip is {gap_ratio:.2g} ranges of the attraction"
        )
        yield ModelWarning(
            "adhesion_rim", f"adhesion: {gap_text}: the attraction beyond its edge is left out"
        )


def _adhesion_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """A warning if the range of the attraction is too long for the JKR limit.

    The measure is the pull-off force by Maugis-Dugdale on a half-space, which may differ from the
    JKR limit by 1 %.
    """
    limit = setup.jkr_limit
    if (
        limit is None
        or limit.range is None
        or not isinstance(setup.relative_tip, Paraboloid | Sphere | Hyperboloid)
    ):
        return
    from indent_sim.theory.maugis import (  # Loads scipy, which no other scene needs.
        maugis_lambda,
        maugis_pull_off,
        tabor_number,
    )

    parameters = limit.work, limit.range, setup.relative_tip.R, setup.physics.material.E_star
    pull_off_factor = maugis_pull_off(maugis_lambda(*parameters))
    if abs(pull_off_factor / -1.5 - 1) > 0.01:
        range_text = (
            f"at a Tabor number of {tabor_number(*parameters):.3g} the range of the attraction is "
            "not short"
        )
        pull_off_text = (
            f"on a half-space the pull-off force is {-pull_off_factor:.4g} pi work R "
            "(Maugis-Dugdale), and 1.5 pi work R in the JKR limit"
        )
        yield ModelWarning("adhesion", f"adhesion: {range_text}: {pull_off_text}")


def _contact_law_warnings(
    setup: ProblemSetup, law: ContactLaw, gap: str, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Warnings about the errors of the contact law and of a stiffness given in the config."""
    material = setup.physics.material
    theory = setup.theory
    # Nodal pressures on a deformed surface have several equilibria.
    if gap == "current" and law.multiplier == "nodal":
        several_text = (
            "several sets of contact nodes may be in equilibrium, the steps decide which is found"
        )
        message = (
            f"{law.method} with gap: current: {several_text}, and their forces differ by "
            f"{error_text(EQUILIBRIA_DIFFERENCE)}"
        )
        yield ModelWarning("several_equilibria", message, EQUILIBRIA_DIFFERENCE)
    # The rounding allows for a stiffness that the program chose to be just this large.
    max_stiffness = (1 + 1e-9) * MAX_STIFFNESS_MULTIPLE * material.E_star / sizes.h_contact
    if isinstance(law, Penalty | Nitsche) and law.stiffness > max_stiffness:
        yield ModelWarning(
            "stiffness", "a stiffness of more than 1000 E*/h_contact: the pressures oscillate"
        )
    if isinstance(law, Penalty):
        force_loss, last_row_loss = _deepest_and_last_error(
            setup, lambda delta, a: penalty_force_loss(law, material, theory, delta, a)
        )
        message = (
            "penalty: the tip penetrates the body, and the force is up to "
            f"{100 * force_loss:.2g} % too low at this epsilon_n"
        )
        yield ModelWarning(
            "penalty", message if force_loss >= NEGLIGIBLE_ERROR else "", last_row_loss
        )


def _friction_warnings(
    setup: ProblemSetup, law: ContactLaw, sizes: Sizes
) -> Iterator[ModelWarning]:
    """A warning about the effect of epsilon_t on what friction adds to the force.

    The friction force itself is unknown before the scene is solved; a share of it of 5 % is worth a
    warning.
    """
    if law.is_conservative:
        return
    assert law.epsilon_t != "auto"
    multiple = law.epsilon_t * sizes.h_contact / setup.physics.material.E_star
    elements = setup.a / sizes.h_contact
    if isinstance(law, Penalty):
        force_fraction = penalty_friction_loss(multiple * elements)
        loss_text = (
            f"about {force_fraction:.0%} of what friction adds to the force is lost at this "
            "epsilon_t"
        )
        message = f"penalty: a sticking surface slips by tau/epsilon_t: {loss_text}"
    else:
        force_fraction = (
            abs(stick_force_change(multiple, elements))
            if law.friction == "stick" or law.friction > MAX_SLIPPING_FRICTION
            else 0.0
        )
        change = (
            f"{force_fraction:.0%} {'more' if multiple > 1 else 'less'} to the force than with 1 "
            "E*/h_contact, the most accurate stiffness"
        )
        message = (
            f"epsilon_t is {multiple:.2g} E*/h_contact: on these elements friction adds about "
            f"{change}"
        )
    if force_fraction >= 0.05:
        yield ModelWarning("friction", message)


def _mesh_warnings(setup: ProblemSetup, sizes: Sizes) -> Iterator[ModelWarning]:
    """Warnings about coarse elements at the contact and at corners, and about p_max."""
    if (tension_ratio := setup.elastocapillary_length / setup.a) > TENSION_PRESSURE_LIMIT:
        step_text = f"gamma/E* is {tension_ratio:.2g} contact radii: the pressure ends with a step"
        yield ModelWarning(
            "p_max", f"{step_text}, where p_max of a mesh is up to 5 % too large; the force is not"
        )
    if setup.physics.is_drop:
        yield ModelWarning("drop", "", SURFACE_MEMBRANE_ERROR)
    moduli = [region.material.constants.E for region in setup.physics.domain.regions]
    if max(moduli) > VERIFIED_CONTRAST * min(moduli):
        message = (
            f"the largest modulus is {max(moduli) / min(moduli):.0e} times the smallest: the "
            "element sizes are verified up to 1000 times"
        )
        yield ModelWarning("contrast", f"{message}; set an accuracy, and compare")
    if sizes.corner_error >= NEGLIGIBLE_ERROR:
        bound_text = f"the force may be too high by up to {error_text(sizes.corner_error)}"
        remedy = "use smaller sizes everywhere, or leave them to the program"
        message = f"coarse elements at corners close to the contact: {bound_text}; {remedy}"
        yield ModelWarning("corners", message, sizes.corner_error)
    nu = setup.physics.largest_nu
    a = setup.a
    force_error, last_row_error = _deepest_and_last_error(
        setup, lambda delta, a: expected_force_error(sizes, a, nu)
    )
    shallowest = _expected_radius(
        setup, min((delta for delta in setup.physics.deltas if delta > 0), default=setup.max_depth)
    )
    message = ""
    if (
        sizes.punch_edge is not None
        and sizes.h_edge is not None
        and force_error >= NEGLIGIBLE_ERROR
    ):
        advice = refinement_advice(sizes, "give a smaller h_contact or h_edge")
        low_text = f"the force may be too low by {error_text(force_error)}; {advice}"
        message = (
            f"elements of {sizes.h_edge / sizes.punch_edge:.2g} radii at the punch's edge: "
            f"{low_text}"
        )
    elif not sizes.is_resolved(a):
        advice = refinement_advice(
            sizes, f"give h_contact at most {1 / DOUBTFUL_ELEMENTS:.2g} of the contact radius"
        )
        wrong_text = (
            f"the force may be wrong by {error_text(force_error)}, a by up to 5 %; {advice}"
        )
        message = (
            f"only {a / sizes.h_contact:.2g} elements in the expected contact radius: {wrong_text}"
        )
    elif (
        not sizes.is_resolved(shallowest)
        and (shallow_error := expected_force_error(sizes, shallowest, nu)) >= UNDERRESOLVED_ERROR
    ):
        element_text = f"only {shallowest / sizes.h_contact:.2g} of them are in the contact radius"
        wrong_text = f"the force there may be wrong by {error_text(shallow_error)}"
        message = (
            "the elements suit the deepest contact; at the shallowest "
            f"{element_text}, and {wrong_text}"
        )
    if message or last_row_error:
        yield ModelWarning("elements", message, last_row_error)


def refinement_advice(sizes: Sizes, advice: str) -> str:
    """Advice on smaller elements: `advice`, or refinement of a mesh that comes from a file."""
    return advice if sizes.refinements is None else "increase mesh.refinements"


def _facet_warnings(setup: ProblemSetup, sizes: Sizes) -> Iterator[ModelWarning]:
    """A warning about flat facets of an imported mesh that may approximate a curved surface.

    They lie inside that surface, so that the depth is too small.
    """
    physics = setup.physics
    if not isinstance(physics.domain, ImportedDomain):
        return
    sag = physics.domain.facet_sagitta(physics.center, setup.a, sizes.refinements or 0)
    if (error := FORCE_DEPTH_EXPONENT * sag / setup.max_depth) >= NEGLIGIBLE_ERROR:
        sag_text = (
            f"they lie up to {sag * physics.scales.length:.2g} inside it, {error_text(error)} "
            "of the force"
        )
        yield ModelWarning(
            "facets",
            f"flat facets under the tip: if they approximate a curved surface, {sag_text}",
        )


def _deepest_and_last_error(
    setup: ProblemSetup, error: Callable[[float, float], float]
) -> tuple[float, float]:
    """Return error(depth, contact radius) at the deepest contact and at the last row.

    It is 0 at the last row if there is no contact.
    """
    last_depth = setup.physics.deltas[-1]
    errors = {
        delta: error(delta, _expected_radius(setup, delta))
        for delta in {setup.max_depth, last_depth}
        if delta > 0
    }
    return errors[setup.max_depth], errors.get(last_depth, 0.0)


def _expected_radius(setup: ProblemSetup, delta: float) -> float:
    """Return the expected contact radius at a depth [length].

    For an adhesive tip it is that of the JKR limit, and infinite without a theory for it.
    """
    if setup.attraction is None:
        return setup.expected_radius(delta)
    with suppress(*SOLUTION_ERRORS):
        if setup.jkr and (contact := setup.jkr.stable_equilibrium(delta)):
            return max(contact.a, setup.expected_radius(delta))
    return inf
