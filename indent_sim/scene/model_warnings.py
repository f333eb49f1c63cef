"""Doubts of model, contact law and mesh: a warning and the relative error of the force that it
stands for.
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

UNDERRESOLVED_ERROR = 0.02  # of the force: a contact in less than two elements
MAX_STIFFNESS_MULTIPLE = 1e3  # E*/h of a penalty: beyond it the pressures oscillate
STIFFNESS_ROUNDING = 1e-9  # of a stiffness that was chosen to be just this large
# characteristic strain up to which forces of small strain are good to some per cent: a/R = 0.25
MAX_SMALL_STRAIN = 0.05
EQUILIBRIA_DIFFERENCE = (
    0.002  # of the force: between the equilibria of one mesh with active_set, over 1, 3 and 6 steps
)
MAX_DEPTH_RATIO = 100.0  # depth over the radius of a tip's end: a needle, or a mistake
# of the pull-off force: by so much Maugis' may differ where the JKR limit is said to be right
JKR_TOLERANCE = 0.01
# nu of a drained gel, and of the force what it costs without a pressure
DRAINED_LOCKING_NU = 0.495
LOCKING_ERROR = 0.01
SUDDEN_BATH_RATIO = (
    10.0  # times what it takes to come: then a gel has risen by 2.6 % less than after a sudden one
)
MIN_SEALED_ELEMENTS = 10.0  # in the contact, under a tip that seals
NEGLIGIBLE_FRICTION_LOSS = (
    0.05  # of what friction adds to the force: a smaller share is not worth a warning
)
# friction up to which the edge slips: steps of a tenth of the path need no second pass (0.01 %,
# measured)
MAX_SLIPPING_FRICTION = 0.3
VERIFIED_CONTRAST = 1001.0  # of moduli, up to which random stacks were held to theory


@dataclass(frozen=True)
class ModelWarning:
    """A reason not to trust the force, in words, and the relative error of the last row's force
    that it stands for.

    words: empty where the error is too small to be worth any. force_error: 0 where it is not known.
    """

    key: str
    message: str
    force_error: float = 0.0


SURFACE_MEMBRANE_ERROR = (
    5e-4  # of the force, what a membrane that holds the surface of a drop in its plane adds at most
)
TENSION_PRESSURE_LIMIT = (
    30.0  # contact radii, gamma/E* from which p_max is off by more than its bar, by 5 % at 200
)
NO_CONTACT = ModelWarning("no_contact", "the tip never reaches the body: every depth is <= 0")


def scene_warnings(
    setup: ProblemSetup, law: ContactLaw, gap: str, sizes: Sizes
) -> tuple[ModelWarning, ...]:
    """All that speaks against the model, the contact method and the mesh of a scene at its deepest
    contact.
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
    """All that speaks against the model, whatever solves it."""
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
    """All that speaks against how fluid leaves the body, and how that is resolved."""
    if not physics.permeable_regions or setup.history is None:
        return
    drainage = physics.drainage
    durations = DiffusionTimes.compute(setup, physics, draining_size(physics, sizes))
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
        problem = f"the tip seals {elements:.2g} elements, and where that ends is known to one"
        remedy = (
            f"from {MIN_SEALED_ELEMENTS:g} on that is 2 % of what relaxes; use a smaller "
            "mesh.h_contact"
        )
        yield ModelWarning("sealing", f"{problem}: {remedy}")
    stiffest = max(
        (
            region.material.constants.nu
            for region in physics.permeable_regions
            if region.formulation != "mixed"
        ),
        default=0.0,
    )
    if stiffest > DRAINED_LOCKING_NU:
        problem = (
            f"nu = {stiffest:g} of the drained gel: elements without a pressure of its network"
        )
        yield ModelWarning("locking", f"{problem} are 1 % too stiff at 0.4999", LOCKING_ERROR)
    if setup.is_half_space and setup.history.duration > durations.wall:
        yield ModelWarning(
            "diffusion", "fluid feels the walls of the finite body that stands for the half-space"
        )
    begin = setup.history.points[0][0]
    if (
        setup.max_depth > 0
        and not physics.is_swelling
        and (film := unresolved_film(setup, physics, sizes, NEGLIGIBLE_ERROR))
    ):
        element_text = (
            f"elements of {film.h * physics.scales.length:.2g} at the drained {film.face} are "
            "thicker than what"
        )
        force_text = f"the force is up to {error_text(film.max_error)} low"
        message = (
            f"rows up to t = {physics.path.times[film.last_row]:.3g}: {element_text} has "
            f"drained there by then, and {force_text}"
        )
        yield ModelWarning(
            "early",
            f"{message}; {refinement_advice(sizes, 'give a smaller mesh.h_film')}",
            film.last_row_error,
        )
    if physics.creasing_message:
        yield ModelWarning(
            "creases",
            f"{physics.creasing_message}: rows may be lost, and those that are found are of a "
            "smooth surface",
        )
    if drainage.bath_ramp != "auto" and not physics.is_swelling:
        yield ModelWarning(
            "bath_ramp",
            "drainage.bath_ramp has no effect: the bath is that in which the body is at rest",
        )
    ramp = physics.bath_ramp
    if early_times := [
        t - begin for t in physics.path.times if 0 < t - begin < SUDDEN_BATH_RATIO * ramp
    ]:
        deficit_text = " to ".join(
            dict.fromkeys(
                error_text(_swelling_deficit(ramp, t)) for t in (max(early_times), min(early_times))
            )
        )
        rows = f"rows up to t = {begin + max(early_times):.3g}: the bath comes within {ramp:.3g}"
        yield ModelWarning(
            "bath",
            f"{rows}, and of a sudden one the gel would have risen more there, by {deficit_text}; "
            "use a smaller drainage.bath_ramp",
        )


def _swelling_deficit(ramp: float, t: float) -> float:
    """How much less a gel has risen at t, relative, when its bath came evenly within `ramp`: the
    rise goes with the root of the time, 2/3 (t^3/2 - (t - ramp)^3/2)/ramp in place of t^1/2.
    """
    return 1.0 - 2.0 / 3.0 * (t**1.5 - max(t - ramp, 0.0) ** 1.5) / (ramp * t**0.5)


def material_warnings(config: Config, setup: ProblemSetup) -> tuple[ModelWarning, ...]:
    """That the section `material` is of no use."""
    message = unused_material_message(config, setup.physics.domain)
    return (ModelWarning("material", message),) if message else ()


def pull_warnings(setup: ProblemSetup) -> tuple[ModelWarning, ...]:
    """What theory's contact has that none has that is pushed alone."""
    if not (setup.theory and setup.theory.tension_fraction):
        return ()
    message = (
        f"{setup.theory.reason}; pushed alone, the body has a smaller one and feels less: "
        "only a mesh knows how much"
    )
    return (ModelWarning("pull", message, setup.theory.tension_fraction),)


def _model_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Where the scene needs more than was asked for."""
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
            "depth beyond R/10: a sphere of this R would feel at least 1 % less than the paraboloid"
        )
        yield ModelWarning("paraboloid", message)
    if (
        physics.small_strain and delta > 0.1 * body.height and not physics.is_compressed
    ):  # or it is said twice
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
        thickness_text = "for a contact this large the body is not thick enough"
        cause = "the body is layered" if len(setup.layers) > 1 else thickness_text
        cause = "its surface is under tension" if physics.surface_tension else cause
        yield ModelWarning(
            "half_space", f"{half_space_force_pair[0]}, half-space, does not apply: {cause}"
        )


def _tip_end_warnings(setup: ProblemSetup, gap: str) -> Iterator[ModelWarning]:
    """That a tip ends inside the contact, and what the model makes of it."""
    tip = setup.physics.indenter
    delta = setup.max_depth
    end_radius = max_radius(setup.physics.indenter)
    if isinstance(tip, FlatPunch) or not (
        setup.a >= end_radius or (isinstance(tip, Sphere) and delta > end_radius)
    ):
        return
    message = "deeper than the profile is high: the body may slip around its end"
    if gap == "reference":
        message = (
            "deeper than the tip has a shape: where it ends the contact ends like under a punch"
        )
    elif isinstance(tip, Sphere):
        message = (
            f"deeper than the ball's radius: it is whole but for a stem within {STEM_HALF_ANGLE:g} "
            "degrees of its top"
        )
    yield ModelWarning("tip_end", message)
    if delta > MAX_DEPTH_RATIO * end_radius:
        message = (
            f"the depth is {delta / end_radius:.3g} times the radius at which the tip ends: are "
            "both in one unit?"
        )
        yield ModelWarning("units", message)


def _attraction_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """That an attraction is felt where the body ends."""
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
        gap_text = f"the body ends where the tip's gap is {gap_ratio:.2g} ranges of the attraction"
        yield ModelWarning(
            "adhesion_rim", f"adhesion: {gap_text}: what a wider one would feel there is left out"
        )


def _adhesion_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Warn of a range of attraction too long for JKR, by Maugis-Dugdale on a half-space."""
    limit = setup.jkr_limit
    if (
        limit is None
        or limit.range is None
        or not isinstance(setup.relative_tip, Paraboloid | Sphere | Hyperboloid)
    ):
        return
    from indent_sim.theory.maugis import (  # with scipy's searches
        maugis_lambda,
        maugis_pull_off,
        tabor_number,
    )

    parameters = limit.work, limit.range, setup.relative_tip.R, setup.physics.material.E_star
    pull_off_factor = maugis_pull_off(maugis_lambda(*parameters))
    if abs(pull_off_factor / -1.5 - 1) > JKR_TOLERANCE:
        range_ = f"at a Tabor number of {tabor_number(*parameters):.3g} its range is not short"
        pull_off_text = (
            f"on a half-space it holds with {-pull_off_factor:.4g} pi work R (Maugis-Dugdale), in "
            "the JKR limit with 1.5"
        )
        yield ModelWarning("adhesion", f"adhesion: {range_}: {pull_off_text}")


def _contact_law_warnings(
    setup: ProblemSetup, law: ContactLaw, gap: str, sizes: Sizes
) -> Iterator[ModelWarning]:
    """What the contact method, and a stiffness given in the config, do to the answer."""
    material = setup.physics.material
    theory = setup.theory
    # nodal pressures on a deformed surface
    if gap == "current" and law.multiplier == "nodal":
        several_text = (
            "several sets of nodes may be in equilibrium, which one is found depends on the steps"
        )
        message = (
            f"{law.method} with gap: current: {several_text}, and their forces differ by "
            f"{error_text(EQUILIBRIA_DIFFERENCE)}"
        )
        yield ModelWarning("several_equilibria", message, EQUILIBRIA_DIFFERENCE)
    stiffest = (1 + STIFFNESS_ROUNDING) * MAX_STIFFNESS_MULTIPLE * material.E_star / sizes.h_contact
    if isinstance(law, Penalty | Nitsche) and law.stiffness > stiffest:
        yield ModelWarning(
            "stiffness", "a stiffness beyond 1000 E*/h_contact: the pressures oscillate"
        )
    if isinstance(law, Penalty):
        force_loss, last_row_loss = _deepest_and_last_error(
            setup, lambda delta, a: penalty_force_loss(law, material, theory, delta, a)
        )
        message = (
            f"penalty: the tip sinks into the body, the force is up to {100 * force_loss:.2g} % "
            "too low at this epsilon_n"
        )
        yield ModelWarning(
            "penalty", message if force_loss >= NEGLIGIBLE_ERROR else "", last_row_loss
        )


def _friction_warnings(
    setup: ProblemSetup, law: ContactLaw, sizes: Sizes
) -> Iterator[ModelWarning]:
    """What epsilon_t does to what friction adds to the force, which nothing knows before it is
    solved.
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
        message = f"penalty: the surface gives way by t/epsilon_t: {loss_text}"
    else:
        force_fraction = (
            abs(stick_force_change(multiple, elements))
            if law.friction == "stick" or law.friction > MAX_SLIPPING_FRICTION
            else 0.0
        )
        change = (
            f"{force_fraction:.0%} {'more' if multiple > 1 else 'less'} to the force than at 1, "
            "the most accurate"
        )
        message = (
            f"epsilon_t is {multiple:.2g} E*/h_contact: on these elements friction adds about "
            f"{change}"
        )
    if force_fraction >= NEGLIGIBLE_FRICTION_LOSS:
        yield ModelWarning("friction", message)


def _mesh_warnings(setup: ProblemSetup, sizes: Sizes) -> Iterator[ModelWarning]:
    """What coarse elements will do to the results."""
    if (tension_ratio := setup.elastocapillary_length / setup.a) > TENSION_PRESSURE_LIMIT:
        step = f"gamma/E* is {tension_ratio:.2g} contact radii: the pressure ends with a step"
        yield ModelWarning(
            "p_max", f"{step}, where p_max of a mesh is up to 5 % too large; the force is not"
        )
    if setup.physics.is_drop:
        yield ModelWarning("drop", "", SURFACE_MEMBRANE_ERROR)
    moduli = [region.material.constants.E for region in setup.physics.domain.regions]
    if max(moduli) > VERIFIED_CONTRAST * min(moduli):
        message = (
            f"moduli {max(moduli) / min(moduli):.0e} times apart: sizes are known to suit up "
            "to 1000 times"
        )
        yield ModelWarning("contrast", f"{message}; ask for an accuracy, and compare")
    if sizes.corner_error >= NEGLIGIBLE_ERROR:
        bound_text = f"the force may be too high by up to {error_text(sizes.corner_error)}"
        remedy = "use smaller sizes everywhere, or leave them to the program"
        message = f"coarse elements at corners that the contact feels: {bound_text}; {remedy}"
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


def refinement_advice(sizes: Sizes, smaller: str) -> str:
    """How to get smaller elements; those of a mesh from a file can only be halved."""
    return smaller if sizes.refinements is None else "refine it: mesh.refinements"


def _facet_warnings(setup: ProblemSetup, sizes: Sizes) -> Iterator[ModelWarning]:
    """That flat facets from a file stand for a curved surface, inside which they are: the tip is
    less deep.
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
            "facets", f"flat facets under the tip: if they stand for a curved surface {sag_text}"
        )


def _deepest_and_last_error(
    setup: ProblemSetup, error: Callable[[float, float], float]
) -> tuple[float, float]:
    """A relative error(depth, contact radius) at the deepest contact and at the last row, where
    there is contact.
    """
    last_depth = setup.physics.deltas[-1]
    errors = {
        delta: error(delta, _expected_radius(setup, delta))
        for delta in {setup.max_depth, last_depth}
        if delta > 0
    }
    return errors[setup.max_depth], errors.get(last_depth, 0.0)


def _expected_radius(setup: ProblemSetup, delta: float) -> float:
    """The contact radius [length] to expect at a depth: of a tip that adheres JKR's, infinite where
    nobody knows it.
    """
    if setup.attraction is None:
        return setup.expected_radius(delta)
    with suppress(*SOLUTION_ERRORS):
        if setup.jkr and (contact := setup.jkr.stable_equilibrium(delta)):
            return max(contact.a, setup.expected_radius(delta))
    return inf
