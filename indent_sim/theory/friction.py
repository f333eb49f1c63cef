"""Coulomb friction between a tip and an elastic half-space during loading.

The results are the ratios of force and contact radius to those of frictionless contact at the same
depth, and the ratio of the stick radius to the contact radius. Under a flat punch of
radius 1 and depth 1, the pressure p, the outward traction q on the body and the displacements
inside the contact are Abel transforms of phi and x chi. With beta = (1 - 2 nu)/(2 (1 - nu)),
stresses in units of mu/(1 - nu):

    int_r^1 s p ds = int_r^1 phi x/sqrt(x^2 - r^2) dx,
    int_r^1 q ds = int_r^1 chi x/sqrt(x^2 - r^2) dx,
    u_z(r) = int_0^r phi/sqrt(r^2 - x^2) dx - beta int_r^1 q ds = 1,
    u_r(r) = int_0^r chi x^2/(r sqrt(r^2 - x^2)) dx - beta/r int_0^r s p ds = 0 (stick)
    or q = k p (slip), with the coefficient of friction k.

With phi and chi constant on rings, all integrals are elementary. Under a tip with the profile f(r)
= B r^n each increment of the depth is that of a flat punch of the present contact radius. The stick
radius is the same fraction of the contact radius for each of these punches, so that the stick and
slip zones grow in proportion to the contact. Therefore delta = alpha a^n as in `no_slip`, where the
surface outside a punch of radius 1 has the depth int_0^1 phi/sqrt(r^2 - x^2) dx.

Sources: Spence (1975), J. Elasticity 5, 297, for the problem and its self-similarity; the
collocation is our own.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from indent_sim.theory import no_slip
from indent_sim.theory.no_slip import FrictionCorrection

EDGE_GRADING = 4.0  # Exponent of the grading of rings towards the edge, where p, q are singular.


def friction_correction(
    nu: float, friction: float | Literal["stick"], power: float = math.inf
) -> FrictionCorrection:
    """Return the factors of force and contact radius, and the stick radius, under f = B r^power.

    The force is accurate to 2e-5, the stick radius to the width of one ring, at most 0.01. An
    infinite power means a flat punch.

    Raises
    ------
    ValueError
        Unless -1 < nu <= 0.5, power >= 1, and friction is "stick" or between 0 and 0.8/beta (1.6 at
        nu = 0, 2.8 at nu = 0.3).
    """
    if friction == "stick":
        return no_slip.no_slip_correction(nu, power)
    no_slip.check_parameters(nu, power)
    beta = (1.0 - 2.0 * nu) / (2.0 * (1.0 - nu))
    # Largest friction times beta with this accuracy; above 1 the edge has another singularity.
    max_beta = 0.8
    if not 0.0 <= friction * beta <= max_beta:
        max_friction = max_beta / beta if beta else math.inf
        raise ValueError(f"friction must lie in [0, {max_friction:.3g}], got {friction!r}")
    punch = _punch(beta, friction)
    radius = (
        1.0
        if math.isinf(power)
        else (punch.sinking_integral(power) / FRICTIONLESS_PUNCH.sinking_integral(power))
        ** (1.0 / power)
    )
    return FrictionCorrection(punch.force * radius, radius, punch.stick_radius)


@dataclass(frozen=True)
class FrictionalPunch:
    """Flat punch of radius 1; phi, whose Abel transform gives the pressure, is constant on rings.

    For the transform see the module. The surface sticks on the innermost `stick_ring_count` rings
    between `ring_edges`, and slips on the outer rings.
    """

    ring_edges: np.ndarray
    phi: np.ndarray
    stick_ring_count: int

    @property
    def force(self) -> float:
        """Ratio of the force to the force of a frictionless punch, for which phi = 2/pi."""
        return float(math.pi / 2.0 * self.phi @ np.diff(self.ring_edges))

    @property
    def stick_radius(self) -> float:
        """Radius up to which the surface sticks."""
        return float(self.ring_edges[self.stick_ring_count])

    def sinking_integral(self, n: float) -> float:
        """Return int_0^1 (1 - W(1/s)) s^(n-1) ds = B/(n alpha).

        W(q) = int_0^1 phi/sqrt(q^2 - x^2) dx is the depth of the surface outside the punch.
        """
        from scipy.special import hyp2f1

        x = self.ring_edges
        # The moment is int_0^1 s^n/sqrt(1 - s^2 x^2) ds.
        moment = hyp2f1(0.5, (n + 1.0) / 2.0, (n + 3.0) / 2.0, x * x) / (n + 1.0)
        return float(1.0 - self.phi @ np.diff(np.arcsin(x) - x * moment)) / n


@lru_cache(maxsize=16)
def _punch(beta: float, friction: float) -> FrictionalPunch:
    """Return the frictional punch, solved on graded rings (cached)."""
    # Twice as many rings halve the error of the force, 2e-5, at five times the cost.
    return Rings(1.0 - (1.0 - np.linspace(0.0, 1.0, 201)) ** EDGE_GRADING).solve_punch(
        beta, friction
    )


@dataclass(frozen=True)
class Rings:
    """Rings between edges (n + 1,), and the Abel integrals over the rings."""

    ring_edges: np.ndarray

    @cached_property
    def ring_middles(self) -> np.ndarray:
        """Midpoints of the rings (n,), the collocation points of the displacements."""
        return (self.ring_edges[1:] + self.ring_edges[:-1]) / 2.0

    @cached_property
    def _inner_fraction(self) -> np.ndarray:
        """Ratios of ring edges to ring midpoints (n, n + 1), limited to 1."""
        return np.minimum(self.ring_edges / self.ring_middles[:, None], 1.0)

    def solve_punch(self, beta: float, friction: float) -> FrictionalPunch:
        """Return the frictional punch; the innermost ring that slips is found by bisection."""
        n = len(self.ring_middles)
        angle = np.arcsin(self._inner_fraction)
        # Each row integrates 1/sqrt(r^2 - x^2) over the rings below one middle r.
        vertical_rows = np.diff(angle)
        radial_rows = (
            self.ring_middles[:, None]
            / 2.0
            * np.diff(angle - self._inner_fraction * np.sqrt(1.0 - self._inner_fraction**2))
        )
        outer_integrals = self._outer_integrals(self.ring_middles)
        pressure_rows = (np.diff(self.ring_edges) - outer_integrals) / self.ring_middles[:, None]
        stick_equations = np.block(
            [[vertical_rows, -beta * outer_integrals], [-beta * pressure_rows, radial_rows]]
        )
        # Integrals over each ring: of q from chi, and of r p from phi.
        ring_tractions = -np.diff(self._outer_integrals(self.ring_edges), axis=0)
        slip_equations = np.hstack(
            [-friction / self.ring_middles[:, None] * ring_tractions, ring_tractions]
        )
        right_side = np.repeat([1.0, 0.0], n)

        def solve_slip_from(k: int) -> np.ndarray:
            """Return phi and chi if the rings from k on slip."""
            return np.linalg.solve(
                np.vstack([stick_equations[: n + k], slip_equations[k:]]), right_side
            )

        def is_slip_admissible(k: int) -> bool:
            """Return whether stick is admissible on ring k - 1, with slip from ring k on."""
            return k == 0 or bool(slip_equations[k - 1] @ solve_slip_from(k) <= 0.0)

        k = bisect_left(range(n), True, key=lambda ring: not is_slip_admissible(ring + 1))
        return FrictionalPunch(self.ring_edges, solve_slip_from(k)[:n], k)

    def _outer_integrals(self, r: np.ndarray) -> np.ndarray:
        """Return int_r^1 x/sqrt(x^2 - r^2) dx over each ring for each r."""
        return np.diff(np.sqrt(np.maximum(self.ring_edges**2 - r[:, None] ** 2, 0.0)))


FRICTIONLESS_PUNCH = FrictionalPunch(np.array([0.0, 1.0]), np.array([2.0 / math.pi]), 0)
