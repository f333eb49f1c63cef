"""Studies whose runs are rows: the same numbers as with folders, whatever interrupts them."""

from __future__ import annotations

import csv
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import environment
from conftest import ROOT

import indent_sim
from indent_sim import studies
from indent_sim.process.errors import ConfigError, NotConverged, UsageError
from indent_sim.results.memory_folder import MemoryFolder
from indent_sim.results.reader import read
from indent_sim.studies import row_worker, shard
from indent_sim.studies.row_file import RowFile, RowIndex

SCENE = {
    "title": "Bead on a film",
    "body": {"shape": "layer", "height": 10.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.45},
    "indenter": {"shape": "paraboloid", "R": 5.0},
    "loading": {"delta": 0.5, "steps": 3},
    "solver": {"method": "theory"},
}
VARY = {
    "material.E": {"from": 0.5, "to": 5, "spacing": "log"},
    "body.height": {"from": 4, "to": 40, "spacing": "log"},
    "loading.delta": {"from": 0.1, "to": 0.6},
}
STUDY = {
    "base": SCENE,
    "vary": VARY,
    "sample": {"count": 30, "seed": 1},
    "output": {"runs": "none"},
}
TIMES = ("wall_s", "memory_MB", "peak_memory_MB")  # and cpu_*


def rows_of(folder: Path) -> list[dict[str, str]]:
    """Rows of study.csv without what differs from one time to the next."""
    with open(folder / "study.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return [
        {k: v for k, v in row.items() if not k.startswith("cpu_") and k not in TIMES}
        for row in rows
    ]


def execute(study: dict, folder: Path, **options):
    return studies.execute_study(study, output=folder, **options)


def names_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def command(folder: Path, *words: str) -> list[str]:
    """Command of the study in `folder`, with its results in out."""
    program = [sys.executable, "-m", "indent_sim.cli.commands", "study", str(folder / "study.yaml")]
    return [*program, "--output", str(folder / "out"), *words]


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """The study of 30 rows without folders."""
    folder = tmp_path_factory.mktemp("rows") / "study"
    execute(STUDY, folder)
    return folder


def test_rows_are_those_of_runs_with_folders(finished, tmp_path):
    """Every column of the table and every curve is equal, to the last digit."""
    execute(STUDY | {"output": {"runs": "all"}}, tmp_path / "all")
    assert rows_of(finished) == rows_of(tmp_path / "all")
    assert (finished / "curves.csv").read_bytes() == (tmp_path / "all/curves.csv").read_bytes()
    assert len(list((tmp_path / "all/runs").iterdir())) == 30
    assert not list((finished / "runs").iterdir())


def test_few_files(finished):
    assert names_below(finished) <= {
        ".lock",
        "study.json",
        "study.csv",
        "curves.csv",
        "curves.png",
        "samples.png",
        "maps.png",
        "runs",
        "rows",
        "rows/1-of-1.h5",
        "rows/1-of-1.lock",
        "rows/gather.lock",
    }


def test_shards_and_gather(finished, tmp_path):
    for number in (1, 2, 3):
        execute(STUDY, tmp_path / "s", shard=(number, 3))
        if number == 2:
            execute(STUDY, tmp_path / "s", gather=True)
            counts = json.loads((tmp_path / "s/study.json").read_text())["counts"]
            assert (counts["done"], counts["pending"]) == (20, 10)
    execute(STUDY, tmp_path / "s", gather=True)
    assert rows_of(tmp_path / "s") == rows_of(finished)


def test_jobs_change_no_number(finished, tmp_path):
    execute(STUDY, tmp_path / "s", jobs=2)
    assert rows_of(tmp_path / "s") == rows_of(finished)


def test_more_points_keep_what_is_there(finished, tmp_path, monkeypatch):
    folder = tmp_path / "s"
    execute(STUDY, folder)
    lines: list[str] = []
    execute(
        STUDY | {"sample": {"count": 34, "seed": 1}, "title": "Other"},
        folder,
        resume=True,
        tell=lines.append,
    )
    assert "30 rows had been computed before" in lines and "4 rows computed" in lines
    assert rows_of(folder)[:30] == rows_of(finished)


def test_rows_are_found_by_their_physics(finished, tmp_path):
    """The same value, given by another key: nothing is computed again."""
    folder = tmp_path / "s"
    execute(STUDY, folder)
    row_count = len(RowIndex(folder / "rows"))
    same = STUDY | {"set": {"material.nu": 0.45}}
    execute(same, folder, resume=True)
    assert rows_of(folder) == rows_of(finished)
    index = RowIndex(folder / "rows")
    assert len(index) == 2 * row_count
    assert len(np.unique(index.physics)) == row_count


def test_a_run_of_interest_gets_its_folder(finished, tmp_path):
    folder = tmp_path / "s"
    execute(STUDY, folder)
    row = rows_of(folder)[7]
    for name in (row["run"], row["run"].rpartition("-")[2], "8"):
        run = studies.execute_run(STUDY, name, output=folder)
        assert run == folder / "runs" / row["run"]
        assert read(run)["force"][-1] == float(row["force"])
    for name in ("31", "0", "E=1-0123456789abcdef", "foo"):
        with pytest.raises(UsageError, match="has no run"):
            studies.execute_run(STUDY, name, output=folder)


def test_earlier_rows_are_not_lost(tmp_path):
    few = STUDY | {"sample": {"count": 3}}
    execute(few, tmp_path / "s")
    with pytest.raises(UsageError, match="--resume keeps them"):
        execute(few, tmp_path / "s")
    execute(STUDY | {"sample": {"count": 2, "seed": 9}}, tmp_path / "s", overwrite=True)
    assert len(RowIndex(tmp_path / "s/rows")) == 2


def test_impossible_scenes_are_rows_and_a_typing_error_is_refused(tmp_path):
    """Poisson's ratio above 0.5 is impossible; a key that does not exist ends at once."""
    vary = {"material.nu": {"from": 0.4, "to": 0.6}}
    study = STUDY | {"vary": vary, "sample": {"count": 16}}
    execute(study, tmp_path / "s")
    rows = rows_of(tmp_path / "s")
    impossible = [float(row["material.nu"]) > 0.5 for row in rows]
    assert [row["exit_code"] == "3" for row in rows] == impossible
    assert [row["force"] == "" for row in rows] == impossible
    assert all("nu" in row["reason"] for row in rows if row["exit_code"] == "3")
    with pytest.raises(ConfigError, match="nuu"):
        execute(STUDY | {"vary": {"material.nuu": {"from": 0.4, "to": 0.45}}}, tmp_path / "t")
    assert not (tmp_path / "t").exists()


def test_failed_runs_get_folders(tmp_path, monkeypatch):
    """With `failed` a run that fails is made again with its folder; with `none` it is not."""
    monkeypatch.setattr(shard, "compute_batch", fail_in_memory)
    for runs, folder_count in (("failed", 3), ("none", 0)):
        folder = tmp_path / runs
        study = STUDY | {"sample": {"count": 3}, "output": {"runs": runs}}
        with pytest.raises(NotConverged, match=r"no run .* has a result.*never"):
            execute(study, folder)
        assert [row["exit_code"] for row in rows_of(folder)] == ["5"] * 3
        assert len(list((folder / "runs").iterdir())) == folder_count


def fail_in_memory(batch):
    """Compute a batch whose runs fail, unless they have a folder."""

    def fail(config, scene, name):
        return MemoryFolder.failed(Path(name), NotConverged("never"))

    row_worker.pipeline.simulate_in_memory = fail
    return row_worker.compute_batch(batch)


def test_a_crash_ends_one_row_alone(tmp_path, monkeypatch):
    """A batch whose process crashes is computed row by row; the row that crashes is failed."""
    monkeypatch.setattr(shard, "compute_batch", crash_at_large_heights)
    study = STUDY | {"vary": {"body.height": {"from": 4, "to": 40}}, "sample": {"count": 12}}
    execute(study, tmp_path / "s")
    rows = rows_of(tmp_path / "s")
    heights = [float(row["body.height"]) for row in rows]
    assert [row["exit_code"] for row in rows] == ["139" if h > 30 else "0" for h in heights]
    assert any(height > 30 for height in heights)


def crash_at_large_heights(batch):
    """Compute a batch unless it has a height above 30."""
    for row in batch.rows:
        if dict((key, value) for key, value, _ in row.request.point)["body.height"] > 30:
            os.kill(os.getpid(), signal.SIGSEGV)
    return row_worker.compute_batch(batch)


def test_kills_at_random_moments(finished, tmp_path):
    """A shard that is killed again and again loses no row and computes none twice.

    `scripts/measure_rows.py kills` does it 200 times, and kills the worker, too.
    """
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(STUDY, sort_keys=False))
    path = tmp_path / "out/rows/1-of-1.h5"
    moments = random.Random(5)
    known: set[int] = set()
    for _ in range(6):
        process = subprocess.Popen(
            command(tmp_path, "--shard", "1/1"), env=environment(), stderr=subprocess.DEVNULL
        )
        while not path.exists() and process.poll() is None:
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 3.0))
        process.send_signal(signal.SIGKILL)
        process.wait()
        if path.exists():
            settings = RowFile(path).column("settings").tolist()
            assert known <= set(settings) and len(settings) == len(set(settings))
            known = set(settings)
    subprocess.run(command(tmp_path, "--resume"), env=environment(), check=True)
    settings = RowFile(path).column("settings").tolist()
    assert known <= set(settings) and len(settings) == len(set(settings)) == 30
    assert rows_of(tmp_path / "out") == rows_of(finished)


def test_the_job_file_of_the_page(finished, tmp_path):
    """The shortest job file for Slurm, as it is printed: two tasks of an array, then the table."""
    page = (ROOT / "docs" / "one_to_a_million.md").read_text()
    job = re.search(r"```bash\n(#!/bin/bash\n#SBATCH --array.*?)```", page, re.DOTALL)
    assert job is not None
    (tmp_path / "films.yaml").write_text(yaml.safe_dump(STUDY, sort_keys=False))
    (tmp_path / "job.sh").write_text(job.group(1))
    program = tmp_path / "indent-sim"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m indent_sim.cli.commands "$@"\n')
    program.chmod(0o755)
    variables = environment() | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    for task in ("1", "2"):
        slurm = {"SLURM_ARRAY_TASK_ID": task, "SLURM_ARRAY_TASK_COUNT": "2"}
        subprocess.run(["bash", "job.sh"], cwd=tmp_path, env=variables | slurm, check=True)
    gather = [str(program), "study", "films.yaml", "--gather"]
    subprocess.run(gather, cwd=tmp_path, env=variables, check=True)
    assert rows_of(tmp_path / "results/films") == rows_of(finished)


def test_surrogate_indices_report_and_plots(tmp_path):
    """A study of 150 rows by the commands: surrogate, Sobol indices, report of one page, plots."""
    study = STUDY | {"sample": {"count": 150, "seed": 2}}
    study["base"] = SCENE | {"units": {"length": "um", "force": "nN"}}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    folder = tmp_path / "out"

    def call(*words: str) -> str:
        program = [sys.executable, "-m", "indent_sim.cli.commands", *words]
        result = subprocess.run(
            program, env=environment(), check=True, capture_output=True, text=True
        )
        return result.stdout.strip()

    subprocess.run(command(tmp_path), env=environment(), check=True)
    words = ("study", str(tmp_path / "study.yaml"), "--output", str(folder))
    file = call(*words, "--surrogate", "force", "--within", "1e-2")
    surrogate = indent_sim.surrogate(file)
    keys = {"material.E": 1.7, "body.height": 9.0, "loading.delta": 0.33}
    (state,) = indent_sim.states(indent_sim.load(SCENE, keys | {"loading.steps": 1}))
    error = abs(float(surrogate(keys)) / state.force - 1)
    # One point: ten times the error that 95 % of the points have.
    assert error < 10 * surrogate.error["error"]
    shares = json.loads((folder / "study.json").read_text())["sobol"]
    assert sum(share["first"] for share in shares.values()) < 1.01
    assert all(share["total"] > share["first"] - share["error"] for share in shares.values())
    page = Path(call("report", str(folder)))
    assert page.stat().st_size < 3e6
    assert "Sobol indices" in page.read_text()
    for what in ("curves", "force", "a"):
        picture = Path(call("plot", str(folder), "--what", what, "--output", f"{tmp_path}/p.png"))
        assert picture.stat().st_size > 10_000
    for name in ("curves.png", "samples.png", "maps.png", "sobol.png"):
        assert (folder / name).stat().st_size > 10_000
    table = indent_sim.read(folder)
    assert len(table) == 150 and np.isfinite(table["force"]).all()


def test_meshed_runs_are_rows_too(tmp_path):
    """Runs on meshes, with the numbers of runs with folders.

    Folders are compared with the finest run, rows are not.
    """
    scene = {
        "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0, "sides": "roller"},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"delta": 0.01, "steps": 2},
        "mesh": {"h_contact": 0.05, "h_far": 0.5},
    }
    study = {"base": scene, "vary": {"contact.method": ["penalty", "active_set"]}}
    execute(study | {"output": {"runs": "none"}}, tmp_path / "rows")
    execute(study | {"output": {"runs": "all"}}, tmp_path / "all")
    rows, expected = rows_of(tmp_path / "rows"), rows_of(tmp_path / "all")
    compared = ("force_error_vs", "force_error_worst", "a_error_vs", "p_error_vs", "reference")
    for row, other in zip(rows, expected, strict=True):
        assert row["status"] == "done"
        assert {k: v for k, v in row.items() if k not in compared} == {
            k: v for k, v in other.items() if k not in compared
        }


@pytest.mark.verify
def test_the_shipped_surrogate(tmp_path):
    """A sphere on a bonded layer: 99 % of points within 1e-4, and 200 new scenes as stated.

    `scripts/measure_rows.py surrogate` compares 2000 scenes.
    """
    path = ROOT / "configs/studies/surrogate/sphere_on_layer.yaml"
    studies.execute_study(path, output=tmp_path / "layer")
    made = studies.make_surrogate(path, "force", within=1e-4, output=tmp_path / "layer")
    assert made.path.stat().st_size < 1e6
    study = yaml.safe_load(path.read_text())
    sample = {"method": "latin_hypercube", "count": 230, "seed": 7}
    ranges = study["vary"][-1]
    execute(study | {"sample": sample, "vary": ranges}, tmp_path / "new")
    table = indent_sim.read(tmp_path / "new")
    keys = {key: table[key] for key in ranges}
    errors = np.abs(made.surrogate(keys) / table["force"] - 1)
    # The largest 1 % of 200 errors are not bounded by the statement.
    assert np.quantile(errors, 0.98) < made.surrogate.error["error"]
    # At the edges of the range the study has runs of its own.
    assert made.surrogate.error["edges"]["difference"] < 1e-2
    formula = made.surrogate.information["formula"]
    assert formula["error"]["error"] < 0.015 and formula["error"]["edges"] < 0.05
