"""Meshing in a child process: splits near corners, crashes, signals and locks."""

from __future__ import annotations

import errno
import fcntl
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import environment
from scenes import grid_of

from indent_sim.config.scene_file import loads
from indent_sim.mesh import gmsh, mesher_process
from indent_sim.mesh.grid import Grid
from indent_sim.process import usage
from indent_sim.process.child_process import ChildProcess, ProcessCrash
from indent_sim.process.errors import BackendError, ConfigError, MeshError
from indent_sim.run import pipeline
from indent_sim.scene.scene import Scene, resolve

SCENE = """\
body: {body}
material: {{model: linear_elastic, E: 1.0, nu: 0.3}}
indenter: {tip}
loading: {{delta: 0.01, steps: 1}}
mesh: {mesh}
"""
PATIENCE = 120  # s


def near_a_corner(kind: str, d: float, width: float, h: float) -> Scene:
    """A scene whose top is split at a distance d from a corner or from the axis."""
    strip = f"{{shape: strip, width: {width!r}, height: 1.0}}"
    round_body = f"{{shape: cylinder, radius: {width!r}, height: 1.0}}"
    body, tip, mesh = {
        "tip beside the left wall": (
            strip,
            f"{{shape: paraboloid, R: 1.0, center: [{d!r}]}}",
            "symmetry: full, ",
        ),
        "tip beside the right wall": (
            strip,
            f"{{shape: paraboloid, R: 1.0, center: [{width - d!r}]}}",
            "",
        ),
        "edge beside the wall": (round_body, f"{{shape: flat_punch, radius: {width - d!r}}}", ""),
        "edges beside both walls": (
            strip,
            f"{{shape: flat_punch, radius: {width / 2 - d!r}}}",
            "symmetry: full, ",
        ),
    }[kind]
    return resolve(
        loads(SCENE.format(body=body, tip=tip, mesh=f"{{{mesh}h_contact: {h!r}, h_far: 0.5}}"))
    )


def areas(grid: Grid) -> np.ndarray:
    """Signed areas of triangles."""
    a, b, c = (grid.points[grid.cells[:, i]] for i in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize(
    "kind",
    [
        "tip beside the left wall",
        "tip beside the right wall",
        "edge beside the wall",
        "edges beside both walls",
    ],
)
def test_a_split_near_a_corner_is_meshed(kind):
    """A body split very near a corner is meshed with its whole area and without flat triangles.

    Points nearer than gmsh's random shift change places: it aborted for distances of 1e-12 to 5e-9
    of the body.
    """
    chance = random.Random(kind)
    for power in range(-13, -5):
        d, width = chance.uniform(1, 10) * 10.0**power, chance.choice([1.0, chance.uniform(0.3, 5)])
        size = areas(grid_of(near_a_corner(kind, d, width, chance.choice([0.1, 0.02]))))
        assert size.sum() == pytest.approx(width, rel=1e-9) and (size > 0).all()


@pytest.mark.parametrize("place", [1.5, 1.4999999999985643])
def test_no_triangle_is_flat(place):
    """No triangle has three points on the top, where gmsh left one without area."""
    tip = f"{{shape: cone, half_angle: 70.0, center: [{place!r}]}}"
    scene = SCENE.format(
        body="{shape: strip, width: 2.0, height: 3.0, sides: fixed}", tip=tip, mesh="{}"
    )
    found = grid_of(resolve(loads(scene, overrides=["loading.delta=0.0005"])))
    assert areas(found).sum() == pytest.approx(2 / 3, rel=1e-9) and (areas(found) > 0).all()


def test_a_failure_by_chance_is_tried_again():
    """A mesh that fails by chance is tried with smaller random shifts.

    gmsh found facets of this box that cut one another; half of the shift does the same, a tenth
    does not.
    """
    body = "{shape: box, size: [2.0, 1.999999999999993, 0.3], base: fixed, sides: fixed}"
    tip = "{shape: cone, half_angle: 70.0, center: [0.9999999999999989, 1.000000001519999]}"
    found = grid_of(
        resolve(
            loads(SCENE.format(body=body, tip=tip, mesh="{}"), overrides=["loading.delta=4.92e-6"])
        )
    )
    assert len(found.cells) > 10_000 and not gmsh.has_flat_cells(found)


def test_a_flat_cell_is_told():
    """A flat cell is found, and a triangle as thin as beside the narrowest split is not one.

    The flat cell has three points of the upper side of a square.
    """
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 1.0], [1e-8, 0.0]])
    halves = [[0, 1, 2], [0, 2, 3], [0, 5, 3]]
    assert not gmsh.has_flat_cells(Grid(points, np.array(halves)))
    assert gmsh.has_flat_cells(Grid(points, np.array([*halves, [2, 4, 3]])))


@pytest.mark.parametrize(
    ("flat", "told"),
    [
        (
            100,
            "a mesh.h_contact 1.1 and 0.9 times as large was tried, with which the body "
            "cannot be meshed either",
        ),
        (3, "a mesh.h_contact 1.1 times as large was tried, with which the body can be meshed"),
        (6, "a mesh.h_contact 0.9 times as large was tried, with which the body can be meshed"),
    ],
)
def test_a_mesh_that_stays_flat_is_refused(monkeypatch, flat, told):
    """A mesh that stays flat is refused, and the message names the sizes that were tried.

    Each size is meshed with three shifts.
    """
    seen = []

    def is_flat(grid):
        seen.append(len(grid.cells))
        return len(seen) <= flat

    monkeypatch.setattr(gmsh, "has_flat_cells", is_flat)
    scene = resolve(loads(SMALL))
    with pytest.raises(MeshError, match=f"cells with zero volume; {told}"):
        gmsh.mesh_domain(scene.physics.domain, scene.sizes)


def test_a_dropped_split_does_not_change_the_force():
    """Punches 5e-9 and 2e-9 narrower than the body have the same force to 1e-8."""
    (wide,), (narrow,) = (
        pipeline.states(near_a_corner("edge beside the wall", d, 1.0, 0.1)) for d in (2e-9, 5e-9)
    )
    assert narrow.force == pytest.approx(wide.force, rel=1e-8)


@pytest.mark.parametrize("radius", [1e-9, 1e-7, 9e-6])
def test_an_edge_lost_in_the_tolerance_of_the_cad_kernel_is_refused(radius):
    body, tip = "{shape: box, size: [1.0, 1.0, 1.0]}", f"{{shape: flat_punch, radius: {radius!r}}}"
    with pytest.raises(ConfigError, match="too small for a box") as refused:
        resolve(loads(SCENE.format(body=body, tip=tip, mesh="{h_contact: 0.2}")))
    assert refused.value.key == "indenter.radius"


# ---- the process
# ------------------------------------------------------------------------------------------------


@pytest.fixture
def child() -> Iterator[ChildProcess]:
    """A child process that is ended after the test."""
    process = ChildProcess()
    yield process
    process.stop()


def call(child: ChildProcess, text: str) -> Any:
    """Value of an expression evaluated in a child process."""
    return child.begin_call(eval, text)()


def process_id(child: ChildProcess) -> int:
    return int(call(child, "__import__('os').getpid()"))


class TestChildProcess:
    def test_it_answers_and_its_exceptions_are_raised_here(self, child):
        assert child.begin_call(divmod, 7, 2)() == (3, 1)
        with pytest.raises(ZeroDivisionError):
            child.begin_call(divmod, 7, 0)()
        assert child.begin_call(divmod, 9, 2)() == (4, 1)

    def test_large_arrays_go_both_ways(self, child):
        numbers = np.arange(10**6, dtype=float)
        assert np.array_equal(child.begin_call(np.negative, numbers)(), -numbers)

    @pytest.mark.parametrize(
        ("ending", "how"),
        [
            ("os.abort()", "SIGABRT"),
            (
                "(os.write(1, b'Info    : a\\nError   : it is odd\\n'), os.kill(os.getpid(), 11))",
                r"SIGSEGV \(it is odd\)",
            ),
            ("os.kill(os.getpid(), 9)", "SIGKILL"),
            ("os._exit(3)", "ended with exit code 3"),
        ],
    )
    def test_a_crash_is_an_exception_and_the_next_call_is_answered(self, child, capfd, ending, how):
        with pytest.raises(ProcessCrash, match=how):
            child.begin_call(exec, f"import os; {ending}")()
        assert child.begin_call(divmod, 7, 2)() == (3, 1)
        assert capfd.readouterr() == ("", "")

    def test_a_crash_between_two_calls_goes_unnoticed(self, child):
        pid = process_id(child)
        os.kill(pid, signal.SIGKILL)
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # on a busy machine that takes a while
        assert process_id(child) != pid

    def test_an_answer_that_nobody_waits_for_is_no_other_calls(self, child):
        late = child.begin_call(divmod, 7, 2)
        assert child.begin_call(divmod, 9, 2)() == (4, 1)
        with pytest.raises(ProcessCrash):
            late()

    def test_a_signal_ends_the_waiting_and_the_process(self, child):
        pid = process_id(child)
        answer = child.begin_call(time.sleep, 60.0)
        before = signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        try:
            with pytest.raises(KeyboardInterrupt):
                answer()
        finally:
            signal.signal(signal.SIGALRM, before)
        assert not Path(f"/proc/{pid}").exists() and child.begin_call(divmod, 7, 2)() == (3, 1)

    def test_it_holds_no_lock(self, child, tmp_path):
        """A child process does not hold the lock of a file that was open when it started.

        Otherwise a result folder would stay in use for as long as the process lives.
        """
        with open(tmp_path / ".lock", "w") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            child.start()
        with open(tmp_path / ".lock") as again:
            fcntl.flock(again, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def test_it_holds_a_lock_that_it_is_given(self, tmp_path):
        with open(tmp_path / ".lock", "w") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            child = ChildProcess(inherited_files=(held.fileno(),))
            child.start()
        with open(tmp_path / ".lock") as again:
            with pytest.raises(BlockingIOError):
                fcntl.flock(again, fcntl.LOCK_EX | fcntl.LOCK_NB)
            child.stop()
            fcntl.flock(again, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def test_a_fork_of_its_owner_has_its_own(self, child):
        pid = process_id(child)
        fork = os.fork()
        if fork == 0:
            is_another = process_id(child) != pid
            child.stop()
            os._exit(0 if is_another else 1)
        assert os.waitpid(fork, 0)[1] == 0 and process_id(child) == pid

    def test_a_file_in_the_working_directory_is_no_library(self, child, tmp_path, monkeypatch):
        (tmp_path / "pickle.py").write_text("import os; os.abort()")
        monkeypatch.chdir(tmp_path)
        assert child.begin_call(divmod, 7, 2)() == (3, 1)

    @pytest.mark.parametrize("work", ["time.sleep(60)", "sum(range(10**11))"])
    def test_it_ends_when_its_owner_is_killed(self, work):
        script = f"""
import os, signal
from indent_sim.process.child_process import ChildProcess
child = ChildProcess()
print(child.begin_call(os.getpid)(), flush=True)
child.begin_call(exec, "import time; {work}")
os.kill(os.getpid(), signal.SIGKILL)
"""
        ended = subprocess.run(
            [sys.executable, "-c", script],
            env=environment(),
            stdout=subprocess.PIPE,
            text=True,
        )
        deadline = time.monotonic() + PATIENCE
        while is_alive(int(ended.stdout)):
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def test_its_time_is_counted(self, child):
        process_id(child)
        before = usage.cpu_time()
        child.begin_call(exec, "import time\nwhile time.process_time() < 1.0: pass")()
        # 0.5 s: what the process used before, which is not that of the call, and this one meanwhile
        assert usage.cpu_time() - before == pytest.approx(1.0, abs=0.5)


def is_alive(pid: int) -> bool:
    """Whether a process exists that is more than a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


# ---- what a user sees
# -------------------------------------------------------------------------------------------

SMALL = SCENE.format(
    body="{shape: cylinder, radius: 1.0, height: 1.0}",
    tip="{shape: paraboloid, R: 1.0}",
    mesh="{h_contact: 0.1, h_far: 0.5}",
)


def with_another_gmsh(place: Path, text: str) -> dict[str, str]:
    """Environment in which the module gmsh does something else when it is initialized."""
    (place / "modules").mkdir()
    lines = ["import os, time", "def initialize(*options):", f"    {text}"]
    (place / "modules" / "gmsh.py").write_text("\n".join(lines))
    (place / "scene.yaml").write_text(SMALL)
    search = os.pathsep.join(filter(None, [str(place / "modules"), environment()["PYTHONPATH"]]))
    return environment() | {"PYTHONPATH": search}


RUN = ("-m", "indent_sim.cli.commands", "run", "scene.yaml", "--output", "out")


class TestRun:
    def test_an_abort_of_gmsh_is_exit_4_and_one_sentence(self, tmp_path):
        ended = subprocess.run(
            [sys.executable, *RUN],
            cwd=tmp_path,
            env=with_another_gmsh(tmp_path, "os.abort()"),
            capture_output=True,
            text=True,
        )
        assert ended.returncode == 4 and ended.stdout == ""
        assert (
            ended.stderr
            == "error: gmsh could not mesh the body: its process was ended by the signal SIGABRT\n"
        )

    def test_an_abort_of_gmsh_on_two_ranks(self, mpirun, tmp_path, monkeypatch):
        monkeypatch.setenv("PYTHONPATH", with_another_gmsh(tmp_path, "os.abort()")["PYTHONPATH"])
        ended = mpirun(2, *RUN)
        assert ended.returncode == 4 and ended.stderr.count("was ended by the signal SIGABRT") == 1

    @pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
    def test_a_signal_to_all_processes_ends_both(self, tmp_path, number, code):
        """A signal to the whole group in the middle of gmsh's work ends both processes.

        Ctrl-C in a terminal and batch systems send signals that way.
        """
        work = "open('pid', 'w').write(str(os.getpid())); time.sleep(300)"
        with subprocess.Popen(
            [sys.executable, *RUN],
            cwd=tmp_path,
            env=with_another_gmsh(tmp_path, work),
            text=True,
            stderr=subprocess.PIPE,
            start_new_session=True,
        ) as process:
            deadline = time.monotonic() + PATIENCE
            while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
                assert process.poll() is None and time.monotonic() < deadline
                time.sleep(0.02)
            time.sleep(0.5)  # dolfinx is loaded meanwhile, which holds signals back
            os.killpg(process.pid, number)
            _, told = process.communicate(timeout=PATIENCE)
        assert process.returncode == code and "Traceback" not in told
        assert not is_alive(int((tmp_path / "pid").read_text()))

    def test_without_room_for_a_process_a_sentence_says_so(self, monkeypatch):
        def refuse(*words: Any, **options: Any) -> None:
            raise BlockingIOError(errno.EAGAIN, "no room")

        mesher_process._mesher.stop()
        monkeypatch.setattr(subprocess, "Popen", refuse)
        with pytest.raises(BackendError, match="cannot start a process for gmsh: no room"):
            grid_of(resolve(loads(SMALL)))
