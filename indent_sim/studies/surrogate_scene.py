"""Scene of a surrogate, for a fit whose forces the surrogate gives."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from indent_sim.config.key_dimensions import DEPTH_KEY, DIMENSIONLESS, key_numbers
from indent_sim.config.scene_file import (
    Overrides,
    config_from_mapping,
    config_with_settings,
    to_mapping,
)
from indent_sim.config.schema import Config
from indent_sim.process.errors import ConfigError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.studies.surrogate import KIND, MAX_BYTES, Surrogate, middle_values


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
    surrogate: Surrogate, path: Path, overrides: Overrides, varied_keys: Sequence[str]
) -> Config:
    """Return the scene of a surrogate with the values that a fit gives and begins with.

    Parameters
    ----------
    surrogate, path
        The surrogate and its file.
    overrides
        Values of keys, as in `load`.
    varied_keys
        Keys of the fit. Those that are not set begin in the middle of their ranges, scaled with
        fixed keys of the same dimension.

    Raises
    ------
    ConfigError
        If the scene has errors, or a key of the surrogate has no value.
    """
    config = config_from_mapping(surrogate.information["scene"], overrides)
    for key, (low, high) in surrogate.ranges.items():
        if key not in {DEPTH_KEY, *varied_keys} and not _is_set(key, overrides):
            raise ConfigError(
                key,
                f"has no value: in the study of the surrogate it varies from {low:g} to {high:g}",
                f"give --set {key}=... or --vary {key}",
                str(path),
            )
    begun = [key for key in varied_keys if key in surrogate.ranges and not _is_set(key, overrides)]
    factors = {key: _size_factor(surrogate, config, key) for key in begun}
    middle = middle_values({key: surrogate.ranges[key] for key in begun})
    settings = [(key, factors[key] * middle[key], (str(path), None)) for key in begun]
    return config_with_settings(to_mapping(config), config.source, settings)


def _is_set(key: str, overrides: Overrides) -> bool:
    """Return whether a key, or a section that contains it, is among the settings."""
    names = [setting.partition("=")[0].strip() for setting in overrides]
    return any(key == name or key.startswith((f"{name}.", f"{name}[")) for name in names)


def _size_factor(surrogate: Surrogate, config: Config, key: str) -> float:
    """Return the geometric mean by which fixed keys with the dimension of a key have changed.

    The range of a height, for example, grows with the radius of the tip.
    """
    numbers = key_numbers(to_mapping(config))
    ratios = [
        numbers[name].value / value
        for name, value in surrogate.fixed.items()
        if name in numbers
        and name != DEPTH_KEY
        and numbers[name].dimension == numbers[key].dimension
        and numbers[key].dimension != DIMENSIONLESS
    ]
    changed = [ratio for ratio in ratios if ratio > 0 and ratio != 1.0]
    return math.exp(sum(map(math.log, changed)) / len(changed)) if changed else 1.0
