"""Drained boundary layer of a porous body, and its overestimation by linear finite elements.

Lengths and times are in any consistent units; fluid leaves the body through the drained face.
Source: Carslaw & Jaeger (1959), Conduction of Heat in Solids, section 2.5.
"""

from __future__ import annotations

import math

import numpy as np


def drained_length(diffusivity: float, elapsed: np.ndarray, ramp_time: np.ndarray) -> np.ndarray:
    """Return the thickness (n,) [length] of an undrained layer with the volume of the lost fluid.

    The pressure p in a half-space grows linearly over the time `ramp_time` and then stays constant.
    The volume of fluid per area that has left through the drained face until the time `elapsed` is
    (p permeability/D) times the length

        (4/3) (D/pi)^(1/2) (elapsed^(3/2) - (elapsed - ramp_time)^(3/2))/ramp_time,

    or 2 (D elapsed/pi)^(1/2) if the pressure is sudden (Carslaw & Jaeger 1959, section 2.5).

    Parameters
    ----------
    diffusivity
        Diffusivity D [length^2/time].
    elapsed
        Times (n,) since the pressure began to grow, > 0 [time].
    ramp_time
        Times (n,) during which the pressure grows, from 0 to `elapsed` [time].
    """
    # The difference of powers would lose digits.
    is_sudden = ramp_time < 1e-6 * elapsed
    growth_time = np.where(is_sudden, elapsed, ramp_time)
    ramped = (elapsed**1.5 - (elapsed - growth_time) ** 1.5) / growth_time
    return (
        4.0
        / 3.0
        * np.sqrt(diffusivity / math.pi)
        * np.where(is_sudden, 1.5 * np.sqrt(elapsed), ramped)
    )


def excess_length(h: np.ndarray, drained: np.ndarray) -> np.ndarray:
    """Return the excess [length] of `drained_length` on elements with linear pressure.

    In Laplace space the drained length of a half-space is (D/s)^(1/2). For elements of height h
    with p = 0 at the face it is (D/s + h^2/12)^(1/2), or h/12^(1/2) at time 0. The difference at a
    given time is at most

        (drained^2 + h^2/12)^(1/2) - drained.

    For large h this bound equals the difference; for small h it is 1.2 (ramp) to 1.6 (jump) times
    the difference.

    Parameters
    ----------
    h
        Height of the elements at the drained face [length].
    drained
        Result of `drained_length` [length], broadcast with h.
    """
    return np.hypot(drained, h / math.sqrt(12.0)) - drained
