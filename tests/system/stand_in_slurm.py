#!/usr/bin/env python3
"""A stand-in for Slurm, called by the names sbatch, srun and scontrol.

sbatch runs the job before it returns: it reads the #SBATCH lines, does the tasks of an array one by
one, sets the SLURM_* variables, and runs a job again that asked for it. STAND_IN_SLURM is the
folder of the jobs, and STAND_IN_ROWS the number of rows that a job or task writes before its first
time limit comes.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

JOBS = Path(os.environ["STAND_IN_SLURM"])
OPTIONS = (
    "job-name",
    "nodes",
    "ntasks",
    "cpus-per-task",
    "mem-per-cpu",
    "time",
    "signal",
    "open-mode",
    "array",
    "dependency",
)


def main() -> int:
    """Act as the command by whose name this file is called."""
    name, words = Path(sys.argv[0]).name, sys.argv[1:]
    return {"sbatch": sbatch, "srun": srun, "scontrol": scontrol}[name](words)


def sbatch(words: list[str]) -> int:
    """Submit a job, which is run at once."""
    asked, script = parsed(words), Path(parsed(words).script[0])
    lines = [line for line in script.read_text().splitlines() if line.startswith("#SBATCH ")]
    job = parsed([*(word for line in lines for word in line.split()[1:]), *words])
    if job.dependency:
        kind, _, before = job.dependency.partition(":")
        assert kind == "afterany" and (JOBS / before).exists(), job.dependency
    number = str(100 + len(list(JOBS.iterdir())))
    (JOBS / number).mkdir()
    for task in tasks(job.array):
        carry_out(number, task, job)
    print(number if asked.parsable else f"Submitted batch job {number}")
    return 0


def parsed(words: list[str]) -> argparse.Namespace:
    """Options of sbatch, the job file and its arguments.

    An option unknown to Slurm is an error.
    """
    parser = argparse.ArgumentParser()
    for name in OPTIONS:
        parser.add_argument(f"--{name}")
    for name in ("parsable", "requeue"):
        parser.add_argument(f"--{name}", action="store_true")
    parser.add_argument("script", nargs=argparse.REMAINDER)
    return parser.parse_args(words)


def tasks(array: str | None) -> list[dict[str, str]]:
    """The variables of each task of an array; for a job without an array, no variables once."""
    if array is None:
        return [{}]
    first, last = map(int, array.split("-"))
    shared = {"MIN": first, "MAX": last, "COUNT": last - first + 1}
    return [
        {f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in (shared | {"ID": task}).items()}
        for task in range(first, last + 1)
    ]


def carry_out(number: str, task: dict[str, str], job: argparse.Namespace) -> None:
    """Run the job file until it ends without a request to be queued again.

    Its exit code goes into `ends`.
    """
    name = "_".join([number, *task.get("SLURM_ARRAY_TASK_ID", "").split()])
    place = JOBS / number / name
    place.mkdir()
    known = {"SLURM_JOB_ID": name, "SLURM_NTASKS": job.ntasks or "1", "STAND_IN_PLACE": str(place)}
    for restart in range(5):
        again = {"SLURM_RESTART_COUNT": str(restart)} if restart else {}
        with open(f"slurm-{name}.out", "a") as log:
            process = subprocess.Popen(
                ["bash", *job.script],
                env=os.environ | known | task | again,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
            if not restart and "STAND_IN_ROWS" in os.environ:
                end_of_time(process, job.signal, place)
            code = process.wait()
        with open(place / "ends", "a") as ends:
            ends.write(
                json.dumps({"code": code, "options": vars(job) | {"script": job.script[1:]}}) + "\n"
            )
        if not (place / "requeued").exists():
            return
        (place / "requeued").unlink()
    raise RuntimeError(f"{name} is queued again and again")


def end_of_time(process: subprocess.Popen[bytes], wanted: str, place: Path) -> None:
    """Send the signal of --signal when enough rows are written.

    It goes to the job file itself (B:) or to what srun started.
    """
    rows = written() + int(os.environ["STAND_IN_ROWS"])
    while written() < rows:
        if process.poll() is not None:
            return
        time.sleep(0.01)
    whom, _, name = wanted.split("@")[0].rpartition(":")
    steps = [] if whom == "B" else [int(word) for word in (place / "step").read_text().split()]
    for target in steps or [process.pid]:
        os.kill(target, signal.Signals[f"SIG{name}"])


def written() -> int:
    """The number of rows of all results here."""
    return sum(
        max(0, text.read_text().count("\n") - 1) for text in Path().rglob("force_indentation.csv")
    )


def srun(words: list[str]) -> int:
    """Start a program on the ranks of the job.

    The exit code is that of the first rank to fail.
    """
    ranks = os.environ["SLURM_NTASKS"]
    process = subprocess.Popen(["mpirun", "-n", ranks, *words])
    place = Path(os.environ["STAND_IN_PLACE"])
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while process.poll() is None and len(children.read_text().split()) < int(ranks):
        time.sleep(0.01)
    if process.poll() is None:
        (place / "step").write_text(children.read_text())
    return process.wait()


def scontrol(words: list[str]) -> int:
    """Put the running job back into the queue."""
    assert words == ["requeue", os.environ["SLURM_JOB_ID"]]
    Path(os.environ["STAND_IN_PLACE"], "requeued").touch()
    return 0


if __name__ == "__main__":
    sys.exit(main())
