"""Solver of a history by hereditary integrals on the elastic curve of a scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.run.error_estimation.error_bars import AnyErrorBars
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.run.history_on_curve import HistoryResult

# Error columns of a history, and the column whose error each one is.
ERROR_SOURCES = {"force_error": "force", "a_error": "a", "delta_error": "delta"}


class HereditaryIntegralSolver:
    """Solver of a history, with the interface of `LoadPathSolver`.

    All rows are computed at once from the elastic curve; a resumed run computes them again.

    Parameters
    ----------
    scene
        The scene with its history.
    elastic
        Solver of the same scene along its elastic curve, on a mesh or by theory.
    started
        Reading of the clock at the start of the rows [s].
    """

    points = ()

    def __init__(self, scene: Scene, elastic: Any, started: float | None = None):
        self.scene = scene
        self._elastic_solver = elastic
        self._started = time.perf_counter() if started is None else started
        # Equilibria of the elastic curve with their error bars, in the user's units.
        self._states_with_errors: list[State] = []

    @property
    def row_count(self) -> int:
        """Number of rows of the whole run, known after `prepare`."""
        return len(self._history_result.rows)

    def prepare(self, error_bars: AnyErrorBars | None = None) -> None:
        """Compute all rows and the error estimates of the elastic curve.

        Raises
        ------
        NotConverged
            If the elastic curve cannot be computed.
        """
        # Imported here since it loads scipy.optimize, which other scenes do not need.
        from indent_sim.run.history_on_curve import evaluate_history

        equilibrium = self._elastic_solver.equilibrium if self.scene.is_meshed else None
        self._history_result = evaluate_history(self.scene, equilibrium)
        self._seconds = time.perf_counter() - self._started
        if error_bars is not None:
            elastic_states = self._elastic_solver.states(
                self.scene.physics.path, lambda step: False
            )
            scales = self.scene.physics.scales
            self._states_with_errors = [
                error_bars.add_error_estimate(state.to_user_units(scales))
                for state in elastic_states
                if state.converged
            ]

    def states(
        self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0
    ) -> Iterator[State]:
        """Yield one State per row after the first `done` rows, nondimensional."""
        has_base = "z" in self.scene.columns
        for step, row in enumerate(self._history_result.rows[done:], start=done + 1):
            numbers = (row.delta, row.force, row.a, nan, nan, nan, 0, self._seconds)
            state = State(
                step, *numbers, t=row.t, branch=row.branch, calibration_error=row.calibration_error
            )
            yield replace(state, z=row.z) if has_base else state

    def experiment(self) -> HistoryResult:
        """Return the experiment, in the user's units; its rows are those of the history."""
        return replace(self._history_result.in_units(self.scene.physics.scales), rows=[])

    def states_with_errors(self, rows: list[State]) -> list[State]:
        """Return the states with error estimates, which are those of the elastic curve."""
        return self._states_with_errors

    def finish_row(self, row: State, check: Callable[[State], State]) -> State:
        """Return a row of a history with the error estimate of the elastic curve at its depth.

        Rows of a history are not checked, since the elastic curve from which they are computed has
        been checked.
        """
        loaded_states = [state for state in self._states_with_errors if state.delta > 0]
        if not loaded_states:
            return row
        depths = [state.delta for state in loaded_states]
        errors = {}
        for name, quantity in ERROR_SOURCES.items():
            if getattr(loaded_states[0], name) is not None:
                relative_errors = [
                    getattr(state, name) / abs(getattr(state, quantity)) for state in loaded_states
                ]
                errors[name] = abs(getattr(row, quantity)) * float(
                    np.interp(row.delta, depths, relative_errors)
                )
        return replace(row, **errors)
