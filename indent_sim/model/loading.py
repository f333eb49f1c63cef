"""Loading: the `loading` section of a scene, which gives the load path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le, Len

from indent_sim.model.history import History
from indent_sim.model.load_path import LoadPath
from indent_sim.model.units import FORCE, LENGTH, TIME, Auto, Coordinate, Length, UnitRow

MAX_STEPS = 100_000
MAX_HISTORY_POINTS = 10_000
Force = Annotated[float, Gt(0), FORCE]
HistoryPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, LENGTH))]
ForceHistoryPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, FORCE))]
PATH_KEYS = (
    "delta",
    "deltas",
    "force",
    "forces",
    "history",
    "force_history",
)  # to say the path, one of them
STEPS_PER_DOUBLING = 4
MAX_STEPS_PER_DOUBLING = 1000
STEPPED_KEYS = ("delta", "force")  # those that have steps


@dataclass(frozen=True)
class Loading:
    """One of: a final depth `delta` or force `force` reached in `steps` equal steps, the depths
    `deltas` or the forces `forces` one by one, or in time `history`, [t, delta] (with a
    cantilever or a frame [t, z]), or `force_history`, [t, force]: straight between the points,
    two equal times are a jump, before the first point the body is at rest. `times`: auto: every
    point and, between them, enough for a curve | the times of the rows. A body that drains, or
    whose shear relaxes, takes `per_doubling` steps of each length before that doubles, in every
    piece.

    delta > 0 pushes in; negative values in `deltas` hold the tip clear of the body [length]. Forces
    are of the whole body (per unit length in plane strain); negative ones only under a tip that
    adheres, and no harder than it pulls where it first touches. Without adhesion a force of 0 is
    where the tip just touches, delta = 0.
    """

    delta: Length | None = None
    force: Force | None = None
    steps: Annotated[int, Gt(0), Le(MAX_STEPS)] = 10
    deltas: Annotated[tuple[Coordinate, ...], Len(1, MAX_STEPS), LENGTH] | None = None
    forces: Annotated[tuple[float, ...], Len(1, MAX_STEPS), FORCE] | None = None
    history: Annotated[tuple[HistoryPoint, ...], Len(2, MAX_HISTORY_POINTS)] | None = None
    force_history: Annotated[tuple[ForceHistoryPoint, ...], Len(2, MAX_HISTORY_POINTS)] | None = (
        None
    )
    times: Annotated[tuple[float, ...], Len(1, MAX_STEPS), TIME] | Auto = "auto"
    per_doubling: Annotated[int, Ge(2), Le(MAX_STEPS_PER_DOUBLING)] | None = None

    @property
    def given_path_keys(self) -> tuple[str, ...]:
        """Which of the ways to say the path are used; a complete loading uses one."""
        return tuple(key for key in PATH_KEYS if getattr(self, key) is not None)

    @property
    def steps_per_doubling(self) -> int:
        """Steps of each length in time before that doubles."""
        return self.per_doubling or STEPS_PER_DOUBLING

    @property
    def prescribed_history(self) -> History | None:
        """What is prescribed in time; None where no time passes."""
        points = self.history or self.force_history
        times = () if isinstance(self.times, str) else self.times
        return History("depth" if self.history else "force", points, times) if points else None  # type: ignore[arg-type]

    def path(self) -> LoadPath:
        """The requested depths or forces in order, of a loading without time."""
        (key,) = self.given_path_keys
        prescribed = getattr(self, key)
        values = (
            prescribed
            if key in ("deltas", "forces")
            else tuple(prescribed * n / self.steps for n in range(1, self.steps + 1))
        )
        return LoadPath("depth" if key in ("delta", "deltas") else "force", values)
