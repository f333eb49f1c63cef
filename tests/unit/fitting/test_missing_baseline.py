"""Curves that begin in contact, or with a toe: a known baseline, which is said."""

from __future__ import annotations

import numpy as np
import pytest
from measurements import HALF_SPACE, N, drawn, scene

from indent_sim.fitting.curve_fit import FitRequest, fit_curve
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.inference.estimate import OriginOptions
from indent_sim.fitting.inference.noise import Noise
from indent_sim.results.measured.measurement import MeasuredCurve, curve_parts

CONFIG = scene(HALF_SPACE, nu=0.5, depth=0.1)
TABLES = ForwardModelCache()
OFFSET = 0.7  # of the column of depths


def fitted(  # type: ignore[no-untyped-def]
    depth: np.ndarray, force: np.ndarray, noise: np.ndarray, origin: OriginOptions | None = None
):
    """Return the entry of a curve with one per cent of noise, and its words about the baseline."""
    force = force + 0.01 * force.max() * noise
    curve = MeasuredCurve("c", force, depth + OFFSET, parts=curve_parts(depth))
    request = FitRequest(CONFIG, ("material.E",), origin=origin or OriginOptions())
    entry = fit_curve(curve, request, TABLES).entry
    said = [line for line in entry["warnings"] if "baseline" in line]
    return entry, " ".join(said)


def hertz(depth: np.ndarray) -> np.ndarray:
    """Force of E = 1, nu = 0.5, R = 1."""
    return 4 / 3 / 0.75 * np.maximum(depth, 0.0) ** 1.5


def white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(N)


def holds(entry, modulus: float = 1.0) -> bool:  # type: ignore[no-untyped-def]
    """Whether an interval of 95 %, made wider by half, contains the modulus: 3 of a thousand
    do not."""
    stated = entry["parameters"]["material.E"]
    value = stated["value"]
    return bool(1.5 * (stated["low"] - value) < modulus - value < 1.5 * (stated["high"] - value))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("begin", [-0.003, 0.0, 0.015, 0.03])
def test_a_curve_that_begins_in_contact(begin, seed):
    depth = np.linspace(begin, 0.1, N)
    entry, said = fitted(depth, hertz(depth), white(seed))
    assert "no baseline: the curve begins in contact" in said
    assert holds(entry)
    # With a free baseline the half-widths are 5 to 50 %, and the values off by a factor of two.
    stated = entry["parameters"]["material.E"]
    assert stated["high"] / stated["low"] < 1.05
    assert entry["baseline"] == {"force": 0.0, "slope": 0.0}


def test_another_zero_is_not_taken_for_0():
    depth = np.linspace(0.015, 0.1, N)
    force = hertz(depth)
    level = 0.2 * force.max()
    entry, said = fitted(depth, force + level, white(0))
    assert "The level and the slope" not in said
    entry, _ = fitted(depth, force + level, white(0), OriginOptions(None, False, level))
    assert holds(entry)
    assert entry["baseline"]["force"] == pytest.approx(level)


@pytest.mark.parametrize("noise", [Noise(), Noise(10.0, 0.0003), Noise(30.0, 0.0003)])
@pytest.mark.parametrize("tilt", [0.0, 0.2, -0.2])
def test_a_baseline_is_not_taken_for_a_toe(tilt, noise):
    depth = np.linspace(-0.1, 0.1, N)
    force = hertz(depth)
    slope = tilt * force.max() * depth / depth.max()
    for seed in range(3):
        _, said = fitted(depth, force + slope, drawn(noise, N, np.random.default_rng(seed)))
        assert said == ""


@pytest.mark.parametrize("seed", range(3))
def test_a_toe_is_left_out(seed):
    """A force that rises gradually, and above the toe is that of a smooth body.

    The tolerance is what is left of the toe at 30 % of the force.
    """
    depth = np.linspace(-0.06, 0.1, N)
    width = 0.012
    reached = width * np.log1p(np.exp(depth / width))
    entry, said = fitted(depth, hertz(reached), 0.1 * white(seed))
    assert "a toe" in said
    assert entry["parameters"]["material.E"]["value"] == pytest.approx(1.0, rel=0.01)
    assert holds(entry)
