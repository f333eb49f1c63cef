"""Track of the tip's axis over the undeformed surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TipTrack:
    """Straight track of the tip's axis over the surface; one point if the tip does not slide.

    Attributes
    ----------
    center
        Horizontal position at which the tip is pressed in [length].
    axis
        Horizontal axis along which the tip slides: 0 (x) or 1 (y).
    low, high
        Ends of the track on this axis, relative to `center` [length]; low <= 0 <= high.
    """

    center: tuple[float, ...]
    axis: int = 0
    low: float = 0.0
    high: float = 0.0

    @property
    def is_point(self) -> bool:
        """True if the tip does not slide."""
        return self.low == self.high

    @property
    def length(self) -> float:
        """Length of the track [length]."""
        return self.high - self.low

    def position(self, x: float) -> tuple[float, ...]:
        """Return the horizontal position of the tip's axis at a displacement x [length]."""
        return tuple(c + x * (k == self.axis) for k, c in enumerate(self.center))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the distances of horizontal positions (..., axes) from the track [length]."""
        offsets = points - np.asarray(self.center)[: points.shape[-1]]
        if not self.is_point:
            along = offsets[..., self.axis]
            offsets[..., self.axis] = along - np.clip(along, self.low, self.high)
        return np.asarray(np.linalg.norm(offsets, axis=-1))
