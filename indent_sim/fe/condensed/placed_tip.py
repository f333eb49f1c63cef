"""The tip at one horizontal position above the condensed surface."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from indent_sim.fe.condensed.compliance import Compliance
from indent_sim.fe.quadrature import contact_quadrature, split_quadrature
from indent_sim.scene.scene import Scene


class PlacedTip:
    """The tip at one horizontal position; for a sliding tip each position has a new object.

    Parameters
    ----------
    compliance
        Compliance of the candidate nodes, with their undeformed surface.
    scene
        The scene.
    slide
        Horizontal displacement of the tip from where it was pressed in [length].

    Attributes
    ----------
    center : tuple of float
        Horizontal position of the tip [length].
    """

    def __init__(self, compliance: Compliance, scene: Scene, slide: float = 0.0):
        self._compliance = compliance
        self._scene = scene
        self.slide = slide
        self.center = scene.physics.track.position(slide)

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Return the heights (facets, points) of tip or flat above the undeformed surface [length].

        Parameters
        ----------
        points
            Points (points, dim - 1) of the reference facet.
        """
        return self._heights_from(points, self.center)

    def height_derivatives(self, points: np.ndarray, axis: int) -> np.ndarray:
        """Return the derivatives of the heights (facets, points) by the position of the tip."""
        # Central difference of the heights, which are smooth except at an apex or an edge.
        step = 1e-5 * self._scene.sizes.h_contact
        before, after = (
            self._heights_from(
                points, tuple(c + shift * (k == axis) for k, c in enumerate(self.center))
            )
            for shift in (-step, step)
        )
        return (after - before) / (2 * step)

    def _heights_from(self, points: np.ndarray, center: tuple[float, ...]) -> np.ndarray:
        """Return the heights of a tip at a horizontal position; see `heights`."""
        physics = self._scene.physics
        x = np.moveaxis(self._compliance.trace.positions(points), -1, 0)
        horizontal = physics.domain.kinematics.horizontal_position(x, center)
        height = physics.indenter.height(*horizontal)
        rests_on_flat = self._compliance.rests_on_flat
        if rests_on_flat is not None:
            height = np.where(rests_on_flat[:, None], 0.0, height)
        return np.asarray(height - x[-1])

    @cached_property
    def quadrature_heights(self) -> np.ndarray:
        """Heights at the contact quadrature points (facets, points) [length]."""
        return self.heights(contact_quadrature(self._compliance.trace.dim)[0])

    @cached_property
    def split_heights(self) -> np.ndarray:
        """Heights at the quadrature points of nodal pressures (facets, points) [length]."""
        return self.heights(split_quadrature(self._compliance.trace.dim)[0])
