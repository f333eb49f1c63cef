"""D."""

from __future__ import annotations

import math

import numpy as np

# of the time since: a pressure that grows in less is sudden, and the difference of powers loses
# digits
SUDDEN_FRACTION = 1e-6


def drained_length(diffusivity: float, elapsed: np.ndarray, ramp_time: np.ndarray) -> np.ndarray:
    """The depth (n,) [length] of undrained body whose fluid has left through a drained face.

    A half-space whose pressure p grows evenly over the time `ramp_time`, and stays then, has lost this
    times p permeability/D of fluid per area at the time `elapsed` its begin:

        (4/3) (D/pi)^(1/2) (since^(3/2) - (since - over)^(3/2))/over,

    and 2 (D since/pi)^(1/2) where the pressure is sudden (Carslaw & Jaeger 1959, 2.5).

    Parameters
    ----------
    diffusivity : D [length^2/time]
    since : times (n,) since the pressure began to grow, > 0 [time]
    over : times (n,) in which it grows, 0 to `elapsed` [time]
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
    """By how much elements of linear pressure and the height h [length] at a drained face overstate
    `drained_length`.

    In Laplace space a half-space drains (D/s)^(1/2), and a row of elements with p = 0 at its end
    (D/s + h^2/12)^(1/2), h/12^(1/2) if no time passes at all. At a time t the difference is at most
    (drained^2 + h^2/12)^(1/2) - drained: equal to it where h is large, 1.2 (ramp) to 1.6 (jump)
    times too large where h is small.

    Parameters
    ----------
    h, drained : of shapes that broadcast [length]
    """
    return np.hypot(drained, h / math.sqrt(12.0)) - drained
