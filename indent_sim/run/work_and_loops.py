"""Work of the tip: energy balance and hysteresis loop of a path."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from indent_sim.model.state import State
from indent_sim.model.work import path_integral


def energy_balance(states: list[State], side_force: str = "") -> float | None:
    """Return the relative difference of the tip's work and elastic energy plus dissipation.

    The work is int F ddelta; for a tip that slides it is int F ddelta - int F_x dx with the side
    force F_x on the tip. The integrals are trapezoid rules. The difference is reported, but not
    checked: with few rows the error of the trapezoid rule far exceeds the error of the solution.
    The result is None if there is no energy.

    Parameters
    ----------
    states
        The rows of a run.
    side_force
        Column of the side force along the slide; empty if the tip does not slide.
    """
    stored_and_dissipated = (
        states[-1].energy + (states[-1].plastic_dissipation or 0.0) if states else 0.0
    ) + sum(state.dissipation or 0.0 for state in states)
    if (
        len(states) < 2
        or stored_and_dissipated == 0
        or stored_and_dissipated != stored_and_dissipated
    ):
        return None
    delta = np.array([0.0, *(state.delta for state in states)])
    force = np.array([0.0, *(state.force for state in states)])
    work = path_integral(delta, force) + slide_work(states, side_force)
    return work / stored_and_dissipated - 1


def slide_work(states: Sequence[State], side_force: str) -> float:
    """Return the work - int F_x dx of a tip that slides, by a trapezoid rule [energy].

    Parameters
    ----------
    states
        The rows of a run.
    side_force
        Column of the side force along the slide; empty if the tip does not slide.
    """
    if not side_force:
        return 0.0
    slide = np.array([state.x for state in states])
    force = np.array([getattr(state, side_force) or 0.0 for state in states])
    return -path_integral(slide, force)


@dataclasses.dataclass(frozen=True)
class HysteresisLoop:
    """Hysteresis loop of force over depth of a path with unloading.

    Attributes
    ----------
    area
        Difference of the work of loading and of unloading [force length].
    error
        Estimated error of the area due to linear interpolation between rows [force length].
    loading_work
        Work of loading [force length].
    end_depth
        Depth [length] at which the path ends in contact; the loop is taken beyond this depth. None
        if the force is zero at the end of the path.
    """

    area: float
    error: float
    loading_work: float
    end_depth: float | None


def hysteresis_loop(states: Sequence[State]) -> HysteresisLoop | None:
    """Return the hysteresis loop of a path; None without unloading, or if the tip slides.

    If the path ends in contact, the loop is taken between the last and the largest depth. The area
    is enclosed by straight lines through the rows. Its error is of second order in the distance of
    the rows. It is estimated as a third of the change of the area if every second row between
    turning points is left out.
    """
    if any(state.x for state in states):
        return None
    rows = [(state.delta, state.force) for state in states]
    if rows[0][0] > 0:  # loading begins at first contact
        rows.insert(0, (0.0, 0.0))
    steps = [end[0] - begin[0] for begin, end in pairwise(rows)]
    work = [_work(*step) for step in pairwise(rows)]
    loading_work = sum(
        segment_work for segment_work, step in zip(work, steps, strict=True) if step > 0
    )
    if min(steps, default=0.0) >= 0 or not loading_work > 0:
        return None
    is_closed = not (rows[-1][0] > 0 and rows[-1][1] > 0)
    if not is_closed:
        rows = _rows_beyond(rows, rows[-1][0])
        steps = [end[0] - begin[0] for begin, end in pairwise(rows)]
        work = [_work(*step) for step in pairwise(rows)]
    turns = [i for i in range(1, len(steps)) if steps[i - 1] * steps[i] <= 0]
    kept_rows = sorted({*range(0, len(rows), 2), *turns, len(rows) - 1})
    coarse_area = sum(
        _work(rows[begin_row], rows[end_row]) for begin_row, end_row in pairwise(kept_rows)
    )
    end_depth = None if is_closed else rows[-1][0]
    return HysteresisLoop(sum(work), abs(sum(work) - coarse_area) / 3, loading_work, end_depth)


def _rows_beyond(rows: list[tuple[float, float]], depth: float) -> list[tuple[float, float]]:
    """Return a row interpolated where a depth is first crossed, and the rows after it."""
    first = next(i for i, (row_depth, _) in enumerate(rows) if row_depth >= depth)
    (depth_before, force_before), (depth_after, force_after) = rows[first - 1 : first + 1]
    fraction = (depth - depth_before) / (depth_after - depth_before)
    return [(depth, force_before + fraction * (force_after - force_before)), *rows[first:]]


def _work(begin: tuple[float, float], end: tuple[float, float]) -> float:
    """Return the work of a force between two points of depth and force, linear between them."""
    return (end[0] - begin[0]) * (begin[1] + end[1]) / 2
