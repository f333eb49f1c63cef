"""The path of the tip: which depths or forces are asked for, one result row each."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

from annotated_types import Gt, Le, Len

from indent_sim.model.units import FORCE, LENGTH, Coordinate, Length

MOST_STEPS = 100_000
Force = Annotated[float, Gt(0), FORCE]
WAYS = ("delta", "deltas", "force", "forces")  # to say the path, one of them


@dataclass(frozen=True)
class LoadPath:
    """What is prescribed, and its values in order: depths [length], or forces of the whole body [force]."""

    control: Literal["depth", "force"]
    values: tuple[float, ...]

    @property
    def kept(self) -> frozenset[int]:
        """The steps whose states are worth keeping, from 1: the last, and those from which the tip goes back after it
        was nowhere deeper (or, where forces are prescribed, pressed no harder)."""
        steps, deepest = {len(self.values)}, float("-inf")
        for step, (value, following) in enumerate(pairwise(self.values), start=1):
            deepest = max(deepest, value)
            if following < value == deepest:
                steps.add(step)
        return frozenset(steps)


@dataclass(frozen=True)
class Loading:
    """One of: a final depth `delta` or force `force` reached in `steps` equal steps, the depths `deltas` or the
    forces `forces` one by one.

    delta > 0 pushes in; negative values in `deltas` hold the tip clear of the body [length]. Forces are of the whole
    body (per unit length in plane strain); negative ones only under a tip that adheres, and no harder than it pulls
    where it first touches. Without adhesion a force of 0 is where the tip just touches, delta = 0.
    """

    delta: Length | None = None
    force: Force | None = None
    steps: Annotated[int, Gt(0), Le(MOST_STEPS)] = 10
    deltas: Annotated[tuple[Coordinate, ...], Len(1, MOST_STEPS), LENGTH] | None = None
    forces: Annotated[tuple[float, ...], Len(1, MOST_STEPS), FORCE] | None = None

    @property
    def given(self) -> tuple[str, ...]:
        """Which of the ways to say the path are used; a complete loading uses one."""
        return tuple(way for way in WAYS if getattr(self, way) is not None)

    def path(self) -> LoadPath:
        """The requested depths or forces in order."""
        (way,) = self.given
        last = getattr(self, way)
        values = last if way in ("deltas", "forces") else tuple(last * n / self.steps for n in range(1, self.steps + 1))
        return LoadPath("depth" if way in ("delta", "deltas") else "force", values)
