"""dolfinx is loaded here, in surroundings that it can bear: it reads the command line, the home
folder and, from the working directory, settings that could have PETSc or the compiler run a
command.
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
from importlib import metadata
from pathlib import Path
from types import ModuleType

from indent_sim.process.errors import BackendError

KERNEL_FOLDER = (
    "fenics"  # dolfinx keeps its compiled kernels there, below XDG_CACHE_HOME [~/.cache]
)
logger = logging.getLogger("indent_sim")


def load_dolfinx() -> Path:
    """Import dolfinx, which keeps compiled kernels in the folder that is returned; BackendError
    when none will do.
    """
    _choose_folders()
    # its logger would take options from ours, and no odd file names
    arguments = sys.argv
    sys.argv = ["indent-sim"]
    sigpipe_handler = signal.getsignal(signal.SIGPIPE)
    try:
        import petsc4py

        petsc4py.init(
            ["indent-sim", "-skip_petscrc", "-no_signal_handler"]
        )  # which would end by exit 59
        with _change_to_root_folder(), _replace_pkg_resources():
            from indent_sim.fe import compat

            return compat.read_settings()
    finally:
        sys.argv = arguments
        if threading.current_thread() is threading.main_thread():
            signal.signal(
                signal.SIGPIPE, sigpipe_handler
            )  # PETSc would end a run that nobody listens to


@contextmanager
def _replace_pkg_resources() -> Iterator[None]:
    """importlib in place of pkg_resources, a tenth of all imports, of which UFL and FFCx 0.5 ask
    their versions.
    """
    if "pkg_resources" in sys.modules:
        yield
        return
    stand_in = ModuleType("pkg_resources")
    stand_in.get_distribution = metadata.distribution  # type: ignore[attr-defined]
    sys.modules["pkg_resources"] = stand_in
    try:
        yield
    finally:
        del sys.modules["pkg_resources"]


@contextmanager
def _change_to_root_folder() -> Iterator[None]:
    """Nobody's scene came with the settings that stand there."""
    try:
        working_directory = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    except OSError:  # it was deleted
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
    """Say where kernels and settings are when the home folder cannot be used: read-only, missing or
    no folder.
    """
    cache_folder = _environment_folder("XDG_CACHE_HOME", ".cache")
    if cache_folder is None or not _is_writable(cache_folder / KERNEL_FOLDER):
        cache_folder = Path(tempfile.gettempdir()) / f"indent-sim-{os.getuid()}"
        if (
            not _is_writable(cache_folder / KERNEL_FOLDER)
            or cache_folder.stat().st_uid != os.getuid()
        ):
            raise BackendError(
                "no folder for compiled kernels is writable; point XDG_CACHE_HOME to one that is"
            )
        logger.info(
            "compiled kernels are kept in %s: the home folder is not writable", cache_folder
        )
    os.environ["XDG_CACHE_HOME"] = str(cache_folder)
    settings_folder = _environment_folder("XDG_CONFIG_HOME", ".config")
    os.environ["XDG_CONFIG_HOME"] = str(
        settings_folder if settings_folder and _is_searchable(settings_folder) else cache_folder
    )


def _environment_folder(variable: str, inside_home: str) -> Path | None:
    """The folder of an environment variable, else one in the home folder, if there is such."""
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
    """Whether a file can be looked for in it; that there is none, or no folder, is an answer."""
    try:
        (folder / "ffcx").stat()
    except OSError as error:
        return isinstance(error, FileNotFoundError)
    return True
