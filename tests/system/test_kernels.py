"""A cold cache of compiled kernels: one message, quiet compilers, and leftovers are cleared."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCENE = """\
body: {shape: cylinder, radius: 1.0, height: 1.0}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 1}
mesh: {h_contact: 0.05, h_far: 0.5}
solver: {method: newton}
output: {plot: false, fields: none}
"""
COMPILING = "compiling kernels (first run only)"
RUN = [sys.executable, "-m", "indent_sim.cli.commands", "run", "scene.yaml", "--output"]
PATIENCE = 300  # s
Run = Callable[[], "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scene and with a cache of its own."""
    folder = tmp_path_factory.mktemp("cold")
    (folder / "scene.yaml").write_text(SCENE)
    return folder


@pytest.fixture(scope="module")
def environment(place: Path) -> dict[str, str]:
    search = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return os.environ | {"XDG_CACHE_HOME": str(place / "cache"), "PYTHONPATH": search}


@pytest.fixture(scope="module")
def run(place: Path, environment: dict[str, str]) -> Run:
    """A function that runs the scene in a process of its own."""

    def start() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*RUN, "out"],
            cwd=place,
            env=environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )

    return start


@pytest.fixture(scope="module")
def cache(run: Run, place: Path) -> Path:
    """The folder of kernels after a first run, which says that it compiles and nothing of how."""
    cold = run()
    assert cold.returncode == 0, cold.stderr
    assert cold.stdout == "out\n" and cold.stderr.count(COMPILING) == 1
    assert "INFO" not in cold.stderr and "gcc" not in cold.stderr and "build_ext" not in cold.stderr
    (folder,) = (place / "cache" / "fenics").iterdir()
    return folder


def files_of_a_kernel(cache: Path) -> dict[str, Path]:
    """The files of one kernel by their suffixes."""
    name = min(path.name for path in cache.glob("*.c")).removesuffix(".c")
    return {path.name.removeprefix(name): path for path in cache.glob(f"{name}.*")}


def test_kernels_are_compiled_once(run: Run, cache: Path) -> None:
    warm = run()
    assert warm.returncode == 0 and COMPILING not in warm.stderr


def test_what_a_killed_run_left_is_compiled_again(run: Run, cache: Path) -> None:
    files = files_of_a_kernel(cache)
    for suffix, path in files.items():
        if suffix != ".c":
            path.unlink()
    mended = run()
    assert mended.returncode == 0 and COMPILING in mended.stderr, mended.stderr
    assert files[".c.cached"].exists()
    assert COMPILING not in run().stderr


def test_a_library_that_is_gone_is_a_sentence(run: Run, cache: Path) -> None:
    (library,) = (
        path for suffix, path in files_of_a_kernel(cache).items() if suffix.endswith(".so")
    )
    content = library.read_bytes()
    library.unlink()
    broken = run()
    library.write_bytes(content)
    assert broken.returncode == 7 and f"delete the folder {cache}" in broken.stderr
    assert "Traceback" not in broken.stderr


def test_a_run_waits_for_another_process_that_compiles(
    place: Path, environment: dict[str, str], cache: Path
) -> None:
    with (
        open(cache / "lock", "w") as lock,
        subprocess.Popen(
            [*RUN, "waited"], cwd=place, env=environment, stderr=subprocess.PIPE, text=True
        ) as process,
    ):
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "waiting for another process that compiles" in line and process.poll() is None
        fcntl.flock(lock, fcntl.LOCK_UN)
        process.communicate(timeout=PATIENCE)
    assert process.returncode == 0


@pytest.mark.stress
def test_six_cold_runs_at_once(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE)
    cold = environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    runs = [
        subprocess.Popen([*RUN, str(k)], cwd=tmp_path, env=cold, stderr=subprocess.PIPE, text=True)
        for k in range(6)
    ]
    told = [run.communicate(timeout=900)[1] for run in runs]
    assert [run.returncode for run in runs] == [0] * 6, told
    assert not any("Traceback" in text for text in told)


def test_a_caller_without_logging_sees_no_compiler(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    """A notebook or script without logging sees no command lines of the compiler.

    setuptools lowers the level of the root logger and writes each command line to it.
    """
    (tmp_path / "scene.yaml").write_text(SCENE)
    program = "import indent_sim; list(indent_sim.states(indent_sim.load('scene.yaml')))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
