"""Choices of the solver: theory or mesh, condensed or full model, direct or iterative."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.contact import AutoContact
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.unbounded_bodies import UnboundedBody
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice
from indent_sim.scene.cost import DENSE_BYTES, MAX_CANDIDATES, Cost
from indent_sim.scene.measured_constants import MAX_ITERATIVE_NU, MAX_ITERATIVE_STIFFNESS
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.reasons import first_reason
from indent_sim.scene.reference_theory import NO_INCLUSIONS
from indent_sim.scene.resolution import target_error
from indent_sim.scene.tip_theories import theory_tip_shape

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


WHOLE_BODY_WHY = "solver.linear: iterative requires the whole body (solver.method: newton)"


def solver(config: Config, setup: ProblemSetup, physics: ProblemDefinition, nodes: float) -> Choice:
    """Choose the solution method: condensed or newton.

    A linear elastic body with the gap at the undeformed point is condensed to one surface
    compliance, unless the contact law prevents it (`reason_not_condensable`). The compliance matrix
    is dense and therefore limited to MAX_CANDIDATES nodes.

    Parameters
    ----------
    config : Config
        The scene file.
    setup : ProblemSetup
        The nondimensional problem before mesh and solver are chosen.
    physics : ProblemDefinition
        The problem with its contact law and gap.
    nodes : float
        Predicted number of candidate nodes of the contact, times displacement components per node.

    Returns
    -------
    Choice
        "condensed" or "newton".

    Raises
    ------
    ConfigError
        If the requested method cannot solve the scene.
    """
    requested = config.solver.method
    law = physics.contact
    size_text = (
        f"{nodes:.2g} nodes may come into contact: the dense matrices need "
        f"{DENSE_BYTES * nodes**2 / 1e9:.2g} GB"
    )
    obstacle = first_reason(
        (not physics.small_strain, "the material is not linear"),
        (physics.yields, "the material yields"),
        (physics.gap == "current", "the gap at the deformed point makes the problem nonlinear"),
        (bool(law.reason_not_condensable), law.reason_not_condensable),
        (bool(physics.permeable_regions), "the pore pressure is an unknown inside the body"),
        (
            bool(physics.relaxing_regions),
            "the shear modulus relaxes, and the bulk modulus does not",
        ),
        (config.solver.linear == "iterative", WHOLE_BODY_WHY),
        (
            nodes > MAX_CANDIDATES,
            f"about {size_text} (static condensation is limited to {MAX_CANDIDATES} nodes)",
        ),
    )
    tip = physics.indenter.elastic_part
    is_linear_tip = tip is not None and tip.material.is_small_strain
    if obstacle and (is_linear_tip or physics.domain.rests_on_flat):
        two_bodies = "indenter.material" if is_linear_tip else "body.base"
        problem = f"is solved by static condensation, but {obstacle}"
        raise ConfigError(two_bodies, problem, "use a rigid tip, and a base that is bonded")
    if requested == "condensed" and obstacle:
        raise ConfigError(
            "solver.method", f"'condensed' does not fit this scene: {obstacle}", "use 'newton'"
        )
    if requested != "auto":
        return Choice("solver.method", requested, "as given")
    why = obstacle or "linear body, gap at the undeformed point: one factorization for all steps"
    if setup.truncation and (theory_reason := theory_obstacle(config, setup)) != why:
        why = f"{why}; not theory: {theory_reason}"
    return Choice("solver.method", "newton" if obstacle else "condensed", why)


def iterative_obstacle(config: Config, physics: ProblemDefinition, sizes: Sizes) -> str:
    """Return the reason why linear systems cannot be solved iteratively; empty if they can."""
    law = physics.contact
    locking_nu = physics.largest_locking_nu
    stiffness_multiple = getattr(law, "stiffness", 0.0) * sizes.h_contact / physics.material.E_star
    # The reason for curved roller walls was measured on a half and a quarter of a rubber cylinder:
    # no equilibrium was found within 23 Newton iterations, however short the step. Linear bodies
    # with such a wall take 83 Krylov iterations, and 45 with a free wall.
    return first_reason(
        (physics.domain.dim == 2, "axisymmetric and plane problems are solved directly"),
        (bool(law.reason_unsymmetric), law.reason_unsymmetric),
        (
            bool(physics.permeable_regions),
            "the preconditioner does not support the pore pressure",
        ),
        (
            bool(physics.relaxing_regions),
            "bodies with shear relaxation are factorized once for each length of the time step",
        ),
        (physics.yields, "the preconditioner does not support bodies that yield"),
        (
            law.multiplier in ("stress", "nodal"),
            f"{law.method} has a tangent that is not symmetric",
        ),
        (
            locking_nu > MAX_ITERATIVE_NU,
            f"displacement elements at nu = {locking_nu:g} need too many iterations",
        ),
        (
            stiffness_multiple > MAX_ITERATIVE_STIFFNESS,
            f"a contact stiffness of {stiffness_multiple:.2g} E*/h_contact needs too many "
            "iterations",
        ),
        (
            bool(physics.wall_stiffness) and not physics.small_strain,
            (
                "at finite strain, iterative solvers do not converge with the weak condition on a "
                "curved roller wall"
            ),
        ),
        (config.solver.method == "condensed", "solver.method: condensed factorizes the body once"),
    )


def linear_solver(
    config: Config,
    physics: ProblemDefinition,
    sizes: Sizes,
    direct: Cost,
    iterative: Cost,
    available_memory: float,
) -> Choice:
    """Choose the solver of the linear systems: direct or iterative.

    Parameters
    ----------
    config : Config
        The scene file.
    physics : ProblemDefinition
        The problem with its contact law and gap.
    sizes : Sizes
        The element sizes, nondimensional.
    direct, iterative : Cost
        Predicted costs of both solvers.
    available_memory : float
        Memory of this machine [bytes].

    Returns
    -------
    Choice
        "direct" or "iterative".

    Raises
    ------
    ConfigError
        If an iterative solver is requested that cannot solve the scene.
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
    # An iterative solver is chosen only if it saves this many seconds, since a factorization never
    # fails.
    min_seconds_saved = 2.0
    is_worth_it = direct.seconds - iterative.seconds > min_seconds_saved
    # It must also take less than this fraction of the time of a factorization, because predicted
    # times are inaccurate.
    max_time_ratio = 0.8
    is_cheaper = is_worth_it and iterative.seconds < max_time_ratio * direct.seconds
    is_needed = direct.memory > available_memory >= iterative.memory
    solver_kind = "iterative" if is_cheaper or is_needed else "direct"
    return Choice(
        "solver.linear",
        solver_kind,
        f"predicted cost: direct {cost_texts[0]}, iterative {cost_texts[1]}",
    )


def theory(config: Config, setup: ProblemSetup) -> Choice | None:
    """Choose theory as the solver if it can solve the scene; None if a mesh is needed.

    Raises
    ------
    ConfigError
        If theory is requested and cannot solve the scene.
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
        "the force is too large"
        if setup.theory.tension_fraction
        else f"the relative error of the force is {setup.theory.error:.0e}"
    )
    why = f"{setup.theory.reason}: {error_text}; no mesh is needed"
    return Choice("solver.method", "theory", f"as given; {why}" if requested == "theory" else why)


def theory_obstacle(config: Config, setup: ProblemSetup) -> str:
    """Return the reason why theory cannot solve a scene as requested; empty if it can."""
    if config_reason := config_obstacle(config):
        return config_reason
    reference_theory = setup.theory
    target = target_error(config.accuracy)
    if reference_theory is None:
        has_shape = theory_tip_shape(setup.physics.indenter) is not None
        return (
            "theory needs nu >= 0 in all layers" if has_shape else "there is no theory for this tip"
        )
    if not reference_theory.is_exact and not (
        reference_theory.tension_fraction and config.solver.method == "theory"
    ):
        return reference_theory.reason
    if target is not None and target < reference_theory.error:
        return (
            f"the relative error of the theory is {reference_theory.error:.0e}, but accuracy asks "
            f"for {target:g}"
        )
    if not reference_theory.covers_path(setup.max_depth, setup.physics.largest_force):
        return (
            "the deepest contact is outside the range of the theory: it reaches a wall, the end of "
            "the tip, or a radius of 100 layer thicknesses"
        )
    return ""


def config_obstacle(config: Config) -> str:
    """Return why the config alone prevents a solution by theory; empty if it does not."""
    materials = [layer.material for layer in config.layers if layer.material]
    law = config.contact
    other_settings = replace(config.solver, method="auto")
    return first_reason(
        (isinstance(config.body, MeshFromFile), "there is no theory for a body from a mesh file"),
        (not all(material.is_small_strain for material in materials), "the material is not linear"),
        (any(material.plasticity for material in materials), "the theory does not include yield"),
        (
            any(material.flow for _, material in config.materials()),
            "the theory does not include pore fluid",
        ),
        (
            any(material.has_shear_relaxation for _, material in config.materials()),
            "the theory does not include relaxation of the shear modulus alone",
        ),
        (bool(config.body.inclusions), NO_INCLUSIONS),
        (
            not config.tip.is_axisymmetric,
            f"theory needs an axisymmetric tip, but a {config.tip.shape} is not axisymmetric",
        ),
        (law.gap == "current", "theory evaluates the gap at the undeformed point"),
        (not isinstance(law, AutoContact), f"contact.method: {law.method} needs a mesh"),
        (
            bool(law.feature_without_theory),
            f"the theory does not include {law.feature_without_theory}",
        ),
        (
            other_settings != type(other_settings)(),
            "solver.linear, solver.rtol and solver.max_iterations need a mesh",
        ),
        (
            config.mesh != type(config.mesh)(),
            "keys of the section 'mesh' are given, but the theory uses no mesh",
        ),
        (
            any(material.formulation != "auto" for material in materials),
            "material.formulation needs a mesh",
        ),
        (
            config.output.fields in ("last", "all"),
            f"output.fields: {config.output.fields} needs a mesh",
        ),
    )


def needs_mesh(config: Config) -> bool:
    """True if the config alone shows that the scene needs a mesh."""
    is_for_theory = isinstance(config.body, UnboundedBody) or config.solver.method == "theory"
    return (
        config.solver.method in ("condensed", "newton")
        or not is_for_theory
        or bool(config_obstacle(config))
    )
