"""Limits of a process: memory, open files, room for temporary files.

MPI, gmsh and PETSc end or hang without a word where they get too little of it, so a run asks before it loads them; what
runs out later is told as an expected failure.
"""

from __future__ import annotations

import errno
import os
import resource
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from indent_sim.process.errors import BackendError, IndentSimError, NotConverged

FILES = 48  # open at a time; a small run was seen to need up to 32
MEMORY = 800e6  # bytes of address space; the libraries alone were seen to need 700 MB
ROOM = 2**20  # bytes for temporary files; Open MPI keeps its session there
NO_MEMORY = ("error code 55\n", "PetscMalloc", "INFOG(1)=-13")  # PETSc and MUMPS in the messages of petsc4py
FULL = (errno.ENOSPC, errno.EDQUOT)


def require_room() -> None:
    """BackendError or NotConverged where the limits of this process are too narrow for any run."""
    _require("open files", "ulimit -n", resource.RLIMIT_NOFILE, FILES)
    _require("MB of memory", "ulimit -v", resource.RLIMIT_AS, MEMORY / 1e6, 1e6)
    folder = Path(os.environ.get("TMPDIR") or "/tmp")
    if not folder.is_dir():
        return  # libraries make it, or take another
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(ROOM))
            file.flush()
    except OSError as error:
        kind = NotConverged if error.errno in FULL else BackendError
        raise kind(f"cannot keep temporary files in {folder}: {error.strerror}; TMPDIR names another folder") from error


def _require(what: str, limit: str, number: int, least: float, unit: float = 1.0) -> None:
    allowed, _ = resource.getrlimit(number)
    if allowed != resource.RLIM_INFINITY and allowed / unit < least:
        raise BackendError(f"{allowed / unit:.0f} {what} are allowed ({limit}); a run needs at least {least:.0f}")


@contextmanager
def spent() -> Iterator[None]:
    """Memory, files or a disk that run out inside the block as the expected failures that they are."""
    try:
        yield
    except (MemoryError, OSError, RuntimeError) as error:
        if (known := _known(error)) is None:
            raise
        raise known from error


def _known(error: BaseException) -> IndentSimError | None:
    is_memory = isinstance(error, MemoryError) or any(sign in str(error) for sign in NO_MEMORY)
    number = errno.ENOMEM if is_memory else getattr(error, "errno", None)
    name = getattr(error, "filename", None)
    place = f" {name}" if name else ""
    match number:
        case errno.ENOMEM:
            return NotConverged("the memory that this process may have is used up; a coarser mesh needs less")
        case errno.EMFILE | errno.ENFILE:
            return BackendError(f"too many open files{place} (ulimit -n)")
        case errno.ENOSPC | errno.EDQUOT:
            return NotConverged(f"cannot write{place}: {os.strerror(number)}")
    return None
