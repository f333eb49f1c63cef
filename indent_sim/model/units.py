"""Annotations of dataclass fields: dimension, range, and the key that selects one of several types.

These annotations are used to nondimensionalize scenes, to convert results to user units, to
validate configs, and to generate the JSON schema and parts of the documentation.
"""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from dataclasses import dataclass
from functools import cache, cached_property
from math import prod
from types import NoneType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt

_FACTOR = re.compile(
    r"(?P<sign>[*/·]?)\s*(?P<name>[^\W\d_]+|[%°])(?:(?:\^|\*\*)?(?P<power>-?\d|[²³]))?\s*"
)
_DIVISOR = re.compile(r"/\s*\(\s*([^()]*?)\s*\)")


def parse_unit_factors(text: str) -> list[tuple[str, int]]:
    """Return names and powers of a product of units such as mN/m or length^2/(pressure time).

    Raises ValueError if the text is not a product of units.
    """
    expanded = _DIVISOR.sub(lambda match: "/" + re.sub(r"\s*[*·]\s*|\s+", "/", match[1]), text)
    unit_factors = []
    end = 0
    superscripts = {"²": 2, "³": 3}
    for match in _FACTOR.finditer(expanded):
        if match.start() != end:
            break
        end = match.end()
        power = superscripts.get(match["power"] or "", 0) or int(match["power"] or 1)
        unit_factors.append((match["name"], -power if match["sign"] == "/" else power))
    if end != len(expanded):
        raise ValueError(f"'{text}' is not a product of units")
    return unit_factors


@dataclass(frozen=True)
class Unit:
    """Dimension of a number: a product of length, pressure, force, energy, time and degrees.

    Forces are those of the whole body, per unit length in plane strain.
    """

    text: str

    @cached_property
    def powers(self) -> dict[str, int]:
        """Powers of length, pressure, force, time and degrees; energy is pressure length^3."""
        powers: Counter[str] = Counter()
        energy_powers = {"length": 3, "pressure": 1}
        for unit_name, power in parse_unit_factors(self.text.removeprefix("1")):
            base_units = energy_powers if unit_name == "energy" else {unit_name: 1}
            powers.update({name: power * multiplicity for name, multiplicity in base_units.items()})
        return powers


@dataclass(frozen=True)
class UnitRow:
    """Dimensions of the entries of each row of a list, None for a dimensionless number.

    A single number given in place of the list has the dimension of the last entry.
    """

    units: tuple[Unit | None, ...]

    @property
    def text(self) -> str:
        """The dimensions as text, separated by commas."""
        return ", ".join(unit.text if unit else "1" for unit in self.units)


LENGTH, PRESSURE, FORCE, TIME, ANGLE = map(Unit, ("length", "pressure", "force", "time", "degrees"))
# Contact stiffnesses epsilon_n and gamma.
STIFFNESS = Unit("pressure/length")
# Work of adhesion, in plane strain too, where a force is per unit length.
ADHESION = Unit("energy/length^2")

SurfaceTension = Annotated[float, Ge(0), ADHESION]
Coordinate = Annotated[float, LENGTH]
Length = Annotated[float, Gt(0), LENGTH]
LengthOrZero = Annotated[float, Ge(0), LENGTH]
Modulus = Annotated[float, Gt(0), PRESSURE]
AnyModulus = Annotated[float, PRESSURE]
ContactStiffness = Annotated[float, Gt(0), STIFFNESS]
PoissonRatio = Annotated[float, Gt(-1), Le(0.5)]
# Angle between axis and flank of a tip.
HalfAngle = Annotated[float, Gt(1e-6), Lt(90), ANGLE]
PositiveInt = Annotated[int, Gt(0)]
Auto = Literal["auto"]

D = TypeVar("D")


@dataclass(frozen=True)
class TaggedBy:
    """Annotation of a union of dataclasses, one of which is selected by a key.

    Unlike pydantic's discriminator, it accepts a union with one member, and None.
    """

    key: str

    def __get_pydantic_core_schema__(self, union: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        alternatives = get_args(union) or (union,)
        # The default of the key's field is the one word that it may have.
        kinds = {getattr(kind, self.key): kind for kind in alternatives if kind is not NoneType}
        choices = {word: handler.generate_schema(kind) for word, kind in kinds.items()}
        schema = core_schema.tagged_union_schema(choices, discriminator=self.key)
        return core_schema.nullable_schema(schema) if NoneType in alternatives else schema


def unit_of(hint: Any) -> Unit | UnitRow | None:
    """Return the `Unit` or `UnitRow` inside a type hint; None for dimensionless values."""
    if get_origin(hint) is Annotated:
        unit_marks = [mark for mark in hint.__metadata__ if isinstance(mark, Unit | UnitRow)]
        return unit_marks[0] if unit_marks else unit_of(hint.__origin__)
    units = [unit for unit in map(unit_of, get_args(hint)) if unit]
    return next((unit for unit in units if isinstance(unit, UnitRow)), units[0] if units else None)


@cache
def field_units(kind: type) -> dict[str, Unit | UnitRow | None]:
    """Return the unit of every field of a dataclass."""
    return {name: unit_of(hint) for name, hint in get_type_hints(kind, include_extras=True).items()}


@dataclass(frozen=True)
class Scales:
    """Length, pressure and time by which a scene is divided for the solver and for gmsh.

    The scales of force [pressure length^2] and energy [pressure length^3] follow, with one power of
    length less in plane strain.
    """

    length: float
    pressure: float
    # 2 in plane strain, where forces are per unit length.
    dim: int = 3
    # Equal contacts of one body, of which one is modelled; depth and energy are those of all.
    contacts_per_body: int = 1
    time: float = 1.0
    degrees: ClassVar[float] = 1.0

    @property
    def depth(self) -> float:
        """Scale of the depth delta, which is summed over the equal contacts of the body."""
        return self.contacts_per_body * self.length

    @property
    def force(self) -> float:
        """Scale by which forces are divided."""
        return self.pressure * self.length ** (self.dim - 1)

    @property
    def stiffness(self) -> float:
        """Scale by which stiffnesses (pressure per length) are divided."""
        return self.pressure / self.length

    @property
    def energy(self) -> float:
        """Scale by which energies are divided."""
        return self.contacts_per_body * self.pressure * self.length**self.dim

    @property
    def report(self) -> dict[str, float]:
        """Return the entry of run.json; `pieces` is the number of contacts per body."""
        return {
            "length": self.length,
            "pressure": self.pressure,
            "dim": self.dim,
            "pieces": self.contacts_per_body,
            "time": self.time,
        }

    def control_unit(self, control: str) -> float:
        """Return the scale of the prescribed quantity of a load path, depth or force."""
        return self.depth if control == "depth" else self.force

    def nondimensionalize(self, item: D) -> D:
        """Return a dataclass with every number divided by the scale of its dimension."""
        units = field_units(type(item))  # type: ignore[arg-type]
        fields = dataclasses.fields(item)  # type: ignore[arg-type]
        values = {
            field.name: self._scale_value(getattr(item, field.name), units[field.name])
            for field in fields
        }
        return dataclasses.replace(item, **values)  # type: ignore[type-var]

    def to_user_units(self, item: D) -> D:
        """Return a nondimensional dataclass in the user's units."""
        inverse = dataclasses.replace(
            self, length=1 / self.length, pressure=1 / self.pressure, time=1 / self.time
        )
        return inverse.nondimensionalize(item)

    def _scale_value(self, value: Any, unit: Unit | UnitRow | None) -> Any:
        """Return the value of a field, or nested dataclasses and tuples, divided by the scale."""
        if dataclasses.is_dataclass(value):
            return self.nondimensionalize(value)
        if isinstance(value, (tuple, list)):
            if isinstance(unit, UnitRow) and not any(isinstance(part, tuple) for part in value):
                return tuple(map(self._scale_value, value, unit.units))
            return tuple(self._scale_value(part, unit) for part in value)
        if isinstance(unit, UnitRow):
            return self._scale_value(value, unit.units[-1])
        if unit is None or isinstance(value, (str, bool)) or value is None:
            return value
        return value / prod(getattr(self, name) ** power for name, power in unit.powers.items())


def round_length(value: float) -> float:
    """Return a length rounded to 12 digits, so that the mesh does not depend on the units."""
    return float(f"{value:.12g}")
