"""The load path of a condensed body: same States as `path.Walk`, from small dense solves."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.fe.body import Body
from indent_sim.fe.condensed.compliance import Condenser
from indent_sim.fe.condensed.contact import CondensedContact, CondensedState
from indent_sim.fe.observe import measure
from indent_sim.fe.path.failure import EVEN, failed_state
from indent_sim.fe.path.load_control import LoadControl, Pair
from indent_sim.fe.path.walk import PATIENCE, SMALLEST_CUT
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import State
from indent_sim.scene.cost import MOST_CANDIDATES
from indent_sim.scene.scene import Scene

MARGIN = 1.0  # elements between the fine patch and the candidates' rim, which the contact must not reach
GROWTH = 1.6  # and this much further when the contact comes to their rim


class CondensedWalk:
    """Contact on the compliance of the candidate surface, which grows when the contact comes to its rim."""

    def __init__(self, scene: Scene, body: Body, started: float | None = None, condenser: Condenser | None = None):
        self.scene, self.body = scene, body
        self.dofs = body.active_dofs
        self.started = time.perf_counter() if started is None else started
        self.condenser = condenser or Condenser(body)
        self._whole = max(abs(end - c) for ends, c in zip(scene.extent, scene.center, strict=False) for end in ends)
        self._whole *= 1.5  # the corners of a box
        self._depth, self._solves, self._outgrown = 0.0, 0, ""
        self._control = LoadControl(self._go, scene.body.height)
        self.observed = RecoveredBody(self)
        self._condense(min(scene.sizes.patch + MARGIN * scene.sizes.h_contact, self._whole))

    def _condense(self, reach: float) -> None:
        self._reach_of_candidates = reach
        compliance = self.condenser.condense(reach, self.scene.center)
        self.contact = CondensedContact(compliance, self.scene, self._solves)
        self.view = CondensedState(self.contact, self.scene, MPI.COMM_SELF, self._depth)

    def under(self, scene: Scene) -> CondensedWalk:
        """The same body under another tip, path or method: nothing is factored again."""
        return CondensedWalk(scene, self.body, condenser=self.condenser)

    def refuse_unused_options(self) -> None:
        """Nothing is passed to PETSc here."""

    @property
    def points(self) -> list[Any]:
        """None are kept: a depth costs milliseconds."""
        return []

    def resume(self, points: Sequence[Any], deltas: tuple[float, ...]) -> bool:
        """Stand at the last of the depths an earlier walk passed; its deepest one says how wide the candidates are."""
        for delta in (max(deltas), deltas[-1]) if deltas else ():
            if not self._solve(delta):
                return False
            self._depth = self.view.depth = delta
            self._control.know(*self._pair)
        return True

    @property
    def failure(self) -> str:
        """Why the last value was not reached."""
        return self._outgrown or self._control.failure or f"{self.contact.failure}, {EVEN}"

    def states(self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0) -> Iterator[State]:
        """One State per requested value after the first `done`; after one that is not converged there is no other."""
        for step, value in enumerate(path.values[done:], start=done + 1):
            before = self._solves
            if not (self._stand_at(value) if path.control == "depth" else self._press(value, step)):
                solves = self._solves - before
                yield failed_state(self.scene, step, value, solves, self._pair, self.started, self.failure)
                return
            yield self._observe(step, self._solves - before, wants_surface(step))

    def _stand_at(self, delta: float) -> bool:
        if not self._solve(delta):
            return False
        self._depth = self.view.depth = delta
        return True

    def _press(self, force: float, step: int) -> bool:
        return self._control.press(force, self.scene.deltas[step - 1])

    def _go(self, delta: float) -> Pair:
        self._stand_at(delta)
        return self._pair

    @property
    def _pair(self) -> Pair:
        return self.scene.copies * float(self.contact.F.sum()), self.contact.depth

    def _solve(self, delta: float) -> bool:
        while True:
            solved = self.contact.solve(delta) or self._creep(delta)
            self._solves = self.contact.iterations
            if not solved:
                return False
            if self._inside():
                return True
            wider = min(GROWTH * self._reach_of_candidates, self._whole)
            if (nodes := self.condenser.candidates(wider, self.scene.center)) > MOST_CANDIDATES:
                self._outgrown = (f"the contact outgrows the {self.contact.compliance.size} nodes that the body is "
                                  f"condensed to, and {nodes} are too many: use solver.method: newton")  # fmt: skip
                self.contact.solve(self._depth)  # back to the last contact that they hold
                return False
            self._condense(wider)

    def _creep(self, delta: float) -> bool:
        """Reach a depth in substeps from the last one, halving them as long as they fail."""
        start, reached, fraction = self._depth, 0.0, 0.5
        failures = 0
        while reached < 1.0 and fraction >= SMALLEST_CUT and failures < PATIENCE:
            fraction = min(fraction, 1.0 - reached)
            if self.contact.solve(start + (delta - start) * (reached + fraction)):
                reached, fraction = reached + fraction, 2 * fraction
            else:
                fraction, failures = fraction / 2, failures + 1
        return reached >= 1.0

    def _inside(self) -> bool:
        """Whether the forces end before the rim of the candidates (or there is no surface beyond it)."""
        if self._reach_of_candidates >= self._whole:
            return True
        trace = self.contact.compliance.trace
        distance = np.linalg.norm(trace.X[..., :-1] - np.asarray(self.scene.center)[: trace.dim - 1], axis=-1)
        rim = self._reach_of_candidates - 2 * self.scene.sizes.h_contact
        loaded = np.abs(self.contact.F[trace.nodes]) > 0
        return bool(distance[loaded].max(initial=0.0) < rim)

    def _observe(self, step: int, iterations: int, with_surface: bool) -> State:
        contact, copies, delta = self.contact, self.scene.copies, self._depth
        a, p_max, penetration, overlap = measure.contact(self.view)
        compliance = contact.compliance
        return State(
            step=step,
            delta=delta,
            force=copies * float(contact.F.sum()),
            a=a,
            p_max=p_max,
            penetration=penetration,
            energy=copies * contact.energy(delta),
            newton_iterations=iterations,
            wall_s=time.perf_counter() - self.started,
            reaction=copies * float(compliance.support @ contact.F),
            stray_reaction=copies * float(compliance.stray @ np.abs(contact.F)),
            overlap=overlap,
            surface=self._surface() if with_surface else None,
        )

    def _surface(self) -> Any:
        self.return_to_row()
        return measure.surface(self.observed)

    def return_to_row(self) -> None:
        """Put the whole body's displacement of the present state into the body's solution."""
        self.condenser.recover(self.contact.F)


class RecoveredBody:
    """The whole body at the present state, for the surface table and the fields; see `return_to_row`."""

    def __init__(self, walk: CondensedWalk):
        body, self._walk = walk.body, walk
        self.scene, self.comm, self.trace, self.body_mesh = body.scene, body.comm, body.trace, body.body_mesh
        self.mesh, self.unknowns, self.stress = body.mesh, body.unknowns, walk.condenser.strain.stress
        self.nodal_displacement, self.local_array = body.nodal_displacement, body.local_array

    @property
    def depth(self) -> float:
        """delta [length]."""
        return self._walk.view.depth

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) on this rank's facets [pressure]."""
        return self._walk.condenser.spread(self._walk.contact.multiplier) @ self._walk.view.basis(points).T

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """The same without its ripples at the vertices of triangles [pressure]."""
        return self._walk.condenser.spread(self._walk.view.nodal_pressure()) @ self._walk.view.basis(points).T
