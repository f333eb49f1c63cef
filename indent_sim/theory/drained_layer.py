"""Drained boundary layer of a porous body, and its overestimate by linear finite elements.

Lengths and times in any consistent units; the fluid leaves the body through the drained face.
Source: Carslaw & Jaeger (1959), Conduction of Heat in Solids, section 2.5.
"""

from __future__ import annotations

import math

import numpy as np

# of the time since: a pressure that grows in less is sudden, and the difference of powers loses
# digits
SUDDEN_FRACTION = 1e-6


def drained_length(diffusivity: float, elapsed: np.ndarray, ramp_time: np.ndarray) -> np.ndarray:
    """Return the depth (n,) [length] of undrained body whose fluid has left through a drained face.

    A half-space whose pressure p grows linearly over the time `ramp_time`, and stays then, has lost
    this length times p permeability/D of fluid per area at the time `elapsed`:

        (4/3) (D/pi)^(1/2) (elapsed^(3/2) - (elapsed - ramp_time)^(3/2))/ramp_time,

    and 2 (D elapsed/pi)^(1/2) where the pressure is sudden (Carslaw & Jaeger 1959, 2.5).

    Parameters
    ----------
    diffusivity
        D [length^2/time].
    elapsed
        Times (n,) since the pressure began to grow, > 0 [time].
    ramp_time
        Times (n,) in which it grows, 0 to `elapsed` [time].
    """
    is_sudden = ramp_time < SUDDEN_FRACTION * elapsed
    growth_time = np.where(is_sudden, elapsed, ramp_time)
    ramped = (elapsed**1.5 - (elapsed - growth_time) ** 1.5) / growth_time
    return (
        4.0
        / 3.0
        * np.sqrt(diffusivity / math.pi)
        * np.where(is_sudden, 1.5 * np.sqrt(elapsed), ramped)
    )


def excess_length(h: np.ndarray, drained: np.ndarray) -> np.ndarray:
    """Return the overestimate [length] of `drained_length` by elements of linear pressure.

    In Laplace space a half-space drains (D/s)^(1/2), and a row of elements of the height h with p =
    0 at its end (D/s + h^2/12)^(1/2), which is h/12^(1/2) at time 0. At a time t the difference is
    at most (drained^2 + h^2/12)^(1/2) - drained: equal to it where h is large, 1.2 (ramp) to 1.6
    (jump) times too large where h is small.

    Parameters
    ----------
    h
        Height of the elements at the drained face [length].
    drained
        `drained_length` [length], of a shape that broadcasts with h.
    """
    return np.hypot(drained, h / math.sqrt(12.0)) - drained
