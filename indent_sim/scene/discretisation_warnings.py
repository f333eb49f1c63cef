"""Warnings about the contact law, the friction and the mesh of a scene, before it is solved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from math import inf

from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.sizes import DOUBTFUL_ELEMENTS, Sizes
from indent_sim.model.contact import ContactLaw, Nitsche, Penalty
from indent_sim.scene.expected_error import (
    FORCE_DEPTH_EXPONENT,
    NEGLIGIBLE_ERROR,
    error_text,
    expected_force_error,
    penalty_force_loss,
    penalty_friction_loss,
    stick_force_change,
)
from indent_sim.scene.measured_constants import (
    EQUILIBRIA_DIFFERENCE,
    MAX_SLIPPING_FRICTION,
    MAX_YIELD_INCREMENT_ERROR,
    RADIUS_ERROR,
    TENSION_PRESSURE_LIMIT,
    YIELD_INCREMENT_ERROR,
)
from indent_sim.scene.model_warnings import NO_CONTACT, ModelWarning, theory_warnings
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory.solution import SOLUTION_ERRORS

# Expected relative error of the force from which on a shallow contact gets a warning; it is about
# the error with two elements in the contact radius.
UNDERRESOLVED_ERROR = 0.02
# Largest penalty stiffness, in units of E*/h_contact; beyond it the contact pressures oscillate.
MAX_STIFFNESS_MULTIPLE = 1e3


def scene_warnings(
    setup: ProblemSetup, row_depths: Sequence[float], law: ContactLaw, gap: str, sizes: Sizes
) -> tuple[ModelWarning, ...]:
    """Return warnings about model, contact law and mesh of a scene at the largest depth.

    Coarse elements are also reported for the smallest contact of an output row.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    row_depths : sequence of float
        Expected depths of the output rows whose depth is known in advance [length].
    law : ContactLaw
        The contact law, with its stiffnesses.
    gap : str
        The key `contact.gap`, "reference" or "current".
    sizes : Sizes
        The element sizes.

    Returns
    -------
    tuple of ModelWarning
        The warnings; a warning that only contributes an error estimate has an empty message.
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
        *_yield_warnings(setup),
        *_mesh_warnings(setup, row_depths, sizes),
        *_facet_warnings(setup, sizes),
        *truncation_warnings,
    )


def _contact_law_warnings(
    setup: ProblemSetup, law: ContactLaw, gap: str, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield warnings about errors of the contact law and about a stiffness given in the config."""
    material = setup.physics.material
    theory = setup.theory
    # Nodal pressures on a deformed surface have several equilibria.
    if gap == "current" and law.multiplier == "nodal":
        several_text = (
            "several equilibria with different contact nodes exist, one of which the load steps "
            "select"
        )
        message = (
            f"{law.method} with gap: current: {several_text}, and their forces differ by "
            f"{error_text(EQUILIBRIA_DIFFERENCE)}"
        )
        yield ModelWarning("several_equilibria", message, EQUILIBRIA_DIFFERENCE)
    # The margin for rounding prevents a warning about a stiffness of exactly this size, which the
    # program may choose.
    max_stiffness = (1 + 1e-9) * MAX_STIFFNESS_MULTIPLE * material.E_star / sizes.h_contact
    if isinstance(law, Penalty | Nitsche) and law.stiffness > max_stiffness:
        yield ModelWarning(
            "stiffness",
            "the contact stiffness is more than 1000 E*/h_contact: the pressures oscillate",
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


def _yield_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Yield warnings on plasticity: no yield on the path, elastic strains, long increments."""
    if not setup.physics.yields:
        return
    onset = setup.yielding.onset if setup.yielding else None
    is_only_first_layer = (
        sum(bool(r.material.plasticity) for r in setup.physics.domain.regions) == 1
    )
    if onset and setup.max_depth < onset.delta and is_only_first_layer:
        message = (
            "yield: the body does not yield on this path: yield begins at the depth "
            f"{onset.delta * setup.physics.scales.depth:.4g}, by Hertz and von Mises"
        )
        yield ModelWarning("no_yield", message)
        return
    yield from _yield_strain_warnings(setup)
    # The stress below a plate is uniform, and its increments are exact.
    if setup.physics.is_compressed:
        return
    deltas = setup.physics.deltas
    if setup.physics.path.turns and not setup.physics.path.times:
        return  # the increments follow from the accuracy
    longest = max(after - before for before, after in pairwise((0.0, *deltas))) / setup.max_depth
    error = min(YIELD_INCREMENT_ERROR * longest, MAX_YIELD_INCREMENT_ERROR)
    if error >= NEGLIGIBLE_ERROR:
        message = (
            f"yield: where the body yields, increments of {longest:.2g} of the depth make the "
            f"force up to about {100 * error:.2g} % too low; shorter increments reduce this in "
            "proportion, and --error-bars computes it"
        )
        yield ModelWarning("increments", message)


def _yield_strain_warnings(setup: ProblemSetup) -> Iterator[ModelWarning]:
    """Yield a warning if the elastic strain at yield is too large for the elastic law."""
    # Ratio of Young's modulus and yield stress below which the logarithmic law, which is measured
    # on metals at strains of a per cent, is an assumption.
    least_ratio = 10.0
    ratios = [
        region.material.constants.E / region.material.plasticity.yield_stress
        for region in setup.physics.domain.regions
        if region.material.plasticity
    ]
    if min(ratios) < least_ratio:
        message = (
            f"yield: E/yield_stress is {min(ratios):.3g}, so that the elastic strain at yield is "
            f"{1 / min(ratios):.0%}, at which no metal or glass is elastic: do both have the same "
            "unit?"
        )
        yield ModelWarning("yield_strain", message)


def _friction_warnings(
    setup: ProblemSetup, law: ContactLaw, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield a warning if epsilon_t changes the effect of friction on the force.

    The friction force itself is unknown before the scene is solved; a change of 5 % of its effect
    is reported.
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


def _mesh_warnings(
    setup: ProblemSetup, row_depths: Sequence[float], sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield warnings about surface tension, moduli, corners and the elements in the contact."""
    if (tension_ratio := setup.elastocapillary_length / setup.a) > TENSION_PRESSURE_LIMIT:
        step_text = (
            f"gamma/E* is {tension_ratio:.2g} contact radii: the pressure falls to zero in a step"
        )
        yield ModelWarning(
            "p_max",
            f"{step_text}, where p_max of a mesh is up to 5 % too large; the force is not affected",
        )
    if setup.physics.is_drop:
        # Largest relative error of the force by the membrane that holds the surface of a drop in
        # its plane.
        surface_membrane_error = 5e-4
        yield ModelWarning("drop", "", surface_membrane_error)
    moduli = [region.material.constants.E for region in setup.physics.domain.regions]
    # Ratio of moduli up to which stacks of random layers were compared with theory: 1000, and a
    # margin for rounding.
    verified_contrast = 1001.0
    if max(moduli) > verified_contrast * min(moduli):
        message = (
            f"the moduli differ by a factor of {max(moduli) / min(moduli):.0e}; automatic element "
            "sizes have been tested only up to 1000"
        )
        yield ModelWarning(
            "contrast", f"{message}: set `accuracy`, or compare the force with that of a finer mesh"
        )
    if sizes.corner_error >= NEGLIGIBLE_ERROR:
        bound_text = f"the force may be too high by up to {error_text(sizes.corner_error)}"
        remedy = "use smaller element sizes in `mesh`, or leave the sizes out"
        message = f"coarse elements at corners close to the contact: {bound_text}; {remedy}"
        yield ModelWarning("corners", message, sizes.corner_error)
    yield from _element_warnings(setup, row_depths, sizes)


def _element_warnings(
    setup: ProblemSetup, row_depths: Sequence[float], sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield a warning about coarse elements in the contact or at the edge of a punch."""
    nu = setup.physics.largest_nu
    a = setup.a
    force_error, last_row_error = _deepest_and_last_error(
        setup, lambda delta, a: expected_force_error(sizes, a, nu)
    )
    shallowest = _expected_radius(
        setup, min((delta for delta in row_depths if delta > 0), default=setup.max_depth)
    )
    message = ""
    if (
        sizes.punch_edge is not None
        and sizes.h_edge is not None
        and force_error >= NEGLIGIBLE_ERROR
    ):
        advice = refinement_advice(sizes, "give a smaller mesh.h_contact or mesh.h_edge")
        low_text = f"the force may be too low by {error_text(force_error)}; {advice}"
        message = (
            f"elements of {sizes.h_edge / sizes.punch_edge:.2g} radii at the punch's edge: "
            f"{low_text}"
        )
    elif not sizes.is_resolved(a):
        advice = refinement_advice(
            sizes, f"use mesh.h_contact of at most {1 / DOUBTFUL_ELEMENTS:.2g} contact radii"
        )
        wrong_text = (
            f"the force may be wrong by {error_text(force_error)}, the contact radius by up to "
            f"{RADIUS_ERROR / sizes.elements_in_contact(a):.0%}; {advice}"
        )
        message = (
            f"only {a / sizes.h_contact:.2g} elements in the expected contact radius: {wrong_text}"
        )
    elif (
        not sizes.is_resolved(shallowest)
        and (shallow_error := expected_force_error(sizes, shallowest, nu)) >= UNDERRESOLVED_ERROR
    ):
        element_text = (
            f"the contact radius is only {shallowest / sizes.h_contact:.2g} times the element size"
        )
        wrong_text = f"the force there may be wrong by {error_text(shallow_error)}"
        message = (
            "the elements resolve the largest contact; in the smallest one "
            f"{element_text}, and {wrong_text}"
        )
    if message or last_row_error:
        yield ModelWarning("elements", message, last_row_error)


def refinement_advice(sizes: Sizes, advice: str) -> str:
    """Return `advice` on smaller elements, or advice to refine a mesh that comes from a file."""
    return advice if sizes.refinements is None else "increase mesh.refinements"


def _facet_warnings(setup: ProblemSetup, sizes: Sizes) -> Iterator[ModelWarning]:
    """Yield a warning about flat facets of an imported mesh that may approximate a curved surface.

    The facets lie inside the curved surface, so that the effective depth is too small.
    """
    physics = setup.physics
    if not isinstance(physics.domain, ImportedDomain):
        return
    sag = physics.domain.facet_sagitta(physics.center, setup.a, sizes.refinements or 0)
    if (error := FORCE_DEPTH_EXPONENT * sag / setup.max_depth) >= NEGLIGIBLE_ERROR:
        sag_text = (
            f"they lie up to {sag * physics.scales.length:.2g} inside it, which changes the force "
            f"by {error_text(error)}"
        )
        yield ModelWarning(
            "facets",
            f"flat facets under the tip: if they approximate a curved surface, {sag_text}",
        )


def _deepest_and_last_error(
    setup: ProblemSetup, error: Callable[[float, float], float]
) -> tuple[float, float]:
    """Return error(depth, contact radius) at the largest depth and at the last row.

    The error at the last row is 0 if there is no contact.
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

    For an adhesive tip it is the radius in the JKR limit, or infinity if there is no theory.
    """
    if setup.attraction is None:
        return setup.expected_radius(delta)
    with suppress(*SOLUTION_ERRORS):
        if setup.jkr and (contact := setup.jkr.stable_equilibrium(delta)):
            return max(contact.a, setup.expected_radius(delta))
    return inf
