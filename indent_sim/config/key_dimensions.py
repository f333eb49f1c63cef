"""Dimensions of the keys of a scene document, as powers of length, force and time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any

from indent_sim.config import key_types, schema
from indent_sim.config.strict_yaml import key_text
from indent_sim.model.units import Unit, UnitRow

# Powers of length, force and time.
Dimension = tuple[int, int, int]
DIMENSIONLESS: Dimension = (0, 0, 0)
# Key of the depth of a load curve.
DEPTH_KEY = "loading.delta"


@dataclass(frozen=True)
class KeyNumber:
    """Number of a key with its dimension."""

    value: float
    dimension: Dimension


def key_numbers(document: Mapping[str, Any]) -> dict[str, KeyNumber]:
    """Return the numbers of a document, whose quantities are converted, by their dotted keys."""
    is_flat = is_plane_strain(document)
    return {
        key: KeyNumber(value, _dimension(unit, is_flat))
        for key, value, unit in _numbers(schema.node_at((), document), None, document)
    }


def is_plane_strain(document: Mapping[str, Any]) -> bool:
    """Return whether the forces of a scene are per unit length."""
    body = document.get("body")
    return isinstance(body, Mapping) and (
        body.get("shape") == "strip" or body.get("kinematics") == "plane_strain"
    )


def column_dimension(column: str, is_flat: bool) -> Dimension:
    """Return the dimension of a column: force, a (a length) or p_max (a pressure)."""
    units = {"force": Unit("force"), "a": Unit("length"), "p_max": Unit("pressure")}
    return _dimension(units[column], is_flat)


def _numbers(
    node: schema.SchemaNode, list_unit: Unit | UnitRow | None, document: Mapping[str, Any]
) -> Iterator[tuple[str, float, Unit | UnitRow | None]]:
    """Yield key, value and unit of every number below a node."""
    if isinstance(node.value, dict):
        for part in node.children():
            yield from _numbers(part, None, document)
        return
    unit = schema.node_unit(node, document) or list_unit
    if isinstance(node.value, list):
        units = chain(unit.units, repeat(None)) if isinstance(unit, UnitRow) else repeat(unit)
        for item, item_unit in zip(node.children(), units, strict=False):
            yield from _numbers(item, item_unit, document)
        return
    if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
        return
    if {key_types.bare_type(part) for part in key_types.union_members(node.type)} & {float, int}:
        unit = unit.units[-1] if isinstance(unit, UnitRow) else unit
        yield key_text(node.path), float(node.value), unit


def _dimension(unit: Unit | UnitRow | None, is_flat: bool) -> Dimension:
    """Return the dimension of a unit; angles are dimensionless."""
    if not isinstance(unit, Unit):
        return DIMENSIONLESS
    powers = unit.powers
    pressure = powers.get("pressure", 0)
    # Forces of a body in plane strain are per unit length.
    length = powers.get("length", 0) - pressure * (1 if is_flat else 2)
    return length, powers.get("force", 0) + pressure, powers.get("time", 0)
