"""Synthetic nanoindentation tests: loading, hold and unloading of a sample of known properties.

The power law of unloading is chosen so that the formulas of Oliver and Pharr, written here a second
time and backwards, give the properties: F_max and H_IT determine the area, the area and E_IT the
stiffness, and both the depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

DIAMOND = 1141.0 / (1 - 0.07**2)  # plane-strain modulus [GPa]
BERKOVICH = 24.494  # area over the square of the contact depth
GPA = 1e-6  # 1 GPa in mN/nm^2


@dataclass(frozen=True)
class Sample:
    """Sample with hardness and modulus [GPa], and the exponent of its unloading curve."""

    E: float
    H: float
    nu: float
    m: float
    tip_E_star: float = DIAMOND
    epsilon: float = 0.75


FUSED_SILICA = Sample(E=72.0, H=9.3, nu=0.17, m=1.27)
STEEL = Sample(E=210.0, H=4.0, nu=0.3, m=1.5)


@dataclass(frozen=True)
class Loop:
    """Times [s], depths [nm] and forces [mN] of a test, and what they were made from.

    Attributes
    ----------
    t, h, F
        Samples (n,).
    S
        Stiffness [mN/nm].
    h_max, h_c, h_f
        Depths [nm] at the beginning of unloading, of the contact, and after unloading.
    hold_start
        Depth [nm] at the beginning of the hold.
    """

    t: np.ndarray
    h: np.ndarray
    F: np.ndarray
    S: float
    h_max: float
    h_c: float
    h_f: float
    hold_start: float

    def table(self) -> str:
        """Return the test as text with time, depth and force."""
        rows = zip(self.t, self.h, self.F, strict=True)
        lines = [f"{t:.3f},{h:.3f},{F:.5f}" for t, h, F in rows]
        return "\n".join(["Time [s],Depth [nm],Load [mN]", *lines, ""])


def loop(
    sample: Sample,
    F_max: float = 10.0,
    rows: int = 200,
    hold_rows: int = 100,
    creep: float = 0.01,
    last: float = 0.0,
) -> Loop:
    """Return a test with loading, hold and unloading at a constant rate of the force.

    Parameters
    ----------
    sample
        The sample.
    F_max
        Largest force [mN].
    rows, hold_rows
        Samples of loading and of unloading, and of the hold.
    creep
        Relative increase of the depth in the hold.
    last
        Fraction of the largest force at which unloading ends.
    """
    E_r = 1 / ((1 - sample.nu**2) / sample.E + 1 / sample.tip_E_star)
    area = F_max / (sample.H * GPA)
    S = 2 / sqrt(pi) * E_r * GPA * sqrt(area)
    h_c = sqrt(area / BERKOVICH)
    h_max = h_c + sample.epsilon * F_max / S
    h_f = h_max - sample.m * F_max / S
    begin = h_max / (1 + creep) if hold_rows else h_max
    up = np.linspace(0.0, 1.0, rows)
    held = np.linspace(0.0, 1.0, hold_rows + 1)[1:]
    down = np.linspace(1.0, last, rows + 1)[1:]
    h = [begin * np.sqrt(up), begin + (h_max - begin) * np.sqrt(held)]
    h.append(h_f + (h_max - h_f) * down ** (1 / sample.m))
    F = F_max * np.concatenate([up, np.ones(hold_rows), down])
    return Loop(0.05 * np.arange(len(F)), np.concatenate(h), F, S, h_max, h_c, h_f, begin)
