"""Effects that a model may neglect, in per cent of the force.

An effect is 100 (F_with/F_without - 1), with the forces F at the deepest row and at the same depth.
Both are solutions of scenes: by theory if it is exact for both, otherwise on the same mesh, whose
discretisation error largely cancels. If the scene does not have the effect, its parameter is varied
up to the threshold at which the effect exceeds the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run.model_selection.variant_solver import VariantSolver
from indent_sim.theory.solution import SOLUTION_ERRORS

# Ratio of successive values of a varied parameter. An effect that exceeds the tolerance only
# between two of them is not found.
FIRST_STEP_RATIO = 1.5
# The ratio shrinks to this value towards parameters for which a scene cannot be solved.
MIN_STEP_RATIO = 1.03
# A parameter is varied by at most this factor in either direction.
MAX_PARAMETER_RANGE = 1e6
# A parameter is varied until the force has changed by this fraction.
MAX_FORCE_CHANGE = 0.5
# Relative width of the interval of a threshold, in which the effect is interpolated linearly.
THRESHOLD_TOLERANCE = 0.01


@dataclass(frozen=True)
class Effect:
    """Relative change of the force by an effect.

    Attributes
    ----------
    name
        Name of the effect.
    percent
        Change of the force [per cent]; None if only a range is known.
    low, high
        Bounds of the change [per cent]; None if there is no bound.
    source
        Description of the solutions that were compared, or the reason why the change is unknown.
    needs
        Threshold of a parameter that the scene does not have, such as "above 1 % from work =
        4.6e-06"; empty if there is none.
    """

    name: str
    percent: float | None
    low: float | None
    high: float | None
    source: str
    needs: str = ""

    @property
    def max_change(self) -> float:
        """Largest possible absolute change [per cent]; infinite if nothing is known."""
        if self.percent is None and (self.low is None or self.high is None):
            return 0.0 if self.needs else inf
        return max(
            abs(change) for change in (self.percent, self.low, self.high) if change is not None
        )

    def scaled(self, gain: float) -> Effect:
        """The effect with its changes multiplied by a factor."""
        percent, low, high = (
            None if change is None else gain * change
            for change in (self.percent, self.low, self.high)
        )
        return replace(self, percent=percent, low=low, high=high)

    @property
    def is_possible(self) -> bool:
        """True if the scene has the effect, or could have it with another parameter."""
        return bool(self.percent != 0.0 or self.needs or self.low or self.high)


def solve_effect(name: str, find: Callable[[], Effect]) -> Effect:
    """Evaluate an effect; if a scene cannot be solved, its source states the reason.

    Parameters
    ----------
    name
        Name of the effect.
    find
        Computes the effect; it may raise NotConverged, ConfigError or an error of a theory.
    """
    try:
        # Theories try depths beyond the end of a tip, where numbers are not finite.
        with np.errstate(all="ignore"):
            return find()
    except (NotConverged, ConfigError, *SOLUTION_ERRORS) as error:
        return Effect(name, None, None, None, f"not solved: {error}")


@dataclass(frozen=True)
class FixedEffect:
    """A known effect: bounds of the relative change of the force, and the change if it is known."""

    low: float
    high: float
    source: str
    change: float | None = None


def no_effect(reason: str) -> FixedEffect:
    """An effect that the scene cannot have."""
    return FixedEffect(0.0, 0.0, reason, 0.0)


@dataclass(frozen=True)
class UnknownEffect:
    """An unknown effect, since the force with or without it is unknown; `needs` as in Effect."""

    reason: str
    needs: str = ""


@dataclass(frozen=True)
class VariantPair:
    """An effect as the ratio of the forces of two scenes, one with the effect and one without."""

    with_effect: Config
    without_effect: Config
    source: str


@dataclass(frozen=True)
class ThresholdSearch:
    """Search of the threshold of an effect that the scene does not have.

    The effect is a function of a variable x > 0 and vanishes as x tends to 0.

    Attributes
    ----------
    parameter
        Name of the parameter in texts.
    force_ratio
        F_with/F_without as a function of x.
    initial
        Value of x at which the search begins.
    source
        Description of the solutions that are compared.
    displayed_value
        Value of the parameter as a function of x.
    direction
        Text after the threshold, such as " or less"; empty if larger values have the effect.
    max_value
        Largest value of x.
    digits
        Digits of the first threshold in texts; further ones have one more.
    """

    parameter: str
    force_ratio: Callable[[float], float]
    initial: float
    source: str
    displayed_value: Callable[[float], float] = lambda x: x
    direction: str = ""
    max_value: float = inf
    digits: int = 2


EffectSource = FixedEffect | UnknownEffect | VariantPair | ThresholdSearch


@dataclass(frozen=True)
class EffectRow:
    """A row of the table of effects.

    Attributes
    ----------
    name
        Name of the effect.
    find_source
        Chooses the scenes to compare, for a scene and a relative tolerance.
    """

    name: str
    find_source: Callable[[VariantSolver, float], EffectSource]

    def effect(self, solver: VariantSolver, tolerance: float) -> Effect:
        """The effect on a scene.

        Parameters
        ----------
        solver
            The scene, which solves its variants.
        tolerance
            Relative change of the force from which on an effect matters.

        Returns
        -------
        Effect
            If a scene cannot be solved, its source states the reason.
        """
        return solve_effect(
            self.name,
            lambda: self._evaluate(self.find_source(solver, tolerance), solver, tolerance),
        )

    def _evaluate(
        self, effect_source: EffectSource, solver: VariantSolver, tolerance: float
    ) -> Effect:
        """Compute the effect from its source."""
        match effect_source:
            case UnknownEffect(reason, needs):
                return Effect(self.name, None, None, None, reason, needs)
            case FixedEffect(low, high, source, change):
                return Effect(self.name, change and 100 * change, 100 * low, 100 * high, source)
            case VariantPair(with_effect, without_effect, source):
                percent = 100 * (solver.force_ratio(with_effect, without_effect) - 1)
                return Effect(self.name, percent, percent, percent, source)
        return self._threshold_effect(effect_source, tolerance)

    def _threshold_effect(self, search: ThresholdSearch, tolerance: float) -> Effect:
        """Effect whose thresholds are known, and ranges beyond them in which it is small again."""
        samples, stop_reason = sample_changes(search, tolerance)
        last_text = f"{search.displayed_value(samples[-1][0]):.{search.digits}g}"
        indexed_crossings = enumerate(threshold_crossings(search, samples, tolerance))
        thresholds = [
            f"{search.displayed_value(x):.{search.digits + (k > 0)}g}" for k, x in indexed_crossings
        ]
        if thresholds:
            needs = (
                f"above {100 * tolerance:g} % from {search.parameter} = {thresholds[0]}"
                f"{search.direction}"
            )
        else:
            needs = f"{search.parameter}: below {100 * tolerance:g} % at all values that were tried"
        source = f"{search.source}, tried as far as {last_text}{stop_reason}"
        range_ends = [*thresholds[1:], last_text][: 2 * (len(thresholds) // 2)]
        small_ranges = " and ".join(
            f"from {start} to {end}"
            for start, end in zip(range_ends[::2], range_ends[1::2], strict=True)
        )
        if small_ranges:
            needs += f", except {small_ranges}"
        return Effect(self.name, None, None, None, source, needs)


# Value of x and relative change of the force.
Sample = tuple[float, float]
Samples = list[Sample]


def sample_changes(search: ThresholdSearch, tolerance: float) -> tuple[Samples, str]:
    """Sample the relative change of the force over the variable x of a parameter.

    Samples begin where the change is below the tolerance, and end where it exceeds
    MAX_FORCE_CHANGE, where x has its largest value, or where a scene cannot be solved.

    Parameters
    ----------
    search
        The parameter.
    tolerance
        Relative change of the force from which on the effect matters.

    Returns
    -------
    samples
        Values of x in ascending order and the relative changes of the force.
    stop_reason
        Text on the scene that could not be solved; empty if there is none.

    Raises
    ------
    NotConverged
        If no value of x has a change below the tolerance.
    """
    x = search.initial
    stop_reason = ""
    change = search.force_ratio(x) - 1
    while abs(change) >= tolerance:
        x /= FIRST_STEP_RATIO**2
        change = search.force_ratio(x) - 1
        if x < search.initial / MAX_PARAMETER_RANGE:
            raise NotConverged(
                f"{search.parameter} changes the force by more than the tolerance at all values "
                "that were tried"
            )
    samples = [(x, change)]
    step = FIRST_STEP_RATIO
    while (
        abs(change) < MAX_FORCE_CHANGE
        and x < min(search.max_value, search.initial * MAX_PARAMETER_RANGE)
        and step > MIN_STEP_RATIO
    ):
        next_x = min(x * (step if abs(change) > tolerance / 10 else step**2), search.max_value)
        try:
            change = search.force_ratio(next_x) - 1
        except (NotConverged, ConfigError, *SOLUTION_ERRORS) as error:
            stop_reason = f"; beyond that not solved: {error}"
            step = step**0.5
            continue
        x = next_x
        samples.append((x, change))
    return samples, stop_reason


def threshold_crossings(search: ThresholdSearch, samples: Samples, tolerance: float) -> list[float]:
    """Values of x, ascending, at which the absolute change passes the tolerance."""
    level_intervals = [
        (low, high, level) for low, high in pairwise(samples) for level in (tolerance, -tolerance)
    ]
    brackets = [
        (level, low, high)
        for low, high, level in level_intervals
        if (low[1] - level) * (high[1] - level) < 0
    ]
    return sorted(
        _bisect_threshold(lambda x: search.force_ratio(x) - 1, *bracket) for bracket in brackets
    )


def _bisect_threshold(
    change: Callable[[float], float], level: float, low: Sample, high: Sample
) -> float:
    """Value of x at which a change passes a level between two samples.

    The interval is bisected to THRESHOLD_TOLERANCE, and the change is interpolated in it.
    """
    while high[0] > low[0] * (1 + THRESHOLD_TOLERANCE):
        x = (low[0] * high[0]) ** 0.5
        middle = x, change(x)
        low, high = (middle, high) if (middle[1] - level) * (low[1] - level) > 0 else (low, middle)
    return low[0] + (high[0] - low[0]) * (level - low[1]) / (high[1] - low[1])
