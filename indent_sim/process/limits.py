"""Limits of a process: memory, open files, room for temporary files.

MPI, gmsh and PETSc end or hang without a word where they get too little of it, so a run asks before
it loads them; what runs out later is told as an expected failure.
"""

from __future__ import annotations

import errno
import math
import os
import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from indent_sim.process.errors import BackendError, IndentSimError, NotConverged, UsageError
from indent_sim.process.usage import address_space

MIN_OPEN_FILES = 48  # open at a time; a small run was seen to need up to 32
# processes and threads beside this one; Open MPI and the linear algebra were seen to need 15
MIN_TASKS = 20
MIN_ADDRESS_SPACE = 800e6  # bytes of address space; the libraries alone were seen to need 700 MB
OUT_OF_MEMORY_SIGNS = (
    "error code 55\n",
    "PetscMalloc",
    "INFOG(1)=-13",
)  # PETSc and MUMPS in the messages of petsc4py
DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)


def require_resources() -> None:
    """BackendError or NotConverged where the limits of this process are too narrow for any run,
    UsageError where it has no working directory.
    """
    try:
        os.getcwd()
    except OSError as error:
        raise UsageError(
            "the working directory is gone", "change to a folder that is there"
        ) from error
    _require_limit("open files", "ulimit -n", resource.RLIMIT_NOFILE, MIN_OPEN_FILES)
    _require_limit("MB of memory", "ulimit -v", resource.RLIMIT_AS, MIN_ADDRESS_SPACE / 1e6, 1e6)
    _require_tasks()
    folder = Path(os.environ.get("TMPDIR") or "/tmp")
    if not folder.is_dir():
        return  # libraries make it, or take another
    import tempfile  # which no help or list needs

    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(2**20))  # Open MPI keeps its session there
            file.flush()
    except OSError as error:
        kind = NotConverged if error.errno in DISK_FULL_ERRORS else BackendError
        raise kind(
            f"cannot keep temporary files in {folder}: {error.strerror}; TMPDIR names another "
            "folder"
        ) from error


def _require_limit(
    resource_name: str, limit: str, limit_number: int, needed: float, unit: float = 1.0
) -> None:
    allowed, _ = resource.getrlimit(limit_number)
    if allowed != resource.RLIM_INFINITY and allowed / unit < needed:
        raise BackendError(
            f"{allowed / unit:.0f} {resource_name} are allowed ({limit}); a run needs at least {needed:.0f}"
        )


def limit_resources(seconds: float, memory: float) -> None:
    """Allow this process so much CPU time in all [s] and so much memory beyond what it has [bytes].

    SIGXCPU ends it after that time; without memory it meets MemoryError, or dies of what a library
    makes of that.
    """
    for number, limit in (
        (resource.RLIMIT_CPU, math.ceil(seconds)),
        (resource.RLIMIT_AS, address_space() + memory),
    ):
        _, hard = resource.getrlimit(number)
        resource.setrlimit(
            number, (int(limit) if hard == resource.RLIM_INFINITY else min(int(limit), hard), hard)
        )


def _require_tasks() -> None:
    """BackendError where no more processes and threads can be started; others of the user count
    too, so it is tried.
    """
    all_started = threading.Event()
    started: list[threading.Thread] = []
    try:
        for _ in range(MIN_TASKS):
            thread = threading.Thread(target=all_started.wait)
            thread.start()
            started.append(thread)
    except RuntimeError as error:
        message = (
            f"{len(started)} more processes and threads can be started (ulimit -u); a run "
            f"needs {MIN_TASKS}"
        )
        raise BackendError(message) from error
    finally:
        all_started.set()
        for thread in started:  # a process will be forked, which copies none
            thread.join()


def write_error(target: object, error: OSError) -> IndentSimError:
    """What to raise where something cannot be written: NotConverged on a full disk, else
    UsageError.
    """
    kind = NotConverged if error.errno in DISK_FULL_ERRORS else UsageError
    return kind(f"cannot write {target}: {error.strerror or error}")


@contextmanager
def translate_resource_errors() -> Iterator[None]:
    """Memory, files or a disk that run out inside the block, and PETSc that refuses what the
    environment says, as the expected failures that they are.
    """
    try:
        yield
    except (MemoryError, OSError, RuntimeError) as error:
        if (resource_error := _resource_error(error)) is None:
            raise
        raise resource_error from error


def _resource_error(error: BaseException) -> IndentSimError | None:
    is_memory = isinstance(error, MemoryError) or any(
        sign in str(error) for sign in OUT_OF_MEMORY_SIGNS
    )
    number = errno.ENOMEM if is_memory else getattr(error, "errno", None)
    place = f" {name}" if (name := getattr(error, "filename", None)) else ""
    match number:
        case errno.ENOMEM:
            return NotConverged(
                "the memory that this process may have is used up; a coarser mesh needs less"
            )
        case errno.EMFILE | errno.ENFILE:
            return BackendError(f"too many open files{place} (ulimit -n)")
        case errno.ENOSPC | errno.EDQUOT:
            return NotConverged(f"cannot write{place}: {os.strerror(number)}")
    options = os.environ.get("PETSC_OPTIONS")
    if options and "PETSc" in type(error).__module__ + str(
        error
    ):  # without it that is a bug of this program
        reason = str(error).strip().splitlines()[-1].removeprefix("[0] ")
        return BackendError(
            f"PETSc stopped with PETSC_OPTIONS={options!r} in the environment: {reason}; try without"
        )
    return None
