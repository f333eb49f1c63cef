"""Model warnings: reasons to doubt the model of a scene, known before it is solved.

Each warning has the relative error of the force that is expected from its cause, if it is known.
`discretisation_warnings` and `fluid_warnings` add warnings about the contact law, the mesh and
the drainage.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from indent_sim.model import stability
from indent_sim.model.measured_constants import LOCKING_POISSON_RATIO
from indent_sim.model.tilted_tip import TiltedTip
from indent_sim.model.tips import (
    STEM_HALF_ANGLE,
    FlatPunch,
    Paraboloid,
    Sphere,
    max_radius,
)
from indent_sim.scene.half_space_formulas import half_space_force
from indent_sim.scene.problem_setup import ATTRACTION_CUTOFF, ProblemSetup
from indent_sim.scene.regions import unused_material_message

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


@dataclass(frozen=True)
class ModelWarning:
    """Reason to doubt the force of a scene.

    Attributes
    ----------
    key : str
        Short name of the cause.
    message : str
        The warning; empty if the error is too small to be reported.
    force_error : float
        Expected relative error of the force of the last row; 0 if it is unknown.
    """

    key: str
    message: str
    force_error: float = 0.0


NO_CONTACT = ModelWarning("no_contact", "the tip never reaches the body: every depth is <= 0")


def theory_warnings(setup: ProblemSetup, gap: str = "reference") -> tuple[ModelWarning, ...]:
    """Return the warnings about the model itself, which apply to every solver."""
    if setup.max_depth <= 0:
        return tuple(_attraction_warnings(setup)) if setup.attraction else (NO_CONTACT,)
    return (
        *_model_warnings(setup),
        *_tip_end_warnings(setup, gap),
        *_attraction_warnings(setup),
        *_adhesion_warnings(setup),
    )


def material_warnings(config: Config, setup: ProblemSetup) -> tuple[ModelWarning, ...]:
    """Return a warning if the section `material` has no effect."""
    message = unused_material_message(config, setup.physics.domain)
    return (ModelWarning("material", message),) if message else ()


def pull_warnings(setup: ProblemSetup) -> tuple[ModelWarning, ...]:
    """Return a warning if the contact pressure of the reference theory is tensile somewhere.

    A contact on a mesh cannot transmit tension without adhesion.
    """
    if not (setup.theory and setup.theory.tension_fraction):
        return ()
    message = (
        f"{setup.theory.reason}; a contact without tension is smaller, and so is its force: the "
        "difference is known only from a finite-element solution"
    )
    return (ModelWarning("pull", message, setup.theory.tension_fraction),)


def _model_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Yield warnings if kinematics, tip, material or body are outside the range of the model."""
    physics = setup.physics
    body = physics.body
    material = physics.material
    tip = physics.indenter
    delta = setup.max_depth
    a = setup.a
    strain, formula = setup.relative_tip.characteristic_strain(delta, a)
    if physics.is_compressed:
        strain = delta / body.height
        formula = "delta/height"
    # Characteristic strain up to which the error of forces at small strain is a few per cent: a/R =
    # 0.25.
    max_small_strain = 0.05
    if physics.small_strain and strain > max_small_strain:
        yield ModelWarning(
            "small_strain",
            f"strains near {formula} = {strain:.2g}: small strain is no longer a good model",
        )
    upright = tip.upright
    if isinstance(upright, Paraboloid) and delta > 0.1 * upright.R:
        message = (
            "the depth is more than R/10: the force of a sphere of this R would be at least 1 % "
            "lower than that of the paraboloid"
        )
        yield ModelWarning("paraboloid", message)
    # Compression of the whole height is already reported by its strain.
    if physics.small_strain and delta > 0.1 * body.height and not physics.is_compressed:
        depth_text = f"the depth is {delta / body.height:.0%} of the thickness"
        yield ModelWarning("small_strain", f"{depth_text}: small strain is no longer a good model")
    reach = a
    if isinstance(tip, TiltedTip):
        reach = sum(tip.contact_patch(a, body.dim))
    if reach > 0.8 * body.lateral_extent(physics.center) and not physics.is_compressed:
        yield ModelWarning("rim", "the contact comes close to the edge of the body")
    if (nu := physics.largest_locking_nu) >= LOCKING_POISSON_RATIO:
        yield ModelWarning(
            "locking",
            f"nu = {nu:g} with displacement elements: the pressures oscillate, the force is too "
            "high",
        )
    for message in stability.instability_warnings(
        material, stability.largest_strain(setup.relative_tip, a, delta, body.height)
    ):
        yield ModelWarning("stability", message)
    solution = setup.solution(delta) if body.dim == 3 else None
    formula_and_force = half_space_force(setup.relative_tip, delta, physics.contact_modulus)
    if solution and formula_and_force and abs(1 - formula_and_force[1] / solution.force) >= 0.01:
        cause = "the body is not thick enough for a contact this large"
        if len(setup.layers) > 1:
            cause = "the body is layered"
        if physics.surface_tension:
            cause = "its surface is under tension"
        if physics.indenter.elastic_part:
            cause = "body or tip are not thick enough for a contact this large, or layered"
        if physics.domain.rests_on_flat:
            cause = "a part of the depth is the approach of the body and the flat below"
        yield ModelWarning(
            "half_space",
            f"the half-space formula {formula_and_force[0]} does not apply: {cause}",
        )


def _tip_end_warnings(setup: ProblemSetup, gap: str) -> Iterator[ModelWarning]:
    """Yield a warning if the tip's profile ends inside the contact, and how the model treats it."""
    tip = setup.physics.indenter
    delta = setup.max_depth
    end_radius = max_radius(setup.physics.indenter)
    if isinstance(tip.upright, FlatPunch) or not (
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
            "the depth exceeds the radius of the sphere, which is modelled as a whole sphere "
            f"except for a stem within {STEM_HALF_ANGLE:g} degrees of its top"
        )
    yield ModelWarning("tip_end", message)
    # A tip that reaches deeper than 100 radii is a needle, or a unit is wrong.
    if delta > 100.0 * end_radius:
        message = (
            f"the depth is {delta / end_radius:.3g} times the radius at which the tip ends: do "
            "depth and tip have the same unit?"
        )
        yield ModelWarning("units", message)


def _attraction_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Yield a warning if the attraction reaches beyond the edge of the body."""
    lateral_extent = setup.physics.body.lateral_extent(setup.physics.center)
    if (
        setup.attraction is None
        or not setup.attraction.range
        or lateral_extent >= max_radius(setup.relative_tip)
    ):
        return
    gap_at_edge = float(setup.relative_tip.height(lateral_extent, 0.0))
    gap_ratio = gap_at_edge / setup.attraction.range
    if gap_ratio < ATTRACTION_CUTOFF:
        gap_text = (
            f"the body ends where its gap to the tip is {gap_ratio:.2g} ranges of the attraction"
        )
        yield ModelWarning(
            "adhesion_rim",
            f"adhesion: {gap_text}; the attraction beyond the edge of the body is neglected",
        )


def _adhesion_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Yield a warning if the range of the attraction is too long for the JKR limit.

    The criterion is a pull-off force by Maugis-Dugdale on a half-space that differs from the JKR
    limit by more than 1 %.
    """
    limit = setup.jkr_limit
    if limit is None or limit.range is None:
        return
    radius = setup.relative_tip.radius_scale(setup.a)
    if radius is None:
        return
    # This import loads scipy, which other scenes do not need.
    from indent_sim.theory.maugis import (
        maugis_lambda,
        maugis_pull_off,
        tabor_number,
    )

    parameters = limit.work, limit.range, radius, setup.physics.material.E_star
    pull_off_factor = maugis_pull_off(maugis_lambda(*parameters))
    if abs(pull_off_factor / -1.5 - 1) > 0.01:
        range_text = (
            f"at a Tabor number of {tabor_number(*parameters):.3g} the range of the attraction is "
            "not short"
        )
        pull_off_text = (
            f"on a half-space the pull-off force is {-pull_off_factor:.4g} pi work R "
            "(Maugis-Dugdale), but 1.5 pi work R in the JKR limit"
        )
        yield ModelWarning("adhesion", f"adhesion: {range_text}: {pull_off_text}")
