"""Command lines that start the program of this checkout."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def command(*words: str | Path) -> list[str]:
    """Command line of the program with these words."""
    return [sys.executable, "-m", "indent_sim.cli.commands", *map(str, words)]


def environment() -> dict[str, str]:
    """Environment in which the program of this checkout is imported first."""
    return os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    }


def ran(*words: str | Path, code: int = 0) -> str:
    """Run the program in the checkout, assert its exit code, and return its standard output."""
    done = subprocess.run(command(*words), cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == code, done.stderr
    return done.stdout
