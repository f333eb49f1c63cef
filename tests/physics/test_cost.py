"""What `plan` says a run costs, against what it does cost: within a factor of two, cells on every
shipped scene.

Seconds are those of a core on which the libraries below take 0.8 s to import, a busy or slower one
is measured by that.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import BOX, CYLINDER, ELASTIC, PARABOLOID, WALLED, grid_of, scene

from indent_sim.config.scene_file import load
from indent_sim.run.error_estimation.predicted_cost import (
    _expected_refinement_ratios as ratios_foreseen,
)
from indent_sim.run.error_estimation.predicted_cost import predict_total_cost
from indent_sim.run.pipeline import states
from indent_sim.scene.mesh_counts import mesh_counts as counts
from indent_sim.scene.scene import resolve

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted(path for path in (ROOT / "configs").rglob("*.yaml") if "studies" not in path.parts)


def meshed(path: Path) -> str:
    """An override by which a scene is meshed also where theory alone would do; a history on the
    elastic curve has no fields.
    """
    is_of_curve = resolve(load(path)).history_on_curve is not None
    return "solver.method=condensed" if is_of_curve else "output.fields=last"


WET = ELASTIC | {"nu": 0.2, "flow": {"diffusivity": 1.0}}

each_scene = pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
# One of each whose cost has constants of its own: condensed, in three dimensions, rubber, friction,
# fluid
KINDS = ("hertz", "hertz_cube", "gel", "thin_gel_stick", "draining_gel")
ONE_OF_A_KIND = [path for path in SCENES if path.stem in KINDS]


def assert_close(predicted: float, found: float) -> None:
    """A factor of two is what a user needs to know before starting a run."""
    assert found / 2 < predicted < 2 * found


@each_scene
def test_cells(path: Path) -> None:
    """The count that all other predictions come from; the mesh alone is quickly made."""
    scene = resolve(load(path, [meshed(path)]))
    assert_close(scene.plan.prediction["cells"], len(grid_of(scene).cells))


def test_counts_of_a_solid() -> None:
    """Cells, nodes and vertices of a box, of which unknowns are made: 5 % from 1000 cells on, here
    700.
    """
    base = scene(BOX, mesh={"h_contact": 0.1, "h_far": 0.3})
    grid, said = grid_of(base), counts(base.sizes, base.physics.domain)
    edges = np.unique(
        np.sort(grid.cells[:, list(combinations(range(4), 2))], axis=-1).reshape(-1, 2), axis=0
    )
    found = {
        "cells": len(grid.cells),
        "nodes": len(grid.points) + len(edges),
        "vertices": len(grid.points),
    }
    assert said == pytest.approx(found, rel=0.1)


def test_a_scene_turned_about_its_axis_costs_the_same() -> None:
    """A tip beside the middle of a box along x, and along y; the grid of the integrals turns with
    it.
    """
    along = [
        scene(
            BOX,
            indenter=PARABOLOID | {"center": center},
            mesh={"h_contact": 0.1, "symmetry": "full"},
        )
        for center in ([1.4, 1.0], [1.0, 1.4])
    ]
    one, other = (base.plan.prediction["cells"] for base in along)
    assert one == pytest.approx(other, rel=1e-3)  # rounded


def test_more_steps_take_longer() -> None:
    """Each one iterations of its own, also of a body that is factored once."""
    mesh = {"h_contact": 0.004, "h_far": 0.5}
    few, many = (scene(CYLINDER, loading={"delta": 0.1, "steps": n}, mesh=mesh) for n in (1, 100))
    assert many.plan.prediction["seconds"] > few.plan.prediction["seconds"] > 0


def test_steps_between_the_rows_of_a_history_are_counted() -> None:
    """The steps are the same, however many of them are rows."""
    history = {"history": [[0, 0], [0.1, 0.02], [1, 0.02]]}
    all_rows, one = (
        scene(WALLED, material=WET, loading=history | times) for times in ({}, {"times": [1]})
    )
    predicted = [base.plan.prediction["seconds"] for base in (all_rows, one)]
    assert len(all_rows.physics.deltas) > 20 and predicted[1] == pytest.approx(
        predicted[0], rel=0.05
    )


HOLD = {"history": [[0, 0], [0, 0.02], [0.01, 0.02]], "times": [0.01]}


def test_steps_under_a_tip_that_stands_still_are_counted_apart() -> None:
    """Two stages each, where nothing but time moves: their systems are solved once, with the last
    factor. A bath that comes makes the contact grow.
    """
    base, swelling = (
        scene(WALLED, material=WET, loading=HOLD, drainage={"bath": bath}) for bath in (0, 0.01)
    )
    one, other = (made.physics.solver_work("newton", "direct") for made in (base, swelling))
    assert (one.steps, other.holding_steps) == (
        2,
        0,
    ) and one.holding_steps == 2 * base.physics.path.hold_count > 20
    assert other.steps >= one.steps + one.holding_steps


def test_meshes_on_the_way_to_an_accuracy_of_a_body_that_drains() -> None:
    """The edge of what a ball seals lies within elements: a run of 0.002 took four meshes, a
    punch's took one. Where the pressure lives at vertices a ball's took two of 0.001.
    """
    ball = {"material": WET, "loading": HOLD, "accuracy": 0.002, "mesh": {}}
    punch = ball | {"indenter": {"shape": "flat_punch", "radius": 1.0}}
    sharp = ball | {"accuracy": 0.001, "contact": {"method": "active_set"}}
    found = [
        predict_total_cost(scene({"shape": "half_space"}, **one)) for one in (ball, punch, sharp)
    ]
    assert [len(ratios_foreseen(one)) for one in found] == [3, 0, 1]


def test_solves_of_a_tip_that_snaps_in_and_comes_off() -> None:
    """As many as are foreseen within a factor of two; without attraction there were four a row and
    ten more.
    """
    sticky = {"adhesion": {"work": 0.008, "range": 0.02}}  # Maugis' lambda 2.5
    way = {"deltas": [-0.2, 0.05, -0.2]}
    base = scene(CYLINDER, contact=sticky, loading=way, mesh={"h_contact": 0.05})
    rows = list(states(base))
    work = base.physics.solver_work(base.solver.method, base.solver.linear)
    assert_close(work.linear_solves, sum(row.newton_iterations for row in rows))


@pytest.mark.verify
@pytest.mark.parametrize("path", ONE_OF_A_KIND, ids=lambda path: path.stem)
def test_unknowns_memory_and_seconds(path: Path, tmp_path: Path) -> None:
    """Of a process of its own whose forms are compiled, the better of two runs: others may be
    working beside it.
    """
    plan = resolve(load(path, [meshed(path)])).plan.prediction
    report, seconds = measured(path, tmp_path / "run", "--set", meshed(path))
    assert_close(plan["dofs"], report["dofs"])
    assert_close(plan["memory_MB"], report["peak_memory_MB"])
    assert_close(plan["seconds"], seconds)


LIBRARIES = "numpy, scipy.special, matplotlib.figure, gmsh, dolfinx, petsc4py"
IMPORT_SECONDS = 0.8  # of the core that the constants of scene/cost.py are of


def processor_seconds(command: list[str]) -> float:
    """Of a process and its child processes, one thread each."""
    one_thread = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command, env=os.environ | one_thread, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0
    return float(usage.ru_utime + usage.ru_stime)


def slowness() -> float:
    """How many times as long as on that core things take here and now."""
    return processor_seconds([sys.executable, "-c", f"import {LIBRARIES}"]) / IMPORT_SECONDS


def measured(path: Path, folder: Path, *words: str) -> tuple[dict[str, Any], float]:
    """run.json of a run, and its processor seconds on that core."""
    command = [
        sys.executable,
        "-m",
        "indent_sim.cli.commands",
        "run",
        str(path),
        "--output",
        str(folder),
        *words,
        "--set",
        "output.plot=false",
    ]
    seconds = [processor_seconds(command) / slowness() for _ in range(2)]
    return json.loads((folder / "run.json").read_text()), min(seconds)


WITH_BARS = ("hertz", "hertz_cube")
ACCURATE = {"": "0.001", "contact.friction=0.3": "0.01"}


@pytest.mark.verify
@pytest.mark.parametrize("name", WITH_BARS)
def test_seconds_with_error_bars(name: str, tmp_path: Path) -> None:
    """The companions too."""
    path = next(path for path in SCENES if path.stem == name)
    _, seconds = measured(path, tmp_path / "run", "--error-bars")
    assert_close(predict_total_cost(resolve(load(path)), True).plan.prediction["seconds"], seconds)


@pytest.mark.verify
@pytest.mark.parametrize("change", ACCURATE)
def test_seconds_with_accuracy(change: str, tmp_path: Path) -> None:
    """The attempts and their companions."""
    path = ROOT / "configs" / "hertz.yaml"
    settings = [f"accuracy={ACCURATE[change]}", "mesh={}", *([change] if change else [])]
    _, seconds = measured(
        path, tmp_path / "run", *(word for one in settings for word in ("--set", one))
    )
    assert_close(
        predict_total_cost(resolve(load(path, settings))).plan.prediction["seconds"], seconds
    )


def test_a_sharp_punch_in_three_dimensions_takes_one_mesh() -> None:
    """Its bar holds what the elements at the edge cost, which is known beforehand, and the first
    mesh is chosen by it: elements that cost 1.65 % where 1 % was asked for led to a second one.
    """
    punch = {"shape": "flat_punch", "radius": 0.2}
    config = {
        "body": BOX | {"size": [2.0, 2.0, 1.0]},
        "indenter": punch,
        "accuracy": 0.01,
        "mesh": {},
    }
    assert (
        ratios_foreseen(scene(**config))
        == ratios_foreseen(scene(**config | {"accuracy": 0.05}))
        == []
    )
