"""Walking the load path: predict, solve, cut back, and say State after State."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil, inf
from typing import Any

import numpy as np

from indent_sim.fe.observe import measure
from indent_sim.fe.path.failure import EVEN, failed_state
from indent_sim.fe.path.load_control import LoadControl, Pair
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.uzawa import Enforcement
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

NEAR = 0.13  # of the depth: over a step up to this the contact edge moves smoothly enough for a parabola, measured
LONGEST = 0.25  # of the deepest contact's radius: a longer step into a gap at the deformed point may end elsewhere
SMALLEST_CUT = 2.0**-10  # of a requested step: what fails there fails for another reason than its size
PATIENCE = 10  # failures in a requested step: what still fails will


@dataclass(frozen=True)
class Point:
    """A converged equilibrium on the path."""

    delta: float
    state: list[Any]  # PETSc vectors


class Walk:
    """Newton along the requested depths or forces, from a predicted state, with cutback where a step is too long."""

    def __init__(self, problem: Problem, enforcement: Enforcement, started: float | None = None):
        self.problem = self.observed = problem
        self.dofs = problem.body.active_dofs
        self.enforcement = enforcement
        self.started = time.perf_counter() if started is None else started
        self._points = [Point(0.0, problem.snapshot())]  # the untouched body at rest
        self._row: Point | None = None
        self._stride = self._longest = _longest(problem.scene)  # the longest step that is tried
        self._successes = 0  # at this stride
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

        Equilibria without friction do not depend on the path, so the way is straight to the last three depths, from
        which the next one is predicted; or that of the earlier walk where it has to be. False when it is lost.
        """
        for delta, arrays in points:
            vectors = self.problem.snapshot()
            if [np.size(values) for values in arrays] != [vector.array.size for vector in vectors]:
                continue  # no checkpoint of this problem, whatever it says of itself
            for vector, values in zip(vectors, arrays, strict=True):
                vector.array[:] = values
            self._points = [*self._points[-2:], Point(delta, vectors)]
        self.return_to_last()
        self._control.know(*self._pair)
        start = self._points
        if all(self._reach(delta) for delta in deltas[-3:]):
            return True
        self._points, self._stride = start, self._longest
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
                yield failed_state(self.problem.scene, step, value, iterations, self._pair, self.started, self.failure,
                                   self.problem.least_volume_ratio())  # fmt: skip
                return
            self._row = self._last
            yield self._observe(step, iterations, substeps, wants_surface(step))

    def _press(self, force: float, step: int) -> int:
        """Find the depth of a force; the number of steps to it, 0 when it is not found."""
        before, substeps = self._points[-2:], self._substeps
        if not self._control.press(force, self.problem.scene.deltas[step - 1]):
            return 0
        self._points = [*before, self._last]  # the tries between them are too close together to extrapolate from
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
        """Step to the target in equal parts, no longer than what works; 0 when it cannot be reached."""
        smallest, failures, substeps = SMALLEST_CUT * abs(target - self._last.delta), 0, 0
        self._stride = max(self._stride, smallest)
        while failures < PATIENCE and self._stride > smallest / 2:
            begin = max(self._last.delta, min(target, 0.0))  # through the air at once
            ahead = target - begin
            parts = max(1, ceil(abs(ahead) / self._stride - 1e-9))
            goal = target if parts == 1 else begin + ahead / parts
            if self._attempt(goal):
                substeps += 1
                self._lengthen()
                if parts == 1:
                    return substeps
            else:
                failures += 1
                self._stride, self._successes = abs(ahead) / parts / 2, 0
        return 0

    def _lengthen(self) -> None:
        """Twice the stride after two successes: where one length has failed, the next step does not begin with it."""
        self._successes += 1
        if self._successes == 2:
            self._stride, self._successes = min(2 * self._stride, self._longest), 0

    def _attempt(self, delta: float) -> bool:
        """Solve at delta, first from the predicted state, then from the last one."""
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
        """Predict by the line or parabola through the last states; False where it leads nowhere."""
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
        self._points = [*self._points[-2:], Point(delta, self.problem.snapshot())]

    def _observe(self, step: int, iterations: int, substeps: int, with_surface: bool) -> State:
        problem = self.problem
        reaction, stray = problem.reactions()
        a, p_max, penetration, overlap = measure.contact(problem)
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
            overlap=overlap,
            substeps=substeps,
            surface=measure.surface(problem) if with_surface else None,
        )


def _longest(scene: Scene) -> float:
    """The longest step [length] that is tried: without limit where the gap is linear in what is sought."""
    if scene.gap == "reference":
        return inf
    return LONGEST * scene.prediction["a"] / scene.scales.length


def _leading(points: list[Point], delta: float) -> list[Point]:
    """The last points from which the path leads straight on to delta; one alone where nothing is predicted.

    Three if the step is small beside the depth; two otherwise, since the contact edge leaves kinks in the states.
    """
    step = delta - points[-1].delta
    most = 3 if abs(step) <= NEAR * abs(delta) else 2
    leading = points[-1:]
    for before, after in zip(points[-2::-1], points[:0:-1], strict=True):
        behind = after.delta - before.delta
        leads = behind != 0 and -1 < step / behind <= 2  # between the two, or not far out
        been_there = any(point.delta == before.delta for point in leading)
        if not leads or been_there or len(leading) == most:
            break
        leading = [before, *leading]
    return leading
