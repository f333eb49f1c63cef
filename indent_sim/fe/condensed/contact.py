"""Contact on a condensed body: the laws of `model.contact`, on a small dense compliance.

With nodal forces F (pushing down) the gap at a quadrature point is g = f - delta + N C F, and every
law with a stiffness is one equation in F alone,

    F = int <p_hat> N,   p_hat = lam - epsilon_n g,   lam = L2 projection of <p_hat> = M^-1 F   (or
    given, or zero):

the full problem's equations with displacement and multiplier eliminated, so both paths give the
same numbers. Forces act on the candidates alone; M and lam are those of the whole contact surface,
so no number knows the candidates.
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
from scipy.sparse.linalg import SuperLU, splu

from indent_sim.fe.condensed.compliance import Compliance
from indent_sim.fe.condensed.friction import NODAL_FORCE_TOLERANCE, CondensedFriction
from indent_sim.fe.observe import surface
from indent_sim.fe.observe.surface import Trace, contact_quadrature, pressure_functions, shapes
from indent_sim.fe.solve import uzawa
from indent_sim.fe.solve.anchor import anchored
from indent_sim.fe.solve.newton import softening
from indent_sim.scene.scene import Scene

# of the nodal forces of the states before: less is none, as under a punch back where it began
NOTHING = 1e-20
MOST_CONTACT_ITERATIONS = 100
MOST_FULL = 128  # unknowns of a Newton step up to which its matrix is full


class CondensedContact:
    """A tip on a condensed body: finds the nodal forces and pressures at any depth."""

    def __init__(self, compliance: Compliance, scene: Scene, iterations: int = 0):
        self.compliance = compliance
        self.scene = scene
        self.depth = 0.0
        self.law: Any = scene.physics.contact
        self.nodes = compliance.trace.nodes
        self.places = compliance.places
        self.iterations = iterations
        self.failure = ""  # why the last solve did not converge
        # nodal forces down and, with friction, along the horizontal axes
        self.forces: np.ndarray = np.zeros((1 + len(compliance.held), compliance.size))
        # multiplier at the nodes of the whole surface (active set: nodal pressures)
        self.lam: np.ndarray = np.zeros(1 + compliance.surface.nodes.max(initial=-1))
        self._factored_mass: SuperLU | None = None
        self._recent = [self.F]  # nodal forces of the last equilibria
        self._expected: np.ndarray | None = (
            None  # which points the next solve takes to be in contact at first
        )
        self._entries_of: tuple[bytes, int, bytes] | None = None  # of the last Newton step
        self._entries: tuple[np.ndarray, ...] = ()
        self.friction = None if self.law.is_conservative else CondensedFriction(self)

    @property
    def F(self) -> np.ndarray:
        """Nodal forces pushing down (nodes,)."""
        return self.forces[0]

    def solve(self, delta: float) -> bool:
        """Find the equilibrium at a depth from the present forces; on failure they are as they
        were.
        """
        before = (self.forces, self.lam, self.depth)
        self.depth = delta
        if CONDENSED_ALGORITHMS[self.law.multiplier](self):
            self._recent = [*self._recent[-1:], self.F]
            return True
        self.forces, self.lam, self.depth = before
        return False

    def depart(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        if self.friction:
            self.friction.depart()

    def dissipation(self) -> float:
        """What is lost in the step to the present state [energy], of the modelled part."""
        return self.friction.dissipation() if self.friction else 0.0

    def trial(self) -> np.ndarray:
        """lam - epsilon_n g of the present forces, above zero in contact: at the points of the
        contact quadrature, and of nodal pressures at the nodes that carry one, with E*/h_contact
        [pressure].
        """
        if self.law.multiplier == "nodal":
            return self._nodal_trial()
        N, _, height = self.quadrature
        epsilon_n = self.law.stiffness
        nodal = self.lam[self.places] - epsilon_n * (self.compliance.C @ self.F)
        return np.asarray(nodal[self.nodes] @ N.T - epsilon_n * (height - self.depth))

    def expect(self, trial: np.ndarray) -> None:
        """Set out from what would be in contact with this trial pressure, in the next solve."""
        self._expected = trial > 0

    def _set_out(self, active: np.ndarray) -> np.ndarray:
        """What is in contact at first: what is expected, or else what is in contact now."""
        expected = self._expected
        self._expected = None
        return active if expected is None else expected

    def nothing(self, size: Callable[[np.ndarray], np.floating]) -> float:
        """NOTHING of the largest size of the nodal forces in the last equilibria."""
        return NOTHING * max(float(size(F)) for F in self._recent)

    def rule(self, points: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted areas (facets, points) and the tip's height over the undeformed surface there."""
        trace = self.compliance.trace
        scene = self.scene
        x = np.moveaxis(trace.positions(points), -1, 0)
        horizontal = scene.physics.part.kinematics.horizontal(x, scene.physics.center)
        return self._areas(trace, points, weights), scene.physics.indenter.height(*horizontal) - x[
            -1
        ]

    def _areas(self, trace: Trace, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        x = np.moveaxis(trace.positions(points), -1, 0)
        return trace.measures(points) * weights * self.scene.physics.part.kinematics.weight(x)

    @cached_property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shape functions (points, nodes), weighted areas and heights (facets, points) of the
        contact quadrature.
        """
        points, weights = contact_quadrature(self.compliance.trace.dim)
        return shapes(points), *self.rule(points, weights)

    @cached_property
    def mass(self) -> csc_matrix:
        """The mass matrix M [area] of the whole contact surface."""
        whole = self.compliance.surface
        points, weights = contact_quadrature(whole.dim)
        N = shapes(points)
        W = self._areas(whole, points, weights)
        nodes = whole.nodes
        rows, columns = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
        values = np.einsum("fp,pn,pm->fnm", W, N, N).ravel()
        return csc_matrix((values, (rows.ravel(), columns.ravel())), shape=(len(self.lam),) * 2)

    def projected(self, F: np.ndarray) -> np.ndarray:
        """M^-1 F on the whole surface for forces (n,) or (n, columns) on the candidates."""
        self._factored_mass = self._factored_mass or splu(self.mass)
        whole = np.zeros((len(self.lam), *F.shape[1:]))
        whole[self.places] = F
        return self._factored_mass.solve(whole)

    @cached_property
    def inverse_mass(self) -> np.ndarray:
        """M^-1 (n, n) [1/area] between the candidates: their lam = M^-1 F."""
        return self.projected(np.eye(self.compliance.size))[self.places]

    def vector(self, local: np.ndarray) -> np.ndarray:
        """Facet vectors (facets, nodes) summed over the nodes of the candidates."""
        return np.bincount(self.nodes.ravel(), local.ravel(), self.compliance.size)

    def newton(self, inverse_mass: np.ndarray | float = 0.0) -> bool:
        """Semismooth Newton on F = int <lam - epsilon_n g> N with lam = M^-1 F, or held as it is
        where M^-1 is none. From where it stands, with a multiplier through a stiffness of
        E*/h_contact, whose solution is nearly the law's own; if that is too far, through softer
        contact to the law's own.
        """
        start = self.forces
        epsilon_n = self.law.stiffness
        unit = self.scene.physics.material.E_star / self.scene.sizes.h_contact
        is_other = np.ndim(inverse_mass) and not isclose(
            epsilon_n, unit, rel_tol=1e-9
        )  # 1e-9: the same in all units
        solve = (
            self.friction.newton
            if self.friction
            else lambda factor: self._newton(factor * epsilon_n, inverse_mass)
        )
        for factors in (
            [unit / epsilon_n, 1.0] if is_other else [1.0],
            softening(self.law, self.scene),
        ):
            self.forces = start
            if all(map(solve, factors)):
                return True
        lost = "or the points in contact go round in a circle"
        self.failure = f"no equilibrium within {MOST_CONTACT_ITERATIONS} iterations, {lost}"
        return False

    def update(self, mixing: uzawa.Mixing) -> float:
        """Change the multiplier; returns how far it was from its projection, relative to itself."""
        before = self.lam
        image = self.projected(self.F)
        change = np.linalg.norm(image - before)
        nothing = self.nothing(lambda F: np.linalg.norm(self.projected(F)))
        self.lam = mixing(before, image)
        size = max(np.linalg.norm(before), np.linalg.norm(image))
        return 0.0 if change <= nothing else float(change / size)

    def _newton(self, epsilon_n: float, inverse_mass: np.ndarray | float) -> bool:
        N, _, height = self.quadrature
        D = inverse_mass - epsilon_n * self.compliance.C
        offset = -epsilon_n * (height - self.depth)
        if not np.ndim(inverse_mass):
            offset = offset + self.lam[self.places][self.nodes] @ N.T
        F: np.ndarray = self.F.copy()
        before = None
        seen = set()
        nothing = self.nothing(lambda F: np.abs(F).max(initial=0.0))
        for _ in range(MOST_CONTACT_ITERATIONS):
            p_hat = (D @ F)[self.nodes] @ N.T + offset
            active = p_hat > 0
            load = self._load(p_hat, active)
            allowed = NODAL_FORCE_TOLERANCE * np.abs(load).max(initial=0.0) + nothing
            # between two Newton steps with the same active points the problem is linear: the first
            # was exact
            settled = before is not None and np.array_equal(active, before)
            residual = np.abs(F - load).max(initial=0.0)
            if not np.isfinite(
                residual
            ):  # p_hat > 0 is False for NaN: it would pass for a body without contact
                return False
            if settled or residual <= allowed:
                self.forces = load[None]
                return True
            if (
                active.tobytes() in seen
            ):  # the active points alone say where the next step leads: it is a circle
                return False
            before = active = self._set_out(active)
            seen.add(active.tobytes())
            F = F + self.newton_step(F - self._load(p_hat, active), active[None, None], D)
            self.iterations += 1
        return False

    def _load(self, p_hat: np.ndarray, active: np.ndarray) -> np.ndarray:
        N, W, _ = self.quadrature
        return self.vector((W * np.where(active, p_hat, 0.0)) @ N)

    def newton_step(
        self, residual: np.ndarray, slopes: np.ndarray, D: np.ndarray, held: Any = ()
    ) -> np.ndarray:
        """-(I - A D)^-1 residual, A = int slopes N N with `slopes` (m, m, facets, points) of the m
        tractions at points. Rows without a point in contact, and those that are `held` (m - 1,
        nodes), are those of the identity.
        """
        (N, W, _) = self.quadrature
        size = self.compliance.size
        m = len(slopes)
        touched = np.flatnonzero(slopes[0, 0].any(axis=1))
        weights = (W * slopes)[:, :, touched]
        # of one traction by BLAS, which is faster and adds in another order
        local = (
            np.einsum("abfp,pij->abfij", weights, self._pairs)
            if m > 1
            else weights @ self._pairs.reshape(len(N), -1)
        )
        key = (touched.tobytes(), m, np.asarray(held).tobytes())
        if key != self._entries_of:  # of neighbouring rows they are the same
            self._entries_of, self._entries = key, _entries(self.nodes[touched], size, m, held)
        rows, kept, i, j = self._entries
        n = len(rows)
        if n <= MOST_FULL:  # scipy's checks of a sparse matrix cost more than its products save
            A: Any = np.bincount(i * n + j, local.ravel()[kept], n * n).reshape(n, n)
        else:
            A = csr_matrix((local.ravel()[kept], (i, j)), shape=(n, n))  # a node has few neighbours
        among = D[np.ix_(rows, rows)]
        step = -residual
        step[rows] += A @ (D[rows] @ step - among @ step[rows])
        step[rows] = np.linalg.solve(np.eye(n) - A @ among, step[rows])
        return step

    @cached_property
    def _pairs(self) -> np.ndarray:
        """Products of the shape functions at the points of the contact quadrature (points, nodes,
        nodes).
        """
        N, _, _ = self.quadrature
        return N[:, :, None] * N[:, None, :]

    def stiffness(self) -> float:
        """d/ddelta of the sum of the nodal forces, by the tangent of the present equilibrium
        [pressure length].

        A multiplier moves with the depth, whether it is solved for or updated in a loop: F is the
        law's own either way.
        """
        if self.law.multiplier == "nodal":  # the punch on the nodes that carry a pressure
            carriers, _, _, areas, A = self._weighted
            on = np.flatnonzero(self.lam[self.places[carriers]] > 0)
            return (
                float(areas[on] @ np.linalg.solve(A[np.ix_(on, on)], areas[on])) if len(on) else 0.0
            )
        N, W, height = self.quadrature
        epsilon_n = self.law.stiffness
        D = (
            0.0 if self.law.multiplier == "none" else self.inverse_mass
        ) - epsilon_n * self.compliance.C
        active = (D @ self.F)[self.nodes] @ N.T - epsilon_n * (height - self.depth) > 0
        if not active.any():
            return 0.0
        return float(
            self.newton_step(
                -self.vector((W * epsilon_n * active) @ N), active[None, None], D
            ).sum()
        )

    @cached_property
    def _weighted(self) -> tuple[np.ndarray, ...]:
        """Nodes with an area; forces per nodal pressure Q, weighted heights, areas, compliance of
        weighted gaps.
        """
        points, weights = surface.split_quadrature(self.compliance.trace.dim)
        W, height = self.rule(points, weights)
        N = shapes(points)
        psi = pressure_functions(points)
        local = np.einsum("fp,pn,pm->fnm", W, N, psi)
        size = self.compliance.size
        places = self.nodes[:, :, None] * size + self.nodes[:, None, :]
        Q = np.bincount(places.ravel(), local.ravel(), size * size).reshape(size, size)
        heights = self.vector((W * height) @ psi)
        areas = self.vector(W @ psi)
        on = np.flatnonzero(areas > 0)
        return on, Q[:, on], heights[on], areas[on], (Q.T @ self.compliance.C @ Q)[np.ix_(on, on)]

    @property
    def weighted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of the nodes that carry a pressure the places x (n, dim - 1) [length], weighted heights,
        areas, and the compliance A: gaps heights - delta areas + A p >= 0, and areas . p is the
        force of the modelled part.
        """
        carriers, _, heights, areas, A = self._weighted
        trace = self.compliance.trace
        x = np.zeros((self.compliance.size, trace.dim - 1))
        x[trace.nodes] = trace.X[..., :-1]
        return x[carriers], heights, areas, A

    def active_set(self) -> bool:
        """Pressures p >= 0 with weighted gaps G = heights - delta areas + A p >= 0 and p G = 0,
        exactly.
        """
        carriers, Q, heights, areas, A = self._weighted
        p, solves = complementary(
            A, heights - self.depth * areas, self._set_out(self._nodal_trial() > 0)
        )
        self.iterations += solves
        self.lam = np.zeros(len(self.lam))
        self.lam[self.places[carriers]] = p
        self.forces = (Q @ p)[None]
        return True

    def _nodal_trial(self) -> np.ndarray:
        carriers, _, heights, areas, A = self._weighted
        p = self.lam[self.places[carriers]]
        scale = self.scene.physics.material.E_star / self.scene.sizes.h_contact
        return np.asarray(p - scale * ((heights - self.depth * areas + A @ p) / areas))

    @property
    def multiplier(self) -> np.ndarray:
        """lam at the nodes of the whole surface [pressure]; of a law without one the projection of
        its <p_hat>.
        """
        return self.projected(self.F) if self.law.multiplier == "none" else self.lam

    def energy(self) -> float:
        """Strain plus contact energy of the modelled part."""
        X = self.forces.ravel()
        whole = self.compliance.whole
        sunk = whole @ X
        strain = 0.5 * float(X @ sunk)
        if self.law.multiplier == "nodal":
            return strain
        N, W, height = self.quadrature
        lam = self.lam[self.places][self.nodes] @ N.T
        gap = height - self.depth + sunk[: len(self.F)][self.nodes] @ N.T
        return strain + float((W * self.law.potential(gap, lam)).sum())


def _entries(at: np.ndarray, size: int, m: int, held: Any) -> tuple[np.ndarray, ...]:
    """Rows of m tractions at nodes (facets, n) of `size`, but for those `held`; which entries of
    local matrices (m, m, facets, n, n) are between them, and in which row and column.
    """
    block = size * np.arange(m)
    is_on = np.zeros(size, dtype=bool)
    is_on[at] = True
    rows: np.ndarray = (block[:, None] + np.flatnonzero(is_on)).ravel()
    if np.size(held):
        rows = np.setdiff1d(rows, size + np.flatnonzero(held))
    place = np.full(m * size, -1)
    place[rows] = np.arange(len(rows))
    i = place[block[:, None, None, None, None] + at[:, :, None]]
    j = place[block[None, :, None, None, None] + at[:, None, :]]
    i, j = (index.ravel() for index in np.broadcast_arrays(i, j))
    kept = np.flatnonzero((i >= 0) & (j >= 0))
    return rows, kept, i[kept], j[kept]


def complementary(
    A: np.ndarray, open_gap: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, int]:
    """p >= 0 with G = open_gap + A p >= 0 and p G = 0, A symmetric positive definite, and the
    number of solves. Primal-dual active sets, beginning with `active`; when a set comes back
    they go round in a circle, and the same problem is solved as one of non-negative least
    squares, which cannot (Lawson & Hanson 1974).
    """
    seen: set[bytes] = set()
    while active.tobytes() not in seen:
        seen.add(active.tobytes())
        p = np.zeros(len(A))
        on = np.flatnonzero(active)
        p[on] = np.linalg.solve(A[np.ix_(on, on)], -open_gap[on])
        if not np.isfinite(p).all():  # what is no number would pass for a node without pressure
            break
        now = np.where(active, p, -(open_gap + A @ p)) > 0
        if np.array_equal(now, active):
            return p, len(seen)
        active = now
    from scipy.optimize import nnls  # with all of scipy's searches, which few contacts need

    L = cholesky(A, lower=True)
    p, _ = nnls(L.T, -solve_triangular(L, open_gap, lower=True), maxiter=50 * len(A))
    return p, len(seen) + 1


def _augmented_lagrangian(contact: CondensedContact) -> bool:
    def once() -> bool:
        if not contact.newton(contact.inverse_mass):
            return False
        contact.lam = contact.projected(contact.F)
        return True

    return anchored(contact.friction, contact.scene.physics.anchor, once)


def _uzawa(contact: CondensedContact) -> bool:
    return uzawa.settle(
        contact, contact.scene, MPI.COMM_SELF, lambda rtol: contact.newton(), contact.update
    )


CONDENSED_ALGORITHMS: dict[str, Callable[[CondensedContact], bool]] = {
    "none": CondensedContact.newton,
    "unknown": _augmented_lagrangian,
    "frozen": _uzawa,
    "nodal": CondensedContact.active_set,
}


class CondensedState:
    """The present state of a condensed contact, as `observe` wants to see it; the same on every
    rank.
    """

    def __init__(self, contact: CondensedContact):
        self.contact = contact
        self.scene = contact.scene
        self.comm = MPI.COMM_SELF
        self.trace = contact.compliance.trace
        self.friction = contact.friction
        self.fluid = None

    @property
    def depth(self) -> float:
        """delta [length]."""
        return self.contact.depth

    @property
    def E_star(self) -> float:
        """Plane-strain modulus of what the tip touches [pressure]: nothing of a condensed body
        takes time.
        """
        return float(self.scene.physics.material.E_star)

    def nodal_displacement(self) -> np.ndarray:
        """Displacement (facets, nodes, dim): u_z; the horizontal part has no say in a reference
        gap.
        """
        u = np.zeros(self.trace.X.shape)
        compliance = self.contact.compliance
        forces = self.contact.forces
        u[..., -1] = -(compliance.whole @ forces.ravel())[: compliance.size][self.trace.nodes]
        return u

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) [pressure]."""
        return self.contact.multiplier[self.contact.places][self.trace.nodes] @ self.basis(points).T

    def basis(self, points: np.ndarray) -> np.ndarray:
        """The multiplier's functions (points, nodes) on the reference facet."""
        is_nodal = self.scene.physics.contact.multiplier == "nodal"
        return pressure_functions(points) if is_nodal else shapes(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) as a pressure to be looked at: without its ripples at the vertices
        of triangles.
        """
        return self.nodal_pressure()[self.contact.places][self.trace.nodes] @ self.basis(points).T

    def nodal_pressure(self) -> np.ndarray:
        """Values at the nodes of the whole surface for `pressure_at` [pressure]."""
        lam = self.contact.multiplier
        nodes = self.contact.compliance.surface.nodes
        if self.scene.physics.contact.multiplier == "nodal" or not self.trace.ripples:
            return lam
        pressure = lam.copy()
        pressure[nodes] = surface.from_midpoints(
            lam[nodes], lambda v: np.bincount(nodes.ravel(), v.ravel())[nodes]
        )
        return pressure
