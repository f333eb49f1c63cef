"""Quantities with units of their own, "2.5 um" or "1 kPa", converted to the units of the scene.

The arithmetic is decimal, exact but for radians, and rounded once: a scene in mixed units has the digits of one in its
own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from functools import cache
from math import pi
from typing import Any

from indent_sim.config import key_types, schema
from indent_sim.config.messages import closest
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.model.symbols import lookup
from indent_sim.model.units import DIMENSIONS, unit_of
from indent_sim.process.errors import ConfigError, ConfigErrors

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
QUANTITY = re.compile(rf"\s*(?P<number>{NUMBER})\s*(?P<unit>[^\W\d_]\S*(?: [*/·] ?\S+)*|[%°])\s*")
FACTOR = re.compile(r"(?P<sign>[*/·]?)\s*(?P<name>[^\W\d_]+|[%°])(?:(?:\^|\*\*)?(?P<power>-?\d|[²³]))?\s*")
COMMA = re.compile(r"\s*[-+]?\d+,\d+\D*")
POWERS = {"²": 2, "³": 3}
EXAMPLES = {"length": "2.5 um", "pressure": "1 kPa", "force": "3 nN", "pressure/length": "2 kPa/um",
            "force/length": "3 mN/m", "length/force": "2 um/mN", "length^2/force": "2 um^2/mN", "time": "0.1 s",
            "1/time": "10 Hz"}  # fmt: skip
ANGLES = {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "rad": 180 / pi, "radian": 180 / pi}  # degrees
OWN = {"length": "um", "force": "nN"}  # examples of a scene's own units; times are in seconds
WORDS = {"length": {"length": 1}, "force": {"force": 1}, "pressure": {"force": 1, "length": -2}, "time": {"time": 1},
         "force per length": {"force": 1, "length": -1}, "energy": {"force": 1, "length": 1}, "angle": {"angle": 1},
         "pressure per length": {"force": 1, "length": -3}}  # fmt: skip
KNOWN = ("pm", "nm", "um", "mm", "cm", "m", "pN", "nN", "uN", "mN", "N", "kN", "Pa", "kPa", "MPa", "GPa", "N/m", "mN/m",
         "deg", "rad", "s", "ms", "J/m^2", "mJ/m^2")  # fmt: skip
Exponents = dict[str, int]  # of length, force and time
Factor = tuple[Decimal, Exponents]  # how many SI units, and of what
Given = dict[KeyPath, tuple[str, float]]  # quantities as they were given, and as numbers


def converted(document: Mapping[str, Any]) -> tuple[dict[str, Any], Given]:
    """The document with every quantity as a number in the scene's units, and the quantities as they were given.

    ConfigErrors (one: ConfigError) for units that are unknown, of the wrong kind, or that the scene's own do not cover.
    """
    convert = Conversion(document)
    changed = convert.changed(schema.spot_at((), document), "")
    if convert.errors:
        raise ConfigErrors(convert.errors) if len(convert.errors) > 1 else convert.errors[0]
    return changed, convert.found


def _is_number(hint: Any) -> bool:
    """Whether a number may stand in a place."""
    return any(key_types.core(part) in (float, int) for part in key_types.members(hint)) if hint is not None else False


def _dimension(spot: schema.Spot) -> str:
    """The dimension of a place in words: length, pressure/length, force, degrees; "" for a pure number."""
    if (unit := unit_of(spot.type) if spot.type is not None else None) is not None:
        return DIMENSIONS[unit]
    names = [part for part in spot.path if isinstance(part, str)]
    symbol = lookup(names[-1], names[-2] if len(names) > 1 else "") if names else None
    dimensions = symbol.dimension.split(", ") if symbol else [""]  # of a row of numbers one each
    place = spot.path[-1] if len(dimensions) > 1 else 0
    found = dimensions[place] if isinstance(place, int) and place < len(dimensions) else ""
    return found if found not in ("1", "word") else ""


class Conversion:
    """Turns the quantities of a document into numbers in its units; `found` and `errors` are what it met."""

    def __init__(self, document: Mapping[str, Any]):
        self.found: Given = {}
        self.errors: list[ConfigError] = []
        units = document.get("units")
        self._units = units if isinstance(units, Mapping) else {}
        self._force = {"force": 1, "length": -1} if _is_flat(document.get("body")) else {"force": 1}

    def changed(self, spot: schema.Spot, above: str) -> Any:
        """The value of a place with its quantities converted; `above`: the dimension of the list that it stands in."""
        if isinstance(spot.value, dict):
            return {part.path[-1]: self.changed(part, "") for part in spot.parts()}
        dimension = _dimension(spot) or above
        if isinstance(spot.value, list):
            return [self.changed(part, dimension) for part in spot.parts()]
        if not isinstance(spot.value, str) or not _is_number(spot.type):
            return spot.value
        try:
            value = self._number(key_text(spot.path), spot.value, dimension)
        except ConfigError as error:
            self.errors.append(error)
            return spot.value
        if value is None:
            return spot.value
        self.found[spot.path] = (spot.value, value)
        return value

    def _number(self, key: str, text: str, dimension: str) -> float | None:
        """The number of a quantity; None for other text."""
        if COMMA.fullmatch(text):
            point = text.strip().replace(",", ".")
            raise ConfigError(key, f"a comma is no decimal point: '{text}'", f"write {point}")
        match = QUANTITY.fullmatch(text)
        if match is None:
            return None
        if not dimension:
            raise ConfigError(key, f"has no unit, got '{text}'", f"write {match['number']}")
        if dimension == "degrees":
            return _angle(key, text, match["number"], match["unit"])
        (factor, exponents), wanted = _factor(key, match["unit"]), _exponents(dimension, self._force)
        if exponents != wanted:
            example = next((text for name, text in EXAMPLES.items() if _exponents(name) == wanted), "a number")
            problem = f"'{text}' is {_in_words(exponents)}, not {_in_words(wanted)}"
            raise ConfigError(key, problem, f"for example {example}")
        return float(Decimal(match["number"]) * factor / self._own(key, wanted))

    def _own(self, key: str, wanted: Exponents) -> Decimal:
        """How many SI units the scene's own unit of this dimension is."""
        total = Decimal(1)
        for kind, power in wanted.items():
            label = "s" if kind == "time" else self._units.get(kind)
            if not isinstance(label, str) or not label:
                remedy = "add units: {length: um, force: nN}, to which quantities are converted, or give plain numbers"
                raise ConfigError(key, f"a quantity, and units say no {kind}", remedy)
            factor, exponents = _factor(f"units.{kind}", label)
            if exponents != {kind: 1}:
                problem = f"'{label}' is {_in_words(exponents)}, no {kind}"
                raise ConfigError(f"units.{kind}", problem, f"for example {OWN[kind]}")
            total *= factor**power
        return total


def _is_flat(body: Any) -> bool:
    """Whether a body is in plane strain, where every force is per length."""
    return isinstance(body, Mapping) and (body.get("shape") == "strip" or body.get("kinematics") == "plane_strain")


def _exponents(dimension: str, force: Exponents | None = None) -> Exponents:
    """Exponents of length, force and time of a dimension in words; `force`: those of what is called a force."""
    known = {"pressure": WORDS["pressure"], "energy": WORDS["energy"], "force": force or WORDS["force"]}
    total: Exponents = {}
    for sign, word, power in re.findall(r"(/?)\s*([a-z]+)(?:\^(-?\d+))?", dimension):
        for name, count in known.get(word, {word: 1}).items():
            total[name] = total.get(name, 0) + count * int(power or 1) * (-1 if sign else 1)
    return {name: power for name, power in total.items() if power}


def _angle(key: str, text: str, number: str, unit: str) -> float:
    """An angle in degrees."""
    if unit not in ANGLES:
        raise ConfigError(key, f"'{text}' is no angle", "give degrees, or for example 70 deg or 1.2 rad")
    return float(number) * ANGLES[unit]


@cache
def _factor(key: str, unit: str) -> Factor:
    """How many SI units a unit is, and its exponents of length, force and time; ConfigError when there is none."""
    if unit in ANGLES:
        return Decimal(1), {"angle": 1}
    total, exponents, end = Decimal(1), {"length": 0, "mass": 0, "time": 0}, 0
    for match in FACTOR.finditer(unit):
        if match.start() != end:
            raise _unknown(key, unit)
        end = match.end()
        power = POWERS.get(match["power"] or "", 0) or int(match["power"] or 1)
        power = -power if match["sign"] == "/" else power
        size, of = _known(key, match["name"], unit)
        total *= size**power
        for name, count in of.items():
            exponents[name] = exponents.get(name, 0) + count * power
    if end != len(unit):
        raise _unknown(key, unit)
    force = exponents.pop("mass")
    exponents |= {"force": force, "length": exponents["length"] - force, "time": exponents["time"] + 2 * force}
    return total, {name: count for name, count in exponents.items() if count}


def _known(key: str, name: str, unit: str) -> tuple[Decimal, Exponents]:
    """One unit by name: how many of kg, m, s, and its exponents of these."""
    import pint

    try:
        size = _registry().Quantity(Decimal(1), name.replace("°", "deg")).to_base_units()
    except (pint.errors.PintError, AttributeError, ValueError, TypeError):
        raise _unknown(key, unit) from None
    words = {"[length]": "length", "[mass]": "mass", "[time]": "time"}
    return Decimal(size.magnitude), {words.get(str(d), str(d)): int(p) for d, p in size.dimensionality.items()}


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(non_int_type=Decimal, autoconvert_offset_to_baseunit=False)


def _unknown(key: str, unit: str) -> ConfigError:
    match = closest(unit, KNOWN)
    remedy = f"did you mean {match}?" if match else "for example um, nN, kPa"
    return ConfigError(key, f"there is no unit '{unit}'", remedy)


def _in_words(exponents: Exponents) -> str:
    """A dimension in words: a length, a pressure, force/length."""
    name = next((name for name, those in WORDS.items() if those == exponents), None)
    if name is None:
        return " ".join(f"{part}^{power}" for part, power in exponents.items()) or "a pure number"
    return f"{'an' if name[0] in 'ae' else 'a'} {name}"
