"""Measurement of whole processes: start-up, meshing, solution and files."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
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
PROGRAM = [sys.executable, "-m", "indent_sim"]
HERTZ = "configs/hertz.yaml"
# Settings of every measured run.
LEAN = ("output.plot=false", "output.fields=none")
MPI_ENVIRONMENT = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
}
# Numbers of load steps, of tips on a condensed body, and of runs of a study.
STEP_COUNTS = (10, 100, 1000, 10000)
TIP_COUNT = 200
STUDY_RUNS = 60
STUDY = """\
base: {scene}
vary: {{indenter.R: {{from: 0.8, to: 1.2, count: {runs}}}}}
compare_to: theory
"""

# A config and its settings.
Scene = tuple[str, ...]


@dataclass(frozen=True)
class Measured:
    """Measurement of a scene as a process of its own.

    Attributes
    ----------
    cpu, wall
        Medians of the CPU and wall time [s].
    memory
        Largest memory [MB].
    force
        Forces of the rows.
    report
        The content of run.json.
    """

    cpu: float
    wall: float
    memory: float
    force: np.ndarray
    report: dict[str, Any]


def measure(
    config: str | Path, *overrides: str, repeat: int = 1, ranks: int = 1, **environment: str
) -> Measured:
    """Run a scene `repeat` times.

    Parameters
    ----------
    config : str or Path
        The scene file.
    overrides : str
        Settings "key=value".
    repeat : int
        Number of runs, of which the median counts.
    ranks : int
        Number of ranks.
    environment : str
        Additional environment variables.

    Raises
    ------
    SystemExit
        A run fails.
    """
    launcher = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    options = [word for setting in (*LEAN, *overrides) for word in ("--set", setting)]
    options += ["--output", "run"]
    command = [*launcher, *PROGRAM, "run", str(ROOT / config), *options]
    run_environment = os.environ | MPI_ENVIRONMENT | {"PYTHONPATH": str(ROOT)} | environment
    with tempfile.TemporaryDirectory() as folder:
        times = [timed(command, folder, run_environment) for _ in range(repeat)]
        results = read(Path(folder, "run"))
    cpu, wall = map(statistics.median, zip(*times, strict=True))
    memory = results.report["peak_memory_MB"]
    return Measured(cpu, wall, memory, results["force"], results.report)


def timed(command: list[str], folder: str, environment: Mapping[str, str]) -> tuple[float, float]:
    """Run a command in a folder.

    Returns
    -------
    cpu : float
        CPU time of the process and of all processes that it started [s].
    wall : float
        Wall time [s].

    Raises
    ------
    SystemExit
        The command fails.
    """
    start = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment
    )
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    if status:
        raise SystemExit(f"failed: {' '.join(command)}")
    return usage.ru_utime + usage.ru_stime, wall


def measure_steps(repeat: int) -> list[tuple[int, float]]:
    """Return numbers of load steps of HERTZ, and the CPU seconds of each run."""
    return [
        (count, measure(HERTZ, f"loading.steps={count}", repeat=repeat).cpu)
        for count in STEP_COUNTS
    ]


def measure_throughput(repeat: int) -> list[tuple[int, float, float]]:
    """Measure a study of STUDY_RUNS tips on the body of HERTZ.

    Returns
    -------
    list of (jobs, wall, cpu)
        Number of parallel runs, wall seconds and CPU seconds.
    """
    measurements = []
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory() as folder:
        study = STUDY.format(scene=ROOT / HERTZ, runs=STUDY_RUNS)
        Path(folder, "tips.yaml").write_text(study, "utf-8")
        for jobs in dict.fromkeys((1, os.cpu_count() or 1)):
            options = ["--jobs", str(jobs), "--output", f"of_{jobs}"]
            command = [*PROGRAM, "study", "tips.yaml", *options]
            times = [timed(command, folder, environment) for _ in range(repeat)]
            cpu, wall = map(statistics.median, zip(*times, strict=True))
            measurements.append((jobs, wall, cpu))
    return measurements


def measure_tips() -> tuple[int, float]:
    """Return the contact nodes of the condensed body of HERTZ, and the CPU seconds of a tip."""
    body = condense(resolve(load(ROOT / HERTZ)))
    start = time.process_time()
    for k in range(TIP_COUNT):
        body.states(Paraboloid(0.8 + 0.4 * k / TIP_COUNT), [0.008])
    return body.compliance.size, (time.process_time() - start) / TIP_COUNT


def measure_kernels(scenes: Sequence[str], repeat: int) -> list[tuple[str, float, float]]:
    """Return every scene with its CPU seconds with an empty and with a full cache of kernels."""
    measurements = []
    for scene in scenes:
        with tempfile.TemporaryDirectory() as cache:
            cold = measure(scene, XDG_CACHE_HOME=cache).cpu
            warm = measure(scene, repeat=repeat, XDG_CACHE_HOME=cache).cpu
        measurements.append((scene, cold, warm))
    return measurements


def measure_ranks(scenes: Sequence[Scene], repeat: int) -> list[tuple[Scene, int, Measured]]:
    """Measure every scene on 1, 2, 4, ... ranks, up to the number of cores."""
    rank_counts = [count for count in (1, 2, 4, 8, 16) if count <= (os.cpu_count() or 1)]
    return [
        (scene, ranks, measure(*scene, repeat=repeat, ranks=ranks))
        for scene in scenes
        for ranks in rank_counts
    ]


def measure_predictions() -> list[tuple[str, list[tuple[float, float]]]]:
    """Compare every shipped scene that has a mesh with its prediction.

    Returns
    -------
    list of (scene, pairs)
        Measured and predicted number of dofs, memory [MB] and CPU seconds.
    """
    comparisons = []
    for path in sorted((ROOT / "configs").rglob("*.yaml")):
        if "studies" in path.parts:
            continue
        scene = resolve(load(path))
        if not scene.is_meshed:
            continue
        plan = scene.plan.prediction
        done = measure(path)
        pairs = [
            (done.report["dofs"], plan["dofs"]),
            (done.memory, plan["memory_MB"]),
            (done.cpu, plan["seconds"]),
        ]
        comparisons.append((str(path.relative_to(ROOT / "configs")), pairs))
    return comparisons
