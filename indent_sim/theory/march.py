"""A layer theory's contacts at one depth after another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from indent_sim.theory.roots import first_guess, increasing_root, next_guess
from indent_sim.theory.solution import Solution, check_contact, no_contact


class Touching(Protocol):
    """What is linear at a given contact size."""

    @property
    def touch(self) -> float:
        """The depth [h] of a smooth tip with this contact size."""
        ...


class Layer(Protocol):
    """A layer of thickness h [L] under a tip; contact sizes are in units of h."""

    @property
    def h(self) -> float:
        """The thickness [L]."""
        ...

    @property
    def edge(self) -> float | None:
        """The contact size [L] that a flat punch has at any depth."""
        ...

    def profile(self, x: np.ndarray) -> np.ndarray:
        """An increasing shape function of the tip, about the depth [h] of a contact of size x."""
        ...

    def largest(self) -> float:
        """The contact size that cannot be reached."""
        ...

    def at(self, a: float) -> Touching:
        """The linear problem of the contact size a."""
        ...

    def solution(self, delta: float, a: float) -> Solution:
        """The contact of size a at the depth delta [L]."""
        ...


def march(layer: Layer, deltas: Sequence[float], wall: float | None) -> list[Solution]:
    """One Solution per depth [L], each contact sought from its neighbour's; `wall`: distance of the side walls [L]."""
    solutions: list[Solution] = []
    known: list[tuple[float, float]] = []
    for delta in deltas:
        check_contact(delta, layer.edge, layer.h, wall)
        if delta <= 0.0:
            solutions.append(no_contact(delta))
        elif layer.edge is not None:
            solutions.append(layer.solution(delta, layer.edge / layer.h))
        else:
            depth = delta / layer.h
            start = next_guess(known, depth) or first_guess(layer.profile, depth, layer.largest())
            a = increasing_root(lambda a: layer.at(a).touch, depth, start, layer.largest())
            known.append((depth, a))
            solutions.append(layer.solution(delta, a))
    return solutions
