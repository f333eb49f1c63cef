"""Fields of a run agree with its tables in surface, energy and stress."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from scenes import ELASTIC

from indent_sim.config.scene_file import config_from_mapping, loads
from indent_sim.results.field_reader import read_fields
from indent_sim.results.reader import read
from indent_sim.run.pipeline import simulate

SCENES = {
    "axisymmetric": """
body: {shape: cylinder, radius: 1.0, height: 1.0}
material: {model: neo_hookean, E: 1.0, nu: 0.4}
indenter: {shape: sphere, R: 0.5}
loading: {delta: 0.2, steps: 2}
mesh: {h_contact: 0.04, h_far: 0.1}
""",
    "mixed": """
body: {shape: cylinder, radius: 1.0, height: 1.0}
material: {model: neo_hookean, E: 1.0, nu: 0.499}
indenter: {shape: sphere, R: 0.5}
loading: {delta: 0.2, steps: 2}
mesh: {h_contact: 0.04, h_far: 0.1}
""",
    "quarter": """
body: {shape: box, size: [1.0, 1.0, 0.5]}
material: {model: neo_hookean, E: 1.0, nu: 0.3}
indenter: {shape: sphere, R: 0.5}
loading: {delta: 0.05, steps: 1}
mesh: {h_contact: 0.08, h_far: 0.2}
""",
}


@pytest.fixture(scope="module", params=SCENES)
def run(request, tmp_path_factory):
    folder: Path = tmp_path_factory.mktemp(request.param)
    simulate(loads(SCENES[request.param]), directory=folder / "out")
    found = read(folder / "out")
    return found, read_fields(folder / "out", int(found["step"][-1]))


def test_fields_and_surface_agree(run):
    """Fields and surface table agree at every vertex of the contact surface, to rounding.

    At finite strain, too, where the pressures of neighbouring facets differ at their common node.
    """
    found, fields = run
    surface = {
        name: column[found.surface["step"] == found["step"][-1]]
        for name, column in found.surface.items()
    }
    places = np.column_stack([surface[name] for name in "xyz"])
    near = np.linalg.norm(places[:, None] - fields["points"][None], axis=-1)
    nodes, vertices = np.nonzero(near < 1e-9)
    assert len(vertices) == (near.min(axis=0) < 1e-9).sum() > 10
    u = np.column_stack([surface[f"u_{axis}"] for axis in "xyz"])
    assert fields["displacement"][vertices] == pytest.approx(u[nodes], rel=1e-12, abs=1e-14)
    assert fields["pressure"][vertices] == pytest.approx(surface["pressure"][nodes], rel=1e-12)
    assert (fields["pressure"] > 0).sum() == (fields["pressure"][vertices] > 0).sum()


def test_the_energy_density_adds_up_to_the_energy(run):
    """The energy density integrates to the energy.

    One point per cell is 4 % off where cells are a third of the contact radius.
    """
    found, fields = run
    corners = fields["points"][fields["cells"]]
    if corners.shape[1] == 3:  # rings
        edges = (corners[:, 1:] - corners[:, :1])[:, :, [0, 2]]
        volumes = np.abs(np.linalg.det(edges)) / 2 * 2 * np.pi * corners[:, :, 0].mean(axis=1)
    else:
        volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6 * 4
    assert fields["energy_density"] @ volumes == pytest.approx(found["energy"][-1], rel=0.06)


def test_stresses_belong_together(run):
    """The invariants of the stress are those of its principal values."""
    _, fields = run
    stress = fields["stress"].reshape(-1, 3, 3)
    principal = fields["principal_stresses"]
    assert (np.diff(principal, axis=1) <= 0).all()
    assert principal.sum(axis=1) == pytest.approx(np.trace(stress, axis1=1, axis2=2), abs=1e-12)
    assert principal.prod(axis=1) == pytest.approx(np.linalg.det(stress), abs=1e-10)
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    assert fields["von_mises"] == pytest.approx(
        np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))), rel=1e-9
    )
    assert (fields["J"] > 0).all() and (fields["energy_density"] >= -1e-6).all()


GEL = """
body: {shape: cylinder, radius: 2.0, height: 1.0, base: roller, sides: free}
material: {model: gel, G: 1.0, n_omega: 1.0e-3, chi: 0.6, stretch: 1.4, flow: {diffusivity: 1.0}}
drainage: {bath: 0}
indenter: {shape: sphere, R: 1.0}
loading: {force_history: [[0, 0], [31050, 0]], times: [0, 31050], per_doubling: 2}
mesh: {h_contact: 0.25, h_far: 0.5}
output: {fields: all, plot: false}
"""

COLUMN = """
body:
  shape: strip
  width: 2.0
  height: 1.0
  sides: roller
  base: fixed
  layers:
    - thickness: 0.6
      material:
        {model: linear_elastic, E: 1.0, nu: 0.2,
         flow: {permeability: 0.9, alpha: 0.8, storage: 0.1}}
    - {thickness: 0.4, material: {model: linear_elastic, E: 3.0, nu: 0.2}}
drainage: {tip: drained, bath: [[0, 0], [0.2, 0.03]]}
indenter: {shape: flat_punch, radius: 1.0}
loading: {history: [[0, 0], [0.1, 0.02], [0.3, 0.02]]}
mesh: {h_contact: 0.2, h_far: 0.2}
output: {fields: all, plot: false}
"""


def test_a_gel_that_swells_freely_has_one_swelling_and_no_stress(tmp_path):
    """A freely swelling gel ends at its equilibrium stretch 1.5756615 without stress.

    At 1000 height^2/D_c, exp(-2000) is left; Newton's method stops at 1e-12 of the pressure of 8.8
    G.
    """
    simulate(loads(GEL), directory=tmp_path / "out")
    first, last = (read_fields(tmp_path / "out", step) for step in (1, 2))
    assert first["swelling"] == pytest.approx(1.4**3, rel=1e-9)
    assert last["swelling"] == pytest.approx(1.5756615**3, rel=1e-6)
    assert last["fluid_content"] == pytest.approx(
        last["J"] - 1, rel=1e-12
    )  # what swells it is solvent
    assert np.abs(last["stress"]).max() < 1e-6 and np.abs(last["pore_pressure"]).max() < 1e-6


def test_a_column_holds_the_fluid_that_has_not_left_and_bears_one_stress(tmp_path):
    """In a column with a rising bath the fluid content is the outflow, and the stress is uniform.

    Content and stress are linear in a cell, so that centroid values sum up exactly: to the outflow
    but for the seal's 1e-8, and by a virtual displacement to the force. Two cells per layer bear
    the same stress within 2 %.
    """
    simulate(loads(COLUMN), directory=tmp_path / "out")
    rows = read(tmp_path / "out")
    assert "swelling" not in read_fields(tmp_path / "out", 1)
    for step in map(int, rows["step"]):
        fields, row = read_fields(tmp_path / "out", step), rows["step"] == step
        corners = fields["points"][fields["cells"]]
        areas = np.abs(np.linalg.det((corners[:, 1:] - corners[:, :1])[:, :, [0, 2]])) / 2
        half = (
            1.0 / areas.sum()
        )  # the strip of height 1 is 2 wide: what is modelled is its half, or all
        held = 2 * half * fields["fluid_content"] @ areas
        largest = np.abs(rows["outflow"]).max()
        assert held == pytest.approx(-float(rows["outflow"][row][0]), abs=1e-7 * largest)
        borne = -float(rows["force"][row][0]) / 2
        assert fields["stress"][:, 8] @ areas / areas.sum() == pytest.approx(borne, abs=1e-9)
        assert fields["stress"][:, 8] == pytest.approx(
            borne, abs=2e-2 * np.abs(rows["force"]).max() / 2
        )
        assert not fields["fluid_content"][fields["region"] == 1].any()


def test_files_for_paraview_name_units_and_regions_and_have_depths_as_times(tmp_path: Path) -> None:
    """Files for ParaView name units and regions, and have depths as times.

    On a path that turns back the increments are the times, because depths occur twice.
    """
    layers = [{"thickness": 0.2, "material": ELASTIC | {"E": "2 kPa"}}, {"thickness": 0.8}]
    given: dict[str, Any] = {
        "units": {"length": "um", "force": "nN"},
        "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "layers": layers},
        "material": ELASTIC | {"E": "1 kPa"},
        "indenter": {"shape": "sphere", "R": 1.0},
        "mesh": {"h_contact": 0.1, "h_far": 0.5},
        "output": {"fields": "all", "plot": False},
    }
    found = {}
    for name, deltas in {"in": [0.01, 0.03], "back": [0.03, 0.01]}.items():
        simulate(
            config_from_mapping(given | {"loading": {"deltas": deltas}}), directory=tmp_path / name
        )
        found[name] = ElementTree.parse(tmp_path / name / "fields.xdmf").getroot()
        tip = ElementTree.parse(tmp_path / name / "tip.xdmf").getroot()
        assert [one.get("Value") for one in tip.iter("Time")] == [
            one.get("Value") for one in found[name].iter("Time")
        ]
    assert [float(one.get("Value", "")) for one in found["in"].iter("Time")] == [0.01, 0.03]
    assert [float(one.get("Value", "")) for one in found["back"].iter("Time")] == [1.0, 2.0]
    said = {
        one.get("Name"): one.get("Value") for one in found["in"].findall("./Domain/Information")
    }
    assert said == {
        "unit of length": "um",
        "unit of force": "nN",
        "region 0": "layers[0]",
        "region 1": "layers[1]",
    }
    regions = read_fields(tmp_path / "in", 1)["region"]
    assert set(regions) == {0, 1}
    # which counts as a state whatever stands in the collection
    with meshio.xdmf.TimeSeriesReader(tmp_path / "in" / "fields.xdmf") as reader:
        points, _ = reader.read_points_cells()
        times = [reader.read_data(k) for k in range(reader.num_steps)]
    assert [t for t, _, _ in times] == [0.01, 0.03] and times[1][1][
        "displacement"
    ].shape == points.shape
