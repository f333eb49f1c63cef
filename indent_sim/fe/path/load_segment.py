"""Points of a load path and the straight segments between them."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class LoadPoint:
    """Depth [length], time and displacement of a sliding tip [length] at one point of the path."""

    delta: float
    t: float = 0.0
    slide: float = 0.0


@dataclass(frozen=True)
class LoadSegment:
    """Straight segment between two load points.

    The coordinate along the segment is the time if time passes, otherwise the displacement of a
    sliding tip if it changes, otherwise the depth.
    """

    begin: LoadPoint
    end: LoadPoint

    @property
    def has_duration(self) -> bool:
        """True if time passes along the segment."""
        return self.end.t != self.begin.t

    @property
    def slides(self) -> bool:
        """True if the tip slides along the segment."""
        return self.end.slide != self.begin.slide

    def coordinate(self, load_point: LoadPoint) -> float:
        """Return the coordinate (time, slide or depth) of a load point on the segment."""
        if self.has_duration:
            return load_point.t
        return load_point.slide if self.slides else load_point.delta

    def load_point(self, coordinate: float) -> LoadPoint:
        """Return the load point at a coordinate; at the last coordinate it is exactly `end`."""
        if coordinate == self.coordinate(self.end):
            return self.end
        if self.has_duration:
            fraction = (coordinate - self.begin.t) / (self.end.t - self.begin.t)
            depth = self.begin.delta + fraction * (self.end.delta - self.begin.delta)
            slide = self.begin.slide + fraction * (self.end.slide - self.begin.slide)
            return LoadPoint(depth, coordinate, slide)
        if self.slides:
            fraction = (coordinate - self.begin.slide) / (self.end.slide - self.begin.slide)
            depth = self.begin.delta + fraction * (self.end.delta - self.begin.delta)
            return LoadPoint(depth, self.begin.t, coordinate)
        return LoadPoint(coordinate, self.begin.t, self.begin.slide)

    def coordinate_length(self, length: float) -> float:
        """Convert a length to an interval of the coordinate; infinite if the tip does not move.

        In an interval of time neither the depth nor the slide changes by more than the length.
        """
        if not self.has_duration:
            return length
        depth_change = abs(self.end.delta - self.begin.delta)
        distance = max(depth_change, abs(self.end.slide - self.begin.slide))
        return length * abs(self.end.t - self.begin.t) / distance if distance else inf
