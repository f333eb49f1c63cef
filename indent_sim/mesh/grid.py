"""A simplex mesh as arrays."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

DIGITS = 12  # lengths are rounded to this many digits, so that a scene in nm and in m gives the same mesh


@dataclass(frozen=True)
class Grid:
    """A simplex mesh as arrays: points (n, dim) [length of the scene], cells (m, dim + 1); by which gmsh."""

    points: np.ndarray
    cells: np.ndarray
    gmsh: str = ""

    @property
    def hash(self) -> str:
        """Fingerprint of the mesh, for the record of a run."""
        digest = hashlib.sha256(np.round(self.points, DIGITS).tobytes() + self.cells.tobytes())
        return digest.hexdigest()[:16]
