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
from indent_sim.theory.surface.relaxation import Prony, Response

PLACES_PER_RADIUS = 200  # of a contact radius, on a body that theory knows
BEYOND = 1.25  # of the widest contact that is expected: places beyond are there
# Steps of the first length after a kink, and steps that a piece of the history has at least
KINK_STEPS = 40
STEPS_PER_PIECE = 150
MOST_HISTORY_STEPS = 2000  # steps of a history, about, but for one in each of its pieces
RESOLVED = 20.0  # first steps in the shortest relaxation time
TOUCHES = 60  # corrections of a contact that is no disc
CONTACT_SLACK = 1e-12  # of the largest pressure, or gap, by which a contact may pull, or overlap
# of a prescribed force, relative, and the steps that find it
FORCE_FOUND = 1e-12
MOST_SEARCH_STEPS = 60


class Outgrown(ValueError):
    """The contact covers all of the surface that is known."""

    def __init__(self) -> None:
        super().__init__(
            "the contact outgrows the surface that is known: the tip comes deeper than its "
            "history says"
        )


class Unsettled(ArithmeticError):
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

    A: np.ndarray
    heights: np.ndarray
    areas: np.ndarray
    places: np.ndarray = field(default_factory=lambda: np.zeros(0))
    shift: float = 0.0
    is_plane: bool = False
    only_discs: bool = False
    end: float | None = None

    @property
    def is_ordered(self) -> bool:
        """Whether a contact is the first places."""
        return len(self.places) > 0

    def radius(self, p: np.ndarray) -> float:
        """Contact radius [L] of pressures (n,) on places that have no order; half the width in
        plane strain.
        """
        area = float(self.areas[p > 0.0].sum())
        return 0.5 * area if self.is_plane else float(np.sqrt(area / np.pi))

    def edge(self, y: np.ndarray) -> float:
        """Radius [L] of a disc from the edge pressures y (n,) of punches that end at each place: it
        is where they change their sign.
        """
        n = int(np.argmax(y <= 0.0))
        if n == 0:
            return 0.0 if y[0] <= 0.0 else self.end or float(self.places[-1])
        distance = self.places[n] - self.places[n - 1]
        return float(self.places[n - 1] + distance * (y[n - 1] / (y[n - 1] - y[n]) + self.shift))


def layer_surface(contact: Layer, a: float) -> RelaxingSurface:
    """The surface of a layer theory for contacts up to the radius a [L], in the variable of its
    integral equation.

    phi(x) >= 0 and delta - g(x) take the places of pressure and gap: (pi/E*)(phi - (2/pi) int K
    phi) = delta - g, and F = 2 pi int phi. A contact that is a disc ends at the same radius in
    both, whatever has happened outside.
    """
    h = contact.h
    n = round(PLACES_PER_RADIUS * BEYOND)
    edge = contact.tip.edge
    end = edge or min(BEYOND * a, contact.largest() * h * (1 - 1e-6))
    edges = np.linspace(0.0, end, n + 1)
    x = 0.5 * (edges[1:] + edges[:-1]) / h
    width = end / n
    kernel = axisymmetric_kernel(end / h, contact.scaled, contact.wall)
    B = kernel.basis(x)
    K = B.T @ (kernel.weight[:, None] * B) / h  # [1/L]
    areas = np.full(n, 2.0 * np.pi * width)
    A = areas[:, None] * np.pi / contact.E_star * (np.eye(n) - 2.0 / np.pi * K * width)
    return RelaxingSurface(
        0.5 * (A + A.T), areas * contact.tip.g(x * h), areas, x * h, only_discs=True, end=edge
    )


class SurfaceContact:
    """One compliance M of a surface and its contacts: p >= 0, o + M p >= 0, p (o + M p) = 0.

    Of the last contact found: its `radius` [L], and the force per depth `stiffness` [F/L] of what
    touches.
    """

    def __init__(self, surface: RelaxingSurface, M: np.ndarray):
        self.surface = surface
        self.M = M
        if surface.is_ordered:
            self.L = cholesky(M, lower=True)
            self.one = solve_triangular(self.L, surface.areas, lower=True)
        self._touching: np.ndarray = np.zeros(len(M), dtype=bool)
        self.radius = 0.0
        self.stiffness = 0.0

    def pressures(self, o: np.ndarray) -> np.ndarray:
        """The pressures of open gaps o (n,).

        Outgrown where all places touch, Unsettled where no contact was found.
        """
        p = self._disc(o) if self.surface.is_ordered else None
        if p is None and self.surface.only_discs:
            raise Unsettled(
                "the contact is no disc, and theory knows no other (solver.method: condensed does)"
            )
        return self._any(o) if p is None else p

    def _disc(self, o: np.ndarray) -> np.ndarray | None:
        """Those of a contact on the first places: the last of n pressures has the sign of y_n, L y
        = -o.
        """
        y = solve_triangular(self.L, -o, lower=True)
        outside = np.flatnonzero(y <= 0.0)
        if not len(outside) and not self.surface.end:
            raise Outgrown
        n = int(outside[0]) if len(outside) else len(o)
        p = np.zeros(len(o))
        p[:n] = solve_triangular(self.L[:n, :n], y[:n], lower=True, trans="T") if n else 0.0
        gap = o[n:] + self.M[n:, :n] @ p[:n]
        self.radius = self.surface.edge(y)
        self.stiffness = float(self.one[:n] @ self.one[:n])
        return p if np.all(p >= 0.0) and np.all(gap >= -CONTACT_SLACK * np.abs(o).max()) else None

    def _any(self, o: np.ndarray) -> np.ndarray:
        """Those of any contact, by primal-dual active sets; from the last one."""
        touching = self._touching if self._touching.any() else o < 0.0
        for _ in range(TOUCHES):
            p, gap = self._held(o, touching)
            if (
                p.min() >= -CONTACT_SLACK * p.max()
                and gap.min() >= -CONTACT_SLACK * np.abs(o).max()
            ):
                break
            touching = np.where(touching, p, -gap) > 0.0
        else:
            raise Unsettled(f"the contact of a step did not settle in {TOUCHES} corrections")
        if touching.all():
            raise Outgrown
        self._touching = touching
        p = np.maximum(p, 0.0)
        on = np.flatnonzero(touching)
        self.radius = self.surface.radius(p)
        self.stiffness = float(self.surface.areas[on] @ self._solved(on, self.surface.areas))
        return p

    def _held(self, o: np.ndarray, touching: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The pressures that close some gaps, whatever their sign, and all gaps."""
        on = np.flatnonzero(touching)
        p = np.zeros(len(o))
        p[on] = self._solved(on, -o)
        gap = o + self.M @ p
        gap[on] = 0.0
        return p, gap

    def _solved(self, on: np.ndarray, right: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self.M[np.ix_(on, on)], right[on])


class StepByStep:
    """The response of a relaxing body to a history of its base's way z [L] (`compliance` [L/F] of
    the spring between it and the tip; 0: of the depth) or of the force [F] (`of_force`).
    """

    def __init__(
        self,
        surface: RelaxingSurface,
        modulus: Prony,
        compliance: float = 0.0,
        of_force: bool = False,
    ):
        self.surface = surface
        self.modulus = modulus
        self.compliance = compliance
        self.of_force = of_force
        n = len(surface.areas)
        self._g = np.array(modulus.fractions)
        self._tau = np.array(modulus.times)
        self._h = np.zeros((len(self._g), n))  # stress left in each exponential
        self._phi: np.ndarray = np.zeros(n)
        self._longest = 0.0
        self._contacts: dict[float, SurfaceContact] = {}

    def responses(
        self, times: Sequence[float], values: Sequence[float], rows: Sequence[int] = ()
    ) -> Iterator[Response]:
        """One Response at every time, straight lines between them, or about so many `rows` in each;
        two equal times are a jump.
        """
        self._longest = (times[-1] - times[0]) / MOST_HISTORY_STEPS
        yield self._step(times[0], 0.0, values[0])
        pieces = pairwise(zip(times, values, strict=True))
        for ((t0, v0), (t1, v1)), parts in zip(pieces, rows or [1] * (len(times) - 1), strict=True):
            if t1 == t0:
                yield self._step(t1, 0.0, v1)
                continue
            said = t0
            every = (t1 - t0) / parts
            for begin, end in self._ladder(t0, t1):
                response = self._step(end, end - begin, v0 + (v1 - v0) * (end - t0) / (t1 - t0))
                if end == t1 or end - said >= every:
                    yield response
                    said = end

    def _ladder(self, begin: float, end: float) -> list[tuple[float, float]]:
        """The steps of a piece: short ones first, where relaxation may be quick, doubling to its
        longest.
        """
        span = end - begin
        longest = min(max(span / STEPS_PER_PIECE, self._longest), span)
        dt = min(longest, min(self._tau, default=span) / RESOLVED)
        dt = longest / 2.0 ** np.ceil(np.log2(longest / dt))
        ends = [begin]
        t = begin
        while dt < longest and t + KINK_STEPS * dt < end:
            ends += [t + dt * k for k in range(1, KINK_STEPS + 1)]
            t = ends[-1]
            dt = 2.0 * dt
        rest = max(1, round((end - t) / longest))
        ends += [*(t + (end - t) * k / rest for k in range(1, rest)), end]
        return list(pairwise(ends))

    def _step(self, t: float, dt: float, value: float) -> Response:
        """Go on to a time, where z, or the force, has this value."""
        x = np.array([dt]) / self._tau if len(self._tau) else np.zeros(0)
        fading = np.exp(-x)
        share = np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0)
        moved = self._g * share
        alpha = self.modulus.lasting + float(moved.sum())
        H = fading @ self._h - float(moved.sum()) * self._phi
        contact = self._contact(alpha)
        o = self.surface.heights - self.surface.A @ H / alpha
        if self.of_force:
            delta, p = self._pressed(contact, o, value)
        else:
            p = contact.pressures(o - value * self.surface.areas)
            delta = value - self.compliance * float(self.surface.areas @ p)
        phi = (p - H) / alpha
        self._h = fading[:, None] * self._h + moved[:, None] * (phi - self._phi)
        self._phi = phi
        return Response(t, delta, float(self.surface.areas @ p), contact.radius, np.nan)

    def _contact(self, alpha: float) -> SurfaceContact:
        """The contact of a step; steps of one length have one, which is factored once."""
        key = round(alpha, 14)
        if key not in self._contacts:
            areas = self.surface.areas
            c = 0.0 if self.of_force else self.compliance
            self._contacts = {
                key: SurfaceContact(
                    self.surface, self.surface.A / alpha + c * np.outer(areas, areas)
                )
            }
        return self._contacts[key]

    def _pressed(
        self, contact: SurfaceContact, o: np.ndarray, force: float
    ) -> tuple[float, np.ndarray]:
        """Depth and pressures under a force: Newton on F(delta), which is convex; at first touch
        for none.
        """
        areas = self.surface.areas
        delta = float((o / areas).min()) if self._phi.any() else 0.0
        if force <= 0.0:
            contact.radius = 0.0
            return delta, np.zeros(len(o))
        low = max(delta, float((o / areas).min()))
        delta = low + max(force * contact.M[0, 0] / areas[0] ** 2, 1e-12 * abs(low))
        for _ in range(MOST_SEARCH_STEPS):
            try:
                p = contact.pressures(o - delta * areas)
            except Outgrown:  # far too deep
                delta = 0.5 * (low + delta)
                continue
            missing = force - float(areas @ p)
            if abs(missing) <= FORCE_FOUND * force:
                return delta, p
            low = delta if missing > 0.0 else low
            delta += missing / contact.stiffness
        raise Unsettled(
            f"the depth of a force of {force:g} was not found in {MOST_SEARCH_STEPS} steps"
        )
