"""Nondimensional experiments do not depend on the units of the scene; points of a history."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

import pytest

from indent_sim.model.experiment import Calibration, Cantilever, Experiment, Frame, JKRAdhesion
from indent_sim.model.loading import Loading
from indent_sim.model.units import Scales


def numbers(part: Any) -> list[float]:
    """All numbers in nested tuples."""
    if isinstance(part, tuple):
        return [number for one in part for number in numbers(one)]
    return [] if part is None else [float(part)]


def in_units(length: float, force: float, dim: int) -> Experiment:
    """One experiment in units of so many meters and newtons; in plane strain newtons per meter."""
    work = force / length if dim == 3 else force  # energy per area: pressure times length
    return Experiment(
        JKRAdhesion(2e-3 / work, 3e-9 / length),
        Cantilever(0.05 / (force / length)),
        Frame(0.7 / (length / force)),
        (10.0, 20.0),
        Calibration(0.1, 0.05),
    )


@pytest.mark.parametrize(("dim", "pieces"), [(3, 1), (3, 2), (2, 1)])
def test_units_go_away(dim: int, pieces: int) -> None:
    """A nondimensional experiment is the same for every choice of units.

    A spring that yields by w under a force f still does so without units.
    """
    height, E = 1e-5, 1e3  # [m], [Pa]
    found = []
    for length, force in ((1.0, 1.0), (1e-6, 1e-9)):
        pressure = force / length ** (dim - 1)
        scales = Scales(height / length, E / pressure, dim, pieces)
        found.append(numbers(astuple(in_units(length, force, dim).nondimensionalize(scales))))
    assert found[0] == pytest.approx(found[1], rel=1e-12)
    assert found[0][1] == pytest.approx(3e-9 / height, rel=1e-12)
    F = E * height ** (dim - 1)
    # a spring that gives way by w under a force f still does
    stiffness, compliance = found[0][2:4]
    assert stiffness == pytest.approx(0.05 * pieces * height / F)
    assert compliance == pytest.approx(0.7 * F / (pieces * height))


def test_a_history_has_a_row_at_every_point() -> None:
    """A history has a row at every point, two at a jump, and its own times become points."""
    points = ((0.0, 0.5), (1.0, 0.5), (1.0, 0.2), (3.0, 0.0))
    history = Loading(history=points, times=(0.25, 2.0)).prescribed_history
    assert (
        history is not None
        and history.has_jumps
        and not history.has_reloading
        and history.duration == 3.0
    )
    rows = [(row.t, row.value, row.branch) for row in history.rows]
    assert [(t, value) for t, value, _ in rows if (t, value) in points] == list(points)
    assert [branch for t, _, branch in rows if t == 1.0] == ["hold", "retract"] and rows[-1] == (
        3.0,
        0.0,
        "retract",
    )
    through = history.with_row_times_inserted
    assert set(through.points) - set(points) == {(0.25, 0.5), (2.0, 0.1)} and not through.times
    assert through.nondimensionalize(0.1).largest_value == pytest.approx(5.0, rel=1e-15)
