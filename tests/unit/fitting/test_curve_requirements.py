"""The scene by which a curve is judged: its modulus, and its path from first contact on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from measurements import HALF_SPACE, drawn, measured, relaxing, scene

from indent_sim.fitting import curve_requirements
from indent_sim.fitting.curve_requirements import require_for_curve
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.inference.noise import WHITE

N = 300
X, T = np.linspace(-0.1, 0.1, N), np.linspace(3, 5, N)


@pytest.fixture
def curve(tmp_path):  # type: ignore[no-untyped-def]
    """Write a curve of a scene with E = 3."""

    def write(config):  # type: ignore[no-untyped-def]
        forces = ForwardModel(config, ["material.E"], 0.13)
        force = measured(
            forces, [math.log(3)], X, drawn(WHITE, N, np.random.default_rng(2)), t=T - T[0]
        )
        np.savetxt(
            tmp_path / "c.csv",
            np.column_stack([X, force, T]),
            delimiter=",",
            header="delta,force,t",
            comments="",
        )
        return tmp_path / "c.csv"

    return write


def asked(monkeypatch):  # type: ignore[no-untyped-def]
    """Scenes for which `require` is called; it returns nothing here."""
    scenes: list = []
    monkeypatch.setattr(curve_requirements, "require", lambda config, within: scenes.append(config))
    return scenes


def test_a_layer_taken_for_a_half_space_needs_its_thickness(curve, monkeypatch):
    scenes = asked(monkeypatch)
    found = require_for_curve(
        scene(HALF_SPACE), curve(scene({"shape": "layer", "height": 0.4})), 0.01
    )
    verdicts = {one["name"]: one["verdict"] for one in found.models}
    assert verdicts["thickness"] == "needed" and found.modulus.low < 3 < found.modulus.high
    (asked_of,) = scenes
    np.testing.assert_allclose(asked_of.material.E, found.modulus.value, rtol=1e-12)
    assert (
        asked_of.loading.delta == found.entry["depth"] and 0.06 < asked_of.loading.delta < 0.1
    )  # 0.087, of a wrong model


def test_a_history_is_the_way_of_the_approach(curve, monkeypatch):
    """The history of the judged scene begins at first contact and has the measured rate.

    First contact is at 0.013 on a ramp of 0.1 per second.
    """
    scenes, config = asked(monkeypatch), relaxing([[0.5, 0.6]], HALF_SPACE)
    require_for_curve(config, curve(config), 0.01)
    first, (t, delta) = scenes[0].loading.history
    assert (
        first == (0, 0)
        and delta == pytest.approx(0.087, abs=0.003)
        and t == pytest.approx(delta / 0.1, rel=0.02)
    )
