"""The values of `vary`: lists and ranges, crossed or zipped, as points of a grid."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.config.scene_file import Place
from indent_sim.config.schema import Source
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.process.errors import ConfigError

RANGE = ("from", "to", "count", "spacing", "unit")
STIFFNESS_UNIT = "E*/h_contact"
MOST_RUNS = 100_000  # runs of one study
LARGEST_RANGE_END = 1e100  # end of a range, beyond all that a scene can hold


@dataclass(frozen=True)
class Multiple:
    """A value in units of the scene's own E*/h_contact."""

    factor: float


Setting = tuple[str, Any, Place]  # dotted key, value, where that is written
Point = tuple[Setting, ...]


@dataclass(frozen=True)
class Block:
    """One grid: axes that are crossed; the keys of one axis go together, value by value."""

    axes: tuple[tuple[Point, ...], ...]

    @property
    def size(self) -> int:
        """How many points it has."""
        return math.prod(map(len, self.axes))

    @property
    def keys(self) -> tuple[str, ...]:
        """The varied keys in order."""
        return tuple(key for axis in self.axes for key, _, _ in axis[0])


def points(block: Block) -> Iterator[Point]:
    """The points of a grid; the last axis varies fastest."""
    for chosen in itertools.product(*block.axes):
        yield tuple(setting for part in chosen for setting in part)


def read_block(part: Mapping[str, Any], keys: KeyPath, source: Source) -> Block:
    """The grid of one section of `vary`; `zip: true` or `zip: [keys]` says which keys go together."""
    values = {
        key: _values(wanted, (*keys, key), key, source)
        for key, wanted in part.items()
        if key != "zip"
    }
    together = _zipped(part.get("zip", False), values, (*keys, "zip"), source)
    axes: list[tuple[Point, ...]] = []
    for key, settings in values.items():
        if key not in together:
            axes.append(tuple((setting,) for setting in settings))
        elif key == together[0]:
            axes.append(tuple(zip(*(values[name] for name in together), strict=True)))
    return Block(tuple(axes))


def _zipped(wanted: Any, values: Mapping[str, Any], keys: KeyPath, source: Source) -> list[str]:
    """The keys that go together, in the order of the block."""
    if isinstance(wanted, bool):
        together = list(values) if wanted else []
    elif isinstance(wanted, list) and all(
        key in list(values) for key in wanted
    ):  # whatever they are
        together = [key for key in values if key in wanted]
    else:
        raise _error(
            keys,
            source,
            "must be true, or a list of keys varied here",
            f"these are {', '.join(values)}",
        )
    lengths = {key: len(values[key]) for key in together}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{key} has {count}" for key, count in lengths.items())
        raise _error(keys, source, f"keys that go together need equally many values: {told}")
    return together


def _values(wanted: Any, keys: KeyPath, key: str, source: Source) -> list[Setting]:
    """The settings of one key: each item of a list, the numbers of a range, or a single word or
    number.
    """
    if isinstance(wanted, dict) and "from" in wanted:
        return [(key, value, source.place(keys)) for value in _range(wanted, keys, source)]
    if isinstance(wanted, list):
        if not wanted:
            raise _error(keys, source, "has no values")
        return [(key, value, source.place((*keys, index))) for index, value in enumerate(wanted)]
    if wanted is None or isinstance(wanted, dict):
        raise _error(keys, source, "must be a list of values, or a range {from, to, count}")
    return [(key, wanted, source.place(keys))]


def _range(wanted: Mapping[str, Any], keys: KeyPath, source: Source) -> list[Any]:
    """`count` numbers from one to another, equally far apart or by equal factors."""
    if unknown := [key for key in wanted if key not in RANGE]:
        raise _error((*keys, unknown[0]), source, "unknown key", f"a range has {', '.join(RANGE)}")
    first, last = (_number(wanted, end, keys, source) for end in ("from", "to"))
    count = wanted.get("count")
    spacing = wanted.get("spacing", "linear")
    unit = wanted.get("unit", 1)
    if type(count) is not int or not 1 <= count <= MOST_RUNS:
        raise _error((*keys, "count"), source, f"must be a whole number from 1 to {MOST_RUNS}")
    if spacing not in ("linear", "log"):
        raise _error((*keys, "spacing"), source, "must be linear or log")
    if unit not in (1, STIFFNESS_UNIT):
        raise _error((*keys, "unit"), source, f"must be {STIFFNESS_UNIT}")
    if spacing == "log" and not (first > 0 and last > 0):
        raise _error((*keys, "from"), source, "must be > 0 for spacing: log")
    numbers = (
        np.geomspace(first, last, count) if spacing == "log" else np.linspace(first, last, count)
    )
    values = [float(f"{number:.12g}") for number in numbers]
    if unit == STIFFNESS_UNIT:
        return [Multiple(value) for value in values]
    whole = type(first) is type(last) is int and all(value.is_integer() for value in values)
    return [int(value) for value in values] if whole else values


def _number(wanted: Mapping[str, Any], end: str, keys: KeyPath, source: Source) -> int | float:
    value = wanted.get(end)
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or abs(value) > LARGEST_RANGE_END
    ):
        raise _error(
            (*keys, end), source, f"must be a number of size {LARGEST_RANGE_END:g} at most"
        )
    return value


def _error(keys: KeyPath, source: Source, problem: str, remedy: str = "") -> ConfigError:
    return ConfigError(key_text(keys), problem, remedy, *source.place(keys))
