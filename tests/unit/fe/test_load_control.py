"""Load control: the search of the depth of a prescribed force, on known curves."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from indent_sim.fe.path.load_control import LoadControl, predict_depth


class Curve:
    """A body whose force is a formula of the depth, down to `end`; it counts its evaluations."""

    def __init__(self, force_at: Callable[[float], float], end: float = math.inf):
        self.force_at, self.end = force_at, end
        self.delta, self.asked = 0.0, 0

    def __call__(self, delta: float) -> tuple[float, float]:
        self.asked += 1
        self.delta = min(delta, self.end)
        return self.force_at(self.delta), self.delta


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_a_power_law_is_predicted_exactly_from_two_points(exponent: float) -> None:
    """A power law is predicted exactly after two rows, as for punch, paraboloid and cone."""
    body = Curve(lambda delta: 3.0 * delta**exponent)
    control = LoadControl(body, deepest=1.0)
    for force in (1e-4, 2e-4):
        assert control.find_depth(force, expected=0.001)
    before = body.asked
    for force in (3e-4, 1.0, 1e-7, 2e-4, 0.0, 1e-5):
        assert control.find_depth(force, expected=0.5)
        assert body.delta == pytest.approx((force / 3.0) ** (1 / exponent), rel=1e-9)
    assert body.asked == before + 6


@pytest.mark.parametrize(
    "force_at",
    [
        lambda delta: delta**1.5 * (1 + 3 * delta + 40 * delta**3),  # a layer that stiffens
        lambda delta: delta / (1 - delta),  # that cannot be crushed
        lambda delta: max(0.0, delta - 0.01) ** 1.5,  # a mesh too coarse to feel the first touch
        lambda delta: delta**1.5 if delta < 0.1 else delta**1.5 + 5 * (delta - 0.1),  # a kink
        lambda delta: math.expm1(20 * delta),
    ],
)
@pytest.mark.parametrize("expected", [1e-6, 0.02, 0.9])
def test_any_increasing_curve(force_at: Callable[[float], float], expected: float) -> None:
    """Any increasing curve is solved from a good or bad first guess in at most 25 evaluations.

    Bisection alone would take more.
    """
    body = Curve(force_at)
    control = LoadControl(body, deepest=1 - 1e-12)
    for force in (1e-3, 0.02, 0.03, 0.3, 0.01, 0.0, 0.3):
        before = body.asked
        assert control.find_depth(force, expected), control.failure
        assert force_at(body.delta) == pytest.approx(force, rel=1e-10, abs=0)
        assert body.asked - before <= 25


def test_a_jump_is_no_depth() -> None:
    control = LoadControl(Curve(lambda delta: delta if delta < 0.1 else delta + 1), deepest=1.0)
    assert not control.find_depth(0.5, expected=0.05) and "discontinuous" in control.failure


def test_more_than_the_body_bears() -> None:
    control = LoadControl(Curve(lambda delta: delta), deepest=1.0)
    assert not control.find_depth(1.5, expected=0.05) and "base" in control.failure
    assert control.find_depth(0.5, expected=0.05)


def test_where_equilibria_end() -> None:
    """Where equilibria end below the force the search fails; the reason is the solver's."""
    body = Curve(lambda delta: delta, end=0.3)
    control = LoadControl(body, deepest=1.0)
    assert not control.find_depth(0.5, expected=0.4) and control.failure == "" and body.delta == 0.3
    assert control.find_depth(0.25, expected=0.4)


def test_where_equilibria_end_on_the_way_out() -> None:
    """A path-dependent body whose unloading ends above the force fails after one trial.

    Each trial starts from the row again and would be stopped at the same depth.
    """
    body = Curve(lambda delta: max(delta, 0.3))
    control = LoadControl(
        lambda delta: (body(delta)[0], max(delta, 0.3)), deepest=1.0, starts_from_row=True
    )
    assert control.find_depth(0.5, expected=0.4)
    before = body.asked
    assert not control.find_depth(0.1, expected=0.1) and control.failure == ""
    assert body.asked == before + 1


def test_prediction_far_from_what_is_known_is_no_polynomial() -> None:
    """A force far from the known points is predicted by a power law and not by a parabola.

    Three points within 2 % do not determine the curvature four decades away.
    """
    points = [(1.0 + n * 0.01, (1.0 + n * 0.01) ** (2 / 3) * (1 + 1e-9 * n**2)) for n in range(3)]
    assert predict_depth(1e4, points) == pytest.approx(1e4 ** (2 / 3), rel=0.01)
    assert predict_depth(1.0, []) is None


def test_a_curve_that_begins_with_a_pull_is_searched_from_there() -> None:
    """A curve that begins with a tensile force is searched from its first touch.

    For F = -2 + delta^(1/2), the force at first touch is -2, and zero at delta = 4.
    """
    reached: list[float] = []

    def reach(delta: float) -> tuple[float, float]:
        reached.append(delta)
        return -2.0 + delta**0.5, delta

    control = LoadControl(reach, 100.0)
    control.measure_pull_at_contact()
    assert control.find_depth(0.0, 1.0) and reached[-1] == pytest.approx(4.0, rel=1e-9)


@pytest.mark.parametrize("sunk", [-0.3, 0.0, 0.05])
def test_a_curve_that_has_moved_is_found_again(sunk: float) -> None:
    """The secant search finds the depth on a surface that has moved, from any start slope."""
    body = Curve(lambda delta: 3.0 * max(delta - sunk, 0.0) ** 1.5)
    control = LoadControl(body, deepest=1.0)
    for slope in (0.5, 2.0, 0.0):
        assert control.find_by_secant(0.01, 0.1, slope or 50.0)
        assert body.delta == pytest.approx(sunk + (0.01 / 3.0) ** (2 / 3), abs=1e-11)
    assert body.asked < 90


def test_a_body_that_stays_where_it_was_has_not_come_to_its_force() -> None:
    """A body that does not move fails, although it still holds the prescribed force."""
    control = LoadControl(lambda delta: (0.01, 0.2), deepest=1.0)
    assert not control.find_by_secant(0.01, 0.1, 1.0)
