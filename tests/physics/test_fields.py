"""Fields of a run: what they say of the surface, of the energy and of the stress is what the tables say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from indent_sim.config.scene_file import loads
from indent_sim.results.reader import read
from indent_sim.results.xdmf import read_fields
from indent_sim.run.chain import simulate

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
    """At every vertex of the contact surface, to rounding: both are the same numbers at finite strain too, where the
    pressure of a facet ends in another value than that of the next."""
    found, fields = run
    surface = {name: column[found.surface["step"] == found["step"][-1]] for name, column in found.surface.items()}
    places = np.column_stack([surface[name] for name in "xyz"])
    near = np.linalg.norm(places[:, None] - fields["points"][None], axis=-1)
    nodes, vertices = np.nonzero(near < 1e-9)
    assert len(vertices) == (near.min(axis=0) < 1e-9).sum() > 10
    u = np.column_stack([surface[f"u_{axis}"] for axis in "xyz"])
    assert fields["displacement"][vertices] == pytest.approx(u[nodes], rel=1e-12, abs=1e-14)
    assert fields["pressure"][vertices] == pytest.approx(surface["pressure"][nodes], rel=1e-12)
    assert (fields["pressure"] > 0).sum() == (fields["pressure"][vertices] > 0).sum()


def test_the_energy_density_adds_up_to_the_energy(run):
    """By one point a cell, which is 4 % off on cells that are a third of the contact radius."""
    found, fields = run
    corners = fields["points"][fields["cells"]]
    if corners.shape[1] == 3:  # rings
        edges = (corners[:, 1:] - corners[:, :1])[:, :, [0, 2]]
        volumes = np.abs(np.linalg.det(edges)) / 2 * 2 * np.pi * corners[:, :, 0].mean(axis=1)
    else:
        volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6 * 4
    assert fields["energy_density"] @ volumes == pytest.approx(found["energy"][-1], rel=0.06)


def test_stresses_belong_together(run):
    """The invariants of the tensor are those of its principal values."""
    _, fields = run
    stress = fields["stress"].reshape(-1, 3, 3)
    principal = fields["principal_stresses"]
    assert (np.diff(principal, axis=1) <= 0).all()
    assert principal.sum(axis=1) == pytest.approx(np.trace(stress, axis1=1, axis2=2), abs=1e-12)
    assert principal.prod(axis=1) == pytest.approx(np.linalg.det(stress), abs=1e-10)
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    assert fields["von_mises"] == pytest.approx(np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))), rel=1e-9)
    assert (fields["J"] > 0).all() and (fields["energy_density"] >= -1e-6).all()
