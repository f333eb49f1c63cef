"""Equilibrium of a condensed body at a depth.

The set of candidate nodes is enlarged when the contact comes near its rim.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from indent_sim.fe.condensed.compliance import Condenser
from indent_sim.fe.condensed.condensed_state import CondensedState
from indent_sim.fe.condensed.contact import CondensedContact, ContactState
from indent_sim.fe.condensed.flat_contact import flat_contact_radius
from indent_sim.fe.condensed.flat_punches import BothContacts, punches
from indent_sim.fe.condensed.resting_body import RestingBodyCondenser
from indent_sim.fe.condensed.soft_tip import SoftTipCondenser
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.path.equilibrium import (
    Equilibrium,
    lateral_imbalance,
    moment_values,
    state_reactions,
)
from indent_sim.fe.path.solver_statistics import SolverStatistics
from indent_sim.fe.postprocessing import measurements, penetration
from indent_sim.fe.postprocessing.whole_body import WholeBody
from indent_sim.fe.solve.extrapolation import lagrange_weights, predict_trial_pressure
from indent_sim.scene.cost import MAX_CANDIDATES
from indent_sim.scene.scene import Scene

# Number of elements between the finely meshed part and the rim of the candidate nodes, which the
# contact must not reach.
CANDIDATE_MARGIN = 1.0


BodyCondenser = Condenser | SoftTipCondenser | RestingBodyCondenser


class CondensedEquilibrium(Equilibrium):
    """Contact on the compliance of the candidate nodes; implements `path.Equilibrium`.

    There is no dynamic relaxation, because adhesive tips, which may snap, are solved on the whole
    body. Checkpoints contain no states, because solving a depth takes milliseconds.

    Parameters
    ----------
    scene, body
        The scene and its discrete body.
    condenser
        The condenser of an already factored body, of a body and its soft tip, or of a body that
        rests on a flat; a new one if None.
    """

    def __init__(self, scene: Scene, body: Body, condenser: BodyCondenser | None = None):
        self.scene = scene
        self.body = body
        self.has_memory = scene.physics.contact.is_path_dependent
        self.condenser = condenser or Condenser(body)
        sides = zip(scene.physics.domain.extent[:-1], scene.sizes.axis, strict=False)
        # The factor 1.5 > sqrt(2) includes the corners of a box.
        self._largest_radius = 1.5 * max(
            abs(end - coordinate) for ends, coordinate in sides for end in ends
        )
        self._iterations = 0
        self._candidate_set_failure = ""
        self._recovered_body = RecoveredBody(self)
        # Last accepted equilibrium
        self._accepted_forces: ContactState | None = None
        self._condense(min(self._initial_radius(), self._largest_radius))

    def _initial_radius(self) -> float:
        """Return the distance from the tip's axis [length] to which the first candidates extend."""
        scene = self.scene
        patch = scene.sizes.fine_radius + CANDIDATE_MARGIN * scene.sizes.h_contact
        a = scene.plan.prediction["a"] / scene.physics.scales.length
        if scene.uses_elastic_curve or a == 0:
            # A history on the elastic curve may need larger contacts than the deepest one
            return patch
        # The candidates extend only 3.5 elements beyond the expected contact, because every
        # candidate costs a solution
        return min(patch, scene.sizes.elongation * a + 3.5 * scene.sizes.h_contact)

    def _condense(self, radius: float) -> None:
        """Condense the body to the surface nodes within a radius [length] of the tip's axis."""
        self._candidate_radius = radius
        dim = self.scene.physics.domain.dim
        law = self.scene.physics.contact
        axes = [dim - 1] if law.is_conservative else [dim - 1, *range(dim - 1)]
        compliance = self.condenser.condense(radius, self.scene.contact_track, axes)
        self.contact = CondensedContact(compliance, self.scene, self._iterations)
        self.contact_state = CondensedState(self.contact)
        self._recent_trials: list[tuple[ContactState, np.ndarray]] = []
        # Facets with a node that is no candidate
        is_outside = ~np.all(np.isin(self.condenser.facet_rows, compliance.candidates), axis=1)
        self._noncontact_trace = self.body.noncontact_trace.join(
            self.body.trace.select_facets(is_outside)
        )
        trace = compliance.tip_trace
        distance = self.scene.contact_track.distance(trace.X[..., :-1])
        is_rim = (distance >= radius - 2 * self.scene.sizes.h_contact) & (
            radius < self._largest_radius
        )
        # There are no rim nodes if the candidates include the whole contact surface
        self._rim_nodes = np.unique(trace.nodes[is_rim])

    @property
    def depth(self) -> float:
        """Present indentation depth delta [length]."""
        return self.contact.depth

    def reuse_body(self, scene: Scene) -> CondensedEquilibrium:
        """Return the equilibrium of a scene with the same body but another tip, path or method."""
        return CondensedEquilibrium(scene, self.body, self.condenser)

    @property
    def statistics(self) -> SolverStatistics:
        """Solver statistics: the number of dense linear solves since the beginning."""
        return SolverStatistics(self.contact.iterations)

    @property
    def failure(self) -> str:
        """Reason why the last solve did not converge."""
        return self._candidate_set_failure or self.contact.failure

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""
        return self.scene.physics.domain.symmetry_factor * self.contact.tip_force

    def tighten_tolerance(self) -> float:
        """Return the relative round-off error of a force; the direct solver has no tolerance."""
        return 1e-10

    def accept(self) -> float:
        """Accept the present equilibrium; return the energy dissipated in the increment."""
        dissipation = self.scene.physics.domain.symmetry_factor * self.contact.dissipation()
        self._accept_state()
        return dissipation

    def _accept_state(self) -> None:
        """Make the present state the start of the next increment."""
        self.contact.accept()
        self._accepted_forces = self.snapshot()

    def solve(self, depth: float, dt: float = 0.0, slide: float = 0.0) -> bool:
        """Solve at a depth from the present state; return False and keep the state on failure.

        The set of candidate nodes is enlarged until the contact does not reach its rim.
        """
        assert dt == 0.0  # a condensed body does not depend on time
        contact = self.contact
        state_before = contact.state
        while self.contact.solve(depth, slide):
            if self._is_contact_inside():
                return True
            forces_before = _forces_on_surface(contact, state_before)
            is_enlarged = self._enlarge_candidate_set()
            # A restart makes the result independent of the previous candidates
            self._set_trial_state(forces_before)
            if not is_enlarged:
                break
        return False

    def _enlarge_candidate_set(self) -> bool:
        """Enlarge the set of candidate nodes; return False if it would exceed MAX_CANDIDATES."""
        wider_radius = min(1.3 * self._candidate_radius, self._largest_radius)
        nodes = self.condenser.count_candidates(wider_radius, self.scene.contact_track) * len(
            self.contact.forces
        )
        if nodes > MAX_CANDIDATES:
            self._candidate_set_failure = (
                f"the contact extends beyond the {self.contact.compliance.size} surface nodes to "
                f"which the body is condensed, and the next larger set of {nodes} nodes exceeds "
                f"the limit of {MAX_CANDIDATES}; use solver.method: newton"
            )
            return False
        self._iterations = self.contact.iterations
        self._condense(wider_radius)
        if self._accepted_forces:
            self.restore(self._accepted_forces)
        return True

    def _is_contact_inside(self) -> bool:
        """Return whether the nodal forces vanish at the rim of the candidate nodes."""
        return not bool((np.abs(self.contact.F[self._rim_nodes]) > 0).any())

    @property
    def stiffness(self) -> float:
        """Stiffness dF/ddelta of the whole body at the present equilibrium [force/length]."""
        return self.scene.physics.domain.symmetry_factor * self.contact.stiffness()

    def punches(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the flat punches of an axisymmetric body; see `condensed.flat_punches`."""
        return punches(self.contact)

    def both_contacts(self) -> BothContacts:
        """Return the punches of a body that rests on a flat, at the present distributions."""
        return BothContacts(self.contact)

    def snapshot(self) -> ContactState:
        """Return a copy of the present state."""
        return _forces_on_surface(self.contact, self.contact.state)

    def restore(self, state: ContactState) -> None:
        """Set the present and the last accepted state to a snapshot."""
        self._set_trial_state(state)
        self._accept_state()

    def _set_trial_state(self, state: ContactState) -> None:
        """Set the present state without changing the last accepted state."""
        self.contact.restore(state._replace(forces=state.forces[:, self.contact.candidates]))

    def extrapolate(self, depth: float, earlier: Sequence[ContactState]) -> None:
        """Set the nodal forces to an extrapolation of earlier states to the given depth."""
        if self.contact.law.is_conservative:
            self.contact.predict_active_set(self._predicted_trial_pressure(earlier[-2:], depth))
        weights = lagrange_weights([state.depth for state in earlier], depth)
        nodal = sum(weight * state.forces for weight, state in zip(weights, earlier, strict=True))
        lam = sum(weight * state.lam for weight, state in zip(weights, earlier, strict=True))
        motion = sum(weight * state.motion for weight, state in zip(weights, earlier, strict=True))
        self._set_trial_state(
            ContactState(
                np.asarray(nodal), np.asarray(lam), depth, earlier[-1].slide, float(motion)
            )
        )

    def _predicted_trial_pressure(
        self, earlier: Sequence[ContactState], depth: float
    ) -> np.ndarray:
        """Extrapolate the trial pressure [pressure] of the last two states to the given depth."""
        trials = [self._trial_pressure(state) for state in earlier]
        return predict_trial_pressure(
            trials,
            [state.depth for state in earlier],
            depth,
            max(trial.max(initial=0.0) for trial in trials),
        )

    def _trial_pressure(self, state: ContactState) -> np.ndarray:
        """Return the trial pressure of an earlier state; the last two results are cached."""
        for cached_state, trial in self._recent_trials:
            if cached_state is state:
                return trial
        self._set_trial_state(state)
        self._recent_trials = [*self._recent_trials[-1:], (state, self.contact.trial_pressure())]
        return self._recent_trials[-1][1]

    def state_values(self) -> dict[str, Any]:
        """Return force, contact, energy and reactions of the present equilibrium."""
        contact = self.contact
        symmetry_factor = self.scene.physics.domain.symmetry_factor
        compliance = self.contact.compliance
        X = contact.forces.ravel()
        values = {"force": self.force, "energy": symmetry_factor * contact.energy()}
        support_reactions = dict(
            zip(
                self.condenser.support_surfaces,
                (compliance.support_reactions @ X).tolist(),
                strict=True,
            )
        )
        values |= state_reactions(self.scene.physics.domain, support_reactions)
        axis = self.scene.physics.track.axis
        # With a reference gap the pressure on the body is vertical
        traction = float(contact.forces[1 + axis].sum()) if contact.friction else 0.0
        values |= lateral_imbalance(self.scene, support_reactions, -symmetry_factor * traction)
        if isinstance(self.condenser, SoftTipCondenser):
            values["tip_sink"] = self.condenser.tip_sink(X)
            values["tip_energy"] = symmetry_factor * self.condenser.tip_energy(X)
        values["stray_reaction"] = symmetry_factor * float(compliance.pin_reactions @ np.abs(X))
        if flat := compliance.flat:
            values["stray_reaction"] += abs(symmetry_factor * flat.imbalance(X))
            values["base_approach"] = contact.base_approach
            values["a_base"] = flat_contact_radius(contact, values["force"])
        for name, k in self.scene.physics.side_force_axes.items():
            values[f"side_force_{name}"] = symmetry_factor * contact.side_force(k)
        if self.scene.physics.has_moment:
            values |= moment_values(symmetry_factor * contact.moment(), values["force"])
        solution = self.condenser.local_displacements(compliance, X)
        if solution is None:
            solution = self.observed_body.local_array()
        else:
            self._add_motion(solution, self.condenser.observed_dofs)
        values["intrusion"] = penetration.penetration_outside_contact_surface(
            self._recovered_body, self._noncontact_trace, solution
        )
        return values | measurements.contact_values(self.contact_state, values["force"])

    @property
    def observed_body(self) -> RecoveredBody:
        """The whole body with the displacements of the present state (collective)."""
        self.condenser.recover(self.contact.compliance, self.contact.forces.ravel())
        self._add_motion(self.body.local_array())
        return self._recovered_body

    def _add_motion(self, solution: np.ndarray, dofs: np.ndarray | None = None) -> None:
        """Add the motion of a body that rests on a flat to displacements of the pinned body.

        Only the local `dofs` are changed if they are given.
        """
        if self.contact.compliance.flat is None:
            return
        vertical = self.body.unknowns.component_dofs("u")[self.scene.physics.domain.dim - 1]
        moved = vertical if dofs is None else np.intersect1d(vertical, dofs)
        solution[moved] -= self.contact.base_approach


def _forces_on_surface(contact: CondensedContact, state: ContactState) -> ContactState:
    """Return a state with the nodal forces on all nodes of the contact surface.

    This state does not depend on the choice of the candidate nodes.
    """
    nodal = np.zeros((len(state.forces), len(state.lam)))
    nodal[:, contact.candidates] = state.forces
    return state._replace(forces=nodal)


class RecoveredBody(WholeBody):
    """Whole body with the displacements recovered from the condensed contact, for output."""

    def __init__(self, equilibrium: CondensedEquilibrium):
        self._equilibrium = equilibrium
        is_conservative = equilibrium.scene.physics.contact.is_conservative
        super().__init__(
            equilibrium.body,
            equilibrium.condenser.strain_energies,
            None if is_conservative else self,
        )

    @property
    def depth(self) -> float:
        """Indentation depth delta [length]."""
        return self._equilibrium.depth

    @property
    def tip_center(self) -> tuple[float, ...]:
        """Horizontal position of the tip's axis [length]."""
        return self._equilibrium.contact_state.tip_center

    def tip_displacement(self, r: np.ndarray) -> np.ndarray:
        """Return the displacement of a soft tip's surface towards its holder at radii [length]."""
        condenser = self._equilibrium.condenser
        if not isinstance(condenser, SoftTipCondenser):
            return super().tip_displacement(r)
        return condenser.tip_displacement(r, self._equilibrium.contact.forces.ravel())

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """Return the multiplier lam (facets, points) on this rank's facets [pressure]."""
        return self._interpolate(self._equilibrium.contact.multiplier, points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """Return the contact pressure for output (facets, points) [pressure].

        On triangles it is free of the oscillation that the multiplier has at the vertices.
        """
        return self._interpolate(self._equilibrium.contact_state.nodal_pressure(), points)

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """Return the tangential traction (facets, points, axes) on this rank's facets."""
        assert self._equilibrium.contact.friction
        return np.stack(
            [
                self._interpolate(tau, points)
                for tau in self._equilibrium.contact.friction.nodal_shear()
            ],
            axis=-1,
        )

    def _interpolate(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Interpolate values at the nodes of the whole surface to points of this rank's facets."""
        return np.asarray(
            nodal[self._equilibrium.condenser.facet_rows]
            @ self._equilibrium.contact_state.basis(points).T
        )
