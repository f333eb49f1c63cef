"""Boundary elements for a paraboloid that is pushed sideways on an incompressible half-space.

With nu = 0.5 the pressure is that of Hertz whatever the tangential tractions are. Square cells have
constant tractions along x and y, whose displacements are integrals of Cerruti's solution. In every
increment of the slide the tractions minimize the complementary energy with |q| <= mu p, whose
multiplier is the slip in the direction of q: Coulomb's law in both directions. Source: Johnson,
Contact Mechanics (1985), 3.6 and 7.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

NU = 0.5
Primitive = Callable[[np.ndarray, np.ndarray], np.ndarray]


def side_force(
    force: float, friction: float, slide: float, cells: int, increments: int = 4
) -> float:
    """Return the side force on a half-space of E = 1 under a paraboloid of R = 1.

    Parameters
    ----------
    force
        Normal force, which is held.
    friction
        Coefficient of friction.
    slide
        Displacement of the tip.
    cells
        Number of cells across the contact.
    increments
        Number of increments of the slide.
    """
    a = (0.75 * force * (1 - NU**2)) ** (1 / 3)
    h = 2 * a / cells
    x, y, p = _pressure(force, a, h, cells)
    compliance = _compliance(x, y, h)
    bound = friction * p
    along_x = np.repeat([1.0, 0.0], len(p))
    stiffest = 1.02 * float(np.linalg.eigvalsh(compliance)[-1])
    q = np.zeros(2 * len(p))
    for _ in range(increments):
        start = q
        previous = q
        momentum = 1.0
        trial = q
        for _ in range(1000):
            slip = slide / increments * along_x - compliance @ (trial - start)
            q = _within(trial + slip / stiffest, bound)
            if np.abs(q - previous).max() < 1e-9 * bound.max():
                break
            faster = (1 + (1 + 4 * momentum**2) ** 0.5) / 2
            trial = q + (momentum - 1) / faster * (q - previous)
            momentum = faster
            previous = q
    return float(q[: len(p)].sum()) * h * h


def _pressure(
    force: float, a: float, h: float, cells: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the centers of the cells in the contact and the means of Hertz's pressure on them."""
    center = (np.arange(cells) + 0.5) * h - a
    x, y = np.meshgrid(center, center, indexing="ij")
    offset = (np.arange(9) + 0.5) / 9 * h - h / 2
    r2 = (x[..., None, None] + offset[:, None]) ** 2 + (y[..., None, None] + offset) ** 2
    p_max = 1.5 * force / (np.pi * a * a)
    p = p_max * np.sqrt(np.maximum(1 - r2 / a**2, 0.0)).mean(axis=(-1, -2))
    return x[p > 0], y[p > 0], p[p > 0]


def _compliance(x: np.ndarray, y: np.ndarray, h: float) -> np.ndarray:
    """Return the displacements along x, then y, by unit tractions along x, then y."""
    dx = x[:, None] - x
    dy = y[:, None] - y
    yy = _cell_integral(lambda u, v: u * np.log(v + np.hypot(u, v)), dx, dy, h)
    xx = _cell_integral(lambda u, v: v * np.log(u + np.hypot(u, v)), dx, dy, h)
    xy = _cell_integral(lambda u, v: -np.hypot(u, v), dx, dy, h)
    both = xx + yy  # the integral of 1/r
    blocks = [[(1 - NU) * both + NU * xx, NU * xy], [NU * xy, (1 - NU) * both + NU * yy]]
    shear_modulus = 1 / (2 * (1 + NU))
    C = np.block(blocks) / (2 * np.pi * shear_modulus)
    return (C + C.T) / 2


def _cell_integral(primitive: Primitive, x: np.ndarray, y: np.ndarray, h: float) -> np.ndarray:
    """Return the integral over a cell of the function with the given second primitive."""
    half = h / 2
    return (
        primitive(x + half, y + half)
        - primitive(x + half, y - half)
        - primitive(x - half, y + half)
        + primitive(x - half, y - half)
    )


def _within(q: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """Return the nearest tractions whose magnitude is at most the bound."""
    parts = q.reshape(2, -1)
    size = np.hypot(*parts)
    return (parts * np.minimum(1.0, bound / np.maximum(size, 1e-300))).ravel()
