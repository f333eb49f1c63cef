"""Error by the load increments or time steps, from increments half as long."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import nan

from indent_sim.model.state import State
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    States,
    StatesByStep,
    halve_increments,
    states_by_step,
)
from indent_sim.run.error_estimation.error_budget import (
    SAFETY_FACTOR,
)
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class StepRefinement:
    """The load path of a scene in its own increments and in increments half as long."""

    full_steps: StatesByStep
    half_steps: StatesByStep

    def error(self, state: State, name: str) -> float:
        """Error of a number of a step: SAFETY_FACTOR times its change by halved increments.

        Twice that change is Richardson's estimate for order 1, 2.6 times for order 0.7, with which
        a path converges whose new contact sticks where the increment began. NaN if the step is
        missing.
        """
        return SAFETY_FACTOR * value_difference(self.full_steps, self.half_steps, state.step, name)


def step_refinement(
    base_run: CoarserRun, follow: Callable[[Scene], States]
) -> StepRefinement | None:
    """Solve a run with increments half as long; None where the result does not depend on them."""
    half_increment_scene = halve_increments(base_run.scene) if base_run.scene else None
    if base_run.scene is None or half_increment_scene is None:
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
    """Distance of a number of a step between two runs; NaN if a run lacks the step."""
    if step not in first or step not in second:
        return nan
    return float(abs(getattr(second[step], name) - getattr(first[step], name)))
