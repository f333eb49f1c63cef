"""A scene followed in time on its elastic curve: the rows of its history."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import nan
from typing import Any

import numpy as np

from indent_sim.model.loading import LoadPath
from indent_sim.model.state import State
from indent_sim.run.companions.error_bars import Bars
from indent_sim.run.readings import Equilibrium
from indent_sim.scene.scene import Scene

BARS = {
    "force_error": "force",
    "a_error": "a",
    "delta_error": "delta",
}  # that the rows of a history have, and of what


class CurveWalk:
    """The rows of a history, step by step: what `fe.walk` is for a path without time.

    `elastic`: the walk of the same scene along its elastic curve, on a mesh or by theory. All rows
    come at once, from the curve; a run that goes on computes it anew.
    """

    points = ()
    failure = ""

    def __init__(self, scene: Scene, elastic: Any, started: float | None = None):
        self.scene = scene
        self._elastic = elastic
        self._started = time.perf_counter() if started is None else started
        self.judged: list[
            State
        ] = []  # equilibria of the elastic curve with their error bars, in the user's units

    @property
    def equilibrium(self) -> Equilibrium:
        """The condensed body; None by theory."""
        return self._elastic.equilibrium if self.scene.is_meshed else None

    def resume(self, saved: Any, depths: Any) -> bool:
        """Nothing is left to be reached again."""
        return True

    def solve(self, bars: Bars | None = None) -> None:
        """Find all rows, and judge the equilibria of the elastic curve; NotConverged where the
        curve is not known.
        """
        from indent_sim.run.experiment import (
            followed,
        )  # with scipy's searches, which no other scene needs

        self.findings = followed(self.scene, self.equilibrium)
        self._seconds = time.perf_counter() - self._started
        if bars is not None:
            walked = self._elastic.states(self.scene.physics.path, lambda step: False)
            scales = self.scene.physics.scales
            self.judged = [
                bars.judged(state.in_units(scales)) for state in walked if state.converged
            ]

    def states(
        self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0
    ) -> Iterator[State]:
        """One State per row after the first `done`, once they are found."""
        has_base = "z" in self.scene.columns
        for step, row in enumerate(self.findings.rows[done:], start=done + 1):
            known = (row.delta, row.force, row.a, nan, nan, nan, 0, self._seconds)
            state = State(
                step, *known, t=row.t, branch=row.branch, calibration_error=row.calibration_error
            )
            yield replace(state, z=row.z) if has_base else state

    def with_bars(self, row: State) -> State:
        """A row with the relative error of the elastic curve at its depth; one that does not push
        has none.
        """
        reached = [state for state in self.judged if state.delta > 0]
        if not reached:
            return row
        depths = [state.delta for state in reached]
        found = {}
        for name, of in BARS.items():
            if getattr(reached[0], name) is not None:
                shares = [getattr(state, name) / abs(getattr(state, of)) for state in reached]
                found[name] = abs(getattr(row, of)) * float(np.interp(row.delta, depths, shares))
        return replace(row, **found)
