"""An experiment without units: the same numbers whatever units the scene came in."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

import numpy as np
import pytest

from indent_sim.model.experiment import (
    Calibration,
    Cantilever,
    Experiment,
    Frame,
    JKRAdhesion,
    PowerLaw,
    Relaxation,
)
from indent_sim.model.units import Scales


def numbers(part: Any) -> list[float]:
    """All numbers in nested tuples."""
    if isinstance(part, tuple):
        return [number for one in part for number in numbers(one)]
    return [] if part is None else [float(part)]


def in_units(length: float, force: float, dim: int) -> Experiment:
    """One experiment in units of so many meters and newtons, in plane strain newtons per meter; times in seconds."""
    work = force / length if dim == 3 else force  # energy per area: pressure times length
    return Experiment(
        JKRAdhesion(2e-3 / work, 3e-9 / length),
        Relaxation(power_law=PowerLaw(0.2, 0.5)),
        ((0.0, 0.0), (1.0, 4e-6 / length)),
        ((0.0, 1e-9 / force), (2.0, 5e-9 / force)),
        Cantilever(0.05 / (force / length)),
        Frame(0.7 / (length / force)),
        (10.0, 20.0),
        Calibration(0.1, 0.05),
    )


@pytest.mark.parametrize(("dim", "pieces"), [(3, 1), (3, 2), (2, 1)])
def test_units_go_away(dim: int, pieces: int) -> None:
    """The unit of pressure follows from those of length and force."""
    height, E = 1e-5, 1e3  # [m], [Pa]
    found = []
    for length, force in ((1.0, 1.0), (1e-6, 1e-9)):
        pressure = force / length ** (dim - 1)
        scales = Scales(height / length, E / pressure, dim, pieces)
        found.append(numbers(astuple(in_units(length, force, dim).without_units(scales))))
    assert found[0] == pytest.approx(found[1], rel=1e-12)
    assert found[0][1:3] == pytest.approx([3e-9 / height, 0.2], rel=1e-12)
    ways, forces = found[0][4:8], found[0][8:12]
    F = E * height ** (dim - 1)
    assert np.allclose(ways, [0.0, 0.0, 1.0, 4e-6 / (pieces * height)], rtol=1e-12)
    assert np.allclose(forces, [0.0, 1e-9 / F, 2.0, 5e-9 / F], rtol=1e-12)
    # a spring that gives way by w under a force f still does
    stiffness, compliance = found[0][12:14]
    assert stiffness == pytest.approx(0.05 * pieces * height / F) and compliance == pytest.approx(
        0.7 * F / (pieces * height)
    )
