"""Inclusions: convex regions of another material inside one layer of a body."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isclose, pi, prod
from typing import Annotated, Literal, Self

import numpy as np
from annotated_types import Gt, Len

from indent_sim.model.algebra import Expr
from indent_sim.model.layers import Position
from indent_sim.model.materials import Material
from indent_sim.model.units import (
    LENGTH,
    Length,
    TaggedBy,
)

PositiveSize = Annotated[tuple[Annotated[float, Gt(0)], ...], Len(3, 3), LENGTH]
# Axes and half-width [length] of each span.
Spans = tuple[tuple[tuple[int, ...], float], ...]
# Length, area and volume of the unit ball by dimension.
UNIT_BALL_MEASURES = {1: 2.0, 2: pi, 3: 4 * pi / 3}
ALL_AXES = (0, 1, 2)
# Positions that differ by less than this fraction of a body's size count as equal, because lengths
# are rounded to 12 digits.
POSITION_TOLERANCE = 2e-11
# Alternating projections end when the distance decreases by less than this fraction.
MAX_PROJECTIONS = 1000
LEAST_APPROACH = 1e-9
# Ellipsoids a thousand times as long as thick need 20 steps of Newton's method.
NEWTON_STEPS = 40
# Points are moved by this fraction of a semi-axis off a plane of symmetry, on which the farthest
# point of an ellipsoid is not unique.
SYMMETRY_OFFSET = 1e-12


class _Inclusion(ABC):
    """Base class of inclusions: convex regions of another material inside one layer.

    The three planes through `center` normal to the axes are mirror planes.
    """

    center: Position

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume [length^3]."""

    @abstractmethod
    def half_width(self, axis: int) -> float:
        """Return the extent from its center along an axis [length]."""

    @abstractmethod
    def is_curved_where_thinnest(self, dim: int) -> bool:
        """Return whether the surface is curved across the smallest thickness.

        dim = 2: in the section that is meshed; dim = 3: in space.
        """

    @abstractmethod
    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """Return whether it is a body of revolution about a vertical axis."""

    @abstractmethod
    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """Return approximately the measure of all points within `distance` of it.

        The measure is the area of the section in two dimensions, the volume in three.
        """

    @abstractmethod
    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """Return its point nearest to a point (x, y, z) [length], which may be inside."""

    @abstractmethod
    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """Return the distance [length] from a point to its farthest point along some axes."""

    @property
    def min_half_width(self) -> float:
        """Half of its smallest thickness [length]."""
        return min(map(self.half_width, ALL_AXES))

    @abstractmethod
    def contains(self, point: Sequence[Expr]) -> Expr:
        """Return whether points (x, y, z) [length] are inside."""

    def distance(self, point: Sequence[Expr]) -> Expr:
        """Return the distance [length] from points to it, 0 inside."""
        return _norm(
            [
                nearest_coordinate - coordinate
                for nearest_coordinate, coordinate in zip(
                    self.nearest_point(point), point, strict=True
                )
            ]
        )

    def overlaps(self, second: _Inclusion, min_distance: float) -> bool:
        """Return whether two inclusions are nearer to each other than `min_distance` [length].

        The distance is found by alternating projections onto the two convex sets.
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
        """Return its mirror image about a plane normal to an axis."""
        center = list(self.center)
        center[axis] = 2 * position - center[axis]
        return replace(self, center=tuple(center))  # type: ignore[type-var]

    def _is_centered_on(self, center: tuple[float, ...]) -> bool:
        """Return whether its center lies on a vertical axis."""
        return bool(
            self._distance_from_center((*center, 0.0), (0, 1))
            <= POSITION_TOLERANCE * max(1.0, *map(abs, center))
        )

    def _distance_from_center(self, point: Sequence[Expr], axes: Sequence[int]) -> Expr:
        """Return the distance of a point from the center along some axes [length]."""
        return _norm([point[axis] - self.center[axis] for axis in axes])


def _norm(components: Sequence[Expr]) -> Expr:
    """Return the Euclidean norm of some components."""
    return (
        np.abs(components[0])
        if len(components) == 1
        else np.sqrt(sum(component * component for component in components))
    )


class _ProductInclusion(_Inclusion):
    """Product of intervals and disks: all points within the half-width of each span."""

    @property
    @abstractmethod
    def spans(self) -> Spans:
        """Axes and half-width [length] of each span."""

    @property
    def volume(self) -> float:
        """Volume [length^3]."""
        return prod(UNIT_BALL_MEASURES[len(axes)] * half ** len(axes) for axes, half in self.spans)

    def is_curved_where_thinnest(self, dim: int) -> bool:
        """Return whether the surface is curved across the smallest thickness."""
        axes, _ = min(self.spans, key=lambda span: span[1])
        return len(axes) > (2 if dim == 2 else 1)

    def half_width(self, axis: int) -> float:
        """Return the extent from its center along an axis [length]."""
        return next(half for axes, half in self.spans if axis in axes)

    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """Return whether it is a body of revolution about a vertical axis."""
        return any({0, 1} <= set(axes) for axes, _ in self.spans) and self._is_centered_on(center)

    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """Return approximately the measure of all points within `distance`, corners sharp."""
        spans = self.spans if dim == 3 else [((axis,), self.half_width(axis)) for axis in (0, 2)]
        return np.prod(
            [
                UNIT_BALL_MEASURES[len(axes)] * (half + distance) ** len(axes)
                for axes, half in spans
            ],
            axis=0,
        )

    def contains(self, point: Sequence[Expr]) -> Expr:
        """Return whether points (x, y, z) [length] are inside."""
        is_within = [self._distance_from_center(point, axes) <= half for axes, half in self.spans]
        return np.all(np.broadcast_arrays(*is_within), axis=0)

    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """Return its nearest point to (x, y, z) [length], which is nearest along each span."""
        coordinates = list(point)
        for axes, half in self.spans:
            scale = half / np.maximum(self._distance_from_center(point, axes), half)
            for axis in axes:
                coordinates[axis] = self.center[axis] + scale * (point[axis] - self.center[axis])
        return coordinates

    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """Return the distance [length] from a point to its farthest point along some axes."""
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
    """Ball about `center`; in a strip a round rod along y."""

    center: Position
    radius: Length
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["ball"] = "ball"

    @property
    def spans(self) -> Spans:
        """Span along every axis."""
        return ((ALL_AXES, self.radius),)


@dataclass(frozen=True)
class CylinderInclusion(_ProductInclusion):
    """Upright cylinder with its middle at `center`; in a strip a bar along y, 2 radius wide."""

    center: Position
    radius: Length
    height: Length
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["cylinder"] = "cylinder"

    @property
    def spans(self) -> Spans:
        """A disk in (x, y) and an interval in z."""
        return ((0, 1), self.radius), ((2,), self.height / 2)


@dataclass(frozen=True)
class BoxInclusion(_ProductInclusion):
    """Box with edges along the axes about `center`; in a strip it is infinite along y."""

    center: Position
    size: PositiveSize
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["box"] = "box"

    @property
    def spans(self) -> Spans:
        """Three intervals."""
        return tuple(((axis,), edge / 2) for axis, edge in enumerate(self.size))


@dataclass(frozen=True)
class EllipsoidInclusion(_Inclusion):
    """Ellipsoid about `center`, semi-axes along x, y, z; in a strip an elliptic rod along y."""

    center: Position
    semi_axes: PositiveSize
    material: Annotated[Material, TaggedBy("model")]
    shape: Literal["ellipsoid"] = "ellipsoid"

    @property
    def volume(self) -> float:
        """Volume [length^3]."""
        return UNIT_BALL_MEASURES[3] * prod(self.semi_axes)

    def half_width(self, axis: int) -> float:
        """Return the extent from its center along an axis [length]."""
        return self.semi_axes[axis]

    def is_curved_where_thinnest(self, dim: int) -> bool:
        """Return True: an ellipsoid is curved everywhere."""
        return True

    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """Return whether it is a body of revolution about a vertical axis."""
        a, b, _ = self.semi_axes
        return isclose(a, b, rel_tol=POSITION_TOLERANCE) and self._is_centered_on(center)

    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """Return the measure of the ellipsoid whose semi-axes are longer by `distance`."""
        halves = self.semi_axes if dim == 3 else self.semi_axes[::2]
        return UNIT_BALL_MEASURES[dim] * np.prod([half + distance for half in halves], axis=0)

    def contains(self, point: Sequence[Expr]) -> Expr:
        """Return whether points (x, y, z) [length] are inside."""
        return (
            sum(
                ((p - c) / s) ** 2
                for p, c, s in zip(point, self.center, self.semi_axes, strict=True)
            )
            <= 1
        )

    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """Return its point nearest to a point (x, y, z) [length].

        For a point center + v it is center + s^2 v/(t + s^2) with the t > 0 that puts it on the
        surface.
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
        """Return the distance [length] from a point to its farthest point along some axes.

        The farthest point is that of `nearest_point` with the smallest root t < 0, for which it
        lies on the other side of the center. -t = max(s)^2 + x is found by bisection of x >= 0.
        """
        s = np.array([self.semi_axes[axis] for axis in axes])
        offset = (
            np.array([abs(point[axis] - self.center[axis]) for axis in axes]) + SYMMETRY_OFFSET * s
        )
        squared_differences = (s.max() - s) * (s.max() + s)
        low = 0.0
        high = float(s.max() * np.sqrt(len(s)) * np.max(offset))
        while low < (midpoint := (low + high) / 2) < high:
            is_too_far = ((s * offset / (midpoint + squared_differences)) ** 2).sum() < 1
            low, high = (low, midpoint) if is_too_far else (midpoint, high)
        return float(_norm(list(offset + offset * s * s / (high + squared_differences))))


def _projection_multiplier(offset: np.ndarray, s: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the root t of sum (s offset/(t + s^2))^2 = 1 by Newton's method from below.

    The sum is convex and decreases with t there, so that the iteration is monotone.
    """
    t = start
    for _ in range(NEWTON_STEPS):
        terms = (s * offset / (t + s * s)) ** 2
        slope = -2 * (terms / (t + s * s)).sum(axis=0)
        t = t + np.maximum((1 - terms.sum(axis=0)) / np.where(slope < 0, slope, -1.0), 0.0)
    return t


Inclusion = BallInclusion | CylinderInclusion | BoxInclusion | EllipsoidInclusion
Inclusions = Annotated[tuple[Annotated[Inclusion, TaggedBy("shape")], ...], Len(1, 50)]
