"""Relaxation functions G(t) = E(t)/E of linear viscoelastic materials: Prony series and power law.

The force of a body of constant Poisson ratio is F(t) = ∫ G(t - s) dF_el(s), with F_el its elastic
force, > 0 while the tip pushes. Any unit of time.
Source: Tschoegl (1989), Phenomenological Theory of Linear Viscoelastic Behavior, chapters 3 and 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# Function from the elastic forces at some times to those of the relaxing body.
ForceRelaxation = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ShearRelaxation:
    """Prony series G = g_inf + sum g_i exp(-t/tau_i) of a relaxing shear modulus.

    `fractions` g_i >= 0 refer to the instantaneous modulus, `times` are tau_i > 0. Without a
    `given_long_term`, g_inf = 1 - sum g_i.
    """

    fractions: tuple[float, ...]
    times: tuple[float, ...]
    given_long_term: float | None = None

    @property
    def long_term(self) -> float:
        """Long-term value g_inf of G."""
        return 1.0 - sum(self.fractions) if self.given_long_term is None else self.given_long_term

    def _sum(self, terms: np.ndarray) -> np.ndarray:
        """Return the sum over the Prony terms, sum g_i terms_i."""
        if not self.fractions:
            return 0.0 * terms.sum(axis=0)
        return np.tensordot(np.array(self.fractions), terms, axes=1)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Return G at times t >= 0."""
        t = np.asarray(t, dtype=float)
        return self.long_term + self._sum(
            np.array([np.exp(-t / tau) for tau in self.times] or [0.0 * t])
        )

    def integral(self, t: np.ndarray) -> np.ndarray:
        """Return the integral int_0^t G [time]."""
        t = np.asarray(t, dtype=float)
        return self.long_term * t + self._sum(
            np.array([-tau * np.expm1(-t / tau) for tau in self.times] or [0.0 * t])
        )

    def complex_modulus(self, omega: float) -> complex:
        """Return the complex modulus (storage + i loss)/E at angular frequency omega [1/time]."""
        pairs = zip(self.fractions, self.times, strict=True)
        return self.long_term + sum(
            g * 1j * omega * tau / (1 + 1j * omega * tau) for g, tau in pairs
        )

    def prony_series(self, shortest: float, longest: float) -> ShearRelaxation:
        """Return this Prony series unchanged."""
        return self

    def force_relaxation(self, t: np.ndarray) -> ForceRelaxation:
        """Return the function that maps elastic forces at times t (n,) to relaxed forces.

        F = g_inf F_el + sum g_i h_i with dh_i/dt = dF_el/dt - h_i/tau_i, exact where F_el is linear
        between the times.
        """
        # Imported here because only sampled curves need it.
        from scipy.signal import lfilter

        dt = np.diff(t)
        has_equal_steps = bool(len(dt)) and bool(np.all(np.abs(dt - dt[0]) <= 1e-6 * abs(dt[0])))

        def recurrence(first: float, decay: np.ndarray, gain: np.ndarray) -> np.ndarray:
            """Return h_j = h_{j-1} decay_j + gain_j for all j, starting from the first value."""
            if has_equal_steps:
                return lfilter([1.0], [1.0, -decay[0]], gain, zi=np.array([decay[0] * first]))[0]
            values = np.empty(len(decay))
            value = first
            for j, (d, g) in enumerate(zip(map(float, decay), map(float, gain), strict=True)):
                value = value * d + g
                values[j] = value
            return values

        def relax_forces(elastic: np.ndarray) -> np.ndarray:
            """Return the relaxed forces for given elastic forces."""
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
    """Power law G = (t/time)^-exponent with 0 < exponent < 1, infinite at t = 0."""

    exponent: float
    time: float

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Return G at times t > 0."""
        return (np.asarray(t, dtype=float) / self.time) ** -self.exponent

    def integral(self, t: np.ndarray) -> np.ndarray:
        """Return the integral int_0^t G [time]."""
        b = self.exponent
        return self.time / (1.0 - b) * (np.asarray(t, dtype=float) / self.time) ** (1.0 - b)

    def complex_modulus(self, omega: float) -> complex:
        """Return the complex modulus (storage + i loss)/E = Gamma(1 - b) (i omega time)^b.

        omega is the angular frequency [1/time], and b the exponent.
        """
        return math.gamma(1.0 - self.exponent) * (1j * omega * self.time) ** self.exponent

    def prony_series(self, shortest: float, longest: float) -> ShearRelaxation:
        """Return a Prony series that is accurate to 1e-6 between the shortest and the longest time.

        t^-b = int_0^inf s^(b-1) e^(-ts) ds/Gamma(b), integrated with equal steps of ln s.
        """
        b = self.exponent
        step = math.log(10.0) / 8  # Eight exponentials per decade.
        # Slower rates contribute less than 1e-9.
        slowest_rate = 1e-9 ** (1.0 / b) / longest
        # Decades of a Prony series beyond the shortest and the longest time.
        extra_decades = 2.0
        log_slowest_rate = math.log(max(slowest_rate, 10.0**-extra_decades * 1e-4 / longest))
        rates = np.exp(np.arange(log_slowest_rate, math.log(10.0**extra_decades / shortest), step))
        weights = step * (rates * self.time) ** b / math.gamma(b)
        # The integral over all slower rates is a constant.
        long_term = (rates[0] * self.time * math.exp(-0.5 * step)) ** b / math.gamma(1.0 + b)
        return ShearRelaxation(
            tuple(weights.tolist()), tuple((1.0 / rates).tolist()), float(long_term)
        )

    def force_relaxation(self, t: np.ndarray) -> ForceRelaxation:
        """Return the function that maps elastic forces at times t (n,) to relaxed forces."""
        span = max(float(np.ptp(t)), 1e-300)
        # The series begins with a thousandth of the mean time between samples.
        return self.prony_series(1e-3 * span / max(len(t) - 1, 1), span).force_relaxation(t)


Modulus = ShearRelaxation | PowerLaw  # G(t) = E(t)/E of a linear viscoelastic material.
