#!/usr/bin/env python
"""Measure large studies of rows: CPU, memory, files, kills, gathering, equality with single runs.

python scripts/measure_rows.py rows [COUNT [FOLDER]]: four shards, one killed ten times [5000]
python scripts/measure_rows.py elements [COUNT [FOLDER]]: the same with finite elements [500]
python scripts/measure_rows.py kills [COUNT]: kills of a shard at random moments [200]
python scripts/measure_rows.py writes [COUNT]: kills of a process that only appends rows [200]
python scripts/measure_rows.py gather [COUNT]: rows that are made, not computed [100000]
python scripts/measure_rows.py surrogate [COUNT]: the shipped surrogate at new scenes [2000]

With FOLDER the results are kept there, and a measurement that was interrupted continues.
"""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import yaml

import indent_sim
from indent_sim import studies
from indent_sim.cli import calls
from indent_sim.studies.row_file import RowFile, RowIndex, RowWriter, RunRow
from indent_sim.studies.settings_checksum import SettingsChecksum

ROOT = Path(__file__).resolve().parents[1]
SCENE: dict[str, Any] = {
    "title": "Beads on two films",
    "body": {
        "shape": "layer",
        "height": 25.0,
        "layers": [
            {"thickness": 5.0},
            {"thickness": 20.0, "material": {"model": "linear_elastic", "E": 10.0, "nu": 0.45}},
        ],
    },
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.45},
    "indenter": {"shape": "paraboloid", "R": 5.0},
    "loading": {"delta": 0.5, "steps": 5},
    "solver": {"method": "theory"},
}
VARY = {
    "material.E": {"from": 0.5, "to": 5, "spacing": "log"},
    "material.nu": {"from": 0.3, "to": 0.5},
    "body.layers[1].material.E": {"from": 5, "to": 50, "spacing": "log"},
    "body.layers[1].material.nu": {"from": 0.3, "to": 0.5},
    "indenter.R": {"from": 2, "to": 10, "spacing": "log"},
    "loading.delta": {"from": 0.05, "to": 0.5},
}
# An axisymmetric sphere on a bonded layer, by finite elements that are condensed.
MESHED_SCENE: dict[str, Any] = {
    "title": "Bead on a bonded layer",
    "body": {"shape": "layer", "height": 10.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.45},
    "indenter": {"shape": "sphere", "R": 5.0},
    "loading": {"delta": 0.5, "steps": 5},
    "solver": {"method": "condensed"},
}
MESHED_VARY = {
    "material.E": {"from": 0.5, "to": 5, "spacing": "log"},
    "material.nu": {"from": 0.3, "to": 0.49},
    "body.height": {"from": 5, "to": 50, "spacing": "log"},
    "indenter.R": {"from": 2, "to": 10, "spacing": "log"},
    "loading.delta": {"from": 0.05, "to": 0.5},
}
SURROGATE_STUDY = ROOT / "configs/studies/surrogate/sphere_on_layer.yaml"
SHARDS = 4
KILLS = 10
SINGLE_RUNS = 30
# Number of rows of a shard that is killed again and again: more than 256 make its file grow.
SHORT_COUNT = 400


def study_of(count: int, seed: int = 1) -> dict[str, Any]:
    """The study of six sampled keys."""
    sample = {"method": "sobol", "count": count, "seed": seed}
    return {"base": SCENE, "vary": VARY, "sample": sample, "output": {"runs": "none"}}


def meshed_study_of(count: int) -> dict[str, Any]:
    """The study of five sampled keys of a scene with finite elements."""
    return study_of(count) | {"base": MESHED_SCENE, "vary": MESHED_VARY}


def write_study(folder: Path, study: dict[str, Any]) -> Path:
    """Write a study into a folder, and return its path."""
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False))
    return path


def command(study: Path, *options: str) -> list[str]:
    """Return the command of a study with its results beside it."""
    program = [sys.executable, "-m", "indent_sim", "study", str(study)]
    return [*program, "--output", str(study.parent / "out"), "--quiet", *options]


def child_seconds() -> float:
    """Return the CPU time [s] of the child processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def run(words: list[str]) -> tuple[float, float, float]:
    """Run a command; return wall time [s], CPU time [s] and its largest memory [MB]."""
    start, cpu = time.monotonic(), child_seconds()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, words
    seconds = time.monotonic() - start
    return seconds, child_seconds() - cpu, usage.ru_maxrss / 1024


def kill_after_rows(words: list[str], path: Path, seconds: float) -> None:
    """Start a shard, and kill it some time [s] after its first new row in the file `path`."""
    before = path.stat().st_mtime_ns if path.exists() else 0
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    while process.poll() is None and not (path.exists() and path.stat().st_mtime_ns > before):
        time.sleep(0.01)
    time.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    process.wait()


def measure_rows(folder: Path, count: int) -> None:
    """Compute a study by theory in four shards, one of them killed ten times, and check it."""
    _measure_shards(folder, study_of(count))


def measure_elements(folder: Path, count: int) -> None:
    """Compute a study with finite elements in four shards, one of them killed ten times."""
    _measure_shards(folder, meshed_study_of(count))


def _measure_shards(folder: Path, study: dict[str, Any]) -> None:
    """Compute a study in four shards, one of them killed ten times, and compare it."""
    path = write_study(folder, study)
    start = child_seconds()
    moments = random.Random(1)
    for _ in range(KILLS):
        words = command(path, "--shard", f"1/{SHARDS}")
        kill_after_rows(words, folder / f"out/rows/1-of-{SHARDS}.h5", moments.uniform(0.0, 10.0))
    kept = len(RowIndex(folder / "out/rows"))
    print(f"{KILLS} kills of shard 1: {kept} rows are kept", flush=True)
    # The CPU time of the workers of a killed shard is not counted by the operating system: it is
    # that of the rows they computed, as in the undisturbed shards.
    for shard in range(1, SHARDS + 1):
        seconds, cpu, memory = run(command(path, "--shard", f"{shard}/{SHARDS}"))
        print(f"shard {shard}: {seconds:.0f} s, {cpu:.1f} s of CPU, {memory:.0f} MB", flush=True)
    seconds, cpu, memory = run(command(path, "--gather"))
    print(f"gather: {seconds:.1f} s, {cpu:.1f} s of CPU, {memory:.0f} MB")
    files = [file for file in (folder / "out").rglob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    print(f"{len(files)} files, {size / 1e6:.1f} MB")
    print(f"CPU of all commands: {child_seconds() - start:.1f} s")
    table = calls.read(folder / "out")
    print(f"{len(table)} rows, {np.count_nonzero(np.isfinite(table['force']))} with a force")
    cpu_of_rows = np.nansum(table["cpu_s"])
    print(f"CPU of all rows: {cpu_of_rows:.1f} s, {1000 * cpu_of_rows / len(table):.2f} ms each")
    difference = _difference(folder, study, table)
    print(f"largest relative difference from {SINGLE_RUNS} single runs: {difference:.1e}")


def _difference(folder: Path, study: dict[str, Any], table: Any) -> float:
    """Return the largest relative difference of the results of single runs from the table."""
    largest = 0.0
    for row in random.Random(2).sample(range(len(table)), min(SINGLE_RUNS, len(table))):
        keys = {key: table[key][row] for key in study["vary"]}
        single = _single_run(folder / "single", study["base"], keys)
        for name in ("force", "a", "p_max"):
            largest = max(largest, abs(single[name][-1] / table[name][row] - 1))
    return largest


def _single_run(folder: Path, scene: dict[str, Any], keys: dict[str, float]) -> Any:
    """Return the result of a single run with its folder."""
    config = indent_sim.load(scene, keys | {"output.plot": False})
    indent_sim.simulate(config, directory=folder, overwrite=True)
    return indent_sim.read(folder)


def measure_kills(folder: Path, count: int) -> None:
    """Kill shards of 400 rows at random moments, until `count` of them were killed.

    After each kill the file opens, no finished row is lost and none is there twice. The program,
    its worker or both are killed. When a shard is complete, its table is that of an undisturbed
    study.
    """
    moments = random.Random(3)
    kills = round_number = 0
    while kills < count:
        round_number += 1
        part = folder / f"round-{round_number}"
        part.mkdir()
        study = study_of(SHORT_COUNT, seed=round_number)
        kills += _kill_until_complete(part, study, moments, count - kills)
        _check_complete(part, study)
        print(f"{kills} kills, {round_number} complete shards", flush=True)


def _kill_until_complete(
    folder: Path, study: dict[str, Any], moments: random.Random, most: int
) -> int:
    """Kill a shard again and again until it is complete; return the number of kills."""
    words = command(write_study(folder, study), "--shard", "1/1")
    path = folder / "out/rows/1-of-1.h5"
    known: set[int] = set()
    kills = 0
    while kills < most:
        before = path.stat().st_mtime_ns if path.exists() else 0
        process = subprocess.Popen(words)
        # One kill in four comes at any moment from the start on, the others after a new row.
        is_early = moments.random() < 0.25
        while process.poll() is None and not (
            is_early or (path.exists() and path.stat().st_mtime_ns > before)
        ):
            time.sleep(0.005)
        time.sleep(moments.uniform(0.0, 2.5 if is_early else 1.0))
        victims = moments.choice(("program", "program", "worker", "both"))
        if victims != "program":
            _kill_children(process.pid)
        if victims == "worker":
            time.sleep(moments.uniform(0.0, 1.0))
        is_complete = process.poll() is not None
        process.kill()
        process.wait()
        known = _checked_rows(path, known)
        if is_complete:
            assert process.returncode == 0, process.returncode
            return kills
        kills += 1
    return kills


def _kill_children(pid: int) -> None:
    """Kill the child processes of a process."""
    with suppress(OSError):
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            os.kill(int(child), signal.SIGKILL)


def _checked_rows(path: Path, known: set[int]) -> set[int]:
    """Return the finished rows of a file; raise AssertionError if one is lost or there twice."""
    if not path.exists():
        return known
    with h5py.File(path, "r") as file:
        assert set(file) == {"rows", "curves", "texts"}
    rows = RowFile(path)
    settings = rows.column("settings")[rows.is_finished].tolist()
    assert known <= set(settings), "a row is lost"
    assert len(settings) == len(set(settings)), "a row is there twice"
    for number in rows.numbers:
        rows.read(int(number))
    return set(settings)


def _check_complete(folder: Path, study: dict[str, Any]) -> None:
    """Complete a shard that was killed, and compare its table with an undisturbed one."""
    path = folder / "study.yaml"
    run(command(path, "--resume"))
    (folder / "other").mkdir()
    run(command(write_study(folder / "other", study)))
    table, other = (calls.read(place / "out") for place in (folder, folder / "other"))
    for name in (*VARY, "exit_code", "steps_done", "force", "a", "p_max", "stated_error"):
        assert np.array_equal(table[name], other[name], equal_nan=True), name


def append_forever(path: Path) -> None:
    """Append made rows to a row file as fast as possible, until the process is killed."""
    number = len(RowFile(path).numbers) if path.exists() else 0
    with RowWriter(path) as writer:
        while True:
            writer.append(made_row(number))
            number += 1


def made_row(number: int) -> RunRow:
    """Return a row that is different for every number."""
    cells = {"status": "done", "exit_code": 0, "reason": "", "method": "theory", "a": 0.1}
    cells |= {"run": f"E=1-{number:016x}", "force": number / 7, "warnings": f"warning {number}"}
    return RunRow(number, number, cells, np.full((1 + number % 9, 5), number / 3))


def measure_writes(folder: Path, count: int) -> None:
    """Kill a process that only appends rows; every row stays, none is there twice."""
    path = folder / "1-of-1.h5"
    moments = random.Random(4)
    known = 0
    for number in range(1, count + 1):
        process = os.fork()
        if process == 0:
            append_forever(path)
        time.sleep(moments.uniform(0.0, 1.0))
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        if not path.exists():
            continue
        file = RowFile(path)
        settings = file.column("settings")
        assert len(settings) >= known, "a row is lost"
        assert np.array_equal(settings, np.arange(len(settings))), "a row is lost or there twice"
        for row in {0, known, max(0, len(settings) - 1)} & set(range(len(settings))):
            expected, found = made_row(row), file.read(row)
            assert np.array_equal(found.curve, expected.curve)
            assert found.cells["force"] == expected.cells["force"]
        known = len(settings)
        if number % 50 == 0:
            print(f"{number} kills: {known} rows", flush=True)


def measure_gather(folder: Path, count: int) -> None:
    """Gather rows that were made without computing them."""
    path = write_study(folder, study_of(count))
    study = studies.read(path)
    checksum = SettingsChecksum(study)
    (folder / "out/rows").mkdir(parents=True)
    (folder / "out/study.json").write_text(json.dumps({"program": "indent-sim"}))
    warning = "strains near 0.2 a/R = 0.074: small strain is no longer a good model"
    cells = {"status": "done", "exit_code": 0, "method": "theory", "cpu_s": 0.01, "wall_s": 0.01}
    start = time.process_time()
    with RowWriter(folder / "out/rows/1-of-1.h5") as writer:
        for index, request in enumerate(study.iterate_requests()):
            row = cells | {"run": f"E=1-{index:016x}", "force": index / 7, "steps_done": 5}
            row |= {"warnings": f"{warning} {index % 100}", "stated_error": 0.0, "a": 0.1}
            curve = np.full((5, 5), index / 3)
            writer.append(RunRow(checksum(request), index, row, curve))
    print(f"{count} rows written: {time.process_time() - start:.1f} s of CPU")
    seconds, cpu, memory = run(command(path, "--shard", "1/1"))
    print(f"shard that finds them all: {seconds:.1f} s, {cpu:.1f} s of CPU, {memory:.0f} MB")
    seconds, cpu, memory = run(command(path, "--gather"))
    print(f"gather: {seconds:.1f} s, {cpu:.1f} s of CPU, {memory:.0f} MB", flush=True)
    for file in sorted((folder / "out").rglob("*")):
        print(f"  {file.relative_to(folder)}: {file.stat().st_size / 1e6:.1f} MB")


def measure_surrogate(folder: Path, count: int) -> None:
    """Compare the surrogate of the shipped study with new scenes: the points of another sample."""
    study = yaml.safe_load(SURROGATE_STUDY.read_text())
    path = write_study(folder, study)
    _, cpu, _ = run(command(path))
    print(f"study of {len(calls.read(folder / 'out'))} rows: {cpu:.1f} s of CPU", flush=True)
    _, cpu, memory = run(command(path, "--surrogate", "force", "--within", "1e-4"))
    print(f"surrogate: {cpu:.1f} s of CPU, {memory:.0f} MB")
    file = folder / "out/surrogate-force.json"
    surrogate = indent_sim.surrogate(file)
    print(f"{surrogate.error_text()}; {file.stat().st_size / 1000:.0f} kB")
    # One point in ten of the ranges does not fulfil `where`.
    sample = {"method": "latin_hypercube", "count": int(1.15 * count), "seed": 7}
    ranges = study["vary"][-1]
    (folder / "new").mkdir()
    run(command(write_study(folder / "new", study | {"sample": sample, "vary": ranges})))
    table = calls.read(folder / "new/out")
    keys = {key: table[key][:count] for key in ranges}
    errors = np.abs(surrogate(keys) / table["force"][:count] - 1)
    quantile, largest = np.quantile(errors, 0.99), errors.max()
    print(f"{len(errors)} new scenes: 99 % within {quantile:.1e}, all within {largest:.1e}")
    print(surrogate.information["formula"]["words"])
    points = 1_000_000
    many = {key: np.resize(values, points) for key, values in keys.items()}
    start = time.process_time()
    surrogate(many)
    print(f"{points} points of the surrogate: {time.process_time() - start:.2f} s of CPU")


def main() -> None:
    """Measure what is asked for."""
    kinds = {"rows": (measure_rows, 5000), "kills": (measure_kills, 200)}
    kinds["elements"] = (measure_elements, 500)
    kinds["gather"] = (measure_gather, 100_000)
    kinds["writes"] = (measure_writes, 200)
    kinds["surrogate"] = (measure_surrogate, 2000)
    kind, *rest = sys.argv[1:]
    measure, count = kinds[kind]
    count = int(rest[0]) if rest else count
    if len(rest) > 1:
        assert kind in ("rows", "elements"), f"{kind} needs a new folder"
        folder = Path(rest[1])
        folder.mkdir(parents=True, exist_ok=True)
        return measure(folder, count)
    with tempfile.TemporaryDirectory() as temporary:
        measure(Path(temporary), count)


if __name__ == "__main__":
    main()
