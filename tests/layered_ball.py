"""A layered ball between two equal tips, by Legendre series: a reference that has no mesh.

Of every degree n the displacement of a shell is U(r) P_n(cos t) along r and V(r) dP_n/dt along the angle t from the
axis, with U, V the sum of four powers of r (two in the core). Interfaces and surface join them, which gives the surface
compliance of the degree. The pressure is sqrt(1 - x) times a polynomial of x = (1 - cos t)/(1 - cos c) up to the edge
at the angle c; it and the depth that goes with c follow from Galerkin's equations. Traction and gap are vertical, as
`gap: reference` says, and the plane through the center is a mirror.

Source: A. E. H. Love, A Treatise on the Mathematical Theory of Elasticity (1927), sections 172 to 177.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import brentq

Matter = tuple[float, float]  # E, nu
WAVES = 400.0  # highest degree times the contact angle; the force converges as its third power
MARGIN = 1.0  # quadrature points per unit of WAVES


@dataclass(frozen=True)
class Contact:
    """One of the two contacts: the approach of both tips, force, contact radius, pressure (over x from 0 to 1)."""

    delta: float
    force: float
    a: float
    pressure: np.ndarray


def contact(
    delta: float, layers: Sequence[tuple[float, Matter]], tip: Callable[[np.ndarray], np.ndarray], terms: int = 12
) -> Contact:
    """The contact of a ball of radius 1 at the approach delta. layers: (outer radius, (E, nu)) from the surface
    inwards, the core last; tip: its height over the distance r from the axis."""
    angle = brentq(
        lambda c: of_angle(c, layers, tip, terms).delta / delta - 1, np.sqrt(delta) / 20, 2 * np.sqrt(delta), rtol=1e-8
    )
    return of_angle(angle, layers, tip, terms)


def of_angle(
    c: float,
    layers: Sequence[tuple[float, Matter]],
    tip: Callable[[np.ndarray], np.ndarray],
    terms: int = 12,
    waves: float = WAVES,
) -> Contact:
    """The contact that ends at the angle c."""
    fall = 1 - np.cos(c)
    v, weights = _gauss(int(MARGIN * waves) + 4 * terms)
    x = 1 - v**2  # sqrt(1 - x) = v has no singularity
    areas = 4 * np.pi * fall * v * weights  # 2 pi sin t dt
    shapes = v * legendre.legvander(2 * x - 1, terms).T  # one more than the pressure has: its equation gives the depth
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
    """Points and weights on 0..1."""
    at, weights = legendre.leggauss(n)
    return (at + 1) / 2, weights / 2


def _coefficients(even: np.ndarray, mu: np.ndarray, loads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of vertical pressures, downwards above and upwards below, the coefficients of P_n and dP_n/dt in the traction."""
    radial, along = np.zeros((len(even), len(loads))), np.zeros((len(even), len(loads)))
    before, here = np.zeros_like(mu), np.ones_like(mu)  # P_(n-1), P_n
    for k, n in enumerate(even):
        radial[k] = -(2 * n + 1) * (loads @ (mu * here))
        if n:
            along[k] = (2 * n + 1) / (n + 1) * (loads @ (mu * here - before))
        for m in (n, n + 1):
            before, here = here, ((2 * m + 1) * mu * here - m * before) / (m + 1)
    return radial, along


def _influence(even: np.ndarray, radial: np.ndarray, along: np.ndarray, flex: np.ndarray) -> np.ndarray:
    """Works of one pressure on the displacement of another, over one of the two contacts."""
    norm = 2 * np.pi / (2 * even + 1)  # half of the sphere
    traction = np.stack([radial, along])
    moved = np.einsum("nab,bnj->anj", flex, traction)
    moved[1] *= (even * (even + 1.0))[:, None]
    return np.einsum("n,ani,anj->ij", norm, traction, moved)


def compliances(degrees: np.ndarray, layers: Sequence[tuple[float, Matter]]) -> np.ndarray:
    """(degrees, 2, 2): U and V at the surface of the tractions P_n along r and dP_n/dt along the angle."""
    return np.array([_compliance(int(n), tuple(layers)) for n in degrees])


@cache
def _compliance(n: int, layers: tuple[tuple[float, Matter], ...]) -> np.ndarray:
    columns = [_solutions(n, k, layers) for k in range(len(layers))]
    sides = [list(side) for side in zip(*columns, strict=True)]  # values at the outer and at the inner face
    kinds = 2 if n else 1
    unknowns = [outer.shape[1] for outer in sides[0]]
    starts = np.concatenate([[0], np.cumsum(unknowns)])
    size = starts[-1]
    matrix, right = np.zeros((size, size)), np.zeros((size, kinds))
    matrix[:kinds, : starts[1]] = sides[0][0][kinds:]
    right[:kinds] = np.eye(kinds)
    for k in range(len(layers) - 1):
        row = kinds + 2 * kinds * k
        matrix[row : row + 2 * kinds, starts[k] : starts[k + 1]] = sides[1][k]
        matrix[row : row + 2 * kinds, starts[k + 1] : starts[k + 2]] = -sides[0][k + 1]
    found = np.zeros((2, 2))
    found[:kinds, :kinds] = sides[0][0][:kinds] @ np.linalg.solve(matrix, right)[: starts[1]]
    return found


def _solutions(n: int, k: int, layers: Sequence[tuple[float, Matter]]) -> tuple[np.ndarray, np.ndarray]:
    """(U, V, s_rr, s_rt) of each solution at the outer and inner face of shell k, each 1 where it is largest."""
    (outer, (E, nu)), N = layers[k], n * (n + 1)
    mu = E / (2 * (1 + nu))
    ratio = 2 * (1 - nu) / (1 - 2 * nu)  # (lam + 2 mu)/mu
    inner = layers[k + 1][0] if k + 1 < len(layers) else 0.0
    powers = [n - 1, n + 1, -n, -n - 2] if n else [1, -2]
    faces: list[list[list[float]]] = [[], []]
    for p in powers if inner else [p for p in powers if p > 0 or (n and p >= n - 1)]:
        if p in (n - 1, -n - 2) and n:
            A, B = float(p + 1), 1.0
        elif n:
            A, B = float(ratio * N - p * (p + 1)), float(ratio * (p + 2) - p)
        else:
            A, B = 1.0, 0.0
        A, B = A / np.hypot(A, n * B), B / np.hypot(A, n * B)
        divergence = (p + 2) * A - N * B
        stresses = [mu * ((ratio - 2) * divergence + 2 * p * A), mu * (A + (p - 1) * B)]
        largest = outer if p > 0 else inner
        for face, r in zip(faces, (outer, inner), strict=True):
            scale = (r / largest) ** p if r else 0.0
            face.append([A * scale, B * scale, *(s * scale / r if r else 0.0 for s in stresses)])
    kept = [0, 1, 2, 3] if n else [0, 2]
    return np.array(faces[0]).T[kept], np.array(faces[1]).T[kept]
