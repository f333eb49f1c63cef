"""Contact on a condensed body: the laws of `model.contact` on a small dense compliance matrix.

With nodal forces F (positive downwards) the gap at a quadrature point is g = f - delta + N C F. For
every contact law with a stiffness the problem is an equation in F alone,

    F = int <p_hat> N,   p_hat = lam - epsilon_n g,   lam = L2 projection of <p_hat> = M^-1 F
    (or frozen, or zero).

This is the full problem with displacement and multiplier eliminated, and both have the same
solution. Forces act on the candidate nodes only; M and lam are defined on the whole contact
surface, so that no result depends on the choice of the candidates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import isclose
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import SuperLU, splu

from indent_sim.fe.condensed.complementarity import solve_complementarity
from indent_sim.fe.condensed.compliance import Compliance, surface_mass_matrix
from indent_sim.fe.condensed.friction import NODAL_FORCE_TOLERANCE, CondensedFriction
from indent_sim.fe.condensed.placed_tip import PlacedTip
from indent_sim.fe.quadrature import contact_quadrature, split_quadrature
from indent_sim.fe.shape_functions import (
    pressure_shape_functions,
    shape_functions,
)
from indent_sim.fe.solve import uzawa
from indent_sim.fe.solve.slip_reference import solve_with_slip_reference
from indent_sim.fe.solve.stiffness_continuation import stiffness_continuation
from indent_sim.fe.surface import Trace
from indent_sim.scene.scene import Scene

# Largest number of Newton iterations with one stiffness of the contact law.
MAX_CONTACT_ITERATIONS = 100
# Largest difference of the forces on the tip and on the flat below, relative to their sum.
BALANCE_TOLERANCE = 1e-10
# Largest number of motions of the body that are tried until these forces are equal.
MAX_BALANCE_ITERATIONS = 50


class ContactState(NamedTuple):
    """State of a condensed contact on its candidate nodes.

    Attributes
    ----------
    forces
        Nodal forces (1 + horizontal axes, candidates): downwards and, with friction, along the axes
        [force].
    lam
        Multiplier at the nodes of the whole surface [pressure].
    depth
        Indentation depth [length].
    slide
        Horizontal displacement of the tip from where it was pressed in [length].
    motion
        Rigid motion of a body that rests on a flat, at which the spring is free of force [length].
    """

    forces: np.ndarray
    lam: np.ndarray
    depth: float
    slide: float
    motion: float


class CondensedContact:
    """Contact of a tip with a condensed body: solves for the nodal forces at any depth.

    Parameters
    ----------
    compliance
        The compliance of the candidate nodes.
    scene
        The scene.
    iterations
        Number of linear solves before this contact was created; the count of this contact begins at
        this number.
    """

    def __init__(self, compliance: Compliance, scene: Scene, iterations: int = 0):
        self.compliance = compliance
        self.scene = scene
        self.depth = 0.0
        # Motion of a body that rests on a flat at which the spring is free of force [length]
        self.motion = 0.0
        self.tip = PlacedTip(compliance, scene)
        self.law: Any = scene.physics.contact
        self.nodes = compliance.trace.nodes
        self.candidates = compliance.candidates
        self.iterations = iterations
        self.failure = ""  # Reason why the last solve did not converge.
        # Nodal forces (1 + horizontal axes, nodes): downwards and, with friction, along the axes
        self.forces: np.ndarray = np.zeros((1 + len(compliance.is_constrained), compliance.size))
        # Multiplier at the nodes of the whole surface [pressure]; nodal pressures of the active set
        # method
        self.lam: np.ndarray = np.zeros(1 + compliance.surface.nodes.max(initial=-1))
        self._mass_factor: SuperLU | None = None
        # Vectors of the nodal forces of the last two equilibria.
        self._recent_forces = [self.F]
        # Points that are in contact in the first iteration of the next solve
        self._predicted_active_set: np.ndarray | None = None
        # Matrix entries of the last Newton step, and the facets and number of quadrature points for
        # which they were computed.
        self._entries_key: tuple[bytes, int, bytes] | None = None
        self._entries: tuple[np.ndarray, ...] = ()
        self.friction = None if self.law.is_conservative else CondensedFriction(self)

    @property
    def F(self) -> np.ndarray:
        """Nodal forces (nodes,) into the body: downwards, on a flat below upwards [force]."""
        return self.forces[0]

    @property
    def tip_force(self) -> float:
        """Force of the model domain on the tip [force]."""
        return float(self.F[self._tip_nodes].sum())

    @cached_property
    def _tip_nodes(self) -> slice | np.ndarray:
        """The candidate nodes that the tip may touch."""
        flat = self.compliance.flat
        return slice(None) if flat is None else flat.signs > 0

    @cached_property
    def _tip_facets(self) -> float | np.ndarray:
        """1 on facets that the tip may touch and 0 on facets on a flat below, (facets, 1) or 1."""
        rests_on_flat = self.compliance.rests_on_flat
        return 1.0 if rests_on_flat is None else np.where(rests_on_flat, 0.0, 1.0)[:, None]

    @property
    def _approach(self) -> float | np.ndarray:
        """Approach of tip or flat to the body [length]: the depth, or one value per facet."""
        if self.compliance.flat is None:
            return self.depth
        return self._tip_facets * (self.depth - self.motion) + (1 - self._tip_facets) * self.motion

    @property
    def base_approach(self) -> float:
        """Motion of a body towards the flat on which it rests [length]; 0 for other bodies."""
        flat = self.compliance.flat
        return 0.0 if flat is None else self.motion + flat.spring * flat.imbalance(self.F)

    def solve(self, delta: float, slide: float = 0.0) -> bool:
        """Solve at a depth from the present forces; return False and restore them on failure.

        Parameters
        ----------
        delta
            Indentation depth [length].
        slide
            Horizontal displacement of the tip [length].
        """
        state_before = self.state
        self.depth = delta
        self.slide_tip(slide)
        if self._solve_balanced():
            self._recent_forces = [*self._recent_forces[-1:], self.F]
            return True
        self.restore(state_before)
        return False

    @property
    def state(self) -> ContactState:
        """The present state, whose arrays are replaced and never changed."""
        return ContactState(self.forces, self.lam, self.depth, self.slide, self.motion)

    def restore(self, state: ContactState) -> None:
        """Set the present state."""
        self.forces = state.forces
        self.lam = state.lam
        self.depth = state.depth
        self.motion = state.motion
        self.slide_tip(state.slide)

    def _solve_balanced(self) -> bool:
        """Solve for the contact, and for the motion of a body that rests on a flat.

        The motion at which the forces on tip and flat are equal is found by the secant method.
        """
        algorithm = CONDENSED_ALGORITHMS[self.law.multiplier]
        flat = self.compliance.flat
        if flat is None:
            return algorithm(self)
        if self.depth <= 0:
            # Without a depth no force acts on the body between tip and flat.
            self.forces = np.zeros_like(self.forces)
            self.lam = np.zeros_like(self.lam)
        if not self.F.any():
            # First guess: tip and flat each approach the body by half of the depth.
            self.motion = self.depth / 2
        previous = None
        for _ in range(MAX_BALANCE_ITERATIONS):
            if not algorithm(self):
                return False
            imbalance = flat.imbalance(self.F)
            force = float(np.abs(self.F).sum())
            earlier_force = max(float(np.abs(F).sum()) for F in self._recent_forces)
            if abs(imbalance) <= BALANCE_TOLERANCE * max(force, 1e-3 * earlier_force):
                return True
            # The imbalance decreases as the motion grows. The first step assumes that only the
            # spring is compliant; the next ones are those of the secant method.
            step = flat.spring * imbalance
            if previous is not None and imbalance != previous[1]:
                secant = (self.motion - previous[0]) / (previous[1] - imbalance)
                step = max(secant, flat.spring) * imbalance
            previous = self.motion, imbalance
            self.motion += step
        self.failure = "the forces on tip and flat do not become equal"
        return False

    @property
    def slide(self) -> float:
        """Horizontal displacement of the tip from where it was pressed in [length]."""
        return self.tip.slide

    def slide_tip(self, slide: float) -> None:
        """Place the tip at a horizontal displacement from where it was pressed in [length]."""
        if slide != self.slide:
            self.tip = PlacedTip(self.compliance, self.scene, slide)

    def accept(self) -> None:
        """Accept the present equilibrium as the start of the next increment."""
        if self.friction:
            self.friction.accept()

    def dissipation(self) -> float:
        """Return the energy dissipated in the model domain in the present increment."""
        return self.friction.dissipation() if self.friction else 0.0

    def trial_pressure(self) -> np.ndarray:
        """Return the trial pressure lam - epsilon_n g [pressure] for the present forces.

        It is evaluated at the contact quadrature points. For nodal pressures it is evaluated at the
        nodes with a pressure unknown, with E*/h_contact in place of epsilon_n.
        """
        if self.law.multiplier == "nodal":
            return self._nodal_trial_pressure()
        N, _, height = self.quadrature
        epsilon_n = self.law.stiffness
        nodal = self.lam[self.candidates] - epsilon_n * (self.compliance.C @ self.F)
        return np.asarray(nodal[self.nodes] @ N.T - epsilon_n * (height - self._approach))

    def predict_active_set(self, trial: np.ndarray) -> None:
        """Use the points with a positive trial pressure as initial active set of the next solve."""
        self._predicted_active_set = trial > 0

    def _initial_active_set(self, active: np.ndarray) -> np.ndarray:
        """Return the predicted active set, or `active` if there is none; discard the prediction."""
        predicted = self._predicted_active_set
        self._predicted_active_set = None
        return active if predicted is None else predicted

    def zero_tolerance(self, norm: Callable[[np.ndarray], np.floating]) -> float:
        """Return the norm below which nodal forces count as zero, based on the last equilibria.

        This norm is needed if a contact has opened completely, e.g. under a punch retracted to zero
        depth.
        """
        return 1e-20 * max(float(norm(F)) for F in self._recent_forces)

    def moment(self) -> float:
        """Return the moment of the nodal forces on the model domain [force length]."""
        trace = self.compliance.trace
        x = np.zeros((self.compliance.size, trace.dim - 1))
        x[trace.nodes] = trace.X[..., :-1]
        physics = self.scene.physics
        lever = physics.domain.kinematics.horizontal_position(x.T, self.tip.center)
        e, g = physics.moment_axis
        return float(self.F @ (e * lever[0] + g * lever[1]))

    def _weighted_areas(self, trace: Trace, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        x = np.moveaxis(trace.positions(points), -1, 0)
        return (
            trace.measures(points)
            * weights
            * self.scene.physics.domain.kinematics.integration_weight(x)
        )

    @property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Contact quadrature: shape functions, weighted areas and heights of the tip.

        The shapes are (points, nodes), (facets, points) and (facets, points). The heights are
        evaluated at the present position of the tip.
        """
        return *self._shapes_and_areas, self.tip.quadrature_heights

    @cached_property
    def _shapes_and_areas(self) -> tuple[np.ndarray, np.ndarray]:
        """Shape functions and weighted areas of the contact quadrature."""
        trace = self.compliance.trace
        points, weights = contact_quadrature(trace.dim)
        return shape_functions(points), self._weighted_areas(trace, points, weights)

    @cached_property
    def mass_matrix(self) -> csc_matrix:
        """Mass matrix of the shape functions on the whole contact surface [area]."""
        surface = self.compliance.surface
        points, weights = contact_quadrature(surface.dim)
        return surface_mass_matrix(surface, self._weighted_areas(surface, points, weights))

    def project(self, F: np.ndarray) -> np.ndarray:
        """Project nodal forces (n,) or (n, columns) from the candidates to the whole surface."""
        self._mass_factor = self._mass_factor or splu(self.mass_matrix)
        nodal = np.zeros((len(self.lam), *F.shape[1:]))
        nodal[self.candidates] = F
        return self._mass_factor.solve(nodal)

    @cached_property
    def inverse_mass(self) -> np.ndarray:
        """Inverse mass matrix (n, n) of the candidate nodes, from forces to pressures [1/area]."""
        return self.project(np.eye(self.compliance.size))[self.candidates]

    def assemble_vector(self, local: np.ndarray) -> np.ndarray:
        """Assemble facet vectors (facets, nodes) into a vector of the candidate nodes."""
        return np.bincount(self.nodes.ravel(), local.ravel(), self.compliance.size)

    def solve_newton(self, inverse_mass: np.ndarray | float = 0.0) -> bool:
        """Solve F = int <lam - epsilon_n g> N by a semismooth Newton method.

        A law with a multiplier is first solved with a stiffness of E*/h_contact, which gives a good
        initial guess. If the method fails, a soft contact is solved first, and its stiffness is
        then increased in steps.

        Parameters
        ----------
        inverse_mass
            M^-1 between the candidates, for lam = M^-1 F; 0 for a frozen multiplier.

        Returns
        -------
        bool
            True if the method converged.
        """
        start = self.forces
        epsilon_n = self.law.stiffness
        unit = self.scene.physics.material.E_star / self.scene.sizes.h_contact
        # The tolerance makes the choice independent of round-off in the conversion of units
        has_other_stiffness = np.ndim(inverse_mass) and not isclose(epsilon_n, unit, rel_tol=1e-9)
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
        self.failure = (
            "the set of nodes in contact did not become constant within "
            f"{MAX_CONTACT_ITERATIONS} iterations, or it recurred"
        )
        return False

    def update_multiplier(self, mixing: uzawa.Mixing) -> float:
        """Update the multiplier; return the relative difference of its old value and projection."""
        before = self.lam
        image = self.project(self.F)
        change = np.linalg.norm(image - before)
        zero_change = self.zero_tolerance(lambda F: np.linalg.norm(self.project(F)))
        self.lam = mixing(before, image)
        magnitude = max(np.linalg.norm(before), np.linalg.norm(image))
        return 0.0 if change <= zero_change else float(change / magnitude)

    def _iterate_newton(self, epsilon_n: float, inverse_mass: np.ndarray | float) -> bool:
        """Run Newton's method with the stiffness `epsilon_n`; return whether it converged."""
        N, _, height = self.quadrature
        D = inverse_mass - epsilon_n * self.compliance.C
        offset = -epsilon_n * (height - self._approach)
        if not np.ndim(inverse_mass):
            offset = offset + self.lam[self.candidates][self.nodes] @ N.T
        F: np.ndarray = self.F.copy()
        last_active = None
        visited = set()
        zero_force = self.zero_tolerance(lambda F: np.abs(F).max(initial=0.0))
        for _ in range(MAX_CONTACT_ITERATIONS):
            trial_pressure = (D @ F)[self.nodes] @ N.T + offset
            active = trial_pressure > 0
            load = self._nodal_load(trial_pressure, active)
            allowed = NODAL_FORCE_TOLERANCE * np.abs(load).max(initial=0.0) + zero_force
            # The problem is linear while the active points stay the same: the first of two such
            # Newton steps was exact.
            is_unchanged = last_active is not None and np.array_equal(active, last_active)
            residual = np.abs(F - load).max(initial=0.0)
            if not np.isfinite(residual):
                # p_hat > 0 is False for NaN, which would look like a body without contact
                return False
            if is_unchanged or residual <= allowed:
                self.forces = load[None]
                return True
            if active.tobytes() in visited:
                # The active points determine the next step, so that the iteration would repeat
                return False
            last_active = active = self._initial_active_set(active)
            visited.add(active.tobytes())
            F = F + self.newton_step(
                F - self._nodal_load(trial_pressure, active), active[None, None], D
            )
            self.iterations += 1
        return False

    def _nodal_load(self, trial_pressure: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Return the nodal forces of the trial pressure at the active points."""
        N, W = self._shapes_and_areas
        return self.assemble_vector((W * np.where(active, trial_pressure, 0.0)) @ N)

    def newton_step(
        self, residual: np.ndarray, slopes: np.ndarray, D: np.ndarray, is_constrained: Any = ()
    ) -> np.ndarray:
        """Return the Newton step -(I - A D)^-1 residual, with A = int slopes N N.

        Rows of nodes without a point in contact and of constrained nodes are identity rows.

        Parameters
        ----------
        residual
            Residual (m nodes,) of the m components of the nodal forces.
        slopes
            Derivatives (m, m, facets, points) of the m tractions with respect to the trial
            tractions.
        D
            Derivatives of the nodal trial tractions with respect to the nodal forces.
        is_constrained
            Whether a horizontal displacement is prescribed (m - 1, nodes).
        """
        N, W = self._shapes_and_areas
        size = self.compliance.size
        m = len(slopes)
        touched_facets = np.flatnonzero(slopes[0, 0].any(axis=1))
        weights = (W * slopes)[:, :, touched_facets]
        # BLAS multiplies a single traction faster, and adds in another order.
        local = (
            np.einsum("abfp,pij->abfij", weights, self._shape_products)
            if m > 1
            else weights @ self._shape_products.reshape(len(N), -1)
        )
        key = (touched_facets.tobytes(), m, np.asarray(is_constrained).tobytes())
        if key != self._entries_key:  # consecutive rows often have the same facets in contact
            self._entries_key = key
            self._entries = _local_matrix_entries(
                self.nodes[touched_facets], size, m, is_constrained
            )
        rows, entries_kept, i, j = self._entries
        n = len(rows)
        # The checks of a sparse matrix cost more than its products save up to 128 unknowns.
        if n <= 128:
            A: Any = np.bincount(i * n + j, local.ravel()[entries_kept], n * n).reshape(n, n)
        else:
            A = csr_matrix((local.ravel()[entries_kept], (i, j)), shape=(n, n))
        submatrix = D[np.ix_(rows, rows)]
        step = -residual
        step[rows] += A @ (D[rows] @ step - submatrix @ step[rows])
        step[rows] = np.linalg.solve(np.eye(n) - A @ submatrix, step[rows])
        return step

    @cached_property
    def _shape_products(self) -> np.ndarray:
        """Products N_i N_j of shape functions at the quadrature points (points, nodes, nodes)."""
        N, _ = self._shapes_and_areas
        return N[:, :, None] * N[:, None, :]

    def stiffness(self) -> float:
        """Return the derivative of the sum of the nodal forces with respect to the depth.

        It is the stiffness of the model domain [force/length], from the tangent of the present
        equilibrium. The change of the multiplier with the depth is included even if Uzawa's
        iteration updates the multiplier.
        """
        tip, from_tip = self._approach_response()
        if self.compliance.flat is None:
            return tip
        # The body moves so that the forces on tip and flat remain equal.
        from_flat, base = self._approach_response(of_flat=True)
        imbalance = tip - from_tip
        balance = tip - from_tip - from_flat + base
        return tip - imbalance / balance * (tip - from_flat) if balance else 0.0

    def _approach_response(self, *, of_flat: bool = False) -> tuple[float, float]:
        """Return the derivatives of the forces on tip and flat if one of them approaches the body.

        Parameters
        ----------
        of_flat
            True if the flat below approaches the body, False if the tip does.
        """
        if self.law.multiplier == "nodal":
            # The nodes in contact move down together, as under a flat punch
            carriers, _, areas, A, tip_areas = self._pressure_matrices
            loaded = np.flatnonzero(self.lam[self.candidates[carriers]] > 0)
            if not len(loaded):
                return 0.0, 0.0
            under_tip = tip_areas[loaded]
            on_flat = areas[loaded] - under_tip
            moved = on_flat if of_flat else under_tip
            p = np.linalg.solve(A[np.ix_(loaded, loaded)], moved)
            return float(under_tip @ p), float(on_flat @ p)
        N, W, height = self.quadrature
        epsilon_n = self.law.stiffness
        D = (
            0.0 if self.law.multiplier == "none" else self.inverse_mass
        ) - epsilon_n * self.compliance.C
        active = (D @ self.F)[self.nodes] @ N.T - epsilon_n * (height - self._approach) > 0
        if not active.any():
            return 0.0, 0.0
        facets = 1 - self._tip_facets if of_flat else self._tip_facets
        load = self.assemble_vector((W * epsilon_n * active * facets) @ N)
        forces = self.newton_step(-load, active[None, None], D)
        tip = float(forces[self._tip_nodes].sum())
        return tip, float(forces.sum()) - tip

    @cached_property
    def _pressure_matrices(self) -> tuple[np.ndarray, ...]:
        """Arrays of the equations for nodal pressures that do not depend on the tip's position.

        They are the numbers of the nodes whose area is not zero, the matrix Q of nodal forces per
        nodal pressure, the areas of these nodes, the compliance Q' C Q of the weighted gaps, and
        the parts of the areas that the tip may touch.
        """
        N = shape_functions(split_quadrature(self.compliance.trace.dim)[0])
        W, psi = self._split_areas
        local = np.einsum("fp,pn,pm->fnm", W, N, psi)
        size = self.compliance.size
        indices = self.nodes[:, :, None] * size + self.nodes[:, None, :]
        Q = np.bincount(indices.ravel(), local.ravel(), size * size).reshape(size, size)
        areas = self.assemble_vector(W @ psi)
        tip_areas = self.assemble_vector((W * self._tip_facets) @ psi)
        carriers = np.flatnonzero(areas > 0)
        return (
            carriers,
            Q[:, carriers],
            areas[carriers],
            (Q.T @ self.compliance.C @ Q)[np.ix_(carriers, carriers)],
            tip_areas[carriers],
        )

    @cached_property
    def _split_areas(self) -> tuple[np.ndarray, np.ndarray]:
        """Weighted areas and pressure shape functions of the quadrature of nodal pressures."""
        trace = self.compliance.trace
        points, weights = split_quadrature(trace.dim)
        return self._weighted_areas(trace, points, weights), pressure_shape_functions(points)

    def _weigh(self, values: np.ndarray) -> np.ndarray:
        """Return the integrals of values (facets, points) times the pressure shape functions.

        The points are those of the quadrature of nodal pressures; there is one integral for each
        node whose area is not zero.
        """
        W, psi = self._split_areas
        carriers = self._pressure_matrices[0]
        return self.assemble_vector((W * values) @ psi)[carriers]

    @property
    def weighted_gap_system(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return positions (n, dim - 1) [length], weighted heights, areas and compliance A.

        These arrays refer to the n nodes with a pressure unknown p. The weighted gaps are heights -
        delta * areas + A p >= 0, and areas . p is the force of the model domain.
        """
        carriers, _, areas, A, _ = self._pressure_matrices
        heights = self._weigh(self.tip.split_heights)
        trace = self.compliance.trace
        x = np.zeros((self.compliance.size, trace.dim - 1))
        x[trace.nodes] = trace.X[..., :-1]
        return x[carriers], heights, areas, A

    def solve_active_set(self) -> bool:
        """Solve the complementarity problem of the nodal pressures p; always return True.

        The problem is p >= 0, p G = 0 and weighted gaps G = heights - delta * areas + A p >= 0.
        """
        carriers, Q, areas, A, tip_areas = self._pressure_matrices
        heights = self._weigh(self.tip.split_heights)
        p, solves = solve_complementarity(
            A,
            heights - self._weighted_approach(areas, tip_areas),
            self._initial_active_set(self._nodal_trial_pressure() > 0),
        )
        self.iterations += solves
        self.lam = np.zeros(len(self.lam))
        self.lam[self.candidates[carriers]] = p
        self.forces = (Q @ p)[None]
        return True

    def _nodal_trial_pressure(self) -> np.ndarray:
        """Return the trial pressure at the pressure nodes, with the stiffness E*/h_contact."""
        carriers, _, areas, A, tip_areas = self._pressure_matrices
        heights = self._weigh(self.tip.split_heights)
        p = self.lam[self.candidates[carriers]]
        scale = self.scene.physics.material.E_star / self.scene.sizes.h_contact
        gaps = heights - self._weighted_approach(areas, tip_areas) + A @ p
        return np.asarray(p - scale * (gaps / areas))

    def _weighted_approach(self, areas: np.ndarray, tip_areas: np.ndarray) -> np.ndarray:
        """Return the approach of tip or flat at the pressure nodes, times their areas."""
        if self.compliance.flat is None:
            return self.depth * areas
        return (self.depth - self.motion) * tip_areas + self.motion * (areas - tip_areas)

    def side_force(self, axis: int) -> float:
        """Return the horizontal force on the tip along an axis, of the model domain [force].

        It is the force of friction. If the load path contains a slide, it includes the force of the
        pressure on the slope of the tip, which is minus the derivative of the energy with respect
        to the tip's position.
        """
        friction = 0.0 if self.friction is None else float(self.forces[1 + axis].sum())
        slope_force = self._slope_force(axis) if self.scene.physics.slides else 0.0
        return slope_force - friction

    def _slope_force(self, axis: int) -> float:
        """Return the horizontal force of the pressure on the slope of the tip [force]."""
        dim = self.compliance.trace.dim
        if self.law.multiplier == "nodal":
            points, _ = split_quadrature(dim)
            slopes = self._weigh(self.tip.height_derivatives(points, axis))
            return float(self.lam[self.candidates[self._pressure_matrices[0]]] @ slopes)
        _, W = self._shapes_and_areas
        trial_pressure = self.friction.trial_pressure() if self.friction else self.trial_pressure()
        points, _ = contact_quadrature(dim)
        slopes = self.tip.height_derivatives(points, axis)
        return float((W * np.maximum(trial_pressure, 0.0) * slopes).sum())

    @property
    def multiplier(self) -> np.ndarray:
        """Multiplier at the nodes of the whole surface [pressure].

        For a law without a multiplier it is the L2 projection of the contact pressure <p_hat>.
        """
        return self.project(self.F) if self.law.multiplier == "none" else self.lam

    def energy(self) -> float:
        """Return the strain energy plus the contact energy of the model domain."""
        X = self.forces.ravel()
        compliance_matrix = self.compliance.matrix
        displacements = compliance_matrix @ X
        strain = 0.5 * float(X @ displacements)
        if self.law.multiplier == "nodal":
            return strain
        N, W, height = self.quadrature
        lam = self.lam[self.candidates][self.nodes] @ N.T
        gap = height - self._approach + displacements[: len(self.F)][self.nodes] @ N.T
        return strain + float((W * self.law.potential(gap, lam)).sum())


def _local_matrix_entries(
    facet_nodes: np.ndarray, size: int, m: int, is_constrained: Any
) -> tuple[np.ndarray, ...]:
    """Return the positions of the entries of facet matrices in a matrix of nodes in contact.

    Parameters
    ----------
    facet_nodes
        Nodes of the touched facets (facets, n).
    size
        Number of candidate nodes.
    m
        Number of tractions.
    is_constrained
        Whether a horizontal displacement is prescribed (m - 1, nodes).

    Returns
    -------
    tuple of ndarray
        Rows of the matrix; flat indices of the entries of the local matrices (m, m, facets, n, n)
        that are assembled into it; row and column of each of these entries.
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


def _augmented_lagrangian(contact: CondensedContact) -> bool:
    """Solve by Newton's method with lam = M^-1 F eliminated; return True if it converged."""

    def solve() -> bool:
        if not contact.solve_newton(contact.inverse_mass):
            return False
        contact.lam = contact.project(contact.F)
        return True

    return solve_with_slip_reference(contact.friction, contact.scene.physics.slip_reference, solve)


def _uzawa(contact: CondensedContact) -> bool:
    """Solve by Uzawa's iteration, identically on every rank; return True if it converged."""
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
