"""Error due to the load increments or time steps, from increments half as long."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import nan

from indent_sim.model.load_path import Unloading
from indent_sim.model.state import State
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    States,
    StatesByStep,
    halve_increments,
    states_by_step,
    with_solved_depths,
)
from indent_sim.run.error_estimation.error_budget import (
    SAFETY_FACTOR,
)
from indent_sim.run.error_estimation.unloading_rows import depth_without_force
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class StepRefinement:
    """Results of a scene with its increments and with increments half as long."""

    full_steps: StatesByStep
    half_steps: StatesByStep

    def error(self, state: State, name: str) -> float:
        """Return the error of a quantity: SAFETY_FACTOR times its change if increments are halved.

        Richardson's estimate is twice the change for order 1 and 2.6 times the change for order
        0.7. Order 0.7 was observed for paths on which new contact sticks at the position at the
        beginning of the increment. The error is NaN if the step is missing in one of the runs.
        """
        return SAFETY_FACTOR * value_difference(self.full_steps, self.half_steps, state.step, name)

    def residual_depth_error(self, unloading: Unloading) -> float:
        """Return the error of the depth at which the force vanishes in unloading [length]."""
        full, half = (
            depth_without_force(states, unloading) for states in (self.full_steps, self.half_steps)
        )
        return SAFETY_FACTOR * abs(half - full)


def step_refinement(
    base_run: CoarserRun, follow: Callable[[Scene], States]
) -> StepRefinement | None:
    """Solve a run with halved increments; None if increments do not change its result."""
    if base_run.scene is None:
        return None
    half_increment_scene = halve_increments(with_solved_depths(base_run.scene, base_run.states))
    if half_increment_scene is None:
        return None
    half_step_states = follow(half_increment_scene)
    full_step_states = [
        replace(
            last,
            step=last.step // 2,
            dissipation=(first.dissipation or 0.0) + (last.dissipation or 0.0),
        )
        for first, last in zip(half_step_states[::2], half_step_states[1::2], strict=False)
    ]
    return StepRefinement(base_run.states_by_step, states_by_step(full_step_states))


def value_difference(first: StatesByStep, second: StatesByStep, step: int, name: str) -> float:
    """Return the absolute difference of a quantity in two runs; NaN if a run lacks the step."""
    if step not in first or step not in second:
        return nan
    return float(abs(getattr(second[step], name) - getattr(first[step], name)))
