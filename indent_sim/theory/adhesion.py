"""Adhesion without range (JKR) on any linear axisymmetric body, from its frictionless curve;
Maugis-Dugdale beside it.

Griffith's balance G = q^2 K'(a)/(4 pi a) = work at the contact's edge gives, with the flat punches
K(a) of the body and the tip's frictionless delta_1(a), F_1(a) (`punches`), the whole equilibrium
curve by the radius:

    q = sqrt(4 pi a work/K'(a)),   delta = delta_1(a) - q,   F = F_1(a) - K(a) q.

Exact for small strain without friction, where the attraction's range is short (Tabor number above
about 5). delta > 0 pushes in, force > 0 pushes and < 0 pulls. Lengths [L], forces [F], work [F/L].
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

from indent_sim.theory.punches import Punches
from indent_sim.theory.solution import require_positive

# of ln a about an extremum, and points of the polynomial that finds it to 1e-10
EXTREMUM_WIDTH = 0.05
EXTREMUM_POINTS = 13
BRANCH_SAMPLES = 120  # of a stable branch
MOST_EQUILIBRIA = (
    500  # equilibria that are remembered: searches come back to the ends of their brackets
)
LEAST_UNSTABLE_RADIUS = (
    1e-3  # of the radius without force: no instability has a smaller contact, on any layer or tip
)
RADIUS_STEP = 1.25  # steps of a radius from the largest one down
LEAST_RIM_DISTANCE = 1e-9  # relative distance from the largest radius that is looked at


@dataclass(frozen=True)
class AdhesiveContact:
    """An equilibrium: contact radius a [L], depth delta [L], force [F] < 0 pulling."""

    a: float
    delta: float
    force: float


class Jkr:
    """The equilibria of a tip that adheres with a work of adhesion [F/L], by the contact radius.

    pull_off(compliance=0): the last stable one on the way out, where dF/ddelta = -1/compliance,
    infinite for 0: compliance [L/F] is that of a spring between the tip and what moves it; 0 depth
    control, infinite force control.
    """

    def __init__(self, punches: Punches, work: float):
        require_positive(work=work)
        self.punches = punches
        self.work = work
        self.pull_off, self._cached_equilibrium = (
            cache(self._find_pull_off),
            lru_cache(MOST_EQUILIBRIA)(self._solve),
        )

    def equilibrium_at(self, a: float) -> AdhesiveContact:
        """The equilibrium, stable or not, of contact radius a [L]."""
        return self._cached_equilibrium(a)

    def _solve(self, a: float) -> AdhesiveContact:
        punch = self.punches.punch_of_radius(a)
        if punch.stiffness_slope <= 0.0:
            raise ValueError(
                f"flat punches of radius {a:.3g} are not known well enough: give a smaller "
                "mesh.h_contact"
            )
        q = math.sqrt(4.0 * math.pi * a * self.work / punch.stiffness_slope)
        return AdhesiveContact(a, punch.delta - q, punch.force - punch.stiffness * q)

    def base_displacement(self, a: float, compliance: float) -> float:
        """z = delta + compliance force [L]: what prescribes the tip's place through a spring of
        1/compliance [L/F].
        """
        equilibrium = self.equilibrium_at(a)
        return equilibrium.delta + compliance * equilibrium.force

    def _find_pull_off(self, compliance: float = 0.0) -> AdhesiveContact:
        zero_force_radius = self._zero_force_radius
        log_bounds = (
            math.log(max(LEAST_UNSTABLE_RADIUS * zero_force_radius, self.punches.min_radius)),
            math.log(zero_force_radius),
        )
        return self.equilibrium_at(self._extremum(self._prescribed_value(compliance), *log_bounds))

    @cached_property
    def _zero_force_radius(self) -> float:
        """The radius without force, beyond which the contact is stable however it is held."""
        low = self.punches.min_radius
        high = self.punches.max_radius * (1.0 - LEAST_RIM_DISTANCE)
        low = max(low, 1e-9 * high)
        if self.equilibrium_at(low).force > 0.0:
            raise ValueError(
                f"adhesion is weak: what pulls is smaller than {low:g}, of which nothing is known"
            )
        widest = high
        while (
            self.equilibrium_at(high).force < 0.0
        ):  # beside a wall, where no edge gives way, every contact pulls
            high /= RADIUS_STEP
            if high <= low:
                raise ValueError(
                    "adhesion is strong: contacts pull beyond "
                    f"{widest:g}, of which nothing is known"
                )
        return math.exp(
            brentq(
                lambda x: self.equilibrium_at(math.exp(x)).force,
                math.log(low),
                math.log(high),
                xtol=1e-10,
            )
        )

    def _extremum(self, value: Callable[[float], float], low: float, high: float) -> float:
        """Radius [L] of the smallest value between two ln a, to about 1e-10; ValueError where it
        lies at an end.
        """
        log_radius = float(
            minimize_scalar(lambda x: value(math.exp(x)), bounds=(low, high), method="bounded").x
        )
        bounds = max(log_radius - EXTREMUM_WIDTH, low), min(log_radius + EXTREMUM_WIDTH, high)
        polynomial = Chebyshev.interpolate(
            np.vectorize(lambda x: value(math.exp(x))), EXTREMUM_POINTS, domain=bounds
        )
        stationary_points = np.asarray(polynomial.deriv().roots(), dtype=complex)
        inner_extrema = [
            x.real
            for x in stationary_points
            if abs(x.imag) < 1e-6 and bounds[0] < x.real < bounds[1]
        ]
        if not inner_extrema:
            raise ValueError(
                f"the contact at pull-off, about {math.exp(log_radius):.3g}, is too small to be known"
            )
        return math.exp(min(inner_extrema, key=polynomial))

    def stable_equilibrium(self, z: float, compliance: float = 0.0) -> AdhesiveContact | None:
        """The stable equilibrium at a way z [L] (see `way`); None where the tip has come off.

        With an infinite compliance z is the force [F].
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
        """What is prescribed through a spring, by the radius: the way, or the force for an infinite
        compliance.
        """
        return (
            (lambda a: self.equilibrium_at(a).force)
            if math.isinf(compliance)
            else (lambda a: self.base_displacement(a, compliance))
        )

    def _radius_beyond(self, z: float, value: Callable[[float], float], a: float) -> float:
        """A radius [L] not far beyond the one with this value."""
        high = self.punches.max_radius * (1.0 - LEAST_RIM_DISTANCE)
        while value(a) < z:
            if a >= high:
                raise ValueError(
                    f"the contact would be wider than {high:g}, of which nothing is known"
                )
            a = min(1.5 * a, high)
        return a

    def stable_branch(
        self, largest: float, compliance: float = 0.0
    ) -> Callable[[float], AdhesiveContact | None]:
        """`stable` for many ways up to the `largest` [L], from some of its equilibria: to 1e-7 of
        the largest. The way is smooth in the root of its distance from pull-off, where the
        radius goes with that root.
        """
        pull_off = self.pull_off(compliance)
        value = self._prescribed_value(compliance)
        lowest = value(pull_off.a)
        upper_radius = self._radius_beyond(largest, value, pull_off.a)
        a = pull_off.a * (upper_radius / pull_off.a) ** (
            np.linspace(0.0, 1.0, BRANCH_SAMPLES) ** 1.5
        )
        equilibria = [pull_off, *(self.equilibrium_at(float(x)) for x in a[1:])]
        prescribed_values = [
            c.force if math.isinf(compliance) else c.delta + compliance * c.force
            for c in equilibria
        ]
        root_distances = np.sqrt(np.maximum(np.array(prescribed_values) - lowest, 0.0))
        table = CubicSpline(root_distances, [[c.a, c.delta, c.force] for c in equilibria])

        def interpolated_equilibrium(z: float) -> AdhesiveContact | None:
            return (
                AdhesiveContact(*map(float, table(math.sqrt(z - lowest)))) if z >= lowest else None
            )

        return interpolated_equilibrium
