"""Constants that were measured with the program itself are measured again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe.measured_constants import OPEN_CONDUCTANCE_FACTOR
from indent_sim.fe.terms import contact_seal
from indent_sim.run.pipeline import condense, states
from indent_sim.scene.scene import resolve
from indent_sim.theory.measured_constants import (
    DRAINAGE_RAMP_FRACTIONS,
    DRAINAGE_STEP_FRACTIONS,
    DRAINAGE_TIMES,
)


@pytest.mark.parametrize("nu", (0.0, 0.3, 0.45, 0.5))
def test_radius_of_the_punch_that_a_mesh_represents(nu: float) -> None:
    """A punch on a half-space has the stiffness 2 E* a, which gives the radius that it has."""
    depth = 0.01
    scene = resolve(
        config_from_mapping(
            {
                "body": {"shape": "half_space"},
                "material": {"model": "linear_elastic", "E": 1.0, "nu": nu},
                "indenter": {"shape": "paraboloid", "R": 1.0},
                "loading": {"delta": depth, "steps": 2},
                "solver": {"method": "condensed"},
                "mesh": {"h_contact": 0.01},
            }
        )
    )
    equilibrium = condense(scene).equilibrium
    equilibrium.solve(depth / scene.physics.scales.depth)
    radii, stiffnesses, _ = equilibrium.punches()
    elements = np.diff(radii, prepend=0.0)
    error = stiffnesses / (2.0 * scene.physics.material.E_star) - radii
    # The shift of one formula for all nu is known to 0.004; single vertices scatter by 0.01.
    assert np.median(abs(error / elements)) < 0.006


def _draining_layer(tip: str, loading: dict[str, Any]) -> list[float]:
    """Return the forces of a paraboloid on a drained layer of a/h = 0.16 and nu = 0.2."""
    config = config_from_mapping(
        {
            "body": {
                "shape": "cylinder",
                "radius": 8.0,
                "height": 1.0,
                "base": "fixed",
                "sides": "roller",
            },
            "material": {
                "model": "linear_elastic",
                "E": 1.0,
                "nu": 0.2,
                "flow": {"diffusivity": 1.0},
            },
            "indenter": {"shape": "paraboloid", "R": 1.0},
            "drainage": {"surface": "drained", "tip": tip, "base": "sealed", "sides": "sealed"},
            "loading": loading,
        }
    )
    return [state.force for state in states(resolve(config), with_surface=False)]


@pytest.mark.verify
@pytest.mark.parametrize("tip", ("sealed", "drained"))
def test_fractions_of_the_force_while_a_layer_drains(tip: str) -> None:
    """The fractions after a step of the depth, and at the end of a ramp."""
    depth = 0.0256
    drained_radius = 0.168
    times = [tau * drained_radius**2 for tau in DRAINAGE_TIMES]
    end = 100.0 * times[-1]
    step = _draining_layer(
        tip, {"history": [[0, 0], [0, depth], [end, depth]], "times": [0.0, *times, end]}
    )
    undrained = step[0]
    drained = step[-1]
    # The contact radius that makes times dimensionless changes by 7 % while the layer drains, which
    # moves the fractions by up to 0.02. They are used to choose meshes, not for forces.
    fractions = (np.array(step[1:-1]) - drained) / (undrained - drained)
    np.testing.assert_allclose(fractions, DRAINAGE_STEP_FRACTIONS[tip], atol=0.02)
    for time, ramp_fraction in list(zip(times, DRAINAGE_RAMP_FRACTIONS[tip], strict=True))[1:3]:
        ramp = _draining_layer(tip, {"history": [[0, 0], [time, depth]], "times": [time]})
        assert (ramp[-1] - drained) / (undrained - drained) == pytest.approx(
            ramp_fraction, abs=0.02
        )


def test_conductance_of_a_drained_vertex(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundredth of the conductance changes the forces by less than 1e-7."""
    loading = {"history": [[0, 0], [0.01, 0.0256]], "times": [0.005, 0.01]}
    forces = _draining_layer("drained", loading)
    monkeypatch.setattr(contact_seal, "OPEN_CONDUCTANCE_FACTOR", OPEN_CONDUCTANCE_FACTOR / 100.0)
    softer = _draining_layer("drained", loading)
    # Newton's method ends at a relative residual of 1e-8 or so: the forces cannot agree better.
    np.testing.assert_allclose(softer, forces, rtol=1e-7)
    assert forces != softer
