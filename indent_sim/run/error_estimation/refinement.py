"""Adaptive refinement: finer meshes until the estimated error is within the requested accuracy."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.error_estimation.coarser_run import CoarserRun
from indent_sim.run.error_estimation.error_bars import AnyErrorBars
from indent_sim.run.error_estimation.error_budget import ErrorBudget
from indent_sim.scene.measured_constants import ORDER_OF_CONVERGENCE
from indent_sim.scene.resolution import MAX_ELEMENTS, MeshResolution, target_error
from indent_sim.scene.scene import Scene

MAX_LEVELS = 6
# The accuracy is not required of rows whose force is at most this fraction of the largest force.
MIN_FORCE_FRACTION = 1e-6
# Bounds of the ratio by which the next mesh is finer.
MIN_REFINEMENT = 1.3
MAX_REFINEMENT = 2.5

# Returns the scene with this number of elements in the contact radius.
Resolve = Callable[[float | None], Scene]
log = logging.getLogger("indent_sim")


@dataclass
class RefinementLevel:
    """One mesh of an adaptive refinement, with its assessment.

    Attributes
    ----------
    scene
        The scene on this mesh.
    previous_resolutions
        Elements in the contact radius of the previous levels, in order.
    coarser_run
        The run on the previous mesh, used as the coarser run of this one; None if a coarser run has
        to be solved.
    failure
        Reason why the accuracy is not reached; "" if it is reached.
    next_level
        The next finer level; None if no finer mesh is needed, possible or useful.
    """

    scene: Scene
    previous_resolutions: tuple[float, ...] = ()
    coarser_run: CoarserRun | None = None
    failure: str = ""
    next_level: RefinementLevel | None = None

    def assess(self, resolve: Resolve, states: Sequence[State], error_bars: AnyErrorBars) -> None:
        """Compare the error estimates with the requested accuracy and choose the next level.

        Parameters
        ----------
        resolve
            Function that returns the scene with a given number of elements in the contact radius.
        states
            The rows of this level [user's units].
        error_bars
            Error estimates of the rows.
        """
        relative_errors = [
            (budget.total / force, budget)
            for force, budget in _loaded_rows(states, error_bars.budgets)
        ]
        unknown = [
            (inf, budget)
            for relative_error, budget in relative_errors
            if relative_error != relative_error
        ]
        error, worst = max(
            unknown or relative_errors, key=lambda item: item[0], default=(0.0, None)
        )
        resolution = self.scene.plan.resolution
        if resolution is None or worst is None or error <= resolution.target:
            return
        resolutions = (*self.previous_resolutions, resolution.n)
        first_step_error = next(
            (budget.path / force for force, budget in _loaded_rows(states, error_bars.budgets)), 0.0
        )
        next_scene, outcome_text = _next_refinement(
            resolve, resolution, error, worst, first_step_error, len(resolutions)
        )
        if next_scene is not None and next_scene.plan.resolution is not None:
            outcome_text = (
                f"refining to {next_scene.plan.resolution.n:.3g} elements in the contact radius"
            )
            ratio = self.scene.sizes.h_contact / next_scene.sizes.h_contact
            self.next_level = RefinementLevel(
                next_scene, resolutions, CoarserRun(ratio, states, self.scene)
            )
        self.failure = (
            f"accuracy not reached: the relative error of the force at step {worst.step} is "
            f"estimated as {error:.2g}"
        )
        self.failure += f", but at most {resolution.target:g} is requested; {outcome_text}"


def adaptive_refinement(
    resolve: Resolve, elements: float | None = None, previous_resolutions: Sequence[float] = ()
) -> Iterator[RefinementLevel]:
    """Yield successively finer levels until one has the requested accuracy.

    Parameters
    ----------
    resolve
        Function that returns the scene with a given number of elements in the contact radius.
    elements
        Elements in the contact radius of the first level; for a resumed run, of its last level.
    previous_resolutions
        Elements in the contact radius of the levels before the first.
    """
    level: RefinementLevel | None = RefinementLevel(resolve(elements), tuple(previous_resolutions))
    while level is not None:
        yield level
        if level.next_level is not None:
            log.info(level.failure)
        level = level.next_level


def refinement_ratio(error_ratio: float) -> float:
    """Return the ratio of element sizes that multiplies the error by `error_ratio`."""
    # Factor by which the next mesh is finer than the estimate requires.
    refinement_margin = 1.1
    return float(
        min(
            max(refinement_margin * error_ratio ** (-1 / ORDER_OF_CONVERGENCE), MIN_REFINEMENT),
            MAX_REFINEMENT,
        )
    )


def forceless_row_warnings(
    scene: Scene, states: Sequence[State], error_bars: AnyErrorBars
) -> list[str]:
    """Return warnings about rows with a small force whose error exceeds the requested accuracy.

    The accuracy is not required of rows whose force is at most MIN_FORCE_FRACTION of the largest.
    """
    threshold = _force_threshold(states)
    resolution = scene.plan.resolution
    if resolution is None:
        return []
    forceless = [
        (state, budget)
        for state, budget in zip(states, error_bars.budgets, strict=True)
        if abs(state.force) <= threshold
    ]
    wide_steps = [
        str(state.step)
        for state, budget in forceless
        if not budget.total <= resolution.target * abs(state.force)
    ]
    if not wide_steps:
        return []
    steps_text = f"{', '.join(wide_steps[:5])}{' and more' if len(wide_steps) > 5 else ''}"
    return [
        "rows need not have the requested accuracy if their force is at most "
        f"{MIN_FORCE_FRACTION:g} of the largest force; the error estimate exceeds the accuracy "
        f"at steps {steps_text}"
    ]


def _force_threshold(states: Sequence[State]) -> float:
    """Return the force up to which a row is excluded from the requested accuracy."""
    return MIN_FORCE_FRACTION * max((abs(state.force) for state in states), default=0.0)


def _loaded_rows(
    states: Sequence[State], budgets: Sequence[ErrorBudget]
) -> Iterator[tuple[float, ErrorBudget]]:
    """Yield the absolute force and the error budget of every row with a significant force."""
    threshold = _force_threshold(states)
    forces = (abs(state.force) for state in states)
    return (
        (force, budget) for force, budget in zip(forces, budgets, strict=True) if force > threshold
    )


def _next_refinement(
    resolve: Resolve,
    resolution: MeshResolution,
    error: float,
    worst: ErrorBudget,
    first_step_error: float,
    level_count: int,
) -> tuple[Scene | None, str]:
    """Choose the scene of the next level, or explain why there is none.

    Parameters
    ----------
    resolve
        Function that returns the scene with a given number of elements in the contact radius.
    resolution
        The resolution of this level.
    error
        The largest relative error of the rows of this level.
    worst
        The error budget of the row with the largest relative error.
    first_step_error
        The relative error of the first row due to the load increments.
    level_count
        Number of levels up to this one.

    Returns
    -------
    scene, reason
        The scene and "", or None and the reason why there is no next level.
    """
    allowed = resolution.target * worst.total / error
    if worst.enforcement >= allowed and resolution.stiffness_given:
        return (
            None,
            "the penalty stiffness epsilon_n alone causes a relative error of "
            f"{error * worst.enforcement / worst.total:.2g}: increase contact.epsilon_n",
        )
    if worst.path >= allowed:
        advice = (
            "give more loading.steps or more values; if the body yields, a smaller accuracy "
            "makes the increments shorter"
            if first_step_error < resolution.target
            else f"in the first row it is {first_step_error:.2g}, since it is always reached "
            "in a single increment from no contact"
        )
        return (
            None,
            "the load increments alone cause a relative error of "
            f"{error * worst.path / worst.total:.2g}: {advice}",
        )
    if worst.time >= allowed:
        return (
            None,
            "the time steps alone cause a relative error of "
            f"{error * worst.time / worst.total:.2g}: increase loading.per_doubling",
        )
    if worst.truncation >= allowed:
        return (
            None,
            "the truncation of the half-space to a finite body, or the approximation of a curved "
            "surface by flat facets, causes a larger error",
        )
    if level_count >= MAX_LEVELS:
        return None, f"no more than {level_count} meshes are tried"
    fixed_errors = worst.truncation + worst.path + worst.time
    error_ratio = (allowed - fixed_errors) / (worst.total - fixed_errors)
    factor = 2.0 if resolution.refinements else refinement_ratio(error_ratio)
    if resolution.n * factor > MAX_ELEMENTS:
        return None, f"more than {MAX_ELEMENTS:g} elements in the contact radius would be needed"
    try:
        return resolve(resolution.n * factor), ""
    except ConfigError as limit:
        return None, f"the next mesh is too large for this machine ({limit.problem})"


def accuracy_entry(
    config: Config, resolution: MeshResolution | None, previous_resolutions: Sequence[float]
) -> dict[str, Any] | None:
    """Return the entry `accuracy` of run.json; None if no accuracy is requested.

    The entry contains the target, and the number of elements in the contact radius on this and the
    previous levels.
    """
    target = target_error(config.accuracy)
    mesh_entries = (
        {"elements": resolution.n, "tried": list(previous_resolutions)} if resolution else {}
    )
    return None if target is None else {"target": target} | mesh_entries
