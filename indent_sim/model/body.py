"""The soft bodies and how they are held. z is up, the undeformed top surface is z = 0, the body
lies below.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isclose, pi, prod, radians, tan
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from annotated_types import Gt, Len, Lt

from indent_sim.model.algebra import Expr
from indent_sim.model.materials import Material
from indent_sim.model.units import (
    ANGLE,
    LENGTH,
    PRESSURE,
    TIME,
    Auto,
    Length,
    SurfaceTension,
    TaggedBy,
    Unit,
    UnitRow,
)

Support = Literal["free", "roller", "fixed"]
BaseSupport = Literal["fixed", "roller"]
Points = tuple[np.ndarray, np.ndarray]  # x and y [length]
POINTS_PER_AXIS = (
    400  # along each axis; midpoints, so that the mean of a paraboloid is good to 1e-5
)
UNIT_MIDPOINTS = (np.arange(POINTS_PER_AXIS) + 0.5) / POINTS_PER_AXIS
UNIT_POINTS = np.linspace(0, 1, POINTS_PER_AXIS + 1)
FACET_TOLERANCE = 1e-9  # of a facet: so far outside a point still counts as on it
TINY_SQUARE = 1e-300  # no length is 0
ContactAngle = Annotated[float, Gt(0), Lt(180), ANGLE]
PositiveSize = Annotated[tuple[Annotated[float, Gt(0)], ...], Len(3, 3), LENGTH]
Position = Annotated[tuple[float, ...], Len(3, 3), LENGTH]  # (x, y, z)
Spans = tuple[tuple[tuple[int, ...], float], ...]  # axes and half-width [length] of each
UNIT_BALL_MEASURES = {1: 2.0, 2: pi, 3: 4 * pi / 3}  # their measures, by dimension
ALL_AXES = (0, 1, 2)  # axes
MAX_BATH_POINTS = 10_000  # of a bath
POSITION_TOLERANCE = 2e-11  # of a body: places to 12 digits
# of two convex bodies on one another, until they come no closer than by this share
MAX_PROJECTIONS = 1000
LEAST_APPROACH = 1e-9
NEWTON_STEPS = 40  # of Newton's method: ellipsoids a thousand times as long as thick need 20
SYMMETRY_OFFSET = 1e-12  # of a semi-axis: so far from a plane of symmetry nothing is on two sides


@dataclass(frozen=True)
class Layer:
    """One layer of a body, bonded to its neighbours; of the body's material where it has none of
    its own.

    The last one of a half-space has no thickness, nor has that of a cap or ball, whose others are
    skins around it.
    """

    thickness: Length | None = None
    material: Annotated[Material | None, TaggedBy("model")] = None


Layers = Annotated[tuple[Layer, ...], Len(1, 50)]


@dataclass(frozen=True)
class Coating:
    """The points whose distance from `center` is between two radii [length]: a skin of a cap or a
    ball.
    """

    center: Position
    inner_radius: float
    outer_radius: float

    @property
    def thickness(self) -> float:
        """outer - inner [length]."""
        return self.outer_radius - self.inner_radius


class _Inclusion(ABC):
    """Other matter inside one layer, convex and mirrored by the three planes through `center`
    normal to the axes.
    """

    center: Position

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume [length^3]."""

    @abstractmethod
    def half_width(self, axis: int) -> float:
        """How far it reaches from its center along an axis [length]."""

    @abstractmethod
    def is_curved_where_thinnest(self, dim: int) -> bool:
        """Whether it is curved where it is thinnest, in the section that is meshed or in space."""

    @abstractmethod
    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """Whether it is a body of revolution about a vertical axis."""

    @abstractmethod
    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """About the area of its section, or the volume, of what is no farther from it than `distance`
        [length].
        """

    @abstractmethod
    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """Its point nearest to a point (x, y, z), which itself may be inside [length]."""

    @abstractmethod
    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """Distance [length] from a point to its farthest point along some axes."""

    @property
    def min_half_width(self) -> float:
        """Half of its smallest thickness [length]."""
        return min(map(self.half_width, ALL_AXES))

    @abstractmethod
    def contains(self, point: Sequence[Expr]) -> Expr:
        """Whether points (x, y, z) [length] are inside."""

    def distance(self, point: Sequence[Expr]) -> Expr:
        """Distance [length] from points to it, 0 inside."""
        return _norm(
            [
                nearest_coordinate - coordinate
                for nearest_coordinate, coordinate in zip(
                    self.nearest_point(point), point, strict=True
                )
            ]
        )

    def overlaps(self, second: _Inclusion, min_distance: float) -> bool:
        """Whether the two are nearer than a distance [length]: by projections on the one and on the
        other in turn.
        """
        point = list(self.center)
        distance = inf
        for _ in range(MAX_PROJECTIONS):
            nearest = second.nearest_point(point)
            point = self.nearest_point(nearest)
            previous_distance = distance
            distance = float(_norm([a - b for a, b in zip(point, nearest, strict=True)]))
            if distance < min_distance or distance > (1 - LEAST_APPROACH) * previous_distance:
                break
        return distance < min_distance

    def mirror_image(self, axis: int, position: float) -> Self:
        """Its mirror image about a plane normal to an axis."""
        center = list(self.center)
        center[axis] = 2 * position - center[axis]
        return replace(self, center=tuple(center))  # type: ignore[type-var]

    def _is_centered_on(self, center: tuple[float, ...]) -> bool:
        """Whether its center is on a vertical axis."""
        return bool(
            self._distance_from_center((*center, 0.0), (0, 1))
            <= POSITION_TOLERANCE * max(1.0, *map(abs, center))
        )

    def _distance_from_center(self, point: Sequence[Expr], axes: Sequence[int]) -> Expr:
        return _norm([point[axis] - self.center[axis] for axis in axes])


def _norm(components: Sequence[Expr]) -> Expr:
    return (
        np.abs(components[0])
        if len(components) == 1
        else np.sqrt(sum(component * component for component in components))
    )


class _ProductInclusion(_Inclusion):
    """The points within the half-width of each span from `center` along its axes."""

    @property
    @abstractmethod
    def spans(self) -> Spans:
        """Axes and half-width [length] of each span."""

    @property
    def volume(self) -> float:
        """Volume [length^3]."""
        return prod(UNIT_BALL_MEASURES[len(axes)] * half ** len(axes) for axes, half in self.spans)

    def is_curved_where_thinnest(self, dim: int) -> bool:
        """As `_Inclusion`."""
        axes, _ = min(self.spans, key=lambda span: span[1])
        return len(axes) > (2 if dim == 2 else 1)

    def half_width(self, axis: int) -> float:
        """As `_Inclusion`."""
        return next(half for axes, half in self.spans if axis in axes)

    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """As `_Inclusion`."""
        return any({0, 1} <= set(axes) for axes, _ in self.spans) and self._is_centered_on(center)

    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """As `_Inclusion`, corners sharp."""
        spans = self.spans if dim == 3 else [((axis,), self.half_width(axis)) for axis in (0, 2)]
        return np.prod(
            [
                UNIT_BALL_MEASURES[len(axes)] * (half + distance) ** len(axes)
                for axes, half in spans
            ],
            axis=0,
        )

    def contains(self, point: Sequence[Expr]) -> Expr:
        """As `_Inclusion`."""
        is_within = [self._distance_from_center(point, axes) <= half for axes, half in self.spans]
        return np.all(np.broadcast_arrays(*is_within), axis=0)

    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """As `_Inclusion`: nearest along each span."""
        coordinates = list(point)
        for axes, half in self.spans:
            scale = half / np.maximum(self._distance_from_center(point, axes), half)
            for axis in axes:
                coordinates[axis] = self.center[axis] + scale * (point[axis] - self.center[axis])
        return coordinates

    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """As `_Inclusion`."""
        relevant_spans = [
            (tuple(axis for axis in span_axes if axis in axes), half)
            for span_axes, half in self.spans
        ]
        return float(
            _norm(
                [
                    self._distance_from_center(point, span_axes) + half
                    for span_axes, half in relevant_spans
                    if span_axes
                ]
            )
        )


@dataclass(frozen=True)
class BallInclusion(_ProductInclusion):
    """A ball about `center`; in a strip a round rod along y."""

    center: Position
    radius: Length
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["ball"] = "ball"

    @property
    def spans(self) -> Spans:
        """Round in all directions."""
        return ((ALL_AXES, self.radius),)


@dataclass(frozen=True)
class CylinderInclusion(_ProductInclusion):
    """An upright cylinder whose middle is `center`; in a strip a bar along y, 2 radius wide."""

    center: Position
    radius: Length
    height: Length
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["cylinder"] = "cylinder"

    @property
    def spans(self) -> Spans:
        """Round from above."""
        return ((0, 1), self.radius), ((2,), self.height / 2)


@dataclass(frozen=True)
class BoxInclusion(_ProductInclusion):
    """A box with edges along the axes whose middle is `center`; in a strip it goes on without end
    along y.
    """

    center: Position
    size: PositiveSize
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["box"] = "box"

    @property
    def spans(self) -> Spans:
        """Between three pairs of faces."""
        return tuple(((axis,), edge / 2) for axis, edge in enumerate(self.size))


@dataclass(frozen=True)
class EllipsoidInclusion(_Inclusion):
    """An ellipsoid about `center` with semi-axes along x, y and z; in a strip an elliptic rod along
    y.
    """

    center: Position
    semi_axes: PositiveSize
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["ellipsoid"] = "ellipsoid"

    @property
    def volume(self) -> float:
        """Volume [length^3]."""
        return UNIT_BALL_MEASURES[3] * prod(self.semi_axes)

    def half_width(self, axis: int) -> float:
        """As `_Inclusion`."""
        return self.semi_axes[axis]

    def is_curved_where_thinnest(self, dim: int) -> bool:
        """It is."""
        return True

    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """As `_Inclusion`."""
        a, b, _ = self.semi_axes
        return isclose(a, b, rel_tol=POSITION_TOLERANCE) and self._is_centered_on(center)

    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """As `_Inclusion`, by semi-axes that are longer by so much."""
        halves = self.semi_axes if dim == 3 else self.semi_axes[::2]
        return UNIT_BALL_MEASURES[dim] * np.prod([half + distance for half in halves], axis=0)

    def contains(self, point: Sequence[Expr]) -> Expr:
        """As `_Inclusion`."""
        return (
            sum(
                ((p - c) / s) ** 2
                for p, c, s in zip(point, self.center, self.semi_axes, strict=True)
            )
            <= 1
        )

    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """As `_Inclusion`: center + s^2 v/(t + s^2) of points center + v, t > 0 where that is on
        the surface.
        """
        offset = np.array(
            np.broadcast_arrays(*(p - c for p, c in zip(point, self.center, strict=True))),
            dtype=float,
        )
        s = np.reshape(self.semi_axes, (3,) + (1,) * (offset.ndim - 1))
        t = _projection_multiplier(
            offset, s, np.maximum(np.max(s * np.abs(offset) - s * s, axis=0), 0.0)
        )
        surface_offset = np.where(
            ((offset / s) ** 2).sum(axis=0) > 1, offset * s * s / (t + s * s), offset
        )
        return [c + component for c, component in zip(self.center, surface_offset, strict=True)]

    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """As `_Inclusion`: likewise with the largest -t, longest^2 + beyond, where all of it is on
        this side of it.
        """
        s = np.array([self.semi_axes[axis] for axis in axes])
        offset = (
            np.array([abs(point[axis] - self.center[axis]) for axis in axes]) + SYMMETRY_OFFSET * s
        )  # on one side of it
        squared_differences = (s.max() - s) * (s.max() + s)
        low = 0.0
        high = float(s.max() * np.sqrt(len(s)) * np.max(offset))
        while low < (midpoint := (low + high) / 2) < high:
            is_too_far = ((s * offset / (midpoint + squared_differences)) ** 2).sum() < 1
            low, high = (low, midpoint) if is_too_far else (midpoint, high)
        return float(_norm(list(offset + offset * s * s / (high + squared_differences))))


def _projection_multiplier(offset: np.ndarray, s: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The root t of sum (s off/(t + s^2))^2 = 1 by Newton's method from below, where the sum is
    convex and falls.
    """
    t = start
    for _ in range(NEWTON_STEPS):
        terms = (s * offset / (t + s * s)) ** 2
        slope = -2 * (terms / (t + s * s)).sum(axis=0)
        t = t + np.maximum((1 - terms.sum(axis=0)) / np.where(slope < 0, slope, -1.0), 0.0)
    return t


Inclusion = BallInclusion | CylinderInclusion | BoxInclusion | EllipsoidInclusion
Inclusions = Annotated[tuple[Annotated[Inclusion, TaggedBy("shape")], ...], Len(1, 50)]


@dataclass(frozen=True)
class StripSides:
    """The two walls of a strip; roller: no normal displacement."""

    x_min: Support = "free"
    x_max: Support = "free"


@dataclass(frozen=True)
class BoxSides(StripSides):
    """The four walls of a box; roller: no normal displacement."""

    y_min: Support = "free"
    y_max: Support = "free"


class _CenteredBody:
    """What holds of a body about the z axis that says nothing else: no side holds it."""

    dim: ClassVar[int] = 3  # 2 in plane strain, where forces are per unit length
    center: ClassVar[tuple[float, ...]] = (0.0, 0.0)  # where the tip stands

    @property
    def is_laterally_confined(self) -> bool:
        """Whether no side lets the body out."""
        return False

    def fixed_edge_points(self) -> Points:
        """Points along the top of all fixed sides."""
        return np.empty(0), np.empty(0)


class _RoundBody(_CenteredBody):
    """What bodies of revolution have in common: their outline, as seen from above, is a circle
    about the origin.
    """

    radius: float

    @property
    def max_section_radius(self) -> float:
        """The largest radius of a horizontal section [length]."""
        return self.radius

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the outline."""
        return self.max_section_radius - float(sum(c * c for c in center) ** 0.5)

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farthest point of the outline."""
        return self.max_section_radius + float(sum(c * c for c in center) ** 0.5)

    def top_points(self) -> Points:
        """Points as seen from above, each standing for an equal area there."""
        r = self.max_section_radius * np.sqrt(UNIT_MIDPOINTS)[:, None]
        angle = 2 * np.pi * UNIT_MIDPOINTS[None, :]
        return r * np.cos(angle), r * np.sin(angle)


@dataclass(frozen=True)
class Cylinder(_RoundBody):
    """0 <= r <= radius, -height <= z <= 0 [length]."""

    radius: Length
    height: Length
    shape: Literal["cylinder"] = "cylinder"
    base: BaseSupport = "fixed"
    sides: Support = "free"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Distance [length] from an inclusion to the wall; negative where it is outside."""
        return self.radius - inclusion.farthest_distance((0.0, 0.0), (0, 1))

    @property
    def is_laterally_confined(self) -> bool:
        """Whether no side lets the body out."""
        return self.sides != "free"

    def fixed_edge_points(self) -> Points:
        """Points along the top of all fixed sides."""
        angle = 2 * np.pi * (UNIT_POINTS if self.sides == "fixed" else UNIT_POINTS[:0])
        return self.radius * np.cos(angle), self.radius * np.sin(angle)


class _WalledBody(ABC):
    """What bodies between vertical walls have in common: each horizontal axis goes from 0 to a
    width.
    """

    sides: StripSides

    @property
    @abstractmethod
    def widths(self) -> tuple[float, ...]:
        """Distances [length] between opposite walls."""

    @property
    def center(self) -> tuple[float, ...]:
        """The middle of the top."""
        return tuple(width / 2 for width in self.widths)

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the nearest edge of the top, beyond which nothing goes
        on.

        A roller wall right under the tip's axis is a mirror plane: the tip sees the body go on
        behind it.
        """
        distances: dict[str, float] = {}
        for axis, position, width in zip("xy", center, self.widths, strict=False):
            distances |= {f"{axis}_min": position, f"{axis}_max": width - position}
        return min(
            distance for wall, distance in distances.items() if not self._is_mirror(distance, wall)
        )

    def _is_mirror(self, distance: float, wall: str) -> bool:
        return (
            abs(distance) <= POSITION_TOLERANCE * max(self.widths)
            and getattr(self.sides, wall) == "roller"
        )

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farthest corner of the top."""
        positions = zip(center, self.widths, strict=True)
        return float(
            sum(max(position, width - position) ** 2 for position, width in positions) ** 0.5
        )

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Distance [length] from an inclusion to the nearest wall; negative where it is outside."""
        positions = enumerate(zip(inclusion.center, self.widths, strict=False))
        return min(
            min(position, width - position) - inclusion.half_width(axis)
            for axis, (position, width) in positions
        )

    @property
    def is_laterally_confined(self) -> bool:
        """Whether no side lets the body out."""
        return "free" not in vars(self.sides).values()


@dataclass(frozen=True)
class Strip(_WalledBody):
    """0 <= x <= width, -height <= z <= 0 [length], plane strain: forces per unit length."""

    width: Length
    height: Length
    shape: Literal["strip"] = "strip"
    base: BaseSupport = "fixed"
    sides: StripSides = StripSides()
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    dim: ClassVar[int] = 2  # forces are per unit length

    @property
    def widths(self) -> tuple[float, ...]:
        """The width alone [length]."""
        return (self.width,)

    def top_points(self) -> Points:
        """Points of the top edge, each standing for an equal length."""
        return self.width * UNIT_MIDPOINTS, np.zeros(POINTS_PER_AXIS)

    def fixed_edge_points(self) -> Points:
        """Points along the top of all fixed sides."""
        wall_positions = {"x_min": 0.0, "x_max": self.width}
        x = np.array(
            [
                position
                for side, position in wall_positions.items()
                if getattr(self.sides, side) == "fixed"
            ]
        )
        return x, 0 * x


@dataclass(frozen=True)
class Box(_WalledBody):
    """0 <= x <= lx, 0 <= y <= ly, -lz <= z <= 0 [length]."""

    size: PositiveSize
    shape: Literal["box"] = "box"
    base: BaseSupport = "fixed"
    sides: BoxSides = BoxSides()
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    dim: ClassVar[int] = 3

    @property
    def height(self) -> float:
        """Thickness lz [length]."""
        return self.size[2]

    @property
    def widths(self) -> tuple[float, ...]:
        """(lx, ly) [length]."""
        return self.size[:2]

    def top_points(self) -> Points:
        """Points of the top surface, each standing for an equal area."""
        return self.size[0] * UNIT_MIDPOINTS[:, None], self.size[1] * UNIT_MIDPOINTS[None, :]

    def fixed_edge_points(self) -> Points:
        """Points along the top of all fixed sides."""
        lx, ly = self.widths
        x = lx * UNIT_POINTS
        y = ly * UNIT_POINTS
        zero = 0 * UNIT_POINTS
        lines = {
            "x_min": (zero, y),
            "x_max": (zero + lx, y),
            "y_min": (x, zero),
            "y_max": (x, zero + ly),
        }
        fixed = [lines[side] for side, support in vars(self.sides).items() if support == "fixed"]
        coordinates = np.hstack([np.empty((2, 0)), *map(np.array, fixed)])
        return coordinates[0], coordinates[1]


class _UnboundedBody(_CenteredBody):
    """What bodies without sides have in common: every place is equal, and there is room beside any
    contact.
    """

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """There is no edge of the top surface."""
        return inf

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """The top surface has no farthest point."""
        return inf

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """There is no wall."""
        return inf

    def top_points(self) -> Points:
        """No points: there is no mean over all of the top surface."""
        return np.empty(0), np.empty(0)


@dataclass(frozen=True)
class HalfSpace(_UnboundedBody):
    """z <= 0 without end: solved by theory, or on a finite body that is large enough."""

    shape: Literal["half_space"] = "half_space"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    height: ClassVar[float] = inf


@dataclass(frozen=True)
class InfiniteLayer(_UnboundedBody):
    """-height <= z <= 0 [length], infinitely wide: solved by theory, or on a finite body that is
    large enough.
    """

    height: Length
    shape: Literal["layer"] = "layer"
    base: BaseSupport = "fixed"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0


@dataclass(frozen=True)
class SphericalBody(_RoundBody):
    """The piece of a ball below its apex at z = 0, down to the plane z = -height [length]; its base
    is there.

    A whole ball (height = 2 radius) is held below its equator instead. pieces: see `Scales`.
    """

    radius: Length
    height: Length
    shape: Literal["cap", "ball"]
    base: BaseSupport = "fixed"
    contacts_per_body: int = 1
    inclusions: Inclusions | None = None

    @property
    def max_coating_thickness(self) -> float:
        """How thick skins may be together [length], all but: beyond it the core would not reach the
        base.
        """
        return (
            self.radius
            if self.height == 2 * self.radius
            else min(self.height, 2 * self.radius - self.height)
        )

    @property
    def base_edge(self) -> tuple[float, float]:
        """(r, z) [length] of the edge between the curved surface and the base."""
        depth = self.radius if self.height == 2 * self.radius else self.height
        return float(depth * (2 * self.radius - depth)) ** 0.5, -depth

    @property
    def max_section_radius(self) -> float:
        """The largest radius of a horizontal section [length]."""
        return self.radius if self.height > self.radius else self.base_edge[0]

    def wall_clearance(self, inclusion: Inclusion) -> float:
        """Distance [length] from an inclusion to the curved surface; negative where it is outside."""
        return self.radius - inclusion.farthest_distance((0.0, 0.0, -self.radius))


@dataclass(frozen=True)
class MeshSurfaces:
    """Names that the file gives to the surface which the tip may touch, to the base and to the
    sides.

    Without them the contact surface is what faces up, the base what faces down and is level, and
    sides that are held what is upright.
    """

    contact: str | None = None
    base: str | None = None
    sides: str | None = None


@dataclass(frozen=True)
class MeshFromFile:
    """A body meshed elsewhere, z up; a file in two dimensions has (r, z) or (x, z) in its (x, y),
    the axis is r = 0.

    The tip's axis is at x = 0, y = 0 of the file unless `indenter.center` says otherwise. What is
    none of `surfaces` is free; a surface without a name is known by where it faces, or the file is
    refused. `regions` gives each named region its material; cells of no region are of the scene's.
    sides auto: free, but asked for where a face lies in a plane through the tip's axis, which is a
    mirror (roller) of half a body, or an end (free) of a whole one.
    """

    file: str
    kinematics: Literal["axisymmetric", "plane_strain", "3d"]
    surfaces: MeshSurfaces = MeshSurfaces()
    shape: Literal["mesh"] = "mesh"
    base: BaseSupport = "fixed"
    sides: Support | Auto = "auto"
    regions: dict[str, Annotated[Material, TaggedBy("model")]] | None = None
    hash: str | None = None

    layers: ClassVar[None] = None  # it has regions
    inclusions: ClassVar[None] = None
    surface_tension: ClassVar[float] = 0.0

    @property
    def surface_names(self) -> MeshSurfaces:
        """The names of all surfaces that it has, those for a copy of the file among them."""
        given = self.surfaces
        sides = "sides" if self.sides in ("roller", "fixed") else None
        return MeshSurfaces(given.contact or "contact", given.base or "base", given.sides or sides)

    @property
    def dim(self) -> int:
        """2 in plane strain, where forces are per unit length."""
        return 2 if self.kinematics == "plane_strain" else 3

    @property
    def center(self) -> tuple[float, ...]:
        """The file's own axis."""
        return (0.0,) * (self.dim - 1)


@dataclass(frozen=True)
class ImportedBody:
    """A body as its mesh has it: what is known of its contact surface. z = 0 where the tip first
    touches.

    facets (k, n, n): corners of the contact surface's facets; rim (m, n - 1, n): the edges around
    it, in two dimensions its ends; clamped (j, n): those of its points that are held too [length].
    """

    height: Length
    center: Annotated[tuple[float, ...], LENGTH]  # where the tip's axis is
    facets: Annotated[np.ndarray, LENGTH]
    boundary_edges: Annotated[np.ndarray, LENGTH]
    fixed_points: Annotated[np.ndarray, LENGTH]
    layers: Layers  # the matter under the tip's axis, as a single one
    base: BaseSupport
    sides: Support
    dim: int  # 2 in plane strain, where forces are per unit length
    shape: Literal["mesh"] = "mesh"

    is_laterally_confined: ClassVar[bool] = False  # not known, and what is not known is not refused
    inclusions: ClassVar[None] = None

    def lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the nearest edge of the contact surface; negative
        outside of it.
        """
        position = self._plan_coordinates(center)
        start = self.boundary_edges[:, 0, :-1]
        edge_vector = self.boundary_edges[:, -1, :-1] - self.boundary_edges[:, 0, :-1]
        edge_fraction = ((position - start) * edge_vector).sum(axis=1) / np.maximum(
            (edge_vector**2).sum(axis=1), TINY_SQUARE
        )
        nearest_points = start + np.clip(edge_fraction, 0.0, 1.0)[:, None] * edge_vector
        distance = float(np.linalg.norm(nearest_points - position, axis=1).min(initial=np.inf))
        return (
            distance
            if (barycentric_coordinates(self.facets, center) >= -FACET_TOLERANCE).all(axis=1).any()
            else -distance
        )

    def max_lateral_extent(self, center: tuple[float, ...]) -> float:
        """Distance [length] from `center` to the farthest point of the contact surface."""
        return float(self.corner_distances(center).max())

    def corner_distances(self, center: tuple[float, ...]) -> np.ndarray:
        """Distances [length] of the corners of the facets from a vertical axis (k, n)."""
        return np.asarray(
            np.linalg.norm(self.facets[..., :-1] - self._plan_coordinates(center), axis=-1)
        )

    def top_points(self) -> Points:
        """The corners of the facets, seen from above."""
        x, y = np.moveaxis(np.pad(self.facets[..., :-1], ((0, 0), (0, 0), (0, 1)))[..., :2], -1, 0)
        return x, y

    def fixed_edge_points(self) -> Points:
        """Those points of the contact surface that are held, seen from above."""
        x, y = np.pad(self.fixed_points[:, :-1], ((0, 0), (0, 1)))[:, :2].T
        return x, y

    def _plan_coordinates(self, center: tuple[float, ...]) -> np.ndarray:
        return np.asarray(center[: self.facets.shape[2] - 1])


def barycentric_coordinates(facets: np.ndarray, center: tuple[float, ...]) -> np.ndarray:
    """The barycentric coordinates (k, n) of a point in facets (k, n, n), seen from above."""
    plan_corners = facets[..., :-1]
    edges = np.swapaxes(plan_corners[:, 1:] - plan_corners[:, :1], 1, 2)
    coordinates = np.linalg.solve(
        edges, (np.asarray(center[: plan_corners.shape[2]]) - plan_corners[:, 0])[..., None]
    )[..., 0]
    return np.column_stack([1 - coordinates.sum(axis=1), coordinates])


@dataclass(frozen=True)
class Cap(_CenteredBody):
    """The part of a ball above the plane z = -height, on which it stands with `base_radius`
    [length].

    Either `height` or `contact_angle` [degrees], between base and surface inside the body: height =
    base_radius tan(contact_angle/2). Beyond 90 degrees the body is wider than its base. Layers are
    skins of constant thickness, concentric, from the curved surface inwards; the last one, the
    core, has no thickness.
    """

    base_radius: Length
    height: Length | None = None
    contact_angle: ContactAngle | None = None
    shape: Literal["cap"] = "cap"
    base: BaseSupport = "fixed"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    @property
    def apex_height(self) -> float:
        """The height, given or by the contact angle [length]."""
        return self.height or self.base_radius * tan(radians(self.contact_angle or 90.0) / 2)

    @property
    def spherical_body(self) -> SphericalBody:
        """The same body by the radius of its ball, (base_radius^2 + height^2)/(2 height)."""
        height = self.apex_height
        radius = (self.base_radius**2 + height**2) / (2 * height)
        return SphericalBody(radius, height, "cap", self.base, inclusions=self.inclusions)


@dataclass(frozen=True)
class Ball(_CenteredBody):
    """A ball whose highest point is the origin: -2 radius <= z <= 0 [length].

    base roller: the plane through its center is a mirror plane, below which the same tip pushes up:
    `delta` is the approach of the two, and an inclusion is above that plane, and mirrored, or
    centered on it. fixed: the lower half of its surface is bonded to something rigid. Layers are
    concentric skins from the surface inwards; the last one, the core, has no thickness.
    """

    radius: Length
    shape: Literal["ball"] = "ball"
    base: BaseSupport = "roller"
    layers: Layers | None = None
    inclusions: Inclusions | None = None
    surface_tension: SurfaceTension = 0.0

    @property
    def spherical_body(self) -> SphericalBody:
        """What is modelled of it: the half above the mirror plane, or all of it."""
        if self.base == "roller":
            return SphericalBody(self.radius, self.radius, "ball", self.base, 2, self.inclusions)
        return SphericalBody(
            self.radius, 2 * self.radius, "ball", self.base, inclusions=self.inclusions
        )


@dataclass(frozen=True)
class Conductance:
    """A surface that lets out the flux `conductance` p [length/time] at the pressure p above the
    bath's.
    """

    conductance: Annotated[float, Gt(0), Unit("length/(pressure time)")]


DrainCondition = Literal["drained", "sealed"]
BathPoint = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, PRESSURE))]


@dataclass(frozen=True)
class Drainage:
    """Where a body with fluid in its pores lets it out, into a bath of the pressure `bath`
    [pressure].

    surface: what the tip may touch, where it does not; tip: where it does; sides auto: drained
    where they are free. Mirror planes are sealed. bath: a number, or [t, value] points, straight
    between them; at rest there is none. Of a gel it is the solvent's chemical potential [kT], and
    at rest that of free swelling.

    bath_ramp: the time that a sudden bath takes to come. No step of Newton's method finds the thin
    layer that swells at once, so that a sudden bath at finite strain comes evenly within it; auto:
    a seventy-fifth of the time that fluid takes through the contact, whatever the mesh. At small
    strain auto is 0, at once.
    """

    surface: DrainCondition = "drained"
    tip: DrainCondition | Conductance = "sealed"
    base: DrainCondition | Conductance = "sealed"
    sides: DrainCondition | Auto = "auto"
    bath: Annotated[float, PRESSURE] | Annotated[tuple[BathPoint, ...], Len(1, MAX_BATH_POINTS)] = (
        0.0
    )
    bath_ramp: Annotated[float, Gt(0), TIME] | Auto = "auto"

    def with_time_origin(self, origin: float) -> Drainage:
        """The same with the bath's times counted from another one."""
        if isinstance(self.bath, float | int):
            return self
        return replace(self, bath=tuple((t - origin, value) for t, value in self.bath))

    def drains_wall(self, support: str) -> bool:
        """Whether a wall with this support lets fluid out."""
        return self.sides == "drained" or (self.sides == "auto" and support == "free")

    @property
    def bath_values(self) -> tuple[float, ...]:
        """Values of the bath, between which all others lie."""
        return (
            (float(self.bath),)
            if isinstance(self.bath, float | int)
            else tuple(value for _, value in self.bath)
        )

    def bath_at(self, t: float) -> float:
        """The bath at a time; before the first point, and after the last, as there."""
        if isinstance(self.bath, float | int):
            return float(self.bath)
        times, values = zip(*self.bath, strict=True)
        return float(np.interp(t, times, values))


UnboundedBody = HalfSpace | InfiniteLayer
DimensionedBody = Cylinder | Strip | Box | SphericalBody  # meshed here
Body = DimensionedBody | ImportedBody | UnboundedBody
AnyBody = Cylinder | Strip | Box | UnboundedBody | Cap | Ball | MeshFromFile
