"""Search for the largest pull between rows, on curves in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, pi, sqrt

import numpy as np
import pytest

from indent_sim.fe.path.pull_off import (
    MAX_EQUILIBRIA,
    LargestPull,
    PullPoint,
    UnloadingBranch,
    find_largest_pull,
)
from indent_sim.process.errors import NotConverged

Curve = Callable[[float], float | None]  # the force at a depth; None where the tip has come off
WORK = 1e-4
JKR_PULL_OFF = -1.5 * pi * WORK  # at R = E* = 1
JKR_DEPTH = (pi * WORK) ** (2 / 3)


def jkr(delta: float) -> float | None:
    """JKR force at a depth on the branch of wide contacts, by bisection; None beyond its fold."""

    def depth(a: float) -> float:
        return a**2 - sqrt(2 * pi * WORK * a)

    fold = (pi * WORK / 8) ** (1 / 3)  # where d(depth)/da = 0
    if delta < depth(fold):
        return None
    low, high = fold, 1.0
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if depth(middle) < delta else (low, middle)
    return 4 * low**3 / 3 - sqrt(8 * pi * WORK * low**3)


def punch(end: float, curved: float) -> Curve:
    """Curve whose pull grows until the tip lets go at -1, at the depth `end`.

    Next to `end` the force follows the root of the distance; `curved` is the range of that root.
    """

    def force(delta: float) -> float | None:
        distance = delta - end
        return None if distance < 0 else -1.0 + 1.5 * sqrt(distance**2 + 0.4 * curved * distance)

    return force


def at(curve: Curve, delta: float) -> PullPoint:
    """Equilibrium of a curve at a depth, as a point of the search."""
    force = curve(delta)
    return PullPoint(delta, 0.0, force or 0.0, a=0.0 if force is None else 1.0)


def way_out(curve: Curve, depths: Sequence[float]) -> UnloadingBranch:
    """Unloading branch of rows at some depths."""
    way = UnloadingBranch()
    for delta in depths:
        way = way.add_point(at(curve, float(delta)))
    return way


def searched(curve: Curve, depths: Sequence[float], tolerance: float) -> LargestPull:
    """Largest pull between rows at some depths."""
    bracket = way_out(curve, depths).bracket
    assert bracket is not None
    return find_largest_pull(
        *bracket, lambda begin, end, delta: at(curve, delta), lambda pull: tolerance
    )


@pytest.mark.parametrize(("spacing", "most"), [(1.0, 10), (0.5, 10), (0.07, 2)])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_jkrs_pull_off_is_found_wherever_the_rows_lie(
    spacing: float, most: int, tolerance: float
) -> None:
    """The pull-off of JKR, -3/2 pi w R, is found within the stated error, wherever the rows lie.

    Rows half a unit apart alone would be off by up to 9 %.
    """
    off_rows = []
    for offset in np.linspace(0, 1, 40):
        depths = (1 + spacing * (offset - np.arange(6 / spacing))) * JKR_DEPTH
        found = searched(jkr, depths, tolerance)
        assert -1e-12 < found.point.force - JKR_PULL_OFF <= found.error
        assert found.error <= tolerance * abs(JKR_PULL_OFF)
        assert found.equilibria <= most
        off_rows.append(min(jkr(delta) or 0.0 for delta in depths) / JKR_PULL_OFF)
    assert min(off_rows) < 0.999


@pytest.mark.parametrize("spacing", [0.3, 0.1])
@pytest.mark.parametrize("curved", [0.05, 0.2, 1.0])
def test_a_tip_that_lets_go_while_it_is_pulled_harder(spacing: float, curved: float) -> None:
    """The largest pull at a fold lies within the stated error.

    Next to the fold the force is a square root of the distance: every factor of four in depth
    halves the missing force, so that the search ends with its limit of equilibria.
    """
    for end in np.linspace(-0.6, -0.5, 30):
        found = searched(
            punch(float(end), curved), 0.1 - spacing * np.arange(1 / spacing + 3), 1e-3
        )
        assert 0 <= found.point.force + 1.0 <= found.error
        assert found.error < 0.02
        assert found.equilibria <= MAX_EQUILIBRIA


def test_a_minimum_in_front_of_a_fold_is_not_passed_over() -> None:
    """A minimum between two rows is found although a third row lies beyond the fold.

    The outer row of the minimum lies right before the fold; bisection towards the fold alone would
    end there, with half of the pull.
    """
    fold = -(3 / 4) * JKR_DEPTH
    depths = np.array([4 * JKR_DEPTH, 3.0 * JKR_DEPTH, fold * 0.999, 3 * fold])
    assert (jkr(depths[2]) or 0.0) > 0.6 * JKR_PULL_OFF
    found = searched(jkr, depths, 1e-3)
    assert found.point.force == pytest.approx(JKR_PULL_OFF, rel=1e-3)


def test_depths_without_equilibrium_further_out_are_as_good_as_a_jump() -> None:
    curve = punch(-0.55, 0.2)

    def go(begin: PullPoint, end: PullPoint, delta: float) -> PullPoint:
        found = at(curve, delta)
        return found if found.is_touching else PullPoint(delta, 0.0, inf, a=0.0)

    bracket = way_out(curve, [0.1, -0.2, -0.5, -0.8]).bracket
    assert bracket is not None
    lost, there = (
        find_largest_pull(*bracket, go, lambda pull: 1e-3),
        searched(curve, [0.1, -0.2, -0.5, -0.8], 1e-3),
    )
    assert (lost.point.delta, lost.error) == (there.point.delta, there.error)


def test_a_depth_that_is_lost_where_the_tip_has_been_further_out_ends_the_search() -> None:
    bracket = way_out(lambda delta: (delta + 0.3) ** 2 - 1, [0.4, 0.0, -0.5, -1.0]).bracket
    assert bracket is not None
    with pytest.raises(NotConverged, match="has passed during unloading"):
        find_largest_pull(
            *bracket, lambda begin, end, delta: PullPoint(delta, 0.0, inf, a=0.0), lambda pull: 1e-3
        )


def test_every_equilibrium_is_found_on_the_way_out() -> None:
    """Every equilibrium of the search is reached by unloading, inside the bracket."""
    ways = []

    def go(begin: PullPoint, end: PullPoint, delta: float) -> PullPoint:
        ways.append((begin.delta, delta, end.delta))
        return at(jkr, delta)

    bracket = way_out(jkr, np.array([2.0, 1.0, 0.0, -1.0, -2.0]) * JKR_DEPTH).bracket
    assert bracket is not None
    find_largest_pull(*bracket, go, lambda pull: 1e-4)
    assert ways and all(begin > delta > end for begin, delta, end in ways)


# ---- which rows are searched between


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(0.1, 1.0), (0.0, -1.0), (-0.1, -2.0), (-0.2, -0.5)], (0.0, -0.1, -0.2)),
        ([(-0.2, -3.0), (0.1, 1.0), (0.0, -2.0), (-0.1, 0.0)], (0.1, 0.0, -0.1)),
        ([(0.1, 1.0), (0.0, -1.0), (-0.1, -2.0)], None),
        ([(0.1, 1.0), (0.0, -1.0), (-0.1, -2.0), (0.1, 1.0)], None),
        ([(0.1, 1.0), (-0.1, -2.0), (0.0, -1.0), (-0.2, -0.5)], None),
        ([(-0.1, -2.0), (-0.2, -0.5), (-0.3, -0.6), (-0.4, -0.1)], None),
        (
            [(0.1, 1.0), (0.0, -1.0), (-0.1, 0.0), (0.1, 1.0), (0.0, -2.0), (-0.1, 0.0)],
            (0.1, 0.0, -0.1),
        ),
        (
            [(0.1, 1.0), (0.0, -2.0), (-0.1, 0.0), (0.1, 1.0), (0.0, -1.0), (-0.1, 0.0)],
            (0.1, 0.0, -0.1),
        ),
        ([(0.1, 3.0), (0.0, 1.0), (-0.1, 2.0)], None),
        ([(0.1, 1.0), (0.2, 2.0)], None),
    ],
    ids=[
        "pulls",
        "snaps in with a larger pull",
        "ends while it pulls",
        "turns where it pulls most",
        "turns there, and goes on later",
        "has turned there",
        "second way out",
        "first way out",
        "pushes",
        "goes in",
    ],
)
def test_the_largest_pull_of_the_ways_out_needs_rows_on_both_sides(
    rows: list[tuple[float, float]], expected: tuple[float, ...] | None
) -> None:
    way = UnloadingBranch()
    for delta, force in rows:
        way = way.add_point(PullPoint(delta, 0.0, force, a=1.0))
    bracket = way.bracket
    assert (bracket and tuple(place.delta for place in bracket)) == expected


@pytest.mark.parametrize("stopped", range(1, 7))
def test_what_is_kept_goes_on_as_before(stopped: int) -> None:
    """An unloading branch restored from its search points goes on with the same bracket."""
    places = [
        (-0.1, -0.1),
        (0.1, 1.0),
        (0.0, -1.0),
        (-0.1, -2.0),
        (-0.2, -0.5),
        (-0.1, -0.4),
        (-0.3, 0.0),
    ]
    pulls = [PullPoint(delta, 0.0, force, a=1.0) for delta, force in places]

    def after(way: UnloadingBranch, rows: Sequence[PullPoint]) -> UnloadingBranch:
        for row in rows:
            way = way.add_point(row)
        return way

    before = after(UnloadingBranch(), pulls[:stopped])
    goes_on = UnloadingBranch.from_search_points(before.search_points, before.last)
    assert after(goes_on, pulls[stopped:]) == after(UnloadingBranch(), pulls)
