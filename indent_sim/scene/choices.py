"""Choices of a scene: model, gap, contact law, tip, solver and mesh, each with its reason."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, fields, replace
from math import inf, pi
from typing import TYPE_CHECKING, Any

from indent_sim.config.strict_yaml import key_text
from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.model_domain import Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import MeshFromFile, UnboundedBody
from indent_sim.model.contact import (
    Adhesion,
    AugmentedLagrangian,
    AutoContact,
    Contact,
    ContactLaw,
    Penalty,
    SlipReference,
)
from indent_sim.model.experiment import Experiment
from indent_sim.model.materials import LOCKING_POISSON_RATIO
from indent_sim.model.tips import FlatPunch, Indenter, Plate, max_radius
from indent_sim.model.units import round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene.cost import DENSE_BYTES, MAX_CANDIDATES, Cost
from indent_sim.scene.model_warnings import (
    MAX_SLIPPING_FRICTION,
    MAX_STIFFNESS_MULTIPLE,
    NEGLIGIBLE_ERROR,
    penalty_force_loss,
)
from indent_sim.scene.predictions import (
    STICK_FRICTION,
    ExpectedAdhesion,
    infinite_pressure_reason,
    tensile_rim_width,
)
from indent_sim.scene.problem_setup import (
    DiffusionTimes,
    ProblemDefinition,
    ProblemSetup,
    first_step,
)
from indent_sim.scene.reference_theory import (
    NO_INCLUSIONS,
    first_reason,
    layer_theory,
    theory_tip_shape,
)
from indent_sim.scene.resolution import MeshResolution, target_error
from indent_sim.theory.solution import SOLUTION_ERRORS
from indent_sim.theory.theory import MAX_KEPT_SOLUTIONS

if TYPE_CHECKING:
    from indent_sim.config.schema import Config

FORCE_WHY = (
    "forces are given: each depth is found from the curve force(depth), which has "
    "one depth for a force"
)
THEORY_FORCE_WHY = "forces are given: theory finds the depth of each"
SIDEWAYS_TEXT = "pushes sideways, and nothing holds this body there (roller base, free sides)"
EDGE_WHY = "the pressure is singular at the punch's sharp edge"
AXIS_WHY = "sizes grow from this at the axis to h_contact where the deepest contact ends"
FILM_WHY = (
    "at drained faces the fluid's pressure changes within a film as thin as (D "
    "t)^(1/2) at the first rows"
)
CORNER_WHY = (
    "the contact feels bonded corners or the gap up to a side: sizes grow from this "
    "with the distance"
)
GAP_WHY = {
    "reference": "linear elastic: Hertz' own problem, tested at the undeformed point",
    "current": "finite strain: tested at the deformed point, pressure along the tip's normal",
}
WHOLE_BODY_WHY = "solver.linear: iterative is for the whole body"
MIN_SECONDS_SAVED = (
    2.0  # of a factorisation, which never fails, that iterations must save to be chosen
)
# of a factorisation's seconds, below which iterations are chosen: a prediction is no better
MAX_TIME_RATIO = 0.8
STEP_START_STICK_WHY = "new contact sticks where its step began"
MIDSTEP_STICK_WHY = (
    "new contact sticks where it touches on its way through the step, found in a "
    "pass without friction for it"
)
MAX_NEEDLE_RATIO = (
    1e3  # depth over a tip's radius beyond which a deformed body cannot be followed around it
)
MAX_ELEMENT_RATIO = (
    1.5  # elements over the cohesive zone: coarser ones jump from node to node, measured
)
# of the largest pull without range: up to this difference a body pulls as a half-space does
PULL_OFF_DIFFERENCE = 0.05
# Beyond these a system takes so many iterations that some are not solved: 7 at nu 0.45 without a
# pressure, 25 at 0.495, 56 at 0.499, too many at 0.4999; 7 in a contact of 3e5 E*/h_contact, 10 and
# more steps of Newton's in one of 9e5
MAX_ITERATIVE_NU = 0.495
MAX_ITERATIVE_STIFFNESS = 3e5
# Measured on a half and a quarter of a rubber cylinder: no equilibrium within 23 iterations,
# however short the step; linear bodies take twice the iterations of free walls (83 instead of 45)
STIFF_WALL_WHY = (
    "a curved roller wall that is held weakly, at finite strain, has steps that "
    "iterations do not find"
)
JKR_WHY = "the JKR limit: exact for this body where the attraction's range is short"
TING_WHY = (
    "Lee & Radok while the contact grows, Ting while it shrinks: exact for one body "
    "or layers that relax alike"
)
STEP_WHY = (
    "contact stepped in time on the compliance, to 1e-4: the history is no single cycle of depths"
)
AS_WIDE_WHY = (
    "the punch is as wide as the body: a plane, whose edge does not cut into a rim that bulges"
)
UNITS_REMEDY = "check work, R and E: are they in the same units?"
QUASI_WHY = "every point an equilibrium of the elastic curve"
# of a mesh: between its contacts that come off and the deepest; of the way to the rim
MAX_RADIUS_SPREAD = 500.0
MAX_RIM_FRACTION = 0.95
ROUNDING_FRACTION = (
    1e-3  # of the expected contact radius: the radius that a sharp apex or edge gets
)


@dataclass(frozen=True)
class Choice:
    """One thing the program decided (or was told), and why."""

    key: str
    value: str | float | int
    why: str


Choices = list[Choice]


def model_choices(setup: ProblemSetup) -> Choices:
    """What of the body is modelled, and how."""
    physics = setup.physics
    domain = physics.domain
    body = f"{physics.body.shape}, height {physics.scales.length:.4g}"
    pinned = "roller base and free sides leave rigid modes; reactions audited to be zero"
    strain = (
        ("small", "the material is linear elastic")
        if physics.small_strain
        else ("finite", "it is hyperelastic")
    )
    return [
        *([Choice("body", body, setup.truncation.why)] if setup.truncation else []),
        Choice("symmetry", domain.symmetry, setup.domain_reason),
        Choice("kinematics", domain.kinematics.name, domain.kinematics.reason),
        Choice("strain", *strain),
        *([Choice("control", "force", FORCE_WHY)] if physics.path.control == "force" else []),
        *(
            [Choice("surface", "held", _surface_membrane_reason(physics))]
            if physics.is_drop
            else []
        ),
        *([Choice("pins", len(domain.pins), pinned)] if domain.pins else []),
    ]


def _surface_membrane_reason(physics: ProblemDefinition) -> str:
    """Why the surface of a drop is held in its plane."""
    number = f"gamma/(mu R) = {physics.drop_number:.3g}: little but its tension holds the surface"
    return (
        f"{number}, whose points a membrane of 0.001 gamma keeps apart, which adds up to "
        "0.05 % to the force"
    )


def quantities(config: Config) -> Choices:
    """Quantities that carried units of their own, as they are in the scene's."""
    scene_units = f"{config.units.length} and {config.units.force}"
    stated_quantities = [
        (key_text(path), value, text) for path, (text, value) in config.source.quantities.items()
    ]
    return [
        Choice(key, value, f"given as {text}; the scene is in {scene_units}")
        for key, value, text in stated_quantities
    ]


def formulations(setup: ProblemSetup) -> Choices:
    """Displacements alone, or with a pressure, in each region."""
    regions = setup.physics.domain.regions
    return [_formulation(region, len(regions) == 1) for region in regions]


def _formulation(region: Region, is_alone: bool) -> Choice:
    key = "material" if is_alone or region.name == "body" else f"body.{region.name}.material"
    key = f"body.{region.name}" if region.name.startswith("regions.") else key
    nu = region.softest_constants.nu
    sign = ">=" if region.formulation == "mixed" else "<"
    state_text = "" if region.material.is_isotropic else "as compressible as "
    state_text = "its shear relaxes to " if region.min_shear_fraction < 1 else state_text
    why = (
        "as given"
        if region.material.formulation != "auto"
        else f"{state_text}nu = {nu:.6g} {sign} {LOCKING_POISSON_RATIO:g}"
    )
    return Choice(f"{key}.formulation", region.formulation, why)


def gap(settings: Contact, setup: ProblemSetup) -> tuple[str, Choice]:
    """Where the gap is tested, at the undeformed or the deformed point.

    ConfigError for a gap at the deformed point that has no answer: a body that slides away, a
    needle.
    """
    physics = setup.physics
    end = max_radius(setup.physics.indenter)
    auto = "reference" if physics.small_strain else "current"
    gap_kind = auto if settings.gap == "auto" else settings.gap
    if gap_kind == "current" and setup.max_depth > MAX_NEEDLE_RATIO * end:
        outcome = "gap: current cannot tell how a body gives way to such a needle"
        problem = (
            f"the depth is {setup.max_depth / end:.3g} times the radius at which the tip ends: "
            f"{outcome}"
        )
        raise ConfigError("indenter", problem, "give both in the same unit of length")
    if gap_kind == "current" and physics.domain.pins and not physics.is_compressed:
        remedy = (
            "fix the base, hold a side, use gap: reference, or put the tip in the middle and "
            "use symmetry"
        )
        raise ConfigError("contact.gap", f"'current' {SIDEWAYS_TEXT}", remedy)
    return gap_kind, Choice(
        "contact.gap", gap_kind, "as given" if settings.gap != "auto" else GAP_WHY[gap_kind]
    )


def contact(
    settings: Contact, setup: ProblemSetup, sizes: Sizes, fineness: MeshResolution | None
) -> tuple[ContactLaw, Choice]:
    """The contact method and its stiffness [pressure/length, without units]; ConfigError for one
    that is too soft.
    """
    scales = setup.physics.scales
    unit = setup.physics.material.E_star / sizes.h_contact
    law: Any = replace(scales.nondimensionalize(settings), gap="auto")  # the scene says which gap
    why = "as given"
    if isinstance(law, AutoContact):
        why = "auto: no penetration to pay for, smooth pressures, fewest iterations"
        law = AugmentedLagrangian(
            friction=law.friction, epsilon_t=law.epsilon_t, adhesion=law.adhesion
        )
    name = next((f.name for f in fields(law) if f.name in ("epsilon_n", "gamma")), None)
    if name is None:
        return law, Choice("contact", law.method, why)
    value: Any = getattr(law, name)
    source = f"{name} {'auto' if value == 'auto' else 'as given'}"
    if value == "auto":
        value = round_length(_auto_stiffness(law, setup, sizes, fineness))
    multiple = value / unit
    smallest = getattr(law, "min_stiffness_factor", 0.0)
    if multiple < smallest * (1 - 1e-9):
        problem = (
            f"is {multiple:.2g} E*/h_contact; below {smallest:g} E*/h_contact {law.method} "
            "gives wrong forces"
        )
        remedy = (
            f"at least {smallest * unit * scales.stiffness:.4g}, or auto "
            f"({law.auto_stiffness_factor:g} E*/h_contact)"
        )
        raise ConfigError(f"contact.{name}", problem, remedy)
    law = replace(law, **{name: value})
    law = law if law.is_conservative else _set_tangential_stiffness(law, unit, scales.stiffness)
    why = f"{why}; {source}: {value / unit:.3g} E*/h_contact"
    return law, Choice("contact", f"{law.method}, {name} = {value * scales.stiffness:.6g}", why)


def friction(
    law: ContactLaw, setup: ProblemSetup, sizes: Sizes
) -> tuple[ContactLaw, SlipReference, Choices]:
    """The law, with friction for stick where no surface that only pushes sticks, where new contact
    is taken to have touched, and what to say of friction; nothing where there is none.

    ConfigError for a scene that friction was never verified in.
    """
    physics = setup.physics
    coefficient = law.friction
    if not coefficient:
        return law, "implicit", []
    on_its_way = [Choice("contact.friction", coefficient, MIDSTEP_STICK_WHY)]
    if physics.domain.pins:
        problem = f"does not fit this scene: it {SIDEWAYS_TEXT}"
        remedy = "fix the base, hold a side, or put the tip in the middle and use symmetry"
        raise ConfigError("contact.friction", problem, remedy)
    if not isinstance(coefficient, str):
        if coefficient <= MAX_SLIPPING_FRICTION:
            return law, "implicit", [Choice("contact.friction", coefficient, STEP_START_STICK_WHY)]
        return law, "mid", on_its_way
    rim_width = tensile_rim_width(
        physics.indenter, physics.material.constants.nu, sizes, physics.domain.dim
    )
    if not rim_width:
        return law, "mid", on_its_way
    why = (
        f"stands for stick: {rim_width * physics.scales.length:.2g} beside the sharp edge a "
        "surface that sticks would pull"
    )
    law = replace(law, friction=STICK_FRICTION)  # type: ignore[arg-type]
    return law, "mid", [Choice("contact.friction", STICK_FRICTION, why)]


def adhesion(
    law: ContactLaw, setup: ProblemSetup, sizes: Sizes
) -> tuple[ExpectedAdhesion | None, Choices]:
    """What to say of a tip that adheres, the number of elements in its cohesive zone; nothing where
    none does. ConfigError for a range that the elements do not resolve, and for plane strain,
    where it was never verified.
    """
    attraction = law.adhesion
    if attraction is None:
        return None, []
    if setup.physics.body.dim == 2:
        problem = "was never verified in plane strain"
        raise ConfigError(
            "contact.adhesion", problem, "use an axisymmetric or a three-dimensional body"
        )
    L = setup.physics.scales.length
    E_star = setup.physics.material.E_star
    h = sizes.h_contact
    smallest = attraction.range_for_cohesive_zone(h / MAX_ELEMENT_RATIO, E_star) * L
    if attraction.range is None:
        remedy = (
            f"at least {smallest:.3g} where h_contact = {h * L:.3g}; its limit 0 is "
            "experiment.adhesion"
        )
        raise ConfigError(
            "contact.adhesion.range",
            "is missing: the distance over which the attraction acts",
            remedy,
        )
    zone = attraction.cohesive_zone(E_star)
    if h > MAX_ELEMENT_RATIO * zone * (1 + 1e-9):
        size_text = f"as those of {MAX_ELEMENT_RATIO:g} times its size at most do"
        problem = (
            f"has a cohesive zone of {zone * L:.3g}, and elements of {h * L:.3g} do not "
            f"resolve it, {size_text}"
        )
        remedy = (
            f"a range of at least {smallest:.3g}, or mesh.h_contact of at most "
            f"{MAX_ELEMENT_RATIO * zone * L:.3g}"
        )
        raise ConfigError("contact.adhesion.range", problem, remedy)
    expected = _expected_adhesion(attraction, setup, zone, h)
    return expected, [Choice("contact.adhesion", attraction.range * L, expected.description)]


def _expected_adhesion(
    attraction: Adhesion, setup: ProblemSetup, zone: float, h: float
) -> ExpectedAdhesion:
    """What is known of this attraction beforehand; zone, h [length]: of its cohesive zone, of the
    elements there.
    """
    from indent_sim.theory.maugis import (  # with scipy's searches
        maugis_lambda,
        maugis_pull_off,
        tabor_number,
    )

    L = setup.physics.scales.length
    F = setup.physics.scales.force
    R = getattr(setup.relative_tip, "R", None)
    pull_off = None
    with contextlib.suppress(*SOLUTION_ERRORS):
        pull_off = setup.jkr.pull_off(inf).force if setup.jkr else None
    expected = ExpectedAdhesion(zone * L, zone / h, jkr_pull_off=pull_off and pull_off * F)
    if R is None:
        return expected
    assert attraction.range is not None
    numbers = (attraction.work, attraction.range, R, setup.physics.material.E_star)
    unit = pi * attraction.work * R
    is_half_space_like = (
        pull_off is not None and abs(pull_off / (-1.5 * unit) - 1) <= PULL_OFF_DIFFERENCE
    )
    dugdale = maugis_pull_off(maugis_lambda(*numbers)) * unit * F if is_half_space_like else None
    return replace(
        expected,
        tabor=tabor_number(*numbers),
        maugis_lambda=maugis_lambda(*numbers),
        maugis_pull_off=dugdale,
    )


def _set_tangential_stiffness(law: Any, unit: float, stiffness: float) -> Any:
    """The law with its epsilon_t, auto being epsilon_n; ConfigError where the surface slips that
    should stick.
    """
    law = replace(law, epsilon_t=law.stiffness) if law.epsilon_t == "auto" else law
    min_multiple = law.min_tangential_factor
    if law.epsilon_t >= min_multiple * unit * (1 - 1e-9):
        return law
    auto_text = ", or auto (epsilon_n)" if law.epsilon_t != law.stiffness else ""
    outcome = f"{law.method} loses friction, or does not converge"
    problem = (
        f"is {law.epsilon_t / unit:.2g} E*/h_contact; below {min_multiple:g} E*/h_contact {outcome}"
    )
    raise ConfigError(
        "contact.epsilon_t", problem, f"at least {min_multiple * unit * stiffness:.4g}{auto_text}"
    )


def _auto_stiffness(
    law: Any, setup: ProblemSetup, sizes: Sizes, fineness: MeshResolution | None
) -> float:
    """The epsilon_n or gamma that `auto` stands for [pressure/length, without units]."""
    unit = setup.physics.material.E_star / sizes.typical_size
    default_stiffness = float(law.auto_stiffness_factor * unit)
    if not isinstance(law, Penalty):
        return default_stiffness
    if fineness is not None:  # the penalty's error must fit into what is asked for
        return min(fineness.penalty_stiffness, MAX_STIFFNESS_MULTIPLE * unit)
    depths = {delta for delta in (setup.max_depth, setup.physics.deltas[-1]) if delta > 0}
    law = replace(law, epsilon_n=default_stiffness)
    force_losses = [
        penalty_force_loss(
            law, setup.physics.material, setup.theory, delta, setup.expected_radius(delta)
        )
        for delta in depths
    ]
    return min(
        default_stiffness * max(1.0, max(force_losses, default=0.0) / NEGLIGIBLE_ERROR),
        MAX_STIFFNESS_MULTIPLE * unit,
    )


def solver(config: Config, setup: ProblemSetup, physics: ProblemDefinition, nodes: float) -> Choice:
    """What solves the scene; ConfigError for one that cannot.

    A linear body under a frictionless tip with a reference gap is one compliance; anything else is
    not. The compliance is dense: beyond MOST_CANDIDATES nodes that may come into contact it is not
    made.
    """
    requested = config.solver.method
    law = physics.contact
    size_text = (
        f"{nodes:.2g} nodes may come into contact: the dense matrices need "
        f"{DENSE_BYTES * nodes**2 / 1e9:.2g} GB"
    )
    obstacle = first_reason(
        (not physics.small_strain, "the material is not linear"),
        (physics.gap == "current", "the gap at the deformed point makes the problem nonlinear"),
        (bool(law.reason_not_condensable), law.reason_not_condensable),
        (bool(physics.permeable_regions), "the fluid's pressure lives inside the body"),
        (bool(physics.relaxing_regions), "its shear relaxes, and its bulk modulus does not"),
        (config.solver.linear == "iterative", WHOLE_BODY_WHY),
        (
            nodes > MAX_CANDIDATES,
            f"about {size_text} (at most {MAX_CANDIDATES} nodes are condensed to)",
        ),
    )
    if requested == "condensed" and obstacle:
        raise ConfigError(
            "solver.method", f"'condensed' does not fit this scene: {obstacle}", "use 'newton'"
        )
    if requested != "auto":
        return Choice("solver.method", requested, "as given")
    why = obstacle or "linear body, reference gap: one factorisation serves every step"
    if setup.truncation and (theory_reason := theory_obstacle(config, setup)) != why:
        why = f"{why}; not theory: {theory_reason}"
    return Choice("solver.method", "newton" if obstacle else "condensed", why)


def iterative_obstacle(config: Config, physics: ProblemDefinition, sizes: Sizes) -> str:
    """Why the linear systems of a scene are not solved iteratively; empty where they can be."""
    law = physics.contact
    locking_nu = physics.largest_locking_nu
    stiffness_multiple = getattr(law, "stiffness", 0.0) * sizes.h_contact / physics.material.E_star
    return first_reason(
        (physics.domain.dim == 2, "axisymmetric and plane bodies are factored"),
        (bool(law.reason_unsymmetric), law.reason_unsymmetric),
        (
            bool(physics.permeable_regions),
            "its preconditioner does not know the pressure of the fluid",
        ),
        (
            bool(physics.relaxing_regions),
            "a body whose shear relaxes is factored, each length of a step anew",
        ),
        (
            law.multiplier in ("stress", "nodal"),
            f"{law.method} has a tangent that is not symmetric",
        ),
        (
            locking_nu > MAX_ITERATIVE_NU,
            f"formulation: displacement at nu = {locking_nu:g} needs too many iterations",
        ),
        (
            stiffness_multiple > MAX_ITERATIVE_STIFFNESS,
            f"a contact of {stiffness_multiple:.2g} E*/h_contact needs too many iterations",
        ),
        (bool(physics.wall_stiffness) and not physics.small_strain, STIFF_WALL_WHY),
        (config.solver.method == "condensed", "solver.method: condensed factors the body once"),
    )


def linear_solver(
    config: Config,
    physics: ProblemDefinition,
    sizes: Sizes,
    direct: Cost,
    iterative: Cost,
    available_memory: float,
) -> Choice:
    """How linear systems are solved, at these costs and with `available_memory` for them [bytes].

    ConfigError for an iterative solver that does not know the scene.
    """
    requested = config.solver.linear
    obstacle = iterative_obstacle(config, physics, sizes)
    if requested == "iterative" and obstacle:
        raise ConfigError(
            "solver.linear", f"'iterative' does not fit this scene: {obstacle}", "use 'direct'"
        )
    if requested != "auto":
        return Choice("solver.linear", requested, "as given")
    if obstacle:
        return Choice("solver.linear", "direct", obstacle)
    cost_texts = [
        f"about {cost.seconds:.2g} s and {cost.memory / 1e9:.2g} GB" for cost in (direct, iterative)
    ]
    is_worth_it = direct.seconds - iterative.seconds > MIN_SECONDS_SAVED
    is_cheaper = is_worth_it and iterative.seconds < MAX_TIME_RATIO * direct.seconds
    is_needed = direct.memory > available_memory >= iterative.memory
    solver_kind = "iterative" if is_cheaper or is_needed else "direct"
    return Choice(
        "solver.linear", solver_kind, f"factored {cost_texts[0]}, iteratively {cost_texts[1]}"
    )


def theory(config: Config, setup: ProblemSetup) -> Choice | None:
    """That theory solves the scene, and why; None where a mesh does.

    ConfigError where theory is asked for in vain.
    """
    requested = config.solver.method
    if requested != "theory" and not (
        requested == "auto" and isinstance(config.body, UnboundedBody)
    ):
        return None
    obstacle = theory_obstacle(config, setup)
    if requested == "theory" and obstacle:
        raise ConfigError(
            "solver.method", f"'theory' does not fit this scene: {obstacle}", "use 'auto'"
        )
    if obstacle or setup.theory is None:
        return None
    error_text = (
        "too large a force"
        if setup.theory.tension_fraction
        else f"exact but for {setup.theory.error:.0e} of the force"
    )
    why = f"{setup.theory.reason}: {error_text}, nothing is meshed"
    return Choice("solver.method", "theory", f"as given; {why}" if requested == "theory" else why)


def theory_obstacle(config: Config, setup: ProblemSetup) -> str:
    """Why theory cannot give what a scene asks for; empty where it can."""
    if config_reason := config_obstacle(config):
        return config_reason
    reference_theory = setup.theory
    target = target_error(config.accuracy)
    if reference_theory is None:
        has_shape = theory_tip_shape(setup.physics.indenter) is not None
        return (
            "theory knows no layers with nu < 0" if has_shape else "theory does not know this tip"
        )
    if not reference_theory.is_exact and not (
        reference_theory.tension_fraction and config.solver.method == "theory"
    ):
        return reference_theory.reason
    if target is not None and target < reference_theory.error:
        return f"theory is good to {reference_theory.error:.0e} of the force, and accuracy asks for {target:g}"
    if setup.physics.path.control == "depth" and len(setup.physics.deltas) <= MAX_KEPT_SOLUTIONS:
        reference_theory.expect_depths(setup.physics.deltas)  # of which this is one
    if not reference_theory.covers_path(setup.max_depth, setup.physics.largest_force):
        return (
            "theory ends before the deepest contact: at a wall, at the tip's end, or at 100 "
            "thicknesses"
        )
    return ""


def config_obstacle(config: Config) -> str:
    """What a config asks for that no theory has, as far as it can be told at a look; empty where
    there is nothing.
    """
    materials = [layer.material for layer in config.layers if layer.material]
    law = config.contact
    solver = replace(config.solver, method="auto")
    return first_reason(
        (isinstance(config.body, MeshFromFile), "theory does not know a body meshed elsewhere"),
        (not all(material.is_small_strain for material in materials), "the material is not linear"),
        (
            any(material.flow for _, material in config.materials()),
            "theory knows no fluid in the pores",
        ),
        (
            any(material.has_shear_relaxation for _, material in config.materials()),
            "theory knows no shear that relaxes",
        ),
        (bool(config.body.inclusions), NO_INCLUSIONS),
        (not config.indenter.is_axisymmetric, f"a {config.indenter.shape} is no tip of revolution"),
        (law.gap == "current", "theory tests the gap at the undeformed point"),
        (not isinstance(law, AutoContact), f"contact.method: {law.method} is for a mesh"),
        (bool(law.feature_without_theory), f"theory knows no {law.feature_without_theory}"),
        (solver != type(solver)(), "linear, rtol and max_iterations of solver are for a mesh"),
        (config.mesh != type(config.mesh)(), "the settings of mesh are for one"),
        (
            any(material.formulation != "auto" for material in materials),
            "material.formulation is for a mesh",
        ),
        (
            config.output.fields in ("last", "all"),
            f"output.fields: {config.output.fields} asks for a mesh",
        ),
    )


def needs_mesh(config: Config) -> bool:
    """Whether a config cannot do without a mesh, as far as it can be told at a look."""
    is_for_theory = isinstance(config.body, UnboundedBody) or config.solver.method == "theory"
    return (
        config.solver.method in ("condensed", "newton")
        or not is_for_theory
        or bool(config_obstacle(config))
    )


def theory_choices(config: Config, setup: ProblemSetup) -> Choices:
    """What theory solves, and what of it is written."""
    physics = setup.physics
    domain = physics.domain
    target = target_error(config.accuracy)
    peak_reason = infinite_pressure_reason(physics.indenter, setup.a) if setup.max_depth > 0 else ""
    accuracy_text = "theory is better than that"
    return [
        Choice("kinematics", domain.kinematics.name, setup.domain_reason),
        Choice("strain", "small", "the material is linear elastic"),
        *(
            [Choice("control", "force", THEORY_FORCE_WHY)]
            if physics.path.control == "force"
            else []
        ),
        Choice("contact.gap", "reference", "theory tests the gap at the undeformed point"),
        *([Choice("p_max", "empty", peak_reason)] if peak_reason else []),
        *([Choice("accuracy", target, accuracy_text)] if target is not None else []),
        Choice("output.fields", "none", "there is no mesh to write them on"),
    ]


def mesh(
    config: Config, setup: ProblemSetup, sizes: Sizes, fineness: MeshResolution | None
) -> Choices:
    """The element sizes, and where each comes from."""
    L = setup.physics.scales.length
    a = setup.a
    settings = config.mesh
    elements_text = f"{a / sizes.h_contact:.3g} elements in the expected contact radius {a * L:.4g}"
    choices = [Choice("accuracy", fineness.target, fineness.why(L))] if fineness else []
    if isinstance(setup.physics.domain, ImportedDomain):
        imported_mesh = setup.physics.domain.mesh
        mesh_text = (
            f"{imported_mesh.statistics.cells} cells, {imported_mesh.statistics.points} points"
        )
        if len(imported_mesh.midside_nodes[0]):
            mesh_text += "; order 2: its midside nodes are the new corners of the first refinement"
        refinement_reason = "as given" if settings.refinements else "the mesh as it is"
        refinements_choice = Choice(
            "mesh.refinements",
            sizes.refinements or 0,
            "each halves every edge" if fineness else refinement_reason,
        )
        size_choice = Choice(
            "mesh.h_contact", sizes.h_contact * L, f"the facets' own; {elements_text}"
        )
        return [
            Choice("body.file", imported_mesh.hash, mesh_text),
            *choices,
            refinements_choice,
            size_choice,
        ]
    auto = "from accuracy" if fineness else "auto: at most 0.3 % of the force at the last step"
    contact_reason = "as given" if settings.h_contact != "auto" else auto
    far_reason = (
        "as given"
        if settings.h_far != "auto"
        else f"sizes grow by {sizes.grading:.3g} per unit distance up to this"
    )
    contact = ("h_contact", f"{contact_reason}; {elements_text}")
    axis = ("h_axis", AXIS_WHY)
    reasons = (
        contact,
        axis,
        ("h_far", far_reason),
        ("h_edge", EDGE_WHY),
        ("h_corner", CORNER_WHY),
        ("h_film", FILM_WHY),
    )
    named_sizes = [(f"mesh.{name}", getattr(sizes, name), why) for name, why in reasons]
    choices += [Choice(key, h * L, why) for key, h, why in named_sizes if h is not None]
    if sizes.inclusions:
        sizes_text = ", ".join(f"{h * L:.4g}" for _, h in sizes.inclusions)
        why = (
            "as given"
            if settings.h_inclusions
            else "by what the force feels of each; sizes grow from this around them"
        )
        choices.append(Choice("mesh.h_inclusions", sizes_text, why))
    if sizes.coatings:
        sizes_text = ", ".join(f"{h * L:.4g}" for _, h in sizes.coatings)
        why = (
            "as given"
            if settings.h_layers
            else "by the thickness of each skin; sizes grow from this on both sides"
        )
        choices.append(Choice("mesh.h_layers", sizes_text, why))
    return choices


def is_followed_on_body(config: Config, setup: ProblemSetup, solver: Choice) -> bool:
    """Whether a history is followed row by row on the whole body: no curve determines it."""
    return setup.history is not None and (
        bool(config.contact.reason_no_elastic_curve) or solver.value == "newton"
    )


def time_steps(setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes) -> Choices:
    """How long what flows and relaxes takes, and in which steps it is followed; nothing where the
    body is elastic.
    """
    if not physics.is_time_dependent or setup.history is None:
        return []
    reasons = []
    if physics.permeable_regions:
        times = DiffusionTimes.compute(setup, physics, sizes.h_contact)
        reasons.append(
            f"fluid takes {times.contact:.3g} through the contact, {times.height:.3g} through "
            "the body"
        )
    if relaxing := [
        t
        for region in physics.domain.regions
        if region.relaxation_series
        for t in region.relaxation_series.times
    ]:
        reasons.append(f"shear relaxes in {min(relaxing):.3g} to {max(relaxing):.3g}")
    method = "SDIRK2" if physics.permeable_regions else "the exponentials' own"
    reasons.append(
        f"{setup.steps_per_doubling} of each length in every piece of the history, then twice "
        f"as long; {method}"
    )
    first = first_step(setup, physics, sizes.h_contact)
    if setup.history.has_jumps and not physics.path.has_jumps:
        reasons.append(
            "a jump on this column has no equilibrium at once: the step after it begins before it"
        )
    choices_made: Choices = [Choice("time.first_step", float(f"{first:.4g}"), "; ".join(reasons))]
    if physics.bath_ramp:
        given_as = (
            "as given"
            if physics.drainage.bath_ramp != "auto"
            else "a 75th of what fluid takes through the contact"
        )
        reason = (
            "a sudden bath comes evenly within this time, since at once it has no "
            f"equilibrium: {given_as}"
        )
        choices_made.append(Choice("drainage.bath_ramp", float(f"{physics.bath_ramp:.4g}"), reason))
    return choices_made


def curve(
    config: Config, setup: ProblemSetup, solver: Choice, follows_whole: bool = False
) -> Choices:
    """How what is computed from the elastic curve is, an experiment, a history, or why a history is
    not; ConfigError where a curve does not determine what is asked for.
    """
    if setup.experiment is None and setup.history is None:
        return []
    if follows_whole:
        reason = solver.why if solver.value == "newton" else config.contact.reason_no_elastic_curve
        _refuse_curve_features(setup, reason)
        return [Choice("time", "steps", f"row by row on the body: {reason}")]
    _refuse_curve(
        config,
        setup,
        solver,
        "experiment" if setup.experiment else f"loading.{config.loading.given_path_keys[0]}",
    )
    choices = [Choice("experiment.adhesion", "JKR", JKR_WHY)] if setup.jkr_limit else []
    if setup.history:
        reason = (
            STEP_WHY if setup.uses_time_stepping else TING_WHY if setup.relaxation else QUASI_WHY
        )
        choices.append(Choice("time", "curve", JKR_WHY if setup.jkr_limit else reason))
    return choices


def refuse_reactions(config: Config, why: str) -> None:
    """ConfigError where reactions are asked for and nothing says them: `why` not."""
    if config.output.reactions:
        raise ConfigError(
            "output.reactions", f"true: there are none to write: {why}", "leave it out"
        )


def refuse_nodal_stress(config: Config, has_fields: bool) -> None:
    """ConfigError where stresses at the nodes are asked for and no fields are written."""
    if config.output.nodal_stress and not (has_fields and config.output.fields != "none"):
        raise ConfigError("output.nodal_stress", "true: this run writes no fields", "leave it out")


def _refuse_curve_features(setup: ProblemSetup, why: str) -> None:
    """ConfigError for what is made of a curve."""
    if setup.relaxation:
        problem = f"all: is for the curve of a linear, frictionless body: {why}"
        raise ConfigError(
            "material.relaxation.of",
            problem,
            "of: shear, or leave out what stands against the curve",
        )
    if experiment_part := next(
        (name for name, part in vars(setup.experiment or Experiment()).items() if part), None
    ):
        problem = f"is made of a curve, and this body is followed row by row: {why}"
        raise ConfigError(f"experiment.{experiment_part}", problem, "leave one of the two out")


def _refuse_curve(config: Config, setup: ProblemSetup, solver: Choice, key: str) -> None:
    physics = setup.physics
    if setup.history and config.output.fields in ("last", "all"):
        problem = (
            f"{config.output.fields}: a history is followed on the elastic curve, which has "
            "no fields"
        )
        raise ConfigError("output.fields", problem, "leave it out")
    if config.contact.reason_no_elastic_curve:
        problem = (
            "is determined by the curve of a tip without friction and adhesion, and contact "
            "has some"
        )
        raise ConfigError(key, problem, "leave one of the two out")
    if solver.value == "newton":
        problem = (
            "needs a linear body whose compliance is known, and this scene is solved whole: "
            f"{solver.why}"
        )
        raise ConfigError(
            key, problem, "solver.method: condensed or theory says what stands against it"
        )
    if setup.jkr_limit and physics.domain.kinematics.name != "axisymmetric":
        problem = (
            "the JKR limit is that of a disc, and this scene is "
            f"{physics.domain.kinematics.name.replace('_', ' ')}"
        )
        raise ConfigError("experiment.adhesion", problem, "put the tip on the axis of a round body")
    if setup.jkr_limit and not setup.adhesive_radii:
        problem = (
            "the contact that adheres so is wider than theory reaches, or there is none at "
            "that depth"
        )
        raise ConfigError("experiment.adhesion", problem, UNITS_REMEDY)
    if setup.jkr_limit and solver.value == "condensed" and setup.adhesive_radii:
        _refuse_radius_range(setup, *setup.adhesive_radii)
    if setup.uses_time_stepping and solver.value == "theory" and physics.body.dim == 2:
        problem = (
            "a strip that relaxes under this history is stepped in time on the compliance of a mesh"
        )
        raise ConfigError("material.relaxation", problem, "use solver.method: condensed")


def _refuse_radius_range(setup: ProblemSetup, smallest: float, largest: float) -> None:
    """ConfigError where no mesh holds the contacts with adhesion, from where the tip comes off to
    the deepest.
    """
    L = setup.physics.scales.length
    rim = setup.physics.body.lateral_extent(setup.physics.center)
    if largest > MAX_RIM_FRACTION * rim:
        problem = (
            f"pulls the body around the tip to a radius of {largest * L:.3g}, its rim being "
            f"at {rim * L:.3g}"
        )
        raise ConfigError("experiment.adhesion.work", problem, UNITS_REMEDY)
    if largest > MAX_RADIUS_SPREAD * smallest:
        problem = (
            f"lets the tip come off at a radius of {smallest * L:.3g}, far below the deepest, "
            f"{largest * L:.3g}"
        )
        raise ConfigError(
            "experiment.adhesion.work", problem, "do not go as deep, or solver.method: theory"
        )


def tip(config: Config, setup: ProblemSetup, gap: str) -> tuple[Indenter, Choices]:
    """The tip, with a small radius at a sharp apex or edge where the gap needs a normal everywhere;
    a plate in place of a punch that is as wide as the body.
    """
    if isinstance(setup.physics.indenter, Plate) and isinstance(config.indenter, FlatPunch):
        return setup.physics.indenter, [Choice("indenter.shape", "plate", AS_WIDE_WHY)]
    physics = setup.physics
    body = setup.physics.body
    sharp_tip = physics.indenter
    key = "edge_radius" if isinstance(physics.indenter, FlatPunch) else "tip_radius"
    if gap == "reference" or getattr(sharp_tip, key, 1.0) > 0:
        return sharp_tip, []
    radius = round_length(ROUNDING_FRACTION * setup.a)
    rounded_tip = replace(sharp_tip, **{key: radius})  # type: ignore[arg-type]
    theories = [
        layer_theory(body, setup.layers, item, physics.center) for item in (sharp_tip, rounded_tip)
    ]
    solutions = [
        solution
        for item in theories
        if item and setup.max_depth > 0 and (solution := item.solution_at_depth(setup.max_depth))
    ]
    change = ""
    if len(solutions) == 2 and all(item.force for item in solutions):
        change = f", changes the force by {solutions[1].force / solutions[0].force - 1:+.1g} by layer theory"
    why = (
        f"gap: current needs a normal everywhere; {ROUNDING_FRACTION:g} of the expected contact "
        f"radius{change}"
    )
    return rounded_tip, [Choice(f"indenter.{key}", radius * physics.scales.length, why)]
