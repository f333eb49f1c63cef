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
    """Uniaxial strain: sigma_z is one, sigma_x = nu/(1-nu) sigma_z that of each layer, in all cells
    up to the face between the two. Linear displacements are exact; 1e-8 is what Newton's method
    leaves.
    """
    fields = written(GIVEN | {"body": body | LAYERS}, tmp_path / "run")
    cells = fields["cells"]
    stress = fields["nodal_stress"].reshape(-1, 3, 3)[cells]  # (cells, corners, 3, 3)
    stiff, soft = (E * (1 - nu) / (1 + nu) / (1 - 2 * nu) for E, nu in ((2.0, 0.2), (1.0, 0.3)))
    sigma = -0.01 / (0.4 / stiff + 0.6 / soft)
    is_upper = fields["points"][cells][..., 2].mean(axis=1) > -0.4
    side = np.where(is_upper, 0.2 / 0.8, 0.3 / 0.7)[:, None] * sigma
    for axis, expected in ((0, side), (1, side), (2, sigma)):
        everywhere = np.broadcast_to(expected, cells.shape)
        assert stress[..., axis, axis] == pytest.approx(everywhere, rel=1e-7)
    assert np.abs(stress[..., 0, 2]).max() < 1e-8 * abs(sigma)
    von_mises = np.broadcast_to(np.abs(sigma - side), cells.shape)
    assert fields["nodal_von_mises"][cells] == pytest.approx(von_mises, rel=1e-6)


def test_regions_have_points_of_their_own(tmp_path: Path) -> None:
    """ParaView interpolates in each cell between the values of its points: where regions meet there
    are two points at one place, with one displacement and the region's own stress. Without stress
    at the nodes there is one.
    """
    elastic = {"model": "linear_elastic", "E": 0.1, "nu": 0.3}
    ball = {"shape": "ball", "center": [0, 0, -0.5], "radius": 0.2, "material": elastic}
    given = GIVEN | {"body": COLUMN | {"inclusions": [ball]}}
    apart = written(given, tmp_path / "apart")
    joined = written(given | {"output": {"fields": "last", "plot": False}}, tmp_path / "joined")
    points = joined["points"]
    inside, outside = (np.unique(joined["cells"][joined["region"] == k]) for k in (1, 0))
    shared = np.intersect1d(inside, outside)
    # Points of the surface of the ball, which gmsh places to twelve digits
    assert np.hypot(points[shared, 0], points[shared, 2] + 0.5) == pytest.approx(0.2, abs=1e-9)
    assert (apart["points"][: len(points)] == points).all()
    assert (apart["points"][len(points) :] == points[shared]).all()
    assert (apart["points"][apart["cells"]] == points[joined["cells"]]).all()
    for name in ("displacement", "pressure"):
        assert (apart[name][apart["cells"]] == joined[name][joined["cells"]]).all()
    # The hoop strain of either side, by Hooke's law of its own, is that of the displacement. The
    # stresses of elements of a third of the ball's radius are good to a tenth of the largest.
    radius = apart["points"][:, 0]
    is_off_axis = radius[shared] > 0.05
    hoop_strain = apart["displacement"][shared, 0] / np.where(is_off_axis, radius[shared], 1.0)
    stress = apart["nodal_stress"].reshape(-1, 3, 3)
    for vertices, E in ((shared, 1.0), (np.arange(len(points), len(radius)), 0.1)):
        r, hoop, z = (stress[vertices, axis, axis] for axis in range(3))
        error = ((hoop - 0.3 * (r + z)) / E - hoop_strain)[is_off_axis]
        assert np.abs(error).max() < 0.1 * np.abs(hoop_strain[is_off_axis]).max()


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
