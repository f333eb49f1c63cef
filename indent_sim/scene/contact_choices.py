"""Choices of the contact: gap, contact law, friction, adhesion and the shape of the tip."""

from __future__ import annotations

import contextlib
from dataclasses import fields, replace
from math import inf, pi
from typing import TYPE_CHECKING, Any

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.adhesion import Adhesion
from indent_sim.model.contact import (
    AugmentedLagrangian,
    AutoContact,
    Contact,
    ContactLaw,
    Penalty,
    SlipReference,
)
from indent_sim.model.tilted_tip import TiltedTip, overhang_tilt
from indent_sim.model.tips import FlatPunch, Indenter, Plate, max_radius
from indent_sim.model.units import round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice, Choices
from indent_sim.scene.discretisation_warnings import MAX_STIFFNESS_MULTIPLE
from indent_sim.scene.expected_error import NEGLIGIBLE_ERROR, penalty_force_loss
from indent_sim.scene.measured_constants import (
    MAX_ELEMENT_RATIO,
    MAX_SLIPPING_FRICTION,
    STICK_FRICTION,
)
from indent_sim.scene.no_slip_effect import tensile_rim_width
from indent_sim.scene.predictions import ExpectedAdhesion
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.reference_theory import layer_theory
from indent_sim.scene.resolution import MeshResolution
from indent_sim.theory.solution import SOLUTION_ERRORS

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


SIDEWAYS_TEXT = (
    "pushes the body sideways, but no support prevents sliding (roller base and free sides)"
)


def gap(settings: Contact, setup: ProblemSetup) -> tuple[str, Choice]:
    """Choose where the gap is evaluated: at the undeformed or at the deformed point.

    Raises
    ------
    ConfigError
        If the gap is evaluated at the deformed point although the body can slide away or the tip is
        a needle.
    """
    physics = setup.physics
    end = max_radius(setup.physics.indenter)
    auto = "reference" if physics.small_strain else "current"
    gap_kind = auto if settings.gap == "auto" else settings.gap
    # Largest ratio of depth and tip radius at which a deformed body can be followed around a
    # needle.
    max_needle_ratio = 1e3
    if gap_kind == "current" and setup.max_depth > max_needle_ratio * end:
        outcome = "gap: current cannot follow the deformation of a body around such a thin tip"
        problem = (
            f"the depth is {setup.max_depth / end:.3g} times the radius at which the tip ends: "
            f"{outcome}"
        )
        raise ConfigError("indenter", problem, "give depth and tip in the same unit of length")
    if gap_kind == "reference":
        _check_reference_gap(physics.indenter)
    if gap_kind == "current" and physics.domain.pins and not physics.is_compressed:
        remedy = (
            "use base: fixed, a fixed or roller side, or gap: reference; or put the tip in the "
            "middle and use symmetry: auto"
        )
        raise ConfigError(
            "contact.gap",
            f"'current' does not fit this scene: the contact pressure {SIDEWAYS_TEXT}",
            remedy,
        )
    if gap_kind == "reference" and physics.yields and not physics.small_strain:
        problem = (
            "'reference' does not fit a body that yields at finite strain: its surface flows along "
            "the tip"
        )
        raise ConfigError("contact.gap", problem, "use current, or the law linear_elastic")
    reasons = {
        "reference": (
            "linear elastic: evaluated at the undeformed point, as in the problem of Hertz"
        ),
        "current": (
            "finite strain: evaluated at the deformed point, pressure along the tip's normal"
        ),
    }
    return gap_kind, Choice(
        "contact.gap", gap_kind, "as given" if settings.gap != "auto" else reasons[gap_kind]
    )


def _check_reference_gap(tip: Indenter) -> None:
    """Raise ConfigError if a tilted tip has no height above every point, or no height formula."""
    if not isinstance(tip, TiltedTip):
        return
    upright = tip.upright
    if tip.tilt >= (limit := overhang_tilt(upright)):
        problem = (
            f"at a tilt of {limit:.4g} degrees, its half angle, a flank of this {upright.shape} "
            "overhangs, where the gap at the undeformed point is not defined"
        )
        raise ConfigError("indenter.tilt", problem, "use a smaller tilt, or contact.gap: current")
    if not tip.has_closed_height:
        problem = (
            f"the gap at the undeformed point is not available for a tilted {upright.shape} with "
            "rounded edges"
        )
        raise ConfigError("indenter.tilt", problem, "use a sharp tip, or contact.gap: current")


def contact(
    settings: Contact, setup: ProblemSetup, sizes: Sizes, fineness: MeshResolution | None
) -> tuple[ContactLaw, Choice]:
    """Choose the contact method and its stiffness.

    Parameters
    ----------
    settings : Contact
        The section `contact` of the scene file.
    setup : ProblemSetup
        The nondimensional problem.
    sizes : Sizes
        The element sizes, nondimensional.
    fineness : MeshResolution or None
        The mesh resolution for the requested `accuracy`, with its penalty stiffness.

    Returns
    -------
    ContactLaw
        The law with its stiffness, a pressure per displacement divided by its scale.
    Choice
        The method and its stiffness in the user's units.

    Raises
    ------
    ConfigError
        If a given stiffness is too small.
    """
    scales = setup.physics.scales
    unit = setup.physics.material.E_star / sizes.h_contact
    # The scene states where the gap is evaluated, so that the law need not.
    law: Any = replace(scales.nondimensionalize(settings), gap="auto")
    why = "as given"
    if isinstance(law, AutoContact):
        why = (
            "auto: this method has no error due to penetration, smooth pressures, and the "
            "fewest iterations"
        )
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
            f"use at least {smallest * unit * scales.stiffness:.4g}, or auto "
            f"({law.auto_stiffness_factor:g} E*/h_contact)"
        )
        raise ConfigError(f"contact.{name}", problem, remedy)
    law = replace(law, **{name: value})
    law = law if law.is_conservative else _set_tangential_stiffness(law, unit, scales.stiffness)
    why = f"{why}; {source}: {value / unit:.3g} E*/h_contact"
    return law, Choice("contact", f"{law.method}, {name} = {value * scales.stiffness:.6g}", why)


def _set_tangential_stiffness(law: Any, unit: float, stiffness: float) -> Any:
    """Return the law with its epsilon_t; `auto` means epsilon_n.

    Raises
    ------
    ConfigError
        If the given stiffness is too small.
    """
    law = replace(law, epsilon_t=law.stiffness) if law.epsilon_t == "auto" else law
    min_multiple = law.min_tangential_factor
    if law.epsilon_t >= min_multiple * unit * (1 - 1e-9):
        return law
    auto_text = ", or auto (epsilon_n)" if law.epsilon_t != law.stiffness else ""
    outcome = f"{law.method} underestimates friction, or does not converge"
    problem = (
        f"is {law.epsilon_t / unit:.2g} E*/h_contact; below {min_multiple:g} E*/h_contact {outcome}"
    )
    raise ConfigError(
        "contact.epsilon_t",
        problem,
        f"use at least {min_multiple * unit * stiffness:.4g}{auto_text}",
    )


def _auto_stiffness(
    law: Any, setup: ProblemSetup, sizes: Sizes, fineness: MeshResolution | None
) -> float:
    """Return the stiffness epsilon_n or gamma for `auto`.

    The stiffness is a pressure per displacement, divided by its scale.
    """
    unit = setup.physics.material.E_star / sizes.typical_size
    default_stiffness = float(law.auto_stiffness_factor * unit)
    if not isinstance(law, Penalty):
        return default_stiffness
    if fineness is not None:
        # The requested accuracy includes the error of the penalty.
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


def friction(
    law: ContactLaw, setup: ProblemSetup, sizes: Sizes
) -> tuple[ContactLaw, SlipReference, Choices]:
    """Choose the friction coefficient and the slip reference of new contact.

    Under a sharp edge, complete stick would need tensile contact pressures at the rim; it is
    replaced by a large friction coefficient.

    Parameters
    ----------
    law : ContactLaw
        The contact law, nondimensional.
    setup : ProblemSetup
        The nondimensional problem.
    sizes : Sizes
        The element sizes, nondimensional.

    Returns
    -------
    ContactLaw
        The law with its friction coefficient.
    SlipReference
        The point from which the slip of new contact is counted.
    list of Choice
        Empty without friction.

    Raises
    ------
    ConfigError
        If no support carries the friction force.
    """
    physics = setup.physics
    coefficient = law.friction
    if not coefficient:
        return law, "implicit", []
    midstep_reason = (
        "a point that comes into contact within a load increment sticks where it first touches "
        "the tip; this place is known from a first solution of the increment, in which the new "
        "contact has no friction"
    )
    on_its_way = [Choice("contact.friction", coefficient, midstep_reason)]
    if physics.domain.pins:
        problem = f"does not fit this scene: friction {SIDEWAYS_TEXT}"
        remedy = (
            "use base: fixed or a fixed or roller side; or put the tip in the middle and use "
            "symmetry: auto"
        )
        raise ConfigError("contact.friction", problem, remedy)
    if not isinstance(coefficient, str):
        if coefficient <= MAX_SLIPPING_FRICTION:
            start_reason = (
                "the slip of a point that comes into contact is counted from the point of the tip "
                "that was above it at the beginning of the load increment"
            )
            return law, "implicit", [Choice("contact.friction", coefficient, start_reason)]
        return law, "mid", on_its_way
    rim_width = tensile_rim_width(
        physics.indenter.upright, physics.material.constants.nu, sizes, physics.domain.dim
    )
    if not rim_width:
        return law, "mid", on_its_way
    why = (
        f"in place of stick: within {rim_width * physics.scales.length:.2g} of the sharp edge, a "
        "sticking surface would need tensile contact pressures"
    )
    law = replace(law, friction=STICK_FRICTION)  # type: ignore[arg-type]
    return law, "mid", [Choice("contact.friction", STICK_FRICTION, why)]


def adhesion(
    law: ContactLaw, setup: ProblemSetup, sizes: Sizes
) -> tuple[ExpectedAdhesion | None, Choices]:
    """Check the adhesion, and predict its cohesive zone and pull-off force.

    Returns
    -------
    ExpectedAdhesion or None
        The prediction; None without adhesion.
    list of Choice
        Empty without adhesion.

    Raises
    ------
    ConfigError
        If the range is missing, if the elements do not resolve the cohesive zone, or in plane
        strain, for which adhesion is not verified.
    """
    attraction = law.adhesion
    if attraction is None:
        return None, []
    if setup.physics.body.dim == 2:
        problem = "is not verified in plane strain"
        raise ConfigError(
            "contact.adhesion", problem, "use an axisymmetric or a three-dimensional body"
        )
    L = setup.physics.scales.length
    E_star = setup.physics.material.E_star
    h = sizes.h_contact
    smallest = attraction.range_for_cohesive_zone(h / MAX_ELEMENT_RATIO, E_star) * L
    if attraction.range is None:
        remedy = (
            f"use at least {smallest:.3g} for h_contact = {h * L:.3g}; for the limit of range 0 "
            "use experiment.adhesion"
        )
        raise ConfigError(
            "contact.adhesion.range",
            "is missing: the distance over which the attraction acts",
            remedy,
        )
    zone = attraction.cohesive_zone(E_star)
    if h > MAX_ELEMENT_RATIO * zone * (1 + 1e-9):
        size_text = f"they may be at most {MAX_ELEMENT_RATIO:g} times as large as the zone"
        problem = (
            f"gives a cohesive zone of {zone * L:.3g}, which elements of {h * L:.3g} do not "
            f"resolve: {size_text}"
        )
        remedy = (
            f"use a range of at least {smallest:.3g}, or mesh.h_contact of at most "
            f"{MAX_ELEMENT_RATIO * zone * L:.3g}"
        )
        raise ConfigError("contact.adhesion.range", problem, remedy)
    expected = _expected_adhesion(attraction, setup, zone, h)
    return expected, [Choice("contact.adhesion", attraction.range * L, expected.description)]


def _expected_adhesion(
    attraction: Adhesion, setup: ProblemSetup, zone: float, h: float
) -> ExpectedAdhesion:
    """Predict the adhesion from its cohesive zone and the element size h in this zone [length]."""
    # This import loads scipy's searches.
    from indent_sim.theory.maugis import maugis_lambda, maugis_pull_off, tabor_number

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
    # Relative difference between the JKR pull-off force and that of a half-space up to which the
    # body is treated as a half-space.
    pull_off_difference = 0.05
    is_half_space_like = (
        pull_off is not None and abs(pull_off / (-1.5 * unit) - 1) <= pull_off_difference
    )
    dugdale = maugis_pull_off(maugis_lambda(*numbers)) * unit * F if is_half_space_like else None
    return replace(
        expected,
        tabor=tabor_number(*numbers),
        maugis_lambda=maugis_lambda(*numbers),
        maugis_pull_off=dugdale,
    )


def tip(config: Config, setup: ProblemSetup, gap: str) -> tuple[Indenter, Choices]:
    """Choose the shape of the tip: rounded, or a plate, if the contact requires it.

    A gap at the deformed point needs a normal everywhere, so that a sharp apex or edge is rounded
    with a small radius. A punch as wide as the body becomes a plate.
    """
    if isinstance(setup.physics.indenter, Plate) and isinstance(config.indenter, FlatPunch):
        plate_reason = (
            "the punch is as wide as the body: a plate, since at finite strain the edge of a "
            "punch would cut into the bulging rim"
        )
        return setup.physics.indenter, [Choice("indenter.shape", "plate", plate_reason)]
    physics = setup.physics
    body = setup.physics.body
    sharp_tip = physics.indenter
    upright = physics.indenter.upright
    key = "edge_radius" if isinstance(upright, FlatPunch) else "tip_radius"
    if gap == "reference" or getattr(upright, key, 1.0) > 0:
        return sharp_tip, []
    # Radius of a rounded apex or edge, relative to the expected contact radius.
    rounding_fraction = 1e-3
    radius = round_length(rounding_fraction * setup.a)
    rounded_tip = sharp_tip.replace_upright(replace(upright, **{key: radius}))
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
        ratio = solutions[1].force / solutions[0].force
        change = f", which changes the force by {ratio - 1:+.1g} according to layer theory"
    why = (
        f"gap: current needs a normal everywhere: the tip is rounded by {rounding_fraction:g} of "
        f"the expected contact radius{change}"
    )
    return rounded_tip, [Choice(f"indenter.{key}", radius * physics.scales.length, why)]
