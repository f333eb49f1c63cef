"""Nodal stresses: exact where constant, and right up to interfaces and the surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError
from indent_sim.results.field_reader import read_fields
from indent_sim.run.pipeline import simulate
from indent_sim.scene.scene import resolve

COLUMN = {"shape": "cylinder", "radius": 0.5, "height": 1.0, "base": "roller", "sides": "roller"}
BLOCK = {"shape": "box", "size": [1.0, 1.0, 1.0], "base": "roller", "sides": "roller"}
STRIP = {"shape": "strip", "width": 1.0, "height": 1.0, "base": "roller", "sides": "roller"}
LAYERS = {
    "layers": [
        {"thickness": 0.4, "material": {"model": "linear_elastic", "E": 2.0, "nu": 0.2}},
        {"thickness": 0.6},
    ]
}
GIVEN: dict[str, Any] = {
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "plate"},
    "loading": {"delta": 0.01, "steps": 1},
    "mesh": {"h_contact": 0.15, "h_far": 0.2},
    "output": {"nodal_stress": True, "fields": "last", "plot": False},
}


def written(given: dict[str, Any], folder: Path) -> dict[str, np.ndarray]:
    """Fields of the last row of a run."""
    outcome = simulate(config_from_mapping(given), directory=folder)
    return read_fields(folder, outcome.states[-1].step)


@pytest.mark.parametrize("body", [COLUMN, BLOCK, STRIP], ids=["axisymmetric", "box", "strip"])
def test_layers_in_a_confined_column_have_one_stress_each(
    body: dict[str, Any], tmp_path: Path
) -> None:
    """Layers of a confined column have uniform nodal stresses up to their interface.

    sigma_z is one, and sigma_x = nu/(1-nu) sigma_z of each layer; nodes of the interface have that
    of the upper one. 1e-8 is what Newton's method leaves.
    """
    fields = written(GIVEN | {"body": body | LAYERS}, tmp_path / "run")
    stress, z = fields["nodal_stress"].reshape(-1, 3, 3), fields["points"][:, 2]
    stiff, soft = (E * (1 - nu) / (1 + nu) / (1 - 2 * nu) for E, nu in ((2.0, 0.2), (1.0, 0.3)))
    sigma = -0.01 / (0.4 / stiff + 0.6 / soft)
    side = np.where(z > -0.4 - 1e-9, 0.2 / 0.8, 0.3 / 0.7) * sigma
    for axis, expected in ((0, side), (1, side), (2, sigma)):
        assert stress[:, axis, axis] == pytest.approx(np.broadcast_to(expected, len(z)), rel=1e-7)
    assert np.abs(stress[:, 0, 2]).max() < 1e-8 * abs(sigma)
    assert fields["nodal_von_mises"] == pytest.approx(np.abs(sigma - side), rel=1e-6)


def test_under_a_ball_the_nodes_have_the_pressure_of_the_surface(tmp_path: Path) -> None:
    """Under a ball sigma_z = -p at the nodes, to 2.5 % of the peak in the inner contact.

    The cells below are half an element away.
    """
    given = GIVEN | {
        "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "mesh": {"h_contact": 0.01, "h_far": 0.3},
    }
    fields = written(given, tmp_path / "run")
    is_inside = (fields["points"][:, 2] > -1e-12) & (np.hypot(*fields["points"][:, :2].T) < 0.07)
    pressure = fields["pressure"][is_inside]
    sigma = fields["nodal_stress"].reshape(-1, 3, 3)[is_inside, 2, 2]
    assert np.abs(sigma + pressure).max() < 0.025 * pressure.max()


def test_without_fields_it_is_refused() -> None:
    for given in (
        GIVEN | {"body": COLUMN, "output": {"nodal_stress": True, "fields": "none"}},
        {
            "body": {"shape": "half_space"},
            "material": GIVEN["material"],
            "indenter": {"shape": "sphere", "R": 1.0},
            "loading": GIVEN["loading"],
            "output": {"nodal_stress": True},
        },
    ):
        with pytest.raises(ConfigError, match="writes no fields") as raised:
            resolve(config_from_mapping(given))
        assert raised.value.key == "output.nodal_stress"
