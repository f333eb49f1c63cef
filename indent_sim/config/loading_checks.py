"""Checks of the load path and of histories."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import inf

from indent_sim.config.scene_sections import SceneSections
from indent_sim.model.gel import Gel
from indent_sim.model.loading import PATH_KEYS
from indent_sim.process.errors import ConfigError


def load_path_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the load path."""
    loading = config.loading
    attraction = config.contact.adhesion
    if not loading.given_path_keys:
        yield ConfigError(
            "loading", "gives no depth and no force", f"give one of {', '.join(PATH_KEYS)}"
        )
    elif len(loading.given_path_keys) > 1:
        first, second = loading.given_path_keys[:2]
        yield ConfigError(
            f"loading.{second}", f"contradicts {first}", f"give one of {', '.join(PATH_KEYS)}"
        )
    elif (forces := loading.forces) and not attraction and min(forces) < 0:
        first_pull = next(k for k, force in enumerate(forces) if force < 0)
        problem = f"a force of {forces[first_pull]:g} is tensile, but there is no adhesion"
        yield ConfigError(
            f"loading.forces[{first_pull}]", problem, "use a force >= 0, or give contact.adhesion"
        )
    elif forces and not attraction and not any(forces):
        yield ConfigError(
            "loading.forces",
            "never press the tip in: every force is 0",
            "give at least one above 0",
        )


def history_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in a history."""
    path_in_time = config.loading.prescribed_history
    times = config.loading.times
    if path_in_time is None:
        if not isinstance(times, str):
            yield ConfigError(
                "loading.times",
                "applies only to a history, but the scene has none",
                "give loading.history, or leave it out",
            )
        return
    key = "loading.history" if config.loading.history else "loading.force_history"
    point_times = [t for t, _ in path_in_time.points]
    backward_index = next(
        (k for k, (earlier, later) in enumerate(pairwise(point_times), start=1) if later < earlier),
        None,
    )
    if backward_index is not None:
        yield ConfigError(
            f"{key}[{backward_index}]",
            f"time goes back from {point_times[backward_index - 1]:g} to "
            f"{point_times[backward_index]:g}",
        )
    elif point_times[0] == point_times[-1]:
        yield ConfigError(key, "has no duration", "give increasing times")
    for k, (before, t) in enumerate(pairwise((-inf, *path_in_time.times))):
        if not max(before, point_times[0]) <= t <= point_times[-1] or t == before:
            problem = (
                f"{t:g} lies outside the history"
                if not point_times[0] <= t <= point_times[-1]
                else "is not later than the previous time"
            )
            yield ConfigError(
                f"loading.times[{k}]",
                problem,
                f"use increasing times from {point_times[0]:g} to {point_times[-1]:g}",
            )
            break
    swells = any(isinstance(material, Gel) and material.flow for _, material in config.materials())
    if path_in_time.largest_value <= 0 and not swells:
        yield ConfigError(key, "never presses the tip in", "give a largest value above 0")
    lowest_force = (
        min(value for _, value in path_in_time.points) if path_in_time.control == "force" else 0.0
    )
    if lowest_force < 0 and config.contact.may_snap_through:
        problem = (
            f"contains the tensile force {lowest_force:g}, but the depth under a prescribed "
            "tensile force is not unique"
        )
        yield ConfigError(key, problem, "prescribe depths by loading.history, or use forces >= 0")
    elif lowest_force < 0 and not (config.experiment and config.experiment.adhesion):
        yield ConfigError(
            key,
            f"a force of {lowest_force:g} is tensile, but there is no adhesion",
            "give experiment.adhesion",
        )
