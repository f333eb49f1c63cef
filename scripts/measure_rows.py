#!/usr/bin/env python
"""Measure large studies of rows: CPU, memory, files, kills, gathering, equality with single runs.

python scripts/measure_rows.py rows [COUNT]: four shards, one of them killed ten times [5000]
python scripts/measure_rows.py kills [COUNT]: kills of a shard at random moments [200]
python scripts/measure_rows.py writes [COUNT]: kills of a process that only appends rows [200]
python scripts/measure_rows.py gather [COUNT]: rows that are made, not computed [100000]
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
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from indent_sim import studies
from indent_sim.cli import calls
from indent_sim.studies.row_file import RowFile, RowIndex, RowWriter, RunRow
from indent_sim.studies.settings_checksum import SettingsChecksum

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
SHARDS = 4
SINGLE_RUNS = 30


def study_of(count: int) -> dict[str, Any]:
    """The study of six sampled keys."""
    sample = {"method": "sobol", "count": count, "seed": 1}
    return {"base": SCENE, "vary": VARY, "sample": sample, "output": {"runs": "none"}}


def write_study(folder: Path, count: int) -> Path:
    """Write the study into a folder, and return its path."""
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(study_of(count), sort_keys=False))
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


def measure_rows(folder: Path, count: int) -> None:
    """Compute a study in four shards, one of them killed ten times, and check it."""
    study = write_study(folder, count)
    start = child_seconds()
    moments = random.Random(1)
    lost_seconds = 0.0
    for _ in range(10):
        process = subprocess.Popen(command(study, "--shard", f"1/{SHARDS}"))
        time.sleep(moments.uniform(2.0, 12.0))
        process.send_signal(signal.SIGKILL)
        process.wait()
    print(f"ten kills of shard 1: {len(RowIndex(folder / 'out/rows'))} rows are kept", flush=True)
    # The CPU time of the workers of a killed shard is not counted by the operating system: it is
    # that of the rows they computed, as in the undisturbed shards.
    for shard in range(1, SHARDS + 1):
        seconds, cpu, memory = run(command(study, "--shard", f"{shard}/{SHARDS}"))
        lost_seconds += cpu
        print(f"shard {shard}: {seconds:.0f} s, {cpu:.1f} s of CPU, {memory:.0f} MB", flush=True)
    seconds, cpu, memory = run(command(study, "--gather"))
    print(f"gather: {seconds:.1f} s, {cpu:.1f} s of CPU, {memory:.0f} MB")
    files = [path for path in (folder / "out").rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    print(f"{len(files)} files, {size / 1e6:.1f} MB")
    print(f"CPU of all commands: {child_seconds() - start:.1f} s")
    table = calls.read(folder / "out")
    cpu_of_rows = np.nansum(table["cpu_s"])
    print(f"CPU of all rows: {cpu_of_rows:.1f} s, {1000 * cpu_of_rows / len(table):.2f} ms each")
    print(f"largest relative difference from single runs: {_difference(folder, table):.1e}")


def _difference(folder: Path, table: Any) -> float:
    """Return the largest relative difference of the results of single runs from the table."""
    largest = 0.0
    for row in random.Random(2).sample(range(len(table)), SINGLE_RUNS):
        keys = {key: table[key][row] for key in VARY}
        single = _single_run(folder / "single", keys)
        for name in ("force", "a", "p_max"):
            largest = max(largest, abs(single[name][-1] / table[name][row] - 1))
    return largest


def _single_run(folder: Path, keys: dict[str, float]) -> Any:
    """Return the result of a single run with its folder."""
    import indent_sim

    config = indent_sim.load(SCENE, keys | {"output.plot": False})
    indent_sim.simulate(config, directory=folder, overwrite=True)
    return indent_sim.read(folder)


def measure_kills(folder: Path, count: int) -> None:
    """Kill a shard at random moments; every row stays, none is there twice, the file opens."""
    study = write_study(folder, 100_000)
    path = folder / "out/rows/1-of-1.h5"
    moments = random.Random(3)
    known: set[int] = set()
    for number in range(1, count + 1):
        before = path.stat().st_mtime_ns if path.exists() else 0
        process = subprocess.Popen(command(study, "--shard", "1/1"))
        # The moment is counted from the first new row on, or from the start.
        while moments.random() < 0.999 and not (path.exists() and path.stat().st_mtime_ns > before):
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 1.0))
        process.send_signal(signal.SIGKILL)
        process.wait()
        settings = RowFile(path).column("settings").tolist() if path.exists() else []
        assert known <= set(settings), "a row is lost"
        assert len(settings) == len(set(settings)), "a row is there twice"
        known = set(settings)
        if number % 20 == 0:
            print(f"{number} kills: {len(known)} rows", flush=True)


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
    path = write_study(folder, count)
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


def main() -> None:
    """Measure what is asked for."""
    kinds = {"rows": (measure_rows, 5000), "kills": (measure_kills, 200)}
    kinds["gather"] = (measure_gather, 100_000)
    kinds["writes"] = (measure_writes, 200)
    kind, *counts = sys.argv[1:]
    measure, count = kinds[kind]
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), int(counts[0]) if counts else count)


if __name__ == "__main__":
    main()
