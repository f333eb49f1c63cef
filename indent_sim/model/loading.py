"""Loading: the `loading` section of a scene, which gives the load path."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

from annotated_types import Ge, Gt, Le, Len

from indent_sim.model.history import History
from indent_sim.model.load_path import Control, LoadPath, Unloading
from indent_sim.model.units import (
    ANGLE,
    FORCE,
    LENGTH,
    TIME,
    Auto,
    Coordinate,
    Length,
    LengthOrZero,
    UnitRow,
)

MAX_STEPS = 100_000
MAX_HISTORY_POINTS = 10_000
Force = Annotated[float, Gt(0), FORCE]
HistoryPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, LENGTH))]
ForceHistoryPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, FORCE))]
# A loading gives exactly one of these keys.
PATH_KEYS = ("delta", "deltas", "force", "forces", "history", "force_history")
STEPS_PER_DOUBLING = 4
# Keys whose value is reached in equal steps.
STEPPED_KEYS = ("delta", "force")


MAX_SLIDES = 1000
# Exponent of force over recovered depth by which prescribed forces of unloading are spread: rows
# of a paraboloid are then equally far apart, and those of other tips nearly so.
UNLOADING_EXPONENT = 1.5


@dataclass(frozen=True)
class Slide:
    """Sideways motion of the tip after the last depth or force, which is held.

    The tip moves in straight stretches to each of the displacements `to`, measured from where it
    was pressed in [length]; one number is a scratch, several make a loop. Every stretch has `steps`
    rows. `along` is the direction in degrees from x: 0 (x) or 90 (y).
    """

    to: Annotated[tuple[Coordinate, ...], Len(1, MAX_SLIDES), LENGTH] | Coordinate
    steps: Annotated[int, Gt(0), Le(MAX_STEPS)] = 10
    along: Annotated[float, ANGLE] = 0.0

    @property
    def ends(self) -> tuple[float, ...]:
        """Displacements at the ends of the stretches [length]."""
        return self.to if isinstance(self.to, tuple) else (self.to,)

    @property
    def displacements(self) -> tuple[float, ...]:
        """Displacement of each row [length]."""
        return tuple(
            begin + (end - begin) * n / self.steps if n < self.steps else end
            for begin, end in pairwise((0.0, *self.ends))
            for n in range(1, self.steps + 1)
        )

    @property
    def axis(self) -> int:
        """Horizontal axis of the motion: 0 (x) or 1 (y)."""
        return round(self.along / 90)


@dataclass(frozen=True)
class Unload:
    """Unloading after the last depth or force, in `rows` rows.

    Unloading ends at the depth `to` (at the force `to` if forces are prescribed), or earlier where
    contact is lost: the last row is then the row at which the force has become zero. With
    prescribed depths the rows divide the recovered depth into equal parts; prescribed forces are
    those of a paraboloid at such depths.
    """

    to: LengthOrZero = 0.0
    rows: Annotated[int, Gt(0), Le(MAX_STEPS)] = 10


@dataclass(frozen=True)
class Loading:
    """Prescribed depths or forces, in order or in time.

    Exactly one of these is given: a final depth `delta` or force `force` that is reached in `steps`
    equal increments; depths `deltas` or forces `forces` in order; or, as a function of time,
    `history` with points [t, delta] (with a cantilever or a frame [t, z]) or `force_history` with
    points [t, force]. A history is linear between its points, two equal times are a jump, and
    before the first point the body is undeformed. `times` are the times of the rows; with "auto"
    every point is a row, and enough rows are added between the points for a smooth curve. For a
    body that drains or whose shear modulus relaxes, every segment has `per_doubling` time
    increments of equal length before the length doubles.

    delta > 0 is indentation; negative values in `deltas` keep the tip clear of the body [length].
    Forces are those of the whole body (per unit length in plane strain). Negative forces require
    adhesion and must not exceed the attraction at first contact. Without adhesion a force of 0
    means delta = 0, where the tip just touches; after yield it means the depth at which contact is
    lost.

    With `slide` the tip then moves sideways at the last depth or force, with `unload` it goes back.
    With `slide_history` it moves along x during a history: points [t, x] with the displacement from
    where it is pressed in [length], beginning at x = 0, linear between the points, and at rest
    before and after them. The body must relax in shear or drain.
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
    per_doubling: Annotated[int, Ge(2), Le(1000)] | None = None
    slide: Slide | None = None
    slide_history: Annotated[tuple[HistoryPoint, ...], Len(2, MAX_HISTORY_POINTS)] | None = None
    unload: Unload | None = None

    @property
    def slides(self) -> bool:
        """True if the tip slides."""
        return self.slide is not None or self.slide_history is not None

    @property
    def given_path_keys(self) -> tuple[str, ...]:
        """The given keys that define a load path; a complete loading has exactly one such key."""
        return tuple(key for key in PATH_KEYS if getattr(self, key) is not None)

    @property
    def steps_per_doubling(self) -> int:
        """Number of time increments of equal length before the length doubles."""
        return self.per_doubling or STEPS_PER_DOUBLING

    @property
    def prescribed_history(self) -> History | None:
        """Prescribed history; None for a time-independent loading."""
        points = self.history or self.force_history
        times = () if isinstance(self.times, str) else self.times
        if not points:
            return None
        control = "depth" if self.history else "force"
        return History(control, points, times, self.slide_history or ())  # type: ignore[arg-type]

    def path(self) -> LoadPath:
        """Return the load path of a time-independent loading."""
        (key,) = self.given_path_keys
        prescribed = getattr(self, key)
        values = (
            prescribed
            if key in ("deltas", "forces")
            else tuple(prescribed * n / self.steps for n in range(1, self.steps + 1))
        )
        control: Control = "depth" if key in ("delta", "deltas") else "force"
        if self.unload is not None:
            return _with_unloading(LoadPath(control, values), self.unload)
        if self.slide is None:
            return LoadPath(control, values)
        displacements = self.slide.displacements
        held = values[-1:] * len(displacements)
        slides = (0.0,) * len(values) + displacements
        return LoadPath(control, values + held, slides=slides, slide_axis=self.slide.axis)


def _with_unloading(path: LoadPath, unload: Unload) -> LoadPath:
    """Return a path with unloading after its last value."""
    top = path.values[-1]
    exponent = UNLOADING_EXPONENT if path.control == "force" else 1.0
    way_back = tuple(
        unload.to + (top - unload.to) * ((unload.rows - n) / unload.rows) ** exponent
        for n in range(1, unload.rows + 1)
    )
    unloading = Unloading(len(path.values), unload.rows, unload.to)
    return LoadPath(path.control, path.values + way_back, unloading=unloading)
