"""A cold cache of compiled kernels: one line says so, compilers keep quiet, and what a killed run left is cleared."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCENE = """\
body: {shape: cylinder, radius: 1.0, height: 1.0}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 1}
mesh: {h_contact: 0.05, h_far: 0.5}
output: {plot: false, fields: none}
"""
LINE = "compiling kernels (first run only)"


@pytest.fixture(scope="module")
def indent_sim(tmp_path_factory):
    """A function that runs the scene in a process of its own, with a cache of its own; and that cache."""
    folder = tmp_path_factory.mktemp("cold")
    (folder / "scene.yaml").write_text(SCENE)
    environment = os.environ | {
        "XDG_CACHE_HOME": str(folder / "cache"),
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
    }

    def start() -> subprocess.CompletedProcess[str]:
        words = [sys.executable, "-m", "indent_sim.cli", "run", "scene.yaml"]
        return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)

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

    # what a kill leaves: a claim, and nobody who will make it good
    victim = entries(cache, ".c.cached")[0]
    name = victim.name.removesuffix(".c.cached")
    for path in cache.glob(f"{name}*"):
        if path.name != f"{name}.c":
            path.unlink()
    os.utime(cache / f"{name}.c", (time.time() - 3600,) * 2)
    begin = time.monotonic()
    mended = start()
    assert mended.returncode == 0, mended.stderr
    assert LINE in mended.stderr and victim.exists()
    assert time.monotonic() - begin < 60

    # what a full disk or a power failure leaves: finished, and cut off
    for library, length in zip(entries(cache, ".so"), (0, 5000), strict=False):
        os.truncate(library, length)
    again = start()
    assert again.returncode == 0 and LINE in again.stderr, again.stderr
    assert LINE not in start().stderr


def test_an_entry_that_somebody_works_on_is_waited_for(tmp_path, monkeypatch):
    from indent_sim.fe import kernels

    calls = []

    def wait(name, objects, cache, timeout):
        calls.append(name)
        if len(calls) < 3:
            raise TimeoutError
        return ["kernel"], "module"

    monkeypatch.setattr(kernels, "_found", wait)
    (tmp_path / "one.c").touch()
    assert kernels.lookup("one", [], tmp_path, 10) == (["kernel"], "module")
    assert len(calls) == 3 and (tmp_path / "one.c").exists()


def test_a_stale_entry_is_removed_and_a_finished_one_is_not(tmp_path, monkeypatch):
    from indent_sim.fe import kernels

    monkeypatch.setattr(kernels, "_found", lambda *arguments: (["kernel"], "module"))
    for name in ("stale", "done"):
        (tmp_path / f"{name}.c").touch()
        os.utime(tmp_path / f"{name}.c", (0, 0))
    (tmp_path / "done.c.cached").touch()
    for name in ("stale", "done", "absent"):
        kernels.lookup(name, [], tmp_path, 10)
    assert [path.name for path in entries(tmp_path, ".c")] == ["done.c"]
