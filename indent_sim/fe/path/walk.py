"""Walking the load path: predict, solve, cut back, and say State after State."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from indent_sim.fe.path.equilibrium import Equilibrium
from indent_sim.fe.path.failure import EVEN, failed_state
from indent_sim.fe.path.load_control import LoadControl, Pair
from indent_sim.fe.path.steps import StepRule
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

NEAR = 0.13  # of the depth: over a step up to this the contact edge moves smoothly enough for a parabola, measured
# Ranges of an attraction: how far away a tip that adheres sets out (6e-6 of what it feels at first touch); its longest
# step; and the longest one over which it may snap in or let go. Over a longer one Newton may end in the other of two
# stable states: measured at Maugis' lambda 2, it let go too early in a step of five ranges.
FAR, LONG, JUMP = 12.0, 4.0, 0.25
LONGEST = 0.25  # of the deepest contact's radius: a longer step into a gap at the deformed point may end elsewhere


@dataclass(frozen=True)
class Point:
    """An equilibrium on the path."""

    delta: float
    state: Any
    dissipated: float = 0.0  # on the path to it [energy]
    touches: bool = False  # asked for only where the tip adheres


class Walk:
    """Equilibria along the requested depths or forces: predicted, solved, and cut back where a step is too long."""

    def __init__(self, equilibrium: Equilibrium, started: float | None = None):
        self.equilibrium = equilibrium
        physics = equilibrium.scene.physics
        self._adheres, self._drags = physics.adheres, physics.has_friction
        self._range = (physics.contact.adhesion.range or 0.0) if physics.contact.adhesion else 0.0
        self.started = time.perf_counter() if started is None else started
        outset = -FAR * self._range if self._adheres else 0.0
        self._points = [Point(outset, equilibrium.snapshot())]  # the untouched body at rest
        self._row = self._untouched = self._points[0]
        self._before = self._points  # the search for a force
        self._steps = self._step_rule()
        self._substeps = 0  # so far
        self._control = LoadControl(self._go, equilibrium.scene.physics.body.height, equilibrium.force_tolerance,
                                    from_row=equilibrium.has_memory)  # fmt: skip

    def _step_rule(self) -> StepRule:
        """Of a path on which nothing has failed yet; a tip that adheres is felt before it touches."""
        longest = _longest(self.equilibrium.scene)
        if not self._adheres:
            return StepRule(longest)
        return StepRule(min(longest, LONG * self._range), self._untouched.delta, JUMP / 4 * self._range)

    @property
    def _last(self) -> Point:
        return self._points[-1]

    @property
    def points(self) -> list[tuple[float, list[np.ndarray]]]:
        """The last equilibria, for `resume`: depth and arrays; with friction that of the last row, on its own path."""
        points = [self._row] if self._drags else self._points
        packed = [(point.delta, self.equilibrium.pack(point.state)) for point in points]
        return [(delta, arrays) for delta, arrays in packed if arrays]

    def resume(self, points: Sequence[tuple[float, Sequence[np.ndarray]]], deltas: tuple[float, ...]) -> bool:
        """Stand where an earlier walk stood: at its `points` (or at rest), then at the last of the depths passed since.

        An equilibrium without memory does not depend on the path, so the way is straight to the last three depths,
        from which the next one is predicted; or that of the earlier walk where it has to be. False when it is lost.
        """
        kept = [Point(delta, state) for delta, arrays in points if (state := self.equilibrium.unpack(arrays))]
        self._points = kept if kept and self._adheres else [*self._points, *kept][-3:]
        self.return_to_last()
        self._points[-1] = replace(self._last, touches=self._touches)
        self._control.know(*self._pair)
        start, has_memory = self._points, self.equilibrium.has_memory
        if not has_memory and all(self._reach(delta) for delta in deltas[-3:]):
            return True
        self._points, self._steps = start, self._step_rule()
        self.return_to_last()
        is_there = all(self._reach(delta) for delta in deltas)
        self._row = self._last
        return is_there

    @property
    def failure(self) -> str:
        """Why the last value was not reached."""
        return self._control.failure or f"{self.equilibrium.failure}, {EVEN}"

    def states(self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0) -> Iterator[State]:
        """One State per requested value after the first `done`; after one that is not converged there is no other."""
        body = self.equilibrium
        if path.control == "force":
            body.sharpen()
            if self._adheres:
                self._before = self._points
                self._control.begin()
        for step, value in enumerate(path.values[done:], start=done + 1):
            iterations, krylov = body.iterations, body.krylov_iterations
            substeps = self._reach(value) if path.control == "depth" else self._press(value, step)
            iterations = body.iterations - iterations
            if krylov is not None and body.krylov_iterations is not None:
                krylov = body.krylov_iterations - krylov
            if not substeps:
                yield failed_state(body.scene, step, value, iterations, self._pair, self.started, self.failure,
                                   body.crushed())  # fmt: skip
                return
            dissipated, self._row = self._last.dissipated - self._row.dissipated, self._last
            surface = body.surface() if wants_surface(step) else None
            yield State(step=step, delta=self._last.delta, newton_iterations=iterations, krylov_iterations=krylov,
                        substeps=substeps, dissipation=dissipated if self._drags else None,
                        wall_s=time.perf_counter() - self.started, surface=surface, **body.numbers())  # fmt: skip

    def _press(self, force: float, step: int) -> int:
        """Find the depth of a force; the number of steps to it, 0 when it is not found."""
        self._before, substeps = self._points, self._substeps
        expected = self.equilibrium.scene.physics.deltas[step - 1] or self._range
        if not self._control.press(force, expected):
            return 0
        # the tries between them are too close together to extrapolate from
        self._points = [*self._before[-2:], self._last]
        return self._substeps - substeps

    def _go(self, delta: float) -> Pair:
        """Stand at a depth, or as near to it as there is an equilibrium; with memory on the way from the last row."""
        if self.equilibrium.has_memory:
            self._points = self._before
            self.return_to_last()
        self._substeps += self._reach(delta)
        return self._pair

    @property
    def _pair(self) -> Pair:
        return self.equilibrium.force, self._last.delta

    def return_to_last(self) -> None:
        """Put the last equilibrium back, after a step that failed."""
        self.equilibrium.restore(self._last.state, self._last.delta)

    def return_to_row(self) -> None:
        """Put the equilibrium of the last row back: after a stop in mid-step the last one may be a substep's."""
        self.equilibrium.restore(self._row.state, self._row.delta)
        self.equilibrium.recover()

    def _reach(self, target: float) -> int:
        """Step to the target; the number of steps, 0 when it cannot be reached.

        With memory each row has steps of its own, whatever those before needed: a resumed path is the same path. And
        the way in stops where it begins, for nothing sticks before; the way out of a tip that adheres where it ends.
        """
        if self.equilibrium.has_memory:
            self._steps = self._step_rule()
            felt = self._untouched.delta  # from here on inwards
            if (target < felt < self._last.delta) if self._adheres else (self._last.delta < 0 < target):
                return (first := self._reach(felt)) and (rest := self._reach(target)) and first + rest
        substeps = 0
        self._steps.begin(target - self._last.delta)
        while (goal := self._steps.goal(self._last.delta, target)) is not None:
            if self._attempt(goal):
                substeps += 1
                self._steps.succeeded()
                if goal == target:
                    return substeps
            else:
                self._steps.failed()
        return 0

    def _attempt(self, delta: float) -> bool:
        """Solve at delta, first from the predicted state, then from the last one, then as a tip that lets go.

        Where it snaps in or lets go only a short step counts, and no prediction leads on from the states before.
        """
        self.equilibrium.depart()
        found = self._solve(delta)
        touches = found and self._touches
        jumps = touches != self._last.touches
        if not found or (jumps and self._is_long(delta)):
            self.return_to_last()
            return False
        dissipated = self._last.dissipated + self.equilibrium.dissipation
        before = [] if jumps else self._points[-2:]
        self._points = [*before, Point(delta, self.equilibrium.snapshot(), dissipated, touches)]
        return True

    def _solve(self, delta: float) -> bool:
        is_led = self._extrapolate(delta)
        if is_led and self.equilibrium.solve(delta):
            return True
        self.return_to_last()
        if is_led and self._adheres and self._is_long(delta):  # a shorter step costs less than another fifty iterations
            return False
        return self.equilibrium.solve(delta) or self._lets_go(delta)

    def _lets_go(self, delta: float) -> bool:
        """Solve at delta from the untouched body: where a contact that pulls has no equilibrium any more."""
        if not self._last.touches or delta > self._last.delta or self._is_long(delta):
            return False
        self.equilibrium.restore(self._untouched.state, delta)
        return self.equilibrium.solve(delta)

    @property
    def _touches(self) -> bool:
        """Whether a tip that adheres touches the body in the present state."""
        return self._adheres and bool(self.equilibrium.numbers()["a"] > 0)

    def _is_long(self, delta: float) -> bool:
        """Whether the step to delta is longer than one over which a tip that adheres may snap in or let go."""
        return abs(delta - self._last.delta) > JUMP * self._range

    def _extrapolate(self, delta: float) -> bool:
        """Predict by the line or parabola through the last states; False where it leads nowhere."""
        points = _leading(self._points, delta)
        if len(points) < 2:
            return False
        self.equilibrium.predict(delta, [(point.delta, point.state) for point in points])
        return True


def _longest(scene: Scene) -> float:
    """The longest step [length] that is tried: without limit where the gap is linear in what is sought."""
    if scene.physics.gap == "reference":
        return inf
    return LONGEST * scene.plan.prediction["a"] / scene.physics.scales.length


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
