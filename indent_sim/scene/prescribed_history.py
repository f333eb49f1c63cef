"""Properties of a prescribed history that the problem setup needs: depth, modulus, steps."""

from __future__ import annotations

from math import ceil, sqrt
from typing import TYPE_CHECKING

from indent_sim.model.loading import STEPS_PER_DOUBLING, History
from indent_sim.model.materials import PronySeries, Relaxation
from indent_sim.scene.resolution import target_error

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


# Of the force, with PER_DOUBLING steps of each length; of second order in them. What rubs is known
# to less: its error bar is five times what half steps change
TIME_STEPPING_ERROR = 0.004
FRICTION_STEPPING_ERROR = 0.02


def needs_time_stepping(history: History | None, law: Relaxation | None, compliance: float) -> bool:
    """Whether a relaxing body is followed step by step: forces or springs, or a tip that comes
    back.
    """
    is_any = history is not None and (
        history.control == "force" or compliance > 0 or history.has_reloading
    )
    return law is not None and is_any


def prony_series(law: Relaxation, shortest: float, longest: float) -> PronySeries:
    """A relaxation as a sum of exponentials; a power law to 1e-5 between two times [time]."""
    if law.power_law is None:
        fractions, times = zip(*(law.prony or ()), strict=True)
        return PronySeries(1.0 - sum(fractions), fractions, times)
    from indent_sim.theory.viscoelasticity import (
        PowerLaw,
    )  # with scipy's splines, which no other scene needs

    series = PowerLaw(law.power_law.exponent, law.power_law.time).prony_series(shortest, longest)
    return PronySeries(series.long_term, series.fractions, series.times)


def remaining_modulus_fraction(law: Relaxation | None, history: History | None) -> float:
    """The least share of the instantaneous modulus that a body has during a history; of a power law
    it may be above 1.
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
    """Steps in time of one length, as given or as the accuracy asks: errors fall with their square."""
    default_error = (
        TIME_STEPPING_ERROR if config.contact.is_conservative else FRICTION_STEPPING_ERROR
    )
    step_factor = ceil(sqrt(default_error / (target_error(config.accuracy) or default_error)))
    return config.loading.per_doubling or STEPS_PER_DOUBLING * max(1, step_factor)
