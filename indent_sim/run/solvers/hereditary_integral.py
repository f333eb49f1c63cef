"""A scene followed in time on its elastic curve: the rows of its history."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import nan
from typing import Any

import numpy as np

from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.run.derived_quantities import Equilibrium
from indent_sim.run.error_estimation.error_bars import AnyErrorBars
from indent_sim.scene.scene import Scene

ERROR_SOURCES = {
    "force_error": "force",
    "a_error": "a",
    "delta_error": "delta",
}  # that the rows of a history have, and of what


class HereditaryIntegralSolver:
    """The rows of a history, step by step: what `fe.walk` is for a path without time.

    `elastic`: the walk of the same scene along its elastic curve, on a mesh or by theory. All rows
    come at once, from the curve; a run that goes on computes it anew.
    """

    points = ()
    failure = ""

    def __init__(self, scene: Scene, elastic: Any, started: float | None = None):
        self.scene = scene
        self._elastic_solver = elastic
        self._started = time.perf_counter() if started is None else started
        self.states_with_errors: list[
            State
        ] = []  # equilibria of the elastic curve with their error bars, in the user's units

    @property
    def equilibrium(self) -> Equilibrium:
        """The condensed body; None by theory."""
        return self._elastic_solver.equilibrium if self.scene.is_meshed else None

    def resume(self, saved: Any, depths: Any) -> bool:
        """Nothing is left to be reached again."""
        return True

    def solve(self, error_bars: AnyErrorBars | None = None) -> None:
        """Find all rows, and judge the equilibria of the elastic curve; NotConverged where the
        curve is not known.
        """
        from indent_sim.run.history_on_curve import (
            evaluate_history,
        )  # with scipy's searches, which no other scene needs

        self.history_result = evaluate_history(self.scene, self.equilibrium)
        self._seconds = time.perf_counter() - self._started
        if error_bars is not None:
            elastic_states = self._elastic_solver.states(
                self.scene.physics.path, lambda step: False
            )
            scales = self.scene.physics.scales
            self.states_with_errors = [
                error_bars.add_error_estimate(state.to_user_units(scales))
                for state in elastic_states
                if state.converged
            ]

    def states(
        self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0
    ) -> Iterator[State]:
        """One State per row after the first `done`, once they are found."""
        has_base = "z" in self.scene.columns
        for step, row in enumerate(self.history_result.rows[done:], start=done + 1):
            numbers = (row.delta, row.force, row.a, nan, nan, nan, 0, self._seconds)
            state = State(
                step, *numbers, t=row.t, branch=row.branch, calibration_error=row.calibration_error
            )
            yield replace(state, z=row.z) if has_base else state

    def add_error_estimate(self, row: State) -> State:
        """A row with the relative error of the elastic curve at its depth; one that does not push
        has none.
        """
        loaded_states = [state for state in self.states_with_errors if state.delta > 0]
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
