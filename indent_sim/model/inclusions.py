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


class _Inclusion(ABC):
    """Base class of inclusions: convex regions of another material inside one layer.

    The three planes through `center` normal to the axes are mirror planes.
    """

    center: Position

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume of the inclusion [length^3]."""

    @abstractmethod
    def half_width(self, axis: int) -> float:
        """Return the half-width of the inclusion along an axis [length]."""

    @abstractmethod
    def is_curved_where_thinnest(self, dim: int) -> bool:
        """Return whether the surface is curved across the smallest thickness.

        dim = 2: in the section that is meshed; dim = 3: in space.
        """

    @abstractmethod
    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """Return whether the inclusion is axisymmetric about a vertical axis."""

    @abstractmethod
    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """Return the approximate size of the region within `distance` of the inclusion.

        The size is the area of the section in two dimensions, the volume in three.
        """

    @abstractmethod
    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """Return the point of the inclusion nearest to a point (x, y, z), which may be inside."""

    @abstractmethod
    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """Return the largest distance, along some axes, of the inclusion's points from a point."""

    @property
    def min_half_width(self) -> float:
        """Half of the smallest thickness of the inclusion [length]."""
        return min(map(self.half_width, ALL_AXES))

    @abstractmethod
    def contains(self, point: Sequence[Expr]) -> Expr:
        """Return whether points (x, y, z) [length] are inside the inclusion."""

    def distance(self, point: Sequence[Expr]) -> Expr:
        """Return the distance [length] from points to the inclusion, 0 inside."""
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

        The distance is found by alternating projections onto the two convex sets, which end when it
        decreases by less than 1e-9 of its value.
        """
        point = list(self.center)
        distance = inf
        for _ in range(1000):
            nearest = second.nearest_point(point)
            point = self.nearest_point(nearest)
            previous_distance = distance
            distance = float(_norm([a - b for a, b in zip(point, nearest, strict=True)]))
            if distance < min_distance or distance > (1 - 1e-9) * previous_distance:
                break
        return distance < min_distance

    def mirror_image(self, axis: int, position: float) -> Self:
        """Return the mirror image of the inclusion in a plane normal to an axis."""
        center = list(self.center)
        center[axis] = 2 * position - center[axis]
        return replace(self, center=tuple(center))  # type: ignore[type-var]

    def _is_centered_on(self, center: tuple[float, ...]) -> bool:
        """Return whether the center of the inclusion lies on a vertical axis."""
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
    """Cartesian product of intervals and disks, called spans, each with a half-width."""

    @property
    @abstractmethod
    def spans(self) -> Spans:
        """Axes and half-width [length] of each span."""

    @property
    def volume(self) -> float:
        """Volume of the inclusion [length^3]."""
        return prod(UNIT_BALL_MEASURES[len(axes)] * half ** len(axes) for axes, half in self.spans)

    def is_curved_where_thinnest(self, dim: int) -> bool:
        """Return whether the surface is curved across the smallest thickness."""
        axes, _ = min(self.spans, key=lambda span: span[1])
        return len(axes) > (2 if dim == 2 else 1)

    def half_width(self, axis: int) -> float:
        """Return the half-width of the inclusion along an axis [length]."""
        return next(half for axes, half in self.spans if axis in axes)

    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """Return whether the inclusion is axisymmetric about a vertical axis."""
        return any({0, 1} <= set(axes) for axes, _ in self.spans) and self._is_centered_on(center)

    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """Return the approximate size of the region within `distance`; corners are not rounded."""
        spans = self.spans if dim == 3 else [((axis,), self.half_width(axis)) for axis in (0, 2)]
        return np.prod(
            [
                UNIT_BALL_MEASURES[len(axes)] * (half + distance) ** len(axes)
                for axes, half in spans
            ],
            axis=0,
        )

    def contains(self, point: Sequence[Expr]) -> Expr:
        """Return whether points (x, y, z) [length] are inside the inclusion."""
        is_within = [self._distance_from_center(point, axes) <= half for axes, half in self.spans]
        return np.all(np.broadcast_arrays(*is_within), axis=0)

    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """Return the point of the inclusion nearest to (x, y, z) [length], found span by span."""
        coordinates = list(point)
        for axes, half in self.spans:
            scale = half / np.maximum(self._distance_from_center(point, axes), half)
            for axis in axes:
                coordinates[axis] = self.center[axis] + scale * (point[axis] - self.center[axis])
        return coordinates

    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """Return the largest distance, along some axes, of the inclusion's points from a point."""
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
        """One span with all three axes and the radius."""
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
        """Two spans: a disk in (x, y) and an interval in z."""
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
        """Three spans: an interval along each axis."""
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
        """Volume of the inclusion [length^3]."""
        return UNIT_BALL_MEASURES[3] * prod(self.semi_axes)

    def half_width(self, axis: int) -> float:
        """Return the half-width of the inclusion along an axis [length]."""
        return self.semi_axes[axis]

    def is_curved_where_thinnest(self, dim: int) -> bool:
        """Return True: an ellipsoid is curved everywhere."""
        return True

    def is_axisymmetric_about(self, center: tuple[float, ...]) -> bool:
        """Return whether the inclusion is axisymmetric about a vertical axis."""
        a, b, _ = self.semi_axes
        return isclose(a, b, rel_tol=POSITION_TOLERANCE) and self._is_centered_on(center)

    def measure_within_distance(self, distance: Expr, dim: int) -> Expr:
        """Return the area or volume of an ellipsoid whose semi-axes are longer by `distance`."""
        halves = self.semi_axes if dim == 3 else self.semi_axes[::2]
        return UNIT_BALL_MEASURES[dim] * np.prod([half + distance for half in halves], axis=0)

    def contains(self, point: Sequence[Expr]) -> Expr:
        """Return whether points (x, y, z) [length] are inside the inclusion."""
        return (
            sum(
                ((p - c) / s) ** 2
                for p, c, s in zip(point, self.center, self.semi_axes, strict=True)
            )
            <= 1
        )

    def nearest_point(self, point: Sequence[Expr]) -> list[Expr]:
        """Return the point of the inclusion nearest to a point (x, y, z) [length].

        The point nearest to center + v is center + s^2 v/(t + s^2) with the semi-axes s; t > 0
        follows from the condition that it lies on the surface.
        """
        offset = np.array(
            np.broadcast_arrays(*(p - c for p, c in zip(point, self.center, strict=True))),
            dtype=float,
        )
        s = np.reshape(self.semi_axes, (3,) + (1,) * (offset.ndim - 1))
        is_outside = ((offset / s) ** 2).sum(axis=0) > 1
        t = _projection_multiplier(np.where(is_outside, offset, 2 * s), s)
        surface_offset = np.where(is_outside, offset * s * s / (t + s * s), offset)
        return [c + component for c, component in zip(self.center, surface_offset, strict=True)]

    def farthest_distance(self, point: Sequence[float], axes: Sequence[int] = ALL_AXES) -> float:
        """Return the largest distance, along some axes, of the inclusion's points from a point.

        The formula of `nearest_point` with the smallest root t < 0 gives the farthest point, on the
        other side of the center. The unknown of the root search is x > 0 in t = -max(s)^2 - x.
        """
        # This import takes 0.2 s, which bodies without an ellipsoid need not spend.
        from scipy.optimize import brentq

        s = np.array([self.semi_axes[axis] for axis in axes])
        # The farthest point is not unique on a plane of symmetry: points are moved off it.
        offset = np.array([abs(point[axis] - self.center[axis]) for axis in axes]) + 1e-12 * s
        squared_differences = (s.max() - s) * (s.max() + s)
        # One term of the sum is 1 at the lower end, none is above 1/len(s) at the upper one.
        low = 0.99 * s.max() * offset[np.argmax(s)]
        high = 1.01 * s.max() * np.sqrt(len(s)) * offset.max()
        x = brentq(
            lambda x: np.linalg.norm(s * offset / (x + squared_differences)) - 1.0,
            low,
            high,
            xtol=1e-16 * low,
        )
        return float(_norm(list(offset + offset * s * s / (x + squared_differences))))


def _projection_multiplier(offset: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Return the root t > 0 of sum (s offset/(t + s^2))^2 = 1 for points outside an ellipsoid.

    The sum is convex and decreases with t, so that Newton's method from below is monotone. The last
    step is less than 1e-11 of the largest t; the remaining relative error is about the square of
    1e-11.
    """
    # This import takes 0.2 s, which bodies without an ellipsoid need not spend.
    from scipy.optimize import newton

    start = np.maximum(np.max(s * np.abs(offset) - s * s, axis=0), 0.0)
    return np.asarray(
        newton(
            lambda t: ((s * offset / (t + s * s)) ** 2).sum(axis=0) - 1,
            start,
            fprime=lambda t: -2 * ((s * offset) ** 2 / (t + s * s) ** 3).sum(axis=0),
            tol=1e-11 * np.abs(s * offset).max(),
        )
    )


Inclusion = BallInclusion | CylinderInclusion | BoxInclusion | EllipsoidInclusion
Inclusions = Annotated[tuple[Annotated[Inclusion, TaggedBy("shape")], ...], Len(1, 50)]
