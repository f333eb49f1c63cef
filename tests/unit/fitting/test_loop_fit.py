"""Fits of loops of a cone: intervals, refusals, one parameter, and the design of a loop.

Loops follow published formulas instead of runs; tests/physics/test_loop_fit.py has the runs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from loops_of_cones import KEYS, published_loop, recorded, solved_by_formula

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting import design
from indent_sim.fitting.curve_fit import FitRequest, fit_curve
from indent_sim.fitting.forward_model import cone_loop
from indent_sim.fitting.forward_model.cone_loop import HARDENING_KEY, Metal
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

SCENE: dict[str, Any] = {
    "units": {"length": "um", "force": "mN"},
    "body": {"shape": "half_space"},
    "material": {"model": "hencky", "E": 70, "nu": 0.3, "plasticity": {"yield_stress": 1.0}},
    "indenter": {"shape": "cone", "half_angle": 70.3},
    "loading": {"delta": 1.0, "steps": 20},
}


@pytest.fixture(autouse=True)
def _formula(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cone_loop, "solve_cone_loop", solved_by_formula)


def scene(
    E: float = 70.0, yield_stress: float = 1.0, n: float | None = None, **sections: Any
) -> Config:
    plasticity: dict[str, Any] = {"yield_stress": yield_stress}
    plasticity |= {} if n is None else {"hardening": {"n": n}}
    material = SCENE["material"] | {"E": E, "plasticity": plasticity}
    return config_from_mapping(SCENE | {"material": material} | sections)


def fitted(config: Config, keys: tuple[str, ...], metal: Metal, seed: int = 0, **how: Any) -> dict:
    curve = recorded(published_loop(metal), metal.E, np.random.default_rng(seed), **how)
    return fit_curve(curve, FitRequest(config, keys, "both"), ForwardModelCache()).entry


@pytest.mark.parametrize("metal", [Metal(100, 0.8, 0), Metal(210, 0.35, 0), Metal(72, 3.0, 0)])
def test_modulus_and_yield_stress_come_back(metal: Metal) -> None:
    """From a start that is wrong by up to a factor of seven, with noise of 0.3 %."""
    entry = fitted(scene(), KEYS, metal)
    assert entry["status"] == "done" and entry["explained"], entry
    for key, value in zip(KEYS, (metal.E, metal.yield_stress), strict=True):
        found = entry["parameters"][key]
        assert found["low"] < value < found["high"]
        assert found["high"] / found["low"] < 1.1
    assert entry["contact_point"]["value"] == pytest.approx(0.05, abs=2e-3)
    assert entry["hertz"] is None


@pytest.mark.parametrize("compliance", [1e-5, 4e-4])
def test_the_frame_of_an_instrument_is_a_spring(compliance: float) -> None:
    """Displacements of the base give the same constants as depths if the frame is in the scene.

    The frame takes 0.07 and 3 % of the depth at 70 mN, and in unloading 0.4 and 17 %.
    """
    metal = Metal(100.0, 1.0, 0.0)
    config = scene(experiment={"frame": {"compliance": compliance}})
    entry = fitted(config, KEYS, metal, compliance=compliance)
    assert entry["status"] == "done" and entry["explained"], entry
    for key, value in zip(KEYS, (metal.E, metal.yield_stress), strict=True):
        assert entry["parameters"][key]["low"] < value < entry["parameters"][key]["high"]
    assert entry["depth"] == pytest.approx(1.0, rel=5e-3)
    assert entry["contact_point"]["value"] == pytest.approx(0.05, abs=2e-3)


def test_a_run_refuses_the_frame() -> None:
    """The depth of the tip is prescribed; silently it would be taken for that of the base."""
    with pytest.raises(ConfigError, match="load curve of a linear body"):
        resolve(scene(experiment={"frame": {"compliance": 1e-5}}))
    with pytest.raises(ConfigError, match=r"experiment\.frequencies"):
        scene(experiment={"frequencies": [1.0]})


def test_the_design_with_a_frame() -> None:
    """A stiff frame changes no interval, and a known compliant one does not add information."""
    rigid, stiff, soft = (
        design.design_measurement(
            scene(100.0, 1.0, **({"experiment": {"frame": {"compliance": c}}} if c else {})),
            KEYS,
            0.003,
            800,
        ).parameters[KEYS[0]]
        for c in (0.0, 1e-7, 1e-2)
    )
    widths = [math.log(one.high / one.low) for one in (rigid, stiff, soft)]
    assert widths[1] == pytest.approx(widths[0], rel=1e-2)
    assert widths[2] > widths[0]


def test_the_intervals_of_noise_hold() -> None:
    """Of 40 draws 95 % are inside the statistical interval, three deviations below are 85 %."""
    metal = Metal(100.0, 0.8, 0.0)
    loop = published_loop(metal)
    request = FitRequest(scene(), KEYS, "both")
    tables = ForwardModelCache()
    inside = []
    for seed in range(40):
        curve = recorded(loop, metal.E, np.random.default_rng(seed))
        parameters = fit_curve(curve, request, tables).entry["parameters"]
        for key, value in zip(KEYS, (metal.E, metal.yield_stress), strict=True):
            low, high = parameters[key]["statistical"]
            # Interpolation between nodes of the formulas is a part of the stated interval only.
            inside.append(low * 0.9985 < value < high * 1.0015)
    assert np.mean(inside) > 0.85


def test_one_key_and_known_hardening() -> None:
    """A wrong modulus beside: the yield stress alone; and both, at a known exponent of 0.1."""
    alone = fitted(scene(E=100.0), KEYS[1:], Metal(100.0, 0.6, 0.0))
    assert alone["parameters"][KEYS[1]]["value"] == pytest.approx(0.6, rel=1e-2)
    hard = fitted(scene(n=0.1), KEYS, Metal(130.0, 0.9, 0.1))
    assert hard["parameters"][KEYS[0]]["value"] == pytest.approx(130.0, rel=2e-2)
    assert hard["parameters"][KEYS[1]]["value"] == pytest.approx(0.9, rel=2e-2)


def test_one_cone_does_not_tell_hardening() -> None:
    """The interval of yield_stress is many times wider than at a known exponent, which is said."""
    metal = Metal(100.0, 1.0, 0.2)
    known = fitted(scene(n=0.2), KEYS, metal)
    free = fitted(scene(n=0.2), (*KEYS, HARDENING_KEY), metal)
    assert free["status"] == "done"
    assert "One cone does not determine yield_stress and n separately" in free["words"]
    assert "does not determine" not in known["words"]
    assert free["tied"][KEYS[1]] > 5 * known["tied"][KEYS[1]]


def test_a_hold_and_many_samples() -> None:
    """The parts are found by the force: a hold without creep, and 5000 samples with noise."""
    metal = Metal(210.0, 0.35, 0.0)
    curve = recorded(published_loop(metal), metal.E, np.random.default_rng(4), points=3000)
    top = int(np.argmax(curve.delta))
    draw = np.random.default_rng(5)
    held = curve.force[top] + 0.003 * curve.force.max() * draw.standard_normal(500)
    longer = replace(
        curve,
        parts={},
        delta=np.insert(curve.delta, top + 1, np.full(500, curve.delta[top])),
        force=np.insert(curve.force, top + 1, held),
    )
    for one in (curve, longer):
        entry = fit_curve(one, FitRequest(scene(), KEYS, "both"), ForwardModelCache()).entry
        assert entry["status"] == "done" and entry["explained"], entry
        for key, value in zip(KEYS, (metal.E, metal.yield_stress), strict=True):
            assert entry["parameters"][key]["value"] == pytest.approx(value, rel=1e-2)


def test_what_is_refused() -> None:
    metal = Metal(100.0, 0.8, 0.0)
    curve = recorded(published_loop(metal), metal.E, np.random.default_rng(0))
    tables = ForwardModelCache()
    loading = FitRequest(scene(), KEYS, "approach")
    with pytest.raises(ConfigError, match="loading curve of a cone gives only one number"):
        fit_curve(curve, loading, tables)
    with pytest.raises(ConfigError, match="not a loop"):
        fit_curve(curve, FitRequest(scene(), KEYS, "all"), tables)
    with pytest.raises(ConfigError, match="is not determined by a loop"):
        fit_curve(curve, FitRequest(scene(), ("material.nu",), "both"), tables)
    one = fit_curve(curve, FitRequest(scene(E=100.0), KEYS[1:], "approach"), tables)
    assert one.entry["parameters"][KEYS[1]]["value"] == pytest.approx(0.8, rel=1e-2)
    sphere = config_from_mapping(SCENE | {"indenter": {"shape": "sphere", "R": 10.0}})
    with pytest.raises(ConfigError, match="needs a sharp cone"):
        fit_curve(curve, FitRequest(sphere, KEYS, "both"), tables)
    elastic = fitted(scene(), KEYS, Metal(100.0, 20.0, 0.0))
    assert elastic["status"] == "refused" and "is outside the range" in elastic["reason"]


def test_the_design_of_a_loop() -> None:
    """The predicted intervals are those of fits, and a second cone makes n known better.

    Both include the errors of the tables; the noise of five fits is known to 10 % on average.
    """
    planned = design.design_measurement(scene(100.0, 0.8), KEYS, 0.003, 800)
    loop = published_loop(Metal(100.0, 0.8, 0.0))
    tables = ForwardModelCache()
    request = FitRequest(scene(100.0, 0.8), KEYS, "both")
    fits = [
        fit_curve(
            recorded(loop, 100.0, np.random.default_rng(k), points=int(800 / 3 * 2)),
            request,
            tables,
        ).entry
        for k in range(5)
    ]
    for key in KEYS:
        wanted = math.log(planned.parameters[key].high / planned.parameters[key].low)
        found = [fit["parameters"][key] for fit in fits]
        widths = [math.log(one["high"] / one["low"]) for one in found]
        assert np.mean(widths) == pytest.approx(wanted, rel=0.1)
    hard = design.design_measurement(scene(100.0, 1.0, 0.1), (*KEYS, HARDENING_KEY), 0.003, 800)
    second = hard.helps[-1]
    assert second.change == {"and indenter.half_angle": 50.0}
    one, both = (result[HARDENING_KEY] for result in (hard.parameters, second.parameters))
    assert both.high - both.low < 0.9 * (one.high - one.low)
    assert hard.tied[HARDENING_KEY] > 5


def test_sensitivities_of_a_loop() -> None:
    """Errors of 1 % in C and in S give 0.8 % in E and 1.5 % in the yield stress.

    They follow from central differences of a published table of runs (Lu
    et al. 2020, PNAS 117, 7052), d(ln C, ln S)/d(ln E, ln
    yield_stress) = [[0.425, 0.575], [1.188, -0.188]] at E/yield_stress = 100 and n = 0.1. The
    formulas are fits to the same runs; a factor of 1.5 is accepted.
    """
    step = 0.01

    def logs(E: float, yield_stress: float) -> np.ndarray:
        loop = published_loop(Metal(E, yield_stress, 0.1))
        C = E * loop.curvature
        return np.log([C, C * loop.stiffness])

    by_E = (logs(100 * math.exp(step), 1) - logs(100 * math.exp(-step), 1)) / (2 * step)
    by_yield = (logs(100, math.exp(step)) - logs(100, math.exp(-step))) / (2 * step)
    inverse = np.linalg.inv(np.column_stack([by_E, by_yield]))
    sd_E, sd_yield = np.sqrt((0.01 * inverse**2 * 0.01).sum(axis=1))
    assert 0.008 / 1.5 < sd_E < 0.008 * 1.5
    assert 0.015 / 1.5 < sd_yield < 0.015 * 1.5
