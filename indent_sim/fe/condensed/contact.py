"""Contact on a condensed body: the laws of `model.contact`, on a small dense compliance.

With nodal forces F (pushing down) the gap at a quadrature point is g = f - delta + N C F, and every law with a
stiffness is one equation in F alone,

    F = int <p_hat> N,   p_hat = lam - epsilon_n g,   lam = L2 projection of <p_hat> = M^-1 F   (or given, or zero):

the full problem's equations with displacement and multiplier eliminated, so both paths give the same numbers. Forces
act on the candidates alone; M and lam are those of the whole contact surface, so no number knows the candidates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import isclose
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from indent_sim.fe.condensed.compliance import Compliance
from indent_sim.fe.condensed.friction import CondensedFriction
from indent_sim.fe.observe.surface import (
    Trace,
    contact_quadrature,
    from_midpoints,
    pressure_functions,
    shapes,
    split_quadrature,
    undeformed,
)
from indent_sim.fe.solve import uzawa
from indent_sim.fe.solve.anchor import anchored
from indent_sim.fe.solve.mixing import Mixing
from indent_sim.fe.solve.newton import softening
from indent_sim.scene.scene import Scene

TOLERANCE = 1e-12  # of the residual, relative to the nodal forces; a dense solve leaves less
NOTHING = 1e-20  # of the nodal forces of the states before: less is none, as under a punch back where it began
ITERATIONS = 100


class CondensedContact:
    """A tip on a condensed body: finds the nodal forces and pressures at any depth."""

    def __init__(self, compliance: Compliance, scene: Scene, iterations: int = 0):
        self.compliance = compliance
        self.law = scene.physics.contact
        self.nodes = compliance.trace.nodes
        self.places = compliance.places
        self.iterations = iterations
        self.failure = ""  # why the last solve did not converge
        # nodal forces down and, with friction, along the horizontal axes
        self.forces: np.ndarray = np.zeros((1 + len(compliance.held), compliance.size))
        # multiplier at the nodes of the whole surface (active set: nodal pressures)
        self.lam: np.ndarray = np.zeros(1 + compliance.surface.nodes.max(initial=-1))
        self.scene = scene
        self._recent = [self.F]  # nodal forces of the last equilibria
        self._expected: np.ndarray | None = None  # which points the next solve takes to be in contact at first
        self.friction = CondensedFriction(self) if self.law.friction else None
        self._solve: Callable[[float], bool] = ALGORITHMS[self.law.multiplier](self)

    @property
    def F(self) -> np.ndarray:
        """Nodal forces pushing down (nodes,)."""
        return self.forces[0]

    def solve(self, delta: float) -> bool:
        """Find the equilibrium at a depth from the present forces; on failure they are as they were."""
        before = self.forces, self.lam
        if self._solve(delta):
            self._recent = [*self._recent[-1:], self.F]
            return True
        self.forces, self.lam = before
        return False

    def trial(self, delta: float) -> np.ndarray:
        """lam - epsilon_n g of the present forces, above zero in contact: at the points of the contact quadrature, and
        of nodal pressures at the nodes that carry one, with E*/h_contact [pressure]."""
        if self.law.multiplier == "nodal":
            return self._nodal_trial(delta)
        N, _, height = self.quadrature
        epsilon_n: float = self.law.stiffness  # type: ignore[union-attr]
        nodal = self.lam[self.places] - epsilon_n * (self.compliance.C @ self.F)
        return np.asarray(nodal[self.nodes] @ N.T - epsilon_n * (height - delta))

    def expect(self, trial: np.ndarray) -> None:
        """Set out from what would be in contact with this trial pressure, in the next solve."""
        self._expected = trial > 0

    def _set_out(self, active: np.ndarray) -> np.ndarray:
        """What is in contact at first: what is expected, or else what is in contact now."""
        expected, self._expected = self._expected, None
        return active if expected is None else expected

    def nothing(self, size: Callable[[np.ndarray], Any]) -> float:
        """NOTHING of the largest size of the nodal forces in the last equilibria."""
        return NOTHING * max(float(size(F)) for F in self._recent)

    # ---- the surface ---------------------------------------------------------------------------------------------

    def rule(self, points: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted areas (facets, points) and the tip's height over the undeformed surface there."""
        trace, scene = self.compliance.trace, self.scene
        x = np.moveaxis(undeformed(scene.physics.part, trace, points), -1, 0)
        horizontal = scene.physics.part.kinematics.horizontal(x, scene.physics.center)
        return self._areas(trace, points, weights), scene.physics.indenter.height(*horizontal) - x[-1]

    def _areas(self, trace: Trace, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Areas (facets, points) of quadrature points, times the kinematics' weight."""
        tangents = trace.tangents(trace.X, points)
        area = np.sqrt(np.linalg.det(np.einsum("fpdi,fpdj->fpij", tangents, tangents)))
        return area * weights * self.scene.physics.part.kinematics.weight(np.moveaxis(trace.positions(points), -1, 0))

    @cached_property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shape functions (points, nodes), weighted areas and heights (facets, points) of the contact quadrature."""
        points, weights = contact_quadrature(self.compliance.trace.dim)
        return shapes(points), *self.rule(points, weights)

    @cached_property
    def mass(self) -> Any:
        """The mass matrix M [area] of the whole contact surface."""
        surface = self.compliance.surface
        points, weights = contact_quadrature(surface.dim)
        N, W, nodes = shapes(points), self._areas(surface, points, weights), surface.nodes
        local = np.einsum("fp,pn,pm->fnm", W, N, N)
        rows, columns = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
        return csc_matrix((local.ravel(), (rows.ravel(), columns.ravel())), shape=(len(self.lam),) * 2)

    @cached_property
    def _factored_mass(self) -> Any:
        return splu(self.mass)

    def projected(self, F: np.ndarray) -> np.ndarray:
        """M^-1 F on the whole surface for forces (n,) or (n, columns) on the candidates."""
        whole = np.zeros((len(self.lam), *F.shape[1:]))
        whole[self.places] = F
        return self._factored_mass.solve(whole)

    @cached_property
    def _inverse_mass(self) -> np.ndarray:
        """M^-1 (n, n) [1/area] between the candidates: their lam = M^-1 F."""
        return self.projected(np.eye(self.compliance.size))[self.places]

    def _matrix(self, local: np.ndarray) -> np.ndarray:
        """Sum facet matrices (facets, n, n) into a dense one over the nodes."""
        size, n = self.compliance.size, self.nodes.shape[1]
        places = self.nodes[:, :, None] * size + self.nodes[:, None, :]
        return np.bincount(places.ravel(), local.ravel(), size * size).reshape(size, size) if n else np.zeros((0, 0))

    def vector(self, local: np.ndarray) -> np.ndarray:
        """Facet vectors (facets, nodes) summed over the nodes of the candidates."""
        return np.bincount(self.nodes.ravel(), local.ravel(), self.compliance.size)

    # ---- laws with a stiffness -----------------------------------------------------------------------------------

    def newton(self, delta: float, *, with_multiplier: bool = False) -> bool:
        """Semismooth Newton on F = int <lam - epsilon_n g> N with lam = M^-1 F, or held as it is.

        From where it stands, with a multiplier through a stiffness of E*/h_contact, whose solution is nearly the law's
        own; if that is too far, through softer contact to the law's own.
        """
        start, epsilon_n = self.forces, self.law.stiffness  # type: ignore[union-attr]
        unit = self.scene.physics.material.E_star / self.scene.sizes.h_contact
        is_other = with_multiplier and not isclose(epsilon_n, unit, rel_tol=1e-9)  # 1e-9: the same in all units
        first = [unit / epsilon_n, 1.0] if is_other else [1.0]
        for factors in (first, softening(self.law, self.scene)):
            self.forces = start
            if self.friction:
                found = all(self.friction.newton(delta, factor) for factor in factors)
            else:
                found = all(self._newton(delta, factor * epsilon_n, with_multiplier) for factor in factors)
            if found:
                return True
        self.failure = f"no equilibrium within {ITERATIONS} iterations, or the points in contact go round in a circle"
        return False

    def update(self, mixing: Mixing) -> float:
        """Change the multiplier; returns how far it was from its projection, relative to itself."""
        before, image = self.lam, self.projected(self.F)
        change, nothing = np.linalg.norm(image - before), self.nothing(lambda F: np.linalg.norm(self.projected(F)))
        self.lam = mixing(before, image)
        size = max(np.linalg.norm(before), np.linalg.norm(image))
        return float(change / size) if change > nothing else 0.0

    def _newton(self, delta: float, epsilon_n: float, with_multiplier: bool) -> bool:
        N, W, height = self.quadrature
        C = self.compliance.C
        D = (self._inverse_mass if with_multiplier else 0.0) - epsilon_n * C
        offset = -epsilon_n * (height - delta)
        if not with_multiplier:
            offset = offset + self.lam[self.places][self.nodes] @ N.T
        F: np.ndarray = self.F.copy()
        before: np.ndarray | None = None
        nothing = self.nothing(lambda F: np.abs(F).max(initial=0.0))
        seen: set[bytes] = set()
        for _ in range(ITERATIONS):
            p_hat = (D @ F)[self.nodes] @ N.T + offset
            active = p_hat > 0
            load = self._load(p_hat, active)
            residual = F - load
            # between two Newton steps with the same active points the problem is linear: the first was exact
            settled = before is not None and np.array_equal(active, before)
            if settled or np.abs(residual).max(initial=0.0) <= TOLERANCE * np.abs(load).max(initial=0.0) + nothing:
                self.forces = load[None]
                return True
            if active.tobytes() in seen:  # the active points alone say where the next step leads: it is a circle
                return False
            before = active = self._set_out(active)
            seen.add(active.tobytes())
            F = F + self._newton_step(F - self._load(p_hat, active), W * active, N, D)
            self.iterations += 1
        return False

    def _load(self, p_hat: np.ndarray, active: np.ndarray) -> np.ndarray:
        """The nodal forces of a pressure at the points of the contact quadrature that are in contact."""
        N, W, _ = self.quadrature
        return self.vector((W * np.where(active, p_hat, 0.0)) @ N)

    def _newton_step(self, residual: np.ndarray, weights: np.ndarray, N: np.ndarray, D: np.ndarray) -> np.ndarray:
        """-(I - M_A D)^-1 residual; rows without an active point are those of the identity."""
        touched = np.flatnonzero(weights.any(axis=1))
        n = N.shape[1]
        pairs = (N[:, :, None] * N[:, None, :]).reshape(len(N), n * n)
        local = (weights[touched] @ pairs).reshape(-1, n, n)
        rows = np.unique(self.nodes[touched])
        place = np.zeros(self.compliance.size, dtype=np.int64)
        place[rows] = np.arange(len(rows))
        inner, m = place[self.nodes[touched]], len(rows)
        i, j = np.broadcast_arrays(inner[:, :, None], inner[:, None, :])
        M_A = csr_matrix((local.ravel(), (i.ravel(), j.ravel())), shape=(m, m))  # a node has few neighbours
        among = D[np.ix_(rows, rows)]
        step = -residual
        step[rows] += M_A @ (D[rows] @ step - among @ step[rows])
        step[rows] = np.linalg.solve(np.eye(m) - M_A @ among, step[rows])
        return step

    def stiffness(self, delta: float) -> float:
        """d/ddelta of the sum of the nodal forces, by the tangent of the present equilibrium [pressure length].

        A multiplier moves with the depth, whether it is solved for or updated in a loop: F is the law's own either way.
        """
        if self.law.multiplier == "nodal":
            return self._nodal_stiffness()
        N, W, height = self.quadrature
        epsilon_n: float = self.law.stiffness  # type: ignore[union-attr]
        D = (0.0 if self.law.multiplier == "none" else self._inverse_mass) - epsilon_n * self.compliance.C
        active = (D @ self.F)[self.nodes] @ N.T - epsilon_n * (height - delta) > 0
        if not active.any():
            return 0.0
        return float(self._newton_step(-self.vector((W * epsilon_n * active) @ N), W * active, N, D).sum())

    def _nodal_stiffness(self) -> float:
        """The same of nodal pressures: the punch on the nodes that carry one."""
        _, _, areas, A = self._weighted
        on = np.flatnonzero(self.lam[self.places] > 0)
        return float(areas[on] @ np.linalg.solve(A[np.ix_(on, on)], areas[on])) if len(on) else 0.0

    # ---- the active set ------------------------------------------------------------------------------------------

    @cached_property
    def _weighted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Forces per nodal pressure Q, weighted heights, node areas, and the compliance between weighted gaps.

        Nodes that carry no pressure have no area.
        """
        points, weights = split_quadrature(self.compliance.trace.dim)
        W, height = self.rule(points, weights)
        N, psi = shapes(points), pressure_functions(points)
        Q = self._matrix(np.einsum("fp,pn,pm->fnm", W, N, psi))
        heights, areas = self.vector((W * height) @ psi), self.vector(W @ psi)
        return Q, heights, areas, Q.T @ self.compliance.C @ Q

    @property
    def weighted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of the nodes that carry a pressure the places x (n, dim - 1) [length], weighted heights, areas, and the
        compliance A: gaps heights - delta areas + A p >= 0, and areas . p is the force of the modelled part."""
        _, heights, areas, A = self._weighted
        trace = self.compliance.trace
        x = np.zeros((self.compliance.size, trace.dim - 1))
        x[trace.nodes] = trace.X[..., :-1]
        carriers = np.flatnonzero(areas > 0)
        return x[carriers], heights[carriers], areas[carriers], A[np.ix_(carriers, carriers)]

    def active_set(self, delta: float) -> bool:
        """Pressures p >= 0 with weighted gaps G = heights - delta areas + A p >= 0 and p G = 0, exactly."""
        Q, heights, areas, A = self._weighted
        carriers = np.flatnonzero(areas > 0)
        open_gap, A = (heights - delta * areas)[carriers], A[np.ix_(carriers, carriers)]
        p, solves = complementary(A, open_gap, self._set_out(self._nodal_trial(delta) > 0))
        self.iterations += solves
        self.lam = np.zeros(len(self.lam))
        self.lam[self.places[carriers]] = p
        self.forces = (Q[:, carriers] @ p)[None]
        return True

    def _nodal_trial(self, delta: float) -> np.ndarray:
        _, heights, areas, A = self._weighted
        on = np.flatnonzero(areas > 0)
        p, scale = self.lam[self.places[on]], self.scene.physics.material.E_star / self.scene.sizes.h_contact
        gaps = ((heights - delta * areas)[on] + A[np.ix_(on, on)] @ p) / areas[on]
        return np.asarray(p - scale * gaps)

    # ---- what is observed ----------------------------------------------------------------------------------------

    @property
    def multiplier(self) -> np.ndarray:
        """lam at the nodes of the whole surface [pressure]; of a law without one the projection of its <p_hat>."""
        return self.projected(self.F) if self.law.multiplier == "none" else self.lam

    def energy(self, delta: float) -> float:
        """Strain plus contact energy of the modelled part."""
        X, whole = self.forces.ravel(), self.compliance.whole
        strain = 0.5 * float(X @ whole @ X)
        if self.law.multiplier == "nodal":
            return strain
        N, W, height = self.quadrature
        lam = self.lam[self.places][self.nodes] @ N.T
        gap = height - delta + (whole @ X)[: len(self.F)][self.nodes] @ N.T
        return strain + float((W * self.law.potential(gap, lam)).sum())  # type: ignore[union-attr]


def complementary(A: np.ndarray, open_gap: np.ndarray, active: np.ndarray) -> tuple[np.ndarray, int]:
    """p >= 0 with G = open_gap + A p >= 0 and p G = 0, A symmetric positive definite, and the number of solves.

    Primal-dual active sets, beginning with `active`; when a set comes back they go round in a circle, and the same
    problem is solved as one of non-negative least squares, which cannot (Lawson & Hanson 1974).
    """
    seen: set[bytes] = set()
    while active.tobytes() not in seen:
        seen.add(active.tobytes())
        p, on = np.zeros(len(A)), np.flatnonzero(active)
        p[on] = np.linalg.solve(A[np.ix_(on, on)], -open_gap[on])
        now = np.where(active, p, -(open_gap + A @ p)) > 0
        if np.array_equal(now, active):
            return p, len(seen)
        active = now
    from scipy.optimize import nnls  # with all of scipy's searches, which few contacts need

    L = cholesky(A, lower=True)
    p, _ = nnls(L.T, -solve_triangular(L, open_gap, lower=True), maxiter=50 * len(A))
    return p, len(seen) + 1


def _augmented_lagrangian(contact: CondensedContact) -> Callable[[float], bool]:
    friction = contact.friction

    def once(delta: float) -> bool:
        if not contact.newton(delta, with_multiplier=True):
            return False
        contact.lam = contact.projected(contact.F)
        return True

    if friction is None:
        return once
    return lambda delta: anchored(friction, contact.scene.physics.anchor, lambda: once(delta))


def _uzawa(contact: CondensedContact) -> Callable[[float], bool]:
    def solve(delta: float) -> bool:
        return uzawa.settle(contact, contact.scene, MPI.COMM_SELF, lambda rtol: contact.newton(delta), contact.update)

    return solve


ALGORITHMS: dict[str, Callable[[CondensedContact], Callable[[float], bool]]] = {
    "none": lambda contact: contact.newton,
    "unknown": _augmented_lagrangian,
    "frozen": _uzawa,
    "nodal": lambda contact: contact.active_set,
}


class CondensedState:
    """The present state of a condensed contact, as `observe` wants to see it; the same on every rank."""

    def __init__(self, contact: CondensedContact, scene: Scene, comm: Any, depth: float = 0.0):
        self.contact, self.scene, self.comm = contact, scene, comm
        self.trace = contact.compliance.trace
        self.depth = depth

    def nodal_displacement(self) -> np.ndarray:
        """Displacement (facets, nodes, dim): u_z; the horizontal part has no say in a reference gap."""
        u = np.zeros(self.trace.X.shape)
        compliance, forces = self.contact.compliance, self.contact.forces
        u[..., -1] = -(compliance.whole @ forces.ravel())[: compliance.size][self.trace.nodes]
        return u

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) [pressure]."""
        return self.contact.multiplier[self.contact.places][self.trace.nodes] @ self.basis(points).T

    def room_at(self, points: np.ndarray) -> np.ndarray:
        """friction p - |t_hat| (facets, points) [pressure], >= 0 where the surface sticks."""
        assert self.contact.friction
        return self.contact.friction.room_at(points, self.depth)

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) [pressure]."""
        assert self.contact.friction
        nodal = self.contact.friction.tau()[:, self.contact.places].T
        return self.trace.values(nodal[self.trace.nodes], points)

    def basis(self, points: np.ndarray) -> np.ndarray:
        """The multiplier's functions (points, nodes) on the reference facet."""
        nodal = self.scene.physics.contact.multiplier == "nodal"
        return pressure_functions(points) if nodal else shapes(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) as a pressure to be looked at: without its ripples at the vertices of triangles."""
        return self.nodal_pressure()[self.contact.places][self.trace.nodes] @ self.basis(points).T

    def nodal_pressure(self) -> np.ndarray:
        """Values at the nodes of the whole surface for `pressure_at` [pressure]."""
        lam, nodes = self.contact.multiplier, self.contact.compliance.surface.nodes
        if self.scene.physics.contact.multiplier == "nodal" or not self.trace.ripples:
            return lam
        pressure = lam.copy()
        pressure[nodes] = from_midpoints(lam[nodes], lambda v: np.bincount(nodes.ravel(), v.ravel())[nodes])
        return pressure
