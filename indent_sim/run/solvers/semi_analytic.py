"""Semi-analytic solution of a scene: the states of its load path by theory, without a mesh."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf, nan

import numpy as np

from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State, Surface
from indent_sim.model.tips import gap_under_tip
from indent_sim.process.ranks import run_on_root
from indent_sim.run.run_output import Comm
from indent_sim.scene.scene import Scene
from indent_sim.theory.solution import Solution


class SemiAnalyticSolver:
    """Solver by theory, row by row, with the interface of the load stepper of a meshed scene.

    Only rank 0 computes. Rows are independent, so that a checkpoint (`points`) is empty.
    """

    points = ()

    def __init__(self, scene: Scene, comm: Comm, started: float | None = None):
        assert scene.plan.theory is not None
        self.scene = scene
        self.theory = scene.plan.theory
        self._comm = comm
        self._started = time.perf_counter() if started is None else started

    def states(
        self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0
    ) -> Iterator[State]:
        """Yield one State per requested value after the first `done` rows.

        The path ends at the first value that theory does not reach, with a state not converged.
        """
        solutions = run_on_root(self._comm, self._solve_all, path.values) or [None] * len(
            path.values
        )
        # The whole path is solved, so that a row does not depend on where a run is resumed.
        rows = list(zip(path.values, solutions, strict=True))
        for step, (value, solution) in enumerate(rows[done:], start=done + 1):
            state = self._comm.bcast(
                run_on_root(self._comm, self._state, step, value, solution, wants_surface)
            )
            yield state
            if not state.converged:
                return

    def _solve_all(self, values: Sequence[float]) -> Sequence[Solution | None] | None:
        """Return the contacts of all rows; None if a row is beyond the range of the theory.

        All contacts together are hardly more expensive than a few of them.
        """
        return (
            self.theory.solutions_at_forces(values)
            if self._has_prescribed_forces
            else self.theory.solutions_at_depths(values)
        )

    @property
    def _has_prescribed_forces(self) -> bool:
        return self.scene.physics.path.control == "force"

    def _solve_one(self, value: float) -> Solution | None:
        """Return the contact at one depth or force; None if theory does not reach it."""
        depth: float | None = value
        if self._has_prescribed_forces:
            depth = self.theory.depth_of_force(value, inf) if value > 0 else 0.0
        return None if depth is None else self.theory.solution_at_depth(depth)

    def _state(
        self,
        step: int,
        value: float,
        cached_solution: Solution | None,
        wants_surface: Callable[[int], bool],
    ) -> State:
        """Return the state of one row."""
        solution = cached_solution or self._solve_one(value)
        seconds = time.perf_counter() - self._started
        if solution is None:
            reason = (
                "theory has no solution for this depth or force: the contact would reach a lateral "
                "wall, the end of the tip or a radius of 100 layer thicknesses"
            )
            return State(
                step, nan, nan, nan, nan, nan, nan, 0, seconds, converged=False, reason=reason
            )
        numbers = solution.delta, solution.force, solution.a, solution.largest_pressure()
        state = State(step, *numbers, 0.0, nan, 0, seconds, stiffness=solution.stiffness)
        return replace(state, surface=self._surface(solution)) if wants_surface(step) else state

    @cached_property
    def _radii(self) -> np.ndarray:
        return surface_radii(self.scene)

    def _surface(self, solution: Solution) -> Surface:
        """Return the surface: pressure (NaN where infinite), u_z and gap, but no u_x."""
        r = self._radii
        tip = self.scene.physics.indenter
        p = np.asarray(solution.pressure(r))
        u_z = np.asarray(solution.u_z(r))
        gap = gap_under_tip(
            tip, np.where(r <= solution.a, 0.0, tip.height(r, 0 * r) - solution.delta - u_z)
        )
        u = np.column_stack([np.full_like(r, nan), 0 * r, u_z])
        axis = float(self.scene.physics.center[0])
        return Surface(r + axis, 0 * r, u, gap, np.where(np.isfinite(p), p, nan), 0 * r)


def surface_radii(scene: Scene) -> np.ndarray:
    """Return the distances from the tip's axis at which the surface is written.

    The distances extend to the end of the body or to ten radii of the largest contact, and include
    the radius of this contact.
    """
    sizes = scene.sizes
    lateral_extent = scene.physics.body.lateral_extent(scene.physics.center)
    # Extent of the written surface in contact radii, if no wall is nearer.
    extent = 10.0
    end = min(extent * sizes.a, lateral_extent)
    distances = [0.0]
    while distances[-1] < end * (1 - 1e-9):
        distances.append(
            distances[-1] + float(sizes.size_at(np.array(distances[-1]), np.array(0.0)))
        )
    r = np.array(distances)
    widest = np.searchsorted(r, sizes.a * (1 - 1e-9))
    r[:widest] *= sizes.a / r[widest]
    r[widest] = sizes.a
    return np.append(r[r < end], end)
