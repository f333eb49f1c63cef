"""Blocks of commands in the documentation, and a shell in which they are run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)


def environment(folder: Path) -> dict[str, str]:
    """Environment in which `indent-sim` is the program of this checkout."""
    bin_ = folder / ".bin"
    bin_.mkdir(exist_ok=True)
    script = bin_ / "indent-sim"
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m indent_sim.cli.commands "$@"\n')
    script.chmod(0o755)
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return os.environ | {
        "PATH": f"{bin_}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": path,
        "MPLBACKEND": "agg",
    }


DIFFERS = "indent-sim compare results/reference results/current"  # as its page says: exit code 6


def followed(commands: list[str], folder: Path) -> None:
    """Run commands one after the other in a folder and assert their exit codes."""
    for command in commands:
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command],
            cwd=folder,
            env=environment(folder),
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == (6 if command == DIFFERS else 0), (
            f"{command}\n{done.stdout}{done.stderr}"
        )
