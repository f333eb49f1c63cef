"""Pictures of the shipped studies, with their keys, names and units, and made-up numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from picture_checks import faults

from indent_sim.results.pictures import figures
from indent_sim.results.pictures.axes import axis_of_column
from indent_sim.results.pictures.forces import draw_force, draw_force_lines
from indent_sim.results.reader import Results
from indent_sim.studies import cases, curve_table, study_file, study_picture, study_table
from indent_sim.studies.cases import Case
from indent_sim.studies.reference.reference_solution import ReferenceSolution
from indent_sim.studies.study_file import StudyFile
from indent_sim.studies.study_table import Row

STUDIES = Path(__file__).resolve().parents[2] / "configs" / "studies"
QUICK = (
    "thin_gel",
    "side_by_side",
    "water_or_chains",
    "published",
)  # few runs, many, in time, of published values
SAMPLES, HOLD = 8, 6  # rows of a curve, and of those how many a history holds


# Of the rest one of each shape: two keys crossed, sizes of meshes, many methods, tips, units
OTHERS = (
    "asked_axi",
    "layer",
    "source_model",
    "cell_on_glass",
    "stiffness_mesh",
    "three_dimensions",
    "tips",
    "notes",
)


def study_of(path: Path) -> Any:
    return pytest.param(
        path, marks=[] if path.stem in QUICK else [pytest.mark.verify], id=path.stem
    )


def made_up(case: Case, random: np.random.Generator) -> Results:
    """Made-up results of a run.

    The force is of the expected size; it rises with depth, or falls while the tip stands.
    """
    scene = case.planned_run.scene
    deepest, force = case.last_depth or 1.0, float(scene.plan.prediction.get("force") or 1.0)
    share = np.linspace(1, SAMPLES, SAMPLES) / SAMPLES
    table: dict[str, Any] = {
        "delta": deepest * share,
        "force": force * share**1.5 * random.uniform(0.8, 1.2),
    }
    if scene.history_on_curve:
        table["t"] = np.linspace(0.0, 10.0, SAMPLES)
        table["branch"] = np.array(["approach"] * (SAMPLES - HOLD) + ["hold"] * HOLD)
        table["force"] = force * np.exp(-random.uniform(0.1, 1) * table["t"])
    known = {name: np.ones(SAMPLES) for name in ("a", "p_max", "penetration", "newton_iterations")}
    units = case.planned_run.config.units
    report = {
        "status": "done",
        "exit_code": 0,
        "dofs": int(random.integers(1000, 100000)),
        "units": {"length": units.length, "force": units.force},
        "plan": {
            "choices": [
                {"key": "kinematics", "value": scene.physics.domain.kinematics.name, "why": ""}
            ]
        },
        "cpu_timings": {"solve": float(random.uniform(0.1, 20.0))},
        "audit": {},
    }
    return Results(
        Path("runs") / case.name, {"step": np.arange(1.0, SAMPLES + 1)} | known | table, report
    )


def board_of(study: StudyFile, random: np.random.Generator) -> list[Row]:
    """A scoreboard whose values are off by up to 30 per cent."""
    rows = []
    for member in study.named_cases:
        if published := member.published:
            off = {
                "difference": random.uniform(-30, 30),
                "ours_difference": random.uniform(-0.3, 0.3),
            }
            said = {
                "case": member.name,
                "quantity": published.quantity,
                "within": published.claimed_error,
                "wrong": "nobody",
            }
            rows.append(
                said | off | {"exact": published.value, "our_error": 1e-3 * published.value}
            )
    return rows


@pytest.mark.parametrize(
    "path",
    [study_of(path) for path in sorted(STUDIES.glob("*/*.yaml")) if path.stem in QUICK + OTHERS],
)
def test_no_picture_of_a_shipped_study_has_a_fault(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With random costs and errors of 1e-5 to 1 no picture of a shipped study has a fault."""
    drawn: dict[str, list[str]] = {}

    def keep(figure: Any, path: Path) -> None:
        figures.apply_layout(figure)
        drawn[path.name] = faults(figure)

    monkeypatch.setattr(figures, "save", keep)
    random, study = np.random.default_rng(1), study_file.read(path)
    asked = found, _ = cases.resolve_cases(study)
    done = {case.id: made_up(case, random) for case in found}
    rows = study_table.rows(
        study, asked, done, ReferenceSolution(study, found), {case.id: case.name for case in found}
    )
    for row in rows:
        if row["status"] == "done":
            row["force_error_vs"] = float(10 ** random.uniform(-5, 0))
    study_picture.draw_cost(rows, study.keys, study.title, "theory", Path("study.png"))
    study_picture.draw_curves(
        curve_table.group_case_curves(found, study.keys, done), study.title, Path("curves.png")
    )
    study_picture.draw_scoreboard(board_of(study, random), study.title, Path("verification.png"))
    assert {"study.png", "curves.png"} <= set(drawn) and ("verification.png" in drawn) == bool(
        study.named_cases
    )
    assert {name: found for name, found in drawn.items() if found} == {}


@pytest.mark.parametrize("count", [1, 12])
def test_many_curves_are_drawn_as_few_are(count: int) -> None:
    """Curves drawn as one collection have the points, colours, dashes and limits of single lines.

    One run has two lines, loading and unloading, whose two styles matplotlib took for one.
    """
    random = np.random.default_rng(2)
    depth = np.array([0.2, 0.5, 1.0, 0.6, 0.1])
    runs = []
    for factor in random.uniform(1.0, 2.0, count):
        table = {"step": np.arange(1.0, 6.0), "delta": depth, "force": factor * depth**1.5}
        runs.append(Results(Path("run"), table, {"status": "done", "units": {}}))
    looks = [
        {"color": (0.1 * (i % 10), 0.0, 0.5, 1.0), "marker": "", "ls": "-"} for i in range(count)
    ]
    of_depth, of_force = axis_of_column("delta", runs), axis_of_column("force", runs)
    with figures.new_figure((6, 3)) as figure:
        few, many = figure.subplots(1, 2)
        for run, look in zip(runs, looks, strict=True):
            draw_force(few, run, of_depth, of_force, look, "_")
        draw_force_lines(many, runs, of_depth, of_force, looks)
        (lines,) = many.collections
        drawn = [line for line in few.lines if len(line.get_xdata())]
        assert len(lines.get_paths()) == len(drawn) == 2 * count
        for path, colour, line in zip(lines.get_paths(), lines.get_colors(), drawn, strict=True):
            np.testing.assert_array_equal(path.vertices, np.column_stack(line.get_data()))
            assert to_rgba(line.get_color()) == tuple(colour)
        dashed = [dashes is not None for _, dashes in lines.get_linestyles()]
        assert (
            dashed == [line.is_dashed() for line in drawn] and sum(dashed) == count
        )  # the way out
        np.testing.assert_allclose(
            [many.get_xlim(), many.get_ylim()], [few.get_xlim(), few.get_ylim()], rtol=1e-12
        )
