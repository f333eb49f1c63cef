"""Stress at the vertices: extrapolated from points inside each cell, and averaged over the cells of
one region.

The stress of quadratic elements is best at points inside a cell. From as many points as a cell has
vertices it is extrapolated linearly to these, and at each vertex averaged over the cells of one
region that meet there, weighted by their volumes. Nothing is averaged across the face between two
regions, where the stress jumps. Source: Hinton & Campbell (1974), Int. J. Numer. Methods Eng. 8,
461; Zienkiewicz, Taylor & Zhu (2013), The Finite Element Method, 15.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat

# The barycentric coordinate of a point along its own vertex: the points of the quadrature of degree
# 2, by dimension
OWN_COORDINATE = {2: 2 / 3, 3: (5 + 3 * 5**0.5) / 20}


class _CellStress(NamedTuple):
    """Of some cells: numbers of their vertices in the grid (cells, dim + 1), their regions
    (cells,), their volumes (cells,), of an axisymmetric body without 2 pi, and the stress at
    their vertices (cells, dim + 1, 9) [pressure].
    """

    vertices: np.ndarray
    regions: np.ndarray
    volumes: np.ndarray
    stress: np.ndarray


def total_stress(body: Any, strain: Any) -> Expr:
    """The Cauchy stress (3, 3) [pressure] in a region of a body, of solid and fluid together, in
    UFL.
    """
    if body.fluid is None:
        return strain.stress
    return strain.stress - body.fluid.pressure_in(strain.region) * ufl.Identity(3)


class NodalStress:
    """The stress of a `WholeBody` at the vertices of its grid."""

    def __init__(self, body: Any):
        self._body = body
        dim = body.body_mesh.dim
        own_coordinate = OWN_COORDINATE[dim]
        other_coordinate = (1 - OWN_COORDINATE[dim]) / dim
        barycentric_weights = np.full((dim + 1, dim + 1), other_coordinate) + (
            own_coordinate - other_coordinate
        ) * np.eye(dim + 1)  # (points, vertices)
        self._points = barycentric_weights[
            :, 1:
        ]  # the vertices of the reference cell are the origin and the unit vectors
        self._to_vertices = np.linalg.inv(barycentric_weights)

    @cached_property
    def _expressions(self) -> list[tuple[fem.Expression, np.ndarray]]:
        expressions = []
        for strain in self._body.strain_energies:
            stress = total_stress(self._body, strain)
            components = ufl.as_vector([stress[i, j] for i, j in np.ndindex(3, 3)])
            expressions.append((fem.Expression(components, self._points), strain.cells))
        return expressions

    def gather_averages(self, points: int) -> np.ndarray | None:
        """Return the volume-weighted nodal stress (points, 3, 3) [pressure]; None but on rank 0.

        Collective.

        Parameters
        ----------
        points
            Number of vertices of the grid.

        Returns
        -------
        array
            Where several regions meet that of the first of them: layers come from the top to the base, then
            inclusions.
        """
        parts = self._body.comm.gather(self._owned_cell_stress(), root=0)
        if parts is None:
            return None
        cells = _CellStress(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        first = np.full(points, np.iinfo(np.int64).max)
        np.minimum.at(
            first, cells.vertices.ravel(), np.repeat(cells.regions, cells.vertices.shape[1])
        )
        weights = np.where(
            first[cells.vertices] == cells.regions[:, None], cells.volumes[:, None], 0.0
        )
        total = np.bincount(cells.vertices.ravel(), weights.ravel(), points)
        columns = (weights[..., None] * cells.stress).reshape(-1, 9).T
        sums = [np.bincount(cells.vertices.ravel(), column, points) for column in columns]
        return (np.array(sums) / total).T.reshape(-1, 3, 3)

    def _owned_cell_stress(self) -> _CellStress:
        """Of the cells that this rank owns: the ghosts are another rank's."""
        body = self._body
        mesh = self._body.mesh
        dim = body.body_mesh.dim
        owned_count = mesh.topology.index_map(dim).size_local
        corners = compat.geometry_dofs(mesh)
        corner_points = mesh.geometry.x[corners][..., :dim]
        volumes = np.abs(np.linalg.det(corner_points[:, 1:] - corner_points[:, :1]))
        if body.scene.physics.domain.kinematics.name == "axisymmetric":
            volumes *= corner_points[..., 0].mean(axis=1)
        stress = np.zeros((len(corners), dim + 1, 9))
        for expression, cells in self._expressions:
            point_stress = compat.evaluate_expression(expression, mesh, cells).reshape(
                len(cells), dim + 1, 9
            )
            stress[cells] = np.einsum("vp,cpk->cvk", self._to_vertices, point_stress)
        vertices = np.asarray(mesh.geometry.input_global_indices)[corners]
        regions = np.asarray(body.body_mesh.regions, dtype=np.int64)
        return _CellStress(
            vertices[:owned_count],
            regions[:owned_count],
            volumes[:owned_count],
            stress[:owned_count],
        )
