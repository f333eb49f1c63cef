"""Limits of numbers: too large, small or unlike for arithmetic of 16 digits, before they become 0,
inf or nan.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from indent_sim.model.units import ANGLE, LENGTH, Unit, field_units
from indent_sim.process.errors import ConfigError

LARGEST_QUANTITY = (
    1e30  # of a length, pressure or time, and one over the smallest: squares of energies are finite
)
QUANTITIES_IN = {"length": 1, "pressure": 1, "time": 1, "force": 3}  # a force is pressure length^2
LARGEST_ASPECT = 1e5  # of a body: beyond it gmsh finds no mesh
UNLIKE = (
    1e15  # between two lengths of a scene: beside the longer one, a shorter is lost in its rounding
)

Measure = tuple[str, float, Unit]  # key, size, dimension


def beyond(sections: Mapping[str, Any]) -> list[ConfigError]:
    """What cannot be computed with in the dataclasses of a scene, by the name of their section."""
    found = [measure for name, section in sections.items() for measure in _measures(name, section)]
    if problems := [problem for measure in found for problem in _beyond(*measure)]:
        return problems
    lengths = [
        (size, key) for key, size, unit in found if unit == LENGTH and not key.startswith("mesh.")
    ]
    body = [(size, key) for size, key in lengths if key.startswith("body.")]
    return [
        *_unlike(lengths, UNLIKE, "lengths of one scene"),
        *_unlike(body, LARGEST_ASPECT, "lengths of a body"),
    ][:1]


def _unlike(lengths: list[tuple[float, str]], most: float, whose: str) -> Iterator[ConfigError]:
    (small, one) = min(lengths, default=(1.0, ""))
    (large, other) = max(lengths, default=(1.0, ""))
    if large > most * small:
        problem = f"{small:g} is too small beside {other} = {large:g}"
        yield ConfigError(one, problem, f"{whose} may differ by a factor of {most:g}")


def _measures(name: str, section: Any) -> Iterator[Measure]:
    """The numbers of a section, and those in it, that have a dimension; of a list the largest, of a
    body both ends.
    """
    for field, unit in field_units(type(section)).items():  # type: ignore[arg-type]
        value = getattr(section, field)
        for key, inner in _inner_sections(f"{name}.{field}", value):
            yield from _measures(key, inner)
        if not isinstance(unit, Unit) or unit == ANGLE or value is None or isinstance(value, str):
            continue
        if sizes := [abs(number) for number in _numbers(value)]:
            told = {max(sizes), min(sizes)} if name == "body" else {max(sizes)}
            yield from ((f"{name}.{field}", size, unit) for size in told - {0.0})


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


def _beyond(key: str, size: float, unit: Unit) -> Iterator[ConfigError]:
    most = LARGEST_QUANTITY ** sum(
        QUANTITIES_IN[name] * abs(power) for name, power in unit.powers.items()
    )
    if not 1 / most <= size <= most:
        remedy = f"choose units in which it lies between {1 / most:g} and {most:g}"
        yield ConfigError(key, f"{size:g} is beyond what can be computed with", remedy)
