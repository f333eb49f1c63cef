"""Process in which gmsh runs, so that a crash of gmsh does not end the simulation."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from indent_sim.process.child_process import ChildProcess, ProcessCrash
from indent_sim.process.errors import BackendError, MeshError
from indent_sim.process.installation import solver_command

T = TypeVar("T")
Gmsh = Any  # The module gmsh, which is imported only where it meshes, or one of its CAD kernels.


def call_in_mesher(function: Callable[..., T], *arguments: object) -> Callable[[], T]:
    """Start a call in the mesher process and return a function that waits for its result.

    The function raises MeshError if the process crashes.
    """
    try:
        wait_for_result = _mesher.begin_call(function, *arguments)
    except OSError as error:
        raise BackendError(f"cannot start a process for gmsh: {error.strerror or error}") from error

    def wait_for_mesh() -> T:
        """Return the result of the call; raise MeshError if the mesher process crashed."""
        try:
            return wait_for_result()
        except ProcessCrash as crash:
            raise MeshError(f"gmsh could not mesh the body: its process {crash}") from None

    return wait_for_mesh


def start_mesher() -> None:
    """Start the mesher process, which imports gmsh while this process continues."""
    # If no process can be started, the first call in the mesher reports it.
    with suppress(OSError):
        _mesher.start()


# The one mesher of this process, as gmsh has global state.
_mesher = ChildProcess("indent_sim.mesh.gmsh", "indent_sim.mesh.loaded_gmsh")


@contextmanager
def gmsh_session() -> Iterator[Gmsh]:
    """Initialize gmsh with this program's options, yield the module, and finalize it."""
    # Importing, initializing and finalizing gmsh each replace the handler of SIGINT.
    handler = signal.getsignal(signal.SIGINT)
    try:
        from indent_sim.mesh.loaded_gmsh import gmsh
    except (ImportError, OSError) as error:
        raise BackendError(
            f"gmsh is missing or lacks a library ({error}); this line installs it: "
            f"{solver_command()}"
        ) from error
    gmsh.initialize([], False)  # Without user configuration the mesh depends on the scene alone.
    try:
        signal.signal(signal.SIGINT, handler)
        # gmsh prints errors only, and sizes come from the size field alone.
        options = {
            "General.Terminal": 1,
            "General.Verbosity": 1,
            "General.NumThreads": 1,
            "Mesh.MeshSizeExtendFromBoundary": 0,
            "Mesh.MeshSizeFromPoints": 0,
        }
        for option, value in options.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add("indent-sim")
        yield gmsh
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGINT, handler)
