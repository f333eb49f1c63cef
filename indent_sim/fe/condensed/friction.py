"""Friction on a condensed body: the equations of `fe.terms.contact.friction` in nodal forces.

X = [F, T_1, ..] are the nodal forces, downwards and along the horizontal axes, and u = C X the
nodal displacements:

    F = int p N,   T_k = int t_k N,   p_hat = lam - epsilon_n g,   t_hat_k = tau_k - epsilon_t s_k,
    lam = M^-1 F,   tau_k = M_k^-1 T_k,

with the mass matrix M of the whole contact surface, and M_k that of its nodes whose displacement
along axis k is free.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import diags
from scipy.sparse.linalg import splu

from indent_sim.fe.condensed.placed_tip import PlacedTip
from indent_sim.fe.shape_functions import shape_functions
from indent_sim.model.contact import SlipReference
from indent_sim.model.contact_point import (
    CoulombPoint,
    dissipation_on_separation,
    is_new_contact,
    passed_gap,
    step_fraction_at_contact,
)

# Residual relative to the nodal forces at which Newton's method ends; a dense solve leaves less
NODAL_FORCE_TOLERANCE = 1e-12


class SurfacePoints(NamedTuple):
    """Points of the contact surface at which the trial tractions are evaluated.

    Attributes
    ----------
    N
        Shape functions (points, nodes).
    height, height_before
        Heights of the tip above the undeformed surface (facets, points), now and in the accepted
        state [length].
    """

    N: np.ndarray
    height: np.ndarray
    height_before: np.ndarray


@dataclass(frozen=True)
class AcceptedState:
    """The last accepted equilibrium.

    Attributes
    ----------
    u
        Displacements (1 + axes, nodes), downwards and along the axes, the latter relative to the
        tip [length].
    lam
        Multiplier (nodes,) [pressure].
    depth
        Indentation depth [length].
    tip
        The tip at its horizontal position.
    """

    u: np.ndarray
    lam: np.ndarray
    depth: float
    tip: PlacedTip


@dataclass(frozen=True)
class TrialTraction(CoulombPoint):
    """Pressure and trial tractions at points of the surface, for Coulomb's law.

    Attributes
    ----------
    trial_traction
        Trial traction t_hat (axes, facets, points) [pressure].
    trial_pressure
        Trial pressure p_hat (facets, points) [pressure].
    carries_traction
        Whether a point can carry a tangential traction.
    initial_gap
        Gap at the beginning of the increment, < 0 where the surface was in contact [length].
    passed_gap
        Gap traversed in the increment where the contact closed or opened, 0 elsewhere [length].
    """

    trial_traction: np.ndarray
    trial_pressure: np.ndarray
    carries_traction: np.ndarray
    initial_gap: np.ndarray
    passed_gap: np.ndarray

    @property
    def is_slipping(self) -> np.ndarray:
        """True if the trial traction exceeds the slip limit."""
        return np.asarray(self.stick_margin < 0)

    @property
    def traction(self) -> np.ndarray:
        """Tangential traction (axes, facets, points) [pressure]."""
        return np.asarray(self.carries_traction * self.traction_ratio * self.trial_traction)


class CondensedFriction:
    """Friction of a `CondensedContact`: tangential forces, last accepted state and dissipation."""

    def __init__(self, contact: Any):
        self._law = contact.law
        self._contact = contact
        self._compliance = contact.compliance
        self._node_count = contact.compliance.size
        axes = len(contact.compliance.is_constrained)
        self._is_constrained = contact.compliance.is_constrained[:, contact.candidates]
        self._accepted_state = AcceptedState(
            np.zeros((1 + axes, self._node_count)), np.zeros(self._node_count), 0.0, contact.tip
        )
        self.set_slip_reference("implicit")

    def accept(self) -> None:
        """Accept the present equilibrium as the start of the next increment."""
        self._accepted_state = AcceptedState(
            self._displacements_along_tip(),
            self._contact.lam[self._contact.candidates],
            self._contact.depth,
            self._contact.tip,
        )

    def set_slip_reference(self, slip_reference: SlipReference) -> None:
        """Set the point from which the slip of new contact points is counted.

        See `solve.slip_reference`.
        """
        self._new_contact_sticks = slip_reference != "glue"
        self._slip_start = self._accepted_state.u[1:]
        self._largest_passed_gap = 1.0
        if slip_reference == "mid":
            self._find_largest_passed_gap()
            self._slip_start = self._displacements_along_tip()[1:]

    def _find_largest_passed_gap(self) -> None:
        self._largest_passed_gap = (
            float(self._present_trial(self._contact_points()).passed_gap.max(initial=0.0)) or 1.0
        )

    def _nodal_displacements(self) -> np.ndarray:
        return (self._compliance.matrix @ self._contact.forces.ravel()).reshape(
            -1, self._node_count
        )

    def _displacements_along_tip(self) -> np.ndarray:
        """Nodal displacements [length], of which the horizontal ones are relative to the tip."""
        u = self._nodal_displacements()
        u[1:] -= self._tip_displacement[:, None]
        return u

    @property
    def _tip_displacement(self) -> np.ndarray:
        """Displacement of a sliding tip along the horizontal axes (axes,) [length]."""
        displacement = np.zeros(len(self._is_constrained))
        if slide := self._contact.slide:
            displacement[self._contact.scene.physics.track.axis] = slide
        return displacement

    def trial_pressure(self) -> np.ndarray:
        """Return the trial pressure at the contact quadrature points [pressure]."""
        return self._present_trial(self._contact_points()).trial_pressure

    def solve_newton(self, stiffness_factor: float) -> bool:
        """Solve for the nodal forces X = [int p N, int t N] by a semismooth Newton method.

        The iteration starts from the present forces. Both penalty stiffnesses of the law are
        multiplied by `stiffness_factor`. Returns True if the method converged.
        """
        contact = self._contact
        stiffnesses = np.repeat(
            [self._law.stiffness, self._law.epsilon_t],
            [self._node_count, len(self._is_constrained) * self._node_count],
        )
        D = self._inverse_masses - stiffness_factor * stiffnesses[:, None] * self._compliance.matrix
        X: np.ndarray = contact.forces.ravel()
        points = self._contact_points()
        zero_force = contact.zero_tolerance(lambda F: np.abs(F).max(initial=0.0))
        residuals = list[float]()
        visited = list[bytes]()
        for _ in range(50):
            trial = self._evaluate_trial(D @ X, points, stiffness_factor)
            load = self._nodal_loads(trial)
            residual = np.abs(X - load).max(initial=0.0)
            smallest_residual = min(residuals, default=np.inf)
            if not np.isfinite(residual):
                return False
            # Round-off may not let the residual fall any further
            allowed = 1e-10 if residual >= smallest_residual else NODAL_FORCE_TOLERANCE
            if residual <= allowed * np.abs(load).max(initial=0.0) + zero_force:
                contact.forces = load.reshape(-1, self._node_count)
                return True
            is_repeated = (pattern := self._stick_slip_pattern(trial)) in visited[:-1]
            # Stop: the states of stick and slip recur, or the last three iterations have not
            # reduced the residual.
            if residual >= smallest_residual and (
                is_repeated or residuals.index(smallest_residual) < len(residuals) - 3
            ):
                return False
            residuals = [*residuals, residual]
            visited = [*visited, pattern]
            X = X + contact.newton_step(
                X - load, self._traction_derivatives(trial), D, self._is_constrained
            )
            contact.iterations += 1
        return False

    @cached_property
    def _inverse_masses(self) -> np.ndarray:
        """Block diagonal matrix of the inverse mass matrices of the candidates [1/area]."""
        candidates = self._contact.candidates
        inverse_masses = np.zeros_like(self._compliance.matrix)
        unit = np.eye(self._node_count)
        for k, project in enumerate([self._contact.project, *self._projections]):
            block = slice(k * self._node_count, (k + 1) * self._node_count)
            inverse_masses[block, block] = project(unit)[candidates]
        return inverse_masses

    @cached_property
    def _projections(self) -> list[Callable[[np.ndarray], np.ndarray]]:
        """Functions, one for each axis, that return tau_k = M_k^-1 T_k on the whole surface."""
        return list(map(self._create_projection, self._compliance.is_constrained))

    def _create_projection(self, is_constrained: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Factor M_k and return a function that projects forces on the candidates."""
        free = diags(1.0 - is_constrained)
        factor = splu(
            (free @ self._contact.mass_matrix @ free + diags(1.0 * is_constrained)).tocsc()
        )

        def project(T: np.ndarray) -> np.ndarray:
            nodal = np.zeros((len(is_constrained), *T.shape[1:]))
            nodal[self._contact.candidates] = T
            nodal[is_constrained] = 0.0
            return np.asarray(factor.solve(nodal))

        return project

    def _contact_points(self) -> SurfacePoints:
        """Return the contact quadrature points."""
        N, _, height = self._contact.quadrature
        return SurfacePoints(N, height, self._accepted_state.tip.quadrature_heights)

    def _evaluate_trial(
        self,
        nodal: np.ndarray,
        points: SurfacePoints,
        stiffness_factor: float = 1.0,
    ) -> TrialTraction:
        """Evaluate the trial tractions at points of the contact surface.

        Parameters
        ----------
        nodal
            The part of the trial tractions (m nodes,) that is interpolated from the nodes
            [pressure]; tip height, depth and slip reference are added at the points.
        points
            The points.
        stiffness_factor
            Factor of both stiffnesses of the law.
        """
        N, height, height_before = points
        depth = self._contact.depth
        epsilon_n = stiffness_factor * self._law.stiffness
        epsilon_t = stiffness_factor * self._law.epsilon_t
        accepted = self._accepted_state
        nodes = self._contact.nodes
        trial_pressure, *t_hat = (
            values[nodes] @ N.T for values in nodal.reshape(-1, self._node_count)
        )
        trial_pressure = trial_pressure - epsilon_n * (height - depth)
        open_displacement = accepted.u[0] - accepted.lam / self._law.stiffness
        initial_gap = open_displacement[nodes] @ N.T + height_before - accepted.depth
        is_new = is_new_contact(initial_gap, depth - accepted.depth)
        passed_gap_values = np.asarray(passed_gap(initial_gap, is_new, trial_pressure, epsilon_n))
        fraction = step_fraction_at_contact(passed_gap_values, self._largest_passed_gap)
        start_pairs = zip(self._slip_start, accepted.u[1:], strict=True)
        slip_starts = [
            accepted_u[nodes] @ N.T + fraction * ((start_u - accepted_u)[nodes] @ N.T)
            for start_u, accepted_u in start_pairs
        ]
        carries_traction = (trial_pressure > 0) & (self._new_contact_sticks | (is_new == 0))
        tip_displacement = self._tip_displacement[:, None, None]
        t_hat = np.array(t_hat) + epsilon_t * (np.array(slip_starts) + tip_displacement)
        return TrialTraction(
            self._law.friction,
            np.maximum(trial_pressure, 0.0),
            t_hat,
            trial_pressure,
            carries_traction,
            initial_gap,
            passed_gap_values,
        )

    def _stick_slip_pattern(self, trial: TrialTraction) -> bytes:
        """Return the contact and slip state of all points as bytes, to detect recurring states."""
        return (trial.trial_pressure > 0).tobytes() + (
            trial.is_slipping * np.sign(trial.trial_traction)
        ).tobytes()

    def _nodal_loads(self, trial: TrialTraction) -> np.ndarray:
        """Return the nodal forces of the tractions, zero where a displacement is prescribed."""
        N, W, _ = self._contact.quadrature
        loads = np.array(
            [self._contact.assemble_vector((W * q) @ N) for q in (trial.p, *trial.traction)]
        )
        loads[1:][self._is_constrained] = 0.0
        return loads.ravel()

    def _traction_derivatives(self, trial: TrialTraction) -> np.ndarray:
        """Return d(p, t)/d(p_hat, t_hat) with shape (1 + axes, 1 + axes, facets, points)."""
        m = 1 + len(trial.trial_traction)
        slopes = np.zeros((m, m, *trial.trial_pressure.shape))
        slopes[0, 0] = trial.trial_pressure > 0
        direction = trial.trial_traction / trial.trial_magnitude
        for i, k in np.ndindex(m - 1, m - 1):
            slopes[1 + i, 1 + k] = (
                trial.carries_traction
                * trial.traction_ratio
                * ((i == k) - trial.is_slipping * direction[i] * direction[k])
            )
        if not self._law.is_bonded:
            slopes[1:, 0] = (
                trial.carries_traction * trial.is_slipping * self._law.friction * direction
            )
        return slopes

    def nodal_shear(self) -> np.ndarray:
        """Return the tangential traction (axes, nodes of the whole surface) [pressure]."""
        forces = self._contact.forces[1:]
        return np.array([project(T) for project, T in zip(self._projections, forces, strict=True)])

    def stick_margin_at(self, points: np.ndarray) -> np.ndarray:
        """Return the stick margin, slip limit minus trial traction (facets, points) [pressure].

        The margin is >= 0 at sticking points.
        """
        return np.asarray(
            self._present_trial(
                SurfacePoints(
                    shape_functions(points),
                    self._contact.tip.heights(points),
                    self._accepted_state.tip.heights(points),
                )
            ).stick_margin
        )

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """Return the tangential traction (facets, points, axes) [pressure]."""
        nodal = self.nodal_shear()[:, self._contact.candidates].T
        return self._compliance.trace.interpolate(nodal[self._contact.nodes], points)

    def dissipation(self) -> float:
        """Return the energy dissipated by slip in the model domain in the present increment."""
        law = self._law
        N, W, _ = self._contact.quadrature
        if law.is_bonded:
            return 0.0
        if is_implicit := self._contact.scene.physics.slip_reference == "implicit":
            self._find_largest_passed_gap()
        trial = self._present_trial(self._contact_points())
        displacement = (self._displacements_along_tip()[1:] - self._accepted_state.u[1:])[
            :, self._contact.nodes
        ] @ N.T
        fraction = step_fraction_at_contact(trial.passed_gap, self._largest_passed_gap)
        pressure_before = law.stiffness * np.maximum(-trial.initial_gap, 0.0)
        heat = trial.dissipation(
            trial.traction,
            (trial.trial_traction - trial.traction) / law.epsilon_t
            + is_implicit * fraction * displacement,
            pressure_before,
        )
        leaving_heat = dissipation_on_separation(
            law.friction, pressure_before, displacement, fraction
        )
        return float((W * (heat + is_implicit * (trial.trial_pressure <= 0) * leaving_heat)).sum())

    def _present_trial(self, points: SurfacePoints) -> TrialTraction:
        """Evaluate the trial tractions for the present nodal forces; see `_evaluate_trial`."""
        u = self._nodal_displacements()
        lam = self._contact.lam[self._contact.candidates]
        trial_pressure = lam - self._law.stiffness * u[0]
        t_hat = self.nodal_shear()[:, self._contact.candidates] - self._law.epsilon_t * u[1:]
        return self._evaluate_trial(np.array([trial_pressure, *t_hat]), points)
