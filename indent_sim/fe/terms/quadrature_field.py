"""Field at the quadrature points of a region, for internal variables of a material."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import create_function_space
from indent_sim.fe.measured_constants import VOLUME_DEGREE

# Components of a symmetric tensor, by dimension of the model; in two dimensions the axes are
# (r, theta, z) or (x, y, z), and the shear components of the second axis are zero.
TENSOR_COMPONENTS = {
    2: ((0, 0), (1, 1), (2, 2), (0, 2)),
    3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)),
}


class QuadratureField:
    """Numbers at the quadrature points of the cells of a region; zero in other cells.

    Parameters
    ----------
    body : Body
        Discrete body.
    width : int
        Number of values at each point.

    Attributes
    ----------
    function : fem.Function
        The values at the quadrature points.
    mean : fem.Function
        Their mean in each cell, which is used for the field at other points; see `update_means`.
    points : ndarray
        Quadrature points (n, dim) of the reference cell.
    """

    def __init__(self, body: Body, width: int):
        dim = body.body_mesh.dim
        degree = VOLUME_DEGREE[dim]
        self.width = width
        self.points, self._weights = compat.quadrature_rule(compat.CELL_NAMES[dim], degree)
        space = create_function_space(body.mesh, compat.quadrature_element(dim, degree, width))
        means = create_function_space(body.mesh, compat.cellwise_element(dim, width))
        self.function = fem.Function(space)
        self.mean = fem.Function(means)
        self._dofs = compat.cell_dofs(space.dofmap)
        self._mean_dofs = compat.cell_dofs(means.dofmap)[:, 0]

    @property
    def weights(self) -> np.ndarray:
        """Weights (n,) of the quadrature points, divided by their sum."""
        weights = np.asarray(self._weights)
        return weights / weights.sum()

    def values(self, cells: np.ndarray) -> np.ndarray:
        """Return the values (cells, points, width) in the given cells."""
        values: np.ndarray = self.function.x.array.reshape(-1, self.width)[self._dofs[cells]]
        return values

    def set_values(self, cells: np.ndarray, values: np.ndarray) -> None:
        """Set the values (cells, points, width) in the given cells."""
        self.function.x.array.reshape(-1, self.width)[self._dofs[cells]] = values

    def update_means(self, cells: np.ndarray) -> None:
        """Set the means of the given cells from the present values."""
        self.mean.x.array.reshape(-1, self.width)[self._mean_dofs[cells]] = np.tensordot(
            self._weights, self.values(cells), (0, 1)
        ) / sum(self._weights)


def symmetric_tensor(components: Expr, dim: int) -> Expr:
    """Return the symmetric tensor (3, 3) with the components TENSOR_COMPONENTS[dim]."""
    pairs = TENSOR_COMPONENTS[dim]
    number = {pair: k for k, pair in enumerate(pairs)} | {
        (j, i): k for k, (i, j) in enumerate(pairs)
    }
    return ufl.as_tensor(
        [
            [components[number[i, j]] if (i, j) in number else 0.0 for j in range(3)]
            for i in range(3)
        ]
    )
