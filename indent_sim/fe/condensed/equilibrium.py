"""The equilibrium of a condensed body at a depth, on candidates that grow when the contact comes to their rim."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.fe.body import Body
from indent_sim.fe.condensed.compliance import Condenser
from indent_sim.fe.condensed.contact import CondensedContact, CondensedState
from indent_sim.fe.condensed.punches import punches
from indent_sim.fe.observe import measure
from indent_sim.fe.solve.prediction import expected, shares
from indent_sim.model.state import Surface
from indent_sim.scene.cost import MOST_CANDIDATES
from indent_sim.scene.scene import Scene

MARGIN = 1.0  # elements between the fine patch and the candidates' rim, which the contact must not reach
RIM = 3.5  # elements between the expected contact and that rim at first: a node costs a solution, now or later
GROWTH = 1.3  # and this much further when the contact comes to their rim
FORCE_TOLERANCE = 1e-10  # a dense solve leaves less

# Nodal forces (axes, nodes) and multiplier (nodes,) at the nodes of the whole contact surface
Forces = tuple[np.ndarray, np.ndarray]


class CondensedEquilibrium:
    """Contact on the compliance of the candidate surface; see `path.Equilibrium`."""

    krylov_iterations = None
    force_tolerance = FORCE_TOLERANCE

    def __init__(self, scene: Scene, body: Body, condenser: Condenser | None = None):
        self.scene, self.body, self.dofs = scene, body, body.active_dofs
        self.has_memory = scene.physics.has_memory
        self.condenser = condenser or Condenser(body)
        sides = zip(scene.physics.part.extent[:-1], scene.physics.center, strict=False)
        self._whole = max(abs(end - c) for ends, c in sides for end in ends)
        self._whole *= 1.5  # the corners of a box
        self._iterations, self._outgrown = 0, ""
        self.observed = RecoveredBody(self)
        self.depth = 0.0
        self._departed: tuple[Forces, float] | None = None  # the equilibrium that the present step set out from
        self._condense(min(self._expected_reach(), self._whole))

    def _expected_reach(self) -> float:
        """How far from the tip's axis [length] nodes are candidates at first: as far as contact is expected."""
        scene = self.scene
        patch = scene.sizes.patch + MARGIN * scene.sizes.h_contact
        a = scene.plan.prediction["a"] / scene.physics.scales.length
        if scene.experiment is not None or a == 0:  # adhesion asks for contacts beyond the deepest one
            return patch
        return min(patch, a + RIM * scene.sizes.h_contact)

    def _condense(self, reach: float) -> None:
        self._reach = reach
        compliance = self.condenser.condense(reach, self.scene.physics.center, shear=self.has_memory)
        self.contact = CondensedContact(compliance, self.scene, self._iterations)
        self.view = CondensedState(self.contact, self.scene, MPI.COMM_SELF, self.depth)

    def under(self, scene: Scene) -> CondensedEquilibrium:
        """The same body under another tip, path or method: nothing is factored again."""
        return CondensedEquilibrium(scene, self.body, self.condenser)

    @property
    def iterations(self) -> int:
        """Dense linear solves so far."""
        return self.contact.iterations

    @property
    def failure(self) -> str:
        """Why the last solve did not converge."""
        return self._outgrown or self.contact.failure

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""
        return self.scene.physics.part.copies * float(self.contact.F.sum())

    def sharpen(self) -> None:
        """A dense solve leaves nothing to sharpen."""

    def depart(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        if self.contact.friction:
            self.contact.friction.depart(self.depth)
            self._departed = self.snapshot(), self.depth

    @property
    def dissipation(self) -> float:
        """What friction dissipates on the way to the present equilibrium from the one before [energy]."""
        friction = self.contact.friction
        return self.scene.physics.part.copies * friction.dissipation(self.depth) if friction else 0.0

    def solve(self, depth: float) -> bool:
        """Find the equilibrium at a depth from the present state; where it fails the state is as it was."""
        before, began = self.snapshot(), self.depth
        while self.contact.solve(depth):
            if self._is_inside():
                self.depth = self.view.depth = depth
                return True
            is_wider = self._widen()
            self.restore(before, began)  # so that no number knows the candidates
            if not is_wider:
                break
        return False

    def _widen(self) -> bool:
        """Condense to more of the surface; False where that is too much of it."""
        wider = min(GROWTH * self._reach, self._whole)
        nodes = self.condenser.candidates(wider, self.scene.physics.center) * len(self.contact.forces)
        if nodes > MOST_CANDIDATES:
            self._outgrown = (f"the contact outgrows the {self.contact.compliance.size} nodes that the body is "
                              f"condensed to, and {nodes} are too many: use solver.method: newton")  # fmt: skip
            return False
        self._iterations = self.iterations
        self._condense(wider)
        if self._departed:
            self.restore(*self._departed)
            self.depart()
        return True

    def _is_inside(self) -> bool:
        """Whether the forces end before the rim of the candidates (or there is no surface beyond it)."""
        if self._reach >= self._whole:
            return True
        trace = self.contact.compliance.trace
        distance = np.linalg.norm(trace.X[..., :-1] - np.asarray(self.scene.physics.center)[: trace.dim - 1], axis=-1)
        rim = self._reach - 2 * self.scene.sizes.h_contact
        loaded = np.abs(self.contact.F[trace.nodes]) > 0
        return bool(distance[loaded].max(initial=0.0) < rim)

    @property
    def stiffness(self) -> float:
        """dF/ddelta of the whole body at the present equilibrium, by its tangent."""
        return self.scene.physics.part.copies * self.contact.stiffness(self.depth)

    def punches(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The flat punches of an axisymmetric body; see `condensed.punches`."""
        return punches(self.contact)

    # ---- the state -----------------------------------------------------------------------------------------------

    def snapshot(self) -> Forces:
        """Nodal forces and multiplier at the nodes of the whole surface: they do not know the candidates."""
        forces = np.zeros((len(self.contact.forces), len(self.contact.lam)))
        forces[:, self.contact.places] = self.contact.forces
        return forces, self.contact.lam

    def restore(self, state: Forces, depth: float) -> None:
        """Put a state back."""
        forces, lam = state
        self.contact.forces, self.contact.lam = forces[:, self.contact.places], lam
        self.depth = self.view.depth = depth

    def pack(self, state: Forces) -> list[np.ndarray]:
        """Nothing is kept in a checkpoint: a depth costs milliseconds."""
        return []

    def unpack(self, arrays: Sequence[np.ndarray]) -> Forces:
        """The state of packed arrays."""
        forces, lam = arrays
        return forces, lam

    def predict(self, depth: float, earlier: Sequence[tuple[float, Forces]]) -> None:
        """Take what the states at earlier depths lead to expect at this one as the present state."""
        depths, states = zip(*earlier, strict=True)
        if not self.contact.friction:
            self.contact.expect(self._expected(earlier[-2:], depth))
        forces, lam = (np.tensordot(shares(depths, depth), fields, axes=1) for fields in zip(*states, strict=True))
        self.restore((forces, lam), depth)

    def _expected(self, earlier: Sequence[tuple[float, Forces]], depth: float) -> np.ndarray:
        """The trial pressure to expect at a depth from those of two states."""
        trials = []
        for before, state in earlier:
            self.restore(state, before)
            trials.append(self.contact.trial(before))
        return expected(trials, [before for before, _ in earlier], depth, max(t.max(initial=0.0) for t in trials))

    # ---- what is observed ----------------------------------------------------------------------------------------

    def numbers(self) -> dict[str, Any]:
        """Force, contact, energy and reactions of the present equilibrium."""
        contact, copies, compliance = self.contact, self.scene.physics.part.copies, self.contact.compliance
        # 0.0 - 0.0 is no -0.0
        sideways = {f"side_force_{name}": 0.0 - copies * float(contact.forces[1 + axis].sum())
                    for name, axis in self.scene.physics.sideways.items()}  # fmt: skip
        return {"force": self.force, "energy": copies * contact.energy(self.depth),
                "reaction": copies * float(compliance.support @ contact.forces.ravel()),
                "stray_reaction": copies * float(compliance.stray @ np.abs(contact.forces.ravel())),
                **sideways, **measure.contact(self.view)}  # fmt: skip

    def surface(self) -> Surface | None:
        """The surface table on rank 0, None on the others."""
        self.recover()
        return measure.surface(self.observed)

    def crushed(self) -> None:
        """A linear body has no volume ratio to speak of."""

    def recover(self) -> None:
        """Put the whole body's displacement of the present state into the body's solution."""
        self.condenser.recover(self.contact.compliance, self.contact.forces.ravel())

    def refuse_unused_options(self) -> None:
        """Nothing is passed to PETSc here."""


class RecoveredBody:
    """The whole body at the present state, for the surface table and the fields; see `CondensedEquilibrium.recover`."""

    def __init__(self, equilibrium: CondensedEquilibrium):
        body, self._equilibrium = equilibrium.body, equilibrium
        self.scene, self.comm, self.trace, self.body_mesh = body.scene, body.comm, body.trace, body.body_mesh
        self.mesh, self.unknowns, self.strains = body.mesh, body.unknowns, equilibrium.condenser.strains
        self.nodal_displacement, self.local_array = body.nodal_displacement, body.local_array

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

    def room_at(self, points: np.ndarray) -> np.ndarray:
        """The stick radius is read off the candidates alone, see `CondensedState`."""
        raise AssertionError

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) on this rank's facets [pressure]."""
        friction = self._equilibrium.contact.friction
        assert friction
        return np.stack([self._spread(tau, points) for tau in friction.tau()], axis=-1)

    def _spread(self, nodal: np.ndarray, points: np.ndarray) -> np.ndarray:
        values: Any = self._equilibrium.condenser.spread(nodal) @ self._equilibrium.view.basis(points).T
        return values
