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
from indent_sim.run.requirements.bench import Bench
from indent_sim.theory.solution import UNSOLVED

# between values of a parameter that is followed: a change of sign is seen that lasts as long
FIRST_STEP_RATIO = 1.5
LEAST_STEP_RATIO = 1.03  # of steps towards where nothing is solved
FOLLOWED_RANGE = 1e6  # times nearer to nothing than where a parameter is followed from, if need be
FOLLOWED = 0.5  # relative change of the force up to which an effect is followed
SHARP = 0.01  # relative, of a threshold's parameter: between, an effect is a straight line


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
    def size(self) -> float:
        """The largest change that is possible [per cent]; infinite where nothing is known."""
        if self.percent is None and (self.low is None or self.high is None):
            return 0.0 if self.needs else inf
        return max(abs(one) for one in (self.percent, self.low, self.high) if one is not None)

    def times(self, gain: float) -> Effect:
        """The effect on a force that is smaller by this factor."""
        percent, low, high = (
            None if one is None else gain * one for one in (self.percent, self.low, self.high)
        )
        return replace(self, percent=percent, low=low, high=high)

    @property
    def applies(self) -> bool:
        """Whether the scene could have the effect at all."""
        return bool(self.percent != 0.0 or self.needs or self.low or self.high)


def solved(name: str, find: Callable[[], Effect]) -> Effect:
    """An effect as it is found; where something could not be solved that is said, with the reason."""
    try:
        with np.errstate(all="ignore"):  # theories try depths beyond a tip's end
            return find()
    except (NotConverged, ConfigError, *UNSOLVED) as error:
        return Effect(name, None, None, None, f"not solved: {error}")


@dataclass(frozen=True)
class Known:
    """The change of the force from elsewhere: relative, between two, and a number where it is one."""

    low: float
    high: float
    source: str
    number: float | None = None


def absent(why: str) -> Known:
    """That the scene has no such thing."""
    return Known(0.0, 0.0, why, 0.0)


@dataclass(frozen=True)
class Unknown:
    """That the force is not known with it or without it, and why; needs: what is known of its
    parameter.
    """

    why: str
    needs: str = ""


@dataclass(frozen=True)
class Pair:
    """The scene with it, and without."""

    with_it: Config
    without: Config
    source: str


@dataclass(frozen=True)
class Start:
    """A parameter that the scene lacks: force with some of it over that without, small where x is.

    key: its name; value(x): what is said of it; side: where it matters, in words; first: an x to
    begin with; end: the largest there is.
    """

    key: str
    change: Callable[[float], float]
    first: float
    source: str
    value: Callable[[float], float] = lambda x: x
    side: str = ""
    end: float = inf
    digits: int = 2


Said = Known | Unknown | Pair | Start


@dataclass(frozen=True)
class Requirement:
    """A row of the table: the name of an effect, and the scenes with it and without, or where
    following it starts.
    """

    name: str
    said: Callable[[Bench, float], Said]

    def effect(self, bench: Bench, within: float) -> Effect:
        """What it does to the force; a scene that could not be solved is said to be that, with the
        reason.
        """
        return solved(self.name, lambda: self._effect(self.said(bench, within), bench, within))

    def _effect(self, said: Said, bench: Bench, within: float) -> Effect:
        match said:
            case Unknown(why, needs):
                return Effect(self.name, None, None, None, why, needs)
            case Known(low, high, source, number):
                return Effect(self.name, number and 100 * number, 100 * low, 100 * high, source)
            case Pair(with_it, without, source):
                percent = 100 * (bench.ratio(with_it, without) - 1)
                return Effect(self.name, percent, percent, percent, source)
        return self._threshold(said, within)

    def _threshold(self, start: Start, within: float) -> Effect:
        samples, why = follow(start, within)
        last = f"{start.value(samples[-1][0]):.{start.digits}g}"
        passed = enumerate(crossings(start, samples, within))
        limits = [f"{start.value(x):.{start.digits + (k > 0)}g}" for k, x in passed]
        never = f"{start.key}: below {100 * within:g} % as far as it was followed"
        words = (
            f"above {100 * within:g} % from {start.key} = {limits[0]}{start.side}"
            if limits
            else never
        )
        source = f"{start.source}, followed to {last}{why}"
        ends = [*limits[1:], last][: 2 * (len(limits) // 2)]
        small = " and ".join(f"{a} to {b}" for a, b in zip(ends[::2], ends[1::2], strict=True))
        return Effect(
            self.name, None, None, None, source, words + (f", but for {small}" if small else "")
        )


Sample = tuple[float, float]
Samples = list[Sample]


def follow(start: Start, within: float) -> tuple[Samples, str]:
    """Relative changes of the force over the parameter's x, from where they are small to where they
    are as large as is followed or nothing is solved, and why there, in words; NotConverged where
    nothing is solved at all.
    """
    x = start.first
    why = ""
    change = start.change(x) - 1
    while abs(change) >= within:
        x /= FIRST_STEP_RATIO**2
        change = start.change(x) - 1
        if x < start.first / FOLLOWED_RANGE:
            raise NotConverged(f"{start.key} is felt however little there is of it")
    samples = [(x, change)]
    step = FIRST_STEP_RATIO
    while (
        abs(change) < FOLLOWED
        and x < min(start.end, start.first * FOLLOWED_RANGE)
        and step > LEAST_STEP_RATIO
    ):
        further = min(x * (step if abs(change) > within / 10 else step**2), start.end)
        try:
            change = start.change(further) - 1
        except (NotConverged, ConfigError, *UNSOLVED) as error:
            why = f"; beyond, {error}"
            step = step**0.5
            continue
        x = further
        samples.append((x, change))
    return samples, why


def crossings(start: Start, samples: Samples, within: float) -> list[float]:
    """Where the change becomes as large as the tolerance, or small again, of either sign, in order."""
    both = [(low, high, level) for low, high in pairwise(samples) for level in (within, -within)]
    passed = [
        (level, low, high) for low, high, level in both if (low[1] - level) * (high[1] - level) < 0
    ]
    return sorted(_between(lambda x: start.change(x) - 1, *one) for one in passed)


def _between(change: Callable[[float], float], level: float, low: Sample, high: Sample) -> float:
    """Where a change passes a level between two samples: halving, and a straight line at last."""
    while high[0] > low[0] * (1 + SHARP):
        x = (low[0] * high[0]) ** 0.5
        middle = x, change(x)
        low, high = (middle, high) if (middle[1] - level) * (low[1] - level) > 0 else (low, middle)
    return low[0] + (high[0] - low[0]) * (level - low[1]) / (high[1] - low[1])
