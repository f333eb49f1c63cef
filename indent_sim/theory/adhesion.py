"""Adhesive contact without range (JKR) on a linear axisymmetric body, from its load curve.

Without adhesion the tip touches a circle of radius a at the depth delta_1(a) under the force
F_1(a), and K(a) is the stiffness of a bonded flat punch of that radius (`punches`). Retracting the
tip by q at constant radius gives the energy release rate G = q^2 K'(a)/(4 pi a). Griffith's balance
G = work at the edge of the contact makes the whole equilibrium curve a function of the radius:

    q = sqrt(4 pi a work/K'(a)),   delta = delta_1(a) - q,   F = F_1(a) - K(a) q.

This is exact for small strain without friction if the range of the attraction is short (Tabor
number above about 5); see `maugis` for longer ranges.

delta > 0 in indentation; force > 0 in compression, < 0 in tension. Lengths [L], forces [F], work
[F/L].
Sources: Johnson, Kendall & Roberts (1971), Proc. R. Soc. A 324, 301; Maugis (1992), J. Colloid
Interface Sci. 150, 243.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, minimize_scalar

from indent_sim.theory.punches import FittedPunches, Punches
from indent_sim.theory.solution import require_positive

# Relative distance that a search keeps from the largest radius, where the stiffness may be singular
# (at a wall).
LEAST_RIM_DISTANCE = 1e-9


@dataclass(frozen=True)
class AdhesiveContact:
    """Equilibrium of an adhesive contact: contact radius a [L], depth delta [L] and force [F]."""

    a: float
    delta: float
    force: float


class Jkr:
    """Equilibria of an adhesive tip as functions of the contact radius.

    In methods with the argument `compliance` [L/F], the tip is loaded through a spring whose base
    is displaced by z = delta + compliance * force [L]. A compliance of 0 is depth control; infinity
    is force control, where z is the force [F].

    `pull_off(compliance=0.0)` is the last stable equilibrium of unloading, where dF/ddelta =
    -1/compliance.

    Parameters
    ----------
    punches
        Stiffness of flat punches on the body, and contact of the tip without adhesion, as functions
        of the contact radius.
    work
        Work of adhesion [F/L], > 0.
    """

    def __init__(self, punches: Punches, work: float):
        require_positive(work=work)
        self.punches = punches
        self.work = work
        # Largest contact radius of searches [L].
        self.max_radius = punches.max_radius * (1.0 - LEAST_RIM_DISTANCE)
        self.pull_off = cache(self._find_pull_off)
        # Searches evaluate the ends of their brackets several times, so that equilibria are cached.
        self._cached_equilibrium = lru_cache(500)(self._solve)

    @property
    def first_contact(self) -> float:
        """Depth at which an approaching tip first touches the body [L]."""
        return 0.0

    @property
    def neighbouring_fits(self) -> list[Jkr]:
        """The same contact by fits of other degrees to the punches; empty without such fits."""
        if not isinstance(self.punches, FittedPunches):
            return []
        return [Jkr(neighbour, self.work) for neighbour in self.punches.neighbouring_fits]

    def equilibrium_at(self, a: float) -> AdhesiveContact:
        """Return the equilibrium of contact radius a [L], stable or not."""
        return self._cached_equilibrium(a)

    def _solve(self, a: float) -> AdhesiveContact:
        """Solve Griffith's balance at the contact radius a [L]."""
        punch = self.punches.punch_of_radius(a)
        if punch.stiffness_slope <= 0.0:
            raise ValueError(
                f"the stiffness of flat punches does not increase at the radius {a:.3g}, so the "
                "load curve is too inaccurate: give a smaller mesh.h_contact"
            )
        q = math.sqrt(4.0 * math.pi * a * self.work / punch.stiffness_slope)
        return AdhesiveContact(a, punch.delta - q, punch.force - punch.stiffness * q)

    def base_displacement(self, a: float, compliance: float) -> float:
        """Return the displacement z = delta + compliance force of the spring's base [L]."""
        equilibrium = self.equilibrium_at(a)
        return equilibrium.delta + compliance * equilibrium.force

    def _find_pull_off(self, compliance: float = 0.0) -> AdhesiveContact:
        """Find the equilibrium with the smallest z, or the smallest force in force control."""
        zero_force_radius = self.zero_force_radius
        # On any layer and under any tip, contacts that become unstable are larger than a thousandth
        # of the contact at zero force.
        log_bounds = (
            math.log(max(1e-3 * zero_force_radius, self.punches.min_radius)),
            math.log(zero_force_radius),
        )
        return self.equilibrium_at(
            self._radius_of_minimum(self._prescribed_value(compliance), *log_bounds)
        )

    @cached_property
    def zero_force_radius(self) -> float:
        """Contact radius [L] at zero force; larger contacts are stable at any compliance."""
        low = self.punches.min_radius
        high = self.max_radius
        low = max(low, 1e-9 * high)
        if self.equilibrium_at(low).force > 0.0:
            raise ValueError(
                "the adhesion is too weak: every contact with a tensile force has a radius below "
                f"{low:g}, the smallest of the load curve"
            )
        largest = high
        # A contact that reaches a wall is always tensile, since K' vanishes there: smaller radii
        # are tried in turn.
        while self.equilibrium_at(high).force < 0.0:
            high /= 1.25
            if high <= low:
                raise ValueError(
                    "the adhesion is too strong: the force is tensile at all radii up to "
                    f"{largest:g}, the largest of the load curve"
                )
        return math.exp(
            brentq(
                lambda x: self.equilibrium_at(math.exp(x)).force,
                math.log(low),
                math.log(high),
                xtol=1e-10,
            )
        )

    def _radius_of_minimum(self, value: Callable[[float], float], low: float, high: float) -> float:
        """Return the radius [L] at which value(a) is smallest, between two bounds of ln a.

        The accuracy is about 1e-10. Raises ValueError if the minimum is at a bound.
        """
        log_radius = float(
            minimize_scalar(lambda x: value(math.exp(x)), bounds=(low, high), method="bounded").x
        )
        # In this interval a polynomial through 14 points locates the extremum to 1e-10.
        bounds = max(log_radius - 0.05, low), min(log_radius + 0.05, high)
        polynomial = Chebyshev.interpolate(
            np.vectorize(lambda x: value(math.exp(x))), 13, domain=bounds
        )
        stationary_points = np.asarray(polynomial.deriv().roots(), dtype=complex)
        inner_extrema = [
            x.real
            for x in stationary_points
            if abs(x.imag) < 1e-6 and bounds[0] < x.real < bounds[1]
        ]
        if not inner_extrema:
            raise ValueError(
                f"the contact radius at pull-off, about {math.exp(log_radius):.3g}, is too small: "
                "the load curve does not reach it"
            )
        return math.exp(min(inner_extrema, key=polynomial))

    def stable_equilibrium(self, z: float, compliance: float = 0.0) -> AdhesiveContact | None:
        """Return the stable equilibrium at z [L]; None if the tip has separated from the body.

        For an infinite compliance (force control) z is the force [F].
        """
        pull_off = self.pull_off(compliance)
        value = self._prescribed_value(compliance)
        if z < value(pull_off.a):
            return None
        upper_radius = self._radius_beyond(z, value, pull_off.a)
        return self.equilibrium_at(
            math.exp(
                brentq(
                    lambda x: value(math.exp(x)) - z,
                    math.log(pull_off.a),
                    math.log(upper_radius),
                    xtol=1e-13,
                )
            )
        )

    def _prescribed_value(self, compliance: float) -> Callable[[float], float]:
        """Return the prescribed quantity (z, or the force) as a function of the contact radius."""
        if math.isinf(compliance):
            return lambda a: self.equilibrium_at(a).force
        return lambda a: self.base_displacement(a, compliance)

    def _radius_beyond(self, z: float, value: Callable[[float], float], a: float) -> float:
        """Return a radius [L] above a at which the prescribed quantity exceeds z."""
        high = self.max_radius
        while value(a) < z:
            if a >= high:
                raise ValueError(
                    f"the contact radius would exceed {high:g}, the largest of the load curve"
                )
            a = min(1.5 * a, high)
        return a

    def stable_branch(
        self, largest: float, compliance: float = 0.0
    ) -> Callable[[float], AdhesiveContact | None]:
        """Return an interpolation of `stable_equilibrium` for many z up to `largest` [L].

        The error is about 1e-7 of the values at `largest`. Near pull-off the radius varies as the
        square root of the distance in z, so that a spline in this square root is used.
        """
        pull_off = self.pull_off(compliance)
        value = self._prescribed_value(compliance)
        lowest = value(pull_off.a)
        upper_radius = self._radius_beyond(largest, value, pull_off.a)
        a = pull_off.a * (upper_radius / pull_off.a) ** (np.linspace(0.0, 1.0, 120) ** 1.5)
        equilibria = [pull_off, *(self.equilibrium_at(float(x)) for x in a[1:])]
        prescribed_values = [
            c.force if math.isinf(compliance) else c.delta + compliance * c.force
            for c in equilibria
        ]
        root_distances = np.sqrt(np.maximum(np.array(prescribed_values) - lowest, 0.0))
        table = CubicSpline(root_distances, [[c.a, c.delta, c.force] for c in equilibria])

        def interpolated_equilibrium(z: float) -> AdhesiveContact | None:
            """Return the stable equilibrium at z; None if the tip has separated from the body."""
            if z < lowest:
                return None
            return AdhesiveContact(*map(float, table(math.sqrt(z - lowest))))

        return interpolated_equilibrium
