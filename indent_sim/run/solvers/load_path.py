"""Solver of the rows of a scene along its load path, with their derived quantities."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.results.tables import EXPERIMENT
from indent_sim.run.derived_quantities import DerivedQuantities
from indent_sim.run.error_estimation.error_bars import AnyErrorBars
from indent_sim.run.run_output import OptionalOutput
from indent_sim.run.solvers.hereditary_integral import HereditaryIntegralSolver
from indent_sim.scene.scene import Scene


class LoadPathSolver:
    """Solver of rows that are equilibria along the load path of a scene.

    A `HereditaryIntegralSolver` has the same interface.

    Parameters
    ----------
    scene
        The scene.
    stepper
        The load stepper of a meshed scene, or its solver by theory.
    optional_output
        Evaluates derived quantities; a failure is reported and does not stop the run.
    """

    def __init__(self, scene: Scene, stepper: Any, optional_output: OptionalOutput | None = None):
        self._scene = scene
        self._stepper = stepper
        self._equilibrium = stepper.equilibrium if scene.is_meshed else None
        self._optional_output = optional_output or OptionalOutput()
        self._derived_quantities = DerivedQuantities(scene, self._equilibrium, optional_output)

    @property
    def points(self) -> Any:
        """The last equilibria, from which a checkpoint is written."""
        return self._stepper.points

    @property
    def row_count(self) -> int:
        """Number of rows of the whole run."""
        return len(self._scene.physics.deltas)

    def prepare(self, error_bars: AnyErrorBars | None = None) -> None:
        """Do nothing: each row is solved when it is requested."""

    def states(
        self, path: LoadPath, wants_surface: Callable[[int], bool], done: int = 0
    ) -> Iterator[State]:
        """Yield one State per row after the first `done` rows, nondimensional."""
        for state in self._stepper.states(path, wants_surface, done):
            yield self._derived_quantities.complete_state(state)

    def finish_row(self, row: State, check: Callable[[State], State]) -> State:
        """Return a row after its checks, with the error estimate that `check` adds."""
        return check(row)

    def states_with_errors(self, rows: list[State]) -> list[State]:
        """Return the states with error estimates, which are the rows of the force table."""
        return rows

    def experiment(self) -> Any:
        """Return the experiment on the elastic curve, in the user's units, with its rows."""
        # Imported here since it loads scipy.optimize, which other scenes do not need.
        from indent_sim.run.history_on_curve import HistoryResult, evaluate_with_units

        return self._optional_output(
            EXPERIMENT,
            lambda: evaluate_with_units(self._scene, self._equilibrium),
            HistoryResult([]),
        )


RowSolver = LoadPathSolver | HereditaryIntegralSolver


def row_solver(
    scene: Scene, stepper: Any, optional_output: OptionalOutput, started: float | None = None
) -> RowSolver:
    """Return the solver of the rows of a scene, whose load path or elastic curve `stepper` solves.

    `started` is the reading of the clock at the start of the rows [s].
    """
    if scene.history_on_curve is None:
        return LoadPathSolver(scene, stepper, optional_output)
    return HereditaryIntegralSolver(scene, stepper, started)
