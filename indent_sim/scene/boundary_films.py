"""Films beside drained faces: what elements that are thicker than the film cost the force, and
sizes that resolve it.

A time t after the load came, the fluid has left a layer of about (D t)^(1/2) beside every drained
face, and that alone. Elements there that are thicker lose more (`excess_length` E of
`theory.surface.drainage`), as if the body had drained E deeper. By Betti's reciprocity, with the
undrained pressure p of a depth delta, fluid lost by a volume dV at the face takes (dp/ddelta) dV
from the force, so all of it takes

    dF = 1/2 d/ddelta int p^2 E/M dA,      1/M = alpha^2/M_c + storage.

Under a tip p is about the pressure of the contact, on an incompressible half-space equal to it.
This gives a share `force_fraction_per_length` E of the force, with

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
from indent_sim.model.drainage import Conductance
from indent_sim.model.load_path import LoadPath
from indent_sim.scene.depth_limits import RIM_TOLERANCE
from indent_sim.scene.elastic_limit_laws import undrained_law
from indent_sim.scene.problem_definition import ProblemDefinition, is_undrained_incompressible
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory.drained_layer import drained_length, excess_length

MEAN_SQUARE_FACTOR = 9 / 8  # mean square of a paraboloid's pressure over the square of its mean
DEPTH_RATIO = 0.9  # of a depth: a second one, for slopes
RATE_TOLERANCE = 1e-6  # relative: of one piece of a path, but for rounding
MAX_CHANGES = 30  # before a row: films of earlier ones have grown thick
MAX_ROWS = 100  # that a size is chosen by
BISECTIONS = 30  # of the range of a size, in its logarithm: to 1e-8
MIN_VALUE_FRACTION = (
    0.05  # of the largest depth or force: earlier rows are not asked for a film's error
)


@dataclass
class PathSegment:
    """A piece of a path in which the value changes evenly, or a jump: its begin and end in time,
    and the change.
    """

    begin: float
    end: float
    change: float

    @property
    def rate(self) -> float:
        """The change in a unit of time; infinite where it jumps."""
        return self.change / (self.end - self.begin) if self.end > self.begin else inf


@dataclass(frozen=True)
class PathRow:
    """A row of a path in time: the sizes of what has changed until then (n,), each with the time
    since it began and the time that it took (n,), and the value of the row; sizes and value over
    the largest value of the path.
    """

    changes: np.ndarray
    elapsed: np.ndarray
    durations: np.ndarray
    value: float

    def drained_length(self, diffusivity: float) -> float:
        """`drained_length` [length] of the row, by the pressure of the largest value: what each
        change has drained.
        """
        return float(self.changes @ drained_length(diffusivity, self.elapsed, self.durations))

    def excess_length(self, h: np.ndarray, diffusivity: float) -> np.ndarray:
        """`excess_length` (m,) of elements h (m,) [length] at a face, by the pressure of the
        largest value: the sum of what each change has left.
        """
        lengths = drained_length(diffusivity, self.elapsed, self.durations)
        return excess_length(h[:, None], lengths) @ self.changes


def path_rows(path: LoadPath) -> list[PathRow]:
    """The rows of a path in time, with the last MOST_CHANGES that have begun until then, but for
    what has come at once just now, of which nothing has drained yet.
    """
    largest = max(path.values)
    if (
        largest <= 0
    ):  # a tip that touches or is lifted: nothing is pressed, and no film costs anything
        return []
    increments = [path.segment(step) for step in range(1, len(path.values) + 1)]
    segments = _merge_segments(
        [(0.0, 0.0), *((value / largest, t) for increment in increments for value, t in increment)]
    )
    begin, end, change = np.array(
        [(segment.begin, segment.end, segment.change) for segment in segments if segment.change]
    ).T
    rows = []
    for increment in increments:
        value, t = increment[-1]
        last = int(np.searchsorted(begin, t))
        recent = slice(max(last - MAX_CHANGES, 0), last)
        elapsed = t - begin[recent]
        full_durations = end[recent] - begin[recent]
        durations = np.minimum(elapsed, full_durations)
        done_fractions = np.divide(
            durations, full_durations, out=np.ones_like(durations), where=full_durations > 0
        )
        rows.append(
            PathRow(np.abs(change[recent] * done_fractions), elapsed, durations, value / largest)
        )
    return rows


def _merge_segments(points: Sequence[tuple[float, float]]) -> list[PathSegment]:
    """The pieces between places (value, time), as long as they are."""
    segments: list[PathSegment] = []
    for (previous_value, begin), (value, end) in pairwise(points):
        segment = PathSegment(begin, end, value - previous_value)
        if (
            segments
            and end > begin
            and abs(segment.rate - segments[-1].rate) <= RATE_TOLERANCE * abs(segment.rate)
        ):
            segments[-1].end = end
            segments[-1].change = segments[-1].change + segment.change
        elif end > begin or value != previous_value:
            segments.append(segment)
    return segments


def smallest_diffusivity(physics: ProblemDefinition) -> float:
    """The smallest diffusivity D [length^2/time] of the regions in which fluid flows: it has the
    thinnest films.
    """
    return min(region.material.diffusivity for region in physics.permeable_regions)


def largest_inverse_modulus(physics: ProblemDefinition) -> float:
    """The largest 1/M = permeability/D [1/pressure] of the regions in which fluid flows: their loss
    per pressure.
    """
    flows = [
        (region.material.flow, region.material.diffusivity) for region in physics.permeable_regions
    ]
    return max(flow.permeability / D for flow, D in flows if flow and flow.permeability)


def film_force_fraction(
    row: PathRow, h: float, diffusivity: float, fraction_per_length: float | None
) -> float:
    """Error of a row's force by elements of size h [length] at a drained face under the tip.

    It is relative to the largest force. For `fraction_per_length` see `force_fraction_per_length`.
    A column is compressed only by the fluid that has drained, so that its error is the excess over
    that.
    """
    excess = float(row.excess_length(np.array([h]), diffusivity)[0])
    if fraction_per_length is not None:
        return fraction_per_length * excess
    drained = row.drained_length(diffusivity)
    return excess / drained if drained else 0.0


def force_fraction_per_length(setup: ProblemSetup) -> float | None:
    """The share of the force that a drained face under the tip costs per `excess_length`
    [1/length], at the deepest contact; by theory, or as on a half-space where it ends. None of a
    column that gives way by draining alone.
    """
    if is_undrained_incompressible(setup.physics):
        return None
    physics = setup.physics
    delta = setup.max_depth
    theory = setup.theory_for_materials(undrained_law)
    solutions = theory.solutions_at_depths([DEPTH_RATIO * delta, delta]) if theory else None
    if not solutions:
        pressure = undrained_law(physics.material).E_star * delta / (2 * setup.a)
        return MEAN_SQUARE_FACTOR * pressure / delta * largest_inverse_modulus(physics)
    lower_value, upper_value = (solution.force**2 / solution.area for solution in solutions)
    growth = log(upper_value / lower_value) / (-2 * log(DEPTH_RATIO))
    return (
        growth
        * MEAN_SQUARE_FACTOR
        * solutions[1].force
        / (solutions[1].area * delta)
        * largest_inverse_modulus(physics)
    )


def drained_faces(setup: ProblemSetup, earliest: float) -> dict[str, float]:
    """The faces through which fluid leaves, each with its distance [length] from the contact, by
    name.

    A conductance holds no pressure until the film is as thick as permeability/conductance: before
    there is none. Nor is there one beside a tip that seals: the undrained surface there has next to
    no pressure, and what leaves around the edge of the contact is known to 0.2 % of the force on 10
    elements in its radius. earliest: time of the first row [time].
    """
    physics = setup.physics
    drainage = physics.drainage
    domain = physics.domain
    face_distances = {}
    if _is_drained(physics, drainage.tip, earliest):
        face_distances["top"] = 0.0
    if _is_drained(physics, drainage.base, earliest):
        face_distances["base"] = domain.height
    distances = domain.wall_distances(physics.center)
    return face_distances | {
        wall: max(distances[wall] - setup.a, 0.0) for wall in physics.drained_walls
    }


def _is_drained(physics: ProblemDefinition, kind: str | Conductance, earliest: float) -> bool:
    """Whether a surface of that kind holds the pressure of the bath at its face from the first row
    on.
    """
    if not isinstance(kind, Conductance):
        return kind == "drained"
    permeability = max(
        region.material.flow.permeability or 0.0
        for region in physics.permeable_regions
        if region.material.flow
    )
    return kind.conductance * (smallest_diffusivity(physics) * earliest) ** 0.5 > permeability


def distance_weight(setup: ProblemSetup, distance: float) -> float:
    """The share of what a drained face under the tip costs that one at a distance [length] from the
    contact does: all of it where the tip covers the body, which feels it throughout.
    """
    a = setup.a
    rim_distance = setup.physics.body.lateral_extent(setup.physics.center)
    return 1.0 if distance <= a or a >= (1 - RIM_TOLERANCE) * rim_distance else (a / distance) ** 2


@dataclass(frozen=True)
class UnresolvedFilm:
    """Rows whose force the films at a face cost something: the face, the size of its elements
    [length], the last of those rows, from 0, and the largest share of a force, and that of the
    last row of the path.
    """

    face: str
    h: float
    last_row: int
    max_error: float
    last_row_error: float


def unresolved_film(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes, negligible: float
) -> UnresolvedFilm | None:
    """The rows of a path in time whose films cost more than a `negligible` share of the largest
    force, at the face that costs most; None without any.
    """
    rows = path_rows(physics.path)
    D = smallest_diffusivity(physics)
    fraction_per_length = force_fraction_per_length(setup)
    films: list[UnresolvedFilm] = []
    for face, distance in drained_faces(
        setup, min(t for t in physics.path.times) - (physics.path.start_time or 0.0)
    ).items():
        film = next((film for film in sizes.drained_faces if film.side.surface == face), None)
        nearest = {"top": (0.0, 0.0), "base": (0.0, physics.domain.height)}.get(
            face, (distance + setup.a, 0.0)
        )
        h_there = float(sizes.size_at(*map(np.array, nearest)))
        h = min(film.h, h_there) if film else h_there
        weight = distance_weight(setup, distance)
        fractions = [
            weight * film_force_fraction(row, h, D, fraction_per_length)
            if row.value >= MIN_VALUE_FRACTION
            else 0.0
            for row in rows
        ]
        late_steps = [k for k, weight in enumerate(fractions) if weight > negligible]
        if late_steps:
            films.append(UnresolvedFilm(face, h, late_steps[-1], max(fractions), fractions[-1]))
    return max(films, key=lambda candidate: candidate.max_error, default=None)


def film_element_size(
    rows: Sequence[PathRow],
    max_fraction: float,
    diffusivity: float,
    fraction_per_length: float | None,
    largest_size: float,
    smallest_size: float,
) -> float:
    """Size [length] of elements at a face under the tip with an error of at most `max_fraction`.

    The error is that of the force at the row that has drained least; the size lies between
    `smallest_size` and `largest_size`.
    """
    relevant_rows = [
        row
        for row in rows
        if row.value >= MIN_VALUE_FRACTION and row.drained_length(diffusivity) > 0
    ]
    relevant_rows = sorted(
        relevant_rows, key=lambda row: row.drained_length(diffusivity) / row.changes.sum()
    )[:MAX_ROWS]

    def beyond(h: float) -> float:
        return (
            max(
                (
                    film_force_fraction(row, h, diffusivity, fraction_per_length)
                    for row in relevant_rows
                ),
                default=0.0,
            )
            - max_fraction
        )

    if beyond(largest_size) <= 0:
        return largest_size
    if beyond(smallest_size) >= 0:
        return smallest_size
    for _ in range(BISECTIONS):
        middle = (smallest_size * largest_size) ** 0.5
        smallest_size, largest_size = (
            (middle, largest_size) if beyond(middle) < 0 else (smallest_size, middle)
        )
    return smallest_size
