"""Limits that keep a scene within double precision: size of numbers, ratio of lengths."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from indent_sim.model.units import ANGLE, LENGTH, Unit, field_units
from indent_sim.process.errors import ConfigError

# Key, absolute value and dimension of a number of a scene.
SceneNumber = tuple[str, float, Unit]


def limit_errors(sections: Mapping[str, Any]) -> list[ConfigError]:
    """Return errors of numbers that are too large, too small or too different.

    Parameters
    ----------
    sections
        Dataclasses of the sections of a scene by name.
    """
    numbers = [
        number for name, section in sections.items() for number in _scene_numbers(name, section)
    ]
    if errors := [error for number in numbers for error in _size_errors(*number)]:
        return errors
    lengths = [
        (size, key) for key, size, unit in numbers if unit == LENGTH and not key.startswith("mesh.")
    ]
    body = [(size, key) for size, key in lengths if key.startswith("body.")]
    # Largest ratio of two lengths of a body. Gmsh finds no mesh for more slender bodies.
    max_aspect_ratio = 1e5
    # Largest ratio of two lengths of a scene. A shorter length would be lost in rounding.
    max_length_ratio = 1e15
    return [
        *_ratio_errors(lengths, max_length_ratio, "lengths of one scene"),
        *_ratio_errors(body, max_aspect_ratio, "lengths of a body"),
    ][:1]


def _ratio_errors(
    lengths: list[tuple[float, str]], max_ratio: float, description: str
) -> Iterator[ConfigError]:
    """Yield the error of the smallest and the largest length if their ratio is too large."""
    small, small_key = min(lengths, default=(1.0, ""))
    large, large_key = max(lengths, default=(1.0, ""))
    if large > max_ratio * small:
        problem = f"{small:g} is too small compared with {large_key} = {large:g}"
        yield ConfigError(
            small_key, problem, f"{description} may differ by a factor of at most {max_ratio:g}"
        )


def _scene_numbers(name: str, section: Any) -> Iterator[SceneNumber]:
    """Yield the numbers with a dimension in a section and in its inner sections.

    For a list the largest number is yielded, and for lists of a body also the smallest number.
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
    """Yield the dataclasses in a value, with their keys."""
    if dataclasses.is_dataclass(value):
        yield key, value
    elif isinstance(value, dict):
        for name, part in value.items():
            yield from _inner_sections(f"{key}.{name}", part)
    elif isinstance(value, tuple):
        for index, part in enumerate(value):
            yield from _inner_sections(f"{key}[{index}]", part)


def _numbers(value: Any) -> Iterator[float]:
    """Yield the numbers of a value or of nested tuples."""
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    elif not dataclasses.is_dataclass(value):
        yield value


def _size_errors(key: str, size: float, unit: Unit) -> Iterator[ConfigError]:
    """Yield the error of a number that is too large or too small."""
    # Largest length, pressure or time, and reciprocal of the smallest one. Squares of
    # energies, which are pressure length^3, are then finite numbers.
    largest_quantity = 1e30
    # Number of base quantities of which each dimension is a product; a force is pressure length^2.
    base_count = {"length": 1, "pressure": 1, "time": 1, "force": 3}
    limit = largest_quantity ** sum(
        base_count[name] * abs(power) for name, power in unit.powers.items()
    )
    if not 1 / limit <= size <= limit:
        remedy = f"choose units in which it is between {1 / limit:g} and {limit:g}"
        yield ConfigError(key, f"{size:g} is beyond the range of numbers of the program", remedy)
