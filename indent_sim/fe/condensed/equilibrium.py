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
from indent_sim.fe.observe import measure
from indent_sim.fe.observe.fields import WholeBody
from indent_sim.fe.path.equilibrium import Effort, Equilibrium, reactions
from indent_sim.fe.solve.prediction import expected, shares
from indent_sim.scene.cost import MOST_CANDIDATES
from indent_sim.scene.scene import Scene

CANDIDATE_MARGIN = (
    1.0  # elements between the fine patch and the candidates' rim, which the contact must not reach
)
# elements between the expected contact and that rim at first: a node costs a solution, now or later
RIM = 3.5
RIM_GROWTH = 1.3  # and this much further when the contact comes to their rim


@dataclass(frozen=True)
class Forces:
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
        self.has_memory = scene.physics.contact.has_memory
        self.condenser = condenser or Condenser(body)
        sides = zip(scene.physics.part.extent[:-1], scene.physics.center, strict=False)
        self._whole = 1.5 * max(
            abs(end - c) for ends, c in sides for end in ends
        )  # the corners of a box
        self._iterations = 0
        self._outgrown = ""
        self._recovered = RecoveredBody(self)
        self._accepted: Forces | None = None  # the equilibrium that the present step set out from
        self._condense(min(self._expected_reach(), self._whole))

    def _expected_reach(self) -> float:
        scene = self.scene
        patch = scene.sizes.patch + CANDIDATE_MARGIN * scene.sizes.h_contact
        a = scene.plan.prediction["a"] / scene.physics.scales.length
        if (
            scene.is_of_curve or a == 0
        ):  # what is made of the curve may ask for contacts beyond the deepest one
            return patch
        return min(patch, a + RIM * scene.sizes.h_contact)

    def _condense(self, reach: float) -> None:
        self._reach = reach
        dim = self.scene.physics.part.dim
        law = self.scene.physics.contact
        axes = [dim - 1] if law.is_conservative else [dim - 1, *range(dim - 1)]
        compliance = self.condenser.condense(reach, self.scene.physics.center, axes)
        self.contact = CondensedContact(compliance, self.scene, self._iterations)
        self.view = CondensedState(self.contact)
        self._trials: list[tuple[Forces, np.ndarray]] = []
        beyond = ~np.all(np.isin(self.condenser.rows, compliance.places), axis=1)  # the candidates
        self._beside = self.body.skin.and_also(self.body.trace.at(beyond))
        trace = compliance.trace
        distance = np.linalg.norm(
            trace.X[..., :-1] - np.asarray(self.scene.physics.center)[: dim - 1], axis=-1
        )
        is_rim = (distance >= reach - 2 * self.scene.sizes.h_contact) & (reach < self._whole)
        self._rim = np.unique(trace.nodes[is_rim])  # none where there is no surface beyond

    @property
    def depth(self) -> float:
        """The present depth delta [length]."""
        return self.contact.depth

    def under(self, scene: Scene) -> CondensedEquilibrium:
        """The same body under another tip, path or method: nothing is factored again."""
        return CondensedEquilibrium(scene, self.body, self.condenser)

    @property
    def effort(self) -> Effort:
        """Dense linear solves so far."""
        return Effort(self.contact.iterations)

    @property
    def failure(self) -> str:
        """Why the last solve did not converge."""
        return self._outgrown or self.contact.failure

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""
        return self.scene.physics.part.copies * float(self.contact.F.sum())

    def sharpen(self) -> float:
        """A dense solve leaves nothing to sharpen."""
        return 1e-10

    def accept(self) -> float:
        """Take the present equilibrium as the one that the next step sets out from; what was lost
        in this [energy].
        """
        lost = self.scene.physics.part.copies * self.contact.dissipation()
        self._depart()
        return lost

    def _depart(self) -> None:
        self.contact.depart()
        self._accepted = self.snapshot()

    def solve(self, depth: float, dt: float = 0.0) -> bool:
        """Find the equilibrium at a depth from the present state; where it fails the state is as it
        was.
        """
        assert dt == 0.0  # nothing of a condensed body takes time
        contact = self.contact
        forces = contact.forces
        lam = contact.lam
        last = contact.depth
        while self.contact.solve(depth):
            if self._is_inside():
                return True
            before = _spread(contact, forces, lam, last)
            is_wider = self._widen()
            self._guess(before)  # so that no number knows the candidates
            if not is_wider:
                break
        return False

    def _widen(self) -> bool:
        """Condense to more of the surface; False where that is too much of it."""
        wider = min(RIM_GROWTH * self._reach, self._whole)
        nodes = self.condenser.candidates(wider, self.scene.physics.center) * len(
            self.contact.forces
        )
        if nodes > MOST_CANDIDATES:
            why = (
                f"the contact outgrows the {self.contact.compliance.size} nodes that the body is "
                "condensed to"
            )
            self._outgrown = f"{why}, and {nodes} are too many: use solver.method: newton"
            return False
        self._iterations = self.contact.iterations
        self._condense(wider)
        if self._accepted:
            self.restore(self._accepted)
        return True

    def _is_inside(self) -> bool:
        """Whether the forces end before the rim of the candidates (or there is no surface beyond
        it).
        """
        return not bool((np.abs(self.contact.F[self._rim]) > 0).any())

    @property
    def stiffness(self) -> float:
        """dF/ddelta of the whole body at the present equilibrium, by its tangent."""
        return self.scene.physics.part.copies * self.contact.stiffness()

    def punches(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The flat punches of an axisymmetric body; see `condensed.flat_punches`."""
        return punches(self.contact)

    def snapshot(self) -> Forces:
        """A copy of the present state."""
        contact = self.contact
        return _spread(contact, contact.forces, contact.lam, contact.depth)

    def restore(self, state: Forces) -> None:
        """Make a snapshot the present state, and the one that was accepted last."""
        self._guess(state)
        self._depart()

    def _guess(self, state: Forces) -> None:
        """Take forces as the present ones; what was accepted last stays."""
        self.contact.forces = state.nodal[:, self.contact.places]
        self.contact.lam = state.lam
        self.contact.depth = state.depth

    def predict(self, depth: float, earlier: Sequence[Forces]) -> None:
        """Take the forces that earlier states lead to expect at a depth as the present ones."""
        if self.contact.law.is_conservative:
            self.contact.expect(self._expected(earlier[-2:], depth))
        weights = shares([state.depth for state in earlier], depth)
        nodal = sum(weight * state.nodal for weight, state in zip(weights, earlier, strict=True))
        lam = sum(weight * state.lam for weight, state in zip(weights, earlier, strict=True))
        self._guess(Forces(np.asarray(nodal), np.asarray(lam), depth))

    def _expected(self, earlier: Sequence[Forces], depth: float) -> np.ndarray:
        trials = [self._trial(state) for state in earlier]
        return expected(
            trials,
            [state.depth for state in earlier],
            depth,
            max(t.max(initial=0.0) for t in trials),
        )

    def _trial(self, state: Forces) -> np.ndarray:
        """The trial pressure of an earlier state; those of the last ones are kept."""
        for known, trial in self._trials:
            if known is state:
                return trial
        self._guess(state)
        self._trials = [*self._trials[-1:], (state, self.contact.trial())]
        return self._trials[-1][1]

    def numbers(self) -> dict[str, Any]:
        """Force, contact, energy and reactions of the present equilibrium."""
        contact = self.contact
        copies = self.scene.physics.part.copies
        compliance = self.contact.compliance
        X = contact.forces.ravel()
        numbers = {"force": self.force, "energy": copies * contact.energy()}
        borne = dict(zip(self.condenser.bearing, (compliance.support @ X).tolist(), strict=True))
        numbers |= reactions(self.scene.physics.part, borne)
        numbers["stray_reaction"] = copies * float(compliance.stray @ np.abs(X))
        for name, k in self.scene.physics.sideways.items():
            numbers[f"side_force_{name}"] = 0.0 - copies * float(
                contact.forces[1 + k].sum()
            )  # no -0.0
        solution = self.condenser.beside(compliance, X)
        if solution is None:
            solution = self.observed.local_array()
        numbers["intrusion"] = measure.intrusion(self._recovered, self._beside, solution)
        return numbers | measure.contact(self.view)

    @property
    def observed(self) -> RecoveredBody:
        """The whole body, with the displacement of the present state (collective)."""
        self.condenser.recover(self.contact.compliance, self.contact.forces.ravel())
        return self._recovered


def _spread(contact: CondensedContact, forces: np.ndarray, lam: np.ndarray, depth: float) -> Forces:
    """Forces on the candidates of a contact, of all nodes of the surface."""
    nodal = np.zeros((len(forces), len(lam)))
    nodal[:, contact.places] = forces
    return Forces(nodal, lam, depth)


class RecoveredBody(WholeBody):
    """The whole body at the state that was recovered last, for the surface table and the fields."""

    def __init__(self, equilibrium: CondensedEquilibrium):
        self._equilibrium = equilibrium
        is_conservative = (
            equilibrium.scene.physics.contact.is_conservative
        )  # see `CondensedState` for the stick radius
        super().__init__(
            equilibrium.body, equilibrium.condenser.strains, None if is_conservative else self
        )

    @property
    def depth(self) -> float:
        """delta [length]."""
        return self._equilibrium.depth

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) on this rank's facets [pressure]."""
        return self._spread(self._equilibrium.contact.multiplier, points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """The same without its ripples at the vertices of triangles [pressure]."""
        return self._spread(self._equilibrium.view.nodal_pressure(), points)

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) on this rank's facets [pressure]."""
        assert self._equilibrium.contact.friction
        return np.stack(
            [self._spread(tau, points) for tau in self._equilibrium.contact.friction.tau()], axis=-1
        )

    def _spread(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        return np.asarray(
            nodal[self._equilibrium.condenser.rows] @ self._equilibrium.view.basis(points).T
        )
