"""Force of a tilted cone on a half-space, by elements of constant pressure on its surface.

A reference for `indenter.tilt` that shares nothing with the program: the displacement is that of
squares with a uniform pressure (Love 1929), summed by the fast Fourier transform, and the pressures
p >= 0 minimize the complementary energy by conjugate gradients on the points in contact (Polonsky &
Keer 1999, Wear 231, 206).

`python tests/tilted_cone_elements.py` prints the force of cones with a half angle of 70 degrees,
tilted by 5, 10 and 15 degrees, over that of the upright cone at the same depth.
"""

from __future__ import annotations

from math import cos, pi, radians, sin, tan

import numpy as np
from scipy.fft import irfft2, rfft2


def cone_height(x: np.ndarray, y: np.ndarray, half_angle: float, tilt: float) -> np.ndarray:
    """Height of a cone whose axis leans towards x, in degrees, above its apex; infinite beside it.

    It is the least z whose point is on the cone, found by bisection of the angle to the axis.
    """
    s = sin(radians(tilt))
    c = cos(radians(tilt))
    low = np.full(x.shape, -np.hypot(x, y))
    high = 1e3 * (np.hypot(x, y) + 1e-12)
    for _ in range(80):
        z = 0.5 * (low + high)
        is_inside = np.hypot(x * c - z * s, y) <= (x * s + z * c) * tan(radians(half_angle))
        low = np.where(is_inside, low, z)
        high = np.where(is_inside, z, high)
    return high


def influence(count: int, h: float) -> np.ndarray:
    """Transform of the displacement by squares of side h with pressure E*, on 2 count points."""
    k = np.arange(2 * count)
    x = h * np.where(k < count, k, k - 2 * count)[:, None]
    y = x.T
    below_x = x - h / 2
    above_x = x + h / 2
    below_y = y - h / 2
    above_y = y + h / 2

    def part(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        return a * np.log((b + np.hypot(a, b)) / (c + np.hypot(a, c)))

    u = part(above_x, above_y, below_y) + part(above_y, above_x, below_x)
    u += part(below_x, below_y, above_y) + part(below_y, below_x, above_x)
    return np.asarray(rfft2(u / pi))


def cone_force(half_angle: float, tilt: float, count: int) -> float:
    """Force over E* at depth 1, on count x count points."""
    # Ends of the contact along x, from the slopes of both flanks, with a margin for its shape that
    # grows with the tilt.
    front = tan(radians(half_angle + tilt))
    back = tan(radians(half_angle - tilt))
    width = 1.265 * (front + back) * 2 / pi * (1 + tilt / 45)
    h = width / count
    middle = (front - back) / pi
    x = middle + h * (np.arange(count) - count / 2 + 0.5)[:, None] * np.ones(count)
    y = h * (np.arange(count) - count / 2 + 0.5)[None, :] * np.ones((count, 1))
    target = 1.0 - cone_height(x, y, half_angle, tilt)
    kernel = influence(count, h)

    def displacement(p: np.ndarray) -> np.ndarray:
        padded = np.zeros((2 * count, 2 * count))
        padded[:count, :count] = p
        return np.asarray(irfft2(rfft2(padded) * kernel, s=padded.shape))[:count, :count]

    p = np.where(target > 0, target, 0.0) / width
    direction = np.zeros_like(p)
    previous = 1.0
    is_restarted = True
    for _ in range(3000):
        r = displacement(p) - target
        in_contact = (p > 0) | (r < 0)
        r = np.where(in_contact, r, 0.0)
        square = float((r * r).sum())
        if square < 1e-14 * float((np.maximum(target, 0) ** 2).sum()):
            break
        direction = r if is_restarted else r + square / previous * direction
        direction = np.where(in_contact, direction, 0.0)
        previous = square
        step = float((r * direction).sum()) / float((direction * displacement(direction)).sum())
        advanced = p - step * direction
        is_restarted = bool(((advanced < 0) & in_contact).any())
        p = np.maximum(advanced, 0.0)
    edge = np.concatenate([p[0], p[-1], p[:, 0], p[:, -1]])
    assert edge.max() == 0, "the contact reaches the end of the points"
    return float(p.sum()) * h * h


def force_ratio(half_angle: float, tilt: float, count: int = 256) -> float:
    """Force of a tilted over that of an upright cone, extrapolated from two sizes of elements."""
    fine = cone_force(half_angle, tilt, count) / cone_force(half_angle, 0.0, count)
    coarse = cone_force(half_angle, tilt, count // 2) / cone_force(half_angle, 0.0, count // 2)
    return 2 * fine - coarse


if __name__ == "__main__":
    print("upright, over theory:", cone_force(70.0, 0.0, 256) / (2 / pi * tan(radians(70))))
    for tilt in (5.0, 10.0, 15.0):
        print(tilt, force_ratio(70.0, tilt))
