"""Properties of a prescribed history for the setup of the problem: depth, modulus and steps."""

from __future__ import annotations

from math import ceil, sqrt
from typing import TYPE_CHECKING, Literal

from indent_sim.model.experiment import Experiment
from indent_sim.model.history import History
from indent_sim.model.loading import STEPS_PER_DOUBLING
from indent_sim.model.relaxation import PronySeries, Relaxation
from indent_sim.scene.resolution import target_error
from indent_sim.theory.relaxation_function import PowerLaw

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


# Method by which a history is evaluated on the elastic curve of a body.
CurveMethod = Literal["JKR", "equilibria", "quadrature", "time steps"]


def curve_method(
    history: History, law: Relaxation | None, experiment: Experiment | None
) -> CurveMethod:
    """Return the method by which a history is evaluated on the elastic curve.

    A relaxing body needs viscoelastic time stepping instead of a quadrature for prescribed forces,
    for a tip on a spring, and for repeated loading. A body that relaxes does not adhere.
    """
    if experiment and experiment.adhesion:
        return "JKR"
    if law is None:
        return "equilibria"
    compliance = experiment.compliance if experiment else 0.0
    is_general = history.control == "force" or compliance > 0 or history.has_reloading
    return "time steps" if is_general else "quadrature"


def prony_series(law: Relaxation, shortest: float, longest: float) -> PronySeries:
    """Return the relaxation as a Prony series.

    Parameters
    ----------
    law : Relaxation
        A Prony series or a power law.
    shortest, longest : float
        Range of times [time] in which the series approximates a power law to 1e-5.
    """
    if law.power_law is None:
        fractions, times = zip(*(law.prony or ()), strict=True)
        return PronySeries(1.0 - sum(fractions), fractions, times)
    series = PowerLaw(law.power_law.exponent, law.power_law.time).prony_series(shortest, longest)
    return PronySeries(series.long_term, series.fractions, series.times)


def remaining_modulus_fraction(law: Relaxation | None, history: History | None) -> float:
    """Return the smallest fraction of the instantaneous modulus during a history.

    The fraction can exceed 1 for a power law, which is relative to the modulus at its reference
    time.
    """
    if law is None:
        return 1.0
    if law.power_law is None:
        return 1.0 - sum(fraction for fraction, _ in law.prony or ())
    return (
        float((history.duration / law.power_law.time) ** -law.power_law.exponent)
        if history
        else 1.0
    )


def time_steps_per_doubling(config: Config) -> int:
    """Return the number of time steps before the step size doubles, given or from `accuracy`.

    The error of the time integration falls with the square of this number.
    """
    # Relative error of the force by time stepping with STEPS_PER_DOUBLING steps of each length. It
    # is of second order in the step size. With friction it is known less accurately: the error
    # estimate is three times the change of the force if the step size is halved.
    time_stepping_error = 0.004
    friction_stepping_error = 0.02
    default_error = (
        time_stepping_error if config.contact.is_conservative else friction_stepping_error
    )
    step_factor = ceil(sqrt(default_error / (target_error(config.accuracy) or default_error)))
    return config.loading.per_doubling or STEPS_PER_DOUBLING * max(1, step_factor)
