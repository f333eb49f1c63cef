"""Runs with `accuracy` and with error bars: the columns, the budget, refinement and its limits.

A run that is resumed has the same bars as one that was not stopped.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from indent_sim.config.scene_file import config_from_mapping, load
from indent_sim.process.errors import ConfigError, VerificationError
from indent_sim.results.reader import read
from indent_sim.run import pipeline, single_run
from indent_sim.scene import measured_constants, resolution
from indent_sim.scene.scene import resolve

SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.01, "steps": 5},
    "output": {"fields": "none", "surface": "last", "plot": False},
}


def simulate(
    folder: Path, error_bars: bool = False, resume: bool = False, **sections: Any
) -> pipeline.Outcome:
    return pipeline.simulate(
        config_from_mapping(SCENE | sections),
        directory=folder,
        error_bars=error_bars,
        resume=resume,
    )


def test_error_bars_are_a_column_and_a_budget(tmp_path: Path) -> None:
    simulate(
        tmp_path / "run",
        error_bars=True,
        contact={"method": "penalty"},
        body={"shape": "half_space"},
    )
    found = read(tmp_path / "run")
    parts = found.report["error_budget"]
    assert [part["step"] for part in parts] == list(found["step"])
    sums = [part["discretisation"] + part["enforcement"] + part["truncation"] for part in parts]
    assert found["force_error"] == pytest.approx(sums, rel=1e-12)
    assert all(
        part[name] > 0 for part in parts for name in ("discretisation", "enforcement", "truncation")
    )


def test_without_being_asked_nothing_is_estimated(tmp_path: Path) -> None:
    outcome = simulate(tmp_path / "run")
    assert "force_error" not in read(tmp_path / "run").table
    assert "error_budget" not in outcome.report and "companions" not in outcome.report["timings"]


def test_the_written_config_gives_the_same_run_without_accuracy(tmp_path: Path) -> None:
    """The resolved config.yaml of a run with `accuracy` repeats its forces without `accuracy`.

    This holds for a punch, whose edge has an element size of its own, and for a path whose first
    contact is small.
    """
    for tip in ({"shape": "flat_punch", "radius": 0.3}, {"shape": "paraboloid", "R": 1.0}):
        first = simulate(tmp_path / tip["shape"], indenter=tip, accuracy=0.01)
        written = load(tmp_path / tip["shape"] / "config.yaml")
        assert written.accuracy is None
        again = pipeline.simulate(written, directory=tmp_path / f"{tip['shape']} again")
        assert [state.force for state in again.states] == [state.force for state in first.states]


def test_the_mesh_is_refined_until_the_bars_are_narrow_enough(
    tmp_path: Path, monkeypatch: Any, caplog: Any
) -> None:
    """A first mesh that is too coarse is noticed by the estimate, and refined until the bars fit.

    The error constant is patched to promise too much, so that the first mesh is too coarse.
    """
    monkeypatch.setitem(measured_constants.ERROR_CONSTANT, 2, 0.02)
    caplog.set_level("INFO", logger="indent_sim")
    outcome = simulate(tmp_path / "run", accuracy=0.001)
    first = resolution.required_elements(0.001, 2)
    assert "refining" in caplog.text and outcome.report["accuracy"]["elements"] > 1.2 * first
    found = read(tmp_path / "run")
    assert np.all(found["force_error"] <= 0.001 * found["force"]) and len(found) == 5
    assert found.report["status"] == "done"


def test_what_no_mesh_can_mend_ends_with_exit_code_6_and_the_rows(tmp_path: Path) -> None:
    """A penalty too soft for the accuracy on any mesh ends with exit code 6, and the rows are kept.

    Its forces are 1 % low whatever the mesh; the message names epsilon_n as the cause.
    """
    with pytest.raises(VerificationError, match="epsilon_n alone causes") as caught:
        simulate(
            tmp_path / "run", accuracy=0.001, contact={"method": "penalty", "epsilon_n": 1000.0}
        )
    assert caught.value.exit_code == 6
    found = read(tmp_path / "run")
    assert len(found) == 5 and found.report["status"] == "failed" and found.report["exit_code"] == 6
    assert "accuracy not reached" in found.report["reason"] and "step 1" in found.report["reason"]


def test_a_machine_that_is_too_small_ends_the_refinement(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr("indent_sim.run.error_estimation.refinement.MAX_LEVELS", 1)
    monkeypatch.setitem(measured_constants.ERROR_CONSTANT, 2, 0.02)
    with pytest.raises(VerificationError, match="no more than 1 meshes are tried"):
        simulate(tmp_path / "run", accuracy=0.001)
    assert len(read(tmp_path / "run")) == 5


class Stop(Exception):
    """Raised by a progress function to stop a run."""


@pytest.mark.parametrize("sections", [{"accuracy": 0.01}, {}], ids=["accuracy", "error bars"])
def test_a_resumed_run_has_the_same_rows_and_bars(tmp_path: Path, sections: dict[str, Any]) -> None:
    def stop(state: Any, step: int, total: int) -> None:
        if step == 3:
            raise Stop

    bars = not sections
    whole = simulate(tmp_path / "whole", error_bars=bars, **sections)
    config = config_from_mapping(SCENE | sections)
    with pytest.raises(Stop):
        pipeline.simulate(config, directory=tmp_path / "run", error_bars=bars, progress=stop)
    assert len(read(tmp_path / "run")) == 3
    resumed = simulate(tmp_path / "run", resume=True, error_bars=bars, **sections)
    assert resumed.resumed_after == 3
    for name in ("force", "force_error"):
        assert [getattr(s, name) for s in resumed.states] == pytest.approx(
            [getattr(s, name) for s in whole.states]
        )
    assert len(resumed.report["error_budget"]) == 5


@pytest.mark.parametrize(
    ("contact", "rows"),
    [
        pytest.param({}, 8, id="second"),
        pytest.param({"method": "penalty"}, 13, id="third, penalty", marks=pytest.mark.verify),
    ],
)
def test_a_later_attempt_that_is_resumed_has_the_same_bars(
    tmp_path: Path, monkeypatch: Any, contact: dict[str, Any], rows: int
) -> None:
    """A run resumed in a later attempt of refinement has the bars of the run that was not stopped.

    A bar compares an attempt with those before it, which another process computed. Every attempt
    has five rows, and there are at least two before the last. Forces agree to about 1e-12, hence
    their differences to 1e-6.
    """
    monkeypatch.setitem(measured_constants.ERROR_CONSTANT, 2, 0.02)
    monkeypatch.setattr(
        "indent_sim.run.error_estimation.refinement.MAX_REFINEMENT", 1.3
    )  # in small steps
    monkeypatch.setattr("indent_sim.run.error_estimation.refinement.MAX_LEVELS", 9)
    told: list[int] = []

    def stop(state: Any, step: int, total: int) -> None:
        told.append(step)
        if len(told) == rows:
            raise Stop

    sections = {"accuracy": 0.001} | ({"contact": contact} if contact else {})
    whole = simulate(tmp_path / "whole", **sections)
    assert len(whole.report["accuracy"]["tried"]) >= 2
    with pytest.raises(Stop):
        pipeline.simulate(
            config_from_mapping(SCENE | sections), directory=tmp_path / "run", progress=stop
        )
    resumed = simulate(tmp_path / "run", resume=True, **sections)
    tried, same = (outcome.report["accuracy"]["tried"] for outcome in (resumed, whole))
    assert tried == pytest.approx(same, rel=1e-6)
    assert read(tmp_path / "run")["force_error"] == pytest.approx(
        read(tmp_path / "whole")["force_error"], rel=1e-6
    )
    for here, there in zip(
        resumed.report["error_budget"], whole.report["error_budget"], strict=True
    ):
        assert here.discretisation == pytest.approx(there.discretisation, rel=1e-6)
        assert here.enforcement == pytest.approx(there.enforcement, rel=1e-6)


def test_bars_cannot_be_added_to_rows_that_have_none(tmp_path: Path) -> None:
    simulate(tmp_path / "run")
    with pytest.raises(ConfigError, match="without error bars"):
        simulate(tmp_path / "run", resume=True, error_bars=True)


def test_a_finished_run_of_another_accuracy_is_not_resumed(tmp_path: Path) -> None:
    simulate(tmp_path / "run", accuracy=0.01)
    assert simulate(tmp_path / "run", accuracy=0.01, resume=True).resumed_after == 5
    with pytest.raises(ConfigError, match=r"accuracy 0\.01"):
        simulate(tmp_path / "run", accuracy=0.001, resume=True)


def test_accuracy_of_a_hyperelastic_body(tmp_path: Path) -> None:
    """With `accuracy: 0.01` the forces of a neo-Hookean layer are within 1 % of a reference.

    The reference is a sphere of R = 1 on a layer with nu = 0.3 and W = 2, with the gap at the
    deformed point, computed with mixed elements of order 6 whose edges follow the contact; it is
    good to 1e-6. One row may lie outside its bar.
    """
    exact = {0.05: 0.0208384, 0.1: 0.0659038, 0.2: 0.219368}
    outcome = simulate(
        tmp_path / "run",
        accuracy=0.01,
        material={"model": "neo_hookean", "E": 1.0, "nu": 0.3},
        indenter={"shape": "sphere", "R": 1.0},
        loading={"deltas": list(exact)},
    )
    bars = np.array([state.force_error for state in outcome.states])
    forces = np.array(list(exact.values()))
    errors = np.abs([state.force for state in outcome.states] - forces)
    assert np.all(errors <= 0.01 * forces) and np.all(bars <= 0.01 * forces)
    assert np.sum(errors > bars) <= 1


def test_accuracy_under_prescribed_forces(tmp_path: Path) -> None:
    """Under prescribed forces the bar holds the force of exact layer theory at the row's depth."""
    outcome = simulate(tmp_path / "run", accuracy=0.01, loading={"force": 1.6e-3, "steps": 4})
    theory = resolve(config_from_mapping(SCENE)).plan.theory
    assert theory is not None
    for state in outcome.states:
        solution = theory.solution_at_depth(state.delta)
        assert solution is not None and state.force_error is not None
        assert abs(state.force - solution.force) <= state.force_error <= 0.01 * state.force


def test_a_lifted_tip_has_no_error(tmp_path: Path) -> None:
    outcome = simulate(tmp_path / "run", accuracy=0.01, loading={"deltas": [0.004, -0.001, 0.01]})
    bars = [state.force_error for state in outcome.states]
    assert bars[1] == 0 and all(bar is not None and math.isfinite(bar) for bar in bars)


def test_a_step_without_force_to_speak_of_is_said_not_to_be_judged(tmp_path: Path) -> None:
    """A step whose force is negligible may have a wide bar, and a warning names it.

    The step at 2e-5 of the depth has 1e-7 of the force, and a fifth of the elements in its contact.
    """
    loading = {"deltas": [2e-7, 1e-3, 0.01]}
    outcome = simulate(tmp_path / "run", accuracy=0.01, loading=loading)
    shallow, *others = outcome.states
    assert (
        all(state.force_error <= 0.01 * state.force for state in others)
        and shallow.force_error > 0.01 * shallow.force
    )
    (said,) = [text for text in outcome.report["warnings"] if "accuracy" in text]
    assert said.endswith("at steps 1") and "1e-06" in said
    assert not [
        text
        for text in simulate(tmp_path / "other", accuracy=0.01).report["warnings"]
        if "accuracy" in text
    ]


def test_loading_the_libraries_is_no_cost_of_the_companions(
    tmp_path: Path, monkeypatch: Any
) -> None:
    import time

    load = single_run.backend
    loaded: list[float] = []

    def slow() -> Any:
        if not loaded:
            time.sleep(0.5)
            loaded.append(time.perf_counter())
        return load()

    monkeypatch.setattr(pipeline, "backend", slow)
    timings = simulate(tmp_path / "run", error_bars=True).report["timings"]
    assert timings["imports"] >= 0.5


def test_plan_says_what_accuracy_chose(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from indent_sim.cli import commands

    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(SCENE | {"accuracy": "balanced"}))
    result = CliRunner().invoke(commands.program, ["plan", str(tmp_path / "scene.yaml"), "--json"])
    choices = {choice["key"]: choice for choice in json.loads(result.stdout)["choices"]}
    assert (
        choices["accuracy"]["value"] == 0.01
        and "elements in the contact radius" in choices["accuracy"]["why"]
    )
    assert "mesh.h_axis" in choices
