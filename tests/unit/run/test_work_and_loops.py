"""Area of the hysteresis loop of a path, by hand, also of a path that ends in contact."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from indent_sim.run.work_and_loops import hysteresis_loop


def path(*rows: tuple[float, float]) -> Sequence[Any]:
    """Rows of depth and force."""
    return [SimpleNamespace(delta=delta, force=force, x=None) for delta, force in rows]


def test_an_elastic_path_that_ends_in_contact_has_no_loop() -> None:
    """An elastic path that ends in contact has no loop: the work is stored."""
    loop = hysteresis_loop(path((1, 1), (2, 2), (3, 3), (2, 2), (1.5, 1.5)))
    assert loop is not None and loop.end_depth == 1.5
    assert loop.area == pytest.approx(0, abs=1e-12) and loop.loading_work == pytest.approx(4.5)


def test_the_loop_of_a_path_that_ends_in_contact_is_that_beyond_its_end() -> None:
    """The loop of a path that ends in contact is the triangle beyond its last depth.

    It loads along F = delta and unloads along F = 2 delta - 3 to (2, 1).
    """
    loop = hysteresis_loop(path((1, 1), (2.5, 2.5), (3, 3), (2.5, 2), (2, 1)))
    assert loop is not None and loop.area == pytest.approx(0.5)


def test_a_closed_loop_is_that_of_the_whole_path() -> None:
    loop = hysteresis_loop(path((1, 1), (2, 2), (1, 0)))
    assert loop is not None and loop.end_depth is None
    assert loop.area == pytest.approx(2 - 1)


def test_a_cycle_that_returns_to_the_largest_depth_is_its_own_loop() -> None:
    """A cycle that returns to the largest depth is a loop of its own.

    It unloads along F = 3 delta - 4 and reloads along F = delta, between the depths 1.5 and 2.
    """
    loop = hysteresis_loop(path((2, 2), (1.5, 0.5), (2, 2)))
    assert loop is not None and loop.area == pytest.approx(0, abs=1e-12)
    loop = hysteresis_loop(path((2, 2), (1.5, 0.5), (1.5, 1.5), (2, 2)))
    assert loop is not None and loop.area == pytest.approx(0.25)
