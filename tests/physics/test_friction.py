"""Stick and Coulomb friction: exact solutions on a half-space, conservation of energy, and the traps of the method."""

from __future__ import annotations

from typing import Any

import pytest
from scenes import PARABOLOID, scene, solve

from indent_sim.fe.condensed import equilibrium
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError

# 200 contact radii thick and wide: the ratio of two forces is that of a half-space to 1e-4 of what it is beyond one
THICK = {"shape": "cylinder", "radius": 20.0, "height": 20.0, "base": "fixed", "sides": "roller"}
A = 0.1  # contact radius of the deepest frictionless contact


def grown(steps: int) -> dict[str, Any]:
    """Depths of a paraboloid whose contact radius grows by equal steps to A."""
    return {"deltas": [A**2 * (k / steps) ** 2 for k in range(1, steps + 1)]}


def rough(friction: float | str, nu: float, loading: dict[str, Any], tip: dict[str, Any] = PARABOLOID, **more: Any
          ) -> list[State]:  # fmt: skip
    """The states of a thick body under a tip, twenty elements in its contact radius."""
    sections = {"material": {"model": "linear_elastic", "E": 1.0, "nu": nu}, "mesh": {"h_contact": A / 20}} | more
    contact = {"method": "augmented_lagrangian", "friction": friction}
    return solve(scene(THICK, indenter=tip, contact=contact, loading=loading, **sections))


def ratio(friction: float | str, nu: float, steps: int = 10) -> float:
    """Force of a rough paraboloid over that of a smooth one at the depth of A."""
    return rough(friction, nu, grown(steps))[-1].force / rough(0.0, nu, grown(1))[-1].force


@pytest.mark.parametrize(("friction", "nu", "exact"), [("stick", 0.0, 1.052891), ("stick", 0.3, 1.016213),
                         (0.3, 0.3, 1.01446), (1.0, 0.3, 1.01620)])  # fmt: skip
def test_paraboloid_on_a_half_space(friction: float | str, nu: float, exact: float) -> None:
    """Superposed no-slip punches, and Coulomb punches by a ring boundary-element method; 6e-4 is the elements' share
    (5e-4 at nu = 0, where half as large ones give -5e-4), that of ten steps a third of it."""
    assert ratio(friction, nu) == pytest.approx(exact, abs=6e-4)


@pytest.mark.parametrize("friction", ["stick", 0.3, 0.5])
def test_condensed_is_newton(friction: float | str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One discrete problem, in and out again: Newton's tolerance alone differs, also where the candidates must grow."""
    path = {"deltas": [0.002, 0.006, 0.01, 0.007, 0.003, 0.0]}
    whole = rough(friction, 0.3, path, mesh={"h_contact": A / 8}, solver={"method": "newton"})
    monkeypatch.setattr(equilibrium, "MARGIN", -5.0)
    condensed = rough(friction, 0.3, path, mesh={"h_contact": A / 8}, solver={"method": "condensed"})
    for one, other in zip(condensed, whole, strict=True):
        assert one.force == pytest.approx(other.force, rel=1e-9, abs=1e-14)


def test_shear_is_held_on_the_axis() -> None:
    """Five steps on the mesh on which modes of tau that do no work there made the force 10.7 % too small."""
    assert ratio("stick", 0.3, steps=5) == pytest.approx(1.016213, abs=0.002)
    with pytest.raises(ConfigError):
        scene(THICK, contact={"method": "nitsche", "friction": 0.3})
