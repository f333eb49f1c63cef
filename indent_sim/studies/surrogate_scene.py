"""Scene of a surrogate, for a fit whose forces the surrogate gives."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.studies.surrogate import KIND, MAX_BYTES, Surrogate

DEPTH_KEY = "loading.delta"


def is_surrogate_file(path: Path) -> bool:
    """Return whether a file is a surrogate, by its content."""
    try:
        content = read_regular_file(path)
        if len(content) > MAX_BYTES or not content.lstrip().startswith(b"{"):
            return False
        data = json.loads(content)
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and data.get("kind") == KIND


def scene_of_surrogate(
    surrogate: Surrogate, path: Path, overrides: Sequence[str], varied_keys: Sequence[str]
) -> Config:
    """Return the scene of a surrogate with the values that a fit gives and begins with.

    Parameters
    ----------
    surrogate, path
        The surrogate and its file.
    overrides
        Values of keys, in the form of the option --set.
    varied_keys
        Keys of the fit, which begin in the middle of their ranges unless they are set.

    Raises
    ------
    UsageError
        If the file is of an earlier version, without scene.
    ConfigError
        If the scene has errors, or a key of the surrogate has no value.
    """
    document = surrogate.information.get("scene")
    if document is None:
        raise UsageError(
            f"{path} was written by an earlier version and does not contain the scene of its "
            "study, which a fit needs",
            "make it again with indent-sim study STUDY --surrogate force",
            str(path),
        )
    set_keys = [text.partition("=")[0].strip() for text in overrides]
    config = config_from_mapping(document, tuple(overrides))
    for key in surrogate.ranges:
        sections = [
            name for name in set_keys if key == name or key.startswith((f"{name}.", f"{name}["))
        ]
        if key != DEPTH_KEY and key not in varied_keys and not sections:
            low, high = surrogate.ranges[key]
            raise ConfigError(
                key,
                f"has no value: in the study of the surrogate it varies from {low:g} to {high:g}",
                f"give --set {key}=... or --vary {key}",
                str(path),
            )
    return config
