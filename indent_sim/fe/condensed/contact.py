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
from indent_sim.fe.quadrature import contact_quadrature, split_quadrature
from indent_sim.fe.shape_functions import (
    interpolate_from_midpoints,
    pressure_shape_functions,
    shape_functions,
)
from indent_sim.fe.solve import uzawa
from indent_sim.fe.solve.newton import stiffness_continuation
from indent_sim.fe.solve.slip_reference import solve_with_slip_reference
from indent_sim.fe.surface import Trace
from indent_sim.scene.scene import Scene

# of the nodal forces of the states before: less is none, as under a punch back where it began
ZERO_FORCE_FRACTION = 1e-20
MOST_CONTACT_ITERATIONS = 100
LARGEST_DENSE = 128  # unknowns of a Newton step up to which its matrix is full


class CondensedContact:
    """A tip on a condensed body: finds the nodal forces and pressures at any depth."""

    def __init__(self, compliance: Compliance, scene: Scene, iterations: int = 0):
        self.compliance = compliance
        self.scene = scene
        self.depth = 0.0
        self.law: Any = scene.physics.contact
        self.nodes = compliance.trace.nodes
        self.candidates = compliance.candidates
        self.iterations = iterations
        self.failure = ""  # why the last solve did not converge
        # nodal forces down and, with friction, along the horizontal axes
        self.forces: np.ndarray = np.zeros((1 + len(compliance.is_constrained), compliance.size))
        # multiplier at the nodes of the whole surface (active set: nodal pressures)
        self.lam: np.ndarray = np.zeros(1 + compliance.surface.nodes.max(initial=-1))
        self._mass_factor: SuperLU | None = None
        self._recent_forces = [self.F]  # nodal forces of the last equilibria
        self._predicted_active_set: np.ndarray | None = (
            None  # which points the next solve takes to be in contact at first
        )
        self._entries_key: tuple[bytes, int, bytes] | None = None  # of the last Newton step
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
        state_before = (self.forces, self.lam, self.depth)
        self.depth = delta
        if CONDENSED_ALGORITHMS[self.law.multiplier](self):
            self._recent_forces = [*self._recent_forces[-1:], self.F]
            return True
        self.forces, self.lam, self.depth = state_before
        return False

    def accept(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        if self.friction:
            self.friction.accept()

    def dissipation(self) -> float:
        """What is lost in the step to the present state [energy], of the modelled part."""
        return self.friction.dissipation() if self.friction else 0.0

    def trial_pressure(self) -> np.ndarray:
        """lam - epsilon_n g of the present forces, above zero in contact: at the points of the
        contact quadrature, and of nodal pressures at the nodes that carry one, with E*/h_contact
        [pressure].
        """
        if self.law.multiplier == "nodal":
            return self._nodal_trial_pressure()
        N, _, height = self.quadrature
        epsilon_n = self.law.stiffness
        nodal = self.lam[self.candidates] - epsilon_n * (self.compliance.C @ self.F)
        return np.asarray(nodal[self.nodes] @ N.T - epsilon_n * (height - self.depth))

    def predict_active_set(self, trial: np.ndarray) -> None:
        """Set out from what would be in contact with this trial pressure, in the next solve."""
        self._predicted_active_set = trial > 0

    def _initial_active_set(self, active: np.ndarray) -> np.ndarray:
        """What is in contact at first: what is expected, or else what is in contact now."""
        predicted = self._predicted_active_set
        self._predicted_active_set = None
        return active if predicted is None else predicted

    def zero_tolerance(self, norm: Callable[[np.ndarray], np.floating]) -> float:
        """NOTHING of the largest size of the nodal forces in the last equilibria."""
        return ZERO_FORCE_FRACTION * max(float(norm(F)) for F in self._recent_forces)

    def quadrature_rule(
        self, points: np.ndarray, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weighted areas (facets, points) and the tip's height over the undeformed surface there."""
        trace = self.compliance.trace
        scene = self.scene
        x = np.moveaxis(trace.positions(points), -1, 0)
        horizontal = scene.physics.domain.kinematics.horizontal_position(x, scene.physics.center)
        return self._weighted_areas(trace, points, weights), scene.physics.indenter.height(
            *horizontal
        ) - x[-1]

    def _weighted_areas(self, trace: Trace, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        x = np.moveaxis(trace.positions(points), -1, 0)
        return (
            trace.measures(points)
            * weights
            * self.scene.physics.domain.kinematics.integration_weight(x)
        )

    @cached_property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shape functions (points, nodes), weighted areas and heights (facets, points) of the
        contact quadrature.
        """
        points, weights = contact_quadrature(self.compliance.trace.dim)
        return shape_functions(points), *self.quadrature_rule(points, weights)

    @cached_property
    def mass_matrix(self) -> csc_matrix:
        """The mass matrix M [area] of the whole contact surface."""
        surface_trace = self.compliance.surface
        points, weights = contact_quadrature(surface_trace.dim)
        N = shape_functions(points)
        W = self._weighted_areas(surface_trace, points, weights)
        nodes = surface_trace.nodes
        rows, columns = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
        values = np.einsum("fp,pn,pm->fnm", W, N, N).ravel()
        return csc_matrix((values, (rows.ravel(), columns.ravel())), shape=(len(self.lam),) * 2)

    def project(self, F: np.ndarray) -> np.ndarray:
        """M^-1 F on the whole surface for forces (n,) or (n, columns) on the candidates."""
        self._mass_factor = self._mass_factor or splu(self.mass_matrix)
        nodal = np.zeros((len(self.lam), *F.shape[1:]))
        nodal[self.candidates] = F
        return self._mass_factor.solve(nodal)

    @cached_property
    def inverse_mass(self) -> np.ndarray:
        """M^-1 (n, n) [1/area] between the candidates: their lam = M^-1 F."""
        return self.project(np.eye(self.compliance.size))[self.candidates]

    def assemble_vector(self, local: np.ndarray) -> np.ndarray:
        """Facet vectors (facets, nodes) summed over the nodes of the candidates."""
        return np.bincount(self.nodes.ravel(), local.ravel(), self.compliance.size)

    def solve_newton(self, inverse_mass: np.ndarray | float = 0.0) -> bool:
        """Semismooth Newton on F = int <lam - epsilon_n g> N with lam = M^-1 F, or held as it is
        where M^-1 is none. From where it stands, with a multiplier through a stiffness of
        E*/h_contact, whose solution is nearly the law's own; if that is too far, through softer
        contact to the law's own.
        """
        start = self.forces
        epsilon_n = self.law.stiffness
        unit = self.scene.physics.material.E_star / self.scene.sizes.h_contact
        has_other_stiffness = np.ndim(inverse_mass) and not isclose(
            epsilon_n, unit, rel_tol=1e-9
        )  # 1e-9: the same in all units
        solve = (
            self.friction.solve_newton
            if self.friction
            else lambda factor: self._iterate_newton(factor * epsilon_n, inverse_mass)
        )
        for factors in (
            [unit / epsilon_n, 1.0] if has_other_stiffness else [1.0],
            stiffness_continuation(self.law, self.scene),
        ):
            self.forces = start
            if all(map(solve, factors)):
                return True
        circle_reason = "or the points in contact go round in a circle"
        self.failure = (
            f"no equilibrium within {MOST_CONTACT_ITERATIONS} iterations, {circle_reason}"
        )
        return False

    def update_multiplier(self, mixing: uzawa.Mixing) -> float:
        """Change the multiplier; returns how far it was from its projection, relative to itself."""
        before = self.lam
        image = self.project(self.F)
        change = np.linalg.norm(image - before)
        zero_change = self.zero_tolerance(lambda F: np.linalg.norm(self.project(F)))
        self.lam = mixing(before, image)
        magnitude = max(np.linalg.norm(before), np.linalg.norm(image))
        return 0.0 if change <= zero_change else float(change / magnitude)

    def _iterate_newton(self, epsilon_n: float, inverse_mass: np.ndarray | float) -> bool:
        N, _, height = self.quadrature
        D = inverse_mass - epsilon_n * self.compliance.C
        offset = -epsilon_n * (height - self.depth)
        if not np.ndim(inverse_mass):
            offset = offset + self.lam[self.candidates][self.nodes] @ N.T
        F: np.ndarray = self.F.copy()
        last_active = None
        visited = set()
        zero_force = self.zero_tolerance(lambda F: np.abs(F).max(initial=0.0))
        for _ in range(MOST_CONTACT_ITERATIONS):
            trial_pressure = (D @ F)[self.nodes] @ N.T + offset
            active = trial_pressure > 0
            load = self._nodal_load(trial_pressure, active)
            allowed = NODAL_FORCE_TOLERANCE * np.abs(load).max(initial=0.0) + zero_force
            # between two Newton steps with the same active points the problem is linear: the first
            # was exact
            is_unchanged = last_active is not None and np.array_equal(active, last_active)
            residual = np.abs(F - load).max(initial=0.0)
            if not np.isfinite(
                residual
            ):  # p_hat > 0 is False for NaN: it would pass for a body without contact
                return False
            if is_unchanged or residual <= allowed:
                self.forces = load[None]
                return True
            if (
                active.tobytes() in visited
            ):  # the active points alone say where the next step leads: it is a circle
                return False
            last_active = active = self._initial_active_set(active)
            visited.add(active.tobytes())
            F = F + self.newton_step(
                F - self._nodal_load(trial_pressure, active), active[None, None], D
            )
            self.iterations += 1
        return False

    def _nodal_load(self, trial_pressure: np.ndarray, active: np.ndarray) -> np.ndarray:
        N, W, _ = self.quadrature
        return self.assemble_vector((W * np.where(active, trial_pressure, 0.0)) @ N)

    def newton_step(
        self, residual: np.ndarray, slopes: np.ndarray, D: np.ndarray, is_constrained: Any = ()
    ) -> np.ndarray:
        """-(I - A D)^-1 residual, A = int slopes N N with `slopes` (m, m, facets, points) of the m
        tractions at points. Rows without a point in contact, and those that are `is_constrained` (m - 1,
        nodes), are those of the identity.
        """
        (N, W, _) = self.quadrature
        size = self.compliance.size
        m = len(slopes)
        touched_facets = np.flatnonzero(slopes[0, 0].any(axis=1))
        weights = (W * slopes)[:, :, touched_facets]
        # of one traction by BLAS, which is faster and adds in another order
        local = (
            np.einsum("abfp,pij->abfij", weights, self._shape_products)
            if m > 1
            else weights @ self._shape_products.reshape(len(N), -1)
        )
        key = (touched_facets.tobytes(), m, np.asarray(is_constrained).tobytes())
        if key != self._entries_key:  # of neighbouring rows they are the same
            self._entries_key, self._entries = (
                key,
                _local_matrix_entries(self.nodes[touched_facets], size, m, is_constrained),
            )
        rows, entries_kept, i, j = self._entries
        n = len(rows)
        if n <= LARGEST_DENSE:  # scipy's checks of a sparse matrix cost more than its products save
            A: Any = np.bincount(i * n + j, local.ravel()[entries_kept], n * n).reshape(n, n)
        else:
            A = csr_matrix(
                (local.ravel()[entries_kept], (i, j)), shape=(n, n)
            )  # a node has few neighbours
        submatrix = D[np.ix_(rows, rows)]
        step = -residual
        step[rows] += A @ (D[rows] @ step - submatrix @ step[rows])
        step[rows] = np.linalg.solve(np.eye(n) - A @ submatrix, step[rows])
        return step

    @cached_property
    def _shape_products(self) -> np.ndarray:
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
            carriers, _, _, areas, A = self._weighted_gap_matrices
            loaded = np.flatnonzero(self.lam[self.candidates[carriers]] > 0)
            return (
                float(areas[loaded] @ np.linalg.solve(A[np.ix_(loaded, loaded)], areas[loaded]))
                if len(loaded)
                else 0.0
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
                -self.assemble_vector((W * epsilon_n * active) @ N), active[None, None], D
            ).sum()
        )

    @cached_property
    def _weighted_gap_matrices(self) -> tuple[np.ndarray, ...]:
        """Nodes with an area; forces per nodal pressure Q, weighted heights, areas, compliance of
        weighted gaps.
        """
        points, weights = split_quadrature(self.compliance.trace.dim)
        W, height = self.quadrature_rule(points, weights)
        N = shape_functions(points)
        psi = pressure_shape_functions(points)
        local = np.einsum("fp,pn,pm->fnm", W, N, psi)
        size = self.compliance.size
        indices = self.nodes[:, :, None] * size + self.nodes[:, None, :]
        Q = np.bincount(indices.ravel(), local.ravel(), size * size).reshape(size, size)
        heights = self.assemble_vector((W * height) @ psi)
        areas = self.assemble_vector(W @ psi)
        carriers = np.flatnonzero(areas > 0)
        return (
            carriers,
            Q[:, carriers],
            heights[carriers],
            areas[carriers],
            (Q.T @ self.compliance.C @ Q)[np.ix_(carriers, carriers)],
        )

    @property
    def weighted_gap_system(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of the nodes that carry a pressure the places x (n, dim - 1) [length], weighted heights,
        areas, and the compliance A: gaps heights - delta areas + A p >= 0, and areas . p is the
        force of the modelled part.
        """
        carriers, _, heights, areas, A = self._weighted_gap_matrices
        trace = self.compliance.trace
        x = np.zeros((self.compliance.size, trace.dim - 1))
        x[trace.nodes] = trace.X[..., :-1]
        return x[carriers], heights, areas, A

    def solve_active_set(self) -> bool:
        """Pressures p >= 0 with weighted gaps G = heights - delta areas + A p >= 0 and p G = 0,
        exactly.
        """
        carriers, Q, heights, areas, A = self._weighted_gap_matrices
        p, solves = solve_complementarity(
            A,
            heights - self.depth * areas,
            self._initial_active_set(self._nodal_trial_pressure() > 0),
        )
        self.iterations += solves
        self.lam = np.zeros(len(self.lam))
        self.lam[self.candidates[carriers]] = p
        self.forces = (Q @ p)[None]
        return True

    def _nodal_trial_pressure(self) -> np.ndarray:
        carriers, _, heights, areas, A = self._weighted_gap_matrices
        p = self.lam[self.candidates[carriers]]
        scale = self.scene.physics.material.E_star / self.scene.sizes.h_contact
        return np.asarray(p - scale * ((heights - self.depth * areas + A @ p) / areas))

    @property
    def multiplier(self) -> np.ndarray:
        """lam at the nodes of the whole surface [pressure]; of a law without one the projection of
        its <p_hat>.
        """
        return self.project(self.F) if self.law.multiplier == "none" else self.lam

    def energy(self) -> float:
        """Strain plus contact energy of the modelled part."""
        X = self.forces.ravel()
        compliance_matrix = self.compliance.matrix
        displacements = compliance_matrix @ X
        strain = 0.5 * float(X @ displacements)
        if self.law.multiplier == "nodal":
            return strain
        N, W, height = self.quadrature
        lam = self.lam[self.candidates][self.nodes] @ N.T
        gap = height - self.depth + displacements[: len(self.F)][self.nodes] @ N.T
        return strain + float((W * self.law.potential(gap, lam)).sum())


def _local_matrix_entries(
    facet_nodes: np.ndarray, size: int, m: int, is_constrained: Any
) -> tuple[np.ndarray, ...]:
    """Rows of m tractions at nodes (facets, n) of `size`, but for those `is_constrained`; which entries of
    local matrices (m, m, facets, n, n) are between them, and in which row and column.
    """
    block = size * np.arange(m)
    is_touched = np.zeros(size, dtype=bool)
    is_touched[facet_nodes] = True
    rows: np.ndarray = (block[:, None] + np.flatnonzero(is_touched)).ravel()
    if np.size(is_constrained):
        rows = np.setdiff1d(rows, size + np.flatnonzero(is_constrained))
    row_of_dof = np.full(m * size, -1)
    row_of_dof[rows] = np.arange(len(rows))
    i = row_of_dof[block[:, None, None, None, None] + facet_nodes[:, :, None]]
    j = row_of_dof[block[None, :, None, None, None] + facet_nodes[:, None, :]]
    i, j = (index.ravel() for index in np.broadcast_arrays(i, j))
    is_kept = np.flatnonzero((i >= 0) & (j >= 0))
    return rows, is_kept, i[is_kept], j[is_kept]


def solve_complementarity(
    A: np.ndarray, open_gap: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, int]:
    """p >= 0 with G = open_gap + A p >= 0 and p G = 0, A symmetric positive definite, and the
    number of solves. Primal-dual active sets, beginning with `active`; when a set comes back
    they go round in a circle, and the same problem is solved as one of non-negative least
    squares, which cannot (Lawson & Hanson 1974).
    """
    visited: set[bytes] = set()
    while active.tobytes() not in visited:
        visited.add(active.tobytes())
        p = np.zeros(len(A))
        active_nodes = np.flatnonzero(active)
        p[active_nodes] = np.linalg.solve(
            A[np.ix_(active_nodes, active_nodes)], -open_gap[active_nodes]
        )
        if not np.isfinite(p).all():  # what is no number would pass for a node without pressure
            break
        next_active = np.where(active, p, -(open_gap + A @ p)) > 0
        if np.array_equal(next_active, active):
            return p, len(visited)
        active = next_active
    from scipy.optimize import nnls  # with all of scipy's searches, which few contacts need

    L = cholesky(A, lower=True)
    p, _ = nnls(L.T, -solve_triangular(L, open_gap, lower=True), maxiter=50 * len(A))
    return p, len(visited) + 1


def _augmented_lagrangian(contact: CondensedContact) -> bool:
    def once() -> bool:
        if not contact.solve_newton(contact.inverse_mass):
            return False
        contact.lam = contact.project(contact.F)
        return True

    return solve_with_slip_reference(contact.friction, contact.scene.physics.slip_reference, once)


def _uzawa(contact: CondensedContact) -> bool:
    return uzawa.iterate(
        contact,
        contact.scene,
        MPI.COMM_SELF,
        lambda rtol: contact.solve_newton(),
        contact.update_multiplier,
    )


CONDENSED_ALGORITHMS: dict[str, Callable[[CondensedContact], bool]] = {
    "none": CondensedContact.solve_newton,
    "unknown": _augmented_lagrangian,
    "frozen": _uzawa,
    "nodal": CondensedContact.solve_active_set,
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
        u[..., -1] = -(compliance.matrix @ forces.ravel())[: compliance.size][self.trace.nodes]
        return u

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) [pressure]."""
        return (
            self.contact.multiplier[self.contact.candidates][self.trace.nodes]
            @ self.basis(points).T
        )

    def basis(self, points: np.ndarray) -> np.ndarray:
        """The multiplier's functions (points, nodes) on the reference facet."""
        is_nodal = self.scene.physics.contact.multiplier == "nodal"
        return pressure_shape_functions(points) if is_nodal else shape_functions(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) as a pressure to be looked at: without its ripples at the vertices
        of triangles.
        """
        return (
            self.nodal_pressure()[self.contact.candidates][self.trace.nodes] @ self.basis(points).T
        )

    def nodal_pressure(self) -> np.ndarray:
        """Values at the nodes of the whole surface for `pressure_at` [pressure]."""
        lam = self.contact.multiplier
        nodes = self.contact.compliance.surface.nodes
        if self.scene.physics.contact.multiplier == "nodal" or not self.trace.has_ripples:
            return lam
        pressure = lam.copy()
        pressure[nodes] = interpolate_from_midpoints(
            lam[nodes], lambda v: np.bincount(nodes.ravel(), v.ravel())[nodes]
        )
        return pressure
