"""Result of the fit of a map: images of the parameter, its intervals and its tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from indent_sim.fitting.inference.pooled_noise import PooledNoise
from indent_sim.fitting.map_fit import REASONS


@dataclass(frozen=True)
class MapFit:
    """Fit of a map, in units of the scene. Arrays have the shape of the map (rows, columns).

    Attributes
    ----------
    key
        The varied key.
    value, low, high
        The parameter and its stated interval; NaN for rejected curves.
    statistical_low, statistical_high
        The interval by noise alone.
    explained
        Whether the scene explains the curve.
    reason
        Index of `reasons`: 0 for a fitted curve, -1 where the map has no curve.
    height
        Height of the surface at zero force, relative to its median [length].
    thickness
        Thickness of the body [length], if it differs from pixel to pixel.
    pixels
        Further results by name: contact point, baseline, largest force, depth, residual, tests.
    size
        Height and width of the scanned area [m], if known.
    noise
        Noise of the map.
    entry
        Content of fit.json.
    """

    key: str
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    statistical_low: np.ndarray
    statistical_high: np.ndarray
    explained: np.ndarray
    reason: np.ndarray
    height: np.ndarray
    thickness: np.ndarray | None
    pixels: dict[str, np.ndarray]
    size: tuple[float, float] | None
    noise: PooledNoise
    entry: dict[str, Any]

    reasons: ClassVar[tuple[str, ...]] = REASONS

    @property
    def words(self) -> str:
        """Sentences on the result."""
        return str(self.entry["words"])
