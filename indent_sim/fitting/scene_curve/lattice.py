"""Lattice: numbers of a scene between values of its parameters, solved where they are asked for and
kept.

Between its nodes they are interpolated by polynomials, of degree five through six nodes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.scene_curve.parameters import Parameter, with_numbers
from indent_sim.process.errors import IndentSimError

# What numpy and theory raise where numbers come to nothing
NUMBERS = (ArithmeticError, ValueError, np.linalg.LinAlgError)


class NoTable(Exception):
    """A scene that has no solution at these parameters; the message says why."""


class Lattice:
    """What `solve` makes of a scene, an array (m,), over parameters that it varies.

    first: that of the scene as it stands; nodes: along every parameter, between which polynomials
    run.
    """

    def __init__(
        self,
        config: Config,
        shape: Sequence[Parameter],
        first: np.ndarray,
        solve: Callable[[Config], np.ndarray],
        nodes: int,
    ):
        self.config = config
        self.shape = tuple(shape)
        self.first = first
        self._solve = solve
        self._count = nodes
        self._nodes: dict[tuple[int, ...], np.ndarray | None] = {}

    def at(self, theta: Sequence[float]) -> np.ndarray:
        """The array at coordinates of the parameters; NoTable where the scene has none."""
        if not self.shape:
            return self.first
        windows = [self._window(axis, value) for axis, value in enumerate(theta)]
        total = np.zeros_like(self.first)
        for chosen in itertools.product(*(list(zip(*window, strict=True)) for window in windows)):
            array = self._node(tuple(k for k, _ in chosen))
            if array is None:
                raise NoTable("the scene has no solution at these parameters")
            total += math.prod(weight for _, weight in chosen) * array
        return total

    def _window(self, axis: int, value: float) -> tuple[list[int], list[float]]:
        """Nodes around a value along one axis, those that exist, and Lagrange's weights."""
        parameter = self.shape[axis]
        count = self._count
        low, high = parameter.bounds
        value = min(max(value, low), high)
        at = value / parameter.step
        least = math.ceil(low / parameter.step - 1e-9) if math.isfinite(low) else -(10**9)
        most = math.floor(high / parameter.step + 1e-9) if math.isfinite(high) else 10**9
        first = min(max(math.floor(at) - count // 2 + 1, least), most - count + 1)
        for shift in sorted(
            range(-count, count + 1), key=abs
        ):  # beside what does not exist, all on one side
            nodes = list(range(first + shift, first + shift + count))
            if nodes[0] >= least and nodes[-1] <= most and self._exist(nodes):
                break
        else:
            raise NoTable(
                f"no scene near {parameter.key} = {parameter.value(value):.4g} has a solution"
            )
        weights = [math.prod((at - m) / (k - m) for m in nodes if m != k) for k in nodes]
        return nodes, weights

    def _exist(self, nodes: Sequence[int]) -> bool:
        """Whether all nodes along the only parameter exist; of several it is found when they are
        solved.
        """
        return len(self.shape) > 1 or all(self._node((k,)) is not None for k in nodes)

    def _node(self, place: tuple[int, ...]) -> np.ndarray | None:
        if place not in self._nodes:
            values = {p.key: p.value(k * p.step) for p, k in zip(self.shape, place, strict=True)}
            try:
                self._nodes[place] = self._solve(with_numbers(self.config, values))
            except (IndentSimError, NoTable):
                self._nodes[place] = None
        return self._nodes[place]
