"""Whole processes, timed: start-up, meshing, solution and files, in CPU seconds with what they started."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.scene_file import load
from indent_sim.model.tips import Paraboloid
from indent_sim.results.reader import read
from indent_sim.run.pipeline import condense
from indent_sim.scene.scene import resolve

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = [sys.executable, "-m", "indent_sim.cli.start"]
LEAN = ("output.plot=false", "output.fields=none")
MPI = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
}
STEPS = (10, 100, 1000, 10000)
TIPS = 200
RUNS = 60
STUDY = """\
base: {scene}
vary: {{indenter.R: {{from: 0.8, to: 1.2, count: {runs}}}}}
compare_to: theory
"""


@dataclass(frozen=True)
class Measured:
    """A scene as a process of its own: medians of its times [s], its largest memory [MB], forces and run.json."""

    cpu: float
    wall: float
    memory: float
    force: np.ndarray
    report: dict[str, Any]


def measure(
    config: str | Path, *overrides: str, repeat: int = 1, ranks: int = 1, **environment: str
) -> Measured:
    """Run a scene `repeat` times. SystemExit when it fails."""
    before = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    words = [word for setting in (*LEAN, *overrides) for word in ("--set", setting)]
    command = [*before, *PROGRAM, "run", str(ROOT / config), *words, "--output", "run"]
    known = os.environ | MPI | {"PYTHONPATH": str(ROOT)} | environment
    with tempfile.TemporaryDirectory() as folder:
        times = [timed(command, folder, known) for _ in range(repeat)]
        found = read(Path(folder, "run"))
    cpu, wall = map(statistics.median, zip(*times, strict=True))
    return Measured(cpu, wall, found.report["peak_memory_MB"], found["force"], found.report)


def timed(command: list[str], folder: str, environment: Mapping[str, str]) -> tuple[float, float]:
    """CPU seconds, with those of what it started, and wall seconds of a command. SystemExit when it fails."""
    began = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"failed: {' '.join(command)}")
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - began


def steps(repeat: int) -> list[tuple[int, float]]:
    """Load steps of configs/hertz.yaml and the CPU seconds of each run."""
    return [
        (n, measure("configs/hertz.yaml", f"loading.steps={n}", repeat=repeat).cpu) for n in STEPS
    ]


def throughput(repeat: int) -> list[tuple[int, float, float]]:
    """Runs at a time, wall seconds and CPU seconds of a study of RUNS tips on the body of configs/hertz.yaml."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "tips.yaml").write_text(
            STUDY.format(scene=ROOT / "configs/hertz.yaml", runs=RUNS), "utf-8"
        )
        for jobs in dict.fromkeys((1, os.cpu_count() or 1)):
            command = [
                *PROGRAM,
                "study",
                "tips.yaml",
                "--jobs",
                str(jobs),
                "--output",
                f"of_{jobs}",
            ]
            times = [
                timed(command, folder, os.environ | {"PYTHONPATH": str(ROOT)})
                for _ in range(repeat)
            ]
            cpu, wall = map(statistics.median, zip(*times, strict=True))
            found.append((jobs, wall, cpu))
    return found


def tips() -> tuple[int, float]:
    """Contact nodes of the condensed body of configs/hertz.yaml, and CPU seconds for one more tip on it."""
    body = condense(resolve(load(ROOT / "configs/hertz.yaml")))
    began = time.process_time()
    for n in range(TIPS):
        body.states(Paraboloid(0.8 + 0.4 * n / TIPS), [0.008])
    return body.compliance.size, (time.process_time() - began) / TIPS


def kernels(scenes: tuple[str, ...], repeat: int) -> list[tuple[str, float, float]]:
    """Scene, CPU seconds with an empty cache of kernels, CPU seconds with a full one."""
    found = []
    for scene in scenes:
        with tempfile.TemporaryDirectory() as cache:
            cold = measure(scene, XDG_CACHE_HOME=cache).cpu
            found.append((scene, cold, measure(scene, repeat=repeat, XDG_CACHE_HOME=cache).cpu))
    return found


def on_ranks(
    scenes: tuple[tuple[str, ...], ...], repeat: int
) -> list[tuple[tuple[str, ...], int, Measured]]:
    """Every scene (with its overrides) on 1, 2, 4, ... ranks, as many as there are cores."""
    ranks = [n for n in (1, 2, 4, 8, 16) if n <= (os.cpu_count() or 1)]
    return [(scene, n, measure(*scene, repeat=repeat, ranks=n)) for scene in scenes for n in ranks]


def predictions() -> list[tuple[str, dict[str, tuple[float, float]]]]:
    """Every shipped scene with a mesh: what was measured and what `plan` said, of dofs, memory [MB] and CPU seconds."""
    found = []
    for path in sorted((ROOT / "configs").rglob("*.yaml")):
        if "studies" in path.parts or not (scene := resolve(load(path))).is_meshed:
            continue
        plan, done = scene.plan.prediction, measure(path)
        pairs = {"dofs": done.report["dofs"], "memory_MB": done.memory, "seconds": done.cpu}
        found.append(
            (str(path.relative_to(ROOT / "configs")), {k: (v, plan[k]) for k, v in pairs.items()})
        )
    return found
