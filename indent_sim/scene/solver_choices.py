"""Choices of the solver: theory or a mesh, condensed or whole body, direct or iterative."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import MeshFromFile, UnboundedBody
from indent_sim.model.contact import (
    AutoContact,
)
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice
from indent_sim.scene.cost import DENSE_BYTES, MAX_CANDIDATES, Cost
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.reasons import first_reason
from indent_sim.scene.reference_theory import NO_INCLUSIONS
from indent_sim.scene.resolution import target_error
from indent_sim.scene.tip_theories import theory_tip_shape
from indent_sim.theory.theory import MAX_KEPT_SOLUTIONS

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


WHOLE_BODY_WHY = "solver.linear: iterative is for the whole body"

MIN_SECONDS_SAVED = (
    2.0  # of a factorisation, which never fails, that iterations must save to be chosen
)

# of a factorisation's seconds, below which iterations are chosen: a prediction is no better
MAX_TIME_RATIO = 0.8

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
