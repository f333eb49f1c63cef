"""A scene solved by theory: the states of its load path without a mesh."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from math import inf, nan
from typing import Any

import numpy as np

from indent_sim.model.loading import LoadPath
from indent_sim.model.state import State, Surface
from indent_sim.process.ranks import on_root
from indent_sim.scene.scene import Scene
from indent_sim.theory.solution import Solution, largest_pressure

SEEN = 10.0  # contact radii of the surface that are written, where no wall is nearer


class TheoryWalk:
    """States by theory, row by row: what `fe.walk` is for a mesh. Rank 0 alone computes.

    No row depends on another, so there is nothing to keep for a run that goes on (`points`).
    """

    points = ()

    def __init__(self, scene: Scene, comm: Any, started: float | None = None):
        assert scene.plan.theory is not None
        self.scene, self.theory, self._comm = scene, scene.plan.theory, comm
        self._started = time.perf_counter() if started is None else started
        self._radii = radii(scene)

    def states(self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0) -> Iterator[State]:
        """One State per requested value after the first `done`; after one that theory does not reach no other."""
        for step, value in enumerate(path.values[done:], start=done + 1):
            state = self._comm.bcast(on_root(self._comm, self._state, step, value, wants_surface(step)))
            yield state
            if not state.converged:
                return

    def _state(self, step: int, value: float, with_surface: bool) -> State:
        found = self._solution(value)
        if found is None:
            return State(step, nan, nan, nan, nan, nan, nan, 0, self._seconds(), converged=False,
                         reason="theory ends before: at a wall, at the tip's end, or at 100 thicknesses")  # fmt: skip
        surface = self._surface(found) if with_surface else None
        return State(step, found.delta, found.force, found.a, largest_pressure(found), 0.0, nan, 0, self._seconds(),
                     stiffness=found.stiffness, surface=surface)  # fmt: skip

    def _seconds(self) -> float:
        return time.perf_counter() - self._started

    def _solution(self, value: float) -> Solution | None:
        """The contact at a depth, or at a force."""
        if self.scene.physics.path.control == "depth":
            return self.theory.at(value)
        depth = self.theory.depth(value, inf) if value > 0 else 0.0
        return None if depth is None else self.theory.at(depth)

    def _surface(self, found: Solution) -> Surface:
        """Pressure (not a number where it is infinite), u_z and gap; theory does not say u_x."""
        r, tip = self._radii, self.scene.physics.indenter
        p, u_z = np.asarray(found.pressure(r)), np.asarray(found.u_z(r))
        gap = np.where(r <= found.a, 0.0, tip.height(r, 0 * r) - found.delta - u_z)
        u = np.column_stack([np.full_like(r, nan), 0 * r, u_z])
        return Surface(r + self._start, 0 * r, u, gap, np.where(np.isfinite(p), p, nan), 0 * r)

    @property
    def _start(self) -> float:
        """x of the tip's axis."""
        return float(self.scene.physics.center[0])


def radii(scene: Scene) -> np.ndarray:
    """Distances from the tip's axis at which the surface is written: to its rim, or SEEN radii of the widest contact.

    One of them is where the widest contact ends.
    """
    sizes, rim = scene.sizes, scene.physics.body.rim_distance(scene.physics.center)
    end, found = min(SEEN * sizes.a, rim), [0.0]
    while found[-1] < end * (1 - 1e-9):
        found.append(found[-1] + float(sizes.at(np.array(found[-1]), np.array(0.0))))
    r = np.array(found)
    widest = np.searchsorted(r, sizes.a * (1 - 1e-9))
    r[:widest] *= sizes.a / r[widest]
    r[widest] = sizes.a
    return np.append(r[r < end], end)
