"""The row of a run that stands in the table of its study."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from indent_sim.results.reader import Results
from indent_sim.studies import cases, study_file, study_table
from indent_sim.studies.reference.reference_solution import ReferenceSolution

RAMPS = """
base:
  body: {shape: layer, height: 1.0}
  material: {model: linear_elastic, E: 1.0, nu: 0.3}
  indenter: {shape: paraboloid, R: 1.0}
vary:
  loading: [{history: [[0, 0], [1, 0.01], [2, 0.01], [3, 0]]}]
"""


def a_run(times: list[float] | None, force: list[float]) -> Results:
    """Result of five rows whose other numbers are 1 to 5 in every column."""
    names = ("step", "delta", "a", "p_max", "penetration", "newton_iterations")
    table = {name: np.arange(1.0, len(force) + 1) for name in names} | {"force": np.array(force)}
    table["force_error"] = 0.01 * table["step"]
    return Results(
        Path(), table | ({} if times is None else {"t": np.array(times)}), {"status": "done"}
    )


@pytest.mark.parametrize(
    ("times", "force", "told"),
    [
        (
            None,
            [1.0, 3.0, 2.0, 1.0, 0.5],
            5,
        ),  # a path without time: what it ends with was asked for
        ([0.5, 1.0, 2.0, 2.5, 3.0], [1.0, 3.0, 2.0, 1.0, 0.0], 2),
        (
            [0.5, 1.0, 2.0, 2.5, 3.0],
            [1.0, 2.0, 2.0 + 1e-12, 2.0, 0.0],
            2,
        ),  # one force, held to round-off
        (
            [0.5, 1.0, 2.0, 2.5, 3.0],
            [-1.0, -3.0, -2.0, -1.0, -0.5],
            5,
        ),  # it pulls all the way: the deepest
    ],
)
def test_a_history_is_told_by_its_largest_force(
    times: list[float] | None, force: list[float], told: int, tmp_path: Path
) -> None:
    """All numbers of a case, and its stated error, are those of one row.

    In a history it is the row of the largest force, without times the last one.
    """
    path = tmp_path / "study.yaml"
    path.write_text(RAMPS)
    study = study_file.read(path)
    asked = cases.resolve_cases(study)
    (case,) = asked[0]
    (row,) = study_table.rows(
        study, asked, {case.id: a_run(times, force)}, ReferenceSolution(study, [case]), {}
    )
    assert row["force"] == force[told - 1]
    assert [row[name] for name in ("a", "p_max", "penetration")] == [told] * 3
    assert row["stated_error"] == pytest.approx(
        0.01 * told / abs(force[told - 1]), rel=1e-12
    )  # round-off
    assert row["steps_done"] == 5
