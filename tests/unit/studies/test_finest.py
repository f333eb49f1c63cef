"""The finest run of a study, with which others are compared: unknowns first, then penetration."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from indent_sim.results.reader import Results
from indent_sim.studies import cases, study_file, study_table
from indent_sim.studies.reference.reference_solution import ReferenceSolution

STUDY = """\
base:
  body: {shape: cylinder, radius: 1.0, height: 1.0}
  material: {model: linear_elastic, E: 1.0, nu: 0.3}
  indenter: {shape: paraboloid, R: 1.0}
  loading: {delta: 0.01, steps: 1}
vary:
  contact:
    - {method: penalty, epsilon_n: 10}
    - {method: penalty, epsilon_n: 1000}
    - {method: active_set}
  mesh.h_contact: [0.05, 0.04]
"""
PENETRATION = (1e-3, 1e-5, 1e-4)  # of the three laws, the softest first
FORCE = (0.9, 1.0, 1.1)


def results(number: int, dofs: int) -> Results:
    """Result of a contact law on a mesh with a number of unknowns."""
    names = {
        "step": 1.0,
        "delta": 0.01,
        "force": FORCE[number],
        "a": 0.1,
        "p_max": 0.1,
        "newton_iterations": 3.0,
    }
    table = {
        name: np.array([value])
        for name, value in (names | {"penetration": PENETRATION[number]}).items()
    }
    return Results(Path("run"), table, {"status": "done", "dofs": dofs})


def test_among_equal_meshes_the_least_penetration_is_the_reference(tmp_path: Path) -> None:
    """Among equal meshes the run with the least penetration is the reference.

    A soft penalty has the wrong force on every mesh.
    """
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    study = study_file.read(path)
    asked = cases.resolve_cases(study)
    truth = ReferenceSolution(study, asked[0])
    done = {
        case.id: results(number // 2, 2000 if number % 2 else 1000)
        for number, case in enumerate(asked[0])
    }
    rows = study_table.rows(
        study, asked, done, truth, {case.id: f"run {case.index}" for case in asked[0]}
    )
    assert {row["reference"] for row in rows} == {"run 3"}  # epsilon_n = 1000 on the finer mesh
    assert [row["force_error_vs"] for row in rows][3] == 0.0
    said = "contact={method: penalty, epsilon_n: 1000}, mesh.h_contact=0.04"
    assert truth.name == f"finest: {said}"
    assert truth.notes == (
        f"compared with the finest run, {said}: 2000 unknowns, penetration 1e-05 at its last row",
    )
    (known,) = study_table.read(study_table.write(rows[:1]))
    assert known["reference"] == "run 3"
