"""Points of a load path and the straight segments between them."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class LoadPoint:
    """Depth [length] and time at one point of the load path."""

    delta: float
    t: float = 0.0


@dataclass(frozen=True)
class LoadSegment:
    """Straight segment between two load points.

    The coordinate along the segment is the time if time passes, otherwise the depth.
    """

    begin: LoadPoint
    end: LoadPoint

    @property
    def has_duration(self) -> bool:
        """True if time passes along the segment."""
        return self.end.t != self.begin.t

    def coordinate(self, load_point: LoadPoint) -> float:
        """Return the coordinate (time or depth) of a load point on the segment."""
        return load_point.t if self.has_duration else load_point.delta

    def load_point(self, coordinate: float) -> LoadPoint:
        """Return the load point at a coordinate; at the last coordinate it is exactly `end`."""
        if coordinate == self.coordinate(self.end):
            return self.end
        if not self.has_duration:
            return LoadPoint(coordinate, self.begin.t)
        fraction = (coordinate - self.begin.t) / (self.end.t - self.begin.t)
        return LoadPoint(
            self.begin.delta + fraction * (self.end.delta - self.begin.delta), coordinate
        )

    def coordinate_length(self, length: float) -> float:
        """Convert a depth interval to an interval of the coordinate; infinite at constant depth."""
        if not self.has_duration:
            return length
        depth_change = abs(self.end.delta - self.begin.delta)
        return length * abs(self.end.t - self.begin.t) / depth_change if depth_change else inf
