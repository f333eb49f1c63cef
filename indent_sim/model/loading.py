"""The path of the tip: which depths are asked for, one result row each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Le, Len

from indent_sim.model.quantities import LENGTH, Coordinate, Length

MOST_STEPS = 100_000


@dataclass(frozen=True)
class Loading:
    """Either a final depth `delta` reached in `steps` equal steps, or the depths `deltas` one by one.

    delta > 0 pushes in; negative values in `deltas` hold the tip clear of the body [length].
    """

    delta: Length | None = None
    steps: Annotated[int, Gt(0), Le(MOST_STEPS)] = 10
    deltas: Annotated[tuple[Coordinate, ...], Len(1, MOST_STEPS), LENGTH] | None = None

    def path(self) -> tuple[float, ...]:
        """The requested depths in order [length]."""
        if self.deltas is not None:
            return self.deltas
        assert self.delta is not None
        return tuple(self.delta * step / self.steps for step in range(1, self.steps + 1))
