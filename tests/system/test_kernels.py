"""A cold cache of compiled kernels: one line says so, compilers keep quiet, and what a killed run
left is cleared.
"""

from __future__ import annotations

import importlib.util
import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from indent_sim.fe import kernel_cache

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
LINE = "compiling kernels (first run only)"


@pytest.fixture(scope="module")
def indent_sim(tmp_path_factory):
    """A function that runs the scene in a process of its own, with a cache of its own; and that
    cache.
    """
    folder = tmp_path_factory.mktemp("cold")
    (folder / "scene.yaml").write_text(SCENE)
    environment = os.environ | {
        "XDG_CACHE_HOME": str(folder / "cache"),
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
    }

    def start() -> subprocess.CompletedProcess[str]:
        words = [sys.executable, "-m", "indent_sim.cli.commands", "run", "scene.yaml"]
        return subprocess.run(
            words, cwd=folder, env=environment, capture_output=True, text=True, timeout=300
        )

    return start, folder / "cache" / "fenics"


def entries(cache: Path, suffix: str) -> list[Path]:
    return sorted(path for path in cache.iterdir() if path.name.endswith(suffix))


def test_cold_warm_and_half_written(indent_sim):
    start, cache = indent_sim
    cold = start()
    assert cold.returncode == 0, cold.stderr
    assert cold.stdout == "results/scene\n" and cold.stderr.count(LINE) == 1
    assert "INFO" not in cold.stderr and "gcc" not in cold.stderr and "build_ext" not in cold.stderr

    warm = start()
    assert warm.returncode == 0 and LINE not in warm.stderr

    # what a kill leaves: a claim, its lock open again, and nobody who will make it good
    victim = entries(cache, ".c.cached")[0]
    name = victim.name.removesuffix(".c.cached")
    for path in cache.glob(f"{name}*"):
        if path.name not in (f"{name}.c", f"{name}.lock"):
            path.unlink()
    begin = time.monotonic()
    mended = start()
    assert mended.returncode == 0, mended.stderr
    assert LINE in mended.stderr and victim.exists()
    assert time.monotonic() - begin < kernel_cache.STALE_AFTER

    # what a full disk or a power failure leaves: finished, and cut off
    for library, length in zip(entries(cache, ".so"), (0, 5000), strict=False):
        os.truncate(library, length)
    again = start()
    assert again.returncode == 0 and LINE in again.stderr, again.stderr

    # what somebody leaves who tidies up, or a Python of another version: finished, and no library
    # to load
    entries(cache, ".so")[0].unlink()
    once_more = start()
    assert once_more.returncode == 0 and LINE in once_more.stderr, once_more.stderr
    assert LINE not in start().stderr


# ---- several processes and one cache


def another_cache(lookup: Callable[..., Any], compilation: Callable[..., Any]) -> ModuleType:
    """A fresh copy of the kernel cache, on an FFCx of these two functions."""
    spec = importlib.util.spec_from_file_location(kernel_cache.__name__, kernel_cache.__file__)
    assert spec and spec.loader
    copy = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copy)
    copy.jit = SimpleNamespace(get_cached_module=lookup, _compile_objects=compilation)
    return copy


def cheap_cache(folder: Path, seconds: float) -> ModuleType:
    """A kernel cache whose FFCx writes its files without a compiler, in so many seconds.

    Every compilation writes a line to `compiled`.
    """

    def lookup(module_name, object_names, cache_dir, timeout):
        if (folder / f"{module_name}.c.cached").exists():
            return ["kernel"], "module"
        try:
            (folder / f"{module_name}.c").touch(exist_ok=False)
        except FileExistsError:
            raise TimeoutError("nobody should have to wait here") from None
        return None, None

    def compilation(decl, ufl_objects, object_names, module_name, options, cache_dir):
        with (folder / "compiled").open("a") as log:
            log.write(f"{os.getpid()}\n")
        time.sleep(seconds)
        finish(folder, module_name)

    cache = another_cache(lookup, compilation)
    assert cache.lock_ffcx_cache()
    return cache


def finish(folder: Path, module: str) -> None:
    """A library with nothing in it, and the mark that it is done."""
    (folder / f"{module}.so").write_bytes(bytes(64))
    (folder / f"{module}.c.cached").touch()


def race(folder: Path, runs: int, seconds: float) -> list[Any]:
    """Processes that all need the same kernel at the same time."""

    def run() -> None:
        cache = cheap_cache(folder, seconds)
        if cache.find_cached_module("one", [], folder, 10)[0] is None:
            cache.compile_kernels("", [], [], "one", {}, folder)
        assert cache.find_cached_module("one", [], folder, 10) == (["kernel"], "module")

    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=run) for _ in range(runs)]
    for process in processes:
        process.start()
    return processes


def compilations(folder: Path) -> list[int]:
    """Who compiled, in turn."""
    log = folder / "compiled"
    return [int(line) for line in log.read_text().split()] if log.exists() else []


def ends(processes: list[Any]) -> list[int]:
    for process in processes:
        process.join(20)  # s: far beyond what these compilations take
    return [process.exitcode for process in processes]


def test_one_process_compiles_and_the_others_wait(tmp_path):
    assert ends(race(tmp_path, 12, seconds=0.3)) == [0] * 12
    assert len(compilations(tmp_path)) == 1


def test_another_process_takes_over_from_a_killed_one(tmp_path):
    """At once: nobody waits for the age of what it left."""
    processes = race(tmp_path, 6, seconds=2.0)
    while not compilations(tmp_path):
        time.sleep(0.01)
    os.kill(compilations(tmp_path)[0], signal.SIGKILL)
    assert sorted(ends(processes)) == [-signal.SIGKILL] + [0] * 5
    assert len(compilations(tmp_path)) == 2


class TestAnotherFFCx:
    """Its functions are not promised: what is not known is left as it is, with a word."""

    @pytest.mark.parametrize("other", ["missing", "another"])
    @pytest.mark.parametrize("name", kernel_cache.EXPECTED_FFCX_FUNCTIONS)
    def test_is_left_alone(self, caplog, name, other):
        caplog.set_level("INFO", "indent_sim")
        cache = another_cache(a_lookup, a_compilation)
        if other == "missing":
            delattr(cache.jit, name)
        else:
            setattr(cache.jit, name, lambda key, folder: None)
        before = dict(vars(cache.jit))
        assert not cache.lock_ffcx_cache() and vars(cache.jit) == before
        assert "does not allow the kernel cache to be locked" in caplog.text

    def test_one_that_is_known_is_watched(self, tmp_path):
        asked = []

        def lookup(module_name, object_names, cache_dir, timeout):
            asked.append(module_name)
            return None, None

        cache = another_cache(lookup, a_compilation)
        assert cache.lock_ffcx_cache() and cache.lock_ffcx_cache()
        assert cache.jit.get_cached_module is cache.find_cached_module
        assert cache.find_cached_module("one", [], tmp_path, 10) == (None, None)
        assert asked == ["one"]

    def test_the_one_here_is_known_and_untouched_by_an_import(self):
        program = """
from ffcx.codegeneration import jit
own = jit.get_cached_module
from indent_sim.fe import kernel_cache, solver
assert jit.get_cached_module is own and kernel_cache.lock_ffcx_cache()
assert jit.get_cached_module is kernel_cache.find_cached_module
"""
        subprocess.run([sys.executable, "-c", program], check=True)


def a_lookup(module_name, object_names, cache_dir, timeout):
    return None, None


def a_compilation(decl, ufl_objects, object_names, module_name, options, cache_dir):
    return None


class TestAnotherProgramsEntry:
    """One without a lock: it is waited for as long as it changes, by the clock of who waits."""

    @pytest.fixture
    def cache(self, tmp_path, caplog):
        caplog.set_level("INFO", "indent_sim")
        cache = cheap_cache(tmp_path, 0.0)
        cache.STALE_AFTER = 0.3
        return cache

    @pytest.mark.parametrize("age", [3600.0, 0.0, -3600.0])
    def test_left_behind(self, cache, tmp_path, caplog, age):
        """The clock of a file server may be another one than that of this machine."""
        (tmp_path / "one.c").touch()
        os.utime(tmp_path / "one.c", (time.time() - age,) * 2)
        begin = time.monotonic()
        assert cache.find_cached_module("one", [], tmp_path, 10) == (None, None)
        assert 0.3 <= time.monotonic() - begin < 5
        assert f"waiting for another program that compiles {tmp_path / 'one.c'}" in caplog.text

    def test_finished_in_the_meantime(self, cache, tmp_path):
        (tmp_path / "one.c").touch()
        later = threading.Timer(0.1, finish, (tmp_path, "one"))
        later.start()
        assert cache.find_cached_module("one", [], tmp_path, 10) == (["kernel"], "module")
        assert (tmp_path / "one.c").exists()


@pytest.mark.stress
def test_six_cold_runs_at_once(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-m", "indent_sim.cli.commands", "run", "scene.yaml", "--output"]
    runs = [
        subprocess.Popen(
            [*words, str(k)], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
        )
        for k in range(6)
    ]
    told = [run.communicate(timeout=900)[1] for run in runs]
    assert [run.returncode for run in runs] == [0] * 6, told
    assert not any("Traceback" in text for text in told)


def test_a_caller_without_logging_sees_no_compiler(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A notebook or script: setuptools lowers the level of the root logger and writes each command
    line to it.
    """
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])
    monkeypatch.setattr(root, "level", logging.WARNING)

    def compiled(decl, ufl_objects, object_names, module_name, options, cache_dir):
        root.setLevel(logging.INFO)
        logging.info("gcc -shared")
        return "done"

    cache = another_cache(a_lookup, compiled)
    assert cache.lock_ffcx_cache()
    assert cache.compile_kernels("", [], [], "module", {}, tmp_path) == "done"
    assert capfd.readouterr().err == ""
    assert (root.handlers, root.level) == ([], logging.WARNING)
