"""Contact of a relaxing body step by step, for any history of depths, forces or a spring's base,
with reloading.

The surface of a linear body carries pressures p >= 0 at n places. Weighted with areas, the gaps are

    heights - delta areas + A phi >= 0,   F = areas . p,   p = int G(t - s) dphi(s),

phi being the pressures of the elastic body with the same surface. With G a sum of exponentials and
phi linear over a step, p = alpha phi + H with what the history leaves, so that every step is one
elastic contact of the compliance A/alpha, error of the order of the step squared. A spring between
the tip and what moves it, z = delta + c F, adds c areas areas^T.

delta > 0 pushes in, force > 0 pushes. Lengths [L], forces [F], any unit of time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from indent_sim.theory.hankel import axisymmetric_kernel
from indent_sim.theory.layer import Layer
from indent_sim.theory.viscoelasticity import Response, ShearRelaxation

POINTS_PER_RADIUS = 200  # of a contact radius, on a body that theory knows
SURFACE_MARGIN = 1.25  # of the widest contact that is expected: places beyond are there
# Steps of the first length after a kink, and steps that a piece of the history has at least
KINK_STEPS = 40
LEAST_STEPS_PER_SEGMENT = 150
MAX_HISTORY_STEPS = 2000  # steps of a history, about, but for one in each of its pieces
STEPS_PER_RELAXATION_TIME = 20.0  # first steps in the shortest relaxation time
MAX_ACTIVE_SET_ITERATIONS = 60  # corrections of a contact that is no disc
CONTACT_TOLERANCE = (
    1e-12  # of the largest pressure, or gap, by which a contact may pull, or overlap
)
# of a prescribed force, relative, and the steps that find it
FORCE_TOLERANCE = 1e-12
MAX_SEARCH_STEPS = 60


class CandidateSetTooSmall(ValueError):
    """The contact covers all of the surface that is known."""

    def __init__(self) -> None:
        super().__init__(
            "the contact outgrows the surface that is known: the tip comes deeper than its "
            "history says"
        )


class SearchNotConverged(ArithmeticError):
    """A search that did not come to its end: what it has is no contact."""


@dataclass(frozen=True)
class RelaxingSurface:
    """A: (n, n) compliance between weighted places, symmetric and positive definite; heights and
    areas (n,).

    `places` (n,): the radii [L] of places in their order on an axisymmetric body; its contact ends
    by `shift` of their distance beyond where their edge pressure vanishes. Empty otherwise, where
    the contact's area is the sum of areas, or its width in plane strain (`is_plane`). `only_discs`:
    what stands for pressure and gap does so for discs alone. `end`: radius [L] at which the tip
    ends, as all places do: then all of them may touch.
    """

    compliance: np.ndarray
    heights: np.ndarray
    areas: np.ndarray
    radii: np.ndarray = field(default_factory=lambda: np.zeros(0))
    edge_shift: float = 0.0
    is_plane_strain: bool = False
    has_only_discs: bool = False
    max_radius: float | None = None

    @property
    def is_ordered(self) -> bool:
        """Whether a contact is the first places."""
        return len(self.radii) > 0

    def contact_radius(self, p: np.ndarray) -> float:
        """Contact radius [L] of pressures (n,) on places that have no order; half the width in
        plane strain.
        """
        area = float(self.areas[p > 0.0].sum())
        return 0.5 * area if self.is_plane_strain else float(np.sqrt(area / np.pi))

    def disc_radius(self, y: np.ndarray) -> float:
        """Radius [L] of a disc from the edge pressures y (n,) of punches that end at each place: it
        is where they change their sign.
        """
        n = int(np.argmax(y <= 0.0))
        if n == 0:
            return 0.0 if y[0] <= 0.0 else self.max_radius or float(self.radii[-1])
        distance = self.radii[n] - self.radii[n - 1]
        return float(
            self.radii[n - 1] + distance * (y[n - 1] / (y[n - 1] - y[n]) + self.edge_shift)
        )


def layer_surface(contact: Layer, a: float) -> RelaxingSurface:
    """The surface of a layer theory for contacts up to the radius a [L], in the variable of its
    integral equation.

    phi(x) >= 0 and delta - g(x) take the places of pressure and gap: (pi/E*)(phi - (2/pi) int K
    phi) = delta - g, and F = 2 pi int phi. A contact that is a disc ends at the same radius in
    both, whatever has happened outside.
    """
    h = contact.h
    n = round(POINTS_PER_RADIUS * SURFACE_MARGIN)
    edge = contact.tip.punch_radius
    max_radius = edge or min(SURFACE_MARGIN * a, contact.max_size() * h * (1 - 1e-6))
    edges = np.linspace(0.0, max_radius, n + 1)
    x = 0.5 * (edges[1:] + edges[:-1]) / h
    width = max_radius / n
    kernel = axisymmetric_kernel(max_radius / h, contact.scaled_stack, contact.wall)
    B = kernel.basis(x)
    K = B.T @ (kernel.weight[:, None] * B) / h  # [1/L]
    areas = np.full(n, 2.0 * np.pi * width)
    A = areas[:, None] * np.pi / contact.E_star * (np.eye(n) - 2.0 / np.pi * K * width)
    return RelaxingSurface(
        0.5 * (A + A.T),
        areas * contact.tip.g(x * h),
        areas,
        x * h,
        has_only_discs=True,
        max_radius=edge,
    )


class SurfaceContactLCP:
    """One compliance M of a surface and its contacts: p >= 0, o + M p >= 0, p (o + M p) = 0.

    Of the last contact found: its `radius` [L], and the force per depth `stiffness` [F/L] of what
    touches.
    """

    def __init__(self, surface: RelaxingSurface, M: np.ndarray):
        self.surface = surface
        self.compliance = M
        if surface.is_ordered:
            self.cholesky_factor = cholesky(M, lower=True)
            self.unit_response = solve_triangular(self.cholesky_factor, surface.areas, lower=True)
        self._is_active: np.ndarray = np.zeros(len(M), dtype=bool)
        self.contact_radius = 0.0
        self.stiffness = 0.0

    def solve_pressures(self, open_gaps: np.ndarray) -> np.ndarray:
        """The pressures of open gaps o (n,).

        Outgrown where all places touch, Unsettled where no contact was found.
        """
        p = self._solve_disc(open_gaps) if self.surface.is_ordered else None
        if p is None and self.surface.has_only_discs:
            raise SearchNotConverged(
                "the contact is no disc, and theory knows no other (solver.method: condensed does)"
            )
        return self._solve_active_set(open_gaps) if p is None else p

    def _solve_disc(self, open_gaps: np.ndarray) -> np.ndarray | None:
        """Those of a contact on the first places: the last of n pressures has the sign of y_n, L y
        = -o.
        """
        edge_pressures = solve_triangular(self.cholesky_factor, -open_gaps, lower=True)
        outside_points = np.flatnonzero(edge_pressures <= 0.0)
        if not len(outside_points) and not self.surface.max_radius:
            raise CandidateSetTooSmall
        n = int(outside_points[0]) if len(outside_points) else len(open_gaps)
        p = np.zeros(len(open_gaps))
        p[:n] = (
            solve_triangular(
                self.cholesky_factor[:n, :n], edge_pressures[:n], lower=True, trans="T"
            )
            if n
            else 0.0
        )
        gap = open_gaps[n:] + self.compliance[n:, :n] @ p[:n]
        self.contact_radius = self.surface.disc_radius(edge_pressures)
        self.stiffness = float(self.unit_response[:n] @ self.unit_response[:n])
        return (
            p
            if np.all(p >= 0.0) and np.all(gap >= -CONTACT_TOLERANCE * np.abs(open_gaps).max())
            else None
        )

    def _solve_active_set(self, open_gaps: np.ndarray) -> np.ndarray:
        """Those of any contact, by primal-dual active sets; from the last one."""
        is_active = self._is_active if self._is_active.any() else open_gaps < 0.0
        for _ in range(MAX_ACTIVE_SET_ITERATIONS):
            p, gap = self._pressures_and_gaps(open_gaps, is_active)
            if (
                p.min() >= -CONTACT_TOLERANCE * p.max()
                and gap.min() >= -CONTACT_TOLERANCE * np.abs(open_gaps).max()
            ):
                break
            is_active = np.where(is_active, p, -gap) > 0.0
        else:
            raise SearchNotConverged(
                f"the contact of a step did not settle in {MAX_ACTIVE_SET_ITERATIONS} corrections"
            )
        if is_active.all():
            raise CandidateSetTooSmall
        self._is_active = is_active
        p = np.maximum(p, 0.0)
        active = np.flatnonzero(is_active)
        self.contact_radius = self.surface.contact_radius(p)
        self.stiffness = float(
            self.surface.areas[active] @ self._solve_active(active, self.surface.areas)
        )
        return p

    def _pressures_and_gaps(
        self, open_gaps: np.ndarray, is_active: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The pressures that close some gaps, whatever their sign, and all gaps."""
        active = np.flatnonzero(is_active)
        p = np.zeros(len(open_gaps))
        p[active] = self._solve_active(active, -open_gaps)
        gap = open_gaps + self.compliance @ p
        gap[active] = 0.0
        return p, gap

    def _solve_active(self, active: np.ndarray, right_side: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self.compliance[np.ix_(active, active)], right_side[active])


class ViscoelasticTimeStepper:
    """The response of a relaxing body to a history of its base's way z [L] (`compliance` [L/F] of
    the spring between it and the tip; 0: of the depth) or of the force [F] (`of_force`).
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
        self._branch_pressures = np.zeros(
            (len(self._fractions), n)
        )  # stress left in each exponential
        self._elastic_pressures: np.ndarray = np.zeros(n)
        self._longest_step = 0.0
        self._contact_of_alpha: dict[float, SurfaceContactLCP] = {}

    def responses(
        self, times: Sequence[float], values: Sequence[float], rows_per_segment: Sequence[int] = ()
    ) -> Iterator[Response]:
        """One Response at every time, straight lines between them, or about so many `rows_per_segment` in each;
        two equal times are a jump.
        """
        self._longest_step = (times[-1] - times[0]) / MAX_HISTORY_STEPS
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
            for step_start, step_end in self._step_intervals(t0, t1):
                response = self._step(
                    step_end, step_end - step_start, v0 + (v1 - v0) * (step_end - t0) / (t1 - t0)
                )
                if step_end == t1 or step_end - last_reported >= report_interval:
                    yield response
                    last_reported = step_end

    def _step_intervals(self, start: float, end: float) -> list[tuple[float, float]]:
        """The steps of a piece: short ones first, where relaxation may be quick, doubling to its
        longest.
        """
        span = end - start
        longest_step = min(max(span / LEAST_STEPS_PER_SEGMENT, self._longest_step), span)
        dt = min(
            longest_step, min(self._relaxation_times, default=span) / STEPS_PER_RELAXATION_TIME
        )
        dt = longest_step / 2.0 ** np.ceil(np.log2(longest_step / dt))
        ends = [start]
        t = start
        while dt < longest_step and t + KINK_STEPS * dt < end:
            ends += [t + dt * k for k in range(1, KINK_STEPS + 1)]
            t = ends[-1]
            dt = 2.0 * dt
        remaining_steps = max(1, round((end - t) / longest_step))
        ends += [*(t + (end - t) * k / remaining_steps for k in range(1, remaining_steps)), end]
        return list(pairwise(ends))

    def _step(self, t: float, dt: float, value: float) -> Response:
        """Go on to a time, where z, or the force, has this value."""
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

    def _contact_problem(self, alpha: float) -> SurfaceContactLCP:
        """The contact of a step; steps of one length have one, which is factored once."""
        key = round(alpha, 14)
        if key not in self._contact_of_alpha:
            areas = self.surface.areas
            c = 0.0 if self.is_force_controlled else self.compliance
            self._contact_of_alpha = {
                key: SurfaceContactLCP(
                    self.surface, self.surface.compliance / alpha + c * np.outer(areas, areas)
                )
            }
        return self._contact_of_alpha[key]

    def _depth_under_force(
        self, contact: SurfaceContactLCP, open_gaps: np.ndarray, force: float
    ) -> tuple[float, np.ndarray]:
        """Depth and pressures under a force: Newton on F(delta), which is convex; at first touch
        for none.
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
            except CandidateSetTooSmall:  # far too deep
                delta = 0.5 * (lower_depth + delta)
                continue
            force_deficit = force - float(areas @ p)
            if abs(force_deficit) <= FORCE_TOLERANCE * force:
                return delta, p
            lower_depth = delta if force_deficit > 0.0 else lower_depth
            delta += force_deficit / contact.stiffness
        raise SearchNotConverged(
            f"the depth of a force of {force:g} was not found in {MAX_SEARCH_STEPS} steps"
        )
