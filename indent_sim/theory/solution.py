"""Solution of a theory at one depth, and checks of its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

BASES = ("fixed", "roller")
MAX_SLENDERNESS = 100.0  # largest a/h; the dense matrices of the layer theories grow with it
FAR_WALL = 1e4  # in thicknesses; the number of modes between walls grows with it


@dataclass(frozen=True)
class Solution:
    """State of the body at one depth; in plane strain force, energy and stiffness are per unit length.

    delta [L]; force [F]; contact radius or half-width a [L]; contact area [L^2], or width [L]; strain energy [F L];
    stiffness d force/d delta [F/L];
    pressure: r -> p [F/L^2], number or array in, same shape out, 0 outside the contact.
    """

    delta: float
    force: float
    a: float
    area: float
    energy: float
    stiffness: float
    pressure: Callable[[np.ndarray], np.ndarray]


def no_contact(delta: float) -> Solution:
    """The untouched body: everything but delta is zero."""
    return Solution(float(delta), 0.0, 0.0, 0.0, 0.0, 0.0, lambda r: np.zeros_like(np.asarray(r, dtype=float))[()])


def check_body(E: float, nu: float, h: float, base: str, wall: float | None) -> None:
    """Raise ValueError unless E, h > 0, 0 <= nu <= 0.5, base is known and wall is None or > 0."""
    require_positive(E=E, h=h)
    if not 0.0 <= nu <= 0.5:
        raise ValueError(f"nu must lie in [0, 0.5], got {nu!r}")
    if base not in BASES:
        raise ValueError(f"base must be one of {BASES}, got {base!r}")
    if wall is not None and not wall > 0.0:
        raise ValueError(f"wall must be > 0 or None, got {wall!r}")


def wall_distance(wall: float | None, h: float) -> float:
    """W/h, or infinity for the infinite layer; beyond FAR_WALL the two differ by less than about (a/h) 1e-8."""
    return math.inf if wall is None or wall > FAR_WALL * h else wall / h


def check_contact(delta: float, edge: float | None, h: float, wall: float) -> None:
    """Raise ValueError if delta is not finite or a fixed edge is wider than the body or the theory allows."""
    if not math.isfinite(delta):
        raise ValueError(f"delta must be finite, got {delta!r}")
    if edge is not None and edge > MAX_SLENDERNESS * h:
        raise ValueError(f"a punch of radius {edge:g} is wider than {MAX_SLENDERNESS:g} thicknesses")
    if edge is not None and edge >= wall:
        raise ValueError(f"a punch of radius {edge:g} does not fit between walls at {wall:g}")


def require_positive(**values: float) -> None:
    """Raise ValueError naming the first value that is not a finite number > 0."""
    for name, value in values.items():
        if not (value > 0.0 and math.isfinite(value)):
            raise ValueError(f"{name} must be a finite number > 0, got {value!r}")
