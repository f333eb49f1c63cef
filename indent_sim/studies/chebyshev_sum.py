"""Sum of products of Chebyshev polynomials in several variables: fit and fast evaluation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev

# Number of points that are evaluated at a time; their values fit into the cache of a processor.
BLOCK = 4096


@dataclass(frozen=True, eq=False)
class ChebyshevSum:
    """Sum of c_k T_k1(x_1) ... T_kd(x_d) over index tuples k, for points of the cube [-1, 1]^d.

    Attributes
    ----------
    indices
        The index tuples in lexicographic order; (terms, d).
    coefficients
        The coefficients; (terms,).
    """

    indices: np.ndarray
    coefficients: np.ndarray

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return the sum at points; (rows, d)."""
        values = np.empty(len(points))
        for start in range(0, len(points), BLOCK):
            block = points[start : start + BLOCK]
            values[start : start + BLOCK] = self._block_values(block)
        return values

    def _block_values(self, points: np.ndarray) -> np.ndarray:
        """Return the sum at a block of points, by summing over the last variable first."""
        *earlier_levels, last_level = self._levels
        parents, degrees, _ = last_level
        dense = np.zeros((int(degrees.max()) + 1, int(parents.max()) + 1))
        dense[degrees, parents] = self.coefficients
        columns = list(points.T)
        # Sums over the last variable, for every prefix of the index tuples; (prefixes, rows).
        values = dense.T @ _polynomials(columns.pop(), len(dense) - 1)
        for _, level_degrees, parent_starts in reversed(earlier_levels):
            polynomials = _polynomials(columns.pop(), int(level_degrees.max()))
            values *= polynomials[level_degrees]
            values = np.add.reduceat(values, parent_starts, axis=0)
        return np.asarray(values.reshape(-1))

    @cached_property
    def _levels(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Levels of the tree of prefixes: parents and degrees of nodes, first child of parents."""
        levels = []
        count = self.indices.shape[1]
        for length in range(1, count + 1):
            prefixes = np.unique(self.indices[:, :length], axis=0)
            is_new = np.any(np.diff(prefixes[:, :-1], axis=0), axis=1)
            parents = np.concatenate([[0], np.cumsum(is_new)]).astype(int)
            starts = np.flatnonzero(np.diff(parents, prepend=-1))
            levels.append((parents, prefixes[:, -1], starts))
        return levels


def _polynomials(x: np.ndarray, degree: int) -> np.ndarray:
    """Return T_0(x), ..., T_degree(x); (degree + 1, rows)."""
    values = np.empty((max(2, degree + 1), len(x)))
    values[0] = 1.0
    values[1] = x
    for k in range(2, degree + 1):
        np.multiply(values[1], 2 * values[k - 1], out=values[k])
        values[k] -= values[k - 2]
    return values[: degree + 1]


def index_tuples(degrees: Sequence[float]) -> np.ndarray:
    """Return the index tuples k with sum k_j / degrees_j <= 1, in lexicographic order."""
    # Tolerance for the round-off of the sum.
    tolerance = 1e-9

    def extend(prefix: tuple[int, ...], left: float) -> Iterator[tuple[int, ...]]:
        if len(prefix) == len(degrees):
            yield prefix
            return
        degree = degrees[len(prefix)]
        for index in range(int(left * degree + tolerance) + 1):
            yield from extend((*prefix, index), left - (index / degree if index else 0.0))

    return np.array(list(extend((), 1.0)), dtype=int).reshape(-1, len(degrees))


def design_matrix(points: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Return the value of each product of polynomials at each point; (rows, terms)."""
    matrix = np.ones((len(points), len(indices)))
    for column, degrees in zip(points.T, indices.T, strict=True):
        matrix *= chebyshev.chebvander(column, int(degrees.max()))[:, degrees]
    return matrix
