"""Contact pressure of axisymmetric contacts by Abel integrals of phi = delta - g + psi.

    p(r) = (E*/pi) [phi(a)/sqrt(a^2 - r^2) - ∫_r^a phi'(t)/sqrt(t^2 - r^2) dt] > 0 in compression.

The tip's Abel transform g may have slope discontinuities; psi, the effect of the layer, is even and
analytic. Lengths are in units of the top layer's thickness h. Source: Sneddon (1965), Int. J. Eng.
Sci. 3, 47, for the Abel integral; the quadrature is our own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebpts1, chebvander

from indent_sim.theory.hankel import EvenKernel, Kernel
from indent_sim.theory.profiles import Shape
from indent_sim.theory.quadrature import Nodes, gauss_legendre, join_nodes

TIP_INTEGRAL_POINTS = 64  # Gauss points of an integral over a tip with a continuous slope.


@dataclass(frozen=True)
class LayerPressure:
    """Effect of the layer on the pressure: -∫_r^a psi'(t)/sqrt(t^2-r^2) dt, psi = sum_j m_j b_j.

    psi is even and analytic, so that the substitution t^2 = r^2 + chord^2 s^2 with chord^2 = a^2 -
    r^2 makes the integrand regular.
    """

    kernel: Kernel | EvenKernel
    a: float
    modes: np.ndarray

    def __call__(self, r: np.ndarray, chord: np.ndarray) -> np.ndarray:
        """Return the effect of the layer (n,) [E*/pi] at radii r, with chord = sqrt(a^2 - r^2)."""
        s, w = gauss_legendre(0.0, 1.0, abel_point_count(self.a))
        t = np.hypot(r[:, None], chord[:, None] * s)
        if len(r) == 1:
            # For a single radius the integral is cheaper than a polynomial.
            return -chord * (self.modes @ self.kernel.slope_over_x(t[0]) @ w)
        return -chord * (self._slope_over_t(t) @ w)

    @cached_property
    def _slope_over_t(self) -> Chebyshev:
        """Chebyshev polynomial of psi'(t)/t on [0, a]."""
        slope_over_x = self.kernel.slope_over_x
        return Chebyshev.interpolate(
            lambda t: self.modes @ slope_over_x(t), polynomial_degree(self.a), domain=[0.0, self.a]
        )


def polynomial_degree(a: float) -> int:
    """Return the degree of a polynomial that approximates psi over a contact of radius a [h]."""
    return 24 + math.ceil(8.0 * a)


def abel_point_count(a: float) -> int:
    """Return the number of Gauss points of an Abel integral of psi for the radius a [h]."""
    return 24 + math.ceil(4.0 * a)


def contact_nodes(a: float, breaks: Sequence[float], count: int) -> Nodes:
    """Return Gauss nodes and weights on [0, a] in panels between the slope discontinuities.

    Each panel has `count` nodes, fewer if there are many panels. Beyond a discontinuity at b, the
    Abel transform g of the tip's profile has a term in sqrt(x - b); the substitution x = b + length
    v^2 makes it analytic.
    """
    edges = [0.0, *(b for b in breaks if 0.0 < b < a), a]
    count = count if len(edges) < 5 else min(count, 12)
    return join_nodes(
        [
            gauss_legendre(0.0, edges[1], count),
            *(_graded_nodes(lo, hi, count) for lo, hi in pairwise(edges[1:])),
        ]
    )


def tip_pressure(
    g: Shape, r: np.ndarray, a: float, breaks: Sequence[float], apex_slope: float
) -> np.ndarray:
    """Return ∫_r^a g'(t)/sqrt(t^2 - r^2) dt at radii 0 <= r < a, in the shape of r.

    This is pi/E* times the pressure on a half-space; it is infinite at a sharp apex.

    Integration by parts about g(r) avoids g' and divides only differences ~ (t - r): (g(a) -
    g(r))/sqrt(a^2 - r^2) + ∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt, with t = r cosh y, which
    resolves any r. If there are more than 40 slope discontinuities, some are ignored, because such
    a tip is nearly smooth.

    Parameters
    ----------
    g
        Abel transform of the tip's profile.
    r
        Radii.
    a
        Contact radius.
    breaks
        Radii at which the tip's slope is discontinuous.
    apex_slope
        Slope of the tip at its apex.
    """
    breaks = [b for b in breaks if 0.0 < b < a]
    # Panels of an Abel integral between slope discontinuities of the tip.
    max_panels = 40
    breaks = breaks[:: max(1, math.ceil(len(breaks) / max_panels))]
    g_edge = float(g(np.array([a]))[0])
    is_off_axis = r >= 1e-9 * a
    t, w = contact_nodes(a, breaks, TIP_INTEGRAL_POINTS)
    # The integral ∫_0^a g'(t)/t dt of a tip that is smooth at its apex.
    on_axis = g_edge / a + float(w @ (g(t) / t**2))
    value = np.full_like(r, math.inf if apex_slope > 0.0 else on_axis)
    off_axis_radii = r[is_off_axis]
    heights = g(off_axis_radii)
    value[is_off_axis] = (g_edge - heights) / np.sqrt(
        (a - off_axis_radii) * (a + off_axis_radii)
    ) + _integral_by_parts(g, heights, a, off_axis_radii, breaks)
    return value


def _integral_by_parts(
    g: Shape, g_r: np.ndarray, a: float, r: np.ndarray, breaks: Sequence[float]
) -> np.ndarray:
    """Return ∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt at radii r.

    For a tip with a continuous slope the same relative nodes are used for all radii.
    """
    if not breaks:
        s, w = gauss_legendre(0.0, 1.0, TIP_INTEGRAL_POINTS)
        end = np.arccosh(a / r)[:, None]
        return np.asarray((_abel_integrand(g, g_r[:, None], r[:, None], end * s) @ w) * end[:, 0])
    # Radii evaluated at once: each has several hundred quadrature nodes.
    radii_per_chunk = 50
    chunks = [slice(k, k + radii_per_chunk) for k in range(0, r.size, radii_per_chunk)]
    return np.concatenate(
        [_integral_with_breaks(g, g_r[chunk], a, r[chunk], breaks) for chunk in chunks] or [r]
    )


def _integral_with_breaks(
    g: Shape, g_r: np.ndarray, a: float, r: np.ndarray, breaks: Sequence[float]
) -> np.ndarray:
    """Return the integral of `_integral_by_parts` with separate nodes for each radius."""
    nodes = [_abel_nodes(a, radius, breaks) for radius in r]
    y, w = join_nodes(nodes)
    counts = [radius_nodes.size for radius_nodes, _ in nodes]
    values = w * _abel_integrand(g, np.repeat(g_r, counts), np.repeat(r, counts), y)
    return np.asarray(np.add.reduceat(values, np.cumsum([0, *counts[:-1]])))


@lru_cache(maxsize=8)
def tip_pressure_rule(point_count: int) -> tuple[np.ndarray, ...]:
    """Return r/a, and nodes and weights of a ∫_r^a (g(t) - g(r)) t/(t^2 - r^2)^{3/2} dt.

    The fractions r/a (n,) are evenly spaced from 0 to below 1; nodes t/a and weights are (n,
    points).
    """
    radius_fractions = np.linspace(0.0, 1.0, point_count, endpoint=False)
    s, w = gauss_legendre(0.0, 1.0, TIP_INTEGRAL_POINTS)
    r = radius_fractions[1:, None]
    end = np.arccosh(1.0 / r)
    cosh = np.cosh(end * s)
    sinh = np.sinh(end * s)
    return (
        radius_fractions,
        np.vstack([s, r * cosh]),
        np.vstack([w / s**2, w * end * cosh / sinh**2 / r]),
    )


@lru_cache(maxsize=8)
def layer_pressure_rule(point_count: int, degree: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of -1/a ∫_r^a psi'(t)/sqrt(t^2 - r^2) dt.

    The radii are evenly spaced from 0 to below a. The weights (radii, nodes) apply to psi'(t)/t at
    the nodes t/a, through a polynomial of the given degree that is integrated with `count` Gauss
    points (`LayerPressure`).
    """
    radius_fractions = np.linspace(0.0, 1.0, point_count, endpoint=False)[:, None]
    nodes = chebpts1(degree + 1)
    s, w = gauss_legendre(0.0, 1.0, count)
    chord = np.sqrt(1.0 - radius_fractions * radius_fractions)
    polynomials = chebvander(2.0 * np.hypot(radius_fractions, chord * s) - 1.0, degree)
    weights = -chord * np.einsum("ijn,j->in", polynomials, w)
    return 0.5 * (1.0 + nodes), weights @ np.linalg.inv(chebvander(nodes, degree))


def _abel_integrand(g: Shape, g_r: np.ndarray, r: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the integrand of `_integral_by_parts` in the variable y = arcosh(t/r)."""
    cosh = np.cosh(y)
    t = r * cosh
    return (g(t.ravel()).reshape(t.shape) - g_r) * cosh / np.sinh(y) ** 2 / r


def _abel_nodes(a: float, r: float, breaks: Sequence[float]) -> Nodes:
    """Return nodes y = arcosh(t/r) and weights on [0, arcosh(a/r)].

    The panels grow geometrically, because a pole or branch point may be near the start of a panel.
    """
    end = math.acosh(a / r)
    break_below = max((b for b in breaks if b < r), default=0.0)
    first_panel = math.sqrt(2.0 * (r - break_below) / r)
    starts = [0.0, *(math.acosh(b / r) for b in breaks if b > r), end]
    panels = []
    for start, stop in pairwise(starts):
        cuts = [
            start,
            *_geometric_edges(max(start, 1e-8) if start else max(first_panel, 1e-8), start, stop),
            stop,
        ]
        first = (
            _graded_nodes(cuts[0], cuts[1], 24) if start else gauss_legendre(cuts[0], cuts[1], 24)
        )
        panels += [first, *(gauss_legendre(lo, hi, 24) for lo, hi in pairwise(cuts[1:]))]
    return join_nodes(panels)


def _geometric_edges(size: float, start: float, stop: float) -> list[float]:
    """Return the panel edges start + size (1, 3, 9, ...) that are clearly below stop."""
    count = (
        math.floor(math.log((stop - start) / (1.5 * size), 3.0)) + 1
        if stop - start > 1.5 * size
        else 0
    )
    return [start + size * 3.0**k for k in range(count)]


def _graded_nodes(lo: float, hi: float, count: int) -> Nodes:
    """Return nodes and weights on [lo, hi], graded towards lo.

    The nodes result from a Gauss rule in v on [0, 1] by the substitution x = lo + (hi - lo) v^2.
    """
    v, w = gauss_legendre(0.0, 1.0, count)
    return lo + (hi - lo) * v**2, 2.0 * (hi - lo) * v * w
