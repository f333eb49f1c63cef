"""Bodies that creep: a bar under a plate against an ordinary differential equation.

The Kirchhoff stress of a bar with free sides is tau = E (-ln lambda - alpha), and its plastic
strain grows by alpha' = rate (tau/sigma - 1)^(1/m).
"""

from __future__ import annotations

from math import log, pi
from typing import Any

import numpy as np
import pytest
from scenes import scene
from scipy.integrate import solve_ivp

from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.scene.scene import Scene

E = 100.0
RATE = 0.01
M = 0.2
CREEP = {"rate": RATE, "m": M}
# Ramp to a compression of 5 % in a unit of time, and a hold ten times as long.
RAMP_AND_HOLD = [[0.0, 0.0], [1.0, 0.05], [11.0, 0.05]]


def bar(loading: dict[str, Any], creep: dict[str, Any] | None = CREEP, **changes: Any) -> Scene:
    """Bar of height 1 and radius 0.5 on a roller, whose whole top is pressed."""
    material = {
        "model": "hencky",
        "E": E,
        "nu": 0.3,
        "plasticity": {"yield_stress": 1.0, "creep": creep},
    }
    body = {
        "shape": "cylinder",
        "radius": 0.5,
        "height": 1.0,
        "base": "roller",
        "sides": "free",
    }
    return scene(
        body,
        material=material | changes,
        indenter={"shape": "paraboloid", "R": 1e7},
        loading=loading,
        mesh={"h_contact": 0.5},
    )


def exact_plastic_strain(times: list[float]) -> list[float]:
    """alpha at times of RAMP_AND_HOLD, by an integration of the differential equation."""

    def rate(t: float, alpha: np.ndarray) -> list[float]:
        stress = E * (-log(1 - 0.05 * min(t, 1.0)) - alpha[0])
        return [RATE * max(stress - 1.0, 0.0) ** (1 / M)]

    path = solve_ivp(rate, (0.0, 11.0), [0.0], "LSODA", times, rtol=1e-9, atol=1e-12, max_step=0.02)
    return [float(alpha) for alpha in path.y[0]]


def errors(states: list[State]) -> np.ndarray:
    """Difference of the forces from the exact ones, relative to the largest."""
    alphas = exact_plastic_strain([state.t or 0.0 for state in states])
    exact = [
        E * (-log(1 - state.delta) - alpha) / (1 - state.delta) * pi / 4
        for state, alpha in zip(states, alphas, strict=True)
    ]
    return np.array([state.force for state in states] - np.array(exact)) / max(exact)


@pytest.mark.verify
def test_ramp_and_hold() -> None:
    """Backward Euler is of first order: the error halves with the steps, and is below 1 %."""
    coarse, fine = (
        errors(list(pipeline.states(bar({"history": RAMP_AND_HOLD, "per_doubling": steps}))))
        for steps in (4, 8)
    )
    assert abs(coarse).max() < 0.03
    # The last rows are the same time.
    assert fine[-1] / coarse[-1] == pytest.approx(0.5, abs=0.1)
    assert abs(coarse[-1]) < 0.005


def test_flow_at_a_constant_rate() -> None:
    """At a constant strain rate the flow stress tends to 1 + (strain rate/rate)^m.

    At finite strain the rate of strain grows, and the elastic strain follows with 0.3 % of it,
    which is m as much in the stress; errors of the increments have decayed to as little.
    """
    loading = {"history": [[0.0, 0.0], [1.0, 0.1]], "times": [1.0]}
    for model in ("hencky", "linear_elastic"):
        (state,) = pipeline.states(bar(loading, model=model))
        stretch = 0.9 if model == "hencky" else 1.0
        flow_stress = 1 + (0.1 / stretch / RATE) ** M
        assert state.force * stretch == pytest.approx(flow_stress * pi / 4, rel=1e-3)


def test_slow_loading_is_plasticity_without_creep() -> None:
    """Far below the reference rate the overstress is (0.1/1e9)^1 = 1e-10 of the yield stress."""
    loading = {"history": [[0.0, 0.0], [1.0, 0.1]], "times": [1.0], "per_doubling": 2}
    (state,) = pipeline.states(bar(loading, {"rate": 1e9, "m": 1.0}))
    assert state.force == pytest.approx(pi / 4 / 0.9, rel=1e-6)


def test_a_jump_is_elastic() -> None:
    """Nothing creeps in no time: tau = E ln(1/lambda)."""
    loading = {"history": [[0.0, 0.0], [0.0, 0.05], [1.0, 0.05]], "times": [0.0, 1.0]}
    first, last = pipeline.states(bar(loading))
    assert first.force == pytest.approx(-E * log(0.95) / 0.95 * pi / 4, rel=1e-4)
    assert last.force < 0.6 * first.force


def test_energies_balance() -> None:
    """Work = stored energy + dissipation, where the dissipation includes that of the overstress.

    Both sums are by trapezoids or backward Euler with 20 increments: 2 %.
    """
    states = list(pipeline.states(bar({"history": [[0.0, 0.0], [1.0, 0.05]]})))
    work = np.trapz([s.force for s in states], [s.delta for s in states])
    last = states[-1]
    assert last.energy + (last.plastic_dissipation or 0.0) == pytest.approx(work, rel=0.02)


@pytest.mark.parametrize("control", ["history", "force_history"])
def test_a_history_without_creep_is_its_path(control: str) -> None:
    """In, held and out: perfect plasticity at finite strain, then elastic unloading.

    The rows of a held load are the same; the stress falls on the way out by E d(ln lambda).
    """
    in_and_out = {
        "history": [[0.0, 0.0], [1.0, 0.05], [2.0, 0.05], [3.0, 0.045]],
        "force_history": [[0.0, 0.0], [1.0, 0.7], [2.0, 0.7], [3.0, 0.35]],
    }
    loading = {control: in_and_out[control], "times": [1.0, 2.0, 3.0]}
    loaded, held, unloaded = pipeline.states(bar(loading, None))
    assert held.force == pytest.approx(loaded.force, rel=1e-9)
    assert held.delta == pytest.approx(loaded.delta, rel=1e-9)
    if control == "history":
        assert loaded.force == pytest.approx(pi / 4 / 0.95, rel=1e-5)
    stress = [row.force * (1 - row.delta) / (pi / 4) for row in (held, unloaded)]
    recovered = log((1 - unloaded.delta) / (1 - held.delta))
    assert stress[0] - stress[1] == pytest.approx(E * recovered, rel=1e-5)


def test_creep_needs_time() -> None:
    with pytest.raises(Exception, match="needs a load path in time"):
        bar({"delta": 0.1})
