"""Interpolation of arrays that depend on scene parameters from the nodes of a grid.

Nodes are computed when they are first needed, and cached. Lagrange polynomials interpolate between
them along every parameter.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.parameters import Parameter, replace_numbers
from indent_sim.process.errors import IndentSimError

# NumPy and the functions of `theory` raise these errors for parameters without a solution.
NUMERICAL_ERRORS = (ArithmeticError, ValueError, np.linalg.LinAlgError)


class ForwardModelUnavailable(Exception):
    """Error: the scene has no solution at these parameters; the message gives the reason."""


class ParameterGrid:
    """Array (m,) that `solve` computes from a scene, as a function of parameters of the scene.

    `scene_values` is the array of the unchanged scene, `node_count` the number of interpolation
    nodes along each parameter.
    """

    def __init__(
        self,
        config: Config,
        shape_parameters: Sequence[Parameter],
        scene_values: np.ndarray,
        solve: Callable[[Config], np.ndarray],
        node_count: int,
    ):
        self.config = config
        self.shape_parameters = tuple(shape_parameters)
        self.scene_values = scene_values
        self._solve = solve
        self._node_count = node_count
        self._node_values: dict[tuple[int, ...], np.ndarray | None] = {}

    @property
    def computed_nodes(self) -> int:
        """Number of nodes that have been computed."""
        return len(self._node_values)

    def interpolate(self, theta: Sequence[float]) -> np.ndarray:
        """Return the array, interpolated at the transformed values theta of the parameters.

        Raises
        ------
        ForwardModelUnavailable
            If the scene has no solution at these parameters.
        """
        if not self.shape_parameters:
            return self.scene_values
        axis_nodes = [self._interpolation_nodes(axis, value) for axis, value in enumerate(theta)]
        total = np.zeros_like(self.scene_values)
        for corner in itertools.product(
            *(list(zip(*nodes_and_weights, strict=True)) for nodes_and_weights in axis_nodes)
        ):
            values = self._values_at_node(tuple(k for k, _ in corner))
            if values is None:
                raise ForwardModelUnavailable("the scene has no solution at these parameters")
            total += math.prod(weight for _, weight in corner) * values
        return total

    def _interpolation_nodes(self, axis: int, value: float) -> tuple[list[int], list[float]]:
        """Return the nodes with a solution around a value along one axis, and Lagrange weights."""
        parameter = self.shape_parameters[axis]
        count = self._node_count
        low, high = parameter.bounds
        value = min(max(value, low), high)
        position = value / parameter.grid_step
        lowest_node = (
            math.ceil(low / parameter.grid_step - 1e-9) if math.isfinite(low) else -(10**9)
        )
        highest_node = (
            math.floor(high / parameter.grid_step + 1e-9) if math.isfinite(high) else 10**9
        )
        first_node = min(
            max(math.floor(position) - count // 2 + 1, lowest_node), highest_node - count + 1
        )
        # Nodes are shifted to one side where values next to them have no solution.
        for shift in sorted(range(-count, count + 1), key=abs):
            nodes = list(range(first_node + shift, first_node + shift + count))
            if nodes[0] >= lowest_node and nodes[-1] <= highest_node and self._has_solutions(nodes):
                break
        else:
            raise ForwardModelUnavailable(
                f"no scene near {parameter.key} = {parameter.value(value):.4g} has a solution"
            )
        weights = [math.prod((position - m) / (k - m) for m in nodes if m != k) for k in nodes]
        return nodes, weights

    def _has_solutions(self, nodes: Sequence[int]) -> bool:
        """Return False if a node has no solution; only a grid of a single parameter is checked.

        With several parameters True is returned, because the solutions of the nodes are not known
        yet.
        """
        return len(self.shape_parameters) > 1 or all(
            self._values_at_node((k,)) is not None for k in nodes
        )

    def _values_at_node(self, indices: tuple[int, ...]) -> np.ndarray | None:
        if indices not in self._node_values:
            values = {
                p.key: p.value(k * p.grid_step)
                for p, k in zip(self.shape_parameters, indices, strict=True)
            }
            try:
                self._node_values[indices] = self._solve(replace_numbers(self.config, values))
            except (IndentSimError, ForwardModelUnavailable):
                self._node_values[indices] = None
        return self._node_values[indices]
