"""A run that is killed, stopped or out of disk leaves a folder that can be read.

`--resume` ends at the same curve.
"""

from __future__ import annotations

import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from command_line import environment
from conftest import MPI_ENVIRONMENT
from resumed_runs import CONDENSED, HYPERELASTIC, same_numbers

from indent_sim.config.scene_file import load
from indent_sim.model.state import State
from indent_sim.process.errors import UsageError
from indent_sim.process.signals import Interrupted, raise_on_signals
from indent_sim.results.reader import Results, read, read_run
from indent_sim.run.pipeline import simulate

RUN = (sys.executable, "-m", "indent_sim.cli.commands", "run", "scene.yaml", "--output", "out")
SCENES = {"newton": HYPERELASTIC, "condensed": CONDENSED.replace("steps: 15", "steps: 60")}
PATIENCE = 180  # s


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A scene, written as scene.yaml."""
    (tmp_path / "scene.yaml").write_text(SCENES[request.param])
    return SCENES[request.param]


def started(place: Path, *words: str, before: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    """The run in a process of its own, started by `before`."""
    return subprocess.Popen(
        (*before, *RUN, *words),
        cwd=place,
        env=environment() | MPI_ENVIRONMENT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


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
        [
            ("newton", signal.SIGTERM, 143),
            ("condensed", signal.SIGINT, 130),
            ("condensed", signal.SIGHUP, 129),
        ],
        indirect=["scene"],
    )
    def test_stopped_and_resumed(self, scene, tmp_path, undisturbed, number, code):
        with started(tmp_path) as process:
            wait_for_rows(tmp_path, process, 2)
            process.send_signal(number)
            _, told = process.communicate(timeout=PATIENCE)
        assert (
            process.returncode == code and "--resume continues" in told and "Traceback" not in told
        )
        stopped = read(tmp_path / "out")
        assert (
            stopped.report["status"] == "interrupted"
            and 2 <= len(stopped) == stopped.report["rows"]
        )
        resumed(tmp_path)
        same_numbers(tmp_path / "out", undisturbed(scene))

    def test_a_library_may_hide_the_signal(self, tmp_path):
        """A signal is recognised also where PETSc's error hides its exception.

        An exception in a callback of PETSc comes out of it as PETSc's own error.
        """

        def hide(state: State, step: int, total: int) -> None:
            try:
                signal.raise_signal(signal.SIGTERM)
            except Interrupted:
                raise RuntimeError("error code 101") from None

        (tmp_path / "scene.yaml").write_text(CONDENSED)
        with pytest.raises(Interrupted), raise_on_signals():
            simulate(load(tmp_path / "scene.yaml"), directory=tmp_path / "out", progress=hide)
        report = read(tmp_path / "out").report
        assert (report["status"], report["exit_code"], report["rows"]) == ("interrupted", 143, 1)

    @pytest.mark.parametrize(
        "number",
        [
            signal.SIGTERM,
            *(
                pytest.param(other, marks=pytest.mark.stress)
                for other in (signal.SIGINT, signal.SIGHUP)
            ),
        ],
    )
    def test_on_two_ranks(self, tmp_path, undisturbed, number):
        """A signal to mpirun stops a run on two ranks, and --resume ends the same curve.

        mpirun passes the signal on; its own exit code only has to differ from 0.
        """
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
    """Kill the run of a place at random moments and resume it each time.

    A finished run is begun anew; returns how often one was. After every kill the folder can be
    read, and no row that was there has changed.
    """
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


@pytest.mark.parametrize("number", [3, pytest.param(8, marks=pytest.mark.stress)])
def test_killed_at_random_moments(scene, tmp_path, undisturbed, number):
    kills(tmp_path, number, seed=number)
    assert {entry.name for entry in tmp_path.iterdir()} <= {
        "scene.yaml",
        "out",
        ".out.staging",
        ".out.old",
    }
    resumed(tmp_path)
    same_numbers(tmp_path / "out", undisturbed(scene))
    assert {entry.name for entry in tmp_path.iterdir()} == {"scene.yaml", "out"}


START = (sys.executable, "-m", "indent_sim")
SENT = (
    signal.SIGKILL,
    signal.SIGTERM,
    signal.SIGINT,
    signal.SIGHUP,
    signal.SIGQUIT,
    signal.SIGUSR1,
    signal.SIGXCPU,
)
WITH_ACCURACY = CONDENSED.replace(
    "mesh: {h_contact: 0.12, h_far: 0.6}\n", "accuracy: 0.003\n"
).replace("fields: all", "fields: none")
STUDY = (
    "base: scene.yaml\nset: {loading.steps: 4}\nvary: {material.nu: [0.2, 0.3, 0.4], "
    "indenter.R: [1.0, 2.0]}\n"
)
AT_THE_END = {  # of each kind of run: the scene, the words before and after the program's
    "plain": (HYPERELASTIC, (), ()),
    "condensed": (SCENES["condensed"], (), ()),
    "error bars": (CONDENSED, (), ("--error-bars",)),
    "accuracy": (WITH_ACCURACY, (), ()),
    "study": (CONDENSED, (), ("--jobs", "2")),
    "two ranks": (HYPERELASTIC, ("mpirun", "-n", "2"), ()),
}


class Victim:
    """A kind of run that is ended at random moments and resumed, compared with `expected`."""

    def __init__(self, kind: str, place: Path, expected: Path):
        self.place, self.expected = place, expected
        self.scene, self.before, self.words = AT_THE_END[kind]
        place.mkdir(exist_ok=True)
        (place / "scene.yaml").write_text(self.scene)
        (place / "study.yaml").write_text(STUDY)
        if kind == "study":
            self.words = (*START, "study", "study.yaml", "--output", "out", "--resume", *self.words)
        else:
            self.words = (*START, *RUN[3:], "--resume", *self.words)
        self.seen: dict[str, tuple[str, dict[str, np.ndarray]]] = {}

    def end(self, after: float | None, number: int = 0) -> tuple[int, str]:
        """Begin or resume the run and send it a signal after some time.

        Returns the exit code and stderr.
        """
        words = (*self.before, *self.words)
        with subprocess.Popen(
            words,
            cwd=self.place,
            env=environment() | MPI_ENVIRONMENT,
            text=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        ) as process:
            try:
                process.wait(after or PATIENCE)
            except subprocess.TimeoutExpired:
                process.send_signal(number)
            _, told = process.communicate(timeout=PATIENCE)
        return process.returncode, told

    def look(self) -> None:
        """Assert that every result can be read and has the rows seen in it before.

        Rows of another mesh are not compared.
        """
        for report in [
            path for path in self.place.rglob("run.json") if ".staging" not in str(path)
        ]:
            try:
                found = read_run(report.parent)
            except UsageError:
                if report.parent.exists():
                    raise
                continue
            name, mesh = str(report.parent), str((found.report.get("mesh") or {}).get("hash"))
            rows = dict(found.table)
            old_mesh, old = self.seen.get(name, (mesh, {}))
            if old and old_mesh == mesh:
                for column in set(old) & set(rows):
                    np.testing.assert_array_equal(
                        rows[column][: len(old[column])], old[column], err_msg=name
                    )
            self.seen[name] = mesh, rows

    def finish(self) -> None:
        """Assert that a finished run has the rows of an undisturbed one."""
        for table in self.expected.rglob("force_indentation.csv"):
            found, wanted = (
                read(self.place / "out" / table.parent.relative_to(self.expected)),
                read(table.parent),
            )
            assert found.report["status"] == "done" and len(found) == len(wanted)
            for column in ("step", "delta", "force", "a", "p_max", "energy", "force_error"):
                if column in wanted.table:
                    size = np.nanmax(np.abs(wanted[column]))
                    near = 1e-8 if column != "force_error" else 1e-4  # a difference of forces
                    np.testing.assert_allclose(
                        found[column], wanted[column], rtol=near, atol=near * size, err_msg=column
                    )
        shutil.rmtree(self.place / "out")
        self.seen.clear()


@pytest.mark.stress
@pytest.mark.parametrize("kind", AT_THE_END)
def test_ended_by_any_signal_at_random_moments(kind, tmp_path):
    """Runs ended eight times by random signals lose nothing and end with undisturbed rows.

    Every end is in the table of exit codes or the signal's own.
    """
    whole = Victim(kind, tmp_path / "whole", tmp_path)
    code, told = whole.end(None)
    assert code == 0, told
    victim, chance, ends = (
        Victim(kind, tmp_path / "ended", whole.place / "out"),
        random.Random(kind),
        Counter(),
    )
    span = 4.0
    while sum(ends.values()) < 8:
        number, begin = chance.choice(SENT), time.monotonic()
        code, told = victim.end(chance.uniform(0.0, span), number)
        if "in use by another" in told:  # the ranks of an mpirun that was killed are on their way
            time.sleep(0.5)
            continue
        ends[code] += 1
        print(kind, dict(ends), flush=True)
        if number == signal.SIGINT and "Traceback" in told and "cli/commands" not in told:
            continue  # Python itself was starting, which has its own way to say so
        assert "Traceback" not in told, (number, told)
        assert victim.before or code in (0, -number, 128 + number), (number, code, told)
        victim.look()
        if code == 0:
            span = 1.1 * (time.monotonic() - begin)
            victim.finish()
    code, told = victim.end(None)
    assert code == 0, told
    victim.finish()
    assert {entry.name for entry in victim.place.iterdir()} == {"scene.yaml", "study.yaml"}


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
        assert (
            process.returncode == 5
            and "No space left on device" in told
            and "Traceback" not in told
        )
        full = read(small_disk / "out")
        assert (
            0 < len(full) < 150
            and full.report["exit_code"] == 5
            and full.report["rows"] == len(full)
        )
        subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
        resumed(small_disk)
        found, wanted = read(small_disk / "out"), read(undisturbed(self.SCENE))
        for name in (
            "step",
            "delta",
            "force",
            "a",
            "p_max",
            "energy",
        ):  # 1e-8: what `same_numbers` asks for
            np.testing.assert_allclose(found[name], wanted[name], rtol=1e-8, err_msg=name)

    def test_a_disk_that_is_read_only(self, small_disk):
        (small_disk / "scene.yaml").write_text(self.SCENE)
        subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
        for output in ("out", "deep/out", "."):
            line = shlex.join([*RUN[:-1], output])
            done = subprocess.run(
                ["bash", "-c", line],
                cwd=small_disk,
                env=environment(),
                capture_output=True,
                text=True,
            )
            assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
        assert os.listdir(small_disk) == ["scene.yaml"]
