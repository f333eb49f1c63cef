"""Bodies of the layer theories from plain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.profiles import Tip
from indent_sim.theory.solution import Solution
from indent_sim.theory.stack import Stack, StackLayer

Kind = TypeVar("Kind", bound=ContactCurve)

# nu and thickness of a layer bonded to its base, and the force [pi work R] at which a paraboloid
# comes off it under force control (JKR, E = R = 1, work 1e-3): five digits of an independent
# solution of the integral equation
BONDED_PULL_OFF = [
    (0.3, 1000, -1.50000),
    (0.3, 1, -1.50246),
    (0.3, 0.3, -1.56203),
    (0.3, 0.1, -1.78781),
    (0.5, 1000, -1.50000),
    (0.5, 1, -1.50310),
    (0.5, 0.3, -1.58085),
    (0.5, 0.1, -1.90534),
]


def stack_of(plies: Sequence[Sequence[float]], base: str | None = "fixed") -> Stack:
    """The stack of layers (thickness, E, nu) from the top."""
    return Stack(tuple(StackLayer(*map(float, ply)) for ply in plies), base)


def one_layer(
    kind: type[Kind],
    tip: Tip,
    *,
    E: float,
    nu: float,
    h: float,
    base: str = "fixed",
    wall: float | None = None,
) -> Kind:
    """The contact of a tip with one layer of thickness h.

    The layer lies between frictionless walls where `wall` is given.
    """
    return kind.from_stack(tip, Stack((StackLayer(h, E, nu),), base), wall)


def indent(kind: type[ContactCurve], tip: Tip, delta: float, **body: Any) -> Solution:
    """The contact at one depth."""
    return one_layer(kind, tip, **body).solutions_at_depths([delta])[0]
