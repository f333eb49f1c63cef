"""Effects that a model may leave out, in per cent of the force.

An effect is 100 (force with it / force without it - 1) at the deepest row, both at one depth and
both forces of scenes that this program solves: by theory where it is exact, else on one mesh, whose
error is in both. What the scene has no parameter of is followed over that parameter, and said as
the value from which on it matters.
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

# between values of a parameter that is followed: a change of sign is seen that lasts as long
FIRST_STEP_RATIO = 1.5
MIN_STEP_RATIO = 1.03  # of steps towards where nothing is solved
MAX_PARAMETER_RANGE = (
    1e6  # times nearer to nothing than where a parameter is followed from, if need be
)
MAX_FORCE_CHANGE = 0.5  # relative change of the force up to which an effect is followed
THRESHOLD_TOLERANCE = (
    0.01  # relative, of a threshold's parameter: between, an effect is a straight line
)


@dataclass(frozen=True)
class Effect:
    """What an effect does to the force [per cent]: between low and high, None where that side has
    no bound, and the number itself where it is one.

    source: where that comes from; needs: the value of a parameter that the scene lacks from which
    on it matters.
    """

    name: str
    percent: float | None
    low: float | None
    high: float | None
    source: str
    needs: str = ""

    @property
    def max_change(self) -> float:
        """The largest change that is possible [per cent]; infinite where nothing is known."""
        if self.percent is None and (self.low is None or self.high is None):
            return 0.0 if self.needs else inf
        return max(
            abs(change) for change in (self.percent, self.low, self.high) if change is not None
        )

    def scaled(self, gain: float) -> Effect:
        """The effect on a force that is smaller by this factor."""
        percent, low, high = (
            None if change is None else gain * change
            for change in (self.percent, self.low, self.high)
        )
        return replace(self, percent=percent, low=low, high=high)

    @property
    def is_possible(self) -> bool:
        """Whether the scene could have the effect at all."""
        return bool(self.percent != 0.0 or self.needs or self.low or self.high)


def solve_effect(name: str, find: Callable[[], Effect]) -> Effect:
    """An effect as it is found; where something could not be solved that is said, with the reason."""
    try:
        with np.errstate(all="ignore"):  # theories try depths beyond a tip's end
            return find()
    except (NotConverged, ConfigError, *SOLUTION_ERRORS) as error:
        return Effect(name, None, None, None, f"not solved: {error}")


@dataclass(frozen=True)
class FixedEffect:
    """The change of the force from elsewhere: relative, between two, and a number where it is one."""

    low: float
    high: float
    source: str
    change: float | None = None


def no_effect(why: str) -> FixedEffect:
    """That the scene has no such thing."""
    return FixedEffect(0.0, 0.0, why, 0.0)


@dataclass(frozen=True)
class UnknownEffect:
    """That the force is not known with it or without it, and why; needs: what is known of its
    parameter.
    """

    why: str
    needs: str = ""


@dataclass(frozen=True)
class VariantPair:
    """The scene with it, and without."""

    with_effect: Config
    without_effect: Config
    source: str


@dataclass(frozen=True)
class ThresholdSearch:
    """A parameter that the scene lacks: force with some of it over that without, small where x is.

    key: its name; value(x): what is said of it; side: where it matters, in words; first: an x to
    begin with; end: the largest there is.
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
    """A row of the table: the name of an effect, and the scenes with it and without, or where
    following it starts.
    """

    name: str
    find_source: Callable[[VariantSolver, float], EffectSource]

    def effect(self, solver: VariantSolver, tolerance: float) -> Effect:
        """What it does to the force; a scene that could not be solved is said to be that, with the
        reason.
        """
        return solve_effect(
            self.name,
            lambda: self._evaluate(self.find_source(solver, tolerance), solver, tolerance),
        )

    def _evaluate(
        self, effect_source: EffectSource, solver: VariantSolver, tolerance: float
    ) -> Effect:
        match effect_source:
            case UnknownEffect(why, needs):
                return Effect(self.name, None, None, None, why, needs)
            case FixedEffect(low, high, source, number):
                return Effect(self.name, number and 100 * number, 100 * low, 100 * high, source)
            case VariantPair(with_it, without, source):
                percent = 100 * (solver.force_ratio(with_it, without) - 1)
                return Effect(self.name, percent, percent, percent, source)
        return self._threshold_effect(effect_source, tolerance)

    def _threshold_effect(self, search: ThresholdSearch, tolerance: float) -> Effect:
        samples, stop_reason = sample_changes(search, tolerance)
        last_text = f"{search.displayed_value(samples[-1][0]):.{search.digits}g}"
        indexed_crossings = enumerate(threshold_crossings(search, samples, tolerance))
        thresholds = [
            f"{search.displayed_value(x):.{search.digits + (k > 0)}g}" for k, x in indexed_crossings
        ]
        not_reached = f"{search.parameter}: below {100 * tolerance:g} % as far as it was followed"
        needs = (
            f"above {100 * tolerance:g} % from {search.parameter} = {thresholds[0]}{search.direction}"
            if thresholds
            else not_reached
        )
        source = f"{search.source}, followed to {last_text}{stop_reason}"
        ends = [*thresholds[1:], last_text][: 2 * (len(thresholds) // 2)]
        small_ranges = " and ".join(
            f"{a} to {b}" for a, b in zip(ends[::2], ends[1::2], strict=True)
        )
        return Effect(
            self.name,
            None,
            None,
            None,
            source,
            needs + (f", but for {small_ranges}" if small_ranges else ""),
        )


Sample = tuple[float, float]
Samples = list[Sample]


def sample_changes(search: ThresholdSearch, tolerance: float) -> tuple[Samples, str]:
    """Relative changes of the force over the parameter's x, from where they are small to where they
    are as large as is followed or nothing is solved, and why there, in words; NotConverged where
    nothing is solved at all.
    """
    x = search.initial
    stop_reason = ""
    change = search.force_ratio(x) - 1
    while abs(change) >= tolerance:
        x /= FIRST_STEP_RATIO**2
        change = search.force_ratio(x) - 1
        if x < search.initial / MAX_PARAMETER_RANGE:
            raise NotConverged(f"{search.parameter} is felt however little there is of it")
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
            stop_reason = f"; beyond, {error}"
            step = step**0.5
            continue
        x = next_x
        samples.append((x, change))
    return samples, stop_reason


def threshold_crossings(search: ThresholdSearch, samples: Samples, tolerance: float) -> list[float]:
    """Where the change becomes as large as the tolerance, or small again, of either sign, in order."""
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
    """Where a change passes a level between two samples: halving, and a straight line at last."""
    while high[0] > low[0] * (1 + THRESHOLD_TOLERANCE):
        x = (low[0] * high[0]) ** 0.5
        middle = x, change(x)
        low, high = (middle, high) if (middle[1] - level) * (low[1] - level) > 0 else (low, middle)
    return low[0] + (high[0] - low[0]) * (level - low[1]) / (high[1] - low[1])
