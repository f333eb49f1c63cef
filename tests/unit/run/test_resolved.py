"""The config that reproduces a run: what docs/results.md says stays `auto`, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mesh_files import section, write

from indent_sim.config.scene_file import config_from_mapping, to_mapping, to_yaml
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.json_text import to_json
from indent_sim.results.previous_run import previous_run
from indent_sim.run.explicit_config import automatic_keys, explicit_config
from indent_sim.scene.scene import resolve

SIZES = {"mesh.h_contact", "mesh.h_far", "mesh.grading", "mesh.symmetry"}
FILE = {
    "shape": "mesh",
    "file": "gel.msh",
    "kinematics": "axisymmetric",
    "surfaces": {"contact": "top", "base": "bottom"},
}
LEFT: dict[str, tuple[dict[str, Any], set[str]]] = {
    "frictionless": ({}, {"contact.epsilon_t"}),
    "friction": ({"contact": {"friction": 0.2}}, set()),
    "mesh file": ({"body": FILE}, {"contact.epsilon_t"} | SIZES),
    "theory": (
        {"body": {"shape": "half_space"}},
        {"material.formulation", "contact.method", "contact.epsilon_t", "solver.linear"} | SIZES,
    ),
}


@pytest.mark.parametrize("name", LEFT)
def test_what_stays_auto_is_what_the_scene_has_no_use_for(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "gel.msh", section())
    monkeypatch.chdir(tmp_path)
    sections, left = LEFT[name]
    config = config_from_mapping(
        {
            "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0},
            "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
            "indenter": {"shape": "paraboloid", "R": 1.0},
            "loading": {"delta": 0.01, "steps": 1},
        }
        | sections
    )
    assert set(_autos(to_mapping(explicit_config(config, resolve(config))))) == left


def _autos(document: dict[str, Any]) -> Iterator[str]:
    for name, part in document.items():
        if isinstance(part, dict):
            yield from (f"{name}.{key}" for key, value in part.items() if value == "auto")


PLAIN = {
    "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.01, "steps": 1},
}
LAYERS = {
    "layers": [
        {"thickness": 0.5, "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3}},
        {"thickness": 0.5, "material": {"model": "linear_elastic", "E": 2.0, "nu": 0.3}},
    ]
}
LAYERED = PLAIN | {"body": PLAIN["body"] | LAYERS, "material": None}
CHANGES = [
    "mesh.h_contact=0.02",
    "mesh.h_far=0.3",
    "material.nu=0.49",
    "material.E=3",
    "indenter.R=2",
    "body.radius=3",
    "contact.method=penalty",
    "contact.gap=current",
    "loading.delta=0.02",
    "solver.method=newton",
    "solver.rtol=1e-11",
    "indenter.center=[0.1, 0]",
    "output.fields=all",
]


@pytest.mark.parametrize("contact", ["auto", "penalty", "augmented_lagrangian"])
def test_a_resume_blames_the_key_that_was_changed(contact: str, tmp_path: Path) -> None:
    """A refused resume names the key that was changed, whatever else follows from it."""
    scenes = [
        (PLAIN, change)
        for change in CHANGES
        if contact == "auto" or change != "contact.method=penalty"
    ]
    scenes += [(LAYERED, "body.layers[1].material.nu=0.49"), (LAYERED, "mesh.h_contact=0.02")]
    (tmp_path / "force_indentation.csv").write_text("step\n1\n")
    for data, change in scenes:
        own = {name: part for name, part in data.items() if part} | {"contact": {"method": contact}}
        told = []
        for config in (config_from_mapping(own), config_from_mapping(own, [change])):
            decided = explicit_config(config, resolve(config))
            told.append(
                (
                    to_yaml(decided),
                    {"program": "indent-sim", "plan": {"auto": automatic_keys(config, decided)}},
                )
            )
        for (there, report), (here, ours) in (told, told[::-1]):
            (tmp_path / "config.yaml").write_text(there)
            (tmp_path / "run.json").write_text(to_json(report))
            with pytest.raises(ConfigError, match="another config") as caught:
                previous_run(tmp_path, here, ours)
            assert caught.value.key == change.split("=")[0], (change, caught.value)


@pytest.mark.parametrize("text", ["", "3\n", "[1, 2]\n", "experiment: 3\n", "[]\n"])
def test_a_damaged_config_is_another_one(text: str, tmp_path: Path) -> None:
    """The config.yaml of an earlier run may hold anything, also no mapping."""
    (tmp_path / "force_indentation.csv").write_text("step\n1\n")
    (tmp_path / "config.yaml").write_text(text)
    (tmp_path / "run.json").write_text(to_json({"program": "indent-sim"}))
    config = config_from_mapping({name: part for name, part in PLAIN.items() if part})
    with pytest.raises((ConfigError, UsageError)):
        previous_run(tmp_path, to_yaml(explicit_config(config, resolve(config))), {})
