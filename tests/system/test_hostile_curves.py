"""`indent-sim fit` of broken or strange files gives a curve or a reason, no traceback."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import hostile_curves
import numpy as np
import pytest

SCENE = """\
units: {length: um, force: nN}
body: {shape: half_space}
material: {model: linear_elastic, E: 2 kPa, nu: 0.5}
indenter: {shape: paraboloid, R: 5 um}
loading: {delta: 0.5 um, steps: 5}
output: {plot: false}
"""
INSTRUMENTS = (".ibw", ".h5", ".zip")  # read by an optional package
OFF = 0.15  # of a modulus from 300 points of 1 % noise, first touch unknown: ten of its deviations


# A process that runs a command, then prints the largest memory that it or a child of it had [kB];
# this test's own process has other children, whose memory would count.
MEMORY_IN_KB = (
    sys.executable,
    "-c",
    "import resource, subprocess, sys\n"
    "code = subprocess.call(sys.argv[1:])\n"
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)\n"
    "sys.exit(code)",
)


def fitted(
    folder: Path, *words: str, runner: Sequence[str] = ()
) -> tuple[subprocess.CompletedProcess[str], dict[str, dict[str, object]]]:
    """Fit a folder of curves in a process started by a runner.

    Returns the finished process, and the entries by file.
    """
    (folder / "scene.yaml").write_text(SCENE)
    command = [
        sys.executable,
        "-m",
        "indent_sim.cli.commands",
        "fit",
        "curves",
        "--scene",
        "scene.yaml",
    ]
    more = ["--vary", "material.E", "--output", "out", *words]
    done = subprocess.run([*runner, *command, *more], cwd=folder, capture_output=True, text=True)
    entries = json.loads((folder / "out" / "fit.json").read_text())["curves"]
    return done, {Path(str(entry["source"]["file"])).name: entry for entry in entries}


def check(folder: Path, files: list[hostile_curves.Hostile], *words: str) -> None:
    """Assert that every file has an entry: a modulus, or a reason on one line."""
    (folder / "curves").mkdir()
    has_reader = importlib.util.find_spec("afmformats") is not None
    there = [one for one in files if has_reader or not one.name.endswith(INSTRUMENTS)]
    for one in there:
        (folder / "curves" / one.name).write_bytes(one.data)
    done, entries = fitted(folder, *words)
    assert done.returncode == 0 and "Traceback" not in done.stdout + done.stderr, done.stderr[
        -3000:
    ]
    assert entries.keys() == {one.name for one in there}
    wrong = [
        (one.name, entries[one.name]) for one in there if not _is_right(one, entries[one.name])
    ]
    assert not wrong, [(name, entry["reason"] or entry["parameters"]) for name, entry in wrong]


def _is_right(file: hostile_curves.Hostile, entry: dict[str, object]) -> bool:
    reason = str(entry["reason"])
    if entry["status"] == "refused":
        fits = file.reason is None or (
            file.reason != hostile_curves.DONE and reason.startswith(file.reason)
        )
        return fits and len(reason) > 8 and "\n" not in reason
    numbers = entry["parameters"]["material.E"]  # type: ignore[index]
    E = hostile_curves.MODULUS
    is_near = file.reason is None or abs(numbers["value"] / E - 1) < OFF
    return (
        file.reason in (None, hostile_curves.DONE)
        and is_near
        and all(np.isfinite(list(_plain(numbers))))
    )


def _plain(numbers: dict[str, object]):  # type: ignore[no-untyped-def]
    yield from (numbers[name] for name in ("value", "low", "high"))


def test_one_file_of_every_kind(tmp_path):
    check(tmp_path, list(hostile_curves.hostile(np.random.default_rng(0))))


@pytest.mark.verify
def test_more_files_in_two_processes(tmp_path):
    files = []
    for seed in range(1, 3):
        drawn = hostile_curves.hostile(np.random.default_rng(seed))
        files += [
            hostile_curves.Hostile(f"{seed} {one.name}", one.data, one.reason) for one in drawn
        ]
    assert len(files) > 160
    check(tmp_path, files, "--jobs", "2")


@pytest.mark.verify
def test_ten_million_rows(tmp_path):
    """A curve of ten million rows with a column of words and a gap is fitted within 2 GB.

    1.4 GB are measured.
    """
    (tmp_path / "curves").mkdir()
    x, force = hostile_curves.curve(np.random.default_rng(0), 10_000_000)
    with (tmp_path / "curves" / "long.csv").open("w") as file:
        file.write("segment;depth [um];force [nN]\n")
        for rows in np.array_split(np.column_stack([x, force]), 100):
            file.write("".join(f"approach;{a:.8f};{b:.6f}\n" for a, b in rows.tolist()))
        file.write("approach;;1.5\n")
    done, entries = fitted(tmp_path, runner=MEMORY_IN_KB)
    stated = entries["long.csv"]["parameters"]["material.E"]
    assert done.returncode == 0 and stated["value"] == pytest.approx(1.0, abs=1e-3)
    assert int(done.stdout.splitlines()[-1]) < 2_000_000
