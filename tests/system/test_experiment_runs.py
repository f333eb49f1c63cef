"""Experiments through the command line: files, resumed runs, ranks, JSON and pictures."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import ran
from conftest import Mpirun

from indent_sim.config.scene_file import config_from_mapping, to_yaml

SCENE: dict[str, Any] = {
    "body": {"shape": "layer", "height": 1.0},
    "material": {
        "model": "linear_elastic",
        "E": 1.0,
        "nu": 0.3,
        "relaxation": {"prony": [[0.5, 1.0]]},
    },
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"history": [[0, 0], [1, 0.01], [2, 0.01], [3, 0]]},
    "experiment": {"frequencies": [1.0]},
}
SOLID = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
STICKY = {
    "experiment": {"adhesion": {"work": 1e-3}, "cantilever": {"stiffness": 0.1}},
    "loading": {"delta": 0.01},
}
STICKY |= {"material": SOLID}
TABLE = "force_indentation.csv"
OF_A_MESH = ("dolfinx", "basix", "ffcx", "petsc4py", "gmsh", "h5py", "mpi4py")


def written(folder: Path, **sections: Any) -> Path:
    path = folder / "scene.yaml"
    path.write_text(to_yaml(config_from_mapping(SCENE | sections)))
    return path


def rows(folder: Path, name: str = TABLE) -> list[dict[str, str]]:
    with open(folder / name, newline="") as stream:
        return list(csv.DictReader(stream))


def test_theory_does_it_without_a_library_of_a_mesh(tmp_path: Path) -> None:
    program = f"""
import sys
sys.modules.update(dict.fromkeys({OF_A_MESH!r}))  # importing any of these fails now
from indent_sim.cli.commands import program
program(sys.argv[1:], standalone_mode=False)
"""
    words = ["run", str(written(tmp_path)), "--output", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    table = rows(tmp_path / "out")
    assert (
        list(table[0])[:5] == ["step", "t", "delta", "force", "a"]
        and list(table[0])[-1] == "branch"
    )
    assert not {table[0][name] for name in ("p_max", "energy", "stiffness")} - {""}
    assert [row["step"] for row in table] == [str(k) for k in range(1, len(table) + 1)]
    assert (
        not (tmp_path / "out" / "experiment.csv").exists()
        and not (tmp_path / "out" / "surface.csv").exists()
    )
    assert {"0", "1", "2", "3"} <= {row["t"] for row in table}
    assert {row["branch"] for row in table} == {"approach", "hold", "retract"}
    assert list(rows(tmp_path / "out", "dynamic.csv")[0]) == ["frequency", "storage", "loss"]
    assert (tmp_path / "out" / "experiment.png").stat().st_size > 5000
    assert "history solved by quadrature" in done.stderr


def test_a_scene_without_an_experiment_loads_and_writes_nothing_of_it(tmp_path: Path) -> None:
    program = """
import sys
from indent_sim.cli.commands import program
program(sys.argv[1:], standalone_mode=False)
unused = ("indent_sim.run.history_on_curve",)
assert not [name for name in sys.modules if name in unused]
"""
    config = tmp_path / "scene.yaml"
    given = {name: part for name, part in SCENE.items() if name != "experiment"} | {
        "material": SOLID
    }
    config.write_text(
        to_yaml(
            config_from_mapping(given | {"loading": {"delta": 0.01}, "output": {"plot": False}})
        )
    )
    words = ["run", str(config), "--output", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "out").glob("experiment*"))
    assert "experiment" not in json.loads((tmp_path / "out" / "run.json").read_text())


@pytest.mark.parametrize("method", ["theory", "condensed"])
def test_a_history_that_was_stopped_is_resumed(tmp_path: Path, method: str) -> None:
    """A resumed history repeats every number but the seconds; a finished one stays as it is."""
    config, out = written(tmp_path, solver={"method": method}), tmp_path / "out"
    ran("run", config, "--output", out)
    whole, report = rows(out), json.loads((out / "run.json").read_text())
    ran("run", config, "--output", out, "--resume")
    assert rows(out) == whole
    lines = (out / TABLE).read_text().splitlines(keepends=True)
    (out / TABLE).write_text("".join(lines[:100]))
    (out / "run.json").write_text(
        json.dumps(report | {"status": "running", "exit_code": None, "rows": 99})
    )
    ran("run", config, "--output", out, "--resume")
    again = rows(out)
    assert [row | {"wall_s": ""} for row in again] == [row | {"wall_s": ""} for row in whole]
    assert json.loads((out / "run.json").read_text())["status"] == "done"


RESUMED: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "rough": (
        {"contact": {"friction": 0.2}, "loading": {"history": [[0, 0], [1, 0.02], [2, 0.01]]}},
        ("force", "a", "stick_radius", "dissipation"),
    ),
    "draining": (
        {
            "material": SOLID | {"flow": {"permeability": 1e-3}},
            "loading": {"force_history": [[0, 0], [1, 3e-3], [2, 0]]},
        },
        ("delta", "a", "outflow", "pore_pressure_max"),
    ),
    "relaxing": (
        {
            "material": SOLID | {"relaxation": {"prony": [[0.5, 1.0]], "of": "shear"}},
            "loading": {"history": [[0, 0], [1, 0.02], [2, 0.01]]},
        },
        ("force", "a"),
    ),
}


@pytest.mark.parametrize("name", RESUMED)
def test_a_history_of_a_body_that_remembers_is_resumed(tmp_path: Path, name: str) -> None:
    """A resumed history of a body with a memory has the rows and files of one run to 1e-9.

    Without its checkpoint the path is solved again, with its turns.
    """
    sections, columns = RESUMED[name]
    body = {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"}
    given: dict[str, Any] = {"body": body, "material": SOLID} | sections
    given |= {"loading": given["loading"] | {"times": [0.5, 1.5, 2.0]}}
    config, out = tmp_path / "scene.yaml", tmp_path / "out"
    scene = {
        "indenter": SCENE["indenter"],
        "mesh": {"h_contact": 0.04},
        "output": {"plot": False},
    } | given
    config.write_text(to_yaml(config_from_mapping(scene)))
    ran("run", config, "--output", out)
    whole, report = rows(out), json.loads((out / "run.json").read_text())
    assert report["time"]["way"] == "steps"
    assert [row["branch"] for row in whole] == ["approach", "retract", "retract"] and (
        out / "surface.csv"
    ).exists()
    lines = (out / TABLE).read_text().splitlines(keepends=True)
    (out / TABLE).write_text("".join(lines[:3]))
    (out / "run.json").write_text(
        json.dumps(report | {"status": "running", "exit_code": None, "rows": 2})
    )
    ran("run", config, "--output", out, "--resume")
    for one, other in zip(rows(out), whole, strict=True):
        for column in columns:
            assert float(one[column]) == pytest.approx(float(other[column]), rel=1e-9, abs=1e-12)


def test_a_run_killed_before_its_experiment_is_resumed(tmp_path: Path) -> None:
    """--resume computes a missing experiment of a run whose rows are all there, to the last digit.

    The status of such a run is `running`.
    """
    config, out = written(tmp_path, **STICKY), tmp_path / "out"
    ran("run", config, "--output", out)
    whole, report = (
        (out / "experiment.csv").read_bytes(),
        json.loads((out / "run.json").read_text()),
    )
    (out / "experiment.csv").unlink()
    said = json.loads(
        ran("run", config, "--output", out, "--resume", "--json")
    )  # finished: it stays as it is
    assert any("experiment.csv" in warning for warning in said["report"]["warnings"])
    (out / "run.json").write_text(json.dumps(report | {"status": "running", "exit_code": None}))
    ran("run", config, "--output", out, "--resume")
    assert (out / "experiment.csv").read_bytes() == whole
    assert json.loads((out / "run.json").read_text())["status"] == "done"


def test_a_run_without_one_replaces_the_files_of_one(tmp_path: Path) -> None:
    out = tmp_path / "out"
    ran("run", written(tmp_path), "--output", out)
    ran("run", written(tmp_path, **STICKY), "--output", out, "--overwrite")
    assert not (out / "dynamic.csv").exists() and len(rows(out, "experiment.csv")) == 200
    held = json.loads((out / "run.json").read_text())["experiment"]
    assert (
        held["adhesion"]["pull_off"]["force_control"]["force"] < 0
        and held["cantilever"]["jump_out"]["z"] < 0
    )
    ran("run", written(tmp_path), "--output", out, "--overwrite")
    assert not (out / "experiment.csv").exists() and (out / "dynamic.csv").exists()


@pytest.mark.parametrize("method", ["theory", "condensed"])
def test_rows_at_the_times_asked_for(tmp_path: Path, method: str) -> None:
    """Rows at given times are those of the whole table, interpolated between its rows.

    In a ramp of half the modulus with tau = 1, a row at a jump is the state after it.
    """
    times = [0.25, 1.0, 1.37, 3.0]
    more = {"solver": {"method": method}, "output": {"plot": False}}
    ran("run", written(tmp_path, **more), "--output", tmp_path / "all")
    history = SCENE["loading"]["history"]
    ran(
        "run",
        written(tmp_path, loading={"history": history, "times": times}, **more),
        "--output",
        tmp_path / "some",
    )
    found = rows(tmp_path / "some")
    assert [float(row["t"]) for row in found] == times
    every = [[float(row[name]) for name in ("t", "force")] for row in rows(tmp_path / "all")]
    t, force = zip(*every, strict=True)
    for row in found:  # straight between rows 1/67 of a piece apart: 1e-4 of the largest force
        assert float(row["force"]) == pytest.approx(
            float(np.interp(float(row["t"]), t, force)), abs=1e-4 * max(force)
        )
    jump = {"history": [[0, 0], [1, 0.01], [1, 0.005], [2, 0.005]], "times": [1.0]}
    ran("run", written(tmp_path, loading=jump, **more), "--output", tmp_path / "jump")
    (after,) = rows(tmp_path / "jump")
    assert float(after["delta"]) == 0.005


@pytest.mark.parametrize("method", ["theory", "condensed"])
def test_error_bars_are_those_of_the_elastic_curve(tmp_path: Path, method: str) -> None:
    """The relative error bars of a history are those of the elastic run at the same depth."""
    more = {"solver": {"method": method}, "output": {"plot": False}}
    ran("run", written(tmp_path, **more), "--error-bars", "--output", tmp_path / "out")
    elastic = {"material": SOLID, "loading": {"delta": 0.01}, **more}
    config = tmp_path / "elastic.yaml"
    given = {name: part for name, part in SCENE.items() if name != "experiment"}
    config.write_text(to_yaml(config_from_mapping(given | elastic)))
    ran("run", config, "--error-bars", "--output", tmp_path / "elastic")
    last, held = (
        rows(tmp_path / "elastic")[-1],
        next(row for row in rows(tmp_path / "out") if row["t"] == "1"),
    )
    for name, of in (("force_error", "force"), ("a_error", "a")):
        shares = [float(row[name]) / float(row[of]) for row in (held, last)]
        assert shares[0] == pytest.approx(shares[1], rel=1e-9)


def test_a_folder_from_before_keys_moved_is_read(tmp_path: Path) -> None:
    """A folder of an older version is drawn and reported; --resume says where its keys are now.

    Its history is in experiment.csv.
    """
    out, config = tmp_path / "out", written(tmp_path, output={"plot": False})
    ran("run", config, "--output", out)
    table = rows(out)
    names = ("t", "z", "delta", "force", "a", "branch")
    lines = [
        ",".join(names),
        *(",".join(row.get(name, row["delta"]) for name in names) for row in table),
    ]
    (out / "experiment.csv").write_text("\n".join(lines) + "\n")
    kept = [name for name in table[0] if name not in ("t", "branch")]
    elastic = [
        ",".join(kept),
        *(",".join(row[name] or "0" for name in kept) for row in table[60:70]),
    ]
    steps = [line if k == 0 else f"{k}," + line.partition(",")[2] for k, line in enumerate(elastic)]
    (out / TABLE).write_text("\n".join(steps) + "\n")
    report = json.loads((out / "run.json").read_text())
    report.pop("time")
    (out / "run.json").write_text(json.dumps(report | {"rows": 10, "version": "0.1.0"}))
    text = (out / "config.yaml").read_text()
    old = text.replace("  relaxation: {prony: [[0.5, 1.0]], of: all}\n", "")
    assert old != text, text
    history = (
        "  history: [[0, 0], [1, 0.01], [2, 0.01], [3, 0]]\n  relaxation: {prony: [[0.5, 1.0]]}\n"
    )
    old = re.sub(r"loading:\n(  .*\n)+", "", old).replace(
        "experiment:\n", f"experiment:\n{history}"
    )
    (out / "config.yaml").write_text(old)
    ran("report", out)
    ran("plot", out, "--what", "force", "--output", tmp_path / "force.png")
    said = json.loads(ran("run", config, "--output", out, "--resume", "--json", code=3))
    assert "has moved" in said["error"]["message"]


def test_two_ranks_write_what_one_does(tmp_path: Path, mpirun: Mpirun) -> None:
    """Two ranks give the rows of one, to rounding.

    They share the partitioned mesh, so the compliance and the edge of contact are the same.
    """
    config = written(tmp_path, solver={"method": "condensed"}, output={"plot": False})
    ran("run", config, "--output", tmp_path / "one")
    mpirun(2, "-m", "indent_sim.cli.commands", "run", config, "--output", tmp_path / "two")
    for one, two in zip(rows(tmp_path / "one"), rows(tmp_path / "two"), strict=True):
        assert float(one["force"]) == pytest.approx(float(two["force"]), rel=1e-6, abs=1e-12)


def test_a_refused_experiment_leaves_nothing(tmp_path: Path) -> None:
    config = tmp_path / "scene.yaml"
    text = to_yaml(config_from_mapping(SCENE)).replace(
        "prony:", "power_law: {exponent: 0.2, time: 1.0}\n    prony:"
    )
    config.write_text(text)
    ran("run", config, "--output", tmp_path / "out", code=3)
    assert os.listdir(tmp_path) == ["scene.yaml"]
