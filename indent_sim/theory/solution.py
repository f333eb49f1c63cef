"""Solution of a theory at one depth, and checks of parameters of theories."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

PEAK_POINTS = 101  # Points of the first round of the search for the largest pressure.
# Exceptions with which a theory reports that it has no solution. In numpy 1.24 LinAlgError is a
# subclass of neither ValueError nor ArithmeticError.
SOLUTION_ERRORS = (ValueError, ArithmeticError, np.linalg.LinAlgError)
MAX_SLENDERNESS = 100.0  # Largest a/h: the dense matrices of the layer theories grow with it.


@dataclass(frozen=True)
class Solution:
    """Solution of a contact problem at one depth.

    In plane strain, force, energy and stiffness are per unit length. The gap at a distance r from
    the axis is f(r) - delta - u_z(r).

    Attributes
    ----------
    delta
        Depth [L].
    force
        Force [F], > 0 while the tip pushes.
    a
        Contact radius or half-width [L].
    area
        Contact area [L^2], in plane strain the width [L].
    energy
        Strain energy [F L].
    stiffness
        d force/d delta [F/L].
    pressure
        Function that returns the contact pressure [F/L^2] at distances r [L]; 0 outside the
        contact.
    u_z
        Function that returns the surface displacement [L] at distances r [L], < 0 into the body;
        NaN beyond side walls.
    peak_pressure
        Function that returns the largest pressure [F/L^2]; None if it must be searched for.
    """

    delta: float
    force: float
    a: float
    area: float
    energy: float
    stiffness: float
    pressure: Callable[[np.ndarray], np.ndarray]
    u_z: Callable[[np.ndarray], np.ndarray]
    peak_pressure: Callable[[], float] | None = None

    def largest_pressure(self, points: int = PEAK_POINTS) -> float:
        """Return the largest pressure [F/L^2] with an accuracy of 1e-9; NaN if it is infinite.

        The pressure is infinite under a sharp apex or edge. The search refines the interval around
        the largest sampled value until this value changes by less than 1e-10.
        """
        if self.force <= 0.0:
            return 0.0
        if self.peak_pressure is not None:
            return self.peak_pressure()
        r = np.linspace(0.0, self.a, points)
        largest = 0.0
        for _ in range(12):
            with np.errstate(all="ignore"):
                p = np.asarray(self.pressure(r), dtype=float)
            previous_largest = largest
            largest = float(p.max())
            if largest == math.inf:
                return math.nan
            if previous_largest == 0.0 and p[0] == largest and p[1] > p[2]:
                return largest  # The maximum is in the center, where the pressure has slope 0.
            if abs(largest - previous_largest) <= 1e-10 * largest:
                return largest
            k = int(np.argmax(p))
            r = np.linspace(r[max(k - 1, 0)], r[min(k + 1, r.size - 1)], 11)
        return math.nan


def no_contact(delta: float) -> Solution:
    """Return the Solution without contact, in which everything but delta is zero."""

    def zero_field(r):
        """Return zeros of the shape of r."""
        return np.zeros_like(np.asarray(r, dtype=float))[()]

    return Solution(float(delta), 0.0, 0.0, 0.0, 0.0, 0.0, zero_field, zero_field)


def check_contact(delta: float, punch_radius: float | None, h: float, wall: float) -> None:
    """Raise ValueError if delta is not finite or a flat punch is too wide for body or theory."""
    if not math.isfinite(delta):
        raise ValueError(f"delta must be finite, got {delta!r}")
    if punch_radius is not None and punch_radius > MAX_SLENDERNESS * h:
        raise ValueError(
            f"a punch of radius {punch_radius:g} is wider than {MAX_SLENDERNESS:g} thicknesses"
        )
    if punch_radius is not None and punch_radius >= wall:
        raise ValueError(
            f"a punch of radius {punch_radius:g} does not fit between walls at {wall:g}"
        )


def require_positive(**values: float) -> None:
    """Raise ValueError if one of the named values is not a finite number > 0."""
    for name, value in values.items():
        if not (value > 0.0 and math.isfinite(value)):
            raise ValueError(f"{name} must be a finite number > 0, got {value!r}")


def tangent_of_half_angle(half_angle: float) -> float:
    """Return the tangent of an angle in degrees; raises ValueError unless it is in (0, 90)."""
    if not 0.0 < half_angle < 90.0:
        raise ValueError(f"half_angle must lie in (0, 90) degrees, got {half_angle!r}")
    return math.tan(math.radians(half_angle))
