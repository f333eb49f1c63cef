"""The equilibrium of a condensed body at a depth, on candidates that grow when the contact comes to
their rim.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.fe.condensed.compliance import Condenser
from indent_sim.fe.condensed.contact import CondensedContact, CondensedState
from indent_sim.fe.condensed.flat_punches import punches
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.path.equilibrium import Equilibrium, SolverStatistics, state_reactions
from indent_sim.fe.postprocessing import measurements, penetration
from indent_sim.fe.postprocessing.whole_body import WholeBody
from indent_sim.fe.solve.extrapolation import lagrange_weights, predict_trial_pressure
from indent_sim.scene.cost import MAX_CANDIDATES
from indent_sim.scene.scene import Scene

CANDIDATE_MARGIN = (
    1.0  # elements between the fine patch and the candidates' rim, which the contact must not reach
)
# elements between the expected contact and that rim at first: a node costs a solution, now or later
INITIAL_RIM_DISTANCE = 3.5
RIM_GROWTH = 1.3  # and this much further when the contact comes to their rim


@dataclass(frozen=True)
class ContactForces:
    """A state: nodal forces (axes, nodes) and multiplier (nodes,) at the nodes of the whole contact
    surface, which do not know the candidates, and the depth [length].
    """

    nodal: np.ndarray
    lam: np.ndarray
    depth: float


class CondensedEquilibrium(Equilibrium):
    """Contact on the compliance of the candidate surface. No rest is looked for: a tip that
    adheres, which may snap, is solved on the whole body. Nothing is kept in a checkpoint: a
    depth costs milliseconds.
    """

    def __init__(self, scene: Scene, body: Body, condenser: Condenser | None = None):
        self.scene = scene
        self.body = body
        self.has_memory = scene.physics.contact.is_path_dependent
        self.condenser = condenser or Condenser(body)
        sides = zip(scene.physics.domain.extent[:-1], scene.physics.center, strict=False)
        self._largest_radius = 1.5 * max(
            abs(end - c) for ends, c in sides for end in ends
        )  # the corners of a box
        self._iterations = 0
        self._candidate_set_failure = ""
        self._recovered_body = RecoveredBody(self)
        self._accepted_forces: ContactForces | None = (
            None  # the equilibrium that the present step set out from
        )
        self._condense(min(self._initial_radius(), self._largest_radius))

    def _initial_radius(self) -> float:
        scene = self.scene
        patch = scene.sizes.fine_radius + CANDIDATE_MARGIN * scene.sizes.h_contact
        a = scene.plan.prediction["a"] / scene.physics.scales.length
        if (
            scene.uses_elastic_curve or a == 0
        ):  # what is made of the curve may ask for contacts beyond the deepest one
            return patch
        return min(patch, a + INITIAL_RIM_DISTANCE * scene.sizes.h_contact)

    def _condense(self, radius: float) -> None:
        self._candidate_radius = radius
        dim = self.scene.physics.domain.dim
        law = self.scene.physics.contact
        axes = [dim - 1] if law.is_conservative else [dim - 1, *range(dim - 1)]
        compliance = self.condenser.condense(radius, self.scene.physics.center, axes)
        self.contact = CondensedContact(compliance, self.scene, self._iterations)
        self.contact_state = CondensedState(self.contact)
        self._recent_trials: list[tuple[ContactForces, np.ndarray]] = []
        is_outside = ~np.all(
            np.isin(self.condenser.facet_rows, compliance.candidates), axis=1
        )  # the candidates
        self._noncontact_trace = self.body.noncontact_trace.join(
            self.body.trace.select_facets(is_outside)
        )
        trace = compliance.trace
        distance = np.linalg.norm(
            trace.X[..., :-1] - np.asarray(self.scene.physics.center)[: dim - 1], axis=-1
        )
        is_rim = (distance >= radius - 2 * self.scene.sizes.h_contact) & (
            radius < self._largest_radius
        )
        self._rim_nodes = np.unique(trace.nodes[is_rim])  # none where there is no surface beyond

    @property
    def depth(self) -> float:
        """The present depth delta [length]."""
        return self.contact.depth

    def reuse_body(self, scene: Scene) -> CondensedEquilibrium:
        """The same body under another tip, path or method: nothing is factored again."""
        return CondensedEquilibrium(scene, self.body, self.condenser)

    @property
    def statistics(self) -> SolverStatistics:
        """Dense linear solves so far."""
        return SolverStatistics(self.contact.iterations)

    @property
    def failure(self) -> str:
        """Why the last solve did not converge."""
        return self._candidate_set_failure or self.contact.failure

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""
        return self.scene.physics.domain.symmetry_factor * float(self.contact.F.sum())

    def tighten_tolerance(self) -> float:
        """A dense solve leaves nothing to sharpen."""
        return 1e-10

    def accept(self) -> float:
        """Take the present equilibrium as the one that the next step sets out from; what was lost
        in this [energy].
        """
        dissipation = self.scene.physics.domain.symmetry_factor * self.contact.dissipation()
        self._accept_state()
        return dissipation

    def _accept_state(self) -> None:
        self.contact.accept()
        self._accepted_forces = self.snapshot()

    def solve(self, depth: float, dt: float = 0.0) -> bool:
        """Find the equilibrium at a depth from the present state; where it fails the state is as it
        was.
        """
        assert dt == 0.0  # nothing of a condensed body takes time
        contact = self.contact
        forces = contact.forces
        lam = contact.lam
        last_depth = contact.depth
        while self.contact.solve(depth):
            if self._is_contact_inside():
                return True
            forces_before = _forces_on_surface(contact, forces, lam, last_depth)
            is_enlarged = self._enlarge_candidate_set()
            self._set_trial_state(forces_before)  # so that no number knows the candidates
            if not is_enlarged:
                break
        return False

    def _enlarge_candidate_set(self) -> bool:
        """Condense to more of the surface; False where that is too much of it."""
        wider_radius = min(RIM_GROWTH * self._candidate_radius, self._largest_radius)
        nodes = self.condenser.count_candidates(wider_radius, self.scene.physics.center) * len(
            self.contact.forces
        )
        if nodes > MAX_CANDIDATES:
            reason = (
                f"the contact outgrows the {self.contact.compliance.size} nodes that the body is "
                "condensed to"
            )
            self._candidate_set_failure = (
                f"{reason}, and {nodes} are too many: use solver.method: newton"
            )
            return False
        self._iterations = self.contact.iterations
        self._condense(wider_radius)
        if self._accepted_forces:
            self.restore(self._accepted_forces)
        return True

    def _is_contact_inside(self) -> bool:
        """Whether the forces end before the rim of the candidates (or there is no surface beyond
        it).
        """
        return not bool((np.abs(self.contact.F[self._rim_nodes]) > 0).any())

    @property
    def stiffness(self) -> float:
        """dF/ddelta of the whole body at the present equilibrium, by its tangent."""
        return self.scene.physics.domain.symmetry_factor * self.contact.stiffness()

    def punches(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The flat punches of an axisymmetric body; see `condensed.flat_punches`."""
        return punches(self.contact)

    def snapshot(self) -> ContactForces:
        """A copy of the present state."""
        contact = self.contact
        return _forces_on_surface(contact, contact.forces, contact.lam, contact.depth)

    def restore(self, state: ContactForces) -> None:
        """Make a snapshot the present state, and the one that was accepted last."""
        self._set_trial_state(state)
        self._accept_state()

    def _set_trial_state(self, state: ContactForces) -> None:
        """Take forces as the present ones; what was accepted last stays."""
        self.contact.forces = state.nodal[:, self.contact.candidates]
        self.contact.lam = state.lam
        self.contact.depth = state.depth

    def extrapolate(self, depth: float, earlier: Sequence[ContactForces]) -> None:
        """Take the forces that earlier states lead to expect at a depth as the present ones."""
        if self.contact.law.is_conservative:
            self.contact.predict_active_set(self._predicted_trial_pressure(earlier[-2:], depth))
        weights = lagrange_weights([state.depth for state in earlier], depth)
        nodal = sum(weight * state.nodal for weight, state in zip(weights, earlier, strict=True))
        lam = sum(weight * state.lam for weight, state in zip(weights, earlier, strict=True))
        self._set_trial_state(ContactForces(np.asarray(nodal), np.asarray(lam), depth))

    def _predicted_trial_pressure(
        self, earlier: Sequence[ContactForces], depth: float
    ) -> np.ndarray:
        trials = [self._trial_pressure(state) for state in earlier]
        return predict_trial_pressure(
            trials,
            [state.depth for state in earlier],
            depth,
            max(t.max(initial=0.0) for t in trials),
        )

    def _trial_pressure(self, state: ContactForces) -> np.ndarray:
        """The trial pressure of an earlier state; those of the last ones are kept."""
        for cached_state, trial in self._recent_trials:
            if cached_state is state:
                return trial
        self._set_trial_state(state)
        self._recent_trials = [*self._recent_trials[-1:], (state, self.contact.trial_pressure())]
        return self._recent_trials[-1][1]

    def state_values(self) -> dict[str, Any]:
        """Force, contact, energy and reactions of the present equilibrium."""
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
        values["stray_reaction"] = symmetry_factor * float(compliance.pin_reactions @ np.abs(X))
        for name, k in self.scene.physics.side_force_axes.items():
            values[f"side_force_{name}"] = 0.0 - symmetry_factor * float(
                contact.forces[1 + k].sum()
            )  # no -0.0
        solution = self.condenser.local_displacements(compliance, X)
        if solution is None:
            solution = self.observed_body.local_array()
        values["intrusion"] = penetration.penetration_outside_contact_surface(
            self._recovered_body, self._noncontact_trace, solution
        )
        return values | measurements.contact_values(self.contact_state)

    @property
    def observed_body(self) -> RecoveredBody:
        """The whole body, with the displacement of the present state (collective)."""
        self.condenser.recover(self.contact.compliance, self.contact.forces.ravel())
        return self._recovered_body


def _forces_on_surface(
    contact: CondensedContact, forces: np.ndarray, lam: np.ndarray, depth: float
) -> ContactForces:
    """Forces on the candidates of a contact, of all nodes of the surface."""
    nodal = np.zeros((len(forces), len(lam)))
    nodal[:, contact.candidates] = forces
    return ContactForces(nodal, lam, depth)


class RecoveredBody(WholeBody):
    """The whole body at the state that was recovered last, for the surface table and the fields."""

    def __init__(self, equilibrium: CondensedEquilibrium):
        self._equilibrium = equilibrium
        is_conservative = (
            equilibrium.scene.physics.contact.is_conservative
        )  # see `CondensedState` for the stick radius
        super().__init__(
            equilibrium.body,
            equilibrium.condenser.strain_energies,
            None if is_conservative else self,
        )

    @property
    def depth(self) -> float:
        """delta [length]."""
        return self._equilibrium.depth

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) on this rank's facets [pressure]."""
        return self._interpolate(self._equilibrium.contact.multiplier, points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """The same without its ripples at the vertices of triangles [pressure]."""
        return self._interpolate(self._equilibrium.contact_state.nodal_pressure(), points)

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) on this rank's facets [pressure]."""
        assert self._equilibrium.contact.friction
        return np.stack(
            [
                self._interpolate(tau, points)
                for tau in self._equilibrium.contact.friction.nodal_shear()
            ],
            axis=-1,
        )

    def _interpolate(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        return np.asarray(
            nodal[self._equilibrium.condenser.facet_rows]
            @ self._equilibrium.contact_state.basis(points).T
        )
