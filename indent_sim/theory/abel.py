"""Quadrature on the contact radius, and the Abel integral that turns g into a pressure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from indent_sim.theory.hankel import gauss
from indent_sim.theory.profiles import Shape

MAX_PANELS = 40
Nodes = tuple[np.ndarray, np.ndarray]


def contact_nodes(a: float, breaks: Sequence[float], count: int) -> Nodes:
    """Gauss nodes and weights on [0, a], `count` per panel (fewer if there are many), panelled at the breaks.

    Behind a break g rises like sqrt(x - break): there x = break + length v^2 makes it analytic again.
    """
    edges = [0.0, *(b for b in breaks if 0.0 < b < a), a]
    count = count if len(edges) < 5 else min(count, 12)
    panels = [gauss(0.0, edges[1], count)]
    panels += [_graded(lo, hi, count) for lo, hi in pairwise(edges[1:])]
    return _join(panels)


def tip_pressure(g: Shape, r: np.ndarray, a: float, breaks: Sequence[float], sharp: bool) -> np.ndarray:
    """∫_r^a g'(t)/sqrt(t^2 - r^2) dt at radii 0 <= r < a, shape of r: pi/E* times the half-space pressure.

    By parts about g(r), so that g' is not needed and only differences ~ (t - r) are divided:
    (g(a) - g(r))/sqrt(a^2 - r^2) + ∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt, with t = r cosh y, which
    resolves any r. More than MAX_PANELS breaks are thinned: such a tip is nearly smooth.
    """
    breaks = [b for b in breaks if 0.0 < b < a]
    breaks = breaks[:: max(1, math.ceil(len(breaks) / MAX_PANELS))]
    g_edge, off_axis = float(g(np.array([a]))[0]), r >= 1e-9 * a
    value = np.full_like(r, math.inf if sharp else _on_axis(g, a, g_edge, breaks))
    seen = r[off_axis]
    g_r = g(seen)
    value[off_axis] = (g_edge - g_r) / np.sqrt((a - seen) * (a + seen)) + _by_parts(g, g_r, a, seen, breaks)
    return value


def _by_parts(g: Shape, g_r: np.ndarray, a: float, r: np.ndarray, breaks: Sequence[float]) -> np.ndarray:
    """∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt; a tip without breaks has the same nodes below all radii."""
    if not breaks:
        s, w = gauss(0.0, 1.0, 64)
        end = np.arccosh(a / r)[:, None]
        return np.asarray((_integrand(g, g_r[:, None], r[:, None], end * s) @ w) * end[:, 0])
    nodes = [_abel_nodes(a, radius, breaks) for radius in r]
    return np.array([w @ _integrand(g, g_r[i], r[i], y) for i, (y, w) in enumerate(nodes)])


def _integrand(g: Shape, g_r: np.ndarray, r: np.ndarray, y: np.ndarray) -> np.ndarray:
    t = r * np.cosh(y)
    return (g(t.ravel()).reshape(t.shape) - g_r) * np.cosh(y) / np.sinh(y) ** 2 / r


def _on_axis(g: Shape, a: float, g_edge: float, breaks: Sequence[float]) -> float:
    """∫_0^a g'(t)/t dt = g(a)/a + ∫_0^a g(t)/t^2 dt of a tip that is smooth at its apex."""
    t, w = contact_nodes(a, breaks, 64)
    return g_edge / a + float(w @ (g(t) / t**2))


def _abel_nodes(a: float, r: float, breaks: Sequence[float]) -> Nodes:
    """Nodes y = arcosh(t/r) on [0, arcosh(a/r)] of a tip with breaks.

    Geometric panels, because the integrand nearly has a pole (1/sinh^2 y, seen from a break just above r)
    or a branch point (the root of a break just below r) next to the start of a panel.
    """
    end = math.acosh(a / r)
    below = max((b for b in breaks if b < r), default=0.0)
    size = math.sqrt(2.0 * (r - below) / r)
    starts = [0.0, *(math.acosh(b / r) for b in breaks if b > r), end]
    panels = []
    for start, stop in pairwise(starts):
        cuts = [start, *_geometric(max(start, 1e-8) if start else max(size, 1e-8), start, stop), stop]
        first = _graded(cuts[0], cuts[1], 24) if start else gauss(cuts[0], cuts[1], 24)
        panels += [first, *(gauss(lo, hi, 24) for lo, hi in pairwise(cuts[1:]))]
    return _join(panels)


def _geometric(size: float, start: float, stop: float) -> list[float]:
    """start + size (1, 3, 9, ...) as far as it stays clearly below stop."""
    count = math.floor(math.log((stop - start) / (1.5 * size), 3.0)) + 1 if stop - start > 1.5 * size else 0
    return [start + size * 3.0**k for k in range(count)]


def _graded(lo: float, hi: float, count: int) -> Nodes:
    v, w = gauss(0.0, 1.0, count)
    return lo + (hi - lo) * v**2, 2.0 * (hi - lo) * v * w


def _join(panels: Sequence[Nodes]) -> Nodes:
    return np.concatenate([x for x, _ in panels]), np.concatenate([w for _, w in panels])
