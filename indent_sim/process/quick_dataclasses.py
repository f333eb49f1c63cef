"""Faster creation of dataclasses in Python 3.11, which compiles six methods of each class.

Compiling takes a twentieth of the time of a small run. The methods that depend only on the names of
the fields are closures here; `__init__` stays compiled. Later versions of Python compile all
methods of a class together, and are not changed.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import FrozenInstanceError
from operator import attrgetter
from reprlib import recursive_repr
from typing import Any

Fields = Sequence[Any]  # of dataclasses.Field
Method = Callable[..., Any]


@contextmanager
def quick_dataclasses() -> Iterator[None]:
    """Create the methods of dataclasses that the block defines without compiling them."""
    replacements = {
        "_frozen_get_del_attr": _frozen,
        "_repr_fn": _repr,
        "_hash_fn": _hash,
        "_cmp_fn": _compare,
    }
    if sys.version_info[:2] != (3, 11):
        replacements = {}
    originals = {name: getattr(dataclasses, name) for name in replacements}
    _patch_dataclasses(replacements)
    try:
        yield
    finally:
        _patch_dataclasses(originals)


def _patch_dataclasses(functions: dict[str, Any]) -> None:
    """Set functions of the module `dataclasses`."""
    for name, function in functions.items():
        setattr(dataclasses, name, function)


def _frozen(cls: Any, fields: Fields, globals: Any) -> tuple[Method, Method]:
    """Methods __setattr__ and __delattr__ of a frozen dataclass."""
    names = frozenset(field.name for field in fields)

    def __setattr__(self: Any, name: str, value: Any) -> None:
        if type(self) is cls or name in names:
            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def __delattr__(self: Any, name: str) -> None:
        if type(self) is cls or name in names:
            raise FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    return __setattr__, __delattr__


def _repr(fields: Fields, globals: Any) -> Method:
    """Method __repr__ of a dataclass."""
    names = [field.name for field in fields]

    @recursive_repr()
    def __repr__(self: Any) -> str:
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{type(self).__qualname__}({values})"

    return __repr__


def _hash(fields: Fields, globals: Any) -> Method:
    """Method __hash__ of a dataclass."""
    field_values = _field_getter([field.name for field in fields])

    def __hash__(self: Any) -> int:
        return hash(field_values(self))

    return __hash__


def _compare(method: str, operator: str, self_tuple: str, other_tuple: str, globals: Any) -> Method:
    """Method __eq__ of a dataclass; other comparisons are compiled.

    The tuples are source code of the fields, such as "(self.x,self.y,)".
    """
    if operator != "==":
        return _compiled_compare(method, operator, self_tuple, other_tuple, globals=globals)
    field_values = _field_getter(
        [name.removeprefix("self.") for name in self_tuple.strip("()").split(",") if name]
    )

    def __eq__(self: Any, other: object) -> Any:
        if other.__class__ is not self.__class__:
            return NotImplemented
        return field_values(self) == field_values(other)

    return __eq__


_compiled_compare: Method = getattr(dataclasses, "_cmp_fn", None)  # type: ignore[assignment]


def _field_getter(names: Sequence[str]) -> Callable[[Any], tuple[Any, ...]]:
    """Function that returns the fields of an instance as a tuple."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda instance: tuple(getattr(instance, name) for name in names)
