"""Import of dolfinx in a controlled environment.

dolfinx and PETSc read the command line, the home folder, and settings files in the working
directory, which could make PETSc or the compiler run a command.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from indent_sim.process.errors import BackendError

logger = logging.getLogger("indent_sim")


def load_mpi() -> Any:
    """Import mpi4py and return its module MPI."""
    # The MPI library of PyPI is found only after this import; other installations do not have it.
    with suppress(ImportError):
        import dolfinx_solver  # noqa: F401
    from mpi4py import MPI

    return MPI


def load_dolfinx() -> Path:
    """Import dolfinx and return the folder of its compiled kernels.

    Raises
    ------
    BackendError
        If no folder for compiled kernels is writable.
    """
    _choose_folders()
    # The logger of dolfinx would read options from our command line
    arguments = sys.argv
    sys.argv = ["indent-sim"]
    sigpipe_handler = signal.getsignal(signal.SIGPIPE)
    try:
        load_mpi()
        import petsc4py

        # The signal handler of PETSc would end the program with exit code 59
        petsc4py.init(["indent-sim", "-skip_petscrc", "-no_signal_handler"])
        with _change_to_root_folder():
            from indent_sim.fe import compat

            return compat.kernel_folder()
    finally:
        sys.argv = arguments
        if threading.current_thread() is threading.main_thread():
            # PETSc would end a run whose output is no longer read
            signal.signal(signal.SIGPIPE, sigpipe_handler)


@contextmanager
def _change_to_root_folder() -> Iterator[None]:
    """Change to the root folder, so that no settings of the working directory are read."""
    try:
        working_directory = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    except OSError:  # the working directory was deleted
        yield
        return
    try:
        os.chdir("/")
        yield
    finally:
        with suppress(OSError):
            os.fchdir(working_directory)
        os.close(working_directory)


def _choose_folders() -> None:
    """Set XDG_CACHE_HOME and XDG_CONFIG_HOME to usable folders.

    The home folder may be read-only, missing or not a folder.
    """
    cache_folder = _environment_folder("XDG_CACHE_HOME", ".cache")
    # dolfinx keeps its compiled kernels in this folder of XDG_CACHE_HOME, by default ~/.cache.
    kernel_folder = "fenics"
    if cache_folder is None or not _is_writable(cache_folder / kernel_folder):
        cache_folder = Path(tempfile.gettempdir()) / f"indent-sim-{os.getuid()}"
        if (
            not _is_writable(cache_folder / kernel_folder)
            or cache_folder.stat().st_uid != os.getuid()
        ):
            raise BackendError(
                "no folder for compiled kernels is writable; set XDG_CACHE_HOME to a writable "
                "folder"
            )
        logger.info(
            "compiled kernels are kept in %s because the home folder is not writable", cache_folder
        )
    os.environ["XDG_CACHE_HOME"] = str(cache_folder)
    settings_folder = _environment_folder("XDG_CONFIG_HOME", ".config")
    os.environ["XDG_CONFIG_HOME"] = str(
        settings_folder if settings_folder and _is_searchable(settings_folder) else cache_folder
    )


def _environment_folder(variable: str, inside_home: str) -> Path | None:
    """Folder given by an environment variable, else `inside_home`; None if there is no home."""
    if given := os.environ.get(variable):
        return Path(given).absolute()
    try:
        return Path.home().absolute() / inside_home
    except RuntimeError:
        return None


def _is_writable(folder: Path) -> bool:
    try:
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _is_searchable(folder: Path) -> bool:
    """Return whether paths in the folder can be looked up, whether they exist or not."""
    try:
        (folder / "ffcx").stat()
    except OSError as error:
        return isinstance(error, FileNotFoundError)
    return True
