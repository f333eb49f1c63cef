"""Traces of nodal fields on the facets of a surface, evaluated in numpy.

The solver integrates over the contact surface with UFL. Results (contact radius, peak pressure,
penetration, surface table) are evaluated in numpy, at any points of the facets, from their dofs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from indent_sim.fe.quadrature import node_points
from indent_sim.fe.shape_functions import shape_functions


@dataclass(frozen=True)
class Trace:
    """Facets of a surface on this rank, with the displacement dofs on them.

    Attributes
    ----------
    nodes : ndarray of int, (facets, n)
        Block dofs of the displacement.
    X : ndarray, (facets, n, dim)
        Undeformed coordinates of the nodes [length].
    dofs : ndarray of int, (facets, n, dim)
        Positions of the displacement components in the local solution array.
    """

    nodes: np.ndarray
    X: np.ndarray
    dofs: np.ndarray

    @property
    def dim(self) -> int:
        """Dimension of the model."""
        return self.X.shape[2]

    def select_facets(self, is_chosen: np.ndarray) -> Trace:
        """Return the trace of the facets selected by a mask (facets,)."""
        return Trace(self.nodes[is_chosen], self.X[is_chosen], self.dofs[is_chosen])

    def join(self, second: Trace) -> Trace:
        """Return a trace of these facets and the facets of another trace of the same body."""
        pairs = ((self.nodes, second.nodes), (self.X, second.X), (self.dofs, second.dofs))
        return Trace(*(np.concatenate(pair) for pair in pairs))

    @property
    def has_ripples(self) -> bool:
        """True if a multiplier oscillates at the vertices; see `interpolate_from_midpoints`."""
        return self.dim == 3

    @cached_property
    def facet_sizes(self) -> np.ndarray:
        """Size of each facet (facets,) [length].

        The size of an edge is its length; the size of a triangle is the side of an equilateral
        triangle of equal area.
        """
        edges = self.X[:, 1 : self.dim] - self.X[:, :1]
        squares = np.linalg.det(edges @ np.swapaxes(edges, 1, 2))
        return np.sqrt(squares) if self.dim == 2 else np.sqrt(2 / np.sqrt(3) * np.sqrt(squares))

    def positions(self, points: np.ndarray) -> np.ndarray:
        """Undeformed positions (facets, points, dim) of points of the reference facet [length]."""
        return self.interpolate(self.X, points)

    def interpolate(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Interpolate nodal values (facets, n, components) to (facets, points, components)."""
        return shape_functions(points) @ nodal

    def tangents(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Derivatives (facets, points, dim, dim - 1) of a nodal field along the facet."""
        step = 1e-3  # central differences are exact for quadratics
        shifts = step * np.eye(points.shape[1])
        slopes = np.stack(
            [
                (shape_functions(points + shift) - shape_functions(points - shift)) / (2 * step)
                for shift in shifts
            ],
            axis=-1,
        )
        return np.einsum("pnk,fnd->fpdk", slopes, nodal)

    def measures(self, points: np.ndarray) -> np.ndarray:
        """Jacobian determinant (facets, points) of the map from the reference facet to a facet."""
        tangents = self.tangents(self.X, points)
        return np.sqrt(np.linalg.det(np.einsum("fpdi,fpdj->fpij", tangents, tangents)))

    def node_points(self) -> np.ndarray:
        """Coordinates (nodes, dim - 1) of the nodes on the reference facet."""
        return node_points(self.dim)
