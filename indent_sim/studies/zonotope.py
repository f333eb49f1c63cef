"""Zonotope: the image of a box of varied keys in the space of dimensionless groups."""

from __future__ import annotations

from functools import cached_property
from itertools import combinations
from math import comb

import numpy as np

# Relative distance outside a facet that counts as round-off.
TOLERANCE = 1e-9


class Zonotope:
    """Set of the points c + sum_k s_k g_k with all |s_k| <= 1.

    Parameters
    ----------
    center
        The point c; (d,).
    generators
        The vectors g_k; (n, d).
    """

    def __init__(self, center: np.ndarray, generators: np.ndarray):
        self.center = center
        self.half_widths = np.abs(generators).sum(axis=0)
        self._generators = generators

    @cached_property
    def _normals(self) -> np.ndarray:
        """Normals (facets, d) of the facets."""
        normals = [np.eye(len(self.center))]
        # Largest number of facets of a zonotope; with more of them only its bounding box is used.
        max_facets = 2000
        if comb(len(self._generators), len(self.center) - 1) <= max_facets:
            generators = self._generators / self.half_widths
            normals.append(_facet_normals(generators) / self.half_widths)
        return np.vstack(normals)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return for each point (rows, d) whether it is inside the zonotope."""
        largest = np.abs(self._generators @ self._normals.T).sum(axis=0)
        distances = np.abs((points - self.center) @ self._normals.T)
        return np.asarray((distances <= largest * (1 + TOLERANCE)).all(axis=1))


def _facet_normals(generators: np.ndarray) -> np.ndarray:
    """Return the normals (facets, d) of the facets; each is normal to d - 1 generators."""
    dimension = generators.shape[1]
    normals = []
    for chosen in combinations(range(len(generators)), dimension - 1):
        _, sizes, directions = np.linalg.svd(generators[list(chosen)].reshape(-1, dimension))
        # Generators that are linearly dependent have no facet.
        if len(sizes) == dimension - 1 and (not len(sizes) or sizes[-1] > 1e-10 * sizes[0]):
            normals.append(directions[-1])
    return np.array(normals).reshape(-1, dimension)
