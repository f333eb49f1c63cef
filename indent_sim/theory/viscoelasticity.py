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

MIN_CURVE_SAMPLES = 4  # of an elastic curve
REGROWTH_TOLERANCE = 1e-9  # of the largest depth: by more than that the contact grows again
EQUAL_STEP_TOLERANCE = 1e-6  # relative: samples at equal times
SHORTEST_TIME_FRACTION = (
    1e-3  # of the time between samples: shorter times of a power law are not seen
)
ForceRelaxation = Callable[
    [np.ndarray], np.ndarray
]  # the force of a relaxing body by the elastic forces at some times
# a power law as a sum of exponentials: per decade, and beyond the times asked for
EXPONENTIALS_PER_DECADE = 8
EXTRA_DECADES = 2.0


@dataclass(frozen=True)
class ShearRelaxation:
    """G = `rest` + sum g_i exp(-t/tau_i); without a rest given, of what is left of 1.

    fractions g_i >= 0 of the instantaneous modulus and times tau_i > 0.
    """

    fractions: tuple[float, ...]
    times: tuple[float, ...]
    given_long_term: float | None = None

    @property
    def long_term(self) -> float:
        """G at infinite time."""
        return 1.0 - sum(self.fractions) if self.given_long_term is None else self.given_long_term

    def _sum(self, terms: np.ndarray) -> np.ndarray:
        return (
            np.tensordot(np.array(self.fractions), terms, axes=1)
            if self.fractions
            else 0.0 * terms.sum(axis=0)
        )

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """G at times t >= 0."""
        t = np.asarray(t, dtype=float)
        return self.long_term + self._sum(
            np.array([np.exp(-t / tau) for tau in self.times] or [0.0 * t])
        )

    def integral(self, t: np.ndarray) -> np.ndarray:
        """int_0^t G [time]."""
        t = np.asarray(t, dtype=float)
        return self.long_term * t + self._sum(
            np.array([-tau * np.expm1(-t / tau) for tau in self.times] or [0.0 * t])
        )

    def complex_modulus(self, omega: float) -> complex:
        """Storage + i loss at the angular frequency omega [1/time], over E."""
        pairs = zip(self.fractions, self.times, strict=True)
        return self.long_term + sum(
            g * 1j * omega * tau / (1 + 1j * omega * tau) for g, tau in pairs
        )

    def prony_series(self, shortest: float, longest: float) -> ShearRelaxation:
        """Itself."""
        return self

    def force_relaxation(self, t: np.ndarray) -> ForceRelaxation:
        """What relaxation makes of elastic forces at times (n,), increasing: F = rest F_el + sum
        g_i h_i, dh_i/dt = dF_el/dt - h_i/tau_i, exact where F_el is linear between the times.
        """
        from scipy.signal import lfilter  # which curves that are not sampled do not need

        dt = np.diff(t)
        has_equal_steps = bool(len(dt)) and bool(
            np.all(np.abs(dt - dt[0]) <= EQUAL_STEP_TOLERANCE * abs(dt[0]))
        )

        def recurrence(first: float, decay: np.ndarray, gain: np.ndarray) -> np.ndarray:
            """h_j = h_{j-1} decay_j + gain_j."""
            if has_equal_steps:
                return lfilter([1.0], [1.0, -decay[0]], gain, zi=np.array([decay[0] * first]))[0]
            values = np.empty(len(decay))
            value = first
            for j, (d, g) in enumerate(zip(map(float, decay), map(float, gain), strict=True)):
                value = value * d + g
                values[j] = value
            return values

        def relax_forces(elastic: np.ndarray) -> np.ndarray:
            force_steps = np.diff(elastic)
            force = self.long_term * elastic
            for fraction, tau in zip(self.fractions, self.times, strict=True):
                gain = np.where(
                    dt > 0,
                    force_steps * -np.expm1(-dt / tau) * tau / np.where(dt > 0, dt, 1.0),
                    force_steps,
                )
                force = force + fraction * np.append(
                    elastic[0], recurrence(elastic[0], np.exp(-dt / tau), gain)
                )
            return force

        return relax_forces


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

    def complex_modulus(self, omega: float) -> complex:
        """Storage + i loss at the angular frequency omega [1/time], over E: Gamma(1 - b) (i omega
        time)^b.
        """
        return math.gamma(1.0 - self.exponent) * (1j * omega * self.time) ** self.exponent

    def prony_series(self, shortest: float, longest: float) -> ShearRelaxation:
        """t^-b = int_0^inf s^(b-1) e^(-ts) ds/Gamma(b) by equal steps of ln s: 1e-6 between the two
        times.
        """
        b = self.exponent
        step = math.log(10.0) / EXPONENTIALS_PER_DECADE
        slowest_rate = 1e-9 ** (1.0 / b) / longest  # slower rates are worth less than 1e-9
        log_slowest_rate = math.log(max(slowest_rate, 10.0**-EXTRA_DECADES * 1e-4 / longest))
        rates = np.exp(np.arange(log_slowest_rate, math.log(10.0**EXTRA_DECADES / shortest), step))
        weights = step * (rates * self.time) ** b / math.gamma(b)
        long_term = (rates[0] * self.time * math.exp(-0.5 * step)) ** b / math.gamma(
            1.0 + b
        )  # all slower rates at once
        return ShearRelaxation(
            tuple(weights.tolist()), tuple((1.0 / rates).tolist()), float(long_term)
        )

    def force_relaxation(self, t: np.ndarray) -> ForceRelaxation:
        """What relaxation makes of elastic forces at times (n,), increasing, as a sum of
        exponentials does.
        """
        span = max(float(np.ptp(t)), 1e-300)
        return self.prony_series(
            SHORTEST_TIME_FRACTION * span / max(len(t) - 1, 1), span
        ).force_relaxation(t)


Modulus = ShearRelaxation | PowerLaw  # G(t) = E(t)/E of a linear viscoelastic material


class ElasticCurve:
    """Force and contact radius of an elastic body over the depth, from samples: splines of their
    logarithms.

    delta [L] > 0 increasing, force [F] and a [L] (n,); below the first sample a power law goes on.
    ValueError for too few.
    """

    def __init__(self, delta: np.ndarray, force: np.ndarray, a: np.ndarray):
        if len(delta) < MIN_CURVE_SAMPLES:
            raise ValueError(
                f"{len(delta)} rows are too few to know a curve by, at least {MIN_CURVE_SAMPLES}"
            )
        self.deepest = float(delta[-1])
        self._low = math.log(delta[0])
        self._force, self._a = (CubicSpline(np.log(delta), np.log(values)) for values in (force, a))

    def _value_and_slope(
        self, spline: CubicSpline, delta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Value and derivative along ln delta of a spline's exponential, both 0 for delta <= 0."""
        delta = np.asarray(delta, dtype=float)
        x = np.log(np.where(delta > 0, delta, 1.0))
        log_depth_inside = np.maximum(x, self._low)
        slope = spline(log_depth_inside, 1)
        value = np.where(
            delta > 0, np.exp(spline(log_depth_inside) + slope * (x - log_depth_inside)), 0.0
        )
        return value, slope * value

    def force(self, delta: np.ndarray) -> np.ndarray:
        """Force [F] at depths [L]."""
        return self._value_and_slope(self._force, delta)[0]

    def stiffness(self, delta: np.ndarray) -> np.ndarray:
        """dF/ddelta [F/L]; 0 without contact."""
        delta = np.asarray(delta, dtype=float)
        return self._value_and_slope(self._force, delta)[1] / np.where(delta > 0, delta, 1.0)

    def contact_radius(self, delta: np.ndarray) -> np.ndarray:
        """Contact radius [L] at depths [L]."""
        return self._value_and_slope(self._a, delta)[0]

    def depth_of_force(self, force: float) -> float:
        """The depth [L] of a force [F] >= 0; ValueError where it is beyond the deepest sample."""
        if not 0.0 <= force <= float(self.force(np.array(self.deepest))):
            raise ValueError(f"the force {force:g} is beyond the deepest point known")
        return self._root(lambda x: float(self.force(np.array(x))) - force, self.deepest)

    def depth_behind_spring(self, compliance: float, z: float) -> float:
        """The depth [L] at which delta + compliance force = z [L]; ValueError where it is beyond
        the deepest sample.
        """
        if z <= 0.0 or compliance == 0.0:
            return z
        upper_depth = min(z, self.deepest)
        if upper_depth + compliance * float(self.force(np.array(upper_depth))) < z:
            raise ValueError(f"the depth at z = {z:g} is beyond the deepest point known")
        return self._root(
            lambda x: x + compliance * float(self.force(np.array(x))) - z, upper_depth
        )

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
    elastic_depth: float


class LeeRadokTing:
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
        self._times = np.array(times, dtype=float)
        self._depths = np.array(deltas, dtype=float)
        steps = np.diff(self._depths)
        falls = np.flatnonzero(steps < 0)
        self._peak_index = (
            int(falls[0]) if len(falls) else len(steps)
        )  # the point from which the tip goes back
        if np.any(steps[self._peak_index :] > 0):
            raise ValueError("the tip comes back after it went away: that is no single cycle")
        self.deepest = float(self._depths[self._peak_index])

    def response_at(self, t: float, is_after_jump: bool = True) -> Response:
        """The response at a time; at a jump after it, or before."""
        delta, k = self._depth_at(t, is_after_jump)
        elastic_depth = (
            max(delta, 0.0) if k <= self._peak_index else self._depth_while_unloading(t, delta, k)
        )
        if elastic_depth <= 0.0:
            return Response(t, delta, 0.0, 0.0, 0.0)
        return Response(
            t,
            delta,
            self._force(t, elastic_depth),
            float(self.curve.contact_radius(np.array(elastic_depth))),
            elastic_depth,
        )

    def _depth_at(self, t: float, is_after_jump: bool) -> tuple[float, int]:
        """The depth at a time, and the number of the point at the end of its piece."""
        point_count = np.count_nonzero(self._times <= t if is_after_jump else self._times < t)
        if point_count == 0:  # at rest, as the history begins
            return float(self._depths[0]), 0
        k = min(max(point_count, 1), len(self._times) - 1)
        if t >= self._times[k]:
            return float(self._depths[k]), k
        if t == self._times[k - 1]:
            return float(self._depths[k - 1]), max(k - 1, min(k, self._peak_index))
        return float(np.interp(t, self._times[k - 1 : k + 1], self._depths[k - 1 : k + 1])), k

    def _loading_segments(self, low: float, high: float) -> list[tuple[float, float, float, float]]:
        """The pieces of the approach between two depths: (depth, depth, time, time), a jump having
        equal times.
        """
        segments = []
        for k in range(self._peak_index):
            d0 = self._depths[k]
            d1 = self._depths[k + 1]
            t0 = self._times[k]
            t1 = self._times[k + 1]
            start_depth = max(d0, low, 0.0)
            end_depth = min(d1, high)
            if end_depth > start_depth:
                slowness = (t1 - t0) / (d1 - d0)
                segments.append(
                    (
                        start_depth,
                        end_depth,
                        t0 + slowness * (start_depth - d0),
                        t0 + slowness * (end_depth - d0),
                    )
                )
        return segments

    def _force(self, t: float, elastic_depth: float) -> float:
        """int_0^elastic G(t - s) F_el' d delta, on nodes that crowd at both ends of every piece."""
        force = 0.0
        for low, high, begin, end in self._loading_segments(0.0, elastic_depth):
            u, v, w = _SEGMENT_NODES
            depth = low + (high - low) * u
            age = np.maximum(t - end, 0.0) + (end - begin) * v
            force += (high - low) * float(w @ (self.modulus(age) * self.curve.stiffness(depth)))
        return force

    def _relaxed_depth_change(self, t: float, d0: float, d1: float, t0: float, t1: float) -> float:
        """int G(t - s) d delta over a straight piece of the path."""
        if t1 == t0:
            return float((d1 - d0) * self.modulus(np.array(t - t0)))
        ages = self.modulus.integral(np.array([t - t0, max(t - t1, 0.0)]))
        return float((d1 - d0) / (t1 - t0) * (ages[0] - ages[1]))

    def _depth_while_unloading(self, t: float, delta: float, k: int) -> float:
        """delta_1 of a contact that shrinks; 0 after lift-off."""
        d = self._depths
        s = self._times
        unloading_integral = sum(
            self._relaxed_depth_change(t, d[i], d[i + 1], s[i], s[i + 1])
            for i in range(self._peak_index, k - 1)
        )
        if t > self._times[k - 1] or delta != self._depths[k - 1]:
            unloading_integral += self._relaxed_depth_change(
                t, self._depths[k - 1], delta, self._times[k - 1], t
            )

        def balance(depth: float) -> float:
            return unloading_integral + sum(
                self._relaxed_depth_change(t, *piece)
                for piece in self._loading_segments(depth, self.deepest)
            )

        if balance(0.0) <= 0.0:
            return 0.0
        return float(brentq(balance, 0.0, self.deepest, xtol=1e-14 * self.deepest))

    def contact_grows_again(self, times: Sequence[float]) -> bool:
        """Whether the contact, once it shrinks, grows again at any of these times: then this is not
        the answer.
        """
        elastic_depths = [
            self.response_at(t).elastic_depth for t in times if t >= self._times[self._peak_index]
        ]
        return bool(np.any(np.diff(elastic_depths) > REGROWTH_TOLERANCE * self.deepest))


def _double_exponential_nodes(points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes u in (0, 1), 1 - u without loss of digits, and weights of the double-exponential rule."""
    x = np.linspace(-3.2, 3.2, points)
    s = 0.5 * math.pi * np.sinh(x)
    u = 1.0 / (1.0 + np.exp(-2.0 * s))
    v = 1.0 / (1.0 + np.exp(2.0 * s))
    return u, v, (x[1] - x[0]) * math.pi * np.cosh(x) * u * v


_SEGMENT_NODES = _double_exponential_nodes(161)
