"""Stress recovery at vertices.

The stress of quadratic elements is most accurate at certain points inside a cell, as many as it has
vertices. It is extrapolated linearly from these points to the vertices, and averaged there over the
cells of one region, weighted by volume. At an interface, where the stress jumps, each region has
separate vertices (`grid.split_at_interfaces`). Source: Hinton & Campbell (1974), Int. J. Numer.
Methods Eng. 8, 461; Zienkiewicz, Taylor & Zhu (2013), The Finite Element Method, 15.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.kernel_cache import compile_expression
from indent_sim.mesh.grid import split_at_interfaces


class _CellStress(NamedTuple):
    """Stress of cells, extrapolated to their vertices.

    Attributes
    ----------
    vertices : ndarray of int, (cells, dim + 1)
        Grid points of the vertices of each cell.
    regions : ndarray of int, (cells,)
        Region number of each cell.
    volumes : ndarray, (cells,)
        Volume of each cell up to a common factor; without 2 pi for an axisymmetric body.
    stress : ndarray, (cells, dim + 1, 9)
        Stress at the vertices of each cell [pressure].
    """

    vertices: np.ndarray
    regions: np.ndarray
    volumes: np.ndarray
    stress: np.ndarray


def total_stress(body: Any, strain: Any) -> Expr:
    """Total Cauchy stress (3, 3) of solid and pore fluid in a region, a UFL tensor [pressure].

    Parameters
    ----------
    body : WholeBody
        The body.
    strain : StrainEnergy
        Strain energy of the region.
    """
    if body.fluid is None:
        return strain.stress
    return strain.stress - body.fluid.pressure_in(strain.region) * ufl.Identity(3)


class NodalStress:
    """Stress of a `WholeBody` at the vertices of its grid."""

    def __init__(self, body: Any):
        self._body = body
        dim = body.body_mesh.dim
        # Largest barycentric coordinate of each point of the quadrature of degree 2, by dimension.
        own_coordinates = {2: 2 / 3, 3: (5 + 3 * 5**0.5) / 20}
        own_coordinate = own_coordinates[dim]
        other_coordinate = (1 - own_coordinates[dim]) / dim
        barycentric_weights = np.full((dim + 1, dim + 1), other_coordinate) + (
            own_coordinate - other_coordinate
        ) * np.eye(dim + 1)  # (points, vertices)
        # The vertices of the reference cell are the origin and the unit vectors
        self._points = barycentric_weights[:, 1:]
        self._to_vertices = np.linalg.inv(barycentric_weights)

    @cached_property
    def _expressions(self) -> list[tuple[fem.Expression, np.ndarray]]:
        expressions = []
        for strain in self._body.strain_energies:
            stress = total_stress(self._body, strain)
            components = ufl.as_vector([stress[i, j] for i, j in np.ndindex(3, 3)])
            expressions.append((compile_expression(components, self._points), strain.cells))
        return expressions

    def gather_averages(self, points: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Gather the nodal stress on rank 0 (collective).

        Parameters
        ----------
        points : int
            Number of vertices of the grid.

        Returns
        -------
        tuple of ndarray, or None
            Grid vertex (n,) of each row and stress (n, 3, 3) [pressure], with n > `points` if
            vertices lie on interfaces; None on other ranks.
        """
        parts = self._body.comm.gather(self._owned_cell_stress(), root=0)
        if parts is None:
            return None
        cells = _CellStress(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        origin, vertices = split_at_interfaces(cells.vertices, cells.regions, points)
        weights = np.repeat(cells.volumes, vertices.shape[1])
        total = np.bincount(vertices.ravel(), weights, len(origin))
        columns = (cells.volumes[:, None, None] * cells.stress).reshape(-1, 9).T
        sums = [np.bincount(vertices.ravel(), column, len(origin)) for column in columns]
        return origin, (np.array(sums) / total).T.reshape(-1, 3, 3)

    def _owned_cell_stress(self) -> _CellStress:
        """Extrapolate the stress of the cells that this rank owns."""
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
