"""Sensitivities: derivatives of the force with respect to keys of a scene, at every row.

All scenes are solved on one mesh, whose nodes move with the body's sides, the interfaces of its
layers and the edge of the contact. The relative discretisation error is then the same in all scenes
and cancels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import KeyPath, key_path
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run import pipeline
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.scene import Scene, resolve

Derivatives = dict[str, dict[str, list[float]]]


def sensitivities(config: Config, keys: Sequence[str], step: float = 0.02) -> Derivatives:
    """Return the derivatives dF/dkey at every row of a scene, in the user's units.

    Differences over relative steps h and 2 h are extrapolated, D = (4 * D_h - D_2h)/3. The
    differences are central if the scene exists for both changes of the key, otherwise backward. The
    error is |D_h - D_2h|/3 plus F/key times the relative error of the forces, which is 0.1 % if no
    accuracy is requested. All scenes have the same depths.

    Parameters
    ----------
    config
        The scene.
    keys
        Keys of numbers in the scene, such as "material.E".
    step
        Relative step h of a key.

    Returns
    -------
    dict
        {key: {"value": [...], "error": [...]}}

    Raises
    ------
    ConfigError
        For a key that is not a number of the scene, prescribed forces or a time-dependent scene.
    NotConverged
        If one of the scenes is not solved.
    """
    base = resolve(config)
    if base.physics.yields:
        raise ConfigError(
            "material.plasticity",
            "derivatives of the force of a body that yields are not computed",
            "leave it out, or run a study of the keys",
        )
    if base.physics.path.control != "depth" or base.is_time_dependent:
        raise ConfigError(
            "loading",
            "derivatives of the force can be computed only if depths are prescribed",
            "give loading.delta or deltas",
        )
    explicit = explicit_config(config, base)
    body = _MeshedScene(base)
    derivatives: Derivatives = {}
    for key in keys:
        path = key_path(key)
        value, error, forces = _derivative(explicit, path, body.forces, step)
        force_error = body.error * np.abs(forces / _key_value(explicit, path))
        derivatives[key] = {
            "value": list(map(float, value)),
            "error": list(map(float, error + force_error)),
        }
    return derivatives


class _MeshedScene:
    """Scene with a mesh that is mapped to slightly different scenes."""

    def __init__(self, scene: Scene):
        self.scene = scene
        self._grid = scene.grid() if scene.is_meshed else None

    @property
    def error(self) -> float:
        """Expected relative error of the forces."""
        plan = self.scene.plan
        if self._grid is None:
            return plan.theory.error if plan.theory else 0.0
        # Relative error of a force with automatic element sizes.
        mesh_error = 1e-3
        return plan.prediction.get("force_error", 0.0) + (
            plan.resolution.error if plan.resolution else mesh_error
        )

    def forces(self, config: Config) -> np.ndarray:
        """Return the force of a changed scene at every row [user's units]."""
        scene = resolve(config)
        mesher = (
            Scene.grid
            if self._grid is None
            else partial(Scene.adapt_grid, similar_scene=self.scene, grid=self._grid)
        )
        states = list(pipeline.states(scene, with_surface=False, mesher=mesher))
        if not all(state.converged for state in states):
            raise NotConverged(f"the scene with a changed key was not solved: {states[-1].reason}")
        return np.array([state.force for state in states])


def _derivative(
    config: Config, path: KeyPath, forces: Callable[[Config], np.ndarray], step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the extrapolated derivative, its error and a force, at every row.

    The derivative is (4 D_h - D_2h)/3, its error |D_h - D_2h|/3, with the difference quotients D_h
    and D_2h of relative steps h and 2 h. The returned force is that at a value of the key that is
    changed by one step.
    """
    value = _key_value(config, path)
    # Steps of a key that are tried, in this order.
    central_steps = (-2.0, -1.0, 1.0, 2.0)
    backward_steps = (-4.0, -2.0, -1.0, 0.0)
    for steps in (central_steps, backward_steps):
        with suppress(ConfigError):
            scenes = [_replace_value(config, path, value * (1 + n * step)) for n in steps]
            for scene in scenes:
                resolve(scene)
            forces_at_steps = [forces(scene) for scene in scenes]
            h = step * value
            if steps is central_steps:
                near_slope = (forces_at_steps[2] - forces_at_steps[1]) / (2 * h)
                far_slope = (forces_at_steps[3] - forces_at_steps[0]) / (4 * h)
            else:  # backward differences of second order
                near_slope = (
                    3 * forces_at_steps[3] - 4 * forces_at_steps[2] + forces_at_steps[1]
                ) / (2 * h)
                far_slope = (
                    3 * forces_at_steps[3] - 4 * forces_at_steps[1] + forces_at_steps[0]
                ) / (4 * h)
            return (
                (4 * near_slope - far_slope) / 3,
                np.abs(near_slope - far_slope) / 3,
                forces_at_steps[2],
            )
    # Resolving the changed scene raises the error that explains why it does not exist.
    resolve(_replace_value(config, path, value * (1 - step)))
    raise ConfigError(
        ".".join(map(str, path)),
        "neither a slightly smaller nor a slightly larger value gives a valid scene",
    )


def _key_value(config: Config, path: KeyPath) -> float:
    """Return the value of a key, in the units of the scene."""
    value: Any = to_mapping(config)
    with suppress(KeyError, IndexError, TypeError):
        for part in path:
            value = value[part]
        if isinstance(value, (int, float)) and not isinstance(value, bool) and value != 0:
            return float(value)
    key = ".".join(map(str, path))
    raise ConfigError(key, "is not a nonzero number of this scene", "give a key such as material.E")


def _replace_value(config: Config, path: KeyPath, value: float) -> Config:
    """Return the scene with another value of the key."""
    document: Any = to_mapping(config)
    section = document
    for part in path[:-1]:
        section = section[part]
    section[path[-1]] = value
    return config_from_mapping(document)
