"""History table: the force of a body that drains, or whose shear relaxes, along the way of one
measured curve.

    F(x, t) = scale G(t) x^p,   G = F_run/delta_run^p

The scene is run along the way of the tip as it was measured, at the nodes of a lattice of its
parameters; x is the depth and t the time from first touch on, p the exponent of the elastic force
at the deepest. Where a fit moves first touch by little, depth enters by the power alone; where by
more, the way is another, and so is the table.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.parameter_grid import (
    NUMERICAL_ERRORS,
    ForwardModelUnavailable,
    ParameterGrid,
)
from indent_sim.fitting.forward_model.parameters import Parameter
from indent_sim.process.errors import ConfigError
from indent_sim.run.pipeline import states
from indent_sim.run.planned_run import PlannedRun

CORNER_TOLERANCE = 0.003  # of the deepest: by as much a measured way may miss its corners
MIN_DEPTH_FRACTION = (
    0.05  # of the deepest: contacts of few elements, whose G is taken from deeper ones
)
# times in every piece of a way, from so much of its length on
TIMES_PER_SEGMENT = 40
FIRST_TIME_FRACTION = 1e-4
STEP_REFINEMENT = 2  # times shorter steps, by which those of a table are judged
# of the lattice: 3e-4 of the force of a draining layer
HISTORY_GRID_NODES = 4
HISTORY_LOG_STEP = 0.4
HISTORY_LINEAR_STEP = 0.05
MAX_DRAINED_NU = 0.45  # of a body that drains, whose diffusivity loses its sense at 0.5


def needs_time_stepping(config: Config) -> bool:
    """Whether the force depends on the way in time so that it has to be run along it; ConfigError
    for a gel.
    """
    for key, law in config.materials():
        if law.model == "gel":
            raise ConfigError(
                f"{key}.model", "a fit does not follow a gel that swells", "fit a body that drains"
            )
    return any(
        law.flow or (law.relaxation and law.relaxation.of != "all") for _, law in config.materials()
    )


@dataclass(frozen=True)
class MeasuredPath:
    """The way of the tip from first touch on: corners (t [s], delta [length]), straight between
    them.
    """

    corners: tuple[tuple[float, float], ...]

    @property
    def max_depth(self) -> float:
        """The largest depth [length]."""
        return max(delta for _, delta in self.corners)

    @property
    def times(self) -> np.ndarray:
        """Times (n,) at which a smooth force is known well by its values: graded after every
        corner.
        """
        t = np.unique([t for t, _ in self.corners])
        fractions = np.geomspace(FIRST_TIME_FRACTION, 1.0, TIMES_PER_SEGMENT)
        return np.unique(
            np.concatenate(
                [t[:1], *(a + (b - a) * fractions for a, b in itertools.pairwise(t.tolist()))]
            )
        )


def simplify_path(t: np.ndarray, delta: np.ndarray, tolerance: float = 0.0) -> MeasuredPath:
    """The way through samples at times (n,) and depths (n,), of which those before first touch are
    < 0.

    Its corners are those of Douglas and Peucker that miss no sample by 0.3 % of the deepest, or by
    `tolerance` [length]. NoTable without depth.
    """
    first_index = int(np.argmax(delta > 0))
    if not delta[first_index] > 0 or first_index == len(t) - 1:
        raise ForwardModelUnavailable("the curve has no way in contact")
    t = t[first_index:] - first_contact_time(t, delta)
    delta = np.maximum(delta[first_index:], 0.0)
    start_corners = [
        (0.0, 0.0),
        *([(0.0, float(delta[0]))] if t[0] <= 0 else []),
    ]  # held from its first sample on: a jump
    t, delta = (t, delta) if t[0] <= 0 else (np.append(0.0, t), np.append(0.0, delta))
    kept_indices = {0, len(t) - 1}
    open_segments = [(0, len(t) - 1)]
    while open_segments:
        i, j = open_segments.pop()
        deviations = np.abs(delta[i : j + 1] - np.interp(t[i : j + 1], t[[i, j]], delta[[i, j]]))
        if deviations.max() > max(CORNER_TOLERANCE * delta.max(), tolerance):
            k = i + int(np.argmax(deviations))
            kept_indices.add(k)
            open_segments += [(i, k), (k, j)]
    corners = [(float(t[k]), float(delta[k])) for k in sorted(kept_indices)]
    return MeasuredPath(tuple([*start_corners, *corners[1:]]))


def first_contact_time(t: np.ndarray, delta: np.ndarray) -> float:
    """The time of first touch: between the samples at which the depth becomes > 0; of the first
    where it is.
    """
    first_index = int(np.argmax(delta > 0))
    if first_index == 0:
        return float(t[0])
    (t_0, t_1) = t[first_index - 1 : first_index + 1]
    (below, above) = delta[first_index - 1 : first_index + 1]
    return float(t_0 + (t_1 - t_0) * -below / (above - below))


class MeasuredPathForces:
    """G(t) of a scene along a way, over its shape parameters.

    power: the exponent p of the depth. NoTable where the scene has no solution along the way.
    """

    def __init__(
        self,
        config: Config,
        shape_parameters: Sequence[Parameter],
        path: MeasuredPath,
        exponent: float,
    ):
        self.path = path
        self.exponent = exponent

        def solve(scene: Config) -> np.ndarray:
            return _force_factors(scene, path, exponent)

        self.grid = ParameterGrid(
            config,
            [_coarsen_grid_step(parameter) for parameter in shape_parameters],
            solve(config),
            solve,
            HISTORY_GRID_NODES,
        )

    def force_factor(self, theta: Sequence[float], t: np.ndarray) -> np.ndarray:
        """G [force/length^p] at times (n,) after first touch, at coordinates of the shape
        parameters.
        """
        times = self.path.times
        return _interpolate_monotonically(
            times, self.grid.interpolate(theta), np.clip(t, times[0], times[-1])
        )

    def time_step_error(self, scene: Config, theta: Sequence[float], t: np.ndarray) -> np.ndarray:
        """What G lacks of a run of the scene, which has these coordinates, in steps of half the
        length.
        """
        times = self.path.times
        difference = _force_factors(
            scene, self.path, self.exponent, STEP_REFINEMENT
        ) - self.grid.interpolate(theta)
        return np.interp(t, times, difference)

    @property
    def peak_force_factor(self) -> float:
        """G of the scene as it stands where the way is first at its deepest."""
        t = next(
            t
            for t, delta in self.path.corners
            if delta >= (1 - 2 * CORNER_TOLERANCE) * self.path.max_depth
        )
        return float(np.interp(t, self.path.times, self.grid.scene_values))


def _coarsen_grid_step(parameter: Parameter) -> Parameter:
    """A parameter on the lattice of runs."""
    if not parameter.is_linear:
        return replace(parameter, grid_step=HISTORY_LOG_STEP)
    return replace(
        parameter, grid_step=HISTORY_LINEAR_STEP, high=min(parameter.high, MAX_DRAINED_NU)
    )


def _force_factors(
    config: Config, path: MeasuredPath, exponent: float, step_refinement: int = 1
) -> np.ndarray:
    """G at the way's times, of a run in steps that are so many times shorter."""
    document: dict[str, Any] = to_mapping(config)
    document.pop("experiment", None)
    document["loading"] = {"history": [list(corner) for corner in path.corners]}
    if step_refinement > 1 or config.loading.per_doubling:
        document["loading"]["per_doubling"] = step_refinement * config.loading.steps_per_doubling
    try:
        rows = list(
            states(PlannedRun.resolve(config_from_mapping(document)).scene, with_surface=False)
        )
    except NUMERICAL_ERRORS as error:
        raise ForwardModelUnavailable(str(error)) from error
    if not rows or not rows[-1].converged:
        raise ForwardModelUnavailable(
            f"the measured way was not followed: {rows[-1].reason if rows else 'no row'}"
        )
    t, delta, force = np.array([(row.t, row.delta, row.force) for row in rows], dtype=float).T
    is_used = delta > MIN_DEPTH_FRACTION * path.max_depth
    is_used[:-1] &= np.diff(t) > 0  # of a jump the row after it
    times = path.times
    return _interpolate_monotonically(
        t[is_used],
        force[is_used] / delta[is_used] ** exponent,
        np.clip(times, t[is_used][0], t[is_used][-1]),
    )


def _interpolate_monotonically(t: np.ndarray, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Between points by cubics without overshoot."""
    from scipy.interpolate import (
        PchipInterpolator,
    )  # a tenth of a second to import, which other fits need not spend

    return PchipInterpolator(t, values)(points)  # type: ignore[no-any-return]
