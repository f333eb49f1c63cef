"""The modelled piece of a body: its outline with named surfaces, its regions of matter, and how it
is held.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, pi, sin

import numpy as np

from indent_sim.model.elastic_law import Constants
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.kinematics import Kinematics
from indent_sim.model.layers import Coating
from indent_sim.model.materials import Material
from indent_sim.model.relaxation import PronySeries

Point = tuple[float, ...]
Coordinates = float | np.ndarray
Pins = tuple[tuple[Point, int], ...]


@dataclass(frozen=True)
class Side:
    """One side of an outline from `start` to `end`; an arc turns anticlockwise about `middle`
    [length].
    """

    surface: str
    start: Point
    end: Point
    center: Point | None = None

    @property
    def normal_axis(self) -> int | None:
        """The axis a straight side is normal to; None for any other."""
        equal_axes = [axis for axis in (0, 1) if self.start[axis] == self.end[axis]]
        return equal_axes[0] if equal_axes and self.center is None else None

    @property
    def radius(self) -> float:
        """Radius of an arc [length]."""
        assert self.center is not None
        return float(np.hypot(self.start[0] - self.center[0], self.start[1] - self.center[1]))

    def inward_distance(self, x: Coordinates, y: Coordinates) -> np.ndarray:
        """How far inside [length] of the line or circle, which the side is a part of, points are:
        on the left of it.
        """
        if self.center is not None:
            return self.radius - np.hypot(x - self.center[0], y - self.center[1])
        (x0, y0) = self.start
        (x1, y1) = self.end
        return ((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) / np.hypot(x1 - x0, y1 - y0)

    def distance(self, x: Coordinates, y: Coordinates) -> np.ndarray:
        """Distance [length] of points to the arc, or to the line that a straight side is a part of."""
        distance_to_curve = np.abs(self.inward_distance(x, y))
        if self.center is None:
            return distance_to_curve
        angle_from_start = (
            np.arctan2(y - self.center[1], x - self.center[0]) - self._start_angle
        ) % (2 * pi)
        end_distances = [np.hypot(x - end[0], y - end[1]) for end in (self.start, self.end)]
        return np.where(
            angle_from_start <= self.arc_angle, distance_to_curve, np.minimum(*end_distances)
        )

    def sample_points(self, n: int) -> tuple[np.ndarray, float]:
        """n points (n, 2) on the side, evenly spread, and the length of it that belongs to each."""
        fraction = ((np.arange(n) + 0.5) / n)[:, None]
        if self.center is None:
            start = np.array(self.start)
            end = np.array(self.end)
            return start + fraction * (end - start), float(np.linalg.norm(end - start)) / n
        angle = self._start_angle + fraction * self.arc_angle
        directions = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
        return np.array(self.center) + self.radius * directions, self.radius * abs(
            self.arc_angle
        ) / n

    @property
    def arc_angle(self) -> float:
        """Angle [radians] of an arc."""
        assert self.center is not None
        return (
            atan2(self.end[1] - self.center[1], self.end[0] - self.center[0]) - self._start_angle
        ) % (2 * pi)

    @property
    def swept_area(self) -> float:
        """Area that the side sweeps as seen from the origin: of its chord, and of the circle beyond
        it [length^2].
        """
        (x0, y0) = self.start
        (x1, y1) = self.end
        chord = (x0 * y1 - x1 * y0) / 2
        return (
            chord
            if self.center is None
            else chord + self.radius**2 / 2 * (self.arc_angle - sin(self.arc_angle))
        )

    @property
    def _start_angle(self) -> float:
        """Direction [radians] in which an arc begins, seen from its middle."""
        assert self.center is not None
        return atan2(self.start[1] - self.center[1], self.start[0] - self.center[0])


@dataclass(frozen=True)
class Region:
    """A layer of the part, or an inclusion: its material, its formulation (displacement, or mixed
    with a pressure), and how its shear stress relaxes while it is followed in time.

    least_share: what is left of its shear modulus when it has relaxed most, on the way that the
    scene asks for.
    """

    name: str
    material: Material
    formulation: str
    bottom: float = 0.0  # z of a layer's lower face [length]
    inclusion: Inclusion | None = None
    relaxation_series: PronySeries | None = None
    min_shear_fraction: float = 1.0

    @property
    def softest_constants(self) -> Constants:
        """Small-strain E [pressure] and nu of its softest state on the way, which is its most
        incompressible one.
        """
        return self.material.relaxed_constants(self.min_shear_fraction)


MIRROR_DISTANCE = 1e-12  # distance [length] of a tip to the mirror plane that it stands over


@dataclass(frozen=True)
class ModelDomain:
    """The modelled piece; `copies` of it are the whole body.

    Its regions are layers from the top to the base, then inclusions.

    outline: its sides, anticlockwise; in two dimensions of the section (r or x, z), in three of the
    section z = const, which goes from z = -height to z = 0 between the surfaces base and top.
    supports: free | roller | fixed by surface, free where there is none; symmetry planes are
    rollers. pins: (point, component) that take the rigid modes left. cuts: the axes, of x and y,
    that mirror planes are normal to; each is the end x_min or y_min of the part.
    """

    kinematics: Kinematics
    symmetry: str  # axisymmetric | quarter | half | full
    symmetry_factor: int
    outline: tuple[Side, ...]
    height: float
    regions: tuple[Region, ...]
    supports: Mapping[str, str]
    pins: Pins = ()
    mirror_axes: tuple[str, ...] = ()

    @property
    def dim(self) -> int:
        """Dimensions of the mesh."""
        return self.kinematics.dim

    @property
    def extent(self) -> tuple[tuple[float, float], ...]:
        """(min, max) along each axis [length]; arcs bulge no further than their ends, being
        quarters of a turn.
        """
        coordinates = [[side.start[axis] for side in self.outline] for axis in (0, 1)]
        section_extent = tuple((min(values), max(values)) for values in coordinates)
        return section_extent if self.dim == 2 else (*section_extent, (-self.height, 0.0))

    def interface_level(self, x: Coordinates, z: Coordinates) -> np.ndarray:
        """z [length] on the axis of the face between layers on which a place would be: z itself
        under a flat top, and under a spherical one, to which faces are concentric, minus the
        distance to it.
        """
        return (
            np.asarray(z)
            if self.top_radius is None
            else np.hypot(x, z + self.top_radius) - self.top_radius
        )

    def interface_crossings(self, side: Side) -> list[tuple[Point, float]]:
        """Where faces between layers cross a straight side of a section, from its start on, and z
        of each.
        """
        (x0, z0) = side.start
        (x1, z1) = side.end
        if self.top_radius is None:
            crossings = [
                ((x0 + (x1 - x0) * (z - z0) / (z1 - z0), z), z) for z in self.interfaces if z0 != z1
            ]
        elif x0 == x1:
            crossings = [
                ((x0, -self.top_radius + sign * (self.top_radius + z)), z)
                for z in self.interfaces
                for sign in (1, -1)
            ]
        else:
            crossings = [
                (((self.top_radius + z) ** 2 - (self.top_radius + z0) ** 2, z0), z)
                for z in self.interfaces
            ]
            crossings = [
                ((r_squared**0.5 if r_squared > 0 else -1.0, height), z)
                for (r_squared, height), z in crossings
            ]
        inner_crossings = [
            crossing for crossing in crossings if _is_between(crossing[0], side.start, side.end)
        ]
        return sorted(
            inner_crossings,
            key=lambda crossing: abs(crossing[0][0] - x0) + abs(crossing[0][1] - z0),
        )

    @property
    def coatings(self) -> tuple[Coating, ...]:
        """The layers around the core of a body with a spherical top, from the surface inwards."""
        if self.top_radius is None:
            return ()
        radii = [self.top_radius, *(self.top_radius + z for z in reversed(self.interfaces))]
        return tuple(
            Coating((0.0, 0.0, -self.top_radius), inner, outer) for outer, inner in pairwise(radii)
        )

    @property
    def interfaces(self) -> tuple[float, ...]:
        """z on the axis of the faces between layers [length], from below; under a spherical top
        they are concentric.
        """
        layers = [region for region in self.regions if region.inclusion is None]
        return tuple(region.bottom for region in reversed(layers[:-1]))

    @property
    def inclusions(self) -> tuple[Inclusion, ...]:
        """Those that are in the piece, wholly or in part: not those beyond a mirror plane."""

        def is_inside(inclusion: Inclusion) -> bool:
            return all(
                low - inclusion.half_width(k) < inclusion.center[k] < high + inclusion.half_width(k)
                for k, (low, high) in horizontal_extents
            )

        horizontal_extents = list(enumerate(self.extent[:-1]))
        return tuple(
            filter(is_inside, (region.inclusion for region in self.regions if region.inclusion))
        )

    @property
    def max_extent(self) -> float:
        """The longest side of the box around it [length]."""
        return max(high - low for low, high in self.extent)

    @property
    def max_width(self) -> float:
        """The longest horizontal side of the box around it [length]."""
        return max(high - low for low, high in self.extent[:-1])

    @property
    def area(self) -> float:
        """Area inside the outline [length^2]."""
        return sum(side.swept_area for side in self.outline)

    @property
    def wall_radius(self) -> float | None:
        """Radius of the curved wall in three dimensions [length]; None: every wall is flat."""
        radii = [side.radius for side in self.outline if side.center is not None]
        return min(radii) if radii and self.dim == 3 else None

    @property
    def top_radius(self) -> float | None:
        """Radius of a spherical top, whose apex is the origin [length]; None: the top is flat."""
        radii = [
            side.radius
            for side in self.outline
            if side.surface == "top" and side.center is not None
        ]
        return radii[0] if radii else None

    def wall_distances(self, center: Point) -> dict[str, float]:
        """The distance [length] from a tip's axis to each wall, along the surface; 0: a mirror
        plane.
        """
        x, y = (*center, 0.0)[:2]
        walls = [side for side in self.outline if side.surface not in ("top", "base")]
        return {side.surface: float(side.inward_distance(x, y)) for side in walls}

    def mirror_walls(self, center: Point) -> set[str]:
        """The walls that are mirror planes: rollers right under the tip's axis."""
        walls_at_axis = {
            wall
            for wall, distance in self.wall_distances(center).items()
            if distance <= MIRROR_DISTANCE
        }
        return {wall for wall in walls_at_axis if self.supports.get(wall) == "roller"}

    @property
    def mirror_planes(self) -> tuple[str, ...]:
        """Names of the surfaces of the modelled part that lie in symmetry planes of the whole body."""
        return tuple(f"{axis}_min" for axis in self.mirror_axes)

    @property
    def constrained_components(self) -> tuple[tuple[int, str], ...]:
        """Each component of the displacement that a support holds, and its surface."""
        sides: list[tuple[int, str]] = []
        for surface, support in self.supports.items():
            if support == "fixed":
                sides += [(component, surface) for component in range(self.dim)]
            elif support == "roller" and (normal := self.normal_component(surface)) is not None:
                sides.append((normal, surface))
        return tuple(sides)

    @property
    def has_curved_roller(self) -> bool:
        """Whether a curved wall in three dimensions is a roller, which has no one normal and is
        guided weakly.
        """
        return self.wall_radius is not None and self.supports.get("r_max") == "roller"

    def mirrored_body_count(self, center: Point) -> int:
        """How many times the whole body the tip sees, mirrored at rollers through its axis: 1, 2,
        or 4 at a corner.

        Its force is that share of the force on the body which it sees.
        """
        return (
            1
            if self.kinematics.name == "axisymmetric"
            else int(2 ** len(self.mirror_walls(center)) // self.symmetry_factor)
        )

    @property
    def file_hash(self) -> str:
        """Fingerprint of the mesh file that it comes from; "" where it is meshed here."""
        return ""

    def facet_sagitta(self, center: Point, radius: float, refinements: int = 0) -> float:
        """How far contact facets within a radius of the tip's axis are inside the surface that they
        stand for [length]: not at all where it is meshed here, whose surfaces are flat, or whose
        cells are curved.
        """
        return 0.0

    def facet_angle(self, center: Point, radius: float, refinements: int = 0) -> float:
        """The mean angle [radians] at which such facets meet."""
        return 0.0

    def normal_component(self, surface: str) -> int | None:
        """The component of u that a roller holds on a surface; None where no one axis is normal to
        it.
        """
        if surface in ("top", "base"):
            return self.dim - 1
        return next(side.normal_axis for side in self.outline if side.surface == surface)


def _is_between(point: Point, start: Point, end: Point) -> bool:
    """Whether a point of the line through two others lies between them."""
    return any(
        min(a, b) < coordinate < max(a, b)
        for coordinate, a, b in zip(point, start, end, strict=True)
    )


def polygon_sides(surfaces: tuple[str, ...], corners: tuple[Point, ...]) -> tuple[Side, ...]:
    """The straight sides between corners; the last goes back to the first."""
    corner_pairs = pairwise((*corners, corners[0]))
    return tuple(
        Side(surface, start, end)
        for surface, (start, end) in zip(surfaces, corner_pairs, strict=True)
    )


def nearest_on_sphere(radius: float, r: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The point of a spherical top nearest to a point (r, z) of its mesh, whose facets are chords
    [length].

    The distance d from the center (0, -radius) by d^2 - radius^2 = r^2 + z (z + 2 radius), to all
    digits near the apex.
    """
    squared_excess = r * r + z * (z + 2 * radius)
    distance = np.sqrt(squared_excess + radius * radius)
    scale = squared_excess / (distance * (distance + radius))
    return r - scale * r, z - scale * (z + radius)
