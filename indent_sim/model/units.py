"""Marks on the types of fields: dimension, range and, of a section that may be several things, the key that chooses.

Numbers know their dimension, so that one function can scale a whole scene; validation, the JSON schema, the generated
docs and the non-dimensionalisation all read the marks.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt


@dataclass(frozen=True)
class Unit:
    """The dimension length^length * pressure^pressure of a number."""

    length: int = 0
    pressure: int = 0


LENGTH = Unit(length=1)
PRESSURE = Unit(pressure=1)
STIFFNESS = Unit(length=-1, pressure=1)  # pressure per length: epsilon_n, gamma
ADHESION = Unit(length=1, pressure=1)  # work of adhesion; in plane strain too, where a force is per length
DIMENSIONS = {LENGTH: "length", PRESSURE: "pressure", STIFFNESS: "pressure/length", ADHESION: "energy/length^2"}

Coordinate = Annotated[float, LENGTH]
Length = Annotated[float, Gt(0), LENGTH]
LengthOrZero = Annotated[float, Ge(0), LENGTH]
Modulus = Annotated[float, Gt(0), PRESSURE]
AnyModulus = Annotated[float, PRESSURE]
ContactStiffness = Annotated[float, Gt(0), STIFFNESS]
PoissonRatio = Annotated[float, Gt(-1), Le(0.5)]
HalfAngle = Annotated[float, Gt(1e-6), Lt(90)]  # degrees, between axis and flank
PositiveInt = Annotated[int, Gt(0)]
Auto = Literal["auto"]

D = TypeVar("D")


@dataclass(frozen=True)
class TaggedBy:
    """Marks a section whose dataclass one key chooses; unlike pydantic's mark it knows a union of one, and None."""

    tag: str

    def __get_pydantic_core_schema__(self, union: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        parts = get_args(union) or (union,)
        kinds = {get_args(get_type_hints(kind)[self.tag])[0]: kind for kind in parts if kind is not NoneType}
        choices = {word: handler.generate_schema(kind) for word, kind in kinds.items()}
        schema = core_schema.tagged_union_schema(choices, discriminator=self.tag)
        return core_schema.nullable_schema(schema) if NoneType in parts else schema


def unit_of(hint: Any) -> Unit | None:
    """The `Unit` annotated anywhere inside a type hint, or None for a pure number or a word."""
    if get_origin(hint) is Annotated:
        for mark in hint.__metadata__:
            if isinstance(mark, Unit):
                return mark
        return unit_of(hint.__origin__)
    return next((unit for unit in map(unit_of, get_args(hint)) if unit), None)


@cache
def field_units(kind: type) -> dict[str, Unit | None]:
    """The unit of every field of a dataclass."""
    return {name: unit_of(hint) for name, hint in get_type_hints(kind, include_extras=True).items()}


def scaled(item: D, length: float, pressure: float) -> D:
    """The same dataclass measured in units of `length` and `pressure`: every number x becomes x / (L^l P^p)."""

    def convert(value: Any, unit: Unit | None) -> Any:
        if dataclasses.is_dataclass(value):
            return scaled(value, length, pressure)
        if isinstance(value, (tuple, list)):
            return tuple(convert(part, unit) for part in value)
        if unit is None or isinstance(value, (str, bool)) or value is None:
            return value
        return value / (length**unit.length * pressure**unit.pressure)

    units = field_units(type(item))  # type: ignore[arg-type]
    values = {f.name: convert(getattr(item, f.name), units[f.name]) for f in dataclasses.fields(item)}  # type: ignore[arg-type]
    return dataclasses.replace(item, **values)  # type: ignore[type-var]


@dataclass(frozen=True)
class Scales:
    """One length and one pressure of the scene; the solver and gmsh see everything divided by them.

    force [pressure length^2] and energy [pressure length^3] follow, one power of length less in plane strain.
    """

    length: float
    pressure: float
    dim: int = 3  # 2 in plane strain, where forces are per unit length
    pieces: int = 1  # equal ones on top of each other, of which one is modelled: approach and energy are those of all

    @property
    def depth(self) -> float:
        """Unit of the depth delta, the whole body's approach."""
        return self.pieces * self.length

    @property
    def force(self) -> float:
        """Unit of force."""
        return self.pressure * self.length ** (self.dim - 1)

    @property
    def stiffness(self) -> float:
        """Unit of pressure per length."""
        return self.pressure / self.length

    def scaled(self, item: D) -> D:
        """A dataclass of the user's numbers in these units."""
        return scaled(item, self.length, self.pressure)

    def unscaled(self, item: D) -> D:
        """A dataclass in these units as the user's numbers."""
        return scaled(item, 1 / self.length, 1 / self.pressure)

    def of(self, control: str) -> float:
        """Unit of what a load path prescribes: depth or force."""
        return self.depth if control == "depth" else self.force

    @property
    def energy(self) -> float:
        """Unit of energy."""
        return self.pieces * self.pressure * self.length**self.dim


def rounded(value: float) -> float:
    """A length to 12 significant digits: the same mesh whatever units the scene came in."""
    return float(f"{value:.12g}")
