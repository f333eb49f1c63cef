"""Choices for what is computed from the elastic curve: experiments and histories."""

from __future__ import annotations

from typing import TYPE_CHECKING

from indent_sim.model.experiment import Experiment
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice, Choices
from indent_sim.scene.problem_setup import ProblemSetup

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


JKR_WHY = "the JKR limit: exact for this body where the attraction's range is short"

TING_WHY = (
    "Lee & Radok while the contact grows, Ting while it shrinks: exact for one body "
    "or layers that relax alike"
)

STEP_WHY = (
    "contact stepped in time on the compliance, to 1e-4: the history is no single cycle of depths"
)

QUASI_WHY = "every point an equilibrium of the elastic curve"

UNITS_REMEDY = "check work, R and E: are they in the same units?"

# of a mesh: between its contacts that come off and the deepest; of the way to the rim
MAX_RADIUS_SPREAD = 500.0

MAX_RIM_FRACTION = 0.95


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
