"""Choices for experiments and histories that are computed from the elastic curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from indent_sim.model.experiment import Experiment
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice, Choices
from indent_sim.scene.prescribed_history import CurveMethod
from indent_sim.scene.problem_setup import ProblemSetup

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


# Reason for each method by which a history is evaluated on the elastic curve.
METHOD_REASONS: dict[CurveMethod, str] = {
    "JKR": "the JKR limit: exact for this body if the range of the attraction is short",
    "equilibria": "quasi-static: every point is an equilibrium on the elastic curve",
    "quadrature": (
        "Lee & Radok while the contact grows, Ting while it shrinks: exact for a homogeneous body, "
        "or for layers that relax alike"
    ),
    "time steps": (
        "viscoelastic time stepping on the surface compliance, with an error of 1e-4: the history "
        "is not one loading and unloading with prescribed depths"
    ),
}
UNITS_REMEDY = "check that work, R and E are in consistent units"


def curve(
    config: Config, setup: ProblemSetup, solver: Choice, follows_history: bool = False
) -> Choices:
    """Return the choices for the evaluation of an experiment and a history.

    Parameters
    ----------
    config : Config
        The scene file.
    setup : ProblemSetup
        The nondimensional problem.
    solver : Choice
        The chosen solver, with its reason.
    follows_history : bool, optional
        True if the load path is the history, which is solved step by step on the mesh.

    Returns
    -------
    list of Choice
        Empty without experiment and history.

    Raises
    ------
    ConfigError
        If the elastic curve does not determine the requested results.
    """
    if setup.experiment is None and setup.history is None:
        return []
    if follows_history:
        reason = solver.why if solver.value == "newton" else config.contact.reason_no_elastic_curve
        _refuse_curve_features(setup, reason)
        return [Choice("time", "steps", f"solved on the mesh, row by row: {reason}")]
    _refuse_curve(
        config,
        setup,
        solver,
        "experiment" if setup.experiment else f"loading.{config.loading.given_path_keys[0]}",
    )
    choices = []
    if setup.jkr_limit:
        choices.append(Choice("experiment.adhesion", "JKR", METHOD_REASONS["JKR"]))
    if setup.curve_method:
        choices.append(Choice("time", "curve", METHOD_REASONS[setup.curve_method]))
    return choices


def _refuse_curve_features(setup: ProblemSetup, why: str) -> None:
    """Raise ConfigError if a property needs an elastic curve; `why` explains why there is none."""
    if setup.relaxation:
        problem = f"'all' needs the elastic curve of a linear, frictionless contact: {why}"
        raise ConfigError(
            "material.relaxation.of",
            problem,
            "use of: shear, or remove the part of the model that is named as the reason",
        )
    if experiment_part := next(
        (name for name, part in vars(setup.experiment or Experiment()).items() if part), None
    ):
        problem = f"needs an elastic curve, but this scene is solved row by row: {why}"
        remedy = "leave it out, or remove the part of the model that is named as the reason"
        raise ConfigError(f"experiment.{experiment_part}", problem, remedy)


def _refuse_curve(config: Config, setup: ProblemSetup, solver: Choice, key: str) -> None:
    """Raise ConfigError if the elastic curve does not determine what `key` requests."""
    physics = setup.physics
    if setup.history and config.output.fields in ("last", "all"):
        problem = (
            f"{config.output.fields}: no fields are available, because a history is evaluated on "
            "the elastic curve"
        )
        raise ConfigError("output.fields", problem, "leave it out")
    if config.contact.reason_no_elastic_curve:
        problem = (
            "needs the elastic curve of a tip without friction and adhesion, but the contact of "
            "this scene has friction or adhesion"
        )
        raise ConfigError(key, problem, f"leave {key} out, or remove friction and adhesion")
    if solver.value == "newton":
        problem = (
            "needs a linear body with a known surface compliance, but this scene is solved with "
            f"the finite-element model of the whole body (newton): {solver.why}"
        )
        raise ConfigError(
            key,
            problem,
            "set solver.method to condensed or theory; if that is not possible, its message names "
            "the reason",
        )
    if setup.jkr_limit and physics.domain.kinematics.name != "axisymmetric":
        problem = (
            "the JKR limit needs a circular contact, but this scene is "
            f"{physics.domain.kinematics.name.replace('_', ' ')}"
        )
        raise ConfigError("experiment.adhesion", problem, "put the tip on the axis of a round body")
    if setup.jkr_limit and not setup.adhesive_radii:
        problem = (
            "the adhesive contact is beyond the range of the theory, or does not exist at this "
            "depth"
        )
        raise ConfigError("experiment.adhesion", problem, UNITS_REMEDY)
    if setup.jkr_limit and solver.value == "condensed" and setup.adhesive_radii:
        _refuse_radius_range(setup, *setup.adhesive_radii)
    if setup.curve_method == "time steps" and solver.value == "theory" and physics.body.dim == 2:
        problem = (
            "this history of a relaxing strip needs time stepping on the surface compliance of a "
            "mesh"
        )
        raise ConfigError("material.relaxation", problem, "use solver.method: condensed")


def _refuse_radius_range(setup: ProblemSetup, smallest: float, largest: float) -> None:
    """Raise ConfigError if one mesh cannot resolve all contacts, from pull-off to the deepest."""
    L = setup.physics.scales.length
    rim = setup.physics.body.lateral_extent(setup.physics.center)
    # Largest contact radius over the lateral extent of the body.
    max_rim_fraction = 0.95
    if largest > max_rim_fraction * rim:
        problem = (
            f"widens the contact to a radius of {largest * L:.3g}, but the body ends at a distance "
            f"of {rim * L:.3g} from the tip's axis"
        )
        raise ConfigError("experiment.adhesion.work", problem, UNITS_REMEDY)
    # Largest ratio of contact radii that one mesh resolves.
    max_radius_spread = 500.0
    if largest > max_radius_spread * smallest:
        problem = (
            f"gives a contact radius of {smallest * L:.3g} at pull-off, too small for a mesh that "
            f"also resolves the deepest contact of radius {largest * L:.3g}"
        )
        raise ConfigError(
            "experiment.adhesion.work", problem, "use a smaller depth, or solver.method: theory"
        )
