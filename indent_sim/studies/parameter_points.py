"""Points of a parameter grid from the lists and ranges of `vary`, as product or zipped."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from indent_sim.config.scene_sections import Source
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.process.errors import ConfigError
from indent_sim.studies.parameter_values import (
    STIFFNESS_UNIT,
    ParameterPoint,
    Setting,
    StiffnessMultiple,
)
from indent_sim.studies.sample import MAX_SAMPLED_KEYS, Sample, SampledRange

RANGE_KEYS = ("from", "to", "count", "spacing", "unit")
# Largest number of runs of one study, and of values of one key.
MAX_RUNS = 1_000_000
MAX_VALUES = 100_000
# Largest end of a range. It exceeds every quantity of a scene, and a product of two does not
# overflow.
LARGEST_RANGE_END = 1e100


@dataclass(frozen=True)
class ParameterBlock:
    """Grid of parameter points: the product of its axes; the keys of one axis vary together.

    The points of a sample are the first axis of the grid, so that a larger sample appends points at
    the end.
    """

    axes: tuple[tuple[ParameterPoint, ...], ...]
    sample: Sample | None = None

    @property
    def size(self) -> int:
        """The number of points."""
        return math.prod(map(len, self.axes)) * (self.sample.count if self.sample else 1)

    @property
    def keys(self) -> tuple[str, ...]:
        """The varied keys in order."""
        grid_keys = tuple(key for axis in self.axes for key, _, _ in axis[0])
        return (*self.sample.keys, *grid_keys) if self.sample else grid_keys


def grid_points(block: ParameterBlock) -> Iterator[ParameterPoint]:
    """Yield the points of a grid; the last axis varies fastest."""
    sample_points = block.sample.points() if block.sample else iter([()])
    for sample_point in sample_points:
        for combination in itertools.product(*block.axes):
            yield (*sample_point, *(setting for part in combination for setting in part))


def read_block(
    part: Mapping[str, Any], keys: KeyPath, source: Source, sample: Sample | None = None
) -> ParameterBlock:
    """Read the grid and the sampled ranges of one section of `vary`.

    Parameters
    ----------
    part
        Keys and values; `zip: true` or `zip: [keys]` lets keys vary together.
    keys, source
        Place of the section in the document, and file and line of each key, for error messages.
    sample
        The sample of the study, to which the ranges of this section are added; None if the study is
        not sampled. A section without ranges is a grid beside the sample.
    """
    ranges = (
        {
            key: _sampled_range(values_given, (*keys, key), key, source)
            for key, values_given in part.items()
            if isinstance(values_given, dict) and "from" in values_given
        }
        if sample
        else {}
    )
    values = {
        key: _read_values(values_given, (*keys, key), key, source)
        for key, values_given in part.items()
        if key != "zip" and key not in ranges
    }
    zipped_keys = _zipped_keys(part.get("zip", False), values, (*keys, "zip"), source)
    axes: list[tuple[ParameterPoint, ...]] = []
    for key, settings in values.items():
        if key not in zipped_keys:
            axes.append(tuple((setting,) for setting in settings))
        elif key == zipped_keys[0]:
            axes.append(tuple(zip(*(values[name] for name in zipped_keys), strict=True)))
    if sample is None or not ranges:
        return ParameterBlock(tuple(axes))
    if len(ranges) > MAX_SAMPLED_KEYS:
        raise _config_error(
            keys,
            source,
            f"a sample has at most {MAX_SAMPLED_KEYS} ranges; there are {len(ranges)}",
            "give lists of values in place of some of them",
        )
    return ParameterBlock(tuple(axes), replace(sample, ranges=tuple(ranges.values())))


def _zipped_keys(
    zip_given: Any, values: Mapping[str, Any], keys: KeyPath, source: Source
) -> list[str]:
    """Return the keys that vary together, in the order of the block."""
    if isinstance(zip_given, bool):
        zipped_keys = list(values) if zip_given else []
    elif isinstance(zip_given, list) and all(key in list(values) for key in zip_given):
        zipped_keys = [key for key in values if key in zip_given]
    else:
        raise _config_error(
            keys,
            source,
            "must be true, or a list of keys of this section",
            f"its keys are {', '.join(values)}",
        )
    lengths = {key: len(values[key]) for key in zipped_keys}
    if len(set(lengths.values())) > 1:
        counts_text = ", ".join(f"{key} has {count}" for key, count in lengths.items())
        raise _config_error(
            keys, source, f"zipped keys need the same number of values: {counts_text}"
        )
    return zipped_keys


def _read_values(values_given: Any, keys: KeyPath, key: str, source: Source) -> list[Setting]:
    """Return the settings of one key, which is given as a list, a range, or a single value."""
    if isinstance(values_given, dict) and "from" in values_given:
        return [
            (key, value, source.location(keys))
            for value in _range_values(values_given, keys, source)
        ]
    if isinstance(values_given, list):
        if not values_given:
            raise _config_error(keys, source, "has no values")
        if len(values_given) > MAX_VALUES:
            raise _config_error(
                keys, source, f"has {len(values_given)} values, at most {MAX_VALUES} are allowed"
            )
        return [
            (key, value, source.location((*keys, index)))
            for index, value in enumerate(values_given)
        ]
    if values_given is None or isinstance(values_given, dict):
        raise _config_error(keys, source, "must be a list of values, or a range {from, to, count}")
    return [(key, values_given, source.location(keys))]


def _range_values(range_given: Mapping[str, Any], keys: KeyPath, source: Source) -> list[Any]:
    """Return `count` numbers from `from` to `to`, with linear or logarithmic spacing."""
    first, last, spacing, unit = _range_parts(range_given, keys, source)
    count = range_given.get("count")
    if type(count) is not int or not 1 <= count <= MAX_VALUES:
        raise _config_error(
            (*keys, "count"), source, f"must be a whole number from 1 to {MAX_VALUES}"
        )
    numbers = (
        np.geomspace(first, last, count) if spacing == "log" else np.linspace(first, last, count)
    )
    values = [float(f"{number:.12g}") for number in numbers]
    if unit == STIFFNESS_UNIT:
        return [StiffnessMultiple(value) for value in values]
    is_integer = type(first) is type(last) is int and all(value.is_integer() for value in values)
    return [int(value) for value in values] if is_integer else values


def _sampled_range(
    range_given: Mapping[str, Any], keys: KeyPath, key: str, source: Source
) -> SampledRange:
    """Return a range whose values are sampled."""
    first, last, spacing, unit = _range_parts(range_given, keys, source)
    if "count" in range_given:
        raise _config_error(
            (*keys, "count"), source, "is not allowed in a sampled range", "set sample.count"
        )
    if first == last:
        raise _config_error((*keys, "to"), source, "must differ from `from` in a sampled range")
    is_stiffness = unit == STIFFNESS_UNIT
    return SampledRange(
        key, float(first), float(last), spacing == "log", is_stiffness, source.location(keys)
    )


def _range_parts(
    range_given: Mapping[str, Any], keys: KeyPath, source: Source
) -> tuple[int | float, int | float, str, Any]:
    """Return the ends of a range, its spacing and its unit."""
    if unknown := [key for key in range_given if key not in RANGE_KEYS]:
        raise _config_error(
            (*keys, unknown[0]), source, "unknown key", f"its keys are {', '.join(RANGE_KEYS)}"
        )
    first, last = (_range_end(range_given, end, keys, source) for end in ("from", "to"))
    spacing = range_given.get("spacing", "linear")
    unit = range_given.get("unit", 1)
    if spacing not in ("linear", "log"):
        raise _config_error((*keys, "spacing"), source, "must be linear or log")
    if unit not in (1, STIFFNESS_UNIT):
        raise _config_error((*keys, "unit"), source, f"must be {STIFFNESS_UNIT}")
    if spacing == "log" and not (first > 0 and last > 0):
        raise _config_error((*keys, "from"), source, "must be > 0 for spacing: log")
    return first, last, spacing, unit


def _range_end(
    range_given: Mapping[str, Any], end: str, keys: KeyPath, source: Source
) -> int | float:
    """Return the number `from` or `to` of a range."""
    value = range_given.get(end)
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or abs(value) > LARGEST_RANGE_END
    ):
        raise _config_error(
            (*keys, end),
            source,
            f"must be a number between {-LARGEST_RANGE_END:g} and {LARGEST_RANGE_END:g}",
            "write it in the units of the scene, without a unit",
        )
    return value


def _config_error(keys: KeyPath, source: Source, problem: str, remedy: str = "") -> ConfigError:
    """Return the ConfigError for a key, with its file and line."""
    return ConfigError(key_text(keys), problem, remedy, *source.location(keys))
