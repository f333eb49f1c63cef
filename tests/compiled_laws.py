"""Hyperelastic and linear laws evaluated as the solver compiles them."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

from indent_sim.fe import compat
from indent_sim.fe.symbolic_constants import symbolic_copy

I = np.eye(3)
GRID = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)


class Numbers:
    """Energy of a law and its first two derivatives along a direction, by compiled forms."""

    def __init__(self, law: Any, mixed: bool):
        self._H, self._G = (fem.Constant(GRID, np.zeros((3, 3))) for _ in range(2))
        self._q, self._dq = (fem.Constant(GRID, 0.0) for _ in range(2))
        t = ufl.variable(fem.Constant(GRID, 0.0))
        H, q, law = self._H + t * self._G, self._q + t * self._dq, symbolic_copy(law, GRID)
        psi = law.mixed_energy(H, q) if mixed else law.energy(H)
        slope = ufl.diff(psi, t)
        values = ufl.as_vector([psi, slope, ufl.diff(slope, t)])
        self._expression = fem.Expression(values, np.array([[0.3, 0.3]]))

    def along(self, F: np.ndarray, G: np.ndarray, q: float = 0.0, dq: float = 0.0) -> np.ndarray:
        """psi, dpsi and d2psi at F (and q) along G (and dq)."""
        return self._along(F - I, G, q, dq)

    def _along(self, H: np.ndarray, G: np.ndarray, q: float, dq: float) -> np.ndarray:
        self._H.value[:], self._G.value[:], self._q.value, self._dq.value = H, G, q, dq
        return compat.evaluate_expression(
            self._expression, GRID, np.array([0], dtype=np.int32)
        ).ravel()

    def energy(self, F: np.ndarray, q: float = 0.0) -> float:
        """Strain energy density psi at F, and at q in the mixed formulation."""
        return float(self.along(F, I, q)[0])

    def stress(self, F: np.ndarray, q: float = 0.0) -> np.ndarray:
        """First Piola-Kirchhoff stress at F, direction by direction."""
        return self.stress_of_gradient(F - I, q)

    def stress_of_gradient(self, H: np.ndarray, q: float = 0.0) -> np.ndarray:
        """First Piola-Kirchhoff stress at F = I + H, with all digits of a small H."""
        unit = [np.outer(I[i], I[j]) for i in range(3) for j in range(3)]
        return np.array([self._along(H, G, q, 0.0)[1] for G in unit]).reshape(3, 3)
