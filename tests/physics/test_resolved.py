"""The resolved config.yaml of a result leaves nothing open and reproduces the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from indent_sim.config.scene_file import config_from_mapping, load, to_mapping
from indent_sim.results.reader import read
from indent_sim.run.pipeline import simulate

ELASTIC = {"model": "linear_elastic", "E": 3.7, "nu": 0.3}
SOFT = {"model": "linear_elastic", "mu": 0.013, "nu": 0.495}
BALL = {"shape": "paraboloid", "R": 9.7}
LOADING = {"deltas": [0.05, 0.13, 0.02]}

SCENES: dict[str, dict[str, Any]] = {
    "axi": {"body": {"shape": "cylinder", "radius": 13.0, "height": 7.3}},
    "axi, mixed": {"body": {"shape": "cylinder", "radius": 13.0, "height": 7.3}, "material": SOFT},
    "strip": {
        "body": {"shape": "strip", "width": 21.0, "height": 7.3},
        "contact": {"method": "penalty"},
    },
    "strip, current": {
        "body": {"shape": "strip", "width": 21.0, "height": 7.3},
        "contact": {"gap": "current"},
    },
    "box": {"body": {"shape": "box", "size": [14.0, 13.0, 7.3]}, "mesh": {"h_contact": 0.7}},
    "box, half": {
        "body": {"shape": "box", "size": [14.0, 13.0, 7.3]},
        "indenter": BALL | {"center": [6.1, 6.5]},
        "contact": {"method": "active_set"},
        "mesh": {"h_contact": 0.9},
    },
    "half-space": {"body": {"shape": "half_space"}, "solver": {"method": "condensed"}},
    "layer": {"body": {"shape": "layer", "height": 7.3}, "solver": {"method": "newton"}},
    "off the axis": {
        "body": {"shape": "cylinder", "radius": 13.0, "height": 7.3},
        "indenter": BALL | {"center": [1.3, 0.4]},
        "mesh": {"h_contact": 2.0},
    },
    "hyperelastic": {
        "body": {"shape": "cylinder", "radius": 13.0, "height": 7.3},
        "material": {"model": "neo_hookean", "E": 3.7, "nu": 0.3},
        "indenter": {"shape": "cone", "half_angle": 70.0},
        "mesh": {"h_contact": 0.06},
    },
    "nitsche": {
        "body": {"shape": "cylinder", "radius": 13.0, "height": 7.3},
        "contact": {"method": "nitsche"},
        "mesh": {"h_contact": 0.3},
    },
}


def words(value: Any) -> set[Any]:
    """All strings in a config."""
    if isinstance(value, dict):
        return set().union(*map(words, value.values()))
    return {value} if isinstance(value, str) else set()


@pytest.mark.parametrize("name", SCENES)
def test_the_written_config_reproduces_the_run(tmp_path, name):
    given = {
        "material": ELASTIC,
        "indenter": BALL,
        "loading": LOADING,
        "output": {"plot": False},
    } | SCENES[name]
    simulate(config_from_mapping(given), MPI.COMM_SELF, directory=tmp_path / "A")
    config = load(tmp_path / "A" / "config.yaml")
    said = to_mapping(config)
    said["contact"].pop("epsilon_t", None)  # of friction, of which there is none
    assert "auto" not in words(said)
    simulate(config, MPI.COMM_SELF, directory=tmp_path / "B")
    A, B = read(tmp_path / "A"), read(tmp_path / "B")
    assert A.report["mesh"]["hash"] == B.report["mesh"]["hash"]
    for column in ("delta", "force", "a", "p_max", "energy"):
        # round-off alone; where contact ends is where a pressure is zero, which is known to fewer
        # digits than the force
        assert A[column] == pytest.approx(B[column], rel=1e-11, nan_ok=True), column
    assert (tmp_path / "B" / "config.yaml").read_text() == (
        tmp_path / "A" / "config.yaml"
    ).read_text()


def test_what_was_auto_stays_visible(tmp_path: Path):
    given = {
        "body": {"shape": "cylinder", "radius": 13.0, "height": 7.3},
        "material": ELASTIC,
        "indenter": BALL,
    }
    sections = {
        "loading": {"delta": 0.1, "steps": 1},
        "mesh": {"h_contact": 0.5},
        "output": {"plot": False},
    }
    simulate(config_from_mapping(given | sections), MPI.COMM_SELF, directory=tmp_path / "A")
    auto = json.loads((tmp_path / "A" / "run.json").read_text())["plan"]["auto"]
    assert {"contact.method", "contact.gap", "mesh.h_far", "mesh.symmetry", "solver.method"} <= set(
        auto
    )
    assert "mesh.h_contact" not in auto and "material.E" not in auto
