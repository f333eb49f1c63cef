"""A process killed while it writes a result folder: what it leaves, and what the next one does."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from made_results import FILES, names, some_fields, write_run

from indent_sim.results.reader import read

KILLED_RUN = """
import sys, time
from pathlib import Path
from indent_sim.results.writer import ResultFolder
from tests.made_results import BODY, a_state, some_fields
with ResultFolder(Path(sys.argv[1]), "", surface="all") as run:
    run.open_fields(*BODY, keep="all")
    for step in range(1, int(sys.argv[2]) + 1):
        run.write_fields(a_state(step), some_fields(step))
        run.append(a_state(step))
    print("ready", flush=True)
    while True:
        time.sleep(0.001)
        step += 1
        run.write_fields(a_state(step), some_fields(step))
        run.append(a_state(step))
"""
IDLE_RUN = """
import sys, time
from pathlib import Path
from indent_sim.results.writer import ResultFolder
with ResultFolder(Path(sys.argv[1]), "") as run:
    print("ready", flush=True)
    time.sleep(60)
"""


def killed(script: str, *args, after: float = 0.0, with_signal: int = signal.SIGKILL) -> int:
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", script, *map(str, args)]
    with subprocess.Popen(
        command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout and process.stdout.readline() == b"ready\n"
        time.sleep(after)
        process.send_signal(with_signal)
        return process.wait(20)


@pytest.mark.parametrize("after", [0.0, 0.037, 0.113])
@pytest.mark.parametrize("with_signal", [signal.SIGKILL, signal.SIGINT])
def test_every_file_is_whole(tmp_path, after, with_signal):
    import meshio

    killed(KILLED_RUN, tmp_path / "run", 1, after=after, with_signal=with_signal)
    done = read(tmp_path / "run")
    assert len(done) >= 1
    assert done["step"].tolist() == list(range(1, len(done) + 1))
    assert done.surface["step"].tolist() == np.repeat(done["step"], 2).tolist()
    assert (
        done.report["status"]
        == {signal.SIGKILL: "running", signal.SIGINT: "interrupted"}[with_signal]
    )
    with meshio.xdmf.TimeSeriesReader(tmp_path / "run" / "fields.xdmf") as reader:
        reader.read_points_cells()
        assert reader.num_steps >= len(done)
        for k in range(len(done)):
            step, nodal, _ = reader.read_data(k)
            assert np.array_equal(nodal["pressure"], some_fields(int(step))["pressure"])


def test_the_staging_of_a_killed_run_is_cleaned(tmp_path):
    write_run(tmp_path / "run", 3)
    killed(IDLE_RUN, tmp_path / "run")
    assert len(read(tmp_path / "run")) == 3
    write_run(tmp_path / "run", 2)
    assert names(tmp_path) == {"run"} and len(read(tmp_path / "run")) == 2


def test_a_killed_run_does_not_hold_its_folder(tmp_path):
    killed(KILLED_RUN, tmp_path / "run", 1)
    write_run(tmp_path / "run", 2)
    assert names(tmp_path / "run") == FILES
