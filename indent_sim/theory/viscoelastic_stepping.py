"""Contact of a viscoelastic body by time stepping, for any history of depths or forces.

The surface of a linear body carries pressures p >= 0 at n points. Weighted with areas, the gaps are

    heights - delta areas + A phi >= 0,   F = areas . p,   p(t) = int G(t - s) dphi(s),

where phi are the pressures of the elastic body with the same surface displacements. If G is a sum
of exponentials and phi linear over a step, p = alpha phi + H with a history term H, so that every
step is an elastic contact problem with the compliance A/alpha. The error is of second order in the
step size. A spring between the tip and its base, z = delta + c F, adds c areas areas^T to the
compliance.

Unlike Ting's solution (`lee_radok_ting`), this method is valid for histories with reloading.

delta and force are > 0 in indentation. Lengths [L], forces [F], any unit of time.
Source: Taylor, Pister & Goudreau (1970), Int. J. Numer. Methods Eng. 2, 45, for the recursion of
exponentials.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from indent_sim.theory.lee_radok_ting import Response
from indent_sim.theory.relaxation_function import ShearRelaxation
from indent_sim.theory.surface_contact import (
    CandidateSetTooSmall,
    RelaxingSurface,
    SearchNotConverged,
    SurfaceContactLCP,
)

MAX_SEARCH_STEPS = 60  # Newton steps of the search for the depth of a force.


class ViscoelasticTimeStepper:
    """Response of a viscoelastic body to a history of depths, base displacements or forces.

    Parameters
    ----------
    surface
        Compliance of the unrelaxed body at the points of its surface.
    modulus
        Relaxation function G(t), 1 at t = 0.
    compliance
        Compliance c [L/F] of a spring between tip and base, whose displacement z = delta + c F is
        then prescribed; 0 for prescribed depths.
    is_force_controlled
        Whether the history consists of forces [F].
    """

    def __init__(
        self,
        surface: RelaxingSurface,
        modulus: ShearRelaxation,
        compliance: float = 0.0,
        is_force_controlled: bool = False,
    ):
        self.surface = surface
        self.modulus = modulus
        self.compliance = compliance
        self.is_force_controlled = is_force_controlled
        n = len(surface.areas)
        self._fractions = np.array(modulus.fractions)
        self._relaxation_times = np.array(modulus.times)
        # Pressures that each exponential retains, (exponentials, points).
        self._branch_pressures = np.zeros((len(self._fractions), n))
        self._elastic_pressures: np.ndarray = np.zeros(n)
        self._longest_step = 0.0
        # Steps of one length share a contact problem, so that its matrix is factored once.
        self._contact_problem = lru_cache(1)(self._make_contact_problem)

    def responses(
        self, times: Sequence[float], values: Sequence[float], rows_per_segment: Sequence[int] = ()
    ) -> Iterator[Response]:
        """Yield the responses along a history of straight segments.

        Parameters
        ----------
        times
            Times of the ends of the segments; two equal times are a jump.
        values
            Values of z [L], or of the force [F], at these times.
        rows_per_segment
            Approximate number of responses for each segment; by default one, at the end.

        Yields
        ------
        Response
            Responses in order; the first one is at the first time.
        """
        # About 2000 steps in all, beside at least one in each segment.
        self._longest_step = (times[-1] - times[0]) / 2000
        yield self._step(times[0], 0.0, values[0])
        pieces = pairwise(zip(times, values, strict=True))
        for ((t0, v0), (t1, v1)), row_count in zip(
            pieces, rows_per_segment or [1] * (len(times) - 1), strict=True
        ):
            if t1 == t0:
                yield self._step(t1, 0.0, v1)
                continue
            last_reported = t0
            report_interval = (t1 - t0) / row_count
            for step_end, dt in self._steps_of_segment(t0, t1):
                response = self._step(step_end, dt, v0 + (v1 - v0) * (step_end - t0) / (t1 - t0))
                if step_end == t1 or step_end - last_reported >= report_interval:
                    yield response
                    last_reported = step_end

    def _steps_of_segment(self, start: float, end: float) -> list[tuple[float, float]]:
        """Return the steps of a segment as pairs (end, length), with few different lengths.

        There are at least 150 steps. The first ones are short, 20 per shortest relaxation time,
        because relaxation may be fast at the beginning of a segment; then the length is doubled up
        to the longest step.
        """
        span = end - start
        longest_step = min(max(span / 150, self._longest_step), span)
        dt = min(longest_step, min(self._relaxation_times, default=span) / 20.0)
        dt = longest_step / 2.0 ** np.ceil(np.log2(longest_step / dt))
        steps = []
        t = start
        # Steps of one length at the beginning of a segment before their length doubles.
        kink_steps = 40
        while dt < longest_step and t + kink_steps * dt < end:
            steps += [(t + dt * k, dt) for k in range(1, kink_steps + 1)]
            t = steps[-1][0]
            dt = 2.0 * dt
        count = max(1, round((end - t) / longest_step))
        dt = (end - t) / count
        return [*steps, *((t + dt * k, dt) for k in range(1, count)), (end, dt)]

    def _step(self, t: float, dt: float, value: float) -> Response:
        """Advance by dt to the time t; `value` is the prescribed z, or force, at t."""
        x = np.array([dt]) / self._relaxation_times if len(self._relaxation_times) else np.zeros(0)
        decay = np.exp(-x)
        gain = np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0)
        weighted_gains = self._fractions * gain
        alpha = self.modulus.long_term + float(weighted_gains.sum())
        history_pressures = (
            decay @ self._branch_pressures - float(weighted_gains.sum()) * self._elastic_pressures
        )
        contact = self._contact_problem(alpha)
        open_gaps = self.surface.heights - self.surface.compliance @ history_pressures / alpha
        if self.is_force_controlled:
            delta, p = self._depth_under_force(contact, open_gaps, value)
        else:
            p = contact.solve_pressures(open_gaps - value * self.surface.areas)
            delta = value - self.compliance * float(self.surface.areas @ p)
        phi = (p - history_pressures) / alpha
        self._branch_pressures = decay[:, None] * self._branch_pressures + weighted_gains[
            :, None
        ] * (phi - self._elastic_pressures)
        self._elastic_pressures = phi
        return Response(t, delta, float(self.surface.areas @ p), contact.contact_radius, np.nan)

    def _make_contact_problem(self, alpha: float) -> SurfaceContactLCP:
        """Return the elastic contact problem of one time step.

        Its compliance is A/alpha; see the module for both symbols.
        """
        areas = self.surface.areas
        c = 0.0 if self.is_force_controlled else self.compliance
        return SurfaceContactLCP(
            self.surface, self.surface.compliance / alpha + c * np.outer(areas, areas)
        )

    def _depth_under_force(
        self, contact: SurfaceContactLCP, open_gaps: np.ndarray, force: float
    ) -> tuple[float, np.ndarray]:
        """Return the depth and the pressures of a given force; Newton's method inverts F(delta).

        Newton's method converges because F(delta) is convex. For zero force the depth of first
        contact is returned.
        """
        areas = self.surface.areas
        delta = float((open_gaps / areas).min()) if self._elastic_pressures.any() else 0.0
        if force <= 0.0:
            contact.contact_radius = 0.0
            return delta, np.zeros(len(open_gaps))
        lower_depth = max(delta, float((open_gaps / areas).min()))
        delta = lower_depth + max(
            force * contact.compliance[0, 0] / areas[0] ** 2, 1e-12 * abs(lower_depth)
        )
        for _ in range(MAX_SEARCH_STEPS):
            try:
                p = contact.solve_pressures(open_gaps - delta * areas)
            except CandidateSetTooSmall:
                # At this iterate the depth is far too large.
                delta = 0.5 * (lower_depth + delta)
                continue
            force_deficit = force - float(areas @ p)
            if abs(force_deficit) <= 1e-12 * force:
                return delta, p
            lower_depth = delta if force_deficit > 0.0 else lower_depth
            delta += force_deficit / contact.stiffness
        raise SearchNotConverged(
            f"the depth of the force {force:g} was not found in {MAX_SEARCH_STEPS} Newton steps"
        )
