"""Hostile mesh files end with an exit code and a message, in bounded time and memory."""

from __future__ import annotations

import os
import resource
import shutil
from collections import Counter
from pathlib import Path

import hostile_meshes
import pytest
from click.testing import CliRunner
from hostile_meshes import hostile

from indent_sim.cli import commands
from indent_sim.mesh import mesh_file
from indent_sim.process.errors import printable

SAMPLE = range(40)
OWN = 2.0  # s: what else a command takes, and reading a limit that is looked at once a second


def waited_for() -> tuple[float, float]:
    """CPU time [s] and largest memory [bytes] of all child processes that have ended."""
    found = resource.getrusage(resource.RUSAGE_CHILDREN)
    return found.ru_utime + found.ru_stime, found.ru_maxrss * 1024.0


def ended(seed: int, place: Path) -> tuple[int, float, float]:
    """Exit code of `plan` for a hostile mesh file, with CPU time [s] and memory [bytes].

    The memory is that of the reading process if it was the largest so far. Linux counts the memory
    of this process as its own.
    """
    place.mkdir()
    scene = hostile(seed, place)
    before, largest = waited_for()
    done = CliRunner().invoke(commands.program, ["plan", str(scene)])
    after, now = waited_for()
    seconds, memory = after - before, now if now > largest else 0.0
    assert done.exit_code in (0, 3, 4), (seed, done.stderr)
    assert "Traceback" not in done.stderr and (done.exit_code == 0 or done.stderr), (
        seed,
        done.stderr,
    )
    assert printable(done.stderr, line_breaks=True) == done.stderr and len(done.stderr) < 2000, seed
    size = sum(path.stat().st_size for path in place.iterdir())
    assert seconds <= mesh_file.READING_SECONDS[0] + mesh_file.READING_SECONDS[1] * size + OWN, (
        seed,
        seconds,
    )
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0
    assert memory <= own + mesh_file.READING_MEMORY[0] + mesh_file.READING_MEMORY[1] * size, (
        seed,
        memory,
    )
    return done.exit_code, seconds, memory


def all_end(seeds: range, place: Path) -> None:
    codes, worst = Counter[int](), (0.0, 0.0)
    for seed in seeds:
        code, seconds, memory = ended(seed, place / str(seed))
        codes[code] += 1
        worst = max(worst[0], seconds), max(worst[1], memory)
        shutil.rmtree(place / str(seed))
    print(
        f"seeds {seeds}: {dict(sorted(codes.items()))}, at worst {worst[0]:.1f} s and "
        f"{worst[1] / 1e6:.0f} MB"
    )
    assert codes[4] > len(seeds) // 3 and len(os.listdir(place)) == 0


def test_a_sample_ends_with_a_word(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hostile_meshes, "MOST_BYTES", 100_000)
    all_end(SAMPLE, tmp_path)


@pytest.mark.stress
def test_hundreds_end_with_a_word(tmp_path: Path) -> None:
    all_end(range(1000, 1150), tmp_path)
