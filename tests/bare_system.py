"""A Python without POSIX modules and without the solver, as on Windows after `pip install`.

It cannot stand in for the paths, consoles and locks of Windows.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

POSIX_MODULES = {"fcntl", "grp", "pwd", "resource", "termios", "tty", "pty", "syslog"}
SOLVER_MODULES = {
    "basix",
    "dolfinx",
    "dolfinx_solver",
    "ffcx",
    "gmsh",
    "h5py",
    "mpi4py",
    "petsc4py",
    "ufl",
}
# What Python for Windows lacks, except what other packages and Python itself use on this system.
POSIX_NAMES = {
    os: (
        *("O_NOFOLLOW", "O_NONBLOCK", "O_DIRECTORY", "chown", "fchdir", "fchmod", "fork"),
        *("getpgid", "killpg", "mkfifo", "pread", "pwrite", "setsid", "sysconf_names"),
    ),
    signal: ("SIGHUP", "SIGBUS", "SIGPIPE", "SIGXCPU", "SIGALRM", "pthread_sigmask"),
}


class Hidden:
    """Finder that finds none of the hidden modules, though they are installed."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Raise ModuleNotFoundError for a hidden module."""
        if name.partition(".")[0] in POSIX_MODULES | SOLVER_MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


def hide() -> None:
    """Hide the modules and names from everything that is imported from now on."""
    for name in [name for name in sys.modules if name in POSIX_MODULES]:
        del sys.modules[name]
    sys.meta_path.insert(0, Hidden())
    for module, names in POSIX_NAMES.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)


def start_up(folder: Path) -> dict[str, str]:
    """Environment in which Python, also of child processes, hides them before anything else."""
    from command_line import environment

    folder.mkdir()
    (folder / "sitecustomize.py").write_text("import bare_system\n\nbare_system.hide()\n")
    given = environment()
    path = os.pathsep.join([str(folder), str(Path(__file__).parent), given["PYTHONPATH"]])
    return given | {"PYTHONPATH": path}
