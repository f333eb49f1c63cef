"""Optional results of a run may fail in any way: they are reported missing, and the rows stay."""

from __future__ import annotations

import csv
import json
import shutil
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import CYLINDER, ELASTIC, PARABOLOID

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe.postprocessing.fields import Fields
from indent_sim.model.kinematics import Axisymmetric
from indent_sim.process.errors import MeshError, NotConverged
from indent_sim.results.pictures import experiment as experiments
from indent_sim.results.pictures import forces
from indent_sim.results.reader import read
from indent_sim.run import (
    derived_quantities,
    history_on_curve,
    pipeline,
    single_run,
    summary,
    theory_comparison,
)
from indent_sim.theory.theory import Theory

# Every thing that stands beside the rows, by the words of its warning, and where it is found
OUTER: dict[str, tuple[Any, str]] = {
    "stiffness": (derived_quantities, "punches_of"),
    "area": (Axisymmetric, "contact_area"),
    "E_hertz": (derived_quantities, "hertz_forces"),
    "fields": (Fields, "gather"),
    "sanity check of the rows": (single_run, "violated_bound"),
    "theory": (summary, "theory_comparison"),
    "Hertz fit": (summary, "hertz_fit"),
    "experiment.csv": (history_on_curve, "evaluate_history"),
    "an auxiliary run of the error estimate": (pipeline, "states"),
    "no-slip effect": (pipeline, "solve_no_slip_effect"),
    "force_indentation.png": (forces, "draw_force_indentation"),
}
INNER: dict[str, tuple[Any, str]] = {
    "half-space formula": (theory_comparison, "half_space_force"),
    "film formulas": (Theory, "formula_value"),
    "experiment.png": (experiments, "draw"),
}
ERRORS = (
    np.linalg.LinAlgError,
    KeyError,
    MemoryError,
    NotConverged,
    ZeroDivisionError,
    MeshError,
    AssertionError,
    RecursionError,
    OSError,
    StopIteration,
    UnicodeError,
)
SCENE = {
    "body": CYLINDER,
    "material": ELASTIC,
    "indenter": PARABOLOID,
    "loading": {"deltas": [0.02, 0.03, 0.04]},
    "mesh": {"h_contact": 0.04},
    "experiment": {"adhesion": {"work": 1e-3}},
    "output": {"fields": "all"},
}


def rows(folder: Path) -> list[dict[str, str]]:
    """Force table without optional columns and seconds."""
    with open(folder / "force_indentation.csv", newline="", encoding="utf-8") as table:
        found = list(csv.DictReader(table))
    beside = ("stiffness", "area", "E_hertz", "wall_s", "force_error", "a_error", "p_max_error")
    return [{name: cell for name, cell in row.items() if name not in beside} for row in found]


def break_(monkeypatch: pytest.MonkeyPatch, things: dict[str, tuple[Any, str]], shift: int) -> None:
    """Let each of the functions fail with another exception."""
    kinds = cycle(ERRORS[shift:] + ERRORS[:shift])
    for (owner, name), kind in zip(things.values(), kinds, strict=False):

        def fail(*args: Any, kind: type[Exception] = kind, **options: Any) -> Any:
            raise kind("on purpose")

        monkeypatch.setattr(owner, name, fail)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run in which nothing fails."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    pipeline.simulate(config_from_mapping(SCENE), directory=folder)
    assert "missing" not in json.loads((folder / "run.json").read_text(encoding="utf-8"))
    return folder


@pytest.fixture(scope="module")
def whole(folder: Path) -> list[dict[str, str]]:
    """Rows of that run."""
    return rows(folder)


def test_an_error_bar_wider_than_its_force_is_drawn(folder: Path, tmp_path: Path) -> None:
    """An error bar wider than its force, whose lower end is tensile, is drawn."""
    copy = shutil.copytree(folder, tmp_path / "run")
    head, *lines = (copy / "force_indentation.csv").read_text(encoding="utf-8").splitlines()
    wide = [f"{head},force_error", *(f"{line},{10.0 * (k == 0)}" for k, line in enumerate(lines))]
    (copy / "force_indentation.csv").write_text("\n".join(wide) + "\n", encoding="utf-8")
    forces.draw_force_indentation(read(copy), copy / "again.png")
    assert (copy / "again.png").exists()


@pytest.mark.parametrize("things", [OUTER, INNER], ids=["outer", "inner"])
def test_what_fails_beside_the_rows_is_missing_and_the_rows_stay(
    things: dict[str, tuple[Any, str]],
    whole: list[dict[str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def break_inner(*row: Any) -> None:
        # After the first row, as the plan of a scene uses film formulas too.
        break_(monkeypatch, INNER, len(whole))

    if things is OUTER:
        break_(monkeypatch, OUTER, len(whole))
    outcome = pipeline.simulate(
        config_from_mapping(SCENE),
        directory=tmp_path / "run",
        error_bars=things is OUTER,
        progress=None if things is OUTER else break_inner,
    )
    assert rows(tmp_path / "run") == whole
    report = json.loads((tmp_path / "run" / "run.json").read_text(encoding="utf-8"))
    assert (report["status"], report["exit_code"]) == ("done", 0)
    for what in things:
        assert any(said.startswith(f"{what} is missing: ") for said in report["warnings"]), what
        assert any(
            said.startswith(f"{what} is missing: ") for said in outcome.report["warnings"]
        ), what
        assert "on purpose" in report["missing"][what]


def test_a_signal_beside_the_rows_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A KeyboardInterrupt in an optional result ends the run."""

    def interrupt(*args: Any) -> float:
        raise KeyboardInterrupt

    monkeypatch.setattr(derived_quantities, "punches_of", interrupt)
    with pytest.raises(KeyboardInterrupt):
        pipeline.simulate(config_from_mapping(SCENE), directory=tmp_path / "run")
