"""Process in which gmsh runs, so that a crash of gmsh does not end the simulation."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, TypeVar

from indent_sim.process.errors import BackendError, MeshError
from indent_sim.process.forked_process import ForkedProcess, ProcessCrash
from indent_sim.process.ranks import is_parallel

T = TypeVar("T")
Gmsh = Any  # The module gmsh, which is imported only where it meshes, or one of its CAD kernels.
# gmsh prints errors only, and sizes come from the size field alone.
GMSH_OPTIONS = {
    "General.Terminal": 0,
    "General.Verbosity": 1,
    "General.NumThreads": 1,
}
GMSH_OPTIONS |= {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeFromPoints": 0}


def call_in_mesher(
    failure: str, function: Callable[..., T], *arguments: object, **child_arguments: object
) -> Callable[[], T]:
    """Start a call in the mesher process and return a function that waits for its result.

    On several ranks the arrays stay in a temporary file, from which they are distributed. The
    function is called in this process if the mesher process was not started before MPI, or cannot
    be started.

    Parameters
    ----------
    failure
        First words of the MeshError that is raised if the process crashes.
    function, arguments
        The call.
    child_arguments
        Keyword arguments that only the mesher process passes.
    """
    call = partial(function, *arguments)
    if not _mesher.is_running and is_parallel():
        return call
    try:
        wait_for_result = _mesher.begin_call(partial(call, **child_arguments), mapped=is_parallel())
    except OSError:
        return call

    def wait_for_mesh() -> T:
        """Return the result of the call; MeshError if the mesher process crashed."""
        try:
            return wait_for_result()
        except ProcessCrash as crash:
            raise MeshError(f"{failure}: its process {crash}") from None

    return wait_for_mesh


def start_mesher() -> None:
    """Fork the mesher process, best before MPI is initialized.

    It imports gmsh at once, so that the first mesh does not wait for that.
    """
    with suppress(OSError):
        _mesher.start()


def _load_gmsh() -> None:
    """Import gmsh in the mesher process."""
    with gmsh_session():
        pass


# The one mesher of this process, as gmsh has global state. It keeps gmsh's output for a crash.
_mesher = ForkedProcess(lambda call: call(), _load_gmsh)


@contextmanager
def gmsh_session() -> Iterator[Gmsh]:
    # Importing, initializing and finalizing gmsh each replace the handler of SIGINT.
    """Initialize gmsh with this program's options, yield the module, and finalize it."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        import gmsh
    except ImportError as missing:
        raise BackendError(
            f"gmsh is missing ({missing}); install the packages of packages-debian.txt"
        ) from missing
    gmsh.initialize([], False)  # Without user configuration the mesh depends on the scene alone.
    try:
        signal.signal(signal.SIGINT, handler)
        for option, value in GMSH_OPTIONS.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add("indent-sim")
        yield gmsh
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGINT, handler)
