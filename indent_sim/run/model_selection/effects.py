"""Effects that a model may neglect, in per cent of the force, and the cases that evaluate them.

An effect is 100 (F_with/F_without - 1). Both forces F are taken at the depth of the deepest row and
solved by theory if theory is exact for both scenes, otherwise on the same mesh, whose
discretisation error largely cancels. If the scene does not have the effect, the parameter of the
effect is increased up to the threshold at which the effect exceeds the tolerance.

A table of effects has one entry per effect, with its cases in the order of preference. A case
states the scenes to which it applies, what is compared, and a description. `find_effect` evaluates
the first case that applies.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field, replace
from itertools import pairwise
from math import inf
from typing import Any, TypeVar

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.theory.solution import SOLUTION_ERRORS

# Errors of a variant that cannot be solved.
UNSOLVED = (NotConverged, ConfigError, *SOLUTION_ERRORS)

T = TypeVar("T")
# Function of the variants v of a scene, or a text in which {v.name} is an attribute of them.
FromVariants = Callable[[Any], T]
Text = str | FromVariants[str]


@dataclass(frozen=True)
class Effect:
    """Relative change of the force due to an effect.

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


@dataclass(frozen=True)
class Case:
    """Method to compute an effect, with the condition for its use.

    Attributes
    ----------
    source
        Description of the solutions that are compared, or the reason why the effect is absent or
        unknown.
    when
        True for the scenes to which the case applies.
    """

    source: Text
    when: FromVariants[bool] = field(default=lambda v: True, kw_only=True)


class Absent(Case):
    """Case in which the scene cannot have the effect."""


@dataclass(frozen=True)
class Unknown(Case):
    """Case in which the force with or without the effect is unknown; see `Effect` for `needs`."""

    needs: Text = field(default="", kw_only=True)


@dataclass(frozen=True)
class Comparison(Case):
    """Case in which two variants of the scene are compared, with and without the effect."""

    with_effect: FromVariants[Config]
    without_effect: FromVariants[Config]


@dataclass(frozen=True)
class Change(Case):
    """Case in which the relative change of the force is computed by a function."""

    find: FromVariants[float]


@dataclass(frozen=True)
class Range(Case):
    """Case in which only bounds of the effect are computed.

    `find` returns the lower and the upper bound of the relative change of the force, and the change
    itself or None.
    """

    find: FromVariants[tuple[float, float, float | None]]


@dataclass(frozen=True)
class Threshold(Case):
    """Case in which the scene lacks the effect; its parameter is varied to find a threshold.

    The effect is a function of a variable x > 0 and vanishes as x tends to 0.

    Attributes
    ----------
    parameter
        Name of the parameter in texts.
    force_ratio
        F_with/F_without as a function of the variants and x.
    initial
        Value of x at which the search begins.
    displayed_value
        Value of the parameter as a function of the variants and x.
    direction
        Text after the threshold, such as " or less"; empty if larger values have the effect.
    max_value
        Largest value of x.
    digits
        Number of significant digits of the first threshold in texts; further thresholds have one
        more.
    """

    parameter: Text
    force_ratio: Callable[[Any, float], float]
    _: KW_ONLY
    initial: FromVariants[float]
    displayed_value: Callable[[Any, float], float] = lambda v, x: x
    direction: str = ""
    max_value: FromVariants[float] = lambda v: inf
    digits: int = 2


# The first case that applies to a scene gives the effect; the last one applies to all scenes.
Cases = tuple[Case, ...]


def find_effect(name: str, cases: Cases, v: Any) -> Effect:
    """Compute the effect that is defined by an entry of a table of effects.

    Parameters
    ----------
    name, cases
        The entry: name of the effect, and the cases in which it can be computed.
    v
        Variants of a scene.

    Returns
    -------
    Effect
        The effect. If a variant cannot be solved, `source` states the reason.
    """
    try:
        # Theories try depths beyond the end of a tip, where numbers are not finite.
        with np.errstate(all="ignore"):
            case = next(case for case in cases if case.when(v))
            return _evaluate(name, case, _text(case.source, v), v)
    except UNSOLVED as error:
        return Effect(name, None, None, None, f"not solved: {error}")


def _evaluate(name: str, case: Case, source: str, v: Any) -> Effect:
    """Compute the effect by the method of one case."""
    low = high = 0.0
    change: float | None = 0.0
    match case:
        case Unknown(needs=needs):
            return Effect(name, None, None, None, source, _text(needs, v))
        case Threshold():
            return _threshold_effect(name, case, source, v)
        case Comparison(with_effect=with_effect, without_effect=without_effect):
            low = high = change = v.force_ratio(with_effect(v), without_effect(v)) - 1
        case Change(find=find):
            low = high = change = find(v)
        case Range(find=find_range):
            low, high, change = find_range(v)
    return Effect(name, change and 100 * change, 100 * low, 100 * high, source)


def _text(text: Text, v: Any) -> str:
    """Return a text of the table of effects with values of the scene inserted."""
    return text.format(v=v) if isinstance(text, str) else text(v)


def _threshold_effect(name: str, case: Threshold, source: str, v: Any) -> Effect:
    """Return an effect with the thresholds of its parameter.

    Ranges beyond a threshold in which the effect is small again are also stated.
    """
    search = _ThresholdSearch(case, v)
    samples, stop_reason = search.sample_changes()

    def displayed(x: float, digits: int) -> str:
        """Return the value of the parameter as text."""
        return f"{case.displayed_value(v, x):.{digits}g}"

    last_text = displayed(samples[-1][0], case.digits)
    thresholds = [
        displayed(x, case.digits + (k > 0)) for k, x in enumerate(search.crossings(samples))
    ]
    if thresholds:
        needs = f"above {v.percent:g} % from {search.parameter} = {thresholds[0]}{case.direction}"
    else:
        needs = f"{search.parameter}: below {v.percent:g} % at all values that were tried"
    range_ends = [*thresholds[1:], last_text][: 2 * (len(thresholds) // 2)]
    small_ranges = " and ".join(
        f"from {start} to {end}"
        for start, end in zip(range_ends[::2], range_ends[1::2], strict=True)
    )
    if small_ranges:
        needs += f", except {small_ranges}"
    source = f"{source}, tried up to {last_text}{stop_reason}"
    return Effect(name, None, None, None, source, needs)


# Value of x and relative change of the force.
Sample = tuple[float, float]


class _ThresholdSearch:
    """Search of the values of x at which the force changes by the tolerance."""

    def __init__(self, case: Threshold, v: Any):
        self.parameter = _text(case.parameter, v)
        self._change = lambda x: case.force_ratio(v, x) - 1
        self._initial = case.initial(v)
        self._max_value = case.max_value(v)
        self._tolerance = v.tolerance

    def sample_changes(self) -> tuple[list[Sample], str]:
        """Return samples of the change, and a text on a scene that could not be solved, or "".

        The first sample is below the tolerance. The last one exceeds 50 %, has the largest value of
        x, or precedes a scene that cannot be solved.
        """
        x = self._initial
        stop_reason = ""
        change = self._change(x)
        # Ratio of successive values of a varied parameter. An effect that exceeds the tolerance
        # only between two of them is not found.
        first_step_ratio = 1.5
        # A parameter is varied by at most this factor in either direction.
        max_parameter_range = 1e6
        while abs(change) >= self._tolerance:
            x /= first_step_ratio**2
            change = self._change(x)
            if x < self._initial / max_parameter_range:
                raise NotConverged(
                    f"{self.parameter} changes the force by more than the tolerance at all values "
                    "that were tried"
                )
        samples = [(x, change)]
        step = first_step_ratio
        # The ratio shrinks to this value towards parameters for which a scene cannot be
        # solved.
        min_step_ratio = 1.03
        # A parameter is varied until the force has changed by this fraction.
        max_force_change = 0.5
        while (
            abs(change) < max_force_change
            and x < min(self._max_value, self._initial * max_parameter_range)
            and step > min_step_ratio
        ):
            factor = step if abs(change) > self._tolerance / 10 else step**2
            next_x = min(x * factor, self._max_value)
            try:
                change = self._change(next_x)
            except UNSOLVED as error:
                stop_reason = f"; beyond that not solved: {error}"
                step = step**0.5
                continue
            x = next_x
            samples.append((x, change))
        return samples, stop_reason

    def crossings(self, samples: list[Sample]) -> list[float]:
        """Return the parameter values at which the absolute change passes the tolerance."""
        return sorted(
            self._bisect(level, low, high)
            for low, high in pairwise(samples)
            for level in (self._tolerance, -self._tolerance)
            if (low[1] - level) * (high[1] - level) < 0
        )

    def _bisect(self, level: float, low: Sample, high: Sample) -> float:
        """Return the parameter value at which the change passes a level between two samples.

        The interval is bisected to 1 %, and the change is interpolated in the last interval.
        """
        # Relative width of the interval of a threshold, in which the effect is interpolated
        # linearly.
        tolerance = 0.01
        while high[0] > low[0] * (1 + tolerance):
            x = (low[0] * high[0]) ** 0.5
            middle = x, self._change(x)
            if (middle[1] - level) * (low[1] - level) > 0:
                low = middle
            else:
                high = middle
        return low[0] + (high[0] - low[0]) * (level - low[1]) / (high[1] - low[1])
