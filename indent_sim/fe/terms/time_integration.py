"""Time integration by SDIRK2: two backward Euler stages in each time step (Alexander 1977)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Stage:
    """Stage of a time step: backward Euler from an initial value y_start.

    With the last accepted value y_n and the result y_1 of the first stage,

        y_start = y_n + extrapolation_factor (y_1 - y_n).

    Attributes
    ----------
    dt : float
        Length of the stage [time].
    elapsed : float
        Time from the beginning of the step to the end of the stage [time].
    end_fraction : float
        Fraction of the step at which the stage ends.
    extrapolation_factor : float
        Factor in the formula above; zero in the first stage.
    """

    dt: float
    elapsed: float = 0.0
    end_fraction: float = 1.0
    extrapolation_factor: float = 0.0


# SDIRK2 is L-stable and of second order with this coefficient (Alexander 1977)
SDIRK2_GAMMA = 1 - 0.5**0.5


def sdirk2_stages(dt: float) -> list[Stage]:
    """Return the two stages of SDIRK2 for a step of length `dt` [time]."""
    first_dt = SDIRK2_GAMMA * dt
    extrapolation_factor = (1 - SDIRK2_GAMMA) / SDIRK2_GAMMA
    return [
        Stage(first_dt, first_dt, end_fraction=SDIRK2_GAMMA),
        Stage(first_dt, dt, extrapolation_factor=extrapolation_factor),
    ]
