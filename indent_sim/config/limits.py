"""Limits of numbers: too large, small or unlike for arithmetic of 16 digits, before they become 0, inf or nan."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from indent_sim.model.units import LENGTH, Unit, field_units
from indent_sim.process.errors import ConfigError

LARGEST = 1e30  # of a length or pressure, and one over the smallest: squares of energies are still finite
SLENDER = 1e5  # of a body: beyond it gmsh finds no mesh
UNLIKE = 1e15  # between two lengths of a scene: beside the longer one, a shorter is lost in its rounding

FORCE = Unit(length=2, pressure=1)
Measure = tuple[str, float, Unit]  # key, size, dimension


def beyond(sections: Mapping[str, Any]) -> list[ConfigError]:
    """What cannot be computed with in the dataclasses of a scene, by the name of their section."""
    found = [measure for name, section in sections.items() for measure in _measures(name, section)]
    if problems := [_beyond(*measure) for measure in found if not _is_finite(*measure[1:])]:
        return problems
    lengths = [(size, key) for key, size, unit in found if unit == LENGTH and not key.startswith("mesh.")]
    body = [(size, key) for size, key in lengths if key.startswith("body.")]
    return [*_unlike(lengths, UNLIKE, "lengths of one scene"), *_unlike(body, SLENDER, "lengths of a body")][:1]


def _unlike(lengths: list[tuple[float, str]], most: float, whose: str) -> Iterator[ConfigError]:
    (small, one), (large, other) = min(lengths, default=(1.0, "")), max(lengths, default=(1.0, ""))
    if large > most * small:
        problem = f"{small:g} is too small beside {other} = {large:g}"
        yield ConfigError(one, problem, f"{whose} may differ by a factor of {most:g}")


def _measures(name: str, section: Any) -> Iterator[Measure]:
    """The numbers of a section that have a dimension, zeros left out; of a list the largest, of a body both ends.

    Sections inside a section, alone or in a list, are looked at in turn.
    """
    for field, unit in field_units(type(section)).items():  # type: ignore[arg-type]
        value = getattr(section, field)
        for key, inner in _inner_sections(f"{name}.{field}", value):
            yield from _measures(key, inner)
        unit = FORCE if field in ("force", "forces") else unit  # which are scaled by the kind of body
        if unit is None or value is None or isinstance(value, str):
            continue
        sizes = [abs(number) for number in _numbers(value)]
        if not sizes:
            continue
        for size in {max(sizes), min(sizes)} if name == "body" else {max(sizes)} - {0.0}:
            yield f"{name}.{field}", size, unit


def _inner_sections(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    if dataclasses.is_dataclass(value):
        yield key, value
    elif isinstance(value, dict):
        for name, part in value.items():
            yield from _inner_sections(f"{key}.{name}", part)
    elif isinstance(value, tuple):
        for index, part in enumerate(value):
            yield from _inner_sections(f"{key}[{index}]", part)


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    elif not dataclasses.is_dataclass(value):
        yield value


def _is_finite(size: float, unit: Unit) -> bool:
    most = _most(unit)
    return 1 / most <= size <= most


def _most(unit: Unit) -> float:
    return LARGEST ** (abs(unit.length) + abs(unit.pressure))


def _beyond(key: str, size: float, unit: Unit) -> ConfigError:
    most = _most(unit)
    return ConfigError(key, f"{size:g} is beyond what can be computed with",
                       f"choose units in which it lies between {1 / most:g} and {most:g}")  # fmt: skip
