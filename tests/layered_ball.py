"""A layered ball between two equal tips, by Legendre series: a reference that has no mesh.

Of every degree n the displacement of a shell is U(r) P_n(cos t) along r and V(r) dP_n/dt along the
angle t from the axis, with U, V the sum of four powers of r (two in the core). Interfaces and
surface join them, which gives the surface compliance of the degree. The pressure is sqrt(1 - x)
times a polynomial of x = (1 - cos t)/(1 - cos c) up to the edge at the angle c; it and the depth
that goes with c follow from Galerkin's equations. Traction and gap are vertical, as `gap:
reference` says, and the plane through the center is a mirror.

Source: A. E. H. Love, A Treatise on the Mathematical Theory of Elasticity (1927), sections 172 to
177.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import brentq

Layer = tuple[float, tuple[float, float]]  # outer radius, (E, nu)
# highest degree times the contact angle; 1e-5 of the force, which converges as its third power
WAVES = 200.0
TERMS = 12  # of the pressure's polynomial


@dataclass(frozen=True)
class Contact:
    """One of the two contacts.

    The approach of both tips, the force, the contact radius, and the pressure over x from 0 to 1.
    """

    delta: float
    force: float
    a: float
    pressure: np.ndarray


def contact(
    delta: float,
    layers: Sequence[Layer],
    tip: Callable[[np.ndarray], np.ndarray],
    terms: int = TERMS,
) -> Contact:
    """The contact of a layered ball of radius 1 at the approach delta.

    `layers` are (outer radius, (E, nu)) from the surface inwards, the core last; `tip` is its
    height over the distance r from the axis.
    """
    wide = 2 * np.sqrt(delta)
    while of_angle(wide / 2, layers, tip, terms).delta > delta:
        wide /= 2
    angle = brentq(
        lambda c: of_angle(c, layers, tip, terms).delta / delta - 1, wide / 2, wide, rtol=1e-7
    )
    return of_angle(angle, layers, tip, terms)


def of_angle(
    c: float,
    layers: Sequence[Layer],
    tip: Callable[[np.ndarray], np.ndarray],
    terms: int = TERMS,
    waves: float = WAVES,
) -> Contact:
    """The contact that ends at the angle c."""
    fall = 1 - np.cos(c)
    v, weights = _gauss(int(waves) + 4 * terms)
    x = 1 - v**2  # sqrt(1 - x) = v has no singularity
    areas = 4 * np.pi * fall * v * weights  # 2 pi sin t dt
    shapes = (
        v * legendre.legvander(2 * x - 1, terms).T
    )  # one more than the pressure has: its equation gives the depth
    mu = 1 - fall * x
    even = 2 * np.arange(int(waves / c) // 2)
    radial, along = _coefficients(even, mu, shapes * areas / (2 * np.pi))
    influence = _influence(even, radial, along, compliances(even, layers))
    loads, heights = shapes @ areas, shapes @ (areas * (mu - 1 - tip(np.sqrt(1 - mu**2))))
    matrix = np.column_stack([influence[:, :terms], -loads / 2])
    *pressure, delta = np.linalg.solve(matrix, heights)
    over = legendre.legvander(2 * np.linspace(0, 1, 101) - 1, terms - 1) @ pressure
    return Contact(delta, float(loads[:terms] @ pressure), float(np.sin(c)), over)


def _gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights on 0..1."""
    at, weights = legendre.leggauss(n)
    return (at + 1) / 2, weights / 2


def _coefficients(
    even: np.ndarray, mu: np.ndarray, loads: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of P_n and dP_n/dt in the traction of vertical pressures.

    The pressures act downwards above and upwards below.
    """
    radial, along = np.zeros((len(even), len(loads))), np.zeros((len(even), len(loads)))
    before, here = np.zeros_like(mu), np.ones_like(mu)  # P_(n-1), P_n
    for k, n in enumerate(even):
        radial[k] = -(2 * n + 1) * (loads @ (mu * here))
        if n:
            along[k] = (2 * n + 1) / (n + 1) * (loads @ (mu * here - before))
        for m in (n, n + 1):
            before, here = here, ((2 * m + 1) * mu * here - m * before) / (m + 1)
    return radial, along


def _influence(
    even: np.ndarray, radial: np.ndarray, along: np.ndarray, flex: np.ndarray
) -> np.ndarray:
    """Work of each pressure on the displacement of another, over one of the two contacts."""
    norm = 2 * np.pi / (2 * even + 1)  # half of the sphere
    traction = np.stack([radial, along])
    moved = np.einsum("nab,bnj->anj", flex, traction)
    moved[1] *= (even * (even + 1.0))[:, None]
    return np.einsum("n,ani,anj->ij", norm, traction, moved)


def compliances(degrees: np.ndarray, layers: Sequence[Layer]) -> np.ndarray:
    """U and V at the surface of the tractions P_n along r and dP_n/dt along t: (degrees, 2, 2).

    Degree 0 comes first.
    """
    shells = [_solutions(degrees[1:], k, layers) for k in range(len(layers))]
    starts = 4 * np.arange(len(layers) + 1)
    starts[-1] -= 2  # the core has two solutions
    matrix, right = np.zeros((len(degrees) - 1, starts[-1], starts[-1])), np.zeros((starts[-1], 2))
    matrix[:, :2, : starts[1]] = shells[0][0][:, 2:]
    right[:2] = np.eye(2)
    for k, ((_, inner), (outer, _)) in enumerate(pairwise(shells)):
        row = slice(4 * k + 2, 4 * k + 6)
        matrix[:, row, starts[k] : starts[k + 1]] = inner
        matrix[:, row, starts[k + 1] : starts[k + 2]] = -outer
    found = shells[0][0][:, :2] @ np.linalg.solve(matrix, right[None])[:, : starts[1]]
    swelling = np.diag([_swelling(layers), 0.0])
    return np.concatenate([swelling[None], found])


def _swelling(layers: Sequence[Layer]) -> float:
    """Displacement of the surface under the tension 1.

    Lame's solution A r + B/r^2 is continued from the core outwards.
    """
    stiffness, inner = 0.0, 0.0  # tension over displacement at the inner face
    for outer, (E, nu) in reversed(layers):
        bulk, shear = E / (1 - 2 * nu), 2 * E / (1 + nu)  # 3 K, 4 mu
        A, B = 1.0, 0.0
        if inner:
            A, B = np.linalg.solve(
                [[inner, inner**-2], [bulk, -shear / inner**3]], [1.0, stiffness]
            )
        stiffness = (bulk * A - shear * B / outer**3) / (A * outer + B / outer**2)
        inner = outer
    return 1 / stiffness


def _solutions(n: np.ndarray, k: int, layers: Sequence[Layer]) -> tuple[np.ndarray, np.ndarray]:
    """U, V, s_rr, s_rt at the outer and the inner face of shell k: (degrees, 4, solutions).

    Each solution is about 1 at the face where it is largest, so that nothing overflows.
    """
    (outer, (E, nu)), N = layers[k], n * (n + 1.0)
    inner = layers[k + 1][0] if k + 1 < len(layers) else None
    shear, ratio = E / (2 * (1 + nu)), 2 * (1 - nu) / (1 - 2 * nu)  # mu, (lambda + 2 mu)/mu
    outside, inside = [], []
    for p in (n - 1, n + 1) if inner is None else (n - 1, n + 1, -n, -n - 2):
        if p[0] in (n[0] - 1, -n[0] - 2):  # neither volume nor rotation
            A, B = p + 1.0, np.ones(len(n))
        else:
            A, B = ratio * N - p * (p + 1), ratio * (p + 2) - p
        A, B = (A, B) / np.hypot(A, n * B)
        normal = (ratio - 2) * ((p + 2) * A - N * B) + 2 * p * A
        moved = np.stack([A, B, shear * normal, shear * (A + (p - 1) * B)], axis=1)
        for face, r in ((outside, outer), (inside, inner or outer)):
            fading = (r / (outer if p[0] > 0 else inner or outer)) ** (p * 1.0)
            face.append(moved * fading[:, None] / [1, 1, r, r])
    return np.stack(outside, axis=2), np.stack(inside, axis=2)
