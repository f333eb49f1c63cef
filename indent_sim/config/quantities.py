"""Conversion of quantities with a unit, "2.5 um" or "1 kPa", to the units of the scene.

The decimal arithmetic is exact except for radians, and rounded once at the end. A scene with mixed
units therefore gives exactly the same numbers as a scene with plain numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from decimal import Decimal
from functools import cache
from itertools import chain, repeat
from math import pi
from typing import Any

from indent_sim.config import key_types, schema
from indent_sim.config.messages import closest_match
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.model.units import (
    ANGLE,
    FORCE,
    LENGTH,
    PRESSURE,
    STIFFNESS,
    TIME,
    Unit,
    UnitRow,
    field_units,
    parse_unit_factors,
)
from indent_sim.process.errors import ConfigError, ConfigErrors

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
QUANTITY_PATTERN = re.compile(
    rf"\s*(?P<number>{NUMBER})\s*(?P<unit>[^\W\d_]\S*(?: [*/·] ?\S+| s\b\S*)*|[%°])\s*"
)
DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+\D*")
# Examples of quantities in error messages, by their dimension.
QUANTITY_EXAMPLES = {
    LENGTH: "2.5 um",
    PRESSURE: "1 kPa",
    FORCE: "3 nN",
    STIFFNESS: "2 kPa/um",
    Unit("force/length"): "3 mN/m",
    Unit("length/force"): "2 um/mN",
    Unit("length^2/force"): "2 um^2/mN",
    TIME: "0.1 s",
    Unit("1/time"): "10 Hz",
    Unit("length^2/time"): "40 um^2/s",
    Unit("length^2/(pressure time)"): "2 um^2/(kPa s)",
    Unit("pressure time"): "5 Pa s",
}
# Units of angles [degrees].
ANGLES = {
    "deg": 1.0,
    "degree": 1.0,
    "degrees": 1.0,
    "°": 1.0,
    "rad": 180 / pi,
    "radian": 180 / pi,
}
# Examples of the units of a scene in error messages. Times are always in seconds.
UNIT_EXAMPLES = {"length": "um", "force": "nN"}
# Exponents of length, force and time of the base quantities of `model.units`.
BASE_EXPONENTS = {
    "length": {"length": 1},
    "force": {"force": 1},
    "pressure": {"force": 1, "length": -2},
    "time": {"time": 1},
}
KIND_EXPONENTS = BASE_EXPONENTS | {
    "force per length": {"force": 1, "length": -1},
    "energy": {"force": 1, "length": 1},
    "angle": {"angle": 1},
    "pressure per length": {"force": 1, "length": -3},
}
# Kinds of units that `si_factor` accepts.
UNIT_KINDS = BASE_EXPONENTS | {"area": {"length": 2}}
# Exponents of length, force and time, or of an angle.
Exponents = dict[str, int]
# SI value and dimension of a unit.
Factor = tuple[Decimal, Exponents]
# Quantities as given, and as numbers in the units of the scene.
Quantities = dict[KeyPath, tuple[str, float]]


def convert_quantities(document: Mapping[str, Any]) -> tuple[dict[str, Any], Quantities]:
    """Return the document with numbers in place of quantities, and the quantities as given.

    Raises
    ------
    ConfigError
        If a unit is unknown or has the wrong dimension, or if the scene does not define the units
        for the conversion. Several such errors are raised as ConfigErrors.
    """
    conversion = Conversion(document)
    converted_document = conversion.convert_node(schema.node_at((), document))
    if conversion.errors:
        raise ConfigErrors.combine(conversion.errors)
    return converted_document, conversion.quantities


def si_factor(unit: str, kind: str) -> float:
    """Return the SI value of a unit of a kind of UNIT_KINDS; raise ConfigError otherwise."""
    factor, exponents = _unit_factor(f"units.{kind}", unit)
    if exponents != UNIT_KINDS[kind]:
        problem = f"'{unit}' is {_dimension_text(exponents)}, not a {kind}"
        example = UNIT_EXAMPLES.get(kind, "s")
        raise ConfigError(f"units.{kind}", problem, f"write for example {example}")
    return float(factor)


def convert_quantity(key: str, text: str, dimension: str, units: Mapping[str, str]) -> float:
    """Return a number as it is, or a quantity such as "0.3 nm/mN" as a number in other units.

    Parameters
    ----------
    key
        Name of the quantity in messages.
    text
        A number, or a number with a unit.
    dimension
        Dimension, a product of length, pressure, force and time.
    units
        Units of length and force; times are in seconds.

    Raises
    ------
    ConfigError
        If the text is neither, or the unit has another dimension.
    """
    with suppress(ValueError):
        return float(text)
    value = Conversion({"units": dict(units)}).convert_text(key, text, Unit(dimension))
    if value is None:
        problem = f"'{text}' is not a number"
        raise ConfigError(key, problem, "write a number, or a number with its unit")
    return value


class Conversion:
    """Conversion of the quantities in a document to its units; all errors are collected."""

    def __init__(self, document: Mapping[str, Any]):
        self.quantities: Quantities = {}
        self.errors: list[ConfigError] = []
        self._document = document
        units = document.get("units")
        self._units = units if isinstance(units, Mapping) else {}
        body = body if isinstance(body := document.get("body"), Mapping) else {}
        is_flat = body.get("shape") == "strip" or body.get("kinematics") == "plane_strain"
        # Forces in plane strain are per unit length.
        self._force = KIND_EXPONENTS["force per length" if is_flat else "force"]

    def convert_node(self, node: schema.SchemaNode, list_unit: Unit | UnitRow | None = None) -> Any:
        """Return the value of a document node with its quantities converted.

        `list_unit` is the unit of the list that contains the node.
        """
        if isinstance(node.value, dict):
            return {part.path[-1]: self.convert_node(part) for part in node.children()}
        unit = schema.node_unit(node, self._document) or list_unit
        if isinstance(node.value, list):
            units = chain(unit.units, repeat(None)) if isinstance(unit, UnitRow) else repeat(unit)
            return [
                self.convert_node(item, item_unit)
                for item, item_unit in zip(node.children(), units, strict=False)
            ]
        if not isinstance(node.value, str):
            return node.value
        kinds = {key_types.bare_type(part) for part in key_types.union_members(node.type)}
        if not kinds & {float, int}:
            return node.value
        # A single number may replace a list of rows, as in drainage.bath; it has their last unit.
        unit = unit.units[-1] if isinstance(unit, UnitRow) else unit
        try:
            value = self.convert_text(key_text(node.path), node.value, unit)
        except ConfigError as error:
            self.errors.append(error)
            return node.value
        if value is None:
            return node.value
        self.quantities[node.path] = (node.value, value)
        return value

    def convert_text(self, key: str, text: str, unit: Unit | UnitRow | None) -> float | None:
        """Return the number of a quantity; None for any other text."""
        if DECIMAL_COMMA.fullmatch(text):
            corrected_text = text.strip().replace(",", ".")
            raise ConfigError(
                key, f"a comma is not a decimal point: '{text}'", f"write {corrected_text}"
            )
        match = QUANTITY_PATTERN.fullmatch(text)
        if match is None:
            return None
        if not isinstance(unit, Unit):
            raise ConfigError(
                key, f"must be a number without unit, got '{text}'", f"write {match['number']}"
            )
        if unit == ANGLE:
            if match["unit"] not in ANGLES:
                raise ConfigError(
                    key,
                    f"'{text}' is not an angle",
                    "give degrees, or for example 70 deg or 1.2 rad",
                )
            return float(match["number"]) * ANGLES[match["unit"]]
        factor, exponents = _unit_factor(key, match["unit"])
        required_exponents = _dimension_exponents(unit, self._force)
        if exponents != required_exponents:
            examples = (
                example
                for dimension, example in QUANTITY_EXAMPLES.items()
                if _dimension_exponents(dimension) == required_exponents
            )
            required = _dimension_text(required_exponents)
            problem = f"'{text}' is {_dimension_text(exponents)}, not {required}"
            raise ConfigError(key, problem, f"write for example {next(examples, 'a number')}")
        scene_unit_factor = self._scene_unit_factor(key, required_exponents)
        return float(Decimal(match["number"]) * factor / scene_unit_factor)

    def _scene_unit_factor(self, key: str, required_exponents: Exponents) -> Decimal:
        """Return the SI value of the scene's unit for a dimension."""
        total = Decimal(1)
        for kind, power in required_exponents.items():
            label = "s" if kind == "time" else self._units.get(kind)
            if not isinstance(label, str) or not label:
                problem = f"has a unit, but `units` does not define the unit of {kind}"
                remedy = (
                    "add units: {length: um, force: nN}, to which quantities are converted, or "
                    "give plain numbers"
                )
                raise ConfigError(key, problem, remedy)
            factor, exponents = _unit_factor(f"units.{kind}", label)
            if exponents != {kind: 1}:
                problem = f"'{label}' is {_dimension_text(exponents)}, not a {kind}"
                raise ConfigError(
                    f"units.{kind}", problem, f"write for example {UNIT_EXAMPLES[kind]}"
                )
            total *= factor**power
        return total


def _dimension_exponents(unit: Unit, force: Exponents = BASE_EXPONENTS["force"]) -> Exponents:
    """Return the exponents of length, force and time of a unit of the symbol table.

    `force` are the exponents of a force of the scene, which in plane strain is per unit length.
    """
    total: Counter[str] = Counter()
    for word, power in unit.powers.items():
        total.update(
            {
                name: count * power
                for name, count in (BASE_EXPONENTS | {"force": force})[word].items()
            }
        )
    return {name: power for name, power in total.items() if power}


@cache
def _unit_factor(key: str, unit: str) -> Factor:
    """Return SI value and dimension of a unit; raise ConfigError if there is no such unit."""
    if unit in ANGLES:
        return Decimal(1), {"angle": 1}
    total = Decimal(1)
    exponents = Counter({"length": 0, "mass": 0, "time": 0})
    try:
        names = parse_unit_factors(unit)
    except ValueError:
        raise _unknown_unit(key, unit) from None
    for part, power in names:
        size, base_exponents = _pint_factor(key, part, unit)
        total *= size**power
        exponents.update({name: count * power for name, count in base_exponents.items()})
    force = exponents.pop("mass")
    exponents.update({"force": force, "length": -force, "time": 2 * force})
    return total, {name: count for name, count in exponents.items() if count}


def _pint_factor(key: str, name: str, unit: str) -> tuple[Decimal, Exponents]:
    """Return the value of a named unit in kg, m, s and its exponents of mass, length and time."""
    import pint

    try:
        size = _unit_registry().Quantity(Decimal(1), name.replace("°", "deg")).to_base_units()
    except (pint.errors.PintError, AttributeError, ValueError, TypeError):
        raise _unknown_unit(key, unit) from None
    names = {"[length]": "length", "[mass]": "mass", "[time]": "time"}
    return Decimal(size.magnitude), {
        names.get(str(dimension), str(dimension)): int(power)
        for dimension, power in size.dimensionality.items()
    }


@cache
def _unit_registry() -> Any:
    """Return the registry of units, in decimal arithmetic."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal, autoconvert_offset_to_baseunit=False)


def _unknown_unit(key: str, unit: str) -> ConfigError:
    """Return the ConfigError for an unknown unit, with the most similar known unit."""
    # Units among which the probable meaning of an unknown unit is searched.
    suggested_units = (
        "pm nm um mm cm m pN nN uN mN N kN Pa kPa MPa GPa N/m mN/m deg rad s ms J/m^2 mJ/m^2"
    )
    match = closest_match(unit, tuple(suggested_units.split()))
    remedy = f"did you mean {match}?" if match else "write for example um, nN or kPa"
    return ConfigError(key, f"there is no unit '{unit}'", remedy)


def _dimension_text(exponents: Exponents) -> str:
    """Return a text on a dimension such as "a length", "a pressure", "force^1 length^-2"."""
    name = next(
        (name for name, kind_exponents in KIND_EXPONENTS.items() if kind_exponents == exponents),
        None,
    )
    if name is None:
        return " ".join(f"{part}^{power}" for part, power in exponents.items()) or "a pure number"
    return f"{'an' if name[0] in 'ae' else 'a'} {name}"


def dimension_of_key(path: KeyPath, document: Mapping[str, Any]) -> str | None:
    """Return the kind "length", "force" or "pressure" of a key; None for other dimensions."""
    unit = schema.node_unit(schema.node_at(path, document), document)
    kinds = {LENGTH: "length", FORCE: "force", PRESSURE: "pressure"}
    return kinds.get(unit) if isinstance(unit, Unit) else None


def pressure_keys(config: schema.Config) -> list[str]:
    """Return the keys of all numbers with a pressure in their unit.

    If there is only one such key, the force is proportional to it by dimensional analysis.
    """
    parts: list[tuple[str, Any]] = [*config.materials(), ("contact", config.contact)]
    parts += [(f"{key}.flow", law.flow) for key, law in config.materials() if law.flow]
    parts.append(("indenter.material", getattr(config.indenter, "material", None)))
    return [
        f"{name}.{key}"
        for name, part in parts
        if is_dataclass(part)
        for key in _pressure_fields(part)
    ]


def _pressure_fields(part: Any) -> list[str]:
    """Return the names of the fields of a dataclass that are numbers with a pressure, not zero."""
    kind: type = type(part)
    units = field_units(kind)
    field_units_by_name = [
        (part_field.name, units[part_field.name])
        for part_field in fields(part)
        if _is_number(getattr(part, part_field.name))
    ]
    return [
        name
        for name, unit in field_units_by_name
        if isinstance(unit, Unit) and unit.powers.get("pressure") and getattr(part, name)
    ]


def _is_number(value: Any) -> bool:
    """Return whether a value is a number; booleans are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)
