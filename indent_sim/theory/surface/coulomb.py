"""Coulomb friction between a tip and an elastic half-space on the way in: its force, contact radius
and stick radius.

Under a flat punch of radius 1 and depth 1 pressure p and outward traction q on the body are Abel
transforms of phi and x chi, and so are the displacements inside, with beta = (1 - 2 nu)/(2 (1 -
nu)), in units of mu/(1 - nu) and 1:

    int_r^1 s p ds = int_r^1 phi x/sqrt(x^2 - r^2) dx,          int_r^1 q ds = int_r^1 chi
    x/sqrt(x^2 - r^2) dx, u_z(r) = int_0^r phi/sqrt(r^2 - x^2) dx - beta int_r^1 q ds = 1, u_r(r) =
    int_0^r chi x^2/(r sqrt(r^2 - x^2)) dx - beta/r int_0^r s p ds = 0 (stick)   or   q = f p
    (slip).

With phi and chi constant on rings all of it is elementary. Under f = B r^n each increment of the
depth is that of a punch of the present radius: the stick radius is the same part of all of them, so
what has slipped slips, and what has stuck sticks. Then delta = alpha a^n as in `no_slip`, the
surface beside a punch of radius 1 lying as deep as int_0^1 phi/sqrt(r^2 - x^2) dx.

Sources: Spence (1975), J. Elasticity 5, 297, for the problem and its self-similarity; the
collocation is our own.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from indent_sim.theory.surface import no_slip
from indent_sim.theory.surface.no_slip import Rubbed

FRICTION_RINGS = 200  # forces to 2e-5; twice as many cost five times as much for half of it
FINER = 4.0  # power of their widths towards the edge, where p and q are singular
# friction beta up to which that holds; from 1 on the rings find another singularity at the edge
LARGEST_FRICTION = 0.8


def rubbed(nu: float, friction: float | Literal["stick"], power: float = math.inf) -> Rubbed:
    """Force, contact and stick radius under f = B r^power with friction, to 2e-5 (`sticks` to a
    ring, 0.01 at worst).

    An infinite power is a flat punch. Raises ValueError unless -1 < nu <= 0.5, power >= 1, and
    friction is stick or between 0 and 0.8/beta, which is 1.6 at nu = 0 and 2.8 at nu = 0.3.
    """
    if friction == "stick":
        return no_slip.stuck(nu, power)
    no_slip.check(nu, power)
    beta = (1.0 - 2.0 * nu) / (2.0 * (1.0 - nu))
    if not 0.0 <= friction * beta <= LARGEST_FRICTION:
        largest = LARGEST_FRICTION / beta if beta else math.inf
        raise ValueError(f"friction must lie in [0, {largest:.3g}], got {friction!r}")
    punch = _punch(beta, friction)
    radius = (
        1.0
        if math.isinf(power)
        else (punch.sinking(power) / SMOOTH.sinking(power)) ** (1.0 / power)
    )
    return Rubbed(punch.force * radius, radius, punch.sticks)


@dataclass(frozen=True)
class FrictionalPunch:
    """The flat punch of radius 1: phi on each ring, over the edges x of the rings; those before
    `stuck` stick.
    """

    x: np.ndarray
    phi: np.ndarray
    stuck: int

    @property
    def force(self) -> float:
        """The force over that of a frictionless punch, whose phi is 2/pi."""
        return float(math.pi / 2.0 * self.phi @ np.diff(self.x))

    @property
    def sticks(self) -> float:
        """The radius up to which the surface sticks."""
        return float(self.x[self.stuck])

    def sinking(self, n: float) -> float:
        """int_0^1 (1 - W(1/s)) s^(n-1) ds = B/(n alpha), W(q) = int_0^1 phi/sqrt(q^2 - x^2) dx
        beside the punch.
        """
        from scipy.special import hyp2f1

        x = self.x
        over_s = hyp2f1(0.5, (n + 1.0) / 2.0, (n + 3.0) / 2.0, x * x) / (
            n + 1.0
        )  # int_0^1 s^n/sqrt(1 - s^2 x^2) ds
        return float(1.0 - self.phi @ np.diff(np.arcsin(x) - x * over_s)) / n


@lru_cache(maxsize=16)
def _punch(beta: float, friction: float) -> FrictionalPunch:
    return Rings(1.0 - (1.0 - np.linspace(0.0, 1.0, FRICTION_RINGS + 1)) ** FINER).pressed(
        beta, friction
    )


@dataclass(frozen=True)
class Rings:
    """Rings between the edges x (n + 1,), their middles r, and the integrals over them (n, n), seen
    from r.
    """

    x: np.ndarray

    @cached_property
    def r(self) -> np.ndarray:
        """Their middles (n,), where displacements are asked for."""
        return (self.x[1:] + self.x[:-1]) / 2.0

    @cached_property
    def _below(self) -> np.ndarray:
        return np.minimum(self.x / self.r[:, None], 1.0)

    def pressed(self, beta: float, friction: float) -> FrictionalPunch:
        """The punch that presses on them: slip begins at a ring found by bisection."""
        n = len(self.r)
        angle = np.arcsin(self._below)
        under = np.diff(angle)  # int_0^r 1/sqrt(r^2 - x^2) dx
        along = self.r[:, None] / 2.0 * np.diff(angle - self._below * np.sqrt(1.0 - self._below**2))
        beyond = self._beyond(self.r)
        pushed = (np.diff(self.x) - beyond) / self.r[:, None]
        stuck = np.block([[under, -beta * beyond], [-beta * pushed, along]])
        on_rings = -np.diff(
            self._beyond(self.x), axis=0
        )  # q of chi, r p of phi, integrated over each ring
        slipping = np.hstack([-friction / self.r[:, None] * on_rings, on_rings])
        one = np.repeat([1.0, 0.0], n)

        def from_ring(k: int) -> np.ndarray:
            """phi and chi if the rings from k on slip."""
            return np.linalg.solve(np.vstack([stuck[: n + k], slipping[k:]]), one)

        def holds(k: int) -> bool:
            """Whether the rings before k stick, of which the last is the first to slip."""
            return k == 0 or bool(slipping[k - 1] @ from_ring(k) <= 0.0)

        k = bisect_left(range(n), True, key=lambda slipping: not holds(slipping + 1))
        return FrictionalPunch(self.x, from_ring(k)[:n], k)

    def _beyond(self, r: np.ndarray) -> np.ndarray:
        """int_r^1 x/sqrt(x^2 - r^2) dx over each ring, seen from each r."""
        return np.diff(np.sqrt(np.maximum(self.x**2 - r[:, None] ** 2, 0.0)))


SMOOTH = FrictionalPunch(np.array([0.0, 1.0]), np.array([2.0 / math.pi]), 0)
