"""The method of Oliver and Pharr a second time, for tests: another algorithm for the power law.

The exponent and the depth h_f are searched by scipy's `curve_fit` on the samples between two
fractions of the largest force, with starts from the literature, and no code of the program.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from scipy.optimize import curve_fit


def oliver_pharr(
    h: np.ndarray,
    F: np.ndarray,
    nu: float,
    area: float = 24.494,
    epsilon: float = 0.75,
    beta: float = 1.0,
    tip: tuple[float, float] = (1141.0, 0.07),
) -> dict[str, float]:
    """Return S [mN/nm], h_c [nm], H and E [GPa] of a loop in nm and mN."""
    top = int(np.flatnonzero(F.max() == F)[-1])
    h_max = float(h[top])
    F_max = float(F[top])
    fall_h = h[top:]
    fall_F = F[top:]
    used = (fall_F <= 0.98 * F_max) & (fall_F >= 0.4 * F_max)
    x = fall_h[used] / h_max
    y = fall_F[used] / F_max

    def power_law(x: np.ndarray, B: float, h_f: float, m: float) -> np.ndarray:
        return B * np.maximum(x - h_f, 1e-12) ** m

    h_f = 0.9 * float(fall_h[fall_F > 0].min()) / h_max
    start = (1.0 / (1.0 - h_f) ** 1.5, h_f, 1.5)
    (B, h_f, m), _ = curve_fit(power_law, x, y, p0=start, maxfev=100000, xtol=1e-13, ftol=1e-13)
    S = float(m * B * (1.0 - h_f) ** (m - 1.0)) * F_max / h_max
    h_c = h_max - epsilon * F_max / S
    A = area * h_c**2
    E_r = sqrt(pi) / 2.0 / beta * S / sqrt(A) * 1e6
    E = (1.0 - nu**2) / (1.0 / E_r - (1.0 - tip[1] ** 2) / tip[0])
    return {"S": S, "h_c": h_c, "H_IT": 1e6 * F_max / A, "E_IT": E, "m": float(m)}
