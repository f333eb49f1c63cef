"""Model domain: the part of a body that is meshed, with its regions and boundary conditions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, pi, sin
from typing import Any

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
    """Side of an outline: a straight line, or an arc of a circle or of an ellipse.

    Attributes
    ----------
    surface
        Name of the surface of which the side is a part.
    start, end
        End points [length]; seen from start to end, the inside of the outline is on the left.
    center
        Center of an arc, which goes anticlockwise from start to end [length]; None for a line.
    stretch
        Vertical over horizontal semi-axis of an arc. The arc of an ellipse is that of a circle
        whose vertical coordinates are multiplied by this number.
    """

    surface: str
    start: Point
    end: Point
    center: Point | None = None
    stretch: float = 1.0

    @property
    def normal_axis(self) -> int | None:
        """Axis to which a straight side is normal; None for an arc or an inclined side."""
        equal_axes = [axis for axis in (0, 1) if self.start[axis] == self.end[axis]]
        return equal_axes[0] if equal_axes and self.center is None else None

    @property
    def radius(self) -> float:
        """Radius of an arc, or horizontal semi-axis of the arc of an ellipse [length]."""
        return float(np.hypot(*self._offset(*self.start)))

    @property
    def apex_radius(self) -> float:
        """Radius of curvature at the highest point of the circle or ellipse of an arc [length]."""
        return self.radius / self.stretch

    def inward_distance(self, x: Coordinates, y: Coordinates) -> np.ndarray:
        """Return the signed distance [length] of points from the line or circle of the side.

        The distance is positive inside the outline: left of a line, and inside a circle. For an
        ellipse it is the distance from the circle of which the ellipse is a stretched image.
        """
        if self.center is not None:
            return self.radius - np.hypot(*self._offset(x, y))
        (x0, y0) = self.start
        (x1, y1) = self.end
        return ((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) / np.hypot(x1 - x0, y1 - y0)

    def distance(self, x: Coordinates, y: Coordinates) -> np.ndarray:
        """Return the distance [length] of points from the arc, or from the line of the side."""
        distance_to_curve = np.abs(self.inward_distance(x, y))
        if self.center is None:
            return distance_to_curve
        right, up = self._offset(x, y)
        angle_from_start = (np.arctan2(up, right) - self._start_angle) % (2 * pi)
        end_distances = [np.hypot(x - end[0], y - end[1]) for end in (self.start, self.end)]
        return np.where(
            angle_from_start <= self.arc_angle, distance_to_curve, np.minimum(*end_distances)
        )

    def sample_points(self, n: int) -> tuple[np.ndarray, float]:
        """Return n equidistant points (n, 2) on a side, and the length that each represents.

        The side is a line or an arc of a circle.
        """
        assert self.stretch == 1.0
        fraction = ((np.arange(n) + 0.5) / n)[:, None]
        if self.center is None:
            start = np.array(self.start)
            end = np.array(self.end)
            return start + fraction * (end - start), float(np.linalg.norm(end - start)) / n
        angle = self._start_angle + fraction * self.arc_angle
        directions = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
        length_per_point = self.radius * abs(self.arc_angle) / n
        return np.array(self.center) + self.radius * directions, length_per_point

    @property
    def arc_angle(self) -> float:
        """Central angle [radians] of the circular arc."""
        right, up = self._offset(*self.end)
        return (atan2(up, right) - self._start_angle) % (2 * pi)

    @property
    def swept_area(self) -> float:
        """Signed area [length^2] between the side and the lines from the origin to its end points.

        This area is that of the triangle below the chord, plus the circular segment of an arc.
        """
        (x0, y0) = self.start
        (x1, y1) = self.end
        triangle_area = (x0 * y1 - x1 * y0) / 2
        if self.center is None:
            return triangle_area
        circular_segment = self.radius**2 / 2 * (self.arc_angle - sin(self.arc_angle))
        return triangle_area + self.stretch * circular_segment

    @property
    def _start_angle(self) -> float:
        """Polar angle [radians] of the start of the circular arc about its center."""
        right, up = self._offset(*self.start)
        return atan2(up, right)

    def _offset(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the offset of points from the center of the arc [length].

        The vertical component is divided by `stretch`, so that the arc becomes a circle.
        """
        assert self.center is not None
        return x - self.center[0], (y - self.center[1]) / self.stretch


@dataclass(frozen=True)
class Region:
    """Region of one material: a layer, an inclusion, or a region of an imported mesh.

    Attributes
    ----------
    name
        Name for messages and results.
    material
        The elastic law; the instantaneous one if the material relaxes.
    formulation
        "displacement", or "mixed" (displacement and pressure).
    bottom
        Height z of a layer's lower face on the axis [length].
    inclusion
        Shape and position of an inclusion; None for other regions.
    relaxation_series
        Prony series of the shear relaxation, if it is integrated in time.
    min_shear_fraction
        Smallest fraction of the instantaneous shear modulus during the load path.
    """

    name: str
    material: Material
    formulation: str
    bottom: float = 0.0
    inclusion: Inclusion | None = None
    relaxation_series: PronySeries | None = None
    min_shear_fraction: float = 1.0

    @property
    def softest_constants(self) -> Constants:
        """Small-strain E [pressure] and nu of the softest state during the load path.

        Since only the shear modulus relaxes, this state is the closest to incompressibility.
        """
        return self.material.relaxed_constants(self.min_shear_fraction)


@dataclass(frozen=True)
class ModelDomain:
    """Part of the body that is meshed, with its boundary conditions.

    Attributes
    ----------
    kinematics
        axisymmetric, plane strain or three-dimensional.
    symmetry
        axisymmetric | quarter | half | full.
    symmetry_factor
        Number of model domains that make up the body.
    outline
        Sides in anticlockwise order. In two dimensions they enclose the section (r, z) or (x, z);
        in three dimensions the horizontal section, which is constant from the surface `base` at z =
        -height to the surface `top` at z = 0.
    height
        Height [length].
    regions
        Layers from the top to the base, then inclusions.
    supports
        free | roller | fixed | unbonded by surface. Surfaces without an entry are free; mirror
        planes are rollers. An unbonded base rests on a rigid flat and may lift off.
    pins
        Points and displacement components that are constrained to remove rigid-body modes.
    mirror_axes
        Axes (x, y) to which mirror planes are normal; such a plane is the side x_min or y_min of
        the domain.
    """

    kinematics: Kinematics
    symmetry: str
    symmetry_factor: int
    outline: tuple[Side, ...]
    height: float
    regions: tuple[Region, ...]
    supports: Mapping[str, str]
    pins: Pins = ()
    mirror_axes: tuple[str, ...] = ()

    @property
    def dim(self) -> int:
        """Number of space dimensions of the mesh."""
        return self.kinematics.dim

    @property
    def extent(self) -> tuple[tuple[float, float], ...]:
        """Smallest and largest coordinate along each axis [length].

        Only the ends of the sides are considered, because no arc extends beyond its ends.
        """
        coordinates = [[side.start[axis] for side in self.outline] for axis in (0, 1)]
        section_extent = tuple((min(values), max(values)) for values in coordinates)
        return section_extent if self.dim == 2 else (*section_extent, (-self.height, 0.0))

    def interface_level(self, x: Coordinates, z: Coordinates) -> np.ndarray:
        """Return the level of points: minus their distance below the top [length].

        Interfaces between layers are surfaces of constant level. The level is z below a flat top,
        and the distance from the center minus the radius below a spherical top.
        """
        if self.top_radius is None:
            return np.asarray(z)
        return np.hypot(x, z + self.top_radius) - self.top_radius

    def interface_crossings(self, side: Side) -> list[tuple[Point, float]]:
        """Return the points at which interfaces between layers cross a straight side of a section.

        Returns
        -------
        list of (point, level)
            Point (x, z) and level of the interface [length], in the order from the start of the
            side.
        """
        (x0, z0) = side.start
        (x1, z1) = side.end
        if self.top_radius is None:
            crossings = [
                ((x0 + (x1 - x0) * (z - z0) / (z1 - z0), z), z) for z in self.interfaces if z0 != z1
            ]
        elif x0 == x1:
            # The side on the axis is crossed above and below the common center of the interfaces.
            crossings = [
                ((x0, -self.top_radius + sign * (self.top_radius + z)), z)
                for z in self.interfaces
                for sign in (1, -1)
            ]
        else:
            crossings = [
                ((_interface_radius(self.top_radius, z, z0), z0), z) for z in self.interfaces
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
        """Layers around the core of a body with a spherical top, from the surface inwards."""
        if self.top_radius is None:
            return ()
        radii = [self.top_radius, *(self.top_radius + z for z in reversed(self.interfaces))]
        return tuple(
            Coating((0.0, 0.0, -self.top_radius), inner, outer) for outer, inner in pairwise(radii)
        )

    @property
    def interfaces(self) -> tuple[float, ...]:
        """Levels [length] of the interfaces between layers in ascending order.

        A level is the height z on the axis; below a spherical top the interfaces are concentric
        spheres.
        """
        layers = [region for region in self.regions if region.inclusion is None]
        return tuple(region.bottom for region in reversed(layers[:-1]))

    @property
    def inclusions(self) -> tuple[Inclusion, ...]:
        """Inclusions that lie at least partly in the domain, not beyond a mirror plane."""

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
        """Longest side of the bounding box [length]."""
        return max(high - low for low, high in self.extent)

    @property
    def max_width(self) -> float:
        """Longest horizontal side of the bounding box [length]."""
        return max(high - low for low, high in self.extent[:-1])

    @property
    def area(self) -> float:
        """Area inside the outline [length^2]."""
        return sum(side.swept_area for side in self.outline)

    @property
    def wall_radius(self) -> float | None:
        """Radius of the curved wall in three dimensions [length]; None if all walls are flat."""
        radii = [side.radius for side in self.outline if side.center is not None]
        return min(radii) if radii and self.dim == 3 else None

    @property
    def top_arc(self) -> Side | None:
        """Arc of a curved top, whose apex is the origin; None if the top is flat."""
        arcs = (side for side in self.outline if side.surface == "top" and side.center is not None)
        return next(arcs, None)

    @property
    def top_radius(self) -> float | None:
        """Radius of curvature of a curved top at its apex [length]; None if the top is flat."""
        return self.top_arc.apex_radius if self.top_arc else None

    @property
    def smallest_semi_axis(self) -> float | None:
        """Radius of a curved wall or top, or smaller semi-axis of an elliptic top [length]."""
        if self.top_arc:
            return self.top_arc.radius * min(1.0, self.top_arc.stretch)
        return self.wall_radius

    def wall_distances(self, center: Point) -> dict[str, float]:
        """Return the horizontal distance [length] from the tip's axis to each wall, by name."""
        x, y = (*center, 0.0)[:2]
        walls = [side for side in self.outline if side.surface not in ("top", "base")]
        return {side.surface: float(side.inward_distance(x, y)) for side in walls}

    def mirror_walls(self, center: Point) -> set[str]:
        """Return the walls that act as mirror planes: roller walls through the tip's axis."""
        # A tip's axis at most this far [length] from a wall is in the plane of the wall;
        # coordinates are rounded to 12 digits.
        mirror_distance = 1e-12
        walls_at_axis = {
            wall
            for wall, distance in self.wall_distances(center).items()
            if distance <= mirror_distance
        }
        return {wall for wall in walls_at_axis if self.supports.get(wall) == "roller"}

    @property
    def rests_on_flat(self) -> bool:
        """True if the body rests on a rigid flat without a bond."""
        return self.supports.get("base") == "unbonded"

    @property
    def mirror_planes(self) -> tuple[str, ...]:
        """Names of the surfaces of the domain that lie in mirror planes of the whole body."""
        return tuple(f"{axis}_min" for axis in self.mirror_axes)

    @property
    def constrained_components(self) -> tuple[tuple[int, str], ...]:
        """Displacement components that supports constrain, each with its surface."""
        components: list[tuple[int, str]] = []
        for surface, support in self.supports.items():
            if support == "fixed":
                components += [(component, surface) for component in range(self.dim)]
            elif support == "roller" and (normal := self.normal_component(surface)) is not None:
                components.append((normal, surface))
        return tuple(components)

    @property
    def has_curved_roller(self) -> bool:
        """Return whether a curved wall in three dimensions is a roller.

        No single displacement component is normal to such a wall, so that the condition is imposed
        weakly.
        """
        return self.wall_radius is not None and self.supports.get("r_max") == "roller"

    def mirrored_body_count(self, center: Point) -> int:
        """Return the number of bodies that the tip indents: the body and its mirror images.

        Rollers through the tip's axis are mirror planes. The number is 1, 2, or 4 at a corner. The
        force on the body is the total force of the tip divided by this number.
        """
        if self.kinematics.name == "axisymmetric":
            return 1
        return int(2 ** len(self.mirror_walls(center)) // self.symmetry_factor)

    @property
    def file_hash(self) -> str:
        """Hash of an imported mesh; empty for a domain that is meshed by the program."""
        return ""

    def facet_sagitta(self, center: Point, radius: float, refinements: int = 0) -> float:
        """Return the distance of facets near the tip from the exact surface [length].

        The distance is 0 for a domain that is meshed by the program, with a flat top or curved
        cells.
        """
        return 0.0

    def facet_angle(self, center: Point, radius: float, refinements: int = 0) -> float:
        """Return 0; the mean angle [radians] between facets is used for imported meshes only."""
        return 0.0

    def normal_component(self, surface: str) -> int | None:
        """Return the displacement component that a roller on a surface constrains.

        It is None if no single axis is normal to the surface.
        """
        if surface in ("top", "base"):
            return self.dim - 1
        return next(side.normal_axis for side in self.outline if side.surface == surface)


def _interface_radius(top_radius: float, level: float, z: float) -> float:
    """Return the radius [length] at which a spherical interface has the height z; -1 if nowhere."""
    r_squared = (top_radius + level) ** 2 - (top_radius + z) ** 2
    return r_squared**0.5 if r_squared > 0 else -1.0


def _is_between(point: Point, start: Point, end: Point) -> bool:
    """Return whether a point on the line through two points lies between them."""
    return any(
        min(a, b) < coordinate < max(a, b)
        for coordinate, a, b in zip(point, start, end, strict=True)
    )


def polygon_sides(surfaces: tuple[str, ...], corners: tuple[Point, ...]) -> tuple[Side, ...]:
    """Return the sides of a polygon from its corners and the surface name of each side."""
    corner_pairs = pairwise((*corners, corners[0]))
    return tuple(
        Side(surface, start, end)
        for surface, (start, end) in zip(surfaces, corner_pairs, strict=True)
    )


def nearest_on_sphere(radius: float, r: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points on a spherical top that are nearest to given points (r, z) [length].

    The apex of the top is the origin. The distance d of a point from the center (0, -radius) is
    computed from d^2 - radius^2 = r^2 + z (z + 2 radius), which loses no digits near the apex.

    Parameters
    ----------
    radius : float
        Radius of the top [length].
    r, z : numpy.ndarray
        Coordinates [length] of points near the top, for example on facets.

    Returns
    -------
    tuple of numpy.ndarray
        Coordinates r and z on the top [length].
    """
    squared_excess = r * r + z * (z + 2 * radius)
    distance = np.sqrt(squared_excess + radius * radius)
    scale = squared_excess / (distance * (distance + radius))
    return r - scale * r, z - scale * (z + radius)
