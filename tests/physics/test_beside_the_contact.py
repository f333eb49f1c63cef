"""A tip inside the surface next to the contact surface is found, and the row is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_files import block, section, write

from indent_sim.config.scene_file import load
from indent_sim.config.strict_yaml import dump
from indent_sim.run import pipeline
from indent_sim.run.previous_rows import PreviousRows
from indent_sim.run.sanity_checks import violated_bound
from indent_sim.scene.scene import resolve

SAID = "outside the contact surface, where no contact is modelled"
BODIES = {
    "axisymmetric": lambda: section(1.0, 0.5, 20, 10),
    "plane_strain": lambda: section(1.0, 0.5, 20, 10),
    "3d": lambda: block(1.2, 0.3, 8, 2),
}


def judged(
    folder: Path, kinematics: str, body: dict[str, Any], *overrides: str
) -> tuple[float, str]:
    """Force of a paraboloid at a depth of 0.05, and the reason why it cannot be right."""
    write(folder / "body.msh", body)
    mesh = {
        "shape": "mesh",
        "file": "body.msh",
        "kinematics": kinematics,
        "surfaces": {"contact": "top", "base": "bottom"},
        "sides": "free",
    }
    scene = {
        "body": mesh,
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"deltas": [0.05]},
    }
    (folder / "scene.yaml").write_text(dump(scene), encoding="utf-8")
    resolved = resolve(load(folder / "scene.yaml", overrides))
    (state,) = pipeline.states(resolved, with_surface=False)
    assert state.converged
    return state.force, violated_bound(resolved, state, PreviousRows()) or ""


def narrowed(body: dict[str, Any], to: float) -> dict[str, Any]:
    """Body with a contact group that ends at a distance from the tip's axis."""
    top = body["facets"]["top"]
    reach = np.abs(body["points"][top][..., :2] * (1.0, float(len(top[0]) == 3))).max(axis=(1, 2))
    body["facets"]["top"] = top[reach <= to + 1e-9]
    return body


@pytest.mark.parametrize(
    ("gap", "kinematics", "reach", "loss"),
    [
        ("reference", "axisymmetric", 0.15, 0.15),
        ("current", "axisymmetric", 0.15, 0.15),
        ("current", "plane_strain", 0.1, 0.05),
        ("reference", "3d", 0.15, 0.05),
        pytest.param("current", "3d", 0.15, 0.05, marks=pytest.mark.verify),
    ],
)
def test_a_contact_group_that_ends_beside_the_contact(
    tmp_path: Path, kinematics: str, reach: float, loss: float, gap: str
) -> None:
    """A contact group that ends inside the contact is found; its force is too small.

    The whole top, in contrast, gives a right row.
    """
    whole, nothing = judged(tmp_path, kinematics, BODIES[kinematics](), f"contact.gap={gap}")
    force, said = judged(
        tmp_path, kinematics, narrowed(BODIES[kinematics](), reach), f"contact.gap={gap}"
    )
    assert force < (1 - loss) * whole
    assert SAID in said and not nothing


def test_a_terrace_that_the_tip_runs_into(tmp_path: Path) -> None:
    """A free terrace next to the contact group, into which the tip runs, is found."""
    body = narrowed(section(1.0, 0.5, 20, 10), 0.3)
    x, z = body["points"][:, 0], body["points"][:, 1]
    body["points"][:, 1] = z + np.where(z > -0.01, np.clip(0.4 * (x - 0.3), 0.0, 0.1), 0.0)
    assert SAID in judged(tmp_path, "axisymmetric", body)[1]
    assert not judged(tmp_path, "axisymmetric", narrowed(section(1.0, 0.5, 20, 10), 0.3))[1]
