"""Meridian of a soft tip: the curve that its deformed surface makes in the plane (r, z)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Part of a segment by which a point may be beyond its end before it changes to the next one. The
# height of a quadratic segment that is continued so far is wrong by 1e-2 of its error inside.
# Without the overlap Newton's method alternates between two segments; with 0.1 the force is 5e-4
# too small. Checked: tests/physics/test_soft_tips_at_finite_strain.py.
OVERLAP = 0.02


@dataclass(frozen=True)
class MeridianPoints:
    """Points of a meridian at given radii.

    Attributes
    ----------
    segments : ndarray of int, (n,)
        Segment of each point.
    is_inside : ndarray of bool, (n,)
        Whether the meridian extends to the radius; if not, the point is at the end of the meridian.
    N, slopes : ndarray, (n, 3)
        Shape functions of the nodes of the segment and their derivatives along it.
    tangent, curvature : ndarray, (n, 2)
        First and second derivative of the position (r, z) along the segment [length].
    height : ndarray, (n,)
        Height z [length].
    """

    segments: np.ndarray
    is_inside: np.ndarray
    N: np.ndarray
    slopes: np.ndarray
    tangent: np.ndarray
    curvature: np.ndarray
    height: np.ndarray

    @property
    def slope(self) -> np.ndarray:
        """Slope dz/dr (n,) of the meridian."""
        return np.asarray(self.tangent[:, 1] / self.tangent[:, 0])


class Meridian:
    """Deformed meridian of a soft tip, a chain of quadratic segments from the axis outwards.

    Parameters
    ----------
    X : ndarray, (facets, 3, 2)
        Undeformed positions of the nodes of the tip's surface [length].
    dofs : ndarray of int, (facets, 3, 2)
        Positions of their displacements in the local solution array.
    max_radius : float
        Undeformed radius [length] up to which facets are used: at the equator of a ball the height
        is no function of the radius.
    """

    def __init__(self, X: np.ndarray, dofs: np.ndarray, max_radius: float):
        used = np.flatnonzero(X[:, :, 0].max(axis=1) <= max_radius)
        order = used[np.argsort(X[used, :, 0].min(axis=1))]
        X = X[order]
        is_reversed = X[:, 0, 0] > X[:, 1, 0]
        nodes = np.where(is_reversed[:, None], [1, 0, 2], [0, 1, 2])
        self._X = np.take_along_axis(X, nodes[:, :, None], axis=1)
        self.dofs = np.take_along_axis(dofs[order], nodes[:, :, None], axis=1)

    def positions(self, solution: np.ndarray) -> np.ndarray:
        """Return the deformed positions (segments, 3, 2) of the nodes [length].

        The first two nodes of a segment are its ends, the third is its midpoint. `solution` is the
        local array of the displacement.
        """
        return np.asarray(self._X + solution[self.dofs])

    @staticmethod
    def is_graph(positions: np.ndarray, end: float) -> bool:
        """Return whether the radius increases along the meridian up to a radius [length]."""
        first, second, middle = np.moveaxis(positions[..., 0], 1, 0)
        c = 2 * (first + second - 2 * middle)
        b = second - first - c
        is_near = np.minimum(first, second) < end
        return bool(np.all((np.minimum(b, b + 2 * c) > 0)[is_near]))

    @staticmethod
    def points_at(
        positions: np.ndarray, r: np.ndarray, kept_segments: np.ndarray | None = None
    ) -> MeridianPoints:
        """Return the points of the meridian at given radii.

        The slope of the meridian jumps from segment to segment. A point keeps its present segment
        until it lies farther than OVERLAP beyond the end of the segment: the equations of a contact
        then remain smooth, and have a solution where a point lies opposite to a jump.

        Parameters
        ----------
        positions : ndarray, (segments, 3, 2)
            Deformed positions of the nodes [length].
        r : ndarray, (n,)
            Radii [length].
        kept_segments : ndarray of int, (n,), optional
            Present segments of the points.
        """
        begins = np.maximum.accumulate(positions[:, 0, 0])
        e = np.clip(np.searchsorted(begins, r, side="right") - 1, 0, len(begins) - 1)
        is_inside = r <= positions[-1, 1, 0]
        if kept_segments is not None:
            first, second, _ = np.moveaxis(positions[kept_segments, :, 0], 1, 0)
            margin = OVERLAP * (second - first)
            is_kept = (r > first - margin) & (r < second + margin)
            e = np.where(is_kept & is_inside, kept_segments, e)
        Y = positions[e]
        # On a segment the radius is r_0 + b x + c x^2 for 0 <= x <= 1.
        curvature = 4 * (Y[:, 0] + Y[:, 1] - 2 * Y[:, 2])
        b = Y[:, 1] - Y[:, 0] - curvature / 2
        root = np.sqrt(
            np.maximum(b[:, 0] ** 2 + 2 * curvature[:, 0] * (r - Y[:, 0, 0]), 1e-6 * b[:, 0] ** 2)
        )
        x = np.clip(2 * (r - Y[:, 0, 0]) / (b[:, 0] + root), -2 * OVERLAP, 1 + 2 * OVERLAP)
        N = np.stack([(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)], axis=-1)
        slopes = np.stack([4 * x - 3, 4 * x - 1, 4 - 8 * x], axis=-1)
        height = np.einsum("pn,pn->p", N, Y[..., 1])
        tangent = b + curvature * x[:, None]
        return MeridianPoints(e, is_inside, N, slopes, tangent, curvature, height)
