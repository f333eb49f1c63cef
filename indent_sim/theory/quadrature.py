"""Quadrature rules of the layer theories: Gauss-Legendre panels, wavenumbers, modes between walls.

All lengths are in units of the top layer's thickness. Sources: Abramowitz & Stegun 9.5.12
(McMahon's expansion of the zeros of J1); Gautschi, Orthogonal Polynomials (2004), for the discrete
measure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

MAX_WAVENUMBER = 22.0  # The compliance M(22) is below 2e-16.
POINTS_PER_PANEL = 18  # Gauss points that resolve M between s and 3 s.
POINTS_PER_PHASE = 0.6  # Further Gauss points per unit of the phase x ds of cos(sx).
# Longest phase on one panel: a Gauss rule of n points costs an eigenvalue problem of size n.
LONGEST_PHASE = 100.0
SINGLE_MODES = 32  # Number of modes between walls that are summed one by one.
Nodes = tuple[np.ndarray, np.ndarray]  # Nodes and weights of a quadrature rule.


def bessel_j1_zeros(numbers: np.ndarray) -> np.ndarray:
    """Return the zeros of J1 with the given increasing numbers, counted from 1.

    Non-integer numbers, from SINGLE_MODES on, give the smooth continuation by McMahon's expansion.
    """
    from scipy.special import jn_zeros

    b = (numbers + 0.25) * math.pi
    v = 8.0 * b
    z = b - 3.0 / v + 12.0 / v**3 - 7545.6 / v**5 + 3567925.0 / v**7
    first = numbers[numbers <= SINGLE_MODES].astype(int)
    if first.size:
        z[: first.size] = jn_zeros(1, first[-1])[first - 1]
    return z


def wavenumber_nodes(max_radius: float, min_wavenumber: float) -> Nodes:
    """Return nodes s and weights of ∫_0^inf M(s) cos(sx) cos(st) ds for x, t <= max_radius.

    The panels are graded geometrically down to `min_wavenumber`.
    """
    panels = max(1, math.ceil(math.log(MAX_WAVENUMBER / min_wavenumber, 3.0)))
    edges = _split_panels(
        [0.0, *(MAX_WAVENUMBER * 3.0 ** np.arange(-panels, 1.0))], LONGEST_PHASE / max_radius
    )
    parts = [
        gauss_legendre(
            lo, hi, POINTS_PER_PANEL + math.ceil(POINTS_PER_PHASE * max_radius * (hi - lo))
        )
        for lo, hi in pairwise(edges)
    ]
    return join_nodes(parts)


def wall_mode_nodes(max_radius: float, wall: float) -> Nodes:
    """Return nodes n and weights of sum_n M(k_n) cos(k_n x) cos(k_n t) for x, t <= max_radius.

    k_n is about n pi/W. The first SINGLE_MODES modes are summed individually; further modes in
    blocks of doubling length by a Gauss rule for sums, which is exact for polynomials in n.
    """
    last = max(1, math.ceil(MAX_WAVENUMBER * wall / math.pi))
    doubling_edges = (n for i in range(64) if (n := (SINGLE_MODES + 1) * 2**i) <= last)
    edges = [*range(1, min(last, SINGLE_MODES) + 1), *doubling_edges, last + 1]
    blocks = pairwise(
        round(edge)
        for edge in _split_panels(edges, max(1.0, LONGEST_PHASE / max_radius * wall / math.pi))
    )
    per_number = POINTS_PER_PHASE * max_radius * math.pi / wall
    return join_nodes(
        [
            _gauss_sum(*ends, POINTS_PER_PANEL + math.ceil(per_number * (ends[1] - ends[0])))
            for ends in blocks
        ]
    )


def join_nodes(parts: Sequence[Nodes]) -> Nodes:
    """Concatenate the nodes and weights of several quadrature rules."""
    return np.concatenate([x for x, _ in parts]), np.concatenate([w for _, w in parts])


def _split_panels(edges: Sequence[float], longest: float) -> list[float]:
    """Split panels evenly so that none is longer than `longest`."""
    parts = [
        np.linspace(lo, hi, math.ceil((hi - lo) / longest), endpoint=False)
        for lo, hi in pairwise(edges)
    ]
    return [*np.concatenate(parts), edges[-1]]


def _gauss_sum(first: int, end: int, count: int) -> Nodes:
    """Return nodes and weights of sum_{n=first}^{end-1} f(n), exact up to degree 2 count - 1.

    Source: Gautschi (2004), section 1.5.2.
    """
    term_count = end - first
    if term_count <= count:
        return np.arange(float(first), end), np.ones(term_count)
    j = np.arange(1.0, count)
    off_diagonal = 0.5 * j * np.sqrt((term_count - j) * (term_count + j) / (4.0 * j * j - 1.0))
    nodes, vectors = np.linalg.eigh(np.diag(off_diagonal, 1) + np.diag(off_diagonal, -1))
    return nodes + 0.5 * (first + end - 1.0), term_count * vectors[0] ** 2


def gauss_legendre(lo: float, hi: float, count: int) -> Nodes:
    """Return Gauss-Legendre nodes and weights on [lo, hi], each of shape (count,)."""
    x, w = _legendre_rule(count)
    return 0.5 * (lo + hi) + 0.5 * (hi - lo) * x, 0.5 * (hi - lo) * w


@lru_cache(maxsize=256)
def _legendre_rule(count: int) -> Nodes:
    """Return numpy's leggauss, cached because computing it takes longer than a contact solution."""
    return np.polynomial.legendre.leggauss(count)
