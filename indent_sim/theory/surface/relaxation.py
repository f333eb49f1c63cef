"""Viscoelastic indentation from the elastic curve: Lee-Radok while the contact grows, Ting while it
shrinks; dynamics.

A homogeneous linear body of constant Poisson ratio whose modulus relaxes as E(t) = E G(t), G(0) =
1, has, at the time t of an approach that reached the depth delta at s(delta), and of the retraction
after it,

    F(t) = int_0^delta_1 G(t - s(delta)) F_el'(delta) d delta,   a(t) = a_el(delta_1):

delta_1 = delta(t) while the contact grows (Lee & Radok 1960); while it shrinks (Ting 1966) delta_1
follows from int_delta_1^max G(t - s(delta)) d delta + int_retraction G(t - s) delta'(s) ds = 0.
Exact for any shape of body and tip.

delta > 0 pushes in, force > 0 pushes. Any unit of time.
Sources: Lee & Radok (1960), J. Appl. Mech. 27, 438; Ting (1966), J. Appl. Mech. 33, 845.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

LEAST_SAMPLES = 4  # of an elastic curve
REGROWN = 1e-9  # of the largest depth: by more than that the contact grows again
SAME_PACE = 1e-6  # relative: samples at equal times
SHORTEST_SHARE = 1e-3  # of the time between samples: shorter times of a power law are not seen
Sampled = Callable[
    [np.ndarray], np.ndarray
]  # the force of a relaxing body by the elastic forces at some times
# a power law as a sum of exponentials: per decade, and beyond the times asked for
EXPONENTIALS = 8
DECADES = 2.0


@dataclass(frozen=True)
class Prony:
    """G = `rest` + sum g_i exp(-t/tau_i); without a rest given, of what is left of 1.

    fractions g_i >= 0 of the instantaneous modulus and times tau_i > 0.
    """

    fractions: tuple[float, ...]
    times: tuple[float, ...]
    rest: float | None = None

    @property
    def lasting(self) -> float:
        """G at infinite time."""
        return 1.0 - sum(self.fractions) if self.rest is None else self.rest

    def _sum(self, terms: np.ndarray) -> np.ndarray:
        return (
            np.tensordot(np.array(self.fractions), terms, axes=1)
            if self.fractions
            else 0.0 * terms.sum(axis=0)
        )

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """G at times t >= 0."""
        t = np.asarray(t, dtype=float)
        return self.lasting + self._sum(
            np.array([np.exp(-t / tau) for tau in self.times] or [0.0 * t])
        )

    def integral(self, t: np.ndarray) -> np.ndarray:
        """int_0^t G [time]."""
        t = np.asarray(t, dtype=float)
        return self.lasting * t + self._sum(
            np.array([-tau * np.expm1(-t / tau) for tau in self.times] or [0.0 * t])
        )

    def complex(self, omega: float) -> complex:
        """Storage + i loss at the angular frequency omega [1/time], over E."""
        pairs = zip(self.fractions, self.times, strict=True)
        return self.lasting + sum(g * 1j * omega * tau / (1 + 1j * omega * tau) for g, tau in pairs)

    def prony(self, shortest: float, longest: float) -> Prony:
        """Itself."""
        return self

    def over(self, t: np.ndarray) -> Sampled:
        """What relaxation makes of elastic forces at times (n,), increasing: F = rest F_el + sum
        g_i h_i, dh_i/dt = dF_el/dt - h_i/tau_i, exact where F_el is linear between the times.
        """
        from scipy.signal import lfilter  # which curves that are not sampled do not need

        dt = np.diff(t)
        steady = bool(len(dt)) and bool(np.all(np.abs(dt - dt[0]) <= SAME_PACE * abs(dt[0])))

        def held(first: float, decay: np.ndarray, gain: np.ndarray) -> np.ndarray:
            """h_j = h_{j-1} decay_j + gain_j."""
            if steady:
                return lfilter([1.0], [1.0, -decay[0]], gain, zi=np.array([decay[0] * first]))[0]
            found = np.empty(len(decay))
            now = first
            for j, (d, g) in enumerate(zip(map(float, decay), map(float, gain), strict=True)):
                now = now * d + g
                found[j] = now
            return found

        def relaxed(elastic: np.ndarray) -> np.ndarray:
            rise = np.diff(elastic)
            force = self.lasting * elastic
            for fraction, tau in zip(self.fractions, self.times, strict=True):
                gain = np.where(
                    dt > 0, rise * -np.expm1(-dt / tau) * tau / np.where(dt > 0, dt, 1.0), rise
                )
                force = force + fraction * np.append(
                    elastic[0], held(elastic[0], np.exp(-dt / tau), gain)
                )
            return force

        return relaxed


@dataclass(frozen=True)
class PowerLaw:
    """G = (t/time)^-exponent, 0 < exponent < 1: infinite at t = 0."""

    exponent: float
    time: float

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """G at times t > 0."""
        return (np.asarray(t, dtype=float) / self.time) ** -self.exponent

    def integral(self, t: np.ndarray) -> np.ndarray:
        """int_0^t G [time]."""
        b = self.exponent
        return self.time / (1.0 - b) * (np.asarray(t, dtype=float) / self.time) ** (1.0 - b)

    def complex(self, omega: float) -> complex:
        """Storage + i loss at the angular frequency omega [1/time], over E: Gamma(1 - b) (i omega
        time)^b.
        """
        return math.gamma(1.0 - self.exponent) * (1j * omega * self.time) ** self.exponent

    def prony(self, shortest: float, longest: float) -> Prony:
        """t^-b = int_0^inf s^(b-1) e^(-ts) ds/Gamma(b) by equal steps of ln s: 1e-6 between the two
        times.
        """
        b = self.exponent
        step = math.log(10.0) / EXPONENTIALS
        tail = 1e-9 ** (1.0 / b) / longest  # slower rates are worth less than 1e-9
        low = math.log(max(tail, 10.0**-DECADES * 1e-4 / longest))
        rates = np.exp(np.arange(low, math.log(10.0**DECADES / shortest), step))
        weights = step * (rates * self.time) ** b / math.gamma(b)
        rest = (rates[0] * self.time * math.exp(-0.5 * step)) ** b / math.gamma(
            1.0 + b
        )  # all slower rates at once
        return Prony(tuple(weights.tolist()), tuple((1.0 / rates).tolist()), float(rest))

    def over(self, t: np.ndarray) -> Sampled:
        """What relaxation makes of elastic forces at times (n,), increasing, as a sum of
        exponentials does.
        """
        span = max(float(np.ptp(t)), 1e-300)
        return self.prony(SHORTEST_SHARE * span / max(len(t) - 1, 1), span).over(t)


Modulus = Prony | PowerLaw  # G(t) = E(t)/E of a linear viscoelastic material


class ElasticCurve:
    """Force and contact radius of an elastic body over the depth, from samples: splines of their
    logarithms.

    delta [L] > 0 increasing, force [F] and a [L] (n,); below the first sample a power law goes on.
    ValueError for too few.
    """

    def __init__(self, delta: np.ndarray, force: np.ndarray, a: np.ndarray):
        if len(delta) < LEAST_SAMPLES:
            raise ValueError(
                f"{len(delta)} rows are too few to know a curve by, at least {LEAST_SAMPLES}"
            )
        self.deepest = float(delta[-1])
        self._low = math.log(delta[0])
        self._force, self._a = (CubicSpline(np.log(delta), np.log(values)) for values in (force, a))

    def _power(self, spline: CubicSpline, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value and derivative along ln delta of a spline's exponential, both 0 for delta <= 0."""
        delta = np.asarray(delta, dtype=float)
        x = np.log(np.where(delta > 0, delta, 1.0))
        inside = np.maximum(x, self._low)
        slope = spline(inside, 1)
        value = np.where(delta > 0, np.exp(spline(inside) + slope * (x - inside)), 0.0)
        return value, slope * value

    def force(self, delta: np.ndarray) -> np.ndarray:
        """Force [F] at depths [L]."""
        return self._power(self._force, delta)[0]

    def stiffness(self, delta: np.ndarray) -> np.ndarray:
        """dF/ddelta [F/L]; 0 without contact."""
        delta = np.asarray(delta, dtype=float)
        return self._power(self._force, delta)[1] / np.where(delta > 0, delta, 1.0)

    def a(self, delta: np.ndarray) -> np.ndarray:
        """Contact radius [L] at depths [L]."""
        return self._power(self._a, delta)[0]

    def depth(self, force: float) -> float:
        """The depth [L] of a force [F] >= 0; ValueError where it is beyond the deepest sample."""
        if not 0.0 <= force <= float(self.force(np.array(self.deepest))):
            raise ValueError(f"the force {force:g} is beyond the deepest point known")
        return self._root(lambda x: float(self.force(np.array(x))) - force, self.deepest)

    def depth_behind(self, compliance: float, z: float) -> float:
        """The depth [L] at which delta + compliance force = z [L]; ValueError where it is beyond
        the deepest sample.
        """
        if z <= 0.0 or compliance == 0.0:
            return z
        high = min(z, self.deepest)
        if high + compliance * float(self.force(np.array(high))) < z:
            raise ValueError(f"the depth at z = {z:g} is beyond the deepest point known")
        return self._root(lambda x: x + compliance * float(self.force(np.array(x))) - z, high)

    def _root(self, equation: Callable[[float], float], high: float) -> float:
        return float(brentq(equation, 0.0, high, xtol=1e-15 * high))


@dataclass(frozen=True)
class Response:
    """What a tip feels at one time: its depth delta [L], the force [F], the contact radius a [L],
    and the depth `elastic` [L] at which an elastic body has that contact.
    """

    t: float
    delta: float
    force: float
    a: float
    elastic: float


class OneCycle:
    """The response to a history of depths that never fall before they never rise, exact by
    quadrature.

    times never fall, deltas [L] are joined by straight lines; two equal times are a jump, which a
    power law refuses.
    """

    def __init__(
        self, modulus: Modulus, times: Sequence[float], deltas: Sequence[float], curve: ElasticCurve
    ):
        self.modulus = modulus
        self.curve = curve
        self._t = np.array(times, dtype=float)
        self._d = np.array(deltas, dtype=float)
        steps = np.diff(self._d)
        falls = np.flatnonzero(steps < 0)
        self._top = (
            int(falls[0]) if len(falls) else len(steps)
        )  # the point from which the tip goes back
        if np.any(steps[self._top :] > 0):
            raise ValueError("the tip comes back after it went away: that is no single cycle")
        self.deepest = float(self._d[self._top])

    def at(self, t: float, after: bool = True) -> Response:
        """The response at a time; at a jump after it, or before."""
        delta, k = self._place(t, after)
        elastic = max(delta, 0.0) if k <= self._top else self._shrunk(t, delta, k)
        if elastic <= 0.0:
            return Response(t, delta, 0.0, 0.0, 0.0)
        return Response(
            t, delta, self._force(t, elastic), float(self.curve.a(np.array(elastic))), elastic
        )

    def _place(self, t: float, after: bool) -> tuple[float, int]:
        """The depth at a time, and the number of the point at the end of its piece."""
        earlier = np.count_nonzero(self._t <= t if after else self._t < t)
        if earlier == 0:  # at rest, as the history begins
            return float(self._d[0]), 0
        k = min(max(earlier, 1), len(self._t) - 1)
        if t >= self._t[k]:
            return float(self._d[k]), k
        if t == self._t[k - 1]:
            return float(self._d[k - 1]), max(k - 1, min(k, self._top))
        return float(np.interp(t, self._t[k - 1 : k + 1], self._d[k - 1 : k + 1])), k

    def _rising(self, low: float, high: float) -> list[tuple[float, float, float, float]]:
        """The pieces of the approach between two depths: (depth, depth, time, time), a jump having
        equal times.
        """
        pieces = []
        for k in range(self._top):
            d0 = self._d[k]
            d1 = self._d[k + 1]
            t0 = self._t[k]
            t1 = self._t[k + 1]
            begin = max(d0, low, 0.0)
            end = min(d1, high)
            if end > begin:
                slowness = (t1 - t0) / (d1 - d0)
                pieces.append(
                    (begin, end, t0 + slowness * (begin - d0), t0 + slowness * (end - d0))
                )
        return pieces

    def _force(self, t: float, elastic: float) -> float:
        """int_0^elastic G(t - s) F_el' d delta, on nodes that crowd at both ends of every piece."""
        total = 0.0
        for low, high, begin, end in self._rising(0.0, elastic):
            u, v, w = _ENDS
            depth = low + (high - low) * u
            age = np.maximum(t - end, 0.0) + (end - begin) * v
            total += (high - low) * float(w @ (self.modulus(age) * self.curve.stiffness(depth)))
        return total

    def _moved(self, t: float, d0: float, d1: float, t0: float, t1: float) -> float:
        """int G(t - s) d delta over a straight piece of the path."""
        if t1 == t0:
            return float((d1 - d0) * self.modulus(np.array(t - t0)))
        ages = self.modulus.integral(np.array([t - t0, max(t - t1, 0.0)]))
        return float((d1 - d0) / (t1 - t0) * (ages[0] - ages[1]))

    def _shrunk(self, t: float, delta: float, k: int) -> float:
        """delta_1 of a contact that shrinks; 0 after lift-off."""
        d = self._d
        s = self._t
        back = sum(self._moved(t, d[i], d[i + 1], s[i], s[i + 1]) for i in range(self._top, k - 1))
        if t > self._t[k - 1] or delta != self._d[k - 1]:
            back += self._moved(t, self._d[k - 1], delta, self._t[k - 1], t)

        def balance(depth: float) -> float:
            return back + sum(self._moved(t, *piece) for piece in self._rising(depth, self.deepest))

        if balance(0.0) <= 0.0:
            return 0.0
        return float(brentq(balance, 0.0, self.deepest, xtol=1e-14 * self.deepest))

    def regrows(self, times: Sequence[float]) -> bool:
        """Whether the contact, once it shrinks, grows again at any of these times: then this is not
        the answer.
        """
        back = [self.at(t).elastic for t in times if t >= self._t[self._top]]
        return bool(np.any(np.diff(back) > REGROWN * self.deepest))


def _end_crowding(points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes u in (0, 1), 1 - u without loss of digits, and weights of the double-exponential rule."""
    x = np.linspace(-3.2, 3.2, points)
    s = 0.5 * math.pi * np.sinh(x)
    u = 1.0 / (1.0 + np.exp(-2.0 * s))
    v = 1.0 / (1.0 + np.exp(2.0 * s))
    return u, v, (x[1] - x[0]) * math.pi * np.cosh(x) * u * v


_ENDS = _end_crowding(161)
