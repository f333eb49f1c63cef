"""Elastic load curve of a body from samples: force and contact radius as functions of the depth.

ln F and ln a are cubic splines of ln delta; below the first sample the curve is continued as a
power law. delta and force are > 0 in indentation. Lengths [L], forces [F].
Source: de Boor (1978), A Practical Guide to Splines, chapter 4, for cubic splines.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

MIN_CURVE_SAMPLES = 4  # Samples that a cubic spline needs.


class ElasticCurve:
    """Force and contact radius of an elastic body as functions of the depth, from splines.

    Parameters
    ----------
    delta
        Depths (n,) [L], > 0 and increasing.
    force
        Forces (n,) [F].
    a
        Contact radii (n,) [L].

    Raises
    ------
    ValueError
        For fewer than MIN_CURVE_SAMPLES samples.
    """

    def __init__(self, delta: np.ndarray, force: np.ndarray, a: np.ndarray):
        if len(delta) < MIN_CURVE_SAMPLES:
            raise ValueError(
                f"a load curve needs at least {MIN_CURVE_SAMPLES} samples, got {len(delta)}"
            )
        self.deepest = float(delta[-1])
        self._low = math.log(delta[0])
        self._force, self._a = (CubicSpline(np.log(delta), np.log(values)) for values in (force, a))

    def _value_and_slope(
        self, spline: CubicSpline, delta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return exp(spline) and its derivative with respect to ln delta; 0 for delta <= 0."""
        delta = np.asarray(delta, dtype=float)
        x = np.log(np.where(delta > 0, delta, 1.0))
        log_depth_inside = np.maximum(x, self._low)
        slope = spline(log_depth_inside, 1)
        value = np.where(
            delta > 0, np.exp(spline(log_depth_inside) + slope * (x - log_depth_inside)), 0.0
        )
        return value, slope * value

    def force(self, delta: np.ndarray) -> np.ndarray:
        """Return the force [F] at depths [L]."""
        return self._value_and_slope(self._force, delta)[0]

    def stiffness(self, delta: np.ndarray) -> np.ndarray:
        """Return dF/ddelta [F/L] at depths [L]; 0 without contact."""
        delta = np.asarray(delta, dtype=float)
        return self._value_and_slope(self._force, delta)[1] / np.where(delta > 0, delta, 1.0)

    def contact_radius(self, delta: np.ndarray) -> np.ndarray:
        """Return the contact radius [L] at depths [L]."""
        return self._value_and_slope(self._a, delta)[0]

    def depth_of_force(self, force: float) -> float:
        """Return the depth [L] of a force [F] >= 0; raises ValueError beyond the deepest sample."""
        if not 0.0 <= force <= float(self.force(np.array(self.deepest))):
            raise ValueError(f"the force {force:g} is beyond the last sample of the load curve")
        return self._root(lambda x: float(self.force(np.array(x))) - force, self.deepest)

    def depth_behind_spring(self, compliance: float, z: float) -> float:
        """Return the depth [L] at which delta + compliance force = z [L].

        Raises ValueError beyond the deepest sample.
        """
        if z <= 0.0 or compliance == 0.0:
            return z
        upper_depth = min(z, self.deepest)
        if upper_depth + compliance * float(self.force(np.array(upper_depth))) < z:
            raise ValueError(
                f"the depth at the base displacement {z:g} is beyond the last sample of the load "
                "curve"
            )
        return self._root(
            lambda x: x + compliance * float(self.force(np.array(x))) - z, upper_depth
        )

    def _root(self, equation: Callable[[float], float], high: float) -> float:
        """Return the root of an equation between 0 and `high`."""
        return float(brentq(equation, 0.0, high, xtol=1e-15 * high))
