"""Frictionless contact on a surface compliance as a linear complementarity problem.

    p >= 0,  g = o + M p >= 0,  p g = 0
for pressures p and gaps o without pressure at surface points; p > 0 in compression, g > 0 open.
Sources: Wriggers, Computational Contact Mechanics (2006), section 6.5; Hintermueller, Ito & Kunisch
(2002), SIAM J. Optim. 13, 865, for the primal-dual active sets.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from indent_sim.theory.hankel import axisymmetric_kernel
from indent_sim.theory.layer import Layer

# Largest number of active sets that are tried for a contact that is not a disc.
MAX_ACTIVE_SET_ITERATIONS = 60
# Largest accepted tensile pressure, and overlap, relative to the largest pressure or gap.
CONTACT_TOLERANCE = 1e-12


class CandidateSetTooSmall(ValueError):
    """The contact reaches the last of the candidate nodes, so that more nodes are needed."""

    def __init__(self) -> None:
        super().__init__(
            "the contact reaches the last of the candidate nodes, which were chosen for the "
            "largest contact of the history"
        )


class SearchNotConverged(ArithmeticError):
    """A search did not converge, and the last iterate is not a solution of the contact problem."""


@dataclass(frozen=True)
class RelaxingSurface:
    """Discretised contact problem: compliance between weighted points, and tip heights there.

    Attributes
    ----------
    compliance
        Symmetric positive definite compliance matrix (n, n) of the weighted points.
    heights, areas
        Weighted heights of the tip and weights of the points (n,).
    radii
        Radii [L] of the points of an axisymmetric body in ascending order; empty for other bodies,
        where the contact area (width in plane strain) is the sum of the areas.
    edge_shift
        Distance by which the contact edge lies outside the zero of the edge pressures
        (`disc_radius`), divided by the spacing of the points.
    has_only_discs
        Whether the formulation is valid only for a circular contact area.
    max_radius
        Radius [L] at which tip and points end, so that all points may touch.
    """

    compliance: np.ndarray
    heights: np.ndarray
    areas: np.ndarray
    radii: np.ndarray = field(default_factory=lambda: np.zeros(0))
    edge_shift: float = 0.0
    is_plane_strain: bool = False
    has_only_discs: bool = False
    max_radius: float | None = None

    @property
    def is_ordered(self) -> bool:
        """True if the points are ordered by radius; a contact then consists of the first ones."""
        return len(self.radii) > 0

    def contact_radius(self, p: np.ndarray) -> float:
        """Return the contact radius [L] of pressures (n,) at unordered points.

        In plane strain this is half the width.
        """
        area = float(self.areas[p > 0.0].sum())
        return 0.5 * area if self.is_plane_strain else float(np.sqrt(area / np.pi))

    def disc_radius(self, y: np.ndarray) -> float:
        """Return the radius [L] of a disc at which the edge pressures y (n,) change their sign.

        Up to a positive factor, y_i is the pressure at point i if the contact ends at this point.
        """
        n = int(np.argmax(y <= 0.0))
        if n == 0:
            return 0.0 if y[0] <= 0.0 else self.max_radius or float(self.radii[-1])
        distance = self.radii[n] - self.radii[n - 1]
        return float(
            self.radii[n - 1] + distance * (y[n - 1] / (y[n - 1] - y[n]) + self.edge_shift)
        )


def layer_surface(contact: Layer, a: float) -> RelaxingSurface:
    """Return the surface of a layer for contacts up to the radius a [L].

    In the layer's integral equation, phi(x) >= 0 corresponds to the pressure, and delta - g(x) to
    the displacement: (pi/E*)(phi - (2/pi) ∫ K phi) = delta - g, and F = 2 pi ∫ phi. If the contact
    is a disc, its radius is the same in both formulations.
    """
    h = contact.h
    # Radius of the surface over the largest expected contact radius.
    margin = 1.25
    n = round(200 * margin)  # 200 points in the largest contact radius.
    edge = contact.tip.punch_radius
    max_radius = edge or min(margin * a, contact.max_size() * h * (1 - 1e-6))
    edges = np.linspace(0.0, max_radius, n + 1)
    x = 0.5 * (edges[1:] + edges[:-1]) / h
    width = max_radius / n
    kernel = axisymmetric_kernel(max_radius / h, contact.scaled_stack, contact.wall)
    B = kernel.basis(x)
    K = B.T @ (kernel.weight[:, None] * B) / h  # [1/L]
    areas = np.full(n, 2.0 * np.pi * width)
    A = areas[:, None] * np.pi / contact.E_star * (np.eye(n) - 2.0 / np.pi * K * width)
    return RelaxingSurface(
        0.5 * (A + A.T),
        areas * contact.tip.g(x * h),
        areas,
        x * h,
        has_only_discs=True,
        max_radius=edge,
    )


class SurfaceContactLCP:
    """Contacts on one surface compliance M: p >= 0, o + M p >= 0, p (o + M p) = 0.

    p are the pressures, and o the gaps without pressure.

    The attributes `contact_radius` [L] and `stiffness` [F/L] (force per depth at constant active
    points) refer to the contact that was solved last.
    """

    def __init__(self, surface: RelaxingSurface, M: np.ndarray):
        self.surface = surface
        self.compliance = M
        if surface.is_ordered:
            self.cholesky_factor = cholesky(M, lower=True)
            self.unit_response = solve_triangular(self.cholesky_factor, surface.areas, lower=True)
        self._is_active: np.ndarray = np.zeros(len(M), dtype=bool)
        self.contact_radius = 0.0
        self.stiffness = 0.0

    def solve_pressures(self, open_gaps: np.ndarray) -> np.ndarray:
        """Return the pressures (n,) for given gaps without pressure, `open_gaps` (n,).

        Raises
        ------
        CandidateSetTooSmall
            If all points touch.
        SearchNotConverged
            If no contact was found.
        """
        p = self._solve_disc(open_gaps) if self.surface.is_ordered else None
        if p is None and self.surface.has_only_discs:
            raise SearchNotConverged(
                "the contact is not a disc, as this theory requires; use solver.method: condensed"
            )
        return self._solve_active_set(open_gaps) if p is None else p

    def _solve_disc(self, open_gaps: np.ndarray) -> np.ndarray | None:
        """Return the pressures of a contact on the first points; None if they are not a solution.

        The last of n pressures has the sign of y_n with L y = -o, L the Cholesky factor.
        """
        edge_pressures = solve_triangular(self.cholesky_factor, -open_gaps, lower=True)
        outside_points = np.flatnonzero(edge_pressures <= 0.0)
        if not len(outside_points) and not self.surface.max_radius:
            raise CandidateSetTooSmall
        n = int(outside_points[0]) if len(outside_points) else len(open_gaps)
        p = np.zeros(len(open_gaps))
        p[:n] = (
            solve_triangular(
                self.cholesky_factor[:n, :n], edge_pressures[:n], lower=True, trans="T"
            )
            if n
            else 0.0
        )
        gap = open_gaps[n:] + self.compliance[n:, :n] @ p[:n]
        self.contact_radius = self.surface.disc_radius(edge_pressures)
        self.stiffness = float(self.unit_response[:n] @ self.unit_response[:n])
        return (
            p
            if np.all(p >= 0.0) and np.all(gap >= -CONTACT_TOLERANCE * np.abs(open_gaps).max())
            else None
        )

    def _solve_active_set(self, open_gaps: np.ndarray) -> np.ndarray:
        """Return the pressures of a contact of any shape by a primal-dual active set method."""
        is_active = self._is_active if self._is_active.any() else open_gaps < 0.0
        for _ in range(MAX_ACTIVE_SET_ITERATIONS):
            p, gap = self._pressures_and_gaps(open_gaps, is_active)
            if (
                p.min() >= -CONTACT_TOLERANCE * p.max()
                and gap.min() >= -CONTACT_TOLERANCE * np.abs(open_gaps).max()
            ):
                break
            is_active = np.where(is_active, p, -gap) > 0.0
        else:
            raise SearchNotConverged(
                f"the active set did not converge in {MAX_ACTIVE_SET_ITERATIONS} iterations"
            )
        if is_active.all():
            raise CandidateSetTooSmall
        self._is_active = is_active
        p = np.maximum(p, 0.0)
        active = np.flatnonzero(is_active)
        self.contact_radius = self.surface.contact_radius(p)
        self.stiffness = float(
            self.surface.areas[active] @ self._solve_active(active, self.surface.areas)
        )
        return p

    def _pressures_and_gaps(
        self, open_gaps: np.ndarray, is_active: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return pressures (of either sign) that close the active gaps, and all resulting gaps."""
        active = np.flatnonzero(is_active)
        p = np.zeros(len(open_gaps))
        p[active] = self._solve_active(active, -open_gaps)
        gap = open_gaps + self.compliance @ p
        gap[active] = 0.0
        return p, gap

    def _solve_active(self, active: np.ndarray, right_side: np.ndarray) -> np.ndarray:
        """Solve for the pressures of the active points."""
        return np.linalg.solve(self.compliance[np.ix_(active, active)], right_side[active])
