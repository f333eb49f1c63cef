"""Frictionless contact on a surface compliance as a linear complementarity problem.

    p >= 0,  g = o + M p >= 0,  p g = 0
for pressures p and open gaps o at surface points; p > 0 in compression, g > 0 where open.
Sources: Wriggers, Computational Contact Mechanics (2006), section 6.5; Hintermueller, Ito & Kunisch
(2002), SIAM J. Optim. 13, 865, for the primal-dual active sets.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from indent_sim.theory.hankel import axisymmetric_kernel
from indent_sim.theory.layer import Layer

POINTS_PER_RADIUS = 200  # of a contact radius, on a body that theory knows
SURFACE_MARGIN = 1.25  # of the widest contact that is expected: places beyond are there
MAX_ACTIVE_SET_ITERATIONS = 60  # corrections of a contact that is no disc
CONTACT_TOLERANCE = (
    1e-12  # of the largest pressure, or gap, by which a contact may pull, or overlap
)


class CandidateSetTooSmall(ValueError):
    """The contact covers all of the surface that is known."""

    def __init__(self) -> None:
        super().__init__(
            "the contact outgrows the surface that is known: the tip comes deeper than its "
            "history says"
        )


class SearchNotConverged(ArithmeticError):
    """A search that did not come to its end: what it has is no contact."""


@dataclass(frozen=True)
class RelaxingSurface:
    """A: (n, n) compliance between weighted places, symmetric and positive definite; heights and
    areas (n,).

    `places` (n,): the radii [L] of places in their order on an axisymmetric body; its contact ends
    by `shift` of their distance beyond where their edge pressure vanishes. Empty otherwise, where
    the contact's area is the sum of areas, or its width in plane strain (`is_plane`). `only_discs`:
    what stands for pressure and gap does so for discs alone. `end`: radius [L] at which the tip
    ends, as all places do: then all of them may touch.
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
        """Whether a contact is the first places."""
        return len(self.radii) > 0

    def contact_radius(self, p: np.ndarray) -> float:
        """Contact radius [L] of pressures (n,) on places that have no order; half the width in
        plane strain.
        """
        area = float(self.areas[p > 0.0].sum())
        return 0.5 * area if self.is_plane_strain else float(np.sqrt(area / np.pi))

    def disc_radius(self, y: np.ndarray) -> float:
        """Radius [L] of a disc from the edge pressures y (n,) of punches that end at each place: it
        is where they change their sign.
        """
        n = int(np.argmax(y <= 0.0))
        if n == 0:
            return 0.0 if y[0] <= 0.0 else self.max_radius or float(self.radii[-1])
        distance = self.radii[n] - self.radii[n - 1]
        return float(
            self.radii[n - 1] + distance * (y[n - 1] / (y[n - 1] - y[n]) + self.edge_shift)
        )


def layer_surface(contact: Layer, a: float) -> RelaxingSurface:
    """The surface of a layer theory for contacts up to the radius a [L], in the variable of its
    integral equation.

    phi(x) >= 0 and delta - g(x) take the places of pressure and gap: (pi/E*)(phi - (2/pi) int K
    phi) = delta - g, and F = 2 pi int phi. A contact that is a disc ends at the same radius in
    both, whatever has happened outside.
    """
    h = contact.h
    n = round(POINTS_PER_RADIUS * SURFACE_MARGIN)
    edge = contact.tip.punch_radius
    max_radius = edge or min(SURFACE_MARGIN * a, contact.max_size() * h * (1 - 1e-6))
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
    """One compliance M of a surface and its contacts: p >= 0, o + M p >= 0, p (o + M p) = 0.

    Of the last contact found: its `radius` [L], and the force per depth `stiffness` [F/L] of what
    touches.
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
        """The pressures of open gaps o (n,).

        Outgrown where all places touch, Unsettled where no contact was found.
        """
        p = self._solve_disc(open_gaps) if self.surface.is_ordered else None
        if p is None and self.surface.has_only_discs:
            raise SearchNotConverged(
                "the contact is no disc, and theory knows no other (solver.method: condensed does)"
            )
        return self._solve_active_set(open_gaps) if p is None else p

    def _solve_disc(self, open_gaps: np.ndarray) -> np.ndarray | None:
        """Those of a contact on the first places: the last of n pressures has the sign of y_n, L y
        = -o.
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
        """Those of any contact, by primal-dual active sets; from the last one."""
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
                f"the contact of a step did not settle in {MAX_ACTIVE_SET_ITERATIONS} corrections"
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
        """The pressures that close some gaps, whatever their sign, and all gaps."""
        active = np.flatnonzero(is_active)
        p = np.zeros(len(open_gaps))
        p[active] = self._solve_active(active, -open_gaps)
        gap = open_gaps + self.compliance @ p
        gap[active] = 0.0
        return p, gap

    def _solve_active(self, active: np.ndarray, right_side: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self.compliance[np.ix_(active, active)], right_side[active])
