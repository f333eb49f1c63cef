"""Limits of numbers that are too large, too small or too different for arithmetic of 16 digits."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from indent_sim.model.units import ANGLE, LENGTH, Unit, field_units
from indent_sim.process.errors import ConfigError

LARGEST_QUANTITY = (
    1e30  # of a length, pressure or time, and one over the smallest: squares of energies are finite
)
BASE_QUANTITY_COUNT = {
    "length": 1,
    "pressure": 1,
    "time": 1,
    "force": 3,
}  # a force is pressure length^2
MAX_ASPECT_RATIO = 1e5  # of a body: beyond it gmsh finds no mesh
MAX_LENGTH_RATIO = (
    1e15  # between two lengths of a scene: beside the longer one, a shorter is lost in its rounding
)

SceneNumber = tuple[str, float, Unit]  # key, size, dimension


def limit_errors(sections: Mapping[str, Any]) -> list[ConfigError]:
    """What cannot be computed with in the dataclasses of a scene, by the name of their section."""
    numbers = [
        measure for name, section in sections.items() for measure in _scene_numbers(name, section)
    ]
    if problems := [problem for measure in numbers for problem in _size_errors(*measure)]:
        return problems
    lengths = [
        (size, key) for key, size, unit in numbers if unit == LENGTH and not key.startswith("mesh.")
    ]
    body = [(size, key) for size, key in lengths if key.startswith("body.")]
    return [
        *_ratio_errors(lengths, MAX_LENGTH_RATIO, "lengths of one scene"),
        *_ratio_errors(body, MAX_ASPECT_RATIO, "lengths of a body"),
    ][:1]


def _ratio_errors(
    lengths: list[tuple[float, str]], max_ratio: float, description: str
) -> Iterator[ConfigError]:
    (small, small_key) = min(lengths, default=(1.0, ""))
    (large, large_key) = max(lengths, default=(1.0, ""))
    if large > max_ratio * small:
        problem = f"{small:g} is too small beside {large_key} = {large:g}"
        yield ConfigError(
            small_key, problem, f"{description} may differ by a factor of {max_ratio:g}"
        )


def _scene_numbers(name: str, section: Any) -> Iterator[SceneNumber]:
    """The numbers of a section, and those in it, that have a dimension; of a list the largest, of a
    body both ends.
    """
    for field, unit in field_units(type(section)).items():  # type: ignore[arg-type]
        value = getattr(section, field)
        for key, inner in _inner_sections(f"{name}.{field}", value):
            yield from _scene_numbers(key, inner)
        if not isinstance(unit, Unit) or unit == ANGLE or value is None or isinstance(value, str):
            continue
        if sizes := [abs(number) for number in _numbers(value)]:
            checked_sizes = {max(sizes), min(sizes)} if name == "body" else {max(sizes)}
            yield from ((f"{name}.{field}", size, unit) for size in checked_sizes - {0.0})


def _inner_sections(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    if dataclasses.is_dataclass(value):
        yield key, value
    named = (
        {f"{key}.{name}": part for name, part in value.items()} if isinstance(value, dict) else {}
    )
    listed = (
        {f"{key}[{index}]": part for index, part in enumerate(value)}
        if isinstance(value, tuple)
        else {}
    )
    for inner, part in (named | listed).items():
        yield from _inner_sections(inner, part)


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    elif not dataclasses.is_dataclass(value):
        yield value


def _size_errors(key: str, size: float, unit: Unit) -> Iterator[ConfigError]:
    limit = LARGEST_QUANTITY ** sum(
        BASE_QUANTITY_COUNT[name] * abs(power) for name, power in unit.powers.items()
    )
    if not 1 / limit <= size <= limit:
        remedy = f"choose units in which it lies between {1 / limit:g} and {limit:g}"
        yield ConfigError(key, f"{size:g} is beyond what can be computed with", remedy)
