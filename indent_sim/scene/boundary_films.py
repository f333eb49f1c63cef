"""Films beside drained faces: what elements that are thicker than the film cost the force, and
sizes that resolve it.

A time t after the load came, the fluid has left a layer of about (D t)^(1/2) beside every drained
face, and that alone. Elements there that are thicker lose more (`excess_length` E of
`theory.surface.drainage`), as if the body had drained E deeper. By Betti's reciprocity, with the
undrained pressure p of a depth delta, fluid lost by a volume dV at the face takes (dp/ddelta) dV
from the force, so all of it takes

    dF = 1/2 d/ddelta int p^2 E/M dA,      1/M = alpha^2/M_c + storage.

Under a tip p is about the pressure of the contact, on an incompressible half-space equal to it.
This gives a share `per_length` E of the force, with

    per_length = c SPREAD F/(A delta M),   c = 1/2 dln(F^2/A)/dln(delta): 1 on a half-space, to 5/2
    on a thin layer,

which is 6 G/(pi M_c a) under a paraboloid on a half-space. Farther faces feel (a/distance)^2 of it
at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, log

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Conductance
from indent_sim.model.loading import LoadPath
from indent_sim.scene.given import AT_RIM, Given, Physics, is_locked
from indent_sim.scene.theories import undrained
from indent_sim.theory.surface.drainage import drained_length, excess_length

SPREAD = 9 / 8  # mean square of a paraboloid's pressure over the square of its mean
STEP = 0.9  # of a depth: a second one, for slopes
SAME_SPEED = 1e-6  # relative: of one piece of a path, but for rounding
MOST_CHANGES = 30  # before a row: films of earlier ones have grown thick
MOST_ROWS = 100  # that a size is chosen by
HALVINGS = 30  # of the range of a size, in its logarithm: to 1e-8
LEAST_VALUE = 0.05  # of the largest depth or force: earlier rows are not asked for a film's error


@dataclass
class PathPiece:
    """A piece of a path in which the value changes evenly, or a jump: its begin and end in time,
    and the change.
    """

    begin: float
    end: float
    change: float

    @property
    def speed(self) -> float:
        """The change in a unit of time; infinite where it jumps."""
        return self.change / (self.end - self.begin) if self.end > self.begin else inf


@dataclass(frozen=True)
class PathRow:
    """A row of a path in time: the sizes of what has changed until then (n,), each with the time
    since it began and the time that it took (n,), and the value of the row; sizes and value over
    the largest value of the path.
    """

    changes: np.ndarray
    since: np.ndarray
    over: np.ndarray
    value: float

    def drained(self, diffusivity: float) -> float:
        """`drained_length` [length] of the row, by the pressure of the largest value: what each
        change has drained.
        """
        return float(self.changes @ drained_length(diffusivity, self.since, self.over))

    def excess(self, h: np.ndarray, diffusivity: float) -> np.ndarray:
        """`excess_length` (m,) of elements h (m,) [length] at a face, by the pressure of the
        largest value: the sum of what each change has left.
        """
        lengths = drained_length(diffusivity, self.since, self.over)
        return excess_length(h[:, None], lengths) @ self.changes


def rows_of(path: LoadPath) -> list[PathRow]:
    """The rows of a path in time, with the last MOST_CHANGES that have begun until then, but for
    what has come at once just now, of which nothing has drained yet.
    """
    largest = max(path.values)
    if (
        largest <= 0
    ):  # a tip that touches or is lifted: nothing is pressed, and no film costs anything
        return []
    legs = [path.leg(step) for step in range(1, len(path.values) + 1)]
    pieces = _pieces([(0.0, 0.0), *((value / largest, t) for leg in legs for value, t in leg)])
    begin, end, change = np.array(
        [(one.begin, one.end, one.change) for one in pieces if one.change]
    ).T
    found = []
    for leg in legs:
        value, t = leg[-1]
        last = int(np.searchsorted(begin, t))
        recent = slice(max(last - MOST_CHANGES, 0), last)
        since = t - begin[recent]
        whole = end[recent] - begin[recent]
        over = np.minimum(since, whole)
        share = np.divide(over, whole, out=np.ones_like(over), where=whole > 0)
        found.append(PathRow(np.abs(change[recent] * share), since, over, value / largest))
    return found


def _pieces(places: Sequence[tuple[float, float]]) -> list[PathPiece]:
    """The pieces between places (value, time), as long as they are."""
    found: list[PathPiece] = []
    for (before, begin), (value, end) in pairwise(places):
        piece = PathPiece(begin, end, value - before)
        if (
            found
            and end > begin
            and abs(piece.speed - found[-1].speed) <= SAME_SPEED * abs(piece.speed)
        ):
            found[-1].end = end
            found[-1].change = found[-1].change + piece.change
        elif end > begin or value != before:
            found.append(piece)
    return found


def slowest(physics: Physics) -> float:
    """The smallest diffusivity D [length^2/time] of the regions in which fluid flows: it has the
    thinnest films.
    """
    return min(region.material.diffusivity for region in physics.permeable)


def softening(physics: Physics) -> float:
    """The largest 1/M = permeability/D [1/pressure] of the regions in which fluid flows: their loss
    per pressure.
    """
    flows = [(region.material.flow, region.material.diffusivity) for region in physics.permeable]
    return max(flow.permeability / D for flow, D in flows if flow and flow.permeability)


def share_of(row: PathRow, h: float, diffusivity: float, per: float | None) -> float:
    """The share of the largest force that elements h [length] at a drained face under the tip cost
    a row.

    per: see `per_length`. A column gives way by what it has drained alone, so that its error is the
    excess over that.
    """
    excess = float(row.excess(np.array([h]), diffusivity)[0])
    if per is not None:
        return per * excess
    drained = row.drained(diffusivity)
    return excess / drained if drained else 0.0


def per_length(given: Given) -> float | None:
    """The share of the force that a drained face under the tip costs per `excess_length`
    [1/length], at the deepest contact; by theory, or as on a half-space where it ends. None of a
    column that gives way by draining alone.
    """
    if is_locked(given.physics):
        return None
    physics = given.physics
    delta = given.deepest
    theory = given.theory_with(undrained)
    some = theory.curve([STEP * delta, delta]) if theory else None
    if not some:
        pressure = undrained(physics.material).E_star * delta / (2 * given.a)
        return SPREAD * pressure / delta * softening(physics)
    before, there = (one.force**2 / one.area for one in some)
    growth = log(there / before) / (-2 * log(STEP))
    return growth * SPREAD * some[1].force / (some[1].area * delta) * softening(physics)


def drained_faces(given: Given, earliest: float) -> dict[str, float]:
    """The faces through which fluid leaves, each with its distance [length] from the contact, by
    name.

    A conductance holds no pressure until the film is as thick as permeability/conductance: before
    there is none. Nor is there one beside a tip that seals: the undrained surface there has next to
    no pressure, and what leaves around the edge of the contact is known to 0.2 % of the force on 10
    elements in its radius. earliest: time of the first row [time].
    """
    physics = given.physics
    drainage = physics.drainage
    part = physics.part
    found = {}
    if _drains(physics, drainage.tip, earliest):
        found["top"] = 0.0
    if _drains(physics, drainage.base, earliest):
        found["base"] = part.height
    distances = part.distances(physics.center)
    return found | {wall: max(distances[wall] - given.a, 0.0) for wall in physics.drained_walls}


def _drains(physics: Physics, kind: str | Conductance, earliest: float) -> bool:
    """Whether a surface of that kind holds the pressure of the bath at its face from the first row
    on.
    """
    if not isinstance(kind, Conductance):
        return kind == "drained"
    permeability = max(
        region.material.flow.permeability or 0.0
        for region in physics.permeable
        if region.material.flow
    )
    return kind.conductance * (slowest(physics) * earliest) ** 0.5 > permeability


def felt(given: Given, distance: float) -> float:
    """The share of what a drained face under the tip costs that one at a distance [length] from the
    contact does: all of it where the tip covers the body, which feels it throughout.
    """
    a = given.a
    rim = given.physics.body.rim_distance(given.physics.center)
    return 1.0 if distance <= a or a >= (1 - AT_RIM) * rim else (a / distance) ** 2


@dataclass(frozen=True)
class Late:
    """Rows whose force the films at a face cost something: the face, the size of its elements
    [length], the last of those rows, from 0, and the largest share of a force, and that of the
    last row of the path.
    """

    face: str
    h: float
    until: int
    worst: float
    at_last: float


def late_rows(given: Given, physics: Physics, sizes: Sizes, negligible: float) -> Late | None:
    """The rows of a path in time whose films cost more than a `negligible` share of the largest
    force, at the face that costs most; None without any.
    """
    rows = rows_of(physics.path)
    D = slowest(physics)
    per = per_length(given)
    found: list[Late] = []
    for face, distance in drained_faces(
        given, min(t for t in physics.path.times) - (physics.path.begin or 0.0)
    ).items():
        film = next((film for film in sizes.films if film.side.surface == face), None)
        nearest = {"top": (0.0, 0.0), "base": (0.0, physics.part.height)}.get(
            face, (distance + given.a, 0.0)
        )
        there = float(sizes.at(*map(np.array, nearest)))
        h = min(film.h, there) if film else there
        share = felt(given, distance)
        shares = [
            share * share_of(row, h, D, per) if row.value >= LEAST_VALUE else 0.0 for row in rows
        ]
        late = [k for k, share in enumerate(shares) if share > negligible]
        if late:
            found.append(Late(face, h, late[-1], max(shares), shares[-1]))
    return max(found, key=lambda one: one.worst, default=None)


def size_for(
    rows: Sequence[PathRow],
    most: float,
    diffusivity: float,
    per: float | None,
    coarse: float,
    fine: float,
) -> float:
    """The size [length] of elements at a face under the tip, from `fine` to `coarse`, that cost at
    `most` this share of the force at the row that has drained least.
    """
    asked = [row for row in rows if row.value >= LEAST_VALUE and row.drained(diffusivity) > 0]
    asked = sorted(asked, key=lambda row: row.drained(diffusivity) / row.changes.sum())[:MOST_ROWS]

    def beyond(h: float) -> float:
        return max((share_of(row, h, diffusivity, per) for row in asked), default=0.0) - most

    if beyond(coarse) <= 0:
        return coarse
    if beyond(fine) >= 0:
        return fine
    for _ in range(HALVINGS):
        middle = (fine * coarse) ** 0.5
        fine, coarse = (middle, coarse) if beyond(middle) < 0 else (fine, middle)
    return fine
