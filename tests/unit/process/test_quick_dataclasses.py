"""Quickly made dataclasses behave as those of the standard library."""

from __future__ import annotations

import dataclasses
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import pytest

from indent_sim.process.quick_dataclasses import quick_dataclasses


def made(quick: bool) -> dict[str, Any]:
    """Dataclasses of every kind that the program has."""
    with quick_dataclasses() if quick else nullcontext():

        @dataclass(frozen=True)
        class Nothing:
            pass

        @dataclass(frozen=True)
        class One:
            x: float = 0.0

        @dataclass(frozen=True)
        class Child(One):
            names: tuple[str, ...] = ()
            hidden: Any = field(default=None, repr=False, compare=False)

        @dataclass
        class Open:
            x: int = 1
            inside: Any = None

        @dataclass(order=True)
        class Ordered:
            x: int = 1

        @dataclass(frozen=True, eq=False)
        class Itself:
            x: int = 1

    return {kind.__name__: kind for kind in (Nothing, One, Child, Open, Ordered, Itself)}


def seen(kinds: dict[str, Any]) -> list[Any]:
    """Everything that a program can observe of these dataclasses."""
    nan = float("nan")
    one, child = kinds["One"], kinds["Child"]
    loop = kinds["Open"]()
    loop.inside = loop
    things = [kinds["Nothing"](), one(), one(2.0), child(1.0, ("a",)), kinds["Open"](3), loop]
    told = [repr(thing).split("<locals>.")[-1] for thing in things]
    hashes = [hash(thing) for thing in things[:4]]
    same = [
        one(nan) == one(nan),
        one(1.0) == one(1.0),
        one() == child(),
        child(1.0, (), 5) == child(1.0, (), 6),
    ]
    other = [
        one(1.0).__eq__(3),
        kinds["Ordered"](1) < kinds["Ordered"](2),
        kinds["Itself"]() == kinds["Itself"](),
    ]
    changed = [
        dataclasses.replace(child(1.0), names=("b",)).names,
        dataclasses.asdict(child(2.0, ("c",))),
    ]
    refused = []
    for thing, name in (
        (one(), "x"),
        (child(), "names"),
        (one(), "unknown"),
        (kinds["Nothing"](), "x"),
    ):
        for act in (lambda thing, name: setattr(thing, name, 1), delattr):
            with pytest.raises(dataclasses.FrozenInstanceError) as error:
                act(thing, name)
            refused.append(str(error.value))
    with pytest.raises(TypeError) as unhashable:
        hash(kinds["Open"]())
    return [told, hashes, same, other, changed, refused, str(unhashable.value)]


def test_quick_dataclasses_are_dataclasses():
    assert seen(made(quick=True)) == seen(made(quick=False))


def test_dataclasses_are_left_as_they_were():
    before = dict(vars(dataclasses))
    with pytest.raises(ZeroDivisionError), quick_dataclasses():
        1 / 0  # noqa: B018
    assert vars(dataclasses) == before
