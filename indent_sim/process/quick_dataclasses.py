"""Dataclasses made quickly: Python 3.11 compiles six methods of each, a twentieth of a small run.

Those that do not depend on the fields but for their names are functions here; `__init__` stays
compiled. Later versions of Python compile all methods of a class at once, and are left as they are.
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

Fields = Sequence[Any]  # dataclasses.Field
Method = Callable[..., Any]


@contextmanager
def quick_dataclasses() -> Iterator[None]:
    """Classes that the block makes dataclasses of get their methods without a compiler."""
    quick = {
        "_frozen_get_del_attr": _frozen,
        "_repr_fn": _repr,
        "_hash_fn": _hash,
        "_cmp_fn": _compare,
    }
    if sys.version_info[:2] != (3, 11):
        quick = {}
    before = {name: getattr(dataclasses, name) for name in quick}
    _patch_dataclasses(quick)
    try:
        yield
    finally:
        _patch_dataclasses(before)


def _patch_dataclasses(functions: dict[str, Any]) -> None:
    for name, function in functions.items():
        setattr(dataclasses, name, function)


def _frozen(cls: Any, fields: Fields, globals: Any) -> tuple[Method, Method]:
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
    names = [field.name for field in fields]

    @recursive_repr()
    def __repr__(self: Any) -> str:
        return f"{type(self).__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    return __repr__


def _hash(fields: Fields, globals: Any) -> Method:
    values = _field_getter([field.name for field in fields])

    def __hash__(self: Any) -> int:
        return hash(values(self))

    return __hash__


def _compare(method: str, operator: str, own: str, other: str, globals: Any) -> Method:
    """own: the fields as in "(self.x,self.y,)"."""
    if operator != "==":
        return _compiled_compare(method, operator, own, other, globals=globals)
    values = _field_getter(
        [word.removeprefix("self.") for word in own.strip("()").split(",") if word]
    )

    def __eq__(self: Any, other: object) -> Any:
        return (
            values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented
        )

    return __eq__


_compiled_compare: Method = getattr(dataclasses, "_cmp_fn", None)  # type: ignore[assignment]


def _field_getter(names: Sequence[str]) -> Callable[[Any], tuple[Any, ...]]:
    """What says the fields of an instance, as a tuple."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda instance: tuple(getattr(instance, name) for name in names)
