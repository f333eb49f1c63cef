"""Scene of a fit: a scene, or that of a surrogate, which then gives the forces."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from indent_sim.config.scene_file import Overrides, SceneInput, load
from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.surrogate_load_curves import refuse_unusable
from indent_sim.studies import surrogate_scene
from indent_sim.studies.surrogate import Surrogate, read_surrogate


def scene_or_surrogate(
    given: SceneInput, overrides: Overrides, keys: Sequence[str]
) -> tuple[Config, Surrogate | None]:
    """Return the scene of a fit, and the surrogate if the scene is given as the file of one.

    Parameters
    ----------
    given
        Scene, or file of a scene or of a surrogate.
    overrides
        Values of keys of the scene.
    keys
        Keys of the fit.

    Raises
    ------
    ConfigError
        If the scene has errors, or the surrogate is not usable in the fit.
    """
    path = Path(given) if isinstance(given, str | os.PathLike) else None
    if path is None or not surrogate_scene.is_surrogate_file(path):
        return load(given, overrides), None
    surrogate = read_surrogate(path)
    config = surrogate_scene.scene_of_surrogate(surrogate, path, overrides, keys)
    refuse_unusable(surrogate, config, keys)
    return config, surrogate
