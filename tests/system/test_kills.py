"""Killed, stopped, out of disk: a folder that can be read at any moment, and `--resume` ends at the same curve."""

from __future__ import annotations

import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import MPI_ENVIRONMENT
from test_cli import environment
from test_resume import CONDENSED, HYPERELASTIC, same_numbers

from indent_sim.config.file import load
from indent_sim.model.state import State
from indent_sim.process.signals import Stopped, stoppable
from indent_sim.results.reader import Results, read
from indent_sim.run.chain import simulate

RUN = (sys.executable, "-m", "indent_sim.cli.commands", "run", "scene.yaml", "--output", "out")
SCENES = {"newton": HYPERELASTIC, "condensed": CONDENSED.replace("steps: 15", "steps: 60")}
PATIENCE = 180  # s


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A scene, written as scene.yaml."""
    (tmp_path / "scene.yaml").write_text(SCENES[request.param])
    return SCENES[request.param]


def started(place: Path, *words: str, before: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    """The run in a process of its own, or in what `before` starts."""
    return subprocess.Popen((*before, *RUN, *words), cwd=place, env=environment() | MPI_ENVIRONMENT, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # fmt: skip


def wait_for_rows(place: Path, process: subprocess.Popen[str], rows: int) -> None:
    table, deadline = place / "out" / "force_indentation.csv", time.monotonic() + PATIENCE
    while not table.exists() or table.read_text().count("\n") <= rows:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.005)


def resumed(place: Path, *before: str) -> Results:
    with started(place, "--resume", before=before) as process:
        _, told = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, told
    return read(place / "out")


class TestSignals:
    @pytest.mark.parametrize(
        ("scene", "number", "code"),
        [("newton", signal.SIGTERM, 143), ("condensed", signal.SIGINT, 130), ("condensed", signal.SIGHUP, 129)],
        indirect=["scene"],
    )
    def test_stopped_and_resumed(self, scene, tmp_path, undisturbed, number, code):
        with started(tmp_path) as process:
            wait_for_rows(tmp_path, process, 2)
            process.send_signal(number)
            _, told = process.communicate(timeout=PATIENCE)
        assert process.returncode == code and "--resume goes on" in told and "Traceback" not in told
        stopped = read(tmp_path / "out")
        assert stopped.report["status"] == "interrupted" and 2 <= len(stopped) == stopped.report["rows"]
        resumed(tmp_path)
        same_numbers(tmp_path / "out", undisturbed(scene))

    def test_a_library_may_hide_the_signal(self, tmp_path):
        """What arrives in a callback of PETSc comes out of it as PETSc's own error."""

        def hide(state: State, step: int, total: int) -> None:
            try:
                signal.raise_signal(signal.SIGTERM)
            except Stopped:
                raise RuntimeError("error code 101") from None

        (tmp_path / "scene.yaml").write_text(CONDENSED)
        with pytest.raises(Stopped), stoppable():
            simulate(load(tmp_path / "scene.yaml"), directory=tmp_path / "out", progress=hide)
        report = read(tmp_path / "out").report
        assert (report["status"], report["exit_code"], report["rows"]) == ("interrupted", 143, 1)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "number",
        [signal.SIGTERM, *(pytest.param(other, marks=pytest.mark.stress) for other in (signal.SIGINT, signal.SIGHUP))],
    )
    def test_on_two_ranks(self, tmp_path, undisturbed, number):
        """mpirun passes the signal on; its own exit code is its own affair, so only not 0 is asked for."""
        long = HYPERELASTIC.replace("steps: 15", "steps: 200")  # mpirun passes it on after a second
        (tmp_path / "scene.yaml").write_text(long)
        with started(tmp_path, before=("mpirun", "-n", "2")) as process:
            wait_for_rows(tmp_path, process, 2)
            process.send_signal(number)
            process.communicate(timeout=PATIENCE)
        assert process.returncode != 0
        assert 2 <= len(read(tmp_path / "out")) < 200
        resumed(tmp_path)
        same_numbers(tmp_path / "out", undisturbed(long))


def kills(place: Path, number: int, seed: int) -> int:
    """Kill the run of a place at random moments, resume it each time, begin anew when it is done; returns how often it
    was done. Whatever is there after a kill can be read, and no row that was there is another now."""
    chance, rows, done, span = random.Random(seed), None, 0, 4.0
    for _ in range(number):
        begin = time.monotonic()
        with started(place, "--resume") as process:
            try:
                process.wait(chance.uniform(0.0, span))
            except subprocess.TimeoutExpired:
                process.kill()
            process.communicate()
        assert process.returncode in (0, -signal.SIGKILL)
        if (place / "out").exists():
            found = read(place / "out")
            if rows is not None:
                assert len(found) >= len(rows)
                assert all((found[name][: len(rows)] == rows[name]).all() for name in rows.table)
            rows = found
        if process.returncode == 0:
            span = 1.2 * (time.monotonic() - begin)
            done, rows = done + 1, None
            shutil.rmtree(place / "out")
    return done


@pytest.mark.parametrize("number", [3, pytest.param(25, marks=pytest.mark.stress)])
def test_killed_at_random_moments(scene, tmp_path, undisturbed, number):
    kills(tmp_path, number, seed=number)
    assert {entry.name for entry in tmp_path.iterdir()} <= {"scene.yaml", "out", ".out.staging", ".out.old"}
    resumed(tmp_path)
    same_numbers(tmp_path / "out", undisturbed(scene))
    assert {entry.name for entry in tmp_path.iterdir()} == {"scene.yaml", "out"}


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own with 200 kB."""
    place = tmp_path / "small"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("only root may mount a small disk")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


class TestDisk:
    SCENE = CONDENSED.replace("steps: 15", "steps: 150").replace("fields: all", "fields: none")

    def test_it_fills_up_and_is_given_room(self, small_disk, tmp_path, undisturbed):
        (small_disk / "scene.yaml").write_text(self.SCENE)
        with started(small_disk) as process:
            _, told = process.communicate(timeout=PATIENCE)
        assert process.returncode == 5 and "No space left on device" in told and "Traceback" not in told
        full = read(small_disk / "out")
        assert 0 < len(full) < 150 and full.report["exit_code"] == 5 and full.report["rows"] == len(full)
        subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
        resumed(small_disk)
        found, wanted = read(small_disk / "out"), read(undisturbed(self.SCENE))
        for name in ("step", "delta", "force", "a", "p_max", "energy"):  # 1e-8: what `same_numbers` asks for
            np.testing.assert_allclose(found[name], wanted[name], rtol=1e-8, err_msg=name)

    def test_a_disk_that_is_read_only(self, small_disk):
        (small_disk / "scene.yaml").write_text(self.SCENE)
        subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
        for output in ("out", "deep/out", "."):
            line = shlex.join([*RUN[:-1], output])
            done = subprocess.run(
                ["bash", "-c", line], cwd=small_disk, env=environment(), capture_output=True, text=True
            )
            assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
        assert os.listdir(small_disk) == ["scene.yaml"]
