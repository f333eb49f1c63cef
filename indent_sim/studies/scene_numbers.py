"""Numbers of the keys of a scene with changed settings, for conditions between keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from indent_sim.config.scene_file import quantities_of
from indent_sim.config.scene_sections import Source
from indent_sim.config.strict_yaml import key_path
from indent_sim.process.errors import ConfigError
from indent_sim.studies.condition import Condition
from indent_sim.studies.parameter_values import ParameterPoint, Setting


class SceneNumbers:
    """Numbers of keys of a study's scene, in the units of the scene.

    Parameters
    ----------
    base, source
        Document of the scene, and file and line of each of its keys.
    common_settings
        Settings of every run.
    """

    def __init__(self, base: Mapping[str, Any], source: Source, common_settings: ParameterPoint):
        self._base = base
        self._source = source
        self._common_settings = common_settings

    def fulfil(self, condition: Condition, point: ParameterPoint) -> bool:
        """Return whether a point fulfils a condition.

        Raises ConfigError if a key of the condition has no number.
        """
        numbers = {key: self._number(key, point, condition.text) for key in condition.keys}
        return condition.holds(numbers)

    def _number(self, key: str, point: ParameterPoint, condition: str) -> float:
        """Return the number of a key of a condition at a point; ConfigError if it has none."""
        value = self._value(key, (*self._common_settings, *point))
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return float(value)
        if isinstance(value, str):
            quantities = quantities_of(self._base, (*self._common_settings, *point))
            if key_path(key) in quantities:
                return quantities[key_path(key)][1]
        problem = f'has no number in this study, which the condition "{condition}" needs'
        remedy = (
            "write a number for it in the scene, in set or in vary; a value of auto does "
            "not suffice"
        )
        raise ConfigError(key, problem, remedy, *self._source.location(key_path(key)))

    def _value(self, key: str, settings: Sequence[Setting]) -> Any:
        """Return the value of a key from its last setting, or from that of a section above it."""
        path = key_path(key)
        for set_key, value, _ in reversed(settings):
            set_path = key_path(set_key)
            if path[: len(set_path)] == set_path:
                return _entry(value, path[len(set_path) :])
        return _entry(self._base, path)


def _entry(value: Any, path: Sequence[str | int]) -> Any:
    """Return the entry of nested mappings and lists at a path; None if there is no such entry."""
    for part in path:
        if isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, list) and isinstance(part, int) and part < len(value):
            value = value[part]
        else:
            return None
    return value
