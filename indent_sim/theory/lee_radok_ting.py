"""Viscoelastic indentation from the elastic curve: Lee-Radok for loading, Ting for unloading.

For a homogeneous linear body with constant Poisson's ratio and the modulus E(t) = E G(t), G(0) = 1,
force and contact radius during loading and the following unloading are

    F(t) = int_0^delta_1 G(t - s(delta)) F_el'(delta) d delta,   a(t) = a_el(delta_1):

where loading reached the depth delta at the time s(delta). While the contact grows, delta_1 =
delta(t) (Lee & Radok 1960). While it shrinks (Ting 1966), delta_1 follows from int_delta_1^max G(t
- s(delta)) d delta + int_unloading G(t - s) delta'(s) ds = 0. This is exact for any shape of body
and tip.

delta and force are > 0 in indentation. Any unit of time.
Sources: Lee & Radok (1960), J. Appl. Mech. 27, 438; Ting (1966), J. Appl. Mech. 33, 845.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from indent_sim.theory.elastic_curve import ElasticCurve
from indent_sim.theory.relaxation_function import Modulus


@dataclass(frozen=True)
class Response:
    """Response at time t: depth delta [L], force [F], contact radius a [L] and elastic depth [L].

    The elastic depth is the depth at which an elastic body has the same contact radius.
    """

    t: float
    delta: float
    force: float
    a: float
    elastic_depth: float


class LeeRadokTing:
    """Response to a history of depths that increase and then decrease, by quadrature.

    `deltas` [L] at non-decreasing `times` are interpolated linearly; two equal times are a jump,
    which is not allowed with a power law.
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
        # The point at which unloading begins.
        self._peak_index = int(falls[0]) if len(falls) else len(steps)
        if np.any(steps[self._peak_index :] > 0):
            raise ValueError(
                "the depth increases again after it has decreased: Ting's solution needs a single "
                "cycle of loading and unloading"
            )
        self.deepest = float(self._depths[self._peak_index])

    def response_at(self, t: float, is_after_jump: bool = True) -> Response:
        """Return the response at a time; at a jump, the response after or before the jump."""
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
        """Return the depth at a time, and the number of the end point of the current segment."""
        point_count = np.count_nonzero(self._times <= t if is_after_jump else self._times < t)
        if point_count == 0:
            # The tip is at rest before the history begins.
            return float(self._depths[0]), 0
        k = min(max(point_count, 1), len(self._times) - 1)
        if t >= self._times[k]:
            return float(self._depths[k]), k
        if t == self._times[k - 1]:
            return float(self._depths[k - 1]), max(k - 1, min(k, self._peak_index))
        return float(np.interp(t, self._times[k - 1 : k + 1], self._depths[k - 1 : k + 1])), k

    def _loading_segments(self, low: float, high: float) -> list[tuple[float, float, float, float]]:
        """Return the loading segments between two depths as (depth, depth, time, time).

        The two times of a jump are equal.
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
        """Return the force int_0^elastic G(t - s) F_el' d delta [F] by graded quadrature."""
        force = 0.0
        for low, high, begin, end in self._loading_segments(0.0, elastic_depth):
            u, v, w = _SEGMENT_NODES
            depth = low + (high - low) * u
            age = np.maximum(t - end, 0.0) + (end - begin) * v
            force += (high - low) * float(w @ (self.modulus(age) * self.curve.stiffness(depth)))
        return force

    def _relaxed_depth_change(self, t: float, d0: float, d1: float, t0: float, t1: float) -> float:
        """Return int G(t - s) d delta over a straight segment of the history."""
        if t1 == t0:
            return float((d1 - d0) * self.modulus(np.array(t - t0)))
        ages = self.modulus.integral(np.array([t - t0, max(t - t1, 0.0)]))
        return float((d1 - d0) / (t1 - t0) * (ages[0] - ages[1]))

    def _depth_while_unloading(self, t: float, delta: float, k: int) -> float:
        """Return the elastic depth delta_1 [L] of a shrinking contact; 0 after separation."""
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
            """Return the sum of both integrals of Ting's condition for delta_1 = depth."""
            return unloading_integral + sum(
                self._relaxed_depth_change(t, *piece)
                for piece in self._loading_segments(depth, self.deepest)
            )

        if balance(0.0) <= 0.0:
            return 0.0
        return float(brentq(balance, 0.0, self.deepest, xtol=1e-14 * self.deepest))

    def contact_grows_again(self, times: Sequence[float]) -> bool:
        """Return whether the contact grows again during retraction at any of the given times.

        Ting's solution is not valid in this case.
        """
        elastic_depths = [
            self.response_at(t).elastic_depth for t in times if t >= self._times[self._peak_index]
        ]
        # A smaller increase is a rounding error.
        return bool(np.any(np.diff(elastic_depths) > 1e-9 * self.deepest))


def _double_exponential_nodes(points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes u in (0, 1), accurate values 1 - u, and weights (double-exponential rule)."""
    x = np.linspace(-3.2, 3.2, points)
    s = 0.5 * math.pi * np.sinh(x)
    u = 1.0 / (1.0 + np.exp(-2.0 * s))
    v = 1.0 / (1.0 + np.exp(2.0 * s))
    return u, v, (x[1] - x[0]) * math.pi * np.cosh(x) * u * v


_SEGMENT_NODES = _double_exponential_nodes(161)
