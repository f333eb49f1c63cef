"""Walking the load path: predict, solve, cut back, and say State after State."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.fe import observe
from indent_sim.fe.enforce import Enforcement
from indent_sim.fe.load_control import LoadControl, Pair
from indent_sim.fe.problem import Problem
from indent_sim.model.loading import LoadPath
from indent_sim.model.materials import Gent
from indent_sim.scene import Scene
from indent_sim.state import State

SMALLEST_CUT = 2.0**-10  # of a requested step: what fails there fails for another reason than its size


EVEN = f"even in substeps of {SMALLEST_CUT:.1e} of the step"


@dataclass(frozen=True)
class Point:
    """A converged equilibrium on the path."""

    delta: float
    state: list[Any]  # PETSc vectors


class Walk:
    """Newton along the requested depths or forces, with a linear predictor, and cutback where a step is too long."""

    def __init__(self, problem: Problem, enforcement: Enforcement, started: float | None = None):
        self.problem = self.observed = problem
        self.dofs = problem.active_dofs
        self.enforcement = enforcement
        self.started = time.perf_counter() if started is None else started
        self._points = [Point(0.0, problem.snapshot())]  # the untouched body at rest
        self._row: Point | None = None
        self._substeps = 0  # so far
        self._control = LoadControl(self._go, problem.scene.body.height, enforcement.force_tolerance)

    @property
    def _last(self) -> Point:
        return self._points[-1]

    @property
    def points(self) -> list[tuple[float, list[np.ndarray]]]:
        """The last equilibria, for `resume`: depth and vectors; none on several ranks, which share them."""
        if self.problem.comm.size > 1:
            return []
        return [(point.delta, [vector.array_r.copy() for vector in point.state]) for point in self._points]

    def resume(self, points: Sequence[tuple[float, Sequence[np.ndarray]]], deltas: tuple[float, ...]) -> bool:
        """Stand where an earlier walk stood: at its `points` (or at rest), then at the last of the depths passed since.

        Equilibria without friction do not depend on the path, so the way is straight to the last two depths, from
        which the next one is predicted; or that of the earlier walk where it has to be. False when it is lost.
        """
        for delta, arrays in points:
            vectors = self.problem.snapshot()
            for vector, values in zip(vectors, arrays, strict=True):
                vector.array[:] = values
            self._points = [*self._points[-1:], Point(delta, vectors)]
        self.return_to_last()
        self._control.know(*self._pair)
        start = self._points
        if all(self._reach(delta) for delta in deltas[-2:]):
            return True
        self._points = start
        self.return_to_last()
        return all(self._reach(delta) for delta in deltas)

    @property
    def failure(self) -> str:
        """Why the last value was not reached."""
        return self._control.failure or f"{self.enforcement.failure}, {EVEN}"

    def states(self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0) -> Iterator[State]:
        """One State per requested value after the first `done`; after one that is not converged there is no other."""
        if path.control == "force":
            self.enforcement.sharpen()
        for step, value in enumerate(path.values[done:], start=done + 1):
            iterations = self.enforcement.iterations
            substeps = self._reach(value) if path.control == "depth" else self._press(value, step)
            iterations = self.enforcement.iterations - iterations
            if not substeps:
                yield failed_state(self.problem.scene, step, value, iterations, self._pair, self.started, self.failure)
                return
            self._row = self._last
            yield self._observe(step, iterations, substeps, wants_surface(step))

    def _press(self, force: float, step: int) -> int:
        """Find the depth of a force; the number of steps to it, 0 when it is not found."""
        before, substeps = self._last, self._substeps
        if not self._control.press(force, self.problem.scene.deltas[step - 1]):
            return 0
        self._points = [before, self._last]  # the tries between them are too close together to extrapolate from
        return self._substeps - substeps

    def _go(self, delta: float) -> Pair:
        """Stand at a depth, or as near to it as there is an equilibrium."""
        self._substeps += self._reach(delta)
        return self._pair

    @property
    def _pair(self) -> Pair:
        return self.problem.force(), self._last.delta

    def refuse_unused_options(self) -> None:
        """ConfigError for a `solver.petsc` option that PETSc never asked for."""
        self.enforcement.refuse_unused_options()

    def return_to_last(self) -> None:
        """Put the last equilibrium back into the problem, after a step that failed."""
        self.problem.delta.value = self._last.delta
        self.problem.restore(self._last.state)

    def return_to_row(self) -> None:
        """Put the equilibrium of the last row back: after a stop in mid-step the last one may be a substep's."""
        row = self._row or self._last
        self.problem.delta.value = row.delta
        self.problem.restore(row.state)

    def _reach(self, target: float) -> int:
        """Step to the target, halving on failure and doubling on success; 0 when it cannot be reached."""
        start = self._last.delta
        fraction, reached, substeps = 1.0, 0.0, 0
        while reached < 1.0:
            fraction = min(fraction, 1.0 - reached)
            goal = target if reached + fraction >= 1.0 else start + (target - start) * (reached + fraction)
            if self._attempt(goal):
                reached, fraction, substeps = reached + fraction, 2 * fraction, substeps + 1
            elif fraction <= SMALLEST_CUT:
                return 0
            else:
                fraction /= 2
        return substeps

    def _attempt(self, delta: float) -> bool:
        """Solve at delta, first from the extrapolated state, then from the last one."""
        self.problem.delta.value = delta
        if self._extrapolate(delta) and self.enforcement.solve():
            self._accept(delta)
            return True
        self.problem.restore(self._last.state)
        if self.enforcement.solve():
            self._accept(delta)
            return True
        self.return_to_last()
        return False

    def _extrapolate(self, delta: float) -> bool:
        """Predict by the line through the last two states; False where it leads nowhere."""
        points = _leading(self._points, delta)
        if len(points) < 2:
            return False
        guess = [vector.copy() for vector in points[-1].state]
        for vector in guess:
            vector.set(0.0)
        for point in points:
            others = [other.delta for other in points if other is not point]
            share = float(np.prod([(delta - other) / (point.delta - other) for other in others]))
            for vector, part in zip(guess, point.state, strict=True):
                vector.axpy(share, part)
        self.problem.restore(guess)
        return True

    def _accept(self, delta: float) -> None:
        self._points = [*self._points[-1:], Point(delta, self.problem.snapshot())]

    def _observe(self, step: int, iterations: int, substeps: int, with_surface: bool) -> State:
        problem = self.problem
        reaction, stray = problem.reactions()
        a, p_max, penetration = observe.contact(problem)
        return State(
            step=step,
            delta=self._last.delta,
            force=problem.force(),
            a=a,
            p_max=p_max,
            penetration=penetration,
            energy=problem.energy(),
            newton_iterations=iterations,
            wall_s=time.perf_counter() - self.started,
            reaction=reaction,
            stray_reaction=stray,
            substeps=substeps,
            surface=observe.surface(problem) if with_surface else None,
        )


def _leading(points: list[Point], delta: float) -> list[Point]:
    """The last points from which the path leads straight on to delta; one alone where a line predicts nothing."""
    if len(points) < 2:
        return points
    step, behind = delta - points[-1].delta, points[-1].delta - points[-2].delta
    leads = behind != 0 and -1 < step / behind <= 2  # between the two, or not far out
    return points if leads else points[-1:]


def failed_state(
    scene: Scene, step: int, value: float, iterations: int, last: Pair, started: float, failure: str
) -> State:
    """The State that says that and why there is none at this depth or force; last: force and depth of the last one."""
    nan, L, F = float("nan"), scene.scales.length, scene.scales.force
    law = scene.material
    limit = f"; Gent's law has no strain beyond I1 - 3 = Jm = {law.Jm:g}" if isinstance(law, Gent) else ""
    wanted, place, delta = f"delta = {value * L:.6g}", f"delta = {last[1] * L:.6g}", value
    if scene.path.control == "force":
        wanted, place, delta = f"force = {value * F:.6g}", f"{place}, force = {last[0] * F:.6g}", last[1]
    reason = (
        f"contact method {scene.contact.method} did not converge at {wanted}: {failure}; "
        f"the last equilibrium found is at {place}{limit}"
    )
    elapsed = time.perf_counter() - started
    return State(step, delta, nan, nan, nan, nan, nan, iterations, elapsed, converged=False, reason=reason)
