"""Force of a path-dependent body (poroelastic, relaxing in shear) along a measured load path.

    F(x, t) = scale G(t) x^p,   G = F_run/delta_run^p

The scene is run along the measured path of the tip at the nodes of a parameter grid; x is the
depth, t the time from first contact, and p the exponent of the elastic force at the largest depth.
A slight change of the contact point during the fit changes only x; a larger change requires a new
path and new runs.
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
from indent_sim.fitting.measured_constants import (
    HISTORY_GRID_NODES,
    HISTORY_LINEAR_STEP,
    HISTORY_LOG_STEP,
)
from indent_sim.process.errors import ConfigError
from indent_sim.run.pipeline import states
from indent_sim.run.planned_run import PlannedRun

CORNER_TOLERANCE = 0.003  # deviation of the path from its samples, relative to the largest depth


def needs_time_stepping(config: Config) -> bool:
    """Return True if the scene needs time stepping; raise ConfigError for a gel."""
    for key, law in config.materials():
        if law.model == "gel":
            raise ConfigError(
                f"{key}.model", "a swelling gel cannot be fitted", "fit a poroelastic material"
            )
    return any(
        law.flow or (law.relaxation and law.relaxation.of != "all") for _, law in config.materials()
    )


@dataclass(frozen=True)
class MeasuredPath:
    """Piecewise linear path of the tip from first contact: corners (t [s], delta [length])."""

    corners: tuple[tuple[float, float], ...]

    @property
    def max_depth(self) -> float:
        """The largest depth [length]."""
        return max(delta for _, delta in self.corners)

    @property
    def times(self) -> np.ndarray:
        """Times (n,) of the force samples, in geometric progression after each corner."""
        t = np.unique([t for t, _ in self.corners])
        # Number of times in each segment of a path, and the first of them as a fraction of the
        # duration of the segment.
        count = 40
        first_fraction = 1e-4
        fractions = np.geomspace(first_fraction, 1.0, count)
        return np.unique(
            np.concatenate(
                [t[:1], *(a + (b - a) * fractions for a, b in itertools.pairwise(t.tolist()))]
            )
        )


def simplify_path(t: np.ndarray, delta: np.ndarray, tolerance: float = 0.0) -> MeasuredPath:
    """Return the load path through samples at times t (n,) and depths delta (n,).

    The corners are found by the algorithm of Douglas and Peucker (1973).

    Parameters
    ----------
    delta
        Depths, < 0 before first contact.
    tolerance
        Largest deviation of the path from a sample [length]; at least `CORNER_TOLERANCE` of the
        largest depth is used.

    Raises
    ------
    ForwardModelUnavailable
        If no sample is in contact.
    """
    first_index = int(np.argmax(delta > 0))
    if not delta[first_index] > 0 or first_index == len(t) - 1:
        raise ForwardModelUnavailable("no part of the curve is in contact")
    t = t[first_index:] - first_contact_time(t, delta)
    delta = np.maximum(delta[first_index:], 0.0)
    start_corners = [(0.0, 0.0)]
    if t[0] <= 0:
        # If the curve is in contact from its first sample on, the path begins with a jump of the
        # depth.
        start_corners.append((0.0, float(delta[0])))
    else:
        t = np.append(0.0, t)
        delta = np.append(0.0, delta)
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
    """Return the time of first contact, interpolated between the samples around it."""
    first_index = int(np.argmax(delta > 0))
    if first_index == 0:
        return float(t[0])
    t_0, t_1 = t[first_index - 1 : first_index + 1]
    below, above = delta[first_index - 1 : first_index + 1]
    return float(t_0 + (t_1 - t_0) * -below / (above - below))


class MeasuredPathForces:
    """Force factor G(t) of a scene along a path, as a function of its shape parameters.

    `exponent` is the exponent p of the depth. Raises ForwardModelUnavailable if the scene has no
    solution along the path.
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
        """Return the force factor G [force/length^p] at times (n,) after first contact.

        theta are the transformed values of the shape parameters.
        """
        times = self.path.times
        return _interpolate_monotonically(
            times, self.grid.interpolate(theta), np.clip(t, times[0], times[-1])
        )

    def time_step_error(self, scene: Config, theta: Sequence[float], t: np.ndarray) -> np.ndarray:
        """Return the difference (n,) of G between a run with half the time step and interpolation.

        The difference estimates the error of time discretisation and interpolation; theta are the
        transformed parameters of the scene.
        """
        times = self.path.times
        difference = _force_factors(
            scene, self.path, self.exponent, step_refinement=2
        ) - self.grid.interpolate(theta)
        return np.interp(t, times, difference)

    @property
    def peak_force_factor(self) -> float:
        """G = F_run/delta_run^p of the unchanged scene when its largest depth is first reached."""
        t = next(
            t
            for t, delta in self.path.corners
            if delta >= (1 - 2 * CORNER_TOLERANCE) * self.path.max_depth
        )
        return float(np.interp(t, self.path.times, self.grid.scene_values))


def _coarsen_grid_step(parameter: Parameter) -> Parameter:
    """Return a parameter with the larger grid step of time-dependent runs."""
    if not parameter.is_linear:
        return replace(parameter, grid_step=HISTORY_LOG_STEP)
    # Upper bound: the diffusivity of a poroelastic body is undefined at 0.5.
    max_drained_nu = 0.45
    return replace(
        parameter, grid_step=HISTORY_LINEAR_STEP, high=min(parameter.high, max_drained_nu)
    )


def _force_factors(
    config: Config, path: MeasuredPath, exponent: float, step_refinement: int = 1
) -> np.ndarray:
    """Return the factors force/depth^exponent at the times of a path, from a run along it.

    The time steps are shortened by the factor `step_refinement`.
    """
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
            f"the run along the measured path failed: {rows[-1].reason if rows else 'no row'}"
        )
    t, delta, force = np.array([(row.t, row.delta, row.force) for row in rows], dtype=float).T
    # Shallower contacts have too few elements, so that G is taken from the first deeper one; the
    # fraction is relative to the largest depth.
    min_fraction = 0.05
    is_used = delta > min_fraction * path.max_depth
    # Two rows at a jump have the same time; only the second one is used.
    is_used[:-1] &= np.diff(t) > 0
    times = path.times
    return _interpolate_monotonically(
        t[is_used],
        force[is_used] / delta[is_used] ** exponent,
        np.clip(times, t[is_used][0], t[is_used][-1]),
    )


def _interpolate_monotonically(t: np.ndarray, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return values at points by piecewise cubic interpolation without overshoot (PCHIP)."""
    # This import takes 0.1 s, which elastic fits need not spend.
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(t, values)(points)  # type: ignore[no-any-return]
