"""P."""

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
Gmsh = Any  # the module, which is loaded where it meshes alone, or one of its kernels
GMSH_OPTIONS = {
    "General.Terminal": 0,
    "General.Verbosity": 1,
    "General.NumThreads": 1,
}  # says errors alone
GMSH_OPTIONS |= {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeFromPoints": 0}


def call_in_mesher(
    failure: str, function: Callable[..., T], *arguments: object, **child_arguments: object
) -> Callable[[], T]:
    """Begin a call in the forked process, told `child_arguments` too; what is returned waits for what it
    gives.

    On several ranks the arrays stay in a temporary file, from which they are divided; a process is
    not forked once MPI may be up, and without room for one this process does it. MeshError where it
    crashes, with `failure` as its words.
    """
    call = partial(function, *arguments)
    if not _mesher.is_running and is_parallel():
        return call
    try:
        wait_for_result = _mesher.begin_call(partial(call, **child_arguments), mapped=is_parallel())
    except OSError:
        return call

    def wait_for_mesh() -> T:
        try:
            return wait_for_result()
        except ProcessCrash as crash:
            raise MeshError(f"{failure}: its process {crash}") from None

    return wait_for_mesh


def start_mesher() -> None:
    """Fork the process that meshes, best before MPI is up; it loads gmsh, which the first mesh
    would wait for.
    """
    with suppress(OSError):
        _mesher.start()


def _load_gmsh() -> None:
    with gmsh_session():
        pass


_mesher = ForkedProcess(
    lambda call: call(), _load_gmsh
)  # one for this process, as gmsh is; keeps what gmsh prints for a crash


@contextmanager
def gmsh_session() -> Iterator[Gmsh]:
    handler = signal.getsignal(
        signal.SIGINT
    )  # importing, initialising and finalising gmsh each take it away
    try:
        import gmsh
    except ImportError as missing:
        raise BackendError(
            f"gmsh is missing ({missing}); install the packages of packages-debian.txt"
        ) from missing
    gmsh.initialize([], False)  # no user configuration: the mesh depends on the scene alone
    try:
        signal.signal(signal.SIGINT, handler)
        for option, value in GMSH_OPTIONS.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add("indent-sim")
        yield gmsh
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGINT, handler)
