"""The config that reproduces a run: what docs/conventions.md says stays `auto`, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mesh_files import section, write

from indent_sim.config.file import from_mapping, to_mapping
from indent_sim.run.resolved import resolved
from indent_sim.scene.scene import resolve

SIZES = {"mesh.h_contact", "mesh.h_far", "mesh.grading", "mesh.symmetry"}
FILE = {"shape": "mesh", "file": "gel.msh", "kinematics": "axisymmetric",
        "surfaces": {"contact": "top", "base": "bottom"}}  # fmt: skip
LEFT: dict[str, tuple[dict[str, Any], set[str]]] = {
    "frictionless": ({}, {"contact.epsilon_t"}),
    "friction": ({"contact": {"friction": 0.2}}, set()),
    "mesh file": ({"body": FILE}, {"contact.epsilon_t"} | SIZES),
    "theory": ({"body": {"shape": "half_space"}},
               {"material.formulation", "contact.method", "contact.epsilon_t", "solver.linear"} | SIZES),
}  # fmt: skip


@pytest.mark.parametrize("name", LEFT)
def test_what_stays_auto_is_what_the_scene_has_no_use_for(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "gel.msh", section())
    monkeypatch.chdir(tmp_path)
    sections, left = LEFT[name]
    config = from_mapping({
        "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"delta": 0.01, "steps": 1},
    } | sections)  # fmt: skip
    assert set(_autos(to_mapping(resolved(config, resolve(config))))) == left


def _autos(document: dict[str, Any]) -> Iterator[str]:
    for name, part in document.items():
        if isinstance(part, dict):
            yield from (f"{name}.{key}" for key, value in part.items() if value == "auto")
